//! Closed rooms, in which light is the same everywhere and known in closed form.

use crate::support::*;
use cardioid::render::{MapKind, Overrides};
use std::f64::consts::PI;

/// Reflectances, one for each channel: three enclosures in one, and chromatic roulette on top.
const RHO: [f64; 3] = [0.5, 0.8, 0.95];

/// The same for photon maps: at 0.95 a photon is stored 20 times, and a map of equal size rests on fewer photons.
const RHO_OF_MAPS: [([f64; 3], u64); 2] = [([0.5, 0.65, 0.8], 500_000), ([0.95; 3], 2_000_000)];

/// An integrating sphere of radius 2 m with 100 W of `light`.
fn integrating_sphere(rho: [f64; 3], light: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0.3, -0.4, 0.9]
        at = [1.0, 0.2, 0.0]
        fov = 60.0

        [materials.paint]
        type = "lambert"
        reflectance = {rho:?}

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [[shapes]]
        type = "sphere"
        radius = 2.0
        material = "paint"
        {light}
        "#
    );
    Stage::new(&text, (24, 24))
}

const POINT: &str = r#"
    [[lights]]
    type = "point"
    position = [0.0, 0.0, 0.0]
    power = 100.0
"#;

/// A ball of radius 0.2 with the same power; it absorbs what returns to it. The camera looks past it.
fn ball() -> String {
    format!(
        r#"
        [[shapes]]
        type = "sphere"
        radius = 0.2
        material = "black"
        emission = {{ radiance = {:?} }}
        "#,
        100.0 / (PI * 4.0 * PI * 0.04)
    )
}

/// `L = rho E / pi` with `E = Phi / (4 pi R^2 (1 - rho))`. Of the light that leaves the wall the share `lost` does
/// not come back: `(r / R)^2` meets a concentric ball.
fn sphere_radiance(rho: [f64; 3], lost: f64) -> [f64; 3] {
    rho.map(|rho| rho / PI * 100.0 / (4.0 * PI * 4.0 * (1.0 - rho * (1.0 - lost))))
}

#[test]
fn integrating_sphere_by_path_tracing() {
    for (light, lost) in [(POINT.to_owned(), 0.0), (ball(), 0.01)] {
        let shot = integrating_sphere(RHO, &light).shoot(&Overrides { spp: Some(256), ..path() });
        assert_close("integrating sphere, path", shot.mean("beauty"), sphere_radiance(RHO, lost), 0.005);
        let direct = RHO.map(|rho| rho / PI * 100.0 / (16.0 * PI));
        assert_close("integrating sphere, path, direct", shot.mean("direct"), direct, 1e-3);
        assert_eq!((shot.mean("emission"), shot.mean("caustics")), ([0.0; 3], [0.0; 3]));
    }
}

#[test]
fn integrating_sphere_by_photon_maps() {
    for (light, lost) in [(POINT.to_owned(), 0.0), (ball(), 0.01)] {
        for (rho, photons) in RHO_OF_MAPS {
            let stage = integrating_sphere(rho, &light);
            let settings = Overrides { spp: Some(16), global_photons: Some(photons), ..photon_map() };
            let want = sphere_radiance(rho, lost);
            let shot = stage.shoot(&settings);
            assert_close("integrating sphere, photon map", shot.mean("beauty"), want, 0.01);
            // The other ways to read a map do not know what light it was.
            if lost > 0.0 {
                continue;
            }
            let full = Overrides { precomputed_irradiance: Some(false), spp: Some(4), ..settings.clone() };
            let shot = stage.shoot(&full);
            assert_close("integrating sphere, full estimates", shot.mean("beauty"), want, 0.01);
            // Only photons on what is seen count here, so more of them are needed for the same noise.
            let shown =
                Overrides { spp: Some(4), global_photons: Some(4 * photons), ..show(MapKind::Global) };
            assert_close("integrating sphere, photons", stage.shoot(&shown).mean("beauty"), want, 0.01);
        }
    }
}

