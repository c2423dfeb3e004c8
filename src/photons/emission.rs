//! How photons leave the lights.
//!
//! A photon's power is the light's emission over the density with which its start was drawn, so flux is exact
//! wherever photons are aimed: what is not aimed at is not emitted, and nothing else changes.

use super::clusters::clustered;
use super::heading_map::HeadingMap;
use super::projection_map::{DiscMap, ProjectionMap};
use crate::lights::Light;
use crate::math::{Frame, Ray, Rgb};
use crate::sampling::warp;
use crate::scene::{MapKind, Scene, Target};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// More objects than this are put together with their neighbours before lights aim at them.
const MOST_TARGETS: usize = 256;

/// Where photons of a light are sent.
#[derive(Clone, Debug)]
enum Aim {
    /// Wherever the light shines; distant lights at the sphere around the scene.
    Everywhere,
    /// More of them towards objects than elsewhere.
    Objects(HeadingMap),
    /// Only towards specular surfaces, from a light with a place.
    Casters(ProjectionMap),
    /// Only towards specular surfaces, from outside.
    Discs(DiscMap),
}

/// A photon that has just left its light.
#[derive(Clone, Copy, Debug)]
pub struct EmittedPhoton {
    /// Its ray, unit direction.
    pub ray: Ray,
    /// Its power if one photon were to carry all of the light's flux (towards the aim): the mean of many photons is
    /// that flux. Positive.
    pub power: Rgb,
    /// It left on the side of the light away from its normal.
    pub back: bool,
}

/// A light, and what its photons are aimed at.
#[derive(Clone, Debug)]
pub struct Emitter<'a> {
    light: &'a Light,
    aim: Aim,
    /// Of the sphere around the scene.
    bounds: (Vec3, f32),
    importance: f64,
}

impl<'a> Emitter<'a> {
    /// Light number `index` of `scene`, for the photons of one map. `None` where none of its photons can be of use: the
    /// light is dark, or no caster is anywhere in front of it.
    pub fn new(scene: &'a Scene, index: usize, kind: MapKind) -> Option<Self> {
        let (light, bounds) = (&scene.lights()[index], scene.bounds());
        let flux = light.flux(bounds.1).max_element();
        if !(flux > 0.0) {
            return None;
        }
        let (aim, flux) = match kind {
            MapKind::Caustic => {
                let casters = clustered(scene.casters(), MOST_TARGETS);
                aim_at_casters(light, bounds, &casters)?
            }
            _ => {
                // A flat light does not see itself.
                let others = scene
                    .targets()
                    .iter()
                    .filter(|target| scene.surfaces()[target.surface as usize].light != Some(index as u32));
                let targets = clustered(&others.copied().collect::<Vec<_>>(), MOST_TARGETS);
                let map = match light {
                    Light::Area(area) => HeadingMap::of_area(area, &targets),
                    Light::Point(point) => {
                        HeadingMap::of_point(point.position, warp::square_to_sphere, &targets)
                    }
                    Light::Spot(spot) if spot.has_even_squares() => {
                        let to_direction = |u| spot.sample(u).map_or(Vec3::Z, |(direction, _)| direction);
                        HeadingMap::of_point(spot.position, to_direction, &targets)
                    }
                    Light::Directional(sun) => {
                        HeadingMap::of_parallel((sun.direction, 0.0), bounds, &targets)
                    }
                    Light::Sun(sun) if sun.angular_radius() < 0.1 => {
                        HeadingMap::of_parallel((-sun.towards(), sun.angular_radius()), bounds, &targets)
                    }
                    // Directions in proportion to luminance, places on the disc around the scene.
                    Light::Spot(_) | Light::Sun(_) | Light::Environment(_) => None,
                };
                (map.map_or(Aim::Everywhere, Aim::Objects), flux)
            }
        };
        let importance = flux * f64::from(scene.light_note(index).photons);
        (importance > 0.0).then_some(Self { light, aim, bounds, importance })
    }

    /// Light number `index` of `scene` as it shines, aimed at nothing.
    pub fn unaimed(scene: &'a Scene, index: usize) -> Self {
        let (light, bounds) = (&scene.lights()[index], scene.bounds());
        let importance = light.flux(bounds.1).max_element() * f64::from(scene.light_note(index).photons);
        Self { light, aim: Aim::Everywhere, bounds, importance }
    }

    /// How many photons the light is to get, relative to others: its flux towards what it is aimed at, times what the
    /// scene file asks for.
    pub fn importance(&self) -> f64 {
        self.importance
    }

