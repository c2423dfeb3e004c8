//! Finds OpenImageIO, compiles the shim over it to a shared library, and generates bindings from the shim's header.
//!
//! Nothing links that library: the crate carries it as bytes and opens it on first use, since the loader takes a third
//! of a second for what OpenImageIO brings along (codecs, font and video libraries), in every run, whether it touches a
//! picture or not.

use std::env;
use std::path::{Path, PathBuf};

const OLDEST: &str = "2.4";

fn main() {
    for file in ["build.rs", "shim/shim.h", "shim/shim.cpp"] {
        println!("cargo::rerun-if-changed={file}");
    }
    let probe = pkg_config::Config::new().atleast_version(OLDEST).cargo_metadata(false).probe("OpenImageIO");
    let library = match probe {
        Ok(library) => library,
        Err(error) => {
            println!(
                "cargo::error=OpenImageIO {OLDEST} or later is needed and was not found. Run ./setup.sh at the top of the \
                 project, or add the folder of its OpenImageIO.pc to PKG_CONFIG_PATH."
            );
            println!("cargo::warning={}", error.to_string().replace('\n', " "));
            return;
        }
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    compile_shim(&library, &out.join("liboiio_shim.so"));
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

/// Compiles and links the shim to the shared library `shim`, which names OpenImageIO as what it needs.
fn compile_shim(library: &pkg_config::Library, shim: &Path) {
    let mut build = cc::Build::new();
    build
        .cpp(true)
        .std("c++17")
        .file("shim/shim.cpp")
        .includes(&library.include_paths)
        .pic(true)
        .warnings(true)
        .extra_warnings(true);
    let objects = build.compile_intermediates();
    let mut linker = build.get_compiler().to_command();
    // With what is missing told here, not when a picture is to be written.
    linker.args(["-shared", "-Wl,-z,defs", "-o"]).arg(shim).args(objects);
    for path in &library.link_paths {
        // A place that the loader does not search by itself is recorded.
        linker.arg(format!("-L{}", path.display())).arg(format!("-Wl,-rpath,{}", path.display()));
    }
    linker.args(library.libs.iter().map(|name| format!("-l{name}")));
    let status = linker.status().expect("the C++ compiler that compiled the shim links it");
    assert!(status.success(), "linking the shim failed: {linker:?}");
}
