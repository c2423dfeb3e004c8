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
mod stream;
#[cfg(test)]
mod tests;

pub use error::{PlyError, PlyPlace, PlyProblem};

use super::mesh::{MeshReport, TriangleMesh, drop_unusable};
use super::mesh_file::MeshReading;
use super::mesh_size::MeshSize;
use header::{Element, Encoding, Header, PropertyType};
use layout::{Contents, Role, Roles};
use std::fs::File;
use std::path::Path;

/// Bound on the memory that reading takes, in lengths of the file (which is itself held in memory, unless it is binary and its
/// faces are alike). The worst
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
    read_ply_with(path, &MeshReading::ALL)
}

/// [`read_ply`], with a choice of what is read.
///
/// # Errors
/// As [`read_ply`], and where it was stopped.
pub fn read_ply_with(path: &Path, reading: &MeshReading<'_>) -> Result<(TriangleMesh, MeshReport), PlyError> {
    let in_file = |problem| PlyError::new(path, PlyPlace::File, problem);
    let metadata = std::fs::metadata(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
    if !metadata.is_file() {
        return Err(in_file(PlyProblem::NotAFile));
    }
    let file = File::open(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
    let (contents, trailing_bytes) = match stream::read(&file, metadata.len(), reading) {
        Some(read) => read,
        None if !(reading.progress)(0, metadata.len()) => return Err(in_file(PlyProblem::Stopped)),
        None => {
            let bytes = std::fs::read(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
            return parse_ply(&bytes, path).map(|(mesh, report)| (reading.without_unwanted(mesh), report));
        }
    };
    Ok(finish(contents, trailing_bytes))
}

/// Numbers of a file that begins with `head`, from its header. Only as many as its length has room for: a file that declares more
/// will be refused.
pub(super) fn declared_size(head: &[u8], length: u64) -> Option<MeshSize> {
    let header = Header::parse(head).ok()?;
    let roles = Roles::of(&header).ok()?;
    let mut left = length.saturating_sub(header.length as u64);
    let is_ascii = header.encoding == Encoding::Ascii;
    // The shortest text of a number is a digit and a blank.
    let shortest = |element: &Element| match is_ascii {
        true => 2 * element.properties.len() as u64,
        false => element.shortest_record() as u64,
    };
    let mut size = MeshSize { reading: if is_ascii { length } else { 0 }, ..MeshSize::default() };
    for (element, role) in header.elements.iter().zip(&roles.roles) {
        let least = shortest(element).max(1);
        let count = element.count.min(left / least);
        match *role {
            Role::Vertices(columns) => {
                size.vertices = count;
                size.has_normals = columns.normal.is_some();
                if columns.is_double {
                    size.reading = size.reading.saturating_add(24 * count);
                }
                left -= count * least;
            }
            Role::Faces(list) => {
                // What is beside the lengths of the lists is corners.
                let corner = match (is_ascii, element.properties.get(list).map(|property| property.kind)) {
                    (false, Some(PropertyType::List(_, item))) => item.size() as u64,
                    _ => 2,
                };
                let corners = (left - count * least) / corner;
                let polygons = corners.saturating_sub(2 * count);
                size.triangles = if is_ascii { count } else { polygons };
                left = 0;
            }
            Role::Skipped => left -= count * least,
        }
    }
    Some(size)
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
    Ok(finish(contents, trailing_bytes))
}

/// The mesh of what was read.
fn finish(contents: Contents, trailing_bytes: u64) -> (TriangleMesh, MeshReport) {
    let Contents { vertices, mut triangles, mut report } = contents;
    report.trailing_bytes = trailing_bytes;
    let (positions, normals, uvs) = vertices.finish(&mut report);
    drop_unusable(&mut triangles, &positions, &mut report);
    (TriangleMesh { positions, triangles, normals, uvs }, report)
}
