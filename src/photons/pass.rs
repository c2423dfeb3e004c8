//! The photon pass as a whole: how many photons to emit, their distribution over threads, and the result of a pass that
//! is stopped.

use super::Photon;
use super::emission::{Emitter, Goals};
use super::sources::Sources;
use super::trace::{Batch, Kept, PhotonTally, Starts, TraceSettings, Traced};
use super::volume::{MediaMaps, MediaRecords, Thinning};
use crate::lights::LightId;
use crate::math::Ray;
use crate::media::MediumId;
use crate::sampling::{Rng, Stream};
use crate::scene::{MapKind, Scene, Surface, Target};
use crate::settings::Wavelengths;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Photons of one map.
#[derive(Debug)]
pub struct TracedPhotons {
    /// The photons; the caller divides their powers by `emitted`.
    pub photons: Vec<Photon>,
    /// By photon: index of the surface that it is stored at. Empty where no surface has an illumination map.
    pub surfaces: Vec<u32>,
    /// Photons in media, where those were asked for.
    pub(super) media: MediaRecords,
    /// Photons emitted by all lights together.
    pub emitted: u64,
    /// By light.
    pub tallies: Vec<PhotonTally>,
    /// Whether the pass was stopped before all photons were traced. There are then fewer photons, but they represent
    /// the same light.
    pub stopped: bool,
    /// By surface, for the caustic map: whether any photon met it. Empty for other maps.
    pub reached: Vec<bool>,
    /// Lights that emit, but of which no photon was traced because the pass was stopped.
    pub missing: Vec<LightId>,
    /// Lights with more than one medium on one side.
    pub divided: Vec<LightId>,
}

impl TracedPhotons {
    /// Number of photons stored.
    fn len(&self) -> usize {
        self.photons.len() + self.media.len()
    }

    /// Number of paths that media scattered where that may be stored.
    fn media_paths(&self) -> u64 {
        self.tallies.iter().map(|tally| tally.media_paths).sum()
    }

    /// Whether paths stay in media for long.
    fn is_dense(&self) -> bool {
        let collisions: u64 = self.tallies.iter().map(|tally| tally.media_collisions).sum();
        collisions > DENSE.saturating_mul(self.media_paths())
    }
}

/// Photons that one task traces: few enough that no thread waits long for the last task.
const CHUNK: u64 = 512;

/// A short pass that stores fewer photons than this is followed by a longer one, whatever share of the requested number
/// they are.
const FEW: u64 = 4096;

/// Parts of a short pass; the variation of their counts gives its standard error.
const REPLICAS: u64 = 16;

/// Photons of the first short pass. The number is small, because photons have thousands of bounces where surfaces
/// reflect nearly everything.
const FIRST_PREPASS: u64 = 256;

/// Ratio of the lengths of successive short passes.
const GROWTH: u64 = 4;

/// Largest relative standard error of the stored photons for each emitted one at which a short pass is accepted: a
/// quarter of the 10 % by which the number may be off.
const CERTAIN: f64 = 0.025;

/// A short pass is also accepted when it stores this share of the requested photons.
const LARGEST_SHARE: f64 = 0.125;

/// Largest number of emitted photons for each stored one. Where more would be needed, fewer photons are stored.
const MOST_EMITTED_PER_STORED: f64 = 2000.0;

/// Largest number of photons emitted for each that is to be stored in media, of those that get there by way of diffuse surfaces.
const MOST_BY_SURFACES: u64 = 16;

/// The same for photons in media, of which each may cross several bodies.
const MOST_EMITTED_IN_MEDIA: f64 = 64.0;

/// Media are dense where they scatter a photon more often.
const DENSE: u64 = 32;

/// Photons to store of each path in dense media: those of one path lie close together and have one colour.
const STORED_OF_PATH: f64 = 2.0;

/// If one in [`MOST_EMITTED_PER_STORED`] photons is stored, then a pass of this many times as many photons stores none
/// with probability e^-20.
const SURE: f64 = 20.0;

