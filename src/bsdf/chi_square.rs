//! Pearson's chi-square test of samples against their stated density, after `chi2.py` of Mitsuba 3. Only for tests, of this and of other
//! modules.

use crate::sampling::{Rng, Stream};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Probability with which a correct sampler fails any of the [`ChiSquare::runs`] tests.
const SIGNIFICANCE: f64 = 0.01;

/// Bins with a smaller expected number of samples are pooled, because the statistic does not follow its distribution below that.
const MIN_EXPECTED: f64 = 5.0;

/// Settings of a test.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChiSquare {
    /// Number of bins in the first and second coordinate.
    pub(crate) bins: [usize; 2],
    /// Number of samples.
    pub(crate) samples: u64,
    /// Number of tests that share the significance of 0.01 (Sidak).
    pub(crate) runs: u32,
    /// Seed of the samples.
    pub(crate) seed: u64,
}

impl Default for ChiSquare {
    fn default() -> Self {
        Self { bins: [20, 40], samples: 400_000, runs: 1, seed: 1 }
    }
}

impl ChiSquare {
    /// Tests directions against a density per solid angle. Bins divide `1 - z` in `[0, max_drop]` (2 for the whole sphere) and the
    /// azimuth evenly, so that all have the same solid angle. A `None` from `sample` stands for probability that the density must lack.
    /// Returns the p-value, or a description of the error.
    pub(crate) fn directions(
        &self,
        max_drop: f64,
        mut sample: impl FnMut(&mut Rng) -> Option<DVec3>,
        pdf_solid_angle: impl Fn(DVec3) -> f64,
    ) -> Result<f64, String> {
        self.unit_square(
            |rng| {
                sample(rng).map(|w| {
                    let sin_squared = w.x * w.x + w.y * w.y;
                    // Without cancellation in a narrow cone.
                    let drop = if w.z > 0.0 { sin_squared / (1.0 + w.z) } else { 1.0 - w.z };
                    DVec2::new(drop / max_drop, (w.y.atan2(w.x) / TAU).rem_euclid(1.0))
                })
            },
            |p| {
                let drop = p.x * max_drop;
                let sin = (drop * (2.0 - drop)).max(0.0).sqrt();
                let (s, c) = (TAU * p.y).sin_cos();
                pdf_solid_angle(DVec3::new(sin * c, sin * s, 1.0 - drop)) * TAU * max_drop
            },
        )
    }

    /// Tests points of the unit square against a density per area of it. Otherwise like [`Self::directions`].
    pub(crate) fn unit_square(
        &self,
        mut sample: impl FnMut(&mut Rng) -> Option<DVec2>,
        pdf: impl Fn(DVec2) -> f64,
    ) -> Result<f64, String> {
        let [nx, ny] = self.bins;
        let mut observed = vec![0u64; nx * ny];
        let mut missing = 0;
        let mut rng = Rng::new(self.seed, Stream::Measure, 0x00c1_2a2e);
        for _ in 0..self.samples {
            let Some(p) = sample(&mut rng) else {
                missing += 1;
                continue;
            };
            let index = |x: f64, n: usize| ((x * n as f64).max(0.0) as usize).min(n - 1);
            observed[index(p.x, nx) * ny + index(p.y, ny)] += 1;
            // Rounding may leave the domain slightly; anything beyond that is an error of the sampler.
            if !(p.x > -1e-6 && p.x < 1.0 + 1e-6 && p.y > -1e-6 && p.y < 1.0 + 1e-6) {
                return Err(format!("sample outside the domain: {p}"));
            }
        }
        let mut expected: Vec<f64> = Vec::with_capacity(nx * ny);
        for i in 0..nx {
            for j in 0..ny {
                expected.push(integrate_bin(&pdf, [i, j], self.bins) * self.samples as f64);
            }
        }
        let total: f64 = expected.iter().sum();
        if total.is_nan() || total > self.samples as f64 * 1.001 {
            return Err(format!("density integrates to {}", total / self.samples as f64));
        }
        // The probability that the density lacks must match the samples that failed.
        observed.push(missing);
        expected.push((self.samples as f64 - total).max(0.0));
        self.judge(&observed, &expected)
    }

    fn judge(&self, observed: &[u64], expected: &[f64]) -> Result<f64, String> {
        let mut order: Vec<usize> = (0..expected.len()).collect();
        order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
        let (mut statistic, mut groups) = (0.0, 0u32);
        let (mut pooled_observed, mut pooled_expected) = (0u64, 0.0);
        for i in order {
            if expected[i] == 0.0 && observed[i] as f64 > self.samples as f64 * 1e-5 {
                return Err(format!("{} samples in bin {i}, where the density is zero", observed[i]));
            }
            pooled_observed += observed[i];
            pooled_expected += expected[i];
            if pooled_expected >= MIN_EXPECTED {
                statistic += (pooled_observed as f64 - pooled_expected).powi(2) / pooled_expected;
                groups += 1;
                (pooled_observed, pooled_expected) = (0, 0.0);
            }
        }
        // The remaining bins expect fewer than five samples; many more than that are an error.
        if pooled_observed as f64 > pooled_expected + 10.0 * MIN_EXPECTED {
            return Err(format!("{pooled_observed} samples where {pooled_expected} are expected"));
        }
        if groups < 2 {
            return Err(format!("only {groups} bins with enough samples"));
        }
        let p = chi_square_tail(statistic, groups - 1);
        let threshold = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / f64::from(self.runs));
        if p > threshold { Ok(p) } else { Err(format!("chi-square {statistic} over {groups} bins: p {p}")) }
    }
}

