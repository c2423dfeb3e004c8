//! Axis-aligned bounding boxes.

use glam::{DAffine3, DVec3};

/// An axis-aligned box in `f64`. Empty when `min > max` in some axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds3 {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Bounds3 {
    /// The empty box.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around `points`.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |bounds, p| bounds.with_point(p))
    }

    /// Whether the box is empty.
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all())
    }

    /// The box grown to contain `p`.
    pub fn with_point(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box around both boxes.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Centre of the box; zero for an empty one.
    pub fn center(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.min + 0.5 * (self.max - self.min) }
    }

    /// Half the length of the diagonal: radius of the sphere around [`Self::center`]; zero for an empty box.
    pub fn radius(&self) -> f64 {
        if self.is_empty() { 0.0 } else { 0.5 * (self.max - self.min).length() }
    }

    /// Distances from `point` to the nearest and to the farthest point of the box.
    pub fn distances(&self, point: DVec3) -> (f64, f64) {
        let nearest = point.clamp(self.min, self.max);
        let farthest = (point - self.min).abs().max((point - self.max).abs());
        ((point - nearest).length(), farthest.length())
    }

    /// The smallest box around the eight transformed corners.
    pub fn transformed(&self, transform: &DAffine3) -> Self {
        if self.is_empty() {
            return *self;
        }
        Self::of_points((0..8).map(|corner| {
            let pick = |bit: u32, low: f64, high: f64| if corner >> bit & 1 == 0 { low } else { high };
            transform.transform_point3(DVec3::new(
                pick(0, self.min.x, self.max.x),
                pick(1, self.min.y, self.max.y),
                pick(2, self.min.z, self.max.z),
            ))
        }))
    }

    /// Corners in `f32`, rounded outward so that the `f32` box contains this one.
    pub fn to_f32_outward(&self) -> ([f32; 3], [f32; 3]) {
        let down = |x: f64| {
            let y = x as f32;
            if f64::from(y) > x { y.next_down() } else { y }
        };
        let up = |x: f64| {
            let y = x as f32;
            if f64::from(y) < x { y.next_up() } else { y }
        };
        (self.min.to_array().map(down), self.max.to_array().map(up))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outward_rounding_contains() {
        let bounds = Bounds3 { min: DVec3::splat(0.1), max: DVec3::splat(0.3) };
        let (low, high) = bounds.to_f32_outward();
        assert!(f64::from(low[0]) <= 0.1 && f64::from(high[0]) >= 0.3);
        assert!(0.1 - f64::from(low[0]) < 1e-8 && f64::from(high[0]) - 0.3 < 1e-7);
    }

    #[test]
    fn empty_box() {
        assert!(Bounds3::EMPTY.is_empty());
        assert_eq!(Bounds3::EMPTY.radius(), 0.0);
        let p = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(Bounds3::EMPTY.with_point(p).center(), p);
    }
}
