//! Adds what a file lacks to be a picture: a camera, ground, light and exposure, each only where the file has none. Each guess is
//! based on the content of the file, is reported in one line, and can be switched off.

use super::materials::LUMENS_PER_WATT;
use crate::math::Bounds3;
use crate::scene_file::description::{
    CameraDescription, FovAxis, GeometryDescription, LightDescription, Location, MaterialDescription, Named,
    ProjectionDescription, SceneDescription, SceneWarning, ShapeDescription,
};
use crate::scene_file::enclosure::{Surroundings, Triangles};
use crate::scene_file::room::{
    Choice, LAMP, Model, Room, add_lamp, add_material, add_shape, corners_of, may_see,
};
use glam::{DAffine3, DVec3};
use std::f64::consts::{FRAC_PI_4, PI};

/// Direction from the centre of the model to the camera.
const VIEW: DVec3 = DVec3::new(0.35, 0.25, 1.0);
/// The same direction for a model that is open above and has walls on all sides.
const VIEW_INTO: DVec3 = DVec3::new(0.35, 1.1, 1.0);
/// Vertical field of view, degrees.
const FOV: f64 = 30.0;
/// Margin around the model in the picture, as a factor.
const MARGIN: f64 = 1.12;
/// Radiance of the studio's surroundings, nits.
const AROUND: f64 = 0.4;
/// Direction from the centre of the model to the studio's lamp.
const LAMP_FROM: DVec3 = DVec3::new(-0.7, 1.0, 0.8);
/// Reflectance of the ground.
const GROUND: f32 = 0.35;

/// The user's choices of what to add.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Wishes {
    pub ground: Choice,
    pub light: Choice,
    pub room: Choice,
}

/// All triangles of the scene.
fn triangles_of(description: &SceneDescription) -> Triangles<'_> {
    Triangles::new(description.shapes.iter().flat_map(|shape| {
        let mesh = match &shape.value.geometry {
            GeometryDescription::Gltf { mesh, .. } => Some(&**mesh),
            _ => None,
        };
        let placed = |mesh| placements(description, &shape.value).map(move |transform| (mesh, transform));
        mesh.into_iter().flat_map(placed)
    }))
}

/// Transforms of all placements of a shape, from its own space to the world.
fn placements<'a>(
    description: &'a SceneDescription,
    shape: &'a ShapeDescription,
) -> impl Iterator<Item = DAffine3> + 'a {
    let alone = shape.group.is_none().then_some(DAffine3::IDENTITY);
    let instances = description.instances.iter().filter(|instance| shape.group == Some(instance.value.group));
    let above = alone.into_iter().chain(instances.map(|instance| instance.value.transform));
    above.map(|above| above * shape.transform)
}

/// Flux of all emitting surfaces, W, largest channel.
fn emitted_flux(description: &SceneDescription) -> f64 {
    let mut flux = 0.0;
    for shape in &description.shapes {
        let (Some(emission), GeometryDescription::Gltf { mesh, .. }) =
            (shape.value.emission, &shape.value.geometry)
        else {
            continue;
        };
        let picture = match &description.materials[shape.value.material].value {
            MaterialDescription::Layered { material, .. } if material.unlit => material.base.as_ref(),
            MaterialDescription::Layered { material, .. } => material.emission.as_ref(),
            _ => None,
        };
        let mean = picture.map_or(DVec3::ONE, |slot| slot.texture.mean().truncate().as_dvec3());
        let sides = if emission.two_sided { 2.0 } else { 1.0 };
        for transform in placements(description, &shape.value) {
            let area: f64 = mesh.triangles.iter().fold(0.0, |area, &triangle| {
                let [a, b, c] =
                    mesh.positions.corners(triangle).map(|corner| transform.transform_point3(corner));
                area + 0.5 * (b - a).cross(c - a).length()
            });
            flux += sides * PI * area * (emission.emitted.radiance(sides * area) * mean).max_element();
        }
    }
    flux
}

/// Source of the light in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// Lights of the file.
    Lights,
    /// Emitting surfaces of the file.
    Emitters,
    /// Unlit materials, which show their colour directly.
    Unlit,
    /// The file has no light.
    None,
}

fn source_of(description: &SceneDescription, model: &Model, is_room: bool) -> Source {
    let shines = |light: &Named<LightDescription>| match light.value {
        LightDescription::Point { intensity, .. } | LightDescription::Spot { intensity, .. } => {
            intensity.max_element() > 0.0
        }
        LightDescription::Directional { irradiance, .. } => irradiance.max_element() > 0.0,
        _ => true,
    };
    if description.lights.iter().any(shines) {
        return Source::Lights;
    }
    let is_unlit = |material: &Named<MaterialDescription>| matches!(&material.value, MaterialDescription::Layered { material, .. } if material.unlit);
    if description.materials.iter().all(is_unlit) {
        return Source::Unlit;
    }
    // Outside a room, emitters count as the light if their flux exceeds that of the studio; in a room any flux counts.
    let flux = emitted_flux(description);
    let studio = PI * (AROUND + LAMP) / LUMENS_PER_WATT * 4.0 * PI * model.bounds.radius().powi(2);
    if flux > if is_room { 0.0 } else { studio } { Source::Emitters } else { Source::None }
}

