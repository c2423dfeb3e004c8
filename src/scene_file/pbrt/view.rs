//! Cameras, films, filters, samplers and integrators: the view, and hints for the computation.

use super::Importer;
use super::error::{Fault, fail};
use super::import::blank_film;
use super::import::shape::is_distorted;
use super::object::Object;
use super::text::shown;
use crate::film::PixelRect;
use crate::math::unit_f64;
use crate::scene_file::description::{
    CameraDescription, FilmDescription, FilterDescription, FovAxis, LensDescription, ProjectionDescription,
};
use crate::scene_file::diagnostic::suggestion;
use glam::DVec3;

/// Most pixels along one side of a picture, and in total: the limits of scene files.
const MOST_SIDE: i64 = 65_536;
const MOST_PIXELS: i64 = 1 << 28;

/// Most samples of a pixel.
const MOST_SAMPLES: i64 = 1 << 24;

/// Default sizes of pictures, of pbrt-v4 and pbrt-v3.
const USUAL_SIZE: (i64, i64) = (1280, 720);
const OLD_SIZE: (i64, i64) = (640, 480);

/// Number of bounces that integrators follow by default.
const USUAL_DEPTH: i64 = 5;

/// A film of the default size.
pub(super) fn usual_film() -> FilmDescription {
    let filter = FilterDescription::Gaussian { radius: 1.5, sigma: 0.5 };
    blank_film([USUAL_SIZE.0 as u32, USUAL_SIZE.1 as u32], filter)
}

