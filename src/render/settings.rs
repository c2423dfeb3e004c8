//! What a user may choose, and what the presets choose.

use crate::photons::{Estimator, Kernel, SearchRegion};
pub use crate::scene::{GuideKind, IntegratorKind, MapKind, ShadowMode};
use crate::scene::{RenderPlan, Scene};
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

/// What [`IntegratorKind::Photons`] shows of its photons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Show {
    /// The radiance that they make.
    Radiance,
    /// Each photon as a disc in the colour of its class (figure 1 of Jensen 1996).
    Classes,
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
    /// Whether photons are aimed by projection maps.
    pub aim_photons: Option<bool>,
    /// Bytes of memory for the photons of all maps, which then sets their counts.
    pub photons_memory: Option<u64>,
    /// Photons in an estimate from the global map.
    pub global_nearest: Option<u32>,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: Option<u32>,
    /// Radius of estimates from the global map in metres, in place of a count of photons.
    pub global_radius: Option<f64>,
    /// Radius of estimates from the caustic map in metres, in place of a count of photons.
    pub caustic_radius: Option<f64>,
    /// Kernel of caustic estimates.
    pub kernel: Option<Kernel>,
    /// Bias of the estimates.
    pub estimator: Option<Estimator>,
    /// Search region.
    pub search: Option<SearchRegion>,
    /// Whether estimates shrink where they change in one direction only (Jensen & Christensen 1995).
    pub differential_check: Option<bool>,
    /// Final gather rays per camera sample.
    pub gather_samples: Option<u32>,
    /// Distribution rays at the first highly glossy surface of a camera sample.
    pub glossy_samples: Option<u32>,
    /// What helps to draw the directions of gather rays and paths.
    pub guide: Option<GuideKind>,
    /// Whether gather rays read irradiance precomputed at the photons (Christensen 1999).
    pub precomputed_irradiance: Option<bool>,
    /// Shadow rays per light and camera sample.
    pub light_samples: Option<u32>,
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: Option<bool>,
    /// Share of the radius of a caustic estimate within which camera samples of one pixel share it.
    pub caustic_reuse: Option<f32>,
    /// Whether shadow photons tell where shadow rays are not needed.
    pub shadow_photons: Option<ShadowMode>,
    /// Rays that place shadow photons, of all lights together.
    pub shadow_photon_rays: Option<u64>,
    /// What is shown of photons that are shown directly.
    pub show: Option<Show>,
    /// Longest path, in surfaces, after which light is counted as truncated.
    pub max_depth: Option<u32>,
    /// Whether indirect light of Lambertian surfaces is interpolated between few places (Ward & Heckbert 1992).
    pub irradiance_cache: Option<bool>,
    /// Largest error of that interpolation after Ward, Rubinstein & Clear 1988, their `a`.
    pub cache_error: Option<f32>,
    /// Gather rays for each place of the cache; half and a quarter as many where places lie four and two pixels apart.
    pub cache_samples: Option<u32>,
    /// Whether objects that the scene gives illumination maps have them; otherwise photon maps serve everywhere.
    pub illumination_maps: Option<bool>,
    /// Whether pixels get camera samples by the variance around them.
    pub adaptive: Option<bool>,
    /// Behind a diffuse reflection, surfaces nearer than this share of the scene's radius are computed accurately.
    pub accurate_distance: Option<f32>,
    /// Paths of which less than this share arrives are evaluated from the maps alone.
    pub approximate_weight: Option<f32>,
    /// Whether lamps in glass and mirrors are looked for before the picture is rendered.
    pub glints: Option<bool>,
    /// Rounds of [`IntegratorKind::Progressive`].
    pub rounds: Option<u64>,
    /// Relative error at which [`IntegratorKind::Progressive`] ends, which it is asked for by this where nothing else is.
    pub target_error: Option<f64>,
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
            aim_photons: self.aim_photons.or(below.aim_photons),
            photons_memory: self.photons_memory.or(below.photons_memory),
            global_nearest: self.global_nearest.or(below.global_nearest),
            caustic_nearest: self.caustic_nearest.or(below.caustic_nearest),
            // A count asked for here goes over a radius asked for below.
            global_radius: self
                .global_radius
                .or(below.global_radius.filter(|_| self.global_nearest.is_none())),
            caustic_radius: self
                .caustic_radius
                .or(below.caustic_radius.filter(|_| self.caustic_nearest.is_none())),
            kernel: self.kernel.or(below.kernel),
            estimator: self.estimator.or(below.estimator),
            search: self.search.or(below.search),
            differential_check: self.differential_check.or(below.differential_check),
            gather_samples: self.gather_samples.or(below.gather_samples),
            glossy_samples: self.glossy_samples.or(below.glossy_samples),
            guide: self.guide.or(below.guide),
            precomputed_irradiance: self.precomputed_irradiance.or(below.precomputed_irradiance),
            light_samples: self.light_samples.or(below.light_samples),
            visible_kernel: self.visible_kernel.or(below.visible_kernel),
            caustic_reuse: self.caustic_reuse.or(below.caustic_reuse),
            shadow_photons: self.shadow_photons.or(below.shadow_photons),
            shadow_photon_rays: self.shadow_photon_rays.or(below.shadow_photon_rays),
            show: self.show.or(below.show),
            max_depth: self.max_depth.or(below.max_depth),
            irradiance_cache: self.irradiance_cache.or(below.irradiance_cache),
            illumination_maps: self.illumination_maps.or(below.illumination_maps),
            adaptive: self.adaptive.or(below.adaptive),
            cache_error: self.cache_error.or(below.cache_error),
            cache_samples: self.cache_samples.or(below.cache_samples),
            accurate_distance: self.accurate_distance.or(below.accurate_distance),
            approximate_weight: self.approximate_weight.or(below.approximate_weight),
            glints: self.glints.or(below.glints),
            rounds: self.rounds.or(below.rounds),
            target_error: self.target_error.or(below.target_error),
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
    /// Whether photons are aimed by projection maps.
    pub aim_photons: bool,
    /// Bytes of memory for the finished maps: as many photons as fit, in the proportion of the two counts.
    pub photons_memory: Option<u64>,
    /// Photons in an estimate from the global map.
    pub global_nearest: u32,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: u32,
    /// Radius of estimates from the global map in metres; `None` where a count of photons sets it.
    pub global_radius: Option<f64>,
    /// Radius of estimates from the caustic map in metres; `None` where a count of photons sets it.
    pub caustic_radius: Option<f64>,
    /// Kernel of caustic estimates.
    pub kernel: Kernel,
    /// Bias of the estimates.
    pub estimator: Estimator,
    /// Search region.
    pub search: SearchRegion,
    /// Whether estimates shrink where they change in one direction only.
    pub differential_check: bool,
    /// Final gather rays per camera sample.
    pub gather_samples: u32,
    /// Distribution rays at the first highly glossy surface of a camera sample.
    pub glossy_samples: u32,
    /// What helps to draw the directions of gather rays and paths.
    pub guide: GuideKind,
    /// Whether gather rays read irradiance precomputed at the photons.
    pub precomputed_irradiance: bool,
    /// Shadow rays per light and camera sample.
    pub light_samples: u32,
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: bool,
    /// Share of the radius of a caustic estimate within which camera samples of one pixel share it.
    pub caustic_reuse: f32,
    /// Whether shadow photons tell where shadow rays are not needed.
    pub shadow_photons: ShadowMode,
    /// Rays that place shadow photons, of all lights together.
    pub shadow_photon_rays: u64,
    /// What is shown of photons that are shown directly.
    pub show: Show,
    /// Longest path, in surfaces.
    pub max_depth: u32,
    /// Whether indirect light of Lambertian surfaces is interpolated between few places (Ward & Heckbert 1992).
    pub irradiance_cache: bool,
    /// Largest error of that interpolation after Ward, Rubinstein & Clear 1988, their `a`.
    pub cache_error: f32,
    /// Gather rays for each place of the cache; half and a quarter as many where places lie four and two pixels apart.
    pub cache_samples: u32,
    /// Whether objects that the scene gives illumination maps have them; otherwise photon maps serve everywhere.
    pub illumination_maps: bool,
    /// Whether pixels get camera samples by the variance around them, `spp` on average.
    pub adaptive: bool,
    /// Behind a diffuse reflection, surfaces nearer than this share of the scene's radius are computed accurately.
    pub accurate_distance: f32,
    /// Paths of which less than this share arrives are evaluated from the maps alone.
    pub approximate_weight: f32,
    /// Whether lamps in glass and mirrors are looked for before the picture is rendered, where their image is smaller than a
    /// pixel.
    pub glints: bool,
    /// Rounds of [`IntegratorKind::Progressive`], where camera samples and photons are those of each round; `None` for as
    /// many as it takes, or there is time for.
    pub rounds: Option<u64>,
    /// Relative error at which [`IntegratorKind::Progressive`] ends.
    pub target_error: Option<f64>,
}

