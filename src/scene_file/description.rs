//! What a scene file says, before anything is built of it: plain data in `f64`, metres and watts, each part with
//! the place in the file it came from.

use super::generate::Generator;
use super::mesh::TriangleMesh;
use super::room::Choice;
use crate::bsdf::Bsdf;
use crate::film::PixelRect;
use crate::math::{Bounds3, Rgb};
use crate::media::{Coefficients, Phase};
use crate::scene::{IlluminationKernel, LayeredMaterial, Tangent};
use crate::settings::Overrides;
use crate::shapes::{Csg, TerrainNoise};
use crate::textures::{SolidTexture, VertexData};
use glam::{DAffine3, DMat3, DVec3};
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

/// Something with a name and a place.
#[derive(Clone, Debug)]
pub struct Named<T> {
    /// Name as the file gives it.
    pub name: String,
    /// Where it is defined.
    pub location: Location,
    /// The thing.
    pub value: T,
}

/// Something in a scene file that is legal but probably not meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneWarning {
    /// Where.
    pub location: Location,
    /// What, and what to do about it.
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
    /// Settings that the scene asks for; the command line goes over them.
    pub render: Overrides,
    /// Media by name; `air` (index of refraction 1, no absorption) always exists and comes first.
    pub media: Vec<Named<MediumDescription>>,
    /// Solid textures by name.
    pub textures: Vec<Named<SolidTexture>>,
    /// Materials by name.
    pub materials: Vec<Named<MaterialDescription>>,
    /// Textures of each material; may be shorter than `materials`.
    pub looks: Vec<MaterialLook>,
    /// Shapes, some of which emit, some of which belong to groups.
    pub shapes: Vec<Named<ShapeDescription>>,
    /// Groups that instances place; a group by itself is not in the picture.
    pub groups: Vec<Named<()>>,
    /// Placements of groups.
    pub instances: Vec<Named<InstanceDescription>>,
    /// Lights without a surface.
    pub lights: Vec<Named<LightDescription>>,
    /// By light: photons in proportion to other lights of the same flux.
    pub light_photons: Vec<f64>,
    /// What the reader noticed that is legal but probably not meant.
    pub warnings: Vec<SceneWarning>,
    /// What was guessed where the file says nothing, and how to have it otherwise.
    pub notes: Vec<SceneWarning>,
    /// Files beside the first one that were read for this description: they count for its hash.
    pub further_files: Vec<PathBuf>,
    /// Values that the file was read with and that are in nothing else here: they count for its hash.
    pub parameters: Vec<(String, String)>,
}

/// Which side of the picture a field of view spans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FovAxis {
    /// From the lower to the upper edge.
    Vertical,
    /// From the left to the right edge.
    Horizontal,
}

/// A camera with or without a lens.
#[derive(Clone, Debug)]
pub struct CameraDescription {
    /// Where it is defined.
    pub location: Location,
    /// Position, metres.
    pub eye: DVec3,
    /// Point in the middle of the picture, metres.
    pub at: DVec3,
    /// A direction that points up in the picture.
    pub up: DVec3,
    /// Full field of view along `fov_axis`, degrees, in `(0, 180)`.
    pub fov: f64,
    /// What `fov` spans. Kept as the file says it, since the command line may change the shape of the picture.
    pub fov_axis: FovAxis,
    /// The lens; none for a pinhole.
    pub lens: Option<LensDescription>,
    /// Whether left and right of the picture are exchanged.
    pub mirrored: bool,
}

impl CameraDescription {
    /// Full vertical field of view in degrees of a picture of `width` by `height` square pixels.
    pub fn vertical_fov(&self, width: u32, height: u32) -> f64 {
        match self.fov_axis {
            FovAxis::Vertical => self.fov,
            FovAxis::Horizontal => {
                let half_width = (0.5 * self.fov).to_radians().tan();
                (2.0 * (half_width * f64::from(height) / f64::from(width)).atan()).to_degrees()
            }
        }
    }
}

/// Which reconstruction filter weighs samples around a pixel's centre. Radii in pixels.
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

/// Picture size and development.
#[derive(Clone, Debug)]
pub struct FilmDescription {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Reconstruction filter.
    pub filter: FilterDescription,
    /// Exposure in stops for the PNG: radiance is multiplied by `2^exposure`; `None` where the picture itself decides.
    pub exposure: Option<f64>,
    /// Stops that are added to every exposure that is given, whoever gives it: what the scene takes for white.
    pub white: f64,
    /// The part of the picture that is rendered; `None` for all of it.
    pub crop: Option<PixelRect>,
}

/// What fills a body.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumDescription {
    /// Index of refraction, at least 1.
    pub ior: f64,
    /// Absorption coefficient per channel, 1/m.
    pub absorption: DVec3,
    /// What scatters, absorbs and emits light in it; the absorption above is then zero.
    pub volume: Option<VolumeDescription>,
    /// Where bodies overlap, the medium of the highest priority fills the place; of equals that of the smallest body.
    pub priority: i32,
}

