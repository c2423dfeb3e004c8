//! Flux of a stored photon in four bytes: a colour, or a wavelength and a magnitude.

use crate::math::{Rgb, Rgbe};
use crate::spectra::Line;

/// The flux of a photon: RGBE, or, for a photon that was dispersed, its [`Line`] and its flux.
///
/// RGBE has a mantissa of 127 or more unless its exponent is among the least. A monochromatic photon has three below 127: digits to the base
/// of 127, which hold the number of the line and nine bits of mantissa, of which the highest is not stored. Its colour has negative
/// channels, which RGBE could not hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PackedPower([u8; 4]);

/// Highest bits of the three mantissas, and one in each.
const HIGH_BITS: u32 = 0x0080_8080;
const ONES: u32 = 0x0001_0101;

/// Base of the digits of a monochromatic photon.
const BASE: u32 = 127;

/// Least code of a monochromatic photon: below, the exponent is so small that RGBE may have small mantissas as well.
const LEAST_LINE: u32 = 0x0c00_0000;

/// Bits of the mantissa of a monochromatic flux, the highest one included.
const MANTISSA_BITS: u32 = 9;

/// That highest bit.
const HIDDEN: u32 = 1 << (MANTISSA_BITS - 1);

const _: () = assert!((1 << (Line::BITS + MANTISSA_BITS - 1)) < BASE * BASE * BASE);

impl PackedPower {
    /// Of `power`, which has equal channels where there is a `line`. `dither` in `[0, 1)` rounds without bias, as
    /// [`Rgbe::encode_dithered`].
    #[inline]
    pub(super) fn encode(power: Rgb, line: Option<Line>, dither: f32) -> Self {
        match line {
            None => Self(Rgbe::encode_dithered(power, dither).0),
            Some(line) => Self::monochromatic(power.x, line, dither),
        }
    }

    /// A flux of one wavelength. Below 1e-35 W it becomes zero, above 1e38 W it is that; NaN and negative ones become zero.
    fn monochromatic(flux: f32, line: Line, dither: f32) -> Self {
        const LEAST: f32 = 1e-35;
        const LARGEST: f32 = 1e38;
        if !(flux >= LEAST) {
            return Self::default();
        }
        let flux = flux.min(LARGEST);
        let mut exponent = (flux.to_bits() >> 23) as i32 - 126;
        let scale = |exponent: i32| f32::from_bits(((MANTISSA_BITS as i32 + 127 - exponent) as u32) << 23);
        let mut mantissa = (flux * scale(exponent) + dither) as u32;
        if mantissa >> MANTISSA_BITS != 0 {
            (mantissa, exponent) = (mantissa >> 1, exponent + 1);
        }
        let bits = u32::from(line.code()) << (MANTISSA_BITS - 1) | (mantissa & (HIDDEN - 1));
        let [low, middle, high] = [1, BASE, BASE * BASE].map(|unit| (bits / unit % BASE) as u8);
        Self([low, middle, high, (exponent + 128) as u8])
    }

    /// Line and flux, of a monochromatic photon.
    #[inline]
    fn of_line(self) -> Option<(Line, f32)> {
        let code = u32::from_le_bytes(self.0);
        let has_small_mantissas = (code | code.wrapping_add(ONES)) & HIGH_BITS == 0;
        (has_small_mantissas && code >= LEAST_LINE).then(|| self.line_and_flux())
    }

    #[cold]
    fn line_and_flux(self) -> (Line, f32) {
        let [low, middle, high, exponent] = self.0;
        let bits = (u32::from(high) * BASE + u32::from(middle)) * BASE + u32::from(low);
        let mantissa = (bits & (HIDDEN - 1) | HIDDEN) as f32;
        // 2^(e - 128 - 9).
        let scale = f32::from_bits((u32::from(exponent) - 10) << 23);
        (Line::of_code((bits >> (MANTISSA_BITS - 1)) as u16), mantissa * scale)
    }

    /// Flux by channel, as the sensor receives it.
    #[inline]
    pub(super) fn decode(self) -> Rgb {
        match self.of_line() {
            None => Rgbe(self.0).decode(),
            Some((line, flux)) => line.response() * flux,
        }
    }

    /// Flux times the factor `rgb`, which is taken at the wavelength of the photon, if it has one.
    #[inline]
    pub(super) fn times(self, rgb: Rgb) -> Rgb {
        match self.of_line() {
            None => Rgbe(self.0).decode() * rgb,
            Some((line, flux)) => line.response() * (flux * line.at(rgb)),
        }
    }

