//! Meshes that are displaced by a texture: tessellated to a stated length of edges, and moved along their normals.

use super::BuildProblem;
use crate::scene_file::mesh::{Positions, TriangleMesh, is_degenerate};
use crate::textures::SolidTexture;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Largest number of triangles of a displaced mesh.
pub(super) const MOST_TRIANGLES: u64 = 10_000_000;

/// How a mesh is displaced.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displaced<'a> {
    /// The pattern, in the world.
    pub texture: &'a SolidTexture,
    /// Displacement where the pattern is one, metres; where it is zero, the surface stays.
    pub height: f64,
    /// Largest length of edges before the displacement, metres.
    pub edge: f64,
    /// Transform of the mesh to the world, metres.
    pub to_world: DAffine3,
    /// Whether shading normals are those of the displaced faces, and not interpolated.
    pub flat: bool,
}

/// A vertex of the tessellation: a corner, a point of an edge (its corners in ascending order, and its place among the parts of the
/// edge), or a point within a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Place {
    Corner(u32),
    Edge(u32, u32, u32),
    Within(u32, u32, u32),
}

impl Displaced<'_> {
    /// The displaced mesh, in its own space.
    ///
    /// An edge is divided by its own length alone, so that the triangles on both sides of it meet at the same points. Corners at one
    /// position are one. A closed mesh therefore stays closed, across sharp edges too: there the surface moves along the mean of the
    /// normals, weighted by angle.
    pub(super) fn displace(&self, mesh: &TriangleMesh) -> Result<TriangleMesh, BuildProblem> {
        let (corners, triangles) = self.welded(mesh);
        let parts = |a: u32, b: u32| {
            let length = corners[a as usize].distance(corners[b as usize]);
            (length / self.edge).ceil().max(1.0)
        };
        let divisions = |&[a, b, c]: &[u32; 3]| [parts(a, b), parts(b, c), parts(c, a)];
        let wanted: f64 = triangles
            .iter()
            .map(|triangle| divisions(triangle).into_iter().fold(1.0, f64::max).powi(2))
            .sum();
        if !(wanted <= MOST_TRIANGLES as f64) {
            return Err(BuildProblem::Displacement(wanted));
        }
        let mut places: HashMap<Place, u32> = HashMap::new();
        let mut points: Vec<DVec3> = Vec::new();
        let mut fine: Vec<[u32; 3]> = Vec::with_capacity(wanted as usize);
        for (number, triangle) in (0..).zip(&triangles) {
            let counts = divisions(triangle).map(|count| count as u32);
            let count = counts.into_iter().max().unwrap_or(1);
            let mut vertex = |i: u32, j: u32| {
                let (place, point) = place_of((number, triangle), (counts, count), (i, j), &corners);
                *places.entry(place).or_insert_with(|| {
                    points.push(point);
                    points.len() as u32 - 1
                })
            };
            // Rows of triangles from the first corner: (i, j) lies i rows from it and j along the row.
            for i in 0..count {
                for j in 0..=i {
                    let [above, left, right] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1)];
                    fine.push([above, left, right]);
                    if j < i {
                        fine.push([above, right, vertex(i, j + 1)]);
                    }
                }
            }
        }
        // Where an edge has fewer parts than its triangle, neighbouring points of the edge are one.
        let mut moved = TriangleMesh {
            positions: Positions::Double(points.iter().map(DVec3::to_array).collect()),
            triangles: fine,
            normals: None,
            uvs: None,
        };
        moved.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        let normals = moved.smooth_normals();
        let back = self.to_world.inverse();
        let positions = points
            .par_iter()
            .zip(&normals)
            .map(|(&point, normal)| {
                let height = self.height * self.texture.value(point, 0.0);
                back.transform_point3(point + normal.as_dvec3() * height).to_array()
            })
            .collect();
        moved.positions = Positions::Double(positions);
        if self.is_mirrored() {
            // Back to the winding of the mesh's own space.
            moved.triangles.par_iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let TriangleMesh { positions, triangles, .. } = &mut moved;
        triangles.retain(|&triangle| !is_degenerate(positions.corners(triangle)));
        moved.normals = (!self.flat).then(|| moved.smooth_normals());
        Ok(moved)
    }

    fn is_mirrored(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// Corners of a mesh in the world, each position once, and triangles of them; mirrored meshes are turned, so that normals point as
    /// those of the mesh do.
    fn welded(&self, mesh: &TriangleMesh) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut corners = Vec::new();
        let mut number = |vertex: u32| {
            let own = mesh.positions.get(vertex);
            let key = own.to_array().map(|x| (x + 0.0).to_bits());
            *known.entry(key).or_insert_with(|| {
                corners.push(self.to_world.transform_point3(own));
                corners.len() as u32 - 1
            })
        };
        let is_mirrored = self.is_mirrored();
        let triangles = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(&mut number);
                if is_mirrored { [a, c, b] } else { [a, b, c] }
            })
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        (corners, triangles)
    }
}

