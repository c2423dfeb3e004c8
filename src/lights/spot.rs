//! Point lights whose intensity depends on the direction: a cone with a soft edge, or a measured profile.

use crate::math::{Frame, Rgb, unit};
use crate::sampling::{SphereDensity, direction_to_square, warp};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A point light with an intensity for each direction.
#[derive(Clone, Debug)]
pub struct SpotLight {
    /// Position.
    pub position: Vec3,
    /// Radiant intensity at the centre of the cone, flux per solid angle; or the factor on the intensity of the profile.
    pub intensity: Rgb,
    /// Axes of the distribution: z is the axis of the cone, or points down in the profile.
    frame: Frame,
    shape: Distribution,
}

#[derive(Clone, Debug)]
enum Distribution {
    Cone(Cone),
    Profile(Arc<Profile>),
}

/// A cone with full intensity around the axis. At its edge the intensity falls to zero with the square of a linear ramp in the cosine
/// (Khronos, `KHR_lights_punctual`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// `1 - cos` of the angle at which the intensity becomes zero.
    outer: f64,
    /// Width of the ramp, as a difference of cosines.
    ramp: f64,
}

impl Cone {
    /// Smallest width of the ramp, as defined by the extension.
    const LEAST_RAMP: f64 = 0.001;

    /// Full intensity up to `inner` radians from the axis, zero from `outer` on; `0 <= inner <= outer <= pi`.
    pub fn new(inner: f64, outer: f64) -> Self {
        let one_minus_cos = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
        let (inner, outer) = (one_minus_cos(inner), one_minus_cos(outer));
        Self { outer, ramp: (outer - inner).max(Self::LEAST_RAMP) }
    }

    /// Factor on the intensity at this cosine to the axis.
    pub fn factor(&self, cosine: f64) -> f64 {
        ((self.outer - (1.0 - cosine)) / self.ramp).clamp(0.0, 1.0).powi(2)
    }

    /// Flux for an intensity of one: the part with full intensity, plus the ramp, whose mean factor is one third.
    pub fn flux(&self) -> f64 {
        let (full, ramp) = self.parts();
        TAU * (full + ramp)
    }

    /// Integrals of the factor over `1 - cos`: where the factor is one, and on the ramp.
    fn parts(&self) -> (f64, f64) {
        let full = (self.outer - self.ramp).max(0.0);
        // Where the cone is narrower than the ramp, the factor never reaches one.
        let top = (self.outer / self.ramp).min(1.0);
        (full, self.ramp * top.powi(3) / 3.0)
    }

    /// Samples a direction around z in proportion to the intensity; the first number selects the latitude, the second the longitude.
    fn sample(&self, u: Vec2) -> Vec3 {
        let (full, ramp) = self.parts();
        let x = f64::from(u.x) * (full + ramp);
        let drop = if x < full {
            x
        } else {
            // Measured from the inner end of the ramp; the remaining integral falls with the cube.
            let left = (1.0 - (x - full) / ramp).max(0.0);
            self.outer - self.ramp * (self.outer / self.ramp).min(1.0) * left.cbrt()
        };
        warp::square_to_cone(Vec2::new(drop.clamp(0.0, 2.0) as f32, u.y), 1.0)
    }
}

/// Measured intensity over polar and azimuthal angles, interpolated bilinearly; zero outside of the polar angles.
#[derive(Clone, Debug, PartialEq)]
pub struct ProfileTable {
    /// Angles to the downward axis (nadir), radians, increasing, in `[0, pi]`.
    pub polar: Vec<f64>,
    /// Angles around that axis, radians, increasing from 0 to 2 pi; only 0 where the intensity does not depend on them.
    pub azimuth: Vec<f64>,
    /// Intensity, azimuth after azimuth: `values[azimuth * polar.len() + polar]`.
    pub values: Vec<f32>,
}

/// A measured profile with a density for sampling directions.
#[derive(Clone, Debug)]
pub struct Profile {
    table: ProfileTable,
    density: SphereDensity,
    flux: f64,
}

/// Index of the interval of `angles` that contains `at`, and the fraction within it; `None` outside.
fn interval(angles: &[f64], at: f64) -> Option<(usize, f64)> {
    let after = angles.partition_point(|&angle| angle <= at);
    match after {
        0 => None,
        _ if after == angles.len() => (at == angles[after - 1]).then_some((after - 1, 0.0)),
        _ => Some((after - 1, (at - angles[after - 1]) / (angles[after] - angles[after - 1]))),
    }
}

