//! Paths in media that scatter, against closed forms and tables: single scattering, slabs by adding and doubling, furnaces.

use crate::support::*;
use cardioid::math::{Ray, Rgb};
use cardioid::render::{IntegratorKind, Overrides, Quality, RenderError, Silent, render};
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::transport::{Clearance, Event, next_event_in_media, walk_in_media};
use glam::Vec3;

/// Paths that may collide or meet surfaces so often.
fn paths(spp: u32, max_depth: Option<u32>) -> Overrides {
    Overrides { spp: Some(spp), max_depth, ..path() }
}

/// Mean of the picture against `want`, of which it may be off by 0.3 % and five standard errors.
fn assert_shows(what: &str, text: &str, overrides: &Overrides, want: f64) {
    let shot = Stage::new(text, (16, 16)).shoot(overrides);
    let (mean, error) = (shot.mean("beauty")[1], shot.standard_error("beauty")[1]);
    assert!(error < 0.01 * want, "{what}: the picture is noisy: {mean} +- {error} for {want}");
    assert!((mean - want).abs() < 5.0 * error + 0.003 * want, "{what}: {mean} +- {error} for {want}");
}

/// A camera that looks along -z at one place, from within a fog of 40 x 40 x 40 that ends at a black wall at a distance `end`; a point
/// light of 1 W/sr stands beside the ray, `height` away from it at the distance `foot`.
fn beside_a_ray(medium: &str, (height, foot, end): (f64, f64, f64)) -> String {
    format!(
        r#"
[camera]
eye = [0, 0, 0]
at = [0, 0, -1]
fov = 0.001
[media.fog]
{medium}
[materials.border]
type = "dielectric"
inside = "fog"
[materials.black]
type = "lambert"
reflectance = 0.0
[[shapes]]
type = "box"
min = [-20, -20, -20]
max = [20, 20, 20]
material = "border"
[[shapes]]
type = "disc"
center = [0, 0, {z}]
normal = [0, 0, 1]
radius = 5
material = "black"
[[lights]]
type = "point"
position = [0, {height}, {light}]
power = 12.566370614
"#,
        z = -end,
        light = -foot,
    )
}

/// One scattering of the light of a point light, in closed form but for one integral.
#[test]
fn single_scattering_of_a_point_light() {
    let way = (1.0, 5.0, 10.0);
    let thin = "scattering = 0.1";
    for (medium, way, want) in [
        (thin, way, 0.011_375_223),
        ("scattering = 0.1\ng = 0.7", way, 0.017_003_158),
        ("scattering = 0.1\ng = -0.4", way, 0.011_090_688),
        ("scattering = 1.0", (1.0, 2.0, 4.0), 0.008_921_349_2),
        ("scattering = 0.5\nabsorption = 0.5", (0.25, 2.0, 4.0), 0.043_710_056),
    ] {
        let what = format!("{medium} {way:?}");
        assert_shows(&what, &beside_a_ray(medium, way), &paths(1024, Some(1)), want);
    }
}

/// A slab of optical depth `thickness` that a camera sees from above, over something black; light comes from all directions above.
fn slab(medium: &str, thickness: f64) -> String {
    format!(
        r#"
[camera]
eye = [0, {eye}, 0]
at = [0, 0, 0]
up = [0, 0, 1]
fov = 0.001
[media.slab]
{medium}
[materials.border]
type = "dielectric"
inside = "slab"
[materials.black]
type = "lambert"
reflectance = 0.0
[[shapes]]
type = "box"
min = [-1000, 0, -1000]
max = [1000, {thickness}, 1000]
material = "border"
[[shapes]]
type = "disc"
center = [0, -0.5, 0]
radius = 100000
material = "black"
[[lights]]
type = "environment"
radiance = 1.0
"#,
        eye = thickness + 5.0,
    )
}

