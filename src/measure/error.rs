//! Error figures of a picture against a reference.

use super::flip::mean_flip;
use crate::math::{Rgb, luminance};
use serde::Serialize;
use thiserror::Error;

/// An error that prevents the comparison of two pictures.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MeasureError {
    /// The number of values is not three per pixel.
    #[error("{values} values are not {width} x {height} pixels of three channels")]
    Length {
        /// Values given.
        values: usize,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// A picture without pixels.
    #[error("the picture has no pixel")]
    Empty,
    /// The sizes differ.
    #[error("the picture has {} x {} pixels, the reference {} x {}", test.0, test.1, reference.0, reference.1)]
    Size {
        /// Size of the picture.
        test: (u32, u32),
        /// Size of the reference.
        reference: (u32, u32),
    },
    /// The reference has a value that is not finite.
    #[error("the reference is not finite at pixel {x},{y}")]
    Reference {
        /// Column.
        x: u32,
        /// Row.
        y: u32,
    },
}

/// A view of linear RGB: rows from the top, with the three channels interleaved.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    width: u32,
    height: u32,
    values: &'a [f32],
}

impl<'a> Picture<'a> {
    /// A view of `width * height * 3` values.
    pub fn new(width: u32, height: u32, values: &'a [f32]) -> Result<Self, MeasureError> {
        let length = (width as usize).checked_mul(height as usize).and_then(|n| n.checked_mul(3));
        if length == Some(0) {
            return Err(MeasureError::Empty);
        }
        if length != Some(values.len()) {
            return Err(MeasureError::Length { values: values.len(), width, height });
        }
        Ok(Self { width, height, values })
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The values.
    pub fn values(&self) -> &'a [f32] {
        self.values
    }

    /// The pixels, row by row.
    pub(super) fn pixels(&self) -> impl Iterator<Item = Rgb> + use<'a> {
        self.values.chunks_exact(3).map(Rgb::from_slice)
    }
}

/// Reference of a comparison: one picture, or the mean of two that were rendered with independent random numbers.
#[derive(Clone, Debug)]
pub struct Reference {
    width: u32,
    height: u32,
    mean: Vec<f32>,
    halves: Option<[Vec<f32>; 2]>,
    /// Largest luminance in the 5 x 5 pixels around each pixel.
    brightest: Vec<f32>,
}

/// Error figures of a picture t against a reference r with independent halves r1 and r2. Means are over pixels
/// and channels; all sums are `f64`. Pixels of t that are not finite are left out of all figures but `nan` and `flip`;
/// where no pixel is left, the figures are NaN.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorFigures {
    /// `sqrt(mean((t - r)^2))`.
    pub rmse: f64,
    /// `mean((t - r)^2 / (r^2 + 0.01))`.
    pub relmse: f64,
    /// `mean((t - r1) (t - r2) / (r^2 + 0.01))`: the same without the reference's noise, which is independent in r1 and r2. This is the
    /// figure to quote. It may be negative for a picture as good as the reference. `None` where there are no halves.
    pub relmse_u: Option<f64>,
    /// `sqrt(mean((t - r1) (t - r2) / (r^2 + f)))` with f a hundredth of the square of the reference's mean, which makes it
    /// independent of the unit of light. Progressive rendering estimates this error. It is zero where the mean is negative; `None` where
    /// there are no halves.
    pub relrmse_u: Option<f64>,
    /// `relmse` without the 0.1 % of pixels (rounded up) with the largest mean over the channels; NaN for a single pixel.
    pub relmse_t: f64,
    /// Excess of the mean luminance of t over that of r, in percent of the latter; not finite where r is black.
    pub bias: f64,
    /// Share of pixels whose luminance exceeds twice the largest in the reference's 5 x 5 neighbourhood plus 1.
    pub firefly: f64,
    /// Pixels of t with a value that is NaN or infinite.
    pub nan: u64,
    /// Mean LDR-FLIP of the clamped sRGB pictures, in `[0, 1]`.
    pub flip: f64,
}

/// Floor that is added to r^2 in relative errors, so that black pixels count without dominating.
const FLOOR: f64 = 0.01;

