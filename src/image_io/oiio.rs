//! Safe wrapper around the C++ shim of OpenImageIO. No other file of `image_io` calls C.
#![allow(unsafe_code, reason = "the border to C++: each call is justified where it stands")]

use std::ffi::{CStr, c_char};
use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::os::fd::AsRawFd;
use std::ptr::NonNull;

use oiio_sys as sys;

use super::{ImageError, MetadataValue, Window};

mod tiles;

pub(super) use tiles::{Headers, Level, Tiles, limit_tiles, write_tiles};

/// Version of OpenImageIO: major, minor, patch. Loads the library if it is not loaded yet; `None` where it cannot be loaded.
#[must_use]
pub fn library_version() -> Option<(i32, i32, i32)> {
    // SAFETY: takes nothing and only reads a constant.
    let version = unsafe { sys::shim().ok()?.oiio_version() };
    Some((version / 10_000, version / 100 % 100, version % 100))
}

/// Loads OpenImageIO, which takes some tenths of a second. A separate thread can call it during other work, so that the first picture need
/// not wait. [`library_failure`] reports the result.
pub fn load_library() {
    // The binding keeps an error and reports it with the first picture.
    let _ = sys::shim();
}

/// The error of loading OpenImageIO; `None` where it is loaded, or was not requested yet.
pub fn library_failure() -> Option<ImageError> {
    sys::load_failure().map(not_loaded)
}

fn not_loaded(reason: &str) -> ImageError {
    ImageError::Library { reason: reason.to_owned() }
}

/// An error of OpenImageIO.
#[derive(Debug)]
pub(super) enum Failure {
    /// The system reported an error.
    System(io::Error),
    /// The library reported an error with this message.
    Library(String),
    /// The library cannot be loaded.
    NotLoaded(&'static str),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::System(error)
    }
}

impl Failure {
    /// An empty error for the shim to fill.
    const fn empty() -> sys::OiioError {
        sys::OiioError { system: 0, text: [0; 1024] }
    }

    fn from_shim(error: &sys::OiioError) -> Self {
        if error.system != 0 {
            return Self::System(io::Error::from_raw_os_error(error.system));
        }
        // SAFETY: the shim ends the text within the array, which is zero where it wrote nothing.
        let text = unsafe { CStr::from_ptr(error.text.as_ptr()) }.to_string_lossy();
        Self::Library(if text.trim().is_empty() {
            "no reason given".to_owned()
        } else {
            text.trim().to_owned()
        })
    }

    /// The functions of the library.
    fn shim() -> Result<&'static sys::Shim, Self> {
        sys::shim().map_err(Self::NotLoaded)
    }

    fn out_of_memory() -> Self {
        Self::System(io::ErrorKind::OutOfMemory.into())
    }
}

/// Type of a channel's values in memory and in the file.
pub(super) trait Sample {
    const FORMAT: sys::OiioFormat;
}

impl Sample for u8 {
    const FORMAT: sys::OiioFormat = sys::OIIO_FORMAT_UINT8;
}

impl Sample for u16 {
    const FORMAT: sys::OiioFormat = sys::OIIO_FORMAT_UINT16;
}

impl Sample for f32 {
    const FORMAT: sys::OiioFormat = sys::OIIO_FORMAT_FLOAT;
}

/// Description of a picture to write.
#[derive(Debug)]
pub(super) struct Spec<T> {
    shim: &'static sys::Shim,
    spec: NonNull<sys::OiioSpec>,
    pixels: usize,
    channels: usize,
    sample: PhantomData<T>,
}

impl<T: Sample> Spec<T> {
    pub(super) fn new(width: u32, height: u32, channels: usize) -> Result<Self, Failure> {
        let too_large =
            |_| Failure::Library("more than 2^31 pixels in a row or column, or channels".to_owned());
        let columns = i32::try_from(width).map_err(too_large)?;
        let rows = i32::try_from(height).map_err(too_large)?;
        let channel_count = i32::try_from(channels).map_err(too_large)?;
        let shim = Failure::shim()?;
        // SAFETY: takes plain numbers.
        let spec = unsafe { shim.oiio_spec_new(columns, rows, channel_count, T::FORMAT) };
        let spec = NonNull::new(spec).ok_or_else(Failure::out_of_memory)?;
        Ok(Self { shim, spec, pixels: width as usize * height as usize, channels, sample: PhantomData })
    }

