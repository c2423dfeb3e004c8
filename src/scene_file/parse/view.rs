//! `[camera]` and `[film]`.

use crate::math::unit_f64;
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, NUMBER, Table, Value};
use glam::DVec3;

/// Most pixels along one side of a picture.
const MAX_SIDE: u64 = 65_536;

/// Most pixels of a picture: 16 GB, at about 60 bytes for all layers of a pixel.
const MAX_PIXELS: u64 = 1 << 28;

/// Sine of the smallest angle between the view and `up` that still defines which way is up.
const SMALLEST_UP_ANGLE: f64 = 1e-9;

const FIELD_OF_VIEW: Expected =
    Expected { what: "an angle between 0 and 180 degrees", example: "40.0", holds: |x| x > 0.0 && x < 180.0 };
const FISHEYE: Expected = Expected {
    what: "an angle above 0, at most 360 degrees",
    example: "180.0",
    holds: |x| x > 0.0 && x <= 360.0,
};
const MILLIMETRES: Expected =
    Expected { what: "a length above zero, in millimetres", example: "36", holds: |x| x > 0.0 };

/// Default of `fov`, degrees.
const FOV: f64 = 40.0;

const FILTER_RADIUS: Expected = Expected {
    what: "a number of pixels above 0, at most 16",
    example: "1.5",
    holds: |x| x > 0.0 && x <= 16.0,
};
const STOPS: Expected =
    Expected { what: "a number of stops from -100 to 100", example: "1.0", holds: |x| x.abs() <= 100.0 };

const LENS_RADIUS: Expected =
    Expected { what: "a length of at least 0", example: "0.005", holds: |x| x >= 0.0 };
const RADIUS: Expected = Expected { what: "a length above zero", example: "0.01", holds: |x| x > 0.0 };

pub(super) fn read_camera(mut table: Table<'_>, unit: f64) -> Option<CameraDescription> {
    let context = table.context();
    let location = table.location();
    let span = table.span().clone();
    let kinds = [
        ("perspective", Kind::Perspective),
        ("orthographic", Kind::Orthographic),
        ("panorama", Kind::Panorama),
        ("fisheye", Kind::Fisheye),
    ];
    let kind = table.or("type", Kind::Perspective, |value| value.choice(&kinds));
    let eye = table.required("eye", "[0.0, 1.5, 4.0]", |value| value.vector(&NUMBER));
    let at = table.required("at", "[0.0, 0.5, 0.0]", |value| value.vector(&NUMBER));
    let up_span = table.get("up").map_or(span.clone(), |value| value.span());
    let up = table.or("up", DVec3::Y, |value| value.vector(&NUMBER));
    // The other keys depend on the type.
    let kind = kind?;
    let (projection, lens) = match kind {
        Kind::Perspective => {
            let view = read_perspective(&mut table, unit);
            let focal_length = view.and_then(|(_, focal_length)| focal_length);
            (view.map(|(view, _)| view), read_lens(&mut table, eye.zip(at), unit, focal_length))
        }
        Kind::Orthographic => {
            (read_orthographic(&mut table, unit), read_lens(&mut table, eye.zip(at), unit, None))
        }
        Kind::Panorama => (Some(ProjectionDescription::Panorama), Some(None)),
        Kind::Fisheye => {
            let angle = table.or("fov", 180.0, |value| value.number(&FISHEYE));
            (angle.map(|angle| ProjectionDescription::Fisheye { angle }), Some(None))
        }
    };
    table.finish();
    let (eye, at, up, projection, lens) = (eye?, at?, up?, projection?, lens?);
    let Some(forward) = unit_f64(at - eye) else {
        let remedy = "move `at` to what should be in the middle of the picture";
        context.error(&span, "the camera's `eye` and `at` are the same point or too far apart", remedy);
        return None;
    };
    match unit_f64(up) {
        Some(up) if forward.cross(up).length() > SMALLEST_UP_ANGLE => {}
        _ => {
            let message = "the camera's `up` is zero or parallel to its view from `eye` to `at`";
            context.error(&up_span, message, "choose another `up`, for example `up = [0.0, 0.0, 1.0]`");
            return None;
        }
    }
    let (eye, at) = (eye * unit, at * unit);
    Some(CameraDescription { location, eye, at, up, projection, lens, mirrored: false })
}

