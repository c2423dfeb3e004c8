//! Pass 1 as a job: traces photons, builds the maps the plan asks for, and says what is odd about them.

use super::observer::Observer;
use super::settings::{IntegratorKind, Settings, ShadowMode};
use super::stats::{MapStatistics, PhotonStatistics, ShadowStatistics};
use crate::integrators::{PhotonMapSettings, PhotonMaps, visible_domain};
use crate::photons::{
    DirectionGuide, EstimateParams, GuideParams, Kernel, PhotonClass, PhotonClasses, PhotonMap, PhotonTally,
    TraceSettings, build_shadow_maps, trace_photons,
};
use crate::scene::{MapKind, RenderPlan, Scene};
use glam::Vec3;
use std::time::Instant;

/// Radius beyond which an estimate says nothing of its place, as a share of the scene's radius.
const LARGEST_RADIUS: f32 = 0.25;

/// One in so many photons of the global map gets its irradiance precomputed (Christensen 1999, section 4).
const IRRADIANCE_STRIDE: usize = 4;

/// A map has fewer photons than this share of those asked for: worth a warning.
const UNDERFILLED: f64 = 0.5;

/// What became of one map.
#[derive(Clone, Debug)]
pub struct MapReport {
    /// Which map.
    pub kind: MapKind,
    /// Photons emitted by all lights.
    pub emitted: u64,
    /// What became of the photons, by light.
    pub tallies: Vec<PhotonTally>,
}

/// Maps, and what is to be told about them.
#[derive(Debug, Default)]
pub struct PassOne {
    /// The maps.
    pub maps: PhotonMaps,
    /// By map, in the order in which they were built.
    pub reports: Vec<MapReport>,
    /// Numbers for the statistics.
    pub statistics: Vec<MapStatistics>,
    /// Shadow photons, by light.
    pub shadows: Vec<ShadowStatistics>,
    /// Seconds for those.
    pub seconds_shadows: f64,
    /// Things a user should know.
    pub warnings: Vec<String>,
    /// Seconds.
    pub seconds: f64,
}

impl Settings {
    /// How the photon maps of `scene` are read.
    pub fn photon_map_settings(&self, scene: &Scene) -> PhotonMapSettings {
        let scene_radius = scene.bounds().1;
        let to_render = |metres| scene.space().length(metres) as f32;
        PhotonMapSettings {
            global_nearest: self.global_nearest,
            caustic_nearest: self.caustic_nearest,
            caustic: EstimateParams { kernel: self.kernel, estimator: self.estimator },
            global: EstimateParams { kernel: Kernel::Constant, estimator: self.estimator },
            global_radius: self.global_radius.map(to_render),
            caustic_radius: self.caustic_radius.map(to_render),
            region: self.search,
            differential_check: self.differential_check,
            max_radius: if scene_radius > 0.0 { LARGEST_RADIUS * scene_radius } else { f32::INFINITY },
            gather_samples: self.gather_samples,
            glossy_samples: self.glossy_samples,
            light_samples: self.light_samples,
            visible_kernel: self.visible_kernel,
            max_depth: self.max_depth,
            accurate_distance: self.accurate_distance * scene_radius,
            approximate_weight: self.approximate_weight,
        }
    }
}

impl Settings {
    /// How photons guide in `scene`.
    pub fn guide_params(&self, scene: &Scene) -> GuideParams {
        let reading = self.photon_map_settings(scene);
        GuideParams {
            classes: match self.integrator {
                // Caustics come from their own map.
                IntegratorKind::PhotonMap | IntegratorKind::Photons => {
                    PhotonClasses::only(PhotonClass::Indirect)
                }
                IntegratorKind::Path => {
                    PhotonClasses::only(PhotonClass::Indirect).and(PhotonClasses::only(PhotonClass::Caustic))
                }
            },
            nearest: GuideParams::NEAREST,
            per_cell: GuideParams::PER_CELL,
            floor: GuideParams::FLOOR,
            region: reading.region,
            max_radius: reading.max_radius,
        }
    }
}

