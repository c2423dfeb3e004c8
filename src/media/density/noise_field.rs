//! Clouds and smoke out of noise.

use super::DensityField;
use crate::math::Bounds3;
use crate::textures::Octaves;
use glam::{DAffine3, DVec3};

/// Largest slope that [`crate::textures::noise`] can have. A bound over all gradients of its lattice and all places in a cell, found
/// numerically; the noise that there is stays below.
const NOISE_SLOPE: f64 = 3.9;

/// A density made of octaves of noise (Perlin, "An Image Synthesizer", 1985): their sum, of which `low` becomes a density of zero and
/// `high` one of one, less what an [`Envelope`] takes away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseField {
    octaves: Octaves,
    is_turbulent: bool,
    low: f64,
    high: f64,
    to_noise: DAffine3,
    /// Largest factor by which `to_noise` stretches.
    stretch: f64,
    envelope: Option<Envelope>,
}

/// Takes the density away towards the sides of a box: none up to a share of the way from its middle, and from there on linearly up to a
/// density of one at the sides. What is denser than one is first cut to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Envelope {
    center: DVec3,
    half: DVec3,
    fade: f64,
    is_round: bool,
}

impl Envelope {
    /// Within `bounds`, or with `is_round` within the ellipsoid in them, over the outer share `fade` of the way; `None` where that is not
    /// above 0 and at most 1, or the bounds have no volume.
    pub fn new(bounds: &Bounds3, is_round: bool, fade: f64) -> Option<Self> {
        let half = 0.5 * (bounds.max - bounds.min);
        let is_sound = fade > 0.0 && fade <= 1.0 && half.min_element() > 0.0 && half.is_finite();
        is_sound.then_some(Self { center: bounds.min + half, half, fade, is_round })
    }

    /// What is taken away at `p`.
    fn taken(&self, p: DVec3) -> f64 {
        let way = ((p - self.center) / self.half).abs();
        let way = if self.is_round { way.length() } else { way.max_element() };
        ((way - (1.0 - self.fade)) / self.fade).max(0.0)
    }

    /// Largest slope of that.
    fn slope(&self) -> f64 {
        1.0 / (self.fade * self.half.min_element())
    }
}

/// Why noise cannot be a density.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoiseFieldError {
    /// The two levels do not differ, or are in the wrong order.
    #[error(
        "noise of {low} is to be a density of zero and noise of {high} one of one: the second must be larger, and both finite"
    )]
    Levels {
        /// Noise that is a density of zero.
        low: f64,
        /// Noise that is a density of one.
        high: f64,
    },
    /// Octaves are endless or empty.
    #[error(
        "noise as a density has octaves of sizes from {finest} to {size}: both must be positive and finite, the first one smaller"
    )]
    Sizes {
        /// Smallest wavelength.
        finest: f64,
        /// Largest wavelength.
        size: f64,
    },
    /// The transform is not finite.
    #[error("the transform of noise as a density is not finite")]
    Transform,
}

impl NoiseField {
    /// Signed octaves (in [-2, 2], mean 0), or with `is_turbulent` absolute ones (in [0, 2]); `to_noise` leads from the space of lines to
    /// that of the noise.
    ///
    /// # Errors
    /// Where `low` is not below `high`, sizes are not positive, or the transform is not finite.
    pub fn new(
        octaves: Octaves,
        is_turbulent: bool,
        (low, high): (f64, f64),
        to_noise: DAffine3,
    ) -> Result<Self, NoiseFieldError> {
        if !(low < high && low.is_finite() && high.is_finite()) {
            return Err(NoiseFieldError::Levels { low, high });
        }
        let Octaves { size, finest, .. } = octaves;
        if !(size >= finest && finest > 0.0 && size.is_finite()) {
            return Err(NoiseFieldError::Sizes { finest, size });
        }
        if !to_noise.is_finite() {
            return Err(NoiseFieldError::Transform);
        }
        // The Frobenius norm is no smaller than the largest stretch.
        let m = to_noise.matrix3;
        let stretch =
            (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
        // For turns and even scales it is the stretch times the root of three.
        let is_even = (m.transpose() * m - glam::DMat3::IDENTITY * (stretch * stretch / 3.0))
            .to_cols_array()
            .iter()
            .all(|e| e.abs() < 1e-9 * stretch * stretch);
        let stretch = if is_even { stretch / 3f64.sqrt() * (1.0 + 1e-9) } else { stretch };
        Ok(Self { octaves, is_turbulent, low, high, to_noise, stretch, envelope: None })
    }

    /// The bound on its slope, as [`DensityField::slope`].
    pub fn steepness(&self) -> f64 {
        self.slope()
    }

    /// The same within an envelope, in the space of lines.
    #[must_use]
    pub fn within(self, envelope: Option<Envelope>) -> Self {
        Self { envelope, ..self }
    }
}

impl DensityField for NoiseField {
    fn value(&self, p: DVec3) -> f64 {
        let taken = self.envelope.map_or(0.0, |envelope| envelope.taken(p));
        if taken >= 1.0 {
            // Nothing is left, whatever the noise is, and nothing is nearer than the envelope says.
            return 1.0 - taken;
        }
        let p = self.to_noise.transform_point3(p);
        let value =
            if self.is_turbulent { self.octaves.turbulence(p, 0.0) } else { self.octaves.fractal(p, 0.0) };
        let density = (value - self.low) / (self.high - self.low);
        if self.envelope.is_some() { density.min(1.0) - taken } else { density }
    }

