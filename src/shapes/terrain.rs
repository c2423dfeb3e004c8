//! Terrain: bilinear surfaces over height grids.

use super::roots::accept;
use super::{ShapeError, error_bound, grown, nearest_by_refining};
use crate::embree::{ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray, unit_f64};
use crate::textures::Octaves;
use glam::{DAffine3, DVec2, DVec3, IVec2, UVec2, Vec2};
use rayon::prelude::*;
use std::sync::Arc;

/// Heights over a square grid, with the minima and maxima of a hierarchy of squares.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightGrid {
    /// Cells along each side.
    cells: u32,
    /// Heights of corners by row along z, then x; each side has one more corner than cells.
    heights: Vec<f32>,
    /// Minimum and maximum height of squares of 4, 8, 16, 32 cells, by row.
    extremes: [Vec<[f32; 2]>; LEVELS],
}

/// Parameters of a noise landscape: Perlin's turbulence at the corners of the grid (Jensen & Christensen 1995, section 5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainNoise {
    /// Number of the largest features along one side.
    pub features: f64,
    /// Number of octaves, each of half the wavelength of the one before; none is finer than two cells.
    pub octaves: u32,
    /// Seed of the landscape.
    pub seed: u32,
    /// Whether the creases of turbulence point upward.
    pub ridges: bool,
}

/// Side length of the smallest squares, in cells.
const SMALLEST: u32 = 4;
/// Number of levels of squares.
const LEVELS: usize = 4;
/// Side length of a primitive, in cells.
const BLOCK: u32 = SMALLEST << (LEVELS - 1);

impl HeightGrid {
    /// Most cells along a side.
    pub const MAX_CELLS: u32 = 8192;

    /// A grid of (`cells` + 1)^2 heights, by rows.
    pub fn new(cells: u32, heights: Vec<f32>) -> Result<Self, ShapeError> {
        let corners = (cells as usize + 1).pow(2);
        let fits = (1..=Self::MAX_CELLS).contains(&cells) && heights.len() == corners;
        if !(fits && heights.iter().all(|height| height.is_finite())) {
            return Err(ShapeError::Heights { cells, heights: heights.len() });
        }
        let mut grid = Self { cells, heights, extremes: Default::default() };
        for level in 0..LEVELS {
            let size = SMALLEST << level;
            let count = cells.div_ceil(size);
            let squares = (0..count * count).into_par_iter().map(|square| {
                let (x, z) = (square % count * size, square / count * size);
                let ends = UVec2::new((x + size).min(cells), (z + size).min(cells));
                let rows = (z..=ends.y).map(|z| grid.row(z, x, ends.x));
                rows.flatten()
                    .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &h| [low.min(h), high.max(h)])
            });
            grid.extremes[level] = squares.collect();
        }
        Ok(grid)
    }

    /// A landscape with heights that fill [0, 1].
    pub fn from_noise(cells: u32, noise: &TerrainNoise) -> Result<Self, ShapeError> {
        let cells_checked = cells.clamp(1, Self::MAX_CELLS);
        let size = 1.0 / noise.features;
        let finest =
            (size * 0.5f64.powi(noise.octaves.saturating_sub(1).min(30) as i32)).max(2.0 / f64::from(cells));
        // An octave at exactly the finest wavelength would have faded away; half of that wavelength keeps the last octave whole.
        let octaves = Octaves { size, finest: 0.5 * finest, seed: noise.seed };
        let side = cells_checked + 1;
        let raw: Vec<f64> = (0..side * side)
            .into_par_iter()
            .map(|corner| {
                let p =
                    DVec2::new(f64::from(corner % side), f64::from(corner / side)) / f64::from(cells_checked);
                // The offset avoids the lattice of the first octave, on which all noise is zero.
                let turbulence = octaves.turbulence(p.extend(0.37 * size), 0.0);
                if noise.ridges { -turbulence } else { turbulence }
            })
            .collect();
        let low = raw.iter().copied().fold(f64::INFINITY, f64::min);
        let high = raw.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
        Self::new(cells, raw.into_iter().map(|h| ((h - low) * scale) as f32).collect())
    }

    /// Cells along each side.
    pub fn cells(&self) -> u32 {
        self.cells
    }

    /// Minimum and maximum height.
    pub fn range(&self) -> [f32; 2] {
        let whole = self.extremes[LEVELS - 1].iter();
        whole.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], &[low, high]| [a.min(low), b.max(high)])
    }

    /// Bytes of memory of this grid.
    pub fn memory(&self) -> usize {
        let extremes: usize = self.extremes.iter().map(|level| size_of_val(level.as_slice())).sum();
        size_of::<Self>() + size_of_val(self.heights.as_slice()) + extremes
    }

    fn row(&self, z: u32, from: u32, to: u32) -> &[f32] {
        let start = z as usize * (self.cells as usize + 1);
        &self.heights[start + from as usize..=start + to as usize]
    }

    /// Height of a corner.
    pub fn height(&self, x: u32, z: u32) -> f32 {
        self.heights[z as usize * (self.cells as usize + 1) + x as usize]
    }

    /// Minimum and maximum height of a square.
    fn extremes(&self, level: usize, square: UVec2) -> [f64; 2] {
        let count = self.cells.div_ceil(SMALLEST << level);
        self.extremes[level][(square.y * count + square.x) as usize].map(f64::from)
    }

    /// The bilinear surface over a cell: `a + b u + c v + e u v`.
    fn patch(&self, cell: UVec2) -> [f64; 4] {
        let at = |x: u32, z: u32| f64::from(self.height(cell.x + x, cell.y + z));
        let (a, right, up, both) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
        [a, right - a, up - a, both - right - up + a]
    }

    /// Slope at a corner, from the heights of its neighbours.
    fn corner_slope(&self, corner: UVec2) -> DVec2 {
        let UVec2 { x, y: z } = corner;
        let slope = |low: (u32, u32), high: (u32, u32), steps: u32| {
            (f64::from(self.height(high.0, high.1)) - f64::from(self.height(low.0, low.1))) / f64::from(steps)
        };
        let (left, right) = (x.saturating_sub(1), (x + 1).min(self.cells));
        let (front, back) = (z.saturating_sub(1), (z + 1).min(self.cells));
        DVec2::new(slope((left, z), (right, z), right - left), slope((x, front), (x, back), back - front))
    }
}

