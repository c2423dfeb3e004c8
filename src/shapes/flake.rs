//! The sphere flake.

use super::roots::accept;
use super::{ShapeError, error_bound, finite, grown, nearest_by_refining, positive_radius, tangents};
use crate::embree::{ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray, unit_f64};
use glam::{DMat3, DVec3, Vec2, Vec3};
use std::f64::consts::{FRAC_PI_3, PI, TAU};

/// The sphere flake of Haines ("A Proposal for Standard Graphics Environments", 1987). Each sphere carries nine touching spheres of a third
/// of its radius: six around its equator and three above. Its pole points away from its parent sphere. The spheres are opaque: where
/// branches overlap, nothing is removed.
///
/// There is no list of the (9^(depth + 1) - 1) / 8 spheres. Every branch is the same object rotated and scaled, so a ray that enters a
/// branch is transformed instead. Memory is that of the upper three generations for any depth.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereFlake {
    center: DVec3,
    radius: f64,
    /// Primitives for Embree: spheres of the upper generations, and below them whole branches.
    branches: Vec<Branch>,
    /// Bounding spheres of branches with their centres on the axis, indexed by the number of remaining generations.
    around: Vec<Around>,
}

/// A sphere and its descendants.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Branch {
    center: DVec3,
    radius: f64,
    /// Axes of its local space; z points away from the parent sphere.
    frame: DMat3,
    /// Generations of descendants in this primitive.
    depth: u32,
}

/// Bounding sphere of a branch whose root is the unit sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Around {
    /// Centre along z.
    height: f64,
    radius: f64,
}

/// Child spheres of a sphere.
const CHILDREN: usize = 9;
/// SIMD lanes of the test of all children at once.
const LANES: usize = 12;
/// Generations whose spheres are separate primitives for Embree.
const SORTED: u32 = 3;
/// Distance from the centre of a sphere to those of its children, in radii.
const DISTANCE: f64 = 4.0 / 3.0;
const SHRINK: f64 = 3.0;

/// Directions of the children, and their frames as rotations to the parent's space.
struct Arrangement {
    frames: [DMat3; CHILDREN],
    /// Coordinates of the directions by lane; NaN in unused lanes.
    lanes: [[f32; LANES]; 3],
}

impl Arrangement {
    fn new() -> Self {
        let directions: [DVec3; CHILDREN] = std::array::from_fn(|i| {
            if i < 6 {
                let (s, c) = (i as f64 * FRAC_PI_3).sin_cos();
                return DVec3::new(c, s, 0.0);
            }
            // The upper three of the twelve neighbours of a ball in a dense packing.
            let (s, c) = ((i - 6) as f64 * 2.0 * FRAC_PI_3 + 0.5 * FRAC_PI_3).sin_cos();
            let across = (1.0f64 / 3.0).sqrt();
            DVec3::new(c * across, s * across, (2.0f64 / 3.0).sqrt())
        });
        let frames = directions.map(|z| {
            // The component of the parent's axis perpendicular to `z`.
            let x = unit_f64(DVec3::Z - z * z.z).unwrap_or(DVec3::X);
            DMat3::from_cols(x, z.cross(x), z)
        });
        let mut lanes = [[f32::NAN; LANES]; 3];
        for (axis, lane) in lanes.iter_mut().enumerate() {
            for (value, direction) in lane.iter_mut().zip(&directions) {
                *value = direction[axis] as f32;
            }
        }
        Self { frames, lanes }
    }
}

static ARRANGEMENT: std::sync::LazyLock<Arrangement> = std::sync::LazyLock::new(Arrangement::new);

/// A line in the space of a branch, given by its point closest to the centre.
#[derive(Clone, Copy)]
struct Line {
    /// Closest point.
    p: DVec3,
    /// Unit direction.
    u: DVec3,
    /// Parameter of `p`, in radii of the primitive.
    start: f64,
    /// Radius of the branch's sphere, in radii of the primitive.
    unit: f64,
}

impl Line {
    /// The line in the space of the child with this frame.
    fn in_child(&self, frame: &DMat3) -> Self {
        let to_child = frame.transpose();
        let u = to_child * self.u;
        let p = SHRINK * (to_child * self.p) - DVec3::new(0.0, 0.0, SHRINK * DISTANCE);
        let s = -p.dot(u);
        let unit = self.unit / SHRINK;
        Self { p: p + s * u, u, start: self.start + s * unit, unit }
    }
}

