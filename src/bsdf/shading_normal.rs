//! Agreement of directions with the shading normal and the geometric normal.

use glam::Vec3;

/// Whether the direction `w` is strictly on the same side of the shading normal `ns` and of the geometric normal `ng`. Light for which
/// it is not is handled by [`super::Bent`].
#[inline]
pub fn sides_agree(w: Vec3, ns: Vec3, ng: Vec3) -> bool {
    // Does not use the sign of the product, which underflows to zero.
    let (s, g) = (w.dot(ns), w.dot(ng));
    (s > 0.0 && g > 0.0) || (s < 0.0 && g < 0.0)
}
