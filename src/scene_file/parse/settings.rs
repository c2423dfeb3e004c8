//! `[render]`: the settings of the table in [`crate::settings`], under the same names.

use crate::scene_file::reader::{Table, Value};
use crate::settings::{Asked, Kind, Overrides, Parameter, SETTINGS, Setting};

/// Example of a length for messages.
const LENGTH: &str = "0.01";

/// Reads all settings. Lengths are in units of `unit` metres.
pub(super) fn read_render(mut table: Table<'_>, unit: f64) -> Option<Overrides> {
    let mut asked = Overrides::default();
    let mut is_right = true;
    for setting in SETTINGS {
        match read_setting(&mut table, setting, unit) {
            Some(None) => {}
            Some(Some(value)) => setting.ask(&mut asked, value),
            None => is_right = false,
        }
    }
    table.finish();
    is_right.then_some(asked)
}

/// Reads one setting. `None` is an error, `Some(None)` means absent.
fn read_setting(table: &mut Table<'_>, setting: &Setting, unit: f64) -> Option<Option<Asked>> {
    let read = |value: Value<'_>| {
        if setting.not_in_scene_files.is_empty() {
            return read_value(value, &setting.kind, unit);
        }
        let name = setting.name;
        let message = format!("`{name}` is no setting of scene files: {}", setting.not_in_scene_files);
        let remedy = format!("leave it out, and give `--{name}` on the command line");
        value.context().error(&value.span(), message, remedy);
        None
    };
    match setting.kind {
        Kind::Choice { parameter: Some(parameter), .. } => {
            let choice = table.optional(setting.name, read);
            // Read whatever the choice is, so that it is no unknown key.
            let found = read_parameter(table, setting.name, choice.flatten(), &parameter);
            choice.and(found)
        }
        // Absent, and not among the keys that are suggested for misspelt ones.
        _ if !setting.not_in_scene_files.is_empty() && table.peek(setting.name).is_none() => Some(None),
        _ => table.optional(setting.name, read),
    }
}

fn read_value(value: Value<'_>, kind: &Kind, unit: f64) -> Option<Asked> {
    match *kind {
        Kind::Flag => value.boolean().map(Asked::Flag),
        Kind::Count { least, most } => value.integer(least..=most).map(Asked::Count),
        Kind::Number { example, .. } => {
            value.number_if(&kind.expected(), example, |x| kind.holds(x)).map(Asked::Number)
        }
        Kind::Length => {
            let length = value.number_if("a length above zero", LENGTH, |x| kind.holds(x))?;
            Some(Asked::Number(length * unit))
        }
        Kind::Memory => value.refuse("no size of memory", "give it on the command line"),
        Kind::Choice { names, .. } => {
            let names: Vec<_> = names.iter().map(|named| (named.name, named.name)).collect();
            value.choice(&names).map(|name| Asked::Choice(name, None))
        }
    }
}

/// Reads the number that belongs to one choice of a setting; given alone, it implies that choice.
fn read_parameter(
    table: &mut Table<'_>,
    setting: &str,
    choice: Option<Asked>,
    parameter: &Parameter,
) -> Option<Option<Asked>> {
    let Some(value) = table.get(parameter.name) else { return Some(choice) };
    let number = read_value(value, &parameter.kind(), 1.0);
    match choice {
        Some(Asked::Choice(name, _)) if name != parameter.of => {
            let (own, of) = (parameter.name, parameter.of);
            let message = format!("`{own}` belongs to the {of}, and `{setting}` is another");
            let remedy = format!("leave `{own}` out, or write `{setting} = \"{of}\"`");
            table.context().error(&value.span(), message, remedy);
            None
        }
        _ => match number? {
            Asked::Number(number) => Some(Some(Asked::Choice(parameter.of, Some(number)))),
            _ => None,
        },
    }
}
