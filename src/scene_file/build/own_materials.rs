//! Meshes with materials of their own: the faces of each material become a separate shape.

use super::mtl_pictures::{Pictures, slot, usable_picture};
use super::{BuildError, BuildProblem, begin_reading, error_of, gltf_shapes, pictured};
use crate::bsdf::{Bsdf, Form, LayeredParameters, Ward};
use crate::observer::Observer;
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::description::{
    EmissionDescription, Emitted, GeometryDescription, MaterialDescription, MediumDescription, MeshNormals,
    Named, SceneDescription, SceneWarning, ShapeDescription,
};
use crate::scene_file::import::material::{Needs, needs_of};
use crate::scene_file::import::vertices::vertex_data;
use crate::scene_file::mesh::{MeshReport, TriangleMesh};
use crate::scene_file::obj::{
    MtlFinish, MtlMaterial, MtlPicture, NamedFile, ObjFile, ObjMesh, ObjPart, find_file, library_files,
    read_mtl, read_obj_with,
};
use crate::scene_file::ply::{PlyModel, declared_look, read_ply_model};
use crate::scene_file::{MeshFileError, MeshReading};
use crate::textures::{Encoding, ImageTexture, TextureBudget, TextureSlot, VertexData};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Splits such meshes into shapes, one for each material. Yields the new description, and for each of its shapes the number of
/// the original shape; `None` where there are no such meshes.
pub(super) fn take_apart(
    description: &SceneDescription,
    observer: &dyn Observer,
) -> Result<Option<(SceneDescription, Vec<usize>)>, BuildError> {
    let is_pictured = |shape: &Named<ShapeDescription>| pictured::needs(description, &shape.value).is_some();
    if !description
        .shapes
        .iter()
        .any(|shape| own_look(shape).is_some() || gltf_shapes::is_gltf(shape) || is_pictured(shape))
    {
        return Ok(None);
    }
    let mut taken = SceneDescription { shapes: Vec::new(), ..description.clone() };
    let mut origins = Vec::new();
    for (number, shape) in description.shapes.iter().enumerate() {
        match (own_look(shape), &shape.value.geometry) {
            (Some(look), GeometryDescription::MeshFile { path, normals, fit, .. }) => {
                begin_reading(observer, path);
                let progress = |done, _| {
                    observer.advance(done);
                    !observer.is_cancelled()
                };
                let reading = MeshReading { progress: &progress, ..MeshReading::ALL };
                let parts = match look {
                    OwnLook::Obj => obj_parts(&mut taken, shape, path, &reading),
                    OwnLook::Ply => ply_parts(&mut taken, shape, path, &reading),
                };
                let parts = parts.map_err(|problem| error_of(shape, problem))?;
                let bounds =
                    parts.iter().fold(crate::math::Bounds3::EMPTY, |all, part| all.union(part.mesh.bounds()));
                let before = match fit {
                    None => DAffine3::IDENTITY,
                    Some(fit) => {
                        let missing = || error_of(shape, super::BuildProblem::Fit(path.clone()));
                        fit.of_shape(&bounds).ok_or_else(missing)?
                    }
                };
                for part in parts {
                    push_part(&mut taken, shape, part, before, *normals);
                }
            }
            _ if gltf_shapes::is_gltf(shape) => gltf_shapes::add(&mut taken, shape)?,
            _ => match pictured::needs(description, &shape.value) {
                Some(needs) => {
                    if let GeometryDescription::MeshFile { path, .. } = &shape.value.geometry {
                        begin_reading(observer, path);
                    }
                    let progress = |done, _| {
                        observer.advance(done);
                        !observer.is_cancelled()
                    };
                    let reading = MeshReading { progress: &progress, ..MeshReading::ALL };
                    pictured::add(&mut taken, shape, needs, &reading)?;
                }
                None => taken.shapes.push(shape.clone()),
            },
        }
        origins.resize(taken.shapes.len(), number);
    }
    Ok(Some((taken, origins)))
}

