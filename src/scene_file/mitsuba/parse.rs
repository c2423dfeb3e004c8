//! Elements to objects: parameters of the command line and `<default>`, `<include>`, `<path>`, `<alias>`, and the values that
//! elements hold.

use super::error::{Fault, Sources, fail};
use super::spectrum::{Spectrum, spectrum_file};
use super::value::{Object, Property, Value, shown};
use super::xml::{self, Element, Place};
use crate::files::{read_regular, text_of};
use crate::scene_file::diagnostic::suggestion;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Longest file that is read, in bytes; meshes are in files of their own.
pub(super) const MOST_BYTES: u64 = 64 << 20;

/// Files that include each other, at most.
const MOST_INCLUDES: usize = 512;

/// Includes in includes, at most.
const DEEPEST_INCLUDE: usize = 15;

/// Longest value after parameters were put in, in bytes.
const LONGEST_VALUE: usize = 1 << 20;

/// Elements that are objects.
const OBJECTS: [&str; 14] = [
    "integrator",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "bsdf",
    "texture",
    "emitter",
    "shape",
    "medium",
    "phase",
    "volume",
    "subsurface",
    "camera",
];

/// What a file holds, with everything put in its place.
pub(super) struct Parsed {
    pub scene: Rc<Object>,
    pub ids: HashMap<String, Rc<Object>>,
    /// Folders that files are looked for in, the last first.
    pub folders: Vec<PathBuf>,
    /// Spectra that were read from files.
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

/// Whether a file is of a version before 2.0, which had other names for some things.
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

/// `intIOR` as `int_ior`.
fn in_letters_of_today(name: &str) -> String {
    let mut today = String::with_capacity(name.len() + 4);
    let mut before = ' ';
    for c in name.chars() {
        if c.is_ascii_uppercase() && before.is_ascii_lowercase() {
            today.push('_');
        }
        today.push(if c.is_ascii_uppercase() && before != ' ' { c.to_ascii_lowercase() } else { c });
        before = c;
    }
    today
}

struct Parser<'a> {
    sources: &'a mut Sources,
    parameters: BTreeMap<String, String>,
    /// Parameters of the command line that nothing has used so far.
    unused: BTreeSet<String>,
    ids: HashMap<String, Rc<Object>>,
    folders: Vec<PathBuf>,
    spectra: Vec<PathBuf>,
    includes: usize,
    depth: usize,
    is_old: bool,
}

/// The file called `name`: as it says, or in one of the folders.
pub(super) fn find(folders: &[PathBuf], name: &str) -> Option<PathBuf> {
    let slashed = name.replace('\\', "/");
    let path = Path::new(&slashed);
    if path.is_absolute() {
        return path.is_file().then(|| path.to_path_buf());
    }
    folders.iter().rev().map(|folder| folder.join(path)).find(|path| path.is_file())
}

