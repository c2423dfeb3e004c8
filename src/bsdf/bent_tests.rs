//! Tests of shading normals that differ from the geometric one: no light is lost, densities agree with samples, and photons agree with
//! paths.

use super::chi_square::ChiSquare;
use super::tests::direction;
use super::*;
use crate::math::{Frame, unit};
use crate::sampling::{Rng, Stream, warp};
use glam::Vec2;
use std::f32::consts::{FRAC_1_PI, PI};

const RADIANCE: TransportMode = TransportMode::Radiance;

/// One model of each kind, with lobes of every class.
fn models() -> Vec<Bsdf> {
    let white = |roughness| Bsdf::Conductor(Conductor::new(Metal::Colour(Rgb::ONE), [roughness; 2]));
    let layered = |p: LayeredParameters| Bsdf::Layered(Layered::new(&p));
    let plastic = LayeredParameters { metallic: 0.0, base: Rgb::splat(0.8), ..Default::default() };
    let interface = Dielectric::new(1.0, 1.5);
    let glass = LayeredParameters { transmission: 1.0, body: Body::Interface(interface), ..plastic };
    vec![
        Bsdf::Lambert(Lambert { reflectance: Rgb::ONE }),
        Bsdf::Mirror(Mirror { reflectance: Rgb::ONE }),
        Bsdf::Dielectric(interface),
        Bsdf::RoughDielectric(RoughDielectric::new(interface, 0.3).unwrap()),
        white(0.0),
        white(0.2),
        white(0.6),
        Bsdf::Ward(Ward::new(Rgb::splat(0.3), Rgb::splat(0.6), [0.2; 2], Form::Bounded)),
        Bsdf::Schlick(Schlick::new(Rgb::splat(0.6), 0.3, 1.0, Form::Bounded)),
        layered(LayeredParameters { roughness: [0.3; 2], ..plastic }),
        layered(LayeredParameters { roughness: [0.5; 2], coat: 1.0, ..plastic }),
        layered(LayeredParameters { roughness: [0.3; 2], ..glass }),
        // The last one turns its frame to the side from which it is seen.
        layered(LayeredParameters { transmission: 0.7, body: Body::Thin, roughness: [0.2; 2], ..plastic }),
    ]
}

/// Geometric normals in the shading frame, close to the shading normal and far from it.
fn bends() -> [Vec3; 3] {
    [Vec3::new(0.1, 0.05, 1.0), Vec3::new(-0.6, 0.2, 1.0), Vec3::new(0.3, -1.7, 1.0)]
        .map(|n| unit(n).unwrap())
}

fn has_back(bsdf: &Bsdf) -> bool {
    bsdf.sample(-Vec3::Z, 0.5, Vec2::splat(0.5), RADIANCE).is_some()
}

/// View directions from which both normals are seen from the same side.
fn eyes(normal: Vec3) -> impl Iterator<Item = Vec3> {
    let all =
        [0.95f32, 0.6, 0.2, -0.5].into_iter().flat_map(|cos| [0.3, 1.9, 4.0].map(|phi| direction(cos, phi)));
    all.filter(move |w| sides_agree(*w, Vec3::Z, normal))
}

/// The reflected light equals that of a surface with equal normals, sample by sample: in a furnace none is lost.
#[test]
fn a_bent_normal_loses_nothing() {
    let mut rng = Rng::new(1, Stream::Measure, 0);
    for (bsdf, normal) in models().into_iter().flat_map(|bsdf| bends().map(|normal| (bsdf, normal))) {
        for wo in eyes(normal) {
            let bent = Bent { bsdf: &bsdf, wo, bend: Bend::new(normal) };
            for _ in 0..200 {
                let (u_lobe, u) = (rng.next_f32(), rng.next_2d());
                let plain = bsdf.sample(wo, u_lobe, u, RADIANCE);
                let sample = bent.sample(u_lobe, u, RADIANCE);
                assert_eq!(
                    sample.map(|s| s.throughput),
                    plain.map(|s| s.throughput),
                    "{bsdf:?} {normal} {wo}"
                );
                let Some(sample) = sample else { continue };
                assert!((sample.wi.length() - 1.0).abs() < 1e-5);
                let sides = sample.wi.dot(normal) * wo.dot(normal);
                assert_eq!(sides < 0.0, sample.transmission, "{bsdf:?} {normal} {wo} {sample:?}");
            }
        }
    }
}