/// The vertex in row `i` from the first corner of a triangle, `j` along the row, of `count` rows; `counts` are the parts of its edges.
fn place_of(
    (number, &[a, b, c]): (u32, &[u32; 3]),
    ([ab, bc, ca], count): ([u32; 3], u32),
    (i, j): (u32, u32),
    corners: &[DVec3],
) -> (Place, DVec3) {
    let at = |corner: u32| corners[corner as usize];
    let on_edge = |from: u32, to: u32, step: u32, parts: u32| {
        // The point of the edge nearest to the one of the finer triangle.
        let part = (u64::from(step) * u64::from(parts) * 2 + u64::from(count)) / (2 * u64::from(count));
        let part = part as u32;
        if part == 0 {
            return (Place::Corner(from), at(from));
        }
        if part == parts {
            return (Place::Corner(to), at(to));
        }
        // Counted from the lower corner, so that both triangles compute the same point.
        let (low, high, part) = if from < to { (from, to, part) } else { (to, from, parts - part) };
        let share = f64::from(part) / f64::from(parts);
        (Place::Edge(low, high, part), at(low).lerp(at(high), share))
    };
    match (i, j) {
        (0, _) => (Place::Corner(a), at(a)),
        (_, 0) => on_edge(a, b, i, ab),
        _ if j == i => on_edge(c, a, count - i, ca),
        _ if i == count => on_edge(b, c, j, bc),
        _ => {
            let (down, along) = (f64::from(i) / f64::from(count), f64::from(j) / f64::from(count));
            (Place::Within(number, i, j), at(a) + (at(b) - at(a)) * (down - along) + (at(c) - at(a)) * along)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::textures::{Octaves, Pattern};
    use std::collections::BTreeMap;

    fn texture() -> SolidTexture {
        SolidTexture {
            pattern: Pattern::Noise(Octaves { size: 0.3, finest: 0.1, seed: 3 }),
            low: Rgb::ZERO,
            high: Rgb::ONE,
            to_texture: DAffine3::IDENTITY,
        }
    }

    /// A box whose faces share no vertex.
    fn a_box(size: DVec3) -> TriangleMesh {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
                let base = positions.len() as u32;
                for (s, t) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                    let mut corner = [0.0; 3];
                    (corner[axis], corner[u], corner[v]) = (side, s, t);
                    positions.push((DVec3::from_array(corner) * size).to_array());
                }
                let face = if side > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
                triangles.extend(face.map(|triangle: [u32; 3]| triangle.map(|i| i + base)));
            }
        }
        TriangleMesh { positions: Positions::Double(positions), triangles, normals: None, uvs: None }
    }

    #[test]
    fn closed_meshes_stay_closed_and_edges_are_short() {
        let texture = texture();
        for (size, edge) in [(DVec3::ONE, 0.1), (DVec3::new(1.0, 0.3, 0.05), 0.07), (DVec3::splat(0.01), 1.0)]
        {
            for to_world in [
                DAffine3::IDENTITY,
                DAffine3::from_scale(DVec3::new(-1.0, 2.0, 1.0)) * DAffine3::from_rotation_x(0.3),
            ] {
                let how = Displaced { texture: &texture, height: 0.02, edge, to_world, flat: false };
                let mesh = how.displace(&a_box(size)).unwrap();
                let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
                let mut volume = 0.0;
                for triangle in &mesh.triangles {
                    let [a, b, c] = mesh.positions.corners(*triangle);
                    volume += a.dot(b.cross(c)) / 6.0;
                    for k in 0..3 {
                        let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
                        *edges.entry((from.min(to), from.max(to))).or_default() +=
                            if from < to { 1 } else { -1 };
                        let [p, q] = [from, to].map(|i| to_world.transform_point3(mesh.positions.get(i)));
                        assert!(p.distance(q) < 1.5 * edge + 0.04, "{}", p.distance(q));
                    }
                }
                assert!(edges.values().all(|&sum| sum == 0), "open at {size}, {edge}");
                // Outwards in the mesh's own space, whether the transform mirrors or not.
                let own = size.element_product();
                assert!(volume > own, "{size}, {edge}: {volume} of {own}");
            }
        }
    }

    #[test]
    fn the_surface_moves_by_the_pattern_along_its_normal() {
        let texture = texture();
        let plane = TriangleMesh {
            positions: Positions::Double(vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 0.0, -1.0]]),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            normals: None,
            uvs: None,
        };
        let to_world = DAffine3::from_translation(DVec3::new(3.0, 2.0, 1.0));
        let how = Displaced { texture: &texture, height: 0.1, edge: 0.02, to_world, flat: true };
        let mesh = how.displace(&plane).unwrap();
        assert!(mesh.normals.is_none() && mesh.triangles.len() > 5000, "{}", mesh.triangles.len());
        for vertex in 0..mesh.positions.len() as u32 {
            let p = mesh.positions.get(vertex);
            let want = 0.1 * texture.value(to_world.transform_point3(p.with_y(0.0)), 0.0);
            assert!((p.y - want).abs() < 1e-9, "{p}: {want}");
        }
    }

    #[test]
    fn too_many_triangles_are_refused() {
        let texture = texture();
        let how = |edge| Displaced {
            texture: &texture,
            height: 0.1,
            edge,
            to_world: DAffine3::IDENTITY,
            flat: false,
        };
        for edge in [1e-5, 1e-300] {
            assert!(matches!(
                how(edge).displace(&a_box(DVec3::ONE)),
                Err(BuildProblem::Displacement(wanted)) if wanted > MOST_TRIANGLES as f64
            ));
        }
    }
}
