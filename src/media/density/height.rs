//! Fog that lies on the ground and thins out exponentially with height.

use super::{Line, Segment};
use crate::math::unit_f64;
use glam::{DAffine3, DVec3};

/// Density one up to a height, and `exp(-(h - base) / scale)` above.
///
/// Its integral along a line has a closed form, and so has the distance at which the integral reaches a value: nothing needs to be
/// tracked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightFog {
    up: DVec3,
    base: f64,
    scale: f64,
}

/// Why a fog by height cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HeightError {
    /// The direction is no direction.
    #[error("the upward direction of a fog by height is {0}: it must be finite and not zero")]
    Up(DVec3),
    /// The height is not finite.
    #[error("the height up to which a fog is uniform is {0}: it must be finite")]
    Base(f64),
    /// The scale is not positive.
    #[error(
        "the scale height of a fog is {0}: it must be positive and finite (over it the density falls to 37 %)"
    )]
    Scale(f64),
}

/// Scale heights above which there is no segment: the density is 2e-22 there.
const TOP: f64 = 50.0;

/// Scale heights of a segment: over it the density falls to a half.
const STEP: f64 = std::f64::consts::LN_2;

/// A part of a line that lies in the uniform part of the fog, or wholly above it.
#[derive(Clone, Copy, Debug)]
struct Piece {
    t0: f64,
    t1: f64,
    /// Height above the base at `t0`, in scale heights; none in the uniform part.
    height: Option<f64>,
    /// Scale heights that the line rises over a unit of length.
    rise: f64,
}

impl HeightFog {
    /// A fog of density one up to `base` (the product of a place with the unit vector along `up`), whose density falls by a factor of
    /// e over `scale` above.
    ///
    /// # Errors
    /// Where the direction is zero, the scale not positive or anything not finite.
    pub fn new(up: DVec3, base: f64, scale: f64) -> Result<Self, HeightError> {
        let up = unit_f64(up).ok_or(HeightError::Up(up))?;
        if !base.is_finite() {
            return Err(HeightError::Base(base));
        }
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(HeightError::Scale(scale));
        }
        Ok(Self { up, base, scale })
    }

    /// The same, moved by `by`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn placed(&self, by: &DAffine3) -> Result<Self, HeightError> {
        // Height is linear in the place, so what was up is moved as normals are.
        let gradient = by.matrix3.inverse().transpose() * self.up;
        let steepness = gradient.length();
        let base = self.base / steepness + gradient.dot(by.translation) / steepness;
        Self::new(gradient, base, self.scale / steepness)
    }

    /// Density at `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        (-self.height(p).max(0.0)).exp()
    }

    /// Height of `p` above the base, in scale heights.
    fn height(&self, p: DVec3) -> f64 {
        (self.up.dot(p) - self.base) / self.scale
    }

    /// Scale heights that `line` rises over a unit of its length; zero where so little that it never matters.
    fn rise(&self, line: &Line) -> f64 {
        let rise = self.up.dot(line.direction()) / self.scale;
        if rise.abs() < 1e-200 { 0.0 } else { rise }
    }

    /// The parts of `line` up to `t_max`: at most two.
    fn pieces(&self, line: &Line, t_max: f64) -> impl Iterator<Item = Piece> + use<> {
        let (start, rise) = (self.height(line.origin()), self.rise(line));
        let piece = move |t0: f64, t1: f64, is_above: bool| Piece {
            t0,
            t1,
            height: is_above.then(|| (start + rise * t0).max(0.0)),
            rise,
        };
        // Where the line crosses the base, if it does.
        let crossing = if rise == 0.0 { f64::INFINITY } else { -start / rise };
        let is_above = start > 0.0 || start == 0.0 && rise > 0.0;
        let pieces = if crossing > 0.0 && crossing < t_max {
            [Some(piece(0.0, crossing, is_above)), Some(piece(crossing, t_max, !is_above))]
        } else {
            [(t_max > 0.0).then(|| piece(0.0, t_max, is_above)), None]
        };
        pieces.into_iter().flatten()
    }

    /// Integral of the density over `line` from 0 to `t_max`.
    pub fn depth(&self, line: &Line, t_max: f64) -> f64 {
        self.pieces(line, t_max).map(|piece| piece.depth()).sum()
    }

    /// The distance along `line` at which the integral of the density from 0 on is `depth`; `None` where it is not reached before
    /// `t_max`.
    pub fn distance(&self, line: &Line, t_max: f64, mut depth: f64) -> Option<f64> {
        for piece in self.pieces(line, t_max) {
            let whole = piece.depth();
            if depth < whole {
                let t = match piece.height {
                    None => piece.t0 + depth,
                    Some(height) => piece.t0 + distance_from(height, piece.rise, depth),
                };
                // Rounding may put the last depth of an endless line out of reach.
                return Some(t.min(piece.t1)).filter(|t| t.is_finite());
            }
            depth -= whole;
        }
        None
    }

    /// Segments of `line` from 0 to `t_max`. What is above 50 scale heights is left out: the density is 2e-22 there.
    pub fn segments(&self, line: &Line, t_max: f64) -> HeightSegments {
        let mut pieces = self.pieces(line, t_max);
        HeightSegments { pieces: [pieces.next(), pieces.next()], steps: 0 }
    }
}

