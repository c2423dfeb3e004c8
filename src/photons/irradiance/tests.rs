//! Tests of precomputed irradiance.

use super::*;
use crate::photons::{Estimator, Kernel, Photon};
use crate::sampling::{Rng, Stream};

fn square(count: u64, seed: u64) -> PhotonMap {
    let photon = |i| {
        let mut rng = Rng::new(seed, Stream::Measure, i);
        let u = rng.next_2d();
        let power = Rgb::new(1.0, 0.5, 0.25);
        Photon::new(Vec3::new(u.x, 0.0, u.y), power, Vec3::Y, Vec3::Y, PhotonClass::Indirect, 0.0)
    };
    PhotonMap::build((0..count).map(photon).collect(), count)
}

fn template(k: usize) -> Query {
    Query::nearest(Vec3::ZERO, Vec3::Y, k)
}

#[test]
fn mean_of_look_ups_is_without_bias() {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    for stride in [1, 4] {
        let (mut sum, mut count) = (0.0, 0);
        for seed in 0..40 {
            let irradiance = square(20_000, seed).precompute_irradiance(&template(50), &params, stride);
            assert_eq!(irradiance.len(), 20_000 / stride);
            let mut rng = Rng::new(seed, Stream::Measure, 1 << 40);
            for _ in 0..5000 {
                let u = rng.next_2d() * 0.7 + 0.15;
                let found = irradiance.nearest(
                    (Vec3::new(u.x, 0.001, u.y), Vec3::Y),
                    (1.0, f32::INFINITY),
                    |_, _| true,
                );
                sum += f64::from(found.unwrap().irradiance.y);
                count += 1;
            }
        }
        let mean = sum / f64::from(count) / 0.5;
        assert!((mean - 1.0).abs() < 0.01, "stride {stride}: {mean}");
        println!("stride {stride}: {mean}");
    }
}

#[test]
fn direct_light_in_place_of_its_photons_has_no_bias() {
    // Half of the photons are of direct light, and direct light is given: the irradiance of each half is 0.25 in
    // green.
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let (mut sum, mut count) = (0.0, 0);
    for seed in 0..40 {
        let classes = [PhotonClass::Direct, PhotonClass::Indirect];
        let photons = square(20_000, seed).photons().collect::<Vec<_>>();
        let photons = photons.iter().enumerate().map(|(i, photon)| {
            let class = classes[(mix(i as u64) & 1) as usize];
            Photon::new(photon.position, photon.power(), Vec3::Y, Vec3::Y, class, 0.0)
        });
        let map = PhotonMap::build(photons.collect(), 20_000);
        // Direct light is not given in one corner, where photons of both classes are used.
        let direct = |_, at: Vec3, _| (at.x + at.z > 0.8).then_some(Rgb::splat(0.25));
        let sight = |_, _| |_| None;
        let irradiance = map
            .precompute_irradiance_until(&template(50), &params, 4, sight, Some(&direct), &|| false)
            .unwrap();
        let mut rng = Rng::new(seed, Stream::Measure, 1 << 40);
        for _ in 0..5000 {
            let u = rng.next_2d() * 0.7 + 0.15;
            sum += f64::from(
                irradiance
                    .nearest((Vec3::new(u.x, 0.001, u.y), Vec3::Y), (1.0, f32::INFINITY), |_, _| true)
                    .unwrap()
                    .irradiance
                    .y,
            );
            count += 1;
        }
    }
    let mean = sum / f64::from(count) / 0.5;
    println!("mean {mean}");
    assert!((mean - 1.0).abs() < 0.01, "{mean}");
}

