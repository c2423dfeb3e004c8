//! Content hashes of scenes: over all files of a scene, and over the part that photons depend on.

use super::description::{
    DensityDescription, FillDescription, GeometryDescription, LightDescription, MediumDescription, Named,
    SceneDescription, ShapeDescription,
};
use super::gltf::{further_files, is_gltf_file};
use super::mesh_scene::{MESH_SCENE, MESH_SCENE_NAME};
use super::mitsuba::is_mitsuba_file;
use super::obj::material_files;
use super::pbrt::is_pbrt_file;
use crate::files::open_regular;
use std::fmt::{self, Write};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Hash of everything that a scene is read from, in hexadecimal: its text, the values of its parameters, and its mesh files. The
/// same content gives the same hash, wherever the files are.
///
/// # Errors
/// Where a file can no longer be read.
pub fn content_hash(scene: &SceneDescription, parameters: &[(String, String)]) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    if scene.location.file.as_os_str() == MESH_SCENE_NAME {
        hasher.update(MESH_SCENE.as_bytes());
    } else {
        hasher.update_reader(open_regular(&*scene.location.file)?.0)?;
    }
    for (name, value) in parameters {
        // Lengths come first, so that different lists of parameters cannot produce the same bytes.
        hasher.update(&(name.len() as u64).to_le_bytes()).update(name.as_bytes());
        hasher.update(&(value.len() as u64).to_le_bytes()).update(value.as_bytes());
    }
    hash_files(scene, &mut hasher)?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Hash of everything in a scene that photons depend on, in hexadecimal: shapes and their mesh files, materials, textures, media
/// and lights. It does not cover the camera (but for its place where a medium fills the scene), the picture, settings, names, or places in
/// the file.
///
/// # Errors
/// Where a mesh file can no longer be read.
pub fn photon_content_hash(scene: &SceneDescription) -> io::Result<String> {
    let is_gltf = is_gltf_file(&scene.location.file);
    if is_gltf || is_mitsuba_file(&scene.location.file) || is_pbrt_file(&scene.location.file) {
        // The file, the files that it names, and its parameters determine everything.
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(open_regular(&*scene.location.file)?.0)?;
        for (name, value) in &scene.parameters {
            hasher.update(&(name.len() as u64).to_le_bytes()).update(name.as_bytes());
            hasher.update(&(value.len() as u64).to_le_bytes()).update(value.as_bytes());
        }
        // The guesses about it count as well.
        for note in scene.notes.iter().filter(|_| is_gltf) {
            hasher.update(&(note.message.len() as u64).to_le_bytes()).update(note.message.as_bytes());
        }
        hash_files(scene, &mut hasher)?;
        return Ok(hasher.finalize().to_hex().to_string());
    }
    // All fields are listed, so that a new one does not compile until its effect on photons is considered.
    let SceneDescription {
        name: _,
        location: _,
        camera,
        film: _,
        render: _,
        warnings: _,
        notes: _,
        media,
        textures,
        materials,
        looks,
        shapes,
        groups,
        instances,
        lights,
        light_photons,
        // Covered by `hash_files`.
        further_files: _,
        // Their effects are in the other fields.
        parameters: _,
    } = scene;
    let mut hasher = blake3::Hasher::new();
    // Numbers print as the shortest text that parses to the same number, so different numbers print differently.
    let mut out = Hashing(&mut hasher);
    let written = (|| {
        writeln!(out, "media {}", media.len())?;
        media.iter().try_for_each(|medium| write_medium(&mut out, &medium.value))?;
        // What fills the scene ends behind the camera.
        if media.iter().any(|medium| fills_scene(&medium.value)) {
            writeln!(out, "eye {:?}", camera.as_ref().map(|camera| camera.eye))?;
        }
        values(&mut out, "textures", textures)?;
        values(&mut out, "materials", materials)?;
        writeln!(out, "looks {looks:?} groups {}", groups.len())?;
        values(&mut out, "instances", instances)?;
        values(&mut out, "lights", lights)?;
        writeln!(out, "photons {light_photons:?} shapes {}", shapes.len())?;
        shapes.iter().try_for_each(|shape| write_shape(&mut out, &shape.value))
    })();
    written.map_err(io::Error::other)?;
    hash_files(scene, &mut hasher)?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// A writer whose text goes into a hash.
struct Hashing<'a>(&'a mut blake3::Hasher);

impl Write for Hashing<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

fn values<T: fmt::Debug>(out: &mut impl Write, what: &str, things: &[Named<T>]) -> fmt::Result {
    writeln!(out, "{what} {}", things.len())?;
    things.iter().try_for_each(|thing| writeln!(out, "{:?}", thing.value))
}

fn fills_scene(medium: &MediumDescription) -> bool {
    medium.volume.as_ref().is_some_and(|volume| matches!(volume.fills, FillDescription::Scene { .. }))
}

/// Writes a medium without the path of its file of voxels, whose content [`hash_files`] covers.
fn write_medium(out: &mut impl Write, medium: &MediumDescription) -> fmt::Result {
    let mut medium = medium.clone();
    let density = medium.volume.as_mut().map(|volume| &mut volume.density);
    if let Some(DensityDescription::Vdb { file, .. }) = density {
        *file = PathBuf::new();
    }
    writeln!(out, "{medium:?}")
}

