//! Triangle meshes as read from files, before any scale or translation.

use crate::math::{Bounds3, unit_f64};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Vertex positions in the precision of their file. Files of doubles hold georeferenced models whose coordinates do not fit `f32`
/// until they are recentred. Storing the positions of all files as doubles would take twice the memory.
#[derive(Clone, Debug, PartialEq)]
pub enum Positions {
    /// Every value of the file is exact in `f32`.
    Single(Vec<[f32; 3]>),
    /// The file holds doubles or integers of 32 bits.
    Double(Vec<[f64; 3]>),
}

impl Positions {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::Single(positions) => positions.len(),
            Self::Double(positions) => positions.len(),
        }
    }

    /// True for a mesh without vertices.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of a vertex.
    ///
    /// # Panics
    /// Where `vertex` is not below [`Self::len`].
    pub fn get(&self, vertex: u32) -> DVec3 {
        match self {
            Self::Single(positions) => Vec3::from_array(positions[vertex as usize]).as_dvec3(),
            Self::Double(positions) => DVec3::from_array(positions[vertex as usize]),
        }
    }

    /// Positions of a triangle's corners.
    ///
    /// # Panics
    /// As [`Self::get`].
    pub fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|vertex| self.get(vertex))
    }
}

/// A mesh in its file's own space and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    /// Positions. Positions that no triangle uses may have any value, even NaN.
    pub positions: Positions,
    /// Corners, each below the number of positions; counter-clockwise as seen from the side of the normal. Every
    /// triangle has an area and finite corners.
    pub triangles: Vec<[u32; 3]>,
    /// Unit shading normal of each vertex. Zero where the file's normal is unusable; the face normal is used there.
    pub normals: Option<Vec<Vec3>>,
    /// Texture coordinates of each vertex, finite.
    pub uvs: Option<Vec<Vec2>>,
}

/// Kind of a file that has vertices but no faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cloud {
    /// A point cloud, as from a scanner.
    Points,
    /// Gaussian splats.
    Splats,
    /// Lines or points of an OBJ, or vertices that nothing uses.
    Lines,
}

impl Cloud {
    /// What the file is, and what to do.
    pub fn explanation(self) -> &'static str {
        match self {
            Self::Points => {
                "is a point cloud: it has vertices and no faces, and points have no surface to render; make a mesh of them (as Poisson \
                 reconstruction does in MeshLab or CloudCompare)"
            }
            Self::Splats => {
                "holds Gaussian splats (properties such as `f_dc_0`, `scale_0`), which have no surface to render; show it in a viewer of \
                 splats, or extract a mesh from the same pictures"
            }
            Self::Lines => {
                "has vertices and no faces (`f`), at most points and lines, which have no surface to render; export the faces of the model"
            }
        }
    }
}

/// Problems that a reader found in a mesh, counted by kind. All zero for a sound file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshReport {
    /// Faces with fewer than three corners, dropped.
    pub short_faces: u64,
    /// Triangles with a corner that is NaN or infinite, dropped.
    pub non_finite_triangles: u64,
    /// Line of the first vertex that is NaN or infinite, in files that have lines.
    pub non_finite_line: Option<usize>,
    /// Triangles with a corner twice or without area, dropped.
    pub degenerate_triangles: u64,
    /// Normals that were zero, NaN or infinite, replaced by zero.
    pub unusable_normals: u64,
    /// Texture coordinates that were NaN or infinite, replaced by zero.
    pub unusable_uvs: u64,
    /// Lines, points, curves and surfaces of an OBJ file, left out.
    pub other_elements: u64,
    /// Vertices without a colour in a file where others have one; they become white.
    pub colourless_vertices: u64,
    /// Whether colours were numbers up to 255 or more where 1 was expected, and were scaled.
    pub scaled_colours: bool,
    /// Kind of the file, where it has vertices but no faces.
    pub cloud: Option<Cloud>,
    /// Polygons that cross themselves; they have no defined interior and become fans of triangles.
    pub crossed_polygons: u64,
    /// Bytes after the end of what the file declares, ignored.
    pub trailing_bytes: u64,
}

