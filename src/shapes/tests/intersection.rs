//! Tests of the intersection of rays with simple shapes.

use super::super::roots::sphere_roots;
use super::super::*;
use super::double_double::Vector;
use super::{random_direction, random_magnitude, random_point};
use crate::embree::{Procedural, SurfacePoint};
use crate::math::Ray;
use crate::sampling::{Rng, Stream};
use glam::Vec2;

/// A shape with its parameters.
#[derive(Clone, Copy, Debug)]
enum Case {
    Sphere { center: DVec3, radius: f64, shape: Sphere },
    Cylinder { base: DVec3, top: DVec3, radius: f64, shape: Cylinder },
    Disc { center: DVec3, normal: DVec3, shape: Disc },
}

impl Case {
    /// A shape that passes through the cube `[-1, 1]^3`, with a radius from 1e-6 to 1e3.
    fn random(kind: usize, rng: &mut Rng) -> Self {
        let (touched, radius) = (random_point(rng), random_magnitude(rng, -6.0, 3.0));
        let center = touched + radius * random_direction(rng);
        match kind {
            0 => Self::Sphere { center, radius, shape: Sphere::new(center, radius).unwrap() },
            1 => {
                let height = radius * random_magnitude(rng, -2.0, 2.0);
                let top = center + height * random_direction(rng);
                let shape = Cylinder::new(center, top, radius).unwrap();
                Self::Cylinder { base: center, top, radius, shape }
            }
            _ => {
                let normal = random_direction(rng) * random_magnitude(rng, -3.0, 3.0);
                Self::Disc { center, normal, shape: Disc::new(center, normal, radius).unwrap() }
            }
        }
    }

    fn shape(&self) -> &dyn Procedural {
        match self {
            Self::Sphere { shape, .. } => shape,
            Self::Cylinder { shape, .. } => shape,
            Self::Disc { shape, .. } => shape,
        }
    }

    fn sample_area(&self, rng: &mut Rng) -> AreaSample {
        let u = rng.next_2d();
        match self {
            Self::Sphere { shape, .. } => shape.sample_area(u),
            Self::Cylinder { shape, .. } => shape.sample_area(u),
            Self::Disc { shape, .. } => shape.sample_area(u),
        }
    }

    /// Distance of `p` from the surface, from its implicit equation in twice the precision.
    fn residual(&self, p: DVec3) -> f64 {
        match *self {
            Self::Sphere { center, radius, .. } => {
                let w = Vector::from(p) - Vector::from(center);
                (w.dot(w) - Vector::from(DVec3::X * radius).dot(Vector::from(DVec3::X * radius))).to_f64()
                    / (2.0 * radius)
            }
            Self::Cylinder { base, top, radius, .. } => {
                let axis = Vector::from(top) - Vector::from(base);
                let across = (Vector::from(p) - Vector::from(base)).cross(axis);
                let edge = Vector::from(DVec3::X * radius);
                let length_squared = axis.dot(axis);
                (across.dot(across) - edge.dot(edge) * length_squared).to_f64()
                    / (2.0 * radius * length_squared.to_f64())
            }
            Self::Disc { center, normal, .. } => {
                let n = Vector::from(normal);
                (Vector::from(p) - Vector::from(center)).dot(n).to_f64() / normal.length()
            }
        }
    }

    /// A ray that should hit a random point of the shape, at angles down to 1e-7 from grazing, from near or far.
    fn ray_towards(&self, rng: &mut Rng) -> Ray {
        let target = self.sample_area(rng);
        let cos = random_magnitude(rng, -7.0, 0.0);
        let (x, y) = tangents(target.normal);
        let (s, c) = (6.3 * rng.next_f64()).sin_cos();
        let side = if rng.next_f64() < 0.5 { -1.0 } else { 1.0 };
        let away = (x * c + y * s) * (1.0 - cos * cos).sqrt() + target.normal * cos * side;
        let origin = (target.position + away * random_magnitude(rng, -4.0, 2.0)).as_vec3();
        let length = random_magnitude(rng, -10.0, 10.0) as f32;
        let direction = (target.position - origin.as_dvec3()).as_vec3();
        Ray::new(origin, direction * length)
    }
}

