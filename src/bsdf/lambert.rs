//! Lambert's model: ideal diffuse reflection.

use super::{BsdfSample, Lobe};
use crate::math::Rgb;
use crate::sampling::warp::{cosine_hemisphere_pdf, square_to_disc};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Ideal diffuse reflection: the same radiance in all directions of the upper hemisphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lambert {
    /// Hemispherical reflectance: reflected over incident flux, without `1/pi`, in `[0, 1]`.
    pub reflectance: Rgb,
}

/// Smallest squared cosine: `1 - x^2 - y^2` of a point of the unit disc has a rounding error of this size.
const SMALLEST_COS_SQUARED: f32 = f32::EPSILON / 4.0;

impl Lambert {
    /// `reflectance / pi` where both directions are above the surface, otherwise zero.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wo.z > 0.0 && wi.z > 0.0 { self.reflectance * FRAC_1_PI } else { Rgb::ZERO }
    }

    /// `cos(theta_i) / pi`, 1/sr, where both directions are above the surface, otherwise zero.
    #[inline]
    pub fn pdf_solid_angle(&self, wo: Vec3, wi: Vec3) -> f32 {
        let lit = wo.z > 0.0 && self.reflectance.max_element() > 0.0;
        if lit { cosine_hemisphere_pdf(wi.z) } else { 0.0 }
    }

    /// A direction with density `cos(theta_i) / pi`, around `+z` and strictly above the surface.
    #[inline]
    pub fn sample_direction(u: Vec2) -> Vec3 {
        let d = square_to_disc(u);
        // Not zero on the rim: the density would vanish there and the direction would lie in the surface; a rejection would lose energy.
        let z = (1.0 - d.length_squared()).max(SMALLEST_COS_SQUARED).sqrt();
        Vec3::new(d.x, d.y, z)
    }

    /// A direction with density `cos(theta_i) / pi`; the throughput is exactly the reflectance.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if !(wo.z > 0.0 && self.reflectance.max_element() > 0.0) {
            return None;
        }
        let wi = Self::sample_direction(u);
        Some(BsdfSample {
            wi,
            throughput: self.reflectance,
            pdf_solid_angle: wi.z * FRAC_1_PI,
            lobe: Lobe::Diffuse,
            transmission: false,
        })
    }
}
