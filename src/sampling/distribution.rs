//! Piecewise-constant distributions over tables of weights.

use glam::Vec2;

/// A piecewise-constant distribution over the indices of a table of non-negative weights.
#[derive(Clone, Debug)]
pub struct Distribution1D {
    /// Cumulative weight up to and including each entry; the last one is the total.
    cumulative: Vec<f64>,
    /// Index of the last positive weight.
    last_positive: usize,
}

impl Distribution1D {
    /// A distribution proportional to `weights`; `None` where there is no positive weight, or one is negative or
    /// not finite.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut total = 0.0;
        let mut cumulative = Vec::new();
        let mut last_positive = 0;
        for weight in weights {
            if !(weight >= 0.0 && weight.is_finite()) {
                return None;
            }
            // Not `weight > 0.0`: a weight that is lost in rounding has no interval of its own.
            if total + weight > total {
                last_positive = cumulative.len();
            }
            total += weight;
            cumulative.push(total);
        }
        (total > 0.0 && total.is_finite()).then_some(Self { cumulative, last_positive })
    }

    /// Number of entries.
    #[allow(clippy::len_without_is_empty, reason = "never empty: there is a positive weight")]
    pub fn len(&self) -> usize {
        self.cumulative.len()
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        *self.cumulative.last().unwrap_or(&0.0)
    }

    /// Samples an index with probability proportional to its weight, for `u` in `[0, 1)`. Returns the index, its probability, and the
    /// remainder of `u`, which is again uniform in `[0, 1)`. It never returns an index of zero weight.
    ///
    /// `u` is an `f64`: the 24 digits of an `f32` do not resolve a million entries, and leave no digits for the remainder.
    /// [`super::refined`] provides such a number.
    #[inline]
    pub fn sample(&self, u: f64) -> (usize, f32, f32) {
        let target = u * self.total();
        let index = self.cumulative.partition_point(|&c| c <= target).min(self.last_positive);
        let low = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let weight = self.cumulative[index] - low;
        let rest = ((target - low) / weight) as f32;
        (index, (weight / self.total()) as f32, rest.clamp(0.0, super::ONE_MINUS_EPSILON))
    }

    /// Probability of `index`.
    pub fn probability(&self, index: usize) -> f32 {
        let low = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        ((self.cumulative[index] - low) / self.total()) as f32
    }
}

/// A piecewise-constant distribution over the unit square, on cells of equal size.
#[derive(Clone, Debug)]
pub struct Distribution2D {
    /// Distribution over columns.
    marginal: Distribution1D,
    /// Distributions over rows, by column; `None` for columns without weight.
    conditional: Vec<Option<Distribution1D>>,
}

impl Distribution2D {
    /// A distribution proportional to the `weights` of cells, column after column of `rows` each; `None` as for
    /// [`Distribution1D::new`].
    pub fn new(weights: &[f64], rows: usize) -> Option<Self> {
        let columns = weights.chunks_exact(rows);
        let marginal = Distribution1D::new(columns.clone().map(|column| column.iter().sum()))?;
        let conditional = columns.map(|column| Distribution1D::new(column.iter().copied())).collect();
        Some(Self { marginal, conditional })
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.marginal.total()
    }

