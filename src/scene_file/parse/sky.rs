//! Skies: the sun by angles, by a direction, or by a time and a place; the sky of a clear day, and those of the CIE.

use super::brightness::{LUMENS_PER_WATT, tinted};
use super::lights::read_direction;
use crate::lights::{CieSky, CieSkyKind, SunPosition, julian_day, sun_position};
use crate::scene_file::description::*;
use crate::scene_file::reader::{Expected, FRACTION, NON_NEGATIVE, NUMBER, Table, Value};
use glam::DVec3;
use std::f64::consts::FRAC_PI_2;
use toml_datetime::{Datetime, Offset};

const ELEVATION: Expected =
    Expected { what: "an angle from 0 to 90 degrees", example: "35.0", holds: |x| (0.0..=90.0).contains(&x) };
const TURBIDITY: Expected =
    Expected { what: "a number from 1 to 10", example: "3.0", holds: |x| (1.0..=10.0).contains(&x) };
const LATITUDE: Expected = Expected {
    what: "degrees from -90 to 90, north above 0",
    example: "48.1",
    holds: |x| (-90.0..=90.0).contains(&x),
};
const LONGITUDE: Expected = Expected {
    what: "degrees from -180 to 180, east above 0",
    example: "11.6",
    holds: |x| (-180.0..=180.0).contains(&x),
};
const TIME_ZONE: Expected = Expected {
    what: "hours from -15 to 15, east of Greenwich above 0",
    example: "1.0",
    holds: |x| (-15.0..=15.0).contains(&x),
};

#[derive(Clone, Copy)]
enum Model {
    Clear,
    Cie(CieSkyKind),
}

pub(super) fn read_sky(table: &mut Table<'_>) -> Option<LightDescription> {
    let models = [
        ("hosek", Model::Clear),
        ("cie-clear", Model::Cie(CieSkyKind::Clear)),
        ("cie-intermediate", Model::Cie(CieSkyKind::Intermediate)),
        ("cie-overcast", Model::Cie(CieSkyKind::Overcast)),
    ];
    let model = table.or("model", Model::Clear, |value| value.choice(&models));
    let place = read_sun(table);
    let albedo = table.or("albedo", DVec3::splat(0.2), |value| value.colour(&FRACTION));
    let factor = table.or("scale", DVec3::ONE, |value| value.colour(&NON_NEGATIVE));
    let sun = table.optional("sun", |value| value.boolean());
    // The other keys depend on the model.
    let sky = match model? {
        Model::Clear => {
            let turbidity = table.or("turbidity", 3.0, |value| value.number(&TURBIDITY));
            let (elevation, azimuth) = place?;
            LightDescription::Sky {
                elevation,
                azimuth,
                turbidity: turbidity?,
                albedo: albedo?,
                factor: factor?,
                sun: sun?.unwrap_or(true),
                axes: None,
            }
        }
        Model::Cie(kind) => {
            let lux = table.optional("lux", |value| value.number(&NON_NEGATIVE));
            let sun_lux = table.optional("sun-lux", |value| value.number(&NON_NEGATIVE));
            let colour = tinted(table, "colour");
            let sun_colour = tinted(table, "sun-colour");
            let (elevation, azimuth) = place?;
            let model = CieSky::new(kind, elevation, azimuth)?;
            let (sun, sun_lux, lux) = (sun?, sun_lux?, lux?);
            let hides_sun = kind == CieSkyKind::Overcast;
            if hides_sun && (sun == Some(true) || sun_lux.is_some()) {
                return table.refuse(
                    format!("{} is overcast, and its sun is to shine", table.title()),
                    "leave `sun` and `sun-lux` out, or choose `model = \"cie-intermediate\"`",
                );
            }
            let has_sun = sun.unwrap_or(!hides_sun);
            let irradiance = colour? * (lux.unwrap_or(model.usual_illuminance()) / LUMENS_PER_WATT);
            let of_sun = sun_colour? * (sun_lux.unwrap_or(model.usual_sun()) / LUMENS_PER_WATT);
            LightDescription::CieSky {
                kind,
                elevation,
                azimuth,
                irradiance,
                sun: has_sun.then_some(of_sun),
                albedo: albedo?,
                factor: factor?,
            }
        }
    };
    Some(sky)
}

