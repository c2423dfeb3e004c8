//! Glass, water and what light loses in them, against Fresnel, Snell and Beer-Lambert.

use crate::support::*;
use cardioid::bsdf::TransportMode;
use cardioid::math::Ray;
use cardioid::media::MediumStack;
use cardioid::render::{MapKind, Overrides};
use cardioid::sampling::ONE_MINUS_EPSILON;
use glam::{Vec2, Vec3};
use std::f64::consts::PI;

/// Reflectance of an interface for unpolarised light, from the side of index 1 into index `n`: Fresnel's equations as
/// textbooks have them, apart from the renderer's own.
pub(crate) fn fresnel(n: f64, cosine: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt() / n;
    if sine >= 1.0 {
        return 1.0;
    }
    let inside = (1.0 - sine * sine).sqrt();
    let s = (cosine - n * inside) / (cosine + n * inside);
    let p = (n * cosine - inside) / (n * cosine + inside);
    0.5 * (s * s + p * p)
}

/// Transmittance of a slab that passes the share `a` from face to face: all reflections between the faces, with the mean
/// of both polarisations at each.
fn slab(r: f64, a: f64) -> f64 {
    (1.0 - r) * (1.0 - r) * a / (1.0 - r * r * a * a)
}

/// A slab of 1 cm and 60 m, a large lamp of radiance 1 below, and a camera that sees a spot of it at `angle` degrees
/// from the normal.
fn slab_scene(ior: f64, absorption: [f64; 3], angle: f64) -> Stage {
    let (sine, cosine) = angle.to_radians().sin_cos();
    let text = format!(
        r#"
        [camera]
        eye = [{x:?}, {y:?}, 0.0]
        at = [0.0, 0.005, 0.0]
        up = [0.0, 0.0, 1.0]
        fov = 0.01

        [materials.glass]
        type = "dielectric"
        ior = {ior:?}
        absorption = {absorption:?}

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [[shapes]]
        name = "upper face"
        type = "quad"
        corner = [-30, 0.005, -30]
        edge-u = [0, 0, 60]
        edge-v = [60, 0, 0]
        material = "glass"

        [[shapes]]
        name = "lower face"
        type = "quad"
        corner = [-30, -0.005, -30]
        edge-u = [60, 0, 0]
        edge-v = [0, 0, 60]
        material = "glass"

        [[shapes]]
        name = "lamp"
        type = "quad"
        corner = [-30, -1, -30]
        edge-u = [0, 0, 60]
        edge-v = [60, 0, 0]
        material = "black"
        emission = {{ radiance = 1.0 }}
        "#,
        x = sine,
        y = 0.005 + cosine,
    );
    Stage::new(&text, (16, 16))
}

/// What is seen through a slab, by path tracing (one way drawn at each face) and by recursion (both followed).
#[track_caller]
fn assert_transmittance(what: &str, stage: &Stage, want: [f64; 3]) {
    let path = stage.shoot(&Overrides { spp: Some(256), ..path() });
    let maps = stage.shoot(&Overrides { spp: Some(16), caustic_photons: Some(0), ..photon_map() });
    for (name, shot) in [("path", path), ("recursion", maps)] {
        let (seen, error) = (shot.mean("specular"), shot.standard_error("specular"));
        println!("{what}, {name}: {seen:.5?} +- {:.5}, want {want:.5?}", error[0]);
        for c in 0..3 {
            // 2e-5: refraction in single precision, and one pixel's share of angles.
            let off = (seen[c] - want[c]).abs();
            assert!(
                off < 4.0 * error[c] + 2e-5 + 2e-4 * want[c],
                "{what}, {name}: {seen:?} +- {error:?}, not {want:?}"
            );
            assert!(error[c] < 0.003, "{what}, {name}: noise of {}", error[c]);
        }
        assert_eq!(shot.mean("beauty"), seen);
        assert_eq!(shot.statistics.counters.medium_mismatches, 0);
    }
}

