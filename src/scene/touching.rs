//! Search for places where surfaces may touch: boxes around all places where an interface between media or a flat emitter is within
//! rounding of another surface. Additional boxes cost time, but a missing one would lose a surface; all bounds are therefore wide.

use super::parts::{Geometry, Node, SceneParts, Surface};
use super::surface::{HitPoint, Placement};
use crate::lights::Light;
use crate::math::{Bounds3, unit_f64};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Result of the search.
pub(super) struct Touching {
    /// For each surface, the boxes in which it may touch another one.
    pub boxes: Vec<Vec<Bounds3>>,
    /// Half the length of a segment that meets all surfaces that touch at its centre, with some room.
    pub reach: f32,
    /// Bound on the distance of surfaces that touch.
    pub distance: f32,
    /// Surfaces that may touch, each pair once.
    pub pairs: Vec<[u32; 2]>,
}

/// A surface with its placement in the scene.
struct Object<'a> {
    surface: u32,
    geometry: &'a Geometry,
    placement: Option<&'a Placement>,
    bounds: Bounds3,
    kind: Kind,
}

/// The property that makes contacts of a surface relevant.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// None: contacts matter only if the other surface has one of these properties.
    Plain,
    /// It is a flat emitter.
    Emitter,
    /// It is an interface between media somewhere.
    Border,
}

/// A box in the search for overlaps.
#[derive(Clone, Copy)]
struct Item {
    min: Vec3,
    max: Vec3,
    /// Number of the object.
    object: u32,
    /// Number of the primitive; unused for whole objects.
    primitive: u32,
    kind: Kind,
}

impl Item {
    fn overlaps(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }
}

/// Room for rounding around compared boxes, render space. No error of a hit is larger, except on shapes much larger than the scene's own
/// radius, which are not part of the scene.
const ROOM: f64 = 64.0 * f32::EPSILON as f64;

/// `None` where nothing touches.
pub(super) fn find_touching(parts: &SceneParts) -> Option<Touching> {
    let kind_of = |surface: &Surface| {
        if surface.all_materials().any(|id| parts.materials[id as usize].1.media().is_some()) {
            return Kind::Border;
        }
        match surface.light.map(|id| &parts.lights[id as usize]) {
            Some(Light::Area(light)) if light.is_flat() => Kind::Emitter,
            _ => Kind::Plain,
        }
    };
    if !parts.surfaces.iter().any(|surface| kind_of(surface) != Kind::Plain) {
        return None;
    }
    let objects = objects_of(parts, kind_of);
    let wholes: Vec<Item> =
        (0u32..).zip(&objects).map(|(number, object)| item(&object.bounds, number, 0, object.kind)).collect();
    // Candidate pairs of objects; a mesh may touch itself.
    let mut partners: Vec<Vec<u32>> = vec![Vec::new(); objects.len()];
    for [a, b] in join(&wholes, &|a, b| vec![[a.object, b.object]]) {
        partners[a as usize].push(b);
        partners[b as usize].push(a);
    }
    for (number, object) in objects.iter().enumerate() {
        if object.kind == Kind::Border && matches!(object.geometry, Geometry::Mesh(_)) {
            partners[number].push(number as u32);
        }
    }
    let items: Vec<Item> = objects
        .par_iter()
        .enumerate()
        .flat_map_iter(|(number, object)| {
            let near = partners[number].iter().map(|&other| wholes[other as usize]).collect::<Vec<_>>();
            object.items(number as u32, near)
        })
        .collect();
    let found = join(&items, &|a, b| {
        if a.object == b.object && a.kind != Kind::Border {
            return Vec::new();
        }
        let (one, other) = (&objects[a.object as usize], &objects[b.object as usize]);
        let places = one.touches(a.primitive, other, b.primitive);
        places.into_iter().map(|(place, room)| (one.surface, other.surface, place, room)).collect()
    });
    let distance = found.iter().map(|(_, _, _, room)| *room).fold(0.0, f64::max);
    if found.is_empty() {
        return None;
    }
    let mut boxes = vec![Vec::new(); parts.surfaces.len()];
    let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(found.len());
    for (a, b, place, _) in found {
        boxes[a as usize].push(place);
        if a != b {
            boxes[b as usize].push(place);
        }
        pairs.push([a.min(b), a.max(b)]);
    }
    pairs.sort_unstable();
    pairs.dedup();
    // The starting point of the segment is rounded as well.
    let reach = (2.0 * distance + ROOM) as f32;
    Some(Touching { boxes, reach, distance: distance as f32, pairs })
}

fn item(bounds: &Bounds3, object: u32, primitive: u32, kind: Kind) -> Item {
    let (min, max) = grown(bounds, ROOM).to_f32_outward();
    Item { min: min.into(), max: max.into(), object, primitive, kind }
}

