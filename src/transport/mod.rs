//! Operations shared by all random walks through a scene, whether they carry radiance from the camera, importance or
//! photons: the event that ends a ray, emission with its MIS weight, and the transmittance of light samples.
//!
//! This module uses the scene, its lights and media; it contains no photon map and no integrator.

mod clearance;
mod dispersion;
mod emission;
mod event;
mod media;
mod visibility;

pub use clearance::Clearance;
pub use dispersion::{refracted_at, refracted_share};
pub use emission::{MisPartner, emission_along, emitted, escaped, power_heuristic, receiver};
pub use event::{Arrival, Event, next_event};
pub use media::{
    Collision, Passage, Stretch, first_surface, next_event_in_media, surface_through_media,
    transmittance_in_media, walk_in_media,
};
pub use visibility::{attenuation, shadow_ray, transmittance};
