//! Converts elements to objects. This covers parameters of the command line and `<default>`, `<include>`, `<path>`, `<alias>`,
//! and the values of elements.

use super::error::{Fault, Place, Sources, fail};
use super::report::Subject;
use super::text::shown;
use super::value::{Object, Property};
use super::xml::{self, Element};
use crate::files::{read_regular, text_of};
use crate::scene_file::diagnostic::suggestion;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Longest file that is read, in bytes; meshes are in separate files.
pub(super) const MOST_BYTES: u64 = 64 << 20;

/// Most included files.
const MOST_INCLUDES: usize = 512;

/// Deepest nesting of includes.
const DEEPEST_INCLUDE: usize = 15;

/// Longest value after substitution of parameters, in bytes.
const LONGEST_VALUE: usize = 1 << 20;

/// The content of a file after all includes and substitutions.
pub(super) struct Parsed {
    pub scene: Rc<Object>,
    pub ids: HashMap<String, Rc<Object>>,
    /// Folders in which files are searched, from the last to the first.
    pub folders: Vec<PathBuf>,
    /// Files from which spectra were read.
    pub spectra: Vec<PathBuf>,
}

/// Reads a text as a scene. `defines` are parameters of the command line.
pub(super) fn parse(
    sources: &mut Sources,
    path: &Path,
    text: String,
    defines: &[(String, String)],
) -> Result<Parsed, Fault> {
    let root = xml::parse(sources, path.to_path_buf(), text)?;
    if root.tag != "scene" {
        let message =
            format!("the file begins with <{}>, and a scene of Mitsuba with <scene>", shown(&root.tag));
        return fail(&root.place, message, "name a scene of Mitsuba, or export the model as glTF");
    }
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let mut parser = Parser {
        sources,
        parameters: defines.iter().cloned().collect(),
        unused: defines.iter().map(|(name, _)| name.clone()).collect(),
        ids: HashMap::new(),
        folders: vec![folder],
        spectra: Vec::new(),
        includes: 0,
        depth: 0,
        is_old: is_old(&root)?,
    };
    let properties = parser.parts(&root)?;
    if let Some(name) = parser.unused.first() {
        let names: Vec<&str> =
            parser.parameters.keys().map(String::as_str).filter(|known| known != name).collect();
        let message = format!("the file has no parameter `{}`", shown(name));
        let whole = Place { file: root.place.file, ..Place::default() };
        return fail(&whole, message, suggestion(name, &names));
    }
    let scene = Object {
        tag: root.tag,
        plugin: "scene".to_owned(),
        id: None,
        properties,
        place: root.place,
        is_old: parser.is_old,
    };
    let Parser { ids, folders, spectra, .. } = parser;
    Ok(Parsed { scene: Rc::new(scene), ids, folders, spectra })
}

/// Whether a file has a version before 2.0, with other names for some elements.
fn is_old(root: &Element) -> Result<bool, Fault> {
    let Some(version) = root.attribute("version") else { return Ok(false) };
    let major = version.split('.').next().and_then(|major| major.trim().parse::<u32>().ok());
    match major {
        Some(major) => Ok(major < 2),
        None => {
            let message = format!("`{}` is no version", shown(version));
            fail(&root.place, message, "write for example <scene version=\"3.0.0\">")
        }
    }
}

/// State while files are converted to objects.
pub(super) struct Parser<'a> {
    pub(super) sources: &'a mut Sources,
    pub(super) parameters: BTreeMap<String, String>,
    /// Parameters of the command line that are not used so far.
    pub(super) unused: BTreeSet<String>,
    pub(super) ids: HashMap<String, Rc<Object>>,
    pub(super) folders: Vec<PathBuf>,
    pub(super) spectra: Vec<PathBuf>,
    pub(super) includes: usize,
    pub(super) depth: usize,
    pub(super) is_old: bool,
}

