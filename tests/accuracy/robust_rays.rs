//! Rays that start on surfaces: never hit the surface they leave, never miss the next one, at any size and place.

use crate::support::*;
use cardioid::math::Ray;
use cardioid::render::Overrides;
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::scene::SurfaceInteraction;
use glam::{DVec3, Vec3};
use std::fmt::Write as _;
use std::io::Write as _;

fn random(index: u64) -> Rng {
    Rng::new(17, Stream::Measure, index)
}

/// A point of the cube `[-1, 1]^3`.
fn point(rng: &mut Rng) -> DVec3 {
    2.0 * DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) - 1.0
}

fn direction(rng: &mut Rng) -> Vec3 {
    warp::square_to_sphere(rng.next_2d())
}

/// `10^x` with `x` uniform.
fn magnitude(rng: &mut Rng, low: f64, high: f64) -> f64 {
    10f64.powf(low + (high - low) * rng.next_f64())
}

const HEADER: &str = r#"
    [camera]
    eye = [0, 0, 5]
    at = [0, 0, 0]

    [materials.clay]
    type = "lambert"
    reflectance = 0.5
"#;

/// Triangles of all sizes and proportions around random places, as the rows of a mesh.
fn triangles(count: usize, rng: &mut Rng) -> (String, String) {
    let (mut vertices, mut faces) = (String::new(), String::new());
    for i in 0..count {
        let place = point(rng);
        let size = magnitude(rng, -6.0, 0.0);
        // Some are slivers, some lie in a plane of the axes.
        let thin = if i % 3 == 0 { magnitude(rng, -5.0, 0.0) } else { 1.0 };
        let flat = if i % 5 == 0 { DVec3::new(1.0, 0.0, 1.0) } else { DVec3::ONE };
        let (u, v) = (point(rng) * flat * size, point(rng) * flat * size * thin);
        for corner in [place, place + u, place + 0.5 * u + v] {
            write!(vertices, "{:?},", corner.to_array()).unwrap();
        }
        write!(faces, "[{},{},{}],", 3 * i, 3 * i + 1, 3 * i + 2).unwrap();
    }
    (vertices, faces)
}

/// Sends rays at the scene and from what they hit, and calls `check` with the hit and a ray that leaves it.
fn leave_surfaces(
    stage: &Stage,
    targets: &[DVec3],
    rng: &mut Rng,
    mut check: impl FnMut(&SurfaceInteraction, Ray),
) -> u32 {
    let scene = stage.scene();
    let mut hits = 0;
    for target in targets {
        let target = scene.space().position(*target).as_vec3();
        // From far, from near, aslant.
        let back = direction(rng);
        let start = target + back * magnitude(rng, -4.0, 0.5) as f32;
        let Some(hit) = scene.intersect(&Ray::new(start, -back)) else { continue };
        hits += 1;
        for i in 0..12 {
            let mut leaving = direction(rng);
            if i % 3 == 0 {
                // Grazing: nearly in the surface.
                let normal = hit.point.normal;
                leaving = (leaving - normal * (leaving.dot(normal) * (1.0 - 1e-3))).normalize_or_zero();
            }
            check(&hit, hit.spawn(leaving));
        }
    }
    hits
}

