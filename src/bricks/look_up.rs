//! Looking up irradiance in a brick map: interpolation between voxels and between levels of detail.

use super::brick::{Brick, SIDE, face_shares};
use super::file::BrickFileError;
use super::map::BrickMap;
use crate::math::Rgb;
use glam::{DVec3, Vec3};

/// Levels above the one asked for in which a look-up that finds nothing goes on. Where the discs around leave a hole, their voxels of one level
/// above close it; farther up, voxels would bring light to places that no photon came near.
const CLIMBS: u32 = 1;

/// Irradiance that a look-up found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Irradiance in W m^-2, cosine included, times the power factor of render space.
    pub irradiance: Rgb,
    /// Side of the coarsest voxels that took part, render space.
    pub voxel: f32,
}

/// Access to the bricks of one map.
pub(super) trait Bricks {
    /// Calls `use_it` with a brick.
    fn with<R>(&mut self, number: u32, use_it: impl FnOnce(&Brick) -> R) -> Result<R, BrickFileError>;
}

/// A voxel that takes part: node, its level, the voxel in its brick, and the weight of its place.
#[derive(Clone, Copy, Default)]
struct Corner {
    node: u32,
    level: u32,
    voxel: usize,
    weight: f32,
}

impl BrickMap {
    /// Mean irradiance around `position` on the side of the unit `normal`, over about the width `width`; `None` where nothing of this side is
    /// near, or outside of the map.
    ///
    /// The filter is a tent of twice the side of a voxel, in three dimensions, of area: what a voxel holds counts by its coverage, so empty
    /// voxels do not darken their neighbours. Voxels of side `width` would lie between two levels, whose values are interpolated by the
    /// logarithm of their sides. Where the octree ends earlier, the voxels that are there are used. Faces count by the square of the cosine to
    /// `normal`; those that look elsewhere do not count at all.
    pub(super) fn look_up(
        &self,
        bricks: &mut impl Bricks,
        (position, normal): (Vec3, Vec3),
        width: f32,
        coverage: &[f32; 256],
    ) -> Result<Option<Found>, BrickFileError> {
        let (origin, size) = self.cube();
        let place = (position.as_dvec3() - origin.as_dvec3()) / f64::from(size);
        // Also where something is not a number.
        if !(place.cmpge(DVec3::ZERO).all() && place.cmplt(DVec3::ONE).all() && normal.is_finite()) {
            return Ok(None);
        }
        let deepest = self.levels() as u32 - 1;
        let exact = (size / SIDE as f32 / width.max(f32::MIN_POSITIVE)).log2().clamp(0.0, deepest as f32);
        let depth = self.depth_at(place, exact.ceil() as u32);
        let (coarse, fine) = ((exact.floor() as u32).min(depth), (exact.ceil() as u32).min(depth));
        let mut found = self.interpolated(bricks, (place, normal), coarse, coverage)?;
        if fine > coarse
            && let Some(finer) = self.interpolated(bricks, (place, normal), fine, coverage)?
        {
            let share = exact - exact.floor();
            found = Some(found.map_or(finer, |found| found.lerp(finer, share)));
        }
        let mut level = coarse;
        while found.is_none() && level > 0 && coarse - level < CLIMBS {
            level -= 1;
            found = self.interpolated(bricks, (place, normal), level, coverage)?;
        }
        let voxel = size / (SIDE as u32 * (1 << level)) as f32;
        Ok(found.map(|irradiance| Found { irradiance, voxel }))
    }

    /// Level of the deepest node around a place, `most` at most.
    fn depth_at(&self, place: DVec3, most: u32) -> u32 {
        let cell = (place * f64::from(1u32 << most)).to_array().map(|x| x as u32);
        self.descend(cell, most).1
    }

    /// The deepest node, and its level, on the way to the cell of a level.
    #[inline]
    fn descend(&self, cell: [u32; 3], level: u32) -> (u32, u32) {
        let mut node = 0;
        for depth in 0..level {
            let shift = level - 1 - depth;
            let child = (cell[0] >> shift & 1) | (cell[1] >> shift & 1) << 1 | (cell[2] >> shift & 1) << 2;
            match self.child(node, child) {
                Some(next) => node = next,
                None => return (node, depth),
            }
        }
        (node, level)
    }

    /// Interpolation between the voxels of one level, or coarser ones where that level has none.
    fn interpolated(
        &self,
        bricks: &mut impl Bricks,
        (place, normal): (DVec3, Vec3),
        level: u32,
        coverage: &[f32; 256],
    ) -> Result<Option<Rgb>, BrickFileError> {
        let corners = self.corners(place, level);
        let shares = face_shares(normal);
        let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
        let mut done = [false; 8];
        for first in 0..8 {
            if done[first] {
                continue;
            }
            let node = corners[first].node;
            bricks.with(node, |brick| {
                for (corner, done) in corners.iter().zip(&mut done).skip(first) {
                    if *done || corner.node != node {
                        continue;
                    }
                    *done = true;
                    if !(corner.weight > 0.0 && brick.has(corner.voxel)) {
                        continue;
                    }
                    // Area over volume: that of a coarser voxel is spread over more room.
                    let density = corner.weight * (1u32 << corner.level) as f32;
                    for (face, share) in shares {
                        if share > 0.0
                            && let Some((irradiance, code)) = brick.face(corner.voxel, face)
                        {
                            let weight = density * share * coverage[usize::from(code)];
                            sum += weight * irradiance;
                            weights += weight;
                        }
                    }
                }
            })?;
        }
        Ok((weights > 0.0).then(|| sum / weights))
    }

    /// The eight voxels around a place with their weights.
    fn corners(&self, place: DVec3, level: u32) -> [Corner; 8] {
        let across = SIDE as u32 * (1 << level);
        let at = place * f64::from(across) - 0.5;
        let low = at.floor();
        let share = (at - low).as_vec3();
        let cell =
            |axis: usize, up: usize| (low[axis] as i64 + up as i64).clamp(0, i64::from(across) - 1) as u32;
        let mut corners = [Corner::default(); 8];
        let mut known: Option<([u32; 3], (u32, u32))> = None;
        for (i, corner) in corners.iter_mut().enumerate() {
            let up = [i & 1, i >> 1 & 1, i >> 2 & 1];
            let voxel: [u32; 3] = std::array::from_fn(|axis| cell(axis, up[axis]));
            let brick = voxel.map(|x| x / SIDE as u32);
            let (node, depth) = match known {
                Some((same, node)) if same == brick => node,
                _ => self.descend(brick, level),
            };
            known = Some((brick, (node, depth)));
            let [x, y, z] = voxel.map(|x| (x >> (level - depth)) as usize % SIDE);
            let weight =
                (0..3).map(|axis| if up[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
            *corner = Corner { node, level: depth, voxel: x + SIDE * y + SIDE * SIDE * z, weight };
        }
        corners
    }
}
