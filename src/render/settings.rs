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
    /// Bytes of memory for the photons of all maps, which then sets their counts.
    pub photons_memory: Option<u64>,
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
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: Option<bool>,
    /// Longest path, in surfaces, after which light is counted as truncated.
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
            photons_memory: self.photons_memory.or(below.photons_memory),
            global_nearest: self.global_nearest.or(below.global_nearest),
            caustic_nearest: self.caustic_nearest.or(below.caustic_nearest),
            kernel: self.kernel.or(below.kernel),
            estimator: self.estimator.or(below.estimator),
            search: self.search.or(below.search),
            gather_samples: self.gather_samples.or(below.gather_samples),
            precomputed_irradiance: self.precomputed_irradiance.or(below.precomputed_irradiance),
            light_samples: self.light_samples.or(below.light_samples),
            visible_kernel: self.visible_kernel.or(below.visible_kernel),
            max_depth: self.max_depth.or(below.max_depth),
        }
    }
}

/// Everything decided.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Settings {
    /// Preset that the rest started from.
    pub quality: Quality,
    /// Integrator.
    pub integrator: IntegratorKind,
    /// Map shown by [`IntegratorKind::Photons`].
    pub map: MapKind,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Camera samples per pixel.
    pub spp: u32,
    /// Photons to store in the global map.
    pub global_photons: u64,
    /// Photons to store in the caustic map.
    pub caustic_photons: u64,
    /// Bytes of memory for the finished maps: as many photons as fit, in the proportion of the two counts.
    pub photons_memory: Option<u64>,
    /// Photons in an estimate from the global map.
    pub global_nearest: u32,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: u32,
    /// Kernel of caustic estimates.
    pub kernel: Kernel,
    /// Bias of the estimates.
    pub estimator: Estimator,
    /// Search region.
    pub search: SearchRegion,
    /// Final gather rays per camera sample.
    pub gather_samples: u32,
    /// Whether gather rays read irradiance precomputed at the photons.
    pub precomputed_irradiance: bool,
    /// Shadow rays per light and camera sample.
    pub light_samples: u32,
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: bool,
    /// Longest path, in surfaces.
    pub max_depth: u32,
}

impl Quality {
    /// The settings of this preset.
    pub fn settings(self) -> Settings {
        let (spp, gather_samples, global_photons, caustic_photons, caustic_nearest) = match self {
            Self::Draft => (4, 4, 50_000, 100_000, 50),
            Self::Preview => (16, 8, 200_000, 500_000, 60),
            Self::Final => (64, 8, 500_000, 5_000_000, 80),
            Self::Reference => (1024, 8, 4_000_000, 20_000_000, 100),
        };
        Settings {
            quality: self,
            integrator: IntegratorKind::PhotonMap,
            map: MapKind::Global,
            seed: 0,
            spp,
            global_photons,
            caustic_photons,
            photons_memory: None,
            global_nearest: 80,
            caustic_nearest,
            kernel: Kernel::Cone { k: 1.0 },
            estimator: Estimator::Corrected,
            search: SearchRegion::Disc,
            gather_samples,
            precomputed_irradiance: true,
            light_samples: 1,
            visible_kernel: true,
            // Reached with probability 1e-4 where everything reflects 99.9 %.
            max_depth: 10_000,
        }
    }
}

impl From<&Overrides> for Settings {
    fn from(asked: &Overrides) -> Self {
        let preset = asked.quality.unwrap_or(Quality::Preview).settings();
        Self {
            quality: preset.quality,
            integrator: asked.integrator.unwrap_or(preset.integrator),
            map: asked.map.unwrap_or(preset.map),
            seed: asked.seed.unwrap_or(preset.seed),
            spp: asked.spp.unwrap_or(preset.spp),
            global_photons: asked.global_photons.unwrap_or(preset.global_photons),
            caustic_photons: asked.caustic_photons.unwrap_or(preset.caustic_photons),
            photons_memory: asked.photons_memory.or(preset.photons_memory),
            global_nearest: asked.global_nearest.unwrap_or(preset.global_nearest),
            caustic_nearest: asked.caustic_nearest.unwrap_or(preset.caustic_nearest),
            kernel: asked.kernel.unwrap_or(preset.kernel),
            estimator: asked.estimator.unwrap_or(preset.estimator),
            search: asked.search.unwrap_or(preset.search),
            gather_samples: asked.gather_samples.unwrap_or(preset.gather_samples),
            precomputed_irradiance: asked.precomputed_irradiance.unwrap_or(preset.precomputed_irradiance),
            light_samples: asked.light_samples.unwrap_or(preset.light_samples),
            // The printed formulas know nothing of it.
            visible_kernel: asked
                .visible_kernel
                .unwrap_or(preset.visible_kernel && asked.estimator != Some(Estimator::AsPrinted)),
            max_depth: asked.max_depth.unwrap_or(preset.max_depth),
        }
    }
}
