//! Pictures of all directions in the layout of an equal-area octahedron, in the layouts that lights use.

use crate::image_io::{Image, Layer};
use crate::lights::ProfileTable;
use crate::math::{Rgb, equal_area_square};
use crate::sampling::square_to_direction;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Most rows of a map in longitude and latitude.
const MOST_ROWS: usize = 4096;

/// Samples along each side of a texel.
const FINE: usize = 2;

/// Most steps of the polar angle of a profile.
const MOST_STEPS: usize = 512;

/// Linear colours of the pixels of the unnamed layer, or of the only one; `None` where there are none.
pub(super) fn colours_of(image: &Image) -> Option<Vec<Rgb>> {
    colours(image.layer("").or_else(|| image.layers.first())?)
}

/// Linear colours of the pixels; `None` where the channels are not colours.
pub(super) fn colours(layer: &Layer) -> Option<Vec<Rgb>> {
    let count = layer.channels.len();
    let channel = |name: &str| layer.channel_index(name);
    let [r, g, b] = match (channel("R"), channel("G"), channel("B")) {
        (Some(r), Some(g), Some(b)) => [r, g, b],
        _ => match channel("Y") {
            Some(y) => [y; 3],
            None if count == 1 => [0; 3],
            None => return None,
        },
    };
    Some(layer.data.chunks_exact(count).map(|pixel| Rgb::new(pixel[r], pixel[g], pixel[b])).collect())
}

/// The pixel of a square picture of all directions.
fn at(side: usize, direction: DVec3) -> usize {
    let [column, row] = equal_area_square(direction)
        .map(|share| ((share * side as f64) as usize).min(side.saturating_sub(1)));
    row * side + column
}

/// The width and the pixels of a map in longitude and latitude of a square picture of all directions.
pub(super) fn latitude_longitude(side: usize, pixels: &[Rgb]) -> (usize, Vec<Rgb>) {
    let rows = side.clamp(2, MOST_ROWS);
    let width = 2 * rows;
    let mut texels = vec![Rgb::ZERO; width * rows];
    texels.par_chunks_mut(width).enumerate().for_each(|(row, texels)| {
        for (column, texel) in texels.iter_mut().enumerate() {
            let mut sum = Rgb::ZERO;
            for i in 0..FINE * FINE {
                let step = |cell: usize, i: usize, count: usize| {
                    (cell as f64 + (i as f64 + 0.5) / FINE as f64) / count as f64
                };
                let (direction, _) =
                    square_to_direction(step(column, i % FINE, width), step(row, i / FINE, rows));
                sum += pixels.get(at(side, direction.as_dvec3())).copied().unwrap_or_default();
            }
            *texel = sum / (FINE * FINE) as f32;
        }
    });
    (width, texels)
}

/// The means of the channels over all directions.
pub(super) fn mean(pixels: &[Rgb]) -> DVec3 {
    pixels.iter().map(|pixel| pixel.as_dvec3()).sum::<DVec3>() / pixels.len().max(1) as f64
}

/// The intensities in a square picture of all directions, the means of its channels, by the angles to its middle and around it.
pub(super) fn profile_table(side: usize, pixels: &[Rgb], is_mirrored: bool) -> ProfileTable {
    let steps = (2 * side).clamp(16, MOST_STEPS);
    let polar: Vec<f64> = (0..=steps).map(|i| PI * i as f64 / steps as f64).collect();
    let azimuth: Vec<f64> = (0..=2 * steps).map(|i| PI * i as f64 / steps as f64).collect();
    let mut values = Vec::with_capacity(polar.len() * azimuth.len());
    for around in &azimuth {
        let around = if is_mirrored { TAU - around } else { *around };
        for angle in &polar {
            let (sin, cos) = angle.sin_cos();
            let direction = DVec3::new(sin * around.cos(), sin * around.sin(), cos);
            let pixel = pixels.get(at(side, direction)).copied().unwrap_or_default();
            let value = pixel.element_sum() / 3.0;
            values.push(if value.is_finite() { value.max(0.0) } else { 0.0 });
        }
    }
    ProfileTable { polar, azimuth, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lights::EnvironmentMap;
    use crate::math::equal_area_direction;

    /// A picture of a cosine lobe has that lobe in the other layouts, and keeps its mean.
    #[test]
    fn directions_stay_where_they_are() {
        const SIDE: usize = 64;
        let axis = DVec3::new(0.3, -0.5, 0.8).normalize();
        let pixels: Vec<Rgb> = (0..SIDE * SIDE)
            .map(|i| {
                let [s, t] = [i % SIDE, i / SIDE].map(|i| (i as f64 + 0.5) / SIDE as f64);
                let lobe = equal_area_direction(s, t).dot(axis).max(0.0);
                Rgb::new(lobe as f32, 1.0, 0.0)
            })
            .collect();
        let (width, texels) = latitude_longitude(SIDE, &pixels);
        let map = EnvironmentMap::new(width, texels).0.unwrap();
        for direction in [axis, DVec3::Z, DVec3::X, DVec3::NEG_Y, -axis] {
            let radiance = map.radiance(direction.as_vec3());
            let lobe = direction.dot(axis).max(0.0) as f32;
            assert!((radiance.x - lobe).abs() < 0.05 && radiance.y == 1.0, "{direction}: {radiance} {lobe}");
        }
        let whole = map.integral() / (4.0 * PI);
        assert!((whole - mean(&pixels)).abs().max_element() < 2e-3, "{whole}");
        let table = profile_table(SIDE, &pixels, false);
        let mirrored = profile_table(SIDE, &pixels, true);
        let (polar, around) = (axis.z.acos(), axis.y.atan2(axis.x));
        let peak = table.values.iter().copied().fold(0.0, f32::max);
        assert!((table.at(polar, around) - f64::from(peak)).abs() < 0.02);
        assert!((mirrored.at(polar, -around) - f64::from(peak)).abs() < 0.02);
        assert!(mirrored.at(polar, around) < 0.9 * f64::from(peak));
    }
}
