//! Emitters of every shape and size, near and far, against closed forms, by shadow rays and by photons; and photons where
//! objects are small and far, where nothing can be stored, and where lights are thousands.

use crate::support::*;
use cardioid::photons::{PhotonClass, TraceSettings, TracedPhotons, trace_photons};
use cardioid::render::{MapKind, Overrides, ProbeEstimator, ProbePoint, ProbeRequest, Silent, probe};
use cardioid::scene::Scene;
use glam::DVec3;
use std::f64::consts::PI;
use std::fmt::Write;
use std::time::Instant;

/// A kind of emitter: its name, its text for a size in metres around a place, and the intensity that it sends in a direction
/// over its radiance times its squared size.
struct Kind {
    name: &'static str,
    text: fn(f64, DVec3) -> String,
    intensity: fn(DVec3) -> f64,
    /// Part of the light samples that send nothing, so that noise is more.
    wasteful: bool,
}

fn list(v: DVec3) -> String {
    format!("[{:e}, {:e}, {:e}]", v.x, v.y, v.z)
}

const KINDS: [Kind; 6] = [
    Kind {
        name: "quad",
        text: |s, at| {
            let corner = at - DVec3::new(0.5, 0.0, 0.5) * s;
            format!(
                "type = \"quad\"\ncorner = {}\nedge-u = [{s:e}, 0, 0]\nedge-v = [0, 0, {s:e}]",
                list(corner)
            )
        },
        intensity: |d| d.y.abs(),
        wasteful: false,
    },
    Kind {
        name: "disc",
        text: |s, at| {
            format!("type = \"disc\"\ncenter = {}\nnormal = [0, -1, 0]\nradius = {:e}", list(at), 0.5 * s)
        },
        intensity: |d| 0.25 * PI * d.y.abs(),
        wasteful: false,
    },
    Kind {
        name: "sphere",
        text: |s, at| format!("type = \"sphere\"\ncenter = {}\nradius = {:e}", list(at), 0.5 * s),
        intensity: |_| 0.25 * PI,
        wasteful: false,
    },
    Kind {
        name: "cylinder",
        text: |s, at| {
            let half = DVec3::X * (0.5 * s);
            let ends = (list(at - half), list(at + half));
            format!("type = \"cylinder\"\nbase = {}\ntop = {}\nradius = {:e}", ends.0, ends.1, 0.5 * s)
        },
        intensity: |d| d.y.hypot(d.z),
        wasteful: true,
    },
    Kind {
        name: "box",
        text: |s, at| {
            let half = DVec3::splat(0.5 * s);
            let corners: Vec<String> = (0..8)
                .map(|i| {
                    let sign = |bit: i32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
                    list(at + DVec3::new(sign(0), sign(1), sign(2)) * half)
                })
                .collect();
            format!(
                "type = \"mesh\"\nvertices = [{}]\nfaces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], \
                 [0, 4, 6, 2], [1, 3, 7, 5]]",
                corners.join(", ")
            )
        },
        intensity: |d| d.abs().element_sum(),
        wasteful: true,
    },
    Kind {
        name: "triangle",
        text: |s, at| {
            let [a, b] = [DVec3::X * s, DVec3::Z * s];
            format!(
                "type = \"mesh\"\nvertices = [{}, {}, {}]\nfaces = [[0, 1, 2]]",
                list(at),
                list(at + a),
                list(at + b)
            )
        },
        intensity: |d| 0.5 * d.y.abs(),
        wasteful: false,
    },
];

/// An emitter of this size so far above a square floor, whose side is twice that, that its intensity straight down is about the
/// squared distance.
fn lamp_above_floor(kind: &Kind, size: f64, distance: f64) -> Stage {
    let radiance = (distance / size).powi(2);
    let text = format!(
        "[camera]\neye = [0, {0:e}, {0:e}]\nat = [0, 0, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
         [[shapes]]\nname = \"floor\"\ntype = \"quad\"\ncorner = [-{0:e}, 0, {0:e}]\nedge-u = [{1:e}, 0, 0]\n\
         edge-v = [0, 0, -{1:e}]\nmaterial = \"grey\"\n\
         [[shapes]]\nname = \"lamp\"\n{2}\nmaterial = \"grey\"\nemission = {{ radiance = {radiance:e} }}\n",
        distance,
        2.0 * distance,
        (kind.text)(size, DVec3::Y * distance)
    );
    Stage::new(&text, (4, 4))
}

