//! Fresnel reflectance of smooth interfaces, and the mirrored and refracted directions.

use glam::Vec3;

/// Squared cosine on the far side times `eta^2`, from the cosine on the near side: negative beyond the critical angle. The formula uses
/// `eta - 1`, which is exact near one, so that there is no cancellation at grazing angles or for nearly matched indices, as there is in
/// `1 - sin^2 / eta^2`.
#[inline]
fn scaled_cos_squared(cos_i: f32, eta: f32) -> f32 {
    (eta - 1.0) * (eta + 1.0) + cos_i * cos_i
}

/// Fraction of unpolarised light that a smooth interface reflects, in `[0, 1]`.
///
/// `cos_i` is the cosine between the incident direction and the normal, of either sign; `eta` is the index of refraction on the far side
/// over that on the incident side. The result is one beyond the critical angle.
///
/// The amplitudes of Born & Wolf, *Principles of Optics*, section 1.5.2, multiplied out so that no difference of nearly equal numbers
/// remains: with `a = eta cos_t`, `r_s = -(eta^2 - 1) / (cos_i + a)^2` and `r_p = (eta^2 - 1) ((eta^2 + 1) cos_i^2 - 1) / (eta^2 cos_i +
/// a)^2`.
#[inline]
pub fn fresnel_dielectric(cos_i: f32, eta: f32) -> f32 {
    if eta == 1.0 {
        return 0.0;
    }
    let cos_i = cos_i.abs().min(1.0);
    let a_squared = scaled_cos_squared(cos_i, eta);
    if a_squared <= 0.0 || a_squared.is_nan() {
        return 1.0;
    }
    let a = a_squared.sqrt();
    let eta_squared = eta * eta;
    let contrast = (eta - 1.0) * (eta + 1.0);
    let s = cos_i + a;
    let p = eta_squared * cos_i + a;
    let r_s = contrast / s / s;
    let r_p = contrast / p * ((eta_squared + 1.0) * cos_i * cos_i - 1.0) / p;
    (0.5 * (r_s * r_s + r_p * r_p)).min(1.0)
}

/// Cosine of the critical angle, measured on the incident side: light at smaller cosines is reflected completely. Zero where `eta`, the
/// far index over the incident one, is at least one.
pub fn critical_cosine(eta: f32) -> f32 {
    ((1.0 - eta) * (1.0 + eta)).max(0.0).sqrt()
}

