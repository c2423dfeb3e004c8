//! Embree scenes: construction, commit and ray queries.

use super::all_hits::{AllHits, COLLECTS, Collection, collect_triangle, instance_of};
use super::callbacks::{self, UserGeometry};
use super::cutout::{self, CutGeometry, Cutout};
use super::device::{Device, EmbreeError};
use super::{Procedural, TriangleBuffers};
use crate::math::Ray;
use embree4_sys as sys;
use glam::DAffine3;
use std::ffi::c_void;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of a geometry in its scene, from 0 in the order in which geometries were added.
pub type GeometryId = u32;

/// A hit as Embree reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawHit {
    /// Geometry in the queried scene, or in the instanced scene where `instance` is set.
    pub geometry: GeometryId,
    /// Primitive in that geometry.
    pub primitive: u32,
    /// Geometry number of the instance in the queried scene; `None` for a direct hit.
    pub instance: Option<GeometryId>,
    /// Barycentric coordinates of the second and third corner; zero for user geometry.
    pub uv: [f32; 2],
    /// Ray parameter, rounded to `f32`.
    pub t: f32,
}

/// Owner of memory that Embree reads while it traces. The value is kept alive and never read.
#[derive(Debug)]
#[allow(dead_code, reason = "owned on behalf of Embree")]
pub(super) enum Resource {
    Triangles(TriangleBuffers),
    Cut(TriangleBuffers, Box<CutGeometry>),
    User(Box<UserGeometry>),
    Instanced(Arc<CommittedScene>),
}

/// A scene handle that is released once.
struct Handle(sys::RTCScene);

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the reference that `rtcNewScene` returned.
        unsafe { sys::rtcReleaseScene(self.0) };
    }
}

/// Progress callback of a build.
struct Watch<'a>(&'a (dyn Fn(f64) -> bool + Sync));

/// Called by Embree while it builds, from any thread.
extern "C" fn report_progress(watch: *mut c_void, share: f64) -> bool {
    if watch.is_null() {
        return true;
    }
    // SAFETY: the pointer is to the local of `commit_watched`, which waits for the build.
    let watch = unsafe { &*watch.cast::<Watch<'_>>() };
    // A panic must not unwind into the library.
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| (watch.0)(share))).unwrap_or(true)
}

/// A scene under construction.
pub struct SceneBuilder {
    // Dropped first: Embree's geometries are released before the memory that they read.
    handle: Handle,
    resources: Vec<Resource>,
    panics: Arc<AtomicU64>,
    device: Arc<Device>,
    robust: bool,
}

impl fmt::Debug for SceneBuilder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneBuilder").field("geometries", &self.resources.len()).finish_non_exhaustive()
    }
}

impl SceneBuilder {
    /// An empty scene in which rays do not pass between triangles that share an edge (Embree's robust flag).
    ///
    /// # Errors
    /// If Embree runs out of memory.
    pub fn new(device: &Arc<Device>) -> Result<Self, EmbreeError> {
        Self::with_robust(device, true)
    }

    /// An empty scene as from [`Self::new`], with or without the robust flag. Benchmarks alone switch it off.
    ///
    /// # Errors
    /// If Embree runs out of memory.
    pub fn with_robust(device: &Arc<Device>, robust: bool) -> Result<Self, EmbreeError> {
        // SAFETY: a valid device.
        let handle = unsafe { sys::rtcNewScene(device.handle()) };
        device.check("make a scene")?;
        let handle = Handle(handle);
        if robust {
            // SAFETY: a valid scene, not committed yet.
            unsafe { sys::rtcSetSceneFlags(handle.0, sys::RTC_SCENE_FLAG_ROBUST) };
        }
        Ok(Self { handle, resources: Vec::new(), panics: Arc::default(), device: Arc::clone(device), robust })
    }

    /// Adds triangles, which Embree reads in place.
    ///
    /// # Errors
    /// If Embree refuses the buffers or runs out of memory.
    pub fn add_triangles(&mut self, buffers: TriangleBuffers) -> Result<GeometryId, EmbreeError> {
        let action = "add triangles";
        let geometry = self.new_triangles(&buffers, action)?;
        self.attach(geometry, Resource::Triangles(buffers), action)
    }

