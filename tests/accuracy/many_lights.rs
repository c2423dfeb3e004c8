//! Many lights: drawn by what they may contribute, against the plain loop over all of them and closed forms; photons shared
//! out by what the camera sees.

use crate::support::*;
use cardioid::lights::{Light, Receiver};
use cardioid::render::{Overrides, photon_budget};
use cardioid::sampling::{Rng, Stream};
use glam::{Vec2, Vec3};
use std::f64::consts::PI;
use std::fmt::Write;

const COUNT: usize = 48;

/// A floor, a wall that casts shadows, and lights of all kinds around, of which those of `shining` shine.
fn hall(shining: std::ops::Range<usize>) -> Stage {
    let mut text = String::from(
        "[camera]\neye = [0, 3, 6]\nat = [0, 0.5, 0]\nfov = 45\n\
         [materials.grey]\ntype = \"lambert\"\nreflectance = 0.6\n[materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-4, 0, 4]\nedge-u = [8, 0, 0]\nedge-v = [0, 0, -8]\nmaterial = \"grey\"\n\
         [[shapes]]\ntype = \"box\"\nmin = [-0.2, 0, -2]\nmax = [0.2, 1.5, 1]\nmaterial = \"grey\"\n",
    );
    let mut rng = Rng::new(21, Stream::Measure, 0);
    for i in 0..COUNT {
        let mut number = |low: f32, high: f32| low + (high - low) * rng.next_f32();
        let at = [number(-4.0, 4.0), number(0.3, 2.5), number(-4.0, 4.0)];
        // The same numbers whichever shine.
        let shine = 0.2 + 30.0 * number(0.0, 1.0).powi(6);
        let [u, v] = [number(-1.0, 1.0), number(-1.0, 1.0)];
        let bright = if shining.contains(&i) { shine } else { 0.0 };
        let [x, y, z] = at;
        let surface = format!("material = \"black\"\nemission = {{ radiance = {bright:?} }}\n");
        let surface = if bright > 0.0 { surface } else { "material = \"black\"\n".to_owned() };
        match i % 4 {
            0 => write!(text, "[[shapes]]\ntype = \"sphere\"\ncenter = {at:?}\nradius = 0.08\n{surface}"),
            1 => write!(
                text,
                "[[shapes]]\ntype = \"quad\"\ncorner = {at:?}\nedge-u = [{:?}, 0.02, 0]\nedge-v = [0, {:?}, 0.3]\n{surface}",
                0.1 + 0.01 * i as f32,
                0.3 * u,
            ),
            2 if bright > 0.0 => {
                write!(text, "[[lights]]\ntype = \"point\"\nposition = [{x}, {y}, {z}]\nintensity = {:?}\n", 0.05 * bright)
            }
            3 if bright > 0.0 => write!(
                text,
                "[[lights]]\ntype = \"spot\"\nposition = [{x}, {y}, {z}]\ndirection = [{:?}, -1, {:?}]\nintensity = {:?}\n",
                u,
                v,
                0.2 * bright
            ),
            _ => Ok(()),
        }
        .unwrap();
    }
    Stage::new(&text, (24, 24))
}

