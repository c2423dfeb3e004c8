//! Messages about a scene file: where, what is wrong, what to do, and the line itself.

use super::description::Location;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// At most this many errors of a file are shown; the rest are counted.
const SHOWN: usize = 20;

/// Longest piece of a source line that a message repeats, in characters.
const EXCERPT_WIDTH: usize = 100;

/// One thing wrong with a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Where.
    pub location: Location,
    /// What is wrong, and what was expected.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
    /// The source line and a line of carets below the part in question; absent for the file as a whole.
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
        /// What the system said.
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
        "{}: {bytes} bytes of scene text, and at most {limit} are read; move meshes into PLY files \
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
    /// The text says something wrong: everything that was found, in the order of the file.
    #[error("{}", Several(.0))]
    Invalid(Vec<Diagnostic>),
}

/// Displays a list of diagnostics, cut where nobody would read on.
struct Several<'a>(&'a [Diagnostic]);

impl fmt::Display for Several<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, diagnostic) in self.0.iter().take(SHOWN).enumerate() {
            let separator = if index == 0 { "" } else { "\n" };
            write!(f, "{separator}{diagnostic}")?;
        }
        match self.0.len().checked_sub(SHOWN) {
            None | Some(0) => Ok(()),
            Some(more) => write!(f, "\n... and {more} more"),
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
}

impl<'a> SourceText<'a> {
    pub(super) fn new(text: &'a str, file: &Path) -> Self {
        let ends = text.bytes().enumerate().filter(|&(_, byte)| byte == b'\n').map(|(at, _)| at + 1);
        let line_starts = std::iter::once(0).chain(ends).collect();
        Self { text, file: Arc::new(file.to_path_buf()), line_starts }
    }

    /// The file as a whole.
    pub(super) fn whole(&self) -> Location {
        Location { file: Arc::clone(&self.file), line: 0, column: 0 }
    }

    /// Line and column of a byte offset; offsets beyond the end mean the end.
    pub(super) fn location(&self, offset: usize) -> Location {
        let (line, start) = self.line_of(offset);
        let before = self.text.get(start..offset.min(self.text.len())).unwrap_or_default();
        Location { file: Arc::clone(&self.file), line: line + 1, column: before.chars().count() + 1 }
    }

    /// The text between two byte offsets.
    pub(super) fn slice(&self, span: &Range<usize>) -> &'a str {
        self.text.get(span.clone()).unwrap_or_default()
    }

    pub(super) fn diagnostic(&self, span: &Range<usize>, message: String, remedy: String) -> Diagnostic {
        let location = self.location(span.start);
        let excerpt = Some(self.excerpt(span));
        Diagnostic { location, message, remedy, excerpt }
    }

    pub(super) fn diagnostic_of_file(&self, message: String, remedy: String) -> Diagnostic {
        Diagnostic { location: self.whole(), message, remedy, excerpt: None }
    }

    /// Index (from 0) and first byte of the line around `offset`.
    fn line_of(&self, offset: usize) -> (usize, usize) {
        let line = self.line_starts.partition_point(|&start| start <= offset).saturating_sub(1);
        (line, self.line_starts.get(line).copied().unwrap_or(0))
    }

    /// The first line of `span`, cut to a readable width, and carets under the span's part of it.
    fn excerpt(&self, span: &Range<usize>) -> (String, String) {
        let (_, start) = self.line_of(span.start);
        let rest = self.text.get(start..).unwrap_or_default();
        let line = rest.lines().next().unwrap_or_default();
        let column = self.location(span.start).column - 1;
        let length = self.slice(span).lines().next().unwrap_or_default().trim_end().chars().count().max(1);
        // A window that keeps the span in sight where the line is long.
        let skipped = column.saturating_sub(EXCERPT_WIDTH / 2);
        let shown: String =
            line.chars().skip(skipped).take(EXCERPT_WIDTH).map(|c| if c == '\t' { ' ' } else { c }).collect();
        let indent = column - skipped;
        let width = length.min(EXCERPT_WIDTH.saturating_sub(indent)).max(1);
        (shown, format!("{}{}", " ".repeat(indent), "^".repeat(width)))
    }
}

/// The known name nearest to `name`, where one is near enough to be what was meant.
pub(super) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = (name.chars().count() / 3).max(2);
    let distances = known.into_iter().map(|other| (strsim::damerau_levenshtein(name, other), other));
    distances
        .filter(|&(distance, _)| distance <= allowed)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, n)| n)
}

/// "did you mean `x`? known: `a`, `b`", as far as there is anything to say.
pub(super) fn suggestion(name: &str, known: &[&str]) -> String {
    const LISTED: usize = 24;
    let meant = nearest(name, known.iter().copied()).map(|near| format!("did you mean `{near}`? "));
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
