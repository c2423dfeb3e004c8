//! Tests of the layered model: density, energy, reciprocity, classes, and agreement with the models that it generalises.

use super::chi_square::ChiSquare;
use super::tests::direction;
use super::*;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Stream};
use glam::Vec2;

const RADIANCE: TransportMode = TransportMode::Radiance;
const FLUX: TransportMode = TransportMode::Flux;

fn layered(change: impl FnOnce(&mut LayeredParameters)) -> Bsdf {
    let mut parameters = LayeredParameters { metallic: 0.0, ..LayeredParameters::default() };
    change(&mut parameters);
    Bsdf::Layered(Layered::new(&parameters))
}

fn interface(ior: f64) -> Body {
    Body::Interface(Dielectric::new(1.0, ior))
}

fn tilted() -> Vec3 {
    direction(0.9, 0.4)
}

/// White models, which make energy errors visible, on both sides of the threshold, with and without each layer.
fn models() -> Vec<Bsdf> {
    let mut models = Vec::new();
    for roughness in [[0.05; 2], [0.2; 2], [0.5; 2], [1.0; 2], [0.5, 0.1]] {
        models.extend([
            layered(|p| p.roughness = roughness),
            layered(|p| (p.roughness, p.metallic) = (roughness, 1.0)),
            layered(|p| (p.roughness, p.metallic, p.ior) = (roughness, 0.5, 2.4)),
            layered(|p| (p.roughness, p.coat, p.coat_roughness) = (roughness, 1.0, 0.1)),
            layered(|p| {
                (p.roughness, p.coat, p.coat_roughness) = (roughness, 0.8, 0.45);
                p.coat_normal = tilted();
            }),
            layered(|p| (p.roughness, p.body, p.transmission) = (roughness, Body::Thin, 1.0)),
            layered(|p| {
                (p.roughness, p.body, p.transmission) = (roughness, Body::Thin, 0.6);
                (p.coat, p.coat_roughness) = (0.7, 0.2);
            }),
            layered(|p| (p.roughness, p.body, p.transmission) = (roughness, interface(1.5), 1.0)),
            layered(|p| {
                (p.roughness, p.body, p.transmission) = (roughness, interface(1.33), 0.5);
                (p.ior, p.coat, p.coat_roughness, p.metallic) = (1.33, 1.0, 0.3, 0.2);
            }),
        ]);
    }
    models
}

/// Models with a delta among others or with deltas alone.
fn smooth_models() -> Vec<Bsdf> {
    vec![
        layered(|p| p.roughness = [0.0; 2]),
        layered(|p| (p.roughness, p.coat) = ([0.3; 2], 1.0)),
        layered(|p| (p.roughness, p.coat, p.coat_normal) = ([0.0; 2], 1.0, tilted())),
        layered(|p| (p.roughness, p.coat, p.metallic) = ([0.0; 2], 1.0, 1.0)),
        layered(|p| (p.roughness, p.body, p.transmission) = ([0.0; 2], Body::Thin, 1.0)),
        layered(|p| (p.roughness, p.body, p.transmission) = ([0.0; 2], Body::Thin, 0.5)),
        layered(|p| (p.roughness, p.body, p.transmission) = ([0.0; 2], interface(1.5), 1.0)),
        layered(|p| {
            (p.roughness, p.body, p.transmission) = ([0.0; 2], interface(1.5), 0.5);
            p.coat = 1.0;
        }),
    ]
}

fn is_interface(bsdf: &Bsdf) -> bool {
    bsdf.lobe_weights(-Vec3::Z) != [0.0; 3]
}

