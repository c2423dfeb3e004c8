//! The ends of every scale: a finite picture, in time, and a warning that says what is wrong.

use crate::support::*;
use cardioid::photons::Kernel;
use cardioid::render::{MapKind, Overrides};
use cardioid::scene_file::parse_scene;
use std::path::Path;
use std::time::Instant;

/// A closed room with a lamp, a glass ball and a mirror.
fn room(reflectance: &str, radiance: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 0.0, 0.95]
        at = [0.0, -0.2, 0.0]
        fov = 70.0

        [materials.paint]
        type = "lambert"
        reflectance = {reflectance}

        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [materials.mirror]
        type = "mirror"

        [[shapes]]
        type = "mesh"
        vertices = [[-1,-1,-1], [1,-1,-1], [1,1,-1], [-1,1,-1], [-1,-1,1], [1,-1,1], [1,1,1], [-1,1,1]]
        faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
        material = "paint"

        [[shapes]]
        type = "sphere"
        center = [-0.3, -0.6, 0.2]
        radius = 0.3
        material = "glass"

        [[shapes]]
        type = "sphere"
        center = [0.4, -0.6, -0.2]
        radius = 0.3
        material = "mirror"

        [[shapes]]
        type = "quad"
        corner = [-0.2, 0.9, -0.2]
        edge-u = [0.4, 0, 0]
        edge-v = [0, 0, 0.4]
        material = "paint"
        emission = {{ radiance = {radiance} }}
        "#
    );
    Stage::new(&text, (20, 20))
}

fn quick(integrator: &Overrides) -> Overrides {
    Overrides { spp: Some(4), global_photons: Some(5000), caustic_photons: Some(5000), ..integrator.clone() }
}

