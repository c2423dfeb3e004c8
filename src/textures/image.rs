//! Textures from pictures: a pyramid of levels, each half as large as the one before, filtered on lookup.

use super::budget::{read_picture, read_picture_bytes};
use super::tiles::TiledTexels;
use crate::image_io::{Image, ImageError, TiledImage};
use glam::{Vec2, Vec4};
use std::path::Path;
use std::sync::OnceLock;

/// Most values (width times height times channels) of a picture that is read as a texture, unless its file has tiles and levels. The
/// limit is 2^28, four channels of 8192 x 8192 texels. Decoding takes eight bytes per value.
pub const TEXTURE_LIMIT: u64 = 1 << 28;

/// Wrapping of coordinates outside `[0, 1]` along one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The picture repeats.
    #[default]
    Repeat,
    /// The picture repeats; every other copy is mirrored.
    Mirror,
    /// The texels of the edge continue.
    Clamp,
}

/// Wrapping and filtering of a lookup.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sampler {
    /// Wrapping along u and v.
    pub wrap: [Wrap; 2],
    /// Use the nearest texel instead of bilinear interpolation of four.
    pub nearest: bool,
    /// Use the finest level only, whatever the footprint.
    pub finest: bool,
}

/// Encoding of the values of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Red, green and blue are encoded by the curve of sRGB (IEC 61966-2-1); alpha is linear.
    Srgb,
    /// All channels are linear.
    Linear,
}

#[derive(Clone, Debug, PartialEq)]
enum Texels {
    /// Eight bits for each channel, in the encoding of the texture.
    Bytes(Vec<[u8; 4]>),
    /// Sixteen bits for each channel, always linear: for pictures with more than eight.
    Words(Vec<[u16; 4]>),
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: u32,
    height: u32,
    texels: Texels,
}

/// Storage of the levels of a texture.
#[derive(Clone, Debug, PartialEq)]
enum Source {
    /// In memory, with the finest level first.
    Memory(Vec<Level>),
    /// In a file; a cache holds the tiles of the latest lookups.
    Tiles(TiledTexels),
}

/// A texture of four channels between 0 and 1. A single channel in the file is grey, and a second one is alpha. Alpha is 1 where the file
/// has none.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageTexture {
    source: Source,
    encoding: Encoding,
    least: Vec4,
    mean: Vec4,
}

/// Linear values of sRGB bytes.
pub(super) fn srgb_table() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|byte| decode_srgb(byte as f32 / 255.0)))
}

/// The linear value of an sRGB value (IEC 61966-2-1), both in `[0, 1]`.
pub fn srgb_to_linear(x: f32) -> f32 {
    decode_srgb(x)
}

