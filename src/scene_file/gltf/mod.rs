//! Importer for glTF 2.0 and GLB files as complete scenes. The support for each feature is described in `docs/gltf.md`.
//!
//! The JSON is read into the types of the crate `gltf`, which checks it. Buffers and accessors are read here, because every
//! length must be checked before memory is allocated or accessed.

mod check;
mod container;
mod data;
mod error;
mod materials;
mod nodes;
mod primitives;
mod schema;
mod semantics;
mod size;
mod solid;
mod stage;
#[cfg(test)]
mod tests;

pub use error::{GltfError, GltfProblem};
pub(super) use size::declared_gltf_size;

use self::check::Report;
use self::container::Parsed;
use self::data::{Allow, Data};
use self::error::{Failure, fail};
use self::materials::Materials;
use self::nodes::{Hierarchy, Placed, Pose};
use self::primitives::{Deformation, PrimitiveReport, ReadPrimitive};
use self::solid::{Closure, closure_of};
use self::stage::Wishes;
use super::description::{
    EmissionDescription, Emitted, FilmDescription, FilterDescription, GeometryDescription,
    InstanceDescription, Location, MaterialDescription, MediumDescription, Named, SceneDescription,
    SceneWarning, ShapeDescription,
};
use super::diagnostic::suggestion;
use super::room::Choice;
use crate::files::read_regular;
use crate::memory::{MemoryError, MemoryEstimate};
use crate::settings::Overrides;
use crate::textures::VertexData;
use glam::{DAffine3, DVec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// File extensions of glTF.
pub const GLTF_EXTENSIONS: &[&str] = &["gltf", "glb"];

/// Most triangles of emitters over all placements: each triangle is a separate light at each place.
const MOST_EMITTING: usize = 1 << 26;

/// Longest name that a message repeats, in characters.
const SHOWN: usize = 100;

/// Whether a file is glTF, by its extension.
pub fn is_gltf_file(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    GLTF_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Longest description of a problem, in characters.
const LONGEST: usize = 500;

/// A text of the file in the form that messages use.
fn shown(text: &str) -> String {
    cut(text, SHOWN)
}

fn cut(text: &str, longest: usize) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    match text.char_indices().nth(longest) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}

/// Name of an object in messages.
fn label(list: &str, index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) => format!("{list}[{index}] `{}`", shown(name)),
        None => format!("{list}[{index}]"),
    }
}

/// Parameters that the user may set for a file.
struct Parameters<'a> {
    scene: Option<&'a str>,
    camera: Option<&'a str>,
    variant: Option<&'a str>,
    /// Whether files outside the folder of this file may be read.
    outside: bool,
    wishes: Wishes,
    solid: Solid<'a>,
}

/// The user's choices for materials that transmit light and declare no volume.
#[derive(Default)]
struct Solid<'a> {
    all: Choice,
    by_name: Vec<(&'a str, Choice)>,
}

impl Solid<'_> {
    /// The choice for the material of this name; the last choice for a name wins.
    fn of(&self, name: Option<&str>) -> Choice {
        let own = self.by_name.iter().rev().find(|(own, _)| Some(*own) == name);
        own.map_or(self.all, |(_, choice)| *choice)
    }

    /// Checks that every given name is the name of a material.
    fn check(&self, document: &gltf::Document) -> Result<(), Failure> {
        let names: Vec<&str> = document.materials().filter_map(|material| material.name()).collect();
        match self.by_name.iter().find(|(name, _)| !names.contains(name)) {
            Some((name, _)) => {
                let known = suggestion(name, &names);
                fail("", format!("--set solid:{}: there is no material of this name; {known}", shown(name)))
            }
            None => Ok(()),
        }
    }
}

