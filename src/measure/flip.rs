//! LDR-FLIP: the difference that a viewer perceives between two pictures shown in alternation
//! (Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom & Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", HPG 2020).
//!
//! This implementation follows the paper and the authors' `flip_loss.py`. The crate `nv-flip` needs a C++ build and accepts only 8-bit
//! pictures, which would lose the last digits of a figure that is compared between runs.

use super::{MeasureError, Picture};
use crate::math::Rgb;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels per degree of the paper's viewer: a 0.7 m wide screen of 3840 pixels at 0.7 m.
const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Exponents and constants of the paper's section 4.
const Q_C: f64 = 0.7;
const Q_F: f64 = 0.5;
const P_C: f64 = 0.4;
const P_T: f64 = 0.95;
/// Width of the detector of edges and points, in degrees.
const FEATURE_WIDTH: f64 = 0.082;

/// Linear Rec. 709 to XYZ relative to the white of D65, so that white is (1, 1, 1).
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
/// Inverse of [`TO_XYZ`].
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.241_003_275, -1.537_398_934, -0.498_615_861],
    [-0.969_224_334, 1.875_930_071, 0.041_554_224],
    [0.055_639_423, -0.204_011_202, 1.057_148_933],
];
/// White point D65 in XYZ.
const WHITE: DVec3 = DVec3::new(0.950_428_545, 1.0, 1.088_900_371);

/// Mean of [`flip_map`].
pub fn mean_flip(reference: Picture<'_>, test: Picture<'_>) -> Result<f64, MeasureError> {
    let map = flip_map(reference, test)?;
    Ok(map.iter().map(|&e| f64::from(e)).sum::<f64>() / map.len() as f64)
}

/// The difference of each pixel, in `[0, 1]`, row by row. Both pictures are linear. They are clamped to `[0, 1]` first, as on a screen
/// without tone mapping (NaN as black), so that sRGB encoding and decoding cancel.
pub fn flip_map(reference: Picture<'_>, test: Picture<'_>) -> Result<Vec<f32>, MeasureError> {
    if reference.size() != test.size() {
        return Err(MeasureError::Size { test: test.size(), reference: reference.size() });
    }
    let (a, b) = (Opponent::new(reference), Opponent::new(test));
    let (colour_a, colour_b) = (a.seen_colours(), b.seen_colours());
    let (features_a, features_b) = (a.features(), b.features());
    let largest = largest_difference();
    let pixel = |i: usize| {
        let colour = redistributed(hyab(colour_a[i], colour_b[i]).powf(Q_C), largest);
        let (fa, fb) = (features_a[i], features_b[i]);
        let feature = f64::from((fa[0] - fb[0]).abs().max((fa[1] - fb[1]).abs()));
        colour.powf(1.0 - (feature * std::f64::consts::FRAC_1_SQRT_2).powf(Q_F)) as f32
    };
    Ok((0..colour_a.len()).into_par_iter().map(pixel).collect())
}

/// A picture in the linear opponent space Y, Cx, Cz, one plane each.
struct Opponent {
    width: usize,
    planes: [Vec<f32>; 3],
}

