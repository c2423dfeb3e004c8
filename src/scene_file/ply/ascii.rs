//! Bodies of ascii files: one record on each line; blank lines are skipped.

use super::Failure;
use super::error::{PlyPlace, PlyProblem};
use super::header::{Element, Header, LineEnd, PropertyType, ScalarType};
use super::layout::{Contents, FaceLook, Role, Roles, Vertices, Wedges, checked_corner};

/// Longest token that a message repeats, in bytes.
const SHOWN: usize = 40;

/// Largest integer up to which every integer has an exact `f64`.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// Reads all elements. Yields the number of bytes after them, without blanks at the end.
pub(super) fn read_body(
    bytes: &[u8],
    header: &Header,
    roles: &Roles,
    contents: &mut Contents,
) -> Result<u64, Failure> {
    let mut lines = Lines { bytes, at: header.length, line: header.lines, line_end: header.line_end };
    for (element, role) in header.elements.iter().zip(&roles.roles) {
        // A record without properties has no line.
        if element.count == 0 || element.properties.is_empty() {
            continue;
        }
        check_length(element, &lines)?;
        match *role {
            Role::Vertices(columns) => {
                contents.vertices = Vertices::with_capacity(&columns, element.count as usize);
                let vertices = &mut contents.vertices;
                read_records(element, &mut lines, |record| {
                    vertices.push(&columns, |column| record.numbers[record.starts[column]]);
                    Ok(())
                })?;
            }
            Role::Faces(columns) => {
                let mut corners = Vec::new();
                let mut look = FaceLook::default();
                contents.wedges = columns.has_look().then(Wedges::default);
                read_records(element, &mut lines, |record| {
                    corners.clear();
                    for &number in record.items(columns.corners) {
                        corners.push(checked_corner(number as i64, roles.vertex_count)?);
                    }
                    let value = |column: usize| record.numbers[record.starts[column]];
                    if columns.has_look() {
                        look.uvs.clear();
                        look.uvs.extend(
                            columns.uvs.iter().flat_map(|&list| record.items(list)).map(|&x| x as f32),
                        );
                        look.texture = columns.texture.map_or(0, |column| value(column) as i64);
                        look.colour = columns.colour.map(|colour| colour.read(value));
                    }
                    contents.push_look(&corners, &look);
                    Ok(())
                })?;
            }
            Role::Strips(list) => read_records(element, &mut lines, |record| {
                let strips = record.items(list).iter().map(|&number| number as i64);
                contents.push_strips(strips, roles.vertex_count)
            })?,
            Role::Skipped => read_records(element, &mut lines, |_| Ok(()))?,
        }
    }
    Ok(bytes[lines.at..].trim_ascii().len() as u64)
}

/// Least number of bytes of `count` records: a digit and a blank for each number.
fn shortest(element: &Element, count: u64) -> u128 {
    u128::from(count) * element.properties.len() as u128 * 2
}

/// Refuses a number of records that exceeds the rest of the file, before memory is allocated.
fn check_length(element: &Element, lines: &Lines<'_>) -> Result<(), Failure> {
    // The last line may lack its line end.
    let remaining = (lines.bytes.len() - lines.at) as u128 + 1;
    let missing = shortest(element, element.count).saturating_sub(remaining);
    if missing == 0 {
        return Ok(());
    }
    Err((PlyPlace::Line(element.line), truncated(element, missing)))
}

fn truncated(element: &Element, missing: u128) -> PlyProblem {
    PlyProblem::Truncated {
        element: element.name.clone(),
        declared: element.count,
        missing: u64::try_from(missing).unwrap_or(u64::MAX),
        exact: false,
    }
}

/// The lines of the body.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Number of the last line that was read, from 1.
    line: usize,
    line_end: LineEnd,
}

