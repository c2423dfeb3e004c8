//! The scene as the integrators see it: immutable, in render space, shared by all threads.

mod contact;
mod crossings;
mod illuminated;
mod interfaces;
mod layered;
mod material;
mod misfits;
mod parts;
mod plan;
mod reach;
mod render_space;
#[allow(clippy::module_inception, reason = "the room's main type")]
mod scene;
mod shading;
mod surface;
mod texture;
mod touching;

pub use crate::settings::{GuideKind, IntegratorKind, MapKind, ShadowMode};
pub use contact::Borders;
pub use crossings::Crossings;
pub use illuminated::{IlluminatedShape, IlluminationKernel};
pub use interfaces::CameraMedia;
pub use layered::{AlphaCutout, Coverage, LayeredMaterial, Painted, glow_of};
pub use material::{Material, Tangent};
pub use parts::{Geometry, LightNote, Mesh, Node, SceneParts, Surface, Target};
pub use plan::{Decision, RenderPlan};
pub use render_space::RenderSpace;
pub use scene::{LightMedia, Scene};
pub use shading::Shading;
pub use surface::{DiffuseHit, HitPoint, Placement, SurfaceInteraction, shadow_target};
pub use texture::{Bump, MaterialTexture};
