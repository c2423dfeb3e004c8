//! Shapes whose material has images, a normal map or an alpha: they become meshes with texture coordinates, which alone are pictured.

use super::{BuildError, error_of, gltf_shapes};
use crate::scene_file::MeshReading;
use crate::scene_file::description::{
    GeometryDescription, MeshNormals, Named, SceneDescription, SceneWarning, ShapeDescription,
};
use crate::scene_file::import::material::{Needs, needs_of};
use crate::scene_file::import::tessellate;
use crate::scene_file::mesh::{Positions, TriangleMesh};
use crate::scene_file::mesh_file::{MeshFileError, read_mesh_file_with};
use crate::textures::VertexData;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Whether a shape has texture coordinates, or its file may have them.
pub(in crate::scene_file) fn can_be_pictured(geometry: &GeometryDescription) -> bool {
    match geometry {
        GeometryDescription::MeshFile { .. }
        | GeometryDescription::Mesh { .. }
        | GeometryDescription::Loaded { .. }
        | GeometryDescription::Gltf { .. }
        | GeometryDescription::Quad { .. }
        | GeometryDescription::Sphere { .. }
        | GeometryDescription::Cylinder { .. }
        | GeometryDescription::Disc { .. } => true,
        GeometryDescription::Csg { object, .. } => object.charts().is_some(),
        GeometryDescription::Generated(_)
        | GeometryDescription::SphereFlake { .. }
        | GeometryDescription::Terrain { .. } => false,
    }
}

/// What the material of a shape needs that the shape does not have yet.
pub(super) fn needs(description: &SceneDescription, shape: &ShapeDescription) -> Option<Needs> {
    if matches!(shape.geometry, GeometryDescription::Gltf { .. } | GeometryDescription::Loaded { .. }) {
        return None;
    }
    let needs = needs_of(&description.materials.get(shape.material)?.value);
    needs.any().then_some(needs)
}

/// Adds a shape as a mesh with the vertex data that its material needs.
pub(super) fn add(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    needs: Needs,
    reading: &MeshReading<'_>,
) -> Result<(), BuildError> {
    let fail = |problem: MeshFileError| error_of(shape, problem.into());
    let (mut mesh, before) = match &shape.value.geometry {
        GeometryDescription::MeshFile { path, normals, fit, .. } => {
            let (mesh, report) = read_mesh_file_with(path, reading).map_err(fail)?;
            let told = report.findings().into_iter().map(|finding| SceneWarning {
                location: shape.location.clone(),
                message: format!("{}: {finding}", shape.name),
            });
            taken.warnings.extend(told);
            let before = match fit {
                None => DAffine3::IDENTITY,
                Some(fit) => {
                    let missing = || error_of(shape, super::BuildProblem::Fit(path.clone()));
                    fit.of_shape(&mesh.bounds()).ok_or_else(missing)?
                }
            };
            (mesh_with_normals(mesh, *normals), before)
        }
        GeometryDescription::Mesh { positions, triangles, normals, uvs } => {
            let positions = Positions::Double(positions.iter().map(DVec3::to_array).collect());
            let (triangles, uvs) = (triangles.clone(), uvs.clone());
            let mesh = TriangleMesh { positions, triangles, normals: None, uvs };
            (mesh_with_normals(mesh, *normals), DAffine3::IDENTITY)
        }
        geometry => match tessellated(geometry) {
            Some(mesh) => (mesh, DAffine3::IDENTITY),
            None => {
                taken.shapes.push(shape.clone());
                return Ok(());
            }
        },
    };
    let uvs = mesh.uvs.take();
    if needs.coordinates && uvs.is_none() {
        taken.warnings.push(without_coordinates(shape));
    }
    let transform = shape.value.transform * before;
    // Without tangents: those at a hit follow the coordinates there, also where these are mirrored, by the mesh or by the transform.
    let data = VertexData { uvs: [upright(uvs.unwrap_or_default()), Vec::new()], ..VertexData::default() };
    taken.shapes.push(Named {
        value: ShapeDescription {
            geometry: GeometryDescription::Gltf { mesh: Arc::new(mesh), data: Arc::new(data) },
            transform,
            ..shape.value.clone()
        },
        ..shape.clone()
    });
    Ok(())
}

