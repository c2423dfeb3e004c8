//! Transmittance along a line as a function of the distance.

use crate::math::Rgb;
use crate::media::density::{Density, Line};
use crate::media::{End, Losses, Volume};
use crate::sampling::Rng;

/// Trackings of one line: the share of those that get beyond a distance is an unbiased estimate of the transmittance up to there.
const TRACKINGS: usize = 8;

/// The same for each channel of a medium whose extinction differs between channels.
const TRACKINGS_OF_CHANNEL: usize = 4;

/// Distances of the first collisions of independent trackings, by channel ("progressive deep shadow maps" of Jarosz, Nowrouzezahrai, Thomas,
/// Sloan & Zwicker, "Progressive Photon Beams", 2011).
#[derive(Clone, Debug)]
pub(super) struct Steps {
    /// In ascending order; infinite where the end was reached.
    channels: [Vec<f64>; 3],
    length: f64,
}

impl Steps {
    /// Of `line` from 0 to `length`.
    pub(super) fn new(volume: &Volume, line: &Line, length: f64, rng: &mut Rng) -> Self {
        let extinction = volume.coefficients().extinction();
        let tracked = |channel: Rgb, count: usize, rng: &mut Rng| {
            let mut distances: Vec<f64> = (0..count)
                .map(|_| match volume.fly(line, length, channel, Losses::Weighted, rng).end {
                    End::Scattered { t, .. } | End::Absorbed { t, .. } => t,
                    End::Escaped { .. } => f64::INFINITY,
                })
                .collect();
            distances.sort_by(f64::total_cmp);
            distances
        };
        let channels = if extinction.x == extinction.y && extinction.y == extinction.z {
            let all = tracked(Rgb::ONE, TRACKINGS, rng);
            [all.clone(), all.clone(), all]
        } else {
            [Rgb::X, Rgb::Y, Rgb::Z].map(|channel| tracked(channel, TRACKINGS_OF_CHANNEL, rng))
        };
        Self { channels, length }
    }

    /// Transmittance from the start to `t`.
    pub(super) fn at(&self, t: f64) -> Rgb {
        let share = |distances: &[f64]| {
            distances.iter().filter(|&&distance| distance > t).count() as f32 / distances.len() as f32
        };
        Rgb::from_array([0, 1, 2].map(|channel| share(&self.channels[channel])))
    }

    /// Calls `visit` with the ends of each part over which the transmittance is the same, and that transmittance.
    pub(super) fn each(&self, mut visit: impl FnMut(f64, f64, Rgb)) {
        let mut ends: Vec<f64> = self.channels.iter().flatten().map(|&t| t.min(self.length)).collect();
        ends.push(self.length);
        ends.sort_by(f64::total_cmp);
        ends.dedup();
        let mut start = 0.0;
        for end in ends {
            if end > start {
                let left = self.at(0.5 * (start + end));
                if left == Rgb::ZERO {
                    return;
                }
                visit(start, end, left);
            }
            start = end;
        }
    }
}

/// Transmittance along a line through a medium.
#[derive(Clone, Debug)]
pub(super) enum Fade<'a> {
    /// `exp(-extinction t)`.
    Homogeneous(Rgb),
    /// In closed form.
    Closed(&'a Volume, Line),
    /// Estimated.
    Tracked(Steps),
}

impl<'a> Fade<'a> {
    /// Of `line` from 0 to `length`.
    pub(super) fn new(volume: &'a Volume, line: &Line, length: f64, rng: &mut Rng) -> Self {
        match volume.density() {
            Density::Homogeneous => Self::Homogeneous(volume.coefficients().extinction()),
            Density::Height(_) => Self::Closed(volume, *line),
            Density::Field(_) | Density::Grid(_) => Self::Tracked(Steps::new(volume, line, length, rng)),
        }
    }

    /// Transmittance from the start to `t`.
    #[inline]
    pub(super) fn at(&self, t: f32) -> Rgb {
        match self {
            Self::Homogeneous(extinction) => exp_of(*extinction * -t),
            Self::Closed(volume, line) => volume.exact_transmittance(line, t.into()).unwrap_or(Rgb::ONE),
            Self::Tracked(steps) => steps.at(t.into()),
        }
    }
}

/// The exponential of each channel; one evaluation where all are the same.
#[inline]
pub(super) fn exp_of(x: Rgb) -> Rgb {
    if x.x == x.y && x.y == x.z { Rgb::splat(x.x.exp()) } else { Rgb::new(x.x.exp(), x.y.exp(), x.z.exp()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::{Coefficients, Phase};
    use crate::sampling::Stream;
    use glam::DVec3;

    #[test]
    fn trackings_estimate_the_transmittance_of_each_channel() {
        let coefficients = Coefficients::new(Rgb::new(0.1, 0.5, 0.0), Rgb::new(0.2, 0.5, 2.0)).unwrap();
        let volume = Volume::homogeneous(coefficients, Phase::Isotropic);
        let line = Line::new(DVec3::ZERO, DVec3::X).unwrap();
        let mut rng = Rng::new(3, Stream::Measure, 0);
        let (mut mean, mut pieces) = (Rgb::ZERO, Rgb::ZERO);
        const RUNS: usize = 20_000;
        for _ in 0..RUNS {
            let steps = Steps::new(&volume, &line, 2.0, &mut rng);
            mean += steps.at(0.7) / RUNS as f32;
            steps.each(|t0, t1, left| {
                assert!(t1 > t0 && t1 <= 2.0);
                if t0 <= 0.7 && 0.7 < t1 {
                    pieces += left / RUNS as f32;
                }
            });
        }
        let exact = volume.exact_transmittance(&line, 0.7).unwrap();
        // Standard error 0.5 / sqrt(4 * 20,000) at most: 0.0018.
        assert!((mean - exact).abs().max_element() < 0.01, "{mean} {exact}");
        assert!((pieces - exact).abs().max_element() < 0.01, "{pieces} {exact}");
        let Fade::Homogeneous(_) = Fade::new(&volume, &line, 2.0, &mut rng) else { panic!("closed form") };
    }
}
