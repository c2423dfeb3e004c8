//! The scene as the integrators see it: immutable, in render space, shared by all threads.

mod material;
mod plan;
mod render_space;
mod surface;
mod world;

pub use material::Material;
pub use plan::{Decision, IntegratorKind, MapKind, RenderPlan};
pub use render_space::RenderSpace;
pub use surface::{DiffuseHit, HitPoint, Placement, Shading, SurfaceInteraction, shadow_target};
pub use world::{Geometry, LightNote, Mesh, Node, Scene, SceneParts, Surface, Target};
