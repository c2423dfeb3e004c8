//! Error figures of a cell from renders with several seeds, and comparisons between cells.

use crate::measure::{MeasureError, Picture};
use serde::Serialize;

/// Relative errors of a cell: roots of means over pixels and channels of squares over r^2 + f, with f a hundredth of the square of the
/// reference's mean (the error of `--target-error`). All are free of the reference's noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SeedFigures {
    /// Error of a picture with one seed.
    pub error: f64,
    /// Standard error of [`Self::error`], from the spread over seeds; NaN for one seed.
    pub uncertainty: f64,
    /// Noise: deviation of a picture from the mean over seeds. NaN for one seed.
    pub noise: f64,
    /// Bias: error of the mean over all seeds. Zero where it is lost in the noise, NaN for one seed.
    pub bias: f64,
}

/// Share of the pixels that [`Compared::but_worst`] leaves out.
pub const WORST_SHARE: f64 = 0.003;

/// Comparison of the pictures of one cell with the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Compared {
    /// Figures of all pixels.
    pub all: SeedFigures,
    /// Figures without the [`WORST_SHARE`] of pixels with the largest error in any of the pictures. Where paths hit something small and
    /// bright by chance, such as an emitter seen through glass, few pixels cause nearly all of the error. Neither these pictures nor the
    /// reference are reliable there.
    pub but_worst: SeedFigures,
}

/// Compares pictures of one size that differ in their seeds with the two halves of a reference.
///
/// # Errors
/// If sizes differ, or a half is not finite.
pub fn figures(seeds: &[Picture<'_>], halves: [Picture<'_>; 2]) -> Result<Compared, MeasureError> {
    let size = halves[0].size();
    for picture in seeds.iter().chain(&halves[1..]) {
        if picture.size() != size {
            return Err(MeasureError::Size { test: picture.size(), reference: size });
        }
    }
    let [a, b] = halves.map(|half| half.values());
    if let Some(at) = a.iter().zip(b).position(|(a, b)| !(a.is_finite() && b.is_finite())) {
        let pixel = at as u32 / 3;
        return Err(MeasureError::Reference { x: pixel % size.0, y: pixel / size.0 });
    }
    let pixels: Vec<usize> = (0..a.len() / 3).collect();
    let all = of_pixels(seeds, [a, b], &pixels);
    let floor = floor_of([a, b]);
    let off = |&pixel: &usize| (worst(seeds, [a, b], floor, pixel), pixel);
    let mut by_error: Vec<(f64, usize)> = pixels.iter().map(off).collect();
    by_error.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    by_error.truncate(((1.0 - WORST_SHARE) * pixels.len() as f64).floor().max(1.0) as usize);
    let mut kept: Vec<usize> = by_error.into_iter().map(|(_, pixel)| pixel).collect();
    kept.sort_unstable();
    Ok(Compared { all, but_worst: of_pixels(seeds, [a, b], &kept) })
}

/// Floor of relative errors, which keeps them finite in dark regions.
fn floor_of([a, b]: [&[f32]; 2]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(&a, &b)| 0.5 * (f64::from(a) + f64::from(b)).abs()).sum();
    let mean = sum / a.len() as f64;
    (0.01 * mean * mean).max(f64::MIN_POSITIVE)
}

/// Largest squared relative error of a pixel over all pictures.
fn worst(seeds: &[Picture<'_>], [a, b]: [&[f32]; 2], floor: f64, pixel: usize) -> f64 {
    let mut worst = 0.0f64;
    for i in 3 * pixel..3 * pixel + 3 {
        let whole = 0.5 * (f64::from(a[i]) + f64::from(b[i]));
        for seed in seeds {
            let square = (f64::from(seed.values()[i]) - whole).powi(2) / (whole * whole + floor);
            // NaN counts as the largest error.
            worst = if square.is_nan() { f64::INFINITY } else { worst.max(square) };
        }
    }
    worst
}

fn of_pixels(seeds: &[Picture<'_>], [a, b]: [&[f32]; 2], pixels: &[usize]) -> SeedFigures {
    let values = 3.0 * pixels.len() as f64;
    let whole = |i: usize| 0.5 * (f64::from(a[i]) + f64::from(b[i]));
    let floor = floor_of([a, b]);
    let count = seeds.len() as f64;
    let mut squares = vec![0.0; seeds.len()];
    let mut variance = 0.0;
    for i in pixels.iter().flat_map(|&pixel| 3 * pixel..3 * pixel + 3) {
        let weight = (whole(i).powi(2) + floor).recip();
        let of_seeds = || seeds.iter().map(|seed| f64::from(seed.values()[i]));
        let centre = of_seeds().sum::<f64>() / count;
        for (square, t) in squares.iter_mut().zip(of_seeds()) {
            *square += (t - f64::from(a[i])) * (t - f64::from(b[i])) * weight / values;
            variance += (t - centre).powi(2) * weight / values / (count - 1.0);
        }
    }
    let square = squares.iter().sum::<f64>() / count;
    let spread = squares.iter().map(|s| (s - square).powi(2)).sum::<f64>() / (count - 1.0) / count;
    let error = square.max(0.0).sqrt();
    SeedFigures {
        error,
        // The relative error of a root is half of that of its square.
        uncertainty: 0.5 * spread.sqrt() / error.max(f64::MIN_POSITIVE),
        noise: variance.sqrt(),
        bias: if variance.is_nan() { f64::NAN } else { (square - variance).max(0.0).sqrt() },
    }
}

/// Remaining noise in the mean of two halves of a reference, relative as in [`SeedFigures`].
pub fn reference_noise(halves: [Picture<'_>; 2]) -> f64 {
    let [a, b] = halves.map(|half| half.values());
    let pairs = || a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b)));
    let count = a.len() as f64;
    let mean = pairs().map(|(a, b)| 0.5 * (a + b).abs()).sum::<f64>() / count;
    let floor = (0.01 * mean * mean).max(f64::MIN_POSITIVE);
    let square = |(a, b): (f64, f64)| 0.25 * (a - b).powi(2) / (0.25 * (a + b).powi(2) + floor);
    (pairs().map(square).sum::<f64>() / count).sqrt()
}

