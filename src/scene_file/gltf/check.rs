//! Checks of the JSON against the schemas of glTF 2.0 and of the extensions that are read: types, ranges, and indices. They run
//! before the document is given to the crate `gltf`. The verdicts are those of the Khronos validator. What the validator calls an
//! error is refused here, unless the meaning is plain; then there is a warning (`docs/gltf.md`).

use super::error::{Failure, fail};
use super::schema::{Beyond, Kind, ROOT, Range, Shape};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Most names that one warning lists.
const LISTED: usize = 8;

/// Warnings about the JSON. Of each kind the first message is kept and the others are counted.
#[derive(Debug, Default)]
pub(super) struct Report {
    warnings: BTreeMap<String, (String, u64)>,
    /// Names of the extensions that occur in any object.
    pub extensions: BTreeSet<String>,
    /// Keys that neither glTF nor an extension defines at their place.
    unknown: BTreeSet<String>,
    /// Empty lists and objects, which glTF forbids.
    empty: u64,
}

impl Report {
    /// Adds a warning; `kind` groups warnings that are counted together.
    pub(super) fn warn(&mut self, kind: &str, message: impl FnOnce() -> String) {
        match self.warnings.get_mut(kind) {
            Some((_, count)) => *count += 1,
            None => drop(self.warnings.insert(kind.to_owned(), (message(), 1))),
        }
    }

    /// All warnings as sentences.
    pub(super) fn into_warnings(self) -> Vec<String> {
        let mut warnings: Vec<String> = self
            .warnings
            .into_values()
            .map(|(message, count)| match count {
                1 => message,
                _ => format!("{message} (and {} more of this kind)", count - 1),
            })
            .collect();
        if self.empty > 0 {
            warnings
                .push(format!("{} empty lists or objects, which glTF forbids, count as absent", self.empty));
        }
        if !self.unknown.is_empty() {
            let listed: Vec<_> = self.unknown.iter().take(LISTED).map(|name| super::shown(name)).collect();
            let more = if self.unknown.len() > LISTED { " and others" } else { "" };
            warnings.push(format!(
                "properties that glTF does not have were ignored: {}{more}",
                listed.join(", ")
            ));
        }
        warnings
    }
}

/// A step on the path from the root to a value.
#[derive(Clone, Copy)]
enum Step {
    Key(&'static str),
    Index(usize),
}

/// The path from the root to a value.
#[derive(Default)]
struct Place(Vec<Step>);

impl Place {
    /// The path as messages write it: `nodes[3].scale`.
    fn text(&self) -> String {
        let mut text = String::new();
        for step in &self.0 {
            match step {
                Step::Key(key) if text.is_empty() => text.push_str(key),
                Step::Key(key) => text.extend([".", key]),
                Step::Index(index) => text.push_str(&format!("[{index}]")),
            }
        }
        text
    }

    /// The path without indices, which groups similar places.
    fn kind(&self) -> String {
        let keys = self.0.iter().filter_map(|step| match step {
            Step::Key(key) => Some(*key),
            Step::Index(_) => None,
        });
        keys.collect::<Vec<_>>().join(".")
    }
}

/// Result of the check of a value.
enum Verdict {
    Stays,
    /// The value is removed, as if it were absent.
    Goes,
}

/// Checks the document, and repairs values whose meaning is plain.
pub(super) fn check(value: &mut Value, report: &mut Report) -> Result<(), Failure> {
    let lengths = lengths(value);
    let Value::Object(root) = value else {
        return fail("the JSON", "not an object; the file is no glTF, or is damaged: write it again");
    };
    Checker { lengths, place: Place::default(), report }.object(root, &ROOT).map(drop)
}

/// Lengths of the lists that indices refer to, by the names in [`Kind::Index`].
fn lengths(value: &Value) -> BTreeMap<&'static str, u64> {
    let length = |pointer: &str| value.pointer(pointer).and_then(Value::as_array).map_or(0, Vec::len) as u64;
    let lists = [
        "accessors",
        "buffers",
        "bufferViews",
        "cameras",
        "images",
        "materials",
        "meshes",
        "nodes",
        "samplers",
        "scenes",
        "skins",
        "textures",
    ];
    let mut lengths: BTreeMap<_, _> = lists.map(|list| (list, length(&format!("/{list}")))).into();
    lengths.insert("lights", length("/extensions/KHR_lights_punctual/lights"));
    lengths.insert("variants", length("/extensions/KHR_materials_variants/variants"));
    lengths
}

struct Checker<'a> {
    lengths: BTreeMap<&'static str, u64>,
    place: Place,
    report: &'a mut Report,
}

