//! Tests of the scene file parser.

use super::*;
use crate::math::Rgb;
use crate::scene_file::diagnostic::Diagnostic;
use crate::settings::Kernel;
use crate::settings::Quality;
use glam::DVec3;
use proptest::prelude::*;
use std::path::PathBuf;

const FILE: &str = "scenes/s.toml";

/// The part that turns a fragment into a complete scene.
const WHITE: &str = "\n[materials.white]\ntype = \"lambert\"\nreflectance = 0.8\n";
const BALL: &str = "\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"white\"\n";

fn parse(text: &str) -> Result<SceneDescription, SceneFileError> {
    parse_scene(text, Path::new(FILE), &[])
}

fn diagnostics(text: &str, parameters: &[(String, String)]) -> Vec<Diagnostic> {
    match parse_scene(text, Path::new(FILE), parameters) {
        Err(SceneFileError::Invalid { diagnostics, .. } | SceneFileError::NotToml { diagnostics, .. }) => {
            diagnostics
        }
        other => panic!("should be refused as invalid: {other:?}"),
    }
}

fn set(name: &str, value: &str) -> (String, String) {
    (name.to_string(), value.to_string())
}

fn checkout() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

const GOOD: &str = r#"
name = "everything"
unit = "mm"

[parameters]
size = 2.0
where = 3

[camera]
eye = [0, 1, 5]
at = [0, 0, 0]
up = [0, 0, -1]
fov = 40.5
fov-axis = "horizontal"

[film]
width = 256
height = 0x80
filter = { type = "gaussian", sigma = 0.6 }
exposure = -1.5

[render]
quality = "draft"
global-photons = 1e6
seed = 18446744073709551615
cone-k = 1.25
precomputed-irradiance = false

[media.water]
ior = 1.33
absorption = [0.1, 0.02, 0.01]

[materials]
white = { type = "lambert", reflectance = 0.8, two-sided = false }
metal = { type = "mirror" }

[materials.glass]
type = "dielectric"
ior = 1.5

[materials.pool]
type = "dielectric"
inside = "water"
outside = "air"

[[shapes]]
name = "ball"
type = "sphere"
radius = "${size}"
material = "glass"
transform = [{ scale = 2 }, { rotate = 90, axis = "y" }, { translate = [1, 2, "${where}"] }]

[[shapes]]
type = "quad"
corner = [0, 0, 0]
edge-u = [1, 0, 0]
edge-v = [0, 0, 1]
emission = { radiance = 3 }
group = "lamp"

[[shapes]]
type = "mesh"
vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
faces = [[0, 1, 2, 3]]
material = "white"
flip-normal = true

[[shapes]]
type = "cylinder"
base = [0, 0, 0]
top = [0, 5, 0]
radius = 1
material = "metal"

[[shapes]]
type = "disc"
radius = 1
material = "pool"

[[instances]]
group = "lamp"
transform = [{ translate = [1000, 0, 0] }]

[[lights]]
type = "point"
position = [0, 3000, 0]
power = 100

[[lights]]
type = "directional"
direction = [0, -2, 0]
irradiance = [1, 2, 3]

[[lights]]
type = "environment"
radiance = 0.5
"#;

/// A scene with one material, followed by this text.
fn with_white(rest: &str) -> String {
    format!("[materials.w]\ntype = \"lambert\"\nreflectance = 0.5\n{rest}")
}

#[test]
fn a_disc_of_the_sky_is_a_sun() {
    let light = |diameter: &str| {
        let text =
            format!("[[lights]]\ntype = \"directional\"\ndirection = [0, -2, 0]\nirradiance = 3\n{diameter}");
        let ball = "[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"w\"\n";
        parse(&with_white(&format!("{ball}{text}"))).unwrap().lights[0].value.clone()
    };
    for parallel in ["", "angular-diameter = 0"] {
        assert!(matches!(light(parallel), LightDescription::Directional { .. }), "{parallel}");
    }
    let LightDescription::Sun { direction, irradiance, radius } = light("angular-diameter = 0.5") else {
        panic!("no sun")
    };
    assert_eq!((direction, irradiance), (DVec3::new(0.0, -2.0, 0.0), DVec3::splat(3.0)));
    assert!((radius - 0.25f64.to_radians()).abs() < 1e-12);
}

#[test]
fn one_instance_stands_for_many() {
    let ball = "[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"w\"\ngroup = \"g\"\n[[instances]]\ngroup = \"g\"\n";
    let text = with_white(&format!(
        "{ball}name = \"row\"\ntransform = [{{ translate = [1, 0, 0] }}]\nrepeat = {{ count = [3, 1, 2], step = [10, 5, -1] }}"
    ));
    let scene = parse(&text).unwrap();
    let places: Vec<_> = scene.instances.iter().map(|i| i.value.transform.translation.to_array()).collect();
    let row = |z: f64| [1.0, 11.0, 21.0].map(|x| [x, 0.0, z]);
    assert_eq!(places, [row(0.0), row(-1.0)].concat());
    assert_eq!(scene.instances[0].name, "row");
    assert_eq!(scene.instances[5].name, "row #6");
    for bad in [
        "{ count = [0, 1, 1], step = [1, 1, 1] }",
        "{ count = [2, 1], step = [1, 1, 1] }",
        "{ count = [1000, 1000, 1000], step = [1, 1, 1] }",
        "{ count = [2, 1, 1] }",
    ] {
        assert!(parse(&with_white(&format!("{ball}repeat = {bad}"))).is_err(), "{bad}");
    }
}

