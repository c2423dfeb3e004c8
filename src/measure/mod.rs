//! How far a picture is from a reference: error figures over plain linear RGB. Caustics in closed form ([`caustics`]). How fast
//! rays are traced ([`bvh`]), and what settings cost and buy ([`tradeoff`]).

pub mod bvh;
pub mod caustics;
mod error;
mod flip;
pub mod tradeoff;

pub use error::{ErrorFigures, MeasureError, Picture, Reference};
pub use flip::{flip_map, mean_flip};
