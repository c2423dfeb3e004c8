//! Distance to the nearest surface, for walks that need no ray while they stay closer than that.

use super::scene::{CommittedScene, Resource};
use crate::math::Bounds3;
use embree4_sys as sys;
use glam::{DAffine3, DVec3, Vec3};
use std::ffi::c_void;

/// Query that the callback reads and answers.
struct Search<'a> {
    scene: &'a CommittedScene,
    at: DVec3,
    /// Smallest distance so far.
    nearest: f64,
}

/// Share of the distance, and of the largest coordinate, that the result is less than the distance computed: more than roundings of
/// coordinates in `f32`, of transforms, and of the parameter of a ray.
const MARGIN: f64 = 1e-5;

impl CommittedScene {
    /// A distance from `at` within which no ray hits anything, at most `reach`. Of triangles it is their distance less a margin for rounding;
    /// of user geometry, that of the bounds of its primitives. Zero where a coordinate is not finite, or `reach` is not positive.
    pub fn clearance(&self, at: Vec3, reach: f32) -> f32 {
        if !(at.is_finite() && reach > 0.0 && reach.is_finite()) {
            return 0.0;
        }
        let mut search = Search { scene: self, at: at.as_dvec3(), nearest: reach.into() };
        let mut query = sys::RTCPointQuery { x: at.x, y: at.y, z: at.z, time: 0.0, radius: reach };
        let mut context = sys::RTCPointQueryContext {
            world2inst: [[0.0; 16]],
            inst2world: [[0.0; 16]],
            instID: [sys::RTC_INVALID_GEOMETRY_ID],
            instPrimID: [sys::RTC_INVALID_GEOMETRY_ID],
            instStackSize: 0,
        };
        let user = (&raw mut search).cast::<c_void>();
        // SAFETY: a committed scene; query and context are locals of the layouts that the library expects, with an empty stack of
        // instances; the callback reads `user` as the `Search` that it is, and nobody else uses it during the query.
        unsafe {
            sys::rtcPointQuery(self.handle(), &raw mut query, &raw mut context, Some(measure), user);
        }
        let margin = MARGIN * (search.nearest + search.at.abs().max_element());
        (search.nearest - margin).max(0.0) as f32
    }

    /// Lower bound on the distance from `at` to a primitive of this scene that `to_world` places.
    fn distance(&self, (geometry, primitive): (u32, u32), to_world: &DAffine3, at: DVec3) -> f64 {
        match self.resources.get(geometry as usize) {
            Some(Resource::Triangles(buffers) | Resource::Cut(buffers, _)) => {
                let corners = buffers.triangles()[primitive as usize];
                let place = |corner: u32| {
                    let [x, y, z] = buffers.positions()[corner as usize];
                    to_world.transform_point3(DVec3::new(x.into(), y.into(), z.into()))
                };
                distance_to_triangle(at, corners.map(place))
            }
            Some(Resource::User(user)) => {
                let bounds = user
                    .guarded(Bounds3 { min: DVec3::MIN, max: DVec3::MAX }, |object| object.bounds(primitive));
                distance_to_box(at, &bounds, to_world)
            }
            // Not reached: Embree enters instances by itself.
            Some(Resource::Instanced(_)) | None => 0.0,
        }
    }
}

/// Called by Embree for each primitive that may be nearer than the radius of the query; true where it has made that smaller.
unsafe extern "C" fn measure(arguments: *mut sys::RTCPointQueryFunctionArguments) -> bool {
    // SAFETY: valid for the call; `userPtr` is the `Search` of `clearance`, which nobody else uses during the query, and the context is its
    // local.
    let (arguments, search, context) = unsafe {
        let arguments = &mut *arguments;
        let search = &mut *arguments.userPtr.cast::<Search<'_>>();
        let context = &*arguments.context;
        (arguments, search, context)
    };
    let primitive = (arguments.geomID, arguments.primID);
    let distance = if context.instStackSize == 0 {
        search.scene.distance(primitive, &DAffine3::IDENTITY, search.at)
    } else {
        match search.scene.resources.get(context.instID[0] as usize) {
            Some(Resource::Instanced(inner)) => {
                let m = context.inst2world[0].map(f64::from);
                let column = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
                let to_world = DAffine3::from_cols(column(0), column(1), column(2), column(3));
                inner.distance(primitive, &to_world, search.at)
            }
            _ => 0.0,
        }
    };
    if !(distance < search.nearest) {
        // NaN, of places that are not finite, counts as no clearance.
        if distance.is_nan() {
            search.nearest = 0.0;
        }
        return false;
    }
    search.nearest = distance;
    // In the space of the scene, also within instances.
    // SAFETY: the query of `clearance`, which Embree reads again where the callback returns true.
    unsafe { (*arguments.query).radius = (distance as f32).next_up() };
    true
}

/// Distance from a point to a triangle (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
fn distance_to_triangle(at: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let edges = [(a, b), (b, c), (c, a)];
    let normal = (b - a).cross(c - a);
    let is_inside = edges.iter().all(|&(from, to)| (to - from).cross(at - from).dot(normal) >= 0.0);
    let length = normal.length();
    if is_inside && length > 0.0 {
        return (at - a).dot(normal).abs() / length;
    }
    let to_edge = |(from, to): (DVec3, DVec3)| {
        let along = to - from;
        let square = along.length_squared();
        let t = if square > 0.0 { ((at - from).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
        (from + t * along).distance(at)
    };
    edges.into_iter().map(to_edge).fold(f64::INFINITY, f64::min)
}

/// Lower bound on the distance from a point to a box that a transform places: to the box, along the axes of the world, that contains it.
fn distance_to_box(at: DVec3, bounds: &Bounds3, to_world: &DAffine3) -> f64 {
    let corner = |i: u8| {
        let pick = |axis: u8, low: f64, high: f64| if i >> axis & 1 == 0 { low } else { high };
        let (low, high) = (bounds.min, bounds.max);
        to_world.transform_point3(DVec3::new(
            pick(0, low.x, high.x),
            pick(1, low.y, high.y),
            pick(2, low.z, high.z),
        ))
    };
    let (low, high) = (0..8)
        .map(corner)
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), place| (low.min(place), high.max(place)));
    (low - at).max(at - high).max(DVec3::ZERO).length()
}

