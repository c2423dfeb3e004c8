//! Files that are broken, of the wrong kind or not to be had, and signals at any time: clear errors, and nothing half-written
//! under its final name.

use crate::common::program;
use rustix::process::{Pid, Signal, kill_process};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// What a run said, which ended by itself with 0, or with 1 and an error that names `name`.
#[track_caller]
fn read_or_told(output: &Output, name: &str) -> bool {
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!message.contains("panicked"), "{name}: {message}");
    match output.status.code() {
        Some(0) => true,
        Some(1) => {
            assert!(message.contains("error: ") && message.contains(name), "{name}: {message}");
            false
        }
        other => panic!("{name}: ended with {other:?}, signal {:?}: {message}", output.status.signal()),
    }
}

fn info(folder: &Path, path: &Path) -> Output {
    program(folder).arg("info").arg(path).arg("--json").output().unwrap()
}

fn refused(folder: &Path, path: &Path, parts: &[&str]) {
    let start = Instant::now();
    let output = info(folder, path);
    let name = path.file_name().unwrap().to_string_lossy();
    assert!(!read_or_told(&output, &name), "{name} was taken");
    let message = String::from_utf8_lossy(&output.stderr);
    parts.iter().for_each(|part| assert!(message.contains(part), "no `{part}` in {message}"));
    assert!(start.elapsed() < Duration::from_secs(30), "{name}: {:?}", start.elapsed());
}

/// All of the collections of malformed files that have an ending of ours, where they lie beside the checkout.
#[test]
fn malformed_collections() {
    let mut folders = root().ancestors().map(|folder| folder.join("shared/assets/malformed"));
    let Some(collections) = folders.find(|folder| folder.is_dir()) else {
        println!("skipped: no folder shared/assets/malformed beside the checkout");
        return;
    };
    let work = folder();
    let (mut seen, mut taken) = (0, 0);
    let mut folders = vec![collections];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
            if path.is_dir() {
                folders.push(path);
            } else if ["ply", "obj", "stl"].iter().any(|known| extension == *known) {
                seen += 1;
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                taken += usize::from(read_or_told(&info(work.path(), &path), &name));
            }
        }
    }
    println!("{seen} files, {taken} taken");
    assert!(seen > 40 && taken > 5, "{seen}, {taken}");
}

/// A square of two triangles in each form.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let knot = fs::read(root().join("scenes/meshes/knot.ply")).unwrap();
    let ascii = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -4 -2 -1\n";
    let facet = |c: &str| format!("facet normal 0 0 1\nouter loop\n{c}\nendloop\nendfacet\n");
    let stl = format!(
        "solid a\n{}{}endsolid a\n",
        facet("vertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0"),
        facet("vertex 0 0 0\nvertex 1 1 0\nvertex 0 1 0")
    );
    let mut binary = vec![0; 80];
    binary.extend(2u32.to_le_bytes());
    for corners in [[0.0f32, 0.0, 1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0, 1.0]] {
        binary.extend([0; 12]);
        corners.chunks(2).for_each(|c| [c[0], c[1], 0.0].iter().for_each(|x| binary.extend(x.to_le_bytes())));
        binary.extend([0; 2]);
    }
    let scene = fs::read(root().join("scenes/cornell-spheres.toml")).unwrap();
    vec![
        ("knot.ply", knot),
        ("ascii.ply", ascii.into()),
        ("a.obj", obj.into()),
        ("ascii.stl", stl.into()),
        ("binary.stl", binary),
        ("a.toml", scene),
    ]
}

#[test]
fn truncation_at_every_sixteenth() {
    let work = folder();
    for (name, bytes) in samples() {
        let path = work.path().join(name);
        fs::write(&path, &bytes).unwrap();
        assert!(read_or_told(&info(work.path(), &path), name), "{name} is sound");
        for sixteenth in 0..16 {
            fs::write(&path, &bytes[..bytes.len() * sixteenth / 16]).unwrap();
            let taken = read_or_told(&info(work.path(), &path), name);
            // An OBJ and a scene may end after any line.
            assert!(!taken || matches!(name, "a.obj" | "a.toml"), "{name} at {sixteenth}/16");
        }
    }
}

