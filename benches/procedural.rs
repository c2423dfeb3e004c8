//! Objects that are never tessellated against the same made of primitives: rays per second of processor time.
//!
//! `cargo bench --bench procedural`. A flake of 4.8 10^7 spheres that are nowhere stored against one of 6 10^5 stored ones, and
//! a terrain over its min-max hierarchy against its 2.1 million triangles. Half of the rays come from a camera, the
//! others start where those hit, in all directions of the hemisphere. Time is that of this thread, without what others
//! took from it; both sides take turns.

use cardioid::embree::{CommittedScene, Device, ObjectHit, Procedural, SceneBuilder, TriangleBuffers};
use cardioid::math::{Bounds3, Frame, Ray};
use cardioid::sampling::{Rng, Stream, warp};
use cardioid::shapes::{HeightGrid, Sphere, SphereFlake, Terrain, TerrainNoise};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

const RAYS: usize = 100_000;
const RUNS: usize = 7;

/// Spheres in a list.
#[derive(Debug)]
struct Spheres(Vec<Sphere>);

impl Procedural for Spheres {
    fn primitive_count(&self) -> u32 {
        self.0.len() as u32
    }

    fn bounds(&self, primitive: u32) -> Bounds3 {
        self.0[primitive as usize].bounds()
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        self.0[primitive as usize].nearest(0, ray)
    }

    fn intersect(&self, primitive: u32, ray: &Ray) -> Option<f32> {
        self.0[primitive as usize].intersect(0, ray)
    }
}

fn committed(device: &Arc<Device>, object: Arc<dyn Procedural>) -> CommittedScene {
    let mut builder = SceneBuilder::new(device).expect("a scene");
    builder.add_procedural(object).expect("an object");
    builder.commit().expect("a scene")
}

/// Seconds that this thread has run.
fn thread_seconds() -> f64 {
    let spent = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = spent.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.elapsed().as_secs_f64(), |nanoseconds| nanoseconds * 1e-9)
}

static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);

/// Camera rays, and as many that start where those hit `object`.
fn rays(scene: &CommittedScene, object: &dyn Procedural, eye: DVec3, at: DVec3, width: f64) -> Vec<Ray> {
    let mut rng = Rng::new(1, Stream::Measure, 0);
    let forward = (at - eye).normalize();
    let (right, up) = forward.any_orthonormal_pair();
    let mut rays = Vec::new();
    while rays.len() < RAYS {
        let (x, y) = (rng.next_f64() - 0.5, rng.next_f64() - 0.5);
        let direction = (forward + width * (right * x + up * y)).normalize();
        let ray = Ray::new(eye.as_vec3(), direction.as_vec3());
        rays.push(ray);
        if let Some(hit) = scene.intersect(&ray) {
            let point = object.refine(hit.primitive, &ray, hit.t);
            let normal = if point.normal.dot(direction) < 0.0 { point.normal } else { -point.normal };
            let local = warp::square_to_cosine_hemisphere(rng.next_2d());
            let direction = Frame::from_z(normal.as_vec3()).to_world(local);
            rays.push(Ray::new((point.position + 1e-6 * normal).as_vec3(), direction));
        }
    }
    rays
}

/// Rays per second of two scenes, medians of runs that take turns; and how many rays hit.
fn race(first: (&CommittedScene, &[Ray]), second: (&CommittedScene, &[Ray])) -> [(f64, usize); 2] {
    let trace = |(scene, rays): (&CommittedScene, &[Ray])| {
        let start = thread_seconds();
        let hits = rays.iter().filter(|ray| black_box(scene.intersect(ray)).is_some()).count();
        (rays.len() as f64 / (thread_seconds() - start), hits)
    };
    let mut runs = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        runs[0].push(trace(first));
        runs[1].push(trace(second));
    }
    runs.map(|mut runs| {
        runs.sort_by(|a, b| a.0.total_cmp(&b.0));
        runs[RUNS / 2]
    })
}

fn report(name: &str, [one, other]: [(f64, usize); 2]) {
    println!(
        "{name}: {:.3} M/s against {:.3} M/s: {:.0} %; {:.0} % and {:.0} % of the rays hit",
        one.0 / 1e6,
        other.0 / 1e6,
        100.0 * one.0 / other.0,
        100.0 * one.1 as f64 / RAYS as f64,
        100.0 * other.1 as f64 / RAYS as f64
    );
}

