//! Irradiance at a point of a surface, independent of the surface's material.

use crate::film::{Aov, PixelSample};
use crate::math::Rgb;
use crate::scene::{Material, Scene, Shading, SurfaceInteraction};
use std::f32::consts::PI;
use std::ops::Add;

/// A point of a surface with its material replaced by a white, flat Lambertian one: the radiance that this reflects, times pi, is the
/// irradiance.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The point, seen from the side in question, without texture and with the geometric normal.
    pub hit: SurfaceInteraction,
    /// White Lambertian shading.
    pub shading: Shading,
}

impl Receiver {
    /// The point of `hit`, on the side at which its ray arrived.
    pub fn new(hit: &SurfaceInteraction) -> Self {
        let hit = SurfaceInteraction { tint: Rgb::ONE, shading_normal: hit.point.normal, ..*hit };
        let shading = hit.shading(&Material::Lambert { reflectance: Rgb::ONE, two_sided: true });
        Self { hit, shading }
    }

    /// Reflectance of the actual surface: its radiant exitance over the irradiance. `None` where it is not Lambertian, because the ratio
    /// then depends on the directions of the light.
    pub fn reflectance(hit: &SurfaceInteraction, scene: &Scene) -> Option<Rgb> {
        hit.shading(scene.material(hit)).bsdf.lambertian().map(|lambert| lambert.reflectance)
    }
}

/// Irradiance in W/m^2 times the power factor of render space, split into the parts of the light; each part includes the cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// Light straight from emitters.
    pub direct: Rgb,
    /// Light that met only specular surfaces on its way.
    pub caustic: Rgb,
    /// Light that met at least one diffuse surface on its way.
    pub indirect: Rgb,
}

impl Irradiance {
    /// Irradiance from the radiance that a [`Receiver`] reflects.
    pub(super) fn of_white(radiance: &PixelSample) -> Self {
        let part = |aov: Aov| radiance.radiance[aov as usize] * PI;
        Self { direct: part(Aov::Direct), caustic: part(Aov::Caustics), indirect: part(Aov::Indirect) }
    }
}

impl Add for Irradiance {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            direct: self.direct + other.direct,
            caustic: self.caustic + other.caustic,
            indirect: self.indirect + other.indirect,
        }
    }
}
