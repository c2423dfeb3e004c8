//! Parts of a progressive picture: files that hold some of its blocks, rendered on any machine. A file is
//!
//! ```text
//! "cardioid part  \n"     16 bytes
//! version                 u32
//! header                  a chunk of JSON: identity of the render, size, layers, which rounds
//! bands                   for each block, a chunk for each band of rows
//! summary                 a chunk of JSON: statistics of rounds, counters, names of objects, warnings
//! ```
//!
//! A chunk is its length (`u32`), its bytes, and their BLAKE3 (32 bytes). Numbers are little-endian. A block is the sums of
//! [`HalvedSum`]: numbers of single precision (of double precision where the picture has a single block), each as the difference from what
//! its neighbours foretell, deflated byte plane by byte plane.

use super::checkpoint::{Identity, LONGEST_HEADER};
use super::fold::{BLOCK, Blocks, EncodedBlock, Fold, bands, blocks_of, precision_of};
use super::{
    Checkpoint, CheckpointError, Job, Precision, RoundObserver, RoundStatistics, Rounds, Run, start,
    with_bias,
};
use crate::camera::Camera;
use crate::files::open_regular;
use crate::film::{FilmError, HalvedSum, LayerSet, PixelRect};
use crate::image_io::{self, ImageError};
use crate::integrators::Counters;
use crate::observer::Observer;
use crate::render::pixels::{RenderError, RenderRequest};
use crate::render::stats::Times;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// First bytes of a part.
const MAGIC: [u8; 16] = *b"cardioid part  \n";

/// Version of the layout above, of the number of rounds in a block, and of the computation of rounds.
const VERSION: u32 = 1;

/// Bytes of a chunk beside its content.
const AROUND: u64 = 4 + 32;

/// Most pixels on a side of a picture.
const LONGEST_SIDE: u32 = 65_536;

/// Which part of a picture: number `part` of `of`, counted from one. Each part has an equal number of blocks, or one more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct PartRange {
    /// Number of the part, from 1.
    pub part: u64,
    /// Number of parts.
    pub of: u64,
}

impl PartRange {
    /// The first block, and the block after the last, of a picture of so many rounds.
    pub fn blocks(self, rounds: u64) -> [u64; 2] {
        let blocks = u128::from(blocks_of(rounds));
        let at = |part: u64| (u128::from(part) * blocks / u128::from(self.of.max(1))) as u64;
        [at(self.part.saturating_sub(1)), at(self.part)]
    }
}

/// An error of rendering or reading a part.
#[derive(Debug, thiserror::Error)]
pub enum PartError {
    /// There are fewer blocks than parts.
    #[error(
        "{rounds} rounds are {} of {BLOCK}, so there are at most {} parts, and not {of}; ask for fewer parts or for more rounds",
        blocks_in_words(*rounds), blocks_of(*rounds).max(1)
    )]
    TooMany {
        /// Rounds of the picture.
        rounds: u64,
        /// Parts asked for.
        of: u64,
    },
    /// The picture has no fixed number of rounds.
    #[error("a part needs the number of rounds of the whole picture: add --rounds")]
    NoRounds,
    /// The file cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// The file is no part, or is damaged.
    #[error("{} {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The problem, as text that follows the file name.
        what: String,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] ImageError),
}

fn blocks_in_words(rounds: u64) -> String {
    match blocks_of(rounds) {
        1 => "1 block".to_owned(),
        n => format!("{n} blocks"),
    }
}

/// What a part is of.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct PartHeader {
    /// Names and values that all parts of a picture share.
    pub(super) identity: Identity,
    pub(super) width: u32,
    pub(super) height: u32,
    /// The pixels of the part: first column and row, and those after the last.
    pub(super) window: [u32; 4],
    pub(super) layers: LayerSet,
    /// Rounds of the whole picture.
    pub(super) rounds: u64,
    /// First block, and the block after the last.
    pub(super) blocks: [u64; 2],
    pub(super) part: PartRange,
    /// What the caller wants to know at the merge.
    pub(super) about: Value,
}