#[test]
fn samples_follow_the_density() {
    let models = models();
    let wos = [direction(1.0, 0.0), direction(0.5, 1.0), direction(0.15, 4.0), direction(-0.7, 2.0)];
    let runs = (models.len() * wos.len() * 2) as u32;
    for (seed, bsdf) in models.iter().enumerate() {
        for (wo, lobe) in wos.into_iter().flat_map(|wo| [Lobe::Diffuse, Lobe::Glossy].map(|lobe| (wo, lobe)))
        {
            // The narrowest lobes need finer bins than these. Refraction makes lobes narrower still; `white_glass_is_the_dielectric`
            // tests those.
            let is_narrow = seed < 9 || is_interface(bsdf) && matches!(seed / 9, 1 | 4);
            if bsdf.lobe_albedo(lobe, wo) == Rgb::ZERO || is_narrow {
                continue;
            }
            let test = ChiSquare { bins: [64, 32], samples: 20_000, runs, seed: seed as u64 };
            let result = test.directions(
                2.0,
                |rng| {
                    let sample = bsdf.sample_lobe(lobe, wo, rng.next_f32(), rng.next_2d(), FLUX)?;
                    Some(sample.wi.as_dvec3())
                },
                |wi| f64::from(bsdf.pdf_solid_angle(lobe, wo, wi.as_vec3())),
            );
            assert!(result.is_ok(), "{bsdf:?} {lobe:?} {wo}: {result:?}");
        }
    }
}

#[test]
fn sample_agrees_with_eval_and_pdf() {
    let mut rng = Rng::new(31, Stream::Measure, 0);
    for bsdf in models().into_iter().chain(smooth_models()) {
        for lobe in [Lobe::Diffuse, Lobe::Glossy] {
            for _ in 0..500 {
                let wo = direction(0.05 + 0.95 * rng.next_f32(), 6.0 * rng.next_f32());
                let mode = if rng.next_f32() < 0.5 { RADIANCE } else { FLUX };
                let sample = bsdf.sample_lobe(lobe, wo, rng.next_f32(), rng.next_2d(), mode);
                let Some(sample) = sample else { continue };
                assert_eq!(sample.pdf_solid_angle, bsdf.pdf_solid_angle(lobe, wo, sample.wi));
                assert_eq!(sample.lobe, lobe);
                assert_eq!(sample.transmission, sample.wi.z * wo.z < 0.0);
                let want =
                    bsdf.eval(lobe, wo, sample.wi, mode) * (sample.wi.z.abs() / sample.pdf_solid_angle);
                assert_eq!(sample.throughput, want, "{bsdf:?} {wo}");
            }
        }
    }
}

/// Mean throughput over samples of [`Bsdf::sample`], in flux, and its standard error.
fn albedo(bsdf: &Bsdf, wo: Vec3, samples: u64) -> (f64, f64) {
    let mut rng = Rng::new(32, Stream::Measure, u64::from(wo.z.to_bits()));
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..samples {
        let sample = bsdf.sample(wo, rng.next_f32(), rng.next_2d(), FLUX);
        let value = sample.map_or(0.0, |sample| f64::from(sample.throughput.x));
        sum += value;
        squares += value * value;
    }
    let n = samples as f64;
    let mean = sum / n;
    (mean, ((squares / n - mean * mean).max(0.0) / n).sqrt())
}

#[test]
fn white_furnace() {
    let (mut least, mut most) = (1f64, 0f64);
    for bsdf in models().into_iter().chain(smooth_models()) {
        let cosines = [1.0f32, 0.7, 0.4, 0.2, 0.1, 0.03, 1e-3];
        let sides = if is_interface(&bsdf) { [1.0, -1.0].as_slice() } else { &[1.0] };
        for (cos, side) in cosines.into_iter().flat_map(|cos| sides.iter().map(move |side| (cos, side))) {
            let (mean, error) = albedo(&bsdf, direction(cos * side, 0.7), 5_000);
            assert!(mean < 1.0 + 4.0 * error + 1e-4, "{bsdf:?} {cos} {side}: {mean} +- {error}");
            // The smallest value is that of a smooth coat that leans away from light that grazes the base.
            assert!(mean > 0.1, "{bsdf:?} {cos} {side}: {mean}");
            (least, most) = (least.min(mean), most.max(mean));
        }
    }
    println!("albedos from {least:.4} to {most:.4}");
}

