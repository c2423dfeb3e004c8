//! Which photons a pass stores where media scatter light again and again (density control: Suykens & Willems, "Density Control for Photon
//! Maps", 2000).
//!
//! In a dense medium most photons collide where the light enters, hundreds of times each, and few get to where the picture sees it. All
//! collisions as they come would be the photons of a few paths, most of them where there are too many already. So a short pass divides
//! the space into cells of as many collisions each, and a photon is stored with a probability that grows with the size of its cell, its
//! power divided by that probability.

use super::record::PointRecord;
use crate::math::Bounds3;
use glam::Vec3;

/// Of the logarithm of the density of collisions, the share by which the stored photons even it out: with one they would be as dense
/// everywhere, with zero as dense as the light.
const EVENED: f64 = 0.75;

/// Most cells.
const MOST_CELLS: usize = 1024;

/// Paths of the short pass for each cell.
const PATHS_PER_CELL: u64 = 4;

/// Inner node of a binary tree in the order of levels; its children are at `2 i + 1` and `2 i + 2`.
#[derive(Clone, Copy, Debug)]
struct Split {
    axis: usize,
    at: f32,
}

/// Probabilities of storing photons in media, by place.
#[derive(Clone, Debug)]
pub(in crate::photons) struct Thinning {
    splits: Vec<Split>,
    /// By cell, in (0, 1].
    shares: Vec<f32>,
}

impl Thinning {
    /// Such that of a pass that is `times` as long as the one that recorded all `points`, of `paths` paths, about `wanted` photons are
    /// stored; `None` where there are not more.
    pub(in crate::photons) fn new(
        points: &[PointRecord],
        paths: u64,
        times: f64,
        wanted: f64,
    ) -> Option<Self> {
        if !(points.len() as f64 * times > wanted && wanted > 0.0) {
            return None;
        }
        let cells = (paths / PATHS_PER_CELL).clamp(1, MOST_CELLS as u64).next_power_of_two() as usize;
        let cells = if cells as u64 * PATHS_PER_CELL > paths { (cells / 2).max(1) } else { cells };
        let mut places: Vec<Vec3> = points.iter().map(|point| point.position).collect();
        let mut splits = vec![Split { axis: 0, at: 0.0 }; cells - 1];
        let mut sizes = vec![(0.0, 0.0); cells];
        let bounds = Bounds3::of_points(places.iter().map(|place| place.as_dvec3()));
        divide(&mut places, bounds, 0, &mut splits, &mut sizes);
        // Volumes as shares of the mean, so that nothing over- or underflows.
        let whole: f64 = sizes.iter().map(|(volume, _)| volume).sum();
        let weight = |&(volume, count): &(f64, f64)| {
            let sparse = volume / whole * points.len() as f64 / count;
            if sparse.is_finite() { sparse.powf(EVENED) } else { f64::INFINITY }
        };
        let weights: Vec<f64> = sizes.iter().map(weight).collect();
        let stored = |factor: f64| -> f64 {
            sizes
                .iter()
                .zip(&weights)
                .map(|((_, count), weight)| count * times * share(weight * factor))
                .sum()
        };
        // The factor, by its logarithm: the number stored grows with it.
        let (mut low, mut high) = (-80.0f64, 80.0f64);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if stored(middle.exp()) < wanted { low = middle } else { high = middle }
        }
        let factor = high.exp();
        Some(Self { splits, shares: weights.iter().map(|weight| share(weight * factor) as f32).collect() })
    }

    /// Probability of storing a photon at a place.
    pub(in crate::photons) fn share(&self, position: Vec3) -> f32 {
        let mut node = 0;
        while let Some(split) = self.splits.get(node) {
            node = 2 * node + if position[split.axis] < split.at { 1 } else { 2 };
        }
        self.shares[node - self.splits.len()]
    }
}

/// A probability that is not so small that one photon outweighs all others.
fn share(weight: f64) -> f64 {
    const LEAST: f64 = 1e-6;
    if weight.is_nan() { 1.0 } else { weight.clamp(LEAST, 1.0) }
}

