//! Parts of a progressive picture added up to the whole: band of rows by band of rows, so that memory holds one picture and its halves,
//! whatever the number of parts.

use super::error::{ErrorEstimate, error_of_halves};
use super::fold::{BLOCK, bands, blocks_of};
use super::part::{PartError, PartFile, PartRange};
use super::{RoundStatistics, checkpoint::differences};
use crate::film::{Developed, FilmError, HalvedSum, Halves, Layer, PixelRect, Rejections};
use crate::integrators::Counters;
use crate::observer::Observer;
use crate::render::stats::Times;
use rayon::prelude::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Files that are kept open. Systems allow a process a thousand or so.
const MOST_OPEN: usize = 400;

/// An error of merging.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// A part cannot be read.
    #[error(transparent)]
    Part(#[from] PartError),
    /// There is no memory for the picture.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// No parts were given.
    #[error("there is no part to merge")]
    Nothing,
    /// Two parts are of different pictures.
    #[error("{} and {} are parts of different pictures: {}", one.display(), other.display(), differences.join("; "))]
    Different {
        /// A part.
        one: PathBuf,
        /// Another.
        other: PathBuf,
        /// Each difference, from the first to the second.
        differences: Vec<String>,
    },
    /// Two parts hold the same rounds.
    #[error("{} and {} both hold rounds {} to {}; leave one of them out", one.display(), other.display(), rounds[0] + 1, rounds[1])]
    Overlap {
        /// A part.
        one: PathBuf,
        /// Another.
        other: PathBuf,
        /// First common round, counted from zero, and the one after the last.
        rounds: [u64; 2],
    },
    /// A block is not the same in a picture of so many rounds.
    #[error(
        "{} was rendered for a picture of {had} rounds, whose last block is not that of {rounds} rounds, which others are for; render that \
         part again with --rounds {rounds}",
        path.display()
    )]
    Short {
        /// The part.
        path: PathBuf,
        /// Rounds of the picture that it is for.
        had: u64,
        /// Rounds of the picture that others are for.
        rounds: u64,
    },
    /// Rounds are missing.
    #[error("parts are missing: {}", missing_in_words(missing, *rounds, *of))]
    Missing {
        /// Rounds of the picture.
        rounds: u64,
        /// Missing blocks: the first, counted from zero, and the one after the last.
        missing: Vec<[u64; 2]>,
        /// Number of parts of which the others are.
        of: u64,
    },
    /// The merge was stopped.
    #[error("stopped before the parts were merged: no picture was written")]
    Stopped,
}

/// Most parts that a message names.
const MOST_NAMED: usize = 20;

/// Names the parts of `of` that hold missing blocks, and the rounds.
fn missing_in_words(missing: &[[u64; 2]], rounds: u64, of: u64) -> String {
    let lacks = |part: &PartRange| {
        let [first, end] = part.blocks(rounds);
        missing.iter().any(|&[from, to]| first < to && from < end)
    };
    let parts: Vec<PartRange> =
        (1..=of.min(blocks_of(rounds))).map(|part| PartRange { part, of }).filter(lacks).collect();
    let mut names: Vec<String> =
        parts.iter().take(MOST_NAMED).map(|part| format!("{}/{}", part.part, part.of)).collect();
    if parts.len() > MOST_NAMED {
        names.push(format!("and {} more", parts.len() - MOST_NAMED));
    }
    let round = |block: u64| block.saturating_mul(BLOCK).min(rounds);
    let ranges: Vec<String> = missing
        .iter()
        .take(MOST_NAMED)
        .map(|&[first, end]| format!("{} to {}", round(first) + 1, round(end)))
        .collect();
    format!("{} (rounds {} of {rounds})", names.join(", "), ranges.join(", "))
}

/// A picture merged of parts.
#[derive(Debug)]
pub struct Merged {
    /// The picture.
    pub developed: Developed,
    /// Statistics of all rounds.
    pub rounds: RoundStatistics,
    /// Counts of rays and look-ups in all rounds.
    pub counters: Counters,
    /// Seconds by step, of all parts together.
    pub times: Times,
    /// Names of the objects and of the materials that the picture shows.
    pub names: [BTreeMap<u32, String>; 2],
    /// What the caller that rendered the first part said of the picture.
    pub about: Value,
    /// Mean samples per pixel.
    pub samples: u64,
    /// Number of files.
    pub parts: u64,
    /// Bytes of all parts.
    pub bytes: u64,
    /// Warnings of the parts, each once.
    pub warnings: Vec<String>,
}

