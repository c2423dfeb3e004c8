//! Rendering in rounds: it converges, knows how far it is, and can be gone on with.

use crate::support::*;
use cardioid::film::{Film, LayerSet};
use cardioid::image_io;
use cardioid::render::{
    CheckpointError, IntegratorKind, Overrides, RenderError, RenderRequest, Rendered, RoundStatistics,
    Rounds, Silent, render_in_rounds,
};
use std::fs;
use std::path::Path;

/// Pixels on a side: an eighth of the references', whose means over 8 x 8 pixels are then the reference.
const SIDE: usize = 32;

fn in_rounds(rounds: u64) -> Overrides {
    Overrides {
        integrator: Some(IntegratorKind::Progressive),
        rounds: Some(rounds),
        spp: Some(1),
        global_photons: Some(10_000),
        caustic_photons: Some(20_000),
        ..Overrides::default()
    }
}

fn stage(name: &str) -> Stage {
    Stage::load(name, (SIDE as u32, SIDE as u32))
}

fn shoot(stage: &Stage, overrides: &Overrides, rounds: Rounds) -> Result<Rendered, RenderError> {
    let request = RenderRequest { layers: LayerSet::default(), ..stage.request(overrides) };
    render_in_rounds(stage.scene(), &stage.built.camera, &request, &Silent, rounds)
}

fn statistics(rendered: &Rendered) -> &RoundStatistics {
    rendered.statistics.rounds.as_ref().unwrap()
}

fn bytes(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.save(&mut bytes).unwrap();
    bytes
}

/// Halves of a reference at this size.
fn reference(scene: &str) -> [Vec<f64>; 2] {
    [1, 2].map(|half| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(scene);
        let image = image_io::read(folder.join(format!("reference-{half}.exr"))).unwrap();
        let step = image.width as usize / SIDE;
        let data = &image.layer("").unwrap().data;
        let channels = image.layer("").unwrap().channels.len();
        let [r, g, b] = ["R", "G", "B"].map(|c| image.layer("").unwrap().channel_index(c).unwrap());
        let mut small = vec![0.0; 3 * SIDE * SIDE];
        for (pixel, values) in data.chunks_exact(channels).enumerate() {
            let (x, y) = (pixel % image.width as usize / step, pixel / image.width as usize / step);
            for (channel, from) in [r, g, b].into_iter().enumerate() {
                small[3 * (y * SIDE + x) + channel] += f64::from(values[from]) / (step * step) as f64;
            }
        }
        small
    })
}

/// The relative error that progressive rendering estimates, against a reference.
fn error_against(film: &Film, [a, b]: &[Vec<f64>; 2]) -> f64 {
    let values = film.develop().beauty().to_vec();
    let mean = a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).sum::<f64>() / a.len() as f64;
    let square = values.iter().zip(a.iter().zip(b)).map(|(&t, (a, b))| {
        let (t, r) = (f64::from(t), 0.5 * (a + b));
        (t - a) * (t - b) / (r * r + 0.01 * mean * mean)
    });
    (square.sum::<f64>() / a.len() as f64).max(0.0).sqrt()
}

/// Error falls with the rounds on all three reference scenes, and the estimate is within a third of it: a test of 3072 values, whose
/// mean square of a noise with heavy tails is certain to some 10 %.
#[test]
fn error_falls_with_rounds_and_is_known() {
    for scene in ["cornell-diffuse", "cornell-spheres", "cardioid"] {
        let (stage, reference) = (stage(scene), reference(scene));
        let found: Vec<(f64, f64)> = [16, 128]
            .map(|rounds| {
                let rendered = shoot(&stage, &in_rounds(rounds), Rounds::keeping_nothing()).unwrap();
                let estimate = statistics(&rendered).error.unwrap();
                println!(
                    "{scene}, {rounds} rounds: {:.4}, {estimate:?}",
                    error_against(&rendered.film, &reference)
                );
                (error_against(&rendered.film, &reference), estimate.error)
            })
            .to_vec();
        // Eight times the rounds: 2.8 for noise alone, 2 for the balance of noise and bias at the worst.
        let slope = (found[1].0 / found[0].0).ln() / 8f64.ln();
        println!("{scene}: slope {slope:.3}");
        assert!(slope < -0.33, "{scene}: slope {slope}, {found:?}");
        for (actual, estimated) in found {
            assert!((0.67..1.7).contains(&(estimated / actual)), "{scene}: {estimated} for {actual}");
        }
    }
}

