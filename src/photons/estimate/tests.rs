//! Tests of density estimates: bias, noise, kernels and search regions.

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
fn faint_estimates_do_not_ask_what_is_seen() {
    let map = PhotonMap::build(square(5000, 0.0, Vec3::Y, 0), 5000);
    let params = corrected(Kernel::Constant);
    let mut scratch = Scratch::default();
    let mut asked = |faint: f32| {
        let query = Query { faint, ..Query::nearest(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, 50) };
        let mut times = 0;
        let mut felt = |_| {
            times += 1;
            None
        };
        let estimate = map.estimate_irradiance_visible(&query, &params, &mut scratch, &mut felt);
        (estimate, times)
    };
    let (usual, times) = asked(0.0);
    assert_eq!(times, 1);
    let brightest = usual.value.max_element();
    assert_eq!(asked(0.99 * brightest), (usual, 1));
    // The same photons over the same disc.
    assert_eq!(asked(1.01 * brightest), (usual, 0));
}

/// Mean of estimates by both regions over that of uniform flux, on a surface of area `area` that `on_surface` samples
/// points and normals of.
fn on_curved(area: f64, n: usize, on_surface: impl Fn(&mut Rng) -> (Vec3, Vec3)) -> [f64; 2] {
    const MAPS: u64 = 8;
    let count = 20_000;
    let mut sums = [0.0; 2];
    for index in 0..MAPS {
        let mut rng = Rng::new(9, Stream::Measure, index);
        let photons = (0..count)
            .map(|_| on_surface(&mut rng))
            .map(|(p, normal)| Photon::new(p, POWER, normal, normal, PhotonClass::Direct, 0.0));
        let map = PhotonMap::build(photons.collect(), count);
        let mut scratch = Scratch::default();
        for _ in 0..1000 {
            let (place, normal) = on_surface(&mut rng);
            for (i, region) in [SearchRegion::Sphere, SearchRegion::Disc].into_iter().enumerate() {
                let query = Query { region, ..Query::nearest(place, normal, n) };
                let estimate = map.estimate_irradiance(&query, &corrected(Kernel::Constant), &mut scratch);
                sums[i] += f64::from(estimate.value.x) * area / (1000 * MAPS) as f64;
            }
        }
    }
    sums
}

