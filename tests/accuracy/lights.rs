//! Environment maps, sun and sky, spot and measured lights: direct light against closed forms, emitted photons against the
//! flux, and both integrators against each other. Pictures and profiles are made here.

use crate::support::*;
use cardioid::image_io::{Image, Layer, write_exr};
use cardioid::lights::{Cone, Light};
use cardioid::photons::{TraceSettings, trace_photons};
use cardioid::render::{MapKind, Overrides};
use cardioid::sampling::square_to_direction;
use cardioid::scene_file::{build_scene, parse_scene};
use glam::{Vec2, Vec3};
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A picture in longitude and latitude of a function of the direction, in a folder of its own.
fn picture(width: usize, radiance: impl Fn(Vec3) -> [f32; 3]) -> (TempDir, PathBuf) {
    let height = width / 2;
    let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
    let data = (0..width * height)
        .flat_map(|i| radiance(square_to_direction(at(i % width, width), at(i / width, height)).0))
        .collect();
    let mut image = Image::new(width as u32, height as u32);
    image.layers.push(Layer::new("", &["R", "G", "B"], data));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("around.exr");
    write_exr(&path, &image).unwrap();
    (folder, path)
}

fn environment(path: &Path, more: &str) -> String {
    format!("[[lights]]\ntype = \"environment\"\nimage = \"{}\"\n{more}\n", path.display())
}

/// A grey floor of 50 m (so that the horizon is nearly bare), and a camera that sees a spot of it.
fn floor(lights: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [2.0, 0.5, 1.0]
        at = [0.0, 0.0, 0.0]
        fov = 0.05

        [materials.floor]
        type = "lambert"
        reflectance = 0.5

        [[shapes]]
        type = "disc"
        radius = 50.0
        material = "floor"
        {lights}
        "#
    );
    Stage::new(&text, (16, 16))
}

#[track_caller]
fn assert_irradiance(what: &str, lights: &str, want: [f64; 3], tolerance: f64) {
    let stage = floor(lights);
    for (name, settings) in [
        ("path", Overrides { spp: Some(256), ..path() }),
        (
            "photon map",
            Overrides { spp: Some(16), gather_samples: Some(16), global_photons: Some(1000), ..photon_map() },
        ),
    ] {
        let shot = stage.shoot(&settings);
        let irradiance = shot.mean("direct").map(|radiance| radiance * PI / 0.5);
        assert_close(&format!("{what}, {name}"), irradiance, want, tolerance);
    }
}

/// Under `cos^n` around an axis: a level surface below one around the zenith gets `2 pi / (n + 2)`; one at an angle to it,
/// for `n = 1`, the form factor of two cosine lobes, `2/3 (sin a + (pi - a) cos a)`.
#[test]
fn irradiance_of_lobes() {
    let colour = [3.0, 2.0, 1.0];
    for n in [1i32, 8, 24] {
        let (_folder, path) = picture(256, |d| colour.map(|c: f32| c * d.y.max(0.0).powi(n)));
        let want = colour.map(|c| f64::from(c) * 2.0 * PI / f64::from(n + 2));
        assert_irradiance(&format!("cos^{n}"), &environment(&path, ""), want, 0.004);
    }
    for degrees in [30.0f64, 60.0, 90.0] {
        let a = degrees.to_radians();
        let (_folder, path) = picture(256, |d| {
            let axis = Vec3::new(0.0, a.cos() as f32, -a.sin() as f32);
            [2.0 * d.dot(axis).max(0.0); 3]
        });
        let want = 2.0 * 2.0 / 3.0 * (a.sin() + (PI - a) * a.cos());
        // Turned or not is the same for a level surface.
        let more = if degrees == 60.0 { "rotation = 77.0\nscale = 0.5" } else { "" };
        let want = if degrees == 60.0 { 0.5 * want } else { want };
        assert_irradiance(&format!("{degrees} degrees"), &environment(&path, more), grey(want), 0.004);
    }
}

