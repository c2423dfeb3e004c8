//! How much a medium absorbs, scatters and emits.
//!
//! All coefficients are per metre of path, one for each channel of linear Rec. 709, and are those where the density of the medium is
//! one; they grow with it. [`Coefficients::per_length`] turns them into those of another unit of length.

use crate::math::Rgb;

/// Contrast by which Koschmieder's law defines the visibility: an object that keeps a fiftieth of it is lost.
const LEAST_CONTRAST: f64 = 0.02;

/// Coefficients of a medium where its density is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    absorption: Rgb,
    scattering: Rgb,
    emission: Rgb,
}

/// Why coefficients cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CoefficientError {
    /// A coefficient is negative, infinite or not a number.
    #[error("the {what} of a medium is {value}: each channel must be a finite number and not negative")]
    OutOfRange {
        /// Which one.
        what: &'static str,
        /// What was given.
        value: Rgb,
    },
    /// An albedo is not in [0, 1].
    #[error(
        "the albedo of a medium is {0}: each channel must be from 0 (absorbs all) to 1 (absorbs nothing)"
    )]
    Albedo(Rgb),
    /// A mean free path is not positive.
    #[error("the mean free path of a medium is {0}: each channel must be a positive, finite length")]
    MeanFreePath(Rgb),
    /// A visibility is not positive.
    #[error("the visibility in a fog is {0}: it must be a positive, finite length")]
    Visibility(f32),
    /// A coefficient is too large or too small for its type.
    #[error(
        "the extinction of a medium comes to {0}, which is out of range: use another unit of length or a longer free path"
    )]
    Overflow(Rgb),
}

impl Coefficients {
    /// Neither absorbs, nor scatters, nor emits.
    pub const CLEAR: Self = Self { absorption: Rgb::ZERO, scattering: Rgb::ZERO, emission: Rgb::ZERO };

    /// Of absorption and scattering coefficients, per metre.
    ///
    /// # Errors
    /// Where a channel is negative or not finite, or their sum is not.
    pub fn new(absorption: Rgb, scattering: Rgb) -> Result<Self, CoefficientError> {
        check("absorption coefficient", absorption)?;
        check("scattering coefficient", scattering)?;
        let extinction = absorption + scattering;
        if !extinction.is_finite() {
            return Err(CoefficientError::Overflow(extinction));
        }
        Ok(Self { absorption, scattering, emission: Rgb::ZERO })
    }

    /// Of the single-scattering albedo (scattering over extinction) and the mean free path (one over extinction, in metres).
    ///
    /// # Errors
    /// Where an albedo is not in [0, 1], or a mean free path not positive and finite, or so short that its inverse is not finite.
    pub fn from_albedo(albedo: Rgb, mean_free_path: Rgb) -> Result<Self, CoefficientError> {
        if !albedo.to_array().iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(CoefficientError::Albedo(albedo));
        }
        if !mean_free_path.to_array().iter().all(|&l| l > 0.0 && l.is_finite()) {
            return Err(CoefficientError::MeanFreePath(mean_free_path));
        }
        let extinction = mean_free_path.recip();
        if !extinction.is_finite() {
            return Err(CoefficientError::Overflow(extinction));
        }
        Self::new((Rgb::ONE - albedo) * extinction, albedo * extinction)
    }

    /// Of fog that absorbs nothing and in which one sees as far as `visibility`, in metres: `-ln(0.02) / visibility`, or 3.912 over it
    /// (Koschmieder, "Theorie der horizontalen Sichtweite", 1924; the contrast of a black object against the horizon is then a fiftieth).
    ///
    /// # Errors
    /// Where the visibility is not positive and finite, or too short.
    pub fn from_visibility(visibility: f32) -> Result<Self, CoefficientError> {
        if !(visibility > 0.0 && visibility.is_finite()) {
            return Err(CoefficientError::Visibility(visibility));
        }
        let extinction = Rgb::splat((-LEAST_CONTRAST.ln() / f64::from(visibility)) as f32);
        if !extinction.is_finite() {
            return Err(CoefficientError::Overflow(extinction));
        }
        Self::new(Rgb::ZERO, extinction)
    }

    /// The same with `emission`: radiance that each metre adds to a ray, W/(m^3 sr), where the density is one.
    ///
    /// # Errors
    /// Where a channel is negative or not finite.
    pub fn with_emission(self, emission: Rgb) -> Result<Self, CoefficientError> {
        check("emission", emission)?;
        Ok(Self { emission, ..self })
    }

    /// The same with the emission of a body whose absorbing particles glow with `radiance`, W/(m^2 sr): absorption times radiance
    /// (Kirchhoff). A thick body that does not scatter then shows just that radiance.
    ///
    /// # Errors
    /// Where a channel of the radiance or of its product with the absorption is negative or not finite.
    pub fn with_source(self, radiance: Rgb) -> Result<Self, CoefficientError> {
        check("emitted radiance", radiance)?;
        self.with_emission(self.absorption * radiance)
    }

    /// Absorption coefficient: share of the light that is absorbed per metre.
    pub fn absorption(&self) -> Rgb {
        self.absorption
    }

    /// Scattering coefficient: share of the light that is scattered per metre.
    pub fn scattering(&self) -> Rgb {
        self.scattering
    }

    /// Radiance that each metre adds, W/(m^3 sr).
    pub fn emission(&self) -> Rgb {
        self.emission
    }

    /// Absorption plus scattering.
    pub fn extinction(&self) -> Rgb {
        self.absorption + self.scattering
    }

    /// Share of the extinction that is scattering; zero in channels where nothing is lost.
    pub fn albedo(&self) -> Rgb {
        let extinction = self.extinction();
        let share = |s: f32, t: f32| if t > 0.0 { (s / t).min(1.0) } else { 0.0 };
        Rgb::new(
            share(self.scattering.x, extinction.x),
            share(self.scattering.y, extinction.y),
            share(self.scattering.z, extinction.z),
        )
    }

    /// True where nothing is absorbed, scattered or emitted.
    pub fn is_clear(&self) -> bool {
        *self == Self::CLEAR
    }

    /// Coefficients per `metres` of path: those of render space where one of its units is so long. Also those where the density is
    /// `metres` times as high.
    ///
    /// # Errors
    /// Where a product is not finite or `metres` is negative or not a number.
    pub fn per_length(self, metres: f32) -> Result<Self, CoefficientError> {
        Self::new(self.absorption * metres, self.scattering * metres)?.with_emission(self.emission * metres)
    }

    /// With the scattering of a medium whose phase function is isotropic and that spreads light alike over many scatterings:
    /// scattering times `1 - mean_cosine` (similarity; van de Hulst, "Multiple Light Scattering", 1980, section 14.1). An approximation,
    /// and a good one only far from sources and borders.
    #[must_use]
    pub fn reduced(self, mean_cosine: f32) -> Self {
        Self { scattering: self.scattering * (1.0 - mean_cosine).clamp(0.0, 2.0), ..self }
    }
}

