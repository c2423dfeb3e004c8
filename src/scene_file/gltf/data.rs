//! Buffers and accessors. Every length is checked before anything is read.

use super::check::Report;
use super::error::{Failure, fail};
use crate::memory::{MemoryError, MemoryEstimate};
use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer;
use std::borrow::Cow;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Most elements of an accessor without data. Their zeros take memory without being in the file.
const MOST_ZEROS: u64 = 1 << 24;

/// Most bytes that the accessors of one file may be decoded to in total, including those that are not kept.
const MOST_DECODED: u64 = 1 << 34;

/// Base64 as files have it, with or without padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The target of a URI in a file.
#[derive(Debug)]
pub(super) enum Resource {
    /// Bytes in the file itself.
    Inline(Vec<u8>),
    /// Another file.
    File(PathBuf),
}

/// Resolves a URI against the folder of the file. A URI that leaves that folder is refused unless `outside` is set, so that a
/// model from elsewhere reads only the files that came with it.
pub(super) fn resolve(uri: &str, folder: &Path, outside: bool) -> Result<Resource, String> {
    if let Some(rest) = uri.strip_prefix("data:") {
        let Some((kind, content)) = rest.split_once(',') else {
            return Err("its data: URI has no data; write the file again".to_owned());
        };
        if !kind.ends_with(";base64") {
            return Err("its data: URI is not in base64; write the file again".to_owned());
        }
        let bytes = BASE64.decode(content);
        let bytes =
            bytes.map_err(|error| format!("its data: URI is damaged ({error}); write the file again"))?;
        return Ok(Resource::Inline(bytes));
    }
    let shown = super::shown(uri);
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    let scheme =
        scheme.filter(|scheme| scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c)));
    let local = match scheme {
        None => uri,
        Some(scheme) if scheme.eq_ignore_ascii_case("file") => {
            // With an empty host, with that of this machine, or without a host.
            let rest = &uri[scheme.len() + 1..];
            rest.strip_prefix("//localhost").or(rest.strip_prefix("//")).unwrap_or(rest)
        }
        Some(_) => return Err(format!("`{shown}` is not in a file beside this one; copy it there")),
    };
    let decoded = urlencoding::decode(local)
        .map_err(|_| format!("`{shown}` is no URI of a file; write the file again"))?;
    if decoded.is_empty() {
        return Err(format!("`{shown}` names no file; write the file again"));
    }
    let path = Path::new(&*decoded);
    if !outside && (scheme.is_some() || leaves(path)) {
        return Err(format!(
            "`{shown}` lies outside of the folder of this file; copy it there, or allow such files with --set \
             outside=yes where this file is rendered by itself"
        ));
    }
    Ok(Resource::File(folder.join(path)))
}

/// Whether a path leads out of the folder that it starts from.
fn leaves(path: &Path) -> bool {
    let mut depth = 0i64;
    path.components().any(|component| {
        match component {
            Component::Normal(_) => depth += 1,
            Component::ParentDir => depth -= 1,
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => depth = i64::MIN / 2,
        }
        depth < 0
    })
}

/// The first `length` bytes of a file.
fn read_file(path: &Path, length: u64) -> Result<Vec<u8>, String> {
    let shown = path.display();
    let unreadable = |error| format!("{shown} cannot be read: {error}; put it there");
    let (mut file, has) = crate::files::open_regular(path).map_err(unreadable)?;
    if has < length {
        return Err(format!(
            "{shown} has {has} bytes, and {length} are declared; it is cut off or another file"
        ));
    }
    let mut bytes = Vec::with_capacity(length as usize);
    Read::by_ref(&mut file).take(length).read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

/// Decides whether a file may take the memory of its estimate.
pub(super) type Allow<'a> = &'a dyn Fn(&MemoryEstimate) -> Result<(), MemoryError>;

/// The data of a file.
pub(super) struct Data<'a> {
    folder: PathBuf,
    /// Whether files outside the folder may be read.
    outside: bool,
    binary: Option<&'a [u8]>,
    /// For each buffer its bytes; read when first needed.
    buffers: Vec<Option<Cow<'a, [u8]>>>,
    decoded: u64,
    /// Files that were read.
    pub(super) files: Vec<PathBuf>,
    /// Warnings about the data that were read.
    pub(super) report: Report,
    /// Memory estimate of the file so far.
    estimate: MemoryEstimate,
    /// Decides whether the estimate is allowed.
    allow: Allow<'a>,
}

/// Position of an accessor's elements in its buffer.
struct Layout {
    buffer: usize,
    start: usize,
    stride: usize,
    count: usize,
    element: usize,
}

impl Layout {
    /// Bytes of element `i`.
    fn element<'b>(&self, bytes: &'b [u8], i: usize) -> &'b [u8] {
        let at = self.start + i * self.stride;
        &bytes[at..at + self.element]
    }
}

