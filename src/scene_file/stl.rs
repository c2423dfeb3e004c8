//! STL meshes (3D Systems 1988), ascii and binary. Corners at the same place become one vertex. Normals of the file are not
//! read: they are those of the triangles, as far as they are right.
//!
//! A binary file says how many triangles it has, which is compared with its length before memory is taken; memory stays
//! below 16 times that length.

use super::keyed::Keyed;
use super::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable, triangulate_polygon};
use super::mesh_file::{
    Failure, MeshFileError, MeshPlace, MeshReading, in_file, number, read_bytes, shown, words,
};
use std::collections::HashMap;
use std::path::Path;

/// Text, and the number of triangles.
const HEADER: usize = 84;

/// A normal, three corners, two bytes of attributes.
const RECORD: usize = 50;

/// Triangles, or lines, from one word of progress to the next.
const TOLD: usize = 1 << 15;

/// Reads an STL file.
///
/// # Errors
/// With the file, the line where it is ascii, what is wrong and what to do.
pub fn read_stl(path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    read_stl_with(path, &MeshReading::ALL)
}

/// [`read_stl`], followed by somebody who may stop it.
pub(super) fn read_stl_with(
    path: &Path,
    reading: &MeshReading<'_>,
) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    parse_stl(&read_bytes(path)?, reading).map_err(|failure| in_file(path, failure))
}

/// Parses the bytes of an STL file; `path` is only for messages.
///
/// # Errors
/// As [`read_stl`].
pub fn parse_stl_bytes(bytes: &[u8], path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    parse_stl(bytes, &MeshReading::ALL).map_err(|failure| in_file(path, failure))
}

/// Vertices by the bits of their place.
#[derive(Default)]
struct Vertices {
    positions: Vec<[f32; 3]>,
    numbers: HashMap<(u64, u32), u32, Keyed>,
}

impl Vertices {
    fn add(&mut self, position: [f32; 3]) -> Result<u32, Failure> {
        // Both zeros are one place.
        let [x, y, z] = position.map(|x| (x + 0.0).to_bits());
        let key = (u64::from(x) << 32 | u64::from(y), z);
        if let Some(&number) = self.numbers.get(&key) {
            return Ok(number);
        }
        let number = u32::try_from(self.positions.len()).ok().filter(|&number| number < u32::MAX - 1);
        let too_many =
            || (MeshPlace::File, "more vertices than 32 bits can count; split the mesh".to_owned());
        let number = number.ok_or_else(too_many)?;
        self.positions.push(position);
        self.numbers.insert(key, number);
        Ok(number)
    }
}

/// Parses the bytes of an STL file.
pub(super) fn parse_stl(
    bytes: &[u8],
    reading: &MeshReading<'_>,
) -> Result<(TriangleMesh, MeshReport), Failure> {
    let mut vertices = Vertices::default();
    let mut triangles = Vec::new();
    let mut report = MeshReport::default();
    if is_ascii(bytes) {
        read_ascii(bytes, reading, &mut vertices, &mut triangles, &mut report)?;
    } else {
        read_binary(bytes, reading, &mut vertices, &mut triangles, &mut report)?;
    }
    let positions = Positions::Single(vertices.positions);
    drop_unusable(&mut triangles, &positions, &mut report);
    Ok((TriangleMesh { positions, triangles, normals: None, uvs: None }, report))
}

/// Number of triangles that a binary file declares.
fn declared(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().ok()?)))
}

/// Binary files may begin with `solid` too: the length tells.
fn is_ascii(bytes: &[u8]) -> bool {
    let fits =
        declared(bytes).is_some_and(|count| HEADER as u64 + RECORD as u64 * count == bytes.len() as u64);
    let start = bytes.trim_ascii_start();
    let is_solid = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    is_solid && !fits && !bytes.iter().take(1024).any(|&byte| byte == 0)
}

fn read_binary(
    bytes: &[u8],
    reading: &MeshReading<'_>,
    vertices: &mut Vertices,
    triangles: &mut Vec<[u32; 3]>,
    report: &mut MeshReport,
) -> Result<(), Failure> {
    let fail = |problem| Err((MeshPlace::File, problem));
    let Some(count) = declared(bytes) else {
        return fail(format!(
            "not an STL file: it has {} bytes, begins with no line `solid`, and a binary file has at least {HEADER}; \
             write or copy it again",
            bytes.len()
        ));
    };
    let needed = HEADER as u64 + RECORD as u64 * count;
    let missing = needed.saturating_sub(bytes.len() as u64);
    if missing > 0 {
        return fail(format!(
            "{count} triangles are declared, but the file ends: exactly {missing} bytes are missing; the file is \
             incomplete or no STL file, write or copy it again"
        ));
    }
    report.trailing_bytes = bytes.len() as u64 - needed;
    triangles.reserve_exact(count as usize);
    for (index, record) in bytes[HEADER..needed as usize].chunks_exact(RECORD).enumerate() {
        if index % TOLD == 0 {
            reading.reached(HEADER + index * RECORD, bytes)?;
        }
        let float =
            |at: usize| f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
        let corner = |number: usize| [0, 4, 8].map(|at| float(12 + 12 * number + at));
        triangles.push([vertices.add(corner(0))?, vertices.add(corner(1))?, vertices.add(corner(2))?]);
    }
    Ok(())
}

