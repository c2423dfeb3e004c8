//! Glossy surfaces: each part of the picture has the same mean by photon maps and distribution rays as by path tracing.

use crate::pictures::assert_same_parts;
use crate::support::*;
use cardioid::render::Overrides;

/// A closed box under a large lamp, with a floor and a ball of these materials.
fn box_with(floor: &str, balls: &[(&str, [f64; 3], f64)]) -> Stage {
    let mut text = format!(
        r#"
        [camera]
        eye = [0.0, 1.0, 0.95]
        at = [0.0, 0.7, 0.0]
        fov = 75.0

        [materials.white]
        type = "lambert"
        reflectance = 0.6

        [materials.red]
        type = "lambert"
        reflectance = [0.6, 0.1, 0.1]

        [materials.floor]
        {floor}

        [[shapes]]
        type = "quad"
        corner = [-1, 0, 1]
        edge-u = [2, 0, 0]
        edge-v = [0, 0, -2]
        material = "floor"

        [[shapes]]
        type = "mesh"
        vertices = [[-1,0,-1], [1,0,-1], [1,2,-1], [-1,2,-1], [-1,0,1], [1,0,1], [1,2,1], [-1,2,1]]
        faces = [[0,1,2,3], [4,7,6,5], [3,2,6,7], [1,5,6,2]]
        material = "white"

        [[shapes]]
        type = "mesh"
        vertices = [[-1,0,-1], [-1,2,-1], [-1,0,1], [-1,2,1]]
        faces = [[0,1,3,2]]
        material = "red"

        [[shapes]]
        name = "lamp"
        type = "quad"
        corner = [-0.7, 1.99, -0.7]
        edge-u = [1.4, 0, 0]
        edge-v = [0, 0, 1.4]
        emission = {{ radiance = 2.0 }}
        "#
    );
    for (index, (material, center, radius)) in balls.iter().enumerate() {
        text += &format!(
            "\n[materials.ball-{index}]\n{material}\n[[shapes]]\ntype = \"sphere\"\ncenter = {center:?}\nradius = \
             {radius}\nmaterial = \"ball-{index}\"\n"
        );
    }
    Stage::new(&text, (32, 32))
}

/// Caustics are what path tracing is noisy in: `certain` is allowed there.
fn assert_agreement(what: &str, stage: &Stage, spp: u32, certain: f64) {
    let path = Overrides { spp: Some(spp), ..path() };
    let maps = Overrides {
        spp: Some(12),
        // The estimates of slightly glossy balls are low by curvature in proportion to the area they span: 2.4 % with 80
        // of 60 000 photons, 0.7 % with 40 of 300 000.
        global_photons: Some(400_000),
        global_nearest: Some(30),
        caustic_photons: Some(250_000),
        ..photon_map()
    };
    assert_same_parts(what, stage, (&path, &maps), certain);
}

const WHITE: &str = "type = \"lambert\"\nreflectance = 0.6";

/// A highly glossy lobe beside a diffuse one, and all three lobes of the sphere flake of Jensen 1996.
#[test]
fn parts_of_a_ward_floor_under_a_schlick_ball() {
    let floor = "type = \"ward\"\ndiffuse = [0.3, 0.25, 0.2]\nspecular = 0.4\nroughness = [0.1, 0.2]\ntangent = [1, 0, 0]";
    let ball = "type = \"schlick\"\ncolour = [0.8, 0.6, 0.3]\nroughness = 0.1";
    let stage = box_with(floor, &[(ball, [0.0, 0.55, -0.3], 0.45)]);
    assert_agreement("Ward floor, Schlick ball", &stage, 112, 0.02);
}

/// Both sides of the threshold: roughness 0.1 is traced, 0.4 read from the maps.
#[test]
fn parts_of_two_golden_balls() {
    let gold = |roughness: f64| format!("type = \"conductor\"\nmetal = \"gold\"\nroughness = {roughness}");
    let balls = [(gold(0.1), [-0.45, 0.45, -0.3], 0.4), (gold(0.4), [0.45, 0.45, -0.3], 0.4)];
    let balls: Vec<_> =
        balls.iter().map(|(text, center, radius)| (text.as_str(), *center, *radius)).collect();
    assert_agreement("golden balls", &box_with(WHITE, &balls), 256, 0.02);
}

/// Caustics of glass are what paths are noisiest in.
#[test]
fn parts_of_a_rough_glass_ball() {
    let glass = "type = \"dielectric\"\nior = 1.5\nroughness = 0.2";
    let stage = box_with(WHITE, &[(glass, [0.0, 0.55, -0.3], 0.45)]);
    assert_agreement("rough glass", &stage, 256, 0.02);
}

/// A roughness too small to be told from none gives the very picture of the smooth material; the smallest that is rough
/// comes close to it.
#[test]
fn rough_goes_over_to_smooth() {
    let settings = |spp| Overrides { spp: Some(spp), ..path() };
    let shot = |ball: &str, spp| box_with(WHITE, &[(ball, [0.0, 0.55, -0.3], 0.45)]).shoot(&settings(spp));
    // The lamp is seen in glass by four rays in a hundred.
    let glass =
        |roughness: &str| shot(&format!("type = \"dielectric\"\nior = 1.5\nroughness = {roughness}"), 384);
    let smooth = shot("type = \"dielectric\"\nior = 1.5", 384);
    assert_eq!(glass("1e-8").layer("beauty"), smooth.layer("beauty"));
    let metal =
        |roughness: &str| shot(&format!("type = \"conductor\"\ncolour = 0.9\nroughness = {roughness}"), 32);
    let mirror = metal("0.0");
    assert_eq!(metal("1e-8").layer("beauty"), mirror.layer("beauty"));
    for (almost, ideal) in [(glass("1e-4"), smooth), (metal("1e-4"), mirror)] {
        assert_close("specular", almost.mean("specular"), ideal.mean("specular"), 0.03);
    }
}

/// Roughness decides how a surface is computed, and so what it costs: from highly glossy to slightly glossy, by distribution rays or
/// among gather rays, the rays for a camera sample change little by little.
#[test]
fn rays_of_a_sample_change_smoothly_with_roughness() {
    /// From one roughness to the next, more or fewer.
    const STEP: f64 = 2.0;
    for specular in [0.05, 0.2, 0.7] {
        let rays: Vec<(f64, f64)> = (8..=20)
            .map(|step| {
                // Those of glTF, whose square is alpha; the threshold is at 0.592.
                let roughness = 0.05 * f64::from(step);
                let floor = format!(
                    "type = \"ward\"\nspecular = {specular}\ndiffuse = {}\nroughness = {:?}",
                    0.75 - specular,
                    roughness * roughness
                );
                let stage = box_with(&floor, &[(&floor, [0.2, 0.4, 0.1], 0.35)]);
                let few = Overrides {
                    spp: Some(4),
                    global_photons: Some(20_000),
                    caustic_photons: Some(20_000),
                    ..photon_map()
                };
                let shot = stage.shoot(&few);
                let counters = &shot.statistics.counters;
                let rays = counters.camera_rays
                    + counters.specular_rays
                    + counters.glossy_rays
                    + counters.approximate_rays
                    + counters.shadow_rays
                    + counters.gather_rays;
                (roughness, rays as f64 / counters.camera_rays as f64)
            })
            .collect();
        println!("specular {specular}: {rays:.2?}");
        for pair in rays.windows(2) {
            let ratio = pair[1].1 / pair[0].1;
            assert!(ratio < STEP && ratio > 1.0 / STEP, "specular {specular}: {pair:?}");
        }
    }
}