#[test]
fn a_resumed_render_is_the_same_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rounds");
    let stage = stage("cornell-spheres");
    let whole = shoot(&stage, &in_rounds(5), Rounds::keeping_nothing()).unwrap();
    let identity = vec![("scene".to_owned(), "spheres".to_owned())];
    let to = Rounds { identity: identity.clone(), checkpoint: Some(path.clone()), resume: None };
    let first = shoot(&stage, &in_rounds(2), to.clone()).unwrap();
    assert_eq!((statistics(&first).done, statistics(&first).resumed), (2, 0));
    let from = Rounds { resume: Some(path.clone()), ..to };
    let resumed = shoot(&stage, &in_rounds(5), from.clone()).unwrap();
    assert_eq!((statistics(&resumed).done, statistics(&resumed).resumed), (5, 2));
    assert_eq!(bytes(&whole.film), bytes(&resumed.film));
    assert_eq!(whole.statistics.counters, resumed.statistics.counters);
    let known = |rendered: &Rendered| {
        let rounds = statistics(rendered);
        (rounds.error, rounds.history.clone(), rounds.photons_emitted, rounds.photons_stored, rounds.area)
    };
    assert_eq!(known(&whole), known(&resumed));
    // Nothing more to do.
    let again = shoot(&stage, &in_rounds(5), from.clone()).unwrap();
    assert_eq!(bytes(&whole.film), bytes(&again.film));
    // Of something else.
    let other = Overrides { spp: Some(2), caustic_nearest: Some(33), ..in_rounds(5) };
    let error = shoot(&stage, &other, from.clone()).unwrap_err();
    assert!(matches!(error, RenderError::Checkpoint(CheckpointError::Different { .. })), "{error}");
    let message = error.to_string();
    for part in ["spp was 1 and is 2", "caustic-nearest was 60 and is 33"] {
        assert!(message.contains(part), "{message}");
    }
    let elsewhere = Rounds { identity: vec![("scene".to_owned(), "ring".to_owned())], ..from.clone() };
    let message = shoot(&stage, &in_rounds(5), elsewhere).unwrap_err().to_string();
    assert!(message.contains("scene was spheres and is ring"), "{message}");
    // Damaged anywhere.
    let kept = fs::read(&path).unwrap();
    for at in [0, 17, 21, 40, kept.len() / 2, kept.len() - 1] {
        let mut damaged = kept.clone();
        damaged[at] ^= 1;
        fs::write(&path, damaged).unwrap();
        let error = shoot(&stage, &in_rounds(5), from.clone()).unwrap_err();
        assert!(matches!(error, RenderError::Checkpoint(_)), "byte {at}: {error}");
    }
    for length in [0, 10, 22, kept.len() - 33, kept.len() - 1] {
        fs::write(&path, &kept[..length]).unwrap();
        let error = shoot(&stage, &in_rounds(5), from.clone()).unwrap_err();
        assert!(
            matches!(error, RenderError::Checkpoint(CheckpointError::Damaged { .. })),
            "{length}: {error}"
        );
    }
}

#[test]
fn a_target_is_reached_and_its_rounds_give_the_same_picture() {
    let stage = stage("cornell-diffuse");
    let target = Overrides { rounds: None, target_error: Some(0.15), ..in_rounds(1) };
    let reached = shoot(&stage, &target, Rounds::keeping_nothing()).unwrap();
    let rounds = statistics(&reached);
    assert!(
        rounds.done >= 4 && rounds.done.is_multiple_of(2) && rounds.error.unwrap().error <= 0.15,
        "{rounds:?}"
    );
    let again = shoot(&stage, &in_rounds(rounds.done), Rounds::keeping_nothing()).unwrap();
    assert_eq!(bytes(&reached.film), bytes(&again.film));
    // What cannot know its error is not asked for one.
    let wrong = Overrides { target_error: Some(0.1), ..path() };
    let request = stage.request(&wrong);
    let error = cardioid::render::render(stage.scene(), &stage.built.camera, &request, &Silent).unwrap_err();
    assert!(matches!(error, RenderError::TargetWithoutRounds));
    // Where nothing else is asked for, a target means rounds.
    let alone = Overrides { target_error: Some(0.1), ..Overrides::default() };
    assert_eq!(stage.settings(&alone).integrator, IntegratorKind::Progressive);
}

/// In the crevices of a polished flake every gather ray meets many surfaces from which sampling might go on, all of which had one
/// more each: that grew without an end. Together they are worth less than one ray.
#[test]
fn recursion_dies_out_between_polished_spheres() {
    let stage = Stage::load("museum", (24, 18));
    let rendered = shoot(&stage, &in_rounds(1), Rounds::keeping_nothing()).unwrap();
    let counters = &rendered.statistics.counters;
    println!("{} evaluations drawn, {} gather rays", counters.accurate_drawn, counters.gather_rays);
    assert!(counters.accurate_drawn > 500 && counters.accurate_drawn < 10_000, "{counters:?}");
}
