//! Tabulated densities over the sphere of directions, in longitude and latitude.

use super::{Distribution2D, ONE_MINUS_EPSILON};
use glam::{Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Longitude and latitude of a direction, in the layout of environment pictures: `u` in `[0, 1)` increases to the right and is one half
/// at -z; `v` in `[0, 1]` increases downwards from +y.
pub fn direction_to_square(direction: Vec3) -> Vec2 {
    let d = direction.as_dvec3();
    let u = 0.5 + d.x.atan2(-d.z) / TAU;
    let v = d.x.hypot(d.z).atan2(d.y) / PI;
    Vec2::new((u as f32).clamp(0.0, ONE_MINUS_EPSILON), v as f32)
}

/// The unit direction of a point of this square, and the sine of its angle to +y.
pub fn square_to_direction(u: f64, v: f64) -> (Vec3, f64) {
    let (sin, cos) = (PI * v).sin_cos();
    let (s, c) = (TAU * (u - 0.5)).sin_cos();
    (Vec3::new((sin * s) as f32, cos as f32, (-sin * c) as f32), sin)
}

/// The four values around a point between the centres of a table's cells, and the position of the point between them. Columns wrap
/// around; beyond the first and the last row the values are constant.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    /// Index of the upper left, upper right, lower left and lower right value.
    pub indices: [usize; 4],
    /// Interpolation weights of the right values and of the lower values.
    pub at: Vec2,
}

impl Corners {
    /// The corners around a point of the unit square, in a table of `width` by `height` values, row by row.
    #[inline]
    pub fn of(u: Vec2, width: usize, height: usize) -> Self {
        let x = u.x * width as f32 - 0.5;
        let y = (u.y * height as f32 - 0.5).clamp(0.0, (height - 1) as f32);
        let (left, top) = (x.floor(), (y.floor() as usize).min(height - 1));
        let right = (left + 1.0) as usize % width;
        let left_column = if left < 0.0 { width - 1 } else { (left as usize).min(width - 1) };
        let bottom = (top + 1).min(height - 1);
        Self {
            indices: [
                top * width + left_column,
                top * width + right,
                bottom * width + left_column,
                bottom * width + right,
            ],
            at: Vec2::new(x - left, y - top as f32),
        }
    }

    /// Weights of the four values.
    #[inline]
    pub fn weights(&self) -> [f32; 4] {
        let Vec2 { x, y } = self.at;
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }
}

/// A density over all directions that is the bilinear interpolation of a table on the square of longitude and latitude. It is positive
/// wherever a function interpolated from the same table positions is, and it is sampled exactly.
#[derive(Clone, Debug)]
pub struct SphereDensity {
    width: usize,
    height: usize,
    /// Weights at the centres of cells, row by row from the top: the value times the sine of the angle to +y.
    weights: Vec<f32>,
    /// Distribution over the cells between centres. The first and the last of the `height + 1` rows have half the height.
    cells: Distribution2D,
    /// Area of the unit square over the integral of the weights.
    scale: f64,
}

impl SphereDensity {
    /// A density proportional to the non-negative `values`, row by row of `width`. The sine of the angle to +y enters the weights. Returns
    /// `None` where the table is empty, where no value is positive, or where a value is not finite.
    pub fn new(width: usize, values: impl IntoIterator<Item = f32>) -> Option<Self> {
        let mut weights: Vec<f32> = values.into_iter().collect();
        if width == 0 || weights.is_empty() || !weights.len().is_multiple_of(width) {
            return None;
        }
        let height = weights.len() / width;
        for (row, values) in weights.chunks_exact_mut(width).enumerate() {
            let sine = (PI * (row as f64 + 0.5) / height as f64).sin() as f32;
            values.iter_mut().for_each(|value| *value *= sine);
        }
        let mut masses = Vec::with_capacity(width * (height + 1));
        for row in 0..=height {
            let (above, below) = (row.saturating_sub(1), row.min(height - 1));
            let size = if row == 0 || row == height { 0.5 } else { 1.0 };
            for column in 0..width {
                let next = (column + 1) % width;
                let corner = |row: usize, column: usize| f64::from(weights[row * width + column]);
                let sum =
                    corner(above, column) + corner(above, next) + corner(below, column) + corner(below, next);
                masses.push(0.25 * sum * size);
            }
        }
        let cells = Distribution2D::new(&masses, width)?;
        let scale = (width * height) as f64 / cells.total();
        scale.is_finite().then_some(Self { width, height, weights, cells, scale })
    }

