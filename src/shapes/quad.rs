//! Parallelograms, and sampling of rectangles by solid angle.

use super::{AreaSample, Patch, ShapeError, SolidAngleSample, finite, seen_from, solid_angle_density};
use crate::math::{Bounds3, unit_f64};
use glam::{DVec2, DVec3, Vec2};

/// Solid angle in sr below which a rectangle is sampled by area instead. Cancellation leaves an error of about 1e-15 sr in the solid
/// angle, so at this size densities and points are still accurate to `f32`. The densities by area and by solid angle of a rectangle of
/// 1e-7 sr, 0.3 mrad across, agree to 0.1 %, unless it is seen edge-on.
pub const SMALLEST_SPHERICAL_RECTANGLE: f64 = 1e-7;

/// Largest cosine between the edges of a rectangle, which allows for the rounding of a rotation in `f64`.
const RIGHT_ANGLE_TOLERANCE: f64 = 1e-10;

/// A parallelogram `corner + s edge_u + t edge_v` with `s, t` in `[0, 1]`; normal along `edge_u x edge_v`.
/// Sampled here, intersected by Embree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quad {
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    normal: DVec3,
    area: f64,
    is_rectangle: bool,
}

impl Quad {
    /// The parallelogram with these edges, which must not be parallel.
    pub fn new(corner: DVec3, edge_u: DVec3, edge_v: DVec3) -> Result<Self, ShapeError> {
        let cross = finite(finite(edge_u)?.cross(finite(edge_v)?))?;
        let normal = unit_f64(cross).ok_or(ShapeError::NoArea)?;
        let is_rectangle =
            edge_u.dot(edge_v).abs() <= RIGHT_ANGLE_TOLERANCE * edge_u.length() * edge_v.length();
        Ok(Self { corner: finite(corner)?, edge_u, edge_v, normal, area: cross.length(), is_rectangle })
    }

    /// Area of one side.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Whether the corners are right angles, so that directions to it are sampled by solid angle.
    pub fn is_rectangle(&self) -> bool {
        self.is_rectangle
    }

    /// Unit normal.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The smallest box around the parallelogram.
    pub fn bounds(&self) -> Bounds3 {
        let (a, b, c) = (self.corner, self.corner + self.edge_u, self.corner + self.edge_v);
        Bounds3::of_points([a, b, c, b + self.edge_v])
    }

    /// Samples a point uniformly over the area.
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> AreaSample {
        let position = self.corner + f64::from(u.x) * self.edge_u + f64::from(u.y) * self.edge_v;
        AreaSample { position, normal: self.normal, pdf_area: (1.0 / self.area) as f32 }
    }

    /// See [`super::EmitterShape::patch`].
    pub(super) fn patch(&self, middle: &AreaSample, half: DVec2) -> Patch {
        let (s, t) = (half.x * self.edge_u, half.y * self.edge_v);
        Patch::around(middle, (s + t).length().max((s - t).length()), 0.0)
    }

    /// Samples a point uniformly over the solid angle of a rectangle, by the map of Ureña, Fajardo & King (2013). A parallelogram without
    /// right angles or a rectangle of less than [`SMALLEST_SPHERICAL_RECTANGLE`] is sampled uniformly over its area instead.
    pub fn sample_solid_angle(&self, reference: DVec3, u: Vec2) -> Option<SolidAngleSample> {
        let Some(rectangle) = self.spherical(reference) else {
            return seen_from(reference, self.sample_area(u), self.area);
        };
        let s_t = rectangle.sample(u.as_dvec2());
        Some(SolidAngleSample {
            position: self.corner + s_t.x * self.edge_u + s_t.y * self.edge_v,
            normal: self.normal,
            pdf_solid_angle: (1.0 / rectangle.solid_angle) as f32,
        })
    }

    /// Density per solid angle of [`Self::sample_solid_angle`] at the point `position` of the surface.
    pub fn pdf_solid_angle(&self, reference: DVec3, position: DVec3) -> f32 {
        match self.spherical(reference) {
            Some(rectangle) => (1.0 / rectangle.solid_angle) as f32,
            None => solid_angle_density(1.0 / self.area, reference, position, self.normal).unwrap_or(0.0),
        }
    }

