//! Tests of the glossy models: density, energy, reciprocity, and the smooth limit.

use super::chi_square::ChiSquare;
use super::tests::direction;
use super::*;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Stream};
use glam::Vec2;
use std::f64::consts::PI;

const RADIANCE: TransportMode = TransportMode::Radiance;
const FLUX: TransportMode = TransportMode::Flux;
const WHITE: Metal = Metal::Colour(Rgb::ONE);

fn metal(metal: Metal, along: f32, across: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(metal, [along, across]))
}

fn glass(ior: f64, roughness: f32) -> Bsdf {
    Bsdf::RoughDielectric(RoughDielectric::new(Dielectric::new(1.0, ior), roughness).unwrap())
}

fn ward(along: f32, across: f32, form: Form) -> Bsdf {
    Bsdf::Ward(Ward::new(Rgb::splat(0.3), Rgb::splat(0.7), [along, across], form))
}

fn schlick(roughness: f32, isotropy: f32, form: Form) -> Bsdf {
    Bsdf::Schlick(Schlick::new(Rgb::splat(0.6), roughness, isotropy, form))
}

/// One model of each kind, on both sides of the threshold.
fn models() -> Vec<Bsdf> {
    let mut models = vec![
        metal(METALS[2].1, 0.2, 0.2),
        metal(METALS[1].1, 0.5, 0.15),
        metal(WHITE, 0.8, 0.8),
        glass(1.5, 0.4),
        glass(1.33, 0.7),
        glass(1.0 / 1.5, 0.3),
    ];
    for form in [Form::Bounded, Form::Printed] {
        models.extend([
            ward(0.2, 0.2, form),
            ward(0.4, 0.15, form),
            ward(0.5, 0.5, form),
            schlick(0.06, 1.0, form),
            schlick(0.1, 0.3, form),
            schlick(0.6, 1.0, form),
            schlick(0.6, 0.2, form),
        ]);
    }
    models
}