#[test]
fn transmittance_of_a_slab() {
    // The mean of both polarisations at each face, as an unpolarised tracer has it.
    let table = [
        (1.5, 0.0, 0.92308),
        (1.5, 30.0, 0.92027),
        (1.5, 45.0, 0.90433),
        (1.5, 60.0, 0.83623),
        (1.5, 75.0, 0.59609),
        (1.5, 85.0, 0.24008),
        (1.52, 60.0, 0.83069),
        (1.33, 0.0, 0.96067),
        (1.33, 60.0, 0.88835),
        (2.417, 0.0, 0.70653),
    ];
    for (ior, angle, tabulated) in table {
        let want = slab(fresnel(ior, f64::cos(f64::to_radians(angle))), 1.0);
        assert!((want - tabulated).abs() < 1e-5, "the formula gives {want}, the table {tabulated}");
        assert_transmittance(&format!("n = {ior} at {angle}"), &slab_scene(ior, [0.0; 3], angle), [want; 3]);
    }
}

#[test]
fn colours_of_glass() {
    let absorption = [5.0f64, 40.0, 200.0];
    let straight = absorption.map(|sigma| slab(fresnel(1.5, 1.0), (-sigma * 0.01).exp()));
    assert_transmittance("coloured", &slab_scene(1.5, absorption, 0.0), straight);
    let inside = (1.0 - (0.75f64.sqrt() / 1.5).powi(2)).sqrt();
    let aslant = absorption.map(|sigma| slab(fresnel(1.5, 0.5), (-sigma * 0.01 / inside).exp()));
    assert_transmittance("coloured, at 60 degrees", &slab_scene(1.5, absorption, 60.0), aslant);
    let filter = absorption.map(|sigma| (-sigma * 0.01).exp());
    assert_transmittance("a filter without faces", &slab_scene(1.0, absorption, 0.0), filter);
}

/// Sunlight through a slab: the flux that reaches the floor behind it as caustic.
#[test]
fn photons_through_a_slab() {
    for (angle, absorption) in [(0.0f64, [0.0f64; 3]), (60.0, [0.0; 3]), (45.0, [5.0, 40.0, 200.0])] {
        let (sine, cosine) = angle.to_radians().sin_cos();
        let text = format!(
            r#"
            [camera]
            eye = [0.0, -0.1, 0.0]
            at = [0.01, -1.0, 0.0]
            fov = 25.0

            [materials.glass]
            type = "dielectric"
            ior = 1.5
            absorption = {absorption:?}

            [materials.floor]
            type = "lambert"
            reflectance = 0.5

            [[shapes]]
            type = "quad"
            corner = [-3, 0.01, -3]
            edge-u = [0, 0, 6]
            edge-v = [6, 0, 0]
            material = "glass"

            [[shapes]]
            type = "quad"
            corner = [-3, 0, -3]
            edge-u = [6, 0, 0]
            edge-v = [0, 0, 6]
            material = "glass"

            [[shapes]]
            type = "quad"
            corner = [-3, -1, -3]
            edge-u = [0, 0, 6]
            edge-v = [6, 0, 0]
            material = "floor"

            [[lights]]
            type = "directional"
            direction = [{sine:?}, {:?}, 0.0]
            irradiance = 1.0
            "#,
            -cosine
        );
        let stage = Stage::new(&text, (32, 32));
        let inside = (1.0 - (sine / 1.5).powi(2)).sqrt();
        // The floor reflects half, the slab sends part of that back, which is no caustic: it was scattered.
        let transmitted =
            absorption.map(|sigma| cosine * slab(fresnel(1.5, cosine), (-sigma * 0.01 / inside).exp()));
        let radiance = transmitted.map(|e| 0.5 * e / PI);
        let settings = Overrides { spp: Some(4), caustic_photons: Some(1_000_000), ..show(MapKind::Caustic) };
        let shot = stage.shoot(&settings);
        assert_close(&format!("photons at {angle}"), shot.mean("caustics"), radiance, 0.01);
        let settings = Overrides {
            spp: Some(4),
            caustic_photons: Some(1_000_000),
            global_photons: Some(1000),
            ..photon_map()
        };
        let shot = stage.shoot(&settings);
        assert_close(&format!("photon map at {angle}"), shot.mean("caustics"), radiance, 0.01);
        assert_eq!(shot.mean("direct"), [0.0; 3]);
    }
}