/// What is known of a part when it is complete.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub(super) struct PartSummary {
    pub(super) statistics: RoundStatistics,
    pub(super) counters: Counters,
    pub(super) times: Times,
    pub(super) rejected: u64,
    /// Names of the objects and materials that its pixels show.
    pub(super) objects: BTreeMap<u32, String>,
    pub(super) materials: BTreeMap<u32, String>,
    pub(super) warnings: Vec<String>,
}

impl PartHeader {
    pub(super) fn rect(&self) -> PixelRect {
        let [x0, y0, x1, y1] = self.window;
        PixelRect { x0, y0, x1, y1 }
    }

    pub(super) fn precision(&self) -> Precision {
        precision_of(self.rounds)
    }

    /// Rounds that a block has.
    pub(super) fn rounds_in(&self, block: u64) -> u64 {
        self.rounds.saturating_sub(block.saturating_mul(BLOCK)).min(BLOCK)
    }

    /// What does not fit together; a file may hold anything.
    fn fault(&self) -> Option<&'static str> {
        let rect = self.rect();
        let is_inside = !rect.is_empty() && PixelRect::whole(self.width, self.height).contains_rect(&rect);
        let [first, end] = self.blocks;
        if self.width.max(self.height) > LONGEST_SIDE || !is_inside {
            Some("has a window that is not in its picture")
        } else if first >= end || end > blocks_of(self.rounds) {
            Some("has rounds that are not in its picture")
        } else {
            None
        }
    }
}

/// What a run for a part came to.
#[derive(Debug)]
pub enum PartOutcome {
    /// All rounds of the part are rendered, and its file is written.
    Whole {
        /// Rounds of the part.
        rounds: u64,
        /// Seconds that they took.
        seconds: f64,
        /// Bytes of the file.
        bytes: u64,
        /// Pixels and blocks of it.
        pixels_and_blocks: [u64; 2],
        /// Warnings.
        warnings: Vec<String>,
    },
    /// The run was stopped.
    Stopped {
        /// Rounds that are rendered.
        done: u64,
        /// Rounds of the part.
        of: u64,
        /// Why they could not be kept.
        failure: Option<CheckpointError>,
    },
}

/// Renders a part of a progressive picture and writes it to `path`. It keeps and resumes rounds as `rounds` says. The picture that all parts
/// are merged to has the bits of a single render.
///
/// # Errors
/// As for [`super::render_in_rounds`], and where the part cannot be or cannot be written.
pub fn render_part(
    scene: &Scene,
    camera: &Camera,
    request: &RenderRequest,
    observer: &dyn Observer,
    (rounds, part, about): (Rounds, PartRange, Value),
    path: &Path,
) -> Result<PartOutcome, RenderError> {
    let header = part_header(scene, request, &rounds, part, about)?;
    let request = &with_bias(scene, request)?;
    let plan = &request.settings.plan(scene);
    let [first, end] = header.blocks;
    let wanted = end.saturating_mul(BLOCK).min(header.rounds) - first * BLOCK;
    let mut identity = header.identity.clone();
    identity.insert(
        "rounds of the part".to_owned(),
        format!("{} to {}", first * BLOCK, first * BLOCK + wanted).into(),
    );
    identity.insert("precision".to_owned(), format!("{:?}", header.precision()).into());
    let state = start(request, &rounds, Fold::Blocks(Blocks::default()), identity)?;
    // Every part needs all glints, however late it is: without them it would be of another picture.
    let patient = RoundObserver { inner: observer, is_first: true };
    let job = Job::new(scene, camera, request, plan, [observer, &patient]);
    let mut run = Run::new(job, state, first * BLOCK, header.precision());
    run.all(&rounds, wanted)?;
    if run.state.header.statistics.done < wanted {
        let done = run.state.header.statistics.done;
        return Ok(PartOutcome::Stopped { done, of: wanted, failure: run.failure });
    }
    run.close()?;
    let Run { job, state, total, .. } = run;
    let Checkpoint { header: kept, fold, .. } = state;
    let Blocks { encoded, seen } = if let Fold::Blocks(blocks) = fold { blocks } else { Blocks::default() };
    let object = |id: u32| scene.surfaces().get(id as usize).map(|surface| surface.name.clone());
    let material = |id: u32| scene.materials().get(id as usize).map(|(name, _)| name.clone());
    let mut warnings = job.warnings;
    let times = total.as_ref().map_or_else(Times::default, |total| total.times);
    warnings.extend(total.into_iter().flat_map(|total| total.warnings));
    let summary = PartSummary {
        times,
        rejected: seen.rejected,
        counters: kept.counters,
        objects: seen.objects.into_iter().filter_map(|id| Some((id, object(id)?))).collect(),
        materials: seen.materials.into_iter().filter_map(|id| Some((id, material(id)?))).collect(),
        warnings: warnings.clone(),
        statistics: kept.statistics,
    };
    let (rounds, seconds) = (wanted, summary.statistics.seconds);
    image_io::write_with(path, |file| write(BufWriter::new(file), &header, &encoded, &summary))
        .map_err(PartError::from)?;
    let bytes = std::fs::metadata(path).map_or(0, |found| found.len());
    let pixels_and_blocks = [header.rect().area() as u64, end - first];
    Ok(PartOutcome::Whole { rounds, seconds, bytes, pixels_and_blocks, warnings })
}

