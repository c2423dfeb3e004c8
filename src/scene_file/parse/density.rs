//! `density` and `fills` of `[media.NAME]`.

use super::shapes::read_point;
use super::transform::{in_metres, transform_of};
use crate::math::Bounds3;
use crate::media::density::{HeightFog, NoiseField};
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, FRACTION, NUMBER, POSITIVE, Table, Value};
use crate::textures::Octaves;
use glam::{DAffine3, DVec3};
use std::path::PathBuf;

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Height,
    Noise,
    Turbulence,
    Vdb,
}

const KINDS: &[(&str, Kind)] =
    &[("height", Kind::Height), ("noise", Kind::Noise), ("turbulence", Kind::Turbulence), ("vdb", Kind::Vdb)];

#[derive(Clone, Copy, PartialEq)]
enum Fills {
    Bodies,
    Bounds,
    Scene,
}

const FILLS: &[(&str, Fills)] =
    &[("bodies", Fills::Bodies), ("bounds", Fills::Bounds), ("scene", Fills::Scene)];

/// Range of factors on a density: within it no change of scale leaves the range of `f32`.
pub(super) const FACTOR: Expected =
    Expected { what: "a number from 0 to 1e12", example: "0.5", holds: |x| (0.0..=1e12).contains(&x) };

/// Factor on the box around the scene; its sides have to be off what is at its border.
const GROW: Expected =
    Expected { what: "a number from 1.001 to 1e6", example: "1.5", holds: |x| (1.001..=1e6).contains(&x) };

/// Default factor on the box around the scene.
const USUAL_GROW: f64 = 1.5;

/// Default ratio of the finest detail of noise to its size: four octaves.
const FINEST: f64 = 1.0 / 8.0;

/// Default share of the way over which a round density fades.
const ROUND_FADE: f64 = 0.5;

const EXAMPLE: &str =
    "write a number, `density = 2.0`, or a table, `density = { type = \"height\", scale-height = 3.0 }`";

/// Reads `density`: a factor, or a table; the factor comes first.
pub(super) fn read_density(value: Value<'_>, unit: f64) -> Option<(f64, DensityDescription)> {
    if !value.is_table() {
        return Some((value.number(&FACTOR)?, DensityDescription::Even));
    }
    let mut table = value.table("`density`", EXAMPLE)?;
    let kind = table.required("type", "\"height\"", |value| value.choice(KINDS));
    let factor = table.or("factor", 1.0, |value| value.number(&FACTOR));
    let density = match kind? {
        Kind::Height => read_height(&mut table, unit),
        Kind::Noise => read_noise(&mut table, false, unit),
        Kind::Turbulence => read_noise(&mut table, true, unit),
        Kind::Vdb => read_vdb(&mut table, unit),
    };
    table.finish();
    Some((factor?, density?))
}

fn read_height(table: &mut Table<'_>, unit: f64) -> Option<DensityDescription> {
    let base = table.or("base", 0.0, |value| value.number(&NUMBER));
    let scale = table.required("scale-height", "3.0", |value| value.number(&POSITIVE));
    let up = table.or("up", DVec3::Y, |value| value.vector(&NUMBER));
    let (base, scale, up) = (base? * unit, scale? * unit, up?);
    match HeightFog::new(up, base, scale) {
        Ok(_) => Some(DensityDescription::Height { up, base, scale }),
        Err(error) => table.refuse(error.to_string(), "check `up`, `base` and `scale-height`"),
    }
}

