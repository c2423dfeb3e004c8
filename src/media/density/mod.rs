//! Density of a medium along a line: what coefficients are multiplied with at each place.
//!
//! Whatever the density is, a tracker sees it as segments of the line, each with bounds on the density within it (majorant and
//! minorant). Where both are the same the density is that; where nothing is there is no segment. Lengths are those of the space in
//! which lines are given, so coefficients must be per unit of that space.

mod cells;
mod field;
mod grid;
mod grid_builder;
mod height;
mod noise_field;

pub use field::{BoundedField, DensityField, FieldError, FieldSegments, Smooth};
pub use grid::{Grid, GridSegments};
pub use grid_builder::{GridBuilder, GridError, LEAF_SIDE, LEAF_VALUES, Refused};
pub use height::{HeightError, HeightFog, HeightSegments};
pub use noise_field::{Envelope, NoiseField, NoiseFieldError};

use crate::math::{Bounds3, Ray, unit_f64};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A line in `f64`, whose parameter is the distance from its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    origin: DVec3,
    direction: DVec3,
}

/// A part of a line with bounds on the density there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start.
    pub t0: f64,
    /// End, not below the start; infinite only where the density is constant from here on.
    pub t1: f64,
    /// The density is nowhere above this; positive.
    pub majorant: f64,
    /// The density is nowhere below this; not negative.
    pub minorant: f64,
}

/// Density of a medium, without unit: the coefficients of the medium are those where it is one.
#[derive(Clone, Debug, Default)]
pub enum Density {
    /// One everywhere.
    #[default]
    Homogeneous,
    /// One up to a height, and falling exponentially above.
    Height(HeightFog),
    /// A function of the place within a box, zero outside.
    Field(Arc<BoundedField>),
    /// Voxels, between which it is interpolated.
    Grid(Arc<Grid>),
}

/// Why a density cannot be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DensityError {
    /// A fog by height.
    #[error(transparent)]
    Height(#[from] HeightError),
    /// A function in a box.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// Noise.
    #[error(transparent)]
    Noise(#[from] NoiseFieldError),
    /// Voxels.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// Segments of a line through a density, in order; they do not overlap, and the density is zero between them.
#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "lives on the stack of a walk; a box would be an allocation for each ray"
)]
pub enum Segments<'a> {
    /// Of a homogeneous medium: one at most.
    Homogeneous(Option<Segment>),
    /// Of a fog by height.
    Height(HeightSegments),
    /// Of a function.
    Field(FieldSegments<'a>),
    /// Of a grid.
    Grid(GridSegments<'a>),
}

impl Line {
    /// The line from `origin` along `direction`, whose length does not matter; `None` where either is not finite, or the direction
    /// is zero.
    pub fn new(origin: DVec3, direction: DVec3) -> Option<Self> {
        origin.is_finite().then_some(())?;
        Some(Self { origin, direction: unit_f64(direction)? })
    }

    /// The line of a ray, and the distance at which it ends.
    pub fn from_ray(ray: &Ray) -> Option<(Self, f64)> {
        let direction = ray.direction.as_dvec3();
        let line = Self::new(ray.origin.as_dvec3(), direction)?;
        Some((line, f64::from(ray.t_max) * direction.length()))
    }

    /// Start of the line.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Direction, of unit length.
    pub fn direction(&self) -> DVec3 {
        self.direction
    }

    /// The point at distance `t`.
    #[inline]
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

impl Density {
    /// Density at `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        match self {
            Self::Homogeneous => 1.0,
            Self::Height(fog) => fog.at(p),
            Self::Field(field) => field.at(p),
            Self::Grid(grid) => grid.at(p),
        }
    }

    /// Segments of the part of `line` from 0 to `t_max`. Where bounds of a grid are apart by more than `finest` over the length of a segment,
    /// it is divided into one for each voxel that the line passes; infinity keeps them long.
    pub fn segments(&self, line: &Line, t_max: f64, finest: f64) -> Segments<'_> {
        match self {
            Self::Homogeneous => Segments::Homogeneous((t_max > 0.0).then_some(Segment {
                t0: 0.0,
                t1: t_max,
                majorant: 1.0,
                minorant: 1.0,
            })),
            Self::Height(fog) => Segments::Height(fog.segments(line, t_max)),
            Self::Field(field) => Segments::Field(field.segments(line, t_max)),
            Self::Grid(grid) => Segments::Grid(grid.segments(line, t_max, finest)),
        }
    }

    /// The integral of the density over the part of `line` from 0 to `t_max`, where it has a closed form: times an extinction
    /// coefficient, the optical depth.
    pub fn depth(&self, line: &Line, t_max: f64) -> Option<f64> {
        match self {
            Self::Homogeneous => Some(t_max.max(0.0)),
            Self::Height(fog) => Some(fog.depth(line, t_max)),
            Self::Field(_) | Self::Grid(_) => None,
        }
    }

    /// The integral of the density over the part of `line` from 0 to `t_max`: exact, but for functions, of which two values in each cell
    /// are taken.
    pub fn integral(&self, line: &Line, t_max: f64) -> f64 {
        match self {
            Self::Homogeneous => t_max.max(0.0),
            Self::Height(fog) => fog.depth(line, t_max),
            Self::Grid(grid) => grid.integral(line, t_max),
            Self::Field(field) => {
                // Gauss's two points.
                let of = |segment: Segment| {
                    let (middle, half) = (0.5 * (segment.t0 + segment.t1), 0.5 * (segment.t1 - segment.t0));
                    let at = |x: f64| field.at(line.at(middle + half * x));
                    half * (at(-1.0 / 3f64.sqrt()) + at(1.0 / 3f64.sqrt()))
                };
                field.segments(line, t_max).map(of).sum()
            }
        }
    }

    /// The box outside of which the density is zero, and the transform from its space to that of lines; `None` where the density ends
    /// nowhere.
    pub fn placed_box(&self) -> Option<(Bounds3, DAffine3)> {
        match self {
            Self::Homogeneous | Self::Height(_) => None,
            Self::Field(field) => Some(field.placed_box()),
            Self::Grid(grid) => Some(grid.placed_box()),
        }
    }

    /// Largest product of density and length that a line can have, about, where the density ends somewhere: its largest value times
    /// the diagonal of its box.
    pub fn widest_depth(&self) -> Option<f64> {
        match self {
            Self::Homogeneous | Self::Height(_) => None,
            Self::Field(field) => Some(field.majorant() * field.diagonal()),
            Self::Grid(grid) => Some(grid.majorant() * grid.diagonal()),
        }
    }
}

