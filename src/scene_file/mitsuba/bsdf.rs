//! Materials of a file as the nearest models that there are.

use super::Importer;
use super::error::{Fault, fail};
use super::facets::{Distribution, diffuse_factor};
use super::indices::{self, MEDIA};
use super::spectrum::Meaning;
use super::texture::{Amount, Paint, Use};
use super::value::{Object, Value, shown};
use crate::bsdf::{LayeredParameters, Metal};
use crate::math::Rgb;
use crate::scene::LayeredMaterial;
use crate::scene_file::diagnostic::suggestion;
use crate::textures::TextureSlot;
use glam::DVec3;
use std::rc::Rc;

/// What scatters light.
#[derive(Clone, Debug)]
pub(super) enum Base {
    Diffuse(Paint),
    /// Layers of facets over a base; not the border of a medium.
    Layered(LayeredMaterial),
    /// The same as the border of media of these indices, inside and outside.
    Border(LayeredMaterial, [f64; 2]),
    /// With the slopes of its facets along the surface and across.
    Metal {
        metal: Metal,
        slopes: [f64; 2],
    },
    Glass {
        indices: [f64; 2],
        slope: f64,
    },
    /// Nothing: light passes.
    Null,
}

/// A material, and what goes over all of it.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub base: Base,
    /// Whether the back is like the front.
    pub two_sided: bool,
    /// The share of it that is there.
    pub opacity: Option<Amount>,
    pub normal: Option<TextureSlot>,
    /// Heights over it, in lengths of the scene for one of the picture.
    pub bump: Option<(TextureSlot, f64)>,
}

impl From<Base> for Surface {
    fn from(base: Base) -> Self {
        Self { base, two_sided: false, opacity: None, normal: None, bump: None }
    }
}

/// Layers that reflect nothing by facets.
fn matt() -> LayeredParameters {
    LayeredParameters { metallic: 0.0, specular: 0.0, ..LayeredParameters::default() }
}

/// The square of `(ior - 1) / (ior + 1)`.
pub(super) fn normal_reflectance(ior: f64) -> f64 {
    ((ior - 1.0) / (ior + 1.0)).powi(2)
}

impl Base {
    /// The same as layers, for what only these can vary: textures, holes, normals.
    pub(super) fn layered(self) -> (LayeredMaterial, Option<[f64; 2]>) {
        match self {
            Self::Diffuse(paint) => {
                let factors = LayeredParameters { base: paint.factor(), ..matt() };
                let coloured = matches!(paint, Paint::Vertices(_));
                (
                    LayeredMaterial { factors, coloured, base: paint.slot(), ..LayeredMaterial::default() },
                    None,
                )
            }
            Self::Layered(material) => (material, None),
            Self::Border(material, indices) => (material, Some(indices)),
            Self::Metal { metal, slopes } => {
                let factors =
                    LayeredParameters { base: metal.reflectance(1.0), ..LayeredParameters::default() };
                let (roughness, anisotropy) = stretched(slopes);
                (LayeredMaterial { factors, roughness, anisotropy, ..LayeredMaterial::default() }, None)
            }
            Self::Glass { indices, slope } => {
                let factors = LayeredParameters {
                    metallic: 0.0,
                    transmission: 1.0,
                    ior: (indices[0] / indices[1]) as f32,
                    ..LayeredParameters::default()
                };
                let roughness = slope.sqrt() as f32;
                (LayeredMaterial { factors, roughness, ..LayeredMaterial::default() }, Some(indices))
            }
            Self::Null => {
                (LayeredMaterial { factors: matt(), alpha: 0.0, ..LayeredMaterial::default() }, None)
            }
        }
    }
}

