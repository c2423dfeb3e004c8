//! `cardioid render`: from a scene file to pictures.

use super::picture::{Loaded, SceneArgs, crop, filter_of, load};
use super::progress::{Console, catch_interrupts, interrupted};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, bail};
use cardioid::film::{Developed, LayerSet, PixelRect, ToneCurve, ToneMap};
use cardioid::image_io::{self, Image, Layer, MetadataValue, PngPixels};
use cardioid::render::{
    IntegratorKind, ProcessStatistics, RenderRequest, Rendered, RoundStatistics, Rounds, SavedMaps, Settings,
    Statistics, Stop, render_in_rounds, render_with_maps,
};
use cardioid::scene_file::photon_content_hash;
use clap::{Args, ValueEnum};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Render a scene to an EXR with all parts of the light, and a PNG
#[derive(Args, Clone, Debug)]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// Picture to write: .exr (a .png is written beside it) or .png alone. Default: the scene's name in this folder.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

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
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f64>,

    /// Tone curve of the PNG.
    #[arg(long, value_enum, default_value_t = CurveArg::None)]
    tone: CurveArg,

    /// Photons from a file that `cardioid photons` wrote, instead of traced ones: the same picture, sooner.
    ///
    /// Scene and photon settings must be those of the file; the camera, the picture and how maps are read may differ.
    #[arg(long, value_name = "FILE")]
    photon_map: Option<PathBuf>,

    /// Leave out albedo, normal, depth and ids from the EXR.
    #[arg(long)]
    beauty_only: bool,

    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,

    /// Print statistics as a table: time and memory by step, rays by kind, photons by map and light, warnings.
    #[arg(long)]
    stats_table: bool,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CurveArg {
    /// Exactly what was computed, clamped at white (the default).
    None,
    /// Bend bright colours towards white (Khronos PBR Neutral).
    Neutral,
}

pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let message = || "write a positive number with s, m or h, for example 30s".to_owned();
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
    Duration::try_from_secs_f64(seconds).ok().filter(|d| !d.is_zero()).ok_or_else(message)
}

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    catch_interrupts();
    let start = Instant::now();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let outputs = Outputs::new(args)?;
    let console = Console::new(args.quiet, args.time_limit);
    pool.install(|| {
        // First of all: a damaged file is told before a scene is built.
        let saved = args.photon_map.as_deref().map(SavedMaps::read).transpose()?;
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &console, &|| console.finish());
        // Where it was not even read.
        console.finish();
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            eprintln!("stopped while the scene was read and built: there is no picture");
            return Ok(ExitCode::from(code));
        }
        let loaded = loaded?;
        // Only now: Embree's threads ask the loader for something too, and would have to wait for this.
        let _library = Loading::start();
        let seconds_scene = start.elapsed().as_secs_f64();
        let request = request(args, &loaded);
        let Loaded { built, .. } = &loaded;
        let (scene, camera) = (&built.scene, &built.camera);
        let plan = request.settings.plan(scene);
        // Without a limit, what is free decides before photons are traced.
        if let Some(limit) = args.scene.memory_limit {
            loaded.estimate.with_photons(&request.settings, &plan).check(Some(limit))?;
        }
        if let Some(saved) = &saved {
            let hash = photon_content_hash(&loaded.description).context("cannot hash the scene")?;
            saved.check(&hash, &request.settings, &plan)?;
        }
        let in_rounds = request.settings.integrator == IntegratorKind::Progressive;
        let rendered = if in_rounds || args.checkpoint.is_some() || args.resume.is_some() {
            if saved.is_some() {
                bail!("--photon-map holds the photons of one picture, and each round of a progressive one has its own");
            }
            render_in_rounds(scene, camera, &request, &console, rounds(args, &loaded))
        } else {
            render_with_maps(scene, camera, &request, saved, &console)
        };
        console.finish();
        let Rendered { film, mut statistics, stopped } = rendered?;
        statistics.times.scene = seconds_scene;
        statistics.process = Some(process(start));
        for warning in &statistics.warnings {
            eprintln!("warning: {warning}");
        }
        // Those of the scene were told when it was built.
        statistics.warnings.splice(0..0, loaded.built.warnings.iter().map(ToString::to_string));
        if let Some(failure) = image_io::library_failure() {
            return Err(failure.into());
        }
        if stopped == Some(Stop::BeforePixels) {
            write_statistics(args, &statistics)?;
            eprintln!("stopped before the first pixel: there is no picture");
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        }
        let developed = film.develop();
        if developed.clamped > 0 {
            eprintln!(
                "warning: {} values exceed what a file of single precision holds and were cut; lower the power of the \
                 lights",
                developed.clamped
            );
        }
        outputs.write(args, &loaded, &developed, &statistics)?;
        if !args.quiet {
            summary(&statistics, stopped, &outputs, request.settings.spp, &developed);
        }
        Ok(interrupted().map_or(ExitCode::SUCCESS, ExitCode::from))
    })
}