fn all() -> [(&'static str, Overrides); 4] {
    [
        ("path", quick(&PATH)),
        ("photon map", quick(&PHOTON_MAP)),
        ("global photons", quick(&show(MapKind::Global))),
        ("caustic photons", quick(&show(MapKind::Caustic))),
    ]
}

#[test]
fn power_from_1e_minus_30_to_1e30() {
    let one = room("0.7", "[10.0, 9.0, 8.0]");
    for power in [1e-30, 1e-12, 1e12, 1e30] {
        let other = room("0.7", &format!("{:?}", [10.0, 9.0, 8.0].map(|x| x * power)));
        for (name, settings) in all() {
            let (a, b) = (one.shoot(&settings), other.shoot(&settings));
            let want = a.mean("beauty").map(|x| x * power);
            assert_close(&format!("{name}, power {power:e}"), b.mean("beauty"), want, 1e-3);
            assert_eq!((b.developed.clamped, b.statistics.rejected_samples), (0, 0));
        }
    }
    // Beyond what f32 holds, pixels are cut and counted; below, they are black.
    for (name, settings) in all() {
        let shot = room("0.7", "1e45").shoot(&settings);
        assert!(shot.developed.clamped > 0, "{name}");
        assert_eq!(shot.statistics.rejected_samples, 0, "{name}");
        let shot = room("0.7", "1e-60").shoot(&settings);
        assert_eq!((shot.mean("beauty"), shot.statistics.rejected_samples), ([0.0; 3], 0), "{name}");
    }
}

#[test]
fn reflectance_up_to_one() {
    for (reflectance, loses) in [("0.99", false), ("0.999999", true), ("1.0", true)] {
        let stage = room(reflectance, "1.0");
        for (name, settings) in all() {
            let start = Instant::now();
            // A limit that light does not reach at 0.99, and does at 0.999999.
            let settings = Overrides { spp: Some(1), max_depth: Some(4000), ..settings };
            let shot = stage.shoot(&settings);
            let seconds = start.elapsed().as_secs_f64();
            println!("{name}, reflectance {reflectance}: {seconds:.1} s, {:?}", shot.statistics.warnings);
            assert!(seconds < 60.0, "{name}, reflectance {reflectance}: {seconds} s");
            if name != "caustic photons" {
                assert_eq!(
                    shot.warns("cut off"),
                    loses,
                    "{name}, {reflectance}: {:?}",
                    shot.statistics.warnings
                );
            }
        }
    }
}

#[test]
fn few_photons_and_none() {
    let stage = room("0.7", "1.0");
    let path = stage.shoot(&Overrides { spp: Some(16), ..PATH }).mean("direct");
    for photons in [0, 1, 2, 10, 1000] {
        for nearest in [1, 2, 80, 100_000] {
            for (name, settings) in all() {
                let settings = Overrides {
                    global_photons: Some(photons),
                    caustic_photons: Some(photons),
                    global_nearest: Some(nearest),
                    caustic_nearest: Some(nearest),
                    spp: Some(1),
                    ..settings
                };
                let shot = stage.shoot(&settings);
                assert_eq!(shot.statistics.rejected_samples, 0);
                if name == "photon map" {
                    // Direct light needs no photons.
                    assert_close("direct", shot.mean("direct"), path, 0.2);
                }
                for map in &shot.statistics.maps {
                    assert!(map.photons <= 40 * photons + 40, "{} photons of {photons}", map.photons);
                }
            }
        }
    }
    for kernel in [Kernel::Constant, Kernel::Cone { k: 1000.0 }, Kernel::Epanechnikov, Kernel::Gaussian] {
        let settings = Overrides { kernel: Some(kernel), caustic_nearest: Some(1), ..quick(&PHOTON_MAP) };
        stage.shoot(&settings);
    }
}

const CAMERA: &str =
    "[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\n[materials.paint]\ntype = \"lambert\"\nreflectance = 0.5\n";

#[test]
fn empty_scenes_and_dark_ones() {
    let sky = "[[lights]]\ntype = \"environment\"\nradiance = [1, 2, 3]\n";
    let bulb = "[[lights]]\ntype = \"point\"\nposition = [0, 3, 0]\npower = 10\n";
    let ball = "[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"paint\"\n";
    let nothing =
        parse_scene(&format!("{CAMERA}{sky}"), Path::new("test.toml"), &[]).unwrap_err().to_string();
    assert!(nothing.contains("no shapes"), "{nothing}");
    let hollow =
        "[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"paint\"\ngroup = \"never placed\"\n";
    for (what, text, want) in [
        ("a group that is never placed", format!("{CAMERA}{hollow}"), Some(0.0)),
        ("sky alone", format!("{CAMERA}{hollow}{sky}"), Some(1.0)),
        ("a bulb alone", format!("{CAMERA}{hollow}{bulb}"), Some(0.0)),
        ("a ball in the dark", format!("{CAMERA}{ball}"), Some(0.0)),
        ("a ball and a bulb", format!("{CAMERA}{ball}{bulb}"), None),
        ("a bulb inside the ball", format!("{CAMERA}{ball}{}", bulb.replace("3", "0.5")), Some(0.0)),
    ] {
        for (name, settings) in all() {
            let shot = Stage::new(&text, (12, 12)).shoot(&settings);
            println!("{what}, {name}: {:?}, {:?}", shot.mean("beauty"), shot.statistics.warnings);
            if let Some(want) = want {
                let off = (shot.mean("beauty")[0] - want).abs();
                assert!(off < 1e-6, "{what}, {name}: {:?}", shot.mean("beauty"));
            }
        }
    }
}

/// Cameras and lights where they should not be.
#[test]
fn in_walls_and_on_surfaces() {
    let ball = "[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"paint\"\n";
    let floor = "[[shapes]]\ntype = \"quad\"\ncorner = [-2, 0, -2]\nedge-u = [0, 0, 4]\nedge-v = [4, 0, 0]\nmaterial = \"paint\"\n";
    let bulb = |at: &str| format!("[[lights]]\ntype = \"point\"\nposition = {at}\npower = 10\n");
    let sky = "[[lights]]\ntype = \"environment\"\nradiance = 1\n";
    let from = |eye: &str, rest: &str| {
        CAMERA.replace("[0, 0, 5]", eye).replace("[0, 0, 0]", "[0.1, 0.2, 0.3]") + rest
    };
    for (what, text) in [
        ("camera inside an opaque ball", from("[0.5, 0, 0]", &format!("{ball}{sky}"))),
        ("camera on the surface of a ball", from("[0, 0, 1]", &format!("{ball}{sky}"))),
        (
            "camera in the plane of the floor",
            from("[1, 0, 0]", &format!("{floor}{sky}{}", bulb("[0, 1, 0]"))),
        ),
        ("camera at the bulb", from("[0, 1, 0]", &format!("{floor}{}", bulb("[0, 1, 0]")))),
        ("bulb in the floor", from("[0, 1, 3]", &format!("{floor}{}", bulb("[0, 0, 0]")))),
        ("bulb a hair above the floor", from("[0, 1, 3]", &format!("{floor}{}", bulb("[0, 1e-30, 0]")))),
        ("two floors in one place", from("[0, 1, 3]", &format!("{floor}{floor}{sky}"))),
        (
            "a lamp on the floor, face down",
            from(
                "[0, 1, 3]",
                &format!(
                    "{floor}[[shapes]]\ntype = \"disc\"\nnormal = [0, -1, 0]\nradius = 0.5\nmaterial = \"paint\"\n\
             emission = {{ radiance = 1 }}\n"
                ),
            ),
        ),
        (
            "a lamp on the floor, face up",
            from(
                "[0, 1, 3]",
                &format!(
                    "{floor}[[shapes]]\ntype = \"quad\"\ncorner = [-1, 0, -1]\nedge-u = [0, 0, 2]\nedge-v = [2, 0, 0]\n\
             material = \"paint\"\nemission = {{ radiance = 1, two-sided = true }}\n"
                ),
            ),
        ),
    ] {
        let stage = Stage::new(&text, (12, 12));
        for (name, settings) in all() {
            let shot = stage.shoot(&settings);
            let brightest = shot.layer("beauty").iter().copied().fold(0.0, f32::max);
            println!("{what}, {name}: up to {brightest}");
            assert_eq!(shot.statistics.rejected_samples, 0, "{what}, {name}");
        }
    }
}

/// Glass as black as ink, thin as nothing, and of a high index.
#[test]
fn media_at_their_ends() {
    for (ior, absorption) in [(1.0, 1e30), (1.5, 1e10), (100.0, 0.0), (1.0001, 1e-30), (1.33, 0.0)] {
        let text = format!(
            "{CAMERA}[materials.glass]\ntype = \"dielectric\"\nior = {ior:?}\nabsorption = {absorption:?}\n\
             [[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"glass\"\n\
             [[shapes]]\ntype = \"quad\"\ncorner = [-2, -1, -2]\nedge-u = [0, 0, 4]\nedge-v = [4, 0, 0]\nmaterial = \"paint\"\n\
             [[lights]]\ntype = \"environment\"\nradiance = 1\n"
        );
        let stage = Stage::new(&text, (12, 12));
        for (name, settings) in all() {
            let shot = stage.shoot(&settings);
            assert_eq!(shot.statistics.rejected_samples, 0, "{name}, {ior} {absorption}");
            let brightest = shot.layer("beauty").iter().copied().fold(0.0, f32::max);
            // Noise of few photons and samples aside, nothing is brighter than the sky.
            assert!(brightest < 20.0, "{name}, {ior} {absorption}: {brightest}");
        }
    }
}

/// A scene of 1e-6 to 1e6 metres, and one whose extent no `f32` holds.
#[test]
fn sizes() {
    for size in [1e-30, 1e-6, 1e6, 1e30] {
        let text = format!(
            "[camera]\neye = [0, 0, {:?}]\nat = [0, 0, 0]\n[materials.paint]\ntype = \"lambert\"\nreflectance = 0.5\n\
             [[shapes]]\ntype = \"sphere\"\nradius = {size:?}\nmaterial = \"paint\"\n\
             [[lights]]\ntype = \"directional\"\ndirection = [0, 0, -1]\nirradiance = 1\n",
            5.0 * size
        );
        let stage = Stage::new(&text, (12, 12));
        for (name, settings) in all() {
            let shot = stage.shoot(&settings);
            if name == "path" {
                assert!(shot.mean("beauty")[0] > 0.01, "{size}");
            }
        }
    }
}
