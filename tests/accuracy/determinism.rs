//! The same seed gives the same bits, whatever the threads, the tiles, the window, the unit of length or of power.

use crate::support::*;
use cardioid::film::PixelRect;
use cardioid::render::{GuideKind, IntegratorKind, MapKind, Overrides};

/// Everything the film holds, as bits.
fn bits(shot: &Shot) -> Vec<(&'static str, Vec<u32>)> {
    let of = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect();
    shot.developed.layers.iter().map(|layer| (layer.name, of(&layer.values))).collect()
}

#[track_caller]
fn assert_same_bits(what: &str, a: &Shot, b: &Shot) {
    for ((name, a), (_, b)) in bits(a).iter().zip(&bits(b)) {
        let differing = a.iter().zip(b).filter(|(a, b)| a != b).count();
        assert!(
            a.len() == b.len() && differing == 0,
            "{what}: {differing} of {} values of {name} differ",
            a.len()
        );
    }
}

/// Every integrator, with settings that are quick and leave nothing out.
fn integrators() -> [(&'static str, Overrides); 8] {
    let maps = Overrides {
        spp: Some(3),
        global_photons: Some(20_000),
        caustic_photons: Some(20_000),
        irradiance_cache: Some(true),
        cache_samples: Some(64),
        ..photon_map()
    };
    let gathered = Overrides { irradiance_cache: Some(false), ..maps.clone() };
    [
        ("path", Overrides { spp: Some(5), ..path() }),
        (
            "guided path",
            Overrides {
                spp: Some(5),
                guide: Some(GuideKind::Photons),
                global_photons: Some(20_000),
                ..path()
            },
        ),
        ("guided photon map", Overrides { guide: Some(GuideKind::Photons), ..maps.clone() }),
        ("photon map", maps.clone()),
        (
            "rounds",
            Overrides {
                integrator: Some(IntegratorKind::Progressive),
                rounds: Some(3),
                spp: Some(1),
                irradiance_cache: Some(false),
                ..maps.clone()
            },
        ),
        ("photon map, full estimates", Overrides { precomputed_irradiance: Some(false), ..gathered }),
        ("global photons", Overrides { spp: Some(2), global_photons: Some(20_000), ..show(MapKind::Global) }),
        (
            "caustic photons",
            Overrides { spp: Some(2), caustic_photons: Some(20_000), ..show(MapKind::Caustic) },
        ),
    ]
}

/// All kinds of shapes, materials and lights. Lengths times `scale`, radiance times `power`, all moved by `offset`.
fn mixed(scale: f64, power: f64, offset: f64) -> Stage {
    let at = |p: [f64; 3]| format!("{:?}", p.map(|x| (x + offset) * scale));
    let along = |v: [f64; 3]| format!("{:?}", v.map(|x| x * scale));
    let len = |x: f64| format!("{:?}", x * scale);
    let light = |rgb: [f64; 3]| format!("{:?}", rgb.map(|x| x * power));
    let intensity = |rgb: [f64; 3]| format!("{:?}", rgb.map(|x| x * power * scale * scale));
    let absorption = format!("{:?}", [0.7, 0.2, 1.5].map(|x| x / scale));
    let text = format!(
        r#"
        [camera]
        eye = {eye}
        at = {target}
        fov = 50.0

        [materials.clay]
        type = "lambert"
        reflectance = [0.7, 0.5, 0.4]

        [materials.metal]
        type = "mirror"
        reflectance = [0.9, 0.8, 0.6]

        [materials.glass]
        type = "dielectric"
        ior = 1.5
        absorption = {absorption}

        [[shapes]]
        type = "quad"
        corner = {corner}
        edge-u = {edge_u}
        edge-v = {edge_v}
        material = "clay"

        [[shapes]]
        type = "sphere"
        center = {ball}
        radius = {ball_radius}
        material = "glass"

        [[shapes]]
        type = "cylinder"
        base = {base}
        top = {top}
        radius = {ring}
        material = "metal"

        [[shapes]]
        type = "mesh"
        vertices = [{a}, {b}, {c}, {d}]
        faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
        normals = "smooth"
        material = "clay"

        [[shapes]]
        type = "sphere"
        center = {lamp}
        radius = {lamp_radius}
        material = "clay"
        emission = {{ radiance = {lamp_radiance} }}

        [[shapes]]
        type = "quad"
        corner = {panel}
        edge-u = {panel_u}
        edge-v = {panel_v}
        material = "clay"
        emission = {{ radiance = {panel_radiance}, two-sided = true }}

        [[lights]]
        type = "point"
        position = {bulb}
        intensity = {bulb_intensity}

        [[lights]]
        type = "directional"
        direction = [0.3, -1.0, 0.2]
        irradiance = {sun}

        [[lights]]
        type = "environment"
        radiance = {sky}
        "#,
        eye = at([0.3, 1.1, 2.7]),
        target = at([0.0, 0.2, 0.0]),
        corner = at([-1.3, 0.0, -1.3]),
        edge_u = along([0.0, 0.0, 2.6]),
        edge_v = along([2.6, 0.0, 0.0]),
        ball = at([-0.4, 0.35, 0.3]),
        ball_radius = len(0.3),
        base = at([0.5, 0.001, 0.2]),
        top = at([0.5, 0.3, 0.2]),
        ring = len(0.4),
        a = at([0.1, 0.05, -0.8]),
        b = at([0.7, 0.05, -0.7]),
        c = at([0.4, 0.05, -0.3]),
        d = at([0.4, 0.6, -0.6]),
        lamp = at([-0.7, 1.3, -0.4]),
        lamp_radius = len(0.1),
        lamp_radiance = light([12.0, 10.0, 8.0]),
        panel = at([0.4, 1.2, -0.9]),
        panel_u = along([0.3, 0.0, 0.0]),
        panel_v = along([0.0, 0.2, 0.1]),
        panel_radiance = light([3.0, 4.0, 5.0]),
        bulb = at([0.9, 0.9, 0.9]),
        bulb_intensity = intensity([0.5, 0.6, 0.4]),
        sun = light([0.7, 0.6, 0.5]),
        sky = light([0.1, 0.15, 0.3]),
    );
    Stage::new(&text, (40, 36))
}

#[test]
fn threads_change_no_bit() {
    for stage in [Stage::load("cornell-spheres", (40, 40)), mixed(1.0, 1.0, 0.0)] {
        for (name, settings) in integrators() {
            let shoot = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| stage.shoot(&settings))
            };
            let one = shoot(1);
            assert!(one.mean("beauty")[0] > 0.0, "{name} is black");
            assert_eq!(one.statistics.threads, 1);
            for threads in [2, 5] {
                let other = shoot(threads);
                assert_same_bits(&format!("{name}, {threads} threads"), &one, &other);
                assert_eq!(one.statistics.counters, other.statistics.counters);
            }
        }
    }
}

