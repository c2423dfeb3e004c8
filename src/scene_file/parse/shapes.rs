//! `[[shapes]]` and `[[instances]]`.

use super::brightness::{Measure, lumens, read_brightness, watts};
use super::generate::{read_city, read_lathe, read_teapot};
use super::names::Names;
use super::objects::{Body, read_csg, read_flake, read_solid, read_terrain};
use super::read_name;
use super::transform::{in_metres, is_similarity, transform_of};
use crate::files::{ForeignFile, foreign_file};
use crate::scene::IlluminationKernel;
use crate::scene_file::build::can_be_pictured;
use crate::scene_file::description::*;
use crate::scene_file::import::material::Needs;
use crate::scene_file::mesh::is_degenerate;
use crate::scene_file::polygon::triangulate_polygon;
use crate::scene_file::reader::{Expected, NUMBER, POSITIVE, SHARE, Table, Value};
use crate::scene_file::{Choice, is_gltf_file, is_mesh_file};
use glam::{DAffine3, DVec3, Vec2};
use std::path::PathBuf;

/// A texture coordinate.
const COORDINATE: Expected =
    Expected { what: "a number from -1e6 to 1e6", example: "0.5", holds: |x| x.abs() <= 1e6 };

/// Sine of the angle between two edges of a quad below which it counts as a line.
const FLAT: f64 = 1e-12;

/// Contents of `[[shapes]]`.
#[derive(Debug)]
pub(super) struct Shapes {
    pub(super) shapes: Vec<Named<ShapeDescription>>,
    pub(super) groups: Vec<Named<()>>,
    pub(super) group_names: Names,
    /// Whether some emitting shape has no material; it then gets one after the last material of the file.
    pub(super) uses_implied_material: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Mesh,
    Quad,
    Sphere,
    Cylinder,
    Disc,
    Lathe,
    Teapot,
    City,
    Body(Body),
    Csg,
    SphereFlake,
    Terrain,
}

const KINDS: &[(&str, Kind)] = &[
    ("mesh", Kind::Mesh),
    ("quad", Kind::Quad),
    ("sphere", Kind::Sphere),
    ("cylinder", Kind::Cylinder),
    ("disc", Kind::Disc),
    ("lathe", Kind::Lathe),
    ("teapot", Kind::Teapot),
    ("city", Kind::City),
    ("box", Kind::Body(Body::Box)),
    ("cone", Kind::Body(Body::Cone)),
    ("torus", Kind::Body(Body::Torus)),
    ("lens", Kind::Body(Body::Lens)),
    ("csg", Kind::Csg),
    ("sphere-flake", Kind::SphereFlake),
    ("terrain", Kind::Terrain),
];