    /// Adds triangles with holes (see [`Cutout`]), which Embree reads in place.
    ///
    /// # Errors
    /// As for [`Self::add_triangles`].
    pub fn add_cut_triangles(
        &mut self,
        buffers: TriangleBuffers,
        cutout: Arc<dyn Cutout>,
    ) -> Result<GeometryId, EmbreeError> {
        let action = "add triangles with holes";
        let geometry = self.new_triangles(&buffers, action)?;
        let cut = Box::new(CutGeometry { cutout, panics: Arc::clone(&self.panics) });
        let pointer = std::ptr::from_ref::<CutGeometry>(&cut).cast_mut().cast::<c_void>();
        // SAFETY: `pointer` is the address of a box that the scene keeps as long as the geometry; the filter expects
        // exactly that type behind it.
        unsafe {
            sys::rtcSetGeometryUserData(geometry, pointer);
            sys::rtcSetGeometryIntersectFilterFunction(geometry, Some(cutout::pass_holes));
            sys::rtcSetGeometryOccludedFilterFunction(geometry, Some(cutout::pass_holes));
        }
        self.attach(geometry, Resource::Cut(buffers, cut), action)
    }

    fn new_triangles(
        &self,
        buffers: &TriangleBuffers,
        action: &'static str,
    ) -> Result<sys::RTCGeometry, EmbreeError> {
        let geometry = self.new_geometry(sys::RTC_GEOMETRY_TYPE_TRIANGLE, action)?;
        // SAFETY: both buffers are owned by `buffers`, which the scene keeps (callers hand them to it); positions have 16 readable bytes at
        // the last vertex and all indices are in range (`TriangleBuffers::new`).
        unsafe {
            sys::rtcSetSharedGeometryBuffer(
                geometry,
                sys::RTC_BUFFER_TYPE_VERTEX,
                0,
                sys::RTC_FORMAT_FLOAT3,
                buffers.positions().as_ptr().cast::<c_void>(),
                0,
                size_of::<[f32; 3]>(),
                buffers.positions().len(),
            );
            sys::rtcSetSharedGeometryBuffer(
                geometry,
                sys::RTC_BUFFER_TYPE_INDEX,
                0,
                sys::RTC_FORMAT_UINT3,
                buffers.triangles().as_ptr().cast::<c_void>(),
                0,
                size_of::<[u32; 3]>(),
                buffers.triangles().len(),
            );
        }
        Ok(geometry)
    }

    /// Adds user geometry.
    ///
    /// # Errors
    /// If Embree runs out of memory.
    pub fn add_procedural(&mut self, object: Arc<dyn Procedural>) -> Result<GeometryId, EmbreeError> {
        let action = "add a procedural object";
        let count = object.primitive_count();
        let geometry = self.new_geometry(sys::RTC_GEOMETRY_TYPE_USER, action)?;
        let user = Box::new(UserGeometry { object, panics: Arc::clone(&self.panics) });
        let pointer = std::ptr::from_ref::<UserGeometry>(&user).cast_mut().cast::<c_void>();
        // SAFETY: `pointer` is the address of a box that the scene keeps as long as the geometry; the callbacks
        // expect exactly that type behind it.
        unsafe {
            sys::rtcSetGeometryUserPrimitiveCount(geometry, count);
            sys::rtcSetGeometryUserData(geometry, pointer);
            sys::rtcSetGeometryBoundsFunction(geometry, Some(callbacks::bounds), std::ptr::null_mut());
            sys::rtcSetGeometryIntersectFunction(geometry, Some(callbacks::intersect));
            sys::rtcSetGeometryOccludedFunction(geometry, Some(callbacks::occluded));
        }
        self.attach(geometry, Resource::User(user), action)
    }

    /// Adds an instance of another scene. Embree follows one level of instances, so `scene` must not contain instances.
    ///
    /// # Errors
    /// If Embree runs out of memory.
    pub fn add_instance(
        &mut self,
        scene: &Arc<CommittedScene>,
        to_world: &DAffine3,
    ) -> Result<GeometryId, EmbreeError> {
        let action = "add an instance";
        let geometry = self.new_geometry(sys::RTC_GEOMETRY_TYPE_INSTANCE, action)?;
        let columns = to_world.to_cols_array().map(|x| x as f32);
        // SAFETY: the instanced scene is kept by this one; Embree copies the 12 floats.
        unsafe {
            sys::rtcSetGeometryInstancedScene(geometry, scene.handle.0);
            sys::rtcSetGeometryTransform(
                geometry,
                0,
                sys::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                columns.as_ptr().cast::<c_void>(),
            );
        }
        self.attach(geometry, Resource::Instanced(Arc::clone(scene)), action)
    }

