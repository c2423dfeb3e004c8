//! A small C interface to the OpenVDB that is installed, and safe Rust over it.
//!
//! OpenVDB speaks C++, whose classes and exceptions cannot cross into Rust. So `shim/shim.cpp` wraps what is needed of it in `extern "C"`
//! functions that catch every exception. The shim is a shared library that the crate carries as bytes; it is opened, and OpenVDB with
//! it, when a file is opened for the first time, as in `oiio-sys`. A program that reads no volume never loads it.
#![allow(unsafe_code, reason = "opens and calls a C interface")]

use std::ffi::{CStr, CString, c_char};
use std::fmt;
use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::OnceLock;

#[allow(
    missing_docs,
    missing_debug_implementations,
    non_camel_case_types,
    non_upper_case_globals,
    unreachable_pub,
    unsafe_op_in_unsafe_fn,
    dead_code,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    reason = "generated from C"
)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

use bindings::{Shim, VdbDense, VdbError, VdbInfo};

/// The compiled shim; no bytes where OpenVDB was not there to compile it with.
const LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/libopenvdb_shim.so"));

static SHIM: OnceLock<Result<Shim, String>> = OnceLock::new();

/// Why OpenVDB did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// OpenVDB could not be loaded.
    #[error("OpenVDB cannot be loaded: {0}")]
    Load(String),
    /// What OpenVDB says.
    #[error("{0}")]
    OpenVdb(String),
    /// A path with a zero byte, which no file has.
    #[error("the path has a zero byte")]
    Path,
}

/// What a grid says that it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridClass {
    /// Nothing is said.
    Unknown,
    /// Density or another quantity that is zero outside.
    FogVolume,
    /// Distance from a surface.
    LevelSet,
    /// Staggered vectors.
    Staggered,
}

/// Description of a grid in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GridInfo {
    /// Name, which other grids of the file may share.
    pub name: String,
    /// OpenVDB's word for the type of its voxels, as `float` or `vec3s`.
    pub value_type: String,
    /// What it holds.
    pub class: GridClass,
    /// True where its voxels are floats, or halves in the file, so that it can be read.
    pub is_float: bool,
    /// From index space (whole coordinates at the centres of voxels) to the world: the images of the three axes, and of the origin. `None`
    /// where it is not affine.
    pub to_world: Option<[[f64; 3]; 4]>,
}

/// A file that was read.
pub struct VdbFile {
    shim: &'static Shim,
    file: NonNull<bindings::VdbFile>,
}

/// A grid of floats, whose leaves and tiles are read one by one.
pub struct VdbGrid {
    shim: &'static Shim,
    grid: NonNull<bindings::VdbGrid>,
}

/// A box of voxels to write. For tests.
#[derive(Clone, Debug)]
pub struct Dense<'a> {
    /// Name of the grid.
    pub name: &'a str,
    /// First voxel.
    pub origin: [i32; 3],
    /// Voxels along each axis.
    pub size: [u16; 3],
    /// One value for each, z fastest.
    pub values: &'a [f32],
    /// As [`GridInfo::to_world`].
    pub to_world: [[f64; 3]; 4],
    /// What it is said to hold.
    pub class: GridClass,
    /// Whether the file has halves.
    pub is_half: bool,
}

impl fmt::Debug for VdbFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("VdbFile")
    }
}

impl fmt::Debug for VdbGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("VdbGrid")
    }
}