impl<'a> Parameters<'a> {
    fn new(parameters: &'a [(String, String)]) -> Result<Self, Failure> {
        const NAMES: [&str; 8] =
            ["scene", "camera", "variant", "ground", "light", "room", "solid", "outside"];
        let mut read = Self {
            scene: None,
            camera: None,
            variant: None,
            outside: false,
            wishes: Wishes::default(),
            solid: Solid::default(),
        };
        for (name, value) in parameters {
            let choice = || match value.as_str() {
                "auto" => Ok(Choice::Auto),
                "yes" => Ok(Choice::Yes),
                "no" => Ok(Choice::No),
                _ => fail("", format!("--set {name}={}: write auto, yes or no", shown(value))),
            };
            match name.as_str() {
                "scene" => read.scene = Some(value),
                "camera" => read.camera = Some(value),
                "variant" => read.variant = Some(value),
                "ground" => read.wishes.ground = choice()?,
                "light" => read.wishes.light = choice()?,
                "outside" => {
                    read.outside = match value.as_str() {
                        "yes" => true,
                        "no" => false,
                        _ => return fail("", format!("--set outside={}: write yes or no", shown(value))),
                    }
                }
                "room" => read.wishes.room = choice()?,
                "solid" => read.solid.all = choice()?,
                "unit" => {
                    let told = "a glTF file has no parameter `unit`: its lengths are metres; export it with those, or scale it in a \
                                scene file (`type = \"mesh\"`, `file`, and a `transform` with `scale`)";
                    return fail("", told);
                }
                _ if name.starts_with("solid:") => read.solid.by_name.push((&name[6..], choice()?)),
                _ => {
                    let known = suggestion(name, &NAMES);
                    return fail("", format!("a glTF file has no parameter `{}`; {known}", shown(name)));
                }
            }
        }
        Ok(read)
    }
}

/// Index of the item that `wanted` means: a name among `names`, or a number from 0.
fn choose(wanted: &str, names: &[Option<String>], what: &str) -> Result<usize, Failure> {
    let by_name = names.iter().position(|name| name.as_deref() == Some(wanted));
    match by_name.or_else(|| wanted.parse().ok().filter(|index| *index < names.len())) {
        Some(index) => Ok(index),
        None => {
            let known: Vec<String> = names
                .iter()
                .enumerate()
                .take(20)
                .map(|(index, name)| name.as_deref().map_or(index.to_string(), shown))
                .collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            fail("", format!("there is no {what} `{}`; the file has {known}", shown(wanted)))
        }
    }
}

/// Reads a `.gltf` or `.glb` file as a scene. `parameters` are `scene`, `camera`, `variant` (each a name or a number from 0),
/// `ground`, `light`, `room` and `solid` (`auto`, `yes` or `no`), `solid:` followed by the name of a material, and `outside`
/// (`yes` where the file may name files outside its folder).
///
/// # Errors
/// Where the file, or a file that it needs, cannot be read, is damaged, or lacks what was asked for. The error gives file,
/// object, and remedy.
pub fn gltf_scene(path: &Path, parameters: &[(String, String)]) -> Result<SceneDescription, GltfError> {
    gltf_scene_within(path, parameters, &|_| Ok(()))
}

/// [`gltf_scene`] with a callback `allow` that accepts or refuses the memory estimate of the file. It is called before the JSON
/// is parsed, before another file is read, and before meshes are read. The estimate includes the later stages, such as Embree's
/// hierarchy.
///
/// # Errors
/// As [`gltf_scene`], and what `allow` returns.
pub fn gltf_scene_within(
    path: &Path,
    parameters: &[(String, String)],
    allow: &dyn Fn(&MemoryEstimate) -> Result<(), MemoryError>,
) -> Result<SceneDescription, GltfError> {
    let size = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    let file = MemoryEstimate { reading: size, ..MemoryEstimate::default() };
    let allowed = allow(&file).or_else(|error| fail("", error));
    let bytes = allowed.and_then(|()| read_file(path));
    bytes.and_then(|bytes| load(&bytes, path, parameters, allow, true)).map_err(|failure| told(path, failure))
}

/// [`gltf_scene`] for bytes in memory. Messages call the file `path`, and other files are looked for relative to it.
///
/// # Errors
/// As [`gltf_scene`].
pub fn parse_gltf_bytes(bytes: &[u8], path: &Path) -> Result<SceneDescription, GltfError> {
    load(bytes, path, &[], &|_| Ok(()), true).map_err(|failure| told(path, failure))
}

fn told(path: &Path, (object, problem): Failure) -> GltfError {
    let problem = match problem {
        GltfProblem::Other(text) => GltfProblem::Other(cut(&text, LONGEST)),
        other => other,
    };
    GltfError { file: path.to_owned(), object: shown(&object), problem }
}

