//! The node hierarchy: placements of meshes, cameras and lights.

use super::check::Report;
use super::data::Data;
use super::error::{Failure, fail};
use super::materials::LUMENS_PER_WATT;
use crate::memory::{INSTANCE, LIGHT};
use crate::scene_file::description::{
    CameraDescription, FovAxis, LightDescription, Location, ProjectionDescription,
};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use gltf::Semantic;
use gltf::camera::Projection;
use gltf::khr_lights_punctual::Kind;
use gltf::scene::Transform;
use serde_json::Value;
use std::f64::consts::FRAC_PI_2;

/// Most placements of nodes and their instances in total.
const MOST_PLACED: usize = 1 << 23;

/// A mesh, camera or light of a node: its index, the node's name, and its transform to the world.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub index: usize,
    pub node: String,
    pub to_world: DAffine3,
    /// Deformation of the mesh before it is placed.
    pub pose: Pose,
}

/// Deformation of a mesh. Nodes with the same mesh in the same pose share it.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pose {
    /// Skin that places the vertices in the world; the node's own transform is then ignored.
    pub skin: Option<usize>,
    /// Weights of the morph targets, as bits; empty where all are zero.
    weights: Vec<u32>,
}

impl Pose {
    fn of(node: &gltf::Node<'_>, mesh: &gltf::Mesh<'_>) -> Self {
        let weights = node.weights().or(mesh.weights()).unwrap_or_default();
        let weights = if weights.iter().all(|weight| *weight == 0.0) { &[] } else { weights };
        let is_skinned = mesh.primitives().any(|primitive| primitive.get(&Semantic::Joints(0)).is_some());
        Self {
            skin: node.skin().filter(|_| is_skinned).map(|skin| skin.index()),
            weights: weights.iter().map(|weight| weight.to_bits()).collect(),
        }
    }

    /// Weights of the morph targets; empty where all are zero.
    pub(super) fn weights(&self) -> impl Iterator<Item = f32> {
        self.weights.iter().map(|bits| f32::from_bits(*bits))
    }
}

/// The contents of a scene, in the order of its nodes.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    pub meshes: Vec<Placed>,
    pub cameras: Vec<Placed>,
    pub lights: Vec<Placed>,
    /// Number of nodes with a mesh whose transform is singular or not finite.
    pub flat: u64,
    /// For each skin in use the transforms of its joints, from the bind pose to the world.
    pub skins: Vec<Option<Vec<DAffine3>>>,
}

fn local(node: &gltf::Node<'_>) -> DAffine3 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            let columns = matrix.map(|column| column.map(f64::from));
            let matrix = DMat4::from_cols_array_2d(&columns);
            DAffine3::from_mat4(matrix)
        }
        Transform::Decomposed { translation, rotation, scale } => DAffine3::from_scale_rotation_translation(
            DVec3::from_array(scale.map(f64::from)),
            turn(rotation),
            DVec3::from_array(translation.map(f64::from)),
        ),
    }
}

/// A quaternion of a file. It has unit length up to rounding; zero means no rotation.
fn turn(rotation: [f32; 4]) -> DQuat {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    let length = rotation.length();
    if length > 0.0 { rotation / length } else { DQuat::IDENTITY }
}

/// Checks that nodes form trees: no node is its own descendant or has two parents.
pub(super) fn check_trees(document: &gltf::Document) -> Result<(), Failure> {
    let name = |index: usize| {
        let name = document.nodes().nth(index).and_then(|node| node.name().map(str::to_owned));
        super::label("nodes", index, name.as_deref())
    };
    let count = document.nodes().len();
    let mut parent = vec![None; count];
    for node in document.nodes() {
        for child in node.children() {
            if let Some(first) = parent[child.index()].replace(node.index()) {
                let problem =
                    format!("a child of nodes {first} and {}; a node has one parent at most", node.index());
                return fail(name(child.index()), problem);
            }
        }
    }
    // Nodes that are not reached from the roots belong to cycles.
    let mut reached = 0;
    let mut waiting: Vec<usize> = (0..count).filter(|&node| parent[node].is_none()).collect();
    let mut seen = vec![false; count];
    let children: Vec<Vec<usize>> =
        document.nodes().map(|node| node.children().map(|child| child.index()).collect()).collect();
    while let Some(node) = waiting.pop() {
        seen[node] = true;
        reached += 1;
        waiting.extend(&children[node]);
    }
    match seen.iter().position(|seen| !seen) {
        Some(first) if reached < count => fail(name(first), "a node below itself; the file is damaged"),
        _ => Ok(()),
    }
}

