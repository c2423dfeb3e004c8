//! Reconstruction filters and their importance sampling.

use glam::Vec2;
use serde::Serialize;
use thiserror::Error;

/// A reconstruction filter: the weight of a point of the picture plane for a pixel, as a function of its offset from the pixel's
/// centre. All filters are products of a function of x and the same function of y. Lengths are in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Filter {
    /// Constant over the square of half width `radius`; 0.5 is the pixel itself.
    Box {
        /// Half width.
        radius: f32,
    },
    /// `max(0, 1 - |x| / radius)`.
    Tent {
        /// Half width.
        radius: f32,
    },
    /// `max(0, g(x) - g(radius))` with the Gaussian `g`: cut off at `radius`, and lowered so that it ends in zero
    /// (Pharr, Jakob & Humphreys, "Physically Based Rendering", 4th ed., section 8.8.3).
    Gaussian {
        /// Half width.
        radius: f32,
        /// Standard deviation of `g`.
        sigma: f32,
    },
    /// The cubic of Mitchell & Netravali ("Reconstruction Filters in Computer Graphics", 1988) with B = C = 1/3,
    /// stretched to end at `radius` (2 in the paper). Negative from 4/7 of the radius on.
    Mitchell {
        /// Half width.
        radius: f32,
    },
}

/// A filter that cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum FilterError {
    /// Radius of zero, negative, not finite or too large.
    #[error("filter radius {0} is not usable; give a number of pixels above 0 and at most 64")]
    Radius(f32),
    /// Standard deviation of zero, negative, not finite, or too small for the filter to be sampled.
    #[error("filter sigma {0} is not usable; give a number of pixels above radius / 20")]
    Sigma(f32),
}

impl Default for Filter {
    /// The box of one pixel.
    fn default() -> Self {
        Self::Box { radius: 0.5 }
    }
}

impl Filter {
    /// Half width of the support, pixels.
    pub fn radius(&self) -> f32 {
        match *self {
            Self::Box { radius }
            | Self::Tent { radius }
            | Self::Gaussian { radius, .. }
            | Self::Mitchell { radius } => radius,
        }
    }

    /// One axis of the filter at `x` pixels from the centre, not normalised; zero beyond the radius.
    pub fn eval_1d(&self, x: f64) -> f64 {
        let (x, radius) = (x.abs(), f64::from(self.radius()));
        if x > radius {
            return 0.0;
        }
        match *self {
            Self::Box { .. } => 1.0,
            Self::Tent { .. } => 1.0 - x / radius,
            Self::Gaussian { sigma, .. } => {
                let g = |x: f64| (-0.5 * (x / f64::from(sigma)).powi(2)).exp();
                g(x) - g(radius)
            }
            Self::Mitchell { .. } => mitchell(2.0 * x / radius),
        }
    }

    /// A sampler for the filter, or an error about its parameters.
    pub fn sampler(&self) -> Result<FilterSampler, FilterError> {
        let radius = self.radius();
        if !(radius > 0.0 && radius <= 64.0) {
            return Err(FilterError::Radius(radius));
        }
        let warp = match *self {
            Self::Box { .. } => Warp::Box,
            Self::Tent { .. } => Warp::Tent,
            Self::Gaussian { sigma, .. } if !(sigma.is_finite() && sigma > radius / 20.0) => {
                return Err(FilterError::Sigma(sigma));
            }
            Self::Gaussian { .. } | Self::Mitchell { .. } => Warp::Table(Table::new(self)),
        };
        Ok(FilterSampler { radius, warp })
    }
}

/// The paper's k(x) for `x` in `[0, 2]`, times 18, which leaves whole coefficients.
fn mitchell(x: f64) -> f64 {
    if x < 1.0 { (21.0 * x - 36.0) * x * x + 16.0 } else { (2.0 - x).powi(2) * (8.0 - 7.0 * x) }
}

/// A point of the picture plane sampled for one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterSample {
    /// Offset from the pixel's centre, pixels, x to the right and y down.
    pub offset: Vec2,
    /// Weight of the sample: exactly 1 for filters without negative lobes, otherwise a positive or negative constant. Its expectation
    /// is 1.
    pub weight: f32,
}

