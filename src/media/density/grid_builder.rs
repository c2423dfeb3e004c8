//! Makes a grid out of leaves, tiles and boxes of voxels.

use super::grid::{Block, Content, Grid, LEAF_BITS, Leaf, NODE_BITS, NODE_LEAVES, NOTHING, linear};
use crate::math::Bounds3;
use glam::{DAffine3, DVec3, IVec3};

/// Voxels along a side of a leaf.
pub const LEAF_SIDE: u32 = 1 << LEAF_BITS;

/// Voxels of a leaf.
pub const LEAF_VALUES: usize = 1 << (3 * LEAF_BITS);

/// Voxels have coordinates between minus this and this.
const FARTHEST: i32 = 1 << 28;

/// Most nodes of 128^3 voxels in the box around all voxels: a table of 16 MB.
const MOST_NODES: i64 = 1 << 22;

/// Most leaves of a grid, those of tiles included: 1600^3 voxels in all. A tile takes no voxels, but its leaves have entries, and a file of
/// a few kilobytes can ask for any number of tiles.
const MOST_LEAVES: usize = 1 << 23;

/// Collects leaves, and makes a [`Grid`] of them.
#[derive(Clone, Debug, Default)]
pub struct GridBuilder {
    /// Coordinates in leaves, and what is there. Of several at one place the last counts.
    leaves: Vec<([i32; 3], Content)>,
    values: Vec<Block>,
    refused: Refused,
}

/// Voxels whose value cannot be a density, and which became zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refused {
    /// Not a number.
    pub nan: u64,
    /// Infinite.
    pub infinite: u64,
    /// Below zero.
    pub negative: u64,
}

/// Why voxels make no grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A leaf or tile does not lie where leaves do.
    #[error("voxels at {0} begin no leaf: leaves begin at multiples of 8 and tiles have whole leaves")]
    Misaligned(IVec3),
    /// Coordinates out of range.
    #[error(
        "voxels at {0} are too far from the origin of their grid: coordinates must be within 268 million"
    )]
    TooFar(IVec3),
    /// The transform leads nowhere.
    #[error("the transform of a grid of voxels cannot be inverted, or is not finite")]
    Transform,
    /// Too many leaves.
    #[error("a grid has more than 67 million leaves of 8^3 voxels: resample it with larger voxels")]
    TooManyLeaves,
    /// The voxels are spread too far.
    #[error(
        "the voxels of a grid spread over {0} voxels: make the box around them smaller, or voxels larger"
    )]
    TooWide(IVec3),
}

impl GridBuilder {
    /// Adds the leaf that begins at `origin`, with its values, z fastest.
    ///
    /// # Errors
    /// Where `origin` is no multiple of 8, or out of range.
    pub fn leaf(&mut self, origin: IVec3, mut values: Box<[f32; LEAF_VALUES]>) -> Result<(), GridError> {
        let leaf = leaf_at(origin)?;
        if self.leaves.len() >= MOST_LEAVES {
            return Err(GridError::TooManyLeaves);
        }
        for value in values.iter_mut() {
            *value = self.refused.checked(*value);
        }
        let content = if values.iter().all(|v| *v == values[0]) {
            Content::Constant(values[0])
        } else {
            self.values.push(values);
            Content::Values((self.values.len() - 1) as u32)
        };
        self.leaves.push((leaf.to_array(), content));
        Ok(())
    }

    /// Adds a cube of voxels of one value, `side` along each axis, that begins at `origin`.
    ///
    /// # Errors
    /// Where `origin` or `side` are no multiples of 8, or out of range.
    pub fn tile(&mut self, origin: IVec3, side: u32, value: f32) -> Result<(), GridError> {
        let leaf = leaf_at(origin)?;
        if side == 0 || !side.is_multiple_of(LEAF_SIDE) || side > FARTHEST as u32 {
            return Err(GridError::Misaligned(origin));
        }
        let value = self.refused.checked(value);
        let side = side / LEAF_SIDE;
        let room = (MOST_LEAVES - self.leaves.len()) as u64;
        if u64::from(side).checked_pow(3).is_none_or(|leaves| leaves > room) {
            return Err(GridError::TooManyLeaves);
        }
        let side = side as i32;
        for x in 0..side {
            for y in 0..side {
                for z in 0..side {
                    self.leaves.push(((leaf + IVec3::new(x, y, z)).to_array(), Content::Constant(value)));
                }
            }
        }
        Ok(())
    }

