use glam::Vec3;

/// A ray `origin + t * direction` for `t` in `(0, t_max]`.
///
/// The direction need not have unit length: shadow rays span the segment to the light with `t_max = 1`.
/// There is no `t_min`: an origin is moved off its surface by that hit's own error bound instead
/// ([`crate::scene::SurfaceInteraction::spawn`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start of the ray, render space.
    pub origin: Vec3,
    /// Direction, any non-zero length.
    pub direction: Vec3,
    /// Largest accepted parameter.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_max: f32::INFINITY }
    }

    /// The segment from `origin` to `target`, both excluded by less than rounding.
    pub fn segment(origin: Vec3, target: Vec3) -> Self {
        Self { origin, direction: target - origin, t_max: 1.0 }
    }

    /// The point at parameter `t`, in plain `f32`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}