/// Adds up the parts of a picture: the same bits as those of one render with as many rounds.
///
/// # Errors
/// If a part cannot be read or is damaged, if the parts are not of one picture, or if rounds are missing or there twice.
pub fn merge_parts(paths: &[PathBuf], observer: &dyn Observer) -> Result<Merged, MergeError> {
    let mut parts = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        let part = PartFile::open(path)?;
        parts.push(if i < MOST_OPEN { part } else { part.closed() });
    }
    let (order, rounds) = ordered(&parts)?;
    let first = &parts[order[0].0];
    let window = first.header.rect();
    let (width, height, layers) = (first.header.width, first.header.height, first.header.layers);
    let bands = bands(window);
    observer.begin("bands merged", bands.len() as u64);
    let finished = AtomicU64::new(0);
    let memory = FilmError::Memory { width, height };
    let mut halves = Halves::new(window).ok_or(memory)?;
    let mut whole: Option<Developed> = None;
    let mut samples = 0;
    // As many bands at once as there are threads: more would only take memory.
    let numbered: Vec<_> = bands.into_iter().enumerate().collect();
    for group in numbered.chunks(rayon::current_num_threads().max(1)) {
        if observer.should_stop() {
            return Err(MergeError::Stopped);
        }
        let found: Result<Vec<_>, MergeError> = group
            .par_iter()
            .map(|(band, rows)| {
                let rect = PixelRect { y0: rows.start, y1: rows.end, ..window };
                let mut sum: Option<HalvedSum> = None;
                for &(part, block) in &order {
                    let mut added = HalvedSum::new(width, height, Some(rect), layers)?;
                    parts[part].read(block, *band, &mut added)?;
                    match &mut sum {
                        Some(sum) => sum.add(&added)?,
                        None => sum = Some(added),
                    }
                }
                let sum = sum.ok_or(MergeError::Nothing)?;
                observer.advance(finished.fetch_add(1, Ordering::Relaxed) + 1);
                Ok((sum.halves().clone(), sum.film().sample_count(), sum.into_film().develop()))
            })
            .collect();
        for (part_of_halves, count, band) in found? {
            halves.put(&part_of_halves);
            samples += count;
            append(&mut whole, band, window).ok_or(memory)?;
        }
    }
    let developed = whole.ok_or(MergeError::Nothing)?;
    samples /= window.area().max(1) as u64;
    let mut merged = Merged {
        developed,
        rounds: RoundStatistics { done: rounds, ..RoundStatistics::default() },
        counters: Counters::default(),
        times: Times::default(),
        names: Default::default(),
        about: first.header.about.clone(),
        samples,
        parts: parts.len() as u64,
        bytes: 0,
        warnings: Vec::new(),
    };
    merged.rounds.error = error_of_halves(|| halves.means(), [rounds.div_ceil(2), rounds / 2]);
    let mut seen = Vec::new();
    for &(part, _) in &order {
        if !seen.contains(&part) {
            seen.push(part);
            merged.count(&parts[part]);
        }
    }
    Ok(merged)
}

impl Merged {
    fn count(&mut self, part: &PartFile) {
        let summary = &part.summary;
        let rounds = &mut self.rounds;
        rounds.photons_emitted += summary.statistics.photons_emitted;
        rounds.photons_stored += summary.statistics.photons_stored;
        rounds.seconds += summary.statistics.seconds;
        rounds.area = summary.statistics.area;
        self.counters += summary.counters;
        let (sum, added) = (&mut self.times, &summary.times);
        sum.photons += added.photons;
        sum.cache += added.cache;
        sum.pixels += added.pixels;
        self.developed.rejections.samples += summary.rejected;
        self.bytes += part.length();
        for (names, found) in self.names.iter_mut().zip([&summary.objects, &summary.materials]) {
            names.extend(found.iter().map(|(id, name)| (*id, name.clone())));
        }
        for warning in &summary.warnings {
            if !self.warnings.contains(warning) {
                self.warnings.push(warning.clone());
            }
        }
    }
}

/// Appends the rows of a band to a picture; `None` where there is no memory for it.
fn append(whole: &mut Option<Developed>, band: Developed, window: PixelRect) -> Option<()> {
    if whole.is_none() {
        let mut layers = Vec::new();
        for Layer { name, channels, .. } in &band.layers {
            let mut values = Vec::new();
            values.try_reserve_exact(window.area().checked_mul(channels.len())?).ok()?;
            layers.push(Layer { name, channels, values });
        }
        let (rejections, width, height) = (Rejections::default(), band.width, band.height);
        *whole =
            Some(Developed { width, height, rect: window, layers, unsampled: 0, clamped: 0, rejections });
    }
    let whole = whole.as_mut()?;
    for (layer, rows) in whole.layers.iter_mut().zip(&band.layers) {
        layer.values.extend_from_slice(&rows.values);
    }
    whole.unsampled += band.unsampled;
    whole.clamped += band.clamped;
    Some(())
}

