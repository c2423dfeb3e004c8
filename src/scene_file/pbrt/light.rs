//! Lights without a surface.

use super::Importer;
use super::error::{Fault, fail};
use super::import::light::{axes_of, inner_angle_of_flux};
use super::object::Object;
use super::paint::luminance;
use super::report::Subject;
use super::text::shown;
use crate::math::{equal_area_direction, unit_f64};
use crate::scene_file::description::{
    EnvironmentLayout, LightDescription, Named, ProfileBrightness, ProfileLayout,
};
use crate::scene_file::diagnostic::suggestion;
use crate::scene_file::directions::colours_of;
use crate::textures::{TEXTURE_LIMIT, read_picture};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::rc::Rc;

/// Largest factor of a light.
const BRIGHTEST: f64 = 1e15;

/// Integral over `1 - cos` of a spot of intensity one that falls from full at `inner` to zero at `outer` by a smooth step in the cosine.
fn spot_integral(inner: f64, outer: f64) -> f64 {
    let one_minus_cos = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
    0.5 * (one_minus_cos(inner) + one_minus_cos(outer))
}

/// The same where it falls by the fourth power of a linear ramp, as in pbrt-v3.
fn old_spot_integral(inner: f64, outer: f64) -> f64 {
    let one_minus_cos = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
    one_minus_cos(inner) + 0.2 * (one_minus_cos(outer) - one_minus_cos(inner))
}

