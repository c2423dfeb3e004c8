//! Layered model: the material of glTF 2.0 (specification, appendix B, with the KHR extensions for index of refraction, specular,
//! transmission, volume, anisotropy and clear coat).

use super::ggx::{Ggx, SMOOTH_ROUGHNESS, half_vector, reflect_about};
use super::layered_albedo::{gloss_albedo, mean_gloss_albedo};
use super::part::{choose, lobe_of};
use super::rough_dielectric::{facet, refract_about};
use super::{
    BsdfSample, Dielectric, Lambert, Lobe, MATCHED_IOR_TOLERANCE, TransportMode, fresnel_dielectric, reflect,
    refract,
};
use crate::math::{Frame, Rgb};
use crate::sampling::warp::cosine_hemisphere_pdf;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Reflectance of a clear coat at normal incidence, for an index of refraction of 1.5 (KHR_materials_clearcoat).
const COAT_F0: f32 = 0.04;

/// Largest reflectance at normal incidence of a slightly glossy part that may be read together with a diffuse one, by irradiance alone.
const FAINT_GLOSS: f32 = 0.08;

/// Smallest reflectance of the diffuse part for that.
const CLEAR_DIFFUSE: f32 = 0.05;

/// What lies below the microfacets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {
    /// No light passes.
    Opaque,
    /// A sheet without thickness: light that passes is not bent.
    Thin,
    /// An interface between media; the frame is that of the surface, as for [`Dielectric`].
    Interface(Dielectric),
}

/// Parameters in the terms of glTF, after textures and factors have been multiplied. Colours and shares are in `[0, 1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayeredParameters {
    /// `baseColor`, without alpha.
    pub base: Rgb,
    /// `metallic`.
    pub metallic: f32,
    /// The GGX alpha along the frame's x axis and across it: the square of `roughness`, stretched by anisotropy.
    pub roughness: [f32; 2],
    /// `ior`, at least 1; an interface uses its own index instead.
    pub ior: f32,
    /// `specularFactor`.
    pub specular: f32,
    /// `specularColorFactor`; may exceed 1.
    pub specular_colour: Rgb,
    /// `transmissionFactor`; has no effect in an opaque body.
    pub transmission: f32,
    /// What lies below the microfacets.
    pub body: Body,
    /// `clearcoatFactor`.
    pub coat: f32,
    /// The GGX alpha of the coat.
    pub coat_roughness: f32,
    /// Normal of the coat in the frame, unit length; `Vec3::Z` where it follows the base.
    pub coat_normal: Vec3,
}

impl Default for LayeredParameters {
    /// The defaults of glTF.
    fn default() -> Self {
        Self {
            base: Rgb::ONE,
            metallic: 1.0,
            roughness: [1.0; 2],
            ior: 1.5,
            specular: 1.0,
            specular_colour: Rgb::ONE,
            transmission: 0.0,
            body: Body::Opaque,
            coat: 0.0,
            coat_roughness: 0.0,
            coat_normal: Vec3::Z,
        }
    }
}

/// A clear coat over GGX microfacets over a diffuse, transparent or metallic base.
///
/// The facets reflect `F0 + (F90 - F0) (1 - cos)^5`, a mixture of dielectric and metal; an interface uses Fresnel's formula for its
/// dielectric share. The base receives the light that the facets leave, on the way in and on the way out: `c/pi T(o) T(i) / mean(T)`
/// with `T = 1 - albedo of the facets` (Kelemen & Szirmay-Kalos 2001, section 2.2). The whole model is therefore reciprocal and reflects
/// at most the incident light, which does not hold for the plain `1 - F` of the specification. A coat leaves `T_c(o) T_c(i)` to
/// everything below it. Facets scatter once. Interreflection between the layers is neglected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layered {
    /// Albedo of the diffuse base, without the shares that are metallic or transmitted.
    diffuse: Rgb,
    /// Share of the light passing the facets that continues behind the surface.
    transmitted: Rgb,
    /// Schlick's term at normal (`f0`) and at grazing incidence (`f90`).
    f0: Rgb,
    f90: f32,
    /// Schlick's term of the dielectric alone, largest channel: light that the base does not receive.
    over_base: [f32; 2],
    /// Share of Fresnel's exact term, for interfaces; zero otherwise.
    exact: f32,
    /// The facets of the base; zero slopes if they are smooth.
    facets: Ggx,
    coat: f32,
    coat_facets: Ggx,
    coat_normal: Vec3,
    body: Body,
    /// Set by [`Self::seen_from`].
    lambert: Option<Lambert>,
}

