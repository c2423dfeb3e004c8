//! Intervals of a line inside convex bodies.

/// Interval of a line inside a convex body, with the faces of entry and exit. It may extend to infinity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) enter: (f64, u8),
    pub(super) exit: (f64, u8),
}

impl Span {
    /// The whole line.
    pub(super) const ALL: Self = Self { enter: (f64::NEG_INFINITY, 0), exit: (f64::INFINITY, 0) };

    fn empty() -> Self {
        Self { enter: (f64::INFINITY, 0), exit: (f64::NEG_INFINITY, 0) }
    }

    /// The intersection of both intervals.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            enter: if other.enter.0 > self.enter.0 { other.enter } else { self.enter },
            exit: if other.exit.0 < self.exit.0 { other.exit } else { self.exit },
        }
    }

    /// The interval with `-1 <= p + s d <= 1`, between the faces `low` and `high`.
    pub(super) fn slab(p: f64, d: f64, low: u8, high: u8) -> Self {
        if d == 0.0 {
            return if p.abs() <= 1.0 { Self::ALL } else { Self::empty() };
        }
        let (a, b) = ((-1.0 - p) / d, (1.0 - p) / d);
        if d > 0.0 { Self::between(a, low, b, high) } else { Self::between(b, high, a, low) }
    }

    fn between(enter: f64, enter_face: u8, exit: f64, exit_face: u8) -> Self {
        Self { enter: (enter, enter_face), exit: (exit, exit_face) }
    }

    /// The interval with `a s^2 + 2 b s + c <= 0`, bounded by one `face`. Where `a < 0` there are two intervals: the one that extends to
    /// minus infinity is returned with `before`, the other without.
    pub(super) fn quadric(a: f64, b: f64, c: f64, face: u8, before: bool) -> Self {
        let span = |enter, exit| Self::between(enter, face, exit, face);
        let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
        if a == 0.0 {
            return match -c / (2.0 * b) {
                root if b > 0.0 => span(low, root),
                root if b < 0.0 => span(root, high),
                _ if c <= 0.0 => Self::ALL,
                _ => Self::empty(),
            };
        }
        let discriminant = b * b - a * c;
        if !(discriminant >= 0.0) && a > 0.0 {
            return Self::empty();
        }
        // The smaller root is computed as a quotient, which avoids cancellation.
        let q = -(b + discriminant.max(0.0).sqrt().copysign(b));
        let (one, other) = if q == 0.0 { (0.0, 0.0) } else { (q / a, c / q) };
        let (first, second) = if one < other { (one, other) } else { (other, one) };
        match a > 0.0 {
            true => span(first, second),
            false if before => span(low, first),
            false => span(second, high),
        }
    }

    /// The two ends; `None` where the interval is empty.
    pub(super) fn ends(self) -> Option<[(f64, u8); 2]> {
        (self.enter.0 < self.exit.0).then_some([self.enter, self.exit])
    }
}
