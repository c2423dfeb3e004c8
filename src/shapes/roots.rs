use glam::DVec3;

/// Parameters at which the line `offset + t direction` meets the sphere of `radius` around zero, ascending;
/// the circular cylinder where both vectors lack their axial part. `None` for a miss, a direction of zero,
/// and NaN.
///
/// In the form of Haines, Günther & Akenine-Möller, "Precision Improvements for Ray/Sphere Intersection" (Ray
/// Tracing Gems, 2019): the discriminant from the closest point of the line, which keeps a small sphere far
/// away; and the smaller root as a quotient, which for an origin close to a large sphere is as exact as the
/// origin's distance from the surface.
pub(super) fn sphere_roots(offset: DVec3, direction: DVec3, radius: f64) -> Option<[f64; 2]> {
    let a = direction.length_squared();
    let b = -offset.dot(direction);
    let closest = (offset + (b / a) * direction).length();
    let discriminant = a * ((radius - closest) * (radius + closest));
    // NaN compares false as well: from a direction of zero, or from one that is not finite.
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

/// `t` as Embree takes it: `None` unless, rounded to `f32`, it is in `(0, t_max]` and finite.
pub(super) fn accept(t: f64, t_max: f32) -> Option<f32> {
    let t = t as f32;
    (t > 0.0 && t <= t_max && t < f32::INFINITY).then_some(t)
}

/// Whichever of `candidates` is nearest to the `f32` parameter `t` that a traversal returned.
pub(super) fn nearest_to(t: f32, candidates: impl IntoIterator<Item = f64>) -> Option<f64> {
    let distance = |x: &f64| (x - f64::from(t)).abs();
    candidates.into_iter().min_by(|x, y| distance(x).total_cmp(&distance(y)))
}
