//! Environment light: light from all directions, with a constant radiance or an image in longitude and latitude.

use crate::math::{Rgb, luminance};
use crate::sampling::{Corners, SphereDensity, direction_to_square, warp};
use glam::{DVec3, Mat3, Vec2, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Light that arrives from all directions outside of the scene.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    /// Radiance, or the factor on the radiance of the map.
    pub radiance: Rgb,
    /// The map; `None` where the radiance is the same in all directions.
    map: Option<Turned>,
}

/// A map rotated around the y axis.
#[derive(Clone, Debug)]
struct Turned {
    map: Arc<EnvironmentMap>,
    /// Cosine and sine of the rotation.
    turn: Vec2,
    /// The directions to which the axes of the rotated map are tilted; `None` where the map is upright.
    axes: Option<Mat3>,
}

/// Radiance in longitude and latitude, bilinear between the centres of pixels, with a density for sampling directions.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    /// Rows from +y downwards; a row runs from +z over -x, -z (its centre) and +x.
    texels: Vec<Rgb>,
    /// Density in proportion to luminance.
    density: SphereDensity,
    integral: DVec3,
}

/// Counts of pixels that were changed because their values were no valid radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mended {
    /// Pixels with a negative or NaN channel, which was set to zero.
    pub negative: u64,
    /// Pixels with a channel above [`EnvironmentMap::LARGEST`], which was clamped.
    pub too_large: u64,
}

impl EnvironmentMap {
    /// Largest value of a pixel: sums and products with it remain well within `f32`.
    pub const LARGEST: f32 = 1e15;

    /// A map of `width` columns and some rows of pixels. Values that are no valid radiance are corrected and counted. `None` where there
    /// is no pixel, or none with light.
    pub fn new(width: usize, mut texels: Vec<Rgb>) -> (Option<Self>, Mended) {
        let mut mended = Mended::default();
        for texel in &mut texels {
            let is_none = |x: f32| x < 0.0 || x.is_nan();
            let channels = texel.to_array();
            mended.negative += u64::from(channels.into_iter().any(is_none));
            mended.too_large += u64::from(channels.into_iter().any(|x| x > Self::LARGEST));
            *texel = Rgb::from_array(channels.map(|x| if is_none(x) { 0.0 } else { x.min(Self::LARGEST) }));
        }
        let density = SphereDensity::new(width, texels.iter().map(|&texel| luminance(texel)));
        let map = density.map(|density| {
            let height = texels.len() / width;
            Self { width, height, integral: integral(width, &texels), texels, density }
        });
        (map, mended)
    }

    /// Radiance from the unit `direction`, in the map's own axes.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let corners = Corners::of(direction_to_square(direction), self.width, self.height);
        let mut sum = Rgb::ZERO;
        for (index, weight) in corners.indices.into_iter().zip(corners.weights()) {
            sum += self.texels[index] * weight;
        }
        sum
    }

    /// Integral of the radiance over all directions.
    pub fn integral(&self) -> DVec3 {
        self.integral
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
}

/// Integral over all directions of the bilinear function between the centres of pixels, in closed form: the integral of each row's hat
/// function times the sine.
fn integral(width: usize, texels: &[Rgb]) -> DVec3 {
    let height = texels.len() / width;
    let h = std::f64::consts::PI / height as f64;
    // Over an interval that starts at `a`: falling from one to zero, and rising from zero to one.
    let falling = |a: f64| a.cos() - ((a + h).sin() - a.sin()) / h;
    let rising = |a: f64| ((a + h).sin() - a.sin()) / h - (a + h).cos();
    let mut sum = DVec3::ZERO;
    for (row, texels) in texels.chunks_exact(width).enumerate() {
        let center = (row as f64 + 0.5) * h;
        let above = if row == 0 { 1.0 - (0.5 * h).cos() } else { rising(center - h) };
        let below = if row + 1 == height { 1.0 - (0.5 * h).cos() } else { falling(center) };
        let of_row: DVec3 = texels.iter().map(|texel| texel.as_dvec3()).sum();
        sum += of_row * (above + below);
    }
    sum * (std::f64::consts::TAU / width as f64)
}