    /// Adds the box of voxels of this `size` that begins at `origin`: `value` is asked for each. It replaces what was there in all leaves
    /// that it touches.
    ///
    /// # Errors
    /// Where a coordinate is out of range.
    pub fn dense(
        &mut self,
        origin: IVec3,
        size: IVec3,
        value: impl Fn(IVec3) -> f32,
    ) -> Result<(), GridError> {
        if size.min_element() <= 0 {
            return Ok(());
        }
        if size.max_element() > FARTHEST {
            return Err(GridError::TooFar(size));
        }
        in_range(origin)?;
        let end = origin + size;
        in_range(end)?;
        let (low, high) = (origin >> LEAF_BITS as i32, (end - 1) >> LEAF_BITS as i32);
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    let first = IVec3::new(x, y, z) << LEAF_BITS as i32;
                    let mut values = Box::new([0.0; LEAF_VALUES]);
                    for (i, slot) in values.iter_mut().enumerate() {
                        let voxel = first + IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
                        if voxel.cmpge(origin).all() && voxel.cmplt(end).all() {
                            *slot = value(voxel);
                        }
                    }
                    self.leaf(first, values)?;
                }
            }
        }
        Ok(())
    }

    /// The grid, whose voxels `to_world` leads from index space to that of lines, and how many voxels had no usable value.
    ///
    /// # Errors
    /// Where the transform cannot be inverted, or the box around all voxels is too large.
    pub fn finish(mut self, to_world: DAffine3) -> Result<(Grid, Refused), GridError> {
        let to_index = inverse_of(&to_world)?;
        // The last of each place, in order, without those that are empty.
        self.leaves.sort_by_key(|(leaf, _)| *leaf);
        self.leaves.reverse();
        self.leaves.dedup_by_key(|(leaf, _)| *leaf);
        self.leaves.reverse();
        self.leaves.retain(|(_, content)| *content != Content::Constant(0.0));
        let mut grid = Grid {
            to_index,
            to_world,
            first_node: IVec3::ZERO,
            nodes: IVec3::ZERO,
            node_table: Vec::new(),
            leaf_table: Vec::new(),
            leaves: Vec::new(),
            values: Vec::new(),
            domain: Bounds3::EMPTY,
            majorant: 0.0,
        };
        place_nodes(&mut grid, &self.leaves)?;
        place_leaves(&mut grid, &self.leaves);
        keep_values(&mut grid, self.values);
        bound(&mut grid);
        Ok((grid, self.refused))
    }
}

/// The way back from where `to_world` leads.
pub(super) fn inverse_of(to_world: &DAffine3) -> Result<DAffine3, GridError> {
    let back = to_world.inverse();
    let is_sound = to_world.is_finite() && back.is_finite() && to_world.matrix3.determinant() != 0.0;
    is_sound.then_some(back).ok_or(GridError::Transform)
}

impl Refused {
    /// How many there are.
    pub fn count(&self) -> u64 {
        self.nan + self.infinite + self.negative
    }

    fn checked(&mut self, value: f32) -> f32 {
        if value.is_nan() {
            self.nan += 1;
        } else if value < 0.0 {
            self.negative += 1;
        } else if value.is_infinite() {
            self.infinite += 1;
        } else {
            return value;
        }
        0.0
    }
}

fn in_range(voxel: IVec3) -> Result<(), GridError> {
    if voxel.cmpgt(IVec3::splat(-FARTHEST)).all() && voxel.cmplt(IVec3::splat(FARTHEST)).all() {
        Ok(())
    } else {
        Err(GridError::TooFar(voxel))
    }
}

/// The leaf that begins at `origin`, in leaves.
fn leaf_at(origin: IVec3) -> Result<IVec3, GridError> {
    in_range(origin)?;
    if origin & (LEAF_SIDE as i32 - 1) == IVec3::ZERO {
        Ok(origin >> LEAF_BITS as i32)
    } else {
        Err(GridError::Misaligned(origin))
    }
}

/// The leaves into which the voxels of a leaf reach: itself and the seven before it.
fn reached(leaf: [i32; 3]) -> impl Iterator<Item = IVec3> {
    (0..8).map(move |i| IVec3::from_array(leaf) - IVec3::new(i >> 2, i >> 1 & 1, i & 1))
}

