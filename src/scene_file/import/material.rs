//! Converts surfaces to materials of a scene description: the simplest model that suffices, and the vertex data that a shape must
//! provide for it.

use super::Building;
use super::paint::{Amount, Paint};
use super::pictures::texture_of;
use super::report::Subject;
use super::surface::{Base, Surface};
use crate::bsdf::{Bsdf, Conductor, Dielectric};
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::description::{MaterialDescription, MediumDescription, Named, VolumeDescription};
use crate::textures::TextureSlot;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Relative difference below which two indices belong to the same medium; an index this close to 1 is air.
const SAME_INDEX: f64 = 1e-3;

/// Properties of a medium, besides the index.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Filling {
    /// Absorption coefficient, 1/m; zero beside a volume.
    pub absorption: DVec3,
    /// What scatters, absorbs and emits.
    pub volume: Option<VolumeDescription>,
}

/// A number for each filling, equal for equal ones.
pub(crate) type FillingKey = [u64; 7];

impl Filling {
    /// The number of this filling.
    pub(crate) fn key(&self) -> FillingKey {
        let [a, b, c] = self.absorption.to_array().map(f64::to_bits);
        let Some(VolumeDescription { coefficients, phase, .. }) = &self.volume else {
            return [a, b, c, 0, 0, 0, 0];
        };
        let bits = |a: f32, b: f32| u64::from(a.to_bits()) << 32 | u64::from(b.to_bits());
        let (absorption, scattering) = (coefficients.absorption(), coefficients.scattering());
        // Two values tell the phase functions apart that files name.
        let [ahead, aside] = [Vec3::NEG_X, Vec3::Y].map(|wi| phase.eval(Vec3::X, wi));
        [
            a,
            b,
            c,
            bits(absorption.x, absorption.y),
            bits(absorption.z, scattering.x),
            bits(scattering.y, scattering.z),
            bits(ahead, aside),
        ]
    }
}

/// What determines the material of a shape.
#[derive(Clone)]
pub(crate) struct Look<'a> {
    /// The object that messages are about.
    pub bsdf: &'a dyn Subject,
    pub surface: &'a Surface,
    /// The medium inside of the shape, and that around it.
    pub fillings: [Filling; 2],
    /// The picture that scales the emission.
    pub glow: Option<TextureSlot>,
}

/// The vertex data that a material requires of its shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Needs {
    /// Any vertex data.
    pub data: bool,
    /// Texture coordinates.
    pub coordinates: bool,
    /// Tangents, which orient normal maps and anisotropy.
    pub tangents: bool,
    /// Vertex colours.
    pub colours: bool,
}

impl Needs {
    /// The same for a shape with bumps, which become a normal map.
    pub(crate) fn with_bumps(self, has_bumps: bool) -> Self {
        Self { coordinates: self.coordinates || has_bumps, tangents: self.tangents || has_bumps, ..self }
    }

    pub(crate) fn any(self) -> bool {
        self.data || self.coordinates || self.tangents || self.colours
    }
}

/// A material that was added to the description.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Finished {
    pub number: usize,
    pub needs: Needs,
}