/// Traces about `settings.stored` photons: within 10 %, as long as that does not need more than 2000 emitted photons
/// for each.
///
/// Short passes with random numbers of their own determine how many photons to emit, so that this number does not
/// depend on the photons that are kept. Each light emits in proportion to its flux (for the caustic map, to its flux
/// towards caustic casters) and to the factor in the scene file. The number of a photon alone determines its path, so
/// the result is the same for any number of threads.
///
/// `progress` is called with the number of photons traced so far and the number to trace. Once it returns `false`, no
/// further task begins, and the finished ones are returned: for each light the photons up to some number, in order,
/// which are an estimate of the same light from fewer photons. `None` where no task is finished yet.
pub fn trace_photons(
    scene: &Scene,
    settings: &TraceSettings,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Option<TracedPhotons> {
    trace_photons_for(scene, settings, PhotonsFor::default(), progress)
}

/// Purpose of the photons, beyond what the scene itself states.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhotonsFor<'a> {
    /// By light: factor on its number of photons, before all numbers are scaled to the requested total. Factors are
    /// positive; they change the noise, not the mean.
    pub budget: Option<&'a [f64]>,
    /// Surfaces whose irradiance is needed: photons are stored there whatever these surfaces reflect, even if they are
    /// black. Indices into [`Scene::surfaces`], in ascending order. Elsewhere photons are stored only where a diffuse
    /// lobe reflects them.
    pub receivers: &'a [u32],
    /// Whether photons are stored in media instead of on surfaces; see [`trace_media_photons`].
    in_media: bool,
}

impl<'a> PhotonsFor<'a> {
    /// Photons for the surfaces that the scene itself states, and for `receivers`.
    pub fn surfaces(budget: Option<&'a [f64]>, receivers: &'a [u32]) -> Self {
        Self { budget, receivers, in_media: false }
    }
}

