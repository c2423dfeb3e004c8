//! Spheres.

use super::roots::{accept, nearest_to, sphere_roots};
use super::{
    AreaSample, Patch, ShapeError, SolidAngleSample, error_bound, finite, grown, nearest_by_refining,
    positive_radius, tangents,
};
use crate::embree::{ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray, unit_f64};
use glam::{DVec3, Vec2};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A sphere with outward normals. Surface parameters: `u` is the azimuth around the y axis over `2 pi`, from +x
/// counter-clockwise as seen from above; `v` the angle from +y over `pi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    center: DVec3,
    radius: f64,
}

impl Sphere {
    /// A sphere of positive `radius`.
    pub fn new(center: DVec3, radius: f64) -> Result<Self, ShapeError> {
        Ok(Self { center: finite(center)?, radius: positive_radius(radius)? })
    }

    /// Centre.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Radius.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Area of the surface.
    pub fn area(&self) -> f64 {
        4.0 * PI * self.radius * self.radius
    }

    /// The smallest box around the sphere, grown by rounding.
    pub fn bounds(&self) -> Bounds3 {
        grown(Bounds3 { min: self.center - self.radius, max: self.center + self.radius })
    }

    /// Samples a point uniformly over the area.
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        let normal = unit_sphere(u);
        let pdf_area = (1.0 / self.area()) as f32;
        AreaSample { position: self.center + self.radius * normal, normal, pdf_area }
    }

    /// See [`super::EmitterShape::patch`].
    pub(super) fn patch(&self, low: Vec2, high: Vec2) -> Patch {
        let middle = self.sample_area(0.5 * (low + high));
        let wide = PI * f64::from(high.y - low.y) > FRAC_PI_2;
        // On a rectangle of latitudes and longitudes the farthest point from the middle is a corner, for up to a quarter turn to both
        // sides: the cosine of the angle then has a single maximum in latitude.
        let corners = [low, high, Vec2::new(low.x, high.y), Vec2::new(high.x, low.y)];
        let angle = |u: Vec2| self.sample_area(u).normal.angle_between(middle.normal);
        let spread = if wide { PI } else { corners.into_iter().map(angle).fold(0.0, f64::max) + 1e-7 };
        Patch::around(&middle, 2.0 * self.radius * (0.5 * spread).sin(), spread)
    }

    /// `1 - cos` of the half angle of the cone of directions from `reference` to the sphere; `None` from inside.
    fn cone(&self, reference: DVec3) -> Option<f64> {
        let distance = (self.center - reference).length();
        let sin = self.radius / distance;
        // The cosine is computed by a product, as 1 - sin^2 cancels close to the surface.
        let cos = ((distance - self.radius) * (distance + self.radius)).sqrt() / distance;
        (distance > self.radius).then(|| sin * sin / (1.0 + cos))
    }

    /// Whether `reference` is inside or at most `slack` outside, which allows for rounded points on the sphere.
    pub fn encloses(&self, reference: DVec3, slack: f64) -> bool {
        (reference - self.center).length() <= self.radius + slack
    }

    /// Samples a direction uniformly over all directions and returns the point where it leaves the sphere. The density is
    /// [`Self::PDF_INSIDE`]. `reference` is inside, or just outside by rounding; then most directions away from the sphere give `None`.
    pub fn sample_inside(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        let (offset, direction) = (reference - self.center, unit_sphere(u));
        let distance = offset.length();
        let along = offset.dot(direction);
        let gap = (self.radius - distance) * (self.radius + distance);
        let root = (along * along + gap).sqrt();
        // The larger root, computed as a quotient where the difference would cancel. It is NaN where the direction misses the sphere.
        let t = if along > 0.0 { gap / (along + root) } else { root - along };
        if !(t > 0.0) {
            return None;
        }
        let normal = unit_f64(offset + t * direction)?;
        let position = self.center + self.radius * normal;
        Some(SolidAngleSample { position, normal, pdf_solid_angle: Self::PDF_INSIDE })
    }

    /// Density per solid angle of [`Self::sample_inside`].
    pub const PDF_INSIDE: f32 = (0.25 / PI) as f32;

    /// Samples a point of the visible cap, uniformly over the solid angle of the sphere. From inside or on the surface that is the full
    /// solid angle. The computation is stable for spheres of 1e-30 sr and for references on the surface.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        let Some(one_minus_cos) = self.cone(reference) else {
            return self.sample_inside(reference, u);
        };
        let away = reference - self.center;
        let distance = away.length();
        let axis = away / distance;
        let drop = f64::from(u.x) * one_minus_cos;
        let sin_squared = drop * (2.0 - drop);
        // The nearer intersection along the direction at this angle from the axis: the smaller root, computed as a quotient.
        let chord = (self.radius * self.radius - distance * distance * sin_squared).max(0.0).sqrt();
        let gap = (distance - self.radius) * (distance + self.radius);
        let t = gap / (distance * (1.0 - drop) + chord);
        // The same point as seen from the centre.
        let sin_center = (t * sin_squared.sqrt() / self.radius).min(1.0);
        let cos_center = ((1.0 - sin_center) * (1.0 + sin_center)).sqrt();
        let (x, y) = tangents(axis);
        let (s, c) = (TAU * f64::from(u.y)).sin_cos();
        let normal = unit_f64(axis * cos_center + (x * c + y * s) * sin_center)?;
        let pdf_solid_angle = cone_density(one_minus_cos)?;
        Some(SolidAngleSample { position: self.center + self.radius * normal, normal, pdf_solid_angle })
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        match self.cone(reference) {
            Some(one_minus_cos) => cone_density(one_minus_cos).unwrap_or(0.0),
            // There is no direction from a point to itself.
            None if position == reference => 0.0,
            None => Self::PDF_INSIDE,
        }
    }
}

