//! Materials of type `schlick`, `ward` and `conductor`.

use super::images::Images;
use super::layered::{self, Finish};
use super::materials::one_sided;
use crate::bsdf::{Bsdf, Conductor, Form, METALS, Metal, Schlick, Ward};
use crate::math::Rgb;
use crate::scene::Tangent;
use crate::scene_file::description::MaterialDescription;
use crate::scene_file::import::paint::{Amount, Paint, Use};
use crate::scene_file::reader::{Expected, FRACTION, NON_NEGATIVE, NUMBER, Table, Value};
use toml::de::DeValue;

/// Range of the slope of microfacets, from smooth.
pub(super) const ROUGHNESS: Expected =
    Expected { what: "a roughness from 0 to 1", example: "0.1", holds: |x| (0.0..=1.0).contains(&x) };

/// Range of slopes of a Gaussian lobe; a mirror is a separate material.
const POSITIVE_ROUGHNESS: Expected = Expected {
    what: "a roughness from 0.0001 to 1 (for less, use `mirror`)",
    example: "0.1",
    holds: |x| (1e-4..=1.0).contains(&x),
};

/// Range of isotropy: from grooves in one direction to none.
const ISOTROPY: Expected = Expected {
    what: "an isotropy from 0.001 (grooves along the tangent) to 1 (isotropic)",
    example: "0.2",
    holds: |x| (1e-3..=1.0).contains(&x),
};

/// Real part of a metal's index of refraction.
const ETA: Expected =
    Expected { what: "a number above 0", example: "[0.2, 0.9, 1.1]", holds: |x| x > 0.0 && x <= 1e4 };

const FORMS: &[(&str, Form)] = &[("bounded", Form::Bounded), ("printed", Form::Printed)];

/// A reflectance for each channel.
pub(super) fn read_reflectance(value: Value<'_>) -> Option<Rgb> {
    value.colour(&FRACTION).map(|colour| colour.as_vec3())
}

/// One slope for all directions, or a list of two: along the tangent and across it.
fn read_roughness(value: Value<'_>, range: &Expected) -> Option<[f32; 2]> {
    if !matches!(value.get_ref(), DeValue::Array(_)) {
        return value.number(range).map(|alpha| [alpha as f32; 2]);
    }
    let items =
        value.list("a roughness, or a list of two: along the tangent and across it", "[0.3, 0.05]")?;
    let numbers: Vec<Option<f64>> = items.map(|item| item.number(range)).collect();
    match numbers[..] {
        [along, across] => Some([along? as f32, across? as f32]),
        _ => value.refuse("two numbers", "write `roughness = [0.3, 0.05]`: along the tangent and across it"),
    }
}

/// Reads the keys that all glossy materials share.
fn finish(table: &mut Table<'_>, bsdf: Option<Bsdf>) -> Option<MaterialDescription> {
    let two_sided = table.or("two-sided", true, |value| value.boolean());
    let along = table.get("tangent");
    let around = table.get("tangent-around");
    let direction = |value: Value<'_>| {
        let vector = value.vector(&NUMBER)?;
        match crate::math::unit_f64(vector) {
            Some(unit) => Some(unit.as_vec3()),
            None => value.refuse("a direction", "give it a length that is not zero"),
        }
    };
    let tangent = match (along, around) {
        (Some(_), Some(around)) => {
            let message = format!("{} has both `tangent` and `tangent-around`", table.title());
            table.context().error(&around.span(), message, "leave one of them out");
            None
        }
        (Some(along), None) => direction(along).map(|v| Some(Tangent::Along(v))),
        (None, Some(around)) => direction(around).map(|v| Some(Tangent::Around(v))),
        (None, None) => Some(None),
    };
    let (bsdf, two_sided, tangent) = (bsdf?, two_sided?, tangent?);
    if bsdf.is_anisotropic() && tangent.is_none() {
        return table.refuse(
            format!("{} differs by direction and does not say along which", table.title()),
            "add `tangent = [1.0, 0.0, 0.0]`, or `tangent-around = [0.0, 1.0, 0.0]` for something turned on a lathe",
        );
    }
    // An isotropic model needs no tangent, so none is projected at hits.
    let tangent = tangent.filter(|_| bsdf.is_anisotropic());
    Some(MaterialDescription::Glossy { bsdf, two_sided, tangent })
}

