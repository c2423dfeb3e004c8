//! Contents of a scene file before anything is built from it: plain data in `f64`, metres and watts. Each part keeps its place in
//! the file.

pub use super::camera::{CameraDescription, FovAxis, LensDescription, ProjectionDescription};
use super::generate::Generator;
use super::mesh::TriangleMesh;
use super::room::Choice;
use crate::bsdf::Bsdf;
use crate::film::PixelRect;
use crate::lights::CieSkyKind;
use crate::math::{Bounds3, Rgb};
use crate::media::{Coefficients, Phase};
use crate::scene::{IlluminationKernel, LayeredMaterial, Tangent};
use crate::settings::Overrides;
use crate::shapes::{Csg, TerrainNoise};
use crate::spectra::Dispersion;
use crate::textures::{Octaves, SolidTexture, VertexData};
use glam::{DAffine3, DMat3, DVec3, Vec2};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// A place in a text file, for messages. Lines and columns count from 1; 0 means the file as a whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// The file.
    pub file: Arc<PathBuf>,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}", self.file.display()),
            line => write!(f, "{}:{line}:{}", self.file.display(), self.column),
        }
    }
}

/// An item with a name and a place in the file.
#[derive(Clone, Debug)]
pub struct Named<T> {
    /// Name as the file gives it.
    pub name: String,
    /// Where it is defined.
    pub location: Location,
    /// The item itself.
    pub value: T,
}

/// A warning: something in a scene file that is legal but probably unintended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneWarning {
    /// Where.
    pub location: Location,
    /// What is odd, and what to do about it.
    pub message: String,
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.location, self.message)
    }
}

/// A whole scene file. All lengths are metres; a file's own unit is applied while reading.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    /// Title for messages and metadata.
    pub name: String,
    /// The file.
    pub location: Location,
    /// The camera; one is framed around the scene where the file has none.
    pub camera: Option<CameraDescription>,
    /// Picture size, filter and exposure.
    pub film: FilmDescription,
    /// Settings that the scene file asks for; the command line overrides them.
    pub render: Overrides,
    /// Media by name; `air` (index of refraction 1, no absorption) always exists and comes first.
    pub media: Vec<Named<MediumDescription>>,
    /// Solid textures by name.
    pub textures: Vec<Named<SolidTexture>>,
    /// Materials by name.
    pub materials: Vec<Named<MaterialDescription>>,
    /// Textures of each material, in the order of `materials`; the list may be shorter than that one.
    pub looks: Vec<MaterialLook>,
    /// Shapes. Some emit light, and some belong to groups.
    pub shapes: Vec<Named<ShapeDescription>>,
    /// Groups that instances place; a group without an instance is not in the picture.
    pub groups: Vec<Named<()>>,
    /// Placements of groups.
    pub instances: Vec<Named<InstanceDescription>>,
    /// Lights without a surface.
    pub lights: Vec<Named<LightDescription>>,
    /// For each light: the factor on its share of the photons, relative to other lights of the same flux.
    pub light_photons: Vec<f64>,
    /// Warnings of the reader about what is legal but probably unintended.
    pub warnings: Vec<SceneWarning>,
    /// Values that were guessed because the file does not give them, and how to choose others.
    pub notes: Vec<SceneWarning>,
    /// Further files that were read for this description; the scene's hash covers them.
    pub further_files: Vec<PathBuf>,
    /// Parameter values that the file was read with and that appear nowhere else here; the scene's hash covers them.
    pub parameters: Vec<(String, String)>,
}

/// Reconstruction filter that weights the samples around a pixel's centre. Radii are in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterDescription {
    /// Constant over the square of half width `radius` (0.5: the pixel itself).
    Box {
        /// Half width.
        radius: f64,
    },
    /// A truncated Gaussian.
    Gaussian {
        /// Half width.
        radius: f64,
        /// Standard deviation.
        sigma: f64,
    },
    /// Linear falloff.
    Tent {
        /// Half width.
        radius: f64,
    },
    /// The cubic of Mitchell & Netravali (1988) with B = C = 1/3; has negative lobes.
    Mitchell {
        /// Half width.
        radius: f64,
    },
}

