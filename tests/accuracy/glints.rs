//! Lamps smaller than a pixel, in glass and mirrors and behind edges: their mean is what it is, with less noise.

use crate::support::*;
use cardioid::render::Overrides;
use std::f64::consts::PI;

/// A mirror ball, or one of glass, of radius 1 at the origin, a lamp of radiance 5, 400 away at an angle from the z axis, and a camera on
/// that, 300 away.
fn ball(material: &str, lamp_angle: f64, lamp_radius: f64, fov: f64) -> Stage {
    let (sin, cos) = lamp_angle.to_radians().sin_cos();
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 0.0, 300.0]
        at = [0.0, 0.0, 0.0]
        fov = {fov:?}

        [materials.mirror]
        type = "mirror"
        reflectance = 0.5

        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [[shapes]]
        type = "sphere"
        center = [0.0, 0.0, 0.0]
        radius = 1.0
        material = "{material}"

        [[shapes]]
        name = "lamp"
        type = "sphere"
        center = [{:?}, {:?}, {:?}]
        radius = {lamp_radius:?}
        emission = {{ radiance = 5.0 }}
        "#,
        // So that no image lies on the border of pixels.
        400.0 * sin * 0.96,
        400.0 * sin * 0.28,
        400.0 * cos
    );
    Stage::new(&text, (8, 8))
}

fn with_glints(of: Overrides, glints: bool, spp: u32, seed: u64) -> Overrides {
    Overrides { glints: Some(glints), spp: Some(spp), seed: Some(seed), ..of }
}

/// Mean of the specular part over the picture, in each of some pictures.
fn means(stage: &Stage, settings: impl Fn(u64) -> Overrides) -> Vec<f64> {
    (0..8).map(|seed| stage.shoot(&settings(seed)).mean("specular")[0]).collect()
}

/// Mean and standard deviation of one.
fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

/// A convex mirror of radius a shows a far lamp under a quarter of a^2 times its solid angle, over the square of its own distance,
/// whatever the angle between lamp and camera.
#[test]
fn a_lamp_in_a_mirror_ball_is_as_bright_as_its_image() {
    let fov = 0.5f64;
    for angle in [20.0, 60.0, 110.0] {
        let stage = ball("mirror", angle, 2.0, fov);
        let picture = (2.0 * (fov.to_radians() / 2.0).tan()).powi(2);
        let lamp = PI * (2.0f64 / 400.0).powi(2);
        let want = 0.5 * 5.0 * lamp * 0.25 / 300f64.powi(2) / picture;
        for (name, of) in [("path", path()), ("photon map", photon_map())] {
            let (mean, deviation) = moments(&means(&stage, |seed| with_glints(of.clone(), true, 64, seed)));
            println!("{name}, {angle} degrees: {mean} +- {deviation}, want {want}");
            // Three standard errors of means of 16 samples; by chance 500 pictures of them would find it once.
            assert!((mean / want - 1.0).abs() < 0.1, "{name}, {angle} degrees: {mean}, want {want}");
            assert!(deviation < 0.15 * want);
        }
    }
}

/// In glass there are images by two, three and four surfaces and more, which no closed form has at hand: many paths do.
#[test]
fn glints_have_the_mean_of_chance_and_less_noise() {
    let stage = ball("glass", 35.0, 50.0, 0.5);
    let (found, deviation) = moments(&means(&stage, |seed| with_glints(path(), true, 256, seed)));
    let (mapped, _) = moments(&means(&stage, |seed| with_glints(photon_map(), true, 256, seed)));
    let (chance, error) = moments(&means(&stage, |seed| with_glints(path(), false, 65536, 100 + seed)));
    let error = error / 8f64.sqrt();
    println!("found {found} +- {deviation}, {mapped}; by chance {chance}, standard error {error}");
    assert!(error < 0.04 * chance);
    assert!((found - chance).abs() < 3.5 * error.hypot(deviation / 8f64.sqrt()));
    let (_, of_mapped) = moments(&means(&stage, |seed| with_glints(photon_map(), true, 256, 50 + seed)));
    assert!((mapped - chance).abs() < 3.5 * error.hypot(of_mapped / 8f64.sqrt()));
    // The 256th part of the samples by chance would have 16 times the deviation.
    assert!(deviation < 0.4 * 16.0 * error * 8f64.sqrt());
}

