//! Light tree: samples one of many lights by its possible contribution to a point, in time that grows with the logarithm of their
//! number.

use super::Receiver;
use crate::math::Bounds3;
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Bounds of the light of one emitter, or of several together (Conty Estevez & Kulla, "Importance Sampling of Many Lights with Adaptive
/// Tree Splitting", HPG 2018).
#[derive(Clone, Copy, Debug)]
pub struct LightBounds {
    /// Box around the positions.
    pub bounds: Bounds3,
    /// Intensity along the normal: radiance times area, or the intensity of a point light. Not negative.
    pub power: f64,
    /// Unit axis of the cone of normals.
    pub axis: DVec3,
    /// Half angle of the cone of normals around the axis.
    pub spread: f64,
    /// Largest angle to the normal at which light leaves.
    pub reach: f64,
    /// Whether both sides emit.
    pub two_sided: bool,
}

impl LightBounds {
    /// A point light that emits in all directions.
    pub fn point(position: DVec3, intensity: f64) -> Self {
        let bounds = Bounds3 { min: position, max: position };
        Self { bounds, power: intensity, axis: DVec3::Z, spread: PI, reach: FRAC_PI_2, two_sided: false }
    }

    /// Bounds of both together.
    pub(super) fn union(self, other: Self) -> Self {
        if self.power <= 0.0 {
            return other;
        }
        if other.power <= 0.0 {
            return self;
        }
        let (axis, spread) = cone_union((self.axis, self.spread), (other.axis, other.spread));
        Self {
            bounds: self.bounds.union(other.bounds),
            power: self.power + other.power,
            axis,
            spread,
            reach: self.reach.max(other.reach),
            two_sided: self.two_sided || other.two_sided,
        }
    }

    /// Share of the sphere into which light may leave, weighted by the cosine to the cone: `M_Omega` of the paper.
    fn orientation(&self) -> f64 {
        let full = self.spread.min(PI);
        let end = (full + self.reach).min(PI);
        // Integral over the range where the cosine falls, from `full` to `end`.
        let falling = FRAC_PI_2
            * (2.0 * end * full.sin() - (full - 2.0 * end).cos() - 2.0 * full * full.sin() + full.cos());
        2.0 * PI * (1.0 - full.cos()) + falling
    }
}

/// The cone around two cones, each given by axis and half angle.
fn cone_union(a: (DVec3, f64), b: (DVec3, f64)) -> (DVec3, f64) {
    let (a, b) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    let between = a.0.angle_between(b.0);
    if (between + b.1).min(PI) <= a.1 {
        return a;
    }
    let spread = 0.5 * (a.1 + between + b.1);
    let across = a.0.cross(b.0).normalize_or_zero();
    // Opposite axes do not define a plane.
    if spread >= PI || across == DVec3::ZERO {
        return (a.0, PI);
    }
    let turn = spread - a.1;
    let axis = a.0 * turn.cos() + across.cross(a.0) * turn.sin();
    // Room for the rounding of the axis.
    (axis.normalize_or(a.0), (spread + 1e-7).min(PI))
}

/// A node with the data that the descent reads.
#[derive(Clone, Copy, Debug)]
struct Node {
    center: Vec3,
    /// Radius of the sphere around the box.
    radius: f32,
    axis: Vec3,
    power: f32,
    cos_spread: f32,
    sin_spread: f32,
    cos_reach: f32,
    /// For an inner node the index of its second child (the first child is the next node); for a leaf the index of its light.
    link: u32,
    is_leaf: bool,
    two_sided: bool,
}

impl Node {
    fn new(of: &LightBounds) -> Self {
        let axis = of.axis.as_vec3();
        let center = of.bounds.center().as_vec3();
        let radius = 0.5 * (of.bounds.max - of.bounds.min).length();
        Self {
            center,
            // Room for the rounding of the centre.
            radius: (radius * (1.0 + 1e-6)) as f32 + center.abs().max_element() * 2e-7,
            axis,
            power: of.power as f32,
            cos_spread: of.spread.cos() as f32,
            sin_spread: of.spread.sin() as f32,
            cos_reach: of.reach.cos() as f32,
            link: 0,
            is_leaf: false,
            two_sided: of.two_sided,
        }
    }

    /// Bound on the light that arrives at a point, without occlusion: power times the cosine at the light over the squared distance, and
    /// times the cosine at the receiver where it has a normal (section 2.2 of the paper, in the form of pbrt's fourth edition). Zero
    /// only where nothing can arrive.
    #[inline]
    fn importance(&self, at: &Receiver) -> f32 {
        let away = at.position - self.center;
        let distance_squared = away.length_squared();
        let reach_squared = self.radius * self.radius;
        // Inside the sphere, only the power is meaningful.
        if distance_squared <= reach_squared {
            return self.power / reach_squared.max(f32::MIN_POSITIVE);
        }
        let inverse = 1.0 / distance_squared.sqrt();
        let direction = away * inverse;
        let mut cos = self.axis.dot(direction);
        if self.two_sided {
            cos = cos.abs();
        }
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let sin_size = self.radius * inverse;
        let cos_size = (1.0 - sin_size * sin_size).max(0.0).sqrt();
        let (cos, sin) = less(cos, sin, self.cos_spread, self.sin_spread);
        let (cos, _) = less(cos, sin, cos_size, sin_size);
        // A little tolerance, so that rounding at grazing angles leaves no light out.
        if cos <= self.cos_reach - 1e-5 {
            return 0.0;
        }
        let mut importance = self.power * cos.max(1e-5) / distance_squared;
        if at.normal != Vec3::ZERO {
            let cos = -at.normal.dot(direction);
            let (cos, _) = less(cos, (1.0 - cos * cos).max(0.0).sqrt(), cos_size, sin_size);
            importance *= if cos <= -1e-5 { 0.0 } else { cos.max(1e-5) };
        }
        importance
    }
}

/// Cosine and sine of an angle minus another one, or of zero where the other one is larger; angles in `[0, pi]`.
#[inline]
fn less(cos: f32, sin: f32, cos_other: f32, sin_other: f32) -> (f32, f32) {
    if cos >= cos_other {
        (1.0, 0.0)
    } else {
        (cos * cos_other + sin * sin_other, sin * cos_other - cos * sin_other)
    }
}

/// A binary tree over lights.
#[derive(Clone, Debug)]
pub struct LightTree {
    nodes: Vec<Node>,
    /// For each light, the path to its leaf, beginning with the lowest bit; a set bit leads to the second child.
    ways: Vec<u64>,
    whole: LightBounds,
}

/// From this depth on, nodes are split in halves, so that no path is longer than 64.
const DEEPEST_UNEVEN: u32 = 30;

/// Nodes with more lights than this are split along the longest axis only.
const MANY: usize = 1024;

/// Number of intervals between which split planes are tested.
const BUCKETS: usize = 12;

impl LightTree {
    /// A tree over these lights, at most 2^31. `None` where no light has power.
    pub fn new(lights: &[LightBounds]) -> Option<Self> {
        let whole = lights.iter().copied().reduce(LightBounds::union)?;
        if !(whole.power > 0.0 && whole.power.is_finite()) || lights.len() > 1 << 31 {
            return None;
        }
        let mut numbers: Vec<u32> = (0..lights.len() as u32).collect();
        let mut tree =
            Self { nodes: Vec::with_capacity(2 * lights.len()), ways: vec![0; lights.len()], whole };
        tree.build(lights, &mut numbers, 0, 0);
        Some(tree)
    }

    fn build(&mut self, lights: &[LightBounds], numbers: &mut [u32], way: u64, depth: u32) -> LightBounds {
        let index = self.nodes.len();
        if let [number] = *numbers {
            let light = lights[number as usize];
            self.ways[number as usize] = way;
            self.nodes.push(Node { link: number, is_leaf: true, ..Node::new(&light) });
            return light;
        }
        // Completed when the children are known.
        let placeholder = Node::new(&lights[numbers[0] as usize]);
        self.nodes.push(placeholder);
        let middle = split(lights, numbers, depth);
        let (first, second) = numbers.split_at_mut(middle);
        let first = self.build(lights, first, way, depth + 1);
        let link = self.nodes.len() as u32;
        let second = self.build(lights, second, way | 1 << depth, depth + 1);
        let both = first.union(second);
        self.nodes[index] = Node { link, ..Node::new(&both) };
        both
    }

    /// Bounds of all lights together.
    pub fn whole(&self) -> &LightBounds {
        &self.whole
    }

    /// Number of lights in the tree.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        self.ways.len()
    }

    /// Samples a light; returns it, its probability, and the remainder of `u`, which is uniform in `[0, 1)` again. `None` where no light
    /// can reach the point.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<(usize, f32, f32)> {
        let mut u = u;
        let mut probability = 1.0;
        let mut index = 0;
        loop {
            let node = &self.nodes[index];
            if node.is_leaf {
                let rest = (u as f32).clamp(0.0, crate::sampling::ONE_MINUS_EPSILON);
                return Some((node.link as usize, probability, rest));
            }
            let first = self.share_of_first(index, at)?;
            let share = f64::from(first);
            if u < share {
                u /= share;
                probability *= first;
                index += 1;
            } else {
                u = (u - share) / (1.0 - share);
                probability *= 1.0 - first;
                index = node.link as usize;
            }
        }
    }

    /// Probability with which [`Self::sample`] samples `light`.
    #[inline]
    pub fn probability(&self, at: &Receiver, light: usize) -> f32 {
        let Some(&(mut way)) = self.ways.get(light) else { return 0.0 };
        let mut probability = 1.0;
        let mut index = 0;
        while !self.nodes[index].is_leaf {
            let Some(first) = self.share_of_first(index, at) else { return 0.0 };
            if way & 1 == 0 {
                probability *= first;
                index += 1;
            } else {
                probability *= 1.0 - first;
                index = self.nodes[index].link as usize;
            }
            way >>= 1;
        }
        probability
    }

    /// Probability of the first child of an inner node; `None` where neither child reaches the point.
    #[inline]
    fn share_of_first(&self, index: usize, at: &Receiver) -> Option<f32> {
        let first = self.nodes[index + 1].importance(at);
        let second = self.nodes[self.nodes[index].link as usize].importance(at);
        let total = first + second;
        if total > 0.0 { Some(if total.is_finite() { first / total } else { 0.5 }) } else { None }
    }
}

