//! Colours as spectra: three smooth reflectances that sum to one.
//!
//! A colour `(r, g, b)` stands for the spectrum `r R + g G + b B` (Mallett & Yuksel, "Spectral Primary Decomposition for Rendering with
//! sRGB Reflectance", EGSR 2019). The three are those of the smallest squared slope for which
//!
//! - each is within `[0, 1]` and they sum to one at each wavelength, so that grey is grey, and no reflectance below one exceeds one;
//! - under D65 each has its own colour: red `(1, 0, 0)`, and so on. Any colour then comes back as it was.

use super::cie;
use glam::DVec3;

/// Wavelength of the first row, nm.
const FIRST: f64 = 380.0;

/// Red and blue in steps of 5 nm; green is the rest. Solved as a quadratic program with the product of observer and daylight of
/// [`cie::ROWS`], both linear between their rows.
#[rustfmt::skip]
const ROWS: [[f64; 2]; 81] = [
    [0.0282826, 0.9717174],
    [0.0282808, 0.9717192],
    [0.0282736, 0.9717264],
    [0.0282557, 0.9717443],
    [0.0282143, 0.9717857],
    [0.0281241, 0.9718759],
    [0.0279477, 0.9720523],
    [0.027614, 0.972386],
    [0.0270135, 0.9729865],
    [0.0260101, 0.9739899],
    [0.0245295, 0.9754705],
    [0.0226666, 0.9773334],
    [0.0207509, 0.9792491],
    [0.0194388, 0.9805612],
    [0.0197396, 0.9802604],
    [0.0230409, 0.9769591],
    [0.0282423, 0.9662311],
    [0.0226857, 0.9316365],
    [0.0117375, 0.8746422],
    [0.0018713, 0.797647],
    [0.0, 0.7029629],
    [0.0, 0.5992111],
    [0.0, 0.4924329],
    [0.0, 0.3869681],
    [0.0, 0.2867501],
    [0.0, 0.1956573],
    [0.0, 0.117677],
    [0.0, 0.0567815],
    [0.0, 0.016587],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0],
    [0.0, 0.0014634],
    [0.0, 0.0211115],
    [0.0303003, 0.0405262],
    [0.1045534, 0.049405],
    [0.2112352, 0.0499787],
    [0.3385018, 0.0445625],
    [0.47456, 0.0355281],
    [0.6088509, 0.0250225],
    [0.7322439, 0.0148751],
    [0.8372563, 0.0066061],
    [0.9183507, 0.0013897],
    [0.9721746, 0.0],
    [0.9989293, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
    [1.0, 0.0],
];

/// Red, green and blue at a wavelength in nm.
pub(super) fn primaries(wavelength: f64) -> DVec3 {
    let place = ((wavelength - FIRST) / cie::STEP).clamp(0.0, (ROWS.len() - 1) as f64);
    let row = (place as usize).min(ROWS.len() - 2);
    let share = place - row as f64;
    let [red, blue] = [0, 1].map(|i| ROWS[row][i] * (1.0 - share) + ROWS[row + 1][i] * share);
    DVec3::new(red, 1.0 - red - blue, blue)
}
