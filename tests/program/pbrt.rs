//! Scenes of pbrt show everything on its side, and as bright as the scene files that say the same.

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet};
use cardioid::render::{IntegratorKind, Overrides, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{SceneDescription, build_scene, parse_pbrt_bytes, parse_scene};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const SIZE: (u32, u32) = (32, 24);

fn of_pbrt(text: &str) -> SceneDescription {
    parse_pbrt_bytes(text.as_bytes(), Path::new("a.pbrt")).unwrap_or_else(|error| panic!("{error}"))
}

/// The picture by path tracing: red, green and blue at a place, from the left upper corner.
fn picture(scene: &SceneDescription, spp: u32) -> impl Fn(f64, f64) -> [f32; 3] + use<> {
    let device = Arc::new(Device::new(1).unwrap());
    let built = build_scene(scene, &device, SIZE).unwrap_or_else(|error| panic!("{error}"));
    let asked = Overrides {
        integrator: Some(IntegratorKind::Path),
        spp: Some(spp),
        seed: Some(3),
        ..Overrides::default()
    };
    let request = RenderRequest {
        width: SIZE.0,
        height: SIZE.1,
        crop: None,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings: Settings::from(&asked),
    };
    let film = render(&built.scene, &built.camera, &request, &Silent).unwrap().film;
    let pixels = film.develop().beauty().to_vec();
    move |x, y| {
        let [column, row] =
            [(x, SIZE.0), (y, SIZE.1)].map(|(share, side)| (share * f64::from(side)) as usize);
        let first = 3 * (row * SIZE.0 as usize + column);
        [pixels[first], pixels[first + 1], pixels[first + 2]]
    }
}

/// Lamps in the shape of an F: a stem, and arms towards +x at the top and in the middle.
const LETTER: &str = "Camera \"perspective\" \"float fov\" 60
    WorldBegin AreaLightSource \"diffuse\" \"bool twosided\" true \"rgb L\" [1 1 1]
    Shape \"bilinearmesh\" \"point3 P\" [-1 -2 0  -0.4 -2 0  -1 2 0  -0.4 2 0]
    Shape \"bilinearmesh\" \"point3 P\" [-0.4 1.4 0  1.4 1.4 0  -0.4 2 0  1.4 2 0]
    Shape \"bilinearmesh\" \"point3 P\" [-0.4 -0.3 0  0.7 -0.3 0  -0.4 0.3 0  0.7 0.3 0]";

/// Pbrt's camera has x on the right where it looks along z. A mirror in its transform turns the letter around, and so does a look
/// from behind.
#[test]
fn letters_can_be_read() {
    let reads = |transform: &str| {
        let at = picture(&of_pbrt(&format!("{transform} {LETTER}")), 4);
        let is_lit = |x: f64, y: f64| at(x, y)[0] > 0.5;
        // The top of the stem, and the ends of the upper arm on either side.
        let top = 0.5 - 1.7 / 5.0 / 2.0 / 0.577 + 0.02;
        let end = 1.1 / 5.0 / 2.0 / 0.577 * 0.75;
        [is_lit(0.5 - end, top), is_lit(0.5 + end, top)]
    };
    // The arm ends on the right where x does.
    assert_eq!(reads("LookAt 0 0 -5  0 0 0  0 1 0"), [false, true]);
    assert_eq!(reads("Scale -1 1 1 LookAt 0 0 -5  0 0 0  0 1 0"), [true, false]);
    assert_eq!(reads("LookAt 0 0 5  0 0 0  0 1 0"), [true, false]);
    assert_eq!(reads("Scale -1 1 1 LookAt 0 0 5  0 0 0  0 1 0"), [false, true]);
}

/// The same scene in both formats: glass, metal, and a lamp over a floor.
#[test]
fn a_scene_of_pbrt_is_that_of_the_scene_file() {
    let pbrt = of_pbrt(
        "Scale -1 1 1 LookAt 1 2 6  0 0.5 0  0 1 0 Camera \"perspective\" \"float fov\" 45
        Film \"rgb\" \"integer xresolution\" 32 \"integer yresolution\" 24 WorldBegin
        LightSource \"infinite\" \"rgb L\" [0.1 0.2 0.3]
        Material \"diffuse\" \"rgb reflectance\" [0.6 0.4 0.2]
        Shape \"bilinearmesh\" \"point3 P\" [-3 0 3  3 0 3  -3 0 -3  3 0 -3]
        AttributeBegin Translate 0.5 1 0 Material \"dielectric\" \"float eta\" 1.5 Shape \"sphere\" \"float radius\" 0.8 AttributeEnd
        AttributeBegin Translate -1 0.5 0.5 Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\" \"spectrum k\" \"metal-Au-k\"
          \"float roughness\" 0.2 \"bool remaproughness\" false Shape \"sphere\" \"float radius\" 0.5 AttributeEnd
        AttributeBegin Translate 0 4 0 Rotate 90 1 0 0 AreaLightSource \"diffuse\" \"rgb L\" [9 8 7]
          Material \"diffuse\" \"rgb reflectance\" [0 0 0] Shape \"disk\" AttributeEnd",
    );
    let toml = r#"
        camera = { eye = [1, 2, 6], at = [0, 0.5, 0], fov = 45.0 }
        [materials]
        floor = { type = "lambert", reflectance = [0.6, 0.4, 0.2] }
        glass = { type = "dielectric", ior = 1.5 }
        gold = { type = "conductor", metal = "gold", roughness = 0.2 }
        black = { type = "lambert", reflectance = 0.0 }
        [[shapes]]
        type = "quad"
        corner = [-3, 0, 3]
        edge-u = [6, 0, 0]
        edge-v = [0, 0, -6]
        material = "floor"
        [[shapes]]
        type = "sphere"
        center = [0.5, 1, 0]
        radius = 0.8
        material = "glass"
        [[shapes]]
        type = "sphere"
        center = [-1, 0.5, 0.5]
        radius = 0.5
        material = "gold"
        [[shapes]]
        type = "disc"
        center = [0, 4, 0]
        normal = [0, -1, 0]
        radius = 1.0
        material = "black"
        emission = { radiance = [9, 8, 7] }
        [[lights]]
        type = "environment"
        radiance = [0.1, 0.2, 0.3]
    "#;
    let toml = parse_scene(toml, Path::new("a.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
    let (ours, theirs) = (picture(&toml, 64), picture(&pbrt, 64));
    let places = (0..SIZE.0 * SIZE.1).map(|i| {
        let share = |i: u32, side: u32| (f64::from(i) + 0.5) / f64::from(side);
        (share(i % SIZE.0, SIZE.0), share(i / SIZE.0, SIZE.1))
    });
    let (mut sums, mut difference) = ([0.0f64; 2], 0.0);
    for (x, y) in places {
        for (a, b) in ours(x, y).into_iter().zip(theirs(x, y)) {
            sums[0] += f64::from(a);
            sums[1] += f64::from(b);
            difference += f64::from((a - b).abs());
        }
    }
    // Paths differ by rounding; the means agree to a fraction of the noise, and places hold what they should.
    assert!((sums[0] / sums[1] - 1.0).abs() < 0.01, "{sums:?}");
    assert!(difference / sums[0] < 0.1, "{}", difference / sums[0]);
}

#[test]
fn the_program_tells_lines() {
    let folder = tempfile::tempdir().unwrap();
    let text = "Film \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 30\nCamera \"perspective\"
        Sampler \"halton\" \"integer pixelsamples\" 2\nWorldBegin\nLightSource \"infinite\"
        Shape \"sphere\" \"float shadowalpha\" 0.5";
    fs::write(folder.path().join("a.pbrt"), text).unwrap();
    let run = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder.path())
            .args(args)
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, told) = run(&["render", "a.pbrt", "-o", "a.exr"]);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("note: a.pbrt:3:9: Sampler `halton`: 2 samples"), "{told}");
    assert!(told.contains("warning: a.pbrt:6:9: Shape `sphere`: `shadowalpha`"), "{told}");
    let (code, told) = run(&["info", "a.pbrt", "-D", "spp=2"]);
    assert!(code == Some(1) && told.contains("no parameters"), "{told}");
}