/// The layers that are not delta distributions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layer {
    Diffuse,
    Gloss,
    Coat,
}

/// Weights of the deltas in one direction: mirrored by the base (and by a coat with the same normal), transmitted, and mirrored by a
/// coat with its own normal.
struct Deltas {
    mirrored: Rgb,
    passing: Rgb,
    coat: Rgb,
}

fn facets_of([along, across]: [f32; 2]) -> Ggx {
    let slope = |x: f32| if x.is_nan() { 1.0 } else { x.clamp(0.0, 1.0) };
    let (along, across) = (slope(along), slope(across));
    if along < SMOOTH_ROUGHNESS && across < SMOOTH_ROUGHNESS {
        return Ggx { along: 0.0, across: 0.0 };
    }
    Ggx { along: along.max(SMOOTH_ROUGHNESS), across: across.max(SMOOTH_ROUGHNESS) }
}

fn is_smooth(facets: &Ggx) -> bool {
    facets.along == 0.0
}

/// Geometric mean of both slopes, by which the tables describe a lobe.
fn mean_slope(facets: &Ggx) -> f32 {
    (facets.along * facets.across).sqrt()
}

/// `(1 - cos)^5`.
#[inline]
fn grazing(cosine: f32) -> f32 {
    let x = (1.0 - cosine).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}

#[inline]
fn flipped(w: Vec3) -> Vec3 {
    Vec3::new(w.x, w.y, -w.z)
}

impl Layered {
    /// The model with these parameters; values out of range are clamped.
    pub fn new(p: &LayeredParameters) -> Self {
        let share = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
        let base = p.base.clamp(Rgb::ZERO, Rgb::ONE);
        let (metallic, specular) = (share(p.metallic), share(p.specular));
        let transmission = if p.body == Body::Opaque { 0.0 } else { share(p.transmission) };
        let normal = ((p.ior - 1.0) / (p.ior + 1.0)).powi(2);
        let is_matched = p.ior - 1.0 < MATCHED_IOR_TOLERANCE as f32;
        let specular = if is_matched { 0.0 } else { specular };
        let f0 = (p.specular_colour.max(Rgb::ZERO) * normal).min(Rgb::ONE) * specular;
        let dielectric = 1.0 - metallic;
        let is_interface = matches!(p.body, Body::Interface(_));
        let exact = if is_interface { dielectric } else { 0.0 };
        let schlick = if is_interface { 0.0 } else { dielectric };
        // Schlick's term is below Fresnel's by at most this much.
        let least = if is_interface { f0.max_element() + 0.03 } else { f0.max_element() };
        Self {
            diffuse: base * (dielectric * (1.0 - transmission)),
            transmitted: base * (dielectric * transmission),
            f0: f0 * schlick + base * metallic,
            f90: specular * schlick + metallic,
            over_base: [least.min(1.0), specular.max(least.min(1.0))],
            exact,
            // Facets between equal indices of refraction neither reflect nor refract.
            facets: match &p.body {
                Body::Interface(interface) if interface.is_matched() => facets_of([0.0; 2]),
                _ => facets_of(p.roughness),
            },
            coat: share(p.coat),
            coat_facets: facets_of([p.coat_roughness; 2]),
            coat_normal: p.coat_normal,
            body: p.body,
            lambert: None,
        }
    }

    /// The same model seen from `wo`, which determines how it reflects irradiance ([`super::Bsdf::lambertian`]): a diffuse base, and
    /// slightly glossy parts that add no more than a few percent, are read together through their albedo.
    #[inline]
    #[must_use]
    pub fn seen_from(self, wo: Vec3) -> Self {
        let is_mixed = self.has_gloss_in(Lobe::Diffuse) || self.has_coat_in(Lobe::Diffuse);
        let is_faint = self.f0.max_element() <= FAINT_GLOSS && self.diffuse.max_element() >= CLEAR_DIFFUSE;
        let is_lambertian = self.diffuse != Rgb::ZERO && (!is_mixed || is_faint);
        let reflectance = || self.lobe_albedo(Lobe::Diffuse, wo).min(Rgb::ONE);
        Self { lambert: is_lambertian.then(|| Lambert { reflectance: reflectance() }), ..self }
    }

