//! What a scene file says, before anything is built of it: plain data in `f64`, metres and watts, each part with
//! the place in the file it came from.

use crate::math::Rgb;
use crate::render::Overrides;
use glam::{DAffine3, DVec3};
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
    /// Materials by name.
    pub materials: Vec<Named<MaterialDescription>>,
    /// Shapes, some of which emit, some of which belong to groups.
    pub shapes: Vec<Named<ShapeDescription>>,
    /// Groups that instances place; a group by itself is not in the picture.
    pub groups: Vec<Named<()>>,
    /// Placements of groups.
    pub instances: Vec<Named<InstanceDescription>>,
    /// Lights without a surface.
    pub lights: Vec<Named<LightDescription>>,
}

/// A pinhole camera.
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
    /// Full vertical field of view, degrees.
    pub vertical_fov: f64,
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
    /// Exposure in stops for the PNG: radiance is multiplied by `2^exposure`.
    pub exposure: f64,
}

/// A homogeneous medium.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumDescription {
    /// Index of refraction, at least 1.
    pub ior: f64,
    /// Absorption coefficient per channel, 1/m.
    pub absorption: DVec3,
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
    /// A smooth interface between two media.
    Dielectric {
        /// Index into [`SceneDescription::media`] on the side away from the normal.
        inside: usize,
        /// Index into [`SceneDescription::media`] on the side of the normal.
        outside: usize,
    },
}

/// Light that a surface emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionDescription {
    /// Radiance, W/(m^2 sr), constant over surface and directions.
    pub radiance: DVec3,
    /// Whether both sides emit; otherwise only the side of the normal.
    pub two_sided: bool,
}

/// A shape and what it is made of.
#[derive(Clone, Debug)]
pub struct ShapeDescription {
    /// Geometry in the shape's own space.
    pub geometry: GeometryDescription,
    /// From the shape's space to the world (metres).
    pub transform: DAffine3,
    /// Turns the normal around: the side it points to swaps.
    pub flip_normal: bool,
    /// Index into [`SceneDescription::materials`].
    pub material: usize,
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
}

/// Geometry in the shape's own space (metres once the transform, which includes the file's unit, is applied).
#[derive(Clone, Debug)]
pub enum GeometryDescription {
    /// Triangles from a PLY file, read when the scene is built.
    MeshFile {
        /// The file, already resolved against the scene file's folder.
        path: PathBuf,
        /// Shading normals.
        normals: MeshNormals,
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
}