impl Reference {
    /// A single picture as reference; its noise counts as error of the compared picture.
    pub fn single(picture: Picture<'_>) -> Result<Self, MeasureError> {
        Self::new(picture, picture.values.to_vec(), None)
    }

    /// Two independent halves of the same picture as reference.
    pub fn halves(first: Picture<'_>, second: Picture<'_>) -> Result<Self, MeasureError> {
        if first.size() != second.size() {
            return Err(MeasureError::Size { test: second.size(), reference: first.size() });
        }
        let both = first.values.iter().zip(second.values);
        let mean = both.map(|(&a, &b)| (0.5 * (f64::from(a) + f64::from(b))) as f32).collect();
        Self::new(first, mean, Some([first.values.to_vec(), second.values.to_vec()]))
    }

    fn new(
        picture: Picture<'_>,
        mean: Vec<f32>,
        halves: Option<[Vec<f32>; 2]>,
    ) -> Result<Self, MeasureError> {
        let (width, height) = picture.size();
        if let Some(i) = mean.iter().position(|v| !v.is_finite()) {
            let pixel = i / 3;
            let (x, y) = (pixel % width as usize, pixel / width as usize);
            return Err(MeasureError::Reference { x: x as u32, y: y as u32 });
        }
        let brightest = brightest_nearby(width as usize, &mean);
        Ok(Self { width, height, mean, halves, brightest })
    }

    /// The reference picture, or the mean of both halves.
    pub fn picture(&self) -> Picture<'_> {
        Picture { width: self.width, height: self.height, values: &self.mean }
    }

    /// Whether `test` is one of the halves: then its `relmse_u` is zero and meaningless.
    pub fn is_half(&self, test: Picture<'_>) -> bool {
        self.halves.iter().flatten().any(|half| half == test.values)
    }

    /// All error figures of `test`.
    pub fn compare(&self, test: Picture<'_>) -> Result<ErrorFigures, MeasureError> {
        self.check_size(test)?;
        // The floor is above zero also where the reference is black.
        let mean = self.mean.iter().map(|&v| f64::from(v).abs()).sum::<f64>() / self.mean.len() as f64;
        let floor = (FLOOR * mean * mean).max(f64::MIN_POSITIVE);
        let mut sums = Sums::default();
        let mut errors = Vec::with_capacity(self.brightest.len());
        for (pixel, (t, r)) in test.pixels().zip(self.picture().pixels()).enumerate() {
            if !t.is_finite() {
                sums.nan += 1;
                continue;
            }
            let halves = self.halves.as_ref().map(|h| h.each_ref().map(|h| Rgb::from_slice(&h[3 * pixel..])));
            errors.push(sums.add(t, r, halves, floor));
            // Computed in f64, as twice the largest f32 overflows f32.
            let limit = 2.0 * f64::from(self.brightest[pixel]) + 1.0;
            sums.fireflies += u64::from(f64::from(luminance(t)) > limit);
        }
        let flip = mean_flip(self.picture(), test)?;
        Ok(sums.figures(self.halves.is_some(), trimmed_mean(errors), flip))
    }

    /// Relative difference of each pixel's luminance, signed: `(t - r) / sqrt(r^2 + 0.01)`. NaN where t is not
    /// finite.
    pub fn differences(&self, test: Picture<'_>) -> Result<Vec<f32>, MeasureError> {
        self.check_size(test)?;
        let difference = |(t, r)| {
            let (t, r) = (f64::from(luminance(t)), f64::from(luminance(r)));
            let relative = (t - r) / (r * r + FLOOR).sqrt();
            if relative.is_finite() { relative as f32 } else { f32::NAN }
        };
        Ok(test.pixels().zip(self.picture().pixels()).map(difference).collect())
    }

    fn check_size(&self, test: Picture<'_>) -> Result<(), MeasureError> {
        let reference = (self.width, self.height);
        if test.size() == reference {
            return Ok(());
        }
        Err(MeasureError::Size { test: test.size(), reference })
    }
}

