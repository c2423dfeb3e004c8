//! Validation in closed rooms, where light is uniform.

use super::stage::{Stage, path, photon_map};
use super::{Claim, Expected, Experiment, ValidateError, by};
use crate::embree::Device;
use crate::render::{Overrides, ProbeEstimator, ProbePoint};
use crate::scene::MapKind;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

const SECTION: &str = "Closed rooms";

/// Flux of the emitters, W.
const FLUX: f64 = 100.0;

const LAMP: &str = "[[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\npower = 100.0\n";

/// Largest bias of estimates from photon maps.
const BIAS: f64 = 0.01;

/// The mean over the walls of any room is `E = Phi / (A (1 - rho))`. The room is a cube of 4 m, as in the fifth part of CIE 171.
fn cube(device: &Arc<Device>, rho: f64) -> Result<Experiment, ValidateError> {
    let text = format!(
        "[camera]\neye = [1, 0, 0]\nat = [0, 0, 1]\n[materials.paint]\ntype = \"lambert\"\nreflectance = {rho:?}\n\
         [[shapes]]\ntype = \"mesh\"\nmaterial = \"paint\"\n\
         vertices = [[-2,-2,-2], [2,-2,-2], [2,2,-2], [-2,2,-2], [-2,-2,2], [2,-2,2], [2,2,2], [-2,2,2]]\n\
         faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]\n\
         [[lights]]\ntype = \"point\"\nposition = [0.5, 1.2, -0.8]\npower = {FLUX:?}\n"
    );
    let stage = Stage::new(device, &text)?;
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: vec![Expected {
            what: format!("cube of 4 m, reflectance {rho}, mean over the walls"),
            by: by::FLUX,
            exact: FLUX / (96.0 * (1.0 - rho)),
            claim: Claim::Unbiased,
        }],
        estimate: Box::new(move |seed| {
            Ok(vec![stage.flux((MapKind::Global, 200_000), 1, |_, _| true, seed)?[0].y / 96.0])
        }),
    })
}

/// Evenly distributed points on the inside of a sphere of radius 2 around the origin.
fn places() -> Vec<ProbePoint> {
    const COUNT: u32 = 32;
    let golden = PI * (5f64.sqrt() - 1.0);
    let at = |i: u32| {
        let y = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(COUNT);
        let (sine, cosine) = (golden * f64::from(i)).sin_cos();
        let out = (1.0 - y * y).sqrt() * DVec3::new(cosine, 0.0, sine) + y * DVec3::Y;
        ProbePoint { position: 2.0 * out, normal: -out }
    };
    (0..COUNT).map(at).collect()
}

fn mean(found: &[[DVec3; 4]], part: usize) -> DVec3 {
    found.iter().map(|parts| parts[part]).sum::<DVec3>() / found.len() as f64
}

/// An integrating sphere: the irradiance is uniform, and `Phi / A` of it is direct light.
fn sphere(device: &Arc<Device>, rho: [f64; 3]) -> Result<Experiment, ValidateError> {
    let text = format!(
        "[camera]\neye = [0.3, -0.4, 0.9]\nat = [1, 0.2, 0]\n[materials.paint]\ntype = \"lambert\"\nreflectance = {rho:?}\n\
         [[shapes]]\ntype = \"sphere\"\nradius = 2.0\nmaterial = \"paint\"\n{LAMP}"
    );
    let stage = Stage::new(device, &text)?;
    let straight = FLUX / (16.0 * PI);
    let row = |by, claim| {
        rho.map(|rho| Expected {
            what: format!("integrating sphere, reflectance {rho}"),
            by,
            exact: straight / (1.0 - rho),
            claim,
        })
    };
    let rows = [
        row(by::PATHS, Claim::Unbiased),
        row(by::GATHER, Claim::Within(BIAS)),
        row(by::PHOTONS, Claim::Within(BIAS)),
    ];
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: rows.into_iter().flatten().collect(),
        estimate: Box::new(move |seed| {
            let points = places();
            let maps = Overrides { global_photons: Some(200_000), ..photon_map() };
            let all = [
                stage.irradiance((ProbeEstimator::Path, 64), &points, path(), seed)?,
                stage.irradiance((ProbeEstimator::Gather, 32), &points, maps.clone(), seed)?,
                stage.irradiance((ProbeEstimator::PhotonMap, 1), &points, maps, seed)?,
            ];
            Ok(all.iter().flat_map(|found| mean(found, 3).to_array()).collect())
        }),
    })
}

