//! Normalization of texts from all systems: byte-order marks, line ends, and detection of UTF-16 and UTF-32.

use rayon::prelude::*;
use std::borrow::Cow;

/// The byte-order mark that some programs write before a text in UTF-8.
pub const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Bytes per parallel task.
const PIECE: usize = 1 << 20;

/// Bytes at the start of a text without a mark that are examined for UTF-16.
const START: usize = 64;

/// The bytes of a text whose lines end in a line feed, possibly after a carriage return. A byte-order mark is removed, and each carriage
/// return without a line feed becomes a line feed. The text is copied only where it has such a carriage return.
///
/// # Errors
/// If the text has two or four bytes per character. The error names the encoding and a remedy.
pub fn text_of(bytes: &[u8]) -> Result<Cow<'_, [u8]>, &'static str> {
    if let Some(encoding) = wide(bytes) {
        return Err(encoding);
    }
    let text = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let is_lone = |at: usize| text[at] == b'\r' && text.get(at + 1) != Some(&b'\n');
    let has_lone = text.par_chunks(PIECE).enumerate().any(|(piece, bytes)| {
        bytes.contains(&b'\r') && (0..bytes.len()).any(|at| is_lone(piece * PIECE + at))
    });
    if !has_lone {
        return Ok(Cow::Borrowed(text));
    }
    let ended = |at: usize| if is_lone(at) { b'\n' } else { text[at] };
    Ok(Cow::Owned((0..text.len()).into_par_iter().map(ended).collect()))
}

/// Message for a text in UTF-16 or UTF-32, with a remedy; `None` for other texts.
pub(super) fn wide(bytes: &[u8]) -> Option<&'static str> {
    const UTF16: &str =
        "is text in UTF-16, and texts are read in UTF-8: save it as UTF-8 (`iconv -f UTF-16 -t UTF-8`)";
    const UTF32: &str =
        "is text in UTF-32, and texts are read in UTF-8: save it as UTF-8 (`iconv -f UTF-32 -t UTF-8`)";
    if bytes.starts_with(b"\xff\xfe\0\0") || bytes.starts_with(b"\0\0\xfe\xff") {
        return Some(UTF32);
    }
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Some(UTF16);
    }
    // Without a mark, UTF-16 shows as alternating ASCII characters and zeros.
    let start = &bytes[..bytes.len().min(START) / 2 * 2];
    let of_pairs = |zero: usize| {
        start.len() >= 8
            && start
                .chunks_exact(2)
                .all(|pair| pair[zero] == 0 && matches!(pair[1 - zero], b' '..=b'~' | b'\t' | b'\r' | b'\n'))
    };
    (of_pairs(0) || of_pairs(1)).then_some(UTF16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_line_feeds() {
        for (bytes, text) in [
            (&b"a\nb\r\nc"[..], &b"a\nb\r\nc"[..]),
            (b"\xef\xbb\xbfa\nb", b"a\nb"),
            (b"a\rb\r\rc\r", b"a\nb\n\nc\n"),
            (b"a\rb\r\nc", b"a\nb\r\nc"),
            (b"", b""),
        ] {
            assert_eq!(&*text_of(bytes).unwrap(), text);
        }
        assert!(matches!(text_of(b"a\r\nb\r\n"), Ok(Cow::Borrowed(_))));
        // A carriage return and line feed that two pieces share are still a pair.
        let mut long = vec![b'x'; PIECE - 1];
        long.extend(b"\r\ny");
        assert!(matches!(text_of(&long), Ok(Cow::Borrowed(_))));
        long[PIECE] = b'\r';
        assert_eq!(text_of(&long).unwrap()[PIECE - 1..], *b"\n\ny");
    }

    #[test]
    fn wide_texts_are_refused() {
        let wide = |text: &str, mark: &[u8], little: bool| {
            let pairs = text
                .encode_utf16()
                .flat_map(|unit| if little { unit.to_le_bytes() } else { unit.to_be_bytes() });
            mark.iter().copied().chain(pairs).collect::<Vec<u8>>()
        };
        for (mark, little) in [(&b"\xff\xfe"[..], true), (b"\xfe\xff", false), (b"", true), (b"", false)] {
            assert!(text_of(&wide("v 0 0 0\nv 1 0 0\n", mark, little)).unwrap_err().contains("UTF-16"));
        }
        assert!(text_of(b"\xff\xfe\0\0v\0\0\0").unwrap_err().contains("UTF-32"));
        assert!(text_of(b"v 0 0 0").is_ok());
    }
}