impl EnvironmentLight {
    /// Density of uniformly sampled directions.
    const UNIFORM: f32 = 1.0 / (4.0 * PI);

    /// The same radiance from every direction.
    pub fn constant(radiance: Rgb) -> Self {
        Self { radiance, map: None }
    }

    /// `map` rotated by `turn` radians around the y axis, counter-clockwise as seen from above, times `factor`.
    pub fn of_map(map: Arc<EnvironmentMap>, turn: f64, factor: Rgb) -> Self {
        let turn = Vec2::new(turn.cos() as f32, turn.sin() as f32);
        Self { radiance: factor, map: Some(Turned { map, turn, axes: None }) }
    }

    /// The same light with its map tilted: after the rotation its axes become `axes`, which are orthonormal and may be mirrored.
    #[must_use]
    pub fn with_axes(self, axes: Option<Mat3>) -> Self {
        Self { map: self.map.map(|turned| Turned { axes, ..turned }), ..self }
    }

    /// Whether the radiance is the same in all directions.
    pub fn is_constant(&self) -> bool {
        self.map.is_none()
    }

    /// Radiance from the unit `direction`, which points away from the scene.
    pub fn radiance_from(&self, direction: Vec3) -> Rgb {
        match &self.map {
            None => self.radiance,
            Some(turned) => self.radiance * turned.map.radiance(turned.to_map(direction)),
        }
    }

    /// Samples a direction to the light in proportion to luminance. Returns the direction, the radiance from there over the density, and
    /// the density per solid angle.
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, Rgb, f32)> {
        match &self.map {
            None => Some((warp::square_to_sphere(u), self.radiance * (4.0 * PI), Self::UNIFORM)),
            Some(turned) => {
                let (own, pdf) = turned.map.density.sample(u)?;
                let over_pdf = self.radiance * turned.map.radiance(own) / pdf;
                over_pdf.is_finite().then(|| (turned.outward(own), over_pdf, pdf))
            }
        }
    }

    /// Density per solid angle with which [`Self::sample`] samples `direction`.
    pub fn pdf_solid_angle(&self, direction: Vec3) -> f32 {
        match &self.map {
            None => Self::UNIFORM,
            Some(turned) => turned.map.density.pdf_solid_angle(turned.to_map(direction)),
        }
    }

    /// Integral of the radiance over all directions.
    pub fn integral(&self) -> DVec3 {
        match &self.map {
            None => self.radiance.as_dvec3() * f64::from(4.0 * PI),
            Some(turned) => self.radiance.as_dvec3() * turned.map.integral,
        }
    }
}

impl Turned {
    fn to_map(&self, d: Vec3) -> Vec3 {
        // Rounding must not make a direction longer than one.
        let d = self.axes.map_or(d, |axes| (axes.transpose() * d).normalize_or(d));
        let (cos, sin) = (self.turn.x, self.turn.y);
        Vec3::new(cos * d.x - sin * d.z, d.y, sin * d.x + cos * d.z)
    }

