//! Compiles the reader of OpenVDB files, a program that the crate carries as bytes.
//!
//! Where OpenVDB's headers are not installed the bytes are none, and reading a file says so: everything but volumes in files works
//! without.

use std::env;
use std::path::{Path, PathBuf};

fn main() {
    for file in ["build.rs", "reader/reader.cpp"] {
        println!("cargo::rerun-if-changed={file}");
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let reader = out.join("openvdb_reader");
    if !(has_headers(&out) && compile(&reader)) {
        println!(
            "cargo::warning=OpenVDB was not found, or cannot be compiled with, so volumes in files cannot be read. Run ./setup.sh at the top \
             of the project, then `cargo clean -p openvdb-sys`, and build again."
        );
        std::fs::write(&reader, []).expect("OUT_DIR is writable");
    }
}

fn build() -> cc::Build {
    let mut build = cc::Build::new();
    build.cpp(true).std("c++17").cargo_metadata(false).warnings(false);
    build
}

/// True where the compiler finds OpenVDB.
fn has_headers(out: &Path) -> bool {
    let probe = out.join("probe.cpp");
    std::fs::write(&probe, "#include <openvdb/math/Math.h>\n").expect("OUT_DIR is writable");
    build().file(probe).cargo_warnings(false).try_compile_intermediates().is_ok()
}

/// Compiles and links the program. False where that fails.
fn compile(reader: &Path) -> bool {
    let mut build = build();
    // OpenVDB is templates: unoptimised, reading is ten times slower, and compiling no faster.
    build.file("reader/reader.cpp").opt_level(2).debug(false);
    // Halves are converted in place, not by a table of a library that would have to be linked for it.
    build.define("IMATH_HALF_NO_LOOKUP_TABLE", None);
    let Ok(objects) = build.try_compile_intermediates() else { return false };
    let mut linker = build.get_compiler().to_command();
    linker.args(["-Wl,-s", "-o"]).arg(reader).args(objects).args(["-lopenvdb", "-ltbb"]);
    linker.status().is_ok_and(|status| status.success())
}
