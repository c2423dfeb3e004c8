use glam::Vec3;

/// True where the direction `w` is strictly on the same side of the shading normal `ns` and of the geometric
/// normal `ng`.
///
/// Every direction that is sampled or evaluated must pass: otherwise light leaks through the surface, as a
/// reflection about `ns` may go below `ng`. Such light counts as absorbed.
#[inline]
pub fn sides_agree(w: Vec3, ns: Vec3, ng: Vec3) -> bool {
    // Not the sign of the product, which underflows to zero.
    let (s, g) = (w.dot(ns), w.dot(ng));
    (s > 0.0 && g > 0.0) || (s < 0.0 && g < 0.0)
}

/// Factor on the power of a photon that scatters where shading normal and geometric normal differ:
/// `|wo.ns| |wi.ng| / (|wo.ng| |wi.ns|)` (Veach 1997, section 5.3, equation 5.19).
///
/// `wo` points to the previous vertex, which for a photon is on the *light's* side; `wi` is the direction in
/// which the photon goes on. All four vectors are unit vectors in one frame. A camera path takes no factor: a
/// shading normal changes the meaning of the BSDF by `|w_light.ns| / |w_light.ng|`, which for a camera path
/// turns the cosine at `wi` from the geometric into the shading one, as is done anyway, while a photon
/// arrived with the geometric cosine at `wo` and leaves with the one at `wi`. Delta lobes take the factor as
/// well.
///
/// Zero where a direction fails [`sides_agree`]. Equal normals give one exactly. The factor has no upper
/// bound at a grazing `wo.ng` or `wi.ns`, and the caller's roulette has to keep the power bounded; where it
/// leaves the range of `f32` it is zero.
pub fn shading_normal_correction(wo: Vec3, wi: Vec3, ns: Vec3, ng: Vec3) -> f32 {
    if !(sides_agree(wo, ns, ng) && sides_agree(wi, ns, ng)) {
        return 0.0;
    }
    // Two ratios, each one exactly where the normals agree; in f64, which no quotient of two f32 leaves.
    let ratio = |a: f32, b: f32| f64::from(a) / f64::from(b);
    let factor = (ratio(wo.dot(ns), wo.dot(ng)) * ratio(wi.dot(ng), wi.dot(ns))) as f32;
    if factor.is_finite() { factor } else { 0.0 }
}
