//! Meshes that bring their materials: each material's faces become a shape of their own.

use super::{BuildError, begin_reading, error_of, gltf_shapes};
use crate::bsdf::{Bsdf, Form, Ward};
use crate::render::Observer;
use crate::scene_file::MeshReading;
use crate::scene_file::description::{
    GeometryDescription, MaterialDescription, MediumDescription, Named, SceneDescription, SceneWarning,
    ShapeDescription,
};
use crate::scene_file::mesh::TriangleMesh;
use crate::scene_file::obj::{MtlFinish, MtlMaterial, ObjFile, read_mtl, read_obj_with};
use glam::{DAffine3, DVec3};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// The description with such meshes taken apart; `None` where there are none.
pub(super) fn take_apart(
    description: &SceneDescription,
    observer: &dyn Observer,
) -> Result<Option<SceneDescription>, BuildError> {
    let has_own = |shape: &Named<ShapeDescription>| {
        matches!(&shape.value.geometry, GeometryDescription::MeshFile { path, own_materials: true, .. }
            if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj")))
    };
    if !description.shapes.iter().any(|shape| has_own(shape) || gltf_shapes::is_gltf(shape)) {
        return Ok(None);
    }
    let mut taken = SceneDescription { shapes: Vec::new(), ..description.clone() };
    for shape in &description.shapes {
        match &shape.value.geometry {
            GeometryDescription::MeshFile { path, normals, fit, .. } if has_own(shape) => {
                let error = |problem| error_of(shape, problem);
                begin_reading(observer, path);
                let progress = |done, _| {
                    observer.advance(done);
                    !observer.is_cancelled()
                };
                let reading = MeshReading { progress: &progress, ..MeshReading::ALL };
                let obj = read_obj_with(path, &reading).map_err(|problem| error(problem.into()))?;
                let mut warn = |message: String| {
                    let message = format!("{}: {message}", shape.name);
                    taken.warnings.push(SceneWarning { location: shape.location.clone(), message });
                };
                obj.report.findings().into_iter().for_each(&mut warn);
                let found = materials_of(&obj, path, &mut warn);
                let used = obj.parts.iter().filter_map(|part| part.material.as_deref());
                let numbers = add_materials(&mut taken, shape, &found, used);
                let parts = obj.into_meshes();
                let bounds =
                    parts.iter().fold(crate::math::Bounds3::EMPTY, |all, (_, mesh)| all.union(mesh.bounds()));
                let before = match fit {
                    None => DAffine3::IDENTITY,
                    Some(fit) => {
                        let missing = || error(super::BuildProblem::Fit(path.clone()));
                        fit.transform(&bounds).ok_or_else(missing)?
                    }
                };
                for (material, mesh) in parts {
                    push_part(&mut taken, shape, material, mesh, before, *normals, &numbers);
                }
            }
            _ if gltf_shapes::is_gltf(shape) => gltf_shapes::add(&mut taken, shape)?,
            _ => taken.shapes.push(shape.clone()),
        }
    }
    Ok(Some(taken))
}

/// The materials of the files that the mesh names; what cannot be read is told.
fn materials_of(obj: &ObjFile, path: &Path, warn: &mut impl FnMut(String)) -> HashMap<String, MtlFinish> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut found = HashMap::new();
    for (library, line) in &obj.libraries {
        match read_mtl(&folder.join(library)) {
            Ok(materials) => {
                found.extend(materials.into_iter().map(|MtlMaterial { name, finish }| (name, finish)));
            }
            Err(error) => {
                warn(format!("line {line} names a file of materials that is not used: {error}"));
            }
        }
    }
    found
}

/// Adds each material that is used, and yields their numbers by name.
fn add_materials<'a>(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    found: &HashMap<String, MtlFinish>,
    used: impl Iterator<Item = &'a str>,
) -> HashMap<String, usize> {
    let mut numbers = HashMap::new();
    let mut missing = Vec::new();
    for name in used {
        let Some(finish) = found.get(name) else {
            missing.push(name);
            continue;
        };
        let value = match *finish {
            MtlFinish::Lambert(reflectance) => MaterialDescription::Lambert { reflectance, two_sided: true },
            MtlFinish::Mirror(reflectance) => MaterialDescription::Mirror { reflectance, two_sided: true },
            MtlFinish::Ward { diffuse, gloss, roughness } => MaterialDescription::Glossy {
                bsdf: Bsdf::Ward(Ward::new(diffuse, gloss, [roughness; 2], Form::Bounded)),
                two_sided: true,
                tangent: None,
            },
            MtlFinish::Glass(ior) => {
                taken.media.push(Named {
                    name: format!("inside of {name}"),
                    location: shape.location.clone(),
                    value: MediumDescription { ior, absorption: DVec3::ZERO },
                });
                MaterialDescription::Dielectric { inside: taken.media.len() - 1, outside: 0, roughness: 0.0 }
            }
        };
        numbers.insert(name.to_owned(), taken.materials.len());
        taken.materials.push(Named { name: name.to_owned(), location: shape.location.clone(), value });
    }
    if let Some(first) = missing.first() {
        taken.warnings.push(SceneWarning {
            location: shape.location.clone(),
            message: format!(
                "{}: {} material(s) of the file were not found, the first `{first}`; those faces have the material of \
                 the shape",
                shape.name,
                missing.len()
            ),
        });
    }
    numbers
}

/// Adds a part as a shape.
fn push_part(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    material: Option<String>,
    mesh: TriangleMesh,
    before: DAffine3,
    normals: crate::scene_file::description::MeshNormals,
    numbers: &HashMap<String, usize>,
) {
    if mesh.triangles.is_empty() {
        return;
    }
    let number = material.as_ref().and_then(|name| numbers.get(name)).copied();
    taken.shapes.push(Named {
        name: match &material {
            Some(material) => format!("{} ({material})", shape.name),
            None => shape.name.clone(),
        },
        location: shape.location.clone(),
        value: ShapeDescription {
            geometry: GeometryDescription::Loaded { mesh: Arc::new(mesh), normals, before },
            material: number.unwrap_or(shape.value.material),
            ..shape.value.clone()
        },
    });
}