pub(super) fn decode_srgb(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

fn encode_srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

impl Texels {
    fn as_bytes(&self) -> Option<&[[u8; 4]]> {
        if let Self::Bytes(texels) = self { Some(texels) } else { None }
    }

    fn as_words(&self) -> Option<&[[u16; 4]]> {
        if let Self::Words(texels) = self { Some(texels) } else { None }
    }
}

impl Level {
    #[inline]
    fn texel(&self, encoding: Encoding, x: u32, y: u32) -> Vec4 {
        let index = y as usize * self.width as usize + x as usize;
        match (&self.texels, encoding) {
            (Texels::Bytes(texels), Encoding::Linear) => {
                Vec4::from_array(texels[index].map(f32::from)) * (1.0 / 255.0)
            }
            (Texels::Bytes(texels), Encoding::Srgb) => {
                let [r, g, b, a] = texels[index];
                let [r, g, b] = [r, g, b].map(|byte| srgb_table()[usize::from(byte)]);
                Vec4::new(r, g, b, f32::from(a) * (1.0 / 255.0))
            }
            (Texels::Words(texels), _) => Vec4::from_array(texels[index].map(f32::from)) * (1.0 / 65535.0),
        }
    }

    fn bytes(&self) -> usize {
        match &self.texels {
            Texels::Bytes(texels) => size_of_val(texels.as_slice()),
            Texels::Words(texels) => size_of_val(texels.as_slice()),
        }
    }

    /// The next coarser level: means of four texels, or of two where there is only one row or column. An odd last row or column is
    /// dropped, unless it is the only one.
    fn halved(&self, encoding: Encoding) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mean = |x: u32, y: u32| {
            let (x0, y0) = ((2 * x).min(self.width - 1), (2 * y).min(self.height - 1));
            let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
            let at = |x, y| self.texel(encoding, x, y);
            (at(x0, y0) + at(x1, y0) + at(x0, y1) + at(x1, y1)) * 0.25
        };
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let texels = match (&self.texels, encoding) {
            (Texels::Bytes(_), Encoding::Srgb) => {
                let encode = |v: Vec4| {
                    let [r, g, b] = [v.x, v.y, v.z].map(encode_srgb);
                    [r, g, b, v.w].map(|x| (x * 255.0).round() as u8)
                };
                Texels::Bytes(places.map(|(x, y)| encode(mean(x, y))).collect())
            }
            (Texels::Bytes(_), Encoding::Linear) => {
                let round = |v: Vec4| v.to_array().map(|x| (x * 255.0).round() as u8);
                Texels::Bytes(places.map(|(x, y)| round(mean(x, y))).collect())
            }
            (Texels::Words(_), _) => {
                let round = |v: Vec4| v.to_array().map(|x| (x * 65535.0).round() as u16);
                Texels::Words(places.map(|(x, y)| round(mean(x, y))).collect())
            }
        };
        Self { width, height, texels }
    }
}

/// The index of a texel along an axis of `size` texels.
#[inline]
fn wrapped(i: i64, size: u32, wrap: Wrap) -> u32 {
    let size = i64::from(size);
    let index = match wrap {
        Wrap::Repeat => i.rem_euclid(size),
        Wrap::Mirror => {
            let twice = i.rem_euclid(2 * size);
            twice.min(2 * size - 1 - twice)
        }
        Wrap::Clamp => i.clamp(0, size - 1),
    };
    index as u32
}

impl ImageTexture {
    /// Reads a picture file. A file with tiles and levels (from `maketx`) stays on disk and is read on demand. Where the file states its
    /// encoding, that one is used.
    ///
    /// # Errors
    /// As for [`super::read_picture`].
    pub fn read(path: &Path, encoding: Encoding) -> Result<Self, ImageError> {
        if let Some(image) = TiledImage::open(path)? {
            let tiles = TiledTexels::new(image, encoding);
            let (least, mean) = tiles.least_and_mean();
            return Ok(Self { source: Source::Tiles(tiles), encoding, least, mean });
        }
        Ok(Self::new(&read_picture(path, TEXTURE_LIMIT)?, encoding))
    }

    /// Reads a picture from memory; messages call it `name`.
    ///
    /// # Errors
    /// As for [`super::read_picture`].
    pub fn from_bytes(bytes: &[u8], name: &Path, encoding: Encoding) -> Result<Self, ImageError> {
        Ok(Self::new(&read_picture_bytes(bytes, name, TEXTURE_LIMIT)?, encoding))
    }

