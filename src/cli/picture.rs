//! Options shared by the commands that read a scene, and how they read it.

use super::outputs::Outputs;
use super::upright::note_of_axis;
use anyhow::{Context, Result, anyhow, bail};
use cardioid::embree::{Device, Isa};
use cardioid::film::PixelRect;
use cardioid::media::AIR;
use cardioid::render::{MemoryEstimate, Observer, allowed_memory};
use cardioid::scene_file::{
    BuildError, BuiltScene, CameraDescription, FilmDescription, FilterDescription, SceneDescription,
    SceneWarning, build_scene_watched, content_hash, gltf_scene_within, is_gltf_file, is_mesh_file,
    is_mitsuba_file, is_pbrt_file, load_scene, mesh_scene, mitsuba_scene_within, pbrt_scene_within,
};
use cardioid::textures::{set_picture_memory, set_texture_memory};
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;

/// Which scene, and what of it.
#[derive(Args, Clone, Debug)]
pub(crate) struct SceneArgs {
    /// Scene file (TOML), a glTF file (.gltf, .glb), a scene of Mitsuba (.xml) or pbrt (.pbrt), or a mesh alone (.ply, .obj, .stl): it stands on the ground in sun and sky.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,

    /// Value of one of the scene's parameters; paths are relative to the current folder (of Mitsuba's, to the scene's).
    #[arg(short = 'D', long = "set", value_name = "NAME=VALUE", value_parser = name_and_value)]
    pub(crate) set: Vec<(String, String)>,

    /// Axis of a mesh alone that points up: y (the default) or z.
    #[arg(long, value_name = "AXIS", value_parser = ["y", "z"])]
    pub(crate) up: Option<String>,

    /// Size of the picture, over that of the scene file.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    pub(crate) resolution: Option<(u32, u32)>,

    /// Threads; 0 means one for each core. The picture does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub(crate) threads: usize,

    /// Instruction set of Embree's kernels: sse4.2, avx2 or avx512. Default: the widest that this machine has.
    ///
    /// Another set gives another picture of the same quality. With one that all machines have, all give the same bits.
    #[arg(long, value_name = "SET", value_parser = isa)]
    pub(crate) isa: Option<Isa>,

    /// Memory that may be taken, for example 8GB: what is foreseen to take more is refused before it is read or traced.
    ///
    /// Without it the limit is what the machine has free.
    #[arg(long, value_name = "BYTES", value_parser = cardioid::settings::memory)]
    pub(crate) memory_limit: Option<u64>,

    /// Memory for the pictures of one mesh file: those that do not fit are kept in a temporary file and read by tiles where they
    /// are looked at, of which a quarter of this is kept, at least 16MB. The picture does not depend on it.
    #[arg(long, value_name = "BYTES", default_value = "1GB", value_parser = cardioid::settings::memory)]
    pub(crate) texture_memory: u64,
}

fn name_and_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("write NAME=VALUE, for example --set mesh=bunny.ply".to_owned()),
    }
}

/// Upper bound on the number of threads: more threads than cores slow a machine down, and thousands bring it to a halt.
const MOST_THREADS: usize = 1024;

pub(crate) fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(threads) if threads <= MOST_THREADS => Ok(threads),
        _ => Err(format!("write a whole number from 1 to {MOST_THREADS}, or 0 for one thread for each core")),
    }
}

fn isa(text: &str) -> Result<Isa, String> {
    match Isa::from_name(text) {
        Ok(isa) if isa != Isa::Best => Ok(isa),
        _ => Err(format!("this machine has {}", Isa::available_names())),
    }
}

fn resolution(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parts {
        Some((w, h)) if (1..=65_536).contains(&w) && (1..=65_536).contains(&h) => Ok((w, h)),
        _ => Err("write WIDTHxHEIGHT in pixels, each from 1 to 65536, for example 1280x960".to_owned()),
    }
}

