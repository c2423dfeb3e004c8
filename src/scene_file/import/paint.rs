//! Colours and numbers of materials: constants and pictures.

use crate::math::Rgb;
use crate::textures::TextureSlot;
use glam::DVec3;

/// The use of a picture's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Use {
    /// Colours between 0 and 1.
    Colour,
    /// Colours of any brightness, divided by the brightest.
    Glow,
    /// Slopes of facets; the square roots are stored in green.
    Slope,
    /// Roughness without conversion, in green.
    Roughness,
    /// Fractions, in blue.
    Blue,
    /// Fractions, in alpha, with white as the colour.
    Alpha,
    /// Values without conversion.
    Raw,
}

/// A colour that may vary.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Paint {
    Plain(DVec3),
    /// A picture with a factor.
    Picture(TextureSlot, DVec3),
    /// Vertex colours with a factor.
    Vertices(DVec3),
}

impl Paint {
    /// The colour, if it is the same everywhere.
    pub(crate) fn plain(&self) -> Option<DVec3> {
        match self {
            Self::Plain(colour) => Some(*colour),
            Self::Picture(..) | Self::Vertices(_) => None,
        }
    }

    /// The colour; where it varies, an approximate mean.
    pub(crate) fn mean(&self) -> DVec3 {
        match self {
            Self::Plain(colour) | Self::Vertices(colour) => *colour,
            Self::Picture(slot, factor) => slot.texture.mean().truncate().as_dvec3() * *factor,
        }
    }

    /// The factor on the picture or on vertex colours; otherwise the colour itself.
    pub(crate) fn tint(&self) -> DVec3 {
        match self {
            Self::Plain(colour) | Self::Picture(_, colour) | Self::Vertices(colour) => *colour,
        }
    }

    pub(crate) fn factor(&self) -> Rgb {
        self.tint().as_vec3()
    }

    pub(crate) fn slot(&self) -> Option<TextureSlot> {
        match self {
            Self::Picture(slot, _) => Some(slot.clone()),
            Self::Plain(_) | Self::Vertices(_) => None,
        }
    }

    pub(crate) fn times(self, factor: DVec3) -> Self {
        match self {
            Self::Plain(colour) => Self::Plain(colour * factor),
            Self::Picture(slot, own) => Self::Picture(slot, own * factor),
            Self::Vertices(own) => Self::Vertices(own * factor),
        }
    }
}

/// A number that may vary.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Amount {
    Plain(f64),
    Picture(TextureSlot),
}

impl Amount {
    /// The number, if it is constant.
    pub(crate) fn plain(&self) -> Option<f64> {
        match self {
            Self::Plain(value) => Some(*value),
            Self::Picture(_) => None,
        }
    }
}

/// Luminance of a linear colour of Rec. 709.
pub(crate) fn luminance(colour: DVec3) -> f64 {
    colour.dot(DVec3::new(0.212_671, 0.715_160, 0.072_169))
}
