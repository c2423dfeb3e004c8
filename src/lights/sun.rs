//! Sun light: a disc that sends light from a small cone of directions.

use crate::math::{Frame, Rgb};
use crate::sampling::warp;
use glam::{Vec2, Vec3};
use std::f64::consts::PI;

/// Equal radiance from all directions within a cone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunLight {
    /// Unit direction to the centre of the disc.
    towards: Vec3,
    /// `1 - cos` of the angular radius.
    one_minus_cos: f32,
    /// Angular radius, radians.
    radius: f32,
    /// Radiance of the disc.
    pub radiance: Rgb,
}

impl SunLight {
    /// A disc with the angular `radius` (radians, in `(0, pi/2]`) in the unit direction `towards`, with this irradiance on a surface
    /// that faces it.
    pub fn new(towards: Vec3, radius: f64, irradiance: Rgb) -> Self {
        // The projected solid angle of the cone.
        let radiance = irradiance / (PI * radius.sin().powi(2)) as f32;
        Self { towards, one_minus_cos: one_minus_cos(radius) as f32, radius: radius as f32, radiance }
    }

    /// Unit direction to the centre of the disc.
    pub fn towards(&self) -> Vec3 {
        self.towards
    }

    /// Angular radius, radians.
    pub fn angular_radius(&self) -> f32 {
        self.radius
    }

    /// Samples a direction to the disc, uniformly over its solid angle.
    pub fn sample(&self, u: Vec2) -> Vec3 {
        Frame::from_z(self.towards).to_world(warp::square_to_cone(u, self.one_minus_cos))
    }

    /// Density per solid angle of [`Self::sample`] in all directions within the disc.
    pub fn pdf_inside(&self) -> f32 {
        warp::cone_pdf(self.one_minus_cos)
    }

    /// Solid angle of the disc.
    pub fn solid_angle(&self) -> f32 {
        1.0 / self.pdf_inside()
    }

    /// Whether the unit `direction` points into the disc.
    pub fn covers(&self, direction: Vec3) -> bool {
        // Computes 1 - cos as half the squared chord, which keeps its precision for narrow cones.
        0.5 * (direction - self.towards).length_squared() <= self.one_minus_cos
    }
}

fn one_minus_cos(angle: f64) -> f64 {
    2.0 * (0.5 * angle).sin().powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// The sun of the sky, and a sun that fills half of the sky.
    #[test]
    fn irradiance_is_what_was_asked_for() {
        let mut rng = Rng::new(6, Stream::Measure, 0);
        for radius in [0.2665f64.to_radians(), 0.5, PI / 2.0] {
            let sun = SunLight::new(Vec3::new(0.6, 0.0, 0.8), radius, Rgb::new(5.0, 4.0, 3.0));
            let (mut sum, n) = (0.0, 100_000);
            for _ in 0..n {
                let direction = sun.sample(rng.next_2d());
                // A direction exactly on the rim may miss the disc by rounding.
                assert!(sun.covers(direction + (sun.towards() - direction) * 1e-3));
                sum += f64::from(sun.radiance.x * direction.dot(sun.towards()) / sun.pdf_inside());
            }
            assert!((sum / f64::from(n) / 5.0 - 1.0).abs() < 5e-3, "{radius}");
            assert!(!sun.covers(Vec3::new(0.0, 1.0, 0.0)) || radius > 1.0);
        }
    }
}
