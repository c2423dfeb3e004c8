use crate::math::{Bounds3, Ray};
use glam::{DVec3, Vec2, Vec3};
use std::fmt;

/// An object that Embree meets through callbacks and never as triangles.
///
/// A new object needs two functions: [`bounds`](Self::bounds) and [`intersect`](Self::intersect), and
/// [`refine`](Self::refine) for the surface at a hit. An object may hold many primitives, each with bounds of its
/// own, which Embree sorts into its hierarchy. Rays arrive in the object's own space with directions of any
/// length. A panic in any of these functions is caught at the border, counts as a miss, and is reported by
/// [`crate::embree::CommittedScene::panics`].
pub trait Procedural: fmt::Debug + Send + Sync {
    /// Number of primitives.
    fn primitive_count(&self) -> u32 {
        1
    }

    /// A box that contains the primitive.
    fn bounds(&self, primitive: u32) -> Bounds3;

    /// Parameter of the nearest hit in `(0, ray.t_max]`, or `None`. Both sides of a surface count.
    fn intersect(&self, primitive: u32, ray: &Ray) -> Option<f32>;

    /// True where anything is hit in `(0, ray.t_max]`; the nearest hit need not be found.
    fn occluded(&self, primitive: u32, ray: &Ray) -> bool {
        self.intersect(primitive, ray).is_some()
    }

    /// All hits in `(0, ray.t_max]`, in any order: what shadow photons and inside/outside tests count.
    fn intersect_all(&self, primitive: u32, ray: &Ray, hits: &mut Vec<f32>);

    /// The surface at parameter `t`, as returned by [`intersect`](Self::intersect) for the same ray. Embree keeps
    /// only an `f32` parameter; this recomputes the point in `f64`, on the surface, with a bound on what is left.
    fn refine(&self, primitive: u32, ray: &Ray, t: f32) -> SurfacePoint;
}

/// A point of a surface, in the object's own space.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position on the surface.
    pub position: DVec3,
    /// Bound on the absolute error of each coordinate of `position`, before it is rounded to `f32`.
    pub error: Vec3,
    /// Geometric normal, unit length, on the outer side of the surface.
    pub normal: DVec3,
    /// Surface parameters in `[0, 1]^2`.
    pub uv: Vec2,
}
