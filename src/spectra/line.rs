//! The wavelength of a path.

use super::primaries::primaries;
use super::{FRAUNHOFER, VISIBLE, cie};
use crate::math::Rgb;
use crate::settings::Wavelengths;
use glam::DVec3;
use std::sync::LazyLock;

/// Number of wavelengths among which continuous ones are chosen. A tenth of a nanometre lies between neighbours.
const CONTINUOUS: u16 = 4093;

/// All lines: the continuous ones and the three.
pub(super) const LINES: usize = CONTINUOUS as usize + 3;

/// The wavelength of a monochromatic path, as the number of one of 4096 that are fixed.
///
/// Continuous wavelengths are chosen with a density in proportion to the sum of the absolute responses of the three channels, so that
/// every path has the same sum of absolute values. The second moments of the responses are then 6.0, 2.8 and 3.9, and those of uniformly
/// distributed wavelengths 10, 5.1 and 6.8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Line(u16);

/// What a line means.
#[derive(Clone, Copy, Debug)]
struct Entry {
    wavelength: f64,
    response: Rgb,
    primaries: Rgb,
}

static ENTRIES: LazyLock<Box<[Entry; LINES]>> = LazyLock::new(entries);

impl Line {
    /// Bits of [`Self::code`].
    pub const BITS: u32 = 12;

    /// The line for a uniform random number `u` in `[0, 1)`. `None` where paths have no wavelength.
    #[inline]
    pub fn choose(wavelengths: Wavelengths, u: f32) -> Option<Self> {
        let of = |count: u16| ((u * f32::from(count)) as u16).min(count - 1);
        match wavelengths {
            Wavelengths::Continuous => Some(Self(of(CONTINUOUS))),
            Wavelengths::Three => Some(Self(CONTINUOUS + of(3))),
            Wavelengths::Off => None,
        }
    }

    /// Number of the line, below 4096.
    #[inline]
    pub fn code(self) -> u16 {
        self.0
    }

    /// The line of this number; higher bits are ignored.
    #[inline]
    pub fn of_code(code: u16) -> Self {
        Self(code % LINES as u16)
    }

    /// Wavelength in vacuum, nm.
    #[inline]
    pub fn wavelength(self) -> f64 {
        self.entry().wavelength
    }

    /// Response of the sensor to light of this wavelength, over the density with which the wavelength is chosen: linear Rec. 709. Its mean
    /// over all choices is `(1, 1, 1)` for light whose spectrum is that of D65, which is what white light has. Channels may be negative,
    /// because no screen shows the colours of the spectrum.
    #[inline]
    pub fn response(self) -> Rgb {
        self.entry().response
    }

    /// The colour `rgb` at this wavelength, over D65 where it is that of light: a reflectance, a transmittance or a radiance.
    #[inline]
    pub fn at(self, rgb: Rgb) -> f32 {
        self.entry().primaries.dot(rgb)
    }

    /// Throughput of a path that carried `rgb` and takes this wavelength: what it shows on the sensor.
    #[inline]
    pub fn taken_by(self, rgb: Rgb) -> Rgb {
        self.response() * self.at(rgb)
    }

    /// Share of each channel in [`Self::at`]; they sum to one.
    #[inline]
    pub fn primaries(self) -> Rgb {
        self.entry().primaries
    }

    #[inline]
    fn entry(self) -> &'static Entry {
        &ENTRIES[usize::from(self.0)]
    }
}

/// The colour `rgb` as a factor of a path: at its wavelength, if it has one.
#[inline]
pub fn at_line(line: Option<Line>, rgb: Rgb) -> Rgb {
    match line {
        None => rgb,
        Some(line) => Rgb::splat(line.at(rgb)),
    }
}

/// Response of the three channels to D65 at a wavelength in nm, to a constant factor.
fn response(wavelength: f64) -> DVec3 {
    let place = (wavelength - cie::FIRST) / cie::STEP;
    let row = (place as usize).min(cie::ROWS.len() - 2);
    let share = place - row as f64;
    let [x, y, z, daylight] =
        std::array::from_fn(|i| cie::ROWS[row][i] * (1.0 - share) + cie::ROWS[row + 1][i] * share);
    cie::TO_RGB * DVec3::new(x, y, z) * daylight
}

