//! Where photons are aimed, how many are stored, and what is told about lights and casters that get none.

use crate::support::*;
use cardioid::photons::{PhotonClass, PhotonMap, TraceSettings, TracedPhotons, trace_photons};
use cardioid::render::{MapKind, Overrides};
use cardioid::scene::Scene;
use std::sync::atomic::{AtomicU64, Ordering};

fn trace(scene: &Scene, kind: MapKind, stored: u64, seed: u64) -> TracedPhotons {
    let settings =
        TraceSettings { kind, stored, seed, max_depth: 30_000, aimed: true, wavelengths: Default::default() };
    trace_photons(scene, &settings, &|_, _| true).unwrap()
}

/// Flux stored, in watts of the first channel.
fn stored_watts(stage: &Stage, traced: TracedPhotons) -> f64 {
    stage.watts(PhotonMap::build(traced.photons, traced.emitted).total_flux()[0])
}

/// Mean of `figure` over runs, and its standard error.
fn over_seeds(runs: u64, figure: impl Fn(u64) -> f64) -> (f64, f64) {
    let values: Vec<f64> = (0..runs).map(figure).collect();
    let n = runs as f64;
    let mean = values.iter().sum::<f64>() / n;
    let error = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    (mean, error)
}

/// A grey floor, and whatever else.
fn floor(rest: &str) -> Stage {
    let text = format!(
        r#"
        [camera]
        eye = [0.0, 1.0, 4.0]
        at = [0.0, 0.0, 0.0]

        [materials.paint]
        type = "lambert"
        reflectance = 0.5

        [materials.black]
        type = "lambert"
        reflectance = 0.0

        [materials.glass]
        type = "dielectric"
        ior = 1.5

        [materials.mirror]
        type = "mirror"
        reflectance = 0.9

        [[shapes]]
        name = "floor"
        type = "quad"
        corner = [-2, -0.5, -2]
        edge-u = [0, 0, 4]
        edge-v = [4, 0, 0]
        material = "paint"
        {rest}
        "#
    );
    Stage::new(&text, (8, 8))
}

fn sphere(name: &str, center: [f64; 3], radius: f64, rest: &str) -> String {
    format!(
        "[[shapes]]\nname = \"{name}\"\ntype = \"sphere\"\ncenter = {center:?}\nradius = {radius}\n{rest}\n"
    )
}

const POINT: &str =
    "[[lights]]\nname = \"bulb\"\ntype = \"point\"\nposition = [0.0, 1.0, 0.0]\npower = 10.0\n";

/// A mirror far from the light, seen through a hole in a black wall, and small: one photon in hundreds that are aimed at
/// its surroundings is stored.
fn little_light() -> Stage {
    let glass = sphere("far", [1.9, -0.2, 0.0], 0.02, "material = \"glass\"");
    let shield = "[[shapes]]\nname = \"shield\"\ntype = \"disc\"\ncenter = [0.0, 0.9, 0.0]\nradius = 0.5\n\
                  normal = [0, 1, 0]\nmaterial = \"black\"\n";
    let lamp = "[[shapes]]\nname = \"lamp\"\ntype = \"disc\"\ncenter = [0.0, 1.0, 0.0]\nnormal = [0, -1, 0]\n\
                radius = 0.508\nmaterial = \"black\"\nemission = { radiance = 5.0 }\n";
    floor(&format!("{glass}{shield}{lamp}"))
}

#[test]
fn as_many_photons_are_stored_as_asked_for() {
    let wide = "[[shapes]]\ntype = \"quad\"\ncorner = [-2, -0.5, -2]\nedge-u = [4, 0, 0]\nedge-v = [0, 3, 0]\n\
                material = \"mirror\"\n";
    let scenes = [
        ("cornell-diffuse", Stage::load("cornell-diffuse", (8, 8)), vec![MapKind::Global]),
        ("cornell-spheres", Stage::load("cornell-spheres", (8, 8)), vec![MapKind::Global, MapKind::Caustic]),
        ("cardioid", Stage::load("cardioid", (8, 8)), vec![MapKind::Global, MapKind::Caustic]),
        ("mesh", Stage::load("mesh", (8, 8)), vec![MapKind::Global]),
        ("little light", little_light(), vec![MapKind::Caustic]),
        ("a wide mirror", floor(&format!("{wide}{POINT}")), vec![MapKind::Global, MapKind::Caustic]),
    ];
    for (name, stage, kinds) in scenes {
        for kind in kinds {
            for (stored, seed) in [(20_000, 1), (40_000, 2)] {
                let traced = trace(stage.scene(), kind, stored, seed);
                let off = traced.photons.len() as f64 / stored as f64 - 1.0;
                let per_stored = traced.emitted as f64 / stored as f64;
                println!(
                    "{name}, {kind:?}, {stored}: off {:+.2} %, {per_stored:.2} emitted each",
                    100.0 * off
                );
                assert!(off.abs() < 0.1, "{name}, {kind:?}: {} of {stored}", traced.photons.len());
            }
        }
    }
    let rare = trace(little_light().scene(), MapKind::Caustic, 20_000, 1);
    assert!(rare.emitted > 20 * 20_000, "the scene is not that dark: {}", rare.emitted);
}

