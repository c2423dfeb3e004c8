//! Closed bodies under affine transforms: sphere, box, cone, torus and lens.

use super::span::Span;
use super::torus::torus_roots;
use super::{Chart, ShapeError, distances_2d, error_bound, finite, grown, positive_radius, tangents};
use crate::embree::SurfacePoint;
use crate::math::{Bounds3, Ray, unit_f64};
use arrayvec::ArrayVec;
use glam::{DAffine3, DMat3, DVec2, DVec3, Vec2};
use std::f64::consts::TAU;

/// A closed body under any affine transform, used by [`super::Csg`]. Normals point outward.
///
/// Each body has a local space in which it has size one. Rays are transformed to it in `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    form: Form,
    center: DVec3,
    to_object: DMat3,
    to_local: DMat3,
}

/// A body in local space.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Radius 1 around zero.
    Sphere,
    /// `[-1, 1]^3`.
    Box,
    /// A cone around z from -1 to 1 with radius `middle - taper z`: 1 at the base, 0 to 1 at the top. Discs close it.
    Cone { middle: f64, taper: f64 },
    /// A torus around z whose middle circle has radius 1.
    Torus { minor: f64 },
    /// A lens around z, between a front through `z = front` and a back through `z = -back`, within the cylinder of radius 1. Curvatures are
    /// one over the radius, 0 for a plane.
    Lens { front: f64, back: f64, front_curvature: f64, back_curvature: f64 },
}

/// Most crossings of a line with one body.
pub(super) const MOST_CROSSINGS: usize = 4;

/// Crossings of a line with a body, as parameter and face, in ascending order. The line starts outside, and each crossing changes sides.
pub(super) type SolidCrossings = ArrayVec<(f64, u8), MOST_CROSSINGS>;

/// Side, base and top of a cone.
const SIDE: u8 = 0;
const BASE: u8 = 1;
const TOP: u8 = 2;
/// Faces of a lens.
const FRONT: u8 = 0;
const BACK: u8 = 1;
const RIM: u8 = 2;

impl Solid {
    fn new(form: Form, center: DVec3, to_object: DMat3) -> Result<Self, ShapeError> {
        let to_local = to_object.inverse();
        if !(finite(center)?.is_finite() && to_object.is_finite() && to_local.is_finite()) {
            return Err(ShapeError::NoArea);
        }
        Ok(Self { form, center, to_object, to_local })
    }

    /// A ball.
    pub fn sphere(center: DVec3, radius: f64) -> Result<Self, ShapeError> {
        Self::new(Form::Sphere, center, DMat3::from_diagonal(DVec3::splat(positive_radius(radius)?)))
    }

    /// The axis-aligned box between two opposite corners.
    pub fn cuboid(min: DVec3, max: DVec3) -> Result<Self, ShapeError> {
        let half = 0.5 * (finite(max)? - finite(min)?);
        if !half.cmpgt(DVec3::ZERO).all() {
            return Err(ShapeError::NoArea);
        }
        Self::new(Form::Box, min + half, DMat3::from_diagonal(half))
    }

    /// A cylinder with both ends closed.
    pub fn cylinder(base: DVec3, top: DVec3, radius: f64) -> Result<Self, ShapeError> {
        Self::cone(base, top, radius, radius)
    }

    /// A cone with a closed base. Where `top_radius` is not zero, the cone is truncated and closed at the top. One of the radii may be
    /// zero.
    pub fn cone(base: DVec3, top: DVec3, base_radius: f64, top_radius: f64) -> Result<Self, ShapeError> {
        let (base, top, wide, narrow) = if base_radius >= top_radius {
            (base, top, base_radius, top_radius)
        } else {
            (top, base, top_radius, base_radius)
        };
        let wide = positive_radius(wide)?;
        if !(narrow >= 0.0) {
            return Err(ShapeError::Radius(narrow));
        }
        let half = 0.5 * (finite(top)? - finite(base)?);
        let axis = unit_f64(half).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        let ratio = narrow / wide;
        let form = Form::Cone { middle: 0.5 * (1.0 + ratio), taper: 0.5 * (1.0 - ratio) };
        Self::new(form, base + half, DMat3::from_cols(x * wide, y * wide, half))
    }

