//! Photometric files of luminaires: IES LM-63 of 1986, 1991, 1995 and 2002.
//!
//! The reader takes intensities of type C (polar angles from the nadir, azimuths around the vertical) and the multipliers for the
//! lamp, for the ballast and for both together. It ignores keywords, sizes and watts.

use crate::files::{foreign_by_content, read_regular, text_of};
use crate::lights::ProfileTable;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Longest file that is read; files of manufacturers have some ten kilobytes.
const MOST_BYTES: u64 = 8 << 20;

/// Most angles of one kind.
const MOST_ANGLES: usize = 10_000;

/// Most values in a file.
const MOST_VALUES: usize = 1 << 20;

/// Why a photometric file cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {problem}", .path.display(), line_suffix(*.line))]
pub struct IesError {
    /// The file.
    pub path: PathBuf,
    /// Line, from 1; 0 for the file as a whole.
    pub line: usize,
    /// The problem, and what to do.
    pub problem: String,
}

fn line_suffix(line: usize) -> String {
    if line == 0 { String::new() } else { format!(":{line}") }
}

/// A photometric file.
#[derive(Clone, Debug, PartialEq)]
pub struct IesFile {
    /// Intensity in candela.
    pub table: ProfileTable,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Reads a photometric file.
///
/// # Errors
/// With the file, the line, the problem, and what to do.
pub fn read_ies(path: &Path) -> Result<IesFile, IesError> {
    let fail = |line, problem: String| IesError { path: path.to_path_buf(), line, problem };
    let unreadable = |error| fail(0, format!("cannot be read: {error}; check its name and permissions"));
    parse_ies_bytes(&read_regular(path, MOST_BYTES).map_err(unreadable)?, path)
}

/// [`read_ies`] for bytes in memory; messages call the file `path`.
///
/// # Errors
/// As [`read_ies`].
pub fn parse_ies_bytes(bytes: &[u8], path: &Path) -> Result<IesFile, IesError> {
    parse_ies(bytes).map_err(|(line, problem)| IesError { path: path.to_path_buf(), line, problem })
}

type Failure = (usize, String);

/// The numbers after TILT, with their lines.
struct Numbers<'a> {
    words: std::vec::IntoIter<(usize, &'a str)>,
    last_line: usize,
}

impl Numbers<'_> {
    fn next(&mut self, what: &str) -> Result<f64, Failure> {
        let Some((line, word)) = self.words.next() else {
            return Err((
                self.last_line,
                format!("the file ends before {what}; it is cut off, fetch it again"),
            ));
        };
        // Some manufacturers write exponents with a D.
        let number = word.replace(['d', 'D'], "e").parse::<f64>().ok().filter(|number| number.is_finite());
        self.last_line = line;
        number.ok_or_else(|| {
            let shown: String = word.chars().take(40).collect();
            (line, format!("`{shown}` is not a number, for {what}; mend the line or fetch the file again"))
        })
    }

    fn count(&mut self, what: &str, most: usize) -> Result<usize, Failure> {
        let number = self.next(what)?;
        if number.fract() == 0.0 && number >= 1.0 && number <= most as f64 {
            return Ok(number as usize);
        }
        Err((
            self.last_line,
            format!("{number} as {what}: expected a whole number from 1 to {most}; mend the line"),
        ))
    }

    /// Increasing angles, converted from degrees to radians.
    fn angles(&mut self, count: usize, what: &str) -> Result<Vec<f64>, Failure> {
        let mut angles: Vec<f64> = Vec::with_capacity(count);
        for _ in 0..count {
            let degrees = self.next(what)?;
            if !(0.0..=360.0).contains(&degrees) {
                return Err((
                    self.last_line,
                    format!("{degrees} among the {what}: expected degrees from 0 to 360"),
                ));
            }
            if angles.last().is_some_and(|&last| degrees.to_radians() <= last) {
                return Err((
                    self.last_line,
                    format!("{degrees} among the {what} is not above the one before it; mend the line"),
                ));
            }
            angles.push(degrees.to_radians());
        }
        Ok(angles)
    }
}

