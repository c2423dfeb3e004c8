//! The scene around a mesh that is rendered by itself: `scenes/mesh.toml`, built into the program.

use super::description::SceneDescription;
use super::diagnostic::SceneFileError;
use super::parse::parse_scene;
use std::path::Path;

/// Extensions of the mesh files that can be read.
pub const MESH_EXTENSIONS: &[&str] = &["ply", "obj", "stl"];

/// The text of `scenes/mesh.toml`.
pub(super) const MESH_SCENE: &str = include_str!("../../scenes/mesh.toml");

/// Name of that text in messages.
pub const MESH_SCENE_NAME: &str = "mesh.toml (built in)";

/// Whether a file is a mesh, by its extension.
pub fn is_mesh_file(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    MESH_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// The scene for a single mesh: the mesh in the lengths of its file on the ground, under sun and sky, with a camera that sees all
/// of it, or a camera inside where the mesh is a room. `parameters` are those of `scenes/mesh.toml`; `mesh` is this file, and
/// `materials` is `one` where only `material` is given. Messages name the scene after the mesh.
///
/// # Errors
/// As [`super::load_scene`].
pub fn mesh_scene(mesh: &Path, parameters: &[(String, String)]) -> Result<SceneDescription, SceneFileError> {
    let mut parameters = parameters.to_vec();
    let is_set = |name: &str| parameters.iter().any(|(set, _)| set == name);
    if is_set("material") && !is_set("materials") {
        parameters.push(("materials".into(), "one".into()));
    }
    parameters.push(("mesh".into(), mesh.to_string_lossy().into_owned()));
    let mut description = parse_scene(MESH_SCENE, Path::new(MESH_SCENE_NAME), &parameters)?;
    description.name = mesh.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(description)
}