/// Sizes and distances, metres.
fn sizes_and_distances(kind: &Kind) -> impl Iterator<Item = (f64, f64)> {
    // Where the corners of a box are written as numbers, its height has the rounding of its place.
    let least = if kind.name == "box" { 1e-12 } else { 0.0 };
    let distances = [1e-3, 1.0, 1e3, 1e6];
    let sizes = [1e-12, 1e-9, 1e-6, 1e-4, 1e-2, 1.0];
    let pairs = distances.into_iter().flat_map(move |distance| sizes.map(|size| (size, distance)));
    // Near lamps are another matter, and the tiniest is of no use to anyone across a kilometre.
    let is_small = move |size: f64, distance: f64| size <= 0.01 * distance && size >= least * distance;
    pairs.filter(move |&(size, distance)| is_small(size, distance) && (size > 1e-11 || distance <= 1.0))
}

/// Direct irradiance by paths and by the shadow rays of photon mode.
#[test]
fn emitters_of_any_size_and_distance_send_their_light() {
    for kind in &KINDS {
        for (size, distance) in sizes_and_distances(kind) {
            let stage = lamp_above_floor(kind, size, distance);
            // Below the lamp and aside, in distances.
            let places = [DVec3::new(0.01, 0.0, 0.02), DVec3::new(0.3, 0.0, 0.4)];
            let few = Overrides { global_photons: Some(100), caustic_photons: Some(0), ..photon_map() };
            let request = ProbeRequest {
                points: places.map(|at| ProbePoint { position: at * distance, normal: DVec3::Y }).to_vec(),
                estimators: vec![ProbeEstimator::Path, ProbeEstimator::Gather],
                samples: if kind.wasteful { 16_384 } else { 256 },
                batches: 8,
                lift: 1e-3 * distance,
                settings: stage.settings(&few),
            };
            let probed = probe(stage.scene(), &request, &Silent).unwrap().unwrap();
            for (at, found) in places.into_iter().zip(probed.points) {
                let way = at - DVec3::Y;
                let d = way.normalize();
                let want = (kind.intensity)(d) * d.y.abs() / way.length_squared();
                for reading in found.unwrap().readings {
                    let (value, error) = (reading.irradiance[0].x, reading.standard_error.unwrap()[0].x);
                    let what =
                        format!("{} of {size:e} m at {distance:e} m by {:?}", kind.name, reading.estimator);
                    // The lamp is not quite a point: a hundredth of the distance at most. And corners of meshes are rounded to single
                    // precision, which changes the area of the smallest box by 2.4e-4.
                    let rounded = if kind.name == "box" { 1.25e-4 } else { 1e-4 };
                    let room = 5.0 * error + 2.0 * (size / distance).max(rounded) * want;
                    assert!(error < 0.02 * want, "{what}: {value} +- {error}");
                    assert!((value - want).abs() < room, "{what}: {value} +- {error}, not {want}");
                }
            }
        }
    }
}

/// Photons that arrive on the floor carry the flux of the closed form.
#[test]
fn photons_of_emitters_of_any_size_arrive() {
    for kind in &KINDS {
        // Irradiance summed up over the floor of side 2, from a height of 1.
        let n = 400;
        let step = 2.0 / f64::from(n);
        let cells = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let want: f64 = cells
            .map(|(i, j)| {
                let at = |k: i32| -1.0 + (f64::from(k) + 0.5) * step;
                let way = DVec3::new(at(i), -1.0, at(j));
                let d = way.normalize();
                (kind.intensity)(d) * d.y.abs() / way.length_squared() * step * step
            })
            .sum();
        for (size, distance) in sizes_and_distances(kind) {
            let stage = lamp_above_floor(kind, size, distance);
            let traced = trace(stage.scene(), MapKind::Global, 4000, 3);
            let direct = traced.photons.iter().filter(|photon| photon.class() == PhotonClass::Direct);
            let sum: f64 = direct.map(|photon| f64::from(photon.power().x)).sum();
            let flux = stage.watts(sum / traced.emitted as f64) / (distance * distance);
            // Photons have equal power, and about as many are stored as asked for.
            assert!(
                (flux / want - 1.0).abs() < 0.08,
                "{} of {size:e} m at {distance:e} m: {flux}, not {want}",
                kind.name
            );
        }
    }
}