/// What a slab reflects of light from everywhere towards its normal is, by reciprocity, what it reflects in all of light along the
/// normal: tables by adding and doubling.
#[test]
fn slabs_reflect_as_tabled() {
    for (medium, thickness, want) in [
        ("scattering = 1.0", 1.0, 0.341_329),
        ("scattering = 1.0", 8.0, 0.821_803),
        ("scattering = 0.9\nabsorption = 0.1", 2.0, 0.361_649),
        ("albedo = 0.9\nmean-free-path = 1.0\ng = 0.75", 2.0, 0.097_395),
        // Between faces of glass, whose first reflection is 0.04.
        ("ior = 1.5\nscattering = 0.9\nabsorption = 0.1", 2.0, 0.213_076 + 0.04),
    ] {
        assert_shows(&format!("{medium}, {thickness}"), &slab(medium, thickness), &paths(192, None), want);
    }
}

/// A slab of marble, in millimetres, over something that emits a radiance of one in all directions.
fn marble(thickness: f64, half_width: f64) -> String {
    let lamp = "material = \"black\"\nemission = { radiance = 1.0 }\n";
    let text = slab("preset = \"marble\"\nior = 1.5", thickness);
    let (text, _) = text.split_once("[[lights]]").unwrap();
    format!("unit = \"mm\"\n{text}")
        .replace("1000", &half_width.to_string())
        .replace("-0.5", "-0.01")
        .replace(
            &format!("radius = {half_width}00\nmaterial = \"black\"\n"),
            &format!("radius = {half_width}\n{lamp}"),
        )
}

/// Share of light along the normal that goes through marble, by channel (coefficients of Jensen et al. 2001; by adding and doubling).
const MARBLE: [(f64, [f64; 3]); 2] =
    [(2.0, [0.356_13, 0.315_53, 0.280_01]), (5.0, [0.190_47, 0.149_49, 0.113_37])];

/// Light behind translucent marble.
#[test]
fn marble_lets_light_pass_as_tabled() {
    for (thickness, want) in MARBLE {
        let shot = Stage::new(&marble(thickness, 100.0), (16, 16)).shoot(&paths(128, None));
        for (channel, want) in want.into_iter().enumerate() {
            let (mean, error) = (shot.mean("beauty")[channel], shot.standard_error("beauty")[channel]);
            println!("{thickness} mm, channel {channel}: {mean} +- {error} for {want}");
            assert!(error < 0.03 * want, "{thickness}: {mean} +- {error} for {want} says little");
            assert!(
                (mean - want).abs() < 5.0 * error + 0.003 * want,
                "{thickness}: {mean} +- {error} for {want}"
            );
        }
    }
}

/// A walk that knows its distance from surfaces meets what every ray would meet, and spares most rays.
#[test]
fn walks_that_trace_few_rays_meet_the_same_events() {
    // A surface of revolution is a mesh; a ball or a box would be user geometry, whose bounds contain the walk.
    let can = "type = \"lathe\"\nsegments = 24\nprofile = [[0, -1], [1, -1], [1, 1], [0, 1]]";
    let text = furnace("ior = 1.5\nscattering = [22, 26, 30]\nabsorption = 0.03")
        .replace("type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1", can);
    let stage = Stage::new(&text, (1, 1));
    let scene = stage.scene();
    let start = scene.bounds().0;
    let medium = scene.medium_at(start);
    let mut rng = Rng::new(1, Stream::Measure, 0);
    let mut clearance = Clearance::default();
    let mut ray = Ray::new(start, Vec3::X);
    let (mut spared, mut surfaces) = (0, 0);
    for _ in 0..100_000 {
        let drawn = (Rgb::new(0.5, 1.0, 0.7), rng.next_f32());
        let (mut one, mut other) = (medium, medium);
        let passage = next_event_in_media(scene, &ray, &mut one, drawn, |_| ());
        let walked = walk_in_media(scene, &ray, &mut other, drawn, &mut clearance, |_| ());
        assert_eq!((one, passage.weight, passage.emitted), (other, walked.weight, walked.emitted));
        let from = match (passage.event, walked.event) {
            (Event::Medium(a), Event::Medium(b)) => {
                assert_eq!((a.t, a.position, a.distance), (b.t, b.position, b.distance));
                spared += u32::from(a.stretch.length != b.stretch.length);
                a.position
            }
            (Event::Surface(a), Event::Surface(b)) => {
                assert_eq!((a.hit.distance, a.hit.surface), (b.hit.distance, b.hit.surface));
                surfaces += 1;
                start
            }
            (a, b) => panic!("{a:?} {b:?}"),
        };
        ray = Ray::new(from, warp::square_to_sphere(rng.next_2d()));
    }
    assert!(spared > 50_000 && surfaces > 20, "{spared} {surfaces}");
}