pub(super) fn read_shapes(
    tables: Vec<(Table<'_>, f64)>,
    (materials, needs, textures): (&Names, &[Needs], &Names),
) -> Shapes {
    let mut names = Names::new("shape");
    let mut result = Shapes {
        shapes: Vec::new(),
        groups: Vec::new(),
        group_names: Names::new("group"),
        uses_implied_material: false,
    };
    for (index, (mut table, unit)) in tables.into_iter().enumerate() {
        let name = read_name(&mut table, &mut names, "shape", index);
        let location = table.location();
        let group = table.optional("group", |value| read_group(value, &mut result));
        let shape = read_shape(table, (materials, needs, textures), unit);
        let (Some(name), Some(group), Some(shape)) = (name, group, shape) else { continue };
        result.uses_implied_material |= shape.material == materials.len();
        result.shapes.push(Named { name, location, value: ShapeDescription { group, ..shape } });
    }
    result
}

/// Index of a group; the first shape in a group defines it.
fn read_group(value: Value<'_>, result: &mut Shapes) -> Option<usize> {
    let name = value.string()?;
    let index = result.group_names.add(&name, value.context().location(&value.span()));
    if index == result.groups.len() {
        let location = value.context().location(&value.span());
        result.groups.push(Named { name: name.into_owned(), location, value: () });
    }
    Some(index)
}

fn read_shape(
    mut table: Table<'_>,
    (materials, needs, textures): (&Names, &[Needs], &Names),
    unit: f64,
) -> Option<ShapeDescription> {
    let kind = table.required("type", "\"sphere\"", |value| value.choice(KINDS))?;
    let geometry = match kind {
        Kind::Mesh => read_mesh(&mut table, materials),
        Kind::Quad => read_quad(&mut table),
        Kind::Sphere => read_sphere(&mut table),
        Kind::Cylinder => read_cylinder(&mut table),
        Kind::Disc => read_disc(&mut table),
        Kind::Lathe => read_lathe(&mut table),
        Kind::Teapot => read_teapot(&mut table),
        Kind::City => read_city(&mut table),
        Kind::Body(body) => read_solid(&mut table, body),
        Kind::Csg => read_csg(&mut table, materials),
        Kind::SphereFlake => read_flake(&mut table),
        Kind::Terrain => read_terrain(&mut table),
    };
    let transform = transform_of(&mut table);
    let flip_normal = table.or("flip-normal", false, |value| value.boolean());
    let caustic_photons = table.or("caustic-photons", 1.0, |value| value.number(&SHARE));
    let illumination = table.optional("illumination-map", read_illumination).map(Option::flatten);
    let has_coordinates = match &geometry {
        Some(GeometryDescription::Csg { object, .. }) => object.charts().is_some(),
        _ => matches!(kind, Kind::Quad | Kind::Sphere | Kind::Cylinder | Kind::Disc),
    };
    if geometry.is_some() && !has_coordinates && matches!(illumination, Some(Some(_))) {
        table.refuse::<()>(
            format!("{} has no coordinates over which illumination could be summed up", table.title()),
            "give the map to a quad, box, sphere, cylinder or disc; other shapes keep their photons",
        );
    }
    let displacement = table.optional("displace", |value| read_displacement(value, textures, unit));
    let is_one_mesh = match &geometry {
        Some(GeometryDescription::MeshFile { own_materials, path, .. }) => {
            !own_materials && !is_gltf_file(path)
        }
        _ => true,
    };
    if matches!(displacement, Some(Some(_))) && !(matches!(kind, Kind::Mesh) && is_one_mesh) {
        table.refuse::<()>(
            format!("{} cannot be displaced", table.title()),
            "displace a mesh with one material: `type = \"mesh\"` with `vertices` or a file of PLY, OBJ or STL, without `materials = \"file\"`",
        );
    }
    let emission = table.optional("emission", read_emission);
    // An emitter need not reflect light, so only an emitter may omit its material.
    let material = match (table.get("material"), &emission) {
        (Some(value), _) => materials.find(value),
        (None, Some(None)) => table.required("material", "\"NAME\"", |_| None),
        (None, _) => Some(materials.len()),
    };
    if let Some(GeometryDescription::Csg { materials: parts, .. }) = &geometry
        && parts.iter().flatten().any(|&part| needs.get(part).is_some_and(|needs| needs.any()))
    {
        table.refuse::<()>(
            format!(
                "an operand of {} has a material with an image, a normal map, an alpha or anisotropy",
                table.title()
            ),
            "operands have no texture coordinates: give it another material",
        );
    }
    let needs = material.and_then(|material| needs.get(material)).copied().unwrap_or_default();
    if needs.any()
        && let Some(geometry) = &geometry
        && !can_be_pictured(geometry)
    {
        table.refuse::<()>(
            format!(
                "{} has no texture coordinates, and its material has an image, a normal map, an alpha or anisotropy",
                table.title()
            ),
            "give it to a quad, sphere, disc, cylinder or box, or to a mesh that has coordinates",
        );
    }
    if needs.any() && (matches!(displacement, Some(Some(_))) || matches!(illumination, Some(Some(_)))) {
        table.refuse::<()>(
            format!("{} has a displacement or an illumination map, and its material has an image, a normal map, an alpha or anisotropy", table.title()),
            "leave one of them out",
        );
    }
    let samples = matches!(kind, Kind::Mesh | Kind::Quad | Kind::Sphere | Kind::Cylinder | Kind::Disc);
    if !samples && matches!(emission, Some(Some(_))) {
        table.refuse::<()>(
            format!("{} emits, and shapes of its type have no light sampling", table.title()),
            "let a mesh, quad, sphere, cylinder or disc emit",
        );
    }
    if needs.data && matches!(emission, Some(Some(_))) {
        table.refuse::<()>(
            format!("{} emits, and its material has an `alpha` or a `cutout`", table.title()),
            "light sources are whole: give it another material, or the outline by its shape",
        );
    }
    let is_split = match &geometry {
        Some(GeometryDescription::MeshFile { own_materials, path, .. }) => {
            *own_materials || is_gltf_file(path)
        }
        _ => false,
    };
    if is_split && matches!(emission, Some(Some(EmissionDescription { emitted: Emitted::Power(_), .. }))) {
        table.refuse::<()>(
            format!(
                "the parts of {}, which come from its file, would each emit all of its power",
                table.title()
            ),
            "give `radiance` or `nits`",
        );
    }
    let is_round = matches!(kind, Kind::Sphere | Kind::Cylinder | Kind::Disc);
    let emits = matches!(emission, Some(Some(_)));
    if is_round && emits && transform.is_some_and(|transform| !is_similarity(&transform)) {
        table.refuse::<()>(
            format!("{} emits and is scaled unequally: light sampling needs it round", table.title()),
            "use the same `scale` for all axes, or a mesh",
        );
    }
    table.finish();
    Some(ShapeDescription {
        geometry: geometry?,
        // The unit is applied last and as a separate factor, so coordinates keep the numbers of the file.
        transform: DAffine3::from_scale(DVec3::splat(unit)) * transform?,
        flip_normal: flip_normal?,
        material: material?,
        caustic_photons: caustic_photons?,
        illumination: illumination?,
        emission: emission?,
        displacement: displacement?,
        group: None,
    })
}

/// Reads `displace = { texture = "NAME", height = 0.02, edge = 0.01 }`.
fn read_displacement(value: Value<'_>, textures: &Names, unit: f64) -> Option<DisplacementDescription> {
    let example = "write for example `displace = { texture = \"NAME\", height = 0.02, edge = 0.01 }`";
    let mut table = value.table("`displace`", example)?;
    let texture = table.required("texture", "\"NAME\"", |value| textures.find(value));
    let height = table.required("height", "0.02", |value| value.number(&NUMBER));
    let edge = table.required("edge", "0.01", |value| value.number(&POSITIVE));
    let normals = table.or("normals", false, |value| value.choice(&[("smooth", false), ("flat", true)]));
    table.finish();
    let (height, edge) = (height? * unit, edge? * unit);
    Some(DisplacementDescription { texture: texture?, height, edge, is_flat: normals? })
}

/// Reads `true`, `false`, a kernel, or a table of options.
fn read_illumination(value: Value<'_>) -> Option<Option<IlluminationDescription>> {
    const KERNELS: &[(&str, IlluminationKernel)] =
        &[("box", IlluminationKernel::Box), ("tent", IlluminationKernel::Tent)];
    let with = |kernel| IlluminationDescription { kernel, elements: None, refinement: None };
    if value.is_boolean() {
        return value.boolean().map(|wanted| wanted.then(|| with(IlluminationKernel::Tent)));
    }
    if !value.is_table() {
        return value.choice(KERNELS).map(|kernel| Some(with(kernel)));
    }
    let mut table = value.table("`illumination-map`", "")?;
    let kernel = table.or("kernel", IlluminationKernel::Tent, |value| value.choice(KERNELS));
    let count =
        |most: u64| move |value: Value<'_>| value.integer(1..=most).and_then(|n| u32::try_from(n).ok());
    let elements = table.optional("elements", count(4_194_304));
    let refinement = table.optional("refinement", count(64));
    table.finish();
    Some(Some(IlluminationDescription { kernel: kernel?, elements: elements?, refinement: refinement? }))
}

fn read_emission(value: Value<'_>) -> Option<EmissionDescription> {
    let mut table =
        value.table("`emission`", "write for example `emission = { radiance = [10.0, 9.0, 8.0] }`")?;
    type Made = fn(DVec3) -> Emitted;
    let measures: [Measure<Made>; 4] = [
        watts("radiance", Emitted::Radiance),
        watts("power", Emitted::Power),
        lumens("nits", Emitted::Radiance),
        lumens("lumens", Emitted::Power),
    ];
    let emitted = match read_brightness(&mut table, &measures) {
        Some(None) => table.required("radiance", "[10.0, 9.0, 8.0]", |_| None),
        found => found.flatten().map(|(amount, of)| of(amount)),
    };
    let two_sided = table.or("two-sided", false, |value| value.boolean());
    let photons = table.or("photons", 1.0, |value| value.number(&SHARE));
    table.finish();
    Some(EmissionDescription { emitted: emitted?, two_sided: two_sided?, photons: photons? })
}

pub(super) fn read_point(table: &mut Table<'_>, key: &'static str) -> Option<DVec3> {
    table.required(key, "[0.0, 1.0, 0.0]", |value| value.vector(&NUMBER))
}

pub(super) fn read_radius(table: &mut Table<'_>) -> Option<f64> {
    table.required("radius", "1.0", |value| value.number(&POSITIVE))
}

fn read_quad(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let corner = read_point(table, "corner");
    let edge_u = read_point(table, "edge-u");
    let edge_v = read_point(table, "edge-v");
    let (corner, edge_u, edge_v) = (corner?, edge_u?, edge_v?);
    let (u, v) = (crate::math::unit_f64(edge_u), crate::math::unit_f64(edge_v));
    if !u.zip(v).is_some_and(|(u, v)| u.cross(v).length() > FLAT) {
        return table.refuse(
            format!("{} has no area: `edge-u` or `edge-v` is zero, or they are parallel", table.title()),
            "give two edges from `corner` that span a parallelogram",
        );
    }
    Some(GeometryDescription::Quad { corner, edge_u, edge_v })
}

fn read_sphere(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let center = table.or("center", DVec3::ZERO, |value| value.vector(&NUMBER));
    let radius = read_radius(table);
    Some(GeometryDescription::Sphere { center: center?, radius: radius? })
}

fn read_cylinder(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let base = read_point(table, "base");
    let top = read_point(table, "top");
    let radius = read_radius(table);
    let (base, top, radius) = (base?, top?, radius?);
    if crate::math::unit_f64(top - base).is_none() {
        let message = format!("{} has no height: `base` and `top` are the same point", table.title());
        return table.refuse(message, "put `base` and `top` at the two ends of its axis");
    }
    Some(GeometryDescription::Cylinder { base, top, radius })
}

fn read_disc(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let center = table.or("center", DVec3::ZERO, |value| value.vector(&NUMBER));
    let normal = table.or("normal", DVec3::Y, |value| match value.vector(&NUMBER)? {
        DVec3::ZERO => value.refuse("a direction", "give at least one number that is not 0"),
        normal => Some(normal),
    });
    let radius = read_radius(table);
    Some(GeometryDescription::Disc { center: center?, normal: normal?, radius: radius? })
}

fn read_mesh(table: &mut Table<'_>, materials: &Names) -> Option<GeometryDescription> {
    let kinds =
        [("file", MeshNormals::FromFile), ("flat", MeshNormals::Flat), ("smooth", MeshNormals::Smooth)];
    if table.get("file").is_some() {
        let path = table.required("file", "", read_mesh_path);
        let normals = table.or("normals", MeshNormals::FromFile, |value| value.choice(&kinds));
        let fit = table.optional("fit", read_fit);
        let own = [("one", false), ("file", true)];
        let own_materials = table.or("materials", false, |value| value.choice(&own));
        let replaced = table.or("replace", Vec::new(), |value| read_replaced(value, materials));
        if own_materials == Some(false) && replaced.as_ref().is_some_and(|replaced| !replaced.is_empty()) {
            return table.refuse(
                format!("{} has `replace`, and no materials of its file", table.title()),
                "add `materials = \"file\"`",
            );
        }
        return Some(GeometryDescription::MeshFile {
            path: path?,
            normals: normals?,
            own_materials: own_materials?,
            replaced: replaced?,
            fit: fit?,
        });
    }
    if table.get("vertices").is_none() {
        return table.refuse(
            format!("{} is a mesh without `file` and without `vertices`", table.title()),
            "add `file = \"meshes/knot.ply\"`, or `vertices` and `faces`",
        );
    }
    let positions = table.required("vertices", "", read_vertices);
    let count = positions.as_ref().map(Vec::len);
    let example = "[[0, 1, 2]]";
    let faces = table.required("faces", example, |value| read_faces(value, positions.as_deref()));
    let normals = table.or("normals", MeshNormals::Flat, |value| value.choice(&kinds[1..]));
    let uvs = table.optional("coordinates", |value| read_coordinates(value, count));
    count?;
    Some(GeometryDescription::Mesh { positions: positions?, triangles: faces?, normals: normals?, uvs: uvs? })
}

/// Reads `replace = { "Name in the file" = "NAME" }`.
fn read_replaced(value: Value<'_>, materials: &Names) -> Option<Vec<(String, usize)>> {
    let table = value.table("`replace`", "write for example `replace = { \"Glass\" = \"NAME\" }`")?;
    let entries = table.sorted_entries().into_iter();
    let found: Vec<_> =
        entries.map(|(_, value)| Some((value.name().to_owned(), materials.find(value)?))).collect();
    found.into_iter().collect()
}

/// Path of a mesh file, which must exist and be of a supported kind.
fn read_mesh_path(value: Value<'_>) -> Option<PathBuf> {
    let path = value.path()?;
    let shown = path.display();
    let context = value.context();
    if !path.exists() {
        const RELATIVE: &str =
            "paths are relative to the scene file, those given by `--set` to the current directory";
        let remedy = match value.whole_parameter() {
            Some((name, _)) => format!("name another with `--set {name}=FILE`; {RELATIVE}"),
            None => RELATIVE.to_string(),
        };
        context.error(&value.span(), format!("there is no mesh file {shown}"), remedy);
        return None;
    }
    if !path.is_file() {
        let remedy = "name a mesh file: .ply, .obj, .stl, .gltf or .glb";
        context.error(&value.span(), format!("{shown} is a folder or not a regular file"), remedy);
        return None;
    }
    if !(is_mesh_file(&path) || is_gltf_file(&path)) {
        match foreign_file(&path) {
            Some(ForeignFile { what, remedy }) => {
                context.error(
                    &value.span(),
                    format!("{shown} is {what}, which is no mesh that is read"),
                    remedy,
                );
            }
            None => {
                let remedy = "convert it to PLY, OBJ, STL or glTF; the name of the file must end in `.ply`, `.obj`, `.stl`, `.gltf` or `.glb`";
                context.error(&value.span(), format!("{shown} is no mesh by its name"), remedy);
            }
        }
        return None;
    }
    Some(path)
}

fn read_fit(value: Value<'_>) -> Option<FitDescription> {
    let anchors = [("center", FitAnchor::Center), ("bottom", FitAnchor::Bottom)];
    let axes = [("y", UpAxis::Y), ("z", UpAxis::Z)];
    let mut table = value.table("`fit`", "write for example `fit = { size = 1.0, anchor = \"bottom\" }`")?;
    let size = table.required("size", "1.0", |value| value.number(&POSITIVE));
    let anchor = table.or("anchor", FitAnchor::Center, |value| value.choice(&anchors));
    let at = table.or("at", DVec3::ZERO, |value| value.vector(&NUMBER));
    let up = table.or("up", UpAxis::Y, |value| value.choice(&axes));
    let moves = table.or("moves", false, |value| value.choice(&[("shape", false), ("scene", true)]));
    let choices = [("auto", Choice::Auto), ("yes", Choice::Yes), ("no", Choice::No)];
    let room = table.optional("room", |value| value.choice(&choices));
    let moves = match (moves?, room?) {
        (true, room) => FitMoves::Scene { room: room.unwrap_or(Choice::No) },
        (false, None) => FitMoves::Shape,
        (false, Some(_)) => {
            let message = "`room` is for a scene that is placed around a mesh";
            return table.refuse(message, "write `moves = \"scene\"` too, or leave `room` out");
        }
    };
    table.finish();
    Some(FitDescription { size: size?, anchor: anchor?, at: at?, up: up?, moves })
}

fn read_vertices(value: Value<'_>) -> Option<Vec<DVec3>> {
    let example = "[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]";
    let vertices = value.list("a list of points", example)?;
    if vertices.len() < 3 {
        return value.refuse("at least 3 points", format!("write for example `vertices = {example}`"));
    }
    vertices.map(|vertex| vertex.vector(&NUMBER)).collect()
}

/// Texture coordinates, one pair for each of `count` vertices.
fn read_coordinates(value: Value<'_>, count: Option<usize>) -> Option<Vec<Vec2>> {
    const EXAMPLE: &str = "[[0, 0], [1, 0], [0, 1]]";
    let pairs = value.list("a list of pairs of numbers", EXAMPLE)?;
    if count.is_some_and(|count| count != pairs.len()) {
        let remedy = "give each vertex its own pair; corners with two are two vertices";
        return value.refuse("as many pairs as there are vertices", remedy);
    }
    let pair = |value: Value<'_>| {
        let [u, v] = value.pair(&COORDINATE, "[0.5, 1.0]")?;
        Some(Vec2::new(u as f32, v as f32))
    };
    pairs.map(pair).collect()
}

