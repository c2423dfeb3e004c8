//! `[[lights]]`: lights without a surface.

use super::brightness::{lumens, read_brightness, watts};
use super::names::Names;
use super::read_name;
use super::sky::read_sky;
use crate::files::open_regular;
use crate::lights::Cone;
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, NON_NEGATIVE, NUMBER, SHARE, Table, Value};
use glam::DVec3;
use std::f64::consts::PI;
use std::path::PathBuf;

/// A smaller disc would have a radiance beyond what single precision holds well.
const DIAMETER: Expected = Expected {
    what: "an angle from 0.001 to 180 degrees, or 0 for parallel light",
    example: "0.53",
    holds: |x| x == 0.0 || (0.001..=180.0).contains(&x),
};
const CONE_ANGLE: Expected = Expected {
    what: "an angle from 0 to 180 degrees",
    example: "30.0",
    holds: |x| (0.0..=180.0).contains(&x),
};

/// Radiant intensity of one candela, W/sr: 683 lm/W.
const PER_CANDELA: f64 = 1.0 / 683.0;

#[derive(Clone, Copy)]
enum Kind {
    Point,
    Directional,
    Environment,
    Sky,
    Spot,
    Ies,
}

/// The lights, and for each the factor on its share of the photons.
pub(super) fn read_lights(tables: Vec<(Table<'_>, f64)>) -> (Vec<Named<LightDescription>>, Vec<f64>) {
    let mut names = Names::new("light");
    let mut environment: Option<Location> = None;
    let (mut lights, mut shares) = (Vec::new(), Vec::new());
    for (index, (mut table, unit)) in tables.into_iter().enumerate() {
        let name = read_name(&mut table, &mut names, "light", index);
        let location = table.location();
        let context = table.context();
        let span = table.span().clone();
        let photons = table.or("photons", 1.0, |value| value.number(&SHARE));
        let Some(value) = read_light(table, unit) else { continue };
        let surrounds = matches!(
            value,
            LightDescription::Environment { .. }
                | LightDescription::EnvironmentMap { .. }
                | LightDescription::Sky { .. }
                | LightDescription::CieSky { .. }
        );
        if surrounds && let Some(first) = environment.replace(location.clone()) {
            let message = format!("a second environment: the first is at {first}");
            context.error(&span, message, "a sky is one as well; leave all but one of them out");
        }
        let (Some(name), Some(photons)) = (name, photons) else { continue };
        lights.push(Named { name, location, value });
        shares.push(photons);
    }
    (lights, shares)
}

fn read_light(mut table: Table<'_>, unit: f64) -> Option<LightDescription> {
    let kinds = [
        ("point", Kind::Point),
        ("directional", Kind::Directional),
        ("environment", Kind::Environment),
        ("sky", Kind::Sky),
        ("spot", Kind::Spot),
        ("ies", Kind::Ies),
    ];
    let light = match table.required("type", "\"point\"", |value| value.choice(&kinds))? {
        Kind::Point => {
            let position = table.required("position", "[0.0, 2.0, 0.0]", |value| value.vector(&NUMBER));
            let intensity = read_intensity(&mut table, 4.0 * PI);
            position
                .zip(intensity)
                .map(|(position, intensity)| LightDescription::Point { position: position * unit, intensity })
        }
        Kind::Directional => {
            let direction = table.required("direction", "[0.0, -1.0, 0.0]", read_direction);
            let measures = [watts("irradiance", ()), lumens("lux", ())];
            let irradiance = match read_brightness(&mut table, &measures) {
                Some(None) => table.required("irradiance", "[3.0, 3.0, 3.0]", |_| None),
                found => found.flatten().map(|(irradiance, ())| irradiance),
            };
            let diameter = table.or("angular-diameter", 0.0, |value| value.number(&DIAMETER));
            match (direction, irradiance, diameter) {
                (Some(direction), Some(irradiance), Some(0.0)) => {
                    Some(LightDescription::Directional { direction, irradiance })
                }
                (Some(direction), Some(irradiance), Some(diameter)) => {
                    let radius = 0.5 * diameter.to_radians();
                    Some(LightDescription::Sun { direction, irradiance, radius })
                }
                _ => None,
            }
        }
        Kind::Environment => read_environment(&mut table),
        Kind::Sky => read_sky(&mut table),
        Kind::Spot => read_spot(&mut table, unit),
        Kind::Ies => read_profile(&mut table, unit),
    };
    table.finish();
    light
}

pub(super) fn read_direction(value: Value<'_>) -> Option<DVec3> {
    match value.vector(&NUMBER)? {
        DVec3::ZERO => value.refuse("a direction", "give at least one number that is not 0"),
        direction => Some(direction),
    }
}

/// Path of an existing file.
pub(super) fn read_file(value: Value<'_>) -> Option<PathBuf> {
    let path = value.path()?;
    if !path.is_file() {
        let message = match open_regular(&path) {
            Err(error) if path.exists() => format!("{} cannot be read: {error}", path.display()),
            _ => format!("there is no file {}", path.display()),
        };
        let remedy = "paths are relative to the scene file, those given by `--set` to the current directory";
        value.context().error(&value.span(), message, remedy);
        return None;
    }
    Some(path)
}

/// A constant radiance or an environment map.
fn read_environment(table: &mut Table<'_>) -> Option<LightDescription> {
    let Some(image) = table.get("image") else {
        let measures = [watts("radiance", ()), lumens("nits", ())];
        let radiance = match read_brightness(table, &measures) {
            Some(None) => table.required("radiance", "[1.0, 1.0, 1.0]", |_| None),
            found => found.flatten().map(|(radiance, ())| radiance),
        };
        return radiance.map(|radiance| LightDescription::Environment { radiance });
    };
    let image = read_file(image);
    let turn = table.or("rotation", 0.0, |value| value.number(&NUMBER));
    let factor = table.or("scale", DVec3::ONE, |value| value.colour(&NON_NEGATIVE));
    Some(LightDescription::EnvironmentMap {
        image: image?,
        layout: EnvironmentLayout::LatitudeLongitude,
        turn: turn?.to_radians(),
        axes: None,
        factor: factor?,
    })
}

fn read_spot(table: &mut Table<'_>, unit: f64) -> Option<LightDescription> {
    let position = table.required("position", "[0.0, 2.0, 0.0]", |value| value.vector(&NUMBER));
    let direction = table.required("direction", "[0.0, -1.0, 0.0]", read_direction);
    let outer = table.or("outer-angle", 45.0, |value| value.number(&CONE_ANGLE));
    let inner_span = table.get("inner-angle").map(|value| value.span());
    let inner = table.or("inner-angle", 0.0, |value| value.number(&CONE_ANGLE));
    let (inner, outer) = (inner?.to_radians(), outer?.to_radians());
    if inner > outer || outer <= 0.0 {
        let span = inner_span.unwrap_or(table.span().clone());
        let message = "the inner angle of the cone is larger than the outer one, or the outer one is 0";
        table.context().error(
            &span,
            message,
            "make `outer-angle` the larger one; both count from the middle",
        );
        return None;
    }
    let flux = Cone::new(inner, outer).flux();
    let intensity = read_intensity(table, flux);
    Some(LightDescription::Spot {
        position: position? * unit,
        direction: direction?,
        intensity: intensity?,
        inner,
        outer,
    })
}

fn read_profile(table: &mut Table<'_>, unit: f64) -> Option<LightDescription> {
    let position = table.required("position", "[0.0, 2.0, 0.0]", |value| value.vector(&NUMBER));
    let file = table.required("file", "\"lamp.ies\"", read_file);
    let direction = table.or("direction", DVec3::NEG_Y, read_direction);
    let along = table.optional("along", read_direction);
    let measures = [watts("scale", false), watts("power", true), lumens("lumens", true)];
    let brightness = read_brightness(table, &measures).map(|found| match found {
        None => ProfileBrightness::PerCandela(DVec3::splat(PER_CANDELA)),
        Some((scale, false)) => ProfileBrightness::PerCandela(scale * PER_CANDELA),
        Some((power, true)) => ProfileBrightness::Power(power),
    });
    let (direction, along) = (direction?, along?);
    let towards = direction.normalize();
    let along = match along {
        Some(along) if along.normalize().cross(towards).length() > 1e-6 => along,
        Some(_) => {
            return table.refuse(
                format!("`along` of {} is parallel to its `direction`", table.title()),
                "choose a direction across, along the luminaire",
            );
        }
        None if towards.cross(DVec3::X).length() > 1e-3 => DVec3::X,
        None => DVec3::Z,
    };
    Some(LightDescription::Profile {
        file: file?,
        layout: ProfileLayout::Photometric,
        position: position? * unit,
        direction,
        along,
        brightness: brightness?,
    })
}

/// Radiant intensity (W/sr) of a light at a point. The file gives it directly, in W/sr or in candela, or as power in W or lumens, which is
/// `flux` times the intensity.
fn read_intensity(table: &mut Table<'_>, flux: f64) -> Option<DVec3> {
    let measures =
        [watts("intensity", 1.0), watts("power", flux), lumens("candela", 1.0), lumens("lumens", flux)];
    match read_brightness(table, &measures)? {
        Some((amount, factor)) => Some(amount / factor),
        None => table.refuse(
            format!("{} does not say how bright it is", table.title()),
            "add `power = [..]` (W), `intensity = [..]` (W/sr), `lumens` or `candela`",
        ),
    }
}
