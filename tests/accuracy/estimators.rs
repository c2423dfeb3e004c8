//! Density estimates in whole scenes: what they cost and what they leave out.

use crate::pictures::reference;
use crate::support::*;
use cardioid::render::{MapKind, Overrides};
use glam::DVec3;

/// A lens, a ball of glass of a millimetre under a small lamp, at `place` of a ground plane `size` metres wide.
fn jewel(size: f64, place: [f64; 2]) -> Stage {
    let half = 0.5 * size;
    let [x, z] = place;
    let text = format!(
        r#"
        [camera]
        eye = [{x}, 0.006, {eye_z}]
        at = [{x}, 0.0, {z}]
        fov = 30.0

        [materials.ground]
        type = "lambert"
        reflectance = 0.5

        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [[shapes]]
        name = "ground"
        type = "quad"
        corner = [-{half}, 0.0, {half}]
        edge-u = [{size}, 0, 0]
        edge-v = [0, 0, -{size}]
        material = "ground"

        [[shapes]]
        name = "jewel"
        type = "sphere"
        center = [{x}, 0.001, {z}]
        radius = 0.0005
        material = "glass"

        [[lights]]
        type = "point"
        position = [{x}, 0.01, {z}]
        intensity = 1.0
        "#,
        eye_z = z + 0.004,
    );
    Stage::new(&text, (48, 48))
}

/// A large plane under a small caustic changes neither its light nor the work of a look-up: positions are as fine as
/// where they are allows, not as the far end of the scene does.
#[test]
fn a_jewel_on_a_plane_of_a_kilometre() {
    let settings = Overrides { caustic_photons: Some(100_000), spp: Some(16), ..show(MapKind::Caustic) };
    let run = |what: &str, stage: &Stage| {
        let shot = stage.shoot(&settings);
        let counters = shot.statistics.counters;
        let visited = counters.photons_visited as f64 / counters.caustic_lookups as f64;
        println!(
            "{what}: {:?}, {visited:.0} photons a look-up, {:?}",
            shot.mean("caustics"),
            stage.built.warnings
        );
        (shot.mean("caustics"), visited, shot)
    };
    let (light, visited, _) = run("a metre", &jewel(1.0, [0.0, 0.0]));
    assert!(light[0] > 0.0);
    // In the middle, and away from it, where the origin of render space has to move.
    for (what, place) in [("a kilometre", [0.0, 0.0]), ("a kilometre, aside", [250.0, 125.0])] {
        let stage = jewel(1000.0, place);
        assert!(stage.built.warnings.is_empty());
        let (other, more, _) = run(what, &stage);
        assert_close(what, other, light, 0.01);
        assert!((more / visited - 1.0).abs() < 0.1, "{what}: {more} photons a look-up, not {visited}");
    }
}

/// Two jewels at far ends cannot both be fine; the one that is not is named.
#[test]
fn what_is_too_small_where_it_stands_is_named() {
    let stage = Stage::new(
        r#"
        [camera]
        eye = [0.0, 10.0, 10.0]
        at = [0.0, 0.0, 0.0]
        fov = 30.0

        [materials.paint]
        type = "lambert"
        reflectance = 0.5

        [[shapes]]
        name = "left"
        type = "sphere"
        center = [-500.0, 0.0, 0.0]
        radius = 0.0005
        material = "paint"

        [[shapes]]
        name = "right"
        type = "sphere"
        center = [500.0, 0.0, 0.0]
        radius = 0.0005
        material = "paint"

        [[lights]]
        type = "point"
        position = [0.0, 10.0, 0.0]
        power = 1.0
        "#,
        (8, 8),
    );
    let warnings = &stage.built.warnings;
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].message.starts_with("right is small"), "{}", warnings[0].message);
}

const ROUND_THINGS: &str = r#"
    [camera]
    eye = [0.0, 1.6, 3.2]
    at = [0.0, 0.5, 0.0]
    fov = 40.0

    [materials.paint]
    type = "lambert"
    reflectance = 0.7

    [[shapes]]
    type = "mesh"
    vertices = [[-2,0,-2], [2,0,-2], [2,3,-2], [-2,3,-2], [-2,0,4], [2,0,4], [2,3,4], [-2,3,4]]
    faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
    material = "paint"

    [[shapes]]
    name = "ball"
    type = "sphere"
    center = [-0.6, 0.4, 0.0]
    radius = 0.4
    material = "paint"

    [[shapes]]
    name = "pillar"
    type = "cylinder"
    base = [0.6, 0.0, 0.0]
    top = [0.6, 0.9, 0.0]
    radius = 0.25
    material = "paint"

    [[shapes]]
    type = "quad"
    corner = [-0.5, 2.95, -0.5]
    edge-u = [1.0, 0, 0]
    edge-v = [0, 0, 1.0]
    material = "paint"
    emission = { radiance = 5.0 }
