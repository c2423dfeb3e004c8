//! Pieces of an OBJ file, each parsed by one thread. A first pass counts the elements before each piece, so that relative indices
//! and line numbers are those of the whole file.

use super::super::mesh_file::{Failure, MeshPlace, MeshReading, number, shown, words};
use super::rest;
use crate::math::unit;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Approximate bytes of a piece, which ends at the end of a line.
const PIECE: usize = 1 << 20;

/// Index of an element that a corner does not name.
pub(super) const NONE: u32 = u32::MAX;

/// Colour of a vertex without one.
pub(super) const COLOURLESS: [f32; 3] = [f32::NAN; 3];

/// A corner of a face: position, texture coordinate and normal, from 0, or [`NONE`].
pub(super) type Corner = [u32; 3];

/// The content of a piece.
#[derive(Default)]
pub(super) struct Piece {
    pub(super) positions: Vec<DVec3>,
    /// Colours of the vertices as given in the file, [`COLOURLESS`] where there are none. The list may be empty, or end at the
    /// last vertex with a colour.
    pub(super) colours: Vec<[f32; 3]>,
    pub(super) coordinates: Vec<Vec2>,
    pub(super) normals: Vec<Vec3>,
    /// Corners of all faces in order.
    pub(super) corners: Vec<Corner>,
    /// End of each face in `corners`.
    pub(super) ends: Vec<u32>,
    /// `usemtl`: the number of faces before it, and the name.
    pub(super) materials: Vec<(usize, String)>,
    pub(super) libraries: Vec<(PathBuf, usize)>,
    pub(super) other_elements: u64,
    /// Line of the first position that is NaN or infinite.
    pub(super) non_finite_line: Option<usize>,
}

/// Numbers of elements in a part of a file, or before it.
#[derive(Clone, Copy, Default)]
struct Counts {
    lines: usize,
    positions: usize,
    coordinates: usize,
    normals: usize,
}

/// Parses all pieces, in the order of the file. Of several errors the first in the file is reported.
pub(super) fn parse_pieces(bytes: &[u8], reading: &MeshReading<'_>) -> Result<Vec<Piece>, Failure> {
    let texts = texts(bytes);
    let counts: Vec<Counts> = texts.par_iter().map(|text| Counts::of(text)).collect();
    let mut before = Counts::default();
    let mut add = |counts: &Counts| {
        let so_far = before.and(counts);
        std::mem::replace(&mut before, so_far)
    };
    let starts: Vec<Counts> = counts.iter().map(&mut add).collect();
    let done = AtomicUsize::new(0);
    let parse = |(text, before): (&&[u8], &Counts)| {
        let piece = Piece::parse(text, *before)?;
        reading.reached(done.fetch_add(text.len(), Ordering::Relaxed) + text.len(), bytes)?;
        Ok(piece)
    };
    let pieces: Vec<Result<Piece, Failure>> = texts.par_iter().zip(&starts).map(parse).collect();
    pieces.into_iter().collect()
}

/// Splits the file into pieces that end with complete statements.
fn texts(bytes: &[u8]) -> Vec<&[u8]> {
    let mut texts = Vec::with_capacity(bytes.len() / PIECE + 1);
    let mut rest = bytes;
    while !rest.is_empty() {
        let mut end = PIECE.min(rest.len());
        while end < rest.len() && !ends_statement(&rest[..end]) {
            let newline = rest[end..].iter().position(|&byte| byte == b'\n');
            end = newline.map_or(rest.len(), |at| end + at + 1);
        }
        let (text, left) = rest.split_at(end);
        texts.push(text);
        rest = left;
    }
    texts
}

/// Whether a text ends with a line that is not continued on the next line.
fn ends_statement(text: &[u8]) -> bool {
    let Some(text) = text.strip_suffix(b"\n") else { return false };
    // Only the last line: the text before it was checked already and may be long.
    let line = text.rsplit(|&byte| byte == b'\n').next().unwrap_or_default();
    !line.trim_ascii_end().ends_with(b"\\")
}

/// Statements of a piece with the number of their last line, from 0 at the start of the piece. A line that ends in a backslash
/// continues on the next line.
fn statements(text: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, [u8]>)> {
    let mut lines = text.strip_suffix(b"\n").unwrap_or(text).split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (mut number, line) = lines.next()?;
        let Some(start) = line.trim_ascii().strip_suffix(b"\\") else {
            return Some((number, Cow::Borrowed(line.trim_ascii())));
        };
        let mut joined = start.to_vec();
        for (next, line) in lines.by_ref() {
            joined.push(b' ');
            number = next;
            match line.trim_ascii().strip_suffix(b"\\") {
                Some(more) => joined.extend_from_slice(more),
                None => {
                    joined.extend_from_slice(line.trim_ascii());
                    break;
                }
            }
        }
        Some((number, Cow::Owned(joined)))
    })
}

