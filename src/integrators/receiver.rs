//! Irradiance at a place of a surface, whatever the surface is made of.

use crate::film::{Aov, PixelSample};
use crate::math::Rgb;
use crate::scene::{Material, Scene, Shading, SurfaceInteraction};
use std::f32::consts::PI;
use std::ops::Add;

/// A place of a surface as a white, flat Lambert surface in its stead would be: what that reflects, times pi, is the irradiance.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The place, seen from the side that is asked about; without texture, with the geometric normal.
    pub hit: SurfaceInteraction,
    /// White.
    pub shading: Shading,
}

impl Receiver {
    /// The place of `hit`, on the side that its ray arrived at.
    pub fn new(hit: &SurfaceInteraction) -> Self {
        let hit = SurfaceInteraction { tint: Rgb::ONE, shading_normal: hit.point.normal, ..*hit };
        let shading = hit.shading(&Material::Lambert { reflectance: Rgb::ONE, two_sided: true });
        Self { hit, shading }
    }

    /// Share of the irradiance that the surface itself reflects: its radiant exitance over the irradiance. `None` where
    /// it is not Lambertian, since the share then depends on where light comes from.
    pub fn reflectance(hit: &SurfaceInteraction, scene: &Scene) -> Option<Rgb> {
        hit.shading(scene.material(hit)).bsdf.lambertian().map(|lambert| lambert.reflectance)
    }
}

/// Irradiance in W/m^2 times the power factor of render space, by the part of the light; each contains the cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// Straight from emitters.
    pub direct: Rgb,
    /// After specular surfaces only.
    pub caustic: Rgb,
    /// After at least one diffuse surface.
    pub indirect: Rgb,
}

impl Irradiance {
    /// From the radiance that a [`Receiver`] reflects.
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
