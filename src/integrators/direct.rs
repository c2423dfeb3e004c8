//! Direct illumination by shadow rays: the first integral of eq. (2).

use super::{Directions, Scratch};
use crate::bsdf::Lobe;
use crate::lights::{Light, LightId, Receiver};
use crate::math::{Ray, Rgb};
use crate::media::{MediumStack, PlaceSample};
use crate::photons::{ShadowDecision, ShadowMaps};
use crate::sampling::{SampleStream, Splits, refined};
use crate::scene::{Scene, SurfaceInteraction};
use crate::transport::{
    Collision, Stretch, attenuation, power_heuristic, receiver, transmittance, transmittance_in_media,
};
use glam::{DVec3, Vec2, Vec3};
use std::ops::AddAssign;

/// Light that arrives straight from emitters and that a surface reflects or transmits, by lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reflected {
    /// By the diffuse lobe.
    pub diffuse: Rgb,
    /// By the glossy lobe, with the MIS weight against rays sampled from that lobe.
    pub glossy: Rgb,
}

/// Traces shadow rays from surfaces that are not specular to sampled points of the lights.
#[derive(Clone, Copy, Debug)]
pub struct DirectLighting<'a> {
    scene: &'a Scene,
    /// Shadow rays per light.
    samples: u32,
    /// Whether rays sampled from the diffuse lobe complete the estimate by multiple importance sampling. Rays from the glossy lobe
    /// always do.
    bsdf_sampling: bool,
    /// Shadow photons that decide where shadow rays are not needed.
    shadows: Option<&'a ShadowMaps>,
}

/// A surface that receives light, with the latest decision of its shadow photons.
struct Shaded<'a> {
    /// The receiving point, as lights use it.
    at: Receiver,
    hit: &'a SurfaceInteraction,
    directions: &'a Directions<'a>,
    medium: MediumStack,
    /// Index of a light, and the decision of its shadow photons. All rays from one point to one light share it.
    decided: Option<(usize, Option<ShadowDecision>)>,
}

impl<'a> DirectLighting<'a> {
    /// Traces `samples` shadow rays to each light, or to all lights together where there are many.
    pub fn new(scene: &'a Scene, samples: u32, bsdf_sampling: bool) -> Self {
        Self { scene, samples: samples.max(1), bsdf_sampling, shadows: None }
    }

    /// The same, with shadow rays only where `shadows` cannot decide whether a light is visible.
    #[must_use]
    pub fn with_shadows(self, shadows: Option<&'a ShadowMaps>) -> Self {
        Self { shadows, ..self }
    }

