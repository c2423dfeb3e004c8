//! A typed reader over the tables of a TOML file.
//!
//! Reading a value either yields it or records a [`Diagnostic`] and yields `None`. A caller can therefore read every key of a
//! table before it gives up, and all errors of a file are found in one pass. A [`Table`] remembers which keys were asked for: a
//! key that is left over when the table is [finished](Table::finish) is unknown and refused.

use super::colour_text::{NoColour, colour_of};
use super::description::{Location, SceneWarning};
use super::diagnostic::{Diagnostic, SceneFileError, SourceText, meant, suggestion};
use super::parameters::Parameters;
use glam::DVec3;
use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use toml_datetime::Datetime;

/// Most errors of a file that are kept; the rest are only counted. A text may have millions.
const KEPT: usize = 100;

/// Shared state while one file is read: its text, its parameters, and the errors found so far.
#[derive(Debug)]
pub(super) struct Context<'a> {
    pub(super) source: SourceText<'a>,
    /// Folder of the file, from which relative paths start.
    pub(super) folder: PathBuf,
    pub(super) parameters: Rc<Parameters>,
    diagnostics: RefCell<Vec<(usize, Diagnostic)>>,
    /// Number of errors beyond those kept.
    more: Cell<u64>,
    warnings: RefCell<Vec<SceneWarning>>,
}

impl<'a> Context<'a> {
    pub(super) fn new(source: SourceText<'a>, folder: PathBuf) -> Self {
        Self {
            source,
            folder,
            parameters: Rc::default(),
            diagnostics: RefCell::default(),
            more: Cell::default(),
            warnings: RefCell::default(),
        }
    }

    /// Records an error about the text in `span`.
    pub(super) fn error(&self, span: &Range<usize>, message: impl Into<String>, remedy: impl Into<String>) {
        self.error_with(span, || (message.into(), remedy.into()));
    }

    /// Records an error whose message and remedy are costly to build, unless enough errors are recorded already.
    pub(super) fn error_with(&self, span: &Range<usize>, what: impl FnOnce() -> (String, String)) {
        if self.diagnostics.borrow().len() >= KEPT {
            self.more.set(self.more.get() + 1);
            return;
        }
        let (message, remedy) = what();
        let diagnostic = self.source.diagnostic(span, message, remedy);
        self.diagnostics.borrow_mut().push((span.start, diagnostic));
    }

    /// Removes an error that another one describes better.
    fn retract(&self, span: &Range<usize>, message: &str) {
        let mut diagnostics = self.diagnostics.borrow_mut();
        let found = diagnostics
            .iter()
            .rposition(|(at, diagnostic)| *at == span.start && diagnostic.message == message);
        if let Some(index) = found {
            diagnostics.remove(index);
        }
    }

    /// Counts errors that do not get a message each.
    pub(super) fn leave_out(&self, count: u64) {
        self.more.set(self.more.get() + count);
    }

    /// Records an error about the file as a whole.
    pub(super) fn error_of_file(&self, message: impl Into<String>, remedy: impl Into<String>) {
        let diagnostic = self.source.diagnostic_of_file(message.into(), remedy.into());
        self.diagnostics.borrow_mut().push((0, diagnostic));
    }

    pub(super) fn warn(&self, span: &Range<usize>, message: impl Into<String>) {
        let location = self.source.location(span.start);
        self.warnings.borrow_mut().push(SceneWarning { location, message: message.into() });
    }

    /// Records a warning about a place that may be in another file.
    pub(super) fn warn_at(&self, location: Location, message: impl Into<String>) {
        self.warnings.borrow_mut().push(SceneWarning { location, message: message.into() });
    }

    /// The file.
    pub(super) fn file(&self) -> &Path {
        self.source.file()
    }

    pub(super) fn location(&self, span: &Range<usize>) -> Location {
        self.source.location(span.start)
    }

    /// All that was recorded.
    pub(super) fn into_findings(self) -> Findings {
        let mut diagnostics = self.diagnostics.into_inner();
        diagnostics.sort_by_key(|&(offset, _)| offset);
        Findings {
            diagnostics: diagnostics.into_iter().map(|(_, diagnostic)| diagnostic).collect(),
            more: self.more.get(),
            warnings: self.warnings.into_inner(),
        }
    }
}

