//! Density that is a function of the place, within a box.

use super::cells::Cells;
use super::{Line, Segment};
use crate::math::Bounds3;
use glam::{DAffine3, DVec3, IVec3, UVec3};
use rayon::prelude::*;
use std::fmt::Debug;

/// A density as a function of the place that changes no faster than it says.
///
/// The density is the value of the function, but zero where that is negative, and [`Self::most`] where it is above that. So values below zero
/// tell how far a place is from where there is anything, which makes bounds of empty cells zero.
pub trait DensityField: Debug + Send + Sync {
    /// Value at `p`, finite.
    fn value(&self, p: DVec3) -> f64;

    /// The value at two places differs by no more than this times their distance.
    fn slope(&self) -> f64;

    /// The density is nowhere above this; positive.
    fn most(&self) -> f64 {
        f64::INFINITY
    }
}

/// A function together with the largest slope it has, as a [`DensityField`].
pub struct Smooth<F> {
    /// See [`DensityField::value`].
    pub value: F,
    /// See [`DensityField::slope`].
    pub slope: f64,
}

impl<F> Debug for Smooth<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Smooth").field("slope", &self.slope).finish_non_exhaustive()
    }
}

impl<F: Fn(DVec3) -> f64 + Send + Sync> DensityField for Smooth<F> {
    fn value(&self, p: DVec3) -> f64 {
        (self.value)(p)
    }

    fn slope(&self) -> f64 {
        self.slope
    }
}

/// A [`DensityField`] within a box, with bounds on it for each of many cells. Field and box have a space of their own, which
/// [`Self::placed`] places in that of lines.
#[derive(Debug)]
pub struct BoundedField {
    field: Box<dyn DensityField>,
    /// From the space of lines to that of the field, and back.
    to_own: DAffine3,
    to_lines: DAffine3,
    bounds: Bounds3,
    cells: UVec3,
    /// Cells over a unit of length.
    per_length: DVec3,
    /// Majorant and minorant of each cell, x fastest.
    ranges: Vec<(f32, f32)>,
    majorant: f64,
}

/// Why a field of densities cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// The box has no volume.
    #[error("the box of a density has no volume, or is not finite: it goes from {min} to {max}")]
    Box {
        /// Lower corner.
        min: DVec3,
        /// Upper corner.
        max: DVec3,
    },
    /// Too few or too many cells.
    #[error(
        "a density is to be bounded in {0} cells: there must be one along each axis, and 16 million in all at most"
    )]
    Cells(UVec3),
    /// The slope is no number.
    #[error("the largest slope of a density is {0}: it must be finite and not negative")]
    Slope(f64),
    /// The function has no usable value somewhere.
    #[error("a density is {value} at {at}: it must be finite everywhere in its box")]
    Value {
        /// Where.
        at: DVec3,
        /// What it is there.
        value: f64,
    },
    /// The transform leads nowhere.
    #[error("the transform of a density cannot be inverted, or is not finite")]
    Transform,
}

const MOST_CELLS: u64 = 1 << 24;

/// Samples along each axis of a cell from which its bounds are taken. More make them tighter.
const SAMPLES: u32 = 2;

impl BoundedField {
    /// `field` within `bounds`, bounded in `cells` along each axis: from eight samples in each and the slope. More cells make bounds tighter,
    /// and lines slower to walk; cells in which the density changes by about a third of its largest value are a good size.
    ///
    /// # Errors
    /// Where the box has no volume, the cells are too many, or a sample is not finite.
    pub fn new(
        field: impl DensityField + 'static,
        bounds: Bounds3,
        cells: UVec3,
    ) -> Result<Self, FieldError> {
        let Bounds3 { min, max } = bounds;
        let size = max - min;
        if !(size.is_finite() && min.is_finite() && size.min_element() > 0.0) {
            return Err(FieldError::Box { min, max });
        }
        let count = cells.to_array().iter().try_fold(1u64, |n, &c| n.checked_mul(u64::from(c)));
        let Some(count @ 1..=MOST_CELLS) = count else { return Err(FieldError::Cells(cells)) };
        let slope = field.slope();
        if !(slope >= 0.0 && slope.is_finite()) {
            return Err(FieldError::Slope(slope));
        }
        let step = size / cells.as_dvec3();
        // No place of a cell is farther than this from the nearest sample.
        let reach = slope * (0.5 / f64::from(SAMPLES)) * step.length();
        let row = |row: u32| {
            let (y, z) = (row % cells.y, row / cells.y);
            let cell = |x| {
                let corner = min + step * UVec3::new(x, y, z).as_dvec3();
                bounds_of_cell(&field, corner, step, reach)
            };
            (0..cells.x).map(cell).collect::<Result<Vec<_>, _>>()
        };
        let rows: Vec<_> = (0..cells.y * cells.z).into_par_iter().map(row).collect();
        let mut ranges = Vec::with_capacity(count as usize);
        for row in rows {
            ranges.extend(row?);
        }
        let majorant = ranges.iter().fold(0.0f32, |most, range| most.max(range.0));
        Ok(Self {
            field: Box::new(field),
            to_own: DAffine3::IDENTITY,
            to_lines: DAffine3::IDENTITY,
            bounds,
            cells,
            per_length: cells.as_dvec3() / size,
            ranges,
            majorant: f64::from(majorant),
        })
    }

