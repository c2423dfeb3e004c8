//! Converts spectra to linear Rec. 709 colours, with the CIE observer of 1931.

use super::error::{Fault, Place, fail};
use super::text::{number, shown, tokens};
use crate::files::{read_regular, text_of};
use crate::spectra::cie::{FIRST, ROWS, STEP, planck};
use crate::textures::srgb_to_linear;
use glam::{DMat3, DVec3};
use std::path::Path;

/// Longest spectrum file, in bytes.
const MOST_BYTES: u64 = 1 << 22;

/// A spectrum as given in a file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Spectrum {
    /// A linear colour.
    Rgb(DVec3),
    /// A constant over all wavelengths.
    Uniform(f64),
    /// Wavelengths (nm, increasing) and values; linear between them and zero outside.
    Samples(Vec<(f64, f64)>),
}

/// Use of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// A reflectance in `[0, 1]`, converted under daylight.
    Reflectance,
    /// Emitted light. In files of versions before 2.0, a constant spectrum is white.
    Light { is_old: bool },
    /// Another quantity, such as an index of refraction.
    Number,
}

impl Spectrum {
    /// Parses three linear numbers, one number, or `#rrggbb`, which is always sRGB. Numbers are sRGB too where `is_encoded`.
    pub(crate) fn rgb(text: &str, is_encoded: bool, place: &Place) -> Result<Self, Fault> {
        let decoded = |value: f64| f64::from(srgb_to_linear(value.clamp(0.0, 1.0) as f32));
        let text = text.trim();
        if let Some(digits) = text.strip_prefix('#') {
            let bytes = (digits.len() == 6).then(|| u32::from_str_radix(digits, 16).ok()).flatten();
            let Some(bytes) = bytes.filter(|_| digits.bytes().all(|byte| byte.is_ascii_hexdigit())) else {
                return fail(place, format!("`{}` is no colour", shown(text)), "write for example #ff8000");
            };
            let channel = |shift: u32| decoded(f64::from(bytes >> shift & 0xff) / 255.0);
            return Ok(Self::Rgb(DVec3::new(channel(16), channel(8), channel(0))));
        }
        let values: Vec<f64> = tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
        let colour = match values[..] {
            [grey] => DVec3::splat(grey),
            [r, g, b] => DVec3::new(r, g, b),
            _ => {
                let message = format!("`{}` is no colour", shown(text));
                return fail(place, message, "write three numbers, for example `0.8, 0.5, 0.2`, or one");
            }
        };
        Ok(Self::Rgb(if is_encoded { colour.map(decoded) } else { colour }))
    }

    /// Parses one number, or a list of `wavelength:value`.
    pub(crate) fn parse(text: &str, place: &Place) -> Result<Self, Fault> {
        if !text.contains(':') {
            // The form of colours in old files.
            let values: Vec<f64> =
                tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
            return match values[..] {
                [value] => Ok(Self::Uniform(value)),
                [r, g, b] => Ok(Self::Rgb(DVec3::new(r, g, b))),
                _ => {
                    let message = format!("`{}` is no spectrum", shown(text));
                    fail(place, message, "write one number, or wavelengths and values: `400:0.3, 700:0.4`")
                }
            };
        }
        let mut samples = Vec::new();
        for token in tokens(text) {
            let Some((wavelength, value)) = token.split_once(':') else {
                let message = format!("`{}` is no wavelength with a value", shown(token));
                return fail(place, message, "write for example `400:0.3, 700:0.4`, in nanometres");
            };
            samples.push((number(wavelength, place)?, number(value, place)?));
        }
        Self::of_samples(samples, place)
    }

