//! Pass 1: traces photons, builds the maps that the plan requires, and collects statistics and warnings about them.

use super::memory::PhotonCounts;
use super::saved::SavedMaps;
use super::settings::{IntegratorKind, Settings, ShadowMode};
use super::stats::{
    IlluminationStatistics, MapStatistics, MediaStatistics, PhotonMapFile, PhotonStatistics, ShadowStatistics,
};
use crate::bricks::IrradianceAtlas;
use crate::camera::Camera;
use crate::integrators::{
    CAUSTIC_POINT_REACH, DirectAt, PhotonBudget, PhotonMapSettings, PhotonMaps, Place, light_importance,
};
use crate::lights::LightId;
use crate::memory::MemoryError;
use crate::observer::Observer;
use crate::photons::{
    Deposit, DirectLight, DirectionGuide, EstimateParams, GuideParams, IlluminationMaps, Kernel, MediaSizes,
    PhotonClass, PhotonClasses, PhotonMap, PhotonTally, PhotonsFor, TraceSettings, TracedPhotons,
    build_shadow_maps, split_deposits, trace_media_photons, trace_photons_for,
};
use crate::scene::{MapKind, RenderPlan, Scene};
use glam::Vec3;
use std::time::{Duration, Instant};

/// Maximum lookup radius of density estimates, as a share of the scene's radius.
const LARGEST_RADIUS: f32 = 0.25;

/// Irradiance is precomputed at one of this many photons of the global map (Christensen 1999, section 4).
pub(super) const IRRADIANCE_STRIDE: usize = 4;

/// A map with less than this share of the requested photons causes a warning.
const UNDERFILLED: f64 = 0.5;

/// The same for photons in media, of which only half are stored where no light gets there by way of diffuse surfaces.
const UNDERFILLED_MEDIA: f64 = 0.25;

/// Report on one map.
#[derive(Clone, Debug)]
pub struct MapReport {
    /// Kind of the map.
    pub kind: MapKind,
    /// Photons emitted by all lights.
    pub emitted: u64,
    /// Fate of the photons (stored, absorbed, escaped and so on), by light.
    pub tallies: Vec<PhotonTally>,
}

/// Result of pass 1: the maps, their statistics and warnings.
#[derive(Debug, Default)]
pub struct PassOne {
    /// The maps.
    pub maps: PhotonMaps,
    /// Reports by map, in the order in which the maps were built.
    pub reports: Vec<MapReport>,
    /// Statistics by map.
    pub statistics: Vec<MapStatistics>,
    /// Statistics of illumination maps, where there are any.
    pub illumination: Option<IlluminationStatistics>,
    /// Statistics of photons in media, where there are any.
    pub media: Option<MediaStatistics>,
    /// Statistics of shadow photons, by light.
    pub shadows: Vec<ShadowStatistics>,
    /// Seconds to trace and sort shadow photons.
    pub seconds_shadows: f64,
    /// Seconds to precompute irradiance.
    pub seconds_irradiance: f64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// The file that the maps were read from; `None` where photons were traced.
    pub file: Option<PhotonMapFile>,
    /// Whether the observer asked to stop: some maps are then missing.
    pub cancelled: bool,
    /// Seconds of the whole pass.
    pub seconds: f64,
}

impl Settings {
    /// Lookup parameters for the photon maps of `scene`.
    pub fn photon_map_settings(&self, scene: &Scene) -> PhotonMapSettings {
        let scene_radius = scene.bounds().1;
        let reach = if scene_radius > 0.0 { scene_radius } else { f32::INFINITY };
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
            max_radius: LARGEST_RADIUS * reach,
            scene_radius: reach,
            gather_samples: self.gather_samples,
            glossy_samples: self.glossy_samples,
            light_samples: self.light_samples,
            visible_kernel: self.visible_kernel,
            caustic_reuse: self.caustic_reuse,
            max_depth: self.max_depth,
            accurate_distance: self.accurate_distance * scene_radius,
            approximate_weight: self.approximate_weight,
            atlas_footprint: self.atlas_footprint,
            wavelengths: self.wavelengths,
            narrowing: None,
        }
    }
}