/// Kinds of mesh files that define the look of their surfaces.
#[derive(Clone, Copy)]
enum OwnLook {
    Obj,
    Ply,
}

/// The kind of file, where the shape uses the look of its file.
fn own_look(shape: &Named<ShapeDescription>) -> Option<OwnLook> {
    let GeometryDescription::MeshFile { path, own_materials: true, .. } = &shape.value.geometry else {
        return None;
    };
    let extension = path.extension()?;
    if extension.eq_ignore_ascii_case("obj") {
        return Some(OwnLook::Obj);
    }
    if !extension.eq_ignore_ascii_case("ply") {
        return None;
    }
    let (has_colours, textures) = declared_look(path);
    (has_colours || !textures.is_empty()).then_some(OwnLook::Ply)
}

/// The faces of one material.
struct Part {
    /// Suffix for the name of the shape.
    name: Option<String>,
    mesh: TriangleMesh,
    colours: Option<Vec<Vec3>>,
    look: Option<Added>,
}

/// Adds messages as warnings at the shape.
fn tell(taken: &mut SceneDescription, shape: &Named<ShapeDescription>, messages: Vec<String>) {
    let warning = |message| SceneWarning {
        location: shape.location.clone(),
        message: format!("{}: {message}", shape.name),
    };
    taken.warnings.extend(messages.into_iter().map(warning));
}

fn obj_parts(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    path: &Path,
    reading: &MeshReading<'_>,
) -> Result<Vec<Part>, BuildProblem> {
    let mut messages = Vec::new();
    let mut found = HashMap::new();
    let is_pictured = scene_materials(shape).any(|material| needs_of(&taken.materials[material].value).any());
    let obj = read_obj_with(path, reading, |libraries| {
        found = materials_of(libraries, path, &mut messages);
        is_pictured
            || found
                .values()
                .any(|Found { material, .. }| material.picture.is_some() || material.cutout.is_some())
    })?;
    no_cloud(shape, path, &obj.report)?;
    messages.extend(obj.report.findings());
    tell(taken, shape, messages);
    let mut materials = add_materials(taken, shape, &found, &obj);
    let part = |ObjMesh { material, mesh, colours }| Part {
        look: materials.remove(&material),
        name: material,
        mesh,
        colours,
    };
    Ok(obj.into_meshes().into_iter().map(part).collect())
}

/// The materials of the scene, not of its file, that a mesh may have.
fn scene_materials(shape: &Named<ShapeDescription>) -> impl Iterator<Item = usize> + '_ {
    let replaced: &[(String, usize)] = match &shape.value.geometry {
        GeometryDescription::MeshFile { replaced, .. } => replaced,
        _ => &[],
    };
    replaced.iter().map(|(_, material)| *material).chain([shape.value.material])
}

/// Refuses a file without faces, which has no extent to fit.
fn no_cloud(shape: &Named<ShapeDescription>, path: &Path, report: &MeshReport) -> Result<(), BuildProblem> {
    match (report.cloud, &shape.value.geometry) {
        (Some(cloud), GeometryDescription::MeshFile { fit: Some(_), .. }) => {
            Err(BuildProblem::Cloud(path.to_path_buf(), cloud))
        }
        _ => Ok(()),
    }
}

