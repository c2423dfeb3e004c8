use super::ggx::{Ggx, SMOOTH_ROUGHNESS, half_vector, reflect_about};
use super::part::PartSample;
use super::{Form, Lambert, reflect, schlick_fresnel};
use crate::math::Rgb;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Schlick's model ("A Customizable Reflectance Model for Everyday Rendering", EG Workshop on Rendering 1993; "An
/// Inexpensive BRDF Model for Physically-based Rendering", Computer Graphics Forum 13(3), 1994) of one layer:
/// `R = S(u) D` with `S(u) = C + (1 - C) (1 - u)^5` and
///
/// ```text
/// D = a/pi + b/(4 pi v v') G(v) G(v') Z(t) A(w) + b/pi (1 - G(v) G(v')) + c delta
/// ```
///
/// with `t`, `v`, `v'` the cosines of half vector, `wo` and `wi` to the normal, `u` that of `wo` to the half vector and
/// `w` that of the half vector's projection to the tangent; `Z(t) = r / (1 + r t^2 - t^2)^2`, `A(w) = sqrt(p / (p^2 - p^2
/// w^2 + w^2))`, `G(v) = v / (r - r v + v)`. The roughness `r` goes from ideal specular (0) to ideal diffuse (1) and also
/// divides the energy: `b = 4 r (1 - r)`, the rest to `a` where `r > 1/2`, else to `c`. `Z` is the GGX distribution of
/// `alpha^2 = r`.
///
/// [`Form::Printed`] is that. Its `G` masks less at grazing angles than the facets would, so its albedo exceeds one there
/// (1.18 for `r = 0.1` at the cosine 0.09; at most 1.6, for `r` about 0.25 at cosines below 0.01). [`Form::Bounded`] takes the smaller of `G` and a masking function for
/// which the albedo cannot exceed one, see [`Schlick::masking_over_cosine`], and drops the light sent on after masking,
/// the term with `1 - G G'`: what is masked is absorbed. Both are reciprocal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schlick {
    colour: Rgb,
    roughness: f32,
    isotropy: f32,
    form: Form,
}

impl Schlick {
    /// The same with its colour multiplied by `tint`, in `[0, 1]`.
    pub fn tinted(mut self, tint: Rgb) -> Self {
        self.colour *= tint;
        self
    }

    /// True where a rotation about the normal changes anything.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.isotropy != 1.0
    }

    /// `colour` at normal incidence, in `[0, 1]`; `roughness` in `[0, 1]`; `isotropy` in `(0, 1]`, one for isotropic,
    /// else grooves along the frame's x axis.
    pub fn new(colour: Rgb, roughness: f32, isotropy: f32, form: Form) -> Self {
        Self { colour, roughness, isotropy: isotropy.max(1e-3), form }
    }

    /// Slope of the microfacets, the alpha of GGX.
    #[inline]
    pub fn slope(&self) -> f32 {
        self.roughness.sqrt()
    }

    /// Shares `[a, b, c]` of the diffuse, the glossy and the specular part; a lobe too narrow to be told from a mirror is
    /// one.
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

    /// True where nothing but a mirror is left.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        self.slope() < SMOOTH_ROUGHNESS
    }

    /// True where there is a diffuse part.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        let [diffuse, gloss, _] = self.shares();
        diffuse > 0.0 || gloss > 0.0 && self.form == Form::Printed
    }

    /// Estimates of what diffuse, glossy and specular part reflect, for choices between them: above zero where the part
    /// reflects anything.
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

    /// `G(v) / v`.
    ///
    /// The bounded form rests on this: a distribution that is the product of `Z` and any density `A` of azimuths, with
    /// a mean `<= 1` and a least value `m`, reflects at most `v M`, `M = m M_1 + (1 - m) M_2`, of what is masked by
    /// neither side, where `M_1 = (1 + sqrt(1 + q^2)) / 2` holds for all azimuths alike (Smith) and `M_2 = 1 + q/2
    /// atan(q)` for all facets turned to the viewer's azimuth and away from it, the worst case; `q = sqrt(r) tan`. So
    /// `G <= 1 / M` bounds the albedo by one. The least value of `A` is `sqrt(p)`.
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

    /// `A(w)`, by azimuth of the half vector; its mean is at most one.
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

    /// By visible normals of the isotropic facets; `A` stays as a weight, between `sqrt(p)` and `1 / sqrt(p)`.
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