impl Iterator for Segments<'_> {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        match self {
            Self::Homogeneous(segment) => segment.take(),
            Self::Height(segments) => segments.next(),
            Self::Field(segments) => segments.next(),
            Self::Grid(segments) => segments.next(),
        }
    }
}

#[cfg(test)]
pub(in crate::media) mod test_lines {
    use super::*;
    use crate::sampling::Rng;

    /// A point uniformly within the box from `low` to `high`.
    pub(in crate::media) fn random_point(rng: &mut Rng, low: DVec3, high: DVec3) -> DVec3 {
        low + (high - low) * DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64())
    }

    /// Checks that segments are in order, within [0, `t_max`], and bound the density; that it is zero outside of them. Returns how
    /// many there are.
    pub(in crate::media) fn check_segments(
        density: &Density,
        line: &Line,
        t_max: f64,
        rng: &mut Rng,
    ) -> usize {
        let mut end = 0.0;
        let mut count = 0;
        let empty = |from: f64, to: f64, rng: &mut Rng| {
            for _ in 0..3 {
                let t = from + (to - from) * rng.next_f64();
                // Within rounding of a border the density may be what rounding leaves.
                assert!(
                    density.at(line.at(t)) <= 1e-9,
                    "{} in a gap from {from} to {to}",
                    density.at(line.at(t))
                );
            }
        };
        // Sometimes divided.
        let finest = if rng.next_f64() < 0.5 { f64::INFINITY } else { 0.1 * rng.next_f64() };
        for segment in density.segments(line, t_max, finest) {
            assert!(
                segment.t0 >= end && segment.t1 >= segment.t0 && segment.t1 <= t_max,
                "{segment:?} after {end}"
            );
            assert!(
                segment.majorant > 0.0 && segment.minorant >= 0.0 && segment.minorant <= segment.majorant
            );
            if segment.t0 > end {
                empty(end, segment.t0, rng);
            }
            // Not at the ends themselves, where rounding may be on the other side of a border of the density.
            for share in [1e-6, 1.0 - 1e-6, rng.next_f64(), rng.next_f64(), rng.next_f64()] {
                let t = segment.t0 + (segment.t1.min(1e9) - segment.t0) * share;
                let here = density.at(line.at(t));
                let room = 1e-9 * segment.majorant.max(1.0);
                assert!(
                    here <= segment.majorant + room && here >= segment.minorant - room,
                    "{here} at {t} in {segment:?}"
                );
            }
            end = segment.t1;
            count += 1;
        }
        if end < t_max && t_max.is_finite() {
            empty(end, t_max, rng);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn lines_measure_distance() {
        let ray = Ray::segment(Vec3::ZERO, Vec3::new(0.0, 3.0, 4.0));
        let (line, end) = Line::from_ray(&ray).unwrap();
        assert_eq!(end, 5.0);
        assert!((line.at(end) - DVec3::new(0.0, 3.0, 4.0)).length() < 1e-12);
        assert!(Line::new(DVec3::ZERO, DVec3::ZERO).is_none());
        assert!(Line::new(DVec3::NAN, DVec3::X).is_none());
        assert_eq!(Line::from_ray(&Ray::new(Vec3::ZERO, Vec3::X)).unwrap().1, f64::INFINITY);
    }

    #[test]
    fn a_homogeneous_medium_is_one_segment() {
        let line = Line::new(DVec3::ZERO, DVec3::X).unwrap();
        let all: Vec<Segment> = Density::Homogeneous.segments(&line, 3.0, 0.0).collect();
        assert_eq!(all, [Segment { t0: 0.0, t1: 3.0, majorant: 1.0, minorant: 1.0 }]);
        assert_eq!(Density::Homogeneous.depth(&line, 3.0), Some(3.0));
        for nothing in [0.0, -1.0, f64::NAN] {
            assert_eq!(Density::Homogeneous.segments(&line, nothing, 0.0).count(), 0);
        }
    }
}
