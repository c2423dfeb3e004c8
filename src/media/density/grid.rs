//! Density in voxels, stored sparsely: leaves of 8^3 voxels, in nodes of 16^3 leaves, as OpenVDB has them (Museth, "VDB:
//! High-Resolution Sparse Volumes with Dynamic Topology", ACM Transactions on Graphics 32(3), 2013).
//!
//! The value of a voxel is that at its centre, which has whole coordinates in index space; between centres the density is interpolated
//! trilinearly, with zero where there is no voxel. The domain of a leaf is where the lower of the eight voxels that are interpolated is
//! one of its own. So its bounds are those of its own voxels and of the first layer of those behind it.

use super::cells::Cells;
use super::grid_builder::inverse_of;
use super::{GridError, Line, Segment};
use crate::math::Bounds3;
use glam::{DAffine3, DVec3, IVec3};

/// Voxels along a side of a leaf, as a power of two.
pub(super) const LEAF_BITS: u32 = 3;
/// Leaves along a side of a node, as a power of two.
pub(super) const NODE_BITS: u32 = 4;
/// Leaves in a node.
pub(super) const NODE_LEAVES: usize = 1 << (3 * NODE_BITS);
/// Entry of a table where nothing is.
pub(super) const NOTHING: u32 = u32::MAX;

/// Values of a leaf. Each in an allocation of its own: they are as large as pages, and are never copied.
pub(super) type Block = Box<[f32; super::LEAF_VALUES]>;

/// A leaf, or the place of one without voxels of its own into which those of its neighbours reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leaf {
    /// Of the interpolated density in the domain of the leaf.
    pub(super) majorant: f32,
    pub(super) minorant: f32,
    pub(super) content: Content,
}

/// Voxels of a leaf.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Content {
    /// All have this value.
    Constant(f32),
    /// Number of the block of values.
    Values(u32),
}

/// A density in voxels.
#[derive(Clone, PartialEq)]
pub struct Grid {
    /// From the space of lines to that of voxels.
    pub(super) to_index: DAffine3,
    pub(super) to_world: DAffine3,
    /// Lowest node, in nodes, and how many there are along each axis.
    pub(super) first_node: IVec3,
    pub(super) nodes: IVec3,
    /// For each node, x slowest, its number among those that have leaves.
    pub(super) node_table: Vec<u32>,
    /// For each of those, its 16^3 leaves, x slowest.
    pub(super) leaf_table: Vec<u32>,
    pub(super) leaves: Vec<Leaf>,
    /// Values of leaves, z fastest.
    pub(super) values: Vec<Block>,
    /// Where the density is not zero, in index space.
    pub(super) domain: Bounds3,
    pub(super) majorant: f32,
}

impl std::fmt::Debug for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Grid")
            .field("to_world", &self.to_world)
            .field("domain", &self.domain)
            .field("leaves", &self.leaves.len())
            .field("majorant", &self.majorant)
            .finish_non_exhaustive()
    }
}

impl Grid {
    /// The density is nowhere above this.
    pub fn majorant(&self) -> f64 {
        f64::from(self.majorant)
    }

    /// True where the density is zero everywhere.
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// A box along the axes of the space of lines, outside of which the density is zero.
    pub fn bounds(&self) -> Bounds3 {
        self.domain.transformed(&self.to_world)
    }

    /// The same, moved by `by`.
    ///
    /// # Errors
    /// Where the transform cannot be inverted or is not finite.
    pub fn placed(self, by: DAffine3) -> Result<Self, GridError> {
        let to_world = by * self.to_world;
        Ok(Self { to_index: inverse_of(&to_world)?, to_world, ..self })
    }

    /// The box outside of which the density is zero, in index space, and the transform from there to the space of lines.
    pub fn placed_box(&self) -> (Bounds3, DAffine3) {
        (self.domain, self.to_world)
    }

