//! Bindings to the Embree 4 that is installed, generated from its own headers.
//!
//! Names are those of C; the manual is <https://github.com/RenderKit/embree>. C enums are structs around an integer, with
//! a constant for each known value, as a library newer than the headers may return others.
//!
//! Written by hand here is only what bindgen cannot see: macros with a cast and inline functions. Those are
//! [`RTC_INVALID_GEOMETRY_ID`] and the `rtcInit*` functions, which became constructors:
//! [`RTCRayQueryContext::new`], [`RTCIntersectArguments::new`], [`RTCOccludedArguments::new`].
#![allow(unsafe_code, reason = "declares a C interface")]

#[allow(
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    unreachable_pub,
    rustdoc::all,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    reason = "generated from C"
)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

use std::ffi::c_uint;
use std::ops::{BitAnd, BitOr};
use std::ptr;

pub use bindings::*;

/// The id that means "none": of a geometry, of a primitive of it, or of an instance.
///
/// A ray's `hit.geomID` must be set to it before a query, and still is when nothing was hit.
pub const RTC_INVALID_GEOMETRY_ID: c_uint = c_uint::MAX;

impl RTCRayQueryContext {
    /// A context outside of all instances, as `rtcInitRayQueryContext` makes it.
    #[must_use]
    pub const fn new() -> Self {
        Self { instID: [RTC_INVALID_GEOMETRY_ID], instPrimID: [RTC_INVALID_GEOMETRY_ID] }
    }
}

impl Default for RTCRayQueryContext {
    fn default() -> Self {
        Self::new()
    }
}

impl RTCIntersectArguments {
    /// Incoherent rays, all features, no callbacks, as `rtcInitIntersectArguments` makes them.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            flags: RTC_RAY_QUERY_FLAG_INCOHERENT,
            feature_mask: RTC_FEATURE_FLAG_ALL,
            context: ptr::null_mut(),
            filter: None,
            intersect: None,
        }
    }
}

impl Default for RTCIntersectArguments {
    fn default() -> Self {
        Self::new()
    }
}

impl RTCOccludedArguments {
    /// Incoherent rays, all features, no callbacks, as `rtcInitOccludedArguments` makes them.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            flags: RTC_RAY_QUERY_FLAG_INCOHERENT,
            feature_mask: RTC_FEATURE_FLAG_ALL,
            context: ptr::null_mut(),
            filter: None,
            occluded: None,
        }
    }
}

impl Default for RTCOccludedArguments {
    fn default() -> Self {
        Self::new()
    }
}

/// Union and intersection of the bits of a C enum of flags.
macro_rules! flags {
    ($($name:ident),*) => {$(
        impl BitOr for $name {
            type Output = Self;
            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }

        impl BitAnd for $name {
            type Output = Self;
            fn bitand(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }
        }
    )*};
}

flags!(RTCSceneFlags, RTCRayQueryFlags, RTCFeatureFlags);
