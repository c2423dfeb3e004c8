//! Embree behind safe Rust: devices, scenes that are immutable once committed, and user geometry.
//!
//! Together with `image_io` the only room with `unsafe` code. What the border guarantees:
//!
//! - Handles are released exactly once, after everything that was made from them.
//! - Buffers that Embree reads in place are owned by the scene that reads them, with the padding it asks for, and
//!   their indices are checked before Embree sees them.
//! - A panic in a [`Procedural`] never unwinds into C: the primitive is missed and the panic counted.
//! - A committed scene cannot change, so any number of threads may trace rays in it.
#![allow(unsafe_code, reason = "calls a C library")]

mod all_hits;
mod callbacks;
mod cutout;
mod device;
mod packets;
mod procedural;
mod scene;
mod triangles;

pub use all_hits::AllHits;
pub use cutout::Cutout;
pub use device::{Device, EmbreeError, Isa, LibraryVersion};
pub use procedural::{NearEdge, ObjectHit, Procedural, SurfacePoint};
pub use scene::{CommittedScene, GeometryId, RawHit, SceneBuilder};
pub use triangles::{TriangleBuffers, TriangleError};
