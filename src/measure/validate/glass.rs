//! Validation of refraction: Fresnel, Snell, Beer-Lambert, and the change of radiance and flux at an interface.

use super::stage::{Stage, path, photon_map, place};
use super::{Claim, Expected, Experiment, ValidateError, by};
use crate::bsdf::TransportMode;
use crate::embree::Device;
use crate::math::Ray;
use crate::render::{Overrides, ProbeEstimator};
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::MapKind;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

const SECTION: &str = "Glass and water";

/// Thickness of the slab, in metres.
const THICKNESS: f64 = 0.01;
/// Absorption of its glass per metre.
const ABSORPTION: [f64; 3] = [0.0, 5.0, 40.0];

/// Reflectance of an interface for unpolarised light from index 1 into index `n`, in double precision and independent of the renderer's
/// code.
fn fresnel(n: f64, cosine: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).sqrt() / n;
    if sine >= 1.0 {
        return 1.0;
    }
    let inside = (1.0 - sine * sine).sqrt();
    let s = (cosine - n * inside) / (cosine + n * inside);
    let p = (n * cosine - inside) / (n * cosine + inside);
    0.5 * (s * s + p * p)
}

/// Transmittance of the slab at `angle` degrees with all reflections between its faces, where each face uses the mean over polarisations.
fn slab(n: f64, absorption: f64, angle: f64) -> f64 {
    let (sine, cosine) = angle.to_radians().sin_cos();
    let r = fresnel(n, cosine);
    let a = (-absorption * THICKNESS / (1.0 - (sine / n).powi(2)).sqrt()).exp();
    (1.0 - r) * (1.0 - r) * a / (1.0 - r * r * a * a)
}

/// Both faces of the slab, which extend `reach` metres to each side: wide enough for many reflections in between.
fn faces(n: f64, reach: f64) -> String {
    let (half, width) = (0.5 * THICKNESS, 2.0 * reach);
    format!(
        "[materials.glass]\ntype = \"dielectric\"\nior = {n:?}\nabsorption = {ABSORPTION:?}\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-{reach}, {half}, -{reach}]\nedge-u = [0, 0, {width}]\nedge-v = [{width}, 0, 0]\n\
         material = \"glass\"\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-{reach}, -{half}, -{reach}]\nedge-u = [{width}, 0, 0]\nedge-v = [0, 0, {width}]\n\
         material = \"glass\"\n"
    )
}

/// Radiance that a camera sees through the slab from a wide emitter of radiance 1.
fn seen_through(device: &Arc<Device>, n: f64, angle: f64) -> Result<Experiment, ValidateError> {
    let (sine, cosine) = angle.to_radians().sin_cos();
    let text = format!(
        "[camera]\neye = [{sine:?}, {:?}, 0]\nat = [0, 0.005, 0]\nup = [0, 0, 1]\nfov = 0.01\n\
         [materials.black]\ntype = \"lambert\"\nreflectance = 0.0\n{}\
         [[shapes]]\ntype = \"quad\"\ncorner = [-30, -1, -30]\nedge-u = [0, 0, 60]\nedge-v = [60, 0, 0]\n\
         material = \"black\"\nemission = {{ radiance = 1.0 }}\n",
        0.5 * THICKNESS + cosine,
        faces(n, 30.0),
    );
    let stage = Stage::new(device, &text)?;
    let rows = [by::PATHS, by::GATHER].into_iter().flat_map(|by| {
        ABSORPTION.map(|absorption| Expected {
            what: format!("slab of 1 cm, n = {n}, absorption {absorption}/m, at {angle}°: transmittance"),
            by,
            exact: slab(n, absorption, angle),
            claim: Claim::Unbiased,
        })
    });
    Ok(Experiment {
        section: SECTION,
        unit: "",
        rows: rows.collect(),
        estimate: Box::new(move |seed| {
            let paths = stage.layer("specular", Overrides { spp: Some(64), ..path() }, seed)?;
            let maps = Overrides { spp: Some(4), caustic_photons: Some(0), ..photon_map() };
            let recursion = stage.layer("specular", maps, seed)?;
            Ok([paths, recursion].iter().flat_map(|seen| seen.to_array()).collect())
        }),
    })
}

