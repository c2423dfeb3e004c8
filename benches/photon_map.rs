//! The photon map against kiddo, on photons as a Cornell box has them.
//!
//! `cargo bench --bench photon_map` prints the ratios at the end: below one, the map is faster.

use cardioid::math::Rgb;
use cardioid::photons::{
    EstimateParams, Estimator, Kernel, Photon, PhotonClass, PhotonMap, Query, Scratch, SearchRegion,
};
use cardioid::sampling::{Rng, Stream, warp};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{Quat, Vec2, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::hint::black_box;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

const PHOTONS: u64 = 1_000_000;
const QUERIES: u64 = 10_000;
const NEAREST: usize = 80;

/// A point on a surface of a box open to the front, or on one of two blocks in it, and the normal there.
fn surface_point(rng: &mut Rng) -> (Vec3, Vec3) {
    // Five walls of a unit cube; a tall block of 0.3 x 0.6 x 0.3 and a cube of 0.3, both turned.
    let walls = 5.0;
    let (tall, short) = (0.09 + 4.0 * 0.18, 5.0 * 0.09);
    let mut at = rng.next_f32() * (walls + tall + short);
    let Vec2 { x: u, y: v } = rng.next_2d();
    if at < walls {
        return match at as u32 {
            0 => (Vec3::new(u, 0.0, v), Vec3::Y),
            1 => (Vec3::new(u, 1.0, v), Vec3::NEG_Y),
            2 => (Vec3::new(0.0, u, v), Vec3::X),
            3 => (Vec3::new(1.0, u, v), Vec3::NEG_X),
            _ => (Vec3::new(u, v, 0.0), Vec3::Z),
        };
    }
    at -= walls;
    let (height, turn, corner) = if at < tall {
        (0.6, 0.3f32, Vec3::new(0.2, 0.0, 0.15))
    } else {
        (0.3, -0.3, Vec3::new(0.55, 0.0, 0.6))
    };
    let top = 0.09 / (0.09 + 4.0 * 0.3 * height);
    let (p, n) = if rng.next_f32() < top {
        (Vec3::new(0.3 * u, height, 0.3 * v), Vec3::Y)
    } else {
        match rng.next_u64() % 4 {
            0 => (Vec3::new(0.0, height * u, 0.3 * v), Vec3::NEG_X),
            1 => (Vec3::new(0.3, height * u, 0.3 * v), Vec3::X),
            2 => (Vec3::new(0.3 * v, height * u, 0.0), Vec3::NEG_Z),
            _ => (Vec3::new(0.3 * v, height * u, 0.3), Vec3::Z),
        }
    };
    let rotation = Quat::from_rotation_y(turn);
    (corner + rotation * p, rotation * n)
}

fn photons(count: u64) -> Vec<Photon> {
    (0..count)
        .map(|i| {
            let mut rng = Rng::new(1, Stream::Measure, i);
            let (position, normal) = surface_point(&mut rng);
            let wi =
                Quat::from_rotation_arc(Vec3::Z, normal) * warp::square_to_cosine_hemisphere(rng.next_2d());
            let power = Rgb::new(1.0, 0.7, 0.5);
            Photon::new(position, power, wi, normal, PhotonClass::Indirect, rng.next_f32())
        })
        .collect()
}

fn queries() -> Vec<(Vec3, Vec3)> {
    (0..QUERIES).map(|i| surface_point(&mut Rng::new(2, Stream::Measure, i))).collect()
}

/// Best times of two works that take turns, so that whatever else the machine does troubles both.
fn race(runs: u32, mut ours: impl FnMut(), mut theirs: impl FnMut()) -> (Duration, Duration) {
    let time = |work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    (0..runs)
        .fold((Duration::MAX, Duration::MAX), |(a, b), _| (a.min(time(&mut ours)), b.min(time(&mut theirs))))
}

fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(|pool| pool.install(work)).expect("a thread pool")
}

