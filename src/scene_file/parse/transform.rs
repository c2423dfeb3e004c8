//! `transform = [ { scale = 2.0 }, { rotate = 30.0, axis = [0.0, 1.0, 0.0] }, { translate = [..] } ]`.

use crate::math::unit_f64;
use crate::scene_file::reader::{Expected, NUMBER, Table, Value};
use glam::{DAffine3, DMat3, DVec3};

/// Ratio of the volume of the transformed unit cube to the product of its edges, below which a transform counts as flat.
const FLAT: f64 = 1e-12;

/// Largest relative deviation of edges and angles of a similarity: the margin for rounding in a long list of steps.
const SIMILAR: f64 = 1e-9;

const EXAMPLE: &str = "write for example `transform = [{ rotate = 30.0, axis = \"y\" }, \
                       { translate = [0.0, 1.0, 0.0] }]`";

/// Reads a list of steps, which are applied in the order of the list. Lengths stay in the file's unit.
pub(super) fn read_transform(value: Value<'_>) -> Option<DAffine3> {
    if value.is_table() {
        return value.refuse("a list of steps", EXAMPLE);
    }
    let steps: Vec<_> = value.list("a list of steps", "[{ scale = 2.0 }]")?.collect();
    let mut transform = Some(DAffine3::IDENTITY);
    for step in steps {
        let step = read_step(step);
        transform = transform.zip(step).map(|(before, step)| step * before);
    }
    let transform = transform?;
    if is_invertible(&transform) {
        return Some(transform);
    }
    value.refuse(
        "a transform that can be undone",
        "its steps together flatten everything or leave the range of numbers: check scales and matrices",
    )
}

fn is_invertible(transform: &DAffine3) -> bool {
    let matrix = transform.matrix3;
    let lengths = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(largest);
    if !transform.is_finite() || lengths.contains(&0.0) {
        return false;
    }
    // The columns are first scaled to about length 1, so that neither 1e-200 nor 1e200 counts as flat.
    let [x, y, z] = lengths;
    let scaled = DMat3::from_cols(matrix.x_axis / x, matrix.y_axis / y, matrix.z_axis / z);
    scaled.determinant().abs() > FLAT
}

fn largest(v: DVec3) -> f64 {
    v.abs().max_element()
}

/// Whether a transform is a similarity: rotations, reflections, translations and uniform scales.
pub(super) fn is_similarity(transform: &DAffine3) -> bool {
    let columns = transform.matrix3;
    let scale = largest(columns.x_axis).max(largest(columns.y_axis)).max(largest(columns.z_axis));
    let (x, y, z) = (columns.x_axis / scale, columns.y_axis / scale, columns.z_axis / scale);
    let (xx, yy, zz) = (x.length_squared(), y.length_squared(), z.length_squared());
    let tolerance = SIMILAR * xx;
    [xx - yy, xx - zz, x.dot(y), x.dot(z), y.dot(z)].iter().all(|difference| difference.abs() <= tolerance)
}

fn read_step(value: Value<'_>) -> Option<DAffine3> {
    let mut step = value.table("a step of `transform`", EXAMPLE)?;
    let translate = step.get("translate");
    let rotate = step.get("rotate");
    let scale = step.get("scale");
    let matrix = step.get("matrix");
    let transform = match (translate, rotate, scale, matrix) {
        (Some(by), None, None, None) => by.vector(&NUMBER).map(DAffine3::from_translation),
        (None, Some(degrees), None, None) => {
            let degrees = degrees.number(&NUMBER);
            let axis = step.required("axis", "[0.0, 1.0, 0.0]", read_axis);
            degrees.zip(axis).map(|(degrees, axis)| DAffine3::from_mat3(rotation(axis, degrees)))
        }
        (None, None, Some(by), None) => by.numbers(&NOT_ZERO).map(DAffine3::from_scale),
        (None, None, None, Some(rows)) => read_matrix(rows),
        _ => {
            let remedy = "each step is one of `translate`, `rotate` (with `axis`), `scale`, `matrix`";
            return step.refuse("a step of `transform` must do exactly one thing", remedy);
        }
    };
    step.finish();
    transform
}

