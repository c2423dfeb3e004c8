//! Tests of the projection map: completeness of the bins, and densities.

use super::*;
use crate::math::Rgb;
use crate::sampling::{Rng, Stream};
use crate::shapes::{Cylinder, Disc, EmitterShape, Quad, Sphere, Triangle};
use glam::DVec3;
use proptest::prelude::*;

/// A light of each shape; the mesh has more triangles than a light has cells along one side.
fn area_light(kind: u32, size: f64, two_sided: bool, flip: bool, rng: &mut Rng) -> AreaLight {
    let mut vector = || warp::square_to_sphere(rng.next_2d()).as_dvec3() * size;
    let at = vector();
    let pieces = match kind {
        0 => vec![EmitterShape::Quad(Quad::new(at, vector(), vector()).unwrap())],
        1 => vec![EmitterShape::Disc(Disc::new(at, vector(), size).unwrap())],
        2 => vec![EmitterShape::Sphere(Sphere::new(at, size).unwrap())],
        3 => vec![EmitterShape::Cylinder(Cylinder::new(at, at + vector(), 0.5 * size).unwrap())],
        4 => vec![EmitterShape::Triangle(Triangle::new(at, at + vector(), at + vector()).unwrap())],
        _ => (0..9 + kind as usize % 90)
            .map(|_| {
                let at = at + vector();
                EmitterShape::Triangle(Triangle::new(at, at + vector(), at + vector()).unwrap())
            })
            .collect(),
    };
    AreaLight::new(pieces, Rgb::ONE, two_sided, flip).unwrap()
}

/// Spheres around the origin, from tiny ones to one that contains the light.
fn casters(count: usize, rng: &mut Rng) -> Vec<Target> {
    (0..count as u32)
        .map(|surface| {
            let center = warp::square_to_sphere(rng.next_2d()) * (1.5 * rng.next_f32());
            let sphere = Target::of_sphere(center, 10f32.powf(-4.0 + 4.0 * rng.next_f32()));
            Target { density: 0.1 + rng.next_f32(), surface, ..sphere }
        })
        .collect()
}

/// A point of the target, on its surface or within.
fn point_of(target: &Target, rng: &mut Rng) -> Vec3 {
    let depth = if rng.next_f32() < 0.5 { 1.0 } else { rng.next_f32() };
    target.center + warp::square_to_sphere(rng.next_2d()) * (target.radius * depth)
}

/// Number of the target among the casters of the cell.
fn number_in(cell: &PositionCell, target: &Target) -> Option<u32> {
    let same = |caster: &Aimed| caster.center == target.center && caster.radius == target.radius;
    cell.casters.iter().position(same).map(|index| index as u32)
}

/// Density of sampling `direction`, without and with the casters on whose rim it lies within rounding: it is not told
/// there which of both a sampled direction has.
fn densities(cell: &PositionCell, apex: Vec3, direction: Vec3) -> [f32; 2] {
    let mut sums = [0.0; 2];
    for caster in &cell.casters {
        let Some(size) = one_minus_cos(apex, caster.center, caster.radius) else {
            sums.iter_mut().for_each(|sum| *sum += caster.pdf(apex, None, direction));
            continue;
        };
        let chord = (direction - unit(caster.center - apex).unwrap()).length();
        for (sum, rounding) in sums.iter_mut().zip([-5e-7, 5e-7]) {
            if chord - rounding <= (2.0 * size).sqrt() {
                *sum += caster.probability * warp::cone_pdf(size);
            }
        }
    }
    sums
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    /// The condition for exact aiming: every direction in which a light shines from any point of a cell to any point of
    /// a caster is marked, and the density of a photon in that direction includes the share of the caster.
    #[test]
    fn no_direction_to_a_caster_is_unmarked(
        kind in 0u32..40, size in -3.0f64..0.3, two_sided: bool, flip: bool, count in 1usize..40, seed: u64,
    ) {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        let light = area_light(kind, 10f64.powf(size), two_sided, flip, &mut rng);
        let targets = casters(count, &mut rng);
        let map = ProjectionMap::of_area(&light, 1.0, &targets);
        let mut draw = |u: Vec2, cell: Option<&PositionCell>| {
            let start = match cell {
                Some(cell) => light.sample_side(cell.back, (cell.low + u * cell.size).min(Vec2::splat(ONE_MINUS_EPSILON))),
                None => light.sample_start(u),
            };
            for target in &targets {
                let Some(direction) = unit(point_of(target, &mut rng) - start.position) else { continue };
                if start.normal.dot(direction) <= 0.0 {
                    continue;
                }
                let Some(cell) = cell else { return Err(TestCaseError::fail("a light that sees a caster has no map")) };
                prop_assert!(cell.is_marked(direction), "{direction} from {}", start.position);
                let number = number_in(cell, target);
                let may_hold = |number: u32| cell.bins.as_ref().is_none_or(|bins| bins.at(direction).contains(&number));
                prop_assert!(number.is_some_and(may_hold));
            }
            Ok(())
        };
        let Some(map) = map else {
            for i in 0..200 {
                draw(Vec2::new((i as f32 + 0.5) / 200.0, (i as f32 * 0.618) % 1.0), None)?;
            }
            return Ok(());
        };
        for cell in &map.cells {
            for corner in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE, Vec2::new(0.3, 0.8), Vec2::new(0.9, 0.5)] {
                draw(corner, Some(cell))?;
            }
        }
        // Every cell that faces a caster is sampled, and sampled points are in their cells.
        let chosen = |cell: &PositionCell| {
            let n = 64;
            (0..n * n).any(|i| {
                let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
                std::ptr::eq(map.depart(u).cell, cell)
            })
        };
        let total: f64 = map.cells.iter().map(|cell| cell.flux).sum();
        for cell in map.cells.iter().filter(|cell| cell.flux > 0.05 * total) {
            prop_assert!(chosen(cell));
        }
    }

    /// The reciprocal densities of sampled directions agree with the density evaluated over all casters, and their mean
    /// is the solid angle that the casters cover together.
    #[test]
    fn densities_are_of_all_casters(count in 1usize..40, seed: u64) {
        let mut rng = Rng::new(seed, Stream::Measure, 1);
        let targets = casters(count, &mut rng);
        let light = PointLight { position: Vec3::new(0.1, 0.2, -0.1), intensity: Rgb::ONE };
        let map = ProjectionMap::of_point(&light, &targets).unwrap();
        let cell = &map.cells[0];
        for _ in 0..500 {
            let (direction, per_pdf) = cell.aim(light.position, None, rng.next_2d()).unwrap();
            prop_assert!((direction.length() - 1.0).abs() < 1e-5);
            let [without_rims, with_rims] = densities(cell, light.position, direction);
            prop_assert!(per_pdf * without_rims < 1.001, "{without_rims} {per_pdf}");
            prop_assert!(per_pdf * with_rims > 0.999, "{with_rims} {per_pdf}");
        }
    }
}

