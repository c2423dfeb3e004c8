//! The parts of this room together, in a small Monte-Carlo program, against tables of light in media.
//!
//! A test is wrong once in 10^5 runs: its mean may be off by 4.42 standard errors and half a unit of the last printed digit.

use super::density::{BoundedField, Density, HeightFog, Line, Smooth};
use super::{Coefficients, Distances, End, Losses, Phase, Volume};
use crate::math::{Bounds3, Rgb};
use crate::sampling::{Rng, Stream, warp};
use glam::{DVec3, UVec3, Vec3};
use std::f64::consts::TAU;
use std::sync::Arc;

const SEED: u64 = 31;

/// Means with their standard errors.
#[derive(Clone, Copy, Default)]
struct Mean {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        assert!(value.is_finite());
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    fn error(&self) -> f64 {
        ((self.squares / self.count - self.mean().powi(2)).max(0.0) / self.count).sqrt()
    }

    fn check(&self, expected: f64, digit: f64, what: &str) {
        let off = (self.mean() - expected).abs();
        let allowed = 4.42 * self.error() + digit;
        assert!(off <= allowed, "{what}: {} +- {} and not {expected}", self.mean(), self.error());
    }
}

fn volume(albedo: f32, phase: Phase, density: Density) -> Volume {
    let coefficients = Coefficients::from_albedo(Rgb::splat(albedo), Rgb::ONE).unwrap();
    Volume::new(coefficients, phase, density)
}

fn hg(g: f32) -> Phase {
    Phase::henyey_greenstein(g).unwrap()
}

/// A direction about the cosine-weighted normal +z.
fn diffuse(rng: &mut Rng) -> DVec3 {
    warp::square_to_cosine_hemisphere(rng.next_2d()).as_dvec3().normalize()
}

/// Reflectance of a border, unpolarised, from the side of index one to that of `n` at the cosine `cos` (or from within, for `1 / n`).
fn fresnel(cos: f64, n: f64) -> f64 {
    let sin2 = (1.0 - cos * cos) / (n * n);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let inner = (1.0 - sin2).sqrt();
    let [s, p] = [(cos - n * inner) / (cos + n * inner), (n * cos - inner) / (n * cos + inner)];
    0.5 * (s * s + p * p)
}

/// What became of a photon.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    /// Out where it came in.
    Reflected,
    Transmitted,
    Absorbed,
}

/// A slab 0 < z < `depth` of a medium, whose borders have the relative index `n`. Lit from z < 0.
struct Slab<'a> {
    volume: &'a Volume,
    depth: f64,
    n: f64,
}

impl Slab<'_> {
    /// The fate of a photon that has entered, with the direction `d` within the slab.
    fn photon(&self, mut d: DVec3, rng: &mut Rng) -> Fate {
        let mut z = 0.0;
        loop {
            let limit = if d.z > 0.0 { (self.depth - z) / d.z } else { -z / d.z };
            let line = Line::new(DVec3::new(0.0, 0.0, z), d).unwrap();
            match self.volume.fly(&line, limit, Rgb::X, Losses::Sampled, rng).end {
                End::Absorbed { .. } => return Fate::Absorbed,
                End::Scattered { t, .. } => {
                    z = (z + t * d.z).clamp(0.0, self.depth);
                    d = scattered(self.volume.phase(), d, rng);
                }
                End::Escaped { .. } => {
                    let out = if d.z > 0.0 { Fate::Transmitted } else { Fate::Reflected };
                    if self.n == 1.0 || rng.next_f64() >= fresnel(d.z.abs(), 1.0 / self.n) {
                        return out;
                    }
                    z = if d.z > 0.0 { self.depth } else { 0.0 };
                    d.z = -d.z;
                }
            }
        }
    }
}

/// The direction after a scattering.
fn scattered(phase: Phase, d: DVec3, rng: &mut Rng) -> DVec3 {
    phase.sample(-d.as_vec3(), rng.next_2d()).wi.as_dvec3().normalize()
}

/// Direction within the slab of light from outside along `d`, refracted.
fn refracted(d: DVec3, n: f64) -> DVec3 {
    let side = d.with_z(0.0) / n;
    side.with_z((1.0 - side.length_squared()).max(0.0).sqrt())
}