/// Picture size, filter and exposure.
#[derive(Clone, Debug)]
pub struct FilmDescription {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Reconstruction filter.
    pub filter: FilterDescription,
    /// Exposure of the PNG in stops: radiance is multiplied by `2^exposure`. `None`: chosen from the picture itself.
    pub exposure: Option<f64>,
    /// Stops added to every exposure that is given, in the scene file or on the command line: the level that the scene takes for
    /// white.
    pub white: f64,
    /// The part of the picture that is rendered; `None` for all of it.
    pub crop: Option<PixelRect>,
}

/// The medium that fills a body.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumDescription {
    /// Index of refraction, at least 1; at the d line where it depends on the wavelength.
    pub ior: f64,
    /// The index as a function of the wavelength; `None` where it is constant.
    pub dispersion: Option<Dispersion>,
    /// Absorption coefficient per channel, 1/m.
    pub absorption: DVec3,
    /// Volume that scatters, absorbs and emits light; `absorption` above is then zero.
    pub volume: Option<VolumeDescription>,
    /// Priority where bodies overlap: the medium of the highest priority fills the place, and among equal priorities that of the
    /// smallest body.
    pub priority: i32,
}

/// Coefficients, phase function and density of a participating medium.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeDescription {
    /// Coefficients where the density is one, per metre.
    pub coefficients: Coefficients,
    /// Phase function.
    pub phase: Phase,
    /// Density.
    pub density: DensityDescription,
    /// What it fills.
    pub fills: FillDescription,
}

impl VolumeDescription {
    /// One of even density, in the bodies that name it.
    pub fn even(coefficients: Coefficients, phase: Phase) -> Self {
        Self { coefficients, phase, density: DensityDescription::Even, fills: FillDescription::Bodies }
    }
}

/// What a medium fills.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FillDescription {
    /// The bodies that name it.
    Bodies,
    /// A box that is made around its density, besides.
    Bounds,
    /// A box that is made around the scene, besides.
    Scene {
        /// Factor on the size of the box around all shapes, the camera and lights with a position.
        grow: f64,
    },
}

/// Density of a medium as a function of the place.
#[derive(Clone, Debug, PartialEq)]
pub enum DensityDescription {
    /// One everywhere.
    Even,
    /// One up to a height, and falling exponentially above.
    Height {
        /// Direction of increasing height, any length.
        up: DVec3,
        /// Height up to which it is one, along `up` from the origin of the world, metres.
        base: f64,
        /// Height over which it falls to 1/e, metres.
        scale: f64,
    },
    /// Noise in a box.
    Noise(NoiseDescription),
    /// Voxels of an OpenVDB file.
    Vdb {
        /// The file, already resolved against the scene file's folder.
        file: PathBuf,
        /// Name of the grid; `None`: the one that is a density.
        grid: Option<String>,
        /// From the space of the file to the world, metres.
        transform: DAffine3,
        /// Temperatures at which what absorbs glows.
        fire: Option<FireDescription>,
    },
}

/// Emission of black bodies.
#[derive(Clone, Debug, PartialEq)]
pub struct FireDescription {
    /// Name of the grid of temperatures, in the same file as the density.
    pub grid: String,
    /// Kelvin for a value of one.
    pub kelvin: f64,
    /// Radiance for 683 cd/m^2, W/(m^2 sr).
    pub glow: f64,
}

/// A density made of noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseDescription {
    /// Octaves, in the space of the noise.
    pub octaves: Octaves,
    /// Whether absolute values are summed.
    pub is_turbulent: bool,
    /// Noise that is a density of zero, and of one.
    pub levels: (f64, f64),
    /// Box that it fills, in the space of the noise.
    pub bounds: Bounds3,
    /// Whether it fills the ellipsoid in the box.
    pub is_round: bool,
    /// Share of the way from the middle to the sides over which it fades.
    pub fade: f64,
    /// From the space of the noise to the world, metres.
    pub transform: DAffine3,
}

