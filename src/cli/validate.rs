//! `cardioid validate`: estimates against closed forms.

use super::outputs::{Named, Outputs};
use super::progress::{Console, catch_interrupts, interrupted};
use super::write_or_print;
use anyhow::{Context, Result};
use cardioid::embree::Device;
use cardioid::measure::validate::{ValidateError, validate};
use cardioid::settings::count;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Whether light comes out as closed forms have it: form factors, closed rooms, glass, caustics, density estimates
#[derive(Args, Clone, Debug)]
pub(crate) struct ValidateArgs {
    /// Seeds of each estimate, two at least. More of them find smaller errors; with fewer than 16 much cannot be told from noise.
    #[arg(long, value_name = "N", default_value = "16", value_parser = seeds)]
    seeds: u64,

    /// Page to write (Markdown); standard output where there is none, or `-`.
    #[arg(short, long, value_name = "FILE.md")]
    output: Option<PathBuf>,

    /// Table to write as JSON; `-` for standard output.
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,

    /// Threads; 0 for as many as the machine has.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = super::picture::threads)]
    threads: usize,
}

fn seeds(text: &str) -> Result<u64, String> {
    match count(text)? {
        seeds @ 2..=1_000_000 => Ok(seeds),
        _ => {
            Err("write a number of seeds from 2 (one tells no noise) to 1000000; 16 is the default"
                .to_owned())
        }
    }
}

/// Runs the checks; the exit code is a failure where a row does not hold.
pub(super) fn run(args: &ValidateArgs) -> Result<ExitCode> {
    catch_interrupts();
    let mut outputs = Outputs::new([]);
    for (output, what) in [(&args.output, "the page"), (&args.json, "--json")] {
        if let Some(output) = output {
            outputs.add_text(output, what, Named::ByUser)?;
        }
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads)
        .build()
        .context("cannot start the threads")?;
    let device = Arc::new(Device::new(0).context("cannot trace rays")?);
    let console = Console::new(false, None);
    let validated = pool.install(|| validate(&device, args.seeds, &console));
    console.finish();
    let validation = match validated {
        Err(ValidateError::Stopped) => {
            say!("stopped; nothing was written");
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        }
        other => other?,
    };
    let page = validation.to_markdown();
    write_or_print(args.output.as_deref(), &page)?;
    if let Some(output) = &args.json {
        write_or_print(Some(output), &serde_json::to_string_pretty(&validation)?)?;
    }
    let (undecided, failures): (Vec<_>, Vec<_>) =
        validation.failures().partition(|row| row.is_undecided(validation.quantile));
    for row in &failures {
        say!(
            "error: {}, {}: {:.6} in place of {:.6} {} ({:+.3} %, standard error {:.3} %)",
            row.what,
            row.by,
            row.mean,
            row.exact,
            row.unit,
            100.0 * row.deviation(),
            100.0 * row.standard_error / row.exact.abs()
        );
    }
    if !undecided.is_empty() {
        say!(
            "{} {} of {} quantities cannot be told from noise with {} seeds, which says nothing against them; take more, for example \
             --seeds {}",
            if failures.is_empty() { "error:" } else { "note:" },
            undecided.len(),
            validation.rows.len(),
            args.seeds,
            (2 * args.seeds).max(16)
        );
    }
    Ok(if validation.passed() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
