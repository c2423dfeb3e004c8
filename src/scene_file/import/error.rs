//! Places in the files of a scene, and errors before the source line is added to them.

use crate::scene_file::description::Location;
use crate::scene_file::diagnostic::{Diagnostic, SceneFileError, SourceText};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// A place in a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Place {
    /// Number of the file in [`Sources`].
    pub file: usize,
    /// Byte range in the file.
    pub span: Range<usize>,
    /// The place in lines and columns.
    pub location: Location,
}

/// One problem: the place, what is wrong, and what to do.
#[derive(Debug)]
pub(crate) struct Problem {
    pub place: Place,
    pub message: String,
    pub remedy: String,
}

/// A boxed problem, so that results stay small.
pub(crate) type Fault = Box<Problem>;

/// Fails with a problem at a place.
pub(crate) fn fail<T>(
    place: &Place,
    message: impl Into<String>,
    remedy: impl Into<String>,
) -> Result<T, Fault> {
    Err(fault(place, message, remedy))
}

pub(crate) fn fault(place: &Place, message: impl Into<String>, remedy: impl Into<String>) -> Fault {
    Box::new(Problem { place: place.clone(), message: message.into(), remedy: remedy.into() })
}

/// The texts of all files that were read, for messages that quote a line.
#[derive(Debug, Default)]
pub(crate) struct Sources {
    files: Vec<(PathBuf, Arc<String>)>,
}

impl Sources {
    /// Stores a text and yields its number.
    pub(crate) fn add(&mut self, path: PathBuf, text: impl Into<Arc<String>>) -> usize {
        self.files.push((path, text.into()));
        self.files.len() - 1
    }

    /// The files, in the order in which they were read.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter().map(|(path, _)| path)
    }

    /// The path and the text of a file.
    pub(crate) fn get(&self, number: usize) -> Option<(&PathBuf, &str)> {
        self.files.get(number).map(|(path, text)| (path, text.as_str()))
    }

    /// The error in the form that the user sees.
    pub(crate) fn told(&self, problem: Problem) -> SceneFileError {
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