    /// Emits a photon for a point `u` of the unit hypercube. `None` where this point sends nothing: it counts as emitted
    /// all the same, with no power.
    #[inline]
    pub fn emit(&self, u: [f32; 4]) -> Option<EmittedPhoton> {
        let (place, heading) = (Vec2::new(u[0], u[1]), Vec2::new(u[2], u[3]));
        match self.light {
            Light::Area(area) => {
                // The shares of the cosine in emission and density cancel where it drew the direction.
                let (start, direction, factor) = match &self.aim {
                    Aim::Casters(map) => {
                        let from = map.depart(place);
                        let start = area.sample_side(from.back, from.place);
                        let (direction, per_pdf) =
                            from.cell.aim(start.position, Some(start.normal), heading)?;
                        let cosine = start.normal.dot(direction);
                        (start, direction, cosine * per_pdf * from.factor)
                    }
                    Aim::Objects(map) => {
                        let start = area.sample_start(place);
                        let (heading, factor) = map.warp(heading);
                        (start, cosine_direction(start.normal, heading), PI * factor)
                    }
                    _ => {
                        let start = area.sample_start(place);
                        (start, cosine_direction(start.normal, heading), PI)
                    }
                };
                let power = area.radiance() * start.glow * (factor * start.area_over_pdf);
                let leaves = start.normal.dot(direction) > 0.0 && power.max_element() > 0.0;
                leaves.then(|| EmittedPhoton {
                    ray: Ray::new(start.off_surface(direction), direction),
                    power,
                    back: start.back,
                })
            }
            Light::Point(point) => {
                let (direction, per_pdf) = match &self.aim {
                    Aim::Casters(map) => map.depart(place).cell.aim(point.position, None, heading)?,
                    Aim::Objects(map) => {
                        let (heading, factor) = map.warp(heading);
                        (warp::square_to_sphere(heading), 4.0 * PI * factor)
                    }
                    _ => (warp::square_to_sphere(heading), 4.0 * PI),
                };
                let ray = Ray::new(point.position, direction);
                Some(EmittedPhoton { ray, power: point.intensity * per_pdf, back: false })
            }
            Light::Spot(spot) => {
                let (direction, power) = match &self.aim {
                    Aim::Casters(map) => {
                        let (direction, per_pdf) =
                            map.depart(place).cell.aim(spot.position, None, heading)?;
                        (direction, spot.intensity * (spot.factor(direction) * per_pdf))
                    }
                    Aim::Objects(map) => {
                        let (heading, factor) = map.warp(heading);
                        let (direction, power) = spot.sample(heading)?;
                        (direction, power * factor)
                    }
                    _ => spot.sample(heading)?,
                };
                let ray = Ray::new(spot.position, direction);
                (power.max_element() > 0.0).then_some(EmittedPhoton { ray, power, back: false })
            }
            Light::Directional(sun) => {
                let (ray, area) = self.enter(Frame::from_z(sun.direction), place)?;
                Some(EmittedPhoton { ray, power: sun.irradiance * area, back: false })
            }
            Light::Sun(sun) => {
                // The axes of the disc turn with the direction, so that a map of the disc holds for all of them.
                let (direction, across) = (-sun.sample(heading), Frame::from_z(-sun.towards()).x);
                let (ray, area) = self.enter(Frame::with_tangent(direction, across), place)?;
                let power = sun.radiance * (sun.solid_angle() * area);
                Some(EmittedPhoton { ray, power, back: false })
            }
            Light::Environment(environment) if environment.is_constant() => {
                let direction = warp::square_to_sphere(heading);
                let (ray, area) = self.enter(Frame::from_z(direction), place)?;
                let power = environment.radiance * (4.0 * PI * area);
                Some(EmittedPhoton { ray, power, back: false })
            }
            Light::Environment(environment) => {
                let (towards, over_pdf, _) = environment.sample(heading)?;
                let (ray, area) = self.enter(Frame::from_z(-towards), place)?;
                let power = over_pdf * area;
                (power.max_element() > 0.0).then_some(EmittedPhoton { ray, power, back: false })
            }
        }
    }

    /// A ray of light along the z of `frame` from outside the scene, and the area that it stands for.
    fn enter(&self, frame: Frame, u: Vec2) -> Option<(Ray, f32)> {
        let (center, radius) = self.bounds;
        let direction = frame.z;
        let (point, area) = match &self.aim {
            Aim::Discs(map) => map.sample(direction, u)?,
            aim => {
                let (u, factor) = match aim {
                    Aim::Objects(map) => map.warp(u),
                    _ => (u, 1.0),
                };
                let d = warp::square_to_disc(u) * radius;
                (center + frame.x * d.x + frame.y * d.y, PI * radius * radius * factor)
            }
        };
        // Back to a plane that touches the sphere around the scene, with room for rounding.
        let depth = (point - center).dot(direction) + 1.01 * radius;
        Some((Ray::new(point - direction * depth, direction), area))
    }
}

/// What the light is aimed at for the caustic map, and the largest channel of its flux there, casters behind each other
/// counted twice.
fn aim_at_casters(light: &Light, (_, radius): (Vec3, f32), casters: &[Target]) -> Option<(Aim, f64)> {
    Some(match light {
        Light::Area(area) => {
            let map = ProjectionMap::of_area(area, radius, casters)?;
            let flux = map.flux() * f64::from(area.radiance().max_element());
            (Aim::Casters(map), flux)
        }
        Light::Point(point) => {
            let map = ProjectionMap::of_point(point, casters)?;
            let flux = map.flux() * f64::from(point.intensity.max_element());
            (Aim::Casters(map), flux)
        }
        Light::Directional(sun) => {
            let map = DiscMap::new(casters)?;
            let flux = map.area() * f64::from(sun.irradiance.max_element());
            (Aim::Discs(map), flux)
        }
        Light::Spot(spot) => {
            let map = ProjectionMap::of_spot(spot, casters)?;
            let flux = map.flux() * f64::from(spot.intensity.max_element());
            (Aim::Casters(map), flux)
        }
        Light::Sun(sun) => {
            let map = DiscMap::new(casters)?;
            let flux = map.area() * f64::from(sun.solid_angle() * sun.radiance.max_element());
            (Aim::Discs(map), flux)
        }
        Light::Environment(environment) => {
            let map = DiscMap::new(casters)?;
            let flux = map.area() * environment.integral().max_element();
            (Aim::Discs(map), flux)
        }
    })
}

/// A direction around `normal` with density `cos / pi`.
#[inline]
fn cosine_direction(normal: Vec3, u: Vec2) -> Vec3 {
    Frame::from_z(normal).to_world(warp::square_to_cosine_hemisphere(u))
}