    /// How many voxels are above zero.
    pub fn voxels(&self) -> u64 {
        let of_leaf = |leaf: &Leaf| match leaf.content {
            Content::Constant(value) => u64::from(value > 0.0) * super::LEAF_VALUES as u64,
            Content::Values(block) => {
                self.values[block as usize].iter().filter(|value| **value > 0.0).count() as u64
            }
        };
        self.leaves.iter().map(of_leaf).sum()
    }

    /// Length of the diagonal of [`Self::bounds`]; zero where the grid is empty.
    pub fn diagonal(&self) -> f64 {
        2.0 * self.bounds().radius()
    }

    /// Bytes that the grid takes.
    pub fn memory(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&self.node_table[..])
            + size_of_val(&self.leaf_table[..])
            + size_of_val(&self.leaves[..])
            + self.values.len() * (size_of::<Block>() + size_of::<[f32; super::LEAF_VALUES]>())
    }

    /// Leaves that have values of their own: 512 each.
    pub fn leaves_with_values(&self) -> usize {
        self.values.len()
    }

    /// The leaf with these coordinates, in leaves.
    #[inline]
    fn leaf(&self, leaf: IVec3) -> Option<&Leaf> {
        let node = (leaf >> NODE_BITS as i32) - self.first_node;
        if node.cmplt(IVec3::ZERO).any() || node.cmpge(self.nodes).any() {
            return None;
        }
        let table = self.node_table[linear(node, self.nodes)];
        if table == NOTHING {
            return None;
        }
        let local = leaf & IVec3::splat((1 << NODE_BITS) - 1);
        let at = table as usize * NODE_LEAVES + linear(local, IVec3::splat(1 << NODE_BITS));
        self.leaves.get(self.leaf_table[at] as usize)
    }

    /// Value of the voxel at `voxel`.
    pub fn value(&self, voxel: IVec3) -> f32 {
        match self.leaf(voxel >> LEAF_BITS as i32) {
            None => 0.0,
            Some(leaf) => match leaf.content {
                Content::Constant(value) => value,
                Content::Values(block) => self.values[block as usize][within(voxel)],
            },
        }
    }

    /// Density at `p` of the space of lines.
    pub fn at(&self, p: DVec3) -> f64 {
        self.at_index(self.to_index.transform_point3(p))
    }

    /// Density at `p` of index space.
    fn at_index(&self, p: DVec3) -> f64 {
        if !(p.cmpge(self.domain.min).all() && p.cmple(self.domain.max).all()) {
            return 0.0;
        }
        let low = p.floor();
        interpolate(self.corners(low.as_ivec3()), p - low)
    }

    /// Values of the eight voxels from `low` on, z fastest.
    #[inline]
    fn corners(&self, low: IVec3) -> [f32; 8] {
        let last = super::LEAF_SIDE as i32 - 1;
        if (low & last).max_element() < last {
            // All eight in one leaf.
            match self.leaf(low >> LEAF_BITS as i32) {
                None => [0.0; 8],
                Some(&Leaf { content: Content::Constant(value), .. }) => [value; 8],
                Some(&Leaf { content: Content::Values(block), .. }) => {
                    let (values, at) = (&self.values[block as usize], within(low));
                    std::array::from_fn(|i| values[at + (i & 1) + (i >> 1 & 1) * 8 + (i >> 2) * 64])
                }
            }
        } else {
            std::array::from_fn(|i| {
                let i = i as i32;
                self.value(low + IVec3::new(i >> 2, i >> 1 & 1, i & 1))
            })
        }
    }

    /// Segments of `line` from 0 to `t_max`: one for each leaf on its way that is not empty, or for each voxel where the bounds of the leaf
    /// are apart by more than `finest` over the length of the segment.
    pub fn segments(&self, line: &Line, t_max: f64, finest: f64) -> GridSegments<'_> {
        let to_leaves = 1.0 / f64::from(1 << LEAF_BITS);
        let origin = self.to_index.transform_point3(line.origin()) * to_leaves;
        let direction = self.to_index.transform_vector3(line.direction()) * to_leaves;
        let to_nodes = 1.0 / f64::from(1 << NODE_BITS);
        let range = (0.0, t_max);
        let nodes = Cells::new(
            origin * to_nodes,
            direction * to_nodes,
            range,
            self.first_node,
            self.first_node + self.nodes,
        );
        GridSegments { grid: self, origin, direction, finest, nodes, leaves: None, voxels: None }
    }
}

