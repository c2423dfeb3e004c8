//! Path guiding: distributions of directions from which nearby photons arrived, to sample gather rays and paths.
//!
//! The idea is that of Jensen, "Importance Driven Path Tracing using the Photon Map" (Rendering Techniques 1995): a
//! histogram of the flux of near photons over the unit square, which the cosine-weighted map takes to directions.
//! Jensen builds it at every hit from about 50 photons. Here it is precomputed from many more photons for cells of the
//! scene's surfaces, and a hit looks up its cell. The density is positive wherever light may come from, so estimates
//! stay unbiased.

use super::SearchRegion;
use super::estimate::least_radius;
use super::map::{PhotonMap, Query, Scratch};
use super::photon::PhotonClasses;
use crate::bsdf::Lambert;
use crate::math::{Frame, luminance};
use crate::sampling::ONE_MINUS_EPSILON;
use crate::sampling::warp::disc_to_square;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Levels of a quadtree over the unit square.
const LEVELS: usize = 4;

/// Cells of the finest level along one side.
const SIDE: usize = 1 << LEVELS;

/// Inner nodes of the quadtree: 1 + 4 + 16 + 64.
const NODES: usize = (SIDE * SIDE - 1) / 3;

/// Settings of guides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuideParams {
    /// Classes of photons that guide; not those of light that is sampled in other ways, such as direct light by shadow
    /// rays.
    pub classes: PhotonClasses,
    /// Number of photons for each distribution.
    pub nearest: usize,
    /// Cells with more photons are divided. This is less than [`Self::nearest`], so that distributions change little
    /// from cell to cell.
    pub per_cell: usize,
    /// Share of directions sampled as for a Lambertian surface; its inverse bounds the weight of a sample.
    pub floor: f32,
    /// Search region.
    pub region: SearchRegion,
    /// Photons farther away than this are left out, render space.
    pub max_radius: f32,
}

impl GuideParams {
    /// Best value of [`Self::floor`] in measurements (`benches/guide.rs`).
    pub const FLOOR: f32 = 0.5;
    /// Best value of [`Self::nearest`], likewise.
    pub const NEAREST: usize = 512;
    /// Best value of [`Self::per_cell`], likewise.
    pub const PER_CELL: usize = 128;
}

/// Pseudo-count of the prior of each node: this many photons, spread evenly over its four parts, are added to those
/// found there. With few photons the distribution stays as even as that of the parent; with many the photons decide.
const PRIOR: f32 = 8.0;

/// Distributions of incident directions, by cells of the surfaces of a scene.
///
/// Cells are the leaves of six octrees, one for each axis and side that a surface may face.
#[derive(Clone, Debug)]
pub struct DirectionGuide {
    /// Children of each inner node.
    nodes: Vec<[Part; 8]>,
    /// Roots, by the axis nearest to the normals.
    roots: [Part; 6],
    records: Vec<Record>,
}

/// A distribution over the hemisphere around a normal, 268 bytes.
#[derive(Clone, Copy, Debug)]
struct Record {
    square: Quadtree,
    normal: Vec3,
}

/// Content of a cell.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// No photon fell into it.
    Empty,
    /// Divided: index of the node.
    Node(u32),
    /// Not divided: index of its distribution.
    Leaf(u32),
}

/// Levels of the octrees: the smallest cells have 1/1024 of the scene's diameter.
const CELL_LEVELS: u32 = 10;

/// Lower corner of the octrees in all axes, slightly outside the unit sphere. Irregular numbers keep the boundaries of
/// cells away from the planes in which walls usually lie, where rounding would decide.
const CORNER: f32 = -1.061_803;
/// Number of smallest cells in a unit of length.
const CELLS_PER_LENGTH: f32 = (1 << CELL_LEVELS) as f32 / 2.141_592_7;

/// Column, row and layer of the smallest cell at a position.
#[inline]
fn cell_of(position: Vec3) -> [u32; 3] {
    let largest = ((1u32 << CELL_LEVELS) - 1) as f32;
    ((position - CORNER) * CELLS_PER_LENGTH).to_array().map(|x| x.clamp(0.0, largest) as u32)
}