#[cfg(test)]
mod tests {
    use super::super::{Device, ObjectHit, Procedural, SceneBuilder, TriangleBuffers};
    use super::*;
    use crate::math::Ray;
    use crate::sampling::{Rng, Stream, warp};
    use std::sync::Arc;

    fn soup(rng: &mut Rng, count: u32) -> TriangleBuffers {
        let mut place = || (warp::square_to_sphere(rng.next_2d()) * rng.next_f32()).to_array();
        let positions = (0..3 * count).map(|_| place()).collect();
        TriangleBuffers::new(positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()).unwrap()
    }

    #[derive(Debug)]
    struct Slab;

    impl Procedural for Slab {
        fn bounds(&self, _primitive: u32) -> Bounds3 {
            Bounds3 { min: DVec3::new(-1.0, -1.0, 2.0), max: DVec3::new(1.0, 1.0, 2.5) }
        }

        fn nearest(&self, _primitive: u32, _ray: &Ray) -> Option<ObjectHit> {
            None
        }
    }

    /// Random rays that start at a place hit nothing nearer than its clearance, of meshes and of instances that are stretched; and no
    /// triangle is nearer than told by more than the margin.
    #[test]
    fn no_ray_hits_within_the_clearance() {
        let mut rng = Rng::new(3, Stream::Measure, 0);
        let device = Arc::new(Device::new(1).unwrap());
        let buffers = soup(&mut rng, 40);
        let mut inner = SceneBuilder::new(&device).unwrap();
        inner.add_triangles(buffers.clone()).unwrap();
        let inner = Arc::new(inner.commit().unwrap());
        let mut outer = SceneBuilder::new(&device).unwrap();
        let place = DAffine3::from_scale_rotation_translation(
            DVec3::new(0.5, 2.0, 1.0),
            glam::DQuat::from_rotation_y(0.7),
            DVec3::new(3.0, 0.0, 0.0),
        );
        outer.add_instance(&inner, &place).unwrap();
        let similar = DAffine3::from_scale_rotation_translation(
            DVec3::splat(0.3),
            glam::DQuat::from_rotation_x(1.0),
            DVec3::new(0.0, -2.0, 0.0),
        );
        outer.add_instance(&inner, &similar).unwrap();
        outer.add_triangles(buffers.clone()).unwrap();
        let scene = outer.commit().unwrap();
        let mut known = 0;
        for _ in 0..300 {
            let at = warp::square_to_sphere(rng.next_2d()) * 2.0 + Vec3::X;
            let clear = scene.clearance(at, 1.0);
            assert!((0.0..=1.0).contains(&clear));
            known += u32::from(clear > 0.1 && clear < 0.99);
            for _ in 0..200 {
                let ray = Ray::new(at, warp::square_to_sphere(rng.next_2d()));
                let hit = scene.intersect(&ray).map_or(f32::INFINITY, |hit| hit.t);
                assert!(hit >= clear, "{at}: {hit} within {clear}");
            }
            let mut nearest = 1.0f64;
            for place in [place, similar, DAffine3::IDENTITY] {
                for &triangle in buffers.triangles() {
                    let corner = |i: u32| {
                        place.transform_point3(Vec3::from(buffers.positions()[i as usize]).as_dvec3())
                    };
                    nearest = nearest.min(distance_to_triangle(at.as_dvec3(), triangle.map(corner)));
                }
            }
            assert!((nearest - f64::from(clear)).abs() < 1e-4, "{nearest} {clear}");
        }
        assert!(known > 50, "{known}");
    }

    #[test]
    fn distances_to_triangles() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let about = |x: f64, y: f64, z: f64, wanted: f64| {
            let found = distance_to_triangle(DVec3::new(x, y, z), triangle);
            assert!((found - wanted).abs() < 1e-12, "{x} {y} {z}: {found}");
        };
        about(0.25, 0.25, 2.0, 2.0);
        about(-3.0, -4.0, 0.0, 5.0);
        about(0.5, -2.0, 0.0, 2.0);
        about(2.0, 0.0, 0.0, 1.0);
        about(1.0, 1.0, 0.0, 0.5f64.sqrt());
        // A triangle without area is a line.
        let line = [DVec3::ZERO, DVec3::X, DVec3::X];
        assert!((distance_to_triangle(DVec3::new(0.5, 0.0, 1.0), line) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn user_geometry_is_as_near_as_its_bounds() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        builder.add_procedural(Arc::new(Slab)).unwrap();
        let scene = builder.commit().unwrap();
        assert!((scene.clearance(Vec3::ZERO, 10.0) - 2.0).abs() < 1e-3);
        assert_eq!(scene.clearance(Vec3::new(0.0, 0.0, 2.2), 10.0), 0.0);
        assert!((scene.clearance(Vec3::ZERO, 1.0) - 1.0).abs() < 1e-3);
        for (at, reach) in
            [(Vec3::NAN, 1.0), (Vec3::ZERO, f32::NAN), (Vec3::ZERO, -1.0), (Vec3::INFINITY, 1.0)]
        {
            assert_eq!(scene.clearance(at, reach), 0.0);
        }
    }
}
