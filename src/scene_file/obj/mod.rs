//! OBJ meshes (Wavefront 1992): `v`, `vn`, `f` with indices that count from the start or back from the line, `usemtl` and
//! `mtllib`. Polygons become fans of triangles (see [`super::mesh::triangulate_polygon`] for concave ones). Lines, points,
//! curves and smoothing groups are not read; what is no triangle is counted.
//!
//! Own, as the crates on offer tell no line of what is wrong. What a file declares by its indices is checked against what it
//! has given before; memory stays below 64 times its length.

mod mtl;

pub use mtl::{MtlFinish, MtlMaterial, parse_mtl_bytes, read_mtl};

use super::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable, triangulate_polygon};
use super::mesh_file::{
    Failure, MeshFileError, MeshPlace, MeshReading, in_file, number, read_bytes, shown, words,
};
use crate::math::unit;
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Lines from one word of progress to the next.
const TOLD: usize = 1 << 15;

/// The faces of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjPart {
    /// Name of the material; `None` for faces before any `usemtl`.
    pub material: Option<String>,
    /// Corners: numbers of [`ObjFile`]'s vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// An OBJ file as it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjFile {
    /// Positions of the vertices of all parts.
    pub positions: Positions,
    /// Unit normals of them, where a face names some; zero where it does not or they are of no use.
    pub normals: Option<Vec<Vec3>>,
    /// By material, in the order of the file.
    pub parts: Vec<ObjPart>,
    /// Files of materials, relative to the OBJ's folder, and the lines that name them.
    pub libraries: Vec<(PathBuf, usize)>,
    /// What was left out.
    pub report: MeshReport,
}

/// Reads an OBJ file; the files of its materials are not opened.
///
/// # Errors
/// With the file, the line, what is wrong and what to do.
pub fn read_obj(path: &Path) -> Result<ObjFile, MeshFileError> {
    read_obj_with(path, &MeshReading::ALL)
}

/// [`read_obj`], followed by somebody who may stop it.
pub(super) fn read_obj_with(path: &Path, reading: &MeshReading<'_>) -> Result<ObjFile, MeshFileError> {
    parse_obj(&read_bytes(path)?, reading).map_err(|failure| in_file(path, failure))
}

/// Parses the bytes of an OBJ file; `path` is only for messages.
///
/// # Errors
/// As [`read_obj`].
pub fn parse_obj_bytes(bytes: &[u8], path: &Path) -> Result<ObjFile, MeshFileError> {
    parse_obj(bytes, &MeshReading::ALL).map_err(|failure| in_file(path, failure))
}

/// The files of materials that an OBJ names; none for other files.
///
/// # Errors
/// Where it cannot be read.
pub fn material_files(path: &Path) -> std::io::Result<Vec<PathBuf>> {
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj")) {
        return Ok(Vec::new());
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let bytes = std::fs::read(path)?;
    let lines = bytes.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let names = lines.filter(|line| words(line).next() == Some(b"mtllib"));
    Ok(names.map(|line| folder.join(&*String::from_utf8_lossy(rest(line, b"mtllib")))).collect())
}

impl ObjFile {
    /// All parts as one mesh.
    pub fn into_mesh(self) -> (TriangleMesh, MeshReport) {
        let triangles = self.parts.into_iter().flat_map(|part| part.triangles).collect();
        let mesh = TriangleMesh { positions: self.positions, triangles, normals: self.normals, uvs: None };
        (mesh, self.report)
    }

    /// Each part as a mesh of the vertices that it uses.
    pub fn into_meshes(self) -> Vec<(Option<String>, TriangleMesh)> {
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
            used.iter().for_each(|&vertex| numbers[vertex as usize] = u32::MAX);
            let positions = Positions::Double(positions);
            meshes.push((
                part.material,
                TriangleMesh { positions, triangles: part.triangles, normals, uvs: None },
            ));
        }
        meshes
    }
}

/// What has been read so far.
#[derive(Default)]
struct Reader {
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    /// Number of `vt` lines.
    coordinates: usize,
    /// Vertices of the mesh: a position, and a normal or `u32::MAX`.
    vertices: Vec<(u32, u32)>,
    /// Vertex of each position whose corner names no normal, or `u32::MAX`: most files need no other table.
    plain: Vec<u32>,
    /// Vertex of each position and normal that are named together.
    numbers: HashMap<(u32, u32), u32>,
    parts: Vec<ObjPart>,
    part_numbers: HashMap<String, usize>,
    current: Option<usize>,
    libraries: Vec<(PathBuf, usize)>,
    report: MeshReport,
    corners: Vec<u32>,
}

/// Parses the bytes of an OBJ file.
pub(super) fn parse_obj(bytes: &[u8], reading: &MeshReading<'_>) -> Result<ObjFile, Failure> {
    let mut reader = Reader::default();
    let mut joined = Vec::new();
    let mut at = 0;
    for (index, text) in bytes.split(|&byte| byte == b'\n').enumerate() {
        if index % TOLD == 0 {
            reading.reached(at, bytes)?;
        }
        at += text.len() + 1;
        let text = text.trim_ascii();
        // A line that ends in a backslash goes on in the next one.
        if let Some(start) = text.strip_suffix(b"\\") {
            joined.extend_from_slice(start);
            joined.push(b' ');
            continue;
        }
        if joined.is_empty() {
            reader.line(text, index + 1)?;
        } else {
            joined.extend_from_slice(text);
            reader.line(&joined, index + 1)?;
            joined.clear();
        }
    }
    reader.line(&joined, bytes.split(|&byte| byte == b'\n').count())?;
    Ok(reader.finish())
}

