//! How bright emitters are: in radiometric or photometric units, by a colour or by a number with a colour.
//!
//! One watt of the colour `[1, 1, 1]` is 683 lumens, as for the sky, and in general 683 times the luminance of its colour.

use crate::scene_file::colour_text::luminance;
use crate::scene_file::reader::{Expected, NON_NEGATIVE, Table};
use glam::DVec3;

/// Lumens of a watt whose colour has the luminance 1.
pub(super) const LUMENS_PER_WATT: f64 = 683.0;

/// A key that says how bright an emitter is.
#[derive(Clone, Copy)]
pub(super) struct Measure<T> {
    pub(super) key: &'static str,
    /// Whether it counts lumens rather than watts.
    pub(super) photometric: bool,
    /// What it measures.
    pub(super) of: T,
}

/// A radiometric measure.
pub(super) const fn watts<T>(key: &'static str, of: T) -> Measure<T> {
    Measure { key, photometric: false, of }
}

/// A photometric measure.
pub(super) const fn lumens<T>(key: &'static str, of: T) -> Measure<T> {
    Measure { key, photometric: true, of }
}

const TINT: Expected =
    Expected { what: "a colour of at least 0", example: "\"2700 K\"", holds: |x| x >= 0.0 };

/// The colour of a key with the luminance 1; white without it.
pub(super) fn tinted(table: &mut Table<'_>, key: &'static str) -> Option<DVec3> {
    match table.optional(key, |value| value.colour(&TINT))? {
        None => Some(DVec3::ONE),
        Some(tint) if luminance(tint) > 0.0 => Some(tint / luminance(tint)),
        Some(_) => table.refuse(format!("`{key}` is black"), "leave it out, or write a colour"),
    }
}

/// Reads the one of some keys that a table has, in watts, and which it is. `Some(None)` where it has none of them.
pub(super) fn read_brightness<T: Copy>(
    table: &mut Table<'_>,
    measures: &[Measure<T>],
) -> Option<Option<(DVec3, T)>> {
    let tint = table.optional("colour", |value| value.colour(&TINT));
    let found: Vec<_> =
        measures.iter().filter_map(|measure| Some((measure, table.get(measure.key)?))).collect();
    let tint = tint?;
    if let [(first, _), (second, value), ..] = &found[..] {
        let message = format!("{} has both `{}` and `{}`", table.title(), first.key, second.key);
        table.context().error(&value.span(), message, "leave one of them out");
        return None;
    }
    let Some((measure, value)) = found.into_iter().next() else {
        return match tint {
            None => Some(None),
            Some(_) => {
                let keys: Vec<_> = measures.iter().map(|measure| measure.key).collect();
                table.refuse(
                    format!("{} has a `colour` and does not say how bright it is", table.title()),
                    format!("add a number as `{}`", keys.join("`, `")),
                )
            }
        };
    };
    let tint = match tint {
        None => None,
        Some(tint) if luminance(tint) > 0.0 => Some(tint / luminance(tint)),
        Some(_) => return table.refuse("a light whose `colour` is black", "leave it out, or write a colour"),
    };
    let amount = match (measure.photometric, tint) {
        (false, None) => value.colour(&NON_NEGATIVE)?,
        (false, Some(tint)) => tint * value.number(&NON_NEGATIVE)?,
        (true, tint) => tint.unwrap_or(DVec3::ONE) * (value.number(&NON_NEGATIVE)? / LUMENS_PER_WATT),
    };
    Some(Some((amount, measure.of)))
}

#[cfg(test)]
mod tests {
    use crate::embree::Device;
    use crate::scene_file::{LightDescription, SceneDescription, build_scene, parse_scene};
    use glam::DVec3;
    use std::f64::consts::PI;
    use std::path::Path;
    use std::sync::Arc;

    const GROUND: &str = "[materials.ground]\ntype = \"lambert\"\nreflectance = 0.5
        [[shapes]]\nname = \"ground\"\ntype = \"disc\"\nradius = 1\nmaterial = \"ground\"\n";

