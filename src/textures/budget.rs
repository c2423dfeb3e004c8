//! How much of the pictures of a scene lies in memory.

use super::ImageTexture;
use crate::image_io::{self, Image, ImageError, set_tile_memory};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// What [`TextureBudget::new`] starts with unless told otherwise: 1 GB.
pub const DEFAULT_TEXTURE_MEMORY: u64 = 1_000_000_000;

/// Part of that which the cache of tiles has for all that does not fit.
const TILE_SHARE: u64 = 4;

/// Less than this in the cache would read the same tiles again and again.
const LEAST_TILE_MEMORY: u64 = 1 << 24;

static TEXTURE_MEMORY: AtomicU64 = AtomicU64::new(DEFAULT_TEXTURE_MEMORY);

/// Sets how many bytes the pictures of one mesh file or scene may take from now on, for the whole process. Those that do not fit
/// are read by tiles, of which a quarter of that is kept, at least 16 MiB. No value changes by it, to the bit.
pub fn set_texture_memory(bytes: u64) {
    TEXTURE_MEMORY.store(bytes, Ordering::Relaxed);
}

static PICTURE_MEMORY: AtomicU64 = AtomicU64::new(u64::MAX);

/// Bytes that decoding takes for each value of a picture: twice what it holds.
const DECODING: u64 = 8;

/// Sets how many bytes decoding one picture may take from now on, for the whole process. A picture tells its size in its first
/// bytes, so that one that takes more is refused before it is decoded.
pub fn set_picture_memory(bytes: u64) {
    PICTURE_MEMORY.store(bytes, Ordering::Relaxed);
}

/// Reads a picture of at most `most` values by `read`, or fewer where less memory is allowed for it.
///
/// # Errors
/// Those of `read`, which gets the number of values that are allowed; [`ImageError::Memory`] where memory is what limits it.
fn within_memory(
    most: u64,
    read: impl FnOnce(u64) -> Result<Image, ImageError>,
) -> Result<Image, ImageError> {
    let allowed = PICTURE_MEMORY.load(Ordering::Relaxed);
    let limit = allowed / DECODING;
    read(most.min(limit)).map_err(|error| match error {
        ImageError::TooLarge { path, values, limit: exceeded } if limit < most && exceeded == limit => {
            ImageError::Memory { path, needed: values.saturating_mul(DECODING), allowed }
        }
        other => other,
    })
}

/// As [`image_io::read_with_limit`], for pictures of a scene: within the memory that is allowed.
///
/// # Errors
/// As there, and [`ImageError::Memory`].
pub fn read_picture(path: &Path, most: u64) -> Result<Image, ImageError> {
    within_memory(most, |limit| image_io::read_with_limit(path, limit))
}

/// As [`image_io::read_bytes`], for pictures of a scene: within the memory that is allowed.
///
/// # Errors
/// As there, and [`ImageError::Memory`].
pub fn read_picture_bytes(bytes: &[u8], name: &Path, most: u64) -> Result<Image, ImageError> {
    within_memory(most, |limit| image_io::read_bytes(bytes, name, limit))
}

/// What is left for the pictures of one file.
#[derive(Debug)]
pub struct TextureBudget {
    left: u64,
    tiles: u64,
}

impl Default for TextureBudget {
    fn default() -> Self {
        Self::new(TEXTURE_MEMORY.load(Ordering::Relaxed))
    }
}

impl TextureBudget {
    /// So many bytes.
    pub fn new(bytes: u64) -> Self {
        Self { left: bytes, tiles: (bytes / TILE_SHARE).max(LEAST_TILE_MEMORY) }
    }

    /// The texture as it is where there is room for it, and otherwise by tiles, see [`ImageTexture::out_of_memory`]; messages call
    /// it `name`.
    ///
    /// # Errors
    /// As [`ImageTexture::out_of_memory`].
    pub fn take(&mut self, texture: ImageTexture, name: &Path) -> Result<ImageTexture, ImageError> {
        let bytes = texture.bytes() as u64;
        if bytes > 0 && bytes <= self.left {
            self.left -= bytes;
            return Ok(texture);
        }
        set_tile_memory(self.tiles)?;
        texture.out_of_memory(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_io::{Image, Layer};
    use crate::textures::Encoding;

    #[test]
    fn what_does_not_fit_is_read_by_tiles() {
        let texture = || {
            let layer = Layer::new("", &["Y"], vec![0.5; 32 * 32]);
            ImageTexture::new(&Image { layers: vec![layer], ..Image::new(32, 32) }, Encoding::Linear)
        };
        let size = texture().bytes() as u64;
        let mut budget = TextureBudget::new(2 * size + 1);
        let kept = [(); 3].map(|()| budget.take(texture(), Path::new("a")).unwrap().bytes() as u64);
        assert_eq!(kept, [size, size, 0]);
    }
}