#[test]
fn windows_show_the_same_pixels() {
    for stage in [Stage::load("cornell-spheres", (40, 40)), mixed(1.0, 1.0, 0.0)] {
        for (name, settings) in integrators() {
            let whole = stage.shoot(&settings);
            for crop in [
                PixelRect { x0: 5, y0: 3, x1: 29, y1: 34 },
                PixelRect { x0: 16, y0: 16, x1: 32, y1: 32 },
                PixelRect { x0: 39, y0: 35, x1: 40, y1: 36 },
            ] {
                let part = stage.crop(&settings, crop);
                for layer in &part.developed.layers {
                    let all = whole.developed.layer(layer.name).unwrap();
                    let channels = layer.channels.len();
                    for (i, (x, y)) in crop.pixels().enumerate() {
                        let j = (y * stage.size.0 + x) as usize;
                        let pixel = |values: &[f32], i: usize| {
                            values[i * channels..][..channels].iter().map(|v| v.to_bits()).collect::<Vec<_>>()
                        };
                        let (a, b) = (pixel(&layer.values, i), pixel(&all.values, j));
                        assert_eq!(a, b, "{name}, {} at {x}, {y}", layer.name);
                    }
                }
            }
        }
    }
}

#[test]
fn runs_repeat_and_seeds_differ() {
    let stage = mixed(1.0, 1.0, 0.0);
    for (name, settings) in integrators() {
        let first = stage.shoot(&settings);
        assert_same_bits(name, &first, &mixed(1.0, 1.0, 0.0).shoot(&settings));
        let other = stage.shoot(&Overrides { seed: Some(1), ..settings });
        // Where there is a surface that scatters: the sky is the same for every seed, also in a mirror.
        let scattered =
            |i: usize| ["direct", "caustics", "indirect"].iter().any(|part| first.layer(part)[i] > 0.0);
        let (mut lit, mut same) = (0, 0);
        for (i, (a, b)) in first.layer("beauty").iter().zip(other.layer("beauty")).enumerate() {
            lit += u32::from(scattered(i));
            same += u32::from(scattered(i) && a == b);
        }
        assert!(lit > 100, "{name}");
        assert!(
            f64::from(same) < 0.02 * f64::from(lit),
            "{name}: {same} of {lit} values do not depend on the seed"
        );
    }
}