#[test]
fn triangles_are_not_hit_by_rays_that_leave_them() {
    let mut rng = random(0);
    let mut left = 0;
    for instanced in [false, true] {
        for number in 0..20 {
            let count = 400;
            let (vertices, faces) = triangles(count, &mut rng);
            let placing = if instanced {
                let scale = [
                    magnitude(&mut rng, -2.0, 2.0),
                    magnitude(&mut rng, -2.0, 2.0),
                    -magnitude(&mut rng, -2.0, 2.0),
                ];
                let turn = 360.0 * rng.next_f64();
                let to = point(&mut rng) * magnitude(&mut rng, -2.0, 4.0);
                format!(
                    "group = \"g\"\n[[instances]]\ngroup = \"g\"\ntransform = [{{ scale = {scale:?} }}, \
                     {{ rotate = {turn:?}, axis = [1.0, 0.3, -0.5] }}, {{ translate = {:?} }}]\n\
                     [[shapes]]\ntype = \"sphere\"\nradius = 1e-3\ncenter = {:?}\nmaterial = \"clay\"\n",
                    to.to_array(),
                    (-to).to_array()
                )
            } else {
                String::new()
            };
            let text = format!(
                "{HEADER}[[shapes]]\ntype = \"mesh\"\nvertices = [{vertices}]\nfaces = [{faces}]\n\
                 material = \"clay\"\n{placing}"
            );
            let stage = Stage::new(&text, (1, 1));
            let scene = stage.scene();
            // Points of the triangles, in the world.
            let mut targets: Vec<DVec3> = (0..count).map(|_| point(&mut rng)).collect();
            for _ in 0..2 * count {
                targets.push(scene.space().center + point(&mut rng) / scene.space().scale * 0.6);
            }
            let mut checked = 0;
            leave_surfaces(&stage, &targets, &mut rng, |hit, ray| {
                checked += 1;
                if let Some(next) = scene.intersect(&ray) {
                    let same = (next.surface, next.primitive) == (hit.surface, hit.primitive);
                    assert!(
                        !same,
                        "scene {number}, instanced {instanced}: {hit:?} hit again at {}",
                        next.distance
                    );
                }
            });
            left += checked;
        }
    }
    println!("{left} rays left triangles");
    assert!(left > 20_000, "only {left} rays");
}

#[test]
fn round_shapes_are_hit_again_only_on_the_other_side() {
    let mut rng = random(1);
    let mut left = 0;
    for kind in ["sphere", "cylinder", "disc"] {
        for number in 0..300 {
            let (place, size) = (point(&mut rng), magnitude(&mut rng, -6.0, 0.0));
            let axis = direction(&mut rng).as_dvec3();
            let shape = match kind {
                "sphere" => format!("center = {:?}\nradius = {size:?}", place.to_array()),
                "disc" => format!(
                    "center = {:?}\nradius = {size:?}\nnormal = {:?}",
                    place.to_array(),
                    axis.to_array()
                ),
                _ => format!(
                    "base = {:?}\ntop = {:?}\nradius = {size:?}",
                    place.to_array(),
                    (place + axis * size * magnitude(&mut rng, -2.0, 2.0)).to_array()
                ),
            };
            // Two far specks make the scene about 2 units wide however small the shape is.
            let specks: String = [DVec3::ONE, DVec3::NEG_ONE]
                .iter()
                .map(|p| {
                    format!(
                        "[[shapes]]\ntype = \"sphere\"\ncenter = {:?}\nradius = 1e-7\nmaterial = \"clay\"\n",
                        p.to_array()
                    )
                })
                .collect();
            let text =
                format!("{HEADER}[[shapes]]\ntype = \"{kind}\"\n{shape}\nmaterial = \"clay\"\n{specks}");
            let stage = Stage::new(&text, (1, 1));
            let scene = stage.scene();
            let targets: Vec<DVec3> =
                (0..10).map(|_| place + direction(&mut rng).as_dvec3() * size * rng.next_f64()).collect();
            let radius = scene.space().length(size) as f32;
            leave_surfaces(&stage, &targets, &mut rng, |hit, ray| {
                left += 1;
                let Some(next) = scene.intersect(&ray).filter(|next| next.surface == hit.surface) else {
                    return;
                };
                assert!(kind != "disc", "{number}: a disc is hit again, {hit:?}");
                let inwards = -ray.direction.dot(hit.point.normal);
                assert!(inwards > 0.0, "{kind} {number}: left outwards and hit again, {hit:?}");
                // Chord of a sphere; of a cylinder at least that across.
                let chord = 2.0 * radius * inwards;
                let slack = 4.0 * hit.point.offset / inwards.max(1e-4);
                assert!(
                    next.distance > 0.9 * chord - slack,
                    "{kind} {number}: a chord of {chord} ended at {}, slack {slack}, {hit:?}",
                    next.distance
                );
            });
        }
    }
    println!("{left} rays left round shapes");
    assert!(left > 20_000, "only {left} rays");
}

