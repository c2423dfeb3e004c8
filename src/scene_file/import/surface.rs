//! Surfaces of other renderers as the nearest models of this one.

use super::paint::{Amount, Paint};
use crate::bsdf::{LayeredParameters, Metal};
use crate::scene::LayeredMaterial;
use crate::textures::TextureSlot;

/// The scattering model.
#[derive(Clone, Debug)]
pub(crate) enum Base {
    Diffuse(Paint),
    /// Layers of facets over a base, not at an interface between media.
    Layered(LayeredMaterial),
    /// The same at an interface between media with these indices, inside and outside.
    Border(LayeredMaterial, [f64; 2]),
    /// A metal, with the slopes of its facets along the surface and across.
    Metal {
        metal: Metal,
        slopes: [f64; 2],
    },
    Glass {
        indices: [f64; 2],
        slope: f64,
    },
    /// No surface: light passes.
    Null,
}

/// A scattering model with modifiers for the whole surface.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    pub base: Base,
    /// Whether the back side is like the front.
    pub two_sided: bool,
    /// Coverage: the share of the surface that is present.
    pub opacity: Option<Amount>,
    pub normal: Option<TextureSlot>,
    /// Bump map, with the height in lengths of the scene for a picture value of one.
    pub bump: Option<(TextureSlot, f64)>,
}

impl From<Base> for Surface {
    fn from(base: Base) -> Self {
        Self { base, two_sided: false, opacity: None, normal: None, bump: None }
    }
}

/// Layers without any reflection from facets.
fn matt() -> LayeredParameters {
    LayeredParameters { metallic: 0.0, specular: 0.0, ..LayeredParameters::default() }
}

/// The square of `(ior - 1) / (ior + 1)`.
pub(crate) fn normal_reflectance(ior: f64) -> f64 {
    ((ior - 1.0) / (ior + 1.0)).powi(2)
}

impl Base {
    /// The surface as a layered material, which alone supports textures, cut-outs and normal maps. At an interface, also yields
    /// the indices of the media.
    pub(crate) fn layered(self) -> (LayeredMaterial, Option<[f64; 2]>) {
        match self {
            Self::Diffuse(paint) => {
                let factors = LayeredParameters { base: paint.factor(), ..matt() };
                let coloured = matches!(paint, Paint::Vertices(_));
                (
                    LayeredMaterial { factors, coloured, base: paint.slot(), ..LayeredMaterial::default() },
                    None,
                )
            }
            Self::Layered(material) => (material, None),
            Self::Border(material, indices) => (material, Some(indices)),
            Self::Metal { metal, slopes } => {
                let factors =
                    LayeredParameters { base: metal.reflectance(1.0), ..LayeredParameters::default() };
                let (roughness, anisotropy) = stretched(slopes);
                (LayeredMaterial { factors, roughness, anisotropy, ..LayeredMaterial::default() }, None)
            }
            Self::Glass { indices, slope } => {
                let factors = LayeredParameters {
                    metallic: 0.0,
                    transmission: 1.0,
                    ior: (indices[0] / indices[1]) as f32,
                    ..LayeredParameters::default()
                };
                let roughness = slope.sqrt() as f32;
                (LayeredMaterial { factors, roughness, ..LayeredMaterial::default() }, Some(indices))
            }
            Self::Null => {
                (LayeredMaterial { factors: matt(), alpha: 0.0, ..LayeredMaterial::default() }, None)
            }
        }
    }
}

/// Roughness and anisotropy in the conventions of glTF, for facets with these slopes.
pub(crate) fn stretched([along, across]: [f64; 2]) -> (f32, [f32; 2]) {
    let (least, most) = (along.min(across).clamp(0.0, 1.0), along.max(across).clamp(0.0, 1.0));
    let strength = if least < 1.0 { ((most - least) / (1.0 - least)).sqrt() } else { 0.0 };
    let turn = if along < across { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    let turn = if strength > 0.0 { turn } else { 0.0 };
    (least.sqrt() as f32, [strength as f32, turn as f32])
}

impl Surface {
    /// Whether the surface has no modifiers.
    pub(crate) fn is_bare(&self) -> bool {
        self.opacity.is_none() && self.normal.is_none() && self.bump.is_none()
    }

    /// The blend of two surfaces with `share` of the second, and whether it can be modelled. If not, it is the heavier one alone.
    pub(crate) fn mixed_with(self, other: Self, share: f64) -> (Self, bool) {
        if share <= 0.0 {
            return (self, true);
        }
        if share >= 1.0 {
            return (other, true);
        }
        let two_sided = self.two_sided || other.two_sided;
        match (&self.base, &other.base) {
            (Base::Diffuse(Paint::Plain(one)), Base::Diffuse(Paint::Plain(two)))
                if self.is_bare() && other.is_bare() =>
            {
                let mixed = Base::Diffuse(Paint::Plain(one.lerp(*two, share)));
                (Self { two_sided, ..mixed.into() }, true)
            }
            (Base::Null, _) if other.opacity.is_none() => {
                (Self { opacity: Some(Amount::Plain(share)), ..other }, true)
            }
            (_, Base::Null) if self.opacity.is_none() => {
                (Self { opacity: Some(Amount::Plain(1.0 - share)), ..self }, true)
            }
            _ => (if share > 0.5 { other } else { self }, false),
        }
    }
}
