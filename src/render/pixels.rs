//! Pass 2: renders tiles of pixels on all threads and merges them in order. The entry points are [`render`] and
//! [`render_with_maps`].

use super::adaptive::{Moments, SampleCounts, pilot_samples};
use super::glints::{GlintSearch, Glints, find_glints};
use super::maps::{ForPicture, PassOne, build_maps_from, photon_budget};
use super::memory::PhotonCounts;
use super::pace::{Pace, Paced};
use super::pixel_footprint::finest_distances;
use super::progressive::{CheckpointError, PartError, Rounds};
use super::saved::SavedMaps;
use super::settings::{MapKind, Settings, Show};
use super::stats::{
    AdaptiveStatistics, AtlasStatistics, CacheStatistics, MemoryStatistics, Statistics, Times,
};
use super::visible_emitters::VisibleEmitters;
use super::warnings::warn;
use crate::bricks::{BrickCounters, BrickFileError, IrradianceAtlas};
use crate::camera::{Camera, CameraRay, FilmPlace};
use crate::film::{
    AOVS, Aov, Film, FilmError, Filter, FilterError, FilterSampler, LayerSet, PixelRect, PixelSample, Tile,
};
use crate::integrators::{
    CacheRequest, Counters, EyeRay, GlintView, Integrator, PathTracer, PhotonMapIntegrator,
    PhotonMapSettings, PhotonMaps, RadiosityView, Scratch, ShadowCounters, ShowClasses, ShowPhotons,
    ShowRadiosity,
};
use crate::math::Rgb;
use crate::media::Medium;
use crate::memory::{MemoryError, Resident, resident_memory};
use crate::observer::{Observer, Silent};
use crate::sampling::{Rng, SampleStream, Stream};
use crate::scene::{CameraMedia, Geometry, GuideKind, IntegratorKind, RenderPlan, Scene};
use glam::{DVec3, Vec2};
use rayon::prelude::*;
use std::ops::Range;
use std::time::{Duration, Instant};

/// A request to render one picture.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Crop window: only these pixels are rendered. `None` for the whole picture.
    pub crop: Option<PixelRect>,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Layers in addition to the five parts of the picture.
    pub layers: LayerSet,
    /// Settings.
    pub settings: Settings,
}

/// The pass in which a render was stopped before all its samples were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// During pass 1, or before the first pixel: there is no picture.
    BeforePixels,
    /// During pass 2: pixels have fewer samples than asked for, some may have none.
    DuringPixels,
}

/// A rendered picture with its statistics.
#[derive(Debug)]
pub struct Rendered {
    /// The film.
    pub film: Film,
    /// Statistics of the render.
    pub statistics: Statistics,
    /// The pass in which the render was stopped early; `None` where it is complete.
    pub stopped: Option<Stop>,
    /// Why the checkpoint could not be written, where the file lacks some of the rounds.
    pub checkpoint_failure: Option<CheckpointError>,
}

/// An error that prevents rendering.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The film cannot be created.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The filter is not valid.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The photon maps do not fit into memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// No camera samples were requested.
    #[error("0 samples per pixel give no picture; --spp must be at least 1")]
    NoSamples,
    /// A target error was given with an integrator that has no error estimate.
    #[error(
        "only --integrator progressive knows its error while it renders: choose it, or leave --target-error out"
    )]
    TargetWithoutRounds,
    /// The scene has a medium that emits light and the settings use photons.
    #[error(
        "the medium `{0}` emits light, which --integrator path alone renders: photons do not start in media"
    )]
    Glowing(String),
    /// A brick map could not be read while the picture was rendered.
    #[error(transparent)]
    Atlas(#[from] BrickFileError),
    /// The settings read no irradiance.
    #[error(
        "this integrator reads no irradiance atlas: leave out --atlas, or use --integrator photon-map, or photons to show it"
    )]
    AtlasUnused,
    /// The render cannot be resumed.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The part cannot be, or cannot be written.
    #[error(transparent)]
    Part(#[from] PartError),
}

/// Side length of a tile, in pixels.
const TILE: u32 = 16;

/// Tiles that are rendered before they are merged. The number bounds the memory for tiles. It should be large, as threads wait for the
/// last tile of each group.
const TILES_AT_ONCE: usize = 512;

/// Most camera samples per pixel in one pass over the picture. The first passes are smaller, so that the picture shows quickly.
const LARGEST_PASS: u32 = 16;

/// Renders a picture. It runs on the current rayon pool; the result does not depend on the size of the pool.
///
/// # Errors
/// If the request is not valid ([`RenderError`]).
pub fn render(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    render_with_maps(scene, camera, request, None, observer)
}

