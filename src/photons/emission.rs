//! How photons leave the lights.
//!
//! A photon's power is the light's emission over the density with which its start was drawn, so flux is exact
//! wherever photons are aimed: what is not aimed at is not emitted, and nothing else changes.

use crate::lights::Light;
use crate::math::{Frame, Ray, Rgb};
use crate::sampling::warp;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Where photons are sent.
#[derive(Clone, Copy, Debug)]
pub enum Aim<'a> {
    /// Wherever the light shines; distant lights at the sphere (centre, radius) around the scene.
    Scene((Vec3, f32)),
    /// Only towards these spheres around specular surfaces. Holds the sphere around the scene as well.
    Casters(&'a [(Vec3, f32)], (Vec3, f32)),
}

/// A photon that has just left its light.
#[derive(Clone, Copy, Debug)]
pub struct EmittedPhoton {
    /// Its ray, unit direction.
    pub ray: Ray,
    /// Its power if one photon were to carry all of the light's flux (towards the aim): the mean of many photons is
    /// that flux. Positive.
    pub power: Rgb,
}

/// Emits a photon of `light` for a point `u` of the unit hypercube. `None` where this point sends nothing: it counts as
/// emitted all the same, with no power.
#[inline]
pub fn emit(light: &Light, aim: Aim<'_>, u: [f32; 4]) -> Option<EmittedPhoton> {
    let (place, heading) = (Vec2::new(u[0], u[1]), Vec2::new(u[2], u[3]));
    match light {
        Light::Area(area) => {
            let start = area.sample_start(place);
            let cones = match aim {
                Aim::Casters(casters, _) => Cones::seen_from(start.position, casters),
                Aim::Scene(_) => None,
            };
            let (direction, per_pdf) = match cones {
                Some(cones) => {
                    let (direction, per_pdf) = cones.sample(heading)?;
                    (direction, Some(per_pdf))
                }
                None => (cosine_direction(start.normal, heading), None),
            };
            let cosine = start.normal.dot(direction);
            // The shares of the cosine in emission and density cancel where it drew the direction.
            let cosine_over_pdf = per_pdf.map_or(PI, |per_pdf| cosine * per_pdf);
            let power = area.radiance() * (cosine_over_pdf * start.area_over_pdf);
            (cosine > 0.0 && power.max_element() > 0.0)
                .then(|| EmittedPhoton { ray: Ray::new(start.off_surface(direction), direction), power })
        }
        Light::Point(point) => {
            let (direction, per_pdf) = match aim {
                Aim::Casters(casters, _) => match Cones::seen_from(point.position, casters) {
                    Some(cones) => cones.sample(heading)?,
                    None => (warp::square_to_sphere(heading), 4.0 * PI),
                },
                Aim::Scene(_) => (warp::square_to_sphere(heading), 4.0 * PI),
            };
            Some(EmittedPhoton { ray: Ray::new(point.position, direction), power: point.intensity * per_pdf })
        }
        Light::Directional(sun) => {
            let (origin, area) = start_on_disc(aim, sun.direction, place)?;
            Some(EmittedPhoton { ray: Ray::new(origin, sun.direction), power: sun.irradiance * area })
        }
        Light::Environment(environment) => {
            let direction = warp::square_to_sphere(heading);
            let (origin, area) = start_on_disc(aim, direction, place)?;
            Some(EmittedPhoton {
                ray: Ray::new(origin, direction),
                power: environment.radiance * (4.0 * PI * area),
            })
        }
    }
}

/// A direction around `normal` with density `cos / pi`.
fn cosine_direction(normal: Vec3, u: Vec2) -> Vec3 {
    Frame::from_z(normal).to_world(warp::square_to_cosine_hemisphere(u))
}

/// The cones that spheres fill as seen from one point.
struct Cones<'a> {
    apex: Vec3,
    spheres: &'a [(Vec3, f32)],
    /// Sum of `1 - cos` of all half angles.
    total: f32,
}

impl<'a> Cones<'a> {
    /// `None` where the point lies inside one of the spheres, which then fills all directions.
    fn seen_from(apex: Vec3, spheres: &'a [(Vec3, f32)]) -> Option<Self> {
        let mut total = 0.0;
        for sphere in spheres {
            total += one_minus_cos(apex, *sphere)?;
        }
        Some(Self { apex, spheres, total })
    }

    /// A direction drawn uniformly from each cone in proportion to its solid angle, and one over the density of that
    /// mixture: cones that overlap are not counted twice.
    fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let mut target = u.x * self.total;
        let mut chosen = None;
        for &sphere in self.spheres {
            let size = one_minus_cos(self.apex, sphere)?;
            chosen = Some((sphere, size, (target / size).clamp(0.0, crate::sampling::ONE_MINUS_EPSILON)));
            if target < size {
                break;
            }
            target -= size;
        }
        let ((center, _), size, rest) = chosen?;
        let axis = crate::math::unit(center - self.apex)?;
        let local = warp::square_to_cone(Vec2::new(rest, u.y), size);
        let direction = Frame::from_z(axis).to_world(local);
        let covering = self.spheres.iter().filter(|&&sphere| self.covers(sphere, direction)).count();
        Some((direction, TAU * self.total / covering.max(1) as f32))
    }

    fn covers(&self, sphere: (Vec3, f32), direction: Vec3) -> bool {
        let (Some(size), Some(axis)) =
            (one_minus_cos(self.apex, sphere), crate::math::unit(sphere.0 - self.apex))
        else {
            return true;
        };
        // 1 - cos(angle) as half the squared chord, which keeps its precision for narrow cones.
        0.5 * (direction - axis).length_squared() <= size
    }
}

/// `1 - cos` of the half angle of `sphere` seen from `apex`; `None` from inside.
fn one_minus_cos(apex: Vec3, (center, radius): (Vec3, f32)) -> Option<f32> {
    let distance = (center - apex).length();
    (distance > radius).then(|| warp::sphere_one_minus_cos(radius, distance))
}

/// A start for parallel light along `direction`, outside the scene, and the area that it stands for.
fn start_on_disc(aim: Aim<'_>, direction: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
    let frame = Frame::from_z(direction);
    let disc = |(center, radius): (Vec3, f32), u: Vec2| {
        let d = warp::square_to_disc(u) * radius;
        center + frame.x * d.x + frame.y * d.y
    };
    let (point, area, (scene_center, scene_radius)) = match aim {
        Aim::Scene(bounds) => (disc(bounds, u), PI * bounds.1 * bounds.1, bounds),
        Aim::Casters(casters, bounds) => {
            let total: f32 = casters.iter().map(|(_, r)| r * r).sum();
            let mut target = u.x * total;
            let mut chosen = None;
            for &caster in casters {
                let size = caster.1 * caster.1;
                let rest = (target / size).clamp(0.0, crate::sampling::ONE_MINUS_EPSILON);
                chosen = Some((caster, rest));
                if target < size {
                    break;
                }
                target -= size;
            }
            let (caster, rest) = chosen?;
            let point = disc(caster, Vec2::new(rest, u.y));
            let covering = casters.iter().filter(|&&(center, radius)| {
                let across = (point - center).reject_from_normalized(direction);
                across.length_squared() <= radius * radius
            });
            (point, PI * total / covering.count().max(1) as f32, bounds)
        }
    };
    // Back to a plane that touches the sphere around the scene, with room for rounding.
    let depth = (point - scene_center).dot(direction) + 1.01 * scene_radius;
    Some((point - direction * depth, area))
}
