//! Fuzzing without another toolchain: sound files, mutated at random, through the readers of `fuzz/common.rs`.
//!
//!     cargo run --release --example mutate -- TARGET|all EXECUTIONS [SEED]
//!     cargo run --release --example mutate -- structure EXECUTIONS [SEED [FOLDER]]
//!     cargo run --release --example mutate -- xml EXECUTIONS [SEED [FOLDER]]
//!     cargo run --release --example mutate -- corpus FOLDER      # the files to begin with, for cargo fuzz
//!
//! `structure` mutates the JSON of glTF as a tree: first each of its values is left out, copied and replaced by one of each type, then
//! several at a time at random. What is read is built as well. With FOLDER it writes the files and `verdicts.txt` instead, for
//! comparison with another reader.
//!
//! `xml` mutates scenes of Mitsuba as trees, those of FOLDER too. `pbrt` is a TARGET.
//!
//! The same seed makes the same files. What makes a reader fail is written to `TARGET.failure`.

#[path = "../fuzz/common.rs"]
mod common;
#[path = "mutate/xml.rs"]
mod xml;

use cardioid::embree::Device;
use cardioid::sampling::{Rng, Stream};
use cardioid::scene_file::{build_scene, parse_gltf_bytes};
use serde_json::{Value, json};
use std::error::Error;
use std::fs;
use std::panic::catch_unwind;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Longest file that mutations make.
const LONGEST: usize = 12_288;

/// Files that mutations start from, at most; those that were read as sound join them in turn.
const POOL: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = "usage: mutate TARGET|all|structure|xml EXECUTIONS [SEED], or: mutate corpus FOLDER";
    let (what, second) = (arguments.first().ok_or(usage)?, arguments.get(1).ok_or(usage)?);
    if what == "corpus" {
        for target in common::TARGETS {
            let folder = Path::new(second).join(target);
            fs::create_dir_all(&folder)?;
            for (number, seed) in common::seeds(target).iter().enumerate() {
                fs::write(folder.join(format!("seed-{number}")), seed)?;
            }
        }
        return Ok(());
    }
    let executions: u64 = second.parse()?;
    let seed = arguments.get(2).map_or(Ok(1), |text| text.parse())?;
    if what == "structure" {
        return run_structure(executions, seed, arguments.get(3).map(Path::new));
    }
    if what == "xml" {
        let rich = common::seeds("mitsuba");
        return xml::run(&rich[0], executions, seed, arguments.get(3).map(Path::new));
    }
    let targets = common::TARGETS.into_iter().filter(|target| what == "all" || what == target);
    let mut ran = 0;
    for target in targets {
        // Each of these starts a process.
        let share = if what == "all" && target == "vdb" { 1000 } else { 1 };
        run(target, executions.div_ceil(share), seed)?;
        ran += 1;
    }
    if ran == 0 { Err(usage.into()) } else { Ok(()) }
}

fn run(target: &str, executions: u64, seed: u64) -> Result<(), Box<dyn Error>> {
    let mut pool = common::seeds(target);
    if let Some(bad) = pool.iter().find(|seed| !common::execute(target, seed)) {
        return Err(format!("a seed of {target} is refused: {}", String::from_utf8_lossy(bad)).into());
    }
    if pool.is_empty() {
        println!("{target}: nothing to begin with, as OpenVDB is not there");
        return Ok(());
    }
    let kept = pool.len();
    let start = Instant::now();
    let (mut read, mut longest) = (0u64, 0.0f64);
    for execution in 0..executions {
        let mut rng = Rng::new(seed, Stream::Measure, execution);
        let below = |rng: &mut Rng, count: usize| (rng.next_u64() % count.max(1) as u64) as usize;
        let mut bytes = pool[below(&mut rng, pool.len())].clone();
        for _ in 0..1 + below(&mut rng, 4) {
            let at = below(&mut rng, bytes.len() + 1);
            let (here, span) = (at.min(bytes.len().saturating_sub(1)), below(&mut rng, 16));
            match below(&mut rng, 8) {
                0 if !bytes.is_empty() => bytes[here] ^= 1 << below(&mut rng, 8),
                1 if !bytes.is_empty() => bytes[here] = rng.next_u64() as u8,
                2 => drop(bytes.drain(at..(at + span).min(bytes.len()))),
                3 => {
                    let part = bytes[at..(at + span).min(bytes.len())].to_vec();
                    bytes.splice(at..at, part);
                }
                4 => {
                    let word = common::WORDS[below(&mut rng, common::WORDS.len())];
                    bytes.splice(at..at, word.bytes());
                }
                5 => bytes.truncate(at),
                6 => {
                    let other = &pool[below(&mut rng, pool.len())];
                    let from = below(&mut rng, other.len() + 1);
                    bytes.truncate(at);
                    bytes.extend_from_slice(&other[from..]);
                }
                // Numbers at the ends of their types.
                _ if bytes.len() >= at + 4 => {
                    let number =
                        [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX, 0x7fc0_0000, 0xff][below(&mut rng, 7)];
                    bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
                }
                _ => {}
            }
        }
        bytes.truncate(LONGEST);
        let begun = Instant::now();
        let Ok(is_read) = catch_unwind(|| common::execute(target, &bytes)) else {
            let name = format!("{target}.failure");
            fs::write(&name, &bytes)?;
            return Err(
                format!("{target}: execution {execution} of seed {seed} failed; its file is {name}").into()
            );
        };
        longest = longest.max(begun.elapsed().as_secs_f64());
        if is_read {
            read += 1;
            match pool.len() < POOL {
                true => pool.push(bytes),
                false => {
                    let place = kept + below(&mut rng, POOL - kept);
                    pool[place] = bytes;
                }
            }
        }
    }
    println!(
        "{target}: {executions} executions, {read} read, the others refused; {:.1} s, the longest {:.1} ms",
        start.elapsed().as_secs_f64(),
        1e3 * longest
    );
    Ok(())
}