/// A surface model.
#[derive(Clone, Debug)]
pub enum MaterialDescription {
    /// Ideal diffuse reflection.
    Lambert {
        /// Hemispherical reflectance per channel, in `[0, 1]`.
        reflectance: Rgb,
        /// Whether the side away from the normal reflects as well; otherwise that side absorbs everything.
        two_sided: bool,
    },
    /// Ideal specular reflection.
    Mirror {
        /// Reflectance per channel, in `[0, 1]`.
        reflectance: Rgb,
        /// As for Lambert.
        two_sided: bool,
    },
    /// An interface between two media.
    Dielectric {
        /// Index into [`SceneDescription::media`] on the side away from the normal.
        inside: usize,
        /// Index into [`SceneDescription::media`] on the side of the normal.
        outside: usize,
        /// The alpha of GGX, in `[0, 1]`; zero for a smooth interface.
        roughness: f64,
    },
    /// A layered material of glTF.
    Layered {
        /// Factors and textures.
        material: Arc<LayeredMaterial>,
        /// Indices into [`SceneDescription::media`]: the side away from the normal, then the side of the normal. Set where the
        /// material is the interface between two media.
        media: Option<[usize; 2]>,
    },
    /// Schlick's or Ward's model, or a metal.
    Glossy {
        /// The model.
        bsdf: Bsdf,
        /// As for Lambert.
        two_sided: bool,
        /// Orientation of an anisotropic model in the surface.
        tangent: Option<Tangent>,
    },
}

/// Textures of a material: indices into [`SceneDescription::textures`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialLook {
    /// Texture that multiplies the reflectance.
    pub colour: Option<usize>,
    /// Bump map: the texture that tilts the shading normal, and its height in metres.
    pub bump: Option<(usize, f64)>,
}

/// How much light a surface emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Emitted {
    /// Radiance, W/(m^2 sr).
    Radiance(DVec3),
    /// Power of all of the shape, both sides together where both emit, W.
    Power(DVec3),
}

impl Emitted {
    /// Radiance, W/(m^2 sr), of a surface of this `area` on all `sides` that emit, m^2.
    pub fn radiance(self, area: f64) -> DVec3 {
        match self {
            Self::Radiance(radiance) => radiance,
            Self::Power(power) => power / (std::f64::consts::PI * area),
        }
    }

    /// The same multiplied by a factor.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        match self {
            Self::Radiance(radiance) => Self::Radiance(radiance * factor),
            Self::Power(power) => Self::Power(power * factor),
        }
    }
}

/// Light that a surface emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionDescription {
    /// How much; constant over surface and directions.
    pub emitted: Emitted,
    /// Whether both sides emit; otherwise only the side of the normal.
    pub two_sided: bool,
    /// Factor on the light's share of the photons, relative to other lights of the same flux.
    pub photons: f64,
}

/// An illumination map over a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IlluminationDescription {
    /// How photons are distributed over its elements.
    pub kernel: IlluminationKernel,
    /// Elements over the whole shape; `None`: chosen by the light that the shape receives.
    pub elements: Option<u32>,
    /// Elements of a caustic map along each side of one of these elements; `None`: chosen by what the camera sees.
    pub refinement: Option<u32>,
}

/// A shape with its material, emission and placement.
#[derive(Clone, Debug)]
pub struct ShapeDescription {
    /// Geometry in the shape's own space.
    pub geometry: GeometryDescription,
    /// Transform from the shape's space to the world, or to the group's space. Both are in metres: the file's unit is part of the
    /// transform. A mirrored placement (negative determinant) does not swap sides: the normal is that of the shape's own space,
    /// transformed with the shape.
    pub transform: DAffine3,
    /// Reverses the normal, which swaps the shape's sides.
    pub flip_normal: bool,
    /// Index into [`SceneDescription::materials`].
    pub material: usize,
    /// Factor on the share of caustic photons aimed at this shape, relative to other shapes of the same material.
    pub caustic_photons: f64,
    /// Illumination map in which photons are summed up, if any.
    pub illumination: Option<IlluminationDescription>,
    /// Emission, if any.
    pub emission: Option<EmissionDescription>,
    /// Displacement of a mesh, if any.
    pub displacement: Option<DisplacementDescription>,
    /// Index into [`SceneDescription::groups`]; `None` for a shape that stands in the picture by itself.
    pub group: Option<usize>,
}

/// Displacement of a mesh along its normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacementDescription {
    /// Index into [`SceneDescription::textures`].
    pub texture: usize,
    /// Displacement where the pattern is one, metres.
    pub height: f64,
    /// Largest length of edges of the tessellation, metres.
    pub edge: f64,
    /// Whether its triangles are shaded flat, and not by normals of the displaced surface.
    pub is_flat: bool,
}

