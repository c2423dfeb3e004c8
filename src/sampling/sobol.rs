//! Owen-scrambled Sobol' sequences.

use super::rng::mix;
use glam::Vec2;

/// Dimensions of one Sobol' point. Further dimensions come from independently shuffled points (padding).
pub const SOBOL_DIMENSIONS: usize = 4;

/// Primitive polynomials and initial direction numbers of Joe & Kuo ("Constructing Sobol sequences with better
/// two-dimensional projections", 2008) for dimensions 2 to 4: (degree, coefficients, m).
const JOE_KUO: [(usize, u32, [u32; 3]); 3] = [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

const fn direction_numbers() -> [[u32; 32]; SOBOL_DIMENSIONS] {
    let mut all = [[0u32; 32]; SOBOL_DIMENSIONS];
    let mut bit = 0;
    while bit < 32 {
        all[0][bit] = 1 << (31 - bit);
        bit += 1;
    }
    let mut dimension = 1;
    while dimension < SOBOL_DIMENSIONS {
        let (degree, coefficients, m) = JOE_KUO[dimension - 1];
        let mut i = 0;
        while i < 32 {
            if i < degree {
                all[dimension][i] = m[i] << (31 - i);
            } else {
                let mut v = all[dimension][i - degree] ^ (all[dimension][i - degree] >> degree);
                let mut k = 1;
                while k < degree {
                    if coefficients >> (degree - 1 - k) & 1 == 1 {
                        v ^= all[dimension][i - k];
                    }
                    k += 1;
                }
                all[dimension][i] = v;
            }
            i += 1;
        }
        dimension += 1;
    }
    all
}

/// XOR of the direction numbers for each value of each byte of an index, so that a coordinate takes four lookups. Bits are reversed, as
/// the scramble requires.
const fn byte_tables() -> [[[u32; 256]; 4]; SOBOL_DIMENSIONS] {
    let directions = direction_numbers();
    let mut tables = [[[0u32; 256]; 4]; SOBOL_DIMENSIONS];
    let mut dimension = 0;
    while dimension < SOBOL_DIMENSIONS {
        let mut byte = 0;
        while byte < 4 {
            let mut value = 1;
            while value < 256usize {
                // XOR of the entry for the value without its lowest bit, and that bit's direction number.
                let bit = value.trailing_zeros() as usize;
                let rest = tables[dimension][byte][value & (value - 1)];
                tables[dimension][byte][value] = rest ^ directions[dimension][byte * 8 + bit].reverse_bits();
                value += 1;
            }
            byte += 1;
        }
        dimension += 1;
    }
    tables
}

static TABLES: [[[u32; 256]; 4]; SOBOL_DIMENSIONS] = byte_tables();

/// One set of a [`Sobol`] sequence.
#[derive(Clone, Copy, Debug)]
pub struct SobolSet {
    shuffle: u32,
    scrambles: u64,
}

impl SobolSet {
    /// Two coordinates of the point with `index`, each in `[0, 1)`.
    #[inline]
    pub fn sample_2d(&self, index: u32) -> Vec2 {
        let shuffled = self.shuffled(index);
        Vec2::new(scrambled(shuffled, 0, self.scrambles), scrambled(shuffled, 1, self.scrambles))
    }

    /// Four coordinates of the point with `index`, each in `[0, 1)`.
    #[inline]
    pub fn sample_4d(&self, index: u32) -> [f32; 4] {
        let (shuffled, scrambles) = (self.shuffled(index), self.scrambles);
        [
            scrambled(shuffled, 0, scrambles),
            scrambled(shuffled, 1, scrambles),
            scrambled(shuffled, 2, scrambles),
            scrambled(shuffled, 3, scrambles),
        ]
    }

    /// One coordinate of the point with `index`, in `[0, 1)`.
    #[inline]
    pub fn sample_1d(&self, index: u32) -> f32 {
        scrambled(self.shuffled(index), 0, self.scrambles)
    }

    /// The index shuffled within its aligned blocks.
    #[inline]
    fn shuffled(&self, index: u32) -> u32 {
        // Bit-reversed input and output: the low bits of an index decide its elementary intervals.
        laine_karras(index.reverse_bits(), self.shuffle).reverse_bits()
    }
}

/// A padded, Owen-scrambled Sobol' sequence (Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020).
///
/// Any aligned block of 2^m indices is a (0, m, 2)-net in the first two dimensions of a set, so a pixel that
/// takes 2^m samples is stratified in each of its sets. Sets with different numbers are independent.
#[derive(Clone, Copy, Debug)]
pub struct Sobol {
    seed: u64,
}

impl Sobol {
    /// The sequence of `seed`, itself a hash of (seed, stream, pixel).
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// Two coordinates of the point with `index` in set number `set`, each in `[0, 1)`.
    #[inline]
    pub fn sample_2d(&self, set: u32, index: u32) -> Vec2 {
        self.set(set).sample_2d(index)
    }

    /// Four coordinates of the point with `index` in set number `set`, each in `[0, 1)`.
    #[inline]
    pub fn sample_4d(&self, set: u32, index: u32) -> [f32; 4] {
        self.set(set).sample_4d(index)
    }

    /// One coordinate of the point with `index` in set number `set`, in `[0, 1)`.
    #[inline]
    pub fn sample_1d(&self, set: u32, index: u32) -> f32 {
        self.set(set).sample_1d(index)
    }

    /// The set with this number, for callers that take many points of one set.
    #[inline]
    pub fn set(&self, number: u32) -> SobolSet {
        let seeds = mix(self.seed ^ mix(u64::from(number).wrapping_add(0x51_7cc1_b727_220a)));
        SobolSet { shuffle: seeds as u32, scrambles: mix(seeds) }
    }
}

#[inline]
fn scrambled(index: u32, dimension: usize, seeds: u64) -> f32 {
    let seed = (seeds >> (dimension * 8)) as u32 ^ (dimension as u32).wrapping_mul(0x9e37_79b9);
    let x = laine_karras(reversed_sobol(index, dimension), seed).reverse_bits();
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// The coordinate of point `index` in one dimension: the 32 bits after the binary point, in reverse order.
#[inline]
fn reversed_sobol(index: u32, dimension: usize) -> u32 {
    if dimension == 0 {
        // The van der Corput sequence is the reversed index.
        return index;
    }
    let [a, b, c, d] = index.to_le_bytes();
    let table = &TABLES[dimension];
    table[0][a as usize] ^ table[1][b as usize] ^ table[2][c as usize] ^ table[3][d as usize]
}

/// A hash in which each bit depends only on lower ones: an Owen scramble of bit-reversed numbers (Laine & Karras
/// 2011, constants of Vegdahl 2021).
#[inline]
fn laine_karras(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_elementary_interval_holds_one_point() {
        for seed in 0..20 {
            let sequence = Sobol::new(mix(seed));
            for m in [4u32, 6, 8] {
                let n = 1u32 << m;
                // Two aligned blocks, all shapes of intervals of area 2^-m.
                for block in 0..2 {
                    for shape in 0..=m {
                        let mut seen = vec![false; n as usize];
                        for i in 0..n {
                            let p = sequence.sample_2d(3, block * n + i);
                            let (w, h) = (1u32 << shape, 1u32 << (m - shape));
                            let cell = (p.x * w as f32) as u32 * h + (p.y * h as f32) as u32;
                            assert!(!seen[cell as usize], "seed {seed} m {m} shape {shape}");
                            seen[cell as usize] = true;
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn each_dimension_is_stratified() {
        let sequence = Sobol::new(99);
        let mut seen = [[false; 256]; SOBOL_DIMENSIONS];
        for i in 0..256 {
            for (dimension, x) in sequence.sample_4d(7, i).into_iter().enumerate() {
                assert!((0.0..1.0).contains(&x));
                assert!(!std::mem::replace(&mut seen[dimension][(x * 256.0) as usize], true));
            }
        }
    }

    #[test]
    fn sets_are_independent() {
        let sequence = Sobol::new(5);
        let n = 4096;
        let covariance: f32 =
            (0..n).map(|i| (sequence.sample_1d(0, i) - 0.5) * (sequence.sample_1d(1, i) - 0.5)).sum::<f32>()
                / n as f32;
        assert!((covariance * 12.0).abs() < 4.0 / (n as f32).sqrt(), "{covariance}");
    }

    #[test]
    fn integrates_better_than_random() {
        // x*y over the unit square: error well below 1/sqrt(n).
        let sequence = Sobol::new(123);
        let n = 1024;
        let mean: f32 = (0..n).map(|i| sequence.sample_2d(0, i)).map(|p| p.x * p.y).sum::<f32>() / n as f32;
        assert!((mean - 0.25).abs() < 5e-4, "{mean}");
    }
}
