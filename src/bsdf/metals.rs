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
///
/// The others were computed alike, from Johnson & Christy 1974 (cobalt, chromium, iron, nickel, palladium, titanium, vanadium), Rakic et
/// al. 1998 (beryllium), Inagaki et al. (mercury 1981, sodium 1976), Smith 1969 (potassium), Mathewson & Myers 1971 (lithium), Querry 1987
/// (molybdenum), Weaver et al. (niobium 1973, rhodium 1977, tungsten 1975) and Ciesielski et al. 2018 (tellurium). Each channel is within
/// 0.003 of the reflectances that it was fitted to.
pub const METALS: &[(&str, Metal)] = &[
    (
        "aluminium",
        Metal::Index { eta: Rgb::new(1.4970, 0.9845, 0.6046), k: Rgb::new(7.6386, 6.5464, 5.3436) },
    ),
    ("copper", Metal::Index { eta: Rgb::new(0.2207, 1.0440, 1.2952), k: Rgb::new(3.3535, 2.6244, 2.3614) }),
    ("gold", Metal::Index { eta: Rgb::new(0.0873, 0.4991, 1.4698), k: Rgb::new(4.1857, 2.2606, 1.7744) }),
    ("silver", Metal::Index { eta: Rgb::new(0.0565, 0.0550, 0.0432), k: Rgb::new(4.4827, 3.5465, 2.5893) }),
    (
        "beryllium",
        Metal::Index { eta: Rgb::new(3.4218, 3.3040, 3.0559), k: Rgb::new(3.1836, 3.1307, 3.1250) },
    ),
    ("chromium", Metal::Index { eta: Rgb::new(3.2473, 3.1138, 2.2855), k: Rgb::new(3.2867, 3.3359, 3.1166) }),
    ("cobalt", Metal::Index { eta: Rgb::new(2.2570, 2.0350, 1.7131), k: Rgb::new(4.2271, 3.7942, 3.2376) }),
    ("iron", Metal::Index { eta: Rgb::new(2.9230, 2.9191, 2.5460), k: Rgb::new(3.0773, 2.9372, 2.7499) }),
    ("lithium", Metal::Index { eta: Rgb::new(0.1496, 0.1462, 0.2116), k: Rgb::new(3.1519, 2.5933, 1.9971) }),
    ("mercury", Metal::Index { eta: Rgb::new(2.0478, 1.5191, 1.0246), k: Rgb::new(5.3078, 4.6052, 3.7941) }),
    (
        "molybdenum",
        Metal::Index { eta: Rgb::new(4.9505, 5.0712, 4.5678), k: Rgb::new(3.6570, 3.8069, 3.8354) },
    ),
    ("nickel", Metal::Index { eta: Rgb::new(2.0327, 1.9030, 1.7284), k: Rgb::new(4.1993, 3.5698, 2.8954) }),
    ("niobium", Metal::Index { eta: Rgb::new(2.9096, 2.9108, 2.6210), k: Rgb::new(2.8302, 2.8865, 2.8103) }),
    (
        "palladium",
        Metal::Index { eta: Rgb::new(1.7956, 1.6216, 1.3956), k: Rgb::new(4.3637, 3.8114, 3.2121) },
    ),
    (
        "potassium",
        Metal::Index { eta: Rgb::new(0.0544, 0.0492, 0.0420), k: Rgb::new(1.7825, 1.4318, 1.0240) },
    ),
    ("rhodium", Metal::Index { eta: Rgb::new(2.1721, 1.9612, 1.7251), k: Rgb::new(5.7200, 4.9549, 4.4008) }),
    ("sodium", Metal::Index { eta: Rgb::new(0.0411, 0.0535, 0.0784), k: Rgb::new(2.8400, 2.2735, 1.7249) }),
    (
        "tellurium",
        Metal::Index { eta: Rgb::new(4.4447, 3.3937, 2.4141), k: Rgb::new(2.3654, 2.8729, 2.7092) },
    ),
    ("titanium", Metal::Index { eta: Rgb::new(2.7472, 2.5077, 2.2397), k: Rgb::new(3.8425, 3.3974, 3.0144) }),
    ("tungsten", Metal::Index { eta: Rgb::new(3.6361, 3.4940, 3.3136), k: Rgb::new(2.9239, 2.7476, 2.5057) }),
    ("vanadium", Metal::Index { eta: Rgb::new(3.4802, 3.9614, 3.6144), k: Rgb::new(2.9834, 3.0758, 3.4750) }),
];
