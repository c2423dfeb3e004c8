//! What is said to who meets the program for the first time: hints for wrong command lines and keys, and names of what is wrong.

use crate::common::{program, run, stderr, stdout};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Fails with `code`, and says all of `parts`.
#[track_caller]
fn refused(folder: &Path, args: &[&str], code: i32, parts: &[&str]) {
    let output = run(folder, args);
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {told}");
    parts.iter().for_each(|part| assert!(told.contains(part), "{args:?}: no `{part}` in {told}"));
}

/// Succeeds; what it said on standard error.
#[track_caller]
fn done(folder: &Path, args: &[&str]) -> String {
    let output = run(folder, args);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
    stderr(&output)
}

/// Quick settings for a tiny picture.
const QUICK: [&str; 8] =
    ["--resolution", "12x9", "--spp", "1", "--global-photons", "2000", "--caustic-photons", "2000"];

fn render<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["render", scene, "-o", "a.exr"], QUICK.as_slice(), more].concat()
}

/// A floor and a ball under a point light; `shape` is the ball's material.
fn ball(material: &str, light: &str) -> String {
    format!(
        r#"
        [camera]
        eye = [0, 1, 5]
        at = [0, 0, 0]
        [materials.glass]
        type = "dielectric"
        ior = 1.5
        [materials.white]
        type = "lambert"
        reflectance = 0.5
        two-sided = false
        [[shapes]]
        name = "ball"
        type = "sphere"
        radius = 1
        material = "{material}"
        [[shapes]]
        name = "floor"
        type = "quad"
        corner = [-5, -2, 5]
        edge-u = [10, 0, 0]
        edge-v = [0, 0, -10]
        material = "white"
        [[lights]]
        name = "lamp"
        {light}
        "#
    )
}

const POINT: &str = "type = \"point\"\nposition = [0, 5, 0]\npower = 100";

#[test]
fn a_file_without_a_subcommand_and_options_of_other_programs() {
    let folder = folder();
    let folder = folder.path();
    refused(folder, &["ball.toml"], 2, &["'ball.toml'", "cardioid render ball.toml"]);
    refused(folder, &["rendr"], 2, &["similar subcommand exists: 'render'"]);
    for (command, option, ours) in [
        ("render", "--size", "'--resolution'"),
        ("render", "--width", "'--resolution'"),
        ("info", "--height", "'--resolution'"),
        ("render", "--samples", "'--spp'"),
        ("render", "--bounces", "'--max-depth'"),
        ("photons", "--out", "'--output'"),
    ] {
        refused(folder, &[command, "a.toml", option, "640"], 2, &[option, ours]);
    }
    // Its own name is what it was.
    refused(folder, &["probe", "a.toml", "--from", "0,0,0", "--samples", "8"], 1, &["a.toml"]);
    refused(folder, &["render", "a.toml", "--spp", "1e18"], 2, &["from 1 to 16777216"]);
}

#[test]
fn keys_and_types_of_other_renderers_are_known() {
    let folder = folder();
    let text = "[materials.a]\ntype = \"lambert\"\ncolor = [1, 0, 0]\n[materials.b]\ntype = \"glass\"\nior = 1.5\n\
                [materials.c]\ntype = \"ward\"\nkd = 0.5\nspecular = 0.1\nroughness = 0.1\n\
                [[shapes]]\ntype = \"cube\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nmaterial = \"a\"\n\
                [[lights]]\ntype = \"point\"\nlocation = [0, 0, 0]\npower = 1\n";
    fs::write(folder.path().join("a.toml"), text).unwrap();
    let meant = ["`reflectance`", "`dielectric`", "`diffuse`", "`box`", "`position`"]
        .map(|name| format!("did you mean {name}?"));
    let output = run(folder.path(), &["info", "a.toml"]);
    let told = stderr(&output);
    meant.iter().for_each(|part| assert!(told.contains(part), "no `{part}` in {told}"));
    // What is misspelt is one error, and not one more for what is then missing.
    assert_eq!(told.matches("a.toml:").count(), 5, "{told}");
}

