//! Direct irradiance at points with known position and normal, such as those of photons.

use super::{DirectLighting, Directions, Scratch};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::sampling::{SampleStream, Stream, mix};
use crate::scene::{Material, Scene, SurfaceInteraction};
use glam::Vec3;
use std::f32::consts::PI;

/// Shadow rays to each light from each point. A few suffice: their noise differs from point to point, and gather rays end at many
/// points.
const SHADOW_RAYS: u32 = 2;

/// Computes the irradiance that arrives straight from emitters, by shadow rays.
#[derive(Clone, Copy, Debug)]
pub struct DirectAt<'a> {
    scene: &'a Scene,
    lights: DirectLighting<'a>,
    seed: u64,
}

impl<'a> DirectAt<'a> {
    /// Requires a scene whose media do not absorb, because the medium at the points is not known.
    pub fn new(scene: &'a Scene, seed: u64) -> Self {
        let seed = mix(seed ^ Stream::DirectAtPoints as u64);
        Self { scene, lights: DirectLighting::new(scene, SHADOW_RAYS, false), seed }
    }

    /// Unbiased estimate of the irradiance in W m^-2 times the power factor of render space, with the cosine to the shading normal.
    /// `number` selects the random numbers. `None` where no surface is found.
    pub fn irradiance(&self, number: u64, position: Vec3, normal: Vec3) -> Option<Rgb> {
        let hit = self.scene.surface_at(position, normal)?;
        let hit = SurfaceInteraction { tint: Rgb::ONE, ..hit };
        let white = hit.shading(&Material::Lambert { reflectance: Rgb::ONE, two_sided: true });
        let mut samples = SampleStream::new(self.seed, number, 0);
        let directions = Directions::of_bsdf(&white);
        let reflected =
            self.lights.radiance(&hit, &directions, MediumStack::AIR, &mut samples, &mut Scratch::default());
        Some(reflected.diffuse * PI)
    }
}