    /// Builds the hierarchies.
    ///
    /// # Errors
    /// If Embree runs out of memory.
    pub fn commit(self) -> Result<CommittedScene, EmbreeError> {
        // SAFETY: a valid scene that only this builder knows.
        unsafe { sys::rtcCommitScene(self.handle.0) };
        self.committed()
    }

    /// Builds the hierarchies as [`Self::commit`] does, and repeatedly reports the share that is built to `progress`, from any thread. The
    /// build stops where `progress` returns false.
    ///
    /// # Errors
    /// If Embree runs out of memory or was stopped.
    pub fn commit_watched(
        self,
        progress: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<CommittedScene, EmbreeError> {
        let watch = Watch(progress);
        let slot = std::ptr::from_ref(&watch).cast_mut().cast::<c_void>();
        // SAFETY: a valid scene that only this builder knows; `watch` outlives the build, after which the library forgets it.
        unsafe { sys::rtcSetSceneProgressMonitorFunction(self.handle.0, Some(report_progress), slot) };
        let handle = self.handle.0;
        // SAFETY: as in `commit`.
        unsafe { sys::rtcCommitScene(handle) };
        // SAFETY: as above.
        unsafe { sys::rtcSetSceneProgressMonitorFunction(handle, None, std::ptr::null_mut()) };
        self.committed()
    }

    fn committed(self) -> Result<CommittedScene, EmbreeError> {
        self.device.check("build the scene")?;
        let Self { handle, resources, panics, device, robust } = self;
        Ok(CommittedScene { handle, resources, panics, device, robust })
    }

    fn new_geometry(
        &self,
        kind: sys::RTCGeometryType,
        action: &'static str,
    ) -> Result<sys::RTCGeometry, EmbreeError> {
        // SAFETY: a valid device.
        let geometry = unsafe { sys::rtcNewGeometry(self.device.handle(), kind) };
        self.device.check(action)?;
        Ok(geometry)
    }

    /// Commits, attaches and releases `geometry`; the scene then holds the only reference.
    fn attach(
        &mut self,
        geometry: sys::RTCGeometry,
        resource: Resource,
        action: &'static str,
    ) -> Result<GeometryId, EmbreeError> {
        let id = self.resources.len() as u32;
        // Pushed first, so that the memory outlives the geometry even if attaching fails.
        self.resources.push(resource);
        // SAFETY: a valid geometry of the same device; the reference from `rtcNewGeometry` is given back after the
        // scene has taken its own.
        unsafe {
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(self.handle.0, geometry, id);
            sys::rtcReleaseGeometry(geometry);
        }
        self.device.check(action)?;
        Ok(id)
    }
}

/// An immutable scene in which any number of threads may trace rays.
pub struct CommittedScene {
    // Dropped first, see `SceneBuilder`.
    handle: Handle,
    pub(super) resources: Vec<Resource>,
    panics: Arc<AtomicU64>,
    device: Arc<Device>,
    robust: bool,
}

// SAFETY: Embree allows concurrent queries in a committed scene, and nothing here changes it; what user geometry
// shares is `Send + Sync` (`Procedural` requires both).
unsafe impl Send for CommittedScene {}
// SAFETY: as above.
unsafe impl Sync for CommittedScene {}

impl fmt::Debug for CommittedScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CommittedScene")
            .field("geometries", &self.resources.len())
            .field("robust", &self.robust)
            .finish_non_exhaustive()
    }
}