fn parse_ies(bytes: &[u8]) -> Result<IesFile, Failure> {
    if let Some(foreign) = foreign_by_content(Path::new(""), bytes) {
        return Err((0, foreign.to_string()));
    }
    // Manufacturers' names may be in any encoding; the numbers are ASCII.
    let bytes = text_of(bytes).map_err(|what| (0, what.to_owned()))?;
    let text: String =
        bytes.iter().map(|&byte| if byte.is_ascii() { char::from(byte) } else { '?' }).collect();
    let mut warnings = Vec::new();
    let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    let tilt = loop {
        let Some((number, line)) = lines.next() else {
            return Err((0, "has no line `TILT=`: not a photometric file of LM-63, or cut off".to_owned()));
        };
        let upper = line.to_ascii_uppercase();
        if let Some(tilt) = upper.strip_prefix("TILT") {
            break (number, tilt.trim_start().trim_start_matches('=').trim().to_owned());
        }
    };
    let words: Vec<(usize, &str)> = lines
        .flat_map(|(number, line)| {
            line.split(|c: char| c.is_whitespace() || c == ',')
                .filter(|word| !word.is_empty())
                .map(move |word| (number, word))
        })
        .collect();
    let mut numbers = Numbers { words: words.into_iter(), last_line: tilt.0 };
    match tilt.1.as_str() {
        "NONE" => {}
        "INCLUDE" => {
            numbers.next("the geometry of lamp and luminaire")?;
            let count = numbers.count("number of tilt angles", MOST_ANGLES)?;
            for _ in 0..2 * count {
                numbers.next("the table of tilt angles and multipliers")?;
            }
            warnings.push(
                "factors for a tilted lamp are not applied: the light is as measured upright".to_owned(),
            );
        }
        other => {
            let shown: String = other.chars().take(40).collect();
            warnings.push(format!(
                "factors for a tilted lamp in `{shown}` are not applied: the light is as measured upright"
            ));
        }
    }
    let lamps = numbers.next("the number of lamps")?;
    let lumens = numbers.next("the lumens of a lamp")?;
    let multiplier = numbers.next("the multiplier of the intensities")?;
    let polar_count = numbers.count("number of vertical angles", MOST_ANGLES)?;
    let azimuth_count = numbers.count("number of horizontal angles", MOST_ANGLES)?;
    let kind = numbers.next("the photometric type")?;
    let kind_line = numbers.last_line;
    numbers.next("the unit of length")?;
    for what in ["width", "length", "height"] {
        numbers.next(&format!("the {what} of the luminaire"))?;
    }
    let ballast = numbers.next("the ballast factor")?;
    let ballast_lamp = numbers.next("the ballast-lamp factor")?;
    numbers.next("the watts")?;
    let kind_name = match kind {
        1.0 => None,
        2.0 => Some("B (floodlights)"),
        3.0 => Some("A (headlights)"),
        _ => return Err((kind_line, format!("{kind} as photometric type: expected 1, which is type C"))),
    };
    if let Some(name) = kind_name {
        let problem = format!(
            "is of photometric type {name}, and only type C is read; ask the maker for type C, or convert it"
        );
        return Err((kind_line, problem));
    }
    if polar_count * azimuth_count > MOST_VALUES {
        return Err((
            kind_line,
            format!("{polar_count} by {azimuth_count} intensities: at most {MOST_VALUES} are read"),
        ));
    }
    let factor = multiplier * ballast * if ballast_lamp == 0.0 { 1.0 } else { ballast_lamp };
    if !(factor > 0.0 && factor.is_finite()) {
        let problem = format!(
            "the multipliers {multiplier}, {ballast} and {ballast_lamp} are not all above zero; mend the line"
        );
        return Err((numbers.last_line, problem));
    }
    let polar = numbers.angles(polar_count, "vertical angles")?;
    let polar_line = numbers.last_line;
    if polar_count < 2 || polar.last().is_some_and(|&last| last > std::f64::consts::PI) {
        return Err((
            polar_line,
            "the vertical angles of type C are two or more from 0 to 180; mend the line".to_owned(),
        ));
    }
    let azimuth = numbers.angles(azimuth_count, "horizontal angles")?;
    let azimuth_line = numbers.last_line;
    let (mut values, mut negative) = (Vec::with_capacity(polar_count * azimuth_count), 0u64);
    for _ in 0..polar_count * azimuth_count {
        let value = numbers.next("the intensities")?;
        negative += u64::from(value < 0.0);
        values.push((value.max(0.0) * factor) as f32);
    }
    if negative > 0 {
        warnings.push(format!("{negative} intensities are below zero and were set to zero"));
    }
    if let Some((line, _)) = numbers.words.next() {
        warnings.push(format!("what follows the intensities, from line {line} on, is not read"));
    }
    if !values.iter().any(|&value| value > 0.0) || !values.iter().all(|value| value.is_finite()) {
        return Err((
            0,
            "no intensity is above zero, or one is beyond single precision; nothing would shine".to_owned(),
        ));
    }
    let table = unfold(polar, azimuth, values).ok_or_else(|| {
        let problem = "the horizontal angles cover neither all around nor a part that symmetry completes: expected 0 alone, 0 to \
                       90, 0 to 180, 90 to 270, or 0 to 360 (the last one may be missing)";
        (azimuth_line, problem.to_owned())
    })?;
    // Absolute photometry is marked by -1.
    let flux = table.flux();
    let rated = lamps * lumens;
    if lumens > 0.0 && flux > 1.05 * rated * factor {
        warnings.push(format!(
            "the intensities add up to {flux:.0} lm, more than the {rated:.0} lm of its lamps"
        ));
    }
    Ok(IesFile { table, warnings })
}

