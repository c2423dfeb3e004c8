//! Parts of a BSDF model, and their assignment to the lobes of equation (2).

use super::{Bsdf, BsdfSample, Lambert, Lobe, TransportMode};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// Smallest roughness of a slightly glossy part, which belongs to [`Lobe::Diffuse`]: its light is estimated from photons. (Roughness is
/// the alpha of GGX and Ward; for Schlick's model it is the square root of the model's roughness.) Below this value a part is highly
/// glossy, [`Lobe::Glossy`], and followed by distribution rays (Jensen 1996, section 4). At the threshold the density of microfacets has
/// fallen to half at 13 degrees from the normal.
pub const GLOSS_THRESHOLD: f32 = 0.35;

/// The parts of a model that are not delta distributions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Diffuse,
    Gloss,
}

/// A direction sampled from one part.
#[derive(Clone, Copy, Debug)]
pub(super) struct PartSample {
    pub wi: Vec3,
    /// `f |cos| / pdf` of this part alone.
    pub throughput: Rgb,
    pub pdf: f32,
    pub transmission: bool,
}

impl PartSample {
    pub(super) fn reflected(wi: Vec3, throughput: Rgb, pdf: f32) -> Self {
        Self { wi, throughput, pdf, transmission: false }
    }

    pub(super) fn delta(wi: Vec3, throughput: Rgb) -> Self {
        Self { wi, throughput, pdf: f32::INFINITY, transmission: false }
    }

    fn of_lobe(self, lobe: Lobe) -> BsdfSample {
        let Self { wi, throughput, pdf, transmission } = self;
        BsdfSample { wi, throughput, pdf_solid_angle: pdf, lobe, transmission }
    }
}

/// Estimated albedo of each part; exactly zero where the part does not exist.
#[derive(Clone, Copy, Debug)]
struct Parts {
    diffuse: Rgb,
    gloss: Rgb,
    mirror: Rgb,
    gloss_lobe: Lobe,
}

impl Parts {
    /// Share of the diffuse part in the diffuse lobe, which may also contain the glossy part.
    fn share_of_diffuse(&self) -> f32 {
        let (diffuse, gloss) = (self.diffuse.max_element(), self.gloss.max_element());
        if self.gloss_lobe == Lobe::Diffuse { diffuse / (diffuse + gloss) } else { 1.0 }
    }
}

/// The lobe of a glossy part with this roughness.
#[inline]
pub(super) fn lobe_of(roughness: f32) -> Lobe {
    if roughness < GLOSS_THRESHOLD { Lobe::Glossy } else { Lobe::Diffuse }
}

impl Bsdf {
    #[inline]
    fn parts(&self, wo: Vec3) -> Parts {
        let none = Rgb::ZERO;
        let (diffuse, gloss, mirror, gloss_lobe) = match self {
            Self::Lambert(lambert) => (lambert.reflectance, none, none, Lobe::Glossy),
            Self::Mirror(mirror) => (none, none, mirror.reflectance, Lobe::Glossy),
            Self::Dielectric(_) => (none, none, Rgb::ONE, Lobe::Glossy),
            Self::Schlick(schlick) => {
                let [diffuse, gloss, mirror] = schlick.albedos(wo);
                (diffuse, gloss, mirror, lobe_of(schlick.slope()))
            }
            Self::Ward(ward) => (ward.diffuse().reflectance, ward.gloss(), none, lobe_of(ward.roughness())),
            Self::Conductor(metal) if metal.is_smooth() => (none, none, metal.albedo(wo), Lobe::Glossy),
            Self::Conductor(metal) => (none, metal.albedo(wo), none, lobe_of(metal.roughness())),
            // Photons at an interface could be found only on the side from which they came; it is therefore traced, however rough.
            Self::RoughDielectric(_) => (none, Rgb::ONE, none, Lobe::Glossy),
            // Has more parts than these; handled separately.
            Self::Layered(_) => (none, none, none, Lobe::Glossy),
        };
        Parts { diffuse, gloss, mirror, gloss_lobe }
    }

