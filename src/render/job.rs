//! Pass 2 as a job: tiles of pixels on all threads, merged in order.

use super::maps::{PassOne, build_maps, is_worth_a_warning};
use super::memory::MemoryError;
use super::observer::Observer;
use super::settings::Settings;
use super::stats::{Statistics, Times};
use crate::camera::Camera;
use crate::film::{AOVS, Film, FilmError, Filter, FilterError, FilterSampler, LayerSet, PixelRect, Tile};
use crate::integrators::{Counters, Integrator, PathTracer, PhotonMapIntegrator, Scratch, ShowPhotons};
use crate::math::Rgb;
use crate::sampling::SampleStream;
use crate::scene::{IntegratorKind, RenderPlan, Scene};
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
    let settings = &request.settings;
    if settings.spp == 0 {
        return Err(RenderError::NoSamples);
    }
    let plan = RenderPlan::new(scene, settings.integrator, settings.map);
    let mut film = Film::new(request.width, request.height, request.crop, request.layers)?;
    let sampler = request.filter.sampler()?;
    let pass_one = build_maps(scene, &plan, settings, observer)?;
    if pass_one.cancelled {
        let statistics = statistics(scene, settings, plan, pass_one);
        return Ok(Rendered { film, statistics, stopped: Some(Stop::BeforePixels) });
    }
    let start = Instant::now();
    let medium = scene.medium_at(camera.eye());
    let reading = settings.photon_map_settings(scene.bounds().1);
    let integrator: Box<dyn Integrator + '_> = match settings.integrator {
        IntegratorKind::PhotonMap => {
            Box::new(PhotonMapIntegrator::new(scene, &pass_one.maps, &plan, reading, medium))
        }
        IntegratorKind::Photons => {
            Box::new(ShowPhotons::new(scene, &pass_one.maps, settings.map, reading, medium))
        }
        IntegratorKind::Path => Box::new(PathTracer::new(scene, settings.max_depth, medium)),
    };
    let pixels = PixelPass { camera, request, sampler: &sampler, integrator: &*integrator, scene, observer };
    let (counters, finished) = pixels.run(&mut film)?;
    drop(integrator);
    let mut statistics = statistics(scene, settings, plan, pass_one);
    statistics.times.pixels = start.elapsed().as_secs_f64();
    statistics.mean_depth = counters.depth_sum as f64 / counters.camera_rays.max(1) as f64;
    statistics.counters = counters;
    statistics.samples = film.sample_count() / film.rect().area().max(1) as u64;
    statistics.rejected_samples = film.rejections().samples;
    warn(&mut statistics, scene);
    Ok(Rendered { film, statistics, stopped: (!finished).then_some(Stop::DuringPixels) })
}

fn statistics(scene: &Scene, settings: &Settings, plan: RenderPlan, pass_one: PassOne) -> Statistics {
    Statistics {
        schema: 1,
        scene: scene.name().to_owned(),
        settings: settings.clone(),
        plan,
        times: Times { scene: 0.0, photons: pass_one.seconds, pixels: 0.0 },
        threads: rayon::current_num_threads(),
        samples: 0,
        irradiance_bytes: pass_one.maps.irradiance.as_ref().map_or(0, |map| map.memory_bytes() as u64),
        maps: pass_one.statistics,
        counters: Counters::default(),
        mean_depth: 0.0,
        rejected_samples: 0,
        warnings: pass_one.warnings,
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
    fn run(&self, film: &mut Film) -> Result<(Counters, bool), FilmError> {
        let spp = self.request.settings.spp;
        let rect = film.rect();
        let tiles = rect.tiles(TILE);
        let total = rect.area() as u64 * u64::from(spp);
        self.observer.begin("rendering", total);
        let mut counters = Counters::default();
        let mut done = 0u64;
        let mut first = 0;
        while first < spp {
            let count = first.clamp(1, LARGEST_PASS).min(spp - first);
            for group in tiles.chunks(TILES_AT_ONCE) {
                let rendered: Vec<Option<(Tile, Counters)>> = group
                    .par_iter()
                    .map_init(Scratch::default, |scratch, &rect| {
                        if self.observer.should_stop() {
                            return Ok(None);
                        }
                        let mut tile = film.tile(rect)?;
                        self.fill(&mut tile, first, count, scratch);
                        Ok(Some((tile, std::mem::take(&mut scratch.counters))))
                    })
                    .collect::<Result<_, FilmError>>()?;
                let mut whole = true;
                for tile in rendered {
                    let Some((tile, counted)) = tile else {
                        whole = false;
                        continue;
                    };
                    film.merge(&tile)?;
                    counters += counted;
                    done += tile.rect().area() as u64 * u64::from(count);
                }
                self.observer.advance(done);
                if !whole {
                    return Ok((counters, false));
                }
            }
            first += count;
        }
        Ok((counters, true))
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
