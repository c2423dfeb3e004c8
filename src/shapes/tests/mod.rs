//! Tests of shapes, and their random numbers.

mod double_double;
mod intersection;
mod objects;
mod sampling;

use crate::sampling::Rng;
use glam::DVec3;
use std::f64::consts::TAU;

/// A unit vector, uniform over the sphere.
fn random_direction(rng: &mut Rng) -> DVec3 {
    let z = 2.0 * rng.next_f64() - 1.0;
    let (s, c) = (TAU * rng.next_f64()).sin_cos();
    let sin = (1.0 - z * z).sqrt();
    DVec3::new(sin * c, sin * s, z)
}

/// A point of the cube `[-1, 1]^3`.
fn random_point(rng: &mut Rng) -> DVec3 {
    2.0 * DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) - 1.0
}

/// `10^x` with `x` uniform.
fn random_magnitude(rng: &mut Rng, low: f64, high: f64) -> f64 {
    10f64.powf(low + (high - low) * rng.next_f64())
}