/// Interval of parameters that is searched, in radii of the primitive.
struct Window {
    low: f64,
    high: f64,
}

/// Path of child indices from the primitive, with four bits each and the first index in the highest bits.
type Path = u64;

impl SphereFlake {
    /// Largest depth: spheres of 2e-6 of the largest radius. `f32` does not resolve smaller ones.
    pub const MAX_DEPTH: u32 = 12;

    /// A flake whose largest sphere has this centre and radius; `axis` points to its upper pole. `depth` 0 means that sphere only.
    pub fn new(center: DVec3, radius: f64, axis: DVec3, depth: u32) -> Result<Self, ShapeError> {
        let axis = unit_f64(finite(axis)?).ok_or(ShapeError::NoArea)?;
        let (x, y) = tangents(axis);
        Self::with_frame(center, radius, DMat3::from_cols(x, y, axis), depth)
    }

    /// A flake as from [`Self::new`]. `frame` is a rotation whose z axis points to the upper pole and whose x axis points to a child.
    pub fn with_frame(center: DVec3, radius: f64, frame: DMat3, depth: u32) -> Result<Self, ShapeError> {
        if depth > Self::MAX_DEPTH {
            return Err(ShapeError::Depth(depth));
        }
        let (center, radius) = (finite(center)?, positive_radius(radius)?);
        let sorted = SORTED.min(depth);
        let mut branches = vec![Branch { center, radius, frame, depth: 0 }];
        let mut generation = 0..1;
        for _ in 0..sorted {
            let start = branches.len();
            for parent in generation.clone() {
                for child in 0..CHILDREN {
                    branches.push(branches[parent].child(child));
                }
            }
            generation = start..branches.len();
        }
        for branch in &mut branches[generation] {
            branch.depth = depth - sorted;
        }
        Ok(Self { center, radius, branches, around: around(depth) })
    }

    /// Number of spheres.
    pub fn sphere_count(&self) -> u64 {
        let below = |depth: u32| (9u64.pow(depth + 1) - 1) / 8;
        self.branches.iter().map(|branch| below(branch.depth)).sum()
    }

    /// A bounding sphere of the flake.
    pub fn bounding_sphere(&self) -> (DVec3, f64) {
        let whole = self.around[self.around.len() - 1];
        let axis = self.branches[0].frame.z_axis;
        (self.center + axis * (whole.height * self.radius), whole.radius * self.radius)
    }

    /// Bytes of memory of this object.
    pub fn memory(&self) -> usize {
        size_of::<Self>() + size_of_val(self.branches.as_slice()) + size_of_val(self.around.as_slice())
    }

    /// The line in a branch's space, the factor (radii per ray parameter) and the offset of the parameter: `t = (s + offset) / factor`.
    /// `None` for a direction of zero and NaN.
    fn line(branch: &Branch, ray: &Ray) -> Option<(Line, f64, f64)> {
        let to_branch = branch.frame.transpose();
        let origin = to_branch * (ray.origin.as_dvec3() - branch.center) / branch.radius;
        let direction = to_branch * ray.direction.as_dvec3() / branch.radius;
        let factor = direction.length();
        let u = direction / factor;
        let offset = -origin.dot(u);
        let p = origin + offset * u;
        (p.is_finite() && factor < f64::INFINITY).then_some((
            Line { p, u, start: 0.0, unit: 1.0 },
            factor,
            offset,
        ))
    }

    /// Calls `visit` with both ends of the chord in each sphere of a branch, nearer branches first. Branches outside the window are
    /// skipped; `visit` may narrow the window.
    fn walk(
        &self,
        line: &Line,
        depth: u32,
        path: Path,
        window: &mut Window,
        visit: &mut impl FnMut(&mut Window, [f64; 2], Path),
    ) {
        let distance = line.p.length();
        if distance < 1.0 {
            let half = ((1.0 - distance) * (1.0 + distance)).sqrt() * line.unit;
            visit(window, [line.start - half, line.start + half], path);
        }
        if depth == 0 {
            return;
        }
        let around = self.around[depth as usize - 1];
        let (entries, exits) = chords(line, around);
        let scale = 1.0 / line.unit;
        let (low, high) =
            (((window.low - line.start) * scale) as f32, ((window.high - line.start) * scale) as f32);
        let mut order = [(0.0f32, 0u8); CHILDREN];
        let mut count = 0;
        for child in 0..CHILDREN {
            // Comparisons with NaN are false, so such a lane is a miss.
            if exits[child] >= low.next_down() && entries[child] <= high.next_up() {
                let entry = (entries[child], child as u8);
                let mut at = count;
                while at > 0 && order[at - 1].0 > entry.0 {
                    order[at] = order[at - 1];
                    at -= 1;
                }
                order[at] = entry;
                count += 1;
            }
        }
        let arrangement = &*ARRANGEMENT;
        for &(entry, child) in &order[..count] {
            if f64::from(entry) * line.unit + line.start > window.high {
                return;
            }
            let child_line = line.in_child(&arrangement.frames[usize::from(child)]);
            self.walk(&child_line, depth - 1, path << 4 | u64::from(child), window, visit);
        }
    }