/// Parses a window `x0,y0,x1,y1`.
pub(crate) fn crop(text: &str) -> Result<PixelRect, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(PixelRect { x0, y0, x1, y1 }),
        _ => Err("write X0,Y0,X1,Y1 in pixels with X0 < X1 and Y0 < Y1; row 0 is on top".to_owned()),
    }
}

/// A scene that was read and built.
pub(crate) struct Loaded {
    /// Its scene file.
    path: PathBuf,
    pub(crate) description: SceneDescription,
    pub(crate) built: BuiltScene,
    pub(crate) device: Arc<Device>,
    pub(crate) size: (u32, u32),
    /// Hash of everything that the scene was read from.
    pub(crate) hash: String,
    /// Memory estimate without photons.
    pub(crate) estimate: MemoryEstimate,
}

/// Reads and builds a scene. Warnings go to standard error, after a call of `when_built`. `observer` follows the work and may
/// cancel it; the error then carries no information. Nothing is built where one of `outputs` would replace a file that the scene
/// is read from.
pub(crate) fn load(
    args: &SceneArgs,
    outputs: &Outputs,
    observer: &dyn Observer,
    when_built: &dyn Fn(),
) -> Result<Loaded> {
    // Textures keep at most a quarter of the allowed memory; the rest is read by tiles.
    set_texture_memory(args.texture_memory.min(args.memory_limit.map_or(u64::MAX, |limit| limit / 4)));
    if let Some(allowed) = allowed_memory(args.memory_limit) {
        set_picture_memory(allowed.saturating_sub(MemoryEstimate::default().peak()));
    }
    // The messages of scene files begin with the place, so no context is put in front of them.
    let is_mesh = is_mesh_file(&args.scene);
    if is_mesh && !args.scene.exists() {
        bail!("there is no mesh file {}; check its name", args.scene.display());
    }
    let description = match (is_mesh, args.up.as_deref()) {
        (true, up) => {
            let up = up.map(|up| ("up".to_owned(), up.to_owned()));
            let parameters: Vec<_> = args.set.iter().cloned().chain(up).collect();
            mesh_scene(&args.scene, &parameters)
        }
        (false, None) if is_gltf_file(&args.scene) => {
            let allow = |estimate: &MemoryEstimate| estimate.check(args.memory_limit);
            let scene = gltf_scene_within(&args.scene, &args.set, &allow);
            let scene = scene?;
            if scene.shapes.is_empty() {
                bail!("{}: its scene has no triangles: there is nothing to render", args.scene.display());
            }
            Ok(scene)
        }
        (false, None) if is_mitsuba_file(&args.scene) => {
            let allow = |estimate: &MemoryEstimate| estimate.check(args.memory_limit);
            mitsuba_scene_within(&args.scene, &args.set, &allow)
        }
        (false, None) if is_pbrt_file(&args.scene) => {
            if let Some((name, _)) = args.set.first() {
                bail!("{}: a scene of pbrt has no parameters to set, and no `{name}`", args.scene.display());
            }
            let allow = |estimate: &MemoryEstimate| estimate.check(args.memory_limit);
            pbrt_scene_within(&args.scene, &allow)
        }
        (false, None) => load_scene(&args.scene, &args.set),
        (false, Some(_)) if is_gltf_file(&args.scene) => {
            bail!("--up is for a mesh alone: glTF has y up; export the model with that (`+Y Up` in Blender)")
        }
        (false, Some(_)) => bail!("--up is for a mesh alone; a scene file says it by `fit` (`up = \"z\"`)"),
    };
    let description = description.map_err(|error| anyhow!("{error}"))?;
    outputs.check_scene(&description)?;
    let FilmDescription { width, height, .. } = description.film;
    let size = args.resolution.unwrap_or((width, height));
    let estimate = MemoryEstimate::of_scene(&description, size);
    estimate.check(args.memory_limit)?;
    let device = Arc::new(Device::counting_memory_with(args.threads, args.isa).context("cannot trace rays")?);
    let built = build_scene_watched(&description, &device, size, observer);
    when_built();
    let mut built = built.map_err(|error| shorter(error, is_mesh))?;
    built.notes.extend(note_of_medium(&built));
    for warning in &built.warnings {
        match is_mesh {
            true => say!("warning: {}: {}", args.scene.display(), warning.message),
            false => say!("warning: {warning}"),
        }
    }
    let is_free = is_mesh && args.up.is_none() && !args.set.iter().any(|(name, _)| name == "up");
    if let Some(note) = is_free.then(|| note_of_axis(&built.scene)).flatten() {
        say!("{note}");
    }
    let axis = args.up.iter().map(|up| ("--up".to_owned(), up.clone()));
    let parameters: Vec<(String, String)> = args.set.iter().cloned().chain(axis).collect();
    let hash = content_hash(&description, &parameters).context("cannot hash the scene")?;
    Ok(Loaded { path: args.scene.clone(), description, built, device, size, hash, estimate })
}