    fn scene(text: &str) -> Result<SceneDescription, String> {
        parse_scene(&format!("{text}\n{GROUND}"), Path::new("a.toml"), &[]).map_err(|error| error.to_string())
    }

    fn close(found: DVec3, want: DVec3) -> bool {
        (found - want).length() <= 1e-5 * want.length()
    }

    /// Luminance 1 in the proportions of a colour.
    fn white(colour: DVec3) -> DVec3 {
        colour / colour.dot(DVec3::new(0.2126, 0.7152, 0.0722))
    }

    #[test]
    fn lights_in_all_units() {
        let half = 0.214_041_14;
        let orange = white(DVec3::new(1.0, half, 0.0));
        let light = |text: &str| scene(&format!("[[lights]]\n{text}")).unwrap().lights[0].value.clone();
        let point = |text: &str| match light(&format!("type = \"point\"\nposition = [0, 1, 0]\n{text}")) {
            LightDescription::Point { intensity, .. } => intensity,
            other => panic!("{other:?}"),
        };
        assert!(close(point("intensity = [1, 2, 3]"), DVec3::new(1.0, 2.0, 3.0)));
        assert!(close(point("power = 8"), DVec3::splat(8.0 / (4.0 * PI))));
        assert!(close(point("candela = 683"), DVec3::ONE));
        assert!(close(point("lumens = 1366\ncolour = \"srgb(1, 0.5, 0)\""), orange * 2.0 / (4.0 * PI)));
        assert!(close(point("power = 8\ncolour = [1, 1, 1]"), DVec3::splat(8.0 / (4.0 * PI))));
        // A colour is not a strength: twice the colour is the same light.
        assert_eq!(
            point("candela = 5\ncolour = [0.2, 0.4, 0.1]"),
            point("candela = 5\ncolour = [0.4, 0.8, 0.2]")
        );
        let spot = light(
            "type = \"spot\"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\nlumens = 683\ninner-angle = 89.999\nouter-angle = 90",
        );
        // Full intensity over a hemisphere.
        assert!(
            matches!(spot, LightDescription::Spot { intensity, .. } if (intensity.x * 2.0 * PI - 1.0).abs() < 2e-3),
            "{spot:?}"
        );
        let sun = light("type = \"directional\"\ndirection = [0, -1, 0]\nlux = 100000\ncolour = \"#ffffff\"");
        assert!(
            matches!(sun, LightDescription::Directional { irradiance, .. } if close(irradiance, DVec3::splat(1e5 / 683.0)))
        );
        let sky = light("type = \"environment\"\nnits = 6830");
        assert!(
            matches!(sky, LightDescription::Environment { radiance } if close(radiance, DVec3::splat(10.0)))
        );
    }

    /// Flux of each light of a scene, W.
    fn fluxes(text: &str) -> Vec<DVec3> {
        let device = Arc::new(Device::new(1).unwrap());
        let built = build_scene(&scene(text).unwrap(), &device, (16, 16)).unwrap();
        let (space, radius) = (*built.scene.space(), built.scene.bounds().1);
        let factor = 1.0 / (space.power * space.scale * space.scale);
        built.scene.lights().iter().map(|light| light.flux(radius) * factor).collect()
    }

