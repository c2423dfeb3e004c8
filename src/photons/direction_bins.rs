//! Bins of directions around a place, with the targets that may be visible in each.

use crate::math::{Frame, unit};
use crate::scene::Target;
use glam::Vec3;
use std::f32::consts::PI;

/// A cone of directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// Unit axis.
    pub axis: Vec3,
    /// Half angle in radians; `pi` contains all directions.
    pub half_angle: f32,
}

impl Cone {
    /// All directions from points within `reach` of `apex` to points of the sphere of `target`: the cone of the sphere
    /// enlarged by `reach`, and every direction where `apex` lies inside that sphere.
    pub(super) fn of(apex: Vec3, reach: f32, target: &Target) -> Self {
        let away = (target.center - apex).as_dvec3();
        // With a margin for the rounding of values computed from such points in f32.
        let radius = (f64::from(target.radius) + f64::from(reach)) * (1.0 + 1e-6);
        match unit(target.center - apex) {
            Some(axis) if away.length() > radius => {
                Self { axis, half_angle: (radius / away.length()).asin() as f32 + ROUNDING }
            }
            _ => Self { axis: Vec3::Z, half_angle: PI },
        }
    }

    /// Whether a cone of half angle `spread` around `direction` has a direction in common with this one.
    pub(super) fn meets(&self, direction: Vec3, spread: f32) -> bool {
        self.half_angle >= PI || self.axis.angle_between(direction) <= self.half_angle + spread + ROUNDING
    }
}

/// Angular margin in radians, larger than the error of an angle computed in `f32` from unit vectors.
const ROUNDING: f32 = 1e-3;

/// Angle to the axis of the map within which azimuths are undefined.
const POLE: f32 = 4.0 * ROUNDING;

/// The directions around a place, in bins of equal steps of the polar angle and the azimuth, with the targets that each
/// bin may contain (Jensen & Christensen 1995, section 3.1 and figure 2).
///
/// A target is entered by the largest extent of its cone in both angles: sometimes in too many bins, never in too few.
#[derive(Clone, Debug)]
pub(super) struct DirectionBins {
    frame: Frame,
    rows: usize,
    columns: usize,
    /// By bin, row after row: its first entry. One more than the number of bins.
    starts: Vec<u32>,
    /// Numbers of cones.
    entries: Vec<u32>,
}

impl DirectionBins {
    /// Bins around `axis` with the parts of `cones` up to the polar angle `limit`.
    pub(super) fn new(axis: Vec3, (rows, columns): (usize, usize), limit: f32, cones: &[Cone]) -> Self {
        let mut bins =
            Self { frame: Frame::from_z(axis), rows, columns, starts: Vec::new(), entries: Vec::new() };
        let mut counts = vec![0u32; rows * columns];
        for cone in cones {
            bins.for_each_bin(cone, limit, |bin| counts[bin] += 1);
        }
        let mut total = 0;
        bins.starts.push(0);
        for count in &mut counts {
            total += std::mem::replace(count, total);
            bins.starts.push(total);
        }
        let mut entries = vec![0; total as usize];
        for (number, cone) in (0..).zip(cones) {
            bins.for_each_bin(cone, limit, |bin| {
                entries[counts[bin] as usize] = number;
                counts[bin] += 1;
            });
        }
        bins.entries = entries;
        bins
    }

