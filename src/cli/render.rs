//! `cardioid render`: from a scene file to pictures.

use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, crop, filter_of, load};
use super::pictures::{About, Exposure, Figures, LooksArgs, Pictures};
use super::progress::{Console, ProgressKind, catch_interrupts, end_with_input, interrupted};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, bail};
use cardioid::film::{Developed, LayerSet, PixelRect};
use cardioid::image_io;
use cardioid::render::{
    IntegratorKind, Observer, ProcessStatistics, RenderRequest, Rendered, RoundStatistics, Rounds, SavedMaps,
    Settings, Statistics, Stop, open_irradiance_atlas, render_in_rounds, render_with_atlas, render_with_maps,
};
use cardioid::scene_file::photon_content_hash;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::process::ExitCode;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Render a scene to an EXR with all parts of the light, and a PNG
#[derive(Args, Clone, Debug)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,

    /// Picture to write: .exr (a .png is written beside it) or .png alone. Default: the scene's name in this folder.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Replace files under names that this program chose (without -o, and the PNG beside an EXR) whoever wrote them; otherwise only
    /// those that cardioid wrote are replaced. Files that the scene is read from never are.
    #[arg(long)]
    overwrite: bool,

    /// Only this window of the picture; the pixels in it do not change.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop)]
    crop: Option<PixelRect>,

    /// Stop after this time, for example 30s, 5m or 1h, and write what is there.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    time_limit: Option<Duration>,

    /// Write a picture only if it is whole: a render that is stopped writes none, and ends with exit code 75. For windows that are tasks.
    #[arg(long)]
    whole: bool,

    /// Keep the rounds of `--integrator progressive` in this file, every half minute and at the end, to go on with them.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,

    /// Go on with the rounds that --checkpoint kept: the same picture as if they had never stopped.
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,

    #[command(flatten)]
    looks: LooksArgs,

    /// Photons from a file that `cardioid photons` wrote, instead of traced ones: the same picture, sooner.
    ///
    /// Scene and photon settings must be those of the file; the camera, the picture and how maps are read may differ.
    #[arg(long, value_name = "FILE")]
    photon_map: Option<PathBuf>,

    /// Irradiance atlas that `cardioid bricks` built, read by gather rays in place of a photon map in memory: as much light as the disk holds.
    ///
    /// The scene must be that of the atlas; camera, picture and caustic photons are those of this render.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["photon_map", "checkpoint", "resume"])]
    atlas: Option<PathBuf>,

    /// With --atlas, memory for its bricks; 0 for none. The picture does not depend on it.
    #[arg(long, value_name = "BYTES", default_value = "100MB", value_parser = brick_cache, requires = "atlas")]
    brick_cache: u64,

    #[command(flatten)]
    layers: LayersArgs,

    /// Write statistics as JSON; `-` for standard output.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,

    /// Print statistics as a table: time and memory by step, rays by kind, photons by map and light, warnings.
    #[arg(long)]
    stats_table: bool,

    /// No progress bars and no summary.
    #[arg(short, long)]
    pub(super) quiet: bool,

    /// How progress is shown.
    #[arg(long, value_name = "KIND", value_enum, default_value_t = ProgressKind::Bar)]
    progress: ProgressKind,

    /// End at once where standard input ends: as `tradeoff` holds its other end, no render outlives it.
    #[arg(long, hide = true)]
    end_with_input: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

impl RenderArgs {
    /// Shows progress as asked for. `limit` is the time from now until rendering stops.
    pub(super) fn console(&self, limit: Option<Duration>) -> Result<Console> {
        let prints = self.stats_table || self.stats.as_deref().is_some_and(image_io::is_standard_output);
        if self.progress == ProgressKind::Json && prints {
            bail!(
                "--progress json and the statistics would both go to standard output; write --stats to a file"
            );
        }
        Ok(Console::new(self.quiet, limit).showing(self.progress))
    }

