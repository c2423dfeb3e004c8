//! Light that comes from no surface: point, spot and parallel lights, the sun, and light from all directions.

use super::model::{Model, OFF};
use crate::lights::{Light, Receiver};
use crate::math::{Ray, Rgb};
use crate::sampling::{Rng, Stream};
use crate::scene::Scene;
use glam::DVec2;

/// Strata along each coordinate of an element.
const SIDE: u32 = 3;

/// Rays from each stratum to a light that fills many directions.
const WIDE: u32 = 16;

/// Irradiance of an element by the lights of the scene that have no surface, mean over its area, and the largest minus the smallest at its
/// points; W/m^2 times the power factor of render space, with the cosine.
pub(super) fn irradiance_by_lights(scene: &Scene, model: &Model, index: u32, seed: u64) -> (Rgb, Rgb) {
    let has_surface = |light: &&Light| matches!(light, Light::Area(_));
    if scene.lights().iter().all(|light| has_surface(&light)) {
        return (Rgb::ZERO, Rgb::ZERO);
    }
    let element = &model.elements[index as usize];
    let mut rng = Rng::new(seed, Stream::RadiosityLights, u64::from(index));
    let (mut sum, mut low, mut high) = (Rgb::ZERO, Rgb::INFINITY, Rgb::ZERO);
    for i in 0..SIDE * SIDE {
        let cell = DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE));
        let u = (cell + DVec2::new(rng.next_f64(), rng.next_f64())) / f64::from(SIDE);
        let place = element.domain.point(&model.charts, u);
        let facing = model.normal(element, place);
        let (position, normal) = ((place + facing * OFF).as_vec3(), facing.as_vec3());
        let mut here = Rgb::ZERO;
        for light in scene.lights().iter().filter(|light| !has_surface(light)) {
            let rays = if light.is_delta() { 1 } else { WIDE };
            for _ in 0..rays {
                let u = rng.next_2d();
                let Some(sample) = light.sample_li(Receiver { position, normal }, u) else { continue };
                let cosine = sample.wi.dot(normal);
                if cosine > 0.0 {
                    let ray = match sample.target {
                        Some(target) => Ray::segment(position, target),
                        None => Ray::new(position, sample.wi),
                    };
                    if !scene.occluded(&ray) {
                        here += sample.radiance_over_pdf * (cosine / rays as f32);
                    }
                }
            }
        }
        sum += here;
        (low, high) = (low.min(here), high.max(here));
    }
    (sum / (SIDE * SIDE) as f32, (high - low).max(Rgb::ZERO))
}