    /// Samples a direction and its density per solid angle; `None` for the few numbers that map to a pole.
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let ((row, column), _, rest) = self.cells.sample(u);
        let (above, below) = (row.saturating_sub(1), row.min(self.height - 1));
        let next = (column + 1) % self.width;
        let corner = |row: usize, column: usize| self.weights[row * self.width + column];
        let [a, b, c, d] =
            [corner(above, column), corner(above, next), corner(below, column), corner(below, next)];
        let y = sample_linear(rest.x, a + b, c + d);
        let (left, right) = (a + (c - a) * y, b + (d - b) * y);
        let x = sample_linear(rest.y, left, right);
        let weight = left + (right - left) * x;
        // The first row of cells starts at the pole, the others at the centres of the table's rows.
        let (start, size) = match row {
            0 => (0.0, 0.5),
            _ if row == self.height => (row as f64 - 0.5, 0.5),
            _ => (row as f64 - 0.5, 1.0),
        };
        let v = (start + size * f64::from(y)) / self.height as f64;
        let across = (column as f64 + 0.5 + f64::from(x)) / self.width as f64;
        let (direction, sine) = square_to_direction(across, v);
        let pdf = self.per_solid_angle(weight, sine);
        (pdf > 0.0 && pdf.is_finite()).then_some((direction, pdf))
    }

    /// Density per solid angle of a unit direction, 1/sr.
    pub fn pdf_solid_angle(&self, direction: Vec3) -> f32 {
        let corners = Corners::of(direction_to_square(direction), self.width, self.height);
        let weight: f32 =
            corners.indices.iter().zip(corners.weights()).map(|(&i, w)| self.weights[i] * w).sum();
        self.per_solid_angle(weight, f64::from(direction.x.hypot(direction.z)))
    }

    #[inline]
    fn per_solid_angle(&self, weight: f32, sine: f64) -> f32 {
        // The unit square is 2 pi by pi radians.
        (f64::from(weight) * self.scale / (TAU * PI * sine)) as f32
    }
}

