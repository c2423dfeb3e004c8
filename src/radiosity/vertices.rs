//! Colours at the corners of patches, for interpolation over the patches (Gouraud 1971).

use super::PatchIrradiance;
use super::domain::{Domain, Local};
use super::model::{Element, Model, NONE};
use crate::math::Rgb;
use crate::scene::{Geometry, Scene};
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// Least cosine between the normals of triangles whose patches share a corner: where a mesh has normals at its vertices, and where it has
/// none and shows its edges.
const SMOOTH: f64 = 0.5;
const FLAT: f64 = 0.999;

/// Most times that an edge is searched for corners of smaller neighbours.
const DEEPEST: u32 = 24;

/// Values at the corners of patches.
#[derive(Clone, Debug, Default)]
pub(super) struct Vertices {
    /// By element: its corners; [`NONE`] where there is none. Empty for elements that are divided.
    corners: Vec<[u32; 4]>,
    values: Vec<PatchIrradiance>,
    /// Outlines of patches that have corners of smaller neighbours on their edges.
    rings: HashMap<u32, Vec<(Corner, u32)>>,
}

/// A corner: where it is, on which side of which surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Place {
    surface: u32,
    back: bool,
    /// Chart, or [`NONE`] for a triangle.
    chart: u32,
    /// Coordinates to the bit: of a chart, or in space.
    at: [u64; 3],
}

/// A corner of a patch before it has a number.
#[derive(Clone, Copy, Debug)]
pub(super) enum Corner {
    Space(DVec3),
    Chart(DVec2),
}

impl Corner {
    fn middle(self, other: Self) -> Self {
        match (self, other) {
            (Self::Space(a), Self::Space(b)) => Self::Space(0.5 * (a + b)),
            (Self::Chart(a), Self::Chart(b)) => Self::Chart(0.5 * (a + b)),
            (Self::Space(_), Self::Chart(_)) | (Self::Chart(_), Self::Space(_)) => self,
        }
    }

    fn place(self, model: &Model, element: &Element) -> Place {
        let Element { surface, back, .. } = *element;
        // Zero has two signs.
        let bits = |x: f64| (x + 0.0).to_bits();
        match (self, element.domain) {
            (Self::Chart(at), Domain::Rectangle { chart, .. }) => {
                let shape = &model.charts[chart as usize];
                // The ends of the azimuth meet, and at the poles of a sphere all of them.
                let round = shape.goes_round() && at.x >= 1.0;
                let pole =
                    matches!(shape, crate::shapes::Chart::Sphere { .. }) && (at.y <= 0.0 || at.y >= 1.0);
                let x = if round || pole { 0.0 } else { at.x };
                Place { surface, back, chart, at: [bits(x), bits(at.y), 0] }
            }
            (Self::Space(p), _) => Place { surface, back, chart: NONE, at: p.to_array().map(bits) },
            (Self::Chart(at), Domain::Triangle { .. }) => {
                Place { surface, back, chart: NONE, at: [bits(at.x), bits(at.y), 0] }
            }
        }
    }
}

/// The corners of a domain, in the order of [`Local::weights`].
pub(super) fn corners_of(domain: &Domain) -> Vec<Corner> {
    match *domain {
        Domain::Triangle { corners } => corners.into_iter().map(Corner::Space).collect(),
        Domain::Rectangle { low, high, .. } => {
            let all = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
            all.into_iter().map(Corner::Chart).collect()
        }
    }
}

/// Patches that share a corner and whose normals are close.
struct Group {
    normal: DVec3,
    sum: [DVec3; 2],
    count: f64,
    /// The next group at the same place, or [`NONE`].
    next: u32,
}

/// The groups at all places.
#[derive(Default)]
struct Groups {
    first: HashMap<Place, u32>,
    all: Vec<Group>,
}

impl Groups {
    fn find(&self, place: &Place, normal: DVec3, least: f64) -> Option<u32> {
        let mut index = *self.first.get(place)?;
        while index != NONE {
            let group = &self.all[index as usize];
            if group.normal.dot(normal) >= least {
                return Some(index);
            }
            index = group.next;
        }
        None
    }

    fn find_or_add(&mut self, place: Place, normal: DVec3, least: f64) -> u32 {
        if let Some(index) = self.find(&place, normal, least) {
            return index;
        }
        let index = self.all.len() as u32;
        let next = self.first.insert(place, index).unwrap_or(NONE);
        self.all.push(Group { normal, sum: [DVec3::ZERO; 2], count: 0.0, next });
        index
    }
}

