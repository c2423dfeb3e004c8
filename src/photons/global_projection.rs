//! The projection map of a light over all objects, for the global photon map: few photons are sent where there is
//! nothing.
//!
//! Bins are squares of the random numbers that determine a direction (or, for parallel light, a place on the disc
//! around the scene). Equal squares carry equal flux, so that photons keep equal power wherever there is something to
//! hit.

use super::direction_bins::Cone;
use crate::lights::AreaLight;
use crate::math::Frame;
use crate::sampling::{Distribution2D, warp};
use crate::scene::Target;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Bins along one side of the square.
const SIDE: usize = 32;

/// Density where there is nothing, relative to where there is something. It is not zero: an object that a bound missed
/// is then noisy instead of lost.
const NOTHING: f64 = 1.0 / 32.0;

/// A map with a larger share of its bins marked than this saves nothing.
const WORTH_IT: f64 = 0.75;

/// The squares of random numbers that send photons towards objects.
#[derive(Clone, Debug)]
pub(super) struct GlobalProjection {
    choice: Distribution2D,
    /// Density in marked bins, over that of uniform sampling.
    gain: f64,
    /// Column after column.
    #[cfg(test)]
    marked: Vec<bool>,
}

impl GlobalProjection {
    fn new(is_marked: impl Fn(Vec2) -> bool) -> Option<Self> {
        let corner = |bin: usize| Vec2::new((bin / SIDE) as f32, (bin % SIDE) as f32) / SIDE as f32;
        let marked: Vec<bool> = (0..SIDE * SIDE).map(|bin| is_marked(corner(bin))).collect();
        let count = marked.iter().filter(|&&marked| marked).count();
        if count as f64 > WORTH_IT * (SIDE * SIDE) as f64 {
            return None;
        }
        let weights: Vec<f64> = marked.iter().map(|&marked| if marked { 1.0 } else { NOTHING }).collect();
        let choice = Distribution2D::new(&weights, SIDE)?;
        Some(Self {
            gain: (SIDE * SIDE) as f64 / choice.total(),
            choice,
            #[cfg(test)]
            marked,
        })
    }

    /// For a flat light that emits on one side, whose directions are [`warp::square_to_cosine_hemisphere`] around its
    /// normal. `None` for others, and where objects are in nearly all directions.
    pub(super) fn of_area(light: &AreaLight, targets: &[Target]) -> Option<Self> {
        let patch = light.patch(false, Vec2::ZERO, Vec2::ONE)?;
        if patch.spread > 0.0 || light.is_two_sided() {
            return None;
        }
        let frame = Frame::from_z(patch.axis.as_vec3());
        let cones = cones(patch.center.as_vec3(), patch.radius as f32 * (1.0 + 1e-6), targets);
        Self::new(|corner| {
            let (center, reach) = on_disc(corner);
            // Converts a step on the disc to the hemisphere above it.
            let distance = center.length().min(1.0);
            let height = |r: f32| (1.0 - r * r).max(0.0).sqrt();
            let (low, high) = (height((distance + reach).min(1.0)), height((distance - reach).max(0.0)));
            let here = height(distance);
            let chord = reach.hypot((here - low).max(high - here));
            let direction = frame.to_world(center.extend(here));
            meets(&cones, direction, chord)
        })
    }

    /// For a light at a point whose directions `to_direction` computes from the square: latitudes from the first
    /// coordinate and longitudes from the second, as in [`warp::square_to_sphere`].
    pub(super) fn of_point(
        position: Vec3,
        to_direction: impl Fn(Vec2) -> Vec3,
        targets: &[Target],
    ) -> Option<Self> {
        let cones = cones(position, 0.0, targets);
        let size = 1.0 / SIDE as f32;
        Self::new(|corner| {
            let middle = to_direction(corner + 0.5 * size);
            // The farthest point of a rectangle of latitudes and longitudes is one of its corners.
            let corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
            let chord = corners.map(|c| (to_direction((corner + c * size).min(Vec2::ONE)) - middle).length());
            meets(&cones, middle, chord.into_iter().fold(0.0, f32::max))
        })
    }

    /// For parallel light along `direction` that starts on the disc around the scene by [`warp::square_to_disc`] in the
    /// frame of the direction, and is within the angle `spread` (small, radians) of it.
    pub(super) fn of_parallel(
        (direction, spread): (Vec3, f32),
        (center, radius): (Vec3, f32),
        targets: &[Target],
    ) -> Option<Self> {
        let frame = Frame::from_z(direction);
        let discs: Vec<(Vec2, f32)> = targets
            .iter()
            .map(|target| {
                let local = frame.to_local(target.center - center);
                // Largest distance that a rotation by the spread moves a point of the disc.
                let moved = 2.0 * spread * (local.length() + target.radius);
                (local.truncate(), target.radius * (1.0 + 1e-5) + 1e-6 * radius + moved)
            })
            .collect();
        Self::new(|corner| {
            let (middle, reach) = on_disc(corner);
            discs.iter().any(|(at, r)| (middle * radius - *at).length() <= r + reach * radius)
        })
    }

    /// Maps `u` towards objects; also returns the factor on the reciprocal of the density.
    #[inline]
    pub(super) fn warp(&self, u: Vec2) -> (Vec2, f32) {
        let ((column, row), probability, rest) = self.choice.sample(u);
        let corner = Vec2::new(column as f32, row as f32);
        ((corner + rest) / SIDE as f32, 1.0 / (probability * (SIDE * SIDE) as f32))
    }

    /// Factor by which the map increases the number of photons in marked bins.
    pub(super) fn gain(&self) -> f64 {
        self.gain
    }

