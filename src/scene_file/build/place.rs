//! From a described shape to geometry in its target space, which is render space or the space of a group.

use super::BuildProblem;
use crate::embree::{Procedural, TriangleBuffers};
use crate::math::{Bounds3, unit_f64};
use crate::scene::{Geometry, Mesh};
use crate::scene_file::description::MeshNormals;
use crate::scene_file::mesh::{MeshReport, Positions, TriangleMesh};
use crate::scene_file::{GeometryDescription, MeshReading, generate, read_mesh_file_with};
use crate::shapes::{
    Chart, Csg, Cylinder, Disc, EmitterShape, HeightGrid, Quad, Sphere, SphereFlake, Terrain, Triangle,
};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A shape whose file is read, ready to be placed. Lengths as in the description.
#[derive(Debug)]
pub(super) enum Source {
    /// A mesh with the bounds of the vertices that its triangles use.
    Mesh(TriangleMesh, Bounds3),
    Quad {
        corner: DVec3,
        edge_u: DVec3,
        edge_v: DVec3,
    },
    Sphere {
        center: DVec3,
        radius: f64,
    },
    Cylinder {
        base: DVec3,
        top: DVec3,
        radius: f64,
    },
    Disc {
        center: DVec3,
        normal: DVec3,
        radius: f64,
    },
    Csg(Csg),
    SphereFlake {
        center: DVec3,
        radius: f64,
        frame: DMat3,
        depth: u32,
    },
    /// A terrain with the transform from the grid's own space.
    Terrain {
        grid: Arc<HeightGrid>,
        transform: DAffine3,
    },
}

/// A shape in its target space.
#[derive(Debug)]
pub(super) struct Placed {
    pub geometry: Geometry,
    /// Bounds in the target space.
    pub bounds: Bounds3,
    /// A bounding sphere, tight where the shape is round.
    pub sphere: (DVec3, f64),
    /// Whether the surface's normal is opposite to the geometry's own.
    pub flip: bool,
    /// The shapes that light sampling uses, by primitive; only for emitters.
    pub emitter: Vec<EmitterShape>,
    /// Number of an emitter's triangles that lost their area to rounding: neither lights nor surfaces.
    pub lost: usize,
}

impl Source {
    /// Reads the files of a shape. Also returns the transform of a fit, to be applied first.
    pub(super) fn read(
        description: &GeometryDescription,
        progress: &(dyn Fn(u64, u64) -> bool + Sync),
    ) -> Result<(Self, DAffine3, MeshReport), BuildProblem> {
        let mut before = DAffine3::IDENTITY;
        let mut report = MeshReport::default();
        let source = match description {
            GeometryDescription::MeshFile { path, normals, fit, .. } => {
                // Surfaces do not use texture coordinates.
                let reading =
                    MeshReading { normals: normals.are_read(), uvs: false, colours: false, progress };
                let (mut mesh, found) = read_mesh_file_with(path, &reading)?;
                report = found;
                choose_normals(&mut mesh, *normals);
                let source = Self::mesh(mesh);
                if let (Some(_), Some(cloud)) = (fit, report.cloud) {
                    return Err(BuildProblem::Cloud(path.clone(), cloud));
                }
                if let (Some(fit), Self::Mesh(_, bounds)) = (fit, &source) {
                    before = fit.of_shape(bounds).ok_or_else(|| BuildProblem::Fit(path.clone()))?;
                }
                source
            }
            GeometryDescription::Loaded { mesh, normals, before: fitted } => {
                let mut mesh = TriangleMesh::clone(mesh);
                choose_normals(&mut mesh, *normals);
                before = *fitted;
                Self::mesh(mesh)
            }
            GeometryDescription::Gltf { mesh, .. } => Self::mesh(TriangleMesh::clone(mesh)),
            GeometryDescription::Mesh { positions, triangles, normals, .. } => {
                let positions = Positions::Double(positions.iter().map(DVec3::to_array).collect());
                let mut mesh =
                    TriangleMesh { positions, triangles: triangles.clone(), normals: None, uvs: None };
                choose_normals(&mut mesh, *normals);
                Self::mesh(mesh)
            }
            GeometryDescription::Generated(generator) => Self::mesh(generator.mesh()),
            &GeometryDescription::Quad { corner, edge_u, edge_v } => Self::Quad { corner, edge_u, edge_v },
            &GeometryDescription::Sphere { center, radius } => Self::Sphere { center, radius },
            &GeometryDescription::Cylinder { base, top, radius } => Self::Cylinder { base, top, radius },
            &GeometryDescription::Disc { center, normal, radius } => Self::Disc { center, normal, radius },
            GeometryDescription::Csg { object, .. } => Self::Csg(object.clone()),
            &GeometryDescription::SphereFlake { center, radius, axis, depth } => {
                let axis = unit_f64(axis).unwrap_or(DVec3::Y);
                let (x, y) = axis.any_orthonormal_pair();
                Self::SphereFlake { center, radius, frame: DMat3::from_cols(x, y, axis), depth }
            }
            &GeometryDescription::Terrain { center, size, cells, ref noise, triangles } => {
                let grid = Arc::new(HeightGrid::from_noise(cells, noise)?);
                let scale = size / DVec3::new(f64::from(cells), 1.0, f64::from(cells));
                let corner = center - 0.5 * size.with_y(0.0);
                let transform = DAffine3::from_translation(corner) * DAffine3::from_scale(scale);
                if triangles {
                    Self::mesh(generate::mesh_of_heights(&grid, &transform))
                } else {
                    Self::Terrain { grid, transform }
                }
            }
        };
        Ok((source, before, report))
    }

