//! Settings that are one of several names. Each enumeration is declared with the names that users write, which are also those in
//! statistics and metadata; the first paragraph of a comment is the help of the command line.

use serde::{Deserialize, Serialize};

/// A name that may be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Named {
    /// As users write it.
    pub name: &'static str,
    /// What it means, as the comment of its declaration.
    pub about: &'static str,
}

/// An enumeration that users choose from.
pub trait Choices: Copy + 'static {
    /// All names, in the order of declaration.
    const NAMES: &'static [Named];

    /// The name of this one.
    fn name(self) -> &'static str;

    /// The one of this name; where it contains a number, with the one given or its default. `None` where no name is this one.
    fn named(name: &str, parameter: Option<f64>) -> Option<Self>;
}

macro_rules! choices {
    ($(
        $(#[doc = $about:literal])*
        enum $enumeration:ident { $( $(#[doc = $doc:literal])* $variant:ident = $name:literal, )+ }
    )+) => {$(
        $(#[doc = $about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum $enumeration {
            $( $(#[doc = $doc])* #[serde(rename = $name)] $variant, )+
        }

        impl $enumeration {
            /// All of them, in the order of declaration.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];
        }

        impl Choices for $enumeration {
            const NAMES: &'static [Named] =
                &[$(Named { name: $name, about: concat!($($doc, "\n"),*) }),+];

            fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)+ }
            }

            fn named(name: &str, _: Option<f64>) -> Option<Self> {
                match name { $($name => Some(Self::$variant),)+ _ => None }
            }
        }
    )+};
}

choices! {
    /// Presets.
    enum Quality {
        /// Seconds: to see whether the scene is right.
        Draft = "draft",
        /// A good idea of the final picture.
        Preview = "preview",
        /// What one publishes.
        Final = "final",
        /// What one measures others against.
        Reference = "reference",
    }

    /// How a picture is computed.
    enum IntegratorKind {
        /// Photon maps and final gathering.
        ///
        /// Two passes: photon maps, then distribution ray tracing with final gathering (Jensen 1996).
        PhotonMap = "photon-map",
        /// One photon map shown directly at the first diffuse surface.
        Photons = "photons",
        /// Unbiased path tracing, the reference.
        Path = "path",
        /// Photon maps and final gathering in rounds, whose error falls as long as they go on.
        ///
        /// Each round has maps of its own, of which ever less that is biased is read (Knaus & Zwicker 2011).
        Progressive = "progressive",
    }

    /// Which of the photon maps.
    enum MapKind {
        /// All photons on diffuse surfaces.
        Global = "global",
        /// Photons that met only specular surfaces between the light and the surface they are stored at.
        Caustic = "caustic",
    }

    /// Whether photons stored along rays from the lights through the whole scene (Jensen & Christensen 1995, section 3 of
    /// Jensen 1996) tell where shadow rays are not needed.
    enum ShadowMode {
        /// Every shadow ray is traced.
        Off = "off",
        /// No ray where the ten nearest photons are all direct or all shadow photons (section 4.1 of Jensen 1996, to the letter).
        AsPrinted = "as-printed",
        /// No ray where enough photons agree that, with 99 % confidence, less than 1 % of the light is otherwise.
        Bounded = "bounded",
    }

    /// What helps BSDFs to sample directions.
    enum GuideKind {
        /// Nothing: directions are sampled from BSDFs alone.
        None = "none",
        /// Photons: directions that much light came from are sampled more often (Jensen 1995).
        Photons = "photons",
    }

    /// What [`IntegratorKind::Photons`] shows of its photons.
    enum Show {
        /// The radiance that they make.
        Radiance = "radiance",
        /// Each photon as a disc: direct white, indirect blue, caustic yellow, shadow red (figure 1 of Jensen 1996).
        Classes = "classes",
    }

    /// Whether density estimates carry the known bias of the printed formulas.
    enum Estimator {
        /// Eq. (3) and (5) of Jensen 1996 to the letter: the N-th photon sets the radius and is counted as well.
        AsPrinted = "as-printed",
        /// Without their bias of N/(N-1): the N-th photon only sets the radius (Garcia, Urena & Sbert 2012).
        Corrected = "corrected",
    }

    /// Wavelengths of paths that meet a medium whose index depends on the wavelength. Other paths have none.
    enum Wavelengths {
        /// All that can be seen, chosen as the eye responds to them.
        Continuous = "continuous",
        /// Three, one for each channel: the lines C, d and F (the picture of a prism in the lecture on photon mapping).
        Three = "3",
        /// None: every medium refracts all light as at the d line.
        Off = "off",
    }

    /// Region in which photons are searched.
    enum SearchRegion {
        /// A sphere.
        Sphere = "sphere",
        /// A sphere flattened along the normal.
        ///
        /// Other surfaces nearby are thereby left out, also those that face the same way. What counts is the height over a surface
        /// of even curvature between the photon and the place that is looked up, which both normals tell; so on round things it is
        /// the sphere.
        Disc = "disc",
    }
}

impl Quality {
    /// The preset where none is named.
    pub const DEFAULT: Self = Self::Preview;
}

#[allow(clippy::derivable_impls, reason = "the macro derives the same for all enumerations")]
impl Default for Wavelengths {
    fn default() -> Self {
        Self::Continuous
    }
}

/// Kernel of a density estimate, a function of the distance `d` over the radius `r`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// Constant (Jensen 1996, eq. 3).
    Constant,
    /// `max(0, 1 - d / (k r))` (Jensen 1996, eq. 4).
    Cone {
        /// Filter constant, at least 1.
        k: f32,
    },
    /// `1 - (d / r)^2`.
    Epanechnikov,
    /// The Gaussian of Pavicic (Graphics Gems I) with Jensen's constants, normalised exactly.
    Gaussian,
}

impl Kernel {
    /// Filter constant of a cone that comes without one.
    const DEFAULT_K: f64 = 1.0;
}

impl Choices for Kernel {
    const NAMES: &'static [Named] = &[
        Named { name: "constant", about: "The same weight for all photons." },
        Named { name: "cone", about: "Weights that fall linearly with distance." },
        Named { name: "epanechnikov", about: "1 - (d/r)^2." },
        Named { name: "gaussian", about: "A Gaussian." },
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Cone { .. } => "cone",
            Self::Epanechnikov => "epanechnikov",
            Self::Gaussian => "gaussian",
        }
    }

    fn named(name: &str, parameter: Option<f64>) -> Option<Self> {
        match name {
            "constant" => Some(Self::Constant),
            "cone" => Some(Self::Cone { k: parameter.unwrap_or(Self::DEFAULT_K) as f32 }),
            "epanechnikov" => Some(Self::Epanechnikov),
            "gaussian" => Some(Self::Gaussian),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Statistics, scene files and the command line have the same names.
    #[test]
    fn names_are_the_serialized_ones() {
        fn check<T: Choices + Serialize>() {
            for &Named { name, about } in T::NAMES {
                let value = T::named(name, None).unwrap();
                let written = serde_json::to_value(value).unwrap();
                let written = written
                    .as_object()
                    .and_then(|fields| fields.keys().next().cloned())
                    .unwrap_or_else(|| written.as_str().unwrap_or_default().to_owned());
                assert_eq!((value.name(), written.as_str()), (name, name));
                assert!(!about.trim().is_empty(), "{name}");
            }
            assert!(T::named("no such name", None).is_none());
        }
        check::<Quality>();
        check::<IntegratorKind>();
        check::<MapKind>();
        check::<ShadowMode>();
        check::<GuideKind>();
        check::<Show>();
        check::<Estimator>();
        check::<Wavelengths>();
        check::<SearchRegion>();
        check::<Kernel>();
    }
}
