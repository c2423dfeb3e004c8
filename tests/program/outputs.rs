//! What a run does to files: none that it reads is replaced, and nothing that goes wrong beside the picture costs the picture.

use crate::common::{program, run, stderr};
use cardioid::image_io::{self, Image, Layer, PngPixels};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Names and content of all files of a folder.
fn content(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.path().is_file())
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}

/// Fails, names both files, and leaves every file as it was.
#[track_caller]
fn assert_refused(folder: &Path, args: &[&str], parts: &[&str]) {
    let before = content(folder);
    let output = run(folder, args);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{args:?}: {message}");
    for part in parts.iter().chain(&["would overwrite"]) {
        assert!(message.contains(part), "{args:?}: no `{part}` in: {message}");
    }
    assert_eq!(content(folder), before, "{args:?}");
}

#[track_caller]
fn assert_done(folder: &Path, args: &[&str]) -> String {
    let output = run(folder, args);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", stderr(&output));
    stderr(&output)
}

const TINY: &str = r#"
[camera]
eye = [0, 1, 3]
at = [0, 0.5, 0]
[film]
width = 8
height = 8
[render]
quality = "draft"
spp = 1
global-photons = 200
caustic-photons = 200
[materials.w]
type = "lambert"
reflectance = 0.7
[materials.g]
type = "dielectric"
ior = 1.5
[[shapes]]
type = "quad"
corner = [-2, 0, 2]
edge-u = [4, 0, 0]
edge-v = [0, 0, -4]
material = "w"
[[shapes]]
type = "sphere"
center = [0, 0.6, 0]
radius = 0.5
material = "g"
[[lights]]
type = "point"
position = [0.5, 3, 0.5]
power = 60
"#;

const TRIANGLE_GLTF: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
 "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
 "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
  {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
 "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
 "buffers": [{"byteLength": 42, "uri": "model.exr"}],
 "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
 "textures": [{"source": 0}], "images": [{"uri": "model.png"}]}"#;

/// A folder with models whose files have the names that pictures of them would have.
fn models() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let png = |name: &str| image_io::write_png(at(name), 2, 2, PngPixels::Rgb8(&[200; 12])).unwrap();
    let write = |name: &str, text: &str| fs::write(at(name), text).unwrap();
    write("tiny.toml", TINY);
    write(
        "house.obj",
        "mtllib house.mtl\nv -1 0 0\nv 1 0 0\nv 1 2 0\nv -1 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wall\n\
         f 1/1 2/2 3/3 4/4\n",
    );
    write("house.mtl", "newmtl wall\nKd 1 1 1\nmap_Kd house.png\n");
    png("house.png");
    write("model.gltf", TRIANGLE_GLTF);
    png("model.png");
    let mut buffer: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|x| x.to_le_bytes()).collect();
    buffer.extend([0u8, 0, 1, 0, 2, 0]);
    fs::write(at("model.exr"), buffer).unwrap();
    write("studio.toml", &format!("{TINY}\n[[lights]]\ntype = \"environment\"\nimage = \"studio.exr\"\n"));
    let mut sky = Image::new(4, 2);
    sky.layers.push(Layer::new("", &["R", "G", "B"], vec![0.5; 24]));
    image_io::write_exr(at("studio.exr"), &sky).unwrap();
    folder
}

