//! Merges corners at the same position into one vertex, on all threads.

use super::keyed::Keyed;
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::BuildHasher;
use std::sync::atomic::{AtomicU32, Ordering};

/// Number of shards, the parts of space by hash. One thread at a time works on a shard, so that its table fits into a processor's
/// cache.
const SHARDS: usize = 64;

/// Corners that a thread takes at a time.
const BLOCK: usize = 1 << 18;

/// Vertices, and the vertex number of each corner.
#[derive(Debug, PartialEq)]
pub(super) struct Welded {
    pub positions: Vec<[f32; 3]>,
    pub numbers: Vec<u32>,
}

/// Positive and negative zero are the same position; NaNs are equal where their bits are.
fn key(position: [f32; 3]) -> (u64, u32) {
    let [x, y, z] = position.map(|x| (x + 0.0).to_bits());
    (u64::from(x) << 32 | u64::from(y), z)
}

/// Numbers the vertices in order of first use by a corner, for any number of threads. `done` hears how many corners have been
/// looked up (each is looked up twice), and its error ends the work. At most `u32::MAX` corners.
pub(super) fn weld<E: Send>(
    count: usize,
    corner: impl Fn(usize) -> [f32; 3] + Sync,
    done: impl Fn(usize) -> Result<(), E> + Sync,
) -> Result<Welded, E> {
    debug_assert!(count <= u32::MAX as usize);
    let hash = Keyed::default();
    let blocks: Vec<_> = (0..count).step_by(BLOCK).map(|from| from..count.min(from + BLOCK)).collect();
    // The corners of each block by shard, in order.
    let sorted: Vec<Vec<Vec<u32>>> = blocks
        .par_iter()
        .map(|block| {
            let capacity = block.len() / SHARDS * 5 / 4;
            let mut shards: Vec<_> = (0..SHARDS).map(|_| Vec::with_capacity(capacity)).collect();
            for index in block.clone() {
                // Bits that the hash tables do not use.
                let shard = (hash.hash_one(key(corner(index))) >> 32) as usize % SHARDS;
                shards[shard].push(index as u32);
            }
            done(block.len())?;
            Ok(shards)
        })
        .collect::<Result<_, E>>()?;
    // For each corner the first corner at the same position.
    let firsts: Vec<AtomicU32> = (0..count).into_par_iter().map(|_| AtomicU32::new(0)).collect();
    (0..SHARDS).into_par_iter().try_for_each(|shard| {
        let mut places = HashMap::with_hasher(hash);
        for block in &sorted {
            for &index in &block[shard] {
                let first = *places.entry(key(corner(index as usize))).or_insert(index);
                firsts[index as usize].store(first, Ordering::Relaxed);
            }
            done(block[shard].len())?;
        }
        Ok(())
    })?;
    drop(sorted);
    let firsts: Vec<u32> = firsts.into_par_iter().map(AtomicU32::into_inner).collect();
    let is_first = |index: usize| firsts[index] as usize == index;
    let counts: Vec<usize> =
        blocks.par_iter().map(|block| block.clone().filter(|&index| is_first(index)).count()).collect();
    // Vertex numbers of the first corners: each block starts at the sum of the blocks before it.
    let sums = counts.iter().scan(0, |sum, count| {
        let before = *sum;
        *sum += count;
        Some(before)
    });
    let starts: Vec<usize> = sums.collect();
    let mut numbers = vec![0u32; count];
    numbers.par_chunks_mut(BLOCK).zip(&blocks).zip(&starts).for_each(|((numbers, block), &start)| {
        let firsts = block.clone().zip(numbers).filter(|(index, _)| is_first(*index));
        firsts.zip(start as u32..).for_each(|((_, number), next)| *number = next);
    });
    let positions =
        blocks.par_iter().flat_map_iter(|block| block.clone().filter(|&index| is_first(index)).map(&corner));
    let positions = positions.collect();
    let numbers = firsts.par_iter().map(|&first| numbers[first as usize]).collect();
    Ok(Welded { positions, numbers })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn numbers_are_those_of_one_after_the_other() {
        for count in [0, 1, 5, BLOCK, 2 * BLOCK + 77] {
            let mut rng = Rng::new(1, Stream::Measure, count as u64);
            // Nine in ten positions repeat; zeros have either sign.
            let mut axis =
                || (rng.next_f64() * 41.0).floor() as f32 * if rng.next_f64() < 0.5 { -0.0 } else { 1.0 };
            let corners: Vec<[f32; 3]> = (0..count).map(|_| [axis(), axis(), axis()]).collect();
            let mut expected = Welded { positions: Vec::new(), numbers: Vec::new() };
            let mut seen = HashMap::new();
            for &corner in &corners {
                let number = *seen.entry(key(corner)).or_insert_with(|| {
                    expected.positions.push(corner);
                    expected.positions.len() as u32 - 1
                });
                expected.numbers.push(number);
            }
            let found = weld(count, |index| corners[index], |_| Ok::<(), ()>(())).unwrap();
            assert!(found == expected, "{count}");
        }
        assert_eq!(weld(3, |_| [0.0; 3], |_| Err(7)), Err(7));
    }
}
