//! The program as a user meets it: messages, exit codes, files, signals.

use crate::common::{self, program, stderr, stdout};
use cardioid::image_io::{self, MetadataValue};
#[cfg(unix)]
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

/// A run in `folder`.
fn run(folder: &TempDir, args: &[&str]) -> Output {
    common::run(folder.path(), args)
}

/// Fails with `code` and a message that holds all of `parts`; writes nothing, and shows no trace of the code.
#[track_caller]
fn assert_fails(folder: &TempDir, args: &[&str], code: i32, parts: &[&str]) {
    let before = names_in(folder.path());
    let start = Instant::now();
    let output = run(folder, args);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{args:?}: no `{part}` in: {message}");
    }
    assert!(message.starts_with("error: "), "{args:?}: {message}");
    assert!(!message.contains("panicked") && !message.contains("src/"), "{args:?}: {message}");
    assert_plain(&message);
    assert_eq!(names_in(folder.path()), before, "{args:?}");
    // Said at once, not after a render.
    assert!(start.elapsed() < Duration::from_secs(20), "{args:?} took {:?}", start.elapsed());
}

/// No control characters: somebody reads this in a file.
#[track_caller]
fn assert_plain(text: &str) {
    let odd = text.chars().find(|c| c.is_control() && *c != '\n');
    assert!(odd.is_none(), "{odd:?} in {text:?}");
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Quick settings for a picture of 24 x 20.
const QUICK: [&str; 9] = [
    "--resolution",
    "24x20",
    "--spp",
    "2",
    "--global-photons",
    "2000",
    "--caustic-photons",
    "2000",
    "--quiet",
];

fn render_args<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["render", scene];
    args.extend(QUICK);
    args.extend(more);
    args
}

fn spheres() -> String {
    scene("cornell-spheres.toml").display().to_string()
}

#[test]
fn wrong_command_lines() {
    let folder = folder();
    let spheres = spheres();
    for (more, parts) in [
        (["--no-such-option", "1"], ["--no-such-option", "--help"]),
        (["--spp", "0"], ["--spp", "0"]),
        (["--spp", "many"], ["--spp", "many"]),
        (["--spp", "1.5"], ["1.5", "write 2"]),
        (["--global-photons", "1e400"], ["1e400", "500k"]),
        (["--resolution", "0x5"], ["--resolution", "WIDTHxHEIGHT"]),
        (["--resolution", "640"], ["640", "WIDTHxHEIGHT"]),
        (["--crop", "1,2,3"], ["--crop", "X0,Y0,X1,Y1"]),
        (["--crop", "5,5,5,9"], ["--crop", "X0 < X1"]),
        (["--set", "novalue"], ["--set", "NAME=VALUE"]),
        (["--quality", "finel"], ["finel", "final"]),
        (["--integrator", "photon"], ["photon", "photon-map"]),
        (["--time-limit", "0s"], ["--time-limit", "30s"]),
        (["--time-limit", "5 weeks"], ["5 weeks", "30s"]),
        (["--cone-k", "0.5"], ["0.5", "from 1 to 1000"]),
        (["--threads", "-1"], ["'-1' for '--threads", "from 1 to 1024"]),
    ] {
        let mut args = vec!["render", spheres.as_str()];
        args.extend(more);
        assert_fails(&folder, &args, 2, &parts);
    }
    assert_fails(&folder, &["rendr", &spheres], 2, &["rendr", "render"]);
    assert_fails(&folder, &["render"], 2, &["SCENE"]);
    assert_fails(&folder, &["compare", "a.exr"], 2, &["TEST"]);
}

/// Whatever is written for a value, the message names the option, the value and what is allowed.
#[test]
fn wrong_values_of_every_option() {
    let folder = folder();
    let spheres = spheres();
    let words = ["big", "", "nan", "inf", "-inf", "-1", "-1e30", "1,5", "0x10", "--quiet"];
    let of = |extra: &[&'static str]| -> Vec<&'static str> { words.iter().chain(extra).copied().collect() };
    let without = |left_out: &[&str]| -> Vec<&'static str> {
        words.iter().filter(|word| !left_out.contains(word)).copied().collect()
    };
    let stops: Vec<&str> = of(&["1e30"]).into_iter().filter(|word| *word != "-1").collect();
    for (command, option, values, allowed) in [
        ("render", "--exposure", stops, "from -100 to 100"),
        ("render", "--threads", of(&["1e30", "5000", "1.5"]), "from 1 to 1024"),
        ("render", "--spp", of(&["0", "1e30"]), ""),
        ("render", "--seed", of(&["1e30"]), "from 0 to 18446744073709551615"),
        ("render", "--seed", vec!["1.5"], "write 2"),
        ("render", "--global-photons", of(&["1e30", "0.5"]), "write "),
        ("render", "--caustic-photons", of(&["1e30"]), "write a whole number"),
        ("render", "--photons", of(&["1e30"]), "write a whole number"),
        ("render", "--photons-memory", of(&["0", "1e30", "5", "0MB", "10 PB"]), "500MB"),
        ("render", "--memory-limit", of(&["0", "1e30", "12", "-5GB"]), "500MB"),
        ("render", "--texture-memory", of(&["0", "1e30"]), "500MB"),
        ("render", "--global-radius", of(&["0"]), "metres above 0"),
        ("render", "--caustic-radius", of(&["0"]), "metres above 0"),
        ("render", "--cone-k", of(&["0", "0.99", "1001"]), "from 1 to 1000"),
        ("render", "--caustic-reuse", of(&["1.01", "1e30"]), "from 0 to 1"),
        ("render", "--accurate-distance", of(&["2"]), "from 0 to 1"),
        ("render", "--approximate-weight", of(&["2"]), "from 0 to 1"),
        ("render", "--cache-error", of(&["0", "2"]), "from 0.01 to 1"),
        ("render", "--cache-samples", of(&["0", "3", "1e30"]), ""),
        ("render", "--gather-samples", of(&["0", "1e30"]), ""),
        ("render", "--glossy-samples", of(&["0"]), ""),
        ("render", "--light-samples", of(&["0"]), ""),
        ("render", "--max-depth", of(&["0"]), ""),
        ("render", "--rounds", of(&["0"]), ""),
        ("render", "--target-error", of(&["0", "1e30"]), "for example 0.02"),
        ("render", "--time-limit", of(&["0", "0s", "1e30", "5 weeks", "1e-9s"]), "30s"),
        ("render", "--resolution", of(&["0x0", "100000x5", "5x"]), "WIDTHxHEIGHT"),
        ("render", "--crop", of(&["0", "1,2,3", "5,5,5,5"]), "X0,Y0,X1,Y1"),
        ("render", "--aim-photons", without(&[]), "true"),
        ("render", "--quality", of(&["0"]), "preview"),
        ("render", "--kernel", of(&["0"]), "epanechnikov"),
        ("render", "--set", without(&[]), "NAME=VALUE"),
        ("probe", "--from", of(&["0", "1,2"]), "three numbers"),
        ("probe", "--samples", of(&["0"]), ""),
        ("probe", "--lift", of(&["0"]), "metres"),
        ("tradeoff", "--seeds", of(&["0", "101", "1.5"]), "from 1 to 100"),
        ("tradeoff", "--time-budget", of(&["0"]), "30s"),
        // A list.
        ("tradeoff", "--knobs", without(&["1,5"]), "caustic-nearest"),
    ] {
        for value in values {
            let output = run(&folder, &[command, &spheres, option, value]);
            let message = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{option} {value}: {message}");
            let named = format!("invalid value '{value}' for '{option}");
            let is_empty = value.is_empty() && message.contains(option);
            assert!(message.contains(&named) || is_empty, "{option} {value}: {message}");
            let says_how = message.contains(allowed)
                && ["write ", "must be", "is not a whole number", "possible values", "the knobs are"]
                    .iter()
                    .any(|words| message.contains(words));
            assert!(says_how || value.is_empty(), "{option} {value}: {message}");
            assert!(!message.contains("float literal") && !message.contains("invalid digit"), "{message}");
        }
    }
    for value in ["0", "1", "many", "-1"] {
        let output = run(&folder, &["validate", "--seeds", value]);
        assert_eq!(output.status.code(), Some(2), "{value}");
        assert!(stderr(&output).contains("--seeds"), "{}", stderr(&output));
    }
    assert_eq!(names_in(folder.path()), [""; 0]);
}

