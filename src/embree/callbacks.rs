//! Callbacks of Embree for user geometry, and their user data.

use super::Procedural;
use super::all_hits::{COLLECTS, Collection, collect_user, instance_of};
use crate::math::Ray;
use embree4_sys as sys;
use glam::Vec3;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// User data of a geometry, which the callbacks read.
pub(super) struct UserGeometry {
    pub(super) object: Arc<dyn Procedural>,
    /// Panic counter, shared with the scene.
    pub(super) panics: Arc<AtomicU64>,
}

impl fmt::Debug for UserGeometry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("UserGeometry").field("object", &self.object).finish_non_exhaustive()
    }
}

impl UserGeometry {
    /// Runs `body`. A panic is counted, and the result is then `otherwise`.
    pub(super) fn guarded<T>(&self, otherwise: T, body: impl FnOnce(&dyn Procedural) -> T) -> T {
        catch_unwind(AssertUnwindSafe(|| body(&*self.object))).unwrap_or_else(|_| {
            self.panics.fetch_add(1, Ordering::Relaxed);
            otherwise
        })
    }
}

fn ray_of(ray: &sys::RTCRay) -> Ray {
    Ray {
        origin: Vec3::new(ray.org_x, ray.org_y, ray.org_z),
        direction: Vec3::new(ray.dir_x, ray.dir_y, ray.dir_z),
        t_max: ray.tfar,
    }
}

/// Bounds of one primitive. A primitive with empty or non-finite bounds is never hit.
pub(super) unsafe extern "C" fn bounds(arguments: *const sys::RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the `UserGeometry` set with the geometry, which
    // the scene owns longer than Embree's geometry.
    let (geometry, primitive, output) = unsafe {
        let arguments = &*arguments;
        (&*arguments.geometryUserPtr.cast::<UserGeometry>(), arguments.primID, &mut *arguments.bounds_o)
    };
    let (low, high) = geometry.guarded(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), |object| {
        object.bounds(primitive).to_f32_outward()
    });
    [output.lower_x, output.lower_y, output.lower_z] = low;
    [output.upper_x, output.upper_y, output.upper_z] = high;
}

/// Nearest hit of one ray with one primitive.
pub(super) unsafe extern "C" fn intersect(arguments: *const sys::RTCIntersectFunctionNArguments) {
    // SAFETY: valid for the call; see `bounds`. This crate traces single rays only, so N is 1 and the ray and hit
    // have the layout of `RTCRayHit`; other widths are left alone.
    let (arguments, geometry) = unsafe {
        let arguments = &*arguments;
        if arguments.N != 1 || *arguments.valid != -1 {
            return;
        }
        (arguments, &*arguments.geometryUserPtr.cast::<UserGeometry>())
    };
    // SAFETY: with N = 1 a `RTCRayHitN` is a `RTCRayHit`, and nobody else reads it during the call.
    let ray_hit = unsafe { &mut *arguments.rayhit.cast::<sys::RTCRayHit>() };
    let ray = ray_of(&ray_hit.ray);
    if ray_hit.ray.id == COLLECTS {
        // SAFETY: only `CommittedScene::intersect_all` traces rays with this number, and its context is a `Collection`
        // whose `found` nobody else uses during the query.
        let (context, found) = unsafe {
            let collection = &*arguments.context.cast::<Collection>();
            (&collection.context, &mut *collection.found)
        };
        collect_user(
            geometry,
            (arguments.geomID, arguments.primID, instance_of(context.instID[0])),
            &ray,
            found,
        );
        return;
    }
    let Some(t) = geometry.guarded(None, |object| object.intersect(arguments.primID, &ray)) else {
        return;
    };
    if !(t > 0.0 && t <= ray.t_max) {
        return;
    }
    ray_hit.ray.tfar = t;
    ray_hit.hit.u = 0.0;
    ray_hit.hit.v = 0.0;
    ray_hit.hit.geomID = arguments.geomID;
    ray_hit.hit.primID = arguments.primID;
    // SAFETY: the context of a query is valid while it runs.
    let context = unsafe { &*arguments.context };
    ray_hit.hit.instID = context.instID;
    ray_hit.hit.instPrimID = context.instPrimID;
}

/// Whether one primitive blocks one ray.
pub(super) unsafe extern "C" fn occluded(arguments: *const sys::RTCOccludedFunctionNArguments) {
    // SAFETY: as in `intersect`.
    let (arguments, geometry) = unsafe {
        let arguments = &*arguments;
        if arguments.N != 1 || *arguments.valid != -1 {
            return;
        }
        (arguments, &*arguments.geometryUserPtr.cast::<UserGeometry>())
    };
    // SAFETY: with N = 1 a `RTCRayN` is a `RTCRay`.
    let ray = unsafe { &mut *arguments.ray.cast::<sys::RTCRay>() };
    let segment = ray_of(ray);
    if geometry.guarded(false, |object| object.occluded(arguments.primID, &segment)) {
        // Embree's convention for an occluded ray.
        ray.tfar = f32::NEG_INFINITY;
    }
}
