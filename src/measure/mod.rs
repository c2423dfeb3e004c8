//! How far a picture is from a reference: error figures over plain linear RGB. Caustics in closed form ([`caustics`]). How fast
//! rays are traced ([`bvh`]), what settings cost and buy ([`tradeoff`]), and whether answers that are known
//! come out ([`validate`]).
// A new choice of a setting does not compile until each match says what it means there.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

pub mod bvh;
pub mod caustics;
mod error;
mod flip;
pub mod tradeoff;
pub mod validate;

pub use error::{ErrorFigures, MeasureError, Picture, Reference};
pub use flip::{flip_map, mean_flip};
