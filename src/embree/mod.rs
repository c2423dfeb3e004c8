//! Safe wrapper around Embree: devices, scenes that are immutable once committed, and user geometry.
//!
//! This module and `image_io` are the only ones with `unsafe` code. The wrapper guarantees:
//!
//! - Handles are released exactly once, after everything that was created from them.
//! - Buffers that Embree reads in place are owned by the scene that reads them and have the required padding. Their
//!   indices are checked before Embree reads them.
//! - A panic in a [`Procedural`] never unwinds into C: the panic is counted and the primitive is not hit.
//! - A committed scene cannot change, so any number of threads may trace rays in it.
#![allow(unsafe_code, reason = "calls a C library")]

mod all_hits;
mod callbacks;
mod clearance;
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
