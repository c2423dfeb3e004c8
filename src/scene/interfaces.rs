//! Medium stack at surfaces: which interface a ray meets, given its medium stack, and the medium stack after it.

use super::material::Material;
use super::scene::{LightMedia, Scene};
use super::shading::Shading;
use super::surface::SurfaceInteraction;
use crate::bsdf::{Bsdf, Dielectric, fresnel_dielectric};
use crate::camera::Camera;
use crate::lights::Light;
use crate::math::{Ray, Rgb, unit};
use crate::media::{AIR, Crossing, Medium, MediumId, MediumStack};
use crate::sampling::{Sobol, warp};
use crate::settings::Wavelengths;
use crate::spectra::{Line, LineIndices};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::PoisonError;

impl Scene {
    /// Media on the near and far side of a hit as declared by its material; `None` where the surface bounds no media.
    #[inline]
    fn stated_sides(&self, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [inside, outside] = self.material(hit).media()?;
        Some(if hit.is_front() { [outside, inside] } else { [inside, outside] })
    }

    /// Actual media on the near and far side of a hit for a ray within `current`; `None` where the surface bounds no media.
    #[inline]
    fn sides(&self, current: &MediumStack, hit: &SurfaceInteraction) -> Option<[MediumId; 2]> {
        let [near, far] = self.stated_sides(hit)?;
        if hit.borders.is_empty() {
            return Some(current.sides(near, far, &self.parts.media));
        }
        let crossing = self.crossing(*current, hit)?;
        Some([crossing.before.medium(), crossing.after.medium()])
    }

