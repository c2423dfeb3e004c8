//! The medium stack at surfaces: which interface a ray meets within the bodies around it, and where it is behind that.

use super::material::Material;
use super::scene::{LightMedia, Scene};
use super::shading::Shading;
use super::surface::SurfaceInteraction;
use crate::bsdf::Dielectric;
use crate::lights::Light;
use crate::math::Ray;
use crate::media::{AIR, Crossing, MediumId, MediumStack};
use crate::sampling::{Sobol, warp};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::PoisonError;

impl Scene {
    /// Media on the near and far side of a hit, as its material states them; `None` where the surface bounds no media.
    #[inline]
    fn stated_sides(&self, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [inside, outside] = self.material(hit).media()?;
        Some(if hit.is_front() { [outside, inside] } else { [inside, outside] })
    }

    /// Media that are on the near and far side of a hit for a ray within `current`; `None` where the surface bounds no media.
    #[inline]
    fn sides(&self, current: &MediumStack, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [near, far] = self.stated_sides(hit)?;
        if hit.borders.is_empty() {
            return Some(current.sides(near, far, &self.parts.media));
        }
        let crossing = self.crossing(*current, hit)?;
        Some([crossing.before.medium(), crossing.after.medium()])
    }

    /// What a ray within `current` crosses at a hit; `None` where the surface bounds no media.
    fn crossing(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<Crossing> {
        let [near, far] = self.stated_sides(hit)?;
        let crossing = if hit.borders.is_empty() {
            current.crossing(near, far, &self.parts.media)
        } else {
            hit.borders.crossing(current, &self.parts.media)?
        };
        if crossing.is_full {
            self.note_overfull(&crossing, far);
        }
        Some(crossing)
    }

    #[cold]
    fn note_overfull(&self, crossing: &Crossing, entered: MediumId) {
        // What is in there is whole whatever a thread that had it did.
        let mut overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.extend(crossing.before.media().chain(Some(entered).filter(|&id| id != AIR)));
    }

    /// Names of the media of bodies that rays found overlapping at one place, where those were more than
    /// [`crate::media::MOST_MEDIA`] and could not all be followed. Empty where that did not happen.
    pub fn overfull(&self) -> Vec<&str> {
        let overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.iter().map(|&id| self.medium(id).name.as_str()).collect()
    }

    /// [`Self::crossing`] for what passes the place of a hit whatever is there: also borders that an opaque surface covers.
    #[inline]
    fn crossing_behind(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<Crossing> {
        if hit.borders.is_empty() {
            return self.crossing(current, hit);
        }
        hit.borders.crossing(current, &self.parts.media)
    }

    /// [`Self::intersect`] for a ray within `current`, which passes the borders of bodies that are not there because another
    /// one fills the place. `current` is then where the ray arrives; the distance is that of the whole way. And whether
    /// there were such borders.
    #[inline]
    pub fn intersect_within(
        &self,
        ray: &Ray,
        current: &mut MediumStack,
    ) -> Option<(SurfaceInteraction, bool)> {
        let hit = self.intersect(ray)?;
        match self.hidden(*current, &hit) {
            None => Some((hit, false)),
            Some(after) => self.intersect_behind(ray, hit, after, current),
        }
    }

    /// Where a ray is behind a border that is not there; `None` for all other surfaces.
    #[inline]
    pub fn hidden(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<MediumStack> {
        let [near, far] = self.sides(&current, hit)?;
        if near != far {
            return None;
        }
        self.crossing(current, hit).map(|crossing| crossing.after)
    }

    /// Where a ray is behind an interface that is no surface: one that [`Self::hidden`] tells, or a smooth one between media of one index of
    /// which one scatters, as the border of a fog. `None` for all other surfaces.
    pub fn null_interface(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<MediumStack> {
        let [near, far] = self.sides(&current, hit)?;
        let [a, b] = [near, far].map(|id| self.medium(id));
        let is_matched = a.ior == b.ior && (a.volume.is_some() || b.volume.is_some());
        let is_smooth = matches!(self.material(hit), Material::Dielectric { .. });
        if near != far && !(is_matched && is_smooth) {
            return None;
        }
        self.crossing(current, hit).map(|crossing| crossing.after)
    }

    #[cold]
    fn intersect_behind(
        &self,
        ray: &Ray,
        mut hit: SurfaceInteraction,
        after: MediumStack,
        current: &mut MediumStack,
    ) -> Option<(SurfaceInteraction, bool)> {
        // More than that is a ray that does not get on.
        const BORDERS: u32 = 1000;
        *current = after;
        for _ in 0..BORDERS {
            let passed = hit.distance;
            hit = self.intersect(&hit.spawn(ray.direction))?;
            hit.distance += passed;
            match self.hidden(*current, &hit) {
                None => return Some((hit, true)),
                Some(after) => *current = after,
            }
        }
        None
    }

    /// BSDF and frame at a hit of a ray within `current`: where bodies overlap, an interface is one between what is really on
    /// both of its sides.
    #[inline]
    pub fn shading_within(&self, hit: &SurfaceInteraction, current: MediumStack) -> Shading {
        let material = self.material(hit);
        let Some(stated) = material.media() else { return hit.shading(material) };
        let Some([near, far]) = self.sides(&current, hit) else { return hit.shading(material) };
        let [inside, outside] = if hit.is_front() { [far, near] } else { [near, far] };
        if [inside, outside] == stated {
            return hit.shading(material);
        }
        let ior = |id| f64::from(self.medium(id).ior);
        hit.shading_between(material, Some(Dielectric::new(ior(outside), ior(inside))))
    }

    /// Where a ray is after scattering from within `current` into `direction`; `None` where by rounding the direction is
    /// on the other side of the surface than it was drawn for.
    #[inline]
    pub fn medium_after(
        &self,
        current: MediumStack,
        hit: &SurfaceInteraction,
        shading: &Shading,
        direction: Vec3,
        transmission: bool,
    ) -> Option<MediumStack> {
        let passes = direction.dot(shading.geometric) * hit.wo.dot(shading.geometric) < 0.0;
        if passes != transmission {
            return None;
        }
        if !transmission {
            return Some(current);
        }
        Some(self.crossing_behind(current, hit).map_or(current, |crossing| crossing.after))
    }

    /// Where a ray is that meets the border of a body from inside without having entered it, as the border says; `None` where
    /// it is within `current` by all that the hit tells. The scene's interfaces contradict each other then.
    #[inline]
    pub fn mismatch(&self, hit: &SurfaceInteraction, current: MediumStack) -> Option<MediumStack> {
        if hit.borders.is_empty() && current.is_within(self.stated_sides(hit)?[0]) && !current.is_full() {
            return None;
        }
        let crossing = self.crossing(current, hit).filter(|crossing| !crossing.fits)?;
        self.misfits.note(hit.surface);
        Some(crossing.before)
    }

    /// Names of the surfaces at which [`Self::mismatch`] found most of what contradicts, the worst first.
    pub fn mismatched(&self) -> Vec<&str> {
        let names = self.misfits.worst().into_iter().map(|id| self.parts.surfaces[id as usize].name.as_str());
        let mut seen = BTreeSet::new();
        names.filter(|name| seen.insert(*name)).collect()
    }

    /// The bodies around `point`, by asking rays in many directions which they leave: the majority decides. None where no ray
    /// meets an interface.
    pub fn medium_at(&self, point: Vec3) -> MediumStack {
        self.medium_around(&[(point, Vec3::ZERO)]).0
    }

    /// The bodies that each light is in.
    pub fn light_media(&self) -> &[LightMedia] {
        self.light_media.get_or_init(|| {
            let of_light = |light: &Light| {
                let (front, front_divided) = self.medium_around(&light.points(false));
                let two_sided = matches!(light, Light::Area(area) if area.is_two_sided());
                let (back, back_divided) =
                    if two_sided { self.medium_around(&light.points(true)) } else { (front, false) };
                LightMedia { sides: [front, back], divided: front_divided || back_divided }
            };
            self.parts.lights.par_iter().map(of_light).collect()
        })
    }

    /// [`Self::medium_at`] by the votes of all `points`, each by rays on the side of its normal where that is not zero; and
    /// whether more than a quarter of the votes that were cast are for others.
    pub fn medium_around(&self, points: &[(Vec3, Vec3)]) -> (MediumStack, bool) {
        const RAYS: u32 = 32;
        if !self.has_interfaces {
            return (MediumStack::AIR, false);
        }
        let sequence = Sobol::new(0x006d_6564_6975_6d00);
        let mut votes: Vec<(MediumStack, u32)> = Vec::new();
        for &(point, normal) in points {
            for index in 0..RAYS {
                let direction = warp::square_to_sphere(sequence.sample_2d(0, index));
                let below = direction.dot(normal).min(0.0);
                let direction = direction - normal * (2.0 * below);
                let Some(found) = self.left_along(Ray::new(point, direction)) else { continue };
                match votes.iter_mut().find(|(known, _)| *known == found) {
                    Some((_, count)) => *count += 1,
                    None => votes.push((found, 1)),
                }
            }
        }
        let all: u32 = votes.iter().map(|(_, count)| count).sum();
        // Of equals the first, which is that of the first ray.
        let best = votes.iter().rev().max_by_key(|(_, count)| count);
        best.map_or((MediumStack::AIR, false), |&(found, count)| (found, 4 * (all - count) > all))
    }

    /// The bodies that a ray leaves without having entered them; `None` where it meets no interface. Opaque surfaces do not
    /// bound media and are passed.
    fn left_along(&self, mut ray: Ray) -> Option<MediumStack> {
        // A ray that crosses more surfaces than this says nothing; the others decide.
        const CROSSINGS: u32 = 1000;
        let (mut start, mut at, mut found) = (MediumStack::AIR, MediumStack::AIR, false);
        for _ in 0..CROSSINGS {
            let Some(hit) = self.intersect(&ray) else { return found.then_some(start) };
            let [near, far] =
                [hit.is_front(), !hit.is_front()].map(|front| self.material(&hit).medium_on(front));
            let alone = near.zip(far).filter(|_| hit.borders.is_empty());
            for (near, far) in alone.into_iter().chain(hit.borders.each()) {
                let crossing = at.crossing(near, far, &self.parts.media);
                found = true;
                // A border that names both media says what fills the place, which is a contradiction within another body.
                if !crossing.fits && crossing.before != at && (far == AIR || at == MediumStack::AIR) {
                    start = start.crossing(AIR, near, &self.parts.media).after;
                }
                at = crossing.after;
            }
            ray = hit.spawn(ray.direction);
        }
        None
    }
}