#[test]
fn what_is_wrong_is_named() {
    let folder = folder();
    let folder = folder.path();
    let write = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    // Glass without a lid.
    write(
        "open.obj",
        "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\nf 1 2 3 4\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\n\
         f 4 8 5 1\n",
    );
    let told = done(folder, &render("open.obj", &["--set", "material=glass"]));
    assert!(told.contains("at `mesh`") && told.contains("the mesh is open there"), "{told}");
    // A closed one is sound.
    write("ball.toml", &ball("glass", POINT));
    let told = done(folder, &render("ball.toml", &[]));
    assert!(!told.contains("another medium") && !told.contains("inside a body"), "{told}");
    // The camera in it.
    write("inside.toml", &ball("glass", POINT).replace("eye = [0, 1, 5]", "eye = [0, 0, 0.5]"));
    let told = done(folder, &render("inside.toml", &[]));
    assert!(
        told.contains("note: inside.toml") && told.contains("inside a body of `inside of glass`"),
        "{told}"
    );
    // A vertex of an OBJ.
    write("nan.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nv 1 1 0\nf 1 2 3\nf 1 2 4\n");
    let told = done(folder, &["info", "nan.obj"]);
    assert!(told.contains("1 triangles with NaN") && told.contains("in line 3)"), "{told}");
    // Shapes that emit.
    let lamp = ball("white", POINT).replace("radius = 1\n", "radius = 1\nemission = { radiance = 1.0 }\n");
    write("lamp.toml", &lamp);
    let output = run(folder, &["info", "lamp.toml"]);
    for part in ["ball: area light, sphere", "lamp: point light"] {
        assert!(stdout(&output).contains(part), "{}", stdout(&output));
    }
}

#[test]
fn pictures_without_photons_say_why() {
    let folder = folder();
    let folder = folder.path();
    let below = POINT.replace("[0, 5, 0]", "[0, -5, 0]");
    fs::write(folder.join("below.toml"), ball("glass", &below)).unwrap();
    for more in [&[][..], &["--integrator", "photons"], &["--integrator", "progressive", "--rounds", "2"]] {
        let told = done(folder, &render("below.toml", more));
        assert!(told.contains("the global map is empty") && told.contains("were tried"), "{more:?}: {told}");
    }
    fs::write(folder.join("white.toml"), ball("white", POINT)).unwrap();
    let told = done(folder, &render("white.toml", &["--integrator", "photons", "--map", "caustic"]));
    assert!(told.contains("the caustic map, which is not built (no specular surface"), "{told}");
    let told = done(folder, &["render", "white.toml", "--resolution", "4x3", "--photons", "0"]);
    assert!(told.contains("no photons of the global map were asked for"), "{told}");
    assert!(!done(folder, &render("white.toml", &[])).contains("warning"));
}

/// The words for glTF and meshes speak of what these have.
#[test]
fn files_without_a_scene_file_are_told_what_they_can_do() {
    let folder = folder();
    let folder = folder.path();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gltf/triangle.gltf");
    let model = model.to_str().unwrap();
    let told = done(folder, &["info", model, "--set", "light=no"]);
    assert!(told.contains("leave `--set light=no` out") && !told.contains("[[lights]]"), "{told}");
    refused(folder, &["info", model, "--up", "z"], 1, &["glTF has y up"]);
    refused(
        folder,
        &["info", model, "--set", "unit=cm"],
        1,
        &["its lengths are metres", "`transform` with `scale`"],
    );
    // Lengths of a mesh.
    let mesh = |scale: f64| {
        let place = |p: [f64; 3]| format!("v {} {} {}\n", scale * p[0], scale * p[1], scale * p[2]);
        let corners: String =
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]].map(place).concat();
        corners + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    };
    for (name, scale) in [("m.obj", 1.0), ("mm.obj", 1000.0)] {
        fs::write(folder.join(name), mesh(scale)).unwrap();
    }
    let told = done(folder, &["info", "m.obj"]);
    assert!(told.contains("1 x 2 x 1 m") && !told.contains("unit"), "{told}");
    let told = done(folder, &["info", "mm.obj"]);
    assert!(told.contains("1000 x 2000 x 1000 m") && told.contains("--set unit=mm"), "{told}");
    for unit in ["unit=mm", "unit=0.001"] {
        let told = done(folder, &["info", "mm.obj", "--set", unit]);
        assert!(told.contains("1 x 2 x 1 m") && !told.contains("--set unit"), "{told}");
    }
    refused(folder, &["info", "mm.obj", "--set", "unit=yard"], 1, &["yard", "`--set unit=mm`"]);
    let picture = |name: &str, more: &[&str]| {
        done(folder, &render(name, more));
        let picture = cardioid::image_io::read(folder.join("a.exr")).unwrap();
        picture.layer("depth").unwrap().data.clone()
    };
    // The same but for rounding, and so are coordinates.
    let (metres, scaled) = (picture("m.obj", &[]), picture("mm.obj", &["--set", "unit=mm"]));
    let is_near = |(a, b): (&f32, &f32)| a == b || (a - b).abs() <= 1e-4 * a.abs();
    assert!(metres.iter().zip(&scaled).all(is_near), "{metres:?} {scaled:?}");
}