    /// The rectangle as seen from `reference`, where it is to be sampled by solid angle.
    fn spherical(&self, reference: DVec3) -> Option<SphericalRectangle> {
        if !self.is_rectangle {
            return None;
        }
        let rectangle = SphericalRectangle::new(self, reference);
        // From a point in its plane the rectangle has no solid angle, or a half space at distance zero. On an edge the value is NaN.
        let covers = rectangle.z0 < 0.0 && rectangle.solid_angle >= SMALLEST_SPHERICAL_RECTANGLE;
        covers.then_some(rectangle)
    }
}

/// A rectangle projected on the unit sphere (Ureña, Fajardo & King, "An Area-Preserving Parametrization for
/// Spherical Rectangles", EGSR 2013), in the paper's symbols: the rectangle spans `[x0, x1] x [y0, y1]` in
/// the plane at distance `-z0 >= 0` from the reference.
///
/// The paper's angles are `g = acos(-n_i.z n_j.z)` between the planes through adjacent edges. This code stores `g - pi/2`, from an arc
/// tangent. The arc cosine loses half of the digits where a rectangle is seen edge-on, and the sum of four angles minus `2 pi` loses more
/// than a sum of four small angles.
struct SphericalRectangle {
    x: DVec2,
    y: DVec2,
    z0: f64,
    /// `n_0.z` and `n_2.z`, of the planes through the edges `y = y0` and `y = y1`.
    b: DVec2,
    /// `(g_2 - pi/2) + (g_3 - pi/2)`, which is `pi - k` of the paper.
    offset: f64,
    solid_angle: f64,
}

impl SphericalRectangle {
    fn new(quad: &Quad, reference: DVec3) -> Self {
        let (width, height) = (quad.edge_u.length(), quad.edge_v.length());
        let d = quad.corner - reference;
        let (x0, y0) = (d.dot(quad.edge_u) / width, d.dot(quad.edge_v) / height);
        let (x, y) = (DVec2::new(x0, x0 + width), DVec2::new(y0, y0 + height));
        let distance = d.dot(quad.normal).abs();
        // Unit normals of the planes through the edges: each has a component along z and one along y or x.
        let normal = |along_z: f64| DVec2::new(along_z, distance) / along_z.hypot(distance);
        let (n0, n1, n2, n3) = (normal(-y.x), normal(x.y), normal(y.y), normal(-x.x));
        // asin of the product of the z components; the cosine is the length of the cross product.
        let excess = |a: DVec2, b: DVec2| {
            let cosine = a.y.hypot(a.x * b.y);
            (a.x * b.x).atan2(cosine)
        };
        let (g0, g1, g2, g3) = (excess(n0, n1), excess(n1, n2), excess(n2, n3), excess(n3, n0));
        Self {
            x,
            y,
            z0: -distance,
            b: DVec2::new(n0.x, n2.x),
            offset: g2 + g3,
            solid_angle: g0 + g1 + g2 + g3,
        }
    }

    /// The point `(s, t)` in `[0, 1]^2` of the rectangle for `u` in `[0, 1)^2`.
    fn sample(&self, u: DVec2) -> DVec2 {
        let distance = -self.z0;
        // 1. cu from the area to the left of it; phi is au - pi of the paper.
        let phi = u.x * self.solid_angle - self.offset;
        let (sin, cos) = phi.sin_cos();
        let fu = (cos * self.b.x + self.b.y) / sin;
        // 2. xu = cu |z0| / sqrt(1 - cu^2) with cu = 1 / sqrt(fu^2 + b0^2); 1 - b0^2 is computed as a square, which
        // avoids a difference of two numbers near one.
        let a0 = distance / self.y.x.hypot(distance);
        let root = ((fu.abs() - a0) * (fu.abs() + a0)).max(0.0).sqrt();
        let xu = (distance / root).copysign(fu).max(self.x.x).min(self.x.y);
        // 3. yv, uniform in the sine of the elevation.
        let d = xu.hypot(distance);
        let (h0, h1) = (self.y.x / self.y.x.hypot(d), self.y.y / self.y.y.hypot(d));
        let hv = h0 + u.y * (h1 - h0);
        let yv = (hv * d / ((1.0 - hv) * (1.0 + hv)).sqrt()).max(self.y.x).min(self.y.y);
        let s = (xu - self.x.x) / (self.x.y - self.x.x);
        let t = (yv - self.y.x) / (self.y.y - self.y.x);
        DVec2::new(s, t).clamp(DVec2::ZERO, DVec2::ONE)
    }
}
