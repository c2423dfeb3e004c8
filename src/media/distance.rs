//! Distances along a ray at which it meets light that a medium scatters: drawn where the light is, or where the ray gets to.
//!
//! After Kulla & Fajardo, "Importance Sampling Techniques for Path Tracing in Participating Media" (Eurographics Symposium on Rendering
//! 2012). A light at a finite distance sends radiance that falls with the square of the distance: equiangular sampling follows that
//! exactly. What reaches the eye falls exponentially: that is sampled by transmittance. [`Distances`] draws by one of both and divides by
//! the density of both together, which is the balance heuristic for one sample (Veach 1997, section 9.2.4). All of it in `f64`, without
//! differences of large numbers.
//!
//! Where the density of the medium varies, transmittance is sampled over its integral along the line instead of the distance: in closed form
//! where there is one, else with the mean of the bounds of each segment in place of the density.

use super::Volume;
use super::density::{Density, HeightFog, Line, Segment};
use crate::math::Rgb;
use glam::DVec3;

/// A distance and the density with which it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceSample {
    /// Distance along the line.
    pub t: f64,
    /// Density per unit of length.
    pub pdf: f64,
}

/// Distances on a part of a line in proportion to one over their squared distance to a point: equal angles, as seen from there.
#[derive(Clone, Copy, Debug)]
pub struct Equiangular {
    /// Distance along the line of the place nearest to the point.
    foot: f64,
    /// Ends of the part, from that place.
    near: f64,
    far: f64,
    /// Distance of the point from the line, and never less than a millionth of the part's extent: a light on the line has no density.
    height: f64,
    /// Angle under which the part is seen.
    angle: f64,
}

/// Distances on a part of a line in proportion to the transmittance of a homogeneous medium up to them.
#[derive(Clone, Copy, Debug)]
pub struct Exponential {
    start: f64,
    length: f64,
    /// Extinction coefficients, and with what probability each is used.
    extinction: DVec3,
    share: DVec3,
}

/// A distance out of [`Distances`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceSample {
    /// Distance along the line.
    pub t: f64,
    /// Density with which it is sampled, per unit of length.
    pub pdf: f64,
    /// Density with which the path itself collides there, per unit of length: as [`collision_density`], by the same density of the medium
    /// that distances are sampled by.
    pub collides: f64,
}

/// Distances by either way, with the density of both.
#[derive(Clone, Copy, Debug)]
pub struct Distances<'a> {
    equiangular: Option<Equiangular>,
    /// Over the depth of the course.
    exponential: Exponential,
    course: Course<'a>,
    extinction: Rgb,
    throughput: Rgb,
}

/// How the density of a medium adds up along a line: to a depth, which is the length where the density is one.
#[derive(Clone, Copy, Debug)]
enum Course<'a> {
    Even,
    Height {
        fog: &'a HeightFog,
        line: Line,
        end: f64,
    },
    /// The mean of the bounds of each segment.
    Stepped {
        density: &'a Density,
        line: Line,
        end: f64,
    },
}

/// A place of a [`Course`].
#[derive(Clone, Copy, Debug)]
struct Place {
    t: f64,
    /// Depth up to there.
    depth: f64,
    /// Depth per unit of length there.
    rate: f64,
}

impl<'a> Course<'a> {
    fn new(density: &'a Density, line: &Line, end: f64) -> Self {
        match density {
            Density::Homogeneous => Self::Even,
            Density::Height(fog) => Self::Height { fog, line: *line, end },
            Density::Field(_) | Density::Grid(_) => Self::Stepped { density, line: *line, end },
        }
    }

