//! Sensors, films, samplers and integrators: the view, and hints for the computation.

use super::Importer;
use super::error::{Fault, fail};
use super::import::blank_film;
use super::text::shown;
use super::value::Object;
use crate::film::PixelRect;
use crate::scene_file::description::{
    CameraDescription, FilmDescription, FilterDescription, FovAxis, LensDescription, ProjectionDescription,
};
use crate::scene_file::diagnostic::suggestion;
use glam::DVec3;
use std::rc::Rc;

/// Most pixels along one side of a picture, and in total: the limits of scene files.
const MOST_SIDE: i64 = 65_536;
const MOST_PIXELS: i64 = 1 << 28;

/// Most samples of a pixel.
const MOST_SAMPLES: i64 = 1 << 24;

/// Diagonal of 36 x 24 mm film.
const DIAGONAL: f64 = 43.266_615_305_567_87;

/// Default size of a picture.
const USUAL_SIZE: (i64, i64) = (768, 576);

/// A film of Mitsuba's default size.
pub(super) fn usual_film() -> FilmDescription {
    let filter = FilterDescription::Gaussian { radius: 2.0, sigma: 0.5 };
    blank_film([USUAL_SIZE.0 as u32, USUAL_SIZE.1 as u32], filter)
}

impl Importer<'_> {
    /// Reads a number of pixels.
    fn side(object: &Object, name: &str, usual: i64, least: i64) -> Result<u32, Fault> {
        let value = object.integer(name)?.unwrap_or(usual);
        match u32::try_from(value) {
            Ok(side) if value >= least && value <= MOST_SIDE => Ok(side),
            _ => {
                let place = object.get(name).map_or(&object.place, |property| &property.place);
                fail(
                    place,
                    format!("`{name}` is {value}"),
                    format!("write a number of pixels from {least} to {MOST_SIDE}"),
                )
            }
        }
    }

    pub(super) fn film(&mut self, object: &Object) -> Result<(), Fault> {
        if !matches!(object.plugin.as_str(), "hdrfilm" | "ldrfilm" | "tiledhdrfilm" | "mfilm" | "specfilm") {
            let known = suggestion(&object.plugin, &["hdrfilm", "ldrfilm"]);
            return fail(&object.place, format!("the film `{}` is not known", shown(&object.plugin)), known);
        }
        if object.plugin == "specfilm" {
            self.report.note(object, "colours are red, green and blue");
        }
        let width = Self::side(object, "width", USUAL_SIZE.0, 1)?;
        let height = Self::side(object, "height", USUAL_SIZE.1, 1)?;
        if i64::from(width) * i64::from(height) > MOST_PIXELS {
            let message = format!("a picture of {width} x {height} pixels");
            return fail(&object.place, message, format!("at most {MOST_PIXELS} pixels in all are rendered"));
        }
        let x0 = Self::side(object, "crop_offset_x", 0, 0)?;
        let y0 = Self::side(object, "crop_offset_y", 0, 0)?;
        let across = Self::side(object, "crop_width", i64::from(width), 1)?;
        let down = Self::side(object, "crop_height", i64::from(height), 1)?;
        let crop = PixelRect { x0, y0, x1: x0.saturating_add(across), y1: y0.saturating_add(down) };
        if crop.x1 > width || crop.y1 > height {
            let message = format!(
                "the crop window ends at {}, {} and the picture at {width}, {height}",
                crop.x1, crop.y1
            );
            return fail(&object.place, message, "make it smaller");
        }
        let filters = self.parts(object, "rfilter")?;
        let filter = match filters.last() {
            Some(filter) => self.filter(filter)?,
            None => usual_film().filter,
        };
        let written = [
            "file_format",
            "pixel_format",
            "component_format",
            "channel_names",
            "banner",
            "gamma",
            "exposure",
            "tonemap_method",
            "key",
            "burn",
            "fill_alpha",
            "label",
            "variable",
            "digits",
        ];
        self.ignore(object, &written, "files are chosen by -o, and the picture is developed by --exposure");
        self.ignore(
            object,
            &["sample_border", "compensate", "high_quality_edges", "attach_log"],
            "films sum in their own way",
        );
        let known = ["width", "height", "crop_offset_x", "crop_offset_y", "crop_width", "crop_height"];
        self.finish(object, &known)?;
        let is_whole = crop == PixelRect::whole(width, height);
        self.description.film =
            FilmDescription { width, height, filter, crop: (!is_whole).then_some(crop), ..usual_film() };
        Ok(())
    }

    fn filter(&mut self, object: &Object) -> Result<FilterDescription, Fault> {
        let radius = |usual: f64| object.within("radius", usual, 0.001..=16.0);
        let filter = match object.plugin.as_str() {
            "box" => FilterDescription::Box { radius: radius(0.5)? },
            "tent" => FilterDescription::Tent { radius: radius(1.0)? },
            "gaussian" => {
                let sigma = object.within("stddev", 0.5, 0.001..=16.0)?;
                FilterDescription::Gaussian { radius: (4.0 * sigma).min(16.0), sigma }
            }
            "mitchell" | "catmullrom" => {
                let third = 1.0 / 3.0;
                let (b, c) = (object.float_or("B", third)?, object.float_or("C", third)?);
                let (b, c) = (object.float_or("b", b)?, object.float_or("c", c)?);
                if object.plugin == "catmullrom" || (b - third).abs() > 1e-6 || (c - third).abs() > 1e-6 {
                    self.report
                        .note(object, "is taken for the cubic of Mitchell and Netravali with B = C = 1/3");
                }
                FilterDescription::Mitchell { radius: 2.0 }
            }
            "lanczos" => {
                object.integer("lobes")?;
                self.report.note(object, "is taken for the cubic of Mitchell and Netravali");
                FilterDescription::Mitchell { radius: 2.0 }
            }
            other => {
                let known =
                    suggestion(other, &["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"]);
                return fail(&object.place, format!("the filter `{}` is not known", shown(other)), known);
            }
        };
        self.finish(object, &["radius", "stddev"])?;
        Ok(filter)
    }

    /// Reads the camera with its film and its samples.
    pub(super) fn sensor(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        match object.plugin.as_str() {
            "perspective" | "thinlens" | "orthographic" | "telecentric" => {}
            "perspective_rdist" | "spherical" | "radiancemeter" | "fluencemeter" | "irradiancemeter"
            | "distant" | "batch" | "mradiancemeter" => {
                return fail(
                    &object.place,
                    format!("the sensor `{}` is not modelled", object.plugin),
                    "use `perspective` or `orthographic`",
                );
            }
            other => {
                let known = suggestion(other, &["perspective", "thinlens", "orthographic", "telecentric"]);
                return fail(&object.place, format!("the sensor `{}` is not known", shown(other)), known);
            }
        }
        for film in self.parts(object, "film")? {
            self.film(&film)?;
        }
        for sampler in self.parts(object, "sampler")? {
            self.sampler_of(&sampler)?;
        }
        let to_world = object.transform("to_world")?;
        let is_parallel = matches!(object.plugin.as_str(), "orthographic" | "telecentric");
        let is_lens = matches!(object.plugin.as_str(), "thinlens" | "telecentric");
        let matrix = to_world.matrix3;
        let projection = if is_parallel {
            // x from -1 to 1 of the sensor's own space.
            ProjectionDescription::Orthographic {
                extent: 2.0 * matrix.x_axis.length(),
                axis: FovAxis::Horizontal,
            }
        } else {
            let (fov, axis) = self.field_of_view(object)?;
            ProjectionDescription::Perspective { fov, axis }
        };
        let radius = if is_lens { object.within("aperture_radius", 0.0, 0.0..=1e9)? } else { 0.0 };
        let far = object.float_or("far_clip", 1e4)?;
        let focus = object.float_or("focus_distance", far)?;
        self.ignore(object, &["near_clip", "far_clip"], "nothing is clipped");
        if !is_lens {
            self.ignore(object, &["focus_distance"], "without a lens everything is sharp");
        }
        if object.float_or("principal_point_offset_x", 0.0)? != 0.0
            || object.float_or("principal_point_offset_y", 0.0)? != 0.0
        {
            self.report
                .warn(object, "its shift (`principal_point_offset`) is not modelled: the picture is centred");
        }
        if object.float_or("shutter_open", 0.0)? != object.float_or("shutter_close", 0.0)? {
            self.report.note(object, "its shutter has no effect, as nothing moves");
        }
        if object.has("srf") {
            object.get("srf");
            self.report.warn(object, "`srf` is not modelled: colours are red, green and blue");
        }
        if !self.parts(object, "medium")?.is_empty() {
            self.report.note(object, "the medium around the camera is that of the body that it is in");
        }
        let known: &[&str] = match is_parallel {
            true => &["to_world", "focus_distance", "aperture_radius"],
            false => &["to_world", "fov", "fov_axis", "focal_length", "focus_distance", "aperture_radius"],
        };
        self.finish(object, known)?;
        let place = object.get("to_world").map_or(&object.place, |property| &property.place);
        let (Some(forward), Some(up)) =
            (crate::math::unit_f64(matrix.z_axis), crate::math::unit_f64(matrix.y_axis))
        else {
            return fail(
                place,
                "the transform of the camera flattens its view",
                "give it a scale that is not zero",
            );
        };
        if forward.cross(up).length() < 1e-6 || matrix.determinant() == 0.0 {
            return fail(
                place,
                "the transform of the camera flattens its view",
                "give it a scale that is not zero",
            );
        }
        if is_parallel && (matrix.y_axis.length() / matrix.x_axis.length() - 1.0).abs() > 1e-4 {
            return fail(
                place,
                "the transform of the camera scales the picture differently across and upwards",
                "pixels are square here: give x and y of its scale the same factor",
            );
        }
        // Lengths in the space of a sensor of parallel rays are scaled with it.
        let (scale, depth) =
            if is_parallel { (matrix.x_axis.length(), matrix.z_axis.length()) } else { (1.0, 1.0) };
        let eye = to_world.translation;
        if is_lens && !(focus > 0.0) {
            return fail(&object.place, format!("a focus distance of {focus}"), "write a number above 0");
        }
        self.description.camera = Some(CameraDescription {
            location: object.place.location.clone(),
            eye,
            at: eye + forward * self.view_distance(eye),
            up,
            projection,
            lens: (radius > 0.0).then_some(LensDescription { radius: radius * scale, focus: focus * depth }),
            mirrored: matrix.determinant() < 0.0,
        });
        Ok(())
    }

    /// A view distance at which the direction keeps its digits beside those of the eye.
    fn view_distance(&self, eye: DVec3) -> f64 {
        eye.abs().max_element().max(1.0)
    }

    /// The field of view in degrees, and the side that it spans.
    fn field_of_view(&mut self, object: &Object) -> Result<(f64, FovAxis), Fault> {
        let FilmDescription { width, height, .. } = self.description.film;
        let aspect = f64::from(width) / f64::from(height);
        let (fov, axis) = match object.float("fov")? {
            Some(fov) => (fov, object.text("fov_axis")?.unwrap_or("x").to_ascii_lowercase()),
            None => {
                let text = object.text("focal_length")?.unwrap_or("50mm");
                let length: Option<f64> = text.trim().trim_end_matches("mm").trim().parse().ok();
                let Some(length) = length.filter(|length| *length > 0.0 && length.is_finite()) else {
                    let message = format!("`{}` is no focal length", shown(text));
                    return fail(&object.place, message, "write for example 50mm");
                };
                ((2.0 * (0.5 * DIAGONAL / length).atan()).to_degrees(), "diagonal".to_owned())
            }
        };
        let place = object.get("fov").map_or(&object.place, |property| &property.place);
        if !(fov > 0.0 && fov < 180.0) {
            return fail(
                place,
                format!("a field of view of {fov} degrees"),
                "write an angle between 0 and 180",
            );
        }
        let is_wide = aspect > 1.0;
        Ok(match axis.as_str() {
            "x" => (fov, FovAxis::Horizontal),
            "y" => (fov, FovAxis::Vertical),
            "smaller" => (fov, if is_wide { FovAxis::Vertical } else { FovAxis::Horizontal }),
            "larger" => (fov, if is_wide { FovAxis::Horizontal } else { FovAxis::Vertical }),
            "diagonal" => {
                let diagonal = (0.5 * fov.to_radians()).tan();
                let half_width = diagonal / (1.0 + 1.0 / (aspect * aspect)).sqrt();
                ((2.0 * half_width.atan()).to_degrees(), FovAxis::Horizontal)
            }
            other => {
                let known = suggestion(other, &["x", "y", "smaller", "larger", "diagonal"]);
                return fail(&object.place, format!("`{}` is no `fov_axis`", shown(other)), known);
            }
        })
    }

    pub(super) fn sampler_of(&mut self, object: &Object) -> Result<(), Fault> {
        let count = object.integer("sample_count")?;
        let place = object.get("sample_count").map_or(&object.place, |property| &property.place);
        if let Some(count) = count {
            if !(1..=MOST_SAMPLES).contains(&count) {
                let remedy = format!("write a number from 1 to {MOST_SAMPLES}");
                return fail(place, format!("{count} samples for each pixel"), remedy);
            }
            self.description.render.spp = u32::try_from(count).ok();
            self.report.note(object, format!("{count} samples for each pixel are taken, with numbers of cardioid's own (--spp for others)"));
        }
        self.ignore(
            object,
            &["seed", "dimension", "scramble", "jitter"],
            "random numbers are cardioid's own",
        );
        self.finish(object, &["sample_count"])
    }

    /// Reads the depths of an integrator; the integrator itself is chosen on the command line.
    pub(super) fn integrator(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        self.enter(object)?;
        let read = self.integrator_of(object);
        self.leave();
        read
    }

    fn integrator_of(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let nested = self.parts(object, "integrator")?;
        for nested in &nested {
            self.integrator(nested)?;
        }
        let depth = object.integer("max_depth")?;
        // The other parameters concern the method, and each integrator has its own.
        object.unread();
        if nested.is_empty() {
            self.report.note(object, "light is computed by cardioid's own ways (--integrator)");
        }
        match depth {
            Some(depth @ 1..=10_000) => {
                self.description.render.max_depth = u32::try_from(depth).ok();
                self.report.note(
                    object,
                    format!(
                        "paths end after {depth} surfaces, as its `max_depth` says (--max-depth for more)"
                    ),
                );
            }
            Some(0) => {
                self.report.warn(object, "a `max_depth` of 0 shows nothing, and is not used");
            }
            _ => {}
        }
        if object.has("hide_emitters") && object.boolean("hide_emitters", false)? {
            self.report.warn(object, "`hide_emitters` is not modelled: lights are seen");
        }
        Ok(())
    }
}
