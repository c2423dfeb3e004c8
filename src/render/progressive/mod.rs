//! Progressive photon mapping: independent rounds of photon maps and pictures, each with less bias than the round before (Knaus &
//! Zwicker, "Progressive Photon Mapping: A Probabilistic Approach", ACM Transactions on Graphics 30(3), 2011). The picture is the mean
//! of all rounds; its error falls with the number of rounds.
//!
//! `docs/progressive.md` describes the sources of bias and how each vanishes.

mod checkpoint;
mod error;
mod fold;
mod law;
mod merge;
mod part;

pub use checkpoint::{Checkpoint, CheckpointError, blank_checkpoint_bytes, parse_checkpoint_bytes};
pub use error::{ErrorEstimate, error_of_halves};
pub use fold::{BLOCK, blocks_of};
pub use merge::{MergeError, Merged, merge_parts, rounds_needed};
pub use part::{
    PartError, PartHeader, PartOutcome, PartRange, blank_part_bytes, is_part_of, parse_part_bytes,
    render_part,
};

use super::glints::{GlintSearch, Glints, find_glints};
use super::maps::{ForPicture, PassOne, build_maps_from, photon_budget};
use super::pace::Pace;
use super::pixels::{
    PassTwo, PassTwoReport, RenderError, RenderRequest, Rendered, Stop, check_media, statistics,
};
use super::settings::Settings;
use super::stats::Statistics;
use crate::camera::Camera;
use crate::film::{Film, FilmError, HalvedSum, LayerSet, Precision};
use crate::integrators::{Narrowing, PhotonBudget, PhotonMapSettings};
use crate::observer::Observer;
use crate::scene::{IntegratorKind, RenderPlan, Scene};
use checkpoint::{Header, Identity};
use fold::Fold;
use law::Areas;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Statistics of rounds, in `--stats` and in the picture's metadata.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct RoundStatistics {
    /// Number of rounds that the picture is the mean of. The same number as `--rounds`, with the same settings, gives the same picture.
    pub done: u64,
    /// Rounds of an earlier render that this render resumed.
    pub resumed: u64,
    /// Photons emitted in all rounds, for all maps.
    pub photons_emitted: u64,
    /// Photons stored in all rounds, in all maps.
    pub photons_stored: u64,
    /// Disc area of caustic estimates in the last round over that in the first round.
    pub area: f64,
    /// Seconds that all rounds took.
    pub seconds: f64,
    /// Estimated error of the picture; `None` after a single round.
    pub error: Option<ErrorEstimate>,
    /// The requested target error.
    pub target_error: Option<f64>,
    /// Samples and photons of each round, where they were reduced to fit a time limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<RoundSize>,
    /// Error estimates after fewer rounds, at the powers of two.
    pub history: Vec<ErrorEstimate>,
}

/// Samples and photons of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct RoundSize {
    /// Camera samples per pixel.
    pub spp: u32,
    /// Photons in the global map.
    pub global_photons: u64,
    /// Photons in the caustic map.
    pub caustic_photons: u64,
}

/// The checkpoint to resume from, and the checkpoint to write.
#[derive(Clone, Debug, Default)]
pub struct Rounds {
    /// Names and values that must match, in addition to the request, for a render to be resumed (the scene, the versions of libraries).
    pub identity: Vec<(String, String)>,
    /// The checkpoint to resume from.
    pub resume: Option<PathBuf>,
    /// The checkpoint to write: at the end, and at intervals before.
    pub checkpoint: Option<PathBuf>,
}

impl Rounds {
    /// Starts with the first round and writes no checkpoint.
    pub fn keeping_nothing() -> Self {
        Self::default()
    }

    fn identity_of(&self, request: &RenderRequest) -> Identity {
        let RenderRequest { width, height, crop, filter, layers, ref settings } = *request;
        let mut identity = Identity::new();
        // A resumed render may have more rounds or another target error.
        let settings = Settings { rounds: None, target_error: None, ..settings.clone() };
        if let Ok(Value::Object(settings)) = serde_json::to_value(settings) {
            identity.extend(settings.into_iter().map(|(name, value)| (name.replace('_', "-"), value)));
        }
        let mut add = |name: &str, value: String| identity.insert(name.to_owned(), value.into());
        add("size", format!("{width}x{height}"));
        add("window", crop.map_or("the whole".into(), |c| format!("{},{},{},{}", c.x0, c.y0, c.x1, c.y1)));
        add("filter", format!("{filter:?}"));
        add("layers", format!("{layers:?}"));
        for (name, value) in &self.identity {
            add(name, value.clone());
        }
        identity
    }
}

