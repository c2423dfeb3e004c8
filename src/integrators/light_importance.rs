//! How much each of many lights contributes to the picture, found by a short pass from the camera before photons are shared
//! out: a light in another room gets few of them, one in this room many.

use crate::bsdf::Lobe;
use crate::camera::Camera;
use crate::lights::{LIGHTS_SAMPLED_EACH, LightId, LightSample};
use crate::math::{Ray, Rgb, unit};
use crate::photons::{CausticSurvey, survey_caustics};
use crate::sampling::{SampleStream, Stream, mix, refined};
use crate::scene::{Scene, SurfaceInteraction};
use crate::transport::{receiver, shadow_ray};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Paths along each side of the picture, where lights are many, and where each is looked at by itself.
const SIDE: u32 = 96;
const SIDE_OF_FEW: u32 = 40;

/// Surfaces of a path.
const DEPTH: u32 = 6;

/// Lights drawn at each surface of a path from those that are not sampled one by one.
const DRAWN: u32 = 4;

/// Interfaces that light may pass on its way to a surface, as through a window.
const PANES: u32 = 8;

/// Caustic photons of each light by which its caustics in the picture are told.
const CAUSTIC_PHOTONS: u64 = 2048;

/// Part of the photons that is shared out by flux whatever the paths found: a light gets no less than this part of what it would
/// get by flux, so that its photons are at most so many times stronger than the mean.
pub const SHARE_BY_FLUX: f64 = 0.2;

/// Few lights share photons by flux as long as none of them deserves more than so many times as many.
const STARVED: f64 = 2.0;

/// By light, what its photons by flux are to be multiplied by; positive. It changes noise, and no light.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonBudget {
    /// For the global map.
    pub global: Vec<f64>,
    /// For the caustic map.
    pub caustic: Vec<f64>,
}

/// How photons are to be shared out, so that they come by the light that the camera sees of each, mostly: for the global map by
/// indirect light, for the caustic map by caustics; with at least [`SHARE_BY_FLUX`] of the share by flux. The same for any
/// number of threads. `None` where sharing by flux does as well, or no path met light that had been reflected.
pub fn light_importance(scene: &Scene, camera: &Camera, seed: u64) -> Option<PhotonBudget> {
    let lights = scene.lights();
    let is_few = lights.len() <= LIGHTS_SAMPLED_EACH;
    let side = if is_few { SIDE_OF_FEW } else { SIDE };
    let rows: Vec<Found> = (0..side)
        .into_par_iter()
        .map(|row| {
            let mut found = Found::default();
            for column in 0..side {
                trace(scene, camera, ((column, row), side), seed, &mut found);
            }
            found
        })
        .collect();
    let mut seen = vec![0.0; lights.len()];
    for &(light, value) in rows.iter().flat_map(|row| &row.lights) {
        seen[light as usize] += value;
    }
    let radius = scene.bounds().1;
    let flux: Vec<f64> = lights.iter().map(|light| light.flux(radius).max_element()).collect();
    let global = factors(&seen, &flux);
    if !is_few {
        let global = global?;
        return Some(PhotonBudget { caustic: global.clone(), global });
    }
    let even = || vec![1.0; lights.len()];
    let global = global.filter(|factors| is_starving(factors)).unwrap_or_else(even);
    let caustic = if scene.casters().is_empty() {
        None
    } else {
        let eyes: Vec<Eye> = rows.into_iter().flat_map(|row| row.eyes).collect();
        let survey = survey_caustics(scene, CAUSTIC_PHOTONS, seed);
        let aimed: Vec<f64> = survey.iter().map(|light| light.importance).collect();
        let notes = (0..lights.len()).map(|light| f64::from(scene.light_note(light).photons));
        let aimed: Vec<f64> = aimed.into_iter().zip(notes).map(|(aimed, note)| aimed / note).collect();
        factors(&caustics_seen(&survey, &eyes), &aimed)
    };
    let caustic = caustic.filter(|factors| is_starving(factors)).unwrap_or_else(even);
    let is_even = |factors: &[f64]| factors.iter().all(|&factor| factor == 1.0);
    (!(is_even(&global) && is_even(&caustic))).then_some(PhotonBudget { global, caustic })
}

/// What shares by `flux` are to be multiplied by to become mostly those of what is `seen`.
fn factors(seen: &[f64], flux: &[f64]) -> Option<Vec<f64>> {
    let (all_seen, all_flux) = (seen.iter().sum::<f64>(), flux.iter().sum::<f64>());
    if !(all_seen > 0.0 && all_seen.is_finite() && all_flux > 0.0) {
        return None;
    }
    let factor = |(&seen, &flux): (&f64, &f64)| {
        if flux > 0.0 {
            SHARE_BY_FLUX + (1.0 - SHARE_BY_FLUX) * (seen / all_seen) / (flux / all_flux)
        } else {
            1.0
        }
    };
    Some(seen.iter().zip(flux).map(factor).collect())
}

/// Whether some light deserves many more photons than its flux gives it.
fn is_starving(factors: &[f64]) -> bool {
    factors.iter().any(|&factor| factor > STARVED)
}

/// What paths found.
#[derive(Default)]
struct Found {
    /// Light that arrives behind a diffuse reflection, by what the picture shows of it.
    lights: Vec<(LightId, f64)>,
    /// Where caustics would be seen.
    eyes: Vec<Eye>,
}