impl Building<'_> {
    /// The number of a medium with this index and absorption, which is added if it is new.
    fn medium(&mut self, ior: f64, filling: Filling, object: &dyn Subject) -> usize {
        let ior = ior.max(1.0);
        let same = |medium: &Named<MediumDescription>| {
            (medium.value.ior / ior - 1.0).abs() < SAME_INDEX
                && medium.value.absorption == filling.absorption
                && medium.value.volume == filling.volume
        };
        if let Some(known) = self.scene.media.iter().position(same) {
            return known;
        }
        let name = if filling == Filling::default() {
            format!("medium of index {ior:.4}")
        } else {
            format!("inside of {}", object.name())
        };
        self.scene.media.push(Named {
            name,
            location: object.place().location.clone(),
            value: MediumDescription {
                ior,
                dispersion: None,
                absorption: filling.absorption,
                priority: 0,
                volume: filling.volume,
            },
        });
        self.scene.media.len() - 1
    }

    /// Media at an interface with these indices: the side away from the normal, then the side of the normal.
    fn border(&mut self, [inside, outside]: [f64; 2], look: &Look<'_>) -> [usize; 2] {
        let is_air = |index: f64| (index - 1.0).abs() < SAME_INDEX;
        let (inside, outside) = match inside / outside {
            // An index below that of air is a bubble; the medium around it gets the index.
            ratio if is_air(outside) && ratio < 1.0 => (1.0, 1.0 / ratio),
            ratio if is_air(outside) => (ratio, 1.0),
            _ if inside < 1.0 => (1.0, outside / inside),
            _ => (inside, outside),
        };
        let [within, around] = look.fillings.clone();
        [self.medium(inside, within, look.bsdf), self.medium(outside, around, look.bsdf)]
    }

    /// Adds the material of a shape. `extra_normal` is a normal map for a surface that has none.
    pub(crate) fn material(&mut self, look: &Look<'_>, extra_normal: Option<TextureSlot>) -> Finished {
        let value = self.described(look, extra_normal);
        let needs = needs_of(&value);
        let number = self.scene.materials.len();
        let location = look.bsdf.place().location.clone();
        self.scene.materials.push(Named { name: look.bsdf.name(), location, value });
        Finished { number, needs }
    }

    fn described(&mut self, look: &Look<'_>, extra_normal: Option<TextureSlot>) -> MaterialDescription {
        let Surface { base, two_sided, opacity, normal, .. } = look.surface.clone();
        let (bsdf, glow) = (look.bsdf, look.glow.clone());
        let normal = normal.or(extra_normal);
        let is_bare = opacity.is_none() && normal.is_none() && glow.is_none();
        match &base {
            Base::Diffuse(Paint::Plain(colour)) if is_bare => {
                return MaterialDescription::Lambert { reflectance: colour.as_vec3(), two_sided };
            }
            Base::Metal { metal, slopes } if is_bare && slopes[0] == slopes[1] => {
                let slopes = slopes.map(|slope| slope as f32);
                let bsdf = Bsdf::Conductor(Conductor::new(*metal, slopes));
                return MaterialDescription::Glossy { bsdf, two_sided, tangent: None };
            }
            Base::Glass { indices, slope } if is_bare => {
                let [inside, outside] = self.border(*indices, look);
                return MaterialDescription::Dielectric { inside, outside, roughness: *slope };
            }
            Base::Null => {
                let [inside, outside] = self.border([1.0; 2], look);
                return MaterialDescription::Dielectric { inside, outside, roughness: 0.0 };
            }
            Base::Metal { .. } => self.report.note(
                bsdf,
                "reflects by Schlick's approximation of the formula for metals, as something of it varies over the surface",
            ),
            _ => {}
        }
        let is_border = matches!(base, Base::Border(..) | Base::Glass { .. });
        let (mut material, indices) = base.layered();
        if !two_sided && !is_border && material.factors.body == crate::bsdf::Body::Opaque {
            self.report.note(bsdf, "is seen from behind as well, where the file has it black");
        }
        material.normal = normal;
        material.emission = glow;
        let media = indices.map(|indices| {
            let media = self.border(indices, look);
            let ior = |medium: usize| self.scene.media[medium].value.ior;
            let interface = Dielectric::new(ior(media[1]), ior(media[0]));
            material.factors.body = crate::bsdf::Body::Interface(interface);
            material.factors.ior = (ior(media[0]) / ior(media[1])).max(1.0) as f32;
            media
        });
        if let Some(opacity) = opacity {
            if media.is_some() {
                self.report
                    .warn(bsdf, "the mask is left out: light crosses the border of a medium everywhere");
            } else {
                self.cut(bsdf, &mut material, opacity);
            }
        }
        MaterialDescription::Layered { material: Arc::new(material), media }
    }

    /// Applies a mask: a share of the rays passes through the surface.
    fn cut(&mut self, bsdf: &dyn Subject, material: &mut LayeredMaterial, opacity: Amount) {
        material.coverage = Coverage::Blend;
        match (opacity, &material.base) {
            (Amount::Plain(share), None) => material.alpha = share.clamp(0.0, 1.0) as f32,
            // The alpha of its own picture would count as well, which the file does not mean.
            (Amount::Plain(share), Some(slot)) => {
                material.alpha = share.clamp(0.0, 1.0) as f32;
                let mean = slot.texture.mean().w;
                if mean < 1.0 {
                    self.report.note(bsdf, "the alpha of its picture counts beside the mask");
                }
            }
            (Amount::Picture(slot), None) => material.base = Some(slot),
            (Amount::Picture(slot), Some(colours)) => match combined(colours, &slot) {
                Some(both) => material.base = Some(both),
                None => {
                    material.alpha = slot.texture.mean().w;
                    self.report.warn(
                        bsdf,
                        "the mask lies otherwise than the picture of the colours: its mean counts",
                    );
                }
            },
        }
    }
}

/// The colours of one picture with the alpha of another that has the same mapping, in the larger of the two sizes.
pub(crate) fn combined(colours: &TextureSlot, mask: &TextureSlot) -> Option<TextureSlot> {
    /// Pictures with more texels are not combined.
    const MOST: u64 = 1 << 26;
    let is_same = colours.transform == mask.transform && colours.sampler.wrap == mask.sampler.wrap;
    let [a, b] = [colours.texture.size(), mask.texture.size()];
    let [width, height] = [a[0].max(b[0]), a[1].max(b[1])];
    if !is_same || u64::from(width) * u64::from(height) > MOST {
        return None;
    }
    let sampler = crate::textures::Sampler { nearest: true, finest: true, ..colours.sampler };
    let at = |slot: &TextureSlot, x: u32, y: u32| {
        let place = glam::Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        slot.texture.at(place, 0.0, &sampler)
    };
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels: Vec<_> = places.map(|(x, y)| at(colours, x, y).truncate().extend(at(mask, x, y).w)).collect();
    let texture = Arc::new(texture_of(width, height, &pixels));
    Some(TextureSlot { texture, ..colours.clone() })
}

/// The vertex data that a material requires.
pub(crate) fn needs_of(material: &MaterialDescription) -> Needs {
    let MaterialDescription::Layered { material, .. } = material else { return Needs::default() };
    let is_stretched = material.anisotropy[0] > 0.0;
    Needs {
        data: material.coverage != Coverage::Whole,
        coordinates: material.slots().next().is_some() || is_stretched,
        tangents: material.normal.is_some() || is_stretched,
        colours: material.coloured,
    }
}
