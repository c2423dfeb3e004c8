//! Every crossing along a ray: against brute force in `f64`, through shared edges and corners, and by the hundred.

use crate::support::*;
use cardioid::math::Ray;
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::scene::{Crossings, Geometry, Scene};
use glam::{DVec3, Vec3};
use std::fmt::Write;

const CAMERA: &str = r#"
    [camera]
    eye = [0, 0, 9]
    at = [0, 0, 0]
    fov = 40

    [materials.grey]
    type = "lambert"
    reflectance = 0.5
"#;

fn mesh(name: &str, vertices: &[DVec3], faces: &[Vec<usize>]) -> String {
    let vertices: Vec<_> = vertices.iter().map(|v| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z)).collect();
    format!(
        "[[shapes]]\nname = \"{name}\"\ntype = \"mesh\"\nvertices = [{}]\nfaces = {faces:?}\nmaterial = \"grey\"\n",
        vertices.join(", ")
    )
}

fn direction(rng: &mut Rng) -> DVec3 {
    warp::square_to_sphere(rng.next_2d()).as_dvec3()
}

fn in_box(rng: &mut Rng) -> DVec3 {
    DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) * 2.0 - 1.0
}

/// Parameters of the crossings of the line with a triangle; `None` where rounding may decide.
fn through_triangle([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<Vec<f64>> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    if det.abs() < 1e-3 * e1.cross(e2).length() {
        return None;
    }
    let s = origin - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    let inside = u.min(v).min(1.0 - u - v);
    if inside.abs() < 1e-4 || t.abs() < 1e-4 {
        return None;
    }
    Some(if inside > 0.0 && t > 0.0 { vec![t] } else { vec![] })
}

/// The exact shapes of the soup, in the world.
#[derive(Clone, Copy)]
enum Round {
    Sphere(DVec3, f64),
    Disc(DVec3, DVec3, f64),
    Cylinder(DVec3, DVec3, f64),
}

impl Round {
    fn text(&self) -> String {
        let v = |v: DVec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
        match *self {
            Self::Sphere(c, r) => format!("type = \"sphere\"\ncenter = {}\nradius = {r:?}", v(c)),
            Self::Disc(c, n, r) => {
                format!("type = \"disc\"\ncenter = {}\nnormal = {}\nradius = {r:?}", v(c), v(n))
            }
            Self::Cylinder(a, b, r) => {
                format!("type = \"cylinder\"\nbase = {}\ntop = {}\nradius = {r:?}", v(a), v(b))
            }
        }
    }

    /// As [`through_triangle`], by solving directly.
    fn crossings(&self, origin: DVec3, direction: DVec3) -> Option<Vec<f64>> {
        let quadratic = |o: DVec3, d: DVec3, r: f64| -> Option<Vec<f64>> {
            let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - r * r);
            let discriminant = b * b - a * c;
            if discriminant.abs() < 1e-4 * r * r || a < 1e-3 {
                return None;
            }
            if discriminant < 0.0 {
                return Some(vec![]);
            }
            Some(vec![(-b - discriminant.sqrt()) / a, (-b + discriminant.sqrt()) / a])
        };
        let mut found = match *self {
            Self::Sphere(center, radius) => quadratic(origin - center, direction, radius)?,
            Self::Disc(center, normal, radius) => {
                let cosine = direction.dot(normal);
                if cosine.abs() < 1e-3 {
                    return None;
                }
                let t = (center - origin).dot(normal) / cosine;
                let distance = (origin + t * direction - center).length();
                if (distance - radius).abs() < 1e-4 {
                    return None;
                }
                if distance < radius { vec![t] } else { vec![] }
            }
            Self::Cylinder(base, top, radius) => {
                let axis = (top - base).normalize();
                let flat = |v: DVec3| v - v.dot(axis) * axis;
                let height = |t: f64| (origin + t * direction - base).dot(axis);
                let length = (top - base).length();
                let roots = quadratic(flat(origin - base), flat(direction), radius)?;
                if roots.iter().any(|&t| height(t).abs() < 1e-4 || (height(t) - length).abs() < 1e-4) {
                    return None;
                }
                roots.into_iter().filter(|&t| height(t) > 0.0 && height(t) < length).collect()
            }
        };
        if found.iter().any(|t| t.abs() < 1e-4) {
            return None;
        }
        found.retain(|&t| t > 0.0);
        Some(found)
    }
}

/// A ray of the world in render space.
fn to_render(scene: &Scene, origin: DVec3, direction: DVec3) -> Ray {
    Ray::new(scene.space().position(origin).as_vec3(), direction.as_vec3())
}

