//! Scenes that are placed around a mesh. The mesh keeps the lengths and the place of its file, and everything else moves by the
//! inverse of the fit.

use super::place::{choose_normals, similarity};
use super::{BuildError, BuildProblem, begin_reading, error_of};
use crate::observer::Observer;
use crate::scene_file::description::{
    CameraDescription, DensityDescription, Emitted, FitDescription, FitMoves, GeometryDescription,
    LightDescription, Named, NoiseDescription, ProfileBrightness, ProjectionDescription, SceneDescription,
    SceneWarning, ShapeDescription,
};
use crate::scene_file::enclosure::Triangles;
use crate::scene_file::mesh::{MeshReport, TriangleMesh};
use crate::scene_file::room::{Choice, Model, Room};
use crate::scene_file::{MeshReading, read_mesh_file_with};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;

/// Plausible sizes of models in metres; outside this range the file probably has another unit.
const PLAIN: std::ops::RangeInclusive<f64> = 0.02..=100.0;

/// Meshes that are already read, by the number of their shape.
pub(super) type Ready = BTreeMap<usize, (TriangleMesh, MeshReport)>;

/// The fit of a shape that moves the scene, if it has one.
fn moving(shape: &Named<ShapeDescription>) -> Option<(FitDescription, Choice)> {
    match &shape.value.geometry {
        GeometryDescription::MeshFile { fit: Some(fit), .. } => match fit.moves {
            FitMoves::Scene { room } => Some((*fit, room)),
            FitMoves::Shape => None,
        },
        _ => None,
    }
}

/// Places the scene around the mesh that asks for it, if any. `original` is the description of the file. `taken` is the
/// description with meshes split into their parts, and for each of its shapes the number of the original shape.
pub(super) fn settle(
    original: &SceneDescription,
    taken: Option<(SceneDescription, Vec<usize>)>,
    observer: &dyn Observer,
) -> Result<(Option<SceneDescription>, Ready), BuildError> {
    let mut ready = Ready::new();
    let found = original.shapes.iter().enumerate().find_map(|(i, shape)| Some((i, moving(shape)?)));
    let Some((index, (fit, room))) = found else { return Ok((taken.map(|(scene, _)| scene), ready)) };
    let shape = &original.shapes[index];
    let error = |problem| error_of(shape, problem);
    let (mut scene, origins) =
        taken.unwrap_or_else(|| (original.clone(), (0..original.shapes.len()).collect()));
    let is_own = |number: usize| origins[number] == index;
    if let Some(number) = (0..scene.shapes.len()).find(|&number| is_own(number))
        && let GeometryDescription::MeshFile { path, normals, .. } = &scene.shapes[number].value.geometry
    {
        begin_reading(observer, path);
        let progress = |done, _| {
            observer.advance(done);
            !observer.is_cancelled()
        };
        let reading =
            MeshReading { normals: normals.are_read(), uvs: false, colours: false, progress: &progress };
        let (mut mesh, report) =
            read_mesh_file_with(path, &reading).map_err(|problem| error(problem.into()))?;
        if let Some(cloud) = report.cloud {
            return Err(error(BuildProblem::Cloud(path.clone(), cloud)));
        }
        choose_normals(&mut mesh, *normals);
        ready.insert(number, (mesh, report));
    }
    let (path, missing) = match &shape.value.geometry {
        GeometryDescription::MeshFile { path, .. } => (path.clone(), BuildProblem::Fit(path.clone())),
        _ => return Ok((Some(scene), ready)),
    };
    // The bounds in the file's own space decide, as for every fit; the shape's transform is applied afterwards.
    let own = shape.value.transform;
    let in_file = triangles_of(&scene, &ready, &is_own).under(&own.inverse());
    let file = in_file.bounds();
    let fitted = fit.transform(&file).ok_or_else(|| error(missing))?;
    let staged = own * fitted;
    let around = own * fitted.inverse() * own.inverse();
    let Some(scale) = similarity(&around).filter(|_| around.is_finite()) else {
        return Err(error(BuildProblem::Around));
    };
    let size = file.transformed(&DAffine3::from_mat3(own.matrix3));
    let size = size.max - size.min;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut notes = vec![format!(
        "{name} keeps its lengths, {} x {} x {} m; camera, ground and light are placed around it{}",
        rounded(size.x),
        rounded(size.y),
        rounded(size.z),
        match PLAIN.contains(&size.max_element()) || own.matrix3 != DMat3::IDENTITY {
            true => "",
            false => "; where its file is not in metres, --set unit=mm (or cm, inch, ft) says so",
        }
    )];
    let in_stage = in_file.under(&staged);
    let model = Model::of(&in_stage);
    let room = match room {
        Choice::No => None,
        wish => Room::of(&model, &shape.location, wish == Choice::Yes, &in_stage),
    };
    let mut kept: Vec<bool> = (0..scene.shapes.len()).map(&is_own).collect();
    if let Some(room) = room {
        notes.push(format!(
            "surfaces of {name} face inwards all around and it has a floor, so it is taken for a room and shown from within, \
             without ground, sun and sky; --set room=no shows it from outside"
        ));
        show_room(&mut scene, &room, &model, &mut kept);
        let is_lit =
            scene.shapes.iter().zip(&kept).any(|(shape, kept)| *kept && shape.value.emission.is_some());
        notes.push(if is_lit {
            "its surfaces that emit are all its light".to_owned()
        } else {
            "no surface of it emits, so a light is added in the room".to_owned()
        });
    }
    move_scene(&mut scene, &around, scale, &kept);
    scene
        .notes
        .extend(notes.into_iter().map(|message| SceneWarning { location: shape.location.clone(), message }));
    // Meshes that were read are numbered like the shapes that remain.
    Ok((Some(scene), ready))
}

