//! `cardioid tradeoff`: cost and benefit of the settings for one scene.

use super::compare::read_picture;
use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, load};
use super::progress::{Console, catch_interrupts, interrupted};
use super::render::duration;
use anyhow::{Context, Result, bail};
use cardioid::image_io;
use cardioid::measure::Picture;
use cardioid::measure::tradeoff::{
    Base, Cell, Outcome, Shown, Sweep, crossing_table, csv, figures, front_table, html, knob_table, knobs,
    points_table, svg, sweep,
};
use cardioid::render::{Observer, Quality, Settings};
use clap::{Args, ValueEnum};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Measure what settings cost and buy on a scene: a report with the front that nothing beats and the price of each knob
///
/// Renders the scene with presets, in rounds, and with each knob one step down and up from there, with several seeds each, and
/// compares all with a reference. The folder then holds report.html (one file, for any browser), tradeoff.csv, tradeoff.md and
/// tradeoff.svg. What is rendered stays in its folder `runs`, and is not rendered again.
#[derive(Args, Clone, Debug)]
pub(crate) struct TradeoffArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// Folder for the report. Default: the scene's name and `-tradeoff`, in this folder.
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,

    /// Write into a folder under the default name that holds something else.
    #[arg(long)]
    overwrite: bool,

    /// Render no more after this time, for example 10m or 2h; what is not rendered then is listed.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    time_budget: Option<Duration>,

    /// Pictures of each cell, with seeds of their own. One alone tells bias from noise no more.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = seeds)]
    seeds: u64,

    /// What knobs are turned around.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["draft", "preview", "rounds", "final"])]
    around: Vec<Around>,

    /// Only these knobs, by their options without dashes; `none` for presets and rounds alone.
    #[arg(long, value_name = "KNOBS", value_delimiter = ',', value_parser = knob)]
    knobs: Option<Vec<String>>,

    /// First half of a reference of the same size, rather than one that is rendered.
    #[arg(long, value_name = "FILE", requires = "second_half")]
    reference: Option<PathBuf>,

    /// Its second half: the same picture with other random numbers.
    #[arg(long, value_name = "FILE", requires = "reference")]
    second_half: Option<PathBuf>,

    /// How a reference is rendered.
    #[arg(long, value_enum, default_value = "progressive")]
    reference_by: ReferenceBy,

    /// Time for each half of the reference. Default: a fifth of --time-budget, or 2m.
    #[arg(long, value_name = "TIME", value_parser = duration)]
    reference_time: Option<Duration>,

    /// No progress bar.
    #[arg(short, long)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Around {
    Draft,
    Preview,
    Final,
    Reference,
    /// 4, 16 and 64 rounds of progressive rendering.
    Rounds,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ReferenceBy {
    /// In rounds, until the error is estimated at 0.2 % or time is up.
    Progressive,
    /// By path tracing, 2^16 samples a pixel or until time is up.
    Path,
}

fn seeds(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(seeds @ 1..=100) => Ok(seeds),
        _ => Err("write a number of seeds from 1 to 100".to_owned()),
    }
}

fn knob(text: &str) -> Result<String, String> {
    let knobs = knobs();
    if text == "none" || knobs.contains(&text) {
        return Ok(text.to_owned());
    }
    Err(format!("the knobs are {}", knobs.join(", ")))
}

/// Files that are written into the folder.
const REPORTS: [&str; 4] = ["tradeoff.csv", "tradeoff.svg", "tradeoff.md", "report.html"];

/// Copy of a given reference as PNG, in the folder of runs.
const REFERENCE_PNG: &str = "reference.png";

/// Seeds of the two halves of a reference; the seeds of cells count from zero.
const REFERENCE_SEEDS: [u64; 2] = [1_000_001, 1_000_002];

/// Files of a run. Each run is a process.
struct Files {
    exr: PathBuf,
    png: PathBuf,
    /// Written last, so its presence means that the run is complete.
    stats: PathBuf,
}

/// Results that a run reports.
struct Run {
    wall: f64,
    cpu: f64,
    memory: Option<u64>,
    photons: u64,
}

struct Sweeper<'a> {
    args: &'a TradeoffArgs,
    loaded: &'a Loaded,
    runs: PathBuf,
    program: PathBuf,
    start: Instant,
}

