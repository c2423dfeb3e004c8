//! `cardioid radiosity`: patches, form factors, their solution, and pictures of it.

use super::outputs::Named;
use super::picture::{Loaded, load};
use super::progress::{catch_interrupts, interrupted};
use super::render::{RenderArgs, deliver, request};
use anyhow::{Context, Result, bail};
use cardioid::image_io;
use cardioid::integrators::RadiosityView;
use cardioid::radiosity::{MOST_STRATA, Radiosity};
use cardioid::radiosity::{
    Method, RadiosityOptions, RadiosityReport, Specular, read_radiosity, write_radiosity,
};
use cardioid::render::{allowed_memory, render_radiosity};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

/// Most patches that may be asked for.
const MOST_PATCHES: u64 = 100_000_000;

/// Solve a diffuse scene by radiosity, and render the solution
#[derive(Args, Clone, Debug)]
pub(crate) struct RadiosityArgs {
    #[command(flatten)]
    render: RenderArgs,

    /// What the picture shows of the solution.
    #[arg(long, value_enum, default_value_t = ViewArg::Final, help_heading = "Radiosity")]
    view: ViewArg,

    #[command(flatten)]
    solver: SolverArgs,
}

/// Options of the solution.
#[derive(Args, Clone, Debug)]
pub(crate) struct SolverArgs {
    /// Largest number of patches, on both sides of all surfaces; each triangle is at least one.
    #[arg(long, value_name = "N", default_value = "20000", value_parser = clap::value_parser!(u64).range(1..=MOST_PATCHES), help_heading = "Radiosity")]
    patches: u64,

    /// How form factors are kept and the equations are solved.
    #[arg(long, value_enum, default_value_t = MethodArg::Hierarchy, help_heading = "Radiosity")]
    method: MethodArg,

    /// Strata along each side of both patches: the fourth power of it is the number of rays between them.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_STRATA)), help_heading = "Radiosity")]
    strata: u32,

    /// What becomes of surfaces that are not diffuse.
    #[arg(long, value_enum, default_value_t = SpecularArg::Refuse, help_heading = "Radiosity")]
    specular: SpecularArg,

