//! From files to a scene: the text of a scene file to a [`SceneDescription`], meshes to triangles, and both to a
//! [`crate::scene::Scene`] in render space.

mod build;
mod camera;
mod colour_text;
mod colours;
mod description;
mod diagnostic;
mod directions;
mod enclosure;
pub mod generate;
mod gltf;
mod hash;
pub mod ies;
mod import;
mod keyed;
mod memory;
pub mod mesh;
mod mesh_file;
mod mesh_scene;
mod mesh_size;
mod mitsuba;
pub mod obj;
mod parameters;
mod parse;
mod pbrt;
pub mod ply;
pub mod polygon;
mod reader;
mod room;
mod stl;
mod synonyms;
mod weld;

pub use build::{BuildError, BuildProblem, BuiltScene, build_scene, build_scene_watched};
pub use description::*;
pub use diagnostic::{Diagnostic, SceneFileError};
pub use gltf::{
    GLTF_EXTENSIONS, GltfError, GltfProblem, gltf_scene, gltf_scene_within, is_gltf_file, parse_gltf_bytes,
};
pub use hash::{content_hash, files_of_scene, photon_content_hash};
pub use ies::{IesError, IesFile, parse_ies_bytes, read_ies};
pub use mesh_file::{MeshFileError, MeshPlace, MeshReading, read_mesh_file, read_mesh_file_with};
pub use mesh_scene::{MESH_EXTENSIONS, MESH_SCENE_NAME, is_mesh_file, mesh_scene};
pub use mesh_size::{MeshSize, kept_textures, mesh_sizes};
pub use mitsuba::{
    MITSUBA_EXTENSIONS, is_mitsuba_file, mitsuba_scene, mitsuba_scene_within, parse_mitsuba_bytes,
};
pub use parse::{MAX_TEXT_BYTES, load_scene, parse_scene};
pub use pbrt::{PBRT_EXTENSIONS, is_pbrt_file, parse_pbrt_bytes, pbrt_scene, pbrt_scene_within};
pub use room::Choice;
pub use stl::{parse_stl_bytes, read_stl};
