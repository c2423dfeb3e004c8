//! Writing pictures.

use std::collections::BTreeSet;
use std::ffi::{CStr, CString};
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant};

use super::atomic::{check, destination, try_beside, write_atomically};
use super::oiio::{Failure, Sample, Spec, load_library};
use super::{Image, ImageError, Layer, MetadataValue, Window, exr_header, is_storage};
use crate::files::open_regular;

/// Longest name of a channel that EXR allows, in bytes.
const LONGEST_NAME: usize = 255;

/// Checks whether a file can be written to `path` at present. It tries a temporary file in the same folder and leaves nothing behind.
///
/// # Errors
/// [`ImageError::Write`] if the folder is missing, full or not writable, or if `path` is a folder or a device.
pub fn check_writable(path: impl AsRef<Path>) -> Result<(), ImageError> {
    let path = path.as_ref();
    let checked = if is_standard_output(path) { Err(no_standard_output()) } else { check(path) };
    checked.map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// Whether a path means standard output: `-`, as is usual for programs that write text.
pub fn is_standard_output(path: impl AsRef<Path>) -> bool {
    path.as_ref().as_os_str() == "-"
}

/// Whether both names lead to one file through symbolic or hard links, or whether writing to both would write one file.
pub fn is_same_file(a: impl AsRef<Path>, b: impl AsRef<Path>) -> bool {
    let (a, b) = (a.as_ref(), b.as_ref());
    let is_one_name = matches!((destination(a), destination(b)), (Ok(a), Ok(b)) if a == b);
    // Device and inode also identify files on disks that ignore case.
    let identity = |path| fs::metadata(path).map(|found| (found.dev(), found.ino()));
    is_one_name || matches!((identity(a), identity(b)), (Ok(a), Ok(b)) if a == b)
}

/// Bytes at the start of a file that are searched for the mark: more than any header that this program writes.
const MARKED: u64 = 1 << 22;

/// Whether a file has the mark of this program: metadata `cardioid/version` of an EXR, the text `Software` of a PNG, or the first bytes of
/// photon maps, of checkpoints and of parts. False where the file cannot be read.
pub fn is_written_by_cardioid(path: impl AsRef<Path>) -> bool {
    const STARTS: [&[u8]; 5] = [
        &exr_header::MAGIC,
        b"\x89PNG\r\n\x1a\n",
        b"\x89CPM\r\n\x1a\n",
        b"cardioid rounds\n",
        b"cardioid part  \n",
    ];
    const MARKS: [&[u8]; 5] =
        [b"cardioid/version\0", b"Software\0cardioid ", b"CPM", b"cardioid rounds", b"cardioid part"];
    let mut head = Vec::new();
    let read = open_regular(path).and_then(|(file, _)| file.take(MARKED).read_to_end(&mut head));
    let holds = |mark: &[u8]| head.windows(mark.len()).any(|bytes| bytes == mark);
    read.is_ok() && STARTS.iter().zip(MARKS).any(|(start, mark)| head.starts_with(start) && holds(mark))
}

/// The error of writing anything but text to standard output.
fn no_standard_output() -> io::Error {
    io::Error::other(
        "`-` stands for standard output, which takes texts alone; name a file (`./-` for one of that name)",
    )
}

/// Writes a text, to standard output where `path` is `-`.
///
/// # Errors
/// [`ImageError::Write`] if the system reports an error. An existing file is then unchanged.
pub fn write_text(path: impl AsRef<Path>, text: &str) -> Result<(), ImageError> {
    let path = path.as_ref();
    let written = if is_standard_output(path) {
        let mut out = io::stdout().lock();
        out.write_all(text.as_bytes()).and_then(|()| out.flush())
    } else {
        write_atomically(path, |mut file| file.write_all(text.as_bytes()))
    };
    written.map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// Writes a file whose content comes from `fill`.
///
/// # Errors
/// [`ImageError::Write`] if the system or `fill` reports an error. An existing file is then unchanged.
pub fn write_with(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&File) -> io::Result<()>,
) -> Result<(), ImageError> {
    let path = path.as_ref();
    write_atomically(path, fill).map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// Writes as [`write_with`] does, through a buffer.
///
/// # Errors
/// [`ImageError::Write`] if the system or `fill` reports an error. An existing file is then unchanged.
pub fn write_bytes(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), ImageError> {
    let path = path.as_ref();
    write_atomically(path, |file| {
        let mut buffer = BufWriter::with_capacity(1 << 18, file);
        fill(&mut buffer)?;
        buffer.flush()
    })
    .map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// Writes an EXR: 32-bit float, losslessly compressed (ZIP), all layers in one part.
///
/// Channels have the usual names: `R`, `G`, `B` for the layer without a name, and names like `normal.X` and `depth.Z` for others. Values
/// are stored bit by bit, including NaN and infinity; ids are stored as numbers, exact below 2^24.
///
/// Metadata names should contain a colon (`cardioid:seed`), as EXR gives some plain names a meaning and a type. No metadata is added: the
/// same picture gives the same file, byte by byte.
///
/// # Errors
/// [`ImageError::Inconsistent`] if the layers do not fit the picture or names are invalid, [`ImageError::Write`] if the system reports an
/// error. An existing file is then unchanged.
pub fn write_exr(path: impl AsRef<Path>, image: &Image) -> Result<(), ImageError> {
    let path = path.as_ref();
    let encode = exr_encoder(path, image)?;
    write_atomically(path, encode).map_err(|failure| refused(path, failure))
}

/// Measures the time to write an EXR on the disk of `path`, and leaves no file behind.
///
/// # Errors
/// As for [`write_exr`].
pub fn time_to_write_exr(path: impl AsRef<Path>, image: &Image) -> Result<Duration, ImageError> {
    let path = path.as_ref();
    let encode = exr_encoder(path, image)?;
    // The library is loaded before the measurement, as this happens only once.
    load_library();
    let start = Instant::now();
    try_beside(path, encode).map_err(|failure| refused(path, failure))?;
    Ok(start.elapsed())
}

/// A function that writes an EXR to a file.
fn exr_encoder<'a>(
    path: &Path,
    image: &'a Image,
) -> Result<impl FnOnce(&File) -> Result<(), Failure> + 'a, ImageError> {
    if let Some(reason) = image.window.and_then(|window| misplaced(image, window)) {
        return Err(inconsistent(path, reason));
    }
    let names = channel_names(image).map_err(|reason| inconsistent(path, reason))?;
    let metadata = metadata_of(image).map_err(|reason| inconsistent(path, reason))?;
    Ok(move |file: &File| {
        let layers: Vec<_> =
            image.layers.iter().map(|layer| (layer.data.as_slice(), layer.channels.len())).collect();
        let mut spec = Spec::<f32>::new(image.width, image.height, names.len())?;
        for (i, name) in names.iter().enumerate() {
            spec.set_channel_name(i, name)?;
        }
        if let Some(window) = image.window {
            spec.set_window(window)?;
        }
        spec.set_text(c"compression", c"zip")?;
        // Otherwise OpenImageIO adds the time of day, and the same picture never gives the same file. A `DateTime` of the wrong type is
        // not stored; a date in the metadata replaces it.
        spec.set_int(c"DateTime", 0)?;
        for (name, value) in &metadata {
            match value {
                Value::Text(text) => spec.set_text(name, text)?,
                Value::Int(number) => spec.set_int(name, *number)?,
                Value::Double(number) => spec.set_double(name, *number)?,
            }
        }
        spec.write(file, c"openexr", &layers)
    })
}

/// Pixels of a PNG, row by row from the top, with interleaved channels. Values are those of the file: encoded for display (sRGB) and not
/// multiplied by alpha.
#[derive(Clone, Copy, Debug)]
pub enum PngPixels<'a> {
    /// Grey, 8 bits.
    Grey8(&'a [u8]),
    /// Red, green, blue, 8 bits each.
    Rgb8(&'a [u8]),
    /// Red, green, blue, alpha, 8 bits each.
    Rgba8(&'a [u8]),
    /// Grey, 16 bits.
    Grey16(&'a [u16]),
    /// Red, green, blue, 16 bits each.
    Rgb16(&'a [u16]),
    /// Red, green, blue, alpha, 16 bits each.
    Rgba16(&'a [u16]),
}

/// Value of `Software` in a PNG, which marks it as written by this program ([`is_written_by_cardioid`]).
const SOFTWARE: &CStr =
    match CStr::from_bytes_with_nul(concat!("cardioid ", env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(text) => text,
        Err(_) => c"cardioid ",
    };

/// Writes a PNG, marked as sRGB, and as written by this program.
///
/// # Errors
/// [`ImageError::Inconsistent`] if the pixels do not fit the size, [`ImageError::Write`] if the system reports an error. An existing file
/// is then unchanged.
pub fn write_png(
    path: impl AsRef<Path>,
    width: u32,
    height: u32,
    pixels: PngPixels<'_>,
) -> Result<(), ImageError> {
    let path = path.as_ref();
    match pixels {
        PngPixels::Grey8(data) => write_png_samples(path, width, height, data, 1),
        PngPixels::Rgb8(data) => write_png_samples(path, width, height, data, 3),
        PngPixels::Rgba8(data) => write_png_samples(path, width, height, data, 4),
        PngPixels::Grey16(data) => write_png_samples(path, width, height, data, 1),
        PngPixels::Rgb16(data) => write_png_samples(path, width, height, data, 3),
        PngPixels::Rgba16(data) => write_png_samples(path, width, height, data, 4),
    }
}

fn write_png_samples<T: Sample>(
    path: &Path,
    width: u32,
    height: u32,
    data: &[T],
    channels: usize,
) -> Result<(), ImageError> {
    let expected = values(width, height, channels).map_err(|reason| inconsistent(path, reason))?;
    if data.len() != expected {
        let reason = format!(
            "{width} x {height} pixels of {channels} channels take {expected} values, not {}",
            data.len()
        );
        return Err(inconsistent(path, reason));
    }
    let names = if channels == 1 { &[c"Y"][..] } else { &[c"R", c"G", c"B", c"A"][..channels] };
    write_atomically(path, |file| {
        let mut spec = Spec::<T>::new(width, height, channels)?;
        for (i, name) in names.iter().enumerate() {
            spec.set_channel_name(i, name)?;
        }
        spec.set_text(c"oiio:ColorSpace", c"sRGB")?;
        spec.set_text(c"Software", SOFTWARE)?;
        spec.set_int(c"oiio:UnassociatedAlpha", 1)?;
        spec.write(file, c"png", &[(data, channels)])
    })
    .map_err(|failure| refused(path, failure))
}

fn inconsistent(path: &Path, reason: String) -> ImageError {
    ImageError::Inconsistent { path: path.to_owned(), reason }
}

fn refused(path: &Path, failure: Failure) -> ImageError {
    match failure {
        Failure::System(cause) => ImageError::Write { path: path.to_owned(), cause },
        Failure::Library(reason) => ImageError::Encode { path: path.to_owned(), reason },
        Failure::NotLoaded(reason) => ImageError::Library { reason: reason.to_owned() },
    }
}

/// Error message for a window that does not lie within the larger picture; `None` where it does.
fn misplaced(image: &Image, window: Window) -> Option<String> {
    let fits = |first: i64, length: u32, all: u32| first >= 0 && first + i64::from(length) <= i64::from(all);
    let Window { x, y, full_width, full_height } = window;
    let is_inside = fits(x, image.width, full_width) && fits(y, image.height, full_height);
    (!is_inside).then(|| {
        format!(
            "a window of {} x {} pixels at {x}, {y} is not within {full_width} x {full_height}",
            image.width, image.height
        )
    })
}

/// Number of values of a picture; an error where it has none or too many.
fn values(width: u32, height: u32, channels: usize) -> Result<usize, String> {
    if width == 0 || height == 0 || channels == 0 {
        return Err(format!("a picture of {width} x {height} pixels and {channels} channels holds nothing"));
    }
    (width as usize)
        .checked_mul(height as usize)
        .and_then(|pixels| pixels.checked_mul(channels))
        .ok_or_else(|| format!("{width} x {height} pixels of {channels} channels are too many"))
}

/// Names of all channels in the file, or an error message about the layers.
fn channel_names(image: &Image) -> Result<Vec<CString>, String> {
    let mut names = Vec::new();
    let mut seen = BTreeSet::new();
    for layer in &image.layers {
        let expected = values(image.width, image.height, layer.channels.len())?;
        if layer.data.len() != expected {
            let (layer, found) = (&layer.name, layer.data.len());
            return Err(format!(
                "layer {layer:?} has {found} values where the picture's size takes {expected}"
            ));
        }
        for channel in &layer.channels {
            let name = channel_name(layer, channel)?;
            if !seen.insert(name.clone()) {
                return Err(format!("two channels are named {name:?}"));
            }
            names.push(c_string(name)?);
        }
    }
    values(image.width, image.height, names.len())?;
    Ok(names)
}

fn channel_name(layer: &Layer, channel: &str) -> Result<String, String> {
    if channel.is_empty() || channel.contains('.') {
        return Err(format!("channel {channel:?} of layer {:?} needs a name without a dot", layer.name));
    }
    let name = if layer.name.is_empty() { channel.to_owned() } else { format!("{}.{channel}", layer.name) };
    if name.len() > LONGEST_NAME {
        return Err(format!("channel {name:?} has a name longer than {LONGEST_NAME} bytes"));
    }
    Ok(name)
}

/// A [`MetadataValue`] in a form for C.
enum Value {
    Text(CString),
    Int(i32),
    Double(f64),
}

/// The metadata in a form for C, or an error message about it.
fn metadata_of(image: &Image) -> Result<Vec<(CString, Value)>, String> {
    let mut seen = BTreeSet::new();
    let mut metadata = Vec::with_capacity(image.metadata.len());
    for (name, value) in &image.metadata {
        if name.is_empty() || is_storage(name) {
            return Err(format!("metadata cannot be named {name:?}"));
        }
        if !seen.insert(name) {
            return Err(format!("metadata {name:?} is given twice"));
        }
        let value = match value {
            MetadataValue::Text(text) => Value::Text(c_string(text.clone())?),
            MetadataValue::Int(number) => Value::Int(*number),
            MetadataValue::Double(number) => Value::Double(*number),
        };
        metadata.push((c_string(name.clone())?, value));
    }
    Ok(metadata)
}

fn c_string(text: String) -> Result<CString, String> {
    CString::new(text)
        .map_err(|error| format!("{:?} contains a NUL", String::from_utf8_lossy(&error.into_vec())))
}

#[cfg(test)]
mod tests {
    use std::fs::OpenOptions;
    use std::io::ErrorKind;

    use super::*;

    #[test]
    fn full_disk_is_told_by_the_system_for_each_format() {
        let full = OpenOptions::new().read(true).write(true).open("/dev/full").expect("this is Linux");
        let noise: Vec<_> = (0_u32..256 * 256).map(|i| i.wrapping_mul(2_654_435_761) as f32).collect();
        let exr = Spec::<f32>::new(256, 256, 1).expect("spec");
        let png = Spec::<u8>::new(64, 64, 1).expect("spec");
        for result in
            [exr.write(&full, c"openexr", &[(&noise, 1)]), png.write(&full, c"png", &[(&[7; 64 * 64], 1)])]
        {
            let Err(Failure::System(error)) = result else { panic!("{result:?}") };
            assert_eq!(error.kind(), ErrorKind::StorageFull);
        }
    }

    #[test]
    fn layers_that_do_not_fit_the_description_are_refused() {
        let file = tempfile::tempfile().expect("file");
        let spec = Spec::<f32>::new(2, 2, 2).expect("spec");
        for layers in [&[(&[0.0; 8][..], 1)][..], &[(&[0.0; 7], 2)], &[(&[0.0; 4], 1)], &[]] {
            assert!(matches!(spec.write(&file, c"openexr", layers), Err(Failure::Library(_))));
        }
    }
}