    /// The nearest hit of a primitive in `(low, high]`, or any hit, with the path to its sphere.
    fn find(&self, primitive: u32, ray: &Ray, [low, high]: [f64; 2], any: bool) -> Option<(f64, Path)> {
        let branch = &self.branches[primitive as usize];
        let (line, factor, offset) = Self::line(branch, ray)?;
        let mut window = Window { low: low * factor - offset, high: high * factor - offset };
        let mut found = None;
        let start = window.low;
        self.walk(&line, branch.depth, 1, &mut window, &mut |window, [near, far], path| {
            let s = if near > start { near } else { far };
            if s > start && s <= window.high {
                window.high = if any { f64::NEG_INFINITY } else { s };
                found = Some((s, path));
            }
        });
        found.map(|(s, path)| ((s + offset) / factor, path))
    }

    /// The sphere at the end of a path.
    fn sphere_at(&self, primitive: u32, path: Path) -> Branch {
        let mut branch = self.branches[primitive as usize];
        // The path starts with a marker bit.
        let length = (63 - path.leading_zeros()) / 4;
        for step in (0..length).rev() {
            branch = branch.child((path >> (4 * step) & 15) as usize);
        }
        branch
    }

    /// Finds the path to the sphere whose surface is nearest to `p`, in a branch's space.
    fn nearest_sphere(&self, p: DVec3, depth: u32, unit: f64, path: Path, best: &mut (f64, Path)) {
        let distance = (p.length() - 1.0).abs() * unit;
        if distance < best.0 {
            *best = (distance, path);
        }
        if depth == 0 {
            return;
        }
        let around = self.around[depth as usize - 1];
        for (child, frame) in ARRANGEMENT.frames.iter().enumerate() {
            let p = SHRINK * (frame.transpose() * p) - DVec3::new(0.0, 0.0, SHRINK * DISTANCE);
            let gap = (p - DVec3::new(0.0, 0.0, around.height)).length() - around.radius;
            let unit = unit / SHRINK;
            if gap * unit < best.0 {
                self.nearest_sphere(p, depth - 1, unit, path << 4 | child as u64, best);
            }
        }
    }
}

/// Parameters at which the line enters and leaves the bounding spheres of all children, in units of the line; NaN for a miss. They are
/// computed in `f32` and slightly too wide.
#[inline]
fn chords(line: &Line, around: Around) -> ([f32; LANES], [f32; LANES]) {
    let lanes = &ARRANGEMENT.lanes;
    let (p, u) = (line.p.as_vec3(), line.u.as_vec3());
    let reach = ((DISTANCE * SHRINK + around.height) / SHRINK) as f32;
    let radius = (around.radius / SHRINK) as f32;
    // A line that hits the branch passes within two radii of its centre, so rounding is a few units of 4e-7.
    let room = radius * radius * (1.0 + 1e-5) + 1e-5 - reach * reach - p.length_squared();
    let mut entries = [0.0; LANES];
    let mut exits = [0.0; LANES];
    for i in 0..LANES {
        let [x, y, z] = [lanes[0][i], lanes[1][i], lanes[2][i]];
        let along = reach * (x * u.x + y * u.y + z * u.z);
        let towards = reach * (x * p.x + y * p.y + z * p.z);
        let half = (room + 2.0 * towards + along * along).sqrt();
        entries[i] = along - half - 1e-5;
        exits[i] = along + half + 1e-5;
    }
    (entries, exits)
}

