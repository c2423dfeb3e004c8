//! Schlick's reflectance model, from specular to diffuse.

use super::ggx::{Ggx, SMOOTH_ROUGHNESS, half_vector, reflect_about};
use super::part::PartSample;
use super::{Form, Lambert, reflect, schlick_fresnel};
use crate::math::Rgb;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Schlick's model ("A Customizable Reflectance Model for Everyday Rendering", EG Workshop on Rendering 1993; "An Inexpensive BRDF Model
/// for Physically-based Rendering", Computer Graphics Forum 13(3), 1994) of one layer: `R = S(u) D` with `S(u) = C + (1 - C) (1 - u)^5`
/// and
///
/// ```text
/// D = a/pi + b/(4 pi v v') G(v) G(v') Z(t) A(w) + b/pi (1 - G(v) G(v')) + c delta
/// ```
///
/// where `t`, `v` and `v'` are the cosines of the half vector, `wo` and `wi` to the normal, `u` is the cosine of `wo` to the half
/// vector, and `w` is the cosine of the half vector's projection to the tangent; `Z(t) = r / (1 + r t^2 - t^2)^2`,
/// `A(w) = sqrt(p / (p^2 - p^2 w^2 + w^2))`, `G(v) = v / (r - r v + v)`. The roughness `r` ranges from ideal specular (0) to ideal
/// diffuse (1) and also divides the energy: `b = 4 r (1 - r)`; the rest goes to `a` where `r > 1/2` and otherwise to `c`. `Z` is the
/// GGX distribution with `alpha^2 = r`.
///
/// [`Form::Printed`] is this formula. Its `G` masks less at grazing angles than the facets would, so that its albedo exceeds one there
/// (1.18 for `r = 0.1` at the cosine 0.09; at most 1.6, for `r` about 0.25 at cosines below 0.01). [`Form::Bounded`] takes the smaller
/// of `G` and a masking function with which the albedo cannot exceed one, see [`Schlick::masking_over_cosine`]. It drops the term with
/// `1 - G G'`, the light that continues after masking: masked light is absorbed. Both forms are reciprocal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schlick {
    colour: Rgb,
    roughness: f32,
    isotropy: f32,
    form: Form,
}

impl Schlick {
    /// The same model with its colour multiplied by `tint`, in `[0, 1]`.
    pub fn tinted(mut self, tint: Rgb) -> Self {
        self.colour *= tint;
        self
    }

