//! Materials of pbrt-v3, as the nearest models.

use super::Importer;
use super::error::{Fault, fail};
use super::material::MetalKind;
use super::models::glass;
use super::object::Object;
use super::paint::{Amount, Paint, Use, luminance};
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::texture::Curve;
use crate::bsdf::Metal;
use glam::DVec3;
use std::rc::Rc;

impl Importer<'_> {
    /// A material by its name in pbrt-v3.
    pub(super) fn old_surface(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        let base = match object.kind.as_str() {
            "matte" => {
                let paint = self.paint(object, "Kd", 0.5)?;
                if self.plain_amount(object, "sigma", 0.0)? > 0.0 {
                    self.report.note(&**object, "is taken for an ideal diffuse surface");
                }
                Base::Diffuse(paint)
            }
            "mirror" => {
                let reflected = self.colour(object, "Kr", DVec3::splat(0.9), Meaning::Reflectance)?;
                Base::Metal { metal: Metal::Colour(reflected.as_vec3()), slopes: [0.0; 2] }
            }
            "metal" => {
                let [eta, k] = self.metal(object, ["eta", "k"])?.map(|index| index.as_vec3());
                let slopes = self.slopes(object, "", 0.01)?;
                self.metal_base(object, MetalKind::Plain(Metal::Index { eta, k }), slopes)?
            }
            "glass" => {
                let index = self.index(object, &["eta", "index"], 1.5)?;
                let slope = self.one_slope(object, "", 0.0)?;
                let reflected = self.colour(object, "Kr", DVec3::ONE, Meaning::Reflectance)?;
                if reflected != DVec3::ONE {
                    self.report
                        .note(&**object, "`Kr` is not used: as much is reflected as Fresnel's formula says");
                }
                let passed = self.paint(object, "Kt", 1.0)?;
                glass([index, 1.0], slope, &passed)
            }
            "plastic" | "substrate" => {
                let (diffuse, specular) = if object.kind == "plastic" { (0.25, 0.25) } else { (0.5, 0.5) };
                let paint = self.paint(object, "Kd", diffuse)?;
                let shine = self.colour(object, "Ks", DVec3::splat(specular), Meaning::Reflectance)?;
                let slope = self.one_slope(object, "", 0.1)?;
                self.report.note(&**object, "is taken for facets of a dielectric over a diffuse base");
                if object.kind == "substrate" {
                    // Ks is the reflectance along the normal: that of the index 1.5 is 0.04.
                    self.coated(1.5, paint, shine / 0.04, slope)
                } else {
                    self.coated(1.5, paint, shine, slope)
                }
            }
            "uber" => return self.uber(object),
            "translucent" => {
                let paint = self.paint(object, "Kd", 0.25)?;
                let kept = self.colour(object, "reflect", DVec3::splat(0.5), Meaning::Reflectance)?;
                let passed = self.colour(object, "transmit", DVec3::splat(0.5), Meaning::Reflectance)?;
                self.colour(object, "Ks", DVec3::splat(0.25), Meaning::Reflectance)?;
                self.slopes(object, "", 0.1)?;
                if passed != DVec3::ZERO {
                    self.report
                        .warn(&**object, "light that it passes is left out: it reflects diffusely alone");
                }
                Base::Diffuse(paint.times(kept))
            }
            other => {
                let message = format!("the material `{other}` is not modelled");
                return fail(
                    &object.place,
                    message,
                    "put `matte`, `plastic`, `metal` or `glass` in its place",
                );
            }
        };
        self.modified(object, base)
    }

    fn uber(&mut self, object: &Rc<Object>) -> Result<Surface, Fault> {
        let paint = self.paint(object, "Kd", 0.25)?;
        let shine = self.colour(object, "Ks", DVec3::splat(0.25), Meaning::Reflectance)?;
        let mirrored = self.colour(object, "Kr", DVec3::ZERO, Meaning::Reflectance)?;
        let passed = self.colour(object, "Kt", DVec3::ZERO, Meaning::Reflectance)?;
        let index = self.index(object, &["eta", "index"], 1.5)?.max(1.0);
        let slope = self.one_slope(object, "", 0.1)?;
        let opacity = match self.paint(object, "opacity", 1.0)? {
            Paint::Plain(colour) => Amount::Plain(luminance(colour)),
            picture => self.amount_of(object, &picture, Curve::Same, Use::Alpha),
        };
        if mirrored != DVec3::ZERO || passed != DVec3::ZERO {
            self.report.warn(
                &**object,
                "`Kr` and `Kt` are left out: it is taken for facets of a dielectric over a diffuse base",
            );
        } else {
            self.report.note(&**object, "is taken for facets of a dielectric over a diffuse base");
        }
        let base = self.coated(index, paint, shine, slope);
        let surface = self.modified(object, base)?;
        let is_whole = opacity == Amount::Plain(1.0);
        Ok(Surface { opacity: (!is_whole).then_some(opacity), ..surface })
    }
}
