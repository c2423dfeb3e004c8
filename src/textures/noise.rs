//! Gradient noise of Perlin ("An Image Synthesizer", 1985) with the fifth-degree blend of his "Improving Noise" (2002),
//! over hashed lattice points instead of a table, so that it does not repeat within 2^32 units.

use glam::DVec3;

/// Scale that brings the largest value of the gradients below to about 1.
const SCALE: f64 = 0.97;

/// Mean of the absolute value of [`noise`].
const MEAN_OF_ABSOLUTE: f64 = 0.2135;

/// Band-limited noise with mean 0 in [-1, 1]. Features are about one unit large, and the value is zero at integer points. The same `seed`
/// and position give the same value on every machine. Positions beyond 2^31 units wrap around.
pub fn noise(p: DVec3, seed: u32) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let [x, y, z] = cell.to_array().map(|c| c.rem_euclid(4_294_967_296.0) as u32);
    let blend = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let corner = |i: u32, j: u32, k: u32| {
        let offset = f - DVec3::new(f64::from(i), f64::from(j), f64::from(k));
        gradient(hash(x.wrapping_add(i), y.wrapping_add(j), z.wrapping_add(k), seed), offset)
    };
    let mix = |a: f64, b: f64, s: f64| a + s * (b - a);
    let edge = |j: u32, k: u32| mix(corner(0, j, k), corner(1, j, k), blend.x);
    let face = |k: u32| mix(edge(0, k), edge(1, k), blend.y);
    SCALE * mix(face(0), face(1), blend.z)
}

/// Dot product of `offset` with one of the twelve directions to the edges of a cube.
fn gradient(hash: u32, offset: DVec3) -> f64 {
    let DVec3 { x, y, z } = offset;
    // The choice is uniform over the twelve to 1e-9.
    let edge = (u64::from(hash) * 12) >> 32;
    let (a, b) = match edge >> 2 {
        0 => (x, y),
        1 => (y, z),
        _ => (z, x),
    };
    let signed = |v: f64, bit: u64| if edge & bit == 0 { v } else { -v };
    signed(a, 1) + signed(b, 2)
}

/// Hash of lattice coordinates in which every input bit affects every output bit.
fn hash(x: u32, y: u32, z: u32, seed: u32) -> u32 {
    let mut h = seed ^ 0x9e37_79b9;
    for word in [x, y, z] {
        h = (h ^ word).wrapping_mul(0x85eb_ca6b);
        h ^= h >> 15;
        h = h.wrapping_mul(0xc2b2_ae35);
        h ^= h >> 13;
    }
    h ^ h >> 16
}

/// Sums of octaves of noise. Each octave has half the wavelength and half the amplitude of the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Octaves {
    /// Wavelength of the first octave.
    pub size: f64,
    /// Least wavelength: no octave is finer, and octaves below twice this wavelength fade.
    pub finest: f64,
    /// Seed of the noise.
    pub seed: u32,
}

impl Octaves {
    /// Most octaves in a sum: a factor of 10^6 in wavelength.
    const MOST: u32 = 20;

    /// Wavelength, weight and number of each octave.
    fn each(&self) -> impl Iterator<Item = (f64, f64, u32)> {
        let Self { size, finest, .. } = *self;
        (0..Self::MOST).map_while(move |k| {
            let share = 0.5f64.powi(k as i32);
            let wavelength = size * share;
            let fade = kept(wavelength, finest);
            (fade > 0.0 || k == 0).then_some((wavelength, share * fade.max(f64::from(k == 0)), k))
        })
    }

    fn octave(&self, p: DVec3, wavelength: f64, k: u32) -> f64 {
        // Each octave has a seed of its own, so that their zeros do not coincide.
        noise(p / wavelength, self.seed.wrapping_add(k.wrapping_mul(0x6d2b_79f5)))
    }

