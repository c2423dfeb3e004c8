//! Densities that vary, out of scene files: transmittance in closed form, single scattering, and furnaces.

use crate::support::*;
use cardioid::render::Overrides;
use cardioid::scene_file::{build_scene, parse_scene};
use openvdb_sys::{Dense, GridClass, is_compiled, write};
use std::path::{Path, PathBuf};

/// Paths of at most so many collisions and surfaces.
fn paths(spp: u32, max_depth: Option<u32>) -> Overrides {
    Overrides { spp: Some(spp), max_depth, ..path() }
}

/// What a camera at `eye` sees of a sky of radiance one at `at`, through a medium of which the text is given.
fn through(head: &str, medium: &str, [eye, at]: [[f64; 3]; 2]) -> String {
    format!(
        "{head}[camera]\neye = {eye:?}\nat = {at:?}\nup = [0.1, 0.2, 1]\nfov = 1e-4\n[media.m]\n{medium}\n[materials.border]\n\
         type = \"dielectric\"\ninside = \"m\"\n[[lights]]\ntype = \"environment\"\nradiance = 1.0\n"
    )
}

fn boxed(min: [f64; 3], max: [f64; 3]) -> String {
    format!("[[shapes]]\ntype = \"box\"\nmin = {min:?}\nmax = {max:?}\nmaterial = \"border\"\n")
}

/// Mean and standard error of a flat picture of 16 x 16 pixels.
fn shown(text: &str, overrides: &Overrides) -> (f64, f64) {
    let shot = Stage::new(text, (16, 16)).shoot(overrides);
    (shot.mean("beauty")[1], shot.standard_error("beauty")[1])
}

/// exp(-h/H) from the ground, vertically and at 60 degrees, to the sky and to one scale height; in other units, and far from the origin.
#[test]
fn an_exponential_atmosphere_lets_through_what_it_should() {
    let slant = 3f64.sqrt();
    for (unit, base) in [("1.0", 0.0), ("0.01", -3000.0), ("1e4", 7.0)] {
        let medium =
            format!("absorption = 1.0\ndensity = {{ type = \"height\", base = {base}, scale-height = 1 }}");
        for (height, over, want) in [
            (60.0, 0.0, 0.367_879_44),
            (1.0, 0.0, 0.531_463_61),
            (60.0, slant, 0.135_335_28),
            (1.0, slant, 0.282_453_56),
        ] {
            let text =
                through(&format!("unit = {unit}\n"), &medium, [[0.0, base, 0.0], [over, base + 1.0, 0.0]])
                    + &boxed([-200.0, base - 1.0, -200.0], [200.0, base + height, 200.0]);
            let (mean, _) = shown(&text, &paths(1, None));
            assert!((mean / want - 1.0).abs() < 2e-4, "{unit} {base} {height} {over}: {mean}, not {want}");
        }
    }
}

/// Noise that is one everywhere, faded from the middle of a ball to its border: density 1 - r, and extinction 3.
#[test]
fn a_ball_of_density_one_less_the_radius_lets_through_what_it_should() {
    for (offset, want) in [(0.0, 0.049_787_07), (0.5, 0.199_816_11)] {
        let medium = "absorption = 3.0\nfills = \"bounds\"\n[media.m.density]\ntype = \"noise\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\n\
                      size = 1\nfinest = 1\nlow = -4\nhigh = -3\nenvelope = \"ellipsoid\"\nfade = 1.0\n\
                      transform = [{ rotate = 30, axis = [1, 2, 3] }, { translate = [7, 8, 9] }]";
        let ends = [[7.0 + offset, 8.0, 12.0], [7.0 + offset, 8.0, 9.0]];
        let (mean, error) = shown(&through("", medium, ends), &paths(64, None));
        assert!(
            error < 0.005 * want && (mean - want).abs() < 4.5 * error,
            "{offset}: {mean} +- {error}, not {want}"
        );
    }
}

/// A file of 32^3 voxels of 0.1; none where there is no OpenVDB.
fn grid(
    folder: &Path,
    name: &str,
    class: GridClass,
    value: impl Fn(usize, usize, usize) -> f32,
) -> Option<PathBuf> {
    if !is_compiled() {
        return None;
    }
    let values: Vec<f32> = (0..32 * 32 * 32).map(|i| value(i >> 10, i >> 5 & 31, i & 31)).collect();
    let path = folder.join(format!("{name}.vdb"));
    let to_world = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0; 3]];
    let dense =
        Dense { name, origin: [0; 3], size: [32; 3], values: &values, to_world, class, is_half: false };
    write(&path, &dense).unwrap();
    Some(path)
}