/// Shares of photons that the scene file asks for change where photons go, and no light.
#[test]
fn overrides_move_photons_and_no_flux() {
    let scene = |lamp: f64, bulb: f64, ball: f64| {
        let glass = |name, x: f64, share: f64| {
            sphere(name, [x, -0.1, 0.0], 0.3, &format!("material = \"glass\"\ncaustic-photons = {share}"))
        };
        let lamp = format!(
            "[[shapes]]\nname = \"lamp\"\ntype = \"quad\"\ncorner = [-0.2, 1.2, -0.2]\nedge-u = [0.4, 0, 0]\n\
             edge-v = [0, 0, 0.4]\nmaterial = \"black\"\nemission = {{ radiance = 3.0, photons = {lamp} }}\n"
        );
        let bulb = POINT.replace("power", &format!("photons = {bulb}\npower"));
        floor(&format!("{}{}{lamp}{bulb}", glass("left", -0.6, 1.0), glass("right", 0.6, ball)))
    };
    let (plain, shifted) = (scene(1.0, 1.0, 1.0), scene(3.0, 0.5, 10.0));
    for kind in [MapKind::Global, MapKind::Caustic] {
        let share = |stage: &Stage| {
            let traced = trace(stage.scene(), kind, 20_000, 0);
            traced.tallies[0].emitted as f64 / traced.tallies[1].emitted as f64
        };
        // Six times as many from the lamp, relative to the bulb.
        let ratio = share(&shifted) / share(&plain);
        assert!((ratio / 6.0 - 1.0).abs() < 0.1, "{kind:?}: {ratio}");
        let flux = |stage: &Stage| {
            over_seeds(8, |seed| stored_watts(stage, trace(stage.scene(), kind, 20_000, seed)))
        };
        let (a, b) = (flux(&plain), flux(&shifted));
        let noise = a.1.hypot(b.1);
        println!("{kind:?}: {:.5} and {:.5} W +- {noise:.5}", a.0, b.0);
        assert!((a.0 - b.0).abs() < 4.0 * noise && noise < 0.01 * a.0, "{kind:?}: {a:?}, {b:?}");
    }
    let right = |stage: &Stage| {
        let photons = trace(stage.scene(), MapKind::Caustic, 20_000, 0).photons;
        photons.iter().filter(|photon| photon.position.x > 0.0).count() as f64 / photons.len() as f64
    };
    let (before, after) = (right(&plain), right(&shifted));
    assert!((before - 0.5).abs() < 0.05 && after > 0.8, "{before} to {after}");
}

/// More casters than a light aims at one by one, and more than it asks for each direction.
#[test]
fn flux_with_many_casters() {
    for count in [20, 700] {
        let balls: String = (0..count)
            .map(|i| {
                let (x, z) =
                    ((f64::from(i) * 0.618).fract() * 3.6 - 1.8, f64::from(i) / f64::from(count) * 3.6 - 1.8);
                format!("[[instances]]\ngroup = \"ball\"\ntransform = [{{ translate = [{x}, -0.3, {z}] }}]\n")
            })
            .collect();
        let ball = sphere("ball", [0.0; 3], 0.06, "material = \"glass\"\ngroup = \"ball\"");
        let lamp = "[[shapes]]\ntype = \"sphere\"\ncenter = [0.3, 1.0, 0.2]\nradius = 0.2\nmaterial = \"black\"\n\
                    emission = { radiance = 5.0 }\n";
        let stage = floor(&format!("{ball}{balls}{lamp}"));
        let scene = stage.scene();
        assert_eq!(scene.casters().len(), count as usize);
        let aimed = over_seeds(8, |seed| stored_watts(&stage, trace(scene, MapKind::Caustic, 20_000, seed)));
        let everywhere = over_seeds(8, |seed| {
            let traced = trace(scene, MapKind::Global, 60_000, seed);
            let caustic = traced.photons.iter().filter(|p| p.class() == PhotonClass::Caustic);
            stage.watts(caustic.map(|p| f64::from(p.power().x)).sum::<f64>() / traced.emitted as f64)
        });
        let noise = aimed.1.hypot(everywhere.1);
        println!("{count}: {:.5} aimed, {:.5} everywhere, +- {noise:.5}", aimed.0, everywhere.0);
        assert!((aimed.0 - everywhere.0).abs() < 4.0 * noise && noise < 0.02 * aimed.0);
    }
}

