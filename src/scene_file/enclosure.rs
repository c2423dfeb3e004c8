//! Whether a model encloses a place: the test behind the guess that a model is a room.

use super::mesh::TriangleMesh;
use crate::math::Bounds3;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

/// Directions in each octant along either coordinate. The cells have equal solid angles.
const CELLS: usize = 4;

/// Directions in one octant.
const IN_OCTANT: usize = CELLS * CELLS;

/// Sectors of azimuth, each half a quadrant. A wall must be hit in each of them.
const SECTORS: usize = 8;

/// Nearest hits of rays from one place in all directions.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    eye: DVec3,
    /// By octant (bit 0, 1, 2 set: negative x, y, z), then by cell: the nearest hit.
    hits: [[Hit; IN_OCTANT]; 8],
    /// The nearest hit straight up.
    above: Hit,
}

/// The nearest surface along a ray.
#[derive(Clone, Copy, Debug)]
struct Hit {
    distance: f64,
    /// Whether the front of the surface faces the eye.
    is_front: bool,
}

impl Hit {
    const NONE: Self = Self { distance: f64::INFINITY, is_front: false };

    fn is_some(&self) -> bool {
        self.distance < f64::INFINITY
    }

    /// Keeps the nearer hit. At equal distances it keeps the front, whatever the order of the calls.
    fn take(&mut self, other: Self) {
        if other.distance < self.distance || other.distance == self.distance && other.is_front {
            *self = other;
        }
    }
}

/// The unit direction of a cell: row by height, column by azimuth.
fn direction(octant: usize, cell: usize) -> DVec3 {
    let (row, column) = (cell / CELLS, cell % CELLS);
    let y = (row as f64 + 0.5) / CELLS as f64;
    let (sin, cos) = ((column as f64 + 0.5) / CELLS as f64 * FRAC_PI_2).sin_cos();
    let across = (1.0 - y * y).sqrt();
    let sign = |bit: usize| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
    DVec3::new(sign(0) * across * cos, sign(1) * y, sign(2) * across * sin)
}

/// All directions, by octant.
static DIRECTIONS: LazyLock<[[DVec3; IN_OCTANT]; 8]> =
    LazyLock::new(|| std::array::from_fn(|octant| std::array::from_fn(|cell| direction(octant, cell))));

/// Solid angle of a triangle as seen from the origin, as a fraction of the sphere; positive where its back is seen (Van Oosterom
/// & Strackee 1983).
fn signed_solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    let angle = 2.0 * a.dot(b.cross(c)).atan2(denominator);
    if angle.is_finite() { angle / (4.0 * PI) } else { 0.0 }
}

/// The triangles of a model in world space.
pub(super) struct Triangles<'a>(Vec<(&'a TriangleMesh, DAffine3)>);

impl<'a> Triangles<'a> {
    /// The triangles of meshes under transforms.
    pub(super) fn new(placed: impl IntoIterator<Item = (&'a TriangleMesh, DAffine3)>) -> Self {
        Self(placed.into_iter().collect())
    }

    /// The same triangles under a further transform.
    pub(super) fn under(&self, after: &DAffine3) -> Self {
        Self(self.0.iter().map(|(mesh, transform)| (*mesh, *after * *transform)).collect())
    }

    /// Folds `add` over all triangles, whose corners are counter-clockwise as seen from the front. The result is the same for any
    /// number of threads.
    pub(super) fn sum<T: Send>(
        &self,
        zero: impl Fn() -> T + Sync,
        add: impl Fn(&mut T, [DVec3; 3]) + Sync,
        merge: impl Fn(&mut T, T),
    ) -> T {
        /// Triangles that one thread folds at a time.
        const AT_ONCE: usize = 1 << 14;
        let mut total = zero();
        for (mesh, transform) in &self.0 {
            let parts: Vec<T> = mesh
                .triangles
                .par_chunks(AT_ONCE)
                .map(|triangles| {
                    let mut part = zero();
                    for triangle in triangles {
                        let corners = mesh.positions.corners(*triangle);
                        add(&mut part, corners.map(|corner| transform.transform_point3(corner)));
                    }
                    part
                })
                .collect();
            parts.into_iter().for_each(|part| merge(&mut total, part));
        }
        total
    }

    /// Bounding box of all triangles.
    pub(super) fn bounds(&self) -> Bounds3 {
        self.sum(
            || Bounds3::EMPTY,
            |bounds, corners| *bounds = bounds.union(Bounds3::of_points(corners)),
            |bounds, other| *bounds = bounds.union(other),
        )
    }

    /// Whether the segment between two points is free of triangles.
    pub(super) fn leave_free(&self, from: DVec3, to: DVec3) -> bool {
        let length = (to - from).length();
        let way = (to - from) / length;
        let nearest = self.sum(
            || Hit::NONE,
            |nearest, triangle| nearest.take(Seen::new(triangle, from).meet(way)),
            |nearest, other| nearest.take(other),
        );
        nearest.distance >= length
    }

    /// Winding number of the surfaces around a point, seen from their fronts: about 1 in a body, -1 in a room whose walls have no
    /// thickness, 0 between walls that do.
    fn winding(&self, around: DVec3) -> f64 {
        self.sum(
            || 0.0,
            |winding, triangle| *winding += signed_solid_angle(triangle.map(|corner| corner - around)),
            |winding, other| *winding += other,
        )
    }
}

/// A triangle seen from the eye.
struct Seen {
    corners: [DVec3; 3],
    /// Cross products of pairs of corners.
    edges: [DVec3; 3],
    /// Six times the volume of the tetrahedron with the eye; positive where the eye sees the back.
    volume: f64,
}

impl Seen {
    fn new(triangle: [DVec3; 3], eye: DVec3) -> Self {
        let [a, b, c] = triangle.map(|corner| corner - eye);
        Self { corners: [a, b, c], edges: [a.cross(b), b.cross(c), c.cross(a)], volume: a.dot(b.cross(c)) }
    }

