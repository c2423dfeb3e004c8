//! Closed bodies, constructive solid geometry, the sphere flake and the terrain.

use super::super::*;
use super::double_double::{DoubleDouble, Vector};
use super::{random_direction, random_magnitude, random_point};
use crate::sampling::{Rng, Stream};
use glam::{DAffine3, DMat3, DVec2};
use std::sync::Arc;

/// A body with its parameters.
#[derive(Clone, Copy, Debug)]
enum Body {
    Ball { center: DVec3, radius: f64 },
    Box { min: DVec3, max: DVec3 },
    Cone { base: DVec3, top: DVec3, wide: f64, narrow: f64 },
    Torus { center: DVec3, axis: DVec3, major: f64, minor: f64 },
    Lens { center: DVec3, axis: DVec3, aperture: f64, thickness: f64, radii: [f64; 2] },
}

const KINDS: usize = 6;

impl Body {
    /// Sizes from 1e-6 to 1e3, passing through the cube [-1, 1]^3.
    fn random(kind: usize, rng: &mut Rng) -> Self {
        let size = random_magnitude(rng, -6.0, 3.0);
        let center = random_point(rng) + size * random_point(rng);
        let axis = random_direction(rng) * random_magnitude(rng, -2.0, 2.0);
        match kind {
            0 => Self::Ball { center, radius: size },
            1 => {
                let half = size * DVec3::from_array([(); 3].map(|()| random_magnitude(rng, -2.0, 0.0)));
                Self::Box { min: center - half, max: center + half }
            }
            2 | 3 => {
                let top = center + size * random_magnitude(rng, -1.5, 1.5) * random_direction(rng);
                let narrow = if kind == 2 { size } else { (2.0 * size * rng.next_f64() - size).max(0.0) };
                Self::Cone { base: center, top, wide: size, narrow }
            }
            4 => Self::Torus { center, axis, major: size, minor: size * random_magnitude(rng, -3.0, -0.001) },
            _ => {
                let mut radius = || match rng.next_f64() {
                    u if u < 0.2 => f64::INFINITY,
                    _ => size * random_magnitude(rng, 0.0, 3.0),
                };
                let radii = [radius(), radius()];
                Self::Lens {
                    center,
                    axis,
                    aperture: size,
                    thickness: size * random_magnitude(rng, -2.0, 0.0),
                    radii,
                }
            }
        }
    }

    fn solid(&self) -> Solid {
        match *self {
            Self::Ball { center, radius } => Solid::sphere(center, radius),
            Self::Box { min, max } => Solid::cuboid(min, max),
            Self::Cone { base, top, wide, narrow } => Solid::cone(base, top, wide, narrow),
            Self::Torus { center, axis, major, minor } => Solid::torus(center, axis, major, minor),
            Self::Lens { center, axis, aperture, thickness, radii } => {
                Solid::lens(center, axis, aperture, thickness, radii)
            }
        }
        .unwrap()
    }

