//! Rays and segments.

use glam::Vec3;

/// A ray `origin + t * direction` for `t` in `(0, t_max]`.
///
/// The direction need not have unit length: shadow rays span the segment to the light with `t_max = 1`. There is no `t_min`: instead, the
/// origin is moved off its surface by the error bound of that hit
/// ([`crate::scene::SurfaceInteraction::spawn`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start of the ray, in render space.
    pub origin: Vec3,
    /// Direction, of any non-zero length.
    pub direction: Vec3,
    /// Largest accepted parameter.
    pub t_max: f32,
}

impl Ray {
    /// An infinite ray.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// The segment from `origin` to `target`. Only rounding decides whether surfaces at its ends are hit.
    pub fn segment(origin: Vec3, target: Vec3) -> Self {
        Self { origin, direction: target - origin, t_max: 1.0 }
    }

    /// The point at parameter `t`, in plain `f32`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}
