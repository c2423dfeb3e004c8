//! A matrix of extremes: 256 rooms in which size, place, reflectance, roughness, index, power, counts of photons and estimates, and
//! the integrator are each drawn from a list that goes to its ends. A picture is finite and its parts sum up
//! (every picture of these tests is looked at for that), nothing is rejected, and radiance is what scaling laws say.

use crate::support::*;
use cardioid::render::{MapKind, Overrides};
use cardioid::sampling::mix;

const CASES: u64 = 256;

/// Metres from floor to ceiling.
const SIZES: [f64; 5] = [1.0, 3.7, 1e-6, 1e6, 1e-3];
/// Distance from the origin of the world, in sizes.
const PLACES: [f64; 4] = [0.0, 1.0, 1e3, 1e5];
const REFLECTANCES: [f64; 6] = [0.0, 1e-6, 0.5, 0.99, 0.999_999, 1.0];
const ROUGHNESSES: [f64; 6] = [0.0, 1e-8, 1e-4, 1e-2, 0.3, 1.0];
const INDICES: [f64; 6] = [1.0, 1.000_000_1, 1.0001, 1.33, 2.417, 100.0];
/// Radiance of the lamp.
const POWERS: [f64; 6] = [1.0, 0.0, 1e-30, 1e-12, 1e12, 1e30];
const PHOTONS: [u64; 5] = [0, 1, 10, 1000, 100_000];
const NEAREST: [u32; 5] = [1, 2, 10, 80, 1_000_000];

#[derive(Clone, Copy, Debug)]
struct Case {
    size: f64,
    place: f64,
    reflectance: f64,
    roughness: f64,
    ior: f64,
    power: f64,
    photons: u64,
    nearest: u32,
    integrator: usize,
}

impl Case {
    fn new(number: u64) -> Self {
        let mut dimension = 0;
        let mut draw = |count: usize| {
            dimension += 1;
            (mix(mix(number) ^ dimension) % count as u64) as usize
        };
        Self {
            size: SIZES[draw(SIZES.len())],
            place: PLACES[draw(PLACES.len())],
            reflectance: REFLECTANCES[draw(REFLECTANCES.len())],
            roughness: ROUGHNESSES[draw(ROUGHNESSES.len())],
            ior: INDICES[draw(INDICES.len())],
            power: POWERS[draw(POWERS.len())],
            photons: PHOTONS[draw(PHOTONS.len())],
            nearest: NEAREST[draw(NEAREST.len())],
            integrator: draw(4),
        }
    }

    /// The same at a size of one metre, at the origin, with a lamp of radiance one.
    fn plain(self) -> Self {
        Self { size: 1.0, place: 0.0, power: 1.0, ..self }
    }

    fn settings(&self) -> Overrides {
        let integrator = match self.integrator {
            0 => path(),
            1 => show(MapKind::Global),
            _ => photon_map(),
        };
        Overrides {
            spp: Some(1),
            gather_samples: Some(2),
            global_photons: Some(self.photons),
            caustic_photons: Some(self.photons),
            global_nearest: Some(self.nearest),
            caustic_nearest: Some(self.nearest),
            // A hundred thousand photons at each of a quarter of them would take all the time of this test.
            precomputed_irradiance: Some(self.photons < 100_000 || self.nearest <= 80),
            max_depth: Some(200),
            ..integrator
        }
    }

    /// A closed room with a ball of glass, smooth or rough, a ball of metal, and a lamp.
    fn stage(&self) -> Stage {
        let Self { size, place, reflectance, roughness, ior, power, .. } = *self;
        let at = |x: f64, y: f64, z: f64| [x, y, z].map(|c| size * (c + place));
        let edge = |x: f64, y: f64, z: f64| [x, y, z].map(|c| size * c);
        let corners = [
            at(-1.0, -1.0, -1.0),
            at(1.0, -1.0, -1.0),
            at(1.0, 1.0, -1.0),
            at(-1.0, 1.0, -1.0),
            at(-1.0, -1.0, 1.0),
            at(1.0, -1.0, 1.0),
            at(1.0, 1.0, 1.0),
            at(-1.0, 1.0, 1.0),
        ];
        let text = format!(
            r#"
            [camera]
            eye = {:?}
            at = {:?}
            fov = 70.0
            [materials.paint]
            type = "lambert"
            reflectance = {reflectance:?}
            [materials.glass]
            type = "dielectric"
            ior = {ior:?}
            roughness = {roughness:?}
            [materials.metal]
            type = "conductor"
            metal = "gold"
            roughness = {roughness:?}
            [[shapes]]
            type = "mesh"
            vertices = {corners:?}
            faces = [[0,1,2,3], [4,7,6,5], [0,4,5,1], [3,2,6,7], [0,3,7,4], [1,5,6,2]]
            material = "paint"
            [[shapes]]
            type = "sphere"
            center = {:?}
            radius = {:?}
            material = "glass"
            [[shapes]]
            type = "sphere"
            center = {:?}
            radius = {:?}
            material = "metal"
            [[shapes]]
            type = "quad"
            corner = {:?}
            edge-u = {:?}
            edge-v = {:?}
            material = "paint"
            emission = {{ radiance = {power:?} }}
            "#,
            at(0.0, 0.0, 0.95),
            at(0.0, -0.2, 0.0),
            at(-0.3, -0.6, 0.2),
            0.3 * size,
            at(0.4, -0.6, -0.2),
            0.3 * size,
            at(-0.2, 0.9, -0.2),
            edge(0.4, 0.0, 0.0),
            edge(0.0, 0.0, 0.4),
        );
        Stage::new(&text, (8, 8))
    }
}

