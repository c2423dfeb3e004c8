//! Importer for scenes of pbrt-v4 and pbrt-v3 (text) as complete scenes. The support for each part is described in `docs/pbrt.md`.

mod colour;
mod directives;
mod file;
mod light;
mod material;
#[cfg(test)]
mod material_tests;
mod medium;
mod mesh;
mod object;
mod old;
mod quadric;
mod shape;
mod state;
#[cfg(test)]
mod tests;
mod texture;
mod token;
mod transform;
mod view;

use self::error::{Fault, Place, Sources, fail};
use self::import::material::{Filling, Finished};
use self::import::pictures::Pictures;
use self::import::{Allow, Building, blank_scene};
use self::object::Object;
use self::paint::Paint;
use self::report::{Report, Subject};
use self::state::{Block, Chosen, State};
use self::surface::Surface;
use self::text::shown;
use super::description::{Location, SceneDescription};
use super::diagnostic::SceneFileError;
use super::import::{self, error, facets, indices, models, paint, pictures, report, spectrum, surface, text};
use crate::files::{foreign_by_content, read_regular, text_of};
use crate::memory::MemoryEstimate;
use glam::DAffine3;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// File extensions of pbrt scenes.
pub const PBRT_EXTENSIONS: &[&str] = &["pbrt"];

/// Longest file of text, in bytes. Meshes may stand in it.
const MOST_BYTES: u64 = 1 << 30;

/// Longest text of all files together.
const MOST_TEXT: u64 = 4 << 30;

/// Bytes of memory for each byte of text: itself, and the numbers of a mesh of short ones.
const TEXT_MEMORY: u64 = 10;

/// Most included files.
const MOST_INCLUDES: usize = 4096;

/// Deepest nesting of included files.
const DEEPEST_INCLUDE: usize = 16;