    /// Shapes emit the power that they are given, however they are scaled, on one side or two.
    #[test]
    fn surfaces_emit_their_power() {
        let head = "unit = \"cm\"\n[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n";
        for (shape, area) in [
            ("type = \"sphere\"\nradius = 2\ntransform = [{ scale = 3 }]", 4.0 * PI * 36.0),
            ("type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [2, 0, 0]\nedge-v = [0, 3, 0]", 6.0),
            ("type = \"disc\"\nradius = 2", 4.0 * PI),
            ("type = \"cylinder\"\nbase = [0, 0, 0]\ntop = [0, 5, 0]\nradius = 1", 10.0 * PI),
            (
                "type = \"mesh\"\nvertices = [[0, 0, 0], [2, 0, 0], [0, 2, 0]]\nfaces = [[0, 1, 2]]\ntransform = [{ scale = [1, 5, 1] }]",
                10.0,
            ),
        ] {
            for (sides, two_sided) in [(1.0, false), (2.0, true)] {
                let of = |emission: &str| {
                    fluxes(&format!(
                        "{head}[[shapes]]\n{shape}\nmaterial = \"m\"\nemission = {{ {emission}, two-sided = {two_sided} }}\n"
                    ))
                };
                let want = DVec3::new(7.0, 5.0, 1.0);
                assert!(close(of("power = [7, 5, 1]")[0], want), "{shape}: {:?}", of("power = [7, 5, 1]"));
                let lit = of("lumens = 6830, colour = [1, 0.5, 0.25]")[0];
                assert!(close(lit, 10.0 * white(DVec3::new(1.0, 0.5, 0.25))), "{shape}: {lit}");
                // Square centimetres.
                let bright = of("nits = 683")[0];
                assert!(close(bright, DVec3::splat(PI * area * 1e-4 * sides)), "{shape}: {bright}");
            }
        }
        // Each instance is a lamp of its own.
        let lamp = "[[shapes]]\ntype = \"sphere\"\nradius = 1\nemission = { power = 3 }\ngroup = \"lamp\"\n";
        let twice = "[[instances]]\ngroup = \"lamp\"\n[[instances]]\ngroup = \"lamp\"\ntransform = [{ scale = 2 }, { translate = [9, 0, 0] }]\n";
        let found = fluxes(&format!("{head}{lamp}{twice}"));
        assert!(found.len() == 2 && found.iter().all(|flux| close(*flux, DVec3::splat(3.0))), "{found:?}");
    }

    #[test]
    fn what_is_said_twice_or_not_at_all() {
        let lamp = |emission: &str| {
            format!("[[shapes]]\ntype = \"sphere\"\nradius = 1\nemission = {{ {emission} }}\n")
        };
        let point = |text: &str| format!("[[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\n{text}\n");
        for (text, told) in [
            (lamp("radiance = 1, nits = 100"), "has both `radiance` and `nits`"),
            (lamp("power = 1, lumens = 100"), "has both `power` and `lumens`"),
            (lamp("two-sided = true"), "`emission` has no `radiance`"),
            (lamp("colour = 1"), "does not say how bright it is"),
            (lamp("nits = [1, 2, 3]"), "`nits` is [1, 2, 3]"),
            (lamp("power = [1, 2, 3], colour = \"#ffffff\""), "`power` is [1, 2, 3]"),
            (lamp("lumens = -1"), "at least 0"),
            (lamp("lumens = 1, colour = 0"), "`colour` is black"),
            (lamp("radiance = \"red\""), "a text such as \"#ff8000\""),
            (lamp("radiance = \"100 K\""), "from 800 K to 40000 K"),
            (lamp("candela = 1"), "unknown key `candela`"),
            (point(""), "does not say how bright it is"),
            (point("candela = 1\nintensity = 2"), "has both `intensity` and `candela`"),
            (point("lux = 1"), "unknown key `lux`"),
            (
                "[[shapes]]\ntype = \"mesh\"\nfile = \"scenes/meshes/cube.gltf\"\nmaterials = \"file\"\nemission = { lumens = 1 }\n".to_owned(),
                "give `radiance` or `nits`",
            ),
            (
                "[materials.m]\ntype = \"lambert\"\nreflectance = \"#zz0000\"\n".to_owned(),
                "six hexadecimal digits",
            ),
        ] {
            let error = scene(&text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
        let material = |colour: &str| {
            scene(&format!("[materials.m]\ntype = \"lambert\"\nreflectance = {colour}\n"))
                .map(|scene| scene.materials.len())
        };
        assert_eq!((material("\"#c08040\""), material("\"2700 K\"")), (Ok(2), Ok(2)));
    }
}
