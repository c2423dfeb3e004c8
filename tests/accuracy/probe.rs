//! Irradiance at places: on surfaces that reflect nothing, and with errors that are what they say.

use crate::support::*;
use cardioid::photons::{TraceSettings, trace_photons_alone};
use cardioid::render::{
    MapKind, Overrides, PROBE_BATCHES, ProbeEstimator, ProbePoint, ProbeRequest, Probed, Quality, Reading,
    Settings, Silent, probe,
};
use glam::DVec3;
use std::f64::consts::PI;

/// A sensor of this material under a plate of glass, and a light above.
fn sensor(material: &str, light: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0, 2, 3]
        at = [0, 0, 0]
        [materials.sensor]
        {material}
        [materials.glass]
        type = "dielectric"
        ior = 1.5
        [[shapes]]
        name = "sensor"
        type = "quad"
        corner = [-1, 0, 1]
        edge-u = [2, 0, 0]
        edge-v = [0, 0, -2]
        material = "sensor"
        [[shapes]]
        name = "plate"
        type = "box"
        min = [-2, 1, -2]
        max = [2, 1.1, 2]
        material = "glass"
        [[lights]]
        name = "lamp"
        {light}
        "#
    );
    Stage::new(&text, (4, 4))
}

const PARALLEL: &str = "type = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1000.0";

/// What a plate of index 1.5 passes of parallel light from above: each face reflects 4 %, and what is reflected between them counts.
const PASSED: f64 = 1000.0 * (1.0 - 0.04) / (1.0 + 0.04);

fn request(settings: Settings, estimators: &[ProbeEstimator], batches: u32) -> ProbeRequest {
    ProbeRequest {
        points: vec![ProbePoint { position: DVec3::ZERO, normal: DVec3::Y }],
        estimators: estimators.to_vec(),
        samples: 128,
        batches,
        lift: 1e-3,
        settings,
    }
}

fn look(stage: &Stage, overrides: &Overrides, estimators: &[ProbeEstimator], batches: u32) -> Probed {
    let request = request(stage.settings(overrides), estimators, batches);
    probe(stage.scene(), &request, &Silent).unwrap().unwrap()
}

fn readings(probed: &Probed) -> &[Reading] {
    &probed.points[0].as_ref().unwrap().readings
}

const BY_MAPS: [ProbeEstimator; 2] = [ProbeEstimator::PhotonMap, ProbeEstimator::Gather];

/// Whatever a surface reflects, what arrives is the same but for what goes back to the plate and returns; the last one is asked
/// on the side that absorbs.
#[test]
fn a_sensor_of_any_material_receives_the_light_of_a_plate() {
    const SEEDS: u64 = 24;
    /// What the plate reflects of light from above or below.
    const RETURNED: f64 = 2.0 * 0.04 / (1.0 + 0.04);
    // The noise of the cone kernel is that of three quarters of these photons: 4 %, and 0.8 % in the mean of all seeds.
    let overrides = Overrides {
        quality: Some(Quality::Draft),
        global_photons: Some(1_000),
        caustic_photons: Some(20_000),
        caustic_nearest: Some(800),
        ..Overrides::default()
    };
    // What reflects parallel light as it comes, at least and at most. Gold spreads it a little.
    for (material, mirrored) in [
        ("type = \"lambert\"\nreflectance = 0.0", [0.0; 2]),
        ("type = \"lambert\"\nreflectance = 0.0001", [0.0; 2]),
        ("type = \"mirror\"\nreflectance = 0.5", [0.5; 2]),
        ("type = \"conductor\"\nmetal = \"gold\"\nroughness = 0.1", [0.0, 1.0]),
        ("type = \"schlick\"\ncolour = 0.0\nroughness = 1.0", [0.0; 2]),
        ("type = \"lambert\"\nreflectance = 0.5\ntwo-sided = false", [0.0; 2]),
    ] {
        let mut stage = sensor(material, PARALLEL);
        if material.contains("two-sided") {
            let shapes = stage.description.shapes.iter_mut();
            shapes.filter(|shape| shape.name == "sensor").for_each(|shape| shape.value.flip_normal = true);
            stage = Stage::of(stage.description, stage.size);
        }
        let mut sums = [0.0; BY_MAPS.len()];
        for seed in 0..SEEDS {
            let overrides = Overrides { seed: Some(seed), ..overrides.clone() };
            let probed = look(&stage, &overrides, &BY_MAPS, 1);
            for (sum, reading) in sums.iter_mut().zip(readings(&probed)) {
                *sum += reading.irradiance[3].x / SEEDS as f64;
            }
        }
        let [least, most] = mirrored.map(|share| PASSED / (1.0 - share * RETURNED));
        println!("{material:?}: {sums:?}, from {least} to {most}");
        for found in sums {
            assert!(
                found > 0.95 * least && found < 1.05 * most,
                "{material}: {found}, from {least} to {most}"
            );
        }
    }
}

/// What no picture reads costs none anything.
#[test]
fn pictures_store_nothing_on_black_surfaces() {
    let stage = sensor("type = \"lambert\"\nreflectance = 0.0", PARALLEL);
    for kind in [MapKind::Global, MapKind::Caustic] {
        let settings = TraceSettings {
            kind,
            stored: 1000,
            seed: 1,
            max_depth: 100,
            aimed: true,
            wavelengths: Default::default(),
        };
        let (photons, met) = trace_photons_alone(stage.scene(), &settings, 1000);
        assert!(photons.is_empty() && met > 0);
    }
}