fn entries() -> Box<[Entry; LINES]> {
    /// Steps of the quadrature for each nanometre.
    const FINE: f64 = 50.0;
    let [first, last] = VISIBLE;
    let steps = ((last - first) * FINE).round() as usize;
    let wavelength = |step: usize| first + (step as f64 + 0.5) / FINE;
    let absolute = |step: usize| response(wavelength(step)).abs().element_sum();
    let all: f64 = (0..steps).map(absolute).sum();
    let (mut step, mut before) = (0, 0.0);
    let mut entries: Vec<Entry> = (0..CONTINUOUS)
        .map(|code| {
            let wanted = (f64::from(code) + 0.5) / f64::from(CONTINUOUS) * all;
            while step + 1 < steps && before + absolute(step) < wanted {
                before += absolute(step);
                step += 1;
            }
            let within = ((wanted - before) / absolute(step)).clamp(0.0, 1.0);
            let wavelength = first + (step as f64 + within) / FINE;
            let response = response(wavelength);
            Entry {
                wavelength,
                response: (response / response.abs().element_sum()).as_vec3(),
                primaries: primaries(wavelength).as_vec3(),
            }
        })
        .collect();
    // White stays white, whatever the quadrature.
    let mean = entries.iter().map(|entry| entry.response.as_dvec3()).sum::<DVec3>() / f64::from(CONTINUOUS);
    for entry in &mut entries {
        entry.response = (entry.response.as_dvec3() / mean).as_vec3();
    }
    entries.extend((0..3).map(|channel| Entry {
        wavelength: FRAUNHOFER[channel],
        response: Rgb::AXES[channel] * 3.0,
        primaries: Rgb::AXES[channel],
    }));
    let boxed: Result<Box<[Entry; LINES]>, _> = entries.into_boxed_slice().try_into();
    boxed.unwrap_or_else(|_| unreachable!("as many entries as lines"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn continuous() -> impl Iterator<Item = Line> {
        (0..CONTINUOUS).map(Line)
    }

    fn mean(value: impl Fn(Line) -> DVec3) -> DVec3 {
        continuous().map(value).sum::<DVec3>() / f64::from(CONTINUOUS)
    }

    #[test]
    fn white_is_white_and_colours_come_back() {
        let white = mean(|line| line.response().as_dvec3());
        assert!((white - 1.0).abs().max_element() < 1e-6, "{white}");
        for (axis, colour) in Rgb::AXES.into_iter().zip(DVec3::AXES) {
            let back = mean(|line| (line.response() * line.at(axis)).as_dvec3());
            assert!((back - colour).abs().max_element() < 1e-4, "{axis}: {back}");
        }
    }

    #[test]
    fn no_reflectance_exceeds_one_and_grey_is_grey() {
        for line in continuous() {
            let shares = line.primaries();
            assert!(
                shares.min_element() >= -1e-6 && shares.max_element() <= 1.0 + 1e-6,
                "{line:?}: {shares}"
            );
            assert!((line.at(Rgb::splat(0.37)) - 0.37).abs() < 1e-6, "{line:?}");
        }
    }

    #[test]
    fn lines_are_chosen_by_their_responses() {
        // Figures of an independent quadrature with the same tables.
        for line in continuous() {
            let sum = line.response().abs().element_sum();
            assert!((sum - 4.440).abs() < 0.005, "{line:?}: {sum}");
        }
        let second = mean(|line| line.response().as_dvec3() * line.response().as_dvec3());
        assert!((second - DVec3::new(6.017, 2.849, 3.939)).abs().max_element() < 0.005, "{second}");
        let ordered: Vec<f64> = continuous().map(Line::wavelength).collect();
        assert!(ordered.is_sorted() && ordered[0] > VISIBLE[0] && ordered[4092] < VISIBLE[1]);
    }

    #[test]
    fn three_lines_are_the_channels() {
        let lines: Vec<Line> =
            [0.0, 0.4, 0.999_999].map(|u| Line::choose(Wavelengths::Three, u).unwrap()).into();
        for (channel, line) in lines.into_iter().enumerate() {
            assert_eq!(line.wavelength(), FRAUNHOFER[channel]);
            assert_eq!(line.response(), 3.0 * Rgb::AXES[channel]);
            assert_eq!(line.at(Rgb::new(0.1, 0.2, 0.3)), [0.1, 0.2, 0.3][channel]);
            assert_eq!(Line::of_code(line.code()), line);
        }
        assert!(Line::choose(Wavelengths::Off, 0.5).is_none());
    }
}