    /// A texture from the first layer of a picture. Values outside `[0, 1]` are clamped; NaN becomes 0.
    pub fn new(image: &Image, encoding: Encoding) -> Self {
        let (data, channels) =
            image.layers.first().map_or((&[][..], 1), |layer| (&layer.data[..], layer.channels.len().max(1)));
        let pixel = |pixel: &[f32]| {
            let at = |i: usize| pixel.get(i).copied().unwrap_or(1.0).clamp(0.0, 1.0);
            let [grey, second] = [at(0), at(1)];
            match channels {
                1 => Vec4::new(grey, grey, grey, 1.0),
                2 => Vec4::new(grey, grey, grey, second),
                3 => Vec4::new(grey, second, at(2), 1.0),
                _ => Vec4::new(grey, second, at(2), at(3)),
            }
        };
        let pixels =
            || data.chunks_exact(channels).map(pixel).map(|v| v.map(|x| if x.is_nan() { 0.0 } else { x }));
        // Pictures of eight bits stay so; finer ones get sixteen.
        let is_bytes = pixels().all(|v| ((v * 255.0).round() / 255.0 - v).abs().max_element() < 1e-6);
        let texels = if is_bytes {
            Texels::Bytes(pixels().map(|v| v.to_array().map(|x| (x * 255.0).round() as u8)).collect())
        } else {
            let linear = |v: Vec4| match encoding {
                Encoding::Srgb => Vec4::new(decode_srgb(v.x), decode_srgb(v.y), decode_srgb(v.z), v.w),
                Encoding::Linear => v,
            };
            Texels::Words(
                pixels().map(|v| linear(v).to_array().map(|x| (x * 65535.0).round() as u16)).collect(),
            )
        };
        let mut finest = Level { width: image.width, height: image.height, texels };
        if finest.width == 0 || finest.height == 0 || data.is_empty() {
            finest = Level { width: 1, height: 1, texels: Texels::Bytes(vec![[0, 0, 0, 255]]) };
        }
        let all = || {
            let rows = 0..finest.height;
            rows.flat_map(|y| (0..finest.width).map(move |x| (x, y)))
                .map(|(x, y)| finest.texel(encoding, x, y))
        };
        let least = all().fold(Vec4::ONE, Vec4::min);
        let sum = all().fold(glam::DVec4::ZERO, |sum, v| sum + v.as_dvec4());
        let mean = (sum / (f64::from(finest.width) * f64::from(finest.height))).as_vec4();
        let mut levels = vec![finest];
        while let Some(last) = levels.last().filter(|last| last.width > 1 || last.height > 1) {
            let next = last.halved(encoding);
            levels.push(next);
        }
        Self { source: Source::Memory(levels), encoding, least, mean }
    }

    /// The same texture with its texels in a temporary file, which is deleted with it. A cache holds only the tiles of the latest lookups.
    /// All values stay the same, to the bit. `name` is for messages.
    ///
    /// # Errors
    /// As for [`TiledImage::from_bytes`].
    pub fn out_of_memory(self, name: &Path) -> Result<Self, ImageError> {
        let Source::Memory(levels) = &self.source else { return Ok(self) };
        let sizes = levels.iter().map(|level| [level.width, level.height]);
        let bytes = || levels.iter().map_while(|level| level.texels.as_bytes());
        let words = || levels.iter().map_while(|level| level.texels.as_words());
        // All levels have the same number of bits.
        let (image, stored) = if bytes().count() == levels.len() {
            (TiledImage::from_bytes(name, bytes().zip(sizes))?, self.encoding)
        } else {
            (TiledImage::from_words(name, words().zip(sizes))?, Encoding::Linear)
        };
        let tiles = TiledTexels::new(image, stored);
        Ok(Self { source: Source::Tiles(tiles), ..self })
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        self.size_of(0)
    }

    #[inline]
    fn size_of(&self, level: usize) -> [u32; 2] {
        match &self.source {
            Source::Memory(levels) => [levels[level].width, levels[level].height],
            Source::Tiles(tiles) => tiles.levels()[level],
        }
    }

    #[inline]
    fn level_count(&self) -> usize {
        match &self.source {
            Source::Memory(levels) => levels.len(),
            Source::Tiles(tiles) => tiles.levels().len(),
        }
    }

    /// Bytes of memory of the texels, without those in the tile cache.
    pub fn bytes(&self) -> usize {
        match &self.source {
            Source::Memory(levels) => levels.iter().map(Level::bytes).sum(),
            Source::Tiles(_) => 0,
        }
    }

    /// Smallest value of each channel.
    pub fn least(&self) -> Vec4 {
        self.least
    }