/// Light and camera in an absorbing medium without index: its start is found by counting, and shadow rays lose as well.
#[test]
fn a_lamp_in_fogless_murk() {
    let text = r#"
        [media.murk]
        ior = 1
        absorption = [0.1, 0.5, 2.0]

        [camera]
        eye = [0.0, 1.5, 1.0]
        at = [0.0, 0.0, 0.0]
        fov = 0.1

        [materials.border]
        type = "dielectric"
        inside = "murk"

        [materials.floor]
        type = "lambert"
        reflectance = 0.5

        [[shapes]]
        type = "sphere"
        radius = 4.0
        material = "border"

        [[shapes]]
        type = "quad"
        corner = [-1, 0, -1]
        edge-u = [0, 0, 2]
        edge-v = [2, 0, 0]
        material = "floor"

        [[lights]]
        type = "point"
        position = [0.6, 0.8, 0.0]
        intensity = 1.0
    "#;
    let stage = Stage::new(text, (16, 16));
    let seen = 3.25f64.sqrt();
    let want = [0.1f64, 0.5, 2.0].map(|sigma| 0.5 / PI * 0.8 * (-sigma * (1.0 + seen)).exp());
    for settings in [
        Overrides { spp: Some(16), ..path() },
        Overrides { spp: Some(4), global_photons: Some(1000), caustic_photons: Some(1000), ..photon_map() },
    ] {
        let shot = stage.shoot(&settings);
        assert_close("murk", shot.mean("direct"), want, 1e-3);
        assert_eq!(shot.statistics.counters.medium_mismatches, 0);
    }
    let settings = Overrides { spp: Some(16), global_photons: Some(1_000_000), ..show(MapKind::Global) };
    let shot = stage.shoot(&settings);
    // One spot, so the noise of one estimate.
    assert_close("murk, photons", shot.mean("indirect"), want, 0.25);
}

/// A pool with mirrors for walls is as wide as the sea: sky of radiance 1 above, a grey floor below.
fn pool() -> Stage {
    let wall = |corner: &str, edge: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {edge}\nedge-v = [0, 0.5, 0]\n\
             material = \"mirror\"\n"
        )
    };
    let walls = [
        wall("[-0.5, 0, -0.5]", "[1, 0, 0]"),
        wall("[-0.5, 0, 0.5]", "[1, 0, 0]"),
        wall("[-0.5, 0, -0.5]", "[0, 0, 1]"),
        wall("[0.5, 0, -0.5]", "[0, 0, 1]"),
    ];
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 60.0, 0.0]
        at = [0.0, 0.0, 0.0]
        up = [0.0, 0.0, 1.0]
        fov = 0.7

        [materials.floor]
        type = "lambert"
        reflectance = [0.2, 0.5, 0.8]

        [materials.mirror]
        type = "mirror"

        [materials.water]
        type = "dielectric"
        ior = 1.33

        [[shapes]]
        type = "quad"
        corner = [-0.5, 0, -0.5]
        edge-u = [0, 0, 1]
        edge-v = [1, 0, 0]
        material = "floor"

        [[shapes]]
        type = "quad"
        corner = [-0.5, 0.5, -0.5]
        edge-u = [0, 0, 1]
        edge-v = [1, 0, 0]
        material = "water"

        {}

        [[lights]]
        type = "environment"
        radiance = 1.0
        "#,
        walls.concat()
    );
    Stage::new(&text, (16, 16))
}