/// One mistake is one message, and no number is longer than it was written.
#[test]
fn messages_say_what_is_wrong_once() {
    let folder = folder();
    let grey = "[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n";
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("typo.toml", &format!("[[shapes]]\ntype = \"sphere\"\nraduis = 1\nmaterial = \"m\"\n{grey}"));
    let message = stderr(&run(&folder, &["info", "typo.toml"]));
    assert_eq!(message.matches("typo.toml:").count(), 1, "{message}");
    assert!(message.contains("typo.toml:3:1") && message.contains("did you mean `radius`?"), "{message}");

    write(
        "box.toml",
        &format!("[[shapes]]\ntype = \"box\"\nmin = [0, 3, 0]\nmax = [1, 2, 1]\nmaterial = \"m\"\n{grey}"),
    );
    assert_fails(&folder, &["info", "box.toml"], 1, &["`min` is 3 in y and `max` is 2", "exchange"]);
    write(
        "flat.toml",
        &format!("[[shapes]]\ntype = \"box\"\nmin = [0, 2, 0]\nmax = [1, 2, 1]\nmaterial = \"m\"\n{grey}"),
    );
    assert_fails(&folder, &["info", "flat.toml"], 1, &["`min` is 2 in y and `max` is 2", "quad"]);

    write("letter.toml", &"Dear reader, = this is [no scene\n".repeat(40));
    let message = stderr(&run(&folder, &["info", "letter.toml"]));
    assert!(message.matches("not TOML").count() <= 3 && message.contains("more"), "{message}");

    let knot = scene("meshes/knot.ply").display().to_string();
    let message = stderr(&run(&folder, &["render", &knot, "--memory-limit", "10MB"]));
    assert!(message.contains("--memory-limit") && !message.contains("  "), "{message}");
    // The parts are all there is.
    let numbers = |text: &str| -> Vec<u64> {
        let words: Vec<&str> = text.split([' ', ',', ';']).collect();
        words.windows(2).filter(|pair| pair[1] == "MB").filter_map(|pair| pair[0].parse().ok()).collect()
    };
    let (whole, parts) = message.split_once(": ").unwrap().1.split_once(": ").unwrap();
    let sum: u64 = numbers(parts.split("; and").next().unwrap()).iter().sum();
    assert!(numbers(whole)[0].abs_diff(sum) <= 3, "{message}");

    let spheres = spheres();
    let output = run(&folder, &["info", &spheres, "--caustic-reuse", "0.2", "--cache-error", "0.3"]);
    assert!(
        stdout(&output).contains(" 0.2\n") && !stdout(&output).contains("0.20000"),
        "{}",
        stdout(&output)
    );
    let output = run(&folder, &["info", &spheres, "--caustic-reuse", "0.2", "--json"]);
    assert!(stdout(&output).contains("\"caustic-reuse\": 0.2,"), "{}", stdout(&output));
}

