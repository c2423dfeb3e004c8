//! Skies of the CIE by their luminance: the clear one (Kittler 1967), the intermediate one (Nakamura & Oki 1985) and the overcast one (Moon
//! & Spencer 1942), as light engineers compare daylight by them.
//!
//! The formulae give luminances over that of the zenith. The strength is an irradiance on the ground, which may come from the usual daylight
//! by the elevation of the sun (IES RP-21-1984).

use super::environment::EnvironmentMap;
use crate::math::Rgb;
use crate::sampling::square_to_direction;
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// One of the skies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CieSkyKind {
    /// Without clouds.
    Clear,
    /// Thin clouds, through which the sun shows.
    Intermediate,
    /// Even clouds, which hide the sun. Three times as bright in the zenith as at the horizon.
    Overcast,
}

/// A sky with the sun at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CieSky {
    kind: CieSkyKind,
    /// Unit direction to the sun.
    towards: DVec3,
}

/// Radians above the horizon at which formulae that divide by the sine end.
const LOWEST: f64 = 0.01;

impl CieSky {
    /// A sky with the sun at `elevation` above the horizon and `azimuth` from -z towards +x (radians); `None` where it is not up.
    pub fn new(kind: CieSkyKind, elevation: f64, azimuth: f64) -> Option<Self> {
        if !(0.0..=FRAC_PI_2).contains(&elevation) || !azimuth.is_finite() {
            return None;
        }
        let (sin, cos) = elevation.sin_cos();
        Some(Self { kind, towards: DVec3::new(cos * azimuth.sin(), sin, -cos * azimuth.cos()) })
    }

    /// Unit direction to the sun.
    pub fn towards_sun(&self) -> DVec3 {
        self.towards
    }

    /// Usual illuminance of the sky alone on level ground, lx.
    pub fn usual_illuminance(&self) -> f64 {
        let sine = self.towards.y.max(0.0);
        match self.kind {
            CieSkyKind::Clear => 800.0 + 15_500.0 * sine.sqrt(),
            CieSkyKind::Intermediate => 300.0 + 45_000.0 * sine,
            CieSkyKind::Overcast => 300.0 + 21_000.0 * sine,
        }
    }

    /// Usual illuminance of the sun alone on a surface that faces it, lx.
    pub fn usual_sun(&self) -> f64 {
        let extinction = match self.kind {
            CieSkyKind::Clear => 0.21,
            CieSkyKind::Intermediate => 0.8,
            CieSkyKind::Overcast => return 0.0,
        };
        127_500.0 * (-extinction / self.towards.y.max(1e-3)).exp()
    }

    /// Luminance in a unit direction above the horizon, over that of the zenith.
    pub fn relative_luminance(&self, direction: Vec3) -> f64 {
        let sine = f64::from(direction.y).clamp(0.0, 1.0);
        // From the chord, which keeps its precision near the sun.
        let apart = 2.0 * (0.5 * (direction.as_dvec3() - self.towards).length()).clamp(0.0, 1.0).asin();
        self.value(sine.asin(), apart) / self.value(FRAC_PI_2, self.towards.y.clamp(-1.0, 1.0).acos())
    }

    /// The formula at an elevation and an angle from the sun, radians.
    fn value(&self, elevation: f64, from_sun: f64) -> f64 {
        let sun = self.towards.y.clamp(0.0, 1.0).asin();
        match self.kind {
            CieSkyKind::Clear => {
                let around = 0.91 + 10.0 * (-3.0 * from_sun).exp() + 0.45 * from_sun.cos().powi(2);
                around * (1.0 - (-0.32 / elevation.sin().max(LOWEST.sin())).exp())
            }
            CieSkyKind::Intermediate => {
                let over = (1.35 * (3.59 * elevation - 0.009).sin() + 3.12) * (2.6 * sun + 0.316).sin();
                let around = (-0.563 * from_sun * ((sun - 0.008) * (elevation + 1.059) + 0.812)).exp();
                (over + elevation + 4.799) / 2.326 * around
            }
            CieSkyKind::Overcast => (1.0 + 2.0 * elevation.sin()) / 3.0,
        }
    }