#[test]
fn points_answer_for_what_is_near_them() {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let map = square(20_000, 3);
    let share = 0.4;
    let points = map
        .precompute_irradiance_near(&template(50), &params, (4, share), |_, _| |_| None, &|| false)
        .unwrap();
    // The radius of an estimate is 0.028, so the validity radius is 0.011.
    let places: Vec<Vec3> = (0..5000)
        .map(|i| {
            let u = Rng::new(9, Stream::Measure, i).next_2d() * 0.7 + 0.15;
            Vec3::new(u.x, 0.0, u.y)
        })
        .collect();
    let told: Vec<f64> = places
        .iter()
        .filter_map(|at| {
            points.near(*at, Vec3::Y, 1.0, |_, _| true).map(|irradiance| f64::from(irradiance.y))
        })
        .collect();
    let mean = told.iter().sum::<f64>() / told.len() as f64 / 0.5;
    println!("{} of {} told, mean {mean}", told.len(), places.len());
    assert!((mean - 1.0).abs() < 0.03, "{mean}");
    // Poisson: a share of 1 - exp(-5000 pi (0.4 0.028)^2) = 0.86.
    let share = told.len() as f64 / places.len() as f64;
    assert!((0.8..0.92).contains(&share), "{share}");
    let beside = Vec3::new(0.5, 0.0, -0.02);
    assert_eq!(points.near(beside, Vec3::Y, 1.0, |_, _| true), None, "beyond the reach of every point");
    assert_eq!(points.near(places[0], Vec3::X, 1.0, |_, _| true), None, "on a wall");
}

#[test]
fn rounding_has_no_bias() {
    let params = EstimateParams { kernel: Kernel::Epanechnikov, estimator: Estimator::Corrected };
    let map = square(50_000, 3);
    let irradiance = map.precompute_irradiance(&template(100), &params, 1);
    let mut scratch = Scratch::default();
    let (mut exact, mut stored, mut square) = (0.0, 0.0, 0.0);
    for photon in map.photons() {
        let query = template(100).at(photon.position, Vec3::Y);
        let a = f64::from(map.estimate_irradiance(&query, &params, &mut scratch).value.x);
        let b = f64::from(
            irradiance
                .nearest((photon.position, Vec3::Y), (1.0, f32::INFINITY), |_, _| true)
                .unwrap()
                .irradiance
                .x,
        );
        exact += a;
        stored += b;
        square += (b / a - 1.0).powi(2);
    }
    let rms = (square / map.len() as f64).sqrt();
    println!("ratio {}, rms {rms}", stored / exact);
    assert!((stored / exact - 1.0).abs() < 1e-4, "{}", stored / exact);
    assert!(rms < 0.004, "{rms}");
}

#[test]
fn sides_and_reach() {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let irradiance = square(1000, 0).precompute_irradiance(&template(50), &params, 1);
    let nearest = |at: Vec3, normal: Vec3, radius: f32| {
        irradiance.nearest((at, normal), (radius, f32::INFINITY), |_, _| true)
    };
    let on = Vec3::new(0.5, 0.0, 0.5);
    assert!(nearest(on, Vec3::Y, f32::INFINITY).is_some());
    assert!(nearest(on, Vec3::NEG_Y, f32::INFINITY).is_none());
    assert!(nearest(on, Vec3::X, f32::INFINITY).is_none());
    assert!(nearest(on, Vec3::Y, 1e-6).is_none());
    assert!(nearest(on, Vec3::Y, -1.0).is_none());
    assert!(nearest(Vec3::NAN, Vec3::Y, 1.0).is_none());
    // Neighbours number 32 within 0.1; points off the surface count as four times as far.
    assert!(nearest(Vec3::new(0.5, 0.0, -0.08), Vec3::Y, 1.0).is_some(), "beside");
    assert!(nearest(Vec3::new(0.5, 0.0, -0.3), Vec3::Y, 1.0).is_none(), "far beside");
    assert!(nearest(Vec3::new(0.5, 0.06, 0.5), Vec3::Y, 1.0).is_none(), "above");
    assert!(nearest(Vec3::new(0.5, -0.06, 0.5), Vec3::Y, 1.0).is_none(), "below");
    assert!(irradiance.memory_bytes() < 28 * irradiance.len());
    let none = PhotonMap::build(Vec::new(), 0).precompute_irradiance(&template(50), &params, 0);
    assert!(none.is_empty() && none.nearest((on, Vec3::Y), (1.0, f32::INFINITY), |_, _| true).is_none());
    let few = square(32, 0).precompute_irradiance(&template(50), &params, 1);
    assert!(
        few.nearest((on, Vec3::Y), (1.0, f32::INFINITY), |_, _| true).is_none(),
        "of 32 points none has 32 neighbours"
    );
}

