//! Reads the grids of OpenVDB files by the OpenVDB that is installed, in a process of its own.
//!
//! OpenVDB trusts its files: where one is broken it writes beyond its buffers, reads counts for hours and takes all the memory there is. So
//! it does not run in this program. `reader/reader.cpp` is a small program over it, compiled with this crate and carried as bytes; it is
//! started for each file, with limits on its memory and processor time, and sends what it reads through a pipe. Whatever a file does to it,
//! the answer is a grid or an error. A program that reads no volume never starts it.

use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// The compiled reader; no bytes where OpenVDB was not there to compile it with.
const READER: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/openvdb_reader"));

/// Voxels of a leaf.
pub const LEAF_VALUES: usize = 512;

/// Longest text that is taken from the reader.
const LONGEST_TEXT: u32 = 1 << 16;

/// Most grids that a file may have.
const MOST_GRIDS: u32 = 1 << 16;

/// Why OpenVDB did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// OpenVDB is not there.
    #[error("OpenVDB cannot be started: {0}")]
    Start(String),
    /// What OpenVDB says.
    #[error("{0}")]
    OpenVdb(String),
    /// The reader ended before it was done.
    #[error("OpenVDB failed on it ({0}): the file is broken, or takes more memory or time than it may")]
    Ended(String),
}

/// What a file may take of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Address space, in megabytes; libraries and stacks take some hundred.
    pub megabytes: u64,
    /// Processor time, in seconds.
    pub seconds: u64,
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
    /// Leaves of 8^3 voxels with values of their own; none where it is not of floats.
    pub leaves: u64,
    /// How many leaves its tiles fill; none where it is not of floats.
    pub tile_leaves: u64,
    /// Bytes that it takes in OpenVDB's process.
    pub bytes: u64,
}

/// A file that was read, with the process that holds it.
pub struct VdbFile {
    process: Process,
    grids: Vec<GridInfo>,
}

/// The voxels of a grid, piece by piece.
pub struct VdbGrid {
    process: Process,
    background: f32,
    is_over: bool,
}

/// Some voxels of a grid.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// A cube of one value.
    Tile {
        /// First voxel.
        origin: [i32; 3],
        /// Voxels along a side.
        side: u32,
        /// Their value.
        value: f32,
    },
    /// 8^3 voxels.
    Leaf {
        /// First voxel.
        origin: [i32; 3],
        /// Values, z fastest.
        values: Box<[f32; LEAF_VALUES]>,
    },
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
        f.debug_struct("VdbFile").field("grids", &self.grids).finish_non_exhaustive()
    }
}

impl fmt::Debug for VdbGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("VdbGrid").field("background", &self.background).finish_non_exhaustive()
    }
}

/// True where the program was compiled with OpenVDB, so that files can be read where its library is.
pub fn is_compiled() -> bool {
    !READER.is_empty()
}

impl VdbFile {
    /// Reads the file at `path` with all of its grids.
    ///
    /// # Errors
    /// Where OpenVDB cannot be started, says that it cannot read the file, or ends.
    pub fn open(path: &Path, limits: Limits) -> Result<Self, Error> {
        let mut process = Process::start(|command| {
            command.arg("read").arg(path).arg(limits.megabytes.to_string()).arg(limits.seconds.to_string());
        })?;
        process.check_status()?;
        let count = process.u32()?;
        if count > MOST_GRIDS {
            return Err(process.ended());
        }
        let mut grids = Vec::new();
        for _ in 0..count {
            grids.push(process.info()?);
        }
        Ok(Self { process, grids })
    }

    /// Descriptions of all grids, in the order of the file.
    pub fn grids(&self) -> &[GridInfo] {
        &self.grids
    }

    /// The voxels of the grid with this number in [`Self::grids`].
    ///
    /// # Errors
    /// Where there is no such grid, it is not of floats, or OpenVDB ends.
    pub fn grid(self, number: usize) -> Result<VdbGrid, Error> {
        let mut process = self.process;
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        if process.input.write_all(&number.to_ne_bytes()).and_then(|()| process.input.flush()).is_err() {
            return Err(process.ended());
        }
        process.check_status()?;
        let background = process.f32()?;
        Ok(VdbGrid { process, background, is_over: false })
    }
}

