//! Adaptive antialiasing: the number of camera samples of a pixel depends on the variance around it (Jensen & Christensen 1995,
//! section 5; after Whitted 1980 and Lee, Redner & Uselton 1985).
//!
//! There are two stages. First, every pixel of the picture takes a few samples, the *pilot*. Then the other samples are distributed in
//! proportion to the relative standard deviation. The deviation of a pixel comes from the pilots of its *eight neighbours* and not from
//! its own. With its own pilot, a pixel whose first samples happen to agree would get no more, and the picture would be too dark where
//! rare samples are bright. So the number of a pixel's samples does not depend on their values, and their plain mean is unbiased. The
//! only dependence left is through the sum over all pixels that normalizes the counts, in which each pixel is one of many.

use crate::sampling::mix;

/// Luminance, over the mean of the picture, above which differences count relatively. Its square is the 0.01 in the error figures of
/// this project.
const DARK: f64 = 0.1;

/// Share of the mean deviation that is added to every pixel, so that features which no pilot sample hit can still be found.
const FLOOR: f64 = 0.1;

/// No pixel gets more than this many times the mean number of samples.
const MOST: f64 = 16.0;

/// Pilot samples of every pixel: a quarter of the mean number, and at least two.
pub(super) fn pilot_samples(spp: u32) -> u32 {
    (spp / 4).max(2).min(spp)
}

/// Sums of the luminance of a pixel's samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    sum: f64,
    squares: f64,
    count: f64,
}

impl Moments {
    /// Adds a sample. A sample that is not finite is left out, as the film does.
    pub(super) fn add(&mut self, luminance: f64) {
        if luminance.is_finite() {
            self.sum += luminance;
            self.squares += luminance * luminance;
            self.count += 1.0;
        }
    }

    fn mean(&self) -> f64 {
        if self.count > 0.0 { self.sum / self.count } else { 0.0 }
    }

    /// Standard deviation over the root of the squared mean plus the square of `dark`; zero for fewer than two samples.
    fn relative_deviation(&self, dark: f64) -> f64 {
        if self.count < 2.0 {
            return 0.0;
        }
        let mean = self.mean();
        let variance = ((self.squares - self.sum * mean) / (self.count - 1.0)).max(0.0);
        let relative = (variance / (mean * mean + dark * dark)).sqrt();
        if relative.is_finite() { relative } else { 0.0 }
    }
}

/// Number of samples of each pixel of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleCounts {
    width: u32,
    counts: Vec<u32>,
}

impl SampleCounts {
    /// Distributes `spp` samples per pixel on average, with at least `pilot` for each pixel. `moments` are those of the pilots, row by row.
    pub(super) fn share_out(moments: &[Moments], width: u32, (pilot, spp): (u32, u32), seed: u64) -> Self {
        let pixels = moments.len();
        let mean = moments.iter().map(Moments::mean).sum::<f64>() / pixels as f64;
        let own: Vec<f64> = moments.iter().map(|m| m.relative_deviation(DARK * mean)).collect();
        let mut around: Vec<f64> =
            (0..pixels).map(|index| of_neighbours(&own, width as usize, index)).collect();
        let floor = FLOOR * around.iter().sum::<f64>() / pixels as f64;
        around.iter_mut().for_each(|deviation| *deviation += floor);
        let (least, most) = (f64::from(pilot), MOST * f64::from(spp));
        let wanted = |factor: f64, deviation: f64| (factor * deviation).clamp(least, most.max(least));
        let total = |factor: f64| around.iter().map(|&deviation| wanted(factor, deviation)).sum::<f64>();
        let budget = f64::from(spp) * pixels as f64;
        let factor = bisect(total, budget);
        let count = |(index, &deviation): (usize, &f64)| {
            let exact = match factor {
                Some(factor) => wanted(factor, deviation),
                // No pixel has any variance.
                None => f64::from(spp),
            };
            // Random rounding up or down keeps the requested mean.
            let u = (mix(mix(seed ^ 0x6164_6170_7469_7665) ^ index as u64) >> 40) as f64 / 16_777_216.0;
            (exact + u).floor() as u32
        };
        Self { width, counts: around.iter().enumerate().map(count).collect() }
    }

    /// Samples of pixel `(x, y)`.
    pub fn at(&self, x: u32, y: u32) -> u32 {
        self.counts[y as usize * self.width as usize + x as usize]
    }

