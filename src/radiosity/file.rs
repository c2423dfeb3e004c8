//! Files of radiosity solutions: which elements are divided, the links, and the light on all patches.
//!
//! A header, the content, and a checksum over both; all numbers little-endian. The patches themselves are made again from the scene, which
//! a hash identifies. A file is never trusted: its length and the checksum come first, and every number is checked before it is used.

use super::key::Key;
use super::links::Link;
use super::model::{Model, NONE};
use super::refine::Hierarchy;
use super::{PatchIrradiance, Radiosity};
use crate::files::open_regular;
use crate::math::Rgb;
use glam::DVec3;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// First bytes: one byte that no text contains, letters, and line ends that a transfer as text would change.
const MAGIC: [u8; 8] = *b"\x89CRS\r\n\x1a\n";

/// Version of the layout that this program writes and reads.
pub const RADIOSITY_FILE_VERSION: u32 = 1;

/// Bytes before the lists: magic, version, two hashes, sweeps, five lengths.
const HEAD: usize = 8 + 4 + 2 * 32 + 4 + 5 * 8;

/// Bytes of a link, of the light on an element, and of the light at a corner.
const LINK: usize = 28;
const LIGHT: usize = 3 * 8 + 6 * 4;
const CORNER: usize = 6 * 4;

/// Why a file of a solution was refused.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct RadiosityFileError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: String,
}

/// A solution as read from a file. [`Radiosity::compute`] takes from it what still holds.
#[derive(Clone, Debug)]
pub struct SavedRadiosity {
    pub(super) keys: [Key; 2],
    pub(super) sweeps: u32,
    /// Elements in the order in which they were divided.
    divided: Vec<u32>,
    links: Vec<Link>,
    pub(super) radiosity: Vec<DVec3>,
    pub(super) irradiance: Vec<PatchIrradiance>,
    /// At the corners of patches.
    pub(super) corners: Vec<PatchIrradiance>,
}

/// Writes a solution.
///
/// # Errors
/// Where `out` fails.
pub fn write_radiosity(out: &mut impl Write, solution: &Radiosity) -> io::Result<()> {
    let Radiosity { model, links, state, irradiance, vertices, report, keys } = solution;
    let corners = vertices.values();
    let mut divided: Vec<(u32, u32)> = model
        .elements
        .iter()
        .enumerate()
        .filter(|(_, element)| element.children != NONE)
        .map(|(index, element)| (element.children, index as u32))
        .collect();
    divided.sort_unstable();
    let mut hasher = blake3::Hasher::new();
    let mut write = |bytes: &[u8]| {
        hasher.update(bytes);
        out.write_all(bytes)
    };
    write(&MAGIC)?;
    write(&RADIOSITY_FILE_VERSION.to_le_bytes())?;
    keys.iter().try_for_each(|key| write(key))?;
    write(&report.sweeps.to_le_bytes())?;
    for length in [model.roots as usize, divided.len(), links.len(), irradiance.len(), corners.len()] {
        write(&(length as u64).to_le_bytes())?;
    }
    divided.iter().try_for_each(|(_, index)| write(&index.to_le_bytes()))?;
    for Link { ends, exchange, error, seen, spread } in links {
        ends.iter().try_for_each(|end| write(&end.to_le_bytes()))?;
        [exchange, error, seen, &spread[0], &spread[1]]
            .into_iter()
            .try_for_each(|x| write(&x.to_le_bytes()))?;
    }
    for (radiosity, PatchIrradiance { direct, indirect }) in state.radiosity.iter().zip(irradiance) {
        radiosity.to_array().iter().try_for_each(|x| write(&x.to_le_bytes()))?;
        [direct, indirect]
            .into_iter()
            .flat_map(|rgb| rgb.to_array())
            .try_for_each(|x| write(&x.to_le_bytes()))?;
    }
    for PatchIrradiance { direct, indirect } in corners {
        let values = [direct, indirect].into_iter().flat_map(|rgb| rgb.to_array());
        values.into_iter().try_for_each(|x| write(&x.to_le_bytes()))?;
    }
    let sum = *hasher.finalize().as_bytes();
    out.write_all(&sum)
}

/// Reads a solution.
///
/// # Errors
/// If the file cannot be read, is not such a file, or is damaged.
pub fn read_radiosity(path: &Path) -> Result<SavedRadiosity, RadiosityFileError> {
    let fail = |problem: String| RadiosityFileError { file: path.to_owned(), problem };
    let unread = |error: io::Error| fail(format!("cannot be read: {error}; check its name and permissions"));
    let (file, length) = open_regular(path).map_err(unread)?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(unread)?;
    parse(&bytes).map_err(|problem| fail(problem.to_owned()))
}

const FOREIGN: &str =
    "is not a file of a radiosity solution; make one with `cardioid radiosity SCENE --solution FILE`";