#[test]
fn samples_follow_the_density() {
    let models = models();
    let wos = [direction(1.0, 0.0), direction(0.6, 1.0), direction(0.15, 4.0), direction(-0.7, 2.0)];
    let lobes = [Lobe::Diffuse, Lobe::Glossy];
    let runs = (models.len() * wos.len() * lobes.len()) as u32;
    for (seed, bsdf) in models.iter().enumerate() {
        for (wo, lobe) in wos.into_iter().flat_map(|wo| lobes.map(|lobe| (wo, lobe))) {
            if bsdf.lobe_albedo(lobe, wo) == Rgb::ZERO
                || !matches!(bsdf, Bsdf::RoughDielectric(_)) && wo.z < 0.0
            {
                continue;
            }
            let test = ChiSquare { bins: [64, 32], samples: 50_000, runs, seed: seed as u64 };
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
    let mut rng = Rng::new(21, Stream::Measure, 0);
    let mut models = models();
    models.extend([
        metal(WHITE, 0.02, 0.02),
        glass(1.5, 0.02),
        ward(0.02, 0.05, Form::Bounded),
        schlick(0.0004, 1.0, Form::Bounded),
    ]);
    for bsdf in models {
        for lobe in [Lobe::Diffuse, Lobe::Glossy] {
            for _ in 0..2000 {
                let wo = direction(0.05 + 0.95 * rng.next_f32(), 6.0 * rng.next_f32());
                let mode = if rng.next_f32() < 0.5 { RADIANCE } else { FLUX };
                let Some(sample) = bsdf.sample_lobe(lobe, wo, rng.next_f32(), rng.next_2d(), mode) else {
                    continue;
                };
                assert_eq!(sample.pdf_solid_angle, bsdf.pdf_solid_angle(lobe, wo, sample.wi));
                assert_eq!(sample.lobe, lobe);
                assert_eq!(sample.transmission, sample.wi.z * wo.z < 0.0);
                let want =
                    bsdf.eval(lobe, wo, sample.wi, mode) * (sample.wi.z.abs() / sample.pdf_solid_angle);
                let off = (sample.throughput - want).abs().max_element();
                // Near its critical angle a refraction is as ill-conditioned as Fresnel's formula.
                let bound = 5e-3 * want.max_element() + 1e-3;
                assert!(off < bound, "{bsdf:?} {wo}: {sample:?}, not {want}");
            }
        }
    }
}

/// Mean throughput over samples of [`Bsdf::sample`], in flux, and its standard error.
fn albedo(bsdf: &Bsdf, wo: Vec3, samples: u64) -> (f64, f64) {
    let mut rng = Rng::new(22, Stream::Measure, u64::from(wo.z.to_bits()));
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

const COSINES: [f32; 7] = [1.0, 0.7, 0.4, 0.2, 0.1, 0.03, 1e-3];

/// The same by quadrature of `f cos` over the half vector's stretched slopes, without the sampler.
fn albedo_by_eval(bsdf: &Bsdf, wo: Vec3) -> f64 {
    // Directions in even steps of cosine and azimuth.
    let (rows, columns) = (500, 360);
    let mut sum = 0.0;
    for i in 0..rows {
        let cos = (i as f32 + 0.5) / rows as f32;
        for j in 0..columns {
            let wi = direction(cos, std::f32::consts::TAU * (j as f32 + 0.5) / columns as f32);
            let f = bsdf.eval(Lobe::Diffuse, wo, wi, FLUX) + bsdf.eval(Lobe::Glossy, wo, wi, FLUX);
            sum += f64::from(f.x * cos);
        }
    }
    2.0 * PI * sum / f64::from(rows * columns)
}

#[test]
fn white_furnace_of_bounded_models() {
    let mut bsdfs = vec![];
    for alpha in [0.0, 0.03, 0.3, 1.0] {
        bsdfs.extend([metal(WHITE, alpha, alpha), metal(WHITE, alpha, 0.3 * alpha)]);
        if alpha > 0.0 {
            let white = |along, across| Ward::new(Rgb::ZERO, Rgb::ONE, [along, across], Form::Bounded);
            bsdfs.extend([Bsdf::Ward(white(alpha, alpha)), Bsdf::Ward(white(alpha, 0.2 * alpha))]);
            bsdfs.extend([glass(1.5, alpha), glass(0.6, alpha)]);
        }
        for (r, p) in [(alpha, 1.0), (alpha, 0.3), (alpha, 0.01)] {
            bsdfs.push(Bsdf::Schlick(Schlick::new(Rgb::ONE, r, p, Form::Bounded)));
        }
    }
    for bsdf in &bsdfs {
        for (cos, phi) in COSINES.into_iter().flat_map(|cos| [(cos, 0.0), (cos, 1.5)]) {
            let (mean, error) = albedo(bsdf, direction(cos, phi), 20_000);
            assert!(mean < 1.0 + 4.0 * error + 1e-5, "{bsdf:?} {cos} {phi}: {mean} +- {error}");
            assert!(mean > 0.2, "{bsdf:?} {cos}: {mean}");
        }
    }
}

/// Claims of the doc comments about the printed formulas: their albedo exceeds one, at about these angles.
#[test]
fn printed_forms_exceed_one() {
    let ward = |alpha| Bsdf::Ward(Ward::new(Rgb::ZERO, Rgb::ONE, [alpha; 2], Form::Printed));
    let schlick = |r| Bsdf::Schlick(Schlick::new(Rgb::ONE, r, 1.0, Form::Printed));
    for (bsdf, cosine) in [(ward(0.2), 1e-4), (schlick(0.1), 0.09)] {
        let (mean, error) = albedo(&bsdf, direction(cosine, 0.0), 100_000);
        println!("{bsdf:?} at cosine {cosine}: {mean:.4} +- {error:.4}");
        assert!(mean > 1.05, "{bsdf:?}: {mean}");
    }
    // Ward's printed form already loses light at 60 degrees.
    let (mean, error) = albedo(&ward(0.02), direction(0.5, 0.0), 100_000);
    assert!((mean - 0.5).abs() < 0.01 + 4.0 * error, "{mean}");
}

#[test]
fn albedo_of_samples_is_that_of_values() {
    for bsdf in [
        metal(WHITE, 0.3, 0.3),
        metal(WHITE, 0.6, 0.2),
        ward(0.3, 0.3, Form::Bounded),
        ward(0.3, 0.15, Form::Printed),
        schlick(0.1, 0.3, Form::Bounded),
        schlick(0.6, 0.3, Form::Printed),
    ] {
        for (cos, phi) in [(1.0, 0.0), (0.5, 0.0), (0.2, 1.2)] {
            let wo = direction(cos, phi);
            let mirrored = bsdf.sample_lobe(Lobe::Specular, wo, 0.0, Vec2::ZERO, FLUX);
            let mirrored = mirrored.map_or(0.0, |sample| f64::from(sample.throughput.x));
            let want = albedo_by_eval(&bsdf, wo) + mirrored;
            let (mean, error) = albedo(&bsdf, wo, 100_000);
            assert!((mean - want).abs() < 4.0 * error + 1e-3, "{bsdf:?} {wo}: {mean} +- {error}, not {want}");
        }
    }
}

/// Single-scattering albedo of GGX at normal incidence. With `G2 = G1(wi)` it is an integral over the angle of the facet, computed here
/// by Simpson's rule in f64; for roughness one it is `1 - ln 2`.
fn ggx_at_normal_incidence(alpha: f64) -> f64 {
    let f = |t: f64| {
        // t: cosine of the facet, from 1/sqrt(2), where the reflected ray grazes the surface.
        let (a2, c) = (alpha * alpha, 2.0 * t * t - 1.0);
        let d = a2 / (PI * ((a2 - 1.0) * t * t + 1.0).powi(2));
        let g1 = 2.0 * c / (c + (c * c + a2 * (1.0 - c * c)).sqrt());
        2.0 * PI * d * t * g1
    };
    let (from, n) = (0.5f64.sqrt(), 20_000);
    let h = (1.0 - from) / f64::from(n);
    let weight = |i: i32| {
        if i == 0 || i == n {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        }
    };
    (0..=n).map(|i| weight(i) * f(from + h * f64::from(i))).sum::<f64>() * h / 3.0
}

#[test]
fn ggx_loses_what_is_known() {
    assert!((ggx_at_normal_incidence(1.0) - (1.0 - 2f64.ln())).abs() < 1e-9);
    for alpha in [0.1, 0.25, 0.5, 0.75, 1.0] {
        let (mean, error) = albedo(&metal(WHITE, alpha, alpha), Vec3::Z, 400_000);
        let want = ggx_at_normal_incidence(f64::from(alpha));
        println!("roughness {alpha}: {mean:.5} +- {error:.5}, want {want:.5}");
        assert!((mean - want).abs() < 4.0 * error, "{alpha}: {mean} +- {error}, not {want}");
    }
}

#[test]
fn reciprocity() {
    let mut rng = Rng::new(23, Stream::Measure, 0);
    let (mut compared, mut critical) = (0, 0);
    for bsdf in models() {
        for _ in 0..1000 {
            let a = direction(0.02 + 0.98 * rng.next_f32(), 6.0 * rng.next_f32());
            let mut b = direction(0.02 + 0.98 * rng.next_f32(), 6.0 * rng.next_f32());
            if matches!(bsdf, Bsdf::RoughDielectric(_)) && rng.next_f32() < 0.5 {
                b.z = -b.z;
            }
            // The adjoint: what radiance undergoes in one direction, flux undergoes in the other (Veach 1997, section 5.2).
            let sum =
                |wo, wi, mode| bsdf.eval(Lobe::Diffuse, wo, wi, mode) + bsdf.eval(Lobe::Glossy, wo, wi, mode);
            let (there, back) = (sum(a, b, RADIANCE), sum(b, a, FLUX));
            let off = (there - back).abs().max_element();
            // Where a facet refracts at the critical angle, the transmission is the root of a difference that f32 represents to 1e-7.
            // Few pairs meet such a facet, and they have errors of a few percent.
            let (largest, is_close) = (there.max_element(), off <= 3e-4 * there.max_element() + 1e-6);
            assert!(is_close || a.z * b.z < 0.0 && off < 0.1 * largest, "{bsdf:?} {a} {b}: {there} {back}");
            critical += u32::from(!is_close);
            compared += u32::from(there != Rgb::ZERO);
        }
    }
    assert!(compared > 10_000 && critical < 20, "{compared} {critical}");
}

/// As roughness goes to zero there is no NaN and no weight above one, and directions converge to the mirrored and the refracted one.
#[test]
fn smooth_limit() {
    let us = [0.0, 1e-7, 0.25, 0.5, 0.75, 0.99, ONE_MINUS_EPSILON];
    for alpha in [0.0f32, 1e-8, 1e-4, 1e-3] {
        let smooth = Dielectric::new(1.0, 1.5);
        let rough = RoughDielectric::new(smooth, alpha);
        let bsdfs = [
            metal(WHITE, alpha, alpha),
            metal(METALS[2].1, alpha, 0.5),
            rough.map_or(Bsdf::Dielectric(smooth), Bsdf::RoughDielectric),
            Bsdf::Schlick(Schlick::new(Rgb::splat(0.5), alpha * alpha, 1.0, Form::Bounded)),
            Bsdf::Schlick(Schlick::new(Rgb::splat(0.5), alpha, 0.1, Form::Bounded)),
            ward(alpha, alpha, Form::Bounded),
        ];
        assert_eq!(bsdfs[0].is_delta(), alpha < 1e-4);
        assert_eq!(bsdfs[2].is_delta(), alpha < 1e-4);
        for (number, bsdf) in bsdfs.iter().enumerate() {
            for cos in [1.0f32, 0.5, 1e-2, 1e-4, 1e-6, 1e-20, 1e-38, 1e-45, 0.0, -0.5, f32::NAN] {
                let wo = direction(cos, 0.7);
                for u in us.into_iter().flat_map(|x| us.map(|y| Vec2::new(x, y))) {
                    for (u_lobe, mode) in us.into_iter().flat_map(|u| [(u, FLUX), (u, RADIANCE)]) {
                        let Some(sample) = bsdf.sample(wo, u_lobe, u, mode) else { continue };
                        let context = || format!("{bsdf:?} {wo} {u_lobe} {u} {mode:?}: {sample:?}");
                        assert!((sample.wi.length() - 1.0).abs() < 1e-6, "{}", context());
                        assert!(sample.throughput.is_finite(), "{}", context());
                        assert!(sample.throughput.min_element() >= 0.0, "{}", context());
                        assert!(sample.pdf_solid_angle > 0.0, "{}", context());
                        for lobe in [Lobe::Diffuse, Lobe::Glossy] {
                            assert!(bsdf.eval(lobe, wo, sample.wi, mode).is_finite(), "{}", context());
                            let pdf = bsdf.pdf_solid_angle(lobe, wo, sample.wi);
                            assert!(pdf.is_finite() && pdf >= 0.0, "{}", context());
                        }
                        // All samples except for the tail of the lobe.
                        let is_narrow =
                            matches!(number, 0 | 2 | 3) && u.max_element() < 0.95 && alpha <= 1e-4;
                        if is_narrow && cos > 1e-3 {
                            let ideal = match sample.transmission {
                                true => refract(wo, 1.5).unwrap(),
                                false => reflect(wo),
                            };
                            assert!((sample.wi - ideal).length() < 0.1, "{} {ideal}", context());
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn metals_reflect_what_was_measured() {
    // Reflectance at normal incidence in Rec. 709 under D65, of the spectra to which the indices were fitted.
    let want = [
        ("aluminium", [0.9073, 0.9159, 0.9223]),
        ("copper", [0.9317, 0.6227, 0.5223]),
        ("gold", [0.98, 0.7284, 0.3646]),
        ("silver", [0.9894, 0.9840, 0.9778]),
    ];
    for ((name, metal), (same, want)) in METALS.iter().zip(want) {
        assert_eq!(*name, same);
        let off = (metal.reflectance(1.0) - Rgb::from_array(want)).abs().max_element();
        assert!(off < 0.004, "{name}: {}", metal.reflectance(1.0));
        assert!((metal.reflectance(0.0) - Rgb::ONE).abs().max_element() < 1e-6);
    }
    // Without absorption the result is that of the dielectric.
    for cos in [1.0f32, 0.7, 0.3, 0.05] {
        assert!((fresnel_conductor(cos, 1.5, 0.0) - fresnel_dielectric(cos, 1.5)).abs() < 2e-6);
    }
    for cos in [0.0, 1e-38, 1e-6, 0.5, 1.0, f32::NAN] {
        for (eta, k) in [(1e-3, 0.0), (1e-3, 1e3), (1e4, 1e4), (1.0, 0.0)] {
            assert!((0.0..=1.0).contains(&fresnel_conductor(cos, eta, k)), "{cos} {eta} {k}");
        }
    }
}

#[test]
fn lobes_by_roughness() {
    let lobes = |bsdf: Bsdf| [bsdf.has_diffuse(), bsdf.has_glossy(), bsdf.has_specular()];
    assert_eq!(lobes(metal(WHITE, 0.0, 0.0)), [false, false, true]);
    assert_eq!(lobes(metal(WHITE, 0.1, 0.1)), [false, true, false]);
    assert_eq!(lobes(metal(WHITE, 0.4, 0.1)), [false, true, false]);
    assert_eq!(lobes(metal(WHITE, 0.4, 0.4)), [true, false, false]);
    assert_eq!(lobes(ward(0.1, 0.1, Form::Bounded)), [true, true, false]);
    assert_eq!(lobes(ward(0.5, 0.5, Form::Bounded)), [true, false, false]);
    assert_eq!(lobes(schlick(0.0, 1.0, Form::Bounded)), [false, false, true]);
    // The sphere flake and the sand of Jensen 1996.
    assert_eq!(lobes(schlick(0.1, 1.0, Form::Bounded)), [false, true, true]);
    assert_eq!(lobes(schlick(0.6, 1.0, Form::Bounded)), [true, false, false]);
    assert_eq!(lobes(glass(1.5, 0.9)), [false, true, false]);
    for bsdf in models() {
        for lobe in [Lobe::Diffuse, Lobe::Glossy, Lobe::Specular] {
            let has = lobes(bsdf)[lobe as usize];
            for cos in [1.0, 0.5, 1e-6] {
                assert_eq!(
                    bsdf.lobe_albedo(lobe, direction(cos, 0.0)) != Rgb::ZERO,
                    has,
                    "{bsdf:?} {lobe:?}"
                );
            }
        }
    }
}
