//! RGBE encoding of colours in four bytes.

use super::Rgb;
use glam::Vec3A;

/// A non-negative colour in four bytes: three 8-bit mantissas and a shared exponent (Ward, "Real Pixels",
/// Graphics Gems II, 1991). Covers 2^-136 to 2^127, which is 1e-41 to 1e38.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rgbe(pub [u8; 4]);

impl Rgbe {
    /// Encodes `colour`. Each mantissa is rounded up or down at random, which keeps its expectation exact.
    ///
    /// Rounding to nearest would shift the flux of a whole map by up to 0.2 %, as many photons carry the same power. The random number `u`
    /// in `[0, 1)` decides instead, with different bits for the three channels. Negative and NaN channels become zero, infinite ones the
    /// largest value.
    pub fn encode_dithered(colour: Rgb, u: f32) -> Self {
        let colour = Vec3A::from(colour).max(Vec3A::ZERO).min(Vec3A::splat(LARGEST));
        let largest = colour.max_element();
        // A colour below the normal range of f32 becomes zero: such flux is lost in any sum.
        if !(largest >= f32::MIN_POSITIVE) {
            return Self([0; 4]);
        }
        let mut exponent = exponent_of(largest);
        // The largest mantissa may round up to 256, which needs the next exponent.
        if largest * scale_for(exponent) > 255.0 {
            exponent += 1;
        }
        let scale = scale_for(exponent);
        let bits = (u * 16_777_216.0) as u32;
        // Each channel uses sixteen bits. They overlap, which correlates the rounding of the channels but does not affect any mean.
        let dither = |bits: u32| (bits & 0xffff) as i32 as f32;
        let dither = Vec3A::new(dither(bits >> 8), dither(bits), dither(bits << 8 | bits >> 16));
        // A shift by a random threshold in half a step around zero, followed by rounding to nearest, is random rounding. Adding 2^23 brings
        // the integer into the low bits.
        let threshold = (dither - 32_767.5) * (1.0 / 65_536.0);
        let moved = (colour * scale + threshold).max(Vec3A::ZERO).min(Vec3A::splat(255.0));
        let [r, g, b] = (moved + 8_388_608.0).to_array();
        Self([r.to_bits() as u8, g.to_bits() as u8, b.to_bits() as u8, (exponent + 128) as u8])
    }

    /// Decodes the colour.
    #[inline]
    pub fn decode(self) -> Rgb {
        let [r, g, b, e] = self.0;
        if e == 0 {
            return Rgb::ZERO;
        }
        // 2^(e - 136).
        let scale = f32::from_bits(u32::from(e.max(10) - 9) << 23);
        Rgb::new(f32::from(r), f32::from(g), f32::from(b)) * scale
    }
}

/// The largest colour that a code can hold: 255 * 2^119.
const LARGEST: f32 = 1.694_733e38;

/// Exponent `e` with `x` in `[2^(e-1), 2^e)`, for normal `x`, at least the smallest that a code can hold.
fn exponent_of(x: f32) -> i32 {
    (((x.to_bits() >> 23) as i32) - 126).max(-117)
}

/// 2^(8 - exponent), for the results of [`exponent_of`] and one more.
fn scale_for(exponent: i32) -> f32 {
    f32::from_bits(((8 + 127 - exponent) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_error_and_expectation() {
        for scale in [1e-30f32, 1e-6, 1.0, 255.9, 256.0, 1e30] {
            let colour = Rgb::new(1.0, 0.37, 0.003) * scale;
            let mut sum = [0f64; 3];
            let n = 65_536;
            for i in 0..n {
                // All combinations of the three dithers would take 2^24 samples; a Weyl sequence covers them evenly.
                let u = ((i as u64 * 11_400_714_819_323_198_485) >> 40) as f32 / 16_777_216.0;
                let decoded = Rgbe::encode_dithered(colour, u).decode();
                assert!((decoded - colour).abs().max_element() <= scale / 127.0);
                (0..3).for_each(|c| sum[c] += f64::from(decoded[c]));
            }
            for c in 0..3 {
                let mean = sum[c] / n as f64;
                let want = f64::from(colour[c]);
                assert!((mean / want - 1.0).abs() < 0.001, "scale {scale}, channel {c}: {mean} {want}");
            }
        }
    }

    #[test]
    fn edges() {
        assert_eq!(Rgbe::encode_dithered(Rgb::ZERO, 0.5).decode(), Rgb::ZERO);
        assert_eq!(Rgbe::encode_dithered(Rgb::splat(f32::NAN), 0.5).decode(), Rgb::ZERO);
        assert_eq!(Rgbe::encode_dithered(Rgb::splat(-1.0), 0.5).decode(), Rgb::ZERO);
        let largest = Rgbe::encode_dithered(Rgb::splat(f32::INFINITY), 0.999).decode();
        assert!(largest.is_finite() && largest.x > 1.6e38, "{largest}");
        assert!(Rgbe::encode_dithered(Rgb::splat(1e-37), 0.999).decode().x > 0.0);
        for power in -30..60 {
            let x = 2f32.powi(power);
            assert_eq!(Rgbe::encode_dithered(Rgb::splat(x), 0.7).decode(), Rgb::splat(x), "2^{power}");
        }
    }

    #[test]
    fn largest_mantissa_does_not_overflow() {
        for u in [0.0, 0.5, 0.999_999_9] {
            let x = 255.99 / 256.0;
            let decoded = Rgbe::encode_dithered(Rgb::splat(x), u).decode().x;
            assert!((decoded - x).abs() < 0.01, "{decoded}");
        }
    }
}