impl ProfileTable {
    /// Intensity at the polar and azimuthal angle.
    pub fn at(&self, polar: f64, azimuth: f64) -> f64 {
        let Some((row, down)) = interval(&self.polar, polar) else { return 0.0 };
        let (column, across) = interval(&self.azimuth, azimuth.rem_euclid(TAU)).unwrap_or((0, 0.0));
        let count = self.polar.len();
        let value = |column: usize, row: usize| -> f64 {
            let index = column.min(self.azimuth.len() - 1) * count + row.min(count - 1);
            self.values.get(index).map_or(0.0, |&value| f64::from(value))
        };
        let left = value(column, row) * (1.0 - down) + value(column, row + 1) * down;
        let right = value(column + 1, row) * (1.0 - down) + value(column + 1, row + 1) * down;
        left * (1.0 - across) + right * across
    }

    /// Flux: the integral over all directions, in closed form for an intensity that is linear in each angle.
    pub fn flux(&self) -> f64 {
        let count = self.polar.len();
        // Share of each azimuth in the full circle.
        let widths: Vec<f64> = if self.azimuth.len() < 2 {
            vec![TAU]
        } else {
            let last = self.azimuth.len() - 1;
            let at = |i: usize| self.azimuth[i];
            (0..=last).map(|i| 0.5 * (at((i + 1).min(last)) - at(i.saturating_sub(1)))).collect()
        };
        let mut flux = 0.0;
        for (column, width) in self.values.chunks_exact(count).zip(widths) {
            for (angles, values) in self.polar.windows(2).zip(column.windows(2)) {
                let (a, b) = (angles[0], angles[1]);
                let slope = (b.sin() - a.sin()) / (b - a);
                let (falling, rising) = (a.cos() - slope, slope - b.cos());
                flux += width * (f64::from(values[0]) * falling + f64::from(values[1]) * rising);
            }
        }
        flux
    }
}

impl Profile {
    /// Columns and rows of the table from which directions are sampled.
    const GRID: (usize, usize) = (256, 256);

