//! Indices of refraction that depend on the wavelength.

use super::line::{LINES, Line};
use super::{FRAUNHOFER, VISIBLE};
use crate::math::Rgb;
use crate::settings::Wavelengths;
use std::sync::Arc;
use thiserror::Error;

/// An index of refraction as a function of the wavelength in vacuum.
#[derive(Clone, Debug, PartialEq)]
pub enum Dispersion {
    /// `n^2 = 1 + sum B l^2 / (l^2 - C)`, with the wavelength `l` in micrometres: rows of `B` and `C` in square micrometres (Sellmeier
    /// 1871; the form of the catalogues of glass).
    Sellmeier(Vec<[f64; 2]>),
    /// `n = A + B / l^2 + C / l^4`, with the wavelength `l` in micrometres (Cauchy 1836).
    Cauchy([f64; 3]),
    /// Wavelengths in nm with their indices, in ascending order; linear between them.
    Table(Vec<[f64; 2]>),
}

/// What is wrong with a [`Dispersion`].
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DispersionError {
    /// The Abbe number is no number that glass can have.
    #[error(
        "an Abbe number of {0}: it must be from 1 to 1,000,000 (5 is extreme, 20 is a heavy flint, 95 a fluoride)"
    )]
    Abbe(f64),
    /// A table without rows, or with rows out of order.
    #[error(
        "row {0} of the table of indices: each row needs a wavelength above 0 and above that of the row before, in nm"
    )]
    Order(usize),
    /// A row whose index is out of range.
    #[error("row {0} of the table has the index {1:?}; it must be from 1 to 100")]
    Row(usize, f64),
    /// A table that ends within the visible range.
    #[error(
        "the table of indices covers {0} to {1} nm, and light needs {first} to {last} nm; add rows for the rest",
        first = VISIBLE[0],
        last = VISIBLE[1]
    )]
    Range(f64, f64),
    /// An index below one, or none at all.
    #[error(
        "the index of refraction is {1:?} at {0:.1} nm; it must be from 1 to 100 from {first} to {last} nm (are the coefficients in micrometres?)",
        first = VISIBLE[0],
        last = VISIBLE[1]
    )]
    Index(f64, f64),
}

impl Dispersion {
    /// The index `ior` at the d line with the Abbe number `abbe`, `(n_d - 1) / (n_F - n_C)`, as a formula of Cauchy with two terms. It
    /// is within 1e-4 of the formula of Sellmeier for crown glass. The larger the number, the less the index varies.
    pub fn from_abbe(ior: f64, abbe: f64) -> Result<Self, DispersionError> {
        if !(1.0..=1e6).contains(&abbe) {
            return Err(DispersionError::Abbe(abbe));
        }
        let [c, d, f] = FRAUNHOFER.map(|nm| (nm * 1e-3).powi(-2));
        let b = (ior - 1.0) / abbe / (f - c);
        Self::Cauchy([ior - b * d, b, 0.0]).checked()
    }

    /// The same, if it has an index from 1 to 100 at each visible wavelength.
    pub fn checked(self) -> Result<Self, DispersionError> {
        if let Self::Table(rows) = &self {
            let ordered = |i: &usize| {
                let [nm, _] = rows[*i];
                nm.is_finite() && nm > 0.0 && (*i == 0 || rows[i - 1][0] < nm)
            };
            if let Some(row) = (0..rows.len()).find(|i| !ordered(i)) {
                return Err(DispersionError::Order(row + 1));
            }
            let (Some([first, _]), Some([last, _])) = (rows.first(), rows.last()) else {
                return Err(DispersionError::Order(1));
            };
            if *first > VISIBLE[0] || *last < VISIBLE[1] {
                return Err(DispersionError::Range(*first, *last));
            }
            let (least, largest) = (1.0, 100.0);
            let is_out = |[_, index]: &[f64; 2]| !(least..=largest).contains(index);
            if let Some(row) = rows.iter().position(is_out) {
                return Err(DispersionError::Row(row + 1, rows[row][1]));
            }
        }
        // All that paths may take, and the ends.
        let lines = (0..LINES as u16).map(|code| Line::of_code(code).wavelength());
        for nm in VISIBLE.into_iter().chain(lines) {
            let index = self.at(nm);
            if !(1.0..=100.0).contains(&index) {
                return Err(DispersionError::Index(nm, index));
            }
        }
        Ok(self)
    }