/// Mean over seeds and its standard error, first channel.
fn mean(stage: &Stage, seeds: u64, layer: &str, settings: &Overrides) -> (f64, f64) {
    let runs: Vec<f64> = (0..seeds)
        .map(|seed| stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() }).mean(layer)[0])
        .collect();
    let mean = runs.iter().sum::<f64>() / seeds as f64;
    let variance = runs.iter().map(|run| (run - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64;
    (mean, (variance / seeds as f64).sqrt())
}

/// Direct light of 48 lights with a tree is that of six times eight, each sampled by itself: 4 standard errors.
#[test]
fn the_tree_agrees_with_the_plain_loop() {
    let all = hall(0..COUNT);
    assert!(all.scene().light_choice().each().is_empty() && all.scene().light_choice().groups().len() == 1);
    // Long enough for rays that hit lights by chance, which have their share of direct light.
    let settings = Overrides { spp: Some(64), max_depth: Some(3), ..path() };
    let tree = mean(&all, 8, "direct", &settings);
    let (mut sum, mut variance) = (0.0, 0.0);
    for part in 0..COUNT / 8 {
        let stage = hall(8 * part..8 * part + 8);
        assert_eq!(stage.scene().light_choice().groups().len(), 0);
        let (value, error) = mean(&stage, 4, "direct", &Overrides { spp: Some(32), ..settings.clone() });
        sum += value;
        variance += error * error;
    }
    let noise = tree.1.hypot(variance.sqrt());
    println!("{} +- {} by the tree, {sum} +- {} one by one", tree.0, tree.1, variance.sqrt());
    assert!(
        (tree.0 - sum).abs() < 4.0 * noise && noise < 0.01 * sum,
        "{tree:?} {sum} +- {}",
        variance.sqrt()
    );
    // Photon mode weighs by the same densities.
    let by_photons = mean(
        &all,
        4,
        "direct",
        &Overrides { spp: Some(32), gather_samples: Some(4), global_photons: Some(10_000), ..photon_map() },
    );
    let noise = by_photons.1.hypot(tree.1);
    assert!((by_photons.0 - tree.0).abs() < 4.0 * noise.max(2e-3 * sum), "{by_photons:?} {tree:?}");
}

/// At a place, the mean over draws of what a drawn light sends over its probability is the sum over all lights.
#[test]
fn one_light_stands_for_all() {
    let stage = hall(0..COUNT);
    let scene = stage.scene();
    let mut rng = Rng::new(22, Stream::Measure, 0);
    for position in [Vec3::new(0.1, -0.2, 0.3), Vec3::new(-0.5, 0.1, 0.4), Vec3::ZERO] {
        let at = Receiver { position, normal: Vec3::Y };
        let sent = |light: &Light, u: Vec2| {
            light.sample_li(at, u).map_or(0.0, |sample| {
                f64::from(sample.radiance_over_pdf.x) * f64::from(sample.wi.dot(at.normal)).max(0.0)
            })
        };
        let n = 40_000;
        let mut plain = 0.0;
        for light in scene.lights() {
            plain += (0..n / 20).map(|_| sent(light, rng.next_2d())).sum::<f64>() / f64::from(n / 20);
        }
        let group = &scene.light_choice().groups()[0];
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let drawn = group.sample(&at, f64::from(rng.next_f32()));
            let value = drawn.map_or(0.0, |(light, probability)| {
                assert_eq!(probability, scene.light_choice().probability(&at, light));
                sent(&scene.lights()[light as usize], rng.next_2d()) / f64::from(probability)
            });
            sum += value;
            squares += value * value;
        }
        let n = f64::from(n);
        let error = ((squares / n - (sum / n).powi(2)) / n).sqrt();
        println!("{} +- {error} drawn, {plain} in all", sum / n);
        assert!((sum / n - plain).abs() < 4.0 * error + 0.003 * plain, "{} +- {error} {plain}", sum / n);
        // Little noise below the lights; above most of them, few of those that are drawn send anything.
        let most = if position.y < 0.0 { 1.5 } else { 10.0 };
        assert!(error * n.sqrt() < most * plain, "{error} {plain}");
    }
}