    pub(super) fn mesh(mesh: TriangleMesh) -> Self {
        let bounds = mesh.bounds();
        Self::Mesh(mesh, bounds)
    }

    /// Takes the mesh out of the source, which is empty afterwards: for a mesh that is placed once.
    pub(super) fn take_mesh(&mut self) -> Option<(TriangleMesh, Bounds3)> {
        let empty = || TriangleMesh {
            positions: Positions::Single(Vec::new()),
            triangles: Vec::new(),
            normals: None,
            uvs: None,
        };
        match self {
            Self::Mesh(mesh, bounds) => {
                Some((std::mem::replace(mesh, empty()), std::mem::replace(bounds, Bounds3::EMPTY)))
            }
            _ => None,
        }
    }

    /// Bounds of the shape under `transform`.
    pub(super) fn bounds(&self, transform: &DAffine3) -> Bounds3 {
        match self {
            // Rounding is monotone, so the corners of the transformed box are the extremes, to the bit.
            Self::Mesh(_, bounds) if keeps_axes(transform) => bounds.transformed(transform),
            Self::Mesh(mesh, _) => mesh
                .triangles
                .par_iter()
                .map(|&triangle| {
                    let corners = mesh.positions.corners(triangle);
                    Bounds3::of_points(corners.map(|corner| transform.transform_point3(corner)))
                })
                .reduce(|| Bounds3::EMPTY, Bounds3::union),
            Self::Quad { corner, edge_u, edge_v } => {
                let corners = [*corner, corner + edge_u, corner + edge_v, corner + edge_u + edge_v];
                Bounds3::of_points(corners.map(|corner| transform.transform_point3(corner)))
            }
            Self::Sphere { center, radius } => {
                let center = transform.transform_point3(*center);
                // Half extents of an ellipsoid: the lengths of its matrix's rows.
                let rows = transform.matrix3.transpose();
                let extent = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
                let extent = extent * *radius;
                Bounds3 { min: center - extent, max: center + extent }
            }
            Self::Cylinder { base, top, radius } => {
                let reach = Bounds3 { min: DVec3::splat(-*radius), max: DVec3::splat(*radius) };
                let end = |center: &DVec3| Bounds3 { min: center + reach.min, max: center + reach.max };
                end(base).union(end(top)).transformed(transform)
            }
            Self::Disc { center, radius, .. } => {
                Bounds3 { min: center - *radius, max: center + *radius }.transformed(transform)
            }
            Self::Csg(object) => {
                object.transformed(transform).map_or(Bounds3::EMPTY, |object| object.bounds())
            }
            Self::SphereFlake { center, radius, frame, depth } => {
                let flake = SphereFlake::with_frame(*center, *radius, *frame, *depth);
                let around = flake.map_or((*center, 0.0), |flake| flake.bounding_sphere());
                Self::Sphere { center: around.0, radius: around.1 }.bounds(transform)
            }
            Self::Terrain { grid, transform: own } => {
                let cells = f64::from(grid.cells());
                let [low, high] = grid.range().map(f64::from);
                let own_box = Bounds3 { min: DVec3::new(0.0, low, 0.0), max: DVec3::new(cells, high, cells) };
                own_box.transformed(&(*transform * *own))
            }
        }
    }

