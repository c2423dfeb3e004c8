//! Check of hits against a reference in `f64`.

use super::tracer::Hit;
use crate::embree::TriangleBuffers;
use crate::math::Ray;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;

/// Tolerance of ray parameters, in lengths of render space, where scenes have a radius of about one.
const TOLERANCE: f64 = 1e-5;

/// A barycentric coordinate this close to zero is at an edge, where rounding in `f32` decides.
const EDGE: f64 = 1e-6;

/// Most triangle tests of a brute-force check.
const MOST_TESTS: u64 = 2_000_000_000;

/// Errors in the hits of one method of tracing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Disagreements {
    /// Rays that were checked.
    pub checked: u64,
    /// Rays that were compared with every triangle; the others were compared with all triangles that any method found.
    pub brute_force: u64,
    /// Rays that miss a triangle which the reference hits first, away from its edges.
    pub lost: u64,
    /// Hits where the reference has none or a farther one.
    pub false_hits: u64,
    /// Lost or false hits within 1e-6 (barycentric) of an edge, or within 1e-5 of the ray's start or end.
    pub at_edges: u64,
    /// Descriptions of the first lost and false hits.
    pub examples: Vec<String>,
}

/// A crossing in `f64`: parameter, and smallest barycentric coordinate.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    t: f64,
    inside: f64,
}

/// Crossing of a ray with the plane of a triangle (Moeller & Trumbore 1997, in `f64`); `None` for a parallel ray.
fn crossing(ray: &Ray, corners: [[f32; 3]; 3]) -> Option<Crossing> {
    let [a, b, c] = corners.map(|corner| Vec3::from_array(corner).as_dvec3());
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (edge_1, edge_2): (DVec3, DVec3) = (b - a, c - a);
    let p = direction.cross(edge_2);
    let determinant = edge_1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let to_origin = origin - a;
    let u = to_origin.dot(p) / determinant;
    let q = to_origin.cross(edge_1);
    let v = direction.dot(q) / determinant;
    let t = edge_2.dot(q) / determinant;
    Some(Crossing { t, inside: u.min(v).min(1.0 - u - v) })
}

/// The nearest crossing on the ray among `candidates`, including edges.
fn nearest(
    ray: &Ray,
    triangles: &TriangleBuffers,
    candidates: impl Iterator<Item = u32>,
) -> Option<(u32, Crossing)> {
    let end = f64::from(ray.t_max);
    let crossed = candidates.filter_map(|index| {
        let found = crossing(ray, triangles.corners(index))?;
        (found.inside >= 0.0 && found.t > 0.0 && found.t <= end).then_some((index, found))
    });
    crossed.min_by(|a, b| a.1.t.total_cmp(&b.1.t))
}

/// Results of one method: its name, its hits, and for occlusion rays the nearest hits that it finds for the same rays.
pub(super) struct Found<'a> {
    pub name: &'a str,
    pub hits: &'a [Hit],
    pub nearest: &'a [Hit],
}

/// Compares the first `count` rays and returns one result for each of `ways`.
pub(super) fn compare(
    kind: &str,
    rays: &[Ray],
    any_hit: bool,
    triangles: &TriangleBuffers,
    ways: &[Found<'_>],
    kinds: usize,
) -> Vec<Disagreements> {
    let size = triangles.triangles().len() as u32;
    let affordable = MOST_TESTS / (kinds as u64 * u64::from(size).max(1));
    let per_ray: Vec<(bool, Option<(u32, Crossing)>)> = rays
        .par_iter()
        .enumerate()
        .map(|(index, ray)| {
            let all = (index as u64) < affordable;
            let reference = if all {
                nearest(ray, triangles, 0..size)
            } else {
                nearest(ray, triangles, ways.iter().filter_map(|way| Some(way.nearest[index]?.0)))
            };
            (all, reference)
        })
        .collect();
    let outcome = |way: &Found<'_>| {
        let mut counts = Disagreements::default();
        for (index, ((all, reference), ray)) in per_ray.iter().zip(rays).enumerate() {
            counts.checked += 1;
            counts.brute_force += u64::from(*all);
            let scale = f64::from(ray.direction.length());
            let verdict = judge(ray, way.hits[index], *reference, any_hit, triangles, scale);
            match verdict {
                Verdict::Same => continue,
                Verdict::Edge => counts.at_edges += 1,
                Verdict::Lost => counts.lost += 1,
                Verdict::False => counts.false_hits += 1,
            }
            if verdict != Verdict::Edge && counts.examples.len() < 3 {
                counts.examples.push(format!(
                    "{}: {kind} ray {index} from {} along {}: found {:?}, the reference {:?}",
                    way.name,
                    ray.origin,
                    ray.direction,
                    way.hits[index],
                    reference.map(|(triangle, at)| (triangle, at.t, at.inside))
                ));
            }
        }
        counts
    };
    ways.iter().map(outcome).collect()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Same,
    Edge,
    Lost,
    False,
}

