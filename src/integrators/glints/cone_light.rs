//! Cone lights: small emitters that a mirror or glass shows to a glossy surface.
//!
//! A ray of a glossy lobe continues at a mirror and hits an emitter. What the camera sees is not an image of the emitter but its light
//! spread over the lobe. No shadow ray finds this light and the probability of hitting it is small, so that it appears as white dots.
//! The mirror is therefore treated as less sharp than it is (path-space regularisation: Kaplanyan & Dachsbacher, "Path Space
//! Regularization for Holistic and Robust Light Transport", Eurographics 2013): the light of small emitters is spread over a cone around
//! the mirrored direction and found by shadow rays. A ray represents a cone of directions among the samples of its lobe and pixel; the
//! cone here is as wide as the mirror spreads those directions. Its width vanishes as the number of samples grows, and what a mirror
//! shows sharply by itself is not changed.

use super::finder::{GlintFinder, Lamp};
use crate::bsdf::Lobe;
use crate::integrators::Scratch;
use crate::integrators::specular::Branch;
use crate::lights::LightId;
use crate::math::{Frame, Ray, Rgb};
use crate::sampling::{ONE_MINUS_EPSILON, SampleStream};
use crate::scene::{Shading, SurfaceInteraction};
use crate::transport::{Event, next_event, receiver, transmittance};
use glam::Vec2;
use std::f32::consts::{PI, TAU};

/// Tangent of the largest angle under which an emitter is seen whose light is spread.
const LARGEST_LAMP: f32 = 0.1;

/// Tangent of the angle of the widest cone.
const WIDEST: f32 = 0.5;

/// Ray-cone spread: tangent of the angle of the cone that a ray represents which was sampled with this density per solid angle, as one
/// of `count` rays of the same camera sample. Further camera samples make it narrower ([`GlintFinder::widened`]).
///
/// The solid angle is divided by the root of their count and not by the count itself. Otherwise the cone of each ray would shrink as
/// fast as their number grows, and the noise would not decrease.
pub(in crate::integrators) fn spread_of(pdf: f32, count: u32) -> f32 {
    (1.0 / (PI * pdf * (count as f32).sqrt())).sqrt()
}

impl GlintFinder<'_> {
    /// Radiance that a specular lobe sends back along the ray `before`, of small emitters that shadow rays find in a cone around the
    /// lobe's continuation. `branch` is that continuation, and its [`Branch::throughput`] is included. `camera_samples` is the number of
    /// samples of the pixel.
    pub(in crate::integrators) fn widened(
        &self,
        (before, branch): (&Branch, &Branch),
        (hit, shading): (&SurfaceInteraction, &Shading),
        camera_samples: f32,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Rgb {
        let mut sum = Rgb::ZERO;
        for lamp in &self.lamps {
            let Some((along, across)) =
                lamp.seen_from(&branch.ray).filter(|_| lamp.is_below(&branch.ray, LARGEST_LAMP))
            else {
                continue;
            };
            if !(across.length() < (WIDEST + LARGEST_LAMP) * along) {
                continue;
            }
            // Limits the width where the sampling density is close to zero.
            let spread = (before.spread / camera_samples.max(1.0).powf(0.25)).min(WIDEST);
            let least = spread.max(lamp.radius / along);
            let u = samples.next_2d();
            let width = self.moved_aside((before, branch), (hit, shading), (lamp, along), spread, u.x * TAU);
            let width =
                width.filter(|width| width.is_finite()).unwrap_or(least).clamp(least.min(WIDEST), WIDEST);
            // One minus the cosine, without the rounding error of the cosine of a narrow cone.
            let secant_squared = 1.0 + width * width;
            let versine = width * width / (secant_squared + secant_squared.sqrt());
            let at = receiver(self.scene, hit);
            let Some(light) = self.scene.lights()[lamp.id as usize].sample_li(at, samples.next_2d()) else {
                continue;
            };
            let same_side =
                light.wi.dot(shading.geometric) * branch.ray.direction.dot(shading.geometric) > 0.0;
            if !same_side || light.wi.distance_squared(branch.ray.direction) > 2.0 * versine {
                continue;
            }
            scratch.counters.shadow_rays += 1;
            let Some(transmittance) = transmittance(self.scene, hit, &light, &branch.medium) else {
                continue;
            };
            sum += branch.throughput * transmittance * light.radiance_over_pdf / (TAU * versine);
        }
        sum
    }

    /// Whether [`Self::widened`] has already counted the light of the emitter that its continued ray hits.
    pub(in crate::integrators) fn has_widened(&self, id: LightId, ray: &Ray) -> bool {
        self.lamps.iter().any(|lamp| lamp.id == id && lamp.is_below(ray, LARGEST_LAMP))
    }

    /// Tangent of the angle by which the continued ray moves at the emitter if the ray before it starts in a neighbouring direction.
    /// `None` where that ray does not meet the same surface.
    fn moved_aside(
        &self,
        (before, branch): (&Branch, &Branch),
        (hit, shading): (&SurfaceInteraction, &Shading),
        (lamp, along): (&Lamp, f32),
        spread: f32,
        azimuth: f32,
    ) -> Option<f32> {
        let frame = Frame::from_z(before.ray.direction);
        let beside = frame.to_world((Vec2::from_angle(azimuth) * spread).extend(1.0)).normalize();
        let mut medium = before.medium;
        let ray = Ray { direction: beside, ..before.ray };
        let Event::Surface(arrival) = next_event(self.scene, &ray, &mut medium) else { return None };
        let other = arrival.hit;
        if other.surface != hit.surface {
            return None;
        }
        let transmission =
            branch.ray.direction.dot(shading.geometric) * before.ray.direction.dot(shading.geometric) > 0.0;
        let by = self.scene.shading_within(&other, medium);
        let u = if transmission { ONE_MINUS_EPSILON } else { 0.0 };
        let sample = by.sample_lobe(Lobe::Specular, u, Vec2::ZERO)?;
        if sample.transmission != transmission {
            return None;
        }
        let frame = Frame::from_z(branch.ray.direction);
        let direction = frame.to_local(by.frame.to_world(sample.wi));
        if !(direction.z > 0.0) {
            return Some(WIDEST);
        }
        let slope = direction.truncate() / direction.z;
        if lamp.is_sun {
            return Some(slope.length());
        }
        let origin = frame.to_local(other.point.position - hit.point.position);
        Some((origin.truncate() + slope * (along - origin.z)).length() / along)
    }
}
