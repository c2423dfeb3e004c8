//! Meshes that bring their materials: each material's faces become a shape of their own.

use super::{BuildError, begin_reading, error_of, gltf_shapes};
use crate::bsdf::{Bsdf, Form, LayeredParameters, Ward};
use crate::render::Observer;
use crate::scene::LayeredMaterial;
use crate::scene_file::MeshReading;
use crate::scene_file::description::{
    EmissionDescription, GeometryDescription, MaterialDescription, MediumDescription, MeshNormals, Named,
    SceneDescription, SceneWarning, ShapeDescription,
};
use crate::scene_file::mesh::TriangleMesh;
use crate::scene_file::obj::{MtlFinish, MtlMaterial, MtlPicture, ObjPart, read_mtl, read_obj_with};
use crate::textures::{Encoding, ImageTexture, Sampler, TextureBudget, TextureSlot, VertexData, Wrap};
use glam::{Affine2, DAffine3, DVec3, Mat2, Vec2, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
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
                let mut warn = |message: String| {
                    let message = format!("{}: {message}", shape.name);
                    taken.warnings.push(SceneWarning { location: shape.location.clone(), message });
                };
                let mut found = HashMap::new();
                let obj = read_obj_with(path, &reading, |libraries| {
                    found = materials_of(libraries, path, &mut warn);
                    found.values().any(|found| found.material.picture.is_some())
                });
                let obj = obj.map_err(|problem| error(problem.into()))?;
                obj.report.findings().into_iter().for_each(&mut warn);
                let materials = add_materials(&mut taken, shape, &found, &obj.parts);
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
                    push_part(&mut taken, shape, material, mesh, before, *normals, &materials);
                }
            }
            _ if gltf_shapes::is_gltf(shape) => gltf_shapes::add(&mut taken, shape)?,
            _ => taken.shapes.push(shape.clone()),
        }
    }
    Ok(Some(taken))
}

/// A material of a file, and the folder that its pictures are in.
struct Found {
    material: MtlMaterial,
    folder: PathBuf,
}

/// The materials of the files that the mesh names; what cannot be read is told.
fn materials_of(
    libraries: &[(PathBuf, usize)],
    path: &Path,
    warn: &mut impl FnMut(String),
) -> HashMap<String, Found> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut found = HashMap::new();
    for (library, line) in libraries {
        let file = folder.join(library);
        let materials = match read_mtl(&file) {
            Ok(materials) => materials,
            Err(error) => {
                warn(format!("line {line} names a file of materials that is not used: {error}"));
                continue;
            }
        };
        let unread: Vec<_> = materials.iter().flat_map(|material| &material.unread).collect();
        if let Some((keyword, line)) = unread.first() {
            warn(format!(
                "{}:{line}: `{keyword}`{} not read, so surfaces look different from what was meant; write the model as glTF \
                 for more",
                file.display(),
                if unread.len() == 1 {
                    " is".to_owned()
                } else {
                    format!(" and {} more statements are", unread.len() - 1)
                }
            ));
        }
        let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
        found.extend(
            materials
                .into_iter()
                .map(|material| (material.name.clone(), Found { material, folder: folder.clone() })),
        );
    }
    found
}

/// What faces of a material get.
struct Added {
    number: usize,
    emission: Option<EmissionDescription>,
    has_picture: bool,
}

/// Adds each material that is used, and yields their numbers by name.
fn add_materials(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    found: &HashMap<String, Found>,
    parts: &[ObjPart],
) -> HashMap<String, Added> {
    let mut added = HashMap::new();
    let mut missing = Vec::new();
    let mut pictures: HashMap<PathBuf, Option<Arc<ImageTexture>>> = HashMap::new();
    let mut warnings = Vec::new();
    let mut budget = TextureBudget::default();
    for part in parts {
        let Some(name) = part.material.as_deref() else { continue };
        let Some(Found { material, folder }) = found.get(name) else {
            missing.push(name);
            continue;
        };
        let (usable, unusable) = usable_picture(material, part);
        warnings.extend(unusable.map(|why| format!("{}: the picture of `{name}` {why}", shape.name)));
        let picture = usable.and_then(|picture| {
            let file = folder.join(&picture.file);
            let texture = pictures.entry(file.clone()).or_insert_with(|| {
                let texture = ImageTexture::read(&file, Encoding::Srgb);
                match texture.and_then(|texture| budget.take(texture, &file)) {
                    Ok(texture) => Some(Arc::new(texture)),
                    Err(error) => {
                        warnings
                            .push(format!("{}: the picture of `{name}` is not used: {error}", shape.name));
                        None
                    }
                }
            });
            texture.clone().map(|texture| slot(picture, texture))
        });
        let has_picture = picture.is_some();
        let value = match (material.finish, picture) {
            (MtlFinish::Lambert(kd), Some(slot)) => layered(kd, Vec3::ZERO, 1.0, slot),
            (MtlFinish::Ward { diffuse, gloss, roughness }, Some(slot)) => {
                layered(diffuse, gloss, roughness, slot)
            }
            (MtlFinish::Lambert(reflectance), None) => {
                MaterialDescription::Lambert { reflectance, two_sided: true }
            }
            (MtlFinish::Mirror(reflectance), _) => {
                MaterialDescription::Mirror { reflectance, two_sided: true }
            }
            (MtlFinish::Ward { diffuse, gloss, roughness }, None) => MaterialDescription::Glossy {
                bsdf: Bsdf::Ward(Ward::new(diffuse, gloss, [roughness; 2], Form::Bounded)),
                two_sided: true,
                tangent: None,
            },
            (MtlFinish::Glass(ior), _) => {
                taken.media.push(Named {
                    name: format!("inside of {name}"),
                    location: shape.location.clone(),
                    value: MediumDescription { ior, absorption: DVec3::ZERO, priority: 0 },
                });
                MaterialDescription::Dielectric { inside: taken.media.len() - 1, outside: 0, roughness: 0.0 }
            }
        };
        let emission = (material.emission != Vec3::ZERO).then(|| EmissionDescription {
            radiance: material.emission.as_dvec3(),
            two_sided: false,
            photons: 1.0,
        });
        added.insert(name.to_owned(), Added { number: taken.materials.len(), emission, has_picture });
        taken.materials.push(Named { name: name.to_owned(), location: shape.location.clone(), value });
    }
    if let Some(first) = missing.first() {
        warnings.push(format!(
            "{}: {} material(s) of the file were not found, the first `{first}`; those faces have the material of \
             the shape",
            shape.name,
            missing.len()
        ));
    }
    let warning = |message| SceneWarning { location: shape.location.clone(), message };
    taken.warnings.extend(warnings.into_iter().map(warning));
    added
}

