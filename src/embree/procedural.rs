//! Procedural objects: user geometry with callbacks for bounds and hits.

use crate::math::{Bounds3, Ray, unit_f64};
use glam::{DVec3, Vec2, Vec3};
use std::fmt;

/// An object that Embree intersects through callbacks and never as triangles.
///
/// A new object needs two functions: [`bounds`](Self::bounds), and [`nearest`](Self::nearest), which intersects it with a ray and returns
/// the normal at the hit (the two requirements of Jensen & Christensen 1995, section 6). All other functions have defaults based on these;
/// an object may override them. `examples/superquadric.rs` is a complete example.
///
/// An object may have many primitives, each with its own bounds, which Embree sorts into its hierarchy. Rays are in object space and have
/// directions of any length. A panic in any of these functions is caught before it reaches Embree and counts as a miss;
/// [`crate::embree::CommittedScene::panics`] reports the number of panics.
pub trait Procedural: fmt::Debug + Send + Sync {
    /// Number of primitives.
    fn primitive_count(&self) -> u32 {
        1
    }

    /// A box that contains the primitive.
    fn bounds(&self, primitive: u32) -> Bounds3;

    /// Returns false where no point of the primitive is in the box `region`. The scene uses this to find surfaces that touch. The default
    /// tests [`Self::bounds`], which costs rays time where other surfaces are near but do not touch.
    fn may_be_in(&self, primitive: u32, region: &Bounds3) -> bool {
        let own = self.bounds(primitive);
        own.min.cmple(region.max).all() && region.min.cmple(own.max).all()
    }

    /// The nearest hit in `(0, ray.t_max]`, or `None`. Both sides of a surface are hit.
    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit>;

    /// Parameter of [`Self::nearest`], rounded to `f32`; `None` where it then lies outside `(0, ray.t_max]`.
    fn intersect(&self, primitive: u32, ray: &Ray) -> Option<f32> {
        let t = self.nearest(primitive, ray)?.t as f32;
        (t > 0.0 && t <= ray.t_max && t < f32::INFINITY).then_some(t)
    }

    /// Whether anything is hit in `(0, ray.t_max]`; the nearest hit need not be found.
    fn occluded(&self, primitive: u32, ray: &Ray) -> bool {
        self.intersect(primitive, ray).is_some()
    }

    /// Finds all hits in `(0, ray.t_max]`, in any order. Shadow photons and inside/outside tests count them.
    ///
    /// The default restarts behind each hit, at the next position that `f32` distinguishes from it. Surfaces closer together than that
    /// count once.
    fn intersect_all(&self, primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        /// Most hits of one primitive along one ray.
        const MOST: usize = 1 << 16;
        let mut start = 0.0;
        for _ in 0..MOST {
            let rest = Ray { origin: ray.at(start), t_max: ray.t_max - start, ..*ray };
            let Some(hit) = self.nearest(primitive, &rest) else { return };
            let t = hit.t as f32;
            if !(t > 0.0 && t <= rest.t_max && t < f32::INFINITY) {
                return;
            }
            hits.push(start + t);
            // Rounding moves the next origin by `across` perpendicular to the surface, and along the ray by that over the cosine.
            let reach = ray.origin.abs() + (start + t) * ray.direction.abs();
            let across = 4.0 * f32::EPSILON * reach.max_element();
            start = (start + t + across / ray.direction.dot(hit.normal.as_vec3()).abs()).next_up();
            if !(start < ray.t_max) {
                return;
            }
        }
    }

    /// The surface point at parameter `t`, as returned by [`intersect`](Self::intersect) for the same ray. Embree keeps only an `f32`
    /// parameter; this function recomputes the point on the surface in `f64`, with a bound on the remaining error.
    fn refine(&self, primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        /// Relative tolerance of the parameter: the transform of an instance rounds a ray, and a hit further off is another hit.
        const SAME: f64 = 1e-4;
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let rounded = f64::from(t);
        let is_same = |hit: &ObjectHit| (hit.t - rounded).abs() <= SAME * rounded;
        // If the hit is not the nearest one, the ray restarts just before it, from a rounded origin.
        let again = || {
            let start = t * (1.0 - 0.5 * SAME as f32);
            let rest = Ray { origin: ray.at(start), t_max: t * 2.0 * SAME as f32, ..*ray };
            let hit = self.nearest(primitive, &rest)?;
            let moved =
                f64::from(f32::EPSILON) * 2.0 * (origin.abs() + (rounded * direction).abs()).max_element();
            Some(ObjectHit { t: f64::from(start) + hit.t, error: hit.error + moved, ..hit })
        };
        let hit = self.nearest(primitive, ray).filter(is_same).or_else(|| again().filter(is_same));
        // A grazing hit may be lost: then the point from Embree is used, with the error of its parameter.
        let hit = hit.unwrap_or_else(|| ObjectHit {
            t: rounded,
            normal: unit_f64(-direction).unwrap_or(DVec3::Y),
            error: SAME * rounded * direction.length(),
        });
        let position = origin + hit.t * direction;
        let rounding = 4.0 * f64::EPSILON * (origin.abs() + (hit.t * direction).abs());
        let error = (rounding + hit.error).to_array().map(|error| (error as f32).next_up());
        SurfacePoint::new(position, error.into(), hit.normal, Vec2::ZERO)
    }
}

