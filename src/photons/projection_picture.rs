//! Pictures of projection maps, for inspection (figure 2 of Jensen & Christensen 1995).

use super::direction_bins::{Cone, DirectionBins};
use super::projection_map::Place;
use crate::lights::Light;
use crate::math::Frame;
use crate::scene::{Scene, Target};
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_PI_2;

/// A picture of 8-bit RGB, row after row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProjectionPicture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Three bytes for each pixel.
    pub pixels: Vec<u8>,
}

/// Bins of a tile: polar angles from 0 (top) to 180 degrees, azimuths all around.
const TILE: (usize, usize) = (64, 128);
/// Side in pixels of the picture of light from outside.
const DISC: usize = 512;
/// Tiles in a row where they have no two-dimensional order.
const TILES_ACROSS: usize = 8;
/// Width in pixels to which a picture with few tiles is enlarged at most, and the largest side of one bin.
const SHOWN_ACROSS: usize = 768;
const LARGEST_BIN: usize = 4;

const NOTHING: [u8; 3] = [16, 16, 22];
const DIFFUSE: [u8; 3] = [70, 88, 120];
const CASTER: [f32; 3] = [255.0, 170.0, 60.0];
const BORDER: [u8; 3] = [120, 120, 120];

/// The view of light number `index` of `scene`: caustic casters orange, brighter the more photons are aimed at them;
/// other objects blue; empty directions dark.
///
/// An area light has one tile for each cell of positions, with the azimuth across and the angle to its normal down, to
/// the horizon or the nadir; every object is enlarged by the cell. A point light has one tile around the y axis. Light
/// from outside has the disc around the scene, perpendicular to the light (for an environment: to light from above).
pub fn projection_picture(scene: &Scene, index: usize) -> ProjectionPicture {
    let targets: Vec<Target> = scene
        .targets()
        .iter()
        .filter(|target| scene.surfaces()[target.surface as usize].light != Some(index as u32))
        .copied()
        .collect();
    match &scene.lights()[index] {
        Light::Area(area) => match Place::all_of(area, scene.bounds().1) {
            Some((places, rows)) => tiles(&places, rows, &targets),
            None => tiles(&[], 1, &targets),
        },
        Light::Point(point) => tiles(&[Place::at(point.position)], 1, &targets),
        Light::Spot(spot) => tiles(&[Place::of_spot(spot)], 1, &targets),
        Light::Directional(sun) => disc(sun.direction, scene.bounds(), &targets),
        Light::Sun(sun) => disc(-sun.towards(), scene.bounds(), &targets),
        Light::Environment(_) => disc(Vec3::NEG_Y, scene.bounds(), &targets),
    }
}

/// Colour of a place where these targets may be visible.
fn colour<'a>(targets: impl Iterator<Item = &'a Target>, densest: f32) -> [u8; 3] {
    let (mut any, mut density) = (false, 0.0);
    for target in targets {
        any = true;
        density += target.density;
    }
    if density > 0.0 {
        let share = 0.35 + 0.65 * (density / densest).min(1.0);
        CASTER.map(|channel| (channel * share) as u8)
    } else if any {
        DIFFUSE
    } else {
        NOTHING
    }
}

/// Density of casters that has the brightest colour.
fn densest(targets: &[Target]) -> f32 {
    targets.iter().map(|target| target.density).fold(0.0, f32::max)
}

fn tiles(places: &[Place], rows: usize, targets: &[Target]) -> ProjectionPicture {
    let count = places.len().max(1);
    let (across, down) = if rows > 1 {
        (count.div_ceil(rows), rows)
    } else {
        (count.min(TILES_ACROSS), count.div_ceil(TILES_ACROSS))
    };
    let scale = (SHOWN_ACROSS / (across * TILE.1)).clamp(1, LARGEST_BIN);
    let hemisphere = places.iter().all(|place| place.limit <= FRAC_PI_2 + 1e-4);
    let shown = if hemisphere { TILE.0 / 2 } else { TILE.0 };
    let (tile_width, tile_height) = (TILE.1 * scale + 1, shown * scale + 1);
    let (width, height) = (across * tile_width + 1, down * tile_height + 1);
    let mut pixels = BORDER.repeat(width * height);
    let densest = densest(targets);
    for (number, place) in places.iter().enumerate() {
        let (column, line) = if rows > 1 {
            (number / rows, number % rows)
        } else {
            (number % TILES_ACROSS, number / TILES_ACROSS)
        };
        let cones: Vec<Cone> =
            targets.iter().map(|target| Cone::of(place.center, place.radius, target)).collect();
        let bins = DirectionBins::new(place.axis, TILE, place.limit, &cones);
        for y in 0..shown * scale {
            for x in 0..TILE.1 * scale {
                let seen = bins.bin(y / scale, x / scale).iter().map(|&number| &targets[number as usize]);
                let at = (line * tile_height + 1 + y) * width + column * tile_width + 1 + x;
                pixels[3 * at..3 * at + 3].copy_from_slice(&colour(seen, densest));
            }
        }
    }
    ProjectionPicture { width: width as u32, height: height as u32, pixels }
}

fn disc(direction: Vec3, (center, radius): (Vec3, f32), targets: &[Target]) -> ProjectionPicture {
    let frame = Frame::from_z(direction);
    let discs: Vec<Vec2> =
        targets.iter().map(|target| frame.to_local(target.center - center).truncate()).collect();
    let densest = densest(targets);
    let mut pixels = Vec::with_capacity(3 * DISC * DISC);
    for y in 0..DISC {
        for x in 0..DISC {
            let unit =
                (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / DISC as f32 * 2.0 - 1.0) * Vec2::new(1.0, -1.0);
            let seen = targets
                .iter()
                .zip(&discs)
                .filter(|(target, at)| (unit * radius - **at).length() <= target.radius)
                .map(|(target, _)| target);
            let inside = unit.length() <= 1.0;
            pixels.extend(if inside { colour(seen, densest) } else { BORDER });
        }
    }
    ProjectionPicture { width: DISC as u32, height: DISC as u32, pixels }
}
