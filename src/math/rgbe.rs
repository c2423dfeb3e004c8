use super::Rgb;

/// A non-negative colour in four bytes: three 8-bit mantissas and a shared exponent (Ward, "Real Pixels",
/// Graphics Gems II, 1991). Covers 2^-136 to 2^127, which is 1e-41 to 1e38.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rgbe(pub [u8; 4]);

impl Rgbe {
    /// Encodes `colour`, rounding each mantissa up or down at random with the expectation kept exact.
    ///
    /// Rounding to nearest would shift the flux of a whole map by up to 0.2 %, as many photons carry the same
    /// power; `u` in `[0, 1)` decides instead, three times from different bits of it. Negative and NaN
    /// channels become zero, infinite ones the largest value.
    pub fn encode_dithered(colour: Rgb, u: f32) -> Self {
        let colour = colour.max(Rgb::ZERO).min(Rgb::splat(1.7e38));
        let largest = colour.max_element();
        // Below the normal range of f32 a photon is zero: such flux is lost in any sum.
        if !(largest >= f32::MIN_POSITIVE) {
            return Self([0; 4]);
        }
        let mut exponent = exponent_of(largest);
        // The largest mantissa may round up to 256; then the next exponent holds it.
        if largest * scale_for(exponent) > 255.0 {
            exponent += 1;
        }
        let scale = scale_for(exponent);
        let bits = (u * 16_777_216.0) as u32;
        // Sixteen bits for each channel; that they overlap ties the roundings of channels together, which no mean sees.
        let dither = [bits >> 8 & 0xffff, bits & 0xffff, (bits << 8 | bits >> 16) & 0xffff];
        let mut out = [0u8; 4];
        for (channel, mantissa) in out.iter_mut().take(3).enumerate() {
            // Rounding to nearest of what was moved by half a step less: rounding down, at random. 2^23 brings the
            // whole number into the low bits.
            let threshold = (dither[channel] as f32 - 32_767.5) / 65_536.0;
            let moved = (colour[channel] * scale + threshold).clamp(0.0, 255.0);
            *mantissa = (moved + 8_388_608.0).to_bits() as u8;
        }
        out[3] = (exponent + 128) as u8;
        Self(out)
    }

    /// The colour.
    #[inline]
    pub fn decode(self) -> Rgb {
        let [r, g, b, e] = self.0;
        if e == 0 {
            return Rgb::ZERO;
        }
        // 2^(e - 136), exactly; in two factors, as the smallest lies below the normal range.
        let scale = f32::from_bits(u32::from(e.max(10) - 9) << 23);
        Rgb::new(f32::from(r), f32::from(g), f32::from(b)) * scale
    }
}

/// Exponent `e` with `x` in `[2^(e-1), 2^e)`, for normal `x`, at least the smallest that a code can hold.
fn exponent_of(x: f32) -> i32 {
    (((x.to_bits() >> 23) as i32) - 126).max(-117)
}

/// 2^(8 - exponent).
fn scale_for(exponent: i32) -> f32 {
    let power = 8 - exponent;
    if power <= 127 { f32::from_bits(((power + 127) as u32) << 23) } else { f32::MAX }
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
                // All combinations of the three dithers would take 2^24; a Weyl sequence covers them evenly.
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
        assert!(Rgbe::encode_dithered(Rgb::splat(f32::INFINITY), 0.999).decode().is_finite());
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