/// Writes a shape without the path of its mesh file, whose content [`hash_files`] covers.
fn write_shape(out: &mut impl Write, shape: &ShapeDescription) -> fmt::Result {
    let ShapeDescription {
        geometry,
        transform,
        flip_normal,
        material,
        caustic_photons,
        emission,
        displacement,
        group,
        // The photon file holds the photons themselves.
        illumination: _,
    } = shape;
    match geometry {
        GeometryDescription::MeshFile { path: _, normals, own_materials, replaced, fit } => {
            write!(out, "file {normals:?} {own_materials} {fit:?}")?;
            if !replaced.is_empty() {
                write!(out, " {replaced:?}")?;
            }
        }
        other => write!(out, "{other:?}")?,
    }
    writeln!(
        out,
        " {transform:?} {flip_normal} {material} {caustic_photons:?} {emission:?} {displacement:?} {group:?}"
    )
}

/// Adds the length and the content of a regular file.
fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> io::Result<()> {
    let (file, length) = open_regular(path)?;
    hasher.update(&length.to_le_bytes());
    // No more than the length, because some system files never end.
    hasher.update_reader(file.take(length))?;
    Ok(())
}

/// A file that a scene is read from.
struct ReadFile {
    path: PathBuf,
    /// Whether the scene loads without it, with a warning: a material file, or a picture that a material file names.
    is_optional: bool,
}

/// The files that a scene names, in the order of their use: meshes, material files, pictures, buffers, photometric files, voxels.
///
/// Files that a mesh names and that cannot be read are left out; the reader of the mesh reports them.
fn named_files(scene: &SceneDescription) -> Vec<ReadFile> {
    let needed = |path: &PathBuf| ReadFile { path: path.clone(), is_optional: false };
    let mut files: Vec<ReadFile> = scene.further_files.iter().map(needed).collect();
    for shape in &scene.shapes {
        if let GeometryDescription::MeshFile { path, own_materials, .. } = &shape.value.geometry {
            files.push(needed(path));
            if is_gltf_file(path) {
                files.extend(further_files(path).iter().map(needed));
            } else if *own_materials {
                let materials = material_files(path).unwrap_or_default().into_iter();
                files.extend(materials.map(|path| ReadFile { path, is_optional: true }));
            }
        }
    }
    for light in &scene.lights {
        if let LightDescription::EnvironmentMap { image: path, .. }
        | LightDescription::Profile { file: path, .. } = &light.value
        {
            files.push(needed(path));
        }
    }
    for medium in &scene.media {
        let density = medium.value.volume.as_ref().map(|volume| &volume.density);
        if let Some(DensityDescription::Vdb { file, .. }) = density {
            files.push(needed(file));
        }
    }
    files
}

/// All existing files that a scene is read from: its own text, and the files that it names. An output must not replace any of
/// them.
pub fn files_of_scene(scene: &SceneDescription) -> Vec<PathBuf> {
    let own = Some(&*scene.location.file).filter(|file| file.as_os_str() != MESH_SCENE_NAME);
    let named = named_files(scene).into_iter().map(|file| file.path);
    own.cloned().into_iter().chain(named).collect()
}

/// Adds the content of all files that a scene names.
fn hash_files(scene: &SceneDescription, hasher: &mut blake3::Hasher) -> io::Result<()> {
    for ReadFile { path, is_optional } in named_files(scene) {
        match hash_file(hasher, &path) {
            Ok(()) => {}
            // The picture is rendered without its materials as well, with a warning.
            Err(_) if is_optional => {
                hasher.update(b"no file");
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse_scene;
    use std::path::Path;

    const SCENE: &str = "[camera]\neye = [0, 1, 5]\nat = [0, 0, 0]\n\n[materials.grey]\ntype = \"lambert\"\n\
        reflectance = [0.5, 0.5, 0.5]\n\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1.0\nmaterial = \"grey\"\n\n\
        [[lights]]\ntype = \"point\"\nposition = [0, 5, 0]\nintensity = [10, 10, 10]\n";

    fn hash(text: &str) -> String {
        let scene = parse_scene(text, Path::new("a.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
        photon_content_hash(&scene).unwrap()
    }

    #[test]
    fn only_what_photons_depend_on_changes_their_hash() {
        let plain = hash(SCENE);
        for (from, to) in [
            ("eye = [0, 1, 5]", "eye = [2, 1, 5]\nfov = 20.0"),
            ("[camera]", "# moved\n\n[film]\nwidth = 100\nheight = 50\n[camera]"),
            ("[camera]", "[render]\nspp = 7\n[camera]"),
            ("grey", "gray"),
        ] {
            assert!(SCENE.contains(from));
            assert_eq!(hash(&SCENE.replace(from, to)), plain, "{to}");
        }
        for (from, to) in [
            ("radius = 1.0", "radius = 1.0000000000000002"),
            ("center = [0, 0, 0]", "center = [-0.0000001, 0, 0]"),
            ("[0.5, 0.5, 0.5]", "[0.5, 0.5, 0.6]"),
            ("intensity = [10,", "intensity = [11,"),
            ("material = \"grey\"", "material = \"grey\"\nflip-normal = true"),
        ] {
            assert!(SCENE.contains(from));
            assert_ne!(hash(&SCENE.replace(from, to)), plain, "{to}");
        }
    }
}