/// The octant of a cell at this level.
#[inline]
fn octant(cell: [u32; 3], level: u32) -> usize {
    let shift = CELL_LEVELS - 1 - level;
    let bit = |x: u32| (x >> shift & 1) as usize;
    bit(cell[0]) | bit(cell[1]) << 1 | bit(cell[2]) << 2
}

/// Number of the axis and side nearest to a normal. The axes have different weights, because of surfaces at 45 degrees.
#[inline]
fn facing(normal: Vec3) -> usize {
    let [x, y, z] = (normal.abs() * Vec3::new(1.0, 1.07, 0.93)).to_array();
    let axis = if x > y && x > z { 0 } else { 2 - usize::from(y > z) };
    2 * axis + usize::from(normal[axis] < 0.0)
}

/// A photon and the path to its cell.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Placed {
    /// Octants from the root down, three bits each, below the number of the axis and side.
    path: u64,
    photon: u32,
}

impl DirectionGuide {
    /// Distributions for all places where `map` has photons in [`GuideParams::classes`]; `None` where there is none.
    ///
    /// The result is a function of the photons and the parameters. The number of threads changes no bit, and neither
    /// does a change of the unit of power or length by a power of two.
    pub fn build(map: &PhotonMap, params: &GuideParams) -> Option<Self> {
        let mut placed: Vec<Placed> = (0..map.len())
            .into_par_iter()
            .filter_map(|index| {
                let photon = map.photon(index);
                params.classes.contains(photon.class()).then(|| {
                    let cell = cell_of(photon.position);
                    let path = (0..CELL_LEVELS).fold(facing(photon.normal()) as u64, |path, level| {
                        path << 3 | octant(cell, level) as u64
                    });
                    Placed { path, photon: index as u32 }
                })
            })
            .collect();
        if placed.is_empty() {
            return None;
        }
        placed.par_sort_unstable();
        let mut guide = Self { nodes: Vec::new(), roots: [Part::Empty; 6], records: Vec::new() };
        let mut leaves = Vec::new();
        for root in 0..6 {
            let below = |path: u64| placed.partition_point(|photon| photon.path >> (3 * CELL_LEVELS) < path);
            let photons = &placed[below(root as u64)..below(root as u64 + 1)];
            guide.roots[root] = guide.divide(photons, 0, params.per_cell.max(1), &mut leaves);
        }
        guide.records = leaves
            .par_iter()
            .with_max_len(16)
            .map_init(Scratch::default, |scratch, photons| {
                let photon = map.photon(most_central(map, photons) as usize);
                record(map, params, photon.position, photon.normal(), scratch)
            })
            .collect();
        Some(guide)
    }

    /// Divides the cell of `photons`, which are sorted by their paths, until no part has more than `per_cell`; appends
    /// the photons of each leaf to `leaves`.
    fn divide<'a>(
        &mut self,
        photons: &'a [Placed],
        level: u32,
        per_cell: usize,
        leaves: &mut Vec<&'a [Placed]>,
    ) -> Part {
        if photons.is_empty() {
            return Part::Empty;
        }
        if photons.len() <= per_cell || level == CELL_LEVELS {
            leaves.push(photons);
            return Part::Leaf(leaves.len() as u32 - 1);
        }
        let node = self.nodes.len();
        self.nodes.push([Part::Empty; 8]);
        let mut rest = photons;
        for octant in 0..8u64 {
            let here = |photon: &Placed| photon.path >> (3 * (CELL_LEVELS - 1 - level)) & 7 <= octant;
            let (part, after) = rest.split_at(rest.partition_point(here));
            rest = after;
            self.nodes[node][octant as usize] = self.divide(part, level + 1, per_cell, leaves);
        }
        Part::Node(node as u32)
    }

    /// Number of distributions.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Never true: there is at least one distribution.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<[Part; 8]>() + self.records.capacity() * size_of::<Record>()
    }

    /// The distribution of the cell of `position` on a surface that faces the unit geometric `normal`, rotated to the
    /// unit `shading` normal. `None` where the cell holds no photon.
    #[inline]
    pub fn at(&self, position: Vec3, normal: Vec3, shading: Vec3) -> Option<GuideLobe<'_>> {
        let cell = cell_of(position);
        let mut part = self.roots[facing(normal)];
        for level in 0..CELL_LEVELS {
            let Part::Node(node) = part else { break };
            part = self.nodes[node as usize][octant(cell, level)];
        }
        let Part::Leaf(index) = part else { return None };
        let record = &self.records[index as usize];
        Some(GuideLobe { square: &record.square, frame: turned(record.normal, shading)? })
    }
}

