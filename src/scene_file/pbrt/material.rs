//! Converts materials of a file to the nearest models of this renderer.

use super::Importer;
use super::error::{Fault, fail};
use super::facets::Distribution;
use super::models::{
    base_factor, glass, internal_reflectance, mean_slope, plastic, set_roughness, thin_sheet, tinted_metal,
};
use super::object::{Object, Values};
use super::paint::{Amount, Paint, Use};
use super::report::Subject;
use super::spectrum::Meaning;
use super::state::Chosen;
use super::surface::{Base, Surface};
use super::text::shown;
use super::texture::{Curve, from_below, mapped};
use crate::bsdf::{LayeredParameters, Metal};
use crate::scene::LayeredMaterial;
use crate::scene_file::diagnostic::suggestion;
use crate::textures::{Sampler, TextureSlot};
use glam::{Affine2, DVec3};
use std::rc::Rc;

/// Deepest nesting of mixed materials; deeper ones contain each other.
const DEEPEST: usize = 64;

/// Materials of pbrt-v4 and of pbrt-v3.
const KNOWN: [&str; 18] = [
    "diffuse",
    "coateddiffuse",
    "conductor",
    "coatedconductor",
    "dielectric",
    "thindielectric",
    "diffusetransmission",
    "interface",
    "mix",
    "matte",
    "plastic",
    "metal",
    "mirror",
    "glass",
    "uber",
    "substrate",
    "translucent",
    "none",
];