    /// The files to write. None of them may be one that is read, or another that is written.
    pub(super) fn outputs(&self) -> Result<(Pictures, Outputs)> {
        let pictures = Pictures::new(self.output.as_deref(), &self.scene.scene)?;
        let read = [Some(self.scene.scene.as_path()), self.photon_map.as_deref()];
        let mut outputs = Outputs::new(read.into_iter().flatten()).overwriting(self.overwrite);
        // The checkpoint may be the file that is resumed from.
        if let Some(checkpoint) = &self.checkpoint {
            outputs.add(checkpoint, "--checkpoint", Named::ByUser)?;
        }
        outputs.also_reads(self.resume.as_deref());
        let named = if self.output.is_some() { Named::ByUser } else { Named::ByUs };
        pictures.check(&mut outputs, named)?;
        if let Some(stats) = &self.stats {
            outputs.add_text(stats, "--stats", Named::ByUser)?;
        }
        Ok((pictures, outputs))
    }

    /// An option that makes sense for photons alone and is given.
    pub(super) fn option_of_rounds(&self) -> Option<&'static str> {
        [
            ("--time-limit", self.time_limit.is_some()),
            ("--checkpoint", self.checkpoint.is_some()),
            ("--resume", self.resume.is_some()),
            ("--photon-map", self.photon_map.is_some()),
            ("--atlas", self.atlas.is_some()),
        ]
        .into_iter()
        .find_map(|(option, given)| given.then_some(option))
    }
}

/// Which layers the EXR has.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct LayersArgs {
    /// Layers of the EXR.
    #[arg(long, value_enum, default_value_t = LayersArg::All)]
    layers: LayersArg,

    /// Leave out albedo, normal, depth and ids from the EXR: --layers light.
    #[arg(long, conflicts_with = "layers")]
    beauty_only: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LayersArg {
    /// The picture, the five parts of its light, albedo, normal, depth and ids (the default).
    All,
    /// The picture and the five parts of its light.
    Light,
    /// The picture alone.
    Beauty,
}

impl LayersArgs {
    /// The layers, and the number of samples where that is not the same everywhere.
    pub(super) fn set(self, is_adaptive: bool) -> LayerSet {
        match self.layers {
            LayersArg::All if !self.beauty_only => LayerSet { samples: is_adaptive, ..LayerSet::all() },
            LayersArg::All | LayersArg::Light => LayerSet::default(),
            LayersArg::Beauty => LayerSet::beauty(),
        }
    }
}

/// Parses the size of the cache of bricks.
fn brick_cache(text: &str) -> Result<u64, String> {
    match text {
        "0" => Ok(0),
        _ => cardioid::settings::memory(text).map_err(|message| format!("{message}, or 0 for none")),
    }
}

pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    /// About three years.
    const LONGEST: f64 = 1e8;
    let message =
        || "write a time from 1ms to 27000h with its unit (ms, s, m or h), for example 30s".to_owned();
    let (number, unit) = match text.find(|c: char| c.is_ascii_alphabetic()) {
        Some(at) => text.split_at(at),
        None => (text, "s"),
    };
    let factor = match unit {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(message()),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| message())? * factor;
    if (1e-3..=LONGEST).contains(&seconds) { Ok(Duration::from_secs_f64(seconds)) } else { Err(message()) }
}

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    let start = Instant::now();
    catch_interrupts();
    if args.end_with_input {
        end_with_input();
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let (pictures, outputs) = args.outputs()?;
    let console = args.console(args.time_limit)?;
    pool.install(|| {
        // Before anything else, so that a damaged file is reported before a scene is built.
        let saved = args.photon_map.as_deref().map(SavedMaps::read).transpose()?;
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
        // Also where the scene could not be read.
        console.finish();
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            say!("stopped while the scene was read and built: there is no picture");
            return Ok(if args.whole { super::part::stopped() } else { ExitCode::from(code) });
        }
        let loaded = loaded?;
        if !args.quiet {
            loaded.print_notes();
        }
        // Not earlier: Embree's threads use the dynamic loader as well and would have to wait.
        let _library = Loading::start();
        let seconds_scene = start.elapsed().as_secs_f64();
        let request = request(args, &loaded);
        if args.whole && args.crop.is_some() && request.settings.adaptive {
            bail!("windows of a picture with --adaptive cannot be merged: each would share out its own samples; leave --adaptive out");
        }
        if args.whole && args.time_limit.is_some() && request.settings.integrator != IntegratorKind::Path {
            bail!(
                "--time-limit sizes photon maps to fit, so that the picture would be whole but another one: leave it out beside --whole"
            );
        }
        if args.time_limit.is_some() {
            console.busy("measuring how fast the disk is");
            // The measurement may run while the machine is busy, so it must not use up the remaining time.
            let left = console.deadline().map(|end| end.saturating_duration_since(Instant::now()));
            console.reserve(pictures.time_to_write(&request)?.min(left.unwrap_or_default() / 2));
            console.finish();
        }
        let Loaded { built, .. } = &loaded;
        let (scene, camera) = (&built.scene, &built.camera);
        let plan = request.settings.plan(scene);
        let plan = if args.atlas.is_some() { plan.with_atlas() } else { plan };
        // Without a limit, the pass itself checks the free memory before it traces photons.
        if let Some(limit) = args.scene.memory_limit {
            loaded.estimate.with_photons(&request.settings, &plan, scene).check(Some(limit))?;
        }
        if let Some(saved) = &saved {
            let hash = photon_content_hash(&loaded.description).context("cannot hash the scene")?;
            saved.check(&hash, &request.settings, &plan)?;
        }
        let atlas = match &args.atlas {
            Some(folder) => {
                let hash = photon_content_hash(&loaded.description).context("cannot hash the scene")?;
                Some(open_irradiance_atlas(scene, &hash, folder, args.brick_cache)?)
            }
            None => None,
        };
        let in_rounds = request.settings.integrator == IntegratorKind::Progressive;
        let rendered = if let Some(atlas) = atlas {
            render_with_atlas(scene, camera, &request, atlas, &console)
        } else if in_rounds || args.checkpoint.is_some() || args.resume.is_some() {
            if saved.is_some() {
                bail!("--photon-map holds the photons of one picture, and each round of a progressive one has its own");
            }
            render_in_rounds(scene, camera, &request, &console, rounds(args, &loaded))
        } else {
            render_with_maps(scene, camera, &request, saved, &console)
        };
        console.finish();
        deliver(args, &loaded, &pictures, rendered?, (start, seconds_scene, request.settings.spp))
    })
}

/// Writes what was rendered, and reports it. The numbers are the start, the seconds until the scene was built, and the samples asked for.
pub(super) fn deliver(
    args: &RenderArgs,
    loaded: &Loaded,
    pictures: &Pictures,
    rendered: Rendered,
    (start, seconds_scene, asked): (Instant, f64, u32),
) -> Result<ExitCode> {
    let Rendered { film, mut statistics, stopped, checkpoint_failure } = rendered;
    statistics.times.scene = seconds_scene;
    statistics.process = Some(process(start));
    for warning in &statistics.warnings {
        say!("warning: {warning}");
    }
    // The warnings of the scene were printed when it was built.
    statistics.warnings.splice(0..0, loaded.built.warnings.iter().map(ToString::to_string));
    if let Some(failure) = image_io::library_failure() {
        return Err(failure.into());
    }
    if stopped == Some(Stop::BeforePixels) || stopped.is_some() && film.sample_count() == 0 {
        write_statistics(args, &statistics)?;
        say!("stopped before the first pixel: there is no picture");
        if args.whole {
            return Ok(super::part::stopped());
        }
        return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
    }
    if args.whole && stopped.is_some() {
        write_statistics(args, &statistics)?;
        say!("stopped before the picture was whole: none was written");
        return Ok(super::part::stopped());
    }
    let developed = film.develop();
    if developed.clamped > 0 {
        say!(
            "warning: {} values exceed what a file of single precision holds and were cut; lower the power of the \
             lights",
            developed.clamped
        );
    }
    let about = About::of(loaded, &statistics.settings, &statistics.plan)?;
    let figures = Figures::of(&statistics, loaded, &developed)?;
    let exposure = Exposure::choose(&args.looks, &about, &developed);
    exposure.tell(args.quiet, &developed, about.has_light);
    let mut failures = pictures.write(&about, &figures, &developed, &exposure);
    failures.extend(write_statistics(args, &statistics).err());
    if !args.quiet {
        summary(&statistics, stopped, asked, &developed);
        if failures.is_empty() {
            pictures.tell();
        }
    }
    failures.extend(checkpoint_failure.map(anyhow::Error::from));
    for failure in &failures {
        say!("error: {failure:#}");
    }
    if !failures.is_empty() {
        return Ok(if args.whole { ExitCode::from(super::part::TRY_AGAIN) } else { ExitCode::FAILURE });
    }
    Ok(interrupted().map_or(ExitCode::SUCCESS, ExitCode::from))
}