const NOT_ZERO: Expected =
    Expected { what: "a number other than 0, or three of them", example: "2.0", holds: |x| x != 0.0 };

fn read_axis(value: Value<'_>) -> Option<DVec3> {
    if value.is_string() {
        return value.choice(&[("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)]);
    }
    match unit_f64(value.vector(&NUMBER)?) {
        Some(axis) => Some(axis),
        None => value.refuse("a direction", "give at least one number that is not 0"),
    }
}

/// Rotation by `degrees` about the unit vector `axis`, counter-clockwise as seen from its tip. Quarter turns are exact: sine and
/// cosine of 90 degrees are 1 and 0, which they are not when computed in radians.
fn rotation(axis: DVec3, degrees: f64) -> DMat3 {
    let degrees = degrees.rem_euclid(360.0);
    let quarter = (degrees / 90.0).round();
    let (sine, cosine) = (degrees - 90.0 * quarter).to_radians().sin_cos();
    let (sine, cosine) = match quarter as i32 % 4 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    };
    // Rodrigues' formula, column by column.
    let column = |v: DVec3| v * cosine + axis.cross(v) * sine + axis * (axis.dot(v) * (1.0 - cosine));
    DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
}

/// Reads three or four rows of four numbers, for column vectors; a fourth row must be 0 0 0 1.
fn read_matrix(value: Value<'_>) -> Option<DAffine3> {
    const WHAT: &str = "three rows of four numbers (and perhaps a fourth, 0 0 0 1)";
    const EXAMPLE: &str = "[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]";
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for row in value.list(WHAT, EXAMPLE)? {
        let numbers: Vec<_> = row.list(WHAT, EXAMPLE)?.map(|item| item.number(&NUMBER)).collect();
        rows.push(numbers.into_iter().collect::<Option<_>>()?);
    }
    let is_well_formed = matches!(rows.len(), 3 | 4)
        && rows.iter().all(|row| row.len() == 4)
        && rows.get(3).is_none_or(|last| last.as_slice() == [0.0, 0.0, 0.0, 1.0]);
    if !is_well_formed {
        return value.refuse(WHAT, format!("write for example `{{ matrix = {EXAMPLE} }}`"));
    }
    let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
    Some(DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) })
}

/// Converts a `transform` of coordinates in units of `unit` metres to metres: only lengths change.
pub(super) fn in_metres(transform: DAffine3, unit: f64) -> DAffine3 {
    DAffine3 { translation: transform.translation * unit, ..transform }
}

/// The transform of a shape or an instance; the identity where the table has none.
pub(super) fn transform_of(table: &mut Table<'_>) -> Option<DAffine3> {
    table.or("transform", DAffine3::IDENTITY, read_transform)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        for turns in -8..=8 {
            let matrix = rotation(DVec3::Y, 90.0 * f64::from(turns));
            for entry in matrix.to_cols_array() {
                assert!(entry == 0.0 || entry.abs() == 1.0, "{turns}: {matrix}");
            }
        }
        assert_eq!(rotation(DVec3::Z, 90.0) * DVec3::X, DVec3::Y);
        assert_eq!(rotation(DVec3::Y, 90.0) * DVec3::Z, DVec3::X);
    }

    #[test]
    fn rotations_agree_with_radians() {
        for degrees in [-725.5, -44.9, 0.1, 44.0, 46.0, 133.0, 359.9] {
            let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
            let reference = DMat3::from_axis_angle(axis, f64::to_radians(degrees));
            assert!(rotation(axis, degrees).abs_diff_eq(reference, 1e-14), "{degrees}");
        }
    }

    #[test]
    fn flat_and_similar() {
        assert!(is_invertible(&DAffine3::from_scale(DVec3::new(1e-200, 1e200, 1.0))));
        assert!(!is_invertible(&DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))));
        let sheared = DMat3::from_cols(DVec3::X, DVec3::new(1.0, 1e-14, 0.0), DVec3::Z);
        assert!(!is_invertible(&DAffine3::from_mat3(sheared)));
        let turned = DAffine3::from_mat3(rotation(DVec3::X, 33.0) * -7.5);
        assert!(is_similarity(&turned));
        assert!(!is_similarity(&DAffine3::from_scale(DVec3::new(1.0, 1.001, 1.0))));
    }
}
