//! Counter-based random numbers.

use glam::Vec2;

/// Purpose of random numbers. Different streams of one seed are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Stream {
    /// Camera samples of a pixel.
    Camera = 1,
    /// Photons of the global map.
    GlobalPhotons = 2,
    /// Photons of the caustic map.
    CausticPhotons = 3,
    /// Short passes that estimate the number of photons to emit.
    Prepass = 4,
    /// Random numbers of tests and measurements.
    Measure = 5,
    /// Hemispheres of the irradiance cache.
    IrradianceCache = 16,
    /// Rays that store direct and shadow photons.
    ShadowPhotons = 17,
    /// Paths that estimate the contribution of each light.
    LightImportance = 18,
    /// Extra camera rays where the camera sees emitters.
    VisibleEmitters = 19,
    /// The search for images of emitters in glass and mirrors (glints).
    GlintSearch = 20,
    /// Extra camera samples at glints.
    Glints = 21,
    /// Shadow rays from points with precomputed irradiance.
    DirectAtPoints = 22,
    /// Collisions in media along a ray.
    Media = 23,
    /// Photons that cross media as beams.
    VolumeBeams = 24,
    /// Photons that media scatter.
    VolumePhotons = 25,
    /// Rays between patches of radiosity.
    Radiosity = 26,
    /// Shadow rays from patches of radiosity to light sources without a surface.
    RadiosityLights = 27,
}

/// The finaliser of SplitMix64 (Steele, Lea & Flood 2014; constants of Stafford's variant 13): every input bit
/// changes each output bit with probability near one half.
#[inline]
pub const fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A counter-based generator: the n-th number of (seed, stream, index) is a hash of the four.
#[derive(Clone, Copy, Debug)]
pub struct Rng {
    key: u64,
    dimension: u64,
}

impl Rng {
    /// The sequence `index` of `stream` for `seed`, from dimension 0.
    #[inline]
    pub fn new(seed: u64, stream: Stream, index: u64) -> Self {
        let key = mix(mix(mix(seed.wrapping_add(GOLDEN)) ^ stream as u64).wrapping_add(index));
        Self { key, dimension: 0 }
    }

    /// An independent sequence, selected by the next dimension of this one.
    pub fn split(&mut self) -> Self {
        Self { key: mix(self.next_u64() ^ GOLDEN), dimension: 0 }
    }

    /// The next 64 bits.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        self.dimension = self.dimension.wrapping_add(GOLDEN);
        mix(self.key.wrapping_add(self.dimension))
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-24.
    #[inline]
    pub fn next_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-53.
    #[inline]
    pub fn next_f64(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Two uniform variates from one hash.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        let bits = self.next_u64();
        Vec2::new((bits >> 40) as f32, (bits >> 8 & 0xff_ffff) as f32) * (1.0 / 16_777_216.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_and_range() {
        let mut rng = Rng::new(7, Stream::Measure, 0);
        let n = 1_000_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let x = rng.next_f64();
            assert!((0.0..1.0).contains(&x));
            sum += x;
            squares += x * x;
        }
        let mean = sum / n as f64;
        assert!((mean - 0.5).abs() < 4.0 * (1.0f64 / 12.0 / n as f64).sqrt(), "{mean}");
        assert!((squares / n as f64 - 1.0 / 3.0).abs() < 0.002);
    }

    #[test]
    fn neighbours_are_uncorrelated() {
        // Across indices, streams and dimensions: correlation of consecutive values.
        let n = 200_000u64;
        let across_index = (0..n).map(|i| Rng::new(1, Stream::Measure, i).next_f64());
        let mut rng = Rng::new(1, Stream::Measure, 0);
        let across_dimension: Vec<f64> = (0..n).map(|_| rng.next_f64()).collect();
        for values in [across_index.collect::<Vec<_>>(), across_dimension] {
            let products: f64 = values.windows(2).map(|w| (w[0] - 0.5) * (w[1] - 0.5)).sum();
            let correlation = products / n as f64 * 12.0;
            assert!(correlation.abs() < 4.0 / (n as f64).sqrt(), "{correlation}");
        }
    }

    #[test]
    fn a_function_of_its_four_arguments() {
        let draw = |seed, stream, index| Rng::new(seed, stream, index).next_u64();
        assert_eq!(draw(1, Stream::Camera, 2), draw(1, Stream::Camera, 2));
        assert_ne!(draw(1, Stream::Camera, 2), draw(2, Stream::Camera, 2));
        assert_ne!(draw(1, Stream::Camera, 2), draw(1, Stream::Prepass, 2));
        assert_ne!(draw(1, Stream::Camera, 2), draw(1, Stream::Camera, 3));
        // Indices do not wrap at 2^32.
        assert_ne!(draw(1, Stream::Camera, 2), draw(1, Stream::Camera, 2 + (1 << 32)));
    }
}