/// A filter with negative lobes weighs further samples by what it is where they are.
#[test]
fn every_filter_keeps_the_light_of_glints() {
    use cardioid::film::Filter;
    let stage = ball("mirror", 60.0, 2.0, 0.5);
    let mean = |filter| {
        let mut request = stage.request(&with_glints(path(), true, 256, 1));
        request.filter = filter;
        stage.shoot_request(&request).mean("specular")[0]
    };
    let want = mean(Filter::default());
    for filter in [
        Filter::Box { radius: 1.5 },
        Filter::Tent { radius: 1.0 },
        Filter::Gaussian { radius: 1.5, sigma: 0.5 },
        Filter::Mitchell { radius: 2.0 },
    ] {
        let found = mean(filter);
        println!("{filter:?}: {found}, want {want}");
        assert!((found / want - 1.0).abs() < 0.06, "{filter:?}: {found}, want {want}");
    }
}

/// Light that chance brings rarely counts for no more than its image, how often that was is told, and paths leave nothing out.
#[test]
fn a_rare_lamp_is_no_white_dot() {
    let stage = Stage::load("cognac", (96, 72));
    let few = Overrides { caustic_photons: Some(3000), global_photons: Some(1000), ..photon_map() };
    let rare = |shot: &Shot| shot.statistics.counters.rare_glints;
    let brightest = |shot: &Shot| shot.layer("specular").iter().copied().fold(0.0, f32::max);
    let (mut dimmed, mut shown, mut by_chance) = (0, 0f32, 0f32);
    for seed in 0..4 {
        let found = stage.shoot(&with_glints(few.clone(), true, 16, seed));
        let chance = stage.shoot(&with_glints(few.clone(), false, 16, seed));
        assert_eq!(rare(&chance), 0);
        dimmed += rare(&found);
        shown = shown.max(brightest(&found));
        by_chance = by_chance.max(brightest(&chance));
    }
    println!("{dimmed} dimmed; brightest {shown}, by chance {by_chance}");
    assert!(dimmed > 0);
    assert!(shown < 0.8 * by_chance, "brightest {shown}, by chance {by_chance}");
    assert_eq!(rare(&stage.shoot(&with_glints(path(), true, 16, 0))), 0);
}

/// The sliver of a lamp behind a screen: as bright as it is wide, with less noise than a sixteenth as many samples have.
#[test]
fn the_sliver_of_a_lamp_is_as_wide_as_it_is() {
    // The lamp is a square of side 0.2, of which the screen leaves the right hundredth; the picture is 2.4 wide there.
    let stage = Stage::new(
        r#"
        [camera]
        eye = [0.0, 0.0, 10.0]
        at = [0.0, 0.0, 0.0]
        fov = 13.685498

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [[shapes]]
        type = "quad"
        corner = [-0.1, -0.1, 0.0]
        edge-u = [0.2, 0.0, 0.0]
        edge-v = [0.0, 0.2, 0.0]
        emission = { radiance = 100.0 }

        [[shapes]]
        type = "quad"
        corner = [-1.0, -1.0, 0.0001]
        edge-u = [1.098, 0.0, 0.0]
        edge-v = [0.0, 2.0, 0.0]
        material = "black"
        "#,
        (8, 8),
    );
    let want = 100.0 * 0.002 * 0.2 / 2.4f64.powi(2);
    for of in [path(), photon_map()] {
        let emission = |seed| stage.shoot(&with_glints(of.clone(), true, 16, seed)).mean("emission")[0];
        let (mean, deviation) = moments(&(0..16).map(emission).collect::<Vec<_>>());
        println!("{mean} +- {deviation}, want {want}");
        assert!((mean / want - 1.0).abs() < 0.15);
        // Of chance, 1024 samples of which one in 14400 finds it: a deviation of 3.7 times the mean.
        assert!(deviation < 1.2 * want);
    }
}

/// Images of a thousandth of a pixel, where pixels are counted in thousands: single precision would round the one to the other.
#[test]
fn a_minute_glint_far_from_the_corner_is_as_bright_as_its_image() {
    let fov = 20f64;
    let stage = ball("mirror", 20.0, 0.008, fov);
    let mut request = stage.request(&with_glints(photon_map(), true, 16, 0));
    (request.width, request.height) = (4096, 4096);
    request.crop = Some(cardioid::film::PixelRect { x0: 2040, y0: 2036, x1: 2064, y1: 2060 });
    let crop = (2.0 * (fov.to_radians() / 2.0).tan() * 24.0 / 4096.0).powi(2);
    let lamp = PI * (0.008f64 / 400.0).powi(2);
    let want = 0.5 * 5.0 * lamp * 0.25 / 300f64.powi(2) / crop;
    let shoot = |seed| {
        request.settings.seed = seed;
        stage.shoot_request(&request).mean("specular")[0]
    };
    let (mean, deviation) = moments(&(0..8).map(shoot).collect::<Vec<_>>());
    println!("{mean} +- {deviation}, want {want}");
    assert!((mean / want - 1.0).abs() < 0.15, "{mean}, want {want}");
    assert!(deviation < 0.3 * want);
}