pub(crate) fn run(args: &TradeoffArgs) -> Result<ExitCode> {
    catch_interrupts();
    let start = Instant::now();
    let console = Console::new(args.quiet, None);
    let folder = args.output.clone().unwrap_or_else(|| {
        let mut name = args.scene.scene.file_stem().unwrap_or_default().to_owned();
        name.push("-tradeoff");
        PathBuf::from(name)
    });
    let runs = folder.join("runs");
    // A folder of reports contains a folder of runs.
    let is_foreign = args.output.is_none() && !args.overwrite && folder.exists() && !runs.is_dir();
    if is_foreign {
        bail!(
            "{} is there already and is no folder of `cardioid tradeoff`, which has a folder `runs`: name another folder with -o, \
             or write into this one with --overwrite",
            folder.display()
        );
    }
    fs::create_dir_all(&runs).with_context(|| format!("cannot make the folder {}", runs.display()))?;
    let references = [&args.reference, &args.second_half];
    let given = references.into_iter().flatten().chain([&args.scene.scene]);
    let mut outputs = Outputs::new(given.map(PathBuf::as_path));
    for name in REPORTS {
        outputs.add(&folder.join(name), "the report", Named::ByUser)?;
    }
    if args.reference.is_some() {
        outputs.add(&runs.join(REFERENCE_PNG), "the picture of the reference", Named::ByUser)?;
    }
    console.busy("reading and building the scene");
    let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
    console.finish();
    let loaded = loaded?;
    let program = std::env::current_exe().context("cannot find this program itself")?;
    let sweeper = Sweeper { args, loaded: &loaded, runs, program, start };
    let state = |base: Base| {
        let settings = Settings::from(&base.overrides().over(loaded.description.render.clone()));
        let plan = settings.plan(&loaded.built.scene);
        (settings, plan)
    };
    let wanted = |name: &str| args.knobs.as_ref().is_none_or(|knobs| knobs.iter().any(|knob| knob == name));
    let cells = sweep(&bases(&args.around), state, wanted);
    console.begin("reference", 2);
    let reference = sweeper.reference(&console)?;
    let Some((halves, origin)) = reference else {
        console.finish();
        say!("stopped before there was a reference");
        return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
    };
    let (outcomes, shown, missing) = sweeper.all(&cells, &halves, &console)?;
    console.finish();
    let threads = if args.scene.threads == 0 {
        thread::available_parallelism().map_or(1, usize::from)
    } else {
        args.scene.threads
    };
    let scene = loaded.built.scene.name().to_owned();
    let noise = 100.0 * cardioid::measure::tradeoff::reference_noise(halves.views()?);
    let origin = format!("{origin}; {noise:.2} % of noise is left in their mean");
    let sweep = Sweep { scene, size: loaded.size, threads, reference: origin, outcomes, missing };
    let mut pictures = vec![Shown { name: "reference".to_owned(), png: halves.png }];
    pictures.extend(shown);
    let reports = [csv(&sweep), svg(&sweep), markdown(&sweep), html(&sweep, &pictures)];
    for (name, text) in REPORTS.iter().zip(reports) {
        image_io::write_text(folder.join(name), &text)?;
    }
    if !args.quiet {
        say!("{}", front_table(&sweep).trim_end());
        for (name, reason) in &sweep.missing {
            say!("not rendered: {name}: {reason}");
        }
        say!("wrote {}", folder.join("report.html").display());
    }
    Ok(interrupted().map_or(ExitCode::SUCCESS, ExitCode::from))
}

fn bases(around: &[Around]) -> Vec<Base> {
    let mut bases = Vec::new();
    for &place in around {
        match place {
            Around::Draft => bases.push(Base::Preset(Quality::Draft)),
            Around::Preview => bases.push(Base::Preset(Quality::Preview)),
            Around::Final => bases.push(Base::Preset(Quality::Final)),
            Around::Reference => bases.push(Base::Preset(Quality::Reference)),
            Around::Rounds => bases.extend([4, 16, 64].map(Base::Rounds)),
        }
    }
    bases
}