#[test]
fn no_file_that_a_scene_is_read_from_is_replaced() {
    let models = models();
    let folder = models.path();
    // By default names, and by names given.
    for (args, parts) in [
        (&["render", "house.obj"][..], &["house.png", "PNG beside"][..]),
        (&["render", "house.obj", "-o", "house.exr"], &["house.png"]),
        (&["render", "house.obj", "-o", "a.exr", "--stats", "house.mtl"], &["house.mtl", "--stats"]),
        (&["render", "house.obj", "-o", "./house.png"], &["./house.png would", "house.png, which"]),
        (&["render", "model.gltf"], &["model.exr"]),
        (&["render", "model.gltf", "-o", "model.png"], &["model.png"]),
        (&["render", "studio.toml"], &["studio.exr"]),
        (&["render", "studio.toml", "-o", "a.png", "--stats", "studio.exr"], &["studio.exr"]),
        (
            &[
                "render",
                "studio.toml",
                "--integrator",
                "progressive",
                "-o",
                "a.exr",
                "--checkpoint",
                "studio.exr",
            ],
            &["--checkpoint", "studio.exr"],
        ),
        (&["photons", "studio.toml", "-o", "studio.exr"], &["studio.exr", "photon map"]),
        (&["probe", "studio.toml", "--from", "0,0,0", "-o", "studio.exr"], &["studio.exr", "table"]),
        (&["bench", "caustic", "studio.toml", "-o", "studio.exr"], &["studio.exr", "plot"]),
        (&["bench", "caustic", "studio.toml", "-o", "studio.toml"], &["studio.toml", "plot"]),
    ] {
        assert_refused(folder, args, parts);
    }
    // What is not read may be replaced.
    assert_done(
        folder,
        &[
            "render",
            "house.obj",
            "-o",
            "model.exr",
            "--resolution",
            "8x8",
            "--quality",
            "draft",
            "--overwrite",
        ],
    );
}

#[cfg(unix)]
#[test]
fn links_to_files_that_are_read_are_known() {
    let models = models();
    let folder = models.path();
    let at = |name: &str| folder.join(name);
    fs::hard_link(at("studio.exr"), at("hard.exr")).unwrap();
    std::os::unix::fs::symlink("studio.exr", at("soft.exr")).unwrap();
    fs::hard_link(at("house.png"), at("other.png")).unwrap();
    fs::create_dir(at("sub")).unwrap();
    for name in ["hard.exr", "soft.exr", "sub/../studio.exr", ".//studio.exr"] {
        assert_refused(folder, &["render", "studio.toml", "-o", name], &[name, "studio.exr"]);
        assert_refused(
            folder,
            &["render", "studio.toml", "-o", "a.exr", "--stats", name],
            &[name, "studio.exr"],
        );
    }
    assert_refused(folder, &["render", "house.obj", "-o", "other.exr"], &["other.png", "house.png"]);
}

#[test]
fn no_file_that_was_given_is_replaced() {
    let models = models();
    let folder = models.path();
    let at = |name: &str| folder.join(name);
    assert_done(folder, &["photons", "tiny.toml", "-o", "kept.photons", "-q"]);
    fs::copy(at("kept.photons"), at("kept.png")).unwrap();
    assert_refused(
        folder,
        &["render", "tiny.toml", "--photon-map", "kept.png", "-o", "kept.exr"],
        &["kept.png", "PNG beside"],
    );
    assert_done(
        folder,
        &[
            "render",
            "tiny.toml",
            "--integrator",
            "progressive",
            "--rounds",
            "1",
            "--checkpoint",
            "r",
            "-q",
            "-o",
            "r.exr",
        ],
    );
    assert_refused(
        folder,
        &[
            "render",
            "tiny.toml",
            "--integrator",
            "progressive",
            "--rounds",
            "2",
            "--resume",
            "r",
            "--stats",
            "r",
        ],
        &["--stats", "r, which"],
    );
    fs::write(at("points.csv"), "0,0,0\n").unwrap();
    assert_refused(
        folder,
        &["probe", "tiny.toml", "--points", "points.csv", "-o", "points.csv"],
        &["points.csv"],
    );
    fs::copy(at("r.exr"), at("s.exr")).unwrap();
    fs::copy(at("r.png"), at("s.png")).unwrap();
    assert_refused(
        folder,
        &["compare", "r.png", "s.exr", "--difference", "r.png"],
        &["--difference", "r.png"],
    );
    fs::create_dir(at("t")).unwrap();
    let tradeoff = ["tradeoff", "tiny.toml", "--reference", "r.exr", "--second-half", "s.exr", "-o", "."];
    fs::copy(at("tiny.toml"), at("tradeoff.csv")).unwrap();
    assert_refused(
        folder,
        &[&["tradeoff", "tradeoff.csv", "-o", "."][..], &[][..]].concat(),
        &["tradeoff.csv"],
    );
    fs::copy(at("r.exr"), at("report.html")).unwrap();
    let mut args = tradeoff;
    args[3] = "report.html";
    assert_refused(folder, &args, &["report.html"]);
    // A mesh named as its report would be.
    fs::rename(at("house.mtl"), at("house.json")).unwrap();
    let obj = fs::read_to_string(at("house.obj")).unwrap().replace("house.mtl", "house.json");
    fs::write(at("house.obj"), obj).unwrap();
    assert_refused(folder, &["bench", "bvh", "house.obj", "--rays", "10", "-o", "."], &["house.json"]);
    assert_refused(
        folder,
        &["validate", "--seeds", "16", "-o", "v.md", "--json", "./v.md"],
        &["v.md", "--json"],
    );
}