    /// A torus: all points within `minor` of a circle of radius `major` around `axis`. `minor` must be below `major`.
    pub fn torus(center: DVec3, axis: DVec3, major: f64, minor: f64) -> Result<Self, ShapeError> {
        let (major, minor) = (positive_radius(major)?, positive_radius(minor)?);
        if !(minor < major) {
            return Err(ShapeError::Radius(minor));
        }
        let axis = unit_f64(finite(axis)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        let frame = DMat3::from_cols(x * major, y * major, axis * major);
        Self::new(Form::Torus { minor: minor / major }, center, frame)
    }

    /// A lens: the intersection of two spheres and a cylinder of radius `aperture` around `axis`. `thickness` is measured on the axis,
    /// half of it on each side of `center`. The surface towards `axis` has the radius of curvature `front`, the other one `back`;
    /// infinity makes a plane. Where the spheres meet inside the aperture, the lens ends there.
    pub fn lens(
        center: DVec3,
        axis: DVec3,
        aperture: f64,
        thickness: f64,
        [front, back]: [f64; 2],
    ) -> Result<Self, ShapeError> {
        let (aperture, thickness) = (positive_radius(aperture)?, positive_radius(thickness)?);
        for radius in [front, back] {
            if radius != f64::INFINITY {
                positive_radius(radius)?;
            }
            // Otherwise the far side of the sphere would cut the lens.
            if !(2.0 * radius >= thickness) {
                return Err(ShapeError::Radius(radius));
            }
        }
        let axis = unit_f64(finite(axis)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        let half = 0.5 * thickness / aperture;
        let form = Form::Lens {
            front: half,
            back: half,
            front_curvature: aperture / front,
            back_curvature: aperture / back,
        };
        Self::new(form, center, DMat3::from_cols(x * aperture, y * aperture, axis * aperture))
    }

    /// Charts of the faces of a box, with outward normals; `None` for other bodies.
    pub(super) fn charts(&self) -> Option<Vec<Chart>> {
        if self.form != Form::Box {
            return None;
        }
        let axes = [self.to_object.x_axis, self.to_object.y_axis, self.to_object.z_axis];
        let turn = if self.to_object.determinant() < 0.0 { -1.0 } else { 1.0 };
        let face = |axis: usize, side: f64| {
            let (out, u, v) = (axes[axis], axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            // The sign makes the normal point outward.
            let u = u * (side * turn);
            Chart::parallelogram(self.center + out * side - u - v, 2.0 * u, 2.0 * v).ok()
        };
        (0..6)
            .map(|face_number| face(face_number / 2, if face_number % 2 == 0 { 1.0 } else { -1.0 }))
            .collect()
    }

    /// The transformed body. The transform must be invertible.
    pub fn transformed(&self, transform: &DAffine3) -> Result<Self, ShapeError> {
        let center = transform.transform_point3(self.center);
        Self::new(self.form, center, transform.matrix3 * self.to_object)
    }

    /// Number of faces.
    pub(super) fn faces(&self) -> u8 {
        match self.form {
            Form::Sphere | Form::Torus { .. } => 1,
            Form::Box => 6,
            Form::Cone { .. } | Form::Lens { .. } => 3,
        }
    }

    /// Radius of a sphere around the origin of local space that contains the body.
    fn reach(&self) -> f64 {
        match self.form {
            Form::Sphere => 1.0,
            Form::Box => 3f64.sqrt(),
            Form::Cone { .. } => 2f64.sqrt(),
            Form::Torus { minor } => 1.0 + minor,
            Form::Lens { front, back, .. } => 1f64.hypot(front.max(back)),
        }
    }

    /// A bounding sphere of the body.
    pub(super) fn around(&self) -> (DVec3, f64) {
        // The Frobenius norm bounds the growth of vectors, but for a scaled rotation it is too large by sqrt(3).
        let [x, y, z] = [self.to_object.x_axis, self.to_object.y_axis, self.to_object.z_axis];
        let norm = (x.length_squared() + y.length_squared() + z.length_squared()).sqrt();
        let longest = x.length().max(y.length()).max(z.length());
        let slack = 1e-9 * longest * longest;
        let right = x.dot(y).abs() <= slack && y.dot(z).abs() <= slack && z.dot(x).abs() <= slack;
        (self.center, self.reach() * if right { longest } else { norm } * (1.0 + 1e-9))
    }

    /// A bounding box of the body.
    pub fn bounds(&self) -> Bounds3 {
        let rows = self.to_object.transpose();
        let [x, y, z] = [rows.x_axis, rows.y_axis, rows.z_axis];
        // Half extents along each axis: of an ellipsoid, a box, or a body of revolution around z.
        let round =
            |row: DVec3, radius: f64, height: f64| radius * row.truncate().length() + height * row.z.abs();
        let half = [x, y, z].map(|row| match self.form {
            Form::Sphere => row.length(),
            Form::Box => row.abs().element_sum(),
            Form::Cone { .. } => round(row, 1.0, 1.0),
            Form::Torus { minor } => row.truncate().length() + minor * row.length(),
            Form::Lens { front, back, .. } => round(row, 1.0, front.max(back)),
        });
        let half = DVec3::from_array(half);
        grown(Bounds3 { min: self.center - half, max: self.center + half })
    }

    /// Crossings of the line through `ray` with the surface. The errors are a few roundings in `f64` of the distance of the origin and of
    /// the size of the body. The result is empty for a direction of zero and for NaN.
    #[inline]
    pub(super) fn crossings(&self, ray: &Ray) -> SolidCrossings {
        let mut found = SolidCrossings::new();
        let origin = self.to_local * (ray.origin.as_dvec3() - self.center);
        let direction = self.to_local * ray.direction.as_dvec3();
        let length = direction.length();
        let u = direction / length;
        // Relative to the point closest to the centre, all numbers have size one.
        let start = -origin.dot(u);
        let p = origin + start * u;
        let reach = self.reach();
        if !(p.length_squared() < reach * reach && length < f64::INFINITY) {
            return found;
        }
        let mut push = |(s, face): (f64, u8)| found.push(((start + s) / length, face));
        match self.form {
            Form::Sphere => {
                let distance = p.length();
                let half = ((1.0 - distance) * (1.0 + distance)).max(0.0).sqrt();
                push((-half, 0));
                push((half, 0));
            }
            Form::Torus { minor } => torus_roots(p, u, minor).into_iter().for_each(|s| push((s, 0))),
            _ => self.span(p, u).ends().into_iter().flatten().for_each(push),
        }
        found
    }

    /// The span of the line `p + s u` inside the body, for the convex forms with several faces.
    fn span(&self, p: DVec3, u: DVec3) -> Span {
        match self.form {
            Form::Sphere | Form::Torus { .. } => Span::ALL,
            Form::Box => {
                Span::slab(p.x, u.x, 0, 1).and(Span::slab(p.y, u.y, 2, 3)).and(Span::slab(p.z, u.z, 4, 5))
            }
            Form::Cone { middle, taper } => {
                let w = middle - taper * p.z;
                let a = u.truncate().length_squared() - taper * taper * u.z * u.z;
                let b = p.truncate().dot(u.truncate()) + taper * w * u.z;
                let c = p.truncate().length_squared() - w * w;
                // The quadric is a double cone. A rising line is in the half below the apex before it reaches the apex.
                Span::quadric(a, b, c, SIDE, u.z > 0.0).and(Span::slab(p.z, u.z, BASE, TOP))
            }
            Form::Lens { front, back, front_curvature, back_curvature } => {
                let cap = |apex: f64, curvature: f64, side: f64, face: u8| {
                    let q = p - DVec3::new(0.0, 0.0, side * apex);
                    let b = curvature * q.dot(u) + side * u.z;
                    let c = curvature * q.length_squared() + 2.0 * side * q.z;
                    Span::quadric(curvature, b, c, face, false)
                };
                let flat = u.truncate();
                let rim = Span::quadric(
                    flat.length_squared(),
                    p.truncate().dot(flat),
                    p.truncate().length_squared() - 1.0,
                    RIM,
                    false,
                );
                cap(front, front_curvature, 1.0, FRONT).and(cap(back, back_curvature, -1.0, BACK)).and(rim)
            }
        }
    }

    /// Returns false where no point of the body's surface is in the box.
    pub(super) fn may_be_in(&self, region: &Bounds3) -> bool {
        // A box around `region` in local space.
        let center = self.to_local * (region.center() - self.center);
        let half = 0.5 * (region.max - region.min);
        let rows = self.to_local.transpose();
        let half =
            DVec3::new(rows.x_axis.abs().dot(half), rows.y_axis.abs().dot(half), rows.z_axis.abs().dot(half));
        let half = half + 1e-12 * (1.0 + center.abs() + half);
        let own = Bounds3 { min: center - half, max: center + half };
        let (low, high) = distances_2d([(center.x, half.x), (center.y, half.y)]);
        let meets = |from: f64, to: f64, at: f64| from <= at && at <= to;
        match self.form {
            Form::Sphere => {
                let (low, high) = own.distances(DVec3::ZERO);
                meets(low, high, 1.0)
            }
            Form::Box => {
                let is_inside = own.min.cmpgt(DVec3::NEG_ONE).all() && own.max.cmplt(DVec3::ONE).all();
                own.min.cmple(DVec3::ONE).all() && own.max.cmpge(DVec3::NEG_ONE).all() && !is_inside
            }
            Form::Cone { middle, taper } => {
                let (bottom, top) = (own.min.z.max(-1.0), own.max.z.min(1.0));
                let (wide, narrow) = (middle - taper * bottom, middle - taper * top);
                let is_inside = own.min.z > -1.0 && own.max.z < 1.0 && high < narrow;
                bottom <= top && low <= wide && !is_inside
            }
            Form::Torus { minor } => {
                // In the half plane of radius and height, the torus is a circle around (1, 0).
                let place = (0.5 * (low + high), 0.5 * (high - low));
                let (low, high) = distances_2d([(place.0 - 1.0, place.1), (center.z, half.z)]);
                meets(low, high, minor)
            }
            Form::Lens { front, back, front_curvature, back_curvature } => {
                let cap = |apex: f64, curvature: f64, radius: f64| {
                    let bent = (1.0 - (curvature * radius).powi(2)).max(0.0).sqrt();
                    apex - curvature * radius * radius / (1.0 + bent)
                };
                let rim = high.min(1.0);
                let touches_cap = |apex: f64, curvature: f64, from: f64, to: f64| {
                    from <= cap(apex, curvature, low) && cap(apex, curvature, rim) <= to
                };
                low <= 1.0
                    && (touches_cap(front, front_curvature, own.min.z, own.max.z)
                        || touches_cap(back, back_curvature, -own.max.z, -own.min.z)
                        || high >= 1.0 && own.max.z >= -back && own.min.z <= front)
            }
        }
    }

    /// Distance from a point to the nearest face of the body except `own`, with a point of that face and the unit normal there; `None`
    /// where all faces are farther away than a small share of the body's size. The distance may be too large for faces that are oblique
    /// to the axes of the body.
    pub(super) fn nearest_face(&self, point: DVec3, own: Option<u8>) -> Option<(f64, DVec3, DVec3)> {
        /// Largest distance, as a share of the body's size.
        const FAR: f64 = 1e-3;
        let local = self.to_local * (point - self.center);
        let reach = self.reach() * (1.0 + FAR);
        if local.length_squared() > reach * reach {
            return None;
        }
        let faces = (0..self.faces()).filter(|&face| Some(face) != own);
        let near = faces.filter_map(|face| {
            let (there, normal) = self.onto_face(local, face);
            let off = there - local;
            (off.length_squared() < FAR * FAR).then(|| ((self.to_object * off).length(), there, normal))
        });
        let (distance, there, normal) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let normal = unit_f64(self.to_local.transpose() * normal)?;
        Some((distance, self.center + self.to_object * there, normal))
    }

    /// The smallest half extent of the body.
    pub(super) fn least_extent(&self) -> f64 {
        let [x, y, z] = [self.to_object.x_axis, self.to_object.y_axis, self.to_object.z_axis];
        let height = match self.form {
            Form::Lens { front, back, .. } => 0.5 * (front + back),
            Form::Torus { minor } => minor,
            Form::Sphere | Form::Box | Form::Cone { .. } => 1.0,
        };
        x.length().min(y.length()).min(z.length() * height)
    }

    /// The point of `face` nearest to the point at `t` of `ray`.
    pub(super) fn refine(&self, ray: &Ray, t: f64, face: u8) -> SurfacePoint {
        let origin = self.to_local * (ray.origin.as_dvec3() - self.center);
        let near = origin + t * (self.to_local * ray.direction.as_dvec3());
        let (local, normal) = self.onto_face(near, face);
        let normal = unit_f64(self.to_local.transpose() * normal).unwrap_or(DVec3::Y);
        let across = local.y.atan2(local.x) / TAU;
        let uv = match (self.form, face) {
            (Form::Box, 0 | 1) => local.truncate().with_x(local.z),
            (Form::Box, 2 | 3) => DVec2::new(local.x, local.z),
            (Form::Box, _) => local.truncate(),
            (Form::Torus { .. }, _) => {
                let tube = local.z.atan2(local.truncate().length() - 1.0);
                DVec2::new(across.rem_euclid(1.0), (tube / TAU).rem_euclid(1.0)) * 2.0 - 1.0
            }
            _ => DVec2::new(across.rem_euclid(1.0) * 2.0 - 1.0, local.z),
        };
        let uv = (0.5 * (uv + 1.0)).clamp(DVec2::ZERO, DVec2::ONE).as_vec2();
        let extent = self.around().1;
        SurfacePoint::new(
            self.center + self.to_object * local,
            error_bound(self.center, extent),
            normal,
            Vec2::new(uv.x, uv.y),
        )
    }

    /// The point of a face near `p`, and the outward normal there, of any length.
    fn onto_face(&self, p: DVec3, face: u8) -> (DVec3, DVec3) {
        let (flat, radius) = (p.truncate(), p.truncate().length());
        let outward = if radius > 0.0 { flat / radius } else { DVec2::X };
        match self.form {
            Form::Sphere => {
                let normal = unit_f64(p).unwrap_or(DVec3::Y);
                (normal, normal)
            }
            Form::Box => {
                let (axis, sign) = (usize::from(face / 2), if face.is_multiple_of(2) { -1.0 } else { 1.0 });
                let mut point = p.clamp(DVec3::NEG_ONE, DVec3::ONE);
                point[axis] = sign;
                (point, DVec3::AXES[axis] * sign)
            }
            Form::Cone { middle, taper } => {
                let z = match face {
                    BASE => -1.0,
                    TOP => 1.0,
                    _ => p.z.clamp(-1.0, 1.0),
                };
                let edge = middle - taper * z;
                match face {
                    SIDE => ((outward * edge).extend(z), outward.extend(taper)),
                    _ => ((outward * radius.min(edge)).extend(z), DVec3::new(0.0, 0.0, z)),
                }
            }
            Form::Torus { minor } => {
                let middle = outward.extend(0.0);
                let normal = unit_f64(p - middle).unwrap_or(DVec3::Z);
                (middle + minor * normal, normal)
            }
            Form::Lens { .. } if face == RIM => (outward.extend(p.z), outward.extend(0.0)),
            Form::Lens { front, back, front_curvature, back_curvature } => {
                let (apex, curvature, side) =
                    if face == FRONT { (front, front_curvature, 1.0) } else { (back, back_curvature, -1.0) };
                // Projection onto the cap along the axis, by its sagitta in a form that also holds for a plane.
                let radius = radius.min(1.0).min(1.0 / curvature);
                let cos = (1.0 - (curvature * radius).powi(2)).max(0.0).sqrt();
                let sagitta = curvature * radius * radius / (1.0 + cos);
                let point = (outward * radius).extend(side * (apex - sagitta));
                (point, (outward * (curvature * radius)).extend(side * cos))
            }
        }
    }
}