/// A length rounded to four digits.
fn rounded(length: f64) -> f64 {
    let step = 10f64.powf((length.abs().max(f64::MIN_POSITIVE)).log10().floor() - 3.0);
    let digits = (length / step).round();
    // Dividing by a whole number keeps the result exact in decimal.
    if step < 1.0 { digits / (1.0 / step).round() } else { digits * step }
}

/// The triangles of the shapes selected by `is_own`.
fn triangles_of<'a>(
    scene: &'a SceneDescription,
    ready: &'a Ready,
    is_own: &dyn Fn(usize) -> bool,
) -> Triangles<'a> {
    let mut placed = Vec::new();
    for (number, shape) in scene.shapes.iter().enumerate().filter(|(number, _)| is_own(*number)) {
        let mesh = match &shape.value.geometry {
            GeometryDescription::Loaded { mesh, .. } | GeometryDescription::Gltf { mesh, .. } => {
                Some(&**mesh)
            }
            _ => ready.get(&number).map(|(mesh, _)| mesh),
        };
        let instances = scene.instances.iter().filter(|i| shape.value.group == Some(i.value.group));
        let alone = shape.value.group.is_none().then_some(DAffine3::IDENTITY);
        for above in alone.into_iter().chain(instances.map(|instance| instance.value.transform)) {
            placed.extend(mesh.map(|mesh| (mesh, above * shape.value.transform)));
        }
    }
    Triangles::new(placed)
}

/// Reduces the scene to a room: its camera and light, without any surroundings.
fn show_room(scene: &mut SceneDescription, room: &Room, model: &Model, kept: &mut Vec<bool>) {
    let location = scene.location.clone();
    scene.camera = Some(room.camera.clone());
    scene.lights.clear();
    scene.light_photons.clear();
    // The other shapes keep their numbers, so that meshes already read still match their shapes; they are hidden instead.
    let hidden = scene.groups.len();
    let mut is_hidden = false;
    for (shape, kept) in scene.shapes.iter_mut().zip(kept.iter()) {
        if !kept {
            shape.value.group = Some(hidden);
            shape.value.emission = None;
            is_hidden = true;
        }
    }
    if is_hidden {
        scene.groups.push(Named { name: "left out".to_owned(), location: location.clone(), value: () });
    }
    if scene.shapes.iter().any(|shape| shape.value.emission.is_some()) {
        scene.film.exposure = None;
        return;
    }
    room.add_light(scene, &model.bounds, 1.0, &location);
    kept.resize(scene.shapes.len(), false);
}

