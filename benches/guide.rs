//! What guiding by photons buys and costs: the variance of pixels with and without it at equal samples, the processor time of
//! the samples, and the product of both, which is what a picture of given noise costs.
//!
//!     cargo bench --bench guide [-- SCENE...]
//!
//! One thread; time is what the thread itself ran, where the system tells (Linux), so other work disturbs little. The maps are
//! those of the preset `preview`; their cost is told apart, as it is paid once for a picture of any size.
#![allow(clippy::unwrap_used, reason = "a benchmark may panic")]

use cardioid::embree::Device;
use cardioid::film::{AOVS, Aov};
use cardioid::integrators::{EyeRay, Integrator, PathTracer, PhotonMapIntegrator, Scratch};
use cardioid::photons::DirectionGuide;
use cardioid::render::{GuideKind, IntegratorKind, Quality, Settings, Silent, build_maps};
use cardioid::sampling::SampleStream;
use cardioid::scene::RenderPlan;
use cardioid::scene_file::{BuiltScene, build_scene, load_scene};
use glam::{DVec3, Vec2};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Pixels along one side.
const SIDE: u32 = 48;
/// Independent estimates of each pixel, from which its variance is estimated.
const RUNS: u64 = 4;

/// Times everything is measured; the shortest time counts.
const REPEATS: usize = 3;

/// Seconds that this thread has run.
fn thread_seconds(start: Instant) -> f64 {
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Variance of a pixel over (mean^2 + 0.01), mean over pixels and channels, of the picture and of its indirect light; and
/// seconds for a run.
fn measure(built: &BuiltScene, integrator: &dyn Integrator, spp: u32) -> ([f64; 2], f64) {
    let mut scratch = Scratch::default();
    let scale = 1.0 / built.scene.space().power;
    let (mut sums, start) = ([0.0; 2], Instant::now());
    let before = thread_seconds(start);
    for pixel in 0..SIDE * SIDE {
        let (x, y) = ((pixel % SIDE) as f32, (pixel / SIDE) as f32);
        let mut moments = [[DVec3::ZERO; 2]; 2];
        for run in 0..RUNS {
            let mut values = [DVec3::ZERO; 2];
            for index in 0..spp {
                let mut samples = SampleStream::new(1000 + run, u64::from(pixel), index);
                let at = (Vec2::new(x, y) + samples.next_2d()) / SIDE as f32;
                let sample = integrator.li(&EyeRay::alone(built.camera.ray(at)), &mut samples, &mut scratch);
                values[0] += AOVS.iter().map(|&aov| sample.radiance[aov as usize].as_dvec3()).sum::<DVec3>();
                values[1] += sample.radiance[Aov::Indirect as usize].as_dvec3();
            }
            for (value, [sum, squares]) in values.iter().zip(&mut moments) {
                let value = value * scale / f64::from(spp);
                *sum += value;
                *squares += value * value;
            }
        }
        for ([sum, squares], total) in moments.iter().zip(&mut sums) {
            let mean = sum / RUNS as f64;
            let variance = (squares - mean * mean * RUNS as f64) / (RUNS - 1) as f64;
            *total += (variance / (mean * mean + 0.01)).element_sum() / 3.0 / f64::from(SIDE * SIDE);
        }
    }
    (sums, (thread_seconds(start) - before) / RUNS as f64)
}

fn main() {
    let asked: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let scenes: Vec<&str> = if asked.is_empty() {
        vec!["cornell-diffuse", "door", "cornell-spheres"]
    } else {
        asked.iter().map(String::as_str).collect()
    };
    println!(
        "| scene | integrator | cells | s to build | variance | of indirect | s | variance ratio | of indirect \
         | time ratio | gain | of indirect |"
    );
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global().unwrap();
    let device = Arc::new(Device::new(0).unwrap());
    for name in scenes {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("toml");
        let built = build_scene(&load_scene(&path, &[]).unwrap(), &device, (SIDE, SIDE)).unwrap();
        for (kind, spp) in [(IntegratorKind::PhotonMap, 16), (IntegratorKind::Path, 64)] {
            table(name, &built, kind, spp);
        }
    }
}

fn table(name: &str, built: &BuiltScene, kind: IntegratorKind, spp: u32) {
    let scene = &built.scene;
    let settings =
        Settings { integrator: kind, guide: GuideKind::Photons, spp, ..Quality::Preview.settings() };
    let plan = RenderPlan::new(scene, kind, settings.map).guided(scene, kind, settings.guide);
    // With the maps of gathering for paths too: the guide is built here, to be timed.
    let with_maps = Settings { integrator: IntegratorKind::PhotonMap, ..settings.clone() };
    let mut pass = build_maps(scene, &plan, &with_maps, &Silent).unwrap();
    let clock = Instant::now();
    let start = thread_seconds(clock);
    let params = settings.guide_params(scene);
    let guide = DirectionGuide::build(pass.maps.global.as_ref().unwrap(), &params);
    let building = thread_seconds(clock) - start;
    let medium = scene.medium_at(built.camera.eye());
    let reading = settings.photon_map_settings(scene);
    let mut found = [([0.0; 2], f64::INFINITY); 2];
    for _ in 0..REPEATS {
        for (guided, (variance, seconds)) in found.iter_mut().enumerate() {
            pass.maps.guide = guide.clone().filter(|_| guided == 1);
            let integrator: Box<dyn Integrator + '_> = match kind {
                IntegratorKind::Path => Box::new(
                    PathTracer::new(scene, settings.max_depth, medium).guided_by(pass.maps.guide.as_ref()),
                ),
                _ => Box::new(PhotonMapIntegrator::new(scene, &pass.maps, &plan, reading, medium)),
            };
            let (all, time) = measure(built, &*integrator, spp);
            (*variance, *seconds) = (all, time.min(*seconds));
        }
    }
    let [(alone, time_alone), (guided, time_guided)] = found;
    println!(
        "| {name} | {kind:?} | {} | {building:.2} | {:.6} | {:.6} | {time_alone:.3} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |",
        guide.map_or(0, |guide| guide.len()),
        alone[0],
        alone[1],
        guided[0] / alone[0],
        guided[1] / alone[1],
        time_guided / time_alone,
        alone[0] * time_alone / (guided[0] * time_guided),
        alone[1] * time_alone / (guided[1] * time_guided),
    );
}
