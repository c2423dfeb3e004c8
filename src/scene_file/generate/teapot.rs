//! The teapot that Martin Newell modelled in 1975: 32 bicubic Bezier patches. Ten are given; the others are their mirror images
//! and quarter turns. The data are in the public domain.

use crate::math::unit_f64;
use crate::scene_file::mesh::{Positions, TriangleMesh, is_degenerate};
use glam::{DVec3, Vec3};

/// The teapot as triangles: 3.15 high with its lid, the body 4 across, standing on the origin, with the spout along x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Teapot {
    /// Segments along each side of a patch, at least 1.
    pub divisions: u32,
}

/// Symmetry that repeats a patch.
#[derive(Clone, Copy)]
enum Symmetry {
    /// Four quarter turns about the vertical axis.
    Turned,
    /// The patch and its mirror image in the plane through spout and handle.
    Mirrored,
}

impl Teapot {
    /// Number of triangles, including those without area at the ends of patches, which are left out later.
    pub fn most_triangles(&self) -> u64 {
        32 * 2 * u64::from(self.divisions) * u64::from(self.divisions)
    }

    /// The triangles, with exact outward normals of the patches at their corners.
    pub fn mesh(&self) -> TriangleMesh {
        let mut mesh = Mesh { divisions: self.divisions, ..Mesh::default() };
        for (symmetry, patch) in PATCHES {
            let control = patch.map(|index| DVec3::from_array(POINTS[usize::from(index)]));
            match symmetry {
                Symmetry::Turned => {
                    for turn in 0..4 {
                        mesh.add(&control.map(|p| quarter_turns(p, turn)), false);
                    }
                }
                Symmetry::Mirrored => {
                    mesh.add(&control, false);
                    mesh.add(&control.map(|p| DVec3::new(p.x, -p.y, p.z)), true);
                }
            }
        }
        TriangleMesh {
            positions: Positions::Double(mesh.positions),
            triangles: mesh.triangles,
            normals: Some(mesh.normals),
            uvs: None,
        }
    }
}

/// `p` rotated about z, which points up in the data.
fn quarter_turns(p: DVec3, turns: u32) -> DVec3 {
    (0..turns).fold(p, |p, _| DVec3::new(-p.y, p.x, p.z))
}

#[derive(Default)]
struct Mesh {
    divisions: u32,
    positions: Vec<[f64; 3]>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Adds a patch; a mirrored patch needs the opposite winding.
    fn add(&mut self, control: &[DVec3; 16], mirrored: bool) {
        let first = self.positions.len() as u32;
        let side = self.divisions + 1;
        for row in 0..side {
            for column in 0..side {
                let at = |i: u32| f64::from(i) / f64::from(self.divisions);
                let (position, normal) = evaluate(control, at(column), at(row));
                let normal = if mirrored { -normal } else { normal };
                // z points up in the data.
                self.positions.push([position.x, position.z, -position.y]);
                self.normals.push(Vec3::new(normal.x as f32, normal.z as f32, -normal.y as f32));
            }
        }
        for row in 0..self.divisions {
            for column in 0..self.divisions {
                let corner = |r: u32, c: u32| first + r * side + c;
                let (a, b) = (corner(row, column), corner(row, column + 1));
                let (c, d) = (corner(row + 1, column + 1), corner(row + 1, column));
                for [p, q, r] in [[a, b, c], [a, c, d]] {
                    let triangle = if mirrored { [p, r, q] } else { [p, q, r] };
                    let corners = triangle.map(|vertex| DVec3::from_array(self.positions[vertex as usize]));
                    if !is_degenerate(corners) {
                        self.triangles.push(triangle);
                    }
                }
            }
        }
    }
}

/// Position and unit normal `du x dv` of a patch whose rows of four points run along `u`.
fn evaluate(control: &[DVec3; 16], u: f64, v: f64) -> (DVec3, DVec3) {
    let sum = |along: [f64; 4], across: [f64; 4]| -> DVec3 {
        (0..16).map(|i| control[i] * (along[i % 4] * across[i / 4])).sum()
    };
    let normal_at =
        |u: f64, v: f64| unit_f64(sum(derivative(u), bernstein(v)).cross(sum(bernstein(u), derivative(v))));
    // A side that is a single point has no derivative along it; the limit from inside the patch is used.
    let inside = |t: f64| t.clamp(1e-5, 1.0 - 1e-5);
    let normal = normal_at(u, v).or_else(|| normal_at(inside(u), inside(v))).unwrap_or(DVec3::Z);
    let row = |i: usize| casteljau([control[i], control[i + 1], control[i + 2], control[i + 3]], u);
    (casteljau([row(0), row(4), row(8), row(12)], v), normal)
}