/// What is deep and only ends at its lowest z does not stand there.
#[test]
fn the_axis_of_a_mesh_is_asked_for_where_it_could_stand_on_end() {
    let folder = folder();
    let folder = folder.path();
    // A spindle along z, and the same cut off flat.
    let ring = |z: f64, r: f64| format!("v {r} 0 {z}\nv 0 {r} {z}\nv -{r} 0 {z}\nv 0 -{r} {z}\n");
    let sides = |a: usize| {
        (0..4)
            .map(move |i| format!("f {} {} {} {}\n", a + i, a + (i + 1) % 4, a + 4 + (i + 1) % 4, a + 4 + i))
    };
    let body = ring(-1.0, 1.0) + &ring(1.0, 1.0) + "v 0 0 -3\nv 0 0 3\n" + &sides(1).collect::<String>();
    let fish = body + "f 9 2 1\nf 9 3 2\nf 9 4 3\nf 9 1 4\nf 10 5 6\nf 10 6 7\nf 10 7 8\nf 10 8 5\n";
    let tower = ring(-3.0, 1.0)
        + &ring(1.0, 1.0)
        + "v 0 0 3\n"
        + &sides(1).collect::<String>()
        + "f 4 3 2 1\nf 9 5 6\nf 9 6 7\nf 9 7 8\nf 9 8 5\n";
    for (name, text, is_told) in [("fish.obj", &fish, false), ("tower.obj", &tower, true)] {
        fs::write(folder.join(name), text).unwrap();
        let told = done(folder, &["info", name]);
        assert_eq!(told.contains("--up z"), is_told, "{name}: {told}");
    }
}

/// Places between surfaces: the nearest one is meant, and one that is far away is told.
#[test]
fn probe_finds_the_surface_that_a_point_is_on() {
    let folder = folder();
    let folder = folder.path();
    let shelf = "[[shapes]]\nname = \"shelf\"\ntype = \"box\"\nmin = [-0.1, -1.9999, -0.1]\nmax = [0.1, -1.9998, 0.1]\nmaterial = \"white\"\n";
    let text = ball("white", POINT).replace("[[lights]]", &format!("{shelf}[[lights]]"));
    fs::write(folder.join("a.toml"), text).unwrap();
    let probe = |at: &str| {
        let output = run(
            folder,
            &[
                &["probe", "a.toml", "--from", at, "-q", "--estimators", "photon-map", "--batches", "1"],
                &QUICK[4..],
            ]
            .concat(),
        );
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        (stdout(&output).lines().nth(1).unwrap().split(',').nth(1).unwrap().to_owned(), stderr(&output))
    };
    // All of them are nearer to one another than the lift.
    assert_eq!(probe("0,-2,0"), ("\"floor\"".to_owned(), String::new()));
    assert_eq!(probe("0,-1.9998,0"), ("\"shelf\"".to_owned(), String::new()));
    assert_eq!(probe("3,-2,0"), ("\"floor\"".to_owned(), String::new()));
    let (object, told) = probe("3,-1.5,0");
    assert!(
        object == "\"floor\"" && told.contains("1 of 1 points lie more than") && told.contains("`floor`"),
        "{told}"
    );
}

#[cfg(unix)]
#[test]
fn what_cannot_be_written_is_said_in_words() {
    let folder = folder();
    let folder = folder.path();
    fs::write(folder.join("a.toml"), ball("white", POINT)).unwrap();
    let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    for more in [
        &["info", "a.toml"][..],
        &["info", "a.toml", "--json"],
        &["probe", "a.toml", "--from", "3,-2,0", "--estimators", "photon-map", "--batches", "1"],
    ] {
        let output = program(folder).args(more).stdout(full()).output().unwrap();
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains("error: cannot write to standard output: No space left"), "{told}");
    }
    // A limit of the size of files is an error of the write, and ends nothing.
    let output = std::process::Command::new("sh")
        .args(["-c", "ulimit -f 1; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_cardioid")])
        .args(["render", "a.toml", "-o", "a.exr", "--spp", "1", "--photons", "2000"])
        .current_dir(folder)
        .output()
        .unwrap();
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{:?} {told}", output.status);
    assert!(
        told.contains("cannot write a.exr") && told.contains("ulimit") && !told.contains("tmp"),
        "{told}"
    );
}
