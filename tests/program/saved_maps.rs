//! Photon maps in files, as a user meets them: the same picture to the bit, from another camera too, and refusals that say what
//! differs.

use crate::common;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;
use tempfile::TempDir;

fn run(folder: &TempDir, args: &[&str]) -> Output {
    common::run(folder.path(), args)
}

fn succeeds(folder: &TempDir, args: &[&str]) -> String {
    let output = run(folder, args);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{args:?}: {message}");
    message
}

#[track_caller]
fn refused(folder: &TempDir, args: &[&str], parts: &[&str]) {
    let output = run(folder, args);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{args:?}: {message}");
    assert!(message.starts_with("error: "), "{message}");
    parts.iter().for_each(|part| assert!(message.contains(part), "no `{part}` in {message}"));
}

fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).display().to_string()
}

const PHOTONS: [&str; 4] = ["--global-photons", "3000", "--caustic-photons", "4000"];

fn render<'a>(scene: &'a str, output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["render", scene, "--spp", "2", "--cache-samples", "32", "-q", "-o", output];
    args.extend(PHOTONS);
    if !more.contains(&"--resolution") {
        args.extend(["--resolution", "40x32"]);
    }
    args.extend(more);
    args
}

fn picture(folder: &TempDir, name: &str) -> Vec<u8> {
    fs::read(folder.path().join(name)).unwrap()
}

fn stats(folder: &TempDir, name: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.path().join(name)).unwrap()).unwrap()
}

#[test]
fn a_map_that_is_read_gives_the_picture_of_one_that_is_traced() {
    let folder = tempfile::tempdir().unwrap();
    let spheres = scene("cornell-spheres.toml");
    let mut photons = vec!["photons", &spheres, "-o", "maps.photons", "--threads", "1"];
    photons.extend(PHOTONS);
    let message = succeeds(&folder, &photons);
    assert!(message.contains("wrote maps.photons"), "{message}");
    // From another camera too, and however the maps are read.
    let text = fs::read_to_string(&spheres).unwrap();
    let camera = text.find("eye = ").unwrap();
    let end = camera + text[camera..].find('\n').unwrap();
    let moved = format!("# Lines\n# before\n{}eye = [150.0, 400.0, -700.0]{}", &text[..camera], &text[end..]);
    fs::write(folder.path().join("moved.toml"), moved).unwrap();
    for (number, (scene, more)) in [
        (spheres.as_str(), &[][..]),
        ("moved.toml", &["--resolution", "30x20"]),
        ("moved.toml", &["--global-nearest", "40", "--kernel", "constant", "--threads", "1"]),
        (
            &spheres,
            &["--precomputed-irradiance", "false", "--irradiance-cache", "false", "--gather-samples", "2"],
        ),
        (&spheres, &["--guide", "photons", "--irradiance-cache", "false"]),
        (&spheres, &["--integrator", "photons", "--map", "caustic"]),
        (&spheres, &["--integrator", "path", "--guide", "photons"]),
        (&spheres, &["--shadow-photons", "bounded", "--crop", "3,4,20,25"]),
    ]
    .into_iter()
    .enumerate()
    {
        let more: Vec<&str> = more.to_vec();
        let (traced, read) = (format!("traced-{number}.png"), format!("read-{number}.png"));
        succeeds(&folder, &render(scene, &traced, &[&more[..], &["--stats", "traced.json"]].concat()));
        let with_map = [&more[..], &["--photon-map", "maps.photons", "--stats", "read.json"]].concat();
        succeeds(&folder, &render(scene, &read, &with_map));
        assert!(picture(&folder, &traced) == picture(&folder, &read), "{scene} {more:?}");
        let (traced, read) = (stats(&folder, "traced.json"), stats(&folder, "read.json"));
        // Eight bits a channel hide much; counts do not.
        assert_eq!(traced["counters"], read["counters"], "{more:?}");
        assert_eq!(traced["cache"], read["cache"], "{more:?}");
        assert!(traced["photon_map_file"].is_null());
        assert_eq!(read["photon_map_file"]["file"], "maps.photons");
        for (a, b) in traced["maps"].as_array().unwrap().iter().zip(read["maps"].as_array().unwrap()) {
            assert_eq!(b["from_file"], true);
            assert_eq!(b["seconds_tracing"], 0.0);
            assert_eq!((&a["photons"], &a["emitted"]), (&b["photons"], &b["emitted"]));
            // Fluxes go by way of decimal numbers.
            assert_eq!(a["lights"][0]["bounces"], b["lights"][0]["bounces"]);
        }
    }
    // Irradiance comes along where it would be precomputed the same.
    let from_file = |json: &str| stats(&folder, json)["photon_map_file"]["irradiance"].as_bool().unwrap();
    succeeds(&folder, &render(&spheres, "a.png", &["--photon-map", "maps.photons", "--stats", "a.json"]));
    let other = ["--photon-map", "maps.photons", "--stats", "b.json", "--global-nearest", "40"];
    succeeds(&folder, &render(&spheres, "b.png", &other));
    assert!(from_file("a.json") && !from_file("b.json"));
}