fn part_header(
    scene: &Scene,
    request: &RenderRequest,
    rounds: &Rounds,
    part: PartRange,
    about: Value,
) -> Result<PartHeader, RenderError> {
    let request = &with_bias(scene, request)?;
    let Some(wanted) = request.settings.rounds else { return Err(PartError::NoRounds.into()) };
    let [first, end] = part.blocks(wanted);
    if part.of > blocks_of(wanted) || first >= end {
        return Err(PartError::TooMany { rounds: wanted, of: part.of }.into());
    }
    let RenderRequest { width, height, crop, layers, .. } = *request;
    let window = crop.unwrap_or(PixelRect::whole(width, height));
    let header = PartHeader {
        identity: rounds.identity_of(request),
        width,
        height,
        window: [window.x0, window.y0, window.x1, window.y1],
        layers,
        rounds: wanted,
        blocks: [first, end],
        part,
        about,
    };
    match header.fault() {
        None => Ok(header),
        Some(_) => Err(FilmError::Crop { crop: window, width, height }.into()),
    }
}

/// Whether the file at `path` is the part that this request would render: `Some(false)` where it is another part or none, `None` where there
/// is no file. A complete part need not be rendered again.
///
/// # Errors
/// As for [`render_part`], where the part cannot be.
pub fn is_part_of(
    path: &Path,
    scene: &Scene,
    request: &RenderRequest,
    (rounds, part): (&Rounds, PartRange),
) -> Result<Option<bool>, RenderError> {
    let header = part_header(scene, request, rounds, part, Value::Null)?;
    if !path.exists() {
        return Ok(None);
    }
    let found = PartFile::open(path).map(|found| found.header);
    Ok(Some(found.is_ok_and(|found| PartHeader { about: Value::Null, ..found } == header)))
}

fn write(
    mut to: impl Write,
    header: &PartHeader,
    blocks: &[EncodedBlock],
    summary: &PartSummary,
) -> io::Result<()> {
    to.write_all(&MAGIC)?;
    to.write_all(&VERSION.to_le_bytes())?;
    let mut chunk = |bytes: &[u8]| {
        let length = u32::try_from(bytes.len()).map_err(|_| ErrorKind::FileTooLarge)?;
        to.write_all(&length.to_le_bytes())?;
        to.write_all(bytes)?;
        to.write_all(blake3::hash(bytes).as_bytes())
    };
    chunk(&serde_json::to_vec(header)?)?;
    blocks.iter().flat_map(|block| &block.bands).try_for_each(|band| chunk(band))?;
    chunk(&serde_json::to_vec(summary)?)?;
    to.flush()
}