/// A sun of 3 degrees, 20 000 times brighter than the sky, by chance and by its share.
#[test]
fn irradiance_of_a_small_sun() {
    let axis = Vec3::new(0.48, 0.6, 0.64);
    let sun = 3f32.to_radians().cos();
    let radiance = |d: Vec3| if d.dot(axis) > sun { 20_000.0 } else { 1.0 };
    let (_folder, path) = picture(512, |d| [radiance(d); 3]);
    // The bilinear interpolation of the very picture.
    let (mut want, n) = (0.0, 512usize);
    for row in 0..n / 4 {
        for column in 0..n {
            let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
            let (d, sine) = square_to_direction(at(column, n), at(row, n / 2));
            want += f64::from(radiance(d)) * f64::from(d.y) * sine * 2.0 * PI * PI / (n * n / 2) as f64;
        }
    }
    assert_irradiance("small sun", &environment(&path, ""), grey(want), 0.01);
}

/// The disc of the sun of a sky, and its irradiance; the sky adds its own.
#[test]
fn irradiance_of_the_sun() {
    let sky = |sun: bool| {
        format!(
            "[[lights]]\ntype = \"sky\"\nelevation = 40\nazimuth = 20\nturbidity = 2.5\nscale = 0.01\nsun = {sun}\n"
        )
    };
    let stage = floor(&sky(true));
    let lights = stage.scene().lights();
    let [Light::Environment(_), Light::Sun(sun)] = lights else { panic!("{lights:?}") };
    assert!((sun.angular_radius().to_degrees() - 0.2665).abs() < 1e-4);
    let power = stage.scene().space().power;
    let irradiance = sun.radiance.as_dvec3() * f64::from(sun.solid_angle()) / power;
    let by_sun = (irradiance * 40f64.to_radians().sin()).to_array();
    let spot = |sun: bool, settings: &Overrides| {
        floor(&sky(sun)).shoot(settings).mean("direct").map(|radiance| radiance * PI / 0.5)
    };
    for settings in [Overrides { spp: Some(256), ..path() }, Overrides { spp: Some(64), ..photon_map() }] {
        let (with, without) = (spot(true, &settings), spot(false, &settings));
        assert_close("sun", std::array::from_fn(|c| with[c] - without[c]), by_sun, 0.01);
    }
}

fn flux_of_photons(stage: &Stage, aimed: bool) -> [f64; 3] {
    let settings = TraceSettings {
        kind: MapKind::Global,
        stored: 100_000,
        seed: 5,
        max_depth: 100,
        aimed,
        wavelengths: Default::default(),
    };
    let traced = trace_photons(stage.scene(), &settings, &|_, _| true).unwrap();
    let out: glam::DVec3 = traced.tallies.iter().map(|tally| tally.power_emitted).sum();
    (out / traced.emitted as f64).to_array().map(|flux| stage.watts(flux))
}

fn ies(folder: &Path) -> PathBuf {
    let path = folder.join("lamp.ies");
    let angles: Vec<f64> = (0..=36).map(|i| 2.5 * f64::from(i)).collect();
    let mut text =
        format!("IESNA:LM-63-2002\n[TEST] cosine\nTILT=NONE\n1 -1 1 {} 1 1 2 0 0 0\n1 1 1\n", angles.len());
    for angle in &angles {
        write!(text, "{angle} ").unwrap();
    }
    text.push_str("\n0\n");
    for angle in &angles {
        write!(text, "{:.6} ", 1000.0 * angle.to_radians().cos()).unwrap();
    }
    std::fs::write(&path, text).unwrap();
    path
}