#[test]
fn soups_of_triangles_and_exact_shapes_against_brute_force() {
    for seed in 0..3 {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        let corners: Vec<DVec3> = (0..250)
            .flat_map(|_| {
                let center = in_box(&mut rng);
                [0; 3].map(|_| center + in_box(&mut rng) * 0.5)
            })
            .collect();
        let faces: Vec<_> = (0..250).map(|i| vec![3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mut text = format!("{CAMERA}{}", mesh("soup", &corners, &faces));
        let mut shapes = Vec::new();
        for _ in 0..8 {
            let (a, b) = (in_box(&mut rng), in_box(&mut rng));
            shapes.push(Round::Sphere(a, 0.1 + 0.5 * rng.next_f64()));
            shapes.push(Round::Disc(in_box(&mut rng), direction(&mut rng), 0.2 + 0.5 * rng.next_f64()));
            shapes.push(Round::Cylinder(a, b, 0.1 + 0.2 * rng.next_f64()));
        }
        for (i, shape) in shapes.iter().enumerate() {
            write!(text, "[[shapes]]\nname = \"s{i}\"\n{}\nmaterial = \"grey\"\n", shape.text()).unwrap();
        }
        let stage = Stage::new(&text, (8, 8));
        let scene = stage.scene();
        let mut crossings = Crossings::default();
        let (mut checked, mut most, mut total) = (0, 0, 0);
        'rays: for _ in 0..4000 {
            let origin = in_box(&mut rng) * 1.5;
            let ray = to_render(scene, origin, direction(&mut rng));
            // The ray as it is after rounding, in the world.
            let to_world = 1.0 / scene.space().scale;
            let origin = ray.origin.as_dvec3() * to_world + scene.space().center;
            let along = ray.direction.as_dvec3();
            let mut want: Vec<(f64, u32, u32)> = Vec::new();
            for (index, surface) in scene.surfaces().iter().enumerate() {
                if let Geometry::Mesh(mesh) = &surface.geometry {
                    for i in 0..mesh.buffers.triangles().len() as u32 {
                        let corners = mesh.buffers.corners(i).map(|c| Vec3::from_array(c).as_dvec3());
                        let Some(t) = through_triangle(corners, ray.origin.as_dvec3(), along) else {
                            continue 'rays;
                        };
                        want.extend(t.into_iter().map(|t| (t, index as u32, i)));
                    }
                } else {
                    let number: usize = surface.name[1..].parse().unwrap();
                    let Some(t) = shapes[number].crossings(origin, along) else { continue 'rays };
                    want.extend(t.into_iter().map(|t| (t / to_world, index as u32, 0)));
                }
            }
            // In the order of surfaces, as equal parameters to within rounding may be in either order.
            want.sort_by(|a, b| (a.1, a.2).cmp(&(b.1, b.2)).then(a.0.total_cmp(&b.0)));
            scene.intersect_all(&ray, &mut crossings);
            assert!(crossings.hits().is_sorted_by_key(|hit| hit.t));
            let mut found: Vec<_> = crossings
                .hits()
                .iter()
                .map(|hit| (hit.t, scene.interaction(&ray, hit).surface, hit.primitive))
                .collect();
            found.sort_by(|a, b| (a.1, a.2).cmp(&(b.1, b.2)).then(a.0.total_cmp(&b.0)));
            assert_eq!(found.len(), want.len(), "{found:?} {want:?}");
            for (a, b) in found.iter().zip(&want) {
                assert_eq!((a.1, a.2), (b.1, b.2));
                assert!((f64::from(a.0) - b.0).abs() < 1e-5, "{a:?} {b:?}");
            }
            let first = scene.embree().intersect(&ray).map(|hit| hit.t);
            assert_eq!(first, crossings.hits().first().map(|hit| hit.t), "the nearest is the nearest");
            checked += 1;
            most = most.max(found.len());
            total += found.len();
        }
        println!("seed {seed}: {checked} rays, {total} crossings, at most {most} on one");
        assert!(checked > 2000 && total > 5000);
    }
}

/// A ball of `rings` rings of quads and two fans of triangles, corners shared.
fn ball(rings: usize, sectors: usize) -> (Vec<DVec3>, Vec<Vec<usize>>) {
    let mut vertices = vec![DVec3::Y];
    for ring in 1..rings {
        let (sin, cos) = (std::f64::consts::PI * ring as f64 / rings as f64).sin_cos();
        for sector in 0..sectors {
            let (s, c) = (std::f64::consts::TAU * sector as f64 / sectors as f64).sin_cos();
            vertices.push(DVec3::new(sin * c, cos, -sin * s));
        }
    }
    vertices.push(DVec3::NEG_Y);
    let last = vertices.len() - 1;
    let at = |ring: usize, sector: usize| 1 + (ring - 1) * sectors + sector % sectors;
    let mut faces = Vec::new();
    for sector in 0..sectors {
        faces.push(vec![0, at(1, sector), at(1, sector + 1)]);
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, sector), at(ring, sector + 1));
            let (c, d) = (at(ring + 1, sector + 1), at(ring + 1, sector));
            faces.push(vec![a, d, c]);
            faces.push(vec![a, c, b]);
        }
        faces.push(vec![last, at(rings - 1, sector + 1), at(rings - 1, sector)]);
    }
    (vertices, faces)
}

