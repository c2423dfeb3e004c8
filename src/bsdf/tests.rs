//! Tests of the simple BSDF models and of the properties that all models share.

use super::chi_square::ChiSquare;
use super::*;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Stream};
use glam::Vec2;

const MODES: [TransportMode; 2] = [TransportMode::Radiance, TransportMode::Flux];

fn lambert(reflectance: f32) -> Bsdf {
    Bsdf::Lambert(Lambert { reflectance: Rgb::splat(reflectance) })
}

fn dielectric(ior_inside: f64) -> Bsdf {
    Bsdf::Dielectric(Dielectric::new(1.0, ior_inside))
}

/// The unit direction with these polar coordinates.
pub(super) fn direction(cos: f32, phi: f32) -> Vec3 {
    let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

#[test]
fn types_are_small() {
    // All models except for the layered one fit into 40 bytes; the layered one determines the size.
    assert!(size_of::<Bsdf>() <= 120 && size_of::<BsdfSample>() <= 32 + 4);
    assert!(size_of::<Ward>() <= 36 && size_of::<Schlick>() <= 36 && size_of::<Conductor>() <= 36);
}

#[test]
fn lambert_samples_follow_the_density() {
    let wos = [(1.0, 0.0), (0.5, 1.0), (1e-6, 2.0)];
    for (seed, (cos, phi)) in wos.into_iter().enumerate() {
        let (bsdf, wo) = (lambert(0.5), direction(cos, phi));
        let test = ChiSquare { runs: wos.len() as u32, seed: seed as u64, ..Default::default() };
        test.directions(
            2.0,
            |rng| {
                let sample = bsdf.sample(wo, rng.next_f32(), rng.next_2d(), TransportMode::Flux)?;
                Some(sample.wi.as_dvec3())
            },
            |wi| f64::from(bsdf.pdf_solid_angle(Lobe::Diffuse, wo, wi.as_vec3())),
        )
        .unwrap();
    }
}

#[test]
fn sample_agrees_with_eval_and_pdf() {
    let mut rng = Rng::new(5, Stream::Measure, 0);
    let reflectance = Rgb::new(0.2, 0.5, 0.9);
    let bsdf = Bsdf::Lambert(Lambert { reflectance });
    for _ in 0..10_000 {
        let wo = direction(rng.next_f32().max(1e-6), 6.0 * rng.next_f32());
        let sample = bsdf.sample(wo, rng.next_f32(), rng.next_2d(), TransportMode::Radiance).unwrap();
        let pdf = bsdf.pdf_solid_angle(Lobe::Diffuse, wo, sample.wi);
        assert_eq!(pdf, sample.pdf_solid_angle);
        let throughput = bsdf.eval(Lobe::Diffuse, wo, sample.wi, TransportMode::Radiance) * sample.wi.z / pdf;
        assert!((throughput - sample.throughput).abs().max_element() < 1e-6);
        assert_eq!((sample.lobe, sample.transmission), (Lobe::Diffuse, false));
    }
}

#[test]
fn white_furnace() {
    // In flux mode the outgoing flux equals the incident flux, in every direction.
    let mut rng = Rng::new(6, Stream::Measure, 0);
    let white = Bsdf::Mirror(Mirror { reflectance: Rgb::ONE });
    for bsdf in [lambert(1.0), white, dielectric(1.5), dielectric(1.0), dielectric(0.7)] {
        for cos in [1e-38f32, 1e-6, 0.1, 0.5, 1.0] {
            for _ in 0..1000 {
                let wo = direction(cos, 1.0);
                let sample = bsdf.sample(wo, rng.next_f32(), rng.next_2d(), TransportMode::Flux).unwrap();
                assert_eq!(sample.throughput, Rgb::ONE, "{bsdf:?}");
            }
        }
        assert_eq!(bsdf.albedo(Vec3::Z), Rgb::ONE);
    }
}

#[test]
fn lambert_integrates_to_its_reflectance() {
    // Uniform directions, so that eval is tested without the sampler: mean of f cos over 1 / (2 pi).
    let mut rng = Rng::new(7, Stream::Measure, 0);
    let (bsdf, n) = (lambert(0.8), 200_000);
    let mut sum = 0f64;
    for _ in 0..n {
        let wi = direction(rng.next_f32(), std::f32::consts::TAU * rng.next_f32());
        sum += f64::from(
            bsdf.eval(Lobe::Diffuse, Vec3::Z, wi, TransportMode::Radiance).x * wi.z * std::f32::consts::TAU,
        );
    }
    // Standard deviation of 2 * 0.8 * cos with cos uniform: 1.6 / sqrt(12).
    let sigma = 1.6 / (12.0 * f64::from(n)).sqrt();
    assert!((sum / f64::from(n) - 0.8).abs() < 4.0 * sigma, "{}", sum / f64::from(n));
}

#[test]
fn frequency_of_reflection_is_fresnel() {
    let mut rng = Rng::new(8, Stream::Measure, 0);
    let n = 100_000;
    for (ior, cos) in [(1.5, 1.0f32), (1.5, 0.2), (1.33, -0.9), (2.417, -0.95), (1e3, 0.5)] {
        let glass = Dielectric::new(1.0, ior);
        let wo = direction(cos, 0.3);
        let reflected = (0..n)
            .filter(|_| !glass.sample(wo, rng.next_f32(), TransportMode::Flux).unwrap().transmission)
            .count();
        let want = f64::from(glass.reflectance(wo));
        let sigma = (want * (1.0 - want) / f64::from(n)).sqrt();
        assert!((reflected as f64 / f64::from(n) - want).abs() < 4.0 * sigma, "{ior} {cos}");
    }
}

#[test]
fn reciprocity() {
    let mut rng = Rng::new(9, Stream::Measure, 0);
    for _ in 0..1000 {
        let (a, b) = (direction(rng.next_f32(), 1.0), direction(rng.next_f32(), 4.0));
        assert_eq!(
            lambert(0.3).eval(Lobe::Diffuse, a, b, TransportMode::Radiance),
            lambert(0.3).eval(Lobe::Diffuse, b, a, TransportMode::Radiance)
        );
    }
    // f(wo, wi) / n_i^2 = f(wi, wo) / n_o^2 (Veach 1997, section 5.2): the factors of the way there and back multiply to one, for
    // radiance.
    for ior in [0.7, 1.0, 1.0001, 1.33, 1.5, 2.417, 10.0] {
        let glass = Dielectric::new(1.0, ior);
        for step in 1..=100 {
            let wo = direction(step as f32 / 100.0, 0.5);
            let there = glass.sample(wo, ONE_MINUS_EPSILON, TransportMode::Radiance).unwrap();
            if !there.transmission {
                continue;
            }
            let back = glass.sample(there.wi, ONE_MINUS_EPSILON, TransportMode::Radiance).unwrap();
            assert!(back.transmission);
            assert!((there.throughput.x * back.throughput.x - 1.0).abs() < 1e-6);
            let n_o_over_n_i = (1.0 / ior) as f32;
            assert!((there.throughput.x / n_o_over_n_i.powi(2) - 1.0).abs() < 1e-6);
            // The way back amplifies the error of `there.wi` by the index.
            assert!((back.wi - wo).length() < 1e-6 * ior.max(1.0) as f32 / wo.z, "{ior}: {} {wo}", back.wi);
        }
    }
    // For flux there is no factor.
    let sample = Dielectric::new(1.0, 1.5).sample(Vec3::Z, 0.5, TransportMode::Flux).unwrap();
    assert_eq!((sample.wi, sample.throughput), (Vec3::NEG_Z, Rgb::ONE));
}

#[test]
fn one_sided_black_side() {
    let (wo, wi) = (direction(-0.5, 0.0), direction(0.5, 0.0));
    for bsdf in [lambert(0.5), Bsdf::Mirror(Mirror { reflectance: Rgb::ONE }), Bsdf::BLACK] {
        assert!(bsdf.sample(wo, 0.5, Vec2::splat(0.5), TransportMode::Flux).is_none());
        for (wo, wi) in [(wo, wi), (wi, wo), (wo, wo)] {
            assert_eq!(
                (
                    bsdf.eval(Lobe::Diffuse, wo, wi, TransportMode::Radiance),
                    bsdf.pdf_solid_angle(Lobe::Diffuse, wo, wi)
                ),
                (Rgb::ZERO, 0.0)
            );
        }
    }
    assert!(Bsdf::BLACK.sample(wi, 0.5, Vec2::splat(0.5), TransportMode::Flux).is_none());
    assert!(!Bsdf::BLACK.has_diffuse() && !Bsdf::BLACK.is_delta() && lambert(0.1).has_diffuse());
    assert!(dielectric(1.5).is_delta() && !dielectric(1.5).has_diffuse());
}

#[test]
fn matched_media_let_light_straight_through() {
    for ior in [1.0, 1.0 + 1e-7, 1.0 - 1e-7, 1.0 + 0.99e-4] {
        let glass = Dielectric::new(1.0, ior);
        assert!(glass.is_matched());
        for wo in [direction(1e-6, 0.4), direction(-0.3, 2.0), Vec3::Z] {
            let sample = glass.sample(wo, 0.0, TransportMode::Radiance).unwrap();
            assert_eq!((sample.wi, sample.throughput, sample.transmission), (-wo, Rgb::ONE, true));
        }
    }
    assert!(!Dielectric::new(1.0, 1.0001).is_matched());
    assert!(!Dielectric::new(1.0001, 1.0).is_matched());
    assert!(!Dielectric::new(1.333, 1.333 * 1.0002).is_matched());
}

#[test]
fn extremes() {
    let reflecting = [0.0f32, 1e-38, 0.5, 0.999_999, 1.0];
    let mut bsdfs: Vec<Bsdf> = reflecting.map(lambert).to_vec();
    bsdfs.extend(reflecting.map(|r| Bsdf::Mirror(Mirror { reflectance: Rgb::splat(r) })));
    bsdfs.extend([1e-3, 0.7, 1.0, 1.0 + 1e-7, 1.0001, 1.5, 1e3].map(dielectric));
    let us = [0.0, 1e-7, 0.25, 0.5, 0.75, ONE_MINUS_EPSILON];
    let cosines = [0.0f32, 1e-45, 1e-38, 1e-20, 1e-6, 1e-3, 0.5, 1.0, f32::NAN];
    for bsdf in bsdfs {
        for (cos, sign) in cosines.into_iter().flat_map(|c| [(c, 1.0), (c, -1.0)]) {
            let mut wo = direction(cos, 0.7);
            wo.z *= sign;
            for u in us.into_iter().flat_map(|x| us.map(|y| Vec2::new(x, y))) {
                for (u_lobe, mode) in us.into_iter().flat_map(|u| MODES.map(|mode| (u, mode))) {
                    let Some(sample) = bsdf.sample(wo, u_lobe, u, mode) else { continue };
                    let context = || format!("{bsdf:?} {wo} {u_lobe} {u} {mode:?}: {sample:?}");
                    assert!((sample.wi.length() - 1.0).abs() < 5e-7, "{}", context());
                    assert!(
                        sample.throughput.is_finite() && sample.throughput.min_element() >= 0.0,
                        "{}",
                        context()
                    );
                    assert!(sample.pdf_solid_angle > 0.0 && sample.wi.z != 0.0, "{}", context());
                    assert_eq!(sample.transmission, (sample.wi.z > 0.0) != (wo.z > 0.0), "{}", context());
                    let pdf = bsdf.pdf_solid_angle(Lobe::Diffuse, wo, sample.wi);
                    assert!(
                        pdf == if bsdf.is_delta() { 0.0 } else { sample.pdf_solid_angle },
                        "{}",
                        context()
                    );
                    assert!(
                        bsdf.eval(Lobe::Diffuse, wo, sample.wi, TransportMode::Radiance).is_finite(),
                        "{}",
                        context()
                    );
                }
            }
            let lost = bsdf.sample(wo, 0.5, Vec2::splat(0.5), TransportMode::Flux).is_none();
            let scatters = match bsdf {
                Bsdf::Dielectric(_) => wo.z != 0.0 && !wo.z.is_nan(),
                _ => wo.z > 0.0 && bsdf.albedo(Vec3::Z).x > 0.0,
            };
            assert_eq!(lost, !scatters, "{bsdf:?} {wo}");
        }
    }
}

#[test]
fn energy_leaves_a_glass_ball() {
    // Flux that enters a ball at random angles leaves it again; after k internal reflections R^k remains.
    let glass = Dielectric::new(1.0, 1.5);
    let mut rng = Rng::new(10, Stream::Measure, 0);
    let n = 50_000;
    let (mut back, mut trapped) = (0u32, 0u32);
    for _ in 0..n {
        // The sine is distributed as for parallel light on a disc. In a ball every inner hit has the same cosine.
        let wo = direction((1.0 - rng.next_f32()).sqrt(), 0.0);
        let first = glass.sample(wo, rng.next_f32(), TransportMode::Flux).unwrap();
        if !first.transmission {
            back += 1;
            continue;
        }
        let mut inner = first.wi;
        let out = (0..100).any(|_| {
            let sample = glass.sample(inner, rng.next_f32(), TransportMode::Flux).unwrap();
            inner = sample.wi;
            sample.transmission
        });
        trapped += u32::from(!out);
    }
    assert_eq!(trapped, 0);
    // External diffuse reflectance of n = 1.5: 0.0918 (Walsh's formula).
    let mean = f64::from(back) / f64::from(n);
    assert!((mean - 0.0918).abs() < 4.0 * (0.0918 * 0.9082 / f64::from(n)).sqrt(), "{mean}");
}
