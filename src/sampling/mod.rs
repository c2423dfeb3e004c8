//! Random and quasi-random numbers, and the warps that map them to directions and points.
//!
//! A number is a function of (seed, stream, index, dimension) only. Photons and pixels share no state, so the number of threads does not
//! change a picture.

mod distribution;
mod rng;
mod roulette;
mod samples;
mod sobol;
mod sphere_density;
pub mod warp;

pub use distribution::{Distribution1D, Distribution2D};
pub use rng::{Rng, Stream, mix};
pub use roulette::chain_roulette;
pub use samples::{SampleStream, Splits, refined};
pub use sobol::{SOBOL_DIMENSIONS, Sobol, SobolSet};
pub use sphere_density::{Corners, SphereDensity, direction_to_square, square_to_direction};

/// Largest `f32` below one: uniform variates are clamped to it.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;
