//! PLY meshes (Turk 1994): ascii, and binary of both byte orders, with any scalar types. Unknown properties and elements are
//! skipped.
//!
//! The reader takes the element `vertex` (`x y z`; `nx ny nz`; `u v`, `s t`, `texture_u texture_v` or `texture_s texture_t`; `red
//! green blue`), the list `vertex_indices` or `vertex_index` of the elements `face` and `tristrips`, for faces also `texcoord`,
//! `texnumber` and `red green blue`, and comments `TextureFile`. Polygons become triangles as in [`super::polygon`]. Integers are
//! not scaled, except for colours.
//!
//! A file is never trusted: what it declares is checked against its length before memory is allocated, and memory stays below
//! [`MEMORY_FACTOR`] times that length. No file makes the reader panic or hang.

mod ascii;
mod binary;
mod error;
mod header;
mod layout;
mod stream;
#[cfg(test)]
mod tests;

pub use error::{PlyError, PlyPlace, PlyProblem};

use super::colours::reflectances;
use super::mesh::{MeshReport, TriangleMesh, drop_unusable, is_degenerate};
use super::mesh_file::MeshReading;
use super::mesh_size::MeshSize;
use super::polygon::{mend_equal_fans, mend_fans};
use crate::files::{open_regular, read_regular};
use glam::{Vec2, Vec3};
use header::{Element, Encoding, Header, PropertyType};
use layout::{Contents, FaceColumns, Role, Roles, Vertices};
use std::io::Read;
use std::path::Path;

/// Bound on the memory for reading, in lengths of the file. The file itself is in memory, unless it is binary and its faces are
/// alike. The worst case is polygons with one-byte indices, each of which becomes a triangle of twelve bytes in a growing list.
pub const MEMORY_FACTOR: u64 = 40;

/// Reads a PLY file.
///
/// Faces with fewer than three corners, triangles without area and triangles with corners that are not finite are dropped and
/// counted in the report. A file without vertices or faces is a mesh without triangles.
///
/// # Errors
/// [`PlyError`] with the file, the line or byte, the problem, and what to do.
pub fn read_ply(path: &Path) -> Result<(TriangleMesh, MeshReport), PlyError> {
    read_ply_with(path, &MeshReading::ALL)
}

/// [`read_ply`] with options.
///
/// # Errors
/// As [`read_ply`], and where the reading was stopped.
pub fn read_ply_with(path: &Path, reading: &MeshReading<'_>) -> Result<(TriangleMesh, MeshReport), PlyError> {
    let model = read(path, reading, false)?;
    Ok((reading.without_unwanted(model.mesh), model.report))
}

/// Reads a PLY file with its colours and the names of its pictures.
///
/// # Errors
/// As [`read_ply_with`].
pub fn read_ply_model(path: &Path, reading: &MeshReading<'_>) -> Result<PlyModel, PlyError> {
    read(path, reading, true)
}

/// A mesh and the look of its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyModel {
    /// The mesh. Where faces have their own data, each vertex stands for a pair of a vertex and face data.
    pub mesh: TriangleMesh,
    /// What was left out.
    pub report: MeshReport,
    /// Linear reflectances of the vertices.
    pub colours: Option<Vec<Vec3>>,
    /// Names of pictures, relative to the folder of the file.
    pub textures: Vec<String>,
    /// Index of the picture of each triangle, where there are several pictures.
    pub triangle_textures: Option<Vec<i64>>,
    /// Number of faces without texture coordinates, in a file that has them by face.
    pub unmapped_faces: u64,
}

/// The look that the header of a file declares: whether vertices or faces have colours, and the names of its pictures. Empty
/// where the header cannot be read.
pub fn declared_look(path: &Path) -> (bool, Vec<String>) {
    /// The same as in `stream`.
    const HEAD: u64 = 1 << 16;
    let mut head = Vec::new();
    let read = open_regular(path).and_then(|(file, _)| file.take(HEAD).read_to_end(&mut head));
    let Some(header) = read.ok().and_then(|_| Header::parse(&head).ok()) else { return (false, Vec::new()) };
    let roles = Roles::of(&header, true).map(|roles| roles.roles).unwrap_or_default();
    let has_colours = roles.iter().any(|role| match role {
        Role::Vertices(columns) => columns.colour.is_some(),
        Role::Faces(columns) => columns.colour.is_some(),
        Role::Strips(_) | Role::Skipped => false,
    });
    (has_colours, header.textures)
}

