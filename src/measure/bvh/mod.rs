//! Benchmark of Embree and hierarchies written in Rust, on the rays of a render: build time, memory, rays per second, and correctness of
//! hits.
//!
//! Candidates are measured in alternation and medians are reported, so that other load on the machine affects all of them equally.

mod check;
#[cfg(feature = "bvh-bench")]
mod crates;
mod report;
mod tracer;
mod workload;

pub use check::Disagreements;
pub use tracer::{Hit, Make, Structure, Walk};
pub use workload::{RaySet, record_rays, triangles_of};

use crate::camera::Camera;
use crate::embree::{EmbreeError, TriangleBuffers, TriangleError};
use crate::math::Ray;
use crate::scene::Scene;
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// An error of the benchmark.
#[derive(Debug, thiserror::Error)]
pub enum BvhBenchError {
    /// There is no mesh, or it is empty.
    #[error("the mesh has no triangles; name another file")]
    NoTriangles,
    /// There are too many triangles.
    #[error(transparent)]
    Triangles(#[from] TriangleError),
    /// Embree reported an error.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// The threads cannot start.
    #[error("cannot start {0} threads; ask for fewer with --threads")]
    Threads(usize),
}

/// Settings of the benchmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BvhBenchSettings {
    /// Most rays of each kind.
    pub rays: usize,
    /// Runs of each measurement; the median is reported.
    pub runs: usize,
    /// Rays of each kind whose hits are checked.
    pub checked: usize,
    /// Threads of the parallel runs; 0 means one per core.
    pub threads: usize,
    /// Seed of the rays.
    pub seed: u64,
}

impl Default for BvhBenchSettings {
    fn default() -> Self {
        Self { rays: 200_000, runs: 5, checked: 4000, threads: 0, seed: 1 }
    }
}

/// Build figures of one hierarchy.
#[derive(Clone, Debug, Serialize)]
pub struct BuildFigures {
    /// Name of the hierarchy.
    pub name: String,
    /// Median time on one thread, seconds.
    pub seconds_one: f64,
    /// Median time on all threads, seconds.
    pub seconds_all: f64,
    /// Bytes of the hierarchy and of its own copy of the triangles, built on one thread.
    pub bytes: u64,
}

/// Figures for one kind of rays.
#[derive(Clone, Debug, Serialize)]
pub struct KindFigures {
    /// Kind of the rays.
    pub kind: String,
    /// Median rays per second on one thread.
    pub rays_per_second_one: f64,
    /// Median rays per second on all threads.
    pub rays_per_second_all: f64,
    /// Result of the check of hits.
    pub check: Disagreements,
}

/// Figures of one method to trace rays.
#[derive(Clone, Debug, Serialize)]
pub struct WayFigures {
    /// Names of hierarchy and traversal.
    pub name: String,
    /// Figures by kind of rays.
    pub kinds: Vec<KindFigures>,
}

/// Results for one mesh.
#[derive(Clone, Debug, Serialize)]
pub struct BvhReport {
    /// Name of the mesh.
    pub name: String,
    /// Number of triangles, including those of the ground.
    pub triangles: usize,
    /// Number of rays of each kind.
    pub rays: Vec<(String, usize)>,
    /// Threads of the parallel runs.
    pub threads: usize,
    /// Runs of each measurement.
    pub runs: usize,
    /// Version of Embree.
    pub embree: String,
    /// Build figures by hierarchy.
    pub builds: Vec<BuildFigures>,
    /// Figures by method of tracing.
    pub ways: Vec<WayFigures>,
}

/// Rays per parallel task.
const CHUNK: usize = 1024;

/// Runs the benchmark on the triangles of `scene` and the rays of a picture of it. `progress` gets the number of each step and of all
/// steps.
///
/// # Errors
/// If there is nothing to trace, or if Embree or the threads cannot start.
pub fn bench_bvh(
    scene: &Scene,
    camera: &Camera,
    settings: &BvhBenchSettings,
    progress: &dyn Fn(&str, u64, u64),
) -> Result<BvhReport, BvhBenchError> {
    let triangles = triangles_of(scene)?;
    let sets = record_rays(scene, camera, settings.rays.max(1), settings.seed);
    let pool = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.map_err(|_| BvhBenchError::Threads(threads))
    };
    let (one, all) = (pool(1)?, pool(settings.threads)?);
    let threads = all.current_num_threads();
    let runs = settings.runs.max(1);
    let ways: Vec<(usize, Walk)> = Make::ALL
        .iter()
        .enumerate()
        .flat_map(|(index, make)| make.walks().iter().map(move |walk| (index, *walk)))
        .collect();
    let steps = (runs * (1 + sets.len()) + sets.len()) as u64;
    let mut step = 0;
    let mut begin = |what: &str| {
        progress(what, step, steps);
        step += 1;
    };

    let mut seconds = vec![(Vec::new(), Vec::new()); Make::ALL.len()];
    let mut structures = Vec::new();
    for run in 0..runs {
        begin("building");
        for (make, seconds) in Make::ALL.iter().zip(&mut seconds) {
            let (structure, time) = timed(|| one.install(|| make.build(&triangles, 1)));
            let structure = structure?;
            seconds.0.push(time);
            if run == 0 {
                structures.push(structure);
            } else {
                drop(structure);
            }
            let (structure, time) = timed(|| all.install(|| make.build(&triangles, threads)));
            structure?;
            seconds.1.push(time);
        }
    }
    let builds =
        Make::ALL.iter().zip(&structures).zip(seconds).map(|((make, structure), (on_one, on_all))| {
            BuildFigures {
                name: make.name().to_owned(),
                seconds_one: median(on_one),
                seconds_all: median(on_all),
                bytes: structure.bytes(),
            }
        });

    let way_name = |(make, walk): (usize, Walk)| format!("{}{}", Make::ALL[make].name(), walk.name());
    let mut figures: Vec<WayFigures> =
        ways.iter().map(|way| WayFigures { name: way_name(*way), kinds: Vec::new() }).collect();
    for set in &sets {
        let mut hits: Vec<Hit> = vec![None; set.rays.len()];
        let mut times = vec![(Vec::new(), Vec::new()); ways.len()];
        for _ in 0..runs {
            begin(set.name);
            for ((make, walk), times) in ways.iter().zip(&mut times) {
                let mut trace = |pool: &rayon::ThreadPool| {
                    timed(|| {
                        pool.install(|| trace(&structures[*make], *walk, set.any_hit, &set.rays, &mut hits))
                    })
                    .1
                };
                times.0.push(trace(&one));
                times.1.push(trace(&all));
            }
        }
        begin("checking hits");
        let checks = check_set(set, &triangles, &structures, &ways, settings.checked, sets.len(), &way_name);
        for (((figures, times), check), count) in
            figures.iter_mut().zip(times).zip(checks).zip(std::iter::repeat(set.rays.len() as f64))
        {
            figures.kinds.push(KindFigures {
                kind: set.name.to_owned(),
                rays_per_second_one: count / median(times.0),
                rays_per_second_all: count / median(times.1),
                check,
            });
        }
    }
    Ok(BvhReport {
        name: scene.name().to_owned(),
        triangles: triangles.triangles().len(),
        rays: sets.iter().map(|set| (set.name.to_owned(), set.rays.len())).collect(),
        threads,
        runs,
        embree: scene.embree().device().version().to_string(),
        builds: builds.collect(),
        ways: figures,
    })
}

