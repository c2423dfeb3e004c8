//! The header of a PLY file: encoding, elements and their properties.

use super::Failure;
use super::error::{PlyPlace, PlyProblem};
use crate::files::{BYTE_ORDER_MARK, foreign_by_content};
use crate::scene_file::mesh::Cloud;
use std::path::Path;

/// Most elements of a file, and most properties of an element. They are far beyond any mesh, and keep a hostile header from
/// costing time.
const MAX_ELEMENTS: usize = 1000;
const MAX_PROPERTIES: usize = 1000;

/// Longest header line that a message repeats.
const SHOWN: usize = 80;

/// Byte order of a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

/// Encoding of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(ByteOrder),
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes that a number takes in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Whether every value is exact in `f32`.
    pub(super) fn fits_f32(self) -> bool {
        !matches!(self, Self::I32 | Self::U32 | Self::F64)
    }
}

/// The content of a property: one number or one list of numbers in each record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PropertyType {
    Scalar(ScalarType),
    /// A list: the types of its length and of its items.
    List(ScalarType, ScalarType),
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: PropertyType,
}

/// A table of records.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Line of the header that declares it.
    pub(super) line: usize,
}

impl Element {
    /// Bytes of the shortest record in a binary file, with empty lists.
    pub(super) fn shortest_record(&self) -> usize {
        let size = |property: &Property| match property.kind {
            PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => scalar.size(),
        };
        self.properties.iter().map(size).sum()
    }

    pub(super) fn has_lists(&self) -> bool {
        self.properties.iter().any(|property| matches!(property.kind, PropertyType::List(..)))
    }
}

/// The content of the header.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Names of pictures from `TextureFile` comments, in their order.
    pub(super) textures: Vec<String>,
    /// Offset of the first byte after the header.
    pub(super) length: usize,
    /// Number of lines of the header.
    pub(super) lines: usize,
    /// Line ending of this file.
    pub(super) line_end: LineEnd,
}

/// Line ending. The first line decides, because the data of a binary file may begin with any byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineEnd {
    /// A line feed, perhaps after a carriage return.
    LineFeed,
    /// A carriage return alone.
    CarriageReturn,
}

impl LineEnd {
    fn of(bytes: &[u8]) -> Self {
        let end = bytes.iter().position(|byte| matches!(byte, b'\r' | b'\n'));
        match end.map(|end| (bytes[end], bytes.get(end + 1))) {
            Some((b'\r', next)) if next != Some(&b'\n') => Self::CarriageReturn,
            _ => Self::LineFeed,
        }
    }

    pub(super) fn byte(self) -> u8 {
        match self {
            Self::LineFeed => b'\n',
            Self::CarriageReturn => b'\r',
        }
    }
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Failure> {
        let line_end = LineEnd::of(bytes);
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut textures = Vec::new();
        let mut at = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        if let Some(foreign) = foreign_by_content(Path::new(""), bytes).filter(|_| !bytes.starts_with(b"ply"))
        {
            return Err((PlyPlace::File, PlyProblem::Foreign(foreign)));
        }
        for number in 1.. {
            let rest = &bytes[at..];
            // Without its line ending, `end_header` may be the beginning of a truncated line.
            let Some(length) = rest.iter().position(|&byte| byte == line_end.byte()) else {
                let is_ply = number > 1 || rest.trim_ascii() == b"ply";
                let problem = if is_ply { PlyProblem::NoEndOfHeader } else { PlyProblem::NotPly };
                return Err((PlyPlace::File, problem));
            };
            at += length + 1;
            let line = String::from_utf8_lossy(&rest[..length]);
            if number == 1 {
                if line.trim() != "ply" {
                    return Err((PlyPlace::File, PlyProblem::NotPly));
                }
                continue;
            }
            let words: Vec<_> = line.split_ascii_whitespace().collect();
            match words.first() {
                None | Some(&"obj_info") => {}
                Some(&"comment") => textures.extend(texture_of(&line)),
                Some(&"end_header") => {
                    let Some(encoding) = encoding else {
                        return Err((PlyPlace::Line(number), PlyProblem::NoFormat("end_header".to_string())));
                    };
                    return Ok(Self { encoding, elements, textures, length: at, lines: number, line_end });
                }
                Some(_) => declare(&words, number, &mut encoding, &mut elements)
                    .map_err(|problem| (PlyPlace::Line(number), problem))?,
            }
        }
        Err((PlyPlace::File, PlyProblem::NoEndOfHeader))
    }

