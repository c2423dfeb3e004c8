//! Builds a scene from its description. Coordinates are recentred and scaled in `f64`, then rounded to `f32` once.

mod around;
mod densities;
mod displace;
mod gltf_shapes;
mod light;
mod media;
mod mtl_pictures;
mod own_materials;
mod pictured;
mod place;
mod textured;

use self::around::Ready;
pub(super) use self::densities::NOISE_BYTES;
use self::displace::Displaced;
use self::light::LightSource;
pub(super) use self::pictured::can_be_pictured;
use self::place::{Placed, Source, place_mesh};
use super::description::{
    CameraDescription, DensityDescription, EmissionDescription, FilmDescription, GeometryDescription,
    IlluminationDescription, Location, MaterialDescription, ProjectionDescription, SceneDescription,
    SceneWarning, ShapeDescription, VolumeDescription,
};
use super::gltf::{GltfError, is_gltf_file};
use super::ies::IesError;
use super::mesh::Cloud;
use super::mesh_file::MeshFileError;
use crate::bsdf::{Dielectric, RoughDielectric};
use crate::camera::{Camera, PixelSpread};
use crate::embree::{Device, EmbreeError, SceneBuilder, TriangleError};
use crate::image_io::ImageError;
use crate::lights::{AreaLight, Light};
use crate::math::{Bounds3, Rgb};
use crate::media::density::DensityError;
use crate::media::{CoefficientError, MOST_MEDIA_OF_SCENE, MediumId, VdbError};
use crate::observer::{Observer, Silent};
use crate::scene::{
    Bump, Geometry, IlluminatedShape, LightNote, Material, MaterialTexture, Node, Placement, RenderSpace,
    Scene, SceneParts, Surface, Target,
};
use crate::shapes::{Chart, EmitterShape, ShapeError};
use glam::{DAffine3, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A built scene with its camera, and the warnings of building it.
#[derive(Debug)]
pub struct BuiltScene {
    /// The scene.
    pub scene: Scene,
    /// The camera, for the requested aspect ratio.
    pub camera: Camera,
    /// The description of the camera: that of the scene, or one that was framed around it.
    pub view: CameraDescription,
    /// The film of the description, completed by what building decided.
    pub film: FilmDescription,
    /// Warnings for the user.
    pub warnings: Vec<SceneWarning>,
    /// Values that were guessed, and how to choose others.
    pub notes: Vec<SceneWarning>,
}

/// Why a scene cannot be built: where, what, and what to do.
#[derive(Debug, thiserror::Error)]
#[error("{location}: {object}: {problem}")]
pub struct BuildError {
    /// Where the object is defined.
    pub location: Location,
    /// Which object.
    pub object: String,
    /// What is wrong with it.
    pub problem: BuildProblem,
}

/// A problem of an object.
#[derive(Debug, thiserror::Error)]
pub enum BuildProblem {
    /// The mesh file cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// The glTF file cannot be read.
    #[error(transparent)]
    Gltf(#[from] Box<GltfError>),
    /// The mesh has no extent to fit.
    #[error(
        "{}: no triangles with an extent: the mesh is empty, damaged, or of points and lines alone; name one with faces",
        .0.display()
    )]
    Fit(PathBuf),
    /// The file has no faces.
    #[error("{}: {}", .0.display(), .1.explanation())]
    Cloud(PathBuf, Cloud),
    /// The triangles are refused.
    #[error(transparent)]
    Triangles(#[from] TriangleError),
    /// The displaced mesh would have too many triangles.
    #[error(
        "`displace` would make {0:.2e} triangles, more than {most}; choose a larger `edge`",
        most = displace::MOST_TRIANGLES
    )]
    Displacement(f64),
    /// The scene cannot be placed around the mesh.
    #[error(
        "its `fit` moves the scene, and its transform scales differently along different axes; leave that out"
    )]
    Around,
    /// The numbers of the placed shape are out of range.
    #[error("{0} (after its transform)")]
    Shape(#[from] ShapeError),
    /// An emitter under a transform that its sampling does not support.
    #[error(
        "emits and is scaled differently along different axes, which light sampling does not cover; use a mesh for this \
         emitter, or scale it equally"
    )]
    NotSimilar,
    /// An emitter of which no area is left.
    #[error(
        "emits, but none of its {0} triangle(s) has an area that single precision can tell; is its scale or its unit right, \
         or does something else lie very far away?"
    )]
    NoEmitter(usize),
    /// An emitter whose area is zero or overflows.
    #[error("emits, but the area of its surface is zero or beyond what can be computed; check its scale")]
    EmitterArea,
    /// An illumination map on a shape that cannot have one.
    #[error("cannot have an illumination map: {0}; leave `illumination-map` out, and its photons are kept")]
    Illumination(&'static str),
    /// More media than rays can distinguish.
    #[error("{0} media, of which at most {MOST_MEDIA_OF_SCENE} can be told apart; let bodies share theirs")]
    Media(usize),
    /// Coefficients of a medium that single precision cannot hold at the scale of the scene.
    #[error("{0} (at the scale of this scene)")]
    Medium(#[from] CoefficientError),
    /// A density that cannot be.
    #[error(transparent)]
    Density(#[from] DensityError),
    /// The file of a density cannot be read.
    #[error(transparent)]
    Vdb(#[from] Box<VdbError>),
    /// An error of Embree.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// A transform that cannot be inverted.
    #[error("its transform flattens everything; give it a scale that is not zero")]
    Singular,
    /// The environment map cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file from which no light can be made.
    #[error("{}: {why}", .path.display())]
    NoLight {
        /// The file.
        path: PathBuf,
        /// The reason, and what to do.
        why: &'static str,
    },
    /// The photometric file of a light cannot be read.
    #[error(transparent)]
    Ies(#[from] IesError),
    /// Parameters of a sky outside the range of its model.
    #[error("its sun is not above the horizon, or its turbidity or albedo is out of range")]
    Sky,
    /// The camera's position, target and up direction define no view.
    #[error("the camera's position and target coincide, or its up direction is parallel to the view")]
    Camera,
    /// No camera, and no shape to frame one around.
    #[error("has no camera and no shape that one could be framed around; add a [camera] table")]
    NoCamera,
    /// Coordinates too large to scale.
    #[error("the extent of the scene is not finite; a coordinate is too large")]
    Extent,
}

/// Distance of the camera from the scene's centre, in radii of the scene, beyond which faces lose significant digits.
const FAR_CAMERA: f64 = 1e5;

/// Extent, in steps of single precision, below which rounding changes the size by more than a thousandth.
const FEW_STEPS: f64 = 1024.0;

/// Number of steps between neighbouring single-precision numbers across the extent of `bounds`, in a space with its origin at
/// `center`. Infinite for bounds without extent.
fn steps_across(bounds: &Bounds3, center: DVec3) -> f64 {
    let extent = 2.0 * bounds.radius();
    if bounds.is_empty() || extent <= 0.0 {
        return f64::INFINITY;
    }
    let farthest = (bounds.min - center).abs().max((bounds.max - center).abs()).max_element();
    extent / (farthest * f64::from(f32::EPSILON))
}

/// Best origin for render space: the middle of the scene, unless something would be coarse there ([`steps_across`]). Then it is
/// the middle of the coarsest object, where numbers are finest; no other coordinate is more than doubled by that.
fn choose_center(bounds: &Bounds3, placed: &[(usize, Bounds3)]) -> DVec3 {
    let center = bounds.center();
    let coarsest = placed
        .iter()
        .map(|(_, bounds)| (steps_across(bounds, center), bounds.center()))
        .filter(|(steps, _)| *steps < FEW_STEPS)
        .min_by(|a, b| a.0.total_cmp(&b.0));
    coarsest.map_or(center, |(_, at)| at)
}

/// Builds the scene for a picture of `width` by `height` pixels.
///
/// # Errors
/// Where a mesh cannot be read, a shape has no extent, or Embree runs out of memory. The error gives place, object and remedy.
pub fn build_scene(
    description: &SceneDescription,
    device: &Arc<Device>,
    size: (u32, u32),
) -> Result<BuiltScene, BuildError> {
    build_scene_watched(description, device, size, &Silent)
}

/// [`build_scene`] with an observer that hears of each file and of Embree's progress, and that may cancel: the work under way
/// then ends with some error.
///
/// # Errors
/// As [`build_scene`].
pub fn build_scene_watched(
    description: &SceneDescription,
    device: &Arc<Device>,
    (width, height): (u32, u32),
    observer: &dyn Observer,
) -> Result<BuiltScene, BuildError> {
    let taken_apart = own_materials::take_apart(description, observer)?;
    let (settled, ready) = around::settle(description, taken_apart, observer)?;
    let description = settled.as_ref().unwrap_or(description);
    if description.media.len() > MOST_MEDIA_OF_SCENE {
        return Err(whole(description, BuildProblem::Media(description.media.len())));
    }
    let (densities, warnings) = densities::read_densities(description, observer)?;
    // Before the builder, which refers to them.
    let (with_bounds, with_scene);
    let mut builder = Builder::read(description, ready, observer)?;
    builder.warnings.extend(warnings);
    with_bounds = densities::with_boxes(description, &densities, None)?;
    if let Some(with_bounds) = &with_bounds {
        builder.extend(with_bounds)?;
    }
    // What a camera that is not given is framed around.
    let seen = bounds_of(&builder.placed_bounds());
    with_scene = densities::with_boxes(builder.description, &densities, Some(&seen))?;
    if let Some(with_scene) = &with_scene {
        builder.extend(with_scene)?;
    }
    let description = builder.description;
    let placed = builder.placed_bounds();
    let bounds = bounds_of(&placed);
    if !(bounds.is_empty() || bounds.center().is_finite() && bounds.radius().is_finite()) {
        return Err(whole(description, BuildProblem::Extent));
    }
    let space = RenderSpace::fitting(choose_center(&bounds, &placed), bounds.radius());
    builder.warn_of_coarse_positions(space.center, &placed);
    let (camera, view) = builder.camera(&seen, &space, (width, height))?;
    let (embree, assembly) = builder.assemble(device, &space, observer)?;
    let radius = space.length(bounds.radius()) as f32;
    let flux = assembly.flux(&builder.lights, &space, f64::from(radius));
    builder.warn_of_darkness(flux);
    let space = space.with_flux(flux);
    let (lights, light_notes) = assembly.lights(description, &builder.lights, &space)?.into_iter().unzip();
    builder.warnings.extend(assembly.warnings);
    let mut surfaces = assembly.surfaces;
    for (id, emitter) in assembly.emitters.iter().enumerate() {
        surfaces[emitter.surface].light = Some(id as u32);
    }
    let scene = Scene::new(SceneParts {
        name: description.name.clone(),
        embree,
        nodes: assembly.nodes,
        surfaces,
        materials: materials(description),
        textures: textures(description),
        media: media::media(description, &space, &placed, densities)?,
        lights,
        space,
        bounds: (space.position(bounds.center()).as_vec3(), radius),
        targets: assembly.targets,
        light_notes,
        pixel: builder.pixel,
    });
    let (film, notes) = (description.film.clone(), description.notes.clone());
    Ok(BuiltScene { scene, camera, view, film, warnings: builder.warnings, notes })
}

/// The box around all that is placed.
fn bounds_of(placed: &[(usize, Bounds3)]) -> Bounds3 {
    placed.iter().fold(Bounds3::EMPTY, |all, (_, bounds)| all.union(*bounds))
}

/// Reports that a file is being read.
fn begin_reading(observer: &dyn Observer, path: &Path) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    observer.begin(&format!("reading {name}"), std::fs::metadata(path).map_or(1, |file| file.len()));
}

fn whole(description: &SceneDescription, problem: BuildProblem) -> BuildError {
    BuildError { location: description.location.clone(), object: "the scene".into(), problem }
}

/// The shapes as read, before render space is chosen.
struct Builder<'a> {
    description: &'a SceneDescription,
    /// For each shape: its source, and its placement in the world or its group.
    sources: Vec<(Source, DAffine3)>,
    /// For each material: its specularity.
    specularities: Vec<f32>,
    /// For each light without a surface: its source.
    lights: Vec<LightSource>,
    warnings: Vec<SceneWarning>,
    /// Width of a pixel at distance 1.
    pixel: PixelSpread,
}

/// A light on a surface whose radiance is not scaled yet.
struct Emitter {
    /// Index of the description's shape.
    shape: usize,
    surface: usize,
    pieces: Vec<EmitterShape>,
    emission: EmissionDescription,
    flip: bool,
}

impl Emitter {
    /// Radiance, W/(m^2 sr).
    fn radiance(&self, space: &RenderSpace) -> DVec3 {
        let area: f64 = self.pieces.iter().map(EmitterShape::area).sum();
        let sides = if self.emission.two_sided { 2.0 } else { 1.0 };
        self.emission.emitted.radiance(sides * area / (space.scale * space.scale))
    }
}

/// The parts of the top-level scene.
#[derive(Default)]
struct Assembly {
    nodes: Vec<Node>,
    surfaces: Vec<Surface>,
    emitters: Vec<Emitter>,
    targets: Vec<Target>,
    warnings: Vec<SceneWarning>,
}

impl<'a> Builder<'a> {
    /// Reads all files, except meshes that are `ready`.
    fn read(
        description: &'a SceneDescription,
        mut ready: Ready,
        observer: &dyn Observer,
    ) -> Result<Self, BuildError> {
        let mut warnings = description.warnings.clone();
        let mut sources = Vec::with_capacity(description.shapes.len());
        for (index, shape) in description.shapes.iter().enumerate() {
            let error = |problem| error_of(shape, problem);
            let known = ready.remove(&index);
            if let (GeometryDescription::MeshFile { path, .. }, None) = (&shape.value.geometry, &known) {
                begin_reading(observer, path);
            }
            let progress = |done, _| {
                observer.advance(done);
                !observer.is_cancelled()
            };
            let (source, before, report) = match known {
                Some((mesh, report)) => (Source::mesh(mesh), DAffine3::IDENTITY, report),
                None => Source::read(&shape.value.geometry, &progress).map_err(error)?,
            };
            let mut warn = |message: String| {
                warnings.push(SceneWarning { location: shape.location.clone(), message });
            };
            for finding in report.findings() {
                warn(format!("{}: {finding}", shape.name));
            }
            if matches!(&source, Source::Mesh(mesh, _) if mesh.triangles.is_empty()) {
                warn(format!("{}: the mesh is empty, nothing of it will be seen", shape.name));
            }
            let transform = shape.value.transform * before;
            let source = match (source, &shape.value.displacement) {
                (Source::Mesh(mesh, _), Some(displacement)) => {
                    let how = Displaced {
                        texture: &description.textures[displacement.texture].value,
                        height: displacement.height,
                        edge: displacement.edge,
                        to_world: transform,
                        flat: displacement.is_flat,
                    };
                    Source::mesh(how.displace(&mesh).map_err(error)?)
                }
                (source, _) => source,
            };
            if !(transform.matrix3.determinant() != 0.0 && transform.is_finite()) {
                return Err(error(BuildProblem::Singular));
            }
            sources.push((source, transform));
        }
        let specularities =
            materials(description).iter().map(|(_, material)| material.specularity()).collect();
        let mut lights = Vec::with_capacity(description.lights.len());
        for light in &description.lights {
            let location = &light.location;
            let (source, findings) = LightSource::read(&light.value).map_err(|problem| BuildError {
                location: location.clone(),
                object: format!("light `{}`", light.name),
                problem,
            })?;
            warnings.extend(findings.into_iter().map(|finding| SceneWarning {
                location: location.clone(),
                message: format!("{}: {finding}", light.name),
            }));
            lights.push(source);
        }
        Ok(Self { description, sources, specularities, lights, warnings, pixel: PixelSpread::default() })
    }

    /// Goes on with a description that has more materials and shapes than the present one.
    fn extend(&mut self, description: &'a SceneDescription) -> Result<(), BuildError> {
        for shape in &description.shapes[self.sources.len()..] {
            let error = |problem| error_of(shape, problem);
            let (source, before, _) = Source::read(&shape.value.geometry, &|_, _| true).map_err(error)?;
            self.sources.push((source, shape.value.transform * before));
        }
        self.description = description;
        self.specularities =
            materials(description).iter().map(|(_, material)| material.specularity()).collect();
        Ok(())
    }

    /// Every placement of every shape: its index, and the transform from its own space to the world. A shape of a group occurs
    /// once for each instance.
    fn placements(&self) -> impl Iterator<Item = (usize, DAffine3, Option<usize>)> + '_ {
        let shapes = self.description.shapes.iter().enumerate();
        shapes.flat_map(move |(index, shape)| {
            let transform = self.sources[index].1;
            let instances = self.description.instances.iter().enumerate();
            let alone = shape.value.group.is_none().then_some((index, transform, None));
            let placed = instances
                .filter(move |(_, instance)| shape.value.group == Some(instance.value.group))
                .map(move |(number, instance)| (index, instance.value.transform * transform, Some(number)));
            alone.into_iter().chain(placed)
        })
    }

    /// Shape and world bounds of each placement.
    fn placed_bounds(&self) -> Vec<(usize, Bounds3)> {
        self.placements()
            .map(|(index, transform, _)| (index, self.sources[index].0.bounds(&transform)))
            .collect()
    }

    /// Warns about objects so small at their place that rounding shows.
    fn warn_of_coarse_positions(&mut self, center: DVec3, placed: &[(usize, Bounds3)]) {
        let mut coarse = vec![f64::INFINITY; self.description.shapes.len()];
        for &(index, ref bounds) in placed {
            coarse[index] = coarse[index].min(steps_across(bounds, center));
        }
        let mut found = coarse.iter().enumerate().filter(|(_, steps)| **steps < FEW_STEPS);
        let Some((index, steps)) = found.next() else { return };
        let others = found.count();
        let shape = &self.description.shapes[index];
        self.warnings.push(SceneWarning {
            location: shape.location.clone(),
            message: format!(
                "{}{} small and far from the middle: {:.0} steps of single precision across, so that rounding shows in \
                 the shape and in caustics; make the scene around smaller, or move the rest towards it",
                shape.name,
                if others == 0 { " is".to_owned() } else { format!(" and {others} more shape(s) are") },
                steps
            ),
        });
    }

    /// Warns about a scene without light. `flux` is the largest channel of the flux of all lights.
    fn warn_of_darkness(&mut self, flux: f64) {
        let glows = |volume: &VolumeDescription| {
            let is_fire = matches!(volume.density, DensityDescription::Vdb { fire: Some(_), .. });
            is_fire || volume.coefficients.emission() != Rgb::ZERO
        };
        let has_glow =
            self.description.media.iter().any(|medium| medium.value.volume.as_ref().is_some_and(glows));
        if flux > 0.0 || has_glow {
            return;
        }
        let is_gltf = is_gltf_file(&self.description.location.file);
        let is_unlit = self.description.lights.is_empty()
            && self.description.shapes.iter().all(|shape| shape.value.emission.is_none());
        let message = match (is_unlit, is_gltf) {
            (true, true) => {
                "the file has no light, so the picture is black: leave `--set light=no` out, and that of a studio is added"
            }
            (true, false) => {
                "the scene has no light, so the picture is black: add a `[[lights]]` table, for example `type = \"environment\"` \
                 with `radiance = [1.0, 1.0, 1.0]`, or `emission` to a shape"
            }
            (false, true) => {
                "all lights of the file have a power of zero, so the picture is black: --set light=yes adds that of a studio"
            }
            (false, false) => {
                "all lights of the scene have a power of zero, so the picture is black: give one a power above zero"
            }
        };
        let location = self.description.location.clone();
        self.warnings.push(SceneWarning { location, message: message.to_owned() });
    }

    fn camera(
        &mut self,
        bounds: &Bounds3,
        space: &RenderSpace,
        (width, height): (u32, u32),
    ) -> Result<(Camera, CameraDescription), BuildError> {
        let aspect = f64::from(width) / f64::from(height);
        let description = match &self.description.camera {
            Some(camera) => camera.clone(),
            None if bounds.is_empty() => return Err(whole(self.description, BuildProblem::NoCamera)),
            None => framing(bounds, aspect, &self.description.location),
        };
        let error = || BuildError {
            location: description.location.clone(),
            object: "camera".into(),
            problem: BuildProblem::Camera,
        };
        let eye = space.position(description.eye);
        if eye.length() > FAR_CAMERA {
            self.warnings.push(SceneWarning {
                location: description.location.clone(),
                message: format!(
                    "the camera is {:.0} scene radii away, where rays of single precision lose the scene's details; is \
                     the unit of the camera that of the scene?",
                    eye.length()
                ),
            });
        }
        let camera = description.build(space, (width, height)).ok_or_else(error)?;
        self.pixel = camera.spread(height);
        Ok((camera, description))
    }

    fn assemble(
        &mut self,
        device: &Arc<Device>,
        space: &RenderSpace,
        observer: &dyn Observer,
    ) -> Result<(crate::embree::CommittedScene, Assembly), BuildError> {
        let fail = |problem: EmbreeError| whole(self.description, problem.into());
        let mut top = SceneBuilder::new(device).map_err(fail)?;
        let mut assembly = Assembly::default();
        let to_render = space.to_affine();
        let mut instanced = vec![false; self.description.shapes.len()];
        let placements: Vec<_> = self.placements().collect();
        for (index, transform, instance) in placements {
            let shape = &self.description.shapes[index];
            let source = &self.sources[index].0;
            let total = to_render * transform;
            let emits = shape.value.emission.is_some();
            if shape.value.illumination.is_some() && (instance.is_some() || source.needs_instance(&total)) {
                let reason = "it is in a group, or scaled differently along different axes";
                return Err(error_of(shape, BuildProblem::Illumination(reason)));
            }
            // Emitters are separate lights at each place, so they are never instanced.
            if instance.is_some() && !emits && !source.needs_instance(&total) {
                instanced[index] = true;
                continue;
            }
            if source.needs_instance(&total) {
                if emits {
                    return Err(error_of(shape, BuildProblem::NotSimilar));
                }
                self.add_distorted(index, &total, device, &mut top, &mut assembly)?;
                continue;
            }
            let charts = self.charts(index, &total);
            let illumination =
                self.illumination(index, &total).map_err(|problem| error_of(shape, problem))?;
            // A mesh that is placed once is transformed in place, without a copy.
            let alone = if instance.is_none() { self.sources[index].0.take_mesh() } else { None };
            let placed = match alone {
                Some((mesh, own)) => place_mesh(mesh, &own, &total, emits),
                None => self.sources[index].0.place(&total, emits),
            };
            let placed = placed.map_err(|problem| error_of(shape, problem))?;
            let placed = self.with_vertex_data(index, &total, placed);
            self.add_surface(index, placed, &mut top, &mut assembly)?;
            if let Some(surface) = assembly.surfaces.last_mut() {
                surface.illumination = illumination;
                surface.charts = charts;
            }
        }
        self.add_groups(&instanced, &to_render, device, &mut top, &mut assembly)?;
        // Progress in thousandths.
        observer.begin("building the hierarchy", 1000);
        let committed = top.commit_watched(&|share| {
            observer.advance((1000.0 * share.clamp(0.0, 1.0)) as u64);
            !observer.is_cancelled()
        });
        Ok((committed.map_err(fail)?, assembly))
    }

    fn add_surface(
        &self,
        index: usize,
        placed: Placed,
        builder: &mut SceneBuilder,
        assembly: &mut Assembly,
    ) -> Result<(), BuildError> {
        let shape = &self.description.shapes[index];
        self.add_geometry(index, builder, &placed.geometry)?;
        let flip = shape.value.flip_normal != placed.flip;
        let surface = assembly.surfaces.len();
        if placed.lost > 0 {
            assembly.warnings.push(SceneWarning {
                location: shape.location.clone(),
                message: format!(
                    "{}: {} of the {} triangles of this emitter have no area in single precision and were left out; they \
                     neither emit nor are seen",
                    shape.name,
                    placed.lost,
                    placed.lost + placed.emitter.len()
                ),
            });
        }
        // Empty only for an empty mesh, which was reported when it was read.
        if let Some(emission) = shape.value.emission.filter(|_| !placed.emitter.is_empty()) {
            assembly.emitters.push(Emitter { shape: index, surface, pieces: placed.emitter, emission, flip });
        }
        if !placed.bounds.is_empty() {
            assembly.targets.push(self.target(index, placed.sphere, &placed.bounds, surface));
        }
        assembly.nodes.push(Node::Surface(surface as u32));
        assembly.surfaces.push(self.surface(index, placed.geometry, flip));
        Ok(())
    }

    /// Adds a shape that its transform distorts, as an instance of the undistorted shape.
    fn add_distorted(
        &self,
        index: usize,
        total: &DAffine3,
        device: &Arc<Device>,
        top: &mut SceneBuilder,
        assembly: &mut Assembly,
    ) -> Result<(), BuildError> {
        let shape = &self.description.shapes[index];
        let error = |problem| error_of(shape, problem);
        let source = &self.sources[index].0;
        // Its own space is scaled to the unit sphere as well.
        let own = source.bounds(&DAffine3::IDENTITY);
        let local = RenderSpace::fitting(own.center(), own.radius()).to_affine();
        let placed = source.place(&local, false).map_err(error)?;
        let mut builder = SceneBuilder::new(device).map_err(|problem| error(problem.into()))?;
        add_geometry(&mut builder, &placed.geometry).map_err(|problem| error(problem.into()))?;
        let committed = Arc::new(builder.commit().map_err(|problem| error(problem.into()))?);
        let first = assembly.surfaces.len() as u32;
        assembly.surfaces.push(self.surface(index, placed.geometry, shape.value.flip_normal));
        let placement =
            Placement::new(*total * local.inverse()).ok_or_else(|| error(BuildProblem::Singular))?;
        top.add_instance(&committed, &placement.to_world).map_err(|problem| error(problem.into()))?;
        let bounds = source.bounds(total);
        if !bounds.is_empty() {
            let target = self.target(index, (bounds.center(), bounds.radius()), &bounds, first as usize);
            assembly.targets.push(target);
        }
        assembly.nodes.push(Node::Instance { first, placement: Box::new(placement) });
        Ok(())
    }

    /// Adds groups whose shapes are shared by their instances: one Embree scene for each.
    fn add_groups(
        &self,
        instanced: &[bool],
        to_render: &DAffine3,
        device: &Arc<Device>,
        top: &mut SceneBuilder,
        assembly: &mut Assembly,
    ) -> Result<(), BuildError> {
        for (group, name) in self.description.groups.iter().enumerate() {
            let members: Vec<usize> = (0..instanced.len())
                .filter(|&i| instanced[i] && self.description.shapes[i].value.group == Some(group))
                .collect();
            if members.is_empty() {
                continue;
            }
            let error = |problem: BuildProblem| BuildError {
                location: name.location.clone(),
                object: format!("group `{}`", name.name),
                problem,
            };
            let bounds = members.iter().fold(Bounds3::EMPTY, |bounds, &i| {
                bounds.union(self.sources[i].0.bounds(&self.sources[i].1))
            });
            let local = RenderSpace::fitting(bounds.center(), bounds.radius()).to_affine();
            let mut builder = SceneBuilder::new(device).map_err(|problem| error(problem.into()))?;
            let first = assembly.surfaces.len() as u32;
            for &index in &members {
                let shape = &self.description.shapes[index];
                let placed = self.place(index, &(local * self.sources[index].1), false)?;
                self.add_geometry(index, &mut builder, &placed.geometry)?;
                let flip = shape.value.flip_normal != placed.flip;
                let charts = self.charts(index, &(local * self.sources[index].1));
                assembly.surfaces.push(Surface { charts, ..self.surface(index, placed.geometry, flip) });
            }
            let committed = Arc::new(builder.commit().map_err(|problem| error(problem.into()))?);
            for instance in self.description.instances.iter().filter(|i| i.value.group == group) {
                let world = *to_render * instance.value.transform;
                let placement =
                    Placement::new(world * local.inverse()).ok_or_else(|| error(BuildProblem::Singular))?;
                top.add_instance(&committed, &placement.to_world).map_err(|problem| error(problem.into()))?;
                for (number, &index) in members.iter().enumerate() {
                    let (source, transform) = &self.sources[index];
                    let bounds = source.bounds(&(world * *transform));
                    if !bounds.is_empty() {
                        let sphere = (bounds.center(), bounds.radius());
                        assembly.targets.push(self.target(index, sphere, &bounds, first as usize + number));
                    }
                }
                assembly.nodes.push(Node::Instance { first, placement: Box::new(placement) });
            }
        }
        Ok(())
    }

    fn surface(&self, index: usize, geometry: Geometry, flip_normal: bool) -> Surface {
        let shape = &self.description.shapes[index];
        Surface {
            name: shape.name.clone(),
            geometry,
            flip_normal,
            material: shape.value.material as u32,
            part_materials: self.part_materials(index),
            light: None,
            illumination: None,
            charts: Vec::new(),
        }
    }

    /// The charts of shape `index` under `total`; none where it has no coordinates.
    fn charts(&self, index: usize, total: &DAffine3) -> Vec<Chart> {
        // A shape that is too degenerate for a chart is reported where it is placed.
        self.sources[index].0.charts(total).ok().flatten().unwrap_or_default()
    }

    /// The illumination map of shape `index` under `total`, where it is to have one.
    fn illumination(
        &self,
        index: usize,
        total: &DAffine3,
    ) -> Result<Option<Arc<IlluminatedShape>>, BuildProblem> {
        let shape = &self.description.shapes[index].value;
        let Some(asked) = shape.illumination else { return Ok(None) };
        let material = &self.description.materials[shape.material].value;
        if !matches!(material, MaterialDescription::Lambert { .. }) {
            return Err(BuildProblem::Illumination(
                "the map holds irradiance, which says what is reflected by a `lambert` material alone",
            ));
        }
        let charts = self.sources[index].0.charts(total)?;
        let charts = charts.ok_or(BuildProblem::Illumination("it has no coordinates"))?;
        let IlluminationDescription { kernel, elements, refinement } = asked;
        Ok(Some(Arc::new(IlluminatedShape { charts, kernel, elements, refinement })))
    }

    /// Materials of the parts of a shape; empty where all parts have the shape's material.
    fn part_materials(&self, index: usize) -> Vec<u32> {
        let shape = &self.description.shapes[index].value;
        match &shape.geometry {
            GeometryDescription::Csg { materials, .. } if materials.iter().any(Option::is_some) => {
                materials.iter().map(|own| own.unwrap_or(shape.material) as u32).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Bounding sphere and box of shape `index` as a target for photons. Its material decides whether it is a caustic caster.
    fn target(
        &self,
        index: usize,
        (center, radius): (DVec3, f64),
        bounds: &Bounds3,
        surface: usize,
    ) -> Target {
        let shape = &self.description.shapes[index].value;
        let parts = self.part_materials(index).into_iter().map(|material| material as usize);
        let specularity =
            parts.chain([shape.material]).map(|material| self.specularities[material]).fold(0.0, f32::max);
        Target {
            center: center.as_vec3(),
            // Rounding of centre and radius must not leave part of the shape outside.
            radius: (radius * (1.0 + 1e-5) + 1e-7 * center.length()) as f32,
            density: specularity * shape.caustic_photons as f32,
            surface: surface as u32,
            bounds: {
                let (min, max) = bounds.to_f32_outward();
                [min.into(), max.into()]
            },
        }
    }
}

impl Assembly {
    /// Largest channel of the flux of all lights, in render units before the power factor.
    fn flux(&self, lights: &[LightSource], space: &RenderSpace, radius: f64) -> f64 {
        let mut total = DVec3::ZERO;
        for emitter in &self.emitters {
            let area: f64 = emitter.pieces.iter().map(EmitterShape::area).sum();
            let sides = if emitter.emission.two_sided { 2.0 } else { 1.0 };
            total += emitter.radiance(space) * (std::f64::consts::PI * area * sides);
        }
        for light in lights {
            total += light.flux(space, radius);
        }
        total.max_element()
    }

    /// The lights of the scene: one for each emitter, in their order, then those without a surface.
    fn lights(
        &self,
        description: &SceneDescription,
        sources: &[LightSource],
        space: &RenderSpace,
    ) -> Result<Vec<(Light, LightNote)>, BuildError> {
        let scaled = |colour: DVec3| (colour * space.power).as_vec3();
        let areas = self.emitters.iter().map(|emitter| {
            let radiance = scaled(emitter.radiance(space));
            let note = LightNote {
                name: self.surfaces[emitter.surface].name.clone(),
                photons: emitter.emission.photons as f32,
            };
            let light =
                AreaLight::new(emitter.pieces.clone(), radiance, emitter.emission.two_sided, emitter.flip);
            light
                .and_then(|light| {
                    textured::with_glow(light, description, emitter.shape, &self.surfaces[emitter.surface])
                })
                .map(|light| (Light::Area(light), note))
                .ok_or_else(|| error_of(&description.shapes[emitter.shape], BuildProblem::EmitterArea))
        });
        let notes = description.lights.iter().zip(&description.light_photons);
        let notes =
            notes.map(|(light, &photons)| LightNote { name: light.name.clone(), photons: photons as f32 });
        let others = sources.iter().zip(notes).flat_map(|(source, note)| {
            source.lights(space).into_iter().map(move |(part, light)| {
                (light, LightNote { name: format!("{}{part}", note.name), ..note.clone() })
            })
        });
        areas.chain(others.map(Ok)).collect()
    }
}

fn error_of(shape: &super::Named<ShapeDescription>, problem: BuildProblem) -> BuildError {
    BuildError { location: shape.location.clone(), object: format!("shape `{}`", shape.name), problem }
}

fn add_geometry(builder: &mut SceneBuilder, geometry: &Geometry) -> Result<u32, EmbreeError> {
    match geometry {
        Geometry::Mesh(mesh) => builder.add_triangles(mesh.buffers.clone()),
        Geometry::Procedural(object) => builder.add_procedural(Arc::clone(object)),
    }
}

fn materials(description: &SceneDescription) -> Vec<(String, Material)> {
    let named = |material: &super::Named<MaterialDescription>| {
        (material.name.clone(), material_of(description, &material.value))
    };
    description.materials.iter().map(named).collect()
}

fn material_of(description: &SceneDescription, material: &MaterialDescription) -> Material {
    match *material {
        MaterialDescription::Lambert { reflectance, two_sided } => {
            Material::Lambert { reflectance, two_sided }
        }
        MaterialDescription::Mirror { reflectance, two_sided } => Material::Mirror { reflectance, two_sided },
        MaterialDescription::Dielectric { inside, outside, roughness } => {
            let ior = |medium: usize| description.media[medium].value.ior;
            let smooth = Dielectric::new(ior(outside), ior(inside));
            let (inside, outside) = (inside as MediumId, outside as MediumId);
            match RoughDielectric::new(smooth, roughness as f32) {
                Some(interface) => Material::RoughDielectric { inside, outside, interface },
                None => Material::Dielectric { inside, outside, interface: smooth },
            }
        }
        MaterialDescription::Layered { ref material, media } => Material::Layered {
            bsdf: material.representative(),
            media: media.map(|media| media.map(|medium| medium as MediumId)),
        },
        MaterialDescription::Glossy { bsdf, two_sided, tangent } => {
            Material::Glossy { bsdf, two_sided, tangent }
        }
    }
}

/// Textures of each material; an empty list where no material has one.
fn textures(description: &SceneDescription) -> Vec<MaterialTexture> {
    let texture = |index: usize| description.textures[index].value;
    let look_of = |index: usize| description.looks.get(index).copied().unwrap_or_default();
    let looks =
        description.materials.iter().enumerate().map(|(index, material)| (look_of(index), &material.value));
    let textures: Vec<_> = looks
        .map(|(look, material)| MaterialTexture {
            colour: look.colour.map(texture),
            bump: look.bump.map(|(index, height)| Bump { texture: texture(index), height }),
            layers: textured::layers_of(material),
        })
        .collect();
    if textures.iter().all(MaterialTexture::is_plain) { Vec::new() } else { textures }
}

/// A camera that sees the whole scene from above and in front.
fn framing(bounds: &Bounds3, aspect: f64, location: &Location) -> CameraDescription {
    const FOV: f64 = 35.0;
    let half = (0.5 * FOV).to_radians();
    // The sphere around the scene fills the shorter side of the picture.
    let narrower = if aspect < 1.0 { (half.tan() * aspect).atan() } else { half };
    let distance = (bounds.radius() / narrower.sin()).max(f64::MIN_POSITIVE);
    let from = DVec3::new(0.45, 0.35, 1.0).normalize_or_zero();
    CameraDescription {
        location: location.clone(),
        eye: bounds.center() + from * distance,
        at: bounds.center(),
        up: DVec3::Y,
        projection: ProjectionDescription::Perspective { fov: FOV, axis: super::FovAxis::Vertical },
        lens: None,
        mirrored: false,
    }
}