fn ply_parts(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    path: &Path,
    reading: &MeshReading<'_>,
) -> Result<Vec<Part>, BuildProblem> {
    let model = read_ply_model(path, reading).map_err(MeshFileError::from)?;
    no_cloud(shape, path, &model.report)?;
    gltf_shapes::warn_of_unknown(taken, shape, &[]);
    let mut messages = model.report.findings();
    let PlyModel { mesh, colours, textures, triangle_textures, unmapped_faces, .. } = model;
    let folder = path.parent().unwrap_or(Path::new(""));
    if mesh.uvs.is_none() && !textures.is_empty() {
        messages.push(format!(
            "the picture `{}` is not used: the file has no texture coordinates (`s t`, `u v` or `texcoord`)",
            textures[0]
        ));
    }
    if unmapped_faces > 0 && !textures.is_empty() {
        messages.push(format!(
            "{unmapped_faces} faces without texture coordinates show one colour of the picture"
        ));
    }
    let textures = if mesh.uvs.is_some() { textures } else { Vec::new() };
    let mut budget = TextureBudget::default();
    let mut pictures: Vec<Option<Arc<ImageTexture>>> = Vec::new();
    for name in &textures {
        let file = find_file(folder, Path::new(name));
        if !file.is_as_named {
            messages.push(format!("the picture `{name}` is not there; {} is used", file.path.display()));
        }
        let texture = ImageTexture::read(&file.path, Encoding::Srgb);
        pictures.push(match texture.and_then(|texture| budget.take(texture, &file.path)) {
            Ok(texture) => Some(Arc::new(texture)),
            Err(error) => {
                messages.push(format!("the picture `{name}` is not used: {error}"));
                None
            }
        });
    }
    // Triangles by picture, in order of first use.
    let mut by_picture: Vec<(usize, Vec<[u32; 3]>)> = Vec::new();
    match triangle_textures {
        Some(numbers) if pictures.len() > 1 => {
            for (&number, &triangle) in numbers.iter().zip(&mesh.triangles) {
                let number = usize::try_from(number).unwrap_or(0);
                match by_picture.iter_mut().find(|(of, _)| *of == number) {
                    Some((_, triangles)) => triangles.push(triangle),
                    None => by_picture.push((number, vec![triangle])),
                }
            }
        }
        _ => by_picture.push((0, mesh.triangles)),
    }
    let is_one = by_picture.len() == 1;
    let whole = ObjFile {
        positions: mesh.positions,
        normals: mesh.normals,
        uvs: mesh.uvs,
        colours,
        parts: by_picture
            .iter_mut()
            .map(|(number, triangles)| ObjPart {
                material: (!is_one).then(|| format!("picture {number}")),
                triangles: std::mem::take(triangles),
                ..ObjPart::default()
            })
            .collect(),
        libraries: Vec::new(),
        report: MeshReport::default(),
    };
    let meshes = if is_one { whole.into_one() } else { whole.into_meshes() };
    let mut parts = Vec::new();
    for ((number, _), ObjMesh { material, mesh, colours }) in by_picture.into_iter().zip(meshes) {
        let picture = pictures.get(number).cloned().flatten();
        let plain = MtlPicture { file: PathBuf::new(), scale: Vec2::ONE, offset: Vec2::ZERO, clamped: false };
        let look = match (picture, colours.is_some()) {
            (Some(texture), _) => Some(Look { slot: Some(slot(&plain, texture)), ..Look::default() }),
            (None, true) => Some(Look { is_coloured: true, ..Look::default() }),
            (None, false) => None,
        };
        let look = look.map(|look| {
            let name = match &look.slot {
                Some(_) => textures.get(number).cloned().unwrap_or_default(),
                None => "colours of the file".to_owned(),
            };
            let (has_picture, is_coloured) = (look.slot.is_some(), look.is_coloured);
            let value = layered(Vec3::ONE, Vec3::ZERO, 1.0, look);
            taken.materials.push(Named { name, location: shape.location.clone(), value });
            Added {
                number: taken.materials.len() - 1,
                emission: None,
                has_picture,
                is_coloured,
                is_own: true,
            }
        });
        parts.push(Part { name: material, mesh, colours, look });
    }
    tell(taken, shape, messages);
    Ok(parts)
}

/// A material of a file, and the folder of its pictures.
struct Found {
    material: MtlMaterial,
    folder: PathBuf,
}