#[test]
fn bent_samples_follow_the_density() {
    let lobes = [Lobe::Diffuse, Lobe::Glossy];
    let (models, bends) = (models(), bends());
    let runs = (models.len() * bends.len() * 2 * 2) as u32;
    for (seed, bsdf) in models.iter().enumerate() {
        for (normal, lobe) in bends.iter().flat_map(|&normal| lobes.map(|lobe| (normal, lobe))) {
            for wo in eyes(normal).step_by(4) {
                let bent = Bent { bsdf, wo, bend: Bend::new(normal) };
                if bsdf.lobe_albedo(lobe, wo) == Rgb::ZERO || wo.z < 0.0 && !has_back(bsdf) {
                    continue;
                }
                let test = ChiSquare { bins: [64, 32], samples: 30_000, runs, seed: seed as u64 };
                let result = test.directions(
                    2.0,
                    |rng| {
                        let sample = bent.sample_lobe(lobe, rng.next_f32(), rng.next_2d(), RADIANCE)?;
                        Some(sample.wi.as_dvec3())
                    },
                    |wi| f64::from(bent.pdf_solid_angle(lobe, wi.as_vec3())),
                );
                assert!(result.is_ok(), "{bsdf:?} {lobe:?} {normal} {wo}: {result:?}");
            }
        }
    }
}

/// The light found by evaluation equals the light found by sampling.
#[test]
fn bent_values_sum_to_what_is_sampled() {
    const SAMPLES: u32 = 40_000;
    let mut rng = Rng::new(2, Stream::Measure, 0);
    for (bsdf, normal) in models().into_iter().flat_map(|bsdf| bends().map(|normal| (bsdf, normal))) {
        for (lobe, wo) in
            eyes(normal).step_by(5).flat_map(|wo| [Lobe::Diffuse, Lobe::Glossy].map(|l| (l, wo)))
        {
            let bent = Bent { bsdf: &bsdf, wo, bend: Bend::new(normal) };
            let [mut by_samples, mut by_values, mut squares] = [0.0f64; 3];
            for _ in 0..SAMPLES {
                let (u_lobe, u) = (rng.next_f32(), rng.next_2d());
                let sample = bent.sample_lobe(lobe, u_lobe, u, RADIANCE);
                by_samples += sample.map_or(0.0, |s| f64::from(s.throughput.x));
                // Half of the directions come from the lobe and half are uniform. Where the lobe yields no sample, the value is zero.
                let wi = if rng.next_f32() < 0.5 {
                    let Some(sample) = sample else { continue };
                    sample.wi
                } else {
                    warp::square_to_sphere(rng.next_2d())
                };
                let pdf = 0.5 * bent.pdf_solid_angle(lobe, wi) + 0.5 * 0.25 * FRAC_1_PI;
                let value = f64::from(bent.eval_with_cosine(lobe, wi, RADIANCE).x / pdf);
                by_values += value;
                squares += value * value;
            }
            let n = f64::from(SAMPLES);
            let error = (squares / n).sqrt() / n.sqrt();
            let (a, b) = (by_samples / n, by_values / n);
            assert!(
                (a - b).abs() <= 6.0 * error + 1e-3 * a,
                "{bsdf:?} {lobe:?} {normal} {wo}: {a}, by values {b}"
            );
        }
    }
}

/// The reflected light falls to zero continuously as the light reaches the geometric horizon.
#[test]
fn diffuse_light_ends_without_a_step() {
    let bsdf = Bsdf::Lambert(Lambert { reflectance: Rgb::ONE });
    for normal in bends() {
        let bent = Bent { bsdf: &bsdf, wo: unit(Vec3::Z + normal).unwrap(), bend: Bend::new(normal) };
        let frame = Frame::from_z(normal);
        for phi in [0.0, 1.0, 2.0, 3.0, 4.0, 5.0] {
            let value = |cos: f32| {
                bent.eval_with_cosine(Lobe::Diffuse, frame.to_world(direction(cos, phi)), RADIANCE).x
            };
            assert!(value(1e-3) < 3e-3, "{normal} {phi}: {}", value(1e-3));
            assert_eq!(value(-1e-3), 0.0);
            for step in 1..100 {
                let cos = 0.01 * step as f32;
                assert!((value(cos) - value(cos - 0.01)).abs() < 0.06, "{normal} {phi} {cos}");
            }
        }
    }
}

