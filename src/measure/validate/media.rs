//! Validation in media that scatter, absorb and glow: single scattering, slabs and furnaces.

use super::stage::{Stage, path, photon_map};
use super::{Claim, Expected, Experiment, ValidateError, by};
use crate::embree::Device;
use crate::render::Overrides;
use std::sync::Arc;

const SECTION: &str = "Media";
const UNIT: &str = "W/(m² sr)";

/// Largest bias of estimates from photons in media.
const BIAS: f64 = 0.02;

/// A picture that is the same all over, by paths and by photons in media.
struct Seen {
    what: String,
    text: String,
    exact: f64,
    /// Camera samples per pixel of paths, and their largest number of scatterings.
    paths: (u32, Option<u32>),
    /// Camera samples and photons in media; `None` where photons say nothing of their own.
    photons: Option<(u32, u64)>,
}

impl Seen {
    fn experiment(self, device: &Arc<Device>) -> Result<Experiment, ValidateError> {
        let stage = Stage::new(device, &self.text)?;
        let row = |by, claim| Expected { what: self.what.clone(), by, exact: self.exact, claim };
        let mut rows = vec![row(by::PATHS, Claim::Unbiased)];
        rows.extend(self.photons.map(|_| row(by::GATHER, Claim::Within(BIAS))));
        let (spp, max_depth) = self.paths;
        let by_paths = Overrides { spp: Some(spp), max_depth, ..path() };
        let by_photons = self.photons.map(|(spp, photons)| Overrides {
            spp: Some(spp),
            volume_photons: Some(photons),
            ..photon_map()
        });
        let estimate = move |seed| {
            let settings = std::iter::once(&by_paths).chain(&by_photons);
            settings.map(|settings| Ok(stage.layer("beauty", settings.clone(), seed)?.y)).collect()
        };
        Ok(Experiment { section: SECTION, unit: UNIT, rows, estimate: Box::new(estimate) })
    }
}

/// One scattering of the light of a point light of 1 W/sr beside a ray that ends at something black. `way` is the distance of the light from
/// the ray, that of its foot, and that of the end. The exact values are integrals over the ray, by quadrature.
fn beside_a_ray(medium: &str, way: (f64, f64, f64), exact: f64) -> Seen {
    let (height, foot, end) = way;
    let text = format!(
        "[camera]\neye = [0, 0, 0]\nat = [0, 0, -1]\nfov = 0.001\n[media.fog]\n{medium}\n[materials.border]\ntype = \"dielectric\"\n\
         inside = \"fog\"\n[materials.black]\ntype = \"lambert\"\nreflectance = 0.0\n[[shapes]]\ntype = \"box\"\nmin = [-20, -20, -20]\n\
         max = [20, 20, 20]\nmaterial = \"border\"\n[[shapes]]\ntype = \"disc\"\ncenter = [0, 0, {}]\nnormal = [0, 0, 1]\nradius = 5\n\
         material = \"black\"\n[[lights]]\ntype = \"point\"\nposition = [0, {height}, {}]\npower = {}\n",
        -end,
        -foot,
        4.0 * std::f64::consts::PI
    );
    let what = format!("one scattering beside a point light, {}, way {way:?}", medium.replace('\n', ", "));
    Seen { what, text, exact, paths: (256, Some(1)), photons: None }
}