impl Opponent {
    fn new(picture: Picture<'_>) -> Self {
        let colours: Vec<Rgb> = picture
            .values()
            .par_chunks_exact(3)
            .map(|p| {
                // `max` drops NaN, which `clamp` lets through.
                let clamped = [p[0], p[1], p[2]].map(|c| f64::from(c.clamp(0.0, 1.0).max(0.0)));
                let v = multiply(&TO_XYZ, DVec3::from_array(clamped)) / WHITE;
                DVec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z)).as_vec3()
            })
            .collect();
        let plane = |channel: usize| colours.iter().map(|c| c[channel]).collect();
        Self { width: picture.size().0 as usize, planes: [plane(0), plane(1), plane(2)] }
    }

    /// Perceived colours: filtered by the contrast sensitivity of the eye, in Hunt-adjusted L*a*b*.
    fn seen_colours(&self) -> Vec<Rgb> {
        let filters = [vec![(1.0, 0.0047)], vec![(1.0, 0.0053)], vec![(34.1, 0.04), (13.5, 0.025)]];
        let [y, cx, cz] = [0, 1, 2].map(|i| contrast_sensitivity(&self.planes[i], self.width, &filters[i]));
        let colour = |i: usize| {
            let y = (f64::from(y[i]) + 16.0) / 116.0;
            let v = DVec3::new(y + f64::from(cx[i]) / 500.0, y, y - f64::from(cz[i]) / 200.0);
            let linear = multiply(&FROM_XYZ, v * WHITE).clamp(DVec3::ZERO, DVec3::ONE);
            hunt_lab(linear).as_vec3()
        };
        (0..y.len()).into_par_iter().map(colour).collect()
    }

    /// Strength of edges and of points at each pixel.
    fn features(&self) -> Vec<[f32; 2]> {
        let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * sigma).ceil() as i32;
        let taps = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            (-radius..=radius).map(f64::from).map(|x| f(x, (-x * x / (2.0 * sigma * sigma)).exp())).collect()
        };
        let smooth = signed_normalised(taps(&|_, g| g));
        let luminance: Vec<f32> = self.planes[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |derivative: &[f64]| -> Vec<f32> {
            let x = convolved(&luminance, self.width, derivative, &smooth);
            let y = convolved(&luminance, self.width, &smooth, derivative);
            x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
        };
        let edges = strength(&signed_normalised(taps(&|x, g| -x * g)));
        let points = strength(&signed_normalised(taps(&|x, g| (x * x / (sigma * sigma) - 1.0) * g)));
        edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
    }
}

/// `plane` filtered by a sum of Gaussians `a sqrt(pi / b) exp(-pi^2 d^2 / b)` of the distance d in degrees. Each
/// is given as (a, b); the taps together have sum 1.
fn contrast_sensitivity(plane: &[f32], width: usize, gaussians: &[(f64, f64)]) -> Vec<f32> {
    // The widest Gaussian of all channels sets the radius of each, as in the authors' code.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let parts: Vec<(f64, Vec<f64>)> = gaussians
        .iter()
        .map(|&(a, b)| {
            let taps = |x: i32| (-(PI * f64::from(x) / PIXELS_PER_DEGREE).powi(2) / b).exp();
            (a * (PI / b).sqrt(), (-radius..=radius).map(taps).collect())
        })
        .collect();
    let total: f64 = parts.iter().map(|(scale, taps)| scale * taps.iter().sum::<f64>().powi(2)).sum();
    let mut sum = vec![0f32; plane.len()];
    for (scale, taps) in &parts {
        let scaled: Vec<f64> = taps.iter().map(|tap| tap * scale / total).collect();
        let part = convolved(plane, width, &scaled, taps);
        sum.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
    }
    sum
}

/// Taps with the positive ones scaled to sum 1 and the negative ones to sum -1.
fn signed_normalised(taps: Vec<f64>) -> Vec<f64> {
    let positive: f64 = taps.iter().filter(|tap| **tap > 0.0).sum();
    let negative: f64 = taps.iter().filter(|tap| **tap < 0.0).sum();
    let scaled = |tap: f64| match tap {
        0.0 => 0.0,
        _ if tap > 0.0 => tap / positive,
        _ => -tap / negative,
    };
    taps.into_iter().map(scaled).collect()
}

/// Correlation with `taps_x` along rows and `taps_y` along columns, both of the same odd length. The outermost pixels are repeated beyond
/// the edge.
fn convolved(plane: &[f32], width: usize, taps_x: &[f64], taps_y: &[f64]) -> Vec<f32> {
    let (radius, height) = (taps_x.len() / 2, plane.len() / width);
    let near = |i: usize, tap: usize, end: usize| (i + tap).saturating_sub(radius).min(end - 1);
    let mut rows = vec![0f32; plane.len()];
    rows.par_chunks_exact_mut(width).zip(plane.par_chunks_exact(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            let taps = taps_x.iter().enumerate();
            *out = taps.map(|(k, tap)| tap * f64::from(row[near(x, k, width)])).sum::<f64>() as f32;
        }
    });
    let mut columns = vec![0f32; plane.len()];
    columns.par_chunks_exact_mut(width).enumerate().for_each(|(y, out)| {
        let mut sums = vec![0f64; width];
        for (k, tap) in taps_y.iter().enumerate() {
            let row = &rows[near(y, k, height) * width..][..width];
            sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += tap * f64::from(*value));
        }
        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum as f32);
    });
    columns
}

fn multiply(matrix: &[[f64; 3]; 3], v: DVec3) -> DVec3 {
    DVec3::from_array(matrix.map(|row| DVec3::from_array(row).dot(v)))
}