/// The materials of the files that the mesh names; files that cannot be read are reported.
fn materials_of(
    libraries: &[(PathBuf, usize)],
    path: &Path,
    messages: &mut Vec<String>,
) -> HashMap<String, Found> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut found: HashMap<String, Found> = HashMap::new();
    for (text, line) in libraries {
        for NamedFile { path: file, is_as_named } in library_files(folder, text) {
            if !is_as_named {
                messages.push(format!(
                    "line {line}: `{}` is not where it is named; {} is used",
                    text.display(),
                    file.display()
                ));
            }
            let materials = match read_mtl(&file) {
                Ok(materials) => materials,
                Err(error) => {
                    messages.push(format!("line {line} names a file of materials that is not used: {error}"));
                    continue;
                }
            };
            tell_unread(&file, &materials, messages);
            let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
            for material in materials {
                let name = material.name.clone();
                if found.insert(name.clone(), Found { material, folder: folder.clone() }).is_some() {
                    messages.push(format!(
                        "{}: the material `{name}` comes twice; the last counts",
                        file.display()
                    ));
                }
            }
        }
    }
    found
}

/// Reports statements of a material file that are not read, or that are interpreted differently.
fn tell_unread(file: &Path, materials: &[MtlMaterial], messages: &mut Vec<String>) {
    /// Number of keywords that a message lists.
    const MOST_NAMED: usize = 8;
    let unread: Vec<_> = materials.iter().flat_map(|material| &material.unread).collect();
    if let Some((keyword, line)) = unread.first() {
        let mut others: Vec<&(String, usize)> = Vec::new();
        for entry in &unread[1..] {
            let is_new = entry.0 != *keyword && others.iter().all(|other| other.0 != entry.0);
            if is_new && others.len() < MOST_NAMED {
                others.push(entry);
            }
        }
        let others: Vec<_> =
            others.iter().map(|(keyword, line)| format!("`{keyword}` in line {line}")).collect();
        messages.push(format!(
            "{}:{line}: `{keyword}`{} not read, so surfaces look different from what was meant{}; write the model as glTF \
             for more",
            file.display(),
            if unread.len() == 1 {
                " is".to_owned()
            } else {
                format!(" and {} more statements are", unread.len() - 1)
            },
            if others.is_empty() { String::new() } else { format!(" (also {})", others.join(", ")) }
        ));
    }
    let notes: Vec<_> = materials.iter().flat_map(|material| &material.notes).collect();
    for (index, (note, line)) in notes.iter().enumerate() {
        if notes[..index].iter().any(|(before, _)| before == note) {
            continue;
        }
        let more = notes[index + 1..].iter().filter(|(after, _)| after == note).count();
        let more = if more == 0 { String::new() } else { format!(" ({more} more such lines)") };
        messages.push(format!("{}:{line}: {note}{more}", file.display()));
    }
}

/// The material data that faces share.
#[derive(Clone)]
struct Added {
    number: usize,
    emission: Option<EmissionDescription>,
    has_picture: bool,
    is_coloured: bool,
    /// Whether it is of the file, whose images have the origin at their lower left corner.
    is_own: bool,
}

