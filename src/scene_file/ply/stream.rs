//! Reader for large binary files, piece by piece on all threads. Each number goes straight to its place, and the file as a whole
//! is never in memory.
//!
//! It handles only what nearly all large files are: records of one length, faces that all have as many corners as the first face,
//! and no errors. Otherwise the file is read as a whole by [`super::binary`], which can report the problem and its place. Pieces
//! are read with `pread` and not mapped, so that a file truncated during reading causes an error and does not end the process.

use super::binary::{FixedFaces, FixedVertices, read_integer};
use super::header::{ByteOrder, Encoding, Header};
use super::layout::{Contents, FaceColumns, Role, Roles, VertexColumns, Vertices};
use crate::scene_file::mesh::Positions;
use crate::scene_file::mesh_file::MeshReading;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicU64, Ordering};

/// A file with a longer header is read as a whole.
const LONGEST_HEADER: u64 = 1 << 16;

/// Bytes of a piece, which stays in a processor's cache until it is converted.
const PIECE: usize = 1 << 18;

/// Reads the bodies of all elements. `None` where the file does not qualify, or the reading was stopped.
pub(super) fn read(
    file: &File,
    length: u64,
    reading: &MeshReading<'_>,
    looks: bool,
) -> Option<(Contents, Header, Roles, u64)> {
    let mut start = vec![0; length.min(LONGEST_HEADER) as usize];
    file.read_exact_at(&mut start, 0).ok()?;
    let header = Header::parse(&start).ok()?;
    let Encoding::Binary(order) = header.encoding else { return None };
    let roles = Roles::of(&header, looks).ok()?;
    let mut contents = Contents::default();
    let mut at = header.length as u64;
    let input = Input { file, length, reading, done: AtomicU64::new(0) };
    for (element, role) in header.elements.iter().zip(&roles.roles) {
        if element.count == 0 {
            continue;
        }
        let count = usize::try_from(element.count).ok()?;
        let stride = match *role {
            Role::Strips(_) => return None,
            Role::Faces(columns) if columns.has_look() => return None,
            Role::Faces(FaceColumns { corners: list, .. }) => {
                let mut first = vec![0; input.left(at).min(LONGEST_HEADER) as usize];
                file.read_exact_at(&mut first, at).ok()?;
                let faces = FixedFaces::of(element, list, &first, order)?;
                let records = input.records(at, count, faces.stride)?;
                contents.triangles = read_faces(&records, &faces, order, roles.vertex_count)?;
                contents.equal_polygons = Some((faces.corners - 2, contents.triangles.len()));
                faces.stride
            }
            Role::Vertices(columns) => {
                let layout = FixedVertices::of(element, order)?;
                let records = input.records(at, count, layout.stride)?;
                contents.vertices = read_vertices(&records, &columns, &layout, reading)?;
                layout.stride
            }
            Role::Skipped if element.has_lists() => return None,
            Role::Skipped => input.records(at, count, element.shortest_record())?.stride,
        };
        at += (count * stride) as u64;
    }
    Some((contents, header, roles, length - at))
}

struct Input<'a> {
    file: &'a File,
    length: u64,
    reading: &'a MeshReading<'a>,
    /// Bytes read so far.
    done: AtomicU64,
}

/// Records of one length, all of which are in the file.
struct Records<'a> {
    input: &'a Input<'a>,
    start: u64,
    count: usize,
    stride: usize,
}

impl Input<'_> {
    fn left(&self, at: u64) -> u64 {
        self.length.saturating_sub(at)
    }

    /// `None` where the file ends before the last record.
    fn records(&self, start: u64, count: usize, stride: usize) -> Option<Records<'_>> {
        let bytes = (count as u64).checked_mul(stride as u64)?;
        (bytes <= self.left(start)).then_some(Records { input: self, start, count, stride })
    }
}

