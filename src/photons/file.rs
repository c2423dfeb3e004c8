//! Photon map files: 20 bytes for each photon, and a checksum over every part.
//!
//! A file is a fixed header followed by sections, all numbers little-endian (`docs/photon-map-files.md` has the
//! layout). It holds the photons and not their trees, which are functions of the set of photons: a map that is read has
//! the same bits as the one that was written. The first section is a text about the program that wrote the file, which
//! this module does not interpret.
//!
//! A file is never trusted: the sizes that it declares are compared with its length before memory is allocated, and
//! memory stays below the size of the file.

use super::irradiance::{IRRADIANCE_RECORD, IrradianceMap};
use super::{Photon, PhotonMap};
use crate::files::open_regular;
use crate::scene::MapKind;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

/// First bytes: one byte that no text contains, letters, and line ends that a transfer as text would change.
const MAGIC: [u8; 8] = *b"\x89CPM\r\n\x1a\n";

/// Version of the layout that this program writes and reads.
pub const PHOTON_FILE_VERSION: u32 = 3;

/// Marker of the byte order: bytes 1, 2, 3, 4 in a little-endian file.
const BYTE_ORDER: u32 = 0x0403_0201;

/// Bytes of the header without its checksum.
const HEAD: usize = 32;

/// Bytes of a checksum (BLAKE3).
const SUM: usize = blake3::OUT_LEN;

/// Bytes of the header of a section: name, a zero, length.
const SECTION_HEAD: usize = 16;

/// Bytes of a photon.
const PHOTON: usize = 20;

/// Bytes of the header of a map: emitted, dropped, count.
const MAP_HEAD: usize = 24;

/// Longest text of the first section.
const LONGEST_TEXT: u64 = 16 << 20;

/// Records that are converted at a time.
const BATCH: usize = 4096;

/// A tree counts its points in 32 bits.
const MOST_RECORDS: usize = 4_000_000_000;

/// Names of the sections in files.
const TEXT: [u8; 4] = *b"TEXT";
const GLOBAL: [u8; 4] = *b"GLOB";
const CAUSTIC: [u8; 4] = *b"CAUS";
const IRRADIANCE: [u8; 4] = *b"IRRA";

/// Why a file of photon maps was refused.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct PhotonFileError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: PhotonFileProblem,
}

/// Problems of a file of photon maps.
#[derive(Debug, thiserror::Error)]
pub enum PhotonFileProblem {
    /// The system reported an error.
    #[error("cannot be read: {0}; check its name and permissions")]
    Io(#[from] io::Error),
    /// It is another kind of file.
    #[error("is not a file of photon maps; make one with `cardioid photons SCENE -o FILE`")]
    Foreign,
    /// It has another version of the layout.
    #[error(
        "is of version {0}, and this program reads version {PHOTON_FILE_VERSION}; make it again with `cardioid photons`"
    )]
    Version(u32),
    /// It is shorter or longer than declared.
    #[error(
        "has {found} bytes instead of {declared}: it is incomplete or was added to; copy it again, or make it again"
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
    Damaged(&'static str),
    /// The checksums are right, but the content is not valid: another program wrote it.
    #[error("{0}; make it again with `cardioid photons`")]
    Content(&'static str),
}

use PhotonFileProblem as Problem;

/// The photons of one map, as a file holds them.
#[derive(Clone, Debug)]
pub struct SavedPhotons {
    /// Which map.
    pub kind: MapKind,
    /// Number of photons that the lights emitted.
    pub emitted: u64,
    /// Number of photons that were left out because their position was not finite.
    pub dropped: u64,
    /// The photons, in any order.
    pub photons: Vec<Photon>,
}

/// Content of a file.
#[derive(Clone, Debug)]
pub struct PhotonFile {
    /// Text about the program that wrote it.
    pub text: String,
    /// The maps, at most one of each kind.
    pub maps: Vec<SavedPhotons>,
    /// Irradiance precomputed at photons of the global map.
    pub irradiance: Option<IrradianceMap>,
    /// Bytes of the file.
    pub bytes: u64,
}

fn name_of(kind: MapKind) -> [u8; 4] {
    match kind {
        MapKind::Global => GLOBAL,
        MapKind::Caustic => CAUSTIC,
    }
}

/// Name of a section in messages.
fn words_for(name: [u8; 4]) -> &'static str {
    match name {
        TEXT => "its description",
        GLOBAL => "its global map",
        CAUSTIC => "its caustic map",
        IRRADIANCE => "its precomputed irradiance",
        _ => "a part of it",
    }
}

