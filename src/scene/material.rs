use crate::bsdf::{Bsdf, Dielectric, Lambert, Mirror};
use crate::math::Rgb;
use crate::media::MediumId;

/// What a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// Ideal diffuse reflection.
    Lambert {
        /// Hemispherical reflectance.
        reflectance: Rgb,
        /// Whether the back reflects as well.
        two_sided: bool,
    },
    /// Ideal specular reflection.
    Mirror {
        /// Reflectance.
        reflectance: Rgb,
        /// Whether the back reflects as well.
        two_sided: bool,
    },
    /// Smooth interface between two media.
    Dielectric {
        /// Medium on the side away from the normal.
        inside: MediumId,
        /// Medium on the side of the normal.
        outside: MediumId,
        /// The interface itself.
        interface: Dielectric,
    },
}

impl Material {
    /// The BSDF for a ray that arrives on the `front` (the side of the normal) or the back; and whether its frame keeps
    /// the side of the normal instead of turning to the ray.
    #[inline]
    pub(super) fn bsdf(&self, front: bool) -> (Bsdf, bool) {
        match *self {
            Self::Lambert { two_sided: false, .. } | Self::Mirror { two_sided: false, .. } if !front => {
                (Bsdf::BLACK, false)
            }
            Self::Lambert { reflectance, .. } => (Bsdf::Lambert(Lambert { reflectance }), false),
            Self::Mirror { reflectance, .. } => (Bsdf::Mirror(Mirror { reflectance }), false),
            Self::Dielectric { interface, .. } => (Bsdf::Dielectric(interface), true),
        }
    }

    /// The medium on the side that a ray travels on after the surface: `front` is the side of the normal. `None` for
    /// opaque materials, which do not bound media.
    #[inline]
    pub fn medium_on(&self, front: bool) -> Option<MediumId> {
        match *self {
            Self::Dielectric { inside, outside, .. } => Some(if front { outside } else { inside }),
            Self::Lambert { .. } | Self::Mirror { .. } => None,
        }
    }

    /// True where photons are stored and maps are asked.
    pub fn has_diffuse(&self) -> bool {
        matches!(self, Self::Lambert { reflectance, .. } if reflectance.max_element() > 0.0)
    }

    /// True where light is mirrored or refracted: what makes caustics.
    pub fn is_specular(&self) -> bool {
        self.specularity() > 0.0
    }

    /// Largest share of the light that is mirrored or refracted: what decides whether a surface casts caustics, and how
    /// many photons are aimed at it (Jensen & Christensen 1995, section 3).
    pub fn specularity(&self) -> f32 {
        match self {
            Self::Lambert { .. } => 0.0,
            Self::Mirror { reflectance, .. } => reflectance.max_element(),
            Self::Dielectric { .. } => 1.0,
        }
    }
}