/// Where a part's bytes are read.
pub(super) trait Bytes: Send + Sync {
    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<()>;
}

impl Bytes for File {
    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<()> {
        self.read_exact_at(buffer, at)
    }
}

impl Bytes for Vec<u8> {
    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<()> {
        let start = usize::try_from(at).map_err(|_| ErrorKind::UnexpectedEof)?;
        let end = start.checked_add(buffer.len()).ok_or(ErrorKind::UnexpectedEof)?;
        buffer.copy_from_slice(self.get(start..end).ok_or(ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

/// Names the file to open again, for each read: where there are too many to keep them open.
struct Closed(PathBuf);

impl Bytes for Closed {
    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<()> {
        open_regular(&self.0)?.0.read_exact_at(buffer, at)
    }
}

/// A part's file, of which all but the bands was read.
pub(super) struct PartFile {
    pub(super) path: PathBuf,
    pub(super) header: PartHeader,
    pub(super) summary: PartSummary,
    bytes: Box<dyn Bytes>,
    /// Start and length of the chunks of bands.
    chunks: Vec<(u64, u32)>,
}

impl PartFile {
    pub(super) fn open(path: &Path) -> Result<Self, PartError> {
        let read = |error| PartError::Read { path: path.to_owned(), error };
        let (file, length) = open_regular(path).map_err(read)?;
        Self::parse(Box::new(file), length, path)
    }

    /// The same file, closed between reads.
    pub(super) fn closed(self) -> Self {
        Self { bytes: Box::new(Closed(self.path.clone())), ..self }
    }

    fn parse(bytes: Box<dyn Bytes>, length: u64, path: &Path) -> Result<Self, PartError> {
        let damaged = |what: &str| PartError::Damaged { path: path.to_owned(), what: what.to_owned() };
        let mut start = [0; 20];
        let is_part = length >= 20 && {
            bytes.read_at(&mut start, 0).map_err(|error| failed(path, error))?;
            start[..16] == MAGIC
        };
        if !is_part {
            return Err(damaged("is not what `cardioid part` writes"));
        }
        let version = u32::from_le_bytes([start[16], start[17], start[18], start[19]]);
        if version != VERSION {
            let what = format!(
                "was written by another version of cardioid ({version}, and this one reads {VERSION})"
            );
            return Err(damaged(&what));
        }
        let mut chunks = Vec::new();
        let mut at = 20;
        while at < length {
            let mut four = [0; 4];
            bytes.read_at(&mut four, at).map_err(|error| failed(path, error))?;
            let size = u32::from_le_bytes(four);
            chunks.push((at, size));
            at += AROUND + u64::from(size);
        }
        if at != length || chunks.len() < 2 {
            return Err(damaged("ends too early; it is damaged"));
        }
        let mut part = Self {
            path: path.to_owned(),
            header: PartHeader {
                identity: Identity::new(),
                width: 0,
                height: 0,
                window: [0; 4],
                layers: LayerSet::default(),
                rounds: 0,
                blocks: [0; 2],
                part: PartRange { part: 1, of: 1 },
                about: Value::Null,
            },
            summary: PartSummary::default(),
            bytes,
            chunks: Vec::new(),
        };
        let summary = chunks.pop().unwrap_or_default();
        let header = chunks.remove(0);
        if header.1.max(summary.1) > LONGEST_HEADER {
            return Err(damaged("is damaged"));
        }
        part.header = serde_json::from_slice(&part.chunk(header)?).map_err(|_| damaged("is damaged"))?;
        part.summary = serde_json::from_slice(&part.chunk(summary)?).map_err(|_| damaged("is damaged"))?;
        if let Some(fault) = part.header.fault() {
            return Err(damaged(fault));
        }
        let [first, end] = part.header.blocks;
        let wanted = (end - first).checked_mul(bands(part.header.rect()).len() as u64);
        if wanted != Some(chunks.len() as u64) {
            return Err(damaged("lacks some of its rounds; it is damaged"));
        }
        part.chunks = chunks;
        Ok(part)
    }

    /// Bytes of the file.
    pub(super) fn length(&self) -> u64 {
        self.chunks.iter().map(|&(_, size)| AROUND + u64::from(size)).sum()
    }

    fn chunk(&self, (at, size): (u64, u32)) -> Result<Vec<u8>, PartError> {
        let mut bytes = vec![0; size as usize + 32];
        self.bytes.read_at(&mut bytes, at + 4).map_err(|error| failed(&self.path, error))?;
        let checksum = bytes.split_off(size as usize);
        if checksum != blake3::hash(&bytes).as_bytes() {
            let what = "is damaged: a checksum is wrong; remove it and render it again".to_owned();
            return Err(PartError::Damaged { path: self.path.clone(), what });
        }
        Ok(bytes)
    }

    /// Reads a band of a block, both counted from zero in the picture.
    pub(super) fn read(&self, block: u64, band: usize, into: &mut HalvedSum) -> Result<(), PartError> {
        let bands = bands(self.header.rect()).len();
        let index = (block - self.header.blocks[0]) as usize * bands + band;
        let damaged = || PartError::Damaged { path: self.path.clone(), what: "is damaged".to_owned() };
        let chunk = *self.chunks.get(index).ok_or_else(damaged)?;
        into.decode(&self.chunk(chunk)?, self.header.precision()).map_err(|_| damaged())
    }
}

fn failed(path: &Path, error: io::Error) -> PartError {
    if error.kind() == ErrorKind::UnexpectedEof {
        let what = "ends too early; it is damaged".to_owned();
        return PartError::Damaged { path: path.to_owned(), what };
    }
    PartError::Read { path: path.to_owned(), error }
}

/// Reads a part from memory, with all of its bands, and returns the number of its rounds. It is meant for tests of readers; `path` appears in
/// messages.
///
/// # Errors
/// If the part is damaged, or larger than `most` pixels.
pub fn parse_part_bytes(bytes: &[u8], path: &Path, most: usize) -> Result<u64, PartError> {
    let part = PartFile::parse(Box::new(bytes.to_vec()), bytes.len() as u64, path)?;
    let header = &part.header;
    let damaged = |what: &str| PartError::Damaged { path: path.to_owned(), what: what.to_owned() };
    if header.rect().area() > most {
        return Err(damaged("is too large to be tested"));
    }
    for block in header.blocks[0]..header.blocks[1] {
        for (band, rows) in bands(header.rect()).into_iter().enumerate() {
            let rect = PixelRect { y0: rows.start, y1: rows.end, ..header.rect() };
            let mut sum = HalvedSum::new(header.width, header.height, Some(rect), header.layers)
                .map_err(|error| damaged(&error.to_string()))?;
            part.read(block, band, &mut sum)?;
        }
    }
    Ok((header.blocks[0]..header.blocks[1]).map(|block| header.rounds_in(block)).sum())
}

/// A valid part of so many blocks of a black picture of this size, for tests of readers.
///
/// # Errors
/// If no film can have this size.
pub fn blank_part_bytes((width, height): (u32, u32), blocks: u64) -> Result<Vec<u8>, FilmError> {
    let layers = LayerSet { bias: true, ..LayerSet::all() };
    let film = || crate::film::Film::new(width, height, None, layers);
    let mut fold = Fold::Blocks(Blocks::default());
    let rounds = blocks * BLOCK;
    for _ in 0..blocks {
        fold.add([film()?, film()?], precision_of(rounds))?;
    }
    let header = PartHeader {
        identity: [("spp".to_owned(), Value::from(4))].into(),
        width,
        height,
        window: [0, 0, width, height],
        layers,
        rounds,
        blocks: [0, blocks],
        part: PartRange { part: 1, of: 1 },
        about: Value::Null,
    };
    let mut bytes = Vec::new();
    if let Fold::Blocks(Blocks { encoded, .. }) = &fold {
        // Writing to a vector cannot fail.
        let _ = write(&mut bytes, &header, encoded, &PartSummary::default());
    }
    Ok(bytes)
}
