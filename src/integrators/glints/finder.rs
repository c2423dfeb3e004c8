//! Glint finder: searches for emitters behind specular chains before the image is rendered.

use super::chain::{Chain, ChainEnd};
use crate::camera::{Camera, CameraRay, FilmPlace};
use crate::integrators::Scratch;
use crate::integrators::specular::{Branch, push_children, push_specular};
use crate::lights::{Light, LightId};
use crate::math::{Frame, Ray};
use crate::media::MediumStack;
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, Scene};
use crate::settings::Wavelengths;
use crate::transport::{Arrival, Event, next_event};
use glam::{Mat2, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Offsets in pixels at which the two neighbours of a camera ray start; the first offset at which the neighbour meets the same surfaces
/// is used.
const STEPS_BESIDE: [f32; 4] = [NARROW * 16.0, NARROW * -16.0, NARROW, -NARROW];

/// Smallest of these offsets.
const NARROW: f32 = 1.0 / 512.0;

/// Tangent of the largest angle between a ray and an emitter at which the search starts.
const NEAR: f32 = 0.5;

/// Largest number of steps of Newton's method, and how often a step is halved where it leads away from the emitter.
const STEPS: u32 = 8;
const HALVINGS: u32 = 4;

/// Largest length of a single step, pixels.
const LONGEST_STEP: f32 = 2.0;
/// Largest distance of a glint from the place where its search started, pixels.
pub const FARTHEST_GLINT: f32 = 6.0;

/// An emitter is found where a ray passes its centre within this share of its radius.
const CLOSE: f32 = 0.1;

/// Factor by which ellipses are larger than the image of the emitter, because that image is not an exact ellipse.
const MARGIN: f32 = 1.3;

/// Longest semi-axis of an ellipse, pixels.
const LONGEST_AXIS: f32 = 1.0;

/// Number of points of an ellipse, beside its centre, at which the throughput of the chain is evaluated.
const AROUND: u32 = 6;

/// Smallest assumed throughput of a chain: elsewhere in the ellipse the throughput may be larger than the values that were found.
const LEAST_THROUGHPUT: f32 = 0.02;

/// Images with at least this area need no help, square pixels.
const LARGEST: f32 = 1.0;

/// An emitter behind a specular chain, with the place where the image shows it.
#[derive(Clone, Copy, Debug)]
pub struct Glint {
    pub(super) chain: Chain,
    pub(super) ellipse: Ellipse,
    /// Radiance that arrives, brightest channel, times the area of the ellipse.
    pub(super) weight: f32,
}

/// An ellipse on the image plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ellipse {
    /// Centre of a pixel, in pixels from the corner of the image.
    pixel: Vec2,
    /// Centre of the ellipse relative to the pixel's centre. Pixels from the corner of the image are too coarse for ellipses of a
    /// thousandth of a pixel.
    center: Vec2,
    /// Unit direction of its first axis.
    axis: Vec2,
    /// Semi-axes, pixels.
    radii: Vec2,
}

impl Ellipse {
    /// Ellipse of all points within `radius` of the centre of an emitter, where a step of one pixel moves the ray by `moves` there.
    fn image((pixel, center): (Vec2, Vec2), radius: f32, moves: Mat2) -> Self {
        // Axes of the symmetric matrix M^T M.
        let (xx, yy) = (moves.x_axis.length_squared(), moves.y_axis.length_squared());
        let xy = moves.x_axis.dot(moves.y_axis);
        let axis = Vec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
        let reach = |axis: Vec2| LONGEST_AXIS.min(radius / (moves * axis).length());
        Self { pixel, center, axis, radii: Vec2::new(reach(axis), reach(axis.perp())) }
    }

    pub(super) fn area(&self) -> f32 {
        PI * self.radii.element_product()
    }

    /// Longest semi-axis.
    pub(super) fn reach(&self) -> f32 {
        self.radii.max_element()
    }

    /// Its centre, in pixels from the corner of the image.
    pub(super) fn middle(&self) -> Vec2 {
        self.pixel + self.center
    }