/// Hit of a ray with an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectHit {
    /// Parameter along the ray.
    pub t: f64,
    /// Geometric normal of unit length, on the outer side of the surface.
    pub normal: DVec3,
    /// Bound on the distance of the point at `t` from the surface, in addition to the rounding error of that point.
    pub error: f64,
}

/// A point of a surface, in object space.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position on the surface.
    pub position: DVec3,
    /// Bound on the absolute error of each coordinate of `position`, before it is rounded to `f32`.
    pub error: Vec3,
    /// Geometric normal, unit length, on the outer side of the surface.
    pub normal: DVec3,
    /// Shading normal of unit length, on the same side as `normal`, and equal to it without smoothing.
    pub shading_normal: DVec3,
    /// Surface parameters in `[0, 1]^2`.
    pub uv: Vec2,
    /// Index of the part of the object; each part may have its own material. 0 where there is only one part.
    pub part: u32,
    /// The nearby edge; `None` far from edges.
    pub edge: Option<NearEdge>,
}

/// An edge near a point of a surface, in object space.
#[derive(Clone, Copy, Debug)]
pub struct NearEdge {
    /// Distance to the adjoining surface, or to the boundary of the surface.
    pub distance: f64,
    /// Extent of the object near the edge.
    pub extent: f64,
    /// A point of the adjoining surface next to the edge, and its unit normal; zero at a boundary.
    pub other: (DVec3, DVec3),
}

impl SurfacePoint {
    /// A point of an object with one part, without smoothing.
    pub fn new(position: DVec3, error: Vec3, normal: DVec3, uv: Vec2) -> Self {
        Self { position, error, normal, shading_normal: normal, uv, part: 0, edge: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    /// A unit ball with the two required functions only.
    #[derive(Debug)]
    struct Ball;

    impl Procedural for Ball {
        fn bounds(&self, _primitive: u32) -> Bounds3 {
            Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE }
        }

        fn nearest(&self, _primitive: u32, ray: &Ray) -> Option<ObjectHit> {
            let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
            let root = (b * b - a * c).sqrt();
            let t = [(-b - root) / a, (-b + root) / a].into_iter().find(|t| *t as f32 > 0.0)?;
            let normal = o + t * d;
            (t <= f64::from(ray.t_max)).then_some(ObjectHit { t, normal, error: 1e-14 })
        }
    }

    #[test]
    fn all_else_follows_from_two_functions() {
        let mut rng = Rng::new(1, Stream::Measure, 3);
        let mut random = || 2.0 * DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) - 1.0;
        let mut crossings = 0;
        for _ in 0..2000 {
            let origin = (4.0 * random()).as_vec3();
            let ray = Ray::new(origin, (random().as_vec3() - origin) * 3.0);
            let mut hits = Vec::new();
            Ball.intersect_all(0, &ray, &mut hits);
            let inside = origin.length() < 1.0;
            // A tangent ray may have both hits at one point.
            let chord = (1.0 - f64::from(origin.cross(ray.direction.normalize()).length_squared())).max(0.0);
            assert!(
                chord < 1e-5 || hits.is_empty() || hits.len() == if inside { 1 } else { 2 },
                "{ray:?}: {hits:?}"
            );
            assert_eq!(Ball.occluded(0, &ray), !hits.is_empty());
            for t in hits {
                crossings += 1;
                let point = Ball.refine(0, &ray, t);
                let bound = 2.0 * f64::from(point.error.max_element());
                assert!((point.position.length() - 1.0).abs() <= bound, "{ray:?} at {t}: {point:?}");
                assert!(bound < 1e-5 || chord < 1e-5, "{ray:?} at {t}: {point:?}");
                assert!(point.normal.dot(point.position) > 0.99);
            }
        }
        assert!(crossings > 1000, "{crossings}");
    }
}
