//! Integrators (pass 2): they compute radiance along camera rays.
//!
//! Every integrator splits its result into the same five parts: emission and the four integrals of Jensen 1996, eq. (2). The table in
//! `docs/light-paths.md` assigns each kind of path to exactly one part.
// A new variant of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod direct;
mod direct_at;
mod directions;
mod glints;
mod light_importance;
mod path;
mod photon_map;
mod receiver;
mod specular;

pub use direct::{DirectLighting, Reflected, ShadowCounters};
pub use direct_at::DirectAt;
pub use directions::Directions;
pub use glints::{ChanceMeetings, FARTHEST_GLINT, Glint, GlintFinder, GlintMap, GlintView, PixelGlints};
pub use light_importance::{PhotonBudget, SHARE_BY_FLUX, light_importance};
pub use path::PathTracer;
pub use photon_map::{
    CAUSTIC_POINT_REACH, CachePass, CacheRequest, Narrowing, PhotonMapIntegrator, PhotonMapSettings,
    PhotonMaps, Place, RadiosityView, ShowClasses, ShowPhotons, ShowRadiosity, ShownRadiosity,
};
pub use receiver::{Irradiance, Receiver};

use crate::bricks::{BrickCounters, BrickReader};
use crate::film::PixelSample;
use crate::lights::LightId;
use crate::math::{Ray, Rgb};
use crate::photons::Scratch as PhotonScratch;
use crate::sampling::SampleStream;
use crate::scene::{Scene, Shading, SurfaceInteraction};
use std::cell::Cell;
use std::ops::AddAssign;

/// A camera ray, with what the integrator needs to know about glints.
#[derive(Clone, Copy, Debug)]
pub struct EyeRay<'a> {
    /// The camera ray.
    pub ray: Ray,
    /// How emitters behind specular chains are weighted; `None` gives each of them unit weight.
    pub glints: Option<GlintView<'a>>,
}

impl EyeRay<'_> {
    /// A ray without glint handling: the integrator finds all light by its own samples.
    pub fn alone(ray: Ray) -> Self {
        Self { ray, glints: None }
    }

    /// MIS weight of an emitter that is hit behind the specular `chain`, by the `ray` that leaves the chain. Increments `rare` where the
    /// weight is reduced because hits are rare.
    fn lamp_weight(&self, chain: &glints::Chain, lamp: LightId, ray: &Ray, rare: &Cell<u64>) -> f32 {
        match &self.glints {
            Some(glints) if !chain.is_empty() => {
                let (weight, is_rare) = glints.weight(chain, lamp, ray);
                rare.set(rare.get() + u64::from(is_rare));
                weight
            }
            _ => 1.0,
        }
    }

    /// Radiance of small emitters in a cone around the ray by which `next` continues the branch `before` specularly, behind a glossy
    /// lobe. `None` where that ray must find them by itself.
    fn widened(
        &self,
        branches: (&specular::Branch, &specular::Branch),
        at: (&SurfaceInteraction, &Shading),
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Option<Rgb> {
        let glints = self.glints.as_ref()?;
        Some(glints.hunter.widened(branches, at, glints.samples?, samples, scratch))
    }

    /// Whether [`Self::widened`] has already counted the light of this emitter, which `ray` hits.
    fn has_widened(&self, lamp: LightId, ray: &Ray) -> bool {
        self.glints.as_ref().is_some_and(|glints| glints.hunter.has_widened(lamp, ray))
    }
}

/// Computes the radiance of camera rays. All threads share one integrator; per-thread memory is in [`Scratch`].
pub trait Integrator: Sync {
    /// Radiance along a ray that starts in the scene's camera medium, split into its parts, in W/(m^2 sr) times the power factor of
    /// render space.
    fn li(&self, ray: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample;
}

/// Per-thread memory, reused from sample to sample so that no ray allocates.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Memory for photon-map lookups.
    pub photons: PhotonScratch,
    /// Counts of rays, lookups and other events.
    pub counters: Counters,
    /// Decisions by shadow photons, by light; empty where shadow photons are not used.
    pub shadows: Vec<ShadowCounters>,
    /// Estimates that the camera samples of one pixel share.
    remembered: photon_map::Remembered,
    /// Expected bias of the surface that was shaded last.
    bias: Rgb,
    /// Specular branches that are still to be followed.
    branches: Vec<specular::Branch>,
    /// Bricks of brick maps that were read last.
    bricks: BrickReader,
}

