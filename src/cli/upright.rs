//! A note for meshes that look as if they lay on their backs, as files with z up do in a world with y up.

use cardioid::scene::{Geometry, Scene};
use glam::Vec3;

/// Smallest ratio of depth to height and width for a mesh that may lie on its back.
const DEEP: f32 = 1.5;

/// Faces along z within this fraction of the depth from the lowest z can be the base of the mesh.
const BASE_DEPTH: f32 = 0.02;

/// Smallest cosine of the angle between the normal of a level face and z.
const LEVEL: f32 = 0.95;

/// Smallest share of the outline, as seen along z, that level faces at the lowest z must cover to be a base. A shape that merely
/// ends there, like a fish, has no base.
const BASE_SHARE: f32 = 0.1;

/// A note for a mesh that is much deeper than high and wide and has a base at its lowest z. The mesh itself is not rotated.
pub(crate) fn note_of_axis(scene: &Scene) -> Option<&'static str> {
    let buffers = || {
        scene.surfaces().iter().filter_map(|surface| match &surface.geometry {
            Geometry::Mesh(mesh) => Some(&mesh.buffers),
            Geometry::Procedural(_) => None,
        })
    };
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let corners = buffers().flat_map(|buffers| buffers.positions()).map(|corner| Vec3::from_array(*corner));
    let (low, high) = corners.fold(empty, |(low, high), at| (low.min(at), high.max(at)));
    let size = high - low;
    if !(size.z > DEEP * size.x.max(size.y)) {
        return None;
    }
    let base = buffers().map(|buffers| {
        let positions = buffers.positions();
        let triangles = buffers.triangles().iter();
        let faces = triangles.map(|triangle| triangle.map(|i| Vec3::from_array(positions[i as usize])));
        faces.map(|face| area_of_base(face, low.z + BASE_DEPTH * size.z)).sum::<f32>()
    });
    (base.sum::<f32>() > BASE_SHARE * size.x * size.y).then_some(
        "note: this mesh is much deeper than high and is flat at its lowest z, as if it lay on its back; where its file has z up, \
         add --up z",
    )
}

/// Area of a level triangle below `highest`, projected along z; zero for other triangles.
fn area_of_base([a, b, c]: [Vec3; 3], highest: f32) -> f32 {
    let twice = (b - a).cross(c - a);
    let is_base = a.z.max(b.z).max(c.z) <= highest && twice.z.abs() > LEVEL * twice.length();
    if is_base { 0.5 * twice.z.abs() } else { 0.0 }
}