/// Applies a similarity with the factor `scale` to the camera, the lights and all shapes except those in `kept`.
fn move_scene(scene: &mut SceneDescription, by: &DAffine3, scale: f64, kept: &[bool]) {
    let point = |p: DVec3| by.transform_point3(p);
    let vector = |v: DVec3| by.transform_vector3(v) / scale;
    if let Some(camera) = &mut scene.camera {
        let lens = camera.lens.map(|mut lens| {
            lens.radius *= scale;
            lens.focus *= scale;
            lens
        });
        let (eye, at, up) = (point(camera.eye), point(camera.at), vector(camera.up));
        let projection = match camera.projection {
            ProjectionDescription::Orthographic { extent, axis } => {
                ProjectionDescription::Orthographic { extent: extent * scale, axis }
            }
            other => other,
        };
        *camera = CameraDescription { eye, at, up, lens, projection, ..camera.clone() };
    }
    for medium in &mut scene.media {
        match medium.value.volume.as_mut().map(|volume| &mut volume.density) {
            None | Some(DensityDescription::Even) => {}
            Some(DensityDescription::Height { up, base, scale: over }) => {
                // `by` keeps angles: a plane across `up` becomes one across its image.
                let on_base = by.transform_point3(up.normalize_or_zero() * *base);
                *up = vector(*up);
                *base = up.normalize_or_zero().dot(on_base);
                *over *= scale;
            }
            Some(DensityDescription::Noise(NoiseDescription { transform, .. }))
            | Some(DensityDescription::Vdb { transform, .. }) => *transform = *by * *transform,
        }
    }
    let mut is_kept_group = vec![false; scene.groups.len()];
    for (shape, kept) in scene.shapes.iter_mut().zip(kept) {
        match shape.value.group {
            None if !kept => shape.value.transform = *by * shape.value.transform,
            Some(group) if *kept => is_kept_group[group] = true,
            _ => {}
        }
    }
    for instance in &mut scene.instances {
        if !is_kept_group[instance.value.group] {
            instance.value.transform = *by * instance.value.transform;
        }
    }
    let area = scale * scale;
    for (shape, kept) in scene.shapes.iter_mut().zip(kept) {
        let is_moved = shape.value.group.map_or(!kept, |group| !is_kept_group[group]);
        if let Some(emission) = &mut shape.value.emission
            && let Emitted::Power(power) = emission.emitted
            && is_moved
        {
            emission.emitted = Emitted::Power(power * area);
        }
    }
    for light in &mut scene.lights {
        match &mut light.value {
            LightDescription::Point { position, intensity } => {
                (*position, *intensity) = (point(*position), *intensity * area);
            }
            LightDescription::Spot { position, direction, intensity, .. } => {
                (*position, *direction) = (point(*position), vector(*direction));
                *intensity *= area;
            }
            LightDescription::Directional { direction, .. } | LightDescription::Sun { direction, .. } => {
                *direction = vector(*direction);
            }
            LightDescription::Profile { position, direction, along, brightness, .. } => {
                (*position, *direction, *along) = (point(*position), vector(*direction), vector(*along));
                *brightness = match *brightness {
                    ProfileBrightness::PerCandela(factor) => ProfileBrightness::PerCandela(factor * area),
                    ProfileBrightness::Power(power) => ProfileBrightness::Power(power * area),
                };
            }
            // These lights have no position, and their orientation stays.
            LightDescription::Environment { .. }
            | LightDescription::EnvironmentMap { .. }
            | LightDescription::Sky { .. }
            | LightDescription::CieSky { .. } => {}
        }
    }
}
