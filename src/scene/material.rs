//! Materials: what surfaces are made of, and the BSDFs and media that follow from it.

use crate::bsdf::{Bsdf, Dielectric, Lambert, Layered, Mirror, RoughDielectric};
use crate::math::Rgb;
use crate::media::{AIR, Medium, MediumId};
use glam::Vec3;

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
    /// Rough interface between two media.
    RoughDielectric {
        /// Medium on the side away from the normal.
        inside: MediumId,
        /// Medium on the side of the normal.
        outside: MediumId,
        /// The interface itself.
        interface: RoughDielectric,
    },
    /// The material of glTF; where its parameters vary, this represents all of its parts.
    Layered {
        /// The model.
        bsdf: Layered,
        /// Media on the side away from the normal and on the side of the normal, where the surface is an interface between them.
        media: Option<[MediumId; 2]>,
    },
    /// Schlick's or Ward's model, or a metal.
    Glossy {
        /// The model, for the side that reflects.
        bsdf: Bsdf,
        /// Whether the back reflects as well.
        two_sided: bool,
        /// Orientation of an anisotropic model in the surface.
        tangent: Option<Tangent>,
    },
}

/// The direction along an anisotropic surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tangent {
    /// A direction, projected onto the surface.
    Along(Vec3),
    /// Around an axis, as for an object turned on a lathe.
    Around(Vec3),
}

impl Tangent {
    /// The direction at a position with this normal; not of unit length and possibly zero.
    #[inline]
    pub fn at(&self, normal: Vec3) -> Vec3 {
        match *self {
            Self::Along(direction) => direction,
            Self::Around(axis) => axis.cross(normal),
        }
    }
}

impl Material {
    /// The BSDF for a ray that arrives on the `front` (the side of the normal) or on the back; and whether its frame keeps the side of
    /// the normal instead of turning to the ray.
    #[inline]
    pub(super) fn bsdf(&self, front: bool) -> (Bsdf, bool) {
        match *self {
            Self::Lambert { two_sided: false, .. }
            | Self::Mirror { two_sided: false, .. }
            | Self::Glossy { two_sided: false, .. }
                if !front =>
            {
                (Bsdf::BLACK, false)
            }
            _ => (self.front_bsdf(), !self.is_opaque()),
        }
    }

    /// The BSDF on the side of the normal.
    #[inline]
    fn front_bsdf(&self) -> Bsdf {
        match *self {
            Self::Lambert { reflectance, .. } => Bsdf::Lambert(Lambert { reflectance }),
            Self::Mirror { reflectance, .. } => Bsdf::Mirror(Mirror { reflectance }),
            Self::Dielectric { interface, .. } => Bsdf::Dielectric(interface),
            Self::RoughDielectric { interface, .. } => Bsdf::RoughDielectric(interface),
            Self::Layered { bsdf, .. } => Bsdf::Layered(bsdf),
            Self::Glossy { bsdf, .. } => bsdf,
        }
    }

    #[inline]
    fn is_opaque(&self) -> bool {
        !matches!(
            self,
            Self::Dielectric { .. } | Self::RoughDielectric { .. } | Self::Layered { media: Some(_), .. }
        )
    }

    /// Orientation of an anisotropic model in the surface; `None` where nothing depends on it.
    #[inline]
    pub(super) fn tangent(&self) -> Option<Tangent> {
        match *self {
            Self::Glossy { tangent, .. } => tangent,
            _ => None,
        }
    }

    /// The medium in which a ray continues after the surface, by the side on which it continues: `front` is the side of the normal.
    /// `None` for opaque materials, which do not bound media.
    #[inline]
    pub fn medium_on(&self, front: bool) -> Option<MediumId> {
        self.media().map(|[inside, outside]| if front { outside } else { inside })
    }

    /// The media inside and outside, if the surface is an interface between them. `None` for opaque materials.
    #[inline]
    pub fn media(&self) -> Option<[MediumId; 2]> {
        match *self {
            Self::Dielectric { inside, outside, .. } | Self::RoughDielectric { inside, outside, .. } => {
                Some([inside, outside])
            }
            Self::Layered { media, .. } => media,
            Self::Lambert { .. } | Self::Mirror { .. } | Self::Glossy { .. } => None,
        }
    }

    /// Description of the material in words; `media` are those of its scene.
    pub fn describe(&self, media: &[Medium]) -> String {
        let border = |[inside, outside]: [MediumId; 2]| {
            let medium = |id: MediumId| match media.get(id as usize) {
                Some(medium) if id != AIR => format!("a medium of index {}", medium.ior),
                _ => "air".to_owned(),
            };
            format!("border of {} in {}", medium(inside), medium(outside))
        };
        let kind = match self {
            Self::Lambert { .. } => return "diffuse".to_owned(),
            Self::Mirror { .. } => return "mirror".to_owned(),
            Self::Glossy { .. } => "opaque".to_owned(),
            Self::Dielectric { inside, outside, .. } | Self::RoughDielectric { inside, outside, .. } => {
                border([*inside, *outside])
            }
            Self::Layered { media: Some(media), .. } => border(*media),
            Self::Layered { bsdf, .. } if bsdf.transmits() => "sheet that does not bend light".to_owned(),
            Self::Layered { .. } => "opaque".to_owned(),
        };
        let bsdf = self.front_bsdf();
        let lobes =
            [(bsdf.has_diffuse(), "diffuse"), (bsdf.has_glossy(), "glossy"), (bsdf.has_specular(), "smooth")];
        let lobes: Vec<_> = lobes.iter().filter(|(has, _)| *has).map(|(_, name)| *name).collect();
        if lobes.is_empty() { kind } else { format!("{kind}, {}", lobes.join(" and ")) }
    }

    /// Whether photons are stored on it and maps are read.
    pub fn has_diffuse(&self) -> bool {
        self.front_bsdf().has_diffuse()
    }

    /// Whether it reflects or refracts light by a highly glossy lobe, which distribution rays follow.
    pub fn has_glossy(&self) -> bool {
        self.front_bsdf().has_glossy()
    }

    /// Whether it reflects or refracts light ideally: no shadow ray passes it, and no light can be sampled through it.
    pub fn has_specular(&self) -> bool {
        self.front_bsdf().has_specular()
    }

    /// Whether it reflects or refracts light ideally or highly glossily, which makes it a caustic caster.
    pub fn is_specular(&self) -> bool {
        self.specularity() > 0.0
    }

    /// Largest share of the light that is reflected or refracted, ideally or highly glossily, near normal incidence. It decides whether
    /// a surface casts caustics, and how many photons are aimed at it (Jensen & Christensen 1995, section 3).
    pub fn specularity(&self) -> f32 {
        let bsdf = self.front_bsdf();
        if !(bsdf.has_specular() || bsdf.has_glossy()) {
            return 0.0;
        }
        let [_, glossy, specular] = bsdf.lobe_weights(glam::Vec3::Z);
        // A lobe that reflects almost nothing at this incidence still casts caustics.
        (glossy + specular).clamp(1e-3, 1.0)
    }
}
