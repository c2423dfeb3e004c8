//! The elements of a scene: values, objects, spectra, transforms.

use super::error::{Fault, fail};
use super::literal::{look_at, matrix, plain, triple, vector};
use super::parse::{Parser, find};
use super::spectrum::{Spectrum, spectrum_file};
use super::text::number;
use super::text::shown;
use super::value::{Object, Property, Value};
use super::xml::Element;
use crate::scene_file::diagnostic::suggestion;
use glam::{DAffine3, DVec3};
use std::rc::Rc;

/// Elements that define objects.
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

/// Converts old names to new ones: `intIOR` to `int_ior`.
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

impl Parser<'_> {
    /// The parameter or part that an element defines.
    pub(super) fn property(&mut self, element: &Element) -> Result<Option<Property>, Fault> {
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
