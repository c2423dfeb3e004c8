//! Bodies of binary files.
//!
//! Vertices almost always have records of one length, and so do faces where all are triangles. Such records are read in parallel,
//! each at its own offset. All others are read one after the other.

use super::Failure;
use super::error::{PlyPlace, PlyProblem};
use super::header::{ByteOrder, Element, Header, PropertyType, ScalarType};
use super::layout::{
    Contents, FaceColumns, FaceLook, Role, Roles, VertexColumns, Vertices, Wedges, checked_corner,
};
use crate::scene_file::mesh::Positions;
use crate::scene_file::polygon::push_fan;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Reads all elements. Yields the number of bytes after them.
pub(super) fn read_body(
    bytes: &[u8],
    header: &Header,
    order: ByteOrder,
    roles: &Roles,
    contents: &mut Contents,
) -> Result<u64, Failure> {
    let mut at = header.length;
    for (element, role) in header.elements.iter().zip(&roles.roles) {
        let records = Records { bytes, start: at, element, order };
        records.check_length()?;
        at = match *role {
            _ if element.count == 0 => at,
            Role::Vertices(columns) => records.read_vertices(&columns, &mut contents.vertices)?,
            Role::Faces(columns) => records.read_faces(&columns, roles.vertex_count, contents)?,
            Role::Strips(list) => records.read_strips(list, roles.vertex_count, contents)?,
            Role::Skipped => records.walk(|_, _, _| Ok(()))?,
        };
    }
    Ok((bytes.len() - at) as u64)
}

/// The first `N` bytes.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&bytes[..N]);
    array
}

/// The number at the start of `bytes`; all types convert exactly to `f64`.
fn read_number(bytes: &[u8], scalar: ScalarType, order: ByteOrder) -> f64 {
    match (scalar, order) {
        (ScalarType::F32, ByteOrder::Little) => f64::from(f32::from_le_bytes(first(bytes))),
        (ScalarType::F32, ByteOrder::Big) => f64::from(f32::from_be_bytes(first(bytes))),
        (ScalarType::F64, ByteOrder::Little) => f64::from_le_bytes(first(bytes)),
        (ScalarType::F64, ByteOrder::Big) => f64::from_be_bytes(first(bytes)),
        _ => read_integer(bytes, scalar, order) as f64,
    }
}

/// The integer at the start of `bytes`; 0 for other types, which headers do not allow there.
pub(super) fn read_integer(bytes: &[u8], scalar: ScalarType, order: ByteOrder) -> i64 {
    match (scalar, order) {
        (ScalarType::U8, _) => i64::from(bytes[0]),
        (ScalarType::I8, _) => i64::from(i8::from_le_bytes(first(bytes))),
        (ScalarType::U16, ByteOrder::Little) => i64::from(u16::from_le_bytes(first(bytes))),
        (ScalarType::U16, ByteOrder::Big) => i64::from(u16::from_be_bytes(first(bytes))),
        (ScalarType::I16, ByteOrder::Little) => i64::from(i16::from_le_bytes(first(bytes))),
        (ScalarType::I16, ByteOrder::Big) => i64::from(i16::from_be_bytes(first(bytes))),
        (ScalarType::U32, ByteOrder::Little) => i64::from(u32::from_le_bytes(first(bytes))),
        (ScalarType::U32, ByteOrder::Big) => i64::from(u32::from_be_bytes(first(bytes))),
        (ScalarType::I32, ByteOrder::Little) => i64::from(i32::from_le_bytes(first(bytes))),
        (ScalarType::I32, ByteOrder::Big) => i64::from(i32::from_be_bytes(first(bytes))),
        (ScalarType::F32 | ScalarType::F64, _) => 0,
    }
}

/// The records of one element.
#[derive(Clone, Copy)]
struct Records<'a> {
    /// The whole file.
    bytes: &'a [u8],
    /// Offset of the first record.
    start: usize,
    element: &'a Element,
    order: ByteOrder,
}

/// A face element whose records all have the length of the first record.
#[derive(Clone, Copy)]
pub(super) struct FixedFaces {
    /// Bytes before the list, and of a whole record.
    pub(super) before: usize,
    pub(super) stride: usize,
    pub(super) corners: usize,
    pub(super) count: ScalarType,
    pub(super) item: ScalarType,
}

