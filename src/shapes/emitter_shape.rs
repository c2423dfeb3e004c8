//! The shape of an area light.

use super::{AreaSample, Cylinder, Disc, Quad, SolidAngleSample, Sphere, Triangle};
use crate::math::Bounds3;
use glam::{DVec3, Vec2};

/// The shape of an area light. Each function calls that of the contained shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EmitterShape {
    /// A sphere.
    Sphere(Sphere),
    /// The side of a cylinder.
    Cylinder(Cylinder),
    /// A disc.
    Disc(Disc),
    /// A parallelogram.
    Quad(Quad),
    /// One triangle of a mesh.
    Triangle(Triangle),
}

/// Calls a function of the contained shape.
macro_rules! dispatch {
    ($self:ident, $shape:ident => $call:expr) => {
        match $self {
            EmitterShape::Sphere($shape) => $call,
            EmitterShape::Cylinder($shape) => $call,
            EmitterShape::Disc($shape) => $call,
            EmitterShape::Quad($shape) => $call,
            EmitterShape::Triangle($shape) => $call,
        }
    };
}

impl EmitterShape {
    /// Area of one side.
    pub fn area(&self) -> f64 {
        dispatch!(self, shape => shape.area())
    }

    /// A bounding box of the shape.
    pub fn bounds(&self) -> Bounds3 {
        dispatch!(self, shape => shape.bounds())
    }

    /// Samples a point uniformly over the area.
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        dispatch!(self, shape => shape.sample_area(u))
    }

    /// Samples a point as seen from `reference`, by solid angle where the shape supports it, otherwise by area; `None` where the density is
    /// not positive and finite.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        dispatch!(self, shape => shape.sample_solid_angle(reference, u))
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        dispatch!(self, shape => shape.pdf_solid_angle(reference, position))
    }
}
