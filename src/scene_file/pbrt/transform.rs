//! Transforms of directives.

use super::error::{Fault, Place, fail};
use crate::math::unit_f64;
use glam::{DAffine3, DMat3, DVec3};

/// From the world to a camera at the first point that looks at the second, with the third pointing up: x to the right of the
/// picture, y up, z to the target.
pub(super) fn inverse_look_at([eye, target, up]: [DVec3; 3], place: &Place) -> Result<DAffine3, Fault> {
    let Some(forward) = unit_f64(target - eye) else {
        return fail(place, "LookAt from a point to the same point", "move one of them");
    };
    let right = unit_f64(up).and_then(|up| unit_f64(up.cross(forward)));
    let Some(right) = right.filter(|_| unit_f64(up).is_some_and(|up| up.cross(forward).length() > 1e-9))
    else {
        return fail(place, "the upward direction of LookAt is parallel to the view", "choose another");
    };
    let to_world = DMat3::from_cols(right, forward.cross(right), forward);
    Ok(DAffine3::from_mat3_translation(to_world, eye).inverse())
}

/// A matrix, column after column.
pub(super) fn matrix(m: [f64; 16], place: &Place) -> Result<DAffine3, Fault> {
    let scale = m[15];
    if [m[3], m[7], m[11]] != [0.0; 3] || scale == 0.0 {
        return fail(
            place,
            "the last row of the matrix (its numbers 4, 8, 12 and 16) is not 0 0 0 1",
            "projections are not modelled: write a matrix without",
        );
    }
    let column = |i: usize| DVec3::new(m[i], m[i + 1], m[i + 2]) / scale;
    let linear = DMat3::from_cols(column(0), column(4), column(8));
    Ok(DAffine3::from_mat3_translation(linear, column(12)))
}

/// Refuses a transform without an inverse.
pub(super) fn check(transform: &DAffine3, place: &Place) -> Result<(), Fault> {
    let determinant = transform.matrix3.determinant();
    if determinant != 0.0 && determinant.is_finite() {
        return Ok(());
    }
    fail(place, "the transform flattens everything", "give it a scale that is not zero")
}