/// CIE L*a*b* of a linear colour, with a and b scaled by the lightness (Hunt effect).
fn hunt_lab(linear: DVec3) -> DVec3 {
    let f = |t: f64| {
        let delta = 6.0 / 29.0;
        if t > delta * delta * delta { t.cbrt() } else { t / (3.0 * delta * delta) + 4.0 / 29.0 }
    };
    let [x, y, z] = (multiply(&TO_XYZ, linear) / WHITE).to_array().map(f);
    let lightness = 116.0 * y - 16.0;
    DVec3::new(lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z))
}

/// The HyAB distance of Abasi, Amani Tehran & Fairchild for large colour differences (2020).
fn hyab(a: Rgb, b: Rgb) -> f64 {
    let d = (a - b).as_dvec3();
    d.x.abs() + d.y.hypot(d.z)
}

/// The distance between blue and green, the largest on a screen, to the power of [`Q_C`].
fn largest_difference() -> f64 {
    hyab(hunt_lab(DVec3::Y).as_vec3(), hunt_lab(DVec3::Z).as_vec3()).powf(Q_C)
}

/// Maps `[0, P_C * largest]` to `[0, P_T]`, and larger differences to the rest of `[0, 1]`.
fn redistributed(difference: f64, largest: f64) -> f64 {
    let knee = P_C * largest;
    if difference < knee {
        difference * P_T / knee
    } else {
        P_T + (difference - knee) / (largest - knee) * (1.0 - P_T)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flip(a: &[f32], b: &[f32], width: u32) -> Vec<f32> {
        let height = a.len() as u32 / 3 / width;
        flip_map(Picture::new(width, height, a).unwrap(), Picture::new(width, height, b).unwrap()).unwrap()
    }

    fn constant(colour: [f32; 3], pixels: usize) -> Vec<f32> {
        colour.repeat(pixels)
    }

    #[test]
    fn identical_pictures_do_not_differ() {
        let picture: Vec<f32> = (0..900).map(|i| (i as f32 * 0.7).sin().abs()).collect();
        assert!(flip(&picture, &picture, 20).iter().all(|&e| e == 0.0));
    }

    #[test]
    fn constant_pictures_differ_by_their_colour_alone() {
        let (green, blue) = (constant([0.0, 1.0, 0.0], 300), constant([0.0, 0.0, 1.0], 300));
        assert!(flip(&green, &blue, 20).iter().all(|&e| (e - 1.0).abs() < 1e-5));
        // Black and white are 100 apart in lightness and equal in colour.
        let (black, white) = (constant([0.0; 3], 300), constant([1.0; 3], 300));
        let largest = largest_difference();
        let want = redistributed(100f64.powf(Q_C), largest) as f32;
        assert!(want > 0.95 && want < 1.0);
        assert!(flip(&black, &white, 20).iter().all(|&e| (e - want).abs() < 1e-4));
    }

    #[test]
    fn symmetric_bounded_and_blind_beyond_the_screen() {
        let a: Vec<f32> = (0..1200).map(|i| (i as f32 * 1.7).sin() * 3.0).collect();
        let b: Vec<f32> = (0..1200).map(|i| (i as f32 * 0.3).cos() * 3.0).collect();
        let (ab, ba) = (flip(&a, &b, 25), flip(&b, &a, 25));
        assert_eq!(ab, ba);
        assert!(ab.iter().all(|e| (0.0..=1.0).contains(e)));
        let clamped: Vec<f32> = a.iter().map(|v| v.clamp(0.0, 1.0)).collect();
        assert!(flip(&a, &clamped, 25).iter().all(|&e| e == 0.0));
        let hostile = [f32::NAN, f32::INFINITY, -f32::INFINITY];
        assert!(flip(&hostile, &[0.0, 1.0, 0.0], 1).iter().all(|&e| e == 0.0));
    }

    #[test]
    fn a_thin_line_is_seen_through_its_features() {
        let dark = constant([0.2; 3], 41 * 41);
        let mut line = dark.clone();
        (0..41).for_each(|y| line[(y * 41 + 20) * 3..][..3].fill(0.6));
        let map = flip(&dark, &line, 41);
        assert!(map[20 * 41 + 20] > 0.3 && map[20 * 41 + 2] < 1e-3, "{} {}", map[860], map[822]);
    }
}
