//! `cardioid bench bvh`: Embree against BVHs written in Rust, on a mesh and the rays of its picture.

use super::bench_caustic;
use super::outputs::{Named, Outputs};
use super::picture::shorter;
use super::progress::Console;
use anyhow::{Context, Result, anyhow, bail};
use cardioid::embree::Device;
use cardioid::image_io;
use cardioid::measure::bvh::{BvhBenchSettings, BvhReport, bench_bvh};
use cardioid::render::Observer;
use cardioid::scene_file::{build_scene, is_mesh_file, mesh_scene};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Measure parts of the program on this machine
#[derive(Args, Clone, Debug)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand, Clone, Debug)]
enum What {
    Bvh(BvhArgs),
    Caustic(bench_caustic::CausticArgs),
}

/// Embree against the Rust crates bvh and obvhs: building, memory, rays per second, right and wrong hits
#[derive(Args, Clone, Debug)]
struct BvhArgs {
    /// Meshes: .ply, .obj or .stl.
    #[arg(value_name = "MESH", required = true)]
    meshes: Vec<PathBuf>,

    /// Folder for NAME.md, NAME.svg and NAME.json of each mesh.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,

    /// Rays of each kind, at most.
    #[arg(long, default_value_t = BvhBenchSettings::default().rays, value_parser = at_least_one)]
    rays: usize,

    /// Runs, in turns; the median counts.
    #[arg(long, default_value_t = BvhBenchSettings::default().runs, value_parser = at_least_one)]
    runs: usize,

    /// Rays of each kind whose hits are checked in double precision.
    #[arg(long, default_value_t = BvhBenchSettings::default().checked, value_parser = from_zero)]
    check: usize,

    /// Threads of the parallel runs; 0 means one for each core.
    #[arg(long, default_value_t = 0, value_parser = super::picture::threads)]
    threads: usize,

    /// Axis of the files that points up: y or z.
    #[arg(long, default_value = "y", value_parser = ["y", "z"])]
    up: String,

    /// No progress bar.
    #[arg(short, long)]
    quiet: bool,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if (1..=100_000_000).contains(&number) => Ok(number),
        _ => Err("write a whole number from 1 to 100000000".to_owned()),
    }
}

fn from_zero(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if number <= 100_000_000 => Ok(number),
        _ => Err("write a whole number from 0 to 100000000".to_owned()),
    }
}

pub(crate) fn run(args: &BenchArgs) -> Result<ExitCode> {
    let args = match &args.what {
        What::Bvh(args) => args,
        What::Caustic(args) => return bench_caustic::run(args),
    };
    for mesh in &args.meshes {
        if !is_mesh_file(mesh) {
            bail!("{}: not a mesh by its name, which ends in .ply, .obj or .stl", mesh.display());
        }
    }
    let mut names: Vec<_> = args.meshes.iter().map(|mesh| mesh.file_stem()).collect();
    names.sort();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]).filter(|_| args.output.is_some()) {
        let name = twice[0].unwrap_or_default().to_string_lossy();
        bail!("two meshes are named {name}, and their files would be too; measure them one by one");
    }
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut outputs = Outputs::new(args.meshes.iter().map(PathBuf::as_path));
    for (mesh, folder) in args.meshes.iter().zip(args.output.iter().cycle()) {
        for (_, path) in report_files(folder, &stem(mesh)) {
            outputs.add(&path, "the report", Named::ByUser)?;
        }
    }
    if cfg!(not(feature = "bvh-bench")) {
        say!("note: built without the feature bvh-bench: Embree alone is measured");
    }
    for mesh in &args.meshes {
        let report = measure(args, mesh, &outputs)?;
        super::print(&format!("{}\n", report.to_markdown()))?;
        if let Some(folder) = &args.output {
            write(folder, &stem(mesh), &report)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn measure(args: &BvhArgs, mesh: &Path, outputs: &Outputs) -> Result<BvhReport> {
    if !mesh.exists() {
        bail!("there is no mesh file {}; check its name", mesh.display());
    }
    let parameters = [("up".to_owned(), args.up.clone())];
    let description = mesh_scene(mesh, &parameters).map_err(|error| anyhow!("{error}"))?;
    outputs.check_scene(&description)?;
    let device = Arc::new(Device::new(args.threads).context("cannot trace rays")?);
    // Square, like the pixels for which rays are recorded.
    let built = build_scene(&description, &device, (512, 512)).map_err(|error| shorter(error, true))?;
    for warning in &built.warnings {
        say!("warning: {}: {}", mesh.display(), warning.message);
    }
    let settings = BvhBenchSettings {
        rays: args.rays,
        runs: args.runs,
        checked: args.check,
        threads: args.threads,
        ..BvhBenchSettings::default()
    };
    let console = Console::new(args.quiet, None);
    let report = bench_bvh(&built.scene, &built.camera, &settings, &|step, done, total| {
        console.begin(step, total);
        console.advance(done);
    });
    console.finish();
    report.with_context(|| mesh.display().to_string())
}

fn stem(mesh: &Path) -> String {
    mesh.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Report files for a mesh of this name, by extension.
fn report_files(folder: &Path, name: &str) -> [(&'static str, PathBuf); 3] {
    ["md", "svg", "json"].map(|extension| (extension, folder.join(format!("{name}.{extension}"))))
}

fn write(folder: &Path, name: &str, report: &BvhReport) -> Result<()> {
    for (extension, path) in report_files(folder, name) {
        let text = match extension {
            "md" => report.to_markdown(),
            "svg" => report.to_svg(),
            _ => serde_json::to_string_pretty(report)? + "\n",
        };
        image_io::write_text(&path, &text)?;
        say!("wrote {}", path.display());
    }
    Ok(())
}
