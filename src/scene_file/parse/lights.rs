//! `[[lights]]`: lights without a surface.

use super::names::Names;
use super::read_name;
use crate::scene_file::description::*;
use crate::scene_file::reader::{NON_NEGATIVE, NUMBER, SHARE, Table};
use glam::DVec3;
use std::f64::consts::PI;

#[derive(Clone, Copy)]
enum Kind {
    Point,
    Directional,
    Environment,
}

/// The lights, and the share of photons of each.
pub(super) fn read_lights(tables: Vec<Table<'_>>, unit: f64) -> (Vec<Named<LightDescription>>, Vec<f64>) {
    let mut names = Names::new("light");
    let mut environment: Option<Location> = None;
    let (mut lights, mut shares) = (Vec::new(), Vec::new());
    for (index, mut table) in tables.into_iter().enumerate() {
        let name = read_name(&mut table, &mut names, "light", index);
        let location = table.location();
        let context = table.context();
        let span = table.span().clone();
        let photons = table.or("photons", 1.0, |value| value.number(&SHARE));
        let Some(value) = read_light(table, unit) else { continue };
        if matches!(value, LightDescription::Environment { .. })
            && let Some(first) = environment.replace(location.clone())
        {
            let message = format!("a second environment: the first is at {first}");
            context.error(&span, message, "add their radiances up in one");
        }
        let (Some(name), Some(photons)) = (name, photons) else { continue };
        lights.push(Named { name, location, value });
        shares.push(photons);
    }
    (lights, shares)
}

fn read_light(mut table: Table<'_>, unit: f64) -> Option<LightDescription> {
    let kinds =
        [("point", Kind::Point), ("directional", Kind::Directional), ("environment", Kind::Environment)];
    let light = match table.required("type", "\"point\"", |value| value.choice(&kinds))? {
        Kind::Point => {
            let position = table.required("position", "[0.0, 2.0, 0.0]", |value| value.vector(&NUMBER));
            let intensity = read_intensity(&mut table);
            position
                .zip(intensity)
                .map(|(position, intensity)| LightDescription::Point { position: position * unit, intensity })
        }
        Kind::Directional => {
            let direction =
                table.required("direction", "[0.0, -1.0, 0.0]", |value| match value.vector(&NUMBER)? {
                    DVec3::ZERO => value.refuse("a direction", "give at least one number that is not 0"),
                    direction => Some(direction),
                });
            let irradiance =
                table.required("irradiance", "[3.0, 3.0, 3.0]", |value| value.colour(&NON_NEGATIVE));
            direction
                .zip(irradiance)
                .map(|(direction, irradiance)| LightDescription::Directional { direction, irradiance })
        }
        Kind::Environment => table
            .required("radiance", "[1.0, 1.0, 1.0]", |value| value.colour(&NON_NEGATIVE))
            .map(|radiance| LightDescription::Environment { radiance }),
    };
    table.finish();
    light
}

/// Radiant intensity (W/sr) of a point light, given as such or as power (W): equal in all directions, so
/// power is 4 pi times intensity.
fn read_intensity(table: &mut Table<'_>) -> Option<DVec3> {
    match (table.get("intensity"), table.get("power")) {
        (Some(intensity), None) => intensity.colour(&NON_NEGATIVE),
        (None, Some(power)) => power.colour(&NON_NEGATIVE).map(|power| power / (4.0 * PI)),
        (Some(_), Some(power)) => {
            let message = format!("{} has both `intensity` and `power`", table.title());
            table.context().error(&power.span(), message, "leave one of them out");
            None
        }
        (None, None) => table.refuse(
            format!("{} does not say how bright it is", table.title()),
            "add `power = [..]` (W) or `intensity = [..]` (W/sr)",
        ),
    }
}
