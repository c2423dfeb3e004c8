//! Measurements: error figures of a picture against a reference in linear RGB, caustics in closed form ([`caustics`]), speed of ray
//! tracing ([`bvh`]), cost and benefit of settings ([`tradeoff`]), and validation against known results ([`validate`]).
// The lints make a new variant of a setting a compile error until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

pub mod bvh;
pub mod caustics;
mod error;
mod flip;
pub mod tradeoff;
pub mod validate;

pub use error::{ErrorFigures, MeasureError, Picture, Reference};
pub use flip::{flip_map, mean_flip};
