//! Directives with their parameters.

use super::error::{Fault, Place, fail};
use super::report::{Subject, label_of, name_of};
use super::text::shown;
use crate::scene_file::diagnostic::nearest;
use glam::{DMat3, DVec3};
use std::cell::Cell;
use std::rc::Rc;

/// Types of parameters, with the numbers that make one value; 0 for other values.
pub(super) const KINDS: [(&str, usize); 18] = [
    ("integer", 1),
    ("float", 1),
    ("point2", 2),
    ("vector2", 2),
    ("point3", 3),
    ("vector3", 3),
    ("point", 3),
    ("vector", 3),
    ("normal", 3),
    ("normal3", 3),
    ("rgb", 3),
    ("color", 3),
    ("xyz", 3),
    ("blackbody", 1),
    ("spectrum", 1),
    ("bool", 0),
    ("string", 0),
    ("texture", 0),
];

/// The values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Booleans(Vec<bool>),
}

/// A parameter.
#[derive(Debug)]
pub(super) struct Parameter {
    /// One of [`KINDS`].
    pub kind: &'static str,
    pub name: String,
    pub values: Values,
    pub place: Place,
    /// From the colour space of its colours to linear Rec. 709; `None` where it is that.
    pub space: Option<DMat3>,
    /// Whether it was given by `Attribute` and need not be used.
    pub is_default: bool,
    used: Cell<bool>,
}

impl Parameter {
    pub(super) fn new(kind: &'static str, name: String, values: Values, place: Place) -> Self {
        Self { kind, name, values, place, space: None, is_default: false, used: Cell::new(false) }
    }

    pub(super) fn numbers(&self) -> &[f64] {
        match &self.values {
            Values::Numbers(numbers) => numbers,
            Values::Texts(_) | Values::Booleans(_) => &[],
        }
    }

    pub(super) fn mark(&self) {
        self.used.set(true);
    }

    /// The only text of a parameter.
    pub(super) fn text(&self) -> Option<&str> {
        match &self.values {
            Values::Texts(texts) if texts.len() == 1 => texts.first().map(String::as_str),
            _ => None,
        }
    }

    pub(super) fn wrong<T>(&self, wanted: &str, example: &str) -> Result<T, Fault> {
        let count = match &self.values {
            Values::Numbers(values) => values.len(),
            Values::Texts(values) => values.len(),
            Values::Booleans(values) => values.len(),
        };
        let message = format!(
            "`{}` is of type `{}` with {count} values, and {wanted} is expected",
            shown(&self.name),
            self.kind
        );
        fail(
            &self.place,
            message,
            format!("write for example {}", example.replace("NAME", &shown(&self.name))),
        )
    }
}

/// A directive with its type and its parameters.
#[derive(Debug)]
pub(super) struct Object {
    /// Tells objects apart.
    pub serial: usize,
    /// The directive, such as `Shape`.
    pub directive: &'static str,
    /// The type, such as `sphere`.
    pub kind: String,
    /// The name by which other directives refer to it.
    pub id: Option<String>,
    /// In order, those of `Attribute` first.
    pub parameters: Vec<Rc<Parameter>>,
    pub place: Place,
}

impl Subject for Object {
    fn place(&self) -> &Place {
        &self.place
    }

    fn label(&self) -> String {
        label_of(self.directive, &self.kind, self.id.as_ref())
    }

    fn name(&self) -> String {
        name_of(&self.kind, self.id.as_ref(), &self.place)
    }
}

impl Object {
    /// The parameter with this name. The last one wins.
    pub(super) fn get(&self, name: &str) -> Option<&Rc<Parameter>> {
        let mut found = None;
        for parameter in self.parameters.iter().filter(|parameter| parameter.name == name) {
            parameter.mark();
            found = Some(parameter);
        }
        found
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.parameters.iter().any(|parameter| parameter.name == name)
    }

    /// Where a parameter is, or else the object.
    pub(super) fn place_of(&self, name: &str) -> &Place {
        self.get(name).map_or(&self.place, |parameter| &parameter.place)
    }

