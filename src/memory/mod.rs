//! Memory: the estimate for a render, the memory of the machine, and the refusal of renders that do not fit. Each room fills in
//! its own part of the estimate: `scene_file` meshes, lights and textures, `render` photon maps.
//!
//! This room depends on no other.

mod error;
mod estimate;
mod system;

pub(crate) use error::MOST_PHOTONS;
pub use error::MemoryError;
pub use estimate::MemoryEstimate;
pub(crate) use estimate::{FILM, INSTANCE, LIGHT, megabytes};
pub use system::{Resident, allowed_memory};
pub(crate) use system::{available_memory, resident_memory};
