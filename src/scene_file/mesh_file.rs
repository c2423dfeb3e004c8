//! Mesh files of any kind, by the ending of their name; and what the readers of OBJ and STL share.

use super::mesh::{MeshReport, TriangleMesh};
use super::obj::read_obj;
use super::ply::{PlyError, read_ply};
use super::stl::read_stl;
use std::fmt;
use std::path::{Path, PathBuf};

/// Longest token that a message repeats, in characters.
const SHOWN: usize = 40;

/// Why a mesh file was refused.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// A PLY file.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// Another: the place, what is wrong, and what to do.
    #[error("{}{place}: {problem}", file.display())]
    Other {
        /// The file.
        file: PathBuf,
        /// Where in it.
        place: MeshPlace,
        /// What is wrong, and what to do about it.
        problem: String,
    },
}

/// A place in a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshPlace {
    /// The file as a whole.
    File,
    /// A line, from 1.
    Line(usize),
}

impl fmt::Display for MeshPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, ":{line}"),
        }
    }
}

/// An error before the file's name is added to it.
pub(super) type Failure = (MeshPlace, String);

pub(super) fn in_file(path: &Path, (place, problem): Failure) -> MeshFileError {
    MeshFileError::Other { file: path.to_path_buf(), place, problem }
}

/// Reads a `.ply`, `.obj` or `.stl` file as one mesh.
///
/// # Errors
/// With the file, the line where there is one, what is wrong and what to do.
pub fn read_mesh_file(path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    let extension = path.extension().unwrap_or_default();
    if extension.eq_ignore_ascii_case("obj") {
        let obj = read_obj(path)?;
        Ok(obj.into_mesh())
    } else if extension.eq_ignore_ascii_case("stl") {
        read_stl(path)
    } else {
        Ok(read_ply(path)?)
    }
}

/// The bytes of a regular file.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshFileError> {
    let fail = |problem| in_file(path, (MeshPlace::File, problem));
    let unreadable = |error| fail(format!("cannot be read: {error}; check its name and permissions"));
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(fail("is not a regular file; name a mesh file".to_owned()));
    }
    std::fs::read(path).map_err(unreadable)
}

/// A token as a message shows it.
pub(super) fn shown(token: &[u8]) -> String {
    let text = String::from_utf8_lossy(&token[..token.len().min(4 * SHOWN)]);
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text.into_owned(),
    }
}

/// A coordinate. What C libraries print for NaN and infinity is understood.
pub(super) fn number(token: Option<&[u8]>, line: usize, what: &str) -> Result<f64, Failure> {
    let Some(token) = token else {
        let problem = format!("the line ends before {what}; mend it or write the file again");
        return Err((MeshPlace::Line(line), problem));
    };
    let text = std::str::from_utf8(token).unwrap_or("");
    let unsigned = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    match text.parse::<f64>() {
        Ok(number) => Ok(number),
        Err(_) if unsigned.starts_with("nan(") || unsigned.starts_with("1.#") => Ok(f64::NAN),
        Err(_) => {
            let problem = format!(
                "`{}` is not a number, for {what}; mend the line or write the file again",
                shown(token)
            );
            Err((MeshPlace::Line(line), problem))
        }
    }
}

/// Words of a line, blanks left out.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}
