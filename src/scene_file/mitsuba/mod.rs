//! Importer for Mitsuba scenes (XML, versions 0.5 to 3) as complete scenes. The support for each part is described in
//! `docs/mitsuba.md`.

mod bsdf;
mod elements;
mod light;
mod literal;
mod material;
#[cfg(test)]
mod material_tests;
mod models;
mod parse;
mod pictures;
mod principled;
mod serialized;
mod shape;
#[cfg(test)]
mod tests;
mod texture;
mod value;
mod view;
mod wrappers;
mod xml;

use self::error::{Fault, Place, Problem, Sources, fail};
use self::parse::{MOST_BYTES, Parsed};
use self::report::{Report, Subject};
use self::surface::Surface;
use self::text::shown;
use self::value::{Object, Value};
use super::description::{Location, SceneDescription};
use super::diagnostic::SceneFileError;
use super::import::blank_scene;
use super::import::material::{FillingKey, Finished};
use super::import::pictures::Pictures;
use super::import::{
    self, Allow, error, facets, indices, paint, report, spectrum, surface, tessellate, text,
};
use crate::files::{foreign_by_content, read_regular, text_of};
use crate::memory::MemoryEstimate;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// File extensions of Mitsuba scenes.
pub const MITSUBA_EXTENSIONS: &[&str] = &["xml"];

/// Bytes of memory for each byte of a scene's text, as elements and objects.
const TEXT_MEMORY: u64 = 16;

/// Deepest nesting of objects; deeper objects contain each other.
const DEEPEST: usize = 64;

/// Whether a file is a Mitsuba scene, by its extension.
pub fn is_mitsuba_file(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    MITSUBA_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Reads a Mitsuba scene. `parameters` are values of its `$parameters`, which override `<default>`.
///
/// # Errors
/// Where the file, or another that it names, cannot be read, or contains something unsupported. The error gives the file, the
/// line, and what to do.
pub fn mitsuba_scene(
    path: &Path,
    parameters: &[(String, String)],
) -> Result<SceneDescription, SceneFileError> {
    mitsuba_scene_within(path, parameters, &|_| Ok(()))
}

/// [`mitsuba_scene`] with a callback `allow` that accepts or refuses the memory estimate. It is called for the text of the scene,
/// and for each mesh under a picture before that mesh is read. Other meshes are read when the scene is built.
///
/// # Errors
/// As [`mitsuba_scene`], and what `allow` returns.
pub fn mitsuba_scene_within(
    path: &Path,
    parameters: &[(String, String)],
    allow: Allow<'_>,
) -> Result<SceneDescription, SceneFileError> {
    let bytes = read_regular(path, MOST_BYTES).map_err(|source| {
        let remedy = match source.kind() {
            ErrorKind::NotFound => "check the name of the scene file",
            ErrorKind::PermissionDenied => "check the permissions of the file",
            _ => "name a scene of Mitsuba (XML)",
        };
        SceneFileError::Io { path: path.to_path_buf(), source, remedy }
    })?;
    parse_within(&bytes, path, parameters, allow)
}

/// [`mitsuba_scene`] for bytes in memory. Messages call the file `path`, and other files are looked for relative to it.
///
/// # Errors
/// As [`mitsuba_scene`]. No bytes cause a panic.
pub fn parse_mitsuba_bytes(
    bytes: &[u8],
    path: &Path,
    parameters: &[(String, String)],
) -> Result<SceneDescription, SceneFileError> {
    parse_within(bytes, path, parameters, &|_| Ok(()))
}

fn parse_within(
    bytes: &[u8],
    path: &Path,
    parameters: &[(String, String)],
    allow: Allow<'_>,
) -> Result<SceneDescription, SceneFileError> {
    if let Some(kind) = foreign_by_content(path, bytes) {
        return Err(SceneFileError::Foreign { path: path.to_path_buf(), kind });
    }
    let text = text_of(bytes).map(|text| String::from_utf8(text.into_owned()));
    let text = match text {
        Ok(Ok(text)) => text,
        Ok(Err(error)) => {
            let valid = error.utf8_error().valid_up_to();
            let byte = error.as_bytes().get(valid).copied().unwrap_or(0);
            let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
            return Err(SceneFileError::NotUtf8 { location, byte });
        }
        Err(_) => String::new(),
    };
    let mut sources = Sources::default();
    let reading = (text.len() as u64).saturating_mul(TEXT_MEMORY);
    if let Err(error) = allow(&MemoryEstimate { reading, ..MemoryEstimate::default() }) {
        sources.add(path.to_path_buf(), String::new());
        let remedy = "allow more memory, or move objects into meshes".to_owned();
        let place = Place::default();
        return Err(sources.told(Problem { place, message: error.to_string(), remedy }));
    }
    let parsed = parse::parse(&mut sources, path, text, parameters);
    let scene = parsed.and_then(|parsed| Importer::new(path, parsed, parameters, allow).read());
    match scene {
        Ok(mut scene) => {
            scene.further_files.extend(sources.paths().skip(1).cloned());
            Ok(scene)
        }
        Err(fault) => Err(sources.told(*fault)),
    }
}

/// State while the objects of a scene are converted to a description.
struct Importer<'a> {
    scene: Rc<Object>,
    ids: HashMap<String, Rc<Object>>,
    folders: Vec<PathBuf>,
    description: SceneDescription,
    report: Report,
    /// The material of shapes without one.
    usual_bsdf: Rc<Object>,
    surfaces: HashMap<*const Object, Surface>,
    /// By object and interior.
    materials: HashMap<(*const Object, FillingKey), Finished>,
    groups: HashMap<*const Object, usize>,
    pictures: Pictures,
    depth: usize,
    /// Estimated memory of the meshes that were read; `allow` decides whether it may grow.
    taken: MemoryEstimate,
    allow: Allow<'a>,
}