    /// Distances from the surfaces that bound it, negative inside, to first order and in twice the precision.
    fn distances(&self, p: DVec3) -> Vec<f64> {
        let exact = DoubleDouble::from;
        match *self {
            Self::Ball { center, radius } => {
                let w = Vector::from(p) - Vector::from(center);
                vec![(w.dot(w) - exact(radius) * exact(radius)).to_f64() / (2.0 * radius)]
            }
            Self::Box { min, max } => (0..3).flat_map(|i| [min[i] - p[i], p[i] - max[i]]).collect(),
            Self::Cone { base, top, wide, narrow } => {
                let (a, w) = (Vector::from(top) - Vector::from(base), Vector::from(p) - Vector::from(base));
                let (squared, along) = (a.dot(a), w.dot(a));
                let edge = exact(wide) * squared + (exact(narrow) - exact(wide)) * along;
                let across = w.dot(w) * squared - along * along;
                let value = (across * squared - edge * edge).to_f64();
                let height = squared.to_f64().sqrt();
                let slant = 1f64.hypot((wide - narrow) / height);
                let side = value / (2.0 * edge.to_f64().abs() * height * height * slant);
                let z = along.to_f64() / height;
                vec![side, -z, (along - squared).to_f64() / height]
            }
            Self::Torus { center, axis, major, minor } => {
                let (w, n) = (Vector::from(p) - Vector::from(center), Vector::from(axis));
                let (squared, along, length) = (w.dot(w), w.dot(n), n.dot(n));
                let bulge = squared + (exact(major) - exact(minor)) * (exact(major) + exact(minor));
                let across = squared * length - along * along;
                let value = bulge * bulge * length - exact(4.0) * exact(major) * exact(major) * across;
                let radius = (across.to_f64() / length.to_f64()).sqrt();
                vec![value.to_f64() / length.to_f64() / (8.0 * major * minor * radius)]
            }
            Self::Lens { center, axis, aperture, thickness, radii } => {
                let n = unit_f64_of(axis);
                let cap = |side: f64, radius: f64| {
                    let n = side * n;
                    let q = Vector::from(p) - Vector::from(center) - Vector::from(0.5 * thickness * n);
                    let curved = exact(if radius == f64::INFINITY { 0.0 } else { 0.5 / radius }) * q.dot(q);
                    (curved + q.dot(Vector::from(n))).to_f64()
                };
                let across = (Vector::from(p) - Vector::from(center)).cross(Vector::from(n));
                let rim =
                    (across.dot(across) - exact(aperture) * exact(aperture)).to_f64() / (2.0 * aperture);
                vec![cap(1.0, radii[0]), cap(-1.0, radii[1]), rim]
            }
        }
    }

    fn distance(&self, p: DVec3) -> f64 {
        self.distances(p).into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
}

fn unit_f64_of(v: DVec3) -> DVec3 {
    crate::math::unit_f64(v).unwrap()
}

fn ray_between(origin: DVec3, target: DVec3, rng: &mut Rng) -> Ray {
    let origin = origin.as_vec3();
    let direction = (target - origin.as_dvec3()) * random_magnitude(rng, -10.0, 10.0);
    Ray::new(origin, direction.as_vec3())
}

/// A ray towards the body or past it; every second ray grazes the hit of the one before.
fn ray_at(shape: &Csg, rng: &mut Rng) -> Ray {
    let (center, radius) = shape.around();
    let distance = radius * random_magnitude(rng, -3.0, 3.0);
    let target = center + radius * random_point(rng);
    let ray = ray_between(target + distance * random_direction(rng), target, rng);
    match shape.nearest(0, &ray) {
        Some(hit) if rng.next_f64() < 0.5 => {
            let p = shape.refine(0, &ray, hit.t as f32).position;
            let (x, y) = tangents(hit.normal);
            let (s, c) = (6.3 * rng.next_f64()).sin_cos();
            let away = x * c + y * s + hit.normal * random_magnitude(rng, -6.0, 0.0);
            ray_between(p + away * distance, p, rng)
        }
        _ => ray,
    }
}

#[test]
fn refined_points_are_on_bodies_and_rays() {
    for kind in 0..KINDS {
        let mut rng = Rng::new(31, Stream::Measure, kind as u64);
        let mut hits = 0;
        for _ in 0..4000 {
            let body = Body::random(kind, &mut rng);
            let shape = Csg::of(body.solid());
            let ray = ray_at(&shape, &mut rng);
            let Some(t) = shape.intersect(0, &ray) else { continue };
            hits += 1;
            let point = shape.refine(0, &ray, t);
            let bound = 2.0 * point.normal.abs().dot(point.error.as_dvec3());
            let off = body.distances(point.position).into_iter().fold(f64::INFINITY, |a, b| a.min(b.abs()));
            assert!(off <= bound, "{body:?}: {off} over {bound}");
            assert!(body.distance(point.position) <= 2.0 * bound, "{body:?} beyond an edge");
            let bounds = shape.bounds();
            assert!(
                bounds.min.cmple(point.position).all() && bounds.max.cmpge(point.position).all(),
                "{body:?}"
            );
            assert!((point.normal.length() - 1.0).abs() < 1e-14);
            // The distance grows along the normal.
            let (center, radius) = shape.around();
            let step = point.normal * (1e-4 * radius.min(smallest(&body)));
            assert!(body.distance(point.position + step) > body.distance(point.position), "{body:?}");
            let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3().normalize());
            let gap = (point.position - origin).cross(direction).length();
            let cos = direction.dot(point.normal).abs().max(1e-7);
            let size = origin.length() + center.length() + radius;
            assert!(gap < 1e-13 * size / cos, "{body:?}: {gap} off the ray, cos {cos}");
        }
        assert!(hits > 400, "{hits} of kind {kind}");
    }
}