/// Finds the file `name`: at its stated path, or in one of the folders.
pub(super) fn find(folders: &[PathBuf], name: &str) -> Option<PathBuf> {
    let slashed = name.replace('\\', "/");
    let path = Path::new(&slashed);
    if path.is_absolute() {
        return path.is_file().then(|| path.to_path_buf());
    }
    folders.iter().rev().map(|folder| folder.join(path)).find(|path| path.is_file())
}

impl Parser<'_> {
    /// `text` after substitution of its `$parameters`.
    fn substituted(&mut self, text: &str, place: &Place) -> Result<String, Fault> {
        if !text.contains('$') {
            return Ok(text.to_owned());
        }
        let mut parts = text.split('$');
        let mut result = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            // The longest name is taken: $resx is not $res followed by an x.
            let known = part
                .char_indices()
                .map(|(at, c)| at + c.len_utf8())
                .take(200)
                .filter_map(|end| self.parameters.get_key_value(&part[..end]))
                .last();
            let Some((name, value)) = known else {
                let name: String = part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let names: Vec<&str> = self.parameters.keys().map(String::as_str).collect();
                let message = format!("the parameter `${}` has no value", shown(&name));
                let remedy = format!(
                    "write <default name=\"{0}\" value=\"...\"/> before, or -D {0}=VALUE; {1}",
                    shown(&name),
                    suggestion(&name, &names)
                );
                return fail(place, message, remedy);
            };
            self.unused.remove(name);
            result.push_str(value);
            result.push_str(&part[name.len()..]);
            if result.len() > LONGEST_VALUE {
                return fail(place, "the value is too long with its parameters put in", "use shorter ones");
            }
        }
        Ok(result)
    }

    /// Attributes of an element after substitution of parameters: the `needed` ones, then the optional ones. Other attributes are
    /// refused.
    pub(super) fn attributes<const N: usize, const M: usize>(
        &mut self,
        element: &Element,
        needed: [&str; N],
        optional: [&str; M],
    ) -> Result<([String; N], [Option<String>; M]), Fault> {
        let place = &element.place;
        let is_known = |name: &str| needed.contains(&name) || optional.contains(&name) || name == "id";
        if let Some((name, _)) = element.attributes.iter().find(|(name, _)| !is_known(name)) {
            let message = format!("<{}> has no attribute `{}`", shown(&element.tag), shown(name));
            let known: Vec<&str> = needed.iter().chain(&optional).copied().collect();
            return fail(place, message, suggestion(name, &known));
        }
        let mut of = |name: &str| match element.attribute(name) {
            Some(text) => self.substituted(text, place).map(Some),
            None => Ok(None),
        };
        let mut first = [const { String::new() }; N];
        for (value, name) in first.iter_mut().zip(needed) {
            match of(name)? {
                Some(text) => *value = text,
                None => {
                    let message = format!("<{}> needs the attribute `{name}`", shown(&element.tag));
                    return fail(place, message, format!("write <{} {name}=\"...\"/>", shown(&element.tag)));
                }
            }
        }
        let mut second = [const { None }; M];
        for (value, name) in second.iter_mut().zip(optional) {
            *value = of(name)?;
        }
        Ok((first, second))
    }

    /// The properties of an object or of the scene, from the children of its element.
    pub(super) fn parts(&mut self, parent: &Element) -> Result<Vec<Property>, Fault> {
        let mut parts = Vec::new();
        self.add_parts(parent, &mut parts)?;
        Ok(parts)
    }

    fn add_parts(&mut self, parent: &Element, parts: &mut Vec<Property>) -> Result<(), Fault> {
        for element in &parent.children {
            match element.tag.as_str() {
                "default" => self.add_default(element)?,
                "include" => self.include(element, parts)?,
                "path" => self.add_folder(element)?,
                "alias" => {
                    let ([id, other], []) = self.attributes(element, ["id", "as"], [])?;
                    let Some(object) = self.ids.get(&id).cloned() else {
                        return fail(
                            &element.place,
                            format!("there is no object `{}`", shown(&id)),
                            self.known_ids(&id),
                        );
                    };
                    self.add_id(other, object, &element.place)?;
                }
                _ => parts.extend(self.property(element)?),
            }
        }
        Ok(())
    }

    fn known_ids(&self, id: &str) -> String {
        let mut names: Vec<&str> = self.ids.keys().map(String::as_str).collect();
        names.sort_unstable();
        suggestion(id, &names)
    }

    pub(super) fn add_id(&mut self, id: String, object: Rc<Object>, place: &Place) -> Result<(), Fault> {
        if let Some(other) = self.ids.get(&id) {
            let message = format!(
                "the id `{}` is taken: it is that of {} in line {}",
                shown(&id),
                other.label(),
                other.place.location.line
            );
            return fail(place, message, "give it another id");
        }
        self.ids.insert(id, object);
        Ok(())
    }

    fn add_default(&mut self, element: &Element) -> Result<(), Fault> {
        let ([name, value], []) = self.attributes(element, ["name", "value"], [])?;
        if name.is_empty() {
            return fail(
                &element.place,
                "a parameter needs a name",
                "write <default name=\"spp\" value=\"64\"/>",
            );
        }
        self.unused.remove(&name);
        self.parameters.entry(name).or_insert(value);
        Ok(())
    }

    fn add_folder(&mut self, element: &Element) -> Result<(), Fault> {
        let ([value], []) = self.attributes(element, ["value"], [])?;
        let wanted = PathBuf::from(value.replace('\\', "/"));
        let found = if wanted.is_absolute() {
            Some(wanted).filter(|path| path.is_dir())
        } else {
            self.folders.iter().rev().map(|folder| folder.join(&wanted)).find(|path| path.is_dir())
        };
        let Some(folder) = found else {
            let message = format!("there is no folder `{}`", shown(&value));
            return fail(&element.place, message, "correct the path, or take the element out");
        };
        // The file's own folder, which is last, is searched first.
        self.folders.insert(0, folder);
        Ok(())
    }

    fn include(&mut self, element: &Element, parts: &mut Vec<Property>) -> Result<(), Fault> {
        let ([name], []) = self.attributes(element, ["filename"], [])?;
        let place = &element.place;
        let Some(path) = find(&self.folders, &name) else {
            let message = format!("there is no file `{}` to include", shown(&name));
            return fail(place, message, "correct its name, or name its folder by <path value=\"...\"/>");
        };
        self.includes += 1;
        if self.includes > MOST_INCLUDES || self.depth >= DEEPEST_INCLUDE {
            return fail(place, "too many files include each other", "does a file include itself?");
        }
        let unreadable = |error: &dyn std::fmt::Display| {
            fail(place, format!("`{}` cannot be read: {error}", shown(&name)), "name a file of Mitsuba (XML)")
        };
        let bytes = match read_regular(&path, MOST_BYTES) {
            Ok(bytes) => bytes,
            Err(error) => return unreadable(&error),
        };
        let text = match text_of(&bytes).map(|text| String::from_utf8(text.into_owned())) {
            Ok(Ok(text)) => text,
            Ok(Err(_)) => return unreadable(&"it is not UTF-8"),
            Err(what) => return unreadable(&what),
        };
        let root = xml::parse(self.sources, path.clone(), text)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let is_old = std::mem::replace(&mut self.is_old, is_old(&root)?);
        self.folders.push(folder);
        self.depth += 1;
        let added = match root.tag.as_str() {
            "scene" => self.add_parts(&root, parts),
            _ => self.property(&root).map(|property| parts.extend(property)),
        };
        self.depth -= 1;
        // From now on the folder of the included file is searched after that of this file.
        if let Some(folder) = self.folders.pop() {
            self.folders.insert(0, folder);
        }
        self.is_old = is_old;
        added
    }
}