/// Makes the tables of nodes, and those of leaves, with nothing in them.
fn place_nodes(grid: &mut Grid, leaves: &[([i32; 3], Content)]) -> Result<(), GridError> {
    let corners = || leaves.iter().map(|(leaf, _)| IVec3::from_array(*leaf));
    let Some(low) = corners().reduce(IVec3::min) else { return Ok(()) };
    let Some(high) = corners().reduce(IVec3::max) else { return Ok(()) };
    grid.first_node = (low - 1) >> NODE_BITS as i32;
    grid.nodes = (high >> NODE_BITS as i32) - grid.first_node + 1;
    let count = grid.nodes.to_array().iter().try_fold(1i64, |count, &n| count.checked_mul(n.into()));
    let Some(count) = count.filter(|&count| count <= MOST_NODES) else {
        return Err(GridError::TooWide((high - low + 1) << LEAF_BITS as i32));
    };
    grid.node_table = vec![NOTHING; count as usize];
    let mut used = 0;
    for leaf in leaves.iter().flat_map(|(leaf, _)| reached(*leaf)) {
        let entry = &mut grid.node_table[linear((leaf >> NODE_BITS as i32) - grid.first_node, grid.nodes)];
        if *entry == NOTHING {
            *entry = used;
            used += 1;
        }
    }
    grid.leaf_table = vec![NOTHING; used as usize * NODE_LEAVES];
    Ok(())
}

/// Fills the tables of leaves: first those with voxels, then those into which these only reach.
fn place_leaves(grid: &mut Grid, leaves: &[([i32; 3], Content)]) {
    let side = IVec3::splat(1 << NODE_BITS);
    let entry = |grid: &Grid, leaf: IVec3| {
        let node = grid.node_table[linear((leaf >> NODE_BITS as i32) - grid.first_node, grid.nodes)];
        node as usize * NODE_LEAVES + linear(leaf & (side - 1), side)
    };
    let mut add = |leaf: IVec3, content: Content| {
        let at = entry(grid, leaf);
        if grid.leaf_table[at] == NOTHING {
            grid.leaf_table[at] = grid.leaves.len() as u32;
            grid.leaves.push(Leaf { majorant: 0.0, minorant: 0.0, content });
        }
    };
    for (leaf, content) in leaves {
        add(IVec3::from_array(*leaf), *content);
    }
    for leaf in leaves.iter().flat_map(|(leaf, _)| reached(*leaf)) {
        add(leaf, Content::Constant(0.0));
    }
    grid.leaves.shrink_to_fit();
}

/// Moves the blocks of values that leaves still have, in the order of the leaves.
fn keep_values(grid: &mut Grid, values: Vec<Block>) {
    let mut values: Vec<Option<Block>> = values.into_iter().map(Some).collect();
    for leaf in &mut grid.leaves {
        if let Content::Values(block) = leaf.content
            && let Some(kept) = values[block as usize].take()
        {
            leaf.content = Content::Values(grid.values.len() as u32);
            grid.values.push(kept);
        }
    }
    grid.values.shrink_to_fit();
}

/// Bounds each leaf, and the whole grid, by the voxels that are interpolated there; leaves in which all of them are zero go.
fn bound(grid: &mut Grid) {
    let side = LEAF_SIDE as i32;
    for node in 0..grid.node_table.len() {
        let table = grid.node_table[node];
        if table == NOTHING {
            continue;
        }
        let [ny, nz] = [grid.nodes.y, grid.nodes.z].map(|n| n as usize);
        let place = IVec3::new((node / (ny * nz)) as i32, (node / nz % ny) as i32, (node % nz) as i32);
        let first = (grid.first_node + place) << NODE_BITS as i32;
        for local in 0..NODE_LEAVES {
            let at = table as usize * NODE_LEAVES + local;
            let number = grid.leaf_table[at];
            if number == NOTHING {
                continue;
            }
            let offset = IVec3::new((local >> 8) as i32, (local >> 4 & 15) as i32, (local & 15) as i32);
            let leaf = first + offset;
            let origin = leaf << LEAF_BITS as i32;
            let (minorant, majorant) = range_of(grid, number, origin);
            if majorant > 0.0 {
                let low = origin.as_dvec3();
                let domain = Bounds3 { min: low, max: low + f64::from(side) };
                grid.domain = grid.domain.union(domain);
                grid.majorant = grid.majorant.max(majorant);
                let slot = &mut grid.leaves[number as usize];
                (slot.majorant, slot.minorant) = (majorant, minorant);
            } else {
                grid.leaf_table[at] = NOTHING;
            }
        }
    }
    shrink_domain(grid);
}

