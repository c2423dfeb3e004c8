//! Ray packets of 8 and 16, for comparison with single rays. The renderer traces single rays, which are as fast for incoherent rays.

use super::all_hits::instance_of;
use super::scene::{CommittedScene, RawHit};
use crate::math::Ray;
use embree4_sys as sys;

macro_rules! packet {
    (
        $lanes:literal, $intersect:ident, $occluded:ident, $ray:ident, $hit:ident, $rayhit:ident, $valid:ident,
        $call_intersect:ident, $call_occluded:ident
    ) => {
        /// Mask of the lanes of a packet that hold a ray: -1 or 0, with the alignment that the library requires.
        #[repr(align(64))]
        struct $valid([i32; $lanes]);

        impl CommittedScene {
            /// The nearest hit of each ray of a packet, as from [`Self::intersect`]. The shorter of the two slices, and at most the
            /// packet's width, is used; other results stay unchanged.
            pub fn $intersect(&self, rays: &[Ray], found: &mut [Option<RawHit>]) {
                let (valid, ray) = $valid::fill(rays);
                let none = [sys::RTC_INVALID_GEOMETRY_ID; $lanes];
                let zero = [0.0; $lanes];
                let hit = sys::$hit {
                    Ng_x: zero,
                    Ng_y: zero,
                    Ng_z: zero,
                    u: zero,
                    v: zero,
                    primID: none,
                    geomID: none,
                    instID: [none],
                    instPrimID: [none],
                };
                let mut query = sys::$rayhit { ray, hit };
                // SAFETY: a committed scene; both structures are locals of the layout and alignment that the library
                // expects; null arguments mean the defaults.
                unsafe {
                    sys::$call_intersect(
                        valid.0.as_ptr(),
                        self.handle(),
                        &raw mut query,
                        std::ptr::null_mut(),
                    );
                }
                for (lane, found) in found.iter_mut().enumerate().take(rays.len().min($lanes)) {
                    let hit = &query.hit;
                    *found = (hit.geomID[lane] != sys::RTC_INVALID_GEOMETRY_ID).then(|| RawHit {
                        geometry: hit.geomID[lane],
                        primitive: hit.primID[lane],
                        instance: instance_of(hit.instID[0][lane]),
                        uv: [hit.u[lane], hit.v[lane]],
                        t: query.ray.tfar[lane],
                    });
                }
            }

            /// Whether each ray of a packet is occluded, as from [`Self::occluded`]. Slices are as for the nearest hit.
            pub fn $occluded(&self, rays: &[Ray], found: &mut [bool]) {
                let (valid, mut ray) = $valid::fill(rays);
                // SAFETY: as above.
                unsafe {
                    sys::$call_occluded(valid.0.as_ptr(), self.handle(), &raw mut ray, std::ptr::null_mut());
                }
                for (lane, found) in found.iter_mut().enumerate().take(rays.len().min($lanes)) {
                    *found = ray.tfar[lane] < 0.0;
                }
            }
        }

        impl $valid {
            fn fill(rays: &[Ray]) -> (Self, sys::$ray) {
                let zero = [0.0; $lanes];
                let mut valid = Self([0; $lanes]);
                let mut ray = sys::$ray {
                    org_x: zero,
                    org_y: zero,
                    org_z: zero,
                    // The same as for single rays.
                    tnear: [f32::MIN_POSITIVE; $lanes],
                    dir_x: zero,
                    dir_y: zero,
                    dir_z: zero,
                    time: zero,
                    tfar: zero,
                    mask: [u32::MAX; $lanes],
                    id: [0; $lanes],
                    flags: [0; $lanes],
                };
                for (lane, from) in rays.iter().enumerate().take($lanes) {
                    valid.0[lane] = -1;
                    [ray.org_x[lane], ray.org_y[lane], ray.org_z[lane]] = from.origin.to_array();
                    [ray.dir_x[lane], ray.dir_y[lane], ray.dir_z[lane]] = from.direction.to_array();
                    ray.tfar[lane] = from.t_max;
                }
                (valid, ray)
            }
        }
    };
}

packet!(8, intersect_8, occluded_8, RTCRay8, RTCHit8, RTCRayHit8, Valid8, rtcIntersect8, rtcOccluded8);
packet!(
    16,
    intersect_16,
    occluded_16,
    RTCRay16,
    RTCHit16,
    RTCRayHit16,
    Valid16,
    rtcIntersect16,
    rtcOccluded16
);

#[cfg(test)]
mod tests {
    use super::super::{Device, SceneBuilder, TriangleBuffers};
    use super::*;
    use glam::Vec3;
    use std::sync::Arc;

    #[test]
    fn packets_find_what_single_rays_find() {
        let device = Arc::new(Device::new(1).unwrap());
        let mut builder = SceneBuilder::new(&device).unwrap();
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]];
        builder.add_triangles(TriangleBuffers::new(corners, vec![[0, 1, 2], [1, 3, 2]]).unwrap()).unwrap();
        let scene = builder.commit().unwrap();
        for count in [1, 7, 8, 13, 16] {
            let rays: Vec<Ray> = (0..count)
                .map(|i| {
                    let at = Vec3::new(0.11 * i as f32, 0.3 + 0.05 * i as f32, 1.0);
                    Ray { t_max: if i % 5 == 4 { 0.1 } else { f32::INFINITY }, ..Ray::new(at, Vec3::NEG_Z) }
                })
                .collect();
            let (mut eight, mut sixteen) = ([None; 16], [None; 16]);
            let (mut dark_8, mut dark_16) = ([false; 16], [false; 16]);
            for (chunk, rays) in rays.chunks(8).enumerate() {
                scene.intersect_8(rays, &mut eight[8 * chunk..]);
                scene.occluded_8(rays, &mut dark_8[8 * chunk..]);
            }
            scene.intersect_16(&rays, &mut sixteen);
            scene.occluded_16(&rays, &mut dark_16);
            for (i, ray) in rays.iter().enumerate() {
                let single = scene.intersect(ray);
                let key = |hit: Option<RawHit>| hit.map(|hit| (hit.geometry, hit.primitive, hit.instance));
                assert_eq!((key(eight[i]), key(sixteen[i])), (key(single), key(single)), "{count}: {i}");
                assert_eq!((dark_8[i], dark_16[i]), (single.is_some(), single.is_some()), "{count}: {i}");
            }
            assert!(
                eight[count..].iter().all(Option::is_none) && sixteen[count..].iter().all(Option::is_none)
            );
        }
    }
}
