//! Looking for glints.

use super::chain::{Chain, ChainEnd};
use crate::camera::{Camera, CameraRay, FilmPlace};
use crate::integrators::Scratch;
use crate::integrators::specular::{Branch, push_children, push_specular};
use crate::lights::{Light, LightId};
use crate::math::{Frame, Ray};
use crate::media::MediumStack;
use crate::sampling::SampleStream;
use crate::scene::Scene;
use crate::transport::{Arrival, Event, next_event};
use glam::{Mat2, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// How far beside a ray of the camera the two others start, pixels; the first that meet the same surfaces.
const STEPS_BESIDE: [f32; 4] = [NARROW * 16.0, NARROW * -16.0, NARROW, -NARROW];

/// The least of those.
const NARROW: f32 = 1.0 / 512.0;

/// Tangent of the angle between a ray and a lamp up to which the lamp is looked for.
const NEAR: f32 = 0.5;

/// Steps of Newton's method, and how often one is halved where it leads away from the lamp.
const STEPS: u32 = 8;
const HALVINGS: u32 = 4;

/// Pixels that a single step may go.
const LONGEST_STEP: f32 = 2.0;
/// As far as glints may lie from the places that they are looked for from.
pub const FARTHEST_GLINT: f32 = 6.0;

/// A lamp is found where a ray passes its middle by less than this share of its radius.
const CLOSE: f32 = 0.1;

/// Ellipses are larger than the image of the lamp by this, as that is no ellipse.
const MARGIN: f32 = 1.3;

/// Longest half axis of an ellipse, pixels.
const LONGEST_AXIS: f32 = 1.0;

/// Points of an ellipse at which it is asked what a chain lets pass, beside its middle.
const AROUND: u32 = 6;

/// What a chain is taken to let pass, at least: what it lets pass elsewhere in the ellipse may be more than was found.
const LEAST_THROUGHPUT: f32 = 0.02;

/// Images of this area need no help, square pixels.
const LARGEST: f32 = 1.0;

/// A lamp behind a chain of specular surfaces.
#[derive(Clone, Copy, Debug)]
pub struct Glint {
    pub(super) chain: Chain,
    pub(super) ellipse: Ellipse,
    /// Radiance that arrives, brightest channel, times the area of the ellipse.
    pub(super) weight: f32,
}

/// An ellipse on the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ellipse {
    /// The middle of a pixel, pixels from the corner of the picture.
    pixel: Vec2,
    /// Its own middle from there: pixels from the corner of the picture are too coarse for ellipses of a thousandth of one.
    center: Vec2,
    /// Unit direction of the first of its axes.
    axis: Vec2,
    /// Half axes, pixels.
    radii: Vec2,
}

impl Ellipse {
    /// Of all that is within `radius` of the middle of a lamp, where a pixel moves the ray by `moves` there.
    fn image((pixel, center): (Vec2, Vec2), radius: f32, moves: Mat2) -> Self {
        // The axes of the symmetric matrix M^T M.
        let (xx, yy) = (moves.x_axis.length_squared(), moves.y_axis.length_squared());
        let xy = moves.x_axis.dot(moves.y_axis);
        let axis = Vec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
        let reach = |axis: Vec2| LONGEST_AXIS.min(radius / (moves * axis).length());
        Self { pixel, center, axis, radii: Vec2::new(reach(axis), reach(axis.perp())) }
    }

    pub(super) fn area(&self) -> f32 {
        PI * self.radii.element_product()
    }

    /// Longest half axis.
    pub(super) fn reach(&self) -> f32 {
        self.radii.max_element()
    }

    /// Its middle, pixels from the corner of the picture.
    pub(super) fn middle(&self) -> Vec2 {
        self.pixel + self.center
    }

    /// Its middle, from that of a `pixel`.
    pub(super) fn offset_from(&self, pixel: Vec2) -> Vec2 {
        (self.pixel - pixel) + self.center
    }

    /// Whether it contains what is at this `offset` from the middle of a `pixel`.
    pub(super) fn contains(&self, pixel: Vec2, offset: Vec2) -> bool {
        let offset = offset - self.offset_from(pixel);
        (Vec2::new(offset.dot(self.axis), offset.dot(self.axis.perp())) / self.radii).length_squared() < 1.0
    }

    /// Whether the middle of another is nearer to that of this than such a `share` of this.
    pub(super) fn is_near(&self, other: &Self, share: f32) -> bool {
        self.contains(self.pixel, self.center + (other.offset_from(self.pixel) - self.center) / share)
    }

    /// From its middle to the point of the ellipse for one of the unit disc.
    pub(super) fn at(&self, disc: Vec2) -> Vec2 {
        let scaled = disc * self.radii;
        self.axis * scaled.x + self.axis.perp() * scaled.y
    }
}

