//! Memory estimate of a file, from its JSON alone, before its data are read.

use super::container::split_head;
use super::nodes::{Hierarchy, Pose};
use super::primitives::{BYTES_OF_TRIANGLE, BYTES_OF_VERTEX};
use crate::memory::MemoryEstimate;
use crate::scene_file::mesh_size::MeshSize;
use gltf::Semantic;
use gltf::mesh::Mode;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// Bytes of a JSON object while the file is read: a node of a search tree, and its copy in the types of the crate.
const OBJECT: u64 = 700;

/// Bytes of an item of a JSON list or object.
const ITEM: u64 = 60;

/// Additional bytes of a vertex while it is read: the positions, and one attribute at a time with its copy.
const READING_VERTEX: u64 = 12 + 2 * 16;

/// Additional bytes of a skin for each vertex: the mean of its joints, and joints and weights.
const SKINNING_VERTEX: u64 = 104 + 32;

/// Bytes of an index while it is read, and of its share of the triangles.
const READING_INDEX: u64 = 8;

/// Bytes that the parsed JSON takes, estimated from its number of brackets and commas.
pub(super) fn of_text(text: &[u8]) -> u64 {
    let (mut objects, mut items, mut inside, mut escaped) = (0u64, 0u64, false, false);
    for byte in text {
        if inside {
            inside = escaped || *byte != b'"';
            escaped = !escaped && *byte == b'\\';
            continue;
        }
        match byte {
            b'"' => inside = true,
            b'{' => objects += 1,
            b',' | b'[' => items += 1,
            _ => {}
        }
    }
    objects * OBJECT + items * ITEM + text.len() as u64
}

fn triangles_of(mode: Mode, corners: u64) -> u64 {
    match mode {
        Mode::Triangles => corners / 3,
        Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
        _ => 0,
    }
}

/// Adds the meshes in the nodes of a scene to an estimate.
pub(super) fn add_meshes(document: &gltf::Document, hierarchy: &Hierarchy, estimate: &mut MemoryEstimate) {
    let distinct: BTreeSet<(usize, &Pose)> =
        hierarchy.meshes.iter().map(|placed| (placed.index, &placed.pose)).collect();
    let (mut triangles, mut meshes, mut reading) = (0u64, 0u64, 0u64);
    for (mesh, pose) in distinct {
        let Some(mesh) = document.meshes().nth(mesh) else { continue };
        for primitive in mesh.primitives() {
            let Some(positions) = primitive.get(&Semantic::Positions) else { continue };
            let vertices = positions.count() as u64;
            let corners = primitive.indices().map_or(vertices, |indices| indices.count() as u64);
            let count = triangles_of(primitive.mode(), corners);
            triangles = triangles.saturating_add(count);
            let kept = vertices
                .saturating_mul(BYTES_OF_VERTEX)
                .saturating_add(count.saturating_mul(BYTES_OF_TRIANGLE));
            meshes = meshes.saturating_add(kept);
            let skinning = if pose.skin.is_some() { SKINNING_VERTEX } else { 0 };
            let read = vertices.saturating_mul(READING_VERTEX + skinning);
            reading = reading.max(read.saturating_add(corners.saturating_mul(READING_INDEX)));
        }
    }
    let built = MemoryEstimate::of_triangles(triangles);
    *estimate = MemoryEstimate {
        meshes,
        reading: estimate.reading.saturating_add(reading),
        lights: estimate.lights,
        ..built
    };
}

/// Size of all meshes of a file that a scene file names, from the JSON alone.
pub(in crate::scene_file) fn declared_gltf_size(path: &Path) -> io::Result<MeshSize> {
    let (text, length) = split_head(path)?;
    let reading = of_text(&text).saturating_add(length);
    let value: Value = serde_json::from_slice(&text)?;
    let list =
        |value: &Value, key: &str| value.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    let accessors = list(&value, "accessors");
    let count = |index: Option<&Value>| {
        let accessor =
            index.and_then(Value::as_u64).and_then(|index| accessors.get(usize::try_from(index).ok()?));
        accessor.and_then(|accessor| accessor.get("count")?.as_u64())
    };
    let mut size = MeshSize { has_normals: true, reading, ..MeshSize::default() };
    for primitive in list(&value, "meshes").iter().flat_map(|mesh| list(mesh, "primitives")) {
        let Some(vertices) = count(primitive.pointer("/attributes/POSITION")) else { continue };
        let corners = count(primitive.get("indices")).unwrap_or(vertices);
        let triangles = match primitive.get("mode").and_then(Value::as_u64).unwrap_or(4) {
            4 => corners / 3,
            5 | 6 => corners.saturating_sub(2),
            _ => 0,
        };
        size.vertices = size.vertices.saturating_add(vertices);
        size.triangles = size.triangles.saturating_add(triangles);
    }
    // With coordinates, tangents and colours; other files are read as a whole.
    size.reading = size.reading.saturating_add(size.vertices.saturating_mul(BYTES_OF_VERTEX));
    let buffers = list(&value, "buffers");
    let external = buffers.iter().filter(|buffer| buffer.get("uri").is_some());
    let bytes = external.filter_map(|buffer| buffer.get("byteLength")?.as_u64());
    size.reading = bytes.fold(size.reading, u64::saturating_add);
    Ok(size)
}
