//! Bodies of glass that touch other surfaces, or each other, and bodies within bodies.

use crate::refraction::fresnel;
use crate::support::*;
use cardioid::math::Ray;
use cardioid::media::AIR;
use cardioid::render::Overrides;
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::scene::{Scene, SurfaceInteraction};
use glam::{DAffine3, DQuat, DVec3, Vec3};

const HEADER: &str = r#"
    [camera]
    eye = [0, 3, 5]
    at = [0, 0, 0]

    [materials.paper]
    type = "lambert"
    reflectance = 0.6

    [materials.glass]
    type = "dielectric"
    ior = 1.5

    [media.water]
    ior = 1.33

    [materials.water]
    type = "dielectric"
    inside = "water"
"#;

/// Bodies that stand on y = 0 with a base that contains the disc of radius 0.45, and reach up to y = 1 there.
const STANDING: [&str; 4] = [
    "type = \"box\"\nmin = [-0.6, 0, -0.7]\nmax = [0.7, 1, 0.6]",
    "type = \"mesh\"\nvertices = [[-0.6,0,-0.6],[0.6,0,-0.6],[0.6,1,-0.6],[-0.6,1,-0.6],[-0.6,0,0.6],[0.6,0,0.6],[0.6,1,0.6],\
     [-0.6,1,0.6]]\nfaces = [[0,3,2,1],[4,5,6,7],[0,4,7,3],[1,2,6,5],[0,1,5,4],[3,7,6,2]]",
    "type = \"cone\"\nbase = [0, 0, 0]\ntop = [0, 1, 0]\nradius = 0.7\ntop-radius = 0.6",
    "type = \"csg\"\noperation = \"difference\"\noperands = [{ type = \"box\", min = [-0.8, 0, -0.8], max = [0.8, 1, 0.8] }, { type = \
     \"sphere\", center = [0.8, 1, 0.8], radius = 0.4 }]",
];

/// What they stand on.
const GROUNDS: [&str; 4] = [
    "type = \"quad\"\ncorner = [-3, 0, 3]\nedge-u = [6, 0, 0]\nedge-v = [0, 0, -6]",
    "type = \"disc\"\ncenter = [0.1, 0, 0]\nnormal = [0, 1, 0]\nradius = 2.5",
    "type = \"mesh\"\nvertices = [[-2, 0, -2], [-2, 0, 2], [2.5, 0, 0]]\nfaces = [[0, 1, 2]]",
    "type = \"box\"\nmin = [-2, -0.5, -2]\nmax = [2, 0, 2]",
];

fn random(index: u64) -> Rng {
    Rng::new(21, Stream::Measure, index)
}

/// A place in the world for a scene around the origin, as scene text and as a transform.
fn place(rng: &mut Rng, number: usize) -> (String, DAffine3) {
    if number == 0 {
        return (String::new(), DAffine3::IDENTITY);
    }
    let axis = warp::square_to_sphere(rng.next_2d()).as_dvec3().normalize();
    let (turn, scale) = (360.0 * rng.next_f64(), 10f64.powf(8.0 * rng.next_f64() - 4.0));
    let to = scale * 4.0 * (DVec3::new(rng.next_f64(), rng.next_f64(), rng.next_f64()) - 0.5);
    let text = format!(
        "transform = [{{ scale = {scale:?} }}, {{ rotate = {turn:?}, axis = {:?} }}, {{ translate = {:?} }}]",
        axis.to_array(),
        to.to_array()
    );
    let turned = DQuat::from_axis_angle(axis, turn.to_radians());
    (text, DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turned, to))
}

/// Takes points of the scene around the origin to render space.
struct Placed<'a> {
    scene: &'a Scene,
    to_world: DAffine3,
}

impl Placed<'_> {
    fn at(&self, point: DVec3) -> Vec3 {
        self.scene.space().position(self.to_world.transform_point3(point)).as_vec3()
    }

    /// A ray from one point towards another.
    fn ray(&self, from: DVec3, to: DVec3) -> Ray {
        Ray::new(self.at(from), (self.at(to) - self.at(from)).normalize())
    }

    fn name(&self, hit: &SurfaceInteraction) -> &str {
        &self.scene.surface(hit).name
    }
}