impl VdbGrid {
    /// Value where there are no voxels.
    pub fn background(&self) -> f32 {
        self.background
    }

    /// The next piece: tiles first, then leaves. `None` after the last one.
    ///
    /// # Errors
    /// Where OpenVDB ends before it is done.
    pub fn next_piece(&mut self) -> Result<Option<Piece>, Error> {
        if self.is_over {
            return Ok(None);
        }
        let kind = self.process.u32()?;
        if kind == 0 {
            self.is_over = true;
            return Ok(None);
        }
        let origin = [self.process.i32()?, self.process.i32()?, self.process.i32()?];
        match kind {
            1 => {
                let side = self.process.i32()?.unsigned_abs();
                Ok(Some(Piece::Tile { origin, side, value: self.process.f32()? }))
            }
            2 => {
                let mut values = Box::new([0.0; LEAF_VALUES]);
                let mut bytes = [0; 4 * LEAF_VALUES];
                self.process.fill(&mut bytes)?;
                for (value, bytes) in values.iter_mut().zip(bytes.as_chunks::<4>().0) {
                    *value = f32::from_ne_bytes(*bytes);
                }
                Ok(Some(Piece::Leaf { origin, values }))
            }
            _ => Err(self.process.ended()),
        }
    }
}

/// Writes a file with one grid, in which voxels of zero are left out. For tests.
///
/// # Errors
/// Where OpenVDB cannot be started or written with, or there are not as many values as voxels.
pub fn write(path: &Path, grid: &Dense<'_>) -> Result<(), Error> {
    let count: usize = grid.size.iter().map(|&n| usize::from(n)).product();
    if count != grid.values.len() || count == 0 {
        return Err(Error::OpenVdb(format!("{} values for {count} voxels", grid.values.len())));
    }
    let mut process = Process::start(|command| {
        command.arg("write").arg(path);
    })?;
    let mut bytes = Vec::new();
    bytes.extend_from_slice(&(grid.name.len() as u32).to_ne_bytes());
    bytes.extend_from_slice(grid.name.as_bytes());
    grid.origin.iter().for_each(|c| bytes.extend_from_slice(&c.to_ne_bytes()));
    grid.size.iter().for_each(|c| bytes.extend_from_slice(&i32::from(*c).to_ne_bytes()));
    grid.to_world.iter().flatten().for_each(|x| bytes.extend_from_slice(&x.to_ne_bytes()));
    let class = match grid.class {
        GridClass::Unknown => 0u32,
        GridClass::FogVolume => 1,
        GridClass::LevelSet => 2,
        GridClass::Staggered => 3,
    };
    bytes.extend_from_slice(&class.to_ne_bytes());
    bytes.extend_from_slice(&u32::from(grid.is_half).to_ne_bytes());
    grid.values.iter().for_each(|v| bytes.extend_from_slice(&v.to_ne_bytes()));
    // A reader that ended says why.
    let _ = process.input.write_all(&bytes).and_then(|()| process.input.flush());
    process.check_status()
}

