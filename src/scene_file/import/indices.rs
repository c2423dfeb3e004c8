//! Indices of refraction by the name of the material.

use crate::bsdf::{METALS, Metal};

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

/// Chemical symbols of [`METALS`], and their names there.
#[rustfmt::skip]
const SYMBOLS: [(&str, &str); 21] = [
    ("Ag", "silver"), ("Al", "aluminium"), ("Au", "gold"), ("Be", "beryllium"), ("Co", "cobalt"), ("Cr", "chromium"), ("Cu", "copper"),
    ("Fe", "iron"), ("Hg", "mercury"), ("K", "potassium"), ("Li", "lithium"), ("Mo", "molybdenum"), ("Na", "sodium"), ("Nb", "niobium"),
    ("Ni", "nickel"), ("Pd", "palladium"), ("Rh", "rhodium"), ("Te", "tellurium"), ("Ti", "titanium"), ("V", "vanadium"), ("W", "tungsten"),
];

/// The supported symbols.
pub(crate) fn symbols() -> impl Iterator<Item = &'static str> {
    SYMBOLS.iter().map(|(symbol, _)| *symbol)
}

/// The metal of a symbol; the tables of different sources (`Cu_palik`) are treated as one.
pub(crate) fn metal(symbol: &str) -> Option<Metal> {
    let symbol = symbol.trim().trim_end_matches("_palik");
    let (_, name) = SYMBOLS.iter().find(|(known, _)| known.eq_ignore_ascii_case(symbol))?;
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