/// A ball of fog or milk in front of a sky of radiance one.
fn furnace(medium: &str) -> String {
    format!(
        r#"
[camera]
eye = [0, 0, 4]
at = [0, 0, 0]
fov = 20
[media.ball]
{medium}
[materials.border]
type = "dielectric"
inside = "ball"
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
material = "border"
[[lights]]
type = "environment"
radiance = 1.0
"#
    )
}

/// Where nothing is absorbed the radiance of the surroundings is everywhere, whatever scatters; and so it is where what absorbs glows
/// with that radiance.
#[test]
fn furnaces_are_even() {
    for medium in [
        "scattering = 3.0",
        "scattering = [0.1, 1.0, 10.0]\nphase = \"rayleigh\"",
        "scattering = 20.0\ng = 0.9",
        "ior = 1.33\nscattering = 5.0\ng = 0.5",
        "scattering = 1.0\nabsorption = 2.0\nemission = 2.0",
    ] {
        assert_shows(medium, &furnace(medium), &paths(128, None), 1.0);
    }
}

/// Furnaces stay even where numbers are large or small: optical depths from 1e-6 to 1e6, phase functions that are nearly deltas,
/// channels that differ a thousandfold, bodies of a micrometre and of a thousand kilometres, eyes inside.
#[test]
fn furnaces_are_even_at_the_extremes() {
    for medium in [
        "scattering = 1e-6",
        "scattering = 0.0",
        "scattering = 200.0",
        "scattering = 10.0\ng = 0.999",
        "scattering = 10.0\ng = -0.999",
        "scattering = [0.02, 0.4, 20.0]",
        "scattering = 5e5\nabsorption = 5e5\nemission = 5e5",
        "scattering = 1e-6\nabsorption = 1e-6\nemission = 1e-6",
        "ior = 2.4\nscattering = 1.0\ng = 0.9",
    ] {
        // What leaves diamond leaves it rarely, and bright.
        let spp = if medium.starts_with("ior") { 256 } else { 32 };
        assert_shows(medium, &furnace(medium), &paths(spp, None), 1.0);
    }
    // The same body in other units: coefficients are per unit of length of the file.
    for unit in ["unit = 1e-6\n", "unit = 1e6\n"] {
        assert_shows(unit, &(unit.to_owned() + &furnace("scattering = 3.0\ng = 0.5")), &paths(64, None), 1.0);
    }
    let inside = furnace("scattering = 3.0").replace("eye = [0, 0, 4]", "eye = [0, 0, 0.3]");
    assert_shows("eye inside", &inside, &paths(64, None), 1.0);
}

/// A border of matched index is no surface: neither shadow rays nor the camera see it, and what a clear body holds is lit directly.
#[test]
fn the_border_of_a_fog_is_no_surface() {
    let clear = "scattering = 0.0";
    let text = |medium: &str| {
        furnace(medium)
            + "[materials.white]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\n\
               radius = 0.4\nmaterial = \"white\"\n[[lights]]\ntype = \"point\"\nposition = [0, 5, 5]\npower = 1000.0\n"
    };
    let shot = Stage::new(&text(clear), (16, 16)).shoot(&paths(256, None));
    let without = text(clear)
        .replace("material = \"border\"", "material = \"white\"")
        .replace("radius = 1\n", "radius = 0.4\n");
    let bare = Stage::new(&without, (16, 16)).shoot(&paths(256, None));
    for part in ["direct", "indirect", "emission"] {
        let (a, b) = (shot.mean(part)[1], bare.mean(part)[1]);
        assert!((a - b).abs() < 0.02 * b.max(0.1), "{part}: {a} in the body, {b} without it");
    }
    for part in ["specular", "caustics"] {
        assert_eq!(shot.mean(part), [0.0; 3], "{part}");
    }
}

