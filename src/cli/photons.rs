//! `cardioid photons`: pass 1 alone. It writes the photon maps into a file that any number of renders can read.

use super::outputs::{Named, Outputs};
use super::picture::{Loaded, SceneArgs, load};
use super::progress::{Console, catch_interrupts, interrupted};
use super::settings::SettingsArgs;
use anyhow::{Context, Result, bail};
use cardioid::image_io;
use cardioid::render::{
    AtlasDescription, AtlasParams, PassOne, Settings, trace_photon_atlas, trace_photon_maps,
    write_photon_maps,
};
use cardioid::scene_file::photon_content_hash;
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Trace photons into a file, for `render --photon-map`: from another camera, in another size, again
#[derive(Args, Clone, Debug)]
pub(crate) struct PhotonsArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// File to write. Default: the scene's name in this folder, with .photons.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Write a photon atlas into this folder instead: the photons of each group of objects in a file of its own, on disk while they are
    /// traced, so that there may be more of them than memory. For `cardioid bricks`.
    #[arg(long, value_name = "FOLDER", conflicts_with = "output")]
    atlas: Option<PathBuf>,

    /// With --atlas, groups at most: where a scene has more objects, neighbours share a group.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = groups, requires = "atlas")]
    groups: usize,

    /// With --atlas, memory for photons while they are sorted. No bit depends on it.
    #[arg(long, value_name = "BYTES", default_value = "64MB", value_parser = cardioid::settings::memory, requires = "atlas")]
    sort_memory: u64,

    /// Replace a file under the default name whoever wrote it; otherwise only one that cardioid wrote is replaced.
    #[arg(long)]
    overwrite: bool,

    /// No progress bars and no summary.
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    settings: SettingsArgs,
}

fn groups(text: &str) -> Result<usize, String> {
    cardioid::settings::count_within(text, 1, 1024).map(|count| count as usize)
}

pub(crate) fn run(args: &PhotonsArgs) -> Result<ExitCode> {
    catch_interrupts();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.scene.threads)
        .build()
        .context("cannot start the threads")?;
    let output = match &args.output {
        Some(output) => output.clone(),
        None => PathBuf::from(args.scene.scene.file_stem().unwrap_or_default()).with_extension("photons"),
    };
    if let Some(folder) = &args.atlas {
        return atlas(args, folder, &pool);
    }
    let named = if args.output.is_some() { Named::ByUser } else { Named::ByUs };
    let mut outputs = Outputs::new([args.scene.scene.as_path()]).overwriting(args.overwrite);
    outputs.add(&output, "the photon map", named)?;
    let console = Console::new(args.quiet, None);
    pool.install(|| {
        console.busy("reading and building the scene");
        let loaded = load(&args.scene, &outputs, &console, &|| console.finish());
        console.finish();
        if let (Err(_), Some(code)) = (&loaded, interrupted()) {
            say!("stopped while the scene was read and built: no file was written");
            return Ok(ExitCode::from(code));
        }
        let Loaded { description, built, estimate, .. } = loaded?;
        let settings = Settings::from(&args.settings.over(&description.render));
        if let Some(medium) = built.scene.media().iter().find(|medium| medium.volume.is_some()) {
            bail!("the medium `{}` scatters light: photon maps hold no light in media", medium.name);
        }
        // Without a limit, the pass itself checks the free memory before it traces photons.
        if let Some(limit) = args.scene.memory_limit {
            estimate.with_photons(&settings, &settings.plan(&built.scene), &built.scene).check(Some(limit))?;
        }
        let (pass, plan) = trace_photon_maps(&built.scene, &settings, &console)?;
        console.finish();
        for warning in &pass.warnings {
            say!("warning: {warning}");
        }
        if let Some(code) = interrupted() {
            say!("stopped before all photons were traced: no file was written");
            return Ok(ExitCode::from(code));
        }
        if pass.statistics.is_empty() {
            bail!(
                "this scene needs no photon map: nothing shines in it, or nothing diffuse is there to be lit ({})",
                plan.global_map
            );
        }
        let hash = photon_content_hash(&description).context("cannot hash the scene")?;
        image_io::write_bytes(&output, |out| {
            write_photon_maps(out, &built.scene, &hash, &settings, (&pass, &plan))
        })?;
        if !args.quiet {
            summary(&pass);
            say!("wrote {}", output.display());
        }
        Ok(ExitCode::SUCCESS)
    })
}

/// Traces photons into an atlas.
fn atlas(args: &PhotonsArgs, folder: &Path, pool: &rayon::ThreadPool) -> Result<ExitCode> {
    let outputs = Outputs::new([args.scene.scene.as_path()]);
    let console = Console::new(args.quiet, None);
    pool.install(|| {
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
        if let Ok(other) = AtlasDescription::of_photons(folder)
            && !(other.is_of(&hash) || args.overwrite)
        {
            bail!(
                "{} holds the photons of another scene, `{}`; name another folder, or add --overwrite",
                folder.display(),
                other.scene
            );
        }
        // Photons twice, while two sorted halves become one.
        let in_memory = (args.sort_memory / 40) as usize;
        let params = AtlasParams { groups: args.groups, in_memory };
        let traced = trace_photon_atlas(&built.scene, (&hash, &settings), folder, params, &console)?;
        console.finish();
        let (Some(atlas), None) = (traced, interrupted()) else {
            say!("stopped before all photons were traced: there is no new atlas in {}", folder.display());
            return Ok(interrupted().map_or(ExitCode::FAILURE, ExitCode::from));
        };
        if !args.quiet {
            say!(
                "{} photons of {} emitted, in {} groups of objects: {}",
                atlas.photons,
                atlas.emitted,
                atlas.groups.len(),
                folder.display()
            );
        }
        Ok(ExitCode::SUCCESS)
    })
}

fn summary(pass: &PassOne) {
    for map in &pass.statistics {
        let name = serde_json::to_value(map.map).ok().and_then(|value| value.as_str().map(str::to_owned));
        say!(
            "{} map: {} photons of {} emitted, {:.1} MB, {:.2} s",
            name.unwrap_or_default(),
            map.photons,
            map.emitted,
            map.bytes as f64 / 1e6,
            map.seconds_tracing + map.seconds_building
        );
    }
}