/// A point of a cubic Bezier curve, exact where all four control points coincide.
fn casteljau(p: [DVec3; 4], t: f64) -> DVec3 {
    let between = |a: DVec3, b: DVec3| a + (b - a) * t;
    let (a, b, c) = (between(p[0], p[1]), between(p[1], p[2]), between(p[2], p[3]));
    between(between(a, b), between(b, c))
}

fn bernstein(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
}

fn derivative(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [-3.0 * s * s, 3.0 * s * s - 6.0 * s * t, 6.0 * s * t - 3.0 * t * t, 3.0 * t * t]
}

use Symmetry::{Mirrored, Turned};

/// Rim, body, lid, bottom, handle and spout: indices of control points, four rows of four.
const PATCHES: [(Symmetry, [u8; 16]); 10] = [
    (Turned, [102, 103, 104, 105, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]),
    (Turned, [12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27]),
    (Turned, [24, 25, 26, 27, 29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40]),
    (Turned, [96, 96, 96, 96, 97, 98, 99, 100, 101, 101, 101, 101, 0, 1, 2, 3]),
    (Turned, [0, 1, 2, 3, 106, 107, 108, 109, 110, 111, 112, 113, 114, 115, 116, 117]),
    (Turned, [118, 118, 118, 118, 124, 122, 119, 121, 123, 126, 125, 120, 40, 39, 38, 37]),
    (Mirrored, [41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51, 52, 53, 54, 55, 56]),
    (Mirrored, [53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63, 64, 28, 65, 66, 67]),
    (Mirrored, [68, 69, 70, 71, 72, 73, 74, 75, 76, 77, 78, 79, 80, 81, 82, 83]),
    (Mirrored, [80, 81, 82, 83, 84, 85, 86, 87, 88, 89, 90, 91, 92, 93, 94, 95]),
];