/// `count` hits of random rays on random shapes.
fn random_hits(kind: usize, count: usize, seed: u64) -> Vec<(Case, Ray, f32, SurfacePoint)> {
    let mut rng = Rng::new(seed, Stream::Measure, kind as u64);
    let mut hits = Vec::new();
    let mut tries = 0;
    while hits.len() < count {
        tries += 1;
        assert!(tries < 20 * count, "{} hits of kind {kind} after {tries} rays", hits.len());
        let case = Case::random(kind, &mut rng);
        let ray = case.ray_towards(&mut rng);
        if let Some(t) = case.shape().intersect(0, &ray) {
            hits.push((case, ray, t, case.shape().refine(0, &ray, t)));
        }
    }
    hits
}

/// An origin off the surface: the `f32` neighbour of the point, moved by the error bound and the rounding, and each
/// coordinate rounded away (Pharr, Jakob & Humphreys, section 6.8.6).
fn offset_origin(point: &SurfacePoint, side: f64) -> Vec3 {
    let p = point.position.as_vec3();
    let normal = point.normal * side;
    let error = point.error.as_dvec3() + p.abs().as_dvec3() * 2f64.powi(-24);
    let moved = p.as_dvec3() + normal.abs().dot(error) * normal;
    let round = |x: f64, n: f64| {
        let y = x as f32;
        match n {
            n if n > 0.0 && f64::from(y) < x => y.next_up(),
            n if n < 0.0 && f64::from(y) > x => y.next_down(),
            _ => y,
        }
    };
    Vec3::new(round(moved.x, normal.x), round(moved.y, normal.y), round(moved.z, normal.z))
}

#[test]
fn refined_points_are_on_the_surface() {
    for kind in 0..3 {
        for (case, _, _, point) in random_hits(kind, 1000, 1) {
            let bound = point.normal.abs().dot(point.error.as_dvec3());
            let residual = case.residual(point.position);
            assert!(residual.abs() <= bound, "{case:?}: {residual} over {bound}");
            assert!((point.normal.length() - 1.0).abs() < 1e-14);
            // The bound is tight: at most a few units of f64 in the numbers involved.
            let size = point.position.abs().max_element() + case.shape().bounds(0).radius();
            assert!(point.error.max_element() < 1e-13 * (1.0 + size) as f32, "{case:?}: {}", point.error);
        }
    }
}

#[test]
fn refined_points_are_on_the_ray() {
    for kind in 0..3 {
        for (case, ray, t, point) in random_hits(kind, 1000, 2) {
            let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3().normalize());
            let off = (point.position - origin).cross(direction).length();
            let bounds = case.shape().bounds(0);
            let size = origin.length() + bounds.center().length() + bounds.radius();
            // Rounding that moves the surface moves the hit by that distance over the cosine.
            let cos = direction.dot(point.normal).abs().max(1e-8);
            assert!(off < 1e-14 * size / cos, "{case:?}: {off}, cos {cos}");
            // And t is the f32 nearest to it.
            let along = (point.position - origin).dot(direction) / ray.direction.as_dvec3().length();
            let slack = 1e-14 * size / cos / ray.direction.as_dvec3().length();
            assert!((f64::from(t) - along).abs() <= 2f64.powi(-24) * along * 1.001 + slack, "{case:?}");
            assert!(bounds.min.cmple(point.position).all() && bounds.max.cmpge(point.position).all());
        }
    }
}

#[test]
fn rays_off_the_outer_side_do_not_come_back() {
    let mut rng = Rng::new(3, Stream::Measure, 9);
    for kind in 0..3 {
        for (case, _, _, point) in random_hits(kind, 1000, 3) {
            // A disc is convex from both sides.
            let sides: &[f64] = if kind == 2 { &[1.0, -1.0] } else { &[1.0] };
            for &side in sides {
                let origin = offset_origin(&point, side);
                for _ in 0..50 {
                    let outer = point.normal * side;
                    let direction = match rng.next_f64() {
                        u if u < 0.5 => random_direction(&mut rng),
                        // Grazing.
                        _ => {
                            let (x, y) = tangents(outer);
                            let (s, c) = (6.3 * rng.next_f64()).sin_cos();
                            x * c + y * s + outer * random_magnitude(&mut rng, -9.0, -2.0)
                        }
                    }
                    .as_vec3();
                    let ray = Ray::new(origin, direction);
                    if direction.as_dvec3().dot(outer) > 0.0 {
                        let hit = case.shape().intersect(0, &ray);
                        assert!(hit.is_none(), "{case:?} again at {hit:?} from {origin} along {direction}");
                        assert!(!case.shape().occluded(0, &ray));
                    }
                }
            }
        }
    }
}

