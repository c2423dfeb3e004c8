//! Emission that a ray meets, and its MIS weight against light sampling.

use super::event::{Event, next_event};
use crate::lights::{Light, LightId, Receiver};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::scene::{Scene, SurfaceInteraction};
use glam::Vec3;

/// The place and density of a ray whose direction was sampled from a smooth lobe, at a place where lights were sampled
/// as well. Emission that the ray meets gets an MIS weight against light sampling.
#[derive(Clone, Copy, Debug)]
pub struct MisPartner {
    /// The place, as a receiver of light.
    pub from: Receiver,
    /// Density of the direction per solid angle.
    pub pdf: f32,
}

impl MisPartner {
    /// MIS weight of emission by the light `id` that the ray meets; `pdf_of_light` is the density per solid angle with
    /// which that light is sampled from a receiver.
    #[inline]
    fn weight(self, scene: &Scene, id: LightId, pdf_of_light: impl FnOnce(Receiver) -> f32) -> f32 {
        let choice = scene.light_choice().probability(&self.from, id);
        power_heuristic(self.pdf, pdf_of_light(self.from) * choice)
    }
}

/// Weight of a sample with density `pdf` against a technique with density `other` (Veach 1997, section 9.2.4).
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if pdf.is_infinite() {
        return 1.0;
    }
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// A hit as a receiver of light. It has a normal only if it does not transmit, so that lights behind it are not
/// sampled.
#[inline]
pub fn receiver(scene: &Scene, hit: &SurfaceInteraction) -> Receiver {
    let transmits = scene.material(hit).medium_on(true).is_some();
    let normal = if transmits { Vec3::ZERO } else { hit.facing_normal() };
    Receiver { position: hit.point.position, normal }
}

/// Radiance that a surface emits towards `hit.wo`, with its MIS weight where the ray has a `partner`, times the
/// `factor` of the light. Zero where the surface emits nothing.
#[inline]
pub fn emitted(
    scene: &Scene,
    hit: &SurfaceInteraction,
    partner: Option<MisPartner>,
    factor: impl FnOnce(LightId) -> f32,
) -> Rgb {
    let Some(id) = scene.surface(hit).light else { return Rgb::ZERO };
    let Light::Area(area) = &scene.lights()[id as usize] else { return Rgb::ZERO };
    let radiance = area.emitted(hit.is_front()) * hit.glow;
    let weighted = match partner {
        Some(partner) => {
            let pdf = |from| area.pdf_solid_angle(from, hit.primitive, hit.point.position);
            radiance * partner.weight(scene, id, pdf)
        }
        None => radiance,
    };
    if weighted == Rgb::ZERO { weighted } else { weighted * factor(id) }
}

/// Radiance from outside the scene along the unit `direction` of a ray that leaves it, weighted as in [`emitted`].
#[inline]
pub fn escaped(
    scene: &Scene,
    direction: Vec3,
    partner: Option<MisPartner>,
    factor: impl Fn(LightId) -> f32,
) -> Rgb {
    scene.outside(direction, |id, pdf| {
        partner.map_or(1.0, |partner| partner.weight(scene, id, |_| pdf())) * factor(id)
    })
}

/// Emission along a ray of unit direction that starts within the bodies of `medium`, without reflected light.
pub fn emission_along(scene: &Scene, ray: &Ray, mut medium: MediumStack) -> Rgb {
    match next_event(scene, ray, &mut medium) {
        Event::Medium(_) => Rgb::ZERO,
        Event::Escape => escaped(scene, ray.direction, None, |_| 1.0),
        Event::Surface(arrival) => {
            let mut emitted = emitted(scene, &arrival.hit, None, |_| 1.0);
            arrival.attenuate(&mut emitted);
            emitted
        }
    }
}