    /// Segments with the density that stands for that of each.
    fn steps(density: &'a Density, line: &Line, end: f64) -> impl Iterator<Item = (Segment, f64)> + use<'a> {
        let with_rate = |segment: Segment| (segment, 0.5 * (segment.majorant + segment.minorant));
        density.segments(line, end, f64::INFINITY).map(with_rate)
    }

    /// Depth at the end of a line of this length.
    fn whole(&self, length: f64) -> f64 {
        match *self {
            Self::Even => length,
            Self::Height { fog, line, end } => fog.depth(&line, end),
            Self::Stepped { density, line, end } => {
                Self::steps(density, &line, end).map(|(segment, rate)| (segment.t1 - segment.t0) * rate).sum()
            }
        }
    }

    fn at(&self, t: f64) -> Place {
        match *self {
            Self::Even => Place { t, depth: t, rate: 1.0 },
            Self::Height { fog, line, .. } => {
                Place { t, depth: fog.depth(&line, t), rate: fog.at(line.at(t)) }
            }
            Self::Stepped { density, line, end } => {
                let mut depth = 0.0;
                for (segment, rate) in Self::steps(density, &line, end) {
                    if t <= segment.t1 {
                        let is_within = t >= segment.t0;
                        depth += (t - segment.t0).max(0.0) * rate;
                        return Place { t, depth, rate: if is_within { rate } else { 0.0 } };
                    }
                    depth += (segment.t1 - segment.t0) * rate;
                }
                Place { t, depth, rate: 0.0 }
            }
        }
    }

    fn at_depth(&self, depth: f64) -> Place {
        match *self {
            Self::Even => Place { t: depth, depth, rate: 1.0 },
            Self::Height { fog, line, end } => {
                // Rounding may put the last depth out of reach.
                let t = fog.distance(&line, end, depth).unwrap_or(end.min(f64::MAX));
                Place { t, depth, rate: fog.at(line.at(t)) }
            }
            Self::Stepped { density, line, end } => {
                let (mut left, mut last) = (depth, Place { t: 0.0, depth, rate: 0.0 });
                for (segment, rate) in Self::steps(density, &line, end) {
                    let t = segment.t0 + left.max(0.0) / rate;
                    if t <= segment.t1 {
                        return Place { t, depth, rate };
                    }
                    left -= (segment.t1 - segment.t0) * rate;
                    last = Place { t: segment.t1, depth, rate };
                }
                last
            }
        }
    }
}

/// Least distance of a point from a line over the largest extent of the part.
const LEAST_HEIGHT: f64 = 1e-6;

impl Equiangular {
    /// For a light at `point` and the part of `line` between the distances `t0` and `t1`; `None` where that is empty or endless, or the
    /// point is not finite.
    pub fn new(line: &Line, point: DVec3, (t0, t1): (f64, f64)) -> Option<Self> {
        let offset = point - line.origin();
        let foot = offset.dot(line.direction());
        let (near, far) = (t0 - foot, t1 - foot);
        let extent = near.abs().max(far.abs());
        let height = (offset - line.direction() * foot).length().max(LEAST_HEIGHT * extent);
        if !(t0 < t1 && height > 0.0 && (height * height).is_normal() && (extent * extent).is_finite()) {
            return None;
        }
        // The difference of both angles, without their cancelling where both are near a quarter turn.
        let angle = (height * (far - near)).atan2(height * height + near * far);
        (angle > 0.0).then_some(Self { foot, near, far, height, angle })
    }

    /// The distance for a uniform variate in `[0, 1)`.
    pub fn sample(&self, u: f64) -> DistanceSample {
        let Self { near, far, height, angle, .. } = *self;
        // Turned from the end that is farther from the foot, or in front of it from the nearer of both: no difference below cancels.
        let from_near = far <= 0.0 || near < 0.0 && u < 0.5;
        let along = if from_near {
            let (sin, cos) = (angle * u).sin_cos();
            height * (near * cos + height * sin) / (height * cos - near * sin)
        } else {
            let (sin, cos) = (angle * (1.0 - u)).sin_cos();
            height * (far * cos - height * sin) / (height * cos + far * sin)
        };
        let along = along.clamp(near, far);
        DistanceSample { t: self.foot + along, pdf: self.pdf_along(along) }
    }

    /// Density per unit of length at the distance `t`, which is within the part.
    pub fn pdf(&self, t: f64) -> f64 {
        // Whatever rounding says of its ends.
        self.pdf_along((t - self.foot).clamp(self.near, self.far))
    }