fn read(path: &Path, reading: &MeshReading<'_>, looks: bool) -> Result<PlyModel, PlyError> {
    let in_file = |problem| PlyError::new(path, PlyPlace::File, problem);
    let (file, length) = open_regular(path).map_err(|error| in_file(PlyProblem::Io(error)))?;
    match stream::read(&file, length, reading, looks) {
        Some((contents, header, roles, trailing_bytes)) => {
            Ok(finish(contents, header, &roles, trailing_bytes))
        }
        None if !(reading.progress)(0, length) => Err(in_file(PlyProblem::Stopped)),
        None => {
            let bytes = read_regular(path, u64::MAX).map_err(|error| in_file(PlyProblem::Io(error)))?;
            parse(&bytes, looks).map_err(|(place, problem)| PlyError::new(path, place, problem))
        }
    }
}

/// Size of the mesh from the header of a file that begins with `head`. Counts are limited by the file's length, because a file
/// that declares more is refused.
pub(super) fn declared_size(head: &[u8], length: u64) -> Option<MeshSize> {
    let header = Header::parse(head).ok()?;
    let roles = Roles::of(&header, false).ok()?;
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
            Role::Faces(FaceColumns { corners: list, .. }) | Role::Strips(list) => {
                // All bytes besides the lengths of the lists are corners.
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

/// Parses the bytes of a PLY file. Messages call it `path`.
///
/// # Errors
/// As [`read_ply`].
pub fn parse_ply(bytes: &[u8], path: &Path) -> Result<(TriangleMesh, MeshReport), PlyError> {
    let model = parse(bytes, false).map_err(|(place, problem)| PlyError::new(path, place, problem))?;
    Ok((model.mesh, model.report))
}

/// [`read_ply_model`] for bytes in memory. Messages call the file `path`.
///
/// # Errors
/// As [`read_ply`].
pub fn parse_ply_model(bytes: &[u8], path: &Path) -> Result<PlyModel, PlyError> {
    parse(bytes, true).map_err(|(place, problem)| PlyError::new(path, place, problem))
}

/// An error without the file's name, which is added later.
type Failure = (PlyPlace, PlyProblem);

fn parse(bytes: &[u8], looks: bool) -> Result<PlyModel, Failure> {
    let header = Header::parse(bytes)?;
    let roles = Roles::of(&header, looks)?;
    let mut contents = Contents::default();
    let trailing_bytes = match header.encoding {
        Encoding::Ascii => ascii::read_body(bytes, &header, &roles, &mut contents)?,
        Encoding::Binary(order) => binary::read_body(bytes, &header, order, &roles, &mut contents)?,
    };
    Ok(finish(contents, header, &roles, trailing_bytes))
}

/// Builds the mesh.
fn finish(contents: Contents, header: Header, roles: &Roles, trailing_bytes: u64) -> PlyModel {
    let Contents { mut vertices, mut triangles, polygons, equal_polygons, wedges, mut report } = contents;
    report.trailing_bytes = trailing_bytes;
    let mut most = roles.colour_range(false);
    let (mut triangle_textures, mut unmapped_faces) = (None, 0);
    if let Some(wedges) = wedges {
        vertices = vertices.gathered(&wedges.of);
        if wedges.uvs.iter().any(|uv| *uv != Vec2::ZERO) {
            vertices.uvs = Some(wedges.uvs);
            unmapped_faces = wedges.unmapped_faces;
        }
        // Colours of faces are used only where vertices have none, because vertex colours are finer.
        if vertices.colours.is_none() && wedges.colours.iter().flatten().any(|channel| !channel.is_nan()) {
            vertices.colours = Some(wedges.colours);
            most = roles.colour_range(true);
        }
        let is_several = wedges.textures.windows(2).any(|pair| pair[0] != pair[1]);
        triangle_textures = is_several.then_some(wedges.textures);
    }
    vertices.mend(&mut report);
    let Vertices { positions, normals, uvs, colours } = vertices;
    report.crossed_polygons = match equal_polygons {
        Some((count, end)) if count > 1 => mend_equal_fans(&mut triangles[..end], count, &positions),
        _ => mend_fans(&mut triangles, &polygons, &positions),
    };
    if triangles.is_empty() && !positions.is_empty() && !roles.have_faces() {
        report.cloud = Some(header.cloud());
    }
    triangle_textures = triangle_textures.map(|textures| {
        // Kept in step with the triangles that are dropped below.
        let is_kept = |triangle: &[u32; 3]| !is_degenerate(positions.corners(*triangle));
        textures
            .into_iter()
            .zip(&triangles)
            .filter(|(_, triangle)| is_kept(triangle))
            .map(|(texture, _)| texture)
            .collect()
    });
    drop_unusable(&mut triangles, &positions, &mut report);
    let colours = colours.map(|colours| reflectances(colours, most, &mut report));
    let mesh = TriangleMesh { positions, triangles, normals, uvs };
    PlyModel { mesh, report, colours, textures: header.textures, triangle_textures, unmapped_faces }
}