/// Traces photons that media scatter, and adds them to `maps`: with [`MapKind::Caustic`] beams of specular chains, `settings.stored` about,
/// with [`MapKind::Global`] points of light that was scattered or reflected diffusely before. Otherwise as [`trace_photons_for`]. The
/// photons are in `maps` and not in the result.
pub fn trace_media_photons(
    scene: &Scene,
    settings: &TraceSettings,
    budget: Option<&[f64]>,
    maps: &mut MediaMaps,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Option<TracedPhotons> {
    let wanted = PhotonsFor { budget, receivers: &[], in_media: true };
    if settings.kind == MapKind::Caustic {
        let mut traced = trace_photons_for(scene, settings, wanted, progress)?;
        maps.add_caustics(scene, &std::mem::take(&mut traced.media), traced.emitted);
        return Some(traced);
    }
    if !settings.aimed {
        let mut traced = trace_photons_for(scene, settings, wanted, progress)?;
        maps.add_scattered(scene, &std::mem::take(&mut traced.media), traced.emitted);
        return Some(traced);
    }
    // Photons from a light to a medium, straight or through glass and mirrors, are aimed there, however small that is. The others get there
    // by way of diffuse surfaces.
    let half = TraceSettings { stored: settings.stored.div_ceil(2), ..*settings };
    let bounding = bounding_media(scene);
    let leads_there = |target: &&Target| {
        let surface = &scene.surfaces()[target.surface as usize];
        let leads = |material: u32| {
            let material = &scene.materials()[material as usize].1;
            material.is_specular() || material.has_glossy() || material.media().is_some()
        };
        bounding[target.surface as usize] || surface.all_materials().any(leads)
    };
    let targets = scene.targets().iter().filter(leads_there).map(|target| Target { density: 1.0, ..*target });
    let goals = Goals::towards(scene, &targets.collect::<Vec<_>>());
    let sources = Sources::with_goals(scene, &goals, half.stored, true, budget);
    let mut traced =
        trace_from(scene, &half, (&sources, u64::MAX), wanted, Starts::AtMedia(&bounding), progress)?;
    // No more than give each of them the same power: where few get to media, they bring little light.
    let flux = sources.importance();
    let sources = Sources::new(scene, (half.kind, half.stored), true, budget);
    let most = (traced.emitted as f64 * sources.importance() / flux).ceil();
    let most = if most.is_finite() { most as u64 } else { u64::MAX };
    let most = most.clamp(half.stored, half.stored.saturating_mul(MOST_BY_SURFACES));
    let mut others =
        trace_from(scene, &half, (&sources, most), wanted, Starts::Elsewhere(&bounding), progress)?;
    let mut records = std::mem::take(&mut traced.media);
    let emitted = traced.emitted.max(1);
    let factor = emitted as f64 / others.emitted.max(1) as f64;
    records.append(std::mem::take(&mut others.media), factor as f32);
    maps.add_scattered(scene, &records, emitted);
    for (tally, other) in traced.tallies.iter_mut().zip(others.tallies) {
        *tally += other;
    }
    traced.emitted += others.emitted;
    traced.stopped |= others.stopped;
    Some(traced)
}

/// By surface, whether it bounds a medium that scatters.
fn bounding_media(scene: &Scene) -> Vec<bool> {
    let scatters = |id: MediumId| scene.medium(id).volume.is_some();
    let bounds_medium = |surface: &Surface| {
        surface.all_materials().any(|material| {
            scene.materials()[material as usize]
                .1
                .media()
                .is_some_and(|media| media.into_iter().any(scatters))
        })
    };
    scene.surfaces().iter().map(bounds_medium).collect()
}

/// [`trace_photons`] for the purpose `wanted`.
pub fn trace_photons_for(
    scene: &Scene,
    settings: &TraceSettings,
    wanted: PhotonsFor<'_>,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Option<TracedPhotons> {
    let sources = Sources::new(scene, (settings.kind, settings.stored), settings.aimed, wanted.budget);
    trace_from(scene, settings, (&sources, u64::MAX), wanted, Starts::Anywhere, progress)
}

/// [`trace_photons_for`] with a limited number of photons of these sources.
fn trace_from(
    scene: &Scene,
    settings: &TraceSettings,
    (sources, most): (&Sources<'_>, u64),
    wanted: PhotonsFor<'_>,
    starts: Starts<'_>,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Option<TracedPhotons> {
    let PhotonsFor { receivers, in_media, .. } = wanted;
    if settings.stored == 0 || sources.is_dark() {
        return Some(TracedPhotons {
            photons: Vec::new(),
            surfaces: Vec::new(),
            media: MediaRecords::default(),
            emitted: 0,
            tallies: vec![PhotonTally::default(); scene.lights().len()],
            stopped: false,
            reached: vec![false; scene.surfaces().len()],
            missing: Vec::new(),
            divided: sources.divided.clone(),
        });
    }
    let mut pass =
        Pass { scene, settings, sources, receivers, in_media, kept: Kept::First, starts, progress };
    let (mut prepass, mut per_stored) = pass.find_count()?;
    if prepass.is_dense() && !prepass.stopped {
        pass.kept = Kept::All;
        (prepass, per_stored) = pass.find_count()?;
    }
    if prepass.stopped || prepass.len() == 0 {
        return Some(prepass);
    }
    let most_per_stored = if in_media { MOST_EMITTED_IN_MEDIA } else { MOST_EMITTED_PER_STORED };
    let emitted = (settings.stored as f64 * per_stored.min(most_per_stored)).min(most as f64);
    let times = emitted.ceil() / prepass.emitted as f64;
    let (paths, points) = (prepass.media_paths(), &prepass.media.points);
    let thinning = if matches!(pass.kept, Kept::All) {
        Thinning::new(points, paths, times, settings.stored as f64)
    } else {
        None
    };
    if let Some(thinning) = &thinning {
        pass.kept = Kept::Thinned(thinning);
    }
    let stream = match (settings.kind, in_media) {
        (MapKind::Caustic, false) => Stream::CausticPhotons,
        (MapKind::Caustic, true) => Stream::VolumeBeams,
        (MapKind::Global, false) => Stream::GlobalPhotons,
        (MapKind::Global, true) => Stream::VolumePhotons,
    };
    drop(prepass);
    pass.run(stream, emitted.ceil() as u64, Some(CHUNK)).map(|(traced, _)| traced)
}

/// Caustics of one light.
#[derive(Clone, Debug)]
pub struct CausticSurvey {
    /// Its importance in the caustic map, which determines its number of photons.
    pub importance: f64,
    /// Photons that were stored; their powers can be compared with those of other lights.
    pub photons: Vec<Photon>,
}

/// The caustic photons of each light, where every light emits the same number, to find the lights that matter.
pub fn survey_caustics(scene: &Scene, emitted_by_each: u64, seed: u64) -> Vec<CausticSurvey> {
    /// Depth limit of the survey.
    const DEPTH: u32 = 64;
    let lights = scene.lights().len();
    let settings = TraceSettings {
        kind: MapKind::Caustic,
        stored: emitted_by_each * lights as u64,
        seed,
        max_depth: DEPTH,
        aimed: true,
        wavelengths: Wavelengths::default(),
    };
    let sources = Sources::new(scene, (settings.kind, settings.stored), settings.aimed, None);
    let shares = vec![emitted_by_each; lights];
    let reached = no_surfaces(scene, settings.kind);
    let batch = Batch {
        receivers: &[],
        scene,
        settings: &settings,
        sources: &sources,
        stream: Stream::Prepass,
        in_media: false,
        kept: Kept::First,
        tagged: false,
        starts: Starts::Anywhere,
        shares,
        reached: &reached,
    };
    let of_light = |light: usize| CausticSurvey {
        importance: sources.emitter(light).map_or(0.0, Emitter::importance),
        photons: batch.trace_range(light, 0, emitted_by_each, settings.stored, &mut |_| ()).photons,
    };
    (0..lights).into_par_iter().map(of_light).collect()
}

/// The rays of a photon pass that emits `emitted` photons, in the order in which one thread traces them: for benchmarks
/// of ray tracing with a realistic workload.
pub fn record_photon_rays(scene: &Scene, settings: &TraceSettings, emitted: u64) -> Vec<Ray> {
    let mut rays = Vec::new();
    trace_alone(scene, settings, emitted, &mut |ray| rays.push(*ray));
    rays
}

/// The same pass on one thread, without recording. Returns the photons and the number of rays that hit something.
pub fn trace_photons_alone(scene: &Scene, settings: &TraceSettings, emitted: u64) -> (Vec<Photon>, u64) {
    trace_alone(scene, settings, emitted, &mut |_| ())
}

fn trace_alone(
    scene: &Scene,
    settings: &TraceSettings,
    emitted: u64,
    observe: &mut impl FnMut(&Ray),
) -> (Vec<Photon>, u64) {
    let sources = Sources::new(scene, (settings.kind, emitted), settings.aimed, None);
    let shares = sources.shares(emitted);
    let reached = no_surfaces(scene, settings.kind);
    let batch = Batch {
        scene,
        settings,
        sources: &sources,
        receivers: &[],
        stream: Stream::Measure,
        in_media: false,
        kept: Kept::First,
        tagged: false,
        starts: Starts::Anywhere,
        shares,
        reached: &reached,
    };
    let (mut photons, mut rays) = (Vec::new(), 0);
    for (light, &share) in batch.shares.iter().enumerate() {
        let traced = batch.trace_range(light, 0, share, emitted, observe);
        rays += traced.tally.bounces;
        photons.extend(traced.photons);
    }
    (photons, rays)
}

/// Result of [`stream_photons`].
#[derive(Debug)]
pub struct StreamedPhotons {
    /// Photons emitted by all lights together, by which powers are divided.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// By light.
    pub tallies: Vec<PhotonTally>,
}

/// What takes photons with the surface of each.
pub type TakePhotons<'a, E> = dyn FnMut(&[Photon], &[u32]) -> Result<(), E> + 'a;

/// Tasks whose photons are in memory at a time, for each thread.
const WINDOW: usize = 32;

/// Traces photons for the global map as [`trace_photons_for`] does, and hands them to `take` in batches, in order, with the surface of each:
/// memory does not grow with their number. The photons are the same for any number of threads.
///
/// `progress` is as for [`trace_photons`]; once it returns `false`, the result is `None`, as part of a map is of no use here.
///
/// # Errors
/// The first error of `take`, after which nothing more is traced.
pub fn stream_photons<E>(
    scene: &Scene,
    settings: &TraceSettings,
    take: &mut TakePhotons<'_, E>,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Result<Option<StreamedPhotons>, E> {
    let sources = Sources::new(scene, (settings.kind, settings.stored), settings.aimed, None);
    let lights = scene.lights().len();
    let mut result = StreamedPhotons { emitted: 0, stored: 0, tallies: vec![PhotonTally::default(); lights] };
    if settings.stored == 0 || sources.is_dark() {
        return Ok(Some(result));
    }
    let (starts, in_media, receivers) = (Starts::Anywhere, false, &[][..]);
    let kept = Kept::First;
    let pass = Pass { scene, settings, sources: &sources, receivers, in_media, kept, starts, progress };
    let Some((prepass, per_stored)) = pass.find_count() else { return Ok(None) };
    if prepass.stopped {
        return Ok(None);
    }
    if prepass.len() == 0 {
        result.emitted = prepass.emitted;
        result.tallies = prepass.tallies;
        return Ok(Some(result));
    }
    drop(prepass);
    let emitted = (settings.stored as f64 * per_stored.min(MOST_EMITTED_PER_STORED)).ceil() as u64;
    let shares = sources.shares(emitted);
    result.emitted = shares.iter().sum();
    let emitted = result.emitted;
    let reached = no_surfaces(scene, settings.kind);
    let stream = Stream::GlobalPhotons;
    let sources = &sources;
    let batch = Batch {
        scene,
        settings,
        sources,
        receivers,
        stream,
        in_media,
        kept,
        tagged: true,
        starts,
        shares,
        reached: &reached,
    };
    let size = CHUNK as usize;
    let tasks = batch.shares.iter().enumerate().flat_map(|(light, &share)| {
        (0..share).step_by(size).map(move |first| (light, first, share.min(first + CHUNK)))
    });
    let mut tasks = tasks.peekable();
    let (window, mut done) = (WINDOW * rayon::current_num_threads(), 0);
    while tasks.peek().is_some() {
        let part: Vec<(usize, u64, u64)> = tasks.by_ref().take(window).collect();
        let traced: Vec<Traced> = part
            .par_iter()
            .map(|&(light, first, end)| batch.trace_range(light, first, end, emitted, &mut |_| ()))
            .collect();
        for (&(light, first, end), traced) in part.iter().zip(traced) {
            done += end - first;
            result.stored += traced.photons.len() as u64;
            result.tallies[light] += traced.tally;
            take(&traced.photons, &traced.surfaces)?;
        }
        if !progress(done, emitted) {
            return Ok(None);
        }
    }
    Ok(Some(result))
}

/// A range of photons of one light, by number.
#[derive(Clone, Copy)]
struct Task {
    light: usize,
    first: u64,
    end: u64,
    /// Position within the light's photons, so that all lights advance at the same rate.
    progress: f64,
}

struct Pass<'a> {
    scene: &'a Scene,
    settings: &'a TraceSettings,
    sources: &'a Sources<'a>,
    receivers: &'a [u32],
    in_media: bool,
    kept: Kept<'a>,
    starts: Starts<'a>,
    progress: &'a (dyn Fn(u64, u64) -> bool + Sync),
}

impl Pass<'_> {
    /// Runs short passes; returns the last one and the number of photons to emit for each that is to be stored; where all photons that
    /// media scatter are stored, such that there are about [`STORED_OF_PATH`] of each path, or all if they are fewer.
    fn find_count(&self) -> Option<(TracedPhotons, f64)> {
        let mut emitted = FIRST_PREPASS;
        // Number of emitted photons after which the search ends if none was stored: at least the number requested, and
        // enough to be sure.
        let futile = self.settings.stored.max((SURE * MOST_EMITTED_PER_STORED) as u64);
        loop {
            let quiet = Pass { progress: &|_, _| (self.progress)(0, 1), ..*self };
            let (prepass, counts) = quiet.run(Stream::Prepass, emitted, None)?;
            let stored = match self.kept {
                Kept::All => (prepass.len() as f64).min(STORED_OF_PATH * prepass.media_paths() as f64),
                Kept::First | Kept::Thinned(_) => prepass.len() as f64,
            };
            let per_stored = prepass.emitted as f64 / stored;
            let enough = if prepass.len() == 0 {
                emitted >= futile
            } else {
                relative_error(&counts) <= CERTAIN
                    || stored >= (LARGEST_SHARE * self.settings.stored as f64).max(FEW as f64)
                    || emitted as f64 >= self.settings.stored as f64 * MOST_EMITTED_PER_STORED
            };
            if enough || prepass.stopped {
                return Some((prepass, per_stored));
            }
            let longest = if prepass.len() == 0 { futile } else { u64::MAX };
            emitted = emitted.saturating_mul(GROWTH).min(longest);
        }
    }

    /// Emits photons in tasks of `chunk`, or in [`REPLICAS`] tasks for each light. Returns the photons, and the number
    /// of photons stored by the tasks of the same number within their lights. `None` where it was stopped before any
    /// task was done.
    fn run(&self, stream: Stream, emitted: u64, chunk: Option<u64>) -> Option<(TracedPhotons, Vec<u64>)> {
        let shares = self.sources.shares(emitted);
        let emitted: u64 = shares.iter().sum();
        let Self { scene, settings, sources, receivers, in_media, kept, starts, .. } = *self;
        let reached = no_surfaces(scene, settings.kind);
        let batch = Batch {
            scene,
            settings,
            sources,
            receivers,
            stream,
            in_media,
            kept,
            tagged: false,
            starts,
            shares,
            reached: &reached,
        };
        let mut tasks = Vec::new();
        for (light, &share) in batch.shares.iter().enumerate() {
            let size = chunk.unwrap_or(share.div_ceil(REPLICAS)).max(1);
            tasks.extend((0..share).step_by(size as usize).map(|first| Task {
                light,
                first,
                end: share.min(first + size),
                progress: first as f64 / share as f64,
            }));
        }
        tasks.sort_by(|a, b| a.progress.total_cmp(&b.progress));
        let (done, stop) = (AtomicU64::new(0), AtomicBool::new(false));
        // Tasks start in order, so that the finished tasks at a stop are (nearly) all those before some task.
        let mut results: Vec<(usize, Traced)> = tasks
            .iter()
            .enumerate()
            .par_bridge()
            .filter_map(|(number, task)| {
                // The first task always runs, however late its thread starts it: without it there would be no result.
                if number > 0 && stop.load(Ordering::Relaxed) {
                    return None;
                }
                let traced = batch.trace_range(task.light, task.first, task.end, emitted, &mut |_| ());
                let count = task.end - task.first;
                let traced_so_far = done.fetch_add(count, Ordering::Relaxed) + count;
                if !(self.progress)(traced_so_far, emitted) {
                    stop.store(true, Ordering::Relaxed);
                }
                Some((number, traced))
            })
            .collect();
        results.sort_unstable_by_key(|(number, _)| *number);
        let whole = results.iter().enumerate().take_while(|(i, (number, _))| i == number).count();
        results.truncate(whole);
        if results.is_empty() {
            return None;
        }
        Some(self.gather(&batch, emitted, &tasks, results))
    }

    /// Combines the results of the first tasks.
    fn gather(
        &self,
        batch: &Batch<'_>,
        emitted: u64,
        tasks: &[Task],
        results: Vec<(usize, Traced)>,
    ) -> (TracedPhotons, Vec<u64>) {
        let lights = batch.shares.len();
        let stopped = results.len() < tasks.len();
        let mut traced = TracedPhotons {
            photons: Vec::with_capacity(results.iter().map(|(_, part)| part.photons.len()).sum()),
            surfaces: Vec::new(),
            media: MediaRecords::default(),
            emitted,
            tallies: vec![PhotonTally::default(); lights],
            stopped,
            reached: Vec::new(),
            missing: Vec::new(),
            divided: self.sources.divided.clone(),
        };
        let mut emitted_by = vec![0u64; lights];
        for (number, _) in &results {
            let task = &tasks[*number];
            emitted_by[task.light] += task.end - task.first;
        }
        if stopped {
            traced.emitted = emitted_by.iter().sum();
            traced.missing = (0..lights)
                .filter(|&light| batch.shares[light] > 0 && emitted_by[light] == 0)
                .map(|light| light as LightId)
                .collect();
        }
        // The power of a photon is its light's flux times all photons over the photons of the light. The factor is one
        // for a light of which the same share is done as of all lights.
        let factor = |light: usize| {
            let planned = emitted as f64 / batch.shares[light] as f64;
            traced.emitted as f64 / emitted_by[light] as f64 / planned
        };
        let factors: Vec<f64> = (0..lights)
            .map(|light| if stopped && emitted_by[light] > 0 { factor(light) } else { 1.0 })
            .collect();
        let mut counts = vec![0u64; tasks.len()];
        let mut ordinal = vec![0usize; lights];
        for (number, part) in results {
            let light = tasks[number].light;
            counts[ordinal[light]] += part.len() as u64;
            ordinal[light] += 1;
            traced.surfaces.extend(part.surfaces);
            traced.media.append(part.media, factors[light] as f32);
            let mut tally = part.tally;
            if factors[light] == 1.0 {
                traced.photons.extend(part.photons);
            } else {
                tally *= factors[light];
                let mut rng = Rng::new(self.settings.seed, Stream::Prepass, number as u64);
                let scaled = |photon: Photon| photon.scaled(factors[light] as f32, rng.next_f32());
                traced.photons.extend(part.photons.into_iter().map(scaled));
            }
            traced.tallies[light] += tally;
        }
        counts.truncate(ordinal.into_iter().max().unwrap_or(0));
        if self.settings.kind == MapKind::Caustic {
            let surfaces = 0..self.scene.surfaces().len();
            traced.reached = surfaces.map(|surface| batch.has_reached(surface as u32)).collect();
        }
        (traced, counts)
    }
}

