//! Phase functions: how a medium spreads light over directions at a scattering.
//!
//! As at surfaces, `wo` leads back to the previous vertex of the path, `wi` is the direction that is evaluated or sampled, both
//! are unit vectors, and both leave the place of the scattering. So light that goes straight on has `wi = -wo`, and the cosine of
//! the angle of deflection is `-(wo . wi)`. All functions here are symmetric: `wo` and `wi` may be exchanged.

use crate::math::Frame;
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// Density of the uniform distribution over the sphere, per steradian.
const UNIFORM: f32 = 0.25 * FRAC_1_PI;

/// A phase function: a density over directions, per steradian, whose integral over the sphere is one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Phase {
    /// `1 / (4 pi)`: every direction alike.
    #[default]
    Isotropic,
    /// One lobe of Henyey & Greenstein: [`Phase::henyey_greenstein`].
    HenyeyGreenstein(Lobe),
    /// Molecules and particles far smaller than the wavelength: `3 / (16 pi) (1 + cos^2)`.
    Rayleigh,
    /// Two lobes of Henyey & Greenstein: [`Phase::two_lobes`].
    TwoLobes {
        /// Lobe that is taken with probability `share`.
        first: Lobe,
        /// The other one.
        second: Lobe,
        /// Share of the first lobe, in [0, 1].
        share: f32,
    },
}

/// A lobe of Henyey & Greenstein ("Diffuse radiation in the Galaxy", Astrophysical Journal 93, 1941), with its mean cosine in
/// (-1, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    g: f32,
}

/// Why a phase function cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PhaseError {
    /// The mean cosine is out of range.
    #[error(
        "the mean cosine g of a phase function is {0}: it must be above -1 and below 1 (0 scatters alike in all directions)"
    )]
    MeanCosine(f32),
    /// The share of a lobe is out of range.
    #[error("the share of the first lobe of a phase function is {0}: it must be from 0 to 1")]
    Share(f32),
}

/// A direction drawn from a phase function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// Unit vector that leaves the scattering.
    pub wi: Vec3,
    /// Its density per steradian, which is also the value of the phase function: the weight of the sample is one.
    pub pdf: f32,
}

impl Lobe {
    /// A lobe with mean cosine `g`.
    ///
    /// # Errors
    /// Where `g` is not above -1 and below 1.
    pub fn new(g: f32) -> Result<Self, PhaseError> {
        if g.abs() < 1.0 { Ok(Self { g }) } else { Err(PhaseError::MeanCosine(g)) }
    }

    /// Mean cosine of the angle of deflection.
    pub fn mean_cosine(self) -> f32 {
        self.g
    }

    /// `(1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))`, by how far the direction is from the peak: `drop` is `1 - cos` for `g >= 0` and
    /// `1 + cos` for `g < 0`.
    ///
    /// With it the bracket is `(1 - |g|)^2 + 2 |g| drop`, in which nothing cancels however narrow the lobe is.
    fn value(self, drop: f32) -> f32 {
        let g = self.g.abs();
        let base = (1.0 - g) * (1.0 - g) + 2.0 * g * drop;
        UNIFORM * (1.0 - g) * (1.0 + g) / (base * base.sqrt())
    }

    fn eval(self, wo: Vec3, wi: Vec3) -> f32 {
        // Half the squared distance of two unit vectors is one minus their cosine, and keeps its digits where that is small.
        let apart = if self.g >= 0.0 { wi + wo } else { wi - wo };
        self.value((0.5 * apart.length_squared()).min(2.0))
    }

    fn sample(self, wo: Vec3, u: Vec2) -> Vec3 {
        // The inverse of the distribution of the cosine, solved for 1 - cos: it needs no case for small g and loses no digits where g
        // is near one (the usual form has 2 g below a difference of squares).
        let g = self.g.abs();
        let d = (1.0 - g) + 2.0 * g * u.x;
        let ratio = (1.0 - g) / d;
        let drop = (2.0 * ratio * ratio * (1.0 - u.x) * (1.0 + g * u.x)).min(2.0);
        around(if self.g >= 0.0 { -wo } else { wo }, drop, u.y)
    }
}

