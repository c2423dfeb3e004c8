//! Emission of a medium whose temperature varies.

use super::density::Grid;
use crate::spectra::cie::black_body;
use glam::DVec3;

/// Steps of the table.
const STEPS: usize = 1024;

/// Highest temperature, kelvin: hotter ones are as bright.
const HOTTEST: f64 = 1e5;

/// How brightly a medium glows at each place, compared with its hottest one: a black body of the temperature there.
#[derive(Clone, Debug)]
pub struct Glow {
    temperature: Grid,
    /// Share of the radiance at the highest temperature, by channel, in even steps of the values of the grid up to that.
    shares: Vec<DVec3>,
    per_value: f64,
}

impl Glow {
    /// For temperatures in voxels, `kelvin` for a value of one. Also returns the radiance of the hottest place, a linear colour in units of
    /// 683 cd/m^2.
    pub fn new(temperature: Grid, kelvin: f64) -> (Self, DVec3) {
        let hottest = temperature.majorant();
        let radiance = |value: f64| black_body((value * kelvin).min(HOTTEST));
        let most = radiance(hottest);
        let share = |radiance: f64, most: f64| if most > 0.0 { (radiance / most).min(1.0) } else { 0.0 };
        let step = |i: usize| {
            let here = radiance(hottest * i as f64 / STEPS as f64);
            DVec3::new(share(here.x, most.x), share(here.y, most.y), share(here.z, most.z))
        };
        let per_value = if hottest > 0.0 { STEPS as f64 / hottest } else { 0.0 };
        (Self { temperature, shares: (0..=STEPS).map(step).collect(), per_value }, most)
    }

    /// Share of the radiance of the hottest place that the place `p` has, by channel.
    pub fn at(&self, p: DVec3) -> DVec3 {
        let place = (self.temperature.at(p) * self.per_value).clamp(0.0, STEPS as f64);
        let low = (place as usize).min(STEPS - 1);
        self.shares[low].lerp(self.shares[low + 1], place - low as f64)
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> usize {
        self.temperature.memory() + size_of_val(&self.shares[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::GridBuilder;
    use glam::{DAffine3, IVec3};

    #[test]
    fn places_glow_as_their_temperature_says() {
        let mut builder = GridBuilder::default();
        builder.dense(IVec3::ZERO, IVec3::splat(8), |v| 500.0 + 250.0 * v.x as f32).unwrap();
        let (glow, most) = Glow::new(builder.finish(DAffine3::IDENTITY).unwrap().0, 1.0);
        assert_eq!(most, black_body(2250.0));
        for x in [0.0, 2.5, 3.7, 6.9, 7.0] {
            let (found, want) = (most * glow.at(DVec3::new(x, 3.0, 3.0)), black_body(500.0 + 250.0 * x));
            assert!(
                (found - want).abs().max_element() < 1e-3 * want.max_element() + 1e-7 * most.x,
                "{x}: {found} {want}"
            );
        }
        assert_eq!(glow.at(DVec3::splat(20.0)), DVec3::ZERO);
    }
}
