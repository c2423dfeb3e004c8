//! Bounds on positions and normals of sampled parts of a shape.

use super::{AreaSample, EmitterShape};
use crate::math::unit_f64;
use glam::{DVec3, Vec2};
use std::f64::consts::PI;

/// A bound on the part of a surface to which a rectangle of the unit square is mapped. Its points lie within `radius` of `center`, and its
/// normals within the angle `spread` (radians) of `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Centre of the bounding sphere of positions.
    pub center: DVec3,
    /// Its radius.
    pub radius: f64,
    /// Unit axis of the cone of normals.
    pub axis: DVec3,
    /// Half angle of that cone; `pi` for all directions.
    pub spread: f64,
}

/// Factor on exact bounds that allows for rounding.
const SLACK: f64 = 1.0 + 1e-6;

impl Patch {
    /// A patch around the point in the middle.
    pub(super) fn around(middle: &AreaSample, radius: f64, spread: f64) -> Self {
        Self {
            center: middle.position,
            // The sample coordinates in f32 are rounded too.
            radius: radius * SLACK + 1e-7 * middle.position.abs().max_element(),
            axis: middle.normal,
            spread: if spread > 0.0 { (spread * SLACK).min(PI) } else { 0.0 },
        }
    }

    /// A bound on all of `patches`; `None` where there are none.
    pub fn union(patches: &[Self]) -> Option<Self> {
        let first = patches.first()?;
        if patches.len() == 1 {
            return Some(*first);
        }
        let n = patches.len() as f64;
        let center = patches.iter().map(|patch| patch.center).sum::<DVec3>() / n;
        let radius = patches.iter().map(|p| (p.center - center).length() + p.radius).fold(0.0, f64::max);
        // The mean of equal vectors differs from them only by rounding, which the tolerance covers.
        let axis = unit_f64(patches.iter().map(|patch| patch.axis).sum());
        let off = |patch: &Self| axis.map_or(PI, |axis| axis.angle_between(patch.axis) + patch.spread);
        let spread = patches.iter().map(off).fold(0.0, f64::max);
        Some(Self {
            center,
            radius: radius * SLACK,
            axis: axis.unwrap_or(DVec3::Z),
            spread: if spread > 1e-6 { (spread + 1e-6).min(PI) } else { 0.0 },
        })
    }

    /// The same patch with flipped normals.
    pub fn flipped(&self) -> Self {
        Self { axis: -self.axis, ..*self }
    }
}

impl EmitterShape {
    /// A bound on the results of [`Self::sample_area`] for random numbers between `low` and `high`.
    pub fn patch(&self, low: Vec2, high: Vec2) -> Patch {
        let middle = self.sample_area(0.5 * (low + high));
        let half = (0.5 * (high - low)).as_dvec2();
        match self {
            Self::Sphere(sphere) => sphere.patch(low, high),
            Self::Cylinder(cylinder) => cylinder.patch(&middle, half),
            Self::Disc(disc) => disc.patch(&middle, half),
            Self::Quad(quad) => quad.patch(&middle, half),
            Self::Triangle(triangle) => triangle.patch(&middle, half),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};
    use crate::shapes::{Cylinder, Disc, Quad, Sphere, Triangle};

    #[test]
    fn no_sample_leaves_its_patch() {
        let at = DVec3::new(3.0, -2.0, 0.5);
        let edges = (DVec3::new(1.0, 0.2, -0.3), DVec3::new(-0.4, 0.1, 0.7));
        let shapes = [
            EmitterShape::Sphere(Sphere::new(at, 0.7).unwrap()),
            EmitterShape::Cylinder(Cylinder::new(at, at + edges.0, 0.3).unwrap()),
            EmitterShape::Disc(Disc::new(at, edges.1, 0.9).unwrap()),
            EmitterShape::Quad(Quad::new(at, edges.0, edges.1).unwrap()),
            EmitterShape::Triangle(Triangle::new(at, at + edges.0, at + edges.1).unwrap()),
        ];
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for shape in shapes {
            for (columns, rows) in [(1, 1), (2, 1), (3, 5), (8, 8)] {
                for cell in 0..columns * rows {
                    let size = Vec2::new(1.0 / columns as f32, 1.0 / rows as f32);
                    let low = Vec2::new((cell % columns) as f32, (cell / columns) as f32) * size;
                    let patch = shape.patch(low, low + size);
                    let mut largest: f64 = 0.0;
                    for i in 0..400 {
                        // Corners and edges often.
                        let u = (rng.next_2d() * 1.4 - 0.2).clamp(Vec2::ZERO, Vec2::ONE);
                        let sample = shape.sample_area(low + u * size);
                        let away = (sample.position - patch.center).length();
                        assert!(away <= patch.radius, "{shape:?} {cell} {i}: {away} beyond {patch:?}");
                        largest = largest.max(away / patch.radius);
                        let angle = sample.normal.angle_between(patch.axis);
                        assert!(angle <= patch.spread + 3e-8, "{shape:?} {cell}: {angle}, {patch:?}");
                    }
                    // And the bound is not idle.
                    assert!(largest > 0.3, "{shape:?} {cell} of {columns}x{rows}: {largest}");
                }
            }
        }
    }

    #[test]
    fn a_union_holds_its_parts() {
        let part = |x: f64, axis: DVec3| Patch { center: DVec3::X * x, radius: 0.1, axis, spread: 0.0 };
        let flat = Patch::union(&[part(0.0, DVec3::Y), part(1.0, DVec3::Y), part(3.0, DVec3::Y)]).unwrap();
        assert!(flat.spread == 0.0 && (flat.center.x - 4.0 / 3.0).abs() < 1e-12);
        assert!((flat.radius - (5.0 / 3.0 + 0.1)).abs() < 1e-5);
        let bent = Patch::union(&[part(0.0, DVec3::Y), part(0.0, DVec3::X)]).unwrap();
        assert!((bent.spread - PI / 4.0).abs() < 1e-5);
        assert_eq!(Patch::union(&[part(0.0, DVec3::Y), part(0.0, DVec3::NEG_Y)]).unwrap().spread, PI);
        assert!(Patch::union(&[]).is_none());
    }
}
