//! How the next direction is drawn at a surface: by its BSDF, or by its BSDF and the photons near it together.

use super::Counters;
#[cfg(doc)]
use crate::bsdf::Bsdf;
use crate::bsdf::{BsdfSample, Lobe};
use crate::photons::{DirectionGuide, GuideLobe};
use crate::scene::{Shading, SurfaceInteraction};
use glam::{Vec2, Vec3};

/// Share of directions drawn from a diffuse lobe that is not Lambertian. For the Lambertian the guide alone suffices: it draws in
/// proportion to the cosine and what arrives, with a floor of cosine sampling in it, and one warp of the unit square
/// keeps the strata of its points.
const BSDF_SHARE: f32 = 0.5;

/// The density of directions at one point of a surface, the same for drawing and for weights.
#[derive(Clone, Copy, Debug)]
pub struct Directions<'a> {
    /// How the point scatters.
    pub shading: &'a Shading,
    guide: Option<GuideLobe<'a>>,
}

impl<'a> Directions<'a> {
    /// Drawn from the BSDF alone.
    pub fn of_bsdf(shading: &'a Shading) -> Self {
        Self { shading, guide: None }
    }

    /// Drawn with the help of `guide` where there is one and photons are near; counts which.
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

    /// Whether photons take part.
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

    /// Draws a lobe and a direction in the shading frame, of a path from the camera, as [`Bsdf::sample`] does; the
    /// direction of the diffuse lobe as [`Self::sample_diffuse`] does.
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

    /// Draws a direction of the diffuse lobe as if there were no other, in the shading frame, of a path from the camera.
    /// Throughput and density are those of the mixture of BSDF and photons (one-sample estimate with the balance
    /// heuristic, Veach 1997, section 9.2.4). `None` where nothing arrives.
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
        // The cosine is that of the frame, without the rounding on the way to the world and back.
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

    /// Density per solid angle, 1/sr, with which [`Self::sample_diffuse`] draws `wi`, in the shading frame.
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
