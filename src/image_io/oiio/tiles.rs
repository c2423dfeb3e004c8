//! Pictures that are read by tiles through OpenImageIO's cache.

use super::{Failure, Sample, sys};
use std::ffi::CStr;
use std::ptr::NonNull;

/// A picture in the cache.
#[derive(Debug)]
pub(in crate::image_io) struct Tiles {
    shim: &'static sys::Shim,
    tiles: NonNull<sys::OiioTiles>,
}

// SAFETY: the shim allows all but freeing from any thread, and freeing needs `&mut self`, as `drop` has.
unsafe impl Send for Tiles {}
// SAFETY: as above: what takes `&self` only reads what does not change, or calls the cache, which has locks of its own.
unsafe impl Sync for Tiles {}

/// Texels of one level, four channels each, and its width and height.
pub(in crate::image_io) struct Level<'a, T> {
    pub(in crate::image_io) texels: &'a [[T; 4]],
    pub(in crate::image_io) size: [u32; 2],
}

/// Writes a picture with tiles and levels, the finest level first. An existing file is overwritten.
pub(in crate::image_io) fn write_tiles<T: Sample>(
    path: &CStr,
    levels: &[Level<'_, T>],
) -> Result<(), Failure> {
    let too_large = || Failure::Library("levels do not fit their sizes".to_owned());
    let level = |level: &Level<'_, T>| {
        let [width, height] = level.size.map(i32::try_from);
        let (width, height) = (width.ok()?, height.ok()?);
        let fits = level.texels.len() as u64 == u64::from(level.size[0]) * u64::from(level.size[1]);
        fits.then_some(sys::OiioLevel { texels: level.texels.as_ptr().cast(), width, height })
    };
    let levels: Vec<_> = levels.iter().map(level).collect::<Option<_>>().ok_or_else(too_large)?;
    let count = i32::try_from(levels.len()).map_err(|_| too_large())?;
    let mut error = Failure::empty();
    // SAFETY: the path ends in NUL, and each level has, by the check above, four values of the given type for each texel.
    let written = unsafe {
        Failure::shim()?.oiio_tiles_write(path.as_ptr(), levels.as_ptr(), count, T::FORMAT, &raw mut error)
    };
    if written { Ok(()) } else { Err(Failure::from_shim(&error)) }
}

/// Sets the memory limit of the tile cache, in units of 2^20 bytes.
pub(in crate::image_io) fn limit_tiles(megabytes: f32) -> Result<(), Failure> {
    // SAFETY: takes a plain number.
    unsafe { Failure::shim()?.oiio_tiles_limit(megabytes) };
    Ok(())
}

/// Headers of a picture.
#[derive(Clone, Debug)]
pub(in crate::image_io) struct Headers {
    /// Width and height of each level, the finest first.
    pub(in crate::image_io) levels: Vec<[u32; 2]>,
    pub(in crate::image_io) is_tiled: bool,
    pub(in crate::image_io) channels: u32,
    pub(in crate::image_io) bits: u32,
    pub(in crate::image_io) is_linear: bool,
    pub(in crate::image_io) is_associated: bool,
}

impl Tiles {
    /// Opens a file and reads only its headers.
    pub(in crate::image_io) fn open(path: &CStr) -> Result<Self, Failure> {
        let shim = Failure::shim()?;
        let mut error = Failure::empty();
        // SAFETY: the path ends in NUL, and the error is there to be written.
        let tiles = unsafe { shim.oiio_tiles_open(path.as_ptr(), &raw mut error) };
        let tiles = NonNull::new(tiles).ok_or_else(|| Failure::from_shim(&error))?;
        Ok(Self { shim, tiles })
    }

    pub(in crate::image_io) fn headers(&self) -> Headers {
        let (shim, tiles) = (self.shim, self.tiles.as_ptr());
        let natural = |number: i32| u32::try_from(number).unwrap_or(0);
        // SAFETY: the picture is live, and these only read what was found when it was opened.
        unsafe {
            let level = |i| [shim.oiio_tiles_width(tiles, i), shim.oiio_tiles_height(tiles, i)].map(natural);
            Headers {
                levels: (0..shim.oiio_tiles_levels(tiles)).map(level).collect(),
                is_tiled: shim.oiio_tiles_is_tiled(tiles),
                channels: natural(shim.oiio_tiles_channels(tiles)),
                bits: natural(shim.oiio_tiles_bits(tiles)),
                is_linear: shim.oiio_tiles_is_linear(tiles),
                is_associated: shim.oiio_tiles_is_associated(tiles),
            }
        }
    }

    /// Reads a window of a level, with its first pixel and its size. Channels that the file lacks keep their values.
    #[inline]
    pub(in crate::image_io) fn read(
        &self,
        level: usize,
        [x, y]: [u32; 2],
        [width, height]: [u32; 2],
        texels: &mut [[f32; 4]],
    ) -> Result<(), Failure> {
        let mut error = Failure::empty();
        let [x, y, width, height] = [x, y, width, height].map(|number| i32::try_from(number).unwrap_or(-1));
        let level = i32::try_from(level).unwrap_or(-1);
        let texels = texels.as_flattened_mut();
        // SAFETY: the picture is live, and the shim writes no more than the given length.
        let read = unsafe {
            self.shim.oiio_tiles_read(
                self.tiles.as_ptr(),
                level,
                x,
                y,
                width,
                height,
                texels.as_mut_ptr(),
                texels.len(),
                &raw mut error,
            )
        };
        if read { Ok(()) } else { Err(Failure::from_shim(&error)) }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        // SAFETY: live until here, and nobody else has it.
        unsafe { self.shim.oiio_tiles_free(self.tiles.as_ptr()) }
    }
}
