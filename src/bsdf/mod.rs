//! Scattering at a surface, one file per model.
//!
//! # Conventions
//!
//! Directions are unit vectors in a local frame whose `z` is the shading normal. `wo` points to the previous
//! vertex of the path, `wi` is the direction that is evaluated or sampled; both leave the surface. For a
//! camera path `wo` is towards the eye and `wi` towards the light; for a photon `wo` is towards the light and
//! `wi` is where the photon goes next.
//!
//! A [`Bsdf`] is a small `Copy` value without references, built anew at each hit: no allocation, no dispatch
//! through a pointer.
//!
//! # Sides
//!
//! Opaque models ([`Lambert`], [`Mirror`]) scatter only where `wo.z > 0` and `wi.z > 0`; towards the other
//! side they are black. A two-sided material is made by the caller, who turns the frame so that `wo.z > 0`
//! before building the `Bsdf`; a one-sided one keeps the frame of the surface, and its back absorbs.
//! [`Bsdf::BLACK`] absorbs everywhere. [`Dielectric`] has media on both sides and must keep the frame of the
//! surface.
//!
//! # Failure values
//!
//! `eval` and `pdf_solid_angle` return zero, `sample` returns `None`, where nothing is scattered: black side,
//! zero reflectance, `wo.z` zero or NaN. Nothing here returns NaN or a direction that is not of unit length.

mod dielectric;
mod fresnel;
mod lambert;
mod mirror;
mod shading_normal;

#[cfg(test)]
pub(crate) mod chi_square;
#[cfg(test)]
mod tests;

pub use dielectric::{Dielectric, MATCHED_IOR_TOLERANCE};
pub use fresnel::{critical_cosine, fresnel_dielectric, reflect, refract};
pub use lambert::Lambert;
pub use mirror::Mirror;
pub use shading_normal::{shading_normal_correction, sides_agree};

use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// What a path carries, which decides what refraction does to it.
///
/// Across an interface from index `n1` to `n2` radiance scales by `(n2 / n1)^2`, because a cone of light is
/// squeezed into another solid angle; the power of a photon does not change. BSDFs with refraction are
/// therefore not symmetric and the two kinds of path use adjoint ones (Veach 1997, section 5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportMode {
    /// Paths from the camera, which gather radiance.
    Radiance,
    /// Paths from a light: photons, which carry flux.
    Flux,
}

/// Which part of the BSDF a sample comes from: the split of equation (2) of Jensen, "Global Illumination
/// using Photon Maps" (1996), which writes `f_r = f_r,s + f_r,d`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// `f_r,d`: what is smooth enough for a density estimate. Its incident light is split over the direct
    /// term (`L_i,l`), the caustic map (`L_i,c`) and the global map or a final gather (`L_i,d`).
    Diffuse,
    /// `f_r,s`: mirror-like parts, followed by tracing further and never looked up in a map.
    Specular,
}

/// A direction drawn from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction, local frame, unit length, `wi.z != 0`.
    pub wi: Vec3,
    /// `f |cos theta_i| / pdf`, finite. In [`TransportMode::Radiance`] a refraction includes its
    /// `(n_o / n_i)^2`. No shading-normal correction: see [`shading_normal_correction`].
    pub throughput: Rgb,
    /// Density of `wi` per solid angle, 1/sr; `INFINITY` for a delta lobe, so that a weight
    /// `1 / (1 + (pdf_other / pdf)^2)` is one without a special case.
    pub pdf_solid_angle: f32,
    /// The part of the BSDF that was sampled.
    pub lobe: Lobe,
    /// True where `wi` is on the other side than `wo`.
    pub transmission: bool,
}

/// How one point of a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Ideal diffuse reflection.
    Lambert(Lambert),
    /// Ideal specular reflection.
    Mirror(Mirror),
    /// Smooth interface between two media.
    Dielectric(Dielectric),
}

impl Bsdf {
    /// Absorbs everything.
    pub const BLACK: Self = Self::Lambert(Lambert { reflectance: Rgb::ZERO });

    /// The BSDF `f(wo, wi)`, 1/sr, without any cosine; zero for delta lobes, which only [`Self::sample`]
    /// meets.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        match self {
            Self::Lambert(lambert) => lambert.eval(wo, wi),
            Self::Mirror(_) | Self::Dielectric(_) => Rgb::ZERO,
        }
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample`] draws `wi`; zero for delta lobes.
    #[inline]
    pub fn pdf_solid_angle(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Self::Lambert(lambert) => lambert.pdf_solid_angle(wo, wi),
            Self::Mirror(_) | Self::Dielectric(_) => 0.0,
        }
    }

    /// Draws a direction. `u_lobe` in `[0, 1)` chooses between lobes, `u` in `[0, 1)^2` within one. `None`
    /// where nothing is scattered: the path ends and its power is absorbed.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        match self {
            Self::Lambert(lambert) => lambert.sample(wo, u),
            Self::Mirror(mirror) => mirror.sample(wo),
            Self::Dielectric(dielectric) => dielectric.sample(wo, u_lobe, mode),
        }
    }

    /// True where every lobe is a delta: [`Self::eval`] is zero everywhere and direct lighting has nothing to
    /// do.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Self::Lambert(_) => false,
            Self::Mirror(_) | Self::Dielectric(_) => true,
        }
    }

    /// True where there is a [`Lobe::Diffuse`] that reflects anything: where photons are stored and maps are
    /// asked.
    #[inline]
    pub fn has_diffuse(&self) -> bool {
        match self {
            Self::Lambert(lambert) => lambert.reflectance.max_element() > 0.0,
            Self::Mirror(_) | Self::Dielectric(_) => false,
        }
    }

    /// Probability with which [`Self::sample`] reflects, as against refracting: `u_lobe` below it reflects. One where
    /// nothing is transmitted.
    #[inline]
    pub fn reflection_probability(&self, wo: Vec3) -> f32 {
        match self {
            Self::Lambert(_) | Self::Mirror(_) => 1.0,
            Self::Dielectric(dielectric) => dielectric.reflectance(wo),
        }
    }

    /// Reflected plus transmitted flux over incident flux, per channel, on the side that scatters: for the
    /// albedo AOV and for Russian roulette. Exact for the present models, none of which depends on the
    /// direction.
    #[inline]
    pub fn albedo(&self) -> Rgb {
        match self {
            Self::Lambert(lambert) => lambert.reflectance,
            Self::Mirror(mirror) => mirror.reflectance,
            Self::Dielectric(_) => Rgb::ONE,
        }
    }
}
