//! Colours and spectra of parameters.

use super::Importer;
use super::error::{Fault, Place, fail};
use super::indices;
use super::object::{Object, Parameter, Values};
use super::paint::luminance;
use super::spectrum::{Meaning, Spectrum, spectrum_file};
use super::text::shown;
use crate::bsdf::Metal;
use crate::scene_file::diagnostic::suggestion;
use glam::{DMat3, DVec3};

/// Chromaticities of red, green, blue and white of the colour spaces that pbrt names.
const SPACES: [(&str, [[f64; 2]; 4]); 4] = [
    ("srgb", REC709),
    ("dci-p3", [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06], [0.312_72, 0.329_03]]),
    ("rec2020", [[0.708, 0.292], [0.17, 0.797], [0.131, 0.046], [0.312_72, 0.329_03]]),
    ("aces2065-1", [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.321_68, 0.337_67]]),
];

const REC709: [[f64; 2]; 4] = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.312_72, 0.329_03]];

/// Chromaticities of illuminants (CIE 15, 2-degree observer; ACES D60 of SMPTE ST 2065-1).
const ILLUMINANTS: [(&str, [f64; 2]); 16] = [
    ("stdillum-A", [0.447_57, 0.407_45]),
    ("stdillum-D50", [0.345_67, 0.358_50]),
    ("stdillum-D65", [0.312_72, 0.329_03]),
    ("stdillum-F1", [0.313_10, 0.337_27]),
    ("stdillum-F2", [0.372_08, 0.375_29]),
    ("stdillum-F3", [0.409_10, 0.394_30]),
    ("stdillum-F4", [0.440_18, 0.403_29]),
    ("stdillum-F5", [0.313_79, 0.345_31]),
    ("stdillum-F6", [0.377_90, 0.388_35]),
    ("stdillum-F7", [0.312_92, 0.329_33]),
    ("stdillum-F8", [0.345_88, 0.358_75]),
    ("stdillum-F9", [0.374_17, 0.372_81]),
    ("stdillum-F10", [0.346_09, 0.359_86]),
    ("stdillum-F11", [0.380_52, 0.377_13]),
    ("stdillum-F12", [0.436_95, 0.404_41]),
    ("illum-acesD60", [0.321_68, 0.337_67]),
];

/// Indices of glasses at 587.6 nm (catalogue of Schott).
const GLASSES: [(&str, f64); 7] = [
    ("glass-BK7", 1.516_80),
    ("glass-BAF10", 1.670_03),
    ("glass-FK51A", 1.486_56),
    ("glass-LASF9", 1.850_25),
    ("glass-SF5", 1.672_71),
    ("glass-SF10", 1.728_28),
    ("glass-SF11", 1.784_72),
];

/// What pbrt counts among the metals and is not among [`indices::symbols`]: `eta` and `k` at 630, 532 and 465 nm: brass of Querry
/// 1985 (refractiveindex.info), magnesium oxide of Stephens & Malitson 1952, rutile of Devore 1951.
const OTHERS: [(&str, [f64; 3], [f64; 3]); 3] = [
    ("CuZn", [0.444, 0.527, 1.094], [3.695, 2.765, 1.829]),
    ("MgO", [1.7350, 1.7405, 1.7460], [0.0; 3]),
    ("TiO2", [2.5853, 2.6678, 2.7765], [0.0; 3]),
];

/// XYZ of a chromaticity with luminance one.
fn xyz([x, y]: [f64; 2]) -> DVec3 {
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// From linear colours with these primaries to XYZ.
fn to_xyz([red, green, blue, white]: [[f64; 2]; 4]) -> DMat3 {
    // Blue of ACES has a negative luminance: columns are not divided by it.
    let column = |[x, y]: [f64; 2]| DVec3::new(x, y, 1.0 - x - y);
    let primaries = DMat3::from_cols(column(red), column(green), column(blue));
    let scales = primaries.inverse() * xyz(white);
    primaries * DMat3::from_diagonal(scales)
}

/// The matrix from a named colour space to linear Rec. 709; `None` for that itself.
pub(super) fn space_named(name: &str, place: &Place) -> Result<Option<DMat3>, Fault> {
    let Some((known, primaries)) = SPACES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)) else {
        let names = SPACES.map(|(known, _)| known);
        return fail(place, format!("`{}` is no colour space", shown(name)), suggestion(name, &names));
    };
    Ok((*known != "srgb").then(|| to_xyz(REC709).inverse() * to_xyz(*primaries)))
}