impl Phase {
    /// Henyey & Greenstein's function with mean cosine `g`: above zero light goes on forwards, below it turns back.
    ///
    /// # Errors
    /// Where `g` is not above -1 and below 1.
    pub fn henyey_greenstein(g: f32) -> Result<Self, PhaseError> {
        let lobe = Lobe::new(g)?;
        Ok(if g == 0.0 { Self::Isotropic } else { Self::HenyeyGreenstein(lobe) })
    }

    /// `share` of a lobe with mean cosine `first`, the rest of one with `second`: for droplets, which have a peak forwards and
    /// a lower one backwards.
    ///
    /// # Errors
    /// Where a mean cosine is not above -1 and below 1, or the share not in [0, 1].
    pub fn two_lobes(first: f32, second: f32, share: f32) -> Result<Self, PhaseError> {
        let (first, second) = (Lobe::new(first)?, Lobe::new(second)?);
        if !(0.0..=1.0).contains(&share) {
            return Err(PhaseError::Share(share));
        }
        Ok(Self::TwoLobes { first, second, share })
    }

    /// The phase function, per steradian, for light from `wi` towards `wo` or the other way round. It contains no cosine and no albedo.
    pub fn eval(self, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Self::Isotropic => UNIFORM,
            Self::HenyeyGreenstein(lobe) => lobe.eval(wo, wi),
            Self::Rayleigh => {
                let cos = wo.dot(wi);
                0.75 * UNIFORM * (1.0 + cos * cos)
            }
            Self::TwoLobes { first, second, share } => {
                share * first.eval(wo, wi) + (1.0 - share) * second.eval(wo, wi)
            }
        }
    }

    /// Largest value, per steradian.
    pub fn peak(self) -> f32 {
        match self {
            Self::Isotropic => UNIFORM,
            Self::HenyeyGreenstein(lobe) => lobe.value(0.0),
            Self::Rayleigh => 1.5 * UNIFORM,
            Self::TwoLobes { .. } => self.eval(Vec3::Z, -Vec3::Z).max(self.eval(Vec3::Z, Vec3::Z)),
        }
    }

    /// Density per steradian with which [`Self::sample`] draws `wi`: the phase function itself.
    pub fn pdf(self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval(wo, wi)
    }

    /// A direction with the density of the phase function, from two uniform variates in `[0, 1)`.
    pub fn sample(self, wo: Vec3, u: Vec2) -> PhaseSample {
        let wi = match self {
            Self::Isotropic => around(-wo, 2.0 * (1.0 - u.x), u.y),
            Self::HenyeyGreenstein(lobe) => lobe.sample(wo, u),
            Self::Rayleigh => {
                // The cosine solves cos^3 + 3 cos = 8 u - 4.
                let cos = 2.0 * ((4.0 * u.x - 2.0).asinh() / 3.0).sinh();
                around(-wo, (1.0 - cos).clamp(0.0, 2.0), u.y)
            }
            Self::TwoLobes { first, second, share } => {
                // The variate that chose the lobe is stretched over [0, 1) again.
                if u.x < share {
                    first.sample(wo, Vec2::new(u.x / share, u.y))
                } else {
                    second.sample(wo, Vec2::new((u.x - share) / (1.0 - share), u.y))
                }
            }
        };
        PhaseSample { wi, pdf: self.eval(wo, wi) }
    }

    /// Mean cosine of the angle of deflection.
    pub fn mean_cosine(self) -> f32 {
        match self {
            Self::Isotropic | Self::Rayleigh => 0.0,
            Self::HenyeyGreenstein(lobe) => lobe.g,
            Self::TwoLobes { first, second, share } => share * first.g + (1.0 - share) * second.g,
        }
    }
}