/// The integrating sphere seen by a camera, with an irradiance cache: `L = rho E / pi`.
fn cached(device: &Arc<Device>, rho: f64) -> Result<Experiment, ValidateError> {
    let text = format!(
        "[camera]\neye = [0.3, -0.4, 0.9]\nat = [1, 0.2, 0]\nfov = 60\n[materials.paint]\ntype = \"lambert\"\n\
         reflectance = {rho:?}\n[[shapes]]\ntype = \"sphere\"\nradius = 2.0\nmaterial = \"paint\"\n{LAMP}"
    );
    let stage = Stage::new(device, &text)?;
    Ok(Experiment {
        section: SECTION,
        unit: "W/(m² sr)",
        rows: vec![Expected {
            what: format!("integrating sphere, reflectance {rho}, radiance"),
            by: by::CACHE,
            exact: rho / PI * FLUX / (16.0 * PI * (1.0 - rho)),
            claim: Claim::Within(BIAS),
        }],
        estimate: Box::new(move |seed| {
            let settings = Overrides {
                irradiance_cache: Some(true),
                global_photons: Some(200_000),
                spp: Some(1),
                ..photon_map()
            };
            Ok(vec![stage.layer("beauty", settings, seed)?.y])
        }),
    })
}

/// A furnace: walls emit `1 - rho` and reflect `rho`, so radiance is 1 everywhere. Objects that absorb nothing do not change it.
fn furnace(device: &Arc<Device>) -> Result<Experiment, ValidateError> {
    const RHO: [f64; 3] = [0.3, 0.5, 0.7];
    let wall = |corner: &str, u: &str, v: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {u}\nedge-v = {v}\nmaterial = \"wall\"\n\
             emission = {{ radiance = {:?} }}\n",
            RHO.map(|rho| 1.0 - rho)
        )
    };
    let text = format!(
        "[camera]\neye = [0.8, 0.5, 0.9]\nat = [0, 0, 0]\n[materials.wall]\ntype = \"lambert\"\nreflectance = {RHO:?}\n\
         [materials.glass]\ntype = \"dielectric\"\nior = 1.5\n[materials.mirror]\ntype = \"mirror\"\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [-0.3, -0.5, 0.2]\nradius = 0.4\nmaterial = \"glass\"\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [0.4, -0.3, -0.4]\nradius = 0.45\nmaterial = \"mirror\"\n{}",
        [
            wall("[-1, -1, -1]", "[0, 0, 2]", "[2, 0, 0]"),
            wall("[-1, 1, -1]", "[2, 0, 0]", "[0, 0, 2]"),
            wall("[-1, -1, -1]", "[0, 2, 0]", "[0, 0, 2]"),
            wall("[1, -1, -1]", "[0, 0, 2]", "[0, 2, 0]"),
            wall("[-1, -1, -1]", "[2, 0, 0]", "[0, 2, 0]"),
            wall("[-1, -1, 1]", "[0, 2, 0]", "[2, 0, 0]"),
        ]
        .concat()
    );
    let stage = Stage::new(device, &text)?;
    let row = |by, claim| {
        RHO.map(|rho| Expected {
            what: format!("furnace with glass and mirror, reflectance {rho}, on the floor"),
            by,
            exact: PI,
            claim,
        })
    };
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: [row(by::PATHS, Claim::Unbiased), row(by::GATHER, Claim::Within(BIAS))]
            .into_iter()
            .flatten()
            .collect(),
        estimate: Box::new(move |seed| {
            let places = [(-0.3, 0.2), (0.1, 0.1), (0.4, -0.4), (-0.7, -0.6), (0.8, 0.7)];
            let points: Vec<_> =
                places.iter().map(|&(x, z)| super::stage::place(x, -1.0, z, DVec3::Y)).collect();
            let maps =
                Overrides { global_photons: Some(100_000), caustic_photons: Some(100_000), ..photon_map() };
            let all = [
                stage.irradiance((ProbeEstimator::Path, 256), &points, path(), seed)?,
                stage.irradiance((ProbeEstimator::Gather, 128), &points, maps, seed)?,
            ];
            Ok(all.iter().flat_map(|found| mean(found, 3).to_array()).collect())
        }),
    })
}

pub(super) fn experiments(device: &Arc<Device>) -> Result<Vec<Experiment>, ValidateError> {
    Ok(vec![
        cube(device, 0.5)?,
        cube(device, 0.8)?,
        cube(device, 0.95)?,
        sphere(device, [0.5, 0.8, 0.9])?,
        cached(device, 0.5)?,
        furnace(device)?,
    ])
}
