use super::description::{GeometryDescription, SceneDescription};
use super::gltf::{further_files, is_gltf_file};
use super::mesh_scene::{MESH_SCENE, MESH_SCENE_NAME};
use super::obj::material_files;
use std::fs::File;
use std::io;

/// A hash of everything a scene is read from: its text, the values of its parameters and its mesh files, in hexadecimal.
/// The same content gives the same hash, wherever the files are.
///
/// # Errors
/// Where a file cannot be read any more.
pub fn content_hash(scene: &SceneDescription, parameters: &[(String, String)]) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    if scene.location.file.as_os_str() == MESH_SCENE_NAME {
        hasher.update(MESH_SCENE.as_bytes());
    } else {
        hasher.update_reader(File::open(&*scene.location.file)?)?;
    }
    for (name, value) in parameters {
        // Lengths first, so that no two lists of parameters look alike.
        hasher.update(&(name.len() as u64).to_le_bytes()).update(name.as_bytes());
        hasher.update(&(value.len() as u64).to_le_bytes()).update(value.as_bytes());
    }
    for path in &scene.further_files {
        let file = File::open(path)?;
        hasher.update(&file.metadata()?.len().to_le_bytes());
        hasher.update_reader(file)?;
    }
    for shape in &scene.shapes {
        if let GeometryDescription::MeshFile { path, own_materials, .. } = &shape.value.geometry {
            let file = File::open(path)?;
            hasher.update(&file.metadata()?.len().to_le_bytes());
            hasher.update_reader(file)?;
            if is_gltf_file(path) {
                for other in further_files(path) {
                    let file = File::open(other)?;
                    hasher.update(&file.metadata()?.len().to_le_bytes());
                    hasher.update_reader(file)?;
                }
            }
            let libraries =
                if *own_materials && !is_gltf_file(path) { material_files(path)? } else { Vec::new() };
            for library in libraries {
                // Where there is none, the picture has none of its materials either, and a warning.
                match File::open(library) {
                    Ok(file) => {
                        hasher.update(&file.metadata()?.len().to_le_bytes());
                        hasher.update_reader(file)?;
                    }
                    Err(_) => {
                        hasher.update(b"no file");
                    }
                }
            }
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}
