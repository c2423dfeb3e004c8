//! Errors of the PLY reader.

use crate::files::ForeignFile;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why a PLY file was refused, and where in it.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {}", .0.file.display(), .0.place, .0.problem)]
pub struct PlyError(Box<Details>);

#[derive(Debug)]
struct Details {
    file: PathBuf,
    place: PlyPlace,
    problem: PlyProblem,
}

impl PlyError {
    pub(super) fn new(file: &Path, place: PlyPlace, problem: PlyProblem) -> Self {
        Self(Box::new(Details { file: file.to_path_buf(), place, problem }))
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.0.file
    }

    /// Where in the file.
    pub fn place(&self) -> &PlyPlace {
        &self.0.place
    }

    /// What is wrong, and what to do about it.
    pub fn problem(&self) -> &PlyProblem {
        &self.0.problem
    }
}

/// A place in a PLY file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PlyPlace {
    /// The file as a whole.
    File,
    /// A line of the header, from 1.
    Line(usize),
    /// A record of an element in the body of an ascii file.
    RecordLine {
        /// The element.
        element: String,
        /// Number of the record, from 0.
        index: u64,
        /// Line, from 1.
        line: usize,
    },
    /// A record of an element in the body of a binary file.
    RecordByte {
        /// The element.
        element: String,
        /// Number of the record, from 0.
        index: u64,
        /// Offset of its first byte in the file.
        byte: u64,
    },
}

impl fmt::Display for PlyPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, ":{line}"),
            Self::RecordLine { element, index, line } => write!(f, ":{line}: {element} {index}"),
            Self::RecordByte { element, index, byte } => write!(f, ": {element} {index} (byte {byte})"),
        }
    }
}

/// What is wrong with a PLY file. Each message ends with what to do.
#[derive(Debug, thiserror::Error)]
pub enum PlyProblem {
    /// The system could not read it.
    #[error("cannot be read: {0}; check its name and permissions")]
    Io(std::io::Error),
    /// The caller stopped the reading.
    #[error("was not read to its end as reading was stopped; start again")]
    Stopped,
    /// The first line is not `ply`.
    #[error("not a PLY file: it does not begin with the line `ply`; convert the mesh to PLY")]
    NotPly,
    /// The first bytes are those of another kind of file.
    #[error("not a PLY file: it {0}")]
    Foreign(ForeignFile),
    /// The header never ends.
    #[error("the header has no line `end_header`; the file is incomplete, write or copy it again")]
    NoEndOfHeader,
    /// The header has no `format`.
    #[error(
        "the header has no line `format` before `{0}`; the second line should be `format ascii 1.0`, \
             `format binary_little_endian 1.0` or `format binary_big_endian 1.0`"
    )]
    NoFormat(String),
    /// A line of the header with wrong syntax.
    #[error("`{line}`: expected {expected}; mend the line or write the file again")]
    HeaderLine {
        /// The line.
        line: String,
        /// What it should have been.
        expected: &'static str,
    },
    /// A duplicate name.
    #[error("the {kind} `{name}` is declared twice; rename one of the two")]
    Duplicate {
        /// "element" or "property".
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// More elements or properties than any mesh has.
    #[error("more than {limit} {kind}; remove those that are not needed")]
    TooMany {
        /// "elements" or "properties".
        kind: &'static str,
        /// The largest number that is read.
        limit: usize,
    },
    /// More vertices than indices can name.
    #[error("declares {count} vertices, at most {} are possible; split the mesh", u32::MAX)]
    TooManyVertices {
        /// Declared number.
        count: u64,
    },
    /// Vertices without a coordinate.
    #[error("the element `vertex` has no property `{0}` that is a number; write the positions as x, y and z")]
    NoCoordinate(&'static str),
    /// Faces without corners.
    #[error(
        "the element `face` or `tristrips` has no list of integers `vertex_indices` or `vertex_index`; write the faces with one"
    )]
    NoVertexIndices,
    /// The file ends too early.
    #[error(
        "{declared} records of `{element}` are declared, but the file ends: {} {missing} bytes are missing; \
         the file is incomplete or its header wrong, write or copy it again",
        if *exact { "exactly" } else { "at least" }
    )]
    Truncated {
        /// The element.
        element: String,
        /// Declared number of records.
        declared: u64,
        /// Bytes that this element still needs.
        missing: u64,
        /// Whether that is all it needs; otherwise the lengths of its lists are unknown.
        exact: bool,
    },
    /// A list of negative length.
    #[error("a list of length {0}; the file is damaged, write or copy it again")]
    NegativeLength(i64),
    /// A corner with an index beyond the vertices.
    #[error("corner {index} is not one of the {vertices} vertices, counted from 0; write the mesh again")]
    IndexOutOfRange {
        /// The number.
        index: i64,
        /// Number of vertices.
        vertices: u64,
    },
    /// Text that is not a number.
    #[error("`{token}` is not {expected}; mend the line or write the file again")]
    BadNumber {
        /// The text.
        token: String,
        /// What it should have been.
        expected: &'static str,
    },
    /// A line with too few numbers.
    #[error("the line ends before its {0} numbers; each record is one line, mend it or write the file again")]
    ShortLine(u64),
    /// A line with too many numbers.
    #[error(
        "the line goes on after its {0} numbers; each record is one line, mend it or write the file again"
    )]
    LongLine(u64),
}
