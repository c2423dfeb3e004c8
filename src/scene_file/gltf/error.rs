//! Errors of the glTF reader.

use crate::image_io::ImageError;
use crate::memory::MemoryError;
use std::path::PathBuf;

/// Why a glTF file was refused: the file, the object in it, what is wrong, and what to do.
#[derive(Debug, thiserror::Error)]
#[error("{}: {object}{}{problem}", file.display(), if object.is_empty() { "" } else { ": " })]
pub struct GltfError {
    /// The file.
    pub file: PathBuf,
    /// The object in the file, by its path in the JSON and its name; empty for the file as a whole.
    pub object: String,
    /// What is wrong, and what to do about it.
    pub problem: GltfProblem,
}

/// A problem of a glTF file.
#[derive(Debug, thiserror::Error)]
pub enum GltfProblem {
    /// The system refused to read.
    #[error("cannot be read: {0}; check its name and permissions")]
    Io(#[from] std::io::Error),
    /// A picture of it.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// It would take more memory than is allowed.
    #[error("{0}")]
    Memory(Box<MemoryError>),
    /// Anything else.
    #[error("{0}")]
    Other(String),
}

impl From<MemoryError> for GltfProblem {
    fn from(error: MemoryError) -> Self {
        Self::Memory(Box::new(error))
    }
}

impl From<String> for GltfProblem {
    fn from(problem: String) -> Self {
        Self::Other(problem)
    }
}

impl From<&str> for GltfProblem {
    fn from(problem: &str) -> Self {
        Self::Other(problem.to_owned())
    }
}

/// An error before the name of the file is added: the object and the problem.
pub(super) type Failure = (String, GltfProblem);

/// The failure of an object.
pub(super) fn fail<T>(object: impl Into<String>, problem: impl Into<GltfProblem>) -> Result<T, Failure> {
    Err((object.into(), problem.into()))
}