/// OpenImageIO on its way into memory while the scene is rendered.
struct Loading(Option<JoinHandle<()>>);

impl Loading {
    fn start() -> Self {
        // Where there is no room for a thread, the first picture loads it.
        Self(thread::Builder::new().spawn(image_io::load_library).ok())
    }
}

impl Drop for Loading {
    /// A program that ends while its libraries are still being set up would tear down what is half there.
    fn drop(&mut self) {
        // It panics no more than the loader does.
        let _ = self.0.take().map(JoinHandle::join);
    }
}

fn request(args: &RenderArgs, loaded: &Loaded) -> RenderRequest {
    let asked = args.settings.over(&loaded.description.render);
    let mut settings = Settings::from(&asked);
    if args.time_limit.is_some() && asked.rounds.is_none() {
        // As many as there is time for.
        settings.rounds = None;
    }
    let layers = if args.beauty_only { LayerSet::default() } else { LayerSet::all() };
    RenderRequest {
        width: loaded.size.0,
        height: loaded.size.1,
        crop: args.crop,
        filter: filter_of(loaded.description.film.filter),
        layers: LayerSet { samples: settings.adaptive && !args.beauty_only, ..layers },
        settings,
    }
}

/// What is gone on with, and where rounds are kept.
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

/// What this process took so far.
fn process(start: Instant) -> ProcessStatistics {
    let cpu = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    // Only Linux has such a file.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = peak.and_then(|text| text.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    ProcessStatistics {
        wall: start.elapsed().as_secs_f64(),
        cpu: cpu.tv_sec as f64 + 1e-9 * cpu.tv_nsec as f64,
        peak_memory: kilobytes.map(|n| 1024 * n),
    }
}

/// Where pictures go. Checked before anything is rendered: a wrong name should not cost an hour.
struct Outputs {
    exr: Option<PathBuf>,
    png: PathBuf,
}

impl Outputs {
    fn new(args: &RenderArgs) -> Result<Self> {
        let output = match &args.output {
            Some(output) => output.clone(),
            None => PathBuf::from(args.scene.scene.file_stem().unwrap_or_default()).with_extension("exr"),
        };
        let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let outputs = match extension.as_str() {
            "exr" => Self { png: output.with_extension("png"), exr: Some(output) },
            "png" => Self { exr: None, png: output },
            _ => bail!("{}: the name of a picture ends in .exr or .png", output.display()),
        };
        outputs.check(args)?;
        Ok(outputs)
    }

    /// Every file can be written, and none would take the place of another, or of the scene.
    fn check(&self, args: &RenderArgs) -> Result<()> {
        let pictures = [self.exr.as_deref(), Some(&*self.png)];
        let others = [args.stats.as_deref(), args.checkpoint.as_deref()];
        let files: Vec<&Path> = pictures.into_iter().chain(others).flatten().collect();
        for (i, file) in files.iter().enumerate() {
            image_io::check_writable(file)?;
            let kept = args.resume.as_deref().filter(|_| args.checkpoint.as_deref() != Some(file));
            let read = [Some(args.scene.scene.as_path()), args.photon_map.as_deref(), kept];
            let others = files[..i].iter().copied().chain(read.into_iter().flatten());
            if let Some(other) = others.into_iter().find(|other| image_io::is_same_file(file, other)) {
                bail!("{} would overwrite {}; give it another name", file.display(), other.display());
            }
        }
        Ok(())
    }

    fn write(
        &self,
        args: &RenderArgs,
        loaded: &Loaded,
        developed: &Developed,
        statistics: &Statistics,
    ) -> Result<()> {
        let (width, height) = (developed.rect.width(), developed.rect.height());
        if let Some(exr) = &self.exr {
            let layers = developed.layers.iter().map(|layer| {
                let name = if layer.name == "beauty" { "" } else { layer.name };
                Layer::new(name, layer.channels, layer.values.clone())
            });
            let mut image = Image::new(width, height);
            image.layers = layers.collect();
            image.metadata = metadata(loaded, developed, statistics)?;
            image_io::write_exr(exr, &image)?;
        }
        let tone = ToneMap {
            exposure: args.exposure.unwrap_or(loaded.description.film.exposure)
                + loaded.description.film.white,
            curve: match args.tone {
                CurveArg::None => ToneCurve::None,
                CurveArg::Neutral => ToneCurve::Neutral,
            },
        };
        let bytes = tone.to_srgb8(developed.beauty());
        image_io::write_png(&self.png, width, height, PngPixels::Rgb8(&bytes))?;
        write_statistics(args, statistics)
    }
}