/// Integral of `pdf` over one bin: Gauss-Legendre quadrature with three points in each of 4 x 4 parts.
fn integrate_bin(pdf: &impl Fn(DVec2) -> f64, bin: [usize; 2], bins: [usize; 2]) -> f64 {
    const PARTS: usize = 4;
    const NODES: [(f64, f64); 3] =
        [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
    let at = |axis: usize, part: usize, node: f64| {
        (bin[axis] as f64 + (part as f64 + node) / PARTS as f64) / bins[axis] as f64
    };
    let mut sum = 0.0;
    for part in 0..PARTS * PARTS {
        for (x, weight_x) in NODES {
            for (y, weight_y) in NODES {
                sum += weight_x * weight_y * pdf(DVec2::new(at(0, part / PARTS, x), at(1, part % PARTS, y)));
            }
        }
    }
    sum / (PARTS * PARTS * bins[0] * bins[1]) as f64
}

/// Probability that chi-square with `degrees` of freedom exceeds `statistic`: the regularised upper incomplete gamma function `Q(degrees
/// / 2, statistic / 2)`, by the finite sum for integer degrees (Abramowitz & Stegun 26.4.4 and 26.4.5), with all terms as logarithms.
fn chi_square_tail(statistic: f64, degrees: u32) -> f64 {
    if statistic <= 0.0 {
        return 1.0;
    }
    let half = 0.5 * statistic;
    // Terms half^k / Gamma(k + 1) e^-half, k from 0 or 1/2 up to degrees / 2 - 1.
    let (mut k, mut log_gamma, mut sum) = match degrees % 2 {
        0 => (0.0, 0.0, 0.0),
        _ => (0.5, (0.5 * std::f64::consts::PI.sqrt()).ln(), erfc(half.sqrt())),
    };
    while k < 0.5 * f64::from(degrees) - 0.25 {
        sum += (k * half.ln() - half - log_gamma).exp();
        k += 1.0;
        log_gamma += f64::ln(k);
    }
    f64::min(sum, 1.0)
}

/// Complementary error function by its Chebyshev fit of relative error 1.2e-7 (Press et al., Numerical
/// Recipes).
fn erfc(x: f64) -> f64 {
    const FIT: [f64; 10] = [
        0.170_872_77,
        -0.822_152_23,
        1.488_515_87,
        -1.135_203_98,
        0.278_868_07,
        -0.186_288_06,
        0.096_784_18,
        0.374_091_96,
        1.000_023_68,
        -1.265_512_23,
    ];
    let t = 1.0 / (1.0 + 0.5 * x);
    t * (FIT.iter().fold(0.0, |sum, c| sum * t + c) - x * x).exp()
}

#[test]
fn tail_of_the_distribution() {
    // Quantiles from printed tables.
    for (degrees, statistic, p) in
        [(1, 3.841, 0.05), (2, 9.210, 0.01), (10, 18.307, 0.05), (99, 134.642, 0.01)]
    {
        let tail = chi_square_tail(statistic, degrees);
        assert!((tail / p - 1.0).abs() < 2e-3, "{degrees}: {tail}");
    }
    assert!(chi_square_tail(5000.0, 799) < 1e-100);
    assert!(chi_square_tail(10.0, 799) > 0.999);
}

#[test]
fn catches_a_wrong_density() {
    use crate::sampling::warp::square_to_cosine_hemisphere;
    use std::f64::consts::PI;
    let cosine = |w: DVec3| w.z.max(0.0) / PI;
    let test = |sample: &dyn Fn(&mut Rng) -> Option<DVec3>, pdf: &dyn Fn(DVec3) -> f64| {
        ChiSquare::default().directions(2.0, |rng| sample(rng), pdf)
    };
    let right = |rng: &mut Rng| Some(square_to_cosine_hemisphere(rng.next_2d()).as_dvec3());
    test(&right, &cosine).unwrap();
    // Uniform instead of cosine; an exponent that differs by 3 %; lost flux; a direction rotated out of the hemisphere.
    test(&right, &|w| if w.z > 0.0 { 1.0 / TAU } else { 0.0 }).unwrap_err();
    test(&right, &|w| w.z.max(0.0).powf(1.03) * 2.03 / TAU).unwrap_err();
    test(&|rng| right(rng).filter(|_| rng.next_f32() > 0.01), &cosine).unwrap_err();
    test(&|rng| right(rng).map(|w| DVec3::new(w.x, w.z, w.y)), &cosine).unwrap_err();
    test(&right, &|w| 1.01 * cosine(w)).unwrap_err();
    test(&right, &|w| 0.99 * cosine(w)).unwrap_err();
}