#[test]
fn rays_into_a_sphere_meet_it_once() {
    let mut rng = Rng::new(4, Stream::Measure, 9);
    let mut hits = Vec::new();
    for (case, _, _, point) in random_hits(0, 1000, 4) {
        let origin = offset_origin(&point, -1.0);
        for _ in 0..50 {
            let direction = random_direction(&mut rng).as_vec3();
            if direction.as_dvec3().dot(point.normal) < 0.0 {
                hits.clear();
                case.shape().intersect_all(0, &Ray::new(origin, direction), &mut hits);
                assert_eq!(hits.len(), 1, "{case:?} from {origin} along {direction}");
            }
        }
    }
}

#[test]
fn roots_against_twice_the_precision() {
    // Tiny spheres far away and huge ones close by; one Newton step in twice the precision shows the error.
    let mut rng = Rng::new(5, Stream::Measure, 9);
    let mut hits = 0;
    for _ in 0..20_000 {
        let radius = random_magnitude(&mut rng, -6.0, 6.0);
        let distance = radius * random_magnitude(&mut rng, -9.0, 9.0);
        let n = random_direction(&mut rng);
        let offset = n * (radius + distance);
        let aim = radius * random_direction(&mut rng) * rng.next_f64();
        let direction = (aim - offset) * random_magnitude(&mut rng, -20.0, 20.0);
        let Some(roots) = sphere_roots(offset, direction, radius) else { continue };
        hits += 1;
        assert!(roots[0] <= roots[1]);
        for t in roots {
            let p = Vector::from(offset).along(t, Vector::from(direction));
            let edge = Vector::from(DVec3::X * radius);
            let value = (p.dot(p) - edge.dot(edge)).to_f64();
            let slope = 2.0 * p.dot(Vector::from(direction)).to_f64().abs();
            let cos = slope / (2.0 * radius * direction.length());
            let error = value / slope * direction.length();
            let tolerance = 1e-15 * (offset.length() + radius) * (1.0 + 1.0 / cos);
            assert!(cos < 1e-6 || error.abs() < tolerance, "r {radius}, at {distance}: {error}, cos {cos}");
        }
    }
    assert!(hits > 10_000, "{hits}");
}

#[test]
fn a_small_root_keeps_its_digits() {
    // A micrometre above a ground of radius 1000 km: both roots come from numbers near 1e6, whose last digit is 1e-10.
    let (radius, height) = (1e6, 2f64.powi(-20));
    let offset = DVec3::new(0.0, 0.0, radius + height);
    for direction in [DVec3::new(0.0, 0.0, -3.0), DVec3::new(0.42, 0.1, -0.56), DVec3::new(-0.3, 7.0, -0.3)] {
        let [t, _] = sphere_roots(offset, direction, radius).unwrap();
        let p = Vector::from(offset).along(t, Vector::from(direction));
        let edge = Vector::from(DVec3::X * radius);
        let slope = 2.0 * p.dot(Vector::from(direction)).to_f64();
        let error = (p.dot(p) - edge.dot(edge)).to_f64() / slope / t;
        assert!(error.abs() < 1e-12, "{direction}: relative error {error}");
    }
}

#[test]
fn known_hits() {
    let all = |shape: &dyn Procedural, origin: [f32; 3], direction: [f32; 3]| {
        let mut hits = Vec::new();
        shape.intersect_all(0, &Ray::new(origin.into(), direction.into()), &mut hits);
        hits
    };
    let sphere = Sphere::new(DVec3::new(0.0, 0.0, 5.0), 1.0).unwrap();
    assert_eq!(all(&sphere, [0.0; 3], [0.0, 0.0, 1.0]), [4.0, 6.0]);
    assert_eq!(all(&sphere, [0.0; 3], [0.0, 0.0, 2.0]), [2.0, 3.0]);
    assert_eq!(all(&sphere, [0.0, 0.0, 5.0], [0.0, 3.0, 0.0]), [1.0 / 3.0]);
    assert!(all(&sphere, [0.0; 3], [0.0, 0.0, -1.0]).is_empty());
    assert!(all(&sphere, [0.0, 1.1, 0.0], [0.0, 0.0, 1.0]).is_empty());
    let cylinder = Cylinder::new(DVec3::ZERO, DVec3::new(0.0, 2.0, 0.0), 1.0).unwrap();
    assert_eq!(all(&cylinder, [-3.0, 1.0, 0.0], [1.0, 0.0, 0.0]), [2.0, 4.0]);
    // Rays that enter at the open top and leave through the side; along the axis; past the end; exactly at the rim.
    assert_eq!(all(&cylinder, [0.0, 3.0, 0.0], [0.5, -1.0, 0.0]), [2.0]);
    assert!(all(&cylinder, [0.5, 3.0, 0.0], [0.0, -1.0, 0.0]).is_empty());
    assert!(all(&cylinder, [-3.0, 2.001, 0.0], [1.0, 0.0, 0.0]).is_empty());
    assert_eq!(all(&cylinder, [-3.0, 2.0, 0.0], [1.0, 0.0, 0.0]), [2.0, 4.0]);
    let disc = Disc::new(DVec3::ZERO, DVec3::new(0.0, 7.0, 0.0), 2.0).unwrap();
    assert_eq!(all(&disc, [1.9, 3.0, 0.0], [0.0, -1.0, 0.0]), [3.0]);
    assert_eq!(all(&disc, [1.9, -3.0, 0.0], [0.0, 1.0, 0.0]), [3.0]);
    assert!(all(&disc, [2.1, 3.0, 0.0], [0.0, -1.0, 0.0]).is_empty());
    assert!(all(&disc, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]).is_empty());
    // A shell 4e-5 around a sphere is still distinguished from it.
    let shell = Sphere::new(DVec3::new(0.0, 0.0, 5.0), 1.0 + 4e-5).unwrap();
    let gap = all(&sphere, [0.0; 3], [0.0, 0.0, 1.0])[0] - all(&shell, [0.0; 3], [0.0, 0.0, 1.0])[0];
    assert!((gap - 4e-5).abs() < 5e-7, "{gap}");
}