/// The smallest length of a body.
fn smallest(body: &Body) -> f64 {
    match *body {
        Body::Ball { radius, .. } => radius,
        Body::Box { min, max } => (max - min).min_element(),
        Body::Cone { base, top, wide, narrow } => {
            let least = if narrow > 0.0 { narrow.min(wide) } else { wide };
            least.min((top - base).length())
        }
        Body::Torus { minor, .. } => minor,
        Body::Lens { thickness, .. } => thickness,
    }
}

/// Crossings and inside/outside must agree at random points of random rays.
fn check_inside(shape: &Csg, distance: impl Fn(DVec3) -> f64, rng: &mut Rng, name: &str) -> usize {
    let mut checked = 0;
    let ray = ray_at(shape, rng);
    let mut hits = Vec::new();
    shape.intersect_all(0, &ray, &mut hits);
    hits.sort_by(f32::total_cmp);
    assert_eq!(shape.intersect(0, &ray), hits.first().copied(), "{name}");
    assert_eq!(shape.occluded(0, &ray), !hits.is_empty(), "{name}");
    let (center, radius) = shape.around();
    let length = ray.direction.as_dvec3().length();
    let origin = ray.origin.as_dvec3();
    let slack = 1e-5 * (radius + (origin - center).length());
    for _ in 0..20 {
        let middle = (center - origin).dot(ray.direction.as_dvec3()) / (length * length);
        let t = middle + (2.0 * rng.next_f64() - 1.0) * radius / length;
        let p = origin + t * ray.direction.as_dvec3();
        let d = distance(p);
        // Close to the surface f32 decides which comes first.
        if t <= 0.0 || d.abs() < slack || !d.is_finite() {
            continue;
        }
        checked += 1;
        let beyond = hits.iter().filter(|&&hit| f64::from(hit) > t).count();
        assert_eq!(beyond % 2 == 1, d < 0.0, "{name}: at {p}, {d}, hits {hits:?}, t {t}");
    }
    checked
}

#[test]
fn crossings_tell_inside_from_outside() {
    for kind in 0..KINDS {
        let mut rng = Rng::new(32, Stream::Measure, kind as u64);
        let mut checked = 0;
        for _ in 0..2000 {
            let body = Body::random(kind, &mut rng);
            let shape = Csg::of(body.solid());
            checked += check_inside(&shape, |p| body.distance(p), &mut rng, &format!("{body:?}"));
        }
        assert!(checked > 3000, "{checked} of kind {kind}");
    }
}

