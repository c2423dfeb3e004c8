//! Maps from the unit square to points and directions, with their densities.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, TAU};

/// Maps the square to the unit disc, area-preserving and with low distortion (Shirley & Chiu, "A Low Distortion Map Between Disk and
/// Square", 1997). Density `1 / pi` per area.
#[inline]
pub fn square_to_disc(u: Vec2) -> Vec2 {
    let p = 2.0 * u - Vec2::ONE;
    if p.x == 0.0 && p.y == 0.0 {
        return Vec2::ZERO;
    }
    let (r, (sin, cos)) = if p.x.abs() > p.y.abs() {
        (p.x, sin_cos_eighth(p.y / p.x))
    } else {
        // Here the angle is taken from the y axis instead of the x axis.
        let (cos, sin) = sin_cos_eighth(p.x / p.y);
        (p.y, (sin, cos))
    };
    Vec2::new(r * cos, r * sin)
}

/// The point of the unit square that [`square_to_disc`] maps to `d`, a point of the unit disc.
#[inline]
pub fn disc_to_square(d: Vec2) -> Vec2 {
    const PER_RADIAN: f32 = 1.0 / FRAC_PI_4;
    let r = d.length();
    let p = if d.x.abs() > d.y.abs() {
        let r = r.copysign(d.x);
        Vec2::new(r, r * (d.y / d.x).atan() * PER_RADIAN)
    } else if d.y != 0.0 {
        let r = r.copysign(d.y);
        Vec2::new(r * (d.x / d.y).atan() * PER_RADIAN, r)
    } else {
        Vec2::ZERO
    };
    (0.5 * p + 0.5).clamp(Vec2::ZERO, Vec2::ONE)
}

/// Lipschitz constant of [`square_to_disc`]: two points are at most this factor farther apart on the disc than on the square. The Jacobian
/// is `2 [[1, 0], [-phi, pi/4]]` with `|phi| <= pi/4`, and its Frobenius norm is no larger than this constant.
pub const DISC_STRETCH: f64 = 2.99;

/// Sine and cosine of `pi/4 x` for `x` in `[-1, 1]`, by their Taylor polynomials. They are accurate to 3e-8, have the same bits on every
/// machine, and are several times faster than the general functions.
#[inline]
fn sin_cos_eighth(x: f32) -> (f32, f32) {
    let phi = FRAC_PI_4 * x;
    let s = phi * phi;
    let sin =
        phi * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s * (1.0 / 362_880.0)))));
    let cos = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s * (1.0 / 40_320.0))));
    (sin, cos)
}

/// Sine and cosine of `2 pi x` for `x` in `[0, 1]`, with the accuracy of [`sin_cos_eighth`].
#[inline]
fn sin_cos_turns(x: f32) -> (f32, f32) {
    // The nearest of the four axes, and the angle from it.
    let quarter = (4.0 * x + 0.5) as i32;
    let (sin, cos) = sin_cos_eighth(2.0 * (4.0 * x - quarter as f32));
    let (sin, cos) = if quarter & 1 == 0 { (sin, cos) } else { (cos, -sin) };
    if quarter & 2 == 0 { (sin, cos) } else { (-sin, -cos) }
}

/// Maps the square to the hemisphere around +z with density `cos(theta) / pi` per solid angle (Malley's method).
#[inline]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = square_to_disc(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Density of [`square_to_cosine_hemisphere`] per solid angle.
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// Maps the square to the sphere with density `1 / (4 pi)` per solid angle.
pub fn square_to_sphere(u: Vec2) -> Vec3 {
    square_to_cone(u, 2.0)
}

/// Maps the square to the cone around +z of all directions with `1 - cos(theta) <= one_minus_cos`, with density [`cone_pdf`] per solid
/// angle. The parameter is `one_minus_cos` instead of the cosine because the cosine of a distant light's cone of 1e-5 rad rounds to one
/// in `f32`.
pub fn square_to_cone(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let drop = u.x * one_minus_cos;
    let sin = (drop * (2.0 - drop)).max(0.0).sqrt();
    let (s, c) = sin_cos_turns(u.y);
    Vec3::new(sin * c, sin * s, 1.0 - drop)
}

/// Density of [`square_to_cone`] per solid angle, inside the cone.
pub fn cone_pdf(one_minus_cos: f32) -> f32 {
    1.0 / (TAU * one_minus_cos)
}

