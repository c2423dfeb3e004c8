//! What a file lacks to be a picture: a camera, ground, light and exposure, each only where it has none.

use super::materials::LUMENS_PER_WATT;
use crate::math::{Bounds3, Rgb};
use crate::scene_file::description::{
    CameraDescription, EmissionDescription, FovAxis, GeometryDescription, LightDescription, Location,
    MaterialDescription, Named, SceneDescription, ShapeDescription,
};
use glam::{DAffine3, DVec3};

/// From the middle of the model to the camera.
const VIEW: DVec3 = DVec3::new(0.35, 0.25, 1.0);
/// Vertical field of view, degrees.
const FOV: f64 = 30.0;
/// Room around the model in the picture.
const MARGIN: f64 = 1.12;
/// Radiance of the studio around, and what a white surface that faces the lamp gets of that, nits.
const AROUND: f64 = 0.4;
const LAMP: f64 = 0.6;
/// Reflectance of the ground.
const GROUND: f32 = 0.35;
/// Share of the model's footprint that flat floor must cover to stand for the ground.
const FLOOR_SHARE: f64 = 0.5;
/// How high above the lowest point a floor may lie, over the model's size.
const FLOOR_HEIGHT: f64 = 0.03;

/// What to add.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Wishes {
    pub ground: Choice,
    pub light: Choice,
}

/// Whether something is added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    /// Where the file has none.
    Auto,
    /// In any case.
    Yes,
    /// Not at all.
    No,
}

impl Choice {
    fn over(self, is_missing: bool) -> bool {
        match self {
            Self::Auto => is_missing,
            Self::Yes => true,
            Self::No => false,
        }
    }
}

/// Bounds of all triangles, and the area of those that face up near the lowest point.
struct Model {
    bounds: Bounds3,
    floor: f64,
    /// How often surfaces go around the middle, seen from their fronts: about 1 in a body, -1 in a room.
    winding: f64,
}

impl Model {
    /// Whether one would look at it from within.
    fn is_room(&self) -> bool {
        self.winding < -0.5
    }
}

/// The solid angle of a triangle as seen from the origin, over the sphere; positive where its back is seen (Van Oosterom &
/// Strackee 1983).
fn signed_solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    let angle = 2.0 * a.dot(b.cross(c)).atan2(denominator);
    if angle.is_finite() { angle / (4.0 * std::f64::consts::PI) } else { 0.0 }
}

/// Each triangle of the scene, in the world.
fn for_each_triangle(description: &SceneDescription, mut take: impl FnMut([DVec3; 3])) {
    for shape in &description.shapes {
        let GeometryDescription::Gltf { mesh, .. } = &shape.value.geometry else { continue };
        let alone = shape.value.group.is_none().then_some(DAffine3::IDENTITY);
        let instances =
            description.instances.iter().filter(|instance| shape.value.group == Some(instance.value.group));
        for above in alone.into_iter().chain(instances.map(|instance| instance.value.transform)) {
            let transform = above * shape.value.transform;
            for &triangle in &mesh.triangles {
                take(mesh.positions.corners(triangle).map(|corner| transform.transform_point3(corner)));
            }
        }
    }
}

fn model_of(description: &SceneDescription) -> Model {
    let mut bounds = Bounds3::EMPTY;
    for_each_triangle(description, |corners| bounds = bounds.union(Bounds3::of_points(corners)));
    let (mut floor, mut winding) = (0.0, 0.0);
    let middle = bounds.center();
    let highest = bounds.min.y + FLOOR_HEIGHT * 2.0 * bounds.radius();
    for_each_triangle(description, |[a, b, c]| {
        winding += signed_solid_angle([a - middle, b - middle, c - middle]);
        let twice = (b - a).cross(c - a);
        if a.y.max(b.y).max(c.y) <= highest && twice.y > 0.9 * twice.length() {
            floor += 0.5 * twice.y;
        }
    });
    Model { bounds, floor, winding }
}

/// Adds what is missing. A file that shows nothing is left alone.
pub(super) fn complete(description: &mut SceneDescription, wishes: Wishes) {
    let model = model_of(description);
    let Model { bounds, floor, .. } = model;
    if bounds.is_empty() || !bounds.radius().is_finite() || bounds.radius() <= 0.0 {
        return;
    }
    let shows_itself = description.materials.iter().all(
        |material| matches!(&material.value, MaterialDescription::Layered { material, .. } if material.unlit),
    );
    let is_lit = !description.lights.is_empty() || shows_itself;
    let size = bounds.max - bounds.min;
    let has_floor = floor > 0.0 && floor >= FLOOR_SHARE * size.x * size.z;
    let location = description.location.clone();
    if description.camera.is_none() {
        let aspect = f64::from(description.film.width) / f64::from(description.film.height);
        let camera =
            if model.is_room() { within(&bounds, &location) } else { framing(&bounds, aspect, &location) };
        description.camera = Some(camera);
    }
    description.film.white = LUMENS_PER_WATT.log2();
    if wishes.light.over(!is_lit) {
        let add = if model.is_room() { add_ceiling_lamp } else { add_studio };
        add(description, &bounds, &location);
    } else if !description.lights.is_empty() {
        description.film.white += exposure(description, &bounds);
    }
    if wishes.ground.over(!has_floor && !shows_itself && !model.is_room()) {
        add_ground(description, &bounds, &location);
    }
}