    /// Index of refraction at a wavelength in nm.
    pub fn at(&self, nm: f64) -> f64 {
        let squared = (nm * 1e-3) * (nm * 1e-3);
        match self {
            Self::Sellmeier(terms) => {
                let sum: f64 = terms.iter().map(|[b, c]| b * squared / (squared - c)).sum();
                (1.0 + sum).sqrt()
            }
            Self::Cauchy([a, b, c]) => a + b / squared + c / (squared * squared),
            Self::Table(rows) => {
                let after = rows.partition_point(|row| row[0] <= nm).clamp(1, rows.len().max(2) - 1);
                let (Some([x0, y0]), Some([x1, y1])) = (rows.get(after - 1), rows.get(after)) else {
                    return f64::NAN;
                };
                let share = ((nm - x0) / (x1 - x0)).clamp(0.0, 1.0);
                y0 * (1.0 - share) + y1 * share
            }
        }
    }

    /// Index of refraction at the d line, which RGB paths see.
    pub fn ior(&self) -> f64 {
        self.at(FRAUNHOFER[1])
    }

    /// Abbe number, `(n_d - 1) / (n_F - n_C)`; infinite where the index does not vary.
    pub fn abbe(&self) -> f64 {
        let [c, d, f] = FRAUNHOFER.map(|nm| self.at(nm));
        (d - 1.0) / (f - c)
    }
}

/// The index of a medium at each [`Line`].
#[derive(Clone, Debug, PartialEq)]
pub struct LineIndices {
    by_line: Arc<[f32]>,
    /// Mean index for the response of each channel, with continuous wavelengths and with three.
    of_channels: [Rgb; 2],
    least: f32,
    largest: f32,
}

impl LineIndices {
    /// Of this dispersion.
    pub fn new(dispersion: &Dispersion) -> Self {
        let lines = (0..LINES as u16).map(Line::of_code);
        let by_line: Arc<[f32]> = lines.map(|line| dispersion.at(line.wavelength()) as f32).collect();
        let continuous = &by_line[..LINES - 3];
        let weighted = (0..).zip(continuous).map(|(code, &index)| Line::of_code(code).response() * index);
        let mean = weighted.map(|index| index.as_dvec3()).sum::<glam::DVec3>() / continuous.len() as f64;
        let three = Rgb::from_slice(&by_line[LINES - 3..]);
        Self {
            of_channels: [mean.as_vec3(), three],
            least: by_line.iter().copied().fold(f32::INFINITY, f32::min),
            largest: by_line.iter().copied().fold(0.0, f32::max),
            by_line,
        }
    }

    /// Abbe number.
    pub fn abbe(&self) -> f64 {
        let [c, d, f] = self.of_channels[1].as_dvec3().to_array();
        (d - 1.0) / (f - c)
    }

    /// At a line.
    #[inline]
    pub fn at(&self, line: Line) -> f32 {
        self.by_line[usize::from(line.code())]
    }

    /// For each channel, the mean over its response: a quantity that is nearly linear in the index has its mean there.
    #[inline]
    pub fn of_channels(&self, wavelengths: Wavelengths) -> Rgb {
        match wavelengths {
            Wavelengths::Continuous | Wavelengths::Off => self.of_channels[0],
            Wavelengths::Three => self.of_channels[1],
        }
    }

    /// The least and the largest index over all lines.
    #[inline]
    pub fn range(&self) -> [f32; 2] {
        [self.least, self.largest]
    }
}

#[cfg(test)]
mod tests {
    use super::super::named_glass;
    use super::*;