/// One bit for each surface that photons may reach; none where the map does not need them.
fn no_surfaces(scene: &Scene, kind: MapKind) -> Vec<AtomicU64> {
    let count = if kind == MapKind::Caustic { scene.surfaces().len().div_ceil(64) } else { 0 };
    std::iter::repeat_with(AtomicU64::default).take(count).collect()
}

/// Relative standard error of the mean of `counts`; infinite where it is not known.
fn relative_error(counts: &[u64]) -> f64 {
    let n = counts.len() as f64;
    let mean = counts.iter().sum::<u64>() as f64 / n;
    let variance = counts.iter().map(|&count| (count as f64 - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if n > 3.0 && mean > 0.0 { (variance / n).sqrt() / mean } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_counts() {
        assert_eq!(relative_error(&[]), f64::INFINITY);
        assert_eq!(relative_error(&[5, 5]), f64::INFINITY);
        assert_eq!(relative_error(&[0; 16]), f64::INFINITY);
        assert_eq!(relative_error(&[7; 16]), 0.0);
        // Deviation 1 each: 16/15 as variance, a quarter of its root as error.
        let counts: Vec<u64> = (0..16).map(|i| 9 + 2 * (i % 2)).collect();
        assert!((relative_error(&counts) - (16.0f64 / 15.0).sqrt() / 40.0).abs() < 1e-12);
    }
}
