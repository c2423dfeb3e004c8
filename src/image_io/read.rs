//! Reading pictures.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString};
use std::io::{self, BufReader, Read, Seek, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::files::open_regular;

use super::exr_header::{self, BLOCK_LIMIT, Fault};
use super::oiio::{Failure, Input};
use super::radiance::RadianceHeader;
use super::{Image, ImageError, Layer, MetadataValue, is_storage};

/// Most values (width times height times channels) that [`read`] accepts: 4 GiB of memory.
pub const DEFAULT_LIMIT: u64 = 1 << 30;

/// Reads a picture as [`read_with_limit`] does, with [`DEFAULT_LIMIT`].
///
/// # Errors
/// As for [`read_with_limit`].
pub fn read(path: impl AsRef<Path>) -> Result<Image, ImageError> {
    read_with_limit(path, DEFAULT_LIMIT)
}

/// Reads a picture of at most `limit` values (width times height times channels).
///
/// The first bytes of the file determine its format, not its name (except for TGA). Integers of 8 and 16 bits are scaled to 0..1 and
/// otherwise unchanged: still encoded for display where the file is a PNG or JPEG, and not multiplied by alpha.
///
/// Channels `layer.R`, `layer.G`, `layer.B` form a layer; channels without a dot form the layer without a name. Layers of a part of a
/// multi-part EXR are named after the part. Layers are sorted by name; channels are sorted as R, G, B, A or Y, A, and others by name.
/// Metadata is that of the first part, without storage attributes.
///
/// Reading takes memory for the values twice, at 4 bytes each, and for a few blocks of at most 128 MiB per thread. None of it is allocated
/// for a file that claims to be larger than `limit`.
///
/// # Errors
/// [`ImageError::Read`], [`ImageError::NotAPicture`], [`ImageError::Damaged`], [`ImageError::Unsupported`] (deep, a volume,
/// parts of different sizes) or [`ImageError::TooLarge`].
pub fn read_with_limit(path: impl AsRef<Path>, limit: u64) -> Result<Image, ImageError> {
    let path = path.as_ref();
    let format = recognise(path, limit)?;
    let c_path = CString::new(path.as_os_str().as_bytes()).map_err(|error| unreadable(path, error.into()))?;
    // The Radiance header is read first, as OpenImageIO does not detect everything that this refuses.
    let radiance = if format == FORMAT_HDR { Some(radiance_header(path)?) } else { None };
    let mut input = Input::open(&c_path, format).map_err(|failure| damaged(path, failure))?;
    let [width, height, ..] = input.size();
    let mut image = Image { window: input.window(), ..Image::new(width, height) };
    let mut layers = Layers::default();
    let mut values = 0;
    // Other formats have pages or frames, of which only the first is read.
    let parts = if format == FORMAT_EXR { i32::MAX } else { 1 };
    for part in 0..parts {
        if part > 0 && !input.seek(part) {
            break;
        }
        values += check_part(path, &input, &image, limit - values)?;
        let attributes = input.attributes();
        let mut pixels = input.read().map_err(|failure| damaged(path, failure))?;
        if let Some(header) = &radiance {
            let channels = input.channel_names().len();
            header.restore(&mut pixels, channels);
            (pixels, [image.width, image.height]) = header.order.upright(pixels, [width, height], channels);
        }
        layers
            .add(part_name(&attributes), &input.channel_names(), &pixels)
            .map_err(|reason| ImageError::Damaged { path: path.to_owned(), reason })?;
        if part == 0 {
            image.metadata = attributes.into_iter().filter(|(name, _)| !is_storage(name)).collect();
        }
    }
    image.layers = layers.finish();
    image.findings = radiance.map(|header| header.findings).unwrap_or_default();
    Ok(image)
}

/// Reads a picture from memory as [`read_with_limit`] does; errors call it `name`. The bytes go through a temporary file.
///
/// # Errors
/// As for [`read_with_limit`].
pub fn read_bytes(bytes: &[u8], name: &Path, limit: u64) -> Result<Image, ImageError> {
    let mut file = tempfile::NamedTempFile::new().map_err(|cause| unreadable(name, cause))?;
    file.write_all(bytes).map_err(|cause| unreadable(name, cause))?;
    read_with_limit(file.path(), limit).map_err(|error| error.renamed(file.path(), name))
}

const FORMAT_EXR: &CStr = c"openexr";

/// Reads the header of a Radiance picture.
fn radiance_header(path: &Path) -> Result<RadianceHeader, ImageError> {
    let header = open_regular(path).and_then(|(file, _)| RadianceHeader::read(file));
    let header = header.map_err(|cause| unreadable(path, cause))?;
    if header.is_xyz {
        let what = "a Radiance picture in CIE XYZ (`ra_xyze -r` makes one in RGB of it)";
        return Err(ImageError::Unsupported { path: path.to_owned(), what });
    }
    Ok(header)
}

const FORMAT_HDR: &CStr = c"hdr";

/// First bytes of each format, and OpenImageIO's name of it.
const KINDS: [(&[u8], &CStr); 9] = [
    (&exr_header::MAGIC, FORMAT_EXR),
    (b"\x89PNG\r\n\x1a\n", c"png"),
    (b"\xff\xd8\xff", c"jpeg"),
    (b"#?", FORMAT_HDR),
    (b"II*\0", c"tiff"),
    (b"MM\0*", c"tiff"),
    (b"II+\0", c"tiff"),
    (b"BM", c"bmp"),
    (b"RIFF", c"webp"),
];

/// The format of a picture file, after a check that it does not claim more values than `limit`.
pub(super) fn recognise(path: &Path, limit: u64) -> Result<&'static CStr, ImageError> {
    let (mut file, _) = open_regular(path).map_err(|cause| unreadable(path, cause))?;
    let mut start = Vec::new();
    Read::by_ref(&mut file).take(8).read_to_end(&mut start).map_err(|cause| unreadable(path, cause))?;
    let kind = KINDS.iter().find(|(magic, _)| start.starts_with(magic)).map(|&(_, format)| format);
    let format = match kind {
        Some(format) => format,
        // TGA is the only format that can be recognised by the name alone.
        None if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("tga")) => c"targa",
        None => return Err(ImageError::NotAPicture { path: path.to_owned() }),
    };
    if format == FORMAT_EXR {
        file.rewind().map_err(|cause| unreadable(path, cause))?;
        exr_header::check(BufReader::new(file), limit).map_err(|fault| match fault {
            Fault::System(cause) => unreadable(path, cause),
            Fault::Damaged(reason) => {
                ImageError::Damaged { path: path.to_owned(), reason: reason.to_owned() }
            }
            Fault::Deep => ImageError::Unsupported { path: path.to_owned(), what: "a deep picture" },
            Fault::TooLarge { values, limit } => {
                ImageError::TooLarge { path: path.to_owned(), values, limit }
            }
        })?;
    }
    Ok(format)
}

