//! Closed bodies: no ray that starts inside gets out, and no light gets in.

use crate::support::*;
use cardioid::math::Ray;
use cardioid::render::{Overrides, Quality};
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::scene::SurfaceInteraction;
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// A closed mesh without dents, faces counter-clockwise from outside.
struct Body {
    name: String,
    vertices: Vec<DVec3>,
    faces: Vec<[usize; 3]>,
}

/// A prism along z whose first edge, through zero, has this angle between its faces.
fn wedge(degrees: f64) -> Body {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let base = [DVec3::ZERO, DVec3::X, DVec3::new(cos, sin, 0.0)];
    let vertices = [-1.0, 1.0].iter().flat_map(|&z| base.map(|p| p + DVec3::Z * z)).collect();
    let faces = vec![[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]];
    Body { name: format!("wedge of {degrees} degrees"), vertices, faces }
}

/// A tetrahedron as flat as `height` makes it.
fn tetrahedron(height: f64) -> Body {
    let corners = [(-1.0, 0.0, -1.0), (1.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, height, 0.0)];
    let vertices = corners.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect();
    let faces = vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
    Body { name: format!("tetrahedron of height {height}"), vertices, faces }
}

/// A box of this height.
fn slab(height: f64) -> Body {
    let vertices = (0..8)
        .map(|i| DVec3::new(f64::from(i & 1), height * f64::from(i >> 1 & 1), f64::from(i >> 2)))
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Body { name: format!("box of height {height}"), vertices, faces }
}

/// Of wedges, degrees.
const ANGLES: [f64; 11] = [0.5, 1.0, 2.0, 5.0, 15.0, 30.0, 45.0, 60.0, 89.0, 120.0, 170.0];

fn bodies() -> Vec<Body> {
    let heights = [0.01, 0.1, 1.0, 10.0];
    let wedges = ANGLES.iter().map(|&angle| wedge(angle));
    wedges.chain(heights.iter().map(|&h| tetrahedron(h))).chain([slab(0.05), slab(1.0)]).collect()
}

fn random(index: u64) -> Rng {
    Rng::new(31, Stream::Measure, index)
}

/// A point between the corners of a simplex, or of any body without dents.
fn between(corners: &[DVec3], rng: &mut Rng) -> DVec3 {
    let weights: Vec<f64> = corners.iter().map(|_| -(1.0 - rng.next_f64()).ln()).collect();
    let total: f64 = weights.iter().sum();
    corners.iter().zip(&weights).map(|(&corner, weight)| corner * (weight / total)).sum()
}

/// What became of rays that met a body from inside next to its edges.
#[derive(Debug, Default)]
struct Leaks {
    /// Rays that went on from there.
    rays: u32,
    /// Of them, those that did not meet the body from inside again.
    left: u32,
    /// As many as would not if they started at the place of the hit.
    without: u32,
}

impl Leaks {
    /// Two rays from where this one arrives, one after the other.
    fn follow(&mut self, stage: &Stage, mut ray: Ray, rng: &mut Rng) {
        let scene = stage.scene();
        let inside = |ray: &Ray| {
            let hit = scene.intersect(ray)?;
            (!hit.is_front() && scene.surface(&hit).name == "body").then_some(hit)
        };
        // What is beyond the edge by rounding, or seen along its plane, is another matter.
        let Some(mut hit) = inside(&ray) else { return };
        for _ in 0..2 {
            let out: Vec3 = warp::square_to_sphere(rng.next_2d());
            let out = if out.dot(hit.facing_normal()) < 0.0 { -out } else { out };
            self.rays += 1;
            let at_once = SurfaceInteraction { retreat: Vec3::ZERO, ..hit };
            self.without += u32::from(inside(&at_once.spawn(out)).is_none());
            ray = hit.spawn(out);
            let Some(next) = inside(&ray) else {
                self.left += 1;
                return;
            };
            hit = next;
        }
    }

    /// Rays all of which are aimed at edges get out only where they also came along the other surface within rounding, or at a
    /// corner: of rays aimed anywhere one in a million comes as near to an edge.
    fn check(&self) {
        println!("{self:?}");
        assert!(self.without > 100 * self.left && 5000 * self.left <= self.rays, "{self:?}");
    }
}

