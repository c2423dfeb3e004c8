//! `--stats` and `--stats-table`: every key is documented, and what is told adds up.

use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                found.insert(key.clone());
                // Those of settings are options, which the help documents.
                if key != "settings" {
                    keys(value, found);
                }
            }
        }
        Value::Array(values) => values.iter().for_each(|value| keys(value, found)),
        _ => {}
    }
}

/// `--progress json` tells of each step from its first unit to its last, on standard output and nowhere else.
#[test]
fn progress_for_programs() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.toml");
    let folder = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .arg("render")
            .arg(&scene)
            .args([
                "--resolution",
                "24x20",
                "--spp",
                "1",
                "--photons",
                "5000",
                "-o",
                "a.exr",
                "--progress",
                "json",
            ])
            .args(more)
            .output()
            .unwrap()
    };
    let output = run(&[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<Value> = String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert!(String::from_utf8_lossy(&output.stderr).lines().all(|line| !line.starts_with('{')));
    let names: BTreeSet<&str> = lines.iter().map(|line| line["step"].as_str().unwrap()).collect();
    assert!(names.len() >= 3, "{names:?}");
    let seconds: Vec<f64> = lines.iter().map(|line| line["seconds"].as_f64().unwrap()).collect();
    assert!(seconds.is_sorted(), "{seconds:?}");
    // Steps of known length go up from 0, and the pixels end at their whole number.
    let of = |name: &str| -> Vec<(u64, u64)> {
        let own = lines.iter().filter(|line| line["step"] == name && line.get("total").is_some());
        own.map(|line| (line["done"].as_u64().unwrap(), line["total"].as_u64().unwrap())).collect()
    };
    for name in &names {
        let told = of(name);
        assert!(told.is_sorted() && told.iter().all(|(done, total)| done <= total), "{name}: {told:?}");
    }
    let pixels = of("rendering");
    assert_eq!(pixels.first().map(|first| first.0), Some(0), "{names:?}");
    assert!(pixels.last().is_some_and(|(done, total)| done == total), "{pixels:?}");
    let clash = run(&["--stats", "-"]);
    assert_eq!(clash.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&clash.stderr).contains("write --stats to a file"));
}

#[test]
fn every_key_of_the_statistics_is_documented() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let run = |scene: &str, more: &[&str]| -> (Value, String) {
        let scene = root.join("scenes").join(scene);
        let output = Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .arg("render")
            .arg(scene)
            .args([
                "--resolution",
                "24x20",
                "--spp",
                "1",
                "--global-photons",
                "2000",
                "--caustic-photons",
                "2000",
            ])
            .args(["-q", "-o", "a.png", "--stats", "a.json", "--stats-table"])
            .args(more)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let json = serde_json::from_slice(&fs::read(folder.path().join("a.json")).unwrap()).unwrap();
        (json, String::from_utf8(output.stdout).unwrap())
    };
    let (plain, table) = run("cornell-spheres.toml", &["--shadow-photons", "bounded"]);
    let mut found = BTreeSet::new();
    keys(&plain, &mut found);
    keys(
        &run("mesh.toml", &["--guide", "photons", "--irradiance-cache", "false", "--quality", "final"]).0,
        &mut found,
    );
    let file = ["photons", "cornell-spheres.toml"];
    let saved = Command::new(env!("CARGO_BIN_EXE_cardioid"))
        .current_dir(folder.path())
        .arg(file[0])
        .arg(root.join("scenes").join(file[1]))
        .args(["--global-photons", "2000", "--caustic-photons", "2000", "-q", "-o", "a.photons"])
        .status()
        .unwrap();
    assert!(saved.success());
    let (read, read_table) = run("cornell-spheres.toml", &["--photon-map", "a.photons"]);
    keys(&read, &mut found);
    for command in ["photons", "bricks"] {
        let made = Command::new(env!("CARGO_BIN_EXE_cardioid"))
            .current_dir(folder.path())
            .arg(command)
            .arg(root.join("scenes/cornell-diffuse.toml"))
            .args(["--global-photons", "2000", "-q", "--atlas", "atlas"])
            .status()
            .unwrap();
        assert!(made.success());
    }
    keys(&run("cornell-diffuse.toml", &["--atlas", "atlas"]).0, &mut found);
    assert!(found.len() > 90, "{}", found.len());
    let document = fs::read_to_string(root.join("docs/statistics.md")).unwrap();
    let missing: Vec<_> = found.iter().filter(|key| !document.contains(&format!("`{key}`"))).collect();
    assert!(missing.is_empty(), "docs/statistics.md does not name {missing:?}");
    let help =
        Command::new(env!("CARGO_BIN_EXE_cardioid")).args(["render", "--help"]).output().unwrap().stdout;
    let help = String::from_utf8(help).unwrap();
    for option in plain["settings"].as_object().unwrap().keys() {
        assert!(help.contains(&format!("--{option}")), "no option --{option}");
    }
    assert_eq!(plain["schema"], 2);
    assert!(document.contains("`schema` | 2"), "the document is of another version");

    // Photons that left a light were absorbed, escaped or cut off.
    for map in plain["maps"].as_array().unwrap() {
        for light in map["lights"].as_array().unwrap() {
            for channel in 0..3 {
                let flux = |key: &str| light[key][channel].as_f64().unwrap();
                let ends = flux("flux_absorbed") + flux("flux_escaped") + flux("flux_truncated");
                assert!((ends / flux("flux_emitted") - 1.0).abs() < 0.1, "{light}");
            }
        }
    }
    for step in ["scene", "photons", "pixels"] {
        let memory = &plain["memory"][step];
        assert!(memory["peak"].as_u64().unwrap() >= memory["resident"].as_u64().unwrap(), "{memory}");
    }
    assert!(plain["memory"]["hierarchy"].as_u64().unwrap() > 0);
    for part in [
        "reading and building",
        "in memory",
        "tracing caustic photons",
        "camera",
        "gather",
        "irradiance cache:",
        "W emitted",
    ] {
        assert!(table.contains(part), "no `{part}` in\n{table}");
    }
    assert!(table.contains("shadow photons of light 0") && !table.contains("NaN"), "{table}");
    assert!(
        read_table.contains("reading photon maps") && read_table.contains("read from a file"),
        "{read_table}"
    );
    println!("{table}");
}
