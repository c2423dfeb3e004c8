//! An irradiance atlas: a brick map for each group of objects, and one cache for all of them.

use super::brick::{Brick, coverage_table};
use super::cache::{BrickCache, BrickCounters, BrickReader};
use super::file::BrickFileError;
use super::look_up::{Bricks, Found};
use super::map::BrickMap;
use glam::Vec3;
use serde::Serialize;
use std::sync::OnceLock;

/// Brick maps by group of objects, read through a cache.
#[derive(Debug)]
pub struct IrradianceAtlas {
    maps: Vec<BrickMap>,
    /// By surface: its map; [`NONE`] where no photon came to its group.
    of_surface: Vec<u32>,
    cache: BrickCache,
    budget: u64,
    coverage: [f32; 256],
    failure: OnceLock<BrickFileError>,
}

/// No map.
const NONE: u32 = u32::MAX;

/// Sizes of an atlas and what was read of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AtlasCounts {
    /// Brick maps.
    pub brick_maps: u64,
    /// Bricks in their files.
    pub bricks: u64,
    /// Bytes of their files.
    pub file_bytes: u64,
    /// Bytes of octrees and coarse levels in memory.
    pub octree_bytes: u64,
    /// Bytes of bricks in the cache at the end.
    pub cache_bytes: u64,
    /// Bricks in the cache at the end.
    pub cached_bricks: u64,
    /// Different bricks that were read.
    pub touched: u64,
    /// Bricks that left the cache.
    pub evicted: u64,
}

impl IrradianceAtlas {
    /// An atlas of these maps. `of_surface` has the map of each surface, with a cache of `budget` bytes for `threads` threads; `None` where no
    /// photon came to the group of the surface.
    pub fn new(
        maps: Vec<BrickMap>,
        of_surface: impl IntoIterator<Item = Option<usize>>,
        (budget, threads): (u64, usize),
    ) -> Self {
        let of_surface = of_surface.into_iter();
        let of_surface =
            of_surface.map(|map| map.filter(|&map| map < maps.len()).map_or(NONE, |map| map as u32));
        Self {
            of_surface: of_surface.collect(),
            cache: BrickCache::new(&maps, budget, threads),
            budget,
            coverage: coverage_table(),
            failure: OnceLock::new(),
            maps,
        }
    }

    /// The maps.
    pub fn maps(&self) -> &[BrickMap] {
        &self.maps
    }

    /// Irradiance at `position` of a surface, on the side of the unit `normal`, averaged over about `width` (render space); `None` where there
    /// is none. The result does not depend on what the cache holds.
    ///
    /// A brick that cannot be read is nothing, and is remembered: see [`Self::failure`].
    #[inline]
    pub fn look_up(
        &self,
        reader: (&mut BrickReader, &mut BrickCounters),
        surface: u32,
        place: (Vec3, Vec3),
        width: f32,
    ) -> Option<Found> {
        let number = *self.of_surface.get(surface as usize)?;
        let map = self.maps.get(number as usize)?;
        let mut bricks = Reading { cache: &self.cache, map: (number, map), reader };
        match map.look_up(&mut bricks, place, width, &self.coverage) {
            Ok(found) => found,
            Err(error) => {
                // The first one is told.
                let _ = self.failure.set(error);
                None
            }
        }
    }

    /// The first error of reading a brick. A picture that was rendered with this atlas is then wrong.
    pub fn failure(&self) -> Option<&BrickFileError> {
        self.failure.get()
    }

    /// Bytes that the cache may take.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// Sizes, and what was read so far.
    pub fn counts(&self) -> AtlasCounts {
        let sum = |of: fn(&BrickMap) -> u64| self.maps.iter().map(of).sum();
        let (cache_bytes, cached_bricks) = self.cache.held();
        AtlasCounts {
            brick_maps: self.maps.len() as u64,
            bricks: sum(|map| map.bricks() as u64),
            file_bytes: sum(|map| map.file_bytes),
            octree_bytes: sum(|map| map.memory_bytes() as u64),
            cache_bytes,
            cached_bricks,
            touched: self.cache.touched(),
            evicted: self.cache.evicted(),
        }
    }
}

/// The bricks of one map, through the cache.
struct Reading<'a> {
    cache: &'a BrickCache,
    map: (u32, &'a BrickMap),
    reader: (&'a mut BrickReader, &'a mut BrickCounters),
}

impl Bricks for Reading<'_> {
    #[inline]
    fn with<R>(&mut self, number: u32, use_it: impl FnOnce(&Brick) -> R) -> Result<R, BrickFileError> {
        self.cache.with(self.map, number, (&mut *self.reader.0, &mut *self.reader.1), use_it)
    }
}
