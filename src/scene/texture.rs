//! Textures of materials, evaluated where a surface is hit.

use super::layered::LayeredMaterial;
use super::render_space::RenderSpace;
use super::surface::SurfaceInteraction;
use crate::bsdf::Bsdf;
use crate::camera::PixelSpread;
use crate::math::{Rgb, unit_f64};
use crate::textures::SolidTexture;
use glam::Vec3;
use std::sync::Arc;

/// Parameters that vary over the surfaces of a material. Materials without textures have the default, which costs nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialTexture {
    /// Factor on the reflectance.
    pub colour: Option<SolidTexture>,
    /// Bump map that tilts the shading normal.
    pub bump: Option<Bump>,
    /// Parameters of a glTF material.
    pub layers: Option<Arc<LayeredMaterial>>,
}

/// Bump map: a surface raised by a pattern, of which only the normals change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bump {
    /// The pattern; its colours are ignored.
    pub texture: SolidTexture,
    /// Height in metres of the pattern's value 1 above its value 0.
    pub height: f64,
}

impl MaterialTexture {
    /// Whether nothing varies.
    pub fn is_plain(&self) -> bool {
        self.colour.is_none() && self.bump.is_none() && self.layers.is_none()
    }

    /// Evaluates the textures at a hit; `pixel` is the width of a pixel.
    pub(super) fn apply(&self, hit: &mut SurfaceInteraction, space: &RenderSpace, pixel: PixelSpread) {
        let world = hit.point.position.as_dvec3() / space.scale + space.center;
        let width = (f64::from(pixel.width) + f64::from(pixel.angle) * f64::from(hit.distance)) / space.scale;
        if let Some(texture) = &self.colour {
            hit.tint = texture.colour(world, width);
        }
        if let Some(Bump { texture, height }) = &self.bump {
            // The normal of a surface that is raised along its own normal (Blinn 1978), in three dimensions.
            let normal = hit.shading_normal.as_dvec3();
            let slope = *height * texture.gradient(world, width);
            let tilted = unit_f64(normal - (slope - normal * slope.dot(normal)));
            if let Some(tilted) = tilted.map(|normal| normal.as_vec3())
                && is_beside(tilted, hit.point.normal)
            {
                hit.shading_normal = tilted;
            }
        }
    }
}

fn is_beside(shading: Vec3, geometric: Vec3) -> bool {
    shading.dot(geometric) > 0.0
}

/// The BSDF with its reflectance, or its diffuse component, multiplied by `tint`. Metals and interfaces between media keep their own
/// colour.
pub(super) fn tinted(bsdf: Bsdf, tint: Rgb) -> Bsdf {
    match bsdf {
        Bsdf::Lambert(mut lambert) => {
            lambert.reflectance *= tint;
            Bsdf::Lambert(lambert)
        }
        Bsdf::Mirror(mut mirror) => {
            mirror.reflectance *= tint;
            Bsdf::Mirror(mirror)
        }
        Bsdf::Schlick(schlick) => Bsdf::Schlick(schlick.tinted(tint)),
        Bsdf::Ward(ward) => Bsdf::Ward(ward.tinted(tint)),
        Bsdf::Conductor(_) | Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::Layered(_) => bsdf,
    }
}
