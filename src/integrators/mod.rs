//! Pass 2: from a camera ray to radiance.
//!
//! Every integrator splits what it finds into the same five parts, emission and the four integrals of Jensen 1996,
//! eq. (2); `docs/light-paths.md` has the table that assigns each kind of path to exactly one.

mod direct;
mod path;
mod photon_map;
mod specular;

pub use direct::DirectLighting;
pub use path::PathTracer;
pub use photon_map::{PhotonMapIntegrator, PhotonMapSettings, PhotonMaps, ShowPhotons, visible_domain};

use crate::film::PixelSample;
use crate::math::Ray;
use crate::photons::Scratch as PhotonScratch;
use crate::sampling::SampleStream;
use crate::scene::{Scene, SurfaceInteraction};
use std::ops::AddAssign;

/// Computes the radiance of camera rays. Shared by all threads; what a thread needs for itself is in [`Scratch`].
pub trait Integrator: Sync {
    /// Radiance along `ray`, which starts in the scene's camera medium, in W/(m^2 sr) times the power factor of
    /// render space, split into its parts.
    fn li(&self, ray: Ray, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample;
}

/// Per-thread memory, reused from sample to sample so that no ray allocates.
#[derive(Debug, Default)]
pub struct Scratch {
    /// For look-ups in photon maps.
    pub photons: PhotonScratch,
    /// What was traced.
    pub counters: Counters,
    /// Specular branches that wait for their turn.
    branches: Vec<specular::Branch>,
}

/// What rendering counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counters {
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Rays continued by specular reflection or refraction, from the camera.
    pub specular_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Final gather rays.
    pub gather_rays: u64,
    /// Rays continued in any other way: paths, and BSDF samples of lights.
    pub path_rays: u64,
    /// Estimates from the global map.
    pub global_lookups: u64,
    /// Estimates from the caustic map.
    pub caustic_lookups: u64,
    /// Gather rays for which no photon with a fitting normal was near.
    pub empty_lookups: u64,
    /// Photons that estimates looked at.
    pub photons_visited: u64,
    /// Estimates that differential checking made smaller.
    pub differential_stops: u64,
    /// Feeler rays of visible kernels.
    pub feelers: u64,
    /// Paths cut at the depth limit.
    pub truncated: u64,
    /// Interfaces met.
    pub interfaces: u64,
    /// Interfaces met in another medium than they state.
    pub medium_mismatches: u64,
    /// Segments traced, over all paths: divided by camera rays, the mean ray depth.
    pub depth_sum: u64,
}

impl AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.camera_rays += other.camera_rays;
        self.specular_rays += other.specular_rays;
        self.shadow_rays += other.shadow_rays;
        self.gather_rays += other.gather_rays;
        self.path_rays += other.path_rays;
        self.global_lookups += other.global_lookups;
        self.caustic_lookups += other.caustic_lookups;
        self.empty_lookups += other.empty_lookups;
        self.photons_visited += other.photons_visited;
        self.differential_stops += other.differential_stops;
        self.feelers += other.feelers;
        self.truncated += other.truncated;
        self.interfaces += other.interfaces;
        self.medium_mismatches += other.medium_mismatches;
        self.depth_sum += other.depth_sum;
    }
}

/// What the first surface contributes to the auxiliary layers.
fn describe_first_hit(sample: &mut PixelSample, scene: &Scene, hit: &SurfaceInteraction) {
    let shading = hit.shading(scene.material(hit));
    sample.albedo = shading.bsdf.albedo();
    sample.normal = shading.frame.z;
    sample.depth = scene.space().metres(f64::from(hit.distance)) as f32;
    sample.object_id = Some(hit.surface);
    sample.material_id = Some(scene.surface(hit).material);
}
