//! Directions that photons guide: the same pictures, with less noise.

use crate::support::*;
use cardioid::integrators::{EyeRay, Integrator, PathTracer, PhotonMapIntegrator, PhotonMaps, Scratch};
use cardioid::render::{GuideKind, MapKind, Overrides, Silent, build_maps};
use cardioid::sampling::SampleStream;
use cardioid::scene::{IntegratorKind, RenderPlan};
use glam::{DVec3, Vec2};

/// Pixels along one side.
const SIDE: u32 = 24;

/// A scene, and the maps of one integrator, with a guide.
struct Guided {
    stage: Stage,
    plan: RenderPlan,
    maps: PhotonMaps,
    kind: IntegratorKind,
    settings: cardioid::render::Settings,
}

impl Guided {
    fn new(stage: Stage, kind: IntegratorKind) -> Self {
        let settings = stage.settings(&Overrides {
            integrator: Some(kind),
            guide: Some(GuideKind::Photons),
            global_photons: Some(200_000),
            caustic_photons: Some(50_000),
            ..Overrides::default()
        });
        let scene = stage.scene();
        let plan = RenderPlan::new(scene, kind, MapKind::Global).guided(scene, kind, settings.guide);
        let maps = build_maps(scene, &plan, &settings, &Silent).unwrap().maps;
        assert!(maps.guide.is_some());
        // A path reads no map, and none is kept for it.
        assert_eq!(maps.global.is_some(), kind == IntegratorKind::PhotonMap);
        Self { stage, plan, maps, kind, settings }
    }

    /// Without the guide.
    fn alone(mut self) -> Self {
        self.maps.guide = None;
        self
    }

    /// Means over `runs` estimates of each pixel of `spp` samples, summed over channels, and variances of one estimate.
    fn moments(&self, runs: u64, spp: u32, seed: u64) -> Vec<(f64, f64)> {
        let scene = self.stage.scene();
        let medium = scene.medium_at(self.stage.built.camera.eye());
        let integrator: Box<dyn Integrator + '_> = match self.kind {
            IntegratorKind::Path => Box::new(
                PathTracer::new(scene, self.settings.max_depth, medium).guided_by(self.maps.guide.as_ref()),
            ),
            _ => {
                let reading = self.settings.photon_map_settings(scene);
                Box::new(PhotonMapIntegrator::new(scene, &self.maps, &self.plan, reading, medium))
            }
        };
        let mut scratch = Scratch::default();
        let mut pixel_moments = Vec::new();
        for pixel in 0..SIDE * SIDE {
            let corner = Vec2::new((pixel % SIDE) as f32, (pixel / SIDE) as f32);
            let (mut sum, mut squares) = (0.0, 0.0);
            for run in 0..runs {
                let mut value = DVec3::ZERO;
                for index in 0..spp {
                    let mut samples = SampleStream::new(seed + run, u64::from(pixel), index);
                    let ray = self.stage.built.camera.ray((corner + samples.next_2d()) / SIDE as f32);
                    let sample = integrator.li(&EyeRay::alone(ray), &mut samples, &mut scratch);
                    value += sample.radiance.iter().map(|part| part.as_dvec3()).sum::<DVec3>();
                }
                let value = value.element_sum() / f64::from(spp) / scene.space().power;
                sum += value;
                squares += value * value;
            }
            let n = runs as f64;
            pixel_moments.push((sum / n, (squares - sum * sum / n) / (n - 1.0)));
        }
        assert_eq!(scratch.counters.guided > 0, self.maps.guide.is_some());
        pixel_moments
    }
}

/// Difference of the means of two pictures over its standard error, and their ratio of variances, weighed as errors of
/// pictures are.
fn compare(what: &str, alone: &[(f64, f64)], guided: &[(f64, f64)], runs: u64) -> (f64, f64) {
    let sum = |moments: &[(f64, f64)], f: fn(&(f64, f64)) -> f64| moments.iter().map(f).sum::<f64>();
    let difference = sum(guided, |m| m.0) - sum(alone, |m| m.0);
    let error = ((sum(guided, |m| m.1) + sum(alone, |m| m.1)) / runs as f64).sqrt();
    let weighed = |moments: &[(f64, f64)]| {
        moments.iter().zip(alone).map(|((_, v), (mean, _))| v / (mean * mean + 0.01)).sum::<f64>()
    };
    let ratio = weighed(guided) / weighed(alone);
    println!(
        "{what}: mean {:+.3} % off, {:+.2} standard errors; variance {ratio:.3}",
        100.0 * difference / sum(alone, |m| m.0),
        difference / error
    );
    (difference / error, ratio)
}