    /// Wavelengths (nm) and values; refuses wavelengths that do not rise.
    pub(crate) fn of_samples(samples: Vec<(f64, f64)>, place: &Place) -> Result<Self, Fault> {
        if samples.len() < 2 {
            return fail(
                place,
                "a spectrum of fewer than two wavelengths",
                "write one number alone, or more wavelengths",
            );
        }
        if samples.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return fail(place, "the wavelengths do not rise", "sort them");
        }
        Ok(Self::Samples(samples))
    }

    /// Radiance of a black body, W/(m^2 sr nm), times `scale`.
    pub(crate) fn blackbody(kelvin: f64, scale: f64, place: &Place) -> Result<Self, Fault> {
        if !(kelvin > 0.0 && kelvin <= 1e6) {
            return fail(
                place,
                format!("a temperature of {kelvin} K"),
                "write a number above 0, for example 6500",
            );
        }
        let radiance = |row: usize| {
            let wavelength = FIRST + STEP * row as f64;
            (wavelength, scale * planck(wavelength, kelvin))
        };
        Ok(Self::Samples((0..ROWS.len()).map(radiance).collect()))
    }

    /// The value at a wavelength, nm; that of green for a colour.
    pub(crate) fn at(&self, wavelength: f64) -> f64 {
        match self {
            Self::Rgb(colour) => colour.y,
            Self::Uniform(value) => *value,
            Self::Samples(samples) => {
                let next = samples.partition_point(|(at, _)| *at <= wavelength);
                match (next.checked_sub(1).and_then(|before| samples.get(before)), samples.get(next)) {
                    (Some(&(a, x)), Some(&(b, y))) => x + (y - x) * (wavelength - a) / (b - a),
                    (Some(&(a, x)), None) if a == wavelength => x,
                    _ => 0.0,
                }
            }
        }
    }

    /// Radiance of a black body where it is brightest (Wien's law), W/(m^2 sr nm).
    pub(crate) fn brightest_blackbody(kelvin: f64) -> f64 {
        planck(2.897_771_955e6 / kelvin, kelvin)
    }

    /// Numbers for the three channels, such as indices of refraction: means over the wavelengths of each, weighted by daylight, so
    /// that a constant is the same in all of them. At least zero.
    pub(crate) fn numbers(&self) -> DVec3 {
        match self {
            Self::Rgb(colour) => *colour,
            Self::Uniform(value) => DVec3::splat(*value),
            Self::Samples(_) => integrated(self, true),
        }
        .max(DVec3::ZERO)
    }

    /// The linear colour, at least zero; for reflectances also at most one.
    pub(crate) fn colour(&self, meaning: Meaning) -> DVec3 {
        let is_light = matches!(meaning, Meaning::Light { .. });
        let colour = match (self, meaning) {
            (Self::Rgb(colour), _) => *colour,
            (Self::Uniform(value), Meaning::Light { is_old: false }) => {
                *value * integrated(&Self::Uniform(1.0), false)
            }
            (Self::Uniform(value), _) => DVec3::splat(*value),
            (Self::Samples(_), _) => integrated(self, meaning == Meaning::Reflectance),
        };
        let most = if is_light || meaning == Meaning::Number { f64::MAX } else { 1.0 };
        colour.clamp(DVec3::ZERO, DVec3::splat(most))
    }
}

/// Samples of a spectrum between two rows of the tables.
const FINE: usize = 5;

/// Integral of a spectrum with the observer, normalized so that a constant spectrum of one has the luminance one. The spectrum is
/// weighted by daylight if `in_daylight`.
fn integrated(spectrum: &Spectrum, in_daylight: bool) -> DVec3 {
    let to_rgb = DMat3::from_cols(
        DVec3::new(3.240_479, -0.969_256, 0.055_648),
        DVec3::new(-1.537_150, 1.875_991, -0.204_043),
        DVec3::new(-0.498_535, 0.041_556, 1.057_311),
    );
    let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
    for (row, pair) in ROWS.windows(2).enumerate() {
        for part in 0..FINE {
            let t = (part as f64 + 0.5) / FINE as f64;
            let [x, y, z, d65] = std::array::from_fn(|i| pair[0][i] + t * (pair[1][i] - pair[0][i]));
            let light = if in_daylight { d65 } else { 1.0 };
            let wavelength = FIRST + STEP * (row as f64 + t);
            sum += DVec3::new(x, y, z) * (light * spectrum.at(wavelength));
            whole += y * light;
        }
    }
    to_rgb * (sum / whole)
}

