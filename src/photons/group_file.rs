//! Photons of a group of objects, streamed to disk while they are traced, and sorted there: a photon atlas is a folder of such files.
//!
//! A file is a header, photons of 20 bytes in Morton order, and a table with the bounds and the checksum of each block of them, so that the
//! photons of a region are read without the others. All numbers are little-endian.

use super::Photon;
use crate::files::open_regular;
use crate::image_io::{ImageError, write_bytes};
use glam::Vec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// First bytes: one byte that no text contains, letters, and line ends that a transfer as text would change.
const MAGIC: [u8; 8] = *b"\x89CPG\r\n\x1a\n";

/// Version of the layout that this program writes and reads.
pub const GROUP_FILE_VERSION: u32 = 1;

/// Marker of the byte order: bytes 1, 2, 3, 4 in a little-endian file.
const BYTE_ORDER: u32 = 0x0403_0201;

/// Bytes of the header without its checksum.
const HEAD: usize = 72;

/// Bytes of a checksum (BLAKE3).
const SUM: usize = blake3::OUT_LEN;

/// Bytes of a photon.
const PHOTON: usize = 20;

/// Photons of a block.
const BLOCK: usize = 1024;

/// Bytes of a block in the table: bounds and checksum.
const ROW: usize = 32;

/// Photons of a sorted run that are read at a time while runs are merged.
const PIECE: usize = 4096;

/// Bytes that are collected before they are written to a temporary file.
const BUFFER: usize = 1 << 16;

/// Why a file of photons was refused.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct GroupFileError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: GroupFileProblem,
}

/// Problems of a file of photons of a group.
#[derive(Debug, thiserror::Error)]
pub enum GroupFileProblem {
    /// The system reported an error.
    #[error("cannot be read: {0}; check its name and permissions")]
    Io(#[from] io::Error),
    /// It is another kind of file.
    #[error("is not a file of a photon atlas; make one with `cardioid photons SCENE --atlas FOLDER`")]
    Foreign,
    /// It has another version of the layout.
    #[error(
        "is of version {0}, and this program reads version {GROUP_FILE_VERSION}; make it again with `cardioid photons`"
    )]
    Version(u32),
    /// It is shorter or longer than declared.
    #[error(
        "has {found} bytes instead of {declared}: it is incomplete or was added to; copy it again, or make it again with `cardioid photons`"
    )]
    Length {
        /// Bytes that it declares.
        declared: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// A checksum differs.
    #[error(
        "is damaged: {0} is not as it was written; copy it again, or make it again with `cardioid photons`"
    )]
    Damaged(String),
    /// The checksums are right, but the content is not valid: another program wrote it.
    #[error("{0}; make it again with `cardioid photons`")]
    Content(&'static str),
    /// It belongs to other photons.
    #[error(
        "was made for another scene, or with other settings, than the rest of its folder; make it again with `cardioid photons`"
    )]
    Owner,
}

use GroupFileProblem as Problem;

/// The order of photons in files: that of a Morton curve through the scene, so that neighbours in space are mostly neighbours in the file.
#[derive(Clone, Copy, Debug)]
pub struct PhotonOrder {
    low: Vec3,
    per_length: f32,
}

/// Steps of the curve along each axis.
const STEPS: u32 = 1 << 21;

impl PhotonOrder {
    /// The order for a scene within `radius` of `centre`.
    pub fn within(centre: Vec3, radius: f32) -> Self {
        let radius = if radius > 0.0 && radius.is_finite() { radius } else { 1.0 };
        Self { low: centre - radius, per_length: STEPS as f32 / (2.0 * radius) }
    }

    /// The Morton code of a place.
    pub fn code(self, position: Vec3) -> u64 {
        let cell = (position - self.low) * self.per_length;
        let spread = |x: f32| {
            // Saturates outside, and where something is not a number.
            let mut x = u64::from((x as u32).min(STEPS - 1));
            x = (x | x << 32) & 0x001f_0000_0000_ffff;
            x = (x | x << 16) & 0x001f_0000_ff00_00ff;
            x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
            x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
            (x | x << 2) & 0x1249_2492_4924_9249
        };
        spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
    }

    /// The key that sorts photons: all of their bits, so that the order is that of the set.
    fn key(self, photon: &Photon) -> Key {
        (self.code(photon.position), photon.to_bytes())
    }
}

/// Morton code, and all bits of the photon.
type Key = (u64, [u8; PHOTON]);

/// Records of photons in a temporary file without a name, so that nothing is left of it however the process ends.
#[derive(Debug)]
struct Temporary {
    file: File,
    buffer: Vec<u8>,
    count: u64,
}