/// |z| below which two equal means stay with probability 0.9999.
const Z: f64 = 3.9;

/// Light through a door: concentrated and indirect. No two pictures share a seed.
#[test]
fn guided_paths_have_the_same_mean_and_less_noise_behind_a_door() {
    let runs = 16;
    let load = || Guided::new(Stage::load("door", (SIDE, SIDE)), IntegratorKind::Path);
    let guided = load().moments(runs, 16, 1000);
    let alone = load().alone().moments(runs, 16, 2000);
    let (z, ratio) = compare("door, paths", &alone, &guided, runs);
    assert!(z.abs() < Z, "{z}");
    assert!(ratio < 0.7, "{ratio}");
}

#[test]
fn guided_gathering_has_the_same_mean_and_less_noise_behind_a_door() {
    let runs = 12;
    let load = || Guided::new(Stage::load("door", (SIDE, SIDE)), IntegratorKind::PhotonMap);
    let guided = load().moments(runs, 8, 1000);
    let alone = load().alone().moments(runs, 8, 2000);
    let (z, ratio) = compare("door, gathering", &alone, &guided, runs);
    assert!(z.abs() < Z, "{z}");
    assert!(ratio < 0.65, "{ratio}");
}

/// Caustics by paths, which photons guide as well, glass and mirrors between the surfaces.
#[test]
fn guided_paths_have_the_same_mean_in_the_box_with_spheres() {
    let runs = 16;
    let load = || Guided::new(Stage::load("cornell-spheres", (SIDE, SIDE)), IntegratorKind::Path);
    let guided = load().moments(runs, 16, 1000);
    let alone = load().alone().moments(runs, 16, 2000);
    // Fireflies decide the variance of so few samples.
    let (z, _) = compare("cornell-spheres, paths", &alone, &guided, runs);
    assert!(z.abs() < Z, "{z}");
}

/// Where rays that photons guide hit lights by chance, the weights of shadow rays against them must know of the guide: under
/// a sky, by a wide lamp, over curved surfaces with shading normals.
#[test]
fn lights_hit_by_guided_rays_are_weighed_right() {
    let text = r#"
        [camera]
        eye = [0.0, 1.0, 3.0]
        at = [0.0, 0.4, 0.0]
        fov = 50.0

        [materials.clay]
        type = "lambert"
        reflectance = [0.8, 0.7, 0.6]

        [[shapes]]
        type = "quad"
        corner = [-2.0, 0.0, 2.0]
        edge-u = [4.0, 0.0, 0.0]
        edge-v = [0.0, 0.0, -4.0]
        material = "clay"

        [[shapes]]
        type = "quad"
        corner = [-2.0, 0.0, -1.0]
        edge-u = [4.0, 0.0, 0.0]
        edge-v = [0.0, 2.0, 0.0]
        material = "clay"

        [[shapes]]
        type = "mesh"
        vertices = [[-0.5, 0.05, -0.3], [0.6, 0.05, -0.2], [0.1, 0.05, 0.6], [0.0, 0.8, 0.0]]
        faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
        normals = "smooth"
        material = "clay"

        [[shapes]]
        type = "disc"
        center = [1.2, 1.0, 0.0]
        normal = [-1.0, -0.2, 0.0]
        radius = 0.7
        material = "clay"
        emission = { radiance = [3.0, 4.0, 5.0] }

        [[lights]]
        type = "environment"
        radiance = [0.2, 0.3, 0.6]
    "#;
    let runs = 32;
    for kind in [IntegratorKind::Path, IntegratorKind::PhotonMap] {
        let load = || Guided::new(Stage::new(text, (SIDE, SIDE)), kind);
        assert!(load().plan.bsdf_sampling.build);
        let guided = load().moments(runs, 4, 5000);
        let alone = load().alone().moments(runs, 4, 9000);
        let (z, _) = compare(&format!("sky and lamp, {kind:?}"), &alone, &guided, runs);
        assert!(z.abs() < Z, "{z}");
    }
}

#[test]
fn nothing_guides_where_nothing_is_reflected() {
    let text = r#"
        [camera]
        eye = [0.0, 1.0, 3.0]
        at = [0.0, 0.0, 0.0]

        [[shapes]]
        type = "sphere"
        radius = 0.5
        emission = { radiance = 1.0 }
    "#;
    let stage = Stage::new(text, (8, 8));
    for integrator in [path(), photon_map(), show(MapKind::Global)] {
        let shot = stage.shoot(&Overrides { guide: Some(GuideKind::Photons), spp: Some(1), ..integrator });
        assert!(!shot.statistics.plan.guide.build);
        assert_eq!((shot.statistics.guide_bytes, shot.statistics.counters.guided), (0, 0));
    }
}