/// Whether the camera is upright in a world with z up.
fn has_z_up(camera: &CameraDescription) -> bool {
    let forward = (camera.at - camera.eye).normalize_or_zero();
    let right = forward.cross(camera.up).normalize_or_zero();
    let up = right.cross(forward);
    up.z > up.y.abs() && right.z.abs() < right.y.abs()
}

/// Adds the missing parts. A file without visible content is left unchanged.
pub(super) fn complete(description: &mut SceneDescription, wishes: Wishes) {
    let model = Model::of(&triangles_of(description));
    if !model.has_extent() {
        return;
    }
    let location = description.location.clone();
    let aspect = f64::from(description.film.width) / f64::from(description.film.height);
    let room = room_of(description, wishes.room, &model, aspect);
    let mut notes = Vec::new();
    if let Some(room) = &room {
        notes.push(match &description.camera {
            Some(_) => "the camera is enclosed by the model, so it is taken for a room; --set room=no where it is none",
            None => {
                "surfaces face inwards all around and there is a floor, so it is taken for a room and shown from within; \
                 --set room=no shows it from outside"
            }
        });
        description.camera = Some(room.camera.clone());
    }
    let has_own_camera = description.camera.is_some() && room.is_none();
    if description.camera.is_none() {
        let (view, how) = view_of(description, &model);
        notes.push(how);
        description.camera = Some(framing(&model.bounds, aspect, view, &location));
    }
    let source = source_of(description, &model, room.is_some());
    description.film.white = LUMENS_PER_WATT.log2();
    if wishes.light.over(source == Source::None) {
        notes.push(match &room {
            Some(room) => {
                room.add_light(description, &model.bounds, 1.0 / LUMENS_PER_WATT, &location);
                "there is no light in the file, so one is added in the room; --set light=no leaves it out"
            }
            None => {
                add_studio(description, &model.bounds, aspect, has_own_camera);
                "there is no light in the file, so that of a studio is added; --set light=no leaves it out"
            }
        });
    } else if source == Source::Lights {
        description.film.white += exposure(description, &model.bounds);
        if room.is_some() {
            // The light at the camera depends on walls and windows.
            description.film.exposure = None;
        }
    } else if source == Source::Emitters {
        notes.push("its surfaces that emit are all its light; --set light=yes adds that of a studio");
        description.film.exposure = None;
    }
    let is_lacking = !model.has_floor() && source != Source::Unlit;
    notes.extend(ground(description, wishes.ground, is_lacking, &model.bounds));
    description.notes.extend(
        notes.into_iter().map(|note| SceneWarning { location: location.clone(), message: note.to_owned() }),
    );
}

/// The room that the picture shows, if it shows one.
fn room_of(description: &SceneDescription, wish: Choice, model: &Model, aspect: f64) -> Option<Room> {
    let is_wished = match wish {
        Choice::No => return None,
        Choice::Yes => true,
        Choice::Auto => false,
    };
    let triangles = &triangles_of(description);
    match &description.camera {
        Some(camera) => Room::around(camera, aspect, model, is_wished, triangles),
        None => Room::of(model, &description.location, is_wished, triangles),
    }
}

/// View direction for a model whose file has no camera, with a description in words.
fn view_of(description: &SceneDescription, model: &Model) -> (DVec3, &'static str) {
    let middle = Surroundings::of(model.bounds.center(), &triangles_of(description));
    if middle.is_open_above() {
        let how = "there is no camera in the file; the model is walled on all sides and open above, so it is shown from above";
        (VIEW_INTO, how)
    } else {
        (VIEW, "there is no camera in the file, so all of the model is shown from in front")
    }
}

/// Adds the ground if it is wanted, unless it would be between the camera and the model. Yields a description of what was done.
fn ground(
    description: &mut SceneDescription,
    wish: Choice,
    is_lacking: bool,
    bounds: &Bounds3,
) -> Option<&'static str> {
    if !wish.over(is_lacking) {
        return None;
    }
    let height = bounds.min.y - 1e-4 * bounds.radius();
    if wish == Choice::Auto
        && let Some(camera) = &description.camera
    {
        if has_z_up(camera) {
            return Some(
                "the camera stands upright with z up, so no ground is added; glTF has y up: export with that",
            );
        }
        if camera.eye.y <= height {
            return Some("the camera is below the model, so no ground is added; --set ground=yes adds it");
        }
    }
    let location = description.location.clone();
    let center = bounds.center().with_y(height);
    let material = add_material(description, "ground", GROUND, &location);
    let disc = GeometryDescription::Disc { center, normal: DVec3::Y, radius: 12.0 * bounds.radius() };
    add_shape(description, "ground", disc, (material, None), &location);
    Some("there is no floor under the model, so a ground is added; --set ground=no leaves it out")
}