/// A height grid in space: a bilinear surface over each cell, with shading normals that are smoothed across cells. Normals point up.
///
/// In grid space, x and z count cells and y is the height. Rays are transformed to it in `f64`. Embree sorts blocks of 32 by 32 cells.
/// Within a block, rays descend from larger to smaller squares and skip those whose heights they do not reach.
#[derive(Clone, Debug, PartialEq)]
pub struct Terrain {
    grid: Arc<HeightGrid>,
    to_object: DAffine3,
    to_grid: DAffine3,
}

/// A ray in grid space.
struct GridRay {
    origin: DVec3,
    direction: DVec3,
    inverse: DVec3,
}

impl GridRay {
    /// The part of `span` with `low <= coordinate <= high`.
    #[inline]
    fn clip(&self, axis: usize, low: f64, high: f64, span: [f64; 2]) -> [f64; 2] {
        let a = (low - self.origin[axis]) * self.inverse[axis];
        let b = (high - self.origin[axis]) * self.inverse[axis];
        [span[0].max(a.min(b)), span[1].min(a.max(b))]
    }
}

/// Extension of each patch beyond its cell, in cells, so that no ray passes between two patches.
const OVERLAP: f64 = 1e-9;

impl Terrain {
    /// The grid under a transform from grid space (cells along x and z, heights along y).
    pub fn new(grid: Arc<HeightGrid>, to_object: DAffine3) -> Result<Self, ShapeError> {
        let to_grid = to_object.inverse();
        if !(to_object.is_finite() && to_grid.is_finite()) {
            return Err(ShapeError::NoArea);
        }
        Ok(Self { grid, to_object, to_grid })
    }

    /// A bounding box of the terrain.
    pub fn bounds(&self) -> Bounds3 {
        (0..self.primitive_count())
            .fold(Bounds3::EMPTY, |all, block| all.union(Procedural::bounds(self, block)))
    }

    /// The grid.
    pub fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn ray(&self, ray: &Ray) -> Option<GridRay> {
        let origin = self.to_grid.transform_point3(ray.origin.as_dvec3());
        let direction = self.to_grid.transform_vector3(ray.direction.as_dvec3());
        // A finite value in place of 1/0, as 0 * infinity would be NaN.
        let inverse = direction.to_array().map(|d| if d == 0.0 { 1e300 } else { 1.0 / d });
        let fine = origin.is_finite() && direction.is_finite() && direction != DVec3::ZERO;
        fine.then_some(GridRay { origin, direction, inverse: inverse.into() })
    }

    fn block(&self, primitive: u32) -> UVec2 {
        let count = self.grid.cells.div_ceil(BLOCK);
        UVec2::new(primitive % count, primitive / count)
    }

