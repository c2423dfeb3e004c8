//! Mirrors: ideal specular reflection.

use super::{BsdfSample, Lobe, reflect};
use crate::math::Rgb;
use glam::Vec3;

/// Ideal specular reflection with the same reflectance at all angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    /// Reflected over incident flux, in `[0, 1]`.
    pub reflectance: Rgb,
}

impl Mirror {
    /// The reflected direction; `None` from below.
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<BsdfSample> {
        if !(wo.z > 0.0 && self.reflectance.max_element() > 0.0) {
            return None;
        }
        Some(BsdfSample {
            wi: reflect(wo),
            throughput: self.reflectance,
            pdf_solid_angle: f32::INFINITY,
            lobe: Lobe::Specular,
            transmission: false,
        })
    }
}