/// Through each corner, and points of each edge, of a closed ball: in and out, nothing lost and nothing twice.
fn assert_two_crossings(
    stage: &Stage,
    to_world: impl Fn(DVec3) -> DVec3,
    (vertices, faces): &(Vec<DVec3>, Vec<Vec<usize>>),
) {
    let scene = stage.scene();
    let mut crossings = Crossings::default();
    let mut rng = Rng::new(1, Stream::Measure, 0);
    let mut targets: Vec<_> = vertices.iter().map(|&v| (true, v)).collect();
    for face in faces {
        for i in 0..3 {
            let (a, b) = (vertices[face[i]], vertices[face[(i + 1) % 3]]);
            targets.extend([0.5, 0.1 + 0.8 * rng.next_f64()].map(|s| (false, a + (b - a) * s)));
        }
    }
    let (mut merged, mut rays, mut corners, mut lost) = (0, 0, 0, 0);
    for (is_corner, target) in targets {
        for _ in 0..4 {
            let origin = direction(&mut rng) * 2.0;
            // Not near the outline, where a ray may miss; both sides of the ball, so that rays end on edges as well.
            if (origin - target).normalize().dot(target.normalize()).abs() < 0.2 {
                continue;
            }
            for (from, want) in [(origin, 2), (DVec3::ZERO, 1)] {
                let (from, to) = (to_world(from), to_world(target));
                let ray = to_render(scene, from, (to - from).normalize());
                scene.intersect_all(&ray, &mut crossings);
                let found = crossings.hits().len();
                merged += crossings.merged();
                rays += 1;
                if is_corner {
                    // Embree's robust test loses a few rays at corners (`robust_rays`), however they are traced.
                    corners += 1;
                    lost += u32::from(found < want);
                    assert!(found <= want, "{from} to {target}: {:?}", crossings.hits());
                } else {
                    assert_eq!(found, want, "{from} to {target}: {:?}", crossings.hits());
                }
            }
        }
    }
    println!("{rays} rays, {merged} hits merged; {lost} of {corners} lost at corners");
    assert!(merged > rays / 8, "these rays do pass through edges: {merged} of {rays}");
    assert!(lost * 50 < corners);
}

#[test]
fn closed_meshes_are_entered_and_left() {
    let ball = ball(16, 32);
    let stage = Stage::new(&format!("{CAMERA}{}", mesh("ball", &ball.0, &ball.1)), (8, 8));
    assert_two_crossings(&stage, |p| p, &ball);
}

#[test]
fn far_and_small_closed_meshes_too() {
    for (scale, offset) in [(1e-3, DVec3::new(10.0, 20.0, -5.0)), (1e3, DVec3::ZERO)] {
        let (vertices, faces) = ball(12, 20);
        let moved: Vec<DVec3> = vertices.iter().map(|&v| v * scale + offset).collect();
        let far = [DVec3::new(-30.0, 0.0, 0.0), DVec3::new(-30.0, 1.0, 0.0), DVec3::new(-30.0, 0.0, 1.0)];
        let text = format!("{CAMERA}{}{}", mesh("ball", &moved, &faces), mesh("far", &far, &[vec![0, 1, 2]]));
        let stage = Stage::new(&text, (8, 8));
        // As stored: the corners of so small a mesh are rounded to the place where it stands.
        let Geometry::Mesh(stored) = &stage.scene().surfaces()[0].geometry else { panic!("a mesh") };
        assert_eq!(stored.buffers.triangles().len(), faces.len());
        let mut crossings = Crossings::default();
        let mut rng = Rng::new(2, Stream::Measure, 0);
        for i in 0..stored.buffers.triangles().len() as u32 {
            let corners = stored.buffers.corners(i).map(Vec3::from_array);
            for target in [corners[0] * 0.3 + corners[1] * 0.7, (corners[0] + corners[1]) * 0.5] {
                let center = stage.scene().space().position(offset).as_vec3();
                let origin = center
                    + direction(&mut rng).as_vec3() * (2.0 * stage.scene().space().length(scale)) as f32;
                let (to, out) = ((target - origin).normalize(), (target - center).normalize());
                if to.dot(out).abs() < 0.3 {
                    continue;
                }
                stage.scene().intersect_all(&Ray::new(origin, to), &mut crossings);
                assert_eq!(crossings.hits().len(), 2, "scale {scale}, {:?}", crossings.hits());
            }
        }
    }
}