    /// Its centre relative to the centre `pixel` of a pixel.
    pub(super) fn offset_from(&self, pixel: Vec2) -> Vec2 {
        (self.pixel - pixel) + self.center
    }

    /// Whether it contains the point at `offset` from the centre `pixel` of a pixel.
    pub(super) fn contains(&self, pixel: Vec2, offset: Vec2) -> bool {
        let offset = offset - self.offset_from(pixel);
        (Vec2::new(offset.dot(self.axis), offset.dot(self.axis.perp())) / self.radii).length_squared() < 1.0
    }

    /// Whether the centre of `other` lies within this ellipse scaled by `share`.
    pub(super) fn is_near(&self, other: &Self, share: f32) -> bool {
        self.contains(self.pixel, self.center + (other.offset_from(self.pixel) - self.center) / share)
    }

    /// Offset from its centre of the point that corresponds to a point of the unit disc.
    pub(super) fn at(&self, disc: Vec2) -> Vec2 {
        let scaled = disc * self.radii;
        self.axis * scaled.x + self.axis.perp() * scaled.y
    }
}

/// A small emitter, treated as a disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    pub id: LightId,
    /// Centre of the bounding sphere; for the sun, the unit direction towards it.
    centre: Vec3,
    /// Radius of the bounding sphere; for the sun, the tangent of its angular radius.
    pub radius: f32,
    /// Radiance, brightest channel.
    radiance: f32,
    pub is_sun: bool,
}

impl Lamp {
    fn new(light: &Light, id: LightId) -> Option<Self> {
        match light {
            Light::Area(area) => {
                let (centre, radius) = area.bounding_sphere()?;
                let radiance = area.radiance().max_element();
                Some(Self { id, centre: centre.as_vec3(), radius: radius as f32, radiance, is_sun: false })
            }
            Light::Sun(sun) => {
                let (radius, radiance) = (sun.angular_radius().tan(), sun.radiance.max_element());
                Some(Self { id, centre: sun.towards(), radius, radiance, is_sun: true })
            }
            Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Environment(_) => None,
        }
    }

    /// Distance along a ray to the point closest to its centre, and the offset from there to the centre, across the ray. `None` where
    /// the centre is behind.
    pub(super) fn seen_from(&self, ray: &Ray) -> Option<(f32, Vec3)> {
        let offset = if self.is_sun { self.centre } else { self.centre - ray.origin };
        let along = offset.dot(ray.direction);
        let across = offset - ray.direction * along;
        (along > 0.0).then(|| if self.is_sun { (1.0, across / along) } else { (along, across) })
    }

    /// Whether a ray towards it sees it under an angle whose tangent is below `tangent`.
    pub(super) fn is_below(&self, ray: &Ray, tangent: f32) -> bool {
        self.seen_from(ray).is_some_and(|(along, _)| self.radius < tangent * along)
    }

    /// Tangent of the angle between a ray and the direction to its centre.
    fn miss(&self, ray: &Ray) -> Option<f32> {
        self.seen_from(ray).map(|(along, across)| across.length() / along)
    }
}

/// A ray behind a specular chain, with the camera ray it comes from.
struct Seen<'a> {
    camera: &'a CameraRay<'a>,
    chain: Chain,
    /// The ray that leaves the last surface.
    ray: Ray,
}

/// Searches for emitters behind specular chains.
#[derive(Clone, Debug)]
pub struct GlintFinder<'a> {
    pub(super) scene: &'a Scene,
    camera_media: CameraMedia,
    max_depth: u32,
    pub(super) lamps: Vec<Lamp>,
}

impl<'a> GlintFinder<'a> {
    /// For chains shorter than `max_depth`, from a camera in `camera_media`.
    pub fn new(scene: &'a Scene, camera_media: CameraMedia, max_depth: u32) -> Self {
        let lamps = scene.lights().iter().zip(0..).filter_map(|(light, id)| Lamp::new(light, id)).collect();
        Self { scene, camera_media, max_depth, lamps }
    }

