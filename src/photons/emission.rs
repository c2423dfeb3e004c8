//! Emission of photons from the lights.
//!
//! The power of a photon is the light's emission over the density with which its start was sampled. Flux is therefore
//! exact in all directions at which photons are aimed; no photons go in other directions.

use super::box_map::{BoxMap, area_of_boxes};
use super::clusters::clustered;
use super::global_projection::GlobalProjection;
use super::projection_map::{DiscMap, ProjectionMap, one_minus_cos};
use crate::lights::Light;
use crate::math::{Frame, Ray, Rgb};
use crate::sampling::warp;
use crate::scene::{MapKind, Scene, Target};
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::f32::consts::{PI, TAU};

/// Largest number of objects a light aims at; if there are more, neighbours are combined.
const MOST_TARGETS: usize = 256;

/// Up to this number of lights, each has a table for the global map, however few photons it emits.
pub(crate) const FEW_LIGHTS: u64 = MOST_TARGETS as u64;

/// Largest number of pairs of lights and caustic casters. With more lights, casters are combined further, down to
/// [`FEW_TARGETS`], so that the tables of all lights grow no faster than lights and objects.
const MOST_PAIRS: usize = 1 << 18;

/// Least number of casters for each light, however many lights there are: for so few it needs no table of directions.
pub(crate) const FEW_TARGETS: usize = 8;

/// Photons that take about as long as the table of a light. A light has a table for the global map if it is to emit
/// more, or if there are few lights.
const PHOTONS_PER_TABLE: f64 = LEAST_FOR_A_TABLE as f64;

/// The same as a whole number.
pub(crate) const LEAST_FOR_A_TABLE: u64 = 256;

/// If the photons of a light meet an object less often than this, although its table directs them towards objects, the
/// light is aimed at the objects one by one: they are smaller than the table resolves.
const SPARSE: f64 = 1.0 / 32.0;

/// Aim of the photons of a light.
#[derive(Clone, Debug)]
enum Aim {
    /// Wherever the light shines; photons of distant lights go to the sphere around the scene.
    Everywhere,
    /// More photons towards objects than elsewhere.
    Objects(GlobalProjection),
    /// Only towards caustic casters, from a light with a position.
    Casters(ProjectionMap),
    /// Only towards caustic casters, from outside the scene.
    Discs(DiscMap),
    /// Only towards boxes around objects, from outside the scene.
    Boxes(BoxMap),
}

/// The targets of all lights of a scene, for one map.
#[derive(Debug)]
pub(super) struct Goals<'a> {
    scene: &'a Scene,
    kind: MapKind,
    /// Caustic casters for the caustic map. For the global map all objects, where there are too many lights for each to
    /// exclude itself.
    shared: Option<Vec<Target>>,
}

impl<'a> Goals<'a> {
    pub(super) fn new(scene: &'a Scene, kind: MapKind) -> Self {
        let lights = scene.lights().len();
        let most = (MOST_PAIRS / lights.max(1)).clamp(FEW_TARGETS, MOST_TARGETS);
        let shared = match kind {
            MapKind::Caustic => Some(clustered(scene.casters(), most)),
            MapKind::Global if lights > MOST_TARGETS => Some(clustered(scene.targets(), MOST_TARGETS)),
            MapKind::Global => None,
        };
        Self { scene, kind, shared }
    }

    /// The `targets` alone, for all lights.
    pub(super) fn towards(scene: &'a Scene, targets: &[Target]) -> Self {
        let most = (MOST_PAIRS / scene.lights().len().max(1)).clamp(FEW_TARGETS, MOST_TARGETS);
        Self { scene, kind: MapKind::Caustic, shared: Some(clustered(targets, most)) }
    }

    /// Targets of light `index`: a limited number of spheres and boxes around all objects. A flat light does not see
    /// itself.
    fn targets_of(&self, index: usize) -> Cow<'_, [Target]> {
        if let Some(shared) = &self.shared {
            return Cow::Borrowed(shared);
        }
        let scene = self.scene;
        let is_other =
            |target: &&Target| scene.surfaces()[target.surface as usize].light != Some(index as u32);
        let others: Vec<Target> = scene.targets().iter().filter(is_other).copied().collect();
        Cow::Owned(clustered(&others, MOST_TARGETS))
    }

    /// Whether a light that emits about this number of photons is worth a table.
    fn is_worth_a_table(&self, photons: f64) -> bool {
        self.scene.lights().len() <= MOST_TARGETS || photons > PHOTONS_PER_TABLE
    }
}

