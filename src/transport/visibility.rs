//! Visibility and transmittance of light samples: occlusion by surfaces and absorption by the medium.

use super::media::transmittance_in_media;
use crate::lights::LightSample;
use crate::math::{Ray, Rgb};
use crate::media::{Medium, MediumStack};
use crate::scene::{Scene, SurfaceInteraction};

/// The segment from a surface to a sampled point of a light, or the ray towards one that is infinitely far away.
#[inline]
pub fn shadow_ray(hit: &SurfaceInteraction, sample: &LightSample) -> Ray {
    match sample.target {
        Some(target) => hit.spawn_to(target),
        None => hit.spawn(sample.wi),
    }
}

/// Share of the radiance of a light sample that arrives at a surface through the bodies of `medium`. `None` where a
/// surface is in between, even a transparent one: light through it is a caustic. Null interfaces of scattering media
/// are passed.
#[inline]
pub fn transmittance(
    scene: &Scene,
    hit: &SurfaceInteraction,
    sample: &LightSample,
    medium: &MediumStack,
) -> Option<Rgb> {
    let ray = shadow_ray(hit, sample);
    if scene.scatters() {
        return transmittance_in_media(scene, &ray, *medium);
    }
    if scene.occluded(&ray) {
        return None;
    }
    Some(attenuation(scene, medium, sample.distance))
}

/// Transmittance over `distance` (render space) within the bodies of `medium`.
#[inline]
pub fn attenuation(scene: &Scene, medium: &MediumStack, distance: f32) -> Rgb {
    attenuation_of(scene.medium(medium.medium()), distance).unwrap_or(Rgb::ONE)
}

/// Transmittance of a medium over `distance`; `None` where it is clear.
#[inline]
pub(super) fn attenuation_of(medium: &Medium, distance: f32) -> Option<Rgb> {
    (!medium.is_clear()).then(|| medium.transmittance(distance))
}