    /// The same, moved by `by`.
    ///
    /// # Errors
    /// Where the transform cannot be inverted or is not finite.
    pub fn placed(self, by: DAffine3) -> Result<Self, FieldError> {
        let to_lines = by * self.to_lines;
        let to_own = to_lines.inverse();
        if to_lines.is_finite() && to_own.is_finite() {
            Ok(Self { to_own, to_lines, ..self })
        } else {
            Err(FieldError::Transform)
        }
    }

    /// The box outside of which the density is zero, and the transform from its space to that of lines.
    pub fn placed_box(&self) -> (Bounds3, DAffine3) {
        (self.bounds, self.to_lines)
    }

    /// Bytes that the bounds take.
    pub fn memory(&self) -> usize {
        size_of::<Self>() + size_of_val(&self.ranges[..])
    }

    /// Density at `p`, zero outside of the box.
    pub fn at(&self, p: DVec3) -> f64 {
        let p = self.to_own.transform_point3(p);
        if p.cmpge(self.bounds.min).all() && p.cmple(self.bounds.max).all() {
            let value = self.field.value(p);
            if value.is_finite() { value.min(self.field.most()).max(0.0) } else { 0.0 }
        } else {
            0.0
        }
    }

    /// The density is nowhere above this.
    pub fn majorant(&self) -> f64 {
        self.majorant
    }

    /// Length of the diagonal of the box around it, in the space of lines.
    pub fn diagonal(&self) -> f64 {
        2.0 * self.bounds.transformed(&self.to_lines).radius()
    }

    /// Segments of `line` from 0 to `t_max`: one for each cell on its way that is not empty.
    pub fn segments(&self, line: &Line, t_max: f64) -> FieldSegments<'_> {
        let origin = (self.to_own.transform_point3(line.origin()) - self.bounds.min) * self.per_length;
        let direction = self.to_own.transform_vector3(line.direction()) * self.per_length;
        let cells = Cells::new(origin, direction, (0.0, t_max), IVec3::ZERO, self.cells.as_ivec3());
        FieldSegments { field: self, cells }
    }
}

fn bounds_of_cell(
    field: &impl DensityField,
    corner: DVec3,
    step: DVec3,
    reach: f64,
) -> Result<(f32, f32), FieldError> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in 0..SAMPLES * SAMPLES * SAMPLES {
        let place = UVec3::new(i % SAMPLES, i / SAMPLES % SAMPLES, i / (SAMPLES * SAMPLES)).as_dvec3();
        let at = corner + step * ((place + 0.5) / f64::from(SAMPLES));
        let value = field.value(at);
        if !value.is_finite() {
            return Err(FieldError::Value { at, value });
        }
        (low, high) = (low.min(value), high.max(value));
    }
    let [low, high] = [low - reach, high + reach].map(|bound| bound.min(field.most()).max(0.0));
    // Outward, so that bounds stay bounds.
    let (mut majorant, mut minorant) = (high as f32, low as f32);
    if f64::from(majorant) < high {
        majorant = majorant.next_up();
    }
    if f64::from(minorant) > low {
        minorant = minorant.next_down();
    }
    Ok((majorant, minorant.max(0.0)))
}

/// Segments of a line through a [`BoundedField`].
#[derive(Clone, Debug)]
pub struct FieldSegments<'a> {
    field: &'a BoundedField,
    cells: Cells,
}

