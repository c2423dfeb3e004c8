//! Irradiance caching: irradiance computed at few places and interpolated between them (Ward, Rubinstein & Clear, "A
//! Ray Tracing Solution for Diffuse Interreflection", SIGGRAPH 1988; Ward & Heckbert, "Irradiance Gradients",
//! Eurographics Rendering Workshop 1992), as in section 4.4 of Jensen 1996 on Lambertian surfaces.
//!
//! A cache is filled in batches. The candidates of a batch are looked up in parallel in a cache that does not change
//! meanwhile. Those to compute are chosen one by one in their order ([`Filling::choose`]), computed in parallel and
//! inserted ([`Filling::accept`]), so the result does not depend on the threads. Rendering only reads the cache. The
//! radiance along a ray of a hemisphere comes from a closure, so this module depends on no integrator.
// A new variant of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod hemisphere;
mod irradiance;
mod neighbours;
mod octree;

pub use hemisphere::{Hemisphere, Irradiance, Seen};
pub use irradiance::{CacheSettings, Filling, IrradianceCache, Place, Record};