impl FixedFaces {
    /// The layout of the faces if all of them are like the first face, which is at the start of `bytes`.
    pub(super) fn of(element: &Element, list: usize, bytes: &[u8], order: ByteOrder) -> Option<Self> {
        let mut before = 0;
        let mut after = 0;
        for (column, property) in element.properties.iter().enumerate() {
            match property.kind {
                PropertyType::Scalar(scalar) if column < list => before += scalar.size(),
                PropertyType::Scalar(scalar) => after += scalar.size(),
                PropertyType::List(..) if column == list => {}
                PropertyType::List(..) => return None,
            }
        }
        let PropertyType::List(count, item) = element.properties.get(list)?.kind else { return None };
        let head = bytes.get(before..before + count.size())?;
        // Only few corners, so that the records cannot be much longer than the file; other faces are read one by one.
        let corners = usize::try_from(read_integer(head, count, order)).ok()?;
        if !(3..=255).contains(&corners) {
            return None;
        }
        let stride = before + count.size() + corners * item.size() + after;
        Some(Self { before, stride, corners, count, item })
    }

    /// Offset of the list in a record, where it consists of a byte and three little-endian integers of 32 bits. (Negative signed
    /// integers then exceed any number of vertices.)
    pub(super) fn plain_triangles(&self, order: ByteOrder) -> Option<usize> {
        let is_plain = self.corners == 3
            && order == ByteOrder::Little
            && self.count == ScalarType::U8
            && matches!(self.item, ScalarType::I32 | ScalarType::U32);
        is_plain.then_some(self.before)
    }
}

/// A vertex element without lists.
#[derive(Clone, Debug)]
pub(super) struct FixedVertices {
    /// Type of each property and its offset in a record.
    properties: Vec<(ScalarType, usize)>,
    pub(super) stride: usize,
    order: ByteOrder,
}

impl FixedVertices {
    /// `None` where there are lists.
    pub(super) fn of(element: &Element, order: ByteOrder) -> Option<Self> {
        let mut stride = 0;
        let mut properties = Vec::with_capacity(element.properties.len());
        for property in &element.properties {
            let PropertyType::Scalar(scalar) = property.kind else { return None };
            properties.push((scalar, stride));
            stride += scalar.size();
        }
        Some(Self { properties, stride, order })
    }

    /// The number in a column of a record.
    pub(super) fn value(&self, record: &[u8], column: usize) -> f64 {
        let (scalar, offset) = self.properties[column];
        read_number(&record[offset..], scalar, self.order)
    }

    /// Offset of three columns, where they are adjacent little-endian floats.
    pub(super) fn three_floats(&self, columns: [usize; 3]) -> Option<usize> {
        let [x, y, z] = columns.map(|column| self.properties[column]);
        let is_float = [x, y, z].iter().all(|(scalar, _)| *scalar == ScalarType::F32);
        let are_close = y.1 == x.1 + 4 && z.1 == x.1 + 8;
        (is_float && are_close && self.order == ByteOrder::Little).then_some(x.1)
    }
}

impl<'a> Records<'a> {
    fn remaining(&self, at: usize) -> u64 {
        self.bytes.len().saturating_sub(at) as u64
    }

    fn fail<T>(&self, index: u64, byte: usize, problem: PlyProblem) -> Result<T, Failure> {
        let element = self.element.name.clone();
        Err((PlyPlace::RecordByte { element, index, byte: byte as u64 }, problem))
    }

    /// Refuses a number of records that exceeds the rest of the file, before memory is allocated.
    fn check_length(&self) -> Result<(), Failure> {
        let shortest = self.element.shortest_record() as u64;
        let remaining = self.remaining(self.start);
        let missing = u128::from(self.element.count) * u128::from(shortest);
        let missing = missing.saturating_sub(u128::from(remaining));
        if missing == 0 {
            return Ok(());
        }
        let index = remaining / shortest;
        let problem = PlyProblem::Truncated {
            element: self.element.name.clone(),
            declared: self.element.count,
            missing: u64::try_from(missing).unwrap_or(u64::MAX),
            exact: !self.element.has_lists(),
        };
        self.fail(index, self.start + (index * shortest) as usize, problem)
    }