impl Importer<'_> {
    /// Reads the colour of a light that has another default than white.
    pub(super) fn light_colour_or(
        &mut self,
        object: &Object,
        name: &str,
        usual: DVec3,
    ) -> Result<DVec3, Fault> {
        if object.has(name) { self.light_colour(object, name) } else { Ok(usual) }
    }

    /// The factor on the colour of a light: `scale`, a colour in pbrt-v3.
    pub(super) fn light_scale(&mut self, object: &Object) -> Result<DVec3, Fault> {
        match object.get("scale").map(Rc::clone) {
            Some(parameter) if !matches!(parameter.kind, "float" | "integer") => {
                Ok(self.spectrum(&parameter)?.numbers())
            }
            _ => Ok(DVec3::splat(object.within("scale", 1.0, 0.0..=BRIGHTEST)?)),
        }
    }

    fn push_light(&mut self, object: &Object, value: LightDescription) {
        let location = object.place.location.clone();
        self.description.lights.push(Named { name: object.name(), location, value });
        self.description.light_photons.push(1.0);
    }

    /// Adds a light.
    pub(super) fn light(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let ctm = self.state.ctm;
        super::transform::check(&ctm, &object.place)?;
        self.ignore(object, &["nsamples", "samples"], "lights are sampled by what they give");
        let value = match object.kind.as_str() {
            "point" => {
                let intensity = self.intensity(object, 4.0 * PI)?;
                let position = self.from(object, &ctm)?;
                self.finish(object, &["I", "scale", "power", "from"])?;
                LightDescription::Point { position, intensity }
            }
            "spot" => self.spot(object, &ctm)?,
            "distant" => {
                let from = object.point("from")?.unwrap_or(DVec3::ZERO);
                let to = object.point("to")?.unwrap_or(DVec3::Z);
                let direction = self.direction(object, &ctm, to - from)?;
                let mut irradiance = self.light_colour(object, "L")? * self.light_scale(object)?;
                if let Some(lux) = self.positive(object, "illuminance")? {
                    irradiance *= lux;
                }
                self.finish(object, &["L", "scale", "illuminance", "from", "to"])?;
                LightDescription::Directional { direction, irradiance }
            }
            "infinite" | "exinfinite" => self.infinite(object, &ctm)?,
            "goniometric" => self.goniometric(object, &ctm)?,
            "projection" => {
                return fail(
                    &object.place,
                    "the light `projection` is not modelled",
                    "use a spot, or an area light with a picture",
                );
            }
            other => {
                let known = ["point", "spot", "distant", "infinite", "goniometric"];
                let message = format!("the light `{}` is not known", shown(other));
                return fail(&object.place, message, suggestion(other, &known));
            }
        };
        self.push_light(object, value);
        Ok(())
    }

    /// A number above zero that replaces the size of a light, where it is given.
    pub(super) fn positive(&mut self, object: &Object, name: &str) -> Result<Option<f64>, Fault> {
        Ok(Some(object.within(name, -1.0, -1.0..=BRIGHTEST)?).filter(|value| *value > 0.0))
    }

    fn from(&mut self, object: &Object, ctm: &DAffine3) -> Result<DVec3, Fault> {
        Ok(ctm.transform_point3(object.point("from")?.unwrap_or(DVec3::ZERO)))
    }

    fn direction(&mut self, object: &Object, ctm: &DAffine3, own: DVec3) -> Result<DVec3, Fault> {
        match unit_f64(ctm.transform_vector3(own)) {
            Some(direction) => Ok(direction),
            None => fail(
                object.place_of("to"),
                "`from` and `to` of the light are the same point",
                "move one of them",
            ),
        }
    }

    /// The intensity of a light at a point; `integral` is that of its directions for an intensity of one.
    fn intensity(&mut self, object: &Object, integral: f64) -> Result<DVec3, Fault> {
        let mut intensity = self.light_colour(object, "I")? * self.light_scale(object)?;
        if let Some(power) = self.positive(object, "power")? {
            intensity *= power / integral;
        }
        Ok(intensity)
    }

    fn spot(&mut self, object: &Rc<Object>, ctm: &DAffine3) -> Result<LightDescription, Fault> {
        let outer = object.within("coneangle", 30.0, 0.001..=180.0)?.to_radians();
        let delta = object.within("conedeltaangle", 5.0, 0.0..=180.0)?.to_radians();
        let inner = (outer - delta).max(0.0);
        let integral =
            if self.is_old { old_spot_integral(inner, outer) } else { spot_integral(inner, outer) };
        let intensity = self.intensity(object, TAU * integral)?;
        let from = object.point("from")?.unwrap_or(DVec3::ZERO);
        let to = object.point("to")?.unwrap_or(DVec3::Z);
        let direction = self.direction(object, ctm, to - from)?;
        self.finish(object, &["I", "scale", "power", "from", "to", "coneangle", "conedeltaangle"])?;
        if delta > 0.0 {
            self.report.note(
                &**object,
                "its edge falls with the square of the cosine; intensity in the middle and flux are those of the file",
            );
        }
        Ok(LightDescription::Spot {
            position: ctm.transform_point3(from),
            direction,
            intensity,
            inner: inner_angle_of_flux(integral, outer),
            outer,
        })
    }

    /// The orthonormal axes of a light, possibly mirrored.
    fn axes(&mut self, object: &Object, ctm: &DAffine3) -> Result<DMat3, Fault> {
        let Some((axes, differs)) = axes_of(ctm.matrix3) else {
            let remedy = "give it a scale that is not zero";
            return fail(&object.place, "the transform of the light flattens everything", remedy);
        };
        if differs {
            self.report.note(object, "its transform is taken for the nearest rotation");
        }
        Ok(axes)
    }

    fn infinite(&mut self, object: &Rc<Object>, ctm: &DAffine3) -> Result<LightDescription, Fault> {
        let scale = self.light_scale(object)?;
        let lux = self.positive(object, "illuminance")?;
        if !object.list("portal", &["point3", "point"], 3)?.is_empty() {
            self.report
                .note(&**object, "its portal has no effect: directions are drawn by what the picture gives");
        }
        let known = ["L", "filename", "scale", "illuminance", "portal"];
        let name = if object.has("mapname") { "mapname" } else { "filename" };
        if !object.has(name) {
            let colour = self.light_colour(object, "L")?;
            self.finish(object, &known)?;
            return Ok(LightDescription::Environment {
                radiance: colour * scale * (lux.map_or(1.0, |lux| lux / PI)),
            });
        }
        let layout = match name {
            "mapname" => {
                self.is_old = true;
                EnvironmentLayout::LatitudeLongitude
            }
            _ => EnvironmentLayout::EqualArea,
        };
        // In pbrt-v3 L is a factor on the picture.
        let tint = match (object.has("L"), layout) {
            (true, EnvironmentLayout::EqualArea) => {
                let message = format!("{} has both `L` and a picture", object.label());
                return fail(object.place_of("L"), message, "keep one of them");
            }
            (true, EnvironmentLayout::LatitudeLongitude) => self.light_colour(object, "L")?,
            (false, _) => DVec3::ONE,
        };
        let image = self.named_file(object, name)?;
        self.finish(object, &known)?;
        let lux = match (lux, layout) {
            (Some(lux), EnvironmentLayout::EqualArea) => lux / self.illuminance(object, &image)?,
            _ => 1.0,
        };
        let axes = self.axes(object, ctm)?;
        // The picture of pbrt-v3 has z up and begins at +x, towards +y; here y is up and it begins at +z, towards -x.
        let upright = DMat3::from_cols(DVec3::NEG_Y, DVec3::Z, DVec3::X);
        let axes = match layout {
            EnvironmentLayout::EqualArea => axes,
            EnvironmentLayout::LatitudeLongitude => axes * upright,
        };
        Ok(LightDescription::EnvironmentMap {
            image,
            layout,
            turn: 0.0,
            axes: Some(axes),
            factor: tint * scale * lux,
        })
    }

    /// Illuminance of a surface that faces up (+z of the light) under a picture of all directions.
    fn illuminance(&mut self, object: &Object, path: &Path) -> Result<f64, Fault> {
        let image = read_picture(path, TEXTURE_LIMIT).or_else(|error| {
            let message = format!("the picture of {} cannot be read: {error}", object.label());
            fail(&object.place, message, "convert it to EXR")
        })?;
        let colours = colours_of(&image);
        let Some(colours) = colours.filter(|_| image.width == image.height) else {
            return fail(
                &object.place,
                "the picture of all directions is not a square with red, green and blue",
                "make an equal-area octahedral map of it (pbrt's `imgtool makeequiarea`)",
            );
        };
        let side = image.width as usize;
        let sum: f64 = colours
            .iter()
            .enumerate()
            .map(|(i, colour)| {
                let at = |i: usize| (i as f64 + 0.5) / side as f64;
                let up = equal_area_direction(at(i % side), at(i / side)).z;
                luminance(colour.as_dvec3().max(DVec3::ZERO)) * up.max(0.0)
            })
            .sum();
        let illuminance = 4.0 * PI * sum / (side * side) as f64;
        if illuminance > 0.0 && illuminance.is_finite() {
            // Pbrt takes the solid angle of a texel for half of what it is.
            self.report
                .note(object, "`illuminance` of a picture counts as in pbrt, where it gives twice as much");
            return Ok(0.5 * illuminance);
        }
        fail(
            object.place_of("illuminance"),
            "nothing comes from above in the picture, so no factor makes it this bright",
            "give it a `scale` instead",
        )
    }

    fn goniometric(&mut self, object: &Rc<Object>, ctm: &DAffine3) -> Result<LightDescription, Fault> {
        let name = if object.has("mapname") { "mapname" } else { "filename" };
        if name == "mapname" {
            return fail(
                object.place_of(name),
                "goniometric pictures of pbrt-v3 are not read",
                "convert the light to an IES profile, or use the equal-area picture of pbrt-v4 (`filename`)",
            );
        }
        let colour = self.light_colour(object, "I")? * self.light_scale(object)?;
        let power = self.positive(object, "power")?;
        let file = self.named_file(object, name)?;
        self.finish(object, &["I", "scale", "power", "filename"])?;
        let axes = self.axes(object, ctm)?;
        Ok(LightDescription::Profile {
            file,
            layout: ProfileLayout::EqualArea { is_mirrored: axes.determinant() < 0.0 },
            position: ctm.translation,
            // The middle of the picture is at +y of the light.
            direction: axes.y_axis,
            along: axes.x_axis,
            brightness: match power {
                Some(power) => ProfileBrightness::Power(colour * power),
                None => ProfileBrightness::PerCandela(colour),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lights::Cone;

    /// The cone has the flux of the file's, which is integrated numerically.
    #[test]
    fn spots_have_the_flux_of_the_file() {
        for (inner, outer) in [(20.0, 30.0), (0.0, 15.0), (29.0, 30.0), (60.0, 120.0)] {
            let (inner, outer) = (f64::to_radians(inner), f64::to_radians(outer));
            const STEPS: usize = 100_000;
            let step = outer / STEPS as f64;
            let flux: f64 = (0..STEPS)
                .map(|i| {
                    let angle = (i as f64 + 0.5) * step;
                    let t = ((angle.cos() - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                    TAU * t * t * (3.0 - 2.0 * t) * angle.sin() * step
                })
                .sum();
            assert!((TAU * spot_integral(inner, outer) / flux - 1.0).abs() < 1e-6);
            let cone = Cone::new(inner_angle_of_flux(spot_integral(inner, outer), outer), outer);
            assert!((cone.flux() / flux - 1.0).abs() < 5e-3, "{inner} {outer}: {}", cone.flux() / flux);
        }
    }
}
