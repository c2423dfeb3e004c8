//! A static kd-tree over points, for the photons of a map and for the points of precomputed irradiance.
//!
//! The reference is the left-balanced tree of Jensen 1996 with one photon in each node (after Bentley 1975). This tree
//! is also balanced, which bounds the depth. It differs in two ways that suit caches and vector units: points are
//! stored in full blocks of `L` at the leaves, coordinate by coordinate, and only the splits are nodes. Node and block
//! indices follow from the counts, so there are no pointers: 8 bytes for each `L` points.

use super::photon::{NORMAL_CLASSES, class_of_normal};
use glam::Vec3;
use rayon::prelude::*;
use std::cmp::Ordering;

/// A point of a tree.
pub(super) trait Point: Copy + Send + Sync {
    /// Its position; finite.
    fn position(&self) -> Vec3;
    /// Two bytes that searches use to accept points; the code of a normal is in the lowest 12 bits.
    fn tag(&self) -> u16;
    /// All data that distinguishes two points at one place, so that a tree is a function of the set of its points.
    fn tie(&self) -> u64;
}

/// A split: one coordinate separates the points of the blocks left and right of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Node {
    /// Coordinate that no point on the left exceeds, and the smallest on the right.
    split: f32,
    /// The axis in bits 0 and 1, then the normal classes of the points on the left, one bit each, then those of the
    /// points on the right.
    axis_and_normals: u32,
}

/// One bit for each class of normals.
type NormalSet = u32;

const ALL_NORMALS: NormalSet = (1 << NORMAL_CLASSES) - 1;
const _: () = assert!(2 + 2 * NORMAL_CLASSES <= u32::BITS);

impl Node {
    fn new(split: f32, axis: usize, left: NormalSet, right: NormalSet) -> Self {
        Self { split, axis_and_normals: axis as u32 | left << 2 | right << (2 + NORMAL_CLASSES) }
    }

    #[inline]
    fn axis(&self) -> usize {
        (self.axis_and_normals & 3) as usize
    }

    /// Normal classes of the points on the left and on the right.
    #[inline]
    fn normals(&self) -> [NormalSet; 2] {
        [2, 2 + NORMAL_CLASSES].map(|shift| self.axis_and_normals >> shift & ALL_NORMALS)
    }
}

/// `L` points, coordinate by coordinate, with their tags next to them, because candidates need these at once. Lanes
/// beyond the last point hold NaN, which no search accepts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block<const L: usize> {
    x: [f32; L],
    y: [f32; L],
    z: [f32; L],
    tags: [u16; L],
}

impl<const L: usize> Block<L> {
    /// Position of the point in `lane`.
    #[inline]
    pub(super) fn position(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Tag of the point in `lane`.
    #[inline]
    pub(super) fn tag(&self, lane: usize) -> u16 {
        self.tags[lane]
    }

    /// Squared distances to `p`, NaN where there is no point.
    ///
    /// The sum has the order of the cell distance in [`KdTree::search`]. Rounding is monotone, so the distance of a
    /// cell never exceeds that of a point in it, and pruning loses no point.
    #[inline]
    fn distances_squared(&self, p: Vec3) -> [f32; L] {
        std::array::from_fn(|i| {
            let (x, y, z) = (self.x[i] - p.x, self.y[i] - p.y, self.z[i] - p.z);
            x * x + y * y + z * z
        })
    }
}

/// Slices shorter than this are split by one thread.
const PARALLEL_LENGTH: usize = 8192;
/// Depth of the largest tree: 2^32 points.
const MAX_DEPTH: usize = 32;

/// A balanced kd-tree with `L` points in each leaf.
#[derive(Clone, Debug)]
pub(super) struct KdTree<const L: usize> {
    /// The split between block `i` and block `i + 1`, in order.
    nodes: Vec<Node>,
    blocks: Vec<Block<L>>,
    extent: Extent,
    len: usize,
}

/// A subtree that a search has deferred.
#[derive(Clone, Copy)]
struct Pending {
    first: u32,
    count: u32,
    /// Squared distance to the cell, axis by axis.
    offsets_squared: [f32; 3],
    distance_squared: f32,
}

/// The operations of a search at the leaves.
pub(super) trait Visitor<const L: usize> {
    /// Squared distance beyond which no point is needed any more.
    fn bound(&self) -> f32;
    /// Whether points with normals of these classes ([`class_of_normal`]) may be accepted: parts of the tree that hold
    /// only other classes are skipped.
    fn wants(&self, _normals: u32) -> bool {
        true
    }
    /// Receives the squared distances of the points `first..first + L`, NaN where there is none, and the points.
    fn visit(&mut self, first: u32, distances_squared: &[f32; L], block: &Block<L>);
}

impl<const L: usize> KdTree<L> {
    /// Builds the tree over `points`, all finite and fewer than 2^32, and sorts them into its order.
    ///
    /// The tree is a function of the set of points: neither their order nor the number of threads matters.
    pub(super) fn build<P: Point>(points: &mut [P]) -> Self {
        Self::build_until(points, &|| false)
    }