/// A lamp as a disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    pub id: LightId,
    /// Of a sphere around it; of the sun the unit direction to it.
    centre: Vec3,
    /// Of that sphere; of the sun its tangent.
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

    /// How far along a ray its middle is, and where from there, across the ray. `None` where that is behind.
    pub(super) fn seen_from(&self, ray: &Ray) -> Option<(f32, Vec3)> {
        let offset = if self.is_sun { self.centre } else { self.centre - ray.origin };
        let along = offset.dot(ray.direction);
        let across = offset - ray.direction * along;
        (along > 0.0).then(|| if self.is_sun { (1.0, across / along) } else { (along, across) })
    }

    /// Whether a ray that meets it sees it under an angle below that of this `tangent`.
    pub(super) fn is_below(&self, ray: &Ray, tangent: f32) -> bool {
        self.seen_from(ray).is_some_and(|(along, _)| self.radius < tangent * along)
    }

    /// Tangent of the angle between a ray and its middle.
    fn miss(&self, ray: &Ray) -> Option<f32> {
        self.seen_from(ray).map(|(along, across)| across.length() / along)
    }
}

/// A ray behind a chain, as the camera sees it.
struct Seen<'a> {
    camera: &'a CameraRay<'a>,
    chain: Chain,
    /// Leaves the last surface.
    ray: Ray,
}

/// Looks for lamps in glass and mirrors.
#[derive(Clone, Debug)]
pub struct GlintFinder<'a> {
    pub(super) scene: &'a Scene,
    camera_medium: MediumStack,
    max_depth: u32,
    pub(super) lamps: Vec<Lamp>,
}

impl<'a> GlintFinder<'a> {
    /// For chains shorter than `max_depth` from a camera in `camera_medium`.
    pub fn new(scene: &'a Scene, camera_medium: MediumStack, max_depth: u32) -> Self {
        let lamps = scene.lights().iter().zip(0..).filter_map(|(light, id)| Lamp::new(light, id)).collect();
        Self { scene, camera_medium, max_depth, lamps }
    }

    /// What is found from one place of the picture, and in how many ways the camera's ray itself meets lamps there that so many
    /// samples of its pixel (`of_pixel`) would meet less than once in the mean; shares where interfaces split it.
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
        branches.push(Branch::from_eye(ray.ray, self.camera_medium));
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
                push_children(&mut branches, &branch, self.scene, &hit, &shading, samples);
            } else {
                push_specular(&mut branches, &branch, self.scene, &hit, &shading, samples.next_1d());
            }
        }
        scratch.branches = branches;
        (found, met)
    }

    /// The place of the picture from which the chain leads to the middle of the lamp.
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
                // What interfaces let pass may change a thousandfold across an ellipse, as at the border of total reflection.
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

    /// [`ChainEnd::chance`] of a camera's ray.
    pub(super) fn chance(&self, camera: &CameraRay<'_>, chain: &Chain) -> Option<f32> {
        Some(chain.follow(self.scene, camera.ray, self.camera_medium)?.chance)
    }

    /// About how often so many `samples` of a pixel, drawn with this `density` per square pixel, meet a lamp behind a chain in the place
    /// where the camera's ray does, at most one: what its light counts for.
    ///
    /// A lamp that few pictures show in this place, as its image is that small, is then no brighter in those than its image is in the
    /// mean of all. What is left out vanishes as samples become many.
    pub(super) fn certainty(
        &self,
        camera: &CameraRay<'_>,
        chain: Chain,
        (id, ray): (LightId, &Ray),
        (samples, density): (f32, f32),
    ) -> f32 {
        // Of what is all around, many ways show some.
        let lamp = self.lamps.iter().find(|lamp| lamp.id == id).filter(|lamp| lamp.is_below(ray, NEAR));
        let Some(lamp) = lamp else { return 1.0 };
        let area = || {
            let end = chain.follow(self.scene, camera.ray, self.camera_medium)?;
            let seen = Seen { camera, chain, ray: end.ray };
            let (along, _) = lamp.seen_from(&end.ray)?;
            let (_, moves) = self.motion(lamp, &seen, Vec2::ZERO, &end.ray, along)?;
            Some(PI * lamp.radius * lamp.radius / moves.determinant().abs() * end.chance)
        };
        // Where no ray beside it meets the same surfaces, all that is seen so is smaller than the way between them.
        let area = area().unwrap_or(NARROW * NARROW);
        // False as well for what is not a number, where all of the picture shows the lamp.
        if samples * density * area < 1.0 { samples * density * area } else { 1.0 }
    }

    /// The chain followed from so many pixels beside the camera's ray.
    fn end(&self, seen: &Seen<'_>, offset: Vec2) -> Option<ChainEnd> {
        seen.chain.follow(self.scene, seen.camera.beside(offset), self.camera_medium)
    }

    /// How the ray at `offset` moves with each pixel, across itself where it passes the lamp; and the frame in which that is.
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

    /// Whether the ray behind the chain really meets the lamp.
    fn meets(&self, lamp: &Lamp, mut end: ChainEnd) -> bool {
        match next_event(self.scene, &end.ray, &mut end.medium) {
            Event::Surface(arrival) => self.scene.surface(&arrival.hit).light == Some(lamp.id),
            Event::Medium(_) => false,
            Event::Escape => lamp.is_sun,
        }
    }
}
