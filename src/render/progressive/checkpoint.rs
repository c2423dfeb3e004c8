//! Checkpoints: files that hold the rounds of a progressive render. A file is
//!
//! ```text
//! "cardioid rounds\n"     16 bytes
//! version                 u32
//! length of the header    u32
//! header                  JSON: identity of the render, statistics of rounds, counters, what follows
//! blocks before           of a picture: their sum, where there are any; of a part of one: each block as in the part's file
//! even rounds, odd rounds sums of the two films of the present block
//! checksum                BLAKE3 of all before, 32 bytes
//! ```
//!
//! Numbers are little-endian.

use super::RoundStatistics;
use super::fold::{Blocks, EncodedBlock, Fold, Seen};
use crate::files::open_regular;
use crate::film::{Film, FilmError, HalvedSum, LayerSet};
use crate::image_io::{self, ImageError};
use crate::integrators::Counters;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{self, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 16] = *b"cardioid rounds\n";

/// Version of the layout above and of the computation of rounds. It is raised where either changes.
const VERSION: u32 = 3;

/// Largest header in bytes; a longer one means that the file is damaged. Names of many thousands of objects fit.
pub(super) const LONGEST_HEADER: u32 = 1 << 26;

/// Names and values that must be equal for a render to be resumed.
pub(super) type Identity = BTreeMap<String, Value>;

/// Header of a checkpoint.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Header {
    pub(super) identity: Identity,
    pub(super) statistics: RoundStatistics,
    pub(super) counters: Counters,
    /// Blocks before the present one.
    pub(super) before: Before,
}

/// How a checkpoint holds the blocks before the present one.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub(super) enum Before {
    /// There are none, of a picture.
    #[default]
    Nothing,
    /// Their sum.
    Sum,
    /// So many of them, each in so many bands.
    Blocks(u64, u64, Seen),
}

/// State of a progressive render after some round.
#[derive(Debug)]
pub struct Checkpoint {
    pub(super) header: Header,
    /// The blocks before the present one.
    pub(super) fold: Fold,
    /// Sums of the even and of the odd rounds of the present block. Rounds are counted from zero.
    pub(super) halves: [Film; 2],
}

/// An error of resuming a render or of writing a checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// The file is not a checkpoint, or is damaged.
    #[error("{} {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The problem, as text that follows the file name.
        what: String,
    },
    /// The checkpoint belongs to another render.
    #[error("{} holds another render, which this one cannot go on with: {}", path.display(), differences.join("; "))]
    Different {
        /// The file.
        path: PathBuf,
        /// Each difference.
        differences: Vec<String>,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] ImageError),
    /// The integrator does not render in rounds, so there is nothing to write or resume.
    #[error("only --integrator progressive renders in rounds, which can be kept and gone on with")]
    NoRounds,
}

impl Checkpoint {
    /// The state before the first round.
    pub(super) fn new(identity: Identity, fold: Fold, halves: [Film; 2]) -> Self {
        let (statistics, counters) = Default::default();
        Self { header: Header { identity, statistics, counters, before: Before::Nothing }, fold, halves }
    }

    /// Writes the checkpoint. The file at `path` changes only when all of the new one is on the disk.
    pub(super) fn write(&self, path: &Path) -> Result<(), CheckpointError> {
        Ok(image_io::write_with(path, |file| self.write_to(BufWriter::new(file)))?)
    }

