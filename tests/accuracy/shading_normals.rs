//! Shading normals beside the geometric one: nothing is lost in a furnace, and photons agree with paths.

use crate::support::*;
use cardioid::render::Overrides;
use std::f64::consts::TAU;

/// A sphere of so many triangles that its normals lie up to 30 degrees beside its faces.
fn coarse_sphere(centre: [f64; 3], radius: f64, material: &str) -> String {
    const ROWS: u32 = 4;
    const COLUMNS: u32 = 6;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for row in 0..=ROWS {
        let polar = 0.5 * TAU * f64::from(row) / f64::from(ROWS);
        let columns = if row == 0 || row == ROWS { 1 } else { COLUMNS };
        for column in 0..columns {
            let azimuth = TAU * f64::from(column) / f64::from(COLUMNS);
            let unit = [polar.sin() * azimuth.cos(), polar.cos(), -polar.sin() * azimuth.sin()];
            let at: Vec<String> = (0..3).map(|i| format!("{:.6}", centre[i] + radius * unit[i])).collect();
            vertices.push(format!("[{}]", at.join(", ")));
        }
    }
    let first = |row: u32| if row == 0 { 0 } else { 1 + (row - 1) * COLUMNS };
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let next = (column + 1) % COLUMNS;
            let (above, below) = (first(row), first(row + 1));
            faces.push(match row {
                0 => format!("[0, {}, {}]", below + column, below + next),
                _ if row == ROWS - 1 => format!("[{}, {below}, {}]", above + column, above + next),
                _ => format!("[{}, {}, {}, {}]", above + column, below + column, below + next, above + next),
            });
        }
    }
    format!(
        "[[shapes]]\nname = \"ball\"\ntype = \"mesh\"\nnormals = \"smooth\"\nvertices = [{}]\nfaces = [{}]\nmaterial = \"{material}\"\n",
        vertices.join(", "),
        faces.join(", ")
    )
}

const MATERIALS: &str = r#"
    [textures.waves]
    type = "wood"
    size = 0.1
    spacing = 0.3
    low = 0.0
    high = 1.0
    [materials.white]
    type = "lambert"
    reflectance = 1.0
    [materials.mirror]
    type = "mirror"
    reflectance = 1.0
    [materials.glass]
    type = "dielectric"
    ior = 1.5
    [materials.rough]
    type = "dielectric"
    ior = 1.5
    roughness = 0.02
    [materials.bumpy-mirror]
    type = "mirror"
    reflectance = 1.0
    bump = { texture = "waves", height = 0.2 }
    [materials.bumpy]
    type = "lambert"
    reflectance = 1.0
    bump = { texture = "waves", height = 0.2 }
    "#;

/// In light that is the same from everywhere, what absorbs nothing shows just that light.
#[test]
fn a_furnace_shows_no_surface() {
    let quad = |material: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = [-1, -1, 0]\nedge-u = [2, 0, 0]\nedge-v = [0, 2, 0]\nmaterial = \"{material}\"\n"
        )
    };
    let ball = |material: &str| coarse_sphere([0.0; 3], 1.0, material);
    for (name, shape, tolerance) in [
        ("a bumpy mirror", quad("bumpy-mirror"), 1e-4),
        ("a bumpy sheet", quad("bumpy"), 0.03),
        ("a mirror ball", ball("mirror"), 1e-4),
        ("a white ball", ball("white"), 0.03),
        // Bent normals have no way back: some light that enters is reflected totally for ever.
        ("a glass ball", ball("glass"), 0.05),
        ("a rough glass ball", ball("rough"), 0.06),
    ] {
        let text = format!(
            "[camera]\neye = [0.4, 0.3, 6]\nat = [0, 0, 0]\nfov = 18\n{MATERIALS}{shape}[[lights]]\ntype = \"environment\"\nradiance = 1.0\n"
        );
        let stage = Stage::new(&text, (24, 24));
        for (how, overrides) in [("path", path()), ("maps", photon_map())] {
            let few = Overrides {
                spp: Some(16),
                global_photons: Some(5_000),
                caustic_photons: Some(5_000),
                ..overrides
            };
            let shot = stage.shoot(&few);
            let mean = shot.mean("beauty")[0];
            println!("{name} by {how}: {mean}");
            assert!((mean - 1.0).abs() < tolerance, "{name} by {how}: {mean}");
        }
    }
}

/// What a coarse ball sends to the floor below a lamp, by photons and by paths that find the lamp by chance.
#[test]
fn photons_from_bent_normals_agree_with_paths() {
    for (material, layer) in [("mirror", "caustics"), ("glass", "caustics"), ("white", "indirect")] {
        let text = format!(
            r#"
            [camera]
            eye = [0, 1, 7]
            at = [0, -0.6, 0]
            fov = 34
            {MATERIALS}
            [materials.floor]
            type = "lambert"
            reflectance = 0.5
            {}
            [[shapes]]
            type = "quad"
            corner = [-3, -1.2, 3]
            edge-u = [6, 0, 0]
            edge-v = [0, 0, -6]
            material = "floor"
            [[shapes]]
            type = "quad"
            corner = [-3, 3, -3]
            edge-u = [6, 0, 0]
            edge-v = [0, 0, 6]
            material = "floor"
            emission = {{ radiance = 1.0 }}
            "#,
            coarse_sphere([0.0; 3], 1.0, material)
        );
        let stage = Stage::new(&text, (16, 16));
        let many = Overrides { spp: Some(256), ..path() };
        let maps = Overrides {
            spp: Some(16),
            global_photons: Some(100_000),
            caustic_photons: Some(100_000),
            ..photon_map()
        };
        let (by_paths, by_maps) = (stage.shoot(&many).mean(layer)[0], stage.shoot(&maps).mean(layer)[0]);
        println!("{material} {layer}: paths {by_paths}, maps {by_maps}");
        assert!((by_maps / by_paths - 1.0).abs() < 0.05, "{material} {layer}: {by_paths}, maps {by_maps}");
    }
}
