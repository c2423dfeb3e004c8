//! Irradiance of direct light at places of which position and normal are known, as those of photons.

use super::{DirectLighting, Directions, Scratch};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::sampling::{SampleStream, Stream, mix};
use crate::scene::{Material, Scene, SurfaceInteraction};
use glam::Vec3;
use std::f32::consts::PI;

/// Shadow rays to each light from each place. Few, since their noise differs from place to place, and a gather ends at many.
const SHADOW_RAYS: u32 = 2;

/// Irradiance of the light that arrives straight from emitters, by shadow rays.
#[derive(Clone, Copy, Debug)]
pub struct DirectAt<'a> {
    scene: &'a Scene,
    lights: DirectLighting<'a>,
    seed: u64,
}

impl<'a> DirectAt<'a> {
    /// In a scene whose media do not absorb: what the places lie in is not known.
    pub fn new(scene: &'a Scene, seed: u64) -> Self {
        let seed = mix(seed ^ Stream::DirectAtPoints as u64);
        Self { scene, lights: DirectLighting::new(scene, SHADOW_RAYS, false), seed }
    }

    /// Irradiance in W m^-2 times the power factor of render space, with the cosine to the shading normal: an unbiased estimate,
    /// by random numbers that belong to the `number`. `None` where no surface is found.
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
