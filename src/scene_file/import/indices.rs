//! Indices of refraction by the name of the material.

use crate::bsdf::{METALS, Metal};
use crate::math::Rgb;

/// Media by name, at 589 nm (E. Hecht, "Optics").
pub(crate) const MEDIA: &[(&str, f64)] = &[
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", 1.000_277),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// The index of a medium; the case of its name does not matter.
pub(crate) fn medium(name: &str) -> Option<f64> {
    MEDIA.iter().find(|(known, _)| known.eq_ignore_ascii_case(name.trim())).map(|(_, index)| *index)
}

/// Chemical symbols of the metals that cardioid's scene files support, and their names there.
const NAMED: [(&str, &str); 4] = [("Al", "aluminium"), ("Ag", "silver"), ("Au", "gold"), ("Cu", "copper")];

/// `eta` and `k` of other metals, computed like [`METALS`] from measurements of refractiveindex.info (public domain): Johnson &
/// Christy 1974 (Co, Cr, Fe, Ni, Pd, Ti, V), Rakic et al. 1998 (Be), Inagaki et al. (Hg 1981, Na 1976), Smith 1969 (K), Mathewson
/// & Myers 1971 (Li), Querry 1987 (Mo), Weaver et al. (Nb 1973, Rh 1977, W 1975), Ciesielski et al. 2018 (Te). Each channel is
/// within 0.003 of the reflectances that it was fitted to.
#[rustfmt::skip]
const MEASURED: [(&str, [f32; 3], [f32; 3]); 17] = [
    ("Be", [3.4218, 3.3040, 3.0559], [3.1836, 3.1307, 3.1250]),
    ("Co", [2.2570, 2.0350, 1.7131], [4.2271, 3.7942, 3.2376]),
    ("Cr", [3.2473, 3.1138, 2.2855], [3.2867, 3.3359, 3.1166]),
    ("Fe", [2.9230, 2.9191, 2.5460], [3.0773, 2.9372, 2.7499]),
    ("Hg", [2.0478, 1.5191, 1.0246], [5.3078, 4.6052, 3.7941]),
    ("K", [0.0544, 0.0492, 0.0420], [1.7825, 1.4318, 1.0240]),
    ("Li", [0.1496, 0.1462, 0.2116], [3.1519, 2.5933, 1.9971]),
    ("Mo", [4.9505, 5.0712, 4.5678], [3.6570, 3.8069, 3.8354]),
    ("Na", [0.0411, 0.0535, 0.0784], [2.8400, 2.2735, 1.7249]),
    ("Nb", [2.9096, 2.9108, 2.6210], [2.8302, 2.8865, 2.8103]),
    ("Ni", [2.0327, 1.9030, 1.7284], [4.1993, 3.5698, 2.8954]),
    ("Pd", [1.7956, 1.6216, 1.3956], [4.3637, 3.8114, 3.2121]),
    ("Rh", [2.1721, 1.9612, 1.7251], [5.7200, 4.9549, 4.4008]),
    ("Te", [4.4447, 3.3937, 2.4141], [2.3654, 2.8729, 2.7092]),
    ("Ti", [2.7472, 2.5077, 2.2397], [3.8425, 3.3974, 3.0144]),
    ("V", [3.4802, 3.9614, 3.6144], [2.9834, 3.0758, 3.4750]),
    ("W", [3.6361, 3.4940, 3.3136], [2.9239, 2.7476, 2.5057]),
];

/// The supported symbols.
pub(crate) fn symbols() -> impl Iterator<Item = &'static str> {
    NAMED.iter().map(|(symbol, _)| *symbol).chain(MEASURED.iter().map(|(symbol, ..)| *symbol))
}

/// The metal of a symbol; the tables of different sources (`Cu_palik`) are treated as one.
pub(crate) fn metal(symbol: &str) -> Option<Metal> {
    let symbol = symbol.trim().trim_end_matches("_palik");
    if let Some((_, eta, k)) = MEASURED.iter().find(|(known, ..)| known.eq_ignore_ascii_case(symbol)) {
        return Some(Metal::Index { eta: Rgb::from_array(*eta), k: Rgb::from_array(*k) });
    }
    let (_, name) = NAMED.iter().find(|(known, _)| known.eq_ignore_ascii_case(symbol))?;
    METALS.iter().find(|(known, _)| known == name).map(|(_, metal)| *metal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_letters() {
        assert_eq!(medium("BK7"), Some(1.5046));
        assert_eq!(medium("Water"), Some(1.333));
        assert_eq!(medium("unobtainium"), None);
        for symbol in symbols() {
            let reflectance = metal(symbol).unwrap().reflectance(1.0);
            assert!(
                reflectance.min_element() > 0.3 && reflectance.max_element() < 0.99,
                "{symbol} {reflectance}"
            );
        }
        assert!(metal("Cu_palik") == metal("Cu") && metal("none").is_none());
    }
}