    /// Declares the picture a window of a larger one.
    pub(super) fn set_window(&mut self, window: Window) -> Result<(), Failure> {
        let number =
            |n: i64| i32::try_from(n).map_err(|_| Failure::Library("a window beyond 2^31 pixels".to_owned()));
        let Window { x, y, full_width, full_height } = window;
        let [x, y] = [number(x)?, number(y)?];
        let [full_width, full_height] = [number(full_width.into())?, number(full_height.into())?];
        // SAFETY: the description is live, and the rest are plain numbers.
        unsafe { self.shim.oiio_spec_set_window(self.spec.as_ptr(), x, y, full_width, full_height) };
        Ok(())
    }

    pub(super) fn set_channel_name(&mut self, channel: usize, name: &CStr) -> Result<(), Failure> {
        let channel = i32::try_from(channel).unwrap_or(i32::MAX);
        // SAFETY: the description is live and the shim checks the channel.
        done(unsafe { self.shim.oiio_spec_set_channel_name(self.spec.as_ptr(), channel, name.as_ptr()) })
    }

    pub(super) fn set_text(&mut self, name: &CStr, value: &CStr) -> Result<(), Failure> {
        // SAFETY: the description is live; both strings are copied.
        done(unsafe { self.shim.oiio_spec_set_text(self.spec.as_ptr(), name.as_ptr(), value.as_ptr()) })
    }

    pub(super) fn set_int(&mut self, name: &CStr, value: i32) -> Result<(), Failure> {
        // SAFETY: the description is live; the string is copied.
        done(unsafe { self.shim.oiio_spec_set_int(self.spec.as_ptr(), name.as_ptr(), value) })
    }

    pub(super) fn set_double(&mut self, name: &CStr, value: f64) -> Result<(), Failure> {
        // SAFETY: the description is live; the string is copied.
        done(unsafe { self.shim.oiio_spec_set_double(self.spec.as_ptr(), name.as_ptr(), value) })
    }

    /// Writes the picture to an empty file in the format with this OpenImageIO name. The channels of the layers, in order, are those of the
    /// description. A layer consists of pixels with interleaved channels, and the number of channels.
    pub(super) fn write(&self, file: &File, format: &CStr, layers: &[(&[T], usize)]) -> Result<(), Failure> {
        let fits =
            layers.iter().all(|&(data, channels)| Some(data.len()) == self.pixels.checked_mul(channels));
        let channels = layers.iter().map(|&(_, channels)| channels).sum::<usize>();
        if !fits || channels != self.channels {
            return Err(Failure::Library("layers do not fit the size of the picture".to_owned()));
        }
        let layers: Vec<_> = layers
            .iter()
            // The cast cannot overflow: the sum of channels was an i32 in `new`.
            .map(|&(data, channels)| sys::OiioLayer {
                pixels: data.as_ptr().cast(),
                channels: channels as i32,
            })
            .collect();
        let count =
            i32::try_from(layers.len()).map_err(|_| Failure::Library("too many layers".to_owned()))?;
        let mut error = Failure::empty();
        // SAFETY: the file is open, the description live, and each layer has, by the check above, one number of the type
        // described for each of its channels of each pixel, and all channels of the description belong to one.
        let written = unsafe {
            self.shim.oiio_write(
                file.as_raw_fd(),
                format.as_ptr(),
                self.spec.as_ptr(),
                layers.as_ptr(),
                count,
                T::FORMAT,
                &raw mut error,
            )
        };
        if written { Ok(()) } else { Err(Failure::from_shim(&error)) }
    }
}

impl<T> Drop for Spec<T> {
    fn drop(&mut self) {
        // SAFETY: live until here, and nobody else has it.
        unsafe { self.shim.oiio_spec_free(self.spec.as_ptr()) }
    }
}

fn done(succeeded: bool) -> Result<(), Failure> {
    if succeeded { Ok(()) } else { Err(Failure::out_of_memory()) }
}

/// A file open for reading, at one of its parts.
#[derive(Debug)]
pub(super) struct Input {
    shim: &'static sys::Shim,
    input: NonNull<sys::OiioInput>,
}

impl Input {
    /// Opens a file in the format with this OpenImageIO name, at its first part. Only the header is read.
    pub(super) fn open(path: &CStr, format: &CStr) -> Result<Self, Failure> {
        let shim = Failure::shim()?;
        let mut error = Failure::empty();
        // SAFETY: both strings end in NUL, and the error is there to be written.
        let input = unsafe { shim.oiio_input_open(path.as_ptr(), format.as_ptr(), &raw mut error) };
        let input = NonNull::new(input).ok_or_else(|| Failure::from_shim(&error))?;
        Ok(Self { shim, input })
    }

    /// Moves to a part; false where the file has no such part.
    pub(super) fn seek(&mut self, part: i32) -> bool {
        // SAFETY: the input is live, and no borrow of its strings is, as `self` is borrowed mutably.
        unsafe { self.shim.oiio_input_seek(self.input.as_ptr(), part) }
    }