/// Samples a direction uniformly over the sphere.
fn unit_sphere(u: Vec2) -> DVec3 {
    let drop = 2.0 * f64::from(u.x);
    let sin = (drop * (2.0 - drop)).sqrt();
    let (s, c) = (TAU * f64::from(u.y)).sin_cos();
    DVec3::new(sin * c, sin * s, 1.0 - drop)
}

/// Density of the uniform distribution over a cone; `None` where `f32` cannot hold it.
fn cone_density(one_minus_cos: f64) -> Option<f32> {
    let pdf = (1.0 / (TAU * one_minus_cos)) as f32;
    pdf.is_finite().then_some(pdf)
}

impl Procedural for Sphere {
    fn bounds(&self, _primitive: u32) -> Bounds3 {
        self.bounds()
    }

    fn may_be_in(&self, _primitive: u32, region: &Bounds3) -> bool {
        let (low, high) = region.distances(self.center);
        // Tolerance for the rounding of distances.
        let room = 1e-12 * (self.radius + high);
        low - room <= self.radius && self.radius <= high + room
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, _primitive: u32, ray: &Ray) -> Option<f32> {
        let roots = sphere_roots(ray.origin.as_dvec3() - self.center, ray.direction.as_dvec3(), self.radius)?;
        roots.into_iter().find_map(|t| accept(t, ray.t_max))
    }

    fn intersect_all(&self, _primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        let offset = ray.origin.as_dvec3() - self.center;
        if let Some(roots) = sphere_roots(offset, ray.direction.as_dvec3(), self.radius) {
            hits.extend(roots.into_iter().filter_map(|t| accept(t, ray.t_max)));
        }
    }

    fn refine(&self, _primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        let (offset, direction) = (ray.origin.as_dvec3() - self.center, ray.direction.as_dvec3());
        let t = sphere_roots(offset, direction, self.radius)
            .and_then(|roots| nearest_to(t, roots))
            .unwrap_or(f64::from(t));
        // The point is projected onto the surface along its direction from the centre.
        let normal = unit_f64(offset + t * direction).unwrap_or(DVec3::Y);
        let azimuth = (-normal.z).atan2(normal.x) / TAU;
        let polar = normal.x.hypot(normal.z).atan2(normal.y) / PI;
        let uv = Vec2::new(azimuth.rem_euclid(1.0) as f32, polar as f32);
        SurfacePoint::new(
            self.center + self.radius * normal,
            error_bound(self.center, self.radius),
            normal,
            uv,
        )
    }
}