/// What leaves as photons is the flux of the light, whether they are aimed or not.
#[test]
fn photons_carry_the_flux() {
    let (_folder, path) = picture(64, |d| {
        if d.dot(Vec3::new(0.6, 0.8, 0.0)) > 0.97 { [900.0, 700.0, 500.0] } else { [0.3, 0.4, 0.6] }
    });
    let folder = tempfile::tempdir().unwrap();
    let profile = ies(folder.path());
    let spot = "[[lights]]\ntype = \"spot\"\nposition = [0.2, 2.0, 0.1]\ndirection = [0.1, -1.0, 0.2]\n\
                intensity = [9.0, 6.0, 3.0]\ninner-angle = 10\nouter-angle = 35\n";
    let measured =
        format!("[[lights]]\ntype = \"ies\"\nposition = [0.0, 2.0, 0.0]\nfile = \"{}\"\n", profile.display());
    for (what, light) in [
        ("environment", environment(&path, "rotation = 30")),
        ("sky", "[[lights]]\ntype = \"sky\"\nelevation = 20\n".to_owned()),
        ("spot", spot.to_owned()),
        ("ies", measured),
    ] {
        let stage = Stage::new(
            &format!(
                "[camera]\neye = [0, 1, 5]\nat = [0, 0, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0.3, 0.4, 0.0]\nradius = 0.4\nmaterial = \"grey\"\n\
                 [[shapes]]\ntype = \"disc\"\nradius = 2.0\nmaterial = \"grey\"\n{light}"
            ),
            (8, 8),
        );
        let scene = stage.scene();
        let flux: glam::DVec3 = scene.lights().iter().map(|light| light.flux(scene.bounds().1)).sum();
        let want = flux.to_array().map(|flux| stage.watts(flux));
        for aimed in [true, false] {
            assert_close(&format!("{what}, aimed: {aimed}"), flux_of_photons(&stage, aimed), want, 0.01);
        }
    }
}

/// Every surface from which light of an environment could come is reached by photons: those stored on a sphere add up to its
/// irradiance, `pi` times its area times the radiance, of a map that is not the same all around.
#[test]
fn photons_of_a_map_land() {
    let (_folder, path) = picture(64, |d| [1.0 + d.x; 3]);
    let text = format!(
        "[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\n[materials.black]\ntype = \"lambert\"\nreflectance = 1e-6\n\
         [[shapes]]\ntype = \"sphere\"\nradius = 0.5\nmaterial = \"black\"\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [4.0, 3.0, 2.0]\nradius = 0.01\nmaterial = \"black\"\n{}",
        environment(&path, "")
    );
    let stage = Stage::new(&text, (8, 8));
    let settings = TraceSettings {
        kind: MapKind::Global,
        stored: 4_000,
        seed: 1,
        max_depth: 10,
        aimed: true,
        wavelengths: Default::default(),
    };
    let traced = trace_photons(stage.scene(), &settings, &|_, _| true).unwrap();
    let on_ball: f64 = traced.photons.iter().map(|photon| f64::from(photon.power().x)).sum();
    let arrived = stage.watts(on_ball / traced.emitted as f64);
    let want = PI * 4.0 * PI * 0.25;
    // As many photons as are stored: 4 standard deviations.
    let tolerance = 4.0 / (traced.photons.len() as f64).sqrt();
    assert!((arrived / want - 1.0).abs() < tolerance, "{arrived} {want} +- {tolerance}");
}

/// A ball of glass in an environment with a small strong sun: paths find the caustic by chance, photons are aimed at it.
#[test]
fn photon_map_and_paths_agree_under_a_map() {
    let axis = Vec3::new(0.5, 0.7, 0.2).normalize();
    let cos = 12f32.to_radians().cos();
    let (_folder, path_of_map) =
        picture(128, |d| if d.dot(axis) > cos { [60.0, 50.0, 40.0] } else { [0.5, 0.6, 0.9] });
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 3.0, 4.0]
        at = [0.0, 0.0, 0.0]
        fov = 35.0

        [materials.floor]
        type = "lambert"
        reflectance = [0.6, 0.5, 0.4]

        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [[shapes]]
        type = "disc"
        radius = 3.0
        material = "floor"

        [[shapes]]
        type = "sphere"
        center = [0.0, 0.55, 0.0]
        radius = 0.5
        material = "glass"
        {}
        "#,
        environment(&path_of_map, "")
    );
    let stage = Stage::new(&text, (32, 32));
    let by_paths = stage.shoot(&Overrides { spp: Some(2048), ..path() });
    let by_photons = stage.shoot(&Overrides {
        spp: Some(64),
        global_photons: Some(100_000),
        caustic_photons: Some(300_000),
        ..photon_map()
    });
    for (part, tolerance) in [("emission", 0.01), ("direct", 0.01), ("specular", 0.02), ("caustics", 0.03)] {
        assert_close(part, by_photons.mean(part), by_paths.mean(part), tolerance);
    }
    // There is hardly any: the floor sees itself in the ball alone.
    let (a, b) = (by_photons.mean("indirect"), by_paths.mean("indirect"));
    let all = by_paths.mean("beauty");
    assert!((0..3).all(|c| (a[c] - b[c]).abs() < 0.004 * all[c]), "{a:?} {b:?}");
}