    pub(super) fn float(&self, name: &str) -> Result<Option<f64>, Fault> {
        let Some(parameter) = self.get(name) else { return Ok(None) };
        match (parameter.kind, parameter.numbers()) {
            ("float" | "integer", [value]) => Ok(Some(*value)),
            _ => parameter.wrong("a number", "\"float NAME\" 0.5"),
        }
    }

    pub(super) fn float_or(&self, name: &str, usual: f64) -> Result<f64, Fault> {
        Ok(self.float(name)?.unwrap_or(usual))
    }

    /// Reads a number in a range.
    pub(super) fn within(
        &self,
        name: &str,
        usual: f64,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<f64, Fault> {
        let value = self.float_or(name, usual)?;
        if range.contains(&value) {
            return Ok(value);
        }
        let message = format!("`{name}` of {} is {value}", self.label());
        fail(
            self.place_of(name),
            message,
            format!("write a number from {} to {}", range.start(), range.end()),
        )
    }

    pub(super) fn integer(&self, name: &str) -> Result<Option<i64>, Fault> {
        let Some(parameter) = self.get(name) else { return Ok(None) };
        match (parameter.kind, parameter.numbers()) {
            ("float" | "integer", [value]) if value.fract() == 0.0 && value.abs() < 1e15 => {
                Ok(Some(*value as i64))
            }
            _ => parameter.wrong("a whole number", "\"integer NAME\" 4"),
        }
    }

    pub(super) fn boolean(&self, name: &str, usual: bool) -> Result<bool, Fault> {
        let Some(parameter) = self.get(name) else { return Ok(usual) };
        match &parameter.values {
            Values::Booleans(values) if values.len() == 1 => Ok(values[0]),
            _ => parameter.wrong("true or false", "\"bool NAME\" true"),
        }
    }

    pub(super) fn text(&self, name: &str) -> Result<Option<&str>, Fault> {
        let Some(parameter) = self.get(name) else { return Ok(None) };
        match parameter.text() {
            Some(text) if parameter.kind == "string" => Ok(Some(text)),
            _ => parameter.wrong("a text", "\"string NAME\" \"...\""),
        }
    }

    pub(super) fn point(&self, name: &str) -> Result<Option<DVec3>, Fault> {
        let Some(parameter) = self.get(name) else { return Ok(None) };
        match (parameter.kind, parameter.numbers()) {
            ("point3" | "point" | "vector3" | "vector", &[x, y, z]) => Ok(Some(DVec3::new(x, y, z))),
            _ => parameter.wrong("a point", "\"point3 NAME\" [ 0 1 0 ]"),
        }
    }

    /// Numbers in groups of `each`; empty where there are none. `kinds` are the types that they may have.
    pub(super) fn list(&self, name: &str, kinds: &[&str], each: usize) -> Result<&[f64], Fault> {
        let Some(parameter) = self.get(name) else { return Ok(&[]) };
        let numbers = parameter.numbers();
        if kinds.contains(&parameter.kind) && numbers.len() % each == 0 {
            return Ok(numbers);
        }
        let wanted = format!("a list of `{}` of {each} numbers each", kinds[0]);
        parameter.wrong(&wanted, &format!("\"{} NAME\" [ ... ]", kinds[0]))
    }

    /// The parameters that were not asked for, each once; marks them as asked for.
    pub(super) fn unread(&self) -> Vec<&Parameter> {
        let mut unread: Vec<&Parameter> = Vec::new();
        for parameter in self.parameters.iter().filter(|parameter| !parameter.used.get()) {
            parameter.mark();
            if !parameter.is_default && unread.iter().all(|known| known.name != parameter.name) {
                unread.push(parameter);
            }
        }
        unread
    }

    /// Refuses a parameter whose name is close to one of the `known` names: it is a misspelling.
    pub(super) fn refuse_misspelt(&self, parameter: &Parameter, known: &[&str]) -> Result<(), Fault> {
        let candidates = known.iter().copied().filter(|name| !self.has(name));
        match nearest(&parameter.name, candidates) {
            Some(meant) if parameter.name.len() > 2 => {
                let message = format!("{} has no parameter `{}`", self.label(), shown(&parameter.name));
                fail(&parameter.place, message, format!("did you mean `{meant}`?"))
            }
            _ => Ok(()),
        }
    }
}
