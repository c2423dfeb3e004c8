//! Photon atlas, brick maps and irradiance atlas, from the command line to the picture.

use cardioid::image_io;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cardioid"))
        .current_dir(folder)
        .stdin(Stdio::null())
        .args(arguments)
        .output()
        .unwrap()
}

fn run_well(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {words}");
    String::from_utf8_lossy(&output.stdout).into_owned() + &words
}

fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && !words.contains("panicked"), "{arguments:?}: {words}");
    words
}

fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).display().to_string()
}

/// Mean over a layer of a picture.
fn mean(path: &Path, layer: &str) -> f64 {
    let image = image_io::read(path).unwrap();
    let layer = image.layers.iter().find(|found| found.name == layer).unwrap();
    layer.data.iter().map(|&x| f64::from(x)).sum::<f64>() / layer.data.len() as f64
}

fn bytes_of(folder: &Path, extension: &str) -> Vec<(String, Vec<u8>)> {
    let mut found: Vec<(String, Vec<u8>)> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|found| found == extension))
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(&path).unwrap()))
        .collect();
    found.sort();
    found
}

#[test]
fn an_atlas_from_photons_to_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = scene("cornell-diffuse.toml");
    let few = ["--global-photons", "20000", "-q"];
    let photons = |atlas: &str, more: &[&str]| {
        run_well(folder, &[&["photons", &scene, "--atlas", atlas], &few[..], more].concat())
    };
    photons("a", &["--threads", "1"]);
    // Neither threads nor memory change a bit, nor does a folder that holds an atlas already.
    photons("b", &["--threads", "3", "--sort-memory", "170kB"]);
    photons("b", &["--threads", "2", "--sort-memory", "170kB"]);
    assert!(
        bytes_of(&folder.join("a"), "photons") == bytes_of(&folder.join("b"), "photons"),
        "photons differ"
    );
    // Nothing else is left there.
    let names = |atlas: &str| fs::read_dir(folder.join(atlas)).unwrap().count();
    assert_eq!(names("b"), bytes_of(&folder.join("b"), "photons").len() + 1);
    fs::create_dir(folder.join("discs")).unwrap();
    run_well(folder, &["bricks", &scene, "--atlas", "a", "-q", "--threads", "1", "--discs", "discs"]);
    run_well(folder, &["bricks", &scene, "--atlas", "b", "-q", "--threads", "3"]);
    assert!(bytes_of(&folder.join("a"), "bricks") == bytes_of(&folder.join("b"), "bricks"), "bricks differ");
    assert_eq!(bytes_of(&folder.join("discs"), "ply").len(), bytes_of(&folder.join("a"), "bricks").len());
    let shown = run_well(folder, &["bricks", &scene, "--atlas", "a", "--inspect"]);
    assert!(shown.contains("level") && shown.contains("bricks"), "{shown}");
    let shown: Value =
        serde_json::from_str(&run_well(folder, &["bricks", &scene, "--atlas", "a", "--inspect", "--json"]))
            .unwrap();
    assert!(
        shown[0]["levels"][0]["bricks"] == 1 && shown[0]["levels"][0]["voxels"].as_u64().unwrap() > 0,
        "{shown}"
    );

    // The same picture for every cache and number of threads.
    let picture = ["--resolution", "32x24", "--spp", "4", "-q"];
    let render = |name: &str, more: &[&str]| {
        let stats = format!("{name}.json");
        let name = format!("{name}.exr");
        run_well(folder, &[&["render", &scene, "-o", &name, "--stats", &stats], &picture[..], more].concat());
        let json: Value = serde_json::from_slice(&fs::read(folder.join(stats)).unwrap()).unwrap();
        (image_io::read(folder.join(name)).unwrap(), json)
    };
    let (first, statistics) = render("cache", &["--atlas", "a", "--threads", "2"]);
    let atlas = &statistics["atlas"];
    assert!(
        atlas["bricks"].as_u64().unwrap() > 5 && atlas["hit_percent"].as_f64().unwrap() > 50.0,
        "{atlas}"
    );
    assert!(statistics["maps"].as_array().unwrap().is_empty(), "no photons are traced");
    for (budget, threads) in [("0", "1"), ("20kB", "3"), ("1MB", "5")] {
        let (other, statistics) =
            render("other", &["--atlas", "a", "--brick-cache", budget, "--threads", threads]);
        let layers = |image: &image_io::Image| {
            image
                .layers
                .iter()
                .map(|layer| layer.data.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        };
        assert!(layers(&first) == layers(&other), "{budget}, {threads} threads");
        let lookups = &statistics["atlas"]["lookups"];
        let count = |key: &str| lookups[key].as_u64().unwrap();
        assert_eq!(
            count("looked_up"),
            count("resident") + count("last_used") + count("cached") + count("missed"),
            "{lookups}"
        );
    }

    // What does not belong together is refused, with the file and what to do.
    let own = ["render", &scene, "-o", "no.exr", "--resolution", "8x8", "--spp", "1", "-q", "--atlas"];
    let other = self::scene("cornell-spheres.toml");
    let foreign = ["render", &other, "-o", "no.exr", "-q", "--atlas", "a"];
    assert!(refusal(folder, &foreign).contains("make it again with `cardioid photons`"));
    assert!(refusal(folder, &[&own[..], &["nowhere"]].concat()).contains("nowhere/bricks.json"));
    assert!(
        refusal(folder, &[&own[..], &["a", "--integrator", "path"]].concat()).contains("leave out --atlas")
    );
    let map = bytes_of(&folder.join("a"), "bricks")[0].0.clone();
    let map = folder.join("a").join(map);
    let sound = fs::read(&map).unwrap();
    fs::write(&map, &sound[..sound.len() / 2]).unwrap();
    assert!(refusal(folder, &[&own[..], &["a"]].concat()).contains("is incomplete"));
    let mut damaged = sound.clone();
    *damaged.last_mut().unwrap() ^= 1;
    fs::write(&map, &damaged).unwrap();
    assert!(refusal(folder, &["bricks", &scene, "--atlas", "a", "--inspect"]).contains("is damaged: brick"));
    // While it is rendered: every brick that the largest map has beyond its middle.
    fs::write(&map, &sound).unwrap();
    let files = bytes_of(&folder.join("a"), "bricks");
    let (name, large) = files.iter().max_by_key(|(_, bytes)| bytes.len()).unwrap();
    let damaged: Vec<u8> =
        large.iter().enumerate().map(|(i, byte)| byte ^ u8::from(i > large.len() / 2)).collect();
    fs::write(folder.join("a").join(name), damaged).unwrap();
    assert!(refusal(folder, &[&own[..], &["a"]].concat()).contains("is damaged: brick"));
    fs::write(folder.join("a").join(name), large).unwrap();
    let shown = ["--integrator", "photons", "--map", "global", "-o", "shown.exr"];
    let shown: Vec<&str> = ["render", &scene, "--atlas", "a", "--resolution", "32x24", "--spp", "1", "-q"]
        .into_iter()
        .chain(shown)
        .collect();
    run_well(folder, &shown);
    assert!(mean(&folder.join("shown.exr"), "indirect") > 0.01);
    fs::remove_file(&map).unwrap();
    assert!(refusal(folder, &[&own[..], &["a"]].concat()).contains(".bricks: cannot be read"));
    let group = bytes_of(&folder.join("b"), "photons")[0].0.clone();
    let group = folder.join("b").join(group);
    let mut damaged = fs::read(&group).unwrap();
    damaged[500] ^= 1;
    fs::write(&group, &damaged).unwrap();
    let words = refusal(folder, &["bricks", &scene, "--atlas", "b", "-q"]);
    assert!(words.contains("is damaged: its block 0") && words.contains("cardioid photons"), "{words}");
    assert!(!folder.join("no.exr").exists());
}