/// Lights with their power, textures, groups and surfaces, by name; and in JSON what was approximated.
#[test]
fn info_lists_what_a_scene_holds() {
    let folder = folder();
    let wood = [200u8; 48];
    cardioid::image_io::write_png(
        folder.path().join("wood.png"),
        4,
        4,
        cardioid::image_io::PngPixels::Rgb8(&wood),
    )
    .unwrap();
    let text = "[textures.wood]\ntype = \"image\"\nfile = \"wood.png\"\n[materials.oak]\ntype = \"lambert\"\n\
                reflectance = { texture = \"wood\" }\n[[shapes]]\nname = \"table\"\ntype = \"quad\"\ncorner = [0, 0, 0]\n\
                edge-u = [1, 0, 0]\nedge-v = [0, 0, -1]\nmaterial = \"oak\"\n[[shapes]]\nname = \"bulb\"\ntype = \"sphere\"\n\
                radius = 0.1\nemission = { lumens = 800 }\ngroup = \"lamp\"\n[[instances]]\ngroup = \"lamp\"\n\
                [[instances]]\ngroup = \"lamp\"\ntransform = [{ translate = [1, 1, 0] }]\n";
    fs::write(folder.path().join("table.toml"), text).unwrap();
    let told = stdout(&run(&folder, &["info", "table.toml"]));
    for part in [
        "area light, sphere, 1.1713 1.1713 1.1713 W, 800 lm\n",
        "  texture    colour of oak: 4 x 4 pixels, ",
        "  group      lamp: 1 shape(s), 2 instance(s)\n",
        "  surface    0 table",
    ] {
        assert!(told.contains(part), "no `{part}` in {told}");
    }
    let told = stdout(&run(&folder, &["info", "table.toml", "--json"]));
    let value: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(value["lights"].as_array().unwrap().len(), 2, "{told}");
    assert!((value["lights"][0]["lumens"].as_f64().unwrap() - 800.0).abs() < 0.1, "{told}");
    assert_eq!(value["textures"][0]["slot"], "colour");
    assert_eq!(value["groups"][0]["instances"], 2);
    assert_eq!(value["surfaces"][0]["materials"][0], "oak");
    let xml = "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><emitter type=\"constant\"/>\
               <shape type=\"sphere\"><bsdf type=\"roughplastic\"/></shape></scene>";
    fs::write(folder.path().join("a.xml"), xml).unwrap();
    let told = stdout(&run(&folder, &["info", "a.xml", "--json"]));
    let value: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert!(!value["notes"].as_array().unwrap().is_empty(), "{told}");
}

/// What a medium is: its density, its mean free path in metres, its optical depth through the middle of its body, and what it takes.
#[test]
fn info_tells_of_media() {
    let folder = folder();
    let text = "unit = \"cm\"\n[media.air2]\nabsorption = [0.5, 0.25, 0.25]\nfills = \"bounds\"\n[media.air2.density]\n\
                type = \"noise\"\nmin = [0, 0, 0]\nmax = [8, 4, 2]\nsize = 9\nlow = -4\nhigh = -3\nfactor = 2\n\
                [media.tea]\nior = 1.33\nabsorption = 0.01\n[media.fog]\nvisibility = 100\ng = 0.5\n\
                density = { type = \"height\", base = 1e6, scale-height = 1 }\n[materials.fog]\ntype = \"dielectric\"\n\
                inside = \"fog\"\n[[shapes]]\ntype = \"sphere\"\nradius = 50\nmaterial = \"fog\"\n";
    fs::write(folder.path().join("media.toml"), text).unwrap();
    let told = stdout(&run(&folder, &["info", "media.toml"]));
    for part in [
        "air2: noise, up to 1, mean free path 0.01 0.02 0.02 m, optical depth 8 4 2 through its middle along x, y, z, 0.",
        "tea: clear, index 1.33, mean free path 1 m\n",
        "fog: falls with height, mean free path 0.2556 m, optical depth 3.912 3.912 3.912 through",
    ] {
        assert!(told.contains(part), "no `{part}` in {told}");
    }
    let told = stdout(&run(&folder, &["info", "media.toml", "--json"]));
    assert!(told.contains("\"optical_depth\": [") && told.contains("\"voxels\": null"), "{told}");
}

/// A window of a picture knows its place: viewers show it there, and it is compared with that part of the whole.
#[test]
fn a_window_has_its_place_in_the_whole_picture() {
    let folder = folder();
    let spheres = spheres();
    let ok = |args: &[&str]| {
        let output = run(&folder, args);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
        stdout(&output)
    };
    ok(&render_args(&spheres, &["-o", "whole.exr"]));
    ok(&render_args(&spheres, &["-o", "part.exr", "--crop", "3,4,20,19"]));
    let part = image_io::read(folder.path().join("part.exr")).unwrap();
    assert_eq!((part.width, part.height), (17, 15));
    assert_eq!(part.window, Some(image_io::Window { x: 3, y: 4, full_width: 24, full_height: 20 }));
    assert_eq!(image_io::read(folder.path().join("whole.exr")).unwrap().window, None);
    // In the bytes, as other programs read them: from the first to the last pixel.
    let bytes = fs::read(folder.path().join("part.exr")).unwrap();
    let window = |name: &[u8]| {
        let start = bytes.windows(name.len()).position(|found| found == name).unwrap() + name.len();
        let number = |i: usize| i32::from_le_bytes(bytes[start + 4 * i..][..4].try_into().unwrap());
        // Its length comes first.
        [number(1), number(2), number(3), number(4)]
    };
    assert_eq!(window(b"dataWindow\0box2i\0"), [3, 4, 19, 18]);
    assert_eq!(window(b"displayWindow\0box2i\0"), [0, 0, 23, 19]);
    for pair in [["whole.exr", "part.exr"], ["part.exr", "part.exr"]] {
        let table = ok(&["compare", pair[0], pair[1], "--aov", "direct"]);
        assert!(
            table
                .lines()
                .nth(1)
                .unwrap()
                .split_whitespace()
                .skip(1)
                .all(|n| ["0", "-", "+0.000", "%"].contains(&n)),
            "{table}"
        );
    }
    assert_fails(&folder, &["compare", "part.exr", "whole.exr"], 1, &["whole.exr"]);
}