/// The photon nearest to the mean position of some; the first of equally near ones.
fn most_central(map: &PhotonMap, photons: &[Placed]) -> u32 {
    let place = |photon: &Placed| map.position(photon.photon as usize).as_dvec3();
    let mean = photons.iter().map(place).sum::<DVec3>() / photons.len() as f64;
    let distance = |photon: &Placed| place(photon).distance_squared(mean);
    photons.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(0, |photon| photon.photon)
}

/// The distribution of one place.
fn record(
    map: &PhotonMap,
    params: &GuideParams,
    position: Vec3,
    normal: Vec3,
    scratch: &mut Scratch,
) -> Record {
    let query = Query {
        region: params.region,
        classes: params.classes,
        max_radius: params.max_radius,
        ..Query::nearest(position, normal, params.nearest)
    };
    let frame = Frame::from_z(normal);
    let found = map.search(&query, scratch);
    let radius_squared = found.farthest_squared().max(least_radius(position).powi(2));
    let mut counts = [0.0; SIDE * SIDE];
    let (mut sum, mut sum_of_squares) = (0.0f64, 0.0f64);
    for (index, distance_squared) in found.iter() {
        let photon = map.photon(index);
        let wi = frame.to_local(photon.wi());
        let weight = luminance(photon.power()).max(0.0) * (1.0 - distance_squared / radius_squared);
        if !(wi.z > 0.0 && weight > 0.0) {
            continue;
        }
        splat(&mut counts, disc_to_square(wi.truncate()), weight);
        sum += f64::from(weight);
        sum_of_squares += f64::from(weight).powi(2);
    }
    // Effective number of photons: that many of equal weight would have the same noise (Kish 1965).
    let effective = if sum > 0.0 { sum * sum / sum_of_squares } else { 0.0 };
    let per_weight = if sum > 0.0 { (effective / sum) as f32 } else { 0.0 };
    counts.iter_mut().for_each(|count| *count *= per_weight);
    Record { square: Quadtree::of(&counts, params.floor), normal }
}

/// Spreads `weight` over the four cells nearest to a point of the unit square.
fn splat(counts: &mut [f32; SIDE * SIDE], p: Vec2, weight: f32) {
    let at = (p * SIDE as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(SIDE as f32 - 1.0));
    let low = at.floor().min(Vec2::splat(SIDE as f32 - 2.0));
    let share = at - low;
    let first = low.y as usize * SIDE + low.x as usize;
    counts[first] += weight * (1.0 - share.x) * (1.0 - share.y);
    counts[first + 1] += weight * share.x * (1.0 - share.y);
    counts[first + SIDE] += weight * (1.0 - share.x) * share.y;
    counts[first + SIDE + 1] += weight * share.x * share.y;
}

/// The frame [`Frame::from_z`] of `from`, rotated to `to` by the shortest rotation; `None` where they point in nearly
/// opposite directions.
#[inline]
fn turned(from: Vec3, to: Vec3) -> Option<Frame> {
    let frame = Frame::from_z(from);
    let cos = from.dot(to);
    if !(cos > -0.5) {
        return None;
    }
    let x = frame.x - (from + to) * (frame.x.dot(to) / (1.0 + cos));
    Some(Frame { x, y: to.cross(x), z: to })
}

