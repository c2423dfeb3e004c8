//! A radiosity solution as the integrators read it, and its direct display.

use super::walk::{Walk, walk_specular};
use super::{PhotonMapIntegrator, PhotonMapSettings, Vertex};
use crate::film::{Aov, PixelSample};
use crate::integrators::{EyeRay, Integrator, Scratch};
use crate::math::Rgb;
use crate::radiosity::{PatchIrradiance, Radiosity};
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, Scene, Shading};
use crate::settings::Wavelengths;
use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

/// How a radiosity solution is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RadiosityView {
    /// Each patch with its own irradiance.
    Flat,
    /// Irradiance interpolated between the corners of patches (Gouraud shading).
    Smooth,
    /// Direct light and specular surfaces by rays, with interpolated indirect irradiance: the second pass of Wallace, Cohen & Greenberg, "A
    /// Two-Pass Solution to the Rendering Equation" (1987).
    Gather,
    /// Direct light by rays, and gather rays that read the solution where they land.
    Final,
}

/// A solution, and how it is shown.
#[derive(Clone, Debug)]
pub struct ShownRadiosity {
    /// The solution.
    pub solution: Arc<Radiosity>,
    /// How it is shown.
    pub view: RadiosityView,
}

/// Radiance that a Lambertian surface reflects of this irradiance.
fn reflected(shading: &Shading, irradiance: Rgb) -> Option<Rgb> {
    Some(shading.bsdf.lambertian()?.reflectance * irradiance * FRAC_1_PI)
}

impl PhotonMapIntegrator<'_> {
    /// Indirect radiance of a surface that the eye sees, where a solution is shown without gather rays.
    pub(super) fn patches_shown(&self, vertex: &Vertex<'_>) -> Option<Rgb> {
        let shown = self.maps.radiosity.as_ref()?;
        match shown.view {
            RadiosityView::Gather => {
                reflected(vertex.shading, shown.solution.interpolated(vertex.hit).indirect)
            }
            RadiosityView::Flat | RadiosityView::Smooth | RadiosityView::Final => None,
        }
    }

    /// All radiance of a surface on which a gather ray ends, where it is read from a solution.
    pub(super) fn patches_behind(&self, at: &Vertex<'_>) -> Option<Rgb> {
        let shown = self.maps.radiosity.as_ref()?;
        reflected(at.shading, shown.solution.interpolated(at.hit).total())
    }
}

/// Displays a solution at the first diffuse surface seen directly or through specular ones.
#[derive(Debug)]
pub struct ShowRadiosity<'a> {
    scene: &'a Scene,
    shown: &'a ShownRadiosity,
    settings: PhotonMapSettings,
    camera_media: CameraMedia,
}

impl<'a> ShowRadiosity<'a> {
    /// Displays `shown`, flat or smooth.
    pub fn new(
        scene: &'a Scene,
        shown: &'a ShownRadiosity,
        settings: PhotonMapSettings,
        camera_media: CameraMedia,
    ) -> Self {
        Self { scene, shown, settings, camera_media }
    }

    fn shade(&self, vertex: &Vertex<'_>) -> [(Aov, Rgb); 2] {
        let solution = &self.shown.solution;
        let PatchIrradiance { direct, indirect } = match self.shown.view {
            RadiosityView::Flat => solution.of_patch(vertex.hit),
            RadiosityView::Smooth | RadiosityView::Gather | RadiosityView::Final => {
                solution.interpolated(vertex.hit)
            }
        };
        let shown = |irradiance| reflected(vertex.shading, irradiance).unwrap_or(Rgb::ZERO);
        [(Aov::Direct, shown(direct)), (Aov::Indirect, shown(indirect))]
    }
}

impl Integrator for ShowRadiosity<'_> {
    fn li(&self, ray: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let walk = Walk {
            // Radiosity knows no wavelengths.
            wavelengths: Wavelengths::Off,
            scene: self.scene,
            max_depth: self.settings.max_depth,
            glossy_samples: self.settings.glossy_samples,
            samples_lights: false,
            media: None,
        };
        let medium = self.camera_media.at(self.scene, ray.ray.origin);
        walk_specular(walk, ray, medium, samples, scratch, &mut {
            |vertex: &Vertex<'_>, _: &mut SampleStream, _: &mut Scratch| self.shade(vertex)
        })
    }
}