/// Photons shown directly have all light in one layer, which is not what that layer is elsewhere.
#[test]
fn layers_that_do_not_mean_the_same_are_not_compared() {
    let folder = folder();
    let spheres = spheres();
    for (name, more) in [
        ("path.exr", &["--integrator", "path"][..]),
        ("map.exr", &[]),
        ("photons.exr", &["--integrator", "photons"]),
        ("classes.exr", &["--integrator", "photons", "--show", "classes"]),
    ] {
        let output = run(&folder, &render_args(&spheres, &[&["-o", name], more].concat()));
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    }
    let layers =
        |name: &str| image_io::read(folder.path().join(name)).unwrap().metadata("cardioid/layers").cloned();
    assert_eq!(layers("map.exr"), Some(MetadataValue::from("by-path")));
    assert_eq!(layers("photons.exr"), Some(MetadataValue::from("global-photons")));
    for layer in ["indirect", "direct"] {
        assert_fails(
            &folder,
            &["compare", "path.exr", "photons.exr", "--aov", layer],
            1,
            &[
                "path.exr",
                "photons.exr",
                layer,
                "do not mean the same",
                "all of it in `indirect`",
                "without --aov",
            ],
        );
    }
    assert_fails(&folder, &["compare", "path.exr", "classes.exr"], 1, &["classes.exr", "discs"]);
    for args in [
        &["compare", "path.exr", "photons.exr"][..],
        &["compare", "path.exr", "photons.exr", "--aov", "albedo"],
        &["compare", "path.exr", "map.exr", "--aov", "indirect"],
    ] {
        assert_eq!(run(&folder, args).status.code(), Some(0), "{args:?}");
    }
}

#[test]
fn wrong_scenes() {
    let folder = folder();
    assert_fails(&folder, &render_args("missing.toml", &[]), 1, &["missing.toml"]);
    assert_fails(&folder, &["info", "missing.toml"], 1, &["missing.toml"]);
    let place = folder.path().display().to_string();
    assert_fails(&folder, &render_args(&place, &[]), 1, &[&place, "folder"]);
    let unreadable = folder.path().join("locked.toml");
    fs::write(&unreadable, "name = \"x\"").unwrap();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(&unreadable, fs::Permissions::from_mode(0o000)).unwrap();
        // Whoever may read everything can read this as well.
        if fs::read(&unreadable).is_err() {
            assert_fails(&folder, &render_args("locked.toml", &[]), 1, &["locked.toml", "ermission"]);
        } else {
            println!("skipped: this user may read every file");
        }
    }
    for (name, text, parts) in [
        ("empty.toml", "", ["empty.toml", "[[shapes]]"]),
        ("broken.toml", "name = ", ["broken.toml:1:", "1"]),
        (
            "typo.toml",
            "nmae = \"x\"\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"m\"\n[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n",
            ["typo.toml:1:1", "name"],
        ),
        (
            "mesh.toml",
            "[[shapes]]\ntype = \"mesh\"\nfile = \"gone.ply\"\nmaterial = \"m\"\n[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n",
            ["mesh.toml:3:", "gone.ply"],
        ),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
        assert_fails(&folder, &render_args(name, &[]), 1, &parts);
    }
    let emitter = |faces: &str| {
        format!(
            "[[shapes]]\ntype = \"mesh\"\nname = \"lamp\"\nmaterial = \"m\"\nemission = {{ radiance = 1.0 }}\n\
             vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1000, 0, 0], [1000.0000000001, 0, 0], [1000, 1e-9, 0]]\n\
             faces = {faces}\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"m\"\n[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n"
        )
    };
    // A lamp that rounding leaves nothing of is an error; one that loses a part, a warning.
    // Something finer has the origin of render space, which would else go to the lamp.
    let finer = "[[shapes]]\ntype = \"sphere\"\nradius = 1e-12\nmaterial = \"m\"\n";
    fs::write(folder.path().join("lost.toml"), emitter("[[3, 4, 5]]") + finer).unwrap();
    assert_fails(&folder, &["info", "lost.toml"], 1, &["lost.toml:1:", "lamp", "none of its 1 triangle"]);
    fs::write(folder.path().join("part.toml"), emitter("[[0, 1, 2], [3, 4, 5]]")).unwrap();
    let output = run(&folder, &["info", "part.toml"]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(message.contains("part.toml:1:") && message.contains("lamp: 1 of the 2 triangles"), "{message}");
    fs::write(folder.path().join("binary.toml"), [0xff, 0xfe, 0x00, 0x41]).unwrap();
    assert_fails(&folder, &render_args("binary.toml", &[]), 1, &["binary.toml", "UTF-8"]);
    // Parameters: unknown ones with the nearest name, bad values with the place.
    let mesh = scene("mesh.toml").display().to_string();
    assert_fails(&folder, &render_args(&mesh, &["--set", "mehs=a.ply"]), 1, &["mehs", "mesh"]);
    assert_fails(&folder, &render_args(&mesh, &["--set", "mesh=gone.ply"]), 1, &["gone.ply"]);
    assert_fails(&folder, &render_args(&mesh, &["--set", "normals=smoth"]), 1, &["smoth", "smooth"]);
}

#[test]
fn wrong_outputs_are_told_before_rendering() {
    let folder = folder();
    let spheres = spheres();
    fs::create_dir(folder.path().join("taken.exr")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/dev/full", folder.path().join("full.exr")).unwrap();
        std::os::unix::fs::symlink("nowhere/a.png", folder.path().join("lost.png")).unwrap();
    }
    for (name, parts) in [
        ("nowhere/a.exr", ["nowhere", "does not exist"]),
        ("/proc/a.exr", ["/proc/a.exr", "takes no new files"]),
        ("full.exr", ["full.exr", "device"]),
        ("lost.png", ["lost.png", "folder that does not exist"]),
        ("a.jpg", ["a.jpg", ".exr or .png"]),
        ("a", ["a", ".exr or .png"]),
        ("taken.exr", ["taken.exr", "folder"]),
    ] {
        // Were it told afterwards, the time limit would tell.
        let args = ["render", &spheres, "--spp", "4096", "--time-limit", "30s", "--quiet", "-o", name];
        assert_fails(&folder, &args, 1, &parts);
    }
    let scene = folder.path().join("scene.toml");
    fs::copy(&spheres, &scene).unwrap();
    for (stats, parts) in [
        ("nowhere/s.json", ["nowhere", "does not exist"]),
        ("/dev/full", ["/dev/full", "device"]),
        // The statistics in the place of a picture, or of the scene.
        ("a.exr", ["a.exr", "would overwrite"]),
        ("./a.png", ["a.png", "would overwrite"]),
        ("scene.toml", ["scene.toml", "would overwrite"]),
    ] {
        let args =
            ["render", "scene.toml", "--spp", "4096", "--time-limit", "30s", "-o", "a.exr", "--stats", stats];
        assert_fails(&folder, &args, 1, &parts);
    }
    assert_eq!(fs::read(&scene).unwrap(), fs::read(&spheres).unwrap());
    let crop =
        ["render", &spheres, "--spp", "4096", "--time-limit", "30s", "-o", "a.exr", "--crop", "0,0,257,256"];
    assert_fails(&folder, &crop, 1, &["0,0 to 257,256", "256 x 256"]);
}

