//! Error figures of real pictures against figures that were computed by other code.

use cardioid::image_io;
use cardioid::measure::{ErrorFigures, Picture, Reference};
use serde_json::Value;
use std::path::Path;

struct Loaded {
    width: u32,
    height: u32,
    values: Vec<f32>,
}

impl Loaded {
    fn read(path: &Path) -> Self {
        let image = image_io::read(path).unwrap();
        let layer = image.layer("").unwrap();
        let rgb = ["R", "G", "B"].map(|name| layer.channel_index(name).unwrap());
        let pixels = layer.data.chunks_exact(layer.channels.len());
        let values = pixels.flat_map(|pixel| rgb.map(|channel| pixel[channel])).collect();
        Self { width: image.width, height: image.height, values }
    }

    fn view(&self) -> Picture<'_> {
        Picture::new(self.width, self.height, &self.values).unwrap()
    }
}

fn compare(halves: [&Path; 2], test: &Path) -> ErrorFigures {
    let [first, second] = halves.map(Loaded::read);
    let reference = Reference::halves(first.view(), second.view()).unwrap();
    reference.compare(Loaded::read(test).view()).unwrap()
}

fn assert_figures(figures: &ErrorFigures, expected: &Value, what: &str) {
    let close = |name: &str, value: f64, tolerance: f64| {
        let want = expected[name].as_f64().unwrap();
        assert!((value - want).abs() <= tolerance * want.abs(), "{what}: {name} is {value}, not {want}");
    };
    // The reference's mean is rounded to f32 here: 1e-7 of r, much less of the sums.
    close("rmse", figures.rmse, 1e-9);
    close("relmse", figures.relmse, 1e-9);
    close("relmse_u", figures.relmse_u.unwrap(), 1e-9);
    close("relmse_t", figures.relmse_t, 1e-9);
    close("bias", figures.bias, 1e-8);
    close("firefly", figures.firefly, 1e-12);
    // FLIP was computed in f32 there; the powers near zero differ.
    close("flip", figures.flip, 5e-5);
    assert_eq!(Some(figures.nan), expected["nan"].as_u64());
}

fn read_json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_picture_full_of_fireflies() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let [first, second] =
        ["reference-1.exr", "reference-2.exr"].map(|name| folder.join("cardioid").join(name));
    let figures = compare([&first, &second], &folder.join("metrics/cardioid-path-64spp.exr"));
    assert_figures(&figures, &read_json(&folder.join("metrics/expected.json")), "cardioid");
}

#[test]
fn every_picture_of_the_shared_references() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference");
    let expected = folder.join("expected-metrics.json");
    if !expected.is_file() {
        println!("skipped: there is no ../shared/reference beside the repository");
        return;
    }
    for entry in read_json(&expected).as_array().unwrap() {
        let path = |name: &Value| folder.join(name.as_str().unwrap());
        let halves = [path(&entry["reference"][0]), path(&entry["reference"][1])];
        let figures = compare([&halves[0], &halves[1]], &path(&entry["test"]));
        assert_figures(&figures, entry, entry["test"].as_str().unwrap());
    }
}
