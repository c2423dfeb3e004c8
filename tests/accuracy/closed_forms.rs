//! Caustics against their closed forms (figures 7 and 8 of Jensen & Christensen 1995, figure 2 of Jensen 1996).

use super::support::{Stage, photon_map};
use cardioid::measure::caustics::{Cardioid, Cell, MirrorSquare, Nephroid};
use cardioid::photons::{Estimator, Kernel, PhotonMap, Query, Scratch, SearchRegion};
use cardioid::render::{
    Overrides, ProbeEstimator, ProbePoint, ProbeRequest, Probed, Quality, Silent, build_maps, probe,
};
use glam::{DVec3, Vec3};

const SQUARE: MirrorSquare = MirrorSquare { intensity: 1.0, reflectance: 0.9 };

/// Photons of the caustic, whose area is 4.
const PHOTONS: u64 = 100_000;

fn point(x: f64, z: f64) -> ProbePoint {
    ProbePoint { position: DVec3::new(x, 0.0, z), normal: DVec3::Y }
}

fn look(stage: &Stage, overrides: &Overrides, points: Vec<ProbePoint>, by: ProbeEstimator) -> Probed {
    let request = ProbeRequest {
        points,
        estimators: vec![by],
        samples: 256,
        batches: 1,
        lift: 1e-3,
        settings: stage.settings(overrides),
    };
    probe(stage.scene(), &request, &Silent).unwrap().unwrap()
}

fn reading(kernel: Kernel, nearest: u32, check: bool, seed: u64) -> Overrides {
    Overrides {
        quality: Some(Quality::Preview),
        seed: Some(seed),
        global_photons: Some(10_000),
        caustic_photons: Some(PHOTONS),
        caustic_nearest: Some(nearest),
        kernel: Some(kernel),
        differential_check: Some(check),
        estimator: Some(Estimator::Corrected),
        search: Some(SearchRegion::Disc),
        ..photon_map()
    }
}

/// Caustic irradiance over the exact one at each point.
fn ratios(stage: &Stage, overrides: &Overrides, places: &[(f64, f64)]) -> Vec<f64> {
    let points = places.iter().map(|&(x, z)| point(x, z)).collect();
    let probed = look(stage, overrides, points, ProbeEstimator::PhotonMap);
    let found = probed.points.iter().zip(places);
    found
        .map(|(found, &(x, z))| found.as_ref().unwrap().readings[0].irradiance[1].y / SQUARE.caustic(x, z))
        .collect()
}

/// Mean and RMS deviation from the exact solution.
#[test]
fn the_mirror_square_within_its_bounds() {
    let stage = Stage::load("mirror-square", (4, 4));
    // Far enough from the edges for the widest estimate, of radius 0.14.
    let places: Vec<(f64, f64)> = (0..21)
        .flat_map(|i| (-2..=2).map(move |j| (0.3 + 0.07 * f64::from(i), 0.1 * f64::from(j))))
        .collect();
    let cone = Kernel::Cone { k: 1.0 };
    for (kernel, nearest, check, bound) in [
        (Kernel::Constant, 200, false, 0.08),
        (cone, 200, false, 0.095),
        (Kernel::Constant, 1500, false, 0.03),
        // Checking takes fewer photons here and there.
        (Kernel::Constant, 200, true, 0.12),
    ] {
        let all: Vec<f64> =
            (0..4).flat_map(|seed| ratios(&stage, &reading(kernel, nearest, check, seed), &places)).collect();
        let n = all.len() as f64;
        let mean = all.iter().sum::<f64>() / n;
        let rms = (all.iter().map(|ratio| (ratio - 1.0).powi(2)).sum::<f64>() / n).sqrt();
        println!("{kernel:?}, N = {nearest}, checked {check}: mean {mean:.4}, RMS {:.2} %", 100.0 * rms);
        assert!((mean - 1.0).abs() < 0.01, "{kernel:?} {nearest} {check}: mean {mean}");
        assert!(rms < bound, "{kernel:?} {nearest} {check}: RMS {rms}");
        // Photons are stratified, so less than the noise of independent ones, of one over the root of N.
        assert!(rms > 0.1 / f64::from(nearest).sqrt(), "{kernel:?} {nearest}: too good to be true, {rms}");
    }
}

