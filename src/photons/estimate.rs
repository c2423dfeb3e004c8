use super::map::{PhotonMap, Query, Scratch};
use super::{Estimator, Kernel, KernelDomain};
use crate::math::Rgb;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// How photons are weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateParams {
    /// Weight of a photon by its distance.
    pub kernel: Kernel,
    /// Whether the photon that sets the radius counts.
    pub estimator: Estimator,
}

/// An estimate of density, and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Irradiance in W m^-2 or radiance in W m^-2 sr^-1, as the function says. Always finite; zero without photons.
    pub value: Rgb,
    /// Count of photons in the sum.
    pub photons: u32,
    /// Radius of the disc that the sum was divided by.
    pub radius: f32,
}

impl PhotonMap {
    /// Irradiance at the query's position, on the side of its normal: `sum w dPhi / (n pi r^2)` over the photons
    /// found, divided by the count emitted, after eq. (3) and (5) of Jensen 1996 without the BRDF.
    ///
    /// A photon carries flux, which has the cosine of incidence in it already: the sum contains no cosine and
    /// needs none. Its `pi` is that of the disc's area alone.
    ///
    /// The radius is the distance of the `k`-th photon. [`Estimator::Corrected`] does not count that photon
    /// itself, and takes at least two; the expectation is then exact where photons lie uniformly (Garcia, Urena
    /// & Sbert 2012), for every kernel. Where fewer than `k` lie within [`Query::max_radius`], that is the radius
    /// and all count; with `k = usize::MAX` this is the estimate of fixed radius. Only where that is infinite as
    /// well does the farthest photon of the map stand in for the `k`-th.
    ///
    /// The radius is no less than eight times the spacing of `f32` at the largest coordinate of the map: closer
    /// than that, places cannot be told apart. Photons that coincide thus give a large and finite value, which
    /// over the disc of that radius amounts to their flux.
    pub fn estimate_irradiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
    ) -> Estimate {
        self.estimate_irradiance_visible(query, params, scratch, |_| None)
    }

    /// [`Self::estimate_irradiance`] over a visible kernel.
    ///
    /// `domain` tells, for the radius that was found, which part of the disc can be seen from its centre; photons
    /// elsewhere are left out and the kernel is normalised over the rest. The expectation stays exact: given the
    /// radius that the `k`-th photon sets, wherever it lies, the others are spread like the flux.
    pub fn estimate_irradiance_visible(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        domain: impl FnOnce(f32) -> Option<KernelDomain>,
    ) -> Estimate {
        self.estimate(query, params, scratch, domain, |index| self.power(index))
    }

    /// Radiance that the surface at the query's position reflects towards some `wo`: eq. (3) and (5) of Jensen 1996.
    ///
    /// `brdf` is `f_r(wo, wi)` in sr^-1 as a function of the unit direction `wi`, which points away from the surface;
    /// it contains no cosine of incidence, since the flux of a photon has it already. For all else see
    /// [`Self::estimate_irradiance`]; a constant `f_r` gives that times `f_r`.
    pub fn estimate_radiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        brdf: impl FnMut(Vec3) -> Rgb,
    ) -> Estimate {
        self.estimate_radiance_visible(query, params, scratch, |_| None, brdf)
    }

    /// [`Self::estimate_radiance`] over a visible kernel; see [`Self::estimate_irradiance_visible`].
    pub fn estimate_radiance_visible(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        domain: impl FnOnce(f32) -> Option<KernelDomain>,
        mut brdf: impl FnMut(Vec3) -> Rgb,
    ) -> Estimate {
        self.estimate(query, params, scratch, domain, |index| {
            let payload = self.payload(index);
            payload.power() * brdf(payload.wi())
        })
    }

    fn estimate(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        domain: impl FnOnce(f32) -> Option<KernelDomain>,
        mut contribution: impl FnMut(usize) -> Rgb,
    ) -> Estimate {
        let corrected = params.estimator == Estimator::Corrected;
        let least_radius = self.least_radius(query.position);
        let query = Query {
            k: if corrected { query.k.max(2) } else { query.k.max(1) },
            max_radius: query.max_radius.max(least_radius),
            ..*query
        };
        let mut found = self.search(&query, scratch);
        // The farthest sets the radius if it is the k-th, or if nothing else does.
        let mut farthest_sets_radius = found.is_complete() || query.max_radius == f32::INFINITY;
        let mut radius =
            if farthest_sets_radius { found.farthest_squared().sqrt() } else { query.max_radius };
        if farthest_sets_radius && radius < least_radius && !found.is_empty() {
            found = self.search(&Query { k: usize::MAX, max_radius: least_radius, ..query }, scratch);
            (farthest_sets_radius, radius) = (false, least_radius);
        }
        let photons = found.len().saturating_sub(usize::from(corrected && farthest_sets_radius));
        if photons == 0 {
            return Estimate { value: Rgb::ZERO, photons: 0, radius };
        }
        let per_radius_squared = 1.0 / (radius * radius);
        let domain = domain(radius);
        let mut sum = DVec3::ZERO;
        let mut counted = 0;
        for (index, distance_squared) in found.iter().take(photons) {
            if domain.as_ref().is_some_and(|domain| !domain.contains(self.position(index) - query.position)) {
                continue;
            }
            counted += 1;
            let weight = params.kernel.weight((distance_squared * per_radius_squared).min(1.0));
            sum += (contribution(index) * weight).as_dvec3();
        }
        let area = PI * f64::from(radius) * f64::from(radius);
        let mean_weight = match &domain {
            Some(domain) => domain.mean_weight(params.kernel),
            None => params.kernel.mean_weight(),
        };
        let scale = self.per_emitted() / (f64::from(mean_weight) * area);
        // Flux of 1e30 W at one point exceeds what f32 can hold.
        let value = (sum * scale).min(DVec3::splat(f64::from(f32::MAX))).as_vec3();
        Estimate { value, photons: counted, radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photons::{MIN_NORMAL_COS, Photon, PhotonClass, PhotonClasses, SearchRegion};
    use crate::sampling::{Rng, Stream, warp};
    use rayon::prelude::*;

    const KERNELS: [Kernel; 6] = [
        Kernel::Constant,
        Kernel::Cone { k: 1.0 },
        Kernel::Cone { k: 1.1 },
        Kernel::Cone { k: 2.0 },
        Kernel::Epanechnikov,
        Kernel::Gaussian,
    ];
    const POWER: Rgb = Rgb::new(1.0, 0.5, 0.25);

    fn corrected(kernel: Kernel) -> EstimateParams {
        EstimateParams { kernel, estimator: Estimator::Corrected }
    }

    fn as_printed(kernel: Kernel) -> EstimateParams {
        EstimateParams { kernel, estimator: Estimator::AsPrinted }
    }

    /// `count` photons, uniform on the unit square at `height`, that arrive cosine-distributed on the side `normal`.
    fn square(count: usize, height: f32, normal: Vec3, index: u64) -> Vec<Photon> {
        let mut rng = Rng::new(5, Stream::Measure, index);
        (0..count)
            .map(|_| {
                let u = rng.next_2d();
                let local = warp::square_to_cosine_hemisphere(rng.next_2d());
                let wi = Vec3::new(local.x, local.z * normal.y, local.y);
                let position = Vec3::new(u.x, height, u.y);
                Photon::new(position, POWER, wi, normal, PhotonClass::Indirect, rng.next_f32())
            })
            .collect()
    }

    /// Sums of `estimate` over 100 look-ups in each of `maps` maps of 5000 photons, divided by their number.
    fn means<const C: usize>(
        maps: u64,
        place: impl Fn(&mut Rng) -> Vec3 + Sync,
        estimate: impl Fn(&PhotonMap, Vec3, &mut Scratch) -> [f64; C] + Sync,
    ) -> [f64; C] {
        let lookups = 100;
        let of_map = |index: u64| {
            let map = PhotonMap::build(square(5000, 0.0, Vec3::Y, index), 5000);
            let mut rng = Rng::new(6, Stream::Measure, index);
            let mut scratch = Scratch::default();
            (0..lookups).fold([0.0; C], |sum, _| {
                let values = estimate(&map, place(&mut rng), &mut scratch);
                std::array::from_fn(|i| sum[i] + values[i])
            })
        };
        let sums: Vec<[f64; C]> = (0..maps).into_par_iter().map(of_map).collect();
        std::array::from_fn(|i| sums.iter().map(|sum| sum[i]).sum::<f64>() / (maps * lookups) as f64)
    }

    fn inside(rng: &mut Rng) -> Vec3 {
        let u = rng.next_2d() * 0.4 + 0.3;
        Vec3::new(u.x, 0.0, u.y)
    }

    #[test]
    fn uniform_flux_is_estimated_without_bias() {
        let kernels = [Kernel::Constant, Kernel::Cone { k: 1.0 }, Kernel::Epanechnikov, Kernel::Gaussian];
        for n in [10, 50, 200] {
            let means = means(1000, inside, |map, position, scratch| {
                let query = Query::nearest(position, Vec3::Y, n);
                kernels.map(|k| f64::from(map.estimate_irradiance(&query, &corrected(k), scratch).value.x))
            });
            for (kernel, mean) in kernels.into_iter().zip(means) {
                assert!((mean - 1.0).abs() < 0.005, "{kernel:?}, N = {n}: {mean}");
                println!("{kernel:?} N = {n}: {mean:.5}");
            }
        }
    }

    #[test]
    fn printed_formulas_are_high_by_the_weight_at_the_edge() {
        for n in [2, 10, 50] {
            let means: [f64; 12] = means(40, inside, |map, position, scratch| {
                let query = Query::nearest(position, Vec3::Y, n);
                std::array::from_fn(|i| {
                    let params = if i < 6 { corrected(KERNELS[i]) } else { as_printed(KERNELS[i - 6]) };
                    f64::from(map.estimate_irradiance(&query, &params, scratch).value.x)
                })
            });
            for (i, kernel) in KERNELS.into_iter().enumerate() {
                // The other N - 1 photons have the mean weight on average; N / (N - 1) for the constant kernel.
                let edge = f64::from(kernel.weight(1.0) / kernel.mean_weight());
                let excess = means[6 + i] / means[i] - 1.0;
                let want = edge / (n - 1) as f64;
                assert!(
                    (excess / want - 1.0).abs() < 0.05 || excess.max(want) < 1e-6,
                    "{kernel:?} {n}: {excess}"
                );
            }
        }
    }

    #[test]
    fn fixed_radius_is_without_bias() {
        let means: [f64; 6] = means(400, inside, |map, position, scratch| {
            let query = Query::within(position, Vec3::Y, 0.08);
            KERNELS.map(|kernel| {
                let estimate = map.estimate_irradiance(&query, &as_printed(kernel), scratch);
                assert_eq!(estimate, map.estimate_irradiance(&query, &corrected(kernel), scratch));
                assert_eq!(estimate.radius, 0.08);
                f64::from(estimate.value.x)
            })
        });
        for (kernel, mean) in KERNELS.into_iter().zip(means) {
            assert!((mean - 1.0).abs() < 0.005, "{kernel:?}: {mean}");
        }
    }

    #[test]
    fn half_at_an_edge_and_a_quarter_in_a_corner() {
        let sides = [(Vec3::new(0.0, 0.0, 0.5), 0.5), (Vec3::new(1.0, 0.0, 1.0), 0.25)];
        for (place, want) in sides {
            let [mean] = means(
                1000,
                |_| place,
                |map, position, scratch| {
                    let query = Query::nearest(position, Vec3::Y, 50);
                    let params = corrected(Kernel::Constant);
                    [f64::from(map.estimate_irradiance(&query, &params, scratch).value.x)]
                },
            );
            assert!((mean / want - 1.0).abs() < 0.02, "{mean} instead of {want}");
        }
    }

    #[test]
    fn curvature_costs_the_disc_and_not_the_sphere() {
        // Radius of the search: a tenth of that of the surface.
        let (count, n) = (20_000, 50);
        let mut sums = [0.0; 2];
        for index in 0..20 {
            let mut rng = Rng::new(9, Stream::Measure, index);
            let mut on_sphere = || warp::square_to_sphere(rng.next_2d());
            let photons = (0..count)
                .map(|_| on_sphere())
                .map(|p| Photon::new(p, POWER, p, p, PhotonClass::Direct, 0.0));
            let map = PhotonMap::build(photons.collect(), count);
            let mut scratch = Scratch::default();
            for _ in 0..2000 {
                let place = on_sphere();
                for (i, region) in [SearchRegion::Sphere, SearchRegion::Disc].into_iter().enumerate() {
                    let query = Query { region, ..Query::nearest(place, place, n) };
                    let estimate =
                        map.estimate_irradiance(&query, &corrected(Kernel::Constant), &mut scratch);
                    sums[i] += f64::from(estimate.value.x) * 4.0 * PI / 40_000.0;
                }
            }
        }
        assert!((sums[0] - 1.0).abs() < 0.005, "{sums:?}");
        assert!((sums[1] * 1.0375 - 1.0).abs() < 0.01, "{sums:?}");
    }

    #[test]
    fn radiance_weighs_by_direction() {
        let map = PhotonMap::build(square(100_000, 0.0, Vec3::Y, 0), 100_000);
        let mut scratch = Scratch::default();
        let query = Query::nearest(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, 20_000);
        for kernel in KERNELS {
            let params = corrected(kernel);
            let irradiance = map.estimate_irradiance(&query, &params, &mut scratch);
            let constant = map.estimate_radiance(&query, &params, &mut scratch, |_| Rgb::splat(0.25));
            assert_eq!(constant.value, irradiance.value * 0.25);
            // Mean cosine of a cosine distribution: two thirds.
            let cosine = map.estimate_radiance(&query, &params, &mut scratch, |wi| Rgb::splat(wi.y));
            assert!((cosine.value / irradiance.value - 2.0 / 3.0).abs().max_element() < 0.01, "{cosine:?}");
            assert!((irradiance.value / POWER - 1.0).abs().max_element() < 0.05, "{irradiance:?}");
        }
    }

    #[test]
    fn parallel_planes_do_not_leak() {
        let floor = square(20_000, 0.0, Vec3::Y, 0);
        let alone = PhotonMap::build(floor.clone(), 20_000);
        let mut scratch = Scratch::default();
        // The same side at a tenth, the other side at a thousandth; a search of 50 photons has radius 0.03.
        for (height, normal, region) in [
            (0.1, Vec3::Y, SearchRegion::Sphere),
            (0.01, Vec3::Y, SearchRegion::Disc),
            (-0.001, Vec3::NEG_Y, SearchRegion::Sphere),
            (-0.001, Vec3::NEG_Y, SearchRegion::Disc),
        ] {
            let mut both = floor.clone();
            both.extend(square(20_000, height, normal, 1));
            let both = PhotonMap::build(both, 20_000);
            for i in 0..1000 {
                let place = inside(&mut Rng::new(7, Stream::Measure, i));
                let query = Query { region, ..Query::nearest(place, Vec3::Y, 50) };
                let params = corrected(Kernel::Cone { k: 1.0 });
                let with = both.estimate_irradiance(&query, &params, &mut scratch);
                let without = alone.estimate_irradiance(&query, &params, &mut scratch);
                assert_eq!((with.photons, with.radius), (without.photons, without.radius));
                assert!((with.value - without.value).length() < 1e-5, "{with:?} {without:?}");
            }
        }
        let sphere = Query::nearest(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, 50);
        let mut near = floor.clone();
        near.extend(square(20_000, 0.01, Vec3::Y, 1));
        let near = PhotonMap::build(near, 20_000);
        let params = corrected(Kernel::Constant);
        let leak = near.estimate_irradiance(&sphere, &params, &mut scratch).value.x;
        assert!(leak > 1.2, "the sphere is expected to leak: {leak}");
    }

    #[test]
    fn few_photons_and_none() {
        let mut scratch = Scratch::default();
        for count in 0..4 {
            let map = PhotonMap::build(square(count, 0.0, Vec3::Y, 0), 10);
            for (kernel, k) in KERNELS.into_iter().flat_map(|kernel| [0, 1, 2, 50].map(|k| (kernel, k))) {
                for max_radius in [0.0, 1e-30, 2.0, 1e30, f32::INFINITY, f32::NAN] {
                    for params in [corrected(kernel), as_printed(kernel)] {
                        let query = Query { max_radius, ..Query::nearest(Vec3::splat(0.1), Vec3::Y, k) };
                        let estimate = map.estimate_irradiance(&query, &params, &mut scratch);
                        assert!(estimate.value.is_finite() && estimate.value.min_element() >= 0.0);
                        assert!(estimate.photons as usize <= count);
                        assert!(estimate.photons > 0 || estimate.value == Rgb::ZERO, "{estimate:?}");
                    }
                }
            }
            // All count where fewer than k lie in reach, and the reach is the radius.
            let query = Query { max_radius: 2.0, ..Query::nearest(Vec3::splat(0.1), Vec3::Y, 50) };
            let estimate = map.estimate_irradiance(&query, &corrected(Kernel::Constant), &mut scratch);
            assert_eq!((estimate.photons as usize, estimate.radius), (count, 2.0));
            let want = count as f32 / 10.0 / (std::f32::consts::PI * 4.0);
            assert!((estimate.value.x - want).abs() <= 1e-6 * want);
        }
        assert_eq!(PhotonMap::build(square(5, 0.0, Vec3::Y, 0), 0).total_flux(), [0.0; 3]);
    }

    #[test]
    fn coincident_photons_keep_their_flux() {
        for place in [Vec3::ZERO, Vec3::new(0.5, -0.7, 0.1), Vec3::splat(1e5)] {
            let photon = |i: usize| {
                Photon::new(place, POWER, Vec3::Y, Vec3::Y, PhotonClass::Caustic, i as f32 / 1000.0)
            };
            let map = PhotonMap::build((0..1000).map(photon).collect(), 1000);
            let mut scratch = Scratch::default();
            for (kernel, k) in KERNELS.into_iter().flat_map(|kernel| [1, 50, 1000, 5000].map(|k| (kernel, k)))
            {
                for params in [corrected(kernel), as_printed(kernel)] {
                    let query = Query::nearest(place, Vec3::Y, k);
                    let estimate = map.estimate_irradiance(&query, &params, &mut scratch);
                    assert!(estimate.value.is_finite() && estimate.radius > 0.0);
                    assert_eq!(estimate.photons, 1000);
                    let flux = f64::from(estimate.value.x) * PI * f64::from(estimate.radius).powi(2);
                    // All sit at the centre, where a kernel exceeds its mean.
                    let want = 1.0 / f64::from(kernel.mean_weight());
                    assert!((flux / want - 1.0).abs() < 1e-5, "{kernel:?} {flux}");
                }
            }
        }
    }

    #[test]
    fn powers_at_the_ends_of_the_range() {
        let mut scratch = Scratch::default();
        for scale in [1e-30f32, 1e30] {
            let power = Rgb::splat(scale);
            let photons = square(1000, 0.0, Vec3::Y, 0)
                .iter()
                .map(|p| Photon::new(p.position, power, Vec3::Y, Vec3::Y, PhotonClass::Direct, 0.3))
                .collect();
            let map = PhotonMap::build(photons, 1000);
            let query = Query::nearest(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, 500);
            let value = map.estimate_irradiance(&query, &corrected(Kernel::Constant), &mut scratch).value;
            assert!((value / scale - 1.0).abs().max_element() < 0.2, "{value}");
            assert!((map.total_flux()[0] / f64::from(scale) - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn threads_and_order_change_no_bit() {
        let mut photons = square(30_000, 0.0, Vec3::Y, 0);
        photons.extend(square(30_000, 0.3, Vec3::NEG_Y, 1));
        photons.extend((0..500).map(|i| photons[i]).collect::<Vec<_>>());
        let query = |i: u64| {
            let place = inside(&mut Rng::new(8, Stream::Measure, i));
            Query { region: SearchRegion::Disc, ..Query::nearest(place, Vec3::Y, 60) }
        };
        let run = |threads: usize, photons: Vec<Photon>| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let map = PhotonMap::build(photons, 30_000);
                let params = corrected(Kernel::Gaussian);
                let mut scratch = Scratch::default();
                let values: Vec<_> =
                    (0..500).map(|i| map.estimate_irradiance(&query(i), &params, &mut scratch)).collect();
                let irradiance = map.precompute_irradiance(&query(0), &params, 3);
                let near: Vec<_> =
                    (0..500).map(|i| irradiance.nearest(query(i).position, Vec3::Y, 1.0)).collect();
                (map.photons().collect::<Vec<_>>(), values, near, map.total_flux())
            })
        };
        let one = run(1, photons.clone());
        assert!(one == run(2, photons.clone()) && one == run(5, photons.clone()));
        photons.reverse();
        assert!(one == run(2, photons.clone()));
    }

    #[test]
    fn merge_is_concatenation() {
        let (a, b) = (square(3000, 0.0, Vec3::Y, 0), square(1777, 0.0, Vec3::Y, 1));
        let both: Vec<Photon> = a.iter().chain(&b).copied().collect();
        let merged = PhotonMap::merge([&PhotonMap::build(a, 3000), &PhotonMap::build(b, 1777)]);
        let whole = PhotonMap::build(both, 4777);
        assert!(merged.photons().eq(whole.photons()));
        assert_eq!((merged.emitted(), merged.dropped()), (4777, 0));
        assert_eq!(merged.total_flux(), whole.total_flux());
        assert!((merged.total_flux()[0] - 1.0).abs() < 1e-12);
        // Counts go past 2^32 without a jump.
        let late = PhotonMap::build(square(10, 0.0, Vec3::Y, 0), (1 << 32) - 10);
        let more = PhotonMap::merge([&late, &PhotonMap::build(Vec::new(), 20)]);
        assert_eq!(more.emitted(), (1 << 32) + 10);
        assert!((more.total_flux()[0] / late.total_flux()[0] - 1.0).abs() < 1e-8);
    }

    #[test]
    fn bad_photons_are_dropped_and_shadows_weigh_nothing() {
        let mut photons = square(100, 0.0, Vec3::Y, 0);
        photons[3].position.x = f32::NAN;
        photons[4].position.z = f32::INFINITY;
        let shadow = Photon::new(Vec3::ZERO, POWER, Vec3::Y, Vec3::Y, PhotonClass::Shadow, 0.0);
        photons.push(shadow);
        let map = PhotonMap::build(photons, 98);
        assert_eq!((map.len(), map.dropped()), (99, 2));
        assert!((map.total_flux()[0] - 1.0).abs() < 1e-12);
        let mut scratch = Scratch::default();
        let query = Query::within(Vec3::ZERO, Vec3::Y, 0.001);
        assert_eq!(map.search(&query, &mut scratch).len(), 0);
        let shadows = Query { classes: PhotonClasses::ALL, min_normal_cos: MIN_NORMAL_COS, ..query };
        assert_eq!(map.search(&shadows, &mut scratch).len(), 1);
        assert!(map.memory_bytes() < 21 * 128);
    }
}