    /// Charts of the shape under `transform`, a similarity; `None` for shapes without charts.
    pub(super) fn charts(&self, transform: &DAffine3) -> Result<Option<Vec<Chart>>, BuildProblem> {
        let point = |p: &DVec3| transform.transform_point3(*p);
        let vector = |v: &DVec3| transform.transform_vector3(*v);
        let scale = || similarity(transform).ok_or(BuildProblem::NotSimilar);
        let chart = match self {
            Self::Quad { corner, edge_u, edge_v } => {
                Chart::parallelogram(point(corner), vector(edge_u), vector(edge_v))
            }
            Self::Sphere { center, radius } => Chart::sphere(point(center), radius * scale()?),
            Self::Cylinder { base, top, radius } => {
                Chart::cylinder(point(base), point(top), radius * scale()?)
            }
            Self::Disc { center, normal, radius } => {
                Chart::disc(point(center), vector(normal), radius * scale()?)
            }
            Self::Csg(object) => return Ok(object.transformed(transform)?.charts()),
            Self::Mesh(..) | Self::SphereFlake { .. } | Self::Terrain { .. } => return Ok(None),
        };
        Ok(Some(vec![chart?]))
    }

    /// Whether `transform` turns the shape into one that has no exact intersection here, such as a sphere into an ellipsoid. Such
    /// shapes become instances.
    pub(super) fn needs_instance(&self, transform: &DAffine3) -> bool {
        match self {
            // The last two have spaces of their own, into which they transform rays in `f64`.
            Self::Mesh(..) | Self::Quad { .. } | Self::Csg(_) | Self::Terrain { .. } => false,
            Self::Sphere { .. } | Self::Cylinder { .. } | Self::Disc { .. } | Self::SphereFlake { .. } => {
                similarity(transform).is_none()
            }
        }
    }

