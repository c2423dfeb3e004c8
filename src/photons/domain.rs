//! The visible kernel: the part of an estimate's disc that can be seen from its centre.
//!
//! A disc at the foot of a wall extends behind the wall. If there is a surface behind it, light leaks; if there is
//! none, the estimate is too dark. Neither normals nor flattened searches can detect this, because the floor on both
//! sides is one plane. Feeler rays in the tangent plane can. Photons that they do not reach are left out, and the
//! kernel is normalised over the rest ("Photon Mapping with Visible Kernel Domains", The Visual Computer, 2018, names
//! the biases).

use super::Kernel;
use crate::math::Frame;
use glam::{Vec2, Vec3};
use std::sync::LazyLock;

/// Feeler rays around a point.
pub const FEELERS: usize = 16;

/// If the visible share of a disc is smaller than this, the domain depends more on the feelers than on the place.
const SMALLEST_SHARE: f32 = 0.1;

/// Length of the feelers over the radius. With this length, one of eight feelers, each 22.5 degrees or less from the
/// normal of a straight wall, meets every wall that crosses the disc.
const STRETCH: f32 = 1.083;

/// Share of the least length of the feelers within which the surface is assumed to be free of obstacles. A right-angled
/// corner between two feelers at half the distance would extend to both of them. Sharper corners may be missed.
const CLEAR_SHARE: f32 = 0.5;

/// Distance from the centre within which every place of the surface is assumed visible, where no feeler met anything
/// within `least_reach`.
pub(super) fn clear_distance(least_reach: f32) -> f32 {
    CLEAR_SHARE * least_reach
}

/// Directions of the feelers in the tangent plane, evenly spaced in the angle of the diamond `|x| + |y| = 1`, so that the
/// sector of a point is found without an arc tangent.
fn direction(feeler: usize) -> Vec2 {
    const PER_QUADRANT: usize = FEELERS / 4;
    let along = (feeler % PER_QUADRANT) as f32 / PER_QUADRANT as f32;
    let v = Vec2::new(1.0 - along, along);
    let v = v / v.length();
    match feeler / PER_QUADRANT % 4 {
        0 => v,
        1 => Vec2::new(-v.y, v.x),
        2 => -v,
        _ => Vec2::new(v.y, -v.x),
    }
}

/// A sector between two feelers; the same for every domain.
struct Sector {
    /// Angle between its feelers, radians.
    angle: f32,
    /// Directions between the feelers and their weights, radians: Gauss-Legendre, as the integrands are smooth.
    across: [(Vec2, f32); 3],
}

static SECTORS: LazyLock<[Sector; FEELERS]> = LazyLock::new(|| {
    const NODES: [(f32, f32); 3] =
        [(0.112_701_67, 0.277_777_8), (0.5, 0.444_444_45), (0.887_298_3, 0.277_777_8)];
    std::array::from_fn(|sector| {
        let from = direction(sector);
        let angle = from.angle_to(direction((sector + 1) % FEELERS)).abs();
        let node = |(node, weight)| (Vec2::from_angle(from.to_angle() + node * angle), weight * angle);
        Sector { angle, across: NODES.map(node) }
    })
});

/// Directions of the feelers.
static DIRECTIONS: LazyLock<[Vec2; FEELERS]> = LazyLock::new(|| std::array::from_fn(direction));

/// Number of the sector between two feelers in which `p` lies.
fn sector_of(p: Vec2) -> usize {
    let along = |across: f32, ahead: f32| across / (across + ahead);
    let (x, y) = (p.x, p.y);
    let position = match (x > 0.0, y >= 0.0) {
        (true, true) => along(y, x),
        (false, true) => 1.0 + along(-x, y),
        (false, false) => 2.0 + along(-y, -x),
        (true, false) => 3.0 + along(x, -y),
    };
    // NaN at the centre itself, which lies in every sector and casts to 0.
    ((position * (FEELERS / 4) as f32) as usize).min(FEELERS - 1)
}

/// Visibility of a disc from its centre.
#[derive(Clone, Copy, Debug)]
pub enum Seen {
    /// The whole disc.
    Whole,
    /// A part of it that is not negligible.
    Part(KernelDomain),
    /// A negligible part: the photons in the disc belong to other places.
    Little,
}

impl Seen {
    /// The visible part, where it is neither the whole disc nor negligible.
    pub fn part(&self) -> Option<&KernelDomain> {
        match self {
            Self::Part(domain) => Some(domain),
            Self::Whole | Self::Little => None,
        }
    }

    /// Least free distance from the centre over all feelers; infinite where the whole disc is visible, or where there
    /// is no domain.
    pub fn least_reach(&self) -> f32 {
        self.part().map_or(f32::INFINITY, KernelDomain::least_reach)
    }
}

/// Queries of an estimate about the surfaces around its centre.
pub trait Sight {
    /// Which part of the disc of this radius can be seen from the centre.
    fn feel(&mut self, radius: f32) -> Seen;

    /// Whether there is a free way from the centre to a photon at `position` on a surface that faces along the unit `normal`.
    fn sees(&mut self, position: Vec3, normal: Vec3) -> bool;