/// Filter importance sampling (Ernst, Stamminger & Greiner, "Filter Importance Sampling", 2006): points are sampled in proportion to
/// the filter's magnitude. So each camera sample contributes to a single pixel, and pixels depend on no neighbour, whatever the tile,
/// crop window or thread.
#[derive(Clone, Debug)]
pub struct FilterSampler {
    radius: f32,
    warp: Warp,
}

#[derive(Clone, Debug)]
enum Warp {
    Box,
    Tent,
    Table(Table),
}

impl FilterSampler {
    /// The sample for `u` in `[0, 1)^2`. Each axis is monotone in its coordinate of `u`, so that stratified points stay stratified.
    #[inline]
    pub fn sample(&self, u: Vec2) -> FilterSample {
        match &self.warp {
            Warp::Box => FilterSample { offset: (2.0 * u - Vec2::ONE) * self.radius, weight: 1.0 },
            Warp::Tent => FilterSample { offset: Vec2::new(tent(u.x), tent(u.y)) * self.radius, weight: 1.0 },
            Warp::Table(table) => {
                let ((x, weight_x), (y, weight_y)) = (table.sample(u.x), table.sample(u.y));
                FilterSample { offset: Vec2::new(x, y), weight: weight_x * weight_y }
            }
        }
    }

    /// Density per square pixel of an offset in [`Self::sample`], and the weight of a sample there. Their product is the filter,
    /// normalized to an integral of one.
    pub fn density(&self, offset: Vec2) -> (f32, f32) {
        let r = self.radius;
        let axis = |x: f32| match &self.warp {
            _ if !(x.abs() < r) => (0.0, 1.0),
            Warp::Box => (0.5 / r, 1.0),
            Warp::Tent => ((1.0 - x.abs() / r) / r, 1.0),
            Warp::Table(table) => table.density(x),
        };
        let ((x, weight_x), (y, weight_y)) = (axis(offset.x), axis(offset.y));
        (x * y, weight_x * weight_y)
    }

    /// Half width of the support, pixels.
    pub fn radius(&self) -> f32 {
        self.radius
    }
}

/// Inverse of the cumulative tent over `[-1, 1]`.
fn tent(u: f32) -> f32 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).max(0.0).sqrt() }
}

/// Cells across the support. A multiple of 7, so that the zeros of Mitchell's filter, at 4/7 of the radius, lie
/// between cells and each cell has one sign.
const CELLS: usize = 28 * 64;

/// One axis of a filter as cells of constant density. Each cell has exactly the filter's mass.
#[derive(Clone, Debug)]
struct Table {
    radius: f32,
    /// Share of |f| below each cell's lower edge; one more entry than cells, the last is 1.
    cumulative: Vec<f32>,
    /// First cell where f is positive, and the cell after the last one.
    positive: (usize, usize),
    /// Integral of |f| over that of f: the weight of a sample where f is positive.
    magnitude: f32,
}

impl Table {
    fn new(filter: &Filter) -> Self {
        let radius = f64::from(filter.radius());
        let edge = |i: usize| radius * (2.0 * i as f64 / CELLS as f64 - 1.0);
        // Simpson's rule: exact for the cubic, 1e-12 for the Gaussian.
        let masses: Vec<f64> = (0..CELLS)
            .map(|i| {
                let (low, high) = (edge(i), edge(i + 1));
                let middle = filter.eval_1d(0.5 * (low + high));
                (filter.eval_1d(low) + 4.0 * middle + filter.eval_1d(high)) / 6.0
            })
            .collect();
        let magnitude: f64 = masses.iter().map(|m| m.abs()).sum();
        let total: f64 = masses.iter().sum();
        let mut cumulative = Vec::with_capacity(CELLS + 1);
        let mut below = 0.0;
        for mass in &masses {
            cumulative.push((below / magnitude) as f32);
            below += mass.abs();
        }
        cumulative.push(1.0);
        let first = masses.iter().position(|&m| m > 0.0).unwrap_or(0);
        let end = masses.iter().rposition(|&m| m > 0.0).map_or(CELLS, |last| last + 1);
        Self {
            radius: filter.radius(),
            cumulative,
            positive: (first, end),
            magnitude: (magnitude / total) as f32,
        }
    }