/// The parent of each node.
fn parents(document: &gltf::Document) -> Vec<Option<usize>> {
    let mut parents = vec![None; document.nodes().len()];
    for node in document.nodes() {
        node.children().for_each(|child| parents[child.index()] = Some(node.index()));
    }
    parents
}

/// The root nodes of a scene: the listed nodes, except descendants of other listed nodes. Without scenes, all nodes that have no
/// parent.
fn roots<'a>(document: &'a gltf::Document, scene: Option<usize>, report: &mut Report) -> Vec<gltf::Node<'a>> {
    let parents = parents(document);
    let Some(scene) = scene.and_then(|scene| document.scenes().nth(scene)) else {
        return document.nodes().filter(|node| parents[node.index()].is_none()).collect();
    };
    let mut listed = vec![false; parents.len()];
    scene.nodes().for_each(|node| listed[node.index()] = true);
    let name = |node: &gltf::Node<'_>| super::label("nodes", node.index(), node.name());
    let mut roots = Vec::new();
    for node in scene.nodes() {
        if parents[node.index()].is_none() {
            roots.push(node);
            continue;
        }
        let mut above = parents[node.index()];
        while let Some(next) = above.filter(|above| !listed[*above]) {
            above = parents[next];
        }
        if above.is_some() {
            report.warn("child as root", || {
                format!("{} is a child of another node, and the scene lists it as well; it is shown once, where its parent \
                 puts it", name(&node))
            });
        } else {
            report.warn("child without parent", || {
                format!("{} is a child of another node, which the scene does not have; it is shown without its parent's place", name(&node))
            });
            roots.push(node);
        }
    }
    roots
}

/// Transforms of the instances of EXT_mesh_gpu_instancing relative to their node; `None` for a node without.
fn instances(
    node: &gltf::Node<'_>,
    (document, json): (&gltf::Document, &Value),
    data: &mut Data<'_>,
) -> Result<Option<Vec<DAffine3>>, Failure> {
    let attributes = json.get("nodes").and_then(|nodes| nodes.get(node.index()));
    let attributes =
        attributes.and_then(|node| node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes"));
    let Some(attributes) = attributes.and_then(Value::as_object) else { return Ok(None) };
    let object = super::label("nodes", node.index(), node.name());
    let mut first = None;
    let mut accessor = |name: &str| -> Result<Option<gltf::Accessor<'_>>, Failure> {
        let Some(index) = attributes.get(name).and_then(Value::as_u64) else { return Ok(None) };
        let Some(accessor) = document.accessors().nth(index as usize) else { return Ok(None) };
        let (found, first) = (accessor.count(), *first.get_or_insert(accessor.count()));
        if found != first {
            let problem =
                format!("{name} of its instances has {found} elements, and another attribute {first}");
            return fail(&object, format!("{problem}; the file is damaged"));
        }
        if found > MOST_PLACED {
            return fail(&object, format!("{found} instances, and at most {MOST_PLACED} are placed"));
        }
        Ok(Some(accessor))
    };
    // Attributes with other names place nothing, but they give the number of instances.
    let count = match attributes.keys().map(|name| accessor(name)).find_map(Result::transpose) {
        Some(first) => first?.count(),
        None => 0,
    };
    data.foresee(&object, |estimate| {
        estimate.lights = estimate.lights.saturating_add((count as u64).saturating_mul(INSTANCE));
    })?;
    let mut vectors = |name: &str| match accessor(name)? {
        Some(accessor) => data.vectors_exactly::<3>(&accessor).map(Some),
        None => Ok(None),
    };
    let (translations, scales) = (vectors("TRANSLATION")?, vectors("SCALE")?);
    let rotations = match accessor("ROTATION")? {
        Some(accessor) => Some(data.vectors_exactly::<4>(&accessor)?),
        None => None,
    };
    let place = |i: usize| {
        let at = |list: &Option<Vec<[f32; 3]>>, default| {
            list.as_ref().map_or(default, |list| DVec3::from_array(list[i].map(f64::from)))
        };
        let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |rotations| turn(rotations[i]));
        DAffine3::from_scale_rotation_translation(
            at(&scales, DVec3::ONE),
            rotation,
            at(&translations, DVec3::ZERO),
        )
    };
    Ok(Some((0..count).map(place).collect()))
}

