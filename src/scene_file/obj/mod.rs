//! OBJ meshes (Wavefront 1992), parsed on all threads: `v`, `vt`, `vn`, `f` with indices that count from the start or back from
//! the current line, `usemtl` and `mtllib`. Polygons become fans of triangles, or are triangulated by `scene_file::polygon` where
//! they are concave. Lines, points, curves and smoothing groups are not read; elements that are not faces are counted.
//!
//! This parser exists because the available crates do not report the line of an error. Every index is checked against the
//! elements before it; memory stays below 64 times the file's length.

mod files;
mod mtl;
mod piece;

pub(super) use files::{NamedFile, find_file, library_files};
pub use mtl::{MtlFinish, MtlMaterial, MtlPicture, parse_mtl_bytes, read_mtl};

use super::colours::reflectances;
use super::keyed::Keyed;
use super::mesh::{Cloud, MeshReport, Positions, TriangleMesh, drop_unusable};
use super::mesh_file::{Failure, MeshFileError, MeshPlace, MeshReading, in_file, read_bytes, words};
use super::ply::declared_look;
use super::polygon::triangulate_polygon;
use crate::files::{foreign_by_content, read_regular, text_of};
use glam::{Vec2, Vec3};
use piece::{COLOURLESS, Corner, NONE, parse_pieces};
use std::collections::HashMap;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

/// The faces of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjPart {
    /// Name of the material; `None` for faces before any `usemtl`.
    pub material: Option<String>,
    /// Corners: indices of [`ObjFile`]'s vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Number of its faces in the file.
    pub faces: u64,
    /// Number of faces with corners without texture coordinates, if coordinates are kept; these corners have the coordinates
    /// zero.
    pub unmapped_faces: u64,
}

/// The faces of one material as a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjMesh {
    /// Name of the material; `None` for faces before any `usemtl`.
    pub material: Option<String>,
    /// The mesh.
    pub mesh: TriangleMesh,
    /// Linear reflectances of its vertices.
    pub colours: Option<Vec<Vec3>>,
}

/// An OBJ file as read.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjFile {
    /// Positions of the vertices of all parts.
    pub positions: Positions,
    /// Unit normals of the vertices, where a face names some. Zero where no face names one or it is unusable.
    pub normals: Option<Vec<Vec3>>,
    /// Finite texture coordinates of the vertices, from the lower left of a picture. Zero where a face names none.
    pub uvs: Option<Vec<Vec2>>,
    /// Linear reflectances of the vertices, from the sRGB colours after their positions; white where a vertex has none.
    pub colours: Option<Vec<Vec3>>,
    /// The parts by material, in the order of the file.
    pub parts: Vec<ObjPart>,
    /// Material files, relative to the OBJ's folder, and the lines that name them.
    pub libraries: Vec<(PathBuf, usize)>,
    /// What was left out.
    pub report: MeshReport,
}

/// Reads an OBJ file. Its material files are not opened.
///
/// # Errors
/// With the file, the line, the problem, and what to do.
pub fn read_obj(path: &Path) -> Result<ObjFile, MeshFileError> {
    read_obj_with(path, &MeshReading::ALL, |_| true)
}

/// [`read_obj`] with a progress callback that may stop it. Texture coordinates are kept if `wants_uvs` returns true for the
/// material files and the lines that name them.
pub(super) fn read_obj_with(
    path: &Path,
    reading: &MeshReading<'_>,
    wants_uvs: impl FnOnce(&[(PathBuf, usize)]) -> bool,
) -> Result<ObjFile, MeshFileError> {
    parse_obj(&read_bytes(path)?, reading, wants_uvs).map_err(|failure| in_file(path, failure))
}

/// Parses the bytes of an OBJ file. Messages call it `path`.
///
/// # Errors
/// As [`read_obj`].
pub fn parse_obj_bytes(bytes: &[u8], path: &Path) -> Result<ObjFile, MeshFileError> {
    parse_obj(bytes, &MeshReading::ALL, |_| true).map_err(|failure| in_file(path, failure))
}

/// The material files that an OBJ names and the pictures that these name, or the pictures that a PLY names. Empty for other
/// files.
///
/// # Errors
/// Where the file cannot be read.
pub fn material_files(path: &Path) -> std::io::Result<Vec<PathBuf>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ply")) {
        let (_, pictures) = declared_look(path);
        return Ok(pictures.iter().map(|picture| find_file(folder, Path::new(picture)).path).collect());
    }
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj")) {
        return Ok(Vec::new());
    }
    let bytes = read_regular(path, u64::MAX)?;
    let Ok(text) = text_of(&bytes) else { return Ok(Vec::new()) };
    let lines = text.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let names = lines.filter(|line| words(line).next() == Some(b"mtllib"));
    let mut files = Vec::new();
    for line in names {
        let name = String::from_utf8_lossy(rest(line, b"mtllib"));
        for library in library_files(folder, Path::new(&*name)) {
            let materials = read_mtl(&library.path).unwrap_or_default();
            let folder = library.path.parent().unwrap_or(Path::new("")).to_path_buf();
            files.push(library.path);
            let pictures = materials
                .into_iter()
                .flat_map(|material| material.picture.into_iter().chain(material.cutout));
            files.extend(pictures.map(|picture| find_file(&folder, &picture.file).path));
        }
    }
    Ok(files)
}