/// Writes `--stats` and prints the table, where they are asked for.
fn write_statistics(args: &RenderArgs, statistics: &Statistics) -> Result<()> {
    if args.stats_table {
        write!(std::io::stdout().lock(), "{}", statistics.to_table())?;
    }
    if let Some(path) = &args.stats {
        let text = serde_json::to_string_pretty(statistics)?;
        image_io::write_text(path, &(text + "\n"))?;
    }
    Ok(())
}

/// What a picture needs to be made again.
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
        ("cardioid/window".into(), format!("{},{},{},{}", rect.x0, rect.y0, rect.x1, rect.y1).into()),
        ("cardioid/fullSize".into(), format!("{}x{}", developed.width, developed.height).into()),
    ];
    if let Some(rounds) = &statistics.rounds {
        metadata.push(("cardioid/rounds".into(), MetadataValue::Double(rounds.done as f64)));
        metadata.push(("cardioid/error".into(), json(serde_json::to_string(&rounds.error))?));
    }
    Ok(metadata)
}

/// The architecture, and the widest instructions that Embree finds: hits differ in the last bits between them.
fn instruction_set() -> String {
    let arch = std::env::consts::ARCH;
    #[cfg(target_arch = "x86_64")]
    for (name, present) in [
        ("avx512", is_x86_feature_detected!("avx512f")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("avx", is_x86_feature_detected!("avx")),
        ("sse4.2", is_x86_feature_detected!("sse4.2")),
    ] {
        if present {
            return format!("{arch} {name}");
        }
    }
    arch.to_owned()
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
    eprintln!(
        "{early}{} rounds{resumed}, {} photons, {:.1} s; the same picture again by --rounds {}",
        rounds.done, rounds.photons_stored, rounds.seconds, rounds.done
    );
    match &rounds.error {
        Some(error) => {
            eprintln!(
                "relative error about {:.2} %: noise {:.2} %, bias {:.2} %{}",
                100.0 * error.error,
                100.0 * error.noise,
                100.0 * error.bias,
                rounds
                    .target_error
                    .map_or_else(String::new, |target| format!(" (asked for: {:.2} %)", 100.0 * target))
            );
            if error.noise_without_glints.powi(2) < 0.75 * error.noise.powi(2) {
                eprintln!(
                    "{} pixels are far brighter in one half of the rounds than in the other: something small and bright \
                     that few samples meet, such as a lamp seen in glass. How far off they are is not known; without \
                     them the noise is {:.2} %",
                    error.glints,
                    100.0 * error.noise_without_glints
                );
            }
        }
        None => eprintln!("the relative error is not known after a single round"),
    }
}

fn summary(
    statistics: &Statistics,
    stopped: Option<Stop>,
    outputs: &Outputs,
    asked: u32,
    developed: &Developed,
) {
    let times = &statistics.times;
    for map in &statistics.maps {
        let name = serde_json::to_value(map.map).ok().and_then(|v| v.as_str().map(str::to_owned));
        eprintln!(
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
        eprintln!("irradiance cache: {} records, {:.2} s", cache.records, times.cache);
    }
    if let Some(maps) = &statistics.illumination {
        let sizes = &maps.sizes;
        eprintln!(
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
        eprintln!(
            "samples by variance: {} to {} per pixel, {:.2} on average",
            adaptive.fewest, adaptive.most, adaptive.mean
        );
    }
    for light in &statistics.shadows {
        let decided = &light.decisions;
        eprintln!(
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
    eprintln!(
        "scene {:.2} s, photons {:.2} s, pixels {:.2} s; {} samples per pixel, mean ray depth {:.2}",
        times.scene, times.photons, times.pixels, statistics.samples, statistics.mean_depth
    );
    if let Some(rounds) = &statistics.rounds {
        summary_of_rounds(rounds, statistics.settings.rounds, stopped.is_some());
    } else if stopped.is_some() {
        eprintln!(
            "stopped early: {} of {asked} samples per pixel, {} pixels have none",
            statistics.samples, developed.unsampled
        );
    }
    if let Some(exr) = &outputs.exr {
        eprintln!("wrote {}", exr.display());
    }
    eprintln!("wrote {}", outputs.png.display());
}
