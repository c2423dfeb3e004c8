//! `[materials.NAME]`, and the ranges that materials and media share.

use super::entries;
use super::glossy::{ROUGHNESS, read_conductor, read_reflectance, read_schlick, read_ward};
use super::images::Images;
use super::index::{Index, read_index};
use super::layered::{Finish, diffuse, interface, read_plastic, read_principled, read_thin_glass};
use super::names::Names;
use super::textures::read_look;
use crate::bsdf::Bsdf;
use crate::math::Rgb;
use crate::scene_file::description::*;
use crate::scene_file::import::paint::{Amount, Paint, Use};
use crate::scene_file::reader::{Context, NON_NEGATIVE, Table};
use glam::DVec3;

/// Index of `air` in [`SceneDescription::media`].
const AIR: usize = 0;

#[derive(Clone, Copy)]
enum Kind {
    Lambert,
    Mirror,
    Dielectric,
    Schlick,
    Ward,
    Conductor,
    Plastic,
    Principled,
    ThinGlass,
}

/// Absorption coefficient, converted from the file's unit to 1/m.
pub(super) fn read_absorption(table: &mut Table<'_>, unit: f64) -> Option<DVec3> {
    let value = table.or("absorption", DVec3::ZERO, |value| value.colour(&NON_NEGATIVE))?;
    Some(value / unit)
}