    /// The same model at an interface between other media.
    #[inline]
    #[must_use]
    pub fn with_interface(self, interface: Dielectric) -> Self {
        let facets = if interface.is_matched() { facets_of([0.0; 2]) } else { self.facets };
        Self { body: Body::Interface(interface), facets, ..self }
    }

    /// Sets the unit normal of the coat in the frame.
    pub fn set_coat_normal(&mut self, normal: Vec3) {
        self.coat_normal = normal;
    }

    #[inline]
    pub(super) fn lambertian(&self) -> Option<Lambert> {
        self.lambert
    }

    #[inline]
    fn is_interface(&self) -> bool {
        matches!(self.body, Body::Interface(_))
    }

    /// Whether light passes through it, refracted or not.
    pub fn transmits(&self) -> bool {
        self.transmitted != Rgb::ZERO
    }

    #[inline]
    pub(super) fn is_anisotropic(&self) -> bool {
        self.facets.along != self.facets.across
    }

    /// Whether the model scatters on the side of `wo`.
    #[inline]
    pub(super) fn is_lit(&self, wo: Vec3) -> bool {
        if self.is_interface() { wo.z != 0.0 && !wo.z.is_nan() } else { wo.z > 0.0 }
    }

    /// Whether the facets have any effect.
    #[inline]
    fn has_facets(&self) -> bool {
        self.f90 > 0.0 || self.exact > 0.0 || self.f0 != Rgb::ZERO || self.transmitted != Rgb::ZERO
    }

    /// Lobe of the rough facets. Photons could find transmitted light from one side only, so that transmitting facets are traced.
    #[inline]
    fn gloss_lobe(&self) -> Lobe {
        if self.transmitted == Rgb::ZERO && self.exact == 0.0 {
            lobe_of(self.facets.along.min(self.facets.across))
        } else {
            Lobe::Glossy
        }
    }

    #[inline]
    fn has_gloss_in(&self, lobe: Lobe) -> bool {
        !is_smooth(&self.facets) && self.gloss_lobe() == lobe && self.has_facets()
    }

    #[inline]
    fn has_coat_in(&self, lobe: Lobe) -> bool {
        self.coat > 0.0 && !is_smooth(&self.coat_facets) && lobe_of(self.coat_facets.along) == lobe
    }

    #[inline]
    pub(super) fn has_diffuse(&self) -> bool {
        self.diffuse != Rgb::ZERO || self.has_gloss_in(Lobe::Diffuse) || self.has_coat_in(Lobe::Diffuse)
    }

    #[inline]
    pub(super) fn has_glossy(&self) -> bool {
        self.has_gloss_in(Lobe::Glossy) || self.has_coat_in(Lobe::Glossy)
    }

    #[inline]
    pub(super) fn has_specular(&self) -> bool {
        is_smooth(&self.facets) && self.has_facets() || self.coat > 0.0 && is_smooth(&self.coat_facets)
    }

    /// Whether the model consists of deltas alone, with at most one mirrored and one transmitted direction.
    #[inline]
    pub(super) fn is_delta(&self) -> bool {
        let is_even = self.coat == 0.0 || self.coat_normal == Vec3::Z;
        !self.has_diffuse() && !self.has_glossy() && self.has_specular() && is_even
    }

    /// Index of refraction behind the facets over that before them, as seen from `wo`; one where light is not refracted.
    #[inline]
    fn eta(&self, wo: Vec3) -> f32 {
        if let Body::Interface(interface) = &self.body { interface.relative_ior(wo) } else { 1.0 }
    }

    /// Reflectance of the facets at this cosine, and the share of the incident light that they transmit.
    #[inline]
    fn fresnel(&self, cosine: f32, eta: f32) -> (Rgb, Rgb) {
        let x = grazing(cosine);
        let schlick = self.f0 + (Rgb::splat(self.f90) - self.f0) * x;
        if self.exact > 0.0 {
            let exact = fresnel_dielectric(cosine, eta);
            return (schlick + Rgb::splat(self.exact * exact), self.transmitted * (1.0 - exact));
        }
        let [f0, f90] = self.over_base;
        (schlick, self.transmitted * (1.0 - (f0 + (f90 - f0) * x)).max(0.0))
    }

