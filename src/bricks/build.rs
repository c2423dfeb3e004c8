//! From discs to a brick map: a sparse octree, filled from the leaves up.

use super::brick::{Octant, Sums};
use super::clip::{for_each_voxel, polygon};
use super::spool::Spool;
use super::{Disc, VOXELS};
use crate::math::Bounds3;
use crate::sampling::mix;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Levels of the deepest octree. Its voxels are 2^-21 of the map's side, about the spacing of `f32`.
const DEEPEST: u32 = 18;

/// The map's cube is larger than the box around the discs by this share on each side. It is no round number, so that walls at round
/// coordinates do not lie between two layers of voxels, where rounding would fill both.
const MARGIN: f64 = 0.0137;

/// The polygons of discs reach beyond their circles by less than this.
const OVERHANG: f32 = 1.02;

/// Children of nodes with more discs than this are built in parallel.
const PARALLEL: usize = 20_000;

/// Levels whose nodes may build their children in parallel.
const PARALLEL_LEVELS: u32 = 2;

/// What is dark against this share of the mean irradiance of the map counts as this bright where variation is measured.
const FLOOR: f64 = 0.01;

/// Settings of building a brick map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrickParams {
    /// A brick is left out if none of its voxels differs from the voxel of the level above by more than this share: 0.03 in Christensen &
    /// Batali 2004, section 5.3. With zero none is.
    pub max_error: f32,
    /// Levels of the octree below its root; at most 18.
    pub max_level: u32,
}

impl Default for BrickParams {
    fn default() -> Self {
        Self { max_error: 0.03, max_level: DEEPEST }
    }
}

/// A brick map that is built and not yet in its file.
#[derive(Debug)]
pub struct BuiltBricks {
    pub(super) origin: Vec3,
    pub(super) size: f32,
    pub(super) spool: Spool,
    pub(super) max_error: f32,
    /// Discs in the map.
    pub discs: u64,
    /// Discs that were left out because their numbers are not sound ([`Disc::is_sound`]).
    pub dropped: u64,
    /// Bricks that were left out because the level above shows the same.
    pub eliminated: u64,
    /// The most bricks that were in memory at once, all threads together.
    pub most_open: usize,
}

impl BuiltBricks {
    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.spool.entries.len()
    }

    /// True where there is no brick, as there was no disc.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Builds a brick map of `discs` (Christensen & Batali 2004, section 3.2). Packed bricks wait in a nameless file on the disk of `folder`.
///
/// A node is divided while the [`Disc::detail`] of a disc with its centre in there is less than half a diagonal of its voxels. A disc adds to
/// each voxel the area that it has in there, with the squares of the cosines of its normal as shares of the voxel's faces; so a voxel holds, for
/// each face, the mean of irradiance over area, and coarser voxels are exact sums of finer ones. Nodes are visited depth first, and a brick is
/// packed as soon as its children are: at most one brick for each level is in memory, for each thread. A brick without children of its own is
/// eliminated where the level above shows the same ([`BrickParams::max_error`]); the root stays.
///
/// The result depends on the discs and their order alone, and not on the number of threads.
///
/// # Errors
/// If the temporary file cannot be written.
pub fn build_bricks(discs: &[Disc], params: &BrickParams, folder: &Path) -> io::Result<BuiltBricks> {
    let sound: Vec<u32> = (0..discs.len() as u32).filter(|&i| discs[i as usize].is_sound()).collect();
    let (origin, size) = cube(discs, &sound);
    let (mut area, mut flux) = (0.0, 0.0);
    for disc in sound.iter().map(|&i| &discs[i as usize]) {
        let own = f64::from(disc.radius).powi(2);
        area += own;
        flux += own * f64::from(disc.irradiance.max_element());
    }
    let builder = Builder {
        discs,
        params: BrickParams { max_level: params.max_level.min(DEEPEST), ..*params },
        origin: origin.as_dvec3(),
        size: f64::from(size),
        floor: if area > 0.0 { (FLOOR * flux / area) as f32 } else { 0.0 },
        spool: Mutex::new(Spool::new(folder)?),
        open: AtomicUsize::new(0),
        most_open: AtomicUsize::new(0),
        eliminated: AtomicU64::new(0),
    };
    if !sound.is_empty() {
        builder.node(Node { level: 0, cell: [0; 3], code: 0 }, &sound)?;
    }
    let mut spool = builder.spool.into_inner().unwrap_or_else(PoisonError::into_inner);
    spool.flush()?;
    spool.entries.sort_unstable_by_key(|entry| (entry.level, entry.code));
    Ok(BuiltBricks {
        origin,
        size,
        spool,
        max_error: params.max_error,
        discs: sound.len() as u64,
        dropped: (discs.len() - sound.len()) as u64,
        eliminated: builder.eliminated.into_inner(),
        most_open: builder.most_open.into_inner(),
    })
}

/// Lower corner and side of a cube around the discs.
fn cube(discs: &[Disc], sound: &[u32]) -> (Vec3, f32) {
    let corners = sound.iter().map(|&i| &discs[i as usize]).flat_map(|disc| {
        let half = OVERHANG * disc.half_sides();
        [disc.position - half, disc.position + half]
    });
    let bounds = Bounds3::of_points(corners.map(Vec3::as_dvec3));
    if bounds.is_empty() {
        return (Vec3::ZERO, 1.0);
    }
    let widest = (bounds.max - bounds.min).max_element();
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    // No smaller than positions can be told apart.
    let size = (widest * (1.0 + 2.0 * MARGIN)).max(1e-4 * farthest).max(1e-30);
    ((bounds.center() - 0.5 * size).as_vec3(), (size * 1.000_001) as f32)
}

