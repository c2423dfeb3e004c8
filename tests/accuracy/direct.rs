//! Direct light against closed forms, by every integrator that computes it, seen by a camera that looks at a spot.

use crate::support::*;
use cardioid::render::Overrides;
use cardioid::sampling::{Rng, Stream};
use std::f64::consts::PI;

/// A grey floor, and a camera that sees a spot of 2 mm around the origin of it from the side.
fn floor(light: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [2.0, 0.5, 1.0]
        at = [0.0, 0.0, 0.0]
        fov = 0.05

        [materials.floor]
        type = "lambert"
        reflectance = 0.5

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [[shapes]]
        type = "quad"
        corner = [-3, 0, -3]
        edge-u = [0, 0, 6]
        edge-v = [6, 0, 0]
        material = "floor"
        {light}
        "#
    );
    Stage::new(&text, (16, 16))
}

/// Irradiance of the spot by both integrators; nothing but direct light must be there.
#[track_caller]
fn assert_irradiance(what: &str, light: &str, want: [f64; 3], tolerance: f64) {
    let stage = floor(light);
    for (name, settings) in [
        ("path", Overrides { spp: Some(256), ..path() }),
        (
            "photon map",
            Overrides { spp: Some(64), gather_samples: Some(4), global_photons: Some(1000), ..photon_map() },
        ),
        (
            "photon map, many shadow rays",
            Overrides {
                spp: Some(4),
                light_samples: Some(32),
                gather_samples: Some(32),
                global_photons: Some(1000),
                ..photon_map()
            },
        ),
    ] {
        let shot = stage.shoot(&settings);
        let irradiance = shot.mean("direct").map(|radiance| radiance * PI / 0.5);
        assert_close(&format!("{what}, {name}"), irradiance, want, tolerance);
        for other in ["emission", "specular", "caustics", "indirect"] {
            assert_eq!(shot.mean(other), [0.0; 3], "{what}, {name}: {other}");
        }
    }
}

fn emitter(shape: &str, extra: &str) -> String {
    format!("[[shapes]]\n{shape}\nmaterial = \"black\"\nemission = {{ radiance = [3.0, 2.0, 1.0]{extra} }}\n")
}

fn of_radiance(factor: f64) -> [f64; 3] {
    [3.0, 2.0, 1.0].map(|radiance| radiance * factor)
}

#[test]
fn unit_square() {
    // Factors from accuracy notes of the project: element parallel to a unit square at height 1.
    let below_center = "type = \"quad\"\ncorner = [-0.5, 1, -0.5]\nedge-u = [1, 0, 0]\nedge-v = [0, 0, 1]";
    assert_irradiance("below the centre", &emitter(below_center, ""), of_radiance(PI * 0.239_456_5), 0.002);
    let below_corner = "type = \"quad\"\ncorner = [0, 1, 0]\nedge-u = [1, 0, 0]\nedge-v = [0, 0, 1]";
    assert_irradiance("below a corner", &emitter(below_corner, ""), of_radiance(PI * 0.138_531_6), 0.002);
    let mesh = "type = \"mesh\"\nvertices = [[-0.5, 1, -0.5], [0.5, 1, -0.5], [0.5, 1, 0.5], [-0.5, 1, 0.5]]\n\
                faces = [[0, 1, 2, 3]]";
    assert_irradiance("mesh", &emitter(mesh, ""), of_radiance(PI * 0.239_456_5), 0.002);
}

#[test]
fn two_sides() {
    // The normal points up, away from the floor.
    let up = "type = \"quad\"\ncorner = [-0.5, 1, -0.5]\nedge-u = [0, 0, 1]\nedge-v = [1, 0, 0]";
    let want = of_radiance(PI * 0.239_456_5);
    assert_irradiance("two-sided", &emitter(up, ", two-sided = true"), want, 0.002);
    assert_irradiance("flipped", &emitter(&format!("{up}\nflip-normal = true"), ""), want, 0.002);
    let dark = floor(&emitter(up, "")).shoot(&Overrides { spp: Some(16), ..path() });
    assert_eq!(dark.mean("beauty"), [0.0; 3]);
    // What the camera sees of an emitter: its own side only, and both of a two-sided one.
    for (extra, front, back) in [("", 1.0, 0.0), (", two-sided = true", 1.0, 1.0)] {
        for (eye, want) in [("[0.0, 3.0, 0.1]", front), ("[0.0, 0.5, 0.1]", back)] {
            let text = format!(
                "[camera]\neye = {eye}\nat = [0.0, 1.0, 0.0]\nfov = 1\n\
                 [materials.black]\ntype = \"lambert\"\nreflectance = 0.0\n{}",
                emitter(up, extra)
            );
            for settings in [path(), photon_map()] {
                let shot = Stage::new(&text, (4, 4)).shoot(&Overrides { spp: Some(4), ..settings });
                let seen = shot.mean("emission");
                assert_eq!(seen, of_radiance(want), "{extra} from {eye}");
                assert_eq!(shot.mean("beauty"), seen);
            }
        }
    }
}

