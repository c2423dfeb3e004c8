//! Layered materials for models of other renderers.

use super::facets::{Distribution, diffuse_factor};
use super::paint::{Amount, Paint};
use super::surface::{Base, normal_reflectance, stretched};
use crate::bsdf::{Body, LayeredParameters, Metal};
use crate::math::Rgb;
use crate::scene::LayeredMaterial;
use glam::DVec3;

/// Glass between media of these indices, inside and outside; `passed` is the colour of what passes.
pub(crate) fn glass(indices: [f64; 2], slope: Amount, passed: &Paint) -> Base {
    if let (Amount::Plain(slope), true) = (&slope, *passed == Paint::Plain(DVec3::ONE)) {
        return Base::Glass { indices, slope: *slope };
    }
    let (mut material, _) = Base::Glass { indices, slope: slope.plain().unwrap_or(1.0) }.layered();
    material.factors.base = passed.factor();
    material.base = passed.slot();
    if let Amount::Picture(slot) = slope {
        material.metallic_roughness = Some(slot);
    }
    Base::Border(material, indices)
}

/// A sheet of glass without thickness, with colours of what it reflects and passes.
pub(crate) fn thin_sheet(ior: f64, reflected: DVec3, passed: &Paint) -> LayeredMaterial {
    let ior = if ior < 1.0 { 1.0 / ior } else { ior };
    let single = normal_reflectance(ior);
    // Light is reflected back and forth between both sides.
    let whole = 2.0 / (1.0 + single);
    let factors = LayeredParameters {
        base: passed.factor(),
        metallic: 0.0,
        ior: ior as f32,
        specular_colour: (reflected * whole).as_vec3(),
        transmission: 1.0,
        body: Body::Thin,
        ..LayeredParameters::default()
    };
    LayeredMaterial { factors, roughness: 0.0, base: passed.slot(), ..LayeredMaterial::default() }
}

/// A metal whose reflectance is multiplied by a colour at every angle, or whose roughness varies.
pub(crate) fn tinted_metal(metal: Metal, tint: &Paint, slopes: [Amount; 2]) -> LayeredMaterial {
    // Facets of a dielectric without a base: their reflectance at every angle can be scaled.
    let factors = LayeredParameters { base: Rgb::ZERO, metallic: 0.0, ..LayeredParameters::default() };
    let whole = tint.mean().max_element().clamp(1e-6, 1.0);
    let colour = metal.reflectance(1.0).as_dvec3() * tint.factor().as_dvec3() / whole;
    let colour = colour / normal_reflectance(f64::from(factors.ior));
    let mut material = LayeredMaterial {
        factors: LayeredParameters { specular: whole as f32, specular_colour: colour.as_vec3(), ..factors },
        specular_colour: tint.slot(),
        ..LayeredMaterial::default()
    };
    set_roughness(&mut material, slopes);
    material
}

/// The colour of a diffuse base whose light its coat reflects back again and again: it is coloured each time.
pub(crate) fn under_a_coat(colour: DVec3, ior: f64) -> DVec3 {
    let back = internal_reflectance(ior);
    colour.map(|c| c * (1.0 - back) / (1.0 - c * back))
}

/// The factor on the diffuse base under facets of a dielectric with this slope ([`super::facets`]).
pub(crate) fn base_factor(distribution: Distribution, slope: &Amount, ior: f64) -> f64 {
    diffuse_factor(distribution, mean_slope(slope), ior)
}

/// The slope of facets; where it varies, the square of the mean root.
pub(crate) fn mean_slope(slope: &Amount) -> f64 {
    match slope {
        Amount::Plain(slope) => *slope,
        // Stored as square roots.
        Amount::Picture(slot) => f64::from(slot.texture.mean().y).powi(2),
    }
}

/// Facets of a dielectric over a diffuse base.
pub(crate) fn plastic(ior: f64, diffuse: &Paint, specular: DVec3, slope: Amount) -> LayeredMaterial {
    // Colours above one make facets that reflect more than their index says.
    let whole = specular.max_element().clamp(1e-6, 1.0);
    let factors = LayeredParameters {
        base: diffuse.factor(),
        metallic: 0.0,
        ior: ior as f32,
        specular: whole as f32,
        specular_colour: (specular / whole).as_vec3(),
        ..LayeredParameters::default()
    };
    let coloured = matches!(diffuse, Paint::Vertices(_));
    let mut material =
        LayeredMaterial { factors, coloured, base: diffuse.slot(), ..LayeredMaterial::default() };
    set_roughness(&mut material, [slope.clone(), slope]);
    material
}

/// Sets the roughness of layers from the slopes of facets.
pub(crate) fn set_roughness(material: &mut LayeredMaterial, [along, across]: [Amount; 2]) {
    match (along.plain(), across.plain(), along) {
        (Some(along), Some(across), _) => {
            (material.roughness, material.anisotropy) = stretched([along, across]);
        }
        (_, _, Amount::Picture(slot)) => {
            material.roughness = 1.0;
            material.metallic_roughness = Some(slot);
        }
        (_, Some(across), Amount::Plain(_)) => material.roughness = across.sqrt() as f32,
        (_, None, Amount::Plain(along)) => material.roughness = along.sqrt() as f32,
    }
}

/// The share of diffuse light inside a medium of this index that its boundary reflects. It follows by reciprocity from Fresnel's
/// formula for light from outside.
pub(crate) fn internal_reflectance(ior: f64) -> f64 {
    const STEPS: usize = 512;
    let mean: f64 = (0..STEPS)
        .map(|i| {
            // Equal steps of the squared sine give cosine-weighted directions.
            let sine_squared = (i as f64 + 0.5) / STEPS as f64;
            f64::from(crate::bsdf::fresnel_dielectric((1.0 - sine_squared).sqrt() as f32, ior as f32))
        })
        .sum::<f64>()
        / STEPS as f64;
    1.0 - (1.0 - mean) / (ior * ior)
}
