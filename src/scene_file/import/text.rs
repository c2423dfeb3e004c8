//! Words and numbers in the text of a file.

use super::error::{Fault, Place, fail};

/// Longest name that a message repeats, in characters.
const SHOWN: usize = 80;

/// A text of the file in the form that messages use.
pub(crate) fn shown(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}

/// The words of a text, which spaces or commas separate.
pub(crate) fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|token| !token.is_empty())
}

/// Parses a finite number.
pub(crate) fn number(text: &str, place: &Place) -> Result<f64, Fault> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => fail(place, format!("`{}` is no number", shown(text)), "write a number, for example 0.5"),
    }
}
