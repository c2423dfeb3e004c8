//! Direct illumination: the first integral of eq. (2).

use super::Counters;
use crate::bsdf::{Lobe, TransportMode};
use crate::lights::{Light, LightId};
use crate::math::Rgb;
use crate::media::MediumId;
use crate::sampling::{SampleStream, Splits, refined};
use crate::scene::{Scene, Shading, SurfaceInteraction};
use glam::{Vec2, Vec3};

/// Up to so many lights, each gets its own shadow rays; beyond, one is drawn in proportion to its flux.
const LIGHTS_SAMPLED_EACH: usize = 8;

/// What a surface reflects or transmits of the light that arrives straight from emitters, by lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reflected {
    /// By the diffuse lobe.
    pub diffuse: Rgb,
    /// By the glossy lobe, weighted against rays drawn from it.
    pub glossy: Rgb,
}

/// Where a ray was drawn from, and its density within a smooth lobe: light that it hits was sampled there as well.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drawn {
    pub from: Vec3,
    pub pdf: f32,
}

/// Shadow rays from surfaces that are not specular to sampled points of the lights.
#[derive(Clone, Copy, Debug)]
pub struct DirectLighting<'a> {
    scene: &'a Scene,
    /// Shadow rays per light.
    samples: u32,
    /// Whether rays drawn from the diffuse lobe complete the estimate by multiple importance sampling; those from the
    /// glossy lobe always do.
    bsdf_sampling: bool,
}

impl<'a> DirectLighting<'a> {
    /// `samples` shadow rays to each light (or in all, where lights are many).
    pub fn new(scene: &'a Scene, samples: u32, bsdf_sampling: bool) -> Self {
        Self { scene, samples: samples.max(1), bsdf_sampling }
    }

    /// Radiance towards `hit.wo` of the light that arrives straight from emitters.
    pub fn radiance(
        &self,
        hit: &SurfaceInteraction,
        shading: &Shading,
        medium: MediumId,
        samples: &mut SampleStream,
        counters: &mut Counters,
    ) -> Reflected {
        let mut sum = Reflected::default();
        let Some(power) = self.scene.light_power() else { return sum };
        let mut add = |found: Reflected| {
            sum.diffuse += found.diffuse;
            sum.glossy += found.glossy;
        };
        if self.scene.lights().len() <= LIGHTS_SAMPLED_EACH {
            for light in self.scene.lights() {
                let splits = samples.splits(self.samples);
                for i in 0..self.samples {
                    add(self.sample_light(hit, shading, medium, light, (1.0, splits.get(i)), counters));
                }
            }
        } else {
            let choices: Splits = samples.splits(self.samples);
            let splits = samples.splits(self.samples);
            for i in 0..self.samples {
                let (index, probability, _) = power.sample(refined(choices.get(i)));
                let light = &self.scene.lights()[index];
                add(self.sample_light(hit, shading, medium, light, (probability, splits.get(i)), counters));
            }
        }
        let count = self.samples as f32;
        Reflected { diffuse: sum.diffuse / count, glossy: sum.glossy / count }
    }

    /// One shadow ray, weighted against BSDF sampling where that is done too. `choice` holds the probability with which
    /// the light was chosen and the random numbers.
    pub fn sample_light(
        &self,
        hit: &SurfaceInteraction,
        shading: &Shading,
        medium: MediumId,
        light: &Light,
        (probability, u): (f32, Vec2),
        counters: &mut Counters,
    ) -> Reflected {
        let nothing = Reflected::default();
        let Some(sample) = light.sample_li(hit.point.position, u) else {
            return nothing;
        };
        let (wo, wi) = (shading.wo_local, shading.frame.to_local(sample.wi));
        // Both normals must agree on the side, or light would leak through the surface.
        let side = sample.wi.dot(shading.geometric) * hit.wo.dot(shading.geometric);
        let transmission = side < 0.0;
        if side == 0.0 || transmission != (wi.z * wo.z < 0.0) {
            return nothing;
        }
        let arriving = wi.z.abs() * sample.radiance_over_pdf / probability;
        let mut found = Reflected {
            diffuse: shading.bsdf.eval(Lobe::Diffuse, wo, wi, TransportMode::Radiance) * arriving,
            glossy: shading.bsdf.eval(Lobe::Glossy, wo, wi, TransportMode::Radiance) * arriving,
        };
        if found == nothing {
            return nothing;
        }
        let Some(medium) = self.scene.medium_after(medium, hit, shading, sample.wi, transmission) else {
            return nothing;
        };
        let ray = match sample.target {
            Some(target) => hit.spawn_to(target),
            None => hit.spawn(sample.wi),
        };
        counters.shadow_rays += 1;
        if self.scene.occluded(&ray) {
            return nothing;
        }
        let medium = self.scene.medium(medium);
        if !medium.is_clear() {
            let transmittance = medium.transmittance(sample.distance);
            found.diffuse *= transmittance;
            found.glossy *= transmittance;
        }
        if !light.is_delta() {
            let weight = |lobe| {
                let other = shading.bsdf.pdf_solid_angle(lobe, wo, wi);
                power_heuristic(sample.pdf_solid_angle * probability, other)
            };
            if self.bsdf_sampling && found.diffuse != Rgb::ZERO {
                found.diffuse *= weight(Lobe::Diffuse);
            }
            if found.glossy != Rgb::ZERO {
                found.glossy *= weight(Lobe::Glossy);
            }
        }
        found
    }

    /// Weight of light found along a ray drawn from a lobe, against sampling it from there; one for a ray that no light
    /// sampling competes with. `pdf_of_light` is the density per solid angle of the light's own samples.
    pub(super) fn weight(
        &self,
        drawn: Option<Drawn>,
        id: LightId,
        pdf_of_light: impl FnOnce(Vec3) -> f32,
    ) -> f32 {
        drawn.map_or(1.0, |drawn| {
            power_heuristic(drawn.pdf, pdf_of_light(drawn.from) * self.choice_probability(id))
        })
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