/// Stops by which a white surface in the middle of the model comes to be nearly white.
fn exposure(description: &SceneDescription, bounds: &Bounds3) -> f64 {
    /// Beyond this the lights are so far off that no guess helps.
    const MOST: f64 = 40.0;
    let irradiance: f64 = description
        .lights
        .iter()
        .map(|light| match &light.value {
            LightDescription::Point { position, intensity } => {
                let distance = (*position - bounds.center()).length().max(0.5 * bounds.radius());
                intensity.max_element() / (distance * distance)
            }
            // As bright as where it shines.
            LightDescription::Spot { position, intensity, .. } => {
                let distance = (*position - bounds.center()).length().max(0.5 * bounds.radius());
                intensity.max_element() / (distance * distance)
            }
            LightDescription::Directional { irradiance, .. } => irradiance.max_element(),
            // Files of glTF have none of these.
            LightDescription::EnvironmentMap { .. }
            | LightDescription::Sky { .. }
            | LightDescription::Profile { .. } => 0.0,
            LightDescription::Environment { radiance } => radiance.max_element() * std::f64::consts::PI,
        })
        .sum();
    let white = irradiance * LUMENS_PER_WATT / std::f64::consts::PI;
    let stops = -(white / 0.8).log2();
    if stops.is_finite() { stops.clamp(-MOST, MOST) } else { 0.0 }
}

/// A camera that sees all of a box from in front, a little from above and from the right.
fn framing(bounds: &Bounds3, aspect: f64, location: &Location) -> CameraDescription {
    let towards = VIEW.normalize_or_zero();
    let right = DVec3::Y.cross(towards).normalize_or_zero();
    let up = towards.cross(right);
    let half = (0.5 * FOV).to_radians().tan();
    let center = bounds.center();
    let corners = (0..8).map(|i| {
        let pick =
            |bit: usize, axis: usize| if i >> bit & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)) - center
    });
    // How far off the eye must be for a corner to be in the picture.
    let distance = corners.map(|corner| {
        let across = (corner.dot(right).abs() / aspect).max(corner.dot(up).abs());
        corner.dot(towards) + MARGIN * across / half
    });
    let distance = distance.fold(0.0, f64::max);
    CameraDescription {
        lens: None,
        location: location.clone(),
        eye: center + towards * distance,
        at: center,
        up: DVec3::Y,
        fov: FOV,
        fov_axis: FovAxis::Vertical,
    }
}

/// A camera in a room: from near one corner towards the other.
fn within(bounds: &Bounds3, location: &Location) -> CameraDescription {
    let size = bounds.max - bounds.min;
    let point = |x: f64, y: f64, z: f64| bounds.min + size * DVec3::new(x, y, z);
    CameraDescription {
        lens: None,
        location: location.clone(),
        eye: point(0.8, 0.4, 0.85),
        at: point(0.35, 0.33, 0.2),
        up: DVec3::Y,
        fov: 65.0,
        fov_axis: FovAxis::Vertical,
    }
}

/// A lamp under the ceiling of a room, which light from outside would not reach.
fn add_ceiling_lamp(description: &mut SceneDescription, bounds: &Bounds3, location: &Location) {
    let size = bounds.max - bounds.min;
    let corner = bounds.min + size * DVec3::new(0.35, 0.97, 0.35);
    let (edge_u, edge_v) = (DVec3::X * (0.3 * size.x), DVec3::Z * (0.3 * size.z));
    let area = edge_u.length() * edge_v.length();
    let radiance = LAMP * std::f64::consts::PI * size.y * size.y / area / LUMENS_PER_WATT;
    let emission = EmissionDescription { radiance: DVec3::splat(radiance), two_sided: false, photons: 1.0 };
    let black = add_material(description, "lamp", 0.0, location);
    // x times z points down.
    let quad = GeometryDescription::Quad { corner, edge_u, edge_v };
    add_shape(description, "ceiling lamp", quad, (black, Some(emission)), location);
}

fn add_material(
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

fn add_shape(
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
            group: None,
        },
    });
}

/// Light from all around, and a large soft lamp above on the left.
fn add_studio(description: &mut SceneDescription, bounds: &Bounds3, location: &Location) {
    let radius = bounds.radius();
    description.lights.push(Named {
        name: "studio".to_owned(),
        location: location.clone(),
        value: LightDescription::Environment { radiance: DVec3::splat(AROUND / LUMENS_PER_WATT) },
    });
    description.light_photons.push(1.0);
    let (distance, side) = (4.0 * radius, 2.4 * radius);
    let towards = DVec3::new(-0.7, 1.0, 0.8).normalize_or_zero();
    let edge_u = DVec3::Y.cross(towards).normalize_or_zero() * side;
    // So that the product points at the model.
    let edge_v = -towards.cross(edge_u).normalize_or_zero() * side;
    let corner = bounds.center() + towards * distance - 0.5 * (edge_u + edge_v);
    let radiance = LAMP * std::f64::consts::PI * (distance / side).powi(2) / LUMENS_PER_WATT;
    let black = add_material(description, "lamp", 0.0, location);
    let emission = EmissionDescription { radiance: DVec3::splat(radiance), two_sided: false, photons: 1.0 };
    let quad = GeometryDescription::Quad { corner, edge_u, edge_v };
    add_shape(description, "studio lamp", quad, (black, Some(emission)), location);
}

fn add_ground(description: &mut SceneDescription, bounds: &Bounds3, location: &Location) {
    let radius = bounds.radius();
    let center = bounds.center().with_y(bounds.min.y - 1e-4 * radius);
    let material = add_material(description, "ground", GROUND, location);
    let disc = GeometryDescription::Disc { center, normal: DVec3::Y, radius: 12.0 * radius };
    add_shape(description, "ground", disc, (material, None), location);
}
