//! Fuzzing without another toolchain: sound files, mutated at random, through the readers of `fuzz/common.rs`.
//!
//!     cargo run --release --example mutate -- TARGET|all EXECUTIONS [SEED]
//!     cargo run --release --example mutate -- corpus FOLDER      # the files to begin with, for cargo fuzz
//!
//! The same seed makes the same files. What makes a reader fail is written to `TARGET.failure`.

#[path = "../fuzz/common.rs"]
mod common;

use cardioid::sampling::{Rng, Stream};
use std::error::Error;
use std::fs;
use std::panic::catch_unwind;
use std::path::Path;
use std::time::Instant;

/// Longest file that mutations make.
const LONGEST: usize = 4096;

/// Files that mutations start from, at most; those that were read as sound join them in turn.
const POOL: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = "usage: mutate TARGET|all EXECUTIONS [SEED], or: mutate corpus FOLDER";
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
    let targets = common::TARGETS.into_iter().filter(|target| what == "all" || what == target);
    let mut ran = 0;
    for target in targets {
        run(target, executions, seed)?;
        ran += 1;
    }
    if ran == 0 { Err(usage.into()) } else { Ok(()) }
}

fn run(target: &str, executions: u64, seed: u64) -> Result<(), Box<dyn Error>> {
    let mut pool = common::seeds(target);
    if let Some(bad) = pool.iter().find(|seed| !common::execute(target, seed)) {
        return Err(format!("a seed of {target} is refused: {}", String::from_utf8_lossy(bad)).into());
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
