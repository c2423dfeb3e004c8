//! By what law rounds narrow, and whose random numbers they take.

use crate::render::pixels::CameraSamples;
use crate::sampling::mix;

/// The parameter of the law: the share of each round's photons that, seen as one growing map, would count. Two thirds balance
/// noise and the bias of smooth light: both fall with the third root of the rounds, in each look-up.
pub(super) const ALPHA: f64 = 2.0 / 3.0;

/// Area of the discs of estimates in each round over that in the first: r_i^2 / r_1^2 (Knaus & Zwicker 2011, eq. 20).
#[derive(Clone, Copy, Debug)]
pub(super) struct Areas {
    round: u64,
    area: f64,
}

impl Areas {
    /// From the first round on.
    pub(super) fn new() -> Self {
        Self { round: 0, area: 1.0 }
    }

    /// That of round `round`, counted from zero; no earlier one than was asked for before.
    pub(super) fn at(&mut self, round: u64) -> f64 {
        while self.round < round {
            self.round += 1;
            let i = self.round as f64;
            self.area *= (i + ALPHA) / (i + 1.0);
        }
        self.area
    }
}

/// Seed of the photons of a round, counted from zero: that of the first is the seed of the picture.
pub(super) fn photon_seed(seed: u64, round: u64) -> u64 {
    match round {
        0 => seed,
        _ => mix(mix(seed ^ 0x726f_756e_6473).wrapping_add(round)),
    }
}

/// Random numbers of the camera samples of a round. Even and odd rounds are two pictures, independent of each other, each of
/// which takes its points in their order.
pub(super) fn camera_samples(seed: u64, round: u64, spp: u32) -> CameraSamples {
    let number = u128::from(round / 2) * u128::from(spp);
    // Points are numbered in 32 bits; after those come others.
    let (first, set) = (number as u32, (number >> 32) as u64);
    let seed = match (round % 2, set) {
        (0, 0) => seed,
        (half, set) => mix(mix(seed ^ 0x6861_6c66).wrapping_add(2 * set + half)),
    };
    CameraSamples { seed, first }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn areas_fall_by_the_law() {
        let mut areas = Areas::new();
        assert_eq!(areas.at(0), 1.0);
        assert!((areas.at(1) - (1.0 + ALPHA) / 2.0).abs() < 1e-15);
        assert!((areas.at(2) - (1.0 + ALPHA) / 2.0 * (2.0 + ALPHA) / 3.0).abs() < 1e-15);
        // Like i^(alpha - 1) in the end.
        let (a, b) = (areas.at(10_000), areas.at(80_000));
        assert!((a / b - 2.0).abs() < 1e-3, "{}", a / b);
        // The same from the start, as after resuming.
        assert_eq!(Areas::new().at(80_000), b);
    }

    #[test]
    fn no_numbers_are_taken_twice() {
        let photons: BTreeSet<u64> =
            (0..4).flat_map(|seed| (0..1000).map(move |round| photon_seed(seed, round))).collect();
        assert_eq!(photons.len(), 4000);
        assert_eq!(photon_seed(9, 0), 9);
        let mut taken = BTreeSet::new();
        let late = (1u64 << 31) / 3 * 2;
        for round in (0..100).chain(late..late + 100) {
            let CameraSamples { seed, first } = camera_samples(1, round, 3);
            for i in 0..3 {
                assert!(taken.insert((seed, first.wrapping_add(i))), "round {round}");
            }
        }
    }
}
