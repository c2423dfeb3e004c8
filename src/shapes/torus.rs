//! Intersection of a line with a torus.

use arrayvec::ArrayVec;
use glam::DVec3;

/// Coefficients of a polynomial of degree 4, in ascending powers.
type Quartic = [f64; 5];

/// Parameters, ascending, at which the line `p + s u` meets the torus around the z axis with the radii 1 (of its middle
/// circle) and `minor`, below 1. `u` is a unit vector and `p` the line's closest point to the origin. The number of roots is even, as the
/// line starts and ends outside.
///
/// Between neighbouring zeros of its derivative a polynomial is monotone, so each interval with a change of sign has exactly one root. It
/// is found by bisection and Newton's method. The zeros of the derivative are found in the same way from those of the second derivative,
/// which are explicit. The method never diverges, and no single root is found twice or lost: two roots closer than rounding are both
/// found or both missed.
pub(super) fn torus_roots(p: DVec3, u: DVec3, minor: f64) -> ArrayVec<f64, 4> {
    let mut roots = ArrayVec::new();
    let reach_squared = (1.0 + minor) * (1.0 + minor) - p.length_squared();
    if !(reach_squared > 0.0) {
        return roots;
    }
    // f = (|x|^2 + 1 - minor^2)^2 - 4 (x^2 + y^2); no cubic term, since p is the closest point.
    let bulge = p.length_squared() + (1.0 - minor) * (1.0 + minor);
    let across = p.truncate().length_squared();
    let f: Quartic = [
        bulge * bulge - 4.0 * across,
        -8.0 * p.truncate().dot(u.truncate()),
        2.0 * bulge - 4.0 * u.truncate().length_squared(),
        0.0,
        1.0,
    ];
    // Slightly beyond the bounding sphere, where f is positive in spite of rounding.
    let end = reach_squared.sqrt() * (1.0 + 1e-9) + 1e-9;
    let df: Quartic = [f[1], 2.0 * f[2], 0.0, 4.0, 0.0];
    let bend = (-f[2] / 6.0).max(0.0).sqrt().min(end);
    let mut turns: ArrayVec<f64, 5> = ArrayVec::new();
    turns.push(-end);
    between_signs(&df, &[-end, -bend, bend, end], |s| turns.push(s));
    turns.push(end);
    between_signs(&f, &turns, |s| {
        if !roots.is_full() {
            roots.push(polished(p, u, minor, s));
        }
    });
    if roots.len() % 2 == 1 {
        // This occurs only where rounding makes f negative at an end, for a line that touches the outermost circle.
        roots.pop();
    }
    roots
}

/// Calls `found` for the root in each interval between neighbouring `stops` at whose ends `f` has different signs.
fn between_signs(f: &Quartic, stops: &[f64], mut found: impl FnMut(f64)) {
    for pair in stops.windows(2) {
        let (low, high) = (pair[0], pair[1]);
        let (at_low, at_high) = (value(f, low).0, value(f, high).0);
        if (at_low < 0.0) != (at_high < 0.0) && low < high {
            found(bracketed(f, low, high, at_low < 0.0));
        }
    }
}

/// The root of `f` in `[low, high]`, where `f` increases if `rises` is true. It uses Newton's method, and bisection where that leaves the
/// bracket.
fn bracketed(f: &Quartic, mut low: f64, mut high: f64, rises: bool) -> f64 {
    let mut s = 0.5 * (low + high);
    for _ in 0..100 {
        let (y, slope) = value(f, s);
        if (y < 0.0) == rises {
            low = s
        } else {
            high = s
        }
        let newton = s - y / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - s).abs() <= 2.0 * f64::EPSILON || high - low <= 2.0 * f64::EPSILON {
            return next;
        }
        s = next;
    }
    s
}

/// Value and slope.
fn value(f: &Quartic, s: f64) -> (f64, f64) {
    let y = (((f[4] * s + f[3]) * s + f[2]) * s + f[1]) * s + f[0];
    let slope = ((4.0 * f[4] * s + 3.0 * f[3]) * s + 2.0 * f[2]) * s + f[1];
    (y, slope)
}

/// One step of Newton's method on the squared distance from the middle circle, which is better conditioned than the quartic for a thin
/// torus.
fn polished(p: DVec3, u: DVec3, minor: f64, s: f64) -> f64 {
    let x = p + s * u;
    let radius = x.truncate().length();
    let (off, slope) = (radius - 1.0, x.truncate().dot(u.truncate()) / radius);
    let y = off.mul_add(off, x.z * x.z) - minor * minor;
    let step = y / (2.0 * (off * slope + x.z * u.z));
    // Where the line grazes the surface, the step is unreliable.
    if step.abs() < 1e-6 { s - step } else { s }
}
