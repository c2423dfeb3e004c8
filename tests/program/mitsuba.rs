//! Scenes of Mitsuba give the pictures of the scene files that say the same.

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet};
use cardioid::image_io::read;
use cardioid::render::{IntegratorKind, Overrides, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{SceneDescription, build_scene, parse_mitsuba_bytes, parse_scene};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

const SIZE: (u32, u32) = (32, 24);

fn xml(sensor: &str) -> String {
    format!(
        "<scene version=\"3.0.0\">
        <sensor type=\"perspective\"><float name=\"fov\" value=\"45\"/><string name=\"fov_axis\" value=\"y\"/>
            <transform name=\"to_world\">{sensor}<lookat origin=\"1, 2, 6\" target=\"0, 0.5, 0\" up=\"0, 1, 0\"/></transform></sensor>
        <shape type=\"rectangle\"><transform name=\"to_world\"><scale value=\"3\"/><rotate x=\"1\" angle=\"-90\"/></transform>
            <bsdf type=\"twosided\"><bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0.6, 0.4, 0.2\"/></bsdf></bsdf></shape>
        <shape type=\"sphere\"><point name=\"center\" x=\"0.5\" y=\"1\" z=\"0\"/><float name=\"radius\" value=\"0.8\"/>
            <bsdf type=\"dielectric\"><float name=\"int_ior\" value=\"1.5\"/><float name=\"ext_ior\" value=\"1\"/></bsdf></shape>
        <shape type=\"sphere\"><point name=\"center\" x=\"-1\" y=\"0.5\" z=\"0.5\"/><float name=\"radius\" value=\"0.5\"/>
            <bsdf type=\"roughconductor\"><string name=\"material\" value=\"Au\"/><float name=\"alpha\" value=\"0.2\"/></bsdf></shape>
        <shape type=\"disk\"><transform name=\"to_world\"><rotate x=\"1\" angle=\"90\"/><translate y=\"4\"/></transform>
            <bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0\"/></bsdf>
            <emitter type=\"area\"><rgb name=\"radiance\" value=\"9, 8, 7\"/></emitter></shape>
        <emitter type=\"constant\"><rgb name=\"radiance\" value=\"0.1, 0.2, 0.3\"/></emitter>
        </scene>"
    )
}

const TOML: &str = r#"
[camera]
eye = [1, 2, 6]
at = [0, 0.5, 0]
fov = 45.0
[materials.floor]
type = "lambert"
reflectance = [0.6, 0.4, 0.2]
[materials.glass]
type = "dielectric"
ior = 1.5
[materials.gold]
type = "conductor"
metal = "gold"
roughness = 0.2
[materials.black]
type = "lambert"
reflectance = 0.0
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

fn of_xml(sensor: &str) -> SceneDescription {
    parse_mitsuba_bytes(xml(sensor).as_bytes(), Path::new("a.xml"), &[])
        .unwrap_or_else(|error| panic!("{error}"))
}

/// The picture by path tracing, row after row.
fn picture(scene: &SceneDescription, spp: u32) -> Vec<f32> {
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
    let rendered = render(&built.scene, &built.camera, &request, &Silent).unwrap();
    rendered.film.develop().beauty().to_vec()
}

fn means(picture: &[f32]) -> [f64; 3] {
    std::array::from_fn(|channel| {
        let values = picture.iter().skip(channel).step_by(3);
        values.map(|value| f64::from(*value)).sum::<f64>() / (picture.len() / 3) as f64
    })
}

/// The rounding of the transforms differs, and with it some paths; the means agree to a fraction of the noise.
#[test]
fn a_scene_of_mitsuba_is_that_of_the_scene_file() {
    let toml = parse_scene(TOML, Path::new("a.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
    let (ours, theirs) = (picture(&toml, 64), picture(&of_xml(""), 64));
    let (a, b) = (means(&ours), means(&theirs));
    for (x, y) in a.iter().zip(&b) {
        assert!((x / y - 1.0).abs() < 0.01, "{a:?} {b:?}");
    }
    let difference: f64 = ours.iter().zip(&theirs).map(|(x, y)| f64::from((x - y).abs())).sum();
    let whole: f64 = ours.iter().map(|x| f64::from(*x)).sum();
    assert!(difference / whole < 0.1, "{}", difference / whole);
}

/// A sensor whose transform mirrors shows the picture the other way around.
#[test]
fn mirrored_sensors_mirror_the_picture() {
    let (plain, mirrored) = (picture(&of_xml(""), 64), picture(&of_xml("<scale x=\"-1\"/>"), 64));
    let width = SIZE.0 as usize;
    let turned: Vec<f32> = mirrored
        .chunks_exact(3 * width)
        .flat_map(|row| row.chunks_exact(3).rev().flatten().copied().collect::<Vec<_>>())
        .collect();
    let distance = |a: &[f32], b: &[f32]| -> f64 {
        let whole: f64 = a.iter().map(|x| f64::from(*x)).sum();
        a.iter().zip(b).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / whole
    };
    assert!(distance(&plain, &turned) < 0.5 * distance(&plain, &mirrored));
}

#[test]
fn the_program_tells_lines_and_renders_the_crop_window() {
    let folder = tempfile::tempdir().unwrap();
    let film = "<default name=\"spp\" value=\"64\"/><sensor type=\"perspective\">
        <sampler type=\"independent\"><integer name=\"sample_count\" value=\"$spp\"/></sampler><film type=\"hdrfilm\">
        <integer name=\"width\" value=\"40\"/><integer name=\"height\" value=\"30\"/><integer name=\"crop_offset_x\" value=\"10\"/>
        <integer name=\"crop_width\" value=\"20\"/><integer name=\"crop_height\" value=\"12\"/></film></sensor>
        <emitter type=\"constant\"/><emitter type=\"projector\"/>";
    fs::write(folder.path().join("a.xml"), format!("<scene version=\"3.0.0\">\n{film}\n</scene>")).unwrap();
    let run = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder.path())
            .args(args)
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, told) = run(&["render", "a.xml", "-D", "spp=2", "-o", "a.exr"]);
    assert_eq!(code, Some(0), "{told}");
    assert!(told.contains("note: a.xml:3:9: sampler `independent`: 2 samples"), "{told}");
    assert!(told.contains("warning: a.xml:6:") && told.contains("`projector`"), "{told}");
    let image = read(folder.path().join("a.exr")).unwrap();
    assert_eq!((image.width, image.height), (20, 12));
    let (code, told) = run(&["info", "a.xml", "-D", "sp=2"]);
    assert!(code == Some(1) && told.contains("did you mean `spp`?"), "{told}");
}