#[rustfmt::skip]
const POINTS: [[f64; 3]; 127] = [
    [0.2, 0.0, 2.7], [0.2, -0.112, 2.7], [0.112, -0.2, 2.7], [0.0, -0.2, 2.7],
    [1.3375, 0.0, 2.53125], [1.3375, -0.749, 2.53125], [0.749, -1.3375, 2.53125], [0.0, -1.3375, 2.53125],
    [1.4375, 0.0, 2.53125], [1.4375, -0.805, 2.53125], [0.805, -1.4375, 2.53125], [0.0, -1.4375, 2.53125],
    [1.5, 0.0, 2.4], [1.5, -0.84, 2.4], [0.84, -1.5, 2.4], [0.0, -1.5, 2.4],
    [1.75, 0.0, 1.875], [1.75, -0.98, 1.875], [0.98, -1.75, 1.875], [0.0, -1.75, 1.875],
    [2.0, 0.0, 1.35], [2.0, -1.12, 1.35], [1.12, -2.0, 1.35], [0.0, -2.0, 1.35],
    [2.0, 0.0, 0.9], [2.0, -1.12, 0.9], [1.12, -2.0, 0.9], [0.0, -2.0, 0.9],
    [-2.0, 0.0, 0.9],
    [2.0, 0.0, 0.45], [2.0, -1.12, 0.45], [1.12, -2.0, 0.45], [0.0, -2.0, 0.45],
    [1.5, 0.0, 0.225], [1.5, -0.84, 0.225], [0.84, -1.5, 0.225], [0.0, -1.5, 0.225],
    [1.5, 0.0, 0.15], [1.5, -0.84, 0.15], [0.84, -1.5, 0.15], [0.0, -1.5, 0.15],
    [-1.6, 0.0, 2.025], [-1.6, -0.3, 2.025], [-1.5, -0.3, 2.25], [-1.5, 0.0, 2.25],
    [-2.3, 0.0, 2.025], [-2.3, -0.3, 2.025], [-2.5, -0.3, 2.25], [-2.5, 0.0, 2.25],
    [-2.7, 0.0, 2.025], [-2.7, -0.3, 2.025], [-3.0, -0.3, 2.25], [-3.0, 0.0, 2.25],
    [-2.7, 0.0, 1.8], [-2.7, -0.3, 1.8], [-3.0, -0.3, 1.8], [-3.0, 0.0, 1.8],
    [-2.7, 0.0, 1.575], [-2.7, -0.3, 1.575], [-3.0, -0.3, 1.35], [-3.0, 0.0, 1.35],
    [-2.5, 0.0, 1.125], [-2.5, -0.3, 1.125], [-2.65, -0.3, 0.9375], [-2.65, 0.0, 0.9375],
    [-2.0, -0.3, 0.9], [-1.9, -0.3, 0.6], [-1.9, 0.0, 0.6],
    [1.7, 0.0, 1.425], [1.7, -0.66, 1.425], [1.7, -0.66, 0.6], [1.7, 0.0, 0.6],
    [2.6, 0.0, 1.425], [2.6, -0.66, 1.425], [3.1, -0.66, 0.825], [3.1, 0.0, 0.825],
    [2.3, 0.0, 2.1], [2.3, -0.25, 2.1], [2.4, -0.25, 2.025], [2.4, 0.0, 2.025],
    [2.7, 0.0, 2.4], [2.7, -0.25, 2.4], [3.3, -0.25, 2.4], [3.3, 0.0, 2.4],
    [2.8, 0.0, 2.475], [2.8, -0.25, 2.475], [3.525, -0.25, 2.49375], [3.525, 0.0, 2.49375],
    [2.9, 0.0, 2.475], [2.9, -0.15, 2.475], [3.45, -0.15, 2.5125], [3.45, 0.0, 2.5125],
    [2.8, 0.0, 2.4], [2.8, -0.15, 2.4], [3.2, -0.15, 2.4], [3.2, 0.0, 2.4],
    [0.0, 0.0, 3.15], [0.8, 0.0, 3.15], [0.8, -0.45, 3.15], [0.45, -0.8, 3.15],
    [0.0, -0.8, 3.15], [0.0, 0.0, 2.85],
    [1.4, 0.0, 2.4], [1.4, -0.784, 2.4], [0.784, -1.4, 2.4], [0.0, -1.4, 2.4],
    [0.4, 0.0, 2.55], [0.4, -0.224, 2.55], [0.224, -0.4, 2.55], [0.0, -0.4, 2.55],
    [1.3, 0.0, 2.55], [1.3, -0.728, 2.55], [0.728, -1.3, 2.55], [0.0, -1.3, 2.55],
    [1.3, 0.0, 2.4], [1.3, -0.728, 2.4], [0.728, -1.3, 2.4], [0.0, -1.3, 2.4],
    [0.0, 0.0, 0.0], [1.425, -0.798, 0.0], [1.5, 0.0, 0.075], [1.425, 0.0, 0.0],
    [0.798, -1.425, 0.0], [0.0, -1.5, 0.075], [0.0, -1.425, 0.0], [1.5, -0.84, 0.075],
    [0.84, -1.5, 0.075],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_teapot_has_its_size_and_faces_outward() {
        let mesh = Teapot { divisions: 8 }.mesh();
        let bounds = mesh.bounds();
        assert!((bounds.max.y - 3.15).abs() < 1e-9 && bounds.min.y.abs() < 1e-9, "{bounds:?}");
        assert!((bounds.min.z + 2.0).abs() < 0.02 && (bounds.max.z - 2.0).abs() < 0.02, "{bounds:?}");
        assert!(bounds.max.x > 3.4 && bounds.min.x < -2.9, "{bounds:?}");
        // The only missing triangles are those at the poles of lid and bottom.
        assert_eq!(mesh.triangles.len(), 32 * 2 * 64 - 2 * 4 * 8);
        let normals = mesh.normals.as_ref().unwrap();
        let mut agree = 0;
        for &triangle in &mesh.triangles {
            let [a, b, c] = mesh.positions.corners(triangle);
            let face = (b - a).cross(c - a);
            let shading: Vec3 = triangle.iter().map(|&vertex| normals[vertex as usize]).sum();
            agree += usize::from(face.dot(shading.as_dvec3()) > 0.0);
            let middle = (a + b + c) / 3.0;
            let across = DVec3::new(middle.x, 0.0, middle.z);
            // Points of the body between lid and bottom, away from handle and spout.
            if (0.5..2.2).contains(&middle.y) && across.x.abs() < 1.2 {
                assert!(face.dot(across) > 0.0, "inward at {middle}");
            }
        }
        assert_eq!(agree, mesh.triangles.len());
        assert!(normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-5));
    }
}