/// The meshes of a file with their materials, without light and camera, which a scene file has itself.
///
/// # Errors
/// As [`gltf_scene`].
pub(super) fn gltf_model(path: &Path) -> Result<SceneDescription, GltfError> {
    let read = read_file(path).and_then(|bytes| load(&bytes, path, &[], &|_| Ok(()), false));
    read.map_err(|failure| told(path, failure))
}

/// Existing files that this file names.
pub(super) fn further_files(path: &Path) -> Vec<PathBuf> {
    let Ok(bytes) = read_regular(path, u64::MAX) else { return Vec::new() };
    let folder = path.parent().unwrap_or(Path::new(""));
    let value =
        container::split(&bytes).ok().and_then(|parts| serde_json::from_slice::<Value>(parts.json).ok());
    let uris = ["buffers", "images"].into_iter().flat_map(|list| {
        let list = value.as_ref().and_then(|value| value.get(list)).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(|item| item.get("uri").and_then(Value::as_str))
    });
    let mut files: Vec<PathBuf> = uris
        .filter_map(|uri| match data::resolve(uri, folder, true) {
            Ok(data::Resource::File(path)) if path.is_file() => Some(path),
            _ => None,
        })
        .collect();
    files.sort();
    files.dedup();
    files
}

fn read_file(path: &Path) -> Result<Vec<u8>, Failure> {
    let io = |error: std::io::Error| (String::new(), GltfProblem::from(error));
    read_regular(path, u64::MAX).map_err(io)
}

/// The scene of a file; with `is_alone`, missing parts such as a camera are added.
fn load(
    bytes: &[u8],
    path: &Path,
    parameters: &[(String, String)],
    allow: Allow<'_>,
    is_alone: bool,
) -> Result<SceneDescription, Failure> {
    let parameters = Parameters::new(parameters)?;
    let parts = container::split(bytes)?;
    let reading = (bytes.len() as u64).saturating_add(size::of_text(parts.json));
    let estimate = MemoryEstimate { reading, ..MemoryEstimate::default() };
    allow(&estimate).or_else(|error| fail("", error))?;
    let mut warnings = parts.warnings;
    let Parsed { document, json, animations } = container::parse(parts.json, &mut warnings)?;
    nodes::check_trees(&document)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let data = Data::new(&document, parts.binary, folder, parameters.outside, (estimate, allow));
    let mut loader = Loader {
        document: &document,
        data,
        materials: Materials::new(&document, &json),
        description: blank(path),
        report: PrimitiveReport::default(),
        emitting: 0,
        glass: BTreeMap::new(),
    };
    let scenes: Vec<_> = document.scenes().map(|scene| scene.name().map(str::to_owned)).collect();
    let scene = match parameters.scene {
        Some(wanted) => Some(choose(wanted, &scenes, "scene")?),
        None => document.default_scene().map(|scene| scene.index()).or((!scenes.is_empty()).then_some(0)),
    };
    let mut report = Report::default();
    let hierarchy = nodes::hierarchy((&document, &json), scene, &mut loader.data, &mut report)?;
    loader.data.foresee("", |estimate| size::add_meshes(&document, &hierarchy, estimate))?;
    let variants = Variants::new(&json, parameters.variant)?;
    parameters.solid.check(&document)?;
    loader.add_meshes(&hierarchy, &variants, &parameters.solid)?;
    loader.note_glass(&parameters.solid);
    loader.add_camera(&hierarchy, parameters.camera, &mut warnings)?;
    loader.add_lights(&hierarchy);
    warnings.extend(report.into_warnings());
    warnings.extend(findings(animations, &hierarchy, &loader.report));
    let Loader { mut description, mut data, .. } = loader;
    warnings.extend(std::mem::take(&mut data.report).into_warnings());
    let location = description.location.clone();
    let warning = |message| SceneWarning { location: location.clone(), message };
    description.warnings.extend(warnings.into_iter().map(warning));
    description.further_files = data.files;
    description.further_files.sort();
    description.further_files.dedup();
    if is_alone {
        stage::complete(&mut description, parameters.wishes);
    }
    Ok(description)
}

