//! Parses the text of a file to a tree of elements with their places.

use super::error::{Fault, Place, Sources, fail, fault};
use crate::scene_file::description::Location;
use crate::scene_file::diagnostic::SourceText;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Deepest nesting of elements; no real scene is deeper.
const DEEPEST: usize = 64;

/// Most elements, attributes and texts of a file.
const MOST_NODES: u32 = 1 << 22;

/// An element.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub tag: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
    pub place: Place,
}

impl Element {
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }
}

/// Parses a text and yields its root element; messages call the file `path`.
pub(super) fn parse(sources: &mut Sources, path: PathBuf, text: String) -> Result<Element, Fault> {
    let file = sources.add(path, text);
    let Some((path, text)) = sources.get(file) else {
        return fail(&Place::default(), "there is no such file", "");
    };
    let source = SourceText::new(text, path);
    let options = roxmltree::ParsingOptions { nodes_limit: MOST_NODES, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(text, options)
        .map_err(|error| not_xml(file, text, path, &error))?;
    let root = document.root_element();
    convert(root, file, &source, 0)
}

/// The parser's error, with its place.
fn not_xml(file: usize, text: &str, path: &Path, error: &roxmltree::Error) -> Fault {
    let position = error.pos();
    let start: usize =
        text.split_inclusive('\n').take((position.row as usize).saturating_sub(1)).map(str::len).sum();
    let line = text.get(start..).unwrap_or_default();
    let within: usize =
        line.chars().take((position.col as usize).saturating_sub(1)).map(char::len_utf8).sum();
    let at = (start + within).min(text.len());
    let location = Location {
        file: Arc::new(path.to_path_buf()),
        line: position.row as usize,
        column: position.col as usize,
    };
    let place = Place { file, span: at..(at + 1).min(text.len()), location };
    // The place states the position already.
    let mut message = error.to_string();
    if let Some((what, _)) = message.rsplit_once(" at ") {
        message.truncate(what.len());
    }
    let remedy = match error {
        roxmltree::Error::DtdDetected => {
            "scenes have no DTD and no entities of their own: take the `<!DOCTYPE ...>` out, and write `<default>` with `$name`"
        }
        roxmltree::Error::NodesLimitReached => "move meshes into files of their own (OBJ, PLY)",
        _ => "mend the line, or write the file again",
    };
    fault(&place, format!("not XML: {message}"), remedy)
}

fn convert(
    node: roxmltree::Node<'_, '_>,
    file: usize,
    source: &SourceText<'_>,
    depth: usize,
) -> Result<Element, Fault> {
    let span = node.range();
    let place = Place { file, location: source.location(span.start), span };
    if depth >= DEEPEST {
        let message = format!("elements are nested deeper than {DEEPEST}");
        return fail(&place, message, "define objects at the top, and name them by `<ref id=\"...\"/>`");
    }
    let mut children = Vec::new();
    for child in node.children() {
        if child.is_element() {
            children.push(convert(child, file, source, depth + 1)?);
        } else if child.is_text() && child.text().is_some_and(|text| !text.trim().is_empty()) {
            let span = child.range();
            let blank = source.slice(&span).len() - source.slice(&span).trim_start().len();
            let span = span.start + blank..span.end;
            let place = Place { file, location: source.location(span.start), span };
            return fail(
                &place,
                "text between elements has no meaning here",
                "write it as a comment: <!-- ... -->",
            );
        }
    }
    let attributes = node
        .attributes()
        .map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned()))
        .collect();
    Ok(Element { tag: node.tag_name().name().to_owned(), attributes, children, place })
}
