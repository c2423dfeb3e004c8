//! Rough interfaces between two media.

use super::ggx::{Ggx, SMOOTH_ROUGHNESS, half_vector, reflect_about};
use super::part::PartSample;
use super::{Dielectric, TransportMode, fresnel_dielectric};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// A rough interface between two media: GGX microfacets that once reflect the Fresnel fraction or refract the rest (Walter et al. 2007).
/// Light that meets a second facet is lost. The frame is that of the surface, as for [`Dielectric`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectric {
    interface: Dielectric,
    facets: Ggx,
}

impl RoughDielectric {
    /// `None` for interfaces that must be treated as smooth: below [`SMOOTH_ROUGHNESS`], and where both media have the same index, so
    /// that facets neither reflect nor refract.
    pub fn new(interface: Dielectric, roughness: f32) -> Option<Self> {
        let is_rough = roughness >= SMOOTH_ROUGHNESS && !interface.is_matched();
        is_rough.then_some(Self { interface, facets: Ggx { along: roughness, across: roughness } })
    }

    /// The same roughness between other media; the smooth interface as an error where their indices match.
    #[inline]
    pub fn with_interface(self, interface: Dielectric) -> Result<Self, Dielectric> {
        if interface.is_matched() { Err(interface) } else { Ok(Self { interface, ..self }) }
    }

    /// The GGX alpha.
    #[inline]
    pub fn roughness(&self) -> f32 {
        self.facets.along
    }

    /// The configuration mirrored so that `wo` is above: the relative index, and both directions.
    #[inline]
    fn turned(&self, wo: Vec3, wi: Vec3) -> (f32, Vec3, Vec3) {
        let side = Vec3::new(1.0, 1.0, 1f32.copysign(wo.z));
        (self.interface.relative_ior(wo), wo * side, wi * side)
    }

    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Rgb::ZERO;
        }
        let (eta, wo, wi) = self.turned(wo, wi);
        let Some((h, factor)) = facet(wo, wi, eta) else { return Rgb::ZERO };
        let reflectance = fresnel_dielectric(wo.dot(h), eta);
        let fraction = match (wi.z > 0.0, mode) {
            (true, _) => reflectance,
            (false, TransportMode::Flux) => 1.0 - reflectance,
            (false, TransportMode::Radiance) => (1.0 - reflectance) / (eta * eta),
        };
        let value = fraction * self.facets.density(h) * self.facets.masking_over_cosines(wo, wi) * factor;
        if value.is_finite() { Rgb::splat(value) } else { Rgb::ZERO }
    }

    #[inline]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        let (eta, wo, wi) = self.turned(wo, wi);
        let Some((h, factor)) = facet(wo, wi, eta) else { return 0.0 };
        let reflectance = fresnel_dielectric(wo.dot(h), eta);
        let fraction = if wi.z > 0.0 { reflectance } else { 1.0 - reflectance };
        let pdf = fraction * self.facets.visible_over_cosine(wo, h) * factor;
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Reflects where `u_lobe` is below the facet's reflectance.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<PartSample> {
        let (eta, above, _) = self.turned(wo, wo);
        let h = self.facets.sample_visible(above, u);
        let cosine = above.dot(h);
        let is_reflected = u_lobe < fresnel_dielectric(cosine, eta);
        let wi = if is_reflected { reflect_about(above, h) } else { refract_about(above, h, eta)? };
        if (wi.z > 0.0) != is_reflected || wi.z == 0.0 {
            return None;
        }
        let mut throughput = self.facets.masking_ratio(above, wi);
        if !is_reflected && mode == TransportMode::Radiance {
            throughput /= eta * eta;
        }
        let wi = Vec3::new(wi.x, wi.y, wi.z * 1f32.copysign(wo.z));
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then_some(PartSample {
            wi,
            throughput: Rgb::splat(throughput),
            pdf,
            transmission: !is_reflected,
        })
    }
}

/// The generalised half vector of a reflection or a refraction, on the side of `wo` (whose cosine is positive here); and the factor
/// `|dh/dwi| / (wo . h)` that converts a density of the half vector over `wo . h` into a density of `wi`. `None` where no facet leads
/// from one direction to the other.
#[inline]
pub(super) fn facet(wo: Vec3, wi: Vec3, eta: f32) -> Option<(Vec3, f32)> {
    if wi.z > 0.0 {
        return half_vector(wo, wi).map(|h| (h, 0.25));
    }
    let sum = wo + wi * eta;
    let h = crate::math::unit(sum)?;
    let h = if h.z < 0.0 { -h } else { h };
    let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
    if !(cos_o > 0.0 && cos_i < 0.0) {
        return None;
    }
    // The length of the half vector before normalisation is |wo . h + eta wi . h|.
    let factor = eta * eta * -cos_i * cos_o / sum.length_squared();
    factor.is_finite().then_some((h, factor))
}

/// The direction into which `wo` is refracted at a facet with normal `h` on the side of `wo`; `None` beyond the critical angle. `eta` is
/// the index behind the facet over that before it.
#[inline]
pub(super) fn refract_about(wo: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cosine = wo.dot(h);
    // As in `refract`: eta^2 cos_t^2 without cancellation near one.
    let a_squared = (eta - 1.0) * (eta + 1.0) + cosine * cosine;
    if !(a_squared > 0.0) {
        return None;
    }
    let wi = h * (cosine - a_squared.sqrt()) - wo;
    Some(wi / wi.length())
}
