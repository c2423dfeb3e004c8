//! The subcommands, one file each; the only users of clap and anyhow.

mod bench_bvh;
mod bench_caustic;
mod compare;
mod info;
mod photons;
mod picture;
mod probe;
mod progress;
mod render;
mod settings;
mod tradeoff;
mod validate;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// What the program's end tells, for the end of the help.
const EXIT_CODES: &str = "\
Exit codes:
  0    done (also where --time-limit stopped a render: the picture has fewer samples)
  1    an error, told on standard error
  2    a wrong command line
  130  stopped by Ctrl-C; 143 by SIGTERM, 129 by SIGHUP. `render` writes what is there first";

/// Photon mapping on Embree: caustics and interreflection, right and fast.
#[derive(Parser, Debug)]
#[command(name = "cardioid", version, about, arg_required_else_help = true, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    Render(render::RenderArgs),
    Photons(photons::PhotonsArgs),
    Info(info::InfoArgs),
    Compare(compare::CompareArgs),
    Probe(probe::ProbeArgs),
    Bench(bench_bvh::BenchArgs),
    Tradeoff(tradeoff::TradeoffArgs),
    Validate(validate::ValidateArgs),
}

/// Runs the program. Its exit codes are listed in [`EXIT_CODES`].
pub(crate) fn run() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Render(args) => render::run(&args),
        Command::Photons(args) => photons::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Probe(args) => probe::run(&args),
        Command::Bench(args) => bench_bvh::run(&args),
        Command::Tradeoff(args) => tradeoff::run(&args),
        Command::Validate(args) => validate::run(&args),
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