/// Straight below a spot light, on its ramp, and outside of it; by intensity and by power.
#[test]
fn spot_lights() {
    let spot = |outer: f64, brightness: &str, at: [f64; 3]| {
        format!(
            "[[lights]]\ntype = \"spot\"\nposition = {at:?}\ndirection = [0, -1, 0]\n{brightness}\n\
             inner-angle = 20.0\nouter-angle = {outer:?}\n"
        )
    };
    let colour = [3.0, 2.0, 1.0];
    assert_irradiance(
        "below",
        &spot(40.0, "intensity = [3, 2, 1]", [0.0, 2.0, 0.0]),
        colour.map(|c| c / 4.0),
        1e-4,
    );
    // 30 degrees off: half way, in angle, between both cones.
    let x = 2.0 * 30f64.to_radians().tan();
    let ramp = (30f64.to_radians().cos() - 40f64.to_radians().cos())
        / (20f64.to_radians().cos() - 40f64.to_radians().cos());
    let distance_squared = 4.0 + x * x;
    let factor = ramp * ramp * 30f64.to_radians().cos() / distance_squared;
    let off = spot(40.0, "intensity = [3, 2, 1]", [x, 2.0, 0.0]);
    assert_irradiance("on the ramp", &off, colour.map(|c| c * factor), 1e-3);
    let flux = Cone::new(20f64.to_radians(), 40f64.to_radians()).flux();
    let of_power = spot(40.0, "power = [3, 2, 1]", [0.0, 2.0, 0.0]);
    assert_irradiance("by power", &of_power, colour.map(|c| c / flux / 4.0), 1e-4);
    let dark =
        floor(&spot(25.0, "intensity = 3", [x, 2.0, 0.0])).shoot(&Overrides { spp: Some(4), ..path() });
    assert_eq!(dark.mean("direct"), [0.0; 3]);
}

/// 1000 cd times the cosine, of which a watt is 683 lumens; and scaled to a power: the flux of a cosine is pi.
#[test]
fn measured_lights() {
    let folder = tempfile::tempdir().unwrap();
    let light = |more: &str, x: f64| {
        format!(
            "[[lights]]\ntype = \"ies\"\nposition = [{x:?}, 2.0, 0.0]\nfile = \"{}\"\n{more}\n",
            ies(folder.path()).display()
        )
    };
    assert_irradiance("below", &light("", 0.0), grey(1000.0 / 683.0 / 4.0), 1e-4);
    // 45 degrees off: cosine of the light, of the floor, and twice the squared distance.
    assert_irradiance("off", &light("scale = 2.0", 2.0), grey(2.0 * 1000.0 / 683.0 / 4.0 / 4.0), 1e-3);
    assert_irradiance("power", &light("power = 10.0", 0.0), grey(10.0 / PI / 4.0), 2e-3);
    // Turned over, nothing arrives.
    let up = floor(&light("direction = [0, 1, 0]", 0.0)).shoot(&Overrides { spp: Some(4), ..path() });
    assert_eq!(up.mean("direct"), [0.0; 3]);
}