impl MeshReport {
    /// The problems in words, one item for each kind.
    pub fn findings(&self) -> Vec<String> {
        let line =
            self.non_finite_line.map(|line| format!(" (the first of these vertices is in line {line})"));
        let non_finite =
            format!("triangles with NaN or infinite corners dropped{}", line.unwrap_or_default());
        let counts = [
            (self.short_faces, "faces with fewer than three corners dropped"),
            (self.non_finite_triangles, &*non_finite),
            (self.degenerate_triangles, "triangles without area dropped"),
            (self.unusable_normals, "normals that are zero, NaN or infinite replaced by those of the faces"),
            (self.unusable_uvs, "texture coordinates that are NaN or infinite replaced by zero"),
            (self.colourless_vertices, "vertices without a colour are white"),
            (self.other_elements, "lines, points, curves or surfaces left out"),
            (
                self.crossed_polygons,
                "polygons that cross themselves were filled by fans of triangles, and may overlap; triangulate them where they are made",
            ),
            (self.trailing_bytes, "bytes after the end of the mesh ignored"),
        ];
        let mut findings: Vec<_> = counts
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        findings.extend(self.cloud.map(|cloud| format!("the file {}", cloud.explanation())));
        if self.scaled_colours {
            findings.push("colours are above 1, and were taken to go up to 255 (or 65535)".to_owned());
        }
        findings
    }
}

/// True for a triangle whose corners are collinear or coincident as far as `f64` can tell: its area is within the rounding error
/// of its own computation. Thin triangles that do have an area pass.
pub fn is_degenerate([a, b, c]: [DVec3; 3]) -> bool {
    /// Bound on the relative rounding error of a cross product, with a margin.
    const ROUNDING: f64 = 4.0 * f64::EPSILON;
    /// Squared sine far above that bound. Most triangles exceed it and need no square root.
    const CLEAR: f64 = 1e-12;
    if !(a.is_finite() && b.is_finite() && c.is_finite()) {
        return true;
    }
    let (u, v) = (b - a, c - a);
    let (product, cross) = (u.length_squared() * v.length_squared(), u.cross(v).length_squared());
    if product.is_normal() && cross.is_normal() && cross > CLEAR * product {
        return false;
    }
    // Each edge is normalized by itself: edges of 1e-200 do not underflow, and a thin triangle is judged by its angle.
    let (Some(u), Some(v)) = (unit_f64(u), unit_f64(v)) else { return true };
    u.cross(v).length() <= ROUNDING
}

/// Fewest triangles for one thread.
const AT_ONCE: usize = 1 << 14;

/// Drops unusable triangles and counts them.
pub(super) fn drop_unusable(triangles: &mut Vec<[u32; 3]>, positions: &Positions, report: &mut MeshReport) {
    let is_finite =
        |triangle: &[u32; 3]| positions.corners(*triangle).iter().all(|corner| corner.is_finite());
    let is_flat = |triangle: &[u32; 3]| is_degenerate(positions.corners(*triangle));
    // Almost every mesh is sound, so a parallel check comes first. Triangles that are not finite count as degenerate.
    let is_sound = match positions {
        Positions::Single(p) => triangles.par_iter().with_min_len(AT_ONCE).all(|triangle| {
            !is_degenerate(triangle.map(|vertex| Vec3::from_array(p[vertex as usize]).as_dvec3()))
        }),
        Positions::Double(_) => triangles.par_iter().with_min_len(AT_ONCE).all(|triangle| !is_flat(triangle)),
    };
    if is_sound {
        return;
    }
    triangles.retain(|triangle| {
        if !is_finite(triangle) {
            report.non_finite_triangles += 1;
            return false;
        }
        let is_flat = is_flat(triangle);
        report.degenerate_triangles += u64::from(is_flat);
        !is_flat
    });
}

