//! Areas of a disc within voxels, by clipping a polygon.

use arrayvec::ArrayVec;
use glam::Vec3;
use std::f32::consts::PI;

/// Corners of the polygon that stands for a disc. It has the disc's area exactly; its corners lie 1.2 % outside of the circle.
const SIDES: usize = 16;

/// Most corners: each of at most six cuts adds two at most to a convex polygon, with rounding.
const CORNERS: usize = SIDES + 16;

type Polygon = ArrayVec<Vec3, CORNERS>;

/// A polygon with the centre, unit normal, and area of a disc.
pub(super) fn polygon(centre: Vec3, normal: Vec3, radius: f32) -> Polygon {
    let frame = crate::math::Frame::from_z(normal);
    let angle = 2.0 * PI / SIDES as f32;
    // Area of a regular polygon with n corners on a circle of radius R: n/2 R^2 sin(2 pi / n).
    let out = radius * (2.0 * PI / (SIDES as f32 * angle.sin())).sqrt();
    (0..SIDES)
        .map(|i| {
            let (sin, cos) = (i as f32 * angle).sin_cos();
            centre + out * (cos * frame.x + sin * frame.y)
        })
        .collect()
}

/// Area of a planar polygon.
fn area(polygon: &[Vec3]) -> f32 {
    let Some((&first, rest)) = polygon.split_first() else { return 0.0 };
    let double: Vec3 = rest.windows(2).map(|edge| (edge[0] - first).cross(edge[1] - first)).sum();
    0.5 * double.length()
}

/// The parts of a convex polygon below and above `at` along `axis`.
fn split(polygon: &[Vec3], axis: usize, at: f32) -> (Polygon, Polygon) {
    let (mut below, mut above) = (Polygon::new(), Polygon::new());
    // More corners than fit do not occur for convex polygons; one that is left out by rounding costs a sliver.
    let push = |part: &mut Polygon, corner| {
        let _ = part.try_push(corner);
    };
    for (i, &corner) in polygon.iter().enumerate() {
        let next = polygon[(i + 1) % polygon.len()];
        let (here, there) = (corner[axis] - at, next[axis] - at);
        if here < 0.0 {
            push(&mut below, corner);
        } else {
            push(&mut above, corner);
        }
        if (here < 0.0) != (there < 0.0) {
            let mut crossing = corner + (next - corner) * (here / (here - there));
            crossing[axis] = at;
            push(&mut below, crossing);
            push(&mut above, crossing);
        }
    }
    (below, above)
}

/// The range of `polygon` along `axis`.
fn range(polygon: &[Vec3], axis: usize) -> (f32, f32) {
    polygon.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), corner| {
        (low.min(corner[axis]), high.max(corner[axis]))
    })
}

/// Calls `visit` with each layer of unit width between 0 and 8 along `axis` that the polygon is in, and its part there. What lies exactly
/// between two layers belongs to the upper one.
fn layers(whole: &[Vec3], axis: usize, mut visit: impl FnMut(usize, &[Vec3])) {
    let (low, high) = range(whole, axis);
    if !(low < 8.0 && high >= 0.0) {
        return;
    }
    let first = low.floor().max(0.0);
    let mut rest: Polygon = whole.iter().copied().collect();
    if low < 0.0 {
        rest = split(&rest, axis, 0.0).1;
    }
    let mut layer = first;
    while layer < 8.0 && rest.len() > 2 {
        if high < layer + 1.0 {
            visit(layer as usize, &rest);
            return;
        }
        let (below, above) = split(&rest, axis, layer + 1.0);
        if below.len() > 2 {
            visit(layer as usize, &below);
        }
        rest = above;
        layer += 1.0;
    }
}

/// Calls `visit` with the index `x + 8 y + 64 z` of each voxel of a brick that the polygon meets, and the area of its part in there.
/// Coordinates are in voxels from the lower corner of the brick.
pub(super) fn for_each_voxel(polygon: &[Vec3], mut visit: impl FnMut(usize, f32)) {
    layers(polygon, 2, |z, slab| {
        layers(slab, 1, |y, bar| {
            layers(bar, 0, |x, cell| {
                let area = area(cell);
                if area > 0.0 {
                    visit(x + 8 * y + 64 * z, area);
                }
            });
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    /// Voxels of a disc against points spread over it.
    #[test]
    fn areas_are_those_of_the_disc() {
        let mut rng = Rng::new(3, Stream::Measure, 0);
        for round in 0..200 {
            let centre = 8.0 * Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
            let normal = match round {
                0..3 => Vec3::AXES[round],
                _ => warp::square_to_sphere(rng.next_2d()),
            };
            let radius = 0.05 + 3.0 * rng.next_f32();
            let mut areas = [0f32; 512];
            for_each_voxel(&polygon(centre, normal, radius), |voxel, area| areas[voxel] += area);
            let frame = crate::math::Frame::from_z(normal);
            let mut counted = [0u32; 512];
            // Vogel's spiral: points of equal area.
            let points = 20_000;
            for i in 0..points {
                let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
                let r = radius * ((i as f32 + 0.5) / points as f32).sqrt();
                let p = centre + r * (cos * frame.x + sin * frame.y);
                if p.min_element() >= 0.0 && p.max_element() < 8.0 {
                    counted[p.x as usize + 8 * (p.y as usize) + 64 * (p.z as usize)] += 1;
                }
            }
            let disc = PI * radius * radius;
            for voxel in 0..512 {
                let want = counted[voxel] as f32 / points as f32 * disc;
                assert!(
                    (areas[voxel] - want).abs() < 0.012 * disc,
                    "{round}: voxel {voxel} of a disc of {radius}: {} {want}",
                    areas[voxel]
                );
            }
        }
    }

    #[test]
    fn nothing_is_lost_between_voxels() {
        let mut rng = Rng::new(4, Stream::Measure, 0);
        for _ in 0..2000 {
            let normal = warp::square_to_sphere(rng.next_2d());
            let centre = Vec3::splat(2.0) + 4.0 * Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
            let radius = 1.9 * rng.next_f32().max(0.01);
            let mut sum = 0.0;
            for_each_voxel(&polygon(centre, normal, radius), |_, area| sum += area);
            let want = PI * radius * radius;
            assert!((sum / want - 1.0).abs() < 1e-3, "{sum} {want}");
        }
        // Exactly between two layers of voxels.
        let mut layers = Vec::new();
        for_each_voxel(&polygon(Vec3::splat(4.0), Vec3::Y, 0.5), |voxel, _| layers.push(voxel / 8 % 8));
        assert!(!layers.is_empty() && layers.iter().all(|&y| y == 4), "{layers:?}");
    }
}