#[test]
fn photons_of_another_scene_or_other_settings_are_refused_with_what_differs() {
    let folder = tempfile::tempdir().unwrap();
    let spheres = scene("cornell-spheres.toml");
    let mut photons = vec!["photons", &spheres, "-o", "maps.photons", "-q"];
    photons.extend(PHOTONS);
    succeeds(&folder, &photons);
    let with_map = ["--photon-map", "maps.photons"];
    let text = fs::read_to_string(&spheres).unwrap();
    assert!(text.contains("reflectance = [0.63, 0.065, 0.05]"));
    fs::write(folder.path().join("red.toml"), text.replace("[0.63, 0.065, 0.05]", "[0.64, 0.065, 0.05]"))
        .unwrap();
    refused(
        &folder,
        &render("red.toml", "a.exr", &with_map),
        &["maps.photons", "materials", "`cardioid photons`"],
    );
    for (more, parts) in [
        (["--seed", "7"], ["--seed 0", "--seed 7"]),
        (["--max-depth", "9"], ["--max-depth 10000", "--max-depth 9"]),
        (["--aim-photons", "false"], ["--aim-photons true", "--aim-photons false"]),
    ] {
        refused(&folder, &render(&spheres, "a.exr", &[&with_map[..], &more].concat()), &parts);
    }
    let mut args = vec!["render", &spheres, "--global-photons", "5k", "-q", "-o", "a.exr"];
    args.extend(with_map);
    refused(&folder, &args, &["--global-photons 3000", "--caustic-photons 4000", "--global-photons 5000"]);
    refused(
        &folder,
        &render(&spheres, "a.exr", &[&with_map[..], &["--integrator", "path"]].concat()),
        &["reads no photon map"],
    );
    refused(&folder, &render(&spheres, "a.exr", &["--photon-map", "none"]), &["none", "cannot be read"]);
    refused(&folder, &render(&spheres, "a.exr", &["--photon-map", "."]), &["not a regular file"]);
    refused(
        &folder,
        &render(&spheres, "a.exr", &["--photon-map", "red.toml"]),
        &["is not a file of photon maps"],
    );
    // A scene of which no caustic map was made.
    let diffuse = scene("cornell-diffuse.toml");
    refused(
        &folder,
        &render(&diffuse, "a.exr", &with_map),
        &["the scene (it was made for `cornell-spheres`)"],
    );
    // Neither scene nor map is overwritten.
    refused(&folder, &["photons", "red.toml", "-o", "red.toml"], &["would overwrite"]);
    refused(&folder, &["photons", &spheres, "-o", "nowhere/a.photons"], &["nowhere/a.photons"]);
    refused(&folder, &["photons", &spheres, "-o", "/dev/full"], &["/dev/full", "device"]);
    let bytes = fs::read(folder.path().join("maps.photons")).unwrap();
    for sixteenth in 0..16 {
        fs::write(folder.path().join("cut.photons"), &bytes[..bytes.len() * sixteenth / 16]).unwrap();
        refused(&folder, &render(&spheres, "a.exr", &["--photon-map", "cut.photons"]), &["cut.photons"]);
        let mut flipped = bytes.clone();
        flipped[bytes.len() * sixteenth / 16 + 5] ^= 0x10;
        fs::write(folder.path().join("cut.photons"), &flipped).unwrap();
        let part = if sixteenth == 0 { "is not a file of photon maps" } else { "is damaged" };
        refused(
            &folder,
            &render(&spheres, "a.exr", &["--photon-map", "cut.photons"]),
            &["cut.photons", part],
        );
    }
    assert!(!folder.path().join("a.exr").exists() && !folder.path().join("a.png").exists());
}

#[test]
fn the_same_photons_give_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let spheres = scene("cornell-spheres.toml");
    let maps = |threads: &str, name: &str| {
        let mut args = vec!["photons", &spheres, "-q", "--threads", threads, "-o", name];
        args.extend(PHOTONS);
        succeeds(&folder, &args);
        let bytes = fs::read(folder.path().join(name)).unwrap();
        // Seconds are in the description; the maps come after it.
        let start = bytes.windows(4).position(|name| name == b"GLOB").unwrap();
        bytes[start..].to_vec()
    };
    assert!(maps("1", "a.photons") == maps("2", "b.photons"));
}