    /// Share of the light that the facets of the dielectric leave to the base, for one direction.
    #[inline]
    fn left_to_base(&self, w: Vec3) -> f32 {
        let [f0, f90] = self.over_base;
        1.0 - gloss_albedo(w.z.abs(), mean_slope(&self.facets), f0, f90)
    }

    /// Share of the light that the coat leaves to everything below it, for one direction. There is no coat inside of a medium.
    #[inline]
    fn left_by_coat(&self, w: Vec3) -> f32 {
        if self.coat == 0.0 || w.z < 0.0 && self.is_interface() {
            return 1.0;
        }
        let cosine = self.coat_normal.dot(Vec3::new(w.x, w.y, w.z.abs()));
        1.0 - self.coat * gloss_albedo(cosine.max(0.0), self.coat_facets.along, COAT_F0, 1.0)
    }

    #[inline]
    fn eval_diffuse(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if !(wo.z > 0.0 && wi.z > 0.0) {
            return Rgb::ZERO;
        }
        let [f0, f90] = self.over_base;
        let mean = 1.0 - mean_gloss_albedo(mean_slope(&self.facets), f0, f90);
        let left = self.left_to_base(wo) * self.left_to_base(wi) / mean;
        self.diffuse * (FRAC_1_PI * left * self.left_by_coat(wo) * self.left_by_coat(wi))
    }

    #[inline]
    fn eval_gloss(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        let passes = wo.z * wi.z < 0.0;
        if !self.is_lit(wo) || wi.z == 0.0 || passes && self.transmitted == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let coats = self.left_by_coat(wo) * self.left_by_coat(wi);
        let (eta, side) = (self.eta(wo), Vec3::new(1.0, 1.0, 1f32.copysign(wo.z)));
        let (wo, wi) = (wo * side, wi * side);
        let value = if passes && self.is_interface() {
            let Some((h, factor)) = facet(wo, wi, eta) else { return Rgb::ZERO };
            let scale = if mode == TransportMode::Radiance { 1.0 / (eta * eta) } else { 1.0 };
            let shape = self.facets.density(h) * self.facets.masking_over_cosines(wo, wi) * factor;
            self.fresnel(wo.dot(h), eta).1 * (shape * scale)
        } else {
            let mirrored = if passes { flipped(wi) } else { wi };
            let Some(h) = half_vector(wo, mirrored) else { return Rgb::ZERO };
            let shape = 0.25 * self.facets.density(h) * self.facets.masking_over_cosines(wo, mirrored);
            let (reflected, passed) = self.fresnel(wo.dot(h), eta);
            (if passes { passed } else { reflected }) * shape
        };
        if value.is_finite() { value * coats } else { Rgb::ZERO }
    }

    /// Both directions in the frame of the coat; `None` where one of them is below its horizon.
    #[inline]
    fn on_coat(&self, wo: Vec3, wi: Vec3) -> Option<(Vec3, Vec3)> {
        if !(wo.z > 0.0 && wi.z > 0.0) {
            return None;
        }
        if self.coat_normal == Vec3::Z {
            return Some((wo, wi));
        }
        let frame = Frame::from_z(self.coat_normal);
        let (wo, wi) = (frame.to_local(wo), frame.to_local(wi));
        (wo.z > 0.0 && wi.z > 0.0).then_some((wo, wi))
    }

    #[inline]
    fn coat_reflectance(&self, cosine: f32) -> f32 {
        self.coat * (COAT_F0 + (1.0 - COAT_F0) * grazing(cosine))
    }

    #[inline]
    fn eval_coat(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some((o, i)) = self.on_coat(wo, wi) else { return Rgb::ZERO };
        let Some(h) = half_vector(o, i) else { return Rgb::ZERO };
        let shape = 0.25 * self.coat_facets.density(h) * self.coat_facets.masking_over_cosines(o, i);
        // The caller multiplies by the cosine at the base, which may count no more than the cosine at the coat.
        let cosines = (o.z / wo.z).min(1.0) * (i.z / wi.z).min(1.0);
        let value = self.coat_reflectance(o.dot(h)) * shape * cosines;
        if value.is_finite() { Rgb::splat(value) } else { Rgb::ZERO }
    }