#[test]
fn the_floor_of_a_pool() {
    const N: f64 = 1.33;
    // Hemispherical reflectance of the surface from above, and from below by reciprocity.
    let steps = 100_000;
    let from_above: f64 = (0..steps)
        .map(|i| {
            let sine_squared = (f64::from(i) + 0.5) / f64::from(steps);
            fresnel(N, (1.0 - sine_squared).sqrt()) / f64::from(steps)
        })
        .sum();
    let from_below = 1.0 - (1.0 - from_above) / (N * N);
    assert!((from_above - 0.0661).abs() < 3e-4, "{from_above}");
    let r = fresnel(N, 1.0);
    let want = [0.2, 0.5, 0.8].map(|rho| {
        let irradiance = PI * (1.0 - from_above) / (1.0 - rho * from_below);
        r + (1.0 - r) / (N * N) * rho * irradiance / PI
    });
    let stage = pool();
    let path = stage.shoot(&Overrides { spp: Some(1024), ..path() });
    assert_close("pool, path", path.mean("beauty"), want, 0.005);
    let settings = Overrides {
        spp: Some(64),
        global_photons: Some(300_000),
        caustic_photons: Some(500_000),
        ..photon_map()
    };
    let maps = stage.shoot(&settings);
    assert_close("pool, photon map", maps.mean("beauty"), want, 0.01);
    let settings = Overrides { spp: Some(64), global_photons: Some(500_000), ..show(MapKind::Global) };
    let shown = stage.shoot(&settings);
    assert_close("pool, photons", shown.mean("beauty"), want, 0.01);
    assert_eq!(maps.statistics.counters.medium_mismatches, 0);
}

/// A ray goes through a ball of glass as through a lens: `f = n R / (2 (n - 1))` from the centre for rays near the axis.
/// Whatever moves the start of a ray off a surface must not move it aside.
#[test]
fn focal_length_of_a_ball() {
    for (ior, radius) in [(1.5f64, 1.0f64), (1.33, 1.0), (1.9, 1.0), (1.5, 1e-3), (1.5, 1e4)] {
        let text = format!(
            "[camera]\neye = [0, 0, {0:?}]\nat = [0, 0, 0]\n[materials.glass]\ntype = \"dielectric\"\nior = {ior:?}\n\
             [[shapes]]\ntype = \"sphere\"\nradius = {radius:?}\nmaterial = \"glass\"\n",
            5.0 * radius
        );
        let stage = Stage::new(&text, (1, 1));
        let scene = stage.scene();
        let unit = scene.space().length(radius) as f32;
        let height = 0.01f32;
        let mut ray = Ray::new(Vec3::new(0.0, height, 3.0) * unit, Vec3::NEG_Z);
        let mut medium = scene.medium_at(ray.origin);
        for _ in 0..2 {
            let hit = scene.intersect(&ray).unwrap();
            let shading = hit.shading(scene.material(&hit));
            let sample = shading
                .bsdf
                .sample(shading.wo_local, ONE_MINUS_EPSILON, Vec2::ZERO, TransportMode::Flux)
                .unwrap();
            let direction = shading.frame.to_world(sample.wi);
            assert!(scene.mismatch(&hit, medium).is_none());
            medium = scene.medium_after(medium, &hit, &shading, direction, sample.transmission).unwrap();
            ray = hit.spawn(direction);
        }
        assert!(scene.intersect(&ray).is_none() && medium == MediumStack::AIR);
        // Exact for this height, by Snell's law: deviation 2 (i - t), and the way out through the sphere.
        let (sin_i, i) = (f64::from(height), f64::from(height).asin());
        let t = (sin_i / ior).asin();
        let deviation = 2.0 * (i - t);
        // Leaves at the angle 2t - i from the axis, and crosses it where the sine rule says.
        let exact = sin_i / deviation.sin();
        let paraxial = ior / (2.0 * (ior - 1.0));
        assert!((exact / paraxial - 1.0).abs() < 1e-3);
        let crossing = ray.origin.z - ray.origin.y * ray.direction.z / ray.direction.y;
        let focal_length = f64::from(-crossing / unit);
        println!("n = {ior}, R = {radius}: {focal_length:.6}, want {exact:.6}, near the axis {paraxial:.6}");
        assert!((focal_length / exact - 1.0).abs() < 5e-5, "{focal_length}, not {exact}");
    }
}
