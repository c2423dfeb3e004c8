//! Meaning of the layers of a picture, which depends on the integrator. It is stored in the picture, so that layers with
//! different meanings are not compared.

use cardioid::image_io::{Image, MetadataValue};
use cardioid::render::{IntegratorKind, MapKind, Settings, Show};

/// Name of the metadata entry.
pub(crate) const LAYERS: &str = "cardioid/layers";

/// How the light of a picture is divided among its layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerMeaning {
    /// By light path: docs/light-paths.md.
    ByPath,
    /// Photons of the global map shown directly, all of them in `indirect`.
    GlobalPhotons,
    /// Photons of the caustic map shown directly, all of them in `indirect`.
    CausticPhotons,
    /// Photons as discs in the colours of their classes; these values are no light.
    Classes,
}

const ALL: [LayerMeaning; 4] =
    [LayerMeaning::ByPath, LayerMeaning::GlobalPhotons, LayerMeaning::CausticPhotons, LayerMeaning::Classes];

/// The layers that light is divided among.
const PARTS: [&str; 5] = ["emission", "direct", "specular", "caustics", "indirect"];

impl LayerMeaning {
    /// The meaning for a picture with these settings.
    pub(crate) fn of(settings: &Settings) -> Self {
        match (settings.integrator, settings.show, settings.map) {
            (IntegratorKind::PhotonMap | IntegratorKind::Path | IntegratorKind::Progressive, _, _) => {
                Self::ByPath
            }
            (IntegratorKind::Photons, Show::Classes, _) => Self::Classes,
            (IntegratorKind::Photons, Show::Radiance, MapKind::Caustic) => Self::CausticPhotons,
            (IntegratorKind::Photons, Show::Radiance, _) => Self::GlobalPhotons,
        }
    }

    /// The meaning that a picture file states; `None` where it states none.
    pub(crate) fn of_image(image: &Image) -> Option<Self> {
        let Some(MetadataValue::Text(text)) = image.metadata(LAYERS) else { return None };
        ALL.into_iter().find(|meaning| meaning.name() == text)
    }

    /// Its name in the metadata.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::ByPath => "by-path",
            Self::GlobalPhotons => "global-photons",
            Self::CausticPhotons => "caustic-photons",
            Self::Classes => "photon-classes",
        }
    }

    /// A phrase for messages, after "its light is".
    fn words(self) -> &'static str {
        match self {
            Self::ByPath => "divided by the path it took",
            Self::GlobalPhotons => {
                "that of the global photon map shown directly, all of it in `indirect`, direct light and caustics too"
            }
            Self::CausticPhotons => "that of the caustic photon map alone, all of it in `indirect`",
            Self::Classes => "none: photons are shown as discs in the colours of their classes",
        }
    }

    /// Why this layer of two pictures cannot be compared; `None` where it can.
    pub(crate) fn difference(a: Self, b: Self, layer: &str) -> Option<String> {
        let is_part = PARTS.contains(&layer);
        // The whole picture holds all light, whatever the integrator, except where it shows a part of the light or none.
        let is_whole = layer == "beauty";
        let shows_all = |meaning| matches!(meaning, Self::ByPath | Self::GlobalPhotons);
        let differ = a != b && (is_part || is_whole && !(shows_all(a) && shows_all(b)));
        differ.then(|| {
            let whole = if is_part && shows_all(a) && shows_all(b) {
                "; compare the pictures as a whole, without --aov"
            } else {
                ""
            };
            format!("the light of one is {}; the light of the other is {}{whole}", a.words(), b.words())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_differ_where_light_is_divided_otherwise() {
        use LayerMeaning::{ByPath, CausticPhotons, Classes, GlobalPhotons};
        let differs = |a, b, layer| LayerMeaning::difference(a, b, layer).is_some();
        assert!(differs(ByPath, GlobalPhotons, "indirect") && differs(GlobalPhotons, ByPath, "direct"));
        assert!(!differs(ByPath, GlobalPhotons, "beauty") && !differs(ByPath, GlobalPhotons, "albedo"));
        assert!(differs(ByPath, CausticPhotons, "beauty") && differs(GlobalPhotons, Classes, "beauty"));
        assert!(ALL.iter().all(|&same| PARTS.iter().all(|layer| !differs(same, same, layer))));
    }
}