/// Roughness and anisotropy, in the terms of glTF, of facets with these slopes.
pub(super) fn stretched([along, across]: [f64; 2]) -> (f32, [f32; 2]) {
    let (least, most) = (along.min(across).clamp(0.0, 1.0), along.max(across).clamp(0.0, 1.0));
    let strength = if least < 1.0 { ((most - least) / (1.0 - least)).sqrt() } else { 0.0 };
    let turn = if along < across { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    let turn = if strength > 0.0 { turn } else { 0.0 };
    (least.sqrt() as f32, [strength as f32, turn as f32])
}

impl Importer {
    /// The only part of an object that is one of `tag`.
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

    /// The parts of an object that are of `tag`, in their order.
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

    /// The material that an object is.
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

    /// An index of refraction: a number, or the name of a medium.
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

    /// The slope of facets; tells where the distribution is another.
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

    /// One slope where the model has but one.
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

    fn dielectric(&mut self, object: &Object) -> Result<Surface, Fault> {
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
        if let (Amount::Plain(slope), true) = (&slope, passed == white) {
            return Ok(Base::Glass { indices, slope: *slope }.into());
        }
        let (mut material, _) = Base::Glass { indices, slope: slope.plain().unwrap_or(1.0) }.layered();
        material.factors.base = passed.factor();
        material.base = passed.slot();
        if let Amount::Picture(slot) = slope {
            material.metallic_roughness = Some(slot);
        }
        Ok(Base::Border(material, indices).into())
    }

    fn thin_dielectric(&mut self, object: &Object) -> Result<Surface, Fault> {
        let [inside, outside] = self.indices(object)?;
        let reflected = self.plain_colour(object, "specular_reflectance", 1.0, Meaning::Reflectance)?;
        let passed = self.paint(object, "specular_transmittance", 1.0, Meaning::Reflectance)?;
        self.finish(object, &["int_ior", "ext_ior", "specular_reflectance", "specular_transmittance"])?;
        let mut ior = inside / outside;
        if ior < 1.0 {
            ior = 1.0 / ior;
        }
        let single = normal_reflectance(ior);
        // Light goes back and forth between both sides.
        let whole = 2.0 / (1.0 + single);
        let factors = LayeredParameters {
            base: passed.factor(),
            metallic: 0.0,
            ior: ior as f32,
            specular_colour: (reflected * whole).as_vec3(),
            transmission: 1.0,
            body: crate::bsdf::Body::Thin,
            ..LayeredParameters::default()
        };
        self.report.note(object, "reflects by Schlick's approximation of Fresnel's formula");
        let material =
            LayeredMaterial { factors, roughness: 0.0, base: passed.slot(), ..LayeredMaterial::default() };
        Ok(Base::Layered(material).into())
    }

    fn metal(&mut self, object: &Object) -> Result<Metal, Fault> {
        let name = object.text("material")?.map(str::to_owned);
        let is_named = name.as_deref().is_some_and(|name| name != "none");
        if !is_named && !object.has("eta") && !object.has("k") {
            // Old files mean copper where they say nothing, those of today a mirror.
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

    fn conductor(&mut self, object: &Object) -> Result<Surface, Fault> {
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
        // Facets of a dielectric without a base: their reflectance at every angle can be scaled.
        let factors = LayeredParameters { base: Rgb::ZERO, metallic: 0.0, ..LayeredParameters::default() };
        let whole = tint.mean().max_element().clamp(1e-6, 1.0);
        let colour = metal.reflectance(1.0).as_dvec3() * tint.factor().as_dvec3() / whole;
        let colour = colour / normal_reflectance(f64::from(factors.ior));
        let mut material = LayeredMaterial {
            factors: LayeredParameters {
                specular: whole as f32,
                specular_colour: colour.as_vec3(),
                ..factors
            },
            specular_colour: tint.slot(),
            ..LayeredMaterial::default()
        };
        set_roughness(&mut material, slopes);
        Ok(Base::Layered(material).into())
    }

    fn plastic(&mut self, object: &Object) -> Result<Surface, Fault> {
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
            (Paint::Plain(colour), true) => {
                // Light that the coat throws back is coloured each time.
                let back = internal_reflectance(ior);
                Paint::Plain(colour.map(|c| c * (1.0 - back) / (1.0 - c * back)))
            }
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
        let mean_slope = match &slope {
            Amount::Plain(slope) => *slope,
            // Kept as roots.
            Amount::Picture(slot) => f64::from(slot.texture.mean().y).powi(2),
        };
        let diffuse = diffuse.times(DVec3::splat(diffuse_factor(distribution, mean_slope, ior)));
        self.report.note(object, "reflects by Schlick's approximation of Fresnel's formula");
        let whole = specular.max_element().max(1e-6);
        let factors = LayeredParameters {
            base: diffuse.factor(),
            metallic: 0.0,
            ior: ior as f32,
            specular: whole.min(1.0) as f32,
            specular_colour: (specular / whole).as_vec3(),
            ..LayeredParameters::default()
        };
        let coloured = matches!(diffuse, Paint::Vertices(_));
        let mut material =
            LayeredMaterial { factors, coloured, base: diffuse.slot(), ..LayeredMaterial::default() };
        set_roughness(&mut material, [slope.clone(), slope]);
        Ok(Base::Layered(material).into())
    }

    fn two_sided(&mut self, object: &Object) -> Result<Surface, Fault> {
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

    fn mask(&mut self, object: &Object) -> Result<Surface, Fault> {
        let opacity = self.amount(object, "opacity", 0.5, Use::Alpha)?;
        let nested = self.only_part(object, "bsdf")?;
        self.finish(object, &["opacity"])?;
        let surface = self.surface(&nested)?;
        if surface.opacity.is_some() {
            self.report.warn(object, "a mask over a mask: the outer one counts");
        }
        Ok(Surface { opacity: Some(opacity), ..surface })
    }

    fn normal_map(&mut self, object: &Object) -> Result<Surface, Fault> {
        let name = if object.has("normals") { "normals" } else { "normalmap" };
        let normals = match object.get(name) {
            Some(_) => self.paint(object, name, 0.5, Meaning::Number)?,
            None => {
                // Before 2.0 the texture had no name.
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

    fn bump_map(&mut self, object: &Object) -> Result<Surface, Fault> {
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

    fn blend(&mut self, object: &Object) -> Result<Surface, Fault> {
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
            // A weight that varies between a material and nothing is a mask.
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

    fn mixture(&mut self, object: &Object) -> Result<Surface, Fault> {
        let text = object.text("weights")?.unwrap_or_default().to_owned();
        let place = object.get("weights").map_or(&object.place, |property| &property.place);
        let weights: Vec<f64> = super::parse::tokens(&text)
            .map(|token| super::parse::number(token, place))
            .collect::<Result<_, _>>()?;
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

    /// Two materials by their weights, where that can be said; otherwise the heavier one.
    fn mixed(&mut self, object: &Object, (a, x): (Surface, f64), (b, y): (Surface, f64)) -> Surface {
        let share = if x + y > 0.0 { (y / (x + y)).clamp(0.0, 1.0) } else { 0.5 };
        if share == 0.0 {
            return a;
        }
        if share == 1.0 {
            return b;
        }
        let two_sided = a.two_sided || b.two_sided;
        match (&a.base, &b.base) {
            (Base::Diffuse(Paint::Plain(one)), Base::Diffuse(Paint::Plain(other)))
                if a.is_bare() && b.is_bare() =>
            {
                Surface { two_sided, ..Base::Diffuse(Paint::Plain(one.lerp(*other, share))).into() }
            }
            (Base::Null, _) if b.opacity.is_none() => Surface { opacity: Some(Amount::Plain(share)), ..b },
            (_, Base::Null) if a.opacity.is_none() => {
                Surface { opacity: Some(Amount::Plain(1.0 - share)), ..a }
            }
            _ => {
                let heavier = if share > 0.5 { b } else { a };
                self.report.warn(
                    object,
                    "this blend cannot be modelled: the heavier of its materials is shown alone",
                );
                heavier
            }
        }
    }
}

impl Surface {
    fn is_bare(&self) -> bool {
        self.opacity.is_none() && self.normal.is_none() && self.bump.is_none()
    }
}

/// Sets the roughness of layers by slopes of facets.
fn set_roughness(material: &mut LayeredMaterial, [along, across]: [Amount; 2]) {
    match (along.plain(), across.plain(), along) {
        (Some(along), Some(across), _) => {
            (material.roughness, material.anisotropy) = stretched([along, across]);
        }
        (_, _, Amount::Picture(slot)) => {
            material.roughness = 1.0;
            material.metallic_roughness = Some(slot);
        }
        (_, Some(across), Amount::Plain(_)) => material.roughness = across.sqrt() as f32,
        (_, None, Amount::Plain(along)) => material.roughness = along.sqrt() as f32,
    }
}

/// The share of diffuse light inside of a medium of this index that its border reflects: of light from outside by Fresnel's
/// formula, and by reciprocity.
pub(super) fn internal_reflectance(ior: f64) -> f64 {
    const STEPS: usize = 512;
    let mean: f64 = (0..STEPS)
        .map(|i| {
            // Equal steps of the squared sine: cosine-weighted.
            let sine_squared = (i as f64 + 0.5) / STEPS as f64;
            f64::from(crate::bsdf::fresnel_dielectric((1.0 - sine_squared).sqrt() as f32, ior as f32))
        })
        .sum::<f64>()
        / STEPS as f64;
    1.0 - (1.0 - mean) / (ior * ior)
}