/// Shading normals of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshNormals {
    /// Normals of the file; flat where it has none.
    FromFile,
    /// Always flat.
    Flat,
    /// Computed: the angle-weighted mean of the faces around a vertex.
    Smooth,
    /// Normals of the file, which also decide the front of a triangle, whatever the order of its corners; computed where the file
    /// has none.
    Leading,
}

impl MeshNormals {
    /// Whether the normals of the file are read.
    pub(super) fn are_read(self) -> bool {
        matches!(self, Self::FromFile | Self::Leading)
    }
}

/// Geometry in the shape's own space. Lengths are metres after the transform, which includes the file's unit.
#[derive(Clone, Debug)]
pub enum GeometryDescription {
    /// Triangles from a PLY, OBJ or STL file, read when the scene is built.
    MeshFile {
        /// The file, already resolved against the scene file's folder.
        path: PathBuf,
        /// Shading normals.
        normals: MeshNormals,
        /// Whether faces take their materials from the file (an OBJ's MTL), where it has them.
        own_materials: bool,
        /// Materials of the file that others take the place of: their names, and indices into [`SceneDescription::materials`].
        replaced: Vec<(String, usize)>,
        /// Placement of a mesh whose size is not known beforehand; applied before the shape's transform.
        fit: Option<FitDescription>,
    },
    /// Triangles listed in the scene file.
    Mesh {
        /// Positions.
        positions: Vec<DVec3>,
        /// Indices of corners, counter-clockwise as seen from the side of the normal.
        triangles: Vec<[u32; 3]>,
        /// Shading normals.
        normals: MeshNormals,
        /// Texture coordinates of the vertices, from the lower left corner of a picture.
        uvs: Option<Vec<Vec2>>,
    },
    /// A mesh that is already in memory.
    Loaded {
        /// The mesh.
        mesh: Arc<TriangleMesh>,
        /// Shading normals.
        normals: MeshNormals,
        /// Transform computed from a fit; applied before the shape's transform.
        before: DAffine3,
    },
    /// Triangles of a glTF file.
    Gltf {
        /// The mesh.
        mesh: Arc<TriangleMesh>,
        /// Vertex attributes that textures need.
        data: Arc<VertexData>,
    },
    /// Triangles made when the scene is built.
    Generated(Generator),
    /// A parallelogram `corner + s edge_u + t edge_v`; normal along `edge_u x edge_v`.
    Quad {
        /// Corner at `s = t = 0`.
        corner: DVec3,
        /// First edge.
        edge_u: DVec3,
        /// Second edge.
        edge_v: DVec3,
    },
    /// A sphere; normal outward.
    Sphere {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// The side of a circular cylinder, without caps; normal outward.
    Cylinder {
        /// Centre of one end.
        base: DVec3,
        /// Centre of the other end.
        top: DVec3,
        /// Radius.
        radius: f64,
    },
    /// A disc.
    Disc {
        /// Centre.
        center: DVec3,
        /// Normal, any length.
        normal: DVec3,
        /// Radius.
        radius: f64,
    },
    /// One closed body, or several combined by constructive solid geometry.
    Csg {
        /// The object.
        object: Csg,
        /// Material of each part, where it differs from that of the shape.
        materials: Vec<Option<usize>>,
    },
    /// A sphere flake.
    SphereFlake {
        /// Centre of the largest sphere.
        center: DVec3,
        /// Radius of the largest sphere.
        radius: f64,
        /// Points to its upper pole.
        axis: DVec3,
        /// Generations on top of the largest sphere.
        depth: u32,
    },
    /// A fractal landscape.
    Terrain {
        /// Middle of the base.
        center: DVec3,
        /// Extent along x, in height, and along z.
        size: DVec3,
        /// Cells along each side.
        cells: u32,
        /// Noise that defines the heights.
        noise: TerrainNoise,
        /// Whether each cell becomes two smoothly shaded triangles instead of a bilinear patch.
        triangles: bool,
    },
}

/// The axis of a mesh's own space that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// The convention of this renderer.
    Y,
    /// The convention of many modelling programs and of all survey programs.
    Z,
}

/// The point of a mesh's bounding box that a fit moves to its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitAnchor {
    /// The middle of the box.
    Center,
    /// The middle of its lowest face, to stand something on the ground.
    Bottom,
}