    /// Kind of a file without faces.
    pub(super) fn cloud(&self) -> Cloud {
        let has =
            |element: &Element, name: &str| element.properties.iter().any(|property| property.name == name);
        match self.element("vertex") {
            Some(vertex) if has(vertex, "f_dc_0") || has(vertex, "scale_0") && has(vertex, "rot_0") => {
                Cloud::Splats
            }
            _ => Cloud::Points,
        }
    }

    pub(super) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }
}

/// The name of a picture in a comment, as MeshLab and photogrammetry programs write it; it may contain blanks.
fn texture_of(line: &str) -> Option<String> {
    let text = line.trim().strip_prefix("comment")?.trim_start();
    let (keyword, name) = text.split_once(char::is_whitespace)?;
    let name = name.trim().trim_matches('"');
    (keyword.eq_ignore_ascii_case("TextureFile") && !name.is_empty()).then(|| name.to_owned())
}

/// Parses one line of a declaration.
fn declare(
    words: &[&str],
    number: usize,
    encoding: &mut Option<Encoding>,
    elements: &mut Vec<Element>,
) -> Result<(), PlyProblem> {
    let wrong = |expected| {
        let line: String = words.join(" ").chars().take(SHOWN).collect();
        PlyProblem::HeaderLine { line, expected }
    };
    if words[0] != "format" && encoding.is_none() {
        return Err(PlyProblem::NoFormat(words[0].chars().take(SHOWN).collect()));
    }
    match words {
        ["format", name, "1.0"] if encoding.is_none() => {
            *encoding = Some(match *name {
                "ascii" => Encoding::Ascii,
                "binary_little_endian" => Encoding::Binary(ByteOrder::Little),
                "binary_big_endian" => Encoding::Binary(ByteOrder::Big),
                _ => return Err(wrong("`ascii`, `binary_little_endian` or `binary_big_endian`")),
            });
            Ok(())
        }
        ["format", ..] if encoding.is_some() => Err(wrong("one line `format` only")),
        ["format", ..] => Err(wrong("`format NAME 1.0`")),
        ["element", name, count] => {
            let count = count.parse().map_err(|_| wrong("a number of records that is a whole number"))?;
            if elements.iter().any(|element| element.name == *name) {
                return Err(PlyProblem::Duplicate { kind: "element", name: (*name).to_string() });
            }
            if elements.len() == MAX_ELEMENTS {
                return Err(PlyProblem::TooMany { kind: "elements", limit: MAX_ELEMENTS });
            }
            elements.push(Element { name: (*name).to_string(), count, properties: Vec::new(), line: number });
            Ok(())
        }
        ["property", ..] => {
            let Some(element) = elements.last_mut() else {
                return Err(wrong("an `element` before its first `property`"));
            };
            let property = parse_property(words)
                .ok_or_else(|| wrong("`property TYPE NAME` or `property list INTEGER_TYPE TYPE NAME`"))?;
            if element.properties.iter().any(|other| other.name == property.name) {
                return Err(PlyProblem::Duplicate { kind: "property", name: property.name });
            }
            if element.properties.len() == MAX_PROPERTIES {
                return Err(PlyProblem::TooMany { kind: "properties", limit: MAX_PROPERTIES });
            }
            element.properties.push(property);
            Ok(())
        }
        _ => Err(wrong("`element NAME COUNT`, `property ...`, `comment ...` or `end_header`")),
    }
}

fn parse_property(words: &[&str]) -> Option<Property> {
    let (kind, name) = match words {
        ["property", "list", count, item, name] => {
            let count = ScalarType::parse(count).filter(|count| count.is_integer())?;
            (PropertyType::List(count, ScalarType::parse(item)?), name)
        }
        ["property", scalar, name] => (PropertyType::Scalar(ScalarType::parse(scalar)?), name),
        _ => return None,
    };
    Some(Property { name: (*name).to_string(), kind })
}
