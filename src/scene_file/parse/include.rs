//! `include = ["library.toml"]`: further files whose materials, media, textures, shapes, instances and lights belong to the scene.

use super::MAX_TEXT_BYTES;
use crate::files::{read_regular, text_of};
use crate::scene_file::diagnostic::{Diagnostic, SourceText};
use crate::scene_file::parameters::Parameters;
use crate::scene_file::reader::{Context, Table, Value};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use toml::de::DeTable;

/// Most files that a scene includes, and how deeply they include each other.
const MOST_FILES: usize = 64;
const MOST_DEPTH: usize = 16;

/// The text of an included file.
#[derive(Debug)]
pub(super) struct Included {
    pub(super) file: PathBuf,
    pub(super) text: String,
}

/// What was included, and what was wrong with files that are no TOML.
#[derive(Debug, Default)]
pub(super) struct Library {
    /// Each file once, after those that it includes.
    pub(super) files: Vec<Included>,
    /// Errors in included files.
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Files by their full names.
    seen: Vec<PathBuf>,
    bytes: u64,
}

impl Library {
    /// Reads what a table includes. Errors at the table are recorded in its context.
    pub(super) fn read(&mut self, table: &mut Table<'_>, depth: usize) -> Option<()> {
        let Some(value) = table.get("include") else { return Some(()) };
        if depth == 0 {
            // A file that includes the scene's own does not add it a second time.
            self.seen.extend(table.context().file().canonicalize());
        }
        let paths: Vec<Value<'_>> = if value.is_string() {
            vec![value]
        } else {
            value.list("a list of paths", "[\"materials.toml\"]")?.collect()
        };
        for path in paths {
            self.add(path, depth);
        }
        Some(())
    }

    fn add(&mut self, value: Value<'_>, depth: usize) -> Option<()> {
        let context = value.context();
        let path = value.path()?;
        let refuse = |message: String, remedy: &str| {
            context.error(&value.span(), message, remedy);
        };
        let whole = path.canonicalize().unwrap_or_else(|_| path.clone());
        if whole == context.file().canonicalize().unwrap_or_default() {
            refuse(format!("{} includes itself", path.display()), "leave it out");
            return None;
        }
        if self.seen.contains(&whole) {
            return Some(());
        }
        if depth >= MOST_DEPTH || self.seen.len() >= MOST_FILES {
            let message = format!(
                "{}: more than {MOST_FILES} files, or {MOST_DEPTH} that include each other",
                path.display()
            );
            refuse(message, "put what they hold into fewer files");
            return None;
        }
        self.seen.push(whole);
        let bytes = match read_regular(&path, MAX_TEXT_BYTES - self.bytes) {
            Ok(bytes) => bytes,
            Err(error) => {
                let remedy =
                    "paths are relative to the file that includes; all files have at most 8 MiB together";
                refuse(format!("{} cannot be read: {error}", path.display()), remedy);
                return None;
            }
        };
        self.bytes += bytes.len() as u64;
        let text = text_of(&bytes).map_or(None, |text| std::str::from_utf8(&text).map(str::to_owned).ok());
        let Some(text) = text else {
            refuse(
                format!("{} is not UTF-8 text", path.display()),
                "include scene files: TOML text in UTF-8",
            );
            return None;
        };
        self.nested(&path, &text, &context.parameters, depth + 1);
        self.files.push(Included { file: path, text });
        Some(())
    }

    /// Reads what an included file includes.
    fn nested(&mut self, path: &Path, text: &str, parameters: &Rc<Parameters>, depth: usize) {
        let (root, _) = DeTable::parse_recoverable(text);
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let mut context = Context::new(SourceText::new(text, path), folder);
        context.parameters = Rc::clone(parameters);
        let mut table = Table::new(&context, root.get_ref(), 0..0, "the included file");
        self.read(&mut table, depth);
        drop(table);
        self.diagnostics.extend(context.into_findings().diagnostics);
    }
}
