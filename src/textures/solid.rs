//! Solid textures: colours and patterns as functions of the position in space.

use super::Octaves;
use super::noise::kept;
use crate::math::Rgb;
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;

/// A solid texture: a pattern in space that blends two colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidTexture {
    /// The pattern.
    pub pattern: Pattern,
    /// Colour at a pattern value of 0.
    pub low: Rgb,
    /// Colour at a pattern value of 1.
    pub high: Rgb,
    /// Transform from the world, in metres, to texture space.
    pub to_texture: DAffine3,
}

/// A function of the position with values in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// A sum of octaves of noise, like clouds.
    Noise(Octaves),
    /// A sum of absolute octaves, which has creases.
    Turbulence(Octaves),
    /// Layers perpendicular to the x axis, distorted by turbulence.
    Marble {
        /// Turbulence that distorts the layers.
        octaves: Octaves,
        /// Distance from one vein to the next.
        spacing: f64,
        /// Shift of the layers for a turbulence of 1, in spacings.
        distortion: f64,
        /// Exponent of the profile; a larger one makes narrower veins.
        sharpness: f64,
    },
    /// Waves on water, as functions of x and z: a sum of sines whose wavelengths go from `size` down to `finest` in a geometric series.
    /// Their directions lie within 60 degrees of the x axis, and the amplitude of each is in proportion to its wavelength to the power
    /// 3/2. Directions and phases are hashes of the seed.
    Waves(Octaves),
    /// Rings around the z axis, distorted by noise, with fibres along the axis.
    Wood {
        /// Noise that distorts the rings.
        octaves: Octaves,
        /// Distance from one ring to the next.
        spacing: f64,
        /// Shift of the rings for a noise of 1, in spacings.
        distortion: f64,
    },
}

impl Pattern {
    /// Value at `p` in texture space, in [0, 1], filtered to the footprint `width` (0 for all detail). Finer waves are replaced by their
    /// mean, so that distant surfaces are not noisy and keep their mean colour.
    pub fn value(&self, p: DVec3, width: f64) -> f64 {
        match *self {
            Self::Noise(octaves) => (0.5 + 0.5 * octaves.fractal(p, width)).clamp(0.0, 1.0),
            Self::Turbulence(octaves) => octaves.turbulence(p, width).min(1.0),
            Self::Waves(octaves) => waves(octaves, p, width),
            Self::Marble { octaves, spacing, distortion, sharpness } => {
                let vein = |phase: f64| (0.5 + 0.5 * (TAU * phase).cos()).powf(sharpness);
                // Midpoint rule with sixteen parts of a period, which suffices for a smooth function.
                let mean = || (0..16).map(|i| vein((f64::from(i) + 0.5) / 16.0)).sum::<f64>() / 16.0;
                mixed(kept(spacing, width), mean, || {
                    vein(p.x / spacing + distortion * octaves.turbulence(p, width))
                })
            }
            Self::Wood { octaves, spacing, distortion } => {
                // Early wood darkens gradually and ends abruptly. The edge is as wide as the finest octave or the footprint.
                let edge_of = |finest: f64| (finest / spacing).clamp(1e-3, 0.5);
                let edge = edge_of(octaves.finest.max(width));
                let mean = |edge: f64| 1.0 / 3.0 + edge / 6.0;
                let kept_mean = mean(edge_of(octaves.finest));
                let rings = mixed(
                    kept(spacing, width),
                    || kept_mean,
                    || {
                        // The distortion varies slowly along the trunk.
                        let bent = octaves.fractal(p * DVec3::new(1.0, 1.0, 0.1), width);
                        let ring = p.truncate().length() / spacing + distortion * bent;
                        let share = ring - ring.floor();
                        let rise = (share / (1.0 - edge)).min(1.0);
                        let fall = ((1.0 - share) / edge).min(1.0);
                        rise * rise * fall + (kept_mean - mean(edge))
                    },
                );
                let fibre = octaves.fractal(p * DVec3::new(6.0, 6.0, 0.3), 6.0 * width);
                (0.85 * rings + 0.15 * (0.5 + 0.5 * fibre)).clamp(0.0, 1.0)
            }
        }
    }