#[test]
fn casters_and_lights_without_photons_are_named() {
    let box_around = "[[shapes]]\nname = \"case\"\ntype = \"sphere\"\ncenter = [1.0, 0.0, 1.0]\nradius = 0.3\n\
                      material = \"black\"\n";
    let hidden = sphere("hidden pearl", [1.0, 0.0, 1.0], 0.1, "material = \"mirror\"");
    let seen = sphere("seen", [-0.5, 0.0, 0.0], 0.3, "material = \"mirror\"");
    let dim =
        "[[lights]]\nname = \"glow-worm\"\ntype = \"point\"\nposition = [0.5, 0.5, 0.5]\npower = 1e-4\n";
    let stage = floor(&format!("{box_around}{hidden}{seen}{POINT}{dim}"));
    let few = Overrides {
        spp: Some(1),
        global_photons: Some(20_000),
        caustic_photons: Some(20_000),
        gather_samples: Some(1),
        ..photon_map()
    };
    let shot = stage.shoot(&few);
    assert!(shot.warns("no caustic photon reached `hidden pearl`:"), "{:?}", shot.statistics.warnings);
    assert!(
        shot.warns("of the global map left `glow-worm`, fewer than 100"),
        "{:?}",
        shot.statistics.warnings
    );
    assert!(shot.warns("`caustic-photons`") && shot.warns("lights of a TOML scene have `photons` too"));
    // What the remedy asks for helps.
    let helped = floor(&format!("{seen}{POINT}{}", dim.replace("power", "photons = 1e5\npower")));
    let shot = helped.shoot(&few);
    assert!(shot.statistics.warnings.is_empty(), "{:?}", shot.statistics.warnings);
    for map in &shot.statistics.maps {
        assert!(map.asked == 20_000 && !map.stopped && map.photons.abs_diff(20_000) < 2_000);
    }
}

/// A pass that is stopped keeps what it has, and that is the same light.
#[test]
fn a_stopped_pass_is_an_estimate_of_the_same_flux() {
    let lamp = "[[shapes]]\ntype = \"quad\"\ncorner = [-0.2, 1.2, -0.2]\nedge-u = [0.4, 0, 0]\nedge-v = [0, 0, 0.4]\n\
                material = \"black\"\nemission = { radiance = 3.0 }\n";
    let stage = floor(&format!("{lamp}{POINT}"));
    let full =
        over_seeds(6, |seed| stored_watts(&stage, trace(stage.scene(), MapKind::Global, 200_000, seed)));
    let stopped = over_seeds(10, |seed| {
        let settings = TraceSettings {
            kind: MapKind::Global,
            stored: 400_000,
            seed,
            max_depth: 1000,
            aimed: true,
            wavelengths: Default::default(),
        };
        let calls = AtomicU64::new(0);
        let traced = trace_photons(stage.scene(), &settings, &|done, total| {
            calls.fetch_add(1, Ordering::Relaxed);
            total <= 1 || done * 7 < total
        });
        let traced = traced.unwrap();
        assert!(traced.stopped && traced.missing.is_empty());
        assert!((30_000..150_000).contains(&traced.photons.len()), "{}", traced.photons.len());
        assert_eq!(traced.tallies.iter().map(|t| t.emitted).sum::<u64>(), traced.emitted);
        let out: f64 = traced.tallies.iter().map(|t| t.power_emitted.x).sum::<f64>() / traced.emitted as f64;
        let all: f64 = stage.scene().lights().iter().map(|l| l.flux(stage.scene().bounds().1).x).sum();
        assert!((out / all - 1.0).abs() < 0.02, "{out} of {all}");
        stored_watts(&stage, traced)
    });
    let noise = full.1.hypot(stopped.1);
    println!("{:.5} in full, {:.5} stopped, +- {noise:.5}", full.0, stopped.0);
    assert!((full.0 - stopped.0).abs() < 4.0 * noise + 2e-4 * full.0 && noise < 0.01 * full.0);
    // Stopped at once: what the first short pass has, or nothing.
    let settings = TraceSettings {
        kind: MapKind::Global,
        stored: 400_000,
        seed: 0,
        max_depth: 1000,
        aimed: true,
        wavelengths: Default::default(),
    };
    let at_once = trace_photons(stage.scene(), &settings, &|_, _| false);
    assert!(at_once.is_none_or(|traced| traced.stopped && traced.emitted < 1000));
}