const DAMAGED: &str = "is damaged or incomplete; remove it, and it is made again";

/// Numbers of a file, one after the other.
struct Cursor<'a>(&'a [u8]);

impl Cursor<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], &'static str> {
        let (head, rest) = self.0.split_first_chunk::<N>().ok_or(DAMAGED)?;
        self.0 = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32, &'static str> {
        self.take().map(u32::from_le_bytes)
    }

    fn f32(&mut self) -> Result<f32, &'static str> {
        let value = f32::from_le_bytes(self.take()?);
        if value.is_finite() { Ok(value) } else { Err(DAMAGED) }
    }

    fn rgb(&mut self) -> Result<Rgb, &'static str> {
        Ok(Rgb::new(self.f32()?, self.f32()?, self.f32()?))
    }

    fn f64(&mut self) -> Result<f64, &'static str> {
        let value = f64::from_le_bytes(self.take()?);
        if value.is_finite() { Ok(value) } else { Err(DAMAGED) }
    }
}

pub(super) fn parse(bytes: &[u8]) -> Result<SavedRadiosity, &'static str> {
    if !bytes.starts_with(&MAGIC) {
        return Err(FOREIGN);
    }
    let (content, sum) = bytes.split_last_chunk::<{ blake3::OUT_LEN }>().ok_or(DAMAGED)?;
    let mut cursor = Cursor(content.get(MAGIC.len()..).ok_or(DAMAGED)?);
    if cursor.u32()? != RADIOSITY_FILE_VERSION {
        return Err("is of another version of this program; remove it, and it is made again");
    }
    if blake3::hash(content).as_bytes() != sum || content.len() < HEAD {
        return Err(DAMAGED);
    }
    let keys = [cursor.take()?, cursor.take()?];
    let sweeps = cursor.u32()?;
    let mut lengths = [0usize; 5];
    for length in &mut lengths {
        *length = usize::try_from(u64::from_le_bytes(cursor.take()?)).map_err(|_| DAMAGED)?;
    }
    let [roots, divided, links, elements, corners] = lengths;
    let sizes = [(divided, 4), (links, LINK), (elements, LIGHT), (corners, CORNER)];
    let declared = sizes.iter().try_fold(0usize, |sum, &(n, size)| sum.checked_add(n.checked_mul(size)?));
    let made = divided.checked_mul(4).and_then(|n| n.checked_add(roots));
    if declared != Some(cursor.0.len()) || made != Some(elements) || elements >= NONE as usize {
        return Err(DAMAGED);
    }
    let divided = (0..divided).map(|_| cursor.u32()).collect::<Result<Vec<_>, _>>()?;
    let mut all = SavedRadiosity {
        keys,
        sweeps,
        divided,
        links: Vec::with_capacity(links),
        radiosity: Vec::with_capacity(elements),
        irradiance: Vec::with_capacity(elements),
        corners: Vec::with_capacity(corners),
    };
    for _ in 0..links {
        let ends = [cursor.u32()?, cursor.u32()?];
        if ends.iter().any(|&end| end as usize >= elements) {
            return Err(DAMAGED);
        }
        let (exchange, error, seen) = (cursor.f32()?, cursor.f32()?, cursor.f32()?);
        all.links.push(Link { ends, exchange, error, seen, spread: [cursor.f32()?, cursor.f32()?] });
    }
    for _ in 0..elements {
        all.radiosity.push(DVec3::new(cursor.f64()?, cursor.f64()?, cursor.f64()?));
        all.irradiance.push(PatchIrradiance { direct: cursor.rgb()?, indirect: cursor.rgb()? });
    }
    for _ in 0..corners {
        all.corners.push(PatchIrradiance { direct: cursor.rgb()?, indirect: cursor.rgb()? });
    }
    Ok(all)
}

impl SavedRadiosity {
    /// Divides the patches of `hierarchy` as they were, and restores the links. Returns false, and changes nothing, where the file does not
    /// fit the scene.
    pub(super) fn restore(&self, hierarchy: &mut Hierarchy<'_>) -> bool {
        let roots = self.irradiance.len().checked_sub(4 * self.divided.len());
        if roots != Some(hierarchy.model.roots as usize) {
            return false;
        }
        let mut made = hierarchy.model.roots as usize;
        let mut seen = vec![false; self.irradiance.len()];
        for &index in &self.divided {
            match seen.get_mut(index as usize).filter(|seen| (index as usize) < made && !**seen) {
                Some(seen) => *seen = true,
                None => return false,
            }
            made += 4;
        }
        for &index in &self.divided {
            hierarchy.model.divide(index);
        }
        hierarchy.links.clone_from(&self.links);
        hierarchy.evaluate();
        true
    }

    /// Whether there is light for every element.
    pub(super) fn fits(&self, model: &Model) -> bool {
        self.irradiance.len() == model.elements.len()
    }
}