#[test]
fn bodies_combined_tell_inside_from_outside() {
    use CsgOperation::{Difference, Intersection, Union};
    let mut rng = Rng::new(33, Stream::Measure, 0);
    let mut checked = 0;
    for round in 0..2000 {
        let bodies: [Body; 4] = std::array::from_fn(|_| {
            let center = random_point(&mut rng);
            match (5.0 * rng.next_f64()) as u32 {
                0 => Body::Ball { center, radius: 0.7 },
                1 => Body::Box { min: center - 0.6, max: center + DVec3::new(0.5, 0.6, 0.4) },
                2 => Body::Cone { base: center, top: 0.5 * center, wide: 0.6, narrow: 0.2 },
                3 => Body::Torus { center, axis: random_direction(&mut rng), major: 0.7, minor: 0.3 },
                _ => {
                    let axis = random_direction(&mut rng);
                    Body::Lens { center, axis, aperture: 0.8, thickness: 0.6, radii: [1.0, 2.0] }
                }
            }
        });
        let operations: [CsgOperation; 3] =
            std::array::from_fn(|_| [Union, Intersection, Difference][(3.0 * rng.next_f64()) as usize]);
        let join = |a: Csg, operation, b: &Csg| a.combined(operation, b).unwrap();
        let [a, b, c, d] = bodies.map(|body| Csg::of(body.solid()));
        // Half of them in a row, half as a tree.
        let is_tree = round % 2 == 0;
        let whole = if is_tree {
            join(join(a, operations[0], &b), operations[1], &join(c, operations[2], &d))
        } else {
            join(join(join(a, operations[0], &b), operations[1], &c), operations[2], &d)
        };
        let combine = |a: f64, operation, b: f64| match operation {
            Union => a.min(b),
            Intersection => a.max(b),
            Difference => a.max(-b),
        };
        let distance = |p: DVec3| {
            let [a, b, c, d] = bodies.map(|body| body.distance(p));
            if is_tree {
                combine(combine(a, operations[0], b), operations[1], combine(c, operations[2], d))
            } else {
                combine(combine(combine(a, operations[0], b), operations[1], c), operations[2], d)
            }
        };
        if whole.bounds().is_empty() {
            continue;
        }
        checked += check_inside(&whole, distance, &mut rng, &format!("{bodies:?} {operations:?}"));
        // Normals leave the whole, and the part is the one whose surface it is.
        let ray = ray_at(&whole, &mut rng);
        if let Some(t) = whole.intersect(0, &ray) {
            let point = whole.refine(0, &ray, t);
            let own = bodies[point.part as usize].distance(point.position);
            assert!(own.abs() < 1e-12, "{own}");
            let step = 1e-7 * point.normal;
            let (inner, outer) = (distance(point.position - step), distance(point.position + step));
            // At an edge both may be outside.
            assert!(
                outer > 0.0 && inner < 0.0
                    || outer.abs() < 1e-6 && inner.abs() < 1e-6 && outer > inner - 1e-12
            );
        }
    }
    assert!(checked > 5000, "{checked}");
}

#[test]
fn affine_bodies() {
    // A unit ball under any transform, against the implicit equation in its own space.
    let mut rng = Rng::new(34, Stream::Measure, 0);
    for _ in 0..500 {
        let columns = [(); 3].map(|()| random_direction(&mut rng) * random_magnitude(&mut rng, -1.0, 1.0));
        let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
        if matrix.determinant().abs() < 1e-3 {
            continue;
        }
        let transform = DAffine3::from_mat3_translation(matrix, random_point(&mut rng));
        let shape = Csg::of(Solid::sphere(DVec3::ZERO, 1.0).unwrap()).transformed(&transform).unwrap();
        let inverse = transform.inverse();
        let ray = ray_at(&shape, &mut rng);
        let Some(t) = shape.intersect(0, &ray) else { continue };
        let point = shape.refine(0, &ray, t);
        let local = inverse.transform_point3(point.position);
        assert!((local.length() - 1.0).abs() < 1e-11 && point.normal.dot(matrix * local) > 0.0);
        let bounds = shape.bounds();
        assert!(bounds.min.cmple(point.position).all() && bounds.max.cmpge(point.position).all());
    }
}

