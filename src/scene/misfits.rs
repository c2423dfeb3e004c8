//! Misfits: surfaces whose interfaces contradict the medium stacks of rays, counted for a warning that names them.

use std::sync::atomic::{AtomicU32, Ordering};

/// Counting stops at this number: by then it is known which surfaces to report, and threads no longer contend for the counters.
const ENOUGH: u32 = 1 << 16;

/// A surface is left out if its count times this is below the worst count: rounding causes a few contradictions anywhere.
const LEAST_SHARE: u32 = 10;

/// For each surface, how often a ray met it from inside a body that the ray had not entered.
#[derive(Debug, Default)]
pub(super) struct Misfits(Vec<AtomicU32>);

impl Misfits {
    pub(super) fn of(surfaces: usize) -> Self {
        Self(std::iter::repeat_with(AtomicU32::default).take(surfaces).collect())
    }

    #[cold]
    pub(super) fn note(&self, surface: u32) {
        if let Some(count) = self.0.get(surface as usize)
            && count.load(Ordering::Relaxed) < ENOUGH
        {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The surfaces with most of the contradictions, the worst first.
    pub(super) fn worst(&self) -> Vec<u32> {
        let counts: Vec<u32> = self.0.iter().map(|count| count.load(Ordering::Relaxed).min(ENOUGH)).collect();
        let most = counts.iter().copied().max().unwrap_or(0);
        let mut worst: Vec<u32> = (0..counts.len() as u32)
            .filter(|&surface| counts[surface as usize] > 0)
            .filter(|&surface| LEAST_SHARE * counts[surface as usize] >= most)
            .collect();
        worst.sort_by_key(|&surface| std::cmp::Reverse(counts[surface as usize]));
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_come_first_and_the_rare_not_at_all() {
        let misfits = Misfits::of(4);
        for (surface, times) in [(0, 3), (1, 0), (2, 100), (3, 40)] {
            (0..times).for_each(|_| misfits.note(surface));
        }
        assert_eq!(misfits.worst(), [2, 3]);
        // Numbers of unknown surfaces do no harm, and neither do very large counts.
        misfits.note(9);
        (0..3 * ENOUGH).for_each(|_| misfits.note(1));
        assert_eq!(misfits.worst(), [1]);
        assert!(Misfits::of(0).worst().is_empty());
    }
}