/// A distribution of directions at one place of a surface.
#[derive(Clone, Copy, Debug)]
pub struct GuideLobe<'a> {
    square: &'a Quadtree,
    frame: Frame,
}

/// A distribution of directions from the photons nearest to one place, for places that are used often enough to be
/// worth a search of their own.
#[derive(Clone, Copy, Debug)]
pub struct LocalGuide(Record);

impl LocalGuide {
    /// Builds it from the photons of `map` around `position` on a surface that faces the unit geometric `normal`.
    /// [`GuideParams::per_cell`] is not used.
    pub fn new(
        map: &PhotonMap,
        params: &GuideParams,
        position: Vec3,
        normal: Vec3,
        scratch: &mut Scratch,
    ) -> Self {
        Self(record(map, params, position, normal, scratch))
    }

    /// The distribution rotated to the unit `shading` normal; `None` where that faces away.
    pub fn turned(&self, shading: Vec3) -> Option<GuideLobe<'_>> {
        Some(GuideLobe { square: &self.0.square, frame: turned(self.0.normal, shading)? })
    }
}

impl GuideLobe<'_> {
    /// Density of the unit `direction` over that of Lambertian sampling; zero below the surface.
    #[inline]
    pub fn over_lambert(&self, direction: Vec3) -> f32 {
        let wi = self.frame.to_local(direction);
        if wi.z > 0.0 { self.square.density(disc_to_square(wi.truncate())) } else { 0.0 }
    }

    /// Samples a direction for `u` in `[0, 1)^2`. Returns it in world axes, its cosine to the shading normal, above
    /// zero, and its density per solid angle, 1/sr.
    #[inline]
    pub fn sample(&self, u: Vec2) -> (Vec3, f32, f32) {
        let (p, density) = self.square.sample(u);
        let wi = Lambert::sample_direction(p);
        (self.frame.to_world(wi), wi.z, density * wi.z * FRAC_1_PI)
    }

    /// Density per solid angle, 1/sr, with which [`Self::sample`] samples the unit `direction`; zero below the surface.
    #[inline]
    pub fn pdf_solid_angle(&self, direction: Vec3) -> f32 {
        let cos = direction.dot(self.frame.z);
        self.over_lambert(direction) * cos.max(0.0) * FRAC_1_PI
    }
}

/// A piecewise constant density over the unit square, a quadtree: each node divides its mass among its quadrants.
///
/// A square is halved by `x` and each half by `y`, in 256ths, so that the densities integrate to one without rounding.
/// Sampling preserves strata: points near each other stay near each other, except across the boundaries of cells.
#[derive(Clone, Copy, Debug)]
struct Quadtree {
    /// Share of the left half; share of the lower part in the left half, and in the right half.
    splits: [[u8; 3]; NODES],
}

/// Number of the first node of a level.
const fn first_node(level: usize) -> usize {
    ((1 << (2 * level)) - 1) / 3
}

impl Quadtree {
    /// The density from `counts` photons, row after row, mixed with a constant density of weight `floor`.
    fn of(counts: &[f32; SIDE * SIDE], floor: f32) -> Self {
        // Masses of all cells, level after level; the last ones are the leaves.
        let mut masses = [0.0f32; NODES + SIDE * SIDE];
        masses[NODES..].copy_from_slice(counts);
        sum_up(&mut masses);
        let mut shares = [0.0f32; NODES + SIDE * SIDE];
        shares[0] = 1.0;
        for level in 0..LEVELS {
            for node in 0..1usize << (2 * level) {
                let parent = first_node(level) + node;
                for child in children(level, node) {
                    let share = (masses[child] + 0.25 * PRIOR) / (masses[parent] + PRIOR);
                    shares[child] = shares[parent] * share;
                }
            }
        }
        let even = floor.clamp(0.0, 1.0) / (SIDE * SIDE) as f32;
        shares[NODES..].iter_mut().for_each(|share| *share = even + (1.0 - floor.clamp(0.0, 1.0)) * *share);
        sum_up(&mut shares);
        let mut splits = [[128; 3]; NODES];
        for level in 0..LEVELS {
            for node in 0..1usize << (2 * level) {
                let [a, b, c, d] = children(level, node).map(|child| shares[child]);
                splits[first_node(level) + node] = [split(a + c, b + d), split(a, c), split(b, d)];
            }
        }
        Self { splits }
    }