    /// Whether the triangle may be seen in an octant.
    fn reaches(&self, octant: usize) -> bool {
        let [a, b, c] = self.corners;
        let (most, least) = (a.max(b).max(c), a.min(b).min(c));
        (0..3).all(|axis| if octant >> axis & 1 == 0 { most[axis] > 0.0 } else { least[axis] < 0.0 })
    }

    /// Hit of a ray along the unit `direction`. A ray through an edge hits both triangles that share the edge.
    fn meet(&self, direction: DVec3) -> Hit {
        let [x, y, z] = self.edges.map(|edge| edge.dot(direction));
        let is_inside = x >= 0.0 && y >= 0.0 && z >= 0.0 || x <= 0.0 && y <= 0.0 && z <= 0.0;
        let distance = self.volume / (x + y + z);
        if is_inside && distance > 0.0 && distance.is_finite() {
            Hit { distance, is_front: self.volume < 0.0 }
        } else {
            Hit::NONE
        }
    }
}

impl Surroundings {
    /// Hits around `eye`.
    pub(super) fn of(eye: DVec3, triangles: &Triangles<'_>) -> Self {
        let nothing = || Self { eye, hits: [[Hit::NONE; IN_OCTANT]; 8], above: Hit::NONE };
        triangles.sum(nothing, Self::add, Self::merge)
    }

    fn add(&mut self, triangle: [DVec3; 3]) {
        let seen = Seen::new(triangle, self.eye);
        self.above.take(seen.meet(DVec3::Y));
        for octant in (0..8).filter(|octant| seen.reaches(*octant)) {
            for (hit, direction) in self.hits[octant].iter_mut().zip(&DIRECTIONS[octant]) {
                hit.take(seen.meet(*direction));
            }
        }
    }

    fn merge(&mut self, other: Self) {
        self.above.take(other.above);
        let others = other.hits.into_iter().flatten();
        self.hits.iter_mut().flatten().zip(others).for_each(|(hit, other)| hit.take(other));
    }

    /// The hits in the octants for which `octants` holds, in the rows and columns for which `cells` does.
    fn select(
        &self,
        octants: impl Fn(usize) -> bool,
        cells: impl Fn(usize, usize) -> bool,
    ) -> impl Iterator<Item = Hit> {
        let of_octant = |(octant, hits): (usize, &[Hit; IN_OCTANT])| {
            let chosen = octants(octant);
            hits.iter()
                .enumerate()
                .filter(|(cell, _)| chosen && cells(cell / CELLS, cell % CELLS))
                .map(|(_, hit)| *hit)
                .collect::<Vec<_>>()
        };
        self.hits.iter().enumerate().flat_map(of_octant).collect::<Vec<_>>().into_iter()
    }

    /// Whether in each sector of azimuth at least half of the upward rays in the lowest `rows` hit the model.
    fn is_walled_up_to(&self, rows: usize) -> bool {
        (0..SECTORS).all(|sector| {
            let (quadrant, half) = (sector / 2, sector % 2);
            // Bits 0 and 2 are the signs of x and z.
            let octant = (quadrant & 1) | (quadrant & 2) << 1;
            let in_half = |column: usize| column * 2 / CELLS == half;
            share(self.select(|other| other == octant, |row, column| row < rows && in_half(column))) >= 0.5
        })
    }

    /// Whether there is a wall on each side, apart from windows: in each sector half of the rays up to 30 degrees hit the model.
    pub(super) fn is_walled(&self) -> bool {
        self.is_walled_up_to(CELLS / 2)
    }

    /// Whether the place is enclosed: three quarters of the upward rays hit the model, half of the steepest quarter, and half of
    /// the rays in each sector of azimuth. Windows and skylights pass this test; an open side or top fails it.
    pub(super) fn is_enclosed(&self) -> bool {
        share(self.select(is_upper, |_, _| true)) >= 0.75
            && share(self.select(is_upper, |row, _| row + 1 == CELLS)) >= 0.5
            && self.is_walled_up_to(CELLS)
    }

    /// Whether the place has walls on all sides and is open above, as in a crater, a bowl or a room without a ceiling.
    pub(super) fn is_open_above(&self) -> bool {
        self.is_walled() && share(self.select(is_upper, |row, _| row + 1 == CELLS)) < 0.25
    }

