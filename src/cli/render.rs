//! `cardioid render`: from a scene file to pictures.

use super::meaning::{LAYERS, LayerMeaning};
use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, crop, filter_of, load};
use super::progress::{Console, ProgressKind, catch_interrupts, end_with_input, interrupted};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, bail};
use cardioid::embree::Isa;
use cardioid::film::{Developed, Film, LayerSet, PixelRect, ToneCurve, ToneMap, auto_exposure};
use cardioid::image_io::{self, Image, Layer, MetadataValue, PngPixels, Window};
use cardioid::render::{
    IntegratorKind, Observer, ProcessStatistics, RenderRequest, Rendered, RoundStatistics, Rounds, SavedMaps,
    Settings, Statistics, Stop, open_irradiance_atlas, render_in_rounds, render_with_atlas, render_with_maps,
};
use cardioid::scene_file::photon_content_hash;
use clap::{Args, ValueEnum};
use std::collections::{BTreeMap, BTreeSet};
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

    /// Keep the rounds of `--integrator progressive` in this file, every half minute and at the end, to go on with them.
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,

    /// Go on with the rounds that --checkpoint kept: the same picture as if they had never stopped.
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,

    /// Exposure of the PNG in stops, over that of the scene file.
    #[arg(long, value_name = "STOPS", value_parser = stops)]
    exposure: Option<f64>,

    /// Tone curve of the PNG.
    #[arg(long, value_enum, default_value_t = CurveArg::None)]
    tone: CurveArg,

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

    /// Leave out albedo, normal, depth and ids from the EXR.
    #[arg(long)]
    beauty_only: bool,

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

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CurveArg {
    /// Exactly what was computed, clamped at white (the default).
    None,
    /// Bend bright colours towards white (Khronos PBR Neutral).
    Neutral,
}

/// Parses the size of the cache of bricks.
fn brick_cache(text: &str) -> Result<u64, String> {
    match text {
        "0" => Ok(0),
        _ => cardioid::settings::memory(text).map_err(|message| format!("{message}, or 0 for none")),
    }
}

/// Parses an exposure in stops.
pub(super) fn stops(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(stops) if (-100.0..=100.0).contains(&stops) => Ok(stops),
        _ => Err("write a number of stops from -100 to 100, for example -1.5: each doubles the brightness"
            .to_owned()),
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
    let pictures = Pictures::new(args)?;
    let outputs = pictures.check(args)?;
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
            return Ok(ExitCode::from(code));
        }
        let loaded = loaded?;
        if !args.quiet {
            loaded.print_notes();
        }
        // Not earlier: Embree's threads use the dynamic loader as well and would have to wait.
        let _library = Loading::start();
        let seconds_scene = start.elapsed().as_secs_f64();
        let request = request(args, &loaded);
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
        return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
    }
    let developed = film.develop();
    if developed.clamped > 0 {
        say!(
            "warning: {} values exceed what a file of single precision holds and were cut; lower the power of the \
             lights",
            developed.clamped
        );
    }
    let exposure = Exposure::choose(args, loaded, &developed);
    exposure.tell(args, &developed, !loaded.built.scene.lights().is_empty());
    let mut failures = pictures.write(args, loaded, &developed, &statistics, &exposure);
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
        return Ok(ExitCode::FAILURE);
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
    let layers = if args.beauty_only { LayerSet::default() } else { LayerSet::all() };
    RenderRequest {
        width: loaded.size.0,
        height: loaded.size.1,
        crop: args.crop.or_else(|| loaded.crop()),
        filter: filter_of(loaded.description.film.filter),
        layers: LayerSet { samples: settings.adaptive && !args.beauty_only, ..layers },
        settings,
    }
}