/// The unit vector whose cosine to `axis` is `1 - drop`, turned about it by `turn` times a full circle.
fn around(axis: Vec3, drop: f32, turn: f32) -> Vec3 {
    let sin = (drop * (2.0 - drop)).sqrt();
    let (s, c) = (TAU * turn).sin_cos();
    Frame::from_z(axis).to_world(Vec3::new(sin * c, sin * s, 1.0 - drop))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};
    use std::f64::consts::TAU as TAU_64;

    fn all() -> Vec<Phase> {
        let mut all = vec![Phase::Isotropic, Phase::Rayleigh];
        for g in [1e-7, 1e-3, 0.3, 0.75, 0.9, 0.99, 0.999, 0.999_999] {
            all.push(Phase::henyey_greenstein(g).unwrap());
            all.push(Phase::henyey_greenstein(-g).unwrap());
        }
        all.push(Phase::two_lobes(0.8, -0.3, 0.7).unwrap());
        all.push(Phase::two_lobes(0.999, -0.9, 0.0).unwrap());
        all.push(Phase::two_lobes(0.999, 0.0, 1.0).unwrap());
        all
    }

    /// The directions `wo = -z` and `wi` with the given `1 - cos` of deflection, without cancellation.
    fn deflected(drop: f64) -> (Vec3, Vec3) {
        let sin = (drop * (2.0 - drop)).max(0.0).sqrt();
        (Vec3::NEG_Z, Vec3::new(sin as f32, 0.0, (1.0 - drop) as f32))
    }

    /// Cosines and shares of the phase function's integral over the sphere: midpoints in a variable that is fine at both poles.
    fn quadrature(phase: Phase) -> impl Iterator<Item = (f64, f64)> {
        let steps = 60_000;
        let decades = 20.0;
        (0..steps).map(move |i| {
            // 1 - cos and 1 + cos from 1e-20 to 1: half of the points each, even in their logarithm.
            let x = (f64::from(i) + 0.5) / f64::from(steps);
            let is_ahead = x < 0.5;
            let drop = 10f64.powf(-decades * (if is_ahead { 2.0 * x } else { 2.0 * x - 1.0 }));
            let (wo, mut wi) = deflected(drop);
            if !is_ahead {
                wi.z = -wi.z;
            }
            let width = drop * decades * 10f64.ln() * 2.0 / f64::from(steps);
            let cos = if is_ahead { 1.0 - drop } else { drop - 1.0 };
            (cos, f64::from(phase.eval(wo, wi)) * TAU_64 * width)
        })
    }

    /// The integral over the sphere of the phase function times `f(cos)`.
    fn integral(phase: Phase, f: impl Fn(f64) -> f64) -> f64 {
        quadrature(phase).map(|(cos, share)| share * f(cos)).sum()
    }

    #[test]
    fn the_integral_over_the_sphere_is_one() {
        for phase in all() {
            let whole = integral(phase, |_| 1.0);
            assert!((whole - 1.0).abs() < 2e-5, "{phase:?}: {whole}");
            let mean = integral(phase, |cos| cos);
            assert!((mean - f64::from(phase.mean_cosine())).abs() < 2e-5, "{phase:?}: {mean}");
        }
    }

    #[test]
    fn printed_values() {
        // p(1), p(0), p(-1), mean cos^2, share backwards.
        let rows = [
            (Phase::henyey_greenstein(0.3), [0.211124, 0.063634, 0.032961, 0.393333, 0.286037]),
            (Phase::henyey_greenstein(0.75), [2.228169, 0.017825, 0.006496, 0.708333, 0.066667]),
            (Phase::henyey_greenstein(0.9), [15.119720, 0.006209, 0.002204, 0.873333, 0.022903]),
            (Phase::henyey_greenstein(-0.5), [0.017684, 0.042706, 0.477465, 0.5, 0.829180]),
            (Ok(Phase::Rayleigh), [0.119366, 0.059683, 0.119366, 0.4, 0.5]),
        ];
        for (phase, [ahead, aside, back, mean_square, backwards]) in rows {
            let phase = phase.unwrap();
            let eval = |drop: f64| {
                let (wo, wi) = deflected(drop);
                f64::from(phase.eval(wo, wi))
            };
            for (value, expected) in [(eval(0.0), ahead), (eval(1.0), aside), (eval(2.0), back)] {
                assert!((value - expected).abs() < 1e-6 + 1e-6 * expected, "{phase:?}: {value} {expected}");
            }
            assert!((integral(phase, |cos| cos * cos) - mean_square).abs() < 1e-5, "{phase:?}");
            let share = integral(phase, |cos| f64::from(cos < 0.0));
            assert!((share - backwards).abs() < 1e-5, "{phase:?} {share}");
        }
    }

    #[test]
    fn small_g_is_the_first_order_of_its_series() {
        // p = (1 + 3 g cos) / (4 pi) + O(g^2): no division by g is left.
        for g in [1e-10f32, 1e-6, 1e-4] {
            for drop in [0.0, 0.3, 1.0, 1.7, 2.0] {
                let (wo, wi) = deflected(drop);
                for g in [g, -g] {
                    let value = f64::from(Phase::henyey_greenstein(g).unwrap().eval(wo, wi));
                    let series = (1.0 + 3.0 * f64::from(g) * (1.0 - drop)) * 0.25 / std::f64::consts::PI;
                    assert!((value / series - 1.0).abs() < 1e-6, "{g} {drop}: {value} {series}");
                }
            }
        }
    }

    /// Bins of equal probability by the closed form of the distribution of the cosine.
    #[test]
    fn samples_of_one_lobe_fall_evenly_into_bins_of_equal_probability() {
        for (at, g) in [0.0f64, 1e-4, 0.3, 0.9, 0.999, -0.5, -0.999].into_iter().enumerate() {
            let phase = Phase::henyey_greenstein(g as f32).unwrap();
            let g = f64::from(g as f32);
            let mut rng = Rng::new(11, Stream::Measure, at as u64);
            let (bins, count) = (64, 200_000);
            let mut found = vec![0u32; bins];
            for _ in 0..count {
                // Along an axis, so that the distance to the peak keeps its digits.
                let wi = phase.sample(Vec3::NEG_Z, rng.next_2d()).wi.as_dvec3();
                let sin_squared = wi.x * wi.x + wi.y * wi.y;
                // |1 -+ cos| of the peak that is near.
                let drop = if (wi.z > 0.0) == (g >= 0.0) {
                    sin_squared / (1.0 + wi.z.abs())
                } else {
                    1.0 + wi.z.abs()
                };
                let a = g.abs();
                // Probability of a deflection from the peak of more than `drop`.
                let beyond = if a > 0.0 {
                    let base = ((1.0 - a).powi(2) + 2.0 * a * drop).sqrt();
                    (1.0 - a) * (1.0 + a) / (2.0 * a) * (1.0 / base - 1.0 / (1.0 + a))
                } else {
                    1.0 - 0.5 * drop
                };
                let bin = (beyond * bins as f64).clamp(0.0, bins as f64 - 1.0) as usize;
                found[bin] += 1;
            }
            let expected = f64::from(count) / bins as f64;
            let chi2: f64 = found.iter().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
            // 63 degrees of freedom: mean 63, deviation 11.2; beyond 125 with probability 5e-6.
            assert!(chi2 < 125.0, "g {g}: {chi2} {found:?}");
        }
    }

    #[test]
    fn histograms_follow_the_density_in_all_directions() {
        // Cells of polar angle and azimuth about an axis that is none of the frame's.
        let axis = Vec3::new(0.6, 0.48, 0.64);
        let frame = Frame::from_z(axis);
        // Unit vectors of `f32` are too coarse for narrower lobes.
        let is_wide = |phase: &Phase| phase.mean_cosine().abs() < 0.9999;
        for (at, phase) in all().into_iter().filter(is_wide).enumerate() {
            let mut rng = Rng::new(12, Stream::Measure, at as u64);
            let (polar, turns, count) = (12usize, 8usize, 100_000u32);
            let mut found = vec![0u32; polar * turns];
            let mut cosines = 0.0;
            for _ in 0..count {
                let drawn = phase.sample(-axis, rng.next_2d());
                assert!((drawn.wi.length() - 1.0).abs() < 1e-5, "{phase:?}");
                assert_eq!(drawn.pdf, phase.pdf(-axis, drawn.wi));
                assert!(drawn.pdf > 0.0 && drawn.pdf.is_finite(), "{phase:?} {drawn:?}");
                let v = frame.to_local(drawn.wi);
                cosines += f64::from(v.z);
                let ring = ((0.5 - 0.5 * v.z) * polar as f32).clamp(0.0, polar as f32 - 1.0) as usize;
                let turn = v.y.atan2(v.x) / TAU + 0.5;
                found[ring * turns + (turn * turns as f32).clamp(0.0, turns as f32 - 1.0) as usize] += 1;
            }
            let mut shares = vec![0.0; polar];
            for (cos, share) in quadrature(phase) {
                shares[((0.5 - 0.5 * cos) * polar as f64).clamp(0.0, polar as f64 - 1.0) as usize] += share;
            }
            let mut chi2 = 0.0;
            let mut cells = 0;
            for (ring, share) in shares.into_iter().enumerate() {
                let expected = f64::from(count) * share / turns as f64;
                if expected < 5.0 {
                    continue;
                }
                for &n in &found[ring * turns..(ring + 1) * turns] {
                    chi2 += (f64::from(n) - expected).powi(2) / expected;
                    cells += 1;
                }
            }
            // Beyond mean + 6 deviations with probability below 1e-6 at these numbers of cells (skewed to the right).
            let limit = f64::from(cells) + 6.0 * (2.0 * f64::from(cells)).sqrt();
            assert!(chi2 < limit, "{phase:?}: {chi2} of {cells} cells");
            let g = f64::from(phase.mean_cosine());
            // The deviation of a cosine is at most one.
            assert!((cosines / f64::from(count) - g).abs() < 4.5 / f64::from(count).sqrt(), "{phase:?}");
        }
    }

    #[test]
    fn narrow_lobes_agree_with_their_density() {
        // The mean of q/p over samples of p is one for any density q: here the same lobe, a little wider.
        for g in [0.99f32, 0.999, -0.999, 0.999_9] {
            let (narrow, wide) =
                (Phase::henyey_greenstein(g).unwrap(), Phase::henyey_greenstein(g * 0.9998).unwrap());
            let mut rng = Rng::new(13, Stream::Measure, 0);
            let count = 200_000;
            let (mut sum, mut squares) = (0.0, 0.0);
            let wo = Vec3::new(0.36, -0.48, 0.8);
            for _ in 0..count {
                let drawn = narrow.sample(wo, rng.next_2d());
                let ratio = f64::from(wide.eval(wo, drawn.wi) / drawn.pdf);
                sum += ratio;
                squares += ratio * ratio;
            }
            let mean = sum / f64::from(count);
            let error = ((squares / f64::from(count) - mean * mean) / f64::from(count)).sqrt();
            assert!((mean - 1.0).abs() < 4.5 * error + 2e-4, "{g}: {mean} +- {error}");
        }
    }

    #[test]
    fn ends_of_the_variates_are_sound() {
        let last = crate::sampling::ONE_MINUS_EPSILON;
        for phase in all() {
            for u in [0.0, 1e-30, 0.5, last] {
                for v in [0.0, last] {
                    for wo in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
                        let drawn = phase.sample(wo, Vec2::new(u, v));
                        assert!(drawn.wi.is_finite() && (drawn.wi.length() - 1.0).abs() < 1e-5, "{phase:?}");
                        assert!(drawn.pdf.is_finite() && drawn.pdf > 0.0, "{phase:?} {u} {v}: {drawn:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_no_phase_function_is_refused() {
        for g in [1.0, -1.0, 1.5, f32::NAN, f32::INFINITY] {
            assert!(matches!(Phase::henyey_greenstein(g), Err(PhaseError::MeanCosine(_))));
            assert!(Phase::two_lobes(0.1, g, 0.5).is_err() && Phase::two_lobes(g, 0.1, 0.5).is_err());
        }
        for share in [-0.1, 1.1, f32::NAN] {
            assert!(matches!(Phase::two_lobes(0.5, -0.2, share), Err(PhaseError::Share(_))));
        }
        assert_eq!(Phase::henyey_greenstein(0.0).unwrap(), Phase::Isotropic);
        assert_eq!(Phase::default(), Phase::Isotropic);
        assert!(PhaseError::MeanCosine(1.0).to_string().contains("below 1"));
    }
}
