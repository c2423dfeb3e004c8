//! Tests of sampling by area and by solid angle.

use super::super::*;
use super::{random_direction, random_magnitude, random_point};
use crate::bsdf::chi_square::ChiSquare;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Stream};
use glam::{DVec2, Vec2};
use std::f64::consts::{PI, TAU};

fn sphere(center: DVec3, radius: f64) -> EmitterShape {
    EmitterShape::Sphere(Sphere::new(center, radius).unwrap())
}

fn quad(corner: DVec3, edge_u: DVec3, edge_v: DVec3) -> EmitterShape {
    EmitterShape::Quad(Quad::new(corner, edge_u, edge_v).unwrap())
}

/// One shape of each kind, and a skewed parallelogram.
fn random_shapes(rng: &mut Rng) -> [EmitterShape; 6] {
    let (p, size) = (random_point(rng), random_magnitude(rng, -6.0, 1.0));
    let (x, y) = tangents(random_direction(rng));
    let other = random_direction(rng);
    [
        sphere(p, size),
        EmitterShape::Cylinder(Cylinder::new(p, p + x * size * 2.0, size).unwrap()),
        EmitterShape::Disc(Disc::new(p, x, size).unwrap()),
        quad(p, x * size, y * size * 3.0),
        quad(p, x * size, other * size),
        EmitterShape::Triangle(Triangle::new(p, p + x * size, p + other * size).unwrap()),
    ]
}

/// Mean and standard deviation of the mean of `f` over samples of `shape` as seen from `reference`.
fn estimate(
    shape: &EmitterShape,
    reference: DVec3,
    samples: u32,
    f: impl Fn(DVec3, &SolidAngleSample) -> f64,
) -> (f64, f64) {
    let mut rng = Rng::new(17, Stream::Measure, 0);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..samples {
        let Some(sample) = shape.sample_solid_angle(reference, rng.next_2d()) else { continue };
        let value = f((sample.position - reference).normalize(), &sample) / f64::from(sample.pdf_solid_angle);
        sum += value;
        squares += value * value;
    }
    let n = f64::from(samples);
    let mean = sum / n;
    (mean, ((squares / n - mean * mean).max(0.0) / n).sqrt())
}

/// Form factor of an element at `reference` with normal +z: the mean of `cos / (pi pdf)`, within four standard
/// deviations of `want` and one no larger than `sigma_max`. The rounding of an `f32` density is allowed for.
fn assert_form_factor(shape: &EmitterShape, reference: DVec3, want: f64, sigma_max: f64) {
    let (mean, sigma) = estimate(shape, reference, 100_000, |w, _| w.z.max(0.0) / PI);
    assert!(sigma <= sigma_max, "{shape:?}: standard deviation {sigma}");
    assert!((mean - want).abs() < 4.0 * sigma + 1e-6 * want, "{shape:?}: {mean} +- {sigma}, not {want}");
}

/// Form factor of the polygon with these corners, all above the horizon, by Lambert's formula: half of the sum of
/// the edges' angles times the z part of the normals of their planes, over pi.
fn lambert_form_factor(corners: &[DVec3]) -> f64 {
    let n = corners.len();
    let sum: f64 = (0..n)
        .map(|i| {
            let (a, b) = (corners[i].normalize(), corners[(i + 1) % n].normalize());
            let cross = a.cross(b);
            cross.length().atan2(a.dot(b)) * cross.z / cross.length()
        })
        .sum();
    sum.abs() / TAU
}

#[test]
fn form_factor_of_a_sphere() {
    for (distance, radius) in [(2.0, 1.0), (4.0, 1.0), (1e3, 1.0), (1.0, 1e-6), (1.000_001, 1e-6)] {
        let want = f64::powi(radius / distance, 2);
        let shape = sphere(DVec3::new(0.0, 0.0, distance), radius);
        assert_form_factor(&shape, DVec3::ZERO, want, 2e-4 * want);
    }
    // At an angle, all of it above the horizon.
    let center = DVec3::new(0.0, 2.0, 1.5);
    assert_form_factor(&sphere(center, 1.0), DVec3::ZERO, 1.0 / 6.25 * 0.6, 1e-3);
}