/// Returns an error where a medium of the scene emits light and the settings use photons.
pub(super) fn check_media(scene: &Scene, settings: &Settings) -> Result<(), RenderError> {
    let is_path = settings.integrator == IntegratorKind::Path && settings.guide == GuideKind::None;
    let emits = |medium: &&Medium| {
        medium.volume.as_ref().is_some_and(|volume| volume.coefficients().emission() != Rgb::ZERO)
    };
    match scene.media().iter().find(emits) {
        Some(medium) if !is_path => Err(RenderError::Glowing(medium.name.clone())),
        _ => Ok(()),
    }
}

/// Renders as [`render`] does, with the photons of `saved` in place of traced ones. The caller must have checked that they belong to this
/// scene and these settings ([`SavedMaps::check`]).
///
/// The picture is the same to the bit, except for scenes whose photons would be allocated to lights by what the camera sees
/// ([`RenderPlan::photon_budget`]). A file is not made for a camera: its photons are allocated by flux, and a warning says so.
///
/// # Errors
/// The same as for [`render`].
pub fn render_with_maps(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    saved: Option<SavedMaps>,
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    render_given(scene, camera, request, (saved, None), observer)
}

/// Renders as [`render`] does, with gather rays that read `atlas` in place of a global photon map. The caller must have opened it for this
/// scene ([`super::open_irradiance_atlas`]).
///
/// # Errors
/// The same as for [`render`]; where a brick could not be read, because the picture would be wrong; and where the settings read no
/// irradiance.
pub fn render_with_atlas(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    atlas: IrradianceAtlas,
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    let Settings { integrator, show, map, .. } = request.settings;
    let is_shown = show == Show::Radiance && map == MapKind::Global;
    let reads = match integrator {
        IntegratorKind::PhotonMap => true,
        IntegratorKind::Photons => is_shown,
        IntegratorKind::Path | IntegratorKind::Progressive => false,
    };
    if !reads {
        return Err(RenderError::AtlasUnused);
    }
    render_given(scene, camera, request, (None, Some(atlas)), observer)
}

/// Renders with maps that are there already, traced to a file or built on disk.
fn render_given(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    (saved, atlas): (Option<SavedMaps>, Option<IrradianceAtlas>),
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    let settings = &request.settings;
    if settings.spp == 0 {
        return Err(RenderError::NoSamples);
    }
    check_media(scene, settings)?;
    if settings.integrator == IntegratorKind::Progressive {
        return super::progressive::render_in_rounds(
            scene,
            camera,
            request,
            observer,
            Rounds::keeping_nothing(),
        );
    }
    if settings.target_error.is_some() {
        return Err(RenderError::TargetWithoutRounds);
    }
    let plan = settings.plan(scene);
    let plan = if atlas.is_some() { plan.with_atlas() } else { plan };
    let mut film = Film::new(request.width, request.height, request.crop, request.layers)?;
    let sums_up = settings.illumination_maps && scene.has_illumination_maps();
    // A file holds individual photons, also those of objects with illumination maps, and so does an atlas.
    let reads = (saved.is_some() || atlas.is_some())
        .then(|| Settings { illumination_maps: false, ..settings.clone() });
    let settings = reads.as_ref().unwrap_or(settings);
    let finest = if sums_up && reads.is_none() {
        finest_distances(scene, camera, (request.width, request.height))
    } else {
        Vec::new()
    };
    let mut memory = scene_memory(scene);
    let budget = photon_budget(scene, camera, &plan, settings);
    let shared = budget.as_ref().filter(|_| saved.is_none());
    // The number of photons in a file is fixed, so a time limit does not change it.
    let paced = match observer.deadline().filter(|_| reads.is_none()) {
        Some(deadline) => {
            let budget = shared;
            Pace { scene, camera, request, plan: &plan, finest: &finest, budget, deadline, observer }
                .fit(settings)?
        }
        None => Paced::unlimited(settings),
    };
    let Paced { ref settings, maps, tracing, seconds_sample, .. } = paced;
    let mut pass_one = match maps {
        Some(maps) => maps,
        None => {
            let picture =
                ForPicture { budget: shared, finest: &finest, saved, atlas, time: tracing, receivers: &[] };
            build_maps_from(scene, &plan, settings, picture, observer)?
        }
    };
    pass_one.warnings.extend(paced.warnings);
    let asked = PhotonCounts::of(&request.settings, &plan);
    for map in pass_one.statistics.iter_mut().filter(|map| !map.from_file) {
        map.stopped |= map.asked < asked.for_map(map.map);
        map.asked = asked.for_map(map.map);
    }
    memory.photons = resident_memory();
    if sums_up && reads.is_some() {
        pass_one.warnings.push(
            "with photons of a file there are no illumination maps: what has one is read from the photon maps".to_owned(),
        );
    }
    if budget.is_some() && shared.is_none() {
        pass_one.warnings.push(
            "photons of a file are shared out by the flux of lights, not by what this camera sees of them: lights are noisier \
             than with photons traced for the picture"
                .to_owned(),
        );
    }
    if pass_one.cancelled {
        let statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
        return Ok(Rendered {
            film,
            statistics,
            stopped: Some(Stop::BeforePixels),
            checkpoint_failure: None,
        });
    }
    let begun = Instant::now();
    let glints = match find_glints(scene, camera, request, &plan, observer) {
        GlintSearch::Done(glints) => Some(*glints),
        GlintSearch::Unplanned => None,
        GlintSearch::Late => {
            pass_one.warnings.push(GlintSearch::LATE.to_owned());
            None
        }
    };
    let seconds_glints = begun.elapsed().as_secs_f64();
    let pass_two = PassTwo {
        scene,
        camera,
        request,
        settings,
        plan: &plan,
        maps: &pass_one.maps,
        reading: settings.photon_map_settings(scene),
        glints: glints.as_ref(),
        samples: CameraSamples { seed: settings.seed, first: 0 },
        seconds_sample,
        observer,
    };
    let Some(taken) = pass_two.run(&mut film)? else {
        let statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
        return Ok(Rendered {
            film,
            statistics,
            stopped: Some(Stop::BeforePixels),
            checkpoint_failure: None,
        });
    };
    if let Some(failure) = pass_one.maps.atlas.as_ref().and_then(IrradianceAtlas::failure) {
        return Err(RenderError::Atlas(failure.clone()));
    }
    let finished = taken.finished;
    memory.cache = taken.memory_cache;
    memory.pixels = resident_memory();
    let mut statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
    statistics.take(taken);
    statistics.times.pixels += seconds_glints;
    statistics.complete(&film, scene);
    let stopped = (!finished).then_some(Stop::DuringPixels);
    Ok(Rendered { film, statistics, stopped, checkpoint_failure: None })
}

