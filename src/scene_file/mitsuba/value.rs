//! Objects with their parameters, in the form that plugins use.

use super::error::{Fault, Place, fail};
use super::report::{Subject, label_of, name_of};
use super::spectrum::Spectrum;
use super::text::shown;
use crate::scene_file::diagnostic::nearest;
use glam::{DAffine3, DVec3};
use std::cell::Cell;
use std::rc::Rc;

/// The value of a parameter.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    Text(String),
    /// A point or a vector.
    Vector(DVec3),
    Transform(DAffine3),
    Spectrum(Spectrum),
    Object(Rc<Object>),
    /// The id of an object.
    Reference(String),
}

impl Value {
    fn kind(&self) -> &'static str {
        match self {
            Self::Float(_) => "a <float>",
            Self::Integer(_) => "an <integer>",
            Self::Boolean(_) => "a <boolean>",
            Self::Text(_) => "a <string>",
            Self::Vector(_) => "a <vector> or <point>",
            Self::Transform(_) => "a <transform>",
            Self::Spectrum(_) => "a colour or spectrum",
            Self::Object(_) => "an object",
            Self::Reference(_) => "a <ref>",
        }
    }
}

/// A parameter or a nested part of an object.
#[derive(Debug)]
pub(super) struct Property {
    /// The name in the current convention (`int_ior`); empty for parts without a name.
    pub name: String,
    pub value: Value,
    pub place: Place,
    /// Whether the parameter was asked for.
    used: Cell<bool>,
}

impl Property {
    pub(super) fn new(name: String, value: Value, place: Place) -> Self {
        Self { name, value, place, used: Cell::new(false) }
    }

    pub(super) fn mark(&self) {
        self.used.set(true);
    }

    fn wrong<T>(&self, wanted: &str) -> Result<T, Fault> {
        let message = format!("`{}` is {}, and {wanted} is expected", shown(&self.name), self.value.kind());
        fail(&self.place, message, format!("write for example {}", example(wanted, &self.name)))
    }
}

fn example(wanted: &str, name: &str) -> String {
    let name = shown(name);
    match wanted {
        "a number" => format!("<float name=\"{name}\" value=\"0.5\"/>"),
        "a whole number" => format!("<integer name=\"{name}\" value=\"4\"/>"),
        "true or false" => format!("<boolean name=\"{name}\" value=\"true\"/>"),
        "a text" => format!("<string name=\"{name}\" value=\"...\"/>"),
        "a vector" => format!("<vector name=\"{name}\" x=\"0\" y=\"1\" z=\"0\"/>"),
        "a transform" => format!("<transform name=\"{name}\"> ... </transform>"),
        _ => format!("<rgb name=\"{name}\" value=\"0.5, 0.5, 0.5\"/>"),
    }
}

/// A plugin with its parameters.
#[derive(Debug)]
pub(super) struct Object {
    /// The element, such as `bsdf`.
    pub tag: String,
    /// The type of plugin, such as `diffuse`.
    pub plugin: String,
    pub id: Option<String>,
    pub properties: Vec<Property>,
    pub place: Place,
    /// Whether the file has a version before 2.0.
    pub is_old: bool,
}

impl Subject for Object {
    fn place(&self) -> &Place {
        &self.place
    }

    fn label(&self) -> String {
        label_of(&self.tag, &self.plugin, self.id.as_ref())
    }

    fn name(&self) -> String {
        name_of(&self.plugin, self.id.as_ref(), &self.place)
    }
}

impl Object {
    /// The parameter with this name. The last one wins, because parameters are set in order.
    pub(super) fn get(&self, name: &str) -> Option<&Property> {
        let mut found = None;
        for property in self.properties.iter().filter(|property| property.name == name) {
            property.mark();
            found = Some(property);
        }
        found
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.properties.iter().any(|property| property.name == name)
    }

    pub(super) fn float(&self, name: &str) -> Result<Option<f64>, Fault> {
        let Some(property) = self.get(name) else { return Ok(None) };
        match property.value {
            Value::Float(value) => Ok(Some(value)),
            Value::Integer(value) => Ok(Some(value as f64)),
            Value::Spectrum(Spectrum::Uniform(value)) => Ok(Some(value)),
            _ => property.wrong("a number"),
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
        let place = self.get(name).map_or(&self.place, |property| &property.place);
        let message = format!("`{name}` of {} is {value}", self.label());
        fail(place, message, format!("write a number from {} to {}", range.start(), range.end()))
    }

    pub(super) fn integer(&self, name: &str) -> Result<Option<i64>, Fault> {
        let Some(property) = self.get(name) else { return Ok(None) };
        match property.value {
            Value::Integer(value) => Ok(Some(value)),
            Value::Float(value) if value.fract() == 0.0 && value.abs() < 1e15 => Ok(Some(value as i64)),
            _ => property.wrong("a whole number"),
        }
    }

    pub(super) fn boolean(&self, name: &str, usual: bool) -> Result<bool, Fault> {
        let Some(property) = self.get(name) else { return Ok(usual) };
        match property.value {
            Value::Boolean(value) => Ok(value),
            _ => property.wrong("true or false"),
        }
    }

    pub(super) fn text(&self, name: &str) -> Result<Option<&str>, Fault> {
        let Some(property) = self.get(name) else { return Ok(None) };
        match &property.value {
            Value::Text(value) => Ok(Some(value)),
            _ => property.wrong("a text"),
        }
    }

    pub(super) fn vector(&self, name: &str) -> Result<Option<DVec3>, Fault> {
        let Some(property) = self.get(name) else { return Ok(None) };
        match property.value {
            Value::Vector(value) => Ok(Some(value)),
            _ => property.wrong("a vector"),
        }
    }

    pub(super) fn transform(&self, name: &str) -> Result<DAffine3, Fault> {
        let Some(property) = self.get(name) else { return Ok(DAffine3::IDENTITY) };
        match property.value {
            Value::Transform(value) => Ok(value),
            _ => property.wrong("a transform"),
        }
    }

    /// The parameters that were not asked for, each once; marks them as asked for.
    pub(super) fn unread(&self) -> Vec<&Property> {
        let mut unread: Vec<&Property> = Vec::new();
        for property in self.properties.iter().filter(|property| !property.used.get()) {
            property.mark();
            if unread.iter().all(|known| known.name != property.name) || property.name.is_empty() {
                unread.push(property);
            }
        }
        unread
    }

    /// Refuses a parameter whose name is close to one of the `known` names: it is a misspelling.
    pub(super) fn refuse_misspelt(&self, property: &Property, known: &[&str]) -> Result<(), Fault> {
        let candidates = known.iter().copied().filter(|name| !self.has(name));
        match nearest(&property.name, candidates) {
            Some(meant) if property.name.len() > 2 => {
                let message = format!("{} has no parameter `{}`", self.label(), shown(&property.name));
                fail(&property.place, message, format!("did you mean `{meant}`?"))
            }
            _ => Ok(()),
        }
    }
}
