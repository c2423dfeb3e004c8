//! `cardioid bench caustic`: density estimates along a line through a caustic, compared with the exact solution.

use super::outputs::{Named, Outputs};
use super::progress::Console;
use anyhow::{Context, Result, anyhow};
use cardioid::embree::Device;
use cardioid::image_io;
use cardioid::measure::caustics::caustic_figure;
use cardioid::scene_file::load_scene;
use cardioid::settings::count;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Photon maps and illumination maps against the exact caustic of a mirror (figure 8 of Jensen & Christensen 1995)
#[derive(Args, Clone, Debug)]
pub(super) struct CausticArgs {
    /// scenes/mirror-square.toml.
    #[arg(value_name = "SCENE")]
    scene: PathBuf,

    /// Caustic photons of each map.
    #[arg(long, value_name = "N", default_value = "100k", value_parser = count)]
    photons: u64,

    /// Plot to write.
    #[arg(short, long, value_name = "FILE.svg")]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &CausticArgs) -> Result<ExitCode> {
    let mut outputs = Outputs::new([args.scene.as_path()]);
    if let Some(output) = &args.output {
        outputs.add(output, "the plot", Named::ByUser)?;
    }
    let description = load_scene(&args.scene, &[]).map_err(|error| anyhow!("{error}"))?;
    outputs.check_scene(&description)?;
    let device = Arc::new(Device::new(0).context("cannot trace rays")?);
    let console = Console::new(false, None);
    let figure = caustic_figure(&description, &device, args.photons, &console);
    console.finish();
    let figure = figure?;
    super::print(&figure.to_markdown())?;
    if let Some(output) = &args.output {
        image_io::write_text(output, &figure.to_svg())?;
    }
    Ok(ExitCode::SUCCESS)
}