    fn pdf_along(&self, along: f64) -> f64 {
        self.height / (self.angle * (self.height * self.height + along * along))
    }
}

impl Exponential {
    /// For the part between `t0` and `t1` of a line through a medium with this extinction, per unit of its length, picking channels in
    /// proportion to `throughput`. The part may be endless, where a channel that is picked loses something; else, and where it is empty,
    /// `None`.
    pub fn new(extinction: Rgb, throughput: Rgb, (t0, t1): (f64, f64)) -> Option<Self> {
        let length = t1 - t0;
        let extinction = extinction.as_dvec3();
        let is_usable = |c: usize| {
            throughput[c] > 0.0 && throughput[c].is_finite() && (length.is_finite() || extinction[c] > 0.0)
        };
        let weight =
            DVec3::from_array([0, 1, 2].map(|c| if is_usable(c) { f64::from(throughput[c]) } else { 0.0 }));
        let (weight, sum) = if weight.element_sum() > 0.0 {
            (weight, weight.element_sum())
        } else {
            // Nothing is to be had; any density does.
            let open = [0, 1, 2].map(|c| f64::from(u8::from(length.is_finite() || extinction[c] > 0.0)));
            (DVec3::from_array(open), open.iter().sum())
        };
        let is_sound =
            length > 0.0 && t0.is_finite() && extinction.is_finite() && extinction.min_element() >= 0.0;
        (is_sound && sum > 0.0).then(|| Self { start: t0, length, extinction, share: weight / sum })
    }

    /// The distance for a uniform variate in `[0, 1)`.
    pub fn sample(&self, u: f64) -> DistanceSample {
        let (channel, u) = self.pick(u);
        let sigma = self.extinction[channel];
        // The share of the light that is lost over the whole part.
        let lost = -(-sigma * self.length).exp_m1();
        let along = if lost > 0.0 { -(-u * lost).ln_1p() / sigma } else { u * self.length };
        // An endless part has no last place.
        let along = along.clamp(0.0, self.length).min(f64::MAX);
        DistanceSample { t: self.start + along, pdf: self.pdf_along(along) }
    }

    /// The channel for a variate, and the variate stretched over `[0, 1)` again.
    fn pick(&self, u: f64) -> (usize, f64) {
        let mut rest = u;
        let mut last = (0, 0.0);
        for channel in 0..3 {
            let share = self.share[channel];
            if share > 0.0 {
                last = (channel, (rest / share).clamp(0.0, 1.0 - f64::EPSILON / 2.0));
                if rest < share {
                    break;
                }
                rest -= share;
            }
        }
        last
    }

    /// Density per unit of length at the distance `t`, which is within the part.
    pub fn pdf(&self, t: f64) -> f64 {
        self.pdf_along((t - self.start).clamp(0.0, self.length))
    }

    fn pdf_along(&self, along: f64) -> f64 {
        let channel = |c: usize| {
            if self.share[c] == 0.0 {
                return 0.0;
            }
            let sigma = self.extinction[c];
            let lost = -(-sigma * self.length).exp_m1();
            let density = if lost > 0.0 { sigma * (-sigma * along).exp() / lost } else { 1.0 / self.length };
            self.share[c] * density
        };
        channel(0) + channel(1) + channel(2)
    }
}

/// Density per unit of length with which light of this throughput is tracked up to a collision at the distance `t` in a homogeneous medium:
/// the mean over the channels, by throughput, of `extinction exp(-extinction t)`. Not the density under the condition that it collides.
pub fn collision_density(extinction: Rgb, throughput: Rgb, t: f64) -> f64 {
    let share = throughput.as_dvec3().to_array().map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
    let sum: f64 = share.iter().sum();
    let share = if sum > 0.0 { share.map(|x| x / sum) } else { [1.0 / 3.0; 3] };
    let extinction = extinction.as_dvec3();
    (0..3).map(|c| share[c] * extinction[c] * (-extinction[c] * t).exp()).sum()
}

impl<'a> Distances<'a> {
    /// For a light at `point`, if it has a place, and the first `length` of `line`, in a medium whose coefficients are per unit of that length;
    /// channels are picked by `throughput`. `None` where nothing can collide there: the part is empty, or the density zero on all of it, or
    /// the part is endless and clear.
    pub fn new(
        volume: &'a Volume,
        line: &Line,
        length: f64,
        point: Option<DVec3>,
        throughput: Rgb,
    ) -> Option<Self> {
        let extinction = volume.coefficients().extinction();
        let course = Course::new(volume.density(), line, length);
        let exponential = Exponential::new(extinction, throughput, (0.0, course.whole(length)))?;
        let equiangular = point.and_then(|point| Equiangular::new(line, point, (0.0, length)));
        Some(Self { equiangular, exponential, course, extinction, throughput })
    }

    /// The distance for two uniform variates in `[0, 1)`, of which the first chooses the way. Its density is that of both together.
    pub fn sample(&self, way: f64, u: f64) -> PlaceSample {
        match &self.equiangular {
            Some(equiangular) if way < 0.5 => self.at(equiangular.sample(u).t),
            _ => self.told(self.course.at_depth(self.exponential.sample(u).t)),
        }
    }