#[test]
fn random_rooms() {
    let (mut compared, mut worst) = (0, 0.0f64);
    for number in 0..CASES {
        let case = Case::new(number);
        let settings = case.settings();
        let shot = case.stage().shoot(&settings);
        assert_eq!(shot.statistics.rejected_samples, 0, "{number}: {case:?}");
        assert_eq!(shot.developed.clamped, 0, "{number}: {case:?}");
        let seen = shot.mean("beauty");
        assert!(seen.iter().all(|&radiance| radiance >= 0.0), "{number}: {case:?}: {seen:?}");
        if case.power == 0.0 {
            assert_eq!(seen, [0.0; 3], "{number}: {case:?}");
            continue;
        }
        // Radiance does not depend on size and place, and is proportional to the lamp's. What is rounded otherwise takes other ways
        // here and there, so means agree within the noise of these small pictures; and where maps are read, of the maps, which
        // pixels do not tell: few photons, or one or two in an estimate, say nothing. Direct light needs none.
        let reads_maps = case.integrator != 0;
        let steady = !reads_maps || (case.photons >= 100_000 && (10..=80).contains(&case.nearest));
        let layers =
            [("direct", 0.01, case.integrator != 1), ("beauty", if reads_maps { 0.1 } else { 0.01 }, steady)];
        let layers: Vec<_> = layers.into_iter().filter(|&(.., counts)| counts).collect();
        if layers.is_empty() {
            continue;
        }
        let few = Overrides { global_photons: Some(10), caustic_photons: Some(10), ..settings.clone() };
        let plain = case.plain().stage().shoot(if steady { &settings } else { &few });
        for (layer, share, _) in layers {
            let (seen, want, noise) = (shot.mean(layer), plain.mean(layer), plain.standard_error(layer));
            for c in 0..3 {
                let found = seen[c] / case.power;
                let off = (found - want[c]).abs();
                assert!(
                    off <= share * want[c] + 4.0 * noise[c],
                    "{number}, {layer}, channel {c}: {case:?}: {found} and not {}, noise {}",
                    want[c],
                    noise[c]
                );
                if noise[c] > 0.0 {
                    worst = worst.max(off / noise[c]);
                }
            }
        }
        compared += 1;
    }
    println!("{compared} of {CASES} compared; at most {worst:.2} standard errors of a picture off");
    assert!(compared > 150);
}

/// Each value of each list meets each value of each other.
#[test]
fn every_pair_is_among_them() {
    let cases: Vec<Case> = (0..CASES).map(Case::new).collect();
    let columns: [Vec<String>; 9] = [
        cases.iter().map(|c| format!("{:?}", c.size)).collect(),
        cases.iter().map(|c| format!("{:?}", c.place)).collect(),
        cases.iter().map(|c| format!("{:?}", c.reflectance)).collect(),
        cases.iter().map(|c| format!("{:?}", c.roughness)).collect(),
        cases.iter().map(|c| format!("{:?}", c.ior)).collect(),
        cases.iter().map(|c| format!("{:?}", c.power)).collect(),
        cases.iter().map(|c| c.photons.to_string()).collect(),
        cases.iter().map(|c| c.nearest.to_string()).collect(),
        cases.iter().map(|c| c.integrator.to_string()).collect(),
    ];
    let distinct = |column: &[String]| column.iter().collect::<std::collections::BTreeSet<_>>().len();
    for (i, a) in columns.iter().enumerate() {
        for b in &columns[i + 1..] {
            let pairs: std::collections::BTreeSet<_> = a.iter().zip(b).collect();
            assert_eq!(pairs.len(), distinct(a) * distinct(b));
        }
    }
}