    /// Whether [`Self::feel`] sends feelers at all.
    fn feels(&self) -> bool;

    /// Whether something is so close above the centre that feelers within [`Self::feel`] may have missed obstacles.
    fn is_covered(&self) -> bool;

    /// Distance along the normal to the surface that the centre faces; infinite where it is farther than `within`.
    fn outlook(&mut self, within: f32) -> f32;
}

/// Only the domain hides photons.
impl<F: FnMut(f32) -> Option<KernelDomain>> Sight for F {
    fn feel(&mut self, radius: f32) -> Seen {
        self(radius).map_or(Seen::Whole, Seen::Part)
    }

    fn sees(&mut self, _: Vec3, _: Vec3) -> bool {
        true
    }

    fn feels(&self) -> bool {
        false
    }

    fn is_covered(&self) -> bool {
        false
    }

    fn outlook(&mut self, _: f32) -> f32 {
        f32::INFINITY
    }
}

/// The star-shaped part of a disc that feelers reach.
#[derive(Clone, Copy, Debug)]
pub struct KernelDomain {
    frame: Frame,
    radius: f32,
    reach: [f32; FEELERS],
}

impl KernelDomain {
    /// The visible part of a disc of `radius` around a point with this unit `normal`. `reach` takes a unit direction of
    /// the tangent plane and a length, which is [`Self::length_for`] the radius. It returns the distance of the first
    /// obstacle, or `None` where there is none within the length.
    pub fn feel(normal: Vec3, radius: f32, reach: impl Fn(Vec3, f32) -> Option<f32>) -> Seen {
        let frame = Frame::from_z(normal);
        let length = Self::length_for(radius);
        let mut domain = Self { frame, radius, reach: [length; FEELERS] };
        let mut free = true;
        let mut feel = |feeler: usize| {
            let d = DIRECTIONS[feeler];
            if let Some(found) = reach(frame.x * d.x + frame.y * d.y, length) {
                domain.reach[feeler] = found.clamp(0.0, length);
                free &= found >= length;
            }
            free
        };
        // Every other feeler first: if all of these are free, the rest could only meet thin objects.
        let even_are_free = (0..FEELERS).step_by(2).fold(true, |_, feeler| feel(feeler));
        let free = even_are_free || (1..FEELERS).step_by(2).fold(true, |_, feeler| feel(feeler));
        if free {
            Seen::Whole
        } else if domain.mean_weight(Kernel::Constant) < SMALLEST_SHARE {
            Seen::Little
        } else {
            Seen::Part(domain)
        }
    }

    /// Length of feelers in a disc of `radius`: slightly more than the radius.
    pub fn length_for(radius: f32) -> f32 {
        STRETCH * radius
    }

    /// The domain of a smaller disc around the same point, from the same feelers.
    #[must_use]
    pub fn narrowed(&self, radius: f32) -> Self {
        let length = STRETCH * radius;
        Self { frame: self.frame, radius, reach: self.reach.map(|reach| reach.min(length)) }
    }

    /// Least free distance from the centre over all feelers.
    pub fn least_reach(&self) -> f32 {
        self.reach.iter().copied().fold(f32::INFINITY, f32::min)
    }

    /// True where the point at `offset` from the centre can be seen from it.
    ///
    /// Between two feelers the boundary is the straight line between their ends. This is exact along a straight wall
    /// that both meet, and on the near side of a wall that only one of them meets.
    pub fn contains(&self, offset: Vec3) -> bool {
        let p = Vec2::new(offset.dot(self.frame.x), offset.dot(self.frame.y));
        let (a, b) = match self.ends(sector_of(p)) {
            Some(ends) => ends,
            None => return true,
        };
        (b - a).perp_dot(p - a) >= 0.0
    }

    /// Ends of the feelers on both sides of a sector; `None` where both reach beyond the rim.
    fn ends(&self, sector: usize) -> Option<(Vec2, Vec2)> {
        let next = (sector + 1) % FEELERS;
        let (a, b) = (self.reach[sector], self.reach[next]);
        let length = STRETCH * self.radius;
        (a < length || b < length).then(|| (DIRECTIONS[sector] * a, DIRECTIONS[next] * b))
    }

    /// Integral of the kernel over the domain, divided by the area of the whole disc: what
    /// [`Kernel::mean_weight`] is for a whole disc.
    pub fn mean_weight(&self, kernel: Kernel) -> f32 {
        let whole = 0.5 * kernel.mean_weight();
        let mut sum = 0.0;
        for (sector, Sector { angle, across }) in SECTORS.iter().enumerate() {
            let Some((a, b)) = self.ends(sector) else {
                sum += angle * whole;
                continue;
            };
            for &(d, weight) in across {
                // Intersection of the ray at this angle with the line from a to b.
                let along = b - a;
                let distance = a.perp_dot(along) / d.perp_dot(along);
                let share = if distance.is_finite() { (distance / self.radius).clamp(0.0, 1.0) } else { 0.0 };
                sum += weight * radial_integral(kernel, share);
            }
        }
        sum / std::f32::consts::PI
    }
}

