//! Differential checking: an estimate stops growing where it changes in one direction only.
//!
//! "When adding photons to the estimate and being near an edge the changes of the estimate will be monotonic [...] we
//! stop adding photons and use the estimate available" (Jensen & Christensen 1995, section 3.3). Taken to the letter
//! any estimate stops, because monotonic runs also occur by chance: an estimate that happens to be high among its
//! nearest photons falls from there on. Here a run must be longer, and its change larger, than chance explains.
//!
//! The disc is divided by area and not by number of photons. Given the flux of the whole disc, the flux in a fixed
//! share of its area varies evenly to both sides. Chance therefore stops estimates that are too high as often as those
//! that are too low.

/// Estimates that are compared, each over `STEP` times the area of the one before, the last over the whole disc.
const LOOKS: usize = 10;
const STEP: f32 = 1.25;

/// Expected number of photons, in uniform flux, in the smallest disc that is used.
const FEWEST: f32 = 12.0;

/// Consecutive changes in one direction that make a run.
const RUN: u32 = 3;

/// Least change of a run, in standard deviations under uniform flux.
const DEVIATIONS: f64 = 3.0;

/// Factor on the squared radius to which an estimate is to shrink; `None` where there is no reason to shrink it.
///
/// `photons` holds, for each photon, its squared distance as a share of the squared radius, and its flux (any fixed
/// measure of it).
pub(super) fn shrink(photons: impl ExactSizeIterator<Item = (f32, f32)>) -> Option<f32> {
    let shares: [f32; LOOKS] = std::array::from_fn(|i| STEP.powi(i as i32 + 1 - LOOKS as i32));
    let count = photons.len() as f32;
    let (mut flux, mut squares) = ([0.0f64; LOOKS], 0.0f64);
    for (share, power) in photons {
        // The smallest disc that contains the photon.
        let look = shares.iter().filter(|&&s| s < share).count().min(LOOKS - 1);
        flux[look] += f64::from(power);
        squares += f64::from(power) * f64::from(power);
    }
    let mut sum = 0.0;
    let densities: [f64; LOOKS] = std::array::from_fn(|i| {
        sum += flux[i];
        sum / f64::from(shares[i])
    });
    // Relative variance of the whole: one over the count, where all photons are alike.
    let variance = if sum > 0.0 { squares / (sum * sum) } else { return None };
    let first = shares.iter().position(|&share| share * count >= FEWEST)?;
    let (mut start, mut run) = (first, 0);
    for look in first + 1..LOOKS {
        let rises = densities[look] > densities[look - 1];
        if run > 0 && rises != (densities[look - 1] > densities[look - 2]) {
            (start, run) = (look - 1, 0);
        }
        run += 1;
        let change = densities[look] - densities[start];
        // Given the flux of the larger disc, the flux of a smaller one varies with the area that it leaves out.
        let chance = variance * f64::from(1.0 / shares[start] - 1.0 / shares[look]);
        if run >= RUN && change.abs() > DEVIATIONS * chance.sqrt() * densities[look] {
            return Some(shares[start]);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use crate::math::Rgb;
    use crate::photons::{EstimateParams, Estimator, Kernel, Photon, PhotonClass, PhotonMap, Query, Scratch};
    use crate::sampling::{Rng, Stream};
    use glam::Vec3;

    const PARAMS: EstimateParams =
        EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };

    /// Photons on the unit square at `y = 0`, a share of `bright` of them at `x < 0.5`.
    fn edge(count: u64, bright: f32, seed: u64) -> PhotonMap {
        let photon = |i| {
            let mut rng = Rng::new(seed, Stream::Measure, i);
            let u = rng.next_2d();
            let x = if rng.next_f32() < bright { 0.5 * u.x } else { 0.5 + 0.5 * u.x };
            let place = Vec3::new(x, 0.0, u.y);
            Photon::new(place, Rgb::ONE, Vec3::Y, Vec3::Y, PhotonClass::Caustic, rng.next_f32())
        };
        PhotonMap::build((0..count).map(photon).collect(), count)
    }

    /// Mean and relative standard deviation of estimates at `x`, and the share that stopped early.
    fn at(maps: &[PhotonMap], x: f32, k: usize, differential_check: bool) -> (f64, f64, f64) {
        let mut scratch = Scratch::default();
        let (mut sum, mut squares, mut stops, mut n) = (0.0, 0.0, 0.0, 0.0);
        for (seed, map) in maps.iter().enumerate() {
            let mut rng = Rng::new(seed as u64, Stream::Measure, 1 << 40);
            for _ in 0..150 {
                let place = Vec3::new(x, 0.0, 0.2 + 0.6 * rng.next_f32());
                let query = Query { differential_check, ..Query::nearest(place, Vec3::Y, k) };
                let estimate = map.estimate_irradiance(&query, &PARAMS, &mut scratch);
                let value = f64::from(estimate.value.x);
                sum += value;
                squares += value * value;
                stops += f64::from(u8::from(estimate.at_edge));
                n += 1.0;
            }
        }
        let mean = sum / n;
        (mean, (squares / n - mean * mean).max(0.0).sqrt() / mean, stops / n)
    }

    /// The stated bound: within 1 % of uniform flux, for 50 photons or more.
    #[test]
    fn uniform_flux_keeps_its_mean() {
        let maps: Vec<_> = (0..200).map(|seed| edge(5000, 0.5, seed)).collect();
        for k in [50, 100, 200] {
            let (off_mean, off_deviation, none) = at(&maps, 0.27, k, false);
            let (mean, deviation, stops) = at(&maps, 0.27, k, true);
            println!(
                "N = {k}: {off_mean:.4} +- {off_deviation:.3} unchecked, {mean:.4} +- {deviation:.3} checked, {:.1} % \
                 stop",
                100.0 * stops
            );
            assert_eq!(none, 0.0);
            assert!((mean / off_mean - 1.0).abs() < 0.01, "N = {k}: {mean}, not {off_mean}");
            assert!(deviation < 1.6 * off_deviation, "N = {k}: {deviation}, not {off_deviation}");
        }
    }

    /// Distance over which the mean estimate falls from 75 % to 25 % of the step.
    fn width(maps: &[PhotonMap], (high, low): (f64, f64), k: usize, check: bool) -> f64 {
        let profile: Vec<(f64, f64)> = (-20..=20)
            .map(|i| 0.5 + f64::from(i) * 0.004)
            .map(|x| (x, (at(maps, x as f32, k, check).0 - low) / (high - low)))
            .collect();
        let crossing = |level: f64| {
            profile
                .windows(2)
                .find(|w| w[0].1 >= level && w[1].1 < level)
                .map(|w| w[0].0 + (w[0].1 - level) / (w[0].1 - w[1].1) * (w[1].0 - w[0].0))
        };
        crossing(0.25).unwrap() - crossing(0.75).unwrap()
    }

    #[test]
    fn edges_get_sharper() {
        // Ten to one; the exact profile is a step.
        let maps: Vec<_> = (0..10).map(|seed| edge(20_000, 10.0 / 11.0, seed)).collect();
        let levels = (20.0 / 11.0, 2.0 / 11.0);
        for k in [100, 200] {
            let (without, with) = (width(&maps, levels, k, false), width(&maps, levels, k, true));
            println!("N = {k}: edge {without:.4} wide, checked {with:.4}");
            assert!(with < 0.7 * without, "N = {k}: {with}, not {without}");
        }
    }
}
