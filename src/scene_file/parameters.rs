//! `[parameters]`: named values that a scene file leaves open, `${name}` where they are used, and `--set name=value`.

use super::diagnostic::{nearest, suggestion};
use super::reader::{Context, Table, Value};
use std::borrow::Cow;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;
use toml::de::DeValue;

/// Longest string after substitution of parameters, in bytes.
const MAX_FILLED: usize = 1 << 16;

/// One parameter of a scene file.
#[derive(Debug)]
struct Parameter {
    /// The value; `None` where the file has no default and the command line gave none.
    value: Option<String>,
    /// Whether the value came from the command line.
    is_setting: bool,
    /// The file's description of it.
    help: Option<String>,
    used: Cell<bool>,
    span: Range<usize>,
}

/// The parameters of a scene file with their values in this run.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    by_name: BTreeMap<String, Parameter>,
}

/// A piece of a string that may contain parameters.
enum Piece<'t> {
    Text(&'t str),
    Reference(&'t str),
    /// `${` without the closing brace.
    Open,
}

impl Parameters {
    /// Reads the table `[parameters]`. The `settings` of the command line override its defaults; later settings win.
    pub(super) fn read<'a>(
        context: &'a Context<'a>,
        table: Option<&Table<'a>>,
        settings: &[(String, String)],
    ) -> Self {
        let mut by_name = BTreeMap::new();
        for (span, value) in table.map(Table::sorted_entries).unwrap_or_default() {
            if let Some(parameter) = read_parameter(&span, value) {
                by_name.insert(value.name().to_string(), parameter);
            }
        }
        for (name, setting) in settings {
            if let Some(parameter) = by_name.get_mut(name) {
                parameter.value = Some(setting.clone());
                parameter.is_setting = true;
                continue;
            }
            let known: Vec<_> = by_name.keys().map(String::as_str).collect();
            let remedy = match nearest(name, known.iter().copied()) {
                Some(near) => format!("did you mean `--set {near}={setting}`?"),
                None if known.is_empty() => {
                    format!("leave `--set` out, or give the file a `[parameters]` table with `{name}` in it")
                }
                None => format!("parameters of this file: `{}`", known.join("`, `")),
            };
            context.error_of_file(format!("`--set {name}={setting}`: no parameter `{name}`"), remedy);
        }
        Self { by_name }
    }

    /// The value of a parameter, if the parameter exists and has a value; counts as a use of it.
    pub(super) fn value(&self, name: &str) -> Option<&str> {
        let parameter = self.by_name.get(name)?;
        parameter.used.set(true);
        parameter.value.as_deref()
    }

    /// Whether `text` begins with a parameter whose value came from the command line.
    pub(super) fn begins_with_setting(&self, text: &str) -> bool {
        match pieces(text).first() {
            Some(Piece::Reference(name)) => self.by_name.get(*name).is_some_and(|p| p.is_setting),
            _ => false,
        }
    }

    /// Substitutes the values of parameters for `${name}`, and `$` for `$$`. Records an error and yields `None` where a parameter
    /// has no value.
    pub(super) fn fill_in<'t>(
        &self,
        context: &Context<'_>,
        text: &'t str,
        span: &Range<usize>,
    ) -> Option<Cow<'t, str>> {
        if !text.contains('$') {
            return Some(Cow::Borrowed(text));
        }
        let mut filled = String::with_capacity(text.len());
        for piece in pieces(text) {
            match piece {
                Piece::Text(part) => filled.push_str(part),
                Piece::Reference(name) => filled.push_str(self.resolve(context, name, span)?),
                Piece::Open => {
                    let remedy = "close the name with `}`, or write `$$` for a dollar sign";
                    context.error(span, "`${` without its `}`", remedy);
                    return None;
                }
            }
            // A short text with long parameter values must not exhaust the memory.
            if filled.len() > MAX_FILLED {
                let message = format!("longer than {MAX_FILLED} bytes with its parameters filled in");
                context.error(span, message, "make the parameters shorter");
                return None;
            }
        }
        Some(Cow::Owned(filled))
    }

    fn resolve(&self, context: &Context<'_>, name: &str, span: &Range<usize>) -> Option<&str> {
        let Some(parameter) = self.by_name.get(name) else {
            context.error_with(span, || {
                (format!("`${{{name}}}`: no parameter `{name}`"), self.undeclared(name))
            });
            return None;
        };
        let value = self.value(name);
        if value.is_none() {
            let help = parameter.help.as_ref().map(|help| format!(" ({help})")).unwrap_or_default();
            let message = format!("the parameter `{name}`{help} has no default and is not set");
            context.error(span, message, format!("give it on the command line: `--set {name}=FILE`"));
        }
        value
    }

    /// The remedy for a name that is not declared.
    fn undeclared(&self, name: &str) -> String {
        if self.by_name.is_empty() {
            return format!("declare it: a table `[parameters]` with `{name} = \"...\"`");
        }
        let known: Vec<_> = self.by_name.keys().map(String::as_str).collect();
        format!("{}; parameters are declared in `[parameters]`", suggestion(name, &known))
    }

    /// Warns about parameters that are never used.
    pub(super) fn warn_unused(&self, context: &Context<'_>) {
        for (name, parameter) in &self.by_name {
            if !parameter.used.get() {
                context
                    .warn(&parameter.span, format!("the parameter `{name}` is never used as `${{{name}}}`"));
            }
        }
    }
}