#[test]
fn sixteen_gigabytes_declared_in_a_kilobyte() {
    let work = folder();
    let pad = |text: &str| [text.as_bytes(), &[b' '; 1024][..]].concat();
    let vertex = "element vertex 1400000000\nproperty float x\nproperty float y\nproperty float z\n";
    let faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    let mut stl = vec![0; 1024];
    stl[80..84].copy_from_slice(&340_000_000u32.to_le_bytes());
    let toml = "[materials.a]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"terrain\"\ncells = 4000000000\nmaterial = \"a\"\n";
    for (name, bytes) in [
        ("little.ply", pad(&format!("ply\nformat binary_little_endian 1.0\n{vertex}{faces}"))),
        ("big.ply", pad(&format!("ply\nformat binary_big_endian 1.0\n{vertex}{faces}"))),
        ("ascii.ply", pad(&format!("ply\nformat ascii 1.0\n{vertex}{faces}"))),
        ("binary.stl", stl),
        ("huge.toml", toml.as_bytes().to_vec()),
    ] {
        let path = work.path().join(name);
        fs::write(&path, bytes).unwrap();
        // With 3 GB of addresses: taking what is declared would fail at once.
        let command = format!("ulimit -v 3000000; exec '{}' info '{name}'", env!("CARGO_BIN_EXE_cardioid"));
        let output = Command::new("sh").current_dir(work.path()).args(["-c", &command]).output().unwrap();
        assert!(!read_or_told(&output, name), "{name} was taken");
    }
}

#[test]
fn what_is_no_file_or_may_not_be_read() {
    let work = folder();
    for name in ["folder.ply", "folder.obj", "folder.stl"] {
        fs::create_dir(work.path().join(name)).unwrap();
        refused(work.path(), &work.path().join(name), &["not a regular file"]);
    }
    refused(work.path(), &work.path().join("missing.ply"), &["there is no mesh file"]);
    for name in ["pipe.ply", "pipe.obj", "pipe.stl", "pipe.toml"] {
        let path = work.path().join(name);
        let made = Command::new("mkfifo").arg(&path).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: no mkfifo");
            break;
        }
        refused(work.path(), &path, &[]);
    }
    let output =
        program(work.path()).args(["render", "pipe.toml", "--photon-map", "pipe.ply"]).output().unwrap();
    assert!(!read_or_told(&output, "pipe"));
    use std::os::unix::fs::PermissionsExt;
    for name in ["locked.ply", "locked.obj", "locked.stl", "locked.toml"] {
        let path = work.path().join(name);
        fs::write(&path, "ply\n").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o000)).unwrap();
        if fs::read(&path).is_ok() {
            println!("skipped: this user may read every file");
            break;
        }
        refused(work.path(), &path, &["ermission"]);
    }
}

/// Outputs that cannot be written, on a file system of 200 kB where this user may make one.
#[test]
fn a_full_disk_and_a_missing_folder() {
    let work = folder();
    let knot = root().join("scenes/meshes/knot.ply");
    for (option, value) in [("-o", "none/a.exr"), ("--stats", "none/a.json"), ("-o", "/dev/full")] {
        let mut command = program(work.path());
        command
            .arg("render")
            .arg(&knot)
            .args(["--resolution", "8x8", "--spp", "1", "-q"])
            .args([option, value]);
        let output = command.output().unwrap();
        assert!(!read_or_told(&output, value.trim_end_matches(".exr")), "{value}");
    }
    assert_eq!(fs::read_dir(work.path()).unwrap().count(), 0);
    let disk = work.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let script = "mount -t tmpfs -o size=200k none disk || exit 77; cd disk; \
        \"$0\" render \"$1\" --resolution 400x300 --spp 1 --quality draft -q -o a.exr; echo \"code $?\"; \
        \"$0\" photons \"$1\" -q -o a.photons; echo \"code $?\"; ls -A";
    let output = Command::new("unshare")
        .current_dir(work.path())
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", script, env!("CARGO_BIN_EXE_cardioid")])
        .arg(&knot)
        .output();
    let Some(output) = output.ok().filter(|output| output.status.success()) else {
        println!("skipped: no file system of its own can be mounted here");
        return;
    };
    let (said, error) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    // The PNG fits, and is kept. Nothing else is left, not even a temporary file.
    assert_eq!(said, "code 1\ncode 1\na.png\n", "{said}{error}");
    assert!(error.contains("a.exr") && error.contains("a.photons") && error.contains("pace"), "{error}");
}

