//! A small C interface to the OpenImageIO that is installed, 2.4 or later.
//!
//! OpenImageIO speaks C++, whose classes and exceptions cannot cross into Rust. So `shim/shim.cpp` wraps what is needed of
//! it in `extern "C"` functions that catch every exception, and this crate is generated from `shim/shim.h`.
//!
//! The shim is a shared library that the crate carries as bytes. [`shim`] opens it, and OpenImageIO with it, when it is
//! asked for the first time. So a program starts without OpenImageIO, and there is no file beside it to be lost: it may be
//! copied anywhere on a machine that has OpenImageIO.
#![allow(unsafe_code, reason = "opens a C interface")]

use std::fmt;
use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::path::Path;
use std::sync::OnceLock;

#[allow(
    missing_docs,
    missing_debug_implementations,
    non_camel_case_types,
    non_upper_case_globals,
    unreachable_pub,
    unsafe_op_in_unsafe_fn,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    reason = "generated from C"
)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

pub use bindings::*;

impl fmt::Debug for Shim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Shim")
    }
}

/// The compiled shim.
const LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/liboiio_shim.so"));

static SHIM: OnceLock<Result<Shim, String>> = OnceLock::new();

/// The functions of the shim. The first call loads OpenImageIO, which takes some tenths of a second; calls of other
/// threads wait for it.
///
/// # Errors
/// What the loader says, where OpenImageIO or something it needs is missing.
pub fn shim() -> Result<&'static Shim, &'static str> {
    SHIM.get_or_init(load).as_ref().map_err(String::as_str)
}

/// Why [`shim`] failed; `None` where it did not, or was not called yet.
pub fn load_failure() -> Option<&'static str> {
    SHIM.get().and_then(|loaded| loaded.as_ref().err()).map(String::as_str)
}

fn load() -> Result<Shim, String> {
    // A file in memory needs no folder; a system may forbid to run one, as it may for the folder of temporary files.
    in_memory().or_else(|first| {
        in_folder().map_err(|second| if first == second { first } else { format!("{first}; {second}") })
    })
}

fn in_memory() -> Result<Shim, String> {
    let told = |error: io::Error| format!("no file in memory: {error}");
    let file = rustix::fs::memfd_create("oiio_shim", rustix::fs::MemfdFlags::CLOEXEC);
    let mut file = File::from(file.map_err(|error| told(error.into()))?);
    file.write_all(LIBRARY).map_err(told)?;
    open(format!("/proc/self/fd/{}", file.as_raw_fd()).as_ref())
}

fn in_folder() -> Result<Shim, String> {
    let told = |error: io::Error| format!("no temporary file: {error}");
    let mut file = tempfile::Builder::new().prefix("oiio_shim").suffix(".so").tempfile().map_err(told)?;
    file.write_all(LIBRARY).map_err(told)?;
    open(file.path())
}

fn open(path: &Path) -> Result<Shim, String> {
    // SAFETY: the file holds the shim as this crate's build linked it, with the functions of the header that the bindings
    // were generated from. Its own initialisation and that of OpenImageIO need nothing from this program.
    unsafe { Shim::new(path) }.map_err(|error| error.to_string())
}
