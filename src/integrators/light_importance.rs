//! Light importance: a short pass from the camera estimates how much each light contributes to the image, before the photons are
//! distributed among the lights. A light in another room gets few photons, one in this room gets many.

use crate::bsdf::Lobe;
use crate::camera::{Camera, PixelSpread};
use crate::lights::{LIGHTS_SAMPLED_EACH, LightId, LightSample};
use crate::math::{Ray, Rgb, unit};
use crate::photons::{CausticSurvey, survey_caustics};
use crate::sampling::{SampleStream, Stream, mix, refined};
use crate::scene::{Scene, SurfaceInteraction};
use crate::transport::{receiver, shadow_ray};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Paths along each side of the image: the first where there are many lights, the second where each light is sampled by itself.
const SIDE: u32 = 96;
const SIDE_OF_FEW: u32 = 40;

/// Largest number of surfaces of a path.
const DEPTH: u32 = 6;

/// Lights sampled at each surface of a path, of those that are not sampled one by one.
const DRAWN: u32 = 4;

/// Number of interfaces that light may pass on its way to a surface, as through a window.
const PANES: u32 = 8;

/// Caustic photons per light that survey its caustics in the image.
const CAUSTIC_PHOTONS: u64 = 2048;

/// Part of the photons that is distributed by flux whatever the paths found. A light gets at least this part of its share by flux, so
/// that the power of its photons is at most the inverse of this times the mean.
pub const SHARE_BY_FLUX: f64 = 0.2;

/// A few lights keep their photon shares by flux as long as none of them deserves more than this factor times its share.
const STARVED: f64 = 2.0;

/// Factors, by light, on its number of photons by flux; positive. They change the noise but not the light.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonBudget {
    /// For the global map.
    pub global: Vec<f64>,
    /// For the caustic map.
    pub caustic: Vec<f64>,
}

/// Computes how photons are to be distributed, so that most of them follow the light of each emitter that the camera sees: indirect
/// light for the global map, caustics for the caustic map. Each light keeps at least [`SHARE_BY_FLUX`] of its share by flux. The result
/// is the same for any number of threads. `None` where distribution by flux is as good, or where no path met reflected light.
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

/// Factors that turn shares by `flux` into shares that mostly follow the light that is `seen`.
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

/// Results of the camera paths.
#[derive(Default)]
struct Found {
    /// Light that arrives behind a diffuse reflection, with its contribution to the image.
    lights: Vec<(LightId, f64)>,
    /// Visible points at which caustics would show.
    eyes: Vec<Eye>,
}

/// A diffuse surface point that the camera sees, directly or through specular surfaces.
struct Eye {
    position: Vec3,
    /// Normal on the visible side.
    normal: Vec3,
    /// Approximate distance to the point that the next path sees: the point represents its surroundings up to that distance.
    radius: f32,
    /// Radiance in the image over the irradiance at the point.
    weight: f32,
}

/// Visible caustics by light; if no caustics are visible, all caustics.
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

/// Traces one path and collects the light that arrives at its surfaces behind a diffuse reflection.
fn trace(scene: &Scene, camera: &Camera, ((x, y), side): ((u32, u32), u32), seed: u64, found: &mut Found) {
    let pixel = u64::from(y) * u64::from(side) + u64::from(x);
    let mut samples = SampleStream::new(mix(seed ^ Stream::LightImportance as u64), pixel, 0);
    let position = (Vec2::new(x as f32, y as f32) + samples.next_2d()) / side as f32;
    if !camera.shows(position) {
        return;
    }
    let (mut ray, mut throughput, mut is_indirect) = (camera.ray(position), Rgb::ONE, false);
    let beside = camera.ray(position + Vec2::splat(1.0 / side as f32));
    let (spread, mut way) = (PixelSpread::between(&ray, &beside), 0.0);
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
            found.eyes.push(Eye { position, normal, radius: spread.at(way), weight });
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

/// Collects the irradiance by each light, times `weight`.
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

/// Whether light reaches a surface, straight or through panes that it passes nearly straight.
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
