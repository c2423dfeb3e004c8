//! Decides whether a mesh that transmits light and declares no volume is a closed body of glass or an open sheet.

use crate::scene_file::mesh::{Positions, TriangleMesh};

/// A mesh as the boundary of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Closure {
    /// It has a boundary edge, an inconsistent orientation, or no volume.
    Open,
    /// Closed, with its fronts facing outwards.
    Closed,
    /// Closed, with its fronts facing inwards.
    InsideOut,
}

/// For each vertex of each mesh the number of its position. Exporters split vertices where normals or texture coordinates differ
/// on both sides of an edge; vertices at the same position are merged here.
fn weld(meshes: &[&TriangleMesh]) -> Vec<Vec<u32>> {
    let mut places = Vec::new();
    for (number, mesh) in meshes.iter().enumerate() {
        for vertex in 0..mesh.positions.len() as u32 {
            // Negative zero is the same position as zero.
            let key = match &mesh.positions {
                Positions::Single(positions) => {
                    positions[vertex as usize].map(|x| (f64::from(x) + 0.0).to_bits())
                }
                Positions::Double(positions) => positions[vertex as usize].map(|x| (x + 0.0).to_bits()),
            };
            places.push((key, number, vertex));
        }
    }
    places.sort_unstable();
    let mut welded: Vec<Vec<u32>> = meshes.iter().map(|mesh| vec![0; mesh.positions.len()]).collect();
    let (mut place, mut before) = (0, None);
    for (key, number, vertex) in places {
        place += u32::from(before.is_some_and(|before| before != key));
        before = Some(key);
        welded[number][vertex as usize] = place;
    }
    welded
}

/// Classifies several meshes as one surface. Each edge must be used equally often in both directions, and the enclosed volume
/// must exceed rounding errors.
pub(super) fn closure_of(meshes: &[&TriangleMesh]) -> Closure {
    let welded = weld(meshes);
    let mut edges = Vec::new();
    let (mut volume, mut magnitude, mut count) = (0.0, 0.0, 0u32);
    let origin = meshes.iter().find_map(|mesh| Some(mesh.positions.get((*mesh.triangles.first()?)[0])));
    for (mesh, places) in meshes.iter().zip(&welded) {
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| places[vertex as usize]);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.push((from.min(to), from.max(to), from < to));
            }
            let [a, b, c] =
                mesh.positions.corners(*triangle).map(|corner| corner - origin.unwrap_or_default());
            volume += a.dot(b.cross(c));
            magnitude += a.length() * b.length() * c.length();
            count += 1;
        }
    }
    edges.sort_unstable();
    let is_balanced = edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).all(|same| {
        let forwards = same.iter().filter(|(_, _, is_forward)| *is_forward).count();
        2 * forwards == same.len() || same[0].0 == same[0].1
    });
    let rounding = magnitude * f64::from(count) * 4.0 * f64::EPSILON;
    match is_balanced {
        true if volume > rounding => Closure::Closed,
        true if volume < -rounding => Closure::InsideOut,
        _ => Closure::Open,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box whose faces do not share vertices, as with flat normals.
    fn split_box() -> TriangleMesh {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let first = positions.len() as u32;
                for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                    let mut corner = [0f32; 3];
                    corner[axis] = side;
                    corner[(axis + 1) % 3] = u;
                    corner[(axis + 2) % 3] = if v == 0.0 && side > 0.0 { -0.0 } else { v };
                    positions.push(corner);
                }
                let order = if side > 0.0 { [0, 1, 2, 3] } else { [0, 3, 2, 1] };
                let [a, b, c, d] = order.map(|i| first + i);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        TriangleMesh { positions: Positions::Single(positions), triangles, normals: None, uvs: None }
    }

    #[test]
    fn a_box_with_split_vertices_is_closed() {
        let closed = split_box();
        assert_eq!(closure_of(&[&closed]), Closure::Closed);
        let mut inverted = closed.clone();
        inverted.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        assert_eq!(closure_of(&[&inverted]), Closure::InsideOut);
        // Split into two parts, each of which is open.
        let (mut first, mut second) = (closed.clone(), closed.clone());
        second.triangles = first.triangles.split_off(5);
        assert_eq!(closure_of(&[&first]), Closure::Open);
        assert_eq!(closure_of(&[&first, &second]), Closure::Closed);
        // Two separate bodies, and one with a hollow.
        let moved = |by: f32, scale: f32| {
            let Positions::Single(positions) = &closed.positions else { panic!() };
            let moved = positions.iter().map(|p| p.map(|x| x * scale + by)).collect();
            TriangleMesh { positions: Positions::Single(moved), ..closed.clone() }
        };
        assert_eq!(closure_of(&[&closed, &moved(5.0, 1.0)]), Closure::Closed);
        let mut hollow = moved(0.25, 0.5);
        hollow.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        assert_eq!(closure_of(&[&closed, &hollow]), Closure::Closed);
        for scale in [1e-12, 1e12] {
            assert_eq!(closure_of(&[&moved(scale, scale)]), Closure::Closed);
        }
    }

    #[test]
    fn what_has_a_hole_or_no_inside_is_open() {
        let mut hole = split_box();
        hole.triangles.pop();
        assert_eq!(closure_of(&[&hole]), Closure::Open);
        let mut twisted = split_box();
        twisted.triangles[3].swap(0, 1);
        assert_eq!(closure_of(&[&twisted]), Closure::Open);
        // A sheet with two sides.
        let mut sheet = split_box();
        sheet.triangles.truncate(2);
        let back: Vec<_> = sheet.triangles.iter().map(|[a, b, c]| [*b, *a, *c]).collect();
        sheet.triangles.extend(back);
        assert_eq!(closure_of(&[&sheet]), Closure::Open);
        assert_eq!(closure_of(&[]), Closure::Open);
    }
}