/// A diffuse surface that the camera sees, directly or by specular surfaces.
struct Eye {
    position: Vec3,
    /// On the side that is seen.
    normal: Vec3,
    /// About the distance to what the next path sees: a place stands for as much around it.
    radius: f32,
    /// Radiance in the picture over the irradiance there.
    weight: f32,
}

/// By light, the caustics of it that the camera sees; or where it sees none, all that there are.
fn caustics_seen(survey: &[CausticSurvey], eyes: &[Eye]) -> Vec<f64> {
    let of_photon = |photon: &crate::photons::Photon| -> f64 {
        let seen = |eye: &Eye| {
            let is_near = eye.position.distance_squared(photon.position) <= eye.radius * eye.radius;
            if is_near && photon.normal().dot(eye.normal) > 0.0 {
                f64::from(eye.weight) / f64::from(eye.radius).powi(2)
            } else {
                0.0
            }
        };
        f64::from(photon.power().max_element()) * eyes.iter().map(seen).sum::<f64>()
    };
    let seen: Vec<f64> = survey.par_iter().map(|light| light.photons.iter().map(of_photon).sum()).collect();
    if seen.iter().sum::<f64>() > 0.0 {
        return seen;
    }
    let power = |light: &CausticSurvey| {
        light.photons.iter().map(|photon| f64::from(photon.power().max_element())).sum()
    };
    survey.iter().map(power).collect()
}

/// One path, and what lights send to its surfaces behind a diffuse reflection.
fn trace(scene: &Scene, camera: &Camera, ((x, y), side): ((u32, u32), u32), seed: u64, found: &mut Found) {
    let pixel = u64::from(y) * u64::from(side) + u64::from(x);
    let mut samples = SampleStream::new(mix(seed ^ Stream::LightImportance as u64), pixel, 0);
    let position = (Vec2::new(x as f32, y as f32) + samples.next_2d()) / side as f32;
    let (mut ray, mut throughput, mut is_indirect) = (camera.ray(position), Rgb::ONE, false);
    let beside = camera.ray(position + Vec2::splat(1.0 / side as f32)).direction;
    let (angle, mut way) = ((beside - ray.direction).length(), 0.0);
    for _ in 0..DEPTH {
        let Some(hit) = scene.intersect(&ray) else { return };
        let shading = hit.shading(scene.material(&hit));
        let albedo = shading.bsdf.lobe_albedo(Lobe::Diffuse, shading.wo_local);
        way += hit.distance;
        if is_indirect && albedo != Rgb::ZERO {
            gather(scene, &hit, throughput * albedo, &mut samples, &mut found.lights);
        } else if albedo != Rgb::ZERO {
            let weight = (throughput * albedo).max_element();
            let (position, normal) = (hit.point.position, hit.facing_normal());
            found.eyes.push(Eye { position, normal, radius: angle * way, weight });
        }
        let (u_lobe, u) = (samples.next_1d(), samples.next_2d());
        let Some(sample) = shading.sample(u_lobe, u) else { return };
        throughput *= sample.throughput;
        is_indirect |= sample.lobe == Lobe::Diffuse;
        if !(throughput.max_element() > 1e-3) {
            return;
        }
        ray = hit.spawn(shading.frame.to_world(sample.wi));
    }
}

/// Irradiance by each light, times `weight`.
fn gather(
    scene: &Scene,
    hit: &SurfaceInteraction,
    weight: Rgb,
    samples: &mut SampleStream,
    found: &mut Vec<(LightId, f64)>,
) {
    let at = receiver(scene, hit);
    let normal = hit.facing_normal();
    let mut add = |light: LightId, probability: f32, u: Vec2| {
        let Some(sample) = scene.lights()[light as usize].sample_li(at, u) else { return };
        let cosine = sample.wi.dot(normal);
        let value = (weight * sample.radiance_over_pdf).max_element() * cosine / probability;
        if !(value > 0.0 && value.is_finite()) {
            return;
        }
        if arrives(scene, hit, &sample) {
            found.push((light, value.into()));
        }
    };
    let choice = scene.light_choice();
    for &light in choice.each() {
        add(light, 1.0, samples.next_2d());
    }
    for group in choice.groups() {
        for _ in 0..DRAWN {
            let u = refined(samples.next_2d());
            let Some((light, probability)) = group.sample(&at, u) else { continue };
            add(light, probability * DRAWN as f32, samples.next_2d());
        }
    }
}

/// Whether light reaches a surface, straight or by panes that it passes nearly straight.
fn arrives(scene: &Scene, hit: &SurfaceInteraction, sample: &LightSample) -> bool {
    let ray = shadow_ray(hit, sample);
    if !scene.occluded(&ray) {
        return true;
    }
    let Some(direction) = unit(ray.direction) else { return false };
    let mut ray = Ray { origin: ray.origin, direction, t_max: ray.t_max * ray.direction.length() };
    for _ in 0..PANES {
        let Some(pane) = scene.intersect(&ray) else { return true };
        if scene.material(&pane).media().is_none() {
            return false;
        }
        ray = Ray { t_max: ray.t_max - pane.distance, ..pane.spawn(direction) };
        if !(ray.t_max > 0.0) {
            return true;
        }
    }
    false
}
