//! Parts of a progressive picture: together they are the picture of one render to the bit, whatever happens on the way, and what does not
//! belong together is refused.

use crate::common::{program, run, stderr};
use cardioid::image_io::{self, Image};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

fn scene() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.toml").display().to_string()
}

/// Runs `command SCENE` at a small size with these options.
#[track_caller]
fn ends(folder: &Path, command: &str, more: &[&str], code: i32) -> String {
    let scene = scene();
    let mut args = vec![command, &scene, "-q", "--spp", "1"];
    args.extend(["--global-photons", "600", "--caustic-photons", "800", "--threads", "2"]);
    if !more.contains(&"--resolution") {
        args.extend(["--resolution", "20x16"]);
    }
    args.extend(more);
    let output = run(folder, &args);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {}", stderr(&output));
    stderr(&output)
}

#[track_caller]
fn merge(folder: &Path, parts: &[&str], more: &[&str], code: i32) -> String {
    let output = run(folder, &[&["merge"], parts, more].concat());
    assert_eq!(output.status.code(), Some(code), "{parts:?} {more:?}: {}", stderr(&output));
    stderr(&output)
}

fn picture(folder: &Path, name: &str) -> Image {
    image_io::read(folder.join(name)).unwrap()
}

/// Every bit of every layer, and what the file says of the render, except for times.
#[track_caller]
fn assert_same(folder: &Path, one: &str, other: &str) {
    let (a, b) = (picture(folder, one), picture(folder, other));
    assert_eq!(a.layers.len(), b.layers.len());
    for (a, b) in a.layers.iter().zip(&b.layers) {
        let bits = |data: &[f32]| data.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert!(
            a.name == b.name && bits(&a.data) == bits(&b.data),
            "layer {:?} of {one} and {other}",
            a.name
        );
    }
    for (name, value) in a.metadata.iter().filter(|(name, _)| name.starts_with("cardioid/")) {
        if !["cardioid/times", "cardioid/settings"].contains(&name.as_str()) {
            assert_eq!(b.metadata(name), Some(value), "{name}");
        }
    }
}

#[test]
fn parts_are_merged_to_the_bits_of_one_render() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    // Three blocks, of which the last has 3 rounds; all layers, the picture alone, and a window.
    for (name, more) in
        [("all", &[][..]), ("beauty", &["--layers", "beauty"]), ("window", &["--crop", "3,2,17,9"])]
    {
        let exr = format!("{name}.exr");
        let rounds = ["--rounds", "35"];
        ends(
            folder,
            "render",
            &[&rounds[..], &["--integrator", "progressive", "-o", &exr], more].concat(),
            0,
        );
        let merged = format!("{name}-merged.exr");
        // In one file or in three, in any order.
        for files in [&["1/3", "2/3", "3/3"][..], &["2/2", "1/2"]] {
            let names: Vec<String> =
                files.iter().map(|part| format!("{name}-{}.part", part.replace('/', "-"))).collect();
            for (part, file) in files.iter().zip(&names) {
                ends(folder, "part", &[&rounds[..], &["--part", part, "-o", file], more].concat(), 0);
            }
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            merge(folder, &names, &["-o", &merged, "--stats", "s.json"], 0);
            assert_same(folder, &exr, &merged);
        }
        let stats: Value = serde_json::from_slice(&fs::read(folder.join("s.json")).unwrap()).unwrap();
        assert_eq!((stats["parts"].as_u64(), stats["rounds"]["done"].as_u64()), (Some(2), Some(35)));
    }
    // Parts of windows, merged to windows, merged to the picture: so the merge itself can be shared out.
    for (window, name) in [("0,0,20,9", "above"), ("0,9,20,16", "below")] {
        let (part, exr) = (format!("{name}.part"), format!("{name}.exr"));
        ends(folder, "part", &["--rounds", "35", "--part", "1/1", "--crop", window, "-o", &part], 0);
        merge(folder, &[&part], &["-o", &exr], 0);
    }
    merge(folder, &["below.exr", "above.exr"], &["-o", "windows.exr"], 0);
    let (one, windows) = (picture(folder, "all.exr"), picture(folder, "windows.exr"));
    for (a, b) in one.layers.iter().zip(&windows.layers) {
        let bits = |data: &[f32]| data.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert!(a.name == b.name && bits(&a.data) == bits(&b.data), "{}", a.name);
    }
    // Blocks of a picture with more rounds are added to those that are there.
    ends(folder, "part", &["--rounds", "32", "--part", "1/2", "-o", "a.part"], 0);
    ends(folder, "part", &["--rounds", "35", "--part", "2/3", "-o", "b.part"], 0);
    let message = merge(folder, &["a.part", "b.part"], &["-o", "more.exr"], 75);
    assert!(message.contains("2/2 (rounds 33 to 35 of 35)"), "{message}");
    merge(folder, &["a.part", "b.part", "all-3-3.part"], &["-o", "more.exr"], 0);
    assert_same(folder, "all.exr", "more.exr");
}

