//! Camera samples shared out by variance: the same mean, less noise, and no bit that depends on how it is computed.

use super::support::{Shot, Stage, path, photon_map};
use cardioid::film::{LayerSet, PixelRect};
use cardioid::render::{Overrides, RenderRequest};

/// A floor that is even but for the edge of a soft shadow, seen from below what casts it.
fn shadow(size: (u32, u32)) -> Stage {
    Stage::new(
        "
        [camera]
        eye = [0, 0.9, 0.01]
        at = [0, 0, 0]
        fov = 90
        [materials.white]
        type = \"lambert\"
        reflectance = 0.7
        [materials.black]
        type = \"lambert\"
        reflectance = 0.0
        [[shapes]]
        type = \"quad\"
        corner = [-3, 0, 3]
        edge-u = [6, 0, 0]
        edge-v = [0, 0, -6]
        material = \"white\"
        [[shapes]]
        type = \"quad\"
        corner = [0.1, 1.0, 3]
        edge-u = [3, 0, 0]
        edge-v = [0, 0, -6]
        material = \"black\"
        [[shapes]]
        type = \"quad\"
        corner = [-0.3, 4, -0.3]
        edge-u = [0.6, 0, 0]
        edge-v = [0, 0, 0.6]
        material = \"black\"
        emission = { radiance = 40.0 }
        ",
        size,
    )
}

fn by_variance(settings: Overrides) -> Overrides {
    Overrides { adaptive: Some(true), ..settings }
}

fn shoot(stage: &Stage, settings: &Overrides, crop: Option<PixelRect>) -> Shot {
    let request = stage.request(settings);
    let layers = LayerSet { samples: true, ..LayerSet::all() };
    stage.shoot_request(&RenderRequest { layers, crop, ..request })
}

fn quick() -> Overrides {
    by_variance(Overrides {
        spp: Some(6),
        global_photons: Some(10_000),
        caustic_photons: Some(10_000),
        ..photon_map()
    })
}

#[test]
fn threads_and_windows_change_no_bit() {
    let stage = Stage::load("cornell-spheres", (40, 40));
    let whole = shoot(&stage, &quick(), None);
    let counts = whole.layer("samples");
    let mean = counts.iter().map(|&n| f64::from(n)).sum::<f64>() / counts.len() as f64;
    let adaptive = whole.statistics.adaptive.unwrap();
    assert!((mean - 6.0).abs() < 0.1 && (adaptive.mean - mean).abs() < 1e-9, "{mean}");
    assert!(f64::from(adaptive.most) > 2.0 * mean && adaptive.fewest >= adaptive.pilot, "{adaptive:?}");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let other = pool.install(|| shoot(&stage, &quick(), None));
        assert_eq!(whole.developed, other.developed);
    }
    let crop = PixelRect { x0: 5, y0: 13, x1: 29, y1: 34 };
    let part = shoot(&stage, &quick(), Some(crop));
    for layer in &part.developed.layers {
        let (all, channels) = (whole.layer(layer.name), layer.channels.len());
        for (i, (x, y)) in crop.pixels().enumerate() {
            let j = (y * 40 + x) as usize;
            let (a, b) = (&layer.values[i * channels..][..channels], &all[j * channels..][..channels]);
            assert!(a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()), "{} at {x}, {y}", layer.name);
        }
    }
}

/// Mean over 150 seeds of the mean of the picture, against that of as many samples for every pixel: within 4 standard errors of
/// the difference, which chance exceeds once in 15 000.
#[test]
fn the_mean_stays() {
    let stage = Stage::load("cornell-diffuse", (8, 8));
    let moments = |settings: Overrides| {
        let means: Vec<f64> = (0..150)
            .map(|seed| stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() }).mean("beauty")[1])
            .collect();
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        (mean, (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
    };
    let plain = Overrides { spp: Some(6), ..path() };
    let (want, error_of_want) = moments(plain.clone());
    let (mean, error) = moments(by_variance(plain));
    println!("{mean} +- {error}, uniform {want} +- {error_of_want}");
    assert!((mean - want).abs() < 4.0 * error.hypot(error_of_want), "{mean} +- {error}, not {want}");
    assert!(error < 0.02 * mean);
}

/// Half of the error at equal samples, where a tenth of the picture is noisy: a quarter at 16 samples in the mean over seeds,
/// and three fifths at 8, of which two are a pilot that a thin edge can slip through.
#[test]
fn noise_falls_where_it_was() {
    let stage = shadow((64, 64));
    let reference = stage.shoot(&Overrides { spp: Some(1024), seed: Some(9), ..path() });
    let error = |settings: &Overrides, seed: u64| {
        let shot = stage.shoot(&Overrides { seed: Some(seed), ..settings.clone() });
        let pairs = shot.layer("beauty").iter().zip(reference.layer("beauty"));
        let sum: f64 = pairs
            .map(|(a, b)| {
                let (a, b) = (f64::from(*a), f64::from(*b));
                (a - b).powi(2) / (b * b + 0.01)
            })
            .sum();
        sum / shot.layer("beauty").len() as f64
    };
    let mean = |settings: Overrides| (0..4).map(|seed| error(&settings, seed)).sum::<f64>() / 4.0;
    let plain = Overrides { spp: Some(16), ..path() };
    let (uniform, adaptive) = (mean(plain.clone()), mean(by_variance(plain)));
    println!("uniform {uniform:.3e}, by variance {adaptive:.3e}");
    assert!(adaptive < 0.5 * uniform, "{adaptive}, not half of {uniform}");
}