/// Distance over which the caustic falls from 75 % to 25 % at its edge, mean over places and seeds.
fn edge_width(stage: &Stage, check: bool) -> f64 {
    let steps: Vec<f64> = (-20..=20).map(|i| MirrorSquare::EDGE + 0.01 * f64::from(i)).collect();
    let mut profile = vec![0.0; steps.len()];
    for seed in 0..4 {
        for j in -4..=4 {
            let points = steps.iter().map(|&x| point(x, 0.1 * f64::from(j))).collect();
            let overrides = reading(Kernel::Constant, 200, check, seed);
            let probed = look(stage, &overrides, points, ProbeEstimator::PhotonMap);
            for (sum, found) in profile.iter_mut().zip(&probed.points) {
                *sum += found.as_ref().unwrap().readings[0].irradiance[1].y;
            }
        }
    }
    let full = 36.0 * SQUARE.caustic(MirrorSquare::EDGE - 0.01, 0.0);
    let crossing = |level: f64| {
        let i = profile.windows(2).position(|w| w[0] >= level * full && w[1] < level * full).unwrap();
        let share = (profile[i] - level * full) / (profile[i] - profile[i + 1]);
        steps[i] + share * (steps[i + 1] - steps[i])
    };
    crossing(0.25) - crossing(0.75)
}

#[test]
fn checking_sharpens_the_edge() {
    let stage = Stage::load("mirror-square", (4, 4));
    let (without, with) = (edge_width(&stage, false), edge_width(&stage, true));
    println!("edge {without:.4} wide, checked {with:.4}");
    assert!(with < 0.8 * without, "{with}, not below {without}");
}

/// Direct light of all estimators, and caustics of those that see them, agree with the closed form; indirect light of paths
/// and of gathering with each other.
#[test]
fn estimators_of_the_probe_agree() {
    let stage = Stage::load("mirror-square", (4, 4));
    let points = || vec![point(0.6, 0.1), point(1.3, -0.2), point(2.4, 0.0)];
    let overrides = reading(Kernel::Constant, 1500, false, 1);
    let all = [ProbeEstimator::PhotonMap, ProbeEstimator::Gather, ProbeEstimator::Path]
        .map(|by| look(&stage, &overrides, points(), by));
    for (number, place) in points().iter().enumerate() {
        let (x, z) = (place.position.x, place.position.z);
        let [map, gather, path] =
            [0, 1, 2].map(|i| all[i].points[number].as_ref().unwrap().readings[0].irradiance.map(|e| e.y));
        let direct = SQUARE.direct(x, z);
        println!("{map:.4?} {gather:.4?} {path:.4?}, direct {direct:.4}");
        // A point light: one shadow ray is exact.
        assert!((gather[0] / direct - 1.0).abs() < 1e-4 && (path[0] / direct - 1.0).abs() < 1e-4);
        // 10 000 photons all over the square.
        assert!((map[0] / direct - 1.0).abs() < 0.35);
        let caustic = SQUARE.caustic(x, z);
        for value in [map[1], gather[1]] {
            // Beyond the edge an estimate of 1500 photons is blurred, and next to nothing.
            assert!((value - caustic).abs() <= 0.09 * caustic.max(0.05), "{value}, not {caustic}");
        }
        // Paths do not find caustics of point lights, and a mirror shows nothing but the square.
        assert_eq!(path[1], 0.0);
        assert!((map[3] - map[..3].iter().sum::<f64>()).abs() < 1e-6 * map[3]);
    }
    // Twice the same.
    let again = look(&stage, &overrides, points(), ProbeEstimator::Path);
    assert_eq!(again.points, all[2].points);
    let csv = again.to_csv();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 4);
    let columns = lines[0].split(',').count();
    assert!(lines.iter().all(|line| line.split(',').count() == columns) && lines[1].contains("\"square\""));
    // Nothing is below a point beside the square.
    let lost = look(&stage, &overrides, vec![point(9.0, 0.0)], ProbeEstimator::Path);
    assert!(lost.points[0].is_none() && lost.warnings.len() == 1);
    assert_eq!(lost.to_csv().lines().nth(1).unwrap().split(',').count(), columns);
}

/// The caustic map of a scene; and its photons' flux and its estimates over `cell`, mean in W/m^2.
fn caustic_map(stage: &Stage, photons: u64) -> PhotonMap {
    let settings = stage.settings(&Overrides {
        global_photons: Some(1000),
        caustic_photons: Some(photons),
        precomputed_irradiance: Some(false),
        ..photon_map()
    });
    let plan = settings.plan(stage.scene());
    build_maps(stage.scene(), &plan, &settings, &Silent).unwrap().maps.caustic.unwrap()
}