/// An empty scene.
fn blank(path: &Path) -> SceneDescription {
    let location = Location { file: Arc::new(PathBuf::from(path)), line: 0, column: 0 };
    let air =
        MediumDescription { ior: 1.0, dispersion: None, absorption: DVec3::ZERO, priority: 0, volume: None };
    SceneDescription {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        media: vec![Named { name: "air".to_owned(), location: location.clone(), value: air }],
        location,
        camera: None,
        film: FilmDescription {
            width: 640,
            height: 480,
            filter: FilterDescription::Gaussian { radius: 1.5, sigma: 0.5 },
            exposure: Some(0.0),
            white: 0.0,
            crop: None,
        },
        render: Overrides::default(),
        textures: Vec::new(),
        materials: Vec::new(),
        looks: Vec::new(),
        shapes: Vec::new(),
        groups: Vec::new(),
        instances: Vec::new(),
        lights: Vec::new(),
        light_photons: Vec::new(),
        warnings: Vec::new(),
        notes: Vec::new(),
        further_files: Vec::new(),
        parameters: Vec::new(),
    }
}

/// One sentence for each kind of content that was left out.
fn findings(animations: u64, hierarchy: &Hierarchy, report: &PrimitiveReport) -> Vec<String> {
    let counts = [
        (report.other_modes, "primitives of points or lines left out: they have no surface"),
        (report.empty, "primitives without positions or triangles left out"),
        (report.loose, "vertices of skinned meshes without weights hang on the first joint"),
        (hierarchy.flat, "nodes with a mesh left out, as their transform makes it flat, or is not finite"),
        (animations, "animations not played: nodes stand where the file puts them"),
    ];
    let counted =
        counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    counted.chain(report.mesh.findings()).collect()
}

/// A set of texture coordinates that the material reads and the vertices do not have.
fn missing_coordinates(material: &MaterialDescription, data: &VertexData) -> Option<usize> {
    let MaterialDescription::Layered { material, .. } = material else { return None };
    material.slots().map(|slot| slot.set).find(|set| data.uvs.get(*set).is_none_or(Vec::is_empty))
}

/// Material replacements of a variant (KHR_materials_variants).
struct Variants<'a> {
    json: &'a Value,
    chosen: Option<u64>,
}

impl<'a> Variants<'a> {
    fn new(json: &'a Value, wanted: Option<&str>) -> Result<Self, Failure> {
        let list = json.pointer("/extensions/KHR_materials_variants/variants").and_then(Value::as_array);
        let name = |variant: &Value| variant.get("name").and_then(Value::as_str).map(str::to_owned);
        let names: Vec<_> = list.into_iter().flatten().map(name).collect();
        let chosen = wanted.map(|wanted| choose(wanted, &names, "variant")).transpose()?;
        Ok(Self { json, chosen: chosen.map(|chosen| chosen as u64) })
    }

    /// Material of a primitive in the chosen variant.
    fn material(&self, mesh: usize, primitive: &gltf::Primitive<'_>) -> Option<usize> {
        let own = primitive.material().index();
        let Some(chosen) = self.chosen else { return own };
        let pointer = format!(
            "/meshes/{mesh}/primitives/{}/extensions/KHR_materials_variants/mappings",
            primitive.index()
        );
        let mappings = self.json.pointer(&pointer).and_then(Value::as_array);
        let found = mappings.into_iter().flatten().find(|mapping| {
            let variants = mapping.get("variants").and_then(Value::as_array);
            variants.into_iter().flatten().any(|variant| variant.as_u64() == Some(chosen))
        });
        let material = found.and_then(|mapping| mapping.get("material")?.as_u64());
        material.and_then(|material| usize::try_from(material).ok()).or(own)
    }
}

/// State while a file is converted to a description.
struct Loader<'a> {
    document: &'a gltf::Document,
    data: Data<'a>,
    materials: Materials<'a>,
    description: SceneDescription,
    report: PrimitiveReport,
    /// Number of emitting triangles so far.
    emitting: usize,
    /// For each material that transmits light and declares no volume: the number of meshes that became bodies, and of those that
    /// became sheets.
    glass: BTreeMap<usize, [u64; 2]>,
}