/// Errors and warnings recorded while a file was read.
#[derive(Debug)]
pub(super) struct Findings {
    /// Errors in the order of the file.
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Number of errors beyond `diagnostics`.
    pub(super) more: u64,
    pub(super) warnings: Vec<SceneWarning>,
}

impl Findings {
    pub(super) fn into_error(self) -> SceneFileError {
        SceneFileError::Invalid { diagnostics: self.diagnostics, more: self.more }
    }
}

/// The range of numbers that a key accepts. Every number in it is finite.
#[derive(Debug)]
pub(super) struct Expected {
    /// Completes "expected ...".
    pub(super) what: &'static str,
    /// A value in the range.
    pub(super) example: &'static str,
    pub(super) holds: fn(f64) -> bool,
}

/// Any finite number.
pub(super) const NUMBER: Expected = Expected { what: "a number", example: "1.5", holds: |_| true };
/// For lengths and scales.
pub(super) const POSITIVE: Expected =
    Expected { what: "a number above 0", example: "1.0", holds: |x| x > 0.0 };
/// A factor on the number of photons, relative to the number without it.
pub(super) const SHARE: Expected =
    Expected { what: "a number from 1e-6 to 1e6", example: "2.0", holds: |x| (1e-6..=1e6).contains(&x) };
/// For radiometric quantities and absorption.
pub(super) const NON_NEGATIVE: Expected =
    Expected { what: "a number of at least 0", example: "1.0", holds: |x| x >= 0.0 };
/// For reflectances.
pub(super) const FRACTION: Expected = Expected {
    what: "a number from 0 to 1 (more would make light)",
    example: "0.75",
    holds: |x| (0.0..=1.0).contains(&x),
};

/// A value of the file and the name of the key it belongs to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Value<'a> {
    context: &'a Context<'a>,
    value: &'a Spanned<DeValue<'a>>,
    name: &'a str,
    /// Whether it is an item of an array.
    is_item: bool,
}

impl<'a> Value<'a> {
    pub(super) fn new(context: &'a Context<'a>, name: &'a str, value: &'a Spanned<DeValue<'a>>) -> Self {
        Self { context, value, name, is_item: false }
    }

    /// Byte range of the value in the file.
    pub(super) fn span(&self) -> Range<usize> {
        self.value.span()
    }

    pub(super) fn context(&self) -> &'a Context<'a> {
        self.context
    }

