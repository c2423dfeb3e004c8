//! Converts height fields over a grid to triangle meshes.

use crate::scene_file::mesh::{Positions, TriangleMesh};
use crate::shapes::HeightGrid;
use glam::{DAffine3, DVec3};

/// A mesh with two triangles for each cell of `grid`, in the space that `transform` maps the grid to. Its normals are smooth and
/// face up in the grid.
pub fn mesh_of_heights(grid: &HeightGrid, transform: &DAffine3) -> TriangleMesh {
    let (cells, side) = (grid.cells(), grid.cells() + 1);
    let position = |corner: u32| {
        let (x, z) = (corner % side, corner / side);
        let p = DVec3::new(f64::from(x), f64::from(grid.height(x, z)), f64::from(z));
        transform.transform_point3(p).to_array()
    };
    let triangles = (0..cells * cells).flat_map(|cell| {
        let a = cell / cells * side + cell % cells;
        let (b, c, d) = (a + 1, a + side, a + side + 1);
        // The direction of the diagonal alternates, so that no direction is preferred.
        if (cell / cells + cell % cells).is_multiple_of(2) {
            [[a, c, d], [a, d, b]]
        } else {
            [[a, c, b], [b, c, d]]
        }
    });
    let mut mesh = TriangleMesh {
        positions: Positions::Double((0..side * side).map(position).collect()),
        triangles: triangles.collect(),
        normals: None,
        uvs: None,
    };
    mesh.normals = Some(mesh.smooth_normals());
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_two_triangles_that_face_up() {
        let heights = (0..36).map(|i| ((i * 7) % 5) as f32 * 0.1).collect();
        let grid = HeightGrid::new(5, heights).unwrap();
        let transform = DAffine3::from_scale(DVec3::new(2.0, 3.0, 2.0));
        let mesh = mesh_of_heights(&grid, &transform);
        assert_eq!(mesh.triangles.len(), 50);
        let mut area = 0.0;
        for (&triangle, normals) in
            mesh.triangles.iter().zip(std::iter::repeat(mesh.normals.as_ref().unwrap()))
        {
            let [a, b, c] = mesh.positions.corners(triangle);
            let across = (b - a).cross(c - a);
            assert!(across.y > 0.0);
            area += 0.5 * across.y;
            assert!(triangle.iter().all(|&vertex| normals[vertex as usize].y > 0.0));
        }
        assert!((area - 100.0).abs() < 1e-9, "{area}");
    }
}