/// Spheres that are 4e-5 apart: a ray through both meets all four surfaces in their order.
#[test]
fn a_thin_gap_is_not_skipped() {
    for (scale, gap) in [(1.0, 4e-5), (1e-6, 4e-5), (1e6, 4e-5), (1.0, 1e-6)] {
        let text = format!(
            "[camera]\neye = [0, 0, {}]\nat = [0, 0, 0]\n[materials.glass]\ntype = \"dielectric\"\nior = 1\n\
             [[shapes]]\ntype = \"sphere\"\nradius = {:?}\nmaterial = \"glass\"\n\
             [[shapes]]\ntype = \"sphere\"\nradius = {:?}\nmaterial = \"glass\"\n",
            5.0 * scale,
            scale * (1.0 + gap),
            scale
        );
        let stage = Stage::new(&text, (1, 1));
        let scene = stage.scene();
        let unit = scene.space().length(scale) as f32;
        let mut rng = random(2);
        for _ in 0..2000 {
            let back = direction(&mut rng);
            let aside = direction(&mut rng).cross(back).normalize_or_zero() * (0.99 * rng.next_f32());
            let mut ray = Ray::new((back * 3.0 + aside) * unit, -back);
            let mut met = Vec::new();
            while let Some(hit) = scene.intersect(&ray) {
                met.push(hit.surface);
                assert!(met.len() <= 4, "more than four surfaces: {met:?}");
                ray = hit.spawn(ray.direction);
            }
            assert_eq!(met, [0, 1, 1, 0], "scale {scale}, gap {gap}");
        }
    }
}

/// Large walls in the planes of the axes through the origin, where a coordinate is zero and so is its roundoff; met by rays that come
/// a way that is short against the walls.
#[test]
fn walls_through_the_origin_are_met_once() {
    let mut shapes = String::new();
    for (u, v) in [(0, 1), (1, 2), (2, 0)] {
        let side = |axis: usize| DVec3::AXES[axis] * 2.0;
        let corner = -(side(u) + side(v)) / 2.0;
        write!(
            shapes,
            "[[shapes]]\ntype = \"quad\"\ncorner = {:?}\nedge-u = {:?}\nedge-v = {:?}\nmaterial = \"clay\"\n",
            corner.to_array(),
            side(u).to_array(),
            side(v).to_array()
        )
        .unwrap();
    }
    let stage = Stage::new(&format!("{HEADER}{shapes}"), (1, 1));
    let scene = stage.scene();
    assert_eq!(scene.space().position(DVec3::ZERO), DVec3::ZERO);
    let mut rng = random(6);
    let mut left = 0;
    for i in 0..20_000 {
        let on_wall = point(&mut rng) * (DVec3::ONE - DVec3::AXES[i % 3]);
        let target = scene.space().position(on_wall).as_vec3();
        let back = direction(&mut rng);
        let start = target + back * magnitude(&mut rng, -6.0, -1.5) as f32;
        let Some(hit) = scene.intersect(&Ray::new(start, -back)) else { continue };
        for _ in 0..4 {
            left += 1;
            let next = scene.intersect(&hit.spawn(direction(&mut rng)));
            assert!(next.is_none_or(|next| next.surface != hit.surface), "{hit:?} is hit again: {next:?}");
        }
    }
    println!("{left} rays left walls");
    assert!(left > 50_000, "only {left} rays");
}