/// Random numbers of the camera samples: the seed, and the index of the first sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraSamples {
    pub(super) seed: u64,
    pub(super) first: u32,
}

/// Pass 2: fills the irradiance cache, where there is one, and renders the pixels.
pub(super) struct PassTwo<'a> {
    pub(super) scene: &'a Scene,
    pub(super) camera: &'a Camera,
    pub(super) request: &'a RenderRequest,
    /// The settings of the request, except for the seed, counts reduced to fit the time, and options that rounds or saved maps switch off.
    pub(super) settings: &'a Settings,
    pub(super) plan: &'a RenderPlan,
    pub(super) maps: &'a PhotonMaps,
    pub(super) reading: PhotonMapSettings,
    pub(super) glints: Option<&'a Glints<'a>>,
    pub(super) samples: CameraSamples,
    /// Time that one sample of every pixel takes, from [`PassTwo::measure`]; zero where there is no time limit.
    pub(super) seconds_sample: Duration,
    pub(super) observer: &'a dyn Observer,
}

/// Counters, times and memory of pass 2.
#[derive(Debug)]
pub(super) struct PassTwoReport {
    pub(super) counters: Counters,
    pub(super) shadows: Vec<ShadowCounters>,
    pub(super) cache: Option<CacheStatistics>,
    pub(super) adaptive: Option<AdaptiveStatistics>,
    pub(super) memory_cache: Option<Resident>,
    pub(super) seconds_cache: f64,
    pub(super) seconds_pixels: f64,
    /// Whether all samples were taken.
    pub(super) finished: bool,
}