/// Materials by name. Unnamed media, from `ior = ...` in a dielectric, are added to `media`.
pub(super) fn read_materials(
    tables: &[(Table<'_>, f64)],
    media_names: &Names,
    media: &mut Vec<Named<MediumDescription>>,
    (textures, images): (&Names, &Images),
) -> (Vec<Named<MaterialDescription>>, Vec<MaterialLook>, Names) {
    let mut names = Names::new("material");
    let mut materials = Vec::new();
    let mut looks = Vec::new();
    for (span, value, unit) in entries(tables) {
        let name = value.name();
        if names.declare(value.context(), name, &span).is_none() {
            continue;
        }
        let example = format!("write `[materials.{name}]` and below it `type = \"lambert\"`");
        let context = value.context();
        let location = context.location(&span);
        let material = value.table(format!("[materials.{name}]"), &example).and_then(|mut table| {
            looks.push(read_look(&mut table, (textures, images), unit));
            read_material(table, (name, &location), (media_names, media), images, unit)
        });
        let value = material.unwrap_or(BLACK);
        // An entry that is not a table is refused, but the list of looks stays aligned with the materials.
        looks.resize(materials.len() + 1, MaterialLook::default());
        let kind = match value {
            MaterialDescription::Dielectric { .. } => Some("a dielectric"),
            MaterialDescription::Glossy { bsdf: Bsdf::Conductor(_), .. } => Some("a metal"),
            MaterialDescription::Layered { .. } => Some("of layers"),
            _ => None,
        };
        if let Some(kind) = kind.filter(|_| looks[materials.len()].colour.is_some()) {
            let message =
                format!("[materials.{name}] is {kind}, which has no reflectance that a solid texture varies");
            context.error(&span, message, "leave `texture` out; `bump` may stay");
        }
        materials.push(Named { name: name.to_string(), location, value });
    }
    (materials, looks, names)
}

/// A material that absorbs all light.
const BLACK: MaterialDescription = MaterialDescription::Lambert { reflectance: Rgb::ZERO, two_sided: true };

/// Material of an emitting shape for which the file gives none.
pub(super) fn implied_material(context: &Context<'_>) -> Named<MaterialDescription> {
    Named { name: "black (implied)".to_string(), location: context.source.whole(), value: BLACK }
}

fn read_material(
    mut table: Table<'_>,
    (name, location): (&str, &Location),
    (media_names, media): (&Names, &mut Vec<Named<MediumDescription>>),
    images: &Images,
    unit: f64,
) -> Option<MaterialDescription> {
    let kinds = [
        ("lambert", Kind::Lambert),
        ("mirror", Kind::Mirror),
        ("dielectric", Kind::Dielectric),
        ("schlick", Kind::Schlick),
        ("ward", Kind::Ward),
        ("conductor", Kind::Conductor),
        ("plastic", Kind::Plastic),
        ("principled", Kind::Principled),
        ("thin-glass", Kind::ThinGlass),
    ];
    let material = match table.required("type", "\"lambert\"", |value| value.choice(&kinds))? {
        Kind::Lambert => {
            let reflectance = table.required("reflectance", "[0.8, 0.8, 0.8]", |value| images.paint(value));
            let two_sided = table.or("two-sided", true, |value| value.boolean());
            let finish = Finish::read(&mut table, images);
            match (reflectance, two_sided, finish) {
                (Some(Paint::Plain(colour)), Some(two_sided), Some(finish)) if finish.is_plain() => {
                    Some(MaterialDescription::Lambert { reflectance: colour.as_vec3(), two_sided })
                }
                (Some(_), Some(false), Some(_)) => one_sided(&table),
                (Some(paint), Some(true), Some(finish)) => diffuse(&table, paint, finish),
                _ => None,
            }
        }
        Kind::Mirror => {
            let reflectance = table.or("reflectance", Rgb::ONE, read_reflectance);
            let two_sided = table.or("two-sided", true, |value| value.boolean());
            reflectance
                .zip(two_sided)
                .map(|(reflectance, two_sided)| MaterialDescription::Mirror { reflectance, two_sided })
        }
        Kind::Dielectric => {
            let inside = read_inside(&mut table, media_names, unit);
            let outside = table.or("outside", AIR, |value| media_names.find(value));
            let smooth = Amount::Plain(0.0);
            let roughness =
                table.or("roughness", smooth, |value| images.amount(value, &ROUGHNESS, Use::Slope));
            let normal = Finish::read(&mut table, images).and_then(|finish| finish.only_normal(&table));
            inside.zip(outside.zip(roughness.zip(normal))).map(|(inside, (outside, (roughness, normal)))| {
                let inside = match inside {
                    Inside::Named(index) => index,
                    Inside::Anonymous(Index { ior, dispersion }, absorption) => {
                        let value =
                            MediumDescription { ior, dispersion, absorption, priority: 0, volume: None };
                        let name = format!("inside of {name}");
                        media.push(Named { name, location: location.clone(), value });
                        media.len() - 1
                    }
                };
                match (roughness, normal) {
                    (Amount::Plain(roughness), None) => {
                        MaterialDescription::Dielectric { inside, outside, roughness }
                    }
                    (roughness, normal) => interface(media, [inside, outside], roughness, normal),
                }
            })
        }
        Kind::Schlick => read_schlick(&mut table),
        Kind::Ward => read_ward(&mut table),
        Kind::Conductor => read_conductor(&mut table, images),
        Kind::Plastic => read_plastic(&mut table, images),
        Kind::Principled => read_principled(&mut table, images),
        Kind::ThinGlass => read_thin_glass(&mut table, images),
    };
    table.finish();
    material
}

/// Refuses a layered material whose back is to be black.
pub(super) fn one_sided(table: &Table<'_>) -> Option<MaterialDescription> {
    table.refuse(
        format!("{} has an image, a normal map or an alpha, and is to be black from behind", table.title()),
        "leave `two-sided` out",
    )
}

/// The medium behind a dielectric surface.
enum Inside {
    /// Index into [`SceneDescription::media`].
    Named(usize),
    /// Defined at the material itself: index of refraction and absorption.
    Anonymous(Index, DVec3),
}

/// Reads `inside = "NAME"`, or the short form `ior = ...` with an optional `absorption = ...`.
fn read_inside(table: &mut Table<'_>, media_names: &Names, unit: f64) -> Option<Inside> {
    let inside = table.get("inside");
    let ior = table.get("ior");
    let absorption = table.get("absorption");
    match (inside, ior, absorption) {
        (Some(_), Some(extra), _) | (Some(_), None, Some(extra)) => {
            let message = format!("{} has both `inside` and `{}`", table.title(), extra.name());
            let remedy = "the medium's own table says what it is made of: leave one of them out";
            table.context().error(&extra.span(), message, remedy);
            None
        }
        (Some(inside), None, None) => media_names.find(inside).map(Inside::Named),
        (None, Some(ior), _) => {
            let absorption = read_absorption(table, unit);
            let ior = read_index(ior);
            Some(Inside::Anonymous(ior?, absorption?))
        }
        (None, None, _) => table.refuse(
            format!("{} does not say what is inside", table.title()),
            "add `ior = 1.5`, or `inside = \"NAME\"` with a `[media.NAME]`",
        ),
    }
}
