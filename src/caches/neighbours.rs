//! Neighbour clamping (Krivanek, Bouatouch, Pattanaik & Zara, "Making Radiance and Irradiance Caching Practical: Adaptive
//! Caching and Neighbor Clamping", Eurographics Symposium on Rendering 2006).

use glam::Vec3;
use rayon::prelude::*;

/// A place, and a length measured there that cannot change faster than the position: the distance of a visible surface.
pub(super) type Measured = (Vec3, f32);

/// Points in a leaf.
const LEAF: usize = 8;

/// Measured lengths, searchable by position.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbours {
    places: Vec<Measured>,
    order: Vec<u32>,
    parts: Vec<Part>,
}

impl Neighbours {
    pub(super) fn new(places: Vec<Measured>) -> Self {
        let mut order: Vec<u32> = (0..places.len() as u32).collect();
        let mut parts = Vec::new();
        if !places.is_empty() {
            divide(&places, &mut order, 0, &mut parts);
        }
        Self { places, order, parts }
    }

    /// The least of all lengths, each plus the distance from `position` to the place of measurement. A few rays may
    /// miss a small object nearby that the neighbouring hemispheres find. Infinite where there is no measurement.
    ///
    /// It depends only on the set of places.
    pub(super) fn least(&self, position: Vec3) -> f32 {
        let mut best = f32::INFINITY;
        let mut node = 0;
        while let Some(part) = self.parts.get(node) {
            let outside = (part.low - position).max(position - part.high).max(Vec3::ZERO).length();
            if part.least + outside >= best {
                node = part.next as usize;
                continue;
            }
            for &i in &self.order[part.range.0 as usize..part.range.1 as usize] {
                let (q, length) = self.places[i as usize];
                best = best.min(length + position.distance(q));
            }
            node += 1;
        }
        best
    }

    /// [`Self::least`] at each place, in their order.
    pub(super) fn clamped(&self) -> Vec<f32> {
        self.places.par_iter().map(|&(position, _)| self.least(position)).collect()
    }
}

/// A node of a tree over the places: its box, the least length in it, and the range of `order` it covers. The first child
/// follows; `next` is the node after the whole subtree.
#[derive(Clone, Debug)]
struct Part {
    low: Vec3,
    high: Vec3,
    least: f32,
    range: (u32, u32),
    next: u32,
}

fn divide(places: &[Measured], order: &mut [u32], first: u32, parts: &mut Vec<Part>) {
    let (mut low, mut high, mut least) = (Vec3::INFINITY, Vec3::NEG_INFINITY, f32::INFINITY);
    for &i in order.iter() {
        let (p, length) = places[i as usize];
        (low, high, least) = (low.min(p), high.max(p), least.min(length));
    }
    let here = parts.len();
    let end = first + order.len() as u32;
    parts.push(Part { low, high, least, range: (first, end), next: 0 });
    if order.len() > LEAF {
        let sides = (high - low).to_array();
        let axis = (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0);
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |&a, &b| {
            let at = |i: u32| places[i as usize].0[axis];
            at(a).total_cmp(&at(b)).then(a.cmp(&b))
        });
        let (left, right) = order.split_at_mut(middle);
        divide(places, left, first, parts);
        divide(places, right, first + middle as u32, parts);
        parts[here].range = (0, 0);
    }
    parts[here].next = parts.len() as u32;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn the_same_as_all_pairs() {
        let mut rng = Rng::new(9, Stream::Measure, 0);
        for count in [1, 2, 9, 500] {
            let mut places: Vec<Measured> = (0..count)
                .map(|_| (Vec3::new(rng.next_f32(), rng.next_f32(), 0.0), rng.next_f32().powi(3)))
                .collect();
            places[0].1 = f32::INFINITY;
            let found = Neighbours::new(places.clone()).clamped();
            for (i, &(p, length)) in places.iter().enumerate() {
                let want = places.iter().map(|&(q, other)| other + p.distance(q)).fold(length, f32::min);
                assert_eq!(found[i], want);
            }
            let again: Vec<Measured> =
                places.iter().zip(&found).map(|(&(p, _), &length)| (p, length)).collect();
            for (a, b) in Neighbours::new(again).clamped().iter().zip(&found) {
                assert!((a - b).abs() <= 1e-6 || a == b);
            }
        }
        assert!(Neighbours::default().clamped().is_empty());
        assert_eq!(Neighbours::default().least(Vec3::ZERO), f32::INFINITY);
    }
}