impl Vertices {
    /// Values at corners: means over the patches around each. `at_corners` has, by element, the value at each of its corners.
    pub(super) fn new(scene: &Scene, model: &Model, at_corners: &[[PatchIrradiance; 4]]) -> Self {
        let least =
            |element: &Element| match (&element.domain, &scene.surfaces()[element.surface as usize].geometry)
            {
                // A chart has no edges inside.
                (Domain::Rectangle { .. }, _) => -2.0,
                (Domain::Triangle { .. }, Geometry::Mesh(mesh)) if mesh.normals.is_some() => SMOOTH,
                (Domain::Triangle { .. }, _) => FLAT,
            };
        let mut groups = Groups::default();
        let mut corners = vec![[NONE; 4]; model.elements.len()];
        for (index, element) in model.elements.iter().enumerate().filter(|(_, e)| e.children == NONE) {
            for (number, corner) in corners_of(&element.domain).into_iter().enumerate() {
                let place = corner.place(model, element);
                let group = groups.find_or_add(place, element.normal, least(element));
                corners[index][number] = group;
                let group = &mut groups.all[group as usize];
                // A patch that nothing reaches lies under what stands on it, and must not darken the patches beside it.
                let value = at_corners[index][number];
                if value.total() == Rgb::ZERO {
                    continue;
                }
                group.sum[0] += value.direct.as_dvec3();
                group.sum[1] += value.indirect.as_dvec3();
                group.count += 1.0;
            }
        }
        let mut values: Vec<PatchIrradiance> = groups
            .all
            .iter()
            .map(|group| PatchIrradiance {
                direct: (group.sum[0] / group.count.max(1.0)).as_vec3(),
                indirect: (group.sum[1] / group.count.max(1.0)).as_vec3(),
            })
            .collect();
        // Where smaller patches meet the edge of a larger one, their corners take its value, so that the picture has no seams. Large
        // patches come first.
        let mut order: Vec<(u32, u32)> = (0..model.elements.len() as u32)
            .filter(|&index| model.elements[index as usize].children == NONE)
            .map(|index| (level(model, index), index))
            .collect();
        order.sort_unstable();
        let mut rings = HashMap::new();
        for (_, index) in order {
            let element = &model.elements[index as usize];
            let outline = corners_of(&element.domain);
            let ids = &corners[index as usize];
            let mut ring = Vec::with_capacity(outline.len());
            for i in 0..outline.len() {
                let j = (i + 1) % outline.len();
                let mut edges = vec![((outline[i], ids[i]), (outline[j], ids[j]), 0)];
                while let Some((a, b, depth)) = edges.pop() {
                    let middle = a.0.middle(b.0);
                    let place = middle.place(model, element);
                    let found = groups.find(&place, element.normal, least(element));
                    let Some(id) = found.filter(|&id| depth < DEEPEST && id != a.1 && id != b.1) else {
                        ring.push(a);
                        continue;
                    };
                    values[id as usize] = mean(values[a.1 as usize], values[b.1 as usize]);
                    // The first half is taken next, so that the ring is in order.
                    edges.push(((middle, id), b, depth + 1));
                    edges.push((a, (middle, id), depth + 1));
                }
            }
            if ring.len() > outline.len() {
                rings.insert(index, ring);
            }
        }
        Self { corners, values, rings }
    }

    /// Values at all corners, in an order that follows from the patches.
    pub(super) fn values(&self) -> &[PatchIrradiance] {
        &self.values
    }

    /// Replaces all values; false where their number is another.
    pub(super) fn set_values(&mut self, values: Vec<PatchIrradiance>) -> bool {
        let fits = values.len() == self.values.len();
        if fits {
            self.values = values;
        }
        fits
    }

    /// The corners of a patch in order, with those of smaller neighbours on its edges.
    pub(super) fn outline(&self, model: &Model, patch: u32) -> Vec<(Corner, u32)> {
        if let Some(ring) = self.rings.get(&patch) {
            return ring.clone();
        }
        let corners = corners_of(&model.elements[patch as usize].domain);
        corners.into_iter().zip(self.corners[patch as usize]).collect()
    }

    /// The value at a corner.
    pub(super) fn value(&self, corner: u32) -> PatchIrradiance {
        self.values.get(corner as usize).copied().unwrap_or_default()
    }

    /// The value in the middle of a patch with so many corners.
    pub(super) fn middle(&self, patch: u32, corners: usize) -> PatchIrradiance {
        let mut sum = PatchIrradiance::default();
        for &corner in &self.corners[patch as usize][..corners] {
            let value = self.value(corner);
            sum.direct += value.direct / corners as f32;
            sum.indirect += value.indirect / corners as f32;
        }
        sum
    }

    /// The value at a place inside a patch.
    pub(super) fn interpolate(&self, patch: u32, local: Local) -> PatchIrradiance {
        let mut sum = PatchIrradiance::default();
        for (&corner, weight) in self.corners[patch as usize].iter().zip(local.weights()) {
            if let Some(value) = self.values.get(corner as usize) {
                sum.direct += value.direct * weight as f32;
                sum.indirect += value.indirect * weight as f32;
            }
        }
        sum
    }
}

fn mean(a: PatchIrradiance, b: PatchIrradiance) -> PatchIrradiance {
    PatchIrradiance { direct: 0.5 * (a.direct + b.direct), indirect: 0.5 * (a.indirect + b.indirect) }
}

/// Number of divisions that lead to an element.
fn level(model: &Model, mut index: u32) -> u32 {
    let mut level = 0;
    while model.elements[index as usize].parent != NONE {
        index = model.elements[index as usize].parent;
        level += 1;
    }
    level
}
