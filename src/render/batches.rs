//! Standard error of a mean from independent batches, each with photon maps and samples of its own.

use glam::DVec3;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Confidence level: share of the intervals that should contain the expectation.
const HELD: f64 = 0.95;

/// Mean and standard error of batch means, by component. The error is `None` for a single batch.
///
/// The error is the standard deviation between batches over the root of their number, times Student's t over the normal quantile (1.21
/// for eight batches, one for many). The factor allows for the uncertain deviation of few batches: the interval mean +- 1.96 errors
/// contains the expectation 95 times in 100 for any number of batches (Student, "The Probable Error of a Mean", Biometrika 6(1), 1908).
pub(super) fn mean_of_batches<const N: usize>(batches: &[[DVec3; N]]) -> ([DVec3; N], Option<[DVec3; N]>) {
    let n = batches.len() as f64;
    let mean: [DVec3; N] = std::array::from_fn(|i| batches.iter().map(|batch| batch[i]).sum::<DVec3>() / n);
    let Some(widening) = widening(batches.len()) else { return (mean, None) };
    let error = std::array::from_fn(|i| {
        let squares: DVec3 = batches.iter().map(|batch| (batch[i] - mean[i]).powf(2.0)).sum();
        let variance = squares / ((n - 1.0) * n);
        widening * DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
    });
    (mean, Some(error))
}

/// Quantile of Student's t over that of the normal distribution; `None` for fewer than two batches.
fn widening(batches: usize) -> Option<f64> {
    let upper = 0.5 + 0.5 * HELD;
    let t = StudentsT::new(0.0, 1.0, batches.checked_sub(1)? as f64).ok()?.inverse_cdf(upper);
    Some(t / Normal::new(0.0, 1.0).ok()?.inverse_cdf(upper))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_widened_for_few_batches() {
        // Tables: t(0.975) is 12.706 for one degree of freedom, 2.3646 for seven, and 1.95996 for the normal distribution.
        for (batches, t) in [(2, 12.7062), (8, 2.36462), (1_000_000, 1.95997)] {
            assert!((widening(batches).unwrap() - t / 1.959964).abs() < 1e-4 * t, "{batches}");
        }
        assert_eq!(widening(1), None);
        let batches = [1.0, 3.0].map(|x| [DVec3::splat(x)]);
        let (mean, error) = mean_of_batches(&batches);
        assert_eq!(mean, [DVec3::splat(2.0)]);
        // The standard deviation of the two is the root of 2, that of their mean is 1.
        assert!((error.unwrap()[0].x - 12.7062 / 1.959964).abs() < 1e-3);
        assert_eq!(mean_of_batches(&batches[..1]).1, None);
    }
}