impl Importer<'_> {
    fn side(object: &Object, name: &str, usual: i64) -> Result<u32, Fault> {
        let value = object.integer(name)?.unwrap_or(usual);
        match u32::try_from(value) {
            Ok(side) if (1..=MOST_SIDE).contains(&value) => Ok(side),
            _ => {
                let remedy = format!("write a number of pixels from 1 to {MOST_SIDE}");
                fail(object.place_of(name), format!("`{name}` is {value}"), remedy)
            }
        }
    }

    pub(super) fn film(&mut self, object: &Object) -> Result<(), Fault> {
        match object.kind.as_str() {
            "rgb" | "gbuffer" => {}
            "spectral" => self.report.note(object, "colours are red, green and blue"),
            "image" => self.is_old = true,
            other => {
                let known = suggestion(other, &["rgb", "gbuffer", "spectral"]);
                return fail(&object.place, format!("the film `{}` is not known", shown(other)), known);
            }
        }
        let usual = if self.is_old { OLD_SIZE } else { USUAL_SIZE };
        let width = Self::side(object, "xresolution", usual.0)?;
        let height = Self::side(object, "yresolution", usual.1)?;
        if i64::from(width) * i64::from(height) > MOST_PIXELS {
            let message = format!("a picture of {width} x {height} pixels");
            return fail(&object.place, message, format!("at most {MOST_PIXELS} pixels in all are rendered"));
        }
        let crop = Self::crop(object, [width, height])?;
        self.sensor(object)?;
        let written = ["filename", "savefp16", "diagonal", "coordinatesystem"];
        self.ignore(object, &written, "-o names the picture, and EXR holds it as it is");
        let buckets = ["nbuckets", "lambdamin", "lambdamax"];
        self.ignore(object, &buckets, "colours are red, green and blue");
        for name in ["maxcomponentvalue", "maxsampleluminance"] {
            if let Some(most) = object.float(name)? {
                self.report.note(object, format!("samples above its `{name}` of {most} are not clamped"));
            }
        }
        let known = [
            "xresolution",
            "yresolution",
            "cropwindow",
            "pixelbounds",
            "iso",
            "whitebalance",
            "sensor",
            "scale",
        ];
        self.finish(object, &known)?;
        let film = &mut self.description.film;
        *film = FilmDescription { width, height, filter: film.filter, crop, ..usual_film() };
        Ok(())
    }

    /// The part of the picture that is rendered; `None` for all of it.
    fn crop(object: &Object, [width, height]: [u32; 2]) -> Result<Option<PixelRect>, Fault> {
        let window = object.list("cropwindow", &["float"], 4)?;
        let bounds = object.list("pixelbounds", &["integer", "float"], 4)?;
        let at = |share: f64, side: u32| (share.clamp(0.0, 1.0) * f64::from(side)).ceil() as u32;
        let crop = match (window, bounds) {
            (&[x0, x1, y0, y1], _) => {
                let [x0, x1] = [x0.min(x1), x0.max(x1)].map(|x| at(x, width));
                let [y0, y1] = [y0.min(y1), y0.max(y1)].map(|y| at(y, height));
                PixelRect { x0, y0, x1, y1 }
            }
            (_, &[x0, x1, y0, y1]) => {
                let within = |x: f64, side: u32| x.clamp(0.0, f64::from(side)) as u32;
                let [x0, x1, y0, y1] =
                    [within(x0, width), within(x1, width), within(y0, height), within(y1, height)];
                PixelRect { x0, y0, x1, y1 }
            }
            _ => return Ok(None),
        };
        if crop.x0 >= crop.x1 || crop.y0 >= crop.y1 {
            let name = if window.is_empty() { "pixelbounds" } else { "cropwindow" };
            let message = format!("the window of `{name}` holds no pixel");
            return fail(
                object.place_of(name),
                message,
                "write x0 x1 y0 y1, each first number below its second",
            );
        }
        Ok((crop != PixelRect::whole(width, height)).then_some(crop))
    }

    /// Reads how a film scales the light that it gets.
    fn sensor(&mut self, object: &Object) -> Result<(), Fault> {
        let range = 0.0..=1e12;
        let mut factor = object.within("iso", 100.0, range.clone())? / 100.0;
        factor *= object.within("imagingratio", 1.0, range.clone())?;
        factor *= object.within("exposuretime", 1.0, range.clone())?;
        factor *= object.within("scale", 1.0, range)?;
        self.sensor_scale = factor;
        if let Some(sensor) = object.text("sensor")?.filter(|sensor| *sensor != "cie1931") {
            self.report.note(
                object,
                format!(
                    "colours are those of the CIE observer of 1931, not of the sensor `{}`",
                    shown(sensor)
                ),
            );
        }
        if object.float("whitebalance")?.is_some_and(|kelvin| kelvin != 0.0) {
            self.report.warn(object, "`whitebalance` is left out: colours are those of the light");
        }
        Ok(())
    }

    pub(super) fn filter(&mut self, object: &Object) -> Result<(), Fault> {
        let radius = |object: &Object, usual: f64| -> Result<[f64; 2], Fault> {
            let old = [
                object.within("xwidth", usual, 0.001..=16.0)?,
                object.within("ywidth", usual, 0.001..=16.0)?,
            ];
            let x = object.within("xradius", old[0], 0.001..=16.0)?;
            Ok([x, object.within("yradius", old[1], 0.001..=16.0)?])
        };
        let is_old = object.has("xwidth") || object.has("ywidth") || object.has("alpha");
        let (radii, filter): ([f64; 2], &dyn Fn(f64) -> FilterDescription) = match object.kind.as_str() {
            "box" => (radius(object, 0.5)?, &|radius| FilterDescription::Box { radius }),
            "triangle" => (radius(object, 2.0)?, &|radius| FilterDescription::Tent { radius }),
            "gaussian" => {
                let alpha = object.within("alpha", 2.0, 1e-6..=1e6)?;
                let usual = if is_old { (0.5 / alpha).sqrt() } else { 0.5 };
                let sigma = object.within("sigma", usual, 0.001..=16.0)?;
                let radii = radius(object, if is_old { 2.0 } else { 1.5 })?;
                (radii, &move |radius| FilterDescription::Gaussian { radius, sigma })
            }
            "mitchell" | "sinc" => {
                let third = 1.0 / 3.0;
                let (b, c) = (object.float_or("B", third)?, object.float_or("C", third)?);
                object.float("tau")?;
                if object.kind == "sinc" || (b - third).abs() > 1e-6 || (c - third).abs() > 1e-6 {
                    self.report
                        .note(object, "is taken for the cubic of Mitchell and Netravali with B = C = 1/3");
                }
                let usual = if object.kind == "sinc" { 4.0 } else { 2.0 };
                let [x, y] = radius(object, usual)?;
                let most = if object.kind == "sinc" { 2.0 } else { 16.0 };
                ([x.min(most), y.min(most)], &|radius| FilterDescription::Mitchell { radius })
            }
            other => {
                let known = suggestion(other, &["box", "triangle", "gaussian", "mitchell", "sinc"]);
                return fail(&object.place, format!("the filter `{}` is not known", shown(other)), known);
            }
        };
        let [x, y] = radii;
        if x != y {
            self.report.note(object, "its two radii are taken for their mean: filters are as wide as high");
        }
        self.description.film.filter = filter(0.5 * (x + y));
        self.finish(object, &["xradius", "yradius", "sigma"])
    }

    pub(super) fn sampler(&mut self, object: &Object) -> Result<(), Fault> {
        let known = [
            "halton",
            "independent",
            "paddedsobol",
            "pmj02bn",
            "sobol",
            "stratified",
            "zsobol",
            "random",
            "02sequence",
            "lowdiscrepancy",
            "maxmindist",
        ];
        if !known.contains(&object.kind.as_str()) {
            let message = format!("the sampler `{}` is not known", shown(&object.kind));
            return fail(&object.place, message, suggestion(&object.kind, &known));
        }
        let (name, count) = if object.kind == "stratified" {
            let x = object.integer("xsamples")?.unwrap_or(4).clamp(0, MOST_SAMPLES);
            ("xsamples", x * object.integer("ysamples")?.unwrap_or(4).clamp(0, MOST_SAMPLES))
        } else {
            ("pixelsamples", object.integer("pixelsamples")?.unwrap_or(16))
        };
        if !(1..=MOST_SAMPLES).contains(&count) {
            let remedy = format!("write a number from 1 to {MOST_SAMPLES}");
            return fail(object.place_of(name), format!("{count} samples for each pixel"), remedy);
        }
        self.description.render.spp = u32::try_from(count).ok();
        self.report.note(
            object,
            format!(
                "{count} samples for each pixel are taken, with numbers of cardioid's own (--spp for others)"
            ),
        );
        let others = ["seed", "randomization", "jitter", "dimensions", "scramble", "samplepixelcenter"];
        self.ignore(object, &others, "random numbers are cardioid's own");
        self.finish(object, &["pixelsamples", "xsamples", "ysamples"])
    }

    /// Reads the depth of an integrator; the integrator itself is chosen on the command line.
    pub(super) fn integrator(&mut self, object: &Object) -> Result<(), Fault> {
        let depth = object.integer("maxdepth")?;
        // The other parameters concern the method, and each integrator has its own.
        object.unread();
        self.report.note(object, "light is computed by cardioid's own ways (--integrator)");
        let (depth, why) = match depth {
            Some(depth) => (depth, "as its `maxdepth` says"),
            None => (USUAL_DEPTH, "as by default in pbrt"),
        };
        // Each of these surfaces reflects light of the sources; pbrt goes on to sources behind the last by chance, too.
        match u32::try_from(depth.max(1)) {
            Ok(surfaces) if depth >= 0 && i64::from(surfaces) <= MOST_SAMPLES => {
                self.description.render.max_depth = Some(surfaces);
                let message = format!("paths end after {depth} reflections, {why} (--max-depth for more)");
                self.report.note(object, message);
                if depth == 0 {
                    self.report.warn(
                        object,
                        "a `maxdepth` of 0 shows lights alone; here light of one reflection is seen",
                    );
                }
                Ok(())
            }
            _ => fail(
                object.place_of("maxdepth"),
                format!("`maxdepth` is {depth}"),
                format!("write a number of reflections from 0 to {MOST_SAMPLES}"),
            ),
        }
    }

    /// Reads the camera; the film is known then.
    pub(super) fn view(&mut self) -> Result<(), Fault> {
        let Some((object, to_camera, outside)) = self.camera.take() else { return Ok(()) };
        match object.kind.as_str() {
            "perspective" | "orthographic" | "environment" | "spherical" => {}
            "realistic" => {
                return fail(
                    &object.place,
                    "the camera `realistic` is not modelled",
                    "use `perspective` with `lensradius` and `focaldistance`",
                );
            }
            other => {
                let known = suggestion(other, &["perspective", "orthographic", "spherical"]);
                return fail(&object.place, format!("the camera `{}` is not known", shown(other)), known);
            }
        }
        super::transform::check(&to_camera, &object.place)?;
        let to_world = to_camera.inverse();
        let [right, up, view] = [to_world.matrix3.x_axis, to_world.matrix3.y_axis, to_world.matrix3.z_axis];
        let (Some(forward), true) = (unit_f64(view), to_world.is_finite()) else {
            return fail(&object.place, "the transform of the camera is out of range", "use smaller numbers");
        };
        // Numbers of six digits, as exporters write them, are no distortion.
        if is_distorted(&to_world) && distortion([right, up, view]) > 1e-4 {
            return fail(
                &object.place,
                "the transform of the camera distorts the picture: its axes are not of one length at right angles",
                "take the distortion out, or use `screenwindow`",
            );
        }
        if !outside.is_empty() {
            self.report
                .warn(&*object, format!("the medium `{}` around the camera is left out", shown(&outside)));
        }
        let is_panorama = matches!(object.kind.as_str(), "environment" | "spherical");
        let projection = match object.kind.as_str() {
            _ if is_panorama => {
                self.panorama(&object)?;
                ProjectionDescription::Panorama
            }
            "orthographic" => {
                let window = self.window(&object)?;
                let extent = 2.0 * window.half_width * view.length();
                ProjectionDescription::Orthographic { extent, axis: FovAxis::Horizontal }
            }
            _ => self.field_of_view(&object)?,
        };
        let radius = object.within("lensradius", 0.0, 0.0..=1e9)?;
        let focus = object.within("focaldistance", 1e6, 1e-9..=1e12)?;
        let open = object.float_or("shutteropen", 0.0)?;
        let shut = object.float_or("shutterclose", 1.0)?;
        if !self.is_old && shut > open {
            self.sensor_scale *= shut - open;
        }
        if radius > 0.0 && object.kind == "orthographic" {
            let message = "its lens blurs what is out of focus, and rays stay parallel on average: pbrt starts all rays at the middle";
            self.report.warn(&*object, message);
        }
        if is_panorama {
            self.ignore(&object, &["lensradius", "focaldistance"], "a panorama has no lens");
        }
        let known: &[&str] = match object.kind.as_str() {
            "perspective" => &["fov", "screenwindow", "frameaspectratio", "lensradius", "focaldistance"],
            "orthographic" => &["screenwindow", "frameaspectratio", "lensradius", "focaldistance"],
            _ => &["mapping"],
        };
        self.finish(&object, known)?;
        let (eye, scale) = (to_world.translation, view.length());
        // A panorama begins at x of the camera and goes on over z to -x, which is in its middle.
        let (forward, is_mirrored) = match is_panorama {
            true => (-right / scale, view.dot(right.cross(up)) < 0.0),
            // Without a mirror, x of a camera that looks along z with y up is on the left.
            false => (forward, to_world.matrix3.determinant() > 0.0),
        };
        self.description.camera = Some(CameraDescription {
            location: object.place.location.clone(),
            eye,
            at: eye + forward * eye.abs().max_element().max(1.0),
            up,
            projection,
            lens: (radius > 0.0 && !is_panorama)
                .then_some(LensDescription { radius: radius * scale, focus: focus * scale }),
            mirrored: is_mirrored,
        });
        Ok(())
    }

    /// Reads how a panorama is laid out.
    fn panorama(&mut self, object: &Object) -> Result<(), Fault> {
        let mapping = object.text("mapping")?.unwrap_or("equalarea");
        if object.kind == "spherical" && mapping != "equirectangular" {
            return fail(
                object.place_of("mapping"),
                format!("the mapping `{}` of a spherical camera is not modelled", shown(mapping)),
                "write \"string mapping\" \"equirectangular\"",
            );
        }
        Ok(())
    }

    /// The field of view of a pinhole or a lens.
    fn field_of_view(&mut self, object: &Object) -> Result<ProjectionDescription, Fault> {
        let fov = match object.float("fov")? {
            Some(fov) => fov,
            None => 2.0 * object.float_or("halffov", 45.0)?,
        };
        if !(fov > 0.0 && fov < 180.0) {
            let message = format!("a field of view of {fov} degrees");
            return fail(object.place_of("fov"), message, "write an angle between 0 and 180");
        }
        let Window { half_width, is_usual } = self.window(object)?;
        let FilmDescription { width, height, .. } = self.description.film;
        let (fov, axis) = match (is_usual, width >= height) {
            (true, true) => (fov, FovAxis::Vertical),
            (true, false) => (fov, FovAxis::Horizontal),
            (false, _) => {
                let tangent = (0.5 * fov.to_radians()).tan();
                ((2.0 * (half_width * tangent).atan()).to_degrees(), FovAxis::Horizontal)
            }
        };
        Ok(ProjectionDescription::Perspective { fov, axis })
    }

    /// The part of the plane at distance 1 that the picture shows, over the tangent of half the field of view. A window beside the middle
    /// becomes a crop of a larger picture.
    fn window(&mut self, object: &Object) -> Result<Window, Fault> {
        let FilmDescription { width, height, .. } = self.description.film;
        let (wide, high) = (f64::from(width), f64::from(height));
        let ratio = object.within("frameaspectratio", wide / high, 1e-4..=1e4)?;
        let given = object.list("screenwindow", &["float"], 4)?;
        let usual =
            if ratio > 1.0 { [-ratio, ratio, -1.0, 1.0] } else { [-1.0, 1.0, -1.0 / ratio, 1.0 / ratio] };
        let [x0, x1, y0, y1] = match *given {
            [x0, x1, y0, y1] => [x0, x1, y0, y1],
            _ => usual,
        };
        if !(x0 < x1 && y0 < y1) {
            let message = "`screenwindow` has no extent";
            return fail(
                object.place_of("screenwindow"),
                message,
                "write x0 x1 y0 y1, the lower numbers first",
            );
        }
        let (across, down) = ((x1 - x0) / wide, (y1 - y0) / high);
        if (across / down - 1.0).abs() > 1e-3 {
            self.report.warn(
                object,
                "pixels are square here: the height of its window follows from the width, and the picture is not stretched",
            );
        }
        let middle = [0.5 * (x0 + x1) / across, 0.5 * (y0 + y1) / down];
        if middle[0].abs() < 0.01 && middle[1].abs() < 0.01 {
            let is_usual = given.is_empty() && !object.has("frameaspectratio");
            return Ok(Window { half_width: 0.5 * (x1 - x0), is_usual });
        }
        self.beside_the_middle(object, middle)?;
        let half_width = 0.5 * f64::from(self.description.film.width) * across;
        Ok(Window { half_width, is_usual: false })
    }

    /// Enlarges the picture so that a window with this middle (pixels to the right and up) is a crop of it.
    fn beside_the_middle(&mut self, object: &Object, [right, up]: [f64; 2]) -> Result<(), Fault> {
        let film = &mut self.description.film;
        // The larger picture has the window at one of its sides.
        let shift = |by: f64| (2.0 * by).round();
        let (dx, dy) = (shift(right), shift(up));
        let (width, height) = (f64::from(film.width) + dx.abs(), f64::from(film.height) + dy.abs());
        if width > MOST_SIDE as f64 || height > MOST_SIDE as f64 || width * height > MOST_PIXELS as f64 {
            return fail(
                object.place_of("screenwindow"),
                "the window is too far from the middle of the view",
                "turn the camera towards it",
            );
        }
        let window = film.crop.unwrap_or(PixelRect::whole(film.width, film.height));
        let (x, y) = (dx.max(0.0) as u32, (-dy).max(0.0) as u32);
        film.crop =
            Some(PixelRect { x0: window.x0 + x, y0: window.y0 + y, x1: window.x1 + x, y1: window.y1 + y });
        (film.width, film.height) = (width as u32, height as u32);
        self.report.note(
            object,
            format!(
                "its window lies beside the middle: it is the crop of a picture of {width} x {height} pixels, to half a pixel"
            ),
        );
        Ok(())
    }
}

/// The part of the screen that a picture shows.
struct Window {
    /// Half its width, where the shorter side of a usual picture has 1.
    half_width: f64,
    /// Whether it is the usual one.
    is_usual: bool,
}

/// How much three axes differ from such of one length at right angles, as a share.
fn distortion([x, y, z]: [DVec3; 3]) -> f64 {
    let whole = z.length();
    let lengths = (x.length() / whole - 1.0).abs().max((y.length() / whole - 1.0).abs());
    let angles = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs()) / (whole * whole);
    if (lengths + angles).is_finite() { lengths.max(angles) } else { f64::INFINITY }
}