/// A photon that has just left its light.
#[derive(Clone, Copy, Debug)]
pub struct EmittedPhoton {
    /// Its ray, unit direction.
    pub ray: Ray,
    /// Its power if one photon carried all of the light's flux (towards the aim): the mean over many photons is that
    /// flux. Positive.
    pub power: Rgb,
    /// Whether it left on the side of the light opposite to its normal.
    pub back: bool,
}

/// A light and the aim of its photons.
#[derive(Clone, Debug)]
pub struct Emitter<'a> {
    light: &'a Light,
    aim: Aim,
    /// Centre and radius of the sphere around the scene.
    bounds: (Vec3, f32),
    importance: f64,
}

impl<'a> Emitter<'a> {
    /// Light number `index` for one map, of which it emits about `photons` photons. `None` where none of its photons
    /// can be of use: the light is dark, or no caustic caster is in front of it.
    pub(super) fn new(goals: &Goals<'a>, index: usize, photons: f64) -> Option<Self> {
        let scene = goals.scene;
        let (light, bounds) = (&scene.lights()[index], scene.bounds());
        let flux = light.flux(bounds.1).max_element();
        if !(flux > 0.0) {
            return None;
        }
        let (aim, flux) = match (goals.kind, &goals.shared) {
            (MapKind::Caustic, Some(casters)) => aim_at_casters(light, bounds, casters)?,
            (MapKind::Caustic, None) => return None,
            (MapKind::Global, _) if goals.is_worth_a_table(photons) => {
                aim_at_objects(light, bounds, &goals.targets_of(index))
            }
            (MapKind::Global, _) => (Aim::Everywhere, flux),
        };
        let importance = flux * f64::from(scene.light_note(index).photons);
        (importance > 0.0).then_some(Self { light, aim, bounds, importance })
    }

    /// Light number `index` of `scene`, not aimed at anything.
    pub fn unaimed(scene: &'a Scene, index: usize) -> Self {
        let (light, bounds) = (&scene.lights()[index], scene.bounds());
        let importance = light.flux(bounds.1).max_element() * f64::from(scene.light_note(index).photons);
        Self { light, aim: Aim::Everywhere, bounds, importance }
    }

    /// Relative number of photons of the light: its flux towards its aim, times the factor in the scene file.
    pub fn importance(&self) -> f64 {
        self.importance
    }