/// Reads where the sun is: its elevation, and its azimuth from -z towards +x, radians.
fn read_sun(table: &mut Table<'_>) -> Option<(f64, f64)> {
    let direction = table.optional("sun-direction", read_direction);
    let elevation = table.optional("elevation", |value| value.number(&ELEVATION));
    let azimuth = table.optional("azimuth", |value| value.number(&NUMBER));
    let moment = table.optional("time", read_moment);
    let latitude = table.optional("latitude", |value| value.number(&LATITUDE));
    let longitude = table.optional("longitude", |value| value.number(&LONGITUDE));
    let zone = table.optional("time-zone", |value| value.number(&TIME_ZONE));
    let north = table.optional("north", |value| value.number(&NUMBER));
    let (direction, elevation, azimuth) = (direction?, elevation?, azimuth?);
    let (moment, latitude, longitude, zone, north) = (moment?, latitude?, longitude?, zone?, north?);
    let has_place = latitude.is_some() || longitude.is_some() || zone.is_some() || north.is_some();
    match (direction, elevation, azimuth, moment) {
        (None, Some(elevation), azimuth, None) if !has_place => {
            Some((elevation.to_radians(), azimuth.unwrap_or(0.0).to_radians()))
        }
        (Some(towards), None, None, None) if !has_place => {
            if towards.y < 0.0 {
                return table.refuse(
                    format!("the sun of {} is below the horizon", table.title()),
                    "`sun-direction` points from the ground to the sun; its second number is at least 0",
                );
            }
            let level = towards.x.hypot(towards.z);
            Some((towards.y.atan2(level).clamp(0.0, FRAC_PI_2), towards.x.atan2(-towards.z)))
        }
        (None, None, None, Some(moment)) => {
            let (Some(latitude), Some(longitude)) = (latitude, longitude) else {
                return table.refuse(
                    format!("{} has a `time` and no place", table.title()),
                    "add `latitude` and `longitude` in degrees, north and east above 0",
                );
            };
            let hours = moment.universal(table, zone)?;
            let day = julian_day(moment.date.0, moment.date.1, moment.date.2, hours);
            let SunPosition { elevation, azimuth } = sun_position(day, latitude, longitude);
            if elevation < 0.0 {
                return table.refuse(
                    format!(
                        "the sun of {} is {:.1} degrees below the horizon at that time and place",
                        table.title(),
                        -elevation.to_degrees()
                    ),
                    "choose another `time`; east of Greenwich the difference from universal time is above 0",
                );
            }
            Some((elevation.min(FRAC_PI_2), azimuth + north.unwrap_or(0.0).to_radians()))
        }
        _ => table.refuse(
            format!("{} does not say where the sun is, or says it twice", table.title()),
            "give `elevation` (and `azimuth`) in degrees, or `sun-direction`, or `time` with `latitude` and `longitude`",
        ),
    }
}

/// A date with a time of the day.
#[derive(Clone, Copy)]
struct Moment {
    /// Year, month and day.
    date: (i32, u32, u32),
    /// Hours since midnight of the zone.
    hours: f64,
    /// Hours by which the zone is before universal time.
    offset: Option<f64>,
}

impl Moment {
    /// Hours since midnight of universal time.
    fn universal(&self, table: &Table<'_>, zone: Option<f64>) -> Option<f64> {
        match (self.offset, zone) {
            (Some(offset), None) | (None, Some(offset)) => Some(self.hours - offset),
            (Some(_), Some(_)) => table.refuse(
                format!("`time` of {} ends with its difference from universal time, and there is a `time-zone`", table.title()),
                "leave one of them out",
            ),
            (None, None) => table.refuse(
                format!("`time` of {} does not say of which time zone", table.title()),
                "end it with the difference from universal time, as in 2026-06-21T14:30:00+02:00, or add `time-zone = 2.0`",
            ),
        }
    }
}