"#;

/// Luminance of the mean of a layer over the pixels of one object, by its number.
fn over_object(shot: &Shot, layer: &str, object: u32) -> f64 {
    let objects = &shot.developed.layer("object").unwrap().values;
    let values = shot.layer(layer);
    let (mut sum, mut count) = (0.0, 0.0);
    for (pixel, _) in objects.iter().enumerate().filter(|(_, id)| **id == object as f32) {
        sum += (0..3).map(|c| f64::from(values[3 * pixel + c])).sum::<f64>() / 3.0;
        count += 1.0;
    }
    assert!(count > 100.0, "object {object} has {count} pixels");
    sum / count
}

/// Indirect light on a ball and a pillar, and on the room around them, as path tracing has it.
#[test]
fn indirect_light_of_round_things() {
    let stage = Stage::new(ROUND_THINGS, (48, 48));
    let shoot = |settings: &Overrides, seed| stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() });
    let maps = Overrides { spp: Some(16), ..photon_map() };
    let paths = Overrides { spp: Some(96), ..path() };
    let shots: Vec<[Shot; 2]> = (0..3).map(|seed| [shoot(&maps, seed), shoot(&paths, seed)]).collect();
    for (object, name) in ["room", "ball", "pillar"].into_iter().enumerate() {
        let ratios: Vec<f64> = shots
            .iter()
            .map(|[a, b]| {
                over_object(a, "indirect", object as u32) / over_object(b, "indirect", object as u32)
            })
            .collect();
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        println!("{name}: off by {:+.2} %, {ratios:.4?}", 100.0 * (mean - 1.0));
        assert!((mean - 1.0).abs() < 0.01, "{name}: {mean}");
    }
}

/// The foot of the ring, where the plane on both sides is one and the light is not: the visible kernel lets none
/// through, and does not darken either.
#[test]
fn no_leak_at_the_foot_of_the_ring() {
    const SIZE: usize = 256;
    let stage = Stage::load("cardioid", (SIZE as u32, SIZE as u32));
    let shot = stage.shoot(&Overrides {
        spp: Some(4),
        gather_samples: Some(2),
        global_photons: Some(50_000),
        ..photon_map()
    });
    let objects = &shot.developed.layer("object").unwrap().values;
    let reference = reference("cardioid");
    let (picture, wanted) = (shot.layer("beauty"), reference.picture().values());
    // The camera of the scene file, in millimetres.
    let eye = DVec3::new(60.0, 380.0, -230.0);
    let ahead = (DVec3::new(0.0, 10.0, 0.0) - eye).normalize();
    let right = ahead.cross(DVec3::Y).normalize();
    let up = right.cross(ahead);
    let half = 17f64.to_radians().tan();
    let on_floor = |x: f64, y: f64| {
        let [u, v] = [2.0 * x / SIZE as f64 - 1.0, 1.0 - 2.0 * y / SIZE as f64];
        let direction = ahead + right * (u * half) + up * (v * half);
        let p = eye - direction * (eye.y / direction.y);
        p.x.hypot(p.z)
    };
    for (side, from, to) in [("inside", 95.0, 100.0), ("outside", 100.0, 105.0)] {
        let (mut found, mut want, mut pixels) = (0.0, 0.0, 0);
        for (y, x) in (1..SIZE - 1).flat_map(|y| (1..SIZE - 1).map(move |x| (y, x))) {
            let is_floor = |dy: usize, dx: usize| objects[(y + dy - 1) * SIZE + x + dx - 1] == 0.0;
            let corners =
                [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(j, i)| on_floor((x + i) as f64, (y + j) as f64));
            if corners.iter().all(|r| (from..to).contains(r))
                && (0..3).all(|dy| (0..3).all(|dx| is_floor(dy, dx)))
            {
                let sum =
                    |values: &[f32]| (0..3).map(|c| f64::from(values[3 * (y * SIZE + x) + c])).sum::<f64>();
                (found, want, pixels) = (found + sum(picture), want + sum(wanted), pixels + 1);
            }
        }
        println!("{side}: off by {:+.3} % over {pixels} pixels", 100.0 * (found / want - 1.0));
        assert!(pixels > 300, "{side}: {pixels} pixels");
        assert!((found / want - 1.0f64).abs() <= 0.03, "{side}: {found}, not {want}");
    }
}