fn markdown(sweep: &Sweep) -> String {
    let crossings = crossing_table(sweep)
        .map_or_else(String::new, |table| format!("Where rounds overtake presets:\n\n{table}\n"));
    let note = match sweep.note() {
        note if note.is_empty() => note,
        note => format!("{note}\n\n"),
    };
    format!(
        "### {}\n\n{} x {} pixels. Reference: {}.\n\n{note}Presets and rounds; last column: the error over that of the front at the same \
         processor time.\n\n{}\n{crossings}What nothing beats:\n\n{}\nThe price of each knob, as factors:\n\n{}",
        sweep.scene,
        sweep.size.0,
        sweep.size.1,
        sweep.reference,
        points_table(sweep),
        front_table(sweep),
        knob_table(sweep)
    )
}

/// The reference in two halves.
struct Halves {
    size: (u32, u32),
    values: [Vec<f32>; 2],
    png: Vec<u8>,
}

impl Halves {
    fn views(&self) -> Result<[Picture<'_>; 2]> {
        let [first, second] = &self.values;
        let view = |values| Picture::new(self.size.0, self.size.1, values);
        Ok([view(first)?, view(second)?])
    }
}

type Outcomes = (Vec<Outcome>, Vec<Shown>, Vec<(String, String)>);

impl Sweeper<'_> {
    /// Runs all cells, or as many as the time allows.
    fn all(&self, cells: &[Cell], halves: &Halves, console: &Console) -> Result<Outcomes> {
        let seeds = self.args.seeds;
        console.begin("rendering", cells.len() as u64 * seeds);
        let (mut outcomes, mut shown, mut missing): Outcomes = (Vec::new(), Vec::new(), Vec::new());
        for (number, cell) in cells.iter().enumerate() {
            let expected = expected_seconds(cell, &outcomes);
            let mut runs = Vec::new();
            for seed in 0..seeds {
                let files = self.files(&cell.options, seed);
                let left = self.args.time_budget.map(|budget| budget.saturating_sub(self.start.elapsed()));
                let is_late = left.is_some_and(|left| left.is_zero() || expected > left.as_secs_f64());
                let result = if files.stats.exists() {
                    self.read(&files).map(Some)
                } else if is_late {
                    let which = if seed == 0 {
                        String::new()
                    } else {
                        format!(" for {} of {seeds} seeds", seeds - seed)
                    };
                    missing.push((cell.name(), format!("no time was left{which}")));
                    break;
                } else {
                    self.render(&cell.options, seed, &files)
                };
                match result {
                    Ok(Some(run)) => runs.push((run, files)),
                    Ok(None) => break,
                    Err(error) => {
                        missing.push((cell.name(), format!("{error:#}")));
                        break;
                    }
                }
                console.advance(number as u64 * seeds + seed + 1);
            }
            if interrupted().is_some() {
                missing.extend(cells[number..].iter().map(|cell| (cell.name(), "stopped".to_owned())));
                break;
            }
            if let Some((_, first)) = runs.first() {
                shown.push(Shown { name: cell.name(), png: file(&first.png)? });
                outcomes.push(outcome(cell, &runs, halves)?);
            }
        }
        Ok((outcomes, shown, missing))
    }

    /// The two halves, read or rendered, and their origin; `None` where the user stopped it.
    fn reference(&self, console: &Console) -> Result<Option<(Halves, String)>> {
        let size = self.loaded.size;
        if let (Some(first), Some(second)) = (&self.args.reference, &self.args.second_half) {
            let read = |path: &Path| -> Result<Vec<f32>> {
                let (found, values) = read_picture(path, "beauty")?;
                if found != size {
                    bail!(
                        "{} has {} x {} pixels and the renders {} x {}: give --resolution, or another reference",
                        path.display(),
                        found.0,
                        found.1,
                        size.0,
                        size.1
                    );
                }
                Ok(values)
            };
            let values = [read(first)?, read(second)?];
            let png = self.runs.join(REFERENCE_PNG);
            self.write_png(&png, &values[0])?;
            return Ok(Some((
                Halves { size, values, png: file(&png)? },
                "two halves that were given".to_owned(),
            )));
        }
        let share = self.args.time_budget.map(|budget| budget / 5);
        let time = self.args.reference_time.or(share).unwrap_or(Duration::from_secs(120));
        let limit = format!("{:.3}s", time.as_secs_f64());
        let options: Vec<String> = match self.args.reference_by {
            ReferenceBy::Progressive => {
                ["--integrator", "progressive", "--target-error", "0.002", "--time-limit", &limit]
            }
            ReferenceBy::Path => ["--integrator", "path", "--spp", "65536", "--time-limit", &limit],
        }
        .map(str::to_owned)
        .to_vec();
        let mut values = Vec::new();
        for (done, seed) in REFERENCE_SEEDS.into_iter().enumerate() {
            let files = self.files(&options, seed);
            if !files.stats.exists() && self.render(&options, seed, &files)?.is_none() {
                return Ok(None);
            }
            values.push((read_picture(&files.exr, "beauty")?.1, file(&files.png)?));
            console.advance(done as u64 + 1);
        }
        let origin = match self.args.reference_by {
            ReferenceBy::Progressive => "progressive rendering",
            ReferenceBy::Path => "path tracing",
        };
        let Ok([(first, png), (second, _)]) = <[_; 2]>::try_from(values) else { return Ok(None) };
        let origin = format!("two halves by {origin}, {limit} at most for each");
        Ok(Some((Halves { size, values: [first, second], png }, origin)))
    }

    fn write_png(&self, path: &Path, values: &[f32]) -> Result<()> {
        let film = &self.loaded.built.film;
        let given = film.exposure.map(|stops| stops + film.white);
        let tone = cardioid::film::ToneMap {
            exposure: given.or_else(|| cardioid::film::auto_exposure(values)).unwrap_or_default(),
            curve: cardioid::film::ToneCurve::None,
        };
        let (width, height) = self.loaded.size;
        image_io::write_png(path, width, height, image_io::PngPixels::Rgb8(&tone.to_srgb8(values)))?;
        Ok(())
    }

    /// File names of a run: a hash of everything that the run depends on.
    fn files(&self, options: &[String], seed: u64) -> Files {
        let Loaded { size, hash, .. } = self.loaded;
        let key = serde_json::json!([
            env!("CARGO_PKG_VERSION"),
            hash,
            size,
            self.args.scene.threads,
            options,
            seed
        ]);
        let name = blake3::hash(key.to_string().as_bytes()).to_hex()[..20].to_owned();
        let file = |extension| self.runs.join(&name).with_extension(extension);
        Files { exr: file("exr"), png: file("png"), stats: file("json") }
    }

    /// Renders in a separate process, so that its memory and time can be measured separately. `None` where the user stopped it.
    fn render(&self, options: &[String], seed: u64, files: &Files) -> Result<Option<Run>> {
        if interrupted().is_some() {
            return Ok(None);
        }
        let SceneArgs { scene, set, up, threads, memory_limit, texture_memory, .. } = &self.args.scene;
        let (width, height) = self.loaded.size;
        let mut command = Command::new(&self.program);
        command.arg("render").arg(scene).args(options);
        set.iter().for_each(|(name, value)| {
            command.arg("--set").arg(format!("{name}={value}"));
        });
        if let Some(up) = up {
            command.args(["--up", up]);
        }
        command.args(["--resolution", &format!("{width}x{height}"), "--threads", &threads.to_string()]);
        // The picture depends on neither limit.
        command.args(["--texture-memory", &format!("{texture_memory}B")]);
        if let Some(limit) = memory_limit {
            command.args(["--memory-limit", &format!("{limit}B")]);
        }
        command.args(["--seed", &seed.to_string(), "--beauty-only", "--quiet"]);
        command.arg("--output").arg(&files.exr).arg("--stats").arg(&files.stats);
        // Files of an earlier run under these names may be replaced, whatever their content; a reference that the user gave may
        // not.
        let given = [&self.args.reference, &self.args.second_half];
        let mut outputs = Outputs::new(given.into_iter().flatten().map(PathBuf::as_path));
        for file in [&files.exr, &files.png, &files.stats] {
            outputs.add(file, "a run", Named::ByUser)?;
        }
        // It ends when this process ends, for whatever reason.
        command.args(["--overwrite", "--end-with-input"]);
        let log = files.stats.with_extension("log");
        let said = fs::File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(said);
        let mut child = command.spawn().context("cannot start a render")?;
        let status = loop {
            if interrupted().is_some() {
                // It may have received the signal as well and have ended.
                let _ = child.kill();
                child.wait().context("cannot wait for a render")?;
                let _ = fs::remove_file(&files.stats);
                return Ok(None);
            }
            if self.args.time_budget.is_some_and(|budget| self.start.elapsed() > budget) {
                let _ = child.kill();
                child.wait().context("cannot wait for a render")?;
                let _ = fs::remove_file(&files.stats);
                bail!("it took longer than what was left of the time");
            }
            if let Some(status) = child.try_wait().context("cannot wait for a render")? {
                break status;
            }
            thread::sleep(Duration::from_millis(20));
        };
        let said = fs::read_to_string(&log).unwrap_or_default();
        let _ = fs::remove_file(&log);
        if !status.success() {
            bail!(
                "{}",
                said.lines().find_map(|line| line.strip_prefix("error: ")).unwrap_or("the render failed")
            );
        }
        self.read(files).map(Some)
    }

    fn read(&self, files: &Files) -> Result<Run> {
        let text = fs::read_to_string(&files.stats).with_context(|| files.stats.display().to_string())?;
        let stats: Value = serde_json::from_str(&text).with_context(|| files.stats.display().to_string())?;
        let number = |field: &str| stats["process"][field].as_f64();
        let maps = stats["maps"].as_array().into_iter().flatten();
        Ok(Run {
            wall: number("wall").unwrap_or(f64::NAN),
            cpu: number("cpu").unwrap_or(f64::NAN),
            memory: stats["process"]["peak_memory"].as_u64(),
            photons: maps.filter_map(|map| map["photons"].as_u64()).sum(),
        })
    }
}