impl Checker<'_> {
    fn refuse<T>(&self, what: impl std::fmt::Display) -> Result<T, Failure> {
        fail(self.place.text(), format!("{what}; the file is damaged, write it again"))
    }

    fn wrong_type<T>(&self, value: &Value, wanted: &str) -> Result<T, Failure> {
        let text = super::shown(&value.to_string().chars().take(200).collect::<String>());
        self.refuse(format!("{text} is not {wanted}"))
    }

    fn warn(&mut self, what: impl FnOnce() -> String) {
        let (kind, place) = (self.place.kind(), self.place.text());
        self.report.warn(&kind, || format!("{place} {}", what()));
    }

    fn object(&mut self, object: &mut Map<String, Value>, shape: &'static Shape) -> Result<Verdict, Failure> {
        let mut gone = Vec::new();
        let mut required = 0;
        for (key, value) in object.iter_mut() {
            let Some(rule) = shape.rules.iter().find(|rule| rule.key == key) else {
                match key.as_str() {
                    "extensions" => self.extensions(value, shape)?,
                    "extras" => {}
                    "name" if value.is_string() => {}
                    "name" => {
                        self.place.0.push(Step::Key("name"));
                        return self.wrong_type(value, "a text");
                    }
                    _ => {
                        self.report.unknown.insert(key.clone());
                    }
                }
                continue;
            };
            self.place.0.push(Step::Key(rule.key));
            required += usize::from(rule.required);
            if let Verdict::Goes = self.value(value, &rule.kind)? {
                if rule.required {
                    return self.refuse("empty, and glTF requires it");
                }
                gone.push(key.clone());
            }
            self.place.0.pop();
        }
        if required < shape.rules.iter().filter(|rule| rule.required).count() {
            let missing = shape.rules.iter().find(|rule| rule.required && !object.contains_key(rule.key));
            self.place.0.extend(missing.map(|rule| Step::Key(rule.key)));
            return self.refuse("missing, and glTF requires it");
        }
        for key in gone {
            object.remove(&key);
        }
        // `extras` may hold any value of any type.
        object.remove("extras");
        Ok(Verdict::Stays)
    }

    fn extensions(&mut self, value: &mut Value, shape: &'static Shape) -> Result<(), Failure> {
        self.place.0.push(Step::Key("extensions"));
        let Value::Object(extensions) = value else { return self.wrong_type(value, "an object") };
        for (name, extension) in extensions.iter_mut() {
            if !self.report.extensions.contains(name) {
                self.report.extensions.insert(name.clone());
            }
            let known = shape.extensions.iter().find(|(known, _)| known == name);
            if let Some((name, shape)) = known {
                self.place.0.push(Step::Key(name));
                match extension {
                    Value::Object(object) => self.object(object, shape)?,
                    other => return self.wrong_type(other, "an object"),
                };
                self.place.0.pop();
            }
        }
        self.place.0.pop();
        Ok(())
    }

    fn value(&mut self, value: &mut Value, kind: &'static Kind) -> Result<Verdict, Failure> {
        match kind {
            Kind::Any => {}
            Kind::Flag if !value.is_boolean() => return self.wrong_type(value, "true or false"),
            Kind::Text if !value.is_string() => return self.wrong_type(value, "a text"),
            Kind::Flag | Kind::Text => {}
            Kind::Whole { least, most, step } => match value.as_u64() {
                Some(whole) if whole < *least || whole > *most => {
                    return self.refuse(format!("{whole} is out of range: {least} to {most}"));
                }
                Some(whole) if whole % step != 0 => {
                    return self.refuse(format!("{whole} is no multiple of {step}"));
                }
                Some(_) => {}
                None => return self.wrong_type(value, "a whole number from 0 up"),
            },
            Kind::Index(list) => self.index(value, list)?,
            Kind::Number(range) => self.number(value, range)?,
            Kind::Numbers { count, range } => {
                let Value::Array(items) = value else { return self.wrong_type(value, "a list of numbers") };
                if items.is_empty() && count.is_none() {
                    return Ok(self.unless_empty(true));
                }
                if count.is_some_and(|count| items.len() != count) {
                    let wanted = count.unwrap_or(1);
                    return self.refuse(format!("{} numbers, where {wanted} belong", items.len()));
                }
                for (i, item) in items.iter_mut().enumerate() {
                    self.place.0.push(Step::Index(i));
                    self.number(item, range)?;
                    self.place.0.pop();
                }
            }
            Kind::Choice(choices, beyond) => {
                let Some(text) = value.as_str() else { return self.wrong_type(value, "a text") };
                if !choices.contains(&text) {
                    let what = format!("`{}` is none of {}", super::shown(text), choices.join(", "));
                    return self.beyond(*beyond, what);
                }
            }
            Kind::Code(codes, beyond) => {
                let Some(code) = value.as_u64() else {
                    return self.wrong_type(value, "a whole number from 0 up");
                };
                if !codes.contains(&code) {
                    let codes: Vec<_> = codes.iter().map(u64::to_string).collect();
                    return self.beyond(*beyond, format!("{code} is none of {}", codes.join(", ")));
                }
            }
            Kind::Object(shape) => match value {
                Value::Object(object) => return self.object(object, shape),
                other => return self.wrong_type(other, "an object"),
            },
            Kind::Objects(shape) => {
                let Value::Array(items) = value else { return self.wrong_type(value, "a list") };
                for (i, item) in items.iter_mut().enumerate() {
                    self.place.0.push(Step::Index(i));
                    match item {
                        Value::Object(object) => self.object(object, shape)?,
                        other => return self.wrong_type(other, "an object"),
                    };
                    self.place.0.pop();
                }
                return Ok(self.unless_empty(items.is_empty()));
            }
            Kind::Indices(list) => return self.indices(value, list),
            Kind::Attributes => {
                let Value::Object(attributes) = value else { return self.wrong_type(value, "an object") };
                for (name, accessor) in attributes.iter() {
                    // Attribute names are free, so the path has no step for them.
                    let count = self.length("accessors");
                    if accessor.as_u64().is_none_or(|index| index >= count) {
                        let name = super::shown(name);
                        return self.refuse(format!("{name} is accessor {accessor}, and there are {count}"));
                    }
                }
            }
            Kind::Targets => {
                let Value::Array(items) = value else { return self.wrong_type(value, "a list") };
                for (i, item) in items.iter_mut().enumerate() {
                    self.place.0.push(Step::Index(i));
                    self.value(item, &Kind::Attributes)?;
                    self.place.0.pop();
                }
                return Ok(self.unless_empty(items.is_empty()));
            }
            Kind::Names => {
                let Value::Array(items) = value else { return self.wrong_type(value, "a list of texts") };
                if let Some(other) = items.iter().find(|item| !item.is_string()) {
                    return self.wrong_type(other, "a text");
                }
                return Ok(self.unless_empty(items.is_empty()));
            }
        }
        Ok(Verdict::Stays)
    }

    fn unless_empty(&mut self, is_empty: bool) -> Verdict {
        self.report.empty += u64::from(is_empty);
        if is_empty { Verdict::Goes } else { Verdict::Stays }
    }

    fn length(&self, list: &str) -> u64 {
        self.lengths.get(list).copied().unwrap_or(0)
    }

    fn index(&self, value: &Value, list: &str) -> Result<(), Failure> {
        match (value.as_u64(), self.length(list)) {
            (Some(index), count) if index >= count => {
                self.refuse(format!("index {index} into {list}, and there are {count}"))
            }
            (Some(_), _) => Ok(()),
            (None, _) => self.wrong_type(value, "an index, a whole number from 0 up"),
        }
    }

    fn indices(&mut self, value: &mut Value, list: &str) -> Result<Verdict, Failure> {
        let Value::Array(items) = value else { return self.wrong_type(value, "a list of indices") };
        let mut seen = BTreeSet::new();
        let mut twice = None;
        for (i, item) in items.iter().enumerate() {
            self.place.0.push(Step::Index(i));
            self.index(item, list)?;
            self.place.0.pop();
            if !seen.insert(item.as_u64()) && twice.is_none() {
                twice = item.as_u64();
            }
        }
        if let Some(twice) = twice {
            self.warn(|| format!("names {twice} more than once; it counts once"));
            let mut seen = BTreeSet::new();
            items.retain(|item| seen.insert(item.as_u64()));
        }
        Ok(self.unless_empty(items.is_empty()))
    }

    fn number(&mut self, value: &mut Value, range: &'static Range) -> Result<(), Failure> {
        let Some(number) = value.as_f64() else { return self.wrong_type(value, "a number") };
        if !(number as f32).is_finite() {
            return self.refuse(format!("{number:e} is too large a number"));
        }
        let is_below = number < range.least || number == range.least && range.is_open;
        if range.also == Some(number) || !is_below && number <= range.most {
            return Ok(());
        }
        let (beyond, end) = if is_below { (range.below, range.least) } else { (range.above, range.most) };
        let wanted = match (range.is_open, range.most.is_finite()) {
            (true, false) => format!("above {}", range.least),
            (true, true) => format!("above {} and at most {}", range.least, range.most),
            (false, false) => format!("at least {}", range.least),
            (false, true) => format!("from {} to {}", range.least, range.most),
        };
        let or = range.also.map_or(String::new(), |also| format!(" or {also}"));
        match beyond {
            Beyond::Refuse => self.refuse(format!("{number} is out of range: it must be {wanted}{or}")),
            Beyond::Cut => {
                self.warn(|| format!("is {number}, and must be {wanted}; it counts as {end}"));
                *value = Value::from(end);
                Ok(())
            }
            Beyond::Keep | Beyond::Drop => {
                self.warn(|| format!("is {number}, and must be {wanted}; it is used as it is"));
                Ok(())
            }
        }
    }

    /// The verdict on a value that is none of the allowed choices.
    fn beyond(&mut self, beyond: Beyond, what: String) -> Result<Verdict, Failure> {
        match beyond {
            Beyond::Refuse => self.refuse(what),
            Beyond::Keep => {
                self.warn(|| what);
                Ok(Verdict::Stays)
            }
            Beyond::Cut | Beyond::Drop => {
                self.warn(|| format!("{what}; the default is used"));
                Ok(Verdict::Goes)
            }
        }
    }
}
