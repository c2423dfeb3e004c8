//! Colours and numbers of materials: constants, pictures and checkerboards.

use super::Importer;
use super::error::{Fault, fail};
use super::import::pictures::checkers;
use super::paint::{Amount, Paint, Use, luminance};
use super::text::{number, tokens};

use super::spectrum::{Meaning, Spectrum};

use super::report::Subject;
use super::text::shown;
use super::value::{Object, Property, Value};
use crate::scene_file::diagnostic::suggestion;
use crate::textures::TextureSlot;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::rc::Rc;

impl Importer<'_> {
    /// The object that a parameter holds or refers to; `None` where it is a plain value.
    pub(super) fn object_of(&self, property: &Property) -> Result<Option<Rc<Object>>, Fault> {
        match &property.value {
            Value::Object(object) => Ok(Some(Rc::clone(object))),
            Value::Reference(id) => match self.ids.get(id) {
                Some(object) => Ok(Some(Rc::clone(object))),
                None => {
                    let mut names: Vec<&str> = self.ids.keys().map(String::as_str).collect();
                    names.sort_unstable();
                    let known = suggestion(id, &names);
                    fail(&property.place, format!("there is no object `{}`", shown(id)), known)
                }
            },
            _ => Ok(None),
        }
    }

    /// The path of the file that parameter `name` of an object gives.
    pub(super) fn file(&mut self, object: &Object, name: &str) -> Result<PathBuf, Fault> {
        let Some(file) = object.text(name)? else {
            let message = format!("{} names no file", object.label());
            let remedy = format!("write <string name=\"{name}\" value=\"...\"/> in it");
            return fail(&object.place, message, remedy);
        };
        let place = object.get(name).map_or(&object.place, |property| &property.place);
        // Beside the file that names it, then in the folders of the scene.
        let beside = place.location.file.parent().map(Path::to_path_buf);
        let folders: Vec<PathBuf> = self.folders.iter().cloned().chain(beside).collect();
        match super::parse::find(&folders, file) {
            Some(path) => {
                self.description.further_files.push(path.clone());
                Ok(path)
            }
            None => {
                let message = format!("there is no file `{}` for {}", shown(file), object.label());
                fail(
                    place,
                    message,
                    "correct its name, put it there, or name its folder by <path value=\"...\"/>",
                )
            }
        }
    }

    /// Reads a colour.
    pub(super) fn paint(
        &mut self,
        object: &Object,
        name: &str,
        usual: f64,
        meaning: Meaning,
    ) -> Result<Paint, Fault> {
        let Some(property) = object.get(name) else { return Ok(Paint::Plain(DVec3::splat(usual))) };
        let colour = match &property.value {
            Value::Float(value) => Spectrum::Rgb(DVec3::splat(*value)).colour(meaning),
            Value::Integer(value) => Spectrum::Rgb(DVec3::splat(*value as f64)).colour(meaning),
            Value::Spectrum(spectrum) => spectrum.colour(meaning),
            _ => match self.object_of(property)? {
                Some(nested) => {
                    let how = if matches!(meaning, Meaning::Light { .. }) { Use::Glow } else { Use::Colour };
                    return self.texture(&nested, meaning, how);
                }
                None => {
                    let message = format!("`{name}` of {} is no colour", object.label());
                    let remedy =
                        format!("write <rgb name=\"{name}\" value=\"0.5, 0.5, 0.5\"/> or a <texture>");
                    return fail(&property.place, message, remedy);
                }
            },
        };
        Ok(Paint::Plain(colour))
    }

    /// Reads a colour that must be constant: a colour that varies is replaced by its approximate mean, with a note.
    pub(super) fn plain_colour(
        &mut self,
        object: &Object,
        name: &str,
        usual: f64,
        meaning: Meaning,
    ) -> Result<DVec3, Fault> {
        let paint = self.paint(object, name, usual, meaning)?;
        if !matches!(paint, Paint::Plain(_)) {
            self.report.note(object, format!("`{name}` does not vary here: its mean counts"));
        }
        Ok(paint.mean())
    }

    /// Reads a number.
    pub(super) fn amount(
        &mut self,
        object: &Object,
        name: &str,
        usual: f64,
        how: Use,
    ) -> Result<Amount, Fault> {
        let Some(property) = object.get(name) else { return Ok(Amount::Plain(usual)) };
        if let Some(nested) = self.object_of(property)? {
            return Ok(match self.texture(&nested, Meaning::Number, how)? {
                Paint::Picture(slot, _) => Amount::Picture(slot),
                Paint::Plain(colour) => Amount::Plain(luminance(colour)),
                Paint::Vertices(_) => {
                    self.report.note(object, format!("`{name}` by the colours of vertices is taken for 0.5"));
                    Amount::Plain(0.5)
                }
            });
        }
        match &property.value {
            Value::Spectrum(spectrum) => Ok(Amount::Plain(luminance(spectrum.colour(Meaning::Number)))),
            _ => Ok(Amount::Plain(object.float_or(name, usual)?)),
        }
    }

    /// Reads a number that must be constant.
    pub(super) fn plain_amount(&mut self, object: &Object, name: &str, usual: f64) -> Result<f64, Fault> {
        match self.amount(object, name, usual, Use::Raw)? {
            Amount::Plain(value) => Ok(value),
            Amount::Picture(slot) => {
                self.report.note(object, format!("`{name}` does not vary here: its mean counts"));
                Ok(luminance(slot.texture.mean().truncate().as_dvec3()))
            }
        }
    }

    /// Reads a nested texture whose numbers are used without conversion.
    pub(super) fn nested_paint(&mut self, object: &Rc<Object>, meaning: Meaning) -> Result<Paint, Fault> {
        self.texture(object, meaning, Use::Raw)
    }

    /// Reads a <texture> or a <spectrum> of any type.
    fn texture(&mut self, object: &Rc<Object>, meaning: Meaning, how: Use) -> Result<Paint, Fault> {
        self.enter(object)?;
        let paint = self.texture_of(object, meaning, how);
        self.leave();
        paint
    }

    fn texture_of(&mut self, object: &Rc<Object>, meaning: Meaning, how: Use) -> Result<Paint, Fault> {
        let of = |spectrum: Spectrum| Paint::Plain(spectrum.colour(meaning));
        match (object.tag.as_str(), object.plugin.as_str()) {
            ("texture", "bitmap" | "ldrtexture" | "exrtexture") => self.bitmap(object, how),
            ("texture", "checkerboard") => self.checkerboard(object, meaning, how),
            ("texture", "scale") => {
                let factor = self.plain_colour(object, "scale", 1.0, Meaning::Number)?;
                let nested = self.only_part(object, "texture")?;
                let paint = self.texture(&nested, meaning, how)?;
                self.finish(object, &["scale"])?;
                if how != Use::Colour && how != Use::Glow && !matches!(paint, Paint::Plain(_)) {
                    self.report.note(object, "the scale of a picture of numbers is not applied");
                }
                Ok(paint.times(factor))
            }
            ("texture", "mesh_attribute" | "vertexcolors") => {
                let name = object.text("name")?.unwrap_or("vertex_color").to_owned();
                let scale = object.float_or("scale", 1.0)?;
                self.finish(object, &["name", "scale"])?;
                if name != "vertex_color" {
                    let message = format!("the attribute `{}` of meshes is not read", shown(&name));
                    return fail(&object.place, message, "colours of vertices are: `vertex_color`");
                }
                Ok(Paint::Vertices(DVec3::splat(scale)))
            }
            (_, "uniform" | "rawconstant") => {
                let value = object.float_or("value", 1.0)?;
                self.ignore(
                    object,
                    &["wavelength_min", "wavelength_max"],
                    "the spectrum is the same everywhere",
                );
                self.finish(object, &["value"])?;
                Ok(of(Spectrum::Uniform(value)))
            }
            (_, "srgb") => {
                let colour = self.plain_colour(object, "color", 1.0, meaning)?;
                self.ignore(object, &["unbounded"], "colours are read as they are");
                self.finish(object, &["color"])?;
                Ok(Paint::Plain(colour))
            }
            (_, "d65") => {
                let scale = object.float_or("scale", 1.0)?;
                let colour = self.plain_colour(object, "color", 1.0, meaning)?;
                self.finish(object, &["scale", "color"])?;
                Ok(Paint::Plain(colour * scale))
            }
            (_, "blackbody") => {
                let Some(kelvin) = object.float("temperature")? else {
                    return fail(
                        &object.place,
                        "a black body without a temperature",
                        "write <float name=\"temperature\" value=\"6500\"/> in it",
                    );
                };
                let scale = object.float_or("scale", 1.0)?;
                self.ignore(
                    object,
                    &["wavelength_min", "wavelength_max"],
                    "what is seen of the spectrum counts",
                );
                self.finish(object, &["temperature", "scale"])?;
                Ok(of(Spectrum::blackbody(kelvin, scale, &object.place)?))
            }
            (_, "irregular" | "regular") => {
                let numbers = |name: &str| -> Result<Vec<f64>, Fault> {
                    let text = object.text(name)?.unwrap_or_default();
                    tokens(text).map(|token| number(token, &object.place)).collect()
                };
                let values = numbers("values")?;
                let wavelengths = if object.plugin == "irregular" {
                    numbers("wavelengths")?
                } else {
                    let low = object.float_or("wavelength_min", 360.0)?;
                    let high = object.float_or("wavelength_max", 830.0)?;
                    let step = (high - low) / values.len().saturating_sub(1).max(1) as f64;
                    (0..values.len()).map(|i| low + step * i as f64).collect()
                };
                self.finish(object, &["values", "wavelengths", "wavelength_min", "wavelength_max"])?;
                if values.len() != wavelengths.len() {
                    let message = format!("{} wavelengths and {} values", wavelengths.len(), values.len());
                    return fail(&object.place, message, "give each wavelength a value");
                }
                let pairs: Vec<String> =
                    wavelengths.iter().zip(&values).map(|(at, value)| format!("{at}:{value}")).collect();
                Ok(of(Spectrum::parse(&pairs.join(","), &object.place)?))
            }
            (tag, plugin) => {
                let message = format!("the {} `{}` is not read", shown(tag), shown(plugin));
                let known =
                    ["bitmap", "checkerboard", "mesh_attribute", "scale", "d65", "blackbody", "uniform"];
                let known = suggestion(plugin, &known);
                fail(&object.place, message, format!("bake it into a picture, and use `bitmap`; {known}"))
            }
        }
    }

    fn bitmap(&mut self, object: &Rc<Object>, how: Use) -> Result<Paint, Fault> {
        let path = self.file(object, "filename")?;
        let is_raw = match object.float("gamma")? {
            None | Some(-1.0) => object.boolean("raw", false)?,
            Some(1.0) => true,
            Some(gamma) => {
                if (gamma - 2.2).abs() > 0.01 {
                    self.report.note(object, "the gamma of the picture is taken for the curve of sRGB");
                }
                false
            }
        };
        if let Some(channel) = object.text("channel")? {
            self.report.note(
                object,
                format!("`channel` `{}` is not chosen: colours of the picture count", shown(channel)),
            );
        }
        let sampler = self.sampler(object)?;
        let transform = Self::to_uv(object)?;
        self.finish(object, &["filename", "raw", "to_uv", "wrap_mode", "filter_type", "gamma", "channel"])?;
        let (texture, factor) = self.picture(object, &path, how, is_raw)?;
        Ok(Paint::Picture(TextureSlot { texture, sampler, set: 0, transform }, DVec3::splat(factor)))
    }

    /// Two colours in squares of half a unit.
    fn checkerboard(&mut self, object: &Rc<Object>, meaning: Meaning, how: Use) -> Result<Paint, Fault> {
        let of_old = matches!(meaning, Meaning::Light { is_old: true });
        let meaning = if of_old { Meaning::Number } else { meaning };
        let colours = [
            self.plain_colour(object, "color0", 0.4, meaning)?,
            self.plain_colour(object, "color1", 0.2, meaning)?,
        ];
        let transform = Self::to_uv(object)?;
        self.finish(object, &["color0", "color1", "to_uv"])?;
        Ok(checkers(colours, how, transform))
    }
}
