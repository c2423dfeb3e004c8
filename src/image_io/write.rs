//! Writing pictures.

use std::collections::BTreeSet;
use std::ffi::CString;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::atomic::{check, destination, write_atomically};
use super::oiio::{Failure, Sample, Spec};
use super::{Image, ImageError, Layer, MetadataValue, is_storage};

/// Longest name of a channel that EXR allows, in bytes.
const LONGEST_NAME: usize = 255;

/// Whether a file could be written to `path` as things stand: tries it beside that place, and leaves nothing behind.
///
/// # Errors
/// [`ImageError::Write`] where the folder is missing, full or not to be written to, or `path` is a folder or a device.
pub fn check_writable(path: impl AsRef<Path>) -> Result<(), ImageError> {
    let path = path.as_ref();
    check(path).map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// True where writing to both would write one file, through whatever links. False where either cannot be written to.
pub fn is_same_file(a: impl AsRef<Path>, b: impl AsRef<Path>) -> bool {
    matches!((destination(a.as_ref()), destination(b.as_ref())), (Ok(a), Ok(b)) if a == b)
}

/// Writes a text.
///
/// # Errors
/// [`ImageError::Write`] where the system refuses. The file that was there before, if any, is then still there.
pub fn write_text(path: impl AsRef<Path>, text: &str) -> Result<(), ImageError> {
    let path = path.as_ref();
    write_atomically(path, |mut file| file.write_all(text.as_bytes()))
        .map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// Writes whatever `fill` writes.
///
/// # Errors
/// [`ImageError::Write`] where the system or `fill` refuses. The file that was there before, if any, is then still there.
pub fn write_with(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&File) -> io::Result<()>,
) -> Result<(), ImageError> {
    let path = path.as_ref();
    write_atomically(path, fill).map_err(|cause| ImageError::Write { path: path.to_owned(), cause })
}

/// [`write_with`], through a buffer.
///
/// # Errors
/// [`ImageError::Write`] where the system or `fill` refuses. The file that was there before, if any, is then still there.
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
/// Channels are named as every viewer knows them: `R`, `G`, `B` of the layer without a name, `normal.X`, `depth.Z` of others.
/// Numbers are stored bit by bit, NaN and infinity included; ids are stored as numbers, exact below 2^24.
///
/// Metadata is best given names with a colon (`cardioid:seed`), as EXR gives meaning and a type to some plain ones. Nothing is
/// added to it: the same picture gives the same file, byte by byte.
///
/// # Errors
/// [`ImageError::Inconsistent`] where the layers do not fit the picture or names are unfit, [`ImageError::Write`] where the
/// system refuses. The file that was there before, if any, is then still there.
pub fn write_exr(path: impl AsRef<Path>, image: &Image) -> Result<(), ImageError> {
    let path = path.as_ref();
    let names = channel_names(image).map_err(|reason| inconsistent(path, reason))?;
    let metadata = metadata_of(image).map_err(|reason| inconsistent(path, reason))?;
    let layers: Vec<_> =
        image.layers.iter().map(|layer| (layer.data.as_slice(), layer.channels.len())).collect();
    write_atomically(path, |file| {
        let mut spec = Spec::<f32>::new(image.width, image.height, names.len())?;
        for (i, name) in names.iter().enumerate() {
            spec.set_channel_name(i, name)?;
        }
        spec.set_text(c"compression", c"zip")?;
        // Otherwise OpenImageIO adds the time of day, and the same picture never gives the same file. Of the wrong type, it
        // is not stored; a date among the metadata replaces it.
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
    .map_err(|failure| refused(path, failure))
}

/// Pixels of a PNG, row by row from the top, the channels of each side by side: as the file holds them, so already encoded
/// for display (sRGB), alpha not multiplied in.
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

/// Writes a PNG, marked as sRGB.
///
/// # Errors
/// [`ImageError::Inconsistent`] where the pixels do not fit the size, [`ImageError::Write`] where the system refuses. The
/// file that was there before, if any, is then still there.
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

/// Number of values of a picture that has any.
fn values(width: u32, height: u32, channels: usize) -> Result<usize, String> {
    if width == 0 || height == 0 || channels == 0 {
        return Err(format!("a picture of {width} x {height} pixels and {channels} channels holds nothing"));
    }
    (width as usize)
        .checked_mul(height as usize)
        .and_then(|pixels| pixels.checked_mul(channels))
        .ok_or_else(|| format!("{width} x {height} pixels of {channels} channels are too many"))
}

/// Names of all channels as the file has them, or what is wrong with the layers.
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

/// A [`MetadataValue`] ready for C.
enum Value {
    Text(CString),
    Int(i32),
    Double(f64),
}

/// The metadata ready for C, or what is wrong with it.
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