/// A room whose walls emit `1 - rho` and reflect `rho`: radiance is 1 everywhere, whatever stands in it as long as it
/// absorbs nothing, and `n^2` in a medium of index `n`.
fn furnace(eye: &str, rho: [f64; 3], content: &str) -> Stage {
    let emission = rho.map(|rho| 1.0 - rho);
    let wall = |name: &str, corner: &str, u: &str, v: &str| {
        format!(
            r#"
            [[shapes]]
            name = "{name}"
            type = "quad"
            corner = {corner}
            edge-u = {u}
            edge-v = {v}
            material = "wall"
            emission = {{ radiance = {emission:?} }}
            "#
        )
    };
    // Normals point inwards.
    let walls = [
        wall("floor", "[-1, -1, -1]", "[0, 0, 2]", "[2, 0, 0]"),
        wall("ceiling", "[-1, 1, -1]", "[2, 0, 0]", "[0, 0, 2]"),
        wall("left", "[-1, -1, -1]", "[0, 2, 0]", "[0, 0, 2]"),
        wall("right", "[1, -1, -1]", "[0, 0, 2]", "[0, 2, 0]"),
        wall("back", "[-1, -1, -1]", "[2, 0, 0]", "[0, 2, 0]"),
        wall("front", "[-1, -1, 1]", "[0, 2, 0]", "[2, 0, 0]"),
    ];
    let text = format!(
        r#"
        [camera]
        eye = {eye}
        at = [0.0, -0.1, 0.0]
        fov = 80.0

        [materials.wall]
        type = "lambert"
        reflectance = {rho:?}

        {}
        {content}
        "#,
        walls.concat()
    );
    Stage::new(&text, (16, 16))
}

const CORNER: &str = "[0.8, 0.5, 0.9]";

#[test]
fn white_furnace_by_path_tracing() {
    let shot = furnace(CORNER, RHO, "").shoot(&Overrides { spp: Some(256), ..path() });
    assert_close("furnace, path", shot.mean("beauty"), grey(1.0), 0.005);
    assert_close("furnace, path, emission", shot.mean("emission"), RHO.map(|rho| 1.0 - rho), 1e-6);
    assert_close("furnace, path, direct", shot.mean("direct"), RHO.map(|rho| rho * (1.0 - rho)), 0.005);
}

#[test]
fn white_furnace_by_photon_maps() {
    for (rho, photons) in RHO_OF_MAPS {
        let stage = furnace(CORNER, rho, "");
        let settings = Overrides { spp: Some(32), global_photons: Some(photons), ..photon_map() };
        let shot = stage.shoot(&settings);
        assert_close("furnace, photon map", shot.mean("beauty"), grey(1.0), 0.01);
        assert_close(
            "furnace, photon map, direct",
            shot.mean("direct"),
            rho.map(|rho| rho * (1.0 - rho)),
            0.005,
        );
        assert_close("furnace, photon map, indirect", shot.mean("indirect"), rho.map(|rho| rho * rho), 0.01);
        // The spread over the picture is noise of the map, not bias of a corner.
        let spread = shot.layer("beauty").iter().map(|v| (v - 1.0).abs()).fold(0.0, f32::max);
        println!("largest difference of a pixel {spread}");
        assert!(spread < 0.1, "{spread}");
        let shown = Overrides { spp: Some(16), global_photons: Some(photons), ..show(MapKind::Global) };
        let shot = stage.shoot(&shown);
        let reflected = std::array::from_fn(|c| shot.mean("indirect")[c] / rho[c]);
        assert_close("furnace, photons", reflected, grey(1.0), 0.015);
    }
}

const BALLS: &str = r#"
    [materials.glass]
    type = "dielectric"
    ior = 1.5

    [materials.mirror]
    type = "mirror"

    [[shapes]]
    name = "glass"
    type = "sphere"
    center = [-0.3, -0.5, 0.2]
    radius = 0.4
    material = "glass"

    [[shapes]]
    name = "mirror"
    type = "sphere"
    center = [0.4, -0.3, -0.4]
    radius = 0.45
    material = "mirror"
"#;

#[test]
fn glass_and_mirrors_are_invisible_in_a_furnace() {
    let rho = [0.3, 0.5, 0.7];
    let stage = furnace(CORNER, rho, BALLS);
    let path = stage.shoot(&Overrides { spp: Some(512), ..path() });
    assert_close("glass in a furnace, path", path.mean("beauty"), grey(1.0), 0.005);
    let settings = Overrides {
        spp: Some(64),
        global_photons: Some(500_000),
        caustic_photons: Some(500_000),
        ..photon_map()
    };
    let shot = stage.shoot(&settings);
    assert_close("glass in a furnace, photon map", shot.mean("beauty"), grey(1.0), 0.01);
    for part in PARTS {
        println!("{part}: path {:.5?}, photon map {:.5?}", path.mean(part), shot.mean(part));
    }
    for part in PARTS {
        assert_close(part, shot.mean(part), path.mean(part), 0.01);
    }
    assert_eq!(shot.statistics.counters.medium_mismatches, 0);
}