impl<'a> Lines<'a> {
    /// The next non-blank line.
    fn next(&mut self) -> Option<&'a [u8]> {
        while self.at < self.bytes.len() {
            let rest = &self.bytes[self.at..];
            let length = rest.iter().position(|&byte| byte == self.line_end.byte()).unwrap_or(rest.len());
            self.at = (self.at + length + 1).min(self.bytes.len());
            self.line += 1;
            let line = rest[..length].trim_ascii();
            if !line.is_empty() {
                return Some(line);
            }
        }
        None
    }
}

/// The numbers of one line.
#[derive(Default)]
struct Record {
    /// All numbers, including the lengths of lists.
    numbers: Vec<f64>,
    /// For each property the index of its number, or of the length of its list.
    starts: Vec<usize>,
}

impl Record {
    /// The items of a list.
    fn items(&self, property: usize) -> &[f64] {
        let start = self.starts[property];
        let end = self.starts.get(property + 1).copied().unwrap_or(self.numbers.len());
        &self.numbers[start + 1..end]
    }

    fn read(&mut self, element: &Element, line: &[u8]) -> Result<(), PlyProblem> {
        self.numbers.clear();
        self.starts.clear();
        let mut tokens = line.split(u8::is_ascii_whitespace).filter(|token| !token.is_empty());
        for property in &element.properties {
            self.starts.push(self.numbers.len());
            let expected = self.numbers.len() as u64 + 1;
            let mut number = |scalar, expected| {
                tokens
                    .next()
                    .ok_or(PlyProblem::ShortLine(expected))
                    .and_then(|token| parse_number(token, scalar))
            };
            match property.kind {
                PropertyType::Scalar(scalar) => self.numbers.push(number(scalar, expected)?),
                PropertyType::List(count, item) => {
                    let length = number(count, expected)?;
                    if length < 0.0 {
                        return Err(PlyProblem::NegativeLength(length as i64));
                    }
                    self.numbers.push(length);
                    // Stops at the end of the line, whatever length the list declares.
                    for _ in 0..length as u64 {
                        self.numbers.push(number(item, expected + length as u64)?);
                    }
                }
            }
        }
        match tokens.next() {
            None => Ok(()),
            Some(_) => Err(PlyProblem::LongLine(self.numbers.len() as u64)),
        }
    }
}

/// Reads the lines of an element.
fn read_records(
    element: &Element,
    lines: &mut Lines<'_>,
    mut visit: impl FnMut(&Record) -> Result<(), PlyProblem>,
) -> Result<(), Failure> {
    let mut record = Record::default();
    for index in 0..element.count {
        let line = lines.next();
        let result = match line {
            Some(line) => record.read(element, line).and_then(|()| visit(&record)),
            None => Err(truncated(element, shortest(element, element.count - index).saturating_sub(1))),
        };
        if let Err(problem) = result {
            let place = PlyPlace::RecordLine { element: element.name.clone(), index, line: lines.line };
            return Err((place, problem));
        }
    }
    Ok(())
}

/// A number, rounded to its type. The forms of NaN and infinity that C libraries print are accepted.
fn parse_number(token: &[u8], scalar: ScalarType) -> Result<f64, PlyProblem> {
    let text = std::str::from_utf8(token).unwrap_or("");
    let number = match scalar {
        // Parsed directly as `f32`: a conversion by way of `f64` would round twice.
        ScalarType::F32 => text.parse::<f32>().ok().map(f64::from),
        _ => text.parse::<f64>().ok(),
    };
    let expected = if scalar.is_integer() { "an integer" } else { "a number" };
    match number {
        Some(number) if !scalar.is_integer() || (number.fract() == 0.0 && number.abs() <= EXACT) => {
            Ok(number)
        }
        None if !scalar.is_integer() && is_not_a_number(text) => Ok(f64::NAN),
        _ => {
            let token = String::from_utf8_lossy(&token[..token.len().min(SHOWN)]).into_owned();
            Err(PlyProblem::BadNumber { token, expected })
        }
    }
}

/// `-nan(ind)`, `nan(0x8)`, `1.#QNAN`, `-1.#IND`.
fn is_not_a_number(text: &str) -> bool {
    let unsigned = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    unsigned.starts_with("nan(") || unsigned.starts_with("1.#")
}