impl Grid {
    /// Integral of the density over `line` from 0 to `t_max`: the sum over all voxels on the way, between which the density is a cubic
    /// along the line, so that Simpson's rule is exact.
    pub fn integral(&self, line: &Line, t_max: f64) -> f64 {
        let mut walk = self.segments(line, t_max, 0.0);
        let scale = f64::from(super::LEAF_SIDE);
        let (origin, direction) = (walk.origin * scale, walk.direction * scale);
        let mut sum = 0.0;
        loop {
            while let Some((voxel, t0, t1, corners)) = walk.next_cell() {
                let from = origin - voxel.as_dvec3();
                let at = |t: f64| interpolate(corners, (from + direction * t).clamp(DVec3::ZERO, DVec3::ONE));
                sum += (t1 - t0) * (at(t0) + 4.0 * at(0.5 * (t0 + t1)) + at(t1)) / 6.0;
            }
            match walk.enter() {
                None => return sum,
                Some(None) => {}
                Some(Some(constant)) => sum += (constant.t1 - constant.t0) * constant.majorant,
            }
        }
    }

    /// Voxels that `line` passes over a unit of its length.
    pub fn voxels_per_length(&self, line: &Line) -> f64 {
        self.to_index.transform_vector3(line.direction()).abs().element_sum()
    }
}

/// Number of a cell in a table of `size`, x slowest.
#[inline]
pub(super) fn linear(cell: IVec3, size: IVec3) -> usize {
    let [x, y, z] = cell.to_array().map(|c| c as usize);
    (x * size.y as usize + y) * size.z as usize + z
}

/// Number of a voxel among the values of its leaf, z fastest.
#[inline]
pub(super) fn within(voxel: IVec3) -> usize {
    let [x, y, z] = voxel.to_array().map(|c| (c & 7) as usize);
    x << 6 | y << 3 | z
}

/// Trilinear interpolation between corners, z fastest, by the place between them.
#[inline]
fn interpolate(c: [f32; 8], f: DVec3) -> f64 {
    let mix = |a: f64, b: f64, s: f64| a + s * (b - a);
    let edge = |i: usize| mix(f64::from(c[i]), f64::from(c[i + 1]), f.z);
    mix(mix(edge(0), edge(2), f.y), mix(edge(4), edge(6), f.y), f.x)
}

/// Segments of a line through a [`Grid`].
#[derive(Clone, Debug)]
pub struct GridSegments<'a> {
    grid: &'a Grid,
    /// In units of a leaf.
    origin: DVec3,
    direction: DVec3,
    finest: f64,
    nodes: Cells,
    /// Leaves of the present node, and where its table begins.
    leaves: Option<(Cells, usize)>,
    /// Cells between voxels of the present leaf, where it is loosely bounded.
    voxels: Option<Cells>,
}

