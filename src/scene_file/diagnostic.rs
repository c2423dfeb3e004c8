//! Diagnostics for scene files: the place, the problem, the remedy, and the source line itself.

use super::description::Location;
use super::synonyms::synonym;
use crate::files::ForeignFile;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most errors of a file that are shown; the rest are only counted.
const SHOWN: usize = 20;

/// Longest message and remedy, in characters: names in a file may have any length.
const MESSAGE_LENGTH: usize = 600;

/// Longest name, in bytes, that is compared: the cost of a distance is the product of the lengths.
const COMPARED_LENGTH: usize = 64;

/// Most names that are compared.
const COMPARED_NAMES: usize = 2000;

/// Bytes of text between two entries of the character index.
const CHARACTER_STRIDE: usize = 1024;

/// Longest piece of a source line that a message repeats, in characters.
const EXCERPT_WIDTH: usize = 100;

/// One problem of a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Where.
    pub location: Location,
    /// The problem, and what was expected.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
    /// The source line and carets below the relevant part; `None` where the whole file is meant.
    excerpt: Option<(String, String)>,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.location, self.message)?;
        if let Some((line, carets)) = &self.excerpt {
            let number = self.location.line.to_string();
            let margin = " ".repeat(number.len());
            write!(f, "\n  {number} | {line}\n  {margin} | {carets}")?;
        }
        if !self.remedy.is_empty() {
            write!(f, "\n  help: {}", self.remedy)?;
        }
        Ok(())
    }
}

/// Why a scene file was refused.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// The file could not be read at all.
    #[error("{}: cannot be read: {source}; {remedy}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The file is not text in UTF-8.
    #[error("{location}: not UTF-8 text (byte 0x{byte:02x}); a scene file is TOML text, save it as UTF-8")]
    NotUtf8 {
        /// Where the first wrong byte is.
        location: Location,
        /// The byte.
        byte: u8,
    },
    /// The file is longer than any scene text should be.
    #[error(
        "{}: {bytes} bytes of scene text, and at most {limit} are read; move meshes into files of their own, PLY, OBJ or STL \
         (`type = \"mesh\"`, `file = \"...\"`)",
        path.display()
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// The longest that is read.
        limit: u64,
    },
    /// The file is of another kind.
    #[error("{}: {kind}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Kind of the file, and what to do.
        kind: ForeignFile,
    },
    /// The text is not TOML.
    #[error("{}", Several(diagnostics, *more))]
    NotToml {
        /// The errors, in the order of the file.
        diagnostics: Vec<Diagnostic>,
        /// Number of further errors.
        more: u64,
    },
    /// The text is valid TOML, but not a valid scene.
    #[error("{}", Several(diagnostics, *more))]
    Invalid {
        /// The errors, in the order of the file.
        diagnostics: Vec<Diagnostic>,
        /// Number of further errors.
        more: u64,
    },
}

/// Displays a list of diagnostics up to a readable length.
struct Several<'a>(&'a [Diagnostic], u64);

impl fmt::Display for Several<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, diagnostic) in self.0.iter().take(SHOWN).enumerate() {
            let separator = if index == 0 { "" } else { "\n" };
            write!(f, "{separator}{diagnostic}")?;
        }
        match self.0.len().saturating_sub(SHOWN) as u64 + self.1 {
            0 => Ok(()),
            more => write!(f, "\n... and {more} more"),
        }
    }
}

/// Text of a file with an index of its lines.
#[derive(Debug)]
pub(super) struct SourceText<'a> {
    text: &'a str,
    file: Arc<PathBuf>,
    /// Offset of the first byte of each line.
    line_starts: Vec<usize>,
    /// Number of characters that begin before each multiple of [`CHARACTER_STRIDE`]. A file may be one long line, where counting
    /// from the start for each place would take too long.
    characters: Vec<usize>,
}

impl<'a> SourceText<'a> {
    /// The file.
    pub(super) fn file(&self) -> &Path {
        &self.file
    }

    pub(super) fn new(text: &'a str, file: &Path) -> Self {
        let ends = text.bytes().enumerate().filter(|&(_, byte)| byte == b'\n').map(|(at, _)| at + 1);
        let line_starts = std::iter::once(0).chain(ends).collect();
        let mut characters = vec![0];
        let mut count = 0;
        for chunk in text.as_bytes().chunks(CHARACTER_STRIDE) {
            count += count_characters(chunk);
            characters.push(count);
        }
        Self { text, file: Arc::new(file.to_path_buf()), line_starts, characters }
    }

    /// Number of characters that begin before byte `offset`.
    fn characters_before(&self, offset: usize) -> usize {
        let block = offset / CHARACTER_STRIDE;
        let rest = &self.text.as_bytes()[block * CHARACTER_STRIDE..offset];
        self.characters[block] + count_characters(rest)
    }

    /// The place that stands for the whole file.
    pub(super) fn whole(&self) -> Location {
        Location { file: Arc::clone(&self.file), line: 0, column: 0 }
    }

    /// Line and column of a byte offset; an offset beyond the end means the end.
    pub(super) fn location(&self, offset: usize) -> Location {
        let offset = offset.min(self.text.len());
        let (line, start) = self.line_of(offset);
        let column = self.characters_before(offset) - self.characters_before(start) + 1;
        Location { file: Arc::clone(&self.file), line: line + 1, column }
    }