/// Caustics of spot lights and of the sun: photons aimed at the glass carry what those sent everywhere carry.
#[test]
fn aimed_caustics_of_small_lights() {
    let folder = tempfile::tempdir().unwrap();
    for (what, light) in [
        (
            "spot",
            "[[lights]]\ntype = \"spot\"\nposition = [1.5, 2.0, 0.0]\ndirection = [-1.2, -1.5, 0.1]\nintensity = 5\n\
             inner-angle = 5\nouter-angle = 25\n"
                .to_owned(),
        ),
        ("sky", "[[lights]]\ntype = \"sky\"\nelevation = 50\nscale = 0.01\n".to_owned()),
        (
            "ies",
            format!(
                "[[lights]]\ntype = \"ies\"\nposition = [0.5, 2.0, 0.0]\nfile = \"{}\"\n",
                ies(folder.path()).display()
            ),
        ),
    ] {
        let stage = Stage::new(
            &format!(
                "[camera]\neye = [0, 3, 4]\nat = [0, 0, 0]\n[materials.floor]\ntype = \"lambert\"\nreflectance = 0.5\n\
                 [materials.glass]\ntype = \"dielectric\"\nior = 1.5\n\
                 [[shapes]]\ntype = \"disc\"\nradius = 3.0\nmaterial = \"floor\"\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.6, 0]\nradius = 0.5\nmaterial = \"glass\"\n{light}"
            ),
            (8, 8),
        );
        let stored = |aimed: bool, count: u64| {
            let runs: Vec<f64> = (0..4)
                .map(|seed| {
                    let settings =
                        TraceSettings { kind: MapKind::Caustic, stored: count, seed, max_depth: 100, aimed, wavelengths: Default::default() };
                    let traced = trace_photons(stage.scene(), &settings, &|_, _| true).unwrap();
                    let sum: f64 = traced.photons.iter().map(|photon| f64::from(photon.power().y)).sum();
                    stage.watts(sum / traced.emitted as f64)
                })
                .collect();
            let mean = runs.iter().sum::<f64>() / 4.0;
            let variance = runs.iter().map(|run| (run - mean).powi(2)).sum::<f64>() / 3.0;
            (mean, (variance / 4.0).sqrt())
        };
        let (aimed, everywhere) = (stored(true, 4_000), stored(false, 1_500));
        let noise = aimed.1.hypot(everywhere.1);
        println!("{what}: {aimed:?} aimed, {everywhere:?} everywhere");
        assert!((aimed.0 - everywhere.0).abs() < 4.0 * noise + 1e-4 * aimed.0, "{what}: {aimed:?} {everywhere:?}");
        assert!(noise < 0.05 * aimed.0, "{what}: {noise}");
    }
}

/// The blur of a point-like lamp seen through a lens has the radius of the circle of confusion: lens radius times the
/// distance from the sharp plane over its own, in the plane of the lamp.
#[test]
fn a_lens_blurs_by_the_closed_form() {
    let camera = |lens: &str| {
        format!(
            "[camera]\neye = [0, 0, 4]\nat = [0, 0, 0]\nfov = 20.0\n{lens}\n[materials.black]\ntype = \"lambert\"\n\
             reflectance = 0.0\n[[shapes]]\ntype = \"sphere\"\nradius = 0.03\nmaterial = \"black\"\n\
             emission = {{ radiance = 100.0 }}\n"
        )
    };
    const SIDE: u32 = 96;
    // Root mean square distance from the middle, in metres at the lamp, and flux.
    let blur = |lens: &str| {
        let shot = Stage::new(&camera(lens), (SIDE, SIDE)).shoot(&Overrides { spp: Some(256), ..path() });
        let size = 2.0 * 4.0 * 10f64.to_radians().tan() / f64::from(SIDE);
        let (mut sum, mut squares) = (0.0, 0.0);
        for (index, &value) in shot.layer("emission").iter().step_by(3).enumerate() {
            let pixel = Vec2::new((index as u32 % SIDE) as f32, (index as u32 / SIDE) as f32);
            let off = (pixel + 0.5 - SIDE as f32 / 2.0).as_dvec2() * size;
            sum += f64::from(value);
            squares += f64::from(value) * off.length_squared();
        }
        ((squares / sum).sqrt(), sum)
    };
    let sharp = blur("");
    for (focus, radius) in [(3.0, 0.2), (2.0, 0.1), (8.0, 0.3)] {
        let found = blur(&format!("lens-radius = {radius}\nfocus-distance = {focus:?}"));
        let want = radius * (4.0f64 - focus).abs() / focus / 2f64.sqrt();
        let rms = (found.0 * found.0 - sharp.0 * sharp.0).sqrt();
        assert!((rms / want - 1.0).abs() < 0.03, "focus {focus}: {rms} {want}");
        assert!((found.1 / sharp.1 - 1.0).abs() < 0.05, "{} {}", found.1, sharp.1);
    }
    // 0.4 m over twice f/1: the same lens.
    let by_number = blur("f-number = 1.0\nfocal-length = 0.4\nfocus-distance = 3.0");
    assert!((by_number.0 - blur("lens-radius = 0.2\nfocus-distance = 3.0").0).abs() < 1e-12);
}