/// Number of values of the current part of the input, after a check that it can be read.
fn check_part(path: &Path, input: &Input, image: &Image, limit: u64) -> Result<u64, ImageError> {
    let unsupported = |what| ImageError::Unsupported { path: path.to_owned(), what };
    let [width, height, depth, channels] = input.size();
    if input.is_deep() {
        return Err(unsupported("a deep picture"));
    }
    if depth > 1 {
        return Err(unsupported("a volume"));
    }
    if (width, height, input.window()) != (image.width, image.height, image.window) {
        return Err(unsupported("a picture of parts of different sizes"));
    }
    let values = u64::from(width) * u64::from(height);
    if values == 0 || channels == 0 {
        return Err(ImageError::Damaged { path: path.to_owned(), reason: "it has no pixels".to_owned() });
    }
    let values = values.saturating_mul(channels.into());
    let block = input.block_bytes() / size_of::<f32>() as u64;
    for (values, limit) in [(values, limit), (block, BLOCK_LIMIT)] {
        if values > limit {
            return Err(ImageError::TooLarge { path: path.to_owned(), values, limit });
        }
    }
    Ok(values)
}

/// Name of a part of a multi-part file; empty elsewhere.
fn part_name(attributes: &[(String, MetadataValue)]) -> &str {
    attributes
        .iter()
        .find_map(|(name, value)| match value {
            MetadataValue::Text(text) if name == "oiio:subimagename" => Some(text.as_str()),
            _ => None,
        })
        .unwrap_or_default()
}

fn unreadable(path: &Path, cause: io::Error) -> ImageError {
    ImageError::Read { path: path.to_owned(), cause }
}

pub(super) fn damaged(path: &Path, failure: Failure) -> ImageError {
    match failure {
        Failure::System(cause) => unreadable(path, cause),
        Failure::Library(reason) => ImageError::Damaged { path: path.to_owned(), reason },
        Failure::NotLoaded(reason) => ImageError::Library { reason: reason.to_owned() },
    }
}