/// Sums over pixels and channels.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    pixels: u64,
    squared: f64,
    relative: f64,
    unbiased: f64,
    unitless: f64,
    luminance_test: f64,
    luminance_reference: f64,
    fireflies: u64,
    nan: u64,
}

impl Sums {
    /// Adds a pixel and returns its relative squared error, averaged over the channels.
    fn add(&mut self, t: Rgb, r: Rgb, halves: Option<[Rgb; 2]>, floor: f64) -> f64 {
        let (t, r) = (t.as_dvec3(), r.as_dvec3());
        let squared = (t - r) * (t - r);
        let scale = (r * r + FLOOR).recip();
        let relative = (squared * scale).element_sum();
        self.pixels += 1;
        self.squared += squared.element_sum();
        self.relative += relative;
        if let Some([r1, r2]) = halves {
            let product = (t - r1.as_dvec3()) * (t - r2.as_dvec3());
            self.unbiased += (product * scale).element_sum();
            self.unitless += (product / (r * r + floor)).element_sum();
        }
        let weights = glam::DVec3::new(0.2126, 0.7152, 0.0722);
        self.luminance_test += t.dot(weights);
        self.luminance_reference += r.dot(weights);
        relative / 3.0
    }

    fn figures(&self, has_halves: bool, relmse_t: f64, flip: f64) -> ErrorFigures {
        // Without a finite pixel, 0 / 0 makes the figures NaN.
        let values = 3.0 * self.pixels as f64;
        ErrorFigures {
            rmse: (self.squared / values).sqrt(),
            relmse: self.relative / values,
            relmse_u: has_halves.then(|| self.unbiased / values),
            relrmse_u: has_halves.then(|| (self.unitless / values).max(0.0).sqrt()),
            relmse_t,
            bias: 100.0 * (self.luminance_test - self.luminance_reference) / self.luminance_reference,
            firefly: self.fireflies as f64 / self.pixels as f64,
            nan: self.nan,
            flip,
        }
    }
}

/// Mean of `errors` without the largest thousandth (rounded up); NaN where none is left.
fn trimmed_mean(mut errors: Vec<f64>) -> f64 {
    let kept = errors.len() - errors.len().div_ceil(1000);
    errors.sort_unstable_by(f64::total_cmp);
    errors[..kept].iter().sum::<f64>() / kept as f64
}