impl ObjFile {
    /// All parts as one mesh.
    pub fn into_mesh(self) -> (TriangleMesh, MeshReport) {
        let triangles = self.parts.into_iter().flat_map(|part| part.triangles).collect();
        let mesh =
            TriangleMesh { positions: self.positions, triangles, normals: self.normals, uvs: self.uvs };
        (mesh, self.report)
    }

    /// The first part with all vertices.
    pub(super) fn into_one(self) -> Vec<ObjMesh> {
        let Self { positions, normals, uvs, colours, parts, .. } = self;
        let first = parts.into_iter().next().unwrap_or_default();
        let mesh = TriangleMesh { positions, triangles: first.triangles, normals, uvs };
        vec![ObjMesh { material: first.material, mesh, colours }]
    }

    /// Each part as a mesh of the vertices that it uses, with their colours.
    pub fn into_meshes(self) -> Vec<ObjMesh> {
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let mut meshes = Vec::with_capacity(self.parts.len());
        for mut part in self.parts {
            let mut used = Vec::new();
            for vertex in part.triangles.iter_mut().flatten() {
                let number = &mut numbers[*vertex as usize];
                if *number == u32::MAX {
                    *number = used.len() as u32;
                    used.push(*vertex);
                }
                *vertex = *number;
            }
            let positions = used.iter().map(|&vertex| self.positions.get(vertex).to_array()).collect();
            let normals = self.normals.as_ref();
            let normals =
                normals.map(|normals| used.iter().map(|&vertex| normals[vertex as usize]).collect());
            let uvs = self.uvs.as_ref();
            let uvs = uvs.map(|uvs| used.iter().map(|&vertex| uvs[vertex as usize]).collect());
            let colours = self.colours.as_ref();
            let colours =
                colours.map(|colours| used.iter().map(|&vertex| colours[vertex as usize]).collect());
            used.iter().for_each(|&vertex| numbers[vertex as usize] = u32::MAX);
            let positions = Positions::Double(positions);
            let mesh = TriangleMesh { positions, triangles: part.triangles, normals, uvs };
            meshes.push(ObjMesh { material: part.material, mesh, colours });
        }
        meshes
    }
}

/// The vertices of a mesh, identified by what their corners name.
#[derive(Default)]
struct Vertices {
    /// For each vertex its position, texture coordinate and normal, or [`NONE`].
    all: Vec<Corner>,
    /// For each position the coordinate and the normal that its first corner names, and the vertex made for that corner. Most
    /// files need no other table.
    first: Vec<Corner>,
    /// Vertices of further corners at a position.
    others: HashMap<Named, u32, Keyed>,
}

/// A corner as a hash key.
#[derive(PartialEq, Eq)]
struct Named(Corner);

impl Hash for Named {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let [position, coordinate, normal] = self.0;
        state.write_u64(u64::from(position) << 32 | u64::from(coordinate));
        state.write_u32(normal);
    }
}

impl Vertices {
    fn number(&mut self, corner: Corner) -> Result<u32, Failure> {
        let [position, coordinate, normal] = corner;
        let first = &mut self.first[position as usize];
        let next = self.all.len() as u32;
        if first[2] != NONE {
            if first[..2] == [coordinate, normal] {
                return Ok(first[2]);
            }
            if let Some(&known) = self.others.get(&Named(corner)) {
                return Ok(known);
            }
        }
        if next == NONE {
            return Err((MeshPlace::File, "more corners than 32 bits can count; split the mesh".to_owned()));
        }
        if first[2] == NONE {
            *first = [coordinate, normal, next];
        } else {
            self.others.insert(Named(corner), next);
        }
        self.all.push(corner);
        Ok(next)
    }
}

