//! Surfaces of revolution around the y axis.

use crate::math::unit_f64;
use crate::scene_file::mesh::{Positions, TriangleMesh};
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::TAU;

/// Interpolation between the points of a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// Straight lines; each makes a strip that is flat along the profile.
    Straight,
    /// Centripetal Catmull-Rom splines (Yuksel, Schaefer & Keyser 2011), which pass through all points without loops. A point
    /// given twice is a corner.
    Smooth {
        /// Pieces between two points.
        steps: u32,
    },
}

/// A surface of revolution: a profile rotated about the y axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Lathe {
    /// Points (distance from the axis, height), at least two, with distances that are not negative. The surface normal is on the
    /// right-hand side along the profile: outward where the profile rises.
    pub profile: Vec<DVec2>,
    /// Interpolation between the points.
    pub curve: Curve,
    /// Segments around the axis, at least 3.
    pub segments: u32,
    /// Whether its facets are flat, as cut in glass; otherwise it is shaded round.
    pub is_flat: bool,
}

/// A point of the profile and the unit normal there, both (distance from the axis, height).
#[derive(Clone, Copy, Debug)]
struct Station {
    point: DVec2,
    normal: DVec2,
}

impl Lathe {
    /// Number of triangles, including those without area at the axis, which are left out later.
    pub fn most_triangles(&self) -> u64 {
        let steps = match self.curve {
            Curve::Straight => 1,
            Curve::Smooth { steps } => u64::from(steps),
        };
        2 * u64::from(self.segments) * steps * self.profile.len().saturating_sub(1) as u64
    }

    /// The triangles, with exact normals of the profile curve at their corners unless they are flat. A strip that ends on the axis ends in
    /// a fan.
    pub fn mesh(&self) -> TriangleMesh {
        let mut mesh = Builder { segments: self.segments, ..Builder::default() };
        for run in self.runs() {
            mesh.add_strip(&run);
        }
        TriangleMesh {
            positions: Positions::Double(mesh.positions),
            triangles: mesh.triangles,
            normals: (!self.is_flat).then_some(mesh.normals),
            uvs: None,
        }
    }

    /// The sections of the profile within which the normal changes smoothly.
    fn runs(&self) -> Vec<Vec<Station>> {
        match self.curve {
            Curve::Straight => self
                .profile
                .windows(2)
                .filter_map(|ends| {
                    let normal = normal_of(ends[1] - ends[0])?;
                    Some(ends.iter().map(|&point| Station { point, normal }).collect())
                })
                .collect(),
            Curve::Smooth { steps } => {
                let mut runs = Vec::new();
                let mut points: Vec<DVec2> = Vec::new();
                for &point in &self.profile {
                    if points.last() == Some(&point) {
                        runs.push(spline(&points, steps));
                        points.clear();
                    }
                    points.push(point);
                }
                runs.push(spline(&points, steps));
                runs
            }
        }
    }
}

/// The unit normal on the right of a direction along the profile.
fn normal_of(along: DVec2) -> Option<DVec2> {
    let unit = unit_f64(along.extend(0.0))?;
    Some(DVec2::new(unit.y, -unit.x))
}

/// Stations of the spline through `points`.
fn spline(points: &[DVec2], steps: u32) -> Vec<Station> {
    let count = points.len();
    if count < 2 {
        return Vec::new();
    }
    // Control points beyond the ends. At an end on the axis the profile is mirrored, so that the surface is smooth there; at any
    // other end it is extrapolated.
    let beyond = |end: DVec2, next: DVec2| {
        if end.x == 0.0 { DVec2::new(-next.x, next.y) } else { 2.0 * end - next }
    };
    let at = |index: usize| match index {
        0 => beyond(points[0], points[1]),
        i if i <= count => points[i - 1],
        _ => beyond(points[count - 1], points[count - 2]),
    };
    let mut stations = Vec::with_capacity(steps as usize * (count - 1) + 1);
    for span in 0..count - 1 {
        let p = [at(span), at(span + 1), at(span + 2), at(span + 3)];
        let knot = |i: usize| (p[i + 1] - p[i]).length().sqrt().max(f64::MIN_POSITIVE);
        let (d0, d1, d2) = (knot(0), knot(1), knot(2));
        let from = d1 * ((p[1] - p[0]) / d0 - (p[2] - p[0]) / (d0 + d1) + (p[2] - p[1]) / d1);
        let to = d1 * ((p[2] - p[1]) / d1 - (p[3] - p[1]) / (d1 + d2) + (p[3] - p[2]) / d2);
        let last = if span + 2 == count { steps } else { steps - 1 };
        for step in 0..=last {
            let s = f64::from(step) / f64::from(steps);
            let hermite = |a: f64, b: f64, c: f64, d: f64| a * p[1] + b * from + c * p[2] + d * to;
            let (s2, s3) = (s * s, s * s * s);
            let mut point =
                hermite(2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2);
            let along =
                hermite(6.0 * s2 - 6.0 * s, 3.0 * s2 - 4.0 * s + 1.0, 6.0 * s - 6.0 * s2, 3.0 * s2 - 2.0 * s);
            // The given points are hit exactly, and no point crosses the axis.
            match step {
                0 => point = p[1],
                step if step == steps => point = p[2],
                _ => point.x = point.x.max(0.0),
            }
            let normal = normal_of(along).or_else(|| normal_of(p[2] - p[1])).unwrap_or(DVec2::X);
            stations.push(Station { point, normal });
        }
    }
    stations
}