/// A ramp from 1 to 2 over the centres of 32 voxels: an optical depth of 4.65, as it stands, and under a transform that keeps it.
#[test]
fn a_ramp_of_voxels_lets_through_what_it_should() {
    let folder = tempfile::tempdir().unwrap();
    let Some(file) = grid(folder.path(), "density", GridClass::FogVolume, |x, _, _| 1.0 + x as f32 / 31.0)
    else {
        return;
    };
    let medium = |loss: f64, more: &str| {
        format!("absorption = {loss}\n[media.m.density]\ntype = \"vdb\"\nfile = {file:?}\n{more}")
    };
    let want = 0.009_561_60;
    let (eye, at) = ([5.0, 1.55, 1.55], [0.0, 1.55, 1.55]);
    let text =
        through("unit = 3.0\n", &medium(1.0, ""), [eye, at]) + &boxed([0.0, 0.0, 0.0], [3.1, 3.1, 3.1]);
    let assert_shows = |text: &str, want: f64| {
        let (mean, error) = shown(text, &paths(256, None));
        assert!(error < 0.005 * want && (mean - want).abs() < 4.5 * error, "{mean} +- {error}, not {want}");
    };
    assert_shows(&text, want);
    // Twice as large and half as dense, along z, and lifted. Its box goes on to where the density has faded to zero, a voxel behind both ends.
    let placed = "transform = [{ scale = 2.0 }, { rotate = -90, axis = \"y\" }, { translate = [0, 10, 0] }]\nfactor = 0.5";
    let ends = [[-3.1, 13.1, 20.0], [-3.1, 13.1, 0.0]];
    let text = through("", &(medium(1.0, placed).replacen("\n", "\nfills = \"bounds\"\n", 1)), ends);
    assert_shows(&text, (-4.65f64 - 0.05 - 0.1).exp());
}

/// The density of each kind that is one on all of a box of 40, and what else its medium says.
fn even_densities(folder: &Path) -> Vec<String> {
    let mut all = vec![
        "[media.m.density]\ntype = \"height\"\nbase = 100\nscale-height = 1".to_owned(),
        "[media.m.density]\ntype = \"noise\"\nmin = [-20, -20, -20]\nmax = [20, 20, 20]\nsize = 10\nlow = -4\nhigh = -3".to_owned(),
    ];
    if let Some(file) = grid(folder, "density", GridClass::FogVolume, |_, _, _| 1.0) {
        all.push(format!(
            "[media.m.density]\ntype = \"vdb\"\nfile = {file:?}\ntransform = [{{ scale = 20 }}, {{ translate = [-31, -31, -31] }}]"
        ));
    }
    all
}

/// One scattering of the light of a point light of 1 W/sr beside a ray, as in a medium without a density.
#[test]
fn densities_of_one_scatter_as_none() {
    let folder = tempfile::tempdir().unwrap();
    for density in even_densities(folder.path()) {
        let medium = format!("scattering = 0.1\n{density}");
        let text = format!(
            "{}{}[materials.black]\ntype = \"lambert\"\nreflectance = 0\n[[shapes]]\ntype = \"disc\"\ncenter = [0, 0, -10]\n\
             normal = [0, 0, 1]\nradius = 5\nmaterial = \"black\"\n",
            through("", &medium, [[0.0; 3], [0.0, 0.0, -1.0]]).replace(
                "type = \"environment\"\nradiance = 1.0",
                "type = \"point\"\nposition = [0, 1, -5]\npower = 12.566370614"
            ),
            boxed([-20.0; 3], [20.0; 3])
        );
        let (mean, error) = shown(&text, &paths(256, Some(1)));
        let want = 0.011_375_223;
        assert!(error < 0.005 * want && (mean - want).abs() < 4.5 * error, "{density}: {mean} +- {error}");
    }
}

