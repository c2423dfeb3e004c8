//! Development of linear radiance for a screen: exposure, tone curve and sRGB encoding.

use crate::math::{Rgb, luminance};
use rayon::prelude::*;
use serde::Serialize;

/// Tone curve: the map from exposed linear radiance to display-linear colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneCurve {
    /// Linear up to 1 and clamped to white above, so that the screen shows the computed values within its range.
    #[default]
    None,
    /// A filmic shoulder after a linear base: the PBR Neutral tone mapper of the Khronos Group ("Khronos PBR Neutral
    /// Tone Mapper", specification and reference code, 2024). Diffuse colours up to 0.76 keep hue and saturation;
    /// brighter ones bend towards 1 and fade to white, where a plain clamp would shift their hue.
    Neutral,
}

impl ToneCurve {
    /// Display-linear colour in `[0, 1]` of the exposed linear `colour`. Negative and NaN channels become zero.
    pub fn apply(self, colour: Rgb) -> Rgb {
        // `max` drops NaN; infinity would give infinity over infinity below.
        let colour = Rgb::from_array(colour.to_array().map(|c| c.clamp(0.0, 1e30).max(0.0)));
        match self {
            Self::None => colour.min(Rgb::ONE),
            Self::Neutral => pbr_neutral(colour),
        }
    }
}

/// The reference code of the specification, with its names.
fn pbr_neutral(colour: Rgb) -> Rgb {
    const F90: f32 = 0.04;
    const START_COMPRESSION: f32 = 0.8 - F90;
    const DESATURATION: f32 = 0.15;
    let x = colour.min_element();
    let offset = if x < 2.0 * F90 { x - x * x / (4.0 * F90) } else { F90 };
    let colour = colour - offset;
    let peak = colour.max_element();
    if peak < START_COMPRESSION {
        return colour.max(Rgb::ZERO);
    }
    let d = 1.0 - START_COMPRESSION;
    let new_peak = 1.0 - d * d / (peak + d - START_COMPRESSION);
    let g = 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    let compressed = colour * (new_peak / peak);
    (compressed * g + Rgb::splat(new_peak) * (1.0 - g)).clamp(Rgb::ZERO, Rgb::ONE)
}

/// The sRGB encoding of linear `x` (IEC 61966-2-1), both in `[0, 1]`. Values outside are clamped first.
pub fn srgb_encode(x: f32) -> f32 {
    let x = f64::from(x.clamp(0.0, 1.0));
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    encoded as f32
}

/// The linear value of an sRGB-encoded `x`, both in `[0, 1]`. Values outside are clamped first.
pub fn srgb_decode(x: f32) -> f32 {
    let x = f64::from(x.clamp(0.0, 1.0));
    let linear = if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    linear as f32
}

/// The sRGB encoding of linear `x` as a byte, rounded to nearest without dithering. NaN becomes zero.
pub fn srgb_encode_u8(x: f32) -> u8 {
    // The cast turns NaN into zero.
    (srgb_encode(x) * 255.0).round() as u8
}

/// Development of linear radiance for a screen: exposure, curve, encoding. The result does not depend on the number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ToneMap {
    /// Exposure in stops: radiance is multiplied by `2^exposure`, and 1 is white.
    pub exposure: f64,
    /// Tone curve.
    pub curve: ToneCurve,
}

impl ToneMap {
    /// Display-linear colour in `[0, 1]` of the linear radiance `colour`.
    pub fn apply(&self, colour: Rgb) -> Rgb {
        // In f64, so that 1e30 W/(m^2 sr) can be exposed by -100 stops.
        let scale = self.exposure.exp2();
        let exposed = colour.as_dvec3() * scale;
        self.curve.apply(exposed.as_vec3())
    }

    /// Counts the clipped, visible and lit pixels of the interleaved linear RGB `pixels`, before any curve.
    pub fn rendition(&self, pixels: &[f32]) -> Rendition {
        /// Encoded value that would round to a byte above 255.
        const BEYOND_WHITE: f64 = 255.5 / 255.0;
        let white = ((BEYOND_WHITE + 0.055) / 1.055).powf(2.4);
        let scale = self.exposure.exp2();
        let mut rendition = Rendition::default();
        for pixel in pixels.chunks_exact(3) {
            let brightest = f64::from(pixel[0].max(pixel[1]).max(pixel[2])) * scale;
            rendition.pixels += 1;
            rendition.clipped += u64::from(brightest >= white);
            rendition.visible += u64::from(brightest > 1.0 / 255.0);
            rendition.lit += u64::from(brightest > 0.0);
        }
        rendition
    }

    /// Bytes for a PNG of the interleaved linear RGB `pixels`, one for each value. Values at the end that do not fill a pixel become
    /// black.
    pub fn to_srgb8(&self, pixels: &[f32]) -> Vec<u8> {
        let mut bytes = vec![0; pixels.len()];
        bytes.par_chunks_exact_mut(3).zip(pixels.par_chunks_exact(3)).for_each(|(out, pixel)| {
            let colour = self.apply(Rgb::new(pixel[0], pixel[1], pixel[2]));
            out.iter_mut().zip(colour.to_array()).for_each(|(byte, x)| *byte = srgb_encode_u8(x));
        });
        bytes
    }
}

/// Counts of clipped, visible and lit pixels of a developed picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rendition {
    /// Number of pixels.
    pub pixels: u64,
    /// Pixels with a channel that rounds to more than white.
    pub clipped: u64,
    /// Pixels with a channel above a 255th of white.
    pub visible: u64,
    /// Pixels with a channel above zero.
    pub lit: u64,
}

