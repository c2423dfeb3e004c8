//! Aims parallel light at boxes around objects, where the disc around the scene is mostly empty.

use crate::sampling::Distribution1D;
use crate::scene::Target;
use glam::{Vec2, Vec3};

/// Starts of light from outside that meets an object: the projections of boxes on a plane perpendicular to the light.
#[derive(Clone, Debug)]
pub(super) struct BoxMap {
    boxes: Vec<Aimed>,
    choice: Distribution1D,
}

/// A box and the probability with which light is aimed at it.
#[derive(Clone, Copy, Debug)]
struct Aimed {
    low: Vec3,
    size: Vec3,
    probability: f32,
}

impl Aimed {
    /// Projected areas of the three pairs of faces along the unit `direction`: only one face of a pair faces the light.
    fn shown(&self, direction: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = self.size;
        Vec3::new(y * z, z * x, x * y) * direction.abs()
    }

    /// Whether the line through `point` along `direction` meets the box.
    fn is_met(&self, point: Vec3, direction: Vec3) -> bool {
        let (mut first, mut last) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in 0..3 {
            let from_low = self.low[axis] - point[axis];
            let from_high = from_low + self.size[axis];
            if direction[axis] == 0.0 {
                if from_low > 0.0 || from_high < 0.0 {
                    return false;
                }
                continue;
            }
            let (a, b) = (from_low / direction[axis], from_high / direction[axis]);
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
        first <= last
    }
}

/// Total projected area of boxes around `targets` along `direction`; boxes behind each other count twice. Without a
/// direction it is the mean over all directions, a quarter of their surface.
pub(super) fn area_of_boxes(targets: &[Target], direction: Option<Vec3>) -> f64 {
    let area = |target: &Target| {
        let size = target.bounds[1] - target.bounds[0];
        let faces = Vec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
        f64::from(direction.map_or_else(|| 0.5 * faces.element_sum(), |d| faces.dot(d.abs())))
    };
    targets.iter().map(area).sum()
}

impl BoxMap {
    /// For light along the unit `direction`, or for light from all directions. `None` where no box has an area.
    pub(super) fn new(targets: &[Target], direction: Option<Vec3>) -> Option<Self> {
        let choice = Distribution1D::new(targets.iter().map(|target| area_of_boxes(&[*target], direction)))?;
        let aimed = |(index, target): (usize, &Target)| Aimed {
            low: target.bounds[0],
            size: target.bounds[1] - target.bounds[0],
            probability: choice.probability(index),
        };
        Some(Self { boxes: targets.iter().enumerate().map(aimed).collect(), choice })
    }

    /// Projected area of the boxes, which determines the number of photons of the light; boxes behind each other count
    /// twice.
    pub(super) fn area(&self) -> f64 {
        self.choice.total()
    }

    /// Samples a point of a box that light along the unit `direction` meets; also returns one over its density per area
    /// perpendicular to the light.
    #[inline]
    pub(super) fn sample(&self, direction: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
        let (chosen, _, rest) = self.choice.sample(f64::from(u.x));
        let target = self.boxes.get(chosen)?;
        let shown = target.shown(direction);
        let area = shown.element_sum();
        let mut x = rest * area;
        let axis = (0..2).find(|&axis| {
            let is_there = x < shown[axis];
            x -= if is_there { 0.0 } else { shown[axis] };
            is_there
        });
        let axis = axis.unwrap_or(2);
        let mut within = Vec3::ZERO;
        within[axis] = if direction[axis] < 0.0 { 1.0 } else { 0.0 };
        within[(axis + 1) % 3] = (x / shown[axis]).clamp(0.0, 1.0);
        within[(axis + 2) % 3] = u.y;
        let point = target.low + target.size * within;
        let mut pdf = target.probability / area;
        for (index, other) in self.boxes.iter().enumerate() {
            if index != chosen && other.is_met(point, direction) {
                let area = other.shown(direction).element_sum();
                // No particular line meets a box that is seen edge-on.
                pdf += if area > 0.0 { other.probability / area } else { 0.0 };
            }
        }
        (pdf > 0.0 && pdf.is_finite()).then(|| (point, 1.0 / pdf))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Frame;
    use crate::sampling::{Rng, Stream, warp};

    /// Flat, long and compact boxes, some of which hide others: the estimate gives their area, from all directions.
    #[test]
    fn areas_that_boxes_cover() {
        let mut rng = Rng::new(7, Stream::Measure, 0);
        let boxes: Vec<Target> = (0..6)
            .map(|i| {
                let center = warp::square_to_sphere(rng.next_2d()) * 0.5;
                let mut half = Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 0.3;
                if i % 3 == 0 {
                    half.y = 0.0;
                }
                Target { bounds: [center - half, center + half], ..Target::of_sphere(center, half.length()) }
            })
            .collect();
        for round in 0..4 {
            let direction = warp::square_to_sphere(rng.next_2d());
            let map = BoxMap::new(&boxes, (round % 2 == 0).then_some(direction)).unwrap();
            let n = 100_000;
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..n {
                let (point, area) = map.sample(direction, rng.next_2d()).unwrap();
                assert!(map.boxes.iter().any(|b| {
                    let room = Vec3::splat(1e-6);
                    let grown = Aimed { low: b.low - room, size: b.size + 2.0 * room, ..*b };
                    grown.is_met(point, direction)
                }));
                sum += f64::from(area);
                squares += f64::from(area).powi(2);
            }
            let mean = sum / f64::from(n);
            let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
            // The same area from points of a square around all boxes.
            let frame = Frame::from_z(direction);
            let met = (0..n)
                .filter(|_| {
                    let d = (rng.next_2d() - 0.5) * 4.0;
                    let point = frame.x * d.x + frame.y * d.y;
                    map.boxes.iter().any(|b| b.is_met(point, direction))
                })
                .count();
            let share = met as f64 / f64::from(n);
            let (want, noise) = (16.0 * share, 16.0 * (share / f64::from(n)).sqrt());
            assert!((mean - want).abs() < 5.0 * error.hypot(noise), "{mean} +- {error}, {want} +- {noise}");
        }
        let area = area_of_boxes(&boxes, None);
        assert!((BoxMap::new(&boxes, None).unwrap().area() / area - 1.0).abs() < 1e-12);
    }
}