/// A border that emits is a surface, of matched index or not.
#[test]
fn a_border_that_emits_is_seen() {
    let text = |medium: &str| {
        let text = furnace(medium)
            .replace("material = \"border\"", "material = \"border\"\nemission = { radiance = 1.0 }");
        text.replace("[[lights]]\ntype = \"environment\"\nradiance = 1.0\n", "")
    };
    let [fog, clear] = ["scattering = 0.0", "ior = 1.0"]
        .map(|medium| Stage::new(&text(medium), (16, 16)).shoot(&paths(16, None)).mean("beauty")[1]);
    assert!(fog > 0.1 && (fog - clear).abs() < 0.01 * clear, "{fog} in a fog, {clear} without");
}

/// The result of `work` on a pool of its own.
fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// Photon maps with this many photons in media.
fn maps(spp: u32, volume_photons: u64) -> Overrides {
    Overrides {
        quality: Some(Quality::Draft),
        spp: Some(spp),
        volume_photons: Some(volume_photons),
        ..photon_map()
    }
}

/// Mean over seeds of the picture by photon maps against `want`: it may be off by 1 % and four standard errors, and these by 1.2 %.
fn assert_maps_show(what: &str, text: &str, (overrides, seeds): (&Overrides, u64), want: f64) {
    let stage = Stage::new(text, (12, 12));
    let shoot = |seed| stage.shoot(&Overrides { seed: Some(seed), ..overrides.clone() }).mean("beauty")[1];
    let means: Vec<f64> = (0..seeds).map(shoot).collect();
    let n = seeds as f64;
    let mean = means.iter().sum::<f64>() / n;
    let error = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    println!("{what}: {mean} +- {error} for {want}");
    assert!(error < 0.012 * want, "{what}: {mean} +- {error} for {want} says little");
    assert!((mean - want).abs() < 4.0 * error + 0.01 * want, "{what}: {mean} +- {error} for {want}");
}

/// Photons in media show what the tables say: read along rays where kernels are narrow, else after a walk through the medium.
#[test]
fn photons_in_media_show_what_is_tabled() {
    for (medium, thickness, want) in
        [("scattering = 1.0", 1.0, 0.341_329), ("scattering = 0.9\nabsorption = 0.1", 2.0, 0.361_649)]
    {
        let text = slab(medium, thickness).replace("-1000", "-8").replace("1000", "8").replace("800", "30");
        let what = format!("{medium}, {thickness}");
        assert_maps_show(&what, &text, (&maps(32, 60_000), 8), want);
    }
    for (medium, photons) in [
        ("scattering = 3.0", 20_000),
        ("scattering = [0.1, 1.0, 10.0]\nphase = \"rayleigh\"", 80_000),
        ("ior = 1.33\nscattering = 2.0\ng = 0.5", 20_000),
        // Too dense for its photons, and too sharp.
        ("scattering = 20.0", 100_000),
        ("scattering = 10.0\ng = 0.999", 10_000),
    ] {
        assert_maps_show(medium, &furnace(medium), (&maps(8, photons), 8), 1.0);
    }
}

/// Fog and a floor behind a ball of glass, under a lamp so large that paths find it through the ball often enough. The ball itself is not in
/// the picture: light of the lamp in it is rare and bright by paths.
const BALL_IN_FOG: &str = r#"
[camera]
eye = [-8.0, 0.0, 2.6]
at = [0.0, 0.0, 2.6]
fov = 18.0
[media.fog]
scattering = [0.12, 0.1, 0.08]
absorption = 0.01
g = 0.3
[media.glass]
ior = 1.5
priority = 1
[materials.fog]
type = "dielectric"
inside = "fog"
[materials.glass]
type = "dielectric"
inside = "glass"
[materials.floor]
type = "lambert"
reflectance = 0.5
[[shapes]]
type = "box"
min = [-4, -4, -4]
max = [4, 4, 4]
material = "fog"
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
material = "glass"
[[shapes]]
type = "disc"
center = [0, 0, 3.9]
normal = [0, 0, -1]
radius = 3
material = "floor"
[[shapes]]
name = "lamp"
type = "sphere"
center = [0, 0, -2.8]
radius = 1.1
material = "floor"
emission = { radiance = 13.0 }
"#;

