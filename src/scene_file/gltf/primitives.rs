//! Primitives of meshes to triangles.

use super::data::Data;
use super::error::{Failure, fail};
use crate::math::unit;
use crate::scene_file::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable};
use crate::textures::VertexData;
use glam::{Vec2, Vec3, Vec4};
use gltf::Semantic;
use gltf::mesh::Mode;

/// Memory that meshes of one file may take.
const MOST_KEPT: u64 = 1 << 32;

/// What primitives are left out.
#[derive(Debug, Default)]
pub(super) struct PrimitiveReport {
    /// Points and lines.
    pub other_modes: u64,
    /// Without positions, or without triangles.
    pub empty: u64,
    /// With more than two sets of coordinates or one of colours in use.
    pub morphed: u64,
    /// Of triangles and their vertices.
    pub mesh: MeshReport,
    /// Bytes kept so far.
    kept: u64,
}

/// Triangles and what textures need.
#[derive(Debug)]
pub(super) struct ReadPrimitive {
    pub mesh: TriangleMesh,
    pub data: VertexData,
}

/// Reads a primitive; `None` where there is nothing to see of it, which is counted.
pub(super) fn read(
    data: &mut Data<'_>,
    primitive: &gltf::Primitive<'_>,
    object: &str,
    report: &mut PrimitiveReport,
) -> Result<Option<ReadPrimitive>, Failure> {
    if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        report.other_modes += 1;
        return Ok(None);
    }
    let Some(positions) = primitive.get(&Semantic::Positions) else {
        report.empty += 1;
        return Ok(None);
    };
    report.morphed += u64::from(primitive.morph_targets().next().is_some());
    let positions = data.vectors::<3>(&positions)?;
    let count = positions.len();
    let order = match primitive.indices() {
        Some(accessor) => data.indices(&accessor)?,
        None => (0..count as u32).collect(),
    };
    if let Some((place, index)) = order.iter().enumerate().find(|(_, index)| **index as usize >= count) {
        let problem = format!("index {place} is vertex {index}, and there are {count}; the file is damaged");
        return fail(object, problem);
    }
    let mut triangles = triangles(primitive.mode(), &order);
    let remap = compact(&mut triangles, count);
    let keep = |index: usize| remap.as_ref().is_none_or(|remap| remap[index] != u32::MAX);
    let attribute = |semantic: Semantic| -> Result<Option<gltf::Accessor<'_>>, Failure> {
        let Some(accessor) = primitive.get(&semantic) else { return Ok(None) };
        if accessor.count() != count {
            let problem = format!(
                "{semantic:?} has {} elements for {count} vertices; the file is damaged",
                accessor.count()
            );
            return fail(object, problem);
        }
        Ok(Some(accessor))
    };
    fn kept<T>(values: Vec<T>, keep: &impl Fn(usize) -> bool) -> impl Iterator<Item = T> {
        values.into_iter().enumerate().filter(|(index, _)| keep(*index)).map(|(_, value)| value)
    }
    let mut vertices = VertexData::default();
    let normals = match attribute(Semantic::Normals)? {
        None => None,
        Some(accessor) => {
            let normals = kept(data.vectors::<3>(&accessor)?, &keep);
            Some(normals.map(|normal| usable_normal(normal, &mut report.mesh)).collect::<Vec<_>>())
        }
    };
    for set in 0..2 {
        if let Some(accessor) = attribute(Semantic::TexCoords(set))? {
            let uvs = kept(data.vectors::<2>(&accessor)?, &keep).map(Vec2::from_array);
            vertices.uvs[set as usize] = uvs.map(|uv| usable_uv(uv, &mut report.mesh)).collect();
        }
    }
    if let Some(accessor) = attribute(Semantic::Colors(0))? {
        let colours = kept(data.vectors::<4>(&accessor)?, &keep).map(Vec4::from_array);
        vertices.colours = colours
            .map(|colour| if colour.is_nan() { Vec4::ONE } else { colour.clamp(Vec4::ZERO, Vec4::ONE) })
            .collect();
    }
    if let Some(accessor) = attribute(Semantic::Tangents)? {
        let tangents = kept(data.vectors::<4>(&accessor)?, &keep);
        let tangent = |[x, y, z, sign]: [f32; 4]| {
            (unit(Vec3::new(x, y, z)).unwrap_or(Vec3::ZERO), if sign < 0.0 { -1.0 } else { 1.0 })
        };
        vertices.tangents = tangents.map(tangent).collect();
    }
    let positions = Positions::Single(kept(positions, &keep).collect());
    drop_unusable(&mut triangles, &positions, &mut report.mesh);
    if triangles.is_empty() {
        report.empty += 1;
        return Ok(None);
    }
    report.kept += 100 * positions.len() as u64 + 24 * triangles.len() as u64;
    if report.kept > MOST_KEPT {
        return fail(object, format!("the meshes of this file take more than {MOST_KEPT} bytes; split it"));
    }
    // Coordinates are with the data for textures.
    Ok(Some(ReadPrimitive {
        mesh: TriangleMesh { positions, triangles, normals, uvs: None },
        data: vertices,
    }))
}

/// Triangles of a list, strip or fan (glTF 2.0, section 3.7.2.1); a rest of one or two corners is dropped.
fn triangles(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => order
            .windows(3)
            .enumerate()
            .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] })
            .collect(),
        Mode::TriangleFan => match order {
            [first, rest @ ..] => rest.windows(2).map(|pair| [pair[0], pair[1], *first]).collect(),
            [] => Vec::new(),
        },
        _ => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

/// Renumbers vertices so that those in use come without gaps; the new number of each, `u32::MAX` for those that go, or `None`
/// where all stay.
fn compact(triangles: &mut [[u32; 3]], count: usize) -> Option<Vec<u32>> {
    let mut used = vec![false; count];
    triangles.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
    if used.iter().all(|used| *used) {
        return None;
    }
    let mut next = 0;
    let remap: Vec<u32> = used
        .into_iter()
        .map(|used| {
            next += u32::from(used);
            if used { next - 1 } else { u32::MAX }
        })
        .collect();
    triangles.iter_mut().flatten().for_each(|vertex| *vertex = remap[*vertex as usize]);
    Some(remap)
}

fn usable_normal(normal: [f32; 3], report: &mut MeshReport) -> Vec3 {
    unit(Vec3::from_array(normal)).unwrap_or_else(|| {
        report.unusable_normals += 1;
        Vec3::ZERO
    })
}

fn usable_uv(uv: Vec2, report: &mut MeshReport) -> Vec2 {
    if uv.is_finite() {
        return uv;
    }
    report.unusable_uvs += 1;
    Vec2::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangles(Mode::TriangleStrip, &[0, 1, 2, 3, 4]), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(triangles(Mode::TriangleFan, &[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3, 4]), [[0, 1, 2]]);
        for mode in [Mode::TriangleStrip, Mode::TriangleFan, Mode::Triangles] {
            assert!(triangles(mode, &[]).is_empty() && triangles(mode, &[0]).is_empty());
        }
    }

    #[test]
    fn unused_vertices_go() {
        let mut used = [[0, 3, 5], [5, 3, 1]];
        let remap = compact(&mut used, 7).unwrap();
        assert_eq!(used, [[0, 2, 3], [3, 2, 1]]);
        assert_eq!(remap, [0, 1, u32::MAX, 2, u32::MAX, 3, u32::MAX]);
        assert!(compact(&mut [[0, 1, 2]], 3).is_none());
    }
}
