//! The subcommands, one file each; the only users of clap and anyhow.

mod compare;
mod info;
mod picture;
mod progress;
mod render;
mod settings;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Photon mapping on Embree: caustics and interreflection, right and fast.
#[derive(Parser, Debug)]
#[command(name = "cardioid", version, about, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    Render(render::RenderArgs),
    Info(info::InfoArgs),
    Compare(compare::CompareArgs),
}

/// Exit code of a run that was stopped by a signal: 128 + SIGINT, as shells do.
const INTERRUPTED: u8 = 130;

/// Runs the program. Exit code 0 for success, 1 for an error, 2 for a wrong command line, 130 when interrupted.
pub(crate) fn run() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Render(args) => render::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Compare(args) => compare::run(&args),
    };
    outcome.unwrap_or_else(|error| {
        // A pipe that the reader closed is no error: `cardioid info scene | head`.
        let closed = error.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        if closed == Some(std::io::ErrorKind::BrokenPipe) {
            return ExitCode::SUCCESS;
        }
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}
