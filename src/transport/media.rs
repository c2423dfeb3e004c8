//! Events and transmittance in scattering media.

use super::clearance::Clearance;
use super::event::{Arrival, Event};
use super::visibility::attenuation_of;
use crate::math::{Ray, Rgb};
use crate::media::density::Line;
use crate::media::{Distances, End, Losses, MediumStack, Phase, Volume};
use crate::sampling::{Rng, Stream, mix};
use crate::scene::{Scene, SurfaceInteraction};
use glam::{DVec3, Vec3};

/// Largest number of null interfaces that a ray passes; it ends without light if it meets more.
const MOST_INTERFACES: u32 = 1000;

/// A segment of a ray within one scattering medium.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// The line, from the start of the stretch.
    pub line: Line,
    /// Length of the stretch; infinite where it has no end.
    pub length: f64,
    /// The medium.
    pub volume: &'a Volume,
    /// The medium stack.
    pub medium: MediumStack,
    /// Weight of light from the stretch at the start of the ray: the transmittance so far over the density of reaching
    /// the stretch.
    pub weight: Rgb,
    /// Generator for estimates of transmittance.
    pub rng: Rng,
}

impl<'a> Stretch<'a> {
    /// The sampler of distances on the stretch for a light at `anchor`, if the light has a position, in a path of this
    /// throughput.
    pub fn distances(&self, anchor: Option<DVec3>, throughput: Rgb) -> Option<Distances<'a>> {
        Distances::new(self.volume, &self.line, self.length, anchor, throughput)
    }
}

/// A scattering event in a medium.
#[derive(Clone, Copy, Debug)]
pub struct Collision<'a> {
    /// The stretch in which it happens.
    pub stretch: Stretch<'a>,
    /// Distance from the start of the stretch.
    pub t: f64,
    /// Place, render space.
    pub position: Vec3,
    /// Distance from the start of the ray.
    pub distance: f32,
    /// Phase function there.
    pub phase: Phase,
}

/// The passage of a ray through media up to its event.
#[derive(Clone, Copy, Debug)]
pub struct Passage<'a> {
    /// The event that ends the ray.
    pub event: Event<'a>,
    /// Factor on the throughput of the path: transmittance over the density of the event, times the albedo for a
    /// scattering event.
    pub weight: Rgb,
    /// Radiance that the media themselves add to the ray, W/(m^2 sr) times the power factor of render space.
    pub emitted: Rgb,
}

/// The event that ends a ray of unit direction in a scene with scattering media ([`Scene::scatters`]);
/// [`super::next_event`] does this for other scenes. `throughput` is that of the path so far, `u` a uniform random
/// number of the path. `pass` receives each stretch within a scattering medium up to its far end, wherever the ray
/// collides.
///
/// Interfaces between media of the same index of refraction, of which one scatters, are null interfaces: the boundary
/// of a fog is no surface.
pub fn next_event_in_media<'a>(
    scene: &'a Scene,
    ray: &Ray,
    medium: &mut MediumStack,
    (throughput, u): (Rgb, f32),
    pass: impl FnMut(&Stretch<'a>),
) -> Passage<'a> {
    through_media(scene, ray, medium, (Some(throughput), u), pass)
}

/// [`next_event_in_media`] for a walk that knows its distance from surfaces: while it collides closer than that it traces no ray. The event
/// and its weight are the same; the length of its stretch may end anywhere after the collision.
pub fn walk_in_media<'a>(
    scene: &'a Scene,
    ray: &Ray,
    medium: &mut MediumStack,
    (throughput, u): (Rgb, f32),
    clearance: &mut Clearance,
    mut pass: impl FnMut(&Stretch<'a>),
) -> Passage<'a> {
    if let Some((collision, weight)) = collision_within(scene, ray, *medium, (throughput, u), clearance) {
        pass(&collision.stretch);
        return Passage { event: Event::Medium(collision), weight, emitted: Rgb::ZERO };
    }
    let passage = through_media(scene, ray, medium, (Some(throughput), u), pass);
    match &passage.event {
        Event::Medium(collision) => clearance.moved(collision.distance),
        Event::Surface(_) | Event::Escape => clearance.forget(),
    }
    passage
}