/// Writes maps and irradiance, with `text` as the first section.
///
/// # Errors
/// Where `out` fails, or `text` is longer than the reader accepts.
pub fn write_photon_file(
    out: &mut impl Write,
    text: &str,
    maps: &[(MapKind, &PhotonMap)],
    irradiance: Option<&IrradianceMap>,
) -> io::Result<()> {
    if text.len() as u64 > LONGEST_TEXT {
        return Err(io::Error::other("its description is too long"));
    }
    let sizes = std::iter::once(text.len())
        .chain(maps.iter().map(|(_, map)| MAP_HEAD + map.len() * PHOTON))
        .chain(irradiance.map(|map| map.len() * IRRADIANCE_RECORD));
    let (count, content) = sizes.fold((0u32, 0u64), |(count, sum), size| (count + 1, sum + size as u64));
    let length = (HEAD + SUM) as u64 + u64::from(count) * (SECTION_HEAD + SUM) as u64 + content;
    let mut head = Vec::with_capacity(HEAD);
    head.extend(MAGIC);
    head.extend(PHOTON_FILE_VERSION.to_le_bytes());
    head.extend(BYTE_ORDER.to_le_bytes());
    head.extend(length.to_le_bytes());
    head.extend(count.to_le_bytes());
    head.extend((PHOTON as u32).to_le_bytes());
    out.write_all(&head)?;
    out.write_all(blake3::hash(&head).as_bytes())?;
    let mut section = Section::begin(out, TEXT, text.len())?;
    section.write(text.as_bytes())?;
    section.end()?;
    let mut batch = Vec::with_capacity(BATCH * PHOTON);
    for (kind, map) in maps {
        let mut section = Section::begin(out, name_of(*kind), MAP_HEAD + map.len() * PHOTON)?;
        [map.emitted(), map.dropped(), map.len() as u64]
            .iter()
            .try_for_each(|number| section.write(&number.to_le_bytes()))?;
        for first in (0..map.len()).step_by(BATCH) {
            batch.clear();
            (first..map.len().min(first + BATCH)).for_each(|i| batch.extend(map.photon(i).to_bytes()));
            section.write(&batch)?;
        }
        section.end()?;
    }
    if let Some(map) = irradiance {
        let mut section = Section::begin(out, IRRADIANCE, map.len() * IRRADIANCE_RECORD)?;
        for first in (0..map.len()).step_by(BATCH) {
            batch.clear();
            (first..map.len().min(first + BATCH)).for_each(|i| batch.extend(map.record(i)));
            section.write(&batch)?;
        }
        section.end()?;
    }
    Ok(())
}

/// A section that is being written, and its checksum.
struct Section<'a, W> {
    out: &'a mut W,
    sum: blake3::Hasher,
}

impl<'a, W: Write> Section<'a, W> {
    fn begin(out: &'a mut W, name: [u8; 4], length: usize) -> io::Result<Self> {
        let mut section = Self { out, sum: blake3::Hasher::new() };
        section.write(&name)?;
        section.write(&[0; 4])?;
        section.write(&(length as u64).to_le_bytes())?;
        Ok(section)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.sum.update(bytes);
        self.out.write_all(bytes)
    }

    fn end(self) -> io::Result<()> {
        self.out.write_all(self.sum.finalize().as_bytes())
    }
}

