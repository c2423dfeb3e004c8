//! Pass 1 keeps its books: flux that leaves the lights is absorbed, escapes or is cut off, and how much is stored is
//! known in closed form.

use crate::support::*;
use cardioid::photons::{PhotonClass, PhotonClasses, PhotonMap, PhotonTally, TraceSettings, trace_photons};
use cardioid::render::{MapKind, Overrides};
use cardioid::scene::Scene;
use glam::DVec3;
use std::f64::consts::PI;

/// Every kind of light that has a power of its own: name, scene text, flux in watts of the first channel; the others
/// have a half and a quarter of it.
fn lights() -> Vec<(&'static str, String, f64)> {
    let area = |shape: &str, two_sided: bool| {
        format!(
            r#"
            [[shapes]]
            {shape}
            material = "paint"
            emission = {{ radiance = [4.0, 2.0, 1.0], two-sided = {two_sided} }}
            "#
        )
    };
    let quad =
        "type = \"quad\"\ncorner = [-0.3, 0.6, -0.2]\nedge-u = [0.5, 0.1, 0.0]\nedge-v = [0.0, 0.1, 0.4]";
    let quad_area = DVec3::new(0.5, 0.1, 0.0).cross(DVec3::new(0.0, 0.1, 0.4)).length();
    let mesh = "type = \"mesh\"\nvertices = [[0, 0.5, 0], [0.4, 0.5, 0], [0.4, 0.5, 0.3], [0, 0.7, 0.5]]\n\
                faces = [[0, 1, 2], [0, 2, 3]]";
    let mesh_area = 0.5
        * (DVec3::new(0.4, 0.0, 0.0).cross(DVec3::new(0.4, 0.0, 0.3)).length()
            + DVec3::new(0.4, 0.0, 0.3).cross(DVec3::new(0.0, 0.2, 0.5)).length());
    let sphere = "type = \"sphere\"\ncenter = [0.1, 0.4, 0.2]\nradius = 0.25";
    let disc = "type = \"disc\"\ncenter = [0.0, 0.7, 0.1]\nnormal = [0.1, -1.0, 0.2]\nradius = 0.3";
    let cylinder = "type = \"cylinder\"\nbase = [-0.4, 0.5, 0.1]\ntop = [0.4, 0.6, -0.1]\nradius = 0.1";
    let cylinder_area = 2.0 * PI * 0.1 * DVec3::new(0.8, 0.1, -0.2).length();
    let point = "[[lights]]\ntype = \"point\"\nposition = [0.2, 0.3, -0.1]\nintensity = [4.0, 2.0, 1.0]\n";
    vec![
        ("quad", area(quad, false), 4.0 * PI * quad_area),
        ("two-sided quad", area(quad, true), 8.0 * PI * quad_area),
        ("mesh", area(mesh, false), 4.0 * PI * mesh_area),
        ("two-sided mesh", area(mesh, true), 8.0 * PI * mesh_area),
        ("sphere", area(sphere, false), 4.0 * PI * 4.0 * PI * 0.0625),
        ("two-sided sphere", area(sphere, true), 8.0 * PI * 4.0 * PI * 0.0625),
        ("disc", area(disc, false), 4.0 * PI * PI * 0.09),
        ("two-sided disc", area(disc, true), 8.0 * PI * PI * 0.09),
        ("cylinder", area(cylinder, false), 4.0 * PI * cylinder_area),
        ("two-sided cylinder", area(cylinder, true), 8.0 * PI * cylinder_area),
        ("point", point.to_owned(), 4.0 * PI * 4.0),
    ]
}

/// Light from outside.
const DISTANT: [(&str, &str); 2] = [
    (
        "directional",
        "[[lights]]\ntype = \"directional\"\ndirection = [0.4, -1.0, 0.3]\nirradiance = [4.0, 2.0, 1.0]\n",
    ),
    ("environment", "[[lights]]\ntype = \"environment\"\nradiance = [4.0, 2.0, 1.0]\n"),
];

const COLOURS: [f64; 3] = [1.0, 0.5, 0.25];

/// A closed room of 2 m with walls of this reflectance.
fn room(reflectance: &str, light: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 0.0, 0.9]
        at = [0.0, 0.0, 0.0]

        [materials.paint]
        type = "lambert"
        reflectance = {reflectance}

        [[shapes]]
        type = "mesh"
        vertices = [[-1,-1,-1], [1,-1,-1], [1,1,-1], [-1,1,-1], [-1,-1,1], [1,-1,1], [1,1,1], [-1,1,1]]
        faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
        material = "paint"
        {light}
        "#
    );
    Stage::new(&text, (16, 16))
}