/// Adds each used material, and yields the numbers of the materials by name.
fn add_materials(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    found: &HashMap<String, Found>,
    obj: &ObjFile,
) -> HashMap<Option<String>, Added> {
    let mut added = HashMap::new();
    let mut missing = Vec::new();
    let mut pictures = Pictures::default();
    let mut messages = Vec::new();
    let has_colours = obj.colours.is_some();
    let names: Vec<&str> = obj.parts.iter().filter_map(|part| part.material.as_deref()).collect();
    gltf_shapes::warn_of_unknown(taken, shape, &names);
    let replaced: &[(String, usize)] = match &shape.value.geometry {
        GeometryDescription::MeshFile { replaced, .. } => replaced,
        _ => &[],
    };
    for part in &obj.parts {
        let other = replaced.iter().find(|(name, _)| Some(name) == part.material.as_ref());
        if let Some(&(_, number)) = other {
            let has_picture = matches!(&taken.materials[number].value,
                MaterialDescription::Layered { material, .. } if material.slots().next().is_some());
            let added_one = Added { number, emission: None, has_picture, is_coloured: false, is_own: false };
            added.insert(part.material.clone(), added_one);
            continue;
        }
        let material = part.material.as_deref().and_then(|name| found.get(name));
        let Some(Found { material, folder }) = material else {
            missing.extend(part.material.as_deref());
            if has_colours {
                let look = Look { is_coloured: true, ..Look::default() };
                let value = layered(Vec3::ONE, Vec3::ZERO, 1.0, look);
                let number = taken.materials.len();
                added.insert(
                    part.material.clone(),
                    Added { number, emission: None, has_picture: false, is_coloured: true, is_own: true },
                );
                let name = part.material.clone().unwrap_or_else(|| "colours of the file".to_owned());
                taken.materials.push(Named { name, location: shape.location.clone(), value });
            }
            continue;
        };
        let name = &material.name;
        let (usable, unusable) = usable_picture(material, part);
        messages.extend(unusable.map(|why| format!("the picture of `{name}` {why}")));
        let slot = usable.and_then(|_| pictures.slot(material, folder, &mut messages));
        let has_picture = slot.is_some();
        let is_clear = matches!(material.finish, MtlFinish::Glass(_) | MtlFinish::Mirror(_));
        let is_coloured = has_colours && !has_picture && !is_clear;
        if has_colours && !is_coloured {
            messages.push(format!(
                "colours of vertices are not shown on `{name}`, which has a picture or is clear"
            ));
        }
        let value = description_of(
            taken,
            shape,
            material,
            Look { slot, is_coloured, is_cut: material.cutout.is_some() },
        );
        let emission = (material.emission != Vec3::ZERO).then(|| EmissionDescription {
            emitted: Emitted::Radiance(material.emission.as_dvec3()),
            two_sided: false,
            photons: 1.0,
        });
        let number = taken.materials.len();
        added.insert(
            part.material.clone(),
            Added { number, emission, has_picture, is_coloured, is_own: true },
        );
        taken.materials.push(Named { name: name.clone(), location: shape.location.clone(), value });
    }
    if let Some(first) = missing.first() {
        let instead = if has_colours { "the colours of their vertices" } else { "the material of the shape" };
        messages.push(format!(
            "{} material(s) of the file were not found, the first `{first}`; those faces have {instead}",
            missing.len()
        ));
    }
    tell(taken, shape, messages);
    added
}

/// The description of a material.
fn description_of(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    material: &MtlMaterial,
    look: Look,
) -> MaterialDescription {
    let is_plain = look.slot.is_none() && !look.is_coloured;
    match material.finish {
        MtlFinish::Lambert(reflectance) if is_plain => {
            MaterialDescription::Lambert { reflectance, two_sided: true }
        }
        MtlFinish::Lambert(kd) => layered(kd, Vec3::ZERO, 1.0, look),
        MtlFinish::Mirror(reflectance) => MaterialDescription::Mirror { reflectance, two_sided: true },
        MtlFinish::Ward { diffuse, gloss, roughness } if is_plain => MaterialDescription::Glossy {
            bsdf: Bsdf::Ward(Ward::new(diffuse, gloss, [roughness; 2], Form::Bounded)),
            two_sided: true,
            tangent: None,
        },
        MtlFinish::Ward { diffuse, gloss, roughness } => layered(diffuse, gloss, roughness, look),
        MtlFinish::Metallic { base, metallic, roughness, coat, coat_roughness } => {
            let factors = LayeredParameters { base, metallic, coat, ..LayeredParameters::default() };
            let material = LayeredMaterial { factors, roughness, coat_roughness, ..look.material() };
            MaterialDescription::Layered { material: Arc::new(material), media: None }
        }
        MtlFinish::Glass(ior) => {
            taken.media.push(Named {
                name: format!("inside of {}", material.name),
                location: shape.location.clone(),
                value: MediumDescription {
                    ior,
                    dispersion: None,
                    absorption: DVec3::ZERO,
                    priority: 0,
                    volume: None,
                },
            });
            MaterialDescription::Dielectric { inside: taken.media.len() - 1, outside: 0, roughness: 0.0 }
        }
    }
}

