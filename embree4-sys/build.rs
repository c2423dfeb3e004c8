//! Finds Embree, generates bindings from its own headers, and links it.
//!
//! Searched, in this order: `EMBREE_DIR`, the project's `.deps` (where `setup.sh` puts a private copy), `/usr/local`,
//! `/usr`. The headers must be 4.3 or later: before, a hit was 16 bytes shorter than what a later library writes.
//!
//! Dependents learn where Embree is from `DEP_EMBREE4_LIBDIR` and `DEP_EMBREE4_INCLUDE`.

use std::env;
use std::fmt::{self, Display};
use std::fs;
use std::path::{Path, PathBuf};

/// Oldest version whose structs have the layout that all later ones have: (major, minor).
const OLDEST: (u32, u32) = (4, 3);

/// An Embree fit for use.
struct Installation {
    include: PathBuf,
    libdir: PathBuf,
}

/// What is under a prefix, other than an Embree fit for use.
enum Unfit {
    NoHeaders,
    NoVersion,
    TooOld(u32, u32),
    Option(&'static str),
    NoLibrary,
}

impl Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoHeaders => write!(f, "no include/embree4/rtcore_config.h"),
            Self::NoVersion => write!(f, "include/embree4/rtcore_config.h states no version"),
            Self::TooOld(major, minor) => write!(f, "version {major}.{minor} is too old"),
            Self::Option(name) => write!(f, "built with another {name} than Embree's default"),
            Self::NoLibrary => write!(f, "headers, but no lib/libembree4.so"),
        }
    }
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    let Some(embree) = find() else { return };
    println!("cargo::rerun-if-changed={}", embree.include.join("embree4/rtcore_config.h").display());
    println!("cargo::metadata=libdir={}", embree.libdir.display());
    println!("cargo::metadata=include={}", embree.include.display());
    println!("cargo::rustc-link-search=native={}", embree.libdir.display());
    println!("cargo::rustc-link-lib=dylib=embree4");
    // For the tests of this package alone: link arguments do not reach dependents.
    println!("cargo::rustc-link-arg=-Wl,--disable-new-dtags,-rpath,{}", embree.libdir.display());
    generate_bindings(&embree.include);
    compile_layout_tables(&embree.include);
}

/// The first fit Embree; where there is none, tells cargo why and what to do.
fn find() -> Option<Installation> {
    // Who names a folder wants that one or an error, not another.
    let chosen = env::var_os("EMBREE_DIR").filter(|dir| !dir.is_empty()).map(PathBuf::from);
    let prefixes = match chosen {
        Some(dir) => vec![dir],
        None => vec![project_prefix(), PathBuf::from("/usr/local"), PathBuf::from("/usr")],
    };
    let mut found = Vec::new();
    for prefix in prefixes {
        match inspect(&prefix) {
            Ok(installation) => return Some(installation),
            Err(unfit) => found.push(format!("{}: {unfit}", prefix.display())),
        }
    }
    let (major, minor) = OLDEST;
    println!(
        "cargo::error=Embree {major}.{minor} or later is needed and was not found ({}). \
         Run ./setup.sh at the top of the project, or set EMBREE_DIR to the folder that holds Embree's include/ and lib/.",
        found.join("; ")
    );
    None
}

/// Where `setup.sh` puts what the distribution lacks.
fn project_prefix() -> PathBuf {
    let manifest = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(&manifest).join(".deps")
}

fn inspect(prefix: &Path) -> Result<Installation, Unfit> {
    let include = prefix.join("include");
    let config = fs::read_to_string(include.join("embree4/rtcore_config.h")).map_err(|_| Unfit::NoHeaders)?;
    let version = (macro_value(&config, "RTC_VERSION_MAJOR"), macro_value(&config, "RTC_VERSION_MINOR"));
    let (Some(major), Some(minor)) = version else { return Err(Unfit::NoVersion) };
    if (major, minor) < OLDEST {
        return Err(Unfit::TooOld(major, minor));
    }
    // Options of Embree's build that add fields to its structs. What is written by hand in lib.rs knows the defaults.
    if macro_value(&config, "RTC_MAX_INSTANCE_LEVEL_COUNT") != Some(1) {
        return Err(Unfit::Option("EMBREE_MAX_INSTANCE_LEVEL_COUNT"));
    }
    if macro_value(&config, "EMBREE_MIN_WIDTH") != Some(0) {
        return Err(Unfit::Option("EMBREE_MIN_WIDTH"));
    }
    if !config.lines().any(|line| line.trim_end() == "#define EMBREE_GEOMETRY_INSTANCE_ARRAY") {
        return Err(Unfit::Option("EMBREE_GEOMETRY_INSTANCE_ARRAY"));
    }
    let architecture = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let libdir = ["lib", "lib64", &format!("lib/{architecture}-linux-gnu")]
        .map(|dir| prefix.join(dir))
        .into_iter()
        .find(|dir| dir.join("libembree4.so").exists())
        .ok_or(Unfit::NoLibrary)?;
    // An rpath must not depend on the folder a program is started from.
    let libdir = libdir.canonicalize().map_err(|_| Unfit::NoLibrary)?;
    Ok(Installation { include, libdir })
}

/// The number that `#define name number` gives.
fn macro_value(header: &str, name: &str) -> Option<u32> {
    header.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        (words.next() == Some("#define") && words.next() == Some(name)).then(|| words.next())??.parse().ok()
    })
}

fn generate_bindings(include: &Path) {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    bindgen::builder()
        .header(include.join("embree4/rtcore.h").to_str().expect("the path of Embree is UTF-8"))
        .clang_arg(format!("-I{}", include.display()))
        // Embree documents itself in plain comments; take those too.
        .clang_arg("-fparse-all-comments")
        .allowlist_item("(rtc|RTC).*")
        .size_t_is_usize(true)
        // The library may return values that this header does not know: never a Rust enum.
        .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: true })
        .prepend_enum_name(false)
        // Zeroed arguments are a trap (an empty feature mask traces nothing).
        .derive_default(false)
        .generate()
        .expect("bindgen reads Embree's headers")
        .write_to_file(out.join("bindings.rs"))
        .expect("OUT_DIR is writable");
}

/// What the C compiler makes of the headers, for `tests/layout.rs`. Nothing else links it in.
fn compile_layout_tables(include: &Path) {
    println!("cargo::rerun-if-changed=tests/layout.c");
    cc::Build::new().file("tests/layout.c").include(include).warnings(true).compile("embree4_sys_layout");
}