#[test]
fn curvature_costs_nothing() {
    // Radius of the search over that of the surface: 0.1, 0.2, 0.4.
    for (n, on_torus) in [(50, 20), (200, 30), (800, 50)] {
        let ball = on_curved(4.0 * PI, n, |rng| {
            let p = warp::square_to_sphere(rng.next_2d());
            (p, p)
        });
        // A torus of radii 4 and 1 is round in one direction, has saddles inside, and no ends.
        let torus = on_curved(16.0 * PI * PI, on_torus, |rng| {
            loop {
                let u = rng.next_2d() * std::f32::consts::TAU;
                let out = 4.0 + u.y.cos();
                if rng.next_f32() * 5.0 <= out {
                    let normal = Vec3::new(u.x.cos() * u.y.cos(), u.y.sin(), u.x.sin() * u.y.cos());
                    break (Vec3::new(u.x.cos() * 4.0, 0.0, u.x.sin() * 4.0) + normal, normal);
                }
            }
        });
        println!("N = {n}: ball {ball:?}, torus {torus:?}");
        for mean in ball.into_iter().chain(torus) {
            assert!((mean - 1.0).abs() < 0.01, "N = {n}: ball {ball:?}, torus {torus:?}");
        }
    }
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
    // Photons on the same side at height 0.1, on the other side at 0.001; a search of 50 photons has radius 0.03.
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
        // Where fewer than k photons lie within the maximum radius, all count, and that is the radius.
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
        let photon =
            |i: usize| Photon::new(place, POWER, Vec3::Y, Vec3::Y, PhotonClass::Caustic, i as f32 / 1000.0);
        let map = PhotonMap::build((0..1000).map(photon).collect(), 1000);
        let mut scratch = Scratch::default();
        for (kernel, k) in KERNELS.into_iter().flat_map(|kernel| [1, 50, 1000, 5000].map(|k| (kernel, k))) {
            for params in [corrected(kernel), as_printed(kernel)] {
                let query = Query::nearest(place, Vec3::Y, k);
                let estimate = map.estimate_irradiance(&query, &params, &mut scratch);
                assert!(estimate.value.is_finite() && estimate.radius > 0.0);
                assert_eq!(estimate.photons, 1000);
                let flux = f64::from(estimate.value.x) * PI * f64::from(estimate.radius).powi(2);
                // All photons lie at the centre, where a kernel exceeds its mean.
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
            let near: Vec<_> = (0..500)
                .map(|i| irradiance.nearest((query(i).position, Vec3::Y), (1.0, f32::INFINITY), |_, _| true))
                .collect();
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
    // Numbers of emitted photons exceed 2^32 without an overflow.
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

/// Mean and relative standard deviation of look-ups at `x` in maps whose left half is `contrast` times as dense, and the
/// photons looked at in each.
fn beside_a_step(contrast: f32, x: f32, query: impl Fn(Vec3) -> Query) -> (f64, f64, f64) {
    let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
    let mut scratch = Scratch::default();
    for index in 0..20 {
        let mut rng = Rng::new(11, Stream::Measure, index);
        let mut photons = square(20_000, 0.0, Vec3::Y, index);
        for photon in &mut photons {
            let dense = rng.next_f32() * (1.0 + contrast) < contrast;
            photon.position.x = 0.5 * photon.position.x + if dense { 0.0 } else { 0.5 };
        }
        let map = PhotonMap::build(photons, 20_000);
        for _ in 0..200 {
            let query = query(Vec3::new(x, 0.0, 0.3 + 0.4 * rng.next_f32()));
            let value = f64::from(
                map.estimate_irradiance(&query, &corrected(Kernel::Constant), &mut scratch).value.x,
            );
            (sum, squares, n) = (sum + value, squares + value * value, n + 1.0);
        }
    }
    let mean: f64 = sum / n;
    (mean, (squares / n - mean * mean).sqrt() / mean, scratch.visited() as f64 / n)
}

/// Section 5 of Jensen 1996: a sphere of fixed size improves the estimate slightly, as the area is constant, but fails
/// where density varies much.
#[test]
fn fixed_radius_is_a_little_better_and_fails_in_two_ways() {
    let radius = |n: f64, density: f64| (n / (PI * density)).sqrt() as f32;
    // Even density: relative variance 1 / N instead of 1 / (N - 2).
    let (_, fixed, _) = beside_a_step(1.0, 0.5, |at| Query::within(at, Vec3::Y, radius(10.0, 20_000.0)));
    let (_, nearest, _) = beside_a_step(1.0, 0.5, |at| Query::nearest(at, Vec3::Y, 10));
    assert!(fixed < 0.97 * nearest && fixed > 0.8 * nearest, "{fixed}, {nearest}");

    let contrast = 100.0;
    let (dense, sparse) = (40_000.0 * 100.0 / 101.0, 40_000.0 / 101.0);
    // A radius that suits the dense half finds almost no photons in the sparse half.
    let small = |at| Query::within(at, Vec3::Y, radius(50.0, dense));
    let nearest = |at| Query::nearest(at, Vec3::Y, 50);
    let (_, noise, _) = beside_a_step(contrast, 0.75, small);
    let (_, noise_of_nearest, _) = beside_a_step(contrast, 0.75, nearest);
    assert!(noise > 1.0 && noise_of_nearest < 0.2, "{noise}, {noise_of_nearest}");
    // A radius that suits the sparse half blurs the edge, and visits all photons nearby in the dense half.
    let large = |at| Query::within(at, Vec3::Y, radius(50.0, sparse));
    let beside = 0.5 + 0.5 * radius(50.0, sparse);
    let (blurred, _, _) = beside_a_step(contrast, beside, large);
    let (sharper, _, _) = beside_a_step(contrast, beside, nearest);
    assert!(blurred > 3.0 * sharper, "{blurred}, {sharper}");
    let (_, _, visited) = beside_a_step(contrast, 0.25, large);
    let (_, _, visited_by_nearest) = beside_a_step(contrast, 0.25, nearest);
    assert!(visited > 10.0 * visited_by_nearest, "{visited}, {visited_by_nearest}");
}