/// What a fit moves: the shape or the rest of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitMoves {
    /// The shape moves to its target.
    Shape,
    /// Everything else moves the opposite way, camera and lights included: the shape keeps the lengths and the place of its file.
    Scene {
        /// Whether the shape is a room. A room is shown from within, without the other shapes and lights.
        room: Choice,
    },
}

/// Rotates, moves and scales a mesh by its bounding box, with one scale for all axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitDescription {
    /// Longest side of the bounding box afterwards, in the shape's space.
    pub size: f64,
    /// The point that moves to `at`.
    pub anchor: FitAnchor,
    /// Target of the anchor, in the shape's space.
    pub at: DVec3,
    /// Up axis of the mesh's file; it is rotated to y.
    pub up: UpAxis,
    /// Whether the shape or the rest of the scene moves.
    pub moves: FitMoves,
}

impl FitDescription {
    /// Transform of the mesh itself: [`Self::transform`], or the identity where the fit moves the scene instead.
    pub(super) fn of_shape(&self, bounds: &Bounds3) -> Option<DAffine3> {
        match self.moves {
            FitMoves::Shape => self.transform(bounds),
            FitMoves::Scene { .. } => Some(DAffine3::IDENTITY),
        }
    }

    /// Transform from the mesh's own space to the shape's space, for a mesh with these bounds (of the vertices that triangles
    /// use). `None` where the bounds have no extent to scale: they are empty, a single point or not finite.
    pub fn transform(&self, bounds: &Bounds3) -> Option<DAffine3> {
        let turn = match self.up {
            UpAxis::Y => DMat3::IDENTITY,
            // z to y and y to -z: an exact quarter turn about x.
            UpAxis::Z => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        };
        let turned = bounds.transformed(&DAffine3::from_mat3(turn));
        let extent = (turned.max - turned.min).max_element();
        let scale = self.size / extent;
        if turned.is_empty() || !(extent > 0.0 && extent.is_finite() && scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let center = turned.center();
        let anchor = match self.anchor {
            FitAnchor::Center => center,
            FitAnchor::Bottom => DVec3::new(center.x, turned.min.y, center.z),
        };
        Some(DAffine3::from_mat3_translation(turn * scale, self.at - scale * anchor))
    }
}

/// A placement of a group.
#[derive(Clone, Debug)]
pub struct InstanceDescription {
    /// Index into [`SceneDescription::groups`].
    pub group: usize,
    /// From the group's space to the world (metres).
    pub transform: DAffine3,
}

/// A light without a surface.
#[derive(Clone, Debug)]
pub enum LightDescription {
    /// Equal intensity in all directions.
    Point {
        /// Position, metres.
        position: DVec3,
        /// Radiant intensity, W/sr.
        intensity: DVec3,
    },
    /// Parallel light.
    Directional {
        /// Direction in which the light travels, any length.
        direction: DVec3,
        /// Irradiance of a surface perpendicular to the light, W/m^2.
        irradiance: DVec3,
    },
    /// Light from a distant disc, as from the sun: parallel but for the small angle of the disc.
    Sun {
        /// Direction in which the light of the disc's centre travels, any length.
        direction: DVec3,
        /// Irradiance of a surface perpendicular to it, W/m^2.
        irradiance: DVec3,
        /// Angular radius of the disc, radians, in `(0, pi/2]`.
        radius: f64,
    },
    /// The same radiance from every direction outside the scene.
    Environment {
        /// Radiance, W/(m^2 sr).
        radiance: DVec3,
    },
    /// An image of the radiance from outside the scene.
    EnvironmentMap {
        /// The picture.
        image: PathBuf,
        /// How directions lie in it.
        layout: EnvironmentLayout,
        /// Rotation about the vertical axis, counter-clockwise as seen from above, radians.
        turn: f64,
        /// Orthonormal axes, possibly mirrored, to which x, y and z of the rotated picture are mapped; `None` where the picture
        /// stands upright.
        axes: Option<DMat3>,
        /// Radiance for a picture value of one, W/(m^2 sr).
        factor: DVec3,
    },
    /// A clear sky with the sun.
    Sky {
        /// Elevation of the sun above the horizon, radians, in `[0, pi/2]`.
        elevation: f64,
        /// Azimuth of the sun, from -z to +x, radians.
        azimuth: f64,
        /// Turbidity, in `[1, 10]`.
        turbidity: f64,
        /// Reflectance of the ground plane under the sky, in `[0, 1]`.
        albedo: DVec3,
        /// Radiance for a model value of one, which is 683 cd/m^2; W/(m^2 sr).
        factor: DVec3,
        /// Whether the sun's disc emits light.
        sun: bool,
        /// Axes to which x, y (the zenith) and z of the sky are mapped, as for an environment map.
        axes: Option<DMat3>,
    },
    /// A sky of the CIE, with or without its sun.
    CieSky {
        /// Which one.
        kind: CieSkyKind,
        /// Elevation of the sun above the horizon, radians, in `[0, pi/2]`.
        elevation: f64,
        /// Azimuth of the sun, from -z to +x, radians.
        azimuth: f64,
        /// Irradiance of the sky alone on level ground, W/m^2.
        irradiance: DVec3,
        /// Irradiance of the sun alone on a surface that faces it, W/m^2; none where it does not shine.
        sun: Option<DVec3>,
        /// Reflectance of the ground plane under the sky, in `[0, 1]`.
        albedo: DVec3,
        /// Factor on all of it.
        factor: DVec3,
    },
    /// A spot light: a cone of light from a point.
    Spot {
        /// Position, metres.
        position: DVec3,
        /// Direction of the cone's axis, any length.
        direction: DVec3,
        /// Radiant intensity on the axis, W/sr.
        intensity: DVec3,
        /// Angle from the axis up to which the intensity is constant, radians.
        inner: f64,
        /// Angle from the axis beyond which the intensity is zero, radians, at least `inner`.
        outer: f64,
    },
    /// A point light with a measured intensity distribution.
    Profile {
        /// The file.
        file: PathBuf,
        /// What kind of file it is.
        layout: ProfileLayout,
        /// Position, metres.
        position: DVec3,
        /// Direction of the file's nadir, any length.
        direction: DVec3,
        /// Direction of the file's azimuth 0, not parallel to `direction`.
        along: DVec3,
        /// Brightness of the light.
        brightness: ProfileBrightness,
    },
}

/// How directions lie in an image of all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnvironmentLayout {
    /// Longitude and latitude, from +y down.
    LatitudeLongitude,
    /// An octahedron whose faces have the area of their directions (Clarberg 2008), with +z in the middle of the square.
    EqualArea,
}