impl Temporary {
    fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self { file: tempfile::tempfile_in(folder)?, buffer: Vec::new(), count: 0 })
    }

    fn push(&mut self, photon: &Photon) -> io::Result<()> {
        self.buffer.extend(photon.to_bytes());
        self.count += 1;
        if self.buffer.len() >= BUFFER { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// Reads photons `first..first + count`, after [`Self::flush`].
    fn read(&self, first: u64, count: usize) -> io::Result<Vec<Photon>> {
        let mut bytes = vec![0; count * PHOTON];
        self.file.read_exact_at(&mut bytes, first * PHOTON as u64)?;
        let (records, _) = bytes.as_chunks::<PHOTON>();
        let photons: Option<Vec<Photon>> = records.iter().map(|record| Photon::from_bytes(*record)).collect();
        photons.ok_or_else(|| io::Error::other("the temporary file of the photons changed on the disk"))
    }
}

/// Photons of a group while they are traced.
#[derive(Debug)]
pub struct GroupWriter {
    folder: PathBuf,
    photons: Temporary,
    dropped: u64,
}

impl GroupWriter {
    /// Photons that will be in a file of `folder`.
    ///
    /// # Errors
    /// If no file can be made there.
    pub fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self { folder: folder.to_owned(), photons: Temporary::new(folder)?, dropped: 0 })
    }

    /// Adds a photon. One without a finite position is left out and counted.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push(&mut self, photon: &Photon) -> io::Result<()> {
        if photon.position.is_finite() {
            return self.photons.push(photon);
        }
        self.dropped += 1;
        Ok(())
    }

    /// Photons so far.
    pub fn len(&self) -> u64 {
        self.photons.count
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Photons that were left out because their position was not finite.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Sorts the photons and writes them to `path`, which changes only if everything succeeds. At most `in_memory` photons are in memory at a
    /// time; the file does not depend on that number. `owner` identifies scene and settings, `emitted` photons left the lights.
    ///
    /// # Errors
    /// If a file cannot be written or read.
    pub fn finish(
        mut self,
        path: &Path,
        (owner, emitted): ([u8; 32], u64),
        order: PhotonOrder,
        in_memory: usize,
    ) -> Result<(), ImageError> {
        let failed = |cause| ImageError::Write { path: path.to_owned(), cause };
        self.photons.flush().map_err(failed)?;
        let count = self.photons.count;
        let run = in_memory.max(PIECE) as u64;
        if count <= run {
            let sorted = self.sorted(0, count as usize, order).map_err(failed)?;
            drop(self.photons);
            return write_file(path, (owner, emitted, count), sorted.into_iter().map(Ok));
        }
        let mut runs = Temporary::new(&self.folder).map_err(failed)?;
        for first in (0..count).step_by(run as usize) {
            let length = run.min(count - first) as usize;
            let sorted = self.sorted(first, length, order).map_err(failed)?;
            sorted.iter().try_for_each(|photon| runs.push(photon)).map_err(failed)?;
        }
        runs.flush().map_err(failed)?;
        drop(self.photons);
        let merge = Merge::new(&runs, run, order).map_err(failed)?;
        write_file(path, (owner, emitted, count), merge)
    }

    fn sorted(&self, first: u64, count: usize, order: PhotonOrder) -> io::Result<Vec<Photon>> {
        use rayon::prelude::*;
        let mut photons = self.photons.read(first, count)?;
        // Keys are made anew for each comparison, as they would take more memory than the photons.
        photons.par_sort_unstable_by(|a, b| {
            let codes = order.code(a.position).cmp(&order.code(b.position));
            codes.then_with(|| a.to_bytes().cmp(&b.to_bytes()))
        });
        Ok(photons)
    }
}

/// Sorted runs, merged.
struct Merge<'a> {
    runs: &'a Temporary,
    order: PhotonOrder,
    /// By run: photons in memory, the next of them, and the range on disk that is left.
    parts: Vec<(Vec<Photon>, usize, std::ops::Range<u64>)>,
    heads: BinaryHeap<Reverse<(Key, usize)>>,
}

impl<'a> Merge<'a> {
    fn new(runs: &'a Temporary, run: u64, order: PhotonOrder) -> io::Result<Self> {
        let starts = (0..runs.count).step_by(run as usize);
        let parts =
            starts.map(|first| (Vec::new(), 0, first..runs.count.min(first + run))).collect::<Vec<_>>();
        let mut merge = Self { runs, order, heads: BinaryHeap::new(), parts };
        for part in 0..merge.parts.len() {
            merge.advance(part)?;
        }
        Ok(merge)
    }