/// What a slab over black reflects of light from everywhere towards its normal: by reciprocity its reflectance for light along the normal. The
/// exact values are by adding and doubling.
fn slab(medium: &str, thickness: f64, exact: f64, paths: u32) -> Seen {
    let text = format!(
        "[camera]\neye = [0, {}, 0]\nat = [0, 0, 0]\nup = [0, 0, 1]\nfov = 0.001\n[media.slab]\n{medium}\n[materials.border]\n\
         type = \"dielectric\"\ninside = \"slab\"\n[materials.black]\ntype = \"lambert\"\nreflectance = 0.0\n[[shapes]]\ntype = \"box\"\n\
         min = [-8, 0, -8]\nmax = [8, {thickness}, 8]\nmaterial = \"border\"\n[[shapes]]\ntype = \"disc\"\ncenter = [0, -0.5, 0]\n\
         radius = 30\nmaterial = \"black\"\n[[lights]]\ntype = \"environment\"\nradiance = 1.0\n",
        thickness + 5.0
    );
    let what = format!("reflectance of a slab of {thickness} m, {}", medium.replace('\n', ", "));
    // By photons in `tests/accuracy/media.rs`, where a table of many seeds need not wait for them.
    Seen { what, text, exact, paths: (paths, None), photons: None }
}

/// A ball in surroundings of radiance one.
fn furnace(medium: &str, what: &str, exact: f64, photons: Option<(u32, u64)>) -> Seen {
    let light = if exact == 1.0 { "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n" } else { "" };
    let text = format!(
        "[camera]\neye = [0, 0, 4]\nat = [0, 0, 0]\nfov = 20\n[media.ball]\n{medium}\n[materials.border]\ntype = \"dielectric\"\n\
         inside = \"ball\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"border\"\n{light}"
    );
    let what = format!("{what}, {}", medium.replace('\n', ", "));
    Seen { what, text, exact, paths: (32, None), photons }
}

/// The middle of a wide layer that glows and absorbs, without surroundings: `B (1 - exp(-depth))`.
fn glow(depth: f64) -> Seen {
    let text = format!(
        "[camera]\neye = [0, 0, 4]\nat = [0, 0, 0]\nfov = 0.001\n[media.layer]\nabsorption = {depth:?}\nemission = {depth:?}\n\
         [materials.border]\ntype = \"dielectric\"\ninside = \"layer\"\n[[shapes]]\ntype = \"box\"\nmin = [-10, -10, -0.5]\n\
         max = [10, 10, 0.5]\nmaterial = \"border\"\n"
    );
    let what = format!("layer that glows and absorbs, optical depth {depth:?}");
    Seen { what, text, exact: -(-depth).exp_m1(), paths: (1, None), photons: None }
}

pub(super) fn experiments(device: &Arc<Device>) -> Result<Vec<Experiment>, ValidateError> {
    let way = (1.0, 5.0, 10.0);
    let seen = [
        beside_a_ray("scattering = 0.1", way, 0.011_375_223),
        beside_a_ray("scattering = 0.1\ng = 0.7", way, 0.017_003_158),
        beside_a_ray("scattering = 0.1\ng = -0.4", way, 0.011_090_688),
        beside_a_ray("scattering = 1.0", (1.0, 2.0, 4.0), 0.008_921_349_2),
        beside_a_ray("scattering = 0.5\nabsorption = 0.5", (0.25, 2.0, 4.0), 0.043_710_056),
        slab("scattering = 1.0", 1.0, 0.341_329, 64),
        slab("scattering = 1.0", 2.0, 0.517_515, 64),
        slab("scattering = 0.9\nabsorption = 0.1", 2.0, 0.361_649, 64),
        slab("scattering = 0.5\nabsorption = 0.5", 1.0, 0.099_119, 128),
        slab("albedo = 0.9\nmean-free-path = 1.0\ng = 0.75", 2.0, 0.097_395, 256),
        furnace("scattering = 3.0", "furnace", 1.0, Some((4, 20_000))),
        furnace("scattering = [0.1, 1.0, 10.0]\nphase = \"rayleigh\"", "furnace", 1.0, None),
        furnace("ior = 1.33\nscattering = 2.0\ng = 0.5", "furnace", 1.0, Some((4, 20_000))),
        furnace("scattering = 1.0\nabsorption = 2.0\nemission = 2.0", "furnace", 1.0, None),
        glow(1e-6),
        glow(0.1),
        glow(1.0),
    ];
    seen.into_iter().map(|seen| seen.experiment(device)).collect()
}