    /// Mean value of each channel.
    pub fn mean(&self) -> Vec4 {
        self.mean
    }

    /// The value at `uv`, whose origin is the upper left corner of the picture. `width` is the side length of the footprint in texels of
    /// the finest level. Up to 1 that level is used; above, the two nearest levels are interpolated.
    #[inline]
    pub fn at(&self, uv: Vec2, width: f32, sampler: &Sampler) -> Vec4 {
        let uv = if uv.is_finite() { uv } else { Vec2::ZERO };
        let last = self.level_count() - 1;
        if sampler.finest || !(width > 1.0) || last == 0 {
            return self.on_level(0, uv, sampler);
        }
        let level = width.log2().min(last as f32);
        let below = (level as usize).min(last - 1);
        let (fine, coarse) = (self.on_level(below, uv, sampler), self.on_level(below + 1, uv, sampler));
        fine.lerp(coarse, level - below as f32)
    }

    #[inline]
    fn on_level(&self, level: usize, uv: Vec2, sampler: &Sampler) -> Vec4 {
        let size = self.size_of(level);
        let place = |axis: usize| {
            let x = f64::from(uv[axis]);
            // Coordinates are reduced first, so that large ones do not overflow; their precision is limited by the caller's.
            let x = match sampler.wrap[axis] {
                Wrap::Repeat => x - x.floor(),
                Wrap::Mirror => x - 2.0 * (0.5 * x).floor(),
                Wrap::Clamp => x.clamp(-1.0, 2.0),
            };
            x * f64::from(size[axis])
        };
        let wrapped = |i: i64, axis: usize| wrapped(i, size[axis], sampler.wrap[axis]);
        let (x, y) = (place(0), place(1));
        if sampler.nearest {
            let (x, y) = (wrapped(x.floor() as i64, 0), wrapped(y.floor() as i64, 1));
            return match &self.source {
                Source::Memory(levels) => levels[level].texel(self.encoding, x, y),
                Source::Tiles(tiles) => tiles.texel(level, [x, y]),
            };
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (s, t) = ((x - x0) as f32, (y - y0) as f32);
        let columns = [0, 1].map(|step| wrapped(x0 as i64 + step, 0));
        let rows = [0, 1].map(|step| wrapped(y0 as i64 + step, 1));
        let [a, b, c, d] = match &self.source {
            Source::Memory(levels) => {
                let at = |x: usize, y: usize| levels[level].texel(self.encoding, columns[x], rows[y]);
                [at(0, 0), at(1, 0), at(0, 1), at(1, 1)]
            }
            Source::Tiles(tiles) => tiles.four(level, columns, rows),
        };
        a.lerp(b, s).lerp(c.lerp(d, s), t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_io::{self, Layer};

    fn image(width: u32, height: u32, channels: &[&str], data: Vec<f32>) -> Image {
        Image { layers: vec![Layer::new("", channels, data)], ..Image::new(width, height) }
    }

    const RGB: [&str; 3] = ["R", "G", "B"];

    #[test]
    fn grey_and_alpha_become_four_channels() {
        let texture =
            |channels: &[&str], data| ImageTexture::new(&image(1, 1, channels, data), Encoding::Linear);
        let at = |texture: ImageTexture| texture.at(Vec2::splat(0.5), 0.0, &Sampler::default());
        let near = |a: Vec4, b: Vec4| (a - b).abs().max_element() < 2e-5;
        assert!(near(at(texture(&["Y"], vec![0.2])), Vec4::new(0.2, 0.2, 0.2, 1.0)));
        assert!(near(at(texture(&["Y", "A"], vec![0.2, 0.6])), Vec4::new(0.2, 0.2, 0.2, 0.6)));
        assert!(near(at(texture(&RGB, vec![0.2, 0.4, 0.6])), Vec4::new(0.2, 0.4, 0.6, 1.0)));
        assert!(near(at(texture(&RGB, vec![f32::NAN, -1.0, 7.0])), Vec4::new(0.0, 0.0, 1.0, 1.0)));
    }

    #[test]
    fn colours_are_decoded_before_they_are_mixed() {
        // Between black and white there is half of the light, whatever the encoding.
        let data = vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        for encoding in [Encoding::Srgb, Encoding::Linear] {
            let texture = ImageTexture::new(&image(2, 1, &RGB, data.clone()), encoding);
            let sampler = Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() };
            assert!((texture.at(Vec2::splat(0.5), 0.0, &sampler).x - 0.5).abs() < 1e-6);
            assert!((texture.at(Vec2::splat(0.1), 99.0, &sampler).x - 0.5).abs() < 5e-3);
            assert!((texture.mean().x - 0.5).abs() < 1e-6 && texture.least().x == 0.0);
        }
        let middle = ImageTexture::new(&image(1, 1, &RGB, vec![188.0 / 255.0; 3]), Encoding::Srgb);
        assert!((middle.mean().x - 0.5029).abs() < 1e-4, "{}", middle.mean());
    }

    #[test]
    fn coordinates_wrap_as_asked() {
        let data = (0..4).map(|x| x as f32 / 3.0).collect();
        let texture = ImageTexture::new(&image(4, 1, &["Y"], data), Encoding::Linear);
        let look = |x: f32, wrap| {
            let sampler = Sampler { wrap: [wrap; 2], nearest: true, finest: true };
            (texture.at(Vec2::new(x, 0.3), 1e9, &sampler).x * 3.0).round() as i32
        };
        let xs = [-1.1, -0.9, -0.1, 0.1, 0.9, 1.1, 1.9, 2.1];
        assert_eq!(xs.map(|x| look(x, Wrap::Repeat)), [3, 0, 3, 0, 3, 0, 3, 0]);
        assert_eq!(xs.map(|x| look(x, Wrap::Mirror)), [3, 3, 0, 0, 3, 3, 0, 0]);
        assert_eq!(xs.map(|x| look(x, Wrap::Clamp)), [0, 0, 0, 0, 3, 3, 3, 3]);
        for x in [f32::NAN, f32::INFINITY, 1e30, -1e30] {
            for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
                assert!((0..4).contains(&look(x, wrap)));
            }
        }
    }

    #[test]
    fn levels_keep_the_mean_and_mix_evenly() {
        let data: Vec<f32> =
            (0..64u32 * 64).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0).collect();
        let texture = ImageTexture::new(&image(64, 64, &["Y"], data), Encoding::Linear);
        assert_eq!((texture.level_count(), texture.size()), (7, [64, 64]));
        assert!(texture.bytes() < 64 * 64 * 4 * 4 / 3 + 16);
        let coarse = texture.at(Vec2::new(0.3, 0.7), 64.0, &Sampler::default()).x;
        assert!((coarse - texture.mean().x).abs() < 0.02, "{coarse} {}", texture.mean());
        // Halfway between two levels each has half of the weight.
        let at = |width: f32| texture.at(Vec2::new(0.31, 0.62), width, &Sampler::default()).x;
        assert!((at(2f32.powf(2.5)) - 0.5 * (at(4.0) + at(8.0))).abs() < 1e-5);
        assert_eq!(at(1.0), at(0.0));
    }