/// Layers under construction from the channels of a file.
#[derive(Default)]
struct Layers(BTreeMap<String, Layer>);

impl Layers {
    /// Adds the channels of a part, whose pixels have interleaved channels.
    fn add(&mut self, part: &str, names: &[String], pixels: &[f32]) -> Result<(), String> {
        let mut channels_of: BTreeMap<String, Vec<(&str, usize)>> = BTreeMap::new();
        for (index, name) in names.iter().enumerate() {
            let (layer, channel) = name.rsplit_once('.').unwrap_or(("", name));
            channels_of.entry(qualified(part, layer)).or_default().push((channel, index));
        }
        for (name, mut channels) in channels_of {
            channels.sort_by(|(a, _), (b, _)| conventional_order(a, b));
            // Grey precedes its alpha.
            if let [("A", _), ("Y", _)] = channels[..] {
                channels.swap(0, 1);
            }
            let data = pixels
                .chunks_exact(names.len())
                .flat_map(|pixel| channels.iter().map(|&(_, index)| pixel[index]))
                .collect();
            let channels: Vec<_> = channels.into_iter().map(|(channel, _)| channel).collect();
            let layer = Layer::new(name.clone(), &channels, data);
            if self.0.insert(name, layer).is_some() {
                return Err("two parts have the same layer".to_owned());
            }
        }
        Ok(())
    }

    fn finish(self) -> Vec<Layer> {
        self.0.into_values().collect()
    }
}

/// Name of a layer of a part, with the part's name as a prefix unless it already has it.
fn qualified(part: &str, layer: &str) -> String {
    let has_it = layer.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    match (part, layer) {
        ("", _) => layer.to_owned(),
        _ if has_it => layer.to_owned(),
        (_, "") => part.to_owned(),
        _ => format!("{part}.{layer}"),
    }
}

/// Order of channels: R, G, B, A, then others by name, such as X, Y, Z.
fn conventional_order(a: &str, b: &str) -> Ordering {
    let rank = |channel: &str| ["R", "G", "B", "A"].iter().position(|&name| name == channel).unwrap_or(4);
    rank(a).cmp(&rank(b)).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_named_after_parts_only_once() {
        assert_eq!(qualified("", ""), "");
        assert_eq!(qualified("", "depth"), "depth");
        assert_eq!(qualified("beauty", ""), "beauty");
        assert_eq!(qualified("beauty", "beauty"), "beauty");
        assert_eq!(qualified("left", "left.depth"), "left.depth");
        assert_eq!(qualified("left", "leftover"), "left.leftover");
    }

    #[test]
    fn channels_are_in_the_usual_order() {
        let names = ["A", "B", "Z.B", "G", "Z.A", "R", "Z.R"].map(str::to_owned);
        let mut layers = Layers::default();
        layers.add("", &names, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).expect("no name twice");
        let expected = [
            Layer::new("", &["R", "G", "B", "A"], vec![5.0, 3.0, 1.0, 0.0]),
            Layer::new("Z", &["R", "B", "A"], vec![6.0, 2.0, 4.0]),
        ];
        assert_eq!(layers.finish(), expected);
    }

    #[test]
    fn grey_comes_before_its_alpha() {
        for names in [["Y", "A"], ["A", "Y"]] {
            let mut layers = Layers::default();
            let values = names.map(|name| if name == "Y" { 0.25 } else { 1.0 });
            layers.add("", &names.map(str::to_owned), &values).expect("no name twice");
            assert_eq!(layers.finish(), [Layer::new("", &["Y", "A"], vec![0.25, 1.0])]);
        }
        // Vector channels keep their order.
        let mut layers = Layers::default();
        layers.add("", &["X", "Y", "Z"].map(str::to_owned), &[1.0, 2.0, 3.0]).expect("no name twice");
        assert_eq!(layers.finish(), [Layer::new("", &["X", "Y", "Z"], vec![1.0, 2.0, 3.0])]);
    }

    #[test]
    fn same_layer_in_two_parts_is_an_error() {
        let mut layers = Layers::default();
        layers.add("a", &["R".to_owned()], &[0.0]).expect("new");
        layers.add("", &["a.R".to_owned()], &[0.0]).expect_err("not new");
    }
}
