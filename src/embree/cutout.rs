//! Triangles with holes (alpha masks): rays pass through the holes.

use embree4_sys as sys;
use std::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Coverage of a surface. Called while rays are traced, from any thread.
pub trait Cutout: Debug + Send + Sync {
    /// Share of rays, from 0 to 1, that hit triangle `primitive` instead of passing through. `uv` are the barycentric coordinates of the
    /// second and third corner.
    fn coverage(&self, primitive: u32, uv: [f32; 2]) -> f32;
}

/// User data of a geometry with holes, which the filter reads.
#[derive(Debug)]
pub(super) struct CutGeometry {
    pub(super) cutout: Arc<dyn Cutout>,
    /// Panic counter, shared with the scene.
    pub(super) panics: Arc<AtomicU64>,
}

/// A number in `[0, 1)` from a hash of a ray and the primitive it hits (the finalizer of MurmurHash3, by Appleby). It is the same in every
/// run and practically independent between rays, so that the mean over rays is correct for any origin of the rays.
fn number_of(ray: &sys::RTCRay, hit: &sys::RTCHit) -> f32 {
    let parts = [
        ray.org_x.to_bits(),
        ray.org_y.to_bits(),
        ray.org_z.to_bits(),
        ray.dir_x.to_bits(),
        ray.dir_y.to_bits(),
        ray.dir_z.to_bits(),
        hit.geomID,
        hit.primID,
        hit.instID[0],
    ];
    let hash = parts.into_iter().fold(0x9e37_79b9_7f4a_7c15u64, |hash, part| {
        let mixed = (hash ^ u64::from(part)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        let mixed = (mixed ^ (mixed >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        mixed ^ (mixed >> 33)
    });
    (hash >> 40) as f32 / 16_777_216.0
}

/// Rejects a hit where the surface has a hole. It handles single rays, which this crate traces in such scenes; for packets, triangles
/// have no holes.
pub(super) unsafe extern "C" fn pass_holes(arguments: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: valid for the call. With N = 1 ray and hit have the layouts of `RTCRay` and `RTCHit`, and the user pointer is
    // the `CutGeometry` set with the geometry, which the scene owns longer than Embree's geometry.
    unsafe {
        let arguments = &*arguments;
        if arguments.N != 1 || *arguments.valid != -1 {
            return;
        }
        let cut = &*arguments.geometryUserPtr.cast::<CutGeometry>();
        let (ray, hit) = (&*arguments.ray.cast::<sys::RTCRay>(), &*arguments.hit.cast::<sys::RTCHit>());
        let coverage = catch_unwind(AssertUnwindSafe(|| cut.cutout.coverage(hit.primID, [hit.u, hit.v])));
        let coverage = coverage.unwrap_or_else(|_| {
            cut.panics.fetch_add(1, Ordering::Relaxed);
            1.0
        });
        let meets = coverage >= 1.0 || coverage > 0.0 && number_of(ray, hit) < coverage;
        if !meets {
            *arguments.valid = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embree::{Device, SceneBuilder, TriangleBuffers};
    use crate::math::Ray;
    use glam::Vec3;

    /// Full coverage below, a quarter in the middle, none above.
    #[derive(Debug)]
    struct Bands;

    impl Cutout for Bands {
        fn coverage(&self, _: u32, uv: [f32; 2]) -> f32 {
            match uv[1] {
                v if v < 0.2 => 1.0,
                v if v < 0.4 => 0.25,
                _ => 0.0,
            }
        }
    }

    #[test]
    fn rays_pass_holes_in_the_share_asked_for() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let buffers = TriangleBuffers::new(corners, vec![[0, 1, 2]]).unwrap();
        builder.add_cut_triangles(buffers, Arc::new(Bands)).unwrap();
        let scene = builder.commit().unwrap();
        let met = |y: f32| {
            let ray = |i: u32| Ray::new(Vec3::new(0.1 + 1e-5 * i as f32, y, 1.0), Vec3::NEG_Z);
            let hits = (0..10_000).filter(|&i| scene.intersect(&ray(i)).is_some()).count();
            let shadows = (0..10_000).filter(|&i| scene.occluded(&ray(i))).count();
            // Both queries give the same result for the same ray.
            assert_eq!(hits, shadows);
            hits
        };
        assert_eq!((met(0.1), met(0.5)), (10_000, 0));
        // The tolerance is five standard deviations.
        assert!((met(0.3) as f64 - 2500.0).abs() < 5.0 * (10_000f64 * 0.25 * 0.75).sqrt());
    }
}