/// A lens of no size changes no bit, and one that is in focus everywhere it looks changes the mean little.
#[test]
fn a_picture_through_a_lens() {
    let text = |lens: &str| {
        format!(
            "[camera]\neye = [0, 1, 4]\nat = [0, 0.3, 0]\n{lens}\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.6\n\
             [[shapes]]\ntype = \"disc\"\nradius = 3.0\nmaterial = \"grey\"\n\
             [[shapes]]\ntype = \"box\"\nmin = [-0.5, 0, -0.5]\nmax = [0.5, 1, 0.5]\nmaterial = \"grey\"\n\
             [[lights]]\ntype = \"point\"\nposition = [1, 3, 2]\npower = 100\n"
        )
    };
    let with_cache = Overrides { spp: Some(16), global_photons: Some(20_000), ..Overrides::default() };
    let stage = |lens: &str| Stage::new(&text(lens), (48, 48));
    let pinhole = stage("").shoot(&with_cache);
    let none = stage("lens-radius = 0.0").shoot(&with_cache);
    assert_eq!(pinhole.layer("beauty"), none.layer("beauty"));
    // The cache is filled from the pinhole; what only the rim of the lens sees is gathered there and then.
    let lens = "lens-radius = 0.3\nfocus-distance = 3.5";
    let cached = stage(lens).shoot(&with_cache);
    let gathered = stage(lens).shoot(&Overrides {
        irradiance_cache: Some(false),
        gather_samples: Some(64),
        ..with_cache.clone()
    });
    assert_close("indirect light", cached.mean("indirect"), gathered.mean("indirect"), 0.03);
}

fn build_error(lights: &str) -> String {
    let text = format!(
        "[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"sphere\"\nradius = 1.0\n\
         material = \"grey\"\n{lights}"
    );
    match parse_scene(&text, Path::new("test.toml"), &[]) {
        Err(error) => error.to_string(),
        Ok(description) => build_scene(&description, device(), (8, 8)).unwrap_err().to_string(),
    }
}

#[test]
fn what_is_wrong_with_lights_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let junk = file("junk.hdr", b"no picture at all");
    let cut = file("cut.ies", b"IESNA91\nTILT=NONE\n1 2 3\n");
    let (_dark_folder, dark) = picture(8, |_| [0.0, -1.0, f32::NAN]);
    let ies = |file: &Path| {
        format!("[[lights]]\ntype = \"ies\"\nposition = [0, 2, 0]\nfile = \"{}\"\n", file.display())
    };
    for (lights, what) in [
        (environment(&junk, ""), "junk.hdr"),
        (environment(Path::new("none.hdr"), ""), "there is no file"),
        (environment(&dark, ""), "no pixel of the picture is above zero"),
        (environment(&dark, "radiance = 1.0"), "`radiance`"),
        (ies(&cut), "cut.ies:3: the file ends before"),
        ("[[lights]]\ntype = \"sky\"\n".to_owned(), "where the sun is"),
        ("[[lights]]\ntype = \"sky\"\nelevation = 95\n".to_owned(), "from 0 to 90"),
        ("[[lights]]\ntype = \"sky\"\nsun-direction = [0, -1, 0]\n".to_owned(), "below the horizon"),
        (
            "[[lights]]\ntype = \"sky\"\nelevation = 9\n[[lights]]\ntype = \"environment\"\nradiance = 1\n".to_owned(),
            "second environment",
        ),
        (
            "[[lights]]\ntype = \"spot\"\nposition = [0, 2, 0]\ndirection = [0, -1, 0]\npower = 1\ninner-angle = 50\n"
                .to_owned(),
            "inner angle",
        ),
    ] {
        let error = build_error(&lights);
        assert!(error.contains(what), "{lights}{error}");
    }
    // Some odd pixels are mended, counted and told.
    let (_odd_folder, odd) = picture(8, |d| if d.x > 0.7 { [f32::NAN, 1.0, -1.0] } else { [1.0; 3] });
    let stage = floor(&environment(&odd, ""));
    let warning = stage.built.warnings.iter().map(ToString::to_string).collect::<String>();
    assert!(warning.contains("pixels are negative or no numbers"), "{warning}");
}
