//! Shadow photons: where they are stored, and what direct light computed with them is off by.

use crate::support::*;
use cardioid::photons::{PhotonClass, trace_shadow_photons};
use cardioid::render::{Overrides, ShadowMode};

/// A floor, and a camera that looks down on it.
const FLOOR: &str = r#"
    [camera]
    eye = [0.0, 6.0, 3.5]
    at = [0.0, 0.0, 0.0]
    fov = 40

    [materials.white]
    type = "lambert"
    reflectance = 0.8

    [materials.black]
    type = "lambert"
    reflectance = 0.0

    [materials.glass]
    type = "dielectric"
    ior = 1.5

    [[shapes]]
    name = "floor"
    type = "quad"
    corner = [-2, 0, -2]
    edge-u = [0, 0, 4]
    edge-v = [4, 0, 0]
    material = "white"
"#;

const LAMP: &str = r#"
    [[shapes]]
    name = "lamp"
    type = "quad"
    corner = [-0.1, 3, -0.1]
    edge-u = [0.2, 0, 0]
    edge-v = [0, 0, 0.2]
    material = "black"
    emission = { radiance = 100.0 }
"#;

/// A rod of 1 cm and a fence of 2 cm bars, for the thin shadows that photons may overlook.
const RODS: &str = r#"
    [[shapes]]
    name = "rod"
    type = "cylinder"
    base = [-1.2, 0.3, 1.1]
    top = [1.2, 0.3, 0.9]
    radius = 0.005
    material = "white"

    [[shapes]]
    name = "bar 1"
    type = "cylinder"
    base = [-0.6, 0.0, -0.5]
    top = [-0.6, 0.8, -0.5]
    radius = 0.01
    material = "white"

    [[shapes]]
    name = "bar 2"
    type = "cylinder"
    base = [-0.4, 0.0, -0.5]
    top = [-0.4, 0.8, -0.5]
    radius = 0.01
    material = "white"

    [[shapes]]
    name = "ball"
    type = "sphere"
    center = [0.7, 0.35, -0.5]
    radius = 0.35
    material = "white"
"#;

fn with(mode: ShadowMode, rays: u64) -> Overrides {
    Overrides {
        spp: Some(8),
        gather_samples: Some(1),
        global_photons: Some(1000),
        shadow_photons: Some(mode),
        shadow_photon_rays: Some(rays),
        ..photon_map()
    }
}

/// What a picture's direct light is off by, from that with all shadow rays and the same random numbers: the error of
/// decisions alone, relative to the mean of the picture. And the largest error of a pixel, in the same unit.
fn error(shot: &Shot, full: &Shot) -> (f64, f64) {
    let (a, b) = (shot.layer("direct"), full.layer("direct"));
    let mean = b.iter().map(|&x| f64::from(x)).sum::<f64>() / b.len() as f64;
    let errors = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).abs() / mean);
    let (squares, largest) =
        errors.fold((0.0, 0.0), |(sum, largest): (f64, f64), e| (sum + e * e, largest.max(e)));
    ((squares / b.len() as f64).sqrt(), largest)
}

#[test]
fn bounded_decisions_keep_the_shadows_of_rods() {
    let stage = Stage::new(&format!("{FLOOR}{LAMP}{RODS}"), (96, 96));
    let full = stage.shoot(&with(ShadowMode::Off, 0));
    assert!(full.statistics.shadows.is_empty() && !full.statistics.plan.shadow_photons.build);
    for (mode, rays, rms, largest, saved) in
        [(ShadowMode::Bounded, 300_000, 0.002, 0.15, 50.0), (ShadowMode::AsPrinted, 300_000, 0.04, 1.5, 80.0)]
    {
        let shot = stage.shoot(&with(mode, rays));
        let light = shot.statistics.shadows[0];
        let off = error(&shot, &full);
        println!("{mode:?}: rms {:.5}, largest {:.4}; {light:?}", off.0, off.1);
        assert!(off.0 < rms && off.1 < largest);
        assert!(light.rays_saved_percent > saved);
        // Decisions cost no light sample: what is saved and what is traced are together what full rays are.
        let counted = light.decisions.rays_saved + light.decisions.rays_traced;
        assert_eq!(counted, full.statistics.counters.shadow_rays);
        assert_eq!(light.decisions.rays_traced, shot.statistics.counters.shadow_rays);
        assert_eq!(light.dropped, 0);
    }
}

