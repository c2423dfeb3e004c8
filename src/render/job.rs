//! Pass 2 as a job: tiles of pixels on all threads, merged in order.

use super::maps::{PassOne, build_maps_from, is_worth_a_warning};
use super::memory::{MemoryError, resident_memory};
use super::observer::Observer;
use super::saved::SavedMaps;
use super::settings::{Settings, Show};
use super::stats::{CacheStatistics, MemoryStatistics, Statistics, Times};
use crate::camera::Camera;
use crate::film::{AOVS, Film, FilmError, Filter, FilterError, FilterSampler, LayerSet, PixelRect, Tile};
use crate::integrators::{
    CacheRequest, Counters, Integrator, PathTracer, PhotonMapIntegrator, Scratch, ShadowCounters,
    ShowClasses, ShowPhotons,
};
use crate::math::Rgb;
use crate::sampling::SampleStream;
use crate::scene::{Geometry, IntegratorKind, RenderPlan, Scene};
use glam::{DVec3, Vec2};
use rayon::prelude::*;
use std::time::Instant;

/// What is to be rendered.
#[derive(Clone, Debug)]
pub struct RenderRequest {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Only these pixels.
    pub crop: Option<PixelRect>,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Layers beside the five parts of the picture.
    pub layers: LayerSet,
    /// Settings.
    pub settings: Settings,
}

/// Why a render ended before all its samples were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// During pass 1: there is no picture.
    BeforePixels,
    /// During pass 2: pixels have fewer samples than asked for, some may have none.
    DuringPixels,
}

/// A picture, and how it came about.
#[derive(Debug)]
pub struct Rendered {
    /// The film.
    pub film: Film,
    /// Numbers.
    pub statistics: Statistics,
    /// Whether it was stopped early.
    pub stopped: Option<Stop>,
}

/// Why nothing can be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The film.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The filter.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// The photon maps.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// No samples.
    #[error("0 samples per pixel give no picture; --spp must be at least 1")]
    NoSamples,
}

/// Pixels on a side of a tile.
const TILE: u32 = 16;

/// Tiles rendered before they are merged: bounds the memory for tiles, and how long threads wait for the last.
const TILES_AT_ONCE: usize = 512;

/// Camera samples per pixel in one pass over the picture, after the first ones that show it quickly.
const LARGEST_PASS: u32 = 16;

/// Renders. Runs on the current rayon pool; the result does not depend on its size.
///
/// # Errors
/// Where the request makes no sense.
pub fn render(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    render_with_maps(scene, camera, request, None, observer)
}