/// A node of the octree that is being built.
#[derive(Clone, Copy)]
struct Node {
    level: u32,
    cell: [u32; 3],
    code: u64,
}

impl Node {
    fn child(self, child: usize) -> Self {
        let bit = |axis: usize| (child >> axis & 1) as u32;
        let cell = std::array::from_fn(|axis| 2 * self.cell[axis] + bit(axis));
        Self { level: self.level + 1, cell, code: self.code << 3 | child as u64 }
    }
}

struct Builder<'a> {
    discs: &'a [Disc],
    params: BrickParams,
    origin: DVec3,
    size: f64,
    floor: f32,
    spool: Mutex<Spool>,
    /// Bricks in memory.
    open: AtomicUsize,
    most_open: AtomicUsize,
    eliminated: AtomicU64,
}

/// Sums that count among the open bricks while they are in memory.
struct Open<'a> {
    sums: Sums,
    count: &'a AtomicUsize,
}

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.count.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A finished node: its light at half resolution, and whether it has a brick.
struct Made {
    octant: Octant,
    is_kept: bool,
}

impl Builder<'_> {
    fn open(&self) -> Open<'_> {
        let open = self.open.fetch_add(1, Ordering::Relaxed) + 1;
        self.most_open.fetch_max(open, Ordering::Relaxed);
        Open { sums: Sums::new(), count: &self.open }
    }

    /// Side of a node.
    fn side(&self, level: u32) -> f64 {
        self.size / f64::from(1u32 << level)
    }

    fn corner(&self, node: Node) -> DVec3 {
        self.origin + DVec3::from_array(node.cell.map(f64::from)) * self.side(node.level)
    }

    /// Whether a node has to be divided.
    fn is_coarse(&self, node: Node, list: &[u32]) -> bool {
        if node.level >= self.params.max_level {
            return false;
        }
        let (low, side) = (self.corner(node), self.side(node.level));
        let half_diagonal = 0.5 * 3f64.sqrt() * side / super::brick::SIDE as f64;
        list.iter().any(|&i| {
            let disc = &self.discs[i as usize];
            let inside = (disc.position.as_dvec3() - low) / side;
            f64::from(disc.detail) < half_diagonal
                && inside.cmpge(DVec3::ZERO).all()
                && inside.cmplt(DVec3::ONE).all()
        })
    }

    /// The discs of `list` whose boxes meet a node.
    fn overlapping(&self, node: Node, list: &[u32]) -> Vec<u32> {
        let low = self.corner(node);
        let high = low + self.side(node.level);
        let meets = |&&i: &&u32| {
            let disc = &self.discs[i as usize];
            let (centre, half) =
                (disc.position.as_dvec3(), f64::from(OVERHANG) * disc.half_sides().as_dvec3());
            (centre + half).cmpge(low).all() && (centre - half).cmple(high).all()
        };
        list.iter().filter(meets).copied().collect()
    }

    /// Builds a node from the discs that meet it; `None` where they have no area in it.
    fn node(&self, node: Node, list: &[u32]) -> io::Result<Option<Made>> {
        if !self.is_coarse(node, list) {
            return self.leaf(node, list);
        }
        let make = |child: usize| {
            let below = node.child(child);
            let list = self.overlapping(below, list);
            if list.is_empty() { Ok(None) } else { self.node(below, &list) }
        };
        let (mut children, mut open) = (0u8, None);
        let mut take = |child: usize, made: Option<Made>| {
            if let Some(Made { octant, is_kept }) = made {
                children |= u8::from(is_kept) << child;
                open.get_or_insert_with(|| self.open()).sums.add_octant(child, &octant);
            }
        };
        if node.level < PARALLEL_LEVELS && list.len() > PARALLEL {
            let made: Vec<Option<Made>> = (0..8).into_par_iter().map(make).collect::<io::Result<_>>()?;
            made.into_iter().enumerate().for_each(|(child, made)| take(child, made));
        } else {
            for child in 0..8 {
                take(child, make(child)?);
            }
        }
        open.map(|open| self.finish(node, children, &open)).transpose()
    }

    fn leaf(&self, node: Node, list: &[u32]) -> io::Result<Option<Made>> {
        let (low, width) = (self.corner(node), self.side(node.level) / super::brick::SIDE as f64);
        let mut open = self.open();
        let square = (width * width) as f32;
        for &i in list {
            let disc = &self.discs[i as usize];
            let centre = ((disc.position.as_dvec3() - low) / width).as_vec3();
            let radius = (f64::from(disc.radius) / width) as f32;
            for_each_voxel(&polygon(centre, disc.normal, radius), |voxel, area| {
                open.sums.add(voxel.min(VOXELS - 1), disc.normal, area * square, disc.irradiance);
            });
        }
        if open.sums.is_empty() {
            return Ok(None);
        }
        self.finish(node, 0, &open).map(Some)
    }

    /// Packs the brick of a node whose sums are complete, or eliminates it.
    fn finish(&self, node: Node, children: u8, open: &Open<'_>) -> io::Result<Made> {
        let octant = open.sums.halved();
        let is_needed = children != 0 || node.level == 0;
        if !is_needed && open.sums.largest_variation(self.floor) <= self.params.max_error {
            self.eliminated.fetch_add(1, Ordering::Relaxed);
            return Ok(Made { octant, is_kept: false });
        }
        let width = self.side(node.level) / super::brick::SIDE as f64;
        let packed = open.sums.pack(width as f32, mix(node.code << 5 | u64::from(node.level)));
        let mut spool = self.spool.lock().unwrap_or_else(PoisonError::into_inner);
        spool.push(node.level, (node.code, children), &packed)?;
        Ok(Made { octant, is_kept: true })
    }
}
