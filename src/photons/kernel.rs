//! Kernels: weights of photons by their distance. The kernel is a setting.

use crate::settings::Kernel;

impl Kernel {
    /// Weight `w(d / r)` of a photon at squared relative distance `t_squared` in `[0, 1]`, one at the centre.
    ///
    /// The density of the kernel per area is `w / (n pi r^2)` with the [`Self::mean_weight`] `n`.
    #[inline]
    pub fn weight(self, t_squared: f32) -> f32 {
        match self {
            Self::Constant => 1.0,
            Self::Cone { k } => (1.0 - t_squared.sqrt() / k.max(1.0)).max(0.0),
            Self::Epanechnikov => 1.0 - t_squared,
            Self::Gaussian => 1.0 - (1.0 - (-0.5 * GAUSSIAN_BETA * t_squared).exp()) / GAUSSIAN_RANGE,
        }
    }

    /// Mean of the weight over the disc, `n = integral over [0, 1] of 2 t w(t) dt`, in closed form.
    ///
    /// `1 - 2 / (3 k)` for the cone is Jensen's own; the others follow by the same integral. Jensen's Gaussian has a
    /// factor `alpha = 0.918`, with which its integral is 0.53 instead of one; division by the mean, which corresponds
    /// to `alpha = 1.7284`, corrects that (Garcia, Urena & Sbert 2014).
    pub fn mean_weight(self) -> f32 {
        match self {
            Self::Constant => 1.0,
            Self::Cone { k } => 1.0 - 2.0 / (3.0 * k.max(1.0)),
            Self::Epanechnikov => 0.5,
            // With u = t^2: integral of 1 - (1 - exp(-beta u / 2)) / (1 - exp(-beta)) over [0, 1].
            Self::Gaussian => {
                let falloff = 1.0 - (1.0 - (-0.5 * GAUSSIAN_BETA).exp()) * 2.0 / GAUSSIAN_BETA;
                1.0 - falloff / GAUSSIAN_RANGE
            }
        }
    }
}

/// Jensen's shape of the Gaussian.
const GAUSSIAN_BETA: f32 = 1.953;
/// `1 - exp(-GAUSSIAN_BETA)`.
const GAUSSIAN_RANGE: f32 = 0.858_152;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_weights_are_the_integrals() {
        let cones = [1.0, 1.1, 2.0, 10.0].map(|k| Kernel::Cone { k });
        let others = [Kernel::Constant, Kernel::Epanechnikov, Kernel::Gaussian];
        for kernel in cones.into_iter().chain(others) {
            let n = 100_000;
            let sum: f64 =
                (0..n).map(|i| f64::from(kernel.weight(((f64::from(i) + 0.5) / f64::from(n)) as f32))).sum();
            let mean = sum / f64::from(n);
            assert!((mean / f64::from(kernel.mean_weight()) - 1.0).abs() < 1e-5, "{kernel:?}: {mean}");
            assert_eq!(kernel.weight(0.0), 1.0);
            assert!(kernel.weight(1.0) >= 0.0);
        }
        assert!((1.0 / Kernel::Gaussian.mean_weight() - 1.7284).abs() < 1e-3);
        assert!((f64::from(GAUSSIAN_RANGE) - (1.0 - (-1.953f64).exp())).abs() < 1e-6);
    }
}