#[test]
fn form_factor_of_a_square() {
    let square = quad(DVec3::new(0.0, 0.0, 1.0), DVec3::X, DVec3::Y);
    assert_form_factor(&square, DVec3::ZERO, 0.138_531_6, 2e-4);
    assert_form_factor(&square, DVec3::new(0.5, 0.5, 0.0), 0.239_456_5, 2e-4);
    // Turned around, and above it with the element looking up from below.
    let flipped = quad(DVec3::new(0.0, 0.0, 1.0), DVec3::Y, DVec3::X);
    assert_form_factor(&flipped, DVec3::ZERO, 0.138_531_6, 2e-4);
}

#[test]
fn form_factor_of_a_disc() {
    for (height, radius, sigma) in [(1.0, 1.0, 2e-3), (2.0, 1.0, 1e-3), (1e3, 1.0, 1e-9), (0.1, 1.0, 0.05)] {
        let disc = Disc::new(DVec3::new(0.0, 0.0, height), DVec3::NEG_Z, radius).unwrap();
        let want = radius * radius / (radius * radius + height * height);
        assert_form_factor(&EmitterShape::Disc(disc), DVec3::ZERO, want, sigma);
    }
}

#[test]
fn form_factor_of_polygons() {
    let mut rng = Rng::new(21, Stream::Measure, 0);
    for _ in 0..20 {
        let (x, y) = tangents(random_direction(&mut rng));
        let p = DVec3::new(rng.next_f64(), rng.next_f64(), 2.0 + rng.next_f64());
        let skewed = 0.5 * y + 0.6 * x;
        let q = |edge: DVec3| [p, p + x, p + x + edge, p + edge];
        let around = q(1.5 * y);
        assert_form_factor(&quad(p, x, 1.5 * y), DVec3::ZERO, lambert_form_factor(&around), 1e-3);
        assert_form_factor(&quad(p, x, skewed), DVec3::ZERO, lambert_form_factor(&q(skewed)), 1e-3);
        let triangle = Triangle::new(p, p + x, p + y).unwrap();
        let want = lambert_form_factor(&[p, p + x, p + y]);
        assert_form_factor(&EmitterShape::Triangle(triangle), DVec3::ZERO, want, 1e-3);
    }
}

#[test]
fn form_factor_of_a_cylinder() {
    // Element below the middle of a long cylinder: an infinite one of radius r at distance d gives r / d (crossed
    // strings). Visible side only; the ends, 100 d away, miss about (d / 100 d)^2.
    let (radius, distance) = (0.5, 2.0);
    let end = DVec3::new(0.0, 20.0, distance);
    let tube = Cylinder::new(DVec3::new(0.0, -20.0, distance), end, radius).unwrap();
    let (mean, sigma) = estimate(&EmitterShape::Cylinder(tube), DVec3::ZERO, 1_000_000, |w, sample| {
        if w.dot(sample.normal) < 0.0 { w.z / PI } else { 0.0 }
    });
    assert!((mean - radius / distance).abs() < 4.0 * sigma + 3e-3, "{mean} +- {sigma}");
}

#[test]
fn mean_of_the_inverse_density_is_the_solid_angle() {
    let reference = DVec3::ZERO;
    let disc = Disc::new(DVec3::Z, DVec3::Z, 1.0).unwrap();
    let (mean, sigma) = estimate(&EmitterShape::Disc(disc), reference, 100_000, |_, _| 1.0);
    assert!((mean - TAU * (1.0 - 0.5f64.sqrt())).abs() < 4.0 * sigma, "{mean} +- {sigma}");
    // From inside, a sphere covers all directions with uniform density. On its surface, a direction that leaves at once may miss.
    for (x, sigma_max) in [(0.0, 1e-6), (0.5, 1e-6), (0.9, 1e-6), (1.0 - 1e-15, 0.1)] {
        let (mean, sigma) = estimate(&sphere(DVec3::new(x, 0.0, 0.0), 1.0), reference, 100_000, |_, _| 1.0);
        assert!((mean - 2.0 * TAU).abs() < 4.0 * sigma + 1e-5 && sigma <= sigma_max, "{mean} +- {sigma}");
    }
}

