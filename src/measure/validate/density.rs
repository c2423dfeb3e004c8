//! Validation of density estimates alone: uniform photons on a square metre.

use super::{Claim, Expected, Experiment, by};
use crate::math::Rgb;
use crate::photons::{
    Estimate, EstimateParams, Estimator, Kernel, Photon, PhotonClass, PhotonMap, Query, Scratch,
};
use crate::sampling::{Rng, Stream};
use glam::Vec3;

const SECTION: &str = "Density estimates";

/// Photons on the square.
const PHOTONS: u64 = 20_000;
/// Number of lookups.
const LOOKUPS: u32 = 2000;

/// A map of independent photons with a total of 1 W.
fn map(rng: &mut Rng, count: u64) -> PhotonMap {
    let photon = |_| {
        let [x, z] = [rng.next_f64(), rng.next_f64()];
        let position = Vec3::new(x as f32, 0.0, z as f32);
        Photon::new(position, Rgb::ONE, Vec3::Y, Vec3::Y, PhotonClass::Caustic, 0.5)
    };
    PhotonMap::build((0..count).map(photon).collect(), count)
}

/// Mean of lookups at positions that `at` computes from two random numbers.
fn lookups(
    what: &str,
    exact: f64,
    photons: u64,
    (nearest, kernel, estimator): (usize, Kernel, Estimator),
    at: fn(f64, f64) -> (f64, f64),
) -> Experiment {
    Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: vec![Expected { what: what.to_owned(), by: by::ESTIMATE, exact, claim: Claim::Unbiased }],
        estimate: Box::new(move |seed| {
            let mut rng = Rng::new(seed, Stream::Measure, 0);
            let map = map(&mut rng, photons);
            let mut scratch = Scratch::default();
            let sum: f64 = (0..LOOKUPS)
                .map(|_| {
                    let (x, z) = at(rng.next_f64(), rng.next_f64());
                    let query = Query::nearest(Vec3::new(x as f32, 0.0, z as f32), Vec3::Y, nearest);
                    let params = EstimateParams { kernel, estimator };
                    let Estimate { value, .. } = map.estimate_irradiance(&query, &params, &mut scratch);
                    f64::from(value.y)
                })
                .sum();
            Ok(vec![sum / f64::from(LOOKUPS)])
        }),
    }
}

pub(super) fn experiments() -> Vec<Experiment> {
    let inside = |u: f64, v: f64| (0.2 + 0.6 * u, 0.2 + 0.6 * v);
    let constant = |nearest| (nearest, Kernel::Constant, Estimator::Corrected);
    let with = |kernel| (50, kernel, Estimator::Corrected);
    vec![
        lookups("even light, N = 10", 1.0, PHOTONS, constant(10), inside),
        lookups("even light, N = 50", 1.0, PHOTONS, constant(50), inside),
        lookups("even light, N = 200", 1.0, PHOTONS, constant(200), inside),
        lookups("even light, cone, N = 50", 1.0, PHOTONS, with(Kernel::Cone { k: 1.0 }), inside),
        lookups("even light, Epanechnikov, N = 50", 1.0, PHOTONS, with(Kernel::Epanechnikov), inside),
        lookups("even light, Gaussian, N = 50", 1.0, PHOTONS, with(Kernel::Gaussian), inside),
        // The formula as printed counts the photon that sets the radius, which gives a factor of N / (N - 1).
        lookups(
            "as printed, N = 10",
            10.0 / 9.0,
            PHOTONS,
            (10, Kernel::Constant, Estimator::AsPrinted),
            inside,
        ),
        lookups(
            "as printed, N = 50",
            50.0 / 49.0,
            PHOTONS,
            (50, Kernel::Constant, Estimator::AsPrinted),
            inside,
        ),
        // Half of the disc has no surface, and no wall reveals it here. A line has few positions, so there are more photons.
        lookups("at a straight edge of all light", 0.5, 10 * PHOTONS, constant(200), |u, v| {
            match (4.0 * v) as u32 {
                0 => (0.2 + 0.6 * u, 0.0),
                1 => (0.2 + 0.6 * u, 1.0),
                2 => (0.0, 0.2 + 0.6 * u),
                _ => (1.0, 0.2 + 0.6 * u),
            }
        }),
    ]
}
