//! Triangles of emitting meshes.

use super::{AreaSample, Patch, ShapeError, SolidAngleSample, finite, seen_from, solid_angle_density};
use crate::math::{Bounds3, unit_f64};
use crate::sampling::warp::square_to_triangle;
use glam::{DVec2, DVec3, Vec2};

/// One triangle of an emitting mesh. It is sampled here and intersected by Embree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    corner: DVec3,
    edge_b: DVec3,
    edge_c: DVec3,
    normal: DVec3,
    area: f64,
}

impl Triangle {
    /// The triangle with these corners, counter-clockwise as seen from the side of the normal. Callers must leave out triangles of a mesh
    /// without area.
    pub fn new(a: DVec3, b: DVec3, c: DVec3) -> Result<Self, ShapeError> {
        let (corner, edge_b, edge_c) = (finite(a)?, finite(b)? - a, finite(c)? - a);
        let cross = finite(edge_b.cross(edge_c))?;
        let normal = unit_f64(cross).ok_or(ShapeError::NoArea)?;
        Ok(Self { corner, edge_b, edge_c, normal, area: 0.5 * cross.length() })
    }

    /// Area of one side.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Unit normal.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The smallest box around the triangle.
    pub fn bounds(&self) -> Bounds3 {
        Bounds3::of_points([self.corner, self.corner + self.edge_b, self.corner + self.edge_c])
    }

    /// Samples a point uniformly over the area.
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        let barycentric = square_to_triangle(u).as_dvec2();
        let position = self.corner + barycentric.x * self.edge_b + barycentric.y * self.edge_c;
        AreaSample { position, normal: self.normal, pdf_area: (1.0 / self.area) as f32 }
    }

    /// Barycentric coordinates of the second and third corner for a point of the triangle.
    pub fn barycentric(&self, position: DVec3) -> [f32; 2] {
        let (from_corner, twice) = (position - self.corner, 2.0 * self.area);
        let part = |cross: DVec3| (cross.dot(self.normal) / twice) as f32;
        [part(from_corner.cross(self.edge_c)), part(self.edge_b.cross(from_corner))]
    }

    /// See [`super::EmitterShape::patch`].
    pub(super) fn patch(&self, middle: &AreaSample, half: DVec2) -> Patch {
        // The map from the square is linear on each side of its diagonal; the bound uses the larger slope.
        let (b, c) = (self.edge_b.length(), self.edge_c.length());
        let across = 0.5 * (self.edge_b - self.edge_c).length();
        Patch::around(middle, half.x * across.max(b) + half.y * across.max(c), 0.0)
    }

    /// Samples a point uniformly over the area, with its density per solid angle.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        seen_from(reference, self.sample_area(u), self.area)
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        solid_angle_density(1.0 / self.area, reference, position, self.normal).unwrap_or(0.0)
    }
}
