//! The GGX distribution of microfacet normals, its masking, and the sampling of visible normals.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};

/// A lobe with a smaller roughness than this counts as ideally specular: half vectors, which `f32` represents to 6e-8, could not resolve
/// its shape.
pub const SMOOTH_ROUGHNESS: f32 = 1e-4;

/// Microfacets with the slopes of Trowbridge & Reitz, scaled by `along` in x and by `across` in y (Walter et al., "Microfacet Models for
/// Refraction through Rough Surfaces", EGSR 2007; Heitz, JCGT 3(2), 2014). All directions are unit vectors above the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ggx {
    /// Slope along x, at least [`SMOOTH_ROUGHNESS`].
    pub along: f32,
    /// Slope along y.
    pub across: f32,
}

impl Ggx {
    /// Density of the microfacet normal `h`, 1/sr, normalised such that its integral with the cosine is one.
    #[inline]
    pub(super) fn density(&self, h: Vec3) -> f32 {
        let (x, y) = (h.x / self.along, h.y / self.across);
        let e = x * x + y * y + h.z * h.z;
        // Two divisions, because the product of both roughnesses with e^2 may leave the range of f32.
        FRAC_1_PI / (self.along * e) / (self.across * e)
    }

    /// `sqrt(z^2 + (along x)^2 + (across y)^2)`. Smith's masking is then `G1 = 2 z / (z + spread)`, without a division by a grazing
    /// cosine.
    #[inline]
    pub(super) fn spread(&self, w: Vec3) -> f32 {
        Vec3::new(w.x * self.along, w.y * self.across, w.z).length()
    }

    /// Height-correlated masking and shadowing over `cos(wo) cos(wi)`: `2 / (z_o s_i + z_i s_o)`. The cosines are taken as positive, so
    /// that the formula also holds for transmission.
    #[inline]
    pub(super) fn masking_over_cosines(&self, wo: Vec3, wi: Vec3) -> f32 {
        2.0 / (wo.z.abs() * self.spread(wi) + wi.z.abs() * self.spread(wo))
    }

    /// `G2 / G1(wo)`, in `[0, 1]`: the share of the light reflected towards `wi` by a visible normal that is not shadowed.
    #[inline]
    pub(super) fn masking_ratio(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (z_o, z_i) = (wo.z.abs(), wi.z.abs());
        let (s_o, s_i) = (self.spread(wo), self.spread(wi));
        (z_i * (z_o + s_o) / (z_o * s_i + z_i * s_o)).min(1.0)
    }

    /// Density of [`Self::sample_visible`] per solid angle of the normal, divided by `|wo . h|`.
    #[inline]
    pub(super) fn visible_over_cosine(&self, wo: Vec3, h: Vec3) -> f32 {
        2.0 * self.density(h) / (wo.z.abs() + self.spread(wo))
    }

    /// Samples a normal that is visible from `wo`, in proportion to its projected area, by a spherical cap (Dupuy & Benyoub, "Sampling
    /// Visible GGX Normals with Spherical Caps", HPG 2023).
    #[inline]
    pub(super) fn sample_visible(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.along, wo.y * self.across, wo.z);
        let stretched = stretched / stretched.length();
        let (sin_phi, cos_phi) = (TAU * u.x).sin_cos();
        // The height of the normal above the cap's base, which is never zero, is computed first; the cap's own coordinate follows from
        // it.
        let height = (1.0 - u.y) * (1.0 + stretched.z);
        let z = height - stretched.z;
        let sin = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
        let h = Vec3::new(
            (sin * cos_phi + stretched.x) * self.along,
            (sin * sin_phi + stretched.y) * self.across,
            height,
        );
        h / h.length()
    }
}

/// The mirror image of `wo` about the normal `h`, unit length.
#[inline]
pub(super) fn reflect_about(wo: Vec3, h: Vec3) -> Vec3 {
    let wi = h * (2.0 * wo.dot(h)) - wo;
    wi / wi.length()
}

/// The unit half vector of two directions; `None` for opposite ones.
#[inline]
pub(super) fn half_vector(wo: Vec3, wi: Vec3) -> Option<Vec3> {
    crate::math::unit(wo + wi)
}