/// The spheres of a flake, by its definition.
fn explicit(center: DVec3, radius: f64, frame: DMat3, depth: u32, spheres: &mut Vec<Sphere>) {
    spheres.push(Sphere::new(center, radius).expect("a sphere"));
    if depth == 0 {
        return;
    }
    for i in 0..9 {
        let angle = if i < 6 { f64::from(i) * 60.0 } else { f64::from(i - 6) * 120.0 + 30.0 }.to_radians();
        let height = if i < 6 { 0.0 } else { (2.0f64 / 3.0).sqrt() };
        let across = (1.0 - height * height).sqrt();
        let z = DVec3::new(across * angle.cos(), across * angle.sin(), height);
        let x = (DVec3::Z - z * z.z).normalize();
        let child = frame * DMat3::from_cols(x, z.cross(x), z);
        explicit(center + child.z_axis * (radius * 4.0 / 3.0), radius / 3.0, child, depth - 1, spheres);
    }
}

fn flake(device: &Arc<Device>) {
    let (eye, at) = (DVec3::new(0.0, 1.0, 2.5), DVec3::new(0.0, 0.1, 0.0));
    let (x, y) = DVec3::Y.any_orthonormal_pair();
    let frame = DMat3::from_cols(x, y, DVec3::Y);
    let mut spheres = Vec::new();
    explicit(DVec3::ZERO, 0.5, frame, 6, &mut spheres);
    let count = spheres.len();
    let list = Arc::new(Spheres(spheres));
    let stored = committed(device, list.clone());
    let stored_rays = rays(&stored, &*list, eye, at, 0.7);
    for depth in [6, 7, 8, 10] {
        let flake = Arc::new(SphereFlake::with_frame(DVec3::ZERO, 0.5, frame, depth).expect("a flake"));
        let scene = committed(device, flake.clone());
        let own_rays = rays(&scene, &*flake, eye, at, 0.7);
        println!("flake: {} spheres in {} bytes", flake.sphere_count(), flake.memory());
        let name = format!("flake of {:.1e} spheres against {count} stored", flake.sphere_count() as f64);
        report(&name, race((&scene, &own_rays), (&stored, &stored_rays)));
    }
}

fn terrain(device: &Arc<Device>) {
    const CELLS: u32 = 1024;
    let noise = TerrainNoise { features: 4.0, octaves: 8, seed: 1, ridges: false };
    let grid = Arc::new(HeightGrid::from_noise(CELLS, &noise).expect("a grid"));
    let scale = DVec3::new(1.0 / f64::from(CELLS), 0.2, 1.0 / f64::from(CELLS));
    let transform = DAffine3::from_translation(DVec3::new(-0.5, 0.0, -0.5)) * DAffine3::from_scale(scale);
    let terrain = Arc::new(Terrain::new(Arc::clone(&grid), transform).expect("a terrain"));
    let scene = committed(device, terrain.clone());
    let corner = |index: u32| {
        let (x, z) = (index % (CELLS + 1), index / (CELLS + 1));
        let p = DVec3::new(f64::from(x), f64::from(grid.height(x, z)), f64::from(z));
        transform.transform_point3(p).as_vec3().to_array()
    };
    let positions = (0..(CELLS + 1).pow(2)).map(corner).collect();
    let triangles = (0..CELLS * CELLS).flat_map(|cell| {
        let a = cell / CELLS * (CELLS + 1) + cell % CELLS;
        let (b, c, d) = (a + 1, a + CELLS + 1, a + CELLS + 2);
        [[a, c, b], [b, c, d]]
    });
    let buffers = TriangleBuffers::new(positions, triangles.collect()).expect("triangles");
    let (count, bytes) = (buffers.triangles().len(), buffers.memory_bytes());
    let mut builder = SceneBuilder::new(device).expect("a scene");
    builder.add_triangles(buffers).expect("triangles");
    let mesh = builder.commit().expect("a scene");
    println!(
        "terrain: {} bytes against {count} triangles in {bytes} bytes and their hierarchy",
        grid.memory()
    );
    let rays = rays(&scene, &*terrain, DVec3::new(0.2, 0.6, 0.9), DVec3::new(0.0, 0.05, 0.0), 0.7);
    report(&format!("terrain of {CELLS}^2 cells"), race((&scene, &rays), (&mesh, &rays)));
    let down: Vec<Ray> = rays.iter().map(|ray| Ray::new(ray.origin.with_y(1.0), Vec3::NEG_Y)).collect();
    report("terrain from above", race((&scene, &down), (&mesh, &down)));
}

fn main() {
    // `cargo test --benches` passes an argument and wants no measurement.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let device = Arc::new(Device::new(1).expect("Embree"));
    flake(&device);
    terrain(&device);
}
