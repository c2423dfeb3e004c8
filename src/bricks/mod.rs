//! Brick maps: irradiance on surfaces as a tiled MIP map in three dimensions, read from disk piece by piece (Christensen & Batali, "An
//! Irradiance Atlas for Global Illumination in Complex Production Scenes", EGSR 2004).
//!
//! Oriented discs with irradiance ([`Disc`]) become a sparse octree with a brick of 8^3 voxels at each node ([`build_bricks`]), which is
//! written to a file ([`write_brick_file`]) and read through a cache of limited size ([`IrradianceAtlas`]).
// A new variant of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod atlas;
mod brick;
mod build;
mod cache;
mod clip;
mod disc;
mod file;
mod look_up;
mod map;
mod spool;
#[cfg(test)]
mod tests;

pub use atlas::{AtlasCounts, IrradianceAtlas};
pub use brick::{Brick, VOXELS};
pub use build::{BrickParams, BuiltBricks, build_bricks};
pub use cache::{BrickCounters, BrickReader};
pub use disc::{Disc, write_discs_as_ply};
pub use file::{BRICK_FILE_VERSION, BrickFileError, BrickFileProblem, BrickOwner, write_brick_file};
pub use look_up::Found;
pub use map::{BrickLevel, BrickMap};