/// A machine without OpenImageIO: scenes are read, and a render stops at once.
#[cfg(unix)]
#[test]
fn a_missing_library_is_told_before_rendering() {
    let folder = folder();
    // What the loader finds first is no library.
    for version in ["2.4", "2.5", "3.0", "3.1", "3.2"] {
        fs::write(folder.path().join(format!("libOpenImageIO.so.{version}")), "none").unwrap();
    }
    let run = |args: &[&str]| {
        let mut command = program(folder.path());
        command.current_dir(folder.path()).env("LD_LIBRARY_PATH", folder.path()).args(args).output().unwrap()
    };
    let before = names_in(folder.path());
    let start = Instant::now();
    let output = run(&[
        "render",
        &spheres(),
        "--integrator",
        "path",
        "--spp",
        "1000000",
        "-o",
        "a.exr",
        "--time-limit",
        "30s",
    ]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("OpenImageIO cannot be loaded") && message.contains("install it"), "{message}");
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    assert_eq!(names_in(folder.path()), before);
    assert_eq!(run(&["compare", "a.exr", "b.exr"]).status.code(), Some(1));
    assert_eq!(run(&["info", &spheres()]).status.code(), Some(0));
}

#[test]
fn a_render_writes_what_it_says() {
    let folder = folder();
    let spheres = spheres();
    let mut args = render_args(&spheres, &["-o", "out.exr", "--stats", "stats.json", "--seed", "7"]);
    args.retain(|arg| *arg != "--quiet");
    let output = run(&folder, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(stdout(&output), "");
    assert_plain(&stderr(&output));
    for part in ["wrote out.exr", "wrote out.png", "photons of", "2 samples per pixel"] {
        assert!(stderr(&output).contains(part), "no `{part}` in {}", stderr(&output));
    }
    assert_eq!(names_in(folder.path()), ["out.exr", "out.png", "stats.json"]);

    let image = image_io::read(folder.path().join("out.exr")).unwrap();
    assert_eq!((image.width, image.height), (24, 20));
    for name in [
        "", "emission", "direct", "specular", "caustics", "indirect", "albedo", "normal", "depth", "object",
        "material",
    ] {
        let layer = image.layer(name).unwrap_or_else(|| panic!("no layer `{name}`"));
        assert_eq!(layer.data.len(), layer.channels.len() * 480, "{name}");
    }
    let text = |name: &str| match image.metadata(name) {
        Some(MetadataValue::Text(text)) => text.clone(),
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(text("cardioid/scene"), "cornell-spheres");
    assert_eq!(text("cardioid/version"), env!("CARGO_PKG_VERSION"));
    assert_eq!(text("cardioid/sceneHash").len(), 64);
    assert!(text("cardioid/embree").contains('.'));
    // Every number in the layers of ids has a name.
    for (key, layer) in [("cardioid/objects", "object"), ("cardioid/materials", "material")] {
        let names: Value = serde_json::from_str(&text(key)).unwrap();
        let ids = &image.layers.iter().find(|found| found.name == layer).unwrap().data;
        assert!(ids.iter().any(|id| *id >= 0.0));
        for id in ids.iter().filter(|id| **id >= 0.0) {
            assert!(names[id.to_string()].is_string(), "{layer} {id} in {names}");
        }
    }
    let settings: Value = serde_json::from_str(&text("cardioid/settings")).unwrap();
    assert_eq!((&settings["seed"], &settings["spp"]), (&7.into(), &2.into()));
    let plan: Value = serde_json::from_str(&text("cardioid/plan")).unwrap();
    assert_eq!(plan["caustic_map"]["build"], true);

    let png = image_io::read(folder.path().join("out.png")).unwrap();
    assert_eq!((png.width, png.height), (24, 20));
    assert!(png.layers[0].data.iter().any(|&v| v > 0.0));

    let stats: Value = serde_json::from_slice(&fs::read(folder.path().join("stats.json")).unwrap()).unwrap();
    assert_eq!(stats["schema"], 2);
    for field in [
        "scene",
        "settings",
        "plan",
        "times",
        "threads",
        "samples",
        "maps",
        "irradiance_bytes",
        "counters",
        "mean_depth",
        "rejected_samples",
        "warnings",
    ] {
        assert!(!stats[field].is_null(), "no `{field}`");
    }
    assert_eq!(stats["samples"], 2);
    assert_eq!(stats["counters"]["camera_rays"], 2 * 480);
    let maps = stats["maps"].as_array().unwrap();
    assert_eq!(
        maps.iter().map(|map| map["map"].as_str().unwrap()).collect::<Vec<_>>(),
        ["global", "caustic"]
    );
    for map in maps {
        assert!(
            map["photons"].as_u64().unwrap() > 1000
                && map["emitted"].as_u64() >= map["photons"].as_u64().map(|n| n / 10)
        );
        let light = &map["lights"][0];
        for channel in 0..3 {
            let flux = |name: &str| light[name][channel].as_f64().unwrap();
            let accounted = flux("flux_absorbed") + flux("flux_escaped") + flux("flux_truncated");
            assert!((flux("flux_emitted") / accounted - 1.0).abs() < 1e-6, "{light}");
        }
    }

    // The same again over the old files; a window; a PNG alone; another seed.
    let again = run(&folder, &args);
    assert_eq!(again.status.code(), Some(0));
    assert_eq!(image_io::read(folder.path().join("out.exr")).unwrap().layers, image.layers);
    let output = run(
        &folder,
        &render_args(&spheres, &["-o", "part.exr", "--seed", "7", "--crop", "3,4,20,19", "--threads", "1"]),
    );
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), ""));
    let part = image_io::read(folder.path().join("part.exr")).unwrap();
    assert_eq!((part.width, part.height), (17, 15));
    let pixel = |image: &image_io::Image, x: usize, y: usize| {
        image.layer("").unwrap().pixel(y * image.width as usize + x).unwrap().to_vec()
    };
    assert_eq!(pixel(&part, 5, 6), pixel(&image, 8, 10));
    let output = run(&folder, &render_args(&spheres, &["-o", "alone.png", "--beauty-only"]));
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), ""));
    assert!(!folder.path().join("alone.exr").exists());
}

