//! The program as a process, for tests of the whole.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// The program in a folder, without input.
pub(crate) fn program(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cardioid"));
    command.stdin(Stdio::null()).current_dir(folder);
    command
}

/// What a run in a folder gave.
pub(crate) fn run(folder: &Path, args: &[&str]) -> Output {
    program(folder).args(args).output().unwrap()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}
