use super::Octaves;
use crate::math::Rgb;
use glam::{DAffine3, DVec3};
use std::f64::consts::TAU;

/// A pattern between two colours, in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidTexture {
    /// What varies.
    pub pattern: Pattern,
    /// Colour where the pattern is 0.
    pub low: Rgb,
    /// Colour where it is 1.
    pub high: Rgb,
    /// From the world, in metres, to the texture's own space.
    pub to_texture: DAffine3,
}

/// A function of the place with values in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Clouds: a sum of octaves.
    Noise(Octaves),
    /// A sum of absolute octaves, with creases.
    Turbulence(Octaves),
    /// Layers across the x axis that turbulence has bent.
    Marble {
        /// What bends the layers.
        octaves: Octaves,
        /// Distance from one vein to the next.
        spacing: f64,
        /// How far turbulence of 1 shifts the layers, in spacings.
        distortion: f64,
        /// Higher powers make narrower veins.
        sharpness: f64,
    },
    /// Rings around the z axis, a little out of round, with fibres along it.
    Wood {
        /// What bends the rings.
        octaves: Octaves,
        /// Distance from one ring to the next.
        spacing: f64,
        /// How far noise of 1 shifts the rings, in spacings.
        distortion: f64,
    },
}

impl Pattern {
    /// Value at `p` of the texture's own space, in [0, 1].
    pub fn value(&self, p: DVec3) -> f64 {
        match *self {
            Self::Noise(octaves) => (0.5 + 0.5 * octaves.fractal(p)).clamp(0.0, 1.0),
            Self::Turbulence(octaves) => octaves.turbulence(p).min(1.0),
            Self::Marble { octaves, spacing, distortion, sharpness } => {
                let phase = p.x / spacing + distortion * octaves.turbulence(p);
                (0.5 + 0.5 * (TAU * phase).cos()).powf(sharpness)
            }
            Self::Wood { octaves, spacing, distortion } => {
                // Slow along the trunk.
                let bent = octaves.fractal(p * DVec3::new(1.0, 1.0, 0.1));
                let ring = p.truncate().length() / spacing + distortion * bent;
                // Early wood turns dark gradually, and ends at once; the edge is as wide as the finest octave.
                let share = ring - ring.floor();
                let edge = (octaves.finest / spacing).clamp(1e-3, 0.5);
                let rise = (share / (1.0 - edge)).min(1.0);
                let fall = ((1.0 - share) / edge).min(1.0);
                let fibre = octaves.fractal(p * DVec3::new(6.0, 6.0, 0.3));
                (0.85 * rise * rise * fall + 0.15 * (0.5 + 0.5 * fibre)).clamp(0.0, 1.0)
            }
        }
    }

    /// The finest detail.
    fn finest(&self) -> f64 {
        match self {
            Self::Noise(octaves)
            | Self::Turbulence(octaves)
            | Self::Marble { octaves, .. }
            | Self::Wood { octaves, .. } => octaves.finest,
        }
    }
}

impl SolidTexture {
    /// Value of the pattern at a place of the world, in [0, 1].
    pub fn value(&self, world: DVec3) -> f64 {
        self.pattern.value(self.to_texture.transform_point3(world))
    }

    /// Colour at a place of the world.
    pub fn colour(&self, world: DVec3) -> Rgb {
        self.low.lerp(self.high, self.value(world) as f32)
    }

    /// How the pattern changes per metre along the three axes of the world, from differences over a tenth of its finest
    /// detail.
    pub fn gradient(&self, world: DVec3) -> DVec3 {
        let [x, y, z] =
            [self.to_texture.matrix3.x_axis, self.to_texture.matrix3.y_axis, self.to_texture.matrix3.z_axis];
        let stretch = x.length().max(y.length()).max(z.length());
        let step = 0.05 * self.pattern.finest() / stretch;
        let change =
            |axis: DVec3| (self.value(world + step * axis) - self.value(world - step * axis)) / (2.0 * step);
        DVec3::new(change(DVec3::X), change(DVec3::Y), change(DVec3::Z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patterns() -> [Pattern; 4] {
        let octaves = Octaves { size: 1.0, finest: 0.05, seed: 1 };
        [
            Pattern::Noise(octaves),
            Pattern::Turbulence(octaves),
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
                let value = pattern.value(p);
                assert!((0.0..=1.0).contains(&value), "{pattern:?} {value}");
                let step = (pattern.value(p + 1e-6) - value).abs();
                assert!(step < 1e-3, "{pattern:?} jumps by {step} at {p}");
                (low, high) = (low.min(value), high.max(value));
            }
            assert!(high - low > 0.5, "{pattern:?}: {low} to {high}");
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
            let slope = (texture.value(p + h * along) - texture.value(p - h * along)) / (2.0 * h);
            assert!((texture.gradient(p).dot(along) - slope).abs() < 0.1, "{p}");
        }
    }
}