impl CommittedScene {
    /// The nearest hit in `(0, ray.t_max]`. A ray with NaN hits nothing.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<RawHit> {
        let mut query = sys::RTCRayHit { ray: ray_of(ray), hit: NO_HIT };
        // SAFETY: a committed scene; `query` is a local of the layout and alignment that the library expects
        // (checked by the layout tests of embree4-sys); null arguments mean the defaults.
        unsafe { sys::rtcIntersect1(self.handle.0, &raw mut query, std::ptr::null_mut()) };
        if query.hit.geomID == sys::RTC_INVALID_GEOMETRY_ID {
            return None;
        }
        Some(RawHit {
            geometry: query.hit.geomID,
            primitive: query.hit.primID,
            instance: instance_of(query.hit.instID[0]),
            uv: [query.hit.u, query.hit.v],
            t: query.ray.tfar,
        })
    }

    /// Finds all crossings in `(0, ray.t_max]` of every primitive, and stores them sorted in `found`. A ray through an edge that triangles
    /// share may cross each of them. A ray with NaN crosses nothing.
    ///
    /// A filter rejects every hit, so that one traversal visits all of them. A ray that restarted behind each hit would lose crossings at
    /// equal parameters. User geometry reports its own crossings ([`Procedural::intersect_all`]).
    pub fn intersect_all(&self, ray: &Ray, found: &mut AllHits) {
        found.clear();
        let mut query = sys::RTCRayHit { ray: sys::RTCRay { id: COLLECTS, ..ray_of(ray) }, hit: NO_HIT };
        let mut collection = Collection {
            context: sys::RTCRayQueryContext {
                instID: [sys::RTC_INVALID_GEOMETRY_ID],
                instPrimID: [sys::RTC_INVALID_GEOMETRY_ID],
            },
            found: std::ptr::from_mut(found),
        };
        let mut arguments = sys::RTCIntersectArguments {
            flags: sys::RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER,
            feature_mask: sys::RTC_FEATURE_FLAG_ALL,
            context: (&raw mut collection).cast::<sys::RTCRayQueryContext>(),
            filter: Some(collect_triangle),
            intersect: None,
        };
        // SAFETY: a committed scene; `query`, `arguments` and `collection` are locals of the layouts that the library
        // expects, and the context is the first field of a `Collection`, as the callbacks of such rays assume. They
        // alone use `found` while the query runs, one after the other.
        unsafe { sys::rtcIntersect1(self.handle.0, &raw mut query, &raw mut arguments) };
        found.finish();
    }

    /// Whether [`Self::intersect_all`] finds triangles. It does if Embree was built with filter functions, which is the default.
    pub fn finds_all_crossings(&self) -> bool {
        self.device.has_filters()
    }

    /// Whether anything lies in `(0, ray.t_max]`.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut query = ray_of(ray);
        // SAFETY: as in `intersect`.
        unsafe { sys::rtcOccluded1(self.handle.0, &raw mut query, std::ptr::null_mut()) };
        query.tfar < 0.0
    }

    /// Number of panics caught in user geometry so far; each counted as a miss.
    pub fn panics(&self) -> u64 {
        self.panics.load(Ordering::Relaxed)
            + self
                .resources
                .iter()
                .map(|resource| match resource {
                    Resource::Instanced(scene) => scene.panics(),
                    Resource::Triangles(_) | Resource::Cut(..) | Resource::User(_) => 0,
                })
                .sum::<u64>()
    }

    pub(super) fn handle(&self) -> sys::RTCScene {
        self.handle.0
    }

    /// The device that built it.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }
}

const NO_HIT: sys::RTCHit = sys::RTCHit {
    Ng_x: 0.0,
    Ng_y: 0.0,
    Ng_z: 0.0,
    u: 0.0,
    v: 0.0,
    primID: sys::RTC_INVALID_GEOMETRY_ID,
    geomID: sys::RTC_INVALID_GEOMETRY_ID,
    instID: [sys::RTC_INVALID_GEOMETRY_ID],
    instPrimID: [sys::RTC_INVALID_GEOMETRY_ID],
};

