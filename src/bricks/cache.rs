//! The cache of bricks: a table of last bricks for each thread, a shared cache behind it, and the files behind that.

use super::brick::Brick;
use super::file::BrickFileError;
use super::map::BrickMap;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use std::ops::AddAssign;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most bricks in the table of a thread.
const TABLE: usize = 64;

/// Share of the budget for the tables of all threads, as a divisor.
const TABLE_SHARE: u64 = 8;

/// Bytes that a brick in a table takes for certain.
const SLOT: u64 = 4096;

/// Bytes that the shared cache takes for a brick beside the brick itself.
const OVERHEAD: u64 = 64;

/// Counts of brick look-ups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct BrickCounters {
    /// Look-ups of bricks: hits, misses, and those of coarse levels that always stay in memory.
    pub looked_up: u64,
    /// Look-ups of coarse levels that always stay in memory.
    pub resident: u64,
    /// Look-ups that the table of last bricks of the thread answered.
    pub last_used: u64,
    /// Look-ups that the shared cache answered.
    pub cached: u64,
    /// Look-ups that read the file.
    pub missed: u64,
    /// Bytes read from files.
    pub read_bytes: u64,
}

impl AddAssign for BrickCounters {
    fn add_assign(&mut self, other: Self) {
        self.looked_up += other.looked_up;
        self.resident += other.resident;
        self.last_used += other.last_used;
        self.cached += other.cached;
        self.missed += other.missed;
        self.read_bytes += other.read_bytes;
    }
}

/// A brick of one of the maps.
type Key = u64;

fn key_of(map: u32, number: u32) -> Key {
    u64::from(map) << 32 | u64::from(number)
}

/// What a thread keeps: its table of last bricks.
#[derive(Debug, Default)]
pub struct BrickReader {
    table: Vec<Option<(Key, Arc<Brick>)>>,
    /// The brick that was read last, where nothing is cached.
    uncached: Option<Brick>,
}

#[derive(Clone, Copy, Debug)]
struct Bytes;

impl Weighter<Key, Arc<Brick>> for Bytes {
    fn weight(&self, _: &Key, brick: &Arc<Brick>) -> u64 {
        brick.memory_bytes() as u64 + OVERHEAD
    }
}

/// The shared part of the cache. What it holds decides how long a look-up takes and never its result.
#[derive(Debug)]
pub(super) struct BrickCache {
    /// `None` where every look-up reads the file.
    shared: Option<Cache<Key, Arc<Brick>, Bytes>>,
    /// Bricks in the table of each thread, a power of two, or zero.
    table: usize,
    /// By map: one bit for each brick that was read.
    touched: Vec<Vec<AtomicU64>>,
    inserted: AtomicU64,
}

impl BrickCache {
    /// A cache of at most `budget` bytes in all, of which `threads` threads have tables.
    pub(super) fn new(maps: &[BrickMap], budget: u64, threads: usize) -> Self {
        let each = budget / TABLE_SHARE / SLOT / threads.max(1) as u64;
        let table = (each as usize).min(TABLE);
        let table = if table == 0 { 0 } else { 1 << table.ilog2() };
        let capacity = budget - (table * threads) as u64 * SLOT;
        let bits = |map: &BrickMap| (0..map.bricks().div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        Self {
            shared: (budget > 0).then(|| Cache::with_weighter((capacity / 1024) as usize, capacity, Bytes)),
            table,
            touched: maps.iter().map(bits).collect(),
            inserted: AtomicU64::new(0),
        }
    }

    /// Bricks that were read at least once.
    pub(super) fn touched(&self) -> u64 {
        let ones = |word: &AtomicU64| u64::from(word.load(Ordering::Relaxed).count_ones());
        self.touched.iter().flatten().map(ones).sum()
    }

    /// Bytes and number of the bricks in the shared cache at present.
    pub(super) fn held(&self) -> (u64, u64) {
        self.shared.as_ref().map_or((0, 0), |shared| (shared.weight(), shared.len() as u64))
    }

    /// Bricks that had to leave the shared cache, or were not taken into it.
    pub(super) fn evicted(&self) -> u64 {
        self.inserted.load(Ordering::Relaxed).saturating_sub(self.held().1)
    }

    /// Calls `use_it` with a brick.
    #[inline]
    pub(super) fn with<R>(
        &self,
        (number_of_map, map): (u32, &BrickMap),
        number: u32,
        (reader, counters): (&mut BrickReader, &mut BrickCounters),
        use_it: impl FnOnce(&Brick) -> R,
    ) -> Result<R, BrickFileError> {
        counters.looked_up += 1;
        if let Some(brick) = map.resident.get(number as usize) {
            counters.resident += 1;
            return Ok(use_it(brick));
        }
        let Some(shared) = &self.shared else {
            let brick = reader.uncached.insert(self.read((number_of_map, map), number, counters)?);
            return Ok(use_it(brick));
        };
        let key = key_of(number_of_map, number);
        if reader.table.len() != self.table {
            reader.table = vec![None; self.table];
        }
        // Fibonacci hashing: neighbours in Morton order go to different places.
        let slot = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & self.table.wrapping_sub(1);
        if let Some(Some((known, brick))) = reader.table.get(slot)
            && *known == key
        {
            counters.last_used += 1;
            return Ok(use_it(brick));
        }
        let before = counters.missed;
        let brick = shared.get_or_insert_with(&key, || {
            self.inserted.fetch_add(1, Ordering::Relaxed);
            self.read((number_of_map, map), number, counters).map(Arc::new)
        })?;
        if counters.missed == before {
            counters.cached += 1;
        }
        let result = use_it(&brick);
        if let Some(place) = reader.table.get_mut(slot) {
            *place = Some((key, brick));
        }
        Ok(result)
    }

    fn read(
        &self,
        (number_of_map, map): (u32, &BrickMap),
        number: u32,
        counters: &mut BrickCounters,
    ) -> Result<Brick, BrickFileError> {
        counters.missed += 1;
        let brick = map.read(number)?;
        counters.read_bytes += u64::from(map.head.nodes[number as usize].bytes);
        let (word, bit) =
            (&self.touched[number_of_map as usize][number as usize / 64], 1u64 << (number % 64));
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
        Ok(brick)
    }
}
