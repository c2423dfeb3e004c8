//! `[camera]`, `[film]` and `[render]`.

use crate::math::unit_f64;
use crate::photons::{Estimator, Kernel, SearchRegion};
use crate::render::{GuideKind, IntegratorKind, MapKind, Overrides, Quality, ShadowMode, Show};
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, NUMBER, Table, Value};
use glam::DVec3;

/// Most pixels along one side of a picture.
const MAX_SIDE: u64 = 65_536;

/// Most pixels of a picture: at about 60 bytes each of all layers together 16 GB.
const MAX_PIXELS: u64 = 1 << 28;

/// Sine of the smallest angle between the view and `up` that still says which way is up.
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
const CONE_CONSTANT: Expected =
    Expected { what: "a number from 1 to 1000", example: "1.1", holds: |x| (1.0..=1000.0).contains(&x) };
const CACHE_ERROR: Expected =
    Expected { what: "a number from 0.01 to 1", example: "0.2", holds: |x| (0.01..=1.0).contains(&x) };
const TARGET_ERROR: Expected =
    Expected { what: "a number from 0.000001 to 10", example: "0.02", holds: |x| (1e-6..=10.0).contains(&x) };
const SHARE: Expected =
    Expected { what: "a share from 0 to 1", example: "0.02", holds: |x| (0.0..=1.0).contains(&x) };

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

/// The lens, by its radius or by f-number and focal length; what is sharp is where `at` is unless it is said otherwise.
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

/// The film of a scene file that says nothing about it.
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

/// A name, or a table of `type`, `radius` and (Gaussian) `sigma`.
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

/// Names of [`Quality`], as on the command line.
const QUALITIES: &[(&str, Quality)] = &[
    ("draft", Quality::Draft),
    ("preview", Quality::Preview),
    ("final", Quality::Final),
    ("reference", Quality::Reference),
];
const INTEGRATORS: &[(&str, IntegratorKind)] = &[
    ("photon-map", IntegratorKind::PhotonMap),
    ("photons", IntegratorKind::Photons),
    ("path", IntegratorKind::Path),
    ("progressive", IntegratorKind::Progressive),
];
const MAPS: &[(&str, MapKind)] = &[("global", MapKind::Global), ("caustic", MapKind::Caustic)];
const GUIDES: &[(&str, GuideKind)] = &[("none", GuideKind::None), ("photons", GuideKind::Photons)];
const ESTIMATORS: &[(&str, Estimator)] =
    &[("as-printed", Estimator::AsPrinted), ("corrected", Estimator::Corrected)];
const SEARCH_REGIONS: &[(&str, SearchRegion)] =
    &[("sphere", SearchRegion::Sphere), ("disc", SearchRegion::Disc)];

const SHADOW_MODES: &[(&str, ShadowMode)] =
    &[("off", ShadowMode::Off), ("as-printed", ShadowMode::AsPrinted), ("bounded", ShadowMode::Bounded)];
const SHOWS: &[(&str, Show)] = &[("radiance", Show::Radiance), ("classes", Show::Classes)];

/// Filter constant of the cone where none is given: as in the presets.
const DEFAULT_CONE: f32 = 1.0;
const KERNELS: &[(&str, Kernel)] = &[
    ("constant", Kernel::Constant),
    ("cone", Kernel::Cone { k: DEFAULT_CONE }),
    ("epanechnikov", Kernel::Epanechnikov),
    ("gaussian", Kernel::Gaussian),
];

