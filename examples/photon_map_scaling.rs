//! How look-ups in a photon map grow with its photons, and what balance brings: the map beside two trees of one photon a node, one
//! built photon by photon in the order of their arrival (Jensen & Christensen 1995, section 3.3), one split at medians (Jensen 1996,
//! section 3; Bentley). Prints a table.
//!
//! ```sh
//! cargo run --release --example photon_map_scaling            # up to 10 million photons
//! cargo run --release --example photon_map_scaling 100000     # up to as many
//! ```
//!
//! Photons are those of `scenes/cornell-spheres.toml`, places those of photons drawn at random. One thread; medians of five.

use cardioid::embree::Device;
use cardioid::photons::{PhotonMap, Query, Scratch, TraceSettings, trace_photons};
use cardioid::sampling::{Rng, Stream};
use cardioid::scene::MapKind;
use cardioid::scene_file::{build_scene, load_scene};
use glam::Vec3;
use std::collections::BinaryHeap;
use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const NEAREST: usize = 80;
const LOOKUPS: usize = 20_000;
const RUNS: usize = 5;

/// A node of a tree that holds a photon in each: its place, the axis it splits, and its children.
struct Node {
    position: Vec3,
    axis: usize,
    children: [u32; 2],
}

const NONE: u32 = u32::MAX;

#[derive(Default)]
struct Tree {
    nodes: Vec<Node>,
    root: Option<u32>,
}

impl Tree {
    /// Each photon is hung below those that came before.
    fn on_the_fly(positions: &[Vec3]) -> Self {
        let mut tree = Self::default();
        for &position in positions {
            let new = tree.nodes.len() as u32;
            let mut link = None;
            let (mut at, mut depth) = (tree.root, 0);
            while let Some(node) = at {
                let Node { position: split, axis, children } = &tree.nodes[node as usize];
                let side = usize::from(position[*axis] >= split[*axis]);
                link = Some((node, side));
                at = (children[side] != NONE).then_some(children[side]);
                depth += 1;
            }
            match link {
                Some((node, side)) => tree.nodes[node as usize].children[side] = new,
                None => tree.root = Some(new),
            }
            tree.nodes.push(Node { position, axis: depth % 3, children: [NONE; 2] });
        }
        tree
    }

    /// Split at medians, along the longest edge of what is left.
    fn balanced(positions: &[Vec3]) -> Self {
        let mut tree = Self::default();
        let mut positions = positions.to_vec();
        tree.root = tree.split(&mut positions);
        tree
    }

    fn split(&mut self, positions: &mut [Vec3]) -> Option<u32> {
        let first = *positions.first()?;
        let (low, high) = positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)));
        let size = high - low;
        let axis = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
        let middle = positions.len() / 2;
        positions.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
        let node = self.nodes.len();
        self.nodes.push(Node { position: positions[middle], axis, children: [NONE; 2] });
        let (below, above) = positions.split_at_mut(middle);
        for (side, part) in [below, &mut above[1..]].into_iter().enumerate() {
            if let Some(child) = self.split(part) {
                self.nodes[node].children[side] = child;
            }
        }
        Some(node as u32)
    }

    fn depth(&self) -> u32 {
        let mut deepest = 0;
        let mut stack: Vec<(u32, u32)> = self.root.map(|root| (root, 1)).into_iter().collect();
        while let Some((node, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            let below = self.nodes[node as usize].children.into_iter().filter(|&child| child != NONE);
            stack.extend(below.map(|child| (child, depth + 1)));
        }
        deepest
    }

    /// Squared distance of the farthest of the nearest.
    fn search(&self, at: Vec3, heap: &mut BinaryHeap<u32>, stack: &mut Vec<(u32, f32)>) -> f32 {
        heap.clear();
        stack.clear();
        stack.extend(self.root.map(|root| (root, 0.0)));
        let radius = |heap: &BinaryHeap<u32>| match heap.peek() {
            // Bits of positive numbers are in their order.
            Some(&bits) if heap.len() == NEAREST => f32::from_bits(bits),
            _ => f32::INFINITY,
        };
        while let Some((node, least)) = stack.pop() {
            if least >= radius(heap) {
                continue;
            }
            let Node { position, axis, children } = &self.nodes[node as usize];
            let squared = position.distance_squared(at);
            if squared < radius(heap) {
                if heap.len() == NEAREST {
                    heap.pop();
                }
                heap.push(squared.to_bits());
            }
            let beside = at[*axis] - position[*axis];
            let near = usize::from(beside >= 0.0);
            for (child, least) in [(children[1 - near], beside * beside), (children[near], least)] {
                if child != NONE {
                    stack.push((child, least));
                }
            }
        }
        radius(heap)
    }
}

