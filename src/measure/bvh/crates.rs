//! Hierarchies of the crates `bvh` and `obvhs`. All use the triangle test of `obvhs` (Moeller & Trumbore 1997 in `f32`, both sides), as the
//! test of `bvh` culls back faces.

use super::tracer::Hit;
use crate::embree::TriangleBuffers;
use crate::math::Ray;
use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::{BHShape, BoundingHierarchy};
use bvh::bvh::{Bvh, BvhNode};
use glam::Vec3A;
use nalgebra::{Point3, Vector3};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{INVALID_ID, Ray as Query, RayHit};
use obvhs::triangle::Triangle;
use std::fmt;
use std::time::Duration;

fn triangles_of(buffers: &TriangleBuffers) -> Vec<Triangle> {
    (0..buffers.triangles().len() as u32)
        .map(|index| {
            let [v0, v1, v2] = buffers.corners(index).map(Vec3A::from_array);
            Triangle { v0, v1, v2 }
        })
        .collect()
}

/// A query that starts just after zero, as Embree's rays do.
fn query(ray: &Ray) -> Query {
    Query::new(ray.origin.into(), ray.direction.into(), f32::MIN_POSITIVE, ray.t_max)
}

/// The binary tree of `obvhs`, with triangles in the order of its leaves.
pub struct Obvhs2 {
    tree: Bvh2,
    triangles: Vec<Triangle>,
}

/// The eight-way tree of `obvhs`, with triangles in the order of its leaves.
pub struct ObvhsWide {
    tree: CwBvh,
    triangles: Vec<Triangle>,
}

macro_rules! obvhs {
    ($name:ident, $build:ident) => {
        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.debug_struct(stringify!($name))
                    .field("triangles", &self.triangles.len())
                    .finish_non_exhaustive()
            }
        }

        impl $name {
            pub(super) fn build(buffers: &TriangleBuffers) -> Self {
                let triangles = triangles_of(buffers);
                let tree = $build(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
                let triangles =
                    tree.primitive_indices.iter().map(|&index| triangles[index as usize]).collect();
                Self { tree, triangles }
            }

            pub(super) fn bytes(&self) -> u64 {
                let nodes = size_of_val(self.tree.nodes.as_slice());
                let indices = size_of_val(self.tree.primitive_indices.as_slice());
                (nodes + indices + size_of_val(self.triangles.as_slice())) as u64
            }

            pub(super) fn trace(&self, any_hit: bool, rays: &[Ray], hits: &mut [Hit]) {
                let test = |ray: &Query, index: usize| self.triangles[index].intersect(ray);
                for (ray, hit) in rays.iter().zip(hits) {
                    let query = query(ray);
                    if any_hit {
                        *hit = (!self.tree.ray_traverse_miss(query, test)).then_some((0, 0.0));
                        continue;
                    }
                    let mut found = RayHit::none();
                    self.tree.ray_traverse(query, &mut found, test);
                    *hit = (found.primitive_id != INVALID_ID)
                        .then(|| (self.tree.primitive_indices[found.primitive_id as usize], found.t));
                }
            }
        }
    };
}

obvhs!(Obvhs2, build_bvh2_from_tris);
obvhs!(ObvhsWide, build_cwbvh_from_tris);

/// A triangle in the form that `bvh` stores.
#[derive(Debug)]
struct Shape {
    triangle: Triangle,
    node: usize,
}

impl Bounded<f32, 3> for Shape {
    fn aabb(&self) -> Aabb<f32, 3> {
        let Triangle { v0, v1, v2 } = self.triangle;
        let point = |p: Vec3A| Point3::new(p.x, p.y, p.z);
        Aabb::with_bounds(point(v0.min(v1).min(v2)), point(v0.max(v1).max(v2)))
    }
}