/// A unit square of thousands of triangles lights the spot below its centre as the square itself does.
#[test]
fn an_emitter_of_many_triangles() {
    const SIDE: usize = 40;
    let (mut vertices, mut faces) = (String::new(), String::new());
    for i in 0..=SIDE {
        for j in 0..=SIDE {
            let at = |k: usize| k as f64 / SIDE as f64 - 0.5;
            write!(vertices, "[{:?}, 1.0, {:?}],", at(i), at(j)).unwrap();
        }
    }
    for i in 0..SIDE {
        for j in 0..SIDE {
            let corner = i * (SIDE + 1) + j;
            write!(faces, "[{}, {}, {}, {}],", corner, corner + SIDE + 1, corner + SIDE + 2, corner + 1)
                .unwrap();
        }
    }
    let text = format!(
        "[camera]\neye = [2.0, 0.5, 1.0]\nat = [0, 0, 0]\nfov = 0.05\n\
         [materials.floor]\ntype = \"lambert\"\nreflectance = 0.5\n[materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-3, 0, -3]\nedge-u = [0, 0, 6]\nedge-v = [6, 0, 0]\nmaterial = \"floor\"\n\
         [[shapes]]\ntype = \"mesh\"\nvertices = [{vertices}]\nfaces = [{faces}]\nmaterial = \"black\"\n\
         emission = {{ radiance = [3.0, 2.0, 1.0] }}\n"
    );
    let stage = Stage::new(&text, (16, 16));
    for settings in [Overrides { spp: Some(128), ..path() }, Overrides { spp: Some(32), ..photon_map() }] {
        let irradiance = stage.shoot(&settings).mean("direct").map(|radiance| radiance * PI / 0.5);
        let want = [3.0, 2.0, 1.0].map(|radiance| radiance * PI * 0.239_456_5);
        assert_close("mesh of 3200 triangles", irradiance, want, 0.01);
    }
}

/// Forty lights in a room that the camera does not see, one in the room that it does: the one gets most of the photons, each
/// of the others some, and indirect light is that of path tracing.
#[test]
fn photons_go_where_the_camera_sees_their_light() {
    let mut text = String::from(
        "[camera]\neye = [-2, 1, 1.9]\nat = [-2, 0.9, -2]\nfov = 60\n\
         [materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
         [[shapes]]\ntype = \"box\"\nmin = [-4, 0, -2]\nmax = [4, 2, 2]\nmaterial = \"grey\"\n\
         [[shapes]]\ntype = \"box\"\nmin = [-0.1, 0, -2]\nmax = [0.1, 2, 2]\nmaterial = \"grey\"\n\
         [[lights]]\nname = \"seen\"\ntype = \"point\"\nposition = [-2, 1.5, 0]\nintensity = 1\n",
    );
    for i in 0..40 {
        write!(
            text,
            "[[lights]]\ntype = \"point\"\nposition = [{:?}, 1.0, {:?}]\nintensity = 1\n",
            0.5 + 0.08 * f64::from(i),
            f64::from(i % 7) * 0.4 - 1.2
        )
        .unwrap();
    }
    let stage = Stage::new(&text, (24, 24));
    let settings =
        Overrides { spp: Some(32), global_photons: Some(40_000), gather_samples: Some(16), ..photon_map() };
    let shot = stage.shoot(&settings);
    let lights = &shot.statistics.maps[0].lights;
    let all: u64 = lights.iter().map(|light| light.emitted).sum();
    let seen = lights[0].emitted as f64 / all as f64;
    assert!(seen > 0.75 && lights.iter().all(|light| light.emitted > 10), "{seen}");
    for (light, flux) in lights.iter().map(|light| (light.light, light.flux_emitted[0])) {
        assert!((flux / (4.0 * PI) - 1.0).abs() < 1e-3, "light {light} emits {flux} W");
    }
    let by_paths = stage.shoot(&Overrides { spp: Some(256), ..path() });
    assert_close("indirect", shot.mean("indirect"), by_paths.mean("indirect"), 0.03);
}

