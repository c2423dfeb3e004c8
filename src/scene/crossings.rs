//! All crossings of a ray with surfaces, each crossing once.

use super::parts::{Geometry, Node};
use super::scene::Scene;
use super::surface::Placement;
use crate::embree::{AllHits, RawHit, TriangleBuffers};
use crate::math::Ray;
use crate::math::rounding::UNIT_ROUNDOFF;
use glam::DVec3;

/// Buffers for the crossings of one ray, reused for every ray.
#[derive(Debug, Default)]
pub struct Crossings {
    found: AllHits,
    kept: Vec<RawHit>,
    facets: Vec<Option<Facet>>,
    merged: u64,
}

impl Crossings {
    /// Keeps at most `limit` hits of a ray, the nearest ones.
    pub fn with_limit(limit: usize) -> Self {
        Self { found: AllHits::with_limit(limit), ..Self::default() }
    }

    /// The crossings of the last ray, sorted by (parameter, instance, geometry, primitive).
    pub fn hits(&self) -> &[RawHit] {
        &self.kept
    }

    /// Hits of the last ray that were merged with another hit of the same crossing: of triangles that share the edge or corner through
    /// which the ray passes.
    pub fn merged(&self) -> u64 {
        self.merged
    }

    /// Hits of the last ray that exceeded the limit.
    pub fn dropped(&self) -> u64 {
        self.found.dropped()
    }
}

/// A triangle and a ray that hits it, in the triangle's own space.
#[derive(Clone, Copy, Debug)]
struct Facet {
    /// Corners as stored, so that equal corners are equal numbers.
    corners: [[f32; 3]; 3],
    origin: DVec3,
    direction: DVec3,
    /// Whether the ray arrives on the front, as defined by winding.
    front: bool,
    /// Longest edge, in units of the ray parameter.
    span: f64,
}

impl Facet {
    fn new(buffers: &TriangleBuffers, primitive: u32, ray: &Ray, placement: Option<&Placement>) -> Self {
        let corners = buffers.corners(primitive);
        let local = placement.map_or(*ray, |placement| placement.ray_to_object(ray));
        let (origin, direction) = (local.origin.as_dvec3(), local.direction.as_dvec3());
        let [a, b, c] = corners.map(point);
        let front = (b - a).cross(c - a).dot(direction) < 0.0;
        let extent = (b - a).length().max((c - a).length()).max((c - b).length());
        Self { corners, origin, direction, front, span: extent / direction.length() }
    }

    /// Whether the ray crosses `other`, a triangle of the same mesh, at the same crossing.
    ///
    /// Two triangles on opposite sides of a shared edge, as seen along the ray, can both be hit only where the ray passes through that
    /// edge, to within rounding; no tolerance is needed. If they lie on the same side, the surface is folded and the ray crosses it
    /// twice. If they share only a corner, the ray must pass through that corner.
    fn is_same_crossing(&self, other: &Self) -> bool {
        let mut shared = [(0, 0); 3];
        let mut count = 0;
        for (i, corner) in self.corners.iter().enumerate() {
            if let Some(j) = other.corners.iter().position(|c| c == corner) {
                shared[count] = (i, j);
                count += 1;
            }
        }
        match count {
            2 => {
                let [(i, k), (j, l), _] = shared;
                let (p, q) = (point(self.corners[i]), point(self.corners[j]));
                let side = |apex: [f32; 3]| (q - p).cross(point(apex) - p).dot(self.direction);
                side(self.corners[3 - i - j]) * side(other.corners[(6 - k - l) % 3]) < 0.0
            }
            1 => self.front == other.front && self.passes_through(point(self.corners[shared[0].0])),
            _ => false,
        }
    }

    /// Whether the ray passes through `corner`, to within the rounding of Embree's test, which moves corners to the ray's origin.
    fn passes_through(&self, corner: DVec3) -> bool {
        const ROUNDINGS: f64 = 16.0;
        let offset = corner - self.origin;
        let distance = offset.cross(self.direction).length() / self.direction.length();
        let size = offset.abs().max_element() + self.origin.abs().max_element();
        distance <= ROUNDINGS * f64::from(UNIT_ROUNDOFF) * size
    }
}

fn point(corner: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(corner).as_dvec3()
}

impl Scene {
    /// Finds every crossing of `ray`, whose direction must have unit length, with a surface, in order. A crossing at an edge or corner
    /// that triangles of a mesh share counts once. [`Scene::interaction`] gives the details of a crossing.
    pub fn intersect_all(&self, ray: &Ray, crossings: &mut Crossings) {
        let Crossings { found, kept, facets, merged } = crossings;
        self.embree().intersect_all(ray, found);
        kept.clear();
        *merged = 0;
        let hits = found.sorted();
        if hits.len() < 2 {
            kept.extend_from_slice(hits);
            return;
        }
        facets.clear();
        facets.extend(hits.iter().map(|hit| self.facet(ray, hit)));
        for (i, hit) in hits.iter().enumerate() {
            // A hit of the same crossing precedes this one by at most the extent of the triangles.
            let is_new = facets[i].is_none_or(|facet| {
                !(0..i).rev().any(|j| {
                    let is_same_mesh = hits[j].geometry == hit.geometry && hits[j].instance == hit.instance;
                    is_same_mesh
                        && facets[j].is_some_and(|earlier| {
                            f64::from(hit.t) - f64::from(hits[j].t) <= earlier.span.max(facet.span)
                                && facet.is_same_crossing(&earlier)
                        })
                })
            });
            if is_new { kept.push(*hit) } else { *merged += 1 }
        }
    }

    fn facet(&self, ray: &Ray, hit: &RawHit) -> Option<Facet> {
        let (index, placement) = match self.nodes().get(hit.instance.unwrap_or(hit.geometry) as usize)? {
            Node::Surface(index) => (*index, None),
            Node::Instance { first, placement } => (first + hit.geometry, Some(&**placement)),
        };
        match &self.surfaces().get(index as usize)?.geometry {
            Geometry::Mesh(mesh) => Some(Facet::new(&mesh.buffers, hit.primitive, ray, placement)),
            Geometry::Procedural(_) => None,
        }
    }
}
