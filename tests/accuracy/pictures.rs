//! The scenes of the project against reference pictures made by others, and the two ways of rendering against each other.

use crate::support::*;
use cardioid::image_io;
use cardioid::measure::{ErrorFigures, Picture, Reference};
use cardioid::render::{Overrides, Quality};
use std::path::Path;

/// The reference picture in its two halves.
fn reference(scene: &str) -> Reference {
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
    Overrides { quality: Some(Quality::Final), spp: Some(16), caustic_photons: Some(2_000_000), ..PHOTON_MAP }
}

#[test]
fn photon_map_of_cornell_diffuse() {
    assert_photon_map("cornell-diffuse", &moderate(), 0.003);
}

#[test]
fn photon_map_of_cornell_spheres() {
    assert_photon_map("cornell-spheres", &moderate(), 0.008);
}

#[test]
fn photon_map_of_cardioid() {
    assert_photon_map("cardioid", &moderate(), 0.06);
}

/// Error of the path tracer: nothing but noise, so four times the samples leave a quarter of it.
#[track_caller]
fn assert_path(scene: &str, spp: u32, error: impl Fn(&ErrorFigures) -> f64, band: (f64, f64)) {
    let stage = Stage::load(scene, (256, 256));
    let few =
        compare(scene, &format!("path, {spp} spp"), &stage.shoot(&Overrides { spp: Some(spp), ..PATH }));
    let shot = stage.shoot(&Overrides { spp: Some(4 * spp), seed: Some(1), ..PATH });
    let many = compare(scene, &format!("path, {} spp", 4 * spp), &shot);
    let ratio = error(&few) / error(&many);
    println!("{scene}: ratio of errors {ratio:.3}");
    assert!((band.0..band.1).contains(&ratio), "{scene}: error falls by {ratio}");
    assert!(many.bias.abs() <= 0.5, "{scene}: bias {} %", many.bias);
}

#[test]
fn path_tracing_of_cornell_diffuse() {
    assert_path("cornell-diffuse", 4, |figures| figures.relmse_u.unwrap(), (3.4, 4.6));
}

#[test]
fn path_tracing_of_cornell_spheres() {
    assert_path("cornell-spheres", 8, |figures| figures.relmse_u.unwrap(), (3.0, 5.3));
}

/// Each of the five parts of the picture has the same mean in both modes.
#[track_caller]
fn assert_same_parts(scene: &str, path: &Overrides, maps: &Overrides, tolerance: f64) {
    let stage = Stage::load(scene, (128, 128));
    let (path, maps) = (stage.shoot(path), stage.shoot(maps));
    println!(
        "{scene}: path {:.1} s, photon map {:.1} s",
        path.statistics.times.pixels,
        maps.statistics.times.photons + maps.statistics.times.pixels
    );
    let mut off = Vec::new();
    for part in PARTS.into_iter().chain(["beauty"]) {
        let (a, b) = (luminance(path.mean(part)), luminance(maps.mean(part)));
        if a == 0.0 && b == 0.0 {
            continue;
        }
        println!("{scene}, {part}: path {a:.6}, photon map {b:.6}, off by {:+.3} %", 100.0 * (b / a - 1.0));
        println!("    {:?} {:?}", path.mean(part), maps.mean(part));
        if (b / a - 1.0).abs() > tolerance {
            off.push(part);
        }
    }
    assert!(off.is_empty(), "{scene}: {off:?} are off");
}

fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

#[test]
fn parts_of_cornell_diffuse() {
    assert_same_parts(
        "cornell-diffuse",
        &Overrides { spp: Some(256), ..PATH },
        &Overrides { spp: Some(64), ..moderate() },
        0.01,
    );
}

#[test]
fn parts_of_cornell_spheres() {
    assert_same_parts(
        "cornell-spheres",
        &Overrides { spp: Some(512), ..PATH },
        &Overrides { spp: Some(64), ..moderate() },
        0.01,
    );
}