    /// A point for `u` in `[0, 1)^2`, and the density there.
    #[inline]
    fn sample(&self, u: Vec2) -> (Vec2, f32) {
        let (mut x, mut y) = (u.x, u.y);
        let (mut column, mut row) = (0, 0);
        let mut density = 1.0;
        for level in 0..LEVELS {
            let splits = &self.splits[first_node(level) + (row << level | column)];
            let right = descend(splits[0], &mut x, &mut density);
            let upper = descend(splits[1 + right], &mut y, &mut density);
            (column, row) = (2 * column + right, 2 * row + upper);
        }
        let p = Vec2::new(column as f32 + x, row as f32 + y) / SIDE as f32;
        (p.min(Vec2::splat(ONE_MINUS_EPSILON)), density)
    }

    /// Density at a point of the unit square.
    #[inline]
    fn density(&self, p: Vec2) -> f32 {
        let cell = |x: f32| ((x * SIDE as f32) as usize).min(SIDE - 1);
        let (column, row) = (cell(p.x), cell(p.y));
        let mut density = 1.0;
        for level in 0..LEVELS {
            let (below, bit) = (LEVELS - level, LEVELS - level - 1);
            let [split_x, below_left, below_right] =
                self.splits[first_node(level) + (row >> below << level | column >> below)];
            let share = |split: u8, upper: bool| {
                let low = f32::from(split) / 128.0;
                if upper { 2.0 - low } else { low }
            };
            let right = column >> bit & 1 == 1;
            density *= share(split_x, right)
                * share(if right { below_right } else { below_left }, row >> bit & 1 == 1);
        }
        density
    }
}

/// `256 / n`.
const RECIPROCALS: [f32; 256] = {
    let mut all = [0.0; 256];
    let mut n = 1;
    while n < 256 {
        all[n] = 256.0 / n as f32;
        n += 1;
    }
    all
};

/// Descends to the upper half (1) if `u` is not below the split, otherwise to the lower half (0), and rescales `u` so
/// that it is uniform again. There are no branches, because none could be predicted.
#[inline]
fn descend(split: u8, u: &mut f32, density: &mut f32) -> usize {
    let split = usize::from(split);
    let low = split as f32 * (1.0 / 256.0);
    let upper = usize::from(*u >= low);
    let share = [split, 256 - split][upper];
    *u = ((*u - low * upper as f32) * RECIPROCALS[share & 255]).min(ONE_MINUS_EPSILON);
    *density *= share as f32 * (1.0 / 128.0);
    upper
}

/// The share of `low` in 256ths, between 1 and 255.
fn split(low: f32, high: f32) -> u8 {
    let share = if low + high > 0.0 { low / (low + high) } else { 0.5 };
    (share * 256.0).round().clamp(1.0, 255.0) as u8
}

/// Children of `node` of a level, where nodes count from the first of their level, as indices among all cells.
fn children(level: usize, node: usize) -> [usize; 4] {
    let (row, column) = (node >> level, node & ((1 << level) - 1));
    let child =
        |x: usize, y: usize| first_node(level + 1) + ((2 * row + y) << (level + 1) | (2 * column + x));
    [child(0, 0), child(1, 0), child(0, 1), child(1, 1)]
}

