//! Errors of the Mitsuba importer, before the source line is added to them.

use super::xml::Place;
use crate::scene_file::diagnostic::{Diagnostic, SceneFileError, SourceText};
use std::path::PathBuf;

/// One problem: the place, what is wrong, and what to do.
#[derive(Debug)]
pub(super) struct Problem {
    pub place: Place,
    pub message: String,
    pub remedy: String,
}

/// A boxed problem, so that results stay small.
pub(super) type Fault = Box<Problem>;

/// Fails with a problem at a place.
pub(super) fn fail<T>(
    place: &Place,
    message: impl Into<String>,
    remedy: impl Into<String>,
) -> Result<T, Fault> {
    Err(fault(place, message, remedy))
}

pub(super) fn fault(place: &Place, message: impl Into<String>, remedy: impl Into<String>) -> Fault {
    Box::new(Problem { place: place.clone(), message: message.into(), remedy: remedy.into() })
}

/// The texts of all files that were read, for messages that quote a line.
#[derive(Debug, Default)]
pub(super) struct Sources {
    files: Vec<(PathBuf, String)>,
}

impl Sources {
    /// Stores a text and yields its number.
    pub(super) fn add(&mut self, path: PathBuf, text: String) -> usize {
        self.files.push((path, text));
        self.files.len() - 1
    }

    /// The files, in the order in which they were read.
    pub(super) fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter().map(|(path, _)| path)
    }

    /// The path and the text of a file.
    pub(super) fn get(&self, number: usize) -> Option<(&PathBuf, &str)> {
        self.files.get(number).map(|(path, text)| (path, text.as_str()))
    }

    /// The error in the form that the user sees.
    pub(super) fn told(&self, problem: Problem) -> SceneFileError {
        let Problem { place, message, remedy } = problem;
        let diagnostic: Diagnostic = match self.get(place.file) {
            Some((path, text)) if place.location.line > 0 => {
                SourceText::new(text, path).diagnostic(&place.span, message, remedy)
            }
            Some((path, text)) => SourceText::new(text, path).diagnostic_of_file(message, remedy),
            None => SourceText::new("", &place.location.file).diagnostic_of_file(message, remedy),
        };
        SceneFileError::Invalid { diagnostics: vec![diagnostic], more: 0 }
    }
}
