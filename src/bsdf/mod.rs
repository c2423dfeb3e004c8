//! Scattering at a surface, with one file per model.
//!
//! # Conventions
//!
//! Directions are unit vectors in a local frame whose `z` is the shading normal. `wo` points to the previous vertex of the path, `wi` is
//! the direction that is evaluated or sampled; both point away from the surface. For a camera path, `wo` points towards the eye and `wi`
//! towards the light; for a photon, `wo` points towards the light and `wi` is the direction in which the photon continues.
//!
//! A [`Bsdf`] is a small `Copy` value without references, built at each hit: it needs no allocation and no dispatch through a pointer.
//!
//! # Sides
//!
//! Opaque models ([`Lambert`], [`Mirror`], [`Schlick`], [`Ward`], [`Conductor`]) scatter only where `wo.z > 0` and `wi.z > 0`; on the
//! other side they are black. For a two-sided material the caller turns the frame so that `wo.z > 0` before it builds the `Bsdf`. A
//! one-sided material keeps the frame of the surface, and its back absorbs. [`Bsdf::BLACK`] absorbs everywhere. [`Dielectric`] and
//! [`RoughDielectric`] have media on both sides and must keep the frame of the surface, as must a [`Layered`] that is an interface;
//! other layered ones are turned.
//!
//! # Failure values
//!
//! Where nothing is scattered (black side, zero reflectance, `wo.z` zero or NaN), `eval` and `pdf_solid_angle` return zero and `sample`
//! returns `None`. No function here returns NaN or a direction that is not of unit length.

mod bent;
mod conductor;
mod dielectric;
mod fresnel;
mod ggx;
mod lambert;
mod layered;
mod layered_albedo;
mod metals;
mod mirror;
mod part;
mod rough_dielectric;
mod schlick;
mod shading_normal;
mod ward;

#[cfg(test)]
mod bent_tests;
#[cfg(test)]
pub(crate) mod chi_square;
#[cfg(test)]
mod glossy_tests;
#[cfg(test)]
mod layered_tests;
#[cfg(test)]
mod tests;

pub use bent::{Bend, Bent};
pub use conductor::{Conductor, Metal, fresnel_conductor, schlick_fresnel};
pub use dielectric::{Dielectric, MATCHED_IOR_TOLERANCE};
pub use fresnel::{critical_cosine, fresnel_dielectric, reflect, refract};
pub use ggx::SMOOTH_ROUGHNESS;
pub use lambert::Lambert;
pub use layered::{Body, Layered, LayeredParameters};
pub use metals::METALS;
pub use mirror::Mirror;
pub use part::GLOSS_THRESHOLD;
pub use rough_dielectric::RoughDielectric;
pub use schlick::Schlick;
pub use shading_normal::sides_agree;
pub use ward::Ward;

use crate::math::Rgb;
use glam::Vec3;

/// The quantity that a path carries, which determines how refraction changes it.
///
/// Across an interface from index `n1` to `n2` radiance scales by `(n2 / n1)^2`, because a cone of light is squeezed into another solid
/// angle; the power of a photon does not change. BSDFs with refraction are therefore not symmetric, and the two kinds of path use
/// adjoint BSDFs (Veach 1997, section 5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportMode {
    /// Paths from the camera, which collect radiance.
    Radiance,
    /// Paths from a light (photons), which carry flux.
    Flux,
}

/// The part of the BSDF that a sample comes from. This is the split of equation (2) of Jensen, "Global Illumination using Photon Maps"
/// (1996), which writes `f_r = f_r,s + f_r,d`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// `f_r,d`: the part that is smooth enough for a density estimate. Its incident light is split into the direct term (`L_i,l`), the
    /// caustic map (`L_i,c`) and the global map or a final gather (`L_i,d`).
    Diffuse,
    /// The highly glossy part of `f_r,s`. It is followed by distribution rays and never looked up in a map, but it is wide enough for
    /// shadow rays. In path notation it counts as S.
    Glossy,
    /// The ideal specular part of `f_r,s`, which consists of deltas and is followed by tracing.
    Specular,
}

/// The formula for models whose published version reflects more light than arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The formula as published.
    Printed,
    /// A formula with an albedo of at most one.
    Bounded,
}

/// A direction sampled from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction, local frame, unit length, `wi.z != 0`.
    pub wi: Vec3,
    /// `f |cos theta_i| / pdf`, finite. In [`TransportMode::Radiance`] a refraction includes its factor `(n_o / n_i)^2`. Valid for equal
    /// shading and geometric normals; see [`Bent`] for different ones.
    pub throughput: Rgb,
    /// Density of `wi` per solid angle within its lobe, 1/sr; `INFINITY` for a delta lobe, so that an MIS weight `1 / (1 + (pdf_other /
    /// pdf)^2)` is one without a special case.
    pub pdf_solid_angle: f32,
    /// The part of the BSDF that was sampled.
    pub lobe: Lobe,
    /// Whether `wi` is on the other side than `wo`.
    pub transmission: bool,
}

/// Scattering of light at one point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Ideal diffuse reflection.
    Lambert(Lambert),
    /// Ideal specular reflection.
    Mirror(Mirror),
    /// Smooth interface between two media.
    Dielectric(Dielectric),
    /// Schlick's model, from specular to diffuse.
    Schlick(Schlick),
    /// Ward's anisotropic model on a Lambert base.
    Ward(Ward),
    /// A rough or smooth metal.
    Conductor(Conductor),
    /// Rough interface between two media.
    RoughDielectric(RoughDielectric),
    /// The material of glTF 2.0.
    Layered(Layered),
}

impl Bsdf {
    /// The same BSDF with the interface between other media, if it is an interface.
    #[must_use]
    pub fn between(self, interface: Dielectric) -> Self {
        match self {
            Self::Dielectric(_) => Self::Dielectric(interface),
            Self::RoughDielectric(rough) => match rough.with_interface(interface) {
                Ok(rough) => Self::RoughDielectric(rough),
                Err(matched) => Self::Dielectric(matched),
            },
            Self::Layered(layers) => Self::Layered(layers.with_interface(interface)),
            other => other,
        }
    }

    /// Absorbs everything.
    pub const BLACK: Self = Self::Lambert(Lambert { reflectance: Rgb::ZERO });

    /// Whether directions along the surface differ, so that the frame needs a tangent.
    pub fn is_anisotropic(&self) -> bool {
        match self {
            Self::Lambert(_) | Self::Mirror(_) | Self::Dielectric(_) | Self::RoughDielectric(_) => false,
            Self::Schlick(schlick) => schlick.is_anisotropic(),
            Self::Ward(ward) => ward.is_anisotropic(),
            Self::Conductor(metal) => metal.is_anisotropic(),
            Self::Layered(layers) => layers.is_anisotropic(),
        }
    }
}
