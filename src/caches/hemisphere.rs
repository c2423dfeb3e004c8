//! Irradiance and its gradients from one stratified hemisphere of rays.

use crate::math::Rgb;
use crate::sampling::Rng;
use glam::{DVec2, DVec3, Mat3, Vec2, Vec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Result of one ray of a hemisphere.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Incident radiance.
    pub radiance: Rgb,
    /// Distance of the first surface; infinite where there is none.
    pub nearest: f32,
    /// Length of the whole path, through specular surfaces, to the source of the radiance: it determines how far the
    /// source appears to shift when the eye moves. Infinite where there is nothing.
    pub distance: f32,
}

impl Seen {
    /// A direction without light or surfaces.
    pub const NOTHING: Self = Self { radiance: Rgb::ZERO, nearest: f32::INFINITY, distance: f32::INFINITY };
}

/// Irradiance at a place, its gradients, and the distances of the surfaces around.
#[derive(Clone, Copy, Debug)]
pub struct Irradiance {
    /// Irradiance in W m^-2, cosine included.
    pub value: Rgb,
    /// Translational gradient: change of irradiance for each unit of length along x, y, z, as columns. Zero along z.
    pub shift: Mat3,
    /// Rotational gradient: change of irradiance for each unit by which the tip of the normal moves along x, y, z. Ward
    /// & Heckbert write the same with the axis of the rotation instead of the displacement of the tip. Zero along z.
    pub tilt: Mat3,
    /// Harmonic mean of the distances to the first surfaces, over directions in proportion to their cosine.
    pub harmonic: f32,
    /// The least of these distances.
    pub nearest: f32,
}

impl Irradiance {
    /// The same with its gradients rotated from a local frame into the space in which `frame` has these axes as
    /// columns.
    pub fn turned(self, frame: Mat3) -> Self {
        Self { shift: self.shift * frame.transpose(), tilt: self.tilt * frame.transpose(), ..self }
    }
}

/// Strata of a hemisphere, each with the same share of the cosine-weighted solid angle: rows of polar angle by columns
/// of azimuth. One ray goes to each stratum, and further rays to those from which most light is expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hemisphere {
    rows: usize,
    columns: usize,
    further: usize,
}

/// Step of the points within a stratum, which spreads any number of them evenly: Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences" (2018), powers of the inverse of the plastic number.
const LATTICE: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// One stratum: its mean radiance, and the mean inverse of the distance.
#[derive(Clone, Copy, Default)]
struct Cell {
    radiance: DVec3,
    inverse_distance: f64,
}

impl Hemisphere {
    /// About `rays` strata, with pi times more columns than rows, as Ward & Heckbert advise; the number of columns is
    /// even.
    pub fn with_rays(rays: u32) -> Self {
        let rays = f64::from(rays.clamp(4, 1 << 20));
        let rows = ((rays / PI).sqrt().round() as usize).max(1);
        let columns = ((rays / rows as f64 / 2.0).round() as usize).max(2) * 2;
        Self { rows, columns, further: 0 }
    }

    /// Half of `rays` for the strata; the other half is distributed among them by the expected light.
    pub fn guided(rays: u32) -> Self {
        let even = Self::with_rays(rays / 2);
        Self { further: (rays as usize).saturating_sub(even.strata()), ..even }
    }