/// What scatters light within a medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeDescription {
    /// Coefficients, per metre.
    pub coefficients: Coefficients,
    /// Phase function.
    pub phase: Phase,
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
    /// A material of glTF.
    Layered {
        /// Factors and textures.
        material: Arc<LayeredMaterial>,
        /// Indices into [`SceneDescription::media`] on the side away from the normal and on the side of the normal, where the
        /// material is the border between them.
        media: Option<[usize; 2]>,
    },
    /// Schlick's or Ward's model, or a metal.
    Glossy {
        /// The model.
        bsdf: Bsdf,
        /// As for Lambert.
        two_sided: bool,
        /// How an anisotropic model lies in the surface.
        tangent: Option<Tangent>,
    },
}

/// Textures of a material: indices into [`SceneDescription::textures`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialLook {
    /// Factor on the reflectance.
    pub colour: Option<usize>,
    /// What tilts the shading normal, and its height in metres.
    pub bump: Option<(usize, f64)>,
}

/// Light that a surface emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionDescription {
    /// Radiance, W/(m^2 sr), constant over surface and directions.
    pub radiance: DVec3,
    /// Whether both sides emit; otherwise only the side of the normal.
    pub two_sided: bool,
    /// Photons in proportion to other lights of the same flux.
    pub photons: f64,
}

/// An illumination map over a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IlluminationDescription {
    /// How photons are spread over its elements.
    pub kernel: IlluminationKernel,
    /// Elements over the whole shape; `None` to go by the light that it receives.
    pub elements: Option<u32>,
    /// Elements of caustic maps along each side of one of these; `None` to go by what the camera sees.
    pub refinement: Option<u32>,
}

/// A shape and what it is made of.
#[derive(Clone, Debug)]
pub struct ShapeDescription {
    /// Geometry in the shape's own space.
    pub geometry: GeometryDescription,
    /// From the shape's space to the world, or to the group's space (metres either way: the file's unit is part
    /// of it). A mirrored placement (negative determinant) does not swap sides: the normal is that of the shape's own
    /// space, carried along.
    pub transform: DAffine3,
    /// Turns the normal around: the side it points to swaps.
    pub flip_normal: bool,
    /// Index into [`SceneDescription::materials`].
    pub material: usize,
    /// Caustic photons in the directions of this shape, in proportion to other shapes of the same material.
    pub caustic_photons: f64,
    /// Whether photons are summed up in an illumination map.
    pub illumination: Option<IlluminationDescription>,
    /// Emission, if any.
    pub emission: Option<EmissionDescription>,
    /// Index into [`SceneDescription::groups`], or `None` for a shape that is in the picture as it is.
    pub group: Option<usize>,
}

/// Shading normals of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshNormals {
    /// Those of the file where it has them, flat otherwise.
    FromFile,
    /// Always flat.
    Flat,
    /// Computed: angle-weighted mean of the faces around a vertex.
    Smooth,
    /// Those of the file, which say which side of a triangle is its front, whatever the order of its corners; computed where the file
    /// has none.
    Leading,
}

impl MeshNormals {
    /// Whether those of the file are looked at.
    pub(super) fn are_read(self) -> bool {
        matches!(self, Self::FromFile | Self::Leading)
    }
}

/// Geometry in the shape's own space (metres once the transform, which includes the file's unit, is applied).
#[derive(Clone, Debug)]
pub enum GeometryDescription {
    /// Triangles from a PLY, OBJ or STL file, read when the scene is built.
    MeshFile {
        /// The file, already resolved against the scene file's folder.
        path: PathBuf,
        /// Shading normals.
        normals: MeshNormals,
        /// Whether faces have the materials of the file (an OBJ's MTL), where it has them.
        own_materials: bool,
        /// Placement of a mesh whose size is not known beforehand; comes before the shape's transform.
        fit: Option<FitDescription>,
    },
    /// Triangles given in the scene file.
    Mesh {
        /// Positions.
        positions: Vec<DVec3>,
        /// Indices of corners, counter-clockwise as seen from the side of the normal.
        triangles: Vec<[u32; 3]>,
        /// Shading normals.
        normals: MeshNormals,
    },
    /// Triangles that were read already.
    Loaded {
        /// The mesh.
        mesh: Arc<TriangleMesh>,
        /// Shading normals.
        normals: MeshNormals,
        /// What a fit made of it; comes before the shape's transform.
        before: DAffine3,
    },
    /// Triangles of a glTF file.
    Gltf {
        /// The mesh.
        mesh: Arc<TriangleMesh>,
        /// What textures need at its vertices.
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
    /// Closed bodies combined, or one alone.
    Csg {
        /// The object.
        object: Csg,
        /// Material of each of its parts, where it differs from that of the shape.
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
        /// What makes the heights.
        noise: TerrainNoise,
        /// Two triangles for each cell, smoothly shaded, instead of the bilinear surface itself.
        triangles: bool,
    },
}

/// The axis of a mesh's own space that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// As everywhere in this renderer.
    Y,
    /// As in many modelling and all survey programs.
    Z,
}

