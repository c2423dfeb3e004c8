//! Sampling of the next direction at a surface: by its BSDF alone, or by its BSDF and the nearby photons together.

use super::Counters;
#[cfg(doc)]
use crate::bsdf::Bsdf;
use crate::bsdf::{BsdfSample, Lobe};
use crate::photons::{DirectionGuide, GuideLobe};
use crate::scene::{Shading, SurfaceInteraction};
use glam::{Vec2, Vec3};

/// Share of directions sampled from the BSDF at a diffuse lobe that is not Lambertian. For a Lambertian lobe the guide alone suffices:
/// it samples in proportion to the cosine and the arriving light, it includes a floor of cosine sampling, and it maps the unit square by
/// one warp, which keeps the strata of its points.
const BSDF_SHARE: f32 = 0.5;

/// The density of directions at one point of a surface, the same for sampling and for MIS weights.
#[derive(Clone, Copy, Debug)]
pub struct Directions<'a> {
    /// How the point scatters.
    pub shading: &'a Shading,
    guide: Option<GuideLobe<'a>>,
}

impl<'a> Directions<'a> {
    /// Directions sampled from the BSDF alone.
    pub fn of_bsdf(shading: &'a Shading) -> Self {
        Self { shading, guide: None }
    }

    /// Directions guided by `guide` where there is one and photons are near; counts which case applies.
    #[inline]
    pub fn new(
        guide: Option<&'a DirectionGuide>,
        hit: &SurfaceInteraction,
        shading: &'a Shading,
        counters: &mut Counters,
    ) -> Self {
        let Some(guide) = guide.filter(|_| shading.bsdf.has_diffuse() && shading.wo_local.z > 0.0) else {
            return Self::of_bsdf(shading);
        };
        let guide = guide.at(hit.point.position, hit.facing_normal(), shading.frame.z);
        *(if guide.is_some() { &mut counters.guided } else { &mut counters.unguided }) += 1;
        Self { shading, guide }
    }

    /// Whether photons guide the sampling.
    #[inline]
    pub fn is_guided(&self) -> bool {
        self.guide.is_some()
    }

    /// Whether [`Self::sample`] needs its first number to choose between photons and BSDF.
    #[inline]
    pub fn draws_lobe(&self) -> bool {
        self.guide.is_some() && self.bsdf_share() > 0.0
    }

    fn bsdf_share(&self) -> f32 {
        if self.shading.bsdf.lambertian().is_some() { 0.0 } else { BSDF_SHARE }
    }

    /// Samples a lobe and a direction in the shading frame, for a path from the camera, as [`Bsdf::sample`] does. The direction of the
    /// diffuse lobe is sampled as by [`Self::sample_diffuse`].
    #[inline]
    pub fn sample(&self, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let Shading { bsdf, wo_local: wo, .. } = self.shading;
        if self.guide.is_none() {
            return self.shading.sample(u_lobe, u);
        }
        let [diffuse, glossy, specular] = bsdf.lobe_weights(*wo);
        let (total, others) = (diffuse + glossy + specular, glossy + specular);
        if !(others > 0.0) {
            return self.sample_diffuse(u_lobe, u);
        }
        let share = diffuse / total;
        if u_lobe >= share {
            return self.shading.sample(u_lobe, u);
        }
        let sample = self.sample_diffuse(u_lobe / share, u)?;
        Some(BsdfSample { throughput: sample.throughput / share, ..sample })
    }

    /// Samples a direction of the diffuse lobe as if there were no other lobe, in the shading frame, for a path from the camera.
    /// Throughput and density are those of the mixture of BSDF and photons (one-sample estimate with the balance heuristic, Veach 1997,
    /// section 9.2.4). `None` where nothing arrives.
    #[inline]
    pub fn sample_diffuse(&self, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let shading = self.shading;
        let Some(guide) = &self.guide else {
            return shading.sample_lobe(Lobe::Diffuse, u_lobe, u);
        };
        let share = self.bsdf_share();
        if u_lobe < share {
            let mut sample = shading.sample_lobe(Lobe::Diffuse, u_lobe / share, u)?;
            let pdf = self.pdf_diffuse(sample.wi);
            sample.throughput *= sample.pdf_solid_angle / pdf;
            sample.pdf_solid_angle = pdf;
            return Some(sample);
        }
        let (direction, cos, by_guide) = guide.sample(u);
        // This cosine is measured in the frame and has no rounding error of the way to world space and back.
        let wi = shading.frame.to_local(direction).truncate().extend(cos);
        let mut pdf = (1.0 - share) * by_guide;
        if share > 0.0 {
            pdf += share * shading.pdf_solid_angle(Lobe::Diffuse, wi);
        }
        let cos = if shading.bend.is_none() { cos } else { 1.0 };
        let throughput = shading.eval(Lobe::Diffuse, wi) * (cos / pdf);
        (throughput.max_element() > 0.0 && throughput.is_finite()).then_some(BsdfSample {
            wi,
            throughput,
            pdf_solid_angle: pdf,
            lobe: Lobe::Diffuse,
            transmission: false,
        })
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample_diffuse`] samples `wi`, in the shading frame.
    #[inline]
    pub fn pdf_diffuse(&self, wi: Vec3) -> f32 {
        let shading = self.shading;
        let Some(guide) = &self.guide else { return shading.pdf_solid_angle(Lobe::Diffuse, wi) };
        let share = self.bsdf_share();
        let by_guide = guide.pdf_solid_angle(shading.frame.to_world(wi));
        if share == 0.0 {
            by_guide
        } else {
            (1.0 - share) * by_guide + share * shading.pdf_solid_angle(Lobe::Diffuse, wi)
        }
    }
}