/// Light from straight above in an exponential atmosphere, seen from twenty scale heights above it: distances have to be sampled where
/// the air is. E/(4 pi) (1 - exp(-2))/2 for isotropic scattering once.
#[test]
fn an_atmosphere_is_sampled_where_it_is() {
    let medium = "scattering = 1.0\ndensity = { type = \"height\", scale-height = 1 }";
    let text = through("", medium, [[0.0, 20.0, 0.0], [0.0; 3]]).replace(
        "type = \"environment\"\nradiance = 1.0",
        "type = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1.0",
    );
    let ground = "[materials.black]\ntype = \"lambert\"\nreflectance = 0\n[[shapes]]\ntype = \"quad\"\ncorner = [-9, 0, 9]\n\
                  edge-u = [18, 0, 0]\nedge-v = [0, 0, -18]\nmaterial = \"black\"\n";
    let text = text + ground + &boxed([-50.0, -1.0, -50.0], [50.0, 60.0, 50.0]);
    let (mean, error) = shown(&text, &paths(64, Some(1)));
    let want = (1.0 - (-2f64).exp()) / 2.0 / (4.0 * std::f64::consts::PI);
    assert!(error < 0.005 * want && (mean - want).abs() < 4.5 * error, "{mean} +- {error}, not {want}");
}

/// Where nothing is absorbed the radiance of the surroundings is everywhere, whatever the density.
#[test]
fn furnaces_are_even_in_every_density() {
    let folder = tempfile::tempdir().unwrap();
    let noise = "min = [-1, -1, -1]\nmax = [1, 1, 1]\nsize = 1.0\nhigh = 0.5";
    let mut media = vec![
        "scattering = 3.0\nfills = \"scene\"\ndensity = { type = \"height\", base = -0.5, scale-height = 0.3 }".to_owned(),
        format!("scattering = [1, 3, 2]\ng = 0.5\nfills = \"bounds\"\n[media.m.density]\ntype = \"noise\"\n{noise}"),
        format!(
            "scattering = 5.0\nfills = \"bounds\"\n[media.m.density]\ntype = \"turbulence\"\nenvelope = \"ellipsoid\"\n{noise}"
        ),
        // What absorbs glows as brightly.
        format!("scattering = 2.0\nabsorption = 2.0\nemission = 2.0\nfills = \"bounds\"\n[media.m.density]\ntype = \"noise\"\n{noise}"),
    ];
    let wavy = |x: usize, y: usize, z: usize| ((x * y + z) % 7) as f32 * if x < 8 { 0.0 } else { 1.0 };
    if let Some(file) = grid(folder.path(), "density", GridClass::FogVolume, wavy) {
        let place = "transform = [{ translate = [-1.5, -1.5, -1.5] }, { scale = [1, 0.5, 0.7] }]";
        media.push(format!("scattering = 0.5\nfills = \"bounds\"\n[media.m.density]\ntype = \"vdb\"\nfile = {file:?}\n{place}"));
    }
    for medium in media {
        let shape = "[materials.white]\ntype = \"lambert\"\nreflectance = 1\n[[shapes]]\ntype = \"sphere\"\n\
                     center = [0, -0.6, 0]\nradius = 0.3\nmaterial = \"white\"\n";
        let text = through("", &medium, [[0.2, 0.1, 3.0], [0.1, -0.1, 0.0]])
            .replace("fov = 1e-4", "fov = 30")
            + shape;
        let (mean, error) = shown(&text, &paths(96, None));
        assert!(error < 0.005 && (mean - 1.0).abs() < 4.5 * error, "{medium}: {mean} +- {error}");
    }
}

/// What absorbs and has a temperature shows a black body behind an optical depth of 3.1; half as bright with `glow = 0.5`. In cd/m^2: platinum as
/// it freezes.
#[test]
fn fire_glows_as_a_black_body() {
    let folder = tempfile::tempdir().unwrap();
    let Some(file) = grid(folder.path(), "heat", GridClass::FogVolume, |_, _, _| 2.0414) else { return };
    for (loss, glow) in [("absorption = 1.0", 1.0), ("absorption = 0.5\nscattering = 0.5", 0.5)] {
        let medium = format!(
            "{loss}\n[media.m.density]\ntype = \"vdb\"\nfile = {file:?}\nfactor = 0.48986\ntemperature = \"heat\"\nkelvin = 1000\nglow = {glow}"
        );
        let text = through("", &medium, [[9.0, 1.55, 1.55], [0.0, 1.55, 1.55]])
            .replace("radiance = 1.0", "radiance = 0.0")
            + &boxed([0.0; 3], [3.1; 3]);
        let shot = Stage::new(&text, (16, 16)).shoot(&paths(384, Some(1)));
        let [r, g, b] = shot.mean("beauty");
        let error = shot.standard_error("beauty")[0] / r;
        let share = glow * (1.0 - (-3.1f64).exp()) * if glow < 1.0 { 0.5 } else { 1.0 };
        let luminance = 683.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b) / share;
        assert!(
            error < 0.005 && (luminance / 6e5 - 1.0).abs() < 0.02 + 4.5 * error,
            "{luminance} +- {error}"
        );
        assert!(r > 2.0 * g && g > 4.0 * b, "{r} {g} {b}");
    }
}

