//! Emitters that the camera sees directly: their emission is sampled with more rays than the rest of the picture.
//!
//! An emitter is far brighter than the surfaces it lights. A sliver of one behind an edge, hit by one camera sample in a thousand, is a
//! white dot in one picture and missing in the next. Direct emission needs no shading, so where a pixel may see an emitter, more rays
//! sample its emission alone. Each ray is one more sample of the pixel's filter: nothing is blurred, and the mean does not change.

use super::pixels::RenderRequest;
use crate::camera::{Camera, CameraRay, FilmPlace, PictureDisc};
use crate::film::{FilterSampler, PixelRect};
use crate::lights::Light;
use crate::math::Rgb;
use crate::sampling::Rng;
use crate::scene::{CameraMedia, Scene};
use crate::transport::emission_along;
use glam::{Vec2, Vec3};

/// The number of extra rays per camera sample is the square of this number.
const SIDE: u32 = 4;

/// Largest tangent of the half angle under which an emitter gets extra rays. Larger emitters are left to the camera samples, which agree
/// everywhere but at the edges.
const WIDEST: f32 = 0.3;

/// A disc on the picture that contains an emitter, in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampDisc {
    center: Vec2,
    radius: f32,
}

impl LampDisc {
    /// Whether samples of the pixel with this centre may see the emitter.
    pub(super) fn is_near(&self, pixel: Vec2) -> bool {
        self.center.distance_squared(pixel) <= self.radius * self.radius
    }
}

/// The emitters in a picture.
#[derive(Clone, Debug, Default)]
pub(super) struct VisibleEmitters {
    lamps: Vec<LampDisc>,
    media: CameraMedia,
}

impl VisibleEmitters {
    /// The emitters that `camera`, inside `media`, may see.
    pub(super) fn new(scene: &Scene, camera: &Camera, media: CameraMedia, request: &RenderRequest) -> Self {
        let size = Vec2::new(request.width as f32, request.height as f32);
        let margin = request.filter.radius() * std::f32::consts::SQRT_2 + 0.5;
        let images = scene.lights().iter().filter_map(|light| image_of(camera, light));
        let copies: &[f32] = if camera.wraps_around() { &[0.0, -1.0, 1.0] } else { &[0.0] };
        let lamps = images.flat_map(|image| {
            copies.iter().map(move |&turn| LampDisc {
                center: (image.center + turn * Vec2::X) * size,
                radius: image.radius * size.y + margin,
            })
        });
        Self { lamps: lamps.collect(), media }
    }

    /// The emitters that pixels of a rectangle may see.
    pub(super) fn near(&self, rect: PixelRect) -> Vec<LampDisc> {
        let (low, high) =
            (Vec2::new(rect.x0 as f32, rect.y0 as f32), Vec2::new(rect.x1 as f32, rect.y1 as f32));
        let distance = |lamp: &LampDisc| (lamp.center - lamp.center.clamp(low, high)).length();
        self.lamps.iter().copied().filter(|lamp| distance(lamp) <= lamp.radius).collect()
    }

    /// Refined emission of a camera sample at `place` with filter weight `weight`: the mean of `found`, the emission along its own ray,
    /// and of the extra rays.
    pub(super) fn refined(
        &self,
        scene: &Scene,
        (camera, sampler, place, weight): (&Camera, &FilterSampler, FilmPlace, f32),
        found: Rgb,
        mut numbers: Rng,
    ) -> Rgb {
        let mut sum = found * weight;
        for cell in 0..SIDE * SIDE {
            let jitter = numbers.next_2d();
            let u = (Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32) + jitter) / SIDE as f32;
            let other = sampler.sample(u.min(Vec2::splat(crate::sampling::ONE_MINUS_EPSILON)));
            let lens = camera.lens().map_or(Vec2::ZERO, |_| numbers.next_2d());
            let ray = CameraRay::new(camera, FilmPlace { offset: other.offset, ..place }, lens).ray;
            sum += emission_along(scene, &ray, self.media.at(scene, ray.origin)) * other.weight;
        }
        sum / ((SIDE * SIDE + 1) as f32 * weight)
    }
}

/// Where the picture may show an emitter that is small on it.
fn image_of(camera: &Camera, light: &Light) -> Option<PictureDisc> {
    if camera.has_parallel_rays() {
        let Light::Area(area) = light else { return None };
        let (center, radius) = area.bounding_sphere()?;
        // The tangent of a camera with a field of view of 53 degrees, whose picture is one distance high.
        return camera.image_of_sphere(center, radius).filter(|image| image.radius < WIDEST);
    }
    let (direction, tangent) = seen_from(camera, light)?;
    camera.image_of_cone(direction, tangent)
}

/// Direction from the eye to the centre of an emitter, and the tangent of the half angle of a cone that contains it as seen from any point
/// of the lens.
fn seen_from(camera: &Camera, light: &Light) -> Option<(Vec3, f32)> {
    let blur = |inverse_distance: f32| {
        camera.lens().map_or(0.0, |lens| (lens.radius as f32) * (inverse_distance + 1.0 / lens.focus as f32))
    };
    let (direction, tangent) = match light {
        Light::Area(area) => {
            let (center, radius) = area.bounding_sphere()?;
            let to_lamp = center.as_vec3() - camera.eye();
            let (distance, radius) = (to_lamp.length(), radius as f32);
            if !(distance > radius) {
                return None;
            }
            let nearest = 1.0 / (distance - radius);
            (to_lamp / distance, radius / (distance * distance - radius * radius).sqrt() + blur(nearest))
        }
        Light::Sun(sun) => (sun.towards(), sun.angular_radius().tan() + blur(0.0)),
        Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Environment(_) => return None,
    };
    (tangent < WIDEST).then_some((direction, tangent))
}
