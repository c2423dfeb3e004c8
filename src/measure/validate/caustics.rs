//! Validation of caustics: a plane mirror, whose caustic has a sharp edge, and rings, whose caustics are curves of infinite irradiance.

use super::stage::{Stage, path, photon_map, place};
use super::{Claim, Expected, Experiment, ValidateError, by};
use crate::embree::Device;
use crate::measure::caustics::{Cardioid, Cell, MirrorSquare, Nephroid};
use crate::photons::{EstimateParams, Estimator, Kernel, Query, Scratch};
use crate::render::{Overrides, ProbeEstimator};
use crate::sampling::{Rng, Stream};
use glam::{DVec3, Vec3};
use std::sync::Arc;

const SECTION: &str = "Caustics";

/// Largest bias of estimates from photons.
const BIAS: f64 = 0.01;
/// Largest bias of estimates over cells inside a caustic curve and across it.
const BIAS_OF_CELLS: f64 = 0.02;
/// Largest bias where irradiance is unbounded within the radius of an estimate. The disc of the nearest photons shrinks where they happen
/// to be dense, so the estimate is too bright. The bias falls with the number of photons: to 2 % with a million (`cells_of_the_nephroid`
/// in `tests/accuracy/closed_forms.rs`).
const BIAS_AT_CUSPS: f64 = 0.06;

const SQUARE: MirrorSquare = MirrorSquare { intensity: 1.0, reflectance: 0.9 };

/// Positions inside the caustic, farther from its edges than the radius of estimates.
fn inside() -> Vec<(f64, f64)> {
    (0..21).flat_map(|i| (-2..=2).map(move |j| (0.3 + 0.07 * f64::from(i), 0.1 * f64::from(j)))).collect()
}

/// Mean ratio of irradiance to the exact value, over positions.
fn mirror_square(device: &Arc<Device>) -> Result<Experiment, ValidateError> {
    let stage = Stage::new(device, include_str!("../../../scenes/mirror-square.toml"))?;
    let ways = [
        ("N = 50", Kernel::Constant, 50),
        ("N = 200", Kernel::Constant, 200),
        ("N = 200, cone", Kernel::Cone { k: 1.0 }, 200),
        ("N = 1500", Kernel::Constant, 1500),
    ];
    let row = |what: String, by, claim| Expected { what, by, exact: 1.0, claim };
    let mut rows: Vec<_> = ways
        .iter()
        .map(|(how, ..)| {
            row(format!("mirror square, over the exact caustic, {how}"), by::PHOTONS, Claim::Within(BIAS))
        })
        .collect();
    rows.push(row("mirror square, over the exact direct light".to_owned(), by::PATHS, Claim::Unbiased));
    Ok(Experiment {
        section: SECTION,
        unit: "",
        rows,
        estimate: Box::new(move |seed| {
            let places = inside();
            let points: Vec<_> = places.iter().map(|&(x, z)| place(x, 0.0, z, DVec3::Y)).collect();
            let mean = |found: &[[DVec3; 4]], part: usize, exact: &dyn Fn(f64, f64) -> f64| {
                let ratios = found.iter().zip(&places).map(|(parts, &(x, z))| parts[part].y / exact(x, z));
                ratios.sum::<f64>() / places.len() as f64
            };
            let mut means = Vec::new();
            for (_, kernel, nearest) in ways {
                let settings = Overrides {
                    global_photons: Some(1000),
                    caustic_photons: Some(100_000),
                    caustic_nearest: Some(nearest),
                    kernel: Some(kernel),
                    ..photon_map()
                };
                let found = stage.irradiance((ProbeEstimator::PhotonMap, 1), &points, settings, seed)?;
                means.push(mean(&found, 1, &|x, z| SQUARE.caustic(x, z)));
            }
            let found = stage.irradiance((ProbeEstimator::Path, 1), &points, path(), seed)?;
            means.push(mean(&found, 0, &|x, z| SQUARE.direct(x, z)));
            Ok(means)
        }),
    })
}

const REFLECTANCE: f64 = 0.8;

fn floor(content: &str) -> String {
    format!(
        "[camera]\neye = [0, 3, 0.1]\nat = [0, 0, 0]\n[materials.floor]\ntype = \"lambert\"\nreflectance = 0.5\n\
         [materials.metal]\ntype = \"mirror\"\nreflectance = {REFLECTANCE:?}\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-2, 0, 2]\nedge-u = [4, 0, 0]\nedge-v = [0, 0, -4]\nmaterial = \"floor\"\n\
         {content}"
    )
}

/// A cell of the floor.
#[derive(Clone, Copy)]
struct Place {
    name: &'static str,
    cell: Cell,
    /// Largest bias of estimates over the cell.
    bias: f64,
}