    /// Calls `enter` for each bin that the cone may touch.
    fn for_each_bin(&self, cone: &Cone, limit: f32, mut enter: impl FnMut(usize)) {
        let (polar, azimuth) = self.angles(cone.axis);
        let reach = cone.half_angle + ROUNDING;
        let (low, high) = ((polar - reach).max(0.0), (polar + reach).min(limit).min(PI));
        if low > high {
            return;
        }
        let around = cone.half_angle >= PI || low <= POLE || polar + reach >= PI - POLE;
        let (first, count) = if around {
            (0, self.columns)
        } else {
            // The tangents from the pole to the circle on the unit sphere; azimuths are less accurate near the poles.
            let half = (reach.sin() / polar.sin()).min(1.0).asin() + ROUNDING / low.sin().min(high.sin());
            let column = |angle: f32| (angle + PI) / (2.0 * PI) * self.columns as f32;
            let (first, last) = (column(azimuth - half).floor(), column(azimuth + half).floor());
            (first.rem_euclid(self.columns as f32) as usize, ((last - first) as usize + 1).min(self.columns))
        };
        for row in self.row(low)..=self.row(high) {
            for column in 0..count {
                enter(row * self.columns + (first + column) % self.columns);
            }
        }
    }

    /// Angle to the axis in `[0, pi]`, and azimuth around it in `[-pi, pi]`.
    fn angles(&self, direction: Vec3) -> (f32, f32) {
        let local = self.frame.to_local(direction);
        (local.x.hypot(local.y).atan2(local.z), local.y.atan2(local.x))
    }

    fn row(&self, polar: f32) -> usize {
        ((polar / PI * self.rows as f32) as usize).min(self.rows - 1)
    }

    /// Numbers of the cones that may contain the unit `direction`.
    pub(super) fn at(&self, direction: Vec3) -> &[u32] {
        let (polar, azimuth) = self.angles(direction);
        let column = ((azimuth + PI) / (2.0 * PI) * self.columns as f32) as usize;
        self.bin(self.row(polar), column.min(self.columns - 1))
    }

    /// Numbers of the cones in a bin.
    pub(super) fn bin(&self, row: usize, column: usize) -> &[u32] {
        let bin = row * self.columns + column;
        &self.entries[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};

    #[test]
    fn every_direction_of_a_cone_is_in_a_bin_of_it() {
        let mut rng = Rng::new(2, Stream::Measure, 0);
        for round in 0..400 {
            let axis = warp::square_to_sphere(rng.next_2d());
            // From very narrow to nearly all directions, often towards the poles of the map.
            let cones: Vec<Cone> = (0..5)
                .map(|i| {
                    let towards = warp::square_to_sphere(rng.next_2d());
                    let near = [1.0, 0.1, 1e-3][(round + i) % 3];
                    let pole = if i % 2 == 0 { axis } else { -axis };
                    let axis = unit(towards * near + pole * (1.0 - near)).unwrap();
                    Cone { axis, half_angle: PI * rng.next_f32().powi(1 + 4 * (round as i32 % 2)) }
                })
                .collect();
            let bins = DirectionBins::new(axis, (32, 64), PI, &cones);
            for (number, cone) in (0..).zip(&cones) {
                for _ in 0..200 {
                    let local = warp::square_to_cone(rng.next_2d(), 1.0 - cone.half_angle.cos());
                    let direction = Frame::from_z(cone.axis).to_world(local);
                    assert!(bins.at(direction).contains(&number), "{cone:?} around {axis}: {direction}");
                }
            }
        }
    }

    #[test]
    fn what_is_far_from_a_cone_is_not_marked() {
        let cone = Cone { axis: Vec3::new(0.6, 0.0, 0.8), half_angle: 0.2 };
        let bins = DirectionBins::new(Vec3::Z, (32, 64), PI, &[cone]);
        let marked = (0..32).flat_map(|row| (0..64).map(move |column| (row, column)));
        let marked = marked.filter(|&(row, column)| !bins.bin(row, column).is_empty()).count();
        // The circle of 0.2 rad covers 4 of 32 rows and 7 of 64 columns.
        assert!((20..=60).contains(&marked), "{marked}");
        assert!(bins.at(Vec3::NEG_Z).is_empty() && bins.at(Vec3::Y).is_empty());
        // Beyond the limit nothing is entered.
        let bins = DirectionBins::new(Vec3::NEG_Z, (32, 64), PI / 2.0, &[cone]);
        assert!(bins.at(cone.axis).is_empty());
    }
}