/// The ways from the root to each value below it.
fn places(value: &Value, at: &str, found: &mut Vec<String>) {
    let mut below = |key: &str, child: &Value| {
        let place = format!("{at}/{key}");
        places(child, &place, found);
        found.push(place);
    };
    match value {
        Value::Object(items) => items.iter().for_each(|(key, child)| below(key, child)),
        Value::Array(items) => items.iter().enumerate().for_each(|(i, child)| below(&i.to_string(), child)),
        _ => {}
    }
}

/// Values to put in the place of others.
fn replacements() -> Vec<Value> {
    vec![
        json!(null),
        json!(true),
        json!(0),
        json!(1),
        json!(2),
        json!(7),
        json!(255),
        json!(65536),
        json!(u32::MAX),
        json!(u64::MAX),
        json!(-1),
        json!(0.5),
        json!(-0.25),
        json!(1e30),
        json!(1e300),
        json!(""),
        json!("a"),
        json!("data:,"),
        json!([]),
        json!([0]),
        json!([1, 1]),
        json!([0.1, 0.2, 0.3]),
        json!({}),
        json!({ "a": 0 }),
        json!([{}]),
        json!({ "index": 0 }),
        json!("BLEND"),
        json!("VEC2"),
        json!(5121),
        json!(5126),
    ]
}

/// Leaves out what stands at a place.
fn leave_out(value: &mut Value, place: &str) {
    let Some((parent, key)) = place.rsplit_once('/') else { return };
    match value.pointer_mut(parent) {
        Some(Value::Object(items)) => drop(items.remove(key)),
        Some(Value::Array(items)) => {
            if let Some(index) = key.parse().ok().filter(|index| *index < items.len()) {
                items.remove(index);
            }
        }
        _ => {}
    }
}

/// Puts a copy of what stands at a place beside it.
fn copy(value: &mut Value, place: &str, name: &str) {
    let Some((parent, key)) = place.rsplit_once('/') else { return };
    let Some(content) = value.pointer(place).cloned() else { return };
    match value.pointer_mut(parent) {
        Some(Value::Object(items)) => drop(items.insert(name.to_owned(), content)),
        Some(Value::Array(items)) => {
            let index = key.parse().unwrap_or(0);
            items.insert(items.len().min(index), content);
        }
        _ => {}
    }
}

/// One of the mutations of each value by itself, in their order; `None` after the last.
fn single(value: &Value, all: &[String], number: u64) -> Option<Value> {
    let others = replacements();
    let kinds = others.len() + 2;
    let place = all.get(usize::try_from(number).ok()? / kinds)?;
    let mut value = value.clone();
    match number as usize % kinds {
        0 => leave_out(&mut value, place),
        1 => copy(&mut value, place, "copy"),
        kind => *value.pointer_mut(place)? = others[kind - 2].clone(),
    }
    Some(value)
}