    /// Whether the model scatters on the side of `wo`.
    #[inline]
    fn is_lit(&self, wo: Vec3) -> bool {
        match self {
            Self::Dielectric(_) | Self::RoughDielectric(_) => wo.z != 0.0 && !wo.z.is_nan(),
            Self::Layered(layers) => layers.is_lit(wo),
            _ => wo.z > 0.0,
        }
    }

    /// Albedo of a lobe, reflected and transmitted, for light along `wo`. It is an estimate, except for the Lambert, mirror and
    /// dielectric models, where it is exact. Exactly zero where there is no such lobe.
    #[inline]
    pub fn lobe_albedo(&self, lobe: Lobe, wo: Vec3) -> Rgb {
        if let Self::Layered(layers) = self {
            return layers.lobe_albedo(lobe, wo);
        }
        let parts = self.parts(wo);
        match lobe {
            Lobe::Specular => parts.mirror,
            Lobe::Glossy if parts.gloss_lobe == Lobe::Glossy => parts.gloss,
            Lobe::Glossy => Rgb::ZERO,
            Lobe::Diffuse if parts.gloss_lobe == Lobe::Diffuse => parts.diffuse + parts.gloss,
            Lobe::Diffuse => parts.diffuse,
        }
    }

    /// Largest channel of [`Self::lobe_albedo`] for the diffuse, glossy and specular lobe.
    #[inline]
    pub fn lobe_weights(&self, wo: Vec3) -> [f32; 3] {
        [Lobe::Diffuse, Lobe::Glossy, Lobe::Specular].map(|lobe| self.lobe_albedo(lobe, wo).max_element())
    }

    #[inline]
    fn eval_part(&self, part: Part, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        if let Self::RoughDielectric(interface) = self {
            return if part == Part::Gloss { interface.eval(wo, wi, mode) } else { Rgb::ZERO };
        }
        if !(wo.z > 0.0 && wi.z > 0.0) {
            return Rgb::ZERO;
        }
        match (self, part) {
            (Self::Lambert(lambert), Part::Diffuse) => lambert.eval(wo, wi),
            (Self::Schlick(schlick), Part::Diffuse) => schlick.eval_diffuse(wo, wi),
            (Self::Schlick(schlick), Part::Gloss) => schlick.eval_gloss(wo, wi),
            (Self::Ward(ward), Part::Diffuse) => ward.diffuse().eval(wo, wi),
            (Self::Ward(ward), Part::Gloss) => ward.eval_gloss(wo, wi),
            (Self::Conductor(metal), Part::Gloss) => metal.eval(wo, wi),
            _ => Rgb::ZERO,
        }
    }

    #[inline]
    fn pdf_part(&self, part: Part, wo: Vec3, wi: Vec3) -> f32 {
        if let Self::RoughDielectric(interface) = self {
            return interface.pdf(wo, wi);
        }
        if !(wo.z > 0.0 && wi.z > 0.0) {
            return 0.0;
        }
        match (self, part) {
            (Self::Schlick(schlick), Part::Gloss) => schlick.pdf_gloss(wo, wi),
            (Self::Ward(ward), Part::Gloss) => ward.pdf_gloss(wo, wi),
            (Self::Conductor(metal), Part::Gloss) => metal.pdf(wo, wi),
            _ => crate::sampling::warp::cosine_hemisphere_pdf(wi.z),
        }
    }