/// Divides the places within `bounds` into halves, across the longest side, down to the cells, whose volumes and counts are written.
fn divide(places: &mut [Vec3], bounds: Bounds3, node: usize, splits: &mut [Split], cells: &mut [(f64, f64)]) {
    if node >= splits.len() {
        let size = bounds.max - bounds.min;
        cells[node - splits.len()] = (size.element_product(), places.len() as f64);
        return;
    }
    let axis = (bounds.max - bounds.min).max_position();
    let middle = places.len() / 2;
    let at = if places.is_empty() {
        bounds.center()[axis] as f32
    } else {
        places.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
    };
    splits[node] = Split { axis, at };
    let (mut low, mut high) = (bounds, bounds);
    low.max[axis] = at.into();
    high.min[axis] = at.into();
    // Those below `at` may be fewer than half where some are equal; the cells then are off by as many.
    let (left, right) = places.split_at_mut(middle);
    divide(left, low, 2 * node + 1, splits, cells);
    divide(right, high, 2 * node + 2, splits, cells);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::sampling::{Rng, Stream};

    /// Points whose density falls exponentially with x.
    fn falling(count: usize, stream: u64) -> Vec<PointRecord> {
        let mut rng = Rng::new(11, Stream::Measure, stream);
        (0..count)
            .map(|_| PointRecord {
                medium: 0,
                position: Vec3::new(-(1.0 - rng.next_f32()).ln(), rng.next_f32(), rng.next_f32()),
                wi: Vec3::X,
                power: Rgb::ONE,
                line: None,
            })
            .collect()
    }

    #[test]
    fn as_many_are_stored_as_wanted_and_evenly() {
        let thinning = Thinning::new(&falling(40_000, 0), 10_000, 8.0, 5000.0).unwrap();
        let others = falling(320_000, 1);
        let stored: f64 = others.iter().map(|p| f64::from(thinning.share(p.position))).sum();
        assert!((stored / 5000.0 - 1.0).abs() < 0.03, "{stored}");
        // Flux is kept: in each slice one over the probability gives back all.
        let mut rng = Rng::new(5, Stream::Measure, 2);
        let kept: Vec<(f32, f32)> = others
            .iter()
            .map(|p| (p.position.x, thinning.share(p.position)))
            .filter(|&(_, share)| rng.next_f32() < share)
            .collect();
        let within = |low: f32, high: f32| kept.iter().filter(move |(x, _)| (low..high).contains(x));
        for (low, high) in [(0.0f32, 0.5f32), (0.5, 2.0), (2.0, 5.0)] {
            let all = f64::from((-low).exp() - (-high).exp()) * 320_000.0;
            let flux: f64 = within(low, high).map(|&(_, share)| 1.0 / f64::from(share)).sum();
            assert!((flux / all - 1.0).abs() < 0.15, "{low}: {flux} for {all}");
        }
        // Four units farther there is 1/55 of the light and about 55^(1 - 3/4) fewer photons.
        let ratio = within(0.0, 0.5).count() as f64 / within(4.0, 4.5).count() as f64;
        assert!((1.8..4.2).contains(&ratio), "{ratio}");
    }

    #[test]
    fn nothing_is_thinned_without_need() {
        assert!(Thinning::new(&falling(100, 0), 50, 2.0, 200.0).is_none());
        assert!(Thinning::new(&[], 0, 2.0, 200.0).is_none());
        assert!(Thinning::new(&falling(100, 0), 50, 2.0, 0.0).is_none());
    }

    /// Cells without volume, all points at one place, and a place far away.
    #[test]
    fn degenerate_places() {
        let mut points = falling(1000, 0);
        for point in &mut points {
            point.position = Vec3::ONE;
        }
        points[7].position = Vec3::splat(1e30);
        let thinning = Thinning::new(&points, 900, 1.0, 100.0).unwrap();
        for place in [Vec3::ONE, Vec3::splat(1e30), Vec3::splat(-1e38), Vec3::NAN] {
            let share = thinning.share(place);
            assert!(share > 0.0 && share <= 1.0, "{place}: {share}");
        }
    }
}
