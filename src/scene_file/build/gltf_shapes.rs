//! Shapes whose file is glTF: each primitive becomes a separate shape, as if the scene file listed it.

use super::{BuildError, BuildProblem, error_of, pictured};
use crate::math::Bounds3;
use crate::scene_file::description::{
    GeometryDescription, InstanceDescription, MaterialDescription, MeshNormals, Named, SceneDescription,
    SceneWarning, ShapeDescription,
};
use crate::scene_file::diagnostic::suggestion;
use crate::scene_file::gltf::{gltf_model, is_gltf_file};
use crate::scene_file::import::material::needs_of;
use crate::scene_file::mesh::TriangleMesh;
use glam::DAffine3;
use std::sync::Arc;

/// Whether the geometry of the shape is a glTF file.
pub(super) fn is_gltf(shape: &Named<ShapeDescription>) -> bool {
    matches!(&shape.value.geometry, GeometryDescription::MeshFile { path, .. } if is_gltf_file(path))
}

/// Bounds of all shapes and instances of a model.
fn bounds_of(model: &SceneDescription) -> Bounds3 {
    let mut bounds = Bounds3::EMPTY;
    for shape in &model.shapes {
        let GeometryDescription::Gltf { mesh, .. } = &shape.value.geometry else { continue };
        let own = mesh.bounds();
        for above in placements(model, &shape.value) {
            bounds = bounds.union(own.transformed(&(above * shape.value.transform)));
        }
    }
    bounds
}

fn placements(model: &SceneDescription, shape: &ShapeDescription) -> Vec<DAffine3> {
    match shape.group {
        None => vec![DAffine3::IDENTITY],
        Some(group) => {
            let instances = model.instances.iter().filter(|instance| instance.value.group == group);
            instances.map(|instance| instance.value.transform).collect()
        }
    }
}

pub(super) fn with_normals(mesh: &Arc<TriangleMesh>, normals: MeshNormals) -> Arc<TriangleMesh> {
    match normals {
        MeshNormals::FromFile => Arc::clone(mesh),
        MeshNormals::Flat => Arc::new(TriangleMesh { normals: None, ..TriangleMesh::clone(mesh) }),
        MeshNormals::Smooth => {
            Arc::new(TriangleMesh { normals: Some(mesh.smooth_normals()), ..TriangleMesh::clone(mesh) })
        }
        MeshNormals::Leading => {
            let mut mesh = TriangleMesh::clone(mesh);
            mesh.follow_normals();
            Arc::new(mesh)
        }
    }
}

/// Replaces `shape` by the shapes of its file, with the file's materials and media where these are wanted.
pub(super) fn add(taken: &mut SceneDescription, shape: &Named<ShapeDescription>) -> Result<(), BuildError> {
    let GeometryDescription::MeshFile { path, normals, own_materials, replaced, fit } = &shape.value.geometry
    else {
        return Ok(());
    };
    let error = |problem| error_of(shape, problem);
    let model = gltf_model(path).map_err(|problem| error(Box::new(problem).into()))?;
    for warning in &model.warnings {
        let message = format!("{}: {}", shape.name, warning.message);
        taken.warnings.push(SceneWarning { location: shape.location.clone(), message });
    }
    for note in &model.notes {
        let message = format!("{}: {}", shape.name, note.message);
        taken.notes.push(SceneWarning { location: shape.location.clone(), message });
    }
    let before = match fit {
        None => DAffine3::IDENTITY,
        Some(fit) => {
            fit.of_shape(&bounds_of(&model)).ok_or_else(|| error(BuildProblem::Fit(path.clone())))?
        }
    };
    let above = shape.value.transform * before;
    let (first_material, first_group) = (taken.materials.len(), taken.groups.len());
    if *own_materials {
        // The first medium is air in every description.
        let first_medium = taken.media.len() - 1;
        let moved = |medium: usize| if medium == 0 { 0 } else { medium + first_medium };
        taken.media.extend(model.media.iter().skip(1).cloned());
        taken.materials.extend(model.materials.iter().cloned().map(|mut material| {
            if let MaterialDescription::Layered { media: Some(media), .. } = &mut material.value {
                *media = media.map(moved);
            }
            material
        }));
    }
    warn_of_unknown(
        taken,
        shape,
        &model.materials.iter().map(|material| &*material.name).collect::<Vec<_>>(),
    );
    let replacement = |part: &ShapeDescription| {
        let name = &model.materials[part.material].name;
        replaced.iter().find(|(replaced, _)| replaced == name).map(|(_, material)| *material)
    };
    // A shape that belongs to a group cannot be grouped again: its meshes are added individually.
    let is_grouped = shape.value.group.is_some();
    if !is_grouped {
        taken.groups.extend(model.groups.iter().cloned());
        taken.instances.extend(model.instances.iter().map(|instance| Named {
            value: InstanceDescription {
                group: first_group + instance.value.group,
                transform: above * instance.value.transform,
            },
            ..instance.clone()
        }));
    }
    for part in &model.shapes {
        let GeometryDescription::Gltf { mesh, data } = &part.value.geometry else { continue };
        let mesh = with_normals(mesh, *normals);
        // A material of the scene may need more than that of the file.
        let own = match replacement(&part.value) {
            _ if !own_materials => Some(shape.value.material),
            other => other,
        };
        let needs = own.and_then(|material| taken.materials.get(material)).map(|it| needs_of(&it.value));
        let data = match needs.filter(|needs| needs.any()) {
            Some(needs) => pictured::of_gltf(taken, shape, needs, data),
            None => Arc::clone(data),
        };
        let stays = part.value.group.is_some() && !is_grouped;
        let all = if stays { vec![DAffine3::IDENTITY] } else { placements(&model, &part.value) };
        for placement in all {
            let transform =
                if stays { part.value.transform } else { above * placement * part.value.transform };
            taken.shapes.push(Named {
                name: format!("{}, {}", shape.name, part.name),
                location: shape.location.clone(),
                value: ShapeDescription {
                    geometry: GeometryDescription::Gltf { mesh: Arc::clone(&mesh), data: Arc::clone(&data) },
                    transform,
                    material: match replacement(&part.value) {
                        Some(material) if *own_materials => material,
                        None if *own_materials => first_material + part.value.material,
                        _ => shape.value.material,
                    },
                    flip_normal: shape.value.flip_normal != part.value.flip_normal,
                    emission: match *own_materials {
                        true => part.value.emission.filter(|_| replacement(&part.value).is_none()),
                        false => shape.value.emission,
                    },
                    displacement: None,
                    group: if stays {
                        part.value.group.map(|group| first_group + group)
                    } else {
                        shape.value.group
                    },
                    ..shape.value.clone()
                },
            });
        }
    }
    Ok(())
}

/// Warns about materials that a shape replaces and its file, which has those in `names`, does not have.
pub(super) fn warn_of_unknown(taken: &mut SceneDescription, shape: &Named<ShapeDescription>, names: &[&str]) {
    let GeometryDescription::MeshFile { path, replaced, .. } = &shape.value.geometry else { return };
    for (name, _) in replaced.iter().filter(|(name, _)| !names.contains(&name.as_str())) {
        let message = format!(
            "{}: no material of {} is named `{name}`, so nothing is replaced; {}",
            shape.name,
            path.display(),
            if names.is_empty() { "it has none".to_owned() } else { suggestion(name, names) }
        );
        taken.warnings.push(SceneWarning { location: shape.location.clone(), message });
    }
}