/// Reads a file of photon maps.
///
/// # Errors
/// The error names the file, the problem and the remedy.
pub fn read_photon_file(path: &Path) -> Result<PhotonFile, PhotonFileError> {
    let in_file = |problem| PhotonFileError { file: path.to_owned(), problem };
    let (file, length) = open_regular(path).map_err(|error| in_file(error.into()))?;
    read_photon_maps(&mut BufReader::with_capacity(1 << 18, file), length).map_err(in_file)
}

/// Reads photon maps of `length` bytes in total.
///
/// # Errors
/// The problem.
pub fn read_photon_maps(from: &mut impl Read, length: u64) -> Result<PhotonFile, PhotonFileProblem> {
    let mut input = Input { from, left: length, length };
    let sections = input.head()?;
    let mut file = PhotonFile { text: String::new(), maps: Vec::new(), irradiance: None, bytes: length };
    let mut names = Vec::new();
    for number in 0..sections {
        let section = input.section()?;
        let name = section.name;
        // This also bounds the number of sections.
        if names.contains(&name) || (number == 0) != (name == TEXT) {
            return Err(Problem::Content("its parts are not those of a file of photon maps"));
        }
        names.push(name);
        match name {
            TEXT => file.text = section.text()?,
            GLOBAL => file.maps.push(section.photons(MapKind::Global)?),
            CAUSTIC => file.maps.push(section.photons(MapKind::Caustic)?),
            IRRADIANCE => file.irradiance = Some(section.irradiance()?),
            _ => return Err(Problem::Content("it has a part of an unknown kind")),
        }
    }
    match input.left {
        0 if !names.is_empty() => Ok(file),
        0 => Err(Problem::Content("it holds nothing")),
        left => Err(Problem::Length { declared: length - left, found: length }),
    }
}

/// The declared length of a section exceeds the file.
const TOO_LONG: Problem = Problem::Content("its parts are longer than it is");

fn read_exactly(from: &mut impl Read, bytes: &mut [u8]) -> Result<(), Problem> {
    from.read_exact(bytes).map_err(|error| match error.kind() == io::ErrorKind::UnexpectedEof {
        true => Problem::Content("it became shorter while it was read"),
        false => error.into(),
    })
}

/// A file that is being read, and the number of bytes left.
struct Input<'a, R> {
    from: &'a mut R,
    left: u64,
    length: u64,
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[at..at + N]);
    array
}

impl<R: Read> Input<'_, R> {
    /// Fills `bytes`; an error where fewer bytes are left.
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), Problem> {
        self.left = self.left.checked_sub(bytes.len() as u64).ok_or(TOO_LONG)?;
        read_exactly(self.from, bytes)
    }

    /// Reads the header; returns the number of sections.
    fn head(&mut self) -> Result<u32, Problem> {
        if self.length < (HEAD + SUM) as u64 {
            let mut start = vec![0; self.length as usize];
            read_exactly(self.from, &mut start)?;
            let known = start.len().min(MAGIC.len());
            let is_ours = known > 0 && start[..known] == MAGIC[..known];
            let (declared, found) = ((HEAD + SUM) as u64, self.length);
            return Err(if is_ours { Problem::Length { declared, found } } else { Problem::Foreign });
        }
        let mut head = [0; HEAD + SUM];
        self.fill(&mut head)?;
        if head[..MAGIC.len()] != MAGIC {
            return Err(Problem::Foreign);
        }
        if blake3::hash(&head[..HEAD]).as_bytes()[..] != head[HEAD..] {
            return Err(Problem::Damaged("its head"));
        }
        let version = u32::from_le_bytes(number(&head, 8));
        if version != PHOTON_FILE_VERSION {
            return Err(Problem::Version(version));
        }
        if u32::from_le_bytes(number(&head, 12)) != BYTE_ORDER {
            return Err(Problem::Content("its numbers have another order of bytes"));
        }
        let declared = u64::from_le_bytes(number(&head, 16));
        if declared != self.length {
            return Err(Problem::Length { declared, found: self.length });
        }
        if u32::from_le_bytes(number(&head, 28)) != PHOTON as u32 {
            return Err(Problem::Content("its photons have another size"));
        }
        Ok(u32::from_le_bytes(number(&head, 24)))
    }

    fn section(&mut self) -> Result<Incoming<'_, R>, Problem> {
        let mut head = [0; SECTION_HEAD];
        self.fill(&mut head)?;
        let length = u64::from_le_bytes(number(&head, 8));
        if self.left.checked_sub(SUM as u64).is_none_or(|left| length > left) {
            return Err(TOO_LONG);
        }
        let mut sum = blake3::Hasher::new();
        sum.update(&head);
        let left = usize::try_from(length).map_err(|_| TOO_LONG)?;
        Ok(Incoming { name: number(&head, 0), sum, left, from: self.from, file_left: &mut self.left })
    }
}