/// Builds the maps that `plan` asks for. `None` where the observer asked to stop.
pub fn build_maps(
    scene: &Scene,
    plan: &RenderPlan,
    settings: &Settings,
    observer: &dyn Observer,
) -> Option<PassOne> {
    let start = Instant::now();
    let mut pass = PassOne::default();
    if plan.global_map.build {
        let map = build_map(scene, settings, MapKind::Global, settings.global_photons, observer, &mut pass)?;
        if plan.final_gather.build && settings.precomputed_irradiance && !map.is_empty() {
            observer.begin("precomputing irradiance", 1);
            let reading = settings.photon_map_settings(scene);
            let template = reading.global_query(Vec3::ZERO, Vec3::Z);
            pass.maps.irradiance = Some(map.precompute_irradiance_visible(
                &template,
                &reading.global,
                IRRADIANCE_STRIDE,
                |at, normal, radius| visible_domain(scene, at, normal, radius),
            ));
            observer.advance(1);
        }
        if plan.guide.build {
            observer.begin("building the guide", 1);
            pass.maps.guide = DirectionGuide::build(&map, &settings.guide_params(scene));
            observer.advance(1);
        }
        // Paths read no map.
        if settings.integrator != IntegratorKind::Path {
            pass.maps.global = Some(map);
        }
    }
    if plan.caustic_map.build {
        pass.maps.caustic = Some(build_map(
            scene,
            settings,
            MapKind::Caustic,
            settings.caustic_photons,
            observer,
            &mut pass,
        )?);
    }
    if plan.shadow_photons.build {
        build_shadows(scene, settings, observer, &mut pass);
    }
    pass.seconds = start.elapsed().as_secs_f64();
    Some(pass)
}

fn build_shadows(scene: &Scene, settings: &Settings, observer: &dyn Observer, pass: &mut PassOne) {
    let rays = settings.shadow_photon_rays;
    observer.begin("tracing shadow photons", 1);
    let start = Instant::now();
    // Photons themselves are kept where they are to be shown.
    let mode = match settings.integrator {
        IntegratorKind::Photons => ShadowMode::Off,
        IntegratorKind::PhotonMap | IntegratorKind::Path => settings.shadow_photons,
    };
    let max_radius = settings.photon_map_settings(scene).max_radius;
    let maps = build_shadow_maps(scene, mode, rays, settings.seed, max_radius);
    pass.seconds_shadows = start.elapsed().as_secs_f64();
    for (light, tally) in maps.tallies().iter().enumerate() {
        if tally.dropped > 0 {
            pass.warnings.push(format!(
                "{} crossings of rays from light {light} with surfaces were not kept: shadow photons are missing there",
                tally.dropped
            ));
        }
        pass.shadows.push(ShadowStatistics {
            light: light as u32,
            rays: tally.rays,
            missed: tally.missed,
            crossings: tally.crossings,
            merged: tally.merged,
            dropped: tally.dropped,
            direct_photons: tally.direct,
            shadow_photons: tally.shadow,
            bytes: maps.memory_bytes(light) as u64,
            decisions: Default::default(),
            rays_saved_percent: 0.0,
        });
    }
    pass.maps.shadows = Some(maps);
    observer.advance(1);
}