/// Coordinates whose second number goes up, as those of a picture, where it goes down.
pub(super) fn upright(mut uvs: Vec<Vec2>) -> Vec<Vec2> {
    uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    uvs
}

/// The vertex data of a part of a glTF file with what a material of the scene needs.
pub(super) fn of_gltf(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    needs: Needs,
    data: &Arc<VertexData>,
) -> Arc<VertexData> {
    let [uvs, _] = &data.uvs;
    if needs.coordinates && uvs.is_empty() {
        taken.warnings.push(without_coordinates(shape));
    }
    Arc::clone(data)
}

pub(super) fn without_coordinates(shape: &Named<ShapeDescription>) -> SceneWarning {
    SceneWarning {
        location: shape.location.clone(),
        message: format!(
            "{}: the mesh has no texture coordinates, so its images are of one colour",
            shape.name
        ),
    }
}

fn mesh_with_normals(mesh: TriangleMesh, normals: MeshNormals) -> TriangleMesh {
    let mesh = gltf_shapes::with_normals(&Arc::new(mesh), normals);
    Arc::unwrap_or_clone(mesh)
}

/// An exact shape as a mesh. Coordinates: of a quad along its edges; of spheres and cylinders around the axis y or their own, from its lower
/// end up; of a disc over the square around it; of a box on each side.
fn tessellated(geometry: &GeometryDescription) -> Option<TriangleMesh> {
    let moved = |mesh: TriangleMesh, matrix: DMat3, center: DVec3| {
        mesh.moved(&DAffine3::from_mat3_translation(matrix, center))
    };
    Some(match geometry {
        &GeometryDescription::Quad { corner, edge_u, edge_v } => {
            let normal = edge_u.cross(edge_v);
            let unit = crate::math::unit_f64(normal).unwrap_or(DVec3::Z);
            tessellate::grid(1, 1, |u, v| (corner + edge_u * u + edge_v * v, unit))
        }
        &GeometryDescription::Sphere { center, radius } => {
            // The pole of the grid goes up, and the middle of a picture to +z.
            let upwards = DQuat::from_rotation_x(-FRAC_PI_2);
            let turn = DMat3::from_quat(DQuat::from_rotation_y(FRAC_PI_2) * upwards);
            let mut mesh = tessellate::sphere();
            // Of the grid, the second coordinate is the angle from the pole.
            flip_second(&mut mesh);
            moved(mesh, turn * radius, center)
        }
        &GeometryDescription::Cylinder { base, top, radius } => {
            let axis = top - base;
            let z = crate::math::unit_f64(axis)?;
            let (x, y) = z.any_orthonormal_pair();
            moved(tessellate::cylinder(), DMat3::from_cols(x * radius, y * radius, axis), base)
        }
        &GeometryDescription::Disc { center, normal, radius } => {
            let z = crate::math::unit_f64(normal)?;
            let (x, y) = z.any_orthonormal_pair();
            let mut mesh = tessellate::disk();
            let over = |i: u32| {
                let at = mesh.positions.get(i);
                Vec2::new((0.5 + 0.5 * at.x) as f32, (0.5 + 0.5 * at.y) as f32)
            };
            mesh.uvs = Some((0..mesh.positions.len() as u32).map(over).collect());
            moved(mesh, DMat3::from_cols(x, y, z) * radius, center)
        }
        GeometryDescription::Csg { object, .. } => {
            let bounds = object.bounds();
            let half = 0.5 * (bounds.max - bounds.min);
            moved(tessellate::cube(), DMat3::from_diagonal(half), bounds.center())
        }
        _ => return None,
    })
}

fn flip_second(mesh: &mut TriangleMesh) {
    mesh.uvs = mesh.uvs.take().map(upright);
}
