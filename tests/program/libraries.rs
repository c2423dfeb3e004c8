//! Scenes of several files, and materials of meshes that others take the place of.

use crate::common::{run, stderr};
use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet};
use cardioid::render::{IntegratorKind, Overrides, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{SceneDescription, build_scene, load_scene};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// The picture by paths, and the warnings of the scene.
fn picture(scene: &SceneDescription) -> (Vec<f32>, Vec<String>) {
    let device = Arc::new(Device::new(1).unwrap());
    let (width, height) = (24, 16);
    let built = build_scene(scene, &device, (width, height)).unwrap_or_else(|error| panic!("{error}"));
    let asked = Overrides {
        integrator: Some(IntegratorKind::Path),
        spp: Some(4),
        seed: Some(3),
        ..Overrides::default()
    };
    let request = RenderRequest {
        width,
        height,
        crop: None,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings: Settings::from(&asked),
    };
    let film = render(&built.scene, &built.camera, &request, &Silent).unwrap().film;
    let warnings = built.warnings.into_iter().map(|warning| warning.message).collect();
    (film.develop().beauty().to_vec(), warnings)
}

fn load(path: &Path) -> SceneDescription {
    load_scene(path, &[]).unwrap_or_else(|error| panic!("{error}"))
}

const MATERIALS: &str = "[materials.paint]\ntype = \"lambert\"\nreflectance = \"${tint}\"
    [media.tea]\nior = 1.33\nabsorption = 0.02\n[materials.tea]\ntype = \"dielectric\"\ninside = \"tea\"\n";
const SHAPES: &str = "[[shapes]]\ntype = \"sphere\"\nradius = 10\nmaterial = \"tea\"
    [[shapes]]\ntype = \"disc\"\ncenter = [0, -10, 0]\nradius = 40\nmaterial = \"paint\"\n";
const HEAD: &str = "[camera]\neye = [0, 0.1, 0.6]\nat = [0, 0, 0]\n[parameters]\ntint = \"#c08040\"
    [[lights]]\ntype = \"environment\"\nradiance = 1.0\n";

/// Files that include each other give the picture of the one file that says the same, each in its own unit.
#[test]
fn a_scene_of_several_files_is_the_scene_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| fs::write(folder.path().join(name), text).unwrap();
    fs::create_dir(folder.path().join("lib")).unwrap();
    write(
        "lib/materials.toml",
        format!(
            "unit = \"cm\"\n{MATERIALS}[materials.unused]\ntype = \"mirror\"\n[textures.unused]\ntype = \"noise\"\nsize = 1\n"
        ),
    );
    write(
        "lib/things.toml",
        format!("unit = \"cm\"\ninclude = [\"materials.toml\", \"../scene.toml\"]\n{SHAPES}"),
    );
    write("scene.toml", format!("include = [\"lib/things.toml\", \"lib/materials.toml\"]\n{HEAD}"));
    write(
        "whole.toml",
        format!("unit = \"cm\"\n{}{MATERIALS}{SHAPES}", HEAD.replace("0.6", "60").replace("0.1", "10")),
    );
    let [several, one] = ["scene.toml", "whole.toml"].map(|name| load(&folder.path().join(name)));
    let ((several, warnings), (one, _)) = (picture(&several), picture(&one));
    assert_eq!(several, one);
    assert!(warnings.is_empty(), "{warnings:?}");
    let set = run(
        folder.path(),
        &[
            "render",
            "scene.toml",
            "--spp",
            "1",
            "--integrator",
            "path",
            "--resolution",
            "16x16",
            "--set",
            "tint=red",
            "-o",
            "a.exr",
        ],
    );
    assert!(stderr(&set).contains("lib/materials.toml:4:"), "{}", stderr(&set));
}

#[test]
fn errors_in_included_files_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("wrong.toml", "[materials.m]\ntype = \"lambert\"\nreflectance = 2.0\n");
    write("broken.toml", "[materials.m\n");
    write("camera.toml", "[camera]\neye = [0, 0, 1]\nat = [0, 0, 0]\n");
    write("itself.toml", "include = \"itself.toml\"\n");
    write("twice.toml", "[materials.paint]\ntype = \"mirror\"\n");
    write("deep.toml", "include = \"gone.toml\"\n");
    let scene = |include: &str| {
        let text = format!(
            "include = {include}\n[materials.paint]\ntype = \"mirror\"\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"paint\"\n"
        );
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        load_scene(&folder.path().join("scene.toml"), &[]).map(|_| ()).unwrap_err().to_string()
    };
    for (include, told) in [
        ("\"wrong.toml\"", "wrong.toml:3:15"),
        ("\"broken.toml\"", "broken.toml:1:"),
        ("\"camera.toml\"", "unknown key `camera` in the included file"),
        ("\"gone.toml\"", "scene.toml:1:11"),
        ("\"deep.toml\"", "deep.toml:1:11"),
        ("\"itself.toml\"", "includes itself"),
        ("\"scene.toml\"", "includes itself"),
        ("[\"twice.toml\"]", "the name `paint` is taken"),
        ("3", "a list of paths"),
        ("[3]", "`include` contains 3"),
        ("\".\"", "cannot be read"),
    ] {
        let error = scene(include);
        assert!(error.contains(told), "{include}: {error}");
    }
}

/// A material that takes the place of all materials of a file gives the picture of that material on the whole mesh.
#[test]
fn materials_of_files_are_replaced_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write(
        "a.obj",
        "mtllib a.mtl\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nusemtl Red\nf 1 2 3\nusemtl Lamp\nf 1 3 4\n",
    );
    write("a.mtl", "newmtl Red\nKd 1 0 0\nnewmtl Lamp\nKd 0 0 0\nKe 3 3 3\n");
    let cube = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/cube.gltf");
    let scene = |file: &str, materials: &str| {
        let text = format!(
            "[camera]\neye = [1, 2, 3]\nat = [0, 0, 0]\n[materials.white]\ntype = \"lambert\"\nreflectance = 0.7
            [[lights]]\ntype = \"environment\"\nradiance = [0.5, 1, 2]
            [[shapes]]\ntype = \"mesh\"\nfile = '{file}'\nmaterial = \"white\"\n{materials}\n"
        );
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        picture(&load(&folder.path().join("scene.toml")))
    };
    let both = "materials = \"file\"\nreplace = { Red = \"white\", Lamp = \"white\" }";
    assert_eq!(scene("a.obj", both).0, scene("a.obj", "").0);
    // The other half still shines.
    let half = scene("a.obj", "materials = \"file\"\nreplace = { Red = \"white\" }").0;
    assert!(half != scene("a.obj", "").0 && half != scene("a.obj", "materials = \"file\"").0);
    let (_, warnings) = scene("a.obj", "materials = \"file\"\nreplace = { red = \"white\" }");
    assert!(warnings.iter().any(|warning| warning.contains("did you mean `Red`?")), "{warnings:?}");
    let cube = cube.display().to_string();
    let (_, warnings) = scene(&cube, "materials = \"file\"\nreplace = { none = \"white\" }");
    let told = warnings.iter().find(|warning| warning.contains("is named `none`")).unwrap();
    let names: Vec<&str> = told.split('`').skip(3).step_by(2).collect();
    assert!(!names.is_empty(), "{told}");
    let all: Vec<String> = names.iter().map(|name| format!("{name:?} = \"white\"")).collect();
    let all = format!("materials = \"file\"\nreplace = {{ {} }}", all.join(", "));
    assert_eq!(scene(&cube, &all).0, scene(&cube, "").0);
}