impl<'a> Importer<'a> {
    fn new(path: &Path, parsed: Parsed, parameters: &[(String, String)], allow: Allow<'a>) -> Self {
        let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
        let Parsed { scene, ids, folders, spectra } = parsed;
        let usual_bsdf = Rc::new(Object {
            tag: "bsdf".to_owned(),
            plugin: "diffuse".to_owned(),
            id: Some("usual".to_owned()),
            properties: Vec::new(),
            place: Place { location: location.clone(), ..Place::default() },
            is_old: false,
        });
        Self {
            scene,
            ids,
            folders,
            description: SceneDescription {
                further_files: spectra,
                parameters: parameters.to_vec(),
                ..blank_scene(path, view::usual_film())
            },
            report: Report::default(),
            usual_bsdf,
            surfaces: HashMap::new(),
            materials: HashMap::new(),
            groups: HashMap::new(),
            pictures: Pictures::default(),
            depth: 0,
            taken: MemoryEstimate::default(),
            allow,
        }
    }

    /// Enters a nested object; refuses objects that contain each other.
    fn enter(&mut self, object: &Object) -> Result<(), Fault> {
        self.depth += 1;
        if self.depth > DEEPEST {
            let message = format!("{} stands in too many others: do they hold each other?", object.label());
            return fail(&object.place, message, "break the circle of <ref>");
        }
        Ok(())
    }

    fn leave(&mut self) {
        self.depth -= 1;
    }

    /// Reports those of the named parameters that an object has, because they have no effect here.
    fn ignore(&mut self, object: &Object, names: &[&str], why: &str) {
        let found: Vec<&str> = names.iter().copied().filter(|name| object.get(name).is_some()).collect();
        self.report.ignored(object, &found, why);
    }

    /// Reports everything in an object that was not asked for; refuses a misspelling of one of the `known` names.
    fn finish(&mut self, object: &Object, known: &[&str]) -> Result<(), Fault> {
        for property in object.unread() {
            object.refuse_misspelt(property, known)?;
            let what = match (&property.value, property.name.as_str()) {
                (Value::Object(part), "") => {
                    format!("the {} in it is left out: it has no place there", part.label())
                }
                (_, "") => "a part of it is left out: it has no place there".to_owned(),
                (_, name) => format!("the parameter `{}` is not known, and has no effect", shown(name)),
            };
            self.report.warn(object, what);
        }
        Ok(())
    }

    fn read(mut self) -> Result<SceneDescription, Fault> {
        let scene = Rc::clone(&self.scene);
        let mut sensors = Vec::new();
        let mut shapes = Vec::new();
        for property in &scene.properties {
            property.mark();
            let Some(object) = self.object_of(property)? else {
                let message = format!("the scene has no parameter `{}`", shown(&property.name));
                return fail(&property.place, message, "put it into the object that it is meant for");
            };
            match object.tag.as_str() {
                "sensor" => sensors.push(object),
                "integrator" => self.integrator(&object)?,
                "emitter" => self.light(&object)?,
                "shape" => shapes.push(object),
                // These are used where something refers to them.
                "bsdf" | "texture" | "medium" | "spectrum" | "phase" | "volume" => {}
                "film" => self.film(&object)?,
                "sampler" => self.sampler_of(&object)?,
                other => {
                    let message = format!("<{}> cannot stand at the top of a scene", shown(other));
                    return fail(&object.place, message, "put it into the object that it is meant for");
                }
            }
        }
        if let Some(sensor) = sensors.first() {
            self.sensor(sensor)?;
        }
        if let Some(second) = sensors.get(1) {
            self.report.warn(second, "is left out: the first sensor of a file counts");
        }
        for shape in shapes {
            self.shape(&shape, None)?;
        }
        let (warnings, notes) = self.report.told();
        self.description.warnings.extend(warnings);
        self.description.notes.extend(notes);
        Ok(self.description)
    }
}
