//! `cardioid merge`: the picture of its parts.

use super::outputs::{Named, Outputs};
use super::part::TRY_AGAIN;
use super::picture::threads;
use super::pictures::{About, Exposure, Figures, LooksArgs, Pictures};
use super::progress::{Console, catch_interrupts, interrupted};
use anyhow::{Context, Result, bail};
use cardioid::image_io;
use cardioid::render::{MergeError, Merged, PartError, RoundStatistics, Times, merge_parts, rounds_needed};
use clap::Args;
use serde::Serialize;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Merge parts or windows, rendered on any machines, to the picture of one render, to the bit
///
/// Ends with exit code 75 where parts are missing: it can be tried again when they are there.
#[derive(Args, Clone, Debug)]
pub(crate) struct MergeArgs {
    /// Files that `cardioid part` wrote, all parts of one picture, in any order; or windows (.exr) that `render --crop` wrote.
    #[arg(value_name = "PART", required = true)]
    parts: Vec<PathBuf>,

    /// Picture to write: .exr (a .png is written beside it) or .png alone.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Replace the PNG beside an EXR whoever wrote it; otherwise only one that cardioid wrote is replaced.
    #[arg(long)]
    overwrite: bool,

    #[command(flatten)]
    looks: LooksArgs,

    /// Say how many rounds more the picture needs for this relative error, for example 0.02.
    #[arg(long, value_name = "ERROR", value_parser = error)]
    target_error: Option<f64>,

    /// Threads; 0 means one for each core. The picture does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    threads: usize,

    /// Write statistics as JSON; `-` for standard output.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,
}

fn error(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(error) if (1e-6..=10.0).contains(&error) => Ok(error),
        _ => Err("write a relative error from 0.000001 to 10, for example 0.02".to_owned()),
    }
}

/// What `--stats` writes.
#[derive(Serialize)]
struct MergeStatistics<'a> {
    schema: u32,
    about: &'a About,
    parts: u64,
    bytes: u64,
    samples: u64,
    rejected_samples: u64,
    rounds: &'a RoundStatistics,
    /// Rounds that the target error is foreseen to need in all.
    rounds_needed: Option<u64>,
    counters: cardioid::integrators::Counters,
    times: Times,
    seconds: f64,
    warnings: &'a [String],
}

pub(crate) fn run(args: &MergeArgs) -> Result<ExitCode> {
    let start = Instant::now();
    catch_interrupts();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads)
        .build()
        .context("cannot start the threads")?;
    let pictures = Pictures::new(Some(&args.output), &args.output)?;
    let mut outputs = Outputs::new(args.parts.iter().map(PathBuf::as_path)).overwriting(args.overwrite);
    pictures.check(&mut outputs, Named::ByUser)?;
    if let Some(stats) = &args.stats {
        outputs.add_text(stats, "--stats", Named::ByUser)?;
    }
    let windows = args.parts.iter().filter(|path| super::windows::is_window(path)).count();
    if windows == args.parts.len() {
        if args.target_error.is_some() || args.stats.is_some() {
            bail!("--target-error and --stats are for parts of rounds: windows hold no statistics of theirs");
        }
        return pool.install(|| super::windows::merge(&args.parts, &pictures, &args.looks, args.quiet));
    }
    if windows > 0 {
        bail!("windows (.exr) and parts of rounds cannot be merged with each other");
    }
    let console = Console::new(args.quiet, None);
    let merged = pool.install(|| merge_parts(&args.parts, &console));
    console.finish();
    match merged {
        Ok(merged) => deliver(args, &pictures, merged, start),
        Err(MergeError::Stopped) => {
            say!("{}", MergeError::Stopped);
            Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from))
        }
        Err(error) if is_for_later(&error) => {
            say!("error: {error}");
            Ok(ExitCode::from(TRY_AGAIN))
        }
        Err(error) => Err(error.into()),
    }
}

/// Whether a later attempt may succeed without a change: parts that are missing may come.
fn is_for_later(error: &MergeError) -> bool {
    let is_unread = |error: &MergeError| matches!(error, MergeError::Part(PartError::Read { error, .. }) if error.kind() != ErrorKind::PermissionDenied);
    matches!(error, MergeError::Missing { .. }) || is_unread(error)
}

fn deliver(args: &MergeArgs, pictures: &Pictures, merged: Merged, start: Instant) -> Result<ExitCode> {
    let Ok(about) = serde_json::from_value::<About>(merged.about) else {
        bail!("{} was not written by `cardioid part`", args.parts[0].display());
    };
    let Merged { developed, rounds, names, counters, times, samples, parts, bytes, warnings, .. } = merged;
    for warning in &warnings {
        say!("warning: {warning}");
    }
    let error = rounds.error.as_ref();
    let figures = Figures::of_parts((&counters, &times), samples, (rounds.done, error), &names, &developed)?;
    let exposure = Exposure::choose(&args.looks, &about, &developed);
    exposure.tell(args.quiet, &developed, about.has_light);
    let mut failures = pictures.write(&about, &figures, &developed, &exposure);
    let needed = args.target_error.zip(error).and_then(|(target, error)| rounds_needed(error, target));
    let seconds = start.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        let statistics = MergeStatistics {
            schema: 1,
            about: &about,
            parts,
            bytes,
            samples,
            rejected_samples: developed.rejections.samples,
            rounds: &rounds,
            rounds_needed: needed,
            counters,
            times,
            seconds,
            warnings: &warnings,
        };
        failures.extend(
            image_io::write_text(path, &(serde_json::to_string_pretty(&statistics)? + "\n"))
                .err()
                .map(Into::into),
        );
    }
    if !args.quiet {
        say!(
            "{parts} parts, {:.1} MB, {} rounds of {:.1} s, merged in {seconds:.1} s",
            bytes as f64 / 1e6,
            rounds.done,
            rounds.seconds
        );
        super::render::say_error(&rounds);
        if failures.is_empty() {
            pictures.tell();
        }
    }
    if let Some(target) = args.target_error {
        tell_needed(target, &rounds, needed);
    }
    for failure in &failures {
        say!("error: {failure:#}");
    }
    // The parts are whole, so a disk that is full now is the only obstacle.
    Ok(if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(TRY_AGAIN) })
}

fn tell_needed(target: f64, rounds: &RoundStatistics, needed: Option<u64>) {
    match (&rounds.error, needed) {
        (Some(error), _) if error.error <= target => {
            say!("the target error of {:.2} % is reached: no rounds are needed", 100.0 * target);
        }
        (Some(_), Some(needed)) => say!(
            "the target error of {:.2} % needs about {} rounds more, {needed} in all: render the parts of the blocks that \
             are not there with --rounds {needed}, and merge all",
            100.0 * target,
            needed.saturating_sub(rounds.done)
        ),
        _ => say!("how many rounds the target error needs is not known"),
    }
}