/// A point of the disc around the origin in y = 0 in which all bodies stand.
fn under(rng: &mut Rng) -> DVec3 {
    let d = 0.45 * warp::square_to_disc(rng.next_2d()).as_dvec2();
    DVec3::new(d.x, 0.0, d.y)
}

#[test]
fn what_stands_on_something_is_left_into_nothing() {
    let mut rng = random(0);
    for (kind, body) in STANDING.iter().enumerate() {
        for (ground_kind, ground) in GROUNDS.iter().enumerate() {
            for number in 0..4 {
                let (transform, to_world) = place(&mut rng, number);
                let text = format!(
                    "{HEADER}[[shapes]]\nname = \"ground\"\nmaterial = \"paper\"\n{ground}\n{transform}\n[[shapes]]\nname = \
                     \"body\"\nmaterial = \"glass\"\n{body}\n{transform}\n"
                );
                let stage = Stage::new(&text, (4, 4));
                let placed = Placed { scene: stage.scene(), to_world };
                let inside = placed.scene.medium_at(placed.at(0.5 * DVec3::Y));
                let what = format!("{kind} on {ground_kind}, {transform}");
                assert_ne!(inside.medium(), AIR, "{what}");
                for _ in 0..200 {
                    let above = under(&mut rng) * 0.5 + DVec3::Y * (0.1 + 0.8 * rng.next_f64());
                    let ray = placed.ray(above, under(&mut rng));
                    let mut medium = inside;
                    let (hit, passed) = placed.scene.intersect_within(&ray, &mut medium).unwrap();
                    assert_eq!((placed.name(&hit), medium, passed), ("ground", inside, false), "{what}");
                    // What the ground reflects is in the body, and meets its other side.
                    let local = warp::square_to_cosine_hemisphere(rng.next_2d());
                    let up = cardioid::math::Frame::from_z(hit.facing_normal()).to_world(local);
                    let back = hit.spawn(up);
                    let (next, passed) = placed.scene.intersect_within(&back, &mut medium).unwrap();
                    assert_eq!((placed.name(&next), medium, passed), ("body", inside, false), "{what}");
                    assert!(!next.is_front() && next.distance > 100.0 * hit.point.offset, "{what}");
                    // And a shadow ray from there up to near the top meets nothing.
                    let target = placed.at(above * 0.5 + 0.4 * DVec3::Y);
                    assert!(!placed.scene.occluded(&hit.spawn_to(target)), "{what}");
                    // From below, a ground without thickness is all that there is.
                    if ground_kind < 3 {
                        let ray = placed.ray(above - 2.0 * DVec3::Y, under(&mut rng));
                        let mut medium = cardioid::media::MediumStack::AIR;
                        let (hit, _) = placed.scene.intersect_within(&ray, &mut medium).unwrap();
                        assert_eq!((placed.name(&hit), medium.medium()), ("ground", AIR), "{what}");
                    }
                }
            }
        }
    }
}

/// Pairs of bodies that have the disc of radius 0.45 around the origin in y = 0 in common, the first below.
const PAIRS: [(&str, &str); 3] = [
    (
        "type = \"box\"\nmin = [-0.6, -1, -0.6]\nmax = [0.6, 0, 0.6]",
        "type = \"box\"\nmin = [-0.6, 0, -0.6]\nmax = [0.6, 1, 0.6]",
    ),
    (
        "type = \"box\"\nmin = [-0.6, -1, -0.7]\nmax = [0.7, 0, 0.6]",
        "type = \"mesh\"\nvertices = [[-0.6,0,-0.6],[0.6,0,-0.6],[0.6,1,-0.6],[-0.6,1,-0.6],[-0.6,0,0.6],[0.6,0,0.6],[0.6,1,0.6],\
         [-0.6,1,0.6]]\nfaces = [[0,3,2,1],[4,5,6,7],[0,4,7,3],[1,2,6,5],[0,1,5,4],[3,7,6,2]]",
    ),
    // Round: a ball in the hollow that it just fills.
    (
        "type = \"csg\"\noperation = \"difference\"\noperands = [{ type = \"box\", min = [-0.9, -1, -0.9], max = [0.9, 1.0, 0.9] }, { \
         type = \"sphere\", center = [0, 1, 0], radius = 1.0 }]",
        "type = \"sphere\"\ncenter = [0, 1, 0]\nradius = 1.0",
    ),
];