    /// Fewest, most and mean.
    pub fn summary(&self) -> (u32, u32, f64) {
        let fewest = self.counts.iter().copied().min().unwrap_or(0);
        let most = self.counts.iter().copied().max().unwrap_or(0);
        let sum: u64 = self.counts.iter().map(|&n| u64::from(n)).sum();
        (fewest, most, sum as f64 / self.counts.len().max(1) as f64)
    }
}

/// The factor at which the non-decreasing function `total` reaches `budget`; `None` where it never does.
fn bisect(total: impl Fn(f64) -> f64, budget: f64) -> Option<f64> {
    let mut high = 1.0;
    while total(high) < budget {
        high *= 2.0;
        if !(high < 1e30) {
            return None;
        }
    }
    let mut low = 0.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if total(middle) < budget { low = middle } else { high = middle }
    }
    Some(high)
}

/// Mean of `values` over the neighbours of a pixel, eight at most; its own value where it has no neighbours.
fn of_neighbours(values: &[f64], width: usize, index: usize) -> f64 {
    let (x, y, height) = (index % width, index / width, values.len() / width);
    let (mut sum, mut count) = (0.0, 0.0);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for column in x.saturating_sub(1)..(x + 2).min(width) {
            if (column, row) != (x, y) {
                sum += values[row * width + column];
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { values[index] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// A picture in which one of ten columns is noisy.
    fn moments(width: u32, height: u32, pilot: u32, seed: u64) -> Vec<Moments> {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        let pixel = |i: u32| {
            let mut moments = Moments::default();
            let noise = if i % width % 10 == 3 { 1.0 } else { 0.02 };
            (0..pilot).for_each(|_| moments.add(1.0 + noise * (rng.next_f64() - 0.5)));
            moments
        };
        (0..width * height).map(pixel).collect()
    }

    #[test]
    fn samples_go_where_noise_is() {
        let counts = SampleCounts::share_out(&moments(50, 40, 2, 1), 50, (2, 8), 3);
        let (fewest, most, mean) = counts.summary();
        assert!(fewest >= 2 && most <= 128 && (mean - 8.0).abs() < 0.1, "{fewest} {most} {mean}");
        let column = |x: u32| (0..40).map(|y| counts.at(x, y)).sum::<u32>();
        assert!(column(3) > 3 * column(7) && column(23) > 3 * column(28), "{} {}", column(3), column(7));
        // The counts are reproducible, and another seed gives another rounding.
        assert_eq!(counts, SampleCounts::share_out(&moments(50, 40, 2, 1), 50, (2, 8), 3));
        assert_ne!(counts, SampleCounts::share_out(&moments(50, 40, 2, 1), 50, (2, 8), 4));
    }

    /// The count of a pixel does not depend on its own pilot, except through the sum over all pixels.
    #[test]
    fn own_samples_do_not_decide() {
        let plain = moments(50, 40, 2, 1);
        let mut changed = plain.clone();
        let index = 20 * 50 + 27;
        changed[index] = Moments::default();
        changed[index].add(1.0);
        changed[index].add(1.3);
        let [before, after] = [plain, changed].map(|m| SampleCounts::share_out(&m, 50, (2, 8), 3));
        assert!(before.at(27, 20).abs_diff(after.at(27, 20)) <= 1);
        assert!(after.at(26, 20) > before.at(26, 20) + 1, "its neighbours get more");
    }

    #[test]
    fn ends() {
        // Cases: no noise, no light, samples that are not finite, one pixel.
        let mut even = Moments::default();
        (0..2).for_each(|_| even.add(1.0));
        let mut bad = Moments::default();
        [f64::NAN, f64::INFINITY].into_iter().for_each(|x| bad.add(x));
        for moments in [vec![even; 12], vec![Moments::default(); 12], vec![bad; 12], vec![even]] {
            let width = if moments.len() == 1 { 1 } else { 4 };
            let counts = SampleCounts::share_out(&moments, width, (2, 8), 0);
            assert_eq!(counts.summary(), (8, 8, 8.0));
        }
        assert_eq!([1, 2, 4, 16, 64].map(pilot_samples), [1, 2, 2, 4, 16]);
        // A scale by a power of two changes nothing.
        let scaled = |factor: f64| {
            let mut all = moments(50, 40, 2, 5);
            for m in &mut all {
                *m = Moments { sum: m.sum * factor, squares: m.squares * factor * factor, count: m.count };
            }
            SampleCounts::share_out(&all, 50, (2, 8), 3)
        };
        assert_eq!(scaled(1.0), scaled(2f64.powi(40)));
    }
}