/// White dielectrics, which lose only what facets lose, are nearly as white as expected.
#[test]
fn a_white_base_stays_white() {
    for roughness in [0.0, 0.05, 0.2, 0.5, 1.0] {
        for cos in [1.0f32, 0.7, 0.4, 0.2, 0.1] {
            let (mean, error) =
                albedo(&layered(|p| p.roughness = [roughness; 2]), direction(cos, 0.0), 20_000);
            assert!(mean > 0.985 - 4.0 * error, "{roughness} {cos}: {mean} +- {error}");
        }
    }
}

#[test]
fn reciprocity() {
    let mut rng = Rng::new(33, Stream::Measure, 0);
    let mut compared = 0;
    for bsdf in models() {
        for _ in 0..500 {
            let a = direction(0.02 + 0.98 * rng.next_f32(), 6.0 * rng.next_f32());
            let mut b = direction(0.02 + 0.98 * rng.next_f32(), 6.0 * rng.next_f32());
            let passes = rng.next_f32() < 0.5;
            if passes {
                b.z = -b.z;
            }
            let sum =
                |wo, wi, mode| bsdf.eval(Lobe::Diffuse, wo, wi, mode) + bsdf.eval(Lobe::Glossy, wo, wi, mode);
            // A sheet is turned to the side from which the light comes.
            let turned = passes && !is_interface(&bsdf);
            let (back_o, back_i) = if turned { (-b, -a) } else { (b, a) };
            let back_turn = |w: Vec3| if turned { Vec3::new(-w.x, -w.y, w.z) } else { w };
            let (there, back) = (sum(a, b, RADIANCE), sum(back_turn(back_o), back_turn(back_i), FLUX));
            let off = (there - back).abs().max_element();
            let largest = there.max_element();
            let is_close = off <= 1e-3 * largest + 1e-6;
            // Close to the critical angle, the transmission is the root of a difference that f32 represents to 1e-7.
            assert!(is_close || passes && off < 0.1 * largest, "{bsdf:?} {a} {b}: {there} {back}");
            compared += u32::from(there != Rgb::ZERO);
        }
    }
    assert!(compared > 10_000, "{compared}");
}

#[test]
fn lobes_are_classed_by_their_own_roughness() {
    let has = |bsdf: Bsdf| (bsdf.has_diffuse(), bsdf.has_glossy(), bsdf.has_specular(), bsdf.is_delta());
    assert_eq!(has(layered(|p| p.roughness = [0.5; 2])), (true, false, false, false));
    assert_eq!(has(layered(|p| p.roughness = [0.1; 2])), (true, true, false, false));
    assert_eq!(has(layered(|p| p.roughness = [0.0; 2])), (true, false, true, false));
    assert_eq!(has(layered(|p| (p.roughness, p.metallic) = ([0.5; 2], 1.0))), (true, false, false, false));
    assert_eq!(has(layered(|p| (p.roughness, p.metallic) = ([0.0; 2], 1.0))), (false, false, true, true));
    assert_eq!(has(layered(|p| (p.roughness, p.coat) = ([0.5; 2], 1.0))), (true, false, true, false));
    let glass =
        |roughness, body| layered(|p| (p.roughness, p.transmission, p.body) = ([roughness; 2], 1.0, body));
    assert_eq!(has(glass(0.0, Body::Thin)), (false, false, true, true));
    assert_eq!(has(glass(0.9, Body::Thin)), (false, true, false, false));
    assert_eq!(has(glass(0.0, interface(1.5))), (false, false, true, true));
    assert_eq!(has(glass(0.9, interface(1.5))), (false, true, false, false));
    // With an index of one and without the term at grazing angles, the model is only a filter.
    let filter = layered(|p| {
        (p.roughness, p.transmission, p.body, p.ior) = ([0.0; 2], 1.0, Body::Thin, 1.0);
        p.base = Rgb::new(0.1, 0.5, 0.9);
    });
    for cos in [1.0, 0.3, 0.01] {
        let wo = direction(cos, 1.0);
        let sample = filter.sample(wo, 0.3, Vec2::ZERO, RADIANCE).unwrap();
        assert_eq!((sample.wi, sample.throughput), (-wo, Rgb::new(0.1, 0.5, 0.9)));
    }
}