    fn strata(&self) -> usize {
        self.rows * self.columns
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.strata() + self.further
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Direction of the point `u` of a stratum.
    #[inline]
    fn direction(&self, stratum: usize, u: Vec2) -> Vec3 {
        let (row, column) = (stratum / self.columns, stratum % self.columns);
        // The square of the sine is uniform for cosine-distributed directions. It stays below one by more than
        // rounding.
        let sin_squared = ((row as f32 + u.x) / self.rows as f32).min(1.0 - f32::EPSILON);
        let azimuth = Vec2::from_angle(std::f32::consts::TAU * (column as f32 + u.y) / self.columns as f32);
        (azimuth * sin_squared.sqrt()).extend((1.0 - sin_squared).sqrt())
    }

    /// Rays of each stratum: one, plus a number of further rays in proportion to the light `expected` from its middle.
    /// Fractions are rounded by systematic sampling.
    fn share_out(&self, offset: f32, expected: impl Fn(Vec3) -> f32) -> Vec<u32> {
        if self.further == 0 {
            return vec![1; self.strata()];
        }
        let shares: Vec<f64> = (0..self.strata())
            .map(|stratum| f64::from(expected(self.direction(stratum, Vec2::splat(0.5)))))
            .map(|share| if share > 0.0 && share.is_finite() { share } else { 0.0 })
            .collect();
        let total: f64 = shares.iter().sum();
        // Without any expected light, all strata get the same share.
        let (even, scale) = if total > 0.0 { (0.0, 1.0 / total) } else { (1.0 / shares.len() as f64, 0.0) };
        let mut given = f64::from(offset);
        let further = |share: f64| {
            let before = given.floor();
            given += (even + share * scale) * self.further as f64;
            (given.floor() - before) as u32
        };
        shares.into_iter().map(further).map(|further| 1 + further).collect()
    }

    /// Sends rays through all strata. `look` takes a direction around +z and a number in `[0, 1)` for choices on the
    /// path, and returns what the ray finds. The light `expected` from a direction, in any unit, decides where the
    /// further rays go: it affects the noise, not the mean.
    ///
    /// The gradients are those of section 3 of Ward & Heckbert 1992. A uniform hemisphere gives gradients of exactly
    /// zero.
    pub fn gather(
        &self,
        rng: &mut Rng,
        expected: impl Fn(Vec3) -> f32,
        mut look: impl FnMut(Vec3, f32) -> Seen,
    ) -> Irradiance {
        let (m, n) = (self.rows, self.columns);
        let mut cells = vec![Cell::default(); m * n];
        let (mut sum, mut inverse, mut nearest) = (DVec3::ZERO, 0.0, f32::INFINITY);
        let rays = self.share_out(rng.next_f32(), expected);
        for (stratum, (cell, &rays)) in cells.iter_mut().zip(&rays).enumerate() {
            let offset = rng.next_2d();
            let mut of_cell = Cell::default();
            for ray in 0..rays {
                let u = (offset + ray as f32 * LATTICE).fract();
                let seen = look(self.direction(stratum, u), rng.next_f32());
                of_cell.radiance += seen.radiance.as_dvec3();
                of_cell.inverse_distance += f64::from(1.0 / seen.distance.max(f32::MIN_POSITIVE));
                inverse += f64::from(1.0 / seen.nearest.max(f32::MIN_POSITIVE)) / f64::from(rays);
                nearest = nearest.min(seen.nearest);
            }
            *cell = Cell {
                radiance: of_cell.radiance / f64::from(rays),
                inverse_distance: of_cell.inverse_distance / f64::from(rays),
            };
            sum += cell.radiance;
        }
        let count = (m * n) as f64;
        Irradiance {
            value: (sum * (PI / count)).as_vec3(),
            shift: columns(self.shift(&cells)),
            tilt: columns(self.tilt(&cells)),
            harmonic: (count / inverse) as f32,
            nearest,
        }
    }

    /// Derivatives along x and y from the shift of the boundaries between strata. As the eye moves by `d`, a boundary
    /// at distance `r` moves by `d / r` across the line of sight, and one side gains what the other loses. The boundary
    /// has the distance of the nearer of the two surfaces.
    fn shift(&self, cells: &[Cell]) -> [DVec3; 2] {
        let (m, n) = (self.rows, self.columns);
        let mut gradient = [DVec3::ZERO; 2];
        let mut add = |direction: DVec2, change: DVec3| {
            gradient[0] += direction.x * change;
            gradient[1] += direction.y * change;
        };
        let border =
            |a: &Cell, b: &Cell| (a.radiance - b.radiance) * a.inverse_distance.max(b.inverse_distance);
        for k in 0..n {
            let turn = TAU / n as f64;
            let middle = DVec2::from_angle((k as f64 + 0.5) * turn);
            let side = DVec2::from_angle(k as f64 * turn).perp();
            let before = (k + n - 1) % n;
            let (mut outward, mut across) = (DVec3::ZERO, DVec3::ZERO);
            for j in 0..m {
                let cell = &cells[j * n + k];
                let low = (j as f64 / m as f64).sqrt();
                let high = ((j + 1) as f64 / m as f64).sqrt();
                if j > 0 {
                    // sin cos^2 of the polar angle of the boundary.
                    outward += border(cell, &cells[(j - 1) * n + k]) * (low * (1.0 - low * low));
                }
                across += border(cell, &cells[j * n + before]) * (high - low);
            }
            add(middle, outward * turn);
            add(side, across);
        }
        gradient
    }

    /// Derivatives by the tilt of the normal towards x and y: the contribution of each direction changes by the tangent
    /// of its polar angle, times its cosine-weighted share.
    fn tilt(&self, cells: &[Cell]) -> [DVec3; 2] {
        let (m, n) = (self.rows, self.columns);
        // Integral of tan over sin^2.
        let primitive = |u: f64| u.sqrt().min(1.0).asin() - (u * (1.0 - u)).max(0.0).sqrt();
        let mut gradient = [DVec3::ZERO; 2];
        for k in 0..n / 2 {
            let direction = DVec2::from_angle((k as f64 + 0.5) * TAU / n as f64);
            let mut sum = DVec3::ZERO;
            for j in 0..m {
                let tangent = primitive((j + 1) as f64 / m as f64) - primitive(j as f64 / m as f64);
                // Opposite columns are subtracted, so that equal ones cancel exactly.
                sum += (cells[j * n + k].radiance - cells[j * n + k + n / 2].radiance) * tangent;
            }
            sum *= PI / n as f64;
            gradient[0] += direction.x * sum;
            gradient[1] += direction.y * sum;
        }
        debug_assert!(primitive(1.0) <= FRAC_PI_2 + 1e-12);
        gradient
    }
}

fn columns([x, y]: [DVec3; 2]) -> Mat3 {
    Mat3::from_cols(x.as_vec3(), y.as_vec3(), Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Stream;

    fn rng(index: u64) -> Rng {
        Rng::new(1, Stream::Measure, index)
    }

    #[test]
    fn strata() {
        for rays in [0, 1, 16, 64, 128, 256, 500, 2000] {
            let hemisphere = Hemisphere::with_rays(rays);
            assert_eq!(hemisphere.columns % 2, 0);
            let off = hemisphere.len() as f64 / f64::from(rays.max(4));
            assert!((0.8..1.25).contains(&off), "{rays}: {hemisphere:?}");
        }
    }

    #[test]
    fn a_uniform_hemisphere_is_exact_and_flat() {
        let radiance = Rgb::new(0.3, 1.7, 1e-3);
        for rays in [16, 100, 256, 1000] {
            for index in 0..20 {
                let mut distances = rng(1000 + index);
                let found = Hemisphere::with_rays(rays).gather(
                    &mut rng(index),
                    |_| 1.0,
                    |direction, u| {
                        assert!(direction.z > 0.0 && (direction.length() - 1.0).abs() < 1e-5 && u < 1.0);
                        let r = 0.1 + distances.next_f32();
                        Seen { radiance, nearest: r, distance: r }
                    },
                );
                assert_eq!(found.shift, Mat3::ZERO);
                assert_eq!(found.tilt, Mat3::ZERO);
                let want = (radiance.as_dvec3() * PI).as_vec3();
                assert!(((found.value - want) / want).abs().max_element() < 1e-6);
                assert!(found.nearest >= 0.1 && found.harmonic > found.nearest && found.harmonic < 1.1);
            }
        }
    }

    #[test]
    fn further_rays_are_all_sent_and_keep_what_is_uniform() {
        let radiance = Rgb::new(0.3, 1.7, 1e-3);
        let expectations: [fn(Vec3) -> f32; 5] =
            [|_| 1.0, |d| d.x.max(0.0), |d| (d.z - 0.99).max(0.0), |_| 0.0, |_| f32::NAN];
        for (index, expected) in expectations.into_iter().enumerate() {
            for rays in [8, 64, 500] {
                let hemisphere = Hemisphere::guided(rays);
                let mut sent = 0;
                let found = hemisphere.gather(&mut rng(index as u64), expected, |direction, _| {
                    sent += 1;
                    assert!(direction.z > 0.0);
                    Seen { radiance, nearest: 1.0, distance: 1.0 }
                });
                // Systematic sampling distributes all rays but what the rounding of the last share leaves.
                assert!(hemisphere.len() - sent <= 1, "{sent} of {hemisphere:?}");
                assert!(hemisphere.len().abs_diff(rays as usize) <= 1 || rays < 64, "{hemisphere:?}");
                assert!(found.shift == Mat3::ZERO && found.tilt == Mat3::ZERO);
                let want = (radiance.as_dvec3() * PI).as_vec3();
                assert!(((found.value - want) / want).abs().max_element() < 1e-6);
            }
        }
    }

    #[test]
    fn further_rays_where_light_comes_from_change_the_noise_alone() {
        // A small bright disc and a dim rest; the expected light is right, constant, or wrong.
        let centre = Vec3::new(0.6, 0.0, 0.8);
        let look = |direction: Vec3, _: f32| {
            let bright = direction.dot(centre) > 0.99;
            let radiance = if bright { Rgb::splat(50.0) } else { Rgb::splat(0.5 + 0.4 * direction.x) };
            Seen { radiance, nearest: 1.0, distance: 1.0 }
        };
        let spread = |hemisphere: Hemisphere, expected: &dyn Fn(Vec3) -> f32| {
            let count = 4000;
            let (mut sum, mut squares) = (0.0, 0.0);
            for index in 0..count {
                let found = f64::from(hemisphere.gather(&mut rng(index), expected, look).value.x);
                sum += found;
                squares += found * found;
            }
            let mean = sum / count as f64;
            (mean, (squares / count as f64 - mean * mean).sqrt())
        };
        // The disc has the projected area pi sin^2 cos; the rest integrates to pi / 2, minus the part that the disc
        // covers.
        let area = PI * (1.0 - 0.99f64.powi(2)) * 0.8;
        let want = 0.5 * PI + area * (50.0 - (0.5 + 0.4 * 0.6 * 0.995));
        let even = spread(Hemisphere::with_rays(256), &|_| 1.0);
        let right = spread(Hemisphere::guided(256), &|d| if d.dot(centre) > 0.97 { 1.0 } else { 0.02 });
        let wrong = spread(Hemisphere::guided(256), &|d| f32::from(d.x < 0.0));
        println!("want {want}: even {even:?}, right {right:?}, wrong {wrong:?}");
        for (mean, deviation) in [even, right, wrong] {
            assert!((mean - want).abs() < 4.0 * deviation / 4000f64.sqrt() + 2e-3 * want, "{mean} {want}");
        }
        assert!(right.1 < 0.5 * even.1, "{right:?} {even:?}");
    }

    /// Irradiance of a disc of `radius` and radiance 1 at height `h`, parallel to the receiver, whose axis passes `x` away:
    /// closed form of the form factor (Naraghi & Chung 1982).
    fn disc_above(x: f64, h: f64, radius: f64) -> f64 {
        let (r, d) = (radius / h, x / h);
        let z = 1.0 + d * d - r * r;
        0.5 * PI * (1.0 - z / (z * z + 4.0 * r * r).sqrt())
    }

    /// Ray from `(x, 0, 0)` to that disc, around which there is nothing.
    fn look_at_disc(x: f64, h: f64, radius: f64) -> impl Fn(Vec3, f32) -> Seen {
        move |direction, _| {
            let d = direction.as_dvec3();
            let t = h / d.z;
            let at = DVec2::new(x + d.x * t, d.y * t);
            if at.length() < radius {
                Seen { radiance: Rgb::ONE, nearest: t as f32, distance: t as f32 }
            } else {
                Seen::NOTHING
            }
        }
    }

    /// Mean over many hemispheres: gradients of one of them are noisy.
    fn mean(rays: u32, count: u64, look: impl Fn(Vec3, f32) -> Seen) -> (f64, [f64; 2], [f64; 2]) {
        let (mut value, mut shift, mut tilt) = (0.0, [0.0; 2], [0.0; 2]);
        for index in 0..count {
            let found = Hemisphere::with_rays(rays).gather(&mut rng(index), |_| 1.0, &look);
            let part = |v: f32| f64::from(v) / count as f64;
            value += part(found.value.x);
            shift = [shift[0] + part(found.shift.x_axis.x), shift[1] + part(found.shift.y_axis.x)];
            tilt = [tilt[0] + part(found.tilt.x_axis.x), tilt[1] + part(found.tilt.y_axis.x)];
        }
        (value, shift, tilt)
    }

    #[test]
    fn translational_gradient_is_the_derivative_of_the_closed_form() {
        let (h, radius) = (1.0, 0.6);
        for x in [0.3, 0.8, 1.5] {
            let step = 1e-4;
            let want = (disc_above(x + step, h, radius) - disc_above(x - step, h, radius)) / (2.0 * step);
            let (value, [dx, dy], _) = mean(5000, 100, look_at_disc(x, h, radius));
            println!("at {x}: irradiance {value} {}, gradient {dx} {want}, {dy}", disc_above(x, h, radius));
            assert!((value / disc_above(x, h, radius) - 1.0).abs() < 0.01);
            assert!((dx / want - 1.0).abs() < 0.05 && dy.abs() < 0.02 * want.abs(), "{dx} {dy} {want}");
        }
    }

    #[test]
    fn rotational_gradient_is_the_derivative_of_the_closed_form() {
        // A sphere above the horizon gives the irradiance pi (r/d)^2 cos, wherever it is.
        let (centre, radius) = (DVec3::new(0.8, 0.0, 1.4), 0.5);
        let look = |direction: Vec3, _: f32| {
            let along = direction.as_dvec3().dot(centre);
            let off = centre.length_squared() - along * along;
            if along > 0.0 && off < radius * radius {
                Seen { radiance: Rgb::ONE, nearest: 1.0, distance: 1.0 }
            } else {
                Seen::NOTHING
            }
        };
        let strength = PI * radius * radius / centre.length_squared();
        let toward = centre.normalize();
        let (value, _, [dx, dy]) = mean(256, 1000, look);
        println!(
            "irradiance {value}, want {}; tilt {dx} {dy}, want {}",
            strength * toward.z,
            strength * toward.x
        );
        assert!((value / (strength * toward.z) - 1.0).abs() < 0.01);
        assert!((dx / (strength * toward.x) - 1.0).abs() < 0.03 && dy.abs() < 0.02 * dx);
    }

    #[test]
    fn a_wall_is_as_far_as_its_harmonic_mean() {
        // A plane x = 2, infinitely high: mean of sin cos(phi) / 2 over half of the directions is 2/3 / pi / 2.
        let look = |direction: Vec3, _: f32| {
            let r = if direction.x > 0.0 { 2.0 / direction.x } else { f32::INFINITY };
            Seen { radiance: Rgb::ZERO, nearest: r, distance: r }
        };
        let found = Hemisphere::with_rays(4000).gather(&mut rng(0), |_| 1.0, look);
        let want = 2.0 * 1.5 * PI;
        assert!((f64::from(found.harmonic) / want - 1.0).abs() < 0.02, "{}", found.harmonic);
        assert!((2.0..2.1).contains(&found.nearest));
        let empty = Hemisphere::with_rays(64).gather(&mut rng(0), |_| 1.0, |_, _| Seen::NOTHING);
        assert!(empty.harmonic == f32::INFINITY && empty.value == Rgb::ZERO && empty.shift == Mat3::ZERO);
    }
}