/// What one run of the photon pass gives, as fluxes in watts.
struct Run {
    /// Stored photons of all classes, and of those that came from specular surfaces only.
    stored: [f64; 3],
    caustic: [f64; 3],
    emitted: [f64; 3],
    absorbed: [f64; 3],
    escaped: [f64; 3],
}

fn trace(stage: &Stage, kind: MapKind, stored: u64, seed: u64) -> Run {
    // Reached with probability 1e-13 where all reflects 99.9 %.
    let settings =
        TraceSettings { kind, stored, seed, max_depth: 30_000, aimed: true, wavelengths: Default::default() };
    let traced = trace_photons(stage.scene(), &settings, &|_, _| true).unwrap();
    for tally in &traced.tallies {
        assert_balance(tally);
    }
    let count = traced.emitted as f64;
    let sum = |field: fn(&PhotonTally) -> DVec3| {
        let sum: DVec3 = traced.tallies.iter().map(field).sum();
        sum.to_array().map(|flux| stage.watts(flux / count))
    };
    let only = PhotonClasses::only(PhotonClass::Caustic);
    let caustic: DVec3 = traced
        .photons
        .iter()
        .filter(|photon| only.contains(photon.class()))
        .map(|photon| photon.power().as_dvec3())
        .sum();
    let (emitted, absorbed, escaped) =
        (sum(|t| t.power_emitted), sum(|t| t.power_absorbed), sum(|t| t.power_escaped));
    let map = PhotonMap::build(traced.photons, traced.emitted);
    Run {
        stored: map.total_flux().map(|flux| stage.watts(flux)),
        caustic: caustic.to_array().map(|flux| stage.watts(flux / count)),
        emitted,
        absorbed,
        escaped,
    }
}

/// What was emitted is accounted for: 1e-6 is what rounding to `f32` at each bounce leaves.
fn assert_balance(tally: &PhotonTally) {
    let accounted = tally.power_absorbed + tally.power_escaped + tally.power_truncated;
    let off =
        (tally.power_emitted - accounted).abs() / tally.power_emitted.max(DVec3::splat(f64::MIN_POSITIVE));
    assert!(off.max_element() <= 1e-6, "{tally:?}");
    assert_eq!(tally.truncated, 0);
}

