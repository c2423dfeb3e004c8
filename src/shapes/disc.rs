//! Flat discs.

use super::roots::accept;
use super::{
    AreaSample, Patch, ShapeError, SolidAngleSample, error_bound, finite, grown, nearest_by_refining,
    positive_radius, seen_from, solid_angle_density, tangents,
};
use crate::embree::{NearEdge, ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray, unit_f64};
use crate::sampling::warp::{DISC_STRETCH, square_to_disc};
use glam::{DVec2, DVec3, Vec2};
use std::f64::consts::{PI, TAU};

/// A flat disc. Surface parameters: `u` is the azimuth over `2 pi`, `v` the distance from the centre over the
/// radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    center: DVec3,
    radius: f64,
    /// Unit vectors: the normal, and two tangents.
    normal: DVec3,
    x: DVec3,
    y: DVec3,
}

impl Disc {
    /// The disc of `radius` around `center`, perpendicular to `normal`, which may have any length but zero.
    pub fn new(center: DVec3, normal: DVec3, radius: f64) -> Result<Self, ShapeError> {
        let normal = unit_f64(finite(normal)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(normal);
        Ok(Self { center: finite(center)?, radius: positive_radius(radius)?, normal, x, y })
    }

    /// Area of one side.
    pub fn area(&self) -> f64 {
        PI * self.radius * self.radius
    }

    /// Unit normal.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The smallest box around the disc, grown by rounding.
    pub fn bounds(&self) -> Bounds3 {
        let n = self.normal;
        // sqrt(1 - n_i^2), without its cancellation.
        let extent = self.radius * DVec3::new(n.y.hypot(n.z), n.z.hypot(n.x), n.x.hypot(n.y));
        grown(Bounds3 { min: self.center - extent, max: self.center + extent })
    }

    /// Samples a point uniformly over the area.
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        let d = square_to_disc(u).as_dvec2();
        // Rounding in f32 may put the point beyond the rim.
        let d = self.radius * d / d.length().max(1.0);
        let position = self.center + d.x * self.x + d.y * self.y;
        AreaSample { position, normal: self.normal, pdf_area: (1.0 / self.area()) as f32 }
    }

    /// See [`super::EmitterShape::patch`].
    pub(super) fn patch(&self, middle: &AreaSample, half: DVec2) -> Patch {
        Patch::around(middle, (DISC_STRETCH * half.length()).min(2.0) * self.radius, 0.0)
    }

    /// Samples a point uniformly over the area, with its density per solid angle.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        seen_from(reference, self.sample_area(u), self.area())
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        solid_angle_density(1.0 / self.area(), reference, position, self.normal).unwrap_or(0.0)
    }

    /// Parameter of the hit with the plane; `None` outside the disc.
    fn hit(&self, ray: &Ray) -> Option<f64> {
        let (offset, direction) = (ray.origin.as_dvec3() - self.center, ray.direction.as_dvec3());
        let t = -offset.dot(self.normal) / direction.dot(self.normal);
        // The comparison is false for NaN, which a ray in the plane gives.
        let inside = (offset + t * direction).length_squared() <= self.radius * self.radius;
        inside.then_some(t)
    }
}

impl Procedural for Disc {
    fn bounds(&self, _primitive: u32) -> Bounds3 {
        self.bounds()
    }

    fn may_be_in(&self, _primitive: u32, region: &Bounds3) -> bool {
        let half = 0.5 * (region.max - region.min);
        let height = (region.center() - self.center).dot(self.normal);
        let room = 1e-12 * (self.radius + height.abs());
        height.abs() <= self.normal.abs().dot(half) + room
            && region.distances(self.center).0 <= self.radius + room
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, _primitive: u32, ray: &Ray) -> Option<f32> {
        accept(self.hit(ray)?, ray.t_max)
    }

    fn intersect_all(&self, primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        hits.extend(self.intersect(primitive, ray));
    }

    fn refine(&self, _primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        let t = self.hit(ray).unwrap_or(f64::from(t));
        let offset = ray.origin.as_dvec3() - self.center + t * ray.direction.as_dvec3();
        // Projection onto the plane, by coordinates in it.
        let (x, y) = (offset.dot(self.x), offset.dot(self.y));
        let distance = x.hypot(y) / self.radius;
        let uv = Vec2::new((y.atan2(x) / TAU).rem_euclid(1.0) as f32, distance.min(1.0) as f32);
        let edge = NearEdge {
            distance: (1.0 - distance).max(0.0) * self.radius,
            extent: self.radius,
            other: (DVec3::ZERO, DVec3::ZERO),
        };
        let point = SurfacePoint::new(
            self.center + x * self.x + y * self.y,
            error_bound(self.center, self.radius),
            self.normal,
            uv,
        );
        SurfacePoint { edge: Some(edge), ..point }
    }
}
