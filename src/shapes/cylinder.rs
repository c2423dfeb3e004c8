//! Open cylinders.

use super::roots::{accept, nearest_to, sphere_roots};
use super::{
    AreaSample, Patch, ShapeError, SolidAngleSample, distances_2d, error_bound, finite, grown,
    nearest_by_refining, positive_radius, seen_from, solid_angle_density, tangents,
};
use crate::embree::{ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray, unit_f64};
use glam::{DVec2, DVec3, Vec2};
use std::f64::consts::TAU;

/// The side of a circular cylinder, open at both ends, with outward normals. Surface parameters: `u` is the azimuth
/// over `2 pi`, `v` the height from the base over the whole height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    base: DVec3,
    height: f64,
    radius: f64,
    /// Unit vectors: the axis from base to top, and two perpendicular to it.
    axis: DVec3,
    x: DVec3,
    y: DVec3,
}

/// A ray in the cylinder's frame.
struct LocalRay {
    origin: DVec3,
    direction: DVec3,
}

impl LocalRay {
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

impl Cylinder {
    /// The cylinder of `radius` between the centres of its ends, which must differ.
    pub fn new(base: DVec3, top: DVec3, radius: f64) -> Result<Self, ShapeError> {
        let along = finite(finite(top)? - finite(base)?)?;
        let axis = unit_f64(along).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        Ok(Self { base, height: along.length(), radius: positive_radius(radius)?, axis, x, y })
    }

    /// Area of the side, without the ends.
    pub fn area(&self) -> f64 {
        TAU * self.radius * self.height
    }

    /// The smallest box around the side, grown by rounding.
    pub fn bounds(&self) -> Bounds3 {
        let across = self.radius * complement(self.axis);
        let top = self.base + self.height * self.axis;
        grown(Bounds3 { min: self.base.min(top) - across, max: self.base.max(top) + across })
    }

    /// Samples a point uniformly over the area.
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        let (s, c) = (TAU * f64::from(u.x)).sin_cos();
        let normal = self.x * c + self.y * s;
        let position = self.base + (f64::from(u.y) * self.height) * self.axis + self.radius * normal;
        AreaSample { position, normal, pdf_area: (1.0 / self.area()) as f32 }
    }

    /// See [`super::EmitterShape::patch`].
    pub(super) fn patch(&self, middle: &AreaSample, half: DVec2) -> Patch {
        let spread = TAU * half.x;
        let across = 2.0 * self.radius * (0.5 * spread).sin();
        Patch::around(middle, across.hypot(half.y * self.height), spread)
    }

    /// Samples a point uniformly over the area, with its density per solid angle. Half of the points face away from a reference outside;
    /// their inner side may still be visible through an open end.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        seen_from(reference, self.sample_area(u), self.area())
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        let offset = position - self.base;
        let normal = (self.x * offset.dot(self.x) + self.y * offset.dot(self.y)) / self.radius;
        solid_angle_density(1.0 / self.area(), reference, position, normal).unwrap_or(0.0)
    }

    fn local(&self, ray: &Ray) -> LocalRay {
        let rotate = |v: DVec3| DVec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.axis));
        LocalRay {
            origin: rotate(ray.origin.as_dvec3() - self.base),
            direction: rotate(ray.direction.as_dvec3()),
        }
    }

    /// Parameters of hits on the side itself, without its infinite continuation, in ascending order.
    fn hits(&self, ray: &LocalRay) -> impl Iterator<Item = f64> {
        let across = |v: DVec3| DVec3::new(v.x, v.y, 0.0);
        let (start, slope, height) = (ray.origin.z, ray.direction.z, self.height);
        sphere_roots(across(ray.origin), across(ray.direction), self.radius)
            .into_iter()
            .flatten()
            .filter(move |t| (0.0..=height).contains(&(start + t * slope)))
    }
}

/// Sine of the angle between the unit vector `v` and each axis, without the cancellation of `1 - v_i^2`.
fn complement(v: DVec3) -> DVec3 {
    DVec3::new(v.y.hypot(v.z), v.z.hypot(v.x), v.x.hypot(v.y))
}

impl Procedural for Cylinder {
    fn bounds(&self, _primitive: u32) -> Bounds3 {
        self.bounds()
    }

    fn may_be_in(&self, _primitive: u32, region: &Bounds3) -> bool {
        let (half, center) = (0.5 * (region.max - region.min), region.center() - self.base);
        let turned = |v: DVec3, axis: DVec3| (v.dot(axis), half.dot(axis.abs()));
        let [x, y, z] = [self.x, self.y, self.axis].map(|axis| turned(center, axis));
        let room = 1e-12 * (self.radius + self.height + center.length() + half.length());
        let (low, high) = distances_2d([x, y]);
        z.0 + z.1 >= -room
            && z.0 - z.1 <= self.height + room
            && low - room <= self.radius
            && self.radius <= high + room
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, _primitive: u32, ray: &Ray) -> Option<f32> {
        self.hits(&self.local(ray)).find_map(|t| accept(t, ray.t_max))
    }

    fn intersect_all(&self, _primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        hits.extend(self.hits(&self.local(ray)).filter_map(|t| accept(t, ray.t_max)));
    }

    fn refine(&self, _primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        let local = self.local(ray);
        let point = local.at(nearest_to(t, self.hits(&local)).unwrap_or(f64::from(t)));
        // Projection onto the surface: radially from the axis, and between the ends.
        let distance = point.x.hypot(point.y);
        let across = if distance > 0.0 { DVec2::new(point.x, point.y) / distance } else { DVec2::X };
        let along = point.z.clamp(0.0, self.height);
        let normal = self.x * across.x + self.y * across.y;
        let azimuth = across.y.atan2(across.x) / TAU;
        let uv = Vec2::new(azimuth.rem_euclid(1.0) as f32, (along / self.height) as f32);
        SurfacePoint::new(
            self.base + along * self.axis + self.radius * normal,
            error_bound(self.base, self.height + self.radius),
            normal,
            uv,
        )
    }
}