/// Traverses the nodes of a scene, or all nodes without a parent where the file has no scenes.
pub(super) fn hierarchy(
    (document, json): (&gltf::Document, &Value),
    scene: Option<usize>,
    data: &mut Data<'_>,
    report: &mut Report,
) -> Result<Hierarchy, Failure> {
    let mut found = Hierarchy { skins: vec![None; document.skins().len()], ..Hierarchy::default() };
    let roots = roots(document, scene, report);
    let mut waiting: Vec<_> = roots.into_iter().rev().map(|node| (node, DAffine3::IDENTITY)).collect();
    while let Some((node, above)) = waiting.pop() {
        let to_world = above * local(&node);
        let name = super::label("nodes", node.index(), node.name());
        let placed = |index: usize| Placed { index, node: name.clone(), to_world, pose: Pose::default() };
        if let Some(mesh) = node.mesh() {
            let pose = Pose::of(&node, &mesh);
            if node.skin().is_some() && pose.skin.is_none() {
                report.warn("skin without joints", || {
                    format!("{name} has a skin, and its mesh no joints; it is shown as it is modelled")
                });
            }
            let inner = instances(&node, (document, json), data)?;
            if inner.is_some() && pose.skin.is_some() {
                return fail(
                    name,
                    "a skin and instances, which glTF has no meaning for; export it without one of them",
                );
            }
            // The transform of a skinned node is ignored: its joints have their own.
            let to_world = if pose.skin.is_some() { DAffine3::IDENTITY } else { to_world };
            for inner in inner.unwrap_or_else(|| vec![DAffine3::IDENTITY]) {
                let to_world = to_world * inner;
                let determinant = to_world.matrix3.determinant();
                if to_world.is_finite() && determinant != 0.0 && determinant.is_finite() {
                    let (node, pose) = (name.clone(), pose.clone());
                    found.meshes.push(Placed { index: mesh.index(), node, to_world, pose });
                } else {
                    found.flat += 1;
                }
            }
            if found.meshes.len() > MOST_PLACED {
                return fail(name, format!("more than {MOST_PLACED} meshes are placed; split the file"));
            }
        }
        found.cameras.extend(node.camera().map(|camera| placed(camera.index())));
        found.lights.extend(node.light().map(|light| placed(light.index())));
        let children: Vec<_> = node.children().collect();
        waiting.extend(children.into_iter().rev().map(|child| (child, to_world)));
    }
    let lights = (found.lights.len() as u64).saturating_mul(LIGHT);
    data.foresee("", |estimate| estimate.lights = estimate.lights.saturating_add(lights))?;
    add_skins(document, &mut found, data)?;
    Ok(found)
}

/// Adds the joint transforms of the skins in use.
fn add_skins(document: &gltf::Document, found: &mut Hierarchy, data: &mut Data<'_>) -> Result<(), Failure> {
    let used: Vec<usize> = found.meshes.iter().filter_map(|placed| placed.pose.skin).collect();
    if used.is_empty() {
        return Ok(());
    }
    // Joints may be anywhere in the file.
    let parents = parents(document);
    let mut to_world = vec![DAffine3::IDENTITY; parents.len()];
    let mut waiting: Vec<_> = document.nodes().filter(|node| parents[node.index()].is_none()).collect();
    while let Some(node) = waiting.pop() {
        let above = parents[node.index()].map_or(DAffine3::IDENTITY, |parent| to_world[parent]);
        to_world[node.index()] = above * local(&node);
        waiting.extend(node.children());
    }
    for index in used {
        let Some(skin) = document.skins().nth(index) else { continue };
        if found.skins[index].is_some() {
            continue;
        }
        let mut joints: Vec<DAffine3> = skin.joints().map(|joint| to_world[joint.index()]).collect();
        if let Some(accessor) = skin.inverse_bind_matrices() {
            let inverse = data.vectors_exactly::<16>(&accessor)?;
            if inverse.len() < joints.len() {
                let problem = format!("{} inverse bind matrices for {} joints", inverse.len(), joints.len());
                let object = super::label("skins", index, skin.name());
                return fail(object, format!("{problem}; the file is damaged"));
            }
            for (joint, inverse) in joints.iter_mut().zip(inverse) {
                *joint *= DAffine3::from_mat4(DMat4::from_cols_array(&inverse.map(f64::from)));
            }
        }
        found.skins[index] = Some(joints);
    }
    Ok(())
}