/// The sun shines through a medium that fills the scene: over the way from the top of its box to the ground, and from there to the eye.
#[test]
fn what_fills_the_scene_takes_from_the_sun() {
    let medium = "absorption = 0.3\nfills = \"scene\"\ngrow = 2.0";
    let ground = "[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"quad\"\ncorner = [-1, 0, 1]\n\
                  edge-u = [2, 0, 0]\nedge-v = [0, 0, -2]\nmaterial = \"grey\"\n";
    let text = through("", medium, [[0.0, 2.0, 0.0], [0.0; 3]]).replace(
        "type = \"environment\"\nradiance = 1.0",
        "type = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 3.141592653589793",
    ) + ground;
    let (mean, _) = shown(&text, &paths(1, None));
    // The box around the ground and the eye has half a diagonal of sqrt 3, by which its top is above the eye.
    let want = 0.5 * (-0.3 * (2.0 + 3f64.sqrt() + 2.0)).exp();
    assert!((mean / want - 1.0).abs() < 1e-4, "{mean}, not {want}");
}

/// What the files say that cannot be rendered.
#[test]
fn files_without_a_density_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let Some(surface) = grid(folder.path(), "surface", GridClass::LevelSet, |_, _, _| 1.0) else { return };
    let broken = folder.path().join("broken.vdb");
    let bytes = std::fs::read(&surface).unwrap();
    std::fs::write(&broken, &bytes[..bytes.len() / 2]).unwrap();
    let empty = grid(folder.path(), "density", GridClass::FogVolume, |_, _, _| 0.0).unwrap();
    let cases: [(&Path, &str, &[&str]); 4] = [
        (&surface, "", &["surface.vdb", "`surface`", "level set", "fog volume"]),
        (&surface, "grid = \"smoke\"", &["surface.vdb", "no grid called `smoke`", "`surface` (float)"]),
        (&broken, "", &["broken.vdb", "ends too early"]),
        (&empty, "", &["density.vdb", "`density`", "no voxel above zero"]),
    ];
    for (file, more, words) in cases {
        let medium = format!(
            "absorption = 1\nfills = \"bounds\"\n[media.m.density]\ntype = \"vdb\"\nfile = {file:?}\n{more}"
        );
        let text = through("", &medium, [[0.0, 0.0, 9.0], [0.0; 3]]);
        let description = parse_scene(&text, Path::new("test.toml"), &[]).unwrap();
        let told = build_scene(&description, device(), (4, 4)).unwrap_err().to_string();
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
        assert!(told.starts_with("test.toml:6:") && told.contains("medium `m`"), "{told}");
    }
    // Voxels without a usable value are left out, with a warning.
    let odd =
        |x: usize, y: usize, _: usize| if x == 3 { -1.0 } else { if y == 3 { f32::INFINITY } else { 1.0 } };
    let odd = grid(folder.path(), "odd", GridClass::Unknown, odd).unwrap();
    let medium =
        format!("absorption = 1\nfills = \"bounds\"\n[media.m.density]\ntype = \"vdb\"\nfile = {odd:?}");
    let stage = Stage::new(&through("", &medium, [[0.0, 0.0, 9.0], [0.0; 3]]), (4, 4));
    let warned = stage.built.warnings.iter().any(|warning| {
        ["`odd`", "odd.vdb", "992 infinite", "1024 below zero"]
            .iter()
            .all(|word| warning.message.contains(word))
    });
    assert!(warned, "{:?}", stage.built.warnings);
    stage.shoot(&paths(1, None));
}