    /// Sum of the channels of white light of this flux: a measure that is never negative.
    #[inline]
    pub(super) fn brightness(self) -> f32 {
        match self.of_line() {
            None => Rgbe(self.0).decode().element_sum(),
            Some((_, flux)) => 3.0 * flux,
        }
    }

    /// Whether it is of one wavelength.
    #[inline]
    pub(super) fn is_monochromatic(self) -> bool {
        self.of_line().is_some()
    }

    /// `factor` times the flux.
    pub(super) fn scaled(self, factor: f32, dither: f32) -> Self {
        match self.of_line() {
            None => Self::encode(Rgbe(self.0).decode() * factor, None, dither),
            Some((line, flux)) => Self::monochromatic(flux * factor, line, dither),
        }
    }

    /// As in files.
    #[inline]
    pub(super) fn to_bytes(self) -> [u8; 4] {
        self.0
    }

    /// The flux of these bytes; all are valid.
    #[inline]
    pub(super) fn from_bytes(bytes: [u8; 4]) -> Self {
        Self(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};
    use crate::settings::Wavelengths;

    #[test]
    fn colours_are_never_taken_for_lines() {
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for _ in 0..300_000 {
            let scale = 2f32.powf(rng.next_f32() * 240.0 - 120.0);
            let power = Rgb::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * scale;
            let packed = PackedPower::encode(power, None, rng.next_f32());
            assert!(!packed.is_monochromatic(), "{power}");
        }
        for power in [128.0, 64.0, 1.0, 1e-38, 0.0, f32::MAX, f32::NAN] {
            for dither in [0.0, 0.5, 0.999_999] {
                assert!(!PackedPower::encode(Rgb::splat(power), None, dither).is_monochromatic(), "{power}");
            }
        }
    }

    #[test]
    fn lines_come_back_and_their_flux_has_no_bias() {
        let mut rng = Rng::new(2, Stream::Measure, 0);
        for flux in [1e-34f32, 1e-6, 0.3, 1.0, 255.9, 511.9, 1e30] {
            let mut sum = 0.0;
            const TRIES: u32 = 20_000;
            for _ in 0..TRIES {
                let line = Line::choose(Wavelengths::Continuous, rng.next_f32()).unwrap();
                let packed = PackedPower::encode(Rgb::splat(flux), Some(line), rng.next_f32());
                let (back, value) = packed.of_line().unwrap();
                assert!(back == line && (value / flux - 1.0).abs() <= 1.0 / 256.0, "{flux}: {value}");
                assert_eq!(packed.decode(), line.response() * value);
                assert_eq!(PackedPower::from_bytes(packed.to_bytes()), packed);
                sum += f64::from(value / flux);
            }
            // Rounding to one part in 256 to 512: standard error 1.1e-5 at most.
            assert!((sum / f64::from(TRIES) - 1.0).abs() < 1e-4, "{flux}: {}", sum / f64::from(TRIES));
        }
        let line = Line::of_code(7);
        for nothing in [0.0, -1.0, f32::NAN, 1e-36] {
            assert_eq!(PackedPower::encode(Rgb::splat(nothing), Some(line), 0.5).decode(), Rgb::ZERO);
        }
        let most = PackedPower::encode(Rgb::splat(f32::INFINITY), Some(line), 0.999);
        assert!(most.of_line().is_some_and(|(back, flux)| back == line && flux.is_finite()));
    }

    #[test]
    fn factors_are_taken_at_the_wavelength() {
        let red = Rgb::new(1.0, 0.0, 0.0);
        for (code, expected) in [(10u16, 0.03), (4000, 1.0)] {
            let line = Line::of_code(code);
            let packed = PackedPower::encode(Rgb::ONE, Some(line), 0.0);
            let times = packed.times(red) / line.response();
            assert!((times - line.at(red)).abs().max_element() < 1e-5);
            assert!((line.at(red) - expected).abs() < 0.01, "{}", line.at(red));
            assert_eq!(packed.brightness(), 3.0);
            assert_eq!(packed.scaled(0.5, 0.0).decode(), packed.decode() * 0.5);
        }
        let grey = PackedPower::encode(Rgb::splat(0.5), None, 0.5);
        assert_eq!((grey.times(red), grey.brightness()), (red * 0.5, 1.5));
    }
}