#[test]
fn bodies_that_share_a_face_have_one_interface_or_none() {
    let mut rng = random(1);
    for (kind, (lower, upper)) in PAIRS.iter().enumerate() {
        for (first, second) in [("glass", "glass"), ("glass", "water"), ("water", "glass")] {
            for number in 0..4 {
                let (transform, to_world) = place(&mut rng, number);
                let text = format!(
                    "{HEADER}[[shapes]]\nname = \"lower\"\nmaterial = \"{first}\"\n{lower}\n{transform}\n[[shapes]]\nname = \
                     \"upper\"\nmaterial = \"{second}\"\n{upper}\n{transform}\n"
                );
                let stage = Stage::new(&text, (4, 4));
                let placed = Placed { scene: stage.scene(), to_world };
                let below = placed.scene.medium_at(placed.at(-0.5 * DVec3::Y));
                let above = placed.scene.medium_at(placed.at(0.5 * DVec3::Y));
                let what = format!("{kind}: {first}, {second}, {transform}");
                assert!(below.medium() != AIR && above.medium() != AIR, "{what}");
                for _ in 0..200 {
                    let across = under(&mut rng);
                    let far = |y: f64| 0.5 * across + y * DVec3::Y;
                    for (from, to, at, beyond) in
                        [(far(-0.5), far(0.5), below, above), (far(0.5), far(-0.5), above, below)]
                    {
                        let ray = placed.ray(from, to);
                        let mut medium = at;
                        let (hit, passed) = placed.scene.intersect_within(&ray, &mut medium).unwrap();
                        assert!(placed.scene.mismatch(&hit, medium).is_none(), "{what}");
                        if first == second {
                            // Through the face as if it were not there, up to the other body's own border.
                            assert!(passed && medium == beyond && !hit.is_front(), "{what}");
                            let shading = placed.scene.shading_within(&hit, medium);
                            let outside =
                                placed.scene.medium_after(medium, &hit, &shading, ray.direction, true);
                            assert_eq!(outside.unwrap().medium(), AIR, "{what}");
                            continue;
                        }
                        assert!(!passed && medium == at, "{what}");
                        let shading = placed.scene.shading_within(&hit, medium);
                        let after = placed.scene.medium_after(medium, &hit, &shading, ray.direction, true);
                        assert_eq!(after, Some(beyond), "{what}");
                        let [here, there] = [at, beyond].map(|at| placed.scene.medium(at.medium()).ior);
                        let cosine = hit.wo.dot(shading.geometric).abs();
                        let want = fresnel(f64::from(there) / f64::from(here), f64::from(cosine)) as f32;
                        let got = shading.bsdf.reflection_probability(shading.wo_local);
                        assert!((got - want).abs() < 1e-4, "{what}: {got}, not {want}");
                    }
                }
            }
        }
    }
}

/// A white floor in a room whose other walls emit 1: radiance is 1 everywhere, seen through whatever absorbs nothing.
fn white_floor(content: &str) -> Stage {
    let wall = |corner: &str, u: &str, v: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {u}\nedge-v = {v}\nmaterial = \"black\"\nemission = {{ \
             radiance = 1.0 }}\n"
        )
    };
    let walls = [
        wall("[-1, 1, -1]", "[2, 0, 0]", "[0, 0, 2]"),
        wall("[-1, -1, -1]", "[0, 2, 0]", "[0, 0, 2]"),
        wall("[1, -1, -1]", "[0, 0, 2]", "[0, 2, 0]"),
        wall("[-1, -1, -1]", "[2, 0, 0]", "[0, 2, 0]"),
        wall("[-1, -1, 1]", "[0, 2, 0]", "[2, 0, 0]"),
    ];
    let text = format!(
        r#"
        [camera]
        eye = [0.5, 0.5, 0.9]
        at = [0.0, -0.8, 0.0]
        fov = 60.0
        [materials.black]
        type = "lambert"
        reflectance = 0.0
        [materials.white]
        type = "lambert"
        reflectance = 1.0
        [materials.glass]
        type = "dielectric"
        ior = 1.5
        [media.water]
        ior = 1.33
        [materials.water]
        type = "dielectric"
        inside = "water"
        [[shapes]]
        type = "quad"
        corner = [-1, -1, 1]
        edge-u = [2, 0, 0]
        edge-v = [0, 0, -2]
        material = "white"
        {}
        {content}
        "#,
        walls.concat()
    );
    Stage::new(&text, (16, 16))
}