    #[test]
    fn sixteen_bits_stay() {
        let texture = ImageTexture::new(&image(1, 1, &["Y"], vec![0.123_45]), Encoding::Linear);
        assert!((texture.mean().x - 0.123_45).abs() < 1e-5);
    }

    #[test]
    fn out_of_memory_nothing_changes() {
        let noise = |seed: u32| move |i: u32| i.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 8;
        let bytes = |i: u32| (noise(1)(i) & 255) as f32 / 255.0;
        let words = |i: u32| (noise(2)(i) & 65535) as f32 / 65535.0;
        let kinds: [&dyn Fn(u32) -> f32; 2] = [&bytes, &words];
        let sizes = [(301, 130), (64, 65), (1, 1), (1, 300), (7, 1), (2, 2)];
        for (kind, (width, height)) in kinds.iter().cycle().zip(sizes) {
            for (channels, encoding) in
                [(&["R", "G", "B", "A"][..], Encoding::Srgb), (&["Y"], Encoding::Linear)]
            {
                let count = width * height * channels.len() as u32;
                let data = (0..count).map(kind).collect();
                let here = ImageTexture::new(&image(width, height, channels, data), encoding);
                let there = here.clone().out_of_memory(Path::new("a")).unwrap();
                assert_eq!((there.bytes(), there.size()), (0, here.size()));
                assert_eq!((there.mean(), there.least()), (here.mean(), here.least()));
                for i in 0..2000 {
                    let [a, b, c] = [3, 4, 5].map(|seed| noise(seed)(i) as f32 / 16_777_216.0);
                    let wrap = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
                    let sampler = Sampler {
                        wrap: [wrap[i as usize % 3], wrap[i as usize / 3 % 3]],
                        nearest: i % 5 == 0,
                        finest: i % 7 == 0,
                    };
                    let (uv, texels) = (Vec2::new(3.0 * a - 1.0, 3.0 * b - 1.0), 400.0 * c * c * c);
                    assert_eq!(
                        there.at(uv, texels, &sampler),
                        here.at(uv, texels, &sampler),
                        "{uv} {texels}"
                    );
                }
            }
        }
    }