/// Pareto front: indices of the (time, error) points that no other beats in both, sorted by time.
pub fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].0 > 0.0 && points[i].1 > 0.0).collect();
    order.sort_by(|&i, &j| points[i].0.total_cmp(&points[j].0).then(points[i].1.total_cmp(&points[j].1)));
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let is_better = points[i].1 < best;
        best = best.min(points[i].1);
        is_better
    });
    order
}

/// Ratio of this point's error to that of the front at the same time, with logarithmic interpolation between the points of the front. It is
/// 1 on the front; beyond its ends, the first or last point is used.
pub fn distance_to_front(points: &[(f64, f64)], front: &[usize], point: (f64, f64)) -> f64 {
    let log = |i: usize| (points[i].0.ln(), points[i].1.ln());
    let time = point.0.ln();
    let after = front.partition_point(|&i| log(i).0 <= time);
    let best = match (after.checked_sub(1).map(|i| log(front[i])), front.get(after).map(|&i| log(i))) {
        (Some(before), Some(next)) => {
            before.1 + (next.1 - before.1) * (time - before.0) / (next.0 - before.0)
        }
        (Some(only), None) | (None, Some(only)) => only.1,
        (None, None) => return 1.0,
    };
    (point.1.ln() - best).exp()
}

/// Number of rounds at which progressive rendering reaches an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Rounds; between rendered numbers of rounds they are interpolated by a power law.
    pub rounds: f64,
    /// Processor seconds of these rounds.
    pub cpu: f64,
    /// Basis of the values.
    pub known: CrossingKnown,
}

/// Basis of a [`Crossing`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrossingKnown {
    /// The fewest rendered rounds already have a smaller error.
    AtMost,
    /// The error lies between those of rendered rounds.
    Between,
    /// The most rendered rounds still have a larger error. The values are extrapolated with the slope of the last two (log error over log
    /// rounds).
    Beyond(f64),
}

/// Largest usable slope. The noise of flatter slopes is as large as the slope, so they do not support an extrapolation.
const LEAST_SLOPE: f64 = -0.1;

