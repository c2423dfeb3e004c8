//! Direct illumination: the first integral of eq. (2).

use super::{Counters, Directions};
use crate::lights::{Light, LightId};
use crate::math::Rgb;
use crate::media::MediumId;
use crate::sampling::{ONE_MINUS_EPSILON, SampleStream, Splits};
use crate::scene::{Scene, SurfaceInteraction};
use glam::Vec2;

/// Up to so many lights, each gets its own shadow rays; beyond, one is drawn in proportion to its flux.
const LIGHTS_SAMPLED_EACH: usize = 8;

/// Shadow rays from diffuse surfaces to sampled points of the lights.
#[derive(Clone, Copy, Debug)]
pub struct DirectLighting<'a> {
    scene: &'a Scene,
    /// Shadow rays per light.
    samples: u32,
    /// Whether rays drawn from the BSDF complete the estimate by multiple importance sampling.
    bsdf_sampling: bool,
}

impl<'a> DirectLighting<'a> {
    /// `samples` shadow rays to each light (or in all, where lights are many).
    pub fn new(scene: &'a Scene, samples: u32, bsdf_sampling: bool) -> Self {
        Self { scene, samples: samples.max(1), bsdf_sampling }
    }

    /// Reflected radiance towards `hit.wo` of the light that arrives straight from emitters. `directions` are how rays
    /// are drawn that may hit a light by chance.
    pub fn radiance(
        &self,
        hit: &SurfaceInteraction,
        directions: &Directions<'_>,
        medium: MediumId,
        samples: &mut SampleStream,
        counters: &mut Counters,
    ) -> Rgb {
        let Some(power) = self.scene.light_power() else { return Rgb::ZERO };
        let mut sum = Rgb::ZERO;
        if self.scene.lights().len() <= LIGHTS_SAMPLED_EACH {
            for light in self.scene.lights() {
                let splits = samples.splits(self.samples);
                for i in 0..self.samples {
                    sum += self.sample_light(hit, directions, medium, light, (1.0, splits.get(i)), counters);
                }
            }
        } else {
            let choices: Splits = samples.splits(self.samples);
            let splits = samples.splits(self.samples);
            for i in 0..self.samples {
                let (index, probability, _) = power.sample(choices.get(i).x.min(ONE_MINUS_EPSILON));
                let light = &self.scene.lights()[index];
                sum +=
                    self.sample_light(hit, directions, medium, light, (probability, splits.get(i)), counters);
            }
        }
        sum / self.samples as f32
    }

    /// One shadow ray, weighted against BSDF sampling where that is done too. `choice` holds the probability with which
    /// the light was chosen and the random numbers.
    pub fn sample_light(
        &self,
        hit: &SurfaceInteraction,
        directions: &Directions<'_>,
        medium: MediumId,
        light: &Light,
        (probability, u): (f32, Vec2),
        counters: &mut Counters,
    ) -> Rgb {
        let shading = directions.shading;
        let Some(sample) = light.sample_li(hit.point.position, u) else {
            return Rgb::ZERO;
        };
        // Both normals must agree on the side, or light would leak through the surface.
        if sample.wi.dot(shading.geometric) * hit.wo.dot(shading.geometric) <= 0.0 {
            return Rgb::ZERO;
        }
        let wi = shading.frame.to_local(sample.wi);
        let f = shading.bsdf.eval(shading.wo_local, wi);
        let mut contribution = f * wi.z.abs() * sample.radiance_over_pdf / probability;
        if contribution == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let ray = match sample.target {
            Some(target) => hit.spawn_to(target),
            None => hit.spawn(sample.wi),
        };
        counters.shadow_rays += 1;
        if self.scene.occluded(&ray) {
            return Rgb::ZERO;
        }
        let medium = self.scene.medium(medium);
        if !medium.is_clear() {
            contribution *= medium.transmittance(sample.distance);
        }
        if self.bsdf_sampling && !light.is_delta() {
            contribution *=
                power_heuristic(sample.pdf_solid_angle * probability, directions.pdf_solid_angle(wi));
        }
        contribution
    }

    /// Probability with which [`Self::radiance`] chooses a light: what the pdf of its samples is multiplied by.
    pub fn choice_probability(&self, light: LightId) -> f32 {
        match self.scene.light_power() {
            Some(power) if self.scene.lights().len() > LIGHTS_SAMPLED_EACH => {
                power.probability(light as usize)
            }
            _ => 1.0,
        }
    }
}

/// Weight of a sample with density `pdf` against a technique with density `other` (Veach 1997, section 9.2.4).
pub(super) fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if pdf.is_infinite() {
        return 1.0;
    }
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}