/// The back of a one-sided material absorbs: it is black to the camera, and passes nothing on.
#[test]
fn one_sided_materials() {
    let scene = |two_sided: bool, flip: bool| {
        let text = format!(
            r#"
            [camera]
            eye = [0.0, 1.0, 3.0]
            at = [0.0, 0.0, 0.0]
            fov = 1

            [materials.screen]
            type = "lambert"
            reflectance = 0.5
            two-sided = {two_sided}

            [[shapes]]
            type = "quad"
            corner = [-1, 0, -1]
            edge-u = [0, 0, 2]
            edge-v = [2, 0, 0]
            material = "screen"
            flip-normal = {flip}

            [[lights]]
            type = "directional"
            direction = [0, -1, 0]
            irradiance = 1.0
            "#
        );
        Stage::new(&text, (4, 4))
    };
    let lit = [0.5 / PI; 3];
    let dark = [0.0; 3];
    for (two_sided, flip, want) in
        [(true, false, lit), (true, true, lit), (false, false, lit), (false, true, dark)]
    {
        let stage = scene(two_sided, flip);
        for settings in [path(), photon_map()] {
            let shot = stage.shoot(&Overrides { spp: Some(4), ..settings });
            let off = (0..3).map(|c| (shot.mean("beauty")[c] - want[c]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "two-sided {two_sided}, flipped {flip}: {:?}", shot.mean("beauty"));
        }
    }
    // Photons that arrive at the absorbing back are not stored.
    let shot =
        scene(false, true).shoot(&Overrides { spp: Some(1), global_photons: Some(1000), ..photon_map() });
    assert_eq!(shot.statistics.maps[0].photons, 0);
    assert!(shot.warns("global map is empty"), "{:?}", shot.statistics.warnings);
}

#[test]
fn disc_and_sphere() {
    for (radius, height) in [(1.0, 1.0), (0.1, 0.5), (0.6, 0.2)] {
        let disc =
            format!("type = \"disc\"\ncenter = [0, {height}, 0]\nnormal = [0, -1, 0]\nradius = {radius}");
        let factor = radius * radius / (radius * radius + height * height);
        assert_irradiance(
            &format!("disc {radius} at {height}"),
            &emitter(&disc, ""),
            of_radiance(PI * factor),
            0.003,
        );
    }
    for (radius, distance) in [(0.5, 1.0), (0.01, 1.0), (0.9, 1.0)] {
        let sphere = format!("type = \"sphere\"\ncenter = [0, {distance}, 0]\nradius = {radius}");
        let factor = (radius / distance) * (radius / distance);
        let what = format!("sphere {radius} at {distance}");
        assert_irradiance(&what, &emitter(&sphere, ""), of_radiance(PI * factor), 0.003);
    }
    // Off the axis, wholly above the horizon: times the cosine.
    let sphere = "type = \"sphere\"\ncenter = [0.6, 0.8, 0.0]\nradius = 0.2";
    assert_irradiance("sphere aslant", &emitter(sphere, ""), of_radiance(PI * 0.04 * 0.8), 0.003);
}

/// Inside of a sphere that emits inward, also of one that reflects: `pi L` at any place, and little noise. Drawn uniformly
/// over its area, a place near the wall got samples of any size.
#[test]
fn domes() {
    let settings =
        Overrides { spp: Some(4), gather_samples: Some(16), global_photons: Some(1000), ..photon_map() };
    for (center, extra) in
        [("[0, 0, 0]", ""), ("[2.95, 1.95, -1.9]", ""), ("[0, 0, 0]", ", two-sided = true")]
    {
        let sphere = format!(
            "type = \"sphere\"\ncenter = {center}\nradius = 4.05{}",
            if extra.is_empty() { "\nflip-normal = true" } else { "" }
        );
        let light = emitter(&sphere, extra);
        assert_irradiance(&format!("dome around {center}{extra}"), &light, of_radiance(PI), 0.002);
        let shot = floor(&light).shoot(&settings);
        let noise = shot.standard_error("direct")[0] / shot.mean("direct")[0] * 16.0;
        println!("dome around {center}{extra}: noise {noise}");
        assert!(noise < 0.05, "dome around {center}{extra}: noise {noise}");
    }
    // Seen from outside it is a lamp like any other.
    let lamp = emitter("type = \"sphere\"\ncenter = [0, 1, 0]\nradius = 0.5", ", two-sided = true");
    assert_irradiance("two-sided sphere from outside", &lamp, of_radiance(PI * 0.25), 0.003);
}

/// The wall of a dome that reflects half: each bounce brings half of the one before, to the same radiance everywhere.
#[test]
fn the_wall_of_a_dome() {
    for (extra, flip) in [("", true), (", two-sided = true", false)] {
        for center in ["[0, 0, 0]", "[0.3, 0.7, 0.1]"] {
            let text = format!(
                r#"
                [camera]
                eye = [0.2, 0.6, 0.0]
                at = [0.5, 0.0, 0.3]
                fov = 60

                [materials.paint]
                type = "lambert"
                reflectance = 0.5

                [[shapes]]
                type = "sphere"
                center = {center}
                radius = 1.0
                flip-normal = {flip}
                material = "paint"
                emission = {{ radiance = 1.0{extra} }}
                "#
            );
            let stage = Stage::new(&text, (16, 16));
            for (name, settings) in [
                ("path", Overrides { spp: Some(64), ..path() }),
                ("photon map", Overrides { spp: Some(16), global_photons: Some(1000), ..photon_map() }),
            ] {
                let shot = stage.shoot(&settings);
                let what = format!("{name}, {center}{extra}");
                assert_close(&what, shot.mean("direct"), [0.5; 3], 0.004);
            }
        }
    }
}

/// Right below a parallelogram that stands aslant on the floor. Drawn by area, samples near its foot have any size.
#[test]
fn the_foot_of_a_slanted_parallelogram() {
    let corners = [[-0.6, 0.002, -0.02], [0.9, 0.002, -0.02], [1.7, 1.002, -0.02], [0.2, 1.002, -0.02]];
    // Lambert's formula for a polygon: half the sum over the edges of the angle between its ends as seen from the place
    // times the upward part of the unit normal of that plane.
    let factor: f64 = (0..4)
        .map(|i| {
            let [a, b] = [corners[i], corners[(i + 1) % 4]].map(glam::DVec3::from_array);
            0.5 * a.angle_between(b) * a.cross(b).normalize().y
        })
        .sum();
    let quad = "type = \"quad\"\ncorner = [-0.6, 0.002, -0.02]\nedge-u = [1.5, 0, 0]\nedge-v = [0.8, 1, 0]";
    let light = emitter(quad, "");
    assert_irradiance("slanted parallelogram", &light, of_radiance(factor.abs()), 0.003);
    let settings =
        Overrides { spp: Some(4), gather_samples: Some(16), global_photons: Some(1000), ..photon_map() };
    let shot = floor(&light).shoot(&settings);
    let noise = shot.standard_error("direct")[0] / shot.mean("direct")[0] * 16.0;
    println!("slanted parallelogram: noise {noise}");
    assert!(noise < 0.15, "noise {noise}");
}

/// A cylinder over an element parallel to its axis: `r / d` where it is long.
#[test]
fn long_cylinder() {
    // Ends at 50 times the distance: what is missing is of the order of (1/50)^4.
    let cylinder = "type = \"cylinder\"\nbase = [-15, 0.3, 0]\ntop = [15, 0.3, 0]\nradius = 0.06";
    assert_irradiance("cylinder", &emitter(cylinder, ""), of_radiance(PI * 0.2), 0.01);
}

#[test]
fn lights_without_a_surface() {
    let point = "[[lights]]\ntype = \"point\"\nposition = [0.6, 0.8, 0.0]\nintensity = [3.0, 2.0, 1.0]\n";
    assert_irradiance("point", point, of_radiance(0.8), 0.001);
    let far = "[[lights]]\ntype = \"point\"\nposition = [600.0, 800.0, 0.0]\nintensity = [3e6, 2e6, 1e6]\n";
    assert_irradiance("far point", far, of_radiance(0.8), 0.001);
    let sun =
        "[[lights]]\ntype = \"directional\"\ndirection = [0.6, -0.8, 0.0]\nirradiance = [3.0, 2.0, 1.0]\n";
    assert_irradiance("directional", sun, of_radiance(0.8), 1e-5);
    // The projected solid angle of a disc above the horizon is its whole one's times the cosine of its middle, however wide it is.
    let wide = format!("{sun}angular-diameter = 60.0\n");
    assert_irradiance("wide sun", &wide, of_radiance(0.8), 0.004);
    let sky = "[[lights]]\ntype = \"environment\"\nradiance = [3.0, 2.0, 1.0]\n";
    assert_irradiance("environment", sky, of_radiance(PI), 0.003);
}

/// More lights than get a shadow ray each: one is drawn, and the sum is the same.
#[test]
fn many_lights() {
    let point = |i: usize| {
        format!(
            "[[lights]]\ntype = \"point\"\nposition = [0.0, {}, 0.0]\nintensity = [3.0, 2.0, 1.0]\n",
            1 + i
        )
    };
    let lights: String = (0..20).map(point).collect();
    let sum: f64 = (0..20).map(|i| 1.0 / f64::from(1 + i).powi(2)).sum();
    // All have the same flux and are drawn alike, though their shares in the sum differ by 400.
    assert_irradiance("20 point lights", &lights, of_radiance(sum), 0.01);
    let balls: String = (0..12)
        .map(|i| {
            let sphere =
                format!("type = \"sphere\"\ncenter = [{}, 1.0, 0.0]\nradius = 0.05", f64::from(i - 6) * 0.2);
            emitter(&sphere, "")
        })
        .collect();
    let sum: f64 = (0..12)
        .map(|i| {
            let distance_squared = 1.0 + (f64::from(i - 6) * 0.2).powi(2);
            0.0025 / distance_squared / distance_squared.sqrt()
        })
        .sum();
    assert_irradiance("12 balls", &balls, of_radiance(PI * sum), 0.01);
}

/// A penumbra: half of a square light is hidden by an edge, so the spot below the edge has half the light.
#[test]
fn half_hidden() {
    let light =
        emitter("type = \"quad\"\ncorner = [-0.5, 1, -0.5]\nedge-u = [1, 0, 0]\nedge-v = [0, 0, 1]", "");
    let wall = "[[shapes]]\ntype = \"quad\"\ncorner = [0, 0.5, -2]\nedge-u = [0, 0, 4]\nedge-v = [-2, 0, 0]\n\
                material = \"black\"\n";
    assert_irradiance("half hidden", &format!("{light}{wall}"), of_radiance(PI * 0.239_456_5 / 2.0), 0.005);
}

/// A lamp that reflects is not lit by its own front: its back is black, wherever rounding puts it.
#[test]
fn lamps_do_not_shine_through_themselves() {
    let mut rng = Rng::new(3, Stream::Measure, 0);
    for number in 0..10 {
        let turn = [360.0 * rng.next_f64(), 360.0 * rng.next_f64()];
        let place = [rng.next_f64(), rng.next_f64(), rng.next_f64()];
        for shape in [
            "type = \"quad\"\ncorner = [-0.4, 0, -0.4]\nedge-u = [0.8, 0, 0]\nedge-v = [0, 0, 0.8]",
            "type = \"disc\"\nradius = 0.4\nnormal = [0, -1, 0]",
            "type = \"mesh\"\nvertices = [[-0.4, 0, -0.4], [0.4, 0, -0.4], [0, 0, 0.8]]\nfaces = [[0, 1, 2]]",
            // From inside.
            "type = \"sphere\"\nradius = 2.0",
            "type = \"cylinder\"\nbase = [0, -9, 0]\ntop = [0, 9, 0]\nradius = 2.0",
        ] {
            // Half of them along the axes, where rounding is the same everywhere on the lamp.
            let turn = if number % 2 == 0 { [0.0; 2] } else { turn };
            let text = format!(
                r#"
                [camera]
                eye = [{x:?}, {y:?}, {z:?}]
                at = [{a:?}, {b:?}, {c:?}]
                up = [0.0, 0.0, 1.0]
                fov = 60.0

                [materials.paint]
                type = "lambert"
                reflectance = 0.8

                [materials.black]
                type = "lambert"
                reflectance = 0.0

                [[shapes]]
                {shape}
                material = "paint"
                emission = {{ radiance = 1.0 }}
                transform = [{{ rotate = {:?}, axis = "x" }}, {{ rotate = {:?}, axis = "z" }}, {{ translate = {place:?} }}]

                [[shapes]]
                name = "something else, so that the lamp is not in the middle"
                type = "sphere"
                center = [7.3, -3.1, 2.2]
                radius = 0.1
                material = "black"
                "#,
                turn[0],
                turn[1],
                // Above the lamp's back: the direction that the y axis turns to.
                x = place[0] - (turn[1].to_radians().sin() * turn[0].to_radians().cos()),
                y = place[1] + (turn[1].to_radians().cos() * turn[0].to_radians().cos()),
                z = place[2] + turn[0].to_radians().sin(),
                a = place[0],
                b = place[1],
                c = place[2],
            );
            let stage = Stage::new(&text, (8, 8));
            for settings in [path(), photon_map()] {
                let settings = Overrides { spp: Some(4), global_photons: Some(10), ..settings };
                let seen = stage.shoot(&settings).mean("beauty");
                assert_eq!(seen, [0.0; 3], "lamp {number}: {shape}");
            }
        }
    }
}
