//! What a scene is made of: surfaces and their geometry, and the list of all parts.

use super::illuminated::IlluminatedShape;
use super::material::Material;
use super::render_space::RenderSpace;
use super::surface::Placement;
use super::texture::MaterialTexture;
use crate::embree::{CommittedScene, Procedural, TriangleBuffers};
use crate::lights::{Light, LightId};
use crate::math::unit;
use crate::media::Medium;
use crate::textures::VertexData;
use glam::Vec3;
use std::sync::Arc;

/// Triangles with what shading needs beyond their corners.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Corners.
    pub buffers: TriangleBuffers,
    /// Unit normals at the vertices, for interpolation; `None` for flat shading.
    pub normals: Option<Arc<Vec<Vec3>>>,
    /// What textures need at the vertices, where the material has some.
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

/// What Embree knows about a surface.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Triangles.
    Mesh(Mesh),
    /// An exact or procedural shape.
    Procedural(Arc<dyn Procedural>),
}

/// A surface: geometry and what it is made of.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name in the scene file, and where it stands there, for messages.
    pub name: String,
    /// Geometry.
    pub geometry: Geometry,
    /// The normal is the opposite of the geometry's own.
    pub flip_normal: bool,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// The same for each part of an object whose parts differ; empty where they do not.
    pub part_materials: Vec<u32>,
    /// The light that this surface is, if it emits.
    pub light: Option<LightId>,
    /// Where photons are summed up in an illumination map instead of being kept in photon maps.
    pub illumination: Option<Arc<IlluminatedShape>>,
}

impl Surface {
    /// All materials that the surface has somewhere.
    pub fn all_materials(&self) -> impl Iterator<Item = u32> + '_ {
        let own = self.part_materials.is_empty().then_some(self.material);
        own.into_iter().chain(self.part_materials.iter().copied())
    }
}

/// What stands behind a geometry number of the top-level Embree scene.
#[derive(Clone, Debug)]
pub enum Node {
    /// A surface in render space: index into [`Scene::surfaces`].
    Surface(u32),
    /// An instance: its geometry number `g` is surface `first + g`.
    Instance {
        /// Surface of the prototype's geometry 0.
        first: u32,
        /// Where it stands.
        placement: Box<Placement>,
    },
}

/// A sphere around a surface, as projection maps see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Centre.
    pub center: Vec3,
    /// Radius, with room for the rounding of the surface.
    pub radius: f32,
    /// How dense caustic photons are to be in the directions of this surface: its specularity times what the scene file
    /// asks for. Zero for what casts no caustics.
    pub density: f32,
    /// Index into [`Scene::surfaces`].
    pub surface: u32,
    /// Corners of a box around the surface.
    pub bounds: [Vec3; 2],
}

impl Target {
    /// A sphere that casts no caustics, of surface 0, and the box around it.
    pub fn of_sphere(center: Vec3, radius: f32) -> Self {
        Self { center, radius, density: 0.0, surface: 0, bounds: [center - radius, center + radius] }
    }
}

/// What is known of a light beside what it emits.
#[derive(Clone, Debug, PartialEq)]
pub struct LightNote {
    /// Name in the scene file, for messages.
    pub name: String,
    /// Photons in proportion to other lights of the same flux; positive.
    pub photons: f32,
}

/// Everything a scene is made of.
#[derive(Debug)]
pub struct SceneParts {
    /// Name, for messages and metadata.
    pub name: String,
    /// The committed top-level scene.
    pub embree: CommittedScene,
    /// By geometry number of `embree`.
    pub nodes: Vec<Node>,
    /// All surfaces.
    pub surfaces: Vec<Surface>,
    /// Materials and their names.
    pub materials: Vec<(String, Material)>,
    /// Textures by material; may be shorter than the materials, and empty where there are none.
    pub textures: Vec<MaterialTexture>,
    /// Media; the first is air.
    pub media: Vec<Medium>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Map to the world.
    pub space: RenderSpace,
    /// Bounds of all surfaces in render space: centre and radius.
    pub bounds: (Vec3, f32),
    /// Spheres around the surfaces in render space: what photons are aimed at.
    pub targets: Vec<Target>,
    /// By light: name in the scene file, and photons in proportion to others of the same flux.
    pub light_notes: Vec<LightNote>,
    /// Width of a pixel of the picture at distance 1: how fine textures are read. 0 for as fine as they are.
    pub pixel: f32,
}
