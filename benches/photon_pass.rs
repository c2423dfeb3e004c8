//! The photon pass against Embree alone on the same rays, and both passes on one thread and two.
//!
//! `cargo bench --bench photon_pass` prints the ratios at the end. The globe of 1.16 million triangles is not part of the
//! project; name its file in `CARDIOID_BENCH_MESH` or leave it out.

use cardioid::embree::Device;
use cardioid::photons::{TraceSettings, record_photon_rays, trace_photons, trace_photons_alone};
use cardioid::render::{Overrides, Quality, RenderRequest, Settings, Silent, render};
use cardioid::scene::{MapKind, Scene};
use cardioid::scene_file::{BuiltScene, build_scene, load_scene};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const EMITTED: u64 = 100_000;
const RUNS: usize = 15;
const SIZE: (u32, u32) = (256, 256);

fn load(scene: &str, mesh: Option<&str>) -> BuiltScene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene);
    let parameters: Vec<_> = mesh.map(|mesh| ("mesh".to_owned(), mesh.to_owned())).into_iter().collect();
    let description = load_scene(&path, &parameters).expect("a scene of the project");
    let device = Arc::new(Device::new(0).expect("Embree"));
    build_scene(&description, &device, SIZE).expect("a scene of the project")
}

fn settings() -> TraceSettings {
    TraceSettings {
        kind: MapKind::Global,
        stored: 0,
        seed: 1,
        max_depth: 1000,
        aimed: true,
        wavelengths: Default::default(),
    }
}

/// Median times of two works that take turns, so that whatever else the machine does troubles both.
fn race(mut a: impl FnMut(), mut b: impl FnMut()) -> (Duration, Duration) {
    let time = |work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    let (mut first, mut second): (Vec<_>, Vec<_>) = (0..RUNS).map(|_| (time(&mut a), time(&mut b))).unzip();
    first.sort();
    second.sort();
    (first[RUNS / 2], second[RUNS / 2])
}

fn against_embree(c: &mut Criterion, name: &str, scene: &Scene) {
    let rays = record_photon_rays(scene, &settings(), EMITTED);
    let bare = || {
        let sum: f32 = rays.iter().filter_map(|ray| scene.embree().intersect(ray)).map(|hit| hit.t).sum();
        black_box(sum);
    };
    let pass = || {
        black_box(trace_photons_alone(scene, &settings(), EMITTED));
    };
    let mut group = c.benchmark_group(name);
    group.sample_size(10).throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("bare rays", |b| b.iter(bare));
    group.bench_function("photon pass", |b| b.iter(pass));
    group.finish();
    let (bare, pass) = race(bare, pass);
    let rate = |time: Duration| rays.len() as f64 / time.as_secs_f64() / 1e6;
    println!(
        "{name}: {} rays; bare {:.2} M/s, photon pass {:.2} M/s: {:.0} %",
        rays.len(),
        rate(bare),
        rate(pass),
        100.0 * bare.as_secs_f64() / pass.as_secs_f64()
    );
}

fn photon_pass(c: &mut Criterion) {
    against_embree(c, "cornell-diffuse", &load("cornell-diffuse.toml", None).scene);
    against_embree(c, "cornell-spheres", &load("cornell-spheres.toml", None).scene);
    match std::env::var("CARDIOID_BENCH_MESH") {
        Ok(mesh) => against_embree(c, "mesh", &load("mesh.toml", Some(&mesh)).scene),
        Err(_) => println!("mesh: left out; name a PLY in CARDIOID_BENCH_MESH"),
    }
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(|pool| pool.install(work)).expect("a thread pool")
}

fn threads(_: &mut Criterion) {
    let BuiltScene { scene, camera, .. } = load("cornell-diffuse.toml", None);
    let trace = TraceSettings { stored: 1_000_000, ..settings() };
    let photons = |threads| {
        black_box(in_pool(threads, || trace_photons(&scene, &trace, &|_, _| true)));
    };
    let (one, two) = race(|| photons(1), || photons(2));
    println!("photon pass: two threads {:.2} times one", one.as_secs_f64() / two.as_secs_f64());

    let overrides = Overrides { quality: Some(Quality::Draft), ..Overrides::default() };
    let request = RenderRequest {
        width: SIZE.0,
        height: SIZE.1,
        crop: None,
        filter: cardioid::film::Filter::Box { radius: 0.5 },
        layers: cardioid::film::LayerSet::default(),
        settings: Settings { global_photons: 1000, ..Settings::from(&overrides) },
    };
    let pixels = |threads| {
        black_box(in_pool(threads, || render(&scene, &camera, &request, &Silent)).is_ok());
    };
    let (one, two) = race(|| pixels(1), || pixels(2));
    println!("pixel pass: two threads {:.2} times one", one.as_secs_f64() / two.as_secs_f64());
}

criterion_group!(benches, photon_pass, threads);
criterion_main!(benches);