    /// Whether a rotation about the normal changes the model.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.isotropy != 1.0
    }

    /// `colour` at normal incidence, in `[0, 1]`; `roughness` in `[0, 1]`; `isotropy` in `(0, 1]`: one is isotropic, smaller values
    /// describe grooves along the frame's x axis.
    pub fn new(colour: Rgb, roughness: f32, isotropy: f32, form: Form) -> Self {
        Self { colour, roughness, isotropy: isotropy.max(1e-3), form }
    }

    /// Slope of the microfacets, the GGX alpha.
    #[inline]
    pub fn slope(&self) -> f32 {
        self.roughness.sqrt()
    }

    /// Shares `[a, b, c]` of the diffuse, the glossy and the specular part. A lobe too narrow to be distinguished from a mirror counts
    /// as a mirror.
    #[inline]
    pub fn shares(&self) -> [f32; 3] {
        let r = self.roughness;
        if self.slope() < SMOOTH_ROUGHNESS {
            return [0.0, 0.0, 1.0];
        }
        let gloss = 4.0 * r * (1.0 - r);
        let rest = (1.0 - 2.0 * r) * (1.0 - 2.0 * r);
        if r < 0.5 { [0.0, gloss, rest] } else { [rest, gloss, 0.0] }
    }

    /// Whether the model is a mirror and nothing else.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        self.slope() < SMOOTH_ROUGHNESS
    }

    /// Whether there is a diffuse part.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        let [diffuse, gloss, _] = self.shares();
        diffuse > 0.0 || gloss > 0.0 && self.form == Form::Printed
    }

    /// Estimated albedos of the diffuse, glossy and specular part, for choices between them: positive where the part reflects anything.
    #[inline]
    pub(super) fn albedos(&self, wo: Vec3) -> [Rgb; 3] {
        let [a, b, c] = self.shares();
        let s = schlick_fresnel(self.colour, wo.z).max(Rgb::splat(0.01));
        let masked = match self.form {
            Form::Printed => b * (1.0 - wo.z * self.masking_over_cosine(wo)).max(0.05),
            Form::Bounded => 0.0,
        };
        [s * (a + masked), s * b, schlick_fresnel(self.colour, wo.z) * c]
    }

    /// Computes `G(v) / v`.
    ///
    /// The bounded form is based on this bound. Take a distribution that is the product of `Z` and any density `A` of azimuths, with a
    /// mean `<= 1` and a least value `m`. Without masking on either side, it reflects at most `v M`, `M = m M_1 + (1 - m) M_2`. Here
    /// `M_1 = (1 + sqrt(1 + q^2)) / 2` holds for all azimuths alike (Smith), and `M_2 = 1 + q/2 atan(q)` for the worst case, in which
    /// all facets are turned to the viewer's azimuth and away from it; `q = sqrt(r) tan`. Therefore `G <= 1 / M` bounds the albedo by
    /// one. The least value of `A` is `sqrt(p)`.
    #[inline]
    pub fn masking_over_cosine(&self, w: Vec3) -> f32 {
        let (v, r) = (w.z, self.roughness);
        let printed = 1.0 / (r * (1.0 - v) + v);
        if self.form == Form::Printed {
            return printed;
        }
        let q = self.slope() * (w.x * w.x + w.y * w.y).sqrt();
        let even = 0.5 * (v + (v * v + q * q).sqrt());
        let plane = v + 0.5 * q * (q / v).atan();
        let least = self.isotropy.sqrt();
        printed.min(1.0 / (least * even + (1.0 - least) * plane))
    }

    /// `A(w)` at the azimuth of the half vector; its mean is at most one.
    #[inline]
    fn azimuthal(&self, h: Vec3) -> f32 {
        let p = self.isotropy;
        let a = (p * (h.x * h.x + h.y * h.y) / (p * p * h.y * h.y + h.x * h.x)).sqrt();
        if a.is_finite() { a } else { 1.0 }
    }

    #[inline]
    fn facets(&self) -> Ggx {
        Ggx { along: self.slope(), across: self.slope() }
    }

    #[inline]
    pub(super) fn eval_diffuse(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(h) = half_vector(wo, wi) else { return Rgb::ZERO };
        let [a, b, _] = self.shares();
        let masked = match self.form {
            Form::Printed => {
                1.0 - (wo.z * self.masking_over_cosine(wo)) * (wi.z * self.masking_over_cosine(wi))
            }
            Form::Bounded => 0.0,
        };
        schlick_fresnel(self.colour, wo.dot(h)) * ((a + b * masked.max(0.0)) * FRAC_1_PI)
    }

    #[inline]
    pub(super) fn sample_diffuse(&self, wo: Vec3, u: Vec2) -> PartSample {
        let wi = Lambert::sample_direction(u);
        PartSample::reflected(
            wi,
            self.eval_diffuse(wo, wi) * std::f32::consts::PI,
            crate::sampling::warp::cosine_hemisphere_pdf(wi.z),
        )
    }

    #[inline]
    pub(super) fn eval_gloss(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(h) = half_vector(wo, wi) else { return Rgb::ZERO };
        let masking = self.masking_over_cosine(wo) * self.masking_over_cosine(wi);
        // Z is pi times the density of the facets.
        let shape = 0.25 * self.facets().density(h) * self.azimuthal(h) * masking;
        schlick_fresnel(self.colour, wo.dot(h)) * (self.shares()[1] * shape)
    }

    #[inline]
    pub(super) fn pdf_gloss(&self, wo: Vec3, wi: Vec3) -> f32 {
        half_vector(wo, wi).map_or(0.0, |h| 0.25 * self.facets().visible_over_cosine(wo, h))
    }

    /// Samples visible normals of the isotropic facets; `A` remains as a weight, between `sqrt(p)` and `1 / sqrt(p)`.
    #[inline]
    pub(super) fn sample_gloss(&self, wo: Vec3, u: Vec2) -> Option<PartSample> {
        let facets = self.facets();
        let h = facets.sample_visible(wo, u);
        let wi = reflect_about(wo, h);
        if !(wi.z > 0.0) {
            return None;
        }
        let masking = self.masking_over_cosine(wo) * self.masking_over_cosine(wi);
        let weight = self.azimuthal(h) * masking * wi.z * 0.5 * (wo.z + facets.spread(wo));
        let throughput = schlick_fresnel(self.colour, wo.dot(h)) * (self.shares()[1] * weight);
        Some(PartSample::reflected(wi, throughput, self.pdf_gloss(wo, wi)))
    }

    #[inline]
    pub(super) fn sample_smooth(&self, wo: Vec3) -> PartSample {
        PartSample::delta(reflect(wo), schlick_fresnel(self.colour, wo.z) * self.shares()[2])
    }
}