#[derive(Default)]
struct Builder {
    segments: u32,
    positions: Vec<[f64; 3]>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    /// Rotates one section of the profile.
    fn add_strip(&mut self, stations: &[Station]) {
        let rings: Vec<(u32, bool)> = stations.iter().map(|station| self.add_ring(station)).collect();
        for pair in rings.windows(2) {
            let [(low, low_is_point), (high, high_is_point)] = [pair[0], pair[1]];
            for segment in 0..self.segments {
                let next = (segment + 1) % self.segments;
                let corner =
                    |(first, is_point): (u32, bool), at: u32| if is_point { first } else { first + at };
                let (a, b) = (corner((low, low_is_point), segment), corner((high, high_is_point), segment));
                let (c, d) = (corner((low, low_is_point), next), corner((high, high_is_point), next));
                if !high_is_point {
                    self.triangles.push([a, b, d]);
                }
                if !low_is_point {
                    self.triangles.push([a, d, c]);
                }
            }
        }
    }

    /// Adds the vertices of a station: a ring, or a single vertex on the axis. Returns the first vertex, and whether it is the
    /// only one.
    fn add_ring(&mut self, station: &Station) -> (u32, bool) {
        let first = self.positions.len() as u32;
        let Station { point, normal } = *station;
        if point.x == 0.0 {
            self.positions.push([0.0, point.y, 0.0]);
            self.normals.push(Vec3::new(0.0, 1.0f32.copysign(normal.y as f32), 0.0));
            return (first, true);
        }
        for segment in 0..self.segments {
            let (sin, cos) = (TAU * f64::from(segment) / f64::from(self.segments)).sin_cos();
            self.positions.push([point.x * cos, point.y, point.x * sin]);
            self.normals.push(DVec3::new(normal.x * cos, normal.y, normal.x * sin).as_vec3());
        }
        (first, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half_circle(count: u32) -> Vec<DVec2> {
        (0..=count)
            .map(|i| std::f64::consts::PI * (f64::from(i) / f64::from(count) - 0.5))
            .map(|angle| DVec2::new(if angle.abs() > 1.57 { 0.0 } else { angle.cos() }, angle.sin()))
            .collect()
    }

    #[test]
    fn a_turned_half_circle_is_a_sphere() {
        let lathe = Lathe {
            profile: half_circle(16),
            curve: Curve::Smooth { steps: 4 },
            segments: 64,
            is_flat: false,
        };
        let mesh = lathe.mesh();
        let normals = mesh.normals.as_ref().unwrap();
        for (vertex, normal) in normals.iter().enumerate() {
            let position = mesh.positions.get(vertex as u32);
            assert!((position.length() - 1.0).abs() < 2e-3, "{position}");
            assert!(normal.as_dvec3().dot(position) > 0.999, "{position} {normal}");
        }
        // Two fans of 64 triangles and 62 bands of 128; every edge is used once in each direction.
        assert_eq!(mesh.triangles.len(), 2 * 64 + 62 * 128);
        let mut edges: Vec<[u32; 2]> =
            mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
        edges.sort_unstable();
        assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(edges.iter().all(|edge| edges.binary_search(&[edge[1], edge[0]]).is_ok()));
        // The triangles face outward: the enclosed volume is positive and that of the ball.
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|&t| mesh.positions.corners(t))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!((volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.005, "{volume}");
    }

    #[test]
    fn straight_profiles_have_creases_and_splines_only_at_doubled_points() {
        let profile = vec![DVec2::new(1.0, 0.0), DVec2::new(1.0, 1.0), DVec2::new(0.0, 1.0)];
        let can = Lathe { profile: profile.clone(), curve: Curve::Straight, segments: 8, is_flat: false };
        assert_eq!(can.runs().len(), 2);
        assert_eq!(can.mesh().triangles.len(), 16 + 8);
        let cut = Lathe { is_flat: true, ..can.clone() }.mesh();
        assert!(cut.normals.is_none() && cut.triangles == can.mesh().triangles);
        let smooth =
            |profile| Lathe { profile, curve: Curve::Smooth { steps: 3 }, segments: 8, is_flat: false };
        assert_eq!(smooth(profile.clone()).runs().len(), 1);
        let mut cornered = profile;
        cornered.insert(1, cornered[1]);
        let runs = smooth(cornered).runs();
        assert_eq!(runs.len(), 2);
        // Straight between the corners, so the normal is that of the line.
        assert!(runs[0].iter().all(|station| (station.normal - DVec2::X).length() < 1e-12));
        assert!(runs[1].iter().all(|station| (station.normal - DVec2::Y).length() < 1e-12));
    }

    #[test]
    fn splines_pass_through_their_points_in_equal_pieces() {
        let profile: Vec<_> = [[0.0, 0.0], [2.0, 0.1], [0.3, 1.0], [0.2, 5.0], [3.0, 7.0], [2.5, 9.0]]
            .map(DVec2::from_array)
            .to_vec();
        let stations = spline(&profile, 7);
        assert_eq!(stations.len(), 7 * 5 + 1);
        for (index, point) in profile.iter().enumerate() {
            assert_eq!(stations[7 * index].point, *point);
        }
        assert!(stations.iter().all(|station| (station.normal.length() - 1.0).abs() < 1e-12));
        assert!(stations.iter().all(|station| station.point.x >= 0.0));
        // Horizontal where it crosses the axis.
        assert!((stations[0].normal - DVec2::NEG_Y).length() < 1e-9, "{:?}", stations[0]);
    }
}
