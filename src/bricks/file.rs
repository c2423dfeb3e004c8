//! Brick map files: the octree first, then the bricks by level and Morton code, with a checksum for each.
//!
//! All numbers are little-endian. The layout is in `docs/irradiance-atlas.md`. A file is never trusted: what it declares is compared with its
//! length before memory is allocated.

use super::BuiltBricks;
use super::brick::MOST_BYTES;
use super::spool::Spool;
use glam::Vec3;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

/// First bytes: one byte that no text contains, letters, and line ends that a transfer as text would change.
const MAGIC: [u8; 8] = *b"\x89CBM\r\n\x1a\n";

/// Version of the layout that this program writes and reads.
pub const BRICK_FILE_VERSION: u32 = 1;

/// Marker of the byte order: bytes 1, 2, 3, 4 in a little-endian file.
const BYTE_ORDER: u32 = 0x0403_0201;

/// Bytes of the header without its checksum.
const HEAD: usize = 88;

/// Bytes of a checksum (BLAKE3) of the header and of the table of nodes.
const SUM: usize = blake3::OUT_LEN;

/// Bytes of a node in the table: which children it has, bytes of its brick, checksum of its brick.
const NODE: usize = 11;

/// What a brick map belongs to: a hash of the scene, of the settings of its photons, and of the group of objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickOwner(pub [u8; 32]);

/// Why a brick map was refused.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct BrickFileError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: BrickFileProblem,
}

/// Problems of a brick map.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum BrickFileProblem {
    /// The system reported an error.
    #[error("cannot be read: {0}; check its name and permissions")]
    Io(String),
    /// It is another kind of file.
    #[error("is not a brick map; make one with `cardioid bricks SCENE --atlas FOLDER`")]
    Foreign,
    /// It has another version of the layout.
    #[error(
        "is of version {0}, and this program reads version {BRICK_FILE_VERSION}; make it again with `cardioid bricks`"
    )]
    Version(u32),
    /// It is shorter or longer than declared.
    #[error(
        "has {found} bytes instead of {declared}: it is incomplete or was added to; copy it again, or make it again with `cardioid bricks`"
    )]
    Length {
        /// Bytes that it declares.
        declared: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// A checksum differs.
    #[error(
        "is damaged: {0} is not as it was written; copy it again, or make it again with `cardioid bricks`"
    )]
    Damaged(&'static str),
    /// The checksum of a brick differs.
    #[error(
        "is damaged: brick {number} (level {level}, {bytes} bytes from byte {at}) is not as it was written; copy it again, or make it again \
         with `cardioid bricks`"
    )]
    DamagedBrick {
        /// Number of the brick in the file.
        number: u32,
        /// Its level.
        level: usize,
        /// Where it starts.
        at: u64,
        /// Its length.
        bytes: u16,
    },
    /// The checksums are right, but the content is not valid: another program wrote it.
    #[error("{0}; make it again with `cardioid bricks`")]
    Content(&'static str),
    /// It belongs to other photons.
    #[error(
        "was made for another scene or from other photons than the rest of its folder; make it again with `cardioid bricks`"
    )]
    Owner,
}

use BrickFileProblem as Problem;

impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Self {
        match error.kind() == io::ErrorKind::UnexpectedEof {
            true => Self::Content("it became shorter while it was read"),
            false => Self::Io(error.to_string()),
        }
    }
}

/// A node of the octree, and where its brick is.
#[derive(Clone, Copy, Debug)]
pub(super) struct FileNode {
    /// Start of the brick in the file.
    pub(super) at: u64,
    /// Checksum of the packed brick.
    pub(super) sum: u64,
    /// Number of the first child; the others follow.
    pub(super) first_child: u32,
    /// Bytes of the packed brick.
    pub(super) bytes: u16,
    /// Which of the eight children exist.
    pub(super) children: u8,
}

/// Header and octree of a file.
#[derive(Debug)]
pub(super) struct Head {
    pub(super) origin: Vec3,
    pub(super) size: f32,
    pub(super) max_error: f32,
    pub(super) discs: u64,
    pub(super) owner: BrickOwner,
    pub(super) nodes: Vec<FileNode>,
    /// By level, the number of its first node; one more at the end.
    pub(super) levels: Vec<u32>,
}

/// Writes a brick map.
///
/// # Errors
/// Where `out` or the temporary file of `built` fails, and where there is no brick.
pub fn write_brick_file(out: &mut impl Write, built: &BuiltBricks, owner: BrickOwner) -> io::Result<()> {
    let entries = &built.spool.entries;
    if entries.is_empty() || u32::try_from(entries.len()).is_err() {
        return Err(io::Error::other("a brick map has at least one brick and less than 2^32"));
    }
    let content: u64 = entries.iter().map(|entry| u64::from(entry.bytes)).sum();
    let length = (HEAD + SUM + SUM) as u64 + (entries.len() * NODE) as u64 + content;
    let mut head = Vec::with_capacity(HEAD);
    head.extend(MAGIC);
    head.extend(BRICK_FILE_VERSION.to_le_bytes());
    head.extend(BYTE_ORDER.to_le_bytes());
    head.extend(length.to_le_bytes());
    head.extend((entries.len() as u32).to_le_bytes());
    built.origin.to_array().iter().for_each(|x| head.extend(x.to_le_bytes()));
    head.extend(built.size.to_le_bytes());
    head.extend(built.max_error.to_le_bytes());
    head.extend(built.discs.to_le_bytes());
    head.extend(owner.0);
    debug_assert_eq!(head.len(), HEAD, "length of the header");
    out.write_all(&head)?;
    out.write_all(blake3::hash(&head).as_bytes())?;
    let mut hasher = blake3::Hasher::new();
    for entry in entries {
        let mut node = [0; NODE];
        node[0] = entry.children;
        node[1..3].copy_from_slice(&entry.bytes.to_le_bytes());
        node[3..].copy_from_slice(&entry.sum.to_le_bytes());
        hasher.update(&node);
        out.write_all(&node)?;
    }
    out.write_all(hasher.finalize().as_bytes())?;
    copy(&built.spool, out)
}