#[test]
fn the_interval_is_open_below_and_closed_above() {
    let sphere = Sphere::new(DVec3::ZERO, 1.0).unwrap();
    let ray = |t_max: f32| Ray { origin: Vec3::new(-3.0, 0.0, 0.0), direction: Vec3::X, t_max };
    assert_eq!(sphere.intersect(0, &ray(2.0)), Some(2.0));
    assert_eq!(sphere.intersect(0, &ray(2f32.next_down())), None);
    let on = Ray::new(Vec3::new(-1.0, 0.0, 0.0), Vec3::X);
    assert_eq!(sphere.intersect(0, &on), Some(2.0));
    let mut rng = Rng::new(6, Stream::Measure, 9);
    for kind in 0..3 {
        for (case, mut ray, t, _) in random_hits(kind, 300, 6) {
            let mut all = Vec::new();
            case.shape().intersect_all(0, &ray, &mut all);
            assert_eq!(all.iter().copied().fold(f32::INFINITY, f32::min), t);
            // A ray that ends between two hits has only the first.
            ray.t_max = t + (all.iter().copied().fold(t, f32::max) - t) * rng.next_f32();
            assert_eq!(case.shape().intersect(0, &ray), Some(t));
            ray.t_max = t.next_down();
            assert_eq!(case.shape().intersect(0, &ray), None);
        }
    }
}

#[test]
fn parameters_scale_with_the_direction() {
    for kind in 0..3 {
        for (case, ray, t, _) in random_hits(kind, 300, 7) {
            let longer = Ray { direction: ray.direction * 1024.0, ..ray };
            assert_eq!(case.shape().intersect(0, &longer), Some(t / 1024.0));
        }
    }
}

#[test]
fn bad_rays_miss() {
    for kind in 0..3 {
        let case = Case::random(kind, &mut Rng::new(8, Stream::Measure, kind as u64));
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        for x in bad {
            for ray in [
                Ray::new(Vec3::new(x, 0.0, 0.0), Vec3::X),
                Ray::new(Vec3::new(0.0, x, 0.0), Vec3::X),
                Ray::new(Vec3::ZERO, Vec3::new(0.0, 1.0, x)),
            ] {
                assert_eq!(case.shape().intersect(0, &ray), None, "{case:?} {ray:?}");
            }
        }
        let inside = case.shape().bounds(0).center().as_vec3();
        assert_eq!(case.shape().intersect(0, &Ray::new(inside, Vec3::ZERO)), None);
    }
}

#[test]
fn refine_survives_a_ray_that_barely_misses() {
    // An instance's transform may turn a grazing hit into a miss by rounding.
    let sphere = Sphere::new(DVec3::ZERO, 1.0).unwrap();
    let point = sphere.refine(0, &Ray::new(Vec3::new(-2.0, 1.000_001, 0.0), Vec3::X), 2.0);
    assert!((point.position - DVec3::Y).length() < 1e-5 && point.position.length() - 1.0 < 1e-15);
    let cylinder = Cylinder::new(DVec3::ZERO, DVec3::Y, 1.0).unwrap();
    let point = cylinder.refine(0, &Ray::new(Vec3::new(-2.0, 1.000_001, 0.0), Vec3::X), 1.0);
    assert_eq!(point.position, DVec3::new(-1.0, 1.0, 0.0));
    let disc = Disc::new(DVec3::ZERO, DVec3::Y, 1.0).unwrap();
    let point = disc.refine(0, &Ray::new(Vec3::new(1.000_001, 1.0, 0.0), Vec3::NEG_Y), 1.0);
    assert!(point.position.y == 0.0 && point.uv.y == 1.0);
}

