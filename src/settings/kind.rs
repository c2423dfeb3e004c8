//! What values a setting takes, and what was asked for as command lines write it. Scene files read the same kinds by their own
//! reader, which knows lines and columns.

use super::choices::Named;
use super::text::paragraphs;

/// The values that a setting takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// True or false.
    Flag,
    /// A whole number, both limits included.
    Count {
        /// The smallest.
        least: u64,
        /// The largest.
        most: u64,
    },
    /// A number, both limits included.
    Number {
        /// What it is called: "number", "share".
        noun: &'static str,
        /// The smallest.
        least: f64,
        /// The largest.
        most: f64,
        /// A value that makes sense.
        example: &'static str,
    },
    /// A length above zero: in metres on the command line, in its own unit in a scene file.
    Length,
    /// Bytes of memory, written with their unit.
    Memory,
    /// One of several names.
    Choice {
        /// The names.
        names: &'static [Named],
        /// A number that belongs to one of them.
        parameter: Option<Parameter>,
    },
}

/// A number that belongs to one name of a choice and is given beside it, as the filter constant of the cone. By itself it means that
/// name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Option without dashes, and key of scene files.
    pub name: &'static str,
    /// The choice that it belongs to.
    pub of: &'static str,
    /// The smallest value.
    pub least: f64,
    /// The largest value.
    pub most: f64,
    /// The value where none is given.
    pub default: f64,
    /// A value that makes sense.
    pub example: &'static str,
    /// What it is.
    pub help: &'static str,
}

impl Parameter {
    /// The values it takes.
    pub fn kind(&self) -> Kind {
        Kind::Number { noun: "number", least: self.least, most: self.most, example: self.example }
    }
}

/// A value of a setting that was asked for, of the setting's [`Kind`] and within its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// Of [`Kind::Flag`].
    Flag(bool),
    /// Of [`Kind::Count`] or [`Kind::Memory`].
    Count(u64),
    /// Of [`Kind::Number`] or, in metres, of [`Kind::Length`].
    Number(f64),
    /// Of [`Kind::Choice`], with its [`Parameter`] where one was given.
    Choice(&'static str, Option<f64>),
}

impl Kind {
    /// What is expected, after "expected" or "write": "a whole number from 1 to 10".
    pub fn expected(&self) -> String {
        match self {
            Self::Flag => "true or false".to_owned(),
            Self::Count { least, most } => format!("a whole number from {least} to {most}"),
            Self::Number { noun, least, most, .. } => format!("a {noun} from {least} to {most}"),
            Self::Length => "a number of metres above 0".to_owned(),
            Self::Memory => "a number of bytes from 1kB to 1000000GB with its unit (kB, MB or GB)".to_owned(),
            Self::Choice { names, .. } => {
                let names: Vec<_> = names.iter().map(|named| named.name).collect();
                format!("one of {}", names.join(", "))
            }
        }
    }

    /// What stands for the value in the help.
    pub fn placeholder(&self) -> &'static str {
        match self {
            Self::Flag => "BOOL",
            Self::Count { .. } => "N",
            Self::Number { noun: "share", .. } => "SHARE",
            Self::Number { .. } => "X",
            Self::Length => "METRES",
            Self::Memory => "BYTES",
            Self::Choice { .. } => "NAME",
        }
    }

    /// Whether a number is within the limits of [`Kind::Number`] and [`Kind::Length`].
    pub fn holds(&self, x: f64) -> bool {
        match *self {
            Self::Number { least, most, .. } => (least..=most).contains(&x),
            Self::Length => x > 0.0 && x.is_finite(),
            Self::Flag | Self::Count { .. } | Self::Memory | Self::Choice { .. } => false,
        }
    }

    /// The value that `text` of a command line means.
    ///
    /// # Errors
    /// What to write instead.
    pub fn parse(&self, text: &str) -> Result<Asked, String> {
        match *self {
            Self::Flag => match text {
                "true" => Ok(Asked::Flag(true)),
                "false" => Ok(Asked::Flag(false)),
                _ => Err("write true or false".to_owned()),
            },
            Self::Count { least, most } => count_within(text, least, most).map(Asked::Count),
            Self::Number { example, .. } => self.number(text, example),
            Self::Length => self.number(text, "0.05"),
            Self::Memory => memory(text).map(Asked::Count),
            Self::Choice { names, .. } => {
                let found = names.iter().find(|named| named.name == text);
                let found = found.ok_or_else(|| format!("write {}", self.expected()))?;
                Ok(Asked::Choice(found.name, None))
            }
        }
    }

    fn number(&self, text: &str, example: &str) -> Result<Asked, String> {
        match text.parse::<f64>() {
            Ok(x) if self.holds(x) => Ok(Asked::Number(x)),
            _ => Err(format!("write {}, for example {example}", self.expected())),
        }
    }
}

