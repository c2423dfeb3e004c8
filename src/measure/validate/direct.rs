//! Validation of direct light: form factors and Lambert's formula, shadows, and absorption by a medium.

use super::stage::{Stage, path, photon_map, place};
use super::{Claim, Expected, Experiment, ValidateError, by};
use crate::embree::Device;
use crate::render::{Overrides, ProbeEstimator};
use crate::scene::MapKind;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

const SECTION: &str = "Direct light";
const FACTORS: &str = "Form factors";

/// Shadow rays at the probed point.
const SAMPLES: u32 = 1024;

/// A scene with a floor around the origin and the given content.
fn floor(content: &str) -> String {
    format!(
        "
        [camera]
        eye = [2, 0.5, 1]
        at = [0, 0, 0]
        [materials.floor]
        type = \"lambert\"
        reflectance = 0.5
        [materials.black]
        type = \"lambert\"
        reflectance = 0.0
        [[shapes]]
        type = \"quad\"
        corner = [-3, 0, -3]
        edge-u = [0, 0, 6]
        edge-v = [6, 0, 0]
        material = \"floor\"
        {content}
        "
    )
}

fn emitter(shape: &str) -> String {
    format!("[[shapes]]\n{shape}\nmaterial = \"black\"\nemission = {{ radiance = 1.0 }}\n")
}

/// Irradiance from a disc of radiance 1, radius `r` and height `h`, of which only `x > c` is visible: an integral over strips.
fn disc_beyond(r: f64, h: f64, c: f64) -> f64 {
    const STEPS: u32 = 20_000;
    // The substitution x = r sin(a) removes the root at the ends.
    let (from, to) = ((c / r).clamp(-1.0, 1.0).asin(), 0.5 * PI);
    let width = (to - from) / f64::from(STEPS);
    let strip = |i: u32| {
        let a = from + width * (f64::from(i) + 0.5);
        let (x, y) = (r * a.sin(), r * a.cos());
        let squared = h * h + x * x;
        let across = y / (squared * (squared + y * y)) + (y / squared.sqrt()).atan() / squared.powf(1.5);
        h * h * across * r * a.cos()
    };
    (0..STEPS).map(strip).sum::<f64>() * width
}

/// Irradiance from a polygon of radiance 1 at the origin of a floor, by Lambert's formula.
fn polygon(corners: [[f64; 3]; 4]) -> f64 {
    let edge = |i: usize| {
        let [a, b] = [corners[i], corners[(i + 1) % 4]].map(DVec3::from_array);
        0.5 * a.angle_between(b) * a.cross(b).normalize().y
    };
    (0..4).map(edge).sum::<f64>().abs()
}

/// Irradiance at the origin from both integrators.
fn at_origin(
    device: &Arc<Device>,
    what: &str,
    content: &str,
    exact: f64,
) -> Result<Experiment, ValidateError> {
    let stage = Stage::new(device, &floor(content))?;
    let row = |by| Expected { what: what.to_owned(), by, exact, claim: Claim::Unbiased };
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: vec![row(by::PATHS), row(by::GATHER)],
        estimate: Box::new(move |seed| {
            let points = [place(0.0, 0.0, 0.0, DVec3::Y)];
            let by_paths = stage.irradiance((ProbeEstimator::Path, SAMPLES), &points, path(), seed)?;
            let few = Overrides { global_photons: Some(1000), caustic_photons: Some(1000), ..photon_map() };
            let by_maps = stage.irradiance((ProbeEstimator::Gather, SAMPLES), &points, few, seed)?;
            Ok([by_paths, by_maps].iter().map(|found| found[0][0].y).collect())
        }),
    })
}

/// Share of the flux of the first shape that reaches the surface at `y = 0`, from photons.
fn form_factor(
    device: &Arc<Device>,
    what: &str,
    (lamp, receiver): (&str, &str),
    area: f64,
    exact: f64,
) -> Result<Experiment, ValidateError> {
    let text = format!(
        "[camera]\neye = [3, 0.5, 1]\nat = [0, 0, 0]\n[materials.black]\ntype = \"lambert\"\nreflectance = 0.0\n\
         [materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n{}[[shapes]]\n{receiver}\nmaterial = \"grey\"\n",
        emitter(lamp)
    );
    let stage = Stage::new(device, &text)?;
    Ok(Experiment {
        section: FACTORS,
        unit: "",
        rows: vec![Expected { what: what.to_owned(), by: by::FLUX, exact, claim: Claim::Unbiased }],
        estimate: Box::new(move |seed| {
            let low = |_: usize, position: DVec3| position.y < 1e-6;
            let flux = stage.flux((MapKind::Global, 20_000), 1, low, seed)?;
            // Reflected light hits nothing but the emitter, which is black.
            Ok(vec![flux[0].y / (PI * area)])
        }),
    })
}