/// Completes a distribution to all azimuths by the symmetry that its angles imply; `None` where they imply none.
fn unfold(polar: Vec<f64>, azimuth: Vec<f64>, values: Vec<f32>) -> Option<ProfileTable> {
    let count = polar.len();
    let column = |index: usize| values[index * count..(index + 1) * count].to_vec();
    let (first, last) = (*azimuth.first()?, *azimuth.last()?);
    let is = |angle: f64, degrees: f64| (angle - degrees.to_radians()).abs() < 1e-6;
    if azimuth.len() == 1 {
        return is(first, 0.0).then(|| ProfileTable { polar, azimuth: vec![0.0], values });
    }
    let mut columns: Vec<(f64, Vec<f32>)> =
        azimuth.iter().enumerate().map(|(i, &angle)| (angle, column(i))).collect();
    // Appends the mirror image of the columns about an angle.
    let mirror = |columns: &mut Vec<(f64, Vec<f32>)>, at: f64| {
        let mirrored: Vec<_> = columns
            .iter()
            .map(|(angle, column)| (2.0 * at - angle, column.clone()))
            .filter(|(angle, _)| (angle - at).abs() > 1e-9)
            .collect();
        columns.extend(mirrored);
    };
    if is(first, 0.0) && is(last, 90.0) {
        mirror(&mut columns, last);
        mirror(&mut columns, TAU / 2.0);
    } else if is(first, 0.0) && is(last, 180.0) {
        mirror(&mut columns, TAU / 2.0);
    } else if is(first, 90.0) && is(last, 270.0) {
        // The mirror plane goes from 90 to 270 degrees.
        mirror(&mut columns, last);
        for (angle, _) in &mut columns {
            if *angle > TAU + 1e-9 {
                *angle -= TAU;
            }
        }
        let wrapped: Vec<_> = columns
            .iter()
            .filter(|(angle, _)| is(*angle, 360.0))
            .map(|(_, column)| (0.0, column.clone()))
            .collect();
        columns.extend(wrapped);
    } else if is(first, 0.0) && last > TAU / 2.0 {
        if !is(last, 360.0) {
            let first = columns[0].1.clone();
            columns.push((TAU, first));
        }
    } else {
        return None;
    }
    columns.sort_by(|a, b| a.0.total_cmp(&b.0));
    columns.dedup_by(|a, b| (a.0 - b.0).abs() < 1e-9);
    // Where no angle lies at the seam, interpolates between its neighbours.
    if columns.first().is_some_and(|(angle, _)| *angle > 1e-9) {
        let (after, before) = (columns[0].clone(), columns[columns.len() - 1].clone());
        let gap = after.0 + TAU - before.0;
        let share = ((TAU - before.0) / gap) as f32;
        let between: Vec<f32> =
            before.1.iter().zip(&after.1).map(|(b, a)| b * (1.0 - share) + a * share).collect();
        columns.insert(0, (0.0, between.clone()));
        if before.0 < TAU - 1e-9 {
            columns.push((TAU, between));
        }
    }
    if let Some(first) = columns.first_mut() {
        first.0 = 0.0;
    }
    if let Some(last) = columns.last_mut() {
        last.0 = TAU;
    }
    let azimuth = columns.iter().map(|(angle, _)| *angle).collect();
    let values = columns.into_iter().flat_map(|(_, column)| column).collect();
    Some(ProfileTable { polar, azimuth, values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn file(header: &str, tilt: &str, horizontal: &str, columns: usize) -> String {
        let count = horizontal.split_whitespace().count();
        let values = (0..columns).map(|column| format!("{} 50 {column} 0\n", 100)).collect::<String>();
        format!(
            "{header}{tilt}\n1 1000 2.0 4 {count}\n 1 2 0.1 0.2\n0.0\n1.0 0.5 42\n0 30 60 90\n{horizontal}\n{values}"
        )
    }

    fn of(horizontal: &str) -> Result<IesFile, Failure> {
        let count = horizontal.split_whitespace().count();
        parse_ies(file("IESNA:LM-63-1995\n[TEST] none\n", "TILT=NONE", horizontal, count).as_bytes())
    }

    #[test]
    fn all_editions_are_read() {
        for header in [
            "Some Luminaire Ltd\n",
            "IESNA91\n[MANUFAC] a\n",
            "IESNA:LM-63-1995\n[MORE] b\n",
            "IESNA:LM-63-2002\r\n[TEST]\r\n",
        ] {
            let ies = parse_ies(file(header, "TILT=NONE", "0", 1).as_bytes()).unwrap();
            assert_eq!(ies.table.values, [100.0, 50.0, 0.0, 0.0]);
            assert_eq!(ies.table.azimuth, [0.0]);
            assert!((ies.table.polar[1] - PI / 6.0).abs() < 1e-12);
            assert!(ies.warnings.is_empty(), "{:?}", ies.warnings);
        }
        let tilted = "TILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.95 0.9";
        let ies = parse_ies(file("IESNA91\n", tilted, "0", 1).as_bytes()).unwrap();
        assert!(ies.warnings[0].contains("tilted") && ies.table.values[0] == 100.0);
        assert!(
            parse_ies(file("x\n", "TILT=lamp.tlt", "0", 1).as_bytes()).unwrap().warnings[0]
                .contains("LAMP.TLT")
        );
    }

    /// A quarter, a half and all of the azimuths; the third value is the number of the column.
    #[test]
    fn symmetries() {
        let at = |ies: &IesFile, degrees: f64| ies.table.at(PI / 3.0, degrees.to_radians());
        let quarter = of("0 45 90").unwrap();
        for (degrees, want) in
            [(0.0, 0.0), (22.5, 0.5), (45.0, 1.0), (135.0, 1.0), (180.0, 0.0), (270.0, 2.0), (315.0, 1.0)]
        {
            assert!((at(&quarter, degrees) - want).abs() < 1e-6, "{degrees}: {}", at(&quarter, degrees));
        }
        let half = of("0 90 180").unwrap();
        for (degrees, want) in [(0.0, 0.0), (90.0, 1.0), (180.0, 2.0), (270.0, 1.0), (225.0, 1.5)] {
            assert!((at(&half, degrees) - want).abs() < 1e-6, "{degrees}: {}", at(&half, degrees));
        }
        let other_half = of("90 180 270").unwrap();
        for (degrees, want) in
            [(90.0, 0.0), (180.0, 1.0), (270.0, 2.0), (0.0, 1.0), (45.0, 0.5), (315.0, 1.5)]
        {
            assert!(
                (at(&other_half, degrees) - want).abs() < 1e-6,
                "{degrees}: {}",
                at(&other_half, degrees)
            );
        }
        for all in [of("0 90 180 270 360"), of("0 90 180 270")] {
            let all = all.unwrap();
            assert!((at(&all, 270.0) - 3.0).abs() < 1e-6 && (at(&all, 180.0) - 2.0).abs() < 1e-6);
            assert_eq!((all.table.azimuth[0], *all.table.azimuth.last().unwrap()), (0.0, TAU));
        }
        assert!(of("0 45 100").unwrap_err().1.contains("symmetry"));
        assert!(of("10").unwrap_err().1.contains("symmetry"));
    }

    #[test]
    fn what_is_wrong_has_a_line() {
        let good = file("IESNA:LM-63-2002\n", "TILT=NONE", "0", 1);
        let cases: [(&str, &str, usize, &str); 9] = [
            ("TILT=NONE", "no tilt", 0, "TILT="),
            ("1 1000 2.0 4 1", "1 1000 2.0 4.5 1", 3, "whole number"),
            ("1 1000 2.0 4 1", "1 1000 2.0 4000000 1", 3, "whole number from 1"),
            ("1 1000 2.0", "1 x1000 2.0", 3, "`x1000` is not a number"),
            (" 1 2 0.1", " 2 2 0.1", 4, "type B"),
            (" 1 2 0.1", " 3 2 0.1", 4, "type A"),
            ("0 30 60 90", "0 30 30 90", 7, "not above"),
            ("0 30 60 90", "0 30 60 190", 7, "from 0 to 180"),
            ("100 50 0 0", "100 50 0", 9, "the file ends before the intensities"),
        ];
        for (from, to, line, what) in cases {
            let (at, problem) = parse_ies(good.replacen(from, to, 1).as_bytes()).unwrap_err();
            assert!(problem.contains(what) && at == line, "{from} as {to}: {at} {problem}");
        }
        for (from, to) in
            [("2.0 4 1", "nan 4 1"), ("2.0 4 1", "0 4 1"), ("100 50 0 0", "0 0 0 0"), ("100 50", "1e300 50")]
        {
            parse_ies(good.replacen(from, to, 1).as_bytes()).unwrap_err();
        }
        let low = parse_ies(good.replacen("100 50 0 0", "100 -50 0 0", 1).as_bytes()).unwrap();
        assert!(low.warnings[0].contains("below zero") && low.table.values[1] == 0.0);
        // No truncated text causes any other failure.
        for end in 0..good.len() {
            let _ = parse_ies(&good.as_bytes()[..end]);
        }
        parse_ies(b"").unwrap_err();
        parse_ies(&[0xff; 100]).unwrap_err();
    }

    #[test]
    fn files_are_named_in_errors() {
        let missing = read_ies(Path::new("no/such/lamp.ies")).unwrap_err().to_string();
        assert!(missing.starts_with("no/such/lamp.ies: cannot be read"), "{missing}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lamp.ies");
        std::fs::write(&path, "IESNA91\nTILT=NONE\n1 2 3\n").unwrap();
        let cut = read_ies(&path).unwrap_err().to_string();
        assert!(cut.contains("lamp.ies:3: the file ends before"), "{cut}");
        assert!(read_ies(folder.path()).unwrap_err().to_string().contains("not a regular file"));
    }
}