fn trace(scene: &Scene, kind: MapKind, stored: u64, seed: u64) -> TracedPhotons {
    let settings =
        TraceSettings { kind, stored, seed, max_depth: 1000, aimed: true, wavelengths: Default::default() };
    trace_photons(scene, &settings, &|_, _| true).unwrap()
}

/// A ball and a small table, alone or with a bead so far away that they are a millionth of the scene.
fn still_life(light: &str, bead: bool) -> Stage {
    let far = "[[shapes]]\nname = \"bead\"\ntype = \"sphere\"\ncenter = [0, 1e5, 2e5]\nradius = 1.0\nmaterial = \"grey\"\n";
    let text = format!(
        "[camera]\neye = [0, 3, 5]\nat = [0, 0, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
         [[shapes]]\nname = \"table\"\ntype = \"quad\"\ncorner = [-2, 0, 2]\nedge-u = [4, 0, 0]\nedge-v = [0, 0, -4]\n\
         material = \"grey\"\n[[shapes]]\nname = \"ball\"\ntype = \"sphere\"\ncenter = [0, 0.5, 0]\nradius = 0.5\n\
         material = \"grey\"\n{}{light}",
        if bead { far } else { "" }
    );
    Stage::new(&text, (8, 8))
}

/// Flux in watts on what is within 10 m of the origin, and photons emitted for one that is stored there.
fn near_flux(stage: &Stage, stored: u64) -> (f64, f64) {
    let traced = trace(stage.scene(), MapKind::Global, stored, 1);
    let space = stage.scene().space();
    let is_near = |at: glam::Vec3| space.world_position(at.as_dvec3()).length() < 10.0;
    let near = traced.photons.iter().filter(|photon| is_near(photon.position));
    let (sum, count) =
        near.fold((0.0, 0u32), |(sum, count), photon| (sum + f64::from(photon.power().x), count + 1));
    (stage.watts(sum / traced.emitted as f64), traced.emitted as f64 / f64::from(count.max(1)))
}

/// What stands far away takes no light from what is near: light from outside is aimed at what can be lit, and so is a lamp that
/// is far from all of it.
#[test]
fn photons_find_small_things_in_a_large_scene() {
    let lights = [
        ("parallel", "[[lights]]\ntype = \"directional\"\ndirection = [0.3, -1, 0.2]\nirradiance = 3\n"),
        ("sky", "[[lights]]\ntype = \"sky\"\nelevation = 50\n"),
        ("environment", "[[lights]]\ntype = \"environment\"\nradiance = 1\n"),
        ("point", "[[lights]]\ntype = \"point\"\nposition = [0, 1e5, 0]\npower = 1e12\n"),
    ];
    for (name, light) in lights {
        let (want, _) = near_flux(&still_life(light, name == "point"), 40_000);
        let (found, each) = near_flux(&still_life(light, true), 40_000);
        println!("{name}: {found} W, {want} W without the bead, {each} emitted for each");
        assert!(want > 0.0 && (found / want - 1.0).abs() < 0.04, "{name}: {found}, not {want}");
        assert!(each < 50.0, "{name}: {each} photons emitted for each stored");
    }
    // The flux from far above in closed form: the intensity times the solid angle of the table, and what goes on to be stored again.
    let (point, _) = near_flux(&still_life(lights[3].1, true), 40_000);
    let direct = 1e12 / (4.0 * PI) * 16.0 / 1e10;
    assert!(point > direct && point < 1.4 * direct, "{point} {direct}");
}

/// A long thin floor fills little of the sphere around it, and photons from outside find it all the same.
#[test]
fn photons_find_a_long_thin_floor() {
    let text = "[camera]\neye = [0, 3, 5]\nat = [0, 0, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
                [[shapes]]\ntype = \"quad\"\ncorner = [-4, 0, 4]\nedge-u = [8, 0, 0]\nedge-v = [0, 0, -1e6]\n\
                material = \"grey\"\n[[lights]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 3\n";
    let stage = Stage::new(text, (8, 8));
    let traced = trace(stage.scene(), MapKind::Global, 20_000, 1);
    let sum: f64 = traced.photons.iter().map(|photon| f64::from(photon.power().x)).sum();
    let flux = stage.watts(sum / traced.emitted as f64);
    assert!((flux / 24e6 - 1.0).abs() < 0.01, "{flux}");
    assert!(traced.emitted < 30_000, "{}", traced.emitted);
}