/// Checkpoint to resume from, and checkpoint to write.
fn rounds(args: &RenderArgs, loaded: &Loaded) -> Rounds {
    let version = env!("CARGO_PKG_VERSION").to_owned();
    Rounds {
        identity: vec![
            ("scene".to_owned(), loaded.hash.clone()),
            ("cardioid".to_owned(), version),
            ("Embree".to_owned(), loaded.device.version().to_string()),
            ("instructions".to_owned(), instruction_set()),
        ],
        resume: args.resume.clone(),
        checkpoint: args.checkpoint.clone(),
    }
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

/// Exposure and tone curve of the PNG, and where the exposure comes from. The EXR holds radiance, whatever the exposure.
struct Exposure {
    tone: ToneMap,
    /// Stops that are added to every given exposure.
    white: f64,
    from: &'static str,
}

impl Exposure {
    /// The exposure of the command line, or that of the scene, or one chosen from the picture itself.
    fn choose(args: &RenderArgs, loaded: &Loaded, developed: &Developed) -> Self {
        let film = &loaded.built.film;
        let given = args.exposure.map(|stops| (stops, "command line"));
        let given = given.or(film.exposure.map(|stops| (stops, "scene")));
        let (exposure, from) = match given {
            Some((stops, from)) => (stops + film.white, from),
            None => (auto_exposure(developed.beauty()).unwrap_or(film.white), "picture"),
        };
        let curve = match args.tone {
            CurveArg::None => ToneCurve::None,
            CurveArg::Neutral => ToneCurve::Neutral,
        };
        Self { tone: ToneMap { exposure, curve }, white: film.white, from }
    }

    /// Reports an exposure that was chosen automatically, and suggests a remedy where the picture shows nothing.
    fn tell(&self, args: &RenderArgs, developed: &Developed, has_light: bool) {
        let stops = self.tone.exposure - self.white;
        let seen = self.tone.rendition(developed.beauty());
        if self.from == "picture" && !args.quiet && !seen.is_black() {
            say!(
                "exposure {stops:.2} stops, chosen by the picture, as the scene gives none: --exposure {stops:.2} keeps it"
            );
        }
        if developed.unsampled > 0 {
            return;
        }
        if seen.is_black() && has_light {
            say!(
                "warning: the picture is black: no light reaches what the camera sees; is the camera, or are all lights, shut \
                 in or turned away?"
            );
        }
        if seen.is_black() {
            return;
        }
        let better = auto_exposure(developed.beauty()).map_or(0.0, |better| better - self.white);
        if seen.is_too_bright() {
            say!(
                "warning: {:.0} % of the pixels are beyond white at an exposure of {stops:.2} stops; try --exposure {better:.1}",
                100.0 * seen.clipped as f64 / seen.pixels as f64
            );
        } else if seen.is_too_dark() {
            say!(
                "warning: all pixels are black at an exposure of {stops:.2} stops, though there is light; try --exposure \
                 {better:.1}"
            );
        }
    }

    fn metadata(&self) -> [(String, MetadataValue); 2] {
        [
            ("cardioid/exposure".into(), MetadataValue::Double(self.tone.exposure)),
            ("cardioid/exposureFrom".into(), self.from.into()),
        ]
    }
}

/// Output files of the picture. They are checked before anything is rendered, because a wrong name should not cost an hour.
pub(super) struct Pictures {
    exr: Option<PathBuf>,
    png: PathBuf,
}

impl Pictures {
    pub(super) fn new(args: &RenderArgs) -> Result<Self> {
        let output = match &args.output {
            Some(output) => output.clone(),
            None => PathBuf::from(args.scene.scene.file_stem().unwrap_or_default()).with_extension("exr"),
        };
        let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self { png: output.with_extension("png"), exr: Some(output) }),
            "png" => Ok(Self { exr: None, png: output }),
            _ => bail!("{}: the name of a picture ends in .exr or .png", output.display()),
        }
    }

    /// Checks that every file can be written and that none would overwrite another output or an input.
    pub(super) fn check(&self, args: &RenderArgs) -> Result<Outputs> {
        let read = [Some(args.scene.scene.as_path()), args.photon_map.as_deref()];
        let mut outputs = Outputs::new(read.into_iter().flatten()).overwriting(args.overwrite);
        // The checkpoint may be the file that is resumed from.
        if let Some(checkpoint) = &args.checkpoint {
            outputs.add(checkpoint, "--checkpoint", Named::ByUser)?;
        }
        outputs.also_reads(args.resume.as_deref());
        let named = if args.output.is_some() { Named::ByUser } else { Named::ByUs };
        if let Some(exr) = &self.exr {
            outputs.add(exr, "the picture", named)?;
        }
        match self.exr {
            Some(_) => outputs.add(&self.png, "the PNG beside the picture", Named::ByUs)?,
            None => outputs.add(&self.png, "the picture", named)?,
        }
        if let Some(stats) = &args.stats {
            outputs.add_text(stats, "--stats", Named::ByUser)?;
        }
        Ok(outputs)
    }

    /// Estimated time of writing the picture. It is measured on a part of the picture filled with noise, the slowest content; the
    /// file is deleted again.
    fn time_to_write(&self, request: &RenderRequest) -> Result<Duration> {
        /// Rows of that part.
        const ROWS: u32 = 64;
        let window =
            request.crop.map_or((request.width, request.height), |crop| (crop.width(), crop.height()));
        let (width, rows) = (window.0, window.1.min(ROWS));
        let empty = Film::new(width, rows, None, request.layers)?.develop();
        let mut image = Image::new(width, rows);
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32
        };
        image.layers = layers_of(&empty);
        image.layers.iter_mut().flat_map(|layer| &mut layer.data).for_each(|value| *value = noise());
        let time = image_io::time_to_write_exr(self.exr.as_ref().unwrap_or(&self.png), &image)?;
        Ok(time.mul_f64(f64::from(window.1) / f64::from(rows)))
    }

    /// Reports the files that were written.
    fn tell(&self) {
        for path in self.exr.iter().chain([&self.png]) {
            say!("wrote {}", path.display());
        }
    }

    /// Writes all outputs, even where one of them fails.
    fn write(
        &self,
        args: &RenderArgs,
        loaded: &Loaded,
        developed: &Developed,
        statistics: &Statistics,
        exposure: &Exposure,
    ) -> Vec<anyhow::Error> {
        let results = [
            self.write_exr(loaded, developed, statistics, exposure),
            self.write_png(developed, exposure),
            write_statistics(args, statistics),
        ];
        results.into_iter().filter_map(Result::err).collect()
    }

    fn write_exr(
        &self,
        loaded: &Loaded,
        developed: &Developed,
        statistics: &Statistics,
        exposure: &Exposure,
    ) -> Result<()> {
        let (width, height) = (developed.rect.width(), developed.rect.height());
        if let Some(exr) = &self.exr {
            let mut image = Image::new(width, height);
            let is_whole = (width, height) == (developed.width, developed.height);
            image.window = (!is_whole).then_some(Window {
                x: developed.rect.x0.into(),
                y: developed.rect.y0.into(),
                full_width: developed.width,
                full_height: developed.height,
            });
            image.layers = layers_of(developed);
            image.metadata = metadata(loaded, developed, statistics)?;
            image.metadata.extend(exposure.metadata());
            image_io::write_exr(exr, &image)?;
        }
        Ok(())
    }

    fn write_png(&self, developed: &Developed, exposure: &Exposure) -> Result<()> {
        let (width, height) = (developed.rect.width(), developed.rect.height());
        let bytes = exposure.tone.to_srgb8(developed.beauty());
        Ok(image_io::write_png(&self.png, width, height, PngPixels::Rgb8(&bytes))?)
    }
}