/// Reads a file with a wavelength and a value in each line; `#` begins a comment.
pub(crate) fn spectrum_file(path: &Path, place: &Place) -> Result<Spectrum, Fault> {
    let unreadable = |why: &dyn std::fmt::Display| {
        let message = format!("{}: cannot be read: {why}", path.display());
        fail(place, message, "name a text of wavelengths and values, a pair in each line")
    };
    let bytes = match read_regular(path, MOST_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => return unreadable(&error),
    };
    let text = match text_of(&bytes) {
        Ok(text) => String::from_utf8_lossy(&text).into_owned(),
        Err(what) => return unreadable(&what),
    };
    let mut samples = Vec::new();
    for (line, text) in text.lines().enumerate() {
        let text = text.split('#').next().unwrap_or_default();
        let words: Vec<&str> = tokens(text).collect();
        let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
        match (words.len(), &numbers[..]) {
            (0, _) => {}
            (2, &[wavelength, value]) if wavelength.is_finite() && value.is_finite() => {
                samples.push((wavelength, value));
            }
            _ => {
                let message =
                    format!("{}:{}: `{}` is no pair of numbers", path.display(), line + 1, shown(text));
                return fail(place, message, "write a wavelength in nanometres and a value");
            }
        }
    }
    Spectrum::of_samples(samples, place)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn colour(text: &str, meaning: Meaning) -> DVec3 {
        Spectrum::parse(text, &Place::default()).unwrap().colour(meaning)
    }

    #[test]
    fn what_reflects_all_wavelengths_alike_is_grey() {
        let grey = colour("300:0.5, 900:0.5", Meaning::Reflectance);
        assert!((grey - DVec3::splat(0.5)).abs().max_element() < 2e-3, "{grey}");
        assert_eq!(colour("0.5", Meaning::Reflectance), DVec3::splat(0.5));
    }

    /// The equal-energy spectrum has the Rec. 709 colour that other renderers give it.
    #[test]
    fn light_of_equal_energy_is_warm() {
        let light = Meaning::Light { is_old: false };
        for text in ["2", "300:2, 900:2"] {
            let warm = colour(text, light);
            assert!((warm - 2.0 * DVec3::new(1.2048, 0.9483, 0.9087)).abs().max_element() < 4e-3, "{warm}");
        }
        assert_eq!(colour("2", Meaning::Light { is_old: true }), DVec3::splat(2.0));
    }

    /// Y is the integral of radiance with the observer, divided by that of the observer alone, 106.86 nm.
    #[test]
    fn a_black_body_has_the_luminance_of_plancks_law() {
        let spectrum = Spectrum::blackbody(5000.0, 1.0, &Place::default()).unwrap();
        let rgb = spectrum.colour(Meaning::Light { is_old: false });
        let y = DVec3::new(0.212_671, 0.715_160, 0.072_169).dot(rgb);
        // 5000 K near 555 nm: 12.7 W/(m^2 sr nm).
        assert!((y / planck(560.0, 5000.0) - 1.0).abs() < 0.03, "{y} {}", planck(560.0, 5000.0));
        assert!(rgb.x > rgb.y && rgb.y > rgb.z, "{rgb}");
    }

    #[test]
    fn colours_in_hexadecimal_are_encoded() {
        let place = Place::default();
        let Spectrum::Rgb(colour) = Spectrum::rgb("#ff8000", false, &place).unwrap() else { panic!() };
        assert!((colour - DVec3::new(1.0, 0.2159, 0.0)).abs().max_element() < 1e-4, "{colour}");
        for bad in ["#ff80", "#+f8000", "#ff80zz", "1 2", ""] {
            assert!(Spectrum::rgb(bad, false, &place).is_err(), "{bad}");
        }
    }
}