#[derive(Clone, Copy)]
enum Kind {
    Perspective,
    Orthographic,
    Panorama,
    Fisheye,
}

/// A focal length, and the metres of its unit.
#[derive(Clone, Copy)]
struct FocalLength {
    length: f64,
    unit: f64,
    /// Whether it says with a sensor what is in view.
    is_of_sensor: bool,
}

const AXES: [(&str, FovAxis); 2] = [("vertical", FovAxis::Vertical), ("horizontal", FovAxis::Horizontal)];

/// Reads the field of view, from an angle or from the focal length and the sensor. Also yields the focal length, where a
/// lens may take it.
fn read_perspective(
    table: &mut Table<'_>,
    unit: f64,
) -> Option<(ProjectionDescription, Option<FocalLength>)> {
    let fov = table.optional("fov", |value| value.number(&FIELD_OF_VIEW));
    let axis = table.optional("fov-axis", |value| value.choice(&AXES));
    let sensor = table.optional("sensor", |value| value.pair(&MILLIMETRES, "[36, 24]"));
    let focal_length = table.optional("focal-length", |value| value.number(&RADIUS));
    let (fov, axis, sensor, focal_length) = (fov?, axis?, sensor?, focal_length?);
    let Some(sensor) = sensor else {
        let axis = axis.unwrap_or(FovAxis::Vertical);
        let fov = fov.unwrap_or(FOV);
        let focal_length = focal_length.map(|length| FocalLength { length, unit, is_of_sensor: false });
        return Some((ProjectionDescription::Perspective { fov, axis }, focal_length));
    };
    let Some(focal_length) = focal_length else {
        return table.refuse(
            "the camera has a `sensor` and no `focal-length`",
            "add it, in millimetres, for example `focal-length = 50`",
        );
    };
    if fov.is_some() || axis.is_some() {
        return table.refuse(
            "the camera has both `fov` or `fov-axis` and a `sensor`, which with `focal-length` says what is in view",
            "leave one out",
        );
    }
    let [width, height] = sensor;
    let fov = (2.0 * (0.5 * width / focal_length).atan()).to_degrees();
    if !(FIELD_OF_VIEW.holds)(fov) {
        return table.refuse(
            format!("a focal length of {focal_length} mm behind a sensor {width} mm wide is a field of view of {fov} degrees"),
            "write both in millimetres, for example `focal-length = 50` and `sensor = [36, 24]`",
        );
    }
    let axis = FovAxis::Sensor { aspect: width / height };
    let focal_length = FocalLength { length: focal_length, unit: 1e-3, is_of_sensor: true };
    Some((ProjectionDescription::Perspective { fov, axis }, Some(focal_length)))
}

/// Reads how much parallel rays show.
fn read_orthographic(table: &mut Table<'_>, unit: f64) -> Option<ProjectionDescription> {
    let width = table.optional("width", |value| value.number(&RADIUS));
    let height = table.optional("height", |value| value.number(&RADIUS));
    let (extent, axis) = match (width?, height?) {
        (Some(width), None) => (width, FovAxis::Horizontal),
        (None, Some(height)) => (height, FovAxis::Vertical),
        _ => {
            return table.refuse(
                "an orthographic camera needs either `width` or `height`: how much of the scene is in view",
                "write one of them, for example `height = 2.0`; the other follows from the picture",
            );
        }
    };
    Some(ProjectionDescription::Orthographic { extent: extent * unit, axis })
}

