//! Meshes in Mitsuba's own format (versions 3 and 4): consecutive compressed streams, with a table of their offsets at the end.

use crate::files::read_regular;
use crate::scene_file::mesh::{MeshReport, Positions, TriangleMesh, drop_unusable};
use flate2::bufread::ZlibDecoder;
use glam::{Vec2, Vec3};
use std::io::{BufReader, Read};
use std::path::Path;

/// Magic number of a stream, which the version follows.
const MAGIC: u16 = 0x041C;

/// Flags of a stream.
const HAS_NORMALS: u32 = 0x1;
const HAS_UVS: u32 = 0x2;
const HAS_COLOURS: u32 = 0x8;
const HAS_DOUBLES: u32 = 0x2000;

/// Most vertices or triangles of a mesh.
const MOST: u64 = u32::MAX as u64 - 1;

/// Longest name of a mesh, in bytes.
const LONGEST_NAME: usize = 1 << 16;

/// Reads mesh number `shape` of a file.
///
/// # Errors
/// With the file, the problem, and what to do.
pub(super) fn read(path: &Path, shape: i64) -> Result<TriangleMesh, String> {
    let bytes = read_regular(path, u64::MAX)
        .map_err(|error| format!("{}: {error}; check its name", path.display()))?;
    parse(&bytes, shape).map_err(|problem| format!("{}: {problem}", path.display()))
}

/// Reads mesh number `shape` of the bytes of a file.
pub(super) fn parse(bytes: &[u8], shape: i64) -> Result<TriangleMesh, String> {
    let damaged = || "the file is damaged or cut short; export it again".to_owned();
    let at = |start: usize, count: usize| {
        start.checked_add(count).and_then(|end| bytes.get(start..end)).ok_or_else(damaged)
    };
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |number, byte| number << 8 | u64::from(*byte));
    if number(at(0, 2)?) != u64::from(MAGIC) {
        return Err("no file of serialized meshes; export the mesh as PLY".to_owned());
    }
    let version = number(at(2, 2)?);
    let width = match version {
        3 => 4,
        4 => 8,
        _ => return Err(format!("version {version}, and 3 and 4 are read; export the mesh as PLY")),
    };
    let end = bytes.len().checked_sub(4).ok_or_else(damaged)?;
    let count = number(at(end, 4)?);
    let shape = match u64::try_from(shape) {
        Ok(shape) if shape < count.max(1) => shape,
        _ => return Err(format!("there is no mesh {shape}; the file has {count}, from 0")),
    };
    let start = if shape == 0 {
        0
    } else {
        let entries = usize::try_from(count - shape).ok().and_then(|left| left.checked_mul(width));
        let entry = entries.and_then(|entries| end.checked_sub(entries)).ok_or_else(damaged)?;
        usize::try_from(number(at(entry, width)?)).map_err(|_| damaged())?
    };
    let header = at(start, 4)?;
    if number(&header[..2]) != u64::from(MAGIC) {
        return Err(damaged());
    }
    let stream = bytes.get(start + 4..).ok_or_else(damaged)?;
    let mut stream = Stream { inner: BufReader::new(ZlibDecoder::new(stream)) };
    mesh(&mut stream, version).ok_or_else(damaged)
}

/// Numbers from the decompressed stream.
struct Stream<R> {
    inner: R,
}

impl<R: Read> Stream<R> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        self.inner.read_exact(&mut bytes).ok().map(|()| bytes)
    }

    fn number(&mut self, is_double: bool) -> Option<f64> {
        if is_double {
            self.bytes().map(f64::from_le_bytes)
        } else {
            self.bytes().map(f32::from_le_bytes).map(f64::from)
        }
    }

    /// Reads `count` groups of numbers. Memory grows with the data that are present, whatever the count.
    fn groups<const N: usize>(&mut self, count: u64, is_double: bool) -> Option<Vec<[f64; N]>> {
        let mut groups = Vec::new();
        for _ in 0..count {
            let mut group = [0.0; N];
            for number in &mut group {
                *number = self.number(is_double)?;
            }
            groups.push(group);
        }
        Some(groups)
    }
}