    /// Calls `found` with the parameters of hits in a square and in `span`, in order, until it returns false. Then this function returns
    /// false too.
    fn walk(
        &self,
        ray: &GridRay,
        level: usize,
        square: UVec2,
        span: [f64; 2],
        found: &mut impl FnMut(f64) -> bool,
    ) -> bool {
        let size = SMALLEST << level;
        let low = square * size;
        let high = (low + size).min(UVec2::splat(self.grid.cells));
        let [least, greatest] = self.grid.extremes(level, square);
        let flat = ray.clip(0, f64::from(low.x), f64::from(high.x), span);
        let flat = ray.clip(2, f64::from(low.y), f64::from(high.y), flat);
        // The slab of a level surface has no thickness; the margin keeps rounding from losing it.
        let margin = 1e-12 * (least.abs() + greatest.abs()) + f64::MIN_POSITIVE;
        let inside = ray.clip(1, least - margin, greatest + margin, flat);
        if !(inside[0] <= inside[1]) {
            return true;
        }
        if level == 0 {
            return self.cells(ray, low, high, inside, found);
        }
        let first = UVec2::new(u32::from(ray.direction.x < 0.0), u32::from(ray.direction.z < 0.0));
        // A ray passes at most one of the two squares between the nearest and the farthest.
        for step in [UVec2::new(0, 0), UVec2::new(1, 0), UVec2::new(0, 1), UVec2::new(1, 1)] {
            let child = square * 2 + (first ^ step);
            if (child * (size / 2)).cmplt(UVec2::splat(self.grid.cells)).all()
                && !self.walk(ray, level - 1, child, inside, found)
            {
                return false;
            }
        }
        true
    }

    /// Does the work of [`Self::walk`] cell by cell.
    fn cells(
        &self,
        ray: &GridRay,
        low: UVec2,
        high: UVec2,
        span: [f64; 2],
        found: &mut impl FnMut(f64) -> bool,
    ) -> bool {
        let step = IVec2::new(
            if ray.direction.x < 0.0 { -1 } else { 1 },
            if ray.direction.z < 0.0 { -1 } else { 1 },
        );
        let entry = ray.origin + span[0] * ray.direction;
        let (low, high) = (low.as_ivec2(), high.as_ivec2());
        let mut cell = IVec2::new(entry.x.floor() as i32, entry.z.floor() as i32).clamp(low, high - 1);
        let mut start = span[0];
        let border = |cell: i32, step: i32, axis: usize| {
            (f64::from(cell + i32::from(step > 0)) - ray.origin[axis]) * ray.inverse[axis]
        };
        loop {
            let (x, z) = (border(cell.x, step.x, 0), border(cell.y, step.y, 2));
            let end = x.min(z).min(span[1]);
            if !self.patch(ray, cell.as_uvec2(), [start, end.max(start)], found) {
                return false;
            }
            if x.min(z) >= span[1] {
                return true;
            }
            if x < z {
                cell.x += step.x
            } else {
                cell.y += step.y
            }
            if cell.cmplt(low).any() || cell.cmpge(high).any() {
                return true;
            }
            start = end.max(start);
        }
    }

    /// Does the work of [`Self::walk`] in one cell.
    #[inline]
    fn patch(
        &self,
        ray: &GridRay,
        cell: UVec2,
        [start, end]: [f64; 2],
        found: &mut impl FnMut(f64) -> bool,
    ) -> bool {
        let [a, b, c, e] = self.grid.patch(cell);
        let p = ray.origin + start * ray.direction;
        let d = ray.direction;
        let (u, v) = (p.x - f64::from(cell.x), p.z - f64::from(cell.y));
        // The height of the ray above the surface is a parabola in the parameter from `start`.
        let f0 = p.y - (a + b * u + (c + e * u) * v);
        let f1 = d.y - (b * d.x + c * d.z + e * (u * d.z + v * d.x));
        let f2 = -e * d.x * d.z;
        let across = d.x.abs().max(d.z.abs());
        let overlap = if across > 0.0 { OVERLAP / across } else { 0.0 };
        let within = -overlap..=end - start + overlap;
        let mut visit = |s: f64| !within.contains(&s) || found(start + s);
        if f2 == 0.0 {
            return f1 == 0.0 || visit(-f0 / f1);
        }
        let discriminant = f1 * f1 - 4.0 * f2 * f0;
        if !(discriminant >= 0.0) {
            return true;
        }
        let q = -0.5 * (f1 + discriminant.sqrt().copysign(f1));
        let (one, other) = if q == 0.0 { (0.0, 0.0) } else { (q / f2, f0 / q) };
        let (first, second) = if one < other { (one, other) } else { (other, one) };
        visit(first) && visit(second)
    }