    /// Value of the BSDF's `lobe`, 1/sr, without any cosine; zero for [`Lobe::Specular`], whose directions only sampling finds. The
    /// `mode` matters only for transmission.
    #[inline]
    pub fn eval(&self, lobe: Lobe, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        if let (Self::Lambert(lambert), Lobe::Diffuse) = (self, lobe) {
            return lambert.eval(wo, wi);
        }
        if lobe == Lobe::Specular {
            return Rgb::ZERO;
        }
        if let Self::Layered(layers) = self {
            return layers.eval(lobe, wo, wi, mode);
        }
        let parts = self.parts(wo);
        let mut f = Rgb::ZERO;
        if lobe == Lobe::Diffuse && parts.diffuse != Rgb::ZERO {
            f += self.eval_part(Part::Diffuse, wo, wi, mode);
        }
        if parts.gloss_lobe == lobe && parts.gloss != Rgb::ZERO {
            f += self.eval_part(Part::Gloss, wo, wi, mode);
        }
        f
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample_lobe`] samples `wi`; zero for [`Lobe::Specular`].
    #[inline]
    pub fn pdf_solid_angle(&self, lobe: Lobe, wo: Vec3, wi: Vec3) -> f32 {
        if let (Self::Lambert(lambert), Lobe::Diffuse) = (self, lobe) {
            return lambert.pdf_solid_angle(wo, wi);
        }
        if let Self::Layered(layers) = self {
            return layers.pdf_solid_angle(lobe, wo, wi);
        }
        let parts = self.parts(wo);
        let (has_diffuse, has_gloss) = (parts.diffuse != Rgb::ZERO, parts.gloss != Rgb::ZERO);
        match lobe {
            Lobe::Specular => 0.0,
            Lobe::Glossy if has_gloss && parts.gloss_lobe == Lobe::Glossy => {
                self.pdf_part(Part::Gloss, wo, wi)
            }
            Lobe::Glossy => 0.0,
            Lobe::Diffuse if parts.gloss_lobe == Lobe::Diffuse && has_gloss => {
                let share = parts.share_of_diffuse();
                let gloss = (1.0 - share) * self.pdf_part(Part::Gloss, wo, wi);
                if share > 0.0 { share * self.pdf_part(Part::Diffuse, wo, wi) + gloss } else { gloss }
            }
            Lobe::Diffuse if has_diffuse => self.pdf_part(Part::Diffuse, wo, wi),
            Lobe::Diffuse => 0.0,
        }
    }

    /// Samples a direction of one lobe, as if there were no other. `u_lobe` selects between parts, and between reflection and
    /// refraction.
    #[inline]
    pub fn sample_lobe(
        &self,
        lobe: Lobe,
        wo: Vec3,
        mut u_lobe: f32,
        u: Vec2,
        mode: TransportMode,
    ) -> Option<BsdfSample> {
        if !self.is_lit(wo) {
            return None;
        }
        if let Self::Layered(layers) = self {
            return layers.sample_lobe(lobe, wo, u_lobe, u, mode);
        }
        let parts = self.parts(wo);
        let (has_diffuse, has_gloss) = (parts.diffuse != Rgb::ZERO, parts.gloss != Rgb::ZERO);
        let is_mixed = has_diffuse && has_gloss && parts.gloss_lobe == Lobe::Diffuse;
        let part = match lobe {
            Lobe::Specular if parts.mirror != Rgb::ZERO => return self.sample_mirror(wo, u_lobe, mode),
            Lobe::Specular => return None,
            Lobe::Diffuse if is_mixed => {
                let share = parts.share_of_diffuse();
                let (is_diffuse, rest) = choose(u_lobe, share);
                u_lobe = rest;
                if is_diffuse { Part::Diffuse } else { Part::Gloss }
            }
            Lobe::Diffuse if has_diffuse => Part::Diffuse,
            _ if has_gloss && parts.gloss_lobe == lobe => Part::Gloss,
            _ => return None,
        };
        let mut sample = self.sample_part(part, wo, u_lobe, u, mode)?.of_lobe(lobe);
        if is_mixed {
            sample.pdf_solid_angle = self.pdf_solid_angle(lobe, wo, sample.wi);
            sample.throughput = self.eval(lobe, wo, sample.wi, mode) * (sample.wi.z / sample.pdf_solid_angle);
        }
        sample.throughput.is_finite().then_some(sample)
    }

    #[inline]
    fn sample_part(
        &self,
        part: Part,
        wo: Vec3,
        u_lobe: f32,
        u: Vec2,
        mode: TransportMode,
    ) -> Option<PartSample> {
        let lambert = |lambert: Lambert| {
            lambert.sample(wo, u).map(|s| PartSample::reflected(s.wi, s.throughput, s.pdf_solid_angle))
        };
        match (self, part) {
            (Self::Lambert(diffuse), Part::Diffuse) => lambert(*diffuse),
            (Self::Ward(ward), Part::Diffuse) => lambert(ward.diffuse()),
            (Self::Ward(ward), Part::Gloss) => ward.sample_gloss(wo, u),
            (Self::Schlick(schlick), Part::Diffuse) => Some(schlick.sample_diffuse(wo, u)),
            (Self::Schlick(schlick), Part::Gloss) => schlick.sample_gloss(wo, u),
            (Self::Conductor(metal), Part::Gloss) => metal.sample(wo, u),
            (Self::RoughDielectric(interface), Part::Gloss) => interface.sample(wo, u_lobe, u, mode),
            _ => None,
        }
    }

    #[inline]
    fn sample_mirror(&self, wo: Vec3, u_lobe: f32, mode: TransportMode) -> Option<BsdfSample> {
        match self {
            Self::Mirror(mirror) => mirror.sample(wo),
            Self::Dielectric(dielectric) => dielectric.sample(wo, u_lobe, mode),
            Self::Schlick(schlick) => Some(schlick.sample_smooth(wo).of_lobe(Lobe::Specular)),
            Self::Conductor(metal) => Some(metal.sample_smooth(wo).of_lobe(Lobe::Specular)),
            _ => None,
        }
    }

    /// Samples a lobe in proportion to the estimated albedos, and a direction of that lobe. The throughput is divided by the lobe's
    /// probability; the density is that within the lobe. `u_lobe` in `[0, 1)` selects the lobe and the part within it, `u` in `[0, 1)^2`
    /// the direction. `None` where nothing is scattered: the path ends and its power is absorbed.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        match self {
            Self::Lambert(lambert) => return lambert.sample(wo, u),
            Self::Mirror(mirror) => return mirror.sample(wo),
            Self::Dielectric(dielectric) => return dielectric.sample(wo, u_lobe, mode),
            _ if !self.is_lit(wo) => return None,
            _ => {}
        }
        let [diffuse, glossy, specular] = self.lobe_weights(wo);
        let total = diffuse + glossy + specular;
        if !(total > 0.0) {
            return None;
        }
        let (is_diffuse, u_lobe) = choose(u_lobe, diffuse / total);
        if is_diffuse {
            let sample = self.sample_lobe(Lobe::Diffuse, wo, u_lobe, u, mode)?;
            return Some(BsdfSample { throughput: sample.throughput * (total / diffuse), ..sample });
        }
        let (is_glossy, u_lobe) = choose(u_lobe, glossy / (glossy + specular));
        let (lobe, weight) = if is_glossy { (Lobe::Glossy, glossy) } else { (Lobe::Specular, specular) };
        let sample = self.sample_lobe(lobe, wo, u_lobe, u, mode)?;
        Some(BsdfSample { throughput: sample.throughput * (total / weight), ..sample })
    }

    /// Whether every lobe is a delta: [`Self::eval`] is then zero everywhere, and direct lighting has nothing to do.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Self::Mirror(_) | Self::Dielectric(_) => true,
            Self::Lambert(_) | Self::Ward(_) | Self::RoughDielectric(_) => false,
            Self::Schlick(schlick) => schlick.is_smooth(),
            Self::Conductor(metal) => metal.is_smooth(),
            Self::Layered(layers) => layers.is_delta(),
        }
    }

    /// Whether [`Self::sample`] uses `u_lobe` for a choice.
    #[inline]
    pub fn chooses(&self) -> bool {
        !matches!(self, Self::Lambert(_))
    }

    /// Whether there is a [`Lobe::Diffuse`] with a positive albedo: photons are then stored here and maps are read.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        match self {
            Self::Lambert(lambert) => lambert.reflectance.max_element() > 0.0,
            Self::Mirror(_) | Self::Dielectric(_) | Self::RoughDielectric(_) => false,
            Self::Schlick(schlick) => {
                let slightly_glossy = lobe_of(schlick.slope()) == Lobe::Diffuse && schlick.shares()[1] > 0.0;
                schlick.has_diffuse() || slightly_glossy
            }
            Self::Ward(ward) => {
                let slightly_glossy = lobe_of(ward.roughness()) == Lobe::Diffuse && ward.gloss() != Rgb::ZERO;
                ward.diffuse().reflectance != Rgb::ZERO || slightly_glossy
            }
            Self::Conductor(metal) => !metal.is_smooth() && lobe_of(metal.roughness()) == Lobe::Diffuse,
            Self::Layered(layers) => layers.has_diffuse(),
        }
    }

    /// Whether there is a [`Lobe::Glossy`] with a positive albedo.
    #[inline]
    pub fn has_glossy(&self) -> bool {
        match self {
            Self::Lambert(_) | Self::Mirror(_) | Self::Dielectric(_) => false,
            Self::RoughDielectric(_) => true,
            Self::Schlick(schlick) => lobe_of(schlick.slope()) == Lobe::Glossy && schlick.shares()[1] > 0.0,
            Self::Ward(ward) => lobe_of(ward.roughness()) == Lobe::Glossy && ward.gloss() != Rgb::ZERO,
            Self::Conductor(metal) => !metal.is_smooth() && lobe_of(metal.roughness()) == Lobe::Glossy,
            Self::Layered(layers) => layers.has_glossy(),
        }
    }

    /// Whether there is a [`Lobe::Specular`] with a positive albedo.
    #[inline]
    pub fn has_specular(&self) -> bool {
        match self {
            Self::Mirror(mirror) => mirror.reflectance.max_element() > 0.0,
            Self::Dielectric(_) => true,
            Self::Schlick(schlick) => schlick.shares()[2] > 0.0,
            Self::Conductor(metal) => metal.is_smooth(),
            Self::Layered(layers) => layers.has_specular(),
            Self::Lambert(_) | Self::Ward(_) | Self::RoughDielectric(_) => false,
        }
    }

    /// The diffuse lobe where it follows Lambert's law, so that its reflected light depends on irradiance alone.
    #[inline]
    pub fn lambertian(&self) -> Option<Lambert> {
        match self {
            Self::Lambert(lambert) => Some(*lambert),
            Self::Ward(ward) if lobe_of(ward.roughness()) == Lobe::Glossy => Some(ward.diffuse()),
            Self::Layered(layers) => layers.lambertian(),
            _ => None,
        }
    }

    /// Probability with which sampling of the specular lobe reflects instead of refracting: it reflects for a smaller `u_lobe`. One
    /// where nothing is transmitted.
    #[inline]
    pub fn reflection_probability(&self, wo: Vec3) -> f32 {
        match self {
            Self::Dielectric(dielectric) => dielectric.reflectance(wo),
            Self::Layered(layers) => layers.reflection_probability(wo),
            _ => 1.0,
        }
    }

    /// Whether the specular lobe reflects into one direction at most; false where a layer above has its own normal.
    pub fn has_one_mirror(&self, wo: Vec3) -> bool {
        match self {
            Self::Layered(layers) => layers.has_one_mirror(wo),
            _ => true,
        }
    }

    /// Reflected plus transmitted flux over incident flux, per channel, on the side that scatters: the sum of [`Self::lobe_albedo`], for
    /// the albedo layer.
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        if let Self::Layered(layers) = self {
            let lobes = [Lobe::Diffuse, Lobe::Glossy, Lobe::Specular];
            return lobes.map(|lobe| layers.lobe_albedo(lobe, wo)).into_iter().sum::<Rgb>().min(Rgb::ONE);
        }
        let parts = self.parts(wo);
        (parts.diffuse + parts.gloss + parts.mirror).min(Rgb::ONE)
    }
}

/// Whether `u` is below `probability`, and the remainder of `u`, which is uniform in `[0, 1)` again.
#[inline]
pub(super) fn choose(u: f32, probability: f32) -> (bool, f32) {
    let below = u < probability;
    let rest = if below { u / probability } else { (u - probability) / (1.0 - probability) };
    (below, rest.clamp(0.0, crate::sampling::ONE_MINUS_EPSILON))
}