/// Checks every n-th ray of a set, so that the check covers the whole set.
fn check_set(
    set: &RaySet,
    triangles: &TriangleBuffers,
    structures: &[Structure],
    ways: &[(usize, Walk)],
    count: usize,
    kinds: usize,
    name: &dyn Fn((usize, Walk)) -> String,
) -> Vec<Disagreements> {
    let step = set.rays.len().div_ceil(count.max(1)).max(1);
    let rays: Vec<Ray> = set.rays.iter().copied().step_by(step).take(count).collect();
    let found = |(make, walk): (usize, Walk), any_hit| {
        let mut hits = vec![None; rays.len()];
        trace(&structures[make], walk, any_hit, &rays, &mut hits);
        hits
    };
    let names: Vec<String> = ways.iter().map(|way| name(*way)).collect();
    let hits: Vec<Vec<Hit>> = ways.iter().map(|way| found(*way, set.any_hit)).collect();
    let nearest: Vec<Vec<Hit>> = ways.iter().map(|way| found(*way, false)).collect();
    let found: Vec<check::Found<'_>> = (0..ways.len())
        .map(|way| check::Found { name: &names[way], hits: &hits[way], nearest: &nearest[way] })
        .collect();
    check::compare(set.name, &rays, set.any_hit, triangles, &found, kinds)
}

fn trace(structure: &Structure, walk: Walk, any_hit: bool, rays: &[Ray], hits: &mut [Hit]) {
    let chunks = rays.par_chunks(CHUNK).zip(hits.par_chunks_mut(CHUNK));
    chunks.for_each(|(rays, hits)| structure.trace(walk, any_hit, rays, hits));
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    // The clock may not advance in that time, so the lower bound avoids a division by zero.
    (result, start.elapsed().as_secs_f64().max(1e-9))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        count if count % 2 == 1 => values[count / 2],
        count => 0.5 * (values[count / 2 - 1] + values[count / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embree::Device;
    use crate::scene_file::{build_scene, mesh_scene};
    use std::path::Path;
    use std::sync::Arc;

    #[test]
    fn all_ways_find_the_same_on_the_knot() {
        let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/knot.ply");
        let description = mesh_scene(&mesh, &[]).unwrap();
        let built = build_scene(&description, &Arc::new(Device::new(1).unwrap()), (64, 64)).unwrap();
        let settings = BvhBenchSettings { rays: 2000, runs: 1, checked: 300, threads: 2, seed: 7 };
        let report = bench_bvh(&built.scene, &built.camera, &settings, &|_, _, _| ()).unwrap();
        assert_eq!(report.builds.len(), Make::ALL.len());
        assert!(report.rays.iter().all(|(_, count)| (1500..=2000).contains(count)), "{:?}", report.rays);
        for build in &report.builds {
            assert!(build.bytes > 10 * report.triangles as u64, "{build:?}");
        }
        for way in &report.ways {
            for kind in &way.kinds {
                let check = &kind.check;
                assert!(
                    check.checked >= 150 && check.checked == check.brute_force,
                    "{}: {check:?}",
                    way.name
                );
                assert_eq!((check.lost, check.false_hits), (0, 0), "{}: {kind:?}", way.name);
                assert!(kind.rays_per_second_one > 0.0 && kind.rays_per_second_all > 0.0);
            }
        }
        let table = report.to_markdown();
        assert!(table.contains("| Embree, robust |") && table.lines().count() > 10, "{table}");
        let plot = report.to_svg();
        assert!(plot.starts_with("<svg") && plot.trim_end().ends_with("</svg>") && !plot.contains("NaN"));
    }

    #[test]
    fn medians() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }
}
