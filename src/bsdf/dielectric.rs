//! Smooth interfaces between two media.

use super::{BsdfSample, Lobe, TransportMode, fresnel_dielectric, reflect, refract};
use crate::math::Rgb;
use glam::Vec3;

/// Largest relative difference of two indices of refraction for which an interface is treated as absent: light passes straight through
/// and nothing is reflected. The reflectance at normal incidence is then below 2.5e-9.
pub const MATCHED_IOR_TOLERANCE: f64 = 1e-4;

/// A smooth interface between two media, without absorption: it reflects the Fresnel fraction and refracts the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction inside over outside; exactly one where they match.
    eta: f32,
    /// `1 / eta`, rounded once.
    inverse_eta: f32,
}

impl Dielectric {
    /// The interface between `ior_outside`, on the side to which the normal points (`z > 0`), and `ior_inside`. Both must be positive
    /// and finite; indices within [`MATCHED_IOR_TOLERANCE`] of each other count as equal.
    pub fn new(ior_outside: f64, ior_inside: f64) -> Self {
        debug_assert!(ior_outside > 0.0 && ior_inside > 0.0, "indices {ior_outside}, {ior_inside}");
        // Decided once from the indices, so that both directions agree, with room for the rounding of a decimal number: 1.0001 does not
        // match 1.
        let difference = (ior_inside - ior_outside).abs();
        if difference < MATCHED_IOR_TOLERANCE * (1.0 - 1e-9) * ior_outside.min(ior_inside) {
            return Self { eta: 1.0, inverse_eta: 1.0 };
        }
        Self { eta: (ior_inside / ior_outside) as f32, inverse_eta: (ior_outside / ior_inside) as f32 }
    }

    /// Whether light passes as if there were no interface.
    #[inline]
    pub fn is_matched(&self) -> bool {
        self.eta == 1.0
    }

    /// Index of refraction on the side away from `wo` over that on the side of `wo`.
    #[inline]
    pub fn relative_ior(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { self.inverse_eta }
    }

    /// Fraction of the light along `wo` that is reflected, in `[0, 1]`.
    #[inline]
    pub fn reflectance(&self, wo: Vec3) -> f32 {
        fresnel_dielectric(wo.z, self.relative_ior(wo))
    }

    /// Reflects with the Fresnel fraction as probability (for a smaller `u_lobe`) and refracts otherwise, so that the throughput is one.
    /// In [`TransportMode::Radiance`] a refraction has the throughput `(n_o / n_i)^2`, where `n_o` is the index on the side of `wo`
    /// (Veach 1997, section 5.2). `None` where `wo.z` is zero or NaN.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z == 0.0 || wo.z.is_nan() {
            return None;
        }
        let eta = self.relative_ior(wo);
        let mut sample = BsdfSample {
            wi: reflect(wo),
            throughput: Rgb::ONE,
            pdf_solid_angle: f32::INFINITY,
            lobe: Lobe::Specular,
            transmission: false,
        };
        if u_lobe < fresnel_dielectric(wo.z, eta) {
            return Some(sample);
        }
        // Exactly straight where the indices match; `refract` would round.
        sample.wi = if self.is_matched() { -wo } else { refract(wo, eta)? };
        sample.transmission = true;
        if mode == TransportMode::Radiance {
            sample.throughput = Rgb::splat(1.0 / (eta * eta));
        }
        Some(sample)
    }
}
