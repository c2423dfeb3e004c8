//! A brick map in a file: its octree and coarse levels in memory, all other bricks read on demand.

use super::brick::Brick;
use super::file::{BrickFileError, BrickFileProblem, BrickOwner, FileNode, Head, read_head};
use super::spool::checksum;
use crate::files::open_regular;
use glam::Vec3;
use serde::Serialize;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Whole levels stay in memory while they take no more than this together; the root always does.
const RESIDENT: usize = 16 << 10;

/// A brick map whose file is open.
#[derive(Debug)]
pub struct BrickMap {
    path: PathBuf,
    file: File,
    pub(super) head: Head,
    /// Bricks of the coarsest levels.
    pub(super) resident: Vec<Brick>,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// Bricks of one level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BrickLevel {
    /// Bricks.
    pub bricks: u64,
    /// Bricks without children.
    pub leaves: u64,
    /// Side of a voxel, in metres if the map is of a render space of known scale, otherwise in its units.
    pub voxel: f64,
    /// Bytes in the file.
    pub bytes: u64,
    /// Voxels that hold something.
    pub voxels: u64,
    /// Faces of voxels that hold something.
    pub faces: u64,
    /// Share of the voxels that hold something, in percent.
    pub fill_percent: f64,
}

impl BrickMap {
    /// Opens a brick map and reads its octree and its coarsest levels. The other bricks are checked when they are read.
    ///
    /// # Errors
    /// The error names the file, the problem and the remedy.
    pub fn open(path: &Path) -> Result<Self, BrickFileError> {
        let in_file = |problem| BrickFileError { file: path.to_owned(), problem };
        let (file, length) = open_regular(path).map_err(|error| in_file(error.into()))?;
        Self::of_file(file, length, path)
    }

    /// The brick map in an open file of `length` bytes, under the name `path` in messages.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn of_file(file: File, length: u64, path: &Path) -> Result<Self, BrickFileError> {
        let in_file = |problem| BrickFileError { file: path.to_owned(), problem };
        let head = read_head(&file, length).map_err(in_file)?;
        let mut map = Self { path: path.to_owned(), file, head, resident: Vec::new(), file_bytes: length };
        let mut bytes = 0;
        for level in 0..map.levels() {
            let mut bricks = Vec::new();
            for number in map.head.levels[level]..map.head.levels[level + 1] {
                let brick = map.read(number)?;
                bytes += brick.memory_bytes();
                bricks.push(brick);
                if level > 0 && bytes > RESIDENT {
                    return Ok(map);
                }
            }
            map.resident.extend(bricks);
        }
        Ok(map)
    }

    /// What it belongs to.
    pub fn owner(&self) -> BrickOwner {
        self.head.owner
    }

    /// Discs that it was built from.
    pub fn discs(&self) -> u64 {
        self.head.discs
    }

    /// The variation below which bricks were eliminated.
    pub fn max_error(&self) -> f32 {
        self.head.max_error
    }

    /// Lower corner and side of its cube, render space.
    pub fn cube(&self) -> (Vec3, f32) {
        (self.head.origin, self.head.size)
    }

    /// Number of bricks.
    pub fn bricks(&self) -> usize {
        self.head.nodes.len()
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.head.levels.len() - 1
    }

    /// Bytes in memory, without the cache.
    pub fn memory_bytes(&self) -> usize {
        self.head.nodes.capacity() * size_of::<FileNode>()
            + self.resident.iter().map(Brick::memory_bytes).sum::<usize>()
    }

    /// Level of a brick.
    pub(super) fn level_of(&self, number: u32) -> usize {
        self.head.levels.partition_point(|&first| first <= number).saturating_sub(1)
    }

    /// Reads a brick from the file and checks it.
    ///
    /// # Errors
    /// If it cannot be read or is not as it was written.
    pub fn read(&self, number: u32) -> Result<Brick, BrickFileError> {
        let in_file = |problem| BrickFileError { file: self.path.clone(), problem };
        let node = &self.head.nodes[number as usize];
        let mut bytes = vec![0; usize::from(node.bytes)];
        self.file.read_exact_at(&mut bytes, node.at).map_err(|error| in_file(error.into()))?;
        if checksum(&bytes) != node.sum {
            let (at, bytes, level) = (node.at, node.bytes, self.level_of(number));
            return Err(in_file(BrickFileProblem::DamagedBrick { number, level, at, bytes }));
        }
        Brick::unpack(&bytes)
            .ok_or_else(|| in_file(BrickFileProblem::Content("a brick of it contradicts itself")))
    }

    /// Reads all bricks and counts them, level by level; `unit` is the length of one in metres.
    ///
    /// # Errors
    /// If a brick cannot be read or is damaged.
    pub fn inspect(&self, unit: f64) -> Result<Vec<BrickLevel>, BrickFileError> {
        (0..self.levels())
            .map(|level| {
                let mut counts = BrickLevel {
                    bricks: 0,
                    leaves: 0,
                    voxel: f64::from(self.head.size) * unit / 8.0 / f64::from(1u32 << level),
                    bytes: 0,
                    voxels: 0,
                    faces: 0,
                    fill_percent: 0.0,
                };
                for number in self.head.levels[level]..self.head.levels[level + 1] {
                    let (node, brick) = (&self.head.nodes[number as usize], self.read(number)?);
                    counts.bricks += 1;
                    counts.leaves += u64::from(node.children == 0);
                    counts.bytes += u64::from(node.bytes);
                    counts.voxels += u64::from(brick.voxels());
                    counts.faces += brick.faces() as u64;
                }
                counts.fill_percent =
                    100.0 * counts.voxels as f64 / (counts.bricks * super::VOXELS as u64) as f64;
                Ok(counts)
            })
            .collect()
    }

    /// The child of a node, if it exists.
    #[inline]
    pub(super) fn child(&self, number: u32, child: u32) -> Option<u32> {
        let node = &self.head.nodes[number as usize];
        let before = node.children & ((1u16 << child) - 1) as u8;
        (node.children >> child & 1 == 1).then(|| node.first_child + before.count_ones())
    }
}