impl Parser<'_> {
    /// `text` with the values of its `$parameters`.
    fn substituted(&mut self, text: &str, place: &Place) -> Result<String, Fault> {
        if !text.contains('$') {
            return Ok(text.to_owned());
        }
        let mut parts = text.split('$');
        let mut result = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            // The longest name counts: $resx is not $res and an x.
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

    /// The attributes of an element with parameters put in: those that are `needed`, then those that are not; others are refused.
    fn attributes<const N: usize, const M: usize>(
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

    /// What stands in an element that is an object, or the scene.
    fn parts(&mut self, parent: &Element) -> Result<Vec<Property>, Fault> {
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

    fn add_id(&mut self, id: String, object: Rc<Object>, place: &Place) -> Result<(), Fault> {
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
        // What stands beside the file comes first.
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
        // Files in the folder of the included one are found beside it, after those of this one.
        if let Some(folder) = self.folders.pop() {
            self.folders.insert(0, folder);
        }
        self.is_old = is_old;
        added
    }

    /// The parameter or part that an element is.
    fn property(&mut self, element: &Element) -> Result<Option<Property>, Fault> {
        let place = element.place.clone();
        let tag = element.tag.as_str();
        if OBJECTS.contains(&tag) || tag == "spectrum" && element.attribute("type").is_some() {
            let (name, object) = self.object(element)?;
            return Ok(Some(Property::new(name, Value::Object(object), place)));
        }
        let value = match tag {
            "float" | "integer" | "boolean" | "string" | "rgb" | "srgb" | "color" => {
                let ([name, text], [_intent]) = self.attributes(element, ["name", "value"], ["intent"])?;
                (name, plain(tag, &text, &place)?)
            }
            "spectrum" => self.spectrum(element)?,
            "blackbody" => {
                let ([name, kelvin], [scale]) =
                    self.attributes(element, ["name", "temperature"], ["scale"])?;
                let kelvin = number(kelvin.trim().trim_end_matches(['k', 'K']), &place)?;
                let scale = scale.map_or(Ok(1.0), |scale| number(&scale, &place))?;
                (name, Value::Spectrum(Spectrum::blackbody(kelvin, scale, &place)?))
            }
            "point" | "vector" => {
                let ([name], [value, x, y, z]) =
                    self.attributes(element, ["name"], ["value", "x", "y", "z"])?;
                (name, Value::Vector(vector([value, x, y, z], 0.0, &place)?))
            }
            "transform" => {
                let ([], [name]) = self.attributes(element, [], ["name"])?;
                (name.unwrap_or_else(|| "to_world".to_owned()), Value::Transform(self.transform(element)?))
            }
            "ref" => {
                let ([id], [name]) = self.attributes(element, ["id"], ["name"])?;
                (name.unwrap_or_default(), Value::Reference(id))
            }
            "animation" => {
                return fail(
                    &place,
                    "moving objects are not modelled",
                    "write one <transform> in the place of <animation>",
                );
            }
            "scene" => {
                return fail(&place, "a scene stands in a scene", "move what is in it up, or use <include>");
            }
            _ => {
                let mut known = vec![
                    "float",
                    "integer",
                    "boolean",
                    "string",
                    "rgb",
                    "spectrum",
                    "blackbody",
                    "point",
                    "vector",
                    "transform",
                    "ref",
                    "default",
                    "include",
                    "path",
                    "alias",
                ];
                known.extend(OBJECTS);
                let message = format!("<{}> is not known", shown(tag));
                return fail(&place, message, suggestion(tag, &known));
            }
        };
        if let Some(child) = element.children.first().filter(|_| tag != "transform") {
            let message = format!("<{}> cannot stand in <{}>", shown(&child.tag), shown(tag));
            return fail(&child.place, message, "close the element before");
        }
        let (name, value) = value;
        Ok(Some(Property::new(in_letters_of_today(&name), value, place)))
    }

    fn object(&mut self, element: &Element) -> Result<(String, Rc<Object>), Fault> {
        let ([plugin], [name, id]) = self.attributes(element, ["type"], ["name", "id"])?;
        let properties = self.parts(element)?;
        let object = Rc::new(Object {
            tag: if element.tag == "camera" { "sensor".to_owned() } else { element.tag.clone() },
            plugin,
            id: id.clone(),
            properties,
            place: element.place.clone(),
            is_old: self.is_old,
        });
        if let Some(id) = id {
            self.add_id(id, Rc::clone(&object), &element.place)?;
        }
        Ok((in_letters_of_today(&name.unwrap_or_default()), object))
    }

    fn spectrum(&mut self, element: &Element) -> Result<(String, Value), Fault> {
        let ([name], [value, file, _intent]) =
            self.attributes(element, ["name"], ["value", "filename", "intent"])?;
        let place = &element.place;
        let spectrum = match (value, file) {
            (Some(value), None) => Spectrum::parse(&value, place)?,
            (None, Some(file)) => {
                let Some(path) = find(&self.folders, &file) else {
                    let message = format!("there is no file `{}`", shown(&file));
                    return fail(
                        place,
                        message,
                        "correct its name, or write the values: value=\"400:0.3, 700:0.4\"",
                    );
                };
                let spectrum = spectrum_file(&path, place)?;
                self.spectra.push(path);
                spectrum
            }
            _ => {
                return fail(
                    place,
                    "<spectrum> needs `value` or `filename`, and not both",
                    "leave one of them",
                );
            }
        };
        Ok((name, Value::Spectrum(spectrum)))
    }

    fn transform(&mut self, element: &Element) -> Result<DAffine3, Fault> {
        let mut transform = DAffine3::IDENTITY;
        for step in &element.children {
            let place = &step.place;
            let next = match step.tag.as_str() {
                "translate" => {
                    let ([], values) = self.attributes(step, [], ["value", "x", "y", "z"])?;
                    DAffine3::from_translation(vector(values, 0.0, place)?)
                }
                "scale" => {
                    let ([], values) = self.attributes(step, [], ["value", "x", "y", "z"])?;
                    DAffine3::from_scale(vector(values, 1.0, place)?)
                }
                "rotate" => {
                    let ([angle], values) = self.attributes(step, ["angle"], ["value", "x", "y", "z"])?;
                    let axis = vector(values, 0.0, place)?;
                    let Some(axis) = crate::math::unit_f64(axis) else {
                        return fail(place, "the axis of the rotation is zero", "write for example y=\"1\"");
                    };
                    DAffine3::from_axis_angle(axis, number(&angle, place)?.to_radians())
                }
                "lookat" | "lookAt" | "look_at" => {
                    let ([origin, target], [up]) = self.attributes(step, ["origin", "target"], ["up"])?;
                    let (origin, target) = (triple(&origin, place)?, triple(&target, place)?);
                    let up = up.map_or(Ok(DVec3::ZERO), |up| triple(&up, place))?;
                    look_at(origin, target, up, place)?
                }
                "matrix" => {
                    let ([value], []) = self.attributes(step, ["value"], [])?;
                    matrix(&value, place)?
                }
                other => {
                    let message = format!("<{}> is no step of a transform", shown(other));
                    let known = ["translate", "rotate", "scale", "lookat", "matrix"];
                    return fail(place, message, suggestion(other, &known));
                }
            };
            if let Some(child) = step.children.first() {
                return fail(&child.place, "steps of a transform hold nothing", "write one after the other");
            }
            transform = next * transform;
            if !transform.is_finite() {
                return fail(place, "the transform is not finite", "make its numbers smaller");
            }
        }
        Ok(transform)
    }
}

/// x to the left, y up, z to the target, as sensors and emitters have it.
fn look_at(origin: DVec3, target: DVec3, up: DVec3, place: &Place) -> Result<DAffine3, Fault> {
    let Some(forward) = crate::math::unit_f64(target - origin) else {
        return fail(place, "`origin` and `target` are the same point", "move one of them");
    };
    let up = if up == DVec3::ZERO { forward.any_orthonormal_vector() } else { up };
    let Some(left) = crate::math::unit_f64(up.cross(forward)) else {
        return fail(place, "`up` is parallel to the view", "choose another `up`");
    };
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(left, forward.cross(left), forward), origin))
}

