//! Embree behind safe Rust: devices, scenes that are immutable once committed, and user geometry.
//!
//! Together with `image_io` the only room with `unsafe` code.

mod procedural;

pub use procedural::{Procedural, SurfacePoint};
