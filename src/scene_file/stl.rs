//! STL meshes (3D Systems 1988), ascii and binary. Corners at the same position become one vertex. The normals of the file are
//! not read: where they are correct, they equal the face normals.
//!
//! A binary file declares its number of triangles. The reader compares it with the file's length before it allocates memory;
//! memory stays below 16 times that length. Corners are read and merged on all threads.

use super::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable};
use super::mesh_file::{
    Failure, MeshFileError, MeshPlace, MeshReading, in_file, number, read_bytes, shown, words,
};
use super::polygon::triangulate_polygon;
use super::weld::{Welded, weld};
use crate::files::{BYTE_ORDER_MARK, foreign_by_content, text_of};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes of the header: 80 bytes of text and the number of triangles.
const HEADER: usize = 84;

/// Bytes of a triangle: a normal, three corners, two bytes of attributes.
const RECORD: usize = 50;

/// Lines between two progress reports.
const TOLD: usize = 1 << 15;

/// Reads an STL file.
///
/// # Errors
/// With the file, the line where it is ascii, the problem, and what to do.
pub fn read_stl(path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    read_stl_with(path, &MeshReading::ALL)
}

/// [`read_stl`] with a progress callback that may stop it.
pub(super) fn read_stl_with(
    path: &Path,
    reading: &MeshReading<'_>,
) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    parse_stl(&read_bytes(path)?, reading).map_err(|failure| in_file(path, failure))
}

/// Parses the bytes of an STL file. Messages call it `path`.
///
/// # Errors
/// As [`read_stl`].
pub fn parse_stl_bytes(bytes: &[u8], path: &Path) -> Result<(TriangleMesh, MeshReport), MeshFileError> {
    parse_stl(bytes, &MeshReading::ALL).map_err(|failure| in_file(path, failure))
}

/// Parses the bytes of an STL file.
pub(super) fn parse_stl(
    bytes: &[u8],
    reading: &MeshReading<'_>,
) -> Result<(TriangleMesh, MeshReport), Failure> {
    let mut report = MeshReport::default();
    let (positions, mut triangles) = if is_ascii(bytes) {
        // The length of a binary file is known, whatever its first bytes are.
        let text = text_of(bytes).map_err(|what| (MeshPlace::File, what.to_owned()))?;
        read_ascii(&text, reading, &mut report)?
    } else {
        let is_named = !bytes.starts_with(b"solid");
        let foreign = foreign_by_content(Path::new(""), bytes).filter(|_| is_named);
        read_binary(bytes, reading, &mut report).map_err(|failure| match foreign {
            Some(foreign) => (MeshPlace::File, format!("no STL file: it {foreign}")),
            None => failure,
        })?
    };
    let positions = Positions::Single(positions);
    drop_unusable(&mut triangles, &positions, &mut report);
    Ok((TriangleMesh { positions, triangles, normals: None, uvs: None }, report))
}

/// Number of triangles that a binary file declares.
fn declared(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().ok()?)))
}

/// Whether a file is ascii. A binary file may begin with `solid` too, so the length decides.
fn is_ascii(bytes: &[u8]) -> bool {
    let fits =
        declared(bytes).is_some_and(|count| HEADER as u64 + RECORD as u64 * count == bytes.len() as u64);
    let start = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes).trim_ascii_start();
    let is_solid = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    is_solid && !fits && !bytes.iter().take(1024).any(|&byte| byte == 0)
}

/// Vertex positions and triangles.
type Contents = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Calls [`weld`] and reports its progress as a share of the file.
fn weld_corners(
    count: usize,
    corner: impl Fn(usize) -> [f32; 3] + Sync,
    bytes: &[u8],
    reading: &MeshReading<'_>,
) -> Result<Welded, Failure> {
    if count > u32::MAX as usize {
        return Err((
            MeshPlace::File,
            "more corners of triangles than 32 bits can count; split the mesh".to_owned(),
        ));
    }
    let done = AtomicUsize::new(0);
    weld(count, corner, |more| {
        let done = done.fetch_add(more, Ordering::Relaxed) + more;
        reading.reached((bytes.len() as f64 * done as f64 / (2 * count) as f64) as usize, bytes)
    })
}

fn read_binary(
    bytes: &[u8],
    reading: &MeshReading<'_>,
    report: &mut MeshReport,
) -> Result<Contents, Failure> {
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
    let records = &bytes[HEADER..needed as usize];
    let corner = |index: usize| {
        let at = index / 3 * RECORD + 12 + index % 3 * 12;
        [0, 4, 8].map(|axis| {
            let at = at + axis;
            f32::from_le_bytes([records[at], records[at + 1], records[at + 2], records[at + 3]])
        })
    };
    let welded = weld_corners(3 * count as usize, corner, bytes, reading)?;
    let triangles = welded.numbers.par_chunks_exact(3).map(|of| [of[0], of[1], of[2]]).collect();
    Ok((welded.positions, triangles))
}

fn read_ascii(bytes: &[u8], reading: &MeshReading<'_>, report: &mut MeshReport) -> Result<Contents, Failure> {
    let mut is_open = false;
    // Corners of all loops, and the range of each loop.
    let mut corners: Vec<[f32; 3]> = Vec::new();
    let mut loops: Vec<Range<usize>> = Vec::new();
    let mut start = 0;
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
            b"outer" => start = corners.len(),
            b"vertex" => {
                let mut position = [0.0; 3];
                for (value, axis) in position.iter_mut().zip(["x", "y", "z"]) {
                    *value = number(parts.next(), line, &format!("{axis} of the vertex"))? as f32;
                }
                corners.push(position);
            }
            b"endloop" => {
                loops.push(start..corners.len());
                start = corners.len();
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
    let welded = weld_corners(corners.len(), |index| corners[index], bytes, reading)?;
    let mut triangles = Vec::with_capacity(loops.len());
    for of in loops {
        report.short_faces += u64::from(of.len() < 3);
        let place = |vertex: u32| Vec3::from_array(welded.positions[vertex as usize]).as_dvec3();
        let is_sound = triangulate_polygon(&welded.numbers[of], place, &mut triangles);
        report.crossed_polygons += u64::from(!is_sound);
    }
    Ok((welded.positions, triangles))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Result<(TriangleMesh, MeshReport), Failure> {
        parse_stl(bytes, &MeshReading::ALL)
    }

    /// A tetrahedron as triangles with their corners.
    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    fn binary() -> Vec<u8> {
        // It begins like an ascii file, as the output of many programs does.
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
        // Declares four billion triangles in a hundred bytes.
        let mut bytes = vec![0; 100];
        bytes[80..84].fill(0xff);
        assert!(parse(&bytes).unwrap_err().1.contains("missing"));
        assert!(parse(b"solid Empty\nendsolid Empty").unwrap().0.triangles.is_empty());
    }
}
