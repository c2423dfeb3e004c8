//! The roles of a file's elements in the mesh, and the mesh while it is read.

use super::Failure;
use super::error::{PlyPlace, PlyProblem};
use super::header::{Element, Header, Property, PropertyType, ScalarType};
use crate::math::unit;
use crate::scene_file::keyed::Keyed;
use crate::scene_file::mesh::{MeshReport, Positions};
use crate::scene_file::polygon::{Run, push_fan};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Names of the two texture coordinates, in order of preference.
const UV_NAMES: [[&str; 2]; 4] =
    [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// Numbers of the properties of a vertex, by their role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct VertexColumns {
    pub(super) position: [usize; 3],
    /// Whether positions need doubles.
    pub(super) is_double: bool,
    pub(super) normal: Option<[usize; 3]>,
    pub(super) uv: Option<[usize; 2]>,
    pub(super) colour: Option<ColourColumns>,
}

/// Properties for red, green and blue of a vertex or a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ColourColumns {
    pub(super) columns: [usize; 3],
    scalar: ScalarType,
}

impl ColourColumns {
    /// Names of the three channels, in order of preference.
    const NAMES: [[&str; 3]; 3] =
        [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

    fn of(element: &Element) -> Option<Self> {
        Self::NAMES.iter().find_map(|names| {
            let [red, green, blue] = names.map(|name| scalar(element, name));
            let (red, scalar) = red?;
            Some(Self { columns: [red, green?.0, blue?.0], scalar })
        })
    }

    /// A channel as given in the file. Bytes are unsigned here, whatever the header declares.
    fn channel(&self, value: f64) -> f32 {
        let is_signed_byte = self.scalar == ScalarType::I8 && value < 0.0;
        (if is_signed_byte { value + 256.0 } else { value }) as f32
    }

    /// The colour of a record.
    pub(super) fn read(&self, value: impl Fn(usize) -> f64) -> [f32; 3] {
        self.columns.map(|column| self.channel(value(column)))
    }

    /// Maximum of the channels.
    fn most(&self) -> f32 {
        match self.scalar {
            ScalarType::F32 | ScalarType::F64 => 1.0,
            ScalarType::I16 | ScalarType::U16 => 65535.0,
            _ => 255.0,
        }
    }
}

/// Numbers of the properties of a face, by their role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FaceColumns {
    pub(super) corners: usize,
    /// Two texture coordinates for each corner.
    pub(super) uvs: Option<usize>,
    /// Index of the picture in the file's list.
    pub(super) texture: Option<usize>,
    pub(super) colour: Option<ColourColumns>,
}

impl FaceColumns {
    /// Whether corners have data besides their vertices.
    pub(super) fn has_look(&self) -> bool {
        self.uvs.is_some() || self.colour.is_some()
    }
}

/// Role of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Vertices(VertexColumns),
    Faces(FaceColumns),
    /// Number of the property that holds the vertices of strips; negative numbers separate strips.
    Strips(usize),
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
    /// Assigns the roles. `looks`: with colours and the data of faces.
    pub(super) fn of(header: &Header, looks: bool) -> Result<Self, Failure> {
        let fail = |element: &Element, problem| Err((PlyPlace::Line(element.line), problem));
        let mut roles = Vec::with_capacity(header.elements.len());
        for element in &header.elements {
            // Without records, the properties of an element do not matter.
            roles.push(match element.name.as_str() {
                _ if element.count == 0 => Role::Skipped,
                "vertex" if element.count > u64::from(u32::MAX) => {
                    return fail(element, PlyProblem::TooManyVertices { count: element.count });
                }
                "vertex" => match vertex_columns(element) {
                    Ok(columns) if looks => Role::Vertices(columns),
                    Ok(columns) => Role::Vertices(VertexColumns { colour: None, ..columns }),
                    Err(problem) => return fail(element, problem),
                },
                "face" => match corner_list(element) {
                    Some(corners) if looks => Role::Faces(face_columns(element, corners)),
                    Some(corners) => {
                        Role::Faces(FaceColumns { corners, uvs: None, texture: None, colour: None })
                    }
                    None => return fail(element, PlyProblem::NoVertexIndices),
                },
                "tristrips" => match corner_list(element) {
                    Some(list) => Role::Strips(list),
                    None => return fail(element, PlyProblem::NoVertexIndices),
                },
                _ => Role::Skipped,
            });
        }
        Ok(Self { roles, vertex_count: header.element("vertex").map_or(0, |element| element.count) })
    }
}