impl Named {
    /// What it means, in a line.
    pub fn help(&self) -> String {
        paragraphs(self.about).into_iter().next().unwrap_or_default()
    }
}

/// A whole number, as people write large ones: `500000`, `500_000`, `500k`, `0.5M` or `5e5`.
///
/// # Errors
/// What to write instead.
pub fn count(text: &str) -> Result<u64, String> {
    count_within(text, 0, u64::MAX)
}

/// [`count`] from `least` to `most`.
///
/// # Errors
/// What to write instead.
pub fn count_within(text: &str, least: u64, most: u64) -> Result<u64, String> {
    /// From here on an `f64` has not every whole number.
    const LIMIT: u64 = 1 << 53;
    let message = || {
        let digits =
            if most < LIMIT { String::new() } else { format!("; above {}, digit by digit", LIMIT - 1) };
        format!("write a whole number from {least} to {most}, for example 500000, 500k, 1.5M or 5e5{digits}")
    };
    let within = |number| if (least..=most).contains(&number) { Ok(number) } else { Err(message()) };
    let plain = text.replace('_', "");
    if let Ok(number) = plain.parse() {
        return within(number);
    }
    // As a power of ten in the text, so that the number is rounded once, from what was written.
    let written = match plain.strip_suffix(['k', 'K']).map(|rest| (rest, 3)).or_else(|| {
        let million = plain.strip_suffix('M').map(|rest| (rest, 6));
        million.or_else(|| plain.strip_suffix('G').map(|rest| (rest, 9)))
    }) {
        Some((rest, power)) => format!("{rest}e{power}"),
        None => plain,
    };
    match written.parse::<f64>() {
        Ok(number) if number.fract() == 0.0 && (0.0..LIMIT as f64).contains(&number) => within(number as u64),
        Ok(number) if (0.0..LIMIT as f64).contains(&number) => {
            Err(format!("{number} is not a whole number; write {:.0}", number.ceil()))
        }
        _ => Err(message()),
    }
}

/// Bytes of memory with their unit: `500MB`, `2GB`.
///
/// # Errors
/// What to write instead.
pub fn memory(text: &str) -> Result<u64, String> {
    let message = || format!("write {}, for example 500MB", Kind::Memory.expected());
    let at = text.find(|c: char| c.is_ascii_alphabetic()).ok_or_else(message)?;
    let (number, unit) = text.split_at(at);
    let factor = match unit.to_ascii_lowercase().as_str() {
        "b" => 1.0,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        _ => return Err(message()),
    };
    let bytes = number.trim().parse::<f64>().map_err(|_| message())? * factor;
    if (1000.0..1e15).contains(&bytes) { Ok(bytes as u64) } else { Err(message()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_as_people_write_them() {
        for (text, number) in [
            ("0", 0),
            ("1e6", 1_000_000),
            ("2.5e5", 250_000),
            ("200_000", 200_000),
            ("500k", 500_000),
            ("2.3k", 2300),
            ("1.1M", 1_100_000),
            ("0.3G", 300_000_000),
            ("18446744073709551615", u64::MAX),
        ] {
            assert_eq!(count(text), Ok(number), "{text}");
        }
        for text in ["", "-1", "-1e3", "1e", "k", "1e400", "nan", "inf", "1e17", "many", "1m", "5 000"] {
            assert!(count(text).is_err_and(|message| message.contains("5e5")), "{text}");
        }
        assert!(count("2.5").is_err_and(|message| message.contains("write 3")));
        assert!(count("0.0005k").is_err());
        let from_one = |text| count_within(text, 1, u64::from(u32::MAX));
        for text in ["0", "5G", "1e18", "99999999999999999999"] {
            let told = from_one(text).unwrap_err();
            assert!(
                told.contains("from 1 to 4294967295") && !told.contains("digit by digit"),
                "{text}: {told}"
            );
        }
        assert!(
            count("1e18").is_err_and(|message| message.contains("above 9007199254740991, digit by digit"))
        );
        assert_eq!(from_one("4e9"), Ok(4_000_000_000));
    }

    #[test]
    fn numbers_have_their_limits() {
        let share = Kind::Number { noun: "share", least: 0.0, most: 1.0, example: "0.2" };
        assert_eq!(share.parse("0.25"), Ok(Asked::Number(0.25)));
        for text in ["-0.1", "1.01", "nan", "inf", "", "a"] {
            assert_eq!(
                share.parse(text),
                Err("write a share from 0 to 1, for example 0.2".to_owned()),
                "{text}"
            );
        }
        assert_eq!(Kind::Length.parse("0.05"), Ok(Asked::Number(0.05)));
        for text in ["0", "-1", "inf", "nan"] {
            assert!(
                Kind::Length.parse(text).is_err_and(|message| message.contains("metres above 0")),
                "{text}"
            );
        }
    }
}