    /// Puts the next photon of a run on the heap.
    fn advance(&mut self, part: usize) -> io::Result<()> {
        let (photons, next, left) = &mut self.parts[part];
        if *next == photons.len() {
            let count = (left.end - left.start).min(PIECE as u64) as usize;
            *photons = self.runs.read(left.start, count)?;
            left.start += count as u64;
            *next = 0;
        }
        if let Some(photon) = photons.get(*next) {
            *next += 1;
            self.heads.push(Reverse((self.order.key(photon), part)));
        }
        Ok(())
    }
}

impl Iterator for Merge<'_> {
    type Item = io::Result<Photon>;

    fn next(&mut self) -> Option<Self::Item> {
        let Reverse(((_, bytes), part)) = self.heads.pop()?;
        let photon = Photon::from_bytes(bytes).ok_or_else(|| io::Error::other("a photon changed in memory"));
        Some(self.advance(part).and(photon))
    }
}

fn write_file(
    path: &Path,
    (owner, emitted, count): ([u8; 32], u64, u64),
    mut photons: impl Iterator<Item = io::Result<Photon>>,
) -> Result<(), ImageError> {
    write_bytes(path, |out| {
        let blocks = count.div_ceil(BLOCK as u64);
        let length = (HEAD + 2 * SUM) as u64 + count * PHOTON as u64 + blocks * ROW as u64;
        let mut head = Vec::with_capacity(HEAD);
        head.extend(MAGIC);
        head.extend(GROUP_FILE_VERSION.to_le_bytes());
        head.extend(BYTE_ORDER.to_le_bytes());
        [length, count, emitted].iter().for_each(|number| head.extend(number.to_le_bytes()));
        head.extend(owner);
        debug_assert_eq!(head.len(), HEAD, "length of the header");
        out.write_all(&head)?;
        out.write_all(blake3::hash(&head).as_bytes())?;
        let mut table = Vec::with_capacity(blocks as usize * ROW);
        let mut bytes = Vec::with_capacity(BLOCK * PHOTON);
        for _ in 0..blocks {
            bytes.clear();
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for photon in photons.by_ref().take(BLOCK) {
                let photon = photon?;
                (low, high) = (low.min(photon.position), high.max(photon.position));
                bytes.extend(photon.to_bytes());
            }
            out.write_all(&bytes)?;
            low.to_array().iter().chain(&high.to_array()).for_each(|x| table.extend(x.to_le_bytes()));
            table.extend(&blake3::hash(&bytes).as_bytes()[..8]);
        }
        out.write_all(&table)?;
        out.write_all(blake3::hash(&table).as_bytes())
    })
}

/// A block of photons in a file.
#[derive(Clone, Copy, Debug)]
struct Block {
    low: Vec3,
    high: Vec3,
    sum: [u8; 8],
}

/// A file of photons of one group, whose photons are read on demand.
#[derive(Debug)]
pub struct GroupFile {
    path: PathBuf,
    file: File,
    blocks: Vec<Block>,
    count: u64,
    emitted: u64,
    owner: [u8; 32],
    /// Bytes of the file.
    pub bytes: u64,
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[at..at + N]);
    array
}

impl GroupFile {
    /// Opens a file and reads its table of blocks. Blocks are checked when they are read.
    ///
    /// # Errors
    /// The error names the file, the problem and the remedy.
    pub fn open(path: &Path) -> Result<Self, GroupFileError> {
        let in_file = |problem| GroupFileError { file: path.to_owned(), problem };
        let (file, length) = open_regular(path).map_err(|error| in_file(error.into()))?;
        Self::of_file(file, length, path)
    }

