//! The words of a scene's text: directives, numbers, quoted strings and brackets.

use std::borrow::Cow;
use std::ops::Range;

/// Longest string, in bytes: names are kept in many places.
const LONGEST: usize = 1 << 14;

/// A word of the text.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A string, without its quotes.
    Quoted(Cow<'a, str>),
    /// A directive or a number.
    Word(&'a str),
    /// `[`
    Open,
    /// `]`
    Close,
}

/// A word and its bytes in the text.
pub(super) type Found<'a> = (Token<'a>, Range<usize>);

/// Why there is no next word: the bytes, what is wrong, and what to do.
pub(super) type Broken = (Range<usize>, String, &'static str);

/// Splits a text into its words.
#[derive(Debug)]
pub(super) struct Tokens<'a> {
    text: &'a str,
    at: usize,
    ahead: Option<Found<'a>>,
}

/// Whether a byte ends a word that is not quoted.
fn ends_word(byte: u8) -> bool {
    byte.is_ascii_whitespace() || matches!(byte, b'"' | b'[' | b']')
}

impl<'a> Tokens<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { text, at: 0, ahead: None }
    }

    /// The next word, which stays the next one; `None` at the end.
    pub(super) fn peek(&mut self) -> Result<Option<&Found<'a>>, Broken> {
        if self.ahead.is_none() {
            self.ahead = self.scan()?;
        }
        Ok(self.ahead.as_ref())
    }

    /// The next word; `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<Found<'a>>, Broken> {
        match self.ahead.take() {
            Some(found) => Ok(Some(found)),
            None => self.scan(),
        }
    }

    fn scan(&mut self) -> Result<Option<Found<'a>>, Broken> {
        let bytes = self.text.as_bytes();
        loop {
            match bytes.get(self.at) {
                None => return Ok(None),
                Some(b'#') => {
                    let rest = &bytes[self.at..];
                    let end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
                    self.at += end.unwrap_or(rest.len());
                }
                Some(byte) if byte.is_ascii_whitespace() => self.at += 1,
                Some(_) => break,
            }
        }
        let start = self.at;
        let single = match bytes[start] {
            b'"' => return self.quoted(start).map(Some),
            b'[' => Some(Token::Open),
            b']' => Some(Token::Close),
            _ => None,
        };
        if let Some(token) = single {
            self.at += 1;
            return Ok(Some((token, start..self.at)));
        }
        let rest = &bytes[start..];
        self.at += rest.iter().position(|byte| ends_word(*byte)).unwrap_or(rest.len());
        let span = start..self.at;
        Ok(Some((Token::Word(self.text.get(span.clone()).unwrap_or_default()), span)))
    }

    fn quoted(&mut self, start: usize) -> Result<Found<'a>, Broken> {
        let bytes = self.text.as_bytes();
        let mut at = start + 1;
        let mut escapes = false;
        loop {
            match bytes.get(at) {
                Some(b'"') => break,
                Some(b'\\') => {
                    escapes = true;
                    at += 2;
                }
                Some(b'\n') | None => {
                    let message = "the string has no closing quotation mark in its line".to_owned();
                    return Err((start..at.min(bytes.len()), message, "write `\"` at its end"));
                }
                Some(_) => at += 1,
            }
        }
        if at - start > LONGEST {
            let message = format!("the string is longer than {LONGEST} bytes");
            return Err((start..start + 1, message, "use a shorter name"));
        }
        self.at = at + 1;
        let inner = self.text.get(start + 1..at).unwrap_or_default();
        let span = start..self.at;
        if !escapes {
            return Ok((Token::Quoted(Cow::Borrowed(inner)), span));
        }
        let mut text = String::with_capacity(inner.len());
        let mut characters = inner.chars();
        while let Some(c) = characters.next() {
            match c {
                '\\' => text.push(match characters.next() {
                    Some('n') => '\n',
                    Some('t') => '\t',
                    Some('r') => '\r',
                    Some('b') => '\u{8}',
                    Some('f') => '\u{c}',
                    Some(other @ ('\\' | '\'' | '"')) => other,
                    _ => {
                        let message = "the string has a `\\` before a character that it cannot escape";
                        return Err((span, message.to_owned(), "write `\\\\` for the character itself"));
                    }
                }),
                other => text.push(other),
            }
        }
        Ok((Token::Quoted(Cow::Owned(text)), span))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_strings_brackets_and_comments() {
        let mut tokens = Tokens::new("Shape\"sphere\" #not this\n[1 -2.5e3]\t\"a\\\"b\"");
        let mut words = Vec::new();
        while let Some((token, _)) = tokens.next().unwrap() {
            words.push(token);
        }
        let quoted = |text: &'static str| Token::Quoted(Cow::Borrowed(text));
        let wanted = [
            Token::Word("Shape"),
            quoted("sphere"),
            Token::Open,
            Token::Word("1"),
            Token::Word("-2.5e3"),
            Token::Close,
            quoted("a\"b"),
        ];
        assert_eq!(words, wanted);
    }

    #[test]
    fn broken_strings_are_refused() {
        for text in ["\"a", "\"a\nb\"", "\"\\", "\"\\x\"", "\"\\é\""] {
            assert!(Tokens::new(text).next().is_err(), "{text}");
        }
    }
}
