//! Reads the arguments of directives from a text.

use super::error::{Fault, Place, fail};
use super::object::{KINDS, Parameter, Values};
use super::text::shown;
use super::token::{Broken, Found, Token, Tokens};
use crate::scene_file::diagnostic::{SourceText, suggestion};
use std::ops::Range;
use std::path::Path;

/// Most parameters of a directive.
const MOST_PARAMETERS: usize = 1024;

/// A text while it is read.
pub(super) struct File<'a> {
    tokens: Tokens<'a>,
    source: SourceText<'a>,
    number: usize,
}

impl<'a> File<'a> {
    /// A text with its number in the list of sources; messages call it `path`.
    pub(super) fn new(text: &'a str, path: &Path, number: usize) -> Self {
        Self { tokens: Tokens::new(text), source: SourceText::new(text, path), number }
    }

    fn place(&self, span: Range<usize>) -> Place {
        Place { file: self.number, location: self.source.location(span.start), span }
    }

    fn broken<T>(&self, (span, message, remedy): Broken) -> Result<T, Fault> {
        fail(&self.place(span), message, remedy)
    }

    fn next(&mut self) -> Result<Option<Found<'a>>, Fault> {
        let next = self.tokens.next();
        next.or_else(|broken| self.broken(broken))
    }

    /// Whether the next word is this kind of token.
    fn comes(&mut self, is: impl Fn(&Token<'_>) -> bool) -> Result<bool, Fault> {
        match self.tokens.peek() {
            Ok(next) => Ok(next.is_some_and(|(token, _)| is(token))),
            Err(broken) => self.broken(broken),
        }
    }

    /// The next directive and its place; `None` at the end of the text.
    pub(super) fn directive(&mut self) -> Result<Option<(&'a str, Place)>, Fault> {
        let Some((token, span)) = self.next()? else { return Ok(None) };
        let place = self.place(span);
        match token {
            Token::Word(word) => Ok(Some((word, place))),
            Token::Quoted(text) => fail(
                &place,
                format!("the text \"{}\" stands where a directive is expected", shown(&text)),
                "write parameters behind the directive that they belong to",
            ),
            Token::Open | Token::Close => {
                fail(&place, "a bracket stands where a directive is expected", "take it out")
            }
        }
    }

    /// A word without quotes behind the directive at `place`.
    pub(super) fn word(&mut self, place: &Place, wanted: &str) -> Result<&'a str, Fault> {
        match self.next()? {
            Some((Token::Word(word), _)) => Ok(word),
            _ => fail(place, format!("{wanted} is missing"), format!("write {wanted} behind it")),
        }
    }

    /// A quoted text behind the directive at `place`.
    pub(super) fn quoted(&mut self, place: &Place, wanted: &str) -> Result<String, Fault> {
        match self.next()? {
            Some((Token::Quoted(text), _)) => Ok(text.into_owned()),
            Some((_, span)) => {
                let place = self.place(span);
                fail(
                    &place,
                    format!("{wanted} in quotation marks is expected here"),
                    "write for example \"a\"",
                )
            }
            None => fail(place, format!("{wanted} is missing"), "write it in quotation marks behind it"),
        }
    }

    /// A quoted text, if there is another.
    pub(super) fn more_quoted(&mut self) -> Result<Option<String>, Fault> {
        if !self.comes(|token| matches!(token, Token::Quoted(_)))? {
            return Ok(None);
        }
        Ok(match self.next()? {
            Some((Token::Quoted(text), _)) => Some(text.into_owned()),
            _ => None,
        })
    }

    fn number(&self, word: &str, span: Range<usize>) -> Result<f64, Fault> {
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => {
                let place = self.place(span);
                let message = format!("`{}` is no number", shown(word));
                fail(&place, message, "write a number in its place, for example 0.5")
            }
        }
    }

    /// `N` numbers behind the directive at `place`, in brackets or not.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        directive: &str,
        place: &Place,
    ) -> Result<[f64; N], Fault> {
        let mut numbers = [0.0; N];
        let is_list = self.comes(|token| *token == Token::Open)?;
        if is_list {
            self.next()?;
        }
        let missing = |at: &Place| {
            let message = format!("`{directive}` takes {N} numbers");
            fail(at, message, "write as many behind it")
        };
        for value in &mut numbers {
            match self.next()? {
                Some((Token::Word(word), span)) => *value = self.number(word, span)?,
                Some((_, span)) => return missing(&self.place(span)),
                None => return missing(place),
            }
        }
        if is_list {
            match self.next()? {
                Some((Token::Close, _)) => {}
                Some((_, span)) => return missing(&self.place(span)),
                None => return missing(place),
            }
        }
        Ok(numbers)
    }

    /// The parameters that follow.
    pub(super) fn parameters(&mut self) -> Result<Vec<Parameter>, Fault> {
        let mut parameters = Vec::new();
        while self.comes(|token| matches!(token, Token::Quoted(_)))? {
            parameters.extend(self.parameter()?);
            if let Some(last) = parameters.get(MOST_PARAMETERS) {
                let message = format!("a directive has more than {MOST_PARAMETERS} parameters");
                return fail(&last.place, message, "write several directives");
            }
        }
        Ok(parameters)
    }

    fn parameter(&mut self) -> Result<Option<Parameter>, Fault> {
        let Some((Token::Quoted(declared), span)) = self.next()? else { return Ok(None) };
        let place = self.place(span);
        let mut words = declared.split_whitespace();
        let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
            let message = format!("\"{}\" is no parameter", shown(&declared));
            return fail(&place, message, "write its type and its name, for example \"float radius\" 2");
        };
        let Some(&(kind, _)) = KINDS.iter().find(|(known, _)| *known == kind) else {
            let known: Vec<&str> = KINDS.iter().map(|(known, _)| *known).collect();
            let message = format!("`{}` is no type of parameters", shown(kind));
            return fail(&place, message, suggestion(kind, &known));
        };
        let values = self.values(kind, name, &place)?;
        Ok(Some(Parameter::new(kind, name.to_owned(), values, place)))
    }

    /// One value, or several in brackets.
    fn values(&mut self, kind: &str, name: &str, place: &Place) -> Result<Values, Fault> {
        let is_list = self.comes(|token| *token == Token::Open)?;
        if is_list {
            self.next()?;
        }
        let (mut numbers, mut texts, mut booleans) = (Vec::new(), Vec::new(), Vec::new());
        let takes_numbers = KINDS.iter().any(|(known, count)| *known == kind && *count > 0);
        let takes_texts = matches!(kind, "string" | "texture" | "spectrum");
        loop {
            let Some((token, span)) = self.next()? else {
                let message = format!("the values of `{}` have no end", shown(name));
                return fail(place, message, "write `]` behind them");
            };
            match token {
                Token::Close if is_list => break,
                Token::Word(word) if takes_numbers && texts.is_empty() => {
                    numbers.push(self.number(word, span)?)
                }
                Token::Quoted(text) if takes_texts && numbers.is_empty() => texts.push(text.into_owned()),
                Token::Word("true") if kind == "bool" => booleans.push(true),
                Token::Word("false") if kind == "bool" => booleans.push(false),
                // As in pbrt-v3.
                Token::Quoted(text) if kind == "bool" && matches!(&*text, "true" | "false") => {
                    booleans.push(text == "true");
                }
                _ => {
                    let message = format!("this is no value of `{}`, which is of type `{kind}`", shown(name));
                    let remedy = match (takes_numbers, kind) {
                        (_, "bool") => "write true or false",
                        (true, _) => "write numbers, several in brackets: [ 1 2 3 ]",
                        (false, _) => "write texts in quotation marks",
                    };
                    return fail(&self.place(span), message, remedy);
                }
            }
            if !is_list {
                break;
            }
        }
        Ok(match (kind, numbers.is_empty(), texts.is_empty()) {
            ("bool", ..) => Values::Booleans(booleans),
            (_, _, false) | ("string" | "texture", ..) => Values::Texts(texts),
            _ => Values::Numbers(numbers),
        })
    }
}