/// The crossing at which rounds, given as (rounds, processor seconds, error) sorted by rounds, reach `error`. `None` where it cannot be
/// determined: without rounds, with a single worse entry, or where the error does not fall.
pub fn crossing(rounds: &[(f64, f64, f64)], error: f64) -> Option<Crossing> {
    let first = rounds.first()?;
    if first.2 <= error {
        return Some(Crossing { rounds: first.0, cpu: first.1, known: CrossingKnown::AtMost });
    }
    let pair = rounds.windows(2).find(|pair| pair[1].2 <= error);
    let (from, to) = match (pair, rounds) {
        (Some(pair), _) => (pair[0], pair[1]),
        (None, [.., from, to]) => (*from, *to),
        _ => return None,
    };
    let slope = (to.2 / from.2).ln() / (to.0 / from.0).ln();
    if !(slope < LEAST_SLOPE && error > 0.0) {
        return None;
    }
    let along = (error / from.2).ln() / slope / (to.0 / from.0).ln();
    let power = |from: f64, to: f64| from * (to / from).powf(along);
    let known = if pair.is_some() { CrossingKnown::Between } else { CrossingKnown::Beyond(slope) };
    Some(Crossing { rounds: power(from.0, to.0), cpu: power(from.1, to.1), known })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn noise_and_bias_of_seeds() {
        let mut rng = Rng::new(3, Stream::Measure, 0);
        let mut noisy = |mean: f64, deviation: f64| -> Vec<f32> {
            let mut value = || mean + deviation * 12f64.sqrt() * (rng.next_f64() - 0.5);
            (0..3 * 64 * 64).map(|_| value() as f32).collect()
        };
        // The reference is noisier here, so weights that depend on its noise would show.
        let halves = [noisy(2.0, 0.1), noisy(2.0, 0.1)];
        let pictures: Vec<_> = (0..4).map(|_| noisy(2.2, 0.4)).collect();
        let view = |values| Picture::new(64, 64, values).unwrap();
        let seeds: Vec<_> = pictures.iter().map(|p| view(p)).collect();
        let found = figures(&seeds, [view(&halves[0]), view(&halves[1])]).unwrap().all;
        let unit = 4.04f64.sqrt();
        assert!((found.bias * unit - 0.2).abs() < 0.02, "{found:?}");
        assert!((found.noise * unit - 0.4).abs() < 0.02, "{found:?}");
        assert!((found.error.powi(2) - found.noise.powi(2) - found.bias.powi(2)).abs() < 1e-9);
        assert!(found.uncertainty > 0.0 && found.uncertainty < 0.01, "{found:?}");
        let one = figures(&seeds[..1], [view(&halves[0]), view(&halves[1])]).unwrap().all;
        assert!(one.noise.is_nan() && one.bias.is_nan() && one.error > 0.0);
    }

    #[test]
    fn glints_are_left_out_of_one_of_the_two() {
        let flat = vec![1.0f32; 3 * 64 * 64];
        let with = |places: &[usize]| {
            let mut values = vec![1.1f32; 3 * 64 * 64];
            places.iter().for_each(|&at| values[at] = 1000.0);
            values
        };
        let pictures = [with(&[5, 6, 700]), with(&[9000]), with(&[])];
        let view = |values| Picture::new(64, 64, values).unwrap();
        let seeds: Vec<_> = pictures.iter().map(|p| view(p)).collect();
        let Compared { all, but_worst } = figures(&seeds, [view(&flat), view(&flat)]).unwrap();
        assert!(
            all.error > 5.0 && (but_worst.error * 1.01f64.sqrt() - 0.1).abs() < 1e-6,
            "{all:?} {but_worst:?}"
        );
        assert!(but_worst.noise < 1e-9);
    }

    #[test]
    fn what_nothing_beats() {
        let points =
            [(1.0, 0.5), (2.0, 0.6), (2.0, 0.2), (3.0, 0.2), (8.0, 0.1), (0.0, 0.01), (4.0, f64::NAN)];
        let front = front(&points);
        assert_eq!(front, [0, 2, 4]);
        let distance = |point| distance_to_front(&points, &front, point);
        assert!((distance((2.0, 0.6)) - 3.0).abs() < 1e-12);
        assert!((distance((4.0, 0.2f64.sqrt() * 0.1f64.sqrt())) - 1.0).abs() < 1e-12);
        assert!((distance((100.0, 0.3)) - 3.0).abs() < 1e-12 && (distance((0.5, 0.5)) - 1.0).abs() < 1e-12);
        assert_eq!(distance_to_front(&points, &[], (1.0, 1.0)), 1.0);
    }

    #[test]
    fn rounds_cross_what_they_come_down_to() {
        // The error falls with the root of the rounds, and time is proportional to rounds.
        let rounds = [4.0, 16.0, 64.0].map(|n: f64| (n, 2.0 * n, 0.2 / n.sqrt()));
        let found = crossing(&rounds, 0.2 / 6.0).unwrap();
        assert!((found.rounds - 36.0).abs() < 1e-9 && (found.cpu - 72.0).abs() < 1e-9, "{found:?}");
        assert_eq!(found.known, CrossingKnown::Between);
        let found = crossing(&rounds, 0.02).unwrap();
        assert!((found.rounds - 100.0).abs() < 1e-9 && (found.cpu - 200.0).abs() < 1e-9, "{found:?}");
        assert!(matches!(found.known, CrossingKnown::Beyond(slope) if (slope + 0.5).abs() < 1e-9));
        let found = crossing(&rounds, 0.5).unwrap();
        assert_eq!((found.rounds, found.cpu, found.known), (4.0, 8.0, CrossingKnown::AtMost));
        assert_eq!(crossing(&rounds[..1], 0.01), None);
        assert_eq!(crossing(&[], 0.01), None);
        assert_eq!(crossing(&[(4.0, 8.0, 0.1), (16.0, 32.0, 0.1)], 0.05), None);
        assert_eq!(crossing(&[(4.0, 8.0, 0.1), (16.0, 32.0, f64::NAN)], 0.05), None);
    }
}
