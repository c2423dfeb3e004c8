//! What every walk through a scene has in common, whether it carries radiance from the camera, importance or photons: the event in which
//! a ray ends, the light of an emitter that it meets with its MIS weight, and how much of the light of a source arrives.
//!
//! Uses the scene, its lights and media; knows no photon map and no integrator.

mod emission;
mod event;
mod media;
mod visibility;

pub use emission::{MisPartner, emission_along, emitted, escaped, power_heuristic, receiver};
pub use event::{Arrival, Event, next_event};
pub use media::{Collision, Passage, Stretch, first_surface, next_event_in_media, transmittance_in_media};
pub use visibility::{attenuation, shadow_ray, transmittance};