/// Fewest rounds after which the error estimate is used.
const FEWEST_ROUNDS: u64 = 4;

/// Time between two checkpoints; writing one takes far less.
const KEPT_EVERY: Duration = Duration::from_secs(30);

/// Renders progressively, up to [`Settings::rounds`] or until the estimated error reaches [`Settings::target_error`]. The render ends
/// before a round that would exceed the observer's deadline, and drops the current round where the observer asks to stop. The first
/// round is always finished unless the observer cancels.
///
/// # Errors
/// If the request is not valid or a checkpoint cannot be read. A checkpoint that cannot be written is reported in
/// [`Rendered::checkpoint_failure`].
pub fn render_in_rounds(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    observer: &dyn Observer,
    rounds: Rounds,
) -> Result<Rendered, RenderError> {
    let request = &with_bias(scene, request)?;
    let settings = &request.settings;
    let plan = &settings.plan(scene);
    let mut state = start(request, &rounds, Fold::Sum(None), rounds.identity_of(request))?;
    state.header.statistics.target_error = settings.target_error;
    // A resumed render keeps its round size.
    let deadline = observer.deadline().filter(|_| state.header.statistics.done == 0);
    let mut job = Job::new(scene, camera, request, plan, [observer; 2]);
    if let Some(deadline) = deadline {
        let budget = job.budget.as_ref();
        let paced = Pace { scene, camera, request, plan, finest: &[], budget, deadline, observer }
            .fit(&Settings { illumination_maps: false, ..settings.clone() })?;
        let size = |settings: &Settings| RoundSize {
            spp: settings.spp,
            global_photons: settings.global_photons,
            caustic_photons: settings.caustic_photons,
        };
        let fitted = size(&paced.settings);
        state.header.statistics.fitted = (fitted != size(settings)).then_some(fitted);
        job.warnings.extend(paced.warnings);
    }
    let fitted = state.header.statistics.fitted.map(|size| {
        let RoundSize { spp, global_photons, caustic_photons } = size;
        let settings =
            Settings { spp, global_photons, caustic_photons, photons_memory: None, ..settings.clone() };
        RenderRequest { settings, ..request.clone() }
    });
    job.request = fitted.as_ref().unwrap_or(request);
    let mut run = Run::new(job, state, 0, Precision::Rounded);
    run.all(&rounds, settings.rounds.unwrap_or(u64::MAX))?;
    run.finish()
}

/// The request with the layer of the estimated bias, if rounds can render it.
fn with_bias(scene: &Scene, request: &RenderRequest) -> Result<RenderRequest, RenderError> {
    let settings = &request.settings;
    if settings.integrator != IntegratorKind::Progressive {
        return Err(CheckpointError::NoRounds.into());
    }
    if settings.spp == 0 {
        return Err(RenderError::NoSamples);
    }
    check_media(scene, settings)?;
    Ok(RenderRequest { layers: LayerSet { bias: true, ..request.layers }, ..request.clone() })
}

/// The state of the checkpoint to resume from, or that before the first round.
fn start(
    request: &RenderRequest,
    rounds: &Rounds,
    fold: Fold,
    identity: Identity,
) -> Result<Checkpoint, RenderError> {
    let film = || Film::new(request.width, request.height, request.crop, request.layers);
    let empty = [film()?, film()?];
    let mut state = match &rounds.resume {
        Some(path) => Checkpoint::read(path, &identity, empty)?,
        None => Checkpoint::new(identity, fold, empty),
    };
    state.header.statistics.resumed = state.header.statistics.done;
    Ok(state)
}

struct Job<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    request: &'a RenderRequest,
    plan: &'a RenderPlan,
    glints: Option<Glints<'a>>,
    /// Warnings of the steps before the rounds.
    warnings: Vec<String>,
    /// Allocation of photons to lights in all rounds.
    budget: Option<PhotonBudget>,
    observer: &'a dyn Observer,
}

impl<'a> Job<'a> {
    /// The observers are that of the rounds, and that of the search for glints before them.
    fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        request: &'a RenderRequest,
        plan: &'a RenderPlan,
        [observer, of_search]: [&'a dyn Observer; 2],
    ) -> Self {
        let mut warnings = Vec::new();
        let glints = match find_glints(scene, camera, request, plan, of_search) {
            GlintSearch::Done(glints) => Some(*glints),
            GlintSearch::Unplanned => None,
            GlintSearch::Late => {
                warnings.push(GlintSearch::LATE.to_owned());
                None
            }
        };
        let budget = photon_budget(scene, camera, plan, &request.settings);
        Self { scene, camera, request, plan, glints, warnings, budget, observer }
    }