/// The kind of file that holds the intensity for each direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileLayout {
    /// Text of IES LM-63.
    Photometric,
    /// An image as of [`EnvironmentLayout::EqualArea`], with its middle at the light's direction.
    EqualArea {
        /// Whether azimuths run the other way around.
        is_mirrored: bool,
    },
}

/// Brightness of a light with a measured distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProfileBrightness {
    /// Radiant intensity per candela of the file, W/sr.
    PerCandela(DVec3),
    /// Total power, W.
    Power(DVec3),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_stands_a_z_up_mesh_on_the_ground() {
        let bounds = Bounds3 { min: DVec3::new(10.0, 20.0, 30.0), max: DVec3::new(11.0, 22.0, 34.0) };
        let fit = FitDescription {
            size: 1.0,
            anchor: FitAnchor::Bottom,
            at: DVec3::X,
            up: UpAxis::Z,
            moves: FitMoves::Shape,
        };
        let placed = bounds.transformed(&fit.transform(&bounds).unwrap());
        assert!((placed.min - DVec3::new(0.875, 0.0, -0.25)).length() < 1e-14, "{placed:?}");
        assert!((placed.max - DVec3::new(1.125, 1.0, 0.25)).length() < 1e-14, "{placed:?}");
    }

    #[test]
    fn fit_refuses_what_has_no_size() {
        let fit = FitDescription {
            size: 1.0,
            anchor: FitAnchor::Center,
            at: DVec3::ZERO,
            up: UpAxis::Y,
            moves: FitMoves::Shape,
        };
        assert!(fit.transform(&Bounds3::EMPTY).is_none());
        assert!(fit.transform(&Bounds3 { min: DVec3::ONE, max: DVec3::ONE }).is_none());
        assert!(fit.transform(&Bounds3 { min: DVec3::ZERO, max: DVec3::INFINITY }).is_none());
    }
}
