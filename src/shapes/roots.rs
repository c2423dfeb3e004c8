//! Intersection of lines with spheres and cylinders, and selection of roots.

use glam::DVec3;

/// Parameters, ascending, at which the line `offset + t direction` meets the sphere of `radius` around the origin. Where both vectors lack
/// their axial component, it is the circular cylinder. `None` for a miss, a direction of zero, and NaN.
///
/// The form is that of Haines, Günther & Akenine-Möller, "Precision Improvements for Ray/Sphere Intersection" (Ray
/// Tracing Gems, 2019). The discriminant comes from the closest point of the line, which is accurate for small distant
/// spheres. The smaller root is a quotient, which for an origin close to a large sphere is as accurate as the origin's
/// distance from the surface.
pub(super) fn sphere_roots(offset: DVec3, direction: DVec3, radius: f64) -> Option<[f64; 2]> {
    let a = direction.length_squared();
    let b = -offset.dot(direction);
    let closest = (offset + (b / a) * direction).length();
    let discriminant = a * ((radius - closest) * (radius + closest));
    // A direction of zero or one that is not finite gives NaN, which is not finite either.
    if !discriminant.is_finite() || discriminant < 0.0 {
        return None;
    }
    let q = b + discriminant.sqrt().copysign(b);
    if q == 0.0 {
        return Some([0.0, 0.0]);
    }
    let distance = offset.length();
    let (one, other) = ((distance - radius) * (distance + radius) / q, q / a);
    Some(if one < other { [one, other] } else { [other, one] })
}

/// `t` rounded to `f32` for Embree; `None` unless it is then finite and in `(0, t_max]`.
pub(super) fn accept(t: f64, t_max: f32) -> Option<f32> {
    let t = t as f32;
    (t > 0.0 && t <= t_max && t < f32::INFINITY).then_some(t)
}

/// The candidate nearest to the `f32` parameter `t` that a traversal returned.
pub(super) fn nearest_to(t: f32, candidates: impl IntoIterator<Item = f64>) -> Option<f64> {
    let distance = |x: &f64| (x - f64::from(t)).abs();
    candidates.into_iter().min_by(|x, y| distance(x).total_cmp(&distance(y)))
}
