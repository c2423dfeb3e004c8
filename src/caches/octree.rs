//! An octree that finds the spheres which contain a point: its leaves list every sphere that overlaps them.

use glam::Vec3;

/// Spheres in a leaf before it is divided.
const LEAF: usize = 12;

/// Depth at which leaves are no longer divided.
const DEEPEST: u32 = 18;

/// A leaf is not divided if this would list its spheres this many times on average: they overlap all of it.
const REPEATS: usize = 5;

/// Numbers of spheres, by place. A look-up descends to one leaf, which lists every sphere that may contain the point.
#[derive(Clone, Debug)]
pub(super) struct Octree {
    centre: Vec3,
    half: f32,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
enum Node {
    /// Number of the first of eight children.
    Inner(u32),
    /// Spheres, in the order of insertion.
    Leaf { items: Vec<u32>, divisible: bool },
}

/// A sphere: centre and radius.
pub(super) type Sphere = (Vec3, f32);

impl Octree {
    /// An empty tree over the cube with this centre and half side.
    pub(super) fn new(centre: Vec3, half: f32) -> Self {
        Self { centre, half, nodes: vec![Node::Leaf { items: Vec::new(), divisible: true }] }
    }

    /// Spheres that may contain `position`, in the order in which they were inserted.
    #[inline]
    pub(super) fn at(&self, position: Vec3) -> &[u32] {
        let (mut centre, mut half, mut node) = (self.centre, self.half, 0);
        loop {
            match &self.nodes[node] {
                Node::Leaf { items, .. } => return items,
                Node::Inner(first) => {
                    let child = octant_of(position, centre);
                    half *= 0.5;
                    centre = child_centre(centre, half, child);
                    node = (first + child) as usize;
                }
            }
        }
    }

    /// Adds sphere number `item`; `sphere_of` returns the other spheres, for leaves that are divided.
    pub(super) fn insert(&mut self, item: u32, sphere: Sphere, sphere_of: impl Fn(u32) -> Sphere + Copy) {
        self.insert_at((0, self.centre, self.half, 0), item, sphere, sphere_of);
    }

    fn insert_at(
        &mut self,
        (node, centre, half, depth): (usize, Vec3, f32, u32),
        item: u32,
        sphere: Sphere,
        sphere_of: impl Fn(u32) -> Sphere + Copy,
    ) {
        let full = match &mut self.nodes[node] {
            Node::Inner(first) => {
                let first = *first;
                self.insert_in_children((first, centre, half, depth), item, sphere, sphere_of);
                return;
            }
            Node::Leaf { items, divisible } => {
                items.push(item);
                // Division is tried again each time the leaf has grown by this number.
                (items.len() % LEAF == 0 && depth < DEEPEST && (*divisible || items.len() % (4 * LEAF) == 0))
                    .then(|| items.clone())
            }
        };
        let Some(items) = full else { return };
        let quarter = half * 0.5;
        let copies: usize = items
            .iter()
            .map(|&item| {
                (0..8)
                    .filter(|&child| overlaps(child_centre(centre, quarter, child), quarter, sphere_of(item)))
                    .count()
            })
            .sum();
        if copies >= REPEATS * items.len() {
            if let Node::Leaf { divisible, .. } = &mut self.nodes[node] {
                *divisible = false;
            }
            return;
        }
        let first = self.nodes.len() as u32;
        self.nodes.extend((0..8).map(|_| Node::Leaf { items: Vec::new(), divisible: true }));
        self.nodes[node] = Node::Inner(first);
        for item in items {
            self.insert_in_children((first, centre, half, depth), item, sphere_of(item), sphere_of);
        }
    }

    fn insert_in_children(
        &mut self,
        (first, centre, half, depth): (u32, Vec3, f32, u32),
        item: u32,
        sphere: Sphere,
        sphere_of: impl Fn(u32) -> Sphere + Copy,
    ) {
        let half = half * 0.5;
        for child in 0..8 {
            let centre = child_centre(centre, half, child);
            if overlaps(centre, half, sphere) {
                self.insert_at(((first + child) as usize, centre, half, depth + 1), item, sphere, sphere_of);
            }
        }
    }
}

#[inline]
fn octant_of(position: Vec3, centre: Vec3) -> u32 {
    u32::from(position.x >= centre.x)
        | u32::from(position.y >= centre.y) << 1
        | u32::from(position.z >= centre.z) << 2
}

#[inline]
fn child_centre(centre: Vec3, half: f32, child: u32) -> Vec3 {
    let side = |bit: u32| if child >> bit & 1 == 1 { half } else { -half };
    centre + Vec3::new(side(0), side(1), side(2))
}

fn overlaps(centre: Vec3, half: f32, (position, radius): Sphere) -> bool {
    let outside = ((position - centre).abs() - Vec3::splat(half)).max(Vec3::ZERO);
    // Slightly more than the radius, as a margin for rounding at boundaries.
    outside.length_squared() <= radius * radius * 1.0001
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn every_sphere_that_contains_a_point_is_found_in_order() {
        let mut rng = Rng::new(5, Stream::Measure, 0);
        let mut point = move || Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 2.0 - 1.0;
        let spheres: Vec<Sphere> = (0..3000)
            .map(|i| (point() * Vec3::new(1.0, 1.0, 0.01), 0.01 + 0.1 * (i % 7) as f32 / 7.0))
            .collect();
        let mut tree = Octree::new(Vec3::ZERO, 1.0);
        for (i, &sphere) in spheres.iter().enumerate() {
            tree.insert(i as u32, sphere, |i| spheres[i as usize]);
        }
        let (mut found, mut visited) = (0, 0);
        for _ in 0..2000 {
            let p = point() * Vec3::new(1.0, 1.0, 0.01);
            let listed = tree.at(p);
            assert!(listed.is_sorted());
            visited += listed.len();
            for (i, &(centre, radius)) in spheres.iter().enumerate() {
                if centre.distance(p) < radius {
                    found += 1;
                    assert!(listed.contains(&(i as u32)));
                }
            }
        }
        println!("{found} spheres around 2000 points, {visited} looked at, {} nodes", tree.nodes.len());
        assert!(visited < 8 * found);
    }

    #[test]
    fn spheres_in_one_place_end_the_division() {
        let mut tree = Octree::new(Vec3::ZERO, 1.0);
        for i in 0..1000 {
            tree.insert(i, (Vec3::splat(0.1), 0.5), |_| (Vec3::splat(0.1), 0.5));
        }
        assert_eq!(tree.at(Vec3::splat(0.1)).len(), 1000);
        assert!(tree.nodes.len() < 10_000);
        // Positions far outside, or not finite, also lead to some leaf.
        assert!(tree.at(Vec3::splat(-1e30)).len() <= 1000 && tree.at(Vec3::NAN).len() <= 1000);
    }
}
