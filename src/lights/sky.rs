//! Clear sky and the sun in it.
//!
//! The sky is the model of Hosek & Wilkie ("An Analytic Model for Full Spectral Sky-Dome Radiance", SIGGRAPH 2012). The sun outside of
//! the atmosphere is a black body; the air attenuates it by the formulae of Preetham, Shirley & Smits ("A Practical Analytic Model for
//! Daylight", SIGGRAPH 1999, appendix A.1) for molecules, aerosols and ozone. Gases and vapour, which absorb almost nothing between 380
//! and 690 nm, are neglected.
//!
//! Both are photometric: a channel of 1 W/(m^2 sr) corresponds to 683 cd/m^2, as in the data of the sky model.

use super::environment::EnvironmentMap;
use crate::math::Rgb;
use crate::sampling::square_to_direction;
use glam::{DMat3, DVec3, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use std::f64::consts::PI;

/// Mean angular radius of the sun, radians: 0.2665 degrees.
pub const SUN_ANGULAR_RADIUS: f64 = 0.2665 * PI / 180.0;

/// Temperature of a black body with the sun's radiance, kelvin.
const SUN_TEMPERATURE: f64 = 5778.0;

/// Wavelengths at which the sun's spectrum is sampled: first, step and count, nm.
const WAVELENGTHS: (f64, f64, usize) = (380.0, 10.0, 40);

/// Absorption by ozone, 1/cm, from 440 nm in steps of 10 nm (as tabulated by Iqbal, "An Introduction to Solar Radiation",
/// 1983, and used by Preetham et al.); zero below.
const OZONE: [f64; 34] = [
    0.0, 0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120,
    0.115, 0.125, 0.120, 0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011,
    0.010, 0.009, 0.007, 0.004,
];

/// Thickness of the ozone column above the ground, cm.
const OZONE_COLUMN: f64 = 0.35;

/// A clear sky.
#[derive(Clone, Debug)]
pub struct Sky {
    model: SkyState,
    towards: DVec3,
    turbidity: f64,
    albedo: Rgb,
}

impl Sky {
    /// A sky with the sun at `elevation` above the horizon and `azimuth` from -z towards +x (radians), for a turbidity from 1 (pure air)
    /// to 10 (haze) and a ground with the reflectance `albedo`. `None` where a value is out of range.
    pub fn new(elevation: f64, azimuth: f64, turbidity: f64, albedo: Rgb) -> Option<Self> {
        if !(0.0..=PI / 2.0).contains(&elevation) {
            return None;
        }
        let params = SkyParams {
            elevation: (elevation as f32).min(std::f32::consts::FRAC_PI_2),
            turbidity: turbidity as f32,
            albedo: albedo.to_array(),
        };
        let model = SkyState::new(&params).ok()?;
        let (sin, cos) = elevation.sin_cos();
        let towards = DVec3::new(cos * azimuth.sin(), sin, -cos * azimuth.cos());
        Some(Self { model, towards, turbidity, albedo })
    }

    /// Unit direction to the sun.
    pub fn towards_sun(&self) -> DVec3 {
        self.towards
    }

    /// Radiance of the sky without the sun's disc, in a unit direction above the horizon.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let theta = direction.y.clamp(0.0, 1.0).acos();
        // Computed from the chord, which keeps its precision near the sun.
        let gamma = 2.0 * (0.5 * (direction.as_dvec3() - self.towards).length()).clamp(0.0, 1.0).asin();
        let of = |channel| self.model.radiance(theta, gamma as f32, channel).max(0.0);
        Rgb::new(of(Channel::R), of(Channel::G), of(Channel::B))
    }

    /// Irradiance by the sun's disc alone on a surface that faces it.
    pub fn sun_irradiance(&self) -> DVec3 {
        let solid_angle = PI * SUN_ANGULAR_RADIUS.sin().powi(2);
        let zenith = self.towards.y.clamp(-1.0, 1.0).acos();
        let mass = air_mass(zenith);
        let aerosol = 0.046_08 * self.turbidity - 0.045_86;
        let (first, step, count) = WAVELENGTHS;
        let mut xyz = DVec3::ZERO;
        for index in 0..count {
            let nm = first + step * index as f64;
            let um = nm / 1000.0;
            let molecules = 0.008_735 * um.powf(-4.08);
            let aerosols = aerosol.max(0.0) * um.powf(-1.3);
            let from_ozone = ((nm - 440.0) / 10.0).max(0.0) as usize;
            let ozone = OZONE.get(from_ozone).copied().unwrap_or(0.0) * OZONE_COLUMN;
            let transmittance = (-(molecules + aerosols + ozone) * mass).exp();
            xyz += matching(nm) * (planck(nm) * transmittance * solid_angle * step);
        }
        to_rgb(xyz).max(DVec3::ZERO)
    }

    /// The whole environment as a map of `2 height` by `height` pixels: the sky, and below the horizon the radiance of a Lambertian
    /// ground under it, which the sun also lights if `with_sun`.
    pub fn map(&self, height: usize, with_sun: bool) -> Option<EnvironmentMap> {
        let width = 2 * height;
        let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
        let (mut texels, mut irradiance) = (Vec::with_capacity(width * height), DVec3::ZERO);
        let area = (PI / height as f64) * (PI / height as f64);
        for row in 0..height / 2 {
            for column in 0..width {
                let (direction, sine) = square_to_direction(at(column, width), at(row, height));
                let radiance = self.radiance(direction);
                irradiance += radiance.as_dvec3() * (sine * f64::from(direction.y) * area);
                texels.push(radiance);
            }
        }
        if with_sun {
            irradiance += self.sun_irradiance() * self.towards.y;
        }
        let ground = (irradiance / PI).as_vec3() * self.albedo;
        texels.resize(width * height, ground);
        EnvironmentMap::new(width, texels).0
    }
}

