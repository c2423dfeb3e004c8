use serde::Serialize;

/// One of the five parts that a picture is the sum of: what emitters send straight to the camera and the four
/// integrals of the rendering equation (Jensen 1996, eq. 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Light emitted by what the camera sees.
    Emission,
    /// Light that reaches a diffuse surface straight from an emitter.
    Direct,
    /// Light that reaches the camera by specular reflection or refraction.
    Specular,
    /// Light that reaches a diffuse surface after specular surfaces only.
    Caustics,
    /// Light that reaches a diffuse surface after at least one other diffuse surface.
    Indirect,
}

/// All parts, in the order in which they are added up and written.
pub const AOVS: [Aov; 5] = [Aov::Emission, Aov::Direct, Aov::Specular, Aov::Caustics, Aov::Indirect];

impl Aov {
    /// Name of the layer in files and on the command line.
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

/// Which buffers a film has. What is left out costs no memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerSet {
    /// The parts of the picture, in the order of [`AOVS`].
    pub aovs: [bool; 5],
    /// Reflectance of the first surface.
    pub albedo: bool,
    /// Shading normal of the first surface, world space.
    pub normal: bool,
    /// Distance from the camera.
    pub depth: bool,
    /// Which object.
    pub object_id: bool,
    /// Which material.
    pub material_id: bool,
    /// Count of samples.
    pub samples: bool,
    /// Estimate of the bias, where the integrator makes one.
    pub bias: bool,
}

impl Default for LayerSet {
    /// The five parts of the picture and nothing else.
    fn default() -> Self {
        Self {
            aovs: [true; 5],
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
    /// Everything that every integrator has. Without the count of samples, which is the same everywhere unless they are shared
    /// out by variance.
    pub fn all() -> Self {
        Self {
            aovs: [true; 5],
            albedo: true,
            normal: true,
            depth: true,
            object_id: true,
            material_id: true,
            samples: false,
            bias: false,
        }
    }

    /// True where `aov` has a buffer.
    pub fn has(&self, aov: Aov) -> bool {
        self.aovs[aov as usize]
    }
}
