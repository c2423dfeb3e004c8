//! The subcommands, one file each; the only users of clap and anyhow.

/// A line on standard error. Where it cannot be written (a log on a full disk, a pipe whose reader is gone) it is left out: what
/// is computed is worth more than what is said of it.
macro_rules! say {
    ($($words:tt)*) => {
        $crate::cli::say(format_args!($($words)*))
    };
}

mod bench_bvh;
mod bench_caustic;
mod compare;
mod info;
mod meaning;
mod outputs;
mod photons;
mod picture;
mod probe;
mod progress;
mod render;
mod settings;
mod tradeoff;
mod validate;

use clap::builder::ValueParser;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::fmt;
use std::io::Write;
use std::process::ExitCode;

/// What the program's end tells, for the end of the help.
const EXIT_CODES: &str = "\
Exit codes:
  0    done (also where --time-limit stopped a render: the picture has fewer samples)
  1    an error, told on standard error; also where a picture was written, and something beside it could not be
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

/// The same command, whose options take for their value what begins with a dash: "-1" for a number of threads is no unknown
/// option, but a wrong number, and the message says what is right. Names of files, and values that may be left out, are not
/// taken so: there an option is likelier.
fn taking_any_value(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| {
        let is_path = arg.get_value_parser().type_id() == ValueParser::path_buf().type_id();
        let is_optional = arg.get_num_args().is_some_and(|range| range.min_values() == 0);
        match arg.is_positional() || !arg.get_action().takes_values() || is_path || is_optional {
            true => arg,
            false => arg.allow_hyphen_values(true),
        }
    });
    command.mut_subcommands(taking_any_value)
}

/// Runs the program. Its exit codes are listed in [`EXIT_CODES`].
pub(crate) fn run() -> ExitCode {
    let cli = Cli::from_arg_matches(&taking_any_value(Cli::command()).get_matches())
        .unwrap_or_else(|error| error.exit());
    let outcome = match cli.command {
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
        say!("error: {error:#}");
        ExitCode::FAILURE
    })
}

/// A line on standard error, where that can be written.
fn say(words: fmt::Arguments<'_>) {
    let _ = std::io::stderr().write_all(format!("{words}\n").as_bytes());
}