/// Least and largest voxel of the leaf that begins at `origin` and of the first layer behind it.
fn range_of(grid: &Grid, number: u32, origin: IVec3) -> (f32, f32) {
    let side = LEAF_SIDE as i32;
    let mut range = match grid.leaves[number as usize].content {
        Content::Constant(value) => (value, value),
        Content::Values(block) => grid.values[block as usize]
            .iter()
            .fold((f32::INFINITY, 0.0f32), |(low, high), &v| (low.min(v), high.max(v))),
    };
    let mut add = |x: i32, y: i32, z: i32| {
        let value = grid.value(origin + IVec3::new(x, y, z));
        range = (range.0.min(value), range.1.max(value));
    };
    for a in 0..=side {
        for b in 0..=side {
            add(side, a, b);
            if a < side {
                add(a, side, b);
                if b < side {
                    add(a, b, side);
                }
            }
        }
    }
    range
}

/// Draws the domain closer: from one before the first voxel that is not zero to one behind the last.
fn shrink_domain(grid: &mut Grid) {
    let mut voxels = Bounds3::EMPTY;
    for (node, table) in grid.node_table.iter().enumerate().filter(|(_, table)| **table != NOTHING) {
        let [ny, nz] = [grid.nodes.y, grid.nodes.z].map(|n| n as usize);
        let place = IVec3::new((node / (ny * nz)) as i32, (node / nz % ny) as i32, (node % nz) as i32);
        let first = (grid.first_node + place) << NODE_BITS as i32;
        for local in 0..NODE_LEAVES {
            let Some(leaf) = grid.leaves.get(grid.leaf_table[*table as usize * NODE_LEAVES + local] as usize)
            else {
                continue;
            };
            let offset = IVec3::new((local >> 8) as i32, (local >> 4 & 15) as i32, (local & 15) as i32);
            let origin = ((first + offset) << LEAF_BITS as i32).as_dvec3();
            let mut add = |i: usize| {
                let voxel = origin + DVec3::new((i >> 6) as f64, (i >> 3 & 7) as f64, (i & 7) as f64);
                voxels = voxels.with_point(voxel);
            };
            match leaf.content {
                Content::Constant(value) if value > 0.0 => {
                    add(0);
                    add(LEAF_VALUES - 1);
                }
                Content::Constant(_) => {}
                Content::Values(block) => {
                    let values = &grid.values[block as usize];
                    values.iter().enumerate().filter(|(_, v)| **v > 0.0).for_each(|(i, _)| add(i));
                }
            }
        }
    }
    if !voxels.is_empty() {
        grid.domain = Bounds3 { min: voxels.min - 1.0, max: voxels.max + 1.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_take_no_values() {
        let mut builder = GridBuilder::default();
        builder.tile(IVec3::ZERO, 128, 0.5).unwrap();
        let (grid, refused) = builder.finish(DAffine3::from_scale(DVec3::splat(0.01))).unwrap();
        assert_eq!((grid.leaves_with_values(), refused.count()), (0, 0));
        assert_eq!(grid.at(DVec3::splat(0.64)), 0.5);
        // Half a voxel before the first centre.
        assert!((grid.at(DVec3::new(-0.005, 0.5, 0.5)) - 0.25).abs() < 1e-12);
        let bounds = grid.bounds();
        assert!(
            (bounds.min + 0.01).abs().max_element() < 1e-12
                && (bounds.max - 1.28).abs().max_element() < 1e-12
        );
        let inner = grid.leaves.iter().filter(|leaf| leaf.minorant == 0.5 && leaf.majorant == 0.5).count();
        assert_eq!(inner, 15 * 15 * 15);
    }

    #[test]
    fn a_grid_can_be_moved() {
        let mut builder = GridBuilder::default();
        builder.dense(IVec3::ZERO, IVec3::splat(8), |v| v.z as f32).unwrap();
        let grid = builder.finish(DAffine3::from_scale(DVec3::splat(0.1))).unwrap().0;
        assert_eq!(grid.voxels(), 8 * 8 * 7);
        let by = DAffine3::from_rotation_x(0.3) * DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let p = DVec3::new(0.31, 0.22, 0.57);
        let before = grid.at(p);
        let grid = grid.placed(by).unwrap();
        assert!(before > 5.0 && (grid.at(by.transform_point3(p)) - before).abs() < 1e-9);
        let (bounds, to_lines) = grid.placed_box();
        assert!(
            (to_lines.transform_point3(bounds.min) - by.transform_point3(DVec3::new(-0.1, -0.1, 0.0)))
                .length()
                < 1e-9
        );
        assert!(matches!(grid.placed(DAffine3::ZERO), Err(GridError::Transform)));
    }

    #[test]
    fn later_leaves_replace_earlier_ones() {
        let mut builder = GridBuilder::default();
        builder.tile(IVec3::ZERO, 16, 1.0).unwrap();
        builder.dense(IVec3::ZERO, IVec3::splat(8), |v| v.z as f32).unwrap();
        builder.tile(IVec3::new(8, 8, 8), 8, 0.0).unwrap();
        let grid = builder.finish(DAffine3::IDENTITY).unwrap().0;
        assert_eq!(grid.value(IVec3::new(1, 2, 3)), 3.0);
        assert_eq!(grid.value(IVec3::new(9, 2, 3)), 1.0);
        assert_eq!(grid.value(IVec3::new(9, 9, 9)), 0.0);
        assert_eq!(grid.leaves_with_values(), 1);
        assert_eq!(grid.majorant(), 7.0);
    }

    #[test]
    fn what_cannot_be_a_density_is_counted_and_zero() {
        let mut builder = GridBuilder::default();
        builder
            .dense(IVec3::ZERO, IVec3::splat(8), |v| match v.to_array() {
                [1, 2, 3] => f32::NAN,
                [4, 4, 4] => -1.0,
                [5, 5, 5] => f32::INFINITY,
                [6, 6, 6] => f32::NEG_INFINITY,
                [7, 7, 7] => -0.0,
                _ => 0.3,
            })
            .unwrap();
        let (grid, refused) = builder.finish(DAffine3::IDENTITY).unwrap();
        assert_eq!(refused, Refused { nan: 1, infinite: 1, negative: 2 });
        assert_eq!(grid.value(IVec3::new(1, 2, 3)), 0.0);
        assert_eq!(grid.value(IVec3::new(1, 2, 4)), 0.3);
        assert_eq!(grid.majorant(), f64::from(0.3f32));
    }

    #[test]
    fn what_is_no_grid_is_refused() {
        let mut builder = GridBuilder::default();
        assert!(matches!(builder.tile(IVec3::ONE, 8, 1.0), Err(GridError::Misaligned(_))));
        assert!(matches!(builder.tile(IVec3::ZERO, 12, 1.0), Err(GridError::Misaligned(_))));
        assert!(matches!(builder.tile(IVec3::ZERO, 4096, 1.0), Err(GridError::TooManyLeaves)));
        assert!(matches!(builder.tile(IVec3::ZERO, 1 << 25, 1.0), Err(GridError::TooManyLeaves)));
        assert!(matches!(builder.tile(IVec3::splat(i32::MAX - 7), 8, 1.0), Err(GridError::TooFar(_))));
        assert!(builder.dense(IVec3::ZERO, IVec3::splat(i32::MAX), |_| 1.0).is_err());
        builder.tile(IVec3::ZERO, 8, 1.0).unwrap();
        for bad in [DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), DAffine3::from_translation(DVec3::NAN)] {
            assert!(matches!(builder.clone().finish(bad), Err(GridError::Transform)));
        }
        // So far apart that the product of the sides overflows.
        let mut wide = builder.clone();
        for corner in [-200_000_000, 200_000_000] {
            wide.tile(IVec3::splat(corner), 8, 1.0).unwrap();
        }
        assert!(matches!(wide.finish(DAffine3::IDENTITY), Err(GridError::TooWide(_))));
        builder.tile(IVec3::splat(1 << 27), 8, 1.0).unwrap();
        assert!(matches!(builder.finish(DAffine3::IDENTITY), Err(GridError::TooWide(_))));
    }
}