impl PassTwo<'_> {
    /// Runs the pass. Returns `None` where it was stopped before the first pixel.
    pub(super) fn run(&self, film: &mut Film) -> Result<Option<PassTwoReport>, RenderError> {
        let Self { scene, settings, plan, maps, reading, observer, .. } = *self;
        let sampler = self.request.filter.sampler()?;
        let mut start = Instant::now();
        let mut seconds_cache = 0.0;
        let mut cache = None;
        let mut memory_cache = None;
        let media = CameraMedia::of(scene, self.camera);
        let is_mapped =
            matches!(settings.integrator, IntegratorKind::PhotonMap | IntegratorKind::Progressive);
        let integrator: Box<dyn Integrator + '_> = if is_mapped && plan.irradiance_cache.build {
            let mut integrator = PhotonMapIntegrator::new(scene, maps, plan, reading, media);
            cache = self.fill_cache(&mut integrator);
            if cache.is_none() {
                return Ok(None);
            }
            seconds_cache = start.elapsed().as_secs_f64();
            memory_cache = resident_memory();
            start = Instant::now();
            Box::new(integrator)
        } else {
            self.integrator(media)
        };
        let pixels = self.pixels(&*integrator, &sampler, media, observer);
        let PixelsDone { counters, shadows, finished, adaptive } =
            if settings.adaptive { pixels.run_adaptive(film)? } else { pixels.run(film)? };
        let seconds_pixels = start.elapsed().as_secs_f64();
        Ok(Some(PassTwoReport {
            counters,
            shadows,
            cache,
            adaptive,
            memory_cache,
            seconds_cache,
            seconds_pixels,
            finished,
        }))
    }

    /// The integrator of the settings, without an irradiance cache.
    fn integrator(&self, media: CameraMedia) -> Box<dyn Integrator + '_> {
        let Self { scene, settings, plan, maps, reading, .. } = *self;
        let shown = maps.radiosity.as_ref();
        if let Some(shown) = shown.filter(|it| matches!(it.view, RadiosityView::Flat | RadiosityView::Smooth))
        {
            return Box::new(ShowRadiosity::new(scene, shown, reading, media));
        }
        match settings.integrator {
            IntegratorKind::PhotonMap | IntegratorKind::Progressive => {
                Box::new(PhotonMapIntegrator::new(scene, maps, plan, reading, media))
            }
            IntegratorKind::Photons if settings.show == Show::Classes => {
                Box::new(ShowClasses::new(scene, maps, settings.map, reading, media))
            }
            IntegratorKind::Photons => Box::new(ShowPhotons::new(scene, maps, settings.map, reading, media)),
            IntegratorKind::Path => {
                let guide = maps.guide.as_ref();
                Box::new(
                    PathTracer::new(scene, settings.max_depth, media)
                        .with_wavelengths(settings.wavelengths)
                        .guided_by(guide),
                )
            }
        }
    }

    fn pixels<'b>(
        &'b self,
        integrator: &'b dyn Integrator,
        sampler: &'b FilterSampler,
        media: CameraMedia,
        observer: &'b dyn Observer,
    ) -> PixelPass<'b> {
        let Self { scene, settings, .. } = *self;
        let lamps = match settings.integrator {
            IntegratorKind::Photons => VisibleEmitters::default(),
            // The extra rays would ignore attenuation by the medium.
            _ if scene.scatters() => VisibleEmitters::default(),
            IntegratorKind::PhotonMap | IntegratorKind::Path | IntegratorKind::Progressive => {
                VisibleEmitters::new(scene, self.camera, media, self.request)
            }
        };
        PixelPass {
            camera: self.camera,
            request: self.request,
            sampler,
            integrator,
            scene,
            lamps,
            glints: self.glints,
            certain: match settings.integrator {
                // The path tracer is the reference for the other integrators.
                IntegratorKind::Path => None,
                // Even and odd rounds have their own sample numbers, so samples of both are counted.
                IntegratorKind::Progressive => Some(2.0 * self.samples.first as f32 + settings.spp as f32),
                IntegratorKind::PhotonMap | IntegratorKind::Photons => Some(settings.spp as f32),
            },
            media,
            samples: self.samples,
            observer,
        }
    }

    /// Time that one sample of every pixel takes on all threads, without an irradiance cache. It is measured at pixels spread over the
    /// whole picture for about as long as `time`, and at a minimum number of them in any case.
    pub(super) fn measure(&self, time: Duration) -> Result<Duration, RenderError> {
        /// Pixels per thread in a batch.
        const BATCH: usize = 16;
        /// One of `FEWEST` pixels is measured in any case, and at most one of `MOST`. Fewer would measure how busy the machine was at
        /// that moment.
        const FEWEST: usize = 256;
        const MOST: usize = 16;
        /// The fractional parts of the multiples of this number fill the unit interval evenly.
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let sampler = self.request.filter.sampler()?;
        let media = CameraMedia::of(self.scene, self.camera);
        let integrator = self.integrator(media);
        let pixels = self.pixels(&*integrator, &sampler, media, &Silent);
        let rect = self.request.crop.unwrap_or(PixelRect::whole(self.request.width, self.request.height));
        let area = rect.area().max(1);
        let batch = BATCH * rayon::current_num_threads();
        let (start, mut done) = (Instant::now(), 0);
        let has_time = |done| done < area / MOST && start.elapsed() < time && !self.observer.is_cancelled();
        while done < batch.max(area / FEWEST) || has_time(done) {
            (done..done + batch).into_par_iter().with_max_len(1).for_each_init(
                Scratch::default,
                |scratch, n| {
                    let index = ((n as f64 * GOLDEN).fract() * area as f64) as u32;
                    let (x, y) = (rect.x0 + index % rect.width(), rect.y0 + index / rect.width());
                    let rect = PixelRect { x0: x, y0: y, x1: x + 1, y1: y + 1 };
                    let mut rendered = RenderedTile { rect, ..RenderedTile::default() };
                    pixels.fill(&mut rendered, &|_, _| 0..1, false, scratch);
                },
            );
            done += batch;
        }
        Ok(start.elapsed().mul_f64(area as f64 / done as f64))
    }

    /// Fills the irradiance cache for the whole picture, even where only a window of it is rendered. Returns `None` where it was stopped.
    fn fill_cache(&self, integrator: &mut PhotonMapIntegrator<'_>) -> Option<CacheStatistics> {
        let Self { camera, settings, observer, .. } = *self;
        let RenderRequest { width, height, .. } = *self.request;
        observer.begin("filling the irradiance cache", u64::from(width) * u64::from(height));
        let filling = CacheRequest {
            camera,
            size: (width, height),
            seed: settings.seed,
            error: settings.cache_error,
            rays: settings.cache_samples,
        };
        // Records that the cache lacks are gathered while pixels are rendered. So filling gets at most half of a limited time, and leaves
        // enough for one sample of every pixel.
        let start = Instant::now();
        let end = observer.deadline().map(|end| {
            let left = end.saturating_duration_since(start);
            start + left.mul_f64(0.5).min(left.saturating_sub(self.seconds_sample))
        });
        let is_late = || end.is_some_and(|end| Instant::now() >= end);
        let advance = |done| observer.advance(done);
        let pass = integrator.fill_cache(&filling, &|| observer.is_cancelled(), &is_late, &advance)?;
        Some(CacheStatistics { records: pass.records, rejected: pass.rejected, counters: pass.counters })
    }
}