impl Loaded {
    /// The crop window of the scene, where the picture has the size that the scene gives.
    pub(crate) fn crop(&self) -> Option<PixelRect> {
        let FilmDescription { width, height, crop, .. } = self.description.film;
        crop.filter(|_| self.size == (width, height))
    }

    /// The architecture and the instruction set of Embree's kernels: hits differ in the last bits between instruction sets.
    pub(crate) fn instruction_set(&self) -> String {
        format!("{} {}", std::env::consts::ARCH, self.device.isa().name()).trim_end().to_owned()
    }

    /// Prints the guesses to standard error.
    pub(crate) fn print_notes(&self) {
        for note in &self.built.notes {
            match note.location.line {
                // Notes about other scenes name their place; the notes about a mesh alone have no useful lines.
                1.. if is_mitsuba_file(&self.path) || is_pbrt_file(&self.path) => say!("note: {note}"),
                _ => say!("note: {}: {}", self.path.display(), note.message),
            }
        }
    }
}

/// A note for a camera inside a body. On purpose this is a picture from under water; by mistake the picture is hard to
/// understand.
fn note_of_medium(built: &BuiltScene) -> Option<SceneWarning> {
    let medium = built.scene.medium_at(built.camera.eye()).medium();
    // A camera in fog is no mistake.
    let filling = built.scene.medium(medium);
    if filling.volume.is_some() && filling.ior == 1.0 {
        return None;
    }
    let message = format!(
        "the camera stands inside a body of `{}`, and what it sees is seen through that; where that is not meant, move it out",
        built.scene.medium(medium).name
    );
    (medium != AIR).then(|| SceneWarning { location: built.view.location.clone(), message })
}

/// For a mesh alone, the error omits the place in the built-in scene around it.
pub(crate) fn shorter(error: BuildError, is_mesh: bool) -> anyhow::Error {
    if is_mesh { anyhow::Error::new(error.problem) } else { error.into() }
}

/// Describes the camera in words.
pub(crate) fn describe_camera(camera: &CameraDescription) -> String {
    let at = |p: glam::DVec3| format!("({:.4}, {:.4}, {:.4}) m", p.x, p.y, p.z);
    let lens = camera.lens.map_or(String::new(), |lens| format!(", lens of {:.4} m radius", lens.radius));
    format!("at {}, looking at {}, {}{lens}", at(camera.eye), at(camera.at), camera.describe_projection())
}

/// The film's filter for that of a scene file.
pub(crate) fn filter_of(filter: FilterDescription) -> cardioid::film::Filter {
    use cardioid::film::Filter;
    match filter {
        FilterDescription::Box { radius } => Filter::Box { radius: radius as f32 },
        FilterDescription::Tent { radius } => Filter::Tent { radius: radius as f32 },
        FilterDescription::Gaussian { radius, sigma } => {
            Filter::Gaussian { radius: radius as f32, sigma: sigma as f32 }
        }
        FilterDescription::Mitchell { radius } => Filter::Mitchell { radius: radius as f32 },
    }
}