#[test]
fn surface_parameters() {
    let at = |shape: &dyn Procedural, origin: Vec3, direction: Vec3| {
        let ray = Ray::new(origin, direction);
        let t = shape.intersect(0, &ray).unwrap();
        shape.refine(0, &ray, t)
    };
    let sphere = Sphere::new(DVec3::ZERO, 2.0).unwrap();
    for (from, uv) in [
        (Vec3::Y, Vec2::new(0.0, 0.0)),
        (Vec3::X, Vec2::new(0.0, 0.5)),
        (Vec3::NEG_Z, Vec2::new(0.25, 0.5)),
        (Vec3::NEG_X, Vec2::new(0.5, 0.5)),
        (Vec3::NEG_Y, Vec2::new(0.0, 1.0)),
    ] {
        let point = at(&sphere, from * 5.0, -from);
        assert_eq!(point.normal.as_vec3(), from);
        assert!(
            (point.uv.y - uv.y).abs() < 1e-7 && (uv.y.fract() == 0.0 || (point.uv.x - uv.x).abs() < 1e-7)
        );
        // The normal is the outer one seen from inside as well.
        assert_eq!(at(&sphere, Vec3::ZERO, from).normal.as_vec3(), from);
    }
    let cylinder = Cylinder::new(DVec3::ZERO, DVec3::Z * 4.0, 1.0).unwrap();
    let point = at(&cylinder, Vec3::new(0.0, 5.0, 1.0), Vec3::NEG_Y);
    assert_eq!((point.normal, point.uv.y), (DVec3::Y, 0.25));
    let disc = Disc::new(DVec3::ZERO, DVec3::Z, 2.0).unwrap();
    let point = at(&disc, Vec3::new(1.0, 0.0, -1.0), Vec3::Z);
    assert_eq!((point.normal, point.uv), (DVec3::Z, Vec2::new(0.0, 0.5)));
}

#[test]
fn bounds_are_tight() {
    let mut rng = Rng::new(10, Stream::Measure, 9);
    for kind in 0..3 {
        for _ in 0..10 {
            let case = Case::random(kind, &mut rng);
            let bounds = case.shape().bounds(0);
            let mut found = Bounds3::EMPTY;
            for _ in 0..20_000 {
                found = found.with_point(case.sample_area(&mut rng).position);
            }
            assert_eq!(bounds.union(found), bounds);
            let (size, missing) =
                (bounds.max - bounds.min, (bounds.max - found.max) + (found.min - bounds.min));
            assert!(missing.max_element() < 0.05 * size.max_element(), "{case:?}: {missing} of {size}");
        }
    }
}

#[test]
fn impossible_shapes_are_refused() {
    for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(Sphere::new(DVec3::ZERO, radius), Err(ShapeError::Radius(_))));
        assert!(matches!(Cylinder::new(DVec3::ZERO, DVec3::Y, radius), Err(ShapeError::Radius(_))));
        assert!(matches!(Disc::new(DVec3::ZERO, DVec3::Y, radius), Err(ShapeError::Radius(_))));
    }
    assert_eq!(Cylinder::new(DVec3::ONE, DVec3::ONE, 1.0), Err(ShapeError::NoArea));
    assert_eq!(Disc::new(DVec3::ONE, DVec3::ZERO, 1.0), Err(ShapeError::NoArea));
    assert_eq!(Quad::new(DVec3::ONE, DVec3::X, 2.0 * DVec3::X), Err(ShapeError::NoArea));
    assert_eq!(Triangle::new(DVec3::ONE, DVec3::ONE, DVec3::ZERO), Err(ShapeError::NoArea));
    let bad = DVec3::new(0.0, f64::NAN, 0.0);
    assert!(matches!(Sphere::new(bad, 1.0), Err(ShapeError::NotFinite { .. })));
    assert!(matches!(Disc::new(DVec3::ZERO, bad, 1.0), Err(ShapeError::NotFinite { .. })));
    assert!(matches!(Triangle::new(DVec3::ZERO, DVec3::X, bad), Err(ShapeError::NotFinite { .. })));
}
