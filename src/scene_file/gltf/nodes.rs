//! The hierarchy of nodes: what stands where.

use super::error::{Failure, fail};
use super::materials::LUMENS_PER_WATT;
use crate::scene_file::description::{CameraDescription, FovAxis, LightDescription, Location};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use gltf::khr_lights_punctual::Kind;
use gltf::scene::Transform;
use std::f64::consts::FRAC_PI_2;

/// A mesh, camera or light of a node, by its index, with the node's name and its place in the world.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub index: usize,
    pub node: String,
    pub to_world: DAffine3,
}

/// What a scene consists of, in the order of its nodes.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    pub meshes: Vec<Placed>,
    pub cameras: Vec<Placed>,
    pub lights: Vec<Placed>,
    /// Nodes with a mesh that a transform makes flat, or moves to infinity.
    pub flat: u64,
    /// Nodes with skins.
    pub skinned: u64,
}

fn local(node: &gltf::Node<'_>) -> DAffine3 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            let columns = matrix.map(|column| column.map(f64::from));
            let matrix = DMat4::from_cols_array_2d(&columns);
            DAffine3::from_mat4(matrix)
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            // Those of files are of unit length but for rounding; zero means nothing is turned.
            let length = rotation.length();
            let rotation = if length > 0.0 { rotation / length } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(
                DVec3::from_array(scale.map(f64::from)),
                rotation,
                DVec3::from_array(translation.map(f64::from)),
            )
        }
    }
}

/// Checks that nodes form trees: none is below itself, or below two others.
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
    // From where every node is reached, none is left over but those of cycles.
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

/// Follows the nodes of a scene; all that have no parent where the file has no scenes.
pub(super) fn hierarchy(document: &gltf::Document, scene: Option<usize>) -> Hierarchy {
    let mut found = Hierarchy::default();
    let scene = scene.and_then(|scene| document.scenes().nth(scene));
    let roots: Vec<gltf::Node<'_>> = match &scene {
        Some(scene) => scene.nodes().collect(),
        None => {
            let mut is_child = vec![false; document.nodes().len()];
            for child in document.nodes().flat_map(|node| node.children().collect::<Vec<_>>()) {
                is_child[child.index()] = true;
            }
            document.nodes().filter(|node| !is_child[node.index()]).collect()
        }
    };
    let mut waiting: Vec<_> = roots.into_iter().rev().map(|node| (node, DAffine3::IDENTITY)).collect();
    while let Some((node, above)) = waiting.pop() {
        let to_world = above * local(&node);
        let placed =
            |index: usize| Placed { index, node: super::label("nodes", node.index(), node.name()), to_world };
        if let Some(mesh) = node.mesh() {
            found.skinned += u64::from(node.skin().is_some());
            let determinant = to_world.matrix3.determinant();
            if to_world.is_finite() && determinant != 0.0 && determinant.is_finite() {
                found.meshes.push(placed(mesh.index()));
            } else {
                found.flat += 1;
            }
        }
        found.cameras.extend(node.camera().map(|camera| placed(camera.index())));
        found.lights.extend(node.light().map(|light| placed(light.index())));
        let children: Vec<_> = node.children().collect();
        waiting.extend(children.into_iter().rev().map(|child| (child, to_world)));
    }
    found
}

/// The pinhole camera of a node: `None`, and a warning, for one of parallel rays, or one that cannot be placed.
pub(super) fn camera(
    camera: &gltf::Camera<'_>,
    placed: &Placed,
    location: &Location,
) -> Result<(CameraDescription, Option<f32>), String> {
    let name = super::label("cameras", camera.index(), camera.name());
    let gltf::camera::Projection::Perspective(lens) = camera.projection() else {
        return Err(format!("{name} is orthographic, which is not modelled; it was left out"));
    };
    let eye = placed.to_world.translation;
    let turned = |v: DVec3| crate::math::unit_f64(placed.to_world.matrix3 * v);
    let (Some(forward), Some(up)) = (turned(DVec3::NEG_Z), turned(DVec3::Y)) else {
        return Err(format!("{name} has no direction; it was left out"));
    };
    let fov = f64::from(lens.yfov()).to_degrees();
    if !(fov > 0.0 && fov < 180.0 && eye.is_finite()) {
        return Err(format!("{name} has a field of view of {fov} degrees; it was left out"));
    }
    // Rounding leaves nothing of a step of 1 far from the origin.
    let step = 1f64.max(1e-3 * eye.length());
    let at = eye + forward * step;
    let description = CameraDescription {
        location: location.clone(),
        eye,
        at,
        up,
        fov,
        fov_axis: FovAxis::Vertical,
        lens: None,
    };
    Ok((description, lens.aspect_ratio().filter(|aspect| aspect.is_finite() && *aspect > 0.0)))
}

/// A light of KHR_lights_punctual, its candela and lux made W/sr and W/m^2. It shines along the node's -z.
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
            // The extension asks for 0 <= inner < outer <= pi / 2.
            let outer = f64::from(outer_cone_angle).clamp(0.0, FRAC_PI_2);
            let inner = f64::from(inner_cone_angle).clamp(0.0, outer);
            LightDescription::Spot { position, direction, intensity: strength, inner, outer }
        }
    }
}

/// Without what scales.
fn rotation(matrix: &DMat3) -> DMat3 {
    let z = crate::math::unit_f64(matrix.z_axis).unwrap_or(DVec3::Z);
    DMat3::from_cols(matrix.x_axis, matrix.y_axis, z)
}