impl Statistics {
    /// Adds the counters and times of pass 2.
    pub(super) fn take(&mut self, taken: PassTwoReport) {
        self.times.pixels += taken.seconds_pixels;
        self.times.cache += taken.seconds_cache;
        self.counters += taken.counters;
        if let Some(cache) = taken.cache {
            let sum = self.cache.get_or_insert_default();
            sum.records += cache.records;
            sum.rejected += cache.rejected;
            sum.counters += cache.counters;
        }
        self.adaptive = taken.adaptive.or(self.adaptive);
        for (light, decisions) in self.shadows.iter_mut().zip(taken.shadows) {
            light.decisions += decisions;
        }
    }

    /// Computes the derived statistics and the warnings from the counters.
    pub(super) fn complete(&mut self, film: &Film, scene: &Scene) {
        let counters = &self.counters;
        self.mean_depth = counters.depth_sum as f64 / counters.camera_rays.max(1) as f64;
        let filling = self.cache.map(|cache| cache.counters).unwrap_or_default();
        if let Some(atlas) = &mut self.atlas {
            atlas.lookups = counters.bricks;
            atlas.lookups += filling.bricks;
            let BrickCounters { looked_up, missed, .. } = atlas.lookups;
            atlas.hit_percent = 100.0 * (looked_up - missed) as f64 / looked_up.max(1) as f64;
            let rays = counters.atlas_lookups + filling.atlas_lookups;
            atlas.bricks_per_ray = looked_up as f64 / rays.max(1) as f64;
        }
        let segments = counters.gather_path_segments + filling.gather_path_segments;
        self.mean_path_depth = segments as f64 / (counters.gather_paths + filling.gather_paths).max(1) as f64;
        for light in &mut self.shadows {
            let decisions = light.decisions;
            let rays = decisions.rays_saved + decisions.rays_traced;
            if light.rays > 0 && decisions.rays_traced > 0 && decisions.rays_saved == 0 {
                self.warnings.push(format!(
                    "the photons of light {} saved no shadow ray: too few are near one another (raise \
                     --shadow-photon-rays), or it is nowhere seen whole or hidden whole",
                    light.light
                ));
            }
            light.rays_saved_percent = 100.0 * decisions.rays_saved as f64 / rays.max(1) as f64;
        }
        self.samples = film.sample_count() / film.rect().area().max(1) as u64;
        self.rejected_samples = film.rejections().samples;
        warn(self, scene);
    }
}