fn copy(spool: &Spool, out: &mut impl Write) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(MOST_BYTES);
    for entry in &spool.entries {
        spool.read(entry, &mut bytes)?;
        if super::spool::checksum(&bytes) != entry.sum {
            return Err(io::Error::other("the temporary file of the bricks changed on the disk"));
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[at..at + N]);
    array
}

/// Reads header and octree of a file of `length` bytes.
pub(super) fn read_head(file: &File, length: u64) -> Result<Head, Problem> {
    if length < (HEAD + SUM) as u64 {
        let mut start = vec![0; length as usize];
        file.read_exact_at(&mut start, 0)?;
        let known = start.len().min(MAGIC.len());
        let is_ours = known > 0 && start[..known] == MAGIC[..known];
        let (declared, found) = ((HEAD + SUM) as u64, length);
        return Err(if is_ours { Problem::Length { declared, found } } else { Problem::Foreign });
    }
    let mut head = [0; HEAD + SUM];
    file.read_exact_at(&mut head, 0)?;
    if head[..MAGIC.len()] != MAGIC {
        return Err(Problem::Foreign);
    }
    if blake3::hash(&head[..HEAD]).as_bytes()[..] != head[HEAD..] {
        return Err(Problem::Damaged("its head"));
    }
    let version = u32::from_le_bytes(number(&head, 8));
    if version != BRICK_FILE_VERSION {
        return Err(Problem::Version(version));
    }
    if u32::from_le_bytes(number(&head, 12)) != BYTE_ORDER {
        return Err(Problem::Content("its numbers have another order of bytes"));
    }
    let declared = u64::from_le_bytes(number(&head, 16));
    if declared != length {
        return Err(Problem::Length { declared, found: length });
    }
    let count = u32::from_le_bytes(number(&head, 24));
    let origin = Vec3::from_array([28, 32, 36].map(|at| f32::from_le_bytes(number(&head, at))));
    let [size, max_error] = [40, 44].map(|at| f32::from_le_bytes(number(&head, at)));
    if !(origin.is_finite() && size > 0.0 && size.is_finite() && count > 0) {
        return Err(Problem::Content("its octree has no size"));
    }
    let discs = u64::from_le_bytes(number(&head, 48));
    let owner = BrickOwner(number(&head, 56));
    let start = (HEAD + SUM) as u64;
    let table = u64::from(count) * NODE as u64;
    if start + table + SUM as u64 > length {
        return Err(Problem::Content("its octree is longer than it is"));
    }
    let mut bytes = vec![0; table as usize + SUM];
    file.read_exact_at(&mut bytes, start)?;
    let (table, sum) = bytes.split_at(table as usize);
    if blake3::hash(table).as_bytes()[..] != *sum {
        return Err(Problem::Damaged("its octree"));
    }
    let first = start + bytes.len() as u64;
    let (nodes, levels) = read_nodes(table, first, length)?;
    Ok(Head { origin, size, max_error, discs, owner, nodes, levels })
}

/// Nodes with the places of their children and bricks, and the first node of each level.
fn read_nodes(table: &[u8], first: u64, length: u64) -> Result<(Vec<FileNode>, Vec<u32>), Problem> {
    const ODD: Problem = Problem::Content("its octree contradicts itself");
    let (records, _) = table.as_chunks::<NODE>();
    let mut nodes = Vec::with_capacity(records.len());
    let (mut at, mut next) = (first, 1u32);
    for record in records {
        let bytes = u16::from_le_bytes(number(record, 1));
        if usize::from(bytes) > MOST_BYTES {
            return Err(ODD);
        }
        let children = record[0];
        nodes.push(FileNode {
            at,
            sum: u64::from_le_bytes(number(record, 3)),
            first_child: next,
            bytes,
            children,
        });
        at += u64::from(bytes);
        next = next.checked_add(children.count_ones()).ok_or(ODD)?;
    }
    if at != length || next as usize != nodes.len() {
        return Err(ODD);
    }
    // Level by level: the children of a level are the next one. Each level starts after the one before, since no node is its own child.
    let mut levels = vec![0, 1];
    let mut start = 0u32;
    let mut end = 1u32;
    while (end as usize) < nodes.len() {
        let children: u32 =
            nodes[start as usize..end as usize].iter().map(|node| node.children.count_ones()).sum();
        if children == 0 || levels.len() > MOST_LEVELS {
            return Err(ODD);
        }
        (start, end) = (end, end + children);
        levels.push(end);
    }
    Ok((nodes, levels))
}

/// Levels of the deepest octree that is read.
const MOST_LEVELS: usize = 21;
