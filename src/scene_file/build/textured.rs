//! Additions of a glTF file to a shape: vertex data, cut-outs, and emission scaled by a picture.

use super::place::Placed;
use super::{BuildError, Builder, add_geometry, error_of};
use crate::embree::SceneBuilder;
use crate::lights::AreaLight;
use crate::scene::{AlphaCutout, Geometry, LayeredMaterial, Surface, glow_of};
use crate::scene_file::description::{GeometryDescription, MaterialDescription, SceneDescription};
use crate::textures::VertexData;
use glam::DAffine3;
use std::sync::Arc;

/// The layered material whose textures are looked up at hits; `None` where nothing varies over the surface.
pub(super) fn layers_of(material: &MaterialDescription) -> Option<Arc<LayeredMaterial>> {
    match material {
        MaterialDescription::Layered { material, .. } => (!material.is_even()).then(|| Arc::clone(material)),
        _ => None,
    }
}

/// The glTF material of a shape.
fn material_of(description: &SceneDescription, shape: usize) -> Option<&Arc<LayeredMaterial>> {
    match &description.materials[description.shapes[shape].value.material].value {
        MaterialDescription::Layered { material, .. } => Some(material),
        _ => None,
    }
}

/// The emission of a shape, scaled by its picture. `None` where nothing remains.
pub(super) fn with_glow(
    light: AreaLight,
    description: &SceneDescription,
    shape: usize,
    surface: &Surface,
) -> Option<AreaLight> {
    let glow = match (material_of(description, shape), &surface.geometry) {
        (Some(material), Geometry::Mesh(mesh)) => {
            let glow = mesh.data.as_ref().and_then(|data| glow_of(material, data));
            glow.map(|glow| (glow, mesh.buffers.triangles().to_vec()))
        }
        _ => None,
    };
    match glow {
        Some((glow, corners)) => light.with_glow(Arc::new(glow), corners),
        None => Some(light),
    }
}

/// The vertex data with tangents in another space. A mirrored transform flips the bitangents.
fn transformed(data: &Arc<VertexData>, transform: &DAffine3) -> Arc<VertexData> {
    if data.tangents.is_empty() {
        return Arc::clone(data);
    }
    let handed = if transform.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
    let turn = |&(tangent, sign): &(glam::Vec3, f32)| {
        let turned = crate::math::unit_f64(transform.matrix3 * tangent.as_dvec3());
        (turned.map_or(glam::Vec3::ZERO, |tangent| tangent.as_vec3()), handed * sign)
    };
    Arc::new(VertexData { tangents: data.tangents.iter().map(turn).collect(), ..VertexData::clone(data) })
}

impl Builder<'_> {
    /// Places shape `index` under `transform`, with the data of its vertices.
    pub(super) fn place(
        &self,
        index: usize,
        transform: &DAffine3,
        emits: bool,
    ) -> Result<Placed, BuildError> {
        let shape = &self.description.shapes[index];
        let placed = self.sources[index].0.place(transform, emits);
        let placed = placed.map_err(|problem| error_of(shape, problem))?;
        Ok(self.with_vertex_data(index, transform, placed))
    }

    /// Adds the vertex data for textures to a placed mesh.
    pub(super) fn with_vertex_data(&self, index: usize, transform: &DAffine3, mut placed: Placed) -> Placed {
        let shape = &self.description.shapes[index];
        if let (GeometryDescription::Gltf { data, .. }, Geometry::Mesh(mesh)) =
            (&shape.value.geometry, &mut placed.geometry)
        {
            mesh.data = Some(transformed(data, transform));
        }
        placed
    }

    /// Adds the geometry of shape `index`, with its cut-outs.
    pub(super) fn add_geometry(
        &self,
        index: usize,
        builder: &mut SceneBuilder,
        geometry: &Geometry,
    ) -> Result<(), BuildError> {
        let cut = match (material_of(self.description, index), geometry) {
            (Some(material), Geometry::Mesh(mesh)) if material.has_holes() => {
                mesh.data.as_ref().map(|data| (Arc::clone(material), Arc::clone(data), mesh.buffers.clone()))
            }
            _ => None,
        };
        let added = match cut {
            Some((material, data, buffers)) => {
                let cutout = AlphaCutout::new(material, data, buffers.clone());
                builder.add_cut_triangles(buffers, Arc::new(cutout))
            }
            None => add_geometry(builder, geometry),
        };
        added.map_err(|problem| error_of(&self.description.shapes[index], problem.into()))?;
        Ok(())
    }
}