/// Whether a file is a pbrt scene, by its extension.
pub fn is_pbrt_file(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    PBRT_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Reads a pbrt scene.
///
/// # Errors
/// Where the file, or another that it names, cannot be read, or contains something unsupported. The error gives the file, the
/// line, and what to do.
pub fn pbrt_scene(path: &Path) -> Result<SceneDescription, SceneFileError> {
    pbrt_scene_within(path, &|_| Ok(()))
}

/// [`pbrt_scene`] with a callback `allow` that accepts or refuses the memory estimate. It is called for the text of each file, and
/// for each mesh that must be known before the scene is built.
///
/// # Errors
/// As [`pbrt_scene`], and what `allow` returns.
pub fn pbrt_scene_within(path: &Path, allow: Allow<'_>) -> Result<SceneDescription, SceneFileError> {
    let bytes = read_regular(path, MOST_BYTES).map_err(|source| {
        let remedy = match source.kind() {
            ErrorKind::NotFound => "check the name of the scene file",
            ErrorKind::PermissionDenied => "check the permissions of the file",
            _ => "name a scene of pbrt (text)",
        };
        SceneFileError::Io { path: path.to_path_buf(), source, remedy }
    })?;
    parse_within(&bytes, path, allow)
}

/// [`pbrt_scene`] for bytes in memory. Messages call the file `path`, and other files are looked for relative to it.
///
/// # Errors
/// As [`pbrt_scene`]. No bytes cause a panic.
pub fn parse_pbrt_bytes(bytes: &[u8], path: &Path) -> Result<SceneDescription, SceneFileError> {
    parse_within(bytes, path, &|_| Ok(()))
}

fn parse_within(bytes: &[u8], path: &Path, allow: Allow<'_>) -> Result<SceneDescription, SceneFileError> {
    if let Some(kind) = foreign_by_content(path, bytes) {
        return Err(SceneFileError::Foreign { path: path.to_path_buf(), kind });
    }
    let text = match text_of(bytes).map(|text| String::from_utf8(text.into_owned())) {
        Ok(Ok(text)) => text,
        Ok(Err(error)) => {
            let valid = error.utf8_error().valid_up_to();
            let byte = error.as_bytes().get(valid).copied().unwrap_or(0);
            let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
            return Err(SceneFileError::NotUtf8 { location, byte });
        }
        Err(_) => String::new(),
    };
    let mut importer = Importer::new(path, allow);
    match importer.read(path, text) {
        Ok(()) => Ok(importer.finished()),
        Err(fault) => Err(importer.sources.told(*fault)),
    }
}

/// State while the directives of a scene are converted to a description.
struct Importer<'a> {
    sources: Sources,
    /// The folder of the scene.
    folder: PathBuf,
    description: SceneDescription,
    report: Report,
    state: State,
    blocks: Vec<(Block, State, Place)>,
    in_world: bool,
    is_over: bool,
    /// Whether something shows that the scene is of pbrt-v3.
    is_old: bool,
    systems: HashMap<String, DAffine3>,
    /// The camera, the transform from the world to it, and the medium around it.
    camera: Option<(Rc<Object>, DAffine3, String)>,
    /// Factor of the film on all light.
    sensor_scale: f64,
    materials: HashMap<String, Rc<Object>>,
    media: HashMap<String, Rc<Object>>,
    /// By whether they are numbers, and by name.
    textures: HashMap<(bool, String), Rc<Object>>,
    groups: HashMap<String, usize>,
    /// The object that is being defined.
    group: Option<usize>,
    instances: Vec<(String, DAffine3, Place)>,
    /// Shapes with names that are not defined so far.
    waiting: Vec<(Rc<Object>, State, Option<usize>)>,
    surfaces: HashMap<usize, Surface>,
    paints: HashMap<usize, Paint>,
    /// Factors on the bases of coats, by the bits of slope and index.
    base_factors: HashMap<[u64; 2], f64>,
    fillings: HashMap<String, Filling>,
    /// By material and the names of the media at both sides.
    finished: HashMap<(usize, String, String), Finished>,
    pictures: Pictures,
    serial: usize,
    includes: usize,
    depth: usize,
    texture_depth: usize,
    material_depth: usize,
    text_bytes: u64,
    /// Estimated memory of what was read; `allow` decides whether it may grow.
    taken: MemoryEstimate,
    allow: Allow<'a>,
}

impl<'a> Importer<'a> {
    fn new(path: &Path, allow: Allow<'a>) -> Self {
        let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
        let usual = Object {
            serial: 0,
            directive: "Material",
            kind: "diffuse".to_owned(),
            id: Some("usual".to_owned()),
            parameters: Vec::new(),
            place: Place { location: location.clone(), ..Place::default() },
        };
        Self {
            sources: Sources::default(),
            folder: path.parent().unwrap_or(Path::new("")).to_path_buf(),
            description: blank_scene(path, view::usual_film()),
            report: Report::default(),
            state: State {
                ctm: DAffine3::IDENTITY,
                is_active: true,
                reverse: false,
                material: Chosen::Object(Rc::new(usual)),
                area_light: None,
                inside: String::new(),
                outside: String::new(),
                space: None,
                defaults: Default::default(),
            },
            blocks: Vec::new(),
            in_world: false,
            is_over: false,
            is_old: false,
            systems: HashMap::new(),
            camera: None,
            sensor_scale: 1.0,
            materials: HashMap::new(),
            media: HashMap::new(),
            textures: HashMap::new(),
            groups: HashMap::new(),
            group: None,
            instances: Vec::new(),
            waiting: Vec::new(),
            surfaces: HashMap::new(),
            paints: HashMap::new(),
            base_factors: HashMap::new(),
            fillings: HashMap::new(),
            finished: HashMap::new(),
            pictures: Pictures::default(),
            serial: 0,
            includes: 0,
            depth: 0,
            texture_depth: 0,
            material_depth: 0,
            text_bytes: 0,
            taken: MemoryEstimate::default(),
            allow,
        }
    }