/// Under names that the user did not choose only what cardioid wrote is replaced.
#[test]
fn default_names_replace_only_what_cardioid_wrote() {
    let models = models();
    let folder = models.path();
    let at = |name: &str| folder.join(name);
    assert_done(folder, &["render", "tiny.toml", "-q"]);
    let first = content(folder);
    let own_png = fs::read(at("tiny.png")).unwrap();
    // Its own pictures again.
    assert_done(folder, &["render", "tiny.toml", "-q", "--seed", "3"]);
    assert_ne!(content(folder), first);
    let mut photo = Image::new(1, 1);
    photo.layers.push(Layer::new("", &["R", "G", "B"], vec![0.5; 3]));
    for (name, bytes) in
        [("tiny.exr", b"not a picture".to_vec()), ("tiny.png", b"\x89PNG\r\n\x1a\nof others".to_vec())]
    {
        let own = fs::read(at(name)).unwrap();
        fs::write(at(name), &bytes).unwrap();
        assert_refused(
            folder,
            &["render", "tiny.toml", "-q"],
            &[name, "was not written by cardioid", "--overwrite"],
        );
        fs::write(at(name), own).unwrap();
    }
    image_io::write_exr(at("tiny.exr"), &photo).unwrap();
    assert_refused(folder, &["render", "tiny.toml", "-q"], &["tiny.exr"]);
    // A name that was given is meant; the PNG beside it was not named.
    assert_done(folder, &["render", "tiny.toml", "-q", "-o", "tiny.exr"]);
    fs::write(at("tiny.png"), "a photograph").unwrap();
    assert_refused(folder, &["render", "tiny.toml", "-q", "-o", "tiny.exr"], &["tiny.png"]);
    assert_done(folder, &["render", "tiny.toml", "-q", "-o", "tiny.png"]);
    fs::write(at("tiny.png"), "a photograph").unwrap();
    assert_done(folder, &["render", "tiny.toml", "-q", "--overwrite"]);
    assert_eq!(fs::read(at("tiny.png")).unwrap(), own_png);

    fs::write(at("tiny.photons"), "notes on light").unwrap();
    assert_refused(folder, &["photons", "tiny.toml", "-q"], &["tiny.photons"]);
    assert_done(folder, &["photons", "tiny.toml", "-q", "--overwrite"]);
    assert_done(folder, &["photons", "tiny.toml", "-q"]);
    fs::create_dir(at("tiny-tradeoff")).unwrap();
    fs::write(at("tiny-tradeoff/report.html"), "mine").unwrap();
    let output = run(folder, &["tradeoff", "tiny.toml", "-q"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("--overwrite"), "{}", stderr(&output));
    assert_eq!(fs::read(at("tiny-tradeoff/report.html")).unwrap(), b"mine");
}

/// Standard error on a full disk, or a pipe whose reader is gone, with warnings to tell.
#[cfg(unix)]
#[test]
fn messages_that_cannot_be_written_do_not_cost_the_picture() {
    let models = models();
    let folder = models.path();
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let warns =
        ["render", "tiny.toml", "--max-depth", "2", "--caustic-photons", "0", "-o", "p.exr", "--stats-table"];
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let closed = || Stdio::from(writer.try_clone().unwrap());
    let ways: [(Stdio, Stdio, i32); 4] = [
        (Stdio::null(), full().into(), 0),
        (full().into(), Stdio::null(), 1),
        (Stdio::null(), closed(), 0),
        (closed(), closed(), 0),
    ];
    for (out, err, code) in ways {
        let status = program(folder).args(warns).stdout(out).stderr(err).status().unwrap();
        assert_eq!(status.code(), Some(code));
        for name in ["p.exr", "p.png"] {
            assert!(image_io::read(folder.join(name)).is_ok(), "{name}");
            fs::remove_file(folder.join(name)).unwrap();
        }
    }
}

/// The folder of the checkpoint goes away while rounds go on, as a disk does that fills up.
#[test]
fn a_checkpoint_that_cannot_be_written_does_not_cost_the_picture() {
    let models = models();
    let folder = models.path();
    fs::create_dir(folder.join("disk")).unwrap();
    let child = program(folder)
        .args([
            "render",
            "tiny.toml",
            "--integrator",
            "progressive",
            "--rounds",
            "1000000",
            "--time-limit",
            "3s",
        ])
        .args(["--checkpoint", "disk/a.rounds", "-q", "-o", "p.exr", "--stats", "s.json"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(1500) {
        std::thread::sleep(Duration::from_millis(50));
    }
    fs::remove_dir_all(folder.join("disk")).unwrap();
    let output = child.wait_with_output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("disk/a.rounds") && message.contains("does not exist"), "{message}");
    assert!(image_io::read(folder.join("p.exr")).is_ok() && folder.join("s.json").exists());
}

/// What a killed process left is gone after the next run with the same output; so is what a killed `tradeoff` had started.
#[cfg(unix)]
#[test]
fn killed_processes_leave_nothing_for_long() {
    use rustix::process::{Pid, Signal, kill_process};
    let models = models();
    let folder = models.path();
    fs::write(folder.join(".p.exr.abcdef.cardioid.tmp"), "half a picture").unwrap();
    assert_done(folder, &["render", "tiny.toml", "-q", "-o", "p.exr"]);
    assert!(!folder.join(".p.exr.abcdef.cardioid.tmp").exists());

    let mut tradeoff = program(folder)
        .args([
            "tradeoff",
            "tiny.toml",
            "-q",
            "--reference-time",
            "60s",
            "--around",
            "draft",
            "--resolution",
            "64x64",
        ])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let log = |folder: &Path| {
        let runs = fs::read_dir(folder.join("tiny-tradeoff/runs")).ok()?;
        runs.flatten().find(|entry| entry.path().extension().is_some_and(|e| e == "log"))
    };
    let start = Instant::now();
    while log(folder).is_none() {
        assert!(start.elapsed() < Duration::from_secs(30));
        std::thread::sleep(Duration::from_millis(20));
    }
    let place = fs::canonicalize(folder).unwrap();
    // Whatever still runs in this folder.
    let running = || {
        let processes = fs::read_dir("/proc").unwrap().flatten();
        processes
            .filter(|entry| fs::read_link(entry.path().join("cwd")).is_ok_and(|cwd| cwd == place))
            .count()
    };
    while running() < 2 {
        assert!(start.elapsed() < Duration::from_secs(30), "no render was started");
        std::thread::sleep(Duration::from_millis(20));
    }
    kill_process(Pid::from_raw(i32::try_from(tradeoff.id()).unwrap()).unwrap(), Signal::KILL).unwrap();
    tradeoff.wait().unwrap();
    let start = Instant::now();
    while running() > 0 {
        assert!(start.elapsed() < Duration::from_secs(20), "a render outlived its tradeoff");
        std::thread::sleep(Duration::from_millis(50));
    }
}
