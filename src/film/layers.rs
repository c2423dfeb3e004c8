//! Parts of a picture and the set of layers of a film.

use serde::{Deserialize, Serialize};

/// One of the five parts whose sum is the picture: the emission that the camera sees directly, and the four integrals of the rendering
/// equation (Jensen 1996, eq. 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Light that surfaces seen by the camera emit.
    Emission,
    /// Light that reaches a diffuse surface directly from an emitter.
    Direct,
    /// Light that reaches the camera by specular reflection or refraction.
    Specular,
    /// Light that reaches a diffuse surface after specular surfaces only.
    Caustics,
    /// Light that reaches a diffuse surface after at least one other diffuse surface.
    Indirect,
}

/// All parts, in the order in which they are summed and written.
pub const AOVS: [Aov; 5] = [Aov::Emission, Aov::Direct, Aov::Specular, Aov::Caustics, Aov::Indirect];

impl Aov {
    /// The name of the layer in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Emission => "emission",
            Self::Direct => "direct",
            Self::Specular => "specular",
            Self::Caustics => "caustics",
            Self::Indirect => "indirect",
        }
    }
}

/// The set of buffers of a film. A buffer that is left out costs no memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct LayerSet {
    /// The parts of the picture, in the order of [`AOVS`].
    pub aovs: [bool; 5],
    /// The sum of the parts as a single buffer, for a picture without the parts.
    pub beauty: bool,
    /// Reflectance of the first surface.
    pub albedo: bool,
    /// Shading normal of the first surface, world space.
    pub normal: bool,
    /// Distance from the camera.
    pub depth: bool,
    /// Number of the object.
    pub object_id: bool,
    /// Number of the material.
    pub material_id: bool,
    /// Number of samples.
    pub samples: bool,
    /// Estimate of the bias, where the integrator has one.
    pub bias: bool,
}

impl Default for LayerSet {
    /// The five parts of the picture and nothing else.
    fn default() -> Self {
        Self {
            aovs: [true; 5],
            beauty: false,
            albedo: false,
            normal: false,
            depth: false,
            object_id: false,
            material_id: false,
            samples: false,
            bias: false,
        }
    }
}

impl LayerSet {
    /// All layers that every integrator provides. The number of samples is left out: it is the same for all pixels unless sampling is
    /// adaptive.
    pub fn all() -> Self {
        Self {
            aovs: [true; 5],
            beauty: false,
            albedo: true,
            normal: true,
            depth: true,
            object_id: true,
            material_id: true,
            samples: false,
            bias: false,
        }
    }

    /// The picture alone, without its parts.
    pub fn beauty() -> Self {
        Self { aovs: [false; 5], beauty: true, ..Self::default() }
    }

    /// Whether `aov` has a buffer.
    pub fn has(&self, aov: Aov) -> bool {
        self.aovs[aov as usize]
    }
}
