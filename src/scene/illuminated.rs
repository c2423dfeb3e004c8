//! What the scene says of illumination maps.

use crate::shapes::Chart;
use serde::Serialize;

/// How a photon is spread over the elements of an illumination map, and how these are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum IlluminationKernel {
    /// Into the element that it hits, and read as it is (Jensen & Christensen 1995).
    Box,
    /// Onto the four elements around it by bilinear weights, and read by bilinear interpolation: smooth, and with a third of
    /// the variance.
    Tent,
}

/// A surface with coordinates over which illumination is summed up (Jensen & Christensen 1995, section 3.2).
#[derive(Clone, Debug, PartialEq)]
pub struct IlluminatedShape {
    /// Coordinates of all parts of the surface, render space.
    pub charts: Vec<Chart>,
    /// How photons are spread.
    pub kernel: IlluminationKernel,
    /// Elements of the map of diffuse illumination over the whole surface; `None` to go by the light that it receives.
    pub elements: Option<u32>,
    /// Elements of a caustic map along each side of one of these; `None` to go by what the camera sees.
    pub refinement: Option<u32>,
}