    /// Emits a photon for a point `u` of the unit hypercube. `None` where this point emits nothing; it still counts as
    /// an emitted photon, without power.
    #[inline]
    pub fn emit(&self, u: [f32; 4]) -> Option<EmittedPhoton> {
        let (place, heading) = (Vec2::new(u[0], u[1]), Vec2::new(u[2], u[3]));
        match self.light {
            Light::Area(area) => {
                // The cosines in emission and density cancel where the direction was sampled by the cosine.
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
                    Aim::Everywhere | Aim::Discs(_) | Aim::Boxes(_) => {
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
                    Aim::Everywhere | Aim::Discs(_) | Aim::Boxes(_) => {
                        (warp::square_to_sphere(heading), 4.0 * PI)
                    }
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
                    Aim::Everywhere | Aim::Discs(_) | Aim::Boxes(_) => spot.sample(heading)?,
                };
                let ray = Ray::new(spot.position, direction);
                (power.max_element() > 0.0).then_some(EmittedPhoton { ray, power, back: false })
            }
            Light::Directional(sun) => {
                let (ray, area) = self.enter(Frame::from_z(sun.direction), place)?;
                Some(EmittedPhoton { ray, power: sun.irradiance * area, back: false })
            }
            Light::Sun(sun) => {
                // The axes of the disc turn with the direction, so that one map of the disc is valid for all
                // directions.
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

    /// A ray along the z axis of `frame` that starts outside the scene, and the area that it represents.
    fn enter(&self, frame: Frame, u: Vec2) -> Option<(Ray, f32)> {
        let (center, radius) = self.bounds;
        let direction = frame.z;
        let (point, area) = match &self.aim {
            Aim::Discs(map) => map.sample(direction, u)?,
            Aim::Boxes(map) => map.sample(direction, u)?,
            aim @ (Aim::Everywhere | Aim::Objects(_) | Aim::Casters(_)) => {
                let (u, factor) = if let Aim::Objects(map) = aim { map.warp(u) } else { (u, 1.0) };
                let d = warp::square_to_disc(u) * radius;
                (center + frame.x * d.x + frame.y * d.y, PI * radius * radius * factor)
            }
        };
        // Moved back to a plane that touches the sphere around the scene, with a margin for rounding.
        let depth = (point - center).dot(direction) + 1.01 * radius;
        Some((Ray::new(point - direction * depth, direction), area))
    }
}

/// Aim of the light for the global map, and the largest channel of its flux: its whole flux, or, where objects are so
/// small and far that it aims at them one by one, its flux towards them.
fn aim_at_objects(light: &Light, bounds: (Vec3, f32), targets: &[Target]) -> (Aim, f64) {
    let (radius, flux) = (bounds.1, light.flux(bounds.1).max_element());
    let map = match light {
        Light::Area(area) => GlobalProjection::of_area(area, targets),
        Light::Point(point) => GlobalProjection::of_point(point.position, warp::square_to_sphere, targets),
        Light::Spot(spot) if spot.has_even_squares() => {
            let to_direction = |u| spot.sample(u).map_or(Vec3::Z, |(direction, _)| direction);
            GlobalProjection::of_point(spot.position, to_direction, targets)
        }
        Light::Directional(sun) => GlobalProjection::of_parallel((sun.direction, 0.0), bounds, targets),
        Light::Sun(sun) if sun.angular_radius() < 0.1 => {
            GlobalProjection::of_parallel((-sun.towards(), sun.angular_radius()), bounds, targets)
        }
        // Directions are sampled in proportion to luminance, and places on the disc around the scene.
        Light::Spot(_) | Light::Sun(_) | Light::Environment(_) => None,
    };
    let gain = map.as_ref().map_or(1.0, GlobalProjection::gain);
    if share_that_meets(light, radius, targets) * gain < SPARSE
        && let Some(sparse) = aim_one_by_one(light, radius, targets)
    {
        return sparse;
    }
    (map.map_or(Aim::Everywhere, Aim::Objects), flux)
}

/// An upper bound on the share of the light's flux that meets one of the targets, without occlusion.
fn share_that_meets(light: &Light, scene_radius: f32, targets: &[Target]) -> f64 {
    // Sum of the solid angles of the targets, each grown by the extent of the light; all directions from inside a
    // target.
    let solid_angle = |from: Vec3, extent: f32| -> f64 {
        let size = |target: &Target| one_minus_cos(from, target.center, target.radius + extent);
        targets.iter().map(|target| f64::from(TAU * size(target).unwrap_or(2.0))).sum()
    };
    let disc = f64::from(PI) * f64::from(scene_radius).powi(2);
    match light {
        Light::Area(area) => area
            .bounding_sphere()
            .map_or(1.0, |(center, extent)| solid_angle(center.as_vec3(), extent as f32) / f64::from(PI)),
        Light::Point(point) => solid_angle(point.position, 0.0) / f64::from(4.0 * PI),
        Light::Spot(spot) => {
            let peak = f64::from(spot.peak().max_element());
            solid_angle(spot.position, 0.0) * peak / spot.flux().max_element()
        }
        Light::Directional(sun) => area_of_boxes(targets, Some(sun.direction)) / disc,
        Light::Sun(_) | Light::Environment(_) => area_of_boxes(targets, None) / disc,
    }
}

/// Aims the light at each of the targets and nowhere else.
fn aim_one_by_one(light: &Light, radius: f32, targets: &[Target]) -> Option<(Aim, f64)> {
    let alike: Vec<Target> = targets.iter().map(|target| Target { density: 1.0, ..*target }).collect();
    let boxes = |direction, irradiance: f64| {
        let map = BoxMap::new(targets, direction)?;
        let flux = map.area() * irradiance;
        Some((Aim::Boxes(map), flux))
    };
    match light {
        Light::Area(_) | Light::Point(_) | Light::Spot(_) => {
            aim_at_casters(light, (Vec3::ZERO, radius), &alike)
        }
        Light::Directional(sun) => boxes(Some(sun.direction), sun.irradiance.max_element().into()),
        Light::Sun(sun) => boxes(None, f64::from(sun.solid_angle() * sun.radiance.max_element())),
        Light::Environment(environment) => boxes(None, environment.integral().max_element()),
    }
}

/// Aim of the light for the caustic map, and the largest channel of its flux there; caustic casters behind each other
/// count twice.
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