/// Mean and standard error of a figure over independent runs.
fn over_seeds(runs: u64, figure: impl Fn(u64) -> [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let values: Vec<[f64; 3]> = (0..runs).map(figure).collect();
    let n = runs as f64;
    let mean: [f64; 3] = std::array::from_fn(|c| values.iter().map(|v| v[c]).sum::<f64>() / n);
    let error = std::array::from_fn(|c| {
        (values.iter().map(|v| (v[c] - mean[c]).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
    });
    (mean, error)
}

/// Fails where `mean` is more than four standard errors and rounding from `want`, or so uncertain that this says little.
#[track_caller]
fn assert_within_noise(what: &str, (mean, error): ([f64; 3], [f64; 3]), want: [f64; 3], certain: f64) {
    for c in 0..3 {
        let (off, noise) = (mean[c] / want[c] - 1.0, error[c] / want[c]);
        println!(
            "{what}, channel {c}: {:.6}, want {:.6}, off {:+.4} % +- {:.4} %",
            mean[c],
            want[c],
            100.0 * off,
            100.0 * noise
        );
        assert!(noise < certain, "{what}: noise of {noise} hides everything");
        assert!(
            off.abs() < 4.0 * noise + 2e-5,
            "{what}, channel {c}: {} +- {}, not {}",
            mean[c],
            error[c],
            want[c]
        );
    }
}

#[test]
fn emitted_flux_is_that_of_the_light() {
    for (name, light, flux) in lights() {
        let stage = room("0.5", &light);
        let want = COLOURS.map(|colour| flux * colour);
        let of_light = stage.scene().lights()[0].flux(stage.scene().bounds().1);
        assert_close(&format!("{name}: flux"), of_light.to_array().map(|f| stage.watts(f)), want, 1e-6);
        let run = trace(&stage, MapKind::Global, 20_000, 0);
        // Directions by the cosine, places by area: each photon has the same power.
        assert_close(&format!("{name}: emitted"), run.emitted, want, 1e-5);
        assert!(
            run.escaped.iter().all(|&e| e <= 1e-5 * want[0]),
            "{name}: {:?} escaped a closed room",
            run.escaped
        );
    }
}

/// Any closed room of uniform reflectance: all light is absorbed in the end, and what arrives at its walls, bounce after
/// bounce, adds up to `Phi / (1 - rho)`.
#[test]
fn stored_flux_of_a_closed_room() {
    for (number, (name, light, flux)) in (1..).zip(lights()) {
        for (reflectance, rho) in [("0.5", [0.5; 3]), ("[0.3, 0.9, 0.6]", [0.3, 0.9, 0.6])] {
            let stage = room(reflectance, &light);
            let want = std::array::from_fn(|c| flux * COLOURS[c] / (1.0 - rho[c]));
            // Roulette is the same for the same seed wherever a photon flies, so each light has seeds of its own.
            let stored =
                over_seeds(8, |seed| trace(&stage, MapKind::Global, 20_000, 100 * number + seed).stored);
            assert_within_noise(&format!("{name}, rho {reflectance}"), stored, want, 0.02);
            let absorbed = trace(&stage, MapKind::Global, 20_000, number).absorbed;
            assert_close(&format!("{name}: absorbed"), absorbed, COLOURS.map(|c| flux * c), 1e-4);
        }
    }
}

#[test]
fn high_albedo_loses_nothing() {
    let (_, light, flux) = lights().pop().unwrap();
    let stage = room("0.999", &light);
    let want = COLOURS.map(|colour| flux * colour / 0.001);
    // 1000 bounces each: few photons, many of them stored.
    let stored = over_seeds(12, |seed| trace(&stage, MapKind::Global, 300_000, seed).stored);
    assert_within_noise("rho 0.999", stored, want, 0.04);
}

/// A convex body under light from outside receives `E` times its shadow, or `pi L` times its surface.
#[test]
fn light_from_outside() {
    for (name, light) in DISTANT {
        let text = format!(
            r#"
            [camera]
            eye = [0.0, 0.0, 9.0]
            at = [0.0, 0.0, 0.0]

            [materials.paint]
            type = "lambert"
            reflectance = 0.5

            [[shapes]]
            type = "sphere"
            center = [7.0, 0.3, -0.2]
            radius = 0.5
            material = "paint"

            [[shapes]]
            name = "far away, to make the scene larger than the ball"
            type = "sphere"
            center = [6.0, 0.3, 8.0]
            radius = 0.1
            material = "paint"
            {light}
            "#
        );
        let stage = Stage::new(&text, (8, 8));
        // The two throw light and shadow on each other, of the order of the solid angle (0.1 / 8)^2.
        let surface = 4.0 * PI * (0.25 + 0.01);
        let full = if name == "environment" { PI * 4.0 * surface } else { 4.0 * surface / 4.0 };
        let stored = over_seeds(12, |seed| trace(&stage, MapKind::Global, 8_000, seed).stored);
        let (mean, error) = stored;
        for c in 0..3 {
            let off = mean[c] / (full * COLOURS[c]) - 1.0;
            let noise = error[c] / mean[c];
            println!("{name}: off {:+.4} % +- {:.4} %", 100.0 * off, 100.0 * noise);
            assert!(noise < 0.01 && off.abs() < 4.0 * noise + 5e-4, "{name}: {mean:?} +- {error:?}");
        }
        let run = trace(&stage, MapKind::Global, 8_000, 3);
        let of_light = stage.scene().lights()[0].flux(stage.scene().bounds().1);
        // Photons start on the boxes around the two things, which fill little of the scene: no more than the light sends through the sphere
        // around all of it, and no less than arrives.
        for c in 0..3 {
            let most = stage.watts(of_light.to_array()[c]);
            assert!(run.emitted[c] < 1.001 * most, "{name}: emitted {:?}, more than {most}", run.emitted);
            assert!(run.emitted[c] > 0.95 * mean[c], "{name}: emitted {:?}, less than {mean:?}", run.emitted);
        }
        if name == "environment" {
            let boxes = 6.0 * (1.0 + 0.2 * 0.2);
            let want = COLOURS.map(|colour| PI * 4.0 * boxes * colour);
            assert_close("environment: emitted", run.emitted, want, 1e-3);
        }
    }
}

/// Glass and mirrors over a grey floor: overlapping cones of aim, an instance, a light inside the sphere around a caster.
fn casters(light: &str, extra: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 1.0, 4.0]
        at = [0.0, 0.0, 0.0]

        [materials.paint]
        type = "lambert"
        reflectance = 0.5

        [materials.glass]
        type = "dielectric"
        ior = 1.5
        absorption = [0.1, 0.5, 1.0]

        [materials.mirror]
        type = "mirror"
        reflectance = [0.9, 0.8, 0.7]

        [[shapes]]
        type = "quad"
        corner = [-2, -0.5, -2]
        edge-u = [0, 0, 4]
        edge-v = [4, 0, 0]
        material = "paint"

        [[shapes]]
        type = "sphere"
        center = [-0.5, -0.1, 0.0]
        radius = 0.35
        material = "glass"

        [[shapes]]
        type = "sphere"
        center = [-0.3, -0.2, 0.6]
        radius = 0.25
        material = "mirror"

        [[shapes]]
        type = "quad"
        corner = [0.8, -0.5, -0.3]
        edge-u = [0.1, 0.0, 0.6]
        edge-v = [0.3, 0.7, 0.0]
        material = "mirror"

        [[shapes]]
        type = "sphere"
        radius = 0.2
        material = "glass"
        group = "pebble"

        [[instances]]
        group = "pebble"
        transform = [{{ scale = [1.5, 0.5, 1.0] }}, {{ translate = [0.4, -0.35, 0.2] }}]
        {extra}
        {light}
        "#
    );
    Stage::new(&text, (16, 16))
}

/// A mirror so large that every light is inside the sphere around it.
const WIDE: &str = r#"
    [[shapes]]
    type = "quad"
    corner = [-2, -0.5, -2]
    edge-u = [4, 0, 0]
    edge-v = [0, 3, 0]
    material = "mirror"
"#;

#[test]
fn flux_does_not_depend_on_where_photons_are_aimed() {
    let all = lights().into_iter().map(|(name, light, _)| (name, light));
    let distant = DISTANT.map(|(name, light)| (name, light.to_owned()));
    for (name, light) in all.chain(distant) {
        for extra in ["", WIDE] {
            let stage = casters(&light, extra);
            let aimed = over_seeds(8, |seed| trace(&stage, MapKind::Caustic, 5_000, seed).stored);
            let everywhere = over_seeds(8, |seed| trace(&stage, MapKind::Global, 20_000, seed).caustic);
            for c in 0..3 {
                let noise = aimed.1[c].hypot(everywhere.1[c]);
                let off = aimed.0[c] - everywhere.0[c];
                println!(
                    "{name}: {:.6} aimed, {:.6} everywhere, off {:+.3} % +- {:.3} %",
                    aimed.0[c],
                    everywhere.0[c],
                    100.0 * off / aimed.0[c],
                    100.0 * noise / aimed.0[c]
                );
                assert!(noise < 0.02 * aimed.0[c], "{name}: noise {noise}");
                assert!(off.abs() < 4.0 * noise, "{name}: {aimed:?} aimed, {everywhere:?} everywhere");
            }
        }
    }
}

#[test]
fn many_lights_share_the_photons() {
    let light = |i: usize| {
        let x = -0.8 + 0.1 * i as f64;
        format!("[[lights]]\ntype = \"point\"\nposition = [{x}, 0.5, 0.0]\npower = {}\n", 1.0 + i as f64)
    };
    let stage = room("0.5", &(0..17).map(light).collect::<String>());
    let settings = TraceSettings {
        kind: MapKind::Global,
        stored: 100_000,
        seed: 1,
        max_depth: 10_000,
        aimed: true,
        wavelengths: Default::default(),
    };
    let traced = trace_photons(stage.scene(), &settings, &|_, _| true).unwrap();
    let count = traced.emitted as f64;
    for (i, tally) in traced.tallies.iter().enumerate() {
        assert_balance(tally);
        let watts = stage.watts(tally.power_emitted.x / count);
        assert!((watts / (1.0 + i as f64) - 1.0).abs() < 1e-5, "light {i}: {watts} W");
        // In proportion to flux, to the rounding of one photon.
        let share = (1.0 + i as f64) / 153.0 * count;
        assert!((tally.emitted as f64 - share).abs() <= 1.0, "light {i}: {} of {share}", tally.emitted);
    }
    assert_eq!(traced.tallies.iter().map(|t| t.emitted).sum::<u64>(), traced.emitted);
    assert_eq!(traced.tallies.iter().map(|t| t.stored).sum::<u64>(), traced.photons.len() as u64);
}

/// The same photons by number: counts beyond what is asked for change no photon, a light that is switched off changes
/// nothing either.
#[test]
fn dark_lights_emit_nothing() {
    let (_, light, flux) = lights().swap_remove(0);
    let dark = "[[lights]]\ntype = \"point\"\nposition = [0.0, 0.0, 0.0]\nintensity = 0.0\n";
    let stage = room("0.5", &format!("{light}{dark}"));
    let run = trace(&stage, MapKind::Global, 20_000, 0);
    assert_close("beside a dark light", run.emitted, COLOURS.map(|c| flux * c), 1e-5);
    let scene: &Scene = stage.scene();
    assert_eq!(scene.lights().len(), 2);
    let nothing = room("0.5", dark);
    let shot = nothing.shoot(&Overrides { spp: Some(2), global_photons: Some(1000), ..photon_map() });
    assert_eq!(shot.mean("beauty"), [0.0; 3]);
}