    /// Name of the key that the value belongs to.
    pub(super) fn name(&self) -> &'a str {
        self.name
    }

    /// The value as the parser left it.
    pub(super) fn get_ref(&self) -> &'a DeValue<'a> {
        self.value.get_ref()
    }

    pub(super) fn is_table(&self) -> bool {
        matches!(self.value.get_ref(), DeValue::Table(_))
    }

    /// Whether it is a truth value, or a parameter that stands for one.
    pub(super) fn is_boolean(&self) -> bool {
        let parameter = self.whole_parameter().map(|(_, text)| text.trim());
        matches!(self.value.get_ref(), DeValue::Boolean(_)) || matches!(parameter, Some("true" | "false"))
    }

    pub(super) fn is_string(&self) -> bool {
        matches!(self.value.get_ref(), DeValue::String(_))
    }

    /// Whether it is this text.
    pub(super) fn is_text(&self, text: &str) -> bool {
        matches!(self.value.get_ref(), DeValue::String(own) if own.as_ref() == text)
    }

    /// Records that the key does not accept the value.
    pub(super) fn refuse<T>(&self, expected: &str, remedy: impl Into<String>) -> Option<T> {
        let verb = if self.is_item { "contains" } else { "is" };
        let message = format!("`{}` {verb} {}: expected {expected}", self.name, self.found());
        self.context.error(&self.span(), message, remedy);
        None
    }

    fn refuse_with_example<T>(&self, expected: &str, example: &str) -> Option<T> {
        match self.is_item {
            true => self.refuse(expected, format!("write for example {example} in its place")),
            false => self.refuse(expected, format!("write for example `{} = {example}`", self.name)),
        }
    }

    /// The value as a message shows it: its text where that is short, otherwise its kind.
    fn found(&self) -> String {
        const SHORT: usize = 40;
        let text = self.context.source.slice(&self.span()).trim();
        let kind = match self.value.get_ref() {
            DeValue::Table(_) => "a table".to_string(),
            DeValue::Array(items) if text.len() > SHORT => format!("a list of {} items", items.len()),
            DeValue::String(_) if text.len() > SHORT => "a string".to_string(),
            _ => text.to_string(),
        };
        match self.whole_parameter() {
            Some((name, value)) => format!("`{value}` (the parameter `{name}`)"),
            None => kind,
        }
    }

    /// Name and value of the parameter where the value is a string that consists of a single `${name}`.
    pub(super) fn whole_parameter(&self) -> Option<(&'a str, &'a str)> {
        let DeValue::String(text) = self.value.get_ref() else { return None };
        let name = text.strip_prefix("${")?.strip_suffix('}')?;
        Some((name, self.context.parameters.value(name)?))
    }

    /// The value as a floating-point number, if it is one; may be infinite or NaN.
    fn as_f64(&self) -> Option<f64> {
        match self.value.get_ref() {
            DeValue::Integer(digits) => {
                i128::from_str_radix(digits.as_str(), digits.radix()).ok().map(|integer| integer as f64)
            }
            DeValue::Float(digits) => digits.as_str().parse().ok(),
            DeValue::String(_) => self.whole_parameter()?.1.trim().parse().ok(),
            _ => None,
        }
    }

    /// A finite number in a range.
    pub(super) fn number(&self, expected: &Expected) -> Option<f64> {
        self.number_if(expected.what, expected.example, expected.holds)
    }

    /// A finite number for which `holds`: `what` completes "expected ...", `example` is one.
    pub(super) fn number_if(&self, what: &str, example: &str, holds: impl Fn(f64) -> bool) -> Option<f64> {
        // A reference to an undeclared parameter gets its own message.
        if self.is_string() && self.whole_parameter().is_none() {
            self.string()?;
        }
        match self.as_f64() {
            Some(number) if !number.is_finite() => {
                self.refuse_with_example(&format!("{what} that is finite"), example)
            }
            Some(number) if holds(number) => Some(number),
            _ => self.refuse_with_example(what, example),
        }
    }

    /// An integer in a range; `1e6` counts as an integer.
    pub(super) fn integer(&self, range: RangeInclusive<u64>) -> Option<u64> {
        /// Above this not every integer has an exact `f64`.
        const EXACT: f64 = 9_007_199_254_740_992.0;
        if self.is_string() && self.whole_parameter().is_none() {
            self.string()?;
        }
        let parameter = self.whole_parameter().and_then(|(_, text)| text.trim().parse::<i128>().ok());
        let exact = match self.value.get_ref() {
            DeValue::Integer(digits) => i128::from_str_radix(digits.as_str(), digits.radix()).ok(),
            _ => parameter,
        };
        let rounded = || self.as_f64().filter(|x| x.fract() == 0.0 && x.abs() <= EXACT).map(|x| x as i128);
        let integer = exact.or_else(rounded).and_then(|integer| u64::try_from(integer).ok());
        if let Some(integer) = integer.filter(|integer| range.contains(integer)) {
            return Some(integer);
        }
        let what = format!("a whole number from {} to {}", range.start(), range.end());
        self.refuse_with_example(&what, &range.start().max(&1).to_string())
    }

    pub(super) fn boolean(&self) -> Option<bool> {
        let parameter = self.whole_parameter().map(|(_, text)| text.trim());
        match (self.value.get_ref(), parameter) {
            (DeValue::Boolean(value), _) => Some(*value),
            (_, Some("true")) => Some(true),
            (_, Some("false")) => Some(false),
            _ => self.refuse_with_example("true or false", "true"),
        }
    }

    /// A string with its parameters filled in.
    pub(super) fn string(&self) -> Option<Cow<'a, str>> {
        match self.value.get_ref() {
            DeValue::String(text) => self.context.parameters.fill_in(self.context, text, &self.span()),
            _ => self.refuse_with_example("a string", "\"...\""),
        }
    }

    /// A path. It is relative to the file's folder, or to the current directory where it begins with a parameter that was set on
    /// the command line.
    pub(super) fn path(&self) -> Option<PathBuf> {
        let text = self.string()?;
        if text.is_empty() {
            return self.refuse_with_example("the path of a file", "\"meshes/knot.ply\"");
        }
        let written = match self.value.get_ref() {
            DeValue::String(written) => written.as_ref(),
            _ => "",
        };
        let from_outside = self.context.parameters.begins_with_setting(written);
        let path = PathBuf::from(text.as_ref());
        Some(if from_outside { path } else { self.context.folder.join(path) })
    }

    /// One of several names.
    pub(super) fn choice<T: Copy>(&self, choices: &[(&'static str, T)]) -> Option<T> {
        let text = self.string()?;
        if let Some(&(_, choice)) = choices.iter().find(|(name, _)| *name == text) {
            return Some(choice);
        }
        let names: Vec<_> = choices.iter().map(|&(name, _)| name).collect();
        let what = format!("one of \"{}\"", names.join("\", \""));
        self.refuse(&what, suggestion(&text, &names))
    }

    pub(super) fn list(&self, what: &str, example: &str) -> Option<impl ExactSizeIterator<Item = Self>> {
        match self.value.get_ref() {
            DeValue::Array(items) => Some(items.iter().map(|value| Self { value, is_item: true, ..*self })),
            _ => self.refuse_with_example(what, example),
        }
    }

    /// Three numbers, each in a range.
    pub(super) fn vector(&self, expected: &Expected) -> Option<DVec3> {
        const EXAMPLE: &str = "[0.0, 1.0, 0.0]";
        let items = self.list("a list of 3 numbers", EXAMPLE)?;
        if items.len() != 3 {
            return self.refuse_with_example("a list of 3 numbers", EXAMPLE);
        }
        let numbers: Vec<_> = items.map(|item| item.number(expected)).collect();
        Some(DVec3::new(numbers[0]?, numbers[1]?, numbers[2]?))
    }

    /// The value as a date or time, if it is one.
    pub(super) fn datetime(&self) -> Option<Datetime> {
        match self.value.get_ref() {
            DeValue::Datetime(found) => Some(*found),
            _ => None,
        }
    }

    /// Two numbers, each in a range.
    pub(super) fn pair(&self, expected: &Expected, example: &str) -> Option<[f64; 2]> {
        let items = self.list("a list of 2 numbers", example)?;
        if items.len() != 2 {
            return self.refuse_with_example("a list of 2 numbers", example);
        }
        let numbers: Vec<_> = items.map(|item| item.number(expected)).collect();
        Some([numbers[0]?, numbers[1]?])
    }

    /// A colour: three numbers for red, green and blue, one for all, or a text ([`colour_of`]).
    pub(super) fn colour(&self, expected: &Expected) -> Option<DVec3> {
        match self.value.get_ref() {
            DeValue::Table(_) | DeValue::Boolean(_) | DeValue::Datetime(_) => {
                self.refuse_with_example("a number or a list [red, green, blue]", "[0.8, 0.5, 0.2]")
            }
            DeValue::String(_) if self.as_f64().is_none() => {
                let text = self.string()?;
                match colour_of(&text) {
                    Ok(colour) if colour.to_array().into_iter().all(expected.holds) => Some(colour),
                    Ok(_) => self.refuse(expected.what, "all three components count"),
                    Err(NoColour { expected, example }) => self.refuse_with_example(expected, example),
                }
            }
            _ => self.numbers(expected),
        }
    }

    /// Three numbers, or one for all.
    pub(super) fn numbers(&self, expected: &Expected) -> Option<DVec3> {
        match self.value.get_ref() {
            DeValue::Array(_) => self.vector(expected),
            _ => self.number(expected).map(DVec3::splat),
        }
    }

    /// A table; `title` names it in messages.
    pub(super) fn table(&self, title: impl Into<String>, example: &str) -> Option<Table<'a>> {
        match self.value.get_ref() {
            DeValue::Table(entries) => Some(Table::new(self.context, entries, self.span(), title)),
            _ => self.refuse("a table", example),
        }
    }
}