fn grown(bounds: &Bounds3, by: f64) -> Bounds3 {
    Bounds3 { min: bounds.min - by, max: bounds.max + by }
}

fn objects_of<'a>(parts: &'a SceneParts, kind_of: impl Fn(&Surface) -> Kind + Sync) -> Vec<Object<'a>> {
    // A prototype's surfaces extend to the first surface of the next node.
    let mut firsts: Vec<u32> = parts
        .nodes
        .iter()
        .map(|node| match node {
            Node::Surface(index) => *index,
            Node::Instance { first, .. } => *first,
        })
        .collect();
    firsts.push(parts.surfaces.len() as u32);
    firsts.sort_unstable();
    let end_of = |first: u32| firsts[firsts.partition_point(|&other| other <= first).min(firsts.len() - 1)];
    let placed = parts.nodes.iter().flat_map(|node| {
        let (range, placement) = match node {
            Node::Surface(index) => (*index..index + 1, None),
            Node::Instance { first, placement } => (*first..end_of(*first), Some(&**placement)),
        };
        range.map(move |surface| (surface, placement))
    });
    let placed: Vec<_> = placed.collect();
    placed
        .into_par_iter()
        .map(|(surface, placement)| {
            let whole = &parts.surfaces[surface as usize];
            let own = match &whole.geometry {
                Geometry::Mesh(mesh) => {
                    let triangles = 0..mesh.buffers.triangles().len() as u32;
                    triangles.fold(Bounds3::EMPTY, |all, id| all.union(around(mesh.buffers.corners(id))))
                }
                Geometry::Procedural(object) => {
                    (0..object.primitive_count()).fold(Bounds3::EMPTY, |all, id| all.union(object.bounds(id)))
                }
            };
            let bounds = placement.map_or(own, |placement| own.transformed(&placement.to_world));
            Object { surface, geometry: &whole.geometry, placement, bounds, kind: kind_of(whole) }
        })
        .collect()
}

fn around(corners: [[f32; 3]; 3]) -> Bounds3 {
    Bounds3::of_points(corners.map(|corner| Vec3::from_array(corner).as_dvec3()))
}

impl Object<'_> {
    /// Its primitives that come close to one of the boxes.
    fn items(&self, number: u32, near: Vec<Item>) -> Vec<Item> {
        if near.is_empty() {
            return Vec::new();
        }
        let count = match self.geometry {
            Geometry::Mesh(mesh) => mesh.buffers.triangles().len() as u32,
            Geometry::Procedural(object) => object.primitive_count(),
        };
        let near = match near.len() {
            0..8 => near,
            _ => vec![Item {
                min: near.iter().fold(Vec3::INFINITY, |all, item| all.min(item.min)),
                max: near.iter().fold(Vec3::NEG_INFINITY, |all, item| all.max(item.max)),
                ..near[0]
            }],
        };
        (0..count)
            .map(|primitive| item(&self.primitive_bounds(primitive), number, primitive, self.kind))
            .filter(|item| near.iter().any(|other| item.overlaps(other)))
            .collect()
    }

    fn primitive_bounds(&self, primitive: u32) -> Bounds3 {
        match self.geometry {
            Geometry::Mesh(_) => self.corners(primitive).map_or(Bounds3::EMPTY, Bounds3::of_points),
            Geometry::Procedural(object) => {
                let own = object.bounds(primitive);
                self.placement.map_or(own, |placement| own.transformed(&placement.to_world))
            }
        }
    }

    /// Corners of a triangle in render space; `None` for other shapes.
    fn corners(&self, primitive: u32) -> Option<[DVec3; 3]> {
        let Geometry::Mesh(mesh) = self.geometry else { return None };
        let corners = mesh.buffers.corners(primitive).map(|corner| Vec3::from_array(corner).as_dvec3());
        Some(match self.placement {
            Some(placement) => corners.map(|corner| placement.to_world.transform_point3(corner)),
            None => corners,
        })
    }

    /// Bound on the error of hits on a triangle.
    fn error(&self, primitive: u32) -> f64 {
        let Geometry::Mesh(mesh) = self.geometry else { return ROOM };
        let corners = mesh.buffers.corners(primitive);
        // The bound depends only weakly on the position, and is largest at a corner.
        let at = |uv| {
            let point = HitPoint::on_triangle(corners, uv)?;
            Some(self.placement.map_or(point, |placement| point.transformed(placement)).offset)
        };
        let errors = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].into_iter().filter_map(at);
        f64::from(errors.fold(0.0, f32::max))
    }

    /// Boxes in which primitive `own` may touch primitive `its` of another object, each with the largest distance between them there.
    fn touches(&self, own: u32, other: &Object<'_>, its: u32) -> Vec<(Bounds3, f64)> {
        match (self.corners(own), other.corners(its)) {
            (Some(a), Some(b)) => {
                if is_apart(a, b) || is_apart(b, a) {
                    return Vec::new();
                }
                let room = self.error(own) + other.error(its);
                overlap_of_triangles(a, b, room)
                    .map(|place| (grown(&place, room), room))
                    .into_iter()
                    .collect()
            }
            _ => {
                let [a, b] =
                    [grown(&self.primitive_bounds(own), ROOM), grown(&other.primitive_bounds(its), ROOM)];
                let overlap = Bounds3 { min: a.min.max(b.min), max: a.max.min(b.max) };
                let may_be_in =
                    |region: &Bounds3| self.may_be_in(own, region) && other.may_be_in(its, region);
                divided(overlap, may_be_in).into_iter().map(|place| (place, ROOM)).collect()
            }
        }
    }

    /// Returns `false` only where no point of the primitive is in the box.
    fn may_be_in(&self, primitive: u32, region: &Bounds3) -> bool {
        match self.geometry {
            Geometry::Mesh(_) => self
                .corners(primitive)
                .is_some_and(|corners| triangle_may_be_in(corners, &grown(region, ROOM))),
            Geometry::Procedural(object) => {
                let region = grown(region, ROOM);
                let own = self.placement.map_or(region, |placement| region.transformed(&placement.to_object));
                Arc::as_ref(object).may_be_in(primitive, &own)
            }
        }
    }
}

