//! The irradiance cache, and which evaluations are accurate and which approximate.

use crate::support::*;
use cardioid::film::PixelRect;
use cardioid::render::Overrides;

fn quick() -> Overrides {
    Overrides {
        spp: Some(4),
        global_photons: Some(50_000),
        caustic_photons: Some(20_000),
        irradiance_cache: Some(true),
        ..photon_map()
    }
}

fn without(overrides: &Overrides) -> Overrides {
    Overrides { irradiance_cache: Some(false), ..overrides.clone() }
}

/// Root of the mean square of the difference, over the mean of `b`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(&a, &b)| f(f64::from(a), f64::from(b))).sum()
    };
    let count = a.len() as f64;
    (sum(&|a, b| (a - b).powi(2)) / count).sqrt() / (sum(&|_, b| b) / count)
}

#[test]
fn interpolation_shows_what_gathering_shows() {
    let stage = Stage::load("cornell-diffuse", (96, 96));
    let cached = stage.shoot(&quick());
    let many = Overrides { spp: Some(16), gather_samples: Some(16), ..quick() };
    let gathered = stage.shoot(&without(&many));
    assert_close("indirect", cached.mean("indirect"), gathered.mean("indirect"), 0.01);
    let plain = stage.shoot(&without(&quick()));
    let noise = difference(plain.layer("indirect"), gathered.layer("indirect"));
    let off = difference(cached.layer("indirect"), gathered.layer("indirect"));
    // What it is compared with has a quarter of the noise of plain gathering.
    println!("rms difference {off}, of plain gathering {noise}");
    assert!(off < 0.1 && off < 0.5 * noise, "{off} {noise}");
    let (with, without) = (&cached.statistics.counters, &plain.statistics.counters);
    let filling = cached.statistics.cache.unwrap();
    assert!(with.cache_hits > 20 * with.cache_misses, "{with:?}");
    assert!(filling.records > 100 && filling.rejected == 0);
    println!("{} records, {} rays", filling.records, filling.counters.gather_rays);
    assert!(plain.statistics.cache.is_none() && without.cache_hits + without.cache_misses == 0);
    // Rays through the picture end two segments from the eye (Jensen 1996, section 6), but for corners.
    let depth = cached.statistics.mean_path_depth;
    assert!((2.0..2.4).contains(&depth), "{depth}");
}

#[test]
fn nothing_but_indirect_light_changes() {
    let stage = Stage::load("cornell-spheres", (48, 48));
    let (with, without) = (stage.shoot(&quick()), stage.shoot(&without(&quick())));
    for layer in ["emission", "direct", "caustics"] {
        assert_eq!(with.layer(layer), without.layer(layer), "{layer}");
    }
    assert!(with.layer("indirect") != without.layer("indirect"));
    // Behind glass and in the mirror as well.
    assert_close("specular", with.mean("specular"), without.mean("specular"), 0.02);
    assert!(with.layer("specular") != without.layer("specular"));
    assert!(with.statistics.plan.irradiance_cache.build && !without.statistics.plan.irradiance_cache.build);
}

#[test]
fn a_window_shows_what_the_whole_shows() {
    let stage = Stage::load("cornell-diffuse", (40, 40));
    let whole = stage.shoot(&quick());
    let window = stage.crop(&quick(), PixelRect { x0: 10, y0: 20, x1: 30, y1: 32 });
    let (all, part) = (whole.layer("beauty"), window.layer("beauty"));
    for (i, &value) in part.iter().enumerate() {
        let (x, y, channel) = (10 + i / 3 % 20, 20 + i / 60, i % 3);
        assert_eq!(value.to_bits(), all[(y * 40 + x) * 3 + channel].to_bits());
    }
}

/// Two cells without a roof, side by side, with a wall without thickness between them; a lamp low in one of them. No light
/// reaches the other: what is above its walls is empty.
fn cells() -> Stage {
    let wall = |corner: [f64; 3], u: [f64; 3], v: [f64; 3]| {
        format!(
            "[[shapes]]\ntype = \"quad\"\ncorner = {corner:?}\nedge-u = {u:?}\nedge-v = {v:?}\nmaterial = \"white\"\n"
        )
    };
    let (along, up) = ([0.0, 0.0, 2.0], [0.0, 1.0, 0.0]);
    let text = [
        "[camera]\neye = [0.0, 6.0, 0.0]\nat = [0.0, 0.0, 0.0]\nup = [0.0, 0.0, 1.0]\nfov = 30.0\n".to_owned(),
        "[materials.white]\ntype = \"lambert\"\nreflectance = 0.8\n".to_owned(),
        wall([-1.0, 0.0, -1.0], [2.0, 0.0, 0.0], along),
        wall([-1.0, 0.0, -1.0], along, up),
        wall([0.0, 0.0, -1.0], along, up),
        wall([1.0, 0.0, -1.0], along, up),
        wall([-1.0, 0.0, -1.0], [2.0, 0.0, 0.0], up),
        wall([-1.0, 0.0, 1.0], [2.0, 0.0, 0.0], up),
        "[[shapes]]\ntype = \"quad\"\ncorner = [0.4, 0.6, -0.2]\nedge-u = [0.2, 0.0, 0.0]\nedge-v = [0.0, 0.0, 0.4]\n\
         material = \"white\"\nemission = { radiance = 10.0 }\n"
            .to_owned(),
    ]
    .concat();
    Stage::new(&text, (64, 64))
}