    /// The bodies in which a camera ray starts.
    fn medium_of(&self, ray: &Ray) -> MediumStack {
        self.camera_media.at(self.scene, ray.origin)
    }

    /// Glints found from one place of the image. Also counts the emitters that the camera's ray itself hits there and that `of_pixel`
    /// samples of its pixel would hit less than once on average; branches that interfaces split count by their shares.
    pub fn look(
        &self,
        (camera, place): (&Camera, FilmPlace),
        of_pixel: f32,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> (Vec<Glint>, f32) {
        let lens = camera.lens().map_or(Vec2::ZERO, |_| samples.next_2d());
        let ray = CameraRay::new(camera, place, lens);
        let (mut found, mut met) = (Vec::new(), 0.0);
        let mut branches = std::mem::take(&mut scratch.branches);
        branches.clear();
        branches.push(Branch::from_eye(ray.ray, self.medium_of(&ray.ray)));
        while let Some(mut branch) = branches.pop() {
            let Some(chain) = branch.chain else { continue };
            if chain.is_lost() {
                continue;
            }
            if !chain.is_empty() {
                let seen = Seen { camera: &ray, chain, ray: branch.ray };
                found.extend(self.lamps.iter().filter_map(|lamp| self.solve(lamp, &seen)));
            }
            let event = next_event(self.scene, &branch.ray, &mut branch.medium);
            let Event::Surface(Arrival { hit, .. }) = event else { continue };
            if let Some(id) = self.scene.surface(&hit).light
                && !chain.is_empty()
                && self.certainty(&ray, chain, (id, &branch.ray), (of_pixel, 1.0)) < 1.0
            {
                met += branch.share;
            }
            let shading = self.scene.shading_within(&hit, branch.medium);
            if branch.depth + 1 >= self.max_depth || !shading.bsdf.has_specular() {
                continue;
            }
            if shading.bsdf.is_delta() {
                // A glint has no place of its own where light is dispersed: such chains are left out.
                let scene = (self.scene, Wavelengths::Off);
                push_children(&mut branches, &branch, scene, &hit, &shading, samples);
            } else {
                push_specular(&mut branches, &branch, self.scene, &hit, &shading, samples.next_1d());
            }
        }
        scratch.branches = branches;
        (found, met)
    }

    /// Solves for the place of the image from which the chain leads to the centre of the emitter.
    fn solve(&self, lamp: &Lamp, seen: &Seen<'_>) -> Option<Glint> {
        let start = seen.camera.place();
        let mut miss = lamp.miss(&seen.ray).filter(|&miss| miss < NEAR)?;
        let (mut offset, mut ray) = (Vec2::ZERO, seen.ray);
        for _ in 0..STEPS {
            let (along, across) = lamp.seen_from(&ray)?;
            let (frame, moves) = self.motion(lamp, seen, offset, &ray, along)?;
            let across = frame.to_local(across).truncate();
            if across.length() < CLOSE * lamp.radius {
                let ellipse =
                    Ellipse::image((start.center, start.offset + offset), MARGIN * lamp.radius, moves);
                let end = self.end(seen, offset)?;
                // The throughput of interfaces may vary a thousandfold across an ellipse, as at the limit of total reflection.
                let around = (0..AROUND).filter_map(|i| {
                    let disc = 0.7 * Vec2::from_angle(i as f32 * TAU / AROUND as f32);
                    Some(self.end(seen, offset + ellipse.at(disc))?.throughput.max_element())
                });
                let throughput =
                    around.fold(end.throughput.max_element(), f32::max).clamp(LEAST_THROUGHPUT, 1.0);
                let weight = throughput * lamp.radiance * ellipse.area();
                let is_small = ellipse.area() < LARGEST && ellipse.area() > 0.0 && weight > 0.0;
                return (is_small && self.meets(lamp, end)).then_some(Glint {
                    chain: seen.chain,
                    ellipse,
                    weight,
                });
            }
            let mut step = (moves.inverse() * across).clamp_length_max(LONGEST_STEP);
            if !step.is_finite() {
                return None;
            }
            let closer = (0..HALVINGS).find_map(|_| {
                let tried = self.end(seen, offset + step).map(|end| end.ray);
                let better =
                    tried.and_then(|ray| Some((ray, lamp.miss(&ray).filter(|&other| other < miss)?)));
                better.or_else(|| {
                    step *= 0.5;
                    None
                })
            });
            (ray, miss) = closer?;
            offset += step;
            if !(offset.length() < FARTHEST_GLINT) {
                return None;
            }
        }
        None
    }

    /// [`ChainEnd::chance`] of a camera ray.
    pub(super) fn chance(&self, camera: &CameraRay<'_>, chain: &Chain) -> Option<f32> {
        Some(chain.follow(self.scene, camera.ray, self.medium_of(&camera.ray))?.chance)
    }

    /// Weight of an emitter that is hit behind a chain: about how often `samples` of a pixel, sampled with this `density` per square
    /// pixel, hit it in the same part of the image as the camera's ray, at most one.
    ///
    /// An emitter whose image is so small that few renderings show it there is then no brighter in those than its image is on average
    /// over all renderings. The light that is left out vanishes as the number of samples grows.
    pub(super) fn certainty(
        &self,
        camera: &CameraRay<'_>,
        chain: Chain,
        (id, ray): (LightId, &Ray),
        (samples, density): (f32, f32),
    ) -> f32 {
        // An emitter that covers a large angle is visible on many paths.
        let lamp = self.lamps.iter().find(|lamp| lamp.id == id).filter(|lamp| lamp.is_below(ray, NEAR));
        let Some(lamp) = lamp else { return 1.0 };
        let area = || {
            let end = chain.follow(self.scene, camera.ray, self.medium_of(&camera.ray))?;
            let seen = Seen { camera, chain, ray: end.ray };
            let (along, _) = lamp.seen_from(&end.ray)?;
            let (_, moves) = self.motion(lamp, &seen, Vec2::ZERO, &end.ray, along)?;
            Some(PI * lamp.radius * lamp.radius / moves.determinant().abs() * end.chance)
        };
        // Where no neighbouring ray meets the same surfaces, the image is smaller than the distance between the rays.
        let area = area().unwrap_or(NARROW * NARROW);
        // The comparison is also false for NaN, where the whole image shows the emitter.
        if samples * density * area < 1.0 { samples * density * area } else { 1.0 }
    }

    /// Follows the chain from a place `offset` pixels beside the camera's ray.
    fn end(&self, seen: &Seen<'_>, offset: Vec2) -> Option<ChainEnd> {
        let ray = seen.camera.beside(offset);
        seen.chain.follow(self.scene, ray, self.medium_of(&ray))
    }

    /// How the ray at `offset` moves across itself with each pixel at the point where it passes the emitter; and the frame of that
    /// motion.
    fn motion(
        &self,
        lamp: &Lamp,
        seen: &Seen<'_>,
        offset: Vec2,
        ray: &Ray,
        along: f32,
    ) -> Option<(Frame, Mat2)> {
        let frame = Frame::from_z(ray.direction);
        let moved = |axis: Vec2| {
            STEPS_BESIDE.into_iter().find_map(|step| {
                let other = self.end(seen, offset + axis * step)?.ray;
                let direction = frame.to_local(other.direction);
                let origin = frame.to_local(other.origin - ray.origin);
                if !(direction.z > 0.1) {
                    return None;
                }
                let slope = direction.truncate() / direction.z;
                let at = if lamp.is_sun { slope } else { origin.truncate() + slope * (along - origin.z) };
                Some(at / step)
            })
        };
        Some((frame, Mat2::from_cols(moved(Vec2::X)?, moved(Vec2::Y)?)))
    }

    /// Whether the ray behind the chain actually hits the emitter.
    fn meets(&self, lamp: &Lamp, mut end: ChainEnd) -> bool {
        match next_event(self.scene, &end.ray, &mut end.medium) {
            Event::Surface(arrival) => self.scene.surface(&arrival.hit).light == Some(lamp.id),
            Event::Medium(_) => false,
            Event::Escape => lamp.is_sun,
        }
    }
}