#[inline]
fn ray_of(ray: &Ray) -> sys::RTCRay {
    sys::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        // Not zero: Embree's robust test accepts `t = tnear`, and a ray that starts exactly in an axis-aligned plane through the origin
        // hits that plane at exactly `t = 0`.
        tnear: f32::MIN_POSITIVE,
        dir_x: ray.direction.x,
        dir_y: ray.direction.y,
        dir_z: ray.direction.z,
        time: 0.0,
        tfar: ray.t_max,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::ObjectHit;
    use super::*;
    use crate::math::Bounds3;
    use glam::{DVec3, Vec3};

    fn triangle() -> TriangleBuffers {
        TriangleBuffers::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]])
            .unwrap()
    }

    /// A plane `z = 0` of the unit square that panics where x is beyond `limit`.
    #[derive(Debug)]
    struct Sheet {
        limit: f32,
    }

    impl Procedural for Sheet {
        fn bounds(&self, _primitive: u32) -> Bounds3 {
            Bounds3 { min: DVec3::new(0.0, 0.0, -1e-6), max: DVec3::new(1.0, 1.0, 1e-6) }
        }

        fn nearest(&self, _primitive: u32, ray: &Ray) -> Option<ObjectHit> {
            assert!(ray.origin.x < self.limit, "on purpose");
            let t = f64::from(-ray.origin.z / ray.direction.z);
            (t > 0.0 && t <= f64::from(ray.t_max)).then_some(ObjectHit { t, normal: DVec3::Z, error: 1e-7 })
        }
    }

    #[test]
    fn a_build_is_followed_and_can_be_stopped() {
        let device = Arc::new(Device::new(2).unwrap());
        let side = 300u32;
        let places =
            (0..=side).flat_map(|y| (0..=side).map(move |x| [x as f32, y as f32, (x * y % 7) as f32]));
        let corner = move |x: u32, y: u32| y * (side + 1) + x;
        let faces = (0..side)
            .flat_map(move |y| (0..side).map(move |x| [corner(x, y), corner(x + 1, y), corner(x, y + 1)]));
        let buffers = TriangleBuffers::new(places.collect(), faces.collect()).unwrap();
        for goes_on in [true, false] {
            let mut builder = SceneBuilder::new(&device).unwrap();
            builder.add_triangles(buffers.clone()).unwrap();
            let calls = AtomicU64::new(0);
            let result = builder.commit_watched(&|share| {
                assert!((0.0..=1.5).contains(&share));
                calls.fetch_add(1, Ordering::Relaxed);
                goes_on
            });
            assert!(calls.into_inner() > 0);
            assert_eq!(result.is_ok(), goes_on, "{result:?}");
        }
    }

    #[test]
    fn triangles_instances_and_user_geometry_in_one_scene() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut inner = SceneBuilder::new(&device).unwrap();
        inner.add_triangles(triangle()).unwrap();
        let inner = Arc::new(inner.commit().unwrap());
        let mut outer = SceneBuilder::new(&device).unwrap();
        assert_eq!(outer.add_triangles(triangle()).unwrap(), 0);
        let place = DAffine3::from_translation(DVec3::new(10.0, 0.0, 5.0));
        assert_eq!(outer.add_instance(&inner, &place).unwrap(), 1);
        assert_eq!(outer.add_procedural(Arc::new(Sheet { limit: 0.5 })).unwrap(), 2);
        let scene = outer.commit().unwrap();
        drop(inner);

        let down = |x: f32, z: f32| Ray::new(Vec3::new(x, 0.25, z), Vec3::NEG_Z);
        // Embree rounds differently for each instruction set; the tolerance is a few roundoffs of the coordinates.
        let is_about = |a: f32, b: f32, scale: f32| (a - b).abs() <= 8.0 * f32::EPSILON * scale;
        let hit = scene.intersect(&down(10.25, 7.0)).unwrap();
        assert_eq!((hit.geometry, hit.instance), (0, Some(1)));
        assert!(is_about(hit.t, 2.0, 10.25), "{}", hit.t);
        assert!(hit.uv.iter().all(|x| is_about(*x, 0.25, 10.25)), "{:?}", hit.uv);
        let hit = scene.intersect(&down(0.25, 2.0)).unwrap();
        assert!(hit.instance.is_none() && is_about(hit.t, 2.0, 2.0), "{}", hit.t);
        assert!(scene.intersect(&down(5.0, 2.0)).is_none());
        assert!(scene.occluded(&down(0.25, 2.0)) && !scene.occluded(&down(5.0, 2.0)));
        assert!(!scene.occluded(&Ray { t_max: 1.9, ..down(0.25, 2.0) }));
        assert!(scene.intersect(&down(f32::NAN, 2.0)).is_none());
    }

    #[test]
    fn a_ray_does_not_hit_the_plane_that_it_starts_in() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        builder.add_triangles(triangle()).unwrap();
        let scene = builder.commit().unwrap();
        for direction in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.1, -0.3, -0.5)] {
            let ray = Ray::new(Vec3::new(0.25, 0.25, 0.0), direction);
            assert!(scene.intersect(&ray).is_none() && !scene.occluded(&ray), "{direction}");
        }
    }

    #[test]
    fn a_panic_in_user_geometry_is_a_counted_miss() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        builder.add_procedural(Arc::new(Sheet { limit: 0.5 })).unwrap();
        let scene = builder.commit().unwrap();
        let at = |x: f32| Ray::new(Vec3::new(x, 0.5, 1.0), Vec3::NEG_Z);
        assert!(scene.intersect(&at(0.25)).is_some());
        assert_eq!(scene.panics(), 0);
        let quiet = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let missed = scene.intersect(&at(0.75)).is_none() && !scene.occluded(&at(0.75));
        std::panic::set_hook(quiet);
        assert!(missed);
        assert_eq!(scene.panics(), 2);
    }

    #[test]
    fn empty_scene_and_empty_mesh() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        builder.add_triangles(TriangleBuffers::new(vec![], vec![]).unwrap()).unwrap();
        let scene = builder.commit().unwrap();
        assert!(scene.intersect(&Ray::new(Vec3::ZERO, Vec3::Z)).is_none());
    }
}