impl Settings {
    /// What `scene` requires for these settings.
    pub fn plan(&self, scene: &Scene) -> RenderPlan {
        let shows_classes = self.integrator == IntegratorKind::Photons && self.show == Show::Classes;
        RenderPlan::new(scene, self.integrator, self.map)
            .with_cache(self.irradiance_cache)
            .with_precomputed(scene, self.integrator, self.precomputed_irradiance)
            .guided(scene, self.integrator, self.guide)
            .with_shadow_photons(scene, self.shadow_photons, shows_classes)
            .with_glints(scene, self.integrator, self.glints)
    }
}

impl Quality {
    /// The settings of this preset.
    pub fn settings(self) -> Settings {
        let (spp, gather_samples, global_photons, caustic_photons, caustic_nearest) = match self {
            Self::Draft => (4, 4, 50_000, 100_000, 50),
            Self::Preview => (16, 8, 200_000, 500_000, 120),
            Self::Final => (64, 8, 500_000, 5_000_000, 80),
            Self::Reference => (1024, 8, 4_000_000, 20_000_000, 100),
        };
        let (cache_error, cache_samples) = match self {
            Self::Draft => (0.4, 256),
            Self::Preview => (0.25, 512),
            Self::Final | Self::Reference => (0.2, 1024),
        };
        Settings {
            quality: self,
            integrator: IntegratorKind::PhotonMap,
            map: MapKind::Global,
            seed: 0,
            spp,
            global_photons,
            caustic_photons,
            aim_photons: true,
            photons_memory: None,
            global_nearest: 80,
            caustic_nearest,
            global_radius: None,
            caustic_radius: None,
            kernel: Kernel::Cone { k: 1.0 },
            estimator: Estimator::Corrected,
            search: SearchRegion::Disc,
            differential_check: false,
            gather_samples,
            glossy_samples: 6,
            guide: GuideKind::None,
            precomputed_irradiance: true,
            light_samples: 1,
            visible_kernel: true,
            caustic_reuse: if self == Self::Reference { 0.0 } else { 0.2 },
            // What it saves is less than it costs at one shadow ray per light: docs/shadow-photons.md.
            shadow_photons: ShadowMode::Off,
            shadow_photon_rays: 200_000,
            show: Show::Radiance,
            // Reached with probability 1e-4 where everything reflects 99.9 %.
            max_depth: 10_000,
            irradiance_cache: self != Self::Reference,
            cache_error,
            cache_samples,
            illumination_maps: true,
            adaptive: false,
            accurate_distance: 0.02,
            approximate_weight: 0.01,
            glints: true,
            rounds: None,
            target_error: None,
        }
    }