/// A room that is lit by a lamp, in the sun, on wide ground, with a glass ball in it; or without the sun.
fn room_in_the_sun(sun: Option<f64>) -> Stage {
    let sun = sun.map_or(String::new(), |sun| {
        format!("[[lights]]\nname = \"sun\"\ntype = \"directional\"\ndirection = [0.3, -1, 0.2]\nirradiance = {sun:e}\n")
    });
    let text = format!(
        "[camera]\neye = [0, 1.2, 1.9]\nat = [0, 0.5, 0]\nfov = 60\n[materials.white]\ntype = \"lambert\"\nreflectance = 0.6\n\
         [materials.glass]\ntype = \"dielectric\"\nior = 1.5\n\
         [[shapes]]\nname = \"walls\"\ntype = \"box\"\nmin = [-2, 0, -2]\nmax = [2, 2.5, 2]\nmaterial = \"white\"\n\
         [[shapes]]\nname = \"ground\"\ntype = \"disc\"\ncenter = [0, -0.1, 0]\nradius = 50\nmaterial = \"white\"\n\
         [[shapes]]\nname = \"ball\"\ntype = \"sphere\"\ncenter = [0, 0.4, 0]\nradius = 0.3\nmaterial = \"glass\"\n\
         [[lights]]\nname = \"lamp\"\ntype = \"point\"\nposition = [0.5, 2, 0.5]\npower = 10.0\n{sun}"
    );
    Stage::new(&text, (24, 18))
}

/// Photons of the global and the caustic map that are stored from the lamp, of all.
fn share_of_lamp(shot: &Shot) -> Vec<f64> {
    let of_map = |map: &cardioid::render::MapStatistics| {
        let stored: u64 = map.lights.iter().map(|light| light.stored).sum();
        map.lights[0].stored as f64 / stored as f64
    };
    shot.statistics.maps.iter().map(of_map).collect()
}

/// However strong the sun outside, the lamp has most of the photons of a picture that shows the room alone, and the caustics of its
/// light keep their brightness.
#[test]
fn the_sun_outside_takes_no_photons_from_the_lamp() {
    let settings = |of: Overrides| Overrides {
        spp: Some(2),
        global_photons: Some(20_000),
        caustic_photons: Some(20_000),
        gather_samples: Some(4),
        ..of
    };
    let rounds = Overrides {
        integrator: Some(cardioid::render::IntegratorKind::Progressive),
        rounds: Some(1),
        irradiance_cache: Some(false),
        ..Overrides::default()
    };
    let alone = room_in_the_sun(None).shoot(&settings(photon_map())).mean("caustics");
    for sun in [1e0, 1e2, 1e4, 1e5] {
        let stage = room_in_the_sun(Some(sun));
        for (name, of) in [("photon map", photon_map()), ("rounds", rounds.clone())] {
            let shot = stage.shoot(&settings(of));
            let shares = share_of_lamp(&shot);
            println!("{name}, sun of {sun:e}: {shares:?}");
            assert!(
                shares.len() == 2 && shares.iter().all(|&share| share > 0.7),
                "{name}, {sun:e}: {shares:?}"
            );
            assert_close(&format!("{name}, {sun:e}"), shot.mean("caustics"), alone, 0.05);
        }
    }
    // A lamp that lights all that the sun lights shares by flux, and its picture keeps its bits.
    let plain = "[[lights]]\ntype = \"point\"\nposition = [0, 3, 0]\npower = 90\n\
                 [[lights]]\ntype = \"point\"\nposition = [1, 3, 0]\npower = 60\n";
    let text = format!(
        "[camera]\neye = [0, 3, 6]\nat = [0, 0, 0]\n[materials.white]\ntype = \"lambert\"\nreflectance = 0.6\n\
         [[shapes]]\ntype = \"disc\"\nradius = 4\nmaterial = \"white\"\n[[shapes]]\ntype = \"box\"\nmin = [-1, 0, -1]\n\
         max = [1, 1, 1]\nmaterial = \"white\"\n{plain}"
    );
    let stage = Stage::new(&text, (8, 8));
    let settings = stage.settings(&photon_map());
    let plan = settings.plan(stage.scene());
    assert!(plan.photon_budget.build);
    assert_eq!(photon_budget(stage.scene(), &stage.built.camera, &plan, &settings), None);
}
