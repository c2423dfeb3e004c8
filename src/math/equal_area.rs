//! Equal-area mapping between the unit square and directions.

use glam::DVec3;
use std::f64::consts::{FRAC_2_PI, FRAC_PI_4};

/// The unit direction of a point of the unit square: an octahedron with +z in the middle and -z in the corners, whose mapping keeps
/// areas (Clarberg, "Fast Equal-Area Mapping of the (Hemi)Sphere Using SIMD", JGT 13(3), 2008).
pub fn equal_area_direction(s: f64, t: f64) -> DVec3 {
    let (u, v) = (2.0 * s - 1.0, 2.0 * t - 1.0);
    // Distance to the edge of the upper hemisphere, which is negative outside.
    let inside = 1.0 - (u.abs() + v.abs());
    let radius = 1.0 - inside.abs();
    let turn = if radius > 0.0 { (v.abs() - u.abs()) / radius + 1.0 } else { 1.0 };
    let (sin, cos) = (turn * FRAC_PI_4).sin_cos();
    let z = (1.0 - radius * radius).copysign(inside);
    let across = radius * (2.0 - radius * radius).max(0.0).sqrt();
    DVec3::new(cos.copysign(u) * across, sin.copysign(v) * across, z)
}

/// The point of the unit square for a unit direction, the inverse of [`equal_area_direction`].
pub fn equal_area_square(direction: DVec3) -> [f64; 2] {
    let d = direction.abs();
    let radius = (1.0 - d.z).max(0.0).sqrt();
    let turn = d.y.atan2(d.x) * FRAC_2_PI;
    let (mut u, mut v) = (radius * (1.0 - turn), radius * turn);
    if direction.z < 0.0 {
        (u, v) = (1.0 - v, 1.0 - u);
    }
    let half = |x: f64, sign: f64| (0.5 * (x.copysign(sign) + 1.0)).clamp(0.0, 1.0);
    [half(u, direction.x), half(v, direction.y)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_are_where_they_should_be() {
        for (direction, square) in [
            (DVec3::Z, [0.5, 0.5]),
            (DVec3::X, [1.0, 0.5]),
            (DVec3::NEG_X, [0.0, 0.5]),
            (DVec3::Y, [0.5, 1.0]),
            (DVec3::NEG_Y, [0.5, 0.0]),
        ] {
            let at = equal_area_square(direction);
            assert!((at[0] - square[0]).abs() + (at[1] - square[1]).abs() < 1e-12, "{direction} {at:?}");
        }
        assert!((equal_area_direction(1.0, 1.0) - DVec3::NEG_Z).length() < 1e-12);
    }

    /// Both functions are inverse, directions are of unit length, and equal squares have equal solid angles: the mean of a polynomial
    /// over the square is that over the sphere.
    #[test]
    fn areas_are_kept() {
        const SIDE: usize = 200;
        let (mut squares, mut mixed) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..SIDE * SIDE {
            let [s, t] = [i % SIDE, i / SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64);
            let d = equal_area_direction(s, t);
            assert!((d.length() - 1.0).abs() < 1e-12);
            let back = equal_area_square(d);
            assert!((back[0] - s).abs() + (back[1] - t).abs() < 1e-9, "{s} {t} {back:?}");
            squares += d * d;
            mixed += d + DVec3::new(d.y * d.z, d.z * d.x, d.x * d.y);
        }
        let count = (SIDE * SIDE) as f64;
        assert!(
            (squares / count - DVec3::splat(1.0 / 3.0)).abs().max_element() < 1e-4,
            "{}",
            squares / count
        );
        assert!((mixed / count).abs().max_element() < 1e-9);
    }
}