    /// The shape under `transform`. `emits`: with the data for light sampling.
    pub(super) fn place(&self, transform: &DAffine3, emits: bool) -> Result<Placed, BuildProblem> {
        match self {
            Self::Mesh(mesh, bounds) => place_mesh(mesh.clone(), bounds, transform, emits),
            Self::Quad { corner, edge_u, edge_v } => {
                let corner = transform.transform_point3(*corner);
                let edge_u = transform.transform_vector3(*edge_u);
                let edge_v = transform.transform_vector3(*edge_v);
                place_quad(corner, edge_u, edge_v, is_mirrored(transform), emits)
            }
            Self::Sphere { center, radius } => {
                let scale = similarity(transform).ok_or(BuildProblem::NotSimilar)?;
                let sphere = Sphere::new(transform.transform_point3(*center), radius * scale)?;
                let around = (sphere.center(), sphere.radius());
                Ok(exact(sphere, around, emits.then_some(EmitterShape::Sphere(sphere))))
            }
            Self::Cylinder { base, top, radius } => {
                let scale = similarity(transform).ok_or(BuildProblem::NotSimilar)?;
                let (base, top) = (transform.transform_point3(*base), transform.transform_point3(*top));
                let cylinder = Cylinder::new(base, top, radius * scale)?;
                let around = (0.5 * (base + top), (radius * scale).hypot(0.5 * (top - base).length()));
                Ok(exact(cylinder, around, emits.then_some(EmitterShape::Cylinder(cylinder))))
            }
            Self::Disc { center, normal, radius } => {
                let scale = similarity(transform).ok_or(BuildProblem::NotSimilar)?;
                let center = transform.transform_point3(*center);
                // Under a similarity normals turn like vectors, mirrored or not.
                let disc = Disc::new(center, transform.transform_vector3(*normal), radius * scale)?;
                Ok(exact(disc, (center, radius * scale), emits.then_some(EmitterShape::Disc(disc))))
            }
            Self::Csg(object) => {
                let object = object.transformed(transform)?;
                let around = object.around();
                Ok(exact(object, around, None))
            }
            Self::SphereFlake { center, radius, frame, depth } => {
                let scale = similarity(transform).ok_or(BuildProblem::NotSimilar)?;
                let center = transform.transform_point3(*center);
                let turned = transform.matrix3 * (1.0 / scale) * *frame;
                let flake = SphereFlake::with_frame(center, radius * scale, turned, *depth)?;
                let around = flake.bounding_sphere();
                Ok(exact(flake, around, None))
            }
            Self::Terrain { grid, transform: own } => {
                let terrain = Terrain::new(Arc::clone(grid), *transform * *own)?;
                let bounds = terrain.bounds();
                Ok(exact(terrain, (bounds.center(), bounds.radius()), None))
            }
        }
    }
}

fn exact<P: Procedural + 'static>(shape: P, sphere: (DVec3, f64), emitter: Option<EmitterShape>) -> Placed {
    let bounds = (0..shape.primitive_count()).fold(Bounds3::EMPTY, |all, part| all.union(shape.bounds(part)));
    Placed {
        geometry: Geometry::Procedural(Arc::new(shape)),
        bounds,
        sphere,
        flip: false,
        lost: 0,
        emitter: emitter.into_iter().collect(),
    }
}

/// The common scale factor, where `transform` is a similarity.
pub(super) fn similarity(transform: &DAffine3) -> Option<f64> {
    /// Differences of angles and lengths below this are rounding.
    const TOLERANCE: f64 = 1e-9;
    let [x, y, z] = [transform.matrix3.x_axis, transform.matrix3.y_axis, transform.matrix3.z_axis];
    let (a, b, c) = (x.length(), y.length(), z.length());
    let largest = a.max(b).max(c);
    let same = (a - b).abs().max((b - c).abs()) <= TOLERANCE * largest;
    let (xy, yz, zx) = (x.dot(y).abs(), y.dot(z).abs(), z.dot(x).abs());
    (same && xy.max(yz).max(zx) <= TOLERANCE * largest * largest).then_some(a)
}

/// Whether `transform` maps each axis to an axis, with a scale and a translation and nothing more.
fn keeps_axes(transform: &DAffine3) -> bool {
    let columns = transform.matrix3.to_cols_array_2d();
    let is_one = |count: usize| count == 1;
    (0..3).all(|i| {
        is_one(columns[i].iter().filter(|x| **x != 0.0).count())
            && is_one(columns.iter().filter(|column| column[i] != 0.0).count())
    })
}

fn is_mirrored(transform: &DAffine3) -> bool {
    transform.matrix3.determinant() < 0.0
}

pub(super) fn choose_normals(mesh: &mut TriangleMesh, normals: MeshNormals) {
    match normals {
        MeshNormals::FromFile => {}
        MeshNormals::Flat => mesh.normals = None,
        MeshNormals::Smooth => mesh.normals = Some(mesh.smooth_normals()),
        MeshNormals::Leading => mesh.follow_normals(),
    }
}

