//! Sizes of meshes, taken from the headers of their files: the memory of a scene must be known before it is read.

use super::description::{
    GeometryDescription, MaterialDescription, MeshNormals, SceneDescription, ShapeDescription,
};
use super::gltf::{declared_gltf_size, is_gltf_file};
use super::import::material::needs_of;
use super::import::tessellate;
use super::ply::declared_size;
use crate::files::open_regular;
use crate::textures::ImageTexture;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;

/// Bytes of text for one vertex and its two triangles in a typical OBJ file: a `v` and two `f`.
const OBJ_BYTES: u64 = 74;

/// Bytes of text for a triangle of an ascii STL.
const STL_TEXT: u64 = 250;

/// Bytes of a triangle of a binary STL.
const STL_RECORD: u64 = 50;

/// Size of a mesh, known or estimated before the mesh is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshSize {
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Whether its vertices have normals that the scene uses.
    pub has_normals: bool,
    /// Additional bytes while the mesh is read.
    pub reading: u64,
}

impl MeshSize {
    /// Bytes of the finished mesh.
    pub fn bytes(&self) -> u64 {
        let vertex = if self.has_normals { 24 } else { 12 };
        self.vertices.saturating_mul(vertex).saturating_add(self.triangles.saturating_mul(12))
    }
}

/// Sizes of all meshes of a scene that come from files: as loaded, or as the headers of the files state them. A file that cannot
/// be read is left out here; the error follows when it is loaded.
pub fn mesh_sizes(scene: &SceneDescription) -> Vec<MeshSize> {
    let size = |geometry: &GeometryDescription| match geometry {
        GeometryDescription::MeshFile { path, .. } if is_gltf_file(path) => declared_gltf_size(path).ok(),
        GeometryDescription::MeshFile { path, normals, .. } => mesh_size(path, *normals).ok(),
        GeometryDescription::Gltf { mesh, .. } | GeometryDescription::Loaded { mesh, .. } => Some(MeshSize {
            vertices: mesh.positions.len() as u64,
            triangles: mesh.triangles.len() as u64,
            has_normals: mesh.normals.is_some(),
            reading: 0,
        }),
        _ => None,
    };
    // Exact shapes become meshes where their material has images; the data of their vertices counts as much as the vertices.
    let is_pictured: Vec<bool> =
        scene.materials.iter().map(|material| needs_of(&material.value).any()).collect();
    let pictured = |shape: &ShapeDescription| match shape.geometry {
        GeometryDescription::Sphere { .. } | GeometryDescription::Disc { .. } => {
            let is_one = is_pictured.get(shape.material).copied().unwrap_or_default();
            let (vertices, triangles) = (2 * tessellate::MOST_VERTICES, 2 * tessellate::MOST_VERTICES);
            is_one.then_some(MeshSize { vertices, triangles, has_normals: true, reading: 0 })
        }
        _ => None,
    };
    let shapes = scene.shapes.iter().map(|shape| &shape.value);
    shapes.filter_map(|shape| size(&shape.geometry).or_else(|| pictured(shape))).collect()
}

/// Bytes of the textures that the scene's materials keep in memory.
pub fn kept_textures(scene: &SceneDescription) -> u64 {
    let mut kept: Vec<(*const ImageTexture, u64)> = Vec::new();
    for material in &scene.materials {
        if let MaterialDescription::Layered { material, .. } = &material.value {
            let textures = material.slots().map(|slot| &slot.texture);
            kept.extend(textures.map(|texture| (Arc::as_ptr(texture), texture.bytes() as u64)));
        }
    }
    kept.sort_unstable();
    kept.dedup();
    kept.iter().fold(0, |sum, (_, bytes)| sum.saturating_add(*bytes))
}

/// The size of one file.
pub(super) fn mesh_size(path: &Path, normals: MeshNormals) -> io::Result<MeshSize> {
    /// Longer headers are rare, and files with such headers are small.
    const HEAD: u64 = 1 << 16;
    let (file, length) = open_regular(path)?;
    let extension = path.extension().unwrap_or_default();
    let mut size = if extension.eq_ignore_ascii_case("obj") {
        let vertices = length / OBJ_BYTES;
        // The file, its positions in double precision twice, and a table of the corners that faces name.
        let reading = length.saturating_add(vertices.saturating_mul(24 + 24 + 8 + 24));
        MeshSize { vertices, triangles: 2 * vertices, has_normals: false, reading }
    } else {
        let mut head = Vec::new();
        file.take(HEAD).read_to_end(&mut head)?;
        if extension.eq_ignore_ascii_case("stl") {
            let count = head
                .get(80..84)
                .map_or(0, |count| u64::from(u32::from_le_bytes([count[0], count[1], count[2], count[3]])));
            let is_binary = count.checked_mul(STL_RECORD) == length.checked_sub(84);
            let triangles = if is_binary { count } else { length / STL_TEXT };
            // The file, and a table of positions.
            MeshSize {
                vertices: triangles / 2,
                triangles,
                has_normals: false,
                reading: length + 16 * triangles,
            }
        } else {
            declared_size(&head, length).unwrap_or_default()
        }
    };
    size.has_normals = match normals {
        MeshNormals::FromFile => size.has_normals,
        MeshNormals::Flat => false,
        MeshNormals::Smooth | MeshNormals::Leading => true,
    };
    if matches!(normals, MeshNormals::Smooth | MeshNormals::Leading) {
        // Sums in double precision.
        size.reading = size.reading.saturating_add(size.vertices.saturating_mul(24));
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn sizes_are_those_of_the_meshes() {
        let meshes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes");
        let size = mesh_size(&meshes.join("knot.ply"), MeshNormals::FromFile).unwrap();
        let (mesh, _) = super::super::read_mesh_file(&meshes.join("knot.ply")).unwrap();
        assert_eq!(
            (size.vertices, size.triangles),
            (mesh.positions.len() as u64, mesh.triangles.len() as u64)
        );
        assert_eq!(size.has_normals, mesh.normals.is_some());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.stl");
        let mut stl = vec![0; 80];
        stl.extend(1000u32.to_le_bytes());
        stl.resize(84 + 50_000, 0);
        fs::write(&path, &stl).unwrap();
        assert_eq!(mesh_size(&path, MeshNormals::Flat).unwrap().triangles, 1000);
        // The count that a short file declares is ignored.
        fs::write(&path, &stl[..100]).unwrap();
        assert!(mesh_size(&path, MeshNormals::Flat).unwrap().triangles < 10);
        let path = folder.path().join("a.ply");
        let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n\
            property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n";
        fs::write(&path, header).unwrap();
        let size = mesh_size(&path, MeshNormals::FromFile).unwrap();
        assert!(size.bytes() + size.reading < 10_000, "{size:?}");
        assert!(mesh_size(folder.path(), MeshNormals::Flat).is_err());
    }
}
