//! Triangulation of polygons: fans where they cover the polygon, ear clipping where they do not.
//!
//! A polygon with holes is given as one loop that goes to each hole and back along the same edge. Such loops need no special
//! case.

use super::mesh::Positions;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Bound on the relative rounding error of a cross product of differences, with a margin.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Most point-in-triangle tests for each corner of a polygon before it is given up. No polygon without self-crossings was seen to
/// need as many, and the limit bounds the time that a file can take.
const TESTS_PER_CORNER: usize = 4096;

/// Tests that every polygon may use. Small polygons need fewer.
const TESTS: usize = 1 << 24;

/// Fewest fans for one thread.
const AT_ONCE: usize = 1 << 12;

/// The range of a polygon's triangles in a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// Number of its first triangle.
    pub(super) first: usize,
    /// How many it has.
    pub(super) count: usize,
}

/// Appends a polygon as a fan of triangles around its first corner.
pub(super) fn push_fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    if let [first, rest @ ..] = corners {
        triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    }
}

/// Triangulates a polygon with corners at `place` and appends the triangles, two fewer than it has corners. It uses a fan around
/// the first corner where that covers the polygon, as for all convex polygons, and ear clipping otherwise. Yields false for a
/// polygon that crosses itself, which becomes a fan.
pub fn triangulate_polygon(
    corners: &[u32],
    place: impl Fn(u32) -> DVec3,
    triangles: &mut Vec<[u32; 3]>,
) -> bool {
    if corners.len() <= 3 {
        push_fan(corners, triangles);
        return true;
    }
    match cut(corners, place) {
        Cut::Fan => push_fan(corners, triangles),
        Cut::Ears(ears) => triangles.extend(ears),
        Cut::Crossed => {
            push_fan(corners, triangles);
            return false;
        }
    }
    true
}

/// Replaces the fans that do not cover their polygons. Yields how many polygons cross themselves.
pub(super) fn mend_fans(triangles: &mut [[u32; 3]], polygons: &[Run], positions: &Positions) -> u64 {
    let mut crossed = 0;
    for run in polygons {
        crossed += u64::from(!mend(&mut triangles[run.first..run.first + run.count], positions));
    }
    crossed
}

/// [`mend_fans`] where all polygons have `count` triangles.
pub(super) fn mend_equal_fans(triangles: &mut [[u32; 3]], count: usize, positions: &Positions) -> u64 {
    let fans = triangles.par_chunks_exact_mut(count).with_min_len(AT_ONCE / count + 1);
    fans.map(|fan| u64::from(!mend(fan, positions))).sum()
}

/// Replaces the triangles of a fan that does not cover its polygon. Yields false where the polygon crosses itself.
fn mend(fan: &mut [[u32; 3]], positions: &Positions) -> bool {
    let Some(first) = fan.first() else { return true };
    let corners: Vec<u32> =
        first.iter().copied().chain(fan.iter().skip(1).map(|triangle| triangle[2])).collect();
    match cut(&corners, |vertex| positions.get(vertex)) {
        Cut::Fan => true,
        Cut::Crossed => false,
        Cut::Ears(ears) => {
            fan.iter_mut().zip(ears).for_each(|(triangle, ear)| *triangle = ear);
            true
        }
    }
}

/// Result of a triangulation.
enum Cut {
    /// A fan around the first corner.
    Fan,
    /// These triangles.
    Ears(Vec<[u32; 3]>),
    /// The polygon crosses itself.
    Crossed,
}