/// Quantities that vary over a surface.
#[derive(Default)]
struct Look {
    slot: Option<TextureSlot>,
    /// Whether vertex colours multiply the material.
    is_coloured: bool,
    /// Whether the picture's alpha cuts holes into the surface.
    is_cut: bool,
}

impl Look {
    fn material(self) -> LayeredMaterial {
        let is_cut = self.is_cut && self.slot.is_some();
        LayeredMaterial {
            base: self.slot,
            coloured: self.is_coloured,
            coverage: if is_cut { Coverage::Blend } else { Coverage::Whole },
            ..LayeredMaterial::default()
        }
    }
}

/// A surface with a picture or vertex colours: a diffuse base under a glossy layer of microfacets with the slope `roughness` and
/// the reflectance `gloss` at normal incidence.
fn layered(diffuse: Vec3, gloss: Vec3, roughness: f32, look: Look) -> MaterialDescription {
    let factors = LayeredParameters { base: diffuse, metallic: 0.0, ..LayeredParameters::default() };
    // Reflectance of the default index of refraction.
    let plain = ((factors.ior - 1.0) / (factors.ior + 1.0)).powi(2);
    let specular = if gloss == Vec3::ZERO { 0.0 } else { 1.0 };
    let material = LayeredMaterial {
        factors: LayeredParameters { specular, specular_colour: gloss / plain, ..factors },
        roughness: roughness.sqrt(),
        ..look.material()
    };
    MaterialDescription::Layered { material: Arc::new(material), media: None }
}

/// Adds a part as a shape.
fn push_part(
    taken: &mut SceneDescription,
    shape: &Named<ShapeDescription>,
    part: Part,
    before: DAffine3,
    normals: MeshNormals,
) {
    let Part { name, mut mesh, colours, look } = part;
    if mesh.triangles.is_empty() {
        return;
    }
    // Faces without a look of their own have that of the scene.
    let is_own = look.as_ref().is_some_and(|look| look.is_own);
    let material = look.as_ref().map_or(shape.value.material, |look| look.number);
    let needs = if is_own { Needs::default() } else { needs_of(&taken.materials[material].value) };
    let has_picture = look.as_ref().is_some_and(|look| look.has_picture) || needs.coordinates;
    let uvs = mesh.uvs.take().filter(|_| has_picture);
    if needs.coordinates && uvs.is_none() {
        taken.warnings.push(pictured::without_coordinates(shape));
    }
    let colours = colours.filter(|_| look.as_ref().is_some_and(|look| look.is_coloured));
    let loaded = if uvs.is_none() && colours.is_none() && !needs.any() {
        GeometryDescription::Loaded { mesh: Arc::new(mesh), normals, before }
    } else {
        let mesh = gltf_shapes::with_normals(&Arc::new(mesh), normals);
        let data = if is_own {
            VertexData {
                uvs: [uvs.unwrap_or_default(), Vec::new()],
                colours: colours.into_iter().flatten().map(|colour| colour.extend(1.0)).collect(),
                ..VertexData::default()
            }
        } else {
            let is_mirrored = (shape.value.transform * before).matrix3.determinant() < 0.0;
            let uvs = pictured::upright(uvs.unwrap_or_default());
            vertex_data(&mesh, uvs, Vec::new(), needs, is_mirrored)
        };
        GeometryDescription::Gltf { mesh, data: Arc::new(data) }
    };
    let transform = match &loaded {
        GeometryDescription::Gltf { .. } => shape.value.transform * before,
        _ => shape.value.transform,
    };
    taken.shapes.push(Named {
        name: match &name {
            Some(name) => format!("{} ({name})", shape.name),
            None => shape.name.clone(),
        },
        location: shape.location.clone(),
        value: ShapeDescription {
            geometry: loaded,
            transform,
            material,
            emission: shape.value.emission.or_else(|| look.and_then(|look| look.emission)),
            ..shape.value.clone()
        },
    });
}