#[test]
fn few_photons_decide_nothing_when_bounded() {
    let stage = Stage::new(&format!("{FLOOR}{LAMP}{RODS}"), (48, 48));
    let full = stage.shoot(&with(ShadowMode::Off, 0));
    let shot = stage.shoot(&with(ShadowMode::Bounded, 1000));
    assert_eq!(shot.layer("direct"), full.layer("direct"));
    assert_eq!(shot.statistics.shadows[0].decisions.rays_saved, 0);
    assert!(shot.warns("saved no shadow ray") && !full.warns("saved no shadow ray"));
    // Ten of few are enough as printed, and show it.
    let printed = stage.shoot(&with(ShadowMode::AsPrinted, 1000));
    let (rms, largest) = error(&printed, &full);
    println!(
        "as printed, 1000 rays: rms {rms:.4}, largest {largest:.3}, {:?}",
        printed.statistics.shadows[0]
    );
    assert!(printed.statistics.shadows[0].rays_saved_percent > 50.0 && rms > 0.002);
}

#[test]
fn lights_without_a_size_pay_nothing() {
    let lights = r#"
        [[lights]]
        type = "point"
        position = [0, 3, 0]
        intensity = 10.0

        [[lights]]
        type = "environment"
        radiance = 0.1
    "#;
    let stage = Stage::new(&format!("{FLOOR}{RODS}{lights}"), (32, 32));
    let full = stage.shoot(&with(ShadowMode::Off, 0));
    let shot = stage.shoot(&with(ShadowMode::Bounded, 100_000));
    assert!(!shot.statistics.plan.shadow_photons.build);
    assert!(shot.statistics.plan.shadow_photons.reason.contains("no light has a size"));
    assert!(shot.statistics.shadows.is_empty() && shot.statistics.seconds_shadows == 0.0);
    assert_eq!(shot.layer("beauty"), full.layer("beauty"));
    // As printed the point light has its photons, and the sky has none.
    let printed = stage.shoot(&with(ShadowMode::AsPrinted, 10_000));
    let [point, sky] = printed.statistics.shadows[..] else { panic!("two lights") };
    assert!(point.rays == 10_000 && point.decisions.rays_saved > 0);
    assert!(sky.rays == 0 && sky.decisions.rays_saved == 0 && sky.decisions.rays_traced > 0);
}

#[test]
fn glass_casts_shadow_photons_and_takes_none() {
    let pane = r#"
        [[shapes]]
        name = "pane"
        type = "disc"
        center = [0, 2, 0]
        radius = 1.0
        material = "glass"
    "#;
    let stage = Stage::new(&format!("{FLOOR}{LAMP}{pane}"), (8, 8));
    let traced = trace_shadow_photons(stage.scene(), 0, 20_000, 3);
    let (mut shadows, mut direct) = (0, 0);
    for (photon, &surface) in traced.photons.iter().zip(&traced.surfaces) {
        assert_eq!(stage.scene().surfaces()[surface as usize].name, "floor");
        let place = photon.position.as_dvec3() / stage.scene().space().scale + stage.scene().space().center;
        let from_axis = place.x.hypot(place.z);
        match photon.class() {
            PhotonClass::Direct => {
                direct += 1;
                assert!(from_axis > 2.5, "{place}");
            }
            PhotonClass::Shadow => {
                shadows += 1;
                // The pane from the farthest corner of the lamp.
                assert!(from_axis < 3.0 + 2.0 * 0.15, "{place}");
            }
            class => panic!("{class:?}"),
        }
    }
    println!("{direct} direct, {shadows} shadow; {:?}", traced.tally);
    assert!(shadows > 5000);
    assert_eq!((traced.tally.direct, traced.tally.shadow), (direct, shadows));
    assert_eq!(traced.tally.rays, 20_000);
}

#[test]
fn the_same_for_any_number_of_threads_and_scale() {
    let text = format!("{FLOOR}{LAMP}{RODS}");
    let stage = Stage::new(&text, (32, 32));
    let shoot = |stage: &Stage, threads: usize, mode| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| stage.shoot(&with(mode, 60_000)))
    };
    for mode in [ShadowMode::Bounded, ShadowMode::AsPrinted] {
        let one = shoot(&stage, 1, mode);
        assert!(one.statistics.shadows[0].decisions.rays_saved > 0);
        let five = shoot(&stage, 5, mode);
        assert_eq!(one.layer("beauty"), five.layer("beauty"));
        assert_eq!(one.statistics.shadows[0].decisions, five.statistics.shadows[0].decisions);
    }
    let large = Stage::new(&text.replacen("[camera]", "unit = 1024\n[camera]", 1), (32, 32));
    let (small, large) = (shoot(&stage, 2, ShadowMode::Bounded), shoot(&large, 2, ShadowMode::Bounded));
    assert_eq!(small.layer("direct"), large.layer("direct"));
}