impl Settings {
    /// Parameters of the photon guide for `scene`.
    pub fn guide_params(&self, scene: &Scene) -> GuideParams {
        let reading = self.photon_map_settings(scene);
        GuideParams {
            classes: match self.integrator {
                // Caustics have a map of their own.
                IntegratorKind::PhotonMap | IntegratorKind::Progressive | IntegratorKind::Photons => {
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

/// Tracing photons takes at most this share of the time limit. Half of the share goes to the global map where there is a caustic map
/// as well.
const PHOTON_SHARE: f64 = 0.5;

/// Builds the maps that `plan` requires. [`PassOne::cancelled`] is set where the observer asked to stop.
///
/// # Errors
/// If the maps would not fit into memory.
pub fn build_maps(
    scene: &Scene,
    plan: &RenderPlan,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<PassOne, MemoryError> {
    build_maps_from(scene, plan, settings, ForPicture::default(), observer)
}

/// Inputs of pass 1 that depend on the picture to be rendered.
#[derive(Debug, Default)]
pub struct ForPicture<'a> {
    /// Allocation of photons to lights by what the lights contribute to the picture ([`photon_budget`]); by flux where there is none.
    pub budget: Option<&'a PhotonBudget>,
    /// The finest pixel footprints ([`super::finest_distances`]), for the resolution of illumination maps; empty for none.
    pub finest: &'a [f32],
    /// Photons of a file in place of traced ones. The caller has checked that they match.
    pub saved: Option<SavedMaps>,
    /// Brick maps in place of the global map.
    pub atlas: Option<IrradianceAtlas>,
    /// Time for tracing all photons; where it is `None`, a share of the time until the observer's deadline.
    pub time: Option<Duration>,
    /// Surfaces whose irradiance will be probed ([`PhotonsFor::receivers`]).
    pub receivers: &'a [u32],
}

/// Builds maps as [`build_maps`] does, for a given picture.
///
/// # Errors
/// The same as for [`build_maps`].
pub fn build_maps_from(
    scene: &Scene,
    plan: &RenderPlan,
    settings: &Settings,
    picture: ForPicture<'_>,
    observer: &dyn Observer,
) -> Result<PassOne, MemoryError> {
    let start = Instant::now();
    let counts = PhotonCounts::of(settings, plan);
    counts.check(settings, plan)?;
    let mut pass = PassOne { file: picture.saved.as_ref().map(SavedMaps::statistics), ..PassOne::default() };
    pass.warnings.extend(picture.saved.iter().flat_map(SavedMaps::warnings).cloned());
    let share = |end: Instant| end.saturating_duration_since(start).mul_f64(PHOTON_SHARE);
    let limit = picture.time.or_else(|| observer.deadline().map(share));
    // Where the number of photons was chosen to fit the time, no map needs to be limited to its half.
    let is_counted = picture.time.is_some();
    let ForPicture { finest, saved, atlas, budget, receivers, .. } = picture;
    pass.maps.atlas = atlas;
    let deposits = Default::default();
    let mut builder = MapBuilder {
        scene,
        settings,
        saved,
        observer,
        finest,
        receivers,
        deposits,
        budget,
        is_counted,
        pass: &mut pass,
    };
    let done = builder.build_all(plan, counts, limit);
    pass.cancelled = done.is_none();
    pass.seconds = start.elapsed().as_secs_f64();
    Ok(pass)
}

/// Allocation of photons to lights for the picture of `camera`, where the plan requires one; `None` means allocation by flux.
pub fn photon_budget(
    scene: &Scene,
    camera: &Camera,
    plan: &RenderPlan,
    settings: &Settings,
) -> Option<PhotonBudget> {
    plan.photon_budget.build.then(|| light_importance(scene, camera, settings.seed)).flatten()
}

fn build_shadows(scene: &Scene, settings: &Settings, observer: &dyn Observer, pass: &mut PassOne) {
    let rays = settings.shadow_photon_rays;
    observer.begin("tracing shadow photons", 1);
    let start = Instant::now();
    // Mode `Off` keeps individual photons, which the integrator that shows photons needs.
    let mode = match settings.integrator {
        IntegratorKind::Photons => ShadowMode::Off,
        IntegratorKind::PhotonMap | IntegratorKind::Progressive | IntegratorKind::Path => {
            settings.shadow_photons
        }
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

struct MapBuilder<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    saved: Option<SavedMaps>,
    observer: &'a dyn Observer,
    finest: &'a [f32],
    receivers: &'a [u32],
    /// Photons of the global and of the caustic pass for illumination maps, with the number emitted; `None` before the pass.
    deposits: [Option<(Vec<Deposit>, u64)>; 2],
    budget: Option<&'a PhotonBudget>,
    /// Whether the number of photons was chosen to fit the time limit.
    is_counted: bool,
    pass: &'a mut PassOne,
}

impl MapBuilder<'_> {
    /// Builds all maps of the plan. Returns `None` where the build was cancelled.
    fn build_all(&mut self, plan: &RenderPlan, counts: PhotonCounts, limit: Option<Duration>) -> Option<()> {
        let start = Instant::now();
        if plan.global_map.build {
            let share = if plan.caustic_map.build && !self.is_counted { 0.5 } else { 1.0 };
            let end = limit.map(|limit| start + limit.mul_f64(share));
            let map = self.build(MapKind::Global, counts, end)?;
            let precomputed =
                self.saved.as_mut().and_then(|saved| saved.take_irradiance(self.settings, plan));
            let is_wanted =
                plan.final_gather.build && self.settings.precomputed_irradiance && !map.is_empty();
            if let (true, Some(precomputed)) = (is_wanted, precomputed) {
                self.pass.file.iter_mut().for_each(|file| file.irradiance = true);
                self.pass.maps.irradiance = Some(precomputed);
            } else if is_wanted {
                self.observer.begin("precomputing irradiance", 1);
                let begun = Instant::now();
                let reading = self.settings.photon_map_settings(self.scene);
                let template = reading.global_query(Vec3::ZERO, Vec3::Z);
                let direct =
                    plan.direct_at_points.build.then(|| DirectAt::new(self.scene, self.settings.seed));
                let irradiance =
                    direct.map(|direct| move |number, at, normal| direct.irradiance(number, at, normal));
                let by_lights = irradiance.as_ref().map(|irradiance| irradiance as &DirectLight<'_>);
                self.pass.maps.irradiance = Some(map.precompute_irradiance_until(
                    &template,
                    &reading.global,
                    IRRADIANCE_STRIDE,
                    |at, normal| Place::new(self.scene, at, normal, reading.visible_kernel),
                    by_lights,
                    &|| self.observer.is_cancelled(),
                )?);
                self.pass.seconds_irradiance = begun.elapsed().as_secs_f64();
                self.observer.advance(1);
            }
            if plan.guide.build {
                self.observer.begin("building the guide", 1);
                let params = self.settings.guide_params(self.scene);
                self.pass.maps.guide = DirectionGuide::build(&map, &params);
                self.observer.advance(1);
            }
            // The path tracer reads no map, only the guide.
            if self.settings.integrator != IntegratorKind::Path {
                self.pass.maps.global = Some(map);
            }
        }
        if plan.caustic_map.build {
            // This map gets its share of the time even where the steps before it exceeded theirs.
            let end = limit.map(|limit| (start + limit).max(Instant::now() + limit.mul_f64(0.5)));
            let map = self.build(MapKind::Caustic, counts, end)?;
            if plan.caustics_at_points.build && !map.is_empty() {
                self.observer.begin("precomputing caustics", 1);
                let begun = Instant::now();
                let reading = self.settings.photon_map_settings(self.scene);
                let template = reading.caustic_query(&map, Vec3::ZERO, Vec3::Z, 1.0);
                let points = map.precompute_irradiance_near(
                    &template,
                    &reading.caustic,
                    (IRRADIANCE_STRIDE, CAUSTIC_POINT_REACH),
                    |at, normal| Place::new(self.scene, at, normal, reading.visible_kernel),
                    &|| self.observer.is_cancelled(),
                )?;
                self.pass.maps.caustic_irradiance = Some(points);
                self.pass.seconds_irradiance += begun.elapsed().as_secs_f64();
                self.observer.advance(1);
            }
            self.pass.maps.caustic = Some(map);
        }
        self.sum_up();
        let end = limit.map(|limit| (start + limit).max(Instant::now() + limit.mul_f64(0.5)));
        if plan.volume_caustics.build {
            self.build_in_media(MapKind::Caustic, self.settings.volume_beams, end)?;
        }
        if plan.volume_map.build {
            self.build_in_media(MapKind::Global, self.settings.volume_photons, end)?;
        }
        if plan.shadow_photons.build {
            if self.observer.is_cancelled() {
                return None;
            }
            build_shadows(self.scene, self.settings, self.observer, self.pass);
        }
        Some(())
    }

    /// Builds the illumination maps from the photons that reached their objects.
    fn sum_up(&mut self) {
        let [global, caustic] = std::mem::take(&mut self.deposits);
        if !(self.settings.illumination_maps && self.scene.has_illumination_maps()) {
            return;
        }
        // There is no global pass where only the caustic map is shown.
        let (global, emitted) = global.unwrap_or_default();
        self.observer.begin("summing up illumination", 1);
        let start = Instant::now();
        let caustic = caustic.as_ref().map(|(deposits, emitted)| (&deposits[..], *emitted));
        let maps = IlluminationMaps::build(self.scene, (&global, emitted), caustic, self.finest);
        self.pass.illumination =
            Some(IlluminationStatistics { sizes: maps.sizes(), seconds: start.elapsed().as_secs_f64() });
        self.pass.maps.illumination = Some(maps);
        self.observer.advance(1);
    }

    /// Traces photons in media: beams of caustics, or points of light that was scattered before.
    fn build_in_media(&mut self, kind: MapKind, wanted: u64, end: Option<Instant>) -> Option<()> {
        let (scene, observer) = (self.scene, self.observer);
        let name = match kind {
            MapKind::Caustic => "beams through media",
            MapKind::Global => "photons in media",
        };
        observer.begin(&format!("tracing {name}"), wanted);
        let start = Instant::now();
        let before = self.pass.maps.media.sizes();
        let trace = self.trace_settings(kind, wanted);
        let budget = self.budget.map(|budget| match kind {
            MapKind::Global => &budget.global[..],
            MapKind::Caustic => &budget.caustic[..],
        });
        let traced =
            trace_media_photons(scene, &trace, budget, &mut self.pass.maps.media, &|done, total| {
                observer.advance((done as f64 / total as f64 * wanted as f64) as u64);
                !observer.is_cancelled() && end.is_none_or(|end| Instant::now() < end)
            })?;
        let statistics = self.pass.media.get_or_insert_default();
        let MediaSizes { beams, points, bytes } = self.pass.maps.media.sizes();
        (statistics.beams, statistics.points, statistics.bytes) = (beams, points, bytes);
        statistics.emitted += traced.emitted;
        statistics.seconds += start.elapsed().as_secs_f64();
        if traced.stopped {
            self.pass.warnings.push(format!(
                "the {name} of {wanted} asked for were traced in part, in their share of the time limit; ask for fewer, or give it more time"
            ));
        }
        let (stored, setting) = match kind {
            MapKind::Caustic => (beams - before.beams, "volume-beams"),
            MapKind::Global => (points - before.points, "volume-photons"),
        };
        if !traced.stopped && (stored as f64) < UNDERFILLED_MEDIA * wanted as f64 {
            self.pass.warnings.push(format!(
                "the {name} are {stored} of {wanted} asked for: of the {} emitted, few get to a medium and are scattered there; where their \
                 light is noisy, raise --{setting}",
                traced.emitted
            ));
        }
        if kind == MapKind::Global {
            for (medium, depth) in self.pass.maps.media.blurred(scene) {
                // The width falls with the root cube of the number.
                let times = (f64::from(depth) / 0.5).powi(3).ceil();
                self.pass.warnings.push(format!(
                    "photons in the medium `{}` are so few that light is blurred over {depth:.1} mean free paths, and thin parts of it show \
                     too much or too little light: --volume-photons {} would be enough, or --integrator path is exact",
                    scene.medium(medium).name,
                    (stored as f64 * times).max(1.0) as u64
                ));
            }
        }
        let truncated: u64 = traced.tallies.iter().map(|tally| tally.truncated).sum();
        if is_worth_a_warning(truncated, traced.emitted) {
            self.pass.warnings.push(format!(
                "{truncated} of the {name} were cut off at the depth limit; their light is missing (raise --max-depth)"
            ));
        }
        Some(())
    }

    fn trace_settings(&self, kind: MapKind, stored: u64) -> TraceSettings {
        TraceSettings {
            kind,
            stored,
            seed: self.settings.seed,
            max_depth: self.settings.max_depth,
            aimed: self.settings.aim_photons,
            wavelengths: self.settings.wavelengths,
        }
    }

    fn build(&mut self, kind: MapKind, counts: PhotonCounts, end: Option<Instant>) -> Option<PhotonMap> {
        let wanted = counts.for_map(kind);
        let name = match kind {
            MapKind::Global => "global",
            MapKind::Caustic => "caustic",
        };
        let (scene, observer) = (self.scene, self.observer);
        if let Some(saved) = &mut self.saved {
            observer.begin(&format!("building the {name} map"), 1);
            let (map, statistics) = saved.take(kind, &|| observer.is_cancelled())?;
            self.pass.statistics.extend(statistics);
            return Some(map);
        }
        observer.begin(&format!("tracing {name} photons"), wanted);
        let trace = self.trace_settings(kind, wanted);
        let start = Instant::now();
        let budget = self.budget.map(|budget| match kind {
            MapKind::Global => &budget.global[..],
            MapKind::Caustic => &budget.caustic[..],
        });
        let wanted_for = PhotonsFor::surfaces(budget, self.receivers);
        let traced = trace_photons_for(scene, &trace, wanted_for, &|done, total| {
            observer.advance((done as f64 / total as f64 * wanted as f64) as u64);
            !observer.is_cancelled() && end.is_none_or(|end| Instant::now() < end)
        })?;
        let seconds_tracing = start.elapsed().as_secs_f64();
        let statistics = MapStatistics {
            map: kind,
            asked: wanted,
            from_file: false,
            stopped: traced.stopped,
            photons: traced.photons.len() as u64,
            emitted: traced.emitted,
            bytes: 0,
            seconds_tracing,
            seconds_building: 0.0,
            lights: traced
                .tallies
                .iter()
                .enumerate()
                .map(|(i, t)| statistics_of(scene, i, t, traced.emitted))
                .collect(),
        };
        self.pass.statistics.push(statistics);
        let start = Instant::now();
        let TracedPhotons { photons, surfaces, emitted, tallies, stopped, reached, missing, divided, .. } =
            traced;
        let keeps_all = !self.settings.illumination_maps || self.settings.integrator == IntegratorKind::Path;
        let surfaces = if keeps_all { Vec::new() } else { surfaces };
        let (photons, deposits) = split_deposits(photons, &surfaces, scene);
        let summed = deposits.len() as u64;
        self.deposits[kind as usize] = Some((deposits, emitted));
        let map = PhotonMap::build_until(photons, emitted, &|| observer.is_cancelled())?;
        if let Some(statistics) = self.pass.statistics.last_mut() {
            statistics.photons = map.len() as u64;
            statistics.bytes = map.memory_bytes() as u64;
            statistics.seconds_building = start.elapsed().as_secs_f64();
        }
        let findings = Findings {
            scene,
            name,
            kind,
            wanted,
            summed,
            map: &map,
            tallies: &tallies,
            stopped,
            reached: &reached,
        };
        findings.warn(&missing, &divided, &mut self.pass.warnings);
        self.pass.reports.push(MapReport { kind, emitted, tallies });
        Some(map)
    }
}

/// Events as rare as this occur where surfaces touch within rounding; they are invisible in the picture. The statistics still count
/// them.
const RARE: f64 = 1e-4;

/// Whether `count` of `all` events are more than rounding explains.
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

/// Photons of a light that emits fewer than this are visible as individual spots.
const STARVED: u64 = 100;

/// Photons emitted per stored photon above which a warning explains where the time goes.
const RARELY_STORED: u64 = 200;

/// Most names listed in one warning.
const NAMED: usize = 5;

/// Results of building one map, from which its warnings are derived.
struct Findings<'a> {
    scene: &'a Scene,
    name: &'static str,
    kind: MapKind,
    wanted: u64,
    /// Photons that went to illumination maps instead of the photon map.
    summed: u64,
    map: &'a PhotonMap,
    tallies: &'a [PhotonTally],
    stopped: bool,
    /// Whether a photon reached the surface, by surface.
    reached: &'a [bool],
}

impl Findings<'_> {
    fn warn(&self, missing: &[LightId], divided: &[LightId], warnings: &mut Vec<String>) {
        let Self { name, wanted, summed, map, .. } = *self;
        let stored = map.len() as u64 + summed;
        if stored == 0 && wanted > 0 {
            warnings.push(self.nothing_stored());
        } else if wanted == 0 && self.kind == MapKind::Global {
            // Zero caustic photons cause no warning: users ask for them to see what caustics contribute.
            warnings.push(
                "no photons of the global map were asked for, so there will be no indirect light".to_owned(),
            );
        } else if self.stopped {
            warnings.push(format!(
                "the {name} map holds {stored} photons of the {wanted} asked for, traced in its share of the time limit; \
                 ask for fewer, or give it more time"
            ));
        } else if (stored as f64) < UNDERFILLED * wanted as f64 {
            warnings.push(format!(
                "the {name} map holds {stored} photons of the {wanted} asked for: too few of those emitted are stored"
            ));
        }
        if map.dropped() > 0 {
            warnings.push(format!(
                "{} photons of the {name} map had no finite position and were dropped",
                map.dropped()
            ));
        }
        let sum = |field: fn(&PhotonTally) -> u64| self.tallies.iter().map(field).sum::<u64>();
        let emitted = sum(|tally| tally.emitted);
        if stored > 0 && emitted > RARELY_STORED * stored {
            warnings.push(format!(
                "{emitted} photons of the {name} map were emitted for the {stored} that are stored, one of {}: nearly all of the time of \
                 this pass goes to photons that bring no light; fewer --{name}-photons take less",
                emitted / stored
            ));
        }
        let truncated = sum(|tally| tally.truncated);
        if is_worth_a_warning(truncated, emitted) {
            warnings.push(format!(
                "{truncated} photons of the {name} map were cut off at the depth limit; their light is missing (raise \
                 --max-depth, or is a reflectance 1?)"
            ));
        }
        let mismatches = sum(|tally| tally.medium_mismatches);
        let met = sum(|tally| tally.interfaces);
        if is_worth_a_warning(mismatches, met) {
            warnings
                .push(format!("{mismatches} of {met} photons {}", contradiction(&self.scene.mismatched())));
        }
        self.warn_of_casters(warnings);
        self.warn_of_lights(missing, divided, warnings);
    }

    /// Warning that no photon was stored, with the reason.
    fn nothing_stored(&self) -> String {
        let sum = |field: fn(&PhotonTally) -> u64| self.tallies.iter().map(field).sum::<u64>();
        let (emitted, missed) = (sum(|tally| tally.emitted), sum(|tally| tally.missed));
        let (what, loss) = match self.kind {
            MapKind::Caustic => ("reached a diffuse surface by way of a specular one", "no caustics"),
            MapKind::Global => ("reached a diffuse surface", "no indirect light"),
        };
        let why = if emitted == 0 && self.kind == MapKind::Caustic {
            "no light has a specular surface in front of it".to_owned()
        } else if emitted == 0 {
            "no light emits anything".to_owned()
        } else {
            let where_to = match missed as f64 / emitted as f64 {
                share if share > 0.99 => {
                    "nearly all met no surface at all: is there anything in front of the lights?"
                }
                share if share > 0.5 => {
                    "most met no surface at all, and the others were absorbed or left the scene: are the lights shut off from \
                     the diffuse surfaces, or very far from them?"
                }
                _ => {
                    "they met surfaces and were absorbed there or left the scene: are the lights shut off from the diffuse \
                     surfaces?"
                }
            };
            format!("none of the {emitted} photons that were tried {what}; {where_to}")
        };
        format!("the {} map is empty, so there will be {loss}: {why}", self.name)
    }

    /// Warns of caustic casters that no photon reached.
    fn warn_of_casters(&self, warnings: &mut Vec<String>) {
        if self.map.len() as u64 + self.summed == 0 || self.reached.is_empty() {
            return;
        }
        let mut dark: Vec<u32> = self.scene.casters().iter().map(|caster| caster.surface).collect();
        dark.retain(|&surface| !self.reached[surface as usize]);
        dark.sort_unstable();
        dark.dedup();
        if !dark.is_empty() {
            let names =
                listed(dark.iter().map(|&surface| self.scene.surfaces()[surface as usize].name.as_str()));
            warnings.push(format!(
                "no caustic photon reached {names}: nothing is lost where no light shines on it; otherwise raise \
                 --caustic-photons (shapes of a TOML scene have `caustic-photons` too, for a larger share)"
            ));
        }
    }

    /// Warns of lights with too few photons, and of lights that lie in more than one medium on one side.
    fn warn_of_lights(&self, missing: &[LightId], divided: &[LightId], warnings: &mut Vec<String>) {
        let light_name = |light: usize| self.scene.light_note(light).name.as_str();
        let starved = |tally: &PhotonTally| {
            let none =
                self.kind == MapKind::Global && tally.stored == 0 && self.map.len() as u64 + self.summed > 0;
            tally.emitted > 0 && (tally.emitted < STARVED || none)
        };
        let lights: Vec<usize> =
            (0..self.tallies.len()).filter(|&light| starved(&self.tallies[light])).collect();
        // A small requested map leaves too few photons for every light, which needs no warning.
        if !lights.is_empty() && self.wanted >= STARVED * self.tallies.len() as u64 {
            let photons: u64 = lights.iter().map(|&light| self.tallies[light].emitted).sum();
            let names = listed(lights.iter().map(|&light| light_name(light)));
            warnings.push(format!(
                "only {photons} photons of the {} map left {names}, fewer than {STARVED} each or none that was stored: \
                 their light is noise or missing; raise --{}-photons (lights of a TOML scene have `photons` too, for a larger share)",
                self.name, self.name
            ));
        }
        if !missing.is_empty() {
            warnings.push(format!(
                "no photon of the {} map was traced from {} within the time limit: their light is missing",
                self.name,
                listed(missing.iter().map(|&light| light_name(light as usize)))
            ));
        }
        // The lights are the same for all maps, so the first map alone warns.
        if !divided.is_empty() && self.pass_is_first() {
            warnings.push(format!(
                "{}: in more than one medium on one side, and all photons from there start in the one that most of it \
                 is in; put it into one body, or close the meshes around it (in a TOML scene, check `inside` and `outside` of \
                 their materials)",
                listed(divided.iter().map(|&light| light_name(light as usize)))
            ));
        }
    }

    fn pass_is_first(&self) -> bool {
        self.kind == MapKind::Global
    }
}

/// Text of the warning about interfaces that contradict the medium a ray is in, at the surfaces with these names, with a remedy.
pub(super) fn contradiction(names: &[&str]) -> String {
    let at = if names.is_empty() { String::new() } else { format!(", at {}", listed(names.iter().copied())) };
    format!(
        "met an interface in another medium than the interface states on that side{at}: the mesh is open there or its normals \
         point inwards; close it, or turn them (in a TOML scene by `flip-normal`, and check `inside` and `outside` of the \
         materials)"
    )
}

/// The first few names in quotes, and the number of the others.
pub(super) fn listed<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> String {
    let count = names.len();
    let shown: Vec<String> = names.take(NAMED).map(|name| format!("`{name}`")).collect();
    match count.saturating_sub(NAMED) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}
