//! What a user may choose, and what the presets choose.

use crate::photons::{Estimator, Kernel, SearchRegion};
pub use crate::scene::{IntegratorKind, MapKind};
use serde::Serialize;

/// Presets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// Seconds; to see whether the scene is right.
    Draft,
    /// A good idea of the final picture.
    Preview,
    /// What one publishes.
    Final,
    /// What one measures others against.
    Reference,
}

/// Settings that somebody asked for; `None` leaves the choice to who comes before: command line over scene file
/// over preset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overrides {
    /// Preset that the rest modifies.
    pub quality: Option<Quality>,
    /// Integrator.
    pub integrator: Option<IntegratorKind>,
    /// Map shown by [`IntegratorKind::Photons`].
    pub map: Option<MapKind>,
    /// Seed of all random numbers.
    pub seed: Option<u64>,
    /// Camera samples per pixel.
    pub spp: Option<u32>,
    /// Photons to store in the global map.
    pub global_photons: Option<u64>,
    /// Photons to store in the caustic map.
    pub caustic_photons: Option<u64>,
    /// Photons in an estimate from the global map.
    pub global_nearest: Option<u32>,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: Option<u32>,
    /// Kernel of caustic estimates.
    pub kernel: Option<Kernel>,
    /// Bias of the estimates.
    pub estimator: Option<Estimator>,
    /// Search region.
    pub search: Option<SearchRegion>,
    /// Final gather rays per camera sample.
    pub gather_samples: Option<u32>,
    /// Whether gather rays read irradiance precomputed at the photons (Christensen 1999).
    pub precomputed_irradiance: Option<bool>,
    /// Shadow rays per light and camera sample.
    pub light_samples: Option<u32>,
    /// Longest path, in bounces, after which light is counted as truncated.
    pub max_depth: Option<u32>,
}

impl Overrides {
    /// These, and where they are silent those of `below`.
    pub fn over(self, below: Self) -> Self {
        Self {
            quality: self.quality.or(below.quality),
            integrator: self.integrator.or(below.integrator),
            map: self.map.or(below.map),
            seed: self.seed.or(below.seed),
            spp: self.spp.or(below.spp),
            global_photons: self.global_photons.or(below.global_photons),
            caustic_photons: self.caustic_photons.or(below.caustic_photons),
            global_nearest: self.global_nearest.or(below.global_nearest),
            caustic_nearest: self.caustic_nearest.or(below.caustic_nearest),
            kernel: self.kernel.or(below.kernel),
            estimator: self.estimator.or(below.estimator),
            search: self.search.or(below.search),
            gather_samples: self.gather_samples.or(below.gather_samples),
            precomputed_irradiance: self.precomputed_irradiance.or(below.precomputed_irradiance),
            light_samples: self.light_samples.or(below.light_samples),
            max_depth: self.max_depth.or(below.max_depth),
        }
    }
}