/// The collision of a walk, and its weight, if it is nearer than any surface.
fn collision_within<'a>(
    scene: &'a Scene,
    ray: &Ray,
    medium: MediumStack,
    (throughput, u): (Rgb, f32),
    clearance: &mut Clearance,
) -> Option<(Collision<'a>, Rgb)> {
    let volume = scene.medium(medium.medium()).volume.as_ref()?;
    let coefficients = volume.coefficients();
    if coefficients.scattering() == Rgb::ZERO || coefficients.emission() != Rgb::ZERO {
        return None;
    }
    let clear = clearance.at(scene, ray, volume);
    if clear == 0.0 {
        return None;
    }
    let (line, _) = Line::from_ray(ray)?;
    let mut rng = rng_of(ray, u);
    let own = rng.split();
    let flight = volume.fly(&line, f64::INFINITY, throughput, Losses::Weighted, &mut rng);
    let End::Scattered { t, weight } = flight.end else { return None };
    if !(t < f64::from(clear)) {
        return None;
    }
    clearance.moved((t as f32).next_up());
    let stretch = Stretch { line, length: clear.into(), volume, medium, weight: Rgb::ONE, rng: own };
    let position = line.at(t).as_vec3();
    let collision = Collision { stretch, t, position, distance: t as f32, phase: volume.phase() };
    Some((collision, weight * coefficients.albedo()))
}

/// As [`next_event_in_media`], for light that media do not scatter: the ray ends at a surface or leaves the scene, and its weight is the
/// transmittance, an unbiased estimate. For rays whose scattered light `pass` accounts for.
pub fn surface_through_media<'a>(
    scene: &'a Scene,
    ray: &Ray,
    medium: &mut MediumStack,
    u: f32,
    pass: impl FnMut(&Stretch<'a>),
) -> Passage<'a> {
    through_media(scene, ray, medium, (None, u), pass)
}

/// Both of the above; light is scattered where there is a throughput.
fn through_media<'a>(
    scene: &'a Scene,
    ray: &Ray,
    medium: &mut MediumStack,
    (throughput, u): (Option<Rgb>, f32),
    mut pass: impl FnMut(&Stretch<'a>),
) -> Passage<'a> {
    let mut rng = rng_of(ray, u);
    let (mut ray, mut passed) = (*ray, 0.0);
    let (mut weight, mut emitted) = (Rgb::ONE, Rgb::ZERO);
    for _ in 0..MOST_INTERFACES {
        let hit = scene.intersect(&ray);
        let filling = scene.medium(medium.medium());
        match (&filling.volume, Line::from_ray(&ray), &hit) {
            (Some(volume), Some((line, _)), hit) => {
                let t_max = hit.as_ref().map_or(f64::INFINITY, |hit| hit.distance.into());
                let stretch =
                    Stretch { line, length: t_max, volume, medium: *medium, weight, rng: rng.split() };
                pass(&stretch);
                match throughput {
                    Some(throughput) => {
                        let throughput = throughput * weight;
                        let flight = volume.fly(&line, t_max, throughput, Losses::Weighted, &mut rng);
                        emitted += weight * flight.emitted;
                        // Where nothing scatters, what passes need not be left to chance.
                        let end = if volume.coefficients().scattering() == Rgb::ZERO {
                            End::Escaped { weight: volume.transmittance(&line, t_max, &mut rng) }
                        } else {
                            flight.end
                        };
                        match end {
                            End::Scattered { t, weight: by } => {
                                weight *= by * volume.coefficients().albedo();
                                let position = line.at(t).as_vec3();
                                let distance = passed + t as f32;
                                let phase = volume.phase();
                                let collision = Collision { stretch, t, position, distance, phase };
                                return Passage { event: Event::Medium(collision), weight, emitted };
                            }
                            End::Escaped { weight: by } | End::Absorbed { weight: by, .. } => weight *= by,
                        }
                    }
                    None => {
                        if volume.coefficients().emission() != Rgb::ZERO {
                            let flight = volume.fly(&line, t_max, weight, Losses::Weighted, &mut rng);
                            emitted += weight * flight.emitted;
                        }
                        weight *= volume.transmittance(&line, t_max, &mut rng);
                    }
                }
            }
            (None, _, Some(hit)) => weight *= attenuation_of(filling, hit.distance).unwrap_or(Rgb::ONE),
            _ => {}
        }
        let Some(mut hit) = hit else { return Passage { event: Event::Escape, weight, emitted } };
        match scene.null_interface(*medium, &hit) {
            Some(after) => {
                passed += hit.distance;
                *medium = after;
                ray = hit.spawn(ray.direction);
            }
            None => {
                hit.distance += passed;
                let arrival = Arrival { hit, passed_null_interface: false, transmittance: None };
                return Passage { event: Event::Surface(arrival), weight, emitted };
            }
        }
    }
    Passage { event: Event::Escape, weight: Rgb::ZERO, emitted }
}