impl VdbFile {
    /// Reads the file at `path` with all of its grids. The first call loads OpenVDB.
    ///
    /// # Errors
    /// Where OpenVDB cannot be loaded, or says that it cannot read the file.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let shim = shim()?;
        let path = c_path(path)?;
        let mut error = no_error();
        // SAFETY: the path is NUL-terminated, and the error is a structure of its own.
        let file = unsafe { shim.vdb_open(path.as_ptr(), &mut error) };
        NonNull::new(file).map(|file| Self { shim, file }).ok_or_else(|| told(&error))
    }

    /// Descriptions of all grids, in the order of the file.
    pub fn grids(&self) -> Vec<GridInfo> {
        // SAFETY: the file is there.
        let count = unsafe { self.shim.vdb_grid_count(self.file.as_ptr()) };
        (0..count).filter_map(|number| self.info(number)).collect()
    }

    fn info(&self, number: i32) -> Option<GridInfo> {
        let mut info = VdbInfo {
            name: [0; 256],
            value_type: [0; 64],
            grid_class: bindings::VDB_CLASS_UNKNOWN,
            is_float: false,
            is_linear: false,
            to_world: [0.0; 12],
        };
        // SAFETY: the file is there, and the description is a structure of its own.
        let is_there = unsafe { self.shim.vdb_grid_info(self.file.as_ptr(), number, &mut info) };
        let m = info.to_world;
        let rows = [0, 3, 6, 9].map(|i| [m[i], m[i + 1], m[i + 2]]);
        is_there.then(|| GridInfo {
            name: text(&info.name),
            value_type: text(&info.value_type),
            class: match info.grid_class {
                bindings::VDB_CLASS_FOG_VOLUME => GridClass::FogVolume,
                bindings::VDB_CLASS_LEVEL_SET => GridClass::LevelSet,
                bindings::VDB_CLASS_STAGGERED => GridClass::Staggered,
                _ => GridClass::Unknown,
            },
            is_float: info.is_float,
            to_world: info.is_linear.then_some(rows),
        })
    }

    /// The voxels of the grid with this number in [`Self::grids`]. It keeps them when the file is dropped.
    ///
    /// # Errors
    /// Where there is no such grid, or it is not of floats.
    pub fn grid(&self, number: usize) -> Result<VdbGrid, Error> {
        let mut error = no_error();
        let number = i32::try_from(number).unwrap_or(-1);
        // SAFETY: the file is there; a number that no grid has is told.
        let grid = unsafe { self.shim.vdb_grid_open(self.file.as_ptr(), number, &mut error) };
        let grid = NonNull::new(grid).ok_or_else(|| told(&error))?;
        Ok(VdbGrid { shim: self.shim, grid })
    }
}

impl Drop for VdbFile {
    fn drop(&mut self) {
        // SAFETY: the file is there, and nothing uses it afterwards: grids own what they have read.
        unsafe { self.shim.vdb_close(self.file.as_ptr()) }
    }
}

impl VdbGrid {
    /// Value where there are no voxels.
    pub fn background(&self) -> f32 {
        // SAFETY: the grid is there.
        unsafe { self.shim.vdb_grid_background(self.grid.as_ptr()) }
    }

    /// The next leaf of 8^3 voxels: its first voxel, and its values, z fastest, which go to `values`. `None` after the last one.
    pub fn next_leaf(&mut self, values: &mut [f32; 512]) -> Option<[i32; 3]> {
        let mut origin = [0; 3];
        // SAFETY: the grid is there; three coordinates and 512 values are what the function writes.
        let is_there = unsafe {
            self.shim.vdb_grid_next_leaf(self.grid.as_ptr(), origin.as_mut_ptr(), values.as_mut_ptr())
        };
        is_there.then_some(origin)
    }

    /// The next active tile of one value larger than a voxel: its first voxel, voxels along a side, and value. `None` after the last one.
    pub fn next_tile(&mut self) -> Option<([i32; 3], u32, f32)> {
        let (mut origin, mut side, mut value) = ([0; 3], 0, 0.0);
        // SAFETY: the grid is there; three coordinates, a side and a value are what the function writes.
        let is_there = unsafe {
            self.shim.vdb_grid_next_tile(self.grid.as_ptr(), origin.as_mut_ptr(), &mut side, &mut value)
        };
        is_there.then(|| (origin, side.unsigned_abs(), value))
    }
}

impl Drop for VdbGrid {
    fn drop(&mut self) {
        // SAFETY: the grid is there, and nothing uses it afterwards.
        unsafe { self.shim.vdb_grid_free(self.grid.as_ptr()) }
    }
}