#[test]
fn slabs_reflect_and_transmit_as_printed() {
    // w, g, tau, n, R and T at normal incidence, R and T in diffuse light; without what the first border reflects.
    let rows = [
        (1.0, 0.0, 1.0, 1.0, 0.341329, 0.658671, 0.446594, 0.553406),
        (1.0, 0.0, 2.0, 1.0, 0.517515, 0.482485, 0.609940, 0.390060),
        (1.0, 0.0, 8.0, 1.0, 0.821803, 0.178197, 0.858471, 0.141529),
        (0.9, 0.0, 2.0, 1.0, 0.361649, 0.356501, 0.437147, 0.265581),
        (0.5, 0.0, 1.0, 1.0, 0.099119, 0.446058, 0.134165, 0.306709),
        (0.9, 0.75, 2.0, 1.0, 0.097395, 0.660958, 0.191090, 0.501816),
        (1.0, 0.75, 4.0, 1.0, 0.311639, 0.688361, 0.450056, 0.549944),
        (0.9, -0.5, 2.0, 1.0, 0.462772, 0.276072, 0.518379, 0.195532),
        (1.0, 0.0, 2.0, 1.5, 0.449010, 0.510990, 0.444229, 0.463994),
        (0.9, 0.0, 2.0, 1.5, 0.213076, 0.288799, 0.211993, 0.246777),
        (0.99, 0.0, 8.0, 1.5, 0.545637, 0.148106, 0.525309, 0.134822),
    ];
    for (at, (w, g, tau, n, r_normal, t_normal, r_diffuse, t_diffuse)) in rows.into_iter().enumerate() {
        let volume = volume(w, hg(g), Density::Homogeneous);
        let slab = Slab { volume: &volume, depth: tau, n };
        for (is_diffuse, expected) in [(false, (r_normal, t_normal)), (true, (r_diffuse, t_diffuse))] {
            let mut rng = Rng::new(SEED, Stream::Measure, at as u64 * 2 + u64::from(is_diffuse));
            let (mut r, mut t) = (Mean::default(), Mean::default());
            for _ in 0..20_000 {
                let outside = if is_diffuse { diffuse(&mut rng) } else { DVec3::Z };
                let enters = n == 1.0 || rng.next_f64() >= fresnel(outside.z, n);
                let fate = enters.then(|| slab.photon(refracted(outside, n), &mut rng));
                r.add(f64::from(u8::from(fate == Some(Fate::Reflected))));
                t.add(f64::from(u8::from(fate == Some(Fate::Transmitted))));
            }
            let what = format!("w {w} g {g} tau {tau} n {n}, diffuse: {is_diffuse}");
            r.check(expected.0, 4e-6, &what);
            t.check(expected.1, 4e-6, &what);
        }
    }
}

#[test]
fn half_spaces_follow_chandrasekhar() {
    // w and plane albedo for cosines of incidence of 1, 0.5 and 0.1.
    let rows = [
        (0.5, [0.115226, 0.160144, 0.241721]),
        (0.8, [0.285255, 0.367970, 0.490710]),
        (0.9, [0.414947, 0.507939, 0.629336]),
        (0.999, [0.912845, 0.938061, 0.960774]),
    ];
    for (at, (w, albedos)) in rows.into_iter().enumerate() {
        let volume = volume(w, Phase::Isotropic, Density::Homogeneous);
        let slab = Slab { volume: &volume, depth: 1e9, n: 1.0 };
        for (mu, expected) in [1.0, 0.5, 0.1].into_iter().zip(albedos) {
            let mut rng = Rng::new(SEED, Stream::Measure, 100 + at as u64);
            let mut r = Mean::default();
            for _ in 0..if w > 0.99 { 8000 } else { 40_000 } {
                let d = DVec3::new(f64::sqrt(1.0 - mu * mu), 0.0, mu);
                r.add(f64::from(u8::from(slab.photon(d, &mut rng) == Fate::Reflected)));
            }
            r.check(expected, 1e-6, &format!("w {w} mu {mu}"));
        }
    }
}