    /// The densities at the distance `t`, which is within the part.
    pub fn at(&self, t: f64) -> PlaceSample {
        self.told(self.course.at(t))
    }

    fn told(&self, Place { t, depth, rate }: Place) -> PlaceSample {
        let along = self.exponential.pdf(depth) * rate;
        let pdf = self.equiangular.map_or(along, |equiangular| 0.5 * (equiangular.pdf(t) + along));
        let collides = collision_density(self.extinction, self.throughput, depth) * rate;
        PlaceSample { t, pdf, collides }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Bounds3;
    use crate::media::density::{BoundedField, GridBuilder, Smooth};
    use crate::media::{Coefficients, Phase};
    use crate::sampling::{Rng, Stream};
    use glam::{DAffine3, IVec3, UVec3};
    use std::sync::Arc;

    fn line() -> Line {
        Line::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.3, -0.5, 0.8)).unwrap()
    }

    /// A point at `height` from the line whose foot is at `foot`.
    fn beside(line: &Line, foot: f64, height: f64) -> DVec3 {
        line.at(foot) + line.direction().any_orthonormal_vector() * height
    }

    /// Checks the density against its samples: quantiles of the distribution function, by quadrature between neighbouring ones.
    fn check(
        sample: impl Fn(f64) -> DistanceSample,
        pdf: impl Fn(f64) -> f64,
        range: (f64, f64),
        what: &str,
    ) {
        // Where nearly all is lost, up to the last quantile that can be told.
        let (parts, last) = (64, 0.999);
        let mut before: Option<(f64, f64)> = None;
        for i in 0..=parts {
            let u = (f64::from(i) / f64::from(parts)).min(last);
            let drawn = sample(u);
            assert!(drawn.t >= range.0 && drawn.t <= range.1, "{what}: {drawn:?} outside of {range:?}");
            assert!(drawn.pdf.is_finite() && drawn.pdf > 0.0, "{what}: {drawn:?}");
            assert!((drawn.pdf / pdf(drawn.t) - 1.0).abs() < 1e-5, "{what}: {drawn:?} {}", pdf(drawn.t));
            if let Some((before, since)) = before {
                // Gauss with five points on halves: densities here change little between quantiles.
                let nodes = [
                    (0.0, 128.0 / 225.0),
                    (0.538_469_310_105_683, 0.478_628_670_499_366),
                    (0.906_179_845_938_664, 0.236_926_885_056_189),
                ];
                let pieces = 1024;
                let width = (drawn.t - before) / f64::from(pieces);
                let mut sum = 0.0;
                for piece in 0..pieces {
                    let middle = before + (f64::from(piece) + 0.5) * width;
                    for (x, weight) in nodes {
                        let both = if x == 0.0 {
                            pdf(middle)
                        } else {
                            pdf(middle + 0.5 * width * x) + pdf(middle - 0.5 * width * x)
                        };
                        sum += 0.5 * width * weight * both;
                    }
                }
                let expected = u - since;
                // Distances far from the origin have lost digits of their own.
                let lost = 4.0 * f64::EPSILON * drawn.t.abs() * pdf(drawn.t).max(pdf(before));
                assert!((sum - expected).abs() < 1e-5 * expected + lost, "{what}: {sum} up to quantile {u}");
            }
            before = Some((drawn.t, u));
        }
    }

    #[test]
    fn equal_angles_follow_their_density() {
        let line = line();
        for height in [1e-3, 0.1, 1.0, 30.0] {
            for (foot, range) in [
                (5.0, (0.0, 10.0)),
                (-3.0, (0.0, 10.0)),
                (13.0, (0.0, 10.0)),
                (0.0, (0.0, 2.0)),
                (1.0, (0.999, 1.5)),
            ] {
                let point = beside(&line, foot, height);
                let equiangular = Equiangular::new(&line, point, range).unwrap();
                check(
                    |u| equiangular.sample(u),
                    |t| equiangular.pdf(t),
                    range,
                    &format!("{height} {foot} {range:?}"),
                );
            }
        }
    }