#[test]
fn points_without_a_free_way_give_no_answer() {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let irradiance = square(1000, 0).precompute_irradiance(&template(50), &params, 1);
    // A wall in the plane x = 0.5.
    let mut rng = Rng::new(5, Stream::Measure, 0);
    for _ in 0..1000 {
        let at = Vec3::new(rng.next_f32(), 0.0, rng.next_f32());
        let same_side = |point: Vec3, _: Vec3| (point.x < 0.5) == (at.x < 0.5);
        // Next to the wall the nearest points may all be on the other side.
        let near_wall = (at.x - 0.5).abs() < 0.05;
        assert!(
            near_wall || irradiance.nearest((at, Vec3::Y), (1.0, f32::INFINITY), same_side).is_some(),
            "{at}"
        );
        assert!(irradiance.nearest((at, Vec3::Y), (1.0, f32::INFINITY), |_, _| false).is_none());
    }
}

#[test]
fn places_among_points_of_other_surfaces_are_given_up_quickly() {
    // The search must not visit all invalid points on its way to a valid one far away.
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let irradiance = square(50_000, 0).precompute_irradiance(&template(50), &params, 1);
    for height in [0.02, 0.1, 0.5] {
        assert!(
            irradiance
                .nearest((Vec3::new(0.5, height, 0.5), Vec3::Y), (1.0, f32::INFINITY), |_, _| true)
                .is_none()
        );
    }
}

#[test]
fn photons_of_direct_light_are_not_searched_where_it_is_known() {
    // Direct photons alone: an estimate of reflected light among them would visit each.
    let photons = square(20_000, 1);
    let direct: Vec<Photon> = photons
        .photons()
        .map(|photon| {
            Photon::new(photon.position, photon.power(), Vec3::Y, Vec3::Y, PhotonClass::Direct, 0.0)
        })
        .collect();
    let map = PhotonMap::build(direct, 20_000);
    let known = |_: u64, _: Vec3, _: Vec3| Some(Rgb::splat(0.25));
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let sight = |_, _| |_| None;
    let irradiance =
        map.precompute_irradiance_until(&template(50), &params, 4, sight, Some(&known), &|| false).unwrap();
    let found =
        irradiance.nearest((Vec3::new(0.5, 0.0, 0.5), Vec3::Y), (1.0, f32::INFINITY), |_, _| true).unwrap();
    assert!(found.lacks_direct && found.irradiance == Rgb::ZERO, "{found:?}");
    assert!(map.only(PhotonClasses::only(PhotonClass::Indirect)).is_empty());
    assert_eq!(map.only(PhotonClasses::only(PhotonClass::Direct)).len(), 20_000);
}

#[test]
fn a_point_next_to_something_answers_for_places_close_by_alone() {
    // The last point of a lattice of spacing 1, whose neighbour number 32 is about 4.5 away.
    let at = |reach: f32, is_sparse: bool| {
        let point = |i: u16| IrradiancePoint {
            position: Vec3::new(f32::from(i % 10), 0.0, f32::from(i / 10)),
            irradiance: Rgbe::encode_dithered(Rgb::ONE, 0.5),
            reach,
            normal: normal_code(Vec3::Y),
            reflected: None,
            is_direct: false,
            outlook: f32::INFINITY,
            is_poor: false,
            is_sparse,
        };
        IrradianceMap::of_points((0..100).map(point).collect())
    };
    let seen_from = |map: &IrradianceMap, beyond: f32, distance: f32| {
        map.nearest((Vec3::new(9.0 + beyond, 0.0, 5.0), Vec3::Y), (100.0, distance), |_, _| true).is_some()
    };
    let answers = |map: &IrradianceMap, beyond: f32| seen_from(map, beyond, 10.0);
    let (open, walled, sparse) = (at(f32::INFINITY, false), at(0.5, false), at(f32::INFINITY, true));
    assert!(answers(&open, 3.0) && !answers(&open, 6.0));
    for limited in [&walled, &sparse] {
        assert!(answers(limited, 1.0) && !answers(limited, 3.0));
    }
    assert!(
        seen_from(&walled, 3.0, 100.0) && !seen_from(&sparse, 3.0, 100.0),
        "from far away they lie close together"
    );
    // Points that are valid for no place are not skipped in favour of others farther away.
    assert!(!answers(&at(0.0, false), 0.1));
    // The sparse flag survives a file.
    let read =
        (0..sparse.len()).map(|i| IrradianceMap::point(sparse.record(i)).unwrap_or_else(|| panic!("{i}")));
    assert!(!answers(&IrradianceMap::of_points(read.collect()), 3.0));
}