    /// Keep the solution in this file. What it holds and still is right is not computed again.
    ///
    /// Another geometry, or other options of patches, start anew; other reflectances and lights solve anew over the same form factors;
    /// another camera renders alone.
    #[arg(long, value_name = "FILE", help_heading = "Radiosity")]
    pub(crate) solution: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MethodArg {
    /// Links between patches of several sizes, placed where the light needs them.
    Hierarchy,
    /// Form factors of all pairs of equal patches: the reference for small scenes.
    Matrix,
    /// Equal patches that shoot their light, without a matrix.
    Shooting,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ViewArg {
    /// Each patch with its own colour.
    Flat,
    /// Colours interpolated between the corners of patches.
    Smooth,
    /// Direct light and mirrors by rays, indirect light interpolated.
    Gather,
    /// Direct light and mirrors by rays, indirect light by gather rays that read the solution.
    Final,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SpecularArg {
    /// The scene is refused.
    Refuse,
    /// They are black in the solution; `--view gather` and `final` show them by rays.
    Absorb,
}

impl SolverArgs {
    /// The options, with this seed.
    pub(crate) fn options(&self, seed: u64) -> RadiosityOptions {
        RadiosityOptions {
            patches: self.patches as usize,
            method: match self.method {
                MethodArg::Hierarchy => Method::Hierarchy,
                MethodArg::Matrix => Method::Matrix,
                MethodArg::Shooting => Method::Shooting,
            },
            strata: self.strata,
            specular: match self.specular {
                SpecularArg::Refuse => Specular::Refuse,
                SpecularArg::Absorb => Specular::Absorb,
            },
            seed,
            ..RadiosityOptions::default()
        }
    }
}

pub(crate) fn run(args: &RadiosityArgs) -> Result<ExitCode> {
    let start = Instant::now();
    catch_interrupts();
    let render = &args.render;
    if let Some(option) = render.option_of_rounds() {
        bail!("{option} belongs to `cardioid render`; leave it out");
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(render.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let (pictures, mut outputs) = render.outputs()?;
    if let Some(solution) = &args.solver.solution {
        outputs.add(solution, "--solution", Named::ByUser)?;
    }
    let console = render.console(None)?;
    pool.install(|| {
        // Before the scene is built, so that a damaged file is reported at once.
        let known = args.solver.solution.as_deref().filter(|path| path.exists());
        let saved = known.map(read_radiosity).transpose()?;
        console.busy("reading and building the scene");
        let loaded = load(&render.scene, &outputs, &console, &|| console.finish());
        console.finish();
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            say!("stopped while the scene was read and built: there is no picture");
            return Ok(ExitCode::from(code));
        }
        let loaded = loaded?;
        let seconds_scene = start.elapsed().as_secs_f64();
        let Loaded { built, .. } = &loaded;
        let request = request(render, &loaded);
        let options = args.solver.options(request.settings.seed);
        let allowed = allowed_memory(render.scene.memory_limit);
        if !render.quiet {
            let bytes = Radiosity::foreseen_bytes(&built.scene, &options)?;
            say!(
                "up to {} patches, whose form factors may take {:.0} MB",
                options.patches,
                bytes as f64 / 1e6
            );
        }
        let solution = Radiosity::compute(&built.scene, &options, saved, allowed, &console);
        console.finish();
        if let (Err(_), Some(code)) = (&solution, interrupted()) {
            say!("stopped before the solution was found: there is no picture");
            return Ok(ExitCode::from(code));
        }
        let solution = Arc::new(solution?);
        if !render.quiet {
            summary(solution.report());
        }
        if let Some(path) = &args.solver.solution {
            image_io::write_bytes(path, |out| write_radiosity(out, &solution))?;
        }
        let view = match args.view {
            ViewArg::Flat => RadiosityView::Flat,
            ViewArg::Smooth => RadiosityView::Smooth,
            ViewArg::Gather => RadiosityView::Gather,
            ViewArg::Final => RadiosityView::Final,
        };
        let rendered = render_radiosity(&built.scene, &built.camera, &request, (solution, view), &console);
        console.finish();
        deliver(render, &loaded, &pictures, rendered?, (start, seconds_scene, request.settings.spp))
    })
}

pub(crate) fn summary(report: &RadiosityReport) {
    let steps = report.steps;
    let factors = match (steps.model, steps.form_factors) {
        (true, n) => format!("{n} form factors computed"),
        (false, 0) => "form factors from the file".to_owned(),
        (false, n) => format!("patches from the file, {n} form factors computed"),
    };
    let solved = if steps.solved { "solved" } else { "solution from the file" };
    say!(
        "{} patches, {} links, {:.0} MB: {factors} in {:.2} s, {solved} in {:.2} s ({} {}), corners in {:.2} s",
        report.patches,
        report.links,
        report.bytes as f64 / 1e6,
        report.seconds_factors,
        report.seconds_solution,
        report.sweeps,
        if report.links > 0 { "sweeps" } else { "patches that shot" },
        report.seconds_corners
    );
    if report.links > 0 {
        say!(
            "sum of the form factors of a lit patch {:.4}, with a standard error of {:.4}",
            report.row_sum,
            report.row_error
        );
    }
    let [emitted, absorbed, escaped] =
        [report.balance.emitted, report.balance.absorbed, report.balance.escaped]
            .map(|rgb| rgb.iter().sum::<f64>());
    if emitted > 0.0 {
        say!(
            "of {emitted:.4} W emitted {:.2} % were absorbed and {:.2} % left the scene",
            100.0 * absorbed / emitted,
            100.0 * escaped / emitted
        );
    }
    if report.degenerate > 0 {
        say!("warning: {} triangles or faces have no area and are no patches", report.degenerate);
    }
}