    /// The photons in an open file of `length` bytes, under the name `path` in messages.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn of_file(file: File, length: u64, path: &Path) -> Result<Self, GroupFileError> {
        let in_file = |problem| GroupFileError { file: path.to_owned(), problem };
        Self::read_head(path, file, length).map_err(in_file)
    }

    fn read_head(path: &Path, file: File, length: u64) -> Result<Self, Problem> {
        let least = (HEAD + 2 * SUM) as u64;
        let mut start = vec![0; length.min((HEAD + SUM) as u64) as usize];
        file.read_exact_at(&mut start, 0)?;
        let known = start.len().min(MAGIC.len());
        if known == 0 || start[..known] != MAGIC[..known] {
            return Err(Problem::Foreign);
        }
        if length < least {
            return Err(Problem::Length { declared: least, found: length });
        }
        let (head, sum) = start.split_at(HEAD);
        if blake3::hash(head).as_bytes()[..] != *sum {
            return Err(Problem::Damaged("its head".to_owned()));
        }
        let version = u32::from_le_bytes(number(head, 8));
        if version != GROUP_FILE_VERSION {
            return Err(Problem::Version(version));
        }
        if u32::from_le_bytes(number(head, 12)) != BYTE_ORDER {
            return Err(Problem::Content("its numbers have another order of bytes"));
        }
        let [declared, count, emitted] = [16, 24, 32].map(|at| u64::from_le_bytes(number(head, at)));
        if declared != length {
            return Err(Problem::Length { declared, found: length });
        }
        let blocks = count.div_ceil(BLOCK as u64);
        let table = count.checked_mul(PHOTON as u64).and_then(|bytes| bytes.checked_add(blocks * ROW as u64));
        if table.and_then(|bytes| bytes.checked_add(least)) != Some(length) {
            return Err(Problem::Content("its number of photons contradicts its length"));
        }
        let mut bytes = vec![0; blocks as usize * ROW + SUM];
        let start = length - bytes.len() as u64;
        file.read_exact_at(&mut bytes, start)?;
        let (table, sum) = bytes.split_at(blocks as usize * ROW);
        if blake3::hash(table).as_bytes()[..] != *sum {
            return Err(Problem::Damaged("its table of blocks".to_owned()));
        }
        let block = |row: &[u8; ROW]| {
            let x: [f32; 6] = std::array::from_fn(|i| f32::from_le_bytes(number(row, 4 * i)));
            let [low, high] = [0, 3].map(|i| Vec3::new(x[i], x[i + 1], x[i + 2]));
            Block { low, high, sum: number(row, 24) }
        };
        let blocks = table.as_chunks::<ROW>().0.iter().map(block).collect();
        let owner = number(head, 40);
        Ok(Self { path: path.to_owned(), file, blocks, count, emitted, owner, bytes: length })
    }

    /// Number of photons.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// True where there is no photon.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Photons that left the lights, by which powers are divided.
    pub fn emitted(&self) -> u64 {
        self.emitted
    }

    /// What identifies scene and settings.
    pub fn owner(&self) -> [u8; 32] {
        self.owner
    }

    /// Reads a block and appends its photons.
    fn read_block(&self, block: usize, photons: &mut Vec<Photon>) -> Result<(), GroupFileError> {
        let in_file = |problem| GroupFileError { file: self.path.clone(), problem };
        let first = (block * BLOCK) as u64;
        let count = (self.count - first).min(BLOCK as u64) as usize;
        let mut bytes = vec![0; count * PHOTON];
        let at = (HEAD + SUM) as u64 + first * PHOTON as u64;
        self.file.read_exact_at(&mut bytes, at).map_err(|error| in_file(error.into()))?;
        if blake3::hash(&bytes).as_bytes()[..8] != self.blocks[block].sum {
            let what = format!("its block {block} ({} bytes from byte {at})", bytes.len());
            return Err(in_file(Problem::Damaged(what)));
        }
        for record in bytes.as_chunks::<PHOTON>().0 {
            let photon = Photon::from_bytes(*record);
            photons.push(photon.ok_or_else(|| in_file(Problem::Content("a photon of it is not valid")))?);
        }
        Ok(())
    }

    /// Photons in runs of about `most`, whole blocks each: the number of runs.
    pub fn runs(&self, most: usize) -> usize {
        self.blocks.len().div_ceil((most / BLOCK).max(1))
    }

    /// Reads run number `run` of [`Self::runs`].
    ///
    /// # Errors
    /// If it cannot be read or is damaged.
    pub fn run(&self, run: usize, most: usize) -> Result<Vec<Photon>, GroupFileError> {
        let blocks = (most / BLOCK).max(1);
        let mut photons = Vec::new();
        for block in run * blocks..self.blocks.len().min((run + 1) * blocks) {
            self.read_block(block, &mut photons)?;
        }
        Ok(photons)
    }

    /// Appends all photons in the box from `low` to `high`, with its sides.
    ///
    /// # Errors
    /// If a block cannot be read or is damaged.
    pub fn within(&self, low: Vec3, high: Vec3, photons: &mut Vec<Photon>) -> Result<(), GroupFileError> {
        let mut block_photons = Vec::with_capacity(BLOCK);
        for (number, block) in self.blocks.iter().enumerate() {
            if block.low.cmple(high).all() && block.high.cmpge(low).all() {
                block_photons.clear();
                self.read_block(number, &mut block_photons)?;
                let inside =
                    |photon: &&Photon| photon.position.cmpge(low).all() && photon.position.cmple(high).all();
                photons.extend(block_photons.iter().filter(inside));
            }
        }
        Ok(())
    }
}