fn read_ascii(
    bytes: &[u8],
    reading: &MeshReading<'_>,
    vertices: &mut Vertices,
    triangles: &mut Vec<[u32; 3]>,
    report: &mut MeshReport,
) -> Result<(), Failure> {
    let mut is_open = false;
    let mut corners: Vec<u32> = Vec::new();
    let mut last = 0;
    let mut at = 0;
    for (index, text) in bytes.split(|&byte| byte == b'\n').enumerate() {
        if index % TOLD == 0 {
            reading.reached(at, bytes)?;
        }
        at += text.len() + 1;
        let line = index + 1;
        let mut parts = words(text);
        let Some(first) = parts.next() else { continue };
        last = line;
        match first.to_ascii_lowercase().as_slice() {
            b"solid" => is_open = true,
            b"endsolid" => is_open = false,
            b"facet" | b"endfacet" => {}
            b"outer" => corners.clear(),
            b"vertex" => {
                let mut position = [0.0; 3];
                for (value, axis) in position.iter_mut().zip(["x", "y", "z"]) {
                    *value = number(parts.next(), line, &format!("{axis} of the vertex"))? as f32;
                }
                corners.push(vertices.add(position)?);
            }
            b"endloop" => {
                report.short_faces += u64::from(corners.len() < 3);
                triangulate_polygon(&corners, triangles);
                corners.clear();
            }
            _ => {
                let problem = format!(
                    "`{}` begins no line of an STL file; mend the line or write the file again",
                    shown(first)
                );
                return Err((MeshPlace::Line(line), problem));
            }
        }
    }
    if is_open {
        let problem = "the file ends without a line `endsolid`; it is incomplete, write or copy it again";
        return Err((MeshPlace::Line(last), problem.to_owned()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Result<(TriangleMesh, MeshReport), Failure> {
        parse_stl(bytes, &MeshReading::ALL)
    }

    /// A tetrahedron, its triangles by their corners.
    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    fn binary() -> Vec<u8> {
        // Begins as ascii files do, which many programs write.
        let mut bytes = b"solid binary".to_vec();
        bytes.resize(80, b' ');
        bytes.extend((FACES.len() as u32).to_le_bytes());
        for face in FACES {
            bytes.extend([0u8; 12]);
            face.iter().flat_map(|&v| CORNERS[v]).for_each(|x| bytes.extend(x.to_le_bytes()));
            bytes.extend([0u8; 2]);
        }
        bytes
    }

    fn ascii() -> String {
        let mut text = "solid thing\n".to_owned();
        for face in FACES {
            text += " facet normal 0 0 0\n  outer loop\n";
            for [x, y, z] in face.map(|v| CORNERS[v]) {
                text += &format!("   vertex {x:e} {y} {z}\n");
            }
            text += "  endloop\n endfacet\n";
        }
        text + "endsolid thing\n"
    }

    #[test]
    fn both_forms_share_corners() {
        for bytes in
            [binary(), ascii().into_bytes(), ascii().replace('\n', "\r\n").to_uppercase().into_bytes()]
        {
            let (mesh, report) = parse(&bytes).unwrap();
            assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 4));
            assert_eq!(report, MeshReport::default());
            assert_eq!(mesh.positions.corners(mesh.triangles[0])[1].to_array(), [0.0, 1.0, 0.0]);
        }
    }

    #[test]
    fn cut_files_are_told() {
        for bytes in [binary(), ascii().into_bytes()] {
            for sixteenth in 0..16 {
                let cut = &bytes[..bytes.len() * sixteenth / 16];
                let (_, problem) = parse(cut).unwrap_err();
                assert!(problem.contains("again"), "{sixteenth}: {problem}");
            }
        }
        let (_, report) = parse(&[binary(), vec![1, 2, 3]].concat()).unwrap();
        assert_eq!(report.trailing_bytes, 3);
        let (place, problem) = parse(
            ascii().replace("outer loop\n   vertex 0e0 0 0", "outer loop\n   vertex 0e0 x 0").as_bytes(),
        )
        .unwrap_err();
        assert_eq!(place, MeshPlace::Line(4));
        assert!(problem.contains("`x`") && problem.contains("y of the vertex"), "{problem}");
        // Four billion triangles in a hundred bytes.
        let mut bytes = vec![0; 100];
        bytes[80..84].fill(0xff);
        assert!(parse(&bytes).unwrap_err().1.contains("missing"));
        assert!(parse(b"solid Empty\nendsolid Empty").unwrap().0.triangles.is_empty());
    }
}