/// A thread that loads OpenImageIO while the scene is rendered.
struct Loading(Option<JoinHandle<()>>);

impl Loading {
    fn start() -> Self {
        // Without a thread, the first picture that is written loads the library.
        Self(thread::Builder::new().spawn(image_io::load_library).ok())
    }
}

impl Drop for Loading {
    /// Waits for the thread: a program that exits while its libraries initialize would destroy half-initialized state.
    fn drop(&mut self) {
        // A panic of the loader is ignored here.
        let _ = self.0.take().map(JoinHandle::join);
    }
}

pub(super) fn request(args: &RenderArgs, loaded: &Loaded) -> RenderRequest {
    let asked = args.settings.over(&loaded.description.render);
    let mut settings = Settings::from(&asked);
    if args.time_limit.is_some() && asked.rounds.is_none() {
        // As many as the time limit allows.
        settings.rounds = None;
    }
    request_of(loaded, args.crop, args.layers, settings)
}

pub(super) fn request_of(
    loaded: &Loaded,
    crop: Option<PixelRect>,
    layers: LayersArgs,
    settings: Settings,
) -> RenderRequest {
    RenderRequest {
        width: loaded.size.0,
        height: loaded.size.1,
        crop: crop.or_else(|| loaded.crop()),
        filter: filter_of(loaded.description.film.filter),
        layers: layers.set(settings.adaptive),
        settings,
    }
}

/// What rounds must have in common to be of one picture, beside the request.
pub(super) fn identity(loaded: &Loaded) -> Vec<(String, String)> {
    let version = env!("CARGO_PKG_VERSION").to_owned();
    vec![
        ("scene".to_owned(), loaded.hash.clone()),
        ("cardioid".to_owned(), version),
        ("Embree".to_owned(), loaded.device.version().to_string()),
        ("instructions".to_owned(), loaded.instruction_set()),
    ]
}

/// Checkpoint to resume from, and checkpoint to write.
fn rounds(args: &RenderArgs, loaded: &Loaded) -> Rounds {
    let identity = identity(loaded);
    Rounds { identity, resume: args.resume.clone(), checkpoint: args.checkpoint.clone() }
}

/// Resources that this process has used so far.
fn process(start: Instant) -> ProcessStatistics {
    let cpu = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    // Only Linux has this file.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = peak.and_then(|text| text.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    ProcessStatistics {
        wall: start.elapsed().as_secs_f64(),
        cpu: cpu.tv_sec as f64 + 1e-9 * cpu.tv_nsec as f64,
        peak_memory: kilobytes.map(|n| 1024 * n),
    }
}

/// Writes `--stats` and prints the table, if they are asked for.
fn write_statistics(args: &RenderArgs, statistics: &Statistics) -> Result<()> {
    let mut printed = String::new();
    if let Some(path) = &args.stats {
        let text = serde_json::to_string_pretty(statistics)? + "\n";
        match image_io::is_standard_output(path) {
            true => printed = text,
            false => image_io::write_text(path, &text)?,
        }
    }
    if args.stats_table {
        printed += &statistics.to_table();
    }
    if printed.is_empty() { Ok(()) } else { super::print(&printed) }
}

