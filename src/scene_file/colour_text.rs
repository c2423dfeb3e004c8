//! Colours that a scene file writes as text: sRGB as pictures and web pages have it, and black bodies.

use crate::spectra::cie::black_body;
use crate::textures::srgb_to_linear;
use glam::DVec3;

/// Temperatures, K, whose colours are accepted: from an ember to a blue star.
const KELVIN: std::ops::RangeInclusive<f64> = 800.0..=40_000.0;

/// Why a text is no colour: what was expected, and an example.
pub(super) struct NoColour {
    pub(super) expected: &'static str,
    pub(super) example: &'static str,
}

/// Luminance of a linear Rec. 709 colour, in units of 683 lm for each watt.
pub(super) fn luminance(colour: DVec3) -> f64 {
    colour.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// The linear Rec. 709 colour of `#rrggbb`, `srgb(r, g, b)` with numbers from 0 to 1, or a black body such as `2700 K`, whose largest
/// component is 1.
pub(super) fn colour_of(text: &str) -> Result<DVec3, NoColour> {
    let text = text.trim();
    if let Some(digits) = text.strip_prefix('#') {
        return hexadecimal(digits)
            .ok_or(NoColour { expected: "six hexadecimal digits after #", example: "\"#ff8000\"" });
    }
    if let Some(inner) = text.strip_prefix("srgb(").and_then(|rest| rest.strip_suffix(')')) {
        return components(inner).ok_or(NoColour {
            expected: "three numbers from 0 to 1 in srgb(...)",
            example: "\"srgb(1.0, 0.5, 0.0)\"",
        });
    }
    if let Some(number) = text.strip_suffix(['K', 'k']) {
        let kelvin = number.trim_end().parse().ok().filter(|kelvin| KELVIN.contains(kelvin));
        return kelvin
            .map(of_black_body)
            .ok_or(NoColour { expected: "a temperature from 800 K to 40000 K", example: "\"2700 K\"" });
    }
    Err(NoColour {
        expected: "a number, a list [red, green, blue], or a text such as \"#ff8000\", \"srgb(1.0, 0.5, 0.0)\" or \"2700 K\"",
        example: "[0.8, 0.5, 0.2]",
    })
}

fn decoded(value: f64) -> f64 {
    f64::from(srgb_to_linear(value as f32))
}

fn hexadecimal(digits: &str) -> Option<DVec3> {
    if digits.len() != 6 || !digits.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let bytes = u32::from_str_radix(digits, 16).ok()?;
    let channel = |shift: u32| decoded(f64::from(bytes >> shift & 0xff) / 255.0);
    Some(DVec3::new(channel(16), channel(8), channel(0)))
}

fn components(text: &str) -> Option<DVec3> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|number| number.trim().parse().ok().filter(|value| (0.0..=1.0).contains(value)))
        .collect::<Option<_>>()?;
    let [r, g, b] = numbers[..] else { return None };
    Some(DVec3::new(r, g, b).map(decoded))
}

fn of_black_body(kelvin: f64) -> DVec3 {
    let colour = black_body(kelvin);
    colour / colour.max_element()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn colour(text: &str) -> DVec3 {
        colour_of(text).unwrap_or_else(|wrong| panic!("{text}: {}", wrong.expected))
    }

    #[test]
    fn pictures_and_web_pages() {
        assert_eq!(colour("#ffffff"), DVec3::ONE);
        assert_eq!(colour("#000000"), DVec3::ZERO);
        // The definition of sRGB: 0x80 is ((128 / 255 + 0.055) / 1.055)^2.4.
        let half = ((128.0 / 255.0 + 0.055) / 1.055f64).powf(2.4);
        assert!((colour("#FF8000") - DVec3::new(1.0, half, 0.0)).length() < 1e-6);
        assert!((colour("srgb(1, 0.5,0.04)") - DVec3::new(1.0, 0.214_041, 0.04 / 12.92)).length() < 1e-6);
    }

    /// Chromaticities of black bodies after Wyszecki & Stiles (1982), table 1(3.11).
    #[test]
    fn black_bodies() {
        let to_xyz = glam::DMat3::from_cols(
            DVec3::new(0.412_391, 0.212_639, 0.019_331),
            DVec3::new(0.357_584, 0.715_169, 0.119_195),
            DVec3::new(0.180_481, 0.072_192, 0.950_532),
        );
        for (text, x, y) in [
            ("2000 K", 0.526_7, 0.413_3),
            ("3000K", 0.436_9, 0.404_1),
            ("5000 K", 0.345_1, 0.351_6),
            ("6500 K", 0.313_5, 0.323_7),
            ("10000 k", 0.280_7, 0.288_4),
        ] {
            let found = colour(text);
            assert!((found.max_element() - 1.0).abs() < 1e-12, "{text}: {found}");
            let xyz = to_xyz * found;
            let sum = xyz.x + xyz.y + xyz.z;
            assert!(
                (xyz.x / sum - x).abs() < 1e-3 && (xyz.y / sum - y).abs() < 1e-3,
                "{text}: {}",
                xyz / sum
            );
        }
    }

    #[test]
    fn what_is_no_colour() {
        for text in [
            "#12345",
            "#1234567",
            "#+12345",
            "#gggggg",
            "#",
            "srgb(1,2,3)",
            "srgb(1,1)",
            "srgb(1,1,1",
            "srgb(nan,0,0)",
            "700 K",
            "K",
            "1e9 K",
            "NaN K",
            "-3000 K",
            "red",
            "",
            "rgb(1,1,1)",
            "#äöü",
        ] {
            assert!(colour_of(text).is_err(), "{text}");
        }
    }
}