    /// Samples a cell with probability proportional to its weight. Returns its column and row, its probability, and the remainder of `u`,
    /// which is again uniform over the unit square. The stratification of `u` in both coordinates is kept.
    #[inline]
    pub fn sample(&self, u: Vec2) -> ((usize, usize), f32, Vec2) {
        let (column, p, x) = self.marginal.sample(f64::from(u.x));
        match &self.conditional[column] {
            Some(rows) => {
                let (row, q, y) = rows.sample(f64::from(u.y));
                ((column, row), p * q, Vec2::new(x, y))
            }
            // Unreachable: a column without weight is never sampled.
            None => ((column, 0), 0.0, Vec2::new(x, u.y)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_match_weights() {
        let weights = [0.0, 1.0, 3.0, 0.0, 4.0, 0.0];
        let distribution = Distribution1D::new(weights).unwrap();
        let n = 80_000;
        let mut counts = [0; 6];
        for i in 0..n {
            let u = (f64::from(i) + 0.5) / f64::from(n);
            let (index, probability, rest) = distribution.sample(u);
            assert!((0.0..1.0).contains(&rest));
            assert_eq!(probability, distribution.probability(index));
            counts[index] += 1;
        }
        assert_eq!(counts, [0, 10_000, 30_000, 0, 40_000, 0]);
        assert_eq!(distribution.sample(1.0 - f64::EPSILON / 2.0).0, 4);
        assert_eq!(distribution.sample(0.0).0, 1);
    }

    /// Indices of a million weights are sampled with their probability, the last ones too, and the remainder is uniform. With 24 binary
    /// digits each index would have 16 or 17 numbers: 6 % too few or too many, and a remainder of 16 values.
    #[test]
    fn a_million_entries_have_their_probability() {
        use crate::sampling::{Rng, Stream, refined};
        const ENTRIES: usize = 1_000_000;
        let distribution = Distribution1D::new((0..ENTRIES).map(|i| 1.0 + (i % 3) as f64)).unwrap();
        let mut rng = Rng::new(5, Stream::Measure, 0);
        let n = 4_000_000;
        let (mut counts, mut rests) = (vec![0u32; ENTRIES], vec![0u32; 256]);
        for _ in 0..n {
            let (index, probability, rest) = distribution.sample(refined(rng.next_2d()));
            assert!((0.0..1.0).contains(&rest) && probability > 0.0);
            counts[index] += 1;
            rests[(rest * 256.0) as usize] += 1;
        }
        // The expected counts are 2, 4 and 6. They are Poisson-distributed: the statistic has variance 2 + 1 / expected per entry.
        let expected = |i: usize| n as f64 * (1.0 + (i % 3) as f64) / distribution.total();
        let chi_square = |counts: &[u32], expected: &dyn Fn(usize) -> f64| -> f64 {
            counts.iter().enumerate().map(|(i, &c)| (f64::from(c) - expected(i)).powi(2) / expected(i)).sum()
        };
        let statistic = chi_square(&counts, &expected);
        let spread = (ENTRIES as f64 * 2.31).sqrt();
        assert!((statistic - ENTRIES as f64).abs() < 5.0 * spread, "{statistic}");
        let statistic = chi_square(&rests, &|_| n as f64 / 256.0);
        assert!((statistic - 255.0).abs() < 5.0 * 510f64.sqrt(), "{statistic}");
        assert_eq!(distribution.sample(1.0 - f64::EPSILON / 2.0).0, ENTRIES - 1);
    }

    #[test]
    fn refuses_what_is_no_distribution() {
        assert!(Distribution1D::new([]).is_none());
        assert!(Distribution1D::new([0.0, 0.0]).is_none());
        assert!(Distribution1D::new([1.0, f64::NAN]).is_none());
        assert!(Distribution1D::new([1.0, -1.0]).is_none());
        assert!(Distribution1D::new([f64::INFINITY]).is_none());
    }

    #[test]
    fn frequencies_match_weights_in_the_plane() {
        let weights = [1.0, 0.0, 3.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0];
        let distribution = Distribution2D::new(&weights, 3).unwrap();
        let n = 400;
        let mut counts = [0; 9];
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let ((column, row), probability, rest) = distribution.sample(u);
            assert!((rest.cmpge(Vec2::ZERO) & rest.cmplt(Vec2::ONE)).all());
            assert!((f64::from(probability) - weights[3 * column + row] / 8.0).abs() < 1e-7);
            counts[3 * column + row] += 1;
        }
        assert_eq!(counts, weights.map(|weight| (weight / 8.0 * f64::from(n * n)) as i32));
        assert!(Distribution2D::new(&[0.0; 4], 2).is_none());
    }
}