/// Bins of pairs of directions, by the octants of both.
fn bin(wo: Vec3, wi: Vec3) -> usize {
    let octant = |w: Vec3| usize::from(w.x > 0.0) | usize::from(w.y > 0.0) << 1 | usize::from(w.z > 0.0) << 2;
    octant(wo) << 3 | octant(wi)
}

/// Flux from each octant to each other one in a uniform light field agrees between paths and photons, so that photons use the adjoint.
#[test]
fn photons_scatter_as_paths_see() {
    const SAMPLES: u32 = 150_000;
    let models = models();
    for (number, bsdf) in models[..models.len() - 1].iter().copied().enumerate() {
        for normal in bends() {
            let mut rng = Rng::new(3, Stream::Measure, number as u64);
            let frame = Frame::from_z(normal);
            let both = has_back(&bsdf);
            let [mut paths, mut photons] = [[(0.0f64, 0.0f64); 64]; 2];
            // In the frame of the geometric normal, which replaces the shading normal there.
            let flat = |w: Vec3| frame.to_local(w);
            let bend = Bend::new(normal);
            for _ in 0..SAMPLES {
                let mut start = frame.to_world(Lambert::sample_direction(rng.next_2d()));
                if both && rng.next_f32() < 0.5 {
                    start = -start;
                }
                let agrees = sides_agree(start, Vec3::Z, normal);
                let (u_lobe, u) = (rng.next_f32(), rng.next_2d());
                let add = |sums: &mut [(f64, f64); 64], bin: usize, value: f32| {
                    sums[bin].0 += f64::from(value);
                    sums[bin].1 += f64::from(value).powi(2);
                };
                let seen = if agrees {
                    Bent { bsdf: &bsdf, wo: start, bend }
                        .sample(u_lobe, u, RADIANCE)
                        .map(|s| (s.wi, s.throughput))
                } else {
                    let sample = bsdf.sample(flat(start), u_lobe, u, RADIANCE);
                    sample.map(|s| (frame.to_world(s.wi), s.throughput))
                };
                if let Some((wi, throughput)) = seen {
                    add(&mut paths, bin(start, wi), throughput.x);
                }
                if agrees {
                    let bent = Bent { bsdf: &bsdf, wo: start, bend };
                    for sample in bent.scatter_photon(u_lobe, u).into_iter().flatten() {
                        // Large weights at grazing angles are rare, and no result here depends on them.
                        add(&mut photons, bin(sample.wi, start), sample.throughput.x);
                    }
                }
                if let Some(sample) = bsdf.sample(flat(start), u_lobe, u, TransportMode::Flux) {
                    let wo = frame.to_world(sample.wi);
                    if !sides_agree(wo, Vec3::Z, normal) {
                        add(&mut photons, bin(wo, start), sample.throughput.x);
                    }
                }
            }
            let n = f64::from(SAMPLES);
            for (bin, ((a, aa), (b, bb))) in paths.into_iter().zip(photons).enumerate() {
                let error = ((aa + bb).sqrt() / n).max(1e-4);
                assert!(
                    (a - b).abs() / n < 7.0 * error,
                    "{bsdf:?} {normal} bin {bin}: paths {}, photons {}, error {error}",
                    a / n,
                    b / n
                );
            }
        }
    }
}

/// The share that photons keep equals the reflected light of a Lambertian surface.
#[test]
fn the_share_of_photons_is_that_of_lambert() {
    let bsdf = Bsdf::Lambert(Lambert { reflectance: Rgb::ONE });
    let mut rng = Rng::new(4, Stream::Measure, 0);
    for normal in bends() {
        let bend = Bend::new(normal);
        let frame = Frame::from_z(normal);
        let bent = Bent { bsdf: &bsdf, wo: unit(Vec3::Z + normal).unwrap(), bend };
        for _ in 0..1000 {
            let wi = frame.to_world(Lambert::sample_direction(rng.next_2d()));
            let (share, cosine) = (bend.lambert_share(wi), wi.dot(normal));
            let value = PI * bent.eval_with_cosine(Lobe::Diffuse, wi, RADIANCE).x;
            assert!((share * cosine - value).abs() < 1e-4, "{share} {cosine} {value}");
            assert!(share <= 1.25 / normal.z + 1.0 + 1e-3);
        }
    }
}