    /// Whether the enclosing surfaces face the place, as the walls of a room do, and are not a shell around a hollow: three
    /// quarters of all hits are fronts, and the winding number is negative.
    pub(super) fn is_inside_out(&self, triangles: &Triangles<'_>) -> bool {
        let hits = || self.select(|_| true, |_, _| true).filter(Hit::is_some);
        let fronts = hits().filter(|hit| hit.is_front).count();
        4 * fronts >= 3 * hits().count() && triangles.winding(self.eye) < -0.5
    }

    /// Distance to the surface straight above, if there is one.
    pub(super) fn above(&self) -> Option<f64> {
        self.above.is_some().then_some(self.above.distance)
    }

    /// Median distance to the surrounding surfaces, if there are any.
    pub(super) fn distance(&self) -> Option<f64> {
        let mut distances: Vec<f64> =
            self.select(|_| true, |_, _| true).filter(Hit::is_some).map(|hit| hit.distance).collect();
        distances.sort_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied()
    }
}

/// Whether an octant lies above the horizon.
fn is_upper(octant: usize) -> bool {
    octant & 2 == 0
}

fn share(hits: impl Iterator<Item = Hit>) -> f64 {
    let (mut met, mut all) = (0, 0);
    for hit in hits {
        all += 1;
        met += u32::from(hit.is_some());
    }
    f64::from(met) / f64::from(all.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::mesh::Positions;

    /// A box from -1 to 1 with faces inwards, without the faces whose normal is in `without`.
    fn room(without: &[DVec3]) -> Vec<[DVec3; 3]> {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let mut triangles = Vec::new();
        for normal in axes.into_iter().flat_map(|axis| [axis, -axis]) {
            if without.contains(&normal) {
                continue;
            }
            let (u, v) = normal.any_orthonormal_pair();
            // Counter-clockwise as seen from within.
            let v = if u.cross(v).dot(normal) > 0.0 { v } else { -v };
            let corner = |a: f64, b: f64| -normal + u * a + v * b;
            triangles.push([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]);
            triangles.push([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        }
        triangles
    }

    fn mesh(triangles: &[[DVec3; 3]]) -> TriangleMesh {
        let positions = triangles.iter().flatten().map(DVec3::to_array).collect();
        TriangleMesh {
            positions: Positions::Double(positions),
            triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            normals: None,
            uvs: None,
        }
    }

    fn around(eye: DVec3, triangles: &[[DVec3; 3]]) -> Surroundings {
        Surroundings::of(eye, &Triangles::new([(&mesh(triangles), DAffine3::IDENTITY)]))
    }

    fn is_inside_out(eye: DVec3, triangles: &[[DVec3; 3]]) -> bool {
        around(eye, triangles).is_inside_out(&Triangles::new([(&mesh(triangles), DAffine3::IDENTITY)]))
    }

    #[test]
    fn a_box_encloses_what_is_in_it_and_nothing_else() {
        for scale in [1e-6, 1.0, 1e6] {
            let walls: Vec<_> =
                room(&[]).into_iter().map(|triangle| triangle.map(|corner| corner * scale)).collect();
            for eye in [DVec3::ZERO, DVec3::new(0.7, -0.5, 0.8), DVec3::new(-0.9, 0.9, 0.0)] {
                let seen = around(eye * scale, &walls);
                assert!(seen.is_enclosed() && !seen.is_open_above(), "{eye}");
                assert!(is_inside_out(eye * scale, &walls), "{eye}");
                let above = (1.0 - eye.y) * scale;
                assert!((seen.above().unwrap() - above).abs() < 1e-9 * scale, "{:?} {above}", seen.above());
            }
            assert!(!around(DVec3::X * 1.1 * scale, &walls).is_enclosed());
            // Turned inside out it is a body; its inside is enclosed all the same.
            let body: Vec<_> = walls.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
            let seen = around(DVec3::ZERO, &body);
            assert!(seen.is_enclosed() && !is_inside_out(DVec3::ZERO, &body));
            // Walls with an outer side form a shell around a hollow.
            let outside: Vec<_> = body.iter().map(|triangle| triangle.map(|corner| corner * 1.1)).collect();
            let thick = [walls.clone(), outside].concat();
            assert!(around(DVec3::ZERO, &thick).is_enclosed() && !is_inside_out(DVec3::ZERO, &thick));
        }
    }

    #[test]
    fn an_open_side_is_not_enclosed() {
        // Normals point inwards: that of the ceiling down, that of a wall away from it.
        let open_above = around(DVec3::ZERO, &room(&[DVec3::NEG_Y]));
        assert!(!open_above.is_enclosed() && open_above.is_open_above());
        for wall in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let seen = around(DVec3::ZERO, &room(&[wall]));
            assert!(!seen.is_walled() && !seen.is_open_above(), "{wall}");
        }
        // A tent without a floor.
        assert!(around(DVec3::ZERO, &room(&[DVec3::Y])).is_enclosed());
        let nothing = around(DVec3::ZERO, &[]);
        assert!(!nothing.is_enclosed() && nothing.above().is_none() && nothing.distance().is_none());
    }
}