/// All layers but depth, which is in metres, have the same bits; depth is scaled exactly.
#[track_caller]
fn assert_scaled(what: &str, one: &Shot, other: &Shot, scale: f64) {
    for (a, b) in one.developed.layers.iter().zip(&other.developed.layers) {
        let factor = if a.name == "depth" { scale as f32 } else { 1.0 };
        let differing = a.values.iter().zip(&b.values).filter(|(a, b)| **a * factor != **b).count();
        assert_eq!(differing, 0, "{what}: values of {} that differ", a.name);
    }
}

#[test]
fn powers_of_two_in_length_change_no_bit() {
    let one = mixed(1.0, 1.0, 0.0);
    for k in [-10, 10] {
        let s = 2f64.powi(k);
        let other = mixed(s, 1.0, 0.0);
        for (name, settings) in integrators() {
            assert_scaled(&format!("{name}, 2^{k}"), &one.shoot(&settings), &other.shoot(&settings), s);
        }
    }
    // By the unit of the file. Light on surfaces keeps its radiance.
    let text = std::fs::read_to_string(scene_path("cornell-spheres")).unwrap();
    let one = Stage::new(&text, (40, 40));
    for k in [-10, 10] {
        let s = 2f64.powi(k);
        let other = text.replace("unit = \"mm\"", &format!("unit = {:?}", 0.001 * s));
        assert_ne!(text, other);
        let other = Stage::new(&other, (40, 40));
        for (name, settings) in integrators() {
            assert_scaled(&format!("{name}, unit 2^{k}"), &one.shoot(&settings), &other.shoot(&settings), s);
        }
    }
}

#[test]
fn powers_of_two_in_power_scale_the_picture() {
    let one = mixed(1.0, 1.0, 0.0);
    for k in [-40, 13, 60] {
        let factor = 2f32.powi(k);
        let other = mixed(1.0, 2f64.powi(k), 0.0);
        for (name, settings) in integrators() {
            let (a, b) = (one.shoot(&settings), other.shoot(&settings));
            for part in PARTS {
                let differing =
                    a.layer(part).iter().zip(b.layer(part)).filter(|(a, b)| **a * factor != **b).count();
                assert_eq!(differing, 0, "{name}, power 2^{k}: values of {part} that differ");
            }
        }
    }
}

/// `mean((a - b)^2 / (mean^2 + 0.01))`, of the picture.
fn difference(a: &Shot, b: &Shot) -> f64 {
    let pairs = a.layer("beauty").iter().zip(b.layer("beauty"));
    let sum: f64 = pairs
        .map(|(&a, &b)| {
            let (a, b) = (f64::from(a), f64::from(b));
            (a - b).powi(2) / ((0.5 * (a + b)).powi(2) + 0.01)
        })
        .sum();
    sum / a.layer("beauty").len() as f64
}

/// What is no power of two rounds differently, and the picture stays the same but for noise: at most what another seed
/// changes.
#[test]
fn other_scales_and_places_stay_within_noise() {
    let one = mixed(1.0, 1.0, 0.0);
    for (name, settings) in integrators() {
        let first = one.shoot(&settings);
        let noise = difference(&first, &one.shoot(&Overrides { seed: Some(7), ..settings.clone() }));
        for (what, other) in [
            ("times 3.7", mixed(3.7, 1.0, 0.0)),
            ("times 1e-6", mixed(1e-6, 1.0, 0.0)),
            ("times 1e6", mixed(1e6, 1.0, 0.0)),
            ("moved by 1e5 times its size", mixed(1.0, 1.0, 1e5)),
            ("moved by 1e3 times its size, times 1e-4", mixed(1e-4, 1.0, 1e3)),
        ] {
            let shot = other.shoot(&settings);
            let off = difference(&first, &shot);
            println!("{name}, {what}: {off:.6}, another seed {noise:.6}");
            assert!(off < noise, "{name}, {what}: {off}, another seed {noise}");
            assert_eq!(shot.statistics.rejected_samples, 0);
        }
    }
}