/// A section that is being read; the file holds its `left` bytes.
struct Incoming<'a, R> {
    name: [u8; 4],
    sum: blake3::Hasher,
    left: usize,
    from: &'a mut R,
    file_left: &'a mut u64,
}

impl<R: Read> Incoming<'_, R> {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), Problem> {
        read_exactly(self.from, bytes)?;
        self.sum.update(bytes);
        self.left -= bytes.len();
        *self.file_left -= bytes.len() as u64;
        Ok(())
    }

    /// Compares the checksum, after all content has been read.
    fn end(self) -> Result<(), Problem> {
        let mut sum = [0; SUM];
        read_exactly(self.from, &mut sum)?;
        *self.file_left -= SUM as u64;
        match self.left == 0 && *self.sum.finalize().as_bytes() == sum {
            true => Ok(()),
            false => Err(Problem::Damaged(words_for(self.name))),
        }
    }

    fn text(mut self) -> Result<String, Problem> {
        if self.left as u64 > LONGEST_TEXT {
            return Err(Problem::Content("its description is too long"));
        }
        let mut bytes = vec![0; self.left];
        self.fill(&mut bytes)?;
        self.end()?;
        String::from_utf8(bytes).map_err(|_| Problem::Content("its description is no text"))
    }

    /// All remaining records of `N` bytes. `None` if `turn` refuses one of them, if the last one is incomplete, or if
    /// there are more than [`MOST_RECORDS`].
    fn records<T, const N: usize>(
        &mut self,
        turn: impl Fn([u8; N]) -> Option<T>,
    ) -> Result<Option<Vec<T>>, Problem> {
        let count = self.left / N;
        if count > MOST_RECORDS {
            return Ok(None);
        }
        let mut records = Vec::with_capacity(count);
        let mut batch = vec![0; BATCH.min(count) * N];
        let mut is_sound = self.left == count * N;
        while records.len() < count && is_sound {
            let size = BATCH.min(count - records.len()) * N;
            self.fill(&mut batch[..size])?;
            for record in batch[..size].chunks_exact(N) {
                match turn(number(record, 0)) {
                    Some(record) => records.push(record),
                    None => is_sound = false,
                }
            }
        }
        Ok(is_sound.then_some(records))
    }

    fn photons(mut self, kind: MapKind) -> Result<SavedPhotons, Problem> {
        if self.left < MAP_HEAD {
            return Err(Problem::Damaged(words_for(self.name)));
        }
        let mut head = [0; MAP_HEAD];
        self.fill(&mut head)?;
        let [emitted, dropped, count] = [0, 8, 16].map(|at| u64::from_le_bytes(number(&head, at)));
        let photons = self.records(Photon::from_bytes)?;
        let name = words_for(self.name);
        let photons = photons.filter(|photons| photons.len() as u64 == count);
        let Some(photons) = photons else { return Err(Problem::Damaged(name)) };
        self.end()?;
        Ok(SavedPhotons { kind, emitted, dropped, photons })
    }

    fn irradiance(mut self) -> Result<IrradianceMap, Problem> {
        let name = words_for(self.name);
        let map = self.records(IrradianceMap::point)?.ok_or(Problem::Damaged(name))?;
        self.end()?;
        Ok(IrradianceMap::of_points(map))
    }
}

#[cfg(test)]
mod tests;