/// Sunlight through the slab: flux of caustic photons on the floor.
fn sun_through(device: &Arc<Device>, angle: f64) -> Result<Experiment, ValidateError> {
    const N: f64 = 1.5;
    let (sine, cosine) = angle.to_radians().sin_cos();
    let text = format!(
        "[camera]\neye = [0, -0.1, 0]\nat = [0.01, -1, 0]\n[materials.floor]\ntype = \"lambert\"\nreflectance = 0.5\n{}\
         [[shapes]]\ntype = \"quad\"\ncorner = [-3, -1, -3]\nedge-u = [0, 0, 6]\nedge-v = [6, 0, 0]\nmaterial = \"floor\"\n\
         [[lights]]\ntype = \"directional\"\ndirection = [{sine:?}, {:?}, 0]\nirradiance = 1.0\n",
        faces(N, 5.0),
        -cosine
    );
    let stage = Stage::new(device, &text)?;
    let rows = ABSORPTION.map(|absorption| Expected {
        what: format!("sunlight through the slab, absorption {absorption}/m, at {angle}°, on the floor"),
        by: by::FLUX,
        exact: cosine * slab(N, absorption, angle),
        claim: Claim::Unbiased,
    });
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: rows.into(),
        estimate: Box::new(move |seed| {
            // Well under the slab, with the 1.7 m that light at 60 degrees moves sideways.
            let inside = |_: usize, at: DVec3| at.x.abs() < 2.5 && at.z.abs() < 2.5;
            let flux = stage.flux((MapKind::Caustic, 50_000), 1, inside, seed)?;
            Ok(flux[0].to_array().map(|flux| flux / 25.0).into())
        }),
    })
}

/// The floor of a pool under a sky of radiance 1. Mirrors as walls make it infinitely wide.
fn pool(device: &Arc<Device>) -> Result<Experiment, ValidateError> {
    const N: f64 = 1.33;
    const RHO: [f64; 3] = [0.2, 0.5, 0.8];
    let wall = |corner: &str, edge: &str| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {edge}\nedge-v = [0, 0.5, 0]\nmaterial = \"mirror\"\n"
        )
    };
    let text = format!(
        "[camera]\neye = [0, 60, 0]\nat = [0, 0, 0]\nup = [0, 0, 1]\n\
         [materials.floor]\ntype = \"lambert\"\nreflectance = {RHO:?}\n[materials.mirror]\ntype = \"mirror\"\n\
         [materials.water]\ntype = \"dielectric\"\nior = {N:?}\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-0.5, 0, -0.5]\nedge-u = [0, 0, 1]\nedge-v = [1, 0, 0]\nmaterial = \"floor\"\n\
         [[shapes]]\ntype = \"quad\"\ncorner = [-0.5, 0.5, -0.5]\nedge-u = [0, 0, 1]\nedge-v = [1, 0, 0]\n\
         material = \"water\"\n{}[[lights]]\ntype = \"environment\"\nradiance = 1.0\n",
        [
            wall("[-0.5, 0, -0.5]", "[1, 0, 0]"),
            wall("[-0.5, 0, 0.5]", "[1, 0, 0]"),
            wall("[-0.5, 0, -0.5]", "[0, 0, 1]"),
            wall("[0.5, 0, -0.5]", "[0, 0, 1]"),
        ]
        .concat()
    );
    // Hemispherical reflectance of the surface from above, and from below by reciprocity.
    let steps = 100_000;
    let share =
        |i: u32| fresnel(N, (1.0 - (f64::from(i) + 0.5) / f64::from(steps)).sqrt()) / f64::from(steps);
    let from_above: f64 = (0..steps).map(share).sum();
    let from_below = 1.0 - (1.0 - from_above) / (N * N);
    let stage = Stage::new(device, &text)?;
    let row = |by, claim| {
        RHO.map(|rho| Expected {
            what: format!("floor of a pool under the sky, reflectance {rho}"),
            by,
            exact: PI * (1.0 - from_above) / (1.0 - rho * from_below),
            claim,
        })
    };
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: [row(by::PATHS, Claim::Unbiased), row(by::GATHER, Claim::Within(0.01))]
            .into_iter()
            .flatten()
            .collect(),
        estimate: Box::new(move |seed| {
            let places = [(0.0, 0.0), (0.3, 0.1), (-0.2, 0.35), (-0.37, -0.31)];
            let points: Vec<_> = places.iter().map(|&(x, z)| place(x, 0.0, z, DVec3::Y)).collect();
            let maps =
                Overrides { global_photons: Some(100_000), caustic_photons: Some(100_000), ..photon_map() };
            let all = [
                stage.irradiance((ProbeEstimator::Path, 512), &points, path(), seed)?,
                stage.irradiance((ProbeEstimator::Gather, 128), &points, maps, seed)?,
            ];
            let mean = |found: &[[DVec3; 4]]| found.iter().map(|parts| parts[3]).sum::<DVec3>() / 4.0;
            Ok(all.iter().flat_map(|found| mean(found).to_array()).collect())
        }),
    })
}