/// `mesh` under `transform`, transformed in place. `own` is the bounding box of the vertices that its triangles use.
pub(super) fn place_mesh(
    mesh: TriangleMesh,
    own: &Bounds3,
    transform: &DAffine3,
    emits: bool,
) -> Result<Placed, BuildProblem> {
    let TriangleMesh { positions, mut triangles, normals, .. } = mesh;
    let place = |vertex: DVec3| transform.transform_point3(vertex).as_vec3().to_array();
    let positions: Vec<[f32; 3]> = match positions {
        Positions::Single(mut positions) => {
            positions.par_iter_mut().for_each(|p| *p = place(Vec3::from_array(*p).as_dvec3()));
            positions
        }
        Positions::Double(positions) => positions.par_iter().map(|&p| place(DVec3::from_array(p))).collect(),
    };
    if is_mirrored(transform) {
        triangles.par_iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    let corners =
        |triangle: &[u32; 3]| triangle.map(|vertex| Vec3::from_array(positions[vertex as usize]).as_dvec3());
    let mut emitter = Vec::new();
    let whole = triangles.len();
    if emits {
        // Each primitive of an emitter is sampled, so triangles that lost their area to rounding have to go.
        triangles.retain(|triangle| {
            let [a, b, c] = corners(triangle);
            Triangle::new(a, b, c).map(|piece| emitter.push(EmitterShape::Triangle(piece))).is_ok()
        });
    }
    let lost = whole - triangles.len();
    if emits && lost > 0 && triangles.is_empty() {
        return Err(BuildProblem::NoEmitter(lost));
    }
    let bounds = if lost == 0 && keeps_axes(transform) {
        // As in `Source::bounds`: rounding to single precision is monotone, too.
        let Bounds3 { min, max } = own.transformed(transform);
        Bounds3 { min: min.as_vec3().as_dvec3(), max: max.as_vec3().as_dvec3() }
    } else {
        triangles
            .par_iter()
            .map(|triangle| Bounds3::of_points(corners(triangle)))
            .reduce(|| Bounds3::EMPTY, Bounds3::union)
    };
    let center = bounds.center();
    // Over all vertices in the box, which are fewer than corners. Vertices that no triangle uses are outside the box or do no
    // harm.
    let farthest = positions
        .par_iter()
        .with_min_len(1 << 14)
        .map(|&position| {
            let position = Vec3::from_array(position).as_dvec3();
            let is_inside = position.cmpge(bounds.min).all() && position.cmple(bounds.max).all();
            if is_inside { (position - center).length_squared() } else { 0.0 }
        })
        .reduce(|| 0.0, f64::max);
    // The square root is monotone, so this is the largest length.
    let radius = farthest.sqrt();
    let normal_matrix = transform.matrix3.inverse().transpose();
    let turn = |normal: &Vec3| {
        unit_f64(normal_matrix * normal.as_dvec3()).map_or(Vec3::ZERO, |normal| normal.as_vec3())
    };
    let normals = normals.map(|mut normals| {
        normals.par_iter_mut().for_each(|normal| *normal = turn(normal));
        Arc::new(normals)
    });
    let buffers = TriangleBuffers::new(positions, triangles)?;
    Ok(Placed {
        geometry: Geometry::Mesh(Mesh { buffers, normals, data: None }),
        bounds,
        sphere: (center, radius),
        flip: false,
        lost,
        emitter,
    })
}

fn place_quad(
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    mirrored: bool,
    emits: bool,
) -> Result<Placed, BuildProblem> {
    // A mirrored quad keeps its side, so the edges swap.
    let (edge_u, edge_v) = if mirrored { (edge_v, edge_u) } else { (edge_u, edge_v) };
    let corners = [corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v];
    let positions = corners.iter().map(|corner| corner.as_vec3().to_array()).collect();
    let buffers = TriangleBuffers::new(positions, vec![[0, 1, 2], [0, 2, 3]])?;
    let bounds = Bounds3::of_points(corners);
    let emitter =
        if emits { vec![EmitterShape::Quad(Quad::new(corner, edge_u, edge_v)?)] } else { Vec::new() };
    Ok(Placed {
        geometry: Geometry::Mesh(Mesh { buffers, normals: None, data: None }),
        bounds,
        sphere: (bounds.center(), bounds.radius()),
        flip: false,
        lost: 0,
        emitter,
    })
}