/// Sorts the lights of the first part to the front and returns their number. The split has the lowest cost by the paper's surface area
/// orientation heuristic, or else divides the lights in halves.
fn split(lights: &[LightBounds], numbers: &mut [u32], depth: u32) -> usize {
    let center = |number: u32| lights[number as usize].bounds.center();
    let centers = numbers.iter().fold(Bounds3::EMPTY, |bounds, &number| {
        let center = center(number);
        bounds.union(Bounds3 { min: center, max: center })
    });
    let extent = centers.max - centers.min;
    let longest = extent.max_element();
    let half = numbers.len() / 2;
    if depth >= DEEPEST_UNEVEN || !(longest > 0.0) {
        let axis = if extent.x == longest { 0 } else { 1 + usize::from(extent.z == longest) };
        numbers.select_nth_unstable_by(half, |&a, &b| {
            center(a)[axis].total_cmp(&center(b)[axis]).then_with(|| a.cmp(&b))
        });
        return half;
    }
    let bucket_of = |number: u32, axis: usize| {
        let at = (center(number)[axis] - centers.min[axis]) / extent[axis];
        ((at * BUCKETS as f64) as usize).min(BUCKETS - 1)
    };
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        // With many lights the longest axis is sufficient.
        if !(extent[axis] > 0.0) || numbers.len() > MANY && extent[axis] < longest {
            continue;
        }
        let mut buckets: [Option<LightBounds>; BUCKETS] = [None; BUCKETS];
        for &number in numbers.iter() {
            let bucket = &mut buckets[bucket_of(number, axis)];
            let light = lights[number as usize];
            *bucket = Some(bucket.map_or(light, |bounds| bounds.union(light)));
        }
        let join = |bounds: Option<LightBounds>, next: &Option<LightBounds>| match (bounds, *next) {
            (Some(a), Some(b)) => Some(a.union(b)),
            (a, b) => a.or(b),
        };
        let cost = |bounds: Option<LightBounds>| {
            bounds.map(|bounds| {
                let d = bounds.bounds.max - bounds.bounds.min;
                bounds.power * bounds.orientation() * (d.x * d.y + d.y * d.z + d.z * d.x)
            })
        };
        // The lights beyond each plane, then the lights before it.
        let mut beyond: [Option<LightBounds>; BUCKETS] = [None; BUCKETS];
        let mut all = None;
        for plane in (1..BUCKETS).rev() {
            all = join(all, &buckets[plane]);
            beyond[plane] = all;
        }
        let mut before = None;
        for (plane, &after) in beyond.iter().enumerate().skip(1) {
            // A plane behind an empty interval divides the lights as the plane before it does.
            if buckets[plane - 1].is_none() {
                continue;
            }
            before = join(before, &buckets[plane - 1]);
            let (Some(first), Some(second)) = (cost(before), cost(after)) else { continue };
            // Long boxes should be cut across.
            let cost = (first + second) * longest / extent[axis];
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, plane));
            }
        }
    }
    let Some((_, axis, plane)) = best else { return half };
    // Stable, so that the tree does not depend on a library's partition algorithm.
    let (mut first, second): (Vec<u32>, Vec<u32>) =
        numbers.iter().partition(|&&number| bucket_of(number, axis) < plane);
    let middle = first.len();
    first.extend(second);
    numbers.copy_from_slice(&first);
    if middle == 0 || middle == numbers.len() { half } else { middle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, refined, warp};

    /// Small quads and points at random places.
    fn lights(count: usize, rng: &mut Rng) -> Vec<LightBounds> {
        (0..count)
            .map(|i| {
                let position = (warp::square_to_sphere(rng.next_2d()) * rng.next_f32()).as_dvec3();
                let intensity = f64::from(rng.next_f32()).powi(3) + 1e-6;
                if i % 3 == 0 {
                    return LightBounds::point(position, intensity);
                }
                let size = DVec3::splat(f64::from(rng.next_f32()) * 0.05);
                LightBounds {
                    bounds: Bounds3 { min: position - size, max: position + size },
                    power: intensity,
                    axis: warp::square_to_sphere(rng.next_2d()).as_dvec3(),
                    spread: f64::from(rng.next_f32()) * 0.5,
                    reach: FRAC_PI_2,
                    two_sided: i % 5 == 1,
                }
            })
            .collect()
    }

    fn receiver(rng: &mut Rng) -> Receiver {
        let normal = warp::square_to_sphere(rng.next_2d());
        let position = warp::square_to_sphere(rng.next_2d()) * (1.5 * rng.next_f32());
        Receiver { position, normal: if rng.next_f32() < 0.3 { Vec3::ZERO } else { normal } }
    }

    /// The probabilities of all lights sum to one, samples return the probability that is evaluated, and their frequencies agree with
    /// it.
    #[test]
    fn probabilities_are_those_of_the_samples() {
        let mut rng = Rng::new(11, Stream::Measure, 0);
        for count in [1, 2, 9, 100, 1000] {
            let lights = lights(count, &mut rng);
            let tree = LightTree::new(&lights).unwrap();
            for _ in 0..20 {
                let at = receiver(&mut rng);
                let sum: f64 = (0..count).map(|light| f64::from(tree.probability(&at, light))).sum();
                match tree.sample(&at, refined(rng.next_2d())) {
                    // Only lights that the descent excluded can be missing.
                    None => assert!(sum < 1.0 + 1e-5, "{sum}"),
                    Some((light, probability, rest)) => {
                        assert!((0.0..1.0).contains(&rest));
                        assert_eq!(probability, tree.probability(&at, light));
                        assert!(sum < 1.0 + 1e-5);
                    }
                }
            }
            let at = Receiver { position: Vec3::new(0.1, 0.2, 0.3), normal: Vec3::ZERO };
            let sum: f64 = (0..count).map(|light| f64::from(tree.probability(&at, light))).sum();
            let mut none = 0;
            let (mut counts, n) = (vec![0u32; count], 100_000);
            for _ in 0..n {
                match tree.sample(&at, refined(rng.next_2d())) {
                    Some((light, ..)) => counts[light] += 1,
                    None => none += 1,
                }
            }
            // The share of failed samples equals one minus the sum of the probabilities.
            assert!((f64::from(none) / f64::from(n) - (1.0 - sum)).abs() < 0.01, "{none} {sum}");
            let (mut statistic, mut freedom) = (0.0, 0.0);
            for (light, &drawn) in counts.iter().enumerate() {
                let want = f64::from(tree.probability(&at, light)) * f64::from(n);
                if want > 8.0 {
                    statistic += (f64::from(drawn) - want).powi(2) / want;
                    freedom += 1.0;
                }
            }
            assert!(
                f64::abs(statistic - freedom) < 4.0 * f64::sqrt(2.0 * freedom) + 4.0,
                "{statistic} {freedom}"
            );
        }
    }

    /// A light that can reach a point is never left out: its own importance and its probability are positive.
    #[test]
    fn nothing_that_shines_is_left_out() {
        let mut rng = Rng::new(12, Stream::Measure, 0);
        let lights = lights(300, &mut rng);
        let tree = LightTree::new(&lights).unwrap();
        let mut reached = 0;
        for _ in 0..2000 {
            let at = receiver(&mut rng);
            let number = (rng.next_f32() * 300.0) as usize;
            let light = &lights[number];
            // A point of the light and a normal in its cone.
            let u = DVec3::new(rng.next_f32().into(), rng.next_f32().into(), rng.next_f32().into());
            let from = light.bounds.min + (light.bounds.max - light.bounds.min) * u;
            let spread = (1.0 - light.spread.cos()) as f32;
            let around = crate::math::Frame::from_z(light.axis.as_vec3());
            let normal = around.to_world(warp::square_to_cone(rng.next_2d(), spread));
            let to = (at.position - from.as_vec3()).normalize();
            let leaves = if light.two_sided || light.spread > 3.0 { true } else { normal.dot(to) > 1e-3 };
            let arrives = at.normal == Vec3::ZERO || at.normal.dot(-to) > 1e-3;
            if leaves && arrives {
                reached += 1;
                assert!(tree.probability(&at, number) > 0.0, "{at:?} {light:?}");
            }
        }
        assert!(reached > 500, "{reached}");
    }

    /// Near a light the tree samples it far more often than in proportion to its power.
    #[test]
    fn near_lights_come_first() {
        let lights: Vec<LightBounds> =
            (0..1000).map(|i| LightBounds::point(DVec3::new(f64::from(i), 0.0, 0.0), 1.0)).collect();
        let tree = LightTree::new(&lights).unwrap();
        let at = Receiver { position: Vec3::new(500.0, 0.5, 0.0), normal: Vec3::Y * -1.0 };
        let near: f32 = (498..=502).map(|light| tree.probability(&at, light)).sum();
        // Fifty times the share of the power.
        assert!(near > 0.25, "{near}");
        let up = Receiver { normal: Vec3::Y, ..at };
        assert!(tree.sample(&up, 0.3).is_none(), "all are below the horizon");
    }

    #[test]
    fn odd_sets_of_lights() {
        assert!(LightTree::new(&[]).is_none());
        assert!(LightTree::new(&[LightBounds::point(DVec3::ZERO, 0.0)]).is_none());
        // All lights at one place, and lights along a line at powers of two.
        let same = vec![LightBounds::point(DVec3::X, 1.0); 1000];
        let powers: Vec<LightBounds> =
            (0..200).map(|i| LightBounds::point(DVec3::X * 2f64.powi(-i), 1.0)).collect();
        for lights in [same, powers] {
            let tree = LightTree::new(&lights).unwrap();
            for position in [Vec3::ZERO, Vec3::X, Vec3::new(0.3, 1.0, 0.0)] {
                let at = Receiver { position, normal: Vec3::ZERO };
                let sum: f64 = (0..lights.len()).map(|light| f64::from(tree.probability(&at, light))).sum();
                assert!((sum - 1.0).abs() < 1e-3, "{sum} at {position}");
                assert!(tree.sample(&at, 0.999).is_some());
            }
        }
    }
}
