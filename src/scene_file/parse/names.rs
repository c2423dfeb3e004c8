//! Tables of names that one part of a file defines and others use.

use crate::scene_file::diagnostic::suggestion;
use crate::scene_file::reader::{Context, Value};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;

/// Names of one kind of object, numbered in the order of their definition.
#[derive(Debug)]
pub(super) struct Names {
    /// The kind of object, for messages: "material".
    kind: &'static str,
    by_name: BTreeMap<String, Entry>,
}

#[derive(Debug)]
struct Entry {
    index: usize,
    span: Range<usize>,
    used: Cell<bool>,
}

impl Names {
    pub(super) fn new(kind: &'static str) -> Self {
        Self { kind, by_name: BTreeMap::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.by_name.len()
    }

    /// Adds a name if it is new, and returns its number.
    pub(super) fn add(&mut self, name: &str, span: Range<usize>) -> usize {
        let index = self.by_name.len();
        self.by_name.entry(name.to_string()).or_insert(Entry { index, span, used: Cell::new(false) }).index
    }

    /// Place of the definition of a name.
    pub(super) fn place_of(&self, name: &str) -> Option<&Range<usize>> {
        self.by_name.get(name).map(|entry| &entry.span)
    }

    /// The number of the object that `value` names; counts as a use of the name.
    pub(super) fn find(&self, value: Value<'_>) -> Option<usize> {
        let name = value.string()?;
        if let Some(entry) = self.by_name.get(name.as_ref()) {
            entry.used.set(true);
            return Some(entry.index);
        }
        value.context().error_with(&value.span(), || {
            let known: Vec<_> = self.by_name.keys().map(String::as_str).collect();
            let message = format!("`{}`: no {} is named `{name}`", value.name(), self.kind);
            (message, suggestion(&name, &known))
        });
        None
    }

    /// Warns about names that are never used.
    pub(super) fn warn_unused(&self, context: &Context<'_>, consequence: &str) {
        for (name, entry) in &self.by_name {
            if !entry.used.get() {
                context.warn(&entry.span, format!("the {} `{name}` {consequence}", self.kind));
            }
        }
    }
}