#[test]
fn lathes_and_teapots() {
    let shape = |rest: &str| with_white(&format!("[[shapes]]\nmaterial = \"w\"\n{rest}"));
    let good = [
        "type = \"lathe\"\nprofile = [[1, 0], [1, 2]]",
        "type = \"lathe\"\nprofile = [[0, 0], [1, 2], [1, 2], [0, 3]]\ncurve = \"smooth\"\nsteps = 2\nsegments = 5",
        "type = \"teapot\"\ndivisions = 3",
    ];
    for text in good {
        parse(&shape(text)).unwrap();
    }
    let bad = [
        "type = \"lathe\"",
        "type = \"lathe\"\nprofile = [[1, 0]]",
        "type = \"lathe\"\nprofile = [[-1, 0], [1, 2]]",
        "type = \"lathe\"\nprofile = [[0, 0], [0, 2]]",
        "type = \"lathe\"\nprofile = [[1, 0], [1, 0]]",
        "type = \"lathe\"\nprofile = [[1, 0, 0], [1, 2, 0]]",
        "type = \"lathe\"\nprofile = [[1, 0], [1, 2]]\nsegments = 2",
        "type = \"teapot\"\ndivisions = 10000",
    ];
    for text in bad {
        assert!(parse(&shape(text)).is_err(), "{text}");
    }
}

/// Cameras of all types, and what is refused about each.
#[test]
fn cameras() {
    let view = |text: &str| {
        parse(&format!("unit = \"cm\"\n[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\n{text}\n{WHITE}{BALL}"))
            .map(|scene| scene.camera.unwrap())
    };
    let projection = |text: &str| view(text).unwrap().projection;
    let parallel = |extent, axis| ProjectionDescription::Orthographic { extent, axis };
    assert_eq!(projection("type = \"orthographic\"\nheight = 3"), parallel(0.03, FovAxis::Vertical));
    assert_eq!(projection("type = \"orthographic\"\nwidth = 4"), parallel(0.04, FovAxis::Horizontal));
    assert_eq!(projection("type = \"panorama\""), ProjectionDescription::Panorama);
    assert_eq!(projection("type = \"fisheye\""), ProjectionDescription::Fisheye { angle: 180.0 });
    assert_eq!(projection("type = \"fisheye\"\nfov = 220"), ProjectionDescription::Fisheye { angle: 220.0 });
    let lens = view("sensor = [36, 24]\nfocal-length = 50\nf-number = 2").unwrap();
    let (fov, axis) = lens.perspective().unwrap();
    assert!((fov - 39.597_752).abs() < 1e-5 && axis == FovAxis::Sensor { aspect: 1.5 }, "{fov}");
    assert_eq!(lens.lens.unwrap(), LensDescription { radius: 0.0125, focus: 0.05 });
    let plain = view("focal-length = 5\nf-number = 2").unwrap();
    assert_eq!(plain.perspective().unwrap(), (40.0, FovAxis::Vertical));
    assert_eq!(plain.lens.unwrap().radius, 0.0125);
    for (text, told) in [
        ("type = \"fish\"", "one of \"perspective\", \"orthographic\", \"panorama\", \"fisheye\""),
        ("type = \"orthographic\"", "either `width` or `height`"),
        ("type = \"orthographic\"\nwidth = 1\nheight = 1", "either `width` or `height`"),
        ("type = \"orthographic\"\nwidth = 1\nfov = 30", "unknown key `fov`"),
        ("type = \"panorama\"\nlens-radius = 1", "unknown key `lens-radius`"),
        ("type = \"fisheye\"\nfov = 361", "at most 360"),
        ("sensor = [36, 24]", "no `focal-length`"),
        ("focal-length = 35", "it would change nothing"),
        ("sensor = [36, 24]\nfocal-length = 50\nfov = 30", "both `fov`"),
        ("sensor = 36\nfocal-length = 50", "a list of 2 numbers"),
        ("sensor = [36, -24]\nfocal-length = 50", "a length above zero"),
        ("sensor = [1e9, 24]\nfocal-length = 1e-9", "field of view of 180"),
    ] {
        let error = view(text).unwrap_err().to_string();
        assert!(error.contains(told), "{text}: {error}");
    }
}

#[test]
fn a_file_that_says_everything() {
    let scene = parse(GOOD).unwrap();
    assert_eq!(scene.name, "everything");
    assert_eq!(scene.warnings, []);
    let camera = scene.camera.unwrap();
    assert_eq!((camera.eye, camera.up), (DVec3::new(0.0, 0.001, 0.005), DVec3::NEG_Z));
    assert_eq!(camera.perspective().unwrap(), (40.5, FovAxis::Horizontal));
    assert_eq!((scene.film.width, scene.film.height, scene.film.exposure), (256, 128, Some(-1.5)));
    assert_eq!(scene.film.filter, FilterDescription::Gaussian { radius: 1.5, sigma: 0.6 });
    assert_eq!((scene.render.quality, scene.render.seed), (Some(Quality::Draft), Some(u64::MAX)));
    assert_eq!((scene.render.global_photons, scene.render.spp), (Some(1_000_000), None));
    assert_eq!(scene.render.kernel, Some(Kernel::Cone { k: 1.25 }));
    let media: Vec<_> = scene.media.iter().map(|medium| (medium.name.as_str(), medium.value.ior)).collect();
    assert_eq!(media, [("air", 1.0), ("water", 1.33), ("inside of glass", 1.5)]);
    assert!((scene.media[1].value.absorption - DVec3::new(100.0, 20.0, 10.0)).length() < 1e-12);
    let materials: Vec<_> = scene.materials.iter().map(|material| material.name.as_str()).collect();
    assert_eq!(materials, ["white", "metal", "glass", "pool", "black (implied)"]);
    assert!(matches!(scene.materials[0].value, MaterialDescription::Lambert { two_sided: false, .. }));
    assert!(matches!(
        scene.materials[2].value,
        MaterialDescription::Dielectric { inside: 2, outside: 0, .. }
    ));
    assert!(matches!(
        scene.materials[3].value,
        MaterialDescription::Dielectric { inside: 1, outside: 0, .. }
    ));
    assert_eq!(scene.groups.len(), 1);
    assert_eq!((scene.shapes.len(), scene.lights.len(), scene.instances.len()), (5, 3, 1));
    assert_eq!(scene.shapes[1].location.to_string(), "scenes/s.toml:53:1");
    assert_eq!(scene.shapes[1].name, "shape 2");
    assert_eq!((scene.shapes[1].value.group, scene.shapes[1].value.material), (Some(0), 4));
    assert!(scene.shapes[2].value.flip_normal);
    // Scaled by 2, x rotated to -z, translated, all in millimetres.
    let ball = scene.shapes[0].value.transform;
    assert_eq!(ball.transform_vector3(DVec3::X), DVec3::new(0.0, 0.0, -0.002));
    assert_eq!(ball.translation, DVec3::new(0.001, 0.002, 0.003));
    assert_eq!(scene.instances[0].value.transform.translation, DVec3::new(1.0, 0.0, 0.0));
    assert_eq!(scene.instances[0].value.transform.matrix3, glam::DMat3::IDENTITY);
    let LightDescription::Point { position, intensity } = scene.lights[0].value else { panic!() };
    assert_eq!(position, DVec3::new(0.0, 3.0, 0.0));
    assert!((intensity.x * 4.0 * std::f64::consts::PI - 100.0).abs() < 1e-12);
}

