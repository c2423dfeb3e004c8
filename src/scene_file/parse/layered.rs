//! Materials of type `plastic`, `principled` and `thin-glass`, and those of other types where an image, a normal map or an alpha makes them
//! vary: all are layered materials, as those of glTF.

use super::glossy::ROUGHNESS;
use super::images::Images;
use crate::bsdf::{Body, Dielectric, LayeredParameters, Metal};
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::description::{MaterialDescription, MediumDescription, Named};
use crate::scene_file::import::material::combined;
use crate::scene_file::import::models::{glass, plastic, set_roughness, thin_sheet, tinted_metal};
use crate::scene_file::import::paint::{Amount, Paint, Use};
use crate::scene_file::import::pictures::texture_of;
use crate::scene_file::import::surface::Base;
use crate::scene_file::reader::{Expected, FRACTION, NUMBER, Table};
use crate::textures::TextureSlot;
use glam::{DVec3, Vec2, Vec4};
use std::sync::Arc;

const INDEX: Expected = Expected {
    what: "an index of refraction from 1 to 4",
    example: "1.5",
    holds: |x| (1.0..=4.0).contains(&x),
};

/// What cuts and bends a surface, whatever its model.
pub(super) struct Finish {
    normal: Option<(TextureSlot, f32)>,
    alpha: Option<Amount>,
    cutout: Option<f64>,
}

impl Finish {
    /// Reads `normal-map`, `alpha` and `cutout`.
    pub(super) fn read(table: &mut Table<'_>, images: &Images) -> Option<Self> {
        let normal = table.optional("normal-map", |value| images.normals(value));
        let alpha = table.optional("alpha", |value| images.amount(value, &FRACTION, Use::Alpha));
        let cutout = table.optional("cutout", |value| value.number(&FRACTION));
        Some(Self { normal: normal?, alpha: alpha?, cutout: cutout? })
    }

    /// Whether there is nothing of it.
    pub(super) fn is_plain(&self) -> bool {
        self.normal.is_none() && self.alpha.is_none() && self.cutout.is_none()
    }

    /// The material with this finish.
    pub(super) fn on(self, table: &Table<'_>, mut material: LayeredMaterial) -> Option<MaterialDescription> {
        if let Some((slot, scale)) = self.normal {
            material.normal = Some(slot);
            material.normal_scales[0] = scale;
        }
        material.coverage = match (self.cutout, &self.alpha) {
            (Some(threshold), _) => Coverage::Mask(threshold as f32),
            (None, Some(_)) => Coverage::Blend,
            (None, None) => Coverage::Whole,
        };
        match (self.alpha, &material.base) {
            (Some(Amount::Plain(share)), _) => material.alpha = share as f32,
            (Some(Amount::Picture(slot)), None) => material.base = Some(slot),
            (Some(Amount::Picture(slot)), Some(colours)) => match combined(colours, &slot) {
                Some(both) => material.base = Some(both),
                None => {
                    return table.refuse(
                        format!("the alpha of {} lies otherwise than the image of its colour", table.title()),
                        "give both textures the same `repeat`, `offset`, `rotate` and `wrap`",
                    );
                }
            },
            (None, None) if self.cutout.is_some() => {
                return table.refuse(
                    format!("{} has a `cutout` and no image whose alpha cuts it out", table.title()),
                    "add `alpha = { texture = \"NAME\" }`, or an image with alpha as its colour",
                );
            }
            (None, _) => {}
        }
        Some(MaterialDescription::Layered { material: Arc::new(material), media: None })
    }
}

/// A diffuse surface.
pub(super) fn diffuse(table: &Table<'_>, paint: Paint, finish: Finish) -> Option<MaterialDescription> {
    finish.on(table, Base::Diffuse(paint).layered().0)
}