impl Roles {
    /// Maximum of the colour channels of the vertices, or of the faces.
    pub(super) fn colour_range(&self, of_faces: bool) -> f32 {
        let of = |role: &Role| match role {
            Role::Vertices(columns) if !of_faces => columns.colour,
            Role::Faces(columns) if of_faces => columns.colour,
            _ => None,
        };
        self.roles.iter().find_map(of).map_or(1.0, |colour| colour.most())
    }

    /// Whether the file has faces or strips.
    pub(super) fn have_faces(&self) -> bool {
        self.roles.iter().any(|role| matches!(role, Role::Faces(_) | Role::Strips(_)))
    }
}

/// Number and type of the scalar property with that name, if there is one.
fn scalar(element: &Element, name: &str) -> Option<(usize, ScalarType)> {
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
        colour: ColourColumns::of(element),
    })
}

fn face_columns(element: &Element, corners: usize) -> FaceColumns {
    let uvs = element
        .properties
        .iter()
        .position(|property| property.name == "texcoord" && matches!(property.kind, PropertyType::List(..)));
    FaceColumns {
        corners,
        uvs,
        texture: scalar(element, "texnumber").map(|(column, _)| column),
        colour: ColourColumns::of(element),
    }
}

fn corner_list(element: &Element) -> Option<usize> {
    let is_corners = |property: &Property| {
        matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
            && matches!(property.kind, PropertyType::List(_, item) if item.is_integer())
    };
    element.properties.iter().position(is_corners)
}

/// The vertices as given in the file.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) positions: Positions,
    pub(super) normals: Option<Vec<Vec3>>,
    pub(super) uvs: Option<Vec<Vec2>>,
    /// As given in the file.
    pub(super) colours: Option<Vec<[f32; 3]>>,
}

impl Default for Vertices {
    fn default() -> Self {
        Self { positions: Positions::Single(Vec::new()), normals: None, uvs: None, colours: None }
    }
}

impl Vertices {
    /// Allocates memory for `count` vertices; `count` has been checked against the length of the file.
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
            colours: columns.colour.map(|_| Vec::with_capacity(count)),
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
        if let (Some(colours), Some(colour)) = (&mut self.colours, columns.colour) {
            colours.push(colour.read(&value));
        }
    }

    /// The vertices for corners with their own data: vertex `of[i]` for corner `i`.
    pub(super) fn gathered(self, of: &[u32]) -> Self {
        fn of_all<T: Copy>(things: &[T], of: &[u32]) -> Vec<T> {
            of.iter().map(|&vertex| things[vertex as usize]).collect()
        }
        Self {
            positions: match &self.positions {
                Positions::Single(positions) => Positions::Single(of_all(positions, of)),
                Positions::Double(positions) => Positions::Double(of_all(positions, of)),
            },
            normals: self.normals.map(|normals| of_all(&normals, of)),
            uvs: self.uvs.map(|uvs| of_all(&uvs, of)),
            colours: self.colours.map(|colours| of_all(&colours, of)),
        }
    }

    /// Normalizes normals, and replaces unusable ones by zero.
    pub(super) fn mend(&mut self, report: &mut MeshReport) {
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
    }
}

/// The data of the corners of a face.
#[derive(Debug, Default)]
pub(super) struct FaceLook {
    /// Two numbers for each corner; any other count means no coordinates.
    pub(super) uvs: Vec<f32>,
    /// Number of the picture, from 0.
    pub(super) texture: i64,
    pub(super) colour: Option<[f32; 3]>,
}

