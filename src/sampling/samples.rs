//! Random numbers of one camera sample.

use super::{Sobol, Stream, rng::mix};
use glam::Vec2;

/// The random numbers of one camera sample: point `index` of the pixel's sequence, dimension by dimension.
///
/// Each call takes the next set of dimensions. Where one hit needs many numbers (gather rays, shadow rays), a [`Splits`] provides
/// consecutive points of one set, so that all rays of the pixel together are stratified.
#[derive(Clone, Copy, Debug)]
pub struct SampleStream {
    sequence: Sobol,
    index: u32,
    set: u32,
}

impl SampleStream {
    /// Sample `index` of `pixel` for `seed`.
    pub fn new(seed: u64, pixel: u64, index: u32) -> Self {
        let key = mix(mix(seed ^ mix(Stream::Camera as u64)).wrapping_add(pixel));
        Self { sequence: Sobol::new(key), index, set: 0 }
    }

    /// A number in `[0, 1)`.
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        self.set += 1;
        self.sequence.sample_1d(self.set, self.index)
    }

    /// A point in `[0, 1)^2`.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        self.set += 1;
        self.sequence.sample_2d(self.set, self.index)
    }

    /// `count` points at once. Every camera sample of the pixel must use the same count for this set, or points repeat.
    #[inline]
    pub fn splits(&mut self, count: u32) -> Splits {
        self.set += 1;
        Splits { sequence: self.sequence, set: self.set, first: self.index.wrapping_mul(count) }
    }
}

/// Consecutive points of one set.
#[derive(Clone, Copy, Debug)]
pub struct Splits {
    sequence: Sobol,
    set: u32,
    first: u32,
}

impl Splits {
    /// Point number `i` of the split.
    #[inline]
    pub fn get(&self, i: u32) -> Vec2 {
        self.sequence.sample_2d(self.set, self.first.wrapping_add(i))
    }

    /// All four coordinates of point number `i`.
    #[inline]
    pub fn get_4d(&self, i: u32) -> [f32; 4] {
        self.sequence.sample_4d(self.set, self.first.wrapping_add(i))
    }
}

/// The first coordinate of a point, a multiple of 2^-24, extended by 24 binary digits from a hash of both coordinates. The result is
/// uniform over the multiples of 2^-48 where the coordinates are uniform over theirs. It serves for a choice among many entries.
#[inline]
pub fn refined(u: Vec2) -> f64 {
    const STEP: f64 = 1.0 / 16_777_216.0;
    let more = mix(u64::from(u.x.to_bits()) << 32 | u64::from(u.y.to_bits())) >> 40;
    f64::from(u.x) + more as f64 * (STEP * STEP)
}