    fn slope(&self) -> f64 {
        // An octave of half the wavelength has half the height: all are as steep as the first.
        let octaves = (self.octaves.size / self.octaves.finest).log2().floor() + 1.0;
        let of_noise = octaves * NOISE_SLOPE / self.octaves.size * self.stretch / (self.high - self.low);
        of_noise + self.envelope.map_or(0.0, |envelope| envelope.slope())
    }

    fn most(&self) -> f64 {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Bounds3;
    use crate::media::density::test_lines::{check_segments, random_point};
    use crate::media::density::{BoundedField, Density, Line};
    use crate::sampling::{Rng, Stream};
    use crate::textures::noise;
    use glam::UVec3;
    use std::sync::Arc;

    /// Largest derivative along `n` at `f` of a lattice cell, whatever gradients its corners have.
    fn steepest(f: DVec3, n: DVec3) -> f64 {
        let blend = |x: f64| x * x * x * (x * (x * 6.0 - 15.0) + 10.0);
        let rate = |x: f64| 30.0 * x * x * (1.0 - x) * (1.0 - x);
        let corners = (0..8).map(|corner| {
            let c = DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
            let side = |axis: usize| {
                if c[axis] > 0.5 {
                    (blend(f[axis]), rate(f[axis]))
                } else {
                    (1.0 - blend(f[axis]), -rate(f[axis]))
                }
            };
            let [(wx, dx), (wy, dy), (wz, dz)] = [side(0), side(1), side(2)];
            let weight = wx * wy * wz;
            let slope = n.dot(DVec3::new(dx * wy * wz, wx * dy * wz, wx * wy * dz));
            // A gradient is (+-1, +-1, 0) in some order: it takes the two largest components.
            let mut v = (n * weight + (f - c) * slope).abs().to_array();
            v.sort_by(f64::total_cmp);
            v[1] + v[2]
        });
        0.97 * corners.sum::<f64>()
    }

    #[test]
    fn noise_is_nowhere_steeper_than_its_bound() {
        let mut rng = Rng::new(1, Stream::Measure, 34);
        // The bound itself: a search for its largest value, narrowed around the best.
        let (mut best, mut at) = (0.0, (DVec3::ZERO, DVec3::X));
        for i in 0..300_000u32 {
            let reach = if i < 100_000 { 1.0 } else { 0.3 * 0.5f64.powf(f64::from(i - 100_000) / 20_000.0) };
            let f = (at.0 + reach * random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE))
                .clamp(DVec3::ZERO, DVec3::ONE);
            let Some(n) =
                crate::math::unit_f64(at.1 + reach * random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE))
            else {
                continue;
            };
            let here = steepest(f, n);
            if here > best {
                (best, at) = (here, (f, n));
            }
        }
        assert!(best < NOISE_SLOPE && best > 0.9 * NOISE_SLOPE, "{best} at {at:?}");
        // And the noise.
        let mut found = 0.0f64;
        for _ in 0..200_000 {
            let p = random_point(&mut rng, DVec3::splat(-100.0), DVec3::splat(100.0));
            let h = 1e-5;
            let gradient = DVec3::from_array(
                [DVec3::X, DVec3::Y, DVec3::Z]
                    .map(|axis| (noise(p + axis * h, 3) - noise(p - axis * h, 3)) / (2.0 * h)),
            );
            found = found.max(gradient.length());
        }
        assert!(found < NOISE_SLOPE && found > 0.4 * NOISE_SLOPE, "{found}");
    }

