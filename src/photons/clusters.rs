//! Clusters of targets, so that a light aims at a limited number of spheres.

use crate::scene::Target;
use glam::Vec3;

/// At most `most` spheres that enclose all of `targets`: targets close to each other are combined. Each sphere is as
/// dense as the densest of its parts.
pub(super) fn clustered(targets: &[Target], most: usize) -> Vec<Target> {
    let mut result = Vec::with_capacity(targets.len().min(most));
    split(&mut targets.to_vec(), most.max(1), &mut result);
    result
}

fn split(targets: &mut [Target], most: usize, result: &mut Vec<Target>) {
    if targets.len() <= most {
        result.extend_from_slice(targets);
        return;
    }
    if most == 1 {
        result.push(around(targets));
        return;
    }
    let centers = targets.iter().map(|target| target.center);
    let (low, high) = centers.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), center| {
        (low.min(center), high.max(center))
    });
    let extent = high - low;
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    let (left, right) = (most / 2, most - most / 2);
    let middle = targets.len() * left / most;
    targets.select_nth_unstable_by(middle, |a, b| {
        a.center[axis].total_cmp(&b.center[axis]).then(a.surface.cmp(&b.surface))
    });
    let (low, high) = targets.split_at_mut(middle);
    split(low, left, result);
    split(high, right, result);
}

fn around(targets: &[Target]) -> Target {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for target in targets {
        low = low.min(target.center - target.radius);
        high = high.max(target.center + target.radius);
    }
    let center = 0.5 * (low + high);
    let reach = |target: &Target| (target.center - center).length() + target.radius;
    Target {
        center,
        radius: targets.iter().map(reach).fold(0.0, f32::max) * (1.0 + 1e-6),
        density: targets.iter().map(|target| target.density).fold(0.0, f32::max),
        surface: targets[0].surface,
        bounds: targets.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], target| {
            [low.min(target.bounds[0]), high.max(target.bounds[1])]
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    #[test]
    fn clusters_hold_every_target() {
        let mut rng = Rng::new(5, Stream::Measure, 0);
        let targets: Vec<Target> = (0..700)
            .map(|surface| {
                let center = warp::square_to_sphere(rng.next_2d()) * rng.next_f32();
                let sphere = Target::of_sphere(center, 0.02 * rng.next_f32());
                Target { density: rng.next_f32(), surface, ..sphere }
            })
            .collect();
        assert_eq!(clustered(&targets, 700), targets);
        for most in [1, 2, 7, 256] {
            let clusters = clustered(&targets, most);
            assert_eq!(clusters.len(), most);
            for target in &targets {
                let holds = |cluster: &&Target| {
                    (cluster.center - target.center).length() + target.radius <= cluster.radius * (1.0 + 1e-6)
                        && cluster.density >= target.density
                        && cluster.bounds[0].cmple(target.bounds[0]).all()
                        && cluster.bounds[1].cmpge(target.bounds[1]).all()
                };
                assert!(clusters.iter().any(|cluster| holds(&cluster)), "{target:?}");
            }
        }
    }
}