#[test]
fn instances_report_their_crossings() {
    let ball = ball(10, 16);
    let text = format!(
        "{CAMERA}{}group = \"g\"\n\
         [[shapes]]\nname = \"inner\"\ntype = \"sphere\"\nradius = 0.25\nmaterial = \"grey\"\ngroup = \"g\"\n\
         [[instances]]\ngroup = \"g\"\ntransform = [{{ rotate = 40, axis = [1, 2, 3] }}, {{ translate = [3, 1, 0] }}]\n\
         [[instances]]\ngroup = \"g\"\ntransform = [{{ translate = [-3, 1, 0] }}]\n",
        mesh("ball", &ball.0, &ball.1)
    );
    let stage = Stage::new(&text, (8, 8));
    let scene = stage.scene();
    assert!(scene.nodes().len() >= 2, "instances: {:?}", scene.nodes().len());
    let mut crossings = Crossings::default();
    // Through both: in, in, out, out, twice.
    let ray = to_render(scene, DVec3::new(-9.0, 1.013, 0.017), DVec3::X);
    scene.intersect_all(&ray, &mut crossings);
    let places: Vec<f64> =
        crossings.hits().iter().map(|hit| scene.space().metres(f64::from(hit.t)) - 9.0).collect();
    println!("{places:.3?}");
    assert_eq!(places.len(), 8);
    for (place, want) in places.iter().zip([-4.0, -3.25, -2.75, -2.0, 2.0, 2.75, 3.25, 4.0]) {
        assert!((place - want).abs() < 0.06, "{place} {want}");
    }
    assert!(crossings.hits().iter().all(|hit| hit.instance.is_some()));
}

#[test]
fn hundreds_of_crossings_and_more_than_are_kept() {
    let sheets = 300;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for i in 0..sheets {
        let z = -f64::from(i) * 0.01;
        let first = vertices.len();
        vertices
            .extend([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z)));
        faces.push(vec![first, first + 1, first + 2, first + 3]);
    }
    // Two sheets in one place are two crossings; and a ball in the middle of the sheets.
    let text = format!(
        "{CAMERA}{}{}[[shapes]]\ntype = \"sphere\"\nradius = 0.5\ncenter = [0, 0, -1.5]\nmaterial = \"grey\"\n",
        mesh("sheets", &vertices, &faces),
        mesh("one more", &vertices[..4], &faces[..1])
    );
    let stage = Stage::new(&text, (8, 8));
    let scene = stage.scene();
    let mut crossings = Crossings::default();
    // Off the diagonal of the sheets, and on it, where both triangles are met.
    for (x, y) in [(0.3, 0.1), (0.125, 0.125), (0.0, 0.0)] {
        let ray = to_render(scene, DVec3::new(x, y, 2.0), DVec3::NEG_Z);
        scene.intersect_all(&ray, &mut crossings);
        assert_eq!(crossings.hits().len(), sheets as usize + 3, "at {x} {y}");
        assert_eq!(crossings.dropped(), 0);
    }
    let ray = to_render(scene, DVec3::new(0.3, 0.1, 2.0), DVec3::NEG_Z);
    scene.intersect_all(&ray, &mut crossings);
    let all = crossings.hits().to_vec();
    for limit in [1, 7, 64, 301] {
        let mut few = Crossings::with_limit(limit);
        for _ in 0..2 {
            scene.intersect_all(&ray, &mut few);
            assert_eq!(few.hits(), &all[..limit], "the nearest are kept");
            assert_eq!(few.dropped(), (all.len() - limit) as u64);
        }
    }
    // Nothing behind, nothing along NaN, and nothing left over from before.
    for ray in [
        Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::Z),
        Ray::new(Vec3::NAN, Vec3::Z),
        Ray { t_max: 0.01, ..Ray::new(Vec3::new(0.0, 0.0, 5.0), Vec3::NEG_Z) },
    ] {
        scene.intersect_all(&ray, &mut crossings);
        assert!(crossings.hits().is_empty() && crossings.dropped() == 0);
    }
}