/// A lamp that a ball mirrors onto a glossy floor: the light that chance brings, with less noise.
#[test]
fn lamps_that_mirrors_show_to_a_glossy_floor_keep_their_light() {
    let stage = Stage::new(
        r#"
        [camera]
        eye = [3.0, 1.2, 0.0]
        at = [0.5, 0.0, 0.0]
        fov = 10.0

        [materials.gloss]
        type = "ward"
        diffuse = 0.0
        specular = 0.8
        roughness = 0.3

        [materials.mirror]
        type = "mirror"
        reflectance = 0.9

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [[shapes]]
        type = "quad"
        corner = [-2.0, 0.0, -2.0]
        edge-u = [0.0, 0.0, 4.0]
        edge-v = [4.0, 0.0, 0.0]
        material = "gloss"

        [[shapes]]
        type = "sphere"
        center = [-0.5, 0.7, 0.0]
        radius = 0.5
        material = "mirror"

        # The floor does not see the lamp itself.
        [[shapes]]
        type = "quad"
        corner = [-4.0, 0.0, 2.0]
        edge-u = [8.0, 0.0, 0.0]
        edge-v = [0.0, 0.6, 0.0]
        material = "black"

        [[shapes]]
        name = "lamp"
        type = "sphere"
        center = [-0.5, 0.7, 4.0]
        radius = 0.3
        emission = { radiance = 100.0 }
        "#,
        (16, 16),
    );
    let shots = |glints: bool, spp: u32| -> Vec<f64> {
        (0..16)
            .map(|seed| {
                let settings = with_glints(photon_map(), glints, spp, seed);
                stage.shoot(&settings).mean("specular")[0]
            })
            .collect()
    };
    let (chance, by_chance) = moments(&shots(false, 512));
    let (mean, deviation) = moments(&shots(true, 64));
    // Of as many samples by chance.
    let alone = by_chance * 8f64.sqrt();
    println!("{mean} +- {deviation}; {chance} +- {alone} by chance");
    assert!((mean / chance - 1.0).abs() < 0.1, "{mean}, by chance {chance}");
    assert!(deviation < 0.5 * alone, "{deviation}, by chance {alone}");
}

/// In a closed box of perfect mirrors every way leads to the lamp sooner or later, so its radiance is that of the lamp all over.
/// Each image of the lamp is small, and behind a chain of its own; but that one is met is not rare.
#[test]
fn a_box_of_mirrors_is_as_bright_as_its_lamp() {
    let text = r#"
        [camera]
        eye = [0.2, 0.1, 0.8]
        at = [-0.3, -0.2, -1.0]
        fov = 60.0

        [materials.mirror]
        type = "mirror"
        reflectance = 1.0

        [[shapes]]
        type = "box"
        min = [-1, -1, -1]
        max = [1, 1, 1]
        material = "mirror"

        [[shapes]]
        name = "lamp"
        type = "sphere"
        center = [0.3, 0.2, -0.1]
        radius = 0.3
        emission = { radiance = 1.0 }
        "#;
    let stage = Stage::new(text, (16, 16));
    for (name, of, spp, seeds) in
        [("path", path(), 4, 12), ("photon map", photon_map(), 4, 12), ("photon map", photon_map(), 16, 4)]
    {
        let means: Vec<f64> = (1..=seeds)
            .map(|seed| stage.shoot(&with_glints(of.clone(), true, spp, seed)).mean("beauty")[0])
            .collect();
        let (mean, deviation) = moments(&means);
        // Roulette along chains leaves 1.5 % of noise in four samples, 0.4 % in the mean of all seeds.
        println!("{name}, {spp} samples: {mean}, one seed by {deviation}");
        assert!((mean - 1.0).abs() < 0.02, "{name}, {spp} samples: {mean}");
    }
}