/// Largest luminance in the 5 x 5 pixels around each pixel, cropped at the picture's edges.
fn brightest_nearby(width: usize, values: &[f32]) -> Vec<f32> {
    let plane: Vec<f32> = values.chunks_exact(3).map(|p| luminance(Rgb::from_slice(p))).collect();
    let height = plane.len() / width;
    let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(f32::NEG_INFINITY, f32::max);
    let near = |i: usize, end: usize| i.saturating_sub(2)..(i + 3).min(end);
    let rows: Vec<f32> = (0..plane.len())
        .map(|i| {
            let (x, row) = (i % width, &plane[i - i % width..][..width]);
            largest(&mut near(x, width).map(|x| row[x]))
        })
        .collect();
    (0..plane.len())
        .map(|i| largest(&mut near(i / width, height).map(|y| rows[y * width + i % width])))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 x 30 pixels of smooth colour, and halves that differ from it by +d and -d.
    fn halves(d: f32) -> [Vec<f32>; 3] {
        let smooth: Vec<f32> = (0..3600).map(|i| 0.5 + 0.4 * (i as f32 * 0.01).sin()).collect();
        let half = |d: f32| smooth.iter().enumerate().map(|(i, v)| v + d * [1.0, -1.0][i % 2]).collect();
        [half(d), half(-d), smooth.clone()]
    }

    fn picture(values: &[f32]) -> Picture<'_> {
        Picture::new(40, 30, values).unwrap()
    }

    #[test]
    fn noise_of_the_reference_leaves_the_unbiased_figure() {
        let [first, second, smooth] = halves(0.125);
        let reference = Reference::halves(picture(&first), picture(&second)).unwrap();
        // For a picture without error the product of the halves' errors is -d^2; for independent noise it would be zero.
        let figures = reference.compare(picture(&smooth)).unwrap();
        assert!(figures.rmse < 1e-7 && figures.relmse < 1e-13 && figures.bias.abs() < 1e-5);
        let want: f64 =
            smooth.iter().map(|&r| -0.015_625 / (f64::from(r).powi(2) + FLOOR)).sum::<f64>() / 3600.0;
        assert!((figures.relmse_u.unwrap() / want - 1.0).abs() < 1e-5);
        assert_eq!(
            Reference::single(picture(&smooth)).unwrap().compare(picture(&smooth)).unwrap().relmse_u,
            None
        );
    }

    #[test]
    fn known_figures() {
        let reference = vec![1.0; 3600];
        let mut test = vec![1.5; 3600];
        let r = Reference::single(picture(&reference)).unwrap();
        let figures = r.compare(picture(&test)).unwrap();
        assert!((figures.rmse - 0.5).abs() < 1e-12 && (figures.bias - 50.0).abs() < 1e-9);
        assert!(
            (figures.relmse - 0.25 / 1.01).abs() < 1e-12 && (figures.relmse_t - figures.relmse).abs() < 1e-12
        );
        // The limit of a firefly is 2 * 1 + 1. The trimmed figure leaves out two of 1200 pixels.
        test[..3].fill(3.01);
        test[300..303].fill(1e30);
        test[600..603].fill(2.99);
        let figures = r.compare(picture(&test)).unwrap();
        assert_eq!(figures.firefly, 2.0 / 1200.0);
        let want = (1197.0 * 0.25 + f64::from(1.99f32).powi(2)) / 1.01 / 1198.0;
        assert!((figures.relmse_t / want - 1.0).abs() < 1e-6, "{} {want}", figures.relmse_t);
        assert!((figures.rmse / (1e60f64 / 1200.0).sqrt() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_neighbourhood_of_a_firefly_is_5_by_5() {
        let mut reference = vec![0.0; 3600];
        let mut test = vec![0.0; 3600];
        let at = |x: usize, y: usize| (y * 40 + x) * 3..(y * 40 + x) * 3 + 3;
        reference[at(20, 10)].fill(10.0);
        for (x, y) in [(18, 8), (22, 12), (18, 12), (23, 10), (20, 13), (17, 10), (20, 7)] {
            test[at(x, y)].fill(5.0);
        }
        let figures = Reference::single(picture(&reference)).unwrap().compare(picture(&test)).unwrap();
        assert_eq!(figures.firefly, 4.0 / 1200.0);
    }

    #[test]
    fn pixels_that_are_not_finite_are_counted() {
        let [_, _, smooth] = halves(0.0);
        let mut test = smooth.clone();
        (test[0], test[1], test[3], test[9]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::NAN);
        let reference = Reference::single(picture(&smooth)).unwrap();
        let figures = reference.compare(picture(&test)).unwrap();
        assert_eq!((figures.nan, figures.rmse, figures.relmse_t), (3, 0.0, 0.0));
        assert!(figures.flip > 0.0 && figures.flip < 0.1);
        assert!(reference.differences(picture(&test)).unwrap()[0].is_nan());
        let nothing = reference.compare(picture(&vec![f32::NAN; 3600])).unwrap();
        assert_eq!(nothing.nan, 1200);
        assert!(nothing.rmse.is_nan() && nothing.relmse_t.is_nan() && nothing.bias.is_nan());
        assert_eq!(Reference::single(picture(&test)).err(), Some(MeasureError::Reference { x: 0, y: 0 }));
    }

    #[test]
    fn pictures_that_do_not_fit() {
        let values = vec![0.0; 12];
        assert!(matches!(Picture::new(2, 3, &values), Err(MeasureError::Length { .. })));
        assert!(matches!(Picture::new(0, 3, &[]), Err(MeasureError::Empty)));
        let a = Picture::new(2, 2, &values).unwrap();
        let b = Picture::new(4, 1, &values).unwrap();
        assert!(matches!(Reference::halves(a, b), Err(MeasureError::Size { .. })));
        assert!(matches!(Reference::single(a).unwrap().compare(b), Err(MeasureError::Size { .. })));
    }
}
