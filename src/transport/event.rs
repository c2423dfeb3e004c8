//! The event in which a ray ends.

use super::media::Collision;
use super::visibility::attenuation_of;
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::scene::{Scene, SurfaceInteraction};

/// Where a ray ends.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// At a surface.
    Surface(Arrival),
    /// Where a medium scatters it; only in scenes whose media scatter ([`super::next_event_in_media`]).
    Medium(Collision<'a>),
    /// Nowhere: it leaves the scene.
    Escape,
}

/// A ray that arrived at a surface.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// The surface. Its distance is that of the whole way, null interfaces included.
    pub hit: SurfaceInteraction,
    /// Whether null interfaces were passed on the way: borders of bodies that another body fills. Shadow rays end there, so light
    /// sampling does not compete with such a ray.
    pub passed_null_interface: bool,
    /// Share of the radiance, or of a photon's power, that the medium left on the way; `None` where it is clear.
    pub transmittance: Option<Rgb>,
}

impl Arrival {
    /// Takes from a throughput what the medium absorbed on the way.
    #[inline]
    pub fn attenuate(&self, throughput: &mut Rgb) {
        if let Some(transmittance) = self.transmittance {
            *throughput *= transmittance;
        }
    }
}

/// The event in which a ray of unit direction ends that starts within the bodies of `medium`, which is then what the ray arrives in.
#[inline]
pub fn next_event(scene: &Scene, ray: &Ray, medium: &mut MediumStack) -> Event<'static> {
    debug_assert!(!scene.scatters(), "media that scatter end rays as well");
    let Some((hit, passed_null_interface)) = scene.intersect_within(ray, medium) else {
        return Event::Escape;
    };
    let transmittance = attenuation_of(scene.medium(medium.medium()), hit.distance);
    Event::Surface(Arrival { hit, passed_null_interface, transmittance })
}
