//! How much each of many lights contributes to the picture, found by a short pass from the camera before photons are shared
//! out: a light in another room gets few of them, one in this room many.

use super::direct::receiver;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::Camera;
use crate::lights::LightId;
use crate::math::{Ray, Rgb};
use crate::sampling::{SampleStream, Stream, mix, refined};
use crate::scene::{Scene, SurfaceInteraction};
use glam::Vec2;
use rayon::prelude::*;

/// Paths along each side of the picture.
const SIDE: u32 = 96;

/// Surfaces of a path.
const DEPTH: u32 = 6;

/// Lights drawn at each surface of a path from those that are not sampled one by one.
const DRAWN: u32 = 4;

/// Part of the photons that is shared out by flux whatever the paths found: a light gets no less than this part of what it would
/// get by flux, so that its photons are at most so many times stronger than the mean.
pub const SHARE_BY_FLUX: f64 = 0.2;

/// By light, what its photons by flux are to be multiplied by, so that they come to be shared by the indirect light that the
/// camera sees of each, mostly; at least [`SHARE_BY_FLUX`]. The same for any number of threads. `None` where no path met
/// light that had been reflected.
pub fn light_importance(scene: &Scene, camera: &Camera, seed: u64) -> Option<Vec<f64>> {
    let lights = scene.lights();
    let rows: Vec<Vec<(LightId, f64)>> = (0..SIDE)
        .into_par_iter()
        .map(|row| {
            let mut found = Vec::new();
            for column in 0..SIDE {
                trace(scene, camera, (column, row), seed, &mut found);
            }
            found
        })
        .collect();
    let mut seen = vec![0.0; lights.len()];
    for (light, value) in rows.into_iter().flatten() {
        seen[light as usize] += value;
    }
    let radius = scene.bounds().1;
    let flux: Vec<f64> = lights.iter().map(|light| light.flux(radius).max_element()).collect();
    let (all_seen, all_flux) = (seen.iter().sum::<f64>(), flux.iter().sum::<f64>());
    if !(all_seen > 0.0 && all_seen.is_finite() && all_flux > 0.0) {
        return None;
    }
    let factor = |(seen, flux): (f64, f64)| {
        if flux > 0.0 {
            SHARE_BY_FLUX + (1.0 - SHARE_BY_FLUX) * (seen / all_seen) / (flux / all_flux)
        } else {
            1.0
        }
    };
    Some(seen.into_iter().zip(flux).map(factor).collect())
}

/// One path, and what lights send to its surfaces behind a diffuse reflection.
fn trace(scene: &Scene, camera: &Camera, (x, y): (u32, u32), seed: u64, found: &mut Vec<(LightId, f64)>) {
    let pixel = u64::from(y) * u64::from(SIDE) + u64::from(x);
    let mut samples = SampleStream::new(mix(seed ^ Stream::LightImportance as u64), pixel, 0);
    let position = (Vec2::new(x as f32, y as f32) + samples.next_2d()) / SIDE as f32;
    let (mut ray, mut throughput, mut is_indirect) = (camera.ray(position), Rgb::ONE, false);
    for _ in 0..DEPTH {
        let Some(hit) = scene.intersect(&ray) else { return };
        let shading = hit.shading(scene.material(&hit));
        let albedo = shading.bsdf.lobe_albedo(Lobe::Diffuse, shading.wo_local);
        if is_indirect && albedo != Rgb::ZERO {
            gather(scene, &hit, throughput * albedo, &mut samples, found);
        }
        let (u_lobe, u) = (samples.next_1d(), samples.next_2d());
        let mode = TransportMode::Radiance;
        let Some(sample) = shading.bsdf.sample(shading.wo_local, u_lobe, u, mode) else { return };
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
        let ray: Ray = match sample.target {
            Some(target) => hit.spawn_to(target),
            None => hit.spawn(sample.wi),
        };
        if !scene.occluded(&ray) {
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