/// Rays that arrive as close to edges as rounding and no rounding can tell, from inside, and go on to anywhere inside: the next
/// thing that they meet is the body, from inside.
#[test]
fn rays_stay_in_closed_bodies_at_their_edges() {
    const RAYS: u32 = 4000;
    let mut all = Leaks::default();
    for (number, body) in bodies().iter().enumerate() {
        // Sharp edges of long faces come first, and hold every ray.
        let wedges_of = ANGLES.get(number).copied();
        for variant in 0..4 {
            let mut rng = random((8 * number + variant) as u64);
            // As it is, turned, far from the origin, and by an instance that is scaled on top.
            let axis = warp::square_to_sphere(rng.next_2d()).as_dvec3();
            let turn = DQuat::from_axis_angle(axis.normalize(), 6.3 * rng.next_f64());
            let to = DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64());
            let place = match variant {
                0 => DAffine3::IDENTITY,
                1 => DAffine3::from_rotation_translation(turn, to),
                2 => DAffine3::from_rotation_translation(turn, to * 40.0),
                _ => DAffine3::from_scale_rotation_translation(DVec3::new(0.3, 2.0, 1.1), turn, to),
            };
            let (at_once, by_instance) =
                if variant == 3 { (DAffine3::IDENTITY, place) } else { (place, DAffine3::IDENTITY) };
            let vertices: String = body
                .vertices
                .iter()
                .map(|&p| format!("{:?},", at_once.transform_point3(p).to_array()))
                .collect();
            let instance = if variant == 3 {
                let [x, y, z] = [place.matrix3.x_axis, place.matrix3.y_axis, place.matrix3.z_axis];
                let row = |i: usize| [x[i], y[i], z[i], place.translation[i]];
                format!(
                    "group = \"g\"\n[[instances]]\ngroup = \"g\"\ntransform = [{{ matrix = [{:?}, {:?}, {:?}] }}]\n",
                    row(0),
                    row(1),
                    row(2)
                )
            } else {
                String::new()
            };
            // Something far away makes coordinates large.
            let text = format!(
                "[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\n[materials.clay]\ntype = \"lambert\"\nreflectance = 0.5\n\
                 [[shapes]]\nname = \"body\"\ntype = \"mesh\"\nvertices = [{vertices}]\nfaces = {:?}\nmaterial = \"clay\"\n{instance}\n\
                 [[shapes]]\ntype = \"quad\"\ncorner = [-9, -9, -9]\nedge-u = [1, 0, 0]\nedge-v = [0, 1, 0]\nmaterial = \
                 \"clay\"\n",
                body.faces
            );
            let stage = Stage::new(&text, (1, 1));
            let scene = stage.scene();
            let place = by_instance * at_once;
            let local = |p: DVec3| scene.space().position(place.transform_point3(p)).as_vec3();
            for _ in 0..RAYS {
                let face = body.faces[(rng.next_f64() * body.faces.len() as f64) as usize];
                let [a, b, c] = face.map(|v| body.vertices[v]);
                // From an edge of a face into it, by 1e-9 to 0.01 of its size.
                let depth = 10f64.powf(-9.0 + 7.0 * rng.next_f64());
                let along = a.lerp(b, rng.next_f64());
                let target = along.lerp(c, depth);
                let from = local(between(&body.vertices, &mut rng));
                let way = local(target) - from;
                let ray = Ray::new(from, way / way.length());
                all.follow(&stage, ray, &mut rng);
            }
            println!("{}, variant {variant}, and all before: {all:?}", body.name);
            if wedges_of.is_some_and(|angle| angle <= 120.0) {
                assert_eq!(all.left, 0, "{}, variant {variant}", body.name);
            }
        }
    }
    all.check();
}

/// The same for closed bodies of round and plane faces, whose edges are circles or straight.
#[test]
fn rays_stay_in_exact_bodies_at_their_edges() {
    const RAYS: u32 = 20_000;
    let ring = |rng: &mut Rng, radius: f64, y: f64| {
        let angle = std::f64::consts::TAU * rng.next_f64();
        DVec3::new(radius * angle.cos(), y, radius * angle.sin())
    };
    let rim_of_lens = (1.75f64.powi(2) - (1.75f64 - 0.15).powi(2)).sqrt();
    type Edge<'a> = &'a dyn Fn(&mut Rng) -> DVec3;
    let lens: Edge<'_> = &|rng| ring(rng, rim_of_lens, 0.0);
    let cone: Edge<'_> = &|rng| ring(rng, 1.0, -0.2);
    let ball: Edge<'_> = &|rng| ring(rng, (0.3f64.powi(2) - 0.05f64.powi(2)).sqrt(), -0.15);
    let bodies: [(&str, &str, Edge<'_>, f64); 3] = [
        (
            "lens",
            "type = \"lens\"\nradius = 1.0\nthickness = 0.3\nfront-radius = 1.75\nback-radius = 1.75",
            lens,
            0.1,
        ),
        ("cone", "type = \"cone\"\nbase = [0, -0.2, 0]\ntop = [0, 0.2, 0]\nradius = 1.0", cone, 0.05),
        (
            "ball cut by a box",
            "type = \"csg\"\noperation = \"intersection\"\noperands = [{ type = \"sphere\", center = [0, -0.1, 0], radius = 0.3 \
             }, { type = \"box\", min = [-1, -0.15, -1], max = [1, 1, 1] }]",
            ball,
            0.1,
        ),
    ];
    let mut all = Leaks::default();
    for (number, (name, shape, edge, room)) in bodies.into_iter().enumerate() {
        let mut rng = random(100 + number as u64);
        let text = format!(
            "[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\n[materials.clay]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\nname = \"body\"\n\
             {shape}\nmaterial = \"clay\"\ntransform = [{{ rotate = 33.0, axis = [1, 0.2, -0.6] }}, {{ translate = [0.3, 0.7, -0.2] \
             }}]\n"
        );
        let stage = Stage::new(&text, (1, 1));
        let scene = stage.scene();
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.2, -0.6).normalize(), 33f64.to_radians());
        let place = DAffine3::from_rotation_translation(turn, DVec3::new(0.3, 0.7, -0.2));
        let local = |p: DVec3| scene.space().position(place.transform_point3(p)).as_vec3();
        for _ in 0..RAYS {
            let inside = warp::square_to_sphere(rng.next_2d()).as_dvec3() * (room * rng.next_f64());
            let at_edge = edge(&mut rng);
            // As close to the edge as rounding and no rounding can tell.
            let beside = warp::square_to_sphere(rng.next_2d()).as_dvec3();
            let target = at_edge * (1.0 - 10f64.powf(-9.0 + 7.0 * rng.next_f64()))
                + beside * 10f64.powf(-10.0 + 5.0 * rng.next_f64());
            let from = local(inside);
            let way = local(target) - from;
            let ray = Ray::new(from, way / way.length());
            all.follow(&stage, ray, &mut rng);
        }
        println!("{name}: {all:?}");
    }
    all.check();
}

