//! `cardioid radiosity` as a user meets it: views that agree with a path-traced reference, and what is computed again after a change.

use crate::common;
use cardioid::image_io;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs `cardioid radiosity` in a folder, and returns what it says.
fn succeeds(folder: &TempDir, args: &[&str]) -> String {
    let all: Vec<&str> = std::iter::once("radiosity").chain(args.iter().copied()).collect();
    let output = common::run(folder.path(), &all);
    let message = common::stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {message}");
    message
}

/// Means of the channels over the quarters of a picture, in watts per square metre and steradian; then over all of it.
fn means(file: &Path) -> [[f64; 3]; 5] {
    let image = image_io::read(file).unwrap();
    let layer = image.layer("").unwrap();
    let (width, height) = (image.width as usize, image.height as usize);
    let mut sums = [[0.0; 3]; 5];
    for (i, value) in layer.data.iter().enumerate() {
        let (pixel, channel) = (i / layer.channels.len(), i % layer.channels.len());
        let quarter = 2 * usize::from(pixel / width >= height / 2) + usize::from(pixel % width >= width / 2);
        sums[quarter][channel] += 4.0 * f64::from(*value) / (width * height) as f64;
        sums[4][channel] += f64::from(*value) / (width * height) as f64;
    }
    sums
}

#[test]
fn views_agree_with_path_tracing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = root().join("scenes/cornell-diffuse.toml").display().to_string();
    let halves = ["reference-1.exr", "reference-2.exr"]
        .map(|half| means(&root().join("tests/reference/cornell-diffuse").join(half)));
    // The solution is computed once: the next views differ in step 4 alone.
    for (view, spp, bound, bound_of_quarter) in [
        ("flat", "4", 0.01, 0.03),
        ("smooth", "4", 0.015, 0.04),
        ("gather", "8", 0.015, 0.04),
        ("final", "8", 0.01, 0.03),
    ] {
        let picture = folder.path().join(view).with_extension("exr");
        let name = picture.display().to_string();
        let said = succeeds(
            &folder,
            &[
                &scene,
                "--patches",
                "4000",
                "--solution",
                "box.radiosity",
                "--view",
                view,
                "--spp",
                spp,
                "--resolution",
                "96x96",
                "--gather-samples",
                "16",
                "-o",
                &name,
            ],
        );
        let is_known = said.contains("form factors from the file") && said.contains("solution from the file");
        assert_eq!(is_known, view != "flat", "{said}");
        let found = means(&picture);
        for (part, found) in found.iter().enumerate() {
            let sum: f64 = found.iter().sum();
            let reference: f64 =
                (0..3).map(|channel| 0.5 * (halves[0][part][channel] + halves[1][part][channel])).sum();
            let bound = if part == 4 { bound } else { bound_of_quarter };
            println!("{view}, part {part}: {:+.2} %", 100.0 * (sum / reference - 1.0));
            assert!((sum / reference - 1.0).abs() < bound, "{view}, part {part}: {sum} for {reference}");
        }
    }
}

const ROOM: &str = r#"
[camera]
eye = [0, 1, 3]
at = [0, 0.5, 0]

[materials.grey]
type = "lambert"
reflectance = 0.5

[[shapes]]
type = "box"
min = [-2, 0, -2]
max = [2, 3, 4]
material = "grey"

[[shapes]]
name = "globe"
type = "sphere"
center = [0, 0.6, 0]
radius = 0.5
material = "grey"

[[lights]]
type = "point"
position = [1, 2.5, 1]
intensity = [10, 9, 8]
"#;

#[test]
fn what_changed_is_computed_again_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let scene: PathBuf = folder.path().join("room.toml");
    let run = |text: &str, patches: &str| {
        fs::write(&scene, text).unwrap();
        let args = [
            "room.toml",
            "--solution",
            "room.radiosity",
            "--spp",
            "1",
            "--resolution",
            "16x16",
            "--view",
            "smooth",
        ];
        succeeds(&folder, &[&args[..], &["--patches", patches]].concat())
    };
    let computed = |said: &str| (said.contains("form factors computed"), said.contains(" solved in"));
    assert_eq!(computed(&run(ROOM, "400")), (true, true));
    assert_eq!(computed(&run(ROOM, "400")), (false, false));
    assert_eq!(computed(&run(&ROOM.replace("eye = [0, 1, 3]", "eye = [1, 1, 3]"), "400")), (false, false));
    assert_eq!(computed(&run(&ROOM.replace("0.5\n\n[[shapes]]", "0.6\n\n[[shapes]]"), "400")), (false, true));
    assert_eq!(computed(&run(&ROOM.replace("[10, 9, 8]", "[3, 9, 8]"), "400")), (false, true));
    assert_eq!(computed(&run(&ROOM.replace("radius = 0.5", "radius = 0.4"), "400")), (true, true));
    assert_eq!(computed(&run(&ROOM.replace("radius = 0.5", "radius = 0.4"), "300")), (true, true));
    // Mirrors on top: the globe is shown by rays.
    let shiny = ROOM.replace("radius = 0.5\nmaterial = \"grey\"", "radius = 0.5\nmaterial = \"shiny\"")
        + "\n[materials.shiny]\ntype = \"mirror\"\n";
    fs::write(&scene, &shiny).unwrap();
    let plain =
        ["radiosity", "room.toml", "--patches", "300", "--spp", "4", "--resolution", "32x32", "-o", "a.exr"];
    let refused = common::run(folder.path(), &plain);
    assert_eq!(refused.status.code(), Some(1));
    let said = common::stderr(&refused);
    assert!(said.contains("`globe`") && said.contains("--specular absorb"), "{said}");
    succeeds(&folder, &[&plain[1..], &["--specular", "absorb", "--view", "gather"]].concat());
    let image = image_io::read(folder.path().join("a.exr")).unwrap();
    assert!(image.layer("specular").unwrap().data.iter().sum::<f32>() > 0.0);
    // A damaged file, and another kind of file.
    for bytes in
        [b"something else".to_vec(), fs::read(folder.path().join("room.radiosity")).unwrap()[..90].to_vec()]
    {
        fs::write(folder.path().join("bad.radiosity"), bytes).unwrap();
        let output = common::run(folder.path(), &[&plain[..], &["--solution", "bad.radiosity"]].concat());
        assert_eq!(output.status.code(), Some(1));
        let said = common::stderr(&output);
        assert!(said.contains("bad.radiosity") && !said.contains("panicked"), "{said}");
    }
}

#[test]
fn a_baked_model_is_read_again() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("room.toml"), ROOM).unwrap();
    let baked = common::run(folder.path(), &["bake", "room.toml", "--patches", "400", "-o", "model.glb"]);
    assert_eq!(baked.status.code(), Some(0), "{}", common::stderr(&baked));
    let read = common::run(folder.path(), &["info", "model.glb"]);
    assert_eq!(read.status.code(), Some(0), "{}", common::stderr(&read));
    // The inside of the room and the outside of the globe.
    assert!(common::stdout(&read).contains("in 2 mesh(es)"), "{}", common::stdout(&read));
    let refused = common::run(folder.path(), &["bake", "room.toml", "-o", "model.obj"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(common::stderr(&refused).contains(".glb"));
}
