//! Trackers against closed forms.

use super::*;
use crate::math::Bounds3;
use crate::media::density::{BoundedField, GridBuilder, HeightFog, Smooth};
use crate::media::{Coefficients, Phase};
use crate::sampling::Stream;
use glam::{DAffine3, IVec3, UVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Means of what is added, by channel, with their standard errors.
#[derive(Default)]
struct Mean {
    count: f64,
    sum: DVec3,
    squares: DVec3,
}

impl Mean {
    fn add(&mut self, value: Rgb) {
        let value = value.as_dvec3();
        assert!(value.is_finite(), "{value}");
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> DVec3 {
        self.sum / self.count
    }

    fn error(&self) -> DVec3 {
        let variance = self.squares / self.count - self.mean() * self.mean();
        (variance.max(DVec3::ZERO) / self.count).map(f64::sqrt)
    }

    /// Wrong once in 10^5 where the mean is as `expected`.
    fn check(&self, expected: DVec3, what: &str) {
        let off = (self.mean() - expected).abs();
        let allowed = self.error() * 4.42 + expected.abs() * 1e-6 + 1e-30;
        assert!(off.cmple(allowed).all(), "{what}: {} +- {} and not {expected}", self.mean(), self.error());
    }
}

fn rng(index: u64) -> Rng {
    Rng::new(21, Stream::Measure, index)
}

fn coefficients(absorption: [f32; 3], scattering: [f32; 3]) -> Coefficients {
    Coefficients::new(Rgb::from_array(absorption), Rgb::from_array(scattering)).unwrap()
}

fn of(coefficients: Coefficients, density: Density) -> Volume {
    Volume::new(coefficients, Phase::Isotropic, density)
}

fn along_x(y: f64) -> Line {
    Line::new(DVec3::new(-2.0, y, 0.0), DVec3::X).unwrap()
}

/// Density 1 - r in the unit sphere.
fn cone() -> Density {
    let bounds = Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let field = Smooth { value: |p: DVec3| 1.0 - p.length(), slope: 1.0 };
    Density::Field(Arc::new(BoundedField::new(field, bounds, UVec3::splat(12)).unwrap()))
}

/// 1 + cos(2 pi k x) over -1 <= x <= 1: bounds in `cells` along x.
fn waves(k: f64, cells: u32) -> Density {
    let bounds = Bounds3 { min: DVec3::new(-1.0, -0.35, -0.35), max: DVec3::new(1.0, 0.35, 0.35) };
    let field = Smooth { value: move |p: DVec3| 1.0 + (TAU * k * p.x).cos(), slope: TAU * k };
    Density::Field(Arc::new(BoundedField::new(field, bounds, UVec3::new(cells, 8, 8)).unwrap()))
}

/// 1 + x/31 at the centres of 32^3 voxels of 0.1.
fn ramp() -> Density {
    let mut builder = GridBuilder::default();
    builder.dense(IVec3::ZERO, IVec3::splat(32), |v| 1.0 + v.x as f32 / 31.0).unwrap();
    let scale = DAffine3::from_scale(DVec3::splat(0.1));
    Density::Grid(Arc::new(builder.finish(scale).unwrap().0))
}

/// Transmittance by flights and by ratio tracking, of `sigma` through `density`.
fn check_transmittance(volume: &Volume, line: &Line, t_max: f64, expected: DVec3, what: &str) {
    let mut rng = rng(1);
    let (mut escaped, mut all, mut passed) = (Mean::default(), Mean::default(), Mean::default());
    for _ in 0..60_000 {
        let flight = volume.fly(line, t_max, Rgb::ONE, Losses::Sampled, &mut rng);
        match flight.end {
            End::Escaped { weight } => {
                escaped.add(weight);
                all.add(weight);
            }
            End::Scattered { t, weight } | End::Absorbed { t, weight } => {
                assert!((0.0..=t_max).contains(&t));
                escaped.add(Rgb::ZERO);
                all.add(weight);
            }
        }
        let estimate = volume.transmittance(line, t_max, &mut rng);
        assert!(estimate.min_element() >= 0.0 && estimate.max_element() <= 1.0);
        passed.add(estimate);
    }
    escaped.check(expected, &format!("{what}, flights"));
    all.check(DVec3::ONE, &format!("{what}, all ends"));
    passed.check(expected, &format!("{what}, ratio tracking"));
}

#[test]
fn a_kind_of_no_probability_is_never_taken() {
    let kinds = |rates: [f64; 4]| {
        [(Kind::Absorb, rates[0]), (Kind::Scatter, rates[1]), (Kind::Emit, rates[2]), (Kind::Null, rates[3])]
    };
    let ends = [0.0, f64::MIN_POSITIVE, 0.3, 1.0 - f64::EPSILON / 2.0];
    for u in ends {
        assert_eq!(Kind::pick(kinds([0.0, 1e-300, 0.0, 0.0]), u), Kind::Scatter);
        assert_eq!(Kind::pick(kinds([-1e-17, 1.0, f64::NAN, -1.0]), u), Kind::Scatter);
        assert_eq!(Kind::pick(kinds([0.0, 0.0, 0.0, 3.0]), u), Kind::Null);
        assert_eq!(Kind::pick(kinds([2.0, 0.0, 0.0, 0.0]), u), Kind::Absorb);
        assert_ne!(Kind::pick(kinds([0.1, 0.0, 0.2, 0.7]), u), Kind::Scatter);
        assert_ne!(Kind::pick(kinds([0.1, 0.2, 0.7, 0.0]), u), Kind::Null);
    }
    // In proportion.
    let mut rng = rng(2);
    let mut counts = [0.0; 4];
    for _ in 0..100_000 {
        counts[Kind::pick(kinds([1.0, 2.0, 3.0, 4.0]), rng.next_f64()) as usize] += 1.0;
    }
    for (at, count) in counts.into_iter().enumerate() {
        let p = 0.1 * (at + 1) as f64;
        assert!((count - 1e5 * p).abs() < 4.5 * (1e5 * p * (1.0 - p)).sqrt(), "{counts:?}");
    }
    // And in flights: no absorption at albedo one, no scattering at zero, in densities with null collisions.
    for (absorb, scatter) in [(0.0, 5.0), (5.0, 0.0)] {
        let volume = of(coefficients([absorb; 3], [scatter; 3]), cone());
        for _ in 0..30_000 {
            match volume.fly(&along_x(0.1), 4.0, Rgb::ONE, Losses::Sampled, &mut rng).end {
                End::Absorbed { .. } => assert!(absorb > 0.0),
                End::Scattered { .. } => assert!(scatter > 0.0),
                End::Escaped { weight } => assert_eq!(weight, Rgb::ONE),
            }
        }
    }
}

#[test]
fn transmittances_in_closed_form() {
    let grey = coefficients([1.0; 3], [2.0; 3]);
    let unit = coefficients([0.25; 3], [0.75; 3]);
    let all = DVec3::splat;
    let one = of(unit, Density::Homogeneous);
    check_transmittance(&one, &along_x(0.0), 1.5, all((-1.5f64).exp()), "homogeneous");
    let sphere = of(grey, cone());
    check_transmittance(&sphere, &along_x(0.0), 4.0, all(0.049_787_07), "sphere, through the centre");
    check_transmittance(&sphere, &along_x(0.5), 4.0, all(0.199_816_11), "sphere, impact 0.5");
    let through = Line::new(DVec3::new(0.0, 1.55, 1.55), DVec3::X).unwrap();
    check_transmittance(&of(unit, ramp()), &through, 3.1, all(0.009_561_60), "ramp");
    for (k, cells) in [(1.0, 64), (3.0, 40), (5.0, 20)] {
        let line = Line::new(DVec3::new(-1.0, 0.2, 0.3), DVec3::X).unwrap();
        check_transmittance(&of(unit, waves(k, cells)), &line, 2.0, all((-2.0f64).exp()), "waves");
    }
    let fog = Density::Height(HeightFog::new(DVec3::Y, 0.0, 1.0).unwrap());
    let slant = Line::new(DVec3::ZERO, DVec3::new(3f64.sqrt(), 1.0, 0.0)).unwrap();
    check_transmittance(&of(unit, fog.clone()), &slant, f64::INFINITY, all(0.135_335_28), "atmosphere");
    check_transmittance(&of(unit, fog), &slant, 2.0, all(0.282_453_56), "atmosphere, to its scale height");
}

#[test]
fn channels_of_very_different_extinction() {
    // 1 : 30 : 1000, with absorption in one and scattering in the other.
    let chromatic = coefficients([0.001, 0.0, 0.5], [0.0, 0.03, 0.5]);
    let expected = |depth: f64| DVec3::new((-0.001 * depth).exp(), (-0.03 * depth).exp(), (-depth).exp());
    let homogeneous = of(chromatic, Density::Homogeneous);
    check_transmittance(&homogeneous, &along_x(0.0), 3.0, expected(3.0), "homogeneous");
    check_transmittance(&of(chromatic, cone()), &along_x(0.0), 4.0, expected(1.0), "sphere");
    let through = Line::new(DVec3::new(0.0, 1.55, 1.55), DVec3::X).unwrap();
    check_transmittance(&of(chromatic, ramp()), &through, 3.1, expected(4.65), "ramp");
    let fog = Density::Height(HeightFog::new(DVec3::Y, 0.0, 2.0).unwrap());
    let up = Line::new(DVec3::ZERO, DVec3::Y).unwrap();
    check_transmittance(&of(chromatic, fog), &up, f64::INFINITY, expected(2.0), "atmosphere");
}

#[test]
fn the_balance_bounds_the_weights_of_thin_channels() {
    // Extinction 0.1 against 1 on an endless line: drawn by the dense channel alone the second moment is infinite.
    let volume = of(coefficients([0.0; 3], [0.1, 1.0, 0.0]), Density::Homogeneous);
    let mut rng = rng(3);
    let (mut weights, mut squares) = (Mean::default(), Mean::default());
    for _ in 0..400_000 {
        let throughput = Rgb::new(1.0, 1.0, 0.0);
        let flight = volume.fly(&along_x(0.0), f64::INFINITY, throughput, Losses::Weighted, &mut rng);
        let End::Scattered { weight, .. } = flight.end else { panic!("{flight:?}") };
        assert!(weight.x <= 2.0 && weight.y <= 2.0 && weight.z == 0.0, "{weight}");
        weights.add(weight);
        squares.add(weight * weight);
    }
    weights.check(DVec3::new(1.0, 1.0, 0.0), "weights");
    assert!((squares.mean().x - 1.56).abs() < 0.01, "{}", squares.mean());
}

/// Mean of `f(t)` over real collisions against the quadrature of `sigma rho T f`.
fn check_collisions(volume: &Volume, line: &Line, t_max: f64, losses: Losses) {
    let f = |t: f64| (3.0 * t).sin() + 0.1 * t;
    let steps = 20_000;
    let width = t_max / f64::from(steps);
    let (mut depth, mut scattered, mut absorbed) = (0.0, DVec3::ZERO, DVec3::ZERO);
    let (a, s) =
        (volume.coefficients().absorption().as_dvec3(), volume.coefficients().scattering().as_dvec3());
    for i in 0..steps {
        let t = (f64::from(i) + 0.5) * width;
        let density = volume.density().at(line.at(t));
        let here = left(a + s, depth + 0.5 * density * width) * (density * width * f(t));
        scattered += here * s;
        absorbed += here * a;
        depth += density * width;
    }
    if losses == Losses::Weighted {
        scattered += absorbed;
        absorbed = DVec3::ZERO;
    }
    let mut rng = rng(4);
    let (mut scatter, mut absorb) = (Mean::default(), Mean::default());
    for i in 0..60_000 {
        // Any throughput.
        let throughput = [Rgb::ONE, Rgb::new(1.0, 0.2, 3.0)][i % 2];
        let (mut s, mut a) = (Rgb::ZERO, Rgb::ZERO);
        match volume.fly(line, t_max, throughput, losses, &mut rng).end {
            End::Scattered { t, weight } => s = weight * f(t) as f32,
            End::Absorbed { t, weight } => a = weight * f(t) as f32,
            End::Escaped { .. } => {}
        }
        scatter.add(s);
        absorb.add(a);
    }
    scatter.check(scattered, "scattered");
    absorb.check(absorbed, "absorbed");
}

#[test]
fn collisions_lie_where_they_should() {
    let chromatic = coefficients([0.1, 1.0, 0.4], [0.9, 0.2, 3.0]);
    let fog = Density::Height(HeightFog::new(DVec3::new(0.3, 1.0, 0.0), 0.1, 0.7).unwrap());
    for density in [Density::Homogeneous, cone(), waves(2.0, 8), fog] {
        for losses in [Losses::Sampled, Losses::Weighted] {
            check_collisions(&of(chromatic, density.clone()), &along_x(0.3), 4.0, losses);
        }
    }
    let line = Line::new(DVec3::new(-0.5, 0.7, 1.0), DVec3::new(1.0, 0.3, 0.2)).unwrap();
    check_collisions(&of(chromatic, ramp()), &line, 5.0, Losses::Sampled);
}

#[test]
fn emission_in_closed_form() {
    let line = along_x(0.0);
    for (depth, expected) in [(1e-6, 9.999_995e-7), (0.1, 0.095_162_582), (1.0, 0.632_120_56)] {
        let body = coefficients([2.0; 3], [0.0; 3]).with_source(Rgb::new(1.0, 10.0, 0.0)).unwrap();
        let found = of(body, Density::Homogeneous).exact_emission(&line, depth / 2.0).unwrap();
        for (value, source) in [(found.x, 1.0), (found.y, 10.0)] {
            assert!((f64::from(value) / source / expected - 1.0).abs() < 2e-7, "{depth}: {value}");
        }
        assert_eq!(found.z, 0.0);
    }
    // Without extinction it is the emission times the length, and endless lines show the source.
    let clear = coefficients([0.0; 3], [0.0; 3]).with_emission(Rgb::splat(3.0)).unwrap();
    assert_eq!(of(clear, Density::Homogeneous).exact_emission(&line, 2.0), Some(Rgb::splat(6.0)));
    let body = coefficients([2.0; 3], [2.0; 3]).with_source(Rgb::splat(1.0)).unwrap();
    let endless = of(body, Density::Homogeneous).exact_emission(&line, f64::INFINITY).unwrap();
    assert_eq!(endless, Rgb::splat(0.5));
    let dark = of(coefficients([2.0; 3], [2.0; 3]), cone());
    assert_eq!(dark.exact_emission(&line, 3.0), Some(Rgb::ZERO));
}

#[test]
fn emission_by_tracking() {
    // Through the sphere the depth of the density is 1: with the source B everything is as in a slab.
    let line = along_x(0.0);
    let all = [
        coefficients([0.1, 1.0, 5.0], [0.0; 3]),
        coefficients([0.1, 1.0, 5.0], [2.0, 0.0, 1.0]),
        coefficients([0.0, 0.001, 1.0], [1.0, 0.0, 0.0]),
    ];
    for (at, body) in all.into_iter().enumerate() {
        let emission = Rgb::new(1.0, 2.0, 0.5);
        let lit = body.with_emission(emission).unwrap();
        let expected = of(lit, Density::Homogeneous).exact_emission(&line, 1.0).unwrap().as_dvec3();
        let volume = of(lit, cone());
        for losses in [Losses::Sampled, Losses::Weighted] {
            let mut rng = rng(5);
            let (mut emitted, mut ends) = (Mean::default(), Mean::default());
            for _ in 0..100_000 {
                let flight = volume.fly(&line, 4.0, Rgb::ONE, losses, &mut rng);
                emitted.add(flight.emitted);
                let (End::Escaped { weight } | End::Scattered { weight, .. } | End::Absorbed { weight, .. }) =
                    flight.end;
                ends.add(weight);
            }
            emitted.check(expected, &format!("body {at}, {losses:?}"));
            ends.check(DVec3::ONE, &format!("body {at}, {losses:?}, all ends"));
        }
    }
}

#[test]
fn ratio_tracking_keeps_its_variance() {
    // Density 1/2 under a majorant of 1 and a minorant of 0: the worst case for its depth.
    let bounds = Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let field = Smooth { value: |_: DVec3| 0.5, slope: 0.4 };
    let loose = BoundedField::new(field, bounds, UVec3::ONE).unwrap();
    assert!((0.5..1.1).contains(&loose.majorant()));
    let density = Density::Field(Arc::new(loose));
    let line = along_x(0.0);
    for sigma in [1.0f32, 4.0, 10.0] {
        let volume = of(coefficients([0.0; 3], [sigma; 3]), density.clone());
        let expected = (-f64::from(sigma)).exp();
        let mut rng = rng(6);
        let mut passed = Mean::default();
        for _ in 0..40_000 {
            passed.add(volume.transmittance(&line, 4.0, &mut rng));
        }
        passed.check(DVec3::splat(expected), "half the majorant");
        let relative = passed.error().x * passed.count.sqrt() / expected;
        assert!(relative * relative < 1f64.exp() - 1.0, "{sigma}: {relative}");
    }
    // Where the bounds agree nothing is left to chance: the inside of a tile.
    let mut builder = GridBuilder::default();
    builder.tile(IVec3::ZERO, 128, 0.5).unwrap();
    let tile = Density::Grid(Arc::new(builder.finish(DAffine3::IDENTITY).unwrap().0));
    let volume = of(coefficients([0.0; 3], [0.1; 3]), tile);
    let line = Line::new(DVec3::splat(60.0), DVec3::X).unwrap();
    for index in 0..10 {
        let passed = volume.transmittance(&line, 40.0, &mut rng(index));
        assert!((f64::from(passed.x) - (-2.0f64).exp()).abs() < 1e-7, "{passed}");
    }
}

#[test]
fn a_flight_takes_one_number() {
    let thick = coefficients([0.5, 10.0, 100.0], [0.5, 0.0, 100.0]).with_emission(Rgb::ONE).unwrap();
    for density in [Density::Homogeneous, cone(), waves(5.0, 20), ramp()] {
        for strength in [1e-3, 1.0] {
            let volume = of(thick.per_length(strength).unwrap(), density.clone());
            for index in 0..10 {
                let mut numbers = rng(index);
                let mut alone = rng(index);
                alone.next_u64();
                volume.fly(&along_x(0.1), 4.0, Rgb::ONE, Losses::Sampled, &mut numbers);
                assert_eq!(numbers.next_u64(), alone.next_u64());
                volume.transmittance(&along_x(0.1), 4.0, &mut numbers);
                alone.next_u64();
                assert_eq!(numbers.next_u64(), alone.next_u64());
            }
        }
    }
}

#[test]
fn extremes_are_finite() {
    let spike = || {
        let mut builder = GridBuilder::default();
        builder
            .dense(IVec3::ZERO, IVec3::splat(16), |v| if v == IVec3::splat(8) { 1e6 } else { 0.0 })
            .unwrap();
        Density::Grid(Arc::new(builder.finish(DAffine3::from_scale(DVec3::splat(0.1))).unwrap().0))
    };
    let mut rng = rng(7);
    for density in [Density::Homogeneous, cone(), ramp(), spike()] {
        for scale in [0.0, 1e-30, 1e-6, 1.0, 1e3] {
            for (absorption, scattering) in [
                ([1.0, 0.0, 1e-3], [0.0, 1.0, 1.0]),
                ([0.0; 3], [1.0, 0.0, 1e-3]),
                ([1.0, 1e-6, 0.0], [0.0; 3]),
            ] {
                let body =
                    coefficients(absorption, scattering).with_emission(Rgb::new(1.0, 0.0, 1e3)).unwrap();
                let volume = of(body.per_length(scale).unwrap(), density.clone());
                let line = Line::new(DVec3::new(-2.0, 0.8, 0.8), DVec3::X).unwrap();
                for throughput in [Rgb::ONE, Rgb::X, Rgb::ZERO, Rgb::splat(1e-38), Rgb::NAN, Rgb::INFINITY] {
                    for t_max in [0.0, 1e-9, 4.0] {
                        let flight = volume.fly(&line, t_max, throughput, Losses::Sampled, &mut rng);
                        let (End::Escaped { weight }
                        | End::Scattered { weight, .. }
                        | End::Absorbed { weight, .. }) = flight.end;
                        assert!(weight.is_finite() && weight.min_element() >= 0.0, "{flight:?}");
                        assert!(flight.emitted.is_finite(), "{flight:?}");
                        let passed = volume.transmittance(&line, t_max, &mut rng);
                        assert!(passed.cmpge(Rgb::ZERO).all() && passed.cmple(Rgb::ONE).all());
                    }
                }
            }
        }
    }
    // Optical depths from 1e-6 to 1e6 end where they should.
    for tau in [1e-6f64, 1e-3, 1.0, 1e3, 1e6] {
        let volume = of(coefficients([0.0; 3], [tau as f32; 3]), Density::Homogeneous);
        let expected = -(-f64::from(tau as f32)).exp_m1();
        let count = 20_000;
        let collided = (0..count)
            .filter(|_| {
                let flight = volume.fly(&along_x(0.0), 1.0, Rgb::ONE, Losses::Sampled, &mut rng);
                matches!(flight.end, End::Scattered { .. })
            })
            .count() as f64;
        let n = f64::from(count);
        let error = (n * expected * (1.0 - expected)).sqrt();
        // Where hardly any is expected, counts are those of Poisson: three of 0.02 are one in 10^6.
        assert!((collided - n * expected).abs() < 4.5 * error + 3.0, "{tau}: {collided} of {count}");
    }
}
