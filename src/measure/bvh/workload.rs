//! Workload of the benchmark: triangles of a scene, and the rays of its render.

use super::BvhBenchError;
use crate::camera::Camera;
use crate::embree::TriangleBuffers;
use crate::math::{Frame, Ray};
use crate::photons::{TraceSettings, record_photon_rays};
use crate::sampling::{Rng, Stream, warp};
use crate::scene::{Geometry, MapKind, Scene, SurfaceInteraction};
use glam::{DVec3, Vec2};

/// Rays of one kind.
#[derive(Clone, Debug)]
pub struct RaySet {
    /// Name of the kind, for tables.
    pub name: &'static str,
    /// The rays, in render space.
    pub rays: Vec<Ray>,
    /// Whether the rays are occlusion queries.
    pub any_hit: bool,
}

/// Most hemisphere samples per camera hit, so that rays do not all start at one point where few pixels show a surface.
const MOST_PASSES: u64 = 64;

/// All triangles of the meshes of a scene, in render space with a common numbering. Discs without a mesh (the ground) are replaced by their
/// bounding squares of two triangles.
///
/// # Errors
/// If there is no triangle, or more than 32 bits can index.
pub fn triangles_of(scene: &Scene) -> Result<TriangleBuffers, BvhBenchError> {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut of_meshes = 0;
    for surface in scene.surfaces() {
        let first = positions.len() as u32;
        match &surface.geometry {
            Geometry::Mesh(mesh) => {
                positions.extend_from_slice(mesh.buffers.positions());
                let moved = |triangle: &[u32; 3]| triangle.map(|vertex| vertex + first);
                triangles.extend(mesh.buffers.triangles().iter().map(moved));
                of_meshes += mesh.buffers.triangles().len();
            }
            Geometry::Procedural(shape) => {
                for part in 0..shape.primitive_count() {
                    let bounds = shape.bounds(part);
                    let y = 0.5 * (bounds.min.y + bounds.max.y);
                    let corner = |x: f64, z: f64| DVec3::new(x, y, z).as_vec3().to_array();
                    let first = positions.len() as u32;
                    positions.extend([
                        corner(bounds.min.x, bounds.min.z),
                        corner(bounds.min.x, bounds.max.z),
                        corner(bounds.max.x, bounds.max.z),
                        corner(bounds.max.x, bounds.min.z),
                    ]);
                    triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
                }
            }
        }
    }
    if of_meshes == 0 {
        return Err(BvhBenchError::NoTriangles);
    }
    Ok(TriangleBuffers::new(positions, triangles)?)
}

/// Up to `count` rays of each kind: camera rays, shadow rays from their hits to samples of the lights, photon rays, and cosine-distributed
/// rays from hits. The result is a function of the seed.
pub fn record_rays(scene: &Scene, camera: &Camera, count: usize, seed: u64) -> Vec<RaySet> {
    let across = (count as f64).sqrt().ceil().max(1.0) as usize;
    let mut rng = Rng::new(seed, Stream::Measure, 0);
    let through = |index: usize, u: Vec2| {
        let pixel = Vec2::new((index % across) as f32, (index / across) as f32);
        camera.ray((pixel + u) / across as f32)
    };
    let seen: Vec<Ray> = (0..count).map(|index| through(index, rng.next_2d())).collect();
    let hits: Vec<SurfaceInteraction> = seen.iter().filter_map(|ray| scene.intersect(ray)).collect();
    let mut gather = Vec::with_capacity(count);
    let mut shadow = Vec::with_capacity(count);
    for _ in 0..MOST_PASSES {
        for hit in &hits {
            let normal = hit.facing_normal();
            let gathered = warp::square_to_cosine_hemisphere(rng.next_2d());
            gather.push(hit.spawn(Frame::from_z(normal).to_world(gathered)));
            for light in scene.lights() {
                let sample = light.sample_li(hit.point.position, rng.next_2d());
                let Some(sample) = sample.filter(|sample| sample.wi.dot(normal) > 0.0) else { continue };
                shadow.push(sample.target.map_or_else(|| hit.spawn(sample.wi), |to| hit.spawn_to(to)));
            }
            if gather.len() >= count && shadow.len() >= count {
                break;
            }
        }
        if hits.is_empty() || gather.len() >= count && shadow.len() >= count {
            break;
        }
    }
    let settings = TraceSettings {
        kind: MapKind::Global,
        stored: 0,
        seed,
        max_depth: 1000,
        aimed: true,
        wavelengths: Default::default(),
    };
    // The number of photons is chosen to give this many rays, so that all lights are included in the order of tracing.
    let first = record_photon_rays(scene, &settings, count as u64);
    let emitted = (count as f64).powi(2) / first.len().max(1) as f64;
    let photon = if first.len() <= count {
        first
    } else {
        record_photon_rays(scene, &settings, emitted.ceil() as u64)
    };
    let set = |name, mut rays: Vec<Ray>, any_hit| {
        // Rays with NaN or infinite values are no work for a traversal.
        rays.retain(|ray| ray.origin.is_finite() && ray.direction.is_finite());
        rays.truncate(count);
        RaySet { name, rays, any_hit }
    };
    vec![
        set("camera", seen, false),
        set("shadow", shadow, true),
        set("photon", photon, false),
        set("gather", gather, false),
    ]
}