/// A default value, or a table with the optional keys `default` and `help`.
fn read_parameter<'a>(span: &Range<usize>, value: Value<'a>) -> Option<Parameter> {
    let parameter = |value, help| Parameter {
        value,
        is_setting: false,
        help,
        used: Cell::new(false),
        span: span.clone(),
    };
    if !value.is_table() {
        return default_of(value).map(|text| parameter(Some(text), None));
    }
    let mut table = value.table(format!("[parameters.{}]", value.name()), "")?;
    let default = table.optional("default", default_of);
    let help = table.optional("help", |help| help.raw_string());
    table.finish();
    Some(parameter(default?, help?))
}

fn default_of(value: Value<'_>) -> Option<String> {
    value.raw_scalar()
}

/// Splits a string at its `${name}`s and `$$`s.
fn pieces(text: &str) -> Vec<Piece<'_>> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find('$') {
        let (before, from) = rest.split_at(at);
        if !before.is_empty() {
            pieces.push(Piece::Text(before));
        }
        if let Some(after) = from.strip_prefix("${") {
            let Some((name, after)) = after.split_once('}') else {
                pieces.push(Piece::Open);
                return pieces;
            };
            pieces.push(Piece::Reference(name));
            rest = after;
        } else {
            // `$$` is a dollar sign; a dollar sign before anything else stands for itself.
            pieces.push(Piece::Text("$"));
            rest = from.strip_prefix("$$").unwrap_or(&from[1..]);
        }
    }
    if !rest.is_empty() {
        pieces.push(Piece::Text(rest));
    }
    pieces
}

impl Value<'_> {
    /// The string before substitution.
    fn raw_string(&self) -> Option<String> {
        match self.get_ref() {
            DeValue::String(text) => Some(text.to_string()),
            _ => self.refuse("a string", format!("write `{} = \"...\"`", self.name())),
        }
    }

    /// A string, number or truth value as text, before substitution.
    fn raw_scalar(&self) -> Option<String> {
        match self.get_ref() {
            DeValue::String(text) => Some(text.to_string()),
            DeValue::Integer(digits) => match i128::from_str_radix(digits.as_str(), digits.radix()) {
                Ok(integer) => Some(integer.to_string()),
                Err(_) => self.refuse("a smaller number", "give the parameter a default that fits its use"),
            },
            DeValue::Float(digits) => Some(digits.as_str().to_string()),
            DeValue::Boolean(value) => Some(value.to_string()),
            _ => {
                self.refuse("a string, a number, true or false", format!("write `{} = \"...\"`", self.name()))
            }
        }
    }
}