/// Faces as triangles. Without `positions` (they have errors of their own) only the form is checked. Faulty faces that a mesh
/// file may contain by accident are refused here, because nobody writes them by hand on purpose.
fn read_faces(value: Value<'_>, positions: Option<&[DVec3]>) -> Option<Vec<[u32; 3]>> {
    const EXAMPLE: &str = "[[0, 1, 2], [0, 2, 3]]";
    let faces = value.list("a list of faces", EXAMPLE)?;
    if faces.len() == 0 {
        return value.refuse("at least one face", format!("write for example `faces = {EXAMPLE}`"));
    }
    let last = positions.map_or(u64::from(u32::MAX), |positions| positions.len() as u64 - 1);
    let mut triangles = Vec::new();
    for face in faces {
        let corners = face.list("a list of faces, each a list of vertex numbers", EXAMPLE)?;
        let corners: Vec<_> = corners.map(|corner| corner.integer(0..=last)).collect();
        let corners: Vec<u32> =
            corners.into_iter().map(|corner| u32::try_from(corner?).ok()).collect::<Option<_>>()?;
        if corners.len() < 3 {
            return face.refuse("at least 3 corners", "leave the face out or complete it");
        }
        let before = triangles.len();
        let Some(positions) = positions else { continue };
        let is_sound = triangulate_polygon(&corners, |vertex| positions[vertex as usize], &mut triangles);
        if !is_sound {
            return face.refuse(
                "corners in the order of its outline, which does not cross itself",
                "cut it into faces that do not",
            );
        }
        let has_area = |triangle: &[u32; 3]| !is_degenerate(triangle.map(|index| positions[index as usize]));
        if !triangles[before..].iter().all(has_area) {
            return face.refuse(
                "a face with an area",
                "three of its corners are in one line or the same point: give the corners in order around it",
            );
        }
    }
    Some(triangles)
}

