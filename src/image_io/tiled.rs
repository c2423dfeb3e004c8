//! Pictures with tiles and levels, each level half as large as the one before. Only the tiles in use lie in memory, in OpenImageIO's
//! cache.

use super::ImageError;
use super::oiio::{Failure, Headers, Level, Sample, Tiles, limit_tiles, write_tiles};
use super::read::{damaged, recognise};
use std::collections::BTreeMap;
use std::ffi::CString;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A picture on disk whose tiles are read on demand. All such pictures share one cache, see [`set_tile_memory`].
#[derive(Debug)]
pub struct TiledImage {
    tiles: Tiles,
    headers: Headers,
    /// Name of the file, for messages.
    path: PathBuf,
    /// A temporary file without a name, which the system deletes when it is closed.
    _file: Option<File>,
}

/// Errors of reading tiles during a render, by file; see [`take_tile_failures`].
static FAILURES: Mutex<BTreeMap<PathBuf, String>> = Mutex::new(BTreeMap::new());

/// Sets the memory limit in bytes for the tiles of all pictures together; the default of OpenImageIO is 256 MiB. Tiles in use stay in
/// memory, and each thread keeps two.
///
/// # Errors
/// [`ImageError::Library`] if OpenImageIO cannot be loaded.
pub fn set_tile_memory(bytes: u64) -> Result<(), ImageError> {
    limit_tiles(bytes as f32 / (1 << 20) as f32).map_err(|failure| damaged(Path::new(""), failure))
}

/// Errors of reading tiled pictures since the last call, one for each file: the file was damaged, or changed or removed after it was
/// opened. Texels that cannot be read are black with alpha 1.
pub fn take_tile_failures() -> Vec<String> {
    let mut failures = FAILURES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    std::mem::take(&mut *failures).into_values().collect()
}

impl TiledImage {
    /// Opens a file with tiles and levels, such as from `maketx` (TIFF or EXR); `None` for any other picture.
    ///
    /// # Errors
    /// As for [`super::read`], except errors that appear only when pixels are read.
    pub fn open(path: &Path) -> Result<Option<Self>, ImageError> {
        let kind = recognise(path, u64::MAX)?;
        if kind != c"tiff" && kind != c"openexr" {
            return Ok(None);
        }
        let name = CString::new(path.as_os_str().as_bytes());
        let name = name.map_err(|error| ImageError::Read { path: path.to_owned(), cause: error.into() })?;
        let tiles = Tiles::open(&name).map_err(|failure| damaged(path, failure))?;
        let headers = tiles.headers();
        let has_levels = headers.is_tiled && headers.levels.len() > 1;
        if !has_levels || headers.levels.iter().flatten().any(|&side| side == 0) || headers.channels == 0 {
            return Ok(None);
        }
        Ok(Some(Self { tiles, headers, path: path.to_owned(), _file: None }))
    }

    /// Writes levels of eight bits, the finest first, to a file for [`Self::open`].
    ///
    /// # Errors
    /// [`ImageError::Write`] and [`ImageError::Encode`].
    pub fn write<'a>(
        path: &Path,
        levels: impl Iterator<Item = (&'a [[u8; 4]], [u32; 2])>,
    ) -> Result<(), ImageError> {
        let refused = |cause: io::Error| ImageError::Write { path: path.to_owned(), cause };
        let name = CString::new(path.as_os_str().as_bytes()).map_err(|error| refused(error.into()))?;
        let levels: Vec<Level<'_, u8>> = levels.map(|(texels, size)| Level { texels, size }).collect();
        write_tiles(&name, &levels).map_err(|failure| unwritten(path, failure))
    }

    /// Moves levels of eight bits from memory to a temporary file without a name, which is deleted with the picture.
    ///
    /// # Errors
    /// [`ImageError::Write`] and [`ImageError::Encode`] if the file cannot be written to the folder of temporary files (`TMPDIR`).
    pub fn from_bytes<'a>(
        name: &Path,
        levels: impl Iterator<Item = (&'a [[u8; 4]], [u32; 2])>,
    ) -> Result<Self, ImageError> {
        Self::moved(name, levels)
    }

    /// Moves levels of sixteen bits as [`Self::from_bytes`] does.
    ///
    /// # Errors
    /// As for [`Self::from_bytes`].
    pub fn from_words<'a>(
        name: &Path,
        levels: impl Iterator<Item = (&'a [[u16; 4]], [u32; 2])>,
    ) -> Result<Self, ImageError> {
        Self::moved(name, levels)
    }

    fn moved<'a, T: Sample + 'a>(
        name: &Path,
        levels: impl Iterator<Item = (&'a [[T; 4]], [u32; 2])>,
    ) -> Result<Self, ImageError> {
        let folder = std::env::temp_dir();
        let refused = |cause: io::Error| ImageError::Write { path: folder.join("texture"), cause };
        let file = tempfile::tempfile_in(&folder).map_err(refused)?;
        // Through this path the library opens a file that has no name in any folder.
        let path = CString::new(format!("/proc/self/fd/{}", file.as_raw_fd()));
        let path = path.map_err(|error| refused(error.into()))?;
        let levels: Vec<Level<'_, T>> = levels.map(|(texels, size)| Level { texels, size }).collect();
        let failed = |failure| unwritten(&folder.join("texture"), failure);
        write_tiles(&path, &levels).map_err(failed)?;
        let tiles = Tiles::open(&path).map_err(failed)?;
        let headers = tiles.headers();
        if headers.levels != levels.iter().map(|level| level.size).collect::<Vec<_>>() {
            let reason = "what was written is not what is read".to_owned();
            return Err(ImageError::Encode { path: folder.join("texture"), reason });
        }
        Ok(Self { tiles, headers, path: name.to_owned(), _file: Some(file) })
    }

    /// Width and height of each level, the finest first. There is at least one level, and no size is 0.
    pub fn levels(&self) -> &[[u32; 2]] {
        &self.headers.levels
    }

    /// Channels in the file, at least one.
    pub fn channels(&self) -> u32 {
        self.headers.channels
    }

    /// Bits per value in the file.
    pub fn bits(&self) -> u32 {
        self.headers.bits
    }

    /// Whether the file states that its colours are linear.
    pub fn is_linear(&self) -> bool {
        self.headers.is_linear
    }

    /// Whether colours are premultiplied by alpha.
    pub fn is_associated(&self) -> bool {
        self.headers.is_associated
    }

    /// Reads a window of a level, rows from the top: the first four channels, with integers scaled to 0..1. Channels that the file lacks
    /// keep their values. A window that does not lie within the level or cannot be read keeps all its values; [`take_tile_failures`]
    /// reports such failures.
    #[inline]
    pub fn read(&self, level: usize, from: [u32; 2], size: [u32; 2], texels: &mut [[f32; 4]]) {
        if let Err(failure) = self.tiles.read(level, from, size, texels) {
            self.remember(failure);
        }
    }

    #[cold]
    fn remember(&self, failure: Failure) {
        let mut failures = FAILURES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // Messages of the library name tiles and levels; one message per file is enough.
        failures.entry(self.path.clone()).or_insert_with(|| damaged(&self.path, failure).to_string());
    }
}

fn unwritten(path: &Path, failure: Failure) -> ImageError {
    match failure {
        Failure::System(cause) => ImageError::Write { path: path.to_owned(), cause },
        Failure::Library(reason) => ImageError::Encode { path: path.to_owned(), reason },
        Failure::NotLoaded(reason) => ImageError::Library { reason: reason.to_owned() },
    }
}
