//! `[textures.NAME]`, and the references to textures in materials.

use super::entries;
use super::images::Images;
use super::names::Names;
use super::transform::{in_metres, transform_of};
use crate::math::Rgb;
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, FRACTION, NON_NEGATIVE, POSITIVE, Table, Value};
use crate::textures::{Octaves, Pattern, SolidTexture};

#[derive(Clone, Copy)]
enum Kind {
    Noise,
    Turbulence,
    Waves,
    Marble,
    Wood,
}

const KINDS: &[(&str, Kind)] = &[
    ("noise", Kind::Noise),
    ("turbulence", Kind::Turbulence),
    ("waves", Kind::Waves),
    ("marble", Kind::Marble),
    ("wood", Kind::Wood),
];

/// Range of the exponent of marble; beyond it, veins are thinner than the finest detail.
const SHARPNESS: Expected =
    Expected { what: "a number above 0 and at most 64", example: "1.0", holds: |x| x > 0.0 && x <= 64.0 };

/// Default ratio of the finest detail to the size.
const FINEST: f64 = 1.0 / 32.0;

/// Textures by name.
pub(super) fn read_textures(tables: &[(Table<'_>, f64)]) -> (Vec<Named<SolidTexture>>, Names, Images) {
    let mut names = Names::new("texture");
    let mut textures = Vec::new();
    let mut images = Images::new();
    for (span, value, unit) in entries(tables) {
        let name = value.name();
        if let Some(table) = as_image(value) {
            images.add(value.context(), name, &span, table);
            continue;
        }
        if names.declare(value.context(), name, &span).is_none() {
            continue;
        }
        let example = format!("write `[textures.{name}]` and below it `type = \"marble\"`");
        let texture = value
            .table(format!("[textures.{name}]"), &example)
            .and_then(|table| read_texture(table, unit))
            .unwrap_or(SolidTexture {
                pattern: Pattern::Noise(Octaves { size: 1.0, finest: 1.0, seed: 0 }),
                low: Rgb::ZERO,
                high: Rgb::ONE,
                to_texture: glam::DAffine3::IDENTITY,
            });
        let location = value.context().location(&span);
        textures.push(Named { name: name.to_string(), location, value: texture });
    }
    (textures, names, images)
}

/// The table of an image.
fn as_image<'a>(value: Value<'a>) -> Option<Table<'a>> {
    if !value.is_table() {
        return None;
    }
    let table = value.table(format!("[textures.{}]", value.name()), "")?;
    let is_image = table.peek("type").is_some_and(|kind| kind.is_text("image"));
    is_image.then_some(table)
}

fn read_texture(mut table: Table<'_>, unit: f64) -> Option<SolidTexture> {
    let kind = table.required("type", "\"marble\"", |value| value.choice(KINDS));
    let size = table.required("size", "0.2", |value| value.number(&POSITIVE));
    let finest = table.optional("finest", |value| value.number(&POSITIVE));
    let seed = table.or("seed", 0, |value| value.integer(0..=u64::from(u32::MAX)));
    let low = table.or("low", Rgb::ZERO, read_colour);
    let high = table.or("high", Rgb::ONE, read_colour);
    let (size, finest) = (size?, finest?.unwrap_or(FINEST * size?));
    let octaves = Octaves { size, finest, seed: u32::try_from(seed?).ok()? };
    let spacing = |table: &mut Table<'_>| table.or("spacing", size, |value| value.number(&POSITIVE));
    let distortion =
        |table: &mut Table<'_>, usual| table.or("distortion", usual, |value| value.number(&NON_NEGATIVE));
    let pattern = match kind? {
        Kind::Noise => Some(Pattern::Noise(octaves)),
        Kind::Turbulence => Some(Pattern::Turbulence(octaves)),
        Kind::Waves => Some(Pattern::Waves(octaves)),
        Kind::Marble => {
            let (spacing, distortion) = (spacing(&mut table), distortion(&mut table, 1.0));
            let sharpness = table.or("sharpness", 1.0, |value| value.number(&SHARPNESS));
            let (spacing, distortion, sharpness) = (spacing?, distortion?, sharpness?);
            Some(Pattern::Marble { octaves, spacing, distortion, sharpness })
        }
        Kind::Wood => {
            let (spacing, distortion) = (spacing(&mut table), distortion(&mut table, 0.3));
            Some(Pattern::Wood { octaves, spacing: spacing?, distortion: distortion? })
        }
    };
    let transform = transform_of(&mut table);
    table.finish();
    // The texture's lengths are in the file's unit.
    let to_texture =
        (in_metres(transform?, unit) * glam::DAffine3::from_scale(glam::DVec3::splat(unit))).inverse();
    Some(SolidTexture { pattern: pattern?, low: low?, high: high?, to_texture })
}

fn read_colour(value: Value<'_>) -> Option<Rgb> {
    value.colour(&FRACTION).map(|colour| colour.as_vec3())
}

/// Reads `texture = "NAME"` and `bump = { texture = "NAME", height = 0.01 }` of a material.
pub(super) fn read_look(
    table: &mut Table<'_>,
    (textures, images): (&Names, &Images),
    unit: f64,
) -> MaterialLook {
    let colour = table.get("texture").and_then(|value| find_solid(value, textures, images));
    let bump = table.get("bump").and_then(|value| {
        let mut table =
            value.table("`bump`", "write for example `bump = { texture = \"NAME\", height = 0.01 }`")?;
        let texture = table.required("texture", "\"NAME\"", |value| find_solid(value, textures, images));
        let height = table.required("height", "0.01", |value| value.number(&POSITIVE));
        table.finish();
        Some((texture?, height? * unit))
    });
    MaterialLook { colour, bump }
}

/// The number of the solid texture that a value names.
fn find_solid(value: Value<'_>, textures: &Names, images: &Images) -> Option<usize> {
    let name = value.string()?;
    if images.has(&name) {
        return value.refuse(
            "a solid texture, and this is an image",
            "an image takes the place of a colour, as in `reflectance = { texture = \"NAME\" }`; bumps by an image are a `normal-map`",
        );
    }
    textures.find(value)
}
