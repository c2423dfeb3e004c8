//! What separate maps bring (Jensen 1996, section 3): caustics and soft indirect light of `scenes/cornell-spheres.toml`, estimated from
//! one map of all photons and from two maps, one of which holds caustics alone, with as many photons in all. Prints a table.
//!
//! ```sh
//! cargo run --release --example one_map_or_two
//! ```
//!
//! Half of the places are those of caustic photons drawn at random, half of all photons. The truth is the mean of two-map estimates
//! over twelve pairs of maps of two million photons.

use cardioid::embree::Device;
use cardioid::photons::{
    EstimateParams, Estimator, Kernel, PhotonClass, PhotonClasses, PhotonMap, Query, Scratch, TraceSettings,
    trace_photons,
};
use cardioid::sampling::{Rng, Stream};
use cardioid::scene::{MapKind, Scene};
use cardioid::scene_file::{build_scene, load_scene};
use glam::Vec3;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const PLACES: usize = 1000;
const SEEDS: u64 = 4;

type Place = (Vec3, Vec3);

fn trace(scene: &Scene, kind: MapKind, stored: u64, seed: u64) -> Result<PhotonMap, Box<dyn Error>> {
    let settings =
        TraceSettings { kind, stored, seed, max_depth: 1000, aimed: true, wavelengths: Default::default() };
    let traced = trace_photons(scene, &settings, &|_, _| true).ok_or("no photons")?;
    Ok(PhotonMap::build(traced.photons, traced.emitted))
}

/// Irradiance at places, from the `nearest` photons of these classes.
fn irradiance(map: &PhotonMap, classes: PhotonClasses, nearest: usize, places: &[Place]) -> Vec<f64> {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let mut scratch = Scratch::default();
    let one = |&(at, normal): &Place| {
        let query = Query { classes, ..Query::nearest(at, normal, nearest) };
        f64::from(map.estimate_irradiance(&query, &params, &mut scratch).value.y)
    };
    places.iter().map(one).collect()
}

fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// Root of the mean of squared errors, over the mean.
fn error(found: &[f64], truth: &[f64]) -> f64 {
    let squares: f64 = found.iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum();
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    (squares / truth.len() as f64).sqrt() / mean
}

fn main() -> Result<(), Box<dyn Error>> {
    let caustic = PhotonClasses::only(PhotonClass::Caustic);
    let indirect = PhotonClasses::only(PhotonClass::Indirect);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.toml");
    let description = load_scene(&file, &[])?;
    let scene = build_scene(&description, &Arc::new(Device::new(0)?), (256, 256))?.scene;

    let mut rng = Rng::new(1, Stream::Measure, 0);
    let mut places: Vec<Place> = Vec::new();
    for kind in [MapKind::Caustic, MapKind::Global] {
        let map = trace(&scene, kind, 100_000, 1000)?;
        for _ in 0..PLACES / 2 {
            let photon = map.photon((rng.next_f64() * map.len() as f64) as usize);
            places.push((photon.position, photon.normal()));
        }
    }
    let mut truth = vec![0.0; PLACES];
    for seed in 100..112 {
        let maps = [MapKind::Caustic, MapKind::Global].map(|kind| trace(&scene, kind, 2_000_000, seed));
        let [caustics, global] = maps;
        let both = sum(
            &irradiance(&caustics?, caustic, 200, &places),
            &irradiance(&global?, indirect, 500, &places),
        );
        truth.iter_mut().zip(both).for_each(|(sum, value)| *sum += value / 12.0);
    }
    println!("| photons | N | one map: error | us | two maps: error | us |");
    println!("|---|---|---|---|---|---|");
    for stored in [20_000, 100_000, 500_000] {
        for nearest in [40, 80, 160] {
            let (mut one, mut two, mut seconds) = (0.0, 0.0, [0.0; 2]);
            for seed in 0..SEEDS {
                let all = trace(&scene, MapKind::Global, stored, seed)?;
                let start = Instant::now();
                one += error(&irradiance(&all, caustic.and(indirect), nearest, &places), &truth);
                seconds[0] += start.elapsed().as_secs_f64();
                drop(all);
                let global = trace(&scene, MapKind::Global, stored / 2, seed)?;
                let caustics = trace(&scene, MapKind::Caustic, stored / 2, seed)?;
                let start = Instant::now();
                let both = sum(
                    &irradiance(&caustics, caustic, nearest, &places),
                    &irradiance(&global, indirect, nearest, &places),
                );
                seconds[1] += start.elapsed().as_secs_f64();
                two += error(&both, &truth);
            }
            let [of_one, of_two] = seconds.map(|s| s * 1e6 / (SEEDS as f64 * PLACES as f64));
            let n = SEEDS as f64;
            println!(
                "| {stored} | {nearest} | {:.1} % | {of_one:.1} | {:.1} % | {of_two:.1} |",
                100.0 * one / n,
                100.0 * two / n
            );
        }
    }
    Ok(())
}