    #[inline]
    fn pdf_gloss(&self, wo: Vec3, wi: Vec3) -> f32 {
        let passes = wo.z * wi.z < 0.0;
        if !self.is_lit(wo) || wi.z == 0.0 {
            return 0.0;
        }
        let (eta, side) = (self.eta(wo), Vec3::new(1.0, 1.0, 1f32.copysign(wo.z)));
        let (wo, wi) = (wo * side, wi * side);
        let (h, factor) = if passes && self.is_interface() {
            let Some(found) = facet(wo, wi, eta) else { return 0.0 };
            found
        } else {
            let Some(h) = half_vector(wo, if passes { flipped(wi) } else { wi }) else { return 0.0 };
            (h, 0.25)
        };
        let reflected = self.reflection_share(wo.dot(h), eta);
        let share = if passes { 1.0 - reflected } else { reflected };
        let pdf = share * self.facets.visible_over_cosine(wo, h) * factor;
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Probability with which sampling chooses reflection at a facet.
    #[inline]
    fn reflection_share(&self, cosine: f32, eta: f32) -> f32 {
        let (reflected, passed) = self.fresnel(cosine, eta);
        let (reflected, passed) = (reflected.max_element(), passed.max_element());
        if passed > 0.0 { reflected / (reflected + passed) } else { 1.0 }
    }

    #[inline]
    fn sample_gloss(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<Vec3> {
        let (eta, side) = (self.eta(wo), Vec3::new(1.0, 1.0, 1f32.copysign(wo.z)));
        let above = wo * side;
        let h = self.facets.sample_visible(above, u);
        let is_reflected = u_lobe < self.reflection_share(above.dot(h), eta);
        let wi = match (is_reflected, self.is_interface()) {
            (true, _) => reflect_about(above, h),
            (false, true) => refract_about(above, h, eta)?,
            (false, false) => {
                let mirrored = reflect_about(above, h);
                if mirrored.z <= 0.0 {
                    return None;
                }
                flipped(mirrored)
            }
        };
        ((wi.z > 0.0) == is_reflected && wi.z != 0.0).then_some(wi * side)
    }

    #[inline]
    fn pdf_coat(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some((o, i)) = self.on_coat(wo, wi) else { return 0.0 };
        half_vector(o, i).map_or(0.0, |h| 0.25 * self.coat_facets.visible_over_cosine(o, h))
    }

    #[inline]
    fn sample_coat(&self, wo: Vec3, u: Vec2) -> Option<Vec3> {
        let frame = Frame::from_z(self.coat_normal);
        let is_even = self.coat_normal == Vec3::Z;
        let o = if is_even { wo } else { frame.to_local(wo) };
        if !(o.z > 0.0) {
            return None;
        }
        let i = reflect_about(o, self.coat_facets.sample_visible(o, u));
        let wi = if is_even { i } else { frame.to_world(i) };
        (i.z > 0.0 && wi.z > 0.0).then_some(wi)
    }

    /// Estimated albedo of a layer in a lobe; exactly zero where the layer has no part in it.
    #[inline]
    fn layer_albedo(&self, layer: Layer, lobe: Lobe, wo: Vec3) -> Rgb {
        match layer {
            Layer::Diffuse if lobe == Lobe::Diffuse && wo.z > 0.0 => {
                self.diffuse * (self.left_to_base(wo) * self.left_by_coat(wo))
            }
            Layer::Gloss if self.has_gloss_in(lobe) => {
                let left = self.left_by_coat(wo);
                let slope = mean_slope(&self.facets);
                let albedo = |f0, f90| gloss_albedo(wo.z.abs(), slope, f0, f90);
                let schlick = Rgb::from_array(self.f0.to_array().map(|f0| albedo(f0, self.f90)));
                let (reflected, passed) = if self.exact > 0.0 {
                    let exact = fresnel_dielectric(wo.z.abs(), self.eta(wo));
                    (Rgb::splat(self.exact * exact), self.transmitted * (1.0 - exact))
                } else {
                    let [f0, f90] = self.over_base;
                    (Rgb::ZERO, self.transmitted * (1.0 - albedo(f0, f90)).max(0.0))
                };
                // Facets away from the normal may reflect where those at the normal do not.
                ((schlick + reflected + passed) * left).max(Rgb::splat(1e-4))
            }
            Layer::Coat if self.has_coat_in(lobe) && wo.z > 0.0 => {
                let cosine = self.coat_normal.dot(wo);
                let albedo = self.coat * gloss_albedo(cosine.max(0.0), self.coat_facets.along, COAT_F0, 1.0);
                Rgb::splat(if cosine > 0.0 { albedo } else { 0.0 })
            }
            _ => Rgb::ZERO,
        }
    }

    #[inline]
    fn deltas(&self, wo: Vec3, mode: TransportMode) -> Deltas {
        let mut found = Deltas { mirrored: Rgb::ZERO, passing: Rgb::ZERO, coat: Rgb::ZERO };
        if !self.is_lit(wo) {
            return found;
        }
        let left = self.left_by_coat(wo);
        if is_smooth(&self.facets) && self.has_facets() {
            let eta = self.eta(wo);
            let (reflected, passed) = self.fresnel(wo.z.abs(), eta);
            found.mirrored = reflected * (left * self.left_by_coat(reflect(wo)));
            if passed != Rgb::ZERO
                && let Some(wi) = self.straight_on(wo)
            {
                let scale = match (mode, self.is_interface()) {
                    (TransportMode::Radiance, true) => 1.0 / (eta * eta),
                    _ => 1.0,
                };
                found.passing = passed * (left * self.left_by_coat(wi) * scale);
            }
        }
        if self.coat > 0.0 && is_smooth(&self.coat_facets) && wo.z > 0.0 {
            let cosine = self.coat_normal.dot(wo);
            let reflected = Rgb::splat(self.coat_reflectance(cosine));
            if self.coat_normal == Vec3::Z {
                found.mirrored += reflected;
            } else if cosine > 0.0 && reflect_about(wo, self.coat_normal).z > 0.0 {
                found.coat = reflected;
            }
        }
        found
    }

    /// Direction of light that is transmitted by a smooth base.
    #[inline]
    fn straight_on(&self, wo: Vec3) -> Option<Vec3> {
        match &self.body {
            Body::Opaque => None,
            Body::Thin => Some(-wo),
            Body::Interface(interface) if interface.is_matched() => Some(-wo),
            Body::Interface(interface) => refract(wo, interface.relative_ior(wo)),
        }
    }

    /// See [`super::Bsdf::lobe_albedo`].
    #[inline]
    pub(super) fn lobe_albedo(&self, lobe: Lobe, wo: Vec3) -> Rgb {
        if lobe == Lobe::Specular {
            let Deltas { mirrored, passing, coat } = self.deltas(wo, TransportMode::Flux);
            return mirrored + passing + coat;
        }
        if !self.is_lit(wo) {
            return Rgb::ZERO;
        }
        [Layer::Diffuse, Layer::Gloss, Layer::Coat]
            .into_iter()
            .fold(Rgb::ZERO, |sum, layer| sum + self.layer_albedo(layer, lobe, wo))
    }

    /// See [`super::Bsdf::eval`].
    #[inline]
    pub(super) fn eval(&self, lobe: Lobe, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        let mut f = Rgb::ZERO;
        if lobe == Lobe::Diffuse && self.diffuse != Rgb::ZERO {
            f += self.eval_diffuse(wo, wi);
        }
        if self.has_gloss_in(lobe) {
            f += self.eval_gloss(wo, wi, mode);
        }
        if self.has_coat_in(lobe) {
            f += self.eval_coat(wo, wi);
        }
        f
    }

    /// Probabilities of the layers of a lobe; `None` where no layer has a part in it.
    #[inline]
    fn shares(&self, lobe: Lobe, wo: Vec3) -> Option<[f32; 3]> {
        let weight = |layer| self.layer_albedo(layer, lobe, wo).max_element();
        let weights = [weight(Layer::Diffuse), weight(Layer::Gloss), weight(Layer::Coat)];
        let total: f32 = weights.iter().sum();
        (total > 0.0).then(|| weights.map(|weight| weight / total))
    }

    /// See [`super::Bsdf::pdf_solid_angle`].
    #[inline]
    pub(super) fn pdf_solid_angle(&self, lobe: Lobe, wo: Vec3, wi: Vec3) -> f32 {
        if lobe == Lobe::Specular || !self.is_lit(wo) {
            return 0.0;
        }
        let Some([diffuse, gloss, coat]) = self.shares(lobe, wo) else { return 0.0 };
        let mut pdf = 0.0;
        if diffuse > 0.0 && wi.z > 0.0 {
            pdf += diffuse * cosine_hemisphere_pdf(wi.z);
        }
        if gloss > 0.0 {
            pdf += gloss * self.pdf_gloss(wo, wi);
        }
        if coat > 0.0 {
            pdf += coat * self.pdf_coat(wo, wi);
        }
        pdf
    }

    /// See [`super::Bsdf::sample_lobe`].
    #[inline]
    pub(super) fn sample_lobe(
        &self,
        lobe: Lobe,
        wo: Vec3,
        u_lobe: f32,
        u: Vec2,
        mode: TransportMode,
    ) -> Option<BsdfSample> {
        if !self.is_lit(wo) {
            return None;
        }
        if lobe == Lobe::Specular {
            return self.sample_delta(wo, u_lobe, mode);
        }
        let [diffuse, gloss, _] = self.shares(lobe, wo)?;
        let (is_diffuse, u_lobe) = choose(u_lobe, diffuse);
        let wi = if is_diffuse {
            Lambert::sample_direction(u)
        } else {
            let (is_gloss, u_lobe) = choose(u_lobe, gloss / (1.0 - diffuse));
            if is_gloss { self.sample_gloss(wo, u_lobe, u)? } else { self.sample_coat(wo, u)? }
        };
        let pdf = self.pdf_solid_angle(lobe, wo, wi);
        let throughput = self.eval(lobe, wo, wi, mode) * (wi.z.abs() / pdf);
        let transmission = wi.z * wo.z < 0.0;
        (pdf > 0.0 && throughput.is_finite()).then_some(BsdfSample {
            wi,
            throughput,
            pdf_solid_angle: pdf,
            lobe,
            transmission,
        })
    }

    /// Probability with which [`Self::sample_delta`] mirrors. It is based on flux, so that it is the same in both modes.
    #[inline]
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        let Deltas { mirrored, passing, coat } = self.deltas(wo, TransportMode::Flux);
        let (mirrored, others) = (mirrored.max_element(), passing.max_element() + coat.max_element());
        if others > 0.0 { mirrored / (mirrored + others) } else { 1.0 }
    }

    /// Whether [`Self::sample_delta`] mirrors into a single direction.
    pub(super) fn has_one_mirror(&self, wo: Vec3) -> bool {
        self.deltas(wo, TransportMode::Flux).coat == Rgb::ZERO
    }

    fn sample_delta(&self, wo: Vec3, u_lobe: f32, mode: TransportMode) -> Option<BsdfSample> {
        let by_flux = self.deltas(wo, TransportMode::Flux);
        let values = self.deltas(wo, mode);
        let [mirrored, passing, coat] =
            [by_flux.mirrored, by_flux.passing, by_flux.coat].map(|value| value.max_element());
        let total = mirrored + passing + coat;
        if !(total > 0.0) {
            return None;
        }
        let (is_mirrored, u_lobe) = choose(u_lobe, self.reflection_probability(wo));
        let (wi, value, weight) = if is_mirrored {
            (reflect(wo), values.mirrored, mirrored)
        } else if choose(u_lobe, passing / (passing + coat)).0 {
            (self.straight_on(wo)?, values.passing, passing)
        } else {
            (reflect_about(wo, self.coat_normal), values.coat, coat)
        };
        let throughput = value * (total / weight);
        (wi.z != 0.0 && throughput.is_finite()).then_some(BsdfSample {
            wi,
            throughput,
            pdf_solid_angle: f32::INFINITY,
            lobe: Lobe::Specular,
            transmission: wi.z * wo.z < 0.0,
        })
    }
}