    fn outward(&self, d: Vec3) -> Vec3 {
        let (cos, sin) = (self.turn.x, self.turn.y);
        let d = Vec3::new(cos * d.x + sin * d.z, d.y, cos * d.z - sin * d.x);
        self.axes.map_or(d, |axes| (axes * d).normalize_or(d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, square_to_direction};

    /// A map of the positive part of the cosine to `axis`, raised to a power.
    fn lobe(width: usize, axis: Vec3, power: i32) -> EnvironmentMap {
        let height = width / 2;
        let texel = |index: usize| {
            let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
            let (direction, _) = square_to_direction(at(index % width, width), at(index / width, height));
            Rgb::new(1.0, 0.5, 0.25) * direction.dot(axis).max(0.0).powi(power)
        };
        EnvironmentMap::new(width, (0..width * height).map(texel).collect()).0.unwrap()
    }

    /// The integral in closed form, the known integral of a lobe, and the mean of radiance over density agree.
    #[test]
    fn integrals_of_a_lobe() {
        for (axis, power) in [(Vec3::Y, 1), (Vec3::X, 4), (Vec3::new(0.6, -0.8, 0.0), 40)] {
            let map = Arc::new(lobe(256, axis, power));
            let want = std::f64::consts::TAU / f64::from(power + 1);
            assert!((map.integral().x / want - 1.0).abs() < 2e-3, "{} {want}", map.integral());
            let light = EnvironmentLight::of_map(map, 0.3, Rgb::splat(2.0));
            let mut rng = Rng::new(4, Stream::Measure, 0);
            let (mut sum, mut most, n) = (0.0, 0f32, 100_000);
            for _ in 0..n {
                let (direction, over_pdf, pdf) = light.sample(rng.next_2d()).unwrap();
                let again = light.radiance_from(direction) / light.pdf_solid_angle(direction);
                assert!((again.x / over_pdf.x - 1.0).abs() < 0.01, "{again} {over_pdf} {pdf}");
                sum += f64::from(over_pdf.x);
                most = most.max(over_pdf.x);
            }
            let mean = sum / f64::from(n);
            assert!((mean / light.integral().x - 1.0).abs() < 1e-3, "{mean} {}", light.integral());
            assert!(f64::from(most) < 1.2 * mean, "{most} {mean}");
        }
    }

    #[test]
    fn a_turn_is_counter_clockwise_from_above() {
        let light = EnvironmentLight::of_map(
            Arc::new(lobe(256, Vec3::NEG_Z, 30)),
            std::f64::consts::FRAC_PI_2,
            Rgb::ONE,
        );
        assert!(light.radiance_from(Vec3::NEG_X).x > 0.98);
        assert!(light.radiance_from(Vec3::X).x == 0.0 && light.radiance_from(Vec3::NEG_Z).x < 1e-3);
    }

    /// A tilted map shows its pole in the direction of its axis, and sampled directions map back consistently, mirrored or not.
    #[test]
    fn axes_tilt_the_map() {
        for mirror in [1.0, -1.0] {
            let axes = Mat3::from_cols(Vec3::X * mirror, Vec3::Z, Vec3::NEG_Y);
            let light = EnvironmentLight::of_map(Arc::new(lobe(256, Vec3::Y, 30)), 0.7, Rgb::ONE);
            let light = light.with_axes(Some(axes));
            assert!(light.radiance_from(Vec3::Z).x > 0.98 && light.radiance_from(Vec3::Y).x < 1e-3);
            let light = EnvironmentLight::of_map(Arc::new(lobe(256, Vec3::X, 30)), 0.0, Rgb::ONE);
            let light = light.with_axes(Some(axes));
            assert!(light.radiance_from(Vec3::X * mirror).x > 0.98);
            let mut rng = Rng::new(5, Stream::Measure, 0);
            for _ in 0..1000 {
                let (direction, over_pdf, pdf) = light.sample(rng.next_2d()).unwrap();
                assert!((direction.length() - 1.0).abs() < 1e-5);
                let again = light.radiance_from(direction) / light.pdf_solid_angle(direction);
                assert!((again.x / over_pdf.x - 1.0).abs() < 0.01, "{again} {over_pdf} {pdf}");
            }
        }
    }

    #[test]
    fn what_is_no_light_is_mended_and_counted() {
        let texels = vec![
            Rgb::new(-1.0, 2.0, 0.0),
            Rgb::new(1.0, f32::NAN, 0.0),
            Rgb::new(1.0, f32::INFINITY, 0.0),
            Rgb::ONE,
        ];
        let (map, mended) = EnvironmentMap::new(2, texels);
        assert_eq!(mended, Mended { negative: 2, too_large: 1 });
        assert!(map.unwrap().integral().is_finite());
        assert!(EnvironmentMap::new(2, vec![Rgb::ZERO; 2]).0.is_none());
    }
}
