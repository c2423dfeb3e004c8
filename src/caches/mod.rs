//! Irradiance computed at few places and interpolated between them (Ward, Rubinstein & Clear, "A Ray Tracing Solution for
//! Diffuse Interreflection", SIGGRAPH 1988; Ward & Heckbert, "Irradiance Gradients", Eurographics Rendering Workshop
//! 1992), as section 4.4 of Jensen 1996 has it on Lambertian surfaces.
//!
//! A cache is filled in batches. Candidates of a batch are looked for in parallel in a cache that does not change
//! meanwhile, chosen one by one in their order ([`Filling::choose`]), computed in parallel and taken in
//! ([`Filling::accept`]); what comes of it depends on no thread. Rendering only reads. What a ray of a hemisphere brings
//! comes in as a closure: nothing here knows an integrator.
// A new choice of a setting does not compile until each match says what it means there.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

mod hemisphere;
mod irradiance;
mod neighbours;
mod octree;

pub use hemisphere::{Hemisphere, Irradiance, Seen};
pub use irradiance::{CacheSettings, Filling, IrradianceCache, Place, Record};
