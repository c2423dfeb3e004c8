//! Claims of Jensen 1996 about photons: how many are needed, and what the cone filter does.

use crate::support::*;
use cardioid::measure::{Picture, Reference};
use cardioid::photons::{EstimateParams, Estimator, Kernel, PhotonMap, Query, Scratch, SearchRegion};
use cardioid::render::{MapKind, Overrides, Silent, build_maps};
use cardioid::scene_file::load_scene;
use glam::{DVec3, Vec3};
use std::fmt::Write as _;
use std::path::Path;
use tempfile::TempDir;

/// A parallelogram as a grid of `n` x `n` squares, two triangles each.
fn grid(path: &Path, (corner, u, v): (DVec3, DVec3, DVec3), n: u32) {
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    )
    .into_bytes();
    for (i, j) in (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))) {
        let p = corner + u * (f64::from(i) / f64::from(n)) + v * (f64::from(j) / f64::from(n));
        p.to_array().iter().for_each(|&x| ply.extend((x as f32).to_le_bytes()));
    }
    for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
        let at = |i, j| j * (n + 1) + i;
        for face in [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]] {
            ply.push(3);
            face.iter().for_each(|index| ply.extend(index.to_le_bytes()));
        }
    }
    std::fs::write(path, ply).unwrap();
}

/// A room whose walls are grids of `n` x `n` squares.
fn room(folder: &Path, n: u32) -> Stage {
    let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
    let walls = [
        ("floor", "white", (o, z, x)),
        ("ceiling", "white", (y, x, z)),
        ("back", "white", (z, y, x)),
        ("left", "red", (o, y, z)),
        ("right", "green", (x, z, y)),
    ];
    let mut text = r#"
        [camera]
        eye = [0.5, 0.5, -1.4]
        at = [0.5, 0.5, 0.0]
        fov = 38.0
        [materials.white]
        type = "lambert"
        reflectance = 0.7
        [materials.red]
        type = "lambert"
        reflectance = [0.6, 0.06, 0.05]
        [materials.green]
        type = "lambert"
        reflectance = [0.14, 0.45, 0.09]
        [materials.glass]
        type = "dielectric"
        ior = 1.5
        [[shapes]]
        type = "sphere"
        center = [0.6, 0.2, 0.6]
        radius = 0.19
        material = "glass"
        [[shapes]]
        type = "quad"
        corner = [0.4, 0.999, 0.4]
        edge-u = [0.2, 0.0, 0.0]
        edge-v = [0.0, 0.0, 0.2]
        material = "white"
        emission = { radiance = 15.0 }
    "#
    .to_owned();
    for (name, material, wall) in walls {
        let file = format!("{name}-{n}.ply");
        grid(&folder.join(&file), wall, n);
        writeln!(text, "[[shapes]]\ntype = \"mesh\"\nfile = \"{file}\"\nmaterial = \"{material}\"").unwrap();
    }
    let path = folder.join(format!("room-{n}.toml"));
    std::fs::write(&path, text).unwrap();
    Stage::of(load_scene(&path, &[]).unwrap(), (64, 64))
}

/// "A Cornell box with walls of millions of triangles needs the same number of photons" (section 6).
#[test]
fn walls_of_a_million_triangles_need_no_more_photons() {
    let folder = TempDir::new().unwrap();
    let (plain, fine) = (room(folder.path(), 1), room(folder.path(), 360));
    let triangles: u32 = 5 * 2 * 360 * 360;
    assert!(triangles > 1_000_000);
    let settings = |seed, photons| Overrides {
        seed: Some(seed),
        spp: Some(16),
        global_photons: Some(photons),
        caustic_photons: Some(photons),
        ..photon_map()
    };
    let truth = plain.shoot(&Overrides { spp: Some(64), ..settings(99, 1_000_000) });
    let error = |stage: &Stage, seed| {
        let shot = stage.shoot(&settings(seed, 20_000));
        let reference = Reference::single(Picture::new(64, 64, truth.layer("beauty")).unwrap()).unwrap();
        reference.compare(Picture::new(64, 64, shot.layer("beauty")).unwrap()).unwrap().relmse
    };
    let mean = |stage: &Stage| (0..4).map(|seed| error(stage, seed)).sum::<f64>() / 4.0;
    let (a, b) = (mean(&plain), mean(&fine));
    println!("relMSE from 20,000 photons: walls of 2 triangles {a:.5}, {triangles} triangles in all {b:.5}");
    assert!((b / a - 1.0).abs() < 0.15, "{a} and {b}");
}

/// Mean over seeds of the irradiance along a line across the caustic of the ring, from `photons` photons.
fn profile(stage: &Stage, kernel: Kernel, photons: u64, nearest: usize, seeds: u64) -> Vec<f64> {
    const POINTS: usize = 400;
    let space = stage.scene().space();
    let mut sums = vec![0.0; POINTS];
    let mut scratch = Scratch::default();
    let params = EstimateParams { kernel, estimator: Estimator::Corrected };
    for seed in 0..seeds {
        let settings = stage.settings(&Overrides {
            seed: Some(seed),
            caustic_photons: Some(photons),
            ..show(MapKind::Caustic)
        });
        let pass = build_maps(stage.scene(), &settings.plan(stage.scene()), &settings, &Silent).unwrap();
        let map: PhotonMap = pass.maps.caustic.unwrap();
        for (i, sum) in sums.iter_mut().enumerate() {
            let along = i as f64 / (POINTS - 1) as f64;
            // Far from the ring itself, at whose foot estimates leak.
            let place = DVec3::new(0.06, 0.0, -0.04 + 0.08 * along);
            let position = space.position(place).as_vec3();
            let query = Query { region: SearchRegion::Disc, ..Query::nearest(position, Vec3::Y, nearest) };
            let estimate = map.estimate_irradiance(&query, &params, &mut scratch);
            *sum += f64::from(estimate.value.y) / seeds as f64;
        }
    }
    sums
}

/// "The cone filter significantly reduces the blur" of few photons (figure 2): the mean of many estimates, which noise
/// is gone from, lies nearer to the caustic.
#[test]
fn the_cone_reduces_the_blur_of_few_photons() {
    let stage = Stage::load("cardioid", (64, 64));
    let truth = profile(&stage, Kernel::Constant, 1_000_000, 300, 4);
    let total: f64 = truth.iter().sum();
    let blur = |kernel| {
        let mean = profile(&stage, kernel, 12_000, 50, 40);
        mean.iter().zip(&truth).map(|(m, t)| (m - t).abs()).sum::<f64>() / total
    };
    let (constant, cone) = (blur(Kernel::Constant), blur(Kernel::Cone { k: 1.0 }));
    println!("blur of 12,000 photons: constant {constant:.4}, cone {cone:.4} of the light");
    assert!(cone < 0.8 * constant, "{cone}, {constant}");
}