#[test]
fn shares_of_photons() {
    let text = format!(
        "[camera]\neye = [0.1, 0.7, 3.3]\nat = [0, 0, 0.3]\n{WHITE}{BALL}caustic-photons = 3.0\n\
         emission = {{ radiance = 1.0, photons = 0.5 }}\n\
         [[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\npower = 1.0\nphotons = 2.0\n"
    );
    let scene = parse(&text).unwrap();
    let ball = &scene.shapes[0].value;
    assert_eq!((ball.caustic_photons, ball.emission.unwrap().photons), (3.0, 0.5));
    assert_eq!(scene.light_photons, [2.0]);
    for (from, to) in
        [("photons = 2.0", "photons = 0.0"), ("photons = 0.5", "photons = -1"), ("= 3.0", "= 1e7")]
    {
        let refused = parse(&text.replace(from, to)).unwrap_err().to_string();
        assert!(refused.contains("a number from 1e-6 to 1e6"), "{refused}");
    }
}

#[test]
fn a_unit_that_is_a_power_of_two_keeps_every_bit() {
    let text = |unit: f64| {
        format!(
            "unit = {unit}\n[camera]\neye = [0.1, 0.7, 3.3]\nat = [0, 0, 0.3]\n{WHITE}{BALL}\
             transform = [{{ rotate = 17, axis = [1, 2, 3] }}, {{ translate = [0.1, 0.2, 0.3] }}]\n"
        )
    };
    let one = parse(&text(1.0)).unwrap();
    for unit in [2f64.powi(-40), 0.125, 1024.0] {
        let other = parse(&text(unit)).unwrap();
        assert_eq!(one.camera.as_ref().unwrap().eye * unit, other.camera.as_ref().unwrap().eye);
        let (a, b) = (one.shapes[0].value.transform, other.shapes[0].value.transform);
        assert_eq!(a.translation * unit, b.translation);
        assert_eq!(a.matrix3 * unit, b.matrix3);
    }
}

#[test]
fn glossy_materials() {
    use crate::bsdf::{Bsdf, Form, Ward};
    use crate::scene::Tangent;
    let material = |text: &str| {
        parse(&format!("[materials.m]\n{text}\n{WHITE}{BALL}")).map(|scene| scene.materials[0].value.clone())
    };
    let ward = material(
        "type = \"ward\"\ndiffuse = 0.25\nspecular = [0.5, 0.25, 0.125]\nroughness = [0.25, 0.5]\ntangent-around = [0, 3, 0]",
    );
    let Ok(MaterialDescription::Glossy { bsdf, two_sided: true, tangent }) = ward else { panic!("{ward:?}") };
    let (diffuse, gloss) = (Rgb::splat(0.25), Rgb::new(0.5, 0.25, 0.125));
    assert_eq!(bsdf, Bsdf::Ward(Ward::new(diffuse, gloss, [0.25, 0.5], Form::Bounded)));
    assert_eq!(tangent, Some(Tangent::Around(glam::Vec3::Y)));
    for good in [
        "type = \"schlick\"\ncolour = 0.5\nroughness = 0",
        "type = \"schlick\"\ncolour = 0.5\nroughness = 0.1\nisotropy = 0.1\nform = \"printed\"\ntangent = [1, 0, 0]",
        "type = \"conductor\"\nmetal = \"gold\"",
        "type = \"conductor\"\neta = [0.2, 0.9, 1.1]\nk = 3\nroughness = 0.1\ntwo-sided = false",
        "type = \"conductor\"\ncolour = 0.9\nroughness = [0.1, 0.1]",
        "type = \"dielectric\"\nior = 1.5\nroughness = 0.2",
    ] {
        assert!(material(good).is_ok(), "{good}");
    }
    for (bad, says) in [
        ("type = \"schlick\"\ncolour = 0.5", "roughness"),
        ("type = \"schlick\"\ncolour = 0.5\nroughness = 0.1\nisotropy = 0.1", "tangent-around"),
        ("type = \"ward\"\ndiffuse = 0.6\nspecular = 0.5\nroughness = 0.1", "at most 1"),
        ("type = \"ward\"\nspecular = 0.5\nroughness = 0", "mirror"),
        ("type = \"ward\"\nspecular = 0.5\nroughness = [0.1, 0.2, 0.3]\ntangent = [1, 0, 0]", "[0.3, 0.05]"),
        ("type = \"conductor\"\nroughness = 0.1", "metal = \"gold\""),
        ("type = \"conductor\"\nmetal = \"gold\"\ncolour = 0.5", "metal = \"gold\""),
        ("type = \"conductor\"\nmetal = \"god\"", "gold"),
        ("type = \"conductor\"\ncolour = 1\nroughness = [0.1, 0.2]\ntangent = [0, 0, 0]", "length"),
        ("type = \"conductor\"\ncolour = 1\ntangent = [0, 0, 1]\ntangent-around = [0, 0, 1]", "one of them"),
        ("type = \"dielectric\"\nior = 1.5\nroughness = 2", "from 0 to 1"),
    ] {
        let message = material(bad).unwrap_err().to_string();
        assert!(message.contains(says), "{bad}: {message}");
    }
}

