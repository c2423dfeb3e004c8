//! Parses the text of a scene file to a [`SceneDescription`]. The format is described in `docs/scene-format.md`.

mod brightness;
mod density;
mod generate;
mod glossy;
mod images;
mod include;
mod index;
mod layered;
mod lights;
mod materials;
mod media;
mod names;
mod objects;
mod settings;
mod shapes;
mod sky;
#[cfg(test)]
mod tests;
mod textures;
mod transform;
mod view;

use super::description::*;
use super::diagnostic::{SceneFileError, SourceText};
use super::import::material::{Needs, needs_of};
use super::parameters::Parameters;
use super::reader::{Context, Findings, POSITIVE, Table, Value};
use crate::files::{foreign_by_content, foreign_file, open_regular, read_regular, text_of};
use include::{Included, Library};
use names::Names;
use std::borrow::Cow;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::Path;
use std::rc::Rc;
use toml::de::{DeTable, DeValue};

/// Longest scene text that is read. An array of single digits takes 90 times its text in memory, so this bound keeps the memory
/// below a gigabyte. Geometry of that size belongs in mesh files.
pub const MAX_TEXT_BYTES: u64 = 8 << 20;

/// Units of length by name, in metres.
const UNITS: &[(&str, f64)] =
    &[("mm", 0.001), ("cm", 0.01), ("m", 1.0), ("km", 1000.0), ("inch", 0.0254), ("ft", 0.3048)];

/// Reads a scene file. `parameters` are the `--set name=value` of the command line; later ones win.
///
/// # Errors
/// [`SceneFileError`] where the file cannot be read, is not UTF-8, is longer than [`MAX_TEXT_BYTES`], or has errors. Then it
/// holds all errors that were found, each with its place and remedy. Meshes are not opened, but their files must exist.
pub fn load_scene(path: &Path, parameters: &[(String, String)]) -> Result<SceneDescription, SceneFileError> {
    let fail = |source, remedy| SceneFileError::Io { path: path.to_path_buf(), source, remedy };
    let remedy = |error: &std::io::Error| match error.kind() {
        ErrorKind::NotFound => "check the name of the scene file",
        ErrorKind::PermissionDenied => "check the permissions of the file",
        ErrorKind::IsADirectory | ErrorKind::InvalidInput => "name a scene file (TOML text)",
        _ => "try again",
    };
    let refuse = |error| {
        let remedy = remedy(&error);
        fail(error, remedy)
    };
    let foreign = |kind| SceneFileError::Foreign { path: path.to_path_buf(), kind };
    let (_, length) = open_regular(path).map_err(refuse)?;
    let kind = foreign_file(path);
    if length > MAX_TEXT_BYTES {
        let too_long =
            SceneFileError::TooLong { path: path.to_path_buf(), bytes: length, limit: MAX_TEXT_BYTES };
        return Err(kind.map_or(too_long, foreign));
    }
    let bytes = read_regular(path, MAX_TEXT_BYTES).map_err(refuse)?;
    // A scene file may have any name, so its content decides.
    if let Some(kind) = foreign_by_content(path, &bytes) {
        return Err(foreign(kind));
    }
    let bytes = text_of(&bytes).map_or(Cow::Borrowed(&*bytes), |text| text);
    let parsed = match std::str::from_utf8(&bytes) {
        Ok(text) => parse_scene(text, path, parameters),
        Err(error) => Err(not_utf8(path, &bytes, error)),
    };
    // Syntax errors are no help where the file is of another kind.
    parsed.map_err(|error| match (error, kind) {
        (SceneFileError::NotToml { .. } | SceneFileError::NotUtf8 { .. }, Some(kind)) => foreign(kind),
        (error, _) => error,
    })
}

fn not_utf8(path: &Path, bytes: &[u8], error: std::str::Utf8Error) -> SceneFileError {
    let (valid, rest) = bytes.split_at(error.valid_up_to());
    let valid = String::from_utf8_lossy(valid);
    let location = SourceText::new(&valid, path).location(valid.len());
    SceneFileError::NotUtf8 { location, byte: rest.first().copied().unwrap_or(0) }
}

