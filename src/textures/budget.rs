//! Memory budget of the pictures of a scene.

use super::ImageTexture;
use crate::image_io::{self, Image, ImageError, set_tile_memory};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Default memory budget of textures, in bytes: 1 GB.
pub const DEFAULT_TEXTURE_MEMORY: u64 = 1_000_000_000;

/// The tile cache, for textures that do not fit, gets the budget divided by this number.
const TILE_SHARE: u64 = 4;

/// Least memory of the tile cache, in bytes. With less it would read the same tiles repeatedly.
const LEAST_TILE_MEMORY: u64 = 1 << 24;

static TEXTURE_MEMORY: AtomicU64 = AtomicU64::new(DEFAULT_TEXTURE_MEMORY);

/// Sets the memory budget in bytes of the pictures of one mesh file or scene, for the whole process. Pictures that do not fit are read
/// by tiles through a cache of a quarter of the budget, at least 16 MiB. The budget does not change any texture value, to the bit.
pub fn set_texture_memory(bytes: u64) {
    TEXTURE_MEMORY.store(bytes, Ordering::Relaxed);
}

static PICTURE_MEMORY: AtomicU64 = AtomicU64::new(u64::MAX);

/// Bytes that decoding takes for each value of a picture: twice the size of the value.
const DECODING: u64 = 8;

/// Sets the memory limit in bytes for decoding one picture, for the whole process. The first bytes of a picture state its size, so a
/// picture that needs more is refused before it is decoded.
pub fn set_picture_memory(bytes: u64) {
    PICTURE_MEMORY.store(bytes, Ordering::Relaxed);
}

/// Reads a picture of at most `most` values with `read`, or of fewer where the memory limit is lower. `read` gets the allowed number of
/// values.
///
/// # Errors
/// The errors of `read`, or [`ImageError::Memory`] where the picture exceeds the memory limit.
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

/// Reads a picture of a scene as [`image_io::read_with_limit`] does, within the memory limit.
///
/// # Errors
/// The errors of that function, and [`ImageError::Memory`].
pub fn read_picture(path: &Path, most: u64) -> Result<Image, ImageError> {
    within_memory(most, |limit| image_io::read_with_limit(path, limit))
}

/// Reads a picture of a scene as [`image_io::read_bytes`] does, within the memory limit.
///
/// # Errors
/// The errors of that function, and [`ImageError::Memory`].
pub fn read_picture_bytes(bytes: &[u8], name: &Path, most: u64) -> Result<Image, ImageError> {
    within_memory(most, |limit| image_io::read_bytes(bytes, name, limit))
}

/// Remaining memory for the pictures of one file.
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
    /// A budget of this many bytes.
    pub fn new(bytes: u64) -> Self {
        Self { left: bytes, tiles: (bytes / TILE_SHARE).max(LEAST_TILE_MEMORY) }
    }

    /// Returns the texture unchanged where it fits into the budget. Otherwise moves it to a file that is read by tiles, see
    /// [`ImageTexture::out_of_memory`]; messages call it `name`.
    ///
    /// # Errors
    /// If the tile cache cannot be set up, or as for [`ImageTexture::out_of_memory`].
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