    /// Width, height, depth and number of channels. Negative claims of a file are returned as 0.
    pub(super) fn size(&self) -> [u32; 4] {
        let input = self.input.as_ptr();
        // SAFETY: the input is live, and these only read it.
        let size = unsafe {
            [
                self.shim.oiio_input_width(input),
                self.shim.oiio_input_height(input),
                self.shim.oiio_input_depth(input),
                self.shim.oiio_input_channels(input),
            ]
        };
        size.map(|number| u32::try_from(number).unwrap_or(0))
    }

    /// The larger picture that this one is a window of; `None` where it is whole.
    pub(super) fn window(&self) -> Option<Window> {
        let input = self.input.as_ptr();
        // SAFETY: the input is live, and these only read it.
        let (x, y, width, height) = unsafe {
            (
                self.shim.oiio_input_x(input),
                self.shim.oiio_input_y(input),
                self.shim.oiio_input_full_width(input),
                self.shim.oiio_input_full_height(input),
            )
        };
        let positive = |number: i32| u32::try_from(number).unwrap_or(0);
        let window = Window { x, y, full_width: positive(width), full_height: positive(height) };
        let [width, height, ..] = self.size();
        (window != Window { x: 0, y: 0, full_width: width, full_height: height }).then_some(window)
    }

    pub(super) fn is_deep(&self) -> bool {
        // SAFETY: the input is live, and this only reads it.
        unsafe { self.shim.oiio_input_is_deep(self.input.as_ptr()) }
    }

    /// Bytes needed to decode one tile or row.
    pub(super) fn block_bytes(&self) -> u64 {
        // SAFETY: the input is live, and this only reads it.
        unsafe { self.shim.oiio_input_block_bytes(self.input.as_ptr()) }
    }

    /// Names of the channels of this part.
    pub(super) fn channel_names(&self) -> Vec<String> {
        // SAFETY: the input is live, and a name lives as long as the input stays at this part.
        let name = |channel| unsafe { text(self.shim.oiio_input_channel_name(self.input.as_ptr(), channel)) };
        // SAFETY: as in `size`.
        let count = unsafe { self.shim.oiio_input_channels(self.input.as_ptr()) };
        (0..count).map(|channel| name(channel).unwrap_or_default()).collect()
    }

    /// Attributes of this part.
    pub(super) fn attributes(&mut self) -> Vec<(String, MetadataValue)> {
        let input = self.input.as_ptr();
        // SAFETY: the input is live, `self` is borrowed mutably, and each text is copied before the next call.
        let attribute = |i| unsafe {
            let value = match self.shim.oiio_input_attribute_kind(input, i) {
                sys::OIIO_ATTRIBUTE_INT => MetadataValue::Int(self.shim.oiio_input_attribute_int(input, i)),
                sys::OIIO_ATTRIBUTE_DOUBLE => {
                    MetadataValue::Double(self.shim.oiio_input_attribute_double(input, i))
                }
                _ => MetadataValue::Text(text(self.shim.oiio_input_attribute_text(input, i))?),
            };
            Some((text(self.shim.oiio_input_attribute_name(input, i))?, value))
        };
        // SAFETY: the input is live, and this only reads it.
        let count = unsafe { self.shim.oiio_input_attributes(input) };
        (0..count).filter_map(attribute).collect()
    }

    /// All pixels of this part, from the top, with interleaved channels.
    pub(super) fn read(&mut self) -> Result<Vec<f32>, Failure> {
        let [width, height, _, channels] = self.size().map(|number| number as usize);
        let length = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
        let length = length.ok_or_else(Failure::out_of_memory)?;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(length).map_err(|_| Failure::out_of_memory())?;
        pixels.resize(length, 0.0);
        let mut error = Failure::empty();
        // SAFETY: the input is live, and the shim writes no more than the given length.
        let read = unsafe {
            self.shim.oiio_input_read(self.input.as_ptr(), pixels.as_mut_ptr(), length, &raw mut error)
        };
        if read { Ok(pixels) } else { Err(Failure::from_shim(&error)) }
    }
}

impl Drop for Input {
    fn drop(&mut self) {
        // SAFETY: live until here, and nobody else has it.
        unsafe { self.shim.oiio_input_free(self.input.as_ptr()) }
    }
}

/// A copy of a C string; `None` for null.
///
/// # Safety
/// The string is null or ends in NUL, and lives until this returns.
unsafe fn text(text: *const c_char) -> Option<String> {
    // SAFETY: as above.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}
