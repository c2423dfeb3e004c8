//! Vertex data that textures need: tangents, and bump maps converted to normal maps.

use super::material::Needs;
use super::paint::luminance;
use super::pictures::texture_of;
use crate::math::unit_f64;
use crate::scene_file::mesh::TriangleMesh;
use crate::textures::{Sampler, TextureSlot, VertexData, Wrap};
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// Bump maps with more texels are not converted to normal maps.
const MOST_TEXELS: u64 = 1 << 26;

/// Edges of a triangle in space per unit of its first and second coordinate; `None` where it has no extent in the picture.
fn along_picture(mesh: &TriangleMesh, uvs: &[Vec2], triangle: [u32; 3]) -> Option<[DVec3; 2]> {
    let [a, b, c] = mesh.positions.corners(triangle);
    let [p, q, r] = triangle.map(|vertex| uvs.get(vertex as usize).copied().unwrap_or_default().as_dvec2());
    let (e1, e2): (DVec3, DVec3) = (b - a, c - a);
    let (d1, d2): (DVec2, DVec2) = (q - p, r - p);
    let determinant = d1.perp_dot(d2);
    let both = [(e1 * d2.y - e2 * d1.y) / determinant, (e2 * d1.x - e1 * d2.x) / determinant];
    both.iter().all(|edge| edge.is_finite()).then_some(both)
}

/// Tangents along the first coordinate, weighted by area; zero where there are none. The second axis of the picture's frame is
/// the cross product of normal and tangent, whatever the second coordinate.
fn tangents(mesh: &TriangleMesh, uvs: &[Vec2], is_mirrored: bool) -> Vec<(Vec3, f32)> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.positions.corners(triangle);
        let area = (b - a).cross(c - a).length();
        let Some(along) = along_picture(mesh, uvs, triangle).and_then(|[along, _]| unit_f64(along)) else {
            continue;
        };
        triangle.iter().for_each(|vertex| sums[*vertex as usize] += along * area);
    }
    let sign = if is_mirrored { -1.0 } else { 1.0 };
    sums.into_iter().map(|sum| (unit_f64(sum).map_or(Vec3::ZERO, |sum| sum.as_vec3()), sign)).collect()
}

/// The vertex data that a material needs of a mesh.
pub(crate) fn vertex_data(
    mesh: &TriangleMesh,
    uvs: Vec<Vec2>,
    colours: Vec<Vec4>,
    needs: Needs,
    is_mirrored: bool,
) -> VertexData {
    let tangents =
        if needs.tangents && !uvs.is_empty() { tangents(mesh, &uvs, is_mirrored) } else { Vec::new() };
    VertexData { uvs: [uvs, Vec::new()], colours, tangents }
}

/// Converts a bump map of this height to a normal map for a mesh with these coordinates, by the mean size of the picture on the
/// mesh. `None` where the picture has no size there.
pub(crate) fn bumped(
    slot: &TextureSlot,
    height: f64,
    (mesh, uvs): (&TriangleMesh, &[Vec2]),
    to_world: &DAffine3,
) -> Option<TextureSlot> {
    let [width, rows] = slot.texture.size();
    if u64::from(width) * u64::from(rows) > MOST_TEXELS {
        return None;
    }
    let (mut lengths, mut turn, mut whole) = (DVec2::ZERO, 0.0, 0.0);
    for &triangle in &mesh.triangles {
        let Some(edges) = along_picture(mesh, uvs, triangle) else { continue };
        let [along, across] = edges.map(|edge| to_world.transform_vector3(edge));
        let [a, b, c] = mesh.positions.corners(triangle);
        let normal = to_world.transform_vector3(b - a).cross(to_world.transform_vector3(c - a));
        let area = normal.length();
        lengths += DVec2::new(along.length(), across.length()) * area;
        turn += along.cross(across).dot(normal).signum() * area;
        whole += area;
    }
    let lengths = lengths / whole;
    if !(lengths.is_finite() && lengths.min_element() > 0.0) {
        return None;
    }
    let sampler = Sampler { wrap: [Wrap::Repeat; 2], nearest: true, finest: true };
    let heights: Vec<f64> = (0..rows)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let at = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / rows as f32);
            luminance(slot.texture.at(at, 0.0, &sampler).truncate().as_dvec3())
        })
        .collect();
    let clamps = slot.sampler.wrap.map(|wrap| wrap == Wrap::Clamp);
    let near = |i: u32, step: i64, size: u32, clamps: bool| {
        let i = i64::from(i) + step;
        if clamps { i.clamp(0, i64::from(size) - 1) as usize } else { i.rem_euclid(i64::from(size)) as usize }
    };
    let linear = slot.transform.matrix2.as_dmat2();
    let orientation = if turn < 0.0 { -1.0 } else { 1.0 };
    let texels: Vec<Vec4> = (0..rows)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let at = |x: usize, y: usize| heights[y * width as usize + x];
            let row = y as usize;
            let column = x as usize;
            let du = at(near(x, 1, width, clamps[0]), row) - at(near(x, -1, width, clamps[0]), row);
            let dv = at(column, near(y, 1, rows, clamps[1])) - at(column, near(y, -1, rows, clamps[1]));
            // Per unit of the picture, then of the mesh's coordinates, then of length.
            let gradient = DVec2::new(du * f64::from(width), dv * f64::from(rows)) * 0.5;
            let slope = linear.transpose() * gradient * height / lengths;
            let normal = DVec3::new(-slope.x, -orientation * slope.y, 1.0).normalize_or(DVec3::Z);
            (normal * 0.5 + 0.5).as_vec3().extend(1.0)
        })
        .collect();
    let texture = Arc::new(texture_of(width, rows, &texels));
    Some(TextureSlot { texture, ..slot.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::import::tessellate;

    /// A slope of the picture along its first coordinate tilts the normal against it, by height over length.
    #[test]
    fn bumps_are_slopes_over_lengths() {
        let mesh = tessellate::rectangle();
        let uvs = mesh.uvs.clone().unwrap();
        let width = 16u32;
        let pixels: Vec<Vec4> =
            (0..4 * width).map(|i| Vec3::splat((i % width) as f32 / 16.0).extend(1.0)).collect();
        let texture = Arc::new(texture_of(width, 4, &pixels));
        let sampler = Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() };
        let slot = TextureSlot { texture, sampler, set: 0, transform: glam::Affine2::IDENTITY };
        // The rectangle is two units wide, so a rise of 0.5 over the picture is a slope of 0.25.
        let map = bumped(&slot, 0.5, (&mesh, &uvs), &DAffine3::IDENTITY).unwrap();
        let texel = map.texture.at(Vec2::new(0.5, 0.5), 0.0, &sampler).truncate() * 2.0 - 1.0;
        assert!((texel.x / texel.z + 0.25).abs() < 1e-3 && texel.y.abs() < 1e-3, "{texel}");
    }
}
