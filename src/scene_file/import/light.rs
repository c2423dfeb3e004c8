//! Directions and cones of lights.

use crate::math::unit_f64;
use glam::{DMat3, DVec3};

/// Orthonormal axes, possibly mirrored, and whether the matrix differs from them by more than a uniform scale. `None` for a
/// singular matrix.
pub(crate) fn axes_of(matrix: DMat3) -> Option<(DMat3, bool)> {
    const TOLERANCE: f64 = 1e-4;
    let y = unit_f64(matrix.y_axis)?;
    let z = unit_f64(matrix.z_axis - y * y.dot(matrix.z_axis))?;
    let x = y.cross(z) * matrix.determinant().signum();
    let axes = DMat3::from_cols(x, y, z);
    let scale = matrix.y_axis.length();
    let differs = (matrix - axes * scale).to_cols_array().iter().any(|d| d.abs() > TOLERANCE * scale);
    axes.is_finite().then_some((axes, differs))
}

/// The rotation about y, counter-clockwise as seen from above, that these axes represent; `None` where they represent another
/// rotation.
pub(crate) fn turn_of(axes: &DMat3) -> Option<f64> {
    const TOLERANCE: f64 = 1e-9;
    let is_upright = (axes.y_axis - DVec3::Y).abs().max_element() < TOLERANCE && axes.determinant() > 0.0;
    is_upright.then(|| axes.z_axis.x.atan2(axes.z_axis.z))
}

/// The angle up to which the intensity is constant. It is chosen so that a cone whose edge falls off with the square of the
/// cosine has the flux of a cone that falls off linearly in the angle from `beam` to `cutoff` (radians).
pub(crate) fn inner_angle(beam: f64, cutoff: f64) -> f64 {
    let width = cutoff - beam;
    let flux = if width > 1e-9 {
        1.0 - (cutoff.sin() - beam.sin()) / width
    } else {
        2.0 * (0.5 * cutoff).sin().powi(2)
    };
    inner_angle_of_flux(flux, cutoff)
}

/// The angle up to which the intensity is constant, so that a cone whose edge falls off with the square of the cosine up to
/// `cutoff` (radians) has this flux, divided by 2 pi, for an intensity of one.
pub(crate) fn inner_angle_of_flux(flux: f64, cutoff: f64) -> f64 {
    let outer = 2.0 * (0.5 * cutoff).sin().powi(2);
    // Full intensity up to x = 1 - cos, and a third of the rest.
    let full = (0.5 * (3.0 * flux - outer)).clamp(0.0, outer);
    (1.0 - full).clamp(-1.0, 1.0).acos().clamp(0.0, cutoff)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_around_y_are_turns() {
        for angle in [0.3, -2.0, 3.0] {
            let (axes, differs) = axes_of(DMat3::from_rotation_y(angle) * 2.0).unwrap();
            assert!(!differs && (turn_of(&axes).unwrap() - angle).abs() < 1e-12);
        }
        let (tilted, _) = axes_of(DMat3::from_rotation_x(1.0)).unwrap();
        assert!(turn_of(&tilted).is_none());
        let (mirrored, differs) = axes_of(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))).unwrap();
        assert!(mirrored.determinant() < 0.0 && turn_of(&mirrored).is_none() && !differs);
        assert!(axes_of(DMat3::ZERO).is_none());
    }
}