impl TriangleMesh {
    /// Bounds of the vertices that triangles use; empty for a mesh without triangles.
    pub fn bounds(&self) -> Bounds3 {
        let triangles = || self.triangles.par_iter().with_min_len(AT_ONCE);
        match &self.positions {
            Positions::Single(positions) => {
                // Exact in single precision.
                let empty = || (Vec3::INFINITY, Vec3::NEG_INFINITY);
                let grown = |(low, high): (Vec3, Vec3), triangle: &[u32; 3]| {
                    let [a, b, c] = triangle.map(|vertex| Vec3::from_array(positions[vertex as usize]));
                    (low.min(a).min(b.min(c)), high.max(a).max(b.max(c)))
                };
                let (low, high) =
                    triangles().fold(empty, grown).reduce(empty, |a, b| (a.0.min(b.0), a.1.max(b.1)));
                Bounds3 { min: low.as_dvec3(), max: high.as_dvec3() }
            }
            Positions::Double(_) => {
                let of_triangle = |triangle: &[u32; 3]| Bounds3::of_points(self.positions.corners(*triangle));
                triangles().map(of_triangle).reduce(|| Bounds3::EMPTY, Bounds3::union)
            }
        }
    }

    /// Swaps the winding of triangles whose normals face the other way; computes smooth normals where the mesh has none.
    pub fn follow_normals(&mut self) {
        let Some(normals) = &self.normals else {
            self.normals = Some(self.smooth_normals());
            return;
        };
        let positions = &self.positions;
        self.triangles.par_iter_mut().with_min_len(AT_ONCE).for_each(|triangle| {
            let [a, b, c] = positions.corners(*triangle);
            let mean: Vec3 = triangle.iter().map(|vertex| normals[*vertex as usize]).sum();
            if (b - a).cross(c - a).dot(mean.as_dvec3()) < 0.0 {
                triangle.swap(1, 2);
            }
        });
    }

    /// Smooth shading normals of unit length: for each vertex the mean of the faces around it, weighted by their angles there
    /// (Thürmer & Wüthrich 1998). Zero where a vertex has no face or its faces cancel.
    ///
    /// Vertices at the same position but with different numbers are not merged: a file that splits them means a crease. The
    /// result does not depend on the number of threads.
    pub fn smooth_normals(&self) -> Vec<Vec3> {
        /// Triangles whose contributions are in memory at one time.
        const BATCH: usize = 1 << 16;
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        let mut contributions = Vec::new();
        for batch in self.triangles.chunks(BATCH) {
            batch
                .par_iter()
                .map(|triangle| self.weighted_normals(*triangle))
                .collect_into_vec(&mut contributions);
            // Added in the order of the file, so that the sums are bit-identical for any number of threads.
            for (triangle, normals) in batch.iter().zip(&contributions) {
                for (vertex, normal) in triangle.iter().zip(normals) {
                    sums[*vertex as usize] += *normal;
                }
            }
        }
        sums.into_par_iter().map(|sum| unit_f64(sum).unwrap_or(DVec3::ZERO).as_vec3()).collect()
    }

    /// The unit normal of a triangle times the angle at each of its corners.
    fn weighted_normals(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        let [a, b, c] = self.positions.corners(triangle);
        let edge = |from: DVec3, to: DVec3| unit_f64(to - from).unwrap_or(DVec3::ZERO);
        let edges = [edge(a, b), edge(b, c), edge(c, a)];
        let normal = unit_f64(edges[0].cross(-edges[2])).unwrap_or(DVec3::ZERO);
        [0, 1, 2].map(|corner| {
            let (u, v) = (edges[corner], -edges[(corner + 2) % 3]);
            // Well conditioned for every angle, unlike the arc cosine.
            normal * u.cross(v).length().atan2(u.dot(v))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::polygon::triangulate_polygon;

    /// A unit cube of two triangles a face, which share its eight vertices.
    fn cube(scale: f64) -> TriangleMesh {
        let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| (f64::from(bit) - 0.5) * scale);
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5u32]];
        let mut triangles = Vec::new();
        let positions = Positions::Double((0..8).map(corner).collect());
        for quad in &quads {
            triangulate_polygon(quad, |vertex| positions.get(vertex), &mut triangles);
        }
        TriangleMesh { positions, triangles, normals: None, uvs: None }
    }