    /// The finest wavelength.
    fn finest(&self) -> f64 {
        match self {
            Self::Noise(octaves)
            | Self::Turbulence(octaves)
            | Self::Waves(octaves)
            | Self::Marble { octaves, .. }
            | Self::Wood { octaves, .. } => octaves.finest,
        }
    }
}

/// Number of sines in [`Pattern::Waves`].
const WAVES: u32 = 32;

/// Value of [`Pattern::Waves`] in [0, 1]; the root mean square of its deviation from one half is an eighth.
fn waves(octaves: Octaves, p: DVec3, width: f64) -> f64 {
    let Octaves { size, finest, seed } = octaves;
    let ratio = (finest / size).min(1.0).powf(1.0 / f64::from(WAVES - 1));
    let unit = |number: u32| f64::from(hashed(seed, number)) / 4_294_967_296.0;
    let (mut sum, mut power) = (0.0, 0.0);
    for i in 0..WAVES {
        let wavelength = size * ratio.powi(i as i32);
        let amplitude = wavelength.powf(1.5);
        power += 0.5 * amplitude * amplitude;
        let share = kept(wavelength, width);
        if share == 0.0 {
            continue;
        }
        let angle = (unit(2 * i) - 0.5) * (2.0 * TAU / 6.0);
        let along = p.x * angle.cos() + p.z * angle.sin();
        let phase = along / wavelength + unit(2 * i + 1);
        sum += amplitude * share * (TAU * (phase - phase.floor())).sin();
    }
    // Four standard deviations fill the interval; rarer crests are cut.
    (0.5 + 0.125 * sum / power.sqrt()).clamp(0.0, 1.0)
}

/// A hash of a seed and a number.
fn hashed(seed: u32, number: u32) -> u32 {
    let mut h = seed ^ number.wrapping_mul(0x9e37_79b9);
    for _ in 0..2 {
        h = (h ^ h >> 16).wrapping_mul(0x85eb_ca6b);
        h = (h ^ h >> 13).wrapping_mul(0xc2b2_ae35);
    }
    h ^ h >> 16
}

/// Blend of a wave and its mean; `kept` is the share of the wave.
fn mixed(kept: f64, mean: impl FnOnce() -> f64, wave: impl FnOnce() -> f64) -> f64 {
    match kept {
        1.0 => wave(),
        0.0 => mean(),
        _ => kept * wave() + (1.0 - kept) * mean(),
    }
}

impl SolidTexture {
    /// Scale factor of lengths from the world to texture space: the largest over the axes.
    fn stretch(&self) -> f64 {
        let axes = self.to_texture.matrix3;
        axes.x_axis.length().max(axes.y_axis.length()).max(axes.z_axis.length())
    }

    /// Value of the pattern at a position in the world, in [0, 1], filtered to the footprint `width` in metres.
    pub fn value(&self, world: DVec3, width: f64) -> f64 {
        self.pattern.value(self.to_texture.transform_point3(world), width * self.stretch())
    }

    /// Colour at a position in the world, filtered to the footprint `width` in metres.
    pub fn colour(&self, world: DVec3, width: f64) -> Rgb {
        self.low.lerp(self.high, self.value(world, width) as f32)
    }

