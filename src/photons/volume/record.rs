//! Photons in media as a photon pass records them.

use super::fade::Steps;
use crate::math::{Ray, Rgb};
use crate::media::{End, Losses, MediumId};
use crate::sampling::Rng;
use crate::spectra::{Line, at_line};
use crate::transport::{Collision, Stretch};
use glam::Vec3;

/// A photon that crossed a stretch of a medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::photons) struct BeamRecord {
    /// The medium.
    pub medium: MediumId,
    /// Start, render space.
    pub start: Vec3,
    /// End, render space.
    pub end: Vec3,
    /// Unnormalised flux at the start, watts; along the whole beam where the density of the medium has no integral in closed form. With a
    /// `line` all channels are that of its wavelength.
    pub power: Rgb,
    /// Wavelength of a photon that was dispersed.
    pub line: Option<Line>,
}

/// A photon where a medium scattered it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::photons) struct PointRecord {
    /// The medium.
    pub medium: MediumId,
    /// Position, render space.
    pub position: Vec3,
    /// Unit direction back along the path of the photon.
    pub wi: Vec3,
    /// Unnormalised flux that the medium scatters, watts: the albedo is contained. With a `line` all channels are that of its wavelength.
    pub power: Rgb,
    /// Wavelength of a photon that was dispersed.
    pub line: Option<Line>,
}

/// Photons in media, in the order in which they were traced.
#[derive(Clone, Debug, Default)]
pub(in crate::photons) struct MediaRecords {
    pub beams: Vec<BeamRecord>,
    pub points: Vec<PointRecord>,
}

/// Share of the flux below which the rest of a beam is left out.
const LEAST_LEFT: f32 = 1e-6;

impl MediaRecords {
    /// Records the light of a specular chain over a stretch: as beams, and as a point where it collides, for rays that are nearly parallel
    /// to the beam. `power` is that at the start of the ray, `reach` the distance to the farthest end of the scene.
    pub(in crate::photons) fn cross(
        &mut self,
        ray: &Ray,
        stretch: &Stretch<'_>,
        (power, line): (Rgb, Option<Line>),
        reach: f64,
        rng: &mut Rng,
    ) {
        let power = power * at_line(line, stretch.weight);
        let volume = stretch.volume;
        if !(power.max_element() > 0.0) || volume.coefficients().scattering() == Rgb::ZERO {
            return;
        }
        let medium = stretch.medium.medium();
        let length = stretch.length.min(reach);
        let at = |t: f64| stretch.line.at(t).as_vec3();
        if !(power.is_finite() && length.is_finite()) {
            return;
        }
        if volume.density().depth(&stretch.line, 0.0).is_some() {
            let visible = self.visible_length(stretch, length);
            self.beams.push(BeamRecord { medium, start: at(0.0), end: at(visible), power, line });
        } else {
            let steps = Steps::new(volume, &stretch.line, length, rng);
            steps.each(|t0, t1, left| {
                let power = power * at_line(line, left);
                self.beams.push(BeamRecord { medium, start: at(t0), end: at(t1), power, line });
            });
        }
        let weights = line.map_or(power, Line::primaries);
        let flight = volume.fly(&stretch.line, length, weights, Losses::Weighted, rng);
        if let End::Scattered { t, weight } = flight.end {
            let power = power * at_line(line, weight * volume.coefficients().albedo());
            self.points.push(PointRecord { medium, position: at(t), wi: -ray.direction, power, line });
        }
    }

    /// Records a photon where a medium scatters it; `power` contains the albedo.
    pub(in crate::photons) fn scatter(
        &mut self,
        ray: &Ray,
        collision: &Collision<'_>,
        (power, line): (Rgb, Option<Line>),
    ) {
        if power.max_element() > 0.0 && power.is_finite() {
            let medium = collision.stretch.medium.medium();
            let position = collision.position;
            self.points.push(PointRecord { medium, position, wi: -ray.direction, power, line });
        }
    }

    /// Length of the part of a stretch after which nothing visible is left.
    fn visible_length(&self, stretch: &Stretch<'_>, length: f64) -> f64 {
        let left =
            |t: f64| stretch.volume.exact_transmittance(&stretch.line, t).unwrap_or(Rgb::ONE).max_element();
        if !(left(length) < LEAST_LEFT) {
            return length;
        }
        let (mut low, mut high) = (0.0, length);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if left(middle) < LEAST_LEFT { high = middle } else { low = middle }
        }
        high
    }

    /// Number of photons, as a pass counts those that it was asked to store.
    pub(in crate::photons) fn len(&self) -> usize {
        if self.beams.is_empty() { self.points.len() } else { self.beams.len() }
    }

    /// Appends others, their power times `factor`.
    pub(in crate::photons) fn append(&mut self, other: Self, factor: f32) {
        self.beams.extend(other.beams.into_iter().map(|b| BeamRecord { power: b.power * factor, ..b }));
        self.points.extend(other.points.into_iter().map(|p| PointRecord { power: p.power * factor, ..p }));
    }
}
