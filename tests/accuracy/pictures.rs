//! The scenes of the project against reference pictures made by others, and the two ways of rendering against each other.

use crate::support::*;
use cardioid::image_io;
use cardioid::measure::{ErrorFigures, Picture, Reference};
use cardioid::render::{Overrides, Quality};
use std::path::Path;

/// The reference picture in its two halves.
pub(crate) fn reference(scene: &str) -> Reference {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(scene);
    let [first, second] = ["reference-1.exr", "reference-2.exr"].map(|name| {
        let image = image_io::read(folder.join(name)).unwrap();
        let layer = image.layer("").unwrap();
        let rgb = ["R", "G", "B"].map(|name| layer.channel_index(name).unwrap());
        let pixels = layer.data.chunks_exact(layer.channels.len());
        pixels.flat_map(|pixel| rgb.map(|channel| pixel[channel])).collect::<Vec<f32>>()
    });
    let view = |values| Picture::new(256, 256, values).unwrap();
    Reference::halves(view(&first), view(&second)).unwrap()
}

fn compare(scene: &str, what: &str, shot: &Shot) -> ErrorFigures {
    let (width, height) = (shot.developed.width, shot.developed.height);
    let figures =
        reference(scene).compare(Picture::new(width, height, shot.layer("beauty")).unwrap()).unwrap();
    let times = shot.statistics.times;
    println!(
        "{scene}, {what}: relmse_u {:.5}, relmse_t {:.5}, bias {:+.3} %, firefly {:.6}, flip {:.4}; {:.1} s + {:.1} s",
        figures.relmse_u.unwrap(),
        figures.relmse_t,
        figures.bias,
        figures.firefly,
        figures.flip,
        times.photons,
        times.pixels
    );
    assert_eq!(figures.nan, 0);
    figures
}

#[track_caller]
fn assert_photon_map(scene: &str, settings: &Overrides, bound: f64) {
    let shot = Stage::load(scene, (256, 256)).shoot(settings);
    let figures = compare(scene, "photon map", &shot);
    assert!(figures.relmse_u.unwrap() <= bound, "{scene}: relmse_u {}", figures.relmse_u.unwrap());
    assert!(figures.bias.abs() <= 1.0, "{scene}: bias {} %", figures.bias);
    assert_eq!(shot.statistics.warnings, [] as [String; 0]);
}

/// `final`, with fewer samples and photons: it must do with less than it has.
fn moderate() -> Overrides {
    Overrides {
        quality: Some(Quality::Final),
        spp: Some(8),
        caustic_photons: Some(1_000_000),
        ..photon_map()
    }
}

// What is asked for is 0.003, 0.008 and 0.06; what is found is several times better, and the bounds hold it there.

#[test]
fn photon_map_of_cornell_diffuse() {
    assert_photon_map("cornell-diffuse", &moderate(), 0.0015);
}

#[test]
fn photon_map_of_cornell_spheres() {
    assert_photon_map("cornell-spheres", &moderate(), 0.003);
}

#[test]
fn photon_map_of_cardioid() {
    assert_photon_map("cardioid", &moderate(), 0.006);
}

/// Luminance of the mean of a layer.
fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// Nothing but noise: four times the samples leave a quarter of the error, or less, since low-discrepancy points do
/// better than random ones where the picture is smooth.
#[test]
fn error_of_path_tracing_falls_with_samples() {
    let stage = Stage::load("cornell-diffuse", (256, 256));
    let error = |spp, seed| {
        let shot = stage.shoot(&Overrides { spp: Some(spp), seed: Some(seed), ..path() });
        let figures = compare("cornell-diffuse", &format!("path, {spp} spp"), &shot);
        assert!(figures.bias.abs() <= 0.5, "bias {} %", figures.bias);
        figures.relmse_u.unwrap()
    };
    let ratio = error(8, 0) / error(32, 1);
    println!("cornell-diffuse: ratio of errors {ratio:.3}");
    assert!((3.7..5.5).contains(&ratio), "error falls by {ratio}");
}

/// Where caustics make fireflies the error of a picture is that of a few pixels: the variance over seeds of the mean of
/// the whole picture says more, and its mean agrees with the reference.
#[test]
fn path_tracing_of_cornell_spheres() {
    let want = luminance(reference_mean("cornell-spheres"));
    let stage = Stage::load("cornell-spheres", (128, 128));
    let means: Vec<f64> = (0..8)
        .map(|seed| {
            luminance(stage.shoot(&Overrides { spp: Some(64), seed: Some(seed), ..path() }).mean("beauty"))
        })
        .collect();
    let mean = means.iter().sum::<f64>() / 8.0;
    let error = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 56.0).sqrt();
    println!(
        "cornell-spheres, path: off by {:+.4} % +- {:.4} %",
        100.0 * (mean / want - 1.0),
        100.0 * error / want
    );
    assert!(error < 0.0015 * want, "{error}");
    assert!((mean / want - 1.0).abs() < 0.005, "{mean}, not {want}");
}

fn reference_mean(scene: &str) -> [f64; 3] {
    let reference = reference(scene);
    let values = reference.picture().values();
    let pixels = (values.len() / 3) as f64;
    std::array::from_fn(|c| values.iter().skip(c).step_by(3).map(|&v| f64::from(v)).sum::<f64>() / pixels)
}