    /// Writes a texture of eight bits as a file of tiles and levels.
    fn write(texture: &ImageTexture, path: &Path) {
        let Source::Memory(levels) = &texture.source else { panic!("not in memory") };
        let sizes = levels.iter().map(|level| [level.width, level.height]);
        let texels = levels.iter().map_while(|level| level.texels.as_bytes());
        TiledImage::write(path, texels.zip(sizes)).unwrap();
    }

    #[test]
    fn files_of_tiles_and_levels_stay_where_they_are() {
        let data: Vec<f32> = (0..256 * 128 * 3).map(|i| (i % 256) as f32 / 255.0).collect();
        let here = ImageTexture::new(&image(256, 128, &RGB, data), Encoding::Srgb);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tx");
        write(&here, &path);
        let there = ImageTexture::read(&path, Encoding::Srgb).unwrap();
        assert!(matches!(there.source, Source::Tiles(_)));
        for i in 0..100 {
            let (uv, texels) = (Vec2::new(0.017 * i as f32, 0.031 * i as f32), 0.1 * i as f32);
            let sampler = Sampler::default();
            let (a, b) = (there.at(uv, texels, &sampler), here.at(uv, texels, &sampler));
            assert_eq!(a, b, "{uv} {texels}");
        }
        assert!((there.mean() - here.mean()).abs().max_element() < 0.01, "{} {}", there.mean(), here.mean());
    }

    #[test]
    fn what_goes_away_while_it_is_looked_at_is_told() {
        // The picture is so large that not all of it is read at first.
        let data = vec![128.0 / 255.0; 2048 * 1024];
        let here = ImageTexture::new(&image(2048, 1024, &["Y"], data), Encoding::Linear);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("goes away.tx");
        write(&here, &path);
        let there = ImageTexture::read(&path, Encoding::Linear).unwrap();
        std::fs::File::options().write(true).open(&path).unwrap().set_len(100).unwrap();
        let values: Vec<Vec4> = (0..100)
            .map(|i| there.at(Vec2::new(0.013 * i as f32, 0.0097 * i as f32), 0.0, &Sampler::default()))
            .collect();
        assert!(values.contains(&Vec4::W), "{values:?}");
        let told = image_io::take_tile_failures();
        assert!(told.iter().any(|told| told.contains("goes away.tx")), "{told:?}");
        assert!(ImageTexture::read(&path, Encoding::Linear).is_err());
    }
}
