//! Mesh files of any kind, chosen by extension, and the code that the OBJ and STL readers share.

use super::mesh::{MeshReport, TriangleMesh};
use super::obj::read_obj_with;
use super::ply::{PlyError, read_ply_with};
use super::stl::read_stl_with;
use crate::files::read_regular;
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
    /// Another kind of file: the place, the problem, and what to do.
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

/// An error without the file's name, which is added later.
pub(super) type Failure = (MeshPlace, String);

pub(super) fn in_file(path: &Path, (place, problem): Failure) -> MeshFileError {
    MeshFileError::Other { file: path.to_path_buf(), place, problem }
}

/// Options for reading a mesh file.
#[derive(Clone, Copy)]
pub struct MeshReading<'a> {
    /// Whether normals are read, where the file has them.
    pub normals: bool,
    /// Whether texture coordinates are read, where the file has them.
    pub uvs: bool,
    /// Whether colours of vertices and faces are read, where the file has them.
    pub colours: bool,
    /// Progress callback: bytes read and bytes in total, from any thread. It returns false to stop.
    pub progress: &'a (dyn Fn(u64, u64) -> bool + Sync),
}

impl std::fmt::Debug for MeshReading<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MeshReading")
            .field("normals", &self.normals)
            .field("uvs", &self.uvs)
            .field("colours", &self.colours)
            .finish_non_exhaustive()
    }
}

impl MeshReading<'static> {
    /// Everything that a file has.
    pub const ALL: Self = Self { normals: true, uvs: true, colours: true, progress: &|_, _| true };
}

impl MeshReading<'_> {
    /// Removes the data that these options leave out.
    pub(super) fn without_unwanted(&self, mesh: TriangleMesh) -> TriangleMesh {
        let normals = mesh.normals.filter(|_| self.normals);
        let uvs = mesh.uvs.filter(|_| self.uvs);
        TriangleMesh { normals, uvs, ..mesh }
    }

    /// Reports progress up to byte `at` of `bytes`.
    pub(super) fn reached(&self, at: usize, bytes: &[u8]) -> Result<(), Failure> {
        match (self.progress)(at as u64, bytes.len() as u64) {
            true => Ok(()),
            false => Err((
                MeshPlace::File,
                "was not read to its end as reading was stopped; start again".to_owned(),
            )),
        }
    }
}

/// Reads a `.ply`, `.obj` or `.stl` file as one mesh.
///
/// # Errors
/// With the file, the line where there is one, the problem, and what to do.
pub fn read_mesh_file(path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    read_mesh_file_with(path, &MeshReading::ALL)
}

/// [`read_mesh_file`] with options.
///
/// # Errors
/// As [`read_mesh_file`], and where the reading was stopped.
pub fn read_mesh_file_with(
    path: &Path,
    reading: &MeshReading<'_>,
) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    let extension = path.extension().unwrap_or_default();
    let (mesh, report) = if extension.eq_ignore_ascii_case("obj") {
        read_obj_with(path, reading, |_| true)?.into_mesh()
    } else if extension.eq_ignore_ascii_case("stl") {
        read_stl_with(path, reading)?
    } else {
        read_ply_with(path, reading)?
    };
    Ok((reading.without_unwanted(mesh), report))
}

/// Content of a regular file.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshFileError> {
    let fail = |problem| in_file(path, (MeshPlace::File, problem));
    let unreadable = |error| fail(format!("cannot be read: {error}; check its name and permissions"));
    read_regular(path, u64::MAX).map_err(unreadable)
}

/// A token in the form that messages use.
pub(super) fn shown(token: &[u8]) -> String {
    let text = String::from_utf8_lossy(&token[..token.len().min(4 * SHOWN)]);
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text.into_owned(),
    }
}

/// Parses a coordinate. The forms of NaN and infinity that C libraries print are accepted.
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

