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
    let eye = table.required("eye", "[0.0, 1.5, 4.0]", |value| value.vector(&NUMBER));
    let at = table.required("at", "[0.0, 0.5, 0.0]", |value| value.vector(&NUMBER));
    let up_span = table.get("up").map_or(span.clone(), |value| value.span());
    let up = table.or("up", DVec3::Y, |value| value.vector(&NUMBER));
    let fov = table.or("fov", 40.0, |value| value.number(&FIELD_OF_VIEW));
    let axes = [("vertical", FovAxis::Vertical), ("horizontal", FovAxis::Horizontal)];
    let fov_axis = table.or("fov-axis", FovAxis::Vertical, |value| value.choice(&axes));
    let lens = read_lens(&mut table, eye.zip(at), unit);
    table.finish();
    let (eye, at, up, lens) = (eye?, at?, up?, lens?);
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
    Some(CameraDescription { location, eye, at, up, fov: fov?, fov_axis: fov_axis?, lens, mirrored: false })
}

/// Reads the lens, from its radius or from f-number and focal length. The focal plane is at `at` unless the file says otherwise.
fn read_lens(
    table: &mut Table<'_>,
    view: Option<(DVec3, DVec3)>,
    unit: f64,
) -> Option<Option<LensDescription>> {
    let radius = table.optional("lens-radius", |value| value.number(&LENS_RADIUS));
    let f_number = table.optional("f-number", |value| value.number(&RADIUS));
    let focal_length = table.optional("focal-length", |value| value.number(&RADIUS));
    let focus = table.optional("focus-distance", |value| value.number(&RADIUS));
    let (radius, focus) = (radius?, focus?);
    let radius = match (radius, f_number?, focal_length?) {
        (radius, None, None) => radius,
        // The diameter is the focal length over the f-number.
        (None, Some(f_number), Some(focal_length)) => Some(0.5 * focal_length / f_number),
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
            Some(Some(LensDescription { radius: radius * unit, focus: focus * unit }))
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
