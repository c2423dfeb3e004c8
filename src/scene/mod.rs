//! The scene as the integrators see it: immutable, in render space, shared by all threads.

mod contact;
mod crossings;
mod illuminated;
mod layered;
mod material;
mod misfits;
mod plan;
mod render_space;
mod shading;
mod surface;
mod texture;
mod touching;
mod world;

pub use crate::settings::{GuideKind, IntegratorKind, MapKind, ShadowMode};
pub use contact::Borders;
pub use crossings::Crossings;
pub use illuminated::{IlluminatedShape, IlluminationKernel};
pub use layered::{AlphaCutout, Coverage, LayeredMaterial, Painted, glow_of};
pub use material::{Material, Tangent};
pub use plan::{Decision, RenderPlan};
pub use render_space::RenderSpace;
pub use shading::Shading;
pub use surface::{DiffuseHit, HitPoint, Placement, SurfaceInteraction, shadow_target};
pub use texture::{Bump, MaterialTexture};
pub use world::{Geometry, LightMedia, LightNote, Mesh, Node, Scene, SceneParts, Surface, Target};