    /// The text between two byte offsets.
    pub(super) fn slice(&self, span: &Range<usize>) -> &'a str {
        self.text.get(span.clone()).unwrap_or_default()
    }

    pub(super) fn diagnostic(&self, span: &Range<usize>, message: String, remedy: String) -> Diagnostic {
        let location = self.location(span.start);
        let excerpt = Some(self.excerpt(span));
        Diagnostic { location, message: cut(message), remedy: cut(remedy), excerpt }
    }

    pub(super) fn diagnostic_of_file(&self, message: String, remedy: String) -> Diagnostic {
        Diagnostic { location: self.whole(), message: cut(message), remedy: cut(remedy), excerpt: None }
    }

    /// Index (from 0) and first byte of the line around `offset`.
    fn line_of(&self, offset: usize) -> (usize, usize) {
        let line = self.line_starts.partition_point(|&start| start <= offset).saturating_sub(1);
        (line, self.line_starts.get(line).copied().unwrap_or(0))
    }

    /// The first line of `span`, cut to a readable width, and carets below the span.
    fn excerpt(&self, span: &Range<usize>) -> (String, String) {
        let (_, start) = self.line_of(span.start);
        let rest = self.text.get(start..).unwrap_or_default();
        let line = rest.lines().next().unwrap_or_default();
        let column = self.location(span.start).column - 1;
        let length = self.slice(span).lines().next().unwrap_or_default().trim_end().chars().count().max(1);
        // In a long line the window is placed so that the span is visible.
        let skipped = column.saturating_sub(EXCERPT_WIDTH / 2);
        let shown: String =
            line.chars().skip(skipped).take(EXCERPT_WIDTH).map(|c| if c == '\t' { ' ' } else { c }).collect();
        let indent = column - skipped;
        let width = length.min(EXCERPT_WIDTH.saturating_sub(indent)).max(1);
        (shown, format!("{}{}", " ".repeat(indent), "^".repeat(width)))
    }
}

fn count_characters(text: &[u8]) -> usize {
    // Counts bytes that are not UTF-8 continuation bytes: one for each character.
    text.iter().filter(|&&byte| byte & 0xc0 != 0x80).count()
}

fn cut(mut message: String) -> String {
    if let Some((end, _)) = message.char_indices().nth(MESSAGE_LENGTH) {
        message.truncate(end);
        message.push_str(" ...");
    }
    message
}

/// The known name nearest to `name`, if one is close enough to be a misspelling.
pub(super) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if name.len() > COMPARED_LENGTH {
        return None;
    }
    let allowed = (name.chars().count() / 3).max(2);
    let known = known.into_iter().take(COMPARED_NAMES).filter(|other| other.len() <= COMPARED_LENGTH);
    let distances = known.map(|other| (strsim::damerau_levenshtein(name, other), other));
    distances
        .filter(|&(distance, _)| distance <= allowed)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, n)| n)
}

/// The known name that other renderers call `name`, or the nearest known name.
pub(super) fn meant<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    synonym(name, known.iter().copied()).or_else(|| nearest(name, known.iter().copied()))
}

/// "did you mean `x`? known: `a`, `b`", or the parts of it that apply.
pub(super) fn suggestion(name: &str, known: &[&str]) -> String {
    const LISTED: usize = 24;
    let meant = meant(name, known).map(|near| format!("did you mean `{near}`? "));
    let listed: Vec<_> = known.iter().take(LISTED).map(|name| format!("`{name}`")).collect();
    let known = match (known.len(), known.len() > LISTED) {
        (0, _) => "there are none yet".to_string(),
        (_, false) => format!("known: {}", listed.join(", ")),
        (count, true) => format!("known: {} and {} more", listed.join(", "), count - LISTED),
    };
    format!("{}{known}", meant.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_characters_and_survive_odd_offsets() {
        let source = SourceText::new("a = 1\nö = \"ß\"\r\n\tx = 2\n", Path::new("s.toml"));
        let at = |offset| {
            let location = source.location(offset);
            (location.line, location.column)
        };
        assert_eq!(at(0), (1, 1));
        assert_eq!(at(6), (2, 1));
        assert_eq!(at(11), (2, 5));
        assert_eq!(at(10_000).0, 4);
        let shown = source.diagnostic(&(11..15), "wrong".into(), "mend it".into()).to_string();
        assert_eq!(shown, "s.toml:2:5: wrong\n  2 | ö = \"ß\"\n    |     ^^^\n  help: mend it");
    }

    #[test]
    fn long_lines_are_cut_around_the_place() {
        let text = format!("{}bad{}", "x".repeat(5000), "y".repeat(5000));
        let source = SourceText::new(&text, Path::new("s.toml"));
        let shown = source.diagnostic(&(5000..5003), "wrong".into(), String::new()).to_string();
        assert!(shown.len() < 400 && shown.contains("xbady") && shown.contains("^^^"), "{shown}");
    }

    #[test]
    fn suggestions_are_near_or_absent() {
        assert_eq!(nearest("reflectence", ["reflectance", "type"]), Some("reflectance"));
        assert_eq!(nearest("zebra", ["reflectance", "type"]), None);
        assert!(suggestion("flip_normal", &["flip-normal", "type"]).contains("did you mean `flip-normal`?"));
    }
}
