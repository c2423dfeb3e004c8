//! Parts of a scene: surfaces with their geometry, and the list of all parts.

use super::illuminated::IlluminatedShape;
use super::material::Material;
use super::render_space::RenderSpace;
use super::surface::Placement;
use super::texture::MaterialTexture;
use crate::camera::PixelSpread;
use crate::embree::{CommittedScene, Procedural, TriangleBuffers};
use crate::lights::{Light, LightId};
use crate::math::unit;
use crate::media::Medium;
use crate::shapes::Chart;
use crate::textures::VertexData;
use glam::Vec3;
use std::sync::Arc;

/// Triangles, with the vertex data that shading needs.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Corners.
    pub buffers: TriangleBuffers,
    /// Unit normals at the vertices, for interpolation; `None` for flat shading.
    pub normals: Option<Arc<Vec<Vec3>>>,
    /// Vertex data of textures, where the material has some.
    pub data: Option<Arc<VertexData>>,
}

impl Mesh {
    /// Interpolated normal, on the side of `geometric`.
    #[inline]
    pub(super) fn shading_normal(&self, primitive: u32, uv: [f32; 2], geometric: Vec3) -> Vec3 {
        let Some(normals) = &self.normals else { return geometric };
        let [a, b, c] = self.buffers.triangles()[primitive as usize].map(|v| normals[v as usize]);
        let normal = a * (1.0 - uv[0] - uv[1]) + b * uv[0] + c * uv[1];
        match unit(normal) {
            Some(n) if n.dot(geometric) >= 0.0 => n,
            Some(n) => -n,
            None => geometric,
        }
    }
}

/// Geometry of a surface, as given to Embree.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Triangles.
    Mesh(Mesh),
    /// An exact or procedural shape.
    Procedural(Arc<dyn Procedural>),
}

/// A surface: geometry and material.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name in the scene file, including its place there, for messages.
    pub name: String,
    /// Geometry.
    pub geometry: Geometry,
    /// Whether the normal is opposite to the geometry's own.
    pub flip_normal: bool,
    /// Index into [`super::Scene::materials`].
    pub material: u32,
    /// Materials by part, for an object whose parts differ; empty where they do not.
    pub part_materials: Vec<u32>,
    /// The light that the surface is part of, if it emits.
    pub light: Option<LightId>,
    /// Coordinates of an illumination map, which sums up photons instead of storing them in photon maps.
    pub illumination: Option<Arc<IlluminatedShape>>,
    /// Coordinates on all parts of the surface, in the space of its geometry, for patches of radiosity; empty where there are none.
    pub charts: Vec<Chart>,
}

impl Surface {
    /// All materials that occur on the surface.
    pub fn all_materials(&self) -> impl Iterator<Item = u32> + '_ {
        let own = self.part_materials.is_empty().then_some(self.material);
        own.into_iter().chain(self.part_materials.iter().copied())
    }
}

/// What a geometry number of the top-level Embree scene refers to.
#[derive(Clone, Debug)]
pub enum Node {
    /// A surface in render space: index into [`super::Scene::surfaces`].
    Surface(u32),
    /// An instance: its geometry number `g` is surface `first + g`.
    Instance {
        /// Surface of the prototype's geometry 0.
        first: u32,
        /// Transform of the instance.
        placement: Box<Placement>,
    },
}

/// Bounding sphere of a surface, as used by projection maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Centre.
    pub center: Vec3,
    /// Radius, including room for the rounding of the surface.
    pub radius: f32,
    /// Relative density of caustic photons towards this surface: its specularity times the factor in the scene file. Zero for surfaces
    /// that cast no caustics.
    pub density: f32,
    /// Index into [`super::Scene::surfaces`].
    pub surface: u32,
    /// Corners of a box around the surface.
    pub bounds: [Vec3; 2],
}

impl Target {
    /// A sphere with its bounding box, as surface 0; it casts no caustics.
    pub fn of_sphere(center: Vec3, radius: f32) -> Self {
        Self { center, radius, density: 0.0, surface: 0, bounds: [center - radius, center + radius] }
    }
}

/// Data of a light beside its emission.
#[derive(Clone, Debug, PartialEq)]
pub struct LightNote {
    /// Name in the scene file, for messages.
    pub name: String,
    /// Relative number of photons, compared with other lights of the same flux; positive.
    pub photons: f32,
}

/// Everything a scene is made of.
#[derive(Debug)]
pub struct SceneParts {
    /// Name, for messages and metadata.
    pub name: String,
    /// The committed top-level scene.
    pub embree: CommittedScene,
    /// Surface or instance by geometry number of `embree`.
    pub nodes: Vec<Node>,
    /// All surfaces.
    pub surfaces: Vec<Surface>,
    /// Materials and their names.
    pub materials: Vec<(String, Material)>,
    /// Textures by material; may be shorter than the list of materials, and empty where there are none.
    pub textures: Vec<MaterialTexture>,
    /// Media; the first is air.
    pub media: Vec<Medium>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Transform between world and render space.
    pub space: RenderSpace,
    /// Bounds of all surfaces in render space: centre and radius.
    pub bounds: (Vec3, f32),
    /// Bounding spheres of the surfaces in render space, at which photons are aimed.
    pub targets: Vec<Target>,
    /// For each light, its name in the scene file and its relative number of photons.
    pub light_notes: Vec<LightNote>,
    /// Width of a pixel of the image, which selects the resolution of textures. Zero selects the full resolution.
    pub pixel: PixelSpread,
}