/// Parses the text of a scene file. `file` is its name for messages and the base of relative paths. `parameters` are the `--set
/// name=value` of the command line; later ones win.
///
/// # Errors
/// As [`load_scene`]. No text causes a panic.
pub fn parse_scene(
    text: &str,
    file: &Path,
    parameters: &[(String, String)],
) -> Result<SceneDescription, SceneFileError> {
    let bytes = text.len() as u64;
    if bytes > MAX_TEXT_BYTES {
        return Err(SceneFileError::TooLong { path: file.to_path_buf(), bytes, limit: MAX_TEXT_BYTES });
    }
    let (root, syntax_errors) = DeTable::parse_recoverable(text);
    let source = SourceText::new(text, file);
    let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
    let mut context = Context::new(source, folder);
    if !syntax_errors.is_empty() {
        report_syntax(&context, &syntax_errors);
        let Findings { diagnostics, more, .. } = context.into_findings();
        return Err(SceneFileError::NotToml { diagnostics, more });
    }
    if root.get_ref().is_empty() {
        let remedy = "a scene needs at least one `[[shapes]]`; docs/scene-format.md has a complete example";
        context.error_of_file("the scene file is empty", remedy);
        return Err(context.into_findings().into_error());
    }
    context.parameters = Rc::new(read_parameters(&context, root.get_ref(), parameters));
    let mut library = Library::default();
    library.read(&mut Table::new(&context, root.get_ref(), 0..0, "the scene file"), 0);
    let Library { files, diagnostics: mut wrong, .. } = library;
    let parsed: Vec<_> = files.iter().map(|included| DeTable::parse_recoverable(&included.text)).collect();
    let contexts: Vec<Context<'_>> = files
        .iter()
        .map(|Included { file, text }| {
            let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
            let mut included = Context::new(SourceText::new(text, file), folder);
            included.parameters = Rc::clone(&context.parameters);
            included
        })
        .collect();
    for (context, (_, syntax_errors)) in contexts.iter().zip(&parsed) {
        report_syntax(context, syntax_errors);
    }
    let parts = contexts.iter().zip(&parsed).filter(|(_, (_, errors))| errors.is_empty());
    let parts: Vec<_> = parts.map(|(context, (root, _))| (context, root.get_ref())).collect();
    let scene = read_scene(&context, root.get_ref(), file, &parts);
    context.parameters.warn_unused(&context);
    drop(parts);
    let mut warnings = Vec::new();
    let mut more = 0;
    for findings in contexts.into_iter().chain([context]).map(Context::into_findings) {
        wrong.extend(findings.diagnostics);
        warnings.extend(findings.warnings);
        more += findings.more;
    }
    match scene {
        Some(mut scene) if wrong.is_empty() => {
            scene.further_files.extend(files.iter().map(|included| included.file.clone()));
            Ok(SceneDescription { warnings, ..scene })
        }
        _ => Err(SceneFileError::Invalid { diagnostics: wrong, more }),
    }
}

/// The entries of some tables with their places and the unit of their file, file by file and there in the order of the text.
fn entries<'a>(tables: &[(Table<'a>, f64)]) -> impl Iterator<Item = (Range<usize>, Value<'a>, f64)> {
    let of = |(table, unit): &(Table<'a>, f64)| {
        let unit = *unit;
        table.sorted_entries().into_iter().map(move |(span, value)| (span, value, unit))
    };
    tables.iter().flat_map(of)
}