/// Settings under the names of the command line's options. Lengths are in units of `unit` metres.
pub(super) fn read_render(mut table: Table<'_>, unit: f64) -> Option<Overrides> {
    const MANY: u64 = 1 << 24;
    const PHOTONS: u64 = 1 << 40;
    const SHADOW_RAYS: u64 = 1 << 30;
    const MOST_ROUNDS: u64 = 1 << 40;
    let count = |low: u64, high: u64| {
        move |value: Value<'_>| value.integer(low..=high).and_then(|count| u32::try_from(count).ok())
    };
    let photons = |value: Value<'_>| value.integer(0..=PHOTONS);
    let quality = table.optional("quality", |value| value.choice(QUALITIES));
    let integrator = table.optional("integrator", |value| value.choice(INTEGRATORS));
    let map = table.optional("map", |value| value.choice(MAPS));
    let seed = table.optional("seed", |value| value.integer(0..=u64::MAX));
    let spp = table.optional("spp", count(1, MANY));
    let global_photons = table.optional("global-photons", photons);
    let caustic_photons = table.optional("caustic-photons", photons);
    let global_nearest = table.optional("global-nearest", count(1, MANY));
    let caustic_nearest = table.optional("caustic-nearest", count(1, MANY));
    let global_radius = table.optional("global-radius", |value| value.number(&RADIUS).map(|r| r * unit));
    let caustic_radius = table.optional("caustic-radius", |value| value.number(&RADIUS).map(|r| r * unit));
    let kernel = read_kernel(&mut table);
    let estimator = table.optional("estimator", |value| value.choice(ESTIMATORS));
    let search = table.optional("search", |value| value.choice(SEARCH_REGIONS));
    let aim_photons = table.optional("aim-photons", |value| value.boolean());
    let differential_check = table.optional("differential-check", |value| value.boolean());
    let gather_samples = table.optional("gather-samples", count(1, MANY));
    let glossy_samples = table.optional("glossy-samples", count(1, MANY));
    let guide = table.optional("guide", |value| value.choice(GUIDES));
    let visible_kernel = table.optional("visible-kernel", |value| value.boolean());
    let shadow_photons = table.optional("shadow-photons", |value| value.choice(SHADOW_MODES));
    let shadow_photon_rays = table.optional("shadow-photon-rays", |value| value.integer(0..=SHADOW_RAYS));
    let show = table.optional("show", |value| value.choice(SHOWS));
    let precomputed_irradiance = table.optional("precomputed-irradiance", |value| value.boolean());
    let light_samples = table.optional("light-samples", count(1, MANY));
    let max_depth = table.optional("max-depth", count(1, MANY));
    let share = |limits: &'static Expected| move |value: Value<'_>| value.number(limits).map(|x| x as f32);
    let irradiance_cache = table.optional("irradiance-cache", |value| value.boolean());
    let illumination_maps = table.optional("illumination-maps", |value| value.boolean());
    let adaptive = table.optional("adaptive", |value| value.boolean());
    let cache_error = table.optional("cache-error", share(&CACHE_ERROR));
    let cache_samples = table.optional("cache-samples", count(4, MANY));
    let caustic_reuse = table.optional("caustic-reuse", share(&SHARE));
    let accurate_distance = table.optional("accurate-distance", share(&SHARE));
    let approximate_weight = table.optional("approximate-weight", share(&SHARE));
    let glints = table.optional("glints", |value| value.boolean());
    let rounds = table.optional("rounds", |value| value.integer(1..=MOST_ROUNDS));
    let target_error = table.optional("target-error", |value| value.number(&TARGET_ERROR));
    table.finish();
    Some(Overrides {
        quality: quality?,
        integrator: integrator?,
        map: map?,
        seed: seed?,
        spp: spp?,
        global_photons: global_photons?,
        caustic_photons: caustic_photons?,
        // The memory of a machine is none of a scene's business.
        photons_memory: None,
        global_nearest: global_nearest?,
        caustic_nearest: caustic_nearest?,
        global_radius: global_radius?,
        caustic_radius: caustic_radius?,
        kernel: kernel?,
        estimator: estimator?,
        search: search?,
        aim_photons: aim_photons?,
        differential_check: differential_check?,
        gather_samples: gather_samples?,
        glossy_samples: glossy_samples?,
        guide: guide?,
        visible_kernel: visible_kernel?,
        caustic_reuse: caustic_reuse?,
        shadow_photons: shadow_photons?,
        shadow_photon_rays: shadow_photon_rays?,
        show: show?,
        precomputed_irradiance: precomputed_irradiance?,
        light_samples: light_samples?,
        max_depth: max_depth?,
        irradiance_cache: irradiance_cache?,
        illumination_maps: illumination_maps?,
        adaptive: adaptive?,
        cache_error: cache_error?,
        cache_samples: cache_samples?,
        accurate_distance: accurate_distance?,
        approximate_weight: approximate_weight?,
        glints: glints?,
        rounds: rounds?,
        target_error: target_error?,
    })
}

/// `kernel` and, for the cone alone, `cone-k`; which by itself means the cone.
fn read_kernel(table: &mut Table<'_>) -> Option<Option<Kernel>> {
    let kernel = table.optional("kernel", |value| value.choice(KERNELS));
    let k = table.get("cone-k");
    let constant = k.map(|value| value.number(&CONE_CONSTANT));
    match (kernel?, constant) {
        (kernel, None) => Some(kernel),
        (None | Some(Kernel::Cone { .. }), Some(constant)) => {
            Some(Some(Kernel::Cone { k: constant? as f32 }))
        }
        (Some(_), Some(_)) => {
            let span = k.map_or(table.span().clone(), |value| value.span());
            let message = "`cone-k` belongs to the cone, and `kernel` is another";
            table.context().error(&span, message, "leave `cone-k` out, or write `kernel = \"cone\"`");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Serialize;

    /// The names here are those under which settings are written to metadata.
    #[test]
    fn names_are_the_serialized_ones() {
        fn check<T: Serialize>(choices: &[(&str, T)]) {
            for (name, choice) in choices {
                assert_eq!(serde_json::to_value(choice).unwrap(), *name);
            }
        }
        check(QUALITIES);
        check(INTEGRATORS);
        check(MAPS);
        check(GUIDES);
        check(ESTIMATORS);
        check(SEARCH_REGIONS);
        check(SHADOW_MODES);
        check(SHOWS);
    }
}