/// For each wrong text: the place of the error, and words of the message.
#[test]
fn every_error_has_a_place_and_a_remedy() {
    let scene = |text: &str| format!("{text}{WHITE}{BALL}");
    let shape = |text: &str| format!("[[shapes]]\n{text}\nmaterial = \"white\"\n{WHITE}");
    let material = |text: &str| format!("[materials.m]\n{text}{WHITE}{BALL}");
    let camera = |text: &str| format!("[camera]\n{text}{WHITE}{BALL}");
    let cases: Vec<(String, &str, &[&str])> = vec![
        (scene("unti = \"mm\""), "1:1", &["unknown key `unti` in the scene file", "did you mean `unit`?"]),
        (scene("unit = \"yard\""), "1:8", &["`unit` is \"yard\"", "`unit = 0.001`"]),
        (scene("unit = -1"), "1:8", &["`unit` is -1: expected a number above 0"]),
        (scene("name = 3"), "1:8", &["`name` is 3: expected a string"]),
        (scene("lights = 1"), "1:10", &["expected a list of tables", "`[[lights]]`"]),
        (scene("a = 1\na = 2"), "2:1", &["duplicate key"]),
        (scene("a = "), "1:5", &["not TOML"]),
        (scene("camera = 1"), "1:10", &["expected a table", "`[camera]`"]),
        (camera("eye = [0, 1]\nat = [0, 0, 0]"), "2:7", &["expected a list of 3 numbers", "`eye = ["]),
        (camera("eye = [0, 0, 1]"), "1:1", &["[camera] has no `at`", "add it"]),
        (camera("eye = [0, 0, nan]\nat = [0, 0, 0]"), "2:14", &["contains nan", "finite", "in its place"]),
        (camera("eye = [0, 0, 1e999]\nat = [0, 0, 0]"), "2:14", &["contains 1e999", "finite"]),
        (camera("eye = [0, 0, 1]\nat = [0, 0, 1]"), "1:1", &["`eye` and `at` are the same", "move `at`"]),
        (camera("eye = [0, 5, 0]\nat = [0, 0, 0]"), "1:1", &["parallel to its view", "`up = ["]),
        (camera("eye = [0, 5, 0]\nat = [0, 0, 0]\nup = [0, 1, 0]"), "4:6", &["parallel to its view"]),
        (camera("eye = [0, 5, 1]\nat = [0, 0, 0]\nup = [0, 0, 0]"), "4:6", &["zero or parallel"]),
        (camera("eye = [0, 0, 1]\nat = [0, 0, 0]\nfov = 180"), "4:7", &["between 0 and 180", "`fov = 40.0`"]),
        (camera("eye = [0, 0, 1]\nat = [0, 0, 0]\nfov = 0"), "4:7", &["between 0 and 180"]),
        (scene("[film]\nwidth = 0"), "2:9", &["`width` is 0: expected a whole number from 1 to 65536"]),
        (scene("[film]\nwidth = 65537"), "2:9", &["from 1 to 65536"]),
        (scene("[film]\nwidth = 99999999999999999999999"), "2:9", &["from 1 to 65536"]),
        (scene("[film]\nwidth = 1e300"), "2:9", &["from 1 to 65536"]),
        (scene("[film]\nwidth = 10.5"), "2:9", &["a whole number"]),
        (scene("[film]\nwidth = 65536\nheight = 65536"), "1:1", &["65536 x 65536 pixels", "crop"]),
        (scene("[film]\nfilter = \"bax\""), "2:10", &["did you mean `box`?"]),
        (scene("[film]\nfilter = { type = \"box\", sigma = 1 }"), "2:26", &["unknown key `sigma`"]),
        (scene("[render]\nspp = 0"), "2:7", &["from 1 to"]),
        (scene("[render]\nglobal_photons = 1"), "2:1", &["did you mean `global-photons`?"]),
        (scene("[render]\nquality = \"finl\""), "2:11", &["did you mean `final`?"]),
        (scene("[render]\nseed = -1"), "2:8", &["a whole number from 0"]),
        (scene("[render]\ncone-k = 0.5"), "2:10", &["from 1 to 1000"]),
        (scene("[render]\nkernel = \"constant\"\ncone-k = 2"), "3:10", &["belongs to the cone", "leave"]),
        (scene("[render]\nspp = 16777217"), "2:7", &["from 1 to 16777216", "write for example `spp = 1`"]),
        (scene("[render]\ncaustic-reuse = 2"), "2:17", &["a share from 0 to 1", "write for example"]),
        (
            scene("[render]\nphotons-memory = 1e9"),
            "2:18",
            &["`photons-memory` is no setting of scene files", "--photons-memory"],
        ),
        (scene("[media.air]\nior = 2"), "1:8", &["`air` cannot be defined anew", "another name"]),
        (
            scene("[media.x]\nvisibility = 5\nabsorption = 1"),
            "1:1",
            &["gives absorption twice", "leave out `absorption`"],
        ),
        (
            scene("[media.x]\nscattering = 1\npreset = \"fog\""),
            "1:1",
            &["in two ways how it scatters", "keep one"],
        ),
        (scene("[media.x]\nior = 1\ng = 0.5"), "1:1", &["does not scatter", "preset"]),
        (scene("[media.x]\nalbedo = 0.5"), "1:1", &["only one of `albedo` and `mean-free-path`"]),
        (scene("[media.x]\nscattering = 1\ng = 1"), "3:5", &["between -1 and 1"]),
        (scene("[media.x]\npreset = \"frog\""), "2:10", &["fog"]),
        (scene("[media.x]\nscattering = 1\ndensity = -1"), "3:11", &["from 0 to 1e12"]),
        (scene("[media.x]\nscattering = 1\ndensity = {}"), "3:11", &["`density` has no `type`", "height"]),
        (scene("[media.x]\ndensity = { type = \"height\", scale-height = 1 }"), "1:1", &["does not scatter"]),
        (
            scene(
                "[media.x]\nscattering = 1\ndensity = { type = \"height\", scale-height = 1, up = [0, 0, 0] }",
            ),
            "3:11",
            &["upward direction", "`up`"],
        ),
        (
            scene(
                "[media.x]\nscattering = 1\n[media.x.density]\ntype = \"noise\"\nmin = [0, 0, 0]\nmax = [1, 1, 0]\nsize = 1",
            ),
            "3:1",
            &["below its `max`"],
        ),
        (
            scene(
                "[media.x]\nscattering = 1\n[media.x.density]\ntype = \"noise\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nsize = 1\nlow = 2",
            ),
            "3:1",
            &["must be larger", "`low`"],
        ),
        (
            scene("[media.x]\nscattering = 1\ndensity = { type = \"vdb\", file = \"none.vdb\" }"),
            "3:34",
            &["there is no file", "none.vdb", "relative"],
        ),
        (
            scene(
                "[media.x]\nabsorption = 1\ndensity = { type = \"vdb\", file = \"../Cargo.toml\", glow = 2 }",
            ),
            "3:11",
            &["not at which temperature", "`glow` out"],
        ),
        (
            scene(
                "[media.x]\nscattering = 1\ndensity = { type = \"vdb\", file = \"../Cargo.toml\", temperature = \"t\" }",
            ),
            "1:1",
            &["only what absorbs glows", "`absorption = 1.0`"],
        ),
        (
            scene("[media.x]\nscattering = 1\nfills = \"bounds\""),
            "1:1",
            &["ends nowhere", "`fills = \"scene\"`"],
        ),
        (
            scene("[media.x]\nior = 1.3\nscattering = 1\nfills = \"scene\""),
            "1:1",
            &["`ior = 1.3` would make its border a surface", "`ior = 1.0`"],
        ),
        (
            scene("[media.x]\nscattering = 1\ngrow = 2"),
            "1:1",
            &["does not fill the scene", "leave `grow` out"],
        ),
        (
            scene(
                "[media.x]\nscattering = 1\nfills = \"scene\"\n[media.y]\nscattering = 1\nfills = \"scene\"",
            ),
            "4:8",
            &["`x` fills the scene already", "a body"],
        ),
        (scene("[render]\nkernel = \"foo\"\ncone-k = 2"), "2:10", &["cone"]),
        (scene("[media.x]\nior = 0.9"), "2:7", &["from 1 to 100"]),
        (scene("[media.x]\nabsorption = 1"), "1:1", &["[media.x] has no `ior`"]),
        (scene("[media.x]\nior = 1\nabsorption = -1"), "3:14", &["at least 0"]),
        (scene("[media.x]\nior = 1\npriority = 0.5"), "3:12", &["a whole number from -1000 to 1000"]),
        (material("type = \"miror\""), "2:8", &["did you mean `mirror`?"]),
        (material("reflectance = 1"), "1:1", &["[materials.m] has no `type`"]),
        (material("type = \"lambert\""), "1:1", &["has no `reflectance`"]),
        (
            material("type = \"lambert\"\nreflectance = [0.5, 1.2, 0]"),
            "3:21",
            &["`reflectance` contains 1.2", "0 to 1"],
        ),
        (material("type = \"mirror\"\nreflectance = -0.1"), "3:15", &["0 to 1"]),
        (material("type = \"mirror\"\nreflectance = true"), "3:15", &["[red, green, blue]"]),
        (material("type = \"dielectric\""), "1:1", &["does not say what is inside", "`ior = 1.5`"]),
        (
            material("type = \"dielectric\"\ninside = \"vater\""),
            "3:10",
            &["no medium is named `vater`", "`air`"],
        ),
        (material("type = \"dielectric\"\ninside = \"air\"\nior = 1.5"), "4:7", &["both `inside` and `ior`"]),
        (
            material("type = \"dielectric\"\nior = 1.5\ncolour = 1"),
            "4:1",
            &["unknown key `colour`", "`absorption`"],
        ),
        (shape("radius = 1"), "1:1", &["has no `type`", "`type = \"sphere\"`"]),
        (shape("type = \"spere\""), "2:8", &["did you mean `sphere`?"]),
        (shape("type = \"sphere\"\nradius = 0"), "3:10", &["a number above 0"]),
        (
            shape("type = \"sphere\"\nradius = \"one\""),
            "3:10",
            &["`radius` is \"one\": expected a number above 0"],
        ),
        (shape("type = \"sphere\"\nradius = 1\nnormal = [0, 1, 0]"), "4:1", &["unknown key `normal`"]),
        (
            shape(
                "type = \"sphere\"\nradius = 1\nemission.radiance = 1\ntransform = [{ scale = [1, 2, 1] }]",
            ),
            "1:1",
            &["emits and is scaled unequally", "same `scale`"],
        ),
        (
            shape("type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [1, 0, 0]\nedge-v = [2, 0, 0]"),
            "1:1",
            &["no area"],
        ),
        (shape("type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [1, 0, 0]"), "1:1", &["has no `edge-v`"]),
        (shape("type = \"cylinder\"\nbase = [0, 1, 0]\ntop = [0, 1, 0]\nradius = 1"), "1:1", &["no height"]),
        (shape("type = \"disc\"\nradius = 1\nnormal = [0, 0, 0]"), "4:10", &["expected a direction"]),
        (shape("type = \"mesh\""), "1:1", &["without `file` and without `vertices`", "add `file"]),
        (
            shape("type = \"mesh\"\nfile = \"no/such.ply\""),
            "3:8",
            &["no mesh file scenes/no/such.ply", "relative"],
        ),
        (shape("type = \"mesh\"\nfile = \"\""), "3:8", &["the path of a file"]),
        (shape("type = \"mesh\"\nfile = \"${mesh}\""), "3:8", &["no parameter `mesh`", "[parameters]"]),
        (shape("type = \"mesh\"\nfile = \"${mesh\""), "3:8", &["without its `}`"]),
        (shape("type = \"mesh\"\nvertices = [[0, 0, 0]]\nfaces = []"), "3:12", &["at least 3 points"]),
        (
            shape("type = \"mesh\"\nvertices = [[0,0,0], [1,0,0], [0,1,0]]\nfaces = [[0, 1, 3]]"),
            "4:17",
            &["`faces` contains 3: expected a whole number from 0 to 2"],
        ),
        (
            shape("type = \"mesh\"\nvertices = [[0,0,0], [1,0,0], [0,1,0]]\nfaces = [[0, 1]]"),
            "4:10",
            &["at least 3 corners"],
        ),
        (
            shape("type = \"mesh\"\nvertices = [[0,0,0], [1,0,0], [0,1,0]]\nfaces = [[0, 1, 1]]"),
            "4:10",
            &["a face with an area"],
        ),
        (
            shape("type = \"mesh\"\nvertices = [[0,0,0], [1,0,0], [0,1,0]]\nfaces = [[0, 1, 2]]\nfit = {}"),
            "5:1",
            &["unknown key `fit`"],
        ),
        (shape("type = \"sphere\"\nradius = 1\nemission = 5"), "4:12", &["emission = { radiance ="]),
        (shape("type = \"sphere\"\nradius = 1\nemission = { radiance = -1 }"), "4:25", &["at least 0"]),
        (
            shape("type = \"sphere\"\nradius = 1\ntransform = { scale = 1 }"),
            "4:13",
            &["expected a list of steps"],
        ),
        (shape("type = \"sphere\"\nradius = 1\ntransform = [{ scale = 0 }]"), "4:24", &["other than 0"]),
        (shape("type = \"sphere\"\nradius = 1\ntransform = [{ rotate = 9 }]"), "4:14", &["has no `axis`"]),
        (shape("type = \"sphere\"\nradius = 1\ntransform = [{}]"), "4:14", &["exactly one thing"]),
        (
            shape("type = \"sphere\"\nradius = 1\ntransform = [{ matrix = [[1, 0, 0, 0], [0, 1, 0, 0]] }]"),
            "4:25",
            &["three rows of four numbers"],
        ),
        (
            shape(
                "type = \"quad\"\ncorner = [0,0,0]\nedge-u = [1,0,0]\nedge-v = [0,1,0]\n\
                   transform = [{ matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]] }]",
            ),
            "6:13",
            &["a transform that can be undone", "check scales"],
        ),
        (BALL.to_string(), "5:12", &["no material is named `white`", "there are none"]),
        (format!("[[shapes]]\ntype = \"sphere\"\nradius = 1\n{WHITE}"), "1:1", &["has no `material`"]),
        (scene("[[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\n"), "1:1", &["how bright", "`power"]),
        (
            scene("[[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\npower = 1\nintensity = 1"),
            "4:9",
            &["both `intensity` and `power`"],
        ),
        (scene("[[lights]]\ntype = \"lamp\""), "2:8", &["expected one of \"point\""]),
        (
            scene("[[lights]]\ntype = \"directional\"\ndirection = [0, 0, 0]\nirradiance = 1"),
            "3:13",
            &["a direction"],
        ),
        (
            scene(
                "[[lights]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1\nangular-diameter = 1e-9",
            ),
            "5:20",
            &["an angle from 0.001 to 180 degrees"],
        ),
        (
            scene(
                "[[lights]]\ntype = \"environment\"\nradiance = 1\n[[lights]]\ntype = \"environment\"\nradiance = 1",
            ),
            "4:1",
            &["a second environment: the first is at scenes/s.toml:1:1"],
        ),
        (scene("[[instances]]\ngroup = \"g\""), "2:9", &["no group is named `g`"]),
        (
            scene(
                "[[lights]]\nname = \"a\"\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1\n\
                   [[lights]]\nname = \"a\"\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1",
            ),
            "7:8",
            &["the name `a` is taken: first at scenes/s.toml:2:8", "its own name"],
        ),
        (scene("[parameters]\na = [1]"), "2:5", &["`a` is [1]: expected a string, a number"]),
        (scene("[parameters.a]\ndefalt = 1"), "2:1", &["unknown key `defalt`", "did you mean `default`?"]),
        (
            "[parameters.mesh]\nhelp = \"a PLY file\"\n[[shapes]]\ntype = \"mesh\"\nfile = \"${mesh}\"\n"
                .to_string(),
            "5:8",
            &["the parameter `mesh` (a PLY file) has no default and is not set", "`--set mesh=FILE`"],
        ),
    ];
    let mut wrong = String::new();
    for (text, place, parts) in &cases {
        let all = diagnostics(text, &[]);
        let message =
            all.iter().map(ToString::to_string).find(|m| m.starts_with(&format!("{FILE}:{place}: ")));
        let is_right = message.is_some_and(|message| {
            let has_remedy = message.contains("help: ") || message.contains("not TOML");
            has_remedy && parts.iter().all(|part| message.contains(part))
        });
        if !is_right {
            wrong += &format!("\n{text}\nexpected at {place}: {parts:?}, and found:\n");
            all.iter().for_each(|diagnostic| wrong += &format!("{diagnostic}\n"));
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn all_errors_are_found_at_once_and_in_order() {
    let text = format!("[camera]\neye = 1\nat = 2\nup = 3\n[film]\nwidth = -1\n{WHITE}{BALL}radiu = 5\n");
    let lines: Vec<_> = diagnostics(&text, &[]).iter().map(|diagnostic| diagnostic.location.line).collect();
    assert_eq!(lines, [2, 3, 4, 6, 16]);
    let many = (0..50).map(|number| format!("key{number} = 1\n")).collect::<String>();
    let message = parse(&format!("{many}{WHITE}{BALL}")).unwrap_err().to_string();
    assert!(
        message.ends_with("... and 30 more") && message.matches("unknown key").count() == 20,
        "{message}"
    );
}

#[test]
fn the_source_line_is_shown() {
    let message = parse(&format!("[film]\nwidht = 3\n{WHITE}{BALL}")).unwrap_err().to_string();
    assert!(message.contains("\n  2 | widht = 3\n    | ^^^^^\n  help: did you mean `width`?"), "{message}");
}

#[test]
fn files_without_a_scene() {
    for text in ["", "\n\n", "# nothing yet\n", "\u{feff}"] {
        let message = parse(text).unwrap_err().to_string();
        assert!(message.starts_with("scenes/s.toml: the scene file is empty\n  help: "), "{message}");
    }
    let message = parse(WHITE).unwrap_err().to_string();
    assert!(message.contains("scenes/s.toml: the scene has no shapes\n  help: add"), "{message}");
}

#[test]
fn parameters_from_the_command_line() {
    let text =
        format!("[parameters]\nradius = 1\nwidth = \"10\"\n[film]\nwidth = \"${{width}}\"\n{WHITE}{BALL}")
            .replace("radius = 1\nmaterial", "radius = \"${radius}\"\nmaterial");
    let scene = parse_scene(&text, Path::new(FILE), &[set("radius", "7"), set("radius", "2.5")]).unwrap();
    assert!(matches!(scene.shapes[0].value.geometry, GeometryDescription::Sphere { radius: 2.5, .. }));
    assert_eq!(scene.film.width, 10);

    let message = diagnostics(&text, &[set("raduis", "1")])[0].to_string();
    assert!(message.starts_with("scenes/s.toml: `--set raduis=1`: no parameter `raduis`"), "{message}");
    assert!(message.contains("did you mean `--set radius=1`?"), "{message}");
    let message = diagnostics(&text, &[set("radius", "-1")])[0].to_string();
    assert!(
        message.contains("`radius` is `-1` (the parameter `radius`): expected a number above 0"),
        "{message}"
    );
    let message = diagnostics(&format!("{WHITE}{BALL}"), &[set("a", "1")])[0].to_string();
    assert!(message.contains("leave `--set` out"), "{message}");

    let unused = parse(&format!("[parameters]\na = 1\n{WHITE}{BALL}")).unwrap();
    assert_eq!(unused.warnings.len(), 1);
    assert_eq!(
        unused.warnings[0].to_string(),
        "scenes/s.toml:2:1: the parameter `a` is never used as `${a}`"
    );
}

#[test]
fn paths_are_relative_to_the_file_or_to_the_current_directory() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("a $ b.ply");
    std::fs::write(&mesh, "").unwrap();
    let text = |file: &str| {
        format!(
            "[parameters]\nmesh = \"none.ply\"\nx = \"b\"\n[[shapes]]\ntype = \"mesh\"\nfile = \"{file}\"\nmaterial = \"white\"\n{WHITE}"
        )
    };
    let path_of = |text: &str, parameters: &[(String, String)]| {
        let scene = parse_scene(text, &folder.path().join("s.toml"), parameters)?;
        match &scene.shapes[0].value.geometry {
            GeometryDescription::MeshFile { path, .. } => Ok::<_, SceneFileError>(path.clone()),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(path_of(&text("a $$ b.ply"), &[]).unwrap(), mesh);
    assert_eq!(path_of(&text("a $ ${x}.ply"), &[]).unwrap(), mesh);
    let given = mesh.to_str().unwrap();
    assert_eq!(path_of(&text("${mesh}"), &[set("mesh", given)]).unwrap(), mesh);
    // Tests run in the folder of the package.
    let knot = "scenes/meshes/knot.ply";
    assert_eq!(path_of(&text("${mesh}"), &[set("mesh", knot)]).unwrap(), Path::new(knot));
    let message = path_of(&text("${mesh}"), &[]).unwrap_err().to_string();
    assert!(message.contains(":6:8: there is no mesh file") && message.contains("none.ply"), "{message}");
    assert!(message.contains("name another with `--set mesh=FILE`"), "{message}");
    let message = path_of(&text("."), &[]).unwrap_err().to_string();
    assert!(message.contains("is a folder"), "{message}");
    let message = path_of(&text("${mesh}"), &[set("mesh", "Cargo.toml")]).unwrap_err().to_string();
    assert!(
        message.contains("Cargo.toml is no mesh by its name") && message.contains("convert"),
        "{message}"
    );
}

#[test]
fn files_that_are_no_scene_files() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| load_scene(path, &[]).unwrap_err().to_string();
    let path = folder.path().join("s.toml");
    assert!(message(&path).contains("s.toml: cannot be read: ") && message(&path).contains("check the name"));
    assert!(message(folder.path()).contains("is a folder and not a regular file; name a scene file"));
    std::fs::write(&path, b"name = \"x\"\n# \xff\n").unwrap();
    assert!(message(&path).contains("s.toml:2:3: not UTF-8 text (byte 0xff); "), "{}", message(&path));
    std::fs::write(&path, vec![b'#'; MAX_TEXT_BYTES as usize + 1]).unwrap();
    assert!(message(&path).contains("8388609 bytes of scene text") && message(&path).contains("PLY"));
    std::fs::write(&path, "").unwrap();
    assert!(message(&path).contains("the scene file is empty"));
}

#[test]
fn deep_nesting_is_refused() {
    let deep = 100_000;
    for text in [
        format!("x = {}", "[".repeat(deep)),
        format!("x = {}{}", "[".repeat(deep), "]".repeat(deep)),
        format!("x = {}1{}", "{a=".repeat(deep), "}".repeat(deep)),
        format!("{} = 1", vec!["a"; deep].join(".")),
        format!("[{}]", vec!["a"; deep].join(".")),
    ] {
        let message = parse(&text).unwrap_err().to_string();
        assert!(message.contains("recur") && message.len() < 10_000, "{message}");
    }
}

/// Texts of a megabyte that would take hours if any step were repeated for each error, name or line.
#[test]
fn hostile_texts_take_no_time() {
    let many = |piece: &dyn Fn(usize) -> String, count: usize| (0..count).map(piece).collect::<String>();
    let one_line = format!("vertices = [{}]", "\"\",".repeat(300_000));
    let inline = many(&|i| format!("\"ö{i}\" = {{ type = \"mirror\" }}, "), 30_000);
    let long_name = "a".repeat(500_000);
    let texts = [
        format!("[[shapes]]\ntype = \"mesh\"\nfaces = []\n{one_line}"),
        format!("materials = {{ {inline} }}\n[[shapes]]\ntype = \"disc\"\nradius = 0\nmaterial = \"x\""),
        format!(
            "{}{}",
            many(&|i| format!("[media.m{i}]\nior = 1\n"), 20_000),
            many(&|i| format!("[materials.m{i}]\ntype = \"dielectric\"\ninside = \"n{i}\"\n"), 10_000)
        ),
        many(&|i| format!("key{i} = 1\n"), 80_000),
        many(&|i| format!("key{i} = \n"), 80_000),
        format!(
            "[materials.{long_name}]\ntype = \"mirror\"\n[[shapes]]\ntype = \"{long_name}b\"\nmaterial = \"{long_name}b\""
        ),
        format!("name = \"{}\"\n[parameters]\na = \"{long_name}\"", "${a}".repeat(100_000)),
    ];
    for text in &texts {
        let start = std::time::Instant::now();
        let message = parse(text).unwrap_err().to_string();
        assert!(message.len() < 100_000, "{}", message.len());
        // The limit holds for an unoptimized build on a busy machine.
        assert!(start.elapsed().as_secs() < 20, "{:?} for {}", start.elapsed(), &text[..60]);
    }
}

#[test]
fn groups_that_nobody_places_are_warned_about() {
    let scene = parse(&format!("{WHITE}{BALL}group = \"g\"\n")).unwrap();
    let expected =
        "scenes/s.toml:10:9: the group `g` is placed by no `[[instances]]`, so it is not in the picture";
    assert_eq!(scene.warnings[0].to_string(), expected);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// A valid file with random changes is either read or refused, and nothing else happens.
    #[test]
    fn damaged_text_never_panics(
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0usize..12, "[ -~\\n]{0,3}"), 1..6),
    ) {
        let mut text: Vec<char> = GOOD.chars().collect();
        for (at, length, insert) in edits {
            let start = at.index(text.len());
            let end = (start + length).min(text.len());
            text.splice(start..end, insert.chars());
        }
        let text: String = text.into_iter().collect();
        if let Err(error) = parse(&text) {
            prop_assert!(error.to_string().starts_with(FILE));
        }
    }
}

/// The TOML blocks of a documentation page, with their first lines.
fn toml_blocks(page: &str) -> Vec<(usize, String)> {
    let mut blocks = Vec::new();
    let mut block: Option<(usize, String)> = None;
    for (number, line) in page.lines().enumerate() {
        match &mut block {
            None if line == "```toml" => block = Some((number + 2, String::new())),
            Some(_) if line == "```" => blocks.extend(block.take()),
            Some((_, text)) => text.extend([line, "\n"]),
            None => {}
        }
    }
    blocks
}

#[test]
fn examples_of_the_documentation_are_scenes() {
    for (page, least) in [("docs/scene-format.md", 9), ("docs/tutorial.md", 3)] {
        let path = checkout().join(page);
        let blocks = toml_blocks(&std::fs::read_to_string(&path).unwrap());
        assert!(blocks.len() >= least);
        for (line, block) in blocks {
            let white = if block.contains("[materials.white]") { "" } else { WHITE };
            let ball = if block.contains("[[shapes]]") { "" } else { BALL };
            let scene = parse_scene(&format!("{block}{white}{ball}"), &path, &[]);
            let scene = scene.unwrap_or_else(|error| panic!("{page}: block at line {line}: {error}"));
            assert_eq!(scene.warnings, [], "{page}: block at line {line}");
        }
    }
}

#[test]
fn shipped_scenes_are_read_without_a_warning() {
    let mut scenes = 0;
    for entry in std::fs::read_dir(checkout().join("scenes")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let scene = load_scene(&path, &[]).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(scene.warnings, []);
            assert_eq!(Some(scene.name.as_str()), path.file_stem().and_then(|stem| stem.to_str()));
            scenes += 1;
        }
    }
    assert!(scenes >= 4);
}

