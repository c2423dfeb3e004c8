//! Tessellates shapes with texture coordinates, because only meshes support pictures.

use crate::scene_file::mesh::{Positions, TriangleMesh};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Segments around and along round shapes: a sphere is within 10^-4 of its radius.
const AROUND: u32 = 256;
const ALONG: u32 = 128;

/// Vertices of a sphere or a disc; it has at most twice as many triangles.
pub(crate) const MOST_VERTICES: u64 = (AROUND as u64 + 1) * (ALONG as u64 + 1);

impl TriangleMesh {
    /// The transformed mesh. A mirrored transform does not swap the sides.
    pub(crate) fn moved(mut self, by: &DAffine3) -> Self {
        let place = |p: DVec3| by.transform_point3(p).to_array();
        let positions = (0..self.positions.len()).map(|i| place(self.positions.get(i as u32))).collect();
        self.positions = Positions::Double(positions);
        if by.matrix3.determinant() < 0.0 {
            self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let turn = by.matrix3.inverse().transpose();
        let turned = |normal: &Vec3| {
            let normal = crate::math::unit_f64(turn * normal.as_dvec3());
            normal.map_or(Vec3::ZERO, |normal| normal.as_vec3())
        };
        self.normals = self.normals.map(|normals| normals.iter().map(turned).collect());
        self
    }
}

/// A grid over the unit square of coordinates; `at` yields position and normal.
pub(crate) fn grid(columns: u32, rows: u32, at: impl Fn(f64, f64) -> (DVec3, DVec3)) -> TriangleMesh {
    let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
            let (position, normal) = at(u, v);
            positions.push(position.to_array());
            normals.push(normal.as_vec3());
            uvs.push(Vec2::new(u as f32, v as f32));
        }
    }
    let corner = |p: u32| DVec3::from_array(positions[p as usize]);
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            for mut triangle in [[a, b, c], [a, c, d]] {
                let [p, q, r] = triangle.map(corner);
                let normal = (q - p).cross(r - p);
                if normal.length() < 1e-14 {
                    continue;
                }
                let mean: Vec3 = triangle.iter().map(|vertex| normals[*vertex as usize]).sum();
                if normal.dot(mean.as_dvec3()) < 0.0 {
                    triangle.swap(1, 2);
                }
                triangles.push(triangle);
            }
        }
    }
    TriangleMesh {
        positions: Positions::Double(positions),
        triangles,
        normals: Some(normals),
        uvs: Some(uvs),
    }
}

/// The unit sphere with z up; the first coordinate is the longitude from x.
pub(crate) fn sphere() -> TriangleMesh {
    grid(AROUND, ALONG, |u, v| {
        let ((sin_u, cos_u), (sin_v, cos_v)) = ((TAU * u).sin_cos(), (PI * v).sin_cos());
        let at = DVec3::new(sin_v * cos_u, sin_v * sin_u, cos_v);
        (at, at)
    })
}

/// The unit disc in z = 0; the first coordinate is the radius.
pub(crate) fn disk() -> TriangleMesh {
    grid(ALONG, AROUND, |u, v| {
        let (sin, cos) = (TAU * v).sin_cos();
        (DVec3::new(u * cos, u * sin, 0.0), DVec3::Z)
    })
}

/// The side of a cylinder of radius one from z = 0 to z = 1.
pub(crate) fn cylinder() -> TriangleMesh {
    grid(AROUND, 1, |u, v| {
        let (sin, cos) = (TAU * u).sin_cos();
        (DVec3::new(cos, sin, v), DVec3::new(cos, sin, 0.0))
    })
}

/// The square from -1 to 1 in x and y.
pub(crate) fn rectangle() -> TriangleMesh {
    grid(1, 1, |u, v| (DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0), DVec3::Z))
}

/// The cube from -1 to 1, with a picture on each side.
pub(crate) fn cube() -> TriangleMesh {
    let mut cube = TriangleMesh {
        positions: Positions::Double(Vec::new()),
        triangles: Vec::new(),
        normals: None,
        uvs: None,
    };
    let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for normal in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        let along = if normal.y.abs() > 0.5 { DVec3::X } else { DVec3::Y.cross(normal) };
        let up = normal.cross(along);
        let first = positions.len() as u32;
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            positions.push((normal + along * (2.0 * u - 1.0) + up * (2.0 * v - 1.0)).to_array());
            normals.push(normal.as_vec3());
            uvs.push(Vec2::new(u as f32, v as f32));
        }
        cube.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    cube.positions = Positions::Double(positions);
    TriangleMesh { normals: Some(normals), uvs: Some(uvs), ..cube }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All triangles face the way of their normals, and closed shapes have the right volume.
    #[test]
    fn shapes_face_outwards() {
        let volume = |mesh: &TriangleMesh| -> f64 {
            let of = |triangle: &[u32; 3]| {
                let [a, b, c] = mesh.positions.corners(*triangle);
                a.dot(b.cross(c)) / 6.0
            };
            mesh.triangles.iter().map(of).sum()
        };
        assert!((volume(&cube()) - 8.0).abs() < 1e-12);
        assert!((volume(&sphere()) / (4.0 / 3.0 * PI) - 1.0).abs() < 1e-3, "{}", volume(&sphere()));
        for mesh in [cube(), sphere(), disk(), cylinder(), rectangle()] {
            let normals = mesh.normals.as_ref().unwrap();
            for triangle in &mesh.triangles {
                let [a, b, c] = mesh.positions.corners(*triangle);
                assert!((b - a).cross(c - a).dot(normals[triangle[0] as usize].as_dvec3()) > 0.0);
            }
        }
        let mirrored = cube().moved(&DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0)));
        assert!((volume(&mirrored) - 16.0).abs() < 1e-12);
    }
}
