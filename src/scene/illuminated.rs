//! Illumination maps as declared by the scene.

use crate::shapes::Chart;
use serde::Serialize;

/// How a photon is distributed over the elements of an illumination map, and how these are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum IlluminationKernel {
    /// The photon goes to the element that it hits, and elements are read without interpolation (Jensen & Christensen 1995).
    Box,
    /// The photon is distributed over the four elements around it by bilinear weights, and elements are read by bilinear interpolation:
    /// smooth, and with a third of the variance.
    Tent,
}

/// A surface with coordinates over which illumination is summed up (Jensen & Christensen 1995, section 3.2).
#[derive(Clone, Debug, PartialEq)]
pub struct IlluminatedShape {
    /// Coordinates of all parts of the surface, render space.
    pub charts: Vec<Chart>,
    /// How photons are distributed over elements.
    pub kernel: IlluminationKernel,
    /// Number of elements of the map of diffuse illumination over the whole surface; `None` to derive it from the light that the surface
    /// receives.
    pub elements: Option<u32>,
    /// Number of elements of a caustic map along each side of one of these elements; `None` to derive it from what the camera sees.
    pub refinement: Option<u32>,
}