/// Writes a file with one grid, in which voxels of zero are left out. For tests.
///
/// # Errors
/// Where OpenVDB cannot be loaded or written with, or there are not as many values as voxels.
pub fn write(path: &Path, grid: &Dense<'_>) -> Result<(), Error> {
    let shim = shim()?;
    let path = c_path(path)?;
    let name = CString::new(grid.name).map_err(|_| Error::Path)?;
    let count: usize = grid.size.iter().map(|&n| usize::from(n)).product();
    if count != grid.values.len() || count == 0 {
        return Err(Error::OpenVdb(format!("{} values for {count} voxels", grid.values.len())));
    }
    let m = grid.to_world;
    let dense = VdbDense {
        name: name.as_ptr(),
        origin: grid.origin,
        size: grid.size.map(i32::from),
        values: grid.values.as_ptr(),
        to_world: std::array::from_fn(|i| m[i / 3][i % 3]),
        grid_class: match grid.class {
            GridClass::Unknown => bindings::VDB_CLASS_UNKNOWN,
            GridClass::FogVolume => bindings::VDB_CLASS_FOG_VOLUME,
            GridClass::LevelSet => bindings::VDB_CLASS_LEVEL_SET,
            GridClass::Staggered => bindings::VDB_CLASS_STAGGERED,
        },
        is_half: grid.is_half,
    };
    let mut error = no_error();
    // SAFETY: path and name are NUL-terminated, and there are as many values as the size says.
    let is_written = unsafe { shim.vdb_write(path.as_ptr(), &dense, &mut error) };
    if is_written { Ok(()) } else { Err(told(&error)) }
}

fn no_error() -> VdbError {
    VdbError { text: [0; 1024] }
}

fn told(error: &VdbError) -> Error {
    Error::OpenVdb(text(&error.text))
}

/// Text up to its zero byte.
fn text(bytes: &[c_char]) -> String {
    // SAFETY: bytes are bytes, whatever sign C gives them.
    let bytes = unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast::<u8>(), bytes.len()) };
    CStr::from_bytes_until_nul(bytes).map(|text| text.to_string_lossy().into_owned()).unwrap_or_default()
}

fn c_path(path: &Path) -> Result<CString, Error> {
    CString::new(path.as_os_str().as_bytes()).map_err(|_| Error::Path)
}

/// Version of the OpenVDB that is loaded: major, minor, patch. The first call loads it.
///
/// # Errors
/// Where it cannot be loaded.
pub fn version() -> Result<(u32, u32, u32), Error> {
    // SAFETY: the function needs nothing.
    let version = unsafe { shim()?.vdb_version() }.unsigned_abs();
    Ok((version / 10_000, version / 100 % 100, version % 100))
}

fn shim() -> Result<&'static Shim, Error> {
    SHIM.get_or_init(load).as_ref().map_err(|why| Error::Load(why.clone()))
}

fn load() -> Result<Shim, String> {
    if LIBRARY.is_empty() {
        return Err("this program was compiled without it. Run ./setup.sh and compile again".to_owned());
    }
    // A file in memory needs no folder; a system may forbid to run one, as it may for the folder of temporary files.
    in_memory().or_else(|first| {
        in_folder().map_err(|second| if first == second { first } else { format!("{first}; {second}") })
    })
}

fn in_memory() -> Result<Shim, String> {
    let told = |error: io::Error| format!("no file in memory: {error}");
    let file = rustix::fs::memfd_create("openvdb_shim", rustix::fs::MemfdFlags::CLOEXEC);
    let mut file = File::from(file.map_err(|error| told(error.into()))?);
    file.write_all(LIBRARY).map_err(told)?;
    // Not by `/proc/self`: the loader knows libraries by their paths, and one that another shim was opened by, whose descriptor this file may
    // have got, is that shim to it.
    open(format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd()).as_ref())
}

fn in_folder() -> Result<Shim, String> {
    let told = |error: io::Error| format!("no temporary file: {error}");
    let mut file = tempfile::Builder::new().prefix("openvdb_shim").suffix(".so").tempfile().map_err(told)?;
    file.write_all(LIBRARY).map_err(told)?;
    open(file.path())
}

fn open(path: &Path) -> Result<Shim, String> {
    // SAFETY: the file holds the shim as this crate's build linked it, with the functions of the header that the bindings
    // were generated from. Its own initialisation and that of OpenVDB need nothing from this program.
    unsafe { Shim::new(path) }.map_err(|error| error.to_string())
}
