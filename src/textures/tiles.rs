//! Texels of a picture that is read from its file by tiles on demand.

use super::image::{Encoding, decode_srgb, srgb_table};
use crate::image_io::TiledImage;
use glam::{DVec4, Vec4};
use std::sync::Arc;

/// Most texels of the level that is searched for the smallest value of a picture.
const LEAST_TEXELS: u64 = 1 << 20;

/// Levels in a file, with the encoding of their values.
#[derive(Clone, Debug)]
pub(super) struct TiledTexels {
    image: Arc<TiledImage>,
    encoding: Encoding,
    /// Values are multiples of one over this number, to which they are rounded to undo rounding errors of the reader; 0 for floating
    /// point.
    steps: f32,
    /// Channels in the file, four at most.
    channels: u32,
    is_associated: bool,
}

impl PartialEq for TiledTexels {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.image, &other.image) && self.encoding == other.encoding
    }
}

impl TiledTexels {
    /// The texels of a picture with this encoding, unless its file states that it is linear.
    pub(super) fn new(image: TiledImage, encoding: Encoding) -> Self {
        let encoding = if image.is_linear() { Encoding::Linear } else { encoding };
        let steps = match image.bits() {
            8 => 255.0,
            16 => 65535.0,
            _ => 0.0,
        };
        let (channels, is_associated) = (image.channels().min(4), image.is_associated());
        Self { image: Arc::new(image), encoding, steps, channels, is_associated }
    }

    /// Width and height of each level, the finest first.
    #[inline]
    pub(super) fn levels(&self) -> &[[u32; 2]] {
        self.image.levels()
    }

    #[inline]
    pub(super) fn texel(&self, level: usize, from: [u32; 2]) -> Vec4 {
        let mut texel = [[0.0, 0.0, 0.0, 1.0]];
        self.image.read(level, from, [1, 1], &mut texel);
        self.decoded(texel[0])
    }

    /// The texels at two columns and two rows, row by row.
    #[inline]
    pub(super) fn four(&self, level: usize, columns: [u32; 2], rows: [u32; 2]) -> [Vec4; 4] {
        if columns[0] + 1 == columns[1] && rows[0] + 1 == rows[1] {
            let mut texels = [[0.0, 0.0, 0.0, 1.0]; 4];
            self.image.read(level, [columns[0], rows[0]], [2, 2], &mut texels);
            return texels.map(|texel| self.decoded(texel));
        }
        let at = |x: usize, y: usize| self.texel(level, [columns[x], rows[y]]);
        [at(0, 0), at(1, 0), at(0, 1), at(1, 1)]
    }

    /// Linear value and alpha of a texel, from its values in the file.
    #[inline]
    fn decoded(&self, [r, g, b, a]: [f32; 4]) -> Vec4 {
        let texel = match self.channels {
            1 => Vec4::new(r, r, r, 1.0),
            2 => Vec4::new(r, r, r, g),
            3 => Vec4::new(r, g, b, 1.0),
            _ => Vec4::new(r, g, b, a),
        };
        // NaN becomes 0.
        let mut texel = Vec4::select(texel.cmpge(Vec4::ZERO), texel, Vec4::ZERO).min(Vec4::ONE);
        if self.steps > 0.0 {
            texel = (texel * self.steps).round() * self.steps.recip();
        }
        if self.is_associated && texel.w > 0.0 && texel.w < 1.0 {
            texel = (texel / texel.w).min(Vec4::ONE).with_w(texel.w);
        }
        let decode = |x: f32| match self.encoding {
            Encoding::Linear => x,
            Encoding::Srgb if self.steps == 255.0 => srgb_table()[(255.0 * x).round() as usize],
            Encoding::Srgb => decode_srgb(x),
        };
        Vec4::new(decode(texel.x), decode(texel.y), decode(texel.z), texel.w)
    }

    /// Smallest value and mean of each channel, from the finest level of at most a million texels.
    pub(super) fn least_and_mean(&self) -> (Vec4, Vec4) {
        let texels = |[width, height]: &[u32; 2]| u64::from(*width) * u64::from(*height);
        let levels = self.levels();
        let level = levels.iter().position(|size| texels(size) <= LEAST_TEXELS).unwrap_or(levels.len() - 1);
        let [width, height] = levels[level];
        let (mut least, mut sum) = (Vec4::ONE, DVec4::ZERO);
        let mut row = vec![[0.0, 0.0, 0.0, 1.0]; width as usize];
        for y in 0..height {
            self.image.read(level, [0, y], [width, 1], &mut row);
            for &texel in &row {
                let value = self.decoded(texel);
                least = least.min(value);
                sum += value.as_dvec4();
            }
        }
        (least, (sum / texels(&levels[level]) as f64).as_vec4())
    }
}