    fn film(&self) -> Result<Film, FilmError> {
        let RenderRequest { width, height, crop, layers, .. } = *self.request;
        Film::new(width, height, crop, layers)
    }

    /// Lookup parameters for a round whose disc area is this share of the first round's.
    fn reading(&self, area: f64) -> PhotonMapSettings {
        let settings = &self.request.settings;
        let reading = settings.photon_map_settings(self.scene);
        let (narrowing, caustic_nearest) = Narrowing::by_area(area, settings.caustic_nearest);
        PhotonMapSettings {
            caustic_nearest,
            narrowing: Some(narrowing),
            approximate_weight: settings.approximate_weight * area as f32,
            ..reading
        }
    }

    /// Renders one round. Returns `None` where it was stopped.
    fn round(
        &self,
        round: u64,
        area: f64,
        is_first: bool,
    ) -> Result<Option<(Film, PassOne, PassTwoReport)>, RenderError> {
        let asked = &self.request.settings;
        // The fixed bins of illumination maps would keep their bias. Adaptive sample counts that change from round to round would not
        // keep the numbering of samples.
        let settings = Settings {
            seed: law::photon_seed(asked.seed, round),
            illumination_maps: false,
            adaptive: false,
            ..asked.clone()
        };
        let observer = RoundObserver { inner: self.observer, is_first };
        let for_picture = ForPicture { budget: self.budget.as_ref(), ..ForPicture::default() };
        let pass_one = build_maps_from(self.scene, self.plan, &settings, for_picture, &observer)?;
        if pass_one.cancelled {
            return Ok(None);
        }
        let mut film = self.film()?;
        let pass_two = PassTwo {
            scene: self.scene,
            camera: self.camera,
            request: self.request,
            settings: &settings,
            plan: self.plan,
            maps: &pass_one.maps,
            reading: self.reading(area),
            glints: self.glints.as_ref(),
            samples: law::camera_samples(asked.seed, round, asked.spp),
            seconds_sample: Duration::ZERO,
            observer: &observer,
        };
        let report = pass_two.run(&mut film)?.filter(|report| report.finished);
        Ok(report.map(|report| (film, pass_one, report)))
    }
}

/// Observer of one round. It reports no progress of its own and has no deadline, so no part of a round is left out for lack of time.
struct RoundObserver<'a> {
    inner: &'a dyn Observer,
    is_first: bool,
}

impl Observer for RoundObserver<'_> {
    fn begin(&self, _step: &str, _total: u64) {}

    fn advance(&self, _done: u64) {}

    fn should_stop(&self) -> bool {
        // A part of the first round is no picture, so only a cancellation stops it.
        if self.is_first { self.inner.is_cancelled() } else { self.inner.should_stop() }
    }
}

struct Run<'a> {
    job: Job<'a>,
    state: Checkpoint,
    /// Number of the first round.
    first: u64,
    /// Precision of blocks that are followed by others, or are those of a part.
    precision: Precision,
    areas: Areas,
    /// Statistics of the rounds of this run.
    total: Option<Statistics>,
    stopped: bool,
    /// Time when the checkpoint was last written.
    kept: Instant,
    /// Time that writing it took.
    writing: Duration,
    /// Why the checkpoint could not be written, where it failed.
    failure: Option<CheckpointError>,
}

impl<'a> Run<'a> {
    fn new(job: Job<'a>, state: Checkpoint, first: u64, precision: Precision) -> Self {
        let (areas, kept) = (Areas::new(), Instant::now());
        Self {
            job,
            state,
            first,
            precision,
            areas,
            total: None,
            stopped: false,
            kept,
            writing: Duration::ZERO,
            failure: None,
        }
    }