/// The distance from a place `height` scale heights above the base over which the density along a line that rises by `rise` integrates to
/// `depth`; infinite where it never does.
fn distance_from(height: f64, rise: f64, depth: f64) -> f64 {
    if rise == 0.0 {
        return depth * height.exp();
    }
    // exp(q) = depth * |rise| / density, which itself may be out of range.
    let q = (depth * rise.abs()).ln() + height;
    if rise > 0.0 {
        // Upwards there is a last depth.
        if q >= 0.0 { f64::INFINITY } else { -(-q.exp()).ln_1p() / rise }
    } else {
        (if q > 36.0 { q } else { q.exp().ln_1p() }) / -rise
    }
}

impl Piece {
    fn depth(&self) -> f64 {
        let length = self.t1 - self.t0;
        let Some(first) = self.height else { return length };
        let climb = if self.rise == 0.0 { 0.0 } else { self.rise.abs() * length };
        // From the lower end, so that nothing is the product of what is too small and what is too large.
        let low = if self.rise < 0.0 { (first - climb).max(0.0) } else { first };
        let density = (-low).exp();
        if density == 0.0 {
            0.0
        } else if climb < 1e-5 {
            // (1 - exp(-x)) / x by its series.
            density * length * (1.0 - climb * (0.5 - climb / 6.0))
        } else {
            density * (-(-climb).exp_m1() / self.rise.abs())
        }
    }

    /// Segment number `step` of the piece; none behind its end.
    fn segment(&self, step: u32) -> Option<Segment> {
        let Self { t0, t1, rise, .. } = *self;
        let Some(first) = self.height.filter(|_| rise != 0.0) else {
            let density = (-self.height.unwrap_or(0.0)).exp();
            let is_there = step == 0 && self.height.unwrap_or(0.0) < TOP;
            return is_there.then_some(Segment { t0, t1, majorant: density, minorant: density });
        };
        let start = if rise > 0.0 { first } else { first.min(TOP) };
        // Away from the start the height changes by a step each.
        let height = |step: u32| start + (STEP * f64::from(step)).copysign(rise);
        let (from, to) = (height(step), height(step + 1));
        let at = |height: f64| t0 + (height - first) / rise;
        let (begin, end) = (at(from).max(t0), at(to).min(t1));
        let is_over = begin >= t1 || from >= TOP && rise > 0.0 || from <= 0.0 && rise < 0.0;
        (!is_over).then(|| Segment {
            t0: begin,
            t1: end,
            majorant: (-from.min(to).max(0.0)).exp(),
            minorant: (-from.max(to)).exp(),
        })
    }
}

/// Segments of a line through a fog by height: each as long as the density takes to fall or rise by a factor of two.
#[derive(Clone, Debug)]
pub struct HeightSegments {
    pieces: [Option<Piece>; 2],
    /// Segments of the first piece that there is, so far.
    steps: u32,
}

impl Iterator for HeightSegments {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        for piece in &mut self.pieces {
            if let Some(segment) = piece.and_then(|piece| piece.segment(self.steps)) {
                self.steps += 1;
                return Some(segment);
            }
            if piece.take().is_some() {
                self.steps = 0;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::{
        Density,
        test_lines::{check_segments, random_point},
    };
    use crate::sampling::{Rng, Stream};

    fn line(origin: [f64; 3], direction: [f64; 3]) -> Line {
        Line::new(DVec3::from_array(origin), DVec3::from_array(direction)).unwrap()
    }

    #[test]
    fn printed_transmittances_of_an_atmosphere() {
        let fog = HeightFog::new(DVec3::Y, 0.0, 1.0).unwrap();
        let slant = [3f64.sqrt(), 1.0, 0.0];
        let cases = [
            ([0.0, 1.0, 0.0], f64::INFINITY, 0.367_879_44),
            ([0.0, 1.0, 0.0], 1.0, 0.531_463_61),
            (slant, f64::INFINITY, 0.135_335_28),
            (slant, 2.0, 0.282_453_56),
        ];
        for (direction, t_max, expected) in cases {
            let found = (-fog.depth(&line([0.0; 3], direction), t_max)).exp();
            assert!((found - expected).abs() < 1e-8, "{direction:?} {t_max}: {found}");
        }
    }

    #[test]
    fn a_fog_can_be_moved() {
        let fog = HeightFog::new(DVec3::new(0.0, 2.0, 0.0), 3.0, 0.5).unwrap();
        let turn = DAffine3::from_rotation_x(0.4) * DAffine3::from_scale(DVec3::splat(4.0));
        let uneven = DAffine3::from_scale(DVec3::new(1.0, -2.0, 3.0)) * DAffine3::from_rotation_z(0.3);
        for by in [DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0)) * turn, uneven] {
            let moved = fog.placed(&by).unwrap();
            for p in [DVec3::new(0.3, 2.0, 7.0), DVec3::new(-3.0, 3.2, 1.0), DVec3::new(5.0, 4.0, 0.0)] {
                let (before, after) = (fog.at(p), moved.at(by.transform_point3(p)));
                assert!((after / before - 1.0).abs() < 1e-12, "{by:?} {p}: {before} {after}");
            }
        }
        assert!(fog.placed(&DAffine3::ZERO).is_err());
    }