    /// Result of crossing an interface at a hit, for a ray within `current`; `None` where the surface bounds no media.
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
        // The set stays valid even if a thread panicked while it held the lock.
        let mut overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.extend(crossing.before.media().chain(Some(entered).filter(|&id| id != AIR)));
    }

    /// Names of the media of bodies that overlap at places where rays found more than [`crate::media::MOST_MEDIA`] of them, which is
    /// more than can be followed. Empty where that did not happen.
    pub fn overfull(&self) -> Vec<&str> {
        let overfull = self.overfull.lock().unwrap_or_else(PoisonError::into_inner);
        overfull.iter().map(|&id| self.medium(id).name.as_str()).collect()
    }

    /// [`Self::crossing`] for rays that pass the place of a hit regardless of its surface; includes interfaces that an opaque surface
    /// covers.
    #[inline]
    fn crossing_behind(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<Crossing> {
        if hit.borders.is_empty() {
            return self.crossing(current, hit);
        }
        hit.borders.crossing(current, &self.parts.media)
    }

    /// [`Self::intersect`] for a ray within `current` that passes hidden interfaces: those of bodies that another body displaces.
    /// Updates `current` to the medium stack at the hit. The distance is that of the whole path. Also returns whether hidden interfaces
    /// were passed.
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

    /// Medium stack after a hidden interface; `None` for all other surfaces.
    #[inline]
    pub fn hidden(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<MediumStack> {
        let [near, far] = self.sides(&current, hit)?;
        if near != far {
            return None;
        }
        self.crossing(current, hit).map(|crossing| crossing.after)
    }

    /// Medium stack after a null interface: a hidden interface (see [`Self::hidden`]), or a smooth one between media of the same index
    /// of refraction of which at least one scatters, such as the boundary of a fog. `None` for all other surfaces.
    pub fn null_interface(&self, current: MediumStack, hit: &SurfaceInteraction) -> Option<MediumStack> {
        let [near, far] = self.sides(&current, hit)?;
        let [a, b] = [near, far].map(|id| self.medium(id));
        let is_matched = a.is_index_matched(b) && (a.volume.is_some() || b.volume.is_some());
        // What emits is there for every ray.
        let is_smooth =
            matches!(self.material(hit), Material::Dielectric { .. }) && self.surface(hit).light.is_none();
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
        // Limit that stops rays which do not advance.
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

    /// BSDF and frame at a hit of a ray within `current`. Where bodies overlap, the interface separates the media that are actually on
    /// both sides of it.
    #[inline]
    pub fn shading_within(&self, hit: &SurfaceInteraction, current: MediumStack) -> Shading {
        let material = self.material(hit);
        let Some(stated) = material.media() else { return hit.shading(material) };
        let Some([near, far]) = self.sides(&current, hit) else { return hit.shading(material) };
        let [inside, outside] = if hit.is_front() { [far, near] } else { [near, far] };
        let disperses = self.disperses && [inside, outside].iter().any(|&id| self.disperses_in(id));
        if [inside, outside] == stated {
            return Shading { disperses, ..hit.shading(material) };
        }
        let ior = |id| f64::from(self.medium(id).ior);
        let interface = Dielectric::new(ior(outside), ior(inside));
        Shading { disperses, ..hit.shading_between(material, Some(interface)) }
    }

    /// [`Self::shading_within`] for a path that has taken a wavelength.
    #[inline]
    pub fn shading_for(&self, hit: &SurfaceInteraction, current: MediumStack, line: Option<Line>) -> Shading {
        let shading = self.shading_within(hit, current);
        match line {
            Some(line) if shading.disperses => self.shading_at(hit, current, line).unwrap_or(shading),
            _ => shading,
        }
    }

    /// Shading of a hit at which light is dispersed, at a wavelength.
    fn shading_at(&self, hit: &SurfaceInteraction, current: MediumStack, line: Line) -> Option<Shading> {
        let [near, far] = self.sides(&current, hit)?;
        let [inside, outside] = if hit.is_front() { [far, near] } else { [near, far] };
        let ior = |id| f64::from(self.medium(id).ior_at(line));
        let interface = Dielectric::new(ior(outside), ior(inside));
        let shading = hit.shading_between(self.material(hit), Some(interface));
        Some(Shading { disperses: true, ..shading })
    }

    /// Whether the index of a medium depends on the wavelength.
    #[inline]
    fn disperses_in(&self, id: MediumId) -> bool {
        self.medium(id).dispersion.is_some()
    }

    /// Whether the index of refraction of any medium depends on the wavelength.
    #[inline]
    pub fn disperses(&self) -> bool {
        self.disperses
    }

    /// By channel, the reflectance of a smooth interface that disperses light over that of `shading`, which is the one at the d line: a
    /// path that is reflected there needs no wavelength. `None` where it needs one to be reflected, because some wavelengths may be
    /// reflected totally, or because the surface is not a smooth interface alone.
    ///
    /// A channel's reflectance is taken at its mean index. The error is of second order in the variation of the index: 1e-5 for heavy
    /// flint.
    pub fn reflected_colour(
        &self,
        hit: &SurfaceInteraction,
        current: MediumStack,
        shading: &Shading,
        wavelengths: Wavelengths,
    ) -> Option<Rgb> {
        if !matches!(shading.bsdf, Bsdf::Dielectric(_)) {
            return None;
        }
        let sides = self.sides(&current, hit)?.map(|id| self.medium(id));
        let range = |medium: &Medium| medium.dispersion.as_ref().map_or([medium.ior; 2], LineIndices::range);
        let [[_, largest_near], [least_far, _]] = sides.map(range);
        if largest_near >= least_far {
            return None;
        }
        let of_channels = |medium: &Medium| {
            let indices = medium.dispersion.as_ref();
            indices.map_or(Rgb::splat(medium.ior), |indices| indices.of_channels(wavelengths))
        };
        let [near, far] = sides.map(of_channels);
        let cosine = shading.wo_local.z;
        let usual = fresnel_dielectric(cosine, sides[1].ior / sides[0].ior);
        let reflected = (far / near).map(|eta| fresnel_dielectric(cosine, eta));
        Some(if usual > 0.0 { reflected / usual } else { Rgb::ONE })
    }

    /// Medium stack after scattering from within `current` into `direction`. `None` where, by rounding, the direction is on the other
    /// side of the surface than the one it was sampled for.
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

    /// Medium stack that an interface implies if a ray meets it from inside a body that the ray has not entered; `None` where the
    /// interface is consistent with `current`. An inconsistency means that the scene's interfaces contradict each other.
    #[inline]
    pub fn mismatch(&self, hit: &SurfaceInteraction, current: MediumStack) -> Option<MediumStack> {
        if hit.borders.is_empty() && current.is_within(self.stated_sides(hit)?[0]) && !current.is_full() {
            return None;
        }
        let crossing = self.crossing(current, hit).filter(|crossing| !crossing.fits)?;
        self.misfits.note(hit.surface);
        Some(crossing.before)
    }

    /// Names of the surfaces at which [`Self::mismatch`] found most of the contradictions, the worst first.
    pub fn mismatched(&self) -> Vec<&str> {
        let names = self.misfits.worst().into_iter().map(|id| self.parts.surfaces[id as usize].name.as_str());
        let mut seen = BTreeSet::new();
        names.filter(|name| seen.insert(*name)).collect()
    }

    /// The bodies that contain `point`: the majority over rays in many directions, each of which yields the bodies that it leaves. Air
    /// where no ray meets an interface.
    pub fn medium_at(&self, point: Vec3) -> MediumStack {
        self.medium_around(&[(point, Vec3::ZERO)]).0
    }

    /// The bodies that contain each light.
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

    /// [`Self::medium_at`] by the majority over rays from all `points`, each sent to the side of the point's normal unless that is zero.
    /// Also returns whether more than a quarter of the votes differ from the majority.
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
        // With equal counts, the stack that was found first wins.
        let best = votes.iter().rev().max_by_key(|(_, count)| count);
        best.map_or((MediumStack::AIR, false), |&(found, count)| (found, 4 * (all - count) > all))
    }

    /// The bodies around `end`, where a straight way from `start` leads that begins within `current`: as the interfaces between them say.
    /// Opaque surfaces are passed.
    pub fn medium_along(&self, start: Vec3, mut current: MediumStack, end: Vec3) -> MediumStack {
        // A way that crosses more surfaces than this is not followed to its end.
        const CROSSINGS: u32 = 1000;
        let Some(direction) = unit(end - start).filter(|_| self.has_interfaces) else { return current };
        let within = |ray: Ray| Ray { t_max: (end - ray.origin).dot(direction), ..ray };
        let mut ray = within(Ray::new(start, direction));
        for _ in 0..CROSSINGS {
            if !(ray.t_max > 0.0) {
                break;
            }
            let Some(hit) = self.intersect(&ray) else { break };
            current = self.crossing_behind(current, &hit).map_or(current, |crossing| crossing.after);
            ray = within(hit.spawn(direction));
        }
        current
    }

    /// The bodies that a ray leaves without having entered them; `None` where it meets no interface. Opaque surfaces do not bound media
    /// and are passed.
    fn left_along(&self, mut ray: Ray) -> Option<MediumStack> {
        // A ray that crosses more surfaces than this has no vote.
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
                // An interface that names both media declares which medium fills the place; within another body that is a contradiction.
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

/// The bodies in which the rays of a camera start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraMedia {
    at_eye: MediumStack,
    /// The eye, where rays start far from it.
    follows: Option<Vec3>,
}

impl CameraMedia {
    /// For a camera in `scene`.
    pub fn of(scene: &Scene, camera: &Camera) -> Self {
        let eye = camera.eye();
        Self { at_eye: scene.medium_at(eye), follows: camera.has_parallel_rays().then_some(eye) }
    }

    /// The bodies around the origin of a ray of the camera.
    #[inline]
    pub fn at(&self, scene: &Scene, origin: Vec3) -> MediumStack {
        match self.follows {
            Some(eye) => scene.medium_along(eye, self.at_eye, origin),
            None => self.at_eye,
        }
    }
}

impl From<MediumStack> for CameraMedia {
    fn from(at_eye: MediumStack) -> Self {
        Self { at_eye, follows: None }
    }
}
