//! A small C interface to the OpenImageIO that is installed, 2.4 or later.
//!
//! OpenImageIO speaks C++, whose classes and exceptions cannot cross into Rust. So `shim/shim.cpp` wraps what is needed of
//! it in `extern "C"` functions that catch every exception, and this crate is generated from `shim/shim.h`.
#![allow(unsafe_code, reason = "declares a C interface")]

#[allow(
    missing_docs,
    non_camel_case_types,
    non_upper_case_globals,
    unreachable_pub,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    reason = "generated from C"
)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

pub use bindings::*;