/// Stops of exposure that make a white surface at the centre of the model nearly white.
fn exposure(description: &SceneDescription, bounds: &Bounds3) -> f64 {
    /// Beyond this the lights are so far away that no guess helps.
    const MOST: f64 = 40.0;
    let irradiance: f64 = description
        .lights
        .iter()
        .map(|light| match &light.value {
            LightDescription::Point { position, intensity } => {
                let distance = (*position - bounds.center()).length().max(0.5 * bounds.radius());
                intensity.max_element() / (distance * distance)
            }
            // Brightness within the cone.
            LightDescription::Spot { position, intensity, .. } => {
                let distance = (*position - bounds.center()).length().max(0.5 * bounds.radius());
                intensity.max_element() / (distance * distance)
            }
            LightDescription::Directional { irradiance, .. } => irradiance.max_element(),
            // glTF has none of these lights.
            LightDescription::Sun { .. }
            | LightDescription::EnvironmentMap { .. }
            | LightDescription::Sky { .. }
            | LightDescription::CieSky { .. }
            | LightDescription::Profile { .. } => 0.0,
            LightDescription::Environment { radiance } => radiance.max_element() * std::f64::consts::PI,
        })
        .sum();
    let white = irradiance * LUMENS_PER_WATT / std::f64::consts::PI;
    let stops = -(white / 0.8).log2();
    if stops.is_finite() { stops.clamp(-MOST, MOST) } else { 0.0 }
}

/// A camera that sees all of a box from the direction `view`.
fn framing(bounds: &Bounds3, aspect: f64, view: DVec3, location: &Location) -> CameraDescription {
    let towards = view.normalize_or_zero();
    let right = DVec3::Y.cross(towards).normalize_or_zero();
    let up = towards.cross(right);
    let half = (0.5 * FOV).to_radians().tan();
    let center = bounds.center();
    let corners = (0..8).map(|i| {
        let pick =
            |bit: usize, axis: usize| if i >> bit & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)) - center
    });
    // Distance of the eye at which a corner is in the picture.
    let distance = corners.map(|corner| {
        let across = (corner.dot(right).abs() / aspect).max(corner.dot(up).abs());
        corner.dot(towards) + MARGIN * across / half
    });
    let distance = distance.fold(0.0, f64::max);
    CameraDescription {
        lens: None,
        mirrored: false,
        location: location.clone(),
        eye: center + towards * distance,
        at: center,
        up: DVec3::Y,
        projection: ProjectionDescription::Perspective { fov: FOV, axis: FovAxis::Vertical },
    }
}

/// Adds light from all directions, and a large soft lamp above on the left. Where the file's camera would see the lamp, the lamp
/// moves around the model; where it would be visible everywhere, parallel light takes its place, which no camera sees.
fn add_studio(description: &mut SceneDescription, bounds: &Bounds3, aspect: f64, has_own_camera: bool) {
    let location = description.location.clone();
    let mut add_light = |name: &str, value| {
        description.lights.push(Named { name: name.to_owned(), location: location.clone(), value });
        description.light_photons.push(1.0);
    };
    let around = DVec3::splat(AROUND / LUMENS_PER_WATT);
    add_light("studio", LightDescription::Environment { radiance: around });
    let radius = bounds.radius();
    let (distance, side) = (4.0 * radius, 2.4 * radius);
    let lamp_at = |turn: f64| {
        let towards = DAffine3::from_rotation_y(turn).transform_vector3(LAMP_FROM).normalize_or_zero();
        let edge_u = DVec3::Y.cross(towards).normalize_or_zero() * side;
        // The cross product of the edges points at the model.
        let edge_v = -towards.cross(edge_u).normalize_or_zero() * side;
        (bounds.center() + towards * distance - 0.5 * (edge_u + edge_v), edge_u, edge_v)
    };
    let own_camera = description.camera.as_ref().filter(|_| has_own_camera);
    let turns = (0..8).map(|turn| f64::from(turn) * FRAC_PI_4);
    let hides =
        |turn: &f64| own_camera.is_some_and(|camera| may_see(camera, aspect, &corners_of(lamp_at(*turn))));
    let Some(turn) = turns.into_iter().find(|turn| !hides(turn)) else {
        let irradiance = DVec3::splat(LAMP * PI / LUMENS_PER_WATT);
        let value = LightDescription::Directional { direction: -LAMP_FROM, irradiance };
        add_light("studio lamp", value);
        return;
    };
    let radiance = LAMP * PI * (distance / side).powi(2) / LUMENS_PER_WATT;
    add_lamp(description, "studio lamp", lamp_at(turn), radiance, &location);
}