/// A few mutations at random.
fn several(mut value: Value, rng: &mut Rng) -> Value {
    let below = |rng: &mut Rng, count: usize| (rng.next_u64() % count.max(1) as u64) as usize;
    for _ in 0..1 + below(rng, 4) {
        let mut all = Vec::new();
        places(&value, "", &mut all);
        let (place, other) = (all[below(rng, all.len())].clone(), all[below(rng, all.len())].clone());
        let elsewhere = value.pointer(&other).cloned();
        match below(rng, 7) {
            0 => leave_out(&mut value, &place),
            1 => copy(&mut value, &place, other.rsplit('/').next().unwrap_or("copy")),
            // Another number, mostly small: an index, a count, an enumeration.
            2 | 3 => match value.pointer_mut(&place) {
                Some(Value::Number(number)) => {
                    let old = number.as_i64().unwrap_or(0);
                    let new = [old + 1, old - 1, 0, below(rng, 16) as i64, -old, 5120 + below(rng, 7) as i64];
                    let new = json!(new[below(rng, 6)]);
                    *value.pointer_mut(&place).unwrap_or(&mut Value::Null) = new;
                }
                _ => leave_out(&mut value, &place),
            },
            4 => {
                let others = replacements();
                if let Some(content) = value.pointer_mut(&place) {
                    *content = others[below(rng, others.len())].clone();
                }
            }
            // What stands elsewhere, or both in each other's place.
            5 => {
                if let (Some(content), Some(elsewhere)) = (value.pointer_mut(&place), elsewhere) {
                    *content = elsewhere;
                }
            }
            _ => {
                let here = value.pointer(&place).cloned();
                if let (Some(content), Some(here)) = (value.pointer_mut(&other), here) {
                    *content = here;
                }
                if let (Some(content), Some(elsewhere)) = (value.pointer_mut(&place), elsewhere) {
                    *content = elsewhere;
                }
            }
        }
    }
    value
}

fn run_structure(executions: u64, seed: u64, folder: Option<&Path>) -> Result<(), Box<dyn Error>> {
    let seeds: Vec<Value> =
        common::seeds("gltf").iter().filter_map(|bytes| serde_json::from_slice(bytes).ok()).collect();
    let rich = seeds.last().ok_or("no seed is JSON")?;
    let mut all = Vec::new();
    places(rich, "", &mut all);
    let device = Arc::new(Device::new(1)?);
    let start = Instant::now();
    let (mut read, mut built, mut longest, mut verdicts) = (0u64, 0u64, 0.0f64, String::new());
    for execution in 0..executions {
        // The first seed goes through them once; with others, all are at random.
        let alone = if seed == 1 { single(rich, &all, execution) } else { None };
        let value = alone.unwrap_or_else(|| {
            let mut rng = Rng::new(seed, Stream::Measure, execution);
            let from = if rng.next_u64().is_multiple_of(8) { &seeds[0] } else { rich };
            several(from.clone(), &mut rng)
        });
        let bytes = serde_json::to_vec(&value)?;
        let begun = Instant::now();
        let outcome = catch_unwind(|| {
            let scene = parse_gltf_bytes(&bytes, Path::new("a.gltf")).map_err(|error| error.to_string())?;
            let is_built = build_scene(&scene, &device, (16, 16)).is_ok();
            let said: Vec<String> = scene.warnings.iter().map(|warning| warning.message.clone()).collect();
            Ok::<_, String>((is_built, said))
        });
        let Ok(outcome) = outcome else {
            fs::write("structure.failure", &bytes)?;
            let problem =
                format!("execution {execution} of seed {seed} failed; its file is structure.failure");
            return Err(problem.into());
        };
        longest = longest.max(begun.elapsed().as_secs_f64());
        read += u64::from(outcome.is_ok());
        built += u64::from(outcome.as_ref().is_ok_and(|(is_built, _)| *is_built));
        if let Some(folder) = folder {
            fs::write(folder.join(format!("{execution}.gltf")), &bytes)?;
            let line = match outcome {
                Ok((_, said)) => format!("{execution} read {}", said.join(" | ")),
                Err(error) => format!("{execution} refused {error}"),
            };
            verdicts.push_str(&line.replace('\n', " "));
            verdicts.push('\n');
        }
    }
    if let Some(folder) = folder {
        fs::write(folder.join("verdicts.txt"), verdicts)?;
    }
    println!(
        "structure: {executions} executions, {read} read, {built} of them built, the others refused; {:.1} s, the longest \
         {:.1} ms",
        start.elapsed().as_secs_f64(),
        1e3 * longest
    );
    Ok(())
}
