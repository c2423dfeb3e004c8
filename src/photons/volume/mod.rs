//! Photons in scattering media: beams for caustics and points for light that was scattered before, by medium.
//!
//! Beams carry the light of specular chains over a whole stretch of a medium (Jarosz, Nowrouzezahrai, Sadeghi & Jensen, "A Comprehensive
//! Theory of Volumetric Radiance Estimation Using Photon Points and Beams", 2011); points hold photons that a medium scatters for the second
//! time or more (Jensen & Christensen, "Efficient Simulation of Light Transport in Scenes with Participating Media using Photon Maps", 1998),
//! and are read along whole rays (beam radiance estimate: Jarosz, Zwicker & Jensen 2008). This module uses the media and the scene; it knows
//! no integrator.

mod beams;
mod box_tree;
mod fade;
mod maps;
mod nearest;
mod points;
mod record;
mod thinning;

pub use maps::{MediaLight, MediaMaps, MediaSizes, Reading};
pub(super) use record::MediaRecords;
pub(super) use thinning::Thinning;