/// Whether a triangle may intersect a box, judged by its plane and its own bounding box.
fn triangle_may_be_in([a, b, c]: [DVec3; 3], region: &Bounds3) -> bool {
    let own = Bounds3::of_points([a, b, c]);
    let overlaps = own.min.cmple(region.max).all() && region.min.cmple(own.max).all();
    let normal = (b - a).cross(c - a);
    let half = 0.5 * (region.max - region.min);
    overlaps && normal.dot(region.min + half - a).abs() <= normal.abs().dot(half)
}

/// The parts of a box that may contain both shapes. Parts are halved repeatedly as long as they are few and larger than rounding.
fn divided(whole: Bounds3, may_be_in: impl Fn(&Bounds3) -> bool) -> Vec<Bounds3> {
    const MANY: usize = 256;
    const STEPS: u32 = 48;
    let mut parts = Vec::new();
    if !whole.is_empty() && may_be_in(&whole) {
        parts.push(whole);
    }
    for _ in 0..STEPS {
        let largest = parts.iter().map(|part| (part.max - part.min).max_element()).fold(0.0, f64::max);
        if parts.is_empty() || parts.len() > MANY || largest < 4.0 * ROOM {
            break;
        }
        let halves = parts.iter().flat_map(|part| {
            let extent = (part.max - part.min).to_array();
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
            let middle = part.center()[axis];
            let (mut low, mut high) = (*part, *part);
            low.max[axis] = middle;
            high.min[axis] = middle;
            [low, high]
        });
        parts = halves.filter(&may_be_in).collect();
    }
    parts
}

/// Quick test that triangle `b` shares no area with `a`: it lies beyond an edge, as neighbours do, or off the plane.
fn is_apart(a: [DVec3; 3], b: [DVec3; 3]) -> bool {
    let normal = (a[1] - a[0]).cross(a[2] - a[0]);
    let room = ROOM * normal.length();
    let heights = b.map(|p| normal.dot(p - a[0]));
    let is_beyond = |i: usize| {
        let (p, edge) = (a[i], a[(i + 1) % 3] - a[i]);
        let out = edge.cross(normal);
        // Allows only for the rounding of this comparison: neighbours touch exactly.
        let least = -1e-12 * out.length() * edge.length();
        b.iter().all(|q| out.dot(q - p) >= least)
    };
    heights.iter().all(|height| *height > room)
        || heights.iter().all(|height| *height < -room)
        || (0..3).any(is_beyond)
}

