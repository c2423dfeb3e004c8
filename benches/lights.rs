//! What a light sample costs as lights become more: drawing one out of the tree, evaluating the probability of one, and
//! both for a triangle of an emitting mesh with its point and density.
//!
//!     cargo bench --bench lights
//!
//! The places are random in and around the cloud of lights.
#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic")]

use cardioid::lights::{AreaLight, Light, LightBounds, LightTree, Receiver};
use cardioid::math::Rgb;
use cardioid::sampling::{Rng, Stream, refined, warp};
use cardioid::shapes::{EmitterShape, Triangle};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use std::hint::black_box;

const COUNTS: [usize; 5] = [10, 100, 1_000, 10_000, 100_000];

fn receivers(rng: &mut Rng) -> Vec<Receiver> {
    let receiver = |_| Receiver {
        position: warp::square_to_sphere(rng.next_2d()) * (1.2 * rng.next_f32()),
        normal: warp::square_to_sphere(rng.next_2d()),
    };
    (0..1024).map(receiver).collect()
}

fn points(c: &mut Criterion) {
    let mut rng = Rng::new(1, Stream::Measure, 0);
    let at = receivers(&mut rng);
    let mut sample = c.benchmark_group("tree_sample");
    let trees: Vec<LightTree> = COUNTS
        .iter()
        .map(|&count| {
            let light = |_| {
                let position = warp::square_to_sphere(rng.next_2d()) * rng.next_f32();
                LightBounds::point(position.as_dvec3(), f64::from(rng.next_f32()) + 0.01)
            };
            LightTree::new(&(0..count).map(light).collect::<Vec<_>>()).unwrap()
        })
        .collect();
    let mut i = 0;
    for (tree, count) in trees.iter().zip(COUNTS) {
        sample.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| {
                i += 1;
                black_box(tree.sample(&at[i % at.len()], refined(rng.next_2d())))
            });
        });
    }
    sample.finish();
    let mut probability = c.benchmark_group("tree_probability");
    for (tree, count) in trees.iter().zip(COUNTS) {
        probability.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| {
                i += 1;
                black_box(tree.probability(&at[i % at.len()], (i * 7919) % count))
            });
        });
    }
    probability.finish();
}

fn meshes(c: &mut Criterion) {
    let mut rng = Rng::new(2, Stream::Measure, 0);
    let at = receivers(&mut rng);
    let mut group = c.benchmark_group("mesh_sample_li");
    for count in COUNTS {
        let size = 1.0 / (count as f64).sqrt();
        let piece = |_| {
            let mut vector =
                |scale: f64| -> DVec3 { warp::square_to_sphere(rng.next_2d()).as_dvec3() * scale };
            let corner = vector(1.0);
            EmitterShape::Triangle(
                Triangle::new(corner, corner + vector(size), corner + vector(size)).unwrap(),
            )
        };
        let light =
            Light::Area(AreaLight::new((0..count).map(piece).collect(), Rgb::ONE, false, false).unwrap());
        let mut i = 0;
        group.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| {
                i += 1;
                black_box(light.sample_li(at[i % at.len()], rng.next_2d()))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, points, meshes);
criterion_main!(benches);