fn build_map(
    scene: &Scene,
    settings: &Settings,
    kind: MapKind,
    wanted: u64,
    observer: &dyn Observer,
    pass: &mut PassOne,
) -> Option<PhotonMap> {
    let name = match kind {
        MapKind::Global => "global",
        MapKind::Caustic => "caustic",
    };
    observer.begin(&format!("tracing {name} photons"), wanted);
    let trace = TraceSettings { kind, stored: wanted, seed: settings.seed, max_depth: settings.max_depth };
    let start = Instant::now();
    let traced = trace_photons(scene, &trace, &|done, total| {
        observer.advance((done as f64 / total as f64 * wanted as f64) as u64);
        !observer.should_stop()
    })?;
    let seconds_tracing = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let map = PhotonMap::build(traced.photons, traced.emitted);
    pass.statistics.push(MapStatistics {
        map: kind,
        photons: map.len() as u64,
        emitted: traced.emitted,
        bytes: map.memory_bytes() as u64,
        seconds_tracing,
        seconds_building: start.elapsed().as_secs_f64(),
        lights: traced
            .tallies
            .iter()
            .enumerate()
            .map(|(i, t)| statistics_of(scene, i, t, traced.emitted))
            .collect(),
    });
    warn(name, kind, wanted, &map, &traced.tallies, &mut pass.warnings);
    pass.reports.push(MapReport { kind, emitted: traced.emitted, tallies: traced.tallies });
    Some(map)
}

/// Events as rare as this come from places where surfaces touch within rounding, and cannot be seen. The statistics have
/// them all the same.
const RARE: f64 = 1e-4;

/// True where `count` of `all` events is more than the few that rounding explains.
pub(super) fn is_worth_a_warning(count: u64, all: u64) -> bool {
    count as f64 > RARE * all as f64
}

fn statistics_of(scene: &Scene, light: usize, tally: &PhotonTally, emitted: u64) -> PhotonStatistics {
    let space = scene.space();
    let to_watts = 1.0 / (space.power * space.scale * space.scale * emitted.max(1) as f64);
    let flux = |power: glam::DVec3| (power * to_watts).to_array();
    PhotonStatistics {
        light: light as u32,
        emitted: tally.emitted,
        stored: tally.stored,
        bounces: tally.bounces,
        missed: tally.missed,
        truncated: tally.truncated,
        medium_mismatches: tally.medium_mismatches,
        flux_emitted: flux(tally.power_emitted),
        flux_absorbed: flux(tally.power_absorbed),
        flux_escaped: flux(tally.power_escaped),
        flux_truncated: flux(tally.power_truncated),
    }
}

fn warn(
    name: &str,
    kind: MapKind,
    wanted: u64,
    map: &PhotonMap,
    tallies: &[PhotonTally],
    warnings: &mut Vec<String>,
) {
    if map.is_empty() && wanted > 0 {
        warnings.push(match kind {
            MapKind::Caustic => "the caustic map is empty: no photon reached a diffuse surface by way of a specular \
                                 one; there will be no caustics (is the light blocked, or does nothing diffuse lie \
                                 behind the glass?)"
                .to_owned(),
            MapKind::Global => "the global map is empty: no photon reached a diffuse surface; there will be no \
                                indirect light"
                .to_owned(),
        });
    } else if (map.len() as f64) < UNDERFILLED * wanted as f64 {
        warnings.push(format!(
            "the {name} map holds {} photons of the {wanted} asked for: too few of those emitted are stored",
            map.len()
        ));
    }
    if map.dropped() > 0 {
        warnings.push(format!(
            "{} photons of the {name} map had no finite position and were dropped",
            map.dropped()
        ));
    }
    let sum = |field: fn(&PhotonTally) -> u64| tallies.iter().map(field).sum::<u64>();
    let truncated = sum(|tally| tally.truncated);
    if is_worth_a_warning(truncated, sum(|tally| tally.emitted)) {
        warnings.push(format!(
            "{truncated} photons of the {name} map were cut off at the depth limit; their light is missing (raise \
             --max-depth, or is a reflectance 1?)"
        ));
    }
    let mismatches = sum(|tally| tally.medium_mismatches);
    if is_worth_a_warning(mismatches, sum(|tally| tally.interfaces)) {
        warnings.push(format!(
            "{mismatches} times a photon met an interface in another medium than the interface states on that side: \
             check `inside` and `outside` of the materials and the direction of normals"
        ));
    }
}
