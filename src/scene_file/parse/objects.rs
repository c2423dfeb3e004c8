//! Shapes of `[[shapes]]` that are closed bodies, constructive solid geometry, or procedures.

use super::names::Names;
use super::shapes::{read_point, read_radius};
use super::transform::transform_of;
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, NUMBER, POSITIVE, Table, Value};
use crate::shapes::{Csg, CsgOperation, HeightGrid, ShapeError, Solid, SphereFlake, TerrainNoise};
use glam::DVec3;

/// Closed bodies, alone or as operands.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Body {
    Sphere,
    Box,
    Cylinder,
    Cone,
    Torus,
    Lens,
}

#[derive(Clone, Copy)]
enum Operand {
    Body(Body),
    Csg,
}

const OPERANDS: &[(&str, Operand)] = &[
    ("sphere", Operand::Body(Body::Sphere)),
    ("box", Operand::Body(Body::Box)),
    ("cylinder", Operand::Body(Body::Cylinder)),
    ("cone", Operand::Body(Body::Cone)),
    ("torus", Operand::Body(Body::Torus)),
    ("lens", Operand::Body(Body::Lens)),
    ("csg", Operand::Csg),
];

const OPERATIONS: &[(&str, CsgOperation)] = &[
    ("union", CsgOperation::Union),
    ("intersection", CsgOperation::Intersection),
    ("difference", CsgOperation::Difference),
];

/// Operands within operands; more is a mistake, and each takes stack.
const MOST_LEVELS: u32 = 32;

const FEATURES: Expected =
    Expected { what: "a number from 0.01 to 1000", example: "4.0", holds: |x| (0.01..=1000.0).contains(&x) };

/// What `made` is, or the reason why it is nothing.
fn checked<T>(table: &Table<'_>, made: Result<T, ShapeError>) -> Option<T> {
    let remedy = "check its radii, lengths and points";
    made.map_err(|error| table.refuse::<T>(format!("{}: {error}", table.title()), remedy)).ok()
}

fn read_axis(table: &mut Table<'_>) -> Option<DVec3> {
    table.or("axis", DVec3::Y, |value| match value.vector(&NUMBER)? {
        DVec3::ZERO => value.refuse("a direction", "give at least one number that is not 0"),
        axis => Some(axis),
    })
}

fn read_center(table: &mut Table<'_>) -> Option<DVec3> {
    table.or("center", DVec3::ZERO, |value| value.vector(&NUMBER))
}

fn read_length(table: &mut Table<'_>, key: &'static str) -> Option<f64> {
    table.required(key, "0.5", |value| value.number(&POSITIVE))
}

/// A closed body.
pub(super) fn read_body(table: &mut Table<'_>, body: Body) -> Option<Solid> {
    let solid = match body {
        Body::Sphere => {
            let (center, radius) = (read_center(table), read_radius(table));
            Solid::sphere(center?, radius?)
        }
        Body::Box => {
            let (min, max) = (read_point(table, "min"), read_point(table, "max"));
            Solid::cuboid(min?, max?)
        }
        Body::Cylinder => {
            let (base, top) = (read_point(table, "base"), read_point(table, "top"));
            let radius = read_radius(table);
            Solid::cylinder(base?, top?, radius?)
        }
        Body::Cone => {
            let (base, top) = (read_point(table, "base"), read_point(table, "top"));
            let radius = read_radius(table);
            let narrow = table.optional("top-radius", |value| value.number(&POSITIVE));
            Solid::cone(base?, top?, radius?, narrow?.unwrap_or(0.0))
        }
        Body::Torus => {
            let (center, axis) = (read_center(table), read_axis(table));
            let (major, minor) = (read_radius(table), read_length(table, "tube-radius"));
            Solid::torus(center?, axis?, major?, minor?)
        }
        Body::Lens => {
            let (center, axis) = (read_center(table), read_axis(table));
            let (aperture, thickness) = (read_radius(table), read_length(table, "thickness"));
            let mut curved = |key| table.or(key, f64::INFINITY, |value| value.number(&POSITIVE));
            let (front, back) = (curved("front-radius"), curved("back-radius"));
            Solid::lens(center?, axis?, aperture?, thickness?, [front?, back?])
        }
    };
    checked(table, solid)
}