/// A metal of which something varies.
pub(super) fn metal(
    table: &Table<'_>,
    (metal, colour): (Option<Metal>, Option<Paint>),
    slopes: [Amount; 2],
    finish: Finish,
) -> Option<MaterialDescription> {
    let material = match (metal, colour) {
        (_, Some(colour)) => {
            let factors = LayeredParameters { base: colour.factor(), ..LayeredParameters::default() };
            let mut material = LayeredMaterial { factors, base: colour.slot(), ..LayeredMaterial::default() };
            set_roughness(&mut material, slopes);
            material
        }
        (Some(metal), None) => tinted_metal(metal, &Paint::Plain(DVec3::ONE), slopes),
        (None, None) => return None,
    };
    finish.on(table, material)
}

/// An interface between two media (inside and outside), whose roughness varies.
pub(super) fn interface(
    media: &[Named<MediumDescription>],
    [inside, outside]: [usize; 2],
    slope: Amount,
    normal: Option<(TextureSlot, f32)>,
) -> MaterialDescription {
    let indices = [inside, outside].map(|medium| media[medium].value.ior);
    let (mut material, _) = glass(indices, slope, &Paint::Plain(DVec3::ONE)).layered();
    material.factors.body = Body::Interface(Dielectric::new(indices[1], indices[0]));
    material.factors.ior = (indices[0] / indices[1]).max(1.0) as f32;
    if let Some((slot, scale)) = normal {
        material.normal = Some(slot);
        material.normal_scales[0] = scale;
    }
    MaterialDescription::Layered { material: Arc::new(material), media: Some([inside, outside]) }
}

impl Finish {
    /// The normal map of a surface that cannot be cut.
    pub(super) fn only_normal(self, table: &Table<'_>) -> Option<Option<(TextureSlot, f32)>> {
        if self.alpha.is_some() || self.cutout.is_some() {
            return table.refuse(
                format!("{} is the border of a medium, which has no holes", table.title()),
                "leave `alpha` and `cutout` out, or use `thin-glass`",
            );
        }
        Some(self.normal)
    }
}

/// `type = "plastic"`: a diffuse base under facets of a clear dielectric.
pub(super) fn read_plastic(table: &mut Table<'_>, images: &Images) -> Option<MaterialDescription> {
    let colour = table.required("colour", "[0.8, 0.1, 0.1]", |value| images.paint(value));
    let ior = table.or("ior", 1.5, |value| value.number(&INDEX));
    let usual = Amount::Plain(0.1);
    let slope = table.or("roughness", usual, |value| images.amount(value, &ROUGHNESS, Use::Slope));
    let finish = Finish::read(table, images);
    finish?.on(table, plastic(ior?, &colour?, DVec3::ONE, slope?))
}

/// `type = "thin-glass"`: a sheet of glass without thickness, which does not bend light.
pub(super) fn read_thin_glass(table: &mut Table<'_>, images: &Images) -> Option<MaterialDescription> {
    let white = Paint::Plain(DVec3::ONE);
    let colour = table.or("colour", white, |value| images.paint(value));
    let ior = table.or("ior", 1.5, |value| value.number(&INDEX));
    let finish = Finish::read(table, images);
    finish?.on(table, thin_sheet(ior?, DVec3::ONE, &colour?))
}