pub(super) fn size_of(kind: DataType) -> usize {
    match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

/// One number. Where integers are `normalized`, they are scaled to `[0, 1]` or `[-1, 1]`.
fn component(kind: DataType, bytes: &[u8], normalized: bool) -> f32 {
    let at = |i: usize| bytes.get(i).copied().unwrap_or(0);
    let two = [at(0), at(1)];
    let four = [at(0), at(1), at(2), at(3)];
    let (value, most) = match kind {
        DataType::I8 => (f32::from(at(0) as i8), 127.0),
        DataType::U8 => (f32::from(at(0)), 255.0),
        DataType::I16 => (f32::from(i16::from_le_bytes(two)), 32767.0),
        DataType::U16 => (f32::from(u16::from_le_bytes(two)), 65535.0),
        DataType::U32 => (u32::from_le_bytes(four) as f32, u32::MAX as f32),
        DataType::F32 => return f32::from_le_bytes(four),
    };
    if normalized { (value / most).max(-1.0) } else { value }
}

impl<'a> Data<'a> {
    pub(super) fn new(
        document: &gltf::Document,
        binary: Option<&'a [u8]>,
        folder: &Path,
        outside: bool,
        (estimate, allow): (MemoryEstimate, Allow<'a>),
    ) -> Self {
        let buffers = document.buffers().map(|_| None).collect();
        let (folder, report) = (folder.to_owned(), Report::default());
        Self { folder, outside, binary, buffers, decoded: 0, files: Vec::new(), report, estimate, allow }
    }

    /// Adds to the memory estimate of the file, before the memory is allocated, and refuses an estimate that is not allowed.
    pub(super) fn foresee(
        &mut self,
        object: &str,
        add: impl FnOnce(&mut MemoryEstimate),
    ) -> Result<(), Failure> {
        add(&mut self.estimate);
        (self.allow)(&self.estimate).or_else(|error| fail(object, error))
    }

    /// Resolves a URI of this file.
    pub(super) fn resolve(&self, uri: &str) -> Result<Resource, String> {
        resolve(uri, &self.folder, self.outside)
    }

    /// Loads a buffer, if it is not loaded yet.
    fn load(&mut self, buffer: &buffer::Buffer<'_>) -> Result<(), Failure> {
        let index = buffer.index();
        if self.buffers[index].is_some() {
            return Ok(());
        }
        let object = super::label("buffers", index, buffer.name());
        let length = buffer.length();
        let bytes: Cow<'a, [u8]> = match buffer.source() {
            buffer::Source::Bin => match self.binary {
                Some(binary) if index == 0 => Cow::Borrowed(binary),
                _ => return fail(object, "it has no data: no URI, and the file no binary chunk for it"),
            },
            buffer::Source::Uri(uri) => match self.resolve(uri) {
                Ok(Resource::Inline(bytes)) => Cow::Owned(bytes),
                Ok(Resource::File(path)) => {
                    self.foresee(&object, |estimate| {
                        estimate.reading = estimate.reading.saturating_add(length as u64);
                    })?;
                    let bytes = read_file(&path, length as u64).or_else(|problem| fail(&object, problem))?;
                    self.files.push(path);
                    Cow::Owned(bytes)
                }
                Err(problem) => return fail(object, problem),
            },
        };
        if bytes.len() < length {
            let problem =
                format!("{} bytes of data, and {length} are declared; the file is cut off", bytes.len());
            return fail(object, problem);
        }
        self.buffers[index] = Some(bytes);
        Ok(())
    }

    fn bytes(&self, buffer: usize) -> &[u8] {
        self.buffers[buffer].as_deref().unwrap_or_default()
    }

    /// The bytes of a view.
    pub(super) fn view(&mut self, view: &buffer::View<'_>) -> Result<&[u8], Failure> {
        self.load(&view.buffer())?;
        let (start, length) = (view.offset(), view.length());
        match start.checked_add(length).and_then(|end| self.bytes(view.buffer().index()).get(start..end)) {
            Some(bytes) => Ok(bytes),
            None => fail(
                super::label("bufferViews", view.index(), view.name()),
                format!("bytes {start} to {} lie beyond the end of its buffer", start.saturating_add(length)),
            ),
        }
    }

    /// Position of `count` elements of `element` bytes in a view, after a check that they lie within it.
    fn layout(
        &mut self,
        view: &buffer::View<'_>,
        offset: usize,
        (count, element): (usize, usize),
        object: &str,
    ) -> Result<Layout, Failure> {
        let length = self.view(view)?.len();
        let stride = view.stride().unwrap_or(element);
        let last = (count.max(1) - 1).checked_mul(stride);
        let end = last.and_then(|last| last.checked_add(offset)?.checked_add(element));
        if stride < element || end.is_none_or(|end| count > 0 && end > length) {
            let problem = format!(
                "{count} elements of {element} bytes, {stride} apart from byte {offset}, and its buffer view has {length} \
                 bytes; the file is damaged"
            );
            return fail(object, problem);
        }
        Ok(Layout { buffer: view.buffer().index(), start: view.offset() + offset, stride, count, element })
    }

    /// Calls `take` with the index and the bytes of each element for which an accessor has data, in order. Elements that the
    /// sparse part replaces come twice. Elements without data are zero.
    fn for_each(
        &mut self,
        accessor: &gltf::Accessor<'_>,
        element: usize,
        mut take: impl FnMut(usize, &[u8]),
    ) -> Result<(), Failure> {
        let object = label(accessor);
        let count = accessor.count();
        self.decoded = self.decoded.saturating_add((count as u64).saturating_mul(16));
        if self.decoded > MOST_DECODED {
            let problem = format!("the meshes of this file take more than {MOST_DECODED} bytes; split it");
            return fail(object, problem);
        }
        if let Some(view) = accessor.view() {
            let layout = self.layout(&view, accessor.offset(), (count, element), &object)?;
            let bytes = self.bytes(layout.buffer);
            (0..layout.count).for_each(|i| take(i, layout.element(bytes, i)));
        }
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let kind = match indices.index_type() {
                gltf::accessor::sparse::IndexType::U8 => DataType::U8,
                gltf::accessor::sparse::IndexType::U16 => DataType::U16,
                gltf::accessor::sparse::IndexType::U32 => DataType::U32,
            };
            let replaced = sparse.count();
            let places =
                self.layout(&indices.view(), indices.offset(), (replaced, size_of(kind)), &object)?;
            let new = self.layout(&values.view(), values.offset(), (replaced, element), &object)?;
            for i in 0..replaced {
                let place = unsigned(kind, places.element(self.bytes(places.buffer), i)) as usize;
                if place >= count {
                    return fail(object, format!("its sparse part replaces element {place} of {count}"));
                }
                take(place, new.element(self.bytes(new.buffer), i));
            }
        }
        Ok(())
    }

    /// The number of elements, if memory may be allocated for them.
    fn count(accessor: &gltf::Accessor<'_>) -> Result<usize, Failure> {
        let count = accessor.count();
        if accessor.view().is_none() && count as u64 > MOST_ZEROS {
            let problem = format!("{count} elements without data, and at most {MOST_ZEROS} are read");
            return fail(label(accessor), problem);
        }
        Ok(count)
    }

    /// Vectors of `N` numbers. Where the accessor has one number less, the last component is 1.
    pub(super) fn vectors<const N: usize>(
        &mut self,
        accessor: &gltf::Accessor<'_>,
    ) -> Result<Vec<[f32; N]>, Failure> {
        let (kind, has) = (accessor.data_type(), numbers_of(accessor.dimensions()));
        if has != N && has + 1 != N || N < 2 {
            return fail(label(accessor), format!("elements of {has} numbers, where {N} are needed"));
        }
        let count = Self::count(accessor)?;
        let (normalized, size) = (accessor.normalized(), size_of(kind));
        if let Some(view) = accessor.view() {
            // Checked before memory is allocated.
            self.layout(&view, accessor.offset(), (count, has * size), &label(accessor))?;
        }
        let mut blank = [0.0; N];
        if has < N {
            blank[N - 1] = 1.0;
        }
        let mut vectors = vec![blank; count];
        self.for_each(accessor, has * size, |i, bytes| {
            for (number, bytes) in vectors[i].iter_mut().zip(bytes.chunks_exact(size)) {
                *number = component(kind, bytes, normalized);
            }
        })?;
        Ok(vectors)
    }

    /// As [`Self::vectors`], for elements of exactly `N` numbers.
    pub(super) fn vectors_exactly<const N: usize>(
        &mut self,
        accessor: &gltf::Accessor<'_>,
    ) -> Result<Vec<[f32; N]>, Failure> {
        let has = numbers_of(accessor.dimensions());
        if has != N {
            return fail(label(accessor), format!("elements of {has} numbers, where {N} are needed"));
        }
        self.vectors(accessor)
    }

    /// Indices of vertices.
    pub(super) fn indices(&mut self, accessor: &gltf::Accessor<'_>) -> Result<Vec<u32>, Failure> {
        let kind = accessor.data_type();
        if !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32)
            || numbers_of(accessor.dimensions()) != 1
        {
            return fail(label(accessor), "indices must be single unsigned integers");
        }
        let count = Self::count(accessor)?;
        if let Some(view) = accessor.view() {
            self.layout(&view, accessor.offset(), (count, size_of(kind)), &label(accessor))?;
        }
        let mut indices = vec![0; count];
        self.for_each(accessor, size_of(kind), |i, bytes| indices[i] = unsigned(kind, bytes))?;
        Ok(indices)
    }
}

fn unsigned(kind: DataType, bytes: &[u8]) -> u32 {
    let at = |i: usize| bytes.get(i).copied().unwrap_or(0);
    match kind {
        DataType::U8 => u32::from(at(0)),
        DataType::U16 => u32::from(u16::from_le_bytes([at(0), at(1)])),
        _ => u32::from_le_bytes([at(0), at(1), at(2), at(3)]),
    }
}

pub(super) fn numbers_of(dimensions: Dimensions) -> usize {
    match dimensions {
        Dimensions::Scalar => 1,
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 | Dimensions::Mat2 => 4,
        Dimensions::Mat3 => 9,
        Dimensions::Mat4 => 16,
    }
}

/// Name of an accessor in messages.
pub(super) fn label(accessor: &gltf::Accessor<'_>) -> String {
    super::label("accessors", accessor.index(), accessor.name())
}