    /// The settings of this preset in rounds: it says how many, and each is the same.
    pub fn progressive_settings(self) -> Settings {
        let rounds = match self {
            Self::Draft => 4,
            Self::Preview => 16,
            Self::Final => 128,
            Self::Reference => 2048,
        };
        Settings {
            integrator: IntegratorKind::Progressive,
            spp: 4,
            gather_samples: 4,
            global_photons: 50_000,
            caustic_photons: 200_000,
            caustic_nearest: 60,
            // It would keep its error however many rounds there are.
            irradiance_cache: false,
            rounds: Some(rounds),
            ..self.settings()
        }
    }
}

impl From<&Overrides> for Settings {
    fn from(asked: &Overrides) -> Self {
        let quality = asked.quality.unwrap_or(Quality::Preview);
        let by_error = asked.integrator.is_none() && asked.target_error.is_some();
        let preset = match asked.integrator == Some(IntegratorKind::Progressive) || by_error {
            true => quality.progressive_settings(),
            false => quality.settings(),
        };
        Self {
            quality: preset.quality,
            integrator: asked.integrator.unwrap_or(preset.integrator),
            map: asked.map.unwrap_or(preset.map),
            seed: asked.seed.unwrap_or(preset.seed),
            spp: asked.spp.unwrap_or(preset.spp),
            global_photons: asked.global_photons.unwrap_or(preset.global_photons),
            caustic_photons: asked.caustic_photons.unwrap_or(preset.caustic_photons),
            aim_photons: asked.aim_photons.unwrap_or(preset.aim_photons),
            photons_memory: asked.photons_memory.or(preset.photons_memory),
            global_nearest: asked.global_nearest.unwrap_or(preset.global_nearest),
            caustic_nearest: asked.caustic_nearest.unwrap_or(preset.caustic_nearest),
            global_radius: asked.global_radius.or(preset.global_radius),
            caustic_radius: asked.caustic_radius.or(preset.caustic_radius),
            kernel: asked.kernel.unwrap_or(preset.kernel),
            estimator: asked.estimator.unwrap_or(preset.estimator),
            search: asked.search.unwrap_or(preset.search),
            differential_check: asked.differential_check.unwrap_or(preset.differential_check),
            gather_samples: asked.gather_samples.unwrap_or(preset.gather_samples),
            glossy_samples: asked.glossy_samples.unwrap_or(preset.glossy_samples),
            guide: asked.guide.unwrap_or(preset.guide),
            precomputed_irradiance: asked.precomputed_irradiance.unwrap_or(preset.precomputed_irradiance),
            light_samples: asked.light_samples.unwrap_or(preset.light_samples),
            // The printed formulas know nothing of it.
            visible_kernel: asked
                .visible_kernel
                .unwrap_or(preset.visible_kernel && asked.estimator != Some(Estimator::AsPrinted)),
            caustic_reuse: asked.caustic_reuse.unwrap_or(preset.caustic_reuse),
            shadow_photons: asked.shadow_photons.unwrap_or(preset.shadow_photons),
            shadow_photon_rays: asked.shadow_photon_rays.unwrap_or(preset.shadow_photon_rays),
            show: asked.show.unwrap_or(preset.show),
            max_depth: asked.max_depth.unwrap_or(preset.max_depth),
            irradiance_cache: asked.irradiance_cache.unwrap_or(preset.irradiance_cache),
            illumination_maps: asked.illumination_maps.unwrap_or(preset.illumination_maps),
            adaptive: asked.adaptive.unwrap_or(preset.adaptive),
            cache_error: asked.cache_error.unwrap_or(preset.cache_error),
            cache_samples: asked.cache_samples.unwrap_or(preset.cache_samples),
            accurate_distance: asked.accurate_distance.unwrap_or(preset.accurate_distance),
            approximate_weight: asked.approximate_weight.unwrap_or(preset.approximate_weight),
            glints: asked.glints.unwrap_or(preset.glints),
            // A target says by itself when to end.
            rounds: asked.rounds.or(preset.rounds.filter(|_| asked.target_error.is_none())),
            target_error: asked.target_error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_asked_for_later_goes_over_a_radius() {
        let below = Overrides { global_radius: Some(0.1), caustic_radius: Some(0.2), ..Overrides::default() };
        let above = Overrides { caustic_nearest: Some(30), ..Overrides::default() };
        let both = Settings::from(&above.over(below));
        assert_eq!((both.global_radius, both.caustic_radius, both.caustic_nearest), (Some(0.1), None, 30));
    }
}