/// Bounding spheres of branches of 0 to `depth` generations: the smallest with the centre on the axis, exact for the upper generations.
fn around(depth: u32) -> Vec<Around> {
    /// Generations whose spheres are enumerated.
    const EXACT: u32 = 3;
    let mut known = vec![Around { height: 0.0, radius: 1.0 }];
    for generations in 1..=depth {
        let exact = EXACT.min(generations);
        let below = known[(generations - exact) as usize];
        let whole = Branch { center: DVec3::ZERO, radius: 1.0, frame: DMat3::IDENTITY, depth: 0 };
        let mut spheres = vec![(DVec3::ZERO, 1.0)];
        let mut last = vec![whole];
        for step in 1..=exact {
            last = last.iter().flat_map(|parent| (0..CHILDREN).map(|i| parent.child(i))).collect();
            let own = |branch: &Branch| (branch.center, branch.radius);
            let all = |branch: &Branch| {
                let center = branch.center + branch.frame.z_axis * (below.height * branch.radius);
                (center, below.radius * branch.radius)
            };
            spheres.extend(last.iter().map(|branch| if step < exact { own(branch) } else { all(branch) }));
        }
        let radius = |height: f64| {
            let center = DVec3::new(0.0, 0.0, height);
            spheres.iter().map(|(c, r)| (*c - center).length() + r).fold(0.0, f64::max)
        };
        // The maximum of convex functions is convex, so ternary search finds the minimum.
        let (mut low, mut high) = (-1.0, 2.0);
        for _ in 0..60 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if radius(a) < radius(b) { high = b } else { low = a }
        }
        let height = 0.5 * (low + high);
        known.push(Around { height, radius: radius(height) * (1.0 + 1e-9) });
    }
    known
}

impl Branch {
    fn child(&self, index: usize) -> Self {
        let frame = self.frame * ARRANGEMENT.frames[index];
        Self {
            center: self.center + frame.z_axis * (DISTANCE * self.radius),
            radius: self.radius / SHRINK,
            frame,
            depth: 0,
        }
    }
}

impl Procedural for SphereFlake {
    fn primitive_count(&self) -> u32 {
        self.branches.len() as u32
    }

    fn bounds(&self, primitive: u32) -> Bounds3 {
        let branch = &self.branches[primitive as usize];
        let around = self.around[branch.depth as usize];
        let center = branch.center + branch.frame.z_axis * (around.height * branch.radius);
        let radius = around.radius * branch.radius;
        grown(Bounds3 { min: center - radius, max: center + radius })
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, primitive: u32, ray: &Ray) -> Option<f32> {
        let span = [0.0, f64::from(ray.t_max)];
        self.find(primitive, ray, span, false).and_then(|(t, _)| accept(t, ray.t_max))
    }

    fn occluded(&self, primitive: u32, ray: &Ray) -> bool {
        let span = [0.0, f64::from(ray.t_max)];
        self.find(primitive, ray, span, true).is_some_and(|(t, _)| accept(t, ray.t_max).is_some())
    }

    fn intersect_all(&self, primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        let branch = &self.branches[primitive as usize];
        let Some((line, factor, offset)) = Self::line(branch, ray) else { return };
        let mut window = Window { low: -offset, high: f64::from(ray.t_max) * factor - offset };
        self.walk(&line, branch.depth, 1, &mut window, &mut |_, ends, _| {
            hits.extend(ends.into_iter().filter_map(|s| accept((s + offset) / factor, ray.t_max)));
        });
    }

    fn refine(&self, primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        /// Relative tolerance of the parameter, for the rounding of `t` and of an instance's transform.
        const SAME: f64 = 1e-6;
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let rounded = f64::from(t);
        let around = [rounded * (1.0 - SAME), rounded * (1.0 + SAME)];
        let (t, path) = self.find(primitive, ray, around, false).unwrap_or_else(|| {
            let branch = &self.branches[primitive as usize];
            let p = origin + rounded * direction - branch.center;
            let p = branch.frame.transpose() * p / branch.radius;
            let mut best = (f64::INFINITY, 1);
            self.nearest_sphere(p, branch.depth, 1.0, 1, &mut best);
            (rounded, best.1)
        });
        let sphere = self.sphere_at(primitive, path);
        let normal = unit_f64(origin + t * direction - sphere.center).unwrap_or(DVec3::Y);
        let local = sphere.frame.transpose() * normal;
        let azimuth = (local.y.atan2(local.x) / TAU).rem_euclid(1.0);
        let polar = local.truncate().length().atan2(local.z) / PI;
        // Each generation adds the rounding error of its centre.
        let error: Vec3 = error_bound(self.center, 2.0 * self.radius) * 2.0;
        let uv = Vec2::new(azimuth as f32, polar as f32);
        SurfacePoint::new(sphere.center + sphere.radius * normal, error, normal, uv)
    }
}
