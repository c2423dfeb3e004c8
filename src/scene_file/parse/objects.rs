//! Shapes of `[[shapes]]` that are closed bodies, constructive solid geometry, or procedural.

use super::names::Names;
use super::shapes::{read_point, read_radius};
use super::transform::transform_of;
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, NUMBER, POSITIVE, Table, Value};
use crate::shapes::{Csg, CsgOperation, HeightGrid, ShapeError, Solid, SphereFlake, TerrainNoise};
use glam::DVec3;

/// Kinds of closed bodies, which stand alone or are operands.
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

/// Deepest nesting of operands; each level takes stack, and deeper nesting is a mistake.
const MOST_LEVELS: u32 = 32;

const FEATURES: Expected =
    Expected { what: "a number from 0.01 to 1000", example: "4.0", holds: |x| (0.01..=1000.0).contains(&x) };

/// The value of `made`; records the reason where it is an error.
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

/// Reads a closed body.
pub(super) fn read_body(table: &mut Table<'_>, body: Body) -> Option<Solid> {
    let solid = match body {
        Body::Sphere => {
            let (center, radius) = (read_center(table), read_radius(table));
            Solid::sphere(center?, radius?)
        }
        Body::Box => {
            let (min, max) = (read_point(table, "min"), read_point(table, "max"));
            let (min, max) = (min?, max?);
            if let Some(axis) = (0..3).find(|&axis| min[axis] >= max[axis]) {
                let name = ["x", "y", "z"][axis];
                return table.refuse(
                    format!(
                        "{}: `min` is {} in {name} and `max` is {}: a box has `min` below `max` on every axis",
                        table.title(),
                        min[axis],
                        max[axis]
                    ),
                    if min[axis] > max[axis] {
                        "exchange the two numbers".to_owned()
                    } else {
                        "make one of them larger, or use a quad for something flat".to_owned()
                    },
                );
            }
            Solid::cuboid(min, max)
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

/// Reads a body that is a shape by itself.
pub(super) fn read_solid(table: &mut Table<'_>, body: Body) -> Option<GeometryDescription> {
    let object = Csg::of(read_body(table, body)?);
    Some(GeometryDescription::Csg { object, materials: vec![None] })
}

/// Reads `operation` and `operands` of a `csg`.
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
    let triangles = table.or("triangles", false, |value| value.boolean());
    let noise = TerrainNoise {
        features: features?,
        octaves: u32::try_from(octaves?).ok()?,
        seed: u32::try_from(seed?).ok()?,
        ridges: ridges?,
    };
    let cells = u32::try_from(cells?).ok()?;
    Some(GeometryDescription::Terrain { center: center?, size: size?, cells, noise, triangles: triangles? })
}

#[cfg(test)]
mod tests {
    use crate::embree::Device;
    use crate::math::Ray;
    use crate::scene_file::{BuiltScene, build_scene, parse_scene};
    use glam::Vec3;
    use std::path::Path;
    use std::sync::Arc;

    const MATERIALS: &str = "
        [textures.veins]
        type = \"marble\"
        size = 0.4
        [materials.white]
        type = \"lambert\"
        reflectance = 0.8
        texture = \"veins\"
        bump = { texture = \"veins\", height = 0.01 }
        [materials.black]
        type = \"lambert\"
        reflectance = 0.1
        [materials.glass]
        type = \"dielectric\"
        ior = 1.5
        ";

    fn build(shapes: &str) -> BuiltScene {
        let text = format!("{MATERIALS}{shapes}");
        let description = parse_scene(&text, Path::new("s.toml"), &[]).unwrap();
        build_scene(&description, &Arc::new(Device::new(1).unwrap()), (4, 4)).unwrap()
    }

    /// Hit of a ray given in metres: the distance in metres, the name of the material, and the normal.
    fn look(built: &BuiltScene, origin: Vec3, direction: Vec3) -> Option<(f64, String, Vec3)> {
        let space = built.scene.space();
        let origin = space.position(origin.as_dvec3()).as_vec3();
        let hit = built.scene.intersect(&Ray::new(origin, direction.normalize()))?;
        let material = built.scene.materials()[hit.material as usize].0.clone();
        Some((space.metres(f64::from(hit.distance)), material, hit.point.normal))
    }

    const DIE: &str = "
        type = \"csg\"
        operation = \"difference\"
        material = \"white\"
        operands = [
          { type = \"csg\", operation = \"intersection\", operands = [
            { type = \"box\", min = [-1, -1, -1], max = [1, 1, 1] },
            { type = \"sphere\", radius = 1.5, material = \"glass\" },
          ] },
          { type = \"sphere\", radius = 0.25, transform = [{ translate = [0, 1, 0] }], material = \"black\" },
        ]
        ";

    #[test]
    fn a_die_has_faces_edges_and_pips() {
        for (place, scale) in [("", 1.0f32), ("transform = [{ scale = [0.5, 0.5, 0.5] }]", 0.5)] {
            let built = build(&format!("[[shapes]]\n{DIE}\n{place}"));
            let from =
                |x: f32, z: f32| look(&built, Vec3::new(x * scale, 10.0, z * scale), Vec3::NEG_Y).unwrap();
            let (distance, material, normal) = from(0.5, 0.3);
            assert!(
                (distance - f64::from(10.0 - scale)).abs() < 1e-5 && material == "white" && normal.y > 0.999
            );
            let (distance, material, normal) = from(0.0, 0.0);
            assert!((distance - f64::from(10.0 - 0.75 * scale)).abs() < 1e-5 && material == "black");
            assert!(normal.y > 0.999, "the normal of a pip points out of it: {normal}");
            // The sphere, which is glass here, cuts off a corner.
            let direction = Vec3::new(-1.0, -1.0, -1.0);
            let (_, material, normal) = look(&built, -5.0 * direction, direction).unwrap();
            assert!(material == "glass" && normal.dot(-direction.normalize()) > 0.999);
            assert_eq!(built.scene.casters().len(), 1, "its glass casts caustics");
        }
    }

    #[test]
    fn objects_stand_in_groups_and_under_any_transform() {
        let objects = [
            ("type = \"torus\"\nradius = 1\ntube-radius = 0.25", Vec3::new(1.0, 5.0, 0.0), 4.75),
            ("type = \"cone\"\nbase = [0, 0, 0]\ntop = [0, 1, 0]\nradius = 1", Vec3::new(0.0, 5.0, 0.0), 4.0),
            ("type = \"box\"\nmin = [-1, 0, -1]\nmax = [1, 0.5, 1]", Vec3::new(0.3, 5.0, 0.3), 4.5),
            (
                "type = \"lens\"\nradius = 1\nthickness = 0.5\nfront-radius = 2",
                Vec3::new(0.0, 5.0, 0.0),
                4.75,
            ),
            (
                "type = \"sphere-flake\"\nradius = 1\ndepth = 1\naxis = [0, -1, 0]",
                Vec3::new(0.0, 5.0, 0.0),
                4.0,
            ),
            ("type = \"terrain\"\nsize = [4, 1e-6, 4]\nresolution = 8", Vec3::new(0.1, 5.0, 0.2), 5.0),
        ];
        for (object, eye, distance) in objects {
            let check = |shapes: String, eye: Vec3, distance: f64| {
                let built = build(&shapes);
                let (found, _, normal) = look(&built, eye, Vec3::NEG_Y).unwrap();
                assert!((found - distance).abs() < 1e-4, "{shapes}: {found} instead of {distance}");
                assert!(normal.y > 0.0, "{shapes}: {normal}");
            };
            let material = "material = \"white\"";
            check(format!("[[shapes]]\n{object}\n{material}"), eye, distance);
            // Twice as wide along x, and mirrored.
            let stretch = "transform = [{ scale = [-2, 1, 1] }, { translate = [7, 0, 0] }]";
            let moved = Vec3::new(7.0 - 2.0 * eye.x, eye.y, eye.z);
            check(format!("[[shapes]]\n{object}\n{material}\n{stretch}"), moved, distance);
            let group =
                format!("[[shapes]]\n{object}\n{material}\ngroup = \"g\"\n[[instances]]\ngroup = \"g\"\n");
            check(format!("{group}{stretch}"), moved, distance);
        }
    }

    #[test]
    fn textures_colour_what_is_hit() {
        let built =
            build("[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\nmaterial = \"white\"");
        let mut tints = Vec::new();
        for i in 0..50 {
            let x = -0.9 + 0.036 * i as f32;
            let hit = built.scene.intersect(&Ray::new(Vec3::new(0.3 * x, 0.9, 0.1), Vec3::NEG_Y)).unwrap();
            tints.push(hit.tint.x);
            assert!(
                (hit.shading_normal.length() - 1.0).abs() < 1e-5
                    && hit.shading_normal.dot(hit.point.normal) > 0.0
            );
            let shading = hit.shading(built.scene.material(&hit));
            let crate::bsdf::Bsdf::Lambert(lambert) = shading.bsdf else { panic!("not Lambert") };
            assert!((lambert.reflectance.x - 0.8 * hit.tint.x).abs() < 1e-6);
        }
        let (low, high) = tints.iter().fold((1.0f32, 0.0f32), |(a, b), &x| (a.min(x), b.max(x)));
        assert!(low < 0.3 && high > 0.7, "{low} to {high}");
    }

    #[test]
    fn mistakes_are_told() {
        let refused = |shape: &str| {
            let text = format!("{MATERIALS}[[shapes]]\n{shape}\nmaterial = \"white\"\n");
            parse_scene(&text, Path::new("s.toml"), &[]).unwrap_err().to_string()
        };
        for (shape, message) in [
            ("type = \"torus\"\nradius = 1\ntube-radius = 2", "radius 2"),
            ("type = \"box\"\nmin = [0, 0, 0]\nmax = [1, 0, 1]", "`min` below `max` on every axis"),
            ("type = \"sphere-flake\"\nradius = 1\ndepth = 13", "from 0 to 12"),
            ("type = \"terrain\"\nsize = [1, 0, 1]", "above 0"),
            ("type = \"csg\"\noperation = \"xor\"\noperands = []", "\"union\""),
            (
                "type = \"csg\"\noperation = \"union\"\noperands = [{ type = \"sphere\", radius = 1 }]",
                "at least two",
            ),
            ("type = \"lens\"\nradius = 1\nthickness = 1\nfront-radius = 0.3", "radius 0.3"),
            (
                "type = \"box\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nemission = { radiance = 1 }",
                "no light sampling",
            ),
            (
                "type = \"box\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\n[materials.m]\ntype = \"lambert\"\nreflectance = 1\ntexture = \"vein\"",
                "no texture is named",
            ),
        ] {
            assert!(refused(shape).contains(message), "{shape}: {}", refused(shape));
        }
    }
}