/// `type = "principled"`: the layers of glTF, with a number or an image for each.
pub(super) fn read_principled(table: &mut Table<'_>, images: &Images) -> Option<MaterialDescription> {
    let paint = |table: &mut Table<'_>, key, usual: f64| {
        table.or(key, Paint::Plain(DVec3::splat(usual)), |value| images.paint(value))
    };
    let share = |table: &mut Table<'_>, key, usual: f64, how| {
        table.or(key, Amount::Plain(usual), |value| images.amount(value, &FRACTION, how))
    };
    let colour = paint(table, "colour", 0.8);
    let metallic = share(table, "metallic", 0.0, Use::Blue);
    let roughness = share(table, "roughness", 0.5, Use::Roughness);
    let specular = share(table, "specular", 1.0, Use::Alpha);
    let specular_colour = paint(table, "specular-colour", 1.0);
    let ior = table.or("ior", 1.5, |value| value.number(&INDEX));
    let transmission = share(table, "transmission", 0.0, Use::Raw);
    let coat = share(table, "coat", 0.0, Use::Raw);
    let coat_roughness = share(table, "coat-roughness", 0.0, Use::Roughness);
    let coat_normal = table.optional("coat-normal-map", |value| images.normals(value));
    let anisotropy = table.or("anisotropy", 0.0, |value| value.number(&FRACTION));
    let turn = table.or("anisotropy-rotation", 0.0, |value| value.number(&NUMBER));
    let finish = Finish::read(table, images);
    let (colour, specular_colour, transmission) = (colour?, specular_colour?, transmission?);
    let (metallic, roughness) = (metallic?, roughness?);
    let is_thin = transmission != Amount::Plain(0.0);
    let ((metallic, roughness), metallic_roughness) = match packed(metallic, roughness) {
        Some(packed) => packed,
        None => {
            return table.refuse(
                format!("the images of `metallic` and `roughness` of {} lie differently", table.title()),
                "give both textures the same `repeat`, `offset`, `rotate` and `wrap`",
            );
        }
    };
    let (specular, specular_map) = factor_of(specular?);
    let (transmission, transmission_map) = factor_of(transmission);
    let (coat, coat_map) = factor_of(coat?);
    let (coat_roughness, coat_roughness_map) = factor_of(coat_roughness?);
    let (coat_normal, coat_scale) = coat_normal?.map_or((None, 1.0), |(slot, scale)| (Some(slot), scale));
    let factors = LayeredParameters {
        base: colour.factor(),
        metallic,
        ior: ior? as f32,
        specular,
        specular_colour: specular_colour.factor(),
        transmission,
        body: if is_thin { Body::Thin } else { Body::Opaque },
        coat,
        ..LayeredParameters::default()
    };
    let material = LayeredMaterial {
        factors,
        roughness,
        coat_roughness,
        anisotropy: [anisotropy? as f32, turn?.to_radians() as f32],
        base: colour.slot(),
        metallic_roughness,
        transmission: transmission_map,
        specular: specular_map,
        specular_colour: specular_colour.slot(),
        coat: coat_map,
        coat_roughness_map,
        coat_normal,
        normal_scales: [1.0, coat_scale],
        ..LayeredMaterial::default()
    };
    finish?.on(table, material)
}

/// A factor, and the image that it multiplies.
fn factor_of(amount: Amount) -> (f32, Option<TextureSlot>) {
    match amount {
        Amount::Plain(value) => (value as f32, None),
        Amount::Picture(slot) => (1.0, Some(slot)),
    }
}

/// Factors of metallic and roughness, and the image of both: roughness in green, metallic in blue. `None` where two images lie
/// differently, or have too many texels.
fn packed(metallic: Amount, roughness: Amount) -> Option<((f32, f32), Option<TextureSlot>)> {
    /// Images with more texels are not combined.
    const MOST: u64 = 1 << 26;
    let (of_metal, metal_map) = factor_of(metallic);
    let (of_slope, slope_map) = factor_of(roughness);
    let (metal, slope) = match (metal_map, slope_map) {
        (None, None) => return Some(((of_metal, of_slope), None)),
        // The other channel of each is one.
        (Some(map), None) | (None, Some(map)) => return Some(((of_metal, of_slope), Some(map))),
        (Some(metal), Some(slope)) => (metal, slope),
    };
    let is_same = metal.transform == slope.transform && metal.sampler == slope.sampler;
    let [a, b] = [metal.texture.size(), slope.texture.size()];
    let [width, height] = [a[0].max(b[0]), a[1].max(b[1])];
    if !is_same || u64::from(width) * u64::from(height) > MOST {
        return None;
    }
    let sampler = crate::textures::Sampler { nearest: true, finest: true, ..metal.sampler };
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels: Vec<Vec4> = places
        .map(|(x, y)| {
            let at = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            let value = |slot: &TextureSlot| slot.texture.at(at, 0.0, &sampler);
            Vec4::new(1.0, value(&slope).y, value(&metal).z, 1.0)
        })
        .collect();
    let texture = Arc::new(texture_of(width, height, &pixels));
    Some(((of_metal, of_slope), Some(TextureSlot { texture, ..metal })))
}