#[test]
fn known_bodies() {
    let all = |shape: &Csg, origin: [f32; 3], direction: [f32; 3]| {
        let mut hits = Vec::new();
        shape.intersect_all(0, &Ray::new(origin.into(), direction.into()), &mut hits);
        hits
    };
    let cuboid = |min: f64, max: f64| Csg::of(Solid::cuboid(DVec3::splat(min), DVec3::splat(max)).unwrap());
    let ring = Csg::of(Solid::torus(DVec3::ZERO, DVec3::Y, 2.0, 0.5).unwrap());
    assert_eq!(all(&ring, [-4.0, 0.0, 0.0], [1.0, 0.0, 0.0]), [1.5, 2.5, 5.5, 6.5]);
    assert_eq!(all(&ring, [2.0, 3.0, 0.0], [0.0, -1.0, 0.0]), [2.5, 3.5]);
    assert!(all(&ring, [0.0, 3.0, 0.0], [0.0, -1.0, 0.0]).is_empty());
    // A cone's apex, and a ray down its axis.
    let cone = Csg::of(Solid::cone(DVec3::ZERO, 2.0 * DVec3::Y, 1.0, 0.0).unwrap());
    assert_eq!(all(&cone, [0.0, 3.0, 0.0], [0.0, -1.0, 0.0]), [1.0, 3.0]);
    assert_eq!(all(&cone, [-2.0, 1.0, 0.0], [1.0, 0.0, 0.0]), [1.5, 2.5]);
    assert!(all(&cone, [-2.0, 2.5, 0.0], [1.0, 0.0, 0.0]).is_empty());
    // Plano-convex: a hemisphere cut at the aperture.
    let radii = [1.0, f64::INFINITY];
    let lens = Csg::of(Solid::lens(DVec3::ZERO, DVec3::Z, 0.8, 0.5, radii).unwrap());
    assert_eq!(all(&lens, [0.0, 0.0, 3.0], [0.0, 0.0, -1.0]), [2.75, 3.25]);
    // A hole through a box whose ends are coplanar with its faces leaves no face there.
    let drill = Csg::of(Solid::cylinder(DVec3::ZERO, DVec3::Y, 0.2).unwrap());
    let unit = Csg::of(Solid::cuboid(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5)).unwrap());
    let drilled = unit.combined(CsgOperation::Difference, &drill).unwrap();
    assert!(all(&drilled, [0.1, 3.0, 0.0], [0.0, -1.0, 0.0]).is_empty());
    assert_eq!(all(&drilled, [0.3, 3.0, 0.0], [0.0, -1.0, 0.0]), [2.0, 3.0]);
    // Two boxes that share a face are one.
    let pair = cuboid(0.0, 1.0)
        .combined(
            CsgOperation::Union,
            &cuboid(0.0, 1.0).transformed(&DAffine3::from_translation(DVec3::X)).unwrap(),
        )
        .unwrap();
    assert_eq!(all(&pair, [-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]), [1.0, 3.0]);
    // A difference that is empty, and too many bodies.
    let nothing = cuboid(0.0, 1.0).combined(CsgOperation::Difference, &cuboid(-1.0, 2.0)).unwrap();
    assert!(all(&nothing, [-3.0, 0.5, 0.5], [1.0, 0.0, 0.0]).is_empty());
    let mut many = cuboid(0.0, 1.0);
    for _ in 0..Csg::MOST_SOLIDS - 1 {
        many = many.combined(CsgOperation::Union, &cuboid(0.0, 1.0)).unwrap();
    }
    assert_eq!(all(&many, [-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]), [1.0, 2.0]);
    assert_eq!(many.combined(CsgOperation::Union, &cuboid(0.0, 1.0)), Err(ShapeError::TooManySolids));
}

/// All spheres of a flake, by its definition.
fn explicit_flake(center: DVec3, radius: f64, frame: DMat3, depth: u32, spheres: &mut Vec<(DVec3, f64)>) {
    spheres.push((center, radius));
    if depth == 0 {
        return;
    }
    for i in 0..9 {
        let z = match i {
            0..6 => DVec3::new(
                (f64::from(i) * 60.0).to_radians().cos(),
                (f64::from(i) * 60.0).to_radians().sin(),
                0.0,
            ),
            _ => {
                let angle = (f64::from(i - 6) * 120.0 + 30.0).to_radians();
                DVec3::new(angle.cos() / 3f64.sqrt(), angle.sin() / 3f64.sqrt(), (2.0 / 3.0f64).sqrt())
            }
        };
        let x = (DVec3::Z - z * z.z).normalize();
        let child = frame * DMat3::from_cols(x, z.cross(x), z);
        explicit_flake(center + child.z_axis * (radius * 4.0 / 3.0), radius / 3.0, child, depth - 1, spheres);
    }
}