/// A lit floor under a lamp, and a camera.
const OUTSIDE: &str = r#"
    [materials.paint]
    type = "lambert"
    reflectance = [0.7, 0.6, 0.5]

    [[shapes]]
    type = "quad"
    corner = [-3, 0, 3]
    edge-u = [6, 0, 0]
    edge-v = [0, 0, -6]
    material = "paint"

    [[shapes]]
    type = "quad"
    corner = [-0.5, 3, -0.5]
    edge-u = [1, 0, 0]
    edge-v = [0, 0, 1]
    emission = { radiance = 20.0 }
"#;

/// Bodies with nothing open, and cameras inside.
const SHUT: [(&str, &str, &str); 4] = [
    (
        "tetrahedron",
        "eye = [0, 0.7, 0]\nat = [0, 0.5, -1]",
        "type = \"mesh\"\nvertices = [[-1, 0.1, -1], [1, 0.1, -1], [0, 0.1, 1], [0, 2, 0]]\nfaces = [[0, 1, 2], [0, 3, 1], \
         [1, 3, 2], [2, 3, 0]]",
    ),
    (
        "box 5 cm high",
        "eye = [0.3, 0.325, 0.2]\nat = [0.9, 0.325, 0.1]",
        "type = \"box\"\nmin = [0, 0.3, 0]\nmax = [1, 0.35, 1]",
    ),
    (
        "cupboard with walls of 5 cm",
        "eye = [0.5, 0.6, 0.3]\nat = [0.8, 0.2, 0.9]",
        "type = \"csg\"\noperation = \"union\"\noperands = [{ type = \"csg\", operation = \"difference\", operands = [{ type = \
         \"box\", min = [0, 0.1, 0], max = [1, 1.1, 1] }, { type = \"box\", min = [0.05, 0.15, -0.5], max = [0.95, 1.05, 0.95] }] \
         }, { type = \"box\", min = [0, 0.1, -0.02], max = [1, 1.1, 0.03] }]",
    ),
    (
        "lens with a sharp rim",
        "eye = [0.1, 0.5, 0.05]\nat = [0.9, 0.5, 0.1]",
        "type = \"lens\"\ncenter = [0, 0.5, 0]\nradius = 1.0\nthickness = 0.3\nfront-radius = 1.75\nback-radius = 1.75",
    ),
];

#[test]
fn closed_bodies_are_black_inside() {
    let presets = [Quality::Draft, Quality::Preview, Quality::Final];
    // Photons of the finer presets lie closer, which leaks less.
    let by_maps = presets.map(|quality| Overrides {
        quality: Some(quality),
        global_photons: Some(100_000),
        caustic_photons: Some(100_000),
        ..Overrides::default()
    });
    for (name, camera, shape) in SHUT {
        let text =
            format!("[camera]\n{camera}\nfov = 90.0\n{OUTSIDE}\n[[shapes]]\n{shape}\nmaterial = \"paint\"\n");
        let stage = Stage::new(&text, (16, 16));
        let paths = Overrides { spp: Some(1024), ..path() };
        // Without photons near, maps are read however few they are: the rim of the lens is a matter of paths.
        let maps = if name.contains("lens") { &[][..] } else { &by_maps[..] };
        for settings in maps.iter().chain([&paths]) {
            let shot = stage.shoot(settings);
            let most = shot.layer("beauty").iter().copied().fold(0.0, f32::max);
            assert_eq!(most, 0.0, "{name}: {:?} {:?}", settings.quality, settings.integrator);
        }
    }
}
