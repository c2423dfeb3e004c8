//! Models that are rooms: detection, a camera inside, and an added light.

use super::description::{
    CameraDescription, EmissionDescription, Emitted, FovAxis, GeometryDescription, LightDescription,
    Location, MaterialDescription, Named, ProjectionDescription, SceneDescription, ShapeDescription,
};
use super::enclosure::{Surroundings, Triangles};
use crate::math::{Bounds3, Rgb};
use glam::{DAffine3, DVec3};
use std::f64::consts::PI;

/// Light that a white surface facing an added light receives, as a share of white.
pub(super) const LAMP: f64 = 0.6;
/// Share of the model's footprint that a flat floor must cover to count as the ground.
const FLOOR_SHARE: f64 = 0.5;
/// Largest height of a floor above the lowest point, relative to the model's size.
const FLOOR_HEIGHT: f64 = 0.03;
/// Position and target of the camera in the bounds of a room: from near one corner towards the other.
const EYE: DVec3 = DVec3::new(0.8, 0.4, 0.85);
const AT: DVec3 = DVec3::new(0.35, 0.33, 0.2);
/// Position of a lamp in the bounds of a room: its corner, and its extent along x and z.
const CEILING: DVec3 = DVec3::new(0.35, 0.97, 0.35);
const CEILING_SHARE: f64 = 0.3;
/// Height of a light above the eye, as a fraction of the distance to what is above.
const ABOVE: f64 = 0.8;
/// Widest aspect ratio in which an added light must not be visible, whatever size is asked for.
const WIDEST: f64 = 2.4;

/// Whether a property is guessed or set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Choice {
    /// Guessed from the file.
    #[default]
    Auto,
    /// Always.
    Yes,
    /// Never.
    No,
}

impl Choice {
    /// The choice where the file suggests `found`.
    pub(super) fn over(self, found: bool) -> bool {
        match self {
            Self::Auto => found,
            Self::Yes => true,
            Self::No => false,
        }
    }
}

/// Measurements over all triangles of a model, y up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Model {
    pub bounds: Bounds3,
    /// Area of the triangles near the lowest point that face up.
    floor: f64,
}

impl Model {
    pub(super) fn of(triangles: &Triangles<'_>) -> Self {
        let bounds = triangles.bounds();
        let highest = bounds.min.y + FLOOR_HEIGHT * 2.0 * bounds.radius();
        let floor = triangles.sum(
            || 0.0,
            |floor, [a, b, c]| {
                let twice = (b - a).cross(c - a);
                if a.y.max(b.y).max(c.y) <= highest && twice.y > 0.9 * twice.length() {
                    *floor += 0.5 * twice.y;
                }
            },
            |floor, other| *floor += other,
        );
        Self { bounds, floor }
    }

    /// Whether the model has a finite extent to place things by.
    pub(super) fn has_extent(&self) -> bool {
        !self.bounds.is_empty() && self.bounds.radius().is_finite() && self.bounds.radius() > 0.0
    }

    /// Whether a flat floor at the lowest point covers half of the footprint.
    pub(super) fn has_floor(&self) -> bool {
        let size = self.bounds.max - self.bounds.min;
        self.floor > 0.0 && self.floor >= FLOOR_SHARE * size.x * size.z
    }
}

/// A light that is added to a room.
#[derive(Clone, Copy, Debug, PartialEq)]
enum RoomLight {
    /// A lamp under the ceiling.
    Ceiling,
    /// A point light, which no camera sees: its position, and the distance to the surrounding surfaces.
    Point { position: DVec3, distance: f64 },
}

/// A room with a camera inside.
#[derive(Clone, Debug)]
pub(super) struct Room {
    /// Camera of the room, unless the file has one.
    pub camera: CameraDescription,
    light: RoomLight,
}

impl Room {
    /// The room around the camera of a file, where surfaces enclose its eye. `None` where they do not, unless `is_wished`.
    pub(super) fn around(
        camera: &CameraDescription,
        aspect: f64,
        model: &Model,
        is_wished: bool,
        triangles: &Triangles<'_>,
    ) -> Option<Self> {
        let seen = Surroundings::of(camera.eye, triangles);
        (is_wished || seen.is_enclosed()).then(|| {
            let lamp = ceiling(&model.bounds);
            let hides = may_see(camera, aspect, &corners_of(lamp));
            let light = light_for(camera.eye, &seen, model, !hides, triangles);
            Self { camera: camera.clone(), light }
        })
    }

