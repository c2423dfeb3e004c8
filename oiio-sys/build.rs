//! Finds OpenImageIO, compiles the shim over it, and generates bindings from the shim's header.

use std::env;
use std::path::PathBuf;

const OLDEST: &str = "2.4";

fn main() {
    for file in ["build.rs", "shim/shim.h", "shim/shim.cpp"] {
        println!("cargo::rerun-if-changed={file}");
    }
    // The shim is named by the build script itself, after it, as a static library must precede what it needs.
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
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .file("shim/shim.cpp")
        .includes(&library.include_paths)
        .warnings(true)
        .extra_warnings(true)
        .compile("oiio_shim");
    for path in &library.link_paths {
        println!("cargo::rustc-link-search=native={}", path.display());
    }
    for name in &library.libs {
        println!("cargo::rustc-link-lib=dylib={name}");
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    bindgen::builder()
        .header("shim/shim.h")
        .allowlist_file("shim/shim.h")
        .size_t_is_usize(true)
        .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: true })
        .prepend_enum_name(false)
        .generate()
        .expect("bindgen reads the shim's header")
        .write_to_file(out.join("bindings.rs"))
        .expect("OUT_DIR is writable");
}
