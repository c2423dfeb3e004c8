//! Media by name: measured ones, and fogs by how far one sees in them.

use super::{CoefficientError, Coefficients, Phase};
use crate::math::Rgb;

/// A medium that is known by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamedMedium {
    /// Name, in lower case, with hyphens.
    pub name: &'static str,
    what: What,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// Reduced scattering and absorption coefficients per millimetre, and index of refraction.
    Measured { scattering: [f32; 3], absorption: [f32; 3], ior: f32 },
    /// Visibility in metres and mean cosine of the phase function.
    Fog { visibility: f32, mean_cosine: f32 },
}

const fn measured(name: &'static str, scattering: [f32; 3], absorption: [f32; 3], ior: f32) -> NamedMedium {
    NamedMedium { name, what: What::Measured { scattering, absorption, ior } }
}

const fn fog(name: &'static str, visibility: f32, mean_cosine: f32) -> NamedMedium {
    NamedMedium { name, what: What::Fog { visibility, mean_cosine } }
}

/// All media with names.
///
/// The measured ones are those of Jensen, Marschner, Levoy & Hanrahan, "A Practical Model for Subsurface Light Transport" (SIGGRAPH
/// 2001), table 1. What is measured there is the *reduced* scattering coefficient, `scattering (1 - mean cosine)`, and so these media
/// scatter isotropically: over many scatterings they look like the real ones, over few (thin layers, edges) they do not.
///
/// Fogs have the visibilities at which the names of the international visibility code (as in McCartney, "Optics of the Atmosphere",
/// 1976) end, absorb nothing, and scatter forwards by one lobe of Henyey & Greenstein: with a mean cosine of 0.85 for droplets, much
/// larger than a wavelength, and 0.7 for the smaller particles of haze. Those two numbers are usual values and no measurement.
pub const NAMED_MEDIA: [NamedMedium; 18] = [
    measured("apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046], 1.3),
    measured("chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19], 1.3),
    measured("chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20], 1.3),
    measured("cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], 1.3),
    measured("ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45], 1.3),
    measured("marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5),
    measured("potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12], 1.3),
    measured("skim-milk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142], 1.3),
    measured("skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3),
    measured("skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145], 1.3),
    measured("spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0], 1.3),
    measured("whole-milk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], 1.3),
    fog("dense-fog", 50.0, 0.85),
    fog("thick-fog", 200.0, 0.85),
    fog("fog", 500.0, 0.85),
    fog("light-fog", 1000.0, 0.85),
    fog("mist", 2000.0, 0.85),
    fog("haze", 4000.0, 0.7),
];

impl NamedMedium {
    /// The medium called `name`.
    pub fn find(name: &str) -> Option<&'static Self> {
        NAMED_MEDIA.iter().find(|medium| medium.name == name)
    }

    /// Its coefficients, per metre.
    ///
    /// # Errors
    /// None for the media of [`NAMED_MEDIA`].
    pub fn coefficients(&self) -> Result<Coefficients, CoefficientError> {
        match self.what {
            What::Measured { scattering, absorption, .. } => {
                const PER_METRE: f32 = 1000.0;
                Coefficients::new(
                    Rgb::from_array(absorption) * PER_METRE,
                    Rgb::from_array(scattering) * PER_METRE,
                )
            }
            What::Fog { visibility, .. } => Coefficients::from_visibility(visibility),
        }
    }

    /// Its phase function.
    pub fn phase(&self) -> Phase {
        match self.what {
            What::Measured { .. } => Phase::Isotropic,
            What::Fog { mean_cosine, .. } => Phase::henyey_greenstein(mean_cosine).unwrap_or_default(),
        }
    }

    /// Its index of refraction: that of air for fogs, which are droplets within it.
    pub fn ior(&self) -> f32 {
        match self.what {
            What::Measured { ior, .. } => ior,
            What::Fog { .. } => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Diffuse reflectance of a half-space by the dipole (Jensen et al. 2001, equation 15 with the boundary term of section 2).
    fn dipole(scattering: f64, absorption: f64, ior: f64) -> f64 {
        let albedo = scattering / (scattering + absorption);
        let fresnel = -1.440 / (ior * ior) + 0.710 / ior + 0.668 + 0.0636 * ior;
        let a = (1.0 + fresnel) / (1.0 - fresnel);
        let root = (3.0 * (1.0 - albedo)).sqrt();
        0.5 * albedo * (1.0 + (-4.0 / 3.0 * a * root).exp()) * (-root).exp()
    }

    /// The same table prints the diffuse reflectance of each medium.
    #[test]
    fn measured_media_have_the_printed_reflectance() {
        let printed = [
            ("apple", [0.85, 0.84, 0.53]),
            ("chicken1", [0.31, 0.15, 0.10]),
            ("chicken2", [0.32, 0.16, 0.10]),
            ("cream", [0.98, 0.90, 0.73]),
            ("ketchup", [0.16, 0.01, 0.00]),
            ("marble", [0.83, 0.79, 0.75]),
            ("potato", [0.77, 0.62, 0.21]),
            ("skim-milk", [0.81, 0.81, 0.69]),
            ("skin1", [0.44, 0.22, 0.13]),
            ("skin2", [0.63, 0.44, 0.34]),
            ("spectralon", [1.00, 1.00, 1.00]),
            ("whole-milk", [0.91, 0.88, 0.76]),
        ];
        for (name, reflectance) in printed {
            let medium = NamedMedium::find(name).unwrap();
            let coefficients = medium.coefficients().unwrap();
            let (s, a) = (coefficients.scattering().to_array(), coefficients.absorption().to_array());
            for channel in 0..3 {
                let found = dipole(f64::from(s[channel]), f64::from(a[channel]), f64::from(medium.ior()));
                // Two digits of the coefficients; one row is farther off, in all copies of the table.
                let allowed = if (name, channel) == ("chicken1", 2) { 0.03 } else { 0.011 };
                assert!((found - reflectance[channel]).abs() < allowed, "{name} {channel}: {found}");
            }
        }
    }

    #[test]
    fn every_name_is_found_once_and_is_sound() {
        for medium in &NAMED_MEDIA {
            assert_eq!(NAMED_MEDIA.iter().filter(|other| other.name == medium.name).count(), 1);
            assert_eq!(NamedMedium::find(medium.name), Some(medium));
            let coefficients = medium.coefficients().unwrap();
            assert!(coefficients.extinction().min_element() > 0.0 && medium.ior() >= 1.0);
            assert!(medium.phase().mean_cosine() >= 0.0);
        }
        assert!(NamedMedium::find("ether").is_none());
        let marble = NamedMedium::find("marble").unwrap().coefficients().unwrap();
        assert!((marble.scattering().x - 2190.0).abs() < 1e-3 && (marble.absorption().z - 7.1).abs() < 1e-5);
        let fog = NamedMedium::find("thick-fog").unwrap();
        assert!((fog.coefficients().unwrap().extinction().y - 3.912_023 / 200.0).abs() < 1e-8);
        assert!((fog.phase().mean_cosine() - 0.85).abs() < 1e-6);
    }
}