    /// The room that the whole model is: it has a floor, and surfaces without thickness face inwards on all sides of a place from
    /// which much of the model is visible. `None` where it is not a room, unless `is_wished`.
    pub(super) fn of(
        model: &Model,
        location: &Location,
        is_wished: bool,
        triangles: &Triangles<'_>,
    ) -> Option<Self> {
        if !model.has_floor() && !is_wished {
            return None;
        }
        let mirrored = |at: DVec3, x: bool, z: bool| {
            DVec3::new(if x { 1.0 - at.x } else { at.x }, at.y, if z { 1.0 - at.z } else { at.z })
        };
        let corners = [(false, false), (true, false), (false, true), (true, true)];
        let places = corners.map(|(x, z)| (mirrored(EYE, x, z), mirrored(AT, x, z)));
        let middle = (DVec3::new(0.5, EYE.y, 0.5), AT);
        let in_middle = within(&model.bounds, middle.0, AT, location).eye;
        if !is_wished && !Surroundings::of(in_middle, triangles).is_walled() {
            return None;
        }
        let mut first = None;
        for (eye, at) in places.into_iter().chain([middle]) {
            let camera = within(&model.bounds, eye, at, location);
            let seen = Surroundings::of(camera.eye, triangles);
            if seen.is_enclosed() && seen.is_inside_out(triangles) {
                let light = light_for(camera.eye, &seen, model, true, triangles);
                return Some(Self { camera, light });
            }
            first.get_or_insert((camera, seen));
        }
        let (camera, seen) = first.filter(|_| is_wished)?;
        let light = light_for(camera.eye, &seen, model, true, triangles);
        Some(Self { camera, light })
    }

    /// Adds the light, in units of the radiance `white`. Its effect depends on the walls, so the exposure is chosen from the
    /// picture.
    pub(super) fn add_light(
        &self,
        description: &mut SceneDescription,
        bounds: &Bounds3,
        white: f64,
        location: &Location,
    ) {
        description.film.exposure = None;
        match self.light {
            RoomLight::Ceiling => {
                let (corner, edge_u, edge_v) = ceiling(bounds);
                let area = edge_u.length() * edge_v.length();
                let height = bounds.max.y - bounds.min.y;
                let radiance = LAMP * PI * height * height / area * white;
                add_lamp(description, "ceiling lamp", (corner, edge_u, edge_v), radiance, location);
            }
            RoomLight::Point { position, distance } => {
                let intensity = DVec3::splat(LAMP * PI * distance * distance * white);
                let value = LightDescription::Point { position, intensity };
                description.lights.push(Named {
                    name: "room light".to_owned(),
                    location: location.clone(),
                    value,
                });
                description.light_photons.push(1.0);
            }
        }
    }
}

/// A lamp under the ceiling where that is inside the room and may be visible; otherwise a light above the eye.
fn light_for(
    eye: DVec3,
    seen: &Surroundings,
    model: &Model,
    may_show: bool,
    triangles: &Triangles<'_>,
) -> RoomLight {
    let (corner, edge_u, edge_v) = ceiling(&model.bounds);
    let middle = corner + 0.5 * (edge_u + edge_v);
    let corners = corners_of(ceiling(&model.bounds));
    let is_seen = || corners.iter().chain([&middle]).all(|place| triangles.leave_free(eye, *place));
    if may_show && is_seen() && Surroundings::of(middle, triangles).is_enclosed() {
        return RoomLight::Ceiling;
    }
    let distance = seen.distance().unwrap_or_else(|| model.bounds.radius());
    let height = ABOVE * seen.above().unwrap_or(distance);
    RoomLight::Point { position: eye + DVec3::Y * height, distance }
}

/// Corner and edges of a lamp under the ceiling; the cross product of x and z points down.
fn ceiling(bounds: &Bounds3) -> (DVec3, DVec3, DVec3) {
    let size = bounds.max - bounds.min;
    let corner = bounds.min + size * CEILING;
    (corner, DVec3::X * (CEILING_SHARE * size.x), DVec3::Z * (CEILING_SHARE * size.z))
}