fn read_moment(value: Value<'_>) -> Option<Moment> {
    const EXPECTED: &str = "a date with a time";
    const REMEDY: &str = "write for example `time = 2026-06-21T14:30:00+02:00`";
    let found = match value.datetime() {
        Some(found) => found,
        None if value.is_string() => match value.string()?.trim().parse::<Datetime>() {
            Ok(found) => found,
            Err(_) => return value.refuse(EXPECTED, REMEDY),
        },
        None => return value.refuse(EXPECTED, REMEDY),
    };
    let (Some(date), Some(time)) = (found.date, found.time) else {
        return value.refuse(EXPECTED, REMEDY);
    };
    let seconds = f64::from(time.second.unwrap_or(0)) + f64::from(time.nanosecond.unwrap_or(0)) * 1e-9;
    let offset = found.offset.map(|offset| match offset {
        Offset::Z => 0.0,
        Offset::Custom { minutes } => f64::from(minutes) / 60.0,
    });
    Some(Moment {
        date: (i32::from(date.year), date.month.into(), date.day.into()),
        hours: f64::from(time.hour) + f64::from(time.minute) / 60.0 + seconds / 3600.0,
        offset,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse_scene;
    use std::path::Path;

    fn light(text: &str) -> Result<LightDescription, String> {
        let text = format!(
            "[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"m\"
            [[lights]]\ntype = \"sky\"\n{text}\n"
        );
        let scene = parse_scene(&text, Path::new("a.toml"), &[]).map_err(|error| error.to_string())?;
        Ok(scene.lights[0].value.clone())
    }

    /// Elevation and azimuth in degrees.
    fn sun(text: &str) -> (f64, f64) {
        let (LightDescription::Sky { elevation, azimuth, .. }
        | LightDescription::CieSky { elevation, azimuth, .. }) = light(text).unwrap()
        else {
            panic!()
        };
        (elevation.to_degrees(), azimuth.to_degrees())
    }

    /// The same moment and place in several ways. The place is that of NREL's example.
    #[test]
    fn the_sun_by_time_and_place() {
        let place = "latitude = 39.742476\nlongitude = -105.1786\n";
        for time in [
            "time = 2003-10-17T12:30:30-07:00",
            "time = 2003-10-17T19:30:30Z",
            "time = 2003-10-17T12:30:30\ntime-zone = -7",
            "time = \"2003-10-17 12:30:30\"\ntime-zone = -7.0",
            "time = 2003-10-18T00:30:30+05:00",
        ] {
            let (elevation, azimuth) = sun(&format!("{place}{time}"));
            assert!(
                (elevation - 39.888).abs() < 0.02 && (azimuth - 194.340).abs() < 0.02,
                "{time}: {elevation} {azimuth}"
            );
        }
        let (_, turned) = sun(&format!("{place}time = 2003-10-17T19:30:30Z\nnorth = 30"));
        assert!((turned - 224.340).abs() < 0.02, "{turned}");
        assert_eq!(sun("elevation = 30\nazimuth = 40").0.round(), 30.0);
    }

    #[test]
    fn skies_of_the_cie() {
        let of = |text: &str| light(&format!("elevation = 30\n{text}")).unwrap();
        let LightDescription::CieSky { irradiance, sun: Some(sun), .. } = of("model = \"cie-clear\"") else {
            panic!()
        };
        assert!((irradiance * 683.0 - (800.0 + 15_500.0 * 0.5f64.sqrt())).length() < 1e-6, "{irradiance}");
        assert!((sun * 683.0 - 127_500.0 * (-0.42f64).exp()).length() < 1e-6, "{sun}");
        let LightDescription::CieSky { irradiance, sun: None, .. } =
            of("model = \"cie-overcast\"\nlux = 6830\ncolour = [2, 2, 2]")
        else {
            panic!()
        };
        assert!((irradiance - 10.0).length() < 1e-9, "{irradiance}");
        let without = of("model = \"cie-intermediate\"\nsun = false");
        assert!(matches!(without, LightDescription::CieSky { sun: None, .. }));
    }

    #[test]
    fn what_is_wrong_with_a_sky() {
        let place = "latitude = 48\nlongitude = 11\n";
        for (text, told) in [
            ("time = 2026-06-21T14:30:00Z".to_owned(), "no place"),
            (format!("{place}time = 2026-06-21T14:30:00"), "of which time zone"),
            (format!("{place}time = 2026-06-21T14:30:00Z\ntime-zone = 1"), "leave one of them out"),
            (format!("{place}time = 2026-06-21T23:30:00Z"), "below the horizon at that time"),
            (format!("{place}time = 2026-06-21"), "a date with a time"),
            (format!("{place}time = \"noon\""), "a date with a time"),
            (format!("{place}time = 12"), "a date with a time"),
            (format!("{place}time = 2026-06-21T14:30:00Z\nelevation = 3"), "or says it twice"),
            (format!("{place}elevation = 3"), "or says it twice"),
            ("elevation = 3\nsun-direction = [0, 1, 0]".to_owned(), "or says it twice"),
            ("latitude = 91\nlongitude = 0\ntime = 2026-06-21T14:30:00Z".to_owned(), "north above 0"),
            ("elevation = 3\nmodel = \"cie-overcast\"\nsun = true".to_owned(), "is overcast"),
            ("elevation = 3\nmodel = \"cie-clear\"\nturbidity = 3".to_owned(), "unknown key `turbidity`"),
            ("elevation = 3\nlux = 3".to_owned(), "unknown key `lux`"),
            ("elevation = 3\nmodel = \"grey\"".to_owned(), "cie-overcast"),
        ] {
            let error = light(&text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
    }
}