fn build(c: &mut Criterion) {
    let photons = photons(PHOTONS);
    let points: Vec<[f32; 3]> = photons.iter().map(|p| p.position.to_array()).collect();
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    for threads in [1, 2] {
        group.bench_function(format!("cardioid/{threads}"), |b| {
            b.iter_batched(
                || photons.clone(),
                |photons| in_pool(threads, || PhotonMap::build(photons, PHOTONS)),
                criterion::BatchSize::LargeInput,
            );
        });
        group.bench_function(format!("kiddo/{threads}"), |b| {
            b.iter(|| in_pool(threads, || kiddo_tree(&points)));
        });
    }
    group.finish();
    for threads in [1, 2] {
        let mut copies: Vec<_> = (0..8).map(|_| photons.clone()).collect();
        let ours = || {
            let photons = copies.pop().unwrap_or_default();
            black_box(in_pool(threads, || PhotonMap::build(photons, PHOTONS)));
        };
        let theirs = || {
            black_box(in_pool(threads, || kiddo_tree(&points)));
        };
        let (ours, theirs) = race(8, ours, theirs);
        report(&format!("build of {PHOTONS}, {threads} threads"), ours, theirs, 1.0);
    }
}

fn kiddo_tree(points: &[[f32; 3]]) -> ImmutableKdTree<f32, 3> {
    ImmutableKdTree::new_from_slice_parallel(points).expect("a tree")
}

fn report(what: &str, ours: Duration, theirs: Duration, count: f64) {
    let micros = |t: Duration| t.as_secs_f64() * 1e6 / count;
    println!(
        "RATIO {what}: cardioid {:.3} us, kiddo {:.3} us, ratio {:.3}",
        micros(ours),
        micros(theirs),
        ours.as_secs_f64() / theirs.as_secs_f64()
    );
}

/// Sum of the squared radii of all look-ups, without test of normals, as kiddo has none.
fn our_look_ups(map: &PhotonMap, queries: &[(Vec3, Vec3)], k: usize, scratch: &mut Scratch) -> f32 {
    let radius_squared = |&(position, normal): &(Vec3, Vec3)| {
        let query = Query { min_normal_cos: -2.0, ..Query::nearest(position, normal, k) };
        map.search(&query, scratch).farthest_squared()
    };
    queries.iter().map(radius_squared).sum()
}

/// The same by kiddo, unsorted.
fn their_look_ups(tree: &ImmutableKdTree<f32, 3>, queries: &[(Vec3, Vec3)], k: usize) -> f32 {
    let k = NonZeroUsize::new(k).expect("not zero");
    let radius_squared = |(position, _): &(Vec3, Vec3)| {
        let point = position.to_array();
        let found = tree.query(&point).nearest_n::<SquaredEuclidean<f32>>(k).unsorted().execute();
        found.iter().map(|item| item.distance).fold(0.0, f32::max)
    };
    queries.iter().map(radius_squared).sum()
}

fn compare_look_ups(
    where_: &str,
    map: &PhotonMap,
    tree: &ImmutableKdTree<f32, 3>,
    queries: &[(Vec3, Vec3)],
    counts: &[usize],
) {
    let mut scratch = Scratch::default();
    for &k in counts {
        let (mut a, mut b) = (0.0, 0.0);
        let ours = || a = our_look_ups(map, queries, k, &mut scratch);
        let theirs = || b = their_look_ups(tree, queries, k);
        let (ours, theirs) = race(9, ours, theirs);
        assert_eq!(a, b, "both find the same photons");
        report(&format!("{k} nearest of {PHOTONS}{where_}"), ours, theirs, queries.len() as f64);
    }
}