    #[test]
    fn a_light_on_the_line_is_no_end() {
        let line = line();
        for (foot, range) in [
            (5.0, (0.0, 10.0)),
            (0.0, (0.0, 10.0)),
            (-1.0, (0.0, 10.0)),
            (11.0, (0.0, 10.0)),
            (5.0, (4.0, 1e6)),
            (1e6, (0.0, 1.0)),
        ] {
            let equiangular = Equiangular::new(&line, line.at(foot), range).unwrap();
            let mut rng = Rng::new(1, Stream::Measure, 41);
            for u in [0.0, 0.5, 1.0 - f64::EPSILON / 2.0].into_iter().chain((0..1000).map(|_| rng.next_f64()))
            {
                let drawn = equiangular.sample(u);
                assert!(
                    drawn.t >= range.0 - 1e-9 && drawn.t <= range.1 + 1e-9,
                    "{foot} {range:?} {u}: {drawn:?}"
                );
                assert!(drawn.pdf.is_finite() && drawn.pdf > 0.0, "{foot} {range:?} {u}: {drawn:?}");
            }
        }
        for range in [(1.0, 1.0), (2.0, 1.0), (0.0, f64::INFINITY), (0.0, f64::NAN)] {
            assert!(Equiangular::new(&line, DVec3::ZERO, range).is_none());
        }
        assert!(Equiangular::new(&line, DVec3::NAN, (0.0, 1.0)).is_none());
        assert!(Equiangular::new(&line, DVec3::splat(1e300), (0.0, 1.0)).is_none());
    }

    #[test]
    fn transmittance_is_followed_from_thin_to_thick() {
        for tau in [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 1.0, 10.0, 1e3, 1e6] {
            let extinction = Rgb::splat((tau / 4.0) as f32);
            let range = (1.0, 5.0);
            let one = Exponential::new(extinction, Rgb::Y, range).unwrap();
            check(|u| one.sample(u), |t| one.pdf(t), range, &format!("{tau}"));
        }
    }

    #[test]
    fn channels_are_mixed_by_throughput() {
        let extinction = Rgb::new(0.01, 1.0, 100.0);
        let mixed = Exponential::new(extinction, Rgb::new(1.0, 2.0, 0.0), (0.0, 2.0)).unwrap();
        let steps = 200_000;
        let width = 2.0 / f64::from(steps);
        let whole: f64 = (0..steps).map(|i| mixed.pdf((f64::from(i) + 0.5) * width) * width).sum();
        assert!((whole - 1.0).abs() < 1e-6, "{whole}");
        let mut rng = Rng::new(1, Stream::Measure, 42);
        let (count, mut sum) = (200_000, 0.0);
        for _ in 0..count {
            sum += mixed.sample(rng.next_f64()).t;
        }
        let mean = |s: f64| 1.0 / s - 2.0 * (-2.0 * s).exp() / -(-2.0 * s).exp_m1();
        let expected = mean(f64::from(0.01f32)) / 3.0 + mean(1.0) * 2.0 / 3.0;
        assert!((sum / f64::from(count) - expected).abs() < 4.5 / f64::from(count).sqrt(), "{sum}");
        // Endless parts: only channels that lose something can be picked.
        let endless = Exponential::new(Rgb::new(0.0, 2.0, 0.0), Rgb::ONE, (1.0, f64::INFINITY)).unwrap();
        let drawn = endless.sample(0.5);
        assert!(
            (drawn.t - (1.0 + 0.5 * 2f64.ln())).abs() < 1e-12 && (drawn.pdf - 1.0).abs() < 1e-12,
            "{drawn:?}"
        );
        assert!(endless.sample(1.0 - f64::EPSILON / 2.0).t.is_finite());
        assert!(Exponential::new(Rgb::ZERO, Rgb::ONE, (0.0, f64::INFINITY)).is_none());
        for throughput in [Rgb::ZERO, Rgb::NAN, Rgb::NEG_ONE, Rgb::INFINITY] {
            let any = Exponential::new(extinction, throughput, (0.0, 1.0)).unwrap();
            assert!(any.sample(0.7).pdf > 0.0 && any.sample(0.7).pdf.is_finite());
        }
        for range in [(0.0, 0.0), (1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::NAN)] {
            assert!(Exponential::new(extinction, Rgb::ONE, range).is_none());
        }
    }