/// Means of the parts and the picture over `runs` seeds, as luminance, with their standard errors.
fn parts(stage: &Stage, settings: &Overrides, runs: u64) -> Vec<(&'static str, f64, f64)> {
    let shots: Vec<Shot> =
        (0..runs).map(|seed| stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() })).collect();
    let n = runs as f64;
    PARTS
        .into_iter()
        .chain(["beauty"])
        .map(|part| {
            let means: Vec<f64> = shots.iter().map(|shot| luminance(shot.mean(part))).collect();
            let mean = means.iter().sum::<f64>() / n;
            let squares: f64 = means.iter().map(|m| (m - mean).powi(2)).sum();
            (part, mean, (squares / (n * (n - 1.0))).sqrt())
        })
        .collect()
}

/// Each of the five parts of the picture has the same mean in both modes, within 1 % and what noise explains of the
/// rest; `certain` is the noise above which that would say nothing.
#[track_caller]
pub(crate) fn assert_same_parts(
    what: &str,
    stage: &Stage,
    (path, maps): (&Overrides, &Overrides),
    certain: f64,
) {
    let runs = 4;
    let mut off_parts = Vec::new();
    for ((part, a, a_error), (_, b, b_error)) in
        parts(stage, path, runs).into_iter().zip(parts(stage, maps, runs))
    {
        if a == 0.0 && b == 0.0 {
            continue;
        }
        let (off, noise) = (b / a - 1.0, a_error.hypot(b_error) / a);
        println!(
            "{what}, {part}: path {a:.6}, photon map {b:.6}, off by {:+.3} % +- {:.3} %",
            100.0 * off,
            100.0 * noise
        );
        assert!(noise < certain, "{what}, {part}: noise of {noise}");
        if off.abs() > 0.01 + 2.0 * noise {
            off_parts.push(part);
        }
    }
    assert!(off_parts.is_empty(), "{what}: {off_parts:?} are off");
}

/// With a quarter of the samples, since four runs are made.
fn for_parts() -> Overrides {
    Overrides { global_photons: Some(200_000), caustic_photons: Some(300_000), ..moderate() }
}

#[test]
fn parts_of_cornell_diffuse() {
    let path = Overrides { spp: Some(16), ..path() };
    assert_same_parts(
        "cornell-diffuse",
        &Stage::load("cornell-diffuse", (128, 128)),
        (&path, &for_parts()),
        0.003,
    );
}

/// By path tracing the caustics of this small lamp are known within 2 %.
#[test]
fn parts_of_cornell_spheres() {
    let path = Overrides { spp: Some(64), ..path() };
    assert_same_parts(
        "cornell-spheres",
        &Stage::load("cornell-spheres", (128, 128)),
        (&path, &for_parts()),
        0.04,
    );
}

/// With a lamp of 54 times the area and a 54th of the radiance, which a path finds 54 times as often.
#[test]
fn parts_of_cornell_spheres_under_a_large_lamp() {
    let text = std::fs::read_to_string(scene_path("cornell-spheres")).unwrap();
    let small =
        "corner = [308.0, 548.7000122070312, 249.5]\nedge-u = [0.0, 0.0, 60.0]\nedge-v = [-60.0, 0.0, 0.0]";
    let large =
        "corner = [498.0, 548.7000122070312, 59.5]\nedge-u = [0.0, 0.0, 440.0]\nedge-v = [-440.0, 0.0, 0.0]";
    let bright = "[64.45833333333333, 45.5, 15.166666666666666]";
    assert!(text.contains(small) && text.contains(bright));
    let text = text.replace(small, large).replace(bright, "[1.2, 0.85, 0.28]");
    let path = Overrides { spp: Some(48), ..path() };
    assert_same_parts("large lamp", &Stage::new(&text, (128, 128)), (&path, &for_parts()), 0.01);
}

/// Shading normals far from the geometric ones: photons take the adjoint factor, so that both modes agree.
#[test]
fn parts_with_shading_normals() {
    let text = r#"
        [camera]
        eye = [0.0, 0.3, 0.95]
        at = [0.0, -0.3, 0.0]
        fov = 60.0

        [materials.paint]
        type = "lambert"
        reflectance = 0.6

        [materials.glass]
        type = "dielectric"
        ior = 1.3

        [[shapes]]
        type = "mesh"
        vertices = [[-1,-1,-1], [1,-1,-1], [1,1,-1], [-1,1,-1], [-1,-1,1], [1,-1,1], [1,1,1], [-1,1,1]]
        faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
        material = "paint"

        [[shapes]]
        name = "an octahedron that would like to be a ball"
        type = "mesh"
        vertices = [[1,0,0], [-1,0,0], [0,1,0], [0,-1,0], [0,0,1], [0,0,-1]]
        faces = [[0,2,4], [2,1,4], [1,3,4], [3,0,4], [2,0,5], [1,2,5], [3,1,5], [0,3,5]]
        normals = "smooth"
        material = "paint"
        transform = [{ scale = 0.5 }, { translate = [-0.3, -0.4, 0.0] }]

        [[shapes]]
        type = "quad"
        corner = [-0.4, 0.95, -0.4]
        edge-u = [0.8, 0, 0]
        edge-v = [0, 0, 0.8]
        material = "paint"
        emission = { radiance = 2.0 }
    "#;
    let path = Overrides { spp: Some(40), ..path() };
    assert_same_parts("smooth octahedron", &Stage::new(text, (96, 96)), (&path, &for_parts()), 0.01);
}