/// A table of the file, with a record of the keys that were asked for.
#[derive(Debug)]
pub(super) struct Table<'a> {
    context: &'a Context<'a>,
    entries: &'a DeTable<'a>,
    span: Range<usize>,
    title: String,
    known: Vec<&'static str>,
    /// Required keys that are missing, with the messages about them.
    missing: Vec<(&'static str, String)>,
}

impl<'a> Table<'a> {
    pub(super) fn new(
        context: &'a Context<'a>,
        entries: &'a DeTable<'a>,
        span: Range<usize>,
        title: impl Into<String>,
    ) -> Self {
        Self { context, entries, span, title: title.into(), known: Vec::new(), missing: Vec::new() }
    }

    pub(super) fn context(&self) -> &'a Context<'a> {
        self.context
    }

    /// Where the table is, for messages about it as a whole.
    pub(super) fn span(&self) -> &Range<usize> {
        &self.span
    }

    pub(super) fn title(&self) -> &str {
        &self.title
    }

    pub(super) fn location(&self) -> Location {
        self.context.location(&self.span)
    }

    /// Records an error about the table as a whole.
    pub(super) fn refuse<T>(&self, message: impl Into<String>, remedy: impl Into<String>) -> Option<T> {
        self.context.error(&self.span, message, remedy);
        None
    }