    /// Midpoint rule, fine enough for 1e-6.
    fn by_quadrature(fog: &HeightFog, line: &Line, t_max: f64) -> f64 {
        let steps = 40_000;
        let width = t_max / f64::from(steps);
        (0..steps).map(|i| fog.at(line.at((f64::from(i) + 0.5) * width))).sum::<f64>() * width
    }

    #[test]
    fn depth_and_distance_are_inverses_and_follow_the_density() {
        let mut rng = Rng::new(1, Stream::Measure, 32);
        for i in 0..300 {
            let up = random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE);
            let fog = HeightFog::new(up, rng.next_f64() - 0.5, 0.1 + rng.next_f64()).unwrap();
            let mut direction = random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE);
            if i % 4 == 0 {
                // Nearly level.
                direction -= up * (up.dot(direction) / up.length_squared()) * (1.0 - 1e-9);
            }
            let line =
                Line::new(random_point(&mut rng, DVec3::splat(-2.0), DVec3::splat(2.0)), direction).unwrap();
            let t_max = 4.0 * rng.next_f64();
            let depth = fog.depth(&line, t_max);
            let quadrature = by_quadrature(&fog, &line, t_max);
            assert!(
                (depth - quadrature).abs() < 1e-6 * (1.0 + depth),
                "{fog:?} {line:?}: {depth} {quadrature}"
            );
            for share in [1e-9, 0.1, 0.5, 0.9, 0.999_999] {
                let t = fog.distance(&line, t_max, depth * share).unwrap();
                assert!((0.0..=t_max).contains(&t));
                assert!(
                    (fog.depth(&line, t) / (depth * share) - 1.0).abs() < 1e-9,
                    "{fog:?} {line:?} {share}"
                );
            }
            assert_eq!(fog.distance(&line, t_max, depth * 1.000_001), None);
            check_segments(&Density::Height(fog), &line, t_max, &mut rng);
        }
    }

    #[test]
    fn extremes_are_sound() {
        let fog = HeightFog::new(DVec3::Y, 0.0, 1.0).unwrap();
        // From far above straight down, through a column whose upper part underflows.
        let down = line([0.0, 5000.0, 0.0], [0.0, -1.0, 0.0]);
        assert!((fog.depth(&down, 5000.0) - 1.0).abs() < 1e-12);
        let t = fog.distance(&down, 6000.0, 0.5).unwrap();
        assert!((t - (5000.0 - 2f64.ln())).abs() < 1e-9, "{t}");
        assert!((fog.distance(&down, 6000.0, 3.0).unwrap() - 5002.0).abs() < 1e-9);
        let segments = fog.segments(&down, 6000.0).count();
        assert!((50..90).contains(&segments), "{segments}");
        // Straight up there is no more than one scale height's worth, and level there is no end.
        let up = line([0.0; 3], [0.0, 1.0, 0.0]);
        assert_eq!(fog.distance(&up, f64::INFINITY, 1.5), None);
        assert!((fog.distance(&up, f64::INFINITY, 0.5).unwrap() - 2f64.ln()).abs() < 1e-12);
        assert!(fog.segments(&up, f64::INFINITY).count() < 90);
        let level = line([0.0, 3.0, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(fog.depth(&level, f64::INFINITY), f64::INFINITY);
        assert!((fog.distance(&level, f64::INFINITY, 2.0).unwrap() - 2.0 * 3f64.exp()).abs() < 1e-9);
        assert_eq!(fog.segments(&level, f64::INFINITY).count(), 1);
        let high = line([0.0, 2000.0, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(fog.depth(&high, f64::INFINITY), 0.0);
        assert_eq!(fog.segments(&high, f64::INFINITY).count(), 0);
        // Within the uniform part, and from its very border.
        let inside = line([0.0, -1.0, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(fog.depth(&inside, 7.0), 7.0);
        let border = line([0.0; 3], [0.0, -1.0, 0.0]);
        assert_eq!(fog.depth(&border, 7.0), 7.0);
        assert_eq!(fog.segments(&border, 7.0).count(), 1);
    }

    #[test]
    fn what_is_no_fog_is_refused() {
        assert!(matches!(HeightFog::new(DVec3::ZERO, 0.0, 1.0), Err(HeightError::Up(_))));
        assert!(matches!(HeightFog::new(DVec3::Y, f64::NAN, 1.0), Err(HeightError::Base(_))));
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(HeightFog::new(DVec3::Y, 0.0, scale), Err(HeightError::Scale(_))));
        }
    }
}