impl Loader<'_> {
    /// Adds the meshes of all nodes. A mesh of several nodes becomes a group that these nodes instantiate.
    fn add_meshes(
        &mut self,
        hierarchy: &Hierarchy,
        variants: &Variants<'_>,
        solid: &Solid<'_>,
    ) -> Result<(), Failure> {
        let mut by_mesh: BTreeMap<(usize, &Pose), Vec<&Placed>> = BTreeMap::new();
        for node in &hierarchy.meshes {
            by_mesh.entry((node.index, &node.pose)).or_default().push(node);
        }
        for ((index, pose), mut nodes) in by_mesh {
            let joints = pose.skin.and_then(|skin| hierarchy.skins.get(skin)?.as_deref());
            if joints.is_some() {
                // All instances would be at the same place.
                nodes.truncate(1);
            }
            let deformation = Deformation { weights: pose.weights().collect(), joints };
            let Some(mesh) = self.document.meshes().nth(index) else { continue };
            let name = label("meshes", index, mesh.name());
            let location = self.description.location.clone();
            let group = (nodes.len() > 1).then_some(self.description.groups.len());
            if group.is_some() {
                self.description.groups.push(Named {
                    name: name.clone(),
                    location: location.clone(),
                    value: (),
                });
                self.description.instances.extend(nodes.iter().map(|node| Named {
                    name: node.node.clone(),
                    location: location.clone(),
                    value: InstanceDescription {
                        group: self.description.groups.len() - 1,
                        transform: node.to_world,
                    },
                }));
            }
            let transform = if group.is_some() { DAffine3::IDENTITY } else { nodes[0].to_world };
            let mut parts = Vec::new();
            for primitive in mesh.primitives() {
                let object = format!("{name}, primitive {}", primitive.index());
                let read =
                    primitives::read(&mut self.data, &primitive, &deformation, &object, &mut self.report)?;
                let material = variants.material(index, &primitive);
                parts.extend(read.map(|read| (object, material, read)));
            }
            let bodies = self.bodies(&parts, solid)?;
            for (object, material, ReadPrimitive { mesh: triangles, data }) in parts {
                let coloured = !data.colours.is_empty();
                let body = material.and_then(|material| bodies.get(&material).copied());
                let (data_of, description) = (&mut self.data, &mut self.description);
                let material =
                    self.materials.convert(material, (coloured, body.is_some()), data_of, description)?;
                let lacks = missing_coordinates(&self.description.materials[material.material].value, &data);
                if let Some(set) = lacks {
                    self.data.report.warn("coordinates", || {
                        format!(
                            "{object}: its material has pictures on texture coordinates {set}, which it lacks; they show one \
                             texel"
                        )
                    });
                }
                if material.emission.is_some() {
                    self.emitting = self.emitting.saturating_add(triangles.triangles.len() * nodes.len());
                    if self.emitting > MOST_EMITTING {
                        let problem =
                            format!("more than {MOST_EMITTING} triangles emit light; reduce the mesh");
                        return fail(object, problem);
                    }
                }
                let (two_sided, photons) = (material.two_sided, 1.0);
                let emission = material.emission.map(|radiance| EmissionDescription {
                    emitted: Emitted::Radiance(radiance),
                    two_sided,
                    photons,
                });
                self.description.shapes.push(Named {
                    name: object,
                    location: location.clone(),
                    value: ShapeDescription {
                        illumination: None,
                        geometry: GeometryDescription::Gltf {
                            mesh: Arc::new(triangles),
                            data: Arc::new(data),
                        },
                        transform,
                        flip_normal: body == Some(Closure::InsideOut),
                        material: material.material,
                        caustic_photons: 1.0,
                        emission,
                        displacement: None,
                        group,
                    },
                });
            }
        }
        Ok(())
    }

    /// For each material of a mesh that is solid glass: the closure of its own faces, or of the whole mesh where its own faces
    /// are open.
    fn bodies(
        &mut self,
        parts: &[(String, Option<usize>, ReadPrimitive)],
        solid: &Solid<'_>,
    ) -> Result<BTreeMap<usize, Closure>, Failure> {
        let mut bodies = BTreeMap::new();
        let mut transmitting: Vec<usize> = parts.iter().filter_map(|(_, material, _)| *material).collect();
        transmitting.sort_unstable();
        transmitting.dedup();
        for material in transmitting {
            if !self.materials.is_sheet(material)? {
                continue;
            }
            let name = self.document.materials().nth(material);
            let choice = solid.of(name.as_ref().and_then(gltf::Material::name));
            let own: Vec<_> = parts
                .iter()
                .filter(|(_, other, _)| *other == Some(material))
                .map(|part| &part.2.mesh)
                .collect();
            let all: Vec<_> = parts.iter().map(|part| &part.2.mesh).collect();
            let closure = match closure_of(&own) {
                Closure::Open if own.len() < all.len() => closure_of(&all),
                closure => closure,
            };
            let is_body = choice.over(closure != Closure::Open);
            self.glass.entry(material).or_default()[usize::from(!is_body)] += 1;
            if is_body {
                bodies.insert(material, closure);
            }
        }
        Ok(bodies)
    }

    /// Adds a note for each material that transmits light and declares no volume.
    fn note_glass(&mut self, solid: &Solid<'_>) {
        for (&material, &[bodies, sheets]) in &self.glass {
            let material = self.document.materials().nth(material);
            let Some(material) = material else { continue };
            let name =
                material.name().map_or_else(|| material.index().unwrap_or_default().to_string(), shown);
            let ior = material.ior().unwrap_or(1.5);
            let by = match material.name() {
                Some(name) => format!("--set \"solid:{name}=no\" or --set solid=no"),
                None => "--set solid=no".to_owned(),
            };
            let count = |n: u64, what: &str| format!("{n} {what}mesh{}", if n == 1 { "" } else { "es" });
            let mut parts = Vec::new();
            if bodies > 0 {
                let verb = if bodies == 1 { "is" } else { "are" };
                parts.push(format!(
                    "{} of it {verb} solid, of index {ior} ({by} makes sheets)",
                    count(bodies, "closed ")
                ));
            }
            if sheets > 0 {
                let kind = if sheets == 1 { "is a sheet that does" } else { "are sheets that do" };
                let open = if solid.of(material.name()) == Choice::No { "" } else { "open " };
                parts.push(format!("{} of it {kind} not bend light", count(sheets, open)));
            }
            let message =
                format!("material `{name}` transmits light and states no volume: {}", parts.join(", and "));
            let location = self.description.location.clone();
            self.description.notes.push(SceneWarning { location, message });
        }
    }

    /// Adds the camera that is asked for, or the first usable one; perspective ones come first.
    fn add_camera(
        &mut self,
        hierarchy: &Hierarchy,
        wanted: Option<&str>,
        warnings: &mut Vec<String>,
    ) -> Result<(), Failure> {
        let cameras: Vec<_> = hierarchy
            .cameras
            .iter()
            .filter_map(|placed| Some((placed, self.document.cameras().nth(placed.index)?)))
            .collect();
        let names: Vec<_> = cameras.iter().map(|(_, camera)| camera.name().map(str::to_owned)).collect();
        let order: Vec<usize> = match wanted {
            Some(wanted) => vec![choose(wanted, &names, "camera")?],
            None => {
                let is_flat = |index: &usize| {
                    matches!(cameras[*index].1.projection(), gltf::camera::Projection::Orthographic(_))
                };
                let (flat, deep): (Vec<_>, Vec<_>) = (0..cameras.len()).partition(is_flat);
                [deep, flat].concat()
            }
        };
        for index in order {
            let (placed, camera) = &cameras[index];
            match nodes::camera(camera, placed, &self.description.location) {
                Ok((camera, aspect)) => {
                    if let Some(aspect) = aspect {
                        let height = f64::from(self.description.film.width) / f64::from(aspect);
                        self.description.film.height = height.round().clamp(1.0, 65_536.0) as u32;
                    }
                    self.description.camera = Some(camera);
                    return Ok(());
                }
                Err(problem) if wanted.is_some() => return fail("", problem),
                Err(problem) => warnings.push(problem),
            }
        }
        Ok(())
    }

    fn add_lights(&mut self, hierarchy: &Hierarchy) {
        for placed in &hierarchy.lights {
            let Some(light) = self.document.lights().and_then(|mut lights| lights.nth(placed.index)) else {
                continue;
            };
            let value = nodes::light(&light, placed);
            let number = self.description.lights.len();
            let name = light
                .name()
                .map_or_else(|| placed.node.clone(), |name| format!("{} ({number})", shown(name)));
            self.description.lights.push(Named { name, location: self.description.location.clone(), value });
            self.description.light_photons.push(1.0);
        }
    }
}
