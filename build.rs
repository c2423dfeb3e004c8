//! Lets the program, its tests and its benches find Embree at run time.
//!
//! The place is recorded as DT_RPATH, not the newer DT_RUNPATH, since only the former also holds for what Embree itself
//! loads: OpenImageIO may bring another TBB, and exactly one, Embree's, must end up in the process.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Set by embree4-sys, which fails with a remedy where it found no Embree.
    if let Some(libdir) = std::env::var_os("DEP_EMBREE4_LIBDIR") {
        println!("cargo::rustc-link-arg=-Wl,--disable-new-dtags,-rpath,{}", libdir.display());
    }
}