    /// Renders up to `wanted` rounds from the first on, and writes checkpoints.
    fn all(&mut self, rounds: &Rounds, wanted: u64) -> Result<(), RenderError> {
        let start = Instant::now();
        self.announce(wanted);
        while self.state.header.statistics.done < wanted && !self.has_reached() {
            let done = self.state.header.statistics.done;
            let in_this_run = done - self.state.header.statistics.resumed;
            // A run of a part ends with more than it began with, however short its time is.
            let is_first = if self.is_part() { in_this_run == 0 } else { done == 0 };
            let should_stop = match is_first {
                true => self.is_part() && self.job.observer.is_cancelled(),
                false => self.job.observer.should_stop() || self.is_too_late(start, in_this_run),
            };
            if should_stop {
                self.stopped = true;
                break;
            }
            let begun = Instant::now();
            let round = self.first + done;
            let area = self.areas.at(round);
            let Some((film, pass_one, report)) = self.job.round(round, area, is_first)? else {
                self.stopped = true;
                break;
            };
            if done > 0 && done.is_multiple_of(BLOCK) {
                self.close()?;
            }
            self.state.halves[(round % 2) as usize].add(&film)?;
            self.count(pass_one, report);
            let statistics = &mut self.state.header.statistics;
            (statistics.done, statistics.area) = (done + 1, area);
            statistics.seconds += begun.elapsed().as_secs_f64();
            self.evaluate(wanted);
            // Writing takes a twentieth of the time at most.
            if self.kept.elapsed() >= KEPT_EVERY.max(20 * self.writing) && done + 1 < wanted {
                self.keep(rounds);
            }
        }
        let is_whole = self.state.header.statistics.done >= wanted;
        if self.state.header.statistics.done > 0 && !(self.is_part() && is_whole) {
            self.keep(rounds);
        }
        Ok(())
    }

    fn is_part(&self) -> bool {
        matches!(self.state.fold, Fold::Blocks(_))
    }

    /// Ends the present block, as another round follows or a part is complete.
    fn close(&mut self) -> Result<(), FilmError> {
        let halves = std::mem::replace(&mut self.state.halves, [self.job.film()?, self.job.film()?]);
        self.state.fold.add(halves, self.precision)
    }

    /// Precision of the present block, if no other follows.
    fn precision_so_far(&self) -> Precision {
        if self.state.fold.sum().is_some() { Precision::Rounded } else { Precision::Exact }
    }

    /// Estimated error of all rounds so far.
    fn error(&self) -> Option<ErrorEstimate> {
        let (sum, precision) = (self.state.fold.sum(), self.precision_so_far());
        let done = self.state.header.statistics.done;
        let means = || HalvedSum::means_with(sum, &self.state.halves, precision);
        error_of_halves(means, [done.div_ceil(2), done / 2])
    }

    /// Writes a checkpoint of the rounds so far, where one is requested. A failed write does not end the render: the disk may have room
    /// later.
    fn keep(&mut self, rounds: &Rounds) {
        if let Some(path) = &rounds.checkpoint {
            let begun = Instant::now();
            self.failure = self.state.write(path).err();
            self.kept = Instant::now();
            self.writing = begun.elapsed();
        }
    }

    /// Whether a round of mean length would end after the deadline.
    fn is_too_late(&self, start: Instant, rounds: u64) -> bool {
        let Some(deadline) = self.job.observer.deadline() else { return false };
        let mean = start.elapsed().as_secs_f64() / rounds.max(1) as f64;
        let mean = if rounds == 0 { Duration::ZERO } else { Duration::from_secs_f64(mean) };
        Instant::now().checked_add(mean).is_none_or(|end| end > deadline)
    }

    fn has_reached(&self) -> bool {
        let RoundStatistics { done, error, target_error, .. } = &self.state.header.statistics;
        // Equal halves give the most certain estimates.
        let is_known = *done >= FEWEST_ROUNDS && done.is_multiple_of(2);
        matches!((error, target_error), (Some(error), &Some(target)) if is_known && error.error <= target)
    }

    fn evaluate(&mut self, wanted: u64) {
        let done = self.state.header.statistics.done;
        let statistics = &self.state.header.statistics;
        if self.is_part() {
            // One part does not tell the error of the picture.
        } else if done.is_power_of_two()
            || done == wanted
            || statistics.target_error.is_some() && done.is_multiple_of(2)
        {
            self.state.header.statistics.error = self.error();
        }
        if done.is_power_of_two() && !self.is_part() {
            let statistics = &mut self.state.header.statistics;
            statistics.history.extend(statistics.error);
            self.announce(wanted);
        }
        let shown = if wanted == u64::MAX { done.next_power_of_two() } else { wanted };
        self.job.observer.advance(done.min(shown));
    }

    fn announce(&self, wanted: u64) {
        let RoundStatistics { done, error, .. } = &self.state.header.statistics;
        let shown = if wanted == u64::MAX { (done + 1).next_power_of_two() } else { wanted };
        let step = match error {
            Some(error) => format!("rounds, error {:.2} %", 100.0 * error.error),
            None => "rounds".to_owned(),
        };
        self.job.observer.begin(&step, shown);
        self.job.observer.advance((*done).min(shown));
    }