pub(super) fn read_schlick(table: &mut Table<'_>) -> Option<MaterialDescription> {
    let colour = table.required("colour", "[0.8, 0.6, 0.3]", read_reflectance);
    let roughness = table.required("roughness", "0.1", |value| value.number(&ROUGHNESS));
    let isotropy = table.or("isotropy", 1.0, |value| value.number(&ISOTROPY));
    let form = table.or("form", Form::Bounded, |value| value.choice(FORMS));
    let model =
        colour.zip(roughness).zip(isotropy.zip(form)).map(|((colour, roughness), (isotropy, form))| {
            Bsdf::Schlick(Schlick::new(colour, roughness as f32, isotropy as f32, form))
        });
    finish(table, model)
}

pub(super) fn read_ward(table: &mut Table<'_>) -> Option<MaterialDescription> {
    let diffuse = table.or("diffuse", Rgb::ZERO, read_reflectance);
    let specular = table.required("specular", "[0.3, 0.3, 0.3]", read_reflectance);
    let roughness = table.required("roughness", "0.1", |value| read_roughness(value, &POSITIVE_ROUGHNESS));
    let form = table.or("form", Form::Bounded, |value| value.choice(FORMS));
    let model = diffuse.zip(specular).zip(roughness.zip(form));
    let model = model.and_then(|((diffuse, specular), (roughness, form))| {
        if (diffuse + specular).max_element() > 1.0 + 1e-6 {
            return table.refuse(
                format!(
                    "{} reflects more than it receives: `diffuse` and `specular` exceed 1",
                    table.title()
                ),
                "make their sum at most 1 in each channel",
            );
        }
        Some(Bsdf::Ward(Ward::new(diffuse, specular, roughness, form)))
    });
    finish(table, model)
}

pub(super) fn read_conductor(table: &mut Table<'_>, images: &Images) -> Option<MaterialDescription> {
    let metal = read_metal(table, images);
    let look = Finish::read(table, images);
    let varying = table.peek("roughness").filter(|value| value.is_table());
    if let Some(value) = varying {
        table.get("roughness");
        let slope = images.amount(value, &ROUGHNESS, Use::Slope);
        return layered_metal(table, metal, slope.map(|slope| [slope.clone(), slope]), look);
    }
    let roughness = table.or("roughness", [0.0; 2], |value| read_roughness(value, &ROUGHNESS));
    match (metal, look) {
        (Some((Some(metal), None)), Some(look)) if look.is_plain() => {
            let model = roughness.map(|roughness| Bsdf::Conductor(Conductor::new(metal, roughness)));
            finish(table, model)
        }
        (metal, look) => {
            let slopes = roughness.map(|slopes| slopes.map(|slope| Amount::Plain(slope.into())));
            layered_metal(table, metal, slopes, look)
        }
    }
}

/// A metal, or its colour where that is an image.
type MetalLook = (Option<Metal>, Option<Paint>);

/// A metal that an image, a normal map or an alpha makes vary.
fn layered_metal(
    table: &mut Table<'_>,
    metal: Option<MetalLook>,
    slopes: Option<[Amount; 2]>,
    look: Option<Finish>,
) -> Option<MaterialDescription> {
    let two_sided = table.or("two-sided", true, |value| value.boolean());
    let (metal, slopes, look, two_sided) = (metal?, slopes?, look?, two_sided?);
    if !two_sided {
        return one_sided(table);
    }
    layered::metal(table, metal, slopes, look)
}

/// `metal = "gold"`, `eta` and `k`, or `colour`.
fn read_metal(table: &mut Table<'_>, images: &Images) -> Option<MetalLook> {
    let name = table.get("metal");
    let (eta, k) = (table.get("eta"), table.get("k"));
    let colour = table.get("colour");
    match (name, eta, k, colour) {
        (Some(name), None, None, None) => name.choice(METALS).map(|metal| (Some(metal), None)),
        (None, Some(eta), Some(k), None) => {
            let (eta, k) = (eta.numbers(&ETA), k.numbers(&NON_NEGATIVE));
            Some((Some(Metal::Index { eta: eta?.as_vec3(), k: k?.as_vec3() }), None))
        }
        (None, None, None, Some(colour)) => images.paint(colour).map(|paint| match paint {
            Paint::Plain(colour) => (Some(Metal::Colour(colour.as_vec3())), None),
            varying => (None, Some(varying)),
        }),
        _ => table.refuse(
            format!("{} must say what metal it is in one way", table.title()),
            "write `metal = \"gold\"`, or `eta` and `k`, or `colour` alone",
        ),
    }
}
