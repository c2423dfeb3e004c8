//! `[media.NAME]`.

use super::density::{FACTOR, read_density, read_fills};
use super::entries;
use super::index::{IOR, Index, read_index};
use super::materials::read_absorption;
use super::names::Names;
use crate::math::Rgb;
use crate::media::{Coefficients, NAMED_MEDIA, NamedMedium, Phase};
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, FRACTION, NON_NEGATIVE, POSITIVE, Table, Value};
use glam::DVec3;

const PRIORITY: Expected = Expected {
    what: "a whole number from -1000 to 1000",
    example: "1",
    holds: |x| x.fract() == 0.0 && x.abs() <= 1000.0,
};

/// Range of the mean cosine of phase functions.
const MEAN_COSINE: Expected = Expected {
    what: "a number between -1 and 1 (0 scatters evenly, above 0 forwards)",
    example: "0.8",
    holds: |x| x.abs() < 1.0,
};

/// Media by name, with `air` first.
pub(super) fn read_media(tables: &[(Table<'_>, f64)]) -> (Vec<Named<MediumDescription>>, Names) {
    let mut names = Names::new("medium");
    names.add("air", Location::default());
    let air =
        MediumDescription { ior: 1.0, dispersion: None, absorption: DVec3::ZERO, priority: 0, volume: None };
    let mut media =
        vec![Named { name: "air".to_string(), location: Location::default(), value: air.clone() }];
    for (span, value, unit) in entries(tables) {
        let context = value.context();
        let name = value.name();
        if name == "air" {
            let remedy = "`air` is built in with `ior = 1.0`; choose another name";
            context.error(&span, "`air` cannot be defined anew", remedy);
            continue;
        }
        if names.declare(context, name, &span).is_none() {
            continue;
        }
        let example = format!("write `[media.{name}]` and below it `ior = 1.5`");
        let medium =
            value.table(format!("[media.{name}]"), &example).and_then(|medium| read_medium(medium, unit));
        // A medium with errors keeps its place, so that the numbers of the others stay valid.
        let value = medium.unwrap_or(air.clone());
        let fills_scene = |medium: &MediumDescription| {
            medium.volume.as_ref().is_some_and(|volume| matches!(volume.fills, FillDescription::Scene { .. }))
        };
        let others: &[Named<MediumDescription>] = if fills_scene(&value) { &media } else { &[] };
        if let Some(first) = others.iter().find(|medium| fills_scene(&medium.value)) {
            let message = format!("`{}` fills the scene already, and `{name}` is to do so too", first.name);
            context.error(&span, message, "leave `fills` out in one of them, and give it to a body");
        }
        media.push(Named { name: name.to_string(), location: context.location(&span), value });
    }
    (media, names)
}

fn read_medium(mut table: Table<'_>, unit: f64) -> Option<MediumDescription> {
    let presets = NAMED_MEDIA.each_ref().map(|medium| (medium.name, medium));
    let preset = table.optional("preset", |value| value.choice(&presets));
    let absorption = read_absorption(&mut table, unit);
    let volume = read_volume(&mut table, unit, preset.flatten(), absorption);
    let ior = match &volume {
        // A scattering medium may be droplets in air, so `ior` is optional.
        Some(Some(_)) => {
            let usual = preset.flatten().map_or(1.0, |preset| f64::from(preset.ior()));
            table.or("ior", Index::constant(usual), read_index)
        }
        Some(None) => table.required("ior", IOR.example, read_index),
        // What is wrong has been said; perhaps the medium scatters.
        None => table.optional("ior", read_index).flatten(),
    };
    let priority = table.or("priority", 0, |value| Some(value.number(&PRIORITY)? as i32));
    if let (Some(Some(volume)), Some(index)) = (&volume, &ior) {
        check_fills(&table, volume, index)?;
    }
    table.finish();
    let (volume, absorption) = (volume?, absorption?);
    preset?;
    let absorption = if volume.is_some() { DVec3::ZERO } else { absorption };
    let Index { ior, dispersion } = ior?;
    Some(MediumDescription { ior, dispersion, absorption, priority: priority?, volume })
}

/// Whether a medium can fill what it is to fill.
fn check_fills(table: &Table<'_>, volume: &VolumeDescription, index: &Index) -> Option<()> {
    let has_bounds = matches!(volume.density, DensityDescription::Noise(_) | DensityDescription::Vdb { .. });
    let title = table.title();
    if volume.fills == FillDescription::Bounds && !has_bounds {
        let message = format!("{title} is to fill the bounds of its density, which ends nowhere");
        let remedy =
            "write `fills = \"scene\"`, a `density` of type `noise` or `vdb`, or give the medium to a body";
        return table.refuse(message, remedy);
    }
    if volume.fills != FillDescription::Bodies && *index != Index::constant(1.0) {
        let ior = index.ior;
        let message =
            format!("{title} has no body of its own, and `ior = {ior}` would make its border a surface");
        return table.refuse(message, "write `ior = 1.0`, or give the medium to a body in place of `fills`");
    }
    Some(())
}

/// Reads the volume of a medium: `Some(None)` where nothing scatters, `None` after an error.
fn read_volume(
    table: &mut Table<'_>,
    unit: f64,
    preset: Option<&NamedMedium>,
    absorption: Option<DVec3>,
) -> Option<Option<VolumeDescription>> {
    let scattering = table.optional("scattering", |value| value.colour(&FACTOR));
    let albedo = table.optional("albedo", |value| value.colour(&FRACTION));
    let free_path = table.optional("mean-free-path", |value| value.colour(&POSITIVE));
    let visibility = table.optional("visibility", |value| value.number(&POSITIVE));
    let emission = table.optional("emission", |value| value.colour(&NON_NEGATIVE));
    let has_table = table.peek("density").is_some_and(|value| value.is_table());
    let even = (1.0, DensityDescription::Even);
    let density = table.or("density", even, |value| read_density(value, unit));
    let fills = read_fills(table);
    let cosine = table.optional("g", |value| value.number(&MEAN_COSINE));
    let kinds = [("isotropic", Phase::Isotropic), ("rayleigh", Phase::Rayleigh)];
    let phase = table.optional("phase", |value: Value<'_>| value.choice(&kinds));
    let (scattering, albedo, free_path) = (scattering?, albedo?, free_path?);
    let (visibility, emission, cosine, phase) = (visibility?, emission?, cosine?, phase?);
    let ((factor, density), fills, absorption) = (density?, fills?, absorption?);
    let by_albedo = albedo.is_some() || free_path.is_some();
    let ways = [preset.is_some(), scattering.is_some(), by_albedo, visibility.is_some()];
    if ways.iter().filter(|&&given| given).count() > 1 {
        let message = format!("{} says in two ways how it scatters", table.title());
        return table.refuse(
            message,
            "keep one of `preset`, `scattering`, `albedo` with `mean-free-path`, `visibility`",
        );
    }
    if phase.is_some() && cosine.is_some() {
        let message = format!("{} has both `phase` and `g`", table.title());
        return table.refuse(message, "keep `g` for a phase function of Henyey and Greenstein, or `phase`");
    }
    if absorption != DVec3::ZERO && (preset.is_some() || by_albedo || visibility.is_some()) {
        let message = format!("{} gives absorption twice", table.title());
        return table.refuse(message, "leave out `absorption`, which the preset, the albedo or the visibility says, or use `scattering`");
    }
    // What absorbs and has a place of its own is a volume too.
    let has_place = has_table || fills != FillDescription::Bodies;
    let absorbs_there = absorption != DVec3::ZERO && has_place;
    if !ways.contains(&true) && emission.is_none() && !absorbs_there {
        if phase.is_some() || cosine.is_some() || factor != 1.0 || has_place {
            let message =
                format!("{} has a phase function, a density or a place, but does not scatter", table.title());
            return table
                .refuse(message, "add `scattering = 0.5`, `visibility = 50.0` or `preset = \"fog\"`");
        }
        return Some(None);
    }
    let is_fire = matches!(density, DensityDescription::Vdb { fire: Some(_), .. });
    if is_fire && emission.is_some() {
        let message = format!("{} has both `emission` and a temperature", table.title());
        return table.refuse(message, "keep `temperature`, with `glow` as its brightness, or `emission`");
    }
    let per_metre = |value: DVec3| (value / unit).as_vec3();
    let coefficients = match (preset, albedo, free_path, visibility) {
        (Some(preset), ..) => preset.coefficients(),
        (_, Some(albedo), Some(free_path), _) => {
            Coefficients::from_albedo(albedo.as_vec3(), (free_path * unit).as_vec3())
        }
        (_, Some(_), None, _) | (_, None, Some(_), _) => {
            let message = format!("{} has only one of `albedo` and `mean-free-path`", table.title());
            return table.refuse(message, "write both, as `albedo = 0.9` and `mean-free-path = 2.0`");
        }
        (.., Some(visibility)) => Coefficients::from_visibility((visibility * unit) as f32),
        _ => Coefficients::new(absorption.as_vec3(), per_metre(scattering.unwrap_or(DVec3::ZERO))),
    };
    let phase = match (phase, cosine, preset) {
        (Some(phase), ..) => Ok(phase),
        (_, Some(g), _) => Phase::henyey_greenstein(g as f32),
        (.., Some(preset)) => Ok(preset.phase()),
        _ => Ok(Phase::Isotropic),
    };
    let coefficients = coefficients
        .and_then(|c| c.per_length(factor as f32))
        .and_then(|c| c.with_emission(emission.unwrap_or(DVec3::ZERO).as_vec3() * factor as f32));
    match (coefficients, phase) {
        (Ok(coefficients), _) if is_fire && coefficients.absorption() == Rgb::ZERO => {
            let message =
                format!("{} has a temperature, but absorbs nothing: only what absorbs glows", table.title());
            table.refuse(message, "add `absorption = 1.0`, or leave `temperature` out")
        }
        (Ok(coefficients), Ok(phase)) => {
            Some(Some(VolumeDescription { coefficients, phase, density, fills }))
        }
        (Err(error), _) => table.refuse(error.to_string(), "choose other coefficients"),
        (_, Err(error)) => table.refuse(error.to_string(), "choose another phase function"),
    }
}
