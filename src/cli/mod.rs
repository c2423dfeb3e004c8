//! The subcommands, one file for each; the only users of clap and anyhow.
// With these lints a new choice of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

/// Prints a line to standard error. A line that cannot be written (a log on a full disk, a pipe whose reader is gone) is dropped,
/// because the computed result matters more than the message.
macro_rules! say {
    ($($words:tt)*) => {
        $crate::cli::say(format_args!($($words)*))
    };
}

mod bake;
mod bench_bvh;
mod bench_caustic;
mod bricks;
mod compare;
mod contents;
mod hints;
mod info;
mod meaning;
mod media_info;
mod merge;
mod outputs;
mod part;
mod photons;
mod picture;
mod pictures;
mod probe;
mod progress;
mod radiosity;
mod render;
mod settings;
mod tradeoff;
mod upright;
mod validate;
mod windows;

use anyhow::Context;
use cardioid::image_io;
use clap::builder::ValueParser;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::fmt;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Exit codes of the program, for the end of the help.
const EXIT_CODES: &str = "\
Exit codes:
  0    done (also where --time-limit stopped a render: the picture has fewer samples)
  1    an error, told on standard error; also where a picture was written, and something beside it could not be
  2    a wrong command line
  75   try again: `part` was stopped and kept its rounds, `merge` lacks parts, or a disk refused a file
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
    Part(part::PartArgs),
    Merge(merge::MergeArgs),
    Photons(photons::PhotonsArgs),
    Bricks(bricks::BricksArgs),
    Radiosity(radiosity::RadiosityArgs),
    Bake(bake::BakeArgs),
    Info(info::InfoArgs),
    Compare(compare::CompareArgs),
    Probe(probe::ProbeArgs),
    Bench(bench_bvh::BenchArgs),
    Tradeoff(tradeoff::TradeoffArgs),
    Validate(validate::ValidateArgs),
}

/// The same command with options that accept values beginning with a dash. "-1" for a number of threads is then a wrong number,
/// with a message about the right range, and not an unknown option. File names and optional values are excluded: there an option
/// is more likely.
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
    survive_file_limits();
    let command = hints::knowing_other_names(taking_any_value(Cli::command()));
    let matches = command.try_get_matches().unwrap_or_else(|error| hints::with_hint(error).exit());
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let outcome = match cli.command {
        Command::Render(args) => render::run(&args),
        Command::Part(args) => part::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Photons(args) => photons::run(&args),
        Command::Bricks(args) => bricks::run(&args),
        Command::Radiosity(args) => radiosity::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Probe(args) => probe::run(&args),
        Command::Bench(args) => bench_bvh::run(&args),
        Command::Tradeoff(args) => tradeoff::run(&args),
        Command::Validate(args) => validate::run(&args),
    };
    outcome.unwrap_or_else(|error| {
        say!("error: {error:#}");
        ExitCode::FAILURE
    })
}

/// Makes a file that grows beyond the user's limit (`ulimit -f`) an error of that write, like a full disk, instead of the end of
/// the program.
fn survive_file_limits() {
    let ignored = Arc::new(AtomicBool::new(false));
    // Without the handler, such a write ends the program, as it would have without this call.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, ignored);
}

/// Writes a text to standard output. A reader that closes the pipe early (`cardioid info scene | head`) is no error.
fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write to standard output"),
    }
}

/// Writes a text to a file, or to standard output where `path` is `None` or `-`.
fn write_or_print(path: Option<&Path>, text: &str) -> anyhow::Result<()> {
    match path.filter(|path| !image_io::is_standard_output(path)) {
        Some(path) => Ok(image_io::write_text(path, text)?),
        None => print(text),
    }
}

/// Prints a line to standard error, if possible.
fn say(words: fmt::Arguments<'_>) {
    let _ = std::io::stderr().write_all(format!("{words}\n").as_bytes());
}