fn judge(
    ray: &Ray,
    hit: Hit,
    reference: Option<(u32, Crossing)>,
    any_hit: bool,
    triangles: &TriangleBuffers,
    scale: f64,
) -> Verdict {
    let at_end = |t: f64| t * scale <= TOLERANCE || (f64::from(ray.t_max) - t).abs() * scale <= TOLERANCE;
    let is_close = |crossing: &Crossing| crossing.inside.abs() <= EDGE || at_end(crossing.t);
    match (hit, reference) {
        (None, None) => Verdict::Same,
        (None, Some((_, at))) => {
            if is_close(&at) {
                Verdict::Edge
            } else {
                Verdict::Lost
            }
        }
        (Some(_), Some(_)) if any_hit => Verdict::Same,
        // The triangle that was hit is unknown; the ray may have passed at its edge.
        (Some(_), None) if any_hit => {
            let size = triangles.triangles().len() as u32;
            let near = (0..size).filter_map(|index| crossing(ray, triangles.corners(index)));
            let end = f64::from(ray.t_max);
            let mut near = near.filter(|at| at.t * scale > -TOLERANCE && (at.t - end) * scale <= TOLERANCE);
            if near.any(|at| at.inside >= -EDGE) { Verdict::Edge } else { Verdict::False }
        }
        (Some((triangle, t)), reference) => {
            let difference = reference.map(|(_, at)| (f64::from(t) - at.t) * scale);
            let allowed = TOLERANCE * (1.0 + f64::from(t) * scale);
            match (difference, reference) {
                (Some(difference), _) if difference.abs() <= allowed => Verdict::Same,
                (Some(difference), Some((_, at))) if difference > 0.0 => {
                    if is_close(&at) {
                        Verdict::Edge
                    } else {
                        Verdict::Lost
                    }
                }
                _ => match crossing(ray, triangles.corners(triangle)) {
                    Some(at) if is_close(&at) => Verdict::Edge,
                    _ => Verdict::False,
                },
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_lost_and_what_is_false() {
        let corners = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, -1.0],
            [1.0, 0.0, -1.0],
            [0.0, 1.0, -1.0],
        ];
        let triangles = TriangleBuffers::new(corners, vec![[0, 1, 2], [3, 4, 5]]).unwrap();
        let down = |x: f32| Ray::new(Vec3::new(x, 0.25, 1.0), Vec3::NEG_Z);
        let rays = [down(0.25), down(0.25), down(0.25), down(5.0), down(0.75), down(0.25)];
        let found = [Some((0, 1.0)), Some((1, 2.0)), None, Some((0, 1.0)), None, Some((0, 0.5))];
        let way = Found { name: "x", hits: &found, nearest: &found };
        let counts = &compare("test", &rays, false, &triangles, &[way], 1)[0];
        assert_eq!((counts.checked, counts.brute_force), (6, 6));
        // The second hit is behind the first triangle, the third misses it, and the fifth is at an edge.
        assert_eq!((counts.lost, counts.false_hits, counts.at_edges), (2, 2, 1), "{counts:?}");
        assert_eq!(counts.examples.len(), 3);
    }
}
