//! Messages about content that is imported differently from the file's meaning. Each message occurs once, with the number of
//! similar objects.

use super::error::Place;
use super::text::shown;
use crate::scene_file::description::SceneWarning;
use std::collections::HashMap;
use std::rc::Rc;

/// An object of a file that messages are about.
pub(crate) trait Subject {
    /// Where it is.
    fn place(&self) -> &Place;
    /// What it is, in messages.
    fn label(&self) -> String;
    /// Base of the names of shapes and materials.
    fn name(&self) -> String;
}

/// The label of an object: its element or directive, its type, and its id.
pub(crate) fn label_of(what: &str, kind: &str, id: Option<&String>) -> String {
    match id {
        Some(id) => format!("{what} `{}` (`{}`)", shown(kind), shown(id)),
        None => format!("{what} `{}`", shown(kind)),
    }
}

/// The name of an object: its id, or its type and its line.
pub(crate) fn name_of(kind: &str, id: Option<&String>, place: &Place) -> String {
    match id {
        Some(id) => shown(id),
        None => format!("{} in line {}", shown(kind), place.location.line),
    }
}

impl<T: Subject> Subject for Rc<T> {
    fn place(&self) -> &Place {
        (**self).place()
    }

    fn label(&self) -> String {
        (**self).label()
    }

    fn name(&self) -> String {
        (**self).name()
    }
}

/// Severity of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    /// The picture is close to the meaning of the file.
    Approximated,
    /// Something is missing from the picture.
    LeftOut,
}

#[derive(Debug)]
struct Entry {
    kind: Kind,
    place: Place,
    message: String,
    more: u64,
}

/// Messages in order of occurrence.
#[derive(Debug, Default)]
pub(crate) struct Report {
    entries: Vec<Entry>,
    known: HashMap<(Kind, String), usize>,
}

impl Report {
    fn add(&mut self, kind: Kind, place: &Place, label: Option<&str>, what: String) {
        let key = (kind, what.clone());
        if let Some(&known) = self.known.get(&key) {
            self.entries[known].more += 1;
            return;
        }
        self.known.insert(key, self.entries.len());
        let message = label.map_or_else(|| what.clone(), |label| format!("{label}: {what}"));
        self.entries.push(Entry { kind, place: place.clone(), message, more: 0 });
    }

    /// Reports that a property of an object is approximated.
    pub(crate) fn note(&mut self, object: &dyn Subject, what: impl Into<String>) {
        self.add(Kind::Approximated, object.place(), Some(&object.label()), what.into());
    }

    /// Reports that a property of an object is missing from the picture.
    pub(crate) fn warn(&mut self, object: &dyn Subject, what: impl Into<String>) {
        self.add(Kind::LeftOut, object.place(), Some(&object.label()), what.into());
    }

    /// Reports that the parameters `found` of an object have no effect here.
    pub(crate) fn ignored(&mut self, object: &dyn Subject, found: &[&str], why: &str) {
        let names: Vec<String> = found.iter().map(|name| format!("`{name}`")).collect();
        if !names.is_empty() {
            let verb = if names.len() == 1 { "has" } else { "have" };
            self.note(object, format!("{} {verb} no effect: {why}", names.join(", ")));
        }
    }

    /// Reports an approximation at a place of the file.
    pub(crate) fn note_at(&mut self, place: &Place, what: impl Into<String>) {
        self.add(Kind::Approximated, place, None, what.into());
    }

    /// Reports that something at a place of the file is missing from the picture.
    pub(crate) fn warn_at(&mut self, place: &Place, what: impl Into<String>) {
        self.add(Kind::LeftOut, place, None, what.into());
    }

    /// The warnings, then the notes.
    pub(crate) fn told(self) -> (Vec<SceneWarning>, Vec<SceneWarning>) {
        let (mut warnings, mut notes) = (Vec::new(), Vec::new());
        for Entry { kind, place, message, more } in self.entries {
            let message = match more {
                0 => message,
                1 => format!("{message} (and one more object)"),
                more => format!("{message} (and {more} more objects)"),
            };
            let told = SceneWarning { location: place.location, message };
            match kind {
                Kind::Approximated => notes.push(told),
                Kind::LeftOut => warnings.push(told),
            }
        }
        (warnings, notes)
    }
}
