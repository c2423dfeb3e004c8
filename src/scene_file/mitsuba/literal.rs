//! Parses numbers, vectors and matrices.

use super::error::{Fault, Place, fail};
use super::spectrum::Spectrum;
use super::text::{number, shown, tokens};
use super::value::Value;
use glam::{DAffine3, DMat3, DVec3};

/// A look-at transform as sensors and emitters use it: x to the left, y up, z to the target.
pub(super) fn look_at(origin: DVec3, target: DVec3, up: DVec3, place: &Place) -> Result<DAffine3, Fault> {
    let Some(forward) = crate::math::unit_f64(target - origin) else {
        return fail(place, "`origin` and `target` are the same point", "move one of them");
    };
    let up = if up == DVec3::ZERO { forward.any_orthonormal_vector() } else { up };
    let Some(left) = crate::math::unit_f64(up.cross(forward)) else {
        return fail(place, "`up` is parallel to the view", "choose another `up`");
    };
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(left, forward.cross(left), forward), origin))
}

pub(super) fn matrix(text: &str, place: &Place) -> Result<DAffine3, Fault> {
    let values: Vec<f64> = tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
    match values.len() {
        16 => {
            let row = |i: usize| DVec3::new(values[4 * i], values[4 * i + 1], values[4 * i + 2]);
            let linear = DMat3::from_cols(row(0), row(1), row(2)).transpose();
            let scale = values[15];
            if values[12..15] != [0.0; 3] || !(scale != 0.0) {
                return fail(
                    place,
                    "the last row of the matrix is not `0 0 0 1`",
                    "projections are not modelled",
                );
            }
            let translation = DVec3::new(values[3], values[7], values[11]);
            Ok(DAffine3::from_mat3_translation(linear * (1.0 / scale), translation / scale))
        }
        9 => {
            let row = |i: usize| DVec3::new(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
            Ok(DAffine3::from_mat3(DMat3::from_cols(row(0), row(1), row(2)).transpose()))
        }
        count => fail(place, format!("a matrix of {count} numbers"), "write 16 numbers, row after row, or 9"),
    }
}

pub(super) fn triple(text: &str, place: &Place) -> Result<DVec3, Fault> {
    let values: Vec<f64> = tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
    match values[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        [x] => Ok(DVec3::splat(x)),
        _ => {
            let message = format!("`{}` is no vector", shown(text));
            fail(place, message, "write three numbers, for example `0, 1, 0`")
        }
    }
}

/// Parses `value`, or `x`, `y` and `z`, which default to `usual`.
pub(super) fn vector(
    [value, x, y, z]: [Option<String>; 4],
    usual: f64,
    place: &Place,
) -> Result<DVec3, Fault> {
    let has_parts = x.is_some() || y.is_some() || z.is_some();
    match value {
        Some(_) if has_parts => fail(place, "both `value` and `x`, `y`, `z`", "leave one of them out"),
        Some(value) => triple(&value, place),
        None => {
            let of = |part: Option<String>| part.map_or(Ok(usual), |part| number(&part, place));
            Ok(DVec3::new(of(x)?, of(y)?, of(z)?))
        }
    }
}

/// The value of an element that holds a single value.
pub(super) fn plain(tag: &str, text: &str, place: &Place) -> Result<Value, Fault> {
    Ok(match tag {
        "float" => Value::Float(number(text, place)?),
        "integer" => match text.trim().parse() {
            Ok(value) => Value::Integer(value),
            Err(_) => {
                return fail(place, format!("`{}` is no whole number", shown(text)), "write for example 64");
            }
        },
        "boolean" => match text.trim().to_ascii_lowercase().as_str() {
            "true" => Value::Boolean(true),
            "false" => Value::Boolean(false),
            _ => {
                return fail(
                    place,
                    format!("`{}` is neither true nor false", shown(text)),
                    "write true or false",
                );
            }
        },
        "string" => Value::Text(text.to_owned()),
        _ => Value::Spectrum(Spectrum::rgb(text, tag == "srgb", place)?),
    })
}