    #[test]
    fn bounds_hold_along_any_line() {
        let bounds = Bounds3 { min: DVec3::ZERO, max: DVec3::new(4.0, 2.0, 3.0) };
        for (is_turbulent, levels) in [(false, (0.0, 0.8)), (true, (0.2, 1.5))] {
            let octaves = Octaves { size: 1.5, finest: 0.4, seed: 3 };
            let turn = DAffine3::from_rotation_y(0.3) * DAffine3::from_scale(DVec3::splat(1.2));
            let cloud = NoiseField::new(octaves, is_turbulent, levels, turn).unwrap();
            let field = BoundedField::new(cloud, bounds, UVec3::splat(24)).unwrap();
            let density = Density::Field(Arc::new(field));
            let mut rng = Rng::new(1, Stream::Measure, 35);
            let mut segments = 0;
            for _ in 0..300 {
                let [from, to] =
                    [(); 2].map(|()| random_point(&mut rng, DVec3::splat(-1.0), DVec3::splat(4.0)));
                let line = Line::new(from, to - from).unwrap();
                segments += check_segments(&density, &line, 6.0, &mut rng);
            }
            assert!(segments > 1000, "{segments}");
        }
    }

    /// Noise that is one everywhere, faded from the middle of a ball on: the density 1 - r.
    #[test]
    fn an_envelope_takes_away_towards_the_sides() {
        let bounds = Bounds3 { min: DVec3::new(-1.0, 1.0, -3.0), max: DVec3::new(1.0, 3.0, 3.0) };
        let octaves = Octaves { size: 1.0, finest: 1.0, seed: 3 };
        let full = NoiseField::new(octaves, false, (-4.0, -3.0), DAffine3::IDENTITY).unwrap();
        let field = |is_round, fade| {
            let envelope = Envelope::new(&bounds, is_round, fade);
            assert!(envelope.is_some());
            BoundedField::new(full.within(envelope), bounds, UVec3::new(8, 8, 24)).unwrap()
        };
        let ball = field(true, 1.0);
        for (p, want) in
            [([0.0, 2.0, 0.0], 1.0), ([0.3, 2.4, 0.0], 0.5), ([0.0, 2.0, 1.5], 0.5), ([0.9, 2.9, 0.0], 0.0)]
        {
            assert!(
                (ball.at(DVec3::from_array(p)) - want).abs() < 1e-12,
                "{p:?}: {}",
                ball.at(DVec3::from_array(p))
            );
        }
        let sides = field(false, 0.25);
        for (p, want) in [([0.7, 2.7, 2.0], 1.0), ([0.9, 2.0, 0.0], 0.4), ([0.9, 2.0, 2.85], 0.2)] {
            assert!(
                (sides.at(DVec3::from_array(p)) - want).abs() < 1e-12,
                "{p:?}: {}",
                sides.at(DVec3::from_array(p))
            );
        }
        let mut rng = Rng::new(1, Stream::Measure, 39);
        for density in [ball, sides].map(|field| Density::Field(Arc::new(field))) {
            for _ in 0..100 {
                let [from, to] = [(); 2].map(|()| random_point(&mut rng, bounds.min - 1.0, bounds.max + 1.0));
                check_segments(&density, &Line::new(from, to - from).unwrap(), 9.0, &mut rng);
            }
        }
        for fade in [0.0, -1.0, 1.1, f64::NAN] {
            assert_eq!(Envelope::new(&bounds, true, fade), None);
        }
        assert_eq!(Envelope::new(&Bounds3::EMPTY, true, 0.5), None);
    }

    #[test]
    fn an_uneven_transform_is_bounded_too() {
        let octaves = Octaves { size: 1.0, finest: 1.0, seed: 3 };
        let even = NoiseField::new(octaves, false, (0.0, 1.0), DAffine3::IDENTITY).unwrap();
        assert!((even.slope() - NOISE_SLOPE).abs() < 1e-6);
        let flat = DAffine3::from_scale(DVec3::new(4.0, 1.0, 1.0));
        let uneven = NoiseField::new(octaves, false, (0.0, 1.0), flat).unwrap();
        assert!(uneven.slope() >= 4.0 * NOISE_SLOPE && uneven.slope() < 4.3 * NOISE_SLOPE);
    }

    #[test]
    fn what_is_no_density_is_refused() {
        let octaves = Octaves { size: 1.0, finest: 0.1, seed: 3 };
        let new = |octaves, levels| NoiseField::new(octaves, false, levels, DAffine3::IDENTITY);
        assert!(matches!(new(octaves, (1.0, 1.0)), Err(NoiseFieldError::Levels { .. })));
        assert!(matches!(new(octaves, (0.0, f64::NAN)), Err(NoiseFieldError::Levels { .. })));
        for (size, finest) in [(1.0, 0.0), (0.1, 1.0), (f64::INFINITY, 1.0), (f64::NAN, 1.0)] {
            let octaves = Octaves { size, finest, seed: 3 };
            assert!(matches!(new(octaves, (0.0, 1.0)), Err(NoiseFieldError::Sizes { .. })));
        }
        let nowhere = DAffine3::from_translation(DVec3::NAN);
        assert!(NoiseField::new(octaves, false, (0.0, 1.0), nowhere).is_err());
    }
}