/// [`render`], with the photons of `saved`, which must have been checked to be those of this scene and these settings
/// ([`SavedMaps::check`]), in place of traced ones: the same picture to the bit.
///
/// # Errors
/// As [`render`].
pub fn render_with_maps(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    saved: Option<SavedMaps>,
    observer: &dyn Observer,
) -> Result<Rendered, RenderError> {
    let settings = &request.settings;
    if settings.spp == 0 {
        return Err(RenderError::NoSamples);
    }
    let plan = settings.plan(scene);
    let mut film = Film::new(request.width, request.height, request.crop, request.layers)?;
    let sampler = request.filter.sampler()?;
    let mut memory = scene_memory(scene);
    let pass_one = build_maps_from(scene, &plan, settings, saved, observer)?;
    memory.photons = resident_memory();
    if pass_one.cancelled {
        let statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
        return Ok(Rendered { film, statistics, stopped: Some(Stop::BeforePixels) });
    }
    let mut start = Instant::now();
    let mut seconds_cache = 0.0;
    let mut cache = None;
    let medium = scene.medium_at(camera.eye());
    let reading = settings.photon_map_settings(scene);
    let integrator: Box<dyn Integrator + '_> = match settings.integrator {
        IntegratorKind::PhotonMap => {
            let mut integrator = PhotonMapIntegrator::new(scene, &pass_one.maps, &plan, reading, medium);
            if plan.irradiance_cache.build {
                cache = fill_cache(&mut integrator, camera, request, observer);
                if cache.is_none() {
                    let statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
                    return Ok(Rendered { film, statistics, stopped: Some(Stop::BeforePixels) });
                }
                seconds_cache = start.elapsed().as_secs_f64();
                memory.cache = resident_memory();
                start = Instant::now();
            }
            Box::new(integrator)
        }
        IntegratorKind::Photons if settings.show == Show::Classes => {
            Box::new(ShowClasses::new(scene, &pass_one.maps, settings.map, reading, medium))
        }
        IntegratorKind::Photons => {
            Box::new(ShowPhotons::new(scene, &pass_one.maps, settings.map, reading, medium))
        }
        IntegratorKind::Path => {
            let guide = pass_one.maps.guide.as_ref();
            Box::new(PathTracer::new(scene, settings.max_depth, medium).guided_by(guide))
        }
    };
    let pixels = PixelPass { camera, request, sampler: &sampler, integrator: &*integrator, scene, observer };
    let (counters, shadows, finished) = pixels.run(&mut film)?;
    drop(integrator);
    memory.pixels = resident_memory();
    let mut statistics = Statistics { memory, ..statistics(scene, settings, plan, pass_one) };
    statistics.times.pixels = start.elapsed().as_secs_f64();
    statistics.mean_depth = counters.depth_sum as f64 / counters.camera_rays.max(1) as f64;
    statistics.times.cache = seconds_cache;
    let filling = cache.map(|cache| cache.counters).unwrap_or_default();
    let segments = counters.gather_path_segments + filling.gather_path_segments;
    statistics.mean_path_depth =
        segments as f64 / (counters.gather_paths + filling.gather_paths).max(1) as f64;
    statistics.cache = cache;
    statistics.counters = counters;
    for (light, decisions) in statistics.shadows.iter_mut().zip(shadows) {
        let rays = decisions.rays_saved + decisions.rays_traced;
        light.decisions = decisions;
        if light.rays > 0 && decisions.rays_traced > 0 && decisions.rays_saved == 0 {
            statistics.warnings.push(format!(
                "the photons of light {} saved no shadow ray: too few are near one another (raise --shadow-photon-rays), \
                 or it is nowhere seen whole or hidden whole",
                light.light
            ));
        }
        light.rays_saved_percent = 100.0 * decisions.rays_saved as f64 / rays.max(1) as f64;
    }
    statistics.samples = film.sample_count() / film.rect().area().max(1) as u64;
    statistics.rejected_samples = film.rejections().samples;
    warn(&mut statistics, scene);
    Ok(Rendered { film, statistics, stopped: (!finished).then_some(Stop::DuringPixels) })
}

/// Fills the irradiance cache for the whole picture, whatever part of it is rendered. `None` where it was stopped.
fn fill_cache(
    integrator: &mut PhotonMapIntegrator<'_>,
    camera: &Camera,
    request: &RenderRequest,
    observer: &dyn Observer,
) -> Option<CacheStatistics> {
    let RenderRequest { width, height, settings, .. } = request;
    observer.begin("filling the irradiance cache", u64::from(*width) * u64::from(*height));
    let filling = CacheRequest {
        camera,
        size: (*width, *height),
        seed: settings.seed,
        error: settings.cache_error,
        rays: settings.cache_samples,
    };
    // What the cache lacks is gathered while pixels are rendered, so of a limited time it gets no more than half.
    let start = Instant::now();
    let end = observer.deadline().map(|end| start + end.saturating_duration_since(start).mul_f64(0.5));
    let is_late = || end.is_some_and(|end| Instant::now() >= end);
    let advance = |done| observer.advance(done);
    let pass = integrator.fill_cache(&filling, &|| observer.is_cancelled(), &is_late, &advance)?;
    Some(CacheStatistics { records: pass.records, rejected: pass.rejected, counters: pass.counters })
}

fn statistics(scene: &Scene, settings: &Settings, plan: RenderPlan, pass_one: PassOne) -> Statistics {
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
        irradiance_bytes: pass_one.maps.irradiance.as_ref().map_or(0, |map| map.memory_bytes() as u64),
        guide_bytes: pass_one.maps.guide.as_ref().map_or(0, |guide| guide.memory_bytes() as u64),
        maps: pass_one.statistics,
        photon_map_file: pass_one.file,
        cache: None,
        shadows: pass_one.shadows,
        seconds_shadows: pass_one.seconds_shadows,
        counters: Counters::default(),
        mean_depth: 0.0,
        mean_path_depth: 0.0,
        rejected_samples: 0,
        warnings: pass_one.warnings,
    }
}

/// What the scene takes, and the process with it.
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