impl GridSegments<'_> {
    /// The next cell between voxels of the present leaf that is not empty, if that leaf was divided: its lower voxel, the parameters between
    /// which the line is in it, and the values of its corners.
    fn next_cell(&mut self) -> Option<(IVec3, f64, f64, [f32; 8])> {
        for (voxel, t0, t1) in self.voxels.as_mut()?.by_ref() {
            let corners = self.grid.corners(voxel);
            if corners.iter().any(|&v| v > 0.0) {
                return Some((voxel, t0, t1, corners));
            }
        }
        self.voxels = None;
        None
    }

    /// Goes on to the next leaf, and returns its segment where it is not to be divided.
    fn enter(&mut self) -> Option<Option<Segment>> {
        loop {
            if let Some((leaf, segment)) = self.next_leaf() {
                let Segment { t0, t1, majorant, minorant } = segment;
                if (majorant - minorant) * (t1 - t0) <= self.finest {
                    return Some(Some(segment));
                }
                let scale = f64::from(super::LEAF_SIDE);
                let low = leaf << LEAF_BITS as i32;
                let high = low + super::LEAF_SIDE as i32;
                let (origin, direction) = (self.origin * scale, self.direction * scale);
                self.voxels = Some(Cells::new(origin, direction, (t0, t1), low, high));
                return Some(None);
            }
            let (node, t0, t1) = self.nodes.next()?;
            let table = self.grid.node_table[linear(node - self.grid.first_node, self.grid.nodes)];
            if table != NOTHING {
                let low = node << NODE_BITS as i32;
                let high = low + (1 << NODE_BITS);
                let leaves = Cells::new(self.origin, self.direction, (t0, t1), low, high);
                self.leaves = Some((leaves, table as usize * NODE_LEAVES));
            }
        }
    }

    /// The next leaf of the present node, with the parameters between which the line is in it.
    fn next_leaf(&mut self) -> Option<(IVec3, Segment)> {
        let side = IVec3::splat(1 << NODE_BITS);
        let (leaves, table) = self.leaves.as_mut()?;
        for (cell, t0, t1) in leaves.by_ref() {
            let at = *table + linear(cell & (side - 1), side);
            if let Some(leaf) = self.grid.leaves.get(self.grid.leaf_table[at] as usize) {
                let (majorant, minorant) = (f64::from(leaf.majorant), f64::from(leaf.minorant));
                return Some((cell, Segment { t0, t1, majorant, minorant }));
            }
        }
        self.leaves = None;
        None
    }
}

