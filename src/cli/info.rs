//! `cardioid info`: the contents of a scene and the plan for rendering it.

use super::contents::Contents;
use super::media_info::{DescribedMedium, describe_media};
use super::outputs::{Named, Outputs};
use super::picture::{SceneArgs, describe_camera, load};
use super::settings::SettingsArgs;
use anyhow::{Result, bail};
use cardioid::image_io::{self, PngPixels};
use cardioid::photons::projection_picture;
use cardioid::render::{Settings, Silent};
use cardioid::scene::{Material, RenderPlan, Scene};
use cardioid::scene_file::SceneWarning;
use clap::Args;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Show what a scene holds, and what would be built for it and why
#[derive(Args, Clone, Debug)]
pub(crate) struct InfoArgs {
    #[command(flatten)]
    scene: SceneArgs,

    #[command(flatten)]
    settings: SettingsArgs,

    /// Write pictures of what each light sees into this folder: casters of caustics, other objects, nothing.
    #[arg(long, value_name = "FOLDER")]
    projection_maps: Option<PathBuf>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A material and its description.
#[derive(Serialize)]
struct DescribedMaterial {
    name: String,
    kind: String,
}

/// The output of `--json`.
#[derive(Serialize)]
struct Described<'a> {
    scene: &'a str,
    camera: String,
    materials: Vec<DescribedMaterial>,
    media: Vec<DescribedMedium>,
    #[serde(flatten)]
    contents: Contents,
    /// What was guessed or approximated as the file was read.
    notes: Vec<String>,
    warnings: Vec<String>,
    settings: &'a Settings,
    plan: &'a RenderPlan,
}

pub(crate) fn run(args: &InfoArgs) -> Result<ExitCode> {
    let mut outputs = Outputs::new([args.scene.scene.as_path()]);
    let loaded = load(&args.scene, &outputs, &Silent, &|| ())?;
    loaded.print_notes();
    let settings = Settings::from(&args.settings.over(&loaded.description.render));
    let scene = &loaded.built.scene;
    let plan = settings.plan(scene);
    if let Some(folder) = &args.projection_maps {
        if !folder.is_dir() {
            bail!("{}: there is no such folder; make it first", folder.display());
        }
        let files = projection_map_files(scene, folder);
        for file in &files {
            outputs.add(file, "a projection map", Named::ByUs)?;
        }
        outputs.check_scene(&loaded.description)?;
        write_projection_maps(scene, &files)?;
    }
    let contents = Contents::of(&loaded.description, scene);
    let mut out = String::new();
    if args.json {
        let described = |(name, material): &(String, Material)| DescribedMaterial {
            name: name.clone(),
            kind: material.describe(scene.media()),
        };
        let materials = scene.materials().iter().map(described).collect();
        let media = describe_media(scene);
        let told = |warnings: &[SceneWarning]| warnings.iter().map(SceneWarning::to_string).collect();
        let value = Described {
            scene: scene.name(),
            camera: describe_camera(&loaded.built.view),
            materials,
            media,
            contents,
            notes: told(&loaded.built.notes),
            warnings: told(&loaded.built.warnings),
            settings: &settings,
            plan: &plan,
        };
        super::print(&format!("{}\n", serde_json::to_string_pretty(&value)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    writeln!(out, "{}", scene.name())?;
    writeln!(out, "  picture    {} x {} pixels", loaded.size.0, loaded.size.1)?;
    writeln!(out, "  camera     {}", describe_camera(&loaded.built.view))?;
    let radius = scene.space().metres(f64::from(scene.bounds().1));
    writeln!(out, "  extent     radius {radius:.4} m around {:.4} m", scene.space().center)?;
    writeln!(out, "  geometry   {}", plan.geometry.join(", "))?;
    contents.write_lights(&mut out)?;
    for (name, material) in scene.materials() {
        writeln!(out, "  material   {name}: {}", material.describe(scene.media()))?;
    }
    for medium in describe_media(scene) {
        writeln!(out, "  medium     {}", medium.in_words())?;
    }
    contents.write_rest(&mut out)?;
    write_contacts(&mut out, scene)?;
    writeln!(out, "  Embree     {}", loaded.device.version())?;
    writeln!(out, "plan")?;
    for (name, decision) in plan.decisions() {
        writeln!(out, "  {name:24} {decision}")?;
    }
    writeln!(out, "settings")?;
    // Numbers are converted by way of text, which has the shortest form that reads as the same number: 0.2, and not
    // 0.20000000298.
    if let serde_json::Value::Object(values) = serde_json::from_str(&serde_json::to_string(&settings)?)? {
        for (name, value) in values {
            writeln!(out, "  {name:24} {value}")?;
        }
    }
    super::print(&out)?;
    Ok(ExitCode::SUCCESS)
}

/// A number with four significant digits.
pub(super) fn four_digits(x: f64) -> String {
    let rounded: f64 = format!("{x:.3e}").parse().unwrap_or(x);
    if rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) {
        rounded.to_string()
    } else {
        format!("{x:.3e}")
    }
}

/// Writes the surfaces that touch, in one line that lists at most `SHOWN` pairs.
fn write_contacts(out: &mut impl Write, scene: &Scene) -> Result<()> {
    const SHOWN: usize = 8;
    let touching = scene.touching();
    if touching.is_empty() {
        return Ok(());
    }
    let name = |id: u32| &scene.surfaces()[id as usize].name;
    let shown = touching.iter().take(SHOWN).map(|&[a, b]| match a == b {
        true => format!("{} within itself", name(a)),
        false => format!("{} and {}", name(a), name(b)),
    });
    let more = touching.len().saturating_sub(SHOWN);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    let gap = scene.space().metres(f64::from(scene.contact_distance()));
    let shown = shown.collect::<Vec<_>>().join(", ");
    writeln!(
        out,
        "  contact    {shown}{more}: no air between (for a gap, move them apart by more than {gap:.1e} m)"
    )?;
    Ok(())
}

/// The PNG file of each light, named by the light's number and name.
fn projection_map_files(scene: &Scene, folder: &Path) -> Vec<PathBuf> {
    let file = |light: usize| {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let name: String = scene.light_note(light).name.chars().take(64).map(plain).collect();
        folder.join(format!("{light}-{name}.png"))
    };
    (0..scene.lights().len()).map(file).collect()
}

fn write_projection_maps(scene: &Scene, files: &[PathBuf]) -> Result<()> {
    for (light, file) in files.iter().enumerate() {
        let picture = projection_picture(scene, light);
        image_io::write_png(file, picture.width, picture.height, PngPixels::Rgb8(&picture.pixels))?;
        say!("wrote {}", file.display());
    }
    Ok(())
}