#[test]
fn info_prints_the_plan() {
    let folder = folder();
    let output = run(&folder, &["info", &spheres()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_plain(&stdout(&output));
    for part in [
        "cornell-spheres",
        "256 x 256",
        "area light",
        "global photon map",
        "caustic photon map",
        "2 specular surface(s)",
        "Embree",
        "spp",
    ] {
        assert!(stdout(&output).contains(part), "no `{part}` in {}", stdout(&output));
    }
    let plain = run(&folder, &["info", &scene("cornell-diffuse.toml").display().to_string()]);
    assert!(stdout(&plain).contains("no specular surface, so there are no caustics"), "{}", stdout(&plain));
    let output = run(&folder, &["info", &spheres(), "--json", "--integrator", "path"]);
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["settings"]["integrator"], "path");
    assert_eq!(value["plan"]["global_map"]["build"], false);
}

#[test]
fn compare_runs() {
    let folder = folder();
    let reference = |name: &str| {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/reference/cornell-diffuse")
            .join(name)
            .display()
            .to_string()
    };
    let (first, second) = (reference("reference-1.exr"), reference("reference-2.exr"));
    let args = ["compare", &first, "--second-half", &second, &first, "--json"];
    let output = run(&folder, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(rows[0]["relmse"].as_f64().unwrap() < 1e-3, "{rows}");
    let table = stdout(&run(&folder, &["compare", &first, &second, "--difference", "map.png"]));
    assert!(table.contains("relmse") && table.contains("reference-2.exr"), "{table}");
    assert_eq!(names_in(folder.path()), ["map.png"]);
    assert_fails(&folder, &["compare", &first, "gone.exr"], 1, &["gone.exr"]);
    let map = fs::read(folder.path().join("map.png")).unwrap();
    let over = ["compare", &first, "map.png", "--difference", "./map.png"];
    assert_fails(&folder, &over, 1, &["map.png", "would overwrite"]);
    assert_eq!(fs::read(folder.path().join("map.png")).unwrap(), map);
    assert_fails(&folder, &["compare", &first, &second, "--aov", "caustics"], 1, &["caustics", "it has"]);
    run(&folder, &render_args(&spheres(), &["-o", "small.exr"]));
    assert_fails(&folder, &["compare", &first, "small.exr"], 1, &["small.exr", "24"]);
}

/// A render that would take hours, and what it wrote so far once it is stopped.
struct Long {
    folder: TempDir,
    child: Child,
}

impl Long {
    fn start(more: &[&str]) -> Self {
        let folder = folder();
        let mut command = program(folder.path());
        command
            .current_dir(folder.path())
            .args(["render", &spheres(), "--integrator", "path", "--spp", "1000000", "-o", "long.exr"])
            .args(["--resolution", "128x128", "--stats", "stats.json"])
            .args(more)
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        Self { child: command.spawn().unwrap(), folder }
    }

    #[cfg(unix)]
    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits, and returns the exit code and what was said. Ends the program itself where it does not end.
    fn wait(&mut self) -> (Option<i32>, String) {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            if start.elapsed() > Duration::from_secs(60) {
                self.child.kill().unwrap();
                panic!("not stopped after a minute");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        let mut message = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
        (status.code(), message)
    }

    /// The picture is there, readable and not black, and the statistics tell how far it came.
    #[track_caller]
    fn assert_written(&self, message: &str) {
        assert!(message.contains("stopped early") && message.contains("of 1000000"), "{message}");
        assert_plain(message);
        let image = image_io::read(self.folder.path().join("long.exr")).unwrap();
        assert!(image.layer("").unwrap().data.iter().any(|&v| v > 0.0));
        let stats: Value =
            serde_json::from_slice(&fs::read(self.folder.path().join("stats.json")).unwrap()).unwrap();
        let samples = stats["samples"].as_u64().unwrap();
        assert!((1..1_000_000).contains(&samples), "{samples}");
        assert_eq!(names_in(self.folder.path()), ["long.exr", "long.png", "stats.json"]);
    }
}

#[cfg(unix)]
#[test]
fn signals_stop_with_a_picture() {
    for (signal, exit) in [(Signal::INT, 130), (Signal::TERM, 143)] {
        let mut long = Long::start(&[]);
        std::thread::sleep(Duration::from_secs(3));
        long.signal(signal);
        let (code, message) = long.wait();
        assert_eq!(code, Some(exit), "{signal:?}: {message}");
        assert!(message.contains("stopping; what is there will be written"), "{message}");
        long.assert_written(&message);
    }
}

#[test]
fn a_time_limit_stops_with_a_picture() {
    let start = Instant::now();
    let mut long = Long::start(&["--time-limit", "1s"]);
    let (code, message) = long.wait();
    assert_eq!(code, Some(0), "{message}");
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    long.assert_written(&message);
}

/// A limit that comes during pass 1 leaves half of the time to the pixels, and what that costs is told.
#[test]
fn a_time_limit_during_the_photon_pass() {
    let folder = folder();
    let spheres = spheres();
    let mut args = vec!["render", &spheres, "--time-limit", "2s", "--resolution", "24x20", "--spp", "1"];
    args.extend(["--global-photons", "4000000", "--caustic-photons", "8000000", "--quiet"]);
    args.extend(["-o", "a.exr", "--stats", "stats.json"]);
    let start = Instant::now();
    let output = run(&folder, &args);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(start.elapsed() < Duration::from_secs(40), "{:?}", start.elapsed());
    assert!(message.contains("caustic photons of the 8000000 asked for"), "{message}");
    let stats: Value = serde_json::from_slice(&fs::read(folder.path().join("stats.json")).unwrap()).unwrap();
    let caustic = &stats["maps"][1];
    assert_eq!((caustic["asked"].as_u64(), caustic["stopped"].as_bool()), (Some(8_000_000), Some(true)));
    let photons = caustic["photons"].as_u64().unwrap();
    assert!((1..7_000_000).contains(&photons), "{photons}");
    assert_eq!(names_in(folder.path()), ["a.exr", "a.png", "stats.json"]);
}

/// Stopped by hand during pass 1 there is no picture, which is said; the numbers so far are written.
#[cfg(unix)]
#[test]
fn a_signal_during_the_photon_pass() {
    let folder = folder();
    let mut args = vec!["--global-photons", "20000000", "-o", "a.exr", "--stats", "stats.json"];
    let spheres = spheres();
    args.splice(0..0, ["render", &spheres]);
    let child =
        program(folder.path()).args(args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut long = Long { child, folder };
    std::thread::sleep(Duration::from_secs(3));
    long.signal(Signal::INT);
    let (code, message) = long.wait();
    assert_eq!(code, Some(130), "{message}");
    assert!(message.contains("stopped before the first pixel: there is no picture"), "{message}");
    assert_eq!(names_in(long.folder.path()), ["stats.json"]);
}

#[test]
fn photons_that_do_not_fit_are_refused() {
    let folder = folder();
    let spheres = spheres();
    let args = ["render", &spheres, "--global-photons", "1000000000000", "-o", "a.exr"];
    assert_fails(&folder, &args, 1, &["1000000000000 photons in the global map", "--global-photons"]);
    for (memory, part) in [("lots", "500MB"), ("5", "500MB"), ("-1GB", "500MB")] {
        let memory = format!("--photons-memory={memory}");
        assert_fails(&folder, &["render", &spheres, &memory], 2, &[part]);
    }
    // Two maps of a megabyte together, in the proportion of the preset.
    let mut args = vec!["render", &spheres, "--photons-memory", "1MB", "--resolution", "24x20", "--spp", "1"];
    args.extend(["--quiet", "-o", "a.exr", "--stats", "stats.json"]);
    let output = run(&folder, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let stats: Value = serde_json::from_slice(&fs::read(folder.path().join("stats.json")).unwrap()).unwrap();
    let bytes: u64 = (0..2).map(|map| stats["maps"][map]["bytes"].as_u64().unwrap()).sum();
    let bytes = bytes + stats["irradiance_bytes"].as_u64().unwrap();
    assert!(bytes.abs_diff(1_000_000) < 110_000, "{bytes}");
    let asked = |map: usize| stats["maps"][map]["asked"].as_u64().unwrap();
    assert!((asked(0) * 5 / 2).abs_diff(asked(1)) <= 5, "{} and {}", asked(0), asked(1));
}

#[test]
fn projection_maps_are_drawn() {
    let folder = folder();
    let spheres = spheres();
    let output = run(&folder, &["info", &spheres, "--projection-maps", "."]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let picture = image_io::read(folder.path().join("0-light.png")).unwrap();
    let data = &picture.layers[0].data;
    // Orange where the balls are, blue where only walls are.
    let pixels = data.len() / 3;
    let orange = data.chunks_exact(3).filter(|pixel| pixel[0] > pixel[2]).count();
    assert!(orange * 20 > pixels && orange * 2 < pixels, "{orange} of {pixels}");
    assert_fails(
        &folder,
        &["info", &spheres, "--projection-maps", "nowhere"],
        1,
        &["nowhere", "make it first"],
    );
}

/// A mesh alone is a scene: the same picture as by `scenes/mesh.toml`, whatever the form of the file.
#[test]
fn a_mesh_alone_renders() {
    let folder = folder();
    let knot = scene("meshes/knot.ply").display().to_string();
    let mesh_scene = scene("mesh.toml").display().to_string();
    let ok = |args: &[&str]| {
        let output = run(&folder, args);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
        stderr(&output)
    };
    ok(&render_args(&knot, &["-o", "alone.exr"]));
    ok(&render_args(&mesh_scene, &["--set", &format!("mesh={knot}"), "-o", "scene.exr"]));
    let beauty =
        |name: &str| image_io::read(folder.path().join(name)).unwrap().layer("").unwrap().data.clone();
    assert_eq!(beauty("alone.exr"), beauty("scene.exr"));

    // A tower along z, red by its materials; and what is wrong with files beside it.
    let tower = "mtllib tower.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 3\nusemtl red\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    fs::write(folder.path().join("tower.obj"), tower).unwrap();
    fs::write(folder.path().join("tower.mtl"), "newmtl red\nKd 0.9 0 0\n").unwrap();
    let told = ok(&render_args("tower.obj", &["-o", "lying.exr"]));
    assert!(told.contains("--up z"), "{told}");
    let told = ok(&render_args("tower.obj", &["-o", "standing.exr", "--up", "z"]));
    assert_eq!(told, "");
    assert_ne!(beauty("lying.exr"), beauty("standing.exr"));
    let albedo =
        image_io::read(folder.path().join("standing.exr")).unwrap().layer("albedo").unwrap().data.clone();
    assert!(albedo.chunks(3).any(|rgb| rgb[0] > 0.85 && rgb[1] == 0.0 && rgb[2] == 0.0));
    ok(&render_args("tower.obj", &["-o", "clay.exr", "--up", "z", "--set", "materials=one"]));
    let albedo =
        image_io::read(folder.path().join("clay.exr")).unwrap().layer("albedo").unwrap().data.clone();
    assert!(!albedo.chunks(3).any(|rgb| rgb[0] > 0.85));

    fs::remove_file(folder.path().join("tower.mtl")).unwrap();
    let told = ok(&render_args("tower.obj", &["-o", "bare.exr", "--up", "z"]));
    assert!(told.contains("tower.mtl") && told.contains("`red`"), "{told}");
    fs::write(folder.path().join("broken.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    assert_fails(
        &folder,
        &render_args("broken.obj", &[]),
        1,
        &["broken.obj:2: 2 is not one of the 1 vertices"],
    );
    fs::write(folder.path().join("empty.stl"), "solid e\nendsolid e\n").unwrap();
    assert_fails(&folder, &render_args("empty.stl", &[]), 1, &["empty.stl: no triangles"]);
    assert_fails(&folder, &render_args("gone.stl", &[]), 1, &["no mesh file", "gone.stl"]);
    let spheres = spheres();
    assert_fails(&folder, &render_args(&spheres, &["--up", "z"]), 1, &["--up is for a mesh alone"]);
}

#[test]
fn bench_bvh_writes_a_table_and_a_plot() {
    let folder = folder();
    let knot = scene("meshes/knot.ply").display().to_string();
    let args = ["bench", "bvh", &knot, "--rays", "1000", "--runs", "1", "--check", "50", "-o", "out"];
    let output = run(&folder, &args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).contains("| Embree, robust |"), "{}", stdout(&output));
    assert_plain(&stdout(&output));
    assert_eq!(names_in(&folder.path().join("out")), ["knot.json", "knot.md", "knot.svg"]);
    assert_fails(&folder, &["bench", "bvh", "a.toml"], 1, &["a.toml", ".ply, .obj or .stl"]);
}

#[test]
fn help_and_version() {
    let folder = folder();
    let version = run(&folder, &["--version"]);
    assert_eq!(stdout(&version).trim(), format!("cardioid {}", env!("CARGO_PKG_VERSION")));
    for args in [vec!["--help"], vec!["render", "--help"], vec!["info", "--help"], vec!["compare", "--help"]]
    {
        let output = run(&folder, &args);
        assert_eq!(output.status.code(), Some(0));
        assert!(stdout(&output).contains("Usage"));
        assert_plain(&stdout(&output));
    }
    // Nothing at all asked for: the help, as an error.
    assert_eq!(run(&folder, &[]).status.code(), Some(2));
}

#[test]
fn rounds_are_kept_and_gone_on_with() {
    let folder = folder();
    let spheres = spheres();
    let args = |more: &[&'static str]| -> Vec<String> {
        let fixed = ["--integrator", "progressive", "--checkpoint", "kept", "--stats", "s.json"];
        render_args(&spheres, &fixed).into_iter().chain(more.iter().copied()).map(str::to_owned).collect()
    };
    let shoot = |more: &[&'static str]| {
        let args = args(more);
        run(&folder, &args.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let output = shoot(&["--rounds", "2", "--adaptive", "-o", "a.exr"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("--adaptive has no effect"), "{}", stderr(&output));
    let output = shoot(&["--rounds", "4", "--adaptive", "--resume", "kept", "-o", "b.exr"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let statistics: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("s.json")).unwrap()).unwrap();
    assert_eq!(statistics["rounds"]["done"], 4);
    assert_eq!(statistics["rounds"]["resumed"], 2);
    assert!(statistics["process"]["cpu"].as_f64().unwrap() > 0.0);
    let image = image_io::read(folder.path().join("b.exr")).unwrap();
    assert_eq!(image.metadata("cardioid/rounds"), Some(&MetadataValue::Double(4.0)));
    assert!(image.layer("bias").is_some());
    assert_fails(
        &folder,
        &render_args(&spheres, &["--integrator", "progressive", "--resume", "kept", "--seed", "3"]),
        1,
        &["kept", "seed was 0 and is 3"],
    );
    assert_fails(
        &folder,
        &render_args(&spheres, &["--checkpoint", "other"]),
        1,
        &["--integrator progressive"],
    );
    assert_fails(
        &folder,
        &render_args(&spheres, &["--integrator", "path", "--target-error", "0.1"]),
        1,
        &["--integrator progressive", "--target-error"],
    );
}

#[test]
fn a_small_sweep_and_the_same_again() {
    let folder = folder();
    let spheres = spheres();
    let sweep = || {
        run(
            &folder,
            &[
                "tradeoff",
                &spheres,
                "--resolution",
                "16x12",
                "--seeds",
                "2",
                "--around",
                "draft",
                "--knobs",
                "spp,kernel",
                "--reference-time",
                "1s",
                "-o",
                "out",
            ],
        )
    };
    let output = sweep();
    assert!(output.status.success(), "{}", stderr(&output));
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let csv = read("tradeoff.csv");
    // The point, half and twice the samples, three other kernels.
    assert_eq!(csv.lines().count(), 1 + 6, "{csv}");
    for line in csv.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), 16, "{line}");
        // Seconds and errors.
        for cell in &cells[5..7] {
            assert!(cell.parse::<f64>().unwrap() > 0.0, "{line}");
        }
        assert!(cells[9].parse::<f64>().unwrap() > 0.0 && cells[11].parse::<f64>().unwrap() > 0.0, "{line}");
    }
    assert!(csv.lines().skip(1).any(|line| line.split(',').nth(13) == Some("1")), "{csv}");
    let html = read("report.html");
    assert_eq!(html.matches("data:image/png;base64,iVBOR").count(), 7);
    for outside in ["http://", "https://", "src=\"", "href="] {
        let found = html.matches(outside).count();
        // The name of SVG's language is no address that anything is loaded from.
        assert_eq!(found, usize::from(outside == "http://"), "{outside}");
    }
    assert!(read("tradeoff.svg").starts_with("<svg") && read("tradeoff.md").contains("kernel"));
    // Nothing is rendered again.
    let runs = folder.path().join("out/runs");
    let times = || -> Vec<_> {
        names_in(&runs)
            .iter()
            .map(|name| fs::metadata(runs.join(name)).unwrap().modified().unwrap())
            .collect()
    };
    let before = times();
    assert_eq!(before.len(), 3 * (2 + 2 * 6));
    assert!(sweep().status.success());
    assert_eq!(times(), before);
    assert_eq!(read("tradeoff.csv"), csv);
    assert_fails(&folder, &["tradeoff", &spheres, "--knobs", "sp"], 2, &["sp", "caustic-nearest"]);
}