fn look_up(c: &mut Criterion) {
    let photons = photons(PHOTONS);
    let points: Vec<[f32; 3]> = photons.iter().map(|p| p.position.to_array()).collect();
    let map = PhotonMap::build(photons, PHOTONS);
    let tree = kiddo_tree(&points);
    let queries = queries();
    let mut scratch = Scratch::default();
    println!("bytes a photon: {:.3}", map.memory_bytes() as f64 / map.len() as f64);

    compare_look_ups("", &map, &tree, &queries, &[1, 10, 50, NEAREST, 200, 500]);
    // No plane of equal coordinates, which kiddo's trees suffer from.
    let turn = Quat::from_rotation_x(0.4) * Quat::from_rotation_z(0.7);
    let turned = |p: Photon| {
        Photon::new(turn * p.position, p.power(), turn * p.wi(), turn * p.normal(), p.class(), 0.5)
    };
    let turned = PhotonMap::build(map.photons().map(turned).collect(), PHOTONS);
    let turned_tree = kiddo_tree(&turned.photons().map(|p| p.position.to_array()).collect::<Vec<_>>());
    let turned_queries: Vec<_> = queries.iter().map(|&(p, n)| (turn * p, turn * n)).collect();
    compare_look_ups(", box turned", &turned, &turned_tree, &turned_queries, &[1, 10, NEAREST, 500]);

    let (mut a, mut b) = (0.0, 0.0);
    let mut ours = || a += our_look_ups(&map, &queries, NEAREST, &mut scratch);
    let mut theirs = || b += their_look_ups(&tree, &queries, NEAREST);
    let mut group = c.benchmark_group("look_up");
    group.sample_size(20);
    group.bench_function("cardioid/80", |bencher| bencher.iter(&mut ours));
    group.bench_function("kiddo/80", |bencher| bencher.iter(&mut theirs));
    let mut scratch = Scratch::default();
    let mut estimate = |kernel, region| {
        let params = EstimateParams { kernel, estimator: Estimator::Corrected };
        for &(position, normal) in &queries {
            let query = Query { region, ..Query::nearest(position, normal, NEAREST) };
            black_box(map.estimate_irradiance(&query, &params, &mut scratch));
        }
    };
    group.bench_function("irradiance/80/constant/sphere", |bencher| {
        bencher.iter(|| estimate(Kernel::Constant, SearchRegion::Sphere));
    });
    group.bench_function("irradiance/80/cone/disc", |bencher| {
        bencher.iter(|| estimate(Kernel::Cone { k: 1.0 }, SearchRegion::Disc));
    });
    group.finish();
}

fn irradiance(c: &mut Criterion) {
    let map = PhotonMap::build(photons(300_000), 300_000);
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    let template = Query::nearest(Vec3::ZERO, Vec3::Z, NEAREST);
    let queries = queries();
    for stride in [1, 4] {
        let irradiance = map.precompute_irradiance(&template, &params, stride);
        let points: Vec<[f32; 3]> = map.photons().step_by(stride).map(|p| p.position.to_array()).collect();
        let tree = kiddo_tree(&points);
        let (mut sum, mut distance) = (Rgb::ZERO, 0.0);
        let ours = || {
            for &(position, normal) in &queries {
                let found =
                    irradiance.nearest((position, normal), (f32::INFINITY, f32::INFINITY), |_, _| true);
                sum += found.map_or(Rgb::ZERO, |found| found.irradiance);
            }
        };
        let theirs = || {
            for (position, _) in &queries {
                let point = position.to_array();
                distance += tree.query(&point).nearest_one::<SquaredEuclidean<f32>>().execute().distance;
            }
        };
        let (ours, theirs) = race(15, ours, theirs);
        black_box((sum, distance));
        report(&format!("nearest irradiance of {}", points.len()), ours, theirs, QUERIES as f64);
        println!("bytes a point: {:.2}", irradiance.memory_bytes() as f64 / irradiance.len() as f64);
    }
    let mut group = c.benchmark_group("irradiance");
    group.sample_size(10);
    group.bench_function("precompute/300000/4", |b| {
        b.iter(|| map.precompute_irradiance(&template, &params, 4));
    });
    group.finish();
}

criterion_group!(benches, build, look_up, irradiance);
criterion_main!(benches);
