//! Where the sun stands at a time and a place: the low-precision formulae of Meeus ("Astronomical Algorithms", second edition, chapters 12,
//! 13, 22 and 25), which the solar calculator of the NOAA uses too. Between 1900 and 2100 the sun is within 0.02 degrees of its place.

use std::f64::consts::PI;

/// Place of the sun in the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Elevation above the horizon, radians, with the refraction of the air at sea level.
    pub elevation: f64,
    /// Azimuth from north over east, radians, in `[0, 2 pi)`.
    pub azimuth: f64,
}

/// Days since noon of 1 January 4713 BC at Greenwich, for a date of the Gregorian calendar and `hours` of universal time after its
/// midnight, which may be below 0 and above 24.
pub fn julian_day(year: i32, month: u32, day: u32, hours: f64) -> f64 {
    // January and February count to the year before.
    let (year, month) =
        if month < 3 { (f64::from(year) - 1.0, month + 12) } else { (f64::from(year), month) };
    let century = (year / 100.0).floor();
    let leap = 2.0 - century + (century / 4.0).floor();
    (365.25 * (year + 4716.0)).floor() + (30.6001 * f64::from(month + 1)).floor() + f64::from(day) + leap
        - 1524.5
        + hours / 24.0
}

/// Position of the sun for a Julian day in universal time, at a latitude and an eastern longitude in degrees.
pub fn sun_position(julian_day: f64, latitude: f64, longitude: f64) -> SunPosition {
    let (ascension, declination, sidereal) = equatorial(julian_day);
    let hour_angle = sidereal + longitude.to_radians() - ascension;
    let (sin_lat, cos_lat) = latitude.to_radians().sin_cos();
    let (sin_dec, cos_dec) = declination.sin_cos();
    let (sin_hour, cos_hour) = hour_angle.sin_cos();
    let elevation = (sin_lat * sin_dec + cos_lat * cos_dec * cos_hour).clamp(-1.0, 1.0).asin();
    // From the south over west, times cos(declination), so that nothing is divided by zero.
    let azimuth = (sin_hour * cos_dec).atan2(cos_hour * cos_dec * sin_lat - sin_dec * cos_lat) + PI;
    SunPosition { elevation: elevation + refraction(elevation), azimuth: azimuth.rem_euclid(2.0 * PI) }
}

/// Apparent right ascension and declination of the sun, and apparent sidereal time at Greenwich, radians.
fn equatorial(julian_day: f64) -> (f64, f64, f64) {
    let days = julian_day - 2_451_545.0;
    let t = days / 36_525.0;
    let mean_longitude = 280.466_46 + t * (36_000.769_83 + t * 0.000_303_2);
    let anomaly = (357.529_11 + t * (35_999.050_29 - t * 0.000_153_7)).to_radians();
    let center = (1.914_602 - t * (0.004_817 + t * 0.000_014)) * anomaly.sin()
        + (0.019_993 - t * 0.000_101) * (2.0 * anomaly).sin()
        + 0.000_289 * (3.0 * anomaly).sin();
    let node = (125.04 - 1934.136 * t).to_radians();
    // Aberration and nutation.
    let longitude = (mean_longitude + center - 0.005_69 - 0.004_78 * node.sin()).to_radians();
    let mean_obliquity = 23.439_291_1 - t * (0.013_004_2 + t * (1.64e-7 - t * 5.04e-7));
    let obliquity = (mean_obliquity + 0.002_56 * node.cos()).to_radians();
    let ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
    let declination = (obliquity.sin() * longitude.sin()).asin();
    let mean_sidereal =
        280.460_618_37 + 360.985_647_366_29 * days + t * t * (0.000_387_933 - t / 38_710_000.0);
    let sidereal = mean_sidereal - 0.004_78 * node.sin() * obliquity.cos();
    (ascension, declination, sidereal.to_radians())
}

/// By how much the air raises what stands at this elevation, radians, at 1010 hPa and 10 degrees Celsius (Saemundsson 1986); zero more than
/// a degree below the horizon.
fn refraction(elevation: f64) -> f64 {
    let degrees = elevation.to_degrees();
    if degrees < -1.0 {
        return 0.0;
    }
    let minutes = 1.02 / (degrees + 10.3 / (degrees + 5.11)).to_radians().tan();
    (minutes.max(0.0) / 60.0).to_radians()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn julian_days() {
        // Meeus, chapter 7.
        assert_eq!(julian_day(2000, 1, 1, 12.0), 2_451_545.0);
        assert_eq!(julian_day(1987, 1, 27, 0.0), 2_446_822.5);
        assert_eq!(julian_day(1900, 1, 1, 0.0), 2_415_020.5);
        assert_eq!(julian_day(1957, 10, 4, 0.81 * 24.0), 2_436_116.31);
        assert_eq!(julian_day(2024, 2, 29, 36.0), julian_day(2024, 3, 1, 12.0));
    }

    /// Example 25.a of Meeus: 13 October 1992 at midnight, right ascension 198.38083 and declination -7.78507 degrees.
    #[test]
    fn the_example_of_meeus() {
        let (ascension, declination, _) = equatorial(2_448_908.5);
        assert!((ascension.to_degrees().rem_euclid(360.0) - 198.380_83).abs() < 2e-4, "{ascension}");
        assert!((declination.to_degrees() + 7.785_07).abs() < 2e-4, "{declination}");
    }

    /// The example of NREL's algorithm (Reda & Andreas 2008, with 820 mbar), and places by the theory VSOP87 as the library PyEphem 4.2
    /// computes it, with refraction.
    #[test]
    fn places_by_other_theories() {
        let cases = [
            ((2003, 10, 17, 19.508_333), (39.742_476, -105.1786), (194.340_24, 39.888_38)),
            ((2024, 6, 21, 12.0), (51.4769, 0.0), (179.062_49, 61.964_97)),
            ((2024, 6, 21, 5.0), (51.4769, 0.0), (63.590_98, 9.230_62)),
            ((2026, 12, 21, 22.25), (-33.8688, 151.2093), (92.612_88, 41.534_48)),
            ((2026, 6, 21, 22.5), (69.65, 18.96), (356.308_32, 3.350_21)),
            ((1990, 2, 3, 6.0), (35.68, 139.69), (228.216_03, 21.873_89)),
            ((2049, 11, 5, 3.0), (-77.85, 166.67), (321.451_84, 25.506_99)),
        ];
        for ((year, month, day, hours), (latitude, longitude), (azimuth, elevation)) in cases {
            let found = sun_position(julian_day(year, month, day, hours), latitude, longitude);
            let (a, e) = (found.azimuth.to_degrees(), found.elevation.to_degrees());
            assert!((a - azimuth).abs() < 0.02 && (e - elevation).abs() < 0.02, "{year}: {a} {e}");
        }
        // Nearly in the zenith, where the azimuth says little.
        let high = sun_position(julian_day(2026, 3, 20, 17.0 + 1.0 / 3.0), 0.0, -78.5);
        assert!((high.elevation.to_degrees() - 89.654_6).abs() < 0.02, "{high:?}");
    }
}