    /// Density and weight of an offset within the radius.
    fn density(&self, x: f32) -> (f32, f32) {
        let cell = (((x / self.radius + 1.0) * 0.5 * CELLS as f32) as usize).min(CELLS - 1);
        let share = self.cumulative[cell + 1] - self.cumulative[cell];
        (share * CELLS as f32 / (2.0 * self.radius), self.weight(cell))
    }

    fn weight(&self, cell: usize) -> f32 {
        let positive = (self.positive.0..self.positive.1).contains(&cell);
        if positive { self.magnitude } else { -self.magnitude }
    }

    /// Offset and weight for `u` in `[0, 1)`.
    fn sample(&self, u: f32) -> (f32, f32) {
        let cell = self.cumulative.partition_point(|&c| c <= u).clamp(1, CELLS) - 1;
        let (low, high) = (self.cumulative[cell], self.cumulative[cell + 1]);
        let within = if high > low { ((u - low) / (high - low)).min(1.0) } else { 0.5 };
        let x = self.radius * (2.0 * (cell as f32 + within) / CELLS as f32 - 1.0);
        (x, self.weight(cell))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    const ALL: [Filter; 7] = [
        Filter::Box { radius: 0.5 },
        Filter::Box { radius: 1.25 },
        Filter::Tent { radius: 1.0 },
        Filter::Gaussian { radius: 1.5, sigma: 0.5 },
        Filter::Gaussian { radius: 2.0, sigma: 3.0 },
        Filter::Mitchell { radius: 2.0 },
        Filter::Mitchell { radius: 3.0 },
    ];

    /// Integral of f(x) x^power over the support, by the midpoint rule.
    fn moment(filter: &Filter, power: i32) -> f64 {
        let (radius, n) = (f64::from(filter.radius()), 200_000);
        let x = |i: u32| radius * ((2 * i + 1) as f64 / n as f64 - 1.0);
        (0..n).map(|i| filter.eval_1d(x(i)) * x(i).powi(power)).sum::<f64>() * 2.0 * radius / n as f64
    }

    #[test]
    fn the_pixel_itself() {
        let sampler = Filter::default().sampler().unwrap();
        assert_eq!(sampler.sample(Vec2::ZERO).offset, Vec2::splat(-0.5));
        let last = 1.0 - 1.0 / 16_777_216.0;
        let far = sampler.sample(Vec2::splat(last)).offset;
        assert!(far.x < 0.5 && far.x > 0.499_999 && far.y == far.x);
        // The map is a shift only: every stratum of u keeps its place.
        for i in 0..1024 {
            let u = Vec2::new(i as f32 / 1024.0, 0.25);
            assert_eq!(sampler.sample(u).offset, u - 0.5);
        }
    }

    #[test]
    fn moments_agree_with_the_filter_function() {
        for filter in ALL {
            let sampler = filter.sampler().unwrap();
            let n = 1 << 18;
            let mut sums = [0f64; 5];
            for i in 0..n {
                let s = sampler.sample(Vec2::new((i as f32 + 0.5) / n as f32, 0.5));
                // The y axis is at the centre, in the positive lobe: its constant weight is divided out.
                let weight = f64::from(s.weight / sampler.sample(Vec2::splat(0.5)).weight.sqrt());
                for (power, sum) in sums.iter_mut().enumerate() {
                    *sum += weight * f64::from(s.offset.x).powi(power as i32) / n as f64;
                }
            }
            let scale = f64::from(filter.radius());
            for (power, sum) in sums.iter().enumerate() {
                let want = moment(&filter, power as i32) / moment(&filter, 0);
                let error = (sum - want).abs() / scale.powi(power as i32);
                assert!(error < 2e-5, "{filter:?} moment {power}: {sum}, not {want}");
            }
        }
    }

    #[test]
    fn histogram_agrees_with_the_filter_function() {
        let mut rng = Rng::new(11, Stream::Measure, 7);
        for filter in ALL {
            let sampler = filter.sampler().unwrap();
            let radius = filter.radius();
            let (bins, n) = (14, 400_000);
            let mut seen = vec![0f64; bins * bins];
            let mut squares = vec![0f64; bins * bins];
            for _ in 0..n {
                let s = sampler.sample(rng.next_2d());
                assert!(s.offset.abs().max_element() <= radius * 1.000_001);
                let bin = |x: f32| ((x / radius + 1.0) * 0.5 * bins as f32).clamp(0.0, 13.0) as usize;
                let cell = bin(s.offset.y) * bins + bin(s.offset.x);
                seen[cell] += f64::from(s.weight) / f64::from(n);
                squares[cell] += f64::from(s.weight).powi(2) / f64::from(n);
            }
            let steps = 200;
            let total = moment(&filter, 0);
            let mass: Vec<f64> = (0..bins)
                .map(|bin| {
                    let at = |k: usize| (bin * steps + k) as f64 + 0.5;
                    let x = |k: usize| f64::from(radius) * (2.0 * at(k) / (bins * steps) as f64 - 1.0);
                    let sum: f64 = (0..steps).map(|k| filter.eval_1d(x(k))).sum();
                    sum * 2.0 * f64::from(radius) / (bins * steps) as f64 / total
                })
                .collect();
            for cell in 0..bins * bins {
                let want = mass[cell % bins] * mass[cell / bins];
                let sigma = (squares[cell] / f64::from(n)).sqrt();
                assert!((seen[cell] - want).abs() < 5.0 * sigma + 3e-5, "{filter:?} cell {cell}");
            }
        }
    }

    #[test]
    fn densities_are_those_of_the_samples() {
        for filter in ALL {
            let sampler = filter.sampler().unwrap();
            let r = sampler.radius();
            let n = 700u32;
            let at = |i: u32| r * ((2 * i + 1) as f32 / n as f32 - 1.0);
            let area = f64::from(2.0 * r / n as f32).powi(2);
            let (mut density, mut value, mut left) = (0.0, 0.0, 0.0);
            for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
                let (pdf, weight) = sampler.density(Vec2::new(at(i), at(j)));
                density += f64::from(pdf) * area;
                value += f64::from(pdf * weight) * area;
                left += if at(i) < -0.3 * r { f64::from(pdf) * area } else { 0.0 };
            }
            let drawn = (0..n).filter(|&k| {
                let u = Vec2::new((k as f32 + 0.5) / n as f32, 0.3);
                sampler.sample(u).offset.x < -0.3 * r
            });
            let drawn = drawn.count() as f64 / f64::from(n);
            println!("{filter:?}: {density} {value}, {left} {drawn}");
            assert!((density - 1.0).abs() < 1e-3 && (value - 1.0).abs() < 1e-3);
            assert!((left - drawn).abs() < 3e-3);
            assert_eq!(sampler.density(Vec2::new(1.01 * r, 0.0)).0, 0.0);
        }
    }