/// Mirror image of the local direction `wo` about the normal `z`; exact.
#[inline]
pub fn reflect(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

/// The refracted direction of the local unit vector `wo`, pointing away from the surface on the other side, unit length with `z != 0`.
/// `None` beyond the critical angle and where `wo.z` is zero. `eta` is the index of refraction on the far side over that on the side of
/// `wo` (Snell: `sin_i = eta sin_t`). For light that leaves a dense medium, `eta < 1`, the error of `cos_t^2` is that of `wo.z` over
/// `eta^2`: 1e-7 for water or diamond, but meaningless for an index of 1000.
#[inline]
pub fn refract(wo: Vec3, eta: f32) -> Option<Vec3> {
    let a_squared = scaled_cos_squared(wo.z, eta);
    if !(a_squared > 0.0 && wo.z != 0.0) {
        return None;
    }
    // All components are scaled by eta. The division by the length, which is eta except for rounding, makes the result a unit vector
    // whatever the error of `wo`, so that errors do not grow along a path of many refractions.
    let scaled = Vec3::new(-wo.x, -wo.y, -a_squared.sqrt().copysign(wo.z));
    Some(scaled / scaled.length())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cos_of_degrees(degrees: f64) -> f32 {
        degrees.to_radians().cos() as f32
    }

    /// Textbook formula in `f64`, for `n_i = 1`.
    fn textbook(cos_i: f64, eta: f64) -> f64 {
        let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (eta * eta)).sqrt();
        let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
        let r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
        0.5 * (r_s * r_s + r_p * r_p)
    }

    #[test]
    fn tabulated_reflectances() {
        let table = [
            (1.5, 0.0, 0.04000),
            (1.5, 30.0, 0.04152),
            (1.5, 45.0, 0.05024),
            (1.5, 60.0, 0.08919),
            (1.5, 75.0, 0.25306),
            (1.5, 85.0, 0.61280),
            (1.52, 0.0, 0.04258),
            (1.52, 60.0, 0.09248),
            (1.33, 0.0, 0.02006),
            (1.33, 60.0, 0.05913),
            (2.417, 0.0, 0.17197),
        ];
        for (n, degrees, want) in table {
            let r = fresnel_dielectric(cos_of_degrees(degrees), n);
            assert!((r - want).abs() < 6e-6, "n {n}, {degrees} degrees: {r}, not {want}");
        }
    }

    #[test]
    fn slab_with_all_interreflections() {
        // (1 - R) / (1 + R): the value to which a tracer of unpolarised light converges.
        let table = [(1.5, 0.0, 0.92308), (1.5, 60.0, 0.83623), (1.5, 85.0, 0.24008), (1.33, 60.0, 0.88835)];
        for (n, degrees, want) in table {
            let r = fresnel_dielectric(cos_of_degrees(degrees), n);
            assert!(((1.0 - r) / (1.0 + r) - want).abs() < 1e-5, "n {n}, {degrees} degrees");
        }
    }

    #[test]
    fn relative_error_against_f64() {
        for eta in [1.0001f32, 1.01, 1.33, 1.5, 2.417, 10.0, 1000.0, 1.0 / 1.5, 1.0 / 1.0001] {
            for step in 1..=2000 {
                let cos_i = step as f32 / 2000.0;
                if cos_i <= critical_cosine(eta) * 1.001 {
                    continue;
                }
                let (r, want) = (fresnel_dielectric(cos_i, eta), textbook(f64::from(cos_i), f64::from(eta)));
                // The f64 formula itself suffers from cancellation near eta = 1.
                let tolerance = 5e-6 * want + 1e-15;
                assert!((f64::from(r) - want).abs() < tolerance, "eta {eta}, cos {cos_i}: {r} {want}");
            }
        }
    }

    #[test]
    fn brewster_angle() {
        for (n, degrees) in [(1.5f32, 56.3099), (1.33, 53.0612), (2.417, 67.5234)] {
            // At the Brewster angle r_p = 0, so R = r_s^2 / 2 with r_s = -(n^2 - 1) / (n^2 + 1).
            let r_s = (n * n - 1.0) / (n * n + 1.0);
            let r = fresnel_dielectric(cos_of_degrees(degrees), n);
            assert!((r - 0.5 * r_s * r_s).abs() < 1e-6, "n {n}: {r}");
        }
    }

    #[test]
    fn critical_angle() {
        for (n, degrees) in [(1.5f32, 41.8103f64), (1.33, 48.7535), (2.417, 24.4397)] {
            let angle = f64::from(critical_cosine(1.0 / n)).acos().to_degrees();
            assert!((angle - degrees).abs() < 1e-4, "n {n}: {angle}");
            assert_eq!(fresnel_dielectric(cos_of_degrees(degrees + 0.01), 1.0 / n), 1.0);
            assert!(fresnel_dielectric(cos_of_degrees(degrees - 0.01), 1.0 / n) < 1.0);
        }
        assert_eq!(critical_cosine(1.5), 0.0);
    }

    #[test]
    fn both_ways_reflect_alike() {
        // Stokes: R from outside at theta_i equals R from inside at theta_t.
        for n in [1.0001f32, 1.33, 1.5, 2.417, 10.0] {
            for step in 1..200 {
                let cos_i = step as f32 / 200.0;
                let wo = Vec3::new((1.0 - cos_i * cos_i).sqrt(), 0.0, cos_i);
                let wt = refract(wo, n).unwrap();
                let (outside, inside) = (fresnel_dielectric(wo.z, n), fresnel_dielectric(wt.z, 1.0 / n));
                // Close to the critical angle R is a steep function of a cosine that f32 represents to 1e-7: the squared cosine outside
                // has an error of 1e-7 n^2, and the cosine has that error divided by cos_i.
                let tolerance = 3e-7 * n.powi(3) / cos_i + 1e-3 * outside;
                assert!((outside - inside).abs() < tolerance, "n {n}: {outside} {inside}");
            }
        }
    }

    #[test]
    fn snell_and_length() {
        for eta in [0.4f32, 0.667, 0.9999, 1.0, 1.0001, 1.5, 1000.0] {
            for step in 0..=1000 {
                let angle = step as f32 / 1000.0 * 1.57;
                let wo = Vec3::new(angle.sin() * 0.6, angle.sin() * 0.8, angle.cos());
                for wo in [wo, -wo] {
                    let Some(wi) = refract(wo, eta) else {
                        assert!(wo.z.abs() <= critical_cosine(eta) * 1.001);
                        continue;
                    };
                    assert!((wi.length() - 1.0).abs() < 3e-7);
                    assert!(wi.z * wo.z < 0.0);
                    let (sin_i, sin_t) = (wo.x.hypot(wo.y), wi.x.hypot(wi.y));
                    assert!((sin_i - eta * sin_t).abs() < 3e-7 * eta.max(1.0), "eta {eta}, angle {angle}");
                }
            }
        }
    }

    #[test]
    fn lateral_shift_of_a_slab() {
        // Thickness 1, n = 1.5: sin(theta - theta_t) / cos(theta_t).
        for (degrees, want) in [(15.0f32, 0.089615), (30.0, 0.193814), (45.0, 0.329142), (75.0, 0.748080)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let inside = refract(Vec3::new(-sin, 0.0, cos), 1.5).unwrap();
            // Inside the slab the ray moves sideways by tan(theta_t), where the straight ray moves by tan(theta).
            let shift = (sin / cos - inside.x / -inside.z) * cos;
            assert!((shift - want).abs() < 2e-6, "{degrees}: {shift}");
        }
    }

    #[test]
    fn extremes_stay_in_range() {
        for eta in [1e-3f32, 0.5, 1.0 - 1e-7, 1.0, 1.0 + 1.2e-7, 1.0001, 1.5, 1e3, 1e6, f32::NAN] {
            for cos_i in [0.0, 1e-45, 1e-38, 1e-20, 1e-6, 0.5, 1.0, 1.000_001, -0.5, f32::NAN] {
                let r = fresnel_dielectric(cos_i, eta);
                assert!((0.0..=1.0).contains(&r), "eta {eta}, cos {cos_i}: {r}");
            }
            if eta != 1.0 {
                assert!(fresnel_dielectric(1e-38, eta) > 0.999_999, "eta {eta}");
            }
        }
    }
}
