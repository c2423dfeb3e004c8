//! `cardioid bake`: a radiosity solution as a model whose vertices have its colours, for programs that show it without computing light.

use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, load};
use super::pictures::stops;
use super::progress::{Console, catch_interrupts, interrupted};
use super::radiosity::{SolverArgs, summary};
use anyhow::{Context, Result, bail};
use cardioid::image_io;
use cardioid::math::{Rgb, luminance};
use cardioid::radiosity::{BakedMesh, Radiosity, read_radiosity, write_glb, write_radiosity};
use cardioid::render::allowed_memory;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the light of a radiosity solution as vertex colours of a glTF model
#[derive(Args, Clone, Debug)]
pub(crate) struct BakeArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// Model to write (.glb). Default: the scene's name in this folder.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Replace a file under the default name whoever wrote it; otherwise only one that cardioid wrote is replaced.
    #[arg(long)]
    overwrite: bool,

    /// Exposure of the colours in stops. Default: one at which 99 % of the area is not cut.
    #[arg(long, value_name = "STOPS", value_parser = stops)]
    exposure: Option<f64>,

    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    solver: SolverArgs,
}

pub(crate) fn run(args: &BakeArgs) -> Result<ExitCode> {
    catch_interrupts();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let output = match &args.output {
        Some(output) => output.clone(),
        None => PathBuf::from(args.scene.scene.file_stem().unwrap_or_default()).with_extension("glb"),
    };
    if output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("glb")) {
        bail!("{}: the name of a model ends in .glb", output.display());
    }
    let named = if args.output.is_some() { Named::ByUser } else { Named::ByUs };
    let mut outputs = Outputs::new([args.scene.scene.as_path()]).overwriting(args.overwrite);
    outputs.add(&output, "the model", named)?;
    if let Some(solution) = &args.solver.solution {
        outputs.add(solution, "--solution", Named::ByUser)?;
    }
    let console = Console::new(args.quiet, None);
    pool.install(|| {
        let known = args.solver.solution.as_deref().filter(|path| path.exists());
        let saved = known.map(read_radiosity).transpose()?;
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
        console.finish();
        let stopped = |code| {
            say!("stopped before the solution was found: no file was written");
            Ok(ExitCode::from(code))
        };
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            return stopped(code);
        }
        let Loaded { built, .. } = loaded?;
        let options = args.solver.options(args.seed);
        let allowed = allowed_memory(args.scene.memory_limit);
        let solution = Radiosity::compute(&built.scene, &options, saved, allowed, &console);
        console.finish();
        if let (Err(_), Some(code)) = (&solution, interrupted()) {
            return stopped(code);
        }
        let solution = solution?;
        if let Some(path) = &args.solver.solution {
            image_io::write_bytes(path, |out| write_radiosity(out, &solution))?;
        }
        let meshes = solution.baked(&built.scene);
        let scale = args.exposure.map_or_else(|| bright(&meshes), |stops| stops.exp2() as f32);
        image_io::write_bytes(&output, |out| write_glb(out, &meshes, scale))?;
        if !args.quiet {
            summary(solution.report());
            let count = |of: fn(&BakedMesh) -> usize| meshes.iter().map(of).sum::<usize>();
            say!(
                "{} vertices, {} triangles; radiance times {scale:.4} is the colour",
                count(|mesh| mesh.positions.len()),
                count(|mesh| mesh.triangles.len())
            );
            say!("wrote {}", output.display());
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// The factor on radiance at which a hundredth of the area is brighter than white.
fn bright(meshes: &[BakedMesh]) -> f32 {
    const CUT: f64 = 0.01;
    let mut all: Vec<(f32, f64)> = Vec::new();
    for mesh in meshes {
        for &[a, b, c] in &mesh.triangles {
            let [p, q, r] = [a, b, c].map(|vertex| mesh.positions[vertex as usize]);
            let colour: Rgb = [a, b, c].map(|vertex| mesh.radiance[vertex as usize]).iter().sum();
            let area = f64::from((q - p).cross(r - p).length());
            all.push((colour.max_element().max(luminance(colour)) / 3.0, area));
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut left = CUT * all.iter().map(|(_, area)| area).sum::<f64>();
    for (radiance, area) in all {
        left -= area;
        if left <= 0.0 && radiance > 0.0 {
            return 1.0 / radiance;
        }
    }
    1.0
}