    /// Sum of the octaves after `fold`, filtered to the footprint `width`: finer octaves are replaced by their `mean`.
    fn sum(&self, p: DVec3, width: f64, fold: impl Fn(f64) -> f64, mean: f64) -> f64 {
        let octaves = self.each().map(|(wavelength, weight, k)| match kept(wavelength, width) {
            0.0 => weight * mean,
            share => weight * (share * fold(self.octave(p, wavelength, k)) + (1.0 - share) * mean),
        });
        octaves.sum()
    }

    /// Sum of signed octaves, with mean 0 and in [-2, 2], filtered to the footprint `width` (0 for all detail).
    pub fn fractal(&self, p: DVec3, width: f64) -> f64 {
        self.sum(p, width, |value| value, 0.0)
    }

    /// Perlin's turbulence: the sum of absolute octaves, with creases where they change sign. It lies in [0, 2]. `width` is as for
    /// [`Self::fractal`] and does not change the mean.
    pub fn turbulence(&self, p: DVec3, width: f64) -> f64 {
        self.sum(p, width, f64::abs, MEAN_OF_ABSOLUTE)
    }
}

/// Share of a wave that is kept for the footprint `width`: all of a wave of at least two widths, none up to one width.
pub(super) fn kept(wavelength: f64, width: f64) -> f64 {
    if width > 0.0 { (wavelength / width - 1.0).clamp(0.0, 1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    fn random_point(rng: &mut Rng, size: f64) -> DVec3 {
        size * (2.0 * DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) - 1.0)
    }

    #[test]
    fn mean_range_and_lattice() {
        let mut rng = Rng::new(1, Stream::Measure, 0);
        let (mut sum, mut absolute, mut squares, mut largest) = (0.0, 0.0, 0.0, 0.0f64);
        let count = 400_000;
        for _ in 0..count {
            let value = noise(random_point(&mut rng, 1000.0), 7);
            sum += value;
            absolute += value.abs();
            squares += value * value;
            largest = largest.max(value.abs());
        }
        let (mean, deviation) = (sum / f64::from(count), (squares / f64::from(count)).sqrt());
        // Points in one cell are not independent, but cells are; there is about one cell per point here.
        assert!(mean.abs() < 5.0 * deviation / f64::from(count).sqrt(), "{mean} of {deviation}");
        assert!(largest <= 1.0 && largest > 0.8 && (0.2..0.35).contains(&deviation), "{largest} {deviation}");
        assert!(
            (absolute / f64::from(count) - MEAN_OF_ABSOLUTE).abs() < 2e-3,
            "{}",
            absolute / f64::from(count)
        );
        for _ in 0..1000 {
            assert_eq!(noise(random_point(&mut rng, 1e6).floor(), 7), 0.0);
        }
    }

    #[test]
    fn smooth_across_cells() {
        let mut rng = Rng::new(2, Stream::Measure, 0);
        for _ in 0..2000 {
            let mut p = random_point(&mut rng, 50.0);
            p.x = p.x.floor();
            let h = 1e-5;
            let at = |x: f64| noise(p.with_x(p.x + x), 3);
            let (left, right) = ((at(0.0) - at(-h)) / h, (at(h) - at(0.0)) / h);
            assert!((left - right).abs() < 1e-3, "{left} {right}");
        }
    }

    #[test]
    fn octaves_below_the_finest_are_left_out() {
        let mut rng = Rng::new(3, Stream::Measure, 0);
        let octaves = |finest: f64| Octaves { size: 1.0, finest, seed: 5 };
        for _ in 0..100 {
            let p = random_point(&mut rng, 10.0);
            assert_eq!(octaves(1.0).fractal(p, 0.0), noise(p, 5));
            // The sum is continuous in the cut-off, as octaves fade.
            for k in 1..6 {
                let finest = 0.5f64.powi(k);
                let (below, above) = (octaves(finest * 0.999_999), octaves(finest * 1.000_001));
                assert!((below.turbulence(p, 0.0) - above.turbulence(p, 0.0)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn seeds_differ_and_repeat() {
        let p = DVec3::new(0.3, 12.7, -8.1);
        assert_eq!(noise(p, 1), noise(p, 1));
        assert_ne!(noise(p, 1), noise(p, 2));
        assert!(noise(DVec3::splat(1e15), 1).is_finite());
    }
}