/// Triangulates a polygon. Triangles that are all counter-clockwise cover the region that the polygon winds around once, and
/// nothing else, because their winding numbers add up to that of the polygon.
fn cut(corners: &[u32], place: impl Fn(u32) -> DVec3) -> Cut {
    let origin = place(corners[0]);
    let edge = |number: usize| place(corners[number]) - origin;
    let crosses = || (1..corners.len() - 1).map(|number| (edge(number), edge(number + 1)));
    // Newell's normal.
    let normal: DVec3 = crosses().map(|(u, v)| u.cross(v)).sum();
    let size = normal.length();
    // Without area, too large for a cross product, or not finite: there is no orientation to decide by.
    if !(size > 0.0 && size.is_finite()) {
        return Cut::Fan;
    }
    let is_ahead =
        |(u, v): (DVec3, DVec3)| u.cross(v).dot(normal) >= -ROUNDING * size * u.length() * v.length();
    if crosses().all(is_ahead) {
        return Cut::Fan;
    }
    // Projected along the axis with the largest projected area, counter-clockwise.
    let flat = |at: DVec3| {
        let (n, at) = (normal.abs(), at - origin);
        if n.x >= n.y && n.x >= n.z {
            DVec2::new(at.y * normal.x.signum(), at.z)
        } else if n.y >= n.z {
            DVec2::new(at.z * normal.y.signum(), at.x)
        } else {
            DVec2::new(at.x * normal.z.signum(), at.y)
        }
    };
    let ring = Ring::new(corners.iter().map(|&corner| flat(place(corner))).collect());
    match ring.clip() {
        Some(ears) => Cut::Ears(ears.into_iter().map(|ear| ear.map(|number| corners[number])).collect()),
        None => Cut::Crossed,
    }
}

/// Twice the area of a triangle, positive where it is counter-clockwise.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Strictness of the ear test. Each level is tried where the one before it finds no ear.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Care {
    /// The ear has an area, and no corner inside or on its boundary.
    Clear,
    /// No corner strictly inside. Corners may lie on the boundary, or the ear may have no area.
    Touching,
}

/// The rest of a polygon while ears are clipped.
struct Ring {
    at: Vec<DVec2>,
    next: Vec<usize>,
    previous: Vec<usize>,
    is_reflex: Vec<bool>,
    /// Corners that were reflex at first, sorted by their first coordinate. No other corner becomes reflex.
    reflex: Vec<usize>,
    left: usize,
    tests: usize,
}

impl Ring {
    fn new(at: Vec<DVec2>) -> Self {
        let count = at.len();
        let mut ring = Self {
            next: (1..count).chain([0]).collect(),
            previous: [count - 1].into_iter().chain(0..count - 1).collect(),
            is_reflex: vec![false; count],
            reflex: Vec::new(),
            left: count,
            tests: 0,
            at,
        };
        for corner in 0..count {
            ring.is_reflex[corner] = ring.area_at(corner) <= 0.0;
        }
        ring.reflex = (0..count).filter(|&corner| ring.is_reflex[corner]).collect();
        ring.reflex.sort_by(|&a, &b| ring.at[a].x.total_cmp(&ring.at[b].x));
        ring
    }

    /// Twice the area of a corner and its neighbours.
    fn area_at(&self, corner: usize) -> f64 {
        area(self.at[self.previous[corner]], self.at[corner], self.at[self.next[corner]])
    }

    /// Whether the triangle of a corner and its neighbours lies within the polygon.
    fn is_ear(&mut self, corner: usize, care: Care) -> bool {
        let area_here = self.area_at(corner);
        if area_here < 0.0 || care == Care::Clear && area_here == 0.0 {
            return false;
        }
        let [a, b, c] = [self.previous[corner], corner, self.next[corner]].map(|number| self.at[number]);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let from = self.reflex.partition_point(|&other| self.at[other].x < low.x);
        for &other in &self.reflex[from..] {
            self.tests += 1;
            let point = self.at[other];
            if point.x > high.x {
                break;
            }
            // A duplicate of the corner counts too: an edge to a hole visits a position twice.
            let is_corner = point == a || point == b || point == c;
            if is_corner || !self.is_reflex[other] || point.y < low.y || point.y > high.y {
                continue;
            }
            let areas = [area(a, b, point), area(b, c, point), area(c, a, point)];
            let is_in = match care {
                Care::Clear => areas.iter().all(|&area| area >= 0.0),
                Care::Touching => areas.iter().all(|&area| area > 0.0),
            };
            if is_in {
                return false;
            }
        }
        true
    }