/// Sixteen rounds or fewer are one block, which is not rounded.
#[test]
fn a_single_block_is_the_plain_sum() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    ends(folder, "render", &["--rounds", "5", "--integrator", "progressive", "-o", "one.exr"], 0);
    ends(folder, "part", &["--rounds", "5", "--part", "1/1", "-o", "one.part"], 0);
    let message = merge(folder, &["one.part"], &["-o", "merged.exr", "--target-error", "0.05"], 0);
    assert!(message.contains("rounds more") && message.contains("--rounds"), "{message}");
    assert_same(folder, "one.exr", "merged.exr");
    let message = ends(folder, "part", &["--rounds", "16", "--part", "1/2", "-o", "x.part"], 1);
    assert!(message.contains("at most 1 parts"), "{message}");
    let message =
        ends(folder, "part", &["--rounds", "32", "--part", "1/2", "-o", "x.part", "--integrator", "path"], 1);
    assert!(message.contains("progressive"), "{message}");
}

/// A checkpoint within a block and one at its end, before and after the first is rounded.
#[test]
fn resumed_renders_keep_their_bits_over_blocks() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let to = |rounds: &str, exr: &str, more: &[&str]| {
        let fixed = ["--integrator", "progressive", "--layers", "light", "--rounds", rounds, "-o", exr];
        ends(folder, "render", &[&fixed[..], more].concat(), 0);
    };
    to("35", "one.exr", &[]);
    to("16", "a.exr", &["--checkpoint", "r"]);
    for rounds in ["20", "32", "35"] {
        to(rounds, "a.exr", &["--checkpoint", "r", "--resume", "r"]);
    }
    assert_same(folder, "one.exr", "a.exr");
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let rounds = ["--rounds", "33"];
    let part = |number: &str, file: &str, more: &[&str]| {
        ends(folder, "part", &[&rounds[..], &["--part", number, "-o", file], more].concat(), 0)
    };
    part("1/3", "1.part", &[]);
    part("2/3", "2.part", &[]);
    part("3/3", "3.part", &[]);
    let refused = |parts: &[&str], code: i32, words: &[&str]| {
        let message = merge(folder, parts, &["-o", "x.exr"], code);
        words.iter().for_each(|word| assert!(message.contains(word), "no `{word}` in {message}"));
        assert!(!folder.join("x.exr").exists());
    };
    refused(&["1.part", "3.part"], 75, &["2/3 (rounds 17 to 32 of 33)"]);
    refused(&["1.part", "2.part", "none.part"], 75, &["none.part"]);
    part("1/2", "half.part", &[]);
    refused(&["half.part", "1.part", "2.part", "3.part"], 1, &["half.part", "1.part", "rounds 1 to 16"]);
    part("3/3", "other.part", &["--seed", "5"]);
    refused(&["1.part", "2.part", "other.part"], 1, &["other.part", "seed was 0 and is 5"]);
    // The last block of 33 rounds has one round, and that of 48 has sixteen.
    ends(folder, "part", &["--rounds", "48", "--part", "1/3", "-o", "long.part"], 0);
    refused(&["long.part", "2.part", "3.part"], 1, &["3.part", "--rounds 48"]);
    let mut bytes = fs::read(folder.join("2.part")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(folder.join("damaged.part"), bytes).unwrap();
    refused(&["1.part", "damaged.part", "3.part"], 1, &["damaged.part", "checksum"]);
    // A complete part is kept; a file that is something else, too.
    let before = fs::metadata(folder.join("1.part")).unwrap().modified().unwrap();
    part("1/3", "1.part", &[]);
    assert_eq!(fs::metadata(folder.join("1.part")).unwrap().modified().unwrap(), before);
    let message = ends(folder, "part", &["--rounds", "33", "--part", "2/3", "-o", "1.part"], 1);
    assert!(message.contains("is not this part"), "{message}");
    part("2/3", "1.part", &["--overwrite"]);
}