impl Iterator for FieldSegments<'_> {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        for (cell, t0, t1) in self.cells.by_ref() {
            let [x, y, z] = cell.to_array().map(|c| c as usize);
            let at = (z * self.field.cells.y as usize + y) * self.field.cells.x as usize + x;
            let (majorant, minorant) = self.field.ranges[at];
            if majorant > 0.0 {
                return Some(Segment {
                    t0,
                    t1,
                    majorant: f64::from(majorant),
                    minorant: f64::from(minorant),
                });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::Density;
    use crate::media::density::test_lines::{check_segments, random_point};
    use crate::sampling::{Rng, Stream};
    use std::sync::Arc;

    fn unit_box() -> Bounds3 {
        Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE }
    }

    #[test]
    fn bounds_hold_along_any_line() {
        let cone = Smooth { value: |p: DVec3| 1.0 - p.length(), slope: 1.0 };
        let field = BoundedField::new(cone, unit_box(), UVec3::new(16, 9, 21)).unwrap();
        assert!((1.0..1.1).contains(&field.majorant()) && (field.diagonal() - 12f64.sqrt()).abs() < 1e-12);
        let density = Density::Field(Arc::new(field));
        let mut rng = Rng::new(1, Stream::Measure, 33);
        let mut segments = 0;
        for _ in 0..2000 {
            let origin = random_point(&mut rng, DVec3::splat(-3.0), DVec3::splat(3.0));
            let target = random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE);
            let line = Line::new(origin, target - origin).unwrap();
            segments += check_segments(&density, &line, 8.0 * rng.next_f64(), &mut rng);
        }
        assert!(segments > 8000, "{segments}");
        // Corners of the box, where the cone is not, are skipped.
        let edge = Line::new(DVec3::new(-2.0, 0.97, 0.97), DVec3::X).unwrap();
        assert_eq!(density.segments(&edge, 9.0, 0.0).count(), 0);
    }

    #[test]
    fn bounds_hold_wherever_a_field_is_placed() {
        let cone = Smooth { value: |p: DVec3| 1.0 - p.length(), slope: 1.0 };
        let by = DAffine3::from_scale_rotation_translation(
            DVec3::new(2.0, -0.5, 3.0),
            glam::DQuat::from_rotation_z(0.7),
            DVec3::new(5.0, 6.0, 7.0),
        );
        let field = BoundedField::new(cone, unit_box(), UVec3::splat(8)).unwrap().placed(by).unwrap();
        let p = DVec3::new(0.1, -0.4, 0.2);
        assert!((field.at(by.transform_point3(p)) - (1.0 - p.length())).abs() < 1e-12);
        let density = Density::Field(Arc::new(field));
        let mut rng = Rng::new(1, Stream::Measure, 38);
        let mut segments = 0;
        for _ in 0..500 {
            let origin = random_point(&mut rng, DVec3::ZERO, DVec3::splat(12.0));
            let target = by.transform_point3(random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE));
            let line = Line::new(origin, target - origin).unwrap();
            segments += check_segments(&density, &line, 30.0 * rng.next_f64(), &mut rng);
        }
        assert!(segments > 1000, "{segments}");
        let cone = Smooth { value: |p: DVec3| 1.0 - p.length(), slope: 1.0 };
        let field = BoundedField::new(cone, unit_box(), UVec3::splat(2)).unwrap();
        let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(matches!(field.placed(flat), Err(FieldError::Transform)));
    }

    #[test]
    fn what_cannot_be_bounded_is_refused() {
        let one = |slope| Smooth { value: |_: DVec3| 1.0, slope };
        let new =
            |slope, bounds, cells| BoundedField::new(one(slope), bounds, cells).map(|field| field.majorant());
        let cells = UVec3::splat(2);
        assert_eq!(new(0.0, unit_box(), cells), Ok(1.0));
        assert!(matches!(new(f64::NAN, unit_box(), cells), Err(FieldError::Slope(_))));
        assert!(matches!(new(0.0, Bounds3::EMPTY, cells), Err(FieldError::Box { .. })));
        let flat = Bounds3 { min: DVec3::ZERO, max: DVec3::new(1.0, 0.0, 1.0) };
        assert!(matches!(new(0.0, flat, cells), Err(FieldError::Box { .. })));
        for bad in [UVec3::new(0, 1, 1), UVec3::splat(1000), UVec3::splat(u32::MAX)] {
            assert!(matches!(new(0.0, unit_box(), bad), Err(FieldError::Cells(_))));
        }
        for value in [f64::NAN, f64::INFINITY] {
            let bad = Smooth { value: move |p: DVec3| if p.x > 0.0 { value } else { 1.0 }, slope: 1.0 };
            assert!(matches!(BoundedField::new(bad, unit_box(), cells), Err(FieldError::Value { .. })));
        }
    }
}