    /// All triangles; `None` where no ear is left or some triangles have the wrong orientation.
    fn clip(mut self) -> Option<Vec<[usize; 3]>> {
        let most = TESTS_PER_CORNER.saturating_mul(self.at.len()).saturating_add(TESTS);
        let mut ears = Vec::with_capacity(self.left - 2);
        let (mut corner, mut passed, mut care) = (0, 0, Care::Clear);
        while self.left > 3 {
            if !self.is_ear(corner, care) {
                corner = self.next[corner];
                passed += 1;
                if passed > self.left {
                    if care == Care::Touching {
                        return None;
                    }
                    (care, passed) = (Care::Touching, 0);
                }
                if self.tests > most {
                    return None;
                }
                self.tests += 1;
                continue;
            }
            let (before, after) = (self.previous[corner], self.next[corner]);
            ears.push([before, corner, after]);
            (self.next[before], self.previous[after]) = (after, before);
            self.is_reflex[corner] = false;
            self.left -= 1;
            for neighbour in [before, after] {
                self.is_reflex[neighbour] &= self.area_at(neighbour) <= 0.0;
            }
            // Advances by one corner, so that not all ears meet in one corner.
            (corner, passed, care) = (self.next[after], 0, Care::Clear);
        }
        let (before, after) = (self.previous[corner], self.next[corner]);
        ears.push([before, corner, after]);
        let is_ahead = |ear: &[usize; 3]| {
            let [a, b, c] = ear.map(|number| self.at[number]);
            area(a, b, c) >= -ROUNDING * (b - a).length() * (c - a).length()
        };
        ears.iter().all(is_ahead).then_some(ears)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// Triangles of a flat polygon, and their areas.
    fn cut_flat(points: &[[f64; 2]], tilt: bool) -> (Vec<[u32; 3]>, bool) {
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let place = |corner: u32| {
            let [x, y] = points[corner as usize];
            if tilt { DVec3::new(3.0 + y, x, 0.3 * x - y) } else { DVec3::new(x, y, 0.0) }
        };
        let mut triangles = Vec::new();
        let is_sound = triangulate_polygon(&corners, place, &mut triangles);
        (triangles, is_sound)
    }

    fn polygon_area(points: &[[f64; 2]]) -> f64 {
        let next = points.iter().cycle().skip(1);
        0.5 * points.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    /// Checks that the triangles cover the polygon and nothing else: none has the wrong orientation, and the areas add up.
    #[track_caller]
    fn covers(points: &[[f64; 2]]) {
        let whole = polygon_area(points);
        for tilt in [false, true] {
            let (triangles, is_sound) = cut_flat(points, tilt);
            assert!(is_sound, "{points:?}");
            assert_eq!(triangles.len(), points.len() - 2);
            let mut sum = 0.0;
            for triangle in triangles {
                let [a, b, c] = triangle.map(|corner| DVec2::from_array(points[corner as usize]));
                let area = 0.5 * area(a, b, c) * whole.signum();
                assert!(area >= -1e-12 * whole.abs(), "{points:?}: {area}");
                sum += area;
            }
            assert!((sum - whole.abs()).abs() < 1e-9 * whole.abs(), "{sum} of {whole}");
        }
    }

    #[test]
    fn convex_polygons_are_fans() {
        let (triangles, is_sound) = cut_flat(&[[0., 0.], [2., 0.], [2., 1.], [1., 2.], [0., 1.]], true);
        assert!(is_sound);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        // With a corner on an edge, and a duplicate corner.
        let (triangles, _) = cut_flat(&[[0., 0.], [1., 0.], [2., 0.], [2., 1.], [2., 1.]], false);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    }

    #[test]
    fn concave_polygons_are_covered() {
        // A dart starting at each of its corners, an L, a window with one hole, and one with two holes.
        let dart = [[0., 0.], [4., 0.], [1., 1.], [0., 4.]];
        for turn in 0..4 {
            let mut turned = dart;
            turned.rotate_left(turn);
            covers(&turned);
            turned.reverse();
            covers(&turned);
        }
        covers(&[[3., 0.], [3., 1.], [1., 1.], [1., 3.], [0., 3.], [0., 0.]]);
        let window = [
            [0., 0.],
            [4., 0.],
            [4., 3.],
            [0., 3.],
            [0., 0.],
            [1., 1.],
            [1., 2.],
            [3., 2.],
            [3., 1.],
            [1., 1.],
        ];
        assert_eq!(polygon_area(&window), 10.0);
        for turn in 0..window.len() {
            let mut turned = window;
            turned.rotate_left(turn);
            covers(&turned);
        }
        covers(&[
            [0., 0.],
            [6., 0.],
            [6., 3.],
            [0., 3.],
            [0., 0.],
            [1., 1.],
            [1., 2.],
            [2., 2.],
            [2., 1.],
            [4., 1.],
            [4., 2.],
            [5., 2.],
            [5., 1.],
            [4., 1.],
            [2., 1.],
            [1., 1.],
        ]);
    }

    #[test]
    fn stars_and_combs_of_any_size_are_covered() {
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for count in [5, 8, 21, 100, 3001] {
            for _ in 0..20_000 / count / 10 + 1 {
                // Star-shaped about the centre, but not about the first corner.
                let star: Vec<[f64; 2]> = (0..count)
                    .map(|i| {
                        let angle = std::f64::consts::TAU * i as f64 / count as f64;
                        let radius = 0.2 + rng.next_f64();
                        [radius * angle.cos(), radius * angle.sin()]
                    })
                    .collect();
                covers(&star);
            }
        }
        for teeth in [2, 50, 3000] {
            let mut comb: Vec<[f64; 2]> = vec![[0.0, -1.0], [2.0 * f64::from(teeth), -1.0]];
            for tooth in (0..teeth).rev() {
                let x = 2.0 * f64::from(tooth);
                comb.extend([[x + 2.0, 0.0], [x + 1.0, 10.0], [x, 0.0]]);
            }
            comb.dedup();
            covers(&comb);
            // The same polygon turned by a quarter.
            covers(&comb.iter().map(|&[x, y]| [-y, x]).collect::<Vec<_>>());
        }
    }

    #[test]
    fn polygons_that_cross_themselves_are_told_in_bounded_time() {
        let (triangles, is_sound) = cut_flat(&[[0., 0.], [2., 2.], [2., 0.], [0., 1.]], false);
        assert_eq!((triangles.len(), is_sound), (2, false));
        let mut rng = Rng::new(2, Stream::Measure, 0);
        let tangle: Vec<[f64; 2]> = (0..20_000).map(|_| [rng.next_f64(), rng.next_f64()]).collect();
        let (triangles, is_sound) = cut_flat(&tangle, false);
        assert_eq!((triangles.len(), is_sound), (19_998, false));
        for odd in [f64::NAN, f64::INFINITY, 1e300] {
            let (triangles, _) = cut_flat(&[[0., 0.], [odd, 0.], [1., 1.], [0., 1.]], true);
            assert_eq!(triangles.len(), 2);
        }
    }

    #[test]
    fn fans_are_mended_where_they_stand() {
        let positions = Positions::Single(vec![[4., 0., 0.], [1., 1., 0.], [0., 4., 0.], [0., 0., 0.]]);
        let fan = [[3, 0, 1], [3, 1, 2]];
        let wrong = [[0, 1, 2], [0, 2, 3]];
        let mut triangles = [wrong, fan].concat();
        assert_eq!(mend_equal_fans(&mut triangles, 2, &positions), 0);
        assert_ne!(triangles[..2], wrong);
        assert_eq!(triangles[2..], fan);
        let mut triangles = [&wrong[..], &[[0, 1, 2]]].concat();
        assert_eq!(mend_fans(&mut triangles, &[Run { first: 0, count: 2 }], &positions), 0);
        assert_ne!(triangles[..2], wrong);
    }
}