fn file(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Upper bound on the seconds for one picture of a cell, from the point where it starts.
fn expected_seconds(cell: &Cell, outcomes: &[Outcome]) -> f64 {
    /// Largest ratio of the times of a preset and the preset before it.
    const LONGER: f64 = 6.0;
    let rank = |quality: Quality| {
        [Quality::Draft, Quality::Preview, Quality::Final]
            .iter()
            .position(|&known| known == quality)
            .unwrap_or(3)
    };
    let mut points = outcomes.iter().rev().filter(|other| other.cell.step.is_none());
    match (&cell.step, cell.base) {
        (Some(step), base) => points.find(|o| o.cell.base == base).map_or(0.0, |o| o.wall * step.cost),
        (None, Base::Rounds(n)) => {
            let one = points.find_map(|o| match o.cell.base {
                Base::Rounds(m) => Some(o.wall / m as f64),
                Base::Preset(_) => None,
            });
            one.map_or(0.0, |one| one * n as f64)
        }
        (None, Base::Preset(quality)) => {
            let known = points.find_map(|o| match o.cell.base {
                Base::Preset(known) => Some((rank(known), o.wall)),
                Base::Rounds(_) => None,
            });
            known.map_or(0.0, |(below, wall)| wall * LONGER.powi(rank(quality) as i32 - below as i32))
        }
    }
}

fn outcome(cell: &Cell, runs: &[(Run, Files)], halves: &Halves) -> Result<Outcome> {
    let mut pictures = Vec::new();
    for (_, files) in runs {
        pictures.push(read_picture(&files.exr, "beauty")?);
    }
    let views: Vec<Picture<'_>> = pictures
        .iter()
        .map(|((width, height), values)| Picture::new(*width, *height, values))
        .collect::<Result<_, _>>()?;
    let median = |get: fn(&Run) -> f64| {
        let mut values: Vec<f64> = runs.iter().map(|(run, _)| get(run)).collect();
        values.sort_by(f64::total_cmp);
        let (low, high) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
        0.5 * (low + high)
    };
    Ok(Outcome {
        cell: cell.clone(),
        seeds: runs.len() as u64,
        wall: median(|run| run.wall),
        cpu: median(|run| run.cpu),
        memory: runs.iter().filter_map(|(run, _)| run.memory).max(),
        photons: runs.iter().map(|(run, _)| run.photons).max().unwrap_or(0),
        compared: figures(&views, halves.views()?)?,
    })
}
