//! What of a file's elements the mesh is made of, and the mesh while it is being read.

use super::Failure;
use super::error::{PlyPlace, PlyProblem};
use super::header::{Element, Header, Property, PropertyType};
use crate::math::unit;
use crate::scene_file::mesh::{MeshReport, Positions, triangulate_polygon};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Names of the two texture coordinates, in the order in which they are looked for.
const UV_NAMES: [[&str; 2]; 4] =
    [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// Which properties of a vertex are what, by their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct VertexColumns {
    pub(super) position: [usize; 3],
    /// Whether positions need doubles.
    pub(super) is_double: bool,
    pub(super) normal: Option<[usize; 3]>,
    pub(super) uv: Option<[usize; 2]>,
}

/// What to do with an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Vertices(VertexColumns),
    /// Number of the property that holds the corners.
    Faces(usize),
    Skipped,
}

/// The roles of all elements, in the order of the file.
#[derive(Debug)]
pub(super) struct Roles {
    pub(super) roles: Vec<Role>,
    /// Number of vertices that faces may refer to.
    pub(super) vertex_count: u64,
}

impl Roles {
    pub(super) fn of(header: &Header) -> Result<Self, Failure> {
        let fail = |element: &Element, problem| Err((PlyPlace::Line(element.line), problem));
        let mut roles = Vec::with_capacity(header.elements.len());
        for element in &header.elements {
            // Without records it does not matter which properties they would have.
            roles.push(match element.name.as_str() {
                _ if element.count == 0 => Role::Skipped,
                "vertex" if element.count > u64::from(u32::MAX) => {
                    return fail(element, PlyProblem::TooManyVertices { count: element.count });
                }
                "vertex" => match vertex_columns(element) {
                    Ok(columns) => Role::Vertices(columns),
                    Err(problem) => return fail(element, problem),
                },
                "face" => match corner_list(element) {
                    Some(list) => Role::Faces(list),
                    None => return fail(element, PlyProblem::NoVertexIndices),
                },
                "tristrips" => return fail(element, PlyProblem::TriangleStrips),
                _ => Role::Skipped,
            });
        }
        Ok(Self { roles, vertex_count: header.element("vertex").map_or(0, |element| element.count) })
    }
}

/// Number and type of the property of that name, if it is a number.
fn scalar(element: &Element, name: &str) -> Option<(usize, super::header::ScalarType)> {
    element.properties.iter().enumerate().find_map(|(column, property)| match property.kind {
        PropertyType::Scalar(scalar) if property.name == name => Some((column, scalar)),
        _ => None,
    })
}

fn vertex_columns(element: &Element) -> Result<VertexColumns, PlyProblem> {
    let coordinate = |name| scalar(element, name).ok_or(PlyProblem::NoCoordinate(name));
    let position = [coordinate("x")?, coordinate("y")?, coordinate("z")?];
    let column = |name| scalar(element, name).map(|(column, _)| column);
    let normal = match (column("nx"), column("ny"), column("nz")) {
        (Some(x), Some(y), Some(z)) => Some([x, y, z]),
        _ => None,
    };
    let uv = UV_NAMES.iter().find_map(|[u, v]| Some([column(u)?, column(v)?]));
    Ok(VertexColumns {
        position: position.map(|(column, _)| column),
        is_double: position.iter().any(|(_, scalar)| !scalar.fits_f32()),
        normal,
        uv,
    })
}

fn corner_list(element: &Element) -> Option<usize> {
    let is_corners = |property: &Property| {
        matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
            && matches!(property.kind, PropertyType::List(_, item) if item.is_integer())
    };
    element.properties.iter().position(is_corners)
}

/// The vertices of a file, as they stand in it.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) positions: Positions,
    pub(super) normals: Option<Vec<Vec3>>,
    pub(super) uvs: Option<Vec<Vec2>>,
}

impl Default for Vertices {
    fn default() -> Self {
        Self { positions: Positions::Single(Vec::new()), normals: None, uvs: None }
    }
}

impl Vertices {
    /// Room for `count` vertices, a number that has been compared with the length of the file.
    pub(super) fn with_capacity(columns: &VertexColumns, count: usize) -> Self {
        let positions = if columns.is_double {
            Positions::Double(Vec::with_capacity(count))
        } else {
            Positions::Single(Vec::with_capacity(count))
        };
        Self {
            positions,
            normals: columns.normal.map(|_| Vec::with_capacity(count)),
            uvs: columns.uv.map(|_| Vec::with_capacity(count)),
        }
    }

    /// Adds a vertex; `value` is the number in a column.
    pub(super) fn push(&mut self, columns: &VertexColumns, value: impl Fn(usize) -> f64) {
        match &mut self.positions {
            Positions::Single(positions) => {
                positions.push(columns.position.map(|column| value(column) as f32))
            }
            Positions::Double(positions) => positions.push(columns.position.map(&value)),
        }
        if let (Some(normals), Some(normal)) = (&mut self.normals, columns.normal) {
            normals.push(Vec3::from_array(normal.map(|column| value(column) as f32)));
        }
        if let (Some(uvs), Some(uv)) = (&mut self.uvs, columns.uv) {
            uvs.push(Vec2::from_array(uv.map(|column| value(column) as f32)));
        }
    }

    /// Normals to unit length, and zeros for what is of no use.
    pub(super) fn finish(
        mut self,
        report: &mut MeshReport,
    ) -> (Positions, Option<Vec<Vec3>>, Option<Vec<Vec2>>) {
        if let Some(normals) = &mut self.normals {
            let unusable = AtomicU64::new(0);
            normals.par_iter_mut().for_each(|normal| {
                let is_finite = normal.is_finite();
                *normal = unit(*normal).filter(|_| is_finite).unwrap_or_else(|| {
                    unusable.fetch_add(1, Ordering::Relaxed);
                    Vec3::ZERO
                });
            });
            report.unusable_normals = unusable.into_inner();
        }
        for uv in self.uvs.iter_mut().flatten().filter(|uv| !uv.is_finite()) {
            *uv = Vec2::ZERO;
            report.unusable_uvs += 1;
        }
        (self.positions, self.normals, self.uvs)
    }
}

/// What has been read of a file.
#[derive(Debug, Default)]
pub(super) struct Contents {
    pub(super) vertices: Vertices,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) report: MeshReport,
}

impl Contents {
    /// Adds a polygon.
    pub(super) fn push_face(&mut self, corners: &[u32]) {
        if corners.len() < 3 {
            self.report.short_faces += 1;
        } else {
            triangulate_polygon(corners, &mut self.triangles);
        }
    }
}

/// `index` as a corner, if there is such a vertex.
pub(super) fn checked_corner(index: i64, vertex_count: u64) -> Result<u32, PlyProblem> {
    match u32::try_from(index) {
        Ok(corner) if u64::from(corner) < vertex_count => Ok(corner),
        _ => Err(PlyProblem::IndexOutOfRange { index, vertices: vertex_count }),
    }
}