/// Reads a mesh. `None` where the stream ends early, or an index exceeds the vertices.
fn mesh<R: Read>(stream: &mut Stream<R>, version: u64) -> Option<TriangleMesh> {
    let flags = u32::from_le_bytes(stream.bytes()?);
    if version >= 4 {
        let mut length = 0;
        while stream.bytes::<1>()? != [0] {
            length += 1;
            if length > LONGEST_NAME {
                return None;
            }
        }
    }
    let vertices = u64::from_le_bytes(stream.bytes()?);
    let faces = u64::from_le_bytes(stream.bytes()?);
    if vertices > MOST || faces > MOST {
        return None;
    }
    let is_double = flags & HAS_DOUBLES != 0;
    let positions = stream.groups::<3>(vertices, is_double)?;
    let normals =
        if flags & HAS_NORMALS != 0 { Some(stream.groups::<3>(vertices, is_double)?) } else { None };
    let uvs = if flags & HAS_UVS != 0 { Some(stream.groups::<2>(vertices, is_double)?) } else { None };
    if flags & HAS_COLOURS != 0 {
        stream.groups::<3>(vertices, is_double)?;
    }
    let mut triangles = Vec::new();
    for _ in 0..faces {
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            *corner = u32::from_le_bytes(stream.bytes()?);
            if u64::from(*corner) >= vertices {
                return None;
            }
        }
        triangles.push(triangle);
    }
    let positions = if is_double {
        Positions::Double(positions)
    } else {
        Positions::Single(positions.iter().map(|p| p.map(|x| x as f32)).collect())
    };
    drop_unusable(&mut triangles, &positions, &mut MeshReport::default());
    let unit = |n: &[f64; 3]| {
        crate::math::unit_f64(glam::DVec3::from_array(*n)).map_or(Vec3::ZERO, |normal| normal.as_vec3())
    };
    let normals = normals.map(|normals| normals.iter().map(unit).collect());
    let finite = |uv: &[f64; 2]| Some(Vec2::new(uv[0] as f32, uv[1] as f32)).filter(|uv| uv.is_finite());
    let uvs = uvs.map(|uvs| uvs.iter().map(|uv| finite(uv).unwrap_or(Vec2::ZERO)).collect());
    Some(TriangleMesh { positions, triangles, normals, uvs })
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::ZlibEncoder};
    use std::io::Write;

    /// A file with two meshes of one triangle each.
    fn sample(version: u16) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut starts = Vec::new();
        for z in [0.0f32, 5.0] {
            starts.push(bytes.len() as u64);
            bytes.extend(MAGIC.to_le_bytes());
            bytes.extend(version.to_le_bytes());
            let mut stream = (HAS_NORMALS | HAS_UVS | 0x1000).to_le_bytes().to_vec();
            if version >= 4 {
                stream.extend(b"a\0");
            }
            stream.extend(3u64.to_le_bytes());
            stream.extend(1u64.to_le_bytes());
            let numbers =
                [0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
            numbers
                .iter()
                .chain(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0])
                .for_each(|x: &f32| stream.extend(x.to_le_bytes()));
            [0u32, 1, 2].iter().for_each(|corner| stream.extend(corner.to_le_bytes()));
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(&stream).unwrap();
            bytes.extend(encoder.finish().unwrap());
        }
        for start in &starts {
            if version >= 4 {
                bytes.extend(start.to_le_bytes());
            } else {
                bytes.extend((*start as u32).to_le_bytes());
            }
        }
        bytes.extend(2u32.to_le_bytes());
        bytes
    }

    #[test]
    fn each_mesh_of_a_file_is_found() {
        for version in [3, 4] {
            let bytes = sample(version);
            for (shape, z) in [(0, 0.0), (1, 5.0)] {
                let mesh = parse(&bytes, shape).unwrap();
                assert_eq!(mesh.triangles, [[0, 1, 2]]);
                assert_eq!(mesh.positions.get(2), glam::DVec3::new(0.0, 1.0, z));
                assert_eq!(mesh.uvs.as_ref().unwrap()[1], Vec2::X);
            }
            for wrong in [2, -1] {
                assert!(parse(&bytes, wrong).unwrap_err().contains("no mesh"));
            }
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let bytes = sample(4);
        for length in 0..bytes.len() - 5 {
            // In a truncated file the end holds other numbers than the offsets.
            let _ = parse(&bytes[..length], 1);
        }
        let mut state = 3u64;
        for _ in 0..2000 {
            let mut damaged = bytes.clone();
            for _ in 0..2 {
                state = crate::sampling::mix(state);
                let at = state as usize % damaged.len();
                damaged[at] = (state >> 40) as u8;
            }
            for shape in [0, 1] {
                if let Ok(mesh) = parse(&damaged, shape) {
                    assert!(
                        mesh.triangles
                            .iter()
                            .flatten()
                            .all(|corner| (*corner as usize) < mesh.positions.len())
                    );
                }
            }
        }
    }
}