/// A jewel of 1 mm on a plane of 1 km: its shadow touches it, and the plane has no shadow of its own.
#[test]
fn a_jewel_on_a_wide_plane() {
    const R: f64 = 1e-3;
    for (x, z, edge) in [(0.0, 0.0, 0.01), (311.0, -207.0, 0.1)] {
        let text = format!(
            "{HEADER}[[shapes]]\ntype = \"quad\"\ncorner = [-500, 0, -500]\nedge-u = [0, 0, 1000]\nedge-v = [1000, 0, 0]\n\
             material = \"clay\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [{x:?}, {R:?}, {z:?}]\nradius = {R:?}\n\
             material = \"clay\"\n"
        );
        let stage = Stage::new(&text, (1, 1));
        let scene = stage.scene();
        let center = DVec3::new(x, R, z);
        let to_sun = DVec3::new(0.6, 0.8, 0.0);
        let mut rng = random(3);
        let (mut dark, mut lit) = (0, 0);
        for i in 0..20_000 {
            // Near the jewel, or anywhere.
            let reach = if i % 4 == 0 { 400.0 } else { 4.0 * R };
            let on_floor =
                DVec3::new(center.x, 0.0, center.z) + point(&mut rng) * reach * DVec3::new(1.0, 0.0, 1.0);
            // From an eye that sees the floor, not the jewel on it.
            let eye = scene.space().position(on_floor + DVec3::new(-0.3, 1.0, 0.2) * reach).as_vec3();
            let target = scene.space().position(on_floor).as_vec3();
            let Some(hit) = scene.intersect(&Ray::new(eye, (target - eye).normalize_or_zero())) else {
                continue;
            };
            if hit.surface != 0 {
                continue;
            }
            let place = hit.point.position.as_dvec3() / scene.space().scale + scene.space().center;
            // Distance of the jewel's centre from the way to the sun, in radii.
            let miss = (center - place).reject_from_normalized(to_sun).length() / R;
            let ahead = (center - place).dot(to_sun) > 0.0;
            let is_dark = scene.occluded(&hit.spawn(to_sun.as_vec3()));
            if ahead && miss < 1.0 - edge {
                assert!(is_dark, "light at {place}, {miss} radii from the way to the sun");
                dark += 1;
            } else if miss > 1.0 + edge {
                assert!(!is_dark, "shadow at {place}, {miss} radii from the way to the sun");
                lit += 1;
            }
        }
        println!("{dark} in the shadow, {lit} in the sun");
        assert!(dark > 300 && lit > 5000, "{dark} in the shadow, {lit} in the sun");
    }
}

/// A sphere of triangles far from the origin of the world, and a grid: rays at edges and corners find no way through.
#[test]
fn closed_meshes_are_watertight() {
    let (rings, sectors) = (60, 120);
    let center = DVec3::new(148_376.0, 1234.0, -223_423.0);
    let mut vertices = vec![center + DVec3::Y, center - DVec3::Y];
    for ring in 1..rings {
        let theta = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
        for sector in 0..sectors {
            let phi = std::f64::consts::TAU * f64::from(sector) / f64::from(sectors);
            vertices.push(center + DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()));
        }
    }
    let at = |ring: i32, sector: i32| match ring {
        0 => 0,
        r if r == rings => 1,
        _ => 2 + (ring - 1) * sectors + sector % sectors,
    };
    let mut faces = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b, c, d] =
                [at(ring, sector), at(ring, sector + 1), at(ring + 1, sector), at(ring + 1, sector + 1)];
            if ring > 0 {
                faces.push([a, b, c]);
            }
            if ring + 1 < rings {
                faces.push([b, d, c]);
            }
        }
    }
    let rows: String = vertices.iter().map(|v| format!("{:?},", v.to_array())).collect();
    let text = format!(
        "{HEADER}[[shapes]]\ntype = \"mesh\"\nvertices = [{rows}]\nfaces = {faces:?}\nmaterial = \"clay\"\n"
    );
    let stage = Stage::new(&text, (1, 1));
    let scene = stage.scene();
    let local = |p: DVec3| scene.space().position(p).as_vec3();
    let mut rng = random(4);
    let (mut at_edges, mut at_corners) = (0, 0);
    for face in &faces {
        let corners = face.map(|v| vertices[v as usize]);
        let mut escapes = |target: DVec3| {
            let origin = local(center + point(&mut rng) * 0.4);
            let way = local(target) - origin;
            let ray = Ray::new(origin, way / way.length());
            u32::from(scene.intersect(&ray).is_none()) + u32::from(!scene.occluded(&ray))
        };
        for (a, b, u) in [(0, 1, 0.3), (1, 2, 0.5), (2, 0, 0.9)] {
            at_edges += escapes(corners[a].lerp(corners[b], u));
        }
        at_corners += escapes(corners[0]);
    }
    // Edges are tight. Of rays that are aimed exactly at a corner, where six triangles meet and each decides by its own
    // rounding, Embree loses one in 200; one at random passes as close as that with a probability of 1e-10 or so.
    println!(
        "{at_edges} of {} rays escaped at edges, {at_corners} of {} at corners",
        6 * faces.len(),
        2 * faces.len()
    );
    assert_eq!(at_edges, 0);
    assert!(at_corners as usize <= 2 * faces.len() / 50, "{at_corners}");
    for _ in 0..200_000 {
        let ray = Ray::new(local(center + point(&mut rng) * 0.4), direction(&mut rng));
        assert!(scene.intersect(&ray).is_some(), "{ray:?}");
    }
}

