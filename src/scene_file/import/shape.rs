//! Geometry of shapes: exact where that suffices, and meshes with vertex data where materials need them.

use super::Allow;
use super::Building;
use super::error::{Fault, fail};
use super::material::{Finished, Look, Needs};
use super::report::Subject;
use super::vertices::{bumped, vertex_data};
use crate::memory::MemoryEstimate;
use crate::scene_file::description::{GeometryDescription, MeshNormals};
use crate::scene_file::mesh::TriangleMesh;
use crate::scene_file::mesh_size::{MeshSize, mesh_size};
use glam::{DAffine3, Vec4};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most shapes of a scene, not counting instances.
pub(crate) const MOST_SHAPES: usize = 1 << 22;

/// Geometry of a shape.
pub(crate) enum Form {
    /// A mesh file that is read when the scene is built.
    File { path: PathBuf, normals: MeshNormals },
    /// Triangles with optional texture coordinates and colours.
    Mesh { mesh: TriangleMesh, colours: Vec<Vec4> },
    /// An exact shape.
    Exact(GeometryDescription),
}

/// A form with its placement.
pub(crate) struct Placed {
    pub form: Form,
    pub to_world: DAffine3,
    /// Whether the normal is reversed.
    pub flip: bool,
}

/// A mesh without colours of vertices.
pub(crate) fn mesh(mesh: TriangleMesh) -> Form {
    Form::Mesh { mesh, colours: Vec::new() }
}

/// Whether a transform scales differently along different axes.
pub(crate) fn is_distorted(transform: &DAffine3) -> bool {
    /// Differences of lengths and angles below this are rounding of the file's numbers.
    const TOLERANCE: f64 = 1e-9;
    let [x, y, z] = [transform.matrix3.x_axis, transform.matrix3.y_axis, transform.matrix3.z_axis];
    let largest = x.length().max(y.length()).max(z.length());
    let lengths = (x.length() - y.length()).abs().max((y.length() - z.length()).abs());
    let angles = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
    !(lengths <= TOLERANCE * largest && angles <= TOLERANCE * largest * largest)
}

/// Checks whether the memory for a mesh is allowed, from the size that its file declares. The first part is the memory of the
/// meshes before it.
pub(crate) fn foresee(
    (taken, allow): (&mut MemoryEstimate, Allow<'_>),
    object: &dyn Subject,
    path: &Path,
) -> Result<(), Fault> {
    let size = match mesh_size(path, MeshNormals::Leading) {
        Ok(size) if size.triangles > 0 => size,
        // Compressed or unusual files: their bytes are counted as corners.
        _ => {
            let length = std::fs::metadata(path).map_or(0, |file| file.len());
            MeshSize { vertices: length / 12, triangles: length / 6, has_normals: true, reading: length }
        }
    };
    taken.triangles = taken.triangles.saturating_add(size.triangles);
    // Counted twice: as read, and as placed.
    taken.meshes = taken.meshes.saturating_add(size.bytes().saturating_mul(2));
    taken.reading = taken.reading.max(size.reading);
    allow(taken).or_else(|error| {
        fail(
            object.place(),
            format!("the mesh of {}: {error}", object.label()),
            "allow more memory, or make the mesh smaller",
        )
    })
}

impl Building<'_> {
    /// The geometry of a shape, with the vertex data that its material needs. A bump map becomes a material of this shape alone.
    pub(crate) fn geometry(
        &mut self,
        object: &dyn Subject,
        look: &Look<'_>,
        (form, to_world): (Form, &DAffine3),
        finished: &mut Finished,
        needs: Needs,
    ) -> GeometryDescription {
        match form {
            Form::File { path, normals } => GeometryDescription::MeshFile {
                path,
                normals,
                own_materials: false,
                replaced: Vec::new(),
                fit: None,
            },
            Form::Exact(geometry) => geometry,
            Form::Mesh { mesh, .. } if !needs.any() => GeometryDescription::Loaded {
                mesh: Arc::new(mesh),
                normals: MeshNormals::FromFile,
                before: DAffine3::IDENTITY,
            },
            Form::Mesh { mut mesh, colours } => {
                let uvs = mesh.uvs.take();
                if needs.coordinates && uvs.is_none() {
                    self.report.warn(object, "has no texture coordinates, so its pictures are of one colour");
                }
                if needs.colours && colours.is_empty() {
                    self.report.warn(object, "has no colours of vertices, and is white in their place");
                }
                let is_mirrored = to_world.matrix3.determinant() < 0.0;
                if let (Some((slot, height)), Some(uvs)) = (&look.surface.bump, &uvs) {
                    let normals = bumped(slot, *height, (&mesh, uvs), to_world);
                    match normals {
                        Some(normals) => {
                            self.report.note(look.bsdf, "bumps are taken for a map of normals, by the mean size of its picture on the shape");
                            *finished = self.material(look, Some(normals));
                        }
                        None => self
                            .report
                            .warn(look.bsdf, "its bumps are left out: the shape has no size in its picture"),
                    }
                }
                let data = vertex_data(&mesh, uvs.unwrap_or_default(), colours, needs, is_mirrored);
                GeometryDescription::Gltf { mesh: Arc::new(mesh), data: Arc::new(data) }
            }
        }
    }
}
