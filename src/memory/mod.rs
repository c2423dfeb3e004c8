//! Memory: what a render is foreseen to take, what the machine has, and what is refused. Who knows a part of it fills that part in:
//! `scene_file` meshes, lights and textures, `render` photon maps.
//!
//! This room uses no other.

mod error;
mod estimate;
mod system;

pub(crate) use error::MOST_PHOTONS;
pub use error::MemoryError;
pub use estimate::MemoryEstimate;
pub(crate) use estimate::{FILM, INSTANCE, LIGHT, megabytes};
pub use system::{Resident, allowed_memory};
pub(crate) use system::{available_memory, resident_memory};
