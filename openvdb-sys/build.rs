//! Compiles the shim over OpenVDB to a shared library, and generates bindings from the shim's header.
//!
//! Nothing links that library: the crate carries it as bytes and opens it on first use, as `oiio-sys` does. Where OpenVDB's headers
//! are not installed the bytes are none, and opening it says so: everything but volumes in files works without.

use std::env;
use std::path::{Path, PathBuf};

fn main() {
    for file in ["build.rs", "shim/shim.h", "shim/shim.cpp"] {
        println!("cargo::rerun-if-changed={file}");
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let shim = out.join("libopenvdb_shim.so");
    let is_compiled = has_headers(&out) && compile_shim(&shim);
    if !is_compiled {
        println!(
            "cargo::warning=OpenVDB was not found, or cannot be compiled with, so volumes in files cannot be read. Run ./setup.sh at the top \
             of the project and build again."
        );
        // It may come at any time.
        println!("cargo::rerun-if-changed=/usr/include/openvdb/version.h");
        std::fs::write(&shim, []).expect("OUT_DIR is writable");
    }
    bindgen::builder()
        .header("shim/shim.h")
        .allowlist_file("shim/shim.h")
        .size_t_is_usize(true)
        .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: true })
        .prepend_enum_name(false)
        // A structure of function pointers, filled when the library is opened; all or none of them.
        .dynamic_library_name("Shim")
        .dynamic_link_require_all(true)
        .generate()
        .expect("bindgen reads the shim's header")
        .write_to_file(out.join("bindings.rs"))
        .expect("OUT_DIR is writable");
}

fn build() -> cc::Build {
    let mut build = cc::Build::new();
    build.cpp(true).std("c++17").pic(true).cargo_metadata(false);
    build
}

/// True where the compiler finds OpenVDB.
fn has_headers(out: &Path) -> bool {
    let probe = out.join("probe.cpp");
    std::fs::write(&probe, "#include <openvdb/math/Math.h>\n").expect("OUT_DIR is writable");
    build().file(probe).cargo_warnings(false).warnings(false).try_compile_intermediates().is_ok()
}

/// Compiles and links the shim to the shared library `shim`, which names OpenVDB as what it needs. False where that fails.
fn compile_shim(shim: &Path) -> bool {
    let mut build = build();
    // The warnings of OpenVDB's own headers are none of ours. OpenVDB is templates: unoptimised, reading is ten times slower, and
    // compiling no faster.
    build.file("shim/shim.cpp").warnings(false).opt_level(2).debug(false);
    // Halves are converted in place, not by a table of a library that would have to be linked for it.
    build.define("IMATH_HALF_NO_LOOKUP_TABLE", None);
    let Ok(objects) = build.try_compile_intermediates() else { return false };
    let mut linker = build.get_compiler().to_command();
    // With what is missing told here, not when a volume is to be read.
    linker.args(["-shared", "-Wl,-z,defs", "-o"]).arg(shim).args(objects).args(["-lopenvdb", "-ltbb"]);
    linker.status().is_ok_and(|status| status.success())
}