/// Integral of `K(t) t` for `t` from 0 to `end`.
fn radial_integral(kernel: Kernel, end: f32) -> f32 {
    match kernel {
        Kernel::Constant => return 0.5 * end * end,
        Kernel::Cone { k } if k >= 1.0 => return end * end * (0.5 - end / (3.0 * k)),
        Kernel::Cone { .. } | Kernel::Epanechnikov | Kernel::Gaussian => (),
    }
    // Gauss-Legendre.
    const NODES: [(f32, f32); 4] = [
        (0.069_431_84, 0.173_927_42),
        (0.330_009_5, 0.326_072_58),
        (0.669_990_5, 0.326_072_58),
        (0.930_568_2, 0.173_927_42),
    ];
    NODES
        .iter()
        .map(|(node, weight)| (node * end, weight * end))
        .map(|(t, w)| w * t * kernel.weight(t * t))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    const KERNELS: [Kernel; 4] =
        [Kernel::Constant, Kernel::Cone { k: 1.0 }, Kernel::Epanechnikov, Kernel::Gaussian];

    /// A wall `x = distance` and nothing else.
    fn wall(distance: f32) -> impl Fn(Vec3, f32) -> Option<f32> {
        move |d: Vec3, _| (d.x > 0.0).then(|| distance / d.x)
    }

    #[test]
    fn sectors_lie_between_their_feelers() {
        for feeler in 0..FEELERS {
            let middle = direction(feeler) + direction((feeler + 1) % FEELERS);
            assert_eq!(sector_of(middle), feeler);
            assert!((direction(feeler).length() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_disc_in_the_open_is_whole() {
        assert!(matches!(KernelDomain::feel(Vec3::Z, 1.0, |_, _| None), Seen::Whole));
        assert!(matches!(KernelDomain::feel(Vec3::Z, 1.0, |_, _| Some(2.0)), Seen::Whole));
        assert!(matches!(KernelDomain::feel(Vec3::Z, 1.0, |_, _| Some(0.0)), Seen::Little));
    }

    #[test]
    fn no_straight_wall_is_missed() {
        for distance in [0.3, 0.9, 0.95, 0.99] {
            for step in 0..200 {
                let normal = Vec2::from_angle(step as f32 / 200.0 * std::f32::consts::TAU);
                let frame = Frame::from_z(Vec3::Z);
                let wall = |d: Vec3, length: f32| {
                    let ahead = Vec2::new(d.dot(frame.x), d.dot(frame.y)).dot(normal);
                    (ahead > 0.0).then(|| distance / ahead).filter(|&found| found <= length)
                };
                let seen = KernelDomain::feel(Vec3::Z, 1.0, wall);
                let domain = seen.part().unwrap();
                let behind = frame.to_world((normal * (distance + 0.009)).extend(0.0));
                assert!(!domain.contains(behind), "{distance} {normal}");
            }
        }
    }

    #[test]
    fn nothing_behind_a_wall_is_in_the_domain() {
        let mut rng = Rng::new(1, Stream::Measure, 0);
        for distance in [0.01, 0.3, 0.7, 0.99] {
            let seen = KernelDomain::feel(Vec3::Z, 1.0, wall(distance));
            let domain = seen.part().unwrap();
            for _ in 0..10_000 {
                let p = warp::square_to_disc(rng.next_2d());
                if domain.contains(p.extend(0.0)) {
                    assert!(p.x <= distance + 1e-5, "{p} beyond {distance}");
                }
            }
        }
    }

    #[test]
    fn uniform_flux_in_front_of_a_wall_is_estimated_without_bias() {
        // The mean of the kernel over the points of a half plane that are in the domain, over its integral, is one.
        for kernel in KERNELS {
            for distance in [0.0f32, 0.1, 0.5, 0.9] {
                let seen = KernelDomain::feel(Vec3::Z, 1.0, wall(distance));
                let domain = seen.part().unwrap();
                let n = 400_000;
                let mut rng = Rng::new(2, Stream::Measure, 0);
                let sum: f64 = (0..n)
                    .map(|_| warp::square_to_disc(rng.next_2d()))
                    .filter(|p| p.x <= distance && domain.contains(p.extend(0.0)))
                    .map(|p| f64::from(kernel.weight(p.length_squared().min(1.0))))
                    .sum();
                let ratio = sum / f64::from(n) / f64::from(domain.mean_weight(kernel));
                assert!((ratio - 1.0).abs() < 0.006, "{kernel:?} at {distance}: {ratio}");
            }
        }
    }

    #[test]
    fn a_straight_wall_costs_little_of_what_is_visible() {
        // Share of the disc in front of a wall through its centre: one half; feelers may lose some, not much.
        let seen = KernelDomain::feel(Vec3::Z, 1.0, wall(1e-3));
        let domain = seen.part().unwrap();
        let share = domain.mean_weight(Kernel::Constant);
        assert!((0.45..=0.501).contains(&share), "{share}");
    }
}