#[test]
fn sphere_chi_square() {
    // From just outside to far away, and from inside.
    let distances = [1.0 + 1e-12, 1.01, 2.0, 1e3, 1e7, 0.99, 0.3];
    for (i, distance) in distances.into_iter().enumerate() {
        let radius = 0.3;
        let reference = DVec3::new(0.2, -0.4, 0.1);
        let axis = DVec3::new(0.6, 0.0, -0.8);
        let shape = Sphere::new(reference + axis * (radius * distance), radius).unwrap();
        let (x, y) = tangents(axis);
        let sin_squared = f64::min(1.0 / distance / distance, 1.0);
        let inside = distance < 1.0;
        let max_drop = if inside { 2.0 } else { sin_squared / (1.0 + (1.0 - sin_squared).sqrt()) };
        let test = ChiSquare {
            bins: [20, 20],
            runs: distances.len() as u32,
            seed: 100 + i as u64,
            ..Default::default()
        };
        test.directions(
            max_drop * (1.0 + 1e-7),
            |rng| {
                let sample = shape.sample_solid_angle(reference, rng.next_2d())?;
                let w = (sample.position - reference).normalize();
                Some(DVec3::new(w.dot(x), w.dot(y), w.dot(axis)))
            },
            |w| {
                // The point in that direction, for the density from inside.
                let w = x * w.x + y * w.y + axis * w.z;
                let offset = reference - shape.center();
                let b = offset.dot(w);
                let t = -b + (b * b - offset.length_squared() + radius * radius).max(0.0).sqrt();
                f64::from(shape.pdf_solid_angle(reference, reference + t * w))
            },
        )
        .unwrap();
    }
}

#[test]
fn quad_chi_square() {
    // Points in the rectangle's own coordinates: the density per area is pdf cos / distance^2.
    let cases = [
        (DVec3::new(0.5, 0.5, 1.0), DVec3::Y),
        (DVec3::new(0.5, 0.5, -0.05), DVec3::Y),
        (DVec3::new(-2.0, 0.3, 0.2), DVec3::Y),
        (DVec3::new(3.0, 4.0, 5.0), 2.0 * DVec3::Y),
        (DVec3::new(0.2, 0.9, 50.0), DVec3::Y),
        (DVec3::new(0.2, 0.9, 1e5), DVec3::Y),
        (DVec3::new(0.5, 0.5, 1.0), DVec3::new(0.7, 0.7, 0.0)),
    ];
    for (i, (reference, edge_v)) in cases.into_iter().enumerate() {
        let shape = Quad::new(DVec3::ZERO, DVec3::X, edge_v).unwrap();
        let test = ChiSquare {
            bins: [20, 20],
            runs: cases.len() as u32,
            seed: 100 + i as u64,
            ..Default::default()
        };
        test.unit_square(
            |rng| {
                let p = shape.sample_solid_angle(reference, rng.next_2d())?.position;
                let t = p.y / edge_v.y;
                Some(DVec2::new(p.x - t * edge_v.x, t))
            },
            |p| {
                let to = DVec3::X * p.x + edge_v * p.y - reference;
                let pdf = f64::from(shape.pdf_solid_angle(reference, reference + to));
                pdf * to.z.abs() / to.length().powi(3) * shape.area()
            },
        )
        .unwrap();
    }
}

#[test]
fn area_chi_square() {
    let test = |i: u64| ChiSquare { bins: [20, 20], runs: 3, seed: 100 + i, ..Default::default() };
    let uniform = |_: DVec2| 1.0;
    let azimuth = |x: f64, y: f64| (y.atan2(x) / TAU).rem_euclid(1.0);
    let ball = Sphere::new(DVec3::ONE, 2.0).unwrap();
    let sample = |rng: &mut Rng| {
        let p = (ball.sample_area(rng.next_2d()).position - DVec3::ONE) / 2.0;
        Some(DVec2::new(0.5 * (p.y + 1.0), azimuth(p.x, p.z)))
    };
    test(1).unit_square(sample, uniform).unwrap();
    let tube = Cylinder::new(DVec3::ZERO, DVec3::Y * 3.0, 2.0).unwrap();
    let sample = |rng: &mut Rng| {
        let p = tube.sample_area(rng.next_2d()).position;
        Some(DVec2::new(p.y / 3.0, azimuth(p.x, p.z)))
    };
    test(2).unit_square(sample, uniform).unwrap();
    let disc = Disc::new(DVec3::ZERO, DVec3::Y, 2.0).unwrap();
    let sample = |rng: &mut Rng| {
        let p = disc.sample_area(rng.next_2d()).position / 2.0;
        Some(DVec2::new(p.length_squared(), azimuth(p.x, p.z)))
    };
    test(3).unit_square(sample, uniform).unwrap();
}