/// The point of a mesh's bounding box that a fit puts in place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitAnchor {
    /// The middle of the box.
    Center,
    /// The middle of its lowest face, to stand something on the ground.
    Bottom,
}

/// What a fit moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitMoves {
    /// The shape, to where the fit says.
    Shape,
    /// Everything else, camera and lights too, the other way: the shape keeps the lengths and the place of its file.
    Scene {
        /// Whether the shape is a room: shown from within, without the other shapes and lights.
        room: Choice,
    },
}

/// Turns, moves and scales a mesh, the same in all axes, by its bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitDescription {
    /// Longest side of the bounding box afterwards, in the shape's space.
    pub size: f64,
    /// Which point goes to `at`.
    pub anchor: FitAnchor,
    /// Where it goes, in the shape's space.
    pub at: DVec3,
    /// Up in the mesh's file; turned to y.
    pub up: UpAxis,
    /// What is moved.
    pub moves: FitMoves,
}

impl FitDescription {
    /// What the mesh itself goes through: [`Self::transform`], or nothing where that moves the scene.
    pub(super) fn of_shape(&self, bounds: &Bounds3) -> Option<DAffine3> {
        match self.moves {
            FitMoves::Shape => self.transform(bounds),
            FitMoves::Scene { .. } => Some(DAffine3::IDENTITY),
        }
    }

    /// The map from the mesh's own space to the shape's space, for a mesh with these bounds (of the vertices that
    /// triangles use). `None` where the bounds have no extent that could be scaled: empty, a single point or
    /// not finite.
    pub fn transform(&self, bounds: &Bounds3) -> Option<DAffine3> {
        let turn = match self.up {
            UpAxis::Y => DMat3::IDENTITY,
            // z to y and y to -z: a quarter turn about x, exact.
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
    /// The same radiance from every direction outside the scene.
    Environment {
        /// Radiance, W/(m^2 sr).
        radiance: DVec3,
    },
    /// A picture of what is outside the scene, in longitude and latitude.
    EnvironmentMap {
        /// The picture.
        image: PathBuf,
        /// Counter-clockwise as seen from above, radians.
        turn: f64,
        /// Axes of unit length at right angles, perhaps mirrored, that x, y and z of the turned picture become; `None` where it
        /// stands upright.
        axes: Option<DMat3>,
        /// W/(m^2 sr) for one of the picture.
        factor: DVec3,
    },
    /// Clear sky, and the sun in it.
    Sky {
        /// Of the sun above the horizon, radians, in `[0, pi/2]`.
        elevation: f64,
        /// Of the sun, from -z to +x, radians.
        azimuth: f64,
        /// In `[1, 10]`.
        turbidity: f64,
        /// Reflectance of the plain under the sky, in `[0, 1]`.
        albedo: DVec3,
        /// W/(m^2 sr) for one of the model, which is 683 cd/m^2.
        factor: DVec3,
        /// Whether the sun's disc shines.
        sun: bool,
        /// Axes that x, y (the zenith) and z of the sky become, as for a picture.
        axes: Option<DMat3>,
    },
    /// A cone of light from a point.
    Spot {
        /// Position, metres.
        position: DVec3,
        /// Direction of the middle, any length.
        direction: DVec3,
        /// Radiant intensity in the middle, W/sr.
        intensity: DVec3,
        /// Angle to the middle up to which the intensity is that, radians.
        inner: f64,
        /// Angle from which on there is none, radians, at least `inner`.
        outer: f64,
    },
    /// Light from a point with a measured distribution.
    Profile {
        /// The photometric file.
        file: PathBuf,
        /// Position, metres.
        position: DVec3,
        /// Direction of the file's nadir, any length.
        direction: DVec3,
        /// Direction of the file's azimuth 0, not parallel to `direction`.
        along: DVec3,
        /// How bright.
        brightness: ProfileBrightness,
    },
}

/// How bright a light with a measured distribution is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProfileBrightness {
    /// W/sr for each candela of the file.
    PerCandela(DVec3),
    /// Power in all, W.
    Power(DVec3),
}

/// A lens that is not a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensDescription {
    /// Radius, metres.
    pub radius: f64,
    /// Distance of the plane that is sharp from the eye, along the view, metres.
    pub focus: f64,
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

    #[test]
    fn horizontal_field_of_view_follows_the_picture() {
        let camera = CameraDescription {
            location: Location::default(),
            eye: DVec3::Z,
            at: DVec3::ZERO,
            up: DVec3::Y,
            fov: 90.0,
            fov_axis: FovAxis::Horizontal,
            lens: None,
            mirrored: false,
        };
        assert!((camera.vertical_fov(100, 100) - 90.0).abs() < 1e-12);
        assert!((camera.vertical_fov(200, 100) - 2.0 * 0.5f64.atan().to_degrees()).abs() < 1e-12);
    }
}