    #[test]
    fn weights() {
        let mut rng = Rng::new(5, Stream::Measure, 8);
        for filter in ALL {
            let sampler = filter.sampler().unwrap();
            let negative = matches!(filter, Filter::Mitchell { .. });
            let mut sum = 0f64;
            for _ in 0..100_000 {
                let weight = sampler.sample(rng.next_2d()).weight;
                assert!(negative || weight == 1.0);
                sum += f64::from(weight);
            }
            assert!((sum / 1e5 - 1.0).abs() < 0.01, "{filter:?}: {sum}");
        }
    }

    #[test]
    fn offsets_are_monotone() {
        for filter in ALL {
            let sampler = filter.sampler().unwrap();
            let mut last = f32::NEG_INFINITY;
            for i in 0..100_000 {
                let x = sampler.sample(Vec2::new(i as f32 / 100_000.0, 0.0)).offset.x;
                assert!(x >= last, "{filter:?} {i}");
                last = x;
            }
        }
    }

    #[test]
    fn unusable_parameters_are_named() {
        for radius in [0.0, -1.0, f32::NAN, f32::INFINITY, 100.0] {
            assert!(matches!(Filter::Tent { radius }.sampler(), Err(FilterError::Radius(_))));
        }
        for sigma in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-3] {
            assert!(matches!(Filter::Gaussian { radius: 2.0, sigma }.sampler(), Err(FilterError::Sigma(_))));
        }
    }
}