#[test]
fn samples_agree_with_the_density() {
    let mut rng = Rng::new(23, Stream::Measure, 0);
    let mut found = 0;
    for _ in 0..1000 {
        for shape in random_shapes(&mut rng) {
            let reference = 2.0 * random_point(&mut rng);
            let area = shape.sample_area(rng.next_2d());
            assert!((f64::from(area.pdf_area) * shape.area() - 1.0).abs() < 1e-6);
            assert!((area.normal.length() - 1.0).abs() < 1e-14);
            let Some(sample) = shape.sample_solid_angle(reference, rng.next_2d()) else { continue };
            found += 1;
            let pdf = shape.pdf_solid_angle(reference, sample.position);
            // Sampled by area, the cosine of a point seen nearly edge-on is as accurate as its distance from the plane.
            let to = (sample.position - reference).normalize();
            let tolerance = 1e-6 + 1e-9 / to.dot(sample.normal).abs() as f32;
            assert!(
                (pdf / sample.pdf_solid_angle - 1.0).abs() < tolerance,
                "{shape:?} {reference} {sample:?} {pdf}"
            );
            let bounds = shape.bounds();
            let margin = 1e-14 * bounds.max.abs().max(bounds.min.abs()).max_element();
            let clear = bounds.min - margin..bounds.max + margin;
            assert!(clear.start.cmple(sample.position).all() && clear.end.cmpge(sample.position).all());
        }
    }
    assert!(found > 5900, "{found}");
}

#[test]
fn sphere_cone_at_the_extremes() {
    let us = [0.0, 1e-7, 0.3, 0.999, ONE_MINUS_EPSILON];
    for ratio in [1.0 + 1e-15, 1.0 + 1e-12, 1.0 + 1e-6, 1.5, 1e4, 1e8, 1e15] {
        for radius in [1e-6, 1.0, 1e3] {
            let reference = DVec3::new(0.0, 0.0, ratio * radius);
            let shape = Sphere::new(DVec3::ZERO, radius).unwrap();
            // Solid angle 2 pi (1 - cos), from the stable form.
            let sin_squared = ratio.powi(-2);
            let cos = ((ratio - 1.0) * (ratio + 1.0)).sqrt() / ratio;
            let want = 1.0 / (TAU * sin_squared / (1.0 + cos));
            for u in us.into_iter().flat_map(|x| us.map(|y| Vec2::new(x, y))) {
                let sample = shape.sample_solid_angle(reference, u).unwrap();
                let pdf = f64::from(sample.pdf_solid_angle);
                assert!((pdf / want - 1.0).abs() < 1e-6, "{ratio}: {pdf} {want}");
                assert!((sample.position.length() / radius - 1.0).abs() < 1e-15);
                // The point is on the near side and at the requested angle.
                let to = reference - sample.position;
                assert!(
                    to.dot(sample.normal) >= -1e-15 * reference.z,
                    "{ratio} {u}: {}",
                    to.dot(sample.normal)
                );
                let across = sample.position.x.hypot(sample.position.y);
                let drop = f64::from(u.x) / (want * TAU);
                let sin = (drop * (2.0 - drop)).sqrt();
                let error = (across / to.length() - sin).abs();
                // Just off the surface the distance to the point is itself a matter of rounding.
                assert!(ratio < 1.0 + 1e-9 || error < 1e-7 * sin + 1e-30, "{ratio} {u}: {error} of {sin}");
            }
        }
    }
}

#[test]
fn rectangles_around_a_point_cover_the_sphere() {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for inside in [DVec3::splat(0.5), DVec3::new(0.1, 0.7, 0.3), DVec3::new(0.5, 1e-3, 1.0 - 1e-9)] {
        let mut total = 0.0;
        for i in 0..3 {
            let (u, v, w) = (axes[i], axes[(i + 1) % 3], axes[(i + 2) % 3]);
            for corner in [DVec3::ZERO, w] {
                let shape = Quad::new(corner, u, v).unwrap();
                total += 1.0 / f64::from(shape.pdf_solid_angle(inside, corner));
            }
        }
        assert!((total / (2.0 * TAU) - 1.0).abs() < 1e-6, "{inside}: {total}");
    }
    let face = Quad::new(DVec3::new(-0.5, -0.5, 0.5), DVec3::X, DVec3::Y).unwrap();
    let sample = face.sample_solid_angle(DVec3::ZERO, Vec2::splat(0.5)).unwrap();
    assert!((1.0 / f64::from(sample.pdf_solid_angle) / (2.0 * TAU / 6.0) - 1.0).abs() < 1e-6);
    assert!((sample.position - DVec3::new(0.0, 0.0, 0.5)).length() < 1e-7);
}