/// Overlap of two triangles that lie within `room` of one plane, over an area and not just a line. `None` for triangles that only share
/// an edge, or that cross.
fn overlap_of_triangles(a: [DVec3; 3], b: [DVec3; 3], room: f64) -> Option<Bounds3> {
    /// Largest sine between the planes: at a larger angle the planes are within rounding only along a line.
    const STEEPEST: f64 = 1.0 / 16.0;
    let normal_of = |[p, q, r]: [DVec3; 3]| unit_f64((q - p).cross(r - p));
    let (normal, other) = (normal_of(a)?, normal_of(b)?);
    if normal.cross(other).length() > STEEPEST {
        return None;
    }
    let mut polygon: Vec<DVec3> = b.to_vec();
    let mut clip = |out: DVec3, limit: f64| {
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (i, &p) in polygon.iter().enumerate() {
            let q = polygon[(i + 1) % polygon.len()];
            let (hp, hq) = (out.dot(p) - limit, out.dot(q) - limit);
            if hp <= 0.0 {
                kept.push(p);
            }
            if (hp < 0.0 && hq > 0.0) || (hp > 0.0 && hq < 0.0) {
                kept.push(p + (q - p) * (hp / (hp - hq)));
            }
        }
        polygon = kept;
    };
    for i in 0..3 {
        let (p, q) = (a[i], a[(i + 1) % 3]);
        let out = unit_f64((q - p).cross(normal))?;
        clip(out, out.dot(p));
    }
    clip(normal, normal.dot(a[0]) + room);
    clip(-normal, room - normal.dot(a[0]));
    let [first, ref rest @ ..] = polygon[..] else { return None };
    let area: f64 =
        rest.windows(2).map(|pair| 0.5 * (pair[0] - first).cross(pair[1] - first).dot(normal)).sum();
    let length = rest.iter().map(|p| (p - first).length()).fold(0.0, f64::max);
    // A polygon narrower than rounding counts as a line.
    (area.abs() > room * length).then(|| Bounds3::of_points(polygon.iter().copied()))
}

/// Results of `found` for each pair of overlapping items of which at least one is not plain; the same in every run.
fn join<T: Send>(items: &[Item], found: &(impl Fn(&Item, &Item) -> Vec<T> + Sync)) -> Vec<T> {
    let is_somewhere = |id: &u32| items[*id as usize].min.cmple(items[*id as usize].max).all();
    let all: Vec<u32> = (0..items.len() as u32).filter(is_somewhere).collect();
    join_within(items, &all, (Vec3::NEG_INFINITY, Vec3::INFINITY), 0, found)
}

fn join_within<T: Send>(
    items: &[Item],
    members: &[u32],
    cell: (Vec3, Vec3),
    depth: u32,
    found: &(impl Fn(&Item, &Item) -> Vec<T> + Sync),
) -> Vec<T> {
    /// Up to this number, all pairs are compared.
    const FEW: usize = 16;
    /// From this number on, a second thread is worthwhile.
    const MANY: usize = 1024;
    const DEEPEST: u32 = 64;
    if members.len() < 2 || !members.iter().any(|&id| items[id as usize].kind != Kind::Plain) {
        return Vec::new();
    }
    if members.len() > FEW
        && depth < DEEPEST
        && let Some((axis, middle, low, high)) = halves(items, members)
    {
        let (mut low_cell, mut high_cell) = (cell, cell);
        low_cell.1[axis] = middle;
        high_cell.0[axis] = middle;
        let of_low = || join_within(items, &low, low_cell, depth + 1, found);
        let of_high = || join_within(items, &high, high_cell, depth + 1, found);
        let (mut all, rest) =
            if members.len() > MANY { rayon::join(of_low, of_high) } else { (of_low(), of_high()) };
        all.extend(rest);
        return all;
    }
    let mut all = Vec::new();
    for (i, &a) in members.iter().enumerate() {
        for &b in &members[i + 1..] {
            let (a, b) = (&items[a as usize], &items[b as usize]);
            if a.kind == Kind::Plain && b.kind == Kind::Plain || !a.overlaps(b) {
                continue;
            }
            // A pair that lies in several cells belongs to the cell with the lower corner of the pair's overlap.
            let corner = a.min.max(b.min);
            if corner.cmpge(cell.0).all() && corner.cmplt(cell.1).all() {
                all.extend(found(a, b));
            }
        }
    }
    all
}

/// An axis, a position on it, and the members below and above it, where each side has clearly fewer members. Members that cross the
/// position are in both.
fn halves(items: &[Item], members: &[u32]) -> Option<(usize, f32, Vec<u32>, Vec<u32>)> {
    let center = |id: u32| 0.5 * (items[id as usize].min + items[id as usize].max);
    let (low, high) = members.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &id| {
        (low.min(center(id)), high.max(center(id)))
    });
    let middle = members.iter().map(|&id| center(id).as_dvec3()).sum::<DVec3>() / members.len() as f64;
    let (spread, middle) = (high - low, middle.as_vec3());
    let mut axes = [0, 1, 2];
    axes.sort_unstable_by(|&a, &b| spread[b].total_cmp(&spread[a]));
    axes.into_iter().find_map(|axis| {
        let at = middle[axis];
        let below =
            members.iter().copied().filter(|&id| items[id as usize].min[axis] < at).collect::<Vec<_>>();
        let above =
            members.iter().copied().filter(|&id| items[id as usize].max[axis] >= at).collect::<Vec<_>>();
        (below.len().max(above.len()) * 8 <= members.len() * 7).then_some((axis, at, below, above))
    })
}