    /// Radiance towards `hit.wo` of the light that arrives straight from emitters. `directions` describes how rays are sampled that may
    /// hit a light by chance.
    pub fn radiance(
        &self,
        hit: &SurfaceInteraction,
        directions: &Directions<'_>,
        medium: MediumStack,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Reflected {
        let at = receiver(self.scene, hit);
        let mut receiver = Shaded { at, hit, directions, medium, decided: None };
        let mut sum = Reflected::default();
        if self.scene.light_power().is_none() {
            return sum;
        }
        let mut add = |found: Reflected| {
            sum.diffuse += found.diffuse;
            sum.glossy += found.glossy;
        };
        let choice = self.scene.light_choice();
        for &light in choice.each() {
            let splits = samples.splits(self.samples);
            for i in 0..self.samples {
                add(self.sample_light(&mut receiver, light as usize, (1.0, splits.get(i)), scratch));
            }
        }
        for group in choice.groups() {
            let choices: Splits = samples.splits(self.samples);
            let splits = samples.splits(self.samples);
            for i in 0..self.samples {
                let Some((light, probability)) = group.sample(&at, refined(choices.get(i))) else { continue };
                add(self.sample_light(&mut receiver, light as usize, (probability, splits.get(i)), scratch));
            }
        }
        let count = self.samples as f32;
        Reflected { diffuse: sum.diffuse / count, glossy: sum.glossy / count }
    }

    /// Radiance of direct light that a stretch of a path scatters, at the start of the stretch and divided by its weight. For each light, a
    /// number of `places` and one shadow ray from each are sampled. Places are sampled near the light and where the path is likely to
    /// collide (Kulla & Fajardo 2012), and weighted against collisions of the path followed by a direction of the phase function where the
    /// path continues so (`phase_sampling`). `throughput` is that of
    /// the path at the start of the stretch.
    pub fn scattered(
        &self,
        stretch: &Stretch<'_>,
        (throughput, phase_sampling, places): (Rgb, bool, u32),
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Rgb {
        let mut sum = Rgb::ZERO;
        if self.scene.light_power().is_none() || stretch.volume.coefficients().scattering() == Rgb::ZERO {
            return sum;
        }
        let choice = self.scene.light_choice();
        for place in 0..places {
            // One place in each part of the range of distances.
            let within = |u: f32| (f64::from(place) + f64::from(u)) / f64::from(places);
            for &light in choice.each() {
                let [way, u] = samples.next_2d().to_array();
                let u_light = samples.next_2d();
                let Some(distances) = stretch.distances(self.anchor(light), throughput) else { continue };
                let at = distances.sample(way.into(), within(u));
                sum += self.scattered_at(stretch, (at, phase_sampling), (light, 1.0, u_light), scratch);
            }
            for group in choice.groups() {
                let [way, u] = samples.next_2d().to_array();
                let (choices, u_light) = (refined(samples.next_2d()), samples.next_2d());
                let Some(distances) = stretch.distances(None, throughput) else { continue };
                let at = distances.sample(way.into(), within(u));
                let from = in_medium(stretch.line.at(at.t).as_vec3());
                let Some((light, probability)) = group.sample(&from, choices) else { continue };
                sum +=
                    self.scattered_at(stretch, (at, phase_sampling), (light, probability, u_light), scratch);
            }
        }
        sum / places as f32
    }

    /// [`Self::scattered`] at a sampled distance, for a light that was chosen with a given probability.
    fn scattered_at(
        &self,
        stretch: &Stretch<'_>,
        (at, phase_sampling): (PlaceSample, bool),
        (index, probability, u): (LightId, f32, Vec2),
        scratch: &mut Scratch,
    ) -> Rgb {
        let place = stretch.line.at(at.t);
        let position = place.as_vec3();
        let light = &self.scene.lights()[index as usize];
        let Some(sample) = light.sample_li(in_medium(position), u) else { return Rgb::ZERO };
        let wo = -stretch.line.direction().as_vec3();
        let phase = stretch.volume.phase().eval(wo, sample.wi);
        if !(phase > 0.0 && at.pdf > 0.0) {
            return Rgb::ZERO;
        }
        scratch.counters.shadow_rays += 1;
        let ray = match sample.target {
            Some(target) => Ray::segment(position, target),
            None => Ray::new(position, sample.wi),
        };
        let Some(arriving) = transmittance_in_media(self.scene, &ray, stretch.medium) else {
            return Rgb::ZERO;
        };
        let volume = stretch.volume;
        let left = volume.transmittance(&stretch.line, at.t, &mut { stretch.rng });
        let weight = if light.is_delta() || !phase_sampling {
            1.0
        } else {
            let other = (at.collides / at.pdf) as f32 * phase;
            power_heuristic(sample.pdf_solid_angle * probability, other)
        };
        let scattering = volume.coefficients().scattering() * (volume.density().at(place) / at.pdf) as f32;
        sample.radiance_over_pdf * arriving * left * scattering * (phase * weight / probability)
    }

    /// Radiance of direct light that a medium scatters at a collision towards `wo`, over the weight of the collision. One shadow ray is
    /// sampled for each light or group of lights, weighted against directions of the phase function if the path continues in one.
    pub fn at_collision(
        &self,
        collision: &Collision<'_>,
        (wo, phase_sampling): (Vec3, bool),
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Rgb {
        let mut sum = Rgb::ZERO;
        if self.scene.light_power().is_none() {
            return sum;
        }
        let from = in_medium(collision.position);
        let mut add = |light: LightId, probability: f32, u: Vec2| {
            let Some(sample) = self.scene.lights()[light as usize].sample_li(from, u) else { return };
            let phase = collision.phase.eval(wo, sample.wi);
            scratch.counters.shadow_rays += 1;
            let ray = match sample.target {
                Some(target) => Ray::segment(from.position, target),
                None => Ray::new(from.position, sample.wi),
            };
            if let Some(arriving) = transmittance_in_media(self.scene, &ray, collision.stretch.medium) {
                let is_alone = self.scene.lights()[light as usize].is_delta() || !phase_sampling;
                let weight =
                    if is_alone { 1.0 } else { power_heuristic(sample.pdf_solid_angle * probability, phase) };
                sum += sample.radiance_over_pdf * arriving * (phase * weight / probability);
            }
        };
        let choice = self.scene.light_choice();
        for &light in choice.each() {
            add(light, 1.0, samples.next_2d());
        }
        for group in choice.groups() {
            let (choices, u) = (refined(samples.next_2d()), samples.next_2d());
            if let Some((light, probability)) = group.sample(&from, choices) {
                add(light, probability, u);
            }
        }
        sum
    }

    /// Factor on the phase function's density at a collision, which makes it comparable with the samples of the light `id` by
    /// [`Self::scattered`]. `id` is `None` for lights at infinity. `throughput` is that of the path at the start of the stretch.
    pub fn density_of_collision(&self, at: &Collision<'_>, throughput: Rgb, id: Option<LightId>) -> f32 {
        let anchor =
            id.filter(|id| self.scene.light_choice().each().contains(id)).and_then(|id| self.anchor(id));
        // What no light is sampled from is found by collisions alone.
        let place = at.stretch.distances(anchor, throughput).map(|distances| distances.at(at.t));
        place
            .filter(|place| place.pdf > 0.0)
            .map_or(f32::INFINITY, |place| (place.collides / place.pdf) as f32)
    }

    /// Approximate position of a light; `None` for light from infinity.
    fn anchor(&self, light: LightId) -> Option<DVec3> {
        match &self.scene.lights()[light as usize] {
            Light::Area(area) => area.bounding_sphere().map(|(centre, _)| centre),
            Light::Point(point) => Some(point.position.as_dvec3()),
            Light::Spot(spot) => Some(spot.position.as_dvec3()),
            Light::Directional(_) | Light::Sun(_) | Light::Environment(_) => None,
        }
    }

    /// One shadow ray, with an MIS weight against BSDF sampling where that is used too. The tuple holds the probability with which the
    /// light was chosen and the random numbers.
    fn sample_light(
        &self,
        receiver: &mut Shaded<'_>,
        index: usize,
        (probability, u): (f32, Vec2),
        scratch: &mut Scratch,
    ) -> Reflected {
        let nothing = Reflected::default();
        let light = &self.scene.lights()[index];
        let Shaded { at, hit, directions, medium, .. } = *receiver;
        let shading = directions.shading;
        let Some(sample) = light.sample_li(at, u) else {
            return nothing;
        };
        let (wo, wi) = (shading.wo_local, shading.frame.to_local(sample.wi));
        let side = sample.wi.dot(shading.geometric) * hit.wo.dot(shading.geometric);
        let transmission = side < 0.0;
        // Where the shading and geometric normals differ, the shading itself decides on which side of the surface the light is.
        if side == 0.0 || shading.bend.is_none() && transmission != (wi.z * wo.z < 0.0) {
            return nothing;
        }
        let arriving = shading.cosine(wi) * sample.radiance_over_pdf / probability;
        let mut found = Reflected {
            diffuse: shading.eval(Lobe::Diffuse, wi) * arriving,
            glossy: shading.eval(Lobe::Glossy, wi) * arriving,
        };
        if found == nothing {
            return nothing;
        }
        let Some(medium) = self.scene.medium_after(medium, hit, shading, sample.wi, transmission) else {
            return nothing;
        };
        // Photons describe only the side on which they arrived.
        let decision = if transmission { None } else { self.decision(receiver, index, scratch) };
        let transmittance = match decision {
            Some(ShadowDecision::Shadow) => None,
            Some(ShadowDecision::Lit) => Some(attenuation(self.scene, &medium, sample.distance)),
            Some(ShadowDecision::Mixed | ShadowDecision::TooFew) | None => {
                scratch.counters.shadow_rays += 1;
                transmittance(self.scene, hit, &sample, &medium)
            }
        };
        let Some(transmittance) = transmittance else { return nothing };
        found.diffuse *= transmittance;
        found.glossy *= transmittance;
        if !light.is_delta() {
            if self.bsdf_sampling && found.diffuse != Rgb::ZERO {
                let other = receiver.directions.pdf_diffuse(wi);
                found.diffuse *= power_heuristic(sample.pdf_solid_angle * probability, other);
            }
            if found.glossy != Rgb::ZERO {
                let other = shading.pdf_solid_angle(Lobe::Glossy, wi);
                found.glossy *= power_heuristic(sample.pdf_solid_angle * probability, other);
            }
        }
        found
    }

    /// Decision of a light's shadow photons at the receiver, made once for all rays; also counts the ray that depends on it.
    #[inline]
    fn decision(
        &self,
        receiver: &mut Shaded<'_>,
        light: usize,
        scratch: &mut Scratch,
    ) -> Option<ShadowDecision> {
        let shadows = self.shadows?;
        let counters = &mut scratch.shadows;
        if counters.len() <= light {
            counters.resize(self.scene.lights().len(), ShadowCounters::default());
        }
        let decision = match receiver.decided {
            Some((decided, decision)) if decided == light => decision,
            _ => {
                let decision = shadows.decide(light as LightId, receiver.hit, &mut scratch.photons);
                receiver.decided = Some((light, decision));
                scratch.shadows[light].decide(decision);
                decision
            }
        };
        scratch.shadows[light].ray(decision);
        decision
    }
}

/// A point in a medium, as lights use it.
fn in_medium(position: Vec3) -> Receiver {
    Receiver { position, normal: Vec3::ZERO }
}

/// Decisions of shadow photons about one light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ShadowCounters {
    /// Points at which the light is fully visible.
    pub lit: u64,
    /// Points at which the light is fully hidden.
    pub shadow: u64,
    /// Points at which direct and shadow photons are mixed.
    pub mixed: u64,
    /// Points with too few photons around for a decision.
    pub too_few: u64,
    /// Shadow rays that were saved.
    pub rays_saved: u64,
    /// Shadow rays that were traced.
    pub rays_traced: u64,
}

impl ShadowCounters {
    fn decide(&mut self, decision: Option<ShadowDecision>) {
        match decision {
            Some(ShadowDecision::Lit) => self.lit += 1,
            Some(ShadowDecision::Shadow) => self.shadow += 1,
            Some(ShadowDecision::Mixed) => self.mixed += 1,
            Some(ShadowDecision::TooFew) => self.too_few += 1,
            None => {}
        }
    }

    fn ray(&mut self, decision: Option<ShadowDecision>) {
        match decision {
            Some(ShadowDecision::Lit | ShadowDecision::Shadow) => self.rays_saved += 1,
            Some(ShadowDecision::Mixed | ShadowDecision::TooFew) | None => self.rays_traced += 1,
        }
    }
}

impl AddAssign for ShadowCounters {
    fn add_assign(&mut self, other: Self) {
        self.lit += other.lit;
        self.shadow += other.shadow;
        self.mixed += other.mixed;
        self.too_few += other.too_few;
        self.rays_saved += other.rays_saved;
        self.rays_traced += other.rays_traced;
    }
}