impl Counts {
    fn of(text: &[u8]) -> Self {
        let mut counts = Self::default();
        for (number, statement) in statements(text) {
            counts.lines = number + 1;
            match words(&statement).next() {
                Some(b"v") => counts.positions += 1,
                Some(b"vt") => counts.coordinates += 1,
                Some(b"vn") => counts.normals += 1,
                _ => {}
            }
        }
        counts
    }

    fn and(&self, more: &Self) -> Self {
        Self {
            lines: self.lines + more.lines,
            positions: self.positions + more.positions,
            coordinates: self.coordinates + more.coordinates,
            normals: self.normals + more.normals,
        }
    }
}

impl Piece {
    /// Parses a piece with the given numbers of elements before it.
    fn parse(text: &[u8], before: Counts) -> Result<Self, Failure> {
        let mut piece = Self::default();
        for (number, statement) in statements(text) {
            piece.statement(&statement, before.lines + number + 1, &before)?;
        }
        Ok(piece)
    }

    fn statement(&mut self, text: &[u8], line: usize, before: &Counts) -> Result<(), Failure> {
        let mut parts = words(text);
        let Some(keyword) = parts.next() else { return Ok(()) };
        match keyword {
            b"v" => {
                let mut position = [0.0; 3];
                for (value, what) in
                    position.iter_mut().zip(["x of the vertex", "y of the vertex", "z of the vertex"])
                {
                    *value = number(parts.next(), line, what)?;
                }
                let position = DVec3::from_array(position);
                if !position.is_finite() {
                    self.non_finite_line.get_or_insert(line);
                }
                self.positions.push(position);
                self.colour(parts);
            }
            b"vn" => {
                let mut normal = [0.0; 3];
                for (value, what) in
                    normal.iter_mut().zip(["x of the normal", "y of the normal", "z of the normal"])
                {
                    *value = number(parts.next(), line, what)? as f32;
                }
                self.normals.push(unit(Vec3::from_array(normal)).unwrap_or(Vec3::ZERO));
            }
            b"vt" => {
                let u = number(parts.next(), line, "u of the texture coordinate")? as f32;
                // One number suffices, for a one-dimensional picture.
                let v = match parts.next().filter(|word| !word.starts_with(b"#")) {
                    Some(word) => number(Some(word), line, "v of the texture coordinate")? as f32,
                    None => 0.0,
                };
                let coordinate = Vec2::new(u, v);
                self.coordinates.push(if coordinate.is_finite() { coordinate } else { Vec2::ZERO });
            }
            b"f" | b"fo" => self.face(parts, line, before)?,
            b"l" | b"p" | b"curv" | b"curv2" | b"surf" => self.other_elements += 1,
            b"usemtl" => {
                let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
                self.materials.push((self.ends.len(), name));
            }
            b"mtllib" => {
                let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
                self.libraries.push((PathBuf::from(name), line));
            }
            // Names, groups, smoothing, comments, and other statements that a mesh does not need.
            _ => {}
        }
        Ok(())
    }

    /// Reads the three numbers after a position, which many programs write as a colour. A fourth number is alpha; a single number
    /// is a weight for curves.
    fn colour<'a>(&mut self, parts: impl Iterator<Item = &'a [u8]>) {
        let mut colour = [0.0; 3];
        let mut count = 0;
        for word in parts.take_while(|word| !word.starts_with(b"#")) {
            let Some(value) = std::str::from_utf8(word).ok().and_then(|word| word.parse::<f32>().ok()) else {
                return;
            };
            if let Some(channel) = colour.get_mut(count) {
                *channel = value;
            }
            count += 1;
        }
        if matches!(count, 3 | 4) && colour.iter().all(|channel| channel.is_finite()) {
            self.colours.resize(self.positions.len() - 1, COLOURLESS);
            self.colours.push(colour);
        }
    }

    fn face<'a>(
        &mut self,
        corners: impl Iterator<Item = &'a [u8]>,
        line: usize,
        before: &Counts,
    ) -> Result<(), Failure> {
        // Up to a comment at the end of the line.
        for corner in corners.take_while(|corner| !corner.starts_with(b"#")) {
            let corner = self.corner(corner, line, before)?;
            self.corners.push(corner);
        }
        self.ends.push(self.corners.len() as u32);
        Ok(())
    }

    /// `position`, `position/coordinate`, `position//normal` or `position/coordinate/normal`.
    fn corner(&self, text: &[u8], line: usize, before: &Counts) -> Result<Corner, Failure> {
        let mut parts = text.split(|&byte| byte == b'/');
        let positions = before.positions + self.positions.len();
        let position = index(parts.next().unwrap_or_default(), positions, "vertices", line)?;
        let mut named = |count: usize, things: &str| match parts.next().filter(|part| !part.is_empty()) {
            Some(part) => index(part, count, things, line),
            None => Ok(NONE),
        };
        let coordinate = named(before.coordinates + self.coordinates.len(), "texture coordinates")?;
        let normal = named(before.normals + self.normals.len(), "normals")?;
        Ok([position, coordinate, normal])
    }
}