impl Rendition {
    /// Whether more than half of the pixels are clipped.
    pub fn is_too_bright(&self) -> bool {
        2 * self.clipped > self.pixels
    }

    /// Whether there is light, but no visible pixel.
    pub fn is_too_dark(&self) -> bool {
        self.visible == 0 && self.lit > 0
    }

    /// Whether no pixel has any light.
    pub fn is_black(&self) -> bool {
        self.lit == 0
    }
}

/// Stops that bring the log-average luminance of the interleaved linear RGB `pixels` to 0.18, middle grey
/// (Reinhard et al., "Photographic Tone Reproduction for Digital Images", 2002).
///
/// Pixels that are black or not finite are left out; the paper adds a small constant instead. So the result follows any scale of the
/// radiance exactly. `None` where no pixel is left.
pub fn auto_exposure(pixels: &[f32]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0u64);
    for pixel in pixels.chunks_exact(3) {
        let y = luminance(Rgb::new(pixel[0], pixel[1], pixel[2]));
        if y > 0.0 && y.is_finite() {
            sum += f64::from(y).log2();
            count += 1;
        }
    }
    (count > 0).then(|| 0.18f64.log2() - sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_the_standard() {
        for (linear, byte) in [(0.0, 0), (0.003_130_8, 10), (0.18, 118), (0.5, 188), (1.0, 255), (7.0, 255)] {
            assert_eq!(srgb_encode_u8(linear), byte, "{linear}");
        }
        assert_eq!(
            (srgb_encode_u8(f32::NAN), srgb_encode_u8(f32::INFINITY), srgb_encode_u8(-1.0)),
            (0, 255, 0)
        );
        for byte in 0..=255u8 {
            assert_eq!(srgb_encode_u8(srgb_decode(f32::from(byte) / 255.0)), byte);
        }
    }

    #[test]
    fn neutral_keeps_the_base_and_bends_the_top() {
        // A grey of the base loses 0.04 (the Fresnel reflection of a white sky), and nothing else happens to it.
        let base = ToneCurve::Neutral.apply(Rgb::new(0.5, 0.3, 0.2));
        assert!((base - Rgb::new(0.46, 0.26, 0.16)).abs().max_element() < 1e-6, "{base}");
        let mut last = -1.0;
        for i in 0..2000 {
            let x = 1e-3 * 1.02f32.powi(i);
            let y = ToneCurve::Neutral.apply(Rgb::splat(x)).x;
            assert!(y >= last && y <= 1.0, "{x}");
            last = y;
        }
        assert!(last > 0.999);
    }

    #[test]
    fn anything_gives_a_colour_in_range() {
        for curve in [ToneCurve::None, ToneCurve::Neutral] {
            for a in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 0.0, 1e-40, 0.08, 1.0, 1e30]
            {
                for b in [0.0, 1.0, f32::MAX, f32::NAN] {
                    let c = curve.apply(Rgb::new(a, b, 0.5));
                    assert!(c.min_element() >= 0.0 && c.max_element() <= 1.0, "{curve:?} {a} {b}: {c}");
                }
            }
        }
    }

    #[test]
    fn exposure_is_a_power_of_two() {
        let map = |exposure| ToneMap { exposure, curve: ToneCurve::None };
        assert_eq!(map(-2.0).apply(Rgb::splat(2.0)), Rgb::splat(0.5));
        assert!((map(-100.0).apply(Rgb::splat(1e30)).x / (1e30 / 2f64.powi(100)) as f32 - 1.0).abs() < 1e-6);
        assert_eq!(map(1.0).to_srgb8(&[0.25, 0.5, 4.0]), [188, 255, 255]);
    }

    #[test]
    fn a_rendition_counts_what_is_seen() {
        let map = |exposure| ToneMap { exposure, curve: ToneCurve::None };
        let pixels = [[0.0; 3], [1e-4, 0.0, 0.0], [0.5; 3], [0.2, 1.0, 0.2], [f32::NAN, 0.0, 0.0]].concat();
        let counts = |stops: f64| {
            let seen = map(stops).rendition(&pixels);
            (seen.pixels, seen.clipped, seen.visible, seen.lit)
        };
        // White itself is not beyond white.
        assert_eq!(counts(0.0), (5, 0, 2, 3));
        assert_eq!(counts(1.5), (5, 2, 2, 3));
        assert_eq!(counts(-10.0), (5, 0, 0, 3));
        assert!(map(-10.0).rendition(&pixels).is_too_dark() && !map(0.0).rendition(&pixels).is_too_dark());
        assert!(map(14.0).rendition(&pixels).is_too_bright() && !map(1.5).rendition(&pixels).is_too_bright());
        assert!(map(0.0).rendition(&[0.0; 6]).is_black() && !map(0.0).rendition(&[0.0; 6]).is_too_dark());
    }

    #[test]
    fn auto_exposure_follows_any_scale() {
        let pixels: Vec<f32> = (0..300).map(|i| 0.01 + (i % 37) as f32).collect();
        let stops = auto_exposure(&pixels).unwrap();
        for power in [-90, -3, 5, 90] {
            let scaled: Vec<f32> = pixels.iter().map(|x| x * 2f32.powi(power)).collect();
            assert!((auto_exposure(&scaled).unwrap() + f64::from(power) - stops).abs() < 1e-9);
        }
        assert!((auto_exposure(&[0.18; 3]).unwrap()).abs() < 1e-6);
        assert_eq!(auto_exposure(&[0.0, 0.0, 0.0, f32::NAN, 1.0, 1.0]), None);
    }
}
