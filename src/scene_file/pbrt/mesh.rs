//! Meshes in the text of a scene, and compressed mesh files.

use super::error::{Fault, fail};
use super::import::Allow;
use super::object::Object;
use super::report::Subject;
use crate::files::read_regular;
use crate::memory::MemoryEstimate;
use crate::scene_file::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable};
use crate::scene_file::ply::parse_ply_model;
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::io::Read;
use std::path::Path;

/// Longest mesh file after it is unpacked, in bytes.
const MOST_BYTES: u64 = 16 << 30;

/// Squares along each side of a bilinear patch that is not flat, in a mesh of few.
const FINE: u32 = 16;

/// Vertices up to which patches are divided.
const MOST_VERTICES: usize = 1 << 24;

/// Distance from its plane, as a share of its size, below which a patch is flat.
const FLAT: f64 = 1e-5;

/// Types of points, normals and coordinates.
const POINTS: [&str; 2] = ["point3", "point"];
const NORMALS: [&str; 4] = ["normal", "normal3", "vector3", "vector"];
const COORDINATES: [&str; 3] = ["point2", "vector2", "float"];

fn points(numbers: &[f64]) -> Vec<[f64; 3]> {
    numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
}

/// Indices of a mesh with this number of vertices, in groups of `N`.
fn indices<const N: usize>(object: &Object, vertices: usize) -> Result<Vec<[u32; N]>, Fault> {
    let numbers = object.list("indices", &["integer"], N)?;
    if numbers.is_empty() {
        if vertices == N {
            return Ok(vec![std::array::from_fn(|i| i as u32)]);
        }
        let message = format!("{} has {vertices} vertices and no indices", object.label());
        return fail(&object.place, message, "write for example \"integer indices\" [ 0 1 2 ]");
    }
    let wrong = numbers.iter().find(|index| !(0.0..vertices as f64).contains(*index) || index.fract() != 0.0);
    if let Some(index) = wrong {
        let message = format!("{} has the index {index} and {vertices} vertices", object.label());
        return fail(object.place_of("indices"), message, "write numbers of its vertices, from 0");
    }
    Ok(numbers.chunks_exact(N).map(|group| std::array::from_fn(|i| group[i] as u32)).collect())
}

/// Data of the vertices, which are as many as the positions.
fn of_vertices<'a>(
    object: &'a Object,
    name: &str,
    kinds: &[&str],
    (each, vertices): (usize, usize),
) -> Result<Option<&'a [f64]>, Fault> {
    let numbers = object.list(name, kinds, each)?;
    if numbers.is_empty() {
        return Ok(None);
    }
    if numbers.len() / each != vertices {
        let message =
            format!("{} has {vertices} vertices and {} of `{name}`", object.label(), numbers.len() / each);
        return fail(object.place_of(name), message, "give each vertex one");
    }
    Ok(Some(numbers))
}

fn normals(object: &Object, vertices: usize) -> Result<Option<Vec<Vec3>>, Fault> {
    let numbers = of_vertices(object, "N", &NORMALS, (3, vertices))?;
    let unit =
        |n: &[f64]| crate::math::unit_f64(DVec3::new(n[0], n[1], n[2])).map_or(Vec3::ZERO, |n| n.as_vec3());
    Ok(numbers.map(|numbers| numbers.chunks_exact(3).map(unit).collect()))
}

fn coordinates(object: &Object, vertices: usize) -> Result<Option<Vec<Vec2>>, Fault> {
    let name = ["uv", "st"].into_iter().find(|name| object.has(name)).unwrap_or("uv");
    let numbers = of_vertices(object, name, &COORDINATES, (2, vertices))?;
    Ok(numbers
        .map(|numbers| numbers.chunks_exact(2).map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32)).collect()))
}

