//! The principled material (Burley 2012) as layers: metal, facets over a diffuse base, transmission, and a clear coat.

use super::Importer;
use super::error::Fault;
use super::paint::{Amount, Use};
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::value::Object;
use crate::bsdf::{Body, LayeredParameters};
use crate::scene::LayeredMaterial;

/// Slopes of the clear coat without gloss and with full gloss.
const COAT_SLOPES: [f64; 2] = [0.1, 0.001];

/// Strength of the clear coat (Burley 2012, section 5.5).
const COAT_SHARE: f64 = 0.25;

impl Importer<'_> {
    pub(super) fn principled(&mut self, object: &Object) -> Result<Surface, Fault> {
        let is_thin = object.plugin == "principledthin";
        let paint = self.paint(object, "base_color", 0.5, Meaning::Reflectance)?;
        let roughness = self.amount(object, "roughness", 0.5, Use::Roughness)?;
        let metallic = self.amount(object, "metallic", 0.0, Use::Blue)?;
        let transmission = self.plain_amount(object, "spec_trans", 0.0)?.clamp(0.0, 1.0);
        let anisotropic = self.plain_amount(object, "anisotropic", 0.0)?.clamp(0.0, 1.0);
        let tint = self.plain_amount(object, "spec_tint", 0.0)?.clamp(0.0, 1.0);
        let coat = self.plain_amount(object, "clearcoat", 0.0)?.clamp(0.0, 1.0);
        let gloss = self.plain_amount(object, "clearcoat_gloss", 0.0)?.clamp(0.0, 1.0);
        let ior = if object.has("eta") {
            object.within("eta", 1.5, 1.0..=10.0)?
        } else {
            let specular = object.within("specular", 0.5, 0.0..=1.0)?;
            2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0
        };
        for name in ["sheen", "flatness", "diff_trans"] {
            if self.plain_amount(object, name, 0.0)? > 0.0 {
                self.report.warn(object, format!("`{name}` is not modelled and left out"));
            }
        }
        object.get("sheen_tint");
        let rates = [
            "main_specular_sampling_rate",
            "clearcoat_sampling_rate",
            "diffuse_reflectance_sampling_rate",
            "specular_reflectance_sampling_rate",
            "specular_transmittance_sampling_rate",
            "diffuse_transmittance_sampling_rate",
        ];
        self.ignore(object, &rates, "sampling goes by what is reflected");
        let known = [
            "base_color",
            "roughness",
            "metallic",
            "spec_trans",
            "anisotropic",
            "spec_tint",
            "clearcoat",
            "clearcoat_gloss",
            "eta",
            "specular",
            "sheen",
            "sheen_tint",
            "flatness",
        ];
        self.finish(object, &known)?;
        self.report.note(object, "is taken for the layered model of docs/gltf.md");
        let mut base = paint.factor();
        if transmission > 0.5 && !is_thin {
            // Burley 2015: the square root of the colour at each of two interfaces.
            base = base.map(f32::sqrt);
        }
        let hue = paint.mean();
        let brightest = hue.max_element().max(1e-6);
        let colour = glam::DVec3::ONE.lerp(hue / brightest, tint);
        let factors = LayeredParameters {
            base,
            metallic: metallic.plain().unwrap_or(1.0).clamp(0.0, 1.0) as f32,
            ior: ior as f32,
            specular_colour: colour.as_vec3(),
            transmission: transmission as f32,
            body: if is_thin && transmission > 0.0 { Body::Thin } else { Body::Opaque },
            coat: (COAT_SHARE * coat) as f32,
            ..LayeredParameters::default()
        };
        let mut material = LayeredMaterial {
            factors,
            roughness: roughness.plain().unwrap_or(1.0).clamp(0.0, 1.0) as f32,
            coat_roughness: (COAT_SLOPES[0] + (COAT_SLOPES[1] - COAT_SLOPES[0]) * gloss).sqrt() as f32,
            coloured: matches!(paint, super::paint::Paint::Vertices(_)),
            base: paint.slot(),
            ..LayeredMaterial::default()
        };
        if let (Amount::Plain(roughness), true) = (&roughness, anisotropic > 0.0) {
            let aspect = (1.0 - 0.9 * anisotropic).sqrt();
            let slope = roughness * roughness;
            let slopes = [slope / aspect, slope * aspect];
            (material.roughness, material.anisotropy) = super::surface::stretched(slopes);
        }
        material.metallic_roughness = match (roughness, metallic) {
            (Amount::Picture(slot), Amount::Plain(_)) => Some(slot),
            (Amount::Plain(_), Amount::Picture(slot)) => Some(slot),
            (Amount::Picture(slot), Amount::Picture(metallic)) => {
                let mean = metallic.texture.mean().z;
                material.factors.metallic = mean;
                self.report
                    .note(object, "`metallic` does not vary beside a `roughness` that does: its mean counts");
                Some(slot)
            }
            (Amount::Plain(_), Amount::Plain(_)) => None,
        };
        Ok(if transmission > 0.0 && !is_thin {
            Base::Border(material, [ior, 1.0]).into()
        } else {
            Base::Layered(material).into()
        })
    }
}
