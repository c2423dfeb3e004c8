//! Converts materials of a file to the nearest models of this renderer.

use super::Importer;
use super::error::{Fault, fail};
use super::spectrum::Meaning;
use super::texture::{Amount, Paint};
use super::value::{Object, Value, shown};
use crate::bsdf::{LayeredParameters, Metal};
use crate::scene::LayeredMaterial;
use crate::scene_file::diagnostic::suggestion;
use crate::textures::TextureSlot;
use std::rc::Rc;

/// The scattering model.
#[derive(Clone, Debug)]
pub(super) enum Base {
    Diffuse(Paint),
    /// Layers of facets over a base, not at an interface between media.
    Layered(LayeredMaterial),
    /// The same at an interface between media with these indices, inside and outside.
    Border(LayeredMaterial, [f64; 2]),
    /// A metal, with the slopes of its facets along the surface and across.
    Metal {
        metal: Metal,
        slopes: [f64; 2],
    },
    Glass {
        indices: [f64; 2],
        slope: f64,
    },
    /// No surface: light passes.
    Null,
}

/// A scattering model with modifiers for the whole surface.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub base: Base,
    /// Whether the back side is like the front.
    pub two_sided: bool,
    /// Coverage: the share of the surface that is present.
    pub opacity: Option<Amount>,
    pub normal: Option<TextureSlot>,
    /// Bump map, with the height in lengths of the scene for a picture value of one.
    pub bump: Option<(TextureSlot, f64)>,
}

impl From<Base> for Surface {
    fn from(base: Base) -> Self {
        Self { base, two_sided: false, opacity: None, normal: None, bump: None }
    }
}

/// Layers without any reflection from facets.
fn matt() -> LayeredParameters {
    LayeredParameters { metallic: 0.0, specular: 0.0, ..LayeredParameters::default() }
}

/// The square of `(ior - 1) / (ior + 1)`.
pub(super) fn normal_reflectance(ior: f64) -> f64 {
    ((ior - 1.0) / (ior + 1.0)).powi(2)
}

impl Base {
    /// The surface as a layered material, which alone supports textures, cut-outs and normal maps. At an interface, also yields
    /// the indices of the media.
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

/// Roughness and anisotropy in the conventions of glTF, for facets with these slopes.
pub(super) fn stretched([along, across]: [f64; 2]) -> (f32, [f32; 2]) {
    let (least, most) = (along.min(across).clamp(0.0, 1.0), along.max(across).clamp(0.0, 1.0));
    let strength = if least < 1.0 { ((most - least) / (1.0 - least)).sqrt() } else { 0.0 };
    let turn = if along < across { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    let turn = if strength > 0.0 { turn } else { 0.0 };
    (least.sqrt() as f32, [strength as f32, turn as f32])
}

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

impl Surface {
    /// Whether the surface has no modifiers.
    pub(super) fn is_bare(&self) -> bool {
        self.opacity.is_none() && self.normal.is_none() && self.bump.is_none()
    }
}