#[test]
fn flake_against_its_spheres() {
    let mut rng = Rng::new(35, Stream::Measure, 0);
    let (x, y) = tangents(DVec3::new(0.6, 0.0, 0.8));
    let frame = DMat3::from_cols(x, y, DVec3::new(0.6, 0.0, 0.8));
    let center = DVec3::new(0.3, -0.2, 0.1);
    for depth in [0, 1, 3, 4] {
        let flake = SphereFlake::with_frame(center, 0.5, frame, depth).unwrap();
        let mut spheres = Vec::new();
        explicit_flake(center, 0.5, frame, depth, &mut spheres);
        assert_eq!(flake.sphere_count(), spheres.len() as u64);
        let around = flake.bounding_sphere();
        assert!(spheres.iter().all(|(c, r)| (c - around.0).length() + r <= around.1));
        let exact: Vec<Sphere> = spheres.iter().map(|&(c, r)| Sphere::new(c, r).unwrap()).collect();
        let mut hits = 0;
        for _ in 0..if depth == 4 { 300 } else { 1000 } {
            let target = around.0 + around.1 * random_point(&mut rng);
            let origin = target + random_direction(&mut rng) * random_magnitude(&mut rng, -3.0, 2.0);
            let ray = ray_between(origin, target, &mut rng);
            let nearest = exact.iter().filter_map(|sphere| sphere.intersect(0, &ray)).reduce(f32::min);
            let blocks = 0..flake.primitive_count();
            let found = blocks.clone().filter_map(|block| Some((flake.intersect(block, &ray)?, block)));
            let found = found.min_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(found.is_some(), blocks.clone().any(|block| flake.occluded(block, &ray)));
            let (Some((t, block)), Some(want)) = (found, nearest) else {
                assert!(found.is_none() && nearest.is_none(), "{found:?} instead of {nearest:?} for {ray:?}");
                continue;
            };
            hits += 1;
            assert!((t - want).abs() <= 4.0 * f32::EPSILON * want, "{t} instead of {want}");
            let point = flake.refine(block, &ray, t);
            let off = spheres.iter().map(|(c, r)| ((point.position - c).length() - r).abs());
            let off = off.fold(f64::INFINITY, f64::min);
            assert!(off < 1e-14 && off < f64::from(point.error.max_element()), "{off}");
            let bounds = flake.bounds(block);
            assert!(bounds.min.cmple(point.position).all() && bounds.max.cmpge(point.position).all());
            let mut all = Vec::new();
            for block in blocks {
                let before = all.len();
                flake.intersect_all(block, &ray, &mut all);
                // Each of them can be refined, not only the nearest.
                let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
                for &t in &all[before..] {
                    let to = flake.refine(block, &ray, t).position - origin;
                    assert!(to.cross(direction).length() < 1e-9 * direction.length());
                    let along = to.dot(direction) / direction.length_squared();
                    assert!((along - f64::from(t)).abs() <= 2e-6 * along, "{along} instead of {t}");
                }
            }
            let mut wanted = Vec::new();
            exact.iter().for_each(|sphere| sphere.intersect_all(0, &ray, &mut wanted));
            assert_eq!(all.len(), wanted.len());
        }
        assert!(hits > 50, "{hits}");
    }
}

#[test]
fn a_flake_of_a_billion_spheres_is_small_and_exact() {
    let flake = SphereFlake::new(DVec3::ZERO, 1.0, DVec3::Y, 10).unwrap();
    assert!(flake.sphere_count() > 3_000_000_000 && flake.memory() < 200_000, "{}", flake.memory());
    let mut rng = Rng::new(36, Stream::Measure, 0);
    let mut hits = 0;
    for _ in 0..300 {
        let target = 0.9 * random_point(&mut rng) + 0.4 * DVec3::Y;
        let ray = ray_between(target + 4.0 * random_direction(&mut rng), target, &mut rng);
        let found =
            (0..flake.primitive_count()).filter_map(|block| Some((flake.intersect(block, &ray)?, block)));
        let Some((t, block)) = found.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        hits += 1;
        let point = flake.refine(block, &ray, t);
        let origin = ray.origin.as_dvec3();
        let direction = ray.direction.as_dvec3().normalize();
        let off = (point.position - origin).cross(direction).length();
        let cos = direction.dot(point.normal).abs();
        // Twelve roundings in each generation, and the smallest radius is 2e-5.
        assert!(off < 1e-13 / cos.max(1e-6), "{off}, cos {cos}");
        assert!(direction.dot(point.normal) < 0.0);
        // A ray that starts outside the error bound and points outward does not hit the same point again.
        let away = point.normal.as_vec3();
        let start = (point.position + point.normal * 4e-7).as_vec3();
        let again = flake.intersect(block, &Ray::new(start, away)).unwrap_or(1.0);
        assert!(again > 1e-7, "{again}");
    }
    assert!(hits > 100, "{hits}");
    assert_eq!(SphereFlake::new(DVec3::ZERO, 1.0, DVec3::Y, 13), Err(ShapeError::Depth(13)));
}

