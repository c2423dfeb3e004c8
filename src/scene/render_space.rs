//! Render space: the recentred and scaled space in which all rays are traced.

use glam::{DAffine3, DVec3};

/// The transform from world space (metres, watts) to render space.
///
/// The scene is recentred, scaled by a power of two so that the radius of its bounds lies in `[0.5, 1)`, and its total flux is scaled by
/// a power of two as well. All of this is exact in `f64`. A scene whose lengths or powers are multiplied by a power of two therefore
/// gives the same image bit for bit, and neither millimetres nor kilometres, microwatts nor gigawatts leave the range of `f32` on the
/// way.
///
/// Quantities change as follows: lengths by `scale`; areas, intensity and flux by `scale^2`; absorption per length by `1 / scale`;
/// radiance and irradiance do not change. In addition all radiometric quantities are multiplied by `power`, which the film divides out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSpace {
    /// World position of the origin of render space.
    pub center: DVec3,
    /// Render units per metre, a power of two.
    pub scale: f64,
    /// Factor on radiance, a power of two.
    pub power: f64,
}

impl RenderSpace {
    /// The render space of a scene with these world bounds. `radius` must be finite; zero means scale 1.
    pub fn fitting(center: DVec3, radius: f64) -> Self {
        let scale = if radius > 0.0 { 1.0 / power_of_two_above(radius) } else { 1.0 };
        Self { center, scale, power: 1.0 }
    }

    /// The same space with the factor on radiance chosen such that `flux` lies in `[0.5, 1)`. `flux` is the largest channel of the total
    /// flux of all lights in render units, before this factor.
    pub fn with_flux(self, flux: f64) -> Self {
        let power = if flux > 0.0 && flux.is_finite() { 1.0 / power_of_two_above(flux) } else { 1.0 };
        Self { power, ..self }
    }

    /// Render-space position of a world position.
    pub fn position(&self, world: DVec3) -> DVec3 {
        (world - self.center) * self.scale
    }

    /// World position, in metres, of a render-space position.
    pub fn world_position(&self, position: DVec3) -> DVec3 {
        position / self.scale + self.center
    }

    /// Render-space length of a length in metres.
    pub fn length(&self, metres: f64) -> f64 {
        metres * self.scale
    }

    /// Length in metres of a render-space length.
    pub fn metres(&self, length: f64) -> f64 {
        length / self.scale
    }

    /// The transform as an affine matrix.
    pub fn to_affine(&self) -> DAffine3 {
        DAffine3::from_scale(DVec3::splat(self.scale)) * DAffine3::from_translation(-self.center)
    }
}

/// The smallest power of two greater than `x`, for positive finite `x`, within the range of `f64`.
fn power_of_two_above(x: f64) -> f64 {
    // The exponent field, plus one. Subnormals count as the smallest normal number.
    let exponent = ((x.to_bits() >> 52) & 0x7ff).clamp(1, 2045);
    f64::from_bits((exponent + 1) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radius_lies_between_a_half_and_one() {
        for radius in [1e-300, 1e-6, 0.3, 0.5, 0.999, 1.0, 1e6, 1e300] {
            let space = RenderSpace::fitting(DVec3::ZERO, radius);
            let scaled = space.length(radius);
            assert!((0.5..1.0).contains(&scaled), "{radius}: {scaled}");
            assert_eq!(space.scale.to_bits() & ((1 << 52) - 1), 0, "a power of two");
        }
        assert_eq!(RenderSpace::fitting(DVec3::ZERO, 0.0).scale, 1.0);
        assert!(RenderSpace::fitting(DVec3::ZERO, 1e-310).scale.is_finite());
    }

    #[test]
    fn powers_of_two_change_no_bit() {
        let p = DVec3::new(0.1, 0.7, -12.3);
        let c = DVec3::new(3.3, 0.2, 0.9);
        let one = RenderSpace::fitting(c, 5.7).position(p);
        for k in [-20, -10, 10, 20] {
            let s = 2f64.powi(k);
            assert_eq!(RenderSpace::fitting(c * s, 5.7 * s).position(p * s), one);
        }
    }
}