/// The words of a line, separated by blanks.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// A square of two triangles in every supported format.
    fn samples() -> Vec<(&'static str, Vec<u8>)> {
        let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
            element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
        let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nusemtl red\nf 1//1 2//1 3//1\nf -4 -2 -1\n";
        let facet = |corners: &str| format!("facet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet\n");
        let ascii = format!(
            "solid square\n{}{}endsolid square\n",
            facet("vertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0"),
            facet("vertex 0 0 0\nvertex 1 1 0\nvertex 0 1 0")
        );
        let mut binary = vec![0; 80];
        binary.extend(2u32.to_le_bytes());
        for corners in [[0.0f32, 0.0, 1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0, 1.0]] {
            binary.extend([0; 12]);
            for corner in corners.chunks(2) {
                [corner[0], corner[1], 0.0].iter().for_each(|x| binary.extend(x.to_le_bytes()));
            }
            binary.extend([0; 2]);
        }
        vec![
            ("a.ply", ply.into()),
            ("a.obj", obj.into()),
            ("ascii.stl", ascii.into_bytes()),
            ("binary.STL", binary),
        ]
    }

    /// Reads a mesh, or checks that the error names the file and says what to do; it must never panic.
    fn read_or_told(path: &Path) -> Option<TriangleMesh> {
        match read_mesh_file(path) {
            Ok((mesh, _)) => {
                let count = mesh.positions.len() as u32;
                assert!(mesh.triangles.iter().flatten().all(|&vertex| vertex < count), "{}", path.display());
                Some(mesh)
            }
            Err(error) => {
                let message = error.to_string();
                let name = path.file_name().unwrap().to_string_lossy();
                // The remedy follows the last semicolon.
                assert!(message.contains(&*name) && message.contains("; "), "{message}");
                None
            }
        }
    }

    #[test]
    fn all_forms_give_the_same_square() {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in samples() {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            let mesh = read_or_told(&path).unwrap();
            let corners: Vec<_> =
                mesh.triangles.iter().map(|triangle| mesh.positions.corners(*triangle)).collect();
            let at = |x: f64, y: f64| glam::DVec3::new(x, y, 0.0);
            let wanted = [[at(0., 0.), at(1., 0.), at(1., 1.)], [at(0., 0.), at(1., 1.), at(0., 1.)]];
            assert_eq!(corners, wanted, "{name}");
        }
    }

    #[test]
    fn files_cut_short_or_damaged_are_read_or_told() {
        let folder = tempfile::tempdir().unwrap();
        let mut state = 1u64;
        for (name, bytes) in samples() {
            let path = folder.path().join(name);
            for sixteenth in 0..16 {
                fs::write(&path, &bytes[..bytes.len() * sixteenth / 16]).unwrap();
                let mesh = read_or_told(&path);
                // Only an OBJ does not state its length.
                assert!(
                    mesh.is_none() || name == "a.obj",
                    "{name} cut at {sixteenth}/16 was taken for whole"
                );
            }
            for _ in 0..400 {
                let mut damaged = bytes.clone();
                for _ in 0..3 {
                    state = crate::sampling::mix(state);
                    let at = state as usize % damaged.len();
                    damaged[at] = (state >> 40) as u8;
                }
                fs::write(&path, &damaged).unwrap();
                read_or_told(&path);
            }
        }
    }

    /// The malformed files of other readers' test collections, where they lie beside the checkout.
    #[test]
    fn malformed_collections_are_read_or_told() {
        let checkout = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut folders = checkout.ancestors().map(|folder| folder.join("shared/assets/malformed"));
        let Some(folder) = folders.find(|folder| folder.is_dir()) else {
            println!("skipped: no folder shared/assets/malformed beside the checkout");
            return;
        };
        let mut seen = 0;
        for collection in ["tinyobj", "trimesh", "magnum-ply"] {
            for entry in fs::read_dir(folder.join(collection)).unwrap() {
                let path = entry.unwrap().path();
                let extension = path.extension().unwrap_or_default().to_owned();
                if ["ply", "obj", "stl"].iter().any(|known| extension == *known) {
                    read_or_told(&path);
                    seen += 1;
                } else if extension == "mtl" {
                    super::super::obj::read_mtl(&path).unwrap();
                    seen += 1;
                }
            }
        }
        assert!(seen > 40, "{seen}");
    }
}