    fn write_to(&self, to: impl Write) -> io::Result<()> {
        let mut to = Hashing::new(to);
        let Header { identity, statistics, counters, .. } = &self.header;
        let before = match &self.fold {
            Fold::Sum(None) => Before::Nothing,
            Fold::Sum(Some(_)) => Before::Sum,
            Fold::Blocks(Blocks { encoded, seen }) => {
                let bands = encoded.first().map_or(0, |block| block.bands.len());
                Before::Blocks(encoded.len() as u64, bands as u64, seen.clone())
            }
        };
        let (identity, statistics) = (identity.clone(), statistics.clone());
        let header = Header { identity, statistics, counters: *counters, before };
        let header = serde_json::to_vec(&header)?;
        to.write_all(&MAGIC)?;
        to.write_all(&VERSION.to_le_bytes())?;
        to.write_all(&(header.len() as u32).to_le_bytes())?;
        to.write_all(&header)?;
        match &self.fold {
            Fold::Sum(sum) => sum.iter().try_for_each(|sum| sum.save(&mut to))?,
            Fold::Blocks(blocks) => {
                for band in blocks.encoded.iter().flat_map(|block| &block.bands) {
                    to.write_all(&(band.len() as u32).to_le_bytes())?;
                    to.write_all(band)?;
                }
            }
        }
        self.halves.iter().try_for_each(|half| half.save(&mut to))?;
        let checksum = to.hasher.finalize();
        to.inner.write_all(checksum.as_bytes())?;
        to.inner.flush()
    }

    /// Reads the checkpoint of a render with this identity, whose films have the layout of `empty`.
    pub(super) fn read(path: &Path, identity: &Identity, empty: [Film; 2]) -> Result<Self, CheckpointError> {
        let (file, _) =
            open_regular(path).map_err(|error| CheckpointError::Read { path: path.to_owned(), error })?;
        Self::parse(BufReader::new(file), path, Some(identity), empty)
    }

    /// Reads a checkpoint from any reader. Without an `identity`, a checkpoint of any render is accepted.
    fn parse(
        from: impl Read,
        path: &Path,
        identity: Option<&Identity>,
        empty: [Film; 2],
    ) -> Result<Self, CheckpointError> {
        let failed = |error: io::Error| {
            if error.kind() == ErrorKind::UnexpectedEof {
                damaged(path, "ends too early; it is damaged")
            } else if error.kind() == ErrorKind::InvalidData {
                damaged(path, "is damaged")
            } else {
                CheckpointError::Read { path: path.to_owned(), error }
            }
        };
        let mut from = Hashing::new(from);
        let mut magic = [0; MAGIC.len()];
        match from.read_exact(&mut magic) {
            Err(error) if error.kind() != ErrorKind::UnexpectedEof => return Err(failed(error)),
            Ok(()) if magic == MAGIC => {}
            _ => return Err(damaged(path, "is not what --checkpoint writes")),
        }
        let mut number = || -> io::Result<u32> {
            let mut bytes = [0; 4];
            from.read_exact(&mut bytes)?;
            Ok(u32::from_le_bytes(bytes))
        };
        let version = number().map_err(failed)?;
        if version != VERSION {
            let what = format!(
                "was written by another version of cardioid ({version}, and this one reads {VERSION})"
            );
            return Err(damaged(path, what));
        }
        let length = number().map_err(failed)?;
        if length > LONGEST_HEADER {
            return Err(damaged(path, "is damaged"));
        }
        let mut header = vec![0; length as usize];
        from.read_exact(&mut header).map_err(failed)?;
        let header: Header = serde_json::from_slice(&header).map_err(|_| damaged(path, "is damaged"))?;
        let differences = identity.map_or_else(Vec::new, |identity| differences(&header.identity, identity));
        if !differences.is_empty() {
            return Err(CheckpointError::Different { path: path.to_owned(), differences });
        }
        let mut halves = empty;
        let fold = read_before(&header.before, &halves[0], &mut from).map_err(failed)?;
        halves.iter_mut().try_for_each(|half| half.restore(&mut from)).map_err(failed)?;
        let checksum = from.hasher.finalize();
        let mut rest = Vec::new();
        from.inner.take(33).read_to_end(&mut rest).map_err(failed)?;
        if rest != checksum.as_bytes() {
            return Err(damaged(path, "is damaged: its checksum is wrong"));
        }
        Ok(Self { header, fold, halves })
    }
}