#[test]
fn no_light_passes_a_thin_wall() {
    let stage = cells();
    const SEEDS: u64 = 5;
    for error in [0.1, 0.3, 0.5] {
        let (mut lit, mut dark, mut far) = (0.0, 0.0, 0.0);
        for seed in 1..=SEEDS {
            // Full estimates, which are clipped to what their centre sees; the nearest precomputed irradiance may lie
            // behind the wall.
            let settings = Overrides {
                cache_error: Some(error),
                precomputed_irradiance: Some(false),
                seed: Some(seed),
                ..quick()
            };
            let shot = stage.shoot(&settings);
            let indirect = shot.layer("indirect");
            // The cell on the side of -x is on the side where nothing is lit; find out which half of the picture that is.
            let column = |x: usize| -> f64 { (0..64).map(|y| f64::from(indirect[(y * 64 + x) * 3])).sum() };
            let halves: [f64; 2] = [(0..32).map(column).sum(), (32..64).map(column).sum()];
            dark += halves[0].min(halves[1]);
            lit += halves[0].max(halves[1]);
            // The wall is in the middle of the picture; half a pixel of reach on each side of it may show.
            let dark_is_left = halves[0] < halves[1];
            far += (0..30).map(|i| column(if dark_is_left { i } else { 63 - i })).sum::<f64>();
        }
        println!("error {error}: dark {:e}, away from the wall {:e} of what is lit", dark / lit, far / lit);
        // Where the wall ends at the top of the box, sixteen feelers let 2.7e-4 of the light pass from cell to cell; a
        // single seed spreads by 0.9e-4 around that.
        assert!(lit > 1.0 && far < 4e-4 * lit, "{}", far / lit);
        assert!(dark < 1.5e-3 * lit, "{}", dark / lit);
    }
}

#[test]
fn too_few_photons_are_replaced_by_sampling() {
    let stage = Stage::load("cornell-diffuse", (24, 24));
    let truth = stage.shoot(&Overrides { spp: Some(512), ..path() });
    for precomputed_irradiance in [true, false] {
        let few = Overrides {
            spp: Some(64),
            global_photons: Some(150),
            precomputed_irradiance: Some(precomputed_irradiance),
            accurate_distance: Some(0.0),
            ..without(&quick())
        };
        let shot = stage.shoot(&few);
        let counters = &shot.statistics.counters;
        println!("{counters:?}");
        assert!(counters.accurate_poor > counters.approximate_diffuse / 4, "{counters:?}");
        assert_close("indirect", shot.mean("indirect"), truth.mean("indirect"), 0.1);
        let enough = stage.shoot(&Overrides { global_photons: Some(50_000), spp: Some(4), ..few });
        let counters = &enough.statistics.counters;
        // Corners that are seen from closer than the points there lie apart are sampled, 4 % here.
        assert!(counters.accurate_poor < counters.approximate_diffuse / 20, "{counters:?}");
    }
}

#[test]
fn corners_are_computed_and_faint_paths_looked_up() {
    let stage = Stage::load("cornell-spheres", (32, 32));
    // One such picture is off by some 4 %.
    let runs: Vec<[f64; 3]> = (0..8)
        .map(|seed| stage.shoot(&Overrides { spp: Some(512), seed: Some(seed), ..path() }).mean("indirect"))
        .collect();
    let truth = [0, 1, 2].map(|channel| runs.iter().map(|run| run[channel]).sum::<f64>() / 8.0);
    let at = |accurate_distance, approximate_weight| {
        let overrides = Overrides {
            spp: Some(16),
            accurate_distance: Some(accurate_distance),
            approximate_weight: Some(approximate_weight),
            ..quick()
        };
        stage.shoot(&overrides)
    };
    let (none, corners, faint) = (at(0.0, 0.0), at(0.2, 0.0), at(0.0, 0.05));
    let of = |shot: &Shot| {
        let c = &shot.statistics.counters;
        let filling = shot.statistics.cache.unwrap().counters;
        (c.accurate_close + filling.accurate_close, c.approximate_weight)
    };
    assert_eq!(of(&none), (0, 0));
    assert!(of(&corners).0 > 10_000 && of(&corners).1 == 0);
    assert!(of(&faint).0 == 0 && of(&faint).1 > 200, "{:?}", of(&faint));
    // Few pixels of the green wall carry the green light. Caustics seen through glass are too noisy in path tracing: what the
    // decisions change of them is measured against the same maps.
    for shot in [&none, &corners, &faint] {
        assert_close("indirect", shot.mean("indirect"), truth, 0.06);
        assert_close("specular", shot.mean("specular"), none.mean("specular"), 0.03);
    }
    // Recursion lengthens the paths of image-sampling rays.
    assert!(corners.statistics.mean_path_depth > none.statistics.mean_path_depth);
}