#[test]
fn a_camera_inside_glass_sees_the_square_of_its_index() {
    let ball = r#"
        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [[shapes]]
        type = "sphere"
        center = [0.2, 0.0, 0.1]
        radius = 0.5
        material = "glass"
    "#;
    // Away from the centre, so that some rays are totally reflected.
    let stage = furnace("[0.5, 0.1, 0.3]", [0.3, 0.5, 0.7], ball);
    let path = stage.shoot(&Overrides { spp: Some(256), ..path() });
    assert_close("inside glass, path", path.mean("beauty"), grey(2.25), 0.005);
    let settings = Overrides {
        spp: Some(64),
        global_photons: Some(300_000),
        caustic_photons: Some(300_000),
        ..photon_map()
    };
    let maps = stage.shoot(&settings);
    assert_close("inside glass, photon map", maps.mean("beauty"), grey(2.25), 0.01);
    assert_eq!(
        (path.statistics.counters.medium_mismatches, maps.statistics.counters.medium_mismatches),
        (0, 0)
    );
}

#[test]
fn matched_indices_are_not_there() {
    for ior in ["1", "1.00005", "1.0001", "1.001"] {
        let ball = format!(
            r#"
            [materials.glass]
            type = "dielectric"
            ior = {ior}

            [[shapes]]
            type = "sphere"
            center = [-0.1, -0.1, 0.1]
            radius = 0.6
            material = "glass"
            "#
        );
        let stage = furnace(CORNER, [0.3, 0.5, 0.7], &ball);
        let path = stage.shoot(&Overrides { spp: Some(64), ..path() });
        assert_close(&format!("ior {ior}, path"), path.mean("beauty"), grey(1.0), 0.01);
        let settings = Overrides {
            spp: Some(8),
            global_photons: Some(100_000),
            caustic_photons: Some(100_000),
            ..photon_map()
        };
        let maps = stage.shoot(&settings);
        assert_close(&format!("ior {ior}, photon map"), maps.mean("beauty"), grey(1.0), 0.015);
    }
}

/// A glass shell around a liquid: the interfaces say which media they part.
fn shell(liquid_outside: &str) -> String {
    format!(
        r#"
        [media.glass]
        ior = 1.5

        [media.liquid]
        ior = 1.36

        [media.oil]
        ior = 1.47

        [materials.outer]
        type = "dielectric"
        inside = "glass"

        [materials.inner]
        type = "dielectric"
        inside = "liquid"
        outside = "{liquid_outside}"

        [[shapes]]
        type = "sphere"
        radius = 0.6
        material = "outer"

        [[shapes]]
        type = "sphere"
        radius = 0.5
        material = "inner"
        "#
    )
}

#[test]
fn nested_interfaces() {
    let path = Overrides { spp: Some(128), ..path() };
    let maps = Overrides {
        spp: Some(16),
        global_photons: Some(150_000),
        caustic_photons: Some(150_000),
        ..photon_map()
    };
    let rho = [0.3, 0.5, 0.7];
    let right = furnace(CORNER, rho, &shell("glass"));
    let wrong = furnace(CORNER, rho, &shell("oil"));
    for settings in [&path, &maps] {
        let shot = right.shoot(settings);
        assert_close("shell of liquid", shot.mean("beauty"), grey(1.0), 0.01);
        assert_eq!(shot.statistics.counters.medium_mismatches, 0);
        assert!(shot.statistics.warnings.is_empty(), "{:?}", shot.statistics.warnings);
        let shot = wrong.shoot(settings);
        assert!(shot.statistics.counters.medium_mismatches > 0);
        assert!(shot.warns("another medium"), "{:?}", shot.statistics.warnings);
    }
    // Each body within air, one in the other: the smaller one displaces the larger one, as if the interface had said so.
    let nested = furnace(CORNER, rho, &shell("air"));
    for settings in [&path, &maps] {
        let (by_size, stated) = (nested.shoot(settings), right.shoot(settings));
        assert_close("one body in another", by_size.mean("beauty"), stated.mean("beauty"), 1e-3);
        assert_eq!(by_size.statistics.counters.medium_mismatches, 0);
        assert!(by_size.statistics.warnings.is_empty(), "{:?}", by_size.statistics.warnings);
    }
    // Photons notice as well.
    let shot = wrong.shoot(&maps);
    assert!(shot.warns("photons met an interface in another medium"), "{:?}", shot.statistics.warnings);
    // And a camera inside starts in the medium it is in.
    let inside = furnace("[0.1, 0.2, 0.3]", rho, &shell("glass")).shoot(&path);
    assert_close("inside the liquid", inside.mean("beauty"), grey(1.36 * 1.36), 0.01);
    assert_eq!(inside.statistics.counters.medium_mismatches, 0);
}