    /// All entries in the order of the file, with the places of their names; none of them counts as unknown.
    pub(super) fn sorted_entries(&self) -> Vec<(Range<usize>, Value<'a>)> {
        let mut entries: Vec<_> = self
            .entries
            .iter()
            .map(|(key, value)| (key.span(), Value::new(self.context, key.get_ref(), value)))
            .collect();
        entries.sort_by_key(|(span, _)| span.start);
        entries
    }

    /// The value of a key, if the table has it; the key counts as known.
    pub(super) fn get(&mut self, key: &'static str) -> Option<Value<'a>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.peek(key)
    }

    /// The value of a key without making it known: [`Self::finish`] still refuses it.
    pub(super) fn peek(&self, key: &'static str) -> Option<Value<'a>> {
        let entry = self.entries.iter().find(|(name, _)| name.get_ref() == key)?;
        Some(Value::new(self.context, key, entry.1))
    }

    /// Reads a required key; `example` is a valid value for the message.
    pub(super) fn required<T>(
        &mut self,
        key: &'static str,
        example: &str,
        read: impl FnOnce(Value<'a>) -> Option<T>,
    ) -> Option<T> {
        match self.get(key) {
            Some(value) => read(value),
            None => {
                let message = format!("{} has no `{key}`", self.title);
                self.missing.push((key, message.clone()));
                self.refuse(message, format!("add it, for example `{key} = {example}`"))
            }
        }
    }

    /// Reads an optional key. `None` is an error, `Some(None)` means absent.
    pub(super) fn optional<T>(
        &mut self,
        key: &'static str,
        read: impl FnOnce(Value<'a>) -> Option<T>,
    ) -> Option<Option<T>> {
        match self.get(key) {
            Some(value) => read(value).map(Some),
            None => Some(None),
        }
    }

    /// Reads a key that has a default.
    pub(super) fn or<T>(
        &mut self,
        key: &'static str,
        default: T,
        read: impl FnOnce(Value<'a>) -> Option<T>,
    ) -> Option<T> {
        self.get(key).map_or(Some(default), read)
    }

    /// Refuses every key that was not asked for. A misspelt key is reported as one error and not as two, even where the key that
    /// was meant is required.
    pub(super) fn finish(self) {
        for (span, value) in self.sorted_entries() {
            if !self.known.contains(&value.name) {
                let meant = meant(value.name, &self.known);
                if let Some((_, message)) = self.missing.iter().find(|(key, _)| Some(*key) == meant) {
                    self.context.retract(&self.span, message);
                }
                self.context.error_with(&span, || {
                    let message = format!("unknown key `{}` in {}", value.name, self.title);
                    (message, suggestion(value.name, &self.known))
                });
            }
        }
    }
}