#[test]
fn half_spaces_with_a_border_and_marble() {
    // Index, albedo, and what is reflected of a beam along the normal without the first reflection.
    for (n, w, expected, digit) in [
        (1.5, 0.9, 0.219919, 1e-6),
        (1.5, 0.99, 0.56198, 1e-5),
        (1.33, 0.9, 0.27473, 1e-5),
        (1.33, 0.99, 0.63290, 1e-5),
    ] {
        let volume = volume(w, Phase::Isotropic, Density::Homogeneous);
        let slab = Slab { volume: &volume, depth: 1e9, n };
        let mut rng = Rng::new(SEED, Stream::Measure, 120);
        let mut r = Mean::default();
        for _ in 0..20_000 {
            let enters = rng.next_f64() >= fresnel(1.0, n);
            r.add(f64::from(u8::from(enters && slab.photon(DVec3::Z, &mut rng) == Fate::Reflected)));
        }
        r.check(expected, digit, &format!("n {n} w {w}"));
    }
    // Marble by name: what passes a slab of 2 mm along the normal, in red; lengths in metres.
    let marble = super::NamedMedium::find("marble").unwrap();
    let volume = Volume::homogeneous(marble.coefficients().unwrap(), marble.phase());
    let slab = Slab { volume: &volume, depth: 2e-3, n: f64::from(marble.ior()) };
    let mut rng = Rng::new(SEED, Stream::Measure, 121);
    let mut t = Mean::default();
    for _ in 0..20_000 {
        let enters = rng.next_f64() >= fresnel(1.0, slab.n);
        t.add(f64::from(u8::from(enters && slab.photon(DVec3::Z, &mut rng) == Fate::Transmitted)));
    }
    t.check(0.35613, 5e-6, "marble");
}

/// Radiance of single scattering along a ray into a slab lit by a beam of irradiance one along +z.
fn single(volume: &Volume, depth: f64, mu: f64, is_behind: bool, rng: &mut Rng) -> Mean {
    // The eye looks along `d` from outside of the slab; where it is behind, towards -z.
    let start = if is_behind { depth } else { 0.0 };
    let d = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, if is_behind { -mu } else { mu });
    let line = Line::new(DVec3::new(0.0, 0.0, start), d).unwrap();
    let mut mean = Mean::default();
    for _ in 0..40_000 {
        let flight = volume.fly(&line, depth / mu, Rgb::ONE, Losses::Weighted, rng);
        mean.add(match flight.end {
            End::Scattered { t, weight } => {
                let place = line.at(t);
                let light = Line::new(place, DVec3::NEG_Z).unwrap();
                let passed = volume.transmittance(&light, place.z, rng);
                let p = volume.phase().eval(-d.as_vec3(), Vec3::NEG_Z);
                f64::from((weight * volume.coefficients().albedo() * passed).y) * f64::from(p)
            }
            _ => 0.0,
        });
    }
    mean
}

#[test]
fn single_scattering_in_slabs() {
    let volume = volume(1.0, Phase::Isotropic, Density::Homogeneous);
    // tau, radiance over irradiance for R(1), R(.5), T(.5).
    let rows = [
        (0.1, [0.00721247, 0.01375002, 0.01370430]),
        (1.0, [0.03440392, 0.05041036, 0.03701055]),
        (4.0, [0.03977539, 0.05305132, 0.00286163]),
    ];
    for (tau, expected) in rows {
        let mut rng = Rng::new(SEED, Stream::Measure, 200);
        for ((mu, is_behind), expected) in [(1.0, false), (0.5, false), (0.5, true)].into_iter().zip(expected)
        {
            let found = single(&volume, tau, mu, is_behind, &mut rng);
            found.check(expected, 1e-8, &format!("tau {tau} mu {mu} behind: {is_behind}"));
        }
    }
}

#[test]
fn single_scattering_in_a_cube() {
    // Lit from above, seen along z through its middle at three heights; the cube as a function in a box.
    let bounds = Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let one = Smooth { value: |_: DVec3| 1.0, slope: 0.0 };
    let density = Density::Field(Arc::new(BoundedField::new(one, bounds, UVec3::new(3, 1, 2)).unwrap()));
    let volume = volume(1.0, Phase::Isotropic, density);
    for (y, expected) in [(-0.5, 0.01535310), (0.0, 0.02531299), (0.5, 0.04173406)] {
        let line = Line::new(DVec3::new(0.1, y, -5.0), DVec3::Z).unwrap();
        let mut rng = Rng::new(SEED, Stream::Measure, 210);
        let mut mean = Mean::default();
        for _ in 0..40_000 {
            let flight = volume.fly(&line, 20.0, Rgb::ONE, Losses::Sampled, &mut rng);
            mean.add(match flight.end {
                End::Scattered { t, weight } => {
                    let up = Line::new(line.at(t), DVec3::Y).unwrap();
                    f64::from((weight * volume.transmittance(&up, 9.0, &mut rng)).x)
                        * f64::from(volume.phase().eval(Vec3::NEG_Z, Vec3::Y))
                }
                _ => 0.0,
            });
        }
        mean.check(expected, 1e-8, &format!("y {y}"));
    }
}