fn landscape(cells: u32) -> Arc<HeightGrid> {
    let noise = TerrainNoise { features: 3.0, octaves: 6, seed: 3, ridges: false };
    Arc::new(HeightGrid::from_noise(cells, &noise).unwrap())
}

/// Height of the bilinear surface.
fn height(grid: &HeightGrid, x: f64, z: f64) -> f64 {
    let last = grid.cells() - 1;
    let (i, j) = ((x as u32).min(last), (z as u32).min(last));
    let (u, v) = (x - f64::from(i), z - f64::from(j));
    let at = |a: u32, b: u32| f64::from(grid.height(i + a, j + b));
    (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v) + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v
}

#[test]
fn terrain_crossings_tell_above_from_below() {
    let grid = landscape(77);
    let mut rng = Rng::new(37, Stream::Measure, 0);
    for size in [1e-3, 1.0, 1e3] {
        let to_object = DAffine3::from_translation(random_point(&mut rng))
            * DAffine3::from_scale(DVec3::new(size / 77.0, 0.3 * size, size / 77.0))
            * DAffine3::from_rotation_y(0.3);
        let terrain = Terrain::new(Arc::clone(&grid), to_object).unwrap();
        let mut checked = 0;
        for _ in 0..3000 {
            let at = |rng: &mut Rng| {
                let p = DVec3::new(77.0 * rng.next_f64(), 1.2 * rng.next_f64() - 0.1, 77.0 * rng.next_f64());
                to_object.transform_point3(p)
            };
            let (from, to) = (at(&mut rng), at(&mut rng));
            let ray = Ray { t_max: 1.0, ..ray_between(from, to, &mut Rng::new(1, Stream::Measure, 1)) };
            let ray = Ray { direction: (to - ray.origin.as_dvec3()).as_vec3(), ..ray };
            let mut hits = Vec::new();
            (0..terrain.primitive_count()).for_each(|block| terrain.intersect_all(block, &ray, &mut hits));
            let side = |p: DVec3| {
                let p = to_object.inverse().transform_point3(p);
                p.y - height(&grid, p.x.clamp(0.0, 77.0), p.z.clamp(0.0, 77.0))
            };
            let end = ray.origin.as_dvec3() + ray.direction.as_dvec3();
            let (before, after) = (side(ray.origin.as_dvec3()), side(end));
            if before.abs() < 1e-5 * (1.0 + 1.0 / size) || after.abs() < 1e-5 * (1.0 + 1.0 / size) {
                continue;
            }
            checked += 1;
            let blocks = 0..terrain.primitive_count();
            let nearest = blocks.clone().filter_map(|block| Some((terrain.intersect(block, &ray)?, block)));
            let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(hits.len() % 2 == 1, (before < 0.0) != (after < 0.0), "{ray:?}: {hits:?}");
            assert_eq!(nearest.map(|(t, _)| t), hits.iter().copied().reduce(f32::min));
            let Some((t, block)) = nearest else { continue };
            let point = terrain.refine(block, &ray, t);
            assert!(
                side(point.position).abs() * 0.3 * size
                    <= 4.0 * f64::from(point.error.max_element()) + 1e-15 * size
            );
            let off =
                (point.position - ray.origin.as_dvec3()).cross(ray.direction.as_dvec3().normalize()).length();
            let cos = ray.direction.as_dvec3().normalize().dot(point.normal).abs();
            assert!(off < 1e-11 * (size + 2.0) / cos.max(1e-5), "{off}, cos {cos}");
            assert!(point.shading_normal.dot(point.normal) > 0.0 && point.normal.y > 0.0);
        }
        assert!(checked > 1500, "{checked}");
    }
}

