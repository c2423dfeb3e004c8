//! Lights without a surface.

use super::Importer;
use super::error::{Fault, fail};
use super::import::light::{axes_of, inner_angle, turn_of};
use super::paint::luminance;
use super::report::Subject;
use super::spectrum::Meaning;
use super::text::shown;
use super::value::Object;
use crate::math::unit_f64;
use crate::scene_file::description::{EnvironmentLayout, LightDescription, Named};
use crate::scene_file::diagnostic::suggestion;
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use std::rc::Rc;

/// Turbidities in the range of the sky model.
const TURBIDITIES: std::ops::RangeInclusive<f64> = 1.0..=10.0;

/// Range of half angles of a cone, degrees.
const ANGLES: std::ops::RangeInclusive<f64> = 0.001..=180.0;

impl Importer<'_> {
    fn push_light(&mut self, object: &Object, value: LightDescription) {
        let location = object.place.location.clone();
        self.description.lights.push(Named { name: object.name(), location, value });
        self.description.light_photons.push(1.0);
    }

    /// Adds an emitter at the top level of the scene.
    pub(super) fn light(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let meaning = Meaning::Light { is_old: object.is_old };
        self.ignore(object, &["sampling_weight", "samples"], "lights are chosen by what they give");
        let to_world = object.transform("to_world")?;
        let of_axis = to_world.transform_vector3(DVec3::Z);
        let place = object.get("to_world").map_or(&object.place, |property| &property.place);
        let flat = || fail(place, "the transform flattens everything", "give it a scale that is not zero");
        let value = match object.plugin.as_str() {
            "point" => {
                let intensity = self.plain_colour(object, "intensity", 1.0, meaning)?;
                let position = object.vector("position")?.unwrap_or(to_world.translation);
                self.finish(object, &["intensity", "position", "to_world"])?;
                LightDescription::Point { position, intensity }
            }
            "directional" => {
                let irradiance = self.plain_colour(object, "irradiance", 1.0, meaning)?;
                let direction = object.vector("direction")?.unwrap_or(of_axis);
                self.finish(object, &["irradiance", "direction", "to_world"])?;
                if unit_f64(direction).is_none() {
                    return fail(
                        &object.place,
                        "the direction of the light is zero",
                        "write for example <vector name=\"direction\" x=\"0\" y=\"-1\" z=\"0\"/>",
                    );
                }
                LightDescription::Directional { direction, irradiance }
            }
            "spot" => {
                let mut intensity = self.plain_colour(object, "intensity", 1.0, meaning)?;
                let cutoff = object.within("cutoff_angle", 20.0, ANGLES)?;
                let beam = object.float_or("beam_width", 0.75 * cutoff)?.clamp(0.0, cutoff);
                if object.has("texture") {
                    intensity *= self.paint(object, "texture", 1.0, Meaning::Number)?.mean();
                    self.report.warn(object, "its picture is not projected: the mean of its colours counts");
                }
                self.finish(object, &["intensity", "cutoff_angle", "beam_width", "texture", "to_world"])?;
                if unit_f64(of_axis).is_none() {
                    return flat();
                }
                if beam < cutoff {
                    self.report.note(object, "its edge falls with the square of the cosine, where the file has it fall evenly in the angle; intensity in the middle and flux are the same");
                }
                let (beam, cutoff) = (beam.to_radians(), cutoff.to_radians());
                LightDescription::Spot {
                    position: to_world.translation,
                    direction: of_axis,
                    intensity,
                    inner: inner_angle(beam, cutoff),
                    outer: cutoff,
                }
            }
            "constant" => {
                let radiance = self.plain_colour(object, "radiance", 1.0, meaning)?;
                self.finish(object, &["radiance", "to_world"])?;
                LightDescription::Environment { radiance }
            }
            "envmap" => {
                let image = self.file(object, "filename")?;
                let scale = object.within("scale", 1.0, 0.0..=1e15)?;
                if let Some(gamma) = object.float("gamma")?.filter(|gamma| *gamma != 1.0 && *gamma != -1.0) {
                    self.report.note(
                        object,
                        format!("the gamma of {gamma} is not used: the file itself says how it is encoded"),
                    );
                }
                self.ignore(
                    object,
                    &["mis_compensation", "cache"],
                    "directions are drawn by what the picture gives",
                );
                self.finish(object, &["filename", "scale", "to_world"])?;
                let Some((axes, differs)) = axes_of(to_world.matrix3) else { return flat() };
                if differs {
                    self.report.note(object, "its transform is taken for the nearest rotation");
                }
                // The middle of the picture is at -z here; in Mitsuba its edge is there.
                let (turn, axes) = match turn_of(&axes) {
                    Some(turn) => (turn + PI, None),
                    None => (PI, Some(axes)),
                };
                LightDescription::EnvironmentMap {
                    image,
                    layout: EnvironmentLayout::LatitudeLongitude,
                    turn,
                    axes,
                    factor: DVec3::splat(scale),
                }
            }
            "sunsky" | "sky" | "sun" => return self.sky(object),
            "area" => {
                return fail(
                    &object.place,
                    "an area light without a shape",
                    "put it into the <shape> that emits",
                );
            }
            "projector" | "directionalarea" | "timed_sunsky" | "collimated" | "skylight" => {
                self.report.warn(object, "is not modelled, and left out: its light is missing");
                return Ok(());
            }
            other => {
                let known = ["area", "point", "directional", "spot", "constant", "envmap", "sunsky"];
                let message = format!("the emitter `{}` is not known", shown(other));
                return fail(&object.place, message, suggestion(other, &known));
            }
        };
        let has_light = match &value {
            LightDescription::Point { intensity, .. } | LightDescription::Spot { intensity, .. } => {
                *intensity
            }
            LightDescription::Directional { irradiance, .. } => *irradiance,
            LightDescription::Environment { radiance } => *radiance,
            _ => DVec3::ONE,
        };
        if luminance(has_light) == 0.0 {
            self.report.note(object, "gives no light");
        }
        self.push_light(object, value);
        Ok(())
    }

    fn sky(&mut self, object: &Object) -> Result<(), Fault> {
        let to_world = object.transform("to_world")?;
        let turbidity = object.within("turbidity", 3.0, TURBIDITIES)?;
        let albedo = self.plain_colour(object, "albedo", 0.3, Meaning::Reflectance)?;
        let scale = object.within("scale", 1.0, 0.0..=1e15)?;
        let sky_scale = object.within("sky_scale", scale, 0.0..=1e15)?;
        let sun_scale = object.within("sun_scale", scale, 0.0..=1e15)?;
        let Some(towards) = object.vector("sun_direction")? else {
            return fail(
                &object.place,
                format!("{} does not say where the sun is", object.label()),
                "write <vector name=\"sun_direction\" x=\"0.5\" y=\"0.3\" z=\"0.7\"/> in it: places and times are not read",
            );
        };
        let ignored = ["sun_aperture", "sun_radius_scale", "stretch", "extend", "resolution", "complex_sun"];
        self.ignore(object, &ignored, "the sun has the size that it has, and the sky is that of its model");
        let known = ["turbidity", "albedo", "scale", "sky_scale", "sun_scale", "sun_direction", "to_world"];
        self.finish(object, &known)?;
        // The sky of current versions has z up; that of versions before 2.0 has y up, as here.
        let upright =
            if object.is_old { DMat3::IDENTITY } else { DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y) };
        let Some((axes, _)) = axes_of(to_world.matrix3 * upright) else {
            return fail(
                &object.place,
                "the transform flattens everything",
                "give it a scale that is not zero",
            );
        };
        let Some(local) = unit_f64(axes.transpose() * towards) else {
            return fail(&object.place, "the direction of the sun is zero", "write where it stands");
        };
        if local.y < 0.0 {
            self.report.warn(object, "its sun stands below the horizon, so there is no light from it");
            return Ok(());
        }
        let sun = object.plugin != "sky" && sun_scale > 0.0;
        if sun && sun_scale != sky_scale || object.plugin == "sun" {
            self.report.note(object, "sun and sky are scaled alike, by that of the sky");
        }
        self.report.note(object, "is as bright as the sky of cardioid is (docs/scene-format.md)");
        let is_upright = (axes - DMat3::IDENTITY).to_cols_array().iter().all(|d| d.abs() < 1e-9);
        let value = LightDescription::Sky {
            elevation: local.y.clamp(0.0, 1.0).asin(),
            azimuth: local.x.atan2(-local.z),
            turbidity,
            albedo,
            factor: DVec3::splat(if sky_scale > 0.0 { sky_scale } else { sun_scale }),
            sun,
            axes: (!is_upright).then_some(axes),
        };
        self.push_light(object, value);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lights::Cone;

    /// The cone has the flux of a cone that falls off linearly in the angle, which is integrated numerically.
    #[test]
    fn cones_have_the_flux_of_the_file() {
        for (beam, cutoff) in [(15.0, 30.0), (0.0, 20.0), (20.0, 20.0), (1.0, 80.0), (60.0, 120.0)] {
            let (beam, cutoff) = (f64::to_radians(beam), f64::to_radians(cutoff));
            const STEPS: usize = 200_000;
            let step = cutoff / STEPS as f64;
            let flux: f64 = (0..STEPS)
                .map(|i| {
                    let angle = (i as f64 + 0.5) * step;
                    let share = if angle < beam { 1.0 } else { (cutoff - angle) / (cutoff - beam) };
                    2.0 * PI * share * angle.sin() * step
                })
                .sum();
            let cone = Cone::new(inner_angle(beam, cutoff), cutoff);
            // The narrowest edge is 0.001 wide in the cosine, and two thirds of its flux are missing.
            let bound = 1e-3 + 0.7e-3 / (1.0 - cutoff.cos());
            let ratio = cone.flux() / flux;
            assert!((ratio - 1.0).abs() < bound, "{beam} {cutoff}: {ratio}");
        }
    }
}
