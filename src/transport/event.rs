//! The event that ends a ray.

use super::media::Collision;
use super::visibility::attenuation_of;
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::scene::{Scene, SurfaceInteraction};

/// End of a ray.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// The ray meets a surface.
    Surface(Arrival),
    /// A medium scatters the light; only in scenes with scattering media ([`super::next_event_in_media`]).
    Medium(Collision<'a>),
    /// The ray leaves the scene.
    Escape,
}

/// A ray that arrived at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// The surface. Its distance is that of the whole path from the start of the ray, across null interfaces.
    pub hit: SurfaceInteraction,
    /// Whether the ray passed null interfaces, where one medium fills both sides. Shadow rays end there, so light
    /// sampling does not compete with such a ray.
    pub passed_null_interface: bool,
    /// Transmittance of the medium on the way, for radiance or the power of a photon; `None` where the medium is clear.
    pub transmittance: Option<Rgb>,
}

impl Arrival {
    /// Multiplies a throughput by the transmittance of the medium.
    #[inline]
    pub fn attenuate(&self, throughput: &mut Rgb) {
        if let Some(transmittance) = self.transmittance {
            *throughput *= transmittance;
        }
    }
}

/// The event that ends a ray of unit direction which starts within the bodies of `medium`. On return, `medium` is the
/// stack in which the ray arrives.
#[inline]
pub fn next_event(scene: &Scene, ray: &Ray, medium: &mut MediumStack) -> Event<'static> {
    debug_assert!(!scene.scatters(), "media that scatter end rays as well");
    let Some((hit, passed_null_interface)) = scene.intersect_within(ray, medium) else {
        return Event::Escape;
    };
    let transmittance = attenuation_of(scene.medium(medium.medium()), hit.distance);
    Event::Surface(Arrival { hit, passed_null_interface, transmittance })
}