pub(super) fn read_instances(
    tables: Vec<(Table<'_>, f64)>,
    groups: &Names,
) -> Vec<Named<InstanceDescription>> {
    let mut names = Names::new("instance");
    let mut instances = Vec::new();
    for (index, (mut table, unit)) in tables.into_iter().enumerate() {
        let name = read_name(&mut table, &mut names, "instance", index);
        let location = table.location();
        let group = table.required("group", "\"NAME\"", |value| groups.find(value));
        let transform = transform_of(&mut table);
        let offsets = table.or("repeat", vec![DVec3::ZERO], read_repeat);
        table.finish();
        let (Some(name), Some(group), Some(transform), Some(offsets)) = (name, group, transform, offsets)
        else {
            continue;
        };
        for (number, offset) in offsets.iter().enumerate() {
            // The first copy has the name of the table.
            let name = if number == 0 { name.clone() } else { format!("{name} #{}", number + 1) };
            let transform = in_metres(DAffine3::from_translation(*offset) * transform, unit);
            let value = InstanceDescription { group, transform };
            instances.push(Named { name, location: location.clone(), value });
        }
    }
    instances
}

/// Most copies in one `[[instances]]`.
const MOST_COPIES: u64 = 1_000_000;

/// Offsets of the copies of an instance from the first copy, x fastest; lengths in the file's unit.
fn read_repeat(value: Value<'_>) -> Option<Vec<DVec3>> {
    const EXAMPLE: &str = "write for example `repeat = { count = [4, 1, 3], step = [1.0, 0.0, 2.0] }`";
    let mut table = value.table("`repeat`", EXAMPLE)?;
    let count = table.required("count", "[4, 1, 3]", |value| {
        let counts: Vec<_> = value.list("three counts, along x, y and z", "[4, 1, 3]")?.collect();
        let [x, y, z] = counts.as_slice() else {
            return value.refuse("three counts, along x, y and z", EXAMPLE);
        };
        let [x, y, z] = [x, y, z].map(|count| count.integer(1..=MOST_COPIES));
        let count = [x?, y?, z?];
        if count.iter().product::<u64>() > MOST_COPIES {
            return value.refuse(&format!("at most {MOST_COPIES} copies in all"), "ask for fewer copies");
        }
        Some(count)
    });
    let step = table.required("step", "[1.0, 0.0, 2.0]", |value| value.vector(&NUMBER));
    table.finish();
    let ([nx, ny, nz], step) = (count?, step?);
    let along = move |n: u64| (0..n).map(|i| i as f64);
    Some(
        along(nz)
            .flat_map(|z| along(ny).flat_map(move |y| along(nx).map(move |x| DVec3::new(x, y, z) * step)))
            .collect(),
    )
}