/// An emitter and a probed point in an absorbing medium.
fn murk(device: &Arc<Device>) -> Result<Experiment, ValidateError> {
    const ABSORPTION: [f64; 3] = [0.1, 0.5, 2.0];
    let text = format!(
        "[media.murk]\nior = 1\nabsorption = {ABSORPTION:?}\n[materials.border]\ntype = \"dielectric\"\ninside = \"murk\"\n\
         [[shapes]]\ntype = \"sphere\"\nradius = 5.0\nmaterial = \"border\"\n\
         [[lights]]\ntype = \"point\"\nposition = [0.6, 0.8, 0.0]\nintensity = 1.0\n"
    );
    let stage = Stage::new(device, &floor(&text))?;
    let row = |sigma: f64, by| Expected {
        what: format!("point light through a metre that absorbs {sigma}/m, cos 0.8"),
        by,
        exact: 0.8 * (-sigma).exp(),
        claim: Claim::Unbiased,
    };
    let rows = [by::PATHS, by::GATHER].into_iter().flat_map(|by| ABSORPTION.map(|sigma| row(sigma, by)));
    Ok(Experiment {
        section: SECTION,
        unit: "W/m²",
        rows: rows.collect(),
        estimate: Box::new(move |seed| {
            let points = [place(0.0, 0.0, 0.0, DVec3::Y)];
            let few = Overrides { global_photons: Some(1000), caustic_photons: Some(0), ..photon_map() };
            let by_paths = stage.irradiance((ProbeEstimator::Path, 1), &points, path(), seed)?;
            let by_maps = stage.irradiance((ProbeEstimator::Gather, 1), &points, few, seed)?;
            Ok([by_paths, by_maps].iter().flat_map(|found| found[0][0].to_array()).collect())
        }),
    })
}

pub(super) fn experiments(device: &Arc<Device>) -> Result<Vec<Experiment>, ValidateError> {
    let square = |corner: &str| {
        emitter(&format!("type = \"quad\"\ncorner = {corner}\nedge-u = [1, 0, 0]\nedge-v = [0, 0, 1]"))
    };
    let disc = |radius: f64, height: f64| {
        format!("type = \"disc\"\ncenter = [0, {height:?}, 0]\nnormal = [0, -1, 0]\nradius = {radius:?}")
    };
    let sphere = "type = \"sphere\"\ncenter = [0.6, 0.8, 0]\nradius = 0.5";
    let aslant = [[-0.6, 0.002, -0.02], [0.9, 0.002, -0.02], [1.7, 1.002, -0.02], [0.2, 1.002, -0.02]];
    let slanted =
        "type = \"quad\"\ncorner = [-0.6, 0.002, -0.02]\nedge-u = [1.5, 0, 0]\nedge-v = [0.8, 1, 0]";
    let wall = |edge: f64| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = [-3, 1, -3]\nedge-u = [0, 0, 6]\nedge-v = [{:?}, 0, 0]\n\
             material = \"black\"\n",
            3.0 + edge
        )
    };
    let mut all = vec![
        at_origin(
            device,
            "unit square at height 1, below its centre",
            &square("[-0.5, 1, -0.5]"),
            PI * 0.239_456_5,
        )?,
        at_origin(device, "unit square at height 1, below a corner", &square("[0, 1, 0]"), PI * 0.138_531_6)?,
        at_origin(
            device,
            "parallelogram that slants up from 2 mm over the floor",
            &emitter(slanted),
            polygon(aslant),
        )?,
        at_origin(device, "disc as wide as high", &emitter(&disc(1.0, 1.0)), PI * 0.5)?,
        at_origin(device, "sphere at twice its radius, cos 0.8", &emitter(sphere), PI * 0.25 * 0.8)?,
        at_origin(
            device,
            "point light at 1 m, cos 0.8",
            "[[lights]]\ntype = \"point\"\nposition = [0.6, 0.8, 0.0]\nintensity = 1.0\n",
            0.8,
        )?,
        at_origin(
            device,
            "parallel light, cos 0.8",
            "[[lights]]\ntype = \"directional\"\ndirection = [0.6, -0.8, 0.0]\nirradiance = 1.0\n",
            0.8,
        )?,
        at_origin(device, "sky of radiance 1", "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n", PI)?,
    ];
    for (what, edge) in [
        ("penumbra: a straight edge hides a quarter of a disc's width", -0.25),
        ("penumbra: half", 0.0),
        ("penumbra: three quarters", 0.25),
    ] {
        // The edge is halfway up to the disc.
        let content = emitter(&disc(1.0, 2.0)) + &wall(edge);
        all.push(at_origin(device, what, &content, disc_beyond(1.0, 2.0, 2.0 * edge))?);
    }
    all.push(murk(device)?);
    let floor = "type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [0, 0, 1]\nedge-v = [1, 0, 0]";
    let above = "type = \"quad\"\ncorner = [0, 1, 0]\nedge-u = [1, 0, 0]\nedge-v = [0, 0, 1]";
    let beside = "type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [0, 1, 0]\nedge-v = [0, 0, 1]";
    let below = "type = \"disc\"\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 1.0";
    all.push(form_factor(device, "parallel unit squares at distance 1", (above, floor), 1.0, 0.199_824_9)?);
    all.push(form_factor(device, "unit squares that share an edge", (beside, floor), 1.0, 0.200_043_8)?);
    for (height, exact) in [(1.0, 0.381_966_0), (2.0, 0.171_572_9)] {
        let what = format!("coaxial unit discs at distance {height}");
        all.push(form_factor(device, &what, (&disc(1.0, height), below), PI, exact)?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_of_a_disc() {
        // All of the disc, half of it, and the remainder.
        let whole = PI * 0.2;
        assert!((disc_beyond(1.0, 2.0, -1.0) / whole - 1.0).abs() < 1e-7);
        assert!((disc_beyond(1.0, 2.0, 0.0) / whole - 0.5).abs() < 1e-7);
        let parts = disc_beyond(1.0, 2.0, 0.3) + disc_beyond(1.0, 2.0, -0.3);
        assert!((parts / whole - 1.0).abs() < 1e-7, "{parts}");
    }

    #[test]
    fn squares_by_the_formula_of_polygons() {
        let square = polygon([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]);
        assert!((square / PI - 0.138_531_6).abs() < 1e-7, "{square}");
    }
}