/// Reads the blocks before the present one, of films like `like`.
fn read_before(before: &Before, like: &Film, from: &mut impl Read) -> io::Result<Fold> {
    match before {
        Before::Nothing => Ok(Fold::Sum(None)),
        Before::Sum => {
            let mut sum = HalvedSum::new(like.width(), like.height(), Some(like.rect()), like.layers())
                .map_err(io::Error::other)?;
            sum.restore(from)?;
            Ok(Fold::Sum(Some(Box::new(sum))))
        }
        Before::Blocks(count, bands, seen) => {
            if *bands == 0 && *count > 0 {
                return Err(ErrorKind::InvalidData.into());
            }
            let mut encoded = Vec::new();
            for _ in 0..*count {
                let mut block = EncodedBlock::default();
                for _ in 0..*bands {
                    let mut length = [0; 4];
                    from.read_exact(&mut length)?;
                    let length = u64::from(u32::from_le_bytes(length));
                    let mut band = Vec::new();
                    if (&mut *from).take(length).read_to_end(&mut band)? as u64 != length {
                        return Err(ErrorKind::UnexpectedEof.into());
                    }
                    block.bands.push(band);
                }
                encoded.push(block);
            }
            Ok(Fold::Blocks(Blocks { encoded, seen: seen.clone() }))
        }
    }
}

/// Parses a checkpoint of any render with pictures of this size, and returns the number of its rounds. It is meant for tests of readers;
/// `path` appears in messages.
///
/// # Errors
/// If the checkpoint is damaged or has another size.
pub fn parse_checkpoint_bytes(bytes: &[u8], path: &Path, size: (u32, u32)) -> Result<u64, CheckpointError> {
    let empty = blank(size).map_err(|error| damaged(path, format!("cannot be tested: {error}")))?;
    Checkpoint::parse(bytes, path, None, empty).map(|checkpoint| checkpoint.header.statistics.done)
}

/// A valid checkpoint without rounds at this size, for tests of readers.
///
/// # Errors
/// If no film can have this size.
pub fn blank_checkpoint_bytes(size: (u32, u32)) -> Result<Vec<u8>, FilmError> {
    let identity = [("spp".to_owned(), Value::from(4)), ("scene".to_owned(), Value::from("a"))].into();
    let mut bytes = Vec::new();
    // Writing to a vector cannot fail.
    let _ = Checkpoint::new(identity, Fold::Sum(None), blank(size)?).write_to(&mut bytes);
    Ok(bytes)
}

fn blank((width, height): (u32, u32)) -> Result<[Film; 2], FilmError> {
    let film = || Film::new(width, height, None, LayerSet { bias: true, ..LayerSet::default() });
    Ok([film()?, film()?])
}

fn damaged(path: &Path, what: impl Into<String>) -> CheckpointError {
    CheckpointError::Damaged { path: path.to_owned(), what: what.into() }
}

/// Descriptions of the differences between two identities, such as "spp was 4 and is 8".
pub(super) fn differences(was: &Identity, is: &Identity) -> Vec<String> {
    let names: std::collections::BTreeSet<&String> = was.keys().chain(is.keys()).collect();
    let said = |value: Option<&Value>| match value {
        None | Some(Value::Null) => "not set".to_owned(),
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
    };
    names
        .into_iter()
        .filter(|&name| was.get(name) != is.get(name))
        .map(|name| format!("{name} was {} and is {}", said(was.get(name)), said(is.get(name))))
        .collect()
}

/// A reader or writer that hashes the bytes it passes on.
pub(super) struct Hashing<T> {
    inner: T,
    hasher: blake3::Hasher,
}

impl<T> Hashing<T> {
    fn new(inner: T) -> Self {
        Self { inner, hasher: blake3::Hasher::new() }
    }
}

impl<T: Read> Read for Hashing<T> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..count]);
        Ok(count)
    }
}

impl<T: Write> Write for Hashing<T> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(buffer)?;
        self.hasher.update(&buffer[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