impl Iterator for GridSegments<'_> {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        loop {
            if let Some((_, t0, t1, corners)) = self.next_cell() {
                let range = |(low, high): (f32, f32), v: f32| (low.min(v), high.max(v));
                let (low, high) = corners.into_iter().fold((f32::INFINITY, 0.0), range);
                return Some(Segment { t0, t1, majorant: f64::from(high), minorant: f64::from(low) });
            }
            if let Some(segment) = self.enter()? {
                return Some(segment);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::density::test_lines::{check_segments, random_point};
    use crate::media::density::{Density, GridBuilder};
    use crate::sampling::{Rng, Stream};
    use glam::DQuat;
    use std::sync::Arc;

    fn of(origin: IVec3, size: IVec3, transform: DAffine3, value: impl Fn(IVec3) -> f32) -> Grid {
        let mut builder = GridBuilder::default();
        builder.dense(origin, size, value).unwrap();
        builder.finish(transform).unwrap().0
    }

    #[test]
    fn integrals_are_exact() {
        let mut rng = Rng::new(1, Stream::Measure, 37);
        let mut noise = Rng::new(2, Stream::Measure, 37);
        let values: Vec<f32> = (0..4096).map(|_| noise.next_f32()).collect();
        let turned = DAffine3::from_rotation_y(0.4) * DAffine3::from_scale(DVec3::new(0.1, 0.2, 0.15));
        let value = |v: IVec3| values[((v.x * 16 + v.y) * 16 + v.z) as usize];
        let grid = of(IVec3::ZERO, IVec3::splat(16), turned, value);
        let bounds = grid.bounds();
        for _ in 0..100 {
            let [a, b] = [(); 2].map(|()| random_point(&mut rng, bounds.min, bounds.max));
            let line = Line::new(a, b - a).unwrap();
            let (exact, fine) = (grid.integral(&line, 2.0), integral(&grid, &line, 2.0, 20_000));
            assert!((exact - fine).abs() < 1e-4, "{exact} {fine}");
        }
    }

    fn integral(grid: &Grid, line: &Line, t_max: f64, steps: u32) -> f64 {
        let width = t_max / f64::from(steps);
        (0..steps).map(|i| grid.at(line.at((f64::from(i) + 0.5) * width))).sum::<f64>() * width
    }

    #[test]
    fn a_ramp_is_interpolated_exactly() {
        // 1 + x/31 at the centres 0 to 31, voxels of 0.1: through the centres' box tau is 31 * 1.5 * 0.1.
        let scale = DAffine3::from_scale(DVec3::splat(0.1));
        let grid = of(IVec3::ZERO, IVec3::splat(32), scale, |v| 1.0 + v.x as f32 / 31.0);
        let line = Line::new(DVec3::new(0.0, 1.5, 1.5), DVec3::X).unwrap();
        let depth = integral(&grid, &line, 3.1, 10_000);
        assert!((depth - 4.65).abs() < 1e-6, "{depth}");
        assert!(((-depth).exp() - 0.009_561_60).abs() < 1e-8);
        assert!((grid.at(DVec3::new(1.234, 1.0, 2.0)) - (1.0 + 12.34 / 31.0)).abs() < 1e-6);
        assert_eq!(grid.majorant(), 2.0);
        // Beyond the last centre it falls to zero over one voxel.
        assert!((grid.at(DVec3::new(3.15, 1.0, 1.0)) - 1.0).abs() < 1e-6);
        assert_eq!(grid.at(DVec3::new(3.2001, 1.0, 1.0)), 0.0);
        assert_eq!(grid.at(DVec3::new(-0.1001, 1.0, 1.0)), 0.0);
        // Leaves within the ramp are bounded closely from both sides.
        let inside: Vec<Segment> =
            Density::Grid(Arc::new(grid)).segments(&line, 3.1, f64::INFINITY).collect();
        assert_eq!(inside.len(), 4);
        for (i, segment) in inside.iter().enumerate() {
            let low = 1.0 + 8.0 * i as f64 / 31.0;
            let high = 1.0 + (8.0 * i as f64 + 8.0).min(31.0) / 31.0;
            assert!((segment.majorant - high).abs() < 1e-6, "{segment:?}");
            // The last one reaches over the end.
            assert!((segment.minorant - if i < 3 { low } else { 0.0 }).abs() < 1e-6, "{segment:?}");
        }
    }

    #[test]
    fn bounds_hold_for_any_transform_and_place() {
        let mut rng = Rng::new(1, Stream::Measure, 36);
        let turned = DAffine3::from_scale_rotation_translation(
            DVec3::new(0.1, 0.05, 0.2),
            DQuat::from_rotation_z(0.5),
            DVec3::new(1.0, 2.0, 3.0),
        );
        let mirrored = DAffine3::from_scale(DVec3::new(-0.3, 0.1, 0.1));
        for (at, transform) in [DAffine3::IDENTITY, turned, mirrored].into_iter().enumerate() {
            // Sparse random voxels over negative indices and several nodes.
            let mut noise = Rng::new(2, Stream::Measure, at as u64);
            let mut voxels = std::collections::BTreeMap::new();
            for _ in 0..400 {
                let v =
                    random_point(&mut noise, DVec3::splat(-150.0), DVec3::splat(140.0)).floor().as_ivec3();
                // In clumps.
                for _ in 0..4 {
                    let near = v + random_point(&mut noise, DVec3::ZERO, DVec3::splat(3.0)).as_ivec3();
                    voxels.insert(near.to_array(), noise.next_f32() * 5.0);
                }
            }
            let mut builder = GridBuilder::default();
            let leaves: std::collections::BTreeSet<_> = voxels.keys().map(|v| v.map(|c| c & !7)).collect();
            for leaf in leaves {
                let value = |v: IVec3| voxels.get(&v.to_array()).copied().unwrap_or(0.0);
                builder.dense(IVec3::from_array(leaf), IVec3::splat(8), value).unwrap();
            }
            let grid = builder.finish(transform).unwrap().0;
            for (voxel, value) in &voxels {
                let v = IVec3::from_array(*voxel);
                assert_eq!(grid.value(v), *value);
                assert!((grid.at(transform.transform_point3(v.as_dvec3())) - f64::from(*value)).abs() < 1e-6);
            }
            let centre = |v: &[i32; 3]| transform.transform_point3(IVec3::from_array(*v).as_dvec3());
            let places: Vec<DVec3> = voxels.keys().map(centre).collect();
            let density = Density::Grid(Arc::new(grid));
            let mut segments = 0;
            for i in 0..1500 {
                let [a, b] = [(); 2].map(|()| places[(rng.next_f64() * places.len() as f64) as usize]);
                let from = a + (a - b) * rng.next_f64();
                let mut to = b;
                if i % 4 == 0 {
                    to = from.with_x(from.x + 1.0);
                }
                let Some(line) = Line::new(from, to - from) else { continue };
                segments += check_segments(&density, &line, 3.0 * (a - b).length(), &mut rng);
            }
            assert!(segments > 3000, "{segments}");
        }
    }

    #[test]
    fn a_voxel_reaches_into_leaves_without_voxels() {
        // At the lower corner of its leaf: seven neighbours interpolate towards it.
        let grid = of(IVec3::splat(8), IVec3::ONE, DAffine3::IDENTITY, |_| 4.0);
        let line = Line::new(DVec3::new(0.0, 7.5, 7.75), DVec3::X).unwrap();
        let depth = integral(&grid, &line, 20.0, 100_000);
        assert!((depth - 4.0 * 0.5 * 0.75).abs() < 1e-4, "{depth}");
        let density = Density::Grid(Arc::new(grid));
        let segments: Vec<Segment> = density.segments(&line, 20.0, f64::INFINITY).collect();
        assert_eq!(segments.len(), 2, "{segments:?}");
        assert!(segments.iter().all(|s| s.majorant == 4.0 && s.minorant == 0.0));
    }

    #[test]
    fn long_empty_runs_are_passed_in_long_steps() {
        let mut builder = GridBuilder::default();
        builder.dense(IVec3::ZERO, IVec3::splat(8), |_| 1.0).unwrap();
        builder.dense(IVec3::new(128 * 500, 0, 0), IVec3::splat(8), |_| 1.0).unwrap();
        let grid = builder.finish(DAffine3::IDENTITY).unwrap().0;
        let line = Line::new(DVec3::new(-1.0, 4.0, 4.0), DVec3::X).unwrap();
        assert_eq!(grid.segments(&line, 1e6, f64::INFINITY).count(), 4);
        let mut nodes = grid.segments(&line, 1e6, f64::INFINITY).nodes;
        assert_eq!(nodes.by_ref().count(), 502);
        // Each block reaches into seven more nodes.
        assert!(grid.memory() < 300_000, "{}", grid.memory());
    }

    #[test]
    fn a_sparse_cloud_takes_little_more_than_its_values() {
        // A shell within 512^3 voxels, as thick as smoke may be.
        let value = |v: IVec3| {
            let r = (v.as_vec3() - 255.5).length();
            if (200.0..212.0).contains(&r) { 1.0 + 0.01 * (r - 200.0) } else { 0.0 }
        };
        let mut builder = GridBuilder::default();
        for leaf in 0..64i32.pow(3) {
            let origin = IVec3::new(leaf >> 12, leaf >> 6 & 63, leaf & 63) * 8;
            // Only where the shell is: most of them are not.
            let r = (origin.as_vec3() - 252.0).length();
            if (190.0..222.0).contains(&r) {
                builder.dense(origin, IVec3::splat(8), value).unwrap();
            }
        }
        let grid = builder.finish(DAffine3::IDENTITY).unwrap().0;
        let values = grid.leaves_with_values() * size_of::<[f32; 512]>();
        let share = grid.memory() as f64 / values as f64;
        assert!(grid.leaves_with_values() > 8000 && share < 1.1, "{share} of {values}");
    }

    #[test]
    fn an_empty_grid_is_no_medium() {
        let grid = GridBuilder::default().finish(DAffine3::IDENTITY).unwrap().0;
        assert!(grid.is_empty() && grid.majorant() == 0.0 && grid.diagonal() == 0.0);
        assert_eq!(grid.at(DVec3::ZERO), 0.0);
        let line = Line::new(DVec3::NEG_ONE, DVec3::ONE).unwrap();
        assert_eq!(grid.segments(&line, 10.0, 0.0).count(), 0);
    }
}