/// The colour of light with this chromaticity and the luminance one.
fn light_of([x, y]: [f64; 2]) -> DVec3 {
    to_xyz(REC709).inverse() * xyz([x, y])
}

/// A name such as `metal-Cu-eta` in its parts: the metal, and whether `k` is meant.
fn metal_part(name: &str) -> Option<(&str, bool)> {
    let rest = name.strip_prefix("metal-")?;
    let (metal, part) = rest.rsplit_once('-')?;
    match part {
        "eta" => Some((metal, false)),
        "k" => Some((metal, true)),
        _ => None,
    }
}

/// `eta` and `k` of a metal by the name that pbrt gives it.
fn eta_and_k(metal: &str) -> Option<[DVec3; 2]> {
    if let Some((_, eta, k)) = OTHERS.iter().find(|(known, ..)| *known == metal) {
        return Some([DVec3::from_array(*eta), DVec3::from_array(*k)]);
    }
    match indices::metal(metal)? {
        Metal::Index { eta, k } => Some([eta.as_dvec3(), k.as_dvec3()]),
        Metal::Colour(_) => None,
    }
}

impl Importer<'_> {
    /// The spectrum of a parameter that holds one by itself: not a texture.
    pub(super) fn spectrum(&mut self, parameter: &Parameter) -> Result<Spectrum, Fault> {
        let place = &parameter.place;
        match (parameter.kind, &parameter.values) {
            ("rgb" | "color", Values::Numbers(numbers)) => match numbers[..] {
                [r, g, b] => {
                    let colour = DVec3::new(r, g, b);
                    let colour = parameter.space.map_or(colour, |space| space * colour);
                    Ok(Spectrum::Rgb(colour))
                }
                _ => parameter.wrong("a colour", "\"rgb NAME\" [ 0.5 0.5 0.5 ]"),
            },
            ("xyz", Values::Numbers(numbers)) => match numbers[..] {
                [x, y, z] => Ok(Spectrum::Rgb(to_xyz(REC709).inverse() * DVec3::new(x, y, z))),
                _ => parameter.wrong("a colour", "\"rgb NAME\" [ 0.5 0.5 0.5 ]"),
            },
            ("blackbody", Values::Numbers(numbers)) => match numbers[..] {
                [kelvin] => Spectrum::blackbody(kelvin, 1.0, place),
                // As in pbrt-v3.
                [kelvin, scale] => {
                    self.is_old = true;
                    Spectrum::blackbody(kelvin, scale, place)
                }
                _ => parameter.wrong("a temperature", "\"blackbody NAME\" 6500"),
            },
            ("spectrum", Values::Numbers(numbers)) => match numbers[..] {
                [value] => Ok(Spectrum::Uniform(value)),
                _ if numbers.len() % 2 == 0 => {
                    let samples = numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
                    Spectrum::of_samples(samples, place)
                }
                _ => {
                    parameter.wrong("wavelengths with their values", "\"spectrum NAME\" [ 400 0.3 700 0.4 ]")
                }
            },
            ("spectrum", Values::Texts(_)) => match parameter.text() {
                Some(name) => self.named_spectrum(name, place),
                None => parameter.wrong("the name of a spectrum", "\"spectrum NAME\" \"metal-Cu-eta\""),
            },
            _ => parameter.wrong("a colour or spectrum", "\"rgb NAME\" [ 0.5 0.5 0.5 ]"),
        }
    }

    fn named_spectrum(&mut self, name: &str, place: &Place) -> Result<Spectrum, Fault> {
        if let Some((_, chromaticity)) = ILLUMINANTS.iter().find(|(known, _)| *known == name) {
            return Ok(Spectrum::Rgb(light_of(*chromaticity)));
        }
        if let Some((_, index)) = GLASSES.iter().find(|(known, _)| *known == name) {
            return Ok(Spectrum::Uniform(*index));
        }
        if let Some((metal, is_k)) = metal_part(name) {
            return match eta_and_k(metal) {
                Some([eta, k]) => Ok(Spectrum::Rgb(if is_k { k } else { eta })),
                None => fail(
                    place,
                    format!("the indices of the metal `{}` are not known", shown(metal)),
                    "write them as \"rgb eta\" [ ... ] and \"rgb k\" [ ... ]",
                ),
            };
        }
        let names = || {
            let others = ILLUMINANTS.iter().map(|(name, _)| *name);
            let names: Vec<&str> = GLASSES.iter().map(|(name, _)| *name).chain(others).collect();
            names
        };
        if name.starts_with("glass-") || name.starts_with("stdillum-") || name.starts_with("illum-") {
            let message = format!("the spectrum `{}` is not known", shown(name));
            return fail(place, message, suggestion(name, &names()));
        }
        let path = self.file(name, place)?;
        spectrum_file(&path, place)
    }

    /// The colour of a parameter that is not a texture.
    fn colour_of(&mut self, parameter: &Parameter, meaning: Meaning) -> Result<DVec3, Fault> {
        let spectrum = self.spectrum(parameter)?;
        Ok(match (meaning, &spectrum) {
            (Meaning::Number, _) => spectrum.numbers(),
            _ => spectrum.colour(meaning),
        })
    }

    /// Reads a colour that is not a texture.
    pub(super) fn colour(
        &mut self,
        object: &Object,
        name: &str,
        usual: DVec3,
        meaning: Meaning,
    ) -> Result<DVec3, Fault> {
        match object.get(name) {
            Some(parameter) if parameter.kind == "texture" => {
                let parameter = std::rc::Rc::clone(parameter);
                let paint = self.texture_of(&parameter, false)?;
                if paint.plain().is_none() {
                    self.report.note(object, format!("`{name}` does not vary here: its mean counts"));
                }
                Ok(paint.mean())
            }
            Some(parameter) => {
                let parameter = std::rc::Rc::clone(parameter);
                let colour = self.colour_of(&parameter, meaning)?;
                if meaning == Meaning::Reflectance
                    && parameter.numbers().iter().any(|x| !(0.0..=1.0).contains(x))
                    && matches!(parameter.kind, "rgb" | "color")
                {
                    self.report
                        .note(object, format!("`{name}` is clamped to what reflects no more than it gets"));
                }
                Ok(colour)
            }
            None => Ok(usual),
        }
    }

    /// Reads the colour of a light. In pbrt-v4 it is that of an `rgb` parameter, and otherwise has the luminance one, whatever the
    /// size of its values.
    pub(super) fn light_colour(&mut self, object: &Object, name: &str) -> Result<DVec3, Fault> {
        let Some(parameter) = object.get(name) else { return Ok(DVec3::ONE) };
        let parameter = std::rc::Rc::clone(parameter);
        let spectrum = self.spectrum(&parameter)?;
        let is_sized = matches!(parameter.kind, "rgb" | "color" | "xyz");
        let colour = match spectrum {
            // As a light, equal energy at all wavelengths is not white.
            Spectrum::Uniform(_) if self.is_old => spectrum.colour(Meaning::Light { is_old: true }),
            _ => spectrum.colour(Meaning::Light { is_old: false }),
        };
        if is_sized {
            return Ok(colour);
        }
        if self.is_old {
            // Black bodies of pbrt-v3 have the value one where they are brightest.
            let brightest = match (parameter.kind, parameter.numbers().first()) {
                ("blackbody", Some(&kelvin)) => Spectrum::brightest_blackbody(kelvin),
                _ => 1.0,
            };
            return Ok(if brightest > 0.0 { colour / brightest } else { DVec3::ZERO });
        }
        let whole = luminance(colour);
        if whole > 0.0 {
            return Ok(colour / whole);
        }
        self.report.note(object, format!("`{name}` gives no light"));
        Ok(DVec3::ZERO)
    }

    /// Reads an index of refraction.
    pub(super) fn index(&mut self, object: &Object, names: &[&str], usual: f64) -> Result<f64, Fault> {
        let Some(parameter) = names.iter().find_map(|name| object.get(name)) else { return Ok(usual) };
        let parameter = std::rc::Rc::clone(parameter);
        let index = match parameter.kind {
            "float" | "integer" => object.float_or(&parameter.name, usual)?,
            "texture" => {
                let paint = self.texture_of(&parameter, true)?;
                self.report.note(object, "the index of refraction does not vary here: its mean counts");
                luminance(paint.mean())
            }
            _ => {
                let spectrum = self.spectrum(&parameter)?;
                if !matches!(spectrum, Spectrum::Uniform(_)) || parameter.text().is_some() {
                    self.report.note(object, "its index of refraction is that at 589 nm for all wavelengths");
                }
                spectrum.at(589.0)
            }
        };
        if !(0.1..=10.0).contains(&index) {
            let message = format!("an index of refraction of {index}");
            return fail(&parameter.place, message, "write a number from 0.1 to 10, for example 1.5");
        }
        Ok(index)
    }

    /// The indices of a metal. Both by the same name are those that its reflectance was fitted to.
    pub(super) fn metal(&mut self, object: &Object, [eta, k]: [&str; 2]) -> Result<[DVec3; 2], Fault> {
        let copper = eta_and_k("Cu").unwrap_or([DVec3::ONE; 2]);
        let eta = self.colour(object, eta, copper[0], Meaning::Number)?;
        let k = self.colour(object, k, copper[1], Meaning::Number)?;
        Ok([eta, k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_white(colour: DVec3) -> bool {
        (colour.x / colour.y - 1.0).abs().max((colour.z / colour.y - 1.0).abs()) < 2e-3
    }

    #[test]
    fn white_is_white_in_every_space() {
        for (name, _) in SPACES {
            let matrix = space_named(name, &Place::default()).unwrap().unwrap_or(DMat3::IDENTITY);
            let white = matrix * DVec3::ONE;
            assert!((luminance(white) - 1.0).abs() < 1e-3, "{name} {white}");
            assert!(is_white(white) || name == "aces2065-1", "{name} {white}");
        }
        // Green of Rec. 2020 is outside of Rec. 709.
        let green = space_named("rec2020", &Place::default()).unwrap().unwrap() * DVec3::Y;
        assert!(green.x < -0.5 && green.y > 1.1, "{green}");
        assert!(space_named("rec601", &Place::default()).is_err());
    }

    #[test]
    fn illuminants_are_white_or_warm() {
        assert!(is_white(light_of(ILLUMINANTS[2].1)));
        let warm = light_of(ILLUMINANTS[0].1);
        assert!(warm.x > 1.5 && warm.z < 0.4 && (luminance(warm) - 1.0).abs() < 1e-3, "{warm}");
    }

    #[test]
    fn metals_have_both_parts() {
        assert_eq!(metal_part("metal-TiO2-eta"), Some(("TiO2", false)));
        assert_eq!(metal_part("metal-Ag-k"), Some(("Ag", true)));
        assert!(metal_part("metal-Ag").is_none() && metal_part("glass-BK7").is_none());
        for name in ["Ag", "Al", "Au", "Cu", "CuZn", "MgO", "TiO2"] {
            assert!(eta_and_k(name).is_some(), "{name}");
        }
    }
}