/// Parses the bytes of an OBJ file. Texture coordinates are kept if `wants_uvs` returns true for the material files.
pub(super) fn parse_obj(
    bytes: &[u8],
    reading: &MeshReading<'_>,
    wants_uvs: impl FnOnce(&[(PathBuf, usize)]) -> bool,
) -> Result<ObjFile, Failure> {
    let whole = |problem| (MeshPlace::File, problem);
    if let Some(foreign) = foreign_by_content(Path::new(""), bytes) {
        return Err(whole(format!("no OBJ file: it {foreign}")));
    }
    let bytes = &*text_of(bytes).map_err(|what| whole(what.to_owned()))?;
    let mut pieces = parse_pieces(bytes, reading)?;
    let libraries: Vec<_> =
        pieces.iter_mut().flat_map(|piece| std::mem::take(&mut piece.libraries)).collect();
    let keeps_uvs = reading.uvs && wants_uvs(&libraries);
    let keeps_normals = reading.normals;
    let mut positions = Vec::with_capacity(pieces.iter().map(|piece| piece.positions.len()).sum());
    let (mut coordinates, mut normals) = (Vec::new(), Vec::new());
    let mut colours: Vec<[f32; 3]> = Vec::new();
    for piece in &mut pieces {
        if reading.colours && !piece.colours.is_empty() {
            colours.resize(positions.len(), COLOURLESS);
            colours.append(&mut piece.colours);
        }
        positions.append(&mut piece.positions);
        coordinates.append(&mut piece.coordinates);
        normals.append(&mut piece.normals);
    }
    let mut vertices = Vertices { first: vec![[NONE; 3]; positions.len()], ..Vertices::default() };
    let mut report = MeshReport::default();
    let mut parts: Vec<ObjPart> = Vec::new();
    let mut numbers_of_parts: HashMap<String, usize> = HashMap::new();
    let mut current = None;
    let mut numbers = Vec::new();
    for piece in pieces {
        report.other_elements += piece.other_elements;
        report.non_finite_line = report.non_finite_line.or(piece.non_finite_line);
        let mut materials = piece.materials.into_iter().peekable();
        let mut start = 0;
        // One more iteration, for statements after the last face.
        for face in 0..=piece.ends.len() {
            while let Some((_, name)) = materials.next_if(|(before, _)| *before == face) {
                let next = parts.len();
                let part = *numbers_of_parts.entry(name.clone()).or_insert(next);
                if part == next {
                    parts.push(ObjPart { material: Some(name), ..ObjPart::default() });
                }
                current = Some(part);
            }
            let Some(&end) = piece.ends.get(face) else { break };
            numbers.clear();
            let mut is_mapped = true;
            for &[position, coordinate, normal] in &piece.corners[start as usize..end as usize] {
                let coordinate = if keeps_uvs { coordinate } else { NONE };
                is_mapped &= coordinate != NONE;
                let normal = if keeps_normals { normal } else { NONE };
                numbers.push(vertices.number([position, coordinate, normal])?);
            }
            start = end;
            report.short_faces += u64::from(numbers.len() < 3);
            let part = *current.get_or_insert_with(|| {
                parts.push(ObjPart::default());
                parts.len() - 1
            });
            let part = &mut parts[part];
            part.faces += 1;
            part.unmapped_faces += u64::from(keeps_uvs && !is_mapped);
            let place = |vertex: u32| positions[vertices.all[vertex as usize][0] as usize];
            let is_sound = triangulate_polygon(&numbers, place, &mut part.triangles);
            report.crossed_polygons += u64::from(!is_sound);
        }
    }
    let has_no_faces = parts.iter().all(|part| part.faces == 0) && !positions.is_empty();
    let Vertices { all, first, others } = vertices;
    drop((first, others));
    let of_all = |named: usize| all.iter().any(|vertex| vertex[named] != NONE);
    let uvs = of_all(1).then(|| {
        let of = |vertex: &Corner| coordinates.get(vertex[1] as usize).copied().unwrap_or(Vec2::ZERO);
        all.iter().map(of).collect::<Vec<Vec2>>()
    });
    let normals = of_all(2).then(|| {
        let of = |vertex: &Corner| normals.get(vertex[2] as usize).copied().unwrap_or(Vec3::ZERO);
        all.iter().map(of).collect::<Vec<Vec3>>()
    });
    if let Some(normals) = &normals {
        let named = all.iter().zip(normals).filter(|(vertex, _)| vertex[2] != NONE);
        report.unusable_normals = named.filter(|(_, normal)| **normal == Vec3::ZERO).count() as u64;
    }
    let colours = (!colours.is_empty()).then(|| {
        let of = |vertex: &Corner| colours.get(vertex[0] as usize).copied().unwrap_or(COLOURLESS);
        reflectances(all.iter().map(of).collect(), 1.0, &mut report)
    });
    let places = all.iter().map(|vertex| positions[vertex[0] as usize].to_array());
    let positions = Positions::Double(places.collect());
    for part in &mut parts {
        drop_unusable(&mut part.triangles, &positions, &mut report);
    }
    if has_no_faces {
        report.cloud = Some(Cloud::Lines);
    }
    Ok(ObjFile { positions, normals, uvs, colours, parts, libraries, report })
}

/// The text after the keyword.
fn rest<'a>(text: &'a [u8], keyword: &[u8]) -> &'a [u8] {
    text.get(keyword.len()..).unwrap_or_default().trim_ascii()
}

#[cfg(test)]
mod tests;