    /// Whether the bin of `u` is marked.
    #[cfg(test)]
    fn is_marked(&self, u: Vec2) -> bool {
        let bin = (u * SIDE as f32).min(Vec2::splat((SIDE - 1) as f32));
        self.marked[bin.x as usize * SIDE + bin.y as usize]
    }

    /// Share of the bins that are marked.
    #[cfg(test)]
    fn marked_share(&self) -> f64 {
        self.marked.iter().filter(|&&marked| marked).count() as f64 / self.marked.len() as f64
    }
}

fn cones(center: Vec3, reach: f32, targets: &[Target]) -> Vec<Cone> {
    targets.iter().map(|target| Cone::of(center, reach, target)).collect()
}

/// Whether a cone meets the part of the unit sphere within the `chord` of `direction`.
fn meets(cones: &[Cone], direction: Vec3, chord: f32) -> bool {
    let angle = if chord >= 2.0 { PI } else { 2.0 * (0.5 * chord).asin() };
    cones.iter().any(|cone| cone.meets(direction, angle))
}

/// The middle of the bin at `corner` on the unit disc, and the largest distance of its points from there.
fn on_disc(corner: Vec2) -> (Vec2, f32) {
    let half = 0.5 / SIDE as f32;
    let reach = warp::DISC_STRETCH as f32 * half * std::f32::consts::SQRT_2;
    (warp::square_to_disc(corner + half), reach * (1.0 + 1e-5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lights::PointLight;
    use crate::math::{Ray, Rgb, unit};
    use crate::sampling::{Rng, Stream};
    use crate::shapes::{Disc, EmitterShape, Quad};
    use glam::DVec3;

    fn targets(rng: &mut Rng) -> Vec<Target> {
        (0..3)
            .map(|surface| {
                let center = warp::square_to_sphere(rng.next_2d()) * (0.5 + rng.next_f32());
                Target { surface, ..Target::of_sphere(center, 0.01 + 0.2 * rng.next_f32().powi(2)) }
            })
            .collect()
    }

    fn hits(ray: &Ray, target: &Target) -> bool {
        let away = target.center - ray.origin;
        let along = away.dot(ray.direction);
        let inside = away.length() <= target.radius;
        inside || along > 0.0 && (away - ray.direction * along).length() <= target.radius
    }

    /// No random number whose ray hits a target is in a bin without one.
    #[test]
    fn nothing_is_missed() {
        let mut rng = Rng::new(8, Stream::Measure, 0);
        let (mut found, mut maps) = (0, 0);
        for round in 0..60 {
            let targets = targets(&mut rng);
            let normal = warp::square_to_sphere(rng.next_2d()).as_dvec3();
            let edge = normal.any_orthonormal_vector() * 0.1;
            let shape = if round % 2 == 0 {
                EmitterShape::Quad(Quad::new(DVec3::ZERO, edge, normal.cross(edge)).unwrap())
            } else {
                EmitterShape::Disc(Disc::new(DVec3::ZERO, normal, 0.15).unwrap())
            };
            let light = AreaLight::new(vec![shape], Rgb::ONE, false, round % 3 == 0).unwrap();
            let point = PointLight { position: Vec3::splat(0.1), intensity: Rgb::ONE };
            let direction = unit(warp::square_to_sphere(rng.next_2d())).unwrap();
            let bounds = (Vec3::ZERO, 2.0);
            let all = [
                GlobalProjection::of_area(&light, &targets),
                GlobalProjection::of_point(point.position, warp::square_to_sphere, &targets),
                GlobalProjection::of_parallel((direction, 0.0), bounds, &targets),
            ];
            for (kind, map) in all.into_iter().enumerate() {
                let Some(map) = map else { continue };
                maps += 1;
                assert!(map.marked_share() > 0.0 && map.marked_share() <= WORTH_IT || kind == 0);
                for _ in 0..4000 {
                    let u = rng.next_2d();
                    let ray = match kind {
                        0 => {
                            let start = light.sample_side(false, rng.next_2d());
                            let local = warp::square_to_cosine_hemisphere(u);
                            Ray::new(start.position, Frame::from_z(start.normal).to_world(local))
                        }
                        1 => Ray::new(point.position, warp::square_to_sphere(u)),
                        _ => {
                            let (frame, d) = (Frame::from_z(direction), warp::square_to_disc(u) * 2.0);
                            Ray::new(frame.x * d.x + frame.y * d.y - direction * 9.0, direction)
                        }
                    };
                    if targets.iter().any(|target| hits(&ray, target)) {
                        found += 1;
                        assert!(map.is_marked(u), "{kind}: {u} leads to something");
                    }
                }
            }
        }
        assert!(maps > 120 && found > 5_000, "{maps} maps, {found} rays");
    }

    /// The density is positive everywhere and integrates to one.
    #[test]
    fn factors_are_those_of_a_density() {
        let targets = [Target::of_sphere(Vec3::X, 0.3)];
        let point = PointLight { position: Vec3::ZERO, intensity: Rgb::ONE };
        let map = GlobalProjection::of_point(point.position, warp::square_to_sphere, &targets).unwrap();
        let n = 512;
        let (mut sum, mut most): (f64, f32) = (0.0, 0.0);
        let mut seen = vec![false; SIDE * SIDE];
        for i in 0..n * n {
            let (u, factor) = map.warp(Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32);
            let bin = (u * SIDE as f32).floor();
            seen[bin.x as usize * SIDE + bin.y as usize] = true;
            sum += f64::from(factor);
            most = most.max(factor);
        }
        let mean = sum / f64::from(n * n);
        // Mean of area over density: the area of the square.
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
        assert!(seen.iter().all(|&seen| seen));
        let share = map.marked_share();
        let least = share + (1.0 - share) * NOTHING;
        assert!((f64::from(most) / (least / NOTHING) - 1.0).abs() < 1e-5, "{most}");
    }
}