/// Light that total internal reflection keeps in a cube of glass is not followed for ever.
#[test]
fn trapped_photons_end_by_roulette() {
    let cube = "[[shapes]]\ntype = \"mesh\"\nvertices = [[-0.2,-0.2,-0.2], [0.2,-0.2,-0.2], [0.2,0.2,-0.2], \
                [-0.2,0.2,-0.2], [-0.2,-0.2,0.2], [0.2,-0.2,0.2], [0.2,0.2,0.2], [-0.2,0.2,0.2]]\n\
                faces = [[0,3,2,1], [4,5,6,7], [0,1,5,4], [3,7,6,2], [0,4,7,3], [1,2,6,5]]\nmaterial = \"glass\"\n";
    let stage = floor(&format!("{cube}{}", POINT.replace("0.0, 1.0, 0.0", "0.01, 0.02, 0.03")));
    for kind in [MapKind::Global, MapKind::Caustic] {
        let traced = trace(stage.scene(), kind, 20_000, 0);
        let tally = traced.tallies[0];
        assert_eq!((tally.truncated, tally.medium_mismatches), (0, 0), "{kind:?}");
        let bounces = tally.bounces as f64 / tally.emitted as f64;
        // A quarter of all directions never leaves by itself: 64 surfaces, and ten more on average.
        assert!((12.0..30.0).contains(&bounces), "{kind:?}: {bounces} surfaces each");
    }
}

/// A lid that shines on both sides, air above and a medium that absorbs everything below.
#[test]
fn each_side_of_a_light_has_its_own_medium() {
    let ink = "[materials.ink]\ntype = \"dielectric\"\nior = 1.3\nabsorption = 1e4\n";
    let pot = "[[shapes]]\ntype = \"mesh\"\nvertices = [[-0.2,-0.2,-0.2], [0.2,-0.2,-0.2], [0.2,0.2,-0.2], \
               [-0.2,0.2,-0.2], [-0.2,-0.2,0.2], [0.2,-0.2,0.2], [0.2,0.2,0.2], [-0.2,0.2,0.2]]\n\
               faces = [[0,3,2,1], [4,5,6,7], [0,1,5,4], [0,4,7,3], [1,2,6,5]]\nmaterial = \"ink\"\n";
    let lid = "[[shapes]]\ntype = \"quad\"\ncorner = [-0.2, 0.2, -0.2]\nedge-u = [0.0, 0, 0.4]\nedge-v = [0.4, 0, 0]\n\
               material = \"black\"\nemission = { radiance = 3.0, two-sided = true }\n";
    let above = "[[shapes]]\ntype = \"quad\"\ncorner = [-20, 0.7, -20]\nedge-u = [40, 0, 0]\nedge-v = [0, 0, 40]\n\
                 material = \"paint\"\n";
    let stage = floor(&format!("{ink}{pot}{lid}{above}"));
    let traced = trace(stage.scene(), MapKind::Global, 20_000, 0);
    assert!(traced.tallies[0].medium_mismatches == 0 && traced.divided.is_empty());
    // All that leaves above arrives at the ceiling, but for its edge; what leaves below is absorbed on its way, so that
    // nothing of it is stored anywhere.
    let direct = traced.photons.iter().filter(|photon| photon.class() == PhotonClass::Direct);
    let watts = stage.watts(direct.map(|p| f64::from(p.power().x)).sum::<f64>() / traced.emitted as f64);
    let want = std::f64::consts::PI * 3.0 * 0.16;
    assert!((watts / want - 1.0).abs() < 0.03, "{watts} W of {want} W");
    // What came out of the ink started a hair from its side.
    let through = traced.photons.iter().filter(|photon| photon.class() == PhotonClass::Caustic);
    let watts = stage.watts(through.map(|p| f64::from(p.power().x)).sum::<f64>() / traced.emitted as f64);
    assert!(watts < 1e-3 * want, "{watts} W");
}