#[test]
fn white_glass_is_the_dielectric() {
    let smooth = Dielectric::new(1.0, 1.5);
    let ours = layered(|p| (p.roughness, p.transmission, p.body) = ([0.0; 2], 1.0, Body::Interface(smooth)));
    let theirs = Bsdf::Dielectric(smooth);
    let rough = layered(|p| (p.roughness, p.transmission, p.body) = ([0.3; 2], 1.0, Body::Interface(smooth)));
    let known = Bsdf::RoughDielectric(RoughDielectric::new(smooth, 0.3).unwrap());
    let mut rng = Rng::new(34, Stream::Measure, 0);
    for _ in 0..2000 {
        let wo = direction(2.0 * rng.next_f32() - 1.0, 6.0 * rng.next_f32());
        let (u, mode) = (rng.next_f32(), if rng.next_f32() < 0.5 { RADIANCE } else { FLUX });
        let p = theirs.reflection_probability(wo);
        assert!((ours.reflection_probability(wo) - p).abs() < 1e-6);
        if (u - p).abs() > 1e-5 {
            let (a, b) = (ours.sample(wo, u, Vec2::ZERO, mode), theirs.sample(wo, u, Vec2::ZERO, mode));
            let (a, b) = (a.unwrap(), b.unwrap());
            assert_eq!((a.wi, a.transmission), (b.wi, b.transmission));
            assert!((a.throughput - b.throughput).abs().max_element() < 1e-5, "{a:?} {b:?}");
        }
        let wi = direction(2.0 * rng.next_f32() - 1.0, 6.0 * rng.next_f32());
        let (a, b) = (rough.eval(Lobe::Glossy, wo, wi, mode), known.eval(Lobe::Glossy, wo, wi, mode));
        assert!((a - b).abs().max_element() <= 1e-4 * b.max_element(), "{a} {b}");
        let (a, b) =
            (rough.pdf_solid_angle(Lobe::Glossy, wo, wi), known.pdf_solid_angle(Lobe::Glossy, wo, wi));
        assert!((a - b).abs() <= 1e-4 * b, "{a} {b}");
    }
}

/// For all parameters: no NaN, unit directions, positive weights.
#[test]
fn extremes() {
    let us = [0.0, 0.25, 0.75, ONE_MINUS_EPSILON];
    let mut models = models();
    models.extend(smooth_models());
    for odd in [f32::NAN, f32::INFINITY, -1.0, 1e-8, 1e-4] {
        models.push(layered(|p| (p.roughness, p.metallic, p.base) = ([odd; 2], odd, Rgb::splat(odd))));
        models.push(layered(|p| (p.ior, p.specular, p.coat, p.coat_roughness) = (odd, odd, odd, odd)));
    }
    for bsdf in &models {
        for cos in [1.0f32, 0.5, 1e-4, 1e-20, 1e-45, 0.0, -0.5, f32::NAN] {
            let wo = direction(cos, 0.7);
            for u in us.into_iter().flat_map(|x| us.map(|y| Vec2::new(x, y))) {
                for (u_lobe, mode) in us.into_iter().flat_map(|u| [(u, FLUX), (u, RADIANCE)]) {
                    let Some(sample) = bsdf.sample(wo, u_lobe, u, mode) else { continue };
                    let context = || format!("{bsdf:?} {wo} {u_lobe} {u} {mode:?}: {sample:?}");
                    assert!((sample.wi.length() - 1.0).abs() < 1e-6, "{}", context());
                    assert!(sample.throughput.is_finite(), "{}", context());
                    assert!(sample.throughput.min_element() >= 0.0, "{}", context());
                    assert!(sample.pdf_solid_angle > 0.0, "{}", context());
                }
            }
        }
    }
}
