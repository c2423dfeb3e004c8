//! Exact shapes, which are never tessellated, and sampling of emitters of every shape.
//!
//! [`Sphere`], [`Cylinder`], [`Disc`], combinations of closed bodies ([`Csg`]), [`SphereFlake`] and [`Terrain`] are
//! [`crate::embree::Procedural`]: they are intersected in `f64` from the `f32` ray, in object space. [`Quad`] and [`Triangle`] are
//! intersected by Embree and only sampled here.
//!
//! # Sampling
//!
//! Each shape has
//! - `area()`, of one side;
//! - `sample_area(u)`: a point uniform over the area, `pdf_area = 1 / area`;
//! - `sample_solid_angle(reference, u)`: a point, with the density per solid angle of the direction to it as seen
//!   from `reference`, in front of the surface or behind. `None` where that density is zero or infinite: the
//!   surface is seen edge-on, or the reference is the sampled point;
//! - `pdf_solid_angle(reference, position)`: the same density for any point `position` of the shape; zero where
//!   it would be infinite.
//!
//! `u` is in `[0, 1)^2`. Both sides of a shape are sampled, whether they face the reference or are visible or not. The light decides which
//! side emits, and tests visibility. Densities are `f32`, in 1/m^2 of the shape's space and in 1/sr; all other values are `f64`.

mod chart;
mod csg;
mod cylinder;
mod disc;
mod emitter_shape;
mod flake;
mod patch;
mod quad;
mod roots;
mod solid;
mod span;
mod sphere;
mod terrain;
mod torus;
mod triangle;

#[cfg(test)]
mod tests;

pub use chart::Chart;
pub use csg::{Csg, CsgOperation};
pub use cylinder::Cylinder;
pub use disc::Disc;
pub use emitter_shape::EmitterShape;
pub use flake::SphereFlake;
pub use patch::Patch;
pub use quad::{Quad, SMALLEST_SPHERICAL_RECTANGLE};
pub use solid::Solid;
pub use sphere::Sphere;
pub use terrain::{HeightGrid, Terrain, TerrainNoise};
pub use triangle::Triangle;

use crate::embree::{ObjectHit, Procedural};
use crate::math::{Bounds3, Ray};
use glam::{DVec3, Vec3};

/// An error in the parameters of a shape.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// A radius that is not a positive finite number.
    #[error("radius {0} is not positive and finite")]
    Radius(f64),
    /// A coordinate that is NaN or infinite.
    #[error("coordinate of ({0}, {1}, {2}) is not finite", .point.x, .point.y, .point.z)]
    NotFinite {
        /// The point or vector with that coordinate.
        point: DVec3,
    },
    /// Two ends, edges or corners that span no area, or a normal of length zero.
    #[error("no area: ends coincide, edges are parallel or the normal is zero")]
    NoArea,
    /// Constructive solid geometry with too many bodies.
    #[error("more than {} bodies in one object; split it into several shapes", Csg::MOST_SOLIDS)]
    TooManySolids,
    /// A recursion that is too deep for the resolution of `f32`.
    #[error("a depth of {0} is more than `f32` can show; at most 12")]
    Depth(u32),
    /// A height grid without cells, or whose number of heights does not match its corners.
    #[error("{heights} heights for {cells} by {cells} cells; there must be one for each corner, all finite")]
    Heights {
        /// Cells along each side.
        cells: u32,
        /// Heights given.
        heights: usize,
    },
}

/// A point sampled uniformly over the area of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaSample {
    /// Position on the surface.
    pub position: DVec3,
    /// Unit normal on the outer side.
    pub normal: DVec3,
    /// Density per area of one side: `1 / area`.
    pub pdf_area: f32,
}

/// A point of a shape, sampled as seen from a reference point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidAngleSample {
    /// Position on the surface.
    pub position: DVec3,
    /// Unit normal on the outer side; may face away from the reference.
    pub normal: DVec3,
    /// Density of the direction from the reference to `position`, per solid angle, 1/sr; positive and finite.
    pub pdf_solid_angle: f32,
}

fn finite(point: DVec3) -> Result<DVec3, ShapeError> {
    if point.is_finite() { Ok(point) } else { Err(ShapeError::NotFinite { point }) }
}

fn positive_radius(radius: f64) -> Result<f64, ShapeError> {
    // The square of the radius must stay in the range of f64.
    if (1e-150..=1e150).contains(&radius) { Ok(radius) } else { Err(ShapeError::Radius(radius)) }
}

/// Converts a density per area to a density per solid angle: `pdf_area distance^2 / |cos|`, with the cosine at the
/// sampled surface. `None` where it is zero, infinite or NaN.
fn solid_angle_density(pdf_area: f64, reference: DVec3, position: DVec3, normal: DVec3) -> Option<f32> {
    let to_surface = position - reference;
    let distance_squared = to_surface.length_squared();
    let cos_times_distance = to_surface.dot(normal).abs();
    let pdf = (pdf_area * distance_squared * distance_squared.sqrt() / cos_times_distance) as f32;
    (pdf > 0.0 && pdf.is_finite()).then_some(pdf)
}

/// Converts an [`AreaSample`] to a sample as seen from `reference`.
fn seen_from(reference: DVec3, sample: AreaSample, area: f64) -> Option<SolidAngleSample> {
    let AreaSample { position, normal, .. } = sample;
    let pdf_solid_angle = solid_angle_density(1.0 / area, reference, position, normal)?;
    Some(SolidAngleSample { position, normal, pdf_solid_angle })
}

/// Two unit vectors that form a right-handed frame with the unit vector `v` as the last one.
fn tangents(v: DVec3) -> (DVec3, DVec3) {
    // The construction of `math::Frame`, in f64.
    let sign = 1f64.copysign(v.z);
    let a = -1.0 / (sign + v.z);
    let b = v.x * v.y * a;
    (DVec3::new(1.0 + sign * v.x * v.x * a, sign * b, -sign * v.x), DVec3::new(b, sign + v.y * v.y * a, -v.y))
}

/// Bound on the relative error of a dozen roundings in `f64`.
const ROUNDINGS: f64 = 8.0 * f64::EPSILON;

/// Error bound for coordinates computed from `point` and lengths up to `extent`, rounded up to `f32`.
fn error_bound(point: DVec3, extent: f64) -> Vec3 {
    (ROUNDINGS * (point.abs() + extent)).to_array().map(|e| (e as f32).next_up()).into()
}

/// `bounds` grown by the rounding error of its corners, so that no computed point lies outside.
fn grown(bounds: Bounds3) -> Bounds3 {
    let margin = ROUNDINGS * bounds.min.abs().max(bounds.max.abs()).max_element();
    Bounds3 { min: bounds.min - margin, max: bounds.max + margin }
}

/// Distances from the origin to the nearest and the farthest point of a rectangle, which is given by centre and half extent along each
/// axis.
fn distances_2d(sides: [(f64, f64); 2]) -> (f64, f64) {
    let [x, y] = sides.map(|(center, half)| ((center.abs() - half).max(0.0), center.abs() + half));
    (x.0.hypot(y.0), x.1.hypot(y.1))
}

/// [`Procedural::nearest`] for a shape that implements `intersect` and `refine`.
fn nearest_by_refining(shape: &impl Procedural, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
    let t = shape.intersect(primitive, ray)?;
    let point = shape.refine(primitive, ray, t);
    Some(ObjectHit { t: f64::from(t), normal: point.normal, error: f64::from(point.error.max_element()) })
}