#[test]
fn single_scattering_of_a_point_light() {
    // Scattering, extinction, distance of the light (1 W/sr) from the ray, distances to its foot and to the end; radiance for g = 0, 0.7, -0.4.
    let rows = [
        (0.1, 0.1, 1.0, 5.0, 10.0, [0.011375223, 0.017003158, 0.011090688]),
        (0.1, 0.1, 0.1, 5.0, 10.0, [0.14566313, 0.31578626, 0.1720647]),
        (1.0, 1.0, 1.0, 2.0, 4.0, [0.0089213492, 0.010000578, 0.0052126815]),
        (0.5, 1.0, 0.25, 2.0, 4.0, [0.043710056, 0.094362317, 0.035432828]),
    ];
    for (scattering, extinction, height, foot, end, radiance) in rows {
        let coefficients =
            Coefficients::new(Rgb::splat(extinction - scattering), Rgb::splat(scattering)).unwrap();
        let line = Line::new(DVec3::ZERO, DVec3::X).unwrap();
        let light = DVec3::new(foot, height, 0.0);
        for (g, expected) in [0.0, 0.7, -0.4].into_iter().zip(radiance) {
            let volume = Volume::homogeneous(coefficients, hg(g));
            for point in [Some(light), None] {
                let distances = Distances::new(&volume, &line, end, point, Rgb::ONE).unwrap();
                let mut rng = Rng::new(SEED, Stream::Measure, 220);
                let mut mean = Mean::default();
                for _ in 0..40_000 {
                    let drawn = distances.sample(rng.next_f64(), rng.next_f64());
                    let place = line.at(drawn.t);
                    let away = light - place;
                    let to_light = Line::new(place, away).unwrap();
                    let passed = volume.exact_transmittance(&line, drawn.t).unwrap()
                        * volume.exact_transmittance(&to_light, away.length()).unwrap();
                    let p = volume.phase().eval(Vec3::NEG_X, to_light.direction().as_vec3());
                    let here = f64::from(p * passed.x) * f64::from(scattering) / away.length_squared();
                    mean.add(here / drawn.pdf);
                }
                mean.check(expected, 1e-6 * expected, &format!("h {height} g {g} {point:?}"));
            }
        }
    }
}

/// Length of the part of a segment of length `t` that is within `r` of the origin.
fn within(place: DVec3, d: DVec3, t: f64, r: f64) -> f64 {
    let foot = -place.dot(d);
    let room = r * r - (place + d * foot).length_squared();
    if room <= 0.0 {
        return 0.0;
    }
    let half = room.sqrt();
    ((foot + half).min(t) - (foot - half).max(0.0)).max(0.0)
}

/// 4 pi r^2 times the fluence around a point source of 1 W.
#[test]
fn a_point_source_in_an_infinite_medium() {
    let radii = [0.5, 1.0, 2.0, 4.0, 8.0];
    let rows = [
        (0.5, [0.926026, 0.737585, 0.398486, 0.090354, 0.003278]),
        (0.9, [1.516864, 1.800558, 1.866176, 1.245388, 0.301740]),
    ];
    for (at, (w, expected)) in rows.into_iter().enumerate() {
        let volume = volume(w, Phase::Isotropic, Density::Homogeneous);
        let mut rng = Rng::new(SEED, Stream::Measure, 300 + at as u64);
        // Track length within thin shells over their thickness is 4 pi r^2 times the mean fluence there.
        let half = 0.01;
        let mut means = [Mean::default(); 5];
        for _ in 0..60_000 {
            let mut lengths = [0.0; 5];
            let (mut place, mut d) = (DVec3::ZERO, scattered(Phase::Isotropic, DVec3::Z, &mut rng));
            loop {
                let line = Line::new(place, d).unwrap();
                let flight = volume.fly(&line, f64::INFINITY, Rgb::ONE, Losses::Sampled, &mut rng);
                let (End::Scattered { t, .. } | End::Absorbed { t, .. }) = flight.end else {
                    panic!("{flight:?}")
                };
                for (length, r) in lengths.iter_mut().zip(radii) {
                    *length += (within(place, d, t, r + half) - within(place, d, t, r - half)) / (2.0 * half);
                }
                if !matches!(flight.end, End::Scattered { .. }) {
                    break;
                }
                place = line.at(t);
                d = scattered(Phase::Isotropic, d, &mut rng);
            }
            means.iter_mut().zip(lengths).for_each(|(mean, length)| mean.add(length));
        }
        for ((mean, r), expected) in means.iter().zip(radii).zip(expected) {
            // The mean over a shell is that of its middle but for second order.
            mean.check(expected, 2e-4 * expected + 1e-6, &format!("w {w} r {r}"));
        }
    }
}

