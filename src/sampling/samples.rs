use super::{Sobol, Stream, rng::mix};
use glam::Vec2;

/// The numbers of one camera sample: point `index` of the pixel's sequence, dimension after dimension.
///
/// Each call takes the next set of dimensions. Where one hit needs many numbers (gather rays, shadow rays) a
/// [`Splits`] gives it consecutive points of one set, so that all rays of the pixel together are stratified.
#[derive(Clone, Copy, Debug)]
pub struct SampleStream {
    sequence: Sobol,
    index: u32,
    set: u32,
}

impl SampleStream {
    /// Sample `index` of `pixel` under `seed`.
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

    /// `count` points at once; every camera sample of the pixel must ask for the same count here, or points repeat.
    #[inline]
    pub fn splits(&mut self, count: u32) -> Splits {
        self.set += 1;
        Splits { sequence: self.sequence, set: self.set, first: self.index.wrapping_mul(count) }
    }
}

/// Where in pixel (`x`, `y`) its sample `index` of `count` lies, in `[0, 1)^2`.
///
/// The samples of all pixels of a square are consecutive points along a Z-order curve: those of one pixel are as well
/// spread as they would be by themselves, and those of its neighbours fill their gaps, so that of an edge one pixel has too
/// much of the next has too little of (Ahmed & Wonka, "Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via
/// Hierarchical Ordering of Pixels", 2020). Each point is uniform by itself. Not for the numbers of paths: that many
/// dimensions of one sequence, scrambled by hashes, go together enough to show in the mean of a square (a white furnace was
/// 0.6 % too bright), and each pixel has a sequence of its own for them.
pub fn place_in_pixel(seed: u64, (x, y): (u32, u32), index: u32, count: u32) -> Vec2 {
    let bits = count.max(1).next_power_of_two().trailing_zeros();
    let side = (INDEX_BITS.saturating_sub(bits) / 2).min(LARGEST_SQUARE);
    let square = u64::from(y >> side) << 32 | u64::from(x >> side);
    let key = mix(mix(seed ^ mix(Stream::PlaceInPixel as u64)).wrapping_add(square));
    let within = (1 << side) - 1;
    let place = spread(x & within) | spread(y & within) << 1;
    Sobol::new(key).sample_2d(0, place.wrapping_shl(bits).wrapping_add(index))
}

/// Sides of the squares whose pixels share a sequence are at most two to the power of this, and less where the indices of
/// all their samples would take more than [`INDEX_BITS`].
const LARGEST_SQUARE: u32 = 6;
const INDEX_BITS: u32 = 30;

/// The bits of a number below 2^16, each with a zero before it.
fn spread(x: u32) -> u32 {
    let x = (x | x << 8) & 0x00ff_00ff;
    let x = (x | x << 4) & 0x0f0f_0f0f;
    let x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
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

/// The first coordinate of a point, a multiple of 2^-24, with as many digits more that a hash of both coordinates gives:
/// uniform over the multiples of 2^-48 where the points are over theirs. For a choice out of many things.
#[inline]
pub fn refined(u: Vec2) -> f64 {
    const STEP: f64 = 1.0 / 16_777_216.0;
    let more = mix(u64::from(u.x.to_bits()) << 32 | u64::from(u.y.to_bits())) >> 40;
    f64::from(u.x) + more as f64 * (STEP * STEP)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_complement_each_other() {
        // One sample for each of 16 x 16 pixels: together a net, one in each cell of 16 x 16 and of 256 x 1.
        for seed in 0..10 {
            for corner in [(0, 0), (48, 16), (1600, 64)] {
                for (across, down) in [(16, 16), (256, 1), (1, 256)] {
                    let mut seen = [false; 256];
                    for i in 0..256 {
                        let pixel = (corner.0 + i % 16, corner.1 + i / 16);
                        let u = place_in_pixel(seed, pixel, 0, 1);
                        let cell = (u.x * across as f32) as usize * down + (u.y * down as f32) as usize;
                        assert!(!std::mem::replace(&mut seen[cell], true), "{seed} {corner:?} {across}");
                    }
                }
            }
        }
    }

    #[test]
    fn samples_of_a_pixel_are_stratified() {
        for (count, pixel) in [(4, (3, 9)), (16, (63, 64)), (1024, (70, 1)), (1 << 20, (5, 6))] {
            let side = (f64::from(count).sqrt() as usize).min(32);
            let taken = side * side;
            let mut seen = vec![false; taken];
            for index in 0..taken as u32 {
                let u = place_in_pixel(1, pixel, index, count);
                let cell = (u.x * side as f32) as usize * side + (u.y * side as f32) as usize;
                assert!(!std::mem::replace(&mut seen[cell], true), "{count} {pixel:?}");
            }
        }
    }

    #[test]
    fn mean_over_pixels_is_better_than_that_of_independent_ones() {
        // Area left of a slanted edge, from four samples a pixel over 32 x 32 pixels.
        let error = |of_pixel: &dyn Fn(u64, u32, u32, u32) -> Vec2| {
            let squares = (0..400).map(|seed| {
                let mut inside = 0;
                for (x, y) in (0..32).flat_map(|y| (0..32).map(move |x| (x, y))) {
                    for index in 0..4 {
                        let p = Vec2::new(x as f32, y as f32) + of_pixel(seed, x, y, index);
                        inside += u32::from(p.x + 0.3 * p.y < 20.0);
                    }
                }
                // The edge meets the bottom at 20 and the top at 10.4.
                (f64::from(inside) / 4096.0 - 15.2 / 32.0).powi(2)
            });
            (squares.sum::<f64>() / 400.0).sqrt()
        };
        let together = error(&|seed, x, y, index| place_in_pixel(seed, (x, y), index, 4));
        let alone =
            error(&|seed, x, y, index| SampleStream::new(seed, u64::from(y * 32 + x), index).next_2d());
        println!("rms error of the area {together:.2e}, of independent pixels {alone:.2e}");
        assert!(together < 0.9 * alone);
    }
}
