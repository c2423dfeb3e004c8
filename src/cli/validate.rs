//! `cardioid validate`: estimates against closed forms.

use super::progress::{Console, catch_interrupts, interrupted};
use super::settings::count;
use anyhow::{Context, Result};
use cardioid::embree::Device;
use cardioid::image_io;
use cardioid::measure::validate::{ValidateError, validate};
use clap::Args;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Whether light comes out as closed forms have it: form factors, closed rooms, glass, caustics, density estimates
#[derive(Args, Clone, Debug)]
pub(crate) struct ValidateArgs {
    /// Seeds of each estimate. More of them find smaller errors.
    #[arg(long, value_name = "N", default_value = "16", value_parser = count)]
    seeds: u64,

    /// Page to write (Markdown); standard output where there is none.
    #[arg(short, long, value_name = "FILE.md")]
    output: Option<PathBuf>,

    /// Table to write as JSON.
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,

    /// Threads; 0 for as many as the machine has.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

/// Fails where a row does not hold.
pub(super) fn run(args: &ValidateArgs) -> Result<ExitCode> {
    catch_interrupts();
    for output in args.output.iter().chain(&args.json) {
        image_io::check_writable(output)?;
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
            eprintln!("stopped; nothing was written");
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        }
        other => other?,
    };
    let page = validation.to_markdown();
    match &args.output {
        Some(output) => image_io::write_text(output, &page)?,
        None => std::io::stdout().lock().write_all(page.as_bytes())?,
    }
    if let Some(output) = &args.json {
        image_io::write_text(output, &serde_json::to_string_pretty(&validation)?)?;
    }
    for row in validation.failures() {
        eprintln!(
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
    Ok(if validation.passed() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