/// The tables of a file from which a scene is put together, each with the unit of its file.
#[derive(Default)]
struct Sections<'a> {
    media: Vec<(Table<'a>, f64)>,
    textures: Vec<(Table<'a>, f64)>,
    materials: Vec<(Table<'a>, f64)>,
    shapes: Vec<(Table<'a>, f64)>,
    instances: Vec<(Table<'a>, f64)>,
    lights: Vec<(Table<'a>, f64)>,
}

impl<'a> Sections<'a> {
    /// Adds those of a file.
    fn add(&mut self, table: &mut Table<'a>, unit: f64) {
        let with_unit = |table: Table<'a>| (table, unit);
        self.media.extend(section(table, "media").map(with_unit));
        self.textures.extend(section(table, "textures").map(with_unit));
        self.materials.extend(section(table, "materials").map(with_unit));
        self.shapes.extend(sections(table, "shapes").into_iter().map(with_unit));
        self.instances.extend(sections(table, "instances").into_iter().map(with_unit));
        self.lights.extend(sections(table, "lights").into_iter().map(with_unit));
    }
}

/// Most TOML syntax errors that are reported. One mistake may cause many, and a file of another kind has nothing else.
const SYNTAX_ERRORS: usize = 3;

/// Reports syntax errors, each once: the TOML parser closes nested brackets one by one.
fn report_syntax(context: &Context<'_>, errors: &[toml::de::Error]) {
    let told = |error: &toml::de::Error| {
        let message = format!("not TOML: {}", error.message().replace('\n', ", "));
        (error.span().unwrap_or(0..0), message)
    };
    let mut errors: Vec<_> = errors.iter().map(told).collect();
    errors.dedup();
    for (span, message) in errors.iter().take(SYNTAX_ERRORS) {
        context.error(span, message.clone(), "");
    }
    context.leave_out(errors.len().saturating_sub(SYNTAX_ERRORS) as u64);
}

fn read_parameters<'a>(
    context: &'a Context<'a>,
    root: &'a DeTable<'a>,
    settings: &[(String, String)],
) -> Parameters {
    let entry = root.iter().find(|(key, _)| key.get_ref() == "parameters");
    let value = entry.map(|(key, value)| Value::new(context, key.get_ref(), value));
    let table = value.and_then(|value| value.table("[parameters]", "begin it with a line `[parameters]`"));
    Parameters::read(context, table.as_ref(), settings)
}

/// Reads the whole scene. `None` or recorded errors mean that the file is refused.
fn read_scene<'a>(
    context: &'a Context<'a>,
    root: &'a DeTable<'a>,
    file: &Path,
    included: &[(&'a Context<'a>, &'a DeTable<'a>)],
) -> Option<SceneDescription> {
    let mut parts = Sections::default();
    for &(context, root) in included {
        let mut table = Table::new(context, root, 0..0, "the included file");
        table.get("include");
        let unit = table.or("unit", 1.0, read_unit).unwrap_or(1.0);
        parts.add(&mut table, unit);
        table.finish();
    }
    let mut table = Table::new(context, root, 0..0, "the scene file");
    // These are read earlier and separately.
    table.get("parameters");
    table.get("include");
    let stem = || file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = table.or("name", stem(), |value| value.string().map(|name| name.into_owned()));
    // Even with a wrong unit, the rest is read for its own errors.
    let unit = table.or("unit", 1.0, read_unit).unwrap_or(1.0);
    let camera = section(&mut table, "camera").map(|camera| view::read_camera(camera, unit));
    let film = section(&mut table, "film").map_or(Some(view::default_film()), view::read_film);
    let render = section(&mut table, "render")
        .map_or(Some(Default::default()), |table| settings::read_render(table, unit));
    parts.add(&mut table, unit);
    let (mut media, media_names) = media::read_media(&parts.media);
    let (textures, texture_names, images) = textures::read_textures(&parts.textures);
    let (mut materials, looks, material_names) =
        materials::read_materials(&parts.materials, &media_names, &mut media, (&texture_names, &images));
    let has_box = |medium: &Named<MediumDescription>| {
        medium.value.volume.as_ref().is_some_and(|volume| volume.fills == FillDescription::Bounds)
    };
    if parts.shapes.is_empty() && table.get("shapes").is_none() && !media.iter().any(has_box) {
        context.error_of_file("the scene has no shapes", "add at least one `[[shapes]]` table");
    }
    let needs: Vec<Needs> = materials.iter().map(|material| needs_of(&material.value)).collect();
    let shapes = shapes::read_shapes(parts.shapes, (&material_names, &needs, &texture_names));
    if shapes.uses_implied_material {
        materials.push(materials::implied_material(context));
    }
    let instances = shapes::read_instances(parts.instances, &shapes.group_names);
    let (lights, light_photons) = lights::read_lights(parts.lights);
    table.finish();
    texture_names.warn_unused(context, "is used by no material");
    images.warn_unused(context);
    shapes.group_names.warn_unused(context, "is placed by no `[[instances]]`, so it is not in the picture");
    Some(SceneDescription {
        name: name?,
        location: context.source.whole(),
        camera: match camera {
            None => None,
            Some(camera) => Some(camera?),
        },
        film: film?,
        render: render?,
        media,
        textures,
        materials,
        looks,
        shapes: shapes.shapes,
        groups: shapes.groups,
        instances,
        lights,
        light_photons,
        warnings: Vec::new(),
        notes: Vec::new(),
        further_files: images.files(),
        parameters: Vec::new(),
    })
}

fn read_unit(value: Value<'_>) -> Option<f64> {
    const REMEDY: &str = "write `unit = \"mm\"`, or the number of metres in one unit: `unit = 0.001`";
    if !value.is_string() {
        return value.number(&POSITIVE);
    }
    let text = value.string()?;
    match UNITS.iter().find(|(name, _)| *name == text) {
        Some(&(_, metres)) => Some(metres),
        // A parameter may stand for the number.
        None => match text.parse::<f64>() {
            Ok(metres) if metres > 0.0 && metres.is_finite() => Some(metres),
            _ => {
                let remedy = match value.whole_parameter() {
                    Some((name, _)) => {
                        format!("write for example `--set {name}=mm`, or the number of metres in one unit")
                    }
                    None => REMEDY.to_owned(),
                };
                value.refuse("\"mm\", \"cm\", \"m\", \"km\", \"inch\", \"ft\" or a number of metres", remedy)
            }
        },
    }
}

/// The table `[name]`, if the file has it.
fn section<'a>(root: &mut Table<'a>, name: &'static str) -> Option<Table<'a>> {
    let value = root.get(name)?;
    value.table(format!("[{name}]"), &format!("begin it with a line `[{name}]`"))
}

/// The tables `[[name]]` in the order of the file, each titled with its name or number.
fn sections<'a>(root: &mut Table<'a>, name: &'static str) -> Vec<Table<'a>> {
    let Some(value) = root.get(name) else { return Vec::new() };
    let DeValue::Array(items) = value.get_ref() else {
        value.refuse::<()>("a list of tables", format!("begin each with a line `[[{name}]]`"));
        return Vec::new();
    };
    let tables = items.iter().enumerate().filter_map(|(index, item)| {
        let value = Value::new(value.context(), name, item);
        value.table(format!("[[{name}]] number {}", index + 1), &format!("begin it with `[[{name}]]`"))
    });
    tables.collect()
}

/// Name of an item of an array: the key `name`, or its kind and number. A name given twice is refused.
fn read_name(table: &mut Table<'_>, seen: &mut Names, kind: &str, index: usize) -> Option<String> {
    let context = table.context();
    let Some(value) = table.get("name") else { return Some(format!("{kind} {}", index + 1)) };
    let name = value.string()?.into_owned();
    seen.declare(context, &name, &value.span())?;
    Some(name)
}