pub(super) fn statistics(
    scene: &Scene,
    settings: &Settings,
    plan: RenderPlan,
    pass_one: PassOne,
) -> Statistics {
    Statistics {
        schema: 2,
        scene: scene.name().to_owned(),
        settings: settings.clone(),
        plan,
        times: Times { scene: 0.0, photons: pass_one.seconds, cache: 0.0, pixels: 0.0 },
        memory: MemoryStatistics::default(),
        threads: rayon::current_num_threads(),
        samples: 0,
        seconds_irradiance: pass_one.seconds_irradiance,
        irradiance_bytes: pass_one.maps.irradiance_bytes(),
        guide_bytes: pass_one.maps.guide.as_ref().map_or(0, |guide| guide.memory_bytes() as u64),
        maps: pass_one.statistics,
        photon_map_file: pass_one.file,
        cache: None,
        illumination: pass_one.illumination,
        media: pass_one.media,
        atlas: pass_one.maps.atlas.as_ref().map(|atlas| AtlasStatistics {
            counts: atlas.counts(),
            budget: atlas.budget(),
            ..AtlasStatistics::default()
        }),
        radiosity: None,
        adaptive: None,
        shadows: pass_one.shadows,
        seconds_shadows: pass_one.seconds_shadows,
        counters: Counters::default(),
        mean_depth: 0.0,
        mean_path_depth: 0.0,
        rejected_samples: 0,
        rounds: None,
        process: None,
        warnings: pass_one.warnings,
    }
}

/// Memory of the scene, and of the process once the scene is built.
fn scene_memory(scene: &Scene) -> MemoryStatistics {
    let bytes = |geometry: &Geometry| match geometry {
        Geometry::Mesh(mesh) => {
            mesh.buffers.memory_bytes()
                + mesh.normals.as_ref().map_or(0, |normals| size_of_val(normals.as_slice()))
        }
        Geometry::Procedural(_) => 0,
    };
    MemoryStatistics {
        meshes: scene.surfaces().iter().map(|surface| bytes(&surface.geometry) as u64).sum(),
        hierarchy: scene.embree().device().memory_bytes(),
        scene: resident_memory(),
        ..MemoryStatistics::default()
    }
}

struct PixelPass<'a> {
    camera: &'a Camera,
    request: &'a RenderRequest,
    sampler: &'a FilterSampler,
    integrator: &'a dyn Integrator,
    scene: &'a Scene,
    lamps: VisibleEmitters,
    glints: Option<&'a Glints<'a>>,
    /// Camera samples per pixel of all rounds up to this one. The MIS weight of emitters that are hit by chance uses them; `None` where
    /// there is no such weight.
    certain: Option<f32>,
    media: CameraMedia,
    samples: CameraSamples,
    observer: &'a dyn Observer,
}

