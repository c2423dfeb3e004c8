//! Materials that modify others: both sides, masks, normal maps, bump maps, blends.

use super::Importer;
use super::error::{Fault, fail};
use super::paint::{Amount, Paint, Use};
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::text::{number, tokens};
use super::value::Object;
use std::rc::Rc;

impl Importer<'_> {
    pub(super) fn two_sided(&mut self, object: &Object) -> Result<Surface, Fault> {
        let sides = self.parts(object, "bsdf")?;
        let allow = ["allow_transmission"];
        self.ignore(object, &allow, "light passes what lets it pass");
        self.finish(object, &[])?;
        let Some(front) = sides.first() else {
            return fail(&object.place, "`twosided` holds no material", "put a <bsdf> or <ref> in it");
        };
        if sides.len() > 1 && !Rc::ptr_eq(front, &sides[1]) {
            self.report.warn(object, "the back has the material of the front: surfaces have but one");
        }
        let mut surface = self.surface(front)?;
        surface.two_sided = true;
        Ok(surface)
    }

    pub(super) fn mask(&mut self, object: &Object) -> Result<Surface, Fault> {
        let opacity = self.amount(object, "opacity", 0.5, Use::Alpha)?;
        let nested = self.only_part(object, "bsdf")?;
        self.finish(object, &["opacity"])?;
        let surface = self.surface(&nested)?;
        if surface.opacity.is_some() {
            self.report.warn(object, "a mask over a mask: the outer one counts");
        }
        Ok(Surface { opacity: Some(opacity), ..surface })
    }

    pub(super) fn normal_map(&mut self, object: &Object) -> Result<Surface, Fault> {
        let name = if object.has("normals") { "normals" } else { "normalmap" };
        let normals = match object.get(name) {
            Some(_) => self.paint(object, name, 0.5, Meaning::Number)?,
            None => {
                // In versions before 2.0 the texture had no name.
                let texture = self.only_part(object, "texture")?;
                self.nested_paint(&texture, Meaning::Number)?
            }
        };
        let nested = self.only_part(object, "bsdf")?;
        self.ignore(
            object,
            &["flip_invalid_normals", "use_shadowing_function"],
            "light below the surface is kept in another way",
        );
        self.finish(object, &["normalmap"])?;
        let surface = self.surface(&nested)?;
        if surface.normal.is_some() || surface.bump.is_some() {
            self.report.warn(object, "normals over normals: the outer ones count");
        }
        match normals.slot() {
            Some(slot) => Ok(Surface { normal: Some(slot), bump: None, ..surface }),
            None => {
                self.report.warn(object, "normals that do not vary are left out");
                Ok(surface)
            }
        }
    }

    pub(super) fn bump_map(&mut self, object: &Object) -> Result<Surface, Fault> {
        let textures = self.parts(object, "texture")?;
        let nested = self.only_part(object, "bsdf")?;
        let scale = object.float_or("scale", 1.0)?;
        self.ignore(
            object,
            &["flip_invalid_normals", "use_shadowing_function"],
            "light below the surface is kept in another way",
        );
        self.finish(object, &["scale"])?;
        let surface = self.surface(&nested)?;
        let Some(texture) = textures.first() else {
            return fail(
                &object.place,
                "`bumpmap` holds no texture",
                "put a <texture type=\"bitmap\"> in it",
            );
        };
        match self.nested_paint(texture, Meaning::Number)? {
            Paint::Picture(slot, _) => Ok(Surface { bump: Some((slot, scale)), normal: None, ..surface }),
            _ => {
                self.report.warn(object, "heights that do not vary are left out");
                Ok(surface)
            }
        }
    }

    pub(super) fn blend(&mut self, object: &Object) -> Result<Surface, Fault> {
        let weight = self.amount(object, "weight", 0.5, Use::Alpha)?;
        let parts = self.parts(object, "bsdf")?;
        self.finish(object, &["weight"])?;
        let [first, second] = &parts[..] else {
            let message = format!("`blendbsdf` holds {} materials, and two are needed", parts.len());
            return fail(&object.place, message, "put two <bsdf> or <ref> in it");
        };
        let (a, b) = (self.surface(first)?, self.surface(second)?);
        match weight.plain() {
            Some(weight) => Ok(self.mixed(object, (a, 1.0 - weight), (b, weight))),
            // A varying weight between a material and nothing is a mask.
            None if matches!(a.base, Base::Null) => Ok(Surface { opacity: Some(weight), ..b }),
            None => {
                let mean = match &weight {
                    Amount::Picture(slot) => f64::from(slot.texture.mean().w),
                    Amount::Plain(weight) => *weight,
                };
                self.report.warn(object, "a weight that varies is taken for its mean");
                Ok(self.mixed(object, (a, 1.0 - mean), (b, mean)))
            }
        }
    }

    pub(super) fn mixture(&mut self, object: &Object) -> Result<Surface, Fault> {
        let text = object.text("weights")?.unwrap_or_default().to_owned();
        let place = object.get("weights").map_or(&object.place, |property| &property.place);
        let weights: Vec<f64> = tokens(&text).map(|token| number(token, place)).collect::<Result<_, _>>()?;
        let parts = self.parts(object, "bsdf")?;
        self.finish(object, &["weights"])?;
        if weights.len() != parts.len() || parts.is_empty() || weights.iter().any(|weight| *weight < 0.0) {
            let message = format!("{} weights for {} materials", weights.len(), parts.len());
            return fail(place, message, "give each material a weight of 0 or more");
        }
        let mut mixed = (self.surface(&parts[0])?, weights[0]);
        for (part, weight) in parts.iter().zip(&weights).skip(1) {
            let next = self.surface(part)?;
            let sum = mixed.1 + weight;
            mixed = (self.mixed(object, mixed, (next, *weight)), sum);
        }
        Ok(mixed.0)
    }

    /// Blends two materials by their weights, where that can be modelled; otherwise yields the one with the larger weight.
    fn mixed(&mut self, object: &Object, (a, x): (Surface, f64), (b, y): (Surface, f64)) -> Surface {
        let share = if x + y > 0.0 { (y / (x + y)).clamp(0.0, 1.0) } else { 0.5 };
        let (mixed, is_exact) = a.mixed_with(b, share);
        if !is_exact {
            self.report
                .warn(object, "this blend cannot be modelled: the heavier of its materials is shown alone");
        }
        mixed
    }
}
