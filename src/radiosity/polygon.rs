//! Form factor from a point to a polygon, in closed form.

use arrayvec::ArrayVec;
use glam::DVec3;
use std::f64::consts::PI;

/// Most corners of an outline.
pub(super) const MOST_CORNERS: usize = 16;

/// Share of the cosine-weighted hemisphere above a point that a polygon fills, without occlusion: the form factor from a differential
/// area to the polygon, in `[0, 1]`.
///
/// Lambert's formula: half the sum over the edges of the angle that the edge subtends, times the cosine between `normal` and the normal of
/// the plane through the point and the edge, over pi (Baum, Rushmeier & Winget, "Improving Radiosity Solutions Through the Use of
/// Analytically Determined Form-Factors", 1989). The part of the polygon below the horizon of the point is cut off first. Both sides of the
/// polygon count; the order of the corners does not matter.
pub fn point_to_polygon(position: DVec3, normal: DVec3, outline: &[DVec3]) -> f64 {
    let mut above: ArrayVec<DVec3, { 2 * MOST_CORNERS }> = ArrayVec::new();
    let Some(last) = outline.last() else { return 0.0 };
    let mut from = *last - position;
    let mut height = from.dot(normal);
    for corner in outline {
        let to = *corner - position;
        let next = to.dot(normal);
        if (height > 0.0) != (next > 0.0) && height != next && !above.is_full() {
            above.push(from + (to - from) * (height / (height - next)));
        }
        if next > 0.0 && !above.is_full() {
            above.push(to);
        }
        (from, height) = (to, next);
    }
    let Some(last) = above.last() else { return 0.0 };
    let mut from = *last;
    let mut sum = 0.0;
    for to in &above {
        let cross = from.cross(*to);
        let length = cross.length();
        if length > 0.0 {
            sum += length.atan2(from.dot(*to)) * normal.dot(cross) / length;
        }
        from = *to;
    }
    (0.5 * sum.abs() / PI).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(corner: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
        [corner, corner + u, corner + u + v, corner + v]
    }

    /// The closed form for a rectangle `a` by `b` parallel to a small area, at the distance `c` from one of its corners (Howell, "A Catalog
    /// of Radiation Heat Transfer Configuration Factors", B-3).
    fn parallel_corner(a: f64, b: f64, c: f64) -> f64 {
        let (x, y) = (a / c, b / c);
        let (sx, sy) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        ((x / sx) * (y / sx).atan() + (y / sy) * (x / sy).atan()) / (2.0 * PI)
    }

    /// The same for a rectangle that is perpendicular to the small area (B-4): `a` wide, `b` high, at the distance `c`.
    fn perpendicular_corner(a: f64, b: f64, c: f64) -> f64 {
        let (x, y) = (a / c, b / c);
        let s = (1.0 + y * y).sqrt();
        (x.atan() - (x / s).atan() / s) / (2.0 * PI)
    }

    #[test]
    fn rectangles_seen_from_a_corner() {
        for (a, b, c) in [(1.0, 1.0, 1.0), (0.3, 2.0, 0.5), (10.0, 10.0, 0.1)] {
            let flat = rectangle(DVec3::new(0.0, 0.0, c), DVec3::X * a, DVec3::Y * b);
            let found = point_to_polygon(DVec3::ZERO, DVec3::Z, &flat);
            assert!((found - parallel_corner(a, b, c)).abs() < 1e-12, "{a} {b} {c}: {found}");
            let upright = rectangle(DVec3::new(0.0, c, 0.0), DVec3::X * a, DVec3::Z * b);
            let found = point_to_polygon(DVec3::ZERO, DVec3::Z, &upright);
            assert!((found - perpendicular_corner(a, b, c)).abs() < 1e-12, "{a} {b} {c}: {found}");
            // The part below the horizon adds nothing.
            let sunk = rectangle(DVec3::new(0.0, c, -3.0), DVec3::X * a, DVec3::Z * (b + 3.0));
            assert!((point_to_polygon(DVec3::ZERO, DVec3::Z, &sunk) - found).abs() < 1e-12);
        }
    }

    #[test]
    fn a_box_fills_the_hemisphere() {
        let faces = [
            rectangle(DVec3::new(-1.0, -1.0, 1.0), DVec3::X * 2.0, DVec3::Y * 2.0),
            rectangle(DVec3::new(-1.0, -1.0, -1.0), DVec3::X * 2.0, DVec3::Z * 2.0),
            rectangle(DVec3::new(-1.0, 1.0, -1.0), DVec3::X * 2.0, DVec3::Z * 2.0),
            rectangle(DVec3::new(-1.0, -1.0, -1.0), DVec3::Y * 2.0, DVec3::Z * 2.0),
            rectangle(DVec3::new(1.0, -1.0, -1.0), DVec3::Y * 2.0, DVec3::Z * 2.0),
            rectangle(DVec3::new(-1.0, -1.0, -1.0), DVec3::X * 2.0, DVec3::Y * 2.0),
        ];
        let normal = DVec3::new(0.3, -0.5, 0.8).normalize();
        let sum: f64 =
            faces.iter().map(|face| point_to_polygon(DVec3::new(0.2, 0.4, -0.3), normal, face)).sum();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
    }

    #[test]
    fn degenerate_outlines_give_nothing() {
        assert_eq!(point_to_polygon(DVec3::ZERO, DVec3::Z, &[]), 0.0);
        assert_eq!(point_to_polygon(DVec3::ZERO, DVec3::Z, &[DVec3::Z; 3]), 0.0);
        let coplanar = rectangle(DVec3::new(1.0, 0.0, 0.0), DVec3::X, DVec3::Y);
        assert_eq!(point_to_polygon(DVec3::ZERO, DVec3::Z, &coplanar), 0.0);
    }
}