impl BHShape<f32, 3> for Shape {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// The tree of `bvh`.
#[derive(Debug)]
pub struct BinaryTree {
    tree: Bvh<f32, 3>,
    shapes: Vec<Shape>,
}

impl BinaryTree {
    pub(super) fn build(buffers: &TriangleBuffers) -> Self {
        let mut shapes: Vec<Shape> =
            triangles_of(buffers).into_iter().map(|triangle| Shape { triangle, node: 0 }).collect();
        let tree = Bvh::build_par(&mut shapes);
        Self { tree, shapes }
    }

    pub(super) fn bytes(&self) -> u64 {
        (size_of_val(self.tree.nodes.as_slice()) + size_of_val(self.shapes.as_slice())) as u64
    }

    pub(super) fn trace(&self, own_order: bool, any_hit: bool, rays: &[Ray], hits: &mut [Hit]) {
        let mut stack = Vec::new();
        for (ray, hit) in rays.iter().zip(hits) {
            let direction = Vector3::from(ray.direction.to_array());
            // `Ray::new` would normalize the direction, but shadow rays are segments.
            let boxes = bvh::ray::Ray {
                origin: Point3::from(ray.origin.to_array()),
                direction,
                inv_direction: direction.map(|x| 1.0 / x),
            };
            let mut query = query(ray);
            *hit = if own_order {
                self.walk(&boxes, &mut query, any_hit, &mut stack)
            } else if any_hit {
                let mut met = self.tree.traverse_iterator(&boxes, &self.shapes);
                met.any(|shape| shape.triangle.intersect(&query) < query.tmax).then_some((0, 0.0))
            } else {
                self.nearest_by_iterator(&boxes, &mut query)
            };
        }
    }

    /// The nearest hit from the iterator that yields shapes in the order of their boxes. It stops at the first box behind the hit.
    fn nearest_by_iterator(&self, boxes: &bvh::ray::Ray<f32, 3>, query: &mut Query) -> Hit {
        let mut nearest: Option<(&Shape, f32)> = None;
        for shape in self.tree.nearest_traverse_iterator(boxes, &self.shapes) {
            let entry = boxes.intersection_slice_for_aabb(&shape.aabb());
            if entry.is_some_and(|(entry, _)| entry > query.tmax) {
                break;
            }
            let t = shape.triangle.intersect(query);
            if t < query.tmax {
                query.tmax = t;
                nearest = Some((shape, t));
            }
        }
        let (shape, t) = nearest?;
        match self.tree.nodes[shape.node] {
            BvhNode::Leaf { shape_index, .. } => Some((shape_index as u32, t)),
            BvhNode::Node { .. } => None,
        }
    }

    /// Traversal that visits the nearer child first and skips boxes behind the hit.
    fn walk(
        &self,
        boxes: &bvh::ray::Ray<f32, 3>,
        query: &mut Query,
        any_hit: bool,
        stack: &mut Vec<(usize, f32)>,
    ) -> Hit {
        let mut nearest = None;
        stack.clear();
        stack.push((0, 0.0));
        while let Some((node, entry)) = stack.pop() {
            if entry > query.tmax {
                continue;
            }
            match &self.tree.nodes[node] {
                BvhNode::Leaf { shape_index, .. } => {
                    let t = self.shapes[*shape_index].triangle.intersect(query);
                    if t < query.tmax {
                        query.tmax = t;
                        nearest = Some((*shape_index as u32, t));
                        if any_hit {
                            return Some((0, 0.0));
                        }
                    }
                }
                BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } => {
                    let entry = |aabb| boxes.intersection_slice_for_aabb(aabb).map(|(entry, _)| entry);
                    let (left, right) = (entry(child_l_aabb), entry(child_r_aabb));
                    let left = left.map(|entry| (*child_l_index, entry));
                    let right = right.map(|entry| (*child_r_index, entry));
                    let right_is_nearer = match (left, right) {
                        (Some((_, left)), Some((_, right))) => right < left,
                        _ => false,
                    };
                    // The nearer child is pushed last, so that it is visited next.
                    let order = if right_is_nearer { [left, right] } else { [right, left] };
                    stack.extend(order.into_iter().flatten());
                }
            }
        }
        nearest
    }
}