/// A mesh of triangles in the text.
pub(super) fn inline(object: &Object) -> Result<TriangleMesh, Fault> {
    let positions = points(object.list("P", &POINTS, 3)?);
    if positions.is_empty() {
        let message = format!("{} has no vertices", object.label());
        return fail(&object.place, message, "write \"point3 P\" [ ... ]");
    }
    let triangles = indices::<3>(object, positions.len())?;
    let mut mesh = TriangleMesh {
        normals: normals(object, positions.len())?,
        uvs: coordinates(object, positions.len())?,
        positions: Positions::Double(positions),
        triangles,
    };
    // Tangents and numbers of faces are not used.
    object.get("S");
    object.get("faceIndices");
    drop_unusable(&mut mesh.triangles, &mesh.positions, &mut MeshReport::default());
    if mesh.normals.is_some() {
        mesh.follow_normals();
    }
    Ok(mesh)
}

/// Squares along each side of patches that are not flat.
fn steps_of(patches: usize) -> u32 {
    let fits = |steps: &u32| patches.saturating_mul((*steps as usize + 1).pow(2)) <= MOST_VERTICES;
    (2..=FINE).rev().find(fits).unwrap_or(1)
}

/// Bilinear patches as triangles, and whether all of them are flat. `allow` decides about this number of vertices.
pub(super) fn bilinear(
    object: &Object,
    allow: impl FnOnce(u64) -> Result<(), Fault>,
) -> Result<(TriangleMesh, bool), Fault> {
    let corners = points(object.list("P", &POINTS, 3)?);
    if corners.is_empty() {
        let message = format!("{} has no vertices", object.label());
        return fail(&object.place, message, "write \"point3 P\" [ ... ]");
    }
    let patches = indices::<4>(object, corners.len())?;
    let own_normals = normals(object, corners.len())?;
    let own_uvs = coordinates(object, corners.len())?;
    object.get("faceIndices");
    let at = |vertex: u32| DVec3::from_array(corners[vertex as usize]);
    let is_flat = |patch: &[u32; 4]| {
        let [a, b, c, d] = patch.map(at);
        let size = (b - a).length().max((c - a).length()).max((d - a).length());
        let normal = crate::math::unit_f64((b - a).cross(c - a)).unwrap_or(DVec3::ZERO);
        normal.dot(d - a).abs() <= FLAT * size
    };
    let all_flat = patches.iter().all(is_flat);
    let steps = if all_flat { 1 } else { steps_of(patches.len()) };
    allow((patches.len() as u64).saturating_mul(u64::from(steps + 1).pow(2)))?;
    let (mut positions, mut uvs, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let mut normals = own_normals.as_ref().map(|_| Vec::new());
    for patch in &patches {
        let first = positions.len() as u32;
        for row in 0..=steps {
            for column in 0..=steps {
                let [u, v] = [column, row].map(|i| f64::from(i) / f64::from(steps));
                // The corners are those of (0, 0), (1, 0), (0, 1) and (1, 1).
                let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
                let sum = |of: &dyn Fn(u32) -> DVec3| -> DVec3 {
                    patch.iter().zip(weights).map(|(vertex, weight)| of(*vertex) * weight).sum()
                };
                positions.push(sum(&at).to_array());
                uvs.push(match &own_uvs {
                    Some(own) => {
                        sum(&|vertex| own[vertex as usize].as_dvec2().extend(0.0)).truncate().as_vec2()
                    }
                    None => Vec2::new(u as f32, v as f32),
                });
                if let (Some(normals), Some(own)) = (&mut normals, &own_normals) {
                    let normal = sum(&|vertex| own[vertex as usize].as_dvec3());
                    normals.push(crate::math::unit_f64(normal).map_or(Vec3::ZERO, |normal| normal.as_vec3()));
                }
            }
        }
        for row in 0..steps {
            for column in 0..steps {
                let a = first + row * (steps + 1) + column;
                let (b, c, d) = (a + 1, a + steps + 2, a + steps + 1);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    let mut mesh =
        TriangleMesh { positions: Positions::Double(positions), triangles, normals, uvs: Some(uvs) };
    drop_unusable(&mut mesh.triangles, &mesh.positions, &mut MeshReport::default());
    if mesh.normals.is_some() {
        mesh.follow_normals();
    } else if !all_flat {
        mesh.normals = Some(mesh.smooth_normals());
    }
    Ok((mesh, all_flat))
}

/// The areas of the triangles of a placed mesh.
pub(super) fn areas(mesh: &TriangleMesh, to_world: &DAffine3) -> Vec<f64> {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = mesh.positions.corners(*triangle);
        let [u, v] = [b - a, c - a].map(|edge| to_world.transform_vector3(edge));
        0.5 * u.cross(v).length()
    };
    mesh.triangles.iter().map(area).collect()
}

/// A mesh without coordinates with those that pbrt gives each of its triangles: (0, 0), (1, 0) and (1, 1).
pub(super) fn with_coordinates(mesh: TriangleMesh) -> TriangleMesh {
    if mesh.uvs.is_some() {
        return mesh;
    }
    let corners = || mesh.triangles.iter().flatten();
    let count = mesh.triangles.len();
    TriangleMesh {
        positions: Positions::Double(corners().map(|i| mesh.positions.get(*i).to_array()).collect()),
        normals: mesh.normals.as_ref().map(|normals| corners().map(|i| normals[*i as usize]).collect()),
        uvs: Some([Vec2::ZERO, Vec2::X, Vec2::ONE].repeat(count)),
        triangles: (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    }
}

/// One triangle of a mesh as a mesh.
pub(super) fn one_triangle(mesh: &TriangleMesh, triangle: [u32; 3]) -> TriangleMesh {
    let positions = mesh.positions.corners(triangle).map(|corner| corner.to_array()).to_vec();
    TriangleMesh {
        positions: Positions::Double(positions),
        triangles: vec![[0, 1, 2]],
        normals: mesh.normals.as_ref().map(|normals| triangle.map(|i| normals[i as usize]).to_vec()),
        uvs: mesh.uvs.as_ref().map(|uvs| triangle.map(|i| uvs[i as usize]).to_vec()),
    }
}

/// The bytes of a file that is compressed by gzip, if they are at most `most`.
pub(super) fn unpacked(path: &Path, most: u64) -> Result<Vec<u8>, String> {
    let packed = read_regular(path, most).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut bytes = Vec::new();
    let mut reader = flate2::read::MultiGzDecoder::new(&packed[..]).take(most + 1);
    let read = reader.read_to_end(&mut bytes);
    read.map_err(|error| format!("{}: cannot be unpacked: {error}", path.display()))?;
    if bytes.len() as u64 > most {
        return Err(format!("{}: more than {most} bytes when it is unpacked", path.display()));
    }
    Ok(bytes)
}

/// The length of a file when it is unpacked, as its last bytes state it, modulo 2^32. At most a thousandfold.
fn unpacked_length(path: &Path) -> Option<u64> {
    use std::io::{Seek, SeekFrom};
    let (mut file, length) = crate::files::open_regular(path).ok()?;
    file.seek(SeekFrom::End(-4)).ok()?;
    let mut last = [0; 4];
    file.read_exact(&mut last).ok()?;
    Some(u64::from(u32::from_le_bytes(last)).max(length))
}

/// Reads a mesh that is compressed by gzip. The first part is the memory of the meshes before it.
pub(super) fn unpacked_mesh(
    path: &Path,
    (taken, allow): (&mut MemoryEstimate, Allow<'_>),
) -> Result<TriangleMesh, String> {
    let length = unpacked_length(path).unwrap_or(0);
    taken.reading = taken.reading.max(length.saturating_mul(3));
    allow(taken).map_err(|error| error.to_string())?;
    // What is longer than its last bytes say is broken, or so large that they are not enough.
    let bytes = unpacked(path, length.saturating_mul(2).clamp(1 << 20, MOST_BYTES))?;
    parse_ply_model(&bytes, path).map(|model| model.mesh).map_err(|error| error.to_string())
}