#[test]
fn radiance_is_one_under_glass_that_stands_on_the_floor() {
    let cube =
        "[[shapes]]\ntype = \"box\"\nmin = [-0.5, -1, -0.5]\nmax = [0.4, -0.3, 0.4]\nmaterial = \"glass\"\n";
    let tile = |corner: &str, u: &str, v: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {u}\nedge-v = {v}\nmaterial = \"white\"\n"
        )
    };
    let pool = [
        tile("[-0.5, -1, -0.5]", "[0, 0.6, 0]", "[0, 0, 1]"),
        tile("[0.5, -1, -0.5]", "[0, 0, 1]", "[0, 0.6, 0]"),
        tile("[-0.5, -1, -0.5]", "[1, 0, 0]", "[0, 0.6, 0]"),
        tile("[-0.5, -1, 0.5]", "[0, 0.6, 0]", "[1, 0, 0]"),
        "[[shapes]]\ntype = \"box\"\nmin = [-0.5, -1, -0.5]\nmax = [0.5, -0.5, 0.5]\nmaterial = \"water\"\n"
            .to_owned(),
    ]
    .concat();
    let stack = format!(
        "{cube}[[shapes]]\ntype = \"box\"\nmin = [-0.5, -0.3, -0.5]\nmax = [0.4, 0.0, 0.4]\nmaterial = \"water\"\n"
    );
    for (name, content) in [("cube", cube), ("pool", &pool), ("stack", &stack)] {
        let stage = white_floor(content);
        let shot = stage.shoot(&Overrides { spp: Some(64), ..path() });
        assert_close(&format!("{name}, path"), shot.mean("beauty"), grey(1.0), 0.01);
        let maps = Overrides {
            spp: Some(16),
            global_photons: Some(200_000),
            caustic_photons: Some(200_000),
            ..photon_map()
        };
        let shot = stage.shoot(&maps);
        assert_close(&format!("{name}, photon map"), shot.mean("beauty"), grey(1.0), 0.03);
        assert!(!shot.warns("medium"), "{:?}", shot.statistics.warnings);
    }
}

/// Balls of glass within each other, of one material or each of its own.
fn nested(count: usize, one_material: bool) -> Stage {
    let ball = |i: usize| {
        let (name, radius) = (if one_material { 0 } else { i }, 0.9 - 0.8 * i as f64 / count as f64);
        format!("[[shapes]]\ntype = \"sphere\"\nradius = {radius:?}\nmaterial = \"g{name}\"\n")
    };
    let material =
        |i: usize| format!("[materials.g{i}]\ntype = \"dielectric\"\nior = {:?}\n", 1.2 + 0.02 * i as f64);
    let materials: String = (0..if one_material { 1 } else { count }).map(material).collect();
    let balls: String = (0..count).map(ball).collect();
    let text = format!(
        "[camera]\neye = [0, 0, 4]\nat = [0, 0, 0]\nfov = 30\n{materials}{balls}[[lights]]\ntype = \"environment\"\nradiance = 1.0\n"
    );
    Stage::new(&text, (16, 16))
}

#[test]
fn bodies_nest_deeper_than_four() {
    for (count, one_material) in [(8, true), (40, true), (8, false), (16, false)] {
        let stage = nested(count, one_material);
        for (name, overrides, spp) in [("path", path(), 256), ("photon map", photon_map(), 16)] {
            let shot = stage.shoot(&Overrides { spp: Some(spp), ..overrides });
            let error = shot.standard_error("beauty")[0];
            println!("{count} balls by {name}: standard error {error}");
            assert_close(&format!("{count} balls by {name}"), shot.mean("beauty"), grey(1.0), 0.005);
            let counters = &shot.statistics.counters;
            assert_eq!((counters.medium_mismatches, counters.truncated), (0, 0), "{count} balls");
            // Those of one material are one ball.
            let segments = counters.depth_sum as f64 / counters.camera_rays as f64;
            assert!(!one_material || segments < 6.0, "{segments} segments");
        }
    }
}

