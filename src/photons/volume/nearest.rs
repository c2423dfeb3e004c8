//! The nearest points of a tree to a place.

use super::super::kd_tree::{Block, Visitor};
use std::collections::BinaryHeap;

/// Search for the `k` nearest points.
#[derive(Debug)]
pub(super) struct Nearest {
    k: usize,
    /// Bits of the squared distance, which order as the distances do, and the index of the point.
    found: BinaryHeap<(u32, u32)>,
}

impl Nearest {
    pub(super) fn new(k: usize) -> Self {
        Self { k, found: BinaryHeap::with_capacity(k + 1) }
    }

    /// Forgets what was found.
    pub(super) fn clear(&mut self) {
        self.found.clear();
    }

    /// Indices of the points found.
    pub(super) fn indices(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.found.iter().map(|&(_, index)| index as usize)
    }

    /// Distance of the farthest of `k` points; `None` where there are fewer.
    pub(super) fn radius(&self) -> Option<f32> {
        (self.found.len() == self.k).then(|| self.bound().sqrt())
    }
}

impl<const L: usize> Visitor<L> for Nearest {
    fn bound(&self) -> f32 {
        Nearest::bound(self)
    }

    fn visit(&mut self, first: u32, distances_squared: &[f32; L], _: &Block<L>) {
        for (lane, &distance) in distances_squared.iter().enumerate() {
            // False for NaN, where there is no point.
            if distance <= Nearest::bound(self) {
                self.found.push((distance.to_bits(), first + lane as u32));
                if self.found.len() > self.k {
                    self.found.pop();
                }
            }
        }
    }
}

impl Nearest {
    fn bound(&self) -> f32 {
        match self.found.peek() {
            Some(&(bits, _)) if self.found.len() >= self.k => f32::from_bits(bits),
            _ => f32::INFINITY,
        }
    }
}