/// A pass that cannot store anything ends when as many photons were traced as were to be stored, and says so.
#[test]
fn a_pass_that_stores_nothing_ends_early() {
    // The lamp is in a black case, beside a grey floor.
    let text = "[camera]\neye = [0, 3, 5]\nat = [0, 0, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
                [materials.mirror]\ntype = \"mirror\"\n\
                [[shapes]]\ntype = \"quad\"\ncorner = [-4, 0, 4]\nedge-u = [8, 0, 0]\nedge-v = [0, 0, -8]\nmaterial = \"grey\"\n\
                [[shapes]]\nname = \"shield\"\ntype = \"quad\"\ncorner = [-9, 1, 9]\nedge-u = [18, 0, 0]\nedge-v = [0, 0, -18]\n\
                material = \"mirror\"\n[[lights]]\ntype = \"point\"\nposition = [0, 2, 0]\npower = 10\n";
    let stage = Stage::new(text, (8, 8));
    for stored in [1000, 100_000] {
        let traced = trace(stage.scene(), MapKind::Global, stored, 1);
        assert!(traced.photons.is_empty());
        assert!(traced.emitted <= stored.max(40_000), "{} emitted for {stored}", traced.emitted);
    }
    let settings = Overrides {
        spp: Some(1),
        global_photons: Some(50_000),
        caustic_photons: Some(50_000),
        ..photon_map()
    };
    let shot = stage.shoot(&settings);
    assert!(
        shot.warns("none of the 50000 photons that were tried reached a diffuse surface"),
        "{:?}",
        shot.statistics.warnings
    );
}

/// A floor, a glass ball and a ceiling of so many lamps.
fn ceiling(side: u32) -> Stage {
    let mut text = String::from(
        "[camera]\neye = [0, 1.2, 4]\nat = [0, 0.4, 0]\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.6\n\
         [materials.glass]\ntype = \"dielectric\"\nior = 1.5\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-5, 0, 5]\nedge-u = [10, 0, 0]\nedge-v = [0, 0, -10]\nmaterial = \"grey\"\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.5, 0]\nradius = 0.4\nmaterial = \"glass\"\n",
    );
    let step = 8.0 / f64::from(side);
    for i in 0..side * side {
        let (x, z) = (-4.0 + f64::from(i % side) * step, -4.0 + f64::from(i / side) * step);
        write!(
            text,
            "[[shapes]]\ntype = \"quad\"\ncorner = [{x:.5}, 2, {z:.5}]\nedge-u = [{0:.6}, 0, 0]\nedge-v = [0, 0, {0:.6}]\n\
             material = \"grey\"\nemission = {{ radiance = 10 }}\n",
            0.3 * step
        )
        .unwrap();
    }
    Stage::new(&text, (8, 8))
}

/// As many photons from nine times as many lamps take about as much time, and what every lamp needs for itself grows as
/// their number; and the light is the same.
#[test]
fn photons_of_thousands_of_lamps() {
    let (few, many) = (ceiling(25), ceiling(75));
    let run = |stage: &Stage| {
        let mut results = [MapKind::Global, MapKind::Caustic].map(|kind| {
            let traced = trace(stage.scene(), kind, 10_000, 1);
            let sum: f64 = traced.photons.iter().map(|photon| f64::from(photon.power().x)).sum();
            (stage.watts(sum / traced.emitted as f64), traced.emitted)
        });
        results.iter_mut().for_each(|result| result.1 = result.1.max(1));
        results
    };
    let time = |stage: &Stage| {
        let runs = (0..3).map(|_| {
            let start = Instant::now();
            run(stage);
            start.elapsed().as_secs_f64()
        });
        runs.fold(f64::INFINITY, f64::min)
    };
    for (a, b) in run(&few).into_iter().zip(run(&many)) {
        println!("{a:?} {b:?}");
        assert!((a.0 / b.0 - 1.0).abs() < 0.1, "{a:?} {b:?}");
    }
    let (short, long) = (time(&few), time(&many));
    println!("{short:.3} s and {long:.3} s");
    // As the square of the count it was 81 times.
    assert!(long < 25.0 * short, "{long} s for nine times as many lamps, not {short}");
}