/// Density 1 - r in the unit sphere.
fn cone() -> Density {
    let bounds = Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let field = Smooth { value: |p: DVec3| 1.0 - p.length(), slope: 1.0 };
    Density::Field(Arc::new(BoundedField::new(field, bounds, UVec3::splat(12)).unwrap()))
}

/// 1 + sin(2 pi x) in the cube from -1 to 1.
fn waves() -> Density {
    let bounds = Bounds3 { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let field = Smooth { value: |p: DVec3| 1.0 + (TAU * p.x).sin(), slope: TAU };
    Density::Field(Arc::new(BoundedField::new(field, bounds, UVec3::new(32, 2, 2)).unwrap()))
}

/// Checks that a ray through the volume sees the radiance `source` of its surroundings, by following light over `reach` at each step.
fn check_furnace(volume: &Volume, source: Rgb, reach: f64, what: &str) {
    let mut rng = Rng::new(SEED, Stream::Measure, 400);
    let mut means = [Mean::default(); 3];
    for _ in 0..10_000 {
        let (mut seen, mut throughput) = (Rgb::ZERO, Rgb::ONE);
        let mut line = Line::new(DVec3::new(-2.0, 0.1, 0.2), DVec3::X).unwrap();
        loop {
            let flight = volume.fly(&line, reach, throughput, Losses::Sampled, &mut rng);
            seen += throughput * flight.emitted;
            match flight.end {
                End::Escaped { weight } => {
                    seen += throughput * weight * source;
                    break;
                }
                End::Absorbed { .. } => break,
                End::Scattered { t, weight } => {
                    throughput *= weight;
                    let d = scattered(volume.phase(), line.direction(), &mut rng);
                    line = Line::new(line.at(t), d).unwrap();
                }
            }
        }
        means.iter_mut().zip(seen.to_array()).for_each(|(mean, value)| mean.add(f64::from(value)));
    }
    for (mean, expected) in means.iter().zip(source.to_array()) {
        mean.check(f64::from(expected), 1e-6 * f64::from(expected), what);
    }
}

#[test]
fn furnaces() {
    let chromatic = Rgb::new(0.2, 1.0, 4.0);
    let fog = Density::Height(HeightFog::new(DVec3::new(0.2, 1.0, 0.0), -0.5, 0.5).unwrap());
    // A homogeneous medium has no border of its own here: light escapes after a distance.
    for (density, reach) in [(cone(), 9.0), (waves(), 9.0), (fog, 0.7), (Density::Homogeneous, 0.7)] {
        for phase in [Phase::Isotropic, hg(0.8), Phase::two_lobes(0.9, -0.4, 0.7).unwrap()] {
            let what = format!("{density:?} {phase:?}");
            let source = Rgb::new(1.0, 2.0, 3.0);
            let scatters = Coefficients::new(Rgb::ZERO, chromatic).unwrap();
            check_furnace(&Volume::new(scatters, phase, density.clone()), source, reach, &what);
            let warm = Coefficients::new(Rgb::new(1.0, 0.1, 0.5), chromatic).unwrap();
            let warm = warm.with_source(source).unwrap();
            check_furnace(&Volume::new(warm, phase, density.clone()), source, reach, &what);
            let hot = Coefficients::new(Rgb::new(0.3, 2.0, 0.01), Rgb::ZERO).unwrap();
            let hot = hot.with_source(source).unwrap();
            check_furnace(&Volume::new(hot, phase, density.clone()), source, reach, &what);
        }
    }
}
