//! A walk along a line through cells of a lattice.

use glam::{DVec3, IVec3};

/// Cells that a line passes, in order, with the parameters between which it is in each.
///
/// After Amanatides & Woo, "A Fast Voxel Traversal Algorithm" (Eurographics 1987), in `f64`. The next border is computed anew from
/// its integer coordinate each time, so that nothing adds up, and the cell is stepped and never derived from a parameter: no rounding
/// skips one or ends the walk.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    origin: DVec3,
    /// One over the direction; infinite where the line does not move.
    inverse: DVec3,
    step: IVec3,
    cell: IVec3,
    low: IVec3,
    high: IVec3,
    /// Parameter of the next border of each axis.
    next: DVec3,
    t: f64,
    end: f64,
    is_done: bool,
}

impl Cells {
    /// The walk along `origin + t * direction` (in units of a cell) for `t` from `start` to `end`, within the cells from `low` to
    /// before `high`.
    pub(super) fn new(
        origin: DVec3,
        direction: DVec3,
        (start, end): (f64, f64),
        low: IVec3,
        high: IVec3,
    ) -> Self {
        let mut walk = Self {
            origin,
            inverse: direction.recip(),
            step: direction.signum().as_ivec3(),
            cell: low,
            low,
            high,
            next: DVec3::INFINITY,
            t: start,
            end,
            is_done: true,
        };
        // Not so where one is no number, which the minima below would forget.
        if !(start < end) {
            return walk;
        }
        let (near, far) = (low.as_dvec3(), high.as_dvec3());
        for axis in 0..3 {
            if direction[axis] == 0.0 {
                walk.step[axis] = 0;
                if !(origin[axis] >= near[axis] && origin[axis] < far[axis]) {
                    return walk;
                }
            } else {
                let [a, b] = [near, far].map(|side| (side[axis] - origin[axis]) * walk.inverse[axis]);
                walk.t = walk.t.max(a.min(b));
                walk.end = walk.end.min(a.max(b));
            }
        }
        if !(walk.t < walk.end) || low.cmpge(high).any() {
            return walk;
        }
        walk.is_done = false;
        let start = origin + direction * walk.t;
        walk.cell = start.floor().clamp(near, far - 1.0).as_ivec3();
        walk.next = DVec3::from_array([0, 1, 2].map(|axis| walk.border(axis)));
        walk
    }

    /// Parameter at which the line leaves the present cell along `axis`.
    fn border(&self, axis: usize) -> f64 {
        match self.step[axis] {
            0 => f64::INFINITY,
            step => {
                (f64::from(self.cell[axis] + i32::from(step > 0)) - self.origin[axis]) * self.inverse[axis]
            }
        }
    }
}

impl Iterator for Cells {
    type Item = (IVec3, f64, f64);

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_done {
            let axis = self.next.min_position();
            let (cell, t0) = (self.cell, self.t);
            let border = self.next[axis];
            if border < self.end {
                self.cell[axis] += self.step[axis];
                self.is_done = self.cell[axis] < self.low[axis] || self.cell[axis] >= self.high[axis];
                self.next[axis] = self.border(axis);
                self.t = t0.max(border);
            } else {
                self.t = self.end;
                self.is_done = true;
            }
            if self.t > t0 {
                return Some((cell, t0, self.t));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::test_lines::random_point;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn every_cell_on_the_way_is_met_in_order() {
        let mut rng = Rng::new(1, Stream::Measure, 31);
        let (low, high) = (IVec3::new(-3, 2, -7), IVec3::new(9, 5, 4));
        let mut met = 0;
        for i in 0..20_000 {
            let origin = random_point(&mut rng, DVec3::splat(-12.0), DVec3::splat(12.0));
            let mut direction = random_point(&mut rng, DVec3::NEG_ONE, DVec3::ONE);
            // Along axes and planes, too, and from borders.
            for axis in 0..3 {
                if i >> axis & 1 == 1 {
                    direction[axis] = 0.0;
                }
            }
            let origin = if i % 5 == 0 { origin.floor() } else { origin };
            if direction == DVec3::ZERO {
                continue;
            }
            let mut end = f64::NEG_INFINITY;
            for (cell, t0, t1) in Cells::new(origin, direction, (0.0, 40.0), low, high) {
                assert!(t1 > t0 && t0 >= 0.0 && t1 <= 40.0);
                assert!(end == f64::NEG_INFINITY || t0 == end, "a gap before {t0}");
                assert!(cell.cmpge(low).all() && cell.cmplt(high).all());
                end = t1;
                met += 1;
                let place = origin + direction * (0.5 * (t0 + t1));
                let inside = cell.as_dvec3();
                let room = 1e-9;
                assert!(
                    place.cmpge(inside - room).all() && place.cmple(inside + 1.0 + room).all(),
                    "{place} is not in {cell}"
                );
            }
            // Points of the line within the box are covered.
            for _ in 0..4 {
                let t = 40.0 * rng.next_f64();
                let place = origin + direction * t;
                if place.cmpgt(low.as_dvec3() + 1e-9).all() && place.cmplt(high.as_dvec3() - 1e-9).all() {
                    assert!(t <= end, "{place} at {t} is behind the end {end}");
                }
            }
        }
        assert!(met > 5000, "{met}");
    }

    #[test]
    fn what_misses_the_box_meets_nothing() {
        let none = |origin, direction, range| {
            Cells::new(origin, direction, range, IVec3::ZERO, IVec3::splat(4)).count() == 0
        };
        assert!(none(DVec3::new(-1.0, 5.0, 1.0), DVec3::X, (0.0, 10.0)));
        assert!(none(DVec3::new(-1.0, 1.0, 1.0), DVec3::NEG_X, (0.0, 10.0)));
        assert!(none(DVec3::new(-1.0, 1.0, 1.0), DVec3::X, (0.0, 0.5)));
        assert!(none(DVec3::new(-1.0, 1.0, 1.0), DVec3::X, (0.0, f64::NAN)));
        assert!(!none(DVec3::new(-1.0, 1.0, 1.0), DVec3::X, (0.0, f64::INFINITY)));
        assert_eq!(Cells::new(DVec3::ONE, DVec3::X, (0.0, 1.0), IVec3::ZERO, IVec3::ZERO).count(), 0);
    }
}
