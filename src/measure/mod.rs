//! How far a picture is from a reference: error figures over plain linear RGB. Caustics in closed form
//! ([`caustics`]). And how fast rays are traced ([`bvh`]).

pub mod bvh;
pub mod caustics;
mod error;
mod flip;

pub use error::{ErrorFigures, MeasureError, Picture, Reference};
pub use flip::{flip_map, mean_flip};