/// Vertices for corners with their own data: one for each pair of a vertex and face data.
#[derive(Debug, Default)]
pub(super) struct Wedges {
    numbers: HashMap<(u32, [u32; 2], [u32; 3]), u32, Keyed>,
    /// The vertex of the file for each of them.
    pub(super) of: Vec<u32>,
    pub(super) uvs: Vec<Vec2>,
    /// Empty where faces have no colours.
    pub(super) colours: Vec<[f32; 3]>,
    /// By triangle.
    pub(super) textures: Vec<i64>,
    pub(super) unmapped_faces: u64,
}

impl Wedges {
    fn number(&mut self, vertex: u32, corner: usize, look: &FaceLook) -> u32 {
        let uv = match look.uvs.get(2 * corner..2 * corner + 2) {
            Some(&[u, v]) if (u + v).is_finite() => [u, v],
            _ => [0.0; 2],
        };
        let colour = look.colour.unwrap_or([f32::NAN; 3]);
        let key = (vertex, uv.map(f32::to_bits), colour.map(f32::to_bits));
        let next = self.of.len() as u32;
        let number = *self.numbers.entry(key).or_insert(next);
        if number == next {
            self.of.push(vertex);
            self.uvs.push(Vec2::from_array(uv));
            self.colours.push(colour);
        }
        number
    }
}

/// The content of a file.
#[derive(Debug, Default)]
pub(super) struct Contents {
    pub(super) vertices: Vertices,
    /// Polygons are fans until all positions are known.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Ranges of the polygons with more than one triangle.
    pub(super) polygons: Vec<Run>,
    /// Replaces `polygons` where all polygons are alike: the number of triangles of each, and their end.
    pub(super) equal_polygons: Option<(usize, usize)>,
    /// Present where corners have their own data.
    pub(super) wedges: Option<Wedges>,
    pub(super) report: MeshReport,
}

impl Contents {
    /// Adds a polygon with the data of its corners.
    pub(super) fn push_look(&mut self, corners: &[u32], look: &FaceLook) {
        let Some(wedges) = &mut self.wedges else { return self.push_face(corners) };
        let numbers: Vec<u32> =
            (0..corners.len()).map(|corner| wedges.number(corners[corner], corner, look)).collect();
        let before = self.triangles.len();
        self.push_face(&numbers);
        let added = self.triangles.len() - before;
        if let Some(wedges) = &mut self.wedges {
            wedges.textures.extend(std::iter::repeat_n(look.texture, added));
            wedges.unmapped_faces += u64::from(look.uvs.len() != 2 * corners.len());
        }
    }

    /// Adds the triangles of strips: each vertex makes a triangle with the two vertices before it, with alternating winding.
    pub(super) fn push_strips(
        &mut self,
        strips: impl Iterator<Item = i64>,
        vertex_count: u64,
    ) -> Result<(), PlyProblem> {
        let mut last: [Option<u32>; 2] = [None; 2];
        let mut is_odd = false;
        for index in strips {
            if index < 0 {
                (last, is_odd) = ([None; 2], false);
                continue;
            }
            let corner = checked_corner(index, vertex_count)?;
            if let [Some(a), Some(b)] = last {
                let triangle = if is_odd { [b, a, corner] } else { [a, b, corner] };
                // Repeated vertices only connect strips.
                if a != b && b != corner && a != corner {
                    self.push_look(&triangle, &FaceLook::default());
                }
                is_odd = !is_odd;
            }
            last = [last[1], Some(corner)];
        }
        Ok(())
    }

    /// Adds a polygon.
    pub(super) fn push_face(&mut self, corners: &[u32]) {
        if corners.len() < 3 {
            self.report.short_faces += 1;
        } else {
            if corners.len() > 3 {
                self.polygons.push(Run { first: self.triangles.len(), count: corners.len() - 2 });
            }
            push_fan(corners, &mut self.triangles);
        }
    }
}

/// Converts `index` to a corner, if that vertex exists.
pub(super) fn checked_corner(index: i64, vertex_count: u64) -> Result<u32, PlyProblem> {
    match u32::try_from(index) {
        Ok(corner) if u64::from(corner) < vertex_count => Ok(corner),
        _ => Err(PlyProblem::IndexOutOfRange { index, vertices: vertex_count }),
    }
}