    #[test]
    fn abbe_numbers_come_back() {
        for (ior, abbe) in [(1.5168, 64.167), (1.78472, 25.68), (1.33, 5.0), (1.5, 1000.0), (2.4, 55.3)] {
            let glass = Dispersion::from_abbe(ior, abbe).unwrap();
            assert!((glass.ior() - ior).abs() < 1e-12 && (glass.abbe() / abbe - 1.0).abs() < 1e-9);
        }
        // Crown glass: Cauchy's formula against Sellmeier's.
        let crown = Dispersion::from_abbe(1.5168, 64.167).unwrap();
        let Dispersion::Cauchy([a, b, _]) = crown else { panic!() };
        assert!((a - 1.504_583).abs() < 1e-6 && (b - 0.004_217_55).abs() < 1e-7, "{a} {b}");
        let exact = named_glass("N-BK7").unwrap().dispersion();
        for nm in [400.0, 435.83, 486.13, 587.56, 656.27, 700.0] {
            assert!((crown.at(nm) - exact.at(nm)).abs() < 2e-4, "{nm}");
        }
        assert!(Dispersion::from_abbe(1.5, 0.0).is_err() && Dispersion::from_abbe(1.5, f64::NAN).is_err());
    }

    #[test]
    fn tables_are_linear_and_must_cover_what_is_seen() {
        let table = Dispersion::Table(vec![[380.0, 1.6], [580.0, 1.5], [780.0, 1.48]]).checked().unwrap();
        assert!((table.at(480.0) - 1.55).abs() < 1e-12 && (table.at(680.0) - 1.49).abs() < 1e-12);
        assert_eq!((table.at(300.0), table.at(900.0)), (1.6, 1.48));
        let short = Dispersion::Table(vec![[400.0, 1.6], [700.0, 1.5]]).checked();
        assert_eq!(short, Err(DispersionError::Range(400.0, 700.0)));
        let message = short.unwrap_err().to_string();
        assert!(message.contains("400 to 700 nm") && message.contains("380 to 780 nm"), "{message}");
        let unordered = Dispersion::Table(vec![[380.0, 1.6], [780.0, 1.5], [600.0, 1.5]]).checked();
        assert_eq!(unordered, Err(DispersionError::Order(3)));
        let peak =
            Dispersion::Table(vec![[380.0, 1.5], [550.4, 1.5], [550.5, 1e30], [550.6, 1.5], [780.0, 1.5]]);
        assert_eq!(peak.checked(), Err(DispersionError::Row(3, 1e30)));
        // A pole between two wavelengths that are a nanometre apart.
        assert!(Dispersion::Sellmeier(vec![[1.25, 0.01], [1e-3, 0.303_050_24]]).checked().is_err());
        assert!(Dispersion::Table(Vec::new()).checked().is_err());
        assert!(Dispersion::Table(vec![[380.0, 1.6]]).checked().is_err());
        // Coefficients in nanometres in place of micrometres.
        let absurd = Dispersion::Cauchy([1.5, 4217.0, 0.0]).checked();
        assert!(matches!(absurd, Err(DispersionError::Index(..))), "{absurd:?}");
        assert!(Dispersion::Sellmeier(vec![[1.0, 0.25]]).checked().is_err());
        assert!(Dispersion::Cauchy([f64::NAN, 0.0, 0.0]).checked().is_err());
    }

    #[test]
    fn indices_of_channels_are_means() {
        let glass = named_glass("N-SF11").unwrap().dispersion();
        let indices = LineIndices::new(&glass);
        let [red, green, blue] = indices.of_channels(Wavelengths::Continuous).to_array();
        assert!(red < green && green < blue, "{red} {green} {blue}");
        let three = indices.of_channels(Wavelengths::Three).as_dvec3();
        let exact = glam::DVec3::from_array(FRAUNHOFER.map(|nm| glass.at(nm)));
        assert!((three - exact).abs().max_element() < 1e-6);
        let [least, largest] = indices.range();
        assert!(least < red && blue < largest);
        let constant = LineIndices::new(&Dispersion::Cauchy([1.5, 0.0, 0.0]));
        assert!((constant.of_channels(Wavelengths::Continuous) - 1.5).abs().max_element() < 1e-6);
    }
}