/// The layers as they are written to a file.
fn layers_of(developed: &Developed) -> Vec<Layer> {
    let layers = developed.layers.iter().map(|layer| {
        let name = if layer.name == "beauty" { "" } else { layer.name };
        Layer::new(name, layer.channels, layer.values.clone())
    });
    layers.collect()
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

/// Metadata from which the picture can be reproduced.
fn metadata(
    loaded: &Loaded,
    developed: &Developed,
    statistics: &Statistics,
) -> Result<Vec<(String, MetadataValue)>> {
    let json = |value: serde_json::Result<String>| value.map(MetadataValue::from);
    let library = image_io::library_version()
        .map_or_else(String::new, |(major, minor, patch)| format!("{major}.{minor}.{patch}"));
    let rect = developed.rect;
    let mut metadata = vec![
        ("cardioid/version".into(), env!("CARGO_PKG_VERSION").into()),
        ("cardioid/scene".into(), statistics.scene.clone().into()),
        ("cardioid/sceneHash".into(), loaded.hash.clone().into()),
        ("cardioid/settings".into(), json(serde_json::to_string(&statistics.settings))?),
        ("cardioid/plan".into(), json(serde_json::to_string(&statistics.plan))?),
        ("cardioid/counters".into(), json(serde_json::to_string(&statistics.counters))?),
        ("cardioid/times".into(), json(serde_json::to_string(&statistics.times))?),
        ("cardioid/samples".into(), MetadataValue::Double(statistics.samples as f64)),
        ("cardioid/embree".into(), loaded.device.version().to_string().into()),
        ("cardioid/openimageio".into(), library.into()),
        ("cardioid/target".into(), instruction_set().into()),
        (LAYERS.into(), LayerMeaning::of(&statistics.settings).name().into()),
        ("cardioid/window".into(), format!("{},{},{},{}", rect.x0, rect.y0, rect.x1, rect.y1).into()),
        ("cardioid/fullSize".into(), format!("{}x{}", developed.width, developed.height).into()),
    ];
    let scene = &loaded.built.scene;
    let object: NameOf<'_> = &|id| scene.surfaces().get(id).map(|surface| surface.name.as_str());
    let material: NameOf<'_> = &|id| scene.materials().get(id).map(|(name, _)| name.as_str());
    for (key, layer, name_of) in
        [("cardioid/objects", "object", object), ("cardioid/materials", "material", material)]
    {
        if let Some(layer) = developed.layers.iter().find(|found| found.name == layer) {
            metadata.push((key.into(), json(serde_json::to_string(&names_in(&layer.values, name_of)))?));
        }
    }
    if let Some(radiosity) = &statistics.radiosity {
        metadata.push(("cardioid/radiosity".into(), json(serde_json::to_string(radiosity))?));
    }
    if let Some(rounds) = &statistics.rounds {
        metadata.push(("cardioid/rounds".into(), MetadataValue::Double(rounds.done as f64)));
        metadata.push(("cardioid/error".into(), json(serde_json::to_string(&rounds.error))?));
    }
    Ok(metadata)
}

/// Maps an id to the name of the object or material.
type NameOf<'a> = &'a dyn Fn(usize) -> Option<&'a str>;

/// Names of the ids that occur in an id layer. The layer holds -1 where no surface is visible.
fn names_in<'a>(ids: &[f32], name_of: NameOf<'a>) -> BTreeMap<usize, &'a str> {
    let seen: BTreeSet<usize> = ids.iter().filter(|id| **id >= 0.0).map(|id| *id as usize).collect();
    seen.into_iter().filter_map(|id| Some((id, name_of(id)?))).collect()
}

/// The architecture and the instruction set of Embree's kernels: hits differ in the last bits between instruction sets.
fn instruction_set() -> String {
    let isa = match Isa::from_environment() {
        Ok(Isa::Best) | Err(_) => Isa::detected(),
        Ok(isa) => isa,
    };
    format!("{} {}", std::env::consts::ARCH, isa.name()).trim_end().to_owned()
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
