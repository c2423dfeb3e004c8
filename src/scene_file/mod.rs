//! From files to a scene: the text of a scene file to a [`SceneDescription`], meshes to triangles, and both to a
//! [`crate::scene::Scene`] in render space.

mod description;
pub mod mesh;
pub mod ply;

pub use description::*;