    /// [`Self::build`], which ends early once `stop` returns true: the tree is then unusable.
    pub(super) fn build_until<P: Point>(points: &mut [P], stop: &(dyn Fn() -> bool + Sync)) -> Self {
        let count = points.len().div_ceil(L);
        let mut nodes = vec![Node::default(); count.saturating_sub(1)];
        let extent = Extent::of(points);
        split::<P, L>(points, extent, &mut nodes, stop);
        let blocks = points.par_chunks(L).with_min_len(256).map(block_of).collect();
        Self { nodes, blocks, extent, len: points.len() }
    }

    /// Middle and half sides of the box around the points; zeros where there are none.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        if self.len == 0 {
            return (Vec3::ZERO, Vec3::ZERO);
        }
        let Extent { low, high } = self.extent;
        // The halves are computed first, because their sum cannot overflow.
        (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low)
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Position of point `index` in the tree's order.
    pub(super) fn position(&self, index: usize) -> Vec3 {
        self.blocks[index / L].position(index % L)
    }

    /// Tag of point `index` in the tree's order.
    pub(super) fn tag(&self, index: usize) -> u16 {
        self.blocks[index / L].tags[index % L]
    }

    /// Bytes on the heap.
    pub(super) fn memory_bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.blocks.capacity() * size_of::<Block<L>>()
    }

    /// Calls `visitor` for every leaf that may hold a point within its bound of `position`, near leaves first.
    #[inline]
    pub(super) fn search(&self, position: Vec3, visitor: &mut impl Visitor<L>) {
        if self.blocks.is_empty() {
            return;
        }
        let p = position.to_array();
        let root = Pending {
            first: 0,
            count: self.blocks.len() as u32,
            offsets_squared: [0.0; 3],
            distance_squared: 0.0,
        };
        let mut stack = [root; MAX_DEPTH];
        let mut height = 0;
        let mut here = root;
        'subtrees: loop {
            while here.count > 1 {
                let left = here.count.div_ceil(2);
                let node = self.nodes[(here.first + left - 1) as usize];
                let axis = node.axis();
                let delta = p[axis] - node.split;
                let mut far = here;
                far.offsets_squared[axis] = delta * delta;
                let [x, y, z] = far.offsets_squared;
                far.distance_squared = x + y + z;
                let [mut near_normals, mut far_normals] = node.normals();
                if delta < 0.0 {
                    (far.first, far.count) = (here.first + left, here.count - left);
                    here.count = left;
                } else {
                    far.count = left;
                    (here.first, here.count) = (here.first + left, here.count - left);
                    std::mem::swap(&mut near_normals, &mut far_normals);
                }
                if far.distance_squared <= visitor.bound() && visitor.wants(far_normals) {
                    stack[height] = far;
                    height += 1;
                }
                if !visitor.wants(near_normals) {
                    match next_pending(&stack, &mut height, visitor.bound()) {
                        Some(pending) => here = pending,
                        None => return,
                    }
                    continue 'subtrees;
                }
            }
            let block = &self.blocks[here.first as usize];
            visitor.visit(here.first * L as u32, &block.distances_squared(position), block);
            match next_pending(&stack, &mut height, visitor.bound()) {
                Some(pending) => here = pending,
                None => return,
            }
        }
    }
}

/// Removes the last deferred subtree that is not farther away than `bound` from the stack.
#[inline]
fn next_pending(stack: &[Pending; MAX_DEPTH], height: &mut usize, bound: f32) -> Option<Pending> {
    while *height > 0 {
        *height -= 1;
        if stack[*height].distance_squared <= bound {
            return Some(stack[*height]);
        }
    }
    None
}