/// Samples a number in `[0, 1)` with a density linear from `a` to `b`, which are non-negative and not both zero.
#[inline]
fn sample_linear(u: f32, a: f32, b: f32) -> f32 {
    let (a, b) = (f64::from(a), f64::from(b));
    let u = f64::from(u);
    let root = (a * a + u * (b * b - a * a)).max(0.0).sqrt();
    let x = u * (a + b) / (a + root);
    // The quotient is zero over zero where `u` and `a` are zero; `max` turns NaN into zero.
    (x.max(0.0) as f32).min(ONE_MINUS_EPSILON)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    fn table() -> (usize, Vec<f32>) {
        let mut values = vec![0.1; 16 * 8];
        // A strong small source, black cells, and a positive value at a pole.
        values[3 * 16 + 15] = 40.0;
        values[4 * 16 + 5] = 0.0;
        values[4 * 16 + 6] = 0.0;
        values[5 * 16 + 5] = 0.0;
        values[5 * 16 + 6] = 0.0;
        values[7] = 3.0;
        (16, values)
    }

    #[test]
    fn directions_lead_back_to_the_square() {
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for _ in 0..10_000 {
            let u = rng.next_2d();
            let (direction, sine) = square_to_direction(f64::from(u.x), f64::from(u.y));
            assert!((direction.length() - 1.0).abs() < 1e-6);
            let back = direction_to_square(direction);
            assert!((back.y - u.y).abs() < 1e-6 && ((back.x - u.x).abs() * sine as f32) < 1e-6, "{u} {back}");
        }
        assert_eq!(direction_to_square(Vec3::NEG_Z), Vec2::splat(0.5));
        assert_eq!(direction_to_square(Vec3::X), Vec2::new(0.75, 0.5));
        assert_eq!(direction_to_square(Vec3::Y).y, 0.0);
        assert_eq!(direction_to_square(Vec3::NEG_Y).y, 1.0);
        assert!(direction_to_square(Vec3::new(-1e-9, 0.0, 1.0)).x < 1e-6);
    }

    /// Directions fall into bins as often as the density predicts (chi-square test), the density of a sample equals the evaluated density,
    /// and the density integrates to one.
    #[test]
    fn samples_follow_the_density() {
        let (width, values) = table();
        let density = SphereDensity::new(width, values).unwrap();
        let mut rng = Rng::new(2, Stream::Measure, 0);
        const BINS: (usize, usize) = (48, 24);
        let bin = |direction: Vec3| {
            let u = direction_to_square(direction);
            let (x, y) = ((u.x * BINS.0 as f32) as usize, (u.y * BINS.1 as f32) as usize);
            y.min(BINS.1 - 1) * BINS.0 + x.min(BINS.0 - 1)
        };
        // Expected shares from the mean density over a fine grid in each bin.
        let mut expected = vec![0.0; BINS.0 * BINS.1];
        const FINE: usize = 24;
        for y in 0..BINS.1 * FINE {
            for x in 0..BINS.0 * FINE {
                let at = |i: usize, n: usize| (i as f64 + 0.5) / (n * FINE) as f64;
                let (direction, sine) = square_to_direction(at(x, BINS.0), at(y, BINS.1));
                let area = TAU * PI * sine / (BINS.0 * BINS.1 * FINE * FINE) as f64;
                expected[bin(direction)] += f64::from(density.pdf_solid_angle(direction)) * area;
            }
        }
        let total: f64 = expected.iter().sum();
        assert!((total - 1.0).abs() < 1e-3, "{total}");
        let n = 400_000;
        let mut counts = vec![0u32; expected.len()];
        let mut none = 0;
        for _ in 0..n {
            let Some((direction, pdf)) = density.sample(rng.next_2d()) else {
                none += 1;
                continue;
            };
            let evaluated = density.pdf_solid_angle(direction);
            assert!((pdf / evaluated - 1.0).abs() < 2e-3, "{pdf} {evaluated} {direction}");
            counts[bin(direction)] += 1;
        }
        assert!(none < 10);
        let (mut statistic, mut bins, mut rest) = (0.0, 0, (0.0, 0u32));
        for (&count, &share) in counts.iter().zip(&expected) {
            let want = share * f64::from(n);
            if want < 10.0 {
                rest = (rest.0 + want, rest.1 + count);
                continue;
            }
            statistic += (f64::from(count) - want).powi(2) / want;
            bins += 1;
        }
        assert!((f64::from(rest.1) - rest.0).abs() < 4.0 * rest.0.sqrt() + 4.0, "{rest:?}");
        let freedom = f64::from(bins - 1);
        assert!((statistic - freedom).abs() < 4.0 * (2.0 * freedom).sqrt(), "{statistic} of {freedom}");
    }

    /// Every direction in which a function interpolated from the table is positive can be sampled.
    #[test]
    fn positive_where_the_function_is() {
        let (width, values) = table();
        let density = SphereDensity::new(width, values.iter().copied()).unwrap();
        let mut rng = Rng::new(3, Stream::Measure, 0);
        let mut black = 0;
        for _ in 0..100_000 {
            let direction = warp::square_to_sphere(rng.next_2d());
            let corners = Corners::of(direction_to_square(direction), width, values.len() / width);
            let value: f32 = corners.indices.iter().zip(corners.weights()).map(|(&i, w)| values[i] * w).sum();
            black += u32::from(value == 0.0);
            assert_eq!(value > 0.0, density.pdf_solid_angle(direction) > 0.0);
        }
        assert!(black > 100);
    }

    #[test]
    fn refuses_what_is_no_density() {
        assert!(SphereDensity::new(0, [1.0]).is_none());
        assert!(SphereDensity::new(2, []).is_none());
        assert!(SphereDensity::new(2, [0.0; 4]).is_none());
        assert!(SphereDensity::new(2, [1.0; 3]).is_none());
        assert!(SphereDensity::new(2, [1.0, f32::NAN, 0.0, 0.0]).is_none());
        assert!(SphereDensity::new(1, [1.0]).is_some());
    }
}