/// An index of one of `count` elements, from 0. The file counts from 1, or back from the last element with negative numbers.
fn index(text: &[u8], count: usize, things: &str, line: usize) -> Result<u32, Failure> {
    let fail = |problem: String| Err((MeshPlace::Line(line), problem));
    let Some(number) = std::str::from_utf8(text).ok().and_then(|text| text.parse::<i64>().ok()) else {
        let shown = shown(text);
        return fail(format!("`{shown}` is not a number of a corner; mend the line or write the file again"));
    };
    let from_start = if number < 0 { (count as i64).checked_add(number) } else { Some(number - 1) };
    let at = from_start.and_then(|at| u32::try_from(at).ok());
    match at.filter(|&at| (at as usize) < count && at < NONE) {
        Some(at) => Ok(at),
        None => fail(format!(
            "{number} is not one of the {count} {things} before this line, counted from 1, or back from -1; write the \
             mesh again"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of many pieces, with materials, indices in both directions and continued lines; each block has one triangle.
    fn long(blocks: usize) -> String {
        let block = |i: usize| {
            format!(
                "v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nvt 0.5 {i}\nvn 0 0 1\nusemtl m{}\nf -3/-1/-1 \\\n {} -1\n",
                i % 3,
                3 * i + 2
            )
        };
        (0..blocks).map(block).collect()
    }

    #[test]
    fn pieces_are_the_whole() {
        let blocks = 40_000;
        let text = long(blocks);
        assert!(text.len() > 3 * PIECE, "{}", text.len());
        assert_eq!(texts(text.as_bytes()).concat(), text.as_bytes());
        let pieces = parse_pieces(text.as_bytes(), &MeshReading::ALL).unwrap();
        assert!(pieces.len() >= 3);
        let corners: Vec<Corner> = pieces.iter().flat_map(|piece| piece.corners.iter().copied()).collect();
        assert_eq!(corners.len(), 3 * blocks);
        for (i, face) in corners.chunks(3).enumerate() {
            let (i, first) = (i as u32, 3 * i as u32);
            assert_eq!(face, [[first, i, i], [first + 1, NONE, NONE], [first + 2, NONE, NONE]]);
        }
        assert_eq!(pieces.iter().map(|piece| piece.materials.len()).sum::<usize>(), blocks);
        // Line numbers count from the start of the file, whichever piece a line is in.
        let lines = text.lines().count();
        for bad in ["f 1 2 0\n", "f 1 2 999999\n", "v 1 2\n"] {
            let (place, _) =
                parse_pieces(format!("{text}{bad}").as_bytes(), &MeshReading::ALL).err().unwrap();
            assert_eq!(place, MeshPlace::Line(lines + 1), "{bad}");
        }
        // Of two errors the first is reported.
        let twice = format!("{}f x\n{}f y\n", long(20_000), long(20_000));
        let (_, problem) = parse_pieces(twice.as_bytes(), &MeshReading::ALL).err().unwrap();
        assert!(problem.contains("`x`"), "{problem}");
    }

    #[test]
    fn no_piece_begins_within_a_statement() {
        let line = "f 1 2 3 \\\n";
        let text = line.repeat(PIECE / line.len() + 5);
        assert_eq!(texts(text.as_bytes()).len(), 1);
        // A blank line ends the continuation; a search back over all blank lines would take too long.
        let blank = format!("f 1 2 3 \\\n{}", "\n".repeat(8 * PIECE));
        assert_eq!(texts(blank.as_bytes()).len(), 9);
        let found: Vec<_> = statements(b"v 1 \\\n2 \\ \n 3\nvt 1\n\\").collect();
        assert_eq!(found[0], (2, Cow::Borrowed(b"v 1  2  3" as &[u8])));
        assert_eq!(found[1], (3, Cow::Borrowed(b"vt 1" as &[u8])));
        assert_eq!(found.len(), 3);
    }

    #[test]
    fn reading_can_be_stopped() {
        let text = long(40_000);
        let reading = MeshReading { progress: &|done, _| done < PIECE as u64, ..MeshReading::ALL };
        let (_, problem) = parse_pieces(text.as_bytes(), &reading).err().unwrap();
        assert!(problem.contains("stopped"), "{problem}");
    }
}
