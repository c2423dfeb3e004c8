//! `ior`: an index of refraction as a number, the name of a glass, or a function of the wavelength.

use crate::scene_file::reader::{Expected, NUMBER, POSITIVE, Table, Value};
use crate::spectra::{Dispersion, DispersionError, NAMED_GLASSES};

/// Range of indices of refraction. No transparent material is near the upper bound; a higher value is a mistake.
pub(super) const IOR: Expected = Expected {
    what: "an index of refraction from 1 to 100",
    example: "1.5",
    holds: |x| (1.0..=100.0).contains(&x),
};

/// An index of refraction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Index {
    /// At the d line.
    pub ior: f64,
    /// As a function of the wavelength, where it is not constant.
    pub dispersion: Option<Dispersion>,
}

impl Index {
    /// The same index at each wavelength.
    pub(super) fn constant(ior: f64) -> Self {
        Self { ior, dispersion: None }
    }
}

impl From<Dispersion> for Index {
    fn from(dispersion: Dispersion) -> Self {
        Self { ior: dispersion.ior(), dispersion: Some(dispersion) }
    }
}

const EXAMPLE: &str = "write a number, `ior = 1.5`, the name of a glass, `ior = \"N-BK7\"`, or a table, `ior = { d = 1.5168, abbe = 64.17 }`";

/// Reads `ior`.
pub(super) fn read_index(value: Value<'_>) -> Option<Index> {
    if value.is_string() {
        let glasses = NAMED_GLASSES.each_ref().map(|glass| (glass.name, glass));
        return value.choice(&glasses).map(|glass| glass.dispersion().into());
    }
    if !value.is_table() {
        return value.number(&IOR).map(Index::constant);
    }
    let mut table = value.table("`ior`", EXAMPLE)?;
    let d = table.optional("d", |value| value.number(&IOR));
    let abbe = table.optional("abbe", |value| value.number(&POSITIVE));
    let sellmeier = table.optional("sellmeier", read_pairs);
    let cauchy = table.optional("cauchy", read_cauchy);
    let rows = table.optional("table", read_pairs);
    let found = index_of(&table, (d?, abbe?), sellmeier?, cauchy?, rows?);
    table.finish();
    found
}

fn index_of(
    table: &Table<'_>,
    by_abbe: (Option<f64>, Option<f64>),
    sellmeier: Option<Vec<[f64; 2]>>,
    cauchy: Option<[f64; 3]>,
    rows: Option<Vec<[f64; 2]>>,
) -> Option<Index> {
    let dispersion = match (by_abbe, sellmeier, cauchy, rows) {
        ((Some(d), Some(abbe)), None, None, None) => Dispersion::from_abbe(d, abbe),
        ((None, None), Some(terms), None, None) => Dispersion::Sellmeier(terms).checked(),
        ((None, None), None, Some(terms), None) => Dispersion::Cauchy(terms).checked(),
        ((None, None), None, None, Some(rows)) => Dispersion::Table(rows).checked(),
        ((Some(_), None) | (None, Some(_)), None, None, None) => {
            let message = format!("{} has only one of `d` and `abbe`", table.title());
            return table.refuse(message, "write both, as `{ d = 1.5168, abbe = 64.17 }`, or a number alone");
        }
        _ => {
            let message =
                format!("{} has to say in one way how the index depends on the wavelength", table.title());
            return table.refuse(
                message,
                "write `d` with `abbe`, or `sellmeier = [[B, C], ...]` or `cauchy = [A, B]` in micrometres, or `table = [[nm, index], ...]`",
            );
        }
    };
    match dispersion {
        Ok(dispersion) => Some(dispersion.into()),
        Err(error) => {
            let remedy = match error {
                DispersionError::Abbe(_) => "write a number such as `abbe = 60.0`",
                DispersionError::Order(_) => "write rows such as `[380.0, 1.53]`, by ascending wavelength",
                DispersionError::Range(..) => "repeat the last known index, if nothing better is known",
                DispersionError::Row(..) => "write an index such as 1.5",
                DispersionError::Index(..) => "check the coefficients",
            };
            table.refuse(error.to_string(), remedy)
        }
    }
}

/// Reads a list of pairs of numbers.
fn read_pairs(value: Value<'_>) -> Option<Vec<[f64; 2]>> {
    let items = value.list("a list of pairs of numbers", "[[1.04, 0.006], [0.23, 0.02], [1.01, 103.6]]")?;
    let pair = |item: Value<'_>| {
        let numbers: Vec<f64> = item
            .list("a pair of numbers", "[1.04, 0.006]")?
            .map(|n| n.number(&NUMBER))
            .collect::<Option<_>>()?;
        match numbers[..] {
            [a, b] => Some([a, b]),
            _ => item.refuse("a pair of numbers", "write two numbers, such as `[1.04, 0.006]`"),
        }
    };
    if items.len() == 0 {
        return value.refuse("a list of pairs of numbers", "write at least one pair");
    }
    items.map(pair).collect()
}

/// Reads two or three coefficients.
fn read_cauchy(value: Value<'_>) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = value
        .list("a list of 2 or 3 numbers", "[1.5046, 0.00422]")?
        .map(|n| n.number(&NUMBER))
        .collect::<Option<_>>()?;
    match numbers[..] {
        [a, b] => Some([a, b, 0.0]),
        [a, b, c] => Some([a, b, c]),
        _ => value.refuse("a list of 2 or 3 numbers", "write two numbers, such as `[1.5046, 0.00422]`"),
    }
}