/// The picture agrees with that of maps in memory.
#[test]
fn an_atlas_shows_the_light_of_maps_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = scene("cornell-diffuse.toml");
    let photons = ["--global-photons", "60000", "-q"];
    run_well(folder, &[&["photons", &scene, "--atlas", "a"], &photons[..]].concat());
    run_well(folder, &["bricks", &scene, "--atlas", "a", "-q"]);
    let render = |name: &str, more: &[&str]| {
        let picture = ["--resolution", "64x48", "--spp", "16"];
        run_well(folder, &[&["render", &scene, "-o", name], &picture[..], &photons[..], more].concat());
    };
    render("memory.exr", &["--stats", "memory.json"]);
    // The same photons, counted.
    let json =
        |file: &str| -> Value { serde_json::from_slice(&fs::read(folder.join(file)).unwrap()).unwrap() };
    let (statistics, description) = (json("memory.json"), json("a/photons.json"));
    for key in ["photons", "emitted"] {
        assert_eq!(statistics["maps"][0][key], description[key], "{key}");
    }
    render("atlas.exr", &["--atlas", "a"]);
    for (layer, most) in [("direct", 1e-6), ("indirect", 0.02), ("", 0.01)] {
        let [memory, atlas] = ["memory.exr", "atlas.exr"].map(|name| mean(&folder.join(name), layer));
        println!("{layer}: {atlas} {memory} {:+.2} %", 100.0 * (atlas / memory - 1.0));
        assert!((atlas / memory - 1.0).abs() < most, "{layer}: {atlas} {memory}");
    }
}

/// A run that is stopped or killed leaves nothing that looks like an atlas.
#[test]
fn an_interrupted_run_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = scene("cornell-diffuse.toml");
    for (signal, code) in [(rustix::process::Signal::INT, Some(130)), (rustix::process::Signal::KILL, None)] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder)
            .args(["photons", &scene, "--atlas", "a", "--global-photons", "1e9", "-q"])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // The folder is made when tracing begins.
        while !folder.join("a").exists() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
        rustix::process::kill_process(rustix::process::Pid::from_child(&child), signal).unwrap();
        assert_eq!(child.wait().unwrap().code(), code);
        assert_eq!(fs::read_dir(folder.join("a")).unwrap().count(), 0, "{signal:?}");
        fs::remove_dir(folder.join("a")).unwrap();
    }
    assert!(refusal(folder, &["bricks", &scene, "--atlas", "a", "-q"]).contains("a/photons.json"));
}
