//! Bounds on rounding errors of `f32` arithmetic (Higham 2002; Pharr, Jakob & Humphreys, section 6.8).

/// Unit roundoff of `f32`: half the distance from 1 to the next number.
pub const UNIT_ROUNDOFF: f32 = f32::EPSILON * 0.5;

/// Bound on the relative error after `n` roundings: `n u / (1 - n u)`.
pub const fn gamma(n: u32) -> f32 {
    let nu = n as f32 * UNIT_ROUNDOFF;
    nu / (1.0 - nu)
}
