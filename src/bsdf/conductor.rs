//! Metals: Fresnel reflectance of conductors, and rough metal surfaces.

use super::ggx::{Ggx, SMOOTH_ROUGHNESS, half_vector, reflect_about};
use super::part::PartSample;
use super::reflect;
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// Reflectance of a metal by angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Metal {
    /// Exact formula for an index of refraction `eta + i k` per channel, against air.
    Index {
        /// Real part.
        eta: Rgb,
        /// Imaginary part, the extinction coefficient.
        k: Rgb,
    },
    /// Colour at normal incidence, with Schlick's approximation (1994) for other angles.
    Colour(Rgb),
}

impl Metal {
    /// Reflectance for unpolarised light at this cosine with the normal, in `[0, 1]`.
    #[inline]
    pub fn reflectance(&self, cosine: f32) -> Rgb {
        match *self {
            Self::Index { eta, k } => Rgb::new(
                fresnel_conductor(cosine, eta.x, k.x),
                fresnel_conductor(cosine, eta.y, k.y),
                fresnel_conductor(cosine, eta.z, k.z),
            ),
            Self::Colour(colour) => schlick_fresnel(colour, cosine),
        }
    }
}

/// `C + (1 - C) (1 - cos)^5`, Schlick's approximation of Fresnel's formula (1994, eq. 15).
#[inline]
pub fn schlick_fresnel(colour: Rgb, cosine: f32) -> Rgb {
    let x = (1.0 - cosine).clamp(0.0, 1.0);
    let x2 = x * x;
    colour + (Rgb::ONE - colour) * (x2 * x2 * x)
}

/// Fraction of unpolarised light that a smooth metal of index `eta + i k` reflects (Born & Wolf, section 14.2).
#[inline]
pub fn fresnel_conductor(cosine: f32, eta: f32, k: f32) -> f32 {
    let cos = cosine.abs().min(1.0);
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    let (eta2, k2) = (eta * eta, k * k);
    let t0 = eta2 - k2 - sin2;
    let a2b2 = (t0 * t0 + 4.0 * eta2 * k2).sqrt();
    let a = (0.5 * (a2b2 + t0)).max(0.0).sqrt();
    let s = (a2b2 + cos2 - 2.0 * cos * a) / (a2b2 + cos2 + 2.0 * cos * a);
    let t3 = cos2 * a2b2 + sin2 * sin2;
    let t4 = 2.0 * cos * a * sin2;
    let p = s * (t3 - t4) / (t3 + t4);
    let r = 0.5 * (s + p);
    if r.is_nan() { 1.0 } else { r.clamp(0.0, 1.0) }
}

/// A rough metal: GGX microfacets that reflect once like the metal. Light reflected from facet to facet is lost, so that the albedo
/// falls with roughness: 0.31 at roughness one and normal incidence for a metal that reflects everything.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    metal: Metal,
    facets: Ggx,
}

impl Conductor {
    /// Whether a rotation about the normal changes the model.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.facets.along != self.facets.across
    }

    /// `roughness` is the GGX alpha along the frame's x axis and across it, in `[0, 1]`. If both values are below [`SMOOTH_ROUGHNESS`],
    /// the metal is a mirror.
    pub fn new(metal: Metal, [along, across]: [f32; 2]) -> Self {
        let facets = if along < SMOOTH_ROUGHNESS && across < SMOOTH_ROUGHNESS {
            Ggx { along: 0.0, across: 0.0 }
        } else {
            Ggx { along: along.max(SMOOTH_ROUGHNESS), across: across.max(SMOOTH_ROUGHNESS) }
        };
        Self { metal, facets }
    }

    /// Whether the metal is a mirror.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        self.facets.along == 0.0
    }

    /// The smaller of the two roughnesses.
    #[inline]
    pub fn roughness(&self) -> f32 {
        self.facets.along.min(self.facets.across)
    }

    /// The reflectance at this angle, which is the lobe's albedo without masking. It is positive for a rough metal, which may reflect by
    /// other facets where those at the normal are black.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let least = if self.is_smooth() { 0.0 } else { 1e-3 };
        self.metal.reflectance(wo.z).max(Rgb::splat(least))
    }

    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(h) = half_vector(wo, wi) else { return Rgb::ZERO };
        let shape = 0.25 * self.facets.density(h) * self.facets.masking_over_cosines(wo, wi);
        self.metal.reflectance(wo.dot(h)) * shape
    }

    #[inline]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        half_vector(wo, wi).map_or(0.0, |h| 0.25 * self.facets.visible_over_cosine(wo, h))
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<PartSample> {
        let h = self.facets.sample_visible(wo, u);
        let wi = reflect_about(wo, h);
        let throughput = self.metal.reflectance(wo.dot(h)) * self.facets.masking_ratio(wo, wi);
        (wi.z > 0.0).then(|| PartSample::reflected(wi, throughput, self.pdf(wo, wi)))
    }

    #[inline]
    pub(super) fn sample_smooth(&self, wo: Vec3) -> PartSample {
        PartSample::delta(reflect(wo), self.metal.reflectance(wo.z))
    }
}
