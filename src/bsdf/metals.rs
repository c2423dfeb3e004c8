//! Table of metals by name.

use super::Metal;
use crate::math::Rgb;

/// Metals by name.
///
/// The data comes from measured indices of refraction (refractiveindex.info, public domain): aluminium of Rakic 1995; copper, gold and
/// silver of Johnson & Christy 1972. The reflectance at each wavelength (5 nm steps, indices interpolated linearly) at angles of 0 to 87
/// degrees in steps of 3 was weighted with the CIE 1931 observer and D65 and converted to linear Rec. 709, with white as (1, 1, 1). Then
/// `eta` and `k` of each channel were fitted to these thirty reflectances by least squares. The fit is within 0.004 of them everywhere
/// except for the red of gold, which lies outside Rec. 709 (1.04 at normal incidence) and was clamped to 0.98 before the fit: there it
/// is within 0.011.
pub const METALS: &[(&str, Metal)] = &[
    (
        "aluminium",
        Metal::Index { eta: Rgb::new(1.4970, 0.9845, 0.6046), k: Rgb::new(7.6386, 6.5464, 5.3436) },
    ),
    ("copper", Metal::Index { eta: Rgb::new(0.2207, 1.0440, 1.2952), k: Rgb::new(3.3535, 2.6244, 2.3614) }),
    ("gold", Metal::Index { eta: Rgb::new(0.0873, 0.4991, 1.4698), k: Rgb::new(4.1857, 2.2606, 1.7744) }),
    ("silver", Metal::Index { eta: Rgb::new(0.0565, 0.0550, 0.0432), k: Rgb::new(4.4827, 3.5465, 2.5893) }),
];