    /// The scene that is built, for what all importers share.
    fn building(&mut self) -> Building<'_> {
        Building { scene: &mut self.description, report: &mut self.report }
    }

    fn read(&mut self, path: &Path, text: String) -> Result<(), Fault> {
        let whole = Place { location: self.description.location.clone(), ..Place::default() };
        if let Err(fault) = self.foresee_text(text.len() as u64, &whole) {
            self.sources.add(path.to_path_buf(), String::new());
            return Err(fault);
        }
        self.text(path.to_path_buf(), text)?;
        if let Some((block, _, place)) = self.blocks.last() {
            return fail(
                place,
                format!("{} has no {}", block.begin(), block.end()),
                format!("write {} where the block ends", block.end()),
            );
        }
        if !self.in_world {
            return fail(
                &whole,
                "the file has no WorldBegin: it is no whole scene of pbrt",
                "name the scene that includes it",
            );
        }
        self.place_waiting()?;
        self.place_instances()?;
        self.view()?;
        Ok(())
    }

    /// The description, with the messages.
    fn finished(mut self) -> SceneDescription {
        if self.sensor_scale != 1.0 {
            self.scale_light();
        }
        if self.is_old {
            let place = Place { location: self.description.location.clone(), ..Place::default() };
            self.report.note_at(&place, "is read as a scene of pbrt-v3, by the names in it");
        }
        let (warnings, notes) = self.report.told();
        self.description.warnings.extend(warnings);
        self.description.notes.extend(notes);
        self.description.further_files.extend(self.sources.paths().skip(1).cloned());
        self.description
    }

    /// Applies the factor of the film to all light.
    fn scale_light(&mut self) {
        use super::description::{LightDescription, ProfileBrightness};
        let factor = self.sensor_scale;
        let place = Place { location: self.description.location.clone(), ..Place::default() };
        self.report.note_at(
            &place,
            format!(
                "all light is multiplied by {factor}, as its film multiplies it (sensitivity and exposure)"
            ),
        );
        for light in &mut self.description.lights {
            match &mut light.value {
                LightDescription::Point { intensity, .. } | LightDescription::Spot { intensity, .. } => {
                    *intensity *= factor;
                }
                LightDescription::Directional { irradiance, .. }
                | LightDescription::Sun { irradiance, .. } => *irradiance *= factor,
                LightDescription::Environment { radiance } => *radiance *= factor,
                LightDescription::EnvironmentMap { factor: own, .. }
                | LightDescription::Sky { factor: own, .. }
                | LightDescription::CieSky { factor: own, .. } => *own *= factor,
                LightDescription::Profile { brightness, .. } => match brightness {
                    ProfileBrightness::PerCandela(own) | ProfileBrightness::Power(own) => *own *= factor,
                },
            }
        }
        for shape in &mut self.description.shapes {
            if let Some(emission) = &mut shape.value.emission {
                emission.emitted = emission.emitted.times(factor);
            }
        }
        for volume in self.description.media.iter_mut().filter_map(|medium| medium.value.volume.as_mut()) {
            let emission = volume.coefficients.emission() * factor as f32;
            // A product that is out of range stays what it was.
            volume.coefficients = volume.coefficients.with_emission(emission).unwrap_or(volume.coefficients);
        }
    }

    /// Reports those of the named parameters that an object has, because they have no effect here.
    fn ignore(&mut self, object: &Object, names: &[&str], why: &str) {
        let found: Vec<&str> = names.iter().copied().filter(|name| object.get(name).is_some()).collect();
        self.report.ignored(object, &found, why);
    }

    /// Reports every parameter of an object that was not asked for; refuses a misspelling of one of the `known` names.
    fn finish(&mut self, object: &Object, known: &[&str]) -> Result<(), Fault> {
        for parameter in object.unread() {
            object.refuse_misspelt(parameter, known)?;
            let what = format!("the parameter `{}` is not known, and has no effect", shown(&parameter.name));
            self.report.warn(object, what);
        }
        Ok(())
    }

    /// The path of a file that the scene names. It stays in the folder of the scene, unless the name is absolute.
    fn path_of(&self, name: &str, place: &Place) -> Result<PathBuf, Fault> {
        let slashed = name.replace('\\', "/");
        let path = Path::new(&slashed);
        if path.is_absolute() {
            return Ok(path.to_path_buf());
        }
        let mut depth = 0i64;
        for component in path.components() {
            depth += match component {
                Component::ParentDir => -1,
                Component::Normal(_) => 1,
                _ => 0,
            };
            if depth < 0 {
                return fail(
                    place,
                    format!("`{}` is outside of the folder of the scene", shown(name)),
                    "move the file into the folder, or write its absolute path",
                );
            }
        }
        Ok(self.folder.join(path))
    }

    /// The path of an existing file that the scene names.
    fn file(&mut self, name: &str, place: &Place) -> Result<PathBuf, Fault> {
        let path = self.path_of(name, place)?;
        if !path.is_file() {
            let message = format!("there is no file `{}`", shown(name));
            return fail(
                place,
                message,
                "correct its name, or put it there: names count from the folder of the scene",
            );
        }
        self.description.further_files.push(path.clone());
        Ok(path)
    }

    /// The path of the file that a parameter gives.
    fn named_file(&mut self, object: &Object, name: &str) -> Result<PathBuf, Fault> {
        match object.text(name)?.map(str::to_owned) {
            Some(file) if !file.is_empty() => self.file(&file, object.place_of(name)),
            _ => {
                let message = format!("{} names no file", object.label());
                fail(&object.place, message, format!("write \"string {name}\" \"...\""))
            }
        }
    }

    /// Checks whether the memory for a text is allowed.
    fn foresee_text(&mut self, bytes: u64, place: &Place) -> Result<(), Fault> {
        self.text_bytes = self.text_bytes.saturating_add(bytes);
        if self.text_bytes > MOST_TEXT {
            let message = format!("the files of the scene have more than {MOST_TEXT} bytes of text");
            return fail(place, message, "move meshes into files of their own (`plymesh`)");
        }
        self.taken.reading = self.taken.reading.max(self.text_bytes.saturating_mul(TEXT_MEMORY));
        (self.allow)(&self.taken).or_else(|error| {
            fail(
                place,
                error.to_string(),
                "allow more memory, or move meshes into files of their own (`plymesh`)",
            )
        })
    }

    /// Checks whether the memory for a mesh of this many vertices is allowed, with two triangles for each.
    fn foresee_mesh(&mut self, object: &Object, vertices: u64) -> Result<(), Fault> {
        const VERTEX: u64 = 24 + 12 + 8 + 2 * 12;
        self.taken.meshes = self.taken.meshes.saturating_add(vertices.saturating_mul(VERTEX));
        (self.allow)(&self.taken).or_else(|error| {
            let message = format!("the mesh of {}: {error}", object.label());
            fail(&object.place, message, "allow more memory, or make the mesh smaller")
        })
    }

    /// The text of an included file, which may be compressed.
    fn text_of_file(&mut self, path: &Path, place: &Place) -> Result<String, Fault> {
        let unreadable = |error: &dyn std::fmt::Display| {
            fail(place, format!("`{}` cannot be read: {error}", path.display()), "name a file of pbrt (text)")
        };
        let is_packed = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gz"));
        let bytes = if is_packed {
            mesh::unpacked(path, MOST_BYTES)
        } else {
            read_regular(path, MOST_BYTES).map_err(|error| error.to_string())
        };
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(error) => return unreadable(&error),
        };
        self.foresee_text(bytes.len() as u64, place)?;
        match text_of(&bytes).map(|text| String::from_utf8(text.into_owned())) {
            Ok(Ok(text)) => Ok(text),
            Ok(Err(_)) => unreadable(&"it is not UTF-8"),
            Err(what) => unreadable(&what),
        }
    }
}
