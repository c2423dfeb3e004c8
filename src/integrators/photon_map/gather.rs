//! The fourth integral by final gathering: rays that read what the photons brought to where they land.

use super::lookup::reflected;
use super::{PhotonMapIntegrator, Vertex};
use crate::bsdf::{Bsdf, TransportMode};
use crate::integrators::Scratch;
use crate::integrators::direct::power_heuristic;
use crate::integrators::specular::chain_roulette;
use crate::lights::Light;
use crate::math::{Ray, Rgb};
use crate::media::MediumId;
use crate::sampling::SampleStream;
use crate::scene::{Shading, SurfaceInteraction};
use std::f32::consts::FRAC_1_PI;

/// What a gather ray brought.
#[derive(Clone, Copy, Debug, Default)]
struct Gathered {
    indirect: Rgb,
    direct: Rgb,
}

impl PhotonMapIntegrator<'_> {
    /// Fourth integral: light that was reflected diffusely before, gathered by rays that read the global map.
    pub(super) fn indirect(
        &self,
        vertex: &Vertex<'_>,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> (Rgb, Rgb) {
        let (mut indirect, mut direct) = (Rgb::ZERO, Rgb::ZERO);
        if self.maps.global.is_none() && !self.bsdf_sampling {
            return (indirect, direct);
        }
        let count = ((self.settings.gather_samples as f32 * vertex.share).ceil() as u32).max(1);
        let splits = samples.splits(self.settings.gather_samples);
        for i in 0..count {
            let [x, y, u_lobe, u_path] = splits.get_4d(i);
            let Some(sample) = vertex.shading.bsdf.sample(
                vertex.shading.wo_local,
                u_lobe,
                glam::Vec2::new(x, y),
                TransportMode::Radiance,
            ) else {
                continue;
            };
            let direction = vertex.shading.frame.to_world(sample.wi);
            let Some(medium) = self.scene.medium_after(
                vertex.medium,
                vertex.hit,
                vertex.shading,
                direction,
                sample.transmission,
            ) else {
                continue;
            };
            scratch.counters.gather_rays += 1;
            let ray = vertex.hit.spawn(direction);
            let found = self.gather(vertex, ray, medium, sample.pdf_solid_angle, u_path, scratch);
            indirect += sample.throughput * found.indirect;
            direct += sample.throughput * found.direct;
        }
        (indirect / count as f32, direct / count as f32)
    }

    /// Radiance that arrives along a gather ray.
    fn gather(
        &self,
        vertex: &Vertex<'_>,
        mut ray: Ray,
        mut medium: MediumId,
        pdf: f32,
        mut u: f32,
        scratch: &mut Scratch,
    ) -> Gathered {
        let mut throughput = Rgb::ONE;
        let mut found = Gathered::default();
        for depth in 0..self.settings.max_depth {
            scratch.counters.depth_sum += 1;
            let Some(hit) = self.scene.intersect(&ray) else {
                if depth == 0 && self.bsdf_sampling {
                    found.direct = self.environment_by_bsdf(pdf);
                }
                return found;
            };
            throughput *= self.transmittance(medium, hit.distance);
            if depth == 0 && self.bsdf_sampling {
                found.direct = throughput * self.emitted_by_bsdf(vertex, &hit, pdf);
            }
            let shading = hit.shading(self.scene.material(&hit));
            if !shading.bsdf.is_delta() {
                found.indirect = throughput * self.approximate(&hit, &shading, scratch);
                return found;
            }
            // A specular surface on the way: one of its directions, drawn by the Fresnel term. One number serves the
            // whole chain: what a decision leaves of it is uniform again.
            let Some(weight) = chain_roulette(depth, || refreshed(u, depth)) else { return found };
            let probability = shading.bsdf.reflection_probability(shading.wo_local);
            let Some(sample) =
                shading.bsdf.sample(shading.wo_local, u, glam::Vec2::ZERO, TransportMode::Radiance)
            else {
                return found;
            };
            u = if u < probability { u / probability } else { (u - probability) / (1.0 - probability) };
            u = u.clamp(0.0, crate::sampling::ONE_MINUS_EPSILON);
            throughput *= weight;
            let direction = shading.frame.to_world(sample.wi);
            let Some(next) = self.scene.medium_after(medium, &hit, &shading, direction, sample.transmission)
            else {
                return found;
            };
            medium = next;
            throughput *= sample.throughput;
            ray = hit.spawn(direction);
        }
        scratch.counters.truncated += 1;
        found
    }

    /// Radiance of a diffuse surface read from the global map.
    fn approximate(&self, hit: &SurfaceInteraction, shading: &Shading, scratch: &mut Scratch) -> Rgb {
        let Some(map) = &self.maps.global else { return Rgb::ZERO };
        if !shading.bsdf.has_diffuse() {
            return Rgb::ZERO;
        }
        scratch.counters.global_lookups += 1;
        if let (Some(irradiance), Bsdf::Lambert(lambert)) = (&self.maps.irradiance, shading.bsdf) {
            let found = irradiance.nearest(hit.point.position, hit.facing_normal(), self.settings.max_radius);
            return match found {
                Some(irradiance) => lambert.reflectance * irradiance * FRAC_1_PI,
                None => {
                    scratch.counters.empty_lookups += 1;
                    Rgb::ZERO
                }
            };
        }
        let query = self.settings.global_query(hit.point.position, hit.facing_normal());
        reflected(self.scene, &self.settings, (map, &query, &self.settings.global), shading, scratch)
    }

    /// Light of an emitter that a gather ray hit by chance, weighted against light sampling.
    fn emitted_by_bsdf(&self, vertex: &Vertex<'_>, hit: &SurfaceInteraction, pdf: f32) -> Rgb {
        let Some(id) = self.scene.surface(hit).light else { return Rgb::ZERO };
        let Light::Area(area) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        let from = vertex.hit.point.position;
        let other = area.pdf_solid_angle(from, hit.primitive, hit.point.position)
            * self.direct.choice_probability(id);
        area.emitted(hit.is_front()) * power_heuristic(pdf, other)
    }

    fn environment_by_bsdf(&self, pdf: f32) -> Rgb {
        let Some(id) = self.scene.environment() else { return Rgb::ZERO };
        let Light::Environment(environment) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        let other = self.direct.choice_probability(id) / (4.0 * std::f32::consts::PI);
        environment.radiance * power_heuristic(pdf, other)
    }
}

/// Another number for a deep surface of a chain whose own number is used up: a hash of it, the same in every run.
fn refreshed(u: f32, depth: u32) -> f32 {
    (crate::sampling::mix(u64::from(u.to_bits()) << 32 | u64::from(depth)) >> 40) as f32 / 16_777_216.0
}
