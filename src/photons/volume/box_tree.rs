//! Boxes around the blocks of a kd-tree, for searches along lines.

use glam::Vec3;

/// Corners of a box, lowest first.
pub(super) type Bounds = [Vec3; 2];

/// A balanced tree of boxes over blocks in the order of a [`super::super::kd_tree::KdTree`]: the same halves, so that indices follow from
/// counts.
#[derive(Clone, Debug)]
pub(super) struct BoxTree {
    /// The box of the node whose halves are blocks up to `i` and from `i + 1`.
    inner: Vec<Bounds>,
    leaves: Vec<Bounds>,
}

/// Depth of the largest tree.
const MAX_DEPTH: usize = 33;

fn union(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl BoxTree {
    /// Over leaves with these boxes.
    pub(super) fn new(leaves: Vec<Bounds>) -> Self {
        let empty = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let mut tree = Self { inner: vec![empty; leaves.len().saturating_sub(1)], leaves };
        if !tree.leaves.is_empty() {
            tree.fill(0, tree.leaves.len());
        }
        tree
    }

    fn fill(&mut self, first: usize, count: usize) -> Bounds {
        if count == 1 {
            return self.leaves[first];
        }
        let left = count.div_ceil(2);
        let bounds = union(self.fill(first, left), self.fill(first + left, count - left));
        self.inner[first + left - 1] = bounds;
        bounds
    }

    /// Bytes on the heap.
    pub(super) fn memory_bytes(&self) -> usize {
        (self.inner.capacity() + self.leaves.capacity()) * size_of::<Bounds>()
    }

    /// Calls `visit` for each leaf whose box `meets` accepts, if all boxes above it are accepted too.
    #[inline]
    fn visit(&self, meets: impl Fn(&Bounds) -> bool, mut visit: impl FnMut(usize)) {
        if self.leaves.is_empty() {
            return;
        }
        let mut stack = [(0u32, 0u32); MAX_DEPTH];
        let mut height = 0;
        let mut here = (0, self.leaves.len() as u32);
        loop {
            let (first, count) = here;
            if count == 1 {
                if meets(&self.leaves[first as usize]) {
                    visit(first as usize);
                }
            } else {
                let left = count.div_ceil(2);
                if meets(&self.inner[(first + left - 1) as usize]) {
                    stack[height] = (first + left, count - left);
                    height += 1;
                    here = (first, left);
                    continue;
                }
            }
            if height == 0 {
                return;
            }
            height -= 1;
            here = stack[height];
        }
    }

    /// Leaves whose box the segment meets, in the order of the tree.
    #[inline]
    pub(super) fn along(&self, origin: Vec3, direction: Vec3, length: f32, visit: impl FnMut(usize)) {
        let inverse = Vec3::ONE / direction;
        let meets = |[low, high]: &Bounds| {
            let (a, b) = ((*low - origin) * inverse, (*high - origin) * inverse);
            // Not the vector's own minimum: a product of zero and infinity must not decide.
            let near = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z)).max(0.0);
            let far = a.x.max(b.x).min(a.y.max(b.y)).min(a.z.max(b.z)).min(length);
            near <= far * (1.0 + 4.0 * f32::EPSILON)
        };
        self.visit(meets, visit);
    }

    /// Leaves whose box contains the point, in the order of the tree.
    #[inline]
    pub(super) fn around(&self, point: Vec3, visit: impl FnMut(usize)) {
        let meets = |[low, high]: &Bounds| point.cmpge(*low).all() && point.cmple(*high).all();
        self.visit(meets, visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    #[test]
    fn searches_find_every_box() {
        let mut rng = Rng::new(4, Stream::Measure, 0);
        for count in [0usize, 1, 2, 3, 7, 100] {
            let mut boxes: Vec<Bounds> = (0..count)
                .map(|_| {
                    let low = rng.next_2d().extend(rng.next_f32());
                    [low, low + 0.2 * rng.next_2d().extend(rng.next_f32())]
                })
                .collect();
            boxes.sort_by(|a, b| a[0].x.total_cmp(&b[0].x));
            let tree = BoxTree::new(boxes.clone());
            for _ in 0..200 {
                let point = rng.next_2d().extend(rng.next_f32());
                let mut found = Vec::new();
                tree.around(point, |leaf| found.push(leaf));
                let inside = |b: &Bounds| point.cmpge(b[0]).all() && point.cmple(b[1]).all();
                let expected: Vec<usize> = (0..count).filter(|&i| inside(&boxes[i])).collect();
                assert_eq!(found, expected);
                // A point within a box that the segment passes makes the box one to be found.
                let direction = warp::square_to_sphere(rng.next_2d());
                let mut along = Vec::new();
                tree.along(point - 0.5 * direction, direction, 1.0, |leaf| along.push(leaf));
                assert!(expected.iter().all(|leaf| along.contains(leaf)));
            }
        }
    }
}