/// The camera of a node, and the aspect of its picture; a warning for one that cannot be placed.
pub(super) fn camera(
    camera: &gltf::Camera<'_>,
    placed: &Placed,
    location: &Location,
) -> Result<(CameraDescription, Option<f32>), String> {
    let name = super::label("cameras", camera.index(), camera.name());
    let eye = placed.to_world.translation;
    let turned = |v: DVec3| crate::math::unit_f64(placed.to_world.matrix3 * v);
    let (Some(forward), Some(up)) = (turned(DVec3::NEG_Z), turned(DVec3::Y)) else {
        return Err(format!("{name} has no direction; it was left out"));
    };
    if !eye.is_finite() {
        return Err(format!("{name} has no position; it was left out"));
    }
    let (projection, aspect) = match camera.projection() {
        Projection::Perspective(lens) => {
            let fov = f64::from(lens.yfov()).to_degrees();
            if !(fov > 0.0 && fov < 180.0) {
                return Err(format!("{name} has a field of view of {fov} degrees; it was left out"));
            }
            (ProjectionDescription::Perspective { fov, axis: FovAxis::Vertical }, lens.aspect_ratio())
        }
        Projection::Orthographic(lens) => {
            // Half of what is in view.
            let (x, y) = (lens.xmag().abs(), lens.ymag().abs());
            if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()) {
                return Err(format!("{name} shows {x} by {y} m; it was left out"));
            }
            let extent = 2.0 * f64::from(y);
            (ProjectionDescription::Orthographic { extent, axis: FovAxis::Vertical }, Some(x / y))
        }
    };
    // Far from the origin, rounding would swallow a step of 1.
    let step = 1f64.max(1e-3 * eye.length());
    let at = eye + forward * step;
    let description = CameraDescription {
        location: location.clone(),
        eye,
        at,
        up,
        projection,
        lens: None,
        mirrored: false,
    };
    Ok((description, aspect.filter(|aspect| aspect.is_finite() && *aspect > 0.0)))
}

/// A light of KHR_lights_punctual, with candela and lux converted to W/sr and W/m^2. It points along the node's -z.
pub(super) fn light(light: &gltf::khr_lights_punctual::Light<'_>, placed: &Placed) -> LightDescription {
    let colour = DVec3::from_array(light.color().map(f64::from)).max(DVec3::ZERO);
    let strength = colour * (f64::from(light.intensity()).max(0.0) / LUMENS_PER_WATT);
    let strength = if strength.is_finite() { strength } else { DVec3::ZERO };
    let position = placed.to_world.translation;
    let direction = rotation(&placed.to_world.matrix3) * DVec3::NEG_Z;
    match light.kind() {
        Kind::Directional => LightDescription::Directional { direction, irradiance: strength },
        Kind::Point => LightDescription::Point { position, intensity: strength },
        Kind::Spot { inner_cone_angle, outer_cone_angle } => {
            // The extension requires 0 <= inner < outer <= pi / 2.
            let outer = f64::from(outer_cone_angle).clamp(0.0, FRAC_PI_2);
            let inner = f64::from(inner_cone_angle).clamp(0.0, outer);
            LightDescription::Spot { position, direction, intensity: strength, inner, outer }
        }
    }
}

/// The rotation of a matrix, without scales.
fn rotation(matrix: &DMat3) -> DMat3 {
    let z = crate::math::unit_f64(matrix.z_axis).unwrap_or(DVec3::Z);
    DMat3::from_cols(matrix.x_axis, matrix.y_axis, z)
}