    /// The nearest hit in `[low, high]`.
    fn find(&self, primitive: u32, ray: &Ray, low: f64, high: f64) -> Option<f64> {
        let ray = self.ray(ray)?;
        let mut nearest = None;
        self.walk(&ray, LEVELS - 1, self.block(primitive), [low.max(0.0), high], &mut |t| {
            // Where patches overlap, a hit may lie slightly before the start.
            let counts = t > 0.0 && t >= low && t <= high;
            if counts {
                nearest = Some(t);
            }
            !counts
        });
        nearest
    }
}

impl Procedural for Terrain {
    fn primitive_count(&self) -> u32 {
        self.grid.cells.div_ceil(BLOCK).pow(2)
    }

    fn bounds(&self, primitive: u32) -> Bounds3 {
        let block = self.block(primitive);
        let [least, greatest] = self.grid.extremes(LEVELS - 1, block);
        let low = block * BLOCK;
        let high = (low + BLOCK).min(UVec2::splat(self.grid.cells));
        let corner = |at: UVec2, height: f64| DVec3::new(f64::from(at.x), height, f64::from(at.y));
        let own = Bounds3 { min: corner(low, least), max: corner(high, greatest) };
        grown(own.transformed(&self.to_object))
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, primitive: u32, ray: &Ray) -> Option<f32> {
        accept(self.find(primitive, ray, 0.0, f64::from(ray.t_max))?, ray.t_max)
    }

    fn intersect_all(&self, primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        let Some(grid_ray) = self.ray(ray) else { return };
        let mut last = f64::NEG_INFINITY;
        let span = [0.0, f64::from(ray.t_max)];
        let across = grid_ray.direction.x.abs().max(grid_ray.direction.z.abs());
        self.walk(&grid_ray, LEVELS - 1, self.block(primitive), span, &mut |t| {
            // Both patches may report the same hit in their overlap.
            if (t - last) * across > 4.0 * OVERLAP || across == 0.0 {
                hits.extend(accept(t, ray.t_max));
            }
            last = t;
            true
        });
    }

    fn refine(&self, primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        /// Relative tolerance of the parameter, for the rounding of an instance's transform.
        const SAME: f64 = 1e-5;
        let rounded = f64::from(t);
        let t = self.find(primitive, ray, rounded * (1.0 - SAME), rounded * (1.0 + SAME)).unwrap_or(rounded);
        let hit = ray.origin.as_dvec3() + t * ray.direction.as_dvec3();
        let hit = self.to_grid.transform_point3(hit);
        let cells = f64::from(self.grid.cells);
        let (x, z) = (hit.x.clamp(0.0, cells), hit.z.clamp(0.0, cells));
        let cell = UVec2::new(x as u32, z as u32).min(UVec2::splat(self.grid.cells - 1));
        let (u, v) = (x - f64::from(cell.x), z - f64::from(cell.y));
        let [a, b, c, e] = self.grid.patch(cell);
        let up = |slope: DVec2| {
            // Normals transform by the inverse transpose.
            unit_f64(self.to_grid.matrix3.transpose() * DVec3::new(-slope.x, 1.0, -slope.y))
                .unwrap_or(DVec3::Y)
        };
        let normal = up(DVec2::new(b + e * v, c + e * u));
        let slope = |x: u32, z: u32| self.grid.corner_slope(cell + UVec2::new(x, z));
        let smooth = slope(0, 0).lerp(slope(1, 0), u).lerp(slope(0, 1).lerp(slope(1, 1), u), v);
        let shading_normal = up(smooth);
        let position = DVec3::new(x, a + b * u + (c + e * u) * v, z);
        let matrix = self.to_object.matrix3;
        let extent = matrix.x_axis.length() * x
            + matrix.y_axis.length() * position.y.abs()
            + matrix.z_axis.length() * z;
        let uv = Vec2::new((x / cells) as f32, (z / cells) as f32);
        SurfacePoint {
            position: self.to_object.transform_point3(position),
            error: error_bound(self.to_object.translation, extent),
            normal,
            shading_normal: if shading_normal.dot(normal) > 0.0 { shading_normal } else { normal },
            uv,
            edge: None,
            part: 0,
        }
    }
}