    /// The whole environment as a map of `2 height` by `height` pixels: the sky, which gives the `irradiance` on level ground, and below the
    /// horizon the radiance of a Lambertian ground with this `albedo`, which a sun with the irradiance `sun` on a surface that faces it
    /// lights as well.
    pub fn map(&self, height: usize, irradiance: DVec3, sun: DVec3, albedo: Rgb) -> Option<EnvironmentMap> {
        let width = 2 * height;
        let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
        let (mut luminances, mut total) = (Vec::with_capacity(width * height), 0.0);
        let area = (PI / height as f64) * (PI / height as f64);
        for row in 0..height / 2 {
            for column in 0..width {
                let (direction, sine) = square_to_direction(at(column, width), at(row, height));
                let luminance = self.relative_luminance(direction);
                total += luminance * (sine * f64::from(direction.y) * area);
                luminances.push(luminance);
            }
        }
        let radiance = |luminance: f64| (irradiance * (luminance / total)).as_vec3();
        let mut texels: Vec<Rgb> = luminances.into_iter().map(radiance).collect();
        let ground = ((irradiance + sun * self.towards.y) / PI).as_vec3() * albedo;
        texels.resize(width * height, ground);
        EnvironmentMap::new(width, texels).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sky(kind: CieSkyKind, elevation: f64) -> CieSky {
        CieSky::new(kind, elevation.to_radians(), 0.7).unwrap()
    }

    fn direction(elevation: f64, azimuth: f64) -> Vec3 {
        let ((sin, cos), (east, north)) = (elevation.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
        DVec3::new(cos * east, sin, -cos * north).as_vec3()
    }

    const KINDS: [CieSkyKind; 3] = [CieSkyKind::Clear, CieSkyKind::Intermediate, CieSkyKind::Overcast];

    /// Every sky has the irradiance that it is given; an overcast zenith has 9/7 of the mean luminance of an even sky.
    #[test]
    fn skies_give_what_they_are_given() {
        let given = DVec3::new(30.0, 20.0, 10.0);
        for kind in KINDS {
            for elevation in [10.0, 45.0, 85.0] {
                let map = sky(kind, elevation).map(256, given, DVec3::ZERO, Rgb::splat(0.5)).unwrap();
                let (mut up, mut down) = (DVec3::ZERO, DVec3::ZERO);
                let (columns, rows) = (600, 300);
                for row in 0..rows {
                    for column in 0..columns {
                        let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
                        let (direction, sine) = square_to_direction(at(column, columns), at(row, rows));
                        let area = PI * 2.0 * PI * sine / (columns * rows) as f64;
                        let found = map.radiance(direction).as_dvec3() * (area * f64::from(direction.y));
                        *(if direction.y > 0.0 { &mut up } else { &mut down }) += found;
                    }
                }
                assert!((up / given - 1.0).abs().max_element() < 0.01, "{kind:?} {elevation}: {up}");
                assert!((down / given + 0.5).abs().max_element() < 0.01, "{kind:?} {elevation}: {down}");
                if kind == CieSkyKind::Overcast {
                    let zenith = map.radiance(direction(89.9, 0.0)).as_dvec3();
                    assert!((zenith * PI / given - 9.0 / 7.0).abs().max_element() < 0.01, "{zenith}");
                }
            }
        }
    }

    /// The clear sky is type 12 of ISO 15469, with the same gradation and the indicatrix in its older form: values of that standard for the
    /// sun at 60 degrees from the zenith, by its own formula, within the two per cent by which the forms differ.
    #[test]
    fn luminances_over_that_of_the_zenith() {
        let clear = sky(CieSkyKind::Clear, 30.0);
        let standard = |z: f64, apart: f64| {
            let gradation = |z: f64| 1.0 - (-0.32 / z.cos()).exp();
            let indicatrix =
                |x: f64| 1.0 + 10.0 * ((-3.0 * x).exp() - (-3.0 * FRAC_PI_2).exp()) + 0.45 * x.cos().powi(2);
            gradation(z) * indicatrix(apart) / (gradation(0.0) * indicatrix(60f64.to_radians()))
        };
        let sun = clear.towards_sun();
        for (elevation, azimuth) in [(5.0, 0.0), (20.0, 40.0), (45.0, 200.0), (70.0, 300.0), (30.0, 60.0)] {
            let at = direction(elevation, azimuth);
            let apart = at.as_dvec3().dot(sun).clamp(-1.0, 1.0).acos();
            let want = standard((90.0f64 - elevation).to_radians(), apart);
            let found = clear.relative_luminance(at);
            assert!((found / want - 1.0).abs() < 0.02, "{elevation} {azimuth}: {found} {want}");
        }
        for kind in KINDS {
            assert!((sky(kind, 40.0).relative_luminance(Vec3::Y) - 1.0).abs() < 1e-6);
        }
        assert!(
            (sky(CieSkyKind::Overcast, 40.0).relative_luminance(direction(0.0, 0.0)) - 1.0 / 3.0).abs()
                < 1e-6
        );
        // Brightest towards the sun, and darkest on the other side, where the intermediate sky is more even.
        let beside = |kind| {
            let sky = sky(kind, 40.0);
            let other = DVec3::new(-sky.towards.x, sky.towards.y, -sky.towards.z).as_vec3();
            sky.relative_luminance(sky.towards.as_vec3()) / sky.relative_luminance(other)
        };
        assert!(beside(CieSkyKind::Clear) > beside(CieSkyKind::Intermediate));
        assert!(beside(CieSkyKind::Intermediate) > 2.0);
    }

    #[test]
    fn usual_daylight() {
        let noon = sky(CieSkyKind::Clear, 60.0);
        assert!(
            (80e3..110e3).contains(&noon.usual_sun()) && (12e3..16e3).contains(&noon.usual_illuminance())
        );
        assert_eq!(sky(CieSkyKind::Overcast, 90.0).usual_illuminance(), 21_300.0);
        assert_eq!(sky(CieSkyKind::Overcast, 30.0).usual_sun(), 0.0);
        for (elevation, azimuth) in [(-0.1, 0.0), (1.6, 0.0), (f64::NAN, 0.0), (0.5, f64::INFINITY)] {
            assert!(CieSky::new(CieSkyKind::Clear, elevation, azimuth).is_none());
        }
    }
}