/// Cells on the axis, around the cusp, and beside the axis.
fn places(cusp: f64) -> Vec<Place> {
    let place = |name, (x, z, width), bias| Place { name, cell: Cell::around(x, z, width), bias };
    vec![
        place("far from it", (-0.5, 0.0, 0.3), BIAS_OF_CELLS),
        place("in the middle", (0.0, 0.0, 0.2), BIAS_OF_CELLS),
        place("around the cusp", (cusp, 0.0, 0.3), BIAS_AT_CUSPS),
        place("across the curve", (0.3, -0.3, 0.3), BIAS_OF_CELLS),
    ]
}

/// Mean irradiance of cells, from the photons in them and from estimates over them.
fn ring(
    device: &Arc<Device>,
    (curve, content): (&str, &str),
    places: Vec<Place>,
    exact: impl Fn(&Cell) -> f64,
) -> Result<Experiment, ValidateError> {
    const ACROSS: u32 = 24;
    const PHOTONS: u64 = 300_000;
    let stage = Stage::new(device, &floor(content))?;
    let row = |place: &Place, by, claim| Expected {
        what: format!("{curve}, mean over a cell {}", place.name),
        by,
        exact: REFLECTANCE * exact(&place.cell),
        claim,
    };
    let by_flux = places.iter().map(|place| row(place, by::FLUX, Claim::Unbiased));
    let by_estimates = places.iter().map(|place| row(place, by::PHOTONS, Claim::Within(place.bias)));
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: by_flux.chain(by_estimates).collect(),
        estimate: Box::new(move |seed| {
            let contains = |i: usize, at: DVec3| at.y.abs() < 1e-6 && places[i].cell.contains(at.x, at.z);
            let map = stage.caustic_map(PHOTONS, seed)?;
            let flux = stage.sum(map.photons(), map.emitted(), places.len(), contains);
            let mut means: Vec<f64> =
                flux.iter().zip(&places).map(|(flux, place)| flux.y / place.cell.area()).collect();
            // One random position in each square of a grid, as no regular grid is fine enough for a curve of infinite irradiance.
            let mut rng = Rng::new(seed, Stream::Measure, 0);
            let mut within = |range: [f64; 2], i: u32| {
                range[0] + (range[1] - range[0]) * (f64::from(i) + rng.next_f64()) / f64::from(ACROSS)
            };
            let space = stage.scene().space();
            let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
            let mut scratch = Scratch::default();
            for Place { cell, .. } in &places {
                let mut sum = 0.0;
                for i in 0..ACROSS * ACROSS {
                    let at = DVec3::new(within(cell.x, i % ACROSS), 0.0, within(cell.z, i / ACROSS));
                    let query = Query::nearest(space.position(at).as_vec3(), Vec3::Y, 60);
                    sum += f64::from(map.estimate_irradiance(&query, &params, &mut scratch).value.y);
                }
                means.push(sum / f64::from(ACROSS * ACROSS) / space.power);
            }
            Ok(means)
        }),
    })
}

/// Half a ring in which every first reflection reaches the floor; light that is reflected twice stays within 0.7 of the wall.
const HALF_RING: &str = "
[[shapes]]
type = \"csg\"
operation = \"difference\"
material = \"metal\"
operands = [
  { type = \"cylinder\", base = [0, -0.2, 0], top = [0, 0.5, 0], radius = 1.02 },
  { type = \"cylinder\", base = [0, -0.3, 0], top = [0, 0.6, 0], radius = 1.0 },
  { type = \"box\", min = [-2, -0.4, -2], max = [0, 0.7, 2] },
]
[[lights]]
type = \"directional\"
direction = [4, -1, 0]
irradiance = 10.0
";

/// A light at twice the height of the ring, so that no light hits the ring twice.
const RING: &str = "
[[shapes]]
type = \"cylinder\"
base = [0, 0, 0]
top = [0, 0.5, 0]
radius = 1.0
material = \"metal\"
[[lights]]
type = \"point\"
position = [-1, 1, 0]
intensity = 3.0
";

pub(super) fn experiments(device: &Arc<Device>) -> Result<Vec<Experiment>, ValidateError> {
    let nephroid = Nephroid { radius: 1.0, reach: 2.0 };
    let on_floor = 10.0 / 17f64.sqrt();
    let cardioid = Cardioid { radius: 1.0, height: 1.0, ring: 0.5, intensity: 3.0 };
    Ok(vec![
        mirror_square(device)?,
        ring(device, ("nephroid", HALF_RING), places(0.5), |cell| on_floor * nephroid.mean(cell))?,
        ring(device, ("cardioid", RING), places(1.0 / 3.0), |cell| cardioid.mean(cell))?,
    ])
}