/// A landscape of `2 side^2` triangles as binary PLY.
fn landscape(path: &Path, side: u32) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (side + 1) * (side + 1),
        2 * side * side
    )
    .into_bytes();
    for (x, z) in (0..=side).flat_map(|z| (0..=side).map(move |x| (x, z))) {
        let height = (x * 7 + z * 13) % 11;
        [x as f32, height as f32, z as f32].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    for (x, z) in (0..side).flat_map(|z| (0..side).map(move |x| (x, z))) {
        let corner = |x: u32, z: u32| (z * (side + 1) + x).to_le_bytes();
        for triangle in [[(x, z), (x, z + 1), (x + 1, z)], [(x + 1, z), (x, z + 1), (x + 1, z + 1)]] {
            bytes.push(3);
            triangle.iter().for_each(|&(x, z)| bytes.extend(corner(x, z)));
        }
    }
    fs::write(path, bytes).unwrap();
}

/// Starts, sends a signal after `delay`, and returns how it ended, what it said and what it left.
fn signalled(
    mesh: &Path,
    command: &[&str],
    signal: Signal,
    delay: Duration,
) -> (Option<i32>, String, Vec<PathBuf>) {
    let work = folder();
    let mut child = program(work.path())
        .arg(command[0])
        .arg(mesh)
        .args(&command[1..])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(delay);
    // It may have ended before.
    let _ = kill_process(Pid::from_child(&child), signal);
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > Duration::from_secs(120) {
            child.kill().unwrap();
            panic!("{command:?}: not stopped two minutes after {signal:?} at {delay:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = child.wait_with_output().unwrap();
    let code = output.status.code().or(output.status.signal().map(|signal| 128 + signal));
    let names = fs::read_dir(work.path()).unwrap().map(|entry| entry.unwrap().path());
    let names: Vec<PathBuf> = names.collect();
    for name in &names {
        match name.extension().and_then(|extension| extension.to_str()) {
            Some("exr" | "png") => drop(cardioid::image_io::read(name).unwrap()),
            Some("photons") => drop(cardioid::photons::read_photon_file(name).unwrap()),
            other => panic!("{command:?} left {} ({other:?})", name.display()),
        }
    }
    (code, String::from_utf8_lossy(&output.stderr).into_owned(), names)
}

#[test]
fn signals_at_any_time() {
    let meshes = folder();
    let mesh = meshes.path().join("landscape.ply");
    landscape(&mesh, 700);
    let render =
        ["render", "--resolution", "48x48", "--spp", "100000", "--photons", "3M", "-o", "a.exr", "-q"];
    let photons = ["photons", "--photons", "20M", "-o", "a.photons", "-q"];
    let mut stopped_early = 0;
    for (number, milliseconds) in [10, 60, 150, 300, 600, 1200, 2500, 5000].into_iter().enumerate() {
        let (name, code) = if number % 2 == 0 { (Signal::INT, 130) } else { (Signal::TERM, 143) };
        let command: &[&str] = if number % 4 == 3 { &photons } else { &render };
        let (ended, said, left) = signalled(&mesh, command, name, Duration::from_millis(milliseconds));
        assert_eq!(ended, Some(code), "{command:?} at {milliseconds} ms: {said}");
        assert!(!said.contains("panicked"), "{said}");
        if left.is_empty() {
            stopped_early += 1;
        } else {
            // A picture comes as a whole, both files of it.
            assert_eq!(left.len(), 2, "{left:?}");
        }
        println!("{command:?} at {milliseconds} ms: {} files; {said}", left.len());
    }
    assert!(stopped_early >= 2, "all signals came when pixels were there already");
}

/// What does not fit is told before it is tried.
#[test]
fn a_limit_of_memory() {
    let work = folder();
    let mesh = work.path().join("landscape.ply");
    landscape(&mesh, 500);
    let render = |more: &[&str]| {
        let mut command = program(work.path());
        command.arg("render").arg(&mesh).args([
            "--resolution",
            "16x16",
            "--spp",
            "1",
            "--quality",
            "draft",
            "-q",
            "-o",
            "a.png",
        ]);
        command.args(more).output().unwrap()
    };
    let output = render(&["--memory-limit", "70MB"]);
    assert!(!read_or_told(&output, "--memory-limit"));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    for part in ["0.5 million triangles", "meshes 9 MB", "Embree's hierarchy 36 MB", "70 MB"] {
        assert!(message.contains(part), "no `{part}` in {message}");
    }
    // Photons are known once the scene is.
    let output = render(&["--memory-limit", "300MB", "--photons", "20M"]);
    assert!(!read_or_told(&output, "--memory-limit"));
    assert!(String::from_utf8_lossy(&output.stderr).contains("photon maps"));
    let output = render(&["--memory-limit", "300MB", "--stats", "a.json"]);
    assert!(read_or_told(&output, ""), "{}", String::from_utf8_lossy(&output.stderr));
    // And the estimate holds.
    let stats: serde_json::Value =
        serde_json::from_slice(&fs::read(work.path().join("a.json")).unwrap()).unwrap();
    let peak = stats["memory"]["pixels"]["peak"].as_u64().unwrap();
    assert!(peak < 300_000_000, "{peak}");
}

/// What glTF declares is compared with the limit before it is read: buffers, accessors, pictures, lights.
#[test]
fn a_limit_of_memory_holds_for_gltf() {
    let work = folder();
    let start = |rest: &str| format!(r#"{{"asset":{{"version":"2.0"}},{rest}}}"#);
    let refuses = |name: &str, text: String, limit: &str, parts: &[&str]| {
        fs::write(work.path().join(name), text).unwrap();
        // With addresses for the program and little more: taking what is declared would fail at once.
        let command = format!(
            "ulimit -v 4000000; exec '{}' info '{name}' --memory-limit {limit}",
            env!("CARGO_BIN_EXE_cardioid")
        );
        let output = Command::new("sh").current_dir(work.path()).args(["-c", &command]).output().unwrap();
        assert!(!read_or_told(&output, name), "{name} was taken");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        parts.iter().for_each(|part| assert!(message.contains(part), "no `{part}` in {message}"));
    };
    // A file of 4 GB without blocks on the disk.
    fs::File::create(work.path().join("big.bin")).unwrap().set_len(1 << 32).unwrap();
    let scene = r#""scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}]"#;
    let data = |count: u64, length: u64| {
        format!(
            r#"{scene},"accessors":[{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3"}},{{"bufferView":0,"componentType":5123,"count":{count},"type":"SCALAR"}}],"bufferViews":[{{"buffer":0,"byteLength":{length}}}],"buffers":[{{"byteLength":{length},"uri":"big.bin"}}]"#
        )
    };
    // 300 million vertices, and three in a buffer as large.
    refuses(
        "vertices.gltf",
        start(&data(300_000_000, 1 << 32)),
        "500MB",
        &["100.0 million triangles", "--memory-limit"],
    );
    refuses(
        "buffer.gltf",
        start(&data(3, 1 << 32)),
        "500MB",
        &["buffers[0]", "reading 4295 MB", "--memory-limit"],
    );
    // A picture of 9000 by 9000 whose data do not come.
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & 0u32.wrapping_sub(crc & 1))
            })
        })
    };
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    let head = [&9000u32.to_be_bytes()[..], &9000u32.to_be_bytes(), &[8, 2, 0, 0, 0]].concat();
    for (kind, content) in [(b"IHDR", &head[..]), (b"IDAT", &[0x78, 0x9c, 1, 0, 0][..])] {
        png.extend((content.len() as u32).to_be_bytes());
        let chunk = [&kind[..], content].concat();
        png.extend(&chunk);
        png.extend(crc(&chunk).to_be_bytes());
    }
    fs::write(work.path().join("bomb.png"), png).unwrap();
    fs::write(
        work.path().join("small.bin"),
        [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat(),
    )
    .unwrap();
    let textured = r#""scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"small.bin"}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],"images":[{"uri":"bomb.png"}]"#;
    refuses("picture.gltf", start(textured), "300MB", &["bomb.png takes 1944 MB", "--memory-limit"]);
    // Lights, by the length of the text.
    let nodes = vec![r#"{"extensions":{"KHR_lights_punctual":{"light":0}}}"#; 50_000].join(",");
    let numbers: Vec<String> = (0..50_000).map(|i: u32| i.to_string()).collect();
    let lights = format!(
        r#""scenes":[{{"nodes":[{}]}}],"nodes":[{nodes}],"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point"}}]}}}}"#,
        numbers.join(",")
    );
    refuses("lights.gltf", start(&lights), "150MB", &["reading", "--memory-limit"]);
    // A picture of an environment that a scene file names.
    fs::copy(work.path().join("bomb.png"), work.path().join("sky.png")).unwrap();
    let scene = "[[lights]]\ntype = \"environment\"\nimage = \"sky.png\"\n[materials.a]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"a\"\n";
    refuses("sky.toml", scene.to_owned(), "300MB", &["sky.png takes 1944 MB", "--memory-limit"]);
}
