//! `cardioid part`: some rounds of a progressive picture, rendered on this machine for `cardioid merge`.

use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, crop, load};
use super::pictures::About;
use super::progress::{Console, catch_interrupts, interrupted};
use super::render::{LayersArgs, duration, identity, request_of};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, anyhow, bail};
use cardioid::film::PixelRect;
use cardioid::render::{
    CheckpointError, IntegratorKind, Overrides, PartError, PartOutcome, PartRange, RenderError, Rounds,
    Settings, is_part_of, render_part,
};
use clap::Args;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Exit code of a run that can be repeated with a better result: what is there is kept, and the next run goes on with it.
pub(super) const TRY_AGAIN: u8 = 75;

/// Render a part of a progressive picture into a file, on any machine, for `merge`
///
/// All parts together give the picture of one render to the bit. A run that is stopped keeps its rounds and ends with exit code 75; the same
/// command goes on with them. A part that is there already is not rendered again.
#[derive(Args, Clone, Debug)]
pub(crate) struct PartArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// Which part of how many, for example 3/16. All parts must have the same --rounds.
    #[arg(long, value_name = "I/N", value_parser = part)]
    part: PartRange,

    /// File to write; it appears when the part is complete. Rounds of a run that was stopped are kept in FILE.rounds.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Only this window of the picture.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop)]
    crop: Option<PixelRect>,

    /// Stop after this time, for example 55m, keep what is there, and end with exit code 75.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    time_limit: Option<Duration>,

    /// Replace a file that holds something else, and kept rounds of another picture.
    #[arg(long)]
    overwrite: bool,

    #[command(flatten)]
    layers: LayersArgs,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

fn part(text: &str) -> Result<PartRange, String> {
    let numbers = text
        .split_once('/')
        .and_then(|(part, of)| Some((part.trim().parse().ok()?, of.trim().parse().ok()?)));
    match numbers {
        Some((part, of)) if 1 <= part && part <= of => Ok(PartRange { part, of }),
        _ => Err("write I/N with I from 1 to N, for example 3/16".to_owned()),
    }
}

/// The file beside a part that keeps its rounds while it is not complete.
fn kept_beside(output: &Path) -> PathBuf {
    let mut name: OsString = output.into();
    name.push(".rounds");
    name.into()
}

pub(crate) fn run(args: &PartArgs) -> Result<ExitCode> {
    catch_interrupts();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let kept = kept_beside(&args.output);
    let mut outputs = Outputs::new([args.scene.scene.as_path()]);
    outputs.add(&args.output, "the part", Named::ByUser)?;
    outputs.add(&kept, "the rounds of an incomplete part", Named::ByUser)?;
    let console = Console::new(args.quiet, args.time_limit);
    pool.install(|| {
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
        console.finish();
        if let (Err(_), Some(_)) = (&loaded, interrupted()) {
            say!("stopped while the scene was read and built: nothing was rendered");
            return Ok(stopped());
        }
        let loaded = loaded?;
        let request = request_of(&loaded, args.crop, args.layers, settings(args, &loaded)?);
        let plan = request.settings.plan(&loaded.built.scene);
        let about = serde_json::to_value(About::of(&loaded, &request.settings, &plan)?)?;
        let mut rounds = Rounds { identity: identity(&loaded), resume: None, checkpoint: Some(kept.clone()) };
        let (scene, camera) = (&loaded.built.scene, &loaded.built.camera);
        match is_part_of(&args.output, scene, &request, (&rounds, args.part))? {
            Some(true) => {
                if !args.quiet {
                    say!("{} is there already, and complete", args.output.display());
                }
                return Ok(ExitCode::SUCCESS);
            }
            Some(false) if !args.overwrite => bail!(
                "{} is there already and is not this part; name another file, or replace it with --overwrite",
                args.output.display()
            ),
            _ => {}
        }
        if let Some(limit) = args.scene.memory_limit {
            loaded.estimate.with_photons(&request.settings, &plan, scene).check(Some(limit))?;
        }
        rounds.resume = kept.exists().then(|| kept.clone());
        let render = |rounds: &Rounds| {
            let of = (rounds.clone(), args.part, about.clone());
            render_part(scene, camera, &request, &console, of, &args.output)
        };
        let outcome = match render(&rounds) {
            Err(RenderError::Checkpoint(
                error @ (CheckpointError::Damaged { .. } | CheckpointError::Different { .. }),
            )) if rounds.resume.is_some() => {
                if !args.overwrite {
                    return Err(anyhow!(error).context("remove that file, or add --overwrite"));
                }
                say!("warning: {error}; the part begins anew");
                render(&Rounds { resume: None, ..rounds })
            }
            outcome => outcome,
        };
        console.finish();
        finish(args, outcome, &kept)
    })
}

/// The settings, of which the integrator is always the progressive one.
fn settings(args: &PartArgs, loaded: &Loaded) -> Result<Settings> {
    let asked = args.settings.over(&Overrides::default()).integrator;
    if asked.is_some_and(|integrator| integrator != IntegratorKind::Progressive) {
        bail!(
            "parts are rounds of --integrator progressive; leave --integrator out, or share out windows (render --crop)"
        );
    }
    let scene = Overrides { integrator: None, ..loaded.description.render.clone() };
    let asked = Overrides { integrator: Some(IntegratorKind::Progressive), ..args.settings.over(&scene) };
    Ok(Settings::from(&asked))
}

/// Exit code of a run that was stopped: that of Ctrl-C where a person did it, and else that for trying again.
pub(super) fn stopped() -> ExitCode {
    const CTRL_C: u8 = 130;
    ExitCode::from(interrupted().filter(|&code| code == CTRL_C).unwrap_or(TRY_AGAIN))
}

fn finish(args: &PartArgs, outcome: Result<PartOutcome, RenderError>, kept: &Path) -> Result<ExitCode> {
    match outcome {
        Ok(PartOutcome::Whole { rounds, seconds, bytes, pixels_and_blocks: [pixels, blocks], warnings }) => {
            // Kept rounds are of no use any more; that a file stays is no error.
            let _ = fs::remove_file(kept);
            for warning in &warnings {
                say!("warning: {warning}");
            }
            if !args.quiet {
                let PartRange { part, of } = args.part;
                say!(
                    "part {part} of {of}: {rounds} rounds, {seconds:.1} s, {:.1} bytes a pixel and block",
                    bytes as f64 / (pixels * blocks) as f64
                );
                say!("wrote {}", args.output.display());
            }
            Ok(ExitCode::SUCCESS)
        }
        Ok(PartOutcome::Stopped { done, of, failure }) => {
            match failure {
                Some(error) => say!("stopped, and the {done} rounds so far could not be kept: {error}"),
                None if done == 0 => say!("stopped before the first round"),
                None => say!(
                    "stopped: {done} of {of} rounds are kept in {}; the same command goes on with them",
                    kept.display()
                ),
            }
            Ok(stopped())
        }
        // A full disk or a lost network drive may be well again at the next attempt.
        Err(error @ RenderError::Part(PartError::Write(_))) => {
            say!("error: {error}");
            Ok(ExitCode::from(TRY_AGAIN))
        }
        Err(error) => Err(error.into()),
    }
}