#[test]
fn small_rectangles_are_continuous() {
    // Across the threshold both ways of sampling agree, in density and in points, on the axis and far off it.
    let shape = Quad::new(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
    for slope in
        [DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.9, 0.4, 0.17).normalize()]
    {
        let cos = slope.z;
        let distance = (cos / SMALLEST_SPHERICAL_RECTANGLE).sqrt();
        for factor in [0.9, 0.999, 1.001, 1.1] {
            let reference = DVec3::new(0.5, 0.5, 0.0) + slope * (distance * factor);
            let solid_angle = cos / (distance * factor).powi(2);
            let mut last = 0.0;
            for i in 0..1000 {
                let u = Vec2::new((i as f32 + 0.5) / 1000.0, 0.25);
                let sample = shape.sample_solid_angle(reference, u).unwrap();
                assert!((f64::from(sample.pdf_solid_angle) * solid_angle - 1.0).abs() < 2e-3);
                assert!((sample.position.x - f64::from(u.x)).abs() < 1e-3);
                assert!((sample.position.y - f64::from(u.y)).abs() < 1e-3);
                // Smooth: noise of cancellation would show in the steps, which are 1e-3.
                let step = sample.position.x - last;
                assert!(i == 0 || (step - 1e-3).abs() < 2e-6, "{slope} {factor}: step {step}");
                last = sample.position.x;
            }
        }
    }
}

#[test]
fn rectangle_at_the_extremes() {
    let shape = Quad::new(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
    let us = [0.0, 1e-7, 0.5, ONE_MINUS_EPSILON];
    for z in [1e-300, 1e-20, 1e-12, 1e-6, 1.0, 1e6, 1e15, 1e100] {
        for (x, y) in [(0.5, 0.5), (0.0, 0.0), (0.0, 0.5), (-1e-9, 0.3), (2.0, 0.5), (-5.0, -7.0), (1e5, 0.0)]
        {
            for reference in [DVec3::new(x, y, z), DVec3::new(x, y, -z)] {
                for u in us.into_iter().flat_map(|x| us.map(|y| Vec2::new(x, y))) {
                    let Some(sample) = shape.sample_solid_angle(reference, u) else { continue };
                    let p = sample.position;
                    assert!(
                        sample.pdf_solid_angle > 0.15 && sample.pdf_solid_angle.is_finite(),
                        "{reference}"
                    );
                    assert!(
                        p.z == 0.0 && p.min_element() >= 0.0 && p.max_element() <= 1.0,
                        "{reference}: {p}"
                    );
                    let pdf = shape.pdf_solid_angle(reference, p);
                    assert!(
                        (pdf / sample.pdf_solid_angle - 1.0).abs() < 1e-5,
                        "{reference}: {pdf} {sample:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn edge_on_and_touching_references_have_no_density() {
    let u = Vec2::splat(0.3);
    let flat: [EmitterShape; 4] = [
        EmitterShape::Disc(Disc::new(DVec3::ZERO, DVec3::Z, 1.0).unwrap()),
        quad(DVec3::ZERO, DVec3::X, DVec3::Y),
        quad(DVec3::ZERO, DVec3::X, DVec3::ONE.with_z(0.0)),
        EmitterShape::Triangle(Triangle::new(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap()),
    ];
    for shape in flat {
        for reference in [DVec3::new(3.0, 0.2, 0.0), DVec3::ZERO, DVec3::X, shape.sample_area(u).position] {
            assert_eq!(shape.sample_solid_angle(reference, u), None, "{shape:?} {reference}");
            assert_eq!(shape.pdf_solid_angle(reference, DVec3::new(0.1, 0.1, 0.0)), 0.0);
        }
    }
    let ball = sphere(DVec3::ZERO, 1.0);
    let touching = ball.sample_area(u).position;
    if let Some(sample) = ball.sample_solid_angle(touching, u) {
        assert!(sample.pdf_solid_angle.is_finite() && sample.pdf_solid_angle > 0.0);
    }
    assert_eq!(Sphere::new(DVec3::ZERO, 1.0).unwrap().pdf_solid_angle(DVec3::X, DVec3::X), 0.0);
}