impl Records<'_> {
    /// Converts every record to `per_record` items. `None` where `turn` refuses a record, or reading fails or is stopped.
    fn turn<T: Copy + Send>(
        &self,
        blank: T,
        per_record: usize,
        turn: impl Fn(&[u8], &mut [T]) -> bool + Sync,
    ) -> Option<Vec<T>> {
        let length = self.count.checked_mul(per_record)?;
        // One more item, for the padding that Embree requires; otherwise the whole list would be copied again.
        let mut things = vec![blank; length + 1];
        things.truncate(length);
        let stride = self.stride;
        let at_once = (PIECE / stride).max(1);
        things.par_chunks_mut(at_once * per_record).enumerate().try_for_each_init(
            Vec::new,
            |buffer, (piece, things)| {
                let bytes = things.len() / per_record * stride;
                buffer.resize(bytes.max(buffer.len()), 0);
                let start = self.start + (piece * at_once * stride) as u64;
                self.input.file.read_exact_at(&mut buffer[..bytes], start).ok()?;
                let records = buffer[..bytes].chunks_exact(stride);
                let mut pairs = records.zip(things.chunks_exact_mut(per_record));
                let is_sound = pairs.all(|(record, things)| turn(record, things));
                let done = self.input.done.fetch_add(bytes as u64, Ordering::Relaxed) + bytes as u64;
                (is_sound && (self.input.reading.progress)(done, self.input.length)).then_some(())
            },
        )?;
        Some(things)
    }
}

fn read_vertices(
    records: &Records<'_>,
    columns: &VertexColumns,
    layout: &FixedVertices,
    reading: &MeshReading<'_>,
) -> Option<Vertices> {
    let single = |record: &[u8], column: usize| layout.value(record, column) as f32;
    let positions = if columns.is_double {
        let turn = |record: &[u8], out: &mut [[f64; 3]]| {
            out[0] = columns.position.map(|column| layout.value(record, column));
            true
        };
        Positions::Double(records.turn([0.0; 3], 1, turn)?)
    } else if let Some(at) = layout.three_floats(columns.position) {
        let turn = |record: &[u8], out: &mut [[f32; 3]]| {
            let float =
                |at: usize| f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
            out[0] = [float(at), float(at + 4), float(at + 8)];
            true
        };
        Positions::Single(records.turn([0.0; 3], 1, turn)?)
    } else {
        let turn = |record: &[u8], out: &mut [[f32; 3]]| {
            out[0] = columns.position.map(|column| single(record, column));
            true
        };
        Positions::Single(records.turn([0.0; 3], 1, turn)?)
    };
    let normals = columns.normal.filter(|_| reading.normals).map(|normal| {
        records.turn(Vec3::ZERO, 1, |record, out| {
            out[0] = Vec3::from_array(normal.map(|column| single(record, column)));
            true
        })
    });
    let uvs = columns.uv.filter(|_| reading.uvs).map(|uv| {
        records.turn(Vec2::ZERO, 1, |record, out| {
            out[0] = Vec2::from_array(uv.map(|column| single(record, column)));
            true
        })
    });
    let colours = columns.colour.map(|colour| {
        records.turn([0.0; 3], 1, |record, out| {
            out[0] = colour.read(|column| layout.value(record, column));
            true
        })
    });
    Some(Vertices { positions, normals: whole(normals)?, uvs: whole(uvs)?, colours: whole(colours)? })
}

/// `None` where reading a wanted part failed.
fn whole<T>(read: Option<Option<T>>) -> Option<Option<T>> {
    match read {
        None => Some(None),
        Some(read) => read.map(Some),
    }
}

fn read_faces(
    records: &Records<'_>,
    faces: &FixedFaces,
    order: ByteOrder,
    vertex_count: u64,
) -> Option<Vec<[u32; 3]>> {
    let corners = faces.corners;
    let fits = vertex_count <= i32::MAX as u64;
    if let Some(at) = faces.plain_triangles(order).filter(|_| fits) {
        // The usual case: a byte 3 and three integers of 32 bits.
        return records.turn([0; 3], 1, |record, out| {
            let corner =
                |at: usize| u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
            out[0] = [corner(at + 1), corner(at + 5), corner(at + 9)];
            record[at] == 3 && out[0].iter().all(|&corner| u64::from(corner) < vertex_count)
        });
    }
    let length = |record: &[u8]| read_integer(&record[faces.before..], faces.count, order);
    let corner = |record: &[u8], number: usize| {
        let offset = faces.before + faces.count.size() + number * faces.item.size();
        let corner = read_integer(&record[offset..], faces.item, order);
        (0..vertex_count as i64).contains(&corner).then_some(corner as u32)
    };
    records.turn([0; 3], corners - 2, |record, out| {
        if length(record) != corners as i64 {
            return false;
        }
        let (Some(first), Some(mut last)) = (corner(record, 0), corner(record, 1)) else { return false };
        // A fan, to be replaced later where the polygon is concave.
        out.iter_mut().enumerate().all(|(number, triangle)| match corner(record, number + 2) {
            Some(next) => {
                *triangle = [first, last, next];
                last = next;
                true
            }
            None => false,
        })
    })
}
