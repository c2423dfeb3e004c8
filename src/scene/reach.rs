//! Extent of a surface around a point, and free paths between points: density estimates and precomputed irradiance test these before
//! they use light from elsewhere.

use super::scene::Scene;
use super::surface::SurfaceInteraction;
use crate::math::Ray;
use glam::Vec3;

/// Rounding tolerance for the position of a surface, render space, where coordinates are about one at most: 64 times the resolution of
/// single precision there.
const ROUNDED: f32 = 64.0 * f32::EPSILON;

/// A point just above a surface, given its position and unit normal. The height covers the rounding of the position and of an
/// intersection with a triangle as large as the scene.
fn off_surface(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * (f32::EPSILON * (2.0 + 8.0 * position.abs().max_element()))
}

/// Height of a path between two points above their surfaces, over the distance of the points: 11 degrees. Lower obstacles are small
/// compared with the distance, and the path passes over them.
const WAY_RISE: f32 = 0.2;

/// Smallest cosine between the normals of points that count as the same surface: 45 degrees, as for photons.
pub(super) const SAME_SURFACE_COS: f32 = std::f32::consts::FRAC_1_SQRT_2;

impl Scene {
    /// Distance from `position` to where the surface with the unit `normal` ends along the unit `tangent`, as seen from that point:
    /// where something rises out of it, or at its edge. `None` where it continues for `radius`.
    ///
    /// In open surroundings a single ray tests both. It starts at a height of `lift` in radii ([`Self::feeler_lift`]) and meets the
    /// surface near the far end. The ray passes over anything lower than that. Surfaces that face like this one within 45 degrees are
    /// ignored, because they may be its own curvature.
    pub fn surface_reach(
        &self,
        (position, normal): (Vec3, Vec3),
        tangent: Vec3,
        radius: f32,
        lift: f32,
    ) -> Option<f32> {
        /// Share of the radius at which the ray meets a flat surface.
        const LANDING: f32 = 0.95;
        let start = position + normal * (lift * radius);
        let direction = tangent * radius - normal * (lift / LANDING * radius);
        match self.intersect_any_direction(&Ray { origin: start, direction, t_max: 1.0 }) {
            Some((t, facing)) if facing.dot(normal) < SAME_SURFACE_COS => Some(t * radius),
            Some(_) => None,
            None => self.surface_end((position, normal), tangent, radius, lift),
        }
    }

    /// Height in radii at which feeler rays around a point start: a twentieth, or half of `headroom` where there is an obstacle lower
    /// than that.
    pub fn feeler_lift(headroom: f32, radius: f32) -> f32 {
        const LIFT: f32 = 0.05;
        if headroom < LIFT * radius { 0.5 * headroom / radius } else { LIFT }
    }

    /// Free distance from `position` along the unit `normal` of the surface there; infinite where it exceeds `within`. Obstacles so
    /// close that rounding may have placed the point beyond them are ignored.
    pub fn headroom(&self, position: Vec3, normal: Vec3, within: f32) -> f32 {
        let up = Ray { t_max: within, ..Ray::new(position + normal * ROUNDED, normal) };
        self.parts.embree.intersect(&up).map_or(f32::INFINITY, |hit| ROUNDED + hit.t)
    }

    /// Whether the straight segment from `start`, a point in free space, to `place` on a surface that faces along the unit `normal` is
    /// free. It ends just above the surface, at the resolution of positions.
    pub fn is_way_free(&self, start: Vec3, place: Vec3, normal: Vec3) -> bool {
        !self.occluded(&Ray::segment(start, off_surface(place, normal)))
    }

    /// Whether a free path leads from a hit to `place`, on a surface that faces along the unit `normal` on the side of the hit. The path
    /// leads back along the ray that found the hit, which was free, until it is well above the tangent planes of both points, and then
    /// straight to `place`. It passes over obstacles that are low compared with the distance of the points.
    ///
    /// Whatever the shapes, such a path passes through no closed surface.
    pub fn connects(&self, hit: &SurfaceInteraction, place: Vec3, normal: Vec3) -> bool {
        let offset = hit.point.position - place;
        let distance = offset.length();
        let rise = WAY_RISE * distance;
        let (here, there) = (hit.wo.dot(hit.facing_normal()), hit.wo.dot(normal));
        let over_here = rise / here;
        let over_there = if there > 0.0 { (rise - offset.dot(normal)) / there } else { 0.0 };
        let back = over_here.max(over_there).min(0.5 * hit.distance);
        // NaN where the ray grazes the surface and both points are the same.
        let back = if back > 0.0 { back } else { 0.0 };
        let start = hit.start_towards(hit.wo) + hit.wo * back;
        self.is_way_free(start, place, normal)
    }

    /// Whether a free path leads from `centre`, on a surface that faces along the unit `up` with this much `headroom`, to `place` on a
    /// surface that faces along `normal`. The path rises well above the tangent planes of both points, and then leads straight to
    /// `place`.
    pub fn connects_upwards(
        &self,
        (centre, up): (Vec3, Vec3),
        headroom: f32,
        (place, normal): (Vec3, Vec3),
    ) -> bool {
        let offset = centre - place;
        let rise = WAY_RISE * offset.length();
        let over_there = (rise - offset.dot(normal)) / up.dot(normal).max(f32::MIN_POSITIVE);
        let height = rise.max(over_there).min(0.5 * headroom);
        self.is_way_free(off_surface(centre, up) + up * height, place, normal)
    }

    /// Distance at which a surface ends along `tangent`, by bisection with rays straight down; `None` where it continues in a curve.
    fn surface_end(
        &self,
        (position, normal): (Vec3, Vec3),
        tangent: Vec3,
        radius: f32,
        lift: f32,
    ) -> Option<f32> {
        const STEPS: u32 = 5;
        let is_supported = |distance: f32| {
            let origin = position + tangent * distance + normal * (lift * radius);
            // A surface that has turned by less than 45 degrees is at most this far below.
            let down = Ray { origin, direction: -normal * (lift * radius + distance), t_max: 1.0 };
            self.intersect_any_direction(&down)
                .is_some_and(|(_, facing)| facing.dot(normal) >= SAME_SURFACE_COS)
        };
        if is_supported(radius) {
            return None;
        }
        let (mut low, mut high) = (0.0, radius);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if is_supported(middle) { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }

    /// Parameter and facing normal of the nearest hit of a ray whose direction may have any length.
    fn intersect_any_direction(&self, ray: &Ray) -> Option<(f32, Vec3)> {
        let hit = self.parts.embree.intersect(ray)?;
        Some((hit.t, self.facing_normal(ray, &hit)))
    }

    /// The surface at `position` that faces along the unit `normal`, for points such as those of photons, of which nothing else is
    /// known. It is found by a ray straight down from slightly above. `None` where the ray finds no surface or one that faces elsewhere.
    pub fn surface_at(&self, position: Vec3, normal: Vec3) -> Option<SurfaceInteraction> {
        let down = Ray { origin: position + normal * ROUNDED, direction: -normal, t_max: 2.0 * ROUNDED };
        let hit = self.met(&down, &self.parts.embree.intersect(&down)?);
        (hit.facing_normal().dot(normal) >= SAME_SURFACE_COS).then_some(hit)
    }
}
