//! `cardioid bricks`: brick maps of irradiance from a photon atlas, and what they hold.

use super::outputs::Outputs;
use super::picture::{Loaded, SceneArgs, load};
use super::progress::{Console, catch_interrupts, interrupted};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, bail};
use cardioid::bricks::BrickLevel;
use cardioid::render::{AtlasDescription, BrickRequest, Settings, build_irradiance_atlas};
use cardioid::scene_file::photon_content_hash;
use clap::Args;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Build brick maps of irradiance from the photon atlas of a scene, for `render --atlas`, or show what they hold
#[derive(Args, Clone, Debug)]
pub(crate) struct BricksArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// Folder of the atlas: the photons that `cardioid photons --atlas` wrote are read there, and brick maps are written beside them.
    #[arg(long, value_name = "FOLDER")]
    atlas: PathBuf,

    /// Only show what the brick maps of the folder hold, level by level: nothing is built.
    #[arg(long)]
    inspect: bool,

    /// With --inspect, print JSON.
    #[arg(long, requires = "inspect")]
    json: bool,

    /// Photons in an estimate of irradiance and area.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = nearest)]
    nearest: u32,

    /// A brick is left out where no voxel differs from the next coarser one by more than this share; 0 keeps all.
    #[arg(long, value_name = "SHARE", default_value_t = 0.03, value_parser = max_error)]
    max_error: f32,

    /// Also write the discs that brick maps are built from, as PLY files in this folder: position, normal, radius, irradiance.
    #[arg(long, value_name = "FOLDER")]
    discs: Option<PathBuf>,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

fn nearest(text: &str) -> Result<u32, String> {
    cardioid::settings::count_within(text, 2, 100_000).map(|count| count as u32)
}

fn max_error(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("write a share from 0 to 1, for example 0.03".to_owned()),
    }
}

pub(crate) fn run(args: &BricksArgs) -> Result<ExitCode> {
    if args.inspect {
        return inspect(args);
    }
    catch_interrupts();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    if let Some(folder) = args.discs.as_ref().filter(|folder| !folder.is_dir()) {
        bail!("{}: there is no such folder; make it first", folder.display());
    }
    let outputs = Outputs::new([args.scene.scene.as_path()]);
    let console = Console::new(args.quiet, None);
    pool.install(|| {
        // Before the scene is read, which may take longer.
        AtlasDescription::of_photons(&args.atlas)?;
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
        console.finish();
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            say!("stopped while the scene was read and built: no file was written");
            return Ok(ExitCode::from(code));
        }
        let Loaded { description, built, .. } = loaded?;
        let settings = Settings::from(&args.settings.over(&description.render));
        let hash = photon_content_hash(&description).context("cannot hash the scene")?;
        let BricksArgs { nearest, max_error, discs, .. } = args.clone();
        let request = BrickRequest { nearest, max_error, discs };
        let made =
            build_irradiance_atlas(&built.scene, (&hash, &settings), &args.atlas, &request, &console)?;
        console.finish();
        let (Some((atlas, report)), None) = (made, interrupted()) else {
            say!("stopped before all brick maps were built: they cannot be used; build them again");
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        };
        if !args.quiet {
            let sum = |of: fn(&cardioid::render::AtlasGroup) -> u64| atlas.groups.iter().map(of).sum::<u64>();
            say!(
                "{} bricks in {} maps, {:.1} MB, of {} discs at {} photons; {} left out; at most {} in memory at once; irradiance {:.1} s, \
                 bricks {:.1} s",
                sum(|group| group.bricks),
                atlas.groups.iter().filter(|group| group.bricks > 0).count(),
                report.bytes as f64 / 1e6,
                sum(|group| group.discs),
                atlas.photons,
                report.eliminated,
                report.most_open,
                report.seconds_irradiance,
                report.seconds_bricks
            );
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// A brick map, for `--json`.
#[derive(Serialize)]
struct Inspected {
    name: String,
    photons: u64,
    discs: u64,
    bytes: u64,
    levels: Vec<BrickLevel>,
}

fn inspect(args: &BricksArgs) -> Result<ExitCode> {
    let maps = inspected(&args.atlas)?;
    if args.json {
        super::print(&format!("{}\n", serde_json::to_string_pretty(&maps)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut out = String::new();
    let total = |of: fn(&BrickLevel) -> u64| maps.iter().flat_map(|map| &map.levels).map(of).sum::<u64>();
    for map in &maps {
        writeln!(
            out,
            "{}: {} photons, {} discs, {:.2} MB",
            map.name,
            map.photons,
            map.discs,
            map.bytes as f64 / 1e6
        )?;
        writeln!(out, "  level   bricks   leaves  voxel [m]       bytes   voxels  fill [%]")?;
        for (number, level) in map.levels.iter().enumerate() {
            let BrickLevel { bricks, leaves, voxel, bytes, voxels, fill_percent, .. } = level;
            writeln!(
                out,
                "  {number:5} {bricks:8} {leaves:8} {voxel:10.4} {bytes:11} {voxels:8} {fill_percent:9.1}"
            )?;
        }
    }
    let bricks = total(|level| level.bricks);
    writeln!(
        out,
        "{} maps, {bricks} bricks, {:.2} MB, {:.1} % of voxels filled",
        maps.len(),
        maps.iter().map(|map| map.bytes).sum::<u64>() as f64 / 1e6,
        100.0 * total(|level| level.voxels) as f64 / (bricks.max(1) * 512) as f64
    )?;
    super::print(&out)?;
    Ok(ExitCode::SUCCESS)
}

fn inspected(folder: &Path) -> Result<Vec<Inspected>> {
    let atlas = AtlasDescription::of_bricks(folder)?;
    let maps = atlas.open_bricks(folder)?;
    let mut all = Vec::new();
    for (group, map) in atlas.groups.iter().zip(maps) {
        let Some(map) = map else { continue };
        let levels = map.inspect(atlas.unit)?;
        let (photons, discs, bytes) = (group.photons, group.discs, map.file_bytes);
        all.push(Inspected { name: group.name.clone(), photons, discs, bytes, levels });
    }
    Ok(all)
}