/// Sorts `points`, which `extent` bounds, into blocks of `L`, and stores the splits. Returns the classes of their
/// normals.
///
/// The middle block splits along the widest side, unless points with the very same coordinate lie on both sides of it.
/// This happens in a cell with an axis-aligned wall and something far in front of it: such a split would put parts of
/// the wall into cells that overlap, and searches would start in the wrong one. The next widest side is tried then.
/// Where all three have ties, the order by all data of the points decides.
fn split<P: Point, const L: usize>(
    points: &mut [P],
    extent: Extent,
    nodes: &mut [Node],
    stop: &(dyn Fn() -> bool + Sync),
) -> NormalSet {
    let count = nodes.len() + 1;
    if count * L > PARALLEL_LENGTH && stop() {
        return ALL_NORMALS;
    }
    if count == 1 {
        points.sort_unstable_by(everything);
        return points.iter().fold(0, |set, point| set | 1 << class_of_normal(point.tag()));
    }
    let left = count.div_ceil(2);
    let middle = left * L;
    let axes = extent.widest_first();
    let mut chosen = None;
    for axis in axes {
        // Without ties across the middle, both sides are the same sets for any selection algorithm.
        let split = select(points, middle, axis);
        let low = Extent::of(&points[..middle]);
        if low.high[axis] < split {
            chosen = Some((axis, split, low));
            break;
        }
    }
    let (axis, split, low_extent) = chosen.unwrap_or_else(|| {
        points.select_nth_unstable_by(middle, everything);
        (0, points[middle].position().x, Extent::of(&points[..middle]))
    });
    let (low, high) = points.split_at_mut(middle);
    let (low_nodes, rest) = nodes.split_at_mut(left - 1);
    let (node, high_nodes) = rest.split_at_mut(1);
    let mut split_low = || self::split::<P, L>(low, low_extent, low_nodes, stop);
    let mut split_high = || self::split::<P, L>(high, Extent::of(high), high_nodes, stop);
    let (left, right) = if count * L > PARALLEL_LENGTH {
        rayon::join(split_low, split_high)
    } else {
        (split_low(), split_high())
    };
    node[0] = Node::new(split, axis, left, right);
    left | right
}

/// Moves the `middle` lowest points along `axis` to the front; returns the coordinate of the next one.
fn select<P: Point>(points: &mut [P], middle: usize, axis: usize) -> f32 {
    // One comparison function for each axis, so that no comparison has to select its coordinate.
    let (_, next, _) = match axis {
        0 => points.select_nth_unstable_by(middle, |a, b| a.position().x.total_cmp(&b.position().x)),
        1 => points.select_nth_unstable_by(middle, |a, b| a.position().y.total_cmp(&b.position().y)),
        _ => points.select_nth_unstable_by(middle, |a, b| a.position().z.total_cmp(&b.position().z)),
    };
    next.position()[axis]
}

/// The box around some points.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: Vec3,
    high: Vec3,
}

impl Extent {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn of<P: Point>(points: &[P]) -> Self {
        let union = |a: Self, b: Self| Self { low: a.low.min(b.low), high: a.high.max(b.high) };
        let of_part = |part: &[P]| {
            // Two independent chains, because each minimum waits for the one before.
            let mut extents = [Self::EMPTY; 2];
            for pair in part.chunks(2) {
                for (extent, point) in extents.iter_mut().zip(pair) {
                    let p = point.position();
                    *extent = Self { low: extent.low.min(p), high: extent.high.max(p) };
                }
            }
            union(extents[0], extents[1])
        };
        if points.len() <= PARALLEL_LENGTH {
            return of_part(points);
        }
        points.par_chunks(PARALLEL_LENGTH).map(of_part).reduce(|| Self::EMPTY, union)
    }

    /// The axes, the widest side first; among equal sides the lowest axis.
    fn widest_first(&self) -> [usize; 3] {
        let sides = self.high - self.low;
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| sides[b].total_cmp(&sides[a]));
        axes
    }
}

/// A total order of points by all their data.
fn everything<P: Point>(a: &P, b: &P) -> Ordering {
    // Two coordinates at once: with only one, the points of an axis-aligned wall would all take the slow path.
    let first = |point: &P| {
        let p = point.position();
        u64::from(ordered_bits(p.x)) << 32 | u64::from(ordered_bits(p.y))
    };
    let rest = |point: &P| (ordered_bits(point.position().z), point.tie());
    first(a).cmp(&first(b)).then_with(|| rest(a).cmp(&rest(b)))
}

/// Bits that order as [`f32::total_cmp`] does.
#[inline]
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000)
}

fn block_of<P: Point, const L: usize>(points: &[P]) -> Block<L> {
    let mut block = Block { x: [f32::NAN; L], y: [f32::NAN; L], z: [f32::NAN; L], tags: [0; L] };
    for (lane, point) in points.iter().enumerate() {
        let p = point.position();
        (block.x[lane], block.y[lane], block.z[lane]) = (p.x, p.y, p.z);
        block.tags[lane] = point.tag();
    }
    block
}