/// Relative path length through the air at an angle to the zenith, radians (Kasten 1965, as in Preetham et al.).
fn air_mass(zenith: f64) -> f64 {
    1.0 / (zenith.cos().max(0.0) + 0.15 * (93.885 - zenith.to_degrees()).max(0.1).powf(-1.253))
}

/// Radiance of a black body with the sun's temperature, W/(m^2 sr nm).
fn planck(nm: f64) -> f64 {
    const TWO_H_C_SQUARED: f64 = 1.191_042_972e-16;
    const H_C_OVER_K: f64 = 1.438_776_877e-2;
    let m = nm * 1e-9;
    TWO_H_C_SQUARED / (m.powi(5) * (H_C_OVER_K / (m * SUN_TEMPERATURE)).exp_m1()) * 1e-9
}

/// CIE 1931 colour matching functions in the analytic approximation of Wyman, Sloan & Shirley (JCGT 2(2), 2013).
fn matching(nm: f64) -> DVec3 {
    let lobe = |center: f64, below: f64, above: f64| {
        let t = (nm - center) / if nm < center { below } else { above };
        (-0.5 * t * t).exp()
    };
    DVec3::new(
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8),
    )
}

/// CIE XYZ to linear Rec. 709.
fn to_rgb(xyz: DVec3) -> DVec3 {
    DMat3::from_cols(
        DVec3::new(3.240_970, -0.969_244, 0.055_630),
        DVec3::new(-1.537_383, 1.875_968, -0.203_977),
        DVec3::new(-0.498_611, 0.041_555, 1.056_972),
    ) * xyz
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(rgb: DVec3) -> f64 {
        rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
    }

    fn sky(elevation: f64, turbidity: f64) -> Sky {
        Sky::new(elevation.to_radians(), 0.3, turbidity, Rgb::splat(0.2)).unwrap()
    }

    /// Above the air: 1361 W/m^2 in total, and about 128 klx.
    #[test]
    fn the_sun_outside_of_the_air() {
        let solid_angle = PI * SUN_ANGULAR_RADIUS.sin().powi(2);
        let total: f64 = (0..100_000).map(|i| planck(100.0 + f64::from(i) * 0.2) * 0.2 * solid_angle).sum();
        assert!((total / 1361.0 - 1.0).abs() < 0.02, "{total}");
        let visible: f64 =
            (380..780).map(|nm| matching(f64::from(nm)).y * planck(f64::from(nm)) * solid_angle).sum();
        assert!((visible * 683.0 / 130e3 - 1.0).abs() < 0.05, "{}", visible * 683.0);
    }

    /// Illuminances agree with handbook values for clear days, and a low sun in haze is red.
    #[test]
    fn daylight_is_as_bright_as_it_is() {
        let klx = |rgb: DVec3| luminance(rgb) * 0.683;
        let noon = sky(60.0, 3.0);
        let sun = klx(noon.sun_irradiance());
        assert!((70.0..110.0).contains(&sun), "{sun}");
        let dome = noon.map(64, false).unwrap();
        let mut up = DVec3::ZERO;
        for y in 0..200 {
            for x in 0..400 {
                let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
                let (direction, sine) = square_to_direction(at(x, 400), at(y, 400));
                let area = PI * PI * sine / (200.0 * 400.0) * f64::from(direction.y);
                up += dome.radiance(direction).as_dvec3() * area;
            }
        }
        assert!((8.0..30.0).contains(&klx(up)), "{}", klx(up));
        let low = sky(5.0, 4.0).sun_irradiance();
        assert!(low.x > 2.0 * low.z && klx(low) < 0.5 * sun, "{low}");
        assert!(klx(sky(60.0, 8.0).sun_irradiance()) < sun);
        // The zenith is blue.
        let zenith = noon.radiance(Vec3::Y);
        assert!(zenith.z > 1.5 * zenith.x, "{zenith}");
    }

    #[test]
    fn the_sun_is_where_it_was_put() {
        let sky = sky(30.0, 3.0);
        let towards = sky.towards_sun();
        assert!((towards.y - 0.5).abs() < 1e-12 && (towards.length() - 1.0).abs() < 1e-12);
        assert!(towards.x > 0.0 && towards.z < 0.0);
        let beside = sky.radiance(towards.as_vec3());
        assert!(beside.y > 3.0 * sky.radiance(Vec3::new(0.0, 0.5, 0.866)).y);
        for odd in [(-0.1, 3.0), (0.5, 0.5), (0.5, 11.0), (2.0, 3.0), (f64::NAN, 3.0)] {
            assert!(Sky::new(odd.0, 0.0, odd.1, Rgb::ZERO).is_none(), "{odd:?}");
        }
    }
}