/// Focal length of a glass ball for a ray at a hundredth of the radius from the axis. The exact value follows from Snell's law and the sine
/// rule; near the axis it is `n R / (2 (n - 1))`.
fn focal_length(device: &Arc<Device>, n: f64, radius: f64) -> Result<Experiment, ValidateError> {
    const HEIGHT: f32 = 0.01;
    let text = format!(
        "[camera]\neye = [0, 0, {:?}]\nat = [0, 0, 0]\n[materials.glass]\ntype = \"dielectric\"\nior = {n:?}\n\
         [[shapes]]\ntype = \"sphere\"\nradius = {radius:?}\nmaterial = \"glass\"\n",
        5.0 * radius
    );
    let stage = Stage::new(device, &text)?;
    let sine = f64::from(HEIGHT);
    let deviation = 2.0 * (sine.asin() - (sine / n).asin());
    Ok(Experiment {
        section: SECTION,
        unit: "radii",
        rows: vec![Expected {
            what: format!("focal length of a ball of {radius} m, n = {n}"),
            by: by::RAYS,
            exact: sine / deviation.sin(),
            claim: Claim::Unbiased,
        }],
        estimate: Box::new(move |_| {
            let scene = stage.scene();
            let unit = scene.space().length(radius) as f32;
            let mut ray = Ray::new(Vec3::new(0.0, HEIGHT, 3.0) * unit, Vec3::NEG_Z);
            for _ in 0..2 {
                let hit = scene.intersect(&ray).ok_or(ValidateError::Missing("the ball"))?;
                let shading = hit.shading(scene.material(&hit));
                let through = shading
                    .bsdf
                    .sample(shading.wo_local, ONE_MINUS_EPSILON, Vec2::ZERO, TransportMode::Flux)
                    .ok_or(ValidateError::Missing("the refracted ray"))?;
                ray = hit.spawn(shading.frame.to_world(through.wi));
            }
            let crossing = ray.origin.z - ray.origin.y * ray.direction.z / ray.direction.y;
            Ok(vec![f64::from(-crossing / unit)])
        }),
    })
}

pub(super) fn experiments(device: &Arc<Device>) -> Result<Vec<Experiment>, ValidateError> {
    Ok(vec![
        seen_through(device, 1.5, 0.0)?,
        seen_through(device, 1.5, 60.0)?,
        seen_through(device, 1.5, 85.0)?,
        seen_through(device, 1.33, 60.0)?,
        seen_through(device, 2.417, 0.0)?,
        sun_through(device, 0.0)?,
        sun_through(device, 60.0)?,
        pool(device)?,
        focal_length(device, 1.5, 1.0)?,
        focal_length(device, 1.33, 1e-3)?,
        focal_length(device, 1.9, 1e4)?,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_as_tabulated() {
        // Index, degrees, transmittance with the mean of both polarisations at each face.
        for (n, angle, want) in
            [(1.5, 0.0, 0.92308), (1.5, 45.0, 0.90433), (1.5, 85.0, 0.24008), (2.417, 0.0, 0.70653)]
        {
            assert!((slab(n, 0.0, angle) - want).abs() < 1e-5, "{n} {angle}: {}", slab(n, 0.0, angle));
        }
        assert!((slab(1.0, 5.0, 0.0) - (-0.05f64).exp()).abs() < 1e-12);
    }
}