/// A body by itself.
pub(super) fn read_solid(table: &mut Table<'_>, body: Body) -> Option<GeometryDescription> {
    let object = Csg::of(read_body(table, body)?);
    Some(GeometryDescription::Csg { object, materials: vec![None] })
}

/// `operation` and `operands` of a `csg`.
pub(super) fn read_csg(table: &mut Table<'_>, materials: &Names) -> Option<GeometryDescription> {
    let (object, materials) = read_operation(table, materials, 0)?;
    Some(GeometryDescription::Csg { object, materials })
}

type Parts = (Csg, Vec<Option<usize>>);

fn read_operation(table: &mut Table<'_>, materials: &Names, level: u32) -> Option<Parts> {
    const EXAMPLE: &str =
        "[{ type = \"box\", min = [0, 0, 0], max = [1, 1, 1] }, { type = \"sphere\", radius = 0.5 }]";
    let operation = table.required("operation", "\"difference\"", |value| value.choice(OPERATIONS));
    if level >= MOST_LEVELS {
        return table.refuse(
            format!("{} is the {MOST_LEVELS}th operand within an operand", table.title()),
            "list the operands of like operations side by side",
        );
    }
    let operands = table.required("operands", EXAMPLE, |value| {
        let operands = value.list("a list of at least two bodies", EXAMPLE)?;
        if operands.len() < 2 {
            return value.refuse(
                "a list of at least two bodies",
                format!("write for example `operands = {EXAMPLE}`"),
            );
        }
        let read: Vec<_> = operands.map(|operand| read_operand(operand, materials, level + 1)).collect();
        read.into_iter().collect::<Option<Vec<Parts>>>()
    });
    let (operation, mut operands) = (operation?, operands?.into_iter());
    let (mut object, mut parts) = operands.next()?;
    for (next, its_parts) in operands {
        object = checked(table, object.combined(operation, &next))?;
        parts.extend(its_parts);
    }
    Some((object, parts))
}

fn read_operand(value: Value<'_>, materials: &Names, level: u32) -> Option<Parts> {
    let mut table = value.table("an operand", "write for example `{ type = \"sphere\", radius = 0.5 }`")?;
    let kind = table.required("type", "\"sphere\"", |value| value.choice(OPERANDS))?;
    let parts = match kind {
        Operand::Body(body) => read_body(&mut table, body).map(|solid| (Csg::of(solid), vec![None])),
        Operand::Csg => read_operation(&mut table, materials, level),
    };
    let transform = transform_of(&mut table);
    let material = table.optional("material", |value| materials.find(value));
    let (object, mut its_materials) = parts?;
    let object = checked(&table, object.transformed(&transform?))?;
    table.finish();
    if let Some(material) = material? {
        its_materials.iter_mut().for_each(|own| *own = own.or(Some(material)));
    }
    Some((object, its_materials))
}

pub(super) fn read_flake(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let (center, radius, axis) = (read_center(table), read_radius(table), read_axis(table));
    let most = u64::from(SphereFlake::MAX_DEPTH);
    let depth = table.required("depth", "5", |value| value.integer(0..=most));
    let depth = u32::try_from(depth?).ok()?;
    Some(GeometryDescription::SphereFlake { center: center?, radius: radius?, axis: axis?, depth })
}

pub(super) fn read_terrain(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let center = read_center(table);
    let size = table.required("size", "[10.0, 2.0, 10.0]", |value| value.vector(&POSITIVE));
    let cells = table.or("resolution", 512, |value| value.integer(1..=u64::from(HeightGrid::MAX_CELLS)));
    let features = table.or("features", 4.0, |value| value.number(&FEATURES));
    let octaves = table.or("octaves", 8, |value| value.integer(1..=20));
    let seed = table.or("seed", 0, |value| value.integer(0..=u64::from(u32::MAX)));
    let ridges = table.or("ridges", false, |value| value.boolean());
    let noise = TerrainNoise {
        features: features?,
        octaves: u32::try_from(octaves?).ok()?,
        seed: u32::try_from(seed?).ok()?,
        ridges: ridges?,
    };
    let cells = u32::try_from(cells?).ok()?;
    Some(GeometryDescription::Terrain { center: center?, size: size?, cells, noise })
}
