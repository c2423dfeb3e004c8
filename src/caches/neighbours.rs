//! Neighbour clamping (Krivanek, Bouatouch, Pattanaik & Zara, "Making Radiance and Irradiance Caching Practical: Adaptive
//! Caching and Neighbor Clamping", Eurographics Symposium on Rendering 2006).

use glam::Vec3;
use rayon::prelude::*;

/// A place, and a length there that cannot change faster than one moves: the distance of what is seen.
pub(super) type Measured = (Vec3, f32);

/// Points in a leaf.
const LEAF: usize = 8;

/// For each place the least of all lengths, each plus the distance from where it was measured: a few rays miss a small thing
/// nearby, the hemispheres next to it do not.
///
/// Depends on the set of places alone, and the result is its own result.
pub(super) fn clamped(places: &[Measured]) -> Vec<f32> {
    if places.is_empty() {
        return Vec::new();
    }
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    let mut parts = Vec::new();
    divide(places, &mut order, 0, &mut parts);
    places.par_iter().map(|&place| least(places, &order, &parts, place)).collect()
}

/// A node of a tree over the places: its box, the least length in it, and the range of `order` it covers. The first child
/// follows; `next` is the node after the whole subtree.
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

fn least(places: &[Measured], order: &[u32], parts: &[Part], (p, length): Measured) -> f32 {
    let mut best = length;
    let mut node = 0;
    while let Some(part) = parts.get(node) {
        let outside = (part.low - p).max(p - part.high).max(Vec3::ZERO).length();
        if part.least + outside >= best {
            node = part.next as usize;
            continue;
        }
        for &i in &order[part.range.0 as usize..part.range.1 as usize] {
            let (q, other) = places[i as usize];
            best = best.min(other + p.distance(q));
        }
        node += 1;
    }
    best
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
            let found = clamped(&places);
            for (i, &(p, length)) in places.iter().enumerate() {
                let want = places.iter().map(|&(q, other)| other + p.distance(q)).fold(length, f32::min);
                assert_eq!(found[i], want);
            }
            let again: Vec<Measured> =
                places.iter().zip(&found).map(|(&(p, _), &length)| (p, length)).collect();
            for (a, b) in clamped(&again).iter().zip(&found) {
                assert!((a - b).abs() <= 1e-6 || a == b);
            }
        }
        assert!(clamped(&[]).is_empty());
    }
}