fn matrix(text: &str, place: &Place) -> Result<DAffine3, Fault> {
    let values: Vec<f64> = tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
    match values.len() {
        16 => {
            let row = |i: usize| DVec3::new(values[4 * i], values[4 * i + 1], values[4 * i + 2]);
            let linear = DMat3::from_cols(row(0), row(1), row(2)).transpose();
            let scale = values[15];
            if values[12..15] != [0.0; 3] || !(scale != 0.0) {
                return fail(
                    place,
                    "the last row of the matrix is not `0 0 0 1`",
                    "projections are not modelled",
                );
            }
            let translation = DVec3::new(values[3], values[7], values[11]);
            Ok(DAffine3::from_mat3_translation(linear * (1.0 / scale), translation / scale))
        }
        9 => {
            let row = |i: usize| DVec3::new(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
            Ok(DAffine3::from_mat3(DMat3::from_cols(row(0), row(1), row(2)).transpose()))
        }
        count => fail(place, format!("a matrix of {count} numbers"), "write 16 numbers, row after row, or 9"),
    }
}

pub(super) fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|token| !token.is_empty())
}

/// A finite number.
pub(super) fn number(text: &str, place: &Place) -> Result<f64, Fault> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => fail(place, format!("`{}` is no number", shown(text)), "write a number, for example 0.5"),
    }
}

fn triple(text: &str, place: &Place) -> Result<DVec3, Fault> {
    let values: Vec<f64> = tokens(text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
    match values[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        [x] => Ok(DVec3::splat(x)),
        _ => {
            let message = format!("`{}` is no vector", shown(text));
            fail(place, message, "write three numbers, for example `0, 1, 0`")
        }
    }
}

/// `value`, or `x`, `y` and `z`, which are `usual` where they are left out.
fn vector([value, x, y, z]: [Option<String>; 4], usual: f64, place: &Place) -> Result<DVec3, Fault> {
    let has_parts = x.is_some() || y.is_some() || z.is_some();
    match value {
        Some(_) if has_parts => fail(place, "both `value` and `x`, `y`, `z`", "leave one of them out"),
        Some(value) => triple(&value, place),
        None => {
            let of = |part: Option<String>| part.map_or(Ok(usual), |part| number(&part, place));
            Ok(DVec3::new(of(x)?, of(y)?, of(z)?))
        }
    }
}

/// The value of an element that holds one.
fn plain(tag: &str, text: &str, place: &Place) -> Result<Value, Fault> {
    Ok(match tag {
        "float" => Value::Float(number(text, place)?),
        "integer" => match text.trim().parse() {
            Ok(value) => Value::Integer(value),
            Err(_) => {
                return fail(place, format!("`{}` is no whole number", shown(text)), "write for example 64");
            }
        },
        "boolean" => match text.trim().to_ascii_lowercase().as_str() {
            "true" => Value::Boolean(true),
            "false" => Value::Boolean(false),
            _ => {
                return fail(
                    place,
                    format!("`{}` is neither true nor false", shown(text)),
                    "write true or false",
                );
            }
        },
        "string" => Value::Text(text.to_owned()),
        _ => Value::Spectrum(Spectrum::rgb(text, tag == "srgb", place)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_old_dialect() {
        for (old, today) in [
            ("intIOR", "int_ior"),
            ("toWorld", "to_world"),
            ("diffuseReflectance", "diffuse_reflectance"),
            ("sampleCount", "sample_count"),
            ("alphaU", "alpha_u"),
            ("to_world", "to_world"),
            ("color0", "color0"),
            ("maxDepth", "max_depth"),
        ] {
            assert_eq!(in_letters_of_today(old), today);
        }
    }
}
