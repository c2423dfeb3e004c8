//! PLY meshes (Turk 1994): ascii and binary of both byte orders, any scalar types, extra properties and elements
//! skipped.
//!
//! Read are the element `vertex` (`x y z`; `nx ny nz`; `u v`, `s t`, `texture_u texture_v` or
//! `texture_s texture_t`) and the list `vertex_indices` or `vertex_index` of the element `face`. Polygons become
//! fans of triangles (see [`super::mesh::triangulate_polygon`] for concave ones). Integers are taken as they
//! are: no range is mapped to 0 to 1.
//!
//! A file is never trusted: what it declares is compared with its length before memory is taken, and memory stays
//! below [`MEMORY_FACTOR`] times that length. Nothing in a file makes the reader panic or hang.

mod ascii;
mod binary;
mod error;
mod header;
mod layout;
#[cfg(test)]
mod tests;

pub use error::{PlyError, PlyPlace, PlyProblem};

use super::mesh::{MeshReport, TriangleMesh, drop_unusable};
use header::{Encoding, Header};
use layout::{Contents, Roles};
use std::path::Path;

/// Bound on the memory that reading takes, in lengths of the file (which is itself held in memory). The worst
/// case is polygons of indices of one byte, each of which becomes a triangle of twelve in a growing list.
pub const MEMORY_FACTOR: u64 = 40;

/// Reads a PLY file.
///
/// Faces with fewer than three corners, triangles without area and triangles with corners that are not finite are
/// dropped and counted in the report. A file without vertices or faces is a mesh without triangles.
///
/// # Errors
/// [`PlyError`] with the file, the line or byte, what is wrong and what to do.
pub fn read_ply(path: &Path) -> Result<(TriangleMesh, MeshReport), PlyError> {
    let in_file = |problem| PlyError::new(path, PlyPlace::File, problem);
    let metadata = std::fs::metadata(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
    if !metadata.is_file() {
        return Err(in_file(PlyProblem::NotAFile));
    }
    let bytes = std::fs::read(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
    parse_ply(&bytes, path)
}

/// Parses the bytes of a PLY file; `path` is only for messages.
///
/// # Errors
/// As [`read_ply`].
pub fn parse_ply(bytes: &[u8], path: &Path) -> Result<(TriangleMesh, MeshReport), PlyError> {
    parse(bytes).map_err(|(place, problem)| PlyError::new(path, place, problem))
}

/// An error before the file's name is added to it.
type Failure = (PlyPlace, PlyProblem);

fn parse(bytes: &[u8]) -> Result<(TriangleMesh, MeshReport), Failure> {
    let header = Header::parse(bytes)?;
    let roles = Roles::of(&header)?;
    let mut contents = Contents::default();
    let trailing_bytes = match header.encoding {
        Encoding::Ascii => ascii::read_body(bytes, &header, &roles, &mut contents)?,
        Encoding::Binary(order) => binary::read_body(bytes, &header, order, &roles, &mut contents)?,
    };
    let Contents { vertices, mut triangles, mut report } = contents;
    report.trailing_bytes = trailing_bytes;
    let (positions, normals, uvs) = vertices.finish(&mut report);
    drop_unusable(&mut triangles, &positions, &mut report);
    Ok((TriangleMesh { positions, triangles, normals, uvs }, report))
}