fn check(what: &'static str, value: Rgb) -> Result<(), CoefficientError> {
    if value.to_array().iter().all(|&v| v >= 0.0 && v.is_finite()) {
        Ok(())
    } else {
        Err(CoefficientError::OutOfRange { what, value })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_to_give_the_same() {
        let absorption = Rgb::new(0.5, 0.0, 2.0);
        let scattering = Rgb::new(1.5, 4.0, 0.0);
        let a = Coefficients::new(absorption, scattering).unwrap();
        assert_eq!(a.albedo(), Rgb::new(0.75, 1.0, 0.0));
        let b = Coefficients::from_albedo(a.albedo(), a.extinction().recip()).unwrap();
        assert!((a.absorption() - b.absorption()).abs().max_element() < 1e-6);
        assert!((a.scattering() - b.scattering()).abs().max_element() < 1e-6);
        // At the distance that is called visibility, 2 % are left.
        let fog = Coefficients::from_visibility(200.0).unwrap();
        assert!((f64::from(fog.extinction().x) * 200.0 - 3.912_023).abs() < 1e-5);
        assert_eq!(fog.albedo(), Rgb::ONE);
    }

    #[test]
    fn another_unit_keeps_what_light_does() {
        let lit = Coefficients::new(Rgb::splat(3.0), Rgb::splat(1.0))
            .unwrap()
            .with_source(Rgb::splat(7.0))
            .unwrap();
        assert_eq!(lit.emission(), Rgb::splat(21.0));
        let per_millimetre = lit.per_length(1e-3).unwrap();
        assert_eq!(per_millimetre.albedo(), lit.albedo());
        assert!((per_millimetre.extinction() * 1000.0 - lit.extinction()).abs().max_element() < 1e-5);
        assert!((per_millimetre.emission() * 1000.0 - lit.emission()).abs().max_element() < 1e-5);
        assert!(
            lit.per_length(f32::NAN).is_err()
                && lit.per_length(-1.0).is_err()
                && lit.per_length(f32::MAX).is_err()
        );
        assert!(lit.per_length(0.0).unwrap().is_clear() && Coefficients::CLEAR.is_clear() && !lit.is_clear());
    }

    #[test]
    fn what_cannot_be_is_refused_in_words() {
        for bad in [-1.0, f32::NAN, f32::INFINITY] {
            let one = Rgb::new(1.0, bad, 1.0);
            assert!(matches!(
                Coefficients::new(one, Rgb::ONE),
                Err(CoefficientError::OutOfRange { what: "absorption coefficient", .. })
            ));
            assert!(
                Coefficients::new(Rgb::ONE, one).unwrap_err().to_string().contains("scattering coefficient")
            );
            assert!(
                Coefficients::CLEAR.with_emission(one).is_err()
                    && Coefficients::CLEAR.with_source(one).is_err()
            );
            assert!(matches!(Coefficients::from_albedo(one, Rgb::ONE), Err(CoefficientError::Albedo(_))));
            assert!(matches!(
                Coefficients::from_albedo(Rgb::ONE, one),
                Err(CoefficientError::MeanFreePath(_))
            ));
            assert!(matches!(Coefficients::from_visibility(bad), Err(CoefficientError::Visibility(_))));
        }
        assert!(matches!(
            Coefficients::from_albedo(Rgb::splat(1.01), Rgb::ONE),
            Err(CoefficientError::Albedo(_))
        ));
        assert!(Coefficients::from_albedo(Rgb::ONE, Rgb::ZERO).is_err());
        assert!(matches!(
            Coefficients::from_albedo(Rgb::ONE, Rgb::splat(1e-42)),
            Err(CoefficientError::Overflow(_))
        ));
        assert!(matches!(Coefficients::new(Rgb::MAX, Rgb::MAX), Err(CoefficientError::Overflow(_))));
        assert!(Coefficients::from_visibility(1e-42).is_err());
    }

    #[test]
    fn similarity_keeps_absorption() {
        let a = Coefficients::new(Rgb::splat(0.1), Rgb::splat(10.0)).unwrap().reduced(0.9);
        assert_eq!(a.absorption(), Rgb::splat(0.1));
        assert!((a.scattering() - Rgb::ONE).abs().max_element() < 1e-5);
    }
}
