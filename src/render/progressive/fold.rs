//! How the rounds of a picture are added up: in blocks of [`BLOCK`] rounds. Each block is summed from zero and rounded, and the blocks are
//! added in order. So blocks that were rendered apart, on any machines, are added up to the same bits as those of a single render.

use crate::film::{Film, FilmError, HalvedSum, PixelRect, Precision};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io;
use std::ops::Range;

/// Rounds in a block. The number is part of the formats of checkpoints and parts, because the bits of a picture depend on it.
pub const BLOCK: u64 = 16;

/// Pixels of a band, the rows of a part that are compressed together: a band is decoded at a time.
const BAND: u32 = 1 << 16;

/// Number of blocks that so many rounds have.
pub fn blocks_of(rounds: u64) -> u64 {
    rounds.div_ceil(BLOCK)
}

/// Precision of the blocks of a picture of so many rounds. A single block is not rounded: it is added to nothing.
pub(super) fn precision_of(rounds: u64) -> Precision {
    if rounds <= BLOCK { Precision::Exact } else { Precision::Rounded }
}

/// A block as a part's file holds it: its bands, compressed.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct EncodedBlock {
    pub(super) bands: Vec<Vec<u8>>,
}

/// Blocks of a part, and what is known of them without decoding.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    pub(super) encoded: Vec<EncodedBlock>,
    pub(super) seen: Seen,
}

/// What blocks show, and how many samples were left out of them.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub(super) struct Seen {
    pub(super) objects: BTreeSet<u32>,
    pub(super) materials: BTreeSet<u32>,
    pub(super) rejected: u64,
}

/// The bands of a picture's window, in rows of the picture.
pub(super) fn bands(window: PixelRect) -> Vec<Range<u32>> {
    let rows = (BAND / window.width().max(1)).max(1);
    let count = window.height().div_ceil(rows);
    (0..count)
        .map(|band| {
            let start = window.y0 + band * rows;
            start..start.saturating_add(rows).min(window.y1)
        })
        .collect()
}

/// Blocks that are complete.
#[derive(Debug)]
pub(super) enum Fold {
    /// Of a picture: their sum, where there are any.
    Sum(Option<Box<HalvedSum>>),
    /// Of a part of one: each.
    Blocks(Blocks),
}

impl Fold {
    /// Adds the block that these halves form.
    pub(super) fn add(&mut self, halves: [Film; 2], precision: Precision) -> Result<(), FilmError> {
        let block = HalvedSum::of(halves, precision)?;
        match self {
            Self::Sum(Some(sum)) => sum.add(&block)?,
            Self::Sum(sum) => *sum = Some(Box::new(block)),
            Self::Blocks(blocks) => {
                let encoded: io::Result<Vec<_>> = bands(block.film().rect())
                    .into_par_iter()
                    .map(|rows| block.encode(rows, precision))
                    .collect();
                // Compression in memory does not fail.
                let bands = encoded.map_err(|_| FilmError::Foreign)?;
                let [objects, materials] = block.film().ids();
                blocks.seen.objects.extend(objects);
                blocks.seen.materials.extend(materials);
                blocks.seen.rejected += block.film().rejections().samples;
                blocks.encoded.push(EncodedBlock { bands });
            }
        }
        Ok(())
    }

    /// The sum of the blocks of a picture.
    pub(super) fn sum(&self) -> Option<&HalvedSum> {
        if let Self::Sum(Some(sum)) = self { Some(sum) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_the_rows_once() {
        for window in [
            PixelRect::whole(1920, 1080),
            PixelRect { x0: 5, y0: 7, x1: 9, y1: 40_000 },
            PixelRect::whole(65_536, 3),
        ] {
            let found = bands(window);
            assert_eq!(found[0].start, window.y0);
            assert_eq!(found[found.len() - 1].end, window.y1);
            assert!(found.windows(2).all(|pair| pair[0].end == pair[1].start && !pair[1].is_empty()));
            assert!(
                found.iter().all(|rows| (rows.len() as u32) * window.width() <= BAND.max(window.width()))
            );
        }
        assert_eq!([0, 1, 16, 17].map(blocks_of), [0, 1, 1, 2]);
    }
}