    /// Gradient of the pattern per metre along the three axes of the world. It comes from central differences over a tenth of the finest
    /// detail or of `width`, whichever is larger, in metres.
    pub fn gradient(&self, world: DVec3, width: f64) -> DVec3 {
        let step = 0.05 * (self.pattern.finest() / self.stretch()).max(width);
        let value = |at: DVec3| self.value(at, width);
        let change = |axis: DVec3| (value(world + step * axis) - value(world - step * axis)) / (2.0 * step);
        DVec3::new(change(DVec3::X), change(DVec3::Y), change(DVec3::Z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patterns() -> [Pattern; 5] {
        let octaves = Octaves { size: 1.0, finest: 0.05, seed: 1 };
        [
            Pattern::Noise(octaves),
            Pattern::Turbulence(octaves),
            Pattern::Waves(octaves),
            Pattern::Marble { octaves, spacing: 0.5, distortion: 1.0, sharpness: 2.0 },
            Pattern::Wood { octaves, spacing: 0.2, distortion: 0.3 },
        ]
    }

    #[test]
    fn values_fill_the_unit_interval_and_are_continuous() {
        for pattern in patterns() {
            let (mut low, mut high) = (1.0f64, 0.0f64);
            for i in 0..20_000 {
                let p = DVec3::new(0.0137, 0.0051, 0.0071) * f64::from(i);
                let value = pattern.value(p, 0.0);
                assert!((0.0..=1.0).contains(&value), "{pattern:?} {value}");
                let step = (pattern.value(p + 1e-6, 0.0) - value).abs();
                assert!(step < 1e-3, "{pattern:?} jumps by {step} at {p}");
                (low, high) = (low.min(value), high.max(value));
            }
            assert!(high - low > 0.5, "{pattern:?}: {low} to {high}");
        }
    }

    #[test]
    fn widths_take_detail_and_leave_the_mean() {
        for pattern in patterns() {
            let spread_of = |width: f64| {
                let count = 20_000;
                let values = (0..count).map(|i| {
                    // A low-discrepancy sequence in three dimensions (Roberts).
                    let at = DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * f64::from(i);
                    pattern.value(40.0 * (at - at.floor()), width)
                });
                let (sum, squares) = values.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
                let mean = sum / f64::from(count);
                (mean, (squares / f64::from(count) - mean * mean).max(0.0).sqrt())
            };
            let (mean, whole) = spread_of(0.0);
            let mut before = whole;
            for width in [0.1, 0.4, 1.0, 4.0] {
                let (seen, spread) = spread_of(width);
                assert!((seen - mean).abs() < 0.02, "{pattern:?} at {width}: {seen} for {mean}");
                assert!(spread < before + 0.01, "{pattern:?} at {width}: {spread} after {before}");
                before = spread;
            }
            assert!(before < 1e-6 && whole > 0.05, "{pattern:?}: {before} of {whole}");
            // Extreme widths: no detail, or all of it.
            let p = DVec3::new(1.3, 0.7, -2.1);
            let (seen, one) = (pattern.value(p, f64::INFINITY), pattern.value(p, 4.0));
            assert!((seen - one).abs() < 1e-12, "{pattern:?}: {seen} for {one}");
            assert_eq!(pattern.value(p, f64::MIN_POSITIVE), pattern.value(p, 0.0), "{pattern:?}");
            let texture =
                SolidTexture { pattern, low: Rgb::ZERO, high: Rgb::ONE, to_texture: DAffine3::IDENTITY };
            for width in [0.0, 1e-300, 1e300, f64::INFINITY] {
                assert!(texture.gradient(p, width).is_finite(), "{pattern:?} at {width}");
            }
            // The value is continuous in the width.
            for i in 0..200 {
                let (p, width) = (DVec3::splat(0.37 * f64::from(i)), 0.01 * f64::from(i));
                let step = (pattern.value(p, width + 1e-9) - pattern.value(p, width)).abs();
                assert!(step < 1e-6, "{pattern:?} jumps by {step} at {width}");
            }
        }
    }

    #[test]
    fn gradient_follows_the_value() {
        let to_texture = DAffine3::from_scale(DVec3::new(2.0, 3.0, 0.5));
        let pattern = Pattern::Noise(Octaves { size: 1.0, finest: 0.9, seed: 4 });
        let texture = SolidTexture { pattern, low: Rgb::ZERO, high: Rgb::ONE, to_texture };
        for i in 0..100 {
            let p = DVec3::new(0.31, 0.17, 0.23) * f64::from(i);
            let along = DVec3::new(0.6, -0.3, 0.5);
            let h = 1e-6;
            let slope = (texture.value(p + h * along, 0.0) - texture.value(p - h * along, 0.0)) / (2.0 * h);
            assert!((texture.gradient(p, 0.0).dot(along) - slope).abs() < 0.1, "{p}");
        }
    }
}
