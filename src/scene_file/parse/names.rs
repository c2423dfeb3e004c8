//! Tables of names that one part of a file defines and others use.

use crate::scene_file::description::Location;
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
    location: Location,
    used: Cell<bool>,
}

impl Names {
    pub(super) fn new(kind: &'static str) -> Self {
        Self { kind, by_name: BTreeMap::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.by_name.len()
    }

    /// Whether there is this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.by_name.contains_key(name)
    }

    /// Adds a name if it is new, and returns its number.
    pub(super) fn add(&mut self, name: &str, location: Location) -> usize {
        let index = self.by_name.len();
        let entry = Entry { index, location, used: Cell::new(false) };
        self.by_name.entry(name.to_string()).or_insert(entry).index
    }

    /// Adds a name, which must be new.
    pub(super) fn declare(
        &mut self,
        context: &Context<'_>,
        name: &str,
        span: &Range<usize>,
    ) -> Option<usize> {
        if let Some(first) = self.by_name.get(name) {
            let message = format!("the name `{name}` is taken: first at {}", first.location);
            context.error(span, message, "give each its own name");
            return None;
        }
        Some(self.add(name, context.location(span)))
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

    /// Warns about names of the file itself that are never used; libraries have more than a scene needs.
    pub(super) fn warn_unused(&self, context: &Context<'_>, consequence: &str) {
        for (name, entry) in &self.by_name {
            if !entry.used.get() && **entry.location.file == *context.file() {
                context.warn_at(entry.location.clone(), format!("the {} `{name}` {consequence}", self.kind));
            }
        }
    }
}