impl Importer<'_> {
    /// The material of the shapes that follow; `None` where its name is not known yet.
    pub(super) fn chosen(&self, chosen: &Chosen) -> Option<Rc<Object>> {
        match chosen {
            Chosen::Object(object) => Some(Rc::clone(object)),
            Chosen::Named(name, _) => self.materials.get(name).map(Rc::clone),
        }
    }

    /// The error for a material that no directive defines.
    pub(super) fn no_material<T>(&self, name: &str, place: &super::error::Place) -> Result<T, Fault> {
        let mut names: Vec<&str> = self.materials.keys().map(String::as_str).collect();
        names.sort_unstable();
        fail(place, format!("there is no material `{}`", shown(name)), suggestion(name, &names))
    }

    /// Converts a material, once.
    pub(super) fn surface(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        if let Some(known) = self.surfaces.get(&object.serial) {
            return Ok(known.clone());
        }
        self.material_depth += 1;
        if self.material_depth > DEEPEST {
            let message = format!("{} stands in too many others", object.label());
            return fail(&object.place, message, "do materials contain each other?");
        }
        let surface = self.surface_of(object)?;
        self.material_depth -= 1;
        self.surfaces.insert(object.serial, surface.clone());
        Ok(surface)
    }

    fn surface_of(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        let base = match object.kind.as_str() {
            "diffuse" => {
                let paint = self.paint(object, "reflectance", 0.5)?;
                Base::Diffuse(paint)
            }
            "coateddiffuse" => self.coated_diffuse(object)?,
            "conductor" => self.conductor(object)?,
            "coatedconductor" => self.coated_conductor(object)?,
            "dielectric" => {
                let eta = self.index(object, &["eta"], 1.5)?;
                let slope = self.one_slope(object, "", 0.0)?;
                glass([eta, 1.0], slope, &Paint::Plain(DVec3::ONE))
            }
            "thindielectric" => {
                let eta = self.index(object, &["eta"], 1.5)?;
                self.report.note(&**object, "reflects by Schlick's approximation of Fresnel's formula");
                Base::Layered(thin_sheet(eta, DVec3::ONE, &Paint::Plain(DVec3::ONE)))
            }
            "diffusetransmission" => self.diffuse_transmission(object)?,
            "interface" | "" | "none" => Base::Null,
            "mix" => return self.mix(object),
            "matte" | "plastic" | "metal" | "mirror" | "glass" | "uber" | "substrate" | "translucent" => {
                self.is_old = true;
                return self.old_surface(object);
            }
            "subsurface" | "hair" | "measured" | "kdsubsurface" | "fourier" | "disney" => {
                return fail(
                    &object.place,
                    format!("the material `{}` is not modelled", object.kind),
                    "put `diffuse`, `coateddiffuse`, `conductor` or `dielectric` in its place",
                );
            }
            other => {
                let message = format!("the material `{}` is not known", shown(other));
                return fail(&object.place, message, suggestion(other, &KNOWN));
            }
        };
        self.modified(object, base)
    }

    /// A model with the bumps and normals of its material.
    pub(super) fn modified(&mut self, object: &Rc<Object>, base: Base) -> Result<Surface, Fault> {
        // Surfaces of pbrt are alike on both sides.
        let mut surface = Surface { two_sided: true, ..base.into() };
        if let Some(name) = object.text("normalmap")?.map(str::to_owned) {
            let path = self.file(&name, object.place_of("normalmap"))?;
            let (texture, _) = self.pictures.read(&path, Use::Raw, true).or_else(|error| {
                let message = format!("the normal map of {} cannot be read: {error}", object.label());
                fail(object.place_of("normalmap"), message, "convert it to PNG or EXR")
            })?;
            let transform = from_below(Affine2::IDENTITY);
            let sampler = Sampler { finest: true, ..Sampler::default() };
            surface.normal = Some(TextureSlot { texture, sampler, set: 0, transform });
        }
        let bump = ["displacement", "bumpmap"].into_iter().find(|name| object.has(name));
        if let Some(name) = bump {
            match self.number_paint(object, name, 0.0)? {
                Paint::Picture(slot, factor) if surface.normal.is_none() => {
                    surface.bump = Some((slot, factor.y))
                }
                Paint::Picture(..) => self.report.warn(&**object, "bumps beside a normal map are left out"),
                _ => self.report.warn(&**object, "heights that do not vary are left out"),
            }
        }
        self.finish(
            object,
            &["reflectance", "eta", "k", "roughness", "uroughness", "vroughness", "normalmap"],
        )?;
        Ok(surface)
    }

    /// The slopes of facets. `prefix` stands before the names of the parameters.
    pub(super) fn slopes(
        &mut self,
        object: &Rc<Object>,
        prefix: &str,
        usual: f64,
    ) -> Result<[Amount; 2], Fault> {
        let is_mapped = object.boolean("remaproughness", true)?;
        let is_old = matches!(
            object.kind.as_str(),
            "metal" | "glass" | "plastic" | "uber" | "substrate" | "translucent"
        );
        let curve = match (is_mapped, is_old) {
            (false, _) => Curve::Same,
            (true, false) => Curve::Root,
            (true, true) => Curve::Polynomial,
        };
        let names = ["uroughness", "vroughness"].map(|name| format!("{prefix}{name}"));
        let both = format!("{prefix}roughness");
        let slope = |importer: &mut Self, name: &str| -> Result<Amount, Fault> {
            let name = if object.has(name) { name } else { both.as_str() };
            // Without facets there is nothing to remap.
            let is_zero = object.get(name).is_none_or(|parameter| parameter.numbers() == [0.0]);
            let is_smooth = is_zero && usual == 0.0;
            let curve = if is_smooth { Curve::Same } else { curve };
            let amount = importer.amount(object, (name, usual), curve, Use::Slope)?;
            Ok(match amount {
                Amount::Plain(value) => Amount::Plain(value.clamp(0.0, 1.0)),
                picture @ Amount::Picture(_) => picture,
            })
        };
        // Marks it as read where both directions are given, too.
        object.get(&both);
        Ok([slope(self, &names[0])?, slope(self, &names[1])?])
    }

    /// A single slope, for models that have only one.
    pub(super) fn one_slope(
        &mut self,
        object: &Rc<Object>,
        prefix: &str,
        usual: f64,
    ) -> Result<Amount, Fault> {
        let [along, across] = self.slopes(object, prefix, usual)?;
        match (along.plain(), across.plain()) {
            (Some(a), Some(b)) if a != b => {
                self.report.note(
                    &**object,
                    "the roughnesses of its two directions are taken for their geometric mean",
                );
                Ok(Amount::Plain((a * b).sqrt()))
            }
            _ => Ok(along),
        }
    }

    fn coated_diffuse(&mut self, object: &Rc<Object>) -> Result<Base, Fault> {
        let paint = self.paint(object, "reflectance", 0.5)?;
        let eta = self.index(object, &["eta"], 1.5)?.max(1.0);
        let slope = self.one_slope(object, "", 0.0)?;
        self.between_layers(object)?;
        self.report.note(
            &**object,
            "its layers are a dielectric over a diffuse base in closed form, with Schlick's approximation of Fresnel's formula",
        );
        // Light that the coat reflects back to the base is coloured each time.
        let back = internal_reflectance(eta);
        let base = mapped(&paint, |colour| colour.map(|c| c * (1.0 - back) / (1.0 - c * back)));
        Ok(self.coated(eta, base, DVec3::ONE, slope))
    }

    /// Facets of a dielectric over a diffuse base.
    pub(super) fn coated(&mut self, ior: f64, diffuse: Paint, specular: DVec3, slope: Amount) -> Base {
        // The factor of a slope and an index is an integral over directions, and scenes have many alike.
        let key = [mean_slope(&slope), ior].map(f64::to_bits);
        let compute = || base_factor(Distribution::Ggx, &slope, ior);
        let factor = *self.base_factors.entry(key).or_insert_with(compute);
        Base::Layered(plastic(ior, &diffuse.times(DVec3::splat(factor)), specular, slope))
    }

    /// Reads what lies between two layers.
    fn between_layers(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let albedo = self.colour(object, "albedo", DVec3::ZERO, Meaning::Reflectance)?;
        if albedo != DVec3::ZERO {
            self.report.warn(&**object, "the medium between its layers (`albedo`) is left out");
        }
        for name in ["thickness", "maxdepth", "nsamples", "g"] {
            object.get(name);
        }
        Ok(())
    }

    /// A metal by its indices or by its reflectance, in a medium of this index.
    fn metal_of(&mut self, object: &Rc<Object>, names: [&str; 2], outside: f64) -> Result<MetalKind, Fault> {
        if object.has("reflectance") {
            if object.has(names[0]) || object.has(names[1]) {
                let message = format!("{} has both a reflectance and indices", object.label());
                return fail(object.place_of("reflectance"), message, "keep one of them");
            }
            let paint = self.paint(object, "reflectance", 0.5)?;
            return Ok(match paint {
                Paint::Plain(colour) => MetalKind::Plain(Metal::Index {
                    eta: DVec3::ONE.as_vec3(),
                    // The k of an index of one with this reflectance.
                    k: colour
                        .map(|r| 2.0 * (r.clamp(0.0, 0.9999) / (1.0 - r.clamp(0.0, 0.9999))).sqrt())
                        .as_vec3(),
                }),
                paint => MetalKind::Painted(paint),
            });
        }
        let [eta, k] = self.metal(object, names)?.map(|index| (index / outside).as_vec3());
        Ok(MetalKind::Plain(Metal::Index { eta, k }))
    }

    fn conductor(&mut self, object: &Rc<Object>) -> Result<Base, Fault> {
        let metal = self.metal_of(object, ["eta", "k"], 1.0)?;
        let slopes = self.slopes(object, "", 0.0)?;
        self.metal_base(object, metal, slopes)
    }

    pub(super) fn metal_base(
        &mut self,
        object: &Rc<Object>,
        metal: MetalKind,
        slopes: [Amount; 2],
    ) -> Result<Base, Fault> {
        Ok(match (metal, slopes[0].plain().zip(slopes[1].plain())) {
            (MetalKind::Plain(metal), Some((along, across))) => {
                Base::Metal { metal, slopes: [along, across] }
            }
            (MetalKind::Plain(metal), None) => {
                self.report.note(
                    &**object,
                    "reflects by Schlick's approximation of the formula for metals, as its roughness varies",
                );
                Base::Layered(tinted_metal(metal, &Paint::Plain(DVec3::ONE), slopes))
            }
            (MetalKind::Painted(paint), _) => {
                self.report.note(
                    &**object,
                    "reflects by Schlick's approximation of the formula for metals, as its colour varies",
                );
                let factors = LayeredParameters { base: paint.factor(), ..LayeredParameters::default() };
                let mut material =
                    LayeredMaterial { factors, base: paint.slot(), ..LayeredMaterial::default() };
                set_roughness(&mut material, slopes);
                Base::Layered(material)
            }
        })
    }

    fn coated_conductor(&mut self, object: &Rc<Object>) -> Result<Base, Fault> {
        let eta = self.index(object, &["interface.eta"], 1.5)?;
        let metal = self.metal_of(object, ["conductor.eta", "conductor.k"], eta)?;
        let slopes = self.slopes(object, "conductor.", 0.0)?;
        let coat = self.one_slope(object, "interface.", 0.0)?;
        self.between_layers(object)?;
        self.report.note(
            &**object,
            "is a metal under a clear coat of index 1.5 (docs/gltf.md), with Schlick's approximation of the formula for metals",
        );
        let (base, slot) = match metal {
            MetalKind::Plain(metal) => (metal.reflectance(1.0), None),
            MetalKind::Painted(paint) => (paint.factor(), paint.slot()),
        };
        let factors = LayeredParameters { base, coat: 1.0, ..LayeredParameters::default() };
        let mut material = LayeredMaterial { factors, base: slot, ..LayeredMaterial::default() };
        set_roughness(&mut material, slopes);
        match coat {
            Amount::Plain(slope) => material.coat_roughness = slope.sqrt() as f32,
            Amount::Picture(slot) => {
                material.coat_roughness = 1.0;
                material.coat_roughness_map = Some(slot);
            }
        }
        Ok(Base::Layered(material))
    }

    fn diffuse_transmission(&mut self, object: &Rc<Object>) -> Result<Base, Fault> {
        let reflected = self.paint(object, "reflectance", 0.25)?;
        let passed = self.paint(object, "transmittance", 0.25)?;
        let scale = object.within("scale", 1.0, 0.0..=1e6)?;
        if passed.mean() != DVec3::ZERO && scale > 0.0 {
            self.report.warn(&**object, "light that it passes diffusely is left out: it reflects alone");
        }
        Ok(Base::Diffuse(mapped(&reflected, |colour| (colour * scale).min(DVec3::ONE))))
    }

    fn mix(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        let amount = self.amount(object, ("amount", 0.5), Curve::Same, Use::Alpha)?;
        let names: Vec<String> = match object.get("materials").map(|parameter| &parameter.values) {
            Some(Values::Texts(names)) => names.clone(),
            _ => {
                // As in pbrt-v3.
                let old = [object.text("namedmaterial1")?, object.text("namedmaterial2")?];
                old.into_iter().flatten().map(str::to_owned).collect()
            }
        };
        self.finish(object, &["materials", "amount"])?;
        let [first, second] = &names[..] else {
            let message = format!("{} mixes {} materials, and two are needed", object.label(), names.len());
            return fail(&object.place, message, "write \"string materials\" [ \"a\" \"b\" ]");
        };
        let part = |importer: &mut Self, name: &str| -> Result<Surface, Fault> {
            match importer.materials.get(name).map(Rc::clone) {
                Some(material) => importer.surface(&material),
                None => importer.no_material(name, object.place_of("materials")),
            }
        };
        let (a, b) = (part(self, first)?, part(self, second)?);
        let share = match amount {
            Amount::Plain(share) => share.clamp(0.0, 1.0),
            // A share that varies between nothing and a material is a mask.
            picture @ Amount::Picture(_) if matches!(a.base, Base::Null) && b.opacity.is_none() => {
                return Ok(Surface { opacity: Some(picture), ..b });
            }
            Amount::Picture(slot) => {
                self.report.warn(&**object, "an amount that varies is taken for its mean");
                f64::from(slot.texture.mean().w)
            }
        };
        let (mixed, is_exact) = a.mixed_with(b, share);
        if !is_exact {
            self.report
                .warn(&**object, "this mix cannot be modelled: the heavier of its materials is shown alone");
        }
        Ok(mixed)
    }
}

/// A metal with one reflectance, or with one that varies.
pub(super) enum MetalKind {
    Plain(Metal),
    Painted(Paint),
}