/// Times that the mean +- 1.96 standard errors holds the truth, by estimator.
fn held(stage: &Stage, overrides: &Overrides, estimators: &[ProbeEstimator], truth: f64) -> Vec<u32> {
    let mut held = vec![0; estimators.len()];
    for seed in 0..SEEDS {
        let overrides = Overrides { seed: Some(seed), ..overrides.clone() };
        let probed = look(stage, &overrides, estimators, PROBE_BATCHES);
        for (held, reading) in held.iter_mut().zip(readings(&probed)) {
            let error = reading.standard_error.unwrap()[3].x;
            *held += u32::from((reading.irradiance[3].x - truth).abs() < 1.96 * error);
        }
    }
    println!("{estimators:?} hold the truth {held:?} times of {SEEDS}");
    held
}

const SEEDS: u64 = 200;

/// 95 % of 200: beyond these with a probability of 4e-5.
const HELD: std::ops::RangeInclusive<u32> = 176..=199;

#[test]
fn stated_intervals_hold_the_truth_of_maps() {
    let stage = sensor("type = \"lambert\"\nreflectance = 0.0", PARALLEL);
    let overrides = Overrides {
        quality: Some(Quality::Draft),
        global_photons: Some(100),
        caustic_photons: Some(1500),
        caustic_nearest: Some(40),
        ..Overrides::default()
    };
    for held in held(&stage, &overrides, &BY_MAPS, PASSED) {
        assert!(HELD.contains(&held), "{held}");
    }
}

#[test]
fn stated_intervals_hold_the_truth_of_paths() {
    let text = r#"
        [camera]
        eye = [0.0, 1.0, 0.9]
        at = [0.0, 1.0, 0.0]
        [materials.paint]
        type = "lambert"
        reflectance = 0.5
        [[shapes]]
        type = "mesh"
        vertices = [[-1,0,-1], [1,0,-1], [1,2,-1], [-1,2,-1], [-1,0,1], [1,0,1], [1,2,1], [-1,2,1]]
        faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
        material = "paint"
        emission = { radiance = 1.0 }
        "#;
    let stage = Stage::new(text, (4, 4));
    let overrides = Overrides { quality: Some(Quality::Draft), ..Overrides::default() };
    let truth = PI / (1.0 - 0.5);
    assert!(HELD.contains(&held(&stage, &overrides, &[ProbeEstimator::Path], truth)[0]));
}

/// Seeds differ by what is stated, where photons of a sun come through a plate.
#[test]
fn errors_of_the_sun_through_a_plate_are_those_between_seeds() {
    let sun = "type = \"sky\"\nelevation = 75";
    let stage = sensor("type = \"lambert\"\nreflectance = 0.5", sun);
    let (mut squares, mut stated) = (0.0, 0.0);
    let mut all = Vec::new();
    for seed in 0..16 {
        let overrides = Overrides {
            quality: Some(Quality::Draft),
            seed: Some(seed),
            global_photons: Some(500),
            caustic_photons: Some(2000),
            ..Overrides::default()
        };
        let probed = look(&stage, &overrides, &[ProbeEstimator::Gather], PROBE_BATCHES);
        let reading = &readings(&probed)[0];
        all.push(reading.irradiance[3].x);
        stated += reading.standard_error.unwrap()[3].x.powi(2) / 16.0;
    }
    let mean = all.iter().sum::<f64>() / 16.0;
    all.iter().for_each(|value| squares += (value - mean).powi(2) / 15.0);
    println!("mean {mean}, between seeds {}, stated {}", squares.sqrt(), stated.sqrt());
    // Student's factor is 1.21; the deviation of 16 values is known within a factor of two.
    assert!(stated.sqrt() > 0.5 * squares.sqrt() && stated.sqrt() < 3.0 * squares.sqrt());
}

/// Paths cannot meet parallel light behind glass: they say so, and no zero error tempts anyone.
#[test]
fn paths_say_what_light_they_miss() {
    let overrides = Overrides { quality: Some(Quality::Draft), ..Overrides::default() };
    let sun = "type = \"sky\"\nelevation = 90";
    for light in [PARALLEL, sun] {
        let stage = sensor("type = \"lambert\"\nreflectance = 0.5", light);
        let probed = look(&stage, &overrides, &[ProbeEstimator::Path], PROBE_BATCHES);
        let reading = &readings(&probed)[0];
        assert!(reading.standard_error.is_none());
        assert!(reading.missing.as_ref().unwrap().contains("lamp"));
        assert!(probed.warnings.iter().any(|warning| warning.contains("`path`") && warning.contains("lamp")));
        let csv = probed.to_csv();
        let lines: Vec<&str> = csv.lines().collect();
        assert!(lines[0].ends_with(",note") && lines[1].contains("lamp"), "{csv}");
    }
    // A lamp that is large enough is met.
    let stage = sensor("type = \"lambert\"\nreflectance = 0.5", "type = \"environment\"\nradiance = 1.0");
    let probed = look(&stage, &overrides, &[ProbeEstimator::Path], PROBE_BATCHES);
    assert!(readings(&probed)[0].missing.is_none() && readings(&probed)[0].standard_error.is_some());
    // One batch of maps does not know its noise.
    let probed = look(&stage, &overrides, &BY_MAPS, 1);
    assert!(readings(&probed).iter().all(|reading| reading.standard_error.is_none()));
}