#[test]
fn more_media_at_one_place_than_are_kept_are_named() {
    let stage = nested(18, false);
    let shot = stage.shoot(&Overrides { spp: Some(4), ..path() });
    assert!(
        shot.warns("overlap at one place") && shot.warns("`inside of g17`"),
        "{:?}",
        shot.statistics.warnings
    );
}

/// A lamp in the plane of a floor, or `above` it, before a wall.
fn lamp_in_floor(lamp: &str, turn: f64, above: f64, lamp_first: bool) -> Stage {
    let place = |above: f64| {
        format!(
            "transform = [{{ translate = [0, {above:?}, 0] }}, {{ rotate = {turn:?}, axis = [1, 0.4, 0.2] }}]"
        )
    };
    let on_floor = place(0.0);
    let lamp =
        format!("[[shapes]]\nname = \"lamp\"\n{lamp}\n{}\nemission = {{ radiance = 5.0 }}\n", place(above));
    let floor = format!(
        "[[shapes]]\nname = \"floor\"\ntype = \"quad\"\ncorner = [-2, 0, 2]\nedge-u = [4, 0, 0]\nedge-v = [0, 0, \
         -4]\nmaterial = \"paper\"\n{on_floor}\n"
    );
    let both = if lamp_first { [lamp, floor] } else { [floor, lamp] }.concat();
    let text = format!(
        "[camera]\neye = [0, 3, 5]\nat = [0, 0.5, 0]\nfov = 50\n[materials.paper]\ntype = \"lambert\"\nreflectance = \
         0.6\n{both}[[shapes]]\ntype = \"quad\"\ncorner = [-2, 0, -2]\nedge-u = [4, 0, 0]\nedge-v = [0, 3, 0]\nmaterial = \
         \"paper\"\n{on_floor}\n"
    );
    Stage::new(&text, (24, 18))
}

/// The lamp shines to its side, whatever is there too and in whichever order; seen from below there is the floor.
#[test]
fn a_lamp_in_the_plane_of_a_floor_shines() {
    let lamps = [
        "type = \"quad\"\ncorner = [-0.7, 0, 0.5]\nedge-u = [1.3, 0, 0]\nedge-v = [0, 0, -1]",
        "type = \"disc\"\ncenter = [0.1, 0, 0]\nradius = 0.6",
        "type = \"mesh\"\nvertices = [[-0.6, 0, 0.6], [0.7, 0, 0.5], [0, 0, -0.8]]\nfaces = [[0, 1, 2]]",
    ];
    for lamp in lamps {
        for turn in [0.0, 7.0] {
            let reference = lamp_in_floor(lamp, turn, 1e-4, true);
            let paths = Overrides { spp: Some(256), ..path() };
            let want = reference.shoot(&paths);
            for lamp_first in [true, false] {
                let stage = lamp_in_floor(lamp, turn, 0.0, lamp_first);
                let maps = Overrides { spp: Some(256), gather_samples: Some(1), ..photon_map() };
                for (mode, settings) in [("path", &paths), ("photon map", &maps)] {
                    let shot = stage.shoot(settings);
                    // What is seen of the lamp has the noise of its outline: 0.3 %.
                    for (part, room) in [("emission", 0.02), ("direct", 0.005), ("indirect", 0.02)] {
                        let what = format!("{part}, {mode}, {lamp}, turned {turn}, lamp first: {lamp_first}");
                        assert_close(&what, shot.mean(part), want.mean(part), room);
                    }
                }
                // From below, where the lamp does not shine, the floor is met.
                let up = Ray::new(Vec3::new(0.03, -0.6, 0.04), Vec3::Y);
                let up =
                    Ray { origin: up.origin + stage.scene().space().position(DVec3::ZERO).as_vec3(), ..up };
                let met = stage.scene().intersect(&up).unwrap();
                assert_eq!(stage.scene().surface(&met).name, "floor", "{lamp}, turned {turn}");
            }
        }
    }
}