fn read_noise(table: &mut Table<'_>, is_turbulent: bool, unit: f64) -> Option<DensityDescription> {
    let (min, max) = (read_point(table, "min"), read_point(table, "max"));
    let size = table.required("size", "0.5", |value| value.number(&POSITIVE));
    let finest = table.optional("finest", |value| value.number(&POSITIVE));
    let seed = table.or("seed", 0, |value| value.integer(0..=u64::from(u32::MAX)));
    let low = table.or("low", 0.0, |value| value.number(&NUMBER));
    let high = table.or("high", 1.0, |value| value.number(&NUMBER));
    let is_round = table.or("envelope", false, |value| value.choice(&[("box", false), ("ellipsoid", true)]));
    let fade = table.optional("fade", |value| value.number(&FRACTION));
    let transform = transform_of(table);
    let (min, max, size, levels, is_round) = (min?, max?, size?, (low?, high?), is_round?);
    let octaves =
        Octaves { size, finest: finest?.unwrap_or(FINEST * size), seed: u32::try_from(seed?).ok()? };
    let fade = fade?.unwrap_or(if is_round { ROUND_FADE } else { 0.0 });
    if min.cmpge(max).any() {
        let message = "`min` of a density must be below its `max` on every axis";
        return table.refuse(message, "exchange numbers, or make one of them larger");
    }
    if is_round && fade == 0.0 {
        let message = "a density in an ellipsoid must fade towards its border";
        return table
            .refuse(message, "give `fade` above 0, or leave `envelope` out and give the medium to a sphere");
    }
    if let Err(error) = NoiseField::new(octaves, is_turbulent, levels, DAffine3::IDENTITY) {
        return table.refuse(error.to_string(), "check `low`, `high`, `size` and `finest`");
    }
    Some(DensityDescription::Noise(NoiseDescription {
        octaves,
        is_turbulent,
        levels,
        bounds: Bounds3 { min, max },
        is_round,
        fade,
        transform: in_file(transform?, unit),
    }))
}

fn read_vdb(table: &mut Table<'_>, unit: f64) -> Option<DensityDescription> {
    let file = table.required("file", "\"cloud.vdb\"", read_vdb_path);
    let grid = table.optional("grid", |value| Some(value.string()?.into_owned()));
    let transform = transform_of(table);
    let fire = read_fire(table);
    Some(DensityDescription::Vdb {
        file: file?,
        grid: grid?,
        transform: in_file(transform?, unit),
        fire: fire?,
    })
}

/// Reads `temperature`, `kelvin` and `glow`.
fn read_fire(table: &mut Table<'_>) -> Option<Option<FireDescription>> {
    let grid = table.optional("temperature", |value| Some(value.string()?.into_owned()));
    let kelvin = table.optional("kelvin", |value| value.number(&POSITIVE));
    let glow = table.optional("glow", |value| value.number(&FACTOR));
    match (grid?, kelvin?, glow?) {
        (Some(grid), kelvin, glow) => {
            Some(Some(FireDescription { grid, kelvin: kelvin.unwrap_or(1.0), glow: glow.unwrap_or(1.0) }))
        }
        (None, None, None) => Some(None),
        _ => table.refuse(
            "`density` says how it glows, but not at which temperature",
            "name the grid of the file, `temperature = \"temperature\"`, or leave `kelvin` and `glow` out",
        ),
    }
}

/// From coordinates that are in units of the file, under a `transform` of the file, to metres.
fn in_file(transform: DAffine3, unit: f64) -> DAffine3 {
    in_metres(transform, unit) * DAffine3::from_scale(DVec3::splat(unit))
}

/// Path of a file of voxels, which must exist. Whether it is one is known when it is read.
fn read_vdb_path(value: Value<'_>) -> Option<PathBuf> {
    let path = value.path()?;
    let shown = path.display();
    let context = value.context();
    if !path.exists() {
        let remedy = "paths are relative to the scene file, those given by `--set` to the current directory";
        context.error(&value.span(), format!("there is no file {shown}"), remedy);
        return None;
    }
    if !path.is_file() {
        let message = format!("{shown} is a folder or not a regular file");
        context.error(&value.span(), message, "name an OpenVDB file (.vdb)");
        return None;
    }
    Some(path)
}

/// Reads `fills` and `grow`.
pub(super) fn read_fills(table: &mut Table<'_>) -> Option<FillDescription> {
    let fills = table.or("fills", Fills::Bodies, |value| value.choice(FILLS));
    let grow = table.optional("grow", |value| value.number(&GROW));
    match (fills?, grow?) {
        (Fills::Scene, grow) => Some(FillDescription::Scene { grow: grow.unwrap_or(USUAL_GROW) }),
        (_, Some(_)) => {
            let message = format!("{} has `grow`, but does not fill the scene", table.title());
            table.refuse(message, "write `fills = \"scene\"` too, or leave `grow` out")
        }
        (Fills::Bounds, None) => Some(FillDescription::Bounds),
        (Fills::Bodies, None) => Some(FillDescription::Bodies),
    }
}