pub(super) fn corners_of((corner, edge_u, edge_v): (DVec3, DVec3, DVec3)) -> [DVec3; 4] {
    [corner, corner + edge_u, corner + edge_v, corner + edge_u + edge_v]
}

/// Whether a flat object with these corners may be visible to a camera, even where the picture is as wide as `WIDEST`.
pub(super) fn may_see(camera: &CameraDescription, aspect: f64, corners: &[DVec3]) -> bool {
    let forward = (camera.at - camera.eye).normalize_or_zero();
    let right = forward.cross(camera.up).normalize_or_zero();
    let up = right.cross(forward);
    let half = |extent: f64, axis: FovAxis| match axis {
        FovAxis::Vertical => extent,
        FovAxis::Horizontal => extent / aspect,
        FovAxis::Sensor { aspect: sensor } => extent / aspect.min(sensor),
    };
    let half = match camera.projection {
        ProjectionDescription::Perspective { fov, axis } => half((0.5 * fov).to_radians().tan(), axis),
        ProjectionDescription::Orthographic { extent, axis } => {
            let half = half(0.5 * extent, axis);
            let is_outside =
                |side: DVec3, most: f64| corners.iter().all(|corner| (*corner - camera.eye).dot(side) > most);
            let across = half * aspect.max(WIDEST);
            let sides = [(right, across), (-right, across), (up, half), (-up, half), (-forward, 0.0)];
            return !sides.into_iter().any(|(side, most)| is_outside(side, most));
        }
        ProjectionDescription::Panorama | ProjectionDescription::Fisheye { .. } => return true,
    };
    let across = half * aspect.max(WIDEST);
    let planes = [
        forward,
        forward * across + right,
        forward * across - right,
        forward * half + up,
        forward * half - up,
    ];
    let is_behind = |plane: &DVec3| corners.iter().all(|corner| (*corner - camera.eye).dot(*plane) < 0.0);
    !planes.iter().any(is_behind)
}

/// A camera at a relative position in the bounds of a room.
fn within(bounds: &Bounds3, eye: DVec3, at: DVec3, location: &Location) -> CameraDescription {
    let size = bounds.max - bounds.min;
    CameraDescription {
        lens: None,
        mirrored: false,
        location: location.clone(),
        eye: bounds.min + size * eye,
        at: bounds.min + size * at,
        up: DVec3::Y,
        projection: ProjectionDescription::Perspective { fov: 65.0, axis: FovAxis::Vertical },
    }
}

/// Adds a one-sided lamp in the shape of a quad.
pub(super) fn add_lamp(
    description: &mut SceneDescription,
    name: &str,
    (corner, edge_u, edge_v): (DVec3, DVec3, DVec3),
    radiance: f64,
    location: &Location,
) {
    let emission = EmissionDescription {
        emitted: Emitted::Radiance(DVec3::splat(radiance)),
        two_sided: false,
        photons: 1.0,
    };
    let black = add_material(description, "lamp", 0.0, location);
    let quad = GeometryDescription::Quad { corner, edge_u, edge_v };
    add_shape(description, name, quad, (black, Some(emission)), location);
}

pub(super) fn add_material(
    description: &mut SceneDescription,
    name: &str,
    reflectance: f32,
    location: &Location,
) -> usize {
    description.materials.push(Named {
        name: name.to_owned(),
        location: location.clone(),
        value: MaterialDescription::Lambert { reflectance: Rgb::splat(reflectance), two_sided: true },
    });
    description.materials.len() - 1
}

pub(super) fn add_shape(
    description: &mut SceneDescription,
    name: &str,
    geometry: GeometryDescription,
    (material, emission): (usize, Option<EmissionDescription>),
    location: &Location,
) {
    description.shapes.push(Named {
        name: name.to_owned(),
        location: location.clone(),
        value: ShapeDescription {
            illumination: None,
            geometry,
            transform: DAffine3::IDENTITY,
            flip_normal: false,
            material,
            caustic_photons: 1.0,
            emission,
            displacement: None,
            group: None,
        },
    });
}