/// Faces that are points, lines, or not numbers leave their neighbours alone, and are told.
#[test]
fn degenerate_and_nan_faces() {
    let mut file = tempfile::Builder::new().suffix(".ply").tempfile().unwrap();
    let vertices = ["0 0 0", "1 0 0", "1 0 1", "0 0 1", "nan 0 0", "inf 1 0", "0.5 0 0.5", "2 0 2", "0 0 0"];
    let faces = ["3 0 2 1", "3 0 3 2", "3 0 1 4", "3 5 1 2", "3 0 6 7", "3 1 1 2", "3 0 8 1", "3 3 3 3"];
    write!(
        file,
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n{}\n{}\n",
        vertices.len(),
        faces.len(),
        vertices.join("\n"),
        faces.join("\n")
    )
    .unwrap();
    let text = format!(
        r#"
        [camera]
        eye = [0.5, 1.0, 0.5]
        at = [0.5, 0.0, 0.5]
        up = [0, 0, 1]
        fov = 40

        [materials.clay]
        type = "lambert"
        reflectance = 0.5

        [[shapes]]
        name = "broken"
        type = "mesh"
        file = {:?}
        normals = "smooth"
        material = "clay"

        [[lights]]
        type = "directional"
        direction = [0, -1, 0]
        irradiance = 3.0
        "#,
        file.path().display().to_string()
    );
    let stage = Stage::new(&text, (24, 24));
    let warnings = stage.built.warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    println!("{warnings}");
    assert!(warnings.contains("broken"), "{warnings}");
    assert!(warnings.contains('2') && warnings.contains('4'), "how many of each kind: {warnings}");
    for settings in [path(), photon_map()] {
        let shot = stage.shoot(&Overrides { spp: Some(4), global_photons: Some(1000), ..settings });
        // The two sound faces fill the picture, without a hole.
        let least = shot.layer("direct").iter().copied().fold(f32::INFINITY, f32::min);
        assert!((f64::from(least) - 1.5 / std::f64::consts::PI).abs() < 1e-5, "{least}");
        assert_eq!(shot.statistics.rejected_samples, 0);
    }
}

/// The short cut that photons take at flat Lambert triangles gives the same bits as the way of all other rays.
#[test]
fn the_short_cut_of_photons_agrees_to_the_bit() {
    let stage = Stage::load("cornell-diffuse", (8, 8));
    let scene = stage.scene();
    let (center, radius) = scene.bounds();
    let mut taken = 0;
    for index in 0..20_000 {
        let mut rng = random(index);
        let ray = Ray::new(center + radius * point(&mut rng).as_vec3(), direction(&mut rng));
        let Some(hit) = scene.embree().intersect(&ray) else { continue };
        let Some(short) = scene.diffuse_hit(&ray, &hit) else { continue };
        let long = scene.interaction(&ray, &hit);
        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
        assert_eq!(bits(short.position()), bits(long.point.position), "{ray:?}");
        assert_eq!(bits(short.facing_normal()), bits(long.facing_normal()), "{ray:?}");
        let out = direction(&mut rng);
        let out = if out.dot(short.facing_normal()) < 0.0 { -out } else { out };
        let (a, b) = (short.spawn(out), long.spawn(out));
        assert_eq!((bits(a.origin), bits(a.direction)), (bits(b.origin), bits(b.direction)), "{ray:?}");
        let cardioid::scene::Material::Lambert { reflectance, .. } = scene.material(&long) else {
            panic!("the short cut took {:?}", scene.material(&long));
        };
        assert_eq!(short.reflectance, *reflectance);
        taken += 1;
    }
    assert!(taken > 5000, "{taken}");
}