    /// The bytes of all records, where each has `stride` bytes and the file contains them all.
    fn fixed(&self, stride: usize) -> Option<&'a [u8]> {
        let length = usize::try_from(self.element.count).ok()?.checked_mul(stride)?;
        self.bytes.get(self.start..self.start.checked_add(length)?)
    }

    /// Visits the records one by one. `visit` gets the number of a record, its first byte and, for each property, the offset of
    /// its data. Yields the offset after the last record.
    fn walk(
        &self,
        mut visit: impl FnMut(u64, usize, &[usize]) -> Result<(), Failure>,
    ) -> Result<usize, Failure> {
        let properties = &self.element.properties;
        if !self.element.has_lists() {
            let stride = self.element.shortest_record();
            // The length has been checked, and without lists nothing in it is needed.
            return Ok(self.start + self.fixed(stride).map_or(0, <[u8]>::len));
        }
        let mut at = self.start;
        let mut offsets = vec![0; properties.len()];
        for index in 0..self.element.count {
            let record = at;
            for (offset, property) in offsets.iter_mut().zip(properties) {
                let size = match property.kind {
                    PropertyType::Scalar(scalar) => scalar.size() as u64,
                    PropertyType::List(count, item) => {
                        let head = self.bytes.get(at..at + count.size());
                        let length = head.map_or(0, |head| read_integer(head, count, self.order));
                        let Ok(length) = u64::try_from(length) else {
                            return self.fail(index, record, PlyProblem::NegativeLength(length));
                        };
                        count.size() as u64 + length * item.size() as u64
                    }
                };
                let remaining = self.remaining(at);
                if size > remaining {
                    return self.fail(index, record, self.truncated(index, size - remaining));
                }
                *offset = at;
                at += size as usize;
            }
            visit(index, record, &offsets)?;
        }
        Ok(at)
    }

    /// The error for a file that ends `missing` bytes before the end of the current property of record `index`.
    fn truncated(&self, index: u64, missing: u64) -> PlyProblem {
        let later = (self.element.count - index - 1).saturating_mul(self.element.shortest_record() as u64);
        PlyProblem::Truncated {
            element: self.element.name.clone(),
            declared: self.element.count,
            missing: missing.saturating_add(later),
            exact: false,
        }
    }

    fn read_vertices(&self, columns: &VertexColumns, vertices: &mut Vertices) -> Result<usize, Failure> {
        let types: Vec<_> = self.element.properties.iter().map(|property| property.kind).collect();
        let number = |bytes: &[u8], column: usize| match types[column] {
            PropertyType::Scalar(scalar) => read_number(bytes, scalar, self.order),
            PropertyType::List(..) => f64::NAN,
        };
        if self.element.has_lists() {
            *vertices = Vertices::with_capacity(columns, self.element.count as usize);
            return self.walk(|_, _, offsets| {
                vertices.push(columns, |column| number(&self.bytes[offsets[column]..], column));
                Ok(())
            });
        }
        let Some(layout) = FixedVertices::of(self.element, self.order) else { return Ok(self.start) };
        let stride = layout.stride;
        let Some(bytes) = self.fixed(stride) else { return Ok(self.start) };
        let records = || bytes.par_chunks_exact(stride);
        let value = |record: &[u8], column: usize| layout.value(record, column);
        let single = |record: &[u8], column: usize| value(record, column) as f32;
        vertices.positions = if columns.is_double {
            let position = |record: &[u8]| columns.position.map(|column| value(record, column));
            Positions::Double(records().map(position).collect())
        } else {
            let position = |record: &[u8]| columns.position.map(|column| single(record, column));
            Positions::Single(records().map(position).collect())
        };
        vertices.normals = columns.normal.map(|normal| {
            records().map(|record| Vec3::from_array(normal.map(|column| single(record, column)))).collect()
        });
        vertices.uvs = columns.uv.map(|uv| {
            records().map(|record| Vec2::from_array(uv.map(|column| single(record, column)))).collect()
        });
        vertices.colours = columns
            .colour
            .map(|colour| records().map(|record| colour.read(|column| value(record, column))).collect());
        Ok(self.start + bytes.len())
    }

    /// The numbers of a list at the start of `data`; `walk` has checked that they are in the file.
    fn items(&self, data: &'a [u8], list: usize) -> impl Iterator<Item = (&'a [u8], ScalarType)> {
        let (count, item) = match self.element.properties[list].kind {
            PropertyType::List(count, item) => (count, item),
            // A scalar has no items.
            PropertyType::Scalar(scalar) => (scalar, scalar),
        };
        let is_list = matches!(self.element.properties[list].kind, PropertyType::List(..));
        let length = if is_list { read_integer(data, count, self.order) as usize } else { 0 };
        data[count.size()..].chunks_exact(item.size()).take(length).map(move |bytes| (bytes, item))
    }

    fn read_strips(&self, list: usize, vertex_count: u64, contents: &mut Contents) -> Result<usize, Failure> {
        self.walk(|index, record, offsets| {
            let items = self.items(&self.bytes[offsets[list]..], list);
            let strips = items.map(|(bytes, item)| read_integer(bytes, item, self.order));
            contents.push_strips(strips, vertex_count).or_else(|problem| self.fail(index, record, problem))
        })
    }

    fn read_faces(
        &self,
        columns: &FaceColumns,
        vertex_count: u64,
        contents: &mut Contents,
    ) -> Result<usize, Failure> {
        let list = columns.corners;
        let first = self.bytes.get(self.start..).unwrap_or_default();
        let is_plain = !columns.has_look() && contents.triangles.is_empty();
        if let Some(faces) = FixedFaces::of(self.element, list, first, self.order).filter(|_| is_plain)
            && let Some(end) = self.read_fixed_faces(faces, vertex_count, contents)?
        {
            return Ok(end);
        }
        let mut corners = Vec::new();
        let mut look = FaceLook::default();
        contents.wedges = columns.has_look().then(Wedges::default);
        self.walk(|index, record, offsets| {
            corners.clear();
            for (bytes, item) in self.items(&self.bytes[offsets[list]..], list) {
                match checked_corner(read_integer(bytes, item, self.order), vertex_count) {
                    Ok(corner) => corners.push(corner),
                    Err(problem) => return self.fail(index, record, problem),
                }
            }
            let value = |column: usize| match self.element.properties[column].kind {
                PropertyType::Scalar(scalar) => {
                    read_number(&self.bytes[offsets[column]..], scalar, self.order)
                }
                PropertyType::List(..) => 0.0,
            };
            if columns.has_look() {
                look.uvs.clear();
                if let Some(list) = columns.uvs {
                    let items = self.items(&self.bytes[offsets[list]..], list);
                    look.uvs.extend(items.map(|(bytes, item)| read_number(bytes, item, self.order) as f32));
                }
                look.texture = columns.texture.map_or(0, |column| value(column) as i64);
                look.colour = columns.colour.map(|colour| colour.read(value));
            }
            contents.push_look(&corners, &look);
            Ok(())
        })
    }

    /// Reads faces that are expected to have equal lengths; `None` where they do not, with nothing read.
    fn read_fixed_faces(
        &self,
        faces: FixedFaces,
        vertex_count: u64,
        contents: &mut Contents,
    ) -> Result<Option<usize>, Failure> {
        let Some(bytes) = self.fixed(faces.stride) else { return Ok(None) };
        let FixedFaces { before, stride, corners, count, item } = faces;
        let length = |record: &[u8]| read_integer(&record[before..], count, self.order);
        let corner = |record: &[u8], number: usize| {
            let offset = before + count.size() + number * item.size();
            read_integer(&record[offset..], item, self.order)
        };
        let is_sound = |record: &[u8]| {
            length(record) == corners as i64
                && (0..corners).all(|number| (0..vertex_count as i64).contains(&corner(record, number)))
        };
        // Where all records before it have the expected length, the first odd record is at its apparent place.
        if let Some(index) = bytes.par_chunks_exact(stride).position_first(|record| !is_sound(record)) {
            let record = &bytes[index * stride..(index + 1) * stride];
            if length(record) != corners as i64 {
                return Ok(None);
            }
            let wrong =
                (0..corners).find_map(|number| checked_corner(corner(record, number), vertex_count).err());
            return match wrong {
                Some(problem) => self.fail(index as u64, self.start + index * stride, problem),
                None => Ok(None),
            };
        }
        let at = |record: &[u8], number: usize| corner(record, number) as u32;
        if corners == 3 {
            let triangle = |record: &[u8]| [0, 1, 2].map(|number| at(record, number));
            contents.triangles = bytes.par_chunks_exact(stride).map(triangle).collect();
        } else {
            contents.triangles.reserve_exact(bytes.len() / stride * (corners - 2));
            let mut polygon = vec![0; corners];
            for record in bytes.chunks_exact(stride) {
                polygon.iter_mut().enumerate().for_each(|(number, corner)| *corner = at(record, number));
                push_fan(&polygon, &mut contents.triangles);
            }
            contents.equal_polygons = Some((corners - 2, contents.triangles.len()));
        }
        Ok(Some(self.start + bytes.len()))
    }
}
