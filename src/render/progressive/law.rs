//! Radius schedule of progressive rounds, and the random numbers of each round.

use crate::render::pixels::CameraSamples;
use crate::sampling::mix;

/// Parameter of the radius schedule: the share of each round's photons that would count in one growing map. Two thirds balance noise and
/// the bias of smooth light: in each lookup both fall with the third root of the number of rounds.
pub(super) const ALPHA: f64 = 2.0 / 3.0;

/// Disc area of estimates in each round over that in the first round: r_i^2 / r_1^2 (Knaus & Zwicker 2011, eq. 20).
#[derive(Clone, Copy, Debug)]
pub(super) struct Areas {
    round: u64,
    area: f64,
}

impl Areas {
    /// Starts at the first round.
    pub(super) fn new() -> Self {
        Self { round: 0, area: 1.0 }
    }

    /// The area of round `round`, counted from zero. Rounds must not decrease from call to call.
    pub(super) fn at(&mut self, round: u64) -> f64 {
        while self.round < round {
            self.round += 1;
            let i = self.round as f64;
            self.area *= (i + ALPHA) / (i + 1.0);
        }
        self.area
    }
}

/// Photon seed of a round, counted from zero. The first round has the seed of the picture.
pub(super) fn photon_seed(seed: u64, round: u64) -> u64 {
    match round {
        0 => seed,
        _ => mix(mix(seed ^ 0x726f_756e_6473).wrapping_add(round)),
    }
}

/// Random numbers of the camera samples of a round. Even and odd rounds form two independent pictures; each takes its sample points in
/// sequence.
pub(super) fn camera_samples(seed: u64, round: u64, spp: u32) -> CameraSamples {
    let number = u128::from(round / 2) * u128::from(spp);
    // Points are numbered in 32 bits; when the numbers run out, another set follows.
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
        // The area tends to a multiple of i^(alpha - 1).
        let (a, b) = (areas.at(10_000), areas.at(80_000));
        assert!((a / b - 2.0).abs() < 1e-3, "{}", a / b);
        // A new schedule gives the same area, as when a render is resumed.
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