/// Sums the leaves up to the root.
fn sum_up(cells: &mut [f32; NODES + SIDE * SIDE]) {
    for level in (0..LEVELS).rev() {
        for node in 0..1usize << (2 * level) {
            let [a, b, c, d] = children(level, node).map(|child| cells[child]);
            cells[first_node(level) + node] = (a + b) + (c + d);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::chi_square::ChiSquare;
    use crate::math::Rgb;
    use crate::photons::{Photon, PhotonClass};
    use crate::sampling::{Rng, Stream, warp};
    use std::f64::consts::PI;

    const PARAMS: GuideParams = GuideParams {
        classes: PhotonClasses::only(PhotonClass::Indirect),
        nearest: 300,
        per_cell: 100,
        floor: GuideParams::FLOOR,
        region: SearchRegion::Disc,
        max_radius: f32::INFINITY,
    };

    /// Photons on a square of side 1 in the plane through the origin with this normal: most of them from a cone around
    /// one direction, others cosine-distributed, direct ones from elsewhere, their powers multiplied by `power`.
    fn photons(count: u64, normal: Vec3, power: f32) -> Vec<Photon> {
        let frame = Frame::from_z(normal);
        (0..count)
            .map(|i| {
                let mut rng = Rng::new(5, Stream::Measure, i);
                let p = rng.next_2d() - 0.5;
                let kind = rng.next_f32();
                let (class, wi) = if kind < 0.2 {
                    (PhotonClass::Direct, Vec3::new(-0.6, 0.0, 0.8))
                } else if kind < 0.7 {
                    let cone = warp::square_to_cone(rng.next_2d(), 0.02);
                    (PhotonClass::Indirect, Frame::from_z(Vec3::new(0.48, 0.64, 0.6)).to_world(cone))
                } else {
                    (PhotonClass::Indirect, warp::square_to_cosine_hemisphere(rng.next_2d()))
                };
                let position = frame.to_world(p.extend(0.0));
                let rgb = Rgb::new(1.0, 0.5, 0.2) * power;
                Photon::new(position, rgb, frame.to_world(wi), normal, class, 0.5)
            })
            .collect()
    }

    fn guide(normal: Vec3) -> DirectionGuide {
        DirectionGuide::build(&PhotonMap::build(photons(4000, normal, 1.0), 4000), &PARAMS).unwrap()
    }

    const NORMALS: [Vec3; 4] =
        [Vec3::Y, Vec3::NEG_Z, Vec3::new(0.48, -0.6, 0.64), Vec3::new(-0.707_106_77, 0.0, 0.707_106_77)];

    #[test]
    fn densities_are_those_of_the_directions_drawn() {
        for (i, normal) in NORMALS.into_iter().enumerate() {
            let guide = guide(normal);
            let shading = (normal + 0.4 * Frame::from_z(normal).x).normalize();
            for shading in [normal, shading] {
                let lobe = guide.at(Vec3::ZERO, normal, shading).unwrap();
                let harness =
                    ChiSquare { bins: [SIDE, SIDE], runs: 8, seed: i as u64, ..ChiSquare::default() };
                // The test uses points of the square, whose cells are the bins: the density per solid angle jumps
                // within bins. The map to the hemisphere has the density cos / pi.
                harness
                    .unit_square(
                        |rng| {
                            let (direction, cos, pdf) = lobe.sample(rng.next_2d());
                            assert!((direction.length() - 1.0).abs() < 1e-6);
                            assert!((direction.dot(shading) - cos).abs() < 1e-6 && cos > 0.0 && pdf > 0.0);
                            Some(disc_to_square(lobe.frame.to_local(direction).truncate()).as_dvec2())
                        },
                        |p| {
                            let wi = Lambert::sample_direction(p.as_vec2());
                            let pdf = lobe.pdf_solid_angle(lobe.frame.to_world(wi));
                            f64::from(pdf) * PI / f64::from(wi.z)
                        },
                    )
                    .unwrap();
            }
        }
    }

    #[test]
    fn densities_integrate_to_one_over_the_hemisphere() {
        let guide = guide(NORMALS[2]);
        let lobe = guide.at(Vec3::ZERO, NORMALS[2], NORMALS[2]).unwrap();
        let mut rng = Rng::new(6, Stream::Measure, 0);
        let n = 1_000_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let value = f64::from(lobe.pdf_solid_angle(warp::square_to_sphere(rng.next_2d()))) * 4.0 * PI;
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * error && error < 0.005, "{mean} +- {error}");
    }

    #[test]
    fn a_sample_knows_its_density() {
        for normal in NORMALS {
            let guide = guide(normal);
            let lobe = guide.at(Vec3::ZERO, normal, normal).unwrap();
            let mut rng = Rng::new(7, Stream::Measure, 0);
            let mut off = 0;
            for _ in 0..100_000 {
                let (direction, _, pdf) = lobe.sample(rng.next_2d());
                off += u32::from((lobe.pdf_solid_angle(direction) / pdf - 1.0).abs() > 1e-4);
            }
            // At the boundaries of cells rounding decides.
            assert!(off < 20, "{off} of 100000 samples");
        }
    }

    #[test]
    fn it_looks_where_light_comes_from_and_nowhere_never() {
        for normal in NORMALS {
            let guide = guide(normal);
            let lobe = guide.at(Vec3::ZERO, normal, normal).unwrap();
            let frame = Frame::from_z(normal);
            let density = |wi: Vec3| lobe.pdf_solid_angle(frame.to_world(wi)) / (wi.z * FRAC_1_PI);
            // Indirect photons count, direct photons do not.
            assert!(density(Vec3::new(0.48, 0.64, 0.6)) > 5.0);
            assert!(density(Vec3::new(-0.6, 0.0, 0.8)) < 1.0);
            let mut rng = Rng::new(8, Stream::Measure, 0);
            for _ in 0..10_000 {
                let d = density(warp::square_to_cosine_hemisphere(rng.next_2d()));
                assert!(d > 0.8 * PARAMS.floor, "{d}");
            }
            assert_eq!(lobe.pdf_solid_angle(-normal), 0.0);
            assert!(guide.at(Vec3::ZERO, -normal, -normal).is_none());
        }
    }

    fn densities(guide: &DirectionGuide) -> Vec<[[u8; 3]; NODES]> {
        guide.records.iter().map(|record| record.square.splits).collect()
    }

    #[test]
    fn threads_order_and_power_change_no_bit() {
        let build = |photons: Vec<Photon>, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| DirectionGuide::build(&PhotonMap::build(photons, 1), &PARAMS).unwrap())
        };
        let one = densities(&build(photons(4000, Vec3::Y, 1.0), 1));
        assert!(one.len() > 20);
        let mut reversed = photons(4000, Vec3::Y, 1.0);
        reversed.reverse();
        assert_eq!(one, densities(&build(reversed, 2)));
        for power in [-40, 60] {
            assert_eq!(one, densities(&build(photons(4000, Vec3::Y, 2f32.powi(power)), 3)));
        }
    }

    #[test]
    fn few_photons_dark_ones_and_none() {
        for count in 0..4 {
            for power in [0.0, 1e-30, 1.0, 1e30] {
                let mut all = photons(count, Vec3::Y, power);
                all.iter_mut().for_each(|photon| {
                    let place = photon.position * 1e3;
                    *photon =
                        Photon::new(place, photon.power(), photon.wi(), Vec3::Y, PhotonClass::Indirect, 0.5);
                });
                let guide = DirectionGuide::build(&PhotonMap::build(all.clone(), 1), &PARAMS);
                assert_eq!(guide.is_some(), count > 0);
                let Some(guide) = guide else { continue };
                assert!(guide.memory_bytes() > 0 && !guide.is_empty());
                for photon in all {
                    let lobe = guide.at(photon.position, Vec3::Y, Vec3::Y).unwrap();
                    let (direction, cos, pdf) = lobe.sample(Vec2::splat(0.3));
                    assert!(direction.is_finite() && cos > 0.0 && pdf.is_finite() && pdf > 0.0);
                }
                assert!(guide.at(Vec3::NAN, Vec3::Y, Vec3::Y).is_none() || count > 0);
            }
        }
        let direct = PhotonClasses::only(PhotonClass::Shadow);
        let map = PhotonMap::build(photons(100, Vec3::Y, 1.0), 1);
        assert!(DirectionGuide::build(&map, &GuideParams { classes: direct, ..PARAMS }).is_none());
    }
}