/// Reads the lens, from its radius or from f-number and focal length. The focal plane is at `at` unless the file says otherwise.
fn read_lens(
    table: &mut Table<'_>,
    view: Option<(DVec3, DVec3)>,
    unit: f64,
    focal_length: Option<FocalLength>,
) -> Option<Option<LensDescription>> {
    let radius = table.optional("lens-radius", |value| value.number(&LENS_RADIUS));
    let f_number = table.optional("f-number", |value| value.number(&RADIUS));
    let focus = table.optional("focus-distance", |value| value.number(&RADIUS));
    let (radius, focus) = (radius?, focus?);
    let radius = match (radius, f_number?, focal_length) {
        (_, None, Some(FocalLength { is_of_sensor: false, .. })) => {
            return table.refuse(
                "the camera has a `focal-length`, and neither a `sensor` nor an `f-number`: it would change nothing",
                "add `sensor`, for example `sensor = [36, 24]`, or `f-number`, or write `fov`",
            );
        }
        (None, Some(f_number), Some(focal_length)) => {
            Some(0.5 * focal_length.length / f_number * focal_length.unit)
        }
        (radius, None, _) => radius.map(|radius| radius * unit),
        _ => {
            return table.refuse(
                "the camera's lens needs either `lens-radius`, or `f-number` and `focal-length` together",
                "leave the others out",
            );
        }
    };
    match (radius, focus) {
        (None, Some(_)) => table.refuse(
            "the camera has a `focus-distance` and no lens: through a pinhole everything is sharp",
            "add `lens-radius`, or `f-number` and `focal-length`",
        ),
        (Some(radius), focus) if radius > 0.0 => {
            let to_target = view.map_or(1.0, |(eye, at)| (at - eye).length());
            let focus = focus.unwrap_or(to_target);
            Some(Some(LensDescription { radius, focus: focus * unit }))
        }
        _ => Some(None),
    }
}

/// The film of a scene file without `[film]`.
pub(super) fn default_film() -> FilmDescription {
    FilmDescription {
        width: 512,
        height: 512,
        filter: FilterDescription::Box { radius: 0.5 },
        exposure: None,
        white: 0.0,
        crop: None,
    }
}

pub(super) fn read_film(mut table: Table<'_>) -> Option<FilmDescription> {
    let default = default_film();
    let side = |value: Value<'_>| value.integer(1..=MAX_SIDE);
    let width = table.or("width", u64::from(default.width), side);
    let height = table.or("height", u64::from(default.height), side);
    let filter = table.or("filter", default.filter, read_filter);
    let exposure = table.optional("exposure", |value| value.number(&STOPS));
    let (context, span) = (table.context(), table.span().clone());
    table.finish();
    let (width, height) = (width?, height?);
    if width * height > MAX_PIXELS {
        let message = format!("a picture of {width} x {height} pixels: at most {MAX_PIXELS} in all");
        context.error(&span, message, "make `width` or `height` smaller, or render crop windows");
        return None;
    }
    let (width, height) = (u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    Some(FilmDescription { width, height, filter: filter?, exposure: exposure?, white: 0.0, crop: None })
}

#[derive(Clone, Copy)]
enum FilterKind {
    Box,
    Tent,
    Gaussian,
    Mitchell,
}

/// Reads a name, or a table of `type`, `radius` and (Gaussian) `sigma`.
fn read_filter(value: Value<'_>) -> Option<FilterDescription> {
    let kinds = [
        ("box", FilterKind::Box),
        ("tent", FilterKind::Tent),
        ("gaussian", FilterKind::Gaussian),
        ("mitchell", FilterKind::Mitchell),
    ];
    let of_kind = |kind, radius: Option<f64>, sigma: Option<f64>| match kind {
        FilterKind::Box => FilterDescription::Box { radius: radius.unwrap_or(0.5) },
        FilterKind::Tent => FilterDescription::Tent { radius: radius.unwrap_or(1.0) },
        FilterKind::Gaussian => {
            FilterDescription::Gaussian { radius: radius.unwrap_or(1.5), sigma: sigma.unwrap_or(0.5) }
        }
        FilterKind::Mitchell => FilterDescription::Mitchell { radius: radius.unwrap_or(2.0) },
    };
    if !value.is_table() {
        return value.choice(&kinds).map(|kind| of_kind(kind, None, None));
    }
    let mut table = value.table("`filter`", "")?;
    let kind = table.required("type", "\"gaussian\"", |value| value.choice(&kinds));
    let radius = table.optional("radius", |value| value.number(&FILTER_RADIUS));
    let sigma = match kind {
        Some(FilterKind::Gaussian) => table.optional("sigma", |value| value.number(&FILTER_RADIUS)),
        _ => Some(None),
    };
    table.finish();
    Some(of_kind(kind?, radius?, sigma?))
}