/// A run that is ended by SIGTERM keeps its rounds and asks for another; that one gives the same bits. So does one with a time limit.
#[test]
fn a_part_that_was_stopped_goes_on() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let options = ["--rounds", "64", "--part", "2/2", "--resolution", "64x48"];
    let scene = scene();
    let with = |file: &str, more: &[&str]| -> Vec<String> {
        let fixed = [
            "part",
            &scene,
            "-q",
            "--spp",
            "1",
            "--global-photons",
            "600",
            "--caustic-photons",
            "800",
            "-o",
            file,
        ];
        fixed.iter().chain(&options).chain(more).map(|word| (*word).to_owned()).collect()
    };
    let whole = program(folder).args(with("whole.part", &[])).output().unwrap();
    assert_eq!(whole.status.code(), Some(0), "{}", stderr(&whole));
    let mut child = program(folder).args(with("p.part", &[])).stderr(Stdio::piped()).spawn().unwrap();
    // The scene is built within this time, or not: either way nothing is lost.
    std::thread::sleep(Duration::from_millis(400));
    kill_process(Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap(), Signal::TERM).unwrap();
    let code = child.wait().unwrap().code();
    assert!(code == Some(75) || code == Some(0), "{code:?}");
    assert_eq!(folder.join("p.part").exists(), code == Some(0));
    // Each run does at least one round.
    let start = Instant::now();
    let mut runs = 0;
    while !folder.join("p.part").exists() {
        let limit: &[&str] = if runs < 2 { &["--time-limit", "1ms"] } else { &[] };
        let run = program(folder).args(with("p.part", limit)).output().unwrap();
        let expected = if runs < 2 { Some(75) } else { Some(0) };
        assert_eq!(run.status.code(), expected, "{}", stderr(&run));
        assert_eq!(folder.join("p.part.rounds").exists(), runs < 2);
        runs += 1;
        assert!(start.elapsed() < Duration::from_secs(120));
    }
    // All but the times in the summaries is equal, so the merged pictures are.
    let other = |part: &str, file: &str| {
        let args = [
            &["part", &scene, "-q", "--spp", "1", "--global-photons", "600", "--caustic-photons", "800"][..],
            &["--rounds", "64", "--resolution", "64x48", "--part", part, "-o", file],
        ]
        .concat();
        assert_eq!(run(folder, &args).status.code(), Some(0));
    };
    other("1/2", "first.part");
    merge(folder, &["first.part", "p.part"], &["-o", "p.exr"], 0);
    merge(folder, &["first.part", "whole.part"], &["-o", "whole.exr"], 0);
    assert_same(folder, "p.exr", "whole.exr");
}

#[test]
fn the_instruction_set_is_pinned_and_recorded() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    if !cfg!(target_arch = "x86_64") {
        return;
    }
    let render = ["--rounds", "1", "--integrator", "progressive", "-o", "a.exr"];
    ends(folder, "render", &[&render[..], &["--isa", "sse4.2"]].concat(), 0);
    let target = picture(folder, "a.exr").metadata("cardioid/target").cloned();
    assert_eq!(target, Some("x86_64 sse4.2".into()));
    let output = run(folder, &["render", &scene(), "--isa", "avx3"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("this machine has sse4.2"), "{}", stderr(&output));
}

/// Windows with a shared photon map, and those of paths, are the picture of one render; what is missing or there twice is said.
#[test]
fn windows_are_merged_to_the_bits_of_one_render() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let windows = ["0,0,20,7", "0,7,9,16", "9,7,20,16"];
    for (integrator, more) in [("path", &[][..]), ("photon-map", &["--photon-map", "m.photons"])] {
        if integrator == "photon-map" {
            let photons = [
                "photons",
                &scene(),
                "-q",
                "--global-photons",
                "600",
                "--caustic-photons",
                "800",
                "-o",
                "m.photons",
            ];
            assert_eq!(run(folder, &photons).status.code(), Some(0));
        }
        let base = [&["--integrator", integrator, "--whole", "-o"][..], &["one.exr"], more].concat();
        ends(folder, "render", &base, 0);
        let names = ["a.exr", "b.exr", "c.exr"];
        for (window, name) in windows.iter().zip(names) {
            let args =
                [&["--integrator", integrator, "--whole", "--crop", window, "-o", name][..], more].concat();
            ends(folder, "render", &args, 0);
        }
        merge(folder, &names, &["-o", "m.exr", "--overwrite"], 0);
        let (one, merged) = (picture(folder, "one.exr"), picture(folder, "m.exr"));
        assert_eq!(one.layers.len(), merged.layers.len());
        for (a, b) in one.layers.iter().zip(&merged.layers) {
            let bits = |data: &[f32]| data.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert!(a.name == b.name && bits(&a.data) == bits(&b.data), "{integrator}: {}", a.name);
        }
        for key in ["cardioid/window", "cardioid/objects", "cardioid/exposure", "cardioid/samples"] {
            assert_eq!(one.metadata(key), merged.metadata(key), "{key}");
        }
        let png = |name: &str| fs::read(folder.join(name)).unwrap();
        assert_eq!(png("one.png"), png("m.png"));
    }
    let message = merge(folder, &["a.exr", "c.exr"], &["-o", "x.exr"], 75);
    assert!(message.contains("pixel 0,7"), "{message}");
    let message = merge(folder, &["a.exr", "b.exr", "one.exr"], &["-o", "x.exr"], 1);
    assert!(message.contains("one.exr both have pixel 0,0"), "{message}");
    let other = ["--integrator", "path", "--seed", "3", "--crop", "9,7,20,16", "-o", "d.exr"];
    ends(folder, "render", &other, 0);
    let message = merge(folder, &["a.exr", "b.exr", "d.exr"], &["-o", "x.exr"], 1);
    assert!(message.contains("the settings differ"), "{message}");
    // A render that is stopped leaves nothing under the name of the window.
    let stopped =
        ["--integrator", "path", "--spp", "100000", "--time-limit", "50ms", "--whole", "-o", "s.exr"];
    let output = run(folder, &[&["render", &scene(), "-q", "--resolution", "20x16"][..], &stopped].concat());
    assert_eq!(output.status.code(), Some(75), "{}", stderr(&output));
    assert!(!folder.join("s.exr").exists() && !folder.join("s.png").exists());
}
