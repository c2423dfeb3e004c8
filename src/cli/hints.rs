//! Hints for a wrong command line: options under the names that other programs use, and a file without a subcommand.

use clap::builder::{StyledStr, UnknownArgumentValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, ArgAction, Command, Error};
use std::collections::BTreeSet;
use std::path::Path;

/// Names of options in other programs, and the option that is meant.
const ELSEWHERE: &[(&str, &str)] = &[
    ("size", "--resolution"),
    ("dimensions", "--resolution"),
    ("width", "--resolution"),
    ("height", "--resolution"),
    ("samples", "--spp"),
    ("preset", "--quality"),
    ("bounces", "--max-depth"),
    ("jobs", "--threads"),
    ("time", "--time-limit"),
    ("timeout", "--time-limit"),
    ("ev", "--exposure"),
    ("silent", "--quiet"),
    ("out", "--output"),
];

/// Adds the other programs' option names to all subcommands, so that the error can name the right option.
pub(super) fn knowing_other_names(command: Command) -> Command {
    let own: BTreeSet<String> =
        command.get_arguments().filter_map(|arg| arg.get_long().map(str::to_owned)).collect();
    let meant = ELSEWHERE.iter().filter(|(name, option)| own.contains(&option[2..]) && !own.contains(*name));
    let command = meant.fold(command, |command, &(name, option)| {
        let parser = UnknownArgumentValueParser::suggest_arg(option);
        command.arg(Arg::new(name).long(name).action(ArgAction::SetTrue).value_parser(parser).hide(true))
    });
    command.mut_subcommands(knowing_other_names)
}

/// Extends the error of a wrong command line: where a file stands in place of a subcommand, the error says what to write instead.
pub(super) fn with_hint(mut error: Error) -> Error {
    let name = match error.get(ContextKind::InvalidSubcommand) {
        Some(ContextValue::String(name)) => name.clone(),
        _ => return error,
    };
    let is_file = Path::new(&name).extension().is_some() || Path::new(&name).is_file();
    if error.kind() == ErrorKind::InvalidSubcommand && is_file {
        let hint = StyledStr::from(format!("to render a file: cardioid render {name}"));
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![hint]));
        // A subcommand with a similar name is not meant.
        error.remove(ContextKind::SuggestedSubcommand);
    }
    error
}