/// A running reader. It ends with this.
struct Process {
    child: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Process {
    /// Starts the reader with arguments.
    fn start(arguments: impl Fn(&mut Command)) -> Result<Self, Error> {
        if !is_compiled() {
            let why = "this program was compiled without it. Run ./setup.sh and compile again";
            return Err(Error::Start(why.to_owned()));
        }
        // A file in memory needs no folder; a system may forbid to run one, as it may for the folder of temporary files.
        let child = in_memory(&arguments).or_else(|first| {
            in_folder(&arguments).map_err(|second| Error::Start(format!("{first}; {second}")))
        });
        let mut child = child?;
        match (child.stdin.take(), child.stdout.take()) {
            (Some(input), Some(output)) => Ok(Self {
                child,
                input: BufWriter::new(input),
                output: BufReader::with_capacity(1 << 16, output),
            }),
            _ => Err(Error::Start("it has no pipes".to_owned())),
        }
    }

    /// Why the reader sends no more.
    fn ended(&mut self) -> Error {
        let _ = self.child.kill();
        Error::Ended(match self.child.wait() {
            Ok(status) => match (status.signal(), status.code()) {
                (Some(signal), _) => format!("ended by signal {signal}"),
                (None, Some(127)) => "a library of it is missing".to_owned(),
                (None, code) => format!("ended with code {}", code.unwrap_or(0)),
            },
            Err(error) => error.to_string(),
        })
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), Error> {
        match self.output.read_exact(bytes) {
            Ok(()) => Ok(()),
            Err(_) => {
                // It has closed its end: it is about to end by itself, with a status that says more than one by force.
                let _ = self.child.wait();
                Err(self.ended())
            }
        }
    }

    fn u32(&mut self) -> Result<u32, Error> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(u32::from_ne_bytes(bytes))
    }

    fn i32(&mut self) -> Result<i32, Error> {
        Ok(self.u32()? as i32)
    }

    fn f32(&mut self) -> Result<f32, Error> {
        Ok(f32::from_bits(self.u32()?))
    }

    fn u64(&mut self) -> Result<u64, Error> {
        let mut bytes = [0; 8];
        self.fill(&mut bytes)?;
        Ok(u64::from_ne_bytes(bytes))
    }

    fn f64(&mut self) -> Result<f64, Error> {
        Ok(f64::from_bits(self.u64()?))
    }

    fn text(&mut self) -> Result<String, Error> {
        let length = self.u32()?;
        if length > LONGEST_TEXT {
            return Err(self.ended());
        }
        let mut bytes = vec![0; length as usize];
        self.fill(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Whether the reader goes on, or says why it does not.
    fn check_status(&mut self) -> Result<(), Error> {
        match self.u32()? {
            0 => Ok(()),
            _ => Err(Error::OpenVdb(self.text()?)),
        }
    }

    fn info(&mut self) -> Result<GridInfo, Error> {
        let (name, value_type) = (self.text()?, self.text()?);
        let class = match self.u32()? {
            1 => GridClass::FogVolume,
            2 => GridClass::LevelSet,
            3 => GridClass::Staggered,
            _ => GridClass::Unknown,
        };
        let (is_float, is_linear) = (self.u32()? != 0, self.u32()? != 0);
        let mut to_world = [[0.0; 3]; 4];
        for x in to_world.iter_mut().flatten() {
            *x = self.f64()?;
        }
        let to_world = is_linear.then_some(to_world);
        let (leaves, tile_leaves, bytes) = (self.u64()?, self.u64()?, self.u64()?);
        Ok(GridInfo { name, value_type, class, is_float, to_world, leaves, tile_leaves, bytes })
    }
}

fn run(program: &Path, arguments: &impl Fn(&mut Command)) -> io::Result<Child> {
    let mut command = Command::new(program);
    arguments(&mut command);
    // What the library prints on its own is of no use to anybody.
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn()
}

fn in_memory(arguments: &impl Fn(&mut Command)) -> Result<Child, String> {
    let told = |error: io::Error| format!("no file in memory: {error}");
    let file = rustix::fs::memfd_create("openvdb_reader", rustix::fs::MemfdFlags::CLOEXEC);
    let mut file = File::from(file.map_err(|error| told(error.into()))?);
    file.write_all(READER).map_err(told)?;
    run(format!("/proc/self/fd/{}", file.as_raw_fd()).as_ref(), arguments).map_err(told)
}

fn in_folder(arguments: &impl Fn(&mut Command)) -> Result<Child, String> {
    let told = |error: io::Error| format!("no temporary file: {error}");
    let mut file = tempfile::Builder::new().prefix("openvdb_reader").tempfile().map_err(told)?;
    file.write_all(READER).map_err(told)?;
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o700)).map_err(told)?;
    // Closed: what is open to be written cannot be run.
    run(&file.into_temp_path(), arguments).map_err(told)
}