/// Counts of rendering events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Counters {
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Camera rays continued by specular reflection or refraction.
    pub specular_rays: u64,
    /// Distribution rays sampled from highly glossy lobes along camera paths.
    pub glossy_rays: u64,
    /// Rays that continue gathering at specular and highly glossy surfaces.
    pub approximate_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Final gather rays.
    pub gather_rays: u64,
    /// All other continued rays: path segments, and BSDF samples of lights.
    pub path_rays: u64,
    /// Estimates from the global map.
    pub global_lookups: u64,
    /// Estimates from the caustic map.
    pub caustic_lookups: u64,
    /// Caustic evaluations that reused the estimate of another camera sample of the same pixel.
    pub caustic_shared: u64,
    /// Caustic evaluations that read a precomputed point nearby.
    pub caustic_nearby: u64,
    /// Estimates from photons in media, along rays and at collisions of gather rays.
    pub media_lookups: u64,
    /// Lookups in illumination maps.
    pub illumination_lookups: u64,
    /// Lookups in brick maps of an irradiance atlas.
    pub atlas_lookups: u64,
    /// Lookups of bricks for those.
    pub bricks: BrickCounters,
    /// Gather rays for which no photon with a matching normal was near.
    pub empty_lookups: u64,
    /// Surfaces at which photons guided the sampling of directions.
    pub guided: u64,
    /// Surfaces at which guiding was enabled, but no photons were near.
    pub unguided: u64,
    /// Photons that estimates visited.
    pub photons_visited: u64,
    /// Estimates that differential checking reduced in size.
    pub differential_stops: u64,
    /// Feeler rays of visible kernels.
    pub feelers: u64,
    /// Paths that were cut at the depth limit.
    pub truncated: u64,
    /// Emitters hit through glass or mirrors and dimmed, because the samples are too few to resolve their brightness there.
    pub rare_glints: u64,
    /// Interfaces that rays met.
    pub interfaces: u64,
    /// Interfaces at which the ray's medium differs from the one that the interface declares.
    pub medium_mismatches: u64,
    /// Segments traced over all paths; divided by the count of camera rays, this is the mean ray depth.
    pub depth_sum: u64,
    /// Paths that ended in a lookup behind a diffuse reflection.
    pub gather_paths: u64,
    /// Segments of those paths, counted from the eye; divided by their count, this is the mean depth of an image-sampling ray.
    pub gather_path_segments: u64,
    /// Evaluations of indirect light by interpolation in the irradiance cache.
    pub cache_hits: u64,
    /// Evaluations for which no cache record was near, so that they gathered themselves.
    pub cache_misses: u64,
    /// Accurate evaluations at surfaces seen by the eye directly or through specular surfaces.
    pub accurate_seen: u64,
    /// Accurate evaluations behind a diffuse reflection because the surface is close.
    pub accurate_close: u64,
    /// Accurate evaluations behind a diffuse reflection because there are too few photons: recursive sampling.
    pub accurate_poor: u64,
    /// Accurate evaluations behind a diffuse reflection that a progressive round chose at random.
    pub accurate_drawn: u64,
    /// Approximate evaluations behind a diffuse reflection.
    pub approximate_diffuse: u64,
    /// Approximate evaluations because the path has a small weight.
    pub approximate_weight: u64,
    /// Approximate evaluations from too few photons because the recursion had to end.
    pub approximate_poor: u64,
}

impl AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.camera_rays += other.camera_rays;
        self.specular_rays += other.specular_rays;
        self.glossy_rays += other.glossy_rays;
        self.approximate_rays += other.approximate_rays;
        self.shadow_rays += other.shadow_rays;
        self.gather_rays += other.gather_rays;
        self.path_rays += other.path_rays;
        self.global_lookups += other.global_lookups;
        self.caustic_lookups += other.caustic_lookups;
        self.caustic_shared += other.caustic_shared;
        self.caustic_nearby += other.caustic_nearby;
        self.media_lookups += other.media_lookups;
        self.illumination_lookups += other.illumination_lookups;
        self.atlas_lookups += other.atlas_lookups;
        self.bricks += other.bricks;
        self.empty_lookups += other.empty_lookups;
        self.guided += other.guided;
        self.unguided += other.unguided;
        self.photons_visited += other.photons_visited;
        self.differential_stops += other.differential_stops;
        self.feelers += other.feelers;
        self.truncated += other.truncated;
        self.rare_glints += other.rare_glints;
        self.interfaces += other.interfaces;
        self.medium_mismatches += other.medium_mismatches;
        self.depth_sum += other.depth_sum;
        self.gather_paths += other.gather_paths;
        self.gather_path_segments += other.gather_path_segments;
        self.cache_hits += other.cache_hits;
        self.cache_misses += other.cache_misses;
        self.accurate_seen += other.accurate_seen;
        self.accurate_close += other.accurate_close;
        self.accurate_poor += other.accurate_poor;
        self.accurate_drawn += other.accurate_drawn;
        self.approximate_diffuse += other.approximate_diffuse;
        self.approximate_weight += other.approximate_weight;
        self.approximate_poor += other.approximate_poor;
    }
}

/// Writes the first surface's values to the auxiliary layers.
fn describe_first_hit(sample: &mut PixelSample, scene: &Scene, hit: &SurfaceInteraction) {
    let shading = hit.shading(scene.material(hit));
    sample.albedo = shading.bsdf.albedo(shading.wo_local);
    sample.normal = shading.frame.z;
    sample.depth = scene.space().metres(f64::from(hit.distance)) as f32;
    sample.object_id = Some(hit.surface);
    sample.material_id = Some(scene.surface(hit).material);
}
