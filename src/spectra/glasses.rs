//! Glasses, liquids and crystals by name.

use super::Dispersion;

/// A transparent material with its index of refraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamedGlass {
    /// Name, as catalogues write it.
    pub name: &'static str,
    /// Coefficients of [`Dispersion::Sellmeier`].
    sellmeier: &'static [[f64; 2]],
}

impl NamedGlass {
    /// Its index of refraction.
    pub fn dispersion(&self) -> Dispersion {
        Dispersion::Sellmeier(self.sellmeier.to_vec())
    }
}

/// All of them. Glasses: catalogue of Schott of 2017. Fused silica: Malitson 1965, at 20 degrees. Sapphire: Malitson & Dodge 1972,
/// ordinary ray. Quartz: Ghosh 1999, ordinary ray, its constant as a term with `C = 0`. Diamond: Peter 1923. Water: Daimon & Masumura 2007, at 20
/// degrees. Acrylic glass (PMMA): Beadie et al. 2015 by one term of Sellmeier's (Sultanova et al. 2009).
pub const NAMED_GLASSES: [NamedGlass; 11] = [
    NamedGlass {
        name: "N-BK7",
        sellmeier: &[
            [1.039_612_12, 0.006_000_698_67],
            [0.231_792_344, 0.020_017_914_4],
            [1.010_469_45, 103.560_653],
        ],
    },
    NamedGlass {
        name: "N-SF11",
        sellmeier: &[
            [1.737_596_95, 0.013_188_707],
            [0.313_747_346, 0.062_306_814_2],
            [1.898_781_01, 155.236_29],
        ],
    },
    NamedGlass {
        name: "SF10",
        sellmeier: &[
            [1.616_259_77, 0.012_753_455_9],
            [0.259_229_334, 0.058_198_395_4],
            [1.077_623_17, 116.607_68],
        ],
    },
    NamedGlass {
        name: "F2",
        sellmeier: &[
            [1.345_333_59, 0.009_977_438_71],
            [0.209_073_176, 0.047_045_076_7],
            [0.937_357_162, 111.886_764],
        ],
    },
    NamedGlass {
        name: "N-FK51A",
        sellmeier: &[
            [0.971_247_817, 0.004_723_019_95],
            [0.216_901_417, 0.015_357_561_2],
            [0.904_651_666, 168.681_33],
        ],
    },
    NamedGlass {
        name: "fused-silica",
        sellmeier: &[
            [0.696_166_3, 0.068_404_3 * 0.068_404_3],
            [0.407_942_6, 0.116_241_4 * 0.116_241_4],
            [0.897_479_4, 9.896_161 * 9.896_161],
        ],
    },
    NamedGlass {
        name: "sapphire",
        sellmeier: &[
            [1.431_349_3, 0.072_663_1 * 0.072_663_1],
            [0.650_547_13, 0.119_324_2 * 0.119_324_2],
            [5.341_402_1, 18.028_251 * 18.028_251],
        ],
    },
    NamedGlass {
        name: "quartz",
        sellmeier: &[[0.286_041_41, 0.0], [1.070_440_83, 0.010_058_599_7], [1.102_022_42, 100.0]],
    },
    NamedGlass { name: "diamond", sellmeier: &[[0.3306, 0.175 * 0.175], [4.3356, 0.106 * 0.106]] },
    NamedGlass {
        name: "water",
        sellmeier: &[
            [0.568_402_756_5, 0.005_101_829_712],
            [0.172_617_739_1, 0.018_211_539_36],
            [0.020_861_896_58, 0.026_207_222_93],
            [0.113_074_868_8, 10.697_927_21],
        ],
    },
    NamedGlass { name: "acrylic", sellmeier: &[[1.1819, 0.011_313]] },
];

/// The one of this name; upper and lower case are the same.
pub fn named_glass(name: &str) -> Option<&'static NamedGlass> {
    NAMED_GLASSES.iter().find(|glass| glass.name.eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_those_of_the_catalogues() {
        // C, d, F and g lines, and the Abbe number.
        let table = [
            ("N-BK7", [1.514_322, 1.516_800, 1.522_376, 1.526_685], 64.167),
            ("N-SF11", [1.775_955, 1.784_720, 1.806_513, 1.825_325], 25.680),
            ("water", [1.331_513, 1.333_403, 1.337_492, 1.340_586], 55.76),
        ];
        for (name, indices, abbe) in table {
            let glass = named_glass(name).unwrap().dispersion();
            for (nm, index) in [656.2725, 587.5618, 486.1327, 435.8343].into_iter().zip(indices) {
                assert!((glass.at(nm) - index).abs() < 2e-6, "{name} at {nm} nm: {}", glass.at(nm));
            }
            assert!((glass.abbe() - abbe).abs() < 0.01, "{name}: {}", glass.abbe());
        }
        let at_d = [
            ("SF10", 1.728_25),
            ("F2", 1.620_04),
            ("N-FK51A", 1.486_56),
            ("fused-silica", 1.458_46),
            ("sapphire", 1.768_2),
            ("quartz", 1.544_2),
            ("diamond", 2.417_5),
            ("acrylic", 1.490_6),
        ];
        for (name, index) in at_d {
            let found = named_glass(name).unwrap().dispersion().ior();
            assert!((found - index).abs() < 6e-4, "{name}: {found}");
        }
        for glass in NAMED_GLASSES {
            glass.dispersion().checked().unwrap();
        }
        assert!(named_glass("n-bk7").is_some() && named_glass("butter").is_none());
    }
}
