//! Messages about content that is imported differently from the file's meaning. Each message occurs once, with the number of
//! similar objects.

use super::value::Object;
use super::xml::Place;
use crate::scene_file::description::SceneWarning;
use std::collections::HashMap;

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
pub(super) struct Report {
    entries: Vec<Entry>,
    known: HashMap<(Kind, String), usize>,
}

impl Report {
    fn add(&mut self, kind: Kind, place: &Place, label: &str, what: String) {
        let key = (kind, what.clone());
        if let Some(&known) = self.known.get(&key) {
            self.entries[known].more += 1;
            return;
        }
        self.known.insert(key, self.entries.len());
        self.entries.push(Entry { kind, place: place.clone(), message: format!("{label}: {what}"), more: 0 });
    }

    /// Reports that a property of an object is approximated.
    pub(super) fn note(&mut self, object: &Object, what: impl Into<String>) {
        self.add(Kind::Approximated, &object.place, &object.label(), what.into());
    }

    /// Reports that a property of an object is missing from the picture.
    pub(super) fn warn(&mut self, object: &Object, what: impl Into<String>) {
        self.add(Kind::LeftOut, &object.place, &object.label(), what.into());
    }

    /// The warnings, then the notes.
    pub(super) fn told(self) -> (Vec<SceneWarning>, Vec<SceneWarning>) {
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