    fn count(&mut self, pass_one: PassOne, report: PassTwoReport) {
        let Header { statistics: rounds, counters, .. } = &mut self.state.header;
        for map in &pass_one.statistics {
            rounds.photons_emitted += map.emitted;
            rounds.photons_stored += map.photons;
        }
        *counters += report.counters;
        let settings = &self.job.request.settings;
        let this = statistics(self.job.scene, settings, self.job.plan.clone(), pass_one);
        match &mut self.total {
            None => self.total = Some(this),
            Some(total) => total.follow(this),
        }
        if let Some(total) = &mut self.total {
            total.take(report);
        }
    }

    fn finish(self) -> Result<Rendered, RenderError> {
        let error = self.error();
        let precision = self.precision_so_far();
        let Self { job, state, total, stopped, failure, .. } = self;
        let Checkpoint { header, mut fold, halves } = state;
        let done = header.statistics.done;
        let settings = &job.request.settings;
        let mut numbers =
            total.unwrap_or_else(|| statistics(job.scene, settings, job.plan.clone(), PassOne::default()));
        let mut rounds = header.statistics;
        rounds.error = error;
        fold.add(halves, precision)?;
        let film = match fold {
            Fold::Sum(Some(sum)) => sum.into_film(),
            Fold::Sum(None) | Fold::Blocks(_) => job.film()?,
        };
        numbers.counters = header.counters;
        numbers.complete(&film, job.scene);
        numbers.warnings.extend(job.warnings);
        warn(&mut numbers, &rounds, settings, job.scene.has_illumination_maps());
        numbers.rounds = Some(rounds);
        let stopped = match (stopped, done) {
            (false, _) => None,
            (true, 0) => Some(Stop::BeforePixels),
            (true, _) => Some(Stop::DuringPixels),
        };
        Ok(Rendered { film, statistics: numbers, stopped, checkpoint_failure: failure })
    }
}

impl Statistics {
    /// Adds a later round: sums times and counts of shadow photons, and keeps the map statistics of the last round.
    fn follow(&mut self, later: Self) {
        self.times.photons += later.times.photons;
        self.seconds_shadows += later.seconds_shadows;
        for (light, added) in self.shadows.iter_mut().zip(&later.shadows) {
            light.rays += added.rays;
            light.missed += added.missed;
            light.crossings += added.crossings;
            light.merged += added.merged;
            light.dropped += added.dropped;
        }
        (self.maps, self.media, self.irradiance_bytes, self.guide_bytes) =
            (later.maps, later.media, later.irradiance_bytes, later.guide_bytes);
        // A warning that differs from a known one only in its numbers is not repeated.
        let words = |text: &str| text.chars().filter(|c| !c.is_ascii_digit()).collect::<String>();
        for warning in later.warnings {
            if !self.warnings.iter().any(|known| words(known) == words(&warning)) {
                self.warnings.push(warning);
            }
        }
    }
}

fn warn(
    numbers: &mut Statistics,
    rounds: &RoundStatistics,
    settings: &Settings,
    has_illumination_maps: bool,
) {
    let mut warnings = Vec::new();
    if let (Some(target), Some(error)) = (rounds.target_error, &rounds.error)
        && error.error > target
    {
        warnings.push(format!(
            "the error is estimated at {:.4} after {} rounds, and not down to {target}",
            error.error, rounds.done
        ));
    }
    if numbers.plan.irradiance_cache.build {
        warnings.push(
            "the irradiance cache keeps its error however many rounds there are; leave it out for pictures that converge"
                .to_owned(),
        );
    }
    if numbers.plan.shadow_photons.build {
        warnings.push(
            "decisions by shadow photons keep their error however many rounds there are; leave them out for pictures that \
             converge"
                .to_owned(),
        );
    }
    if settings.adaptive {
        warnings
            .push("rounds take as many samples of every pixel: --adaptive has no effect in them".to_owned());
    }
    if settings.illumination_maps && has_illumination_maps {
        warnings.push(
            "illumination maps keep the size of their bins however many rounds there are: rounds read photon maps in their \
             place"
                .to_owned(),
        );
    }
    if settings.estimator == crate::photons::Estimator::AsPrinted {
        warnings.push(
            "the bias of formulas as printed grows as rounds narrow; choose the corrected estimator for pictures that \
             converge"
                .to_owned(),
        );
    }
    numbers.warnings.extend(warnings);
}
