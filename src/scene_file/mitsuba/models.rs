//! Dielectric, conductor and plastic materials.

use super::Importer;
use super::error::{Fault, fail};
use super::facets::Distribution;
use super::import::models::{base_factor, glass, plastic, thin_sheet, tinted_metal, under_a_coat};
use super::indices::{self, MEDIA};
use super::paint::{Amount, Paint, Use};
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::text::shown;
use super::value::{Object, Value};
use crate::bsdf::Metal;
use crate::math::Rgb;
use crate::scene_file::diagnostic::suggestion;
use glam::DVec3;

impl Importer<'_> {
    /// An index of refraction, given as a number or as the name of a medium.
    fn index(&mut self, object: &Object, name: &str, usual: f64) -> Result<f64, Fault> {
        let Some(property) = object.get(name) else { return Ok(usual) };
        let index = match &property.value {
            Value::Text(text) => match indices::medium(text) {
                Some(index) => index,
                None => {
                    let known: Vec<&str> = MEDIA.iter().map(|(name, _)| *name).collect();
                    let message = format!("the index of `{}` is not known", shown(text));
                    return fail(&property.place, message, suggestion(text, &known));
                }
            },
            _ => object.float_or(name, usual)?,
        };
        if !(0.1..=10.0).contains(&index) {
            let message = format!("an index of refraction of {index}");
            return fail(&property.place, message, "write a number from 0.1 to 10, for example 1.5");
        }
        Ok(index)
    }

    fn indices(&mut self, object: &Object) -> Result<[f64; 2], Fault> {
        Ok([self.index(object, "int_ior", 1.5046)?, self.index(object, "ext_ior", 1.000_277)?])
    }

    /// The slopes of facets; reports a distribution that is not supported.
    fn slopes(&mut self, object: &Object, usual: f64) -> Result<[Amount; 2], Fault> {
        let distribution = object.text("distribution")?.unwrap_or("beckmann").to_ascii_lowercase();
        match distribution.as_str() {
            "ggx" => {}
            "beckmann" | "phong" | "as" => {
                let name = if distribution == "beckmann" {
                    "Beckmann's distribution"
                } else {
                    "Phong's distribution"
                };
                self.report.note(
                    object,
                    format!("{name} of facets is taken for GGX of the same `alpha`, which has longer tails"),
                );
            }
            other => {
                let known = suggestion(other, &["beckmann", "ggx"]);
                return fail(
                    &object.place,
                    format!("`{}` is no distribution of facets", shown(other)),
                    known,
                );
            }
        }
        self.ignore(object, &["sample_visible"], "facets are always drawn by what is seen of them");
        let range = |amount: Amount| match amount {
            Amount::Plain(value) => Amount::Plain(value.clamp(0.0, 1.0)),
            picture => picture,
        };
        if object.has("alpha_u") || object.has("alpha_v") {
            let along = self.amount(object, "alpha_u", usual, Use::Slope)?;
            let across = self.amount(object, "alpha_v", usual, Use::Slope)?;
            return Ok([range(along), range(across)]);
        }
        let alpha = range(self.amount(object, "alpha", usual, Use::Slope)?);
        Ok([alpha.clone(), alpha])
    }

    /// A single slope, for models that have only one.
    fn one_slope(&mut self, object: &Object, usual: f64) -> Result<Amount, Fault> {
        let [along, across] = self.slopes(object, usual)?;
        match (along.plain(), across.plain()) {
            (Some(a), Some(b)) if a != b => {
                self.report.note(object, "`alpha_u` and `alpha_v` are taken for their geometric mean");
                Ok(Amount::Plain((a * b).sqrt()))
            }
            _ => Ok(along),
        }
    }

    pub(super) fn dielectric(&mut self, object: &Object) -> Result<Surface, Fault> {
        let is_rough = object.plugin == "roughdielectric";
        let indices = self.indices(object)?;
        let slope = if is_rough { self.one_slope(object, 0.1)? } else { Amount::Plain(0.0) };
        let reflected = self.paint(object, "specular_reflectance", 1.0, Meaning::Reflectance)?;
        let passed = self.paint(object, "specular_transmittance", 1.0, Meaning::Reflectance)?;
        let known =
            ["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance", "alpha", "distribution"];
        self.finish(object, &known)?;
        let white = Paint::Plain(DVec3::ONE);
        if reflected != white {
            self.report.note(
                object,
                "`specular_reflectance` is not used: as much is reflected as Fresnel's formula says",
            );
        }
        Ok(glass(indices, slope, &passed).into())
    }

    pub(super) fn thin_dielectric(&mut self, object: &Object) -> Result<Surface, Fault> {
        let [inside, outside] = self.indices(object)?;
        let reflected = self.plain_colour(object, "specular_reflectance", 1.0, Meaning::Reflectance)?;
        let passed = self.paint(object, "specular_transmittance", 1.0, Meaning::Reflectance)?;
        self.finish(object, &["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"])?;
        self.report.note(object, "reflects by Schlick's approximation of Fresnel's formula");
        let material = thin_sheet(inside / outside, reflected, &passed);
        Ok(Base::Layered(material).into())
    }

    fn metal(&mut self, object: &Object) -> Result<Metal, Fault> {
        let name = object.text("material")?.map(str::to_owned);
        let is_named = name.as_deref().is_some_and(|name| name != "none");
        if !is_named && !object.has("eta") && !object.has("k") {
            // In old files a missing material means copper, in current files a mirror.
            let is_mirror = name.is_some() || !object.is_old;
            return Ok(if is_mirror {
                Metal::Colour(Rgb::ONE)
            } else {
                indices::metal("Cu").unwrap_or(Metal::Colour(Rgb::ONE))
            });
        }
        if let (Some(name), true) = (&name, is_named) {
            return match indices::metal(name) {
                Some(metal) => Ok(metal),
                None => {
                    let known: Vec<&str> = indices::symbols().chain(["none"]).collect();
                    let place = object.get("material").map_or(&object.place, |property| &property.place);
                    let message = format!("the indices of the metal `{}` are not known", shown(name));
                    let remedy = format!(
                        "write them as <rgb name=\"eta\" .../> and <rgb name=\"k\" .../>; {}",
                        suggestion(name, &known)
                    );
                    fail(place, message, remedy)
                }
            };
        }
        let eta = self.plain_colour(object, "eta", 0.0, Meaning::Number)?;
        let k = self.plain_colour(object, "k", 1.0, Meaning::Number)?;
        let outside = if object.has("ext_eta") { self.index(object, "ext_eta", 1.0)? } else { 1.0 };
        Ok(Metal::Index { eta: (eta / outside).as_vec3(), k: (k / outside).as_vec3() })
    }

    pub(super) fn conductor(&mut self, object: &Object) -> Result<Surface, Fault> {
        let is_rough = object.plugin == "roughconductor";
        let metal = self.metal(object)?;
        let smooth = || [const { Amount::Plain(0.0) }; 2];
        let slopes = if is_rough { self.slopes(object, 0.1)? } else { smooth() };
        let tint = self.paint(object, "specular_reflectance", 1.0, Meaning::Reflectance)?;
        let known = [
            "material",
            "eta",
            "k",
            "specular_reflectance",
            "distribution",
            "alpha",
            "alpha_u",
            "alpha_v",
            "ext_eta",
        ];
        self.finish(object, &known)?;
        let plain = slopes[0].plain().zip(slopes[1].plain());
        if let (Some((along, across)), true) = (plain, tint == Paint::Plain(DVec3::ONE)) {
            return Ok(Base::Metal { metal, slopes: [along, across] }.into());
        }
        self.report.note(object, "reflects by Schlick's approximation of the formula for metals, as it is tinted or its roughness varies");
        let material = tinted_metal(metal, &tint, slopes);
        Ok(Base::Layered(material).into())
    }

    pub(super) fn plastic(&mut self, object: &Object) -> Result<Surface, Fault> {
        let is_rough = object.plugin == "roughplastic";
        let [inside, outside] = self.indices(object)?;
        let slope = if is_rough { self.one_slope(object, 0.1)? } else { Amount::Plain(0.0) };
        let diffuse = self.paint(object, "diffuse_reflectance", 0.5, Meaning::Reflectance)?;
        let specular = self.plain_colour(object, "specular_reflectance", 1.0, Meaning::Reflectance)?;
        let is_nonlinear = object.boolean("nonlinear", false)?;
        let known = [
            "int_ior",
            "ext_ior",
            "diffuse_reflectance",
            "specular_reflectance",
            "nonlinear",
            "alpha",
            "distribution",
        ];
        self.finish(object, &known)?;
        let ior = (inside / outside).max(1.0);
        let diffuse = match (diffuse, is_nonlinear) {
            (Paint::Plain(colour), true) => Paint::Plain(under_a_coat(colour, ior)),
            (paint, true) => {
                self.report
                    .note(object, "`nonlinear` is not used: colours of its picture are less saturated");
                paint
            }
            (paint, false) => paint,
        };
        let distribution = match object.text("distribution")? {
            Some(name) if name.eq_ignore_ascii_case("ggx") => Distribution::Ggx,
            _ => Distribution::Beckmann,
        };
        self.report.note(object, "reflects by Schlick's approximation of Fresnel's formula");
        let diffuse = diffuse.times(DVec3::splat(base_factor(distribution, &slope, ior)));
        let material = plastic(ior, &diffuse, specular, slope);
        Ok(Base::Layered(material).into())
    }
}