#[test]
fn one_sphere_is_aimed_at_uniformly() {
    let target = Target { density: 0.3, ..Target::of_sphere(Vec3::X * 2.0, 1.0) };
    let light = PointLight { position: Vec3::ZERO, intensity: Rgb::ONE };
    let map = ProjectionMap::of_point(&light, &[target]).unwrap();
    let solid_angle = TAU * (1.0 - (1.0f32 - 0.25).sqrt());
    assert!((map.flux() / f64::from(0.3 * solid_angle) - 1.0).abs() < 1e-5);
    let mut rng = Rng::new(0, Stream::Measure, 2);
    for _ in 0..1000 {
        let (direction, per_pdf) = map.cells[0].aim(Vec3::ZERO, None, rng.next_2d()).unwrap();
        assert!((per_pdf / solid_angle - 1.0).abs() < 1e-5);
        assert!(direction.x >= 0.75f32.sqrt() - 1e-6);
    }
}

/// Where two spheres overlap in the view of the light, the mean is the area that they cover together, and the denser
/// one gets more photons.
#[test]
fn overlaps_are_not_counted_twice() {
    let sphere = |y: f32, density: f32| Target { density, ..Target::of_sphere(Vec3::new(2.0, y, 0.0), 0.6) };
    let targets = [sphere(0.0, 1.0), sphere(0.5, 4.0)];
    let light = PointLight { position: Vec3::ZERO, intensity: Rgb::ONE };
    let map = ProjectionMap::of_point(&light, &targets).unwrap();
    let mut rng = Rng::new(0, Stream::Measure, 3);
    let n = 200_000;
    let (mut sum, mut squares, mut denser) = (0.0, 0.0, 0);
    for _ in 0..n {
        let (direction, per_pdf) = map.cells[0].aim(Vec3::ZERO, None, rng.next_2d()).unwrap();
        sum += f64::from(per_pdf);
        squares += f64::from(per_pdf).powi(2);
        denser += u32::from(
            direction.dot(targets[1].center.normalize()) > direction.dot(targets[0].center.normalize()),
        );
    }
    let covered = |direction: Vec3| {
        targets.iter().any(|target| {
            let along = direction.dot(target.center);
            along > 0.0 && (target.center - direction * along).length() <= target.radius
        })
    };
    let hits = (0..4 * n).filter(|_| covered(warp::square_to_sphere(rng.next_2d()))).count();
    let share = hits as f64 / f64::from(4 * n);
    let (want, want_error) =
        (share * 4.0 * f64::from(PI), (share / f64::from(4 * n)).sqrt() * 4.0 * f64::from(PI));
    let mean = sum / f64::from(n);
    let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt().hypot(want_error);
    assert!((mean - want).abs() < 4.0 * error, "{mean}, not {want} +- {error}");
    assert!(f64::from(denser) > 0.65 * f64::from(n), "{denser}");
}

/// The back of a sphere light sends nothing to a caster in front of it, and is not sampled.
#[test]
fn starts_are_where_casters_are_in_view() {
    let light = EmitterShape::Sphere(Sphere::new(DVec3::ZERO, 0.5).unwrap());
    let light = AreaLight::new(vec![light], Rgb::ONE, false, false).unwrap();
    let target = Target { density: 1.0, ..Target::of_sphere(Vec3::new(0.0, 3.0, 0.0), 0.2) };
    let map = ProjectionMap::of_area(&light, 1.0, &[target]).unwrap();
    let mut rng = Rng::new(0, Stream::Measure, 4);
    let n = 10_000;
    let facing = (0..n).filter(|_| {
        let from = map.depart(rng.next_2d());
        light.sample_side(from.back, from.place).normal.y > 0.0
    });
    let share = facing.count() as f64 / f64::from(n);
    assert!(share > 0.9, "{share}");
    // A light that faces away does not see the caster.
    let away = EmitterShape::Quad(Quad::new(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap());
    let away = AreaLight::new(vec![away], Rgb::ONE, false, false).unwrap();
    assert!(ProjectionMap::of_area(&away, 1.0, &[target]).is_none());
}
