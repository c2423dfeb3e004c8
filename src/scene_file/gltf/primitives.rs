//! Converts the primitives of meshes to triangles.

use super::data::Data;
use super::error::{Failure, fail};
use crate::math::unit;
use crate::scene_file::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable};
use crate::textures::VertexData;
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};
use gltf::Semantic;
use gltf::mesh::Mode;

/// Most memory that the meshes of one file may take.
const MOST_KEPT: u64 = 1 << 32;

/// Bytes of a vertex in memory: position, normal, two pairs of coordinates, tangent and colour.
pub(super) const BYTES_OF_VERTEX: u64 = 100;

/// Bytes of a triangle in memory.
pub(super) const BYTES_OF_TRIANGLE: u64 = 24;

/// Deformation of a primitive's vertices.
#[derive(Debug, Default)]
pub(super) struct Deformation<'a> {
    /// Weights of the morph targets; empty where all are zero.
    pub weights: Vec<f32>,
    /// Transforms of the skin's joints, from the bind pose to the world.
    pub joints: Option<&'a [DAffine3]>,
}

/// Counts of the primitives and vertices that were left out.
#[derive(Debug, Default)]
pub(super) struct PrimitiveReport {
    /// Primitives of points and lines.
    pub other_modes: u64,
    /// Primitives without positions or without triangles.
    pub empty: u64,
    /// Vertices that no joint of their skin moves.
    pub loose: u64,
    /// Problems of triangles and their vertices.
    pub mesh: MeshReport,
    /// Bytes kept so far.
    kept: u64,
}

/// Triangles with the vertex data for textures.
#[derive(Debug)]
pub(super) struct ReadPrimitive {
    pub mesh: TriangleMesh,
    pub data: VertexData,
}

/// Reads a primitive. Yields `None` where it has no visible triangles, and counts it in the report.
pub(super) fn read(
    data: &mut Data<'_>,
    primitive: &gltf::Primitive<'_>,
    deformation: &Deformation<'_>,
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
    let mut positions = data.vectors_exactly::<3>(&positions)?;
    let count = positions.len();
    add_targets(data, primitive, &deformation.weights, |target| target.positions(), &mut positions)?;
    let skinned = match deformation.joints {
        Some(joints) => Some(skinning(data, primitive, joints, object, report)?),
        None => None,
    };
    if let Some(skinned) = &skinned {
        for (position, matrix) in positions.iter_mut().zip(skinned) {
            let moved = matrix.transform_point3(DVec3::from_array(position.map(f64::from)));
            *position = moved.as_vec3().to_array();
        }
    }
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
            let mut normals = data.vectors_exactly::<3>(&accessor)?;
            add_targets(data, primitive, &deformation.weights, |target| target.normals(), &mut normals)?;
            for (normal, matrix) in normals.iter_mut().zip(skinned.iter().flatten()) {
                *normal = moved_normal(&matrix.matrix3, *normal);
            }
            let normals = kept(normals, &keep);
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
        let tangents = data.vectors_exactly::<4>(&accessor)?;
        let (mut along, signs): (Vec<_>, Vec<_>) =
            tangents.into_iter().map(|[x, y, z, sign]| ([x, y, z], sign)).unzip();
        add_targets(data, primitive, &deformation.weights, |target| target.tangents(), &mut along)?;
        for (tangent, matrix) in along.iter_mut().zip(skinned.iter().flatten()) {
            let moved = matrix.matrix3 * DVec3::from_array(tangent.map(f64::from));
            *tangent = moved.as_vec3().to_array();
        }
        let tangents = along.into_iter().zip(signs).map(|([x, y, z], sign)| [x, y, z, sign]).collect();
        let tangents = kept(tangents, &keep);
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
    report.kept += BYTES_OF_VERTEX * positions.len() as u64 + BYTES_OF_TRIANGLE * triangles.len() as u64;
    if report.kept > MOST_KEPT {
        return fail(object, format!("the meshes of this file take more than {MOST_KEPT} bytes; split it"));
    }
    // Texture coordinates are part of the data for textures.
    Ok(Some(ReadPrimitive {
        mesh: TriangleMesh { positions, triangles, normals, uvs: None },
        data: vertices,
    }))
}

/// Adds the weighted displacements of the morph targets.
fn add_targets(
    data: &mut Data<'_>,
    primitive: &gltf::Primitive<'_>,
    weights: &[f32],
    part: impl for<'d> Fn(&gltf::mesh::MorphTarget<'d>) -> Option<gltf::Accessor<'d>>,
    values: &mut [[f32; 3]],
) -> Result<(), Failure> {
    for (target, &weight) in primitive.morph_targets().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        let Some(accessor) = part(&target) else { continue };
        for (value, offset) in values.iter_mut().zip(data.vectors_exactly::<3>(&accessor)?) {
            *value = (Vec3::from_array(*value) + weight * Vec3::from_array(offset)).to_array();
        }
    }
    Ok(())
}

/// For each vertex the weighted mean of its joint transforms (glTF 2.0, section 3.7.3.3).
fn skinning(
    data: &mut Data<'_>,
    primitive: &gltf::Primitive<'_>,
    joints: &[DAffine3],
    object: &str,
    report: &mut PrimitiveReport,
) -> Result<Vec<DAffine3>, Failure> {
    let mut sums: Vec<(DAffine3, f64)> = Vec::new();
    for set in 0.. {
        let (Some(indices), Some(weights)) =
            (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
        else {
            break;
        };
        let (indices, weights) = (data.vectors_exactly::<4>(&indices)?, data.vectors_exactly::<4>(&weights)?);
        sums.resize(indices.len(), (DAffine3::ZERO, 0.0));
        for ((sum, total), (indices, weights)) in sums.iter_mut().zip(indices.into_iter().zip(weights)) {
            for (index, weight) in indices.into_iter().zip(weights) {
                let weight = f64::from(weight);
                if !(weight > 0.0 && weight.is_finite()) {
                    continue;
                }
                let Some(joint) = joints.get(index as usize) else {
                    let problem =
                        format!("a vertex hangs on joint {index}, and its skin has {}", joints.len());
                    return fail(object, format!("{problem}; the file is damaged"));
                };
                sum.matrix3 += joint.matrix3 * weight;
                sum.translation += joint.translation * weight;
                *total += weight;
            }
        }
    }
    let mean = |(sum, total): (DAffine3, f64)| {
        if total > 0.0 {
            return DAffine3 { matrix3: sum.matrix3 * total.recip(), translation: sum.translation / total };
        }
        report.loose += 1;
        joints.first().copied().unwrap_or(DAffine3::IDENTITY)
    };
    Ok(sums.into_iter().map(mean).collect())
}

/// Transforms a surface normal by a matrix. It uses the cofactors, which need no inverse.
fn moved_normal(matrix: &DMat3, normal: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let moved = cofactors * DVec3::from_array(normal.map(f64::from)) * matrix.determinant().signum();
    moved.normalize_or_zero().as_vec3().to_array()
}

/// Triangles of a list, strip or fan (glTF 2.0, section 3.7.2.1); one or two corners that are left over are dropped.
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

/// Renumbers the vertices in use without gaps. Yields the new number of each vertex, `u32::MAX` for unused ones, or `None` where
/// all are in use.
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