/// Two balls of different glass that share a lens-shaped part, and a third one of the first glass across both.
#[test]
fn bodies_overlap_without_a_trace() {
    let balls = |priority: i32| {
        format!(
            r#"
            [media.flint]
            ior = 1.7
            priority = {priority}

            [media.crown]
            ior = 1.5

            [materials.flint]
            type = "dielectric"
            inside = "flint"

            [materials.crown]
            type = "dielectric"
            inside = "crown"

            [[shapes]]
            type = "sphere"
            center = [-0.25, 0, 0]
            radius = 0.5
            material = "flint"

            [[shapes]]
            type = "sphere"
            center = [0.3, 0.1, 0]
            radius = 0.45
            material = "crown"

            [[shapes]]
            type = "sphere"
            center = [0.0, -0.3, 0.1]
            radius = 0.4
            material = "crown"
            "#
        )
    };
    let rho = [0.3, 0.5, 0.7];
    for priority in [-1, 0, 1] {
        let stage = furnace(CORNER, rho, &balls(priority));
        let maps = Overrides {
            spp: Some(16),
            global_photons: Some(150_000),
            caustic_photons: Some(150_000),
            ..photon_map()
        };
        for settings in [&Overrides { spp: Some(128), ..path() }, &maps] {
            let shot = stage.shoot(settings);
            assert_close("balls in each other", shot.mean("beauty"), grey(1.0), 0.01);
            assert_eq!(shot.statistics.counters.medium_mismatches, 0);
            assert!(shot.statistics.warnings.is_empty(), "{:?}", shot.statistics.warnings);
        }
        // The camera is in both; the one that counts has its radiance by the square of its index.
        let eye = "[0.05, 0.1, 0.2]";
        let inside = furnace(eye, rho, &balls(priority)).shoot(&Overrides { spp: Some(128), ..path() });
        let index: f64 = if priority > 0 { 1.7 } else { 1.5 };
        assert_close("within both", inside.mean("beauty"), grey(index * index), 0.01);
        assert_eq!(inside.statistics.counters.medium_mismatches, 0);
    }
}

/// Beer's law through two slabs, of which half of each is the other.
#[test]
fn the_prior_body_absorbs() {
    let slabs = |priorities: [i32; 2]| {
        let [first, second] = priorities;
        format!(
            r#"
            [camera]
            eye = [0, 0, 9]
            at = [0, 0, 0]
            fov = 0.1

            [media.first]
            ior = 1.0
            absorption = [0.3, 0.6, 0.9]
            priority = {first}

            [media.second]
            ior = 1.0
            absorption = [1.1, 0.7, 0.2]
            priority = {second}

            [materials.first]
            type = "dielectric"
            inside = "first"

            [materials.second]
            type = "dielectric"
            inside = "second"

            [materials.black]
            type = "lambert"
            reflectance = 0

            [[shapes]]
            type = "box"
            min = [-1, -1, 0]
            max = [1, 1, 1]
            material = "first"

            [[shapes]]
            type = "box"
            min = [-2, -2, 0.5]
            max = [2, 2, 1.75]
            material = "second"

            [[shapes]]
            type = "quad"
            corner = [-3, -3, -2]
            edge-u = [6, 0, 0]
            edge-v = [0, 6, 0]
            material = "black"
            emission = {{ radiance = [1, 1, 1] }}
            "#
        )
    };
    let (first, second) = ([0.3, 0.6, 0.9], [1.1, 0.7, 0.2]);
    // Without priorities the smaller body is there.
    for (priorities, lengths) in
        [([1, 0], [1.0, 0.75]), ([0, 1], [0.5, 1.25]), ([0, 0], [1.0, 0.75]), ([-3, -2], [0.5, 1.25])]
    {
        let shot = Stage::new(&slabs(priorities), (4, 4)).shoot(&Overrides { spp: Some(4), ..path() });
        let want = [0, 1, 2].map(|c| f64::exp(-(first[c] * lengths[0] + second[c] * lengths[1])));
        assert_close(&format!("priorities {priorities:?}"), shot.mean("beauty"), want, 1e-5);
        assert_eq!(shot.statistics.counters.medium_mismatches, 0);
    }
}