impl Reader {
    fn line(&mut self, text: &[u8], line: usize) -> Result<(), Failure> {
        let mut parts = words(text);
        let Some(keyword) = parts.next() else { return Ok(()) };
        match keyword {
            b"v" => {
                let mut position = [0.0; 3];
                for (value, axis) in position.iter_mut().zip(["x", "y", "z"]) {
                    *value = number(parts.next(), line, &format!("{axis} of the vertex"))?;
                }
                self.positions.push(DVec3::from_array(position));
            }
            b"vn" => {
                let mut normal = [0.0; 3];
                for (value, axis) in normal.iter_mut().zip(["x", "y", "z"]) {
                    *value = number(parts.next(), line, &format!("{axis} of the normal"))? as f32;
                }
                self.normals.push(unit(Vec3::from_array(normal)).unwrap_or(Vec3::ZERO));
            }
            b"vt" => self.coordinates += 1,
            b"f" => self.face(parts, line)?,
            b"l" | b"p" | b"curv" | b"curv2" | b"surf" => self.report.other_elements += 1,
            b"usemtl" => {
                let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
                let next = self.parts.len();
                let part = *self.part_numbers.entry(name.clone()).or_insert(next);
                if part == next {
                    self.parts.push(ObjPart { material: Some(name), triangles: Vec::new() });
                }
                self.current = Some(part);
            }
            b"mtllib" => {
                let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
                self.libraries.push((PathBuf::from(name), line));
            }
            // Names, groups, smoothing, comments, and what a mesh does not need.
            _ => {}
        }
        Ok(())
    }

    fn face<'a>(&mut self, corners: impl Iterator<Item = &'a [u8]>, line: usize) -> Result<(), Failure> {
        let mut numbers = std::mem::take(&mut self.corners);
        numbers.clear();
        for corner in corners {
            // A comment at the end of the line.
            if corner.starts_with(b"#") {
                break;
            }
            numbers.push(self.corner(corner, line)?);
        }
        self.report.short_faces += u64::from(numbers.len() < 3);
        let part = match self.current {
            Some(part) => part,
            None => {
                self.parts.push(ObjPart::default());
                *self.current.insert(self.parts.len() - 1)
            }
        };
        triangulate_polygon(&numbers, &mut self.parts[part].triangles);
        self.corners = numbers;
        Ok(())
    }

    /// `position`, `position/coordinate`, `position//normal` or `position/coordinate/normal`.
    fn corner(&mut self, text: &[u8], line: usize) -> Result<u32, Failure> {
        let mut parts = text.split(|&byte| byte == b'/');
        let position = index(parts.next().unwrap_or_default(), self.positions.len(), "vertices", line)?;
        if let Some(part) = parts.next().filter(|part| !part.is_empty()) {
            index(part, self.coordinates, "texture coordinates", line)?;
        }
        let normal = match parts.next().filter(|part| !part.is_empty()) {
            Some(part) => index(part, self.normals.len(), "normals", line)?,
            None => u32::MAX,
        };
        let next = self.vertices.len() as u32;
        let known = if normal == u32::MAX {
            self.plain.resize(self.positions.len(), u32::MAX);
            &mut self.plain[position as usize]
        } else {
            self.numbers.entry((position, normal)).or_insert(u32::MAX)
        };
        if *known == u32::MAX {
            self.vertices.push((position, normal));
            *known = next;
        }
        let number = *known;
        if number == u32::MAX {
            return Err((
                MeshPlace::Line(line),
                "more corners than 32 bits can count; split the mesh".to_owned(),
            ));
        }
        Ok(number)
    }

    fn finish(self) -> ObjFile {
        let Self { positions, normals, vertices, mut parts, libraries, mut report, numbers, plain, .. } =
            self;
        drop((numbers, plain));
        let has_normals = vertices.iter().any(|&(_, normal)| normal != u32::MAX);
        let normals = has_normals.then(|| {
            let of = |&(_, normal): &(u32, u32)| normals.get(normal as usize).copied().unwrap_or(Vec3::ZERO);
            vertices.iter().map(of).collect::<Vec<Vec3>>()
        });
        if let Some(normals) = &normals {
            let named = vertices.iter().zip(normals).filter(|(vertex, _)| vertex.1 != u32::MAX);
            report.unusable_normals = named.filter(|(_, normal)| **normal == Vec3::ZERO).count() as u64;
        }
        let places = vertices.iter().map(|&(position, _)| positions[position as usize].to_array());
        let positions = Positions::Double(places.collect());
        for part in &mut parts {
            drop_unusable(&mut part.triangles, &positions, &mut report);
        }
        ObjFile { positions, normals, parts, libraries, report }
    }
}

/// What follows the keyword.
fn rest<'a>(text: &'a [u8], keyword: &[u8]) -> &'a [u8] {
    text.get(keyword.len()..).unwrap_or_default().trim_ascii()
}

/// An index of one of `count` things, from 0: the file counts from 1, or back from the last with negative numbers.
fn index(text: &[u8], count: usize, things: &str, line: usize) -> Result<u32, Failure> {
    let fail = |problem: String| Err((MeshPlace::Line(line), problem));
    let Some(number) = std::str::from_utf8(text).ok().and_then(|text| text.parse::<i64>().ok()) else {
        let shown = shown(text);
        return fail(format!("`{shown}` is not a number of a corner; mend the line or write the file again"));
    };
    let from_start = if number < 0 { count as i64 + number } else { number - 1 };
    match u32::try_from(from_start).ok().filter(|&at| (at as usize) < count && at < u32::MAX) {
        Some(at) => Ok(at),
        None => fail(format!(
            "{number} is not one of the {count} {things} before this line, counted from 1, or back from -1; write the \
             mesh again"
        )),
    }
}

#[cfg(test)]
mod tests;