    #[test]
    fn both_ways_share_one_density() {
        let line = line();
        let volume = volume(Density::Homogeneous);
        let both = Distances::new(&volume, &line, 6.0, Some(beside(&line, 2.0, 0.01)), Rgb::ONE).unwrap();
        // The mean of 1/pdf is the length.
        let mut rng = Rng::new(1, Stream::Measure, 43);
        let (count, mut sum, mut squares) = (400_000, 0.0, 0.0);
        for _ in 0..count {
            let drawn = both.sample(rng.next_f64(), rng.next_f64());
            assert_eq!(drawn, both.at(drawn.t));
            sum += 1.0 / drawn.pdf;
            squares += 1.0 / drawn.pdf / drawn.pdf;
        }
        let mean = sum / f64::from(count);
        let error = ((squares / f64::from(count) - mean * mean) / f64::from(count)).sqrt();
        assert!((mean - 6.0).abs() < 4.5 * error, "{mean} +- {error}");
        // Lights at infinity have no place.
        let far = Distances::new(&volume, &line, 6.0, None, Rgb::ONE).unwrap();
        assert_eq!(far.sample(0.1, 0.3), far.sample(0.9, 0.3));
        assert!(Distances::new(&volume, &line, 0.0, None, Rgb::ONE).is_none());
    }

    fn volume(density: Density) -> Volume {
        Volume::new(Coefficients::new(Rgb::ZERO, Rgb::ONE).unwrap(), Phase::Isotropic, density)
    }

    /// Densities that vary: where distances are sampled, the density of sampling integrates to one, and the mean of what is sampled of any
    /// function is its integral.
    #[test]
    fn distances_follow_densities_that_vary() {
        let bounds = Bounds3 { min: DVec3::splat(-2.0), max: DVec3::splat(2.0) };
        let cone = Smooth { value: |p: DVec3| 5.0 * (1.0 - p.length()), slope: 5.0 };
        let cone = Density::Field(Arc::new(BoundedField::new(cone, bounds, UVec3::splat(9)).unwrap()));
        let mut builder = GridBuilder::default();
        builder
            .dense(IVec3::splat(-16), IVec3::splat(32), |v| if v.x < 0 { 0.0 } else { v.y.abs() as f32 })
            .unwrap();
        let grid = builder.finish(DAffine3::from_scale(DVec3::splat(0.1))).unwrap().0;
        let fog = HeightFog::new(DVec3::Z, 0.5, 0.3).unwrap();
        let mut rng = Rng::new(1, Stream::Measure, 44);
        for density in [cone, Density::Grid(Arc::new(grid)), Density::Height(fog)] {
            let volume = volume(density);
            for (i, point) in [None, Some(DVec3::new(0.5, 0.2, 0.3))].into_iter().cycle().take(4).enumerate()
            {
                let from = DVec3::new(-3.0, 0.3 * i as f64 - 1.0, -1.0);
                let line = Line::new(from, DVec3::new(0.3, 0.1, 0.4) - from).unwrap();
                let Some(distances) = Distances::new(&volume, &line, 7.0, point, Rgb::ONE) else {
                    panic!("{volume:?} has something on {line:?}")
                };
                let steps = 10_000;
                let width = 7.0 / f64::from(steps);
                let places = (0..steps).map(|step| distances.at((f64::from(step) + 0.5) * width));
                let (mut whole, mut all, mut expected) = (0.0, 0.0, 0.0);
                for place in places {
                    whole += place.pdf * width;
                    all += place.collides * width;
                    expected += place.collides * place.t * width;
                }
                assert!((whole - 1.0).abs() < 2e-3, "{whole}");
                // What collides at all, of a light of one.
                let lost = 1.0 - (-distances.course.whole(7.0)).exp();
                assert!((all - lost).abs() < 2e-3 * lost, "{all} {lost}");
                let (count, mut sum, mut squares) = (5_000, 0.0, 0.0);
                for _ in 0..count {
                    let drawn = distances.sample(rng.next_f64(), rng.next_f64());
                    assert!((0.0..=7.0).contains(&drawn.t) && drawn.pdf > 0.0, "{drawn:?}");
                    let value = drawn.collides * drawn.t / drawn.pdf;
                    sum += value;
                    squares += value * value;
                }
                let mean = sum / f64::from(count);
                let error = ((squares / f64::from(count) - mean * mean).max(0.0) / f64::from(count)).sqrt();
                assert!(
                    (mean - expected).abs() < 4.5 * error + 2e-3 * expected,
                    "{mean} +- {error}, {expected}"
                );
            }
            let away = Line::new(DVec3::new(0.0, 0.0, 500.0), DVec3::Z).unwrap();
            assert!(Distances::new(&volume, &away, 7.0, None, Rgb::ONE).is_none());
        }
    }
}