/// Median over runs of the microseconds of one look-up.
fn microseconds(mut look_up_all: impl FnMut() -> f32) -> f64 {
    let mut times: Vec<f64> = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            black_box(look_up_all());
            start.elapsed().as_secs_f64() * 1e6 / LOOKUPS as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[RUNS / 2]
}

fn main() -> Result<(), Box<dyn Error>> {
    let most = std::env::args().nth(1).map_or(Ok(10_000_000), |text| text.parse::<u64>())?;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.toml");
    let description = load_scene(&file, &[])?;
    let scene = build_scene(&description, &Arc::new(Device::new(0)?), (256, 256))?.scene;
    println!(
        "| photons | map: build, s | look-up of {NEAREST}, us | over log2 N | bytes a photon | \
         split at medians: us | depth | in order of arrival: us | depth |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut stored = 10_000;
    while stored <= most {
        let settings = TraceSettings {
            kind: MapKind::Global,
            stored,
            seed: 0,
            max_depth: 1000,
            aimed: true,
            wavelengths: Default::default(),
        };
        let traced = trace_photons(&scene, &settings, &|_, _| true).ok_or("no photons")?;
        let mut rng = Rng::new(1, Stream::Measure, 0);
        let count = traced.photons.len();
        let places: Vec<_> = (0..LOOKUPS)
            .map(|_| {
                let photon = &traced.photons[(rng.next_f64() * count as f64) as usize];
                (photon.position, photon.normal())
            })
            .collect();
        let positions: Vec<Vec3> = traced.photons.iter().map(|photon| photon.position).collect();
        let (mut heap, mut stack) = (BinaryHeap::new(), Vec::new());
        let mut of_tree = |tree: &Tree| {
            microseconds(|| places.iter().map(|&(at, _)| tree.search(at, &mut heap, &mut stack)).sum())
        };
        let (balanced, fly) = (Tree::balanced(&positions), Tree::on_the_fly(&positions));
        let (of_balanced, of_fly) = (of_tree(&balanced), of_tree(&fly));
        let depths = (balanced.depth(), fly.depth());
        drop((balanced, fly, positions));

        let start = Instant::now();
        let map = PhotonMap::build(traced.photons, traced.emitted);
        let build = start.elapsed().as_secs_f64();
        let mut scratch = Scratch::default();
        let of_map = microseconds(|| {
            let squared = |&(at, normal): &(Vec3, Vec3)| {
                // Without a test of normals, as the trees have none.
                let query = Query { min_normal_cos: -2.0, ..Query::nearest(at, normal, NEAREST) };
                map.search(&query, &mut scratch).farthest_squared()
            };
            places.iter().map(squared).sum()
        });
        println!(
            "| {count} | {build:.3} | {of_map:.2} | {:.3} | {:.2} | {of_balanced:.2} | {} | {of_fly:.2} | {} |",
            of_map / (count as f64).log2(),
            map.memory_bytes() as f64 / count as f64,
            depths.0,
            depths.1
        );
        stored *= 10;
    }
    Ok(())
}