    /// A square whose second half has the opposite winding, with normals that define the front.
    #[test]
    fn triangles_follow_their_normals() {
        let square = |normals: Option<Vec<Vec3>>| TriangleMesh {
            positions: Positions::Double(vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [1.0, 1.0, 0.0],
                [0.0, 1.0, 0.0],
            ]),
            triangles: vec![[0, 1, 2], [0, 3, 2]],
            normals,
            uvs: None,
        };
        for (normal, expected) in [(Vec3::Z, [[0, 1, 2], [0, 2, 3]]), (Vec3::NEG_Z, [[0, 2, 1], [0, 3, 2]])] {
            let mut mesh = square(Some(vec![normal; 4]));
            mesh.follow_normals();
            assert_eq!(mesh.triangles, expected);
        }
        let mut mesh = square(None);
        mesh.follow_normals();
        assert!(mesh.normals.is_some() && mesh.triangles == [[0, 1, 2], [0, 3, 2]]);
    }

    #[test]
    fn smooth_normals_of_a_cube_point_along_its_diagonals() {
        // A weight by area or by count would show the diagonals of the faces: 5 faces of 1, 4 or 2 triangles.
        for scale in [1e-150, 1e-6, 1.0, 1e6, 1e150] {
            let mesh = cube(scale);
            for (vertex, normal) in mesh.smooth_normals().iter().enumerate() {
                let outward = unit_f64(mesh.positions.get(vertex as u32)).unwrap().as_vec3();
                assert!(
                    (*normal - outward).length() < 1e-6,
                    "{scale}: vertex {vertex}: {normal} for {outward}"
                );
            }
        }
    }

    #[test]
    fn degenerate_means_no_area_not_little_area() {
        let triangle = |x: f64, y: f64| [DVec3::ZERO, DVec3::X, DVec3::new(x, y, 0.0)];
        assert!(is_degenerate(triangle(0.5, 0.0)));
        assert!(is_degenerate(triangle(1.0, 0.0)));
        assert!(is_degenerate([DVec3::splat(0.1), DVec3::splat(0.2), DVec3::splat(0.7)]));
        assert!(!is_degenerate(triangle(0.5, 1e-12)));
        assert!(!is_degenerate(triangle(1e-300, 1e-300)));
        assert!(!is_degenerate(triangle(0.5, 1.0).map(|corner| corner * 1e-200)));
        assert!(!is_degenerate(triangle(0.5, 1.0).map(|corner| corner * 1e200)));
        assert!(is_degenerate(triangle(f64::NAN, 1.0)));
        assert!(is_degenerate(triangle(f64::INFINITY, 1.0)));
    }

    #[test]
    fn a_needle_with_two_long_edges_has_an_area() {
        let needle = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1e-14, 0.0)];
        assert!(!is_degenerate(needle));
        // Seen from another corner it is the same triangle.
        assert!(!is_degenerate([needle[1], needle[2], needle[0]]));
    }

    #[test]
    fn bounds_are_those_of_used_vertices() {
        let mut mesh = cube(2.0);
        let Positions::Double(positions) = &mut mesh.positions else { unreachable!() };
        positions.push([f64::NAN, 1e9, 0.0]);
        assert_eq!(mesh.bounds(), Bounds3 { min: -DVec3::ONE, max: DVec3::ONE });
    }

    #[test]
    fn findings_name_what_was_found() {
        let report = MeshReport { degenerate_triangles: 3, trailing_bytes: 7, ..MeshReport::default() };
        assert_eq!(
            report.findings(),
            ["3 triangles without area dropped", "7 bytes after the end of the mesh ignored"]
        );
        assert!(MeshReport::default().findings().is_empty());
    }
}