fn means(stage: &Stage, map: &PhotonMap, cell: &Cell) -> [f64; 2] {
    const ACROSS: u32 = 32;
    let space = stage.scene().space();
    let mut flux = 0.0;
    for photon in map.photons() {
        let place = space.world_position(photon.position.as_dvec3());
        if place.y.abs() < 1e-6 && cell.contains(place.x, place.z) {
            flux += f64::from(photon.power().y);
        }
    }
    let by_flux = stage.watts(flux / map.emitted() as f64) / cell.area();
    let params =
        cardioid::photons::EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let mut scratch = Scratch::default();
    let mut sum = 0.0;
    for i in 0..ACROSS * ACROSS {
        let at = |range: [f64; 2], i: u32| {
            range[0] + (range[1] - range[0]) * (f64::from(i) + 0.5) / f64::from(ACROSS)
        };
        let place = DVec3::new(at(cell.x, i % ACROSS), 0.0, at(cell.z, i / ACROSS));
        let query = Query::nearest(space.position(place).as_vec3(), Vec3::Y, 100);
        sum += f64::from(map.estimate_irradiance(&query, &params, &mut scratch).value.y);
    }
    [by_flux, sum / f64::from(ACROSS * ACROSS) / space.power]
}

const RING: &str = "
    [camera]
    eye = [0, 3, 0.1]
    at = [0, 0, 0]
    [materials.floor]
    type = \"lambert\"
    reflectance = 0.5
    [materials.metal]
    type = \"mirror\"
    reflectance = 0.8
    [[shapes]]
    name = \"floor\"
    type = \"quad\"
    corner = [-2, 0, 2]
    edge-u = [4, 0, 0]
    edge-v = [0, 0, -4]
    material = \"floor\"
    ";

#[track_caller]
fn assert_cells(what: &str, stage: &Stage, photons: u64, cells: &[Cell], exact: impl Fn(&Cell) -> f64) {
    let map = caustic_map(stage, photons);
    for cell in cells {
        let want = 0.8 * exact(cell);
        let [flux, estimate] = means(stage, &map, cell);
        println!(
            "{what} {cell:?}: {want:.5}, photons {:+.2} %, estimates {:+.2} %",
            100.0 * (flux / want - 1.0),
            100.0 * (estimate / want - 1.0)
        );
        assert!((flux / want - 1.0).abs() < 0.02, "{what} {cell:?}: flux {flux}, not {want}");
        assert!((estimate / want - 1.0).abs() < 0.02, "{what} {cell:?}: estimate {estimate}, not {want}");
    }
}

/// On the axis, around the cusp at `cusp`, and beside the axis. Wide where light is faint, so that the photons' own noise stays
/// below 1 %, and where it is brightest, so that little of it is blurred over the edge.
fn cells(cusp: f64) -> Vec<Cell> {
    let places = [
        (-0.5, 0.0, 0.2),
        (0.0, 0.0, 0.2),
        (0.2, 0.0, 0.16),
        (cusp, 0.0, 0.3),
        (0.1, 0.4, 0.3),
        (0.3, -0.3, 0.3),
        (-0.1, -0.4, 0.3),
    ];
    places.map(|(x, z, width)| Cell::around(x, z, width)).to_vec()
}

/// Half a ring of which every first reflection reaches the floor. What is reflected twice stays within 0.7 of the wall.
#[test]
fn cells_of_the_nephroid() {
    let stage = Stage::new(
        &format!(
            "{RING}
            [[shapes]]
            name = \"ring\"
            type = \"csg\"
            operation = \"difference\"
            material = \"metal\"
            operands = [
              {{ type = \"cylinder\", base = [0, -0.2, 0], top = [0, 0.5, 0], radius = 1.02 }},
              {{ type = \"cylinder\", base = [0, -0.3, 0], top = [0, 0.6, 0], radius = 1.0 }},
              {{ type = \"box\", min = [-2, -0.4, -2], max = [0, 0.7, 2] }},
            ]
            [[lights]]
            type = \"directional\"
            direction = [4, -1, 0]
            irradiance = 10.0"
        ),
        (4, 4),
    );
    let on_floor = 10.0 / 17f64.sqrt();
    let nephroid = Nephroid { radius: 1.0, reach: 2.0 };
    assert_cells("nephroid", &stage, 1_000_000, &cells(0.5), |cell| on_floor * nephroid.mean(cell));
}

/// A light over the ring that is twice as high: no light meets the ring twice.
#[test]
fn cells_of_the_cardioid() {
    let stage = Stage::new(
        &format!(
            "{RING}
            [[shapes]]
            name = \"ring\"
            type = \"cylinder\"
            base = [0, 0, 0]
            top = [0, 0.5, 0]
            radius = 1.0
            material = \"metal\"
            [[lights]]
            type = \"point\"
            position = [-1, 1, 0]
            intensity = 3.0"
        ),
        (4, 4),
    );
    let cardioid = Cardioid { radius: 1.0, height: 1.0, ring: 0.5, intensity: 3.0 };
    assert_cells("cardioid", &stage, 1_000_000, &cells(1.0 / 3.0), |cell| cardioid.mean(cell));
}