/// The part and number of each block of the picture, in order, and the number of rounds of the picture.
fn ordered(parts: &[PartFile]) -> Result<(Vec<(usize, u64)>, u64), MergeError> {
    let first = parts.first().ok_or(MergeError::Nothing)?;
    let rounds = parts.iter().map(|part| part.header.rounds).max().unwrap_or(0);
    for part in &parts[1..] {
        let (a, b) = (&first.header, &part.header);
        let mut differences = differences(&a.identity, &b.identity);
        if differences.is_empty()
            && (a.width, a.height, a.window, a.layers) != (b.width, b.height, b.window, b.layers)
        {
            differences.push("their sizes or layers".to_owned());
        }
        if !differences.is_empty() {
            return Err(MergeError::Different {
                one: first.path.clone(),
                other: part.path.clone(),
                differences,
            });
        }
    }
    let whole = |block: u64| rounds.saturating_sub(block.saturating_mul(BLOCK)).min(BLOCK);
    let round = |block: u64| block.saturating_mul(BLOCK).min(rounds);
    let mut sorted: Vec<usize> = (0..parts.len()).collect();
    sorted.sort_by_key(|&part| parts[part].header.blocks);
    let (mut order, mut missing, mut end) = (Vec::new(), Vec::new(), 0);
    let mut before: Option<&PartFile> = None;
    for part in sorted {
        let file = &parts[part];
        let [from, to] = file.header.blocks;
        if let Some(before) = before.filter(|_| from < end) {
            let (one, other) = (before.path.clone(), file.path.clone());
            return Err(MergeError::Overlap { one, other, rounds: [round(from), round(to.min(end))] });
        }
        if from > end {
            missing.push([end, from]);
        }
        let is_alone = file.header.rounds <= BLOCK;
        if file.header.rounds_in(to - 1) != whole(to - 1) || is_alone != (rounds <= BLOCK) {
            let (path, had) = (file.path.clone(), file.header.rounds);
            return Err(MergeError::Short { path, had, rounds });
        }
        order.extend((from..to).map(|block| (part, block)));
        (end, before) = (to, Some(file));
    }
    if end < blocks_of(rounds) {
        missing.push([end, blocks_of(rounds)]);
    }
    if missing.is_empty() {
        Ok((order, rounds))
    } else {
        Err(MergeError::Missing { rounds, missing, of: first.header.part.of })
    }
}

/// Rounds after which a picture is foreseen to have this error, where its estimate is as given: noise falls with the root of the number
/// of rounds, and bias with the third root (`docs/progressive.md`). A multiple of [`BLOCK`]; `None` where the error is not positive or there
/// would be too many rounds.
pub fn rounds_needed(estimate: &ErrorEstimate, target: f64) -> Option<u64> {
    let done = estimate.rounds as f64;
    let square = |rounds: f64| {
        let share = done / rounds;
        estimate.noise.powi(2) * share + (estimate.bias * share.cbrt()).powi(2)
    };
    if !(target > 0.0 && square(done).is_finite()) {
        return None;
    }
    // The error falls with each block, so the least number of blocks is found by halving an interval.
    let enough = |blocks: u64| square((blocks * BLOCK) as f64) <= target * target;
    let (mut low, mut high) = (0, 1);
    while !enough(high) {
        low = high;
        high = high.checked_mul(2).filter(|&blocks| blocks < 1 << 50)?;
    }
    while high - low > 1 {
        let middle = low.midpoint(high);
        if enough(middle) { high = middle } else { low = middle }
    }
    Some(high * BLOCK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observer::Silent;
    use crate::render::progressive::part::blank_part_bytes;
    use std::fs;

    #[test]
    fn rounds_needed_for_a_target() {
        let estimate = |noise: f64, bias: f64| ErrorEstimate {
            rounds: 64,
            error: noise.hypot(bias),
            noise,
            bias,
            glints: 0,
            noise_without_glints: noise,
        };
        // Noise alone: a quarter of it with sixteen times the rounds. Bias alone: half of it with eight times the rounds.
        assert_eq!(rounds_needed(&estimate(0.08, 0.0), 0.0200001), Some(1024));
        assert_eq!(rounds_needed(&estimate(0.0, 0.08), 0.0400001), Some(512));
        assert_eq!(rounds_needed(&estimate(0.08, 0.0), 0.5), Some(16));
        assert_eq!(rounds_needed(&estimate(0.0, 0.08), 1e-9), None);
        assert_eq!(rounds_needed(&estimate(f64::NAN, 0.0), 0.1), None);
    }

    #[test]
    fn missing_parts_are_named() {
        // Of 100 rounds in 7 blocks and 3 parts: blocks 0 and 1, 2 and 3, 4 to 6.
        let words = missing_in_words(&[[1, 3]], 100, 3);
        assert_eq!(words, "1/3, 2/3 (rounds 17 to 48 of 100)");
        assert_eq!(missing_in_words(&[[6, 7]], 100, 3), "3/3 (rounds 97 to 100 of 100)");
        assert!(missing_in_words(&[[0, 100]], 1600, 100).contains("20/100, and 80 more"));
    }

    /// Any changed byte is seen, and nothing is read past the end.
    #[test]
    fn damaged_parts_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        let whole = blank_part_bytes((5, 4), 2).unwrap();
        fs::write(&path, &whole).unwrap();
        let merged = merge_parts(std::slice::from_ref(&path), &Silent).unwrap();
        assert_eq!((merged.rounds.done, merged.developed.unsampled), (32, 20));
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 4;
            fs::write(&path, &damaged).unwrap();
            let error = merge_parts(std::slice::from_ref(&path), &Silent).unwrap_err();
            assert!(error.to_string().contains("a.part"), "byte {at}: {error}");
        }
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(merge_parts(std::slice::from_ref(&path), &Silent).is_err(), "{length}");
        }
    }
}