/// The picture of a material where faces of the part can show it, and what has to be told about it.
fn usable_picture<'a>(material: &'a MtlMaterial, part: &ObjPart) -> (Option<&'a MtlPicture>, Option<String>) {
    let Some(picture) = &material.picture else { return (None, None) };
    match material.finish {
        MtlFinish::Glass(_) | MtlFinish::Mirror(_) => {
            let why = "is not used: glass and mirrors have no diffuse part that it could colour";
            (None, Some(why.to_owned()))
        }
        _ if part.unmapped_faces == 0 => (Some(picture), None),
        _ if part.unmapped_faces == part.faces => {
            let why = "is not used: its faces have no texture coordinates (`f` with numbers of `vt`)";
            (None, Some(why.to_owned()))
        }
        _ => {
            let why = format!(
                "is of one colour, that of its corner, on {} of {} faces, which have no texture coordinates",
                part.unmapped_faces, part.faces
            );
            (Some(picture), Some(why))
        }
    }
}

/// How a surface reads its picture: the file has v upwards, pictures are read from above.
fn slot(picture: &MtlPicture, texture: Arc<ImageTexture>) -> TextureSlot {
    let wrap = if picture.clamped { Wrap::Clamp } else { Wrap::Repeat };
    let scale = Mat2::from_diagonal(picture.scale * Vec2::new(1.0, -1.0));
    let offset = Vec2::new(picture.offset.x, 1.0 - picture.offset.y);
    TextureSlot {
        texture,
        sampler: Sampler { wrap: [wrap; 2], ..Sampler::default() },
        set: 0,
        transform: Affine2::from_mat2_translation(scale, offset),
    }
}

/// A surface with a picture: diffuse, under a gloss of facets with the slope `roughness` that reflects `gloss` straight on.
fn layered(diffuse: Vec3, gloss: Vec3, roughness: f32, slot: TextureSlot) -> MaterialDescription {
    let factors = LayeredParameters { base: diffuse, metallic: 0.0, ..LayeredParameters::default() };
    // Reflectance of the index that is the default.
    let plain = ((factors.ior - 1.0) / (factors.ior + 1.0)).powi(2);
    let specular = if gloss == Vec3::ZERO { 0.0 } else { 1.0 };
    let material = LayeredMaterial {
        factors: LayeredParameters { specular, specular_colour: gloss / plain, ..factors },
        roughness: roughness.sqrt(),
        base: Some(slot),
        ..LayeredMaterial::default()
    };
    MaterialDescription::Layered { material: Arc::new(material), media: None }
}

/// Adds a part as a shape.
fn push_part(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    material: Option<String>,
    mut mesh: TriangleMesh,
    before: DAffine3,
    normals: MeshNormals,
    materials: &HashMap<String, Added>,
) {
    if mesh.triangles.is_empty() {
        return;
    }
    let own = material.as_ref().and_then(|name| materials.get(name));
    let uvs = mesh.uvs.take().filter(|_| own.is_some_and(|own| own.has_picture));
    let loaded = match uvs {
        None => GeometryDescription::Loaded { mesh: Arc::new(mesh), normals, before },
        Some(uvs) => {
            let data = VertexData { uvs: [uvs, Vec::new()], ..VertexData::default() };
            GeometryDescription::Gltf {
                mesh: gltf_shapes::with_normals(&Arc::new(mesh), normals),
                data: Arc::new(data),
            }
        }
    };
    let transform = match &loaded {
        GeometryDescription::Gltf { .. } => shape.value.transform * before,
        _ => shape.value.transform,
    };
    taken.shapes.push(Named {
        name: match &material {
            Some(material) => format!("{} ({material})", shape.name),
            None => shape.name.clone(),
        },
        location: shape.location.clone(),
        value: ShapeDescription {
            geometry: loaded,
            transform,
            material: own.map_or(shape.value.material, |own| own.number),
            emission: shape.value.emission.or_else(|| own.and_then(|own| own.emission)),
            ..shape.value.clone()
        },
    });
}