fn summary_of_rounds(rounds: &RoundStatistics, asked: Option<u64>, stopped: bool) {
    let resumed = match rounds.resumed {
        0 => String::new(),
        n => format!(", {n} of them from before"),
    };
    let early = match (stopped, asked) {
        (true, Some(asked)) => format!("stopped early: of {asked} rounds "),
        _ => String::new(),
    };
    say!(
        "{early}{} rounds{resumed}, {} photons, {:.1} s; the same picture again by --rounds {}{}",
        rounds.done,
        rounds.photons_stored,
        rounds.seconds,
        rounds.done,
        rounds.fitted.map_or_else(String::new, |round| format!(
            " --spp {} --global-photons {} --caustic-photons {}",
            round.spp, round.global_photons, round.caustic_photons
        ))
    );
    say_error(rounds);
}

/// Prints the estimate of the error.
pub(super) fn say_error(rounds: &RoundStatistics) {
    match &rounds.error {
        Some(error) => {
            say!(
                "relative error about {:.2} %: noise {:.2} %, bias {:.2} %{}",
                100.0 * error.error,
                100.0 * error.noise,
                100.0 * error.bias,
                rounds
                    .target_error
                    .map_or_else(String::new, |target| format!(" (asked for: {:.2} %)", 100.0 * target))
            );
            if error.noise_without_glints.powi(2) < 0.75 * error.noise.powi(2) {
                say!(
                    "{} pixels are far brighter in one half of the rounds than in the other: something small and bright \
                     that few samples meet, such as a lamp seen in glass. How far off they are is not known; without \
                     them the noise is {:.2} %",
                    error.glints,
                    100.0 * error.noise_without_glints
                );
            }
        }
        None if rounds.done < 2 => say!("the relative error is not known after a single round"),
        None => say!("the relative error is not known: the picture is black"),
    }
}

fn summary(statistics: &Statistics, stopped: Option<Stop>, asked: u32, developed: &Developed) {
    let times = &statistics.times;
    for map in &statistics.maps {
        let name = serde_json::to_value(map.map).ok().and_then(|v| v.as_str().map(str::to_owned));
        say!(
            "{} map{}: {} photons of {} emitted, {:.1} MB, {:.2} s",
            name.unwrap_or_default(),
            if map.from_file { " from the file" } else { "" },
            map.photons,
            map.emitted,
            map.bytes as f64 / 1e6,
            map.seconds_tracing + map.seconds_building
        );
    }
    if let Some(cache) = &statistics.cache {
        say!("irradiance cache: {} records, {:.2} s", cache.records, times.cache);
    }
    if let Some(maps) = &statistics.illumination {
        let sizes = &maps.sizes;
        say!(
            "illumination maps of {} surfaces: {} photons in {} elements, caustics in {} (of {} everywhere), {:.1} MB, {:.2} s",
            sizes.surfaces,
            sizes.photons,
            sizes.elements,
            sizes.caustic_elements,
            sizes.caustic_elements_everywhere,
            sizes.bytes as f64 / 1e6,
            maps.seconds
        );
    }
    if let Some(adaptive) = &statistics.adaptive {
        say!(
            "samples by variance: {} to {} per pixel, {:.2} on average",
            adaptive.fewest,
            adaptive.most,
            adaptive.mean
        );
    }
    for light in &statistics.shadows {
        let decided = &light.decisions;
        say!(
            "shadow photons of light {}: {} direct, {} shadow; saved {} shadow rays ({:.1} %); lit {}, shadow {}, mixed {}, \
             too few {}",
            light.light,
            light.direct_photons,
            light.shadow_photons,
            decided.rays_saved,
            light.rays_saved_percent,
            decided.lit,
            decided.shadow,
            decided.mixed,
            decided.too_few
        );
    }
    say!(
        "scene {:.2} s, photons {:.2} s, pixels {:.2} s; {} samples per pixel, mean ray depth {:.2}",
        times.scene,
        times.photons,
        times.pixels,
        statistics.samples,
        statistics.mean_depth
    );
    if let Some(rounds) = &statistics.rounds {
        summary_of_rounds(rounds, statistics.settings.rounds, stopped.is_some());
    } else if stopped.is_some() {
        say!(
            "stopped early: {} of {asked} samples per pixel, {} pixels have none",
            statistics.samples,
            developed.unsampled
        );
    }
}