/// Mean over seeds of a part of the picture, and its standard error.
fn mean_of_part(shots: &[Shot], part: &str) -> (f64, f64) {
    let means: Vec<f64> = shots.iter().map(|shot| shot.mean(part)[1]).collect();
    let n = means.len() as f64;
    let mean = means.iter().sum::<f64>() / n;
    (mean, (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
}

/// Both modes agree, part by part, on a caustic in fog and on a floor, and on light that fog and floor pass on to each other.
#[test]
fn parts_of_a_ball_in_fog() {
    let stage = Stage::new(BALL_IN_FOG, (24, 24));
    let shoot = |settings: &Overrides, seeds: u64| -> Vec<Shot> {
        (0..seeds).map(|seed| stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() })).collect()
    };
    let by_maps = Overrides {
        global_photons: Some(20_000),
        caustic_photons: Some(20_000),
        volume_beams: Some(2_000),
        ..maps(4, 60_000)
    };
    let (paths, maps) = (shoot(&Overrides { spp: Some(256), ..path() }, 8), shoot(&by_maps, 8));
    for part in ["direct", "caustics", "indirect", "beauty"] {
        let ((a, a_error), (b, b_error)) = (mean_of_part(&paths, part), mean_of_part(&maps, part));
        let noise = a_error.hypot(b_error);
        println!("ball in fog, {part}: path {a} +- {a_error}, photon map {b} +- {b_error}");
        assert!(noise < 0.025 * a, "{part}: noise of {noise} says little of {a}");
        assert!((a - b).abs() < 0.01 * a + 4.0 * noise, "{part}: {a} +- {a_error}, {b} +- {b_error}");
    }
}

/// Rounds narrow the kernels in media as well, and show the same light; no thread changes a bit of it.
#[test]
fn rounds_in_fog_agree_and_repeat() {
    let stage = Stage::new(BALL_IN_FOG, (24, 24));
    let one = Overrides {
        global_photons: Some(10_000),
        caustic_photons: Some(10_000),
        volume_beams: Some(2_000),
        irradiance_cache: Some(true),
        ..maps(8, 10_000)
    };
    let rounds = Overrides {
        integrator: Some(IntegratorKind::Progressive),
        irradiance_cache: None,
        rounds: Some(6),
        spp: Some(4),
        ..one.clone()
    };
    let by_paths = stage.shoot(&Overrides { spp: Some(384), ..path() }).mean("beauty")[1];
    for settings in [one, rounds] {
        let alone = on_threads(1, || stage.shoot(&settings));
        let shot = on_threads(3, || stage.shoot(&settings));
        assert_eq!(shot.layer("beauty"), alone.layer("beauty"));
        let mean = shot.mean("beauty")[1];
        // Photons leave 3.5 % of noise in a single picture and 1.1 % in rounds, paths 0.8 %.
        let bound = if settings.rounds.is_some() { 0.06 } else { 0.16 };
        assert!((mean / by_paths - 1.0).abs() < bound, "{mean}, by paths {by_paths}");
    }
}

/// Photons do not start in media that glow, and say so.
#[test]
fn photons_refuse_media_that_glow() {
    let stage = Stage::new(&furnace("scattering = 1.0\nemission = 0.5"), (4, 4));
    for integrator in [IntegratorKind::PhotonMap, IntegratorKind::Photons, IntegratorKind::Progressive] {
        let request = stage.request(&Overrides { integrator: Some(integrator), ..Overrides::default() });
        let refused = render(stage.scene(), &stage.built.camera, &request, &Silent);
        assert!(matches!(refused, Err(RenderError::Glowing(name)) if name == "ball"), "{integrator:?}");
    }
}