fn warn(statistics: &mut Statistics, scene: &Scene) {
    let counters = &statistics.counters;
    let mut warnings = Vec::new();
    if statistics.rejected_samples > 0 {
        warnings.push(format!("{} samples were not finite and were left out", statistics.rejected_samples));
    }
    if is_worth_a_warning(counters.truncated, counters.camera_rays) {
        warnings.push(format!(
            "{} paths were cut off at {} surfaces; their light is missing (raise --max-depth)",
            counters.truncated, statistics.settings.max_depth
        ));
    }
    if is_worth_a_warning(counters.medium_mismatches, counters.interfaces) {
        warnings.push(format!(
            "{} times a ray met an interface in another medium than the interface states on that side: check `inside` \
             and `outside` of the materials and the direction of normals",
            counters.medium_mismatches
        ));
    }
    if statistics.settings.integrator == IntegratorKind::Path && scene.has_hidden_caustics() {
        warnings.push(
            "paths from the camera never hit a point or parallel light, so their light is missing where it comes by way \
             of mirrors or glass; the photon map has it, or give the lights a size"
                .to_owned(),
        );
    }
    let panics = scene.embree().panics();
    if panics > 0 {
        warnings.push(format!("a procedural object failed {panics} times; those rays missed it"));
    }
    statistics.warnings.extend(warnings);
}

struct PixelPass<'a> {
    camera: &'a Camera,
    request: &'a RenderRequest,
    sampler: &'a FilterSampler,
    integrator: &'a dyn Integrator,
    scene: &'a Scene,
    observer: &'a dyn Observer,
}

impl PixelPass<'_> {
    /// Takes all samples, in passes that each give the whole picture some; `false` where it was stopped.
    fn run(&self, film: &mut Film) -> Result<(Counters, Vec<ShadowCounters>, bool), FilmError> {
        let spp = self.request.settings.spp;
        let rect = film.rect();
        let tiles = rect.tiles(TILE);
        let total = rect.area() as u64 * u64::from(spp);
        self.observer.begin("rendering", total);
        let mut counters = Counters::default();
        let mut shadows = vec![ShadowCounters::default(); self.scene.lights().len()];
        let mut done = 0u64;
        let mut first = 0;
        while first < spp {
            let count = first.clamp(1, LARGEST_PASS).min(spp - first);
            for group in tiles.chunks(TILES_AT_ONCE) {
                let rendered: Vec<Option<(Tile, Counters, Vec<ShadowCounters>)>> = group
                    .par_iter()
                    // One by one: whole halves of a row of tiles would leave threads without work at the end.
                    .with_max_len(1)
                    .map_init(Scratch::default, |scratch, &rect| {
                        if self.observer.should_stop() {
                            return Ok(None);
                        }
                        let mut tile = film.tile(rect)?;
                        self.fill(&mut tile, first, count, scratch);
                        let counters = std::mem::take(&mut scratch.counters);
                        Ok(Some((tile, counters, std::mem::take(&mut scratch.shadows))))
                    })
                    .collect::<Result<_, FilmError>>()?;
                let mut whole = true;
                for tile in rendered {
                    let Some((tile, counted, decided)) = tile else {
                        whole = false;
                        continue;
                    };
                    film.merge(&tile)?;
                    counters += counted;
                    shadows.iter_mut().zip(decided).for_each(|(sum, light)| *sum += light);
                    done += tile.rect().area() as u64 * u64::from(count);
                }
                self.observer.advance(done);
                if !whole {
                    return Ok((counters, shadows, false));
                }
            }
            first += count;
        }
        Ok((counters, shadows, true))
    }

    fn fill(&self, tile: &mut Tile, first: u32, count: u32, scratch: &mut Scratch) {
        let (width, height) = (self.request.width, self.request.height);
        let size = Vec2::new(width as f32, height as f32);
        // Back from render space; a power of two, so nothing is rounded.
        let scale = 1.0 / self.scene.space().power;
        for (x, y) in tile.rect().pixels() {
            let pixel = u64::from(y) * u64::from(width) + u64::from(x);
            let center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            for index in first..first + count {
                let mut samples = SampleStream::new(self.request.settings.seed, pixel, index);
                let filtered = self.sampler.sample(samples.next_2d());
                let ray = self.camera.ray((center + filtered.offset) / size);
                let mut sample = self.integrator.li(ray, &mut samples, scratch);
                for aov in AOVS {
                    sample.radiance[aov as usize] = to_world(sample.radiance[aov as usize], scale);
                }
                tile.add(x, y, filtered.weight, &sample);
            }
        }
    }
}

/// `radiance` times `scale`, at most the largest `f32`, which the film counts as clamped. What is not finite stays so.
fn to_world(radiance: Rgb, scale: f64) -> Rgb {
    if !radiance.is_finite() {
        return radiance;
    }
    (radiance.as_dvec3() * scale).min(DVec3::splat(f64::from(f32::MAX))).as_vec3()
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