/// The first surface along a ray; scattering before it is ignored.
pub fn first_surface(scene: &Scene, ray: &Ray, mut medium: MediumStack) -> Option<SurfaceInteraction> {
    let (mut ray, mut passed) = (*ray, 0.0);
    for _ in 0..MOST_INTERFACES {
        let mut hit = scene.intersect(&ray)?;
        let Some(after) = scene.null_interface(medium, &hit) else {
            hit.distance += passed;
            return Some(hit);
        };
        passed += hit.distance;
        medium = after;
        ray = hit.spawn(ray.direction);
    }
    None
}

/// Transmittance of a segment, or of a ray to infinity, that starts within the bodies of `medium`: an unbiased
/// estimate. `None` where a surface is in between.
pub fn transmittance_in_media(scene: &Scene, segment: &Ray, mut medium: MediumStack) -> Option<Rgb> {
    let (line, length) = Line::from_ray(segment)?;
    let mut rng = rng_of(segment, 0.0);
    let direction = line.direction().as_vec3();
    // The end is offset from its own surface by less than the possible rounding of the length.
    let mut left = length as f32 * (1.0 - 4.0 * f32::EPSILON);
    let mut ray = Ray { t_max: left, ..Ray::new(segment.origin, direction) };
    let mut weight = Rgb::ONE;
    for _ in 0..MOST_INTERFACES {
        let hit = scene.intersect(&ray);
        let t_max = hit.as_ref().map_or(left, |hit| hit.distance);
        let filling = scene.medium(medium.medium());
        match (&filling.volume, Line::from_ray(&ray)) {
            (Some(volume), Some((line, _))) => {
                weight *= volume.transmittance(&line, t_max.into(), &mut rng);
            }
            _ if t_max.is_finite() => weight *= attenuation_of(filling, t_max).unwrap_or(Rgb::ONE),
            _ => {}
        }
        let Some(hit) = hit else { return Some(weight) };
        medium = scene.null_interface(medium, &hit)?;
        left -= hit.distance;
        if !(left > 0.0) {
            return Some(weight);
        }
        ray = Ray { t_max: left, ..hit.spawn(direction) };
    }
    None
}

/// A generator for the media along a ray. It depends on the ray and `u` alone, so that no event on the way shifts any
/// other random number.
fn rng_of(ray: &Ray, u: f32) -> Rng {
    let bits = |a: f32, b: f32| u64::from(a.to_bits()) << 32 | u64::from(b.to_bits());
    let (o, d) = (ray.origin, ray.direction);
    let key = mix(mix(bits(o.x, o.y)) ^ mix(bits(o.z, d.x).wrapping_add(1)) ^ bits(d.y, d.z));
    Rng::new(key, Stream::Media, u.to_bits().into())
}