    /// `None` where the intensity is zero everywhere.
    pub fn new(table: ProfileTable) -> Option<Self> {
        let (width, height) = Self::GRID;
        let (dx, dy) = (TAU / width as f64, PI / height as f64);
        // Largest value in each cell and around it, so that a bright spot between dark points is not left out.
        let cell = |index: usize| {
            let (x, y) = ((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            let mut most = 0f64;
            for i in -2..=2 {
                for j in -2..=2 {
                    let azimuth = (x + 0.5 * f64::from(i)) * dx;
                    let polar = ((y + 0.5 * f64::from(j)) * dy).clamp(0.0, PI);
                    most = most.max(table.at(polar, azimuth));
                }
            }
            // Also the table's polar angles that are closer together than a cell.
            let (low, high) = ((y - 1.0) * dy, (y + 1.0) * dy);
            for &polar in table.polar.iter().filter(|&&polar| low < polar && polar < high) {
                for i in -2..=2 {
                    most = most.max(table.at(polar, (x + 0.5 * f64::from(i)) * dx));
                }
            }
            most as f32
        };
        let density = SphereDensity::new(width, (0..width * height).map(cell))?;
        let flux = table.flux();
        (flux > 0.0 && flux.is_finite()).then_some(Self { table, density, flux })
    }

    /// The measured table.
    pub fn table(&self) -> &ProfileTable {
        &self.table
    }

    /// Flux for a factor of one.
    pub fn flux(&self) -> f64 {
        self.flux
    }

    /// Largest intensity.
    fn peak(&self) -> f32 {
        self.table.values.iter().copied().fold(0.0, f32::max)
    }
}

/// Polar angle and azimuth of a direction in axes whose z points down. Azimuths are counter-clockwise as seen from above.
fn to_table(d: Vec3) -> (f64, f64) {
    let d = d.as_dvec3();
    (d.x.hypot(d.y).atan2(d.z), (-d.y).atan2(d.x).rem_euclid(TAU))
}

impl SpotLight {
    /// A cone along the unit `direction`.
    pub fn cone(position: Vec3, direction: Vec3, intensity: Rgb, cone: Cone) -> Self {
        Self { position, intensity, frame: Frame::from_z(direction), shape: Distribution::Cone(cone) }
    }

    /// A profile whose polar angles count from the unit direction `down`, and whose azimuths count from the direction `along`,
    /// counter-clockwise as seen from above, where `down` points away from the viewer.
    pub fn profile(position: Vec3, (down, along): (Vec3, Vec3), factor: Rgb, profile: Arc<Profile>) -> Self {
        let shape = Distribution::Profile(profile);
        Self { position, intensity: factor, frame: Frame::with_tangent(down, along), shape }
    }

    /// Whether the light has a measured profile.
    pub fn is_profile(&self) -> bool {
        matches!(self.shape, Distribution::Profile(_))
    }

    /// Unit direction of the axis, and the angle to it beyond which nothing is emitted, radians.
    pub fn extent(&self) -> (Vec3, f32) {
        let limit = match &self.shape {
            Distribution::Cone(cone) => 2.0 * (0.5 * cone.outer).sqrt().min(1.0).asin(),
            Distribution::Profile(profile) => profile.table.polar.last().copied().unwrap_or(PI),
        };
        (self.frame.z, (limit as f32 * (1.0 + 1e-5)).min(std::f32::consts::PI))
    }

    /// Largest intensity.
    pub fn peak(&self) -> Rgb {
        match &self.shape {
            Distribution::Cone(_) => self.intensity,
            Distribution::Profile(profile) => self.intensity * profile.peak(),
        }
    }

    /// Factor on the intensity in the unit `direction` away from the light.
    pub fn factor(&self, direction: Vec3) -> f32 {
        match &self.shape {
            // Computes 1 - cos as half the squared chord, which keeps its precision in narrow cones.
            Distribution::Cone(cone) => {
                let drop = 0.5 * (direction - self.frame.z).as_dvec3().length_squared();
                cone.factor(1.0 - drop) as f32
            }
            Distribution::Profile(profile) => {
                let (polar, azimuth) = to_table(self.frame.to_local(direction));
                profile.table.at(polar, azimuth) as f32
            }
        }
    }

    /// Samples a direction away from the light in proportion to the intensity; also returns the intensity over the density per solid
    /// angle.
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, Rgb)> {
        match &self.shape {
            Distribution::Cone(cone) => {
                Some((self.frame.to_world(cone.sample(u)), self.intensity * cone.flux() as f32))
            }
            Distribution::Profile(profile) => {
                let (own, pdf) = profile.density.sample(u)?;
                let square = direction_to_square(own);
                let (polar, azimuth) = (f64::from(square.y) * PI, f64::from(square.x) * TAU);
                let (sin, cos) = polar.sin_cos();
                let local = DVec3::new(sin * azimuth.cos(), -sin * azimuth.sin(), cos).as_vec3();
                let value = profile.table.at(polar, azimuth) as f32;
                (value > 0.0).then(|| (self.frame.to_world(local), self.intensity * (value / pdf)))
            }
        }
    }

    /// Whether [`Self::sample`] maps the first number to latitudes alone and the second to longitudes alone, as for a cone.
    pub fn has_even_squares(&self) -> bool {
        !self.is_profile()
    }

    /// Flux, per channel.
    pub fn flux(&self) -> DVec3 {
        let of_one = match &self.shape {
            Distribution::Cone(cone) => cone.flux(),
            Distribution::Profile(profile) => profile.flux,
        };
        self.intensity.as_dvec3() * of_one
    }

    /// Unit direction to the light, the intensity towards `from` over the squared distance, and the distance.
    pub(super) fn arriving(&self, from: Vec3) -> Option<(Vec3, Rgb, f32)> {
        let to_light = self.position - from;
        let wi = unit(to_light)?;
        let factor = self.factor(-wi);
        let distance = to_light.length();
        let arriving = self.intensity * (factor / (distance * distance));
        (factor > 0.0 && arriving.is_finite()).then_some((wi, arriving, distance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// Checks intensities, powers of emitted photons and the flux of a light: the mean over uniformly sampled directions, and the mean
    /// over samples by intensity.
    fn check(light: &SpotLight, tolerance: f64) {
        let mut rng = Rng::new(7, Stream::Measure, 0);
        let n = 400_000;
        let (mut uniform, mut drawn, mut most, mut dark) = (0.0, 0.0, 0f32, 0);
        for _ in 0..n {
            uniform += f64::from(light.factor(warp::square_to_sphere(rng.next_2d())));
            let Some((direction, power)) = light.sample(rng.next_2d()) else { continue };
            assert!((direction.length() - 1.0).abs() < 1e-5);
            dark += u32::from(light.factor(direction) == 0.0);
            drawn += f64::from(power.x);
            most = most.max(power.x);
        }
        let flux = light.flux().x;
        let scale = f64::from(light.intensity.x) / f64::from(n);
        assert!(
            (uniform * 4.0 * PI * scale / flux - 1.0).abs() < tolerance,
            "{} {flux}",
            uniform * 4.0 * PI * scale
        );
        assert!((drawn / f64::from(n) / flux - 1.0).abs() < 3e-3, "{} {flux}", drawn / f64::from(n));
        assert!(f64::from(most) < 30.0 * flux && dark < 10, "{most} {flux} {dark}");
    }

    #[test]
    fn cones() {
        let direction = Vec3::new(0.0, -0.6, 0.8);
        for (inner, outer) in [(0.0, 0.5), (0.3, 0.5), (0.5, 0.5), (1.0, 3.0), (0.0, 0.9)] {
            let light = SpotLight::cone(Vec3::ZERO, direction, Rgb::splat(3.0), Cone::new(inner, outer));
            check(&light, 0.05);
            let at = |angle: f64| {
                light.factor(Frame::from_z(direction).to_world(Vec3::new(
                    angle.sin() as f32,
                    0.0,
                    angle.cos() as f32,
                )))
            };
            assert!((at(0.0) - 1.0).abs() < 1e-6);
            assert_eq!(at(outer + 0.02), 0.0);
            // The formula of the extension.
            let angle: f64 = 0.5 * (inner + outer);
            let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
            let want = (angle.cos() * scale - outer.cos() * scale).clamp(0.0, 1.0).powi(2);
            assert!((f64::from(at(angle)) - want).abs() < 1e-3, "{} {want}", at(angle));
        }
        // All directions without an edge: like a point light, except for the narrowest ramp.
        let all = Cone::new(PI, PI).flux();
        assert!((all / (4.0 * PI) - 1.0).abs() < 1e-3, "{all}");
    }

    /// The frequencies of sampled directions in a cone agree with the intensity (chi-square).
    #[test]
    fn directions_of_a_cone() {
        let cone = Cone::new(0.4, 0.8);
        let mut rng = Rng::new(8, Stream::Measure, 0);
        const BINS: usize = 40;
        let mut counts = [0u32; BINS];
        let n = 200_000;
        for _ in 0..n {
            let drop = f64::from(1.0 - cone.sample(rng.next_2d()).z);
            counts[((drop / cone.outer * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        let step = cone.outer / BINS as f64;
        let mut statistic = 0.0;
        for (bin, &count) in counts.iter().enumerate() {
            const FINE: usize = 1000;
            let mean: f64 = (0..FINE)
                .map(|i| cone.factor(1.0 - step * (bin as f64 + (i as f64 + 0.5) / FINE as f64)))
                .sum::<f64>()
                / FINE as f64;
            let want = f64::from(n) * mean * step * TAU / cone.flux();
            statistic += (f64::from(count) - want).powi(2) / want;
        }
        let freedom = BINS as f64 - 1.0;
        assert!((statistic - freedom).abs() < 4.0 * (2.0 * freedom).sqrt(), "{statistic}");
    }

    #[test]
    fn profiles() {
        let degrees = |angles: &[f64]| angles.iter().map(|angle| angle.to_radians()).collect::<Vec<_>>();
        // An intensity proportional to the downward cosine, in steps of five degrees: flux pi, except for the interpolation.
        let polar: Vec<f64> = (0..=18).map(|i| f64::from(5 * i).to_radians()).collect();
        let values = polar.iter().map(|angle| angle.cos() as f32).collect();
        let cosine = Profile::new(ProfileTable { polar, azimuth: vec![0.0], values }).unwrap();
        assert!((cosine.flux() / PI - 1.0).abs() < 2e-3, "{}", cosine.flux());
        let lopsided = Profile::new(ProfileTable {
            polar: degrees(&[0.0, 30.0, 31.0, 120.0]),
            azimuth: degrees(&[0.0, 90.0, 180.0, 360.0]),
            values: vec![5.0, 2.0, 0.0, 1.0, 5.0, 1.0, 3.0, 0.0, 5.0, 0.0, 0.0, 0.0, 5.0, 2.0, 0.0, 1.0],
        })
        .unwrap();
        for profile in [cosine, lopsided] {
            let axes = (Vec3::NEG_Y, Vec3::X);
            let light = SpotLight::profile(Vec3::ZERO, axes, Rgb::splat(2.0), Arc::new(profile));
            check(&light, 0.02);
            assert_eq!(light.factor(Vec3::Y), 0.0);
        }
        let dark = ProfileTable { polar: vec![0.0, 1.0], azimuth: vec![0.0], values: vec![0.0; 2] };
        assert!(Profile::new(dark).is_none());
    }

    /// Azimuths count from `along`, counter-clockwise as seen from above.
    #[test]
    fn azimuths() {
        let table = ProfileTable {
            polar: vec![0.0, PI],
            azimuth: [0.0f64, 90.0, 180.0, 270.0, 360.0].map(f64::to_radians).to_vec(),
            values: vec![1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 1.0, 1.0],
        };
        let light = SpotLight::profile(
            Vec3::ZERO,
            (Vec3::NEG_Y, Vec3::X),
            Rgb::ONE,
            Arc::new(Profile::new(table).unwrap()),
        );
        for (direction, want) in [(Vec3::X, 1.0), (Vec3::NEG_X, 3.0), (Vec3::NEG_Z, 2.0), (Vec3::Z, 4.0)] {
            assert!(
                (light.factor(direction) - want).abs() < 1e-4,
                "{direction}: {}",
                light.factor(direction)
            );
        }
    }
}