#[test]
fn the_shipped_mesh_is_sound() {
    let (mesh, report) =
        crate::scene_file::ply::read_ply(&checkout().join("scenes/meshes/knot.ply")).unwrap();
    assert_eq!(report, Default::default());
    assert_eq!(mesh.triangles.len(), 6144);
    // The normals are those of the tube, and close to those of the faces.
    for (given, smooth) in mesh.normals.as_ref().unwrap().iter().zip(mesh.smooth_normals()) {
        assert!(given.dot(smooth) > 0.98, "{given} {smooth}");
    }
    for material in ["clay", "metal", "glass"] {
        let parameters = [set("material", material), set("up", "z"), set("normals", "smooth")];
        load_scene(&checkout().join("scenes/mesh.toml"), &parameters).unwrap();
    }
}

/// The scenes with reference pictures have exactly the geometry that the pictures were made from, to the bit.
#[test]
fn reference_scenes_have_the_vertices_of_their_meshes() {
    let reference = checkout().ancestors().map(|folder| folder.join("shared/reference")).find(|f| f.is_dir());
    let Some(reference) = reference else {
        println!("skipped: no folder shared/reference beside the checkout");
        return;
    };
    for (name, meshes) in [("cornell-diffuse", 8), ("cornell-spheres", 6), ("cardioid", 1)] {
        let scene = load_scene(&checkout().join(format!("scenes/{name}.toml")), &[]).unwrap();
        let mut seen = 0;
        for shape in &scene.shapes {
            let (positions, triangles) = match &shape.value.geometry {
                GeometryDescription::Mesh { positions, triangles, .. } => {
                    (positions.clone(), triangles.clone())
                }
                &GeometryDescription::Quad { corner, edge_u, edge_v } => {
                    let corners = [corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v];
                    (corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]])
                }
                _ => continue,
            };
            let path = reference.join(name).join("meshes").join(&shape.name).with_extension("ply");
            let (mesh, _) = crate::scene_file::ply::read_ply(&path).unwrap();
            let expected: Vec<_> = (0..mesh.positions.len() as u32).map(|i| mesh.positions.get(i)).collect();
            assert_eq!((&positions, &triangles), (&expected, &mesh.triangles), "{name}: {}", shape.name);
            seen += 1;
        }
        assert_eq!(seen, meshes, "{name}");
    }
}
