//! How far a surface goes on around a place, and whether a free way leads from one place to another: what density estimates and
//! precomputed irradiance ask before they use light from elsewhere.

use super::scene::Scene;
use super::surface::SurfaceInteraction;
use crate::math::Ray;
use glam::Vec3;

/// How far from where it was found a surface may lie by rounding, render space, where no coordinate is much beyond one: what
/// single precision resolves there, 64 times over.
const ROUNDED: f32 = 64.0 * f32::EPSILON;

/// A place just above a surface of which position and unit normal are known: by what rounding may do to the position, and to where
/// a ray meets a triangle as large as the scene.
fn off_surface(position: Vec3, normal: Vec3) -> Vec3 {
    position + normal * (f32::EPSILON * (2.0 + 8.0 * position.abs().max_element()))
}

/// Height over the distance of two places that a way between them has above their surfaces: 11 degrees. What is lower is passed
/// over, as an obstacle that is small against the distance.
const WAY_RISE: f32 = 0.2;

/// Surfaces whose normals are this close count as one: 45 degrees, as for photons.
pub(super) const SAME_SURFACE_COS: f32 = std::f32::consts::FRAC_1_SQRT_2;

impl Scene {
    /// How far the surface at `position`, with the unit `normal`, goes on along the unit `tangent`, as seen from that
    /// place: up to where something rises out of it, or where it ends. `None` where it goes on for `radius`.
    ///
    /// One ray that comes down to the surface at the far end tells both in the open, from a height of `lift` in radii
    /// ([`Self::feeler_lift`]). What rises less than that, and surfaces that face like this one within 45 degrees (its own
    /// curvature), are passed over.
    pub fn surface_reach(
        &self,
        (position, normal): (Vec3, Vec3),
        tangent: Vec3,
        radius: f32,
        lift: f32,
    ) -> Option<f32> {
        /// Share of the radius at which the ray meets a plane surface.
        const LANDING: f32 = 0.95;
        let start = position + normal * (lift * radius);
        let direction = tangent * radius - normal * (lift / LANDING * radius);
        match self.intersect_any_direction(&Ray { origin: start, direction, t_max: 1.0 }) {
            Some((t, facing)) if facing.dot(normal) < SAME_SURFACE_COS => Some(t * radius),
            Some(_) => None,
            None => self.surface_end((position, normal), tangent, radius, lift),
        }
    }

    /// Height in radii from which feelers around a place start, where there is nothing within `headroom` above it: a
    /// twentieth, or half of the way up to what is there.
    pub fn feeler_lift(headroom: f32, radius: f32) -> f32 {
        const LIFT: f32 = 0.05;
        if headroom < LIFT * radius { 0.5 * headroom / radius } else { LIFT }
    }

    /// How far one can go from `position` along the unit `normal` of the surface there before something is in the way; infinite where
    /// that is farther than `within`. What is so close that rounding may have put the place beyond it is passed over.
    pub fn headroom(&self, position: Vec3, normal: Vec3, within: f32) -> f32 {
        let up = Ray { t_max: within, ..Ray::new(position + normal * ROUNDED, normal) };
        self.parts.embree.intersect(&up).map_or(f32::INFINITY, |hit| ROUNDED + hit.t)
    }

    /// Whether a free way leads from `start`, a place in the open, to `place` on a surface that faces along the unit `normal`:
    /// a straight segment, which ends as close above the surface as places can be told apart.
    pub fn is_way_free(&self, start: Vec3, place: Vec3, normal: Vec3) -> bool {
        !self.occluded(&Ray::segment(start, off_surface(place, normal)))
    }

    /// Whether a free way leads from a hit to `place` on a surface that faces along the unit `normal` on the side of the hit: back
    /// along the ray that found the hit, which was free, up to where the tangent planes of both places lie well below, and
    /// straight on from there. What is low against the distance of the two is passed over.
    ///
    /// Whatever the shapes, such a way leads through no closed surface.
    pub fn connects(&self, hit: &SurfaceInteraction, place: Vec3, normal: Vec3) -> bool {
        let offset = hit.point.position - place;
        let distance = offset.length();
        let rise = WAY_RISE * distance;
        let (here, there) = (hit.wo.dot(hit.facing_normal()), hit.wo.dot(normal));
        let over_here = rise / here;
        let over_there = if there > 0.0 { (rise - offset.dot(normal)) / there } else { 0.0 };
        let back = over_here.max(over_there).min(0.5 * hit.distance);
        // Not a number where the ray grazes the surface and the places are the same.
        let back = if back > 0.0 { back } else { 0.0 };
        let start = hit.start_towards(hit.wo) + hit.wo * back;
        self.is_way_free(start, place, normal)
    }

    /// Whether a free way leads from `centre`, on a surface that faces along the unit `up` and has this much `headroom`, to `place`
    /// on one that faces along `normal`: up to where the tangent planes of both lie well below, and straight on from there.
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

    /// Where a surface ends along `tangent`, by bisection with rays straight down; `None` where it goes on after all,
    /// curving away.
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
            // A surface that has turned by less than 45 degrees lies no deeper than this.
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

    /// The surface at `position` that faces along the unit `normal`, for places of which no more is known, as those of
    /// photons: what a ray straight down from a little above meets. `None` where that finds none, or one that faces
    /// elsewhere.
    pub fn surface_at(&self, position: Vec3, normal: Vec3) -> Option<SurfaceInteraction> {
        let down = Ray { origin: position + normal * ROUNDED, direction: -normal, t_max: 2.0 * ROUNDED };
        let hit = self.met(&down, &self.parts.embree.intersect(&down)?);
        (hit.facing_normal().dot(normal) >= SAME_SURFACE_COS).then_some(hit)
    }
}