#[test]
fn nothing_passes_between_the_cells_of_a_terrain() {
    // Straight down onto corners, edges and their neighbourhoods, and along grid lines.
    let grid = landscape(64);
    let terrain = Terrain::new(Arc::clone(&grid), DAffine3::IDENTITY).unwrap();
    let hit = |ray: &Ray| (0..terrain.primitive_count()).any(|block| terrain.intersect(block, ray).is_some());
    let mut rng = Rng::new(38, Stream::Measure, 0);
    for _ in 0..3000 {
        let corner = DVec2::new((1.0 + 62.0 * rng.next_f64()).floor(), (1.0 + 62.0 * rng.next_f64()).floor());
        let target = DVec3::new(corner.x, height(&grid, corner.x, corner.y), corner.y);
        for origin in [
            target + DVec3::Y,
            target + DVec3::new(rng.next_f64() - 0.5, 1.0, 0.0),
            target + DVec3::new(0.5, 1.0, 0.5),
            target + random_point(&mut rng) * 0.3 + DVec3::Y,
        ] {
            let direction = (target - DVec3::new(0.0, 0.5, 0.0) - origin).as_vec3();
            assert!(hit(&Ray::new(origin.as_vec3(), direction)), "from {origin} to {target}");
        }
    }
}

#[test]
fn terrain_memory_and_bad_grids() {
    let flat = HeightGrid::new(1024, vec![0.5; 1025 * 1025]).unwrap();
    assert!(flat.memory() < 16_000_000, "{}", flat.memory());
    let terrain = Terrain::new(Arc::new(flat), DAffine3::IDENTITY).unwrap();
    let ray = Ray::new(Vec3::new(500.5, 1.0, 300.25), Vec3::NEG_Y);
    let hits: Vec<_> =
        (0..terrain.primitive_count()).filter_map(|block| terrain.intersect(block, &ray)).collect();
    assert_eq!(hits, [0.5]);
    for (cells, heights) in [(0, vec![0.0]), (2, vec![0.0; 8]), (1, vec![0.0, 0.0, f32::NAN, 0.0])] {
        assert!(matches!(HeightGrid::new(cells, heights), Err(ShapeError::Heights { .. })));
    }
}

#[test]
fn bad_rays_miss_objects() {
    let objects: [Box<dyn Procedural>; 3] = [
        Box::new(Csg::of(Solid::torus(DVec3::ZERO, DVec3::Y, 1.0, 0.4).unwrap())),
        Box::new(SphereFlake::new(DVec3::ZERO, 1.0, DVec3::Y, 4).unwrap()),
        Box::new(Terrain::new(landscape(20), DAffine3::IDENTITY).unwrap()),
    ];
    for object in objects {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for ray in [
                Ray::new(Vec3::new(x, 0.0, 0.0), Vec3::X),
                Ray::new(Vec3::ZERO, Vec3::new(0.0, 1.0, x)),
                Ray::new(Vec3::ZERO, Vec3::ZERO),
            ] {
                for block in 0..object.primitive_count() {
                    assert_eq!(object.intersect(block, &ray), None, "{object:?} {ray:?}");
                }
            }
        }
    }
}

#[test]
fn impossible_bodies_are_refused() {
    assert!(Solid::cuboid(DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0)).is_err());
    assert!(Solid::cone(DVec3::ZERO, DVec3::ZERO, 1.0, 0.0).is_err());
    assert!(Solid::cone(DVec3::ZERO, DVec3::Y, 0.0, 0.0).is_err());
    assert!(Solid::torus(DVec3::ZERO, DVec3::Y, 1.0, 1.0).is_err());
    assert!(Solid::lens(DVec3::ZERO, DVec3::Y, 1.0, 1.0, [0.4, 2.0]).is_err());
    assert!(Solid::sphere(DVec3::splat(f64::NAN), 1.0).is_err());
    assert!(
        Solid::sphere(DVec3::ZERO, 1.0)
            .unwrap()
            .transformed(&DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)))
            .is_err()
    );
}