/// `1 - cos` of the half angle of a sphere of `radius` as seen from `distance`, for `distance > radius`, without the cancellation of the
/// direct formula.
pub fn sphere_one_minus_cos(radius: f32, distance: f32) -> f32 {
    let sin_squared = (radius / distance).powi(2).min(1.0);
    sin_squared / (1.0 + (1.0 - sin_squared).sqrt())
}

/// Barycentric coordinates of the second and third vertex, uniform over a triangle (Heitz, "A Low-Distortion Map
/// Between Triangle and Square", 2019).
#[inline]
pub fn square_to_triangle(u: Vec2) -> Vec2 {
    let (x, y) = (u.x, u.y);
    if y > x {
        let b = 0.5 * x;
        Vec2::new(b, y - b)
    } else {
        let b = 0.5 * y;
        Vec2::new(x - b, b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn means_of_the_warps() {
        let mut rng = Rng::new(3, Stream::Measure, 1);
        let n = 400_000;
        let (mut disc, mut cosine, mut sphere, mut cone, mut triangle) =
            (Vec2::ZERO, Vec3::ZERO, Vec3::ZERO, 0f64, Vec2::ZERO);
        let mut disc_r2 = 0f64;
        for _ in 0..n {
            let u = rng.next_2d();
            let d = square_to_disc(u);
            disc += d;
            disc_r2 += f64::from(d.length_squared());
            cosine += square_to_cosine_hemisphere(u);
            sphere += square_to_sphere(u);
            cone += f64::from(square_to_cone(u, 0.3).z);
            let t = square_to_triangle(u);
            assert!(t.x >= 0.0 && t.y >= 0.0 && t.x + t.y <= 1.0 + 1e-6);
            triangle += t;
        }
        let n = n as f32;
        assert!((disc / n).length() < 0.005);
        assert!((disc_r2 / f64::from(n) - 0.5).abs() < 0.003);
        assert!((cosine / n - Vec3::new(0.0, 0.0, 2.0 / 3.0)).length() < 0.005);
        assert!((sphere / n).length() < 0.005);
        assert!((cone / f64::from(n) - 0.85).abs() < 1e-3);
        assert!((triangle / n - Vec2::splat(1.0 / 3.0)).length() < 0.003);
    }

    #[test]
    fn the_disc_map_follows_the_trigonometric_functions() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0;
            let (sin, cos) = sin_cos_eighth(x);
            let phi = std::f64::consts::FRAC_PI_4 * f64::from(x);
            assert!((f64::from(sin) - phi.sin()).abs() < 1e-7 && (f64::from(cos) - phi.cos()).abs() < 1e-7);
        }
        for i in 0..=4096 {
            let (sin, cos) = sin_cos_turns(i as f32 / 4096.0);
            let (s, c) = (std::f64::consts::TAU * f64::from(i) / 4096.0).sin_cos();
            assert!((f64::from(sin) - s).abs() < 1e-7 && (f64::from(cos) - c).abs() < 1e-7, "{i}");
        }
        assert_eq!(square_to_disc(Vec2::splat(0.5)), Vec2::ZERO);
    }

    #[test]
    fn the_disc_leads_back_to_the_square() {
        let mut rng = Rng::new(4, Stream::Measure, 2);
        for _ in 0..100_000 {
            let u = rng.next_2d();
            assert!((disc_to_square(square_to_disc(u)) - u).abs().max_element() < 1e-6, "{u}");
        }
        for u in [Vec2::ZERO, Vec2::ONE, Vec2::new(0.5, 0.0), Vec2::new(1.0, 0.5), Vec2::splat(0.5)] {
            assert!((disc_to_square(square_to_disc(u)) - u).abs().max_element() < 1e-6, "{u}");
        }
    }

    #[test]
    fn far_sphere_keeps_its_solid_angle() {
        // radius 1 at 1e5: 1 - cos = 5e-11, which 1 - cos in f32 would round to zero.
        let x = sphere_one_minus_cos(1.0, 1e5);
        assert!((x / 5e-11 - 1.0).abs() < 1e-5, "{x}");
        let v = square_to_cone(Vec2::new(0.9, 0.1), x);
        assert!((v.x.hypot(v.y) / (2.0f32 * 0.9 * 5e-11).sqrt() - 1.0).abs() < 1e-4);
    }
}
