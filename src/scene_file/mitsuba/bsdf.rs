//! Converts materials of a file to the nearest models of this renderer.

use super::Importer;
use super::error::{Fault, fail};
use super::report::Subject;
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::text::shown;
use super::value::{Object, Value};
use crate::scene_file::diagnostic::suggestion;
use std::rc::Rc;

impl Importer<'_> {
    /// The only part of an object with the element `tag`.
    pub(super) fn only_part(&mut self, object: &Object, tag: &str) -> Result<Rc<Object>, Fault> {
        let mut parts = self.parts(object, tag)?;
        match (parts.pop(), parts.is_empty()) {
            (Some(part), true) => Ok(part),
            (found, _) => {
                let count = parts.len() + usize::from(found.is_some());
                let message = format!("{} holds {count} of <{tag}>, and one is needed", object.label());
                fail(&object.place, message, format!("put one <{tag} type=\"...\"> or <ref> in it"))
            }
        }
    }

    /// The parts of an object with the element `tag`, in their order.
    pub(super) fn parts(&mut self, object: &Object, tag: &str) -> Result<Vec<Rc<Object>>, Fault> {
        let mut parts = Vec::new();
        for property in &object.properties {
            if !matches!(property.value, Value::Object(_) | Value::Reference(_)) {
                continue;
            }
            if let Some(part) = self.object_of(property)?.filter(|part| part.tag == tag) {
                property.mark();
                parts.push(part);
            }
        }
        Ok(parts)
    }

    /// Converts an object to a material.
    pub(super) fn surface(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        let key = Rc::as_ptr(object);
        if let Some(known) = self.surfaces.get(&key) {
            return Ok(known.clone());
        }
        self.enter(object)?;
        let surface = self.surface_of(object);
        self.leave();
        let surface = surface?;
        self.surfaces.insert(key, surface.clone());
        Ok(surface)
    }

    fn surface_of(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        match object.plugin.as_str() {
            "diffuse" => {
                let name =
                    if object.has("diffuse_reflectance") { "diffuse_reflectance" } else { "reflectance" };
                let paint = self.paint(object, name, 0.5, Meaning::Reflectance)?;
                self.finish(object, &["reflectance"])?;
                Ok(Base::Diffuse(paint).into())
            }
            "roughdiffuse" => {
                let paint = self.paint(object, "reflectance", 0.5, Meaning::Reflectance)?;
                let alpha = self.plain_amount(object, "alpha", 0.2)?;
                self.ignore(object, &["use_fast_approx"], "the model is another");
                self.finish(object, &["reflectance", "alpha"])?;
                if alpha > 0.0 {
                    self.report.note(object, "is taken for an ideal diffuse surface");
                }
                Ok(Base::Diffuse(paint).into())
            }
            "dielectric" | "roughdielectric" => self.dielectric(object),
            "thindielectric" => self.thin_dielectric(object),
            "conductor" | "roughconductor" => self.conductor(object),
            "plastic" | "roughplastic" => self.plastic(object),
            "principled" | "principledthin" => self.principled(object),
            "twosided" => self.two_sided(object),
            "mask" => self.mask(object),
            "normalmap" => self.normal_map(object),
            "bumpmap" => self.bump_map(object),
            "blendbsdf" => self.blend(object),
            "mixturebsdf" => self.mixture(object),
            "null" => {
                self.finish(object, &[])?;
                Ok(Base::Null.into())
            }
            "difftrans" | "coating" | "roughcoating" | "phong" | "ward" | "hair" | "measured"
            | "pplastic" | "measured_polarized" | "polarizer" | "retarder" | "circular" | "hk" | "irawan" => {
                fail(
                    &object.place,
                    format!("the material `{}` is not modelled", object.plugin),
                    "put `diffuse`, `roughplastic`, `roughconductor`, `roughdielectric` or `principled` in its place",
                )
            }
            other => {
                let known = [
                    "diffuse",
                    "dielectric",
                    "roughdielectric",
                    "thindielectric",
                    "conductor",
                    "roughconductor",
                    "plastic",
                    "roughplastic",
                    "principled",
                    "twosided",
                    "mask",
                    "normalmap",
                    "bumpmap",
                    "blendbsdf",
                    "null",
                ];
                let message = format!("the material `{}` is not known", shown(other));
                fail(&object.place, message, suggestion(other, &known))
            }
        }
    }
}