impl PixelPass<'_> {
    /// Takes all samples, in passes over the whole picture.
    fn run(&self, film: &mut Film) -> Result<PixelsDone, FilmError> {
        let spp = self.request.settings.spp;
        let rect = film.rect();
        let tiles = rect.tiles(TILE);
        self.observer.begin("rendering", rect.area() as u64 * u64::from(spp));
        let mut done = PixelsDone::new(self.scene);
        let mut advanced = 0;
        let mut first = 0;
        while first < spp {
            let count = (first * 3).clamp(1, LARGEST_PASS).min(spp - first);
            let samples = |_, _| first..first + count;
            if !self.pass(&tiles, &samples, film, &mut advanced, &mut done, None)? {
                return Ok(done);
            }
            first += count;
        }
        done.finished = true;
        Ok(done)
    }

    /// Takes a few samples of every pixel (the pilot), then distributes the other samples by the variance of the pilot. The pilot covers
    /// the whole picture even where only a window is rendered, so that the window equals that part of the whole picture.
    fn run_adaptive(&self, film: &mut Film) -> Result<PixelsDone, FilmError> {
        let RenderRequest { width, height, ref settings, .. } = *self.request;
        let whole = PixelRect::whole(width, height);
        let pilot = pilot_samples(settings.spp);
        let rest = u64::from(settings.spp - pilot) * film.rect().area() as u64;
        self.observer.begin("rendering", whole.area() as u64 * u64::from(pilot) + rest);
        let mut done = PixelsDone::new(self.scene);
        let mut advanced = 0;
        let mut moments = vec![Moments::default(); whole.area()];
        let first = |_, _| 0..pilot;
        if !self.pass(&whole.tiles(TILE), &first, film, &mut advanced, &mut done, Some(&mut moments))? {
            return Ok(done);
        }
        let counts = SampleCounts::share_out(&moments, width, (pilot, settings.spp), settings.seed);
        drop(moments);
        let (fewest, most, mean) = counts.summary();
        done.adaptive = Some(AdaptiveStatistics { pilot, fewest, most, mean });
        let others = |x, y| pilot..counts.at(x, y);
        let tiles = film.rect().tiles(TILE);
        done.finished = self.pass(&tiles, &others, film, &mut advanced, &mut done, None)?;
        Ok(done)
    }

    /// One pass over `tiles`: takes the samples with the indices `samples(x, y)` of each pixel. Pixels outside the film are rendered only
    /// for their `moments`, which cover the whole picture. Returns `false` where it was stopped.
    fn pass(
        &self,
        tiles: &[PixelRect],
        samples: &(dyn Fn(u32, u32) -> Range<u32> + Sync),
        film: &mut Film,
        advanced: &mut u64,
        done: &mut PixelsDone,
        mut moments: Option<&mut [Moments]>,
    ) -> Result<bool, FilmError> {
        let whole = PixelRect::whole(self.request.width, self.request.height);
        let wants_moments = moments.is_some();
        for group in tiles.chunks(TILES_AT_ONCE) {
            let rendered: Vec<Option<RenderedTile>> = group
                .par_iter()
                // One tile per task: larger tasks would leave threads without work at the end.
                .with_max_len(1)
                .map_init(Scratch::default, |scratch, &rect| {
                    // The first sample of every pixel is taken even after the deadline: without it there is no picture.
                    let is_first = samples(rect.x0, rect.y0).start == 0;
                    if self.observer.is_cancelled() || !is_first && self.observer.should_stop() {
                        return Ok(None);
                    }
                    let inside = rect.intersection(&film.rect());
                    let tile = if inside.is_empty() { None } else { Some(film.tile(inside)?) };
                    let mut rendered = RenderedTile { rect, tile, ..RenderedTile::default() };
                    self.fill(&mut rendered, samples, wants_moments, scratch);
                    rendered.counters = std::mem::take(&mut scratch.counters);
                    rendered.shadows = std::mem::take(&mut scratch.shadows);
                    Ok(Some(rendered))
                })
                .collect::<Result<_, FilmError>>()?;
            let mut complete = true;
            for rendered in rendered {
                let Some(rendered) = rendered else {
                    complete = false;
                    continue;
                };
                complete &= !rendered.is_cut;
                if let Some(tile) = &rendered.tile {
                    film.merge(tile)?;
                }
                if let Some(moments) = &mut moments {
                    for ((x, y), found) in rendered.rect.pixels().zip(rendered.moments) {
                        if let Some(index) = whole.index(x, y) {
                            moments[index] = found;
                        }
                    }
                }
                done.counters += rendered.counters;
                done.shadows.iter_mut().zip(rendered.shadows).for_each(|(sum, light)| *sum += light);
                *advanced += rendered.samples;
            }
            self.observer.advance(*advanced);
            if !complete {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn fill(
        &self,
        rendered: &mut RenderedTile,
        samples: &(dyn Fn(u32, u32) -> Range<u32> + Sync),
        wants_moments: bool,
        scratch: &mut Scratch,
    ) {
        let (width, height) = (self.request.width, self.request.height);
        let CameraSamples { seed, first } = self.samples;
        let size = Vec2::new(width as f32, height as f32);
        // Converts radiance from render space; the factor is a power of two, so nothing is rounded.
        let scale = 1.0 / self.scene.space().power;
        let lamps = self.lamps.near(rendered.rect);
        for (x, y) in rendered.rect.pixels() {
            scratch.begin_pixel();
            let pixel = u64::from(y) * u64::from(width) + u64::from(x);
            let center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let glints = self.glints.and_then(|glints| glints.map.of_pixel(center, self.sampler));
            let shows_lamps = lamps.iter().any(|lamp| lamp.is_near(center));
            let mut moments = Moments::default();
            let mut wanted = samples(x, y);
            if self.observer.should_stop() {
                let is_first = wanted.start == 0 && !self.observer.is_cancelled();
                rendered.is_cut |= wanted.len() > usize::from(is_first);
                wanted.end = wanted.end.min(wanted.start + u32::from(is_first));
            }
            for index in wanted {
                let index = first.wrapping_add(index);
                let mut stream = SampleStream::new(seed, pixel, index);
                let filtered = self.sampler.sample(stream.next_2d());
                let place = FilmPlace { size, center, offset: filtered.offset };
                if !self.camera.shows((center + filtered.offset) / size) {
                    rendered.add((x, y), filtered.weight, &PixelSample::default());
                    if wants_moments {
                        moments.add(0.0);
                    }
                    continue;
                }
                // A pinhole camera uses no random numbers for the lens.
                let lens = self.camera.lens().map_or(Vec2::ZERO, |_| stream.next_2d());
                let ray = CameraRay::new(self.camera, place, lens);
                let known = self.glints.map(|known| GlintView {
                    camera: &ray,
                    sampler: self.sampler,
                    pixel: glints.as_ref(),
                    hunter: &known.hunter,
                    samples: self.certain,
                    meetings: &known.meetings,
                });
                let eye = EyeRay { ray: ray.ray, glints: known };
                let mut sample = self.integrator.li(&eye, &mut stream, scratch);
                if let Some(glints) = &glints {
                    let numbers = Rng::new(seed, Stream::Glints, (pixel << 32) | u64::from(index));
                    let (by, view) = ((self.scene, self.media), (self.camera, size, lens));
                    sample.add(Aov::Specular, glints.radiance(by, view, filtered.weight, numbers));
                }
                if shows_lamps {
                    let numbers = Rng::new(seed, Stream::VisibleEmitters, (pixel << 32) | u64::from(index));
                    let emission = &mut sample.radiance[Aov::Emission as usize];
                    let view = (self.camera, self.sampler, place, filtered.weight);
                    *emission = self.lamps.refined(self.scene, view, *emission, numbers);
                }
                for aov in AOVS {
                    sample.radiance[aov as usize] = to_world(sample.radiance[aov as usize], scale);
                }
                sample.bias = to_world(sample.bias, scale);
                if wants_moments {
                    let sum: DVec3 = sample.radiance.iter().map(|radiance| radiance.as_dvec3()).sum();
                    moments.add(sum.dot(LUMINANCE));
                }
                rendered.add((x, y), filtered.weight, &sample);
            }
            if wants_moments {
                rendered.moments.push(moments);
            }
        }
    }
}

/// Luminance weights of the channels (Rec. 709).
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Result of one tile.
#[derive(Default)]
struct RenderedTile {
    rect: PixelRect,
    /// Samples of the part that lies in the film; `None` where no part does.
    tile: Option<Tile>,
    /// Moments by pixel of the rectangle; empty where they are not needed.
    moments: Vec<Moments>,
    counters: Counters,
    shadows: Vec<ShadowCounters>,
    samples: u64,
    /// Whether pixels lack samples because the render was stopped.
    is_cut: bool,
}

impl RenderedTile {
    /// Adds a camera sample of a pixel.
    fn add(&mut self, (x, y): (u32, u32), weight: f32, sample: &PixelSample) {
        self.samples += 1;
        if let Some(tile) = self.tile.as_mut().filter(|tile| tile.rect().contains(x, y)) {
            tile.add(x, y, weight, sample);
        }
    }
}

/// Totals over all pixels.
struct PixelsDone {
    counters: Counters,
    /// Counters of shadow photons, by light.
    shadows: Vec<ShadowCounters>,
    finished: bool,
    adaptive: Option<AdaptiveStatistics>,
}

impl PixelsDone {
    fn new(scene: &Scene) -> Self {
        Self {
            counters: Counters::default(),
            shadows: vec![ShadowCounters::default(); scene.lights().len()],
            finished: false,
            adaptive: None,
        }
    }
}

/// `radiance` times `scale`, clamped to the largest `f32`, which the film counts as clamped. A value that is not finite is returned
/// unchanged.
fn to_world(radiance: Rgb, scale: f64) -> Rgb {
    if !radiance.is_finite() {
        return radiance;
    }
    let most = DVec3::splat(f64::from(f32::MAX));
    (radiance.as_dvec3() * scale).clamp(-most, most).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_beyond_single_precision_is_cut_and_nothing_else_changed() {
        let one = Rgb::new(1.0, 0.3, 0.0);
        assert_eq!(to_world(one, 2f64.powi(40)), one * 2f32.powi(40));
        assert_eq!(to_world(one, 2f64.powi(200)), Rgb::new(f32::MAX, f32::MAX, 0.0));
        assert_eq!(to_world(one, 2f64.powi(-300)), Rgb::ZERO);
        assert!(to_world(Rgb::new(f32::NAN, 1.0, 1.0), 1.0).x.is_nan());
        assert_eq!(to_world(Rgb::new(f32::INFINITY, 1.0, 1.0), 1.0).x, f32::INFINITY);
    }
}
