//! What thousands of lights take in memory is foreseen. One test alone, as it looks at the memory of its process.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet};
use cardioid::render::{MemoryEstimate, Quality, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{build_scene, parse_scene};
use std::path::Path;
use std::sync::Arc;

const SIZE: (u32, u32) = (24, 18);

/// A floor with forty balls of glass, and half of so many lights as points, half as spheres that emit, in rows above it.
fn scene(lights: u32) -> String {
    let mut text = "
        [camera]
        eye = [0, 3, 8]
        at = [0, 0, 0]
        [materials.white]
        type = \"lambert\"
        reflectance = 0.5
        [materials.glass]
        type = \"dielectric\"
        ior = 1.5
        [[shapes]]
        type = \"quad\"
        corner = [-5, 0, 5]
        edge-u = [10, 0, 0]
        edge-v = [0, 0, -10]
        material = \"white\"
    "
    .to_owned();
    let place = |i: u32, height: f64| {
        let turn = 2.399_963 * f64::from(i);
        let radius = 4.0 * (f64::from(i) / f64::from(lights.max(40))).sqrt();
        format!("[{}, {height}, {}]", radius * turn.cos(), radius * turn.sin())
    };
    for i in 0..40 {
        text += &format!(
            "[[shapes]]\ntype = \"sphere\"\ncenter = {}\nradius = 0.2\nmaterial = \"glass\"\n",
            place(i * lights.max(40) / 40, 0.5)
        );
    }
    for i in 0..lights / 2 {
        text += &format!(
            "[[shapes]]\ntype = \"sphere\"\ncenter = {}\nradius = 0.01\nmaterial = \"white\"\nemission = {{ radiance = 1 }}\n\
             [[lights]]\ntype = \"point\"\nposition = {}\npower = 1\n",
            place(2 * i, 4.0),
            place(2 * i + 1, 4.0)
        );
    }
    text
}

/// The most memory that this process has had, bytes.
fn peak() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()?)
}

/// What rendering a scene of so many lights was foreseen to take, and what this process has had since.
fn render_lights(lights: u32) -> Option<(u64, u64)> {
    let description = parse_scene(&scene(lights), Path::new("lights.toml"), &[]).unwrap();
    let device = Arc::new(Device::new(0).unwrap());
    let built = build_scene(&description, &device, SIZE).unwrap();
    let settings = Settings {
        spp: 1,
        global_photons: 500_000,
        caustic_photons: 50_000,
        irradiance_cache: false,
        ..Quality::Draft.settings()
    };
    let plan = settings.plan(&built.scene);
    let estimate = MemoryEstimate::of_scene(&description, SIZE).with_photons(&settings, &plan, &built.scene);
    let request = RenderRequest {
        width: SIZE.0,
        height: SIZE.1,
        crop: None,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings,
    };
    render(&built.scene, &built.camera, &request, &Silent).unwrap();
    Some((estimate.peak(), peak()?))
}

#[test]
fn thousands_of_lights_take_what_is_foreseen() {
    const LIGHTS: u32 = 6000;
    // The first makes what all renders share.
    let (Some(few), Some(many)) = (render_lights(100), render_lights(LIGHTS)) else {
        println!("skipped: the system does not tell");
        return;
    };
    let (foreseen, taken) = (many.0 - few.0, many.1 - few.1);
    println!("{} bytes a light foreseen, {} taken", foreseen / u64::from(LIGHTS), taken / u64::from(LIGHTS));
    assert!(taken <= foreseen, "{taken} bytes for {foreseen}");
    // Nor is anything refused that would fit by far.
    assert!(foreseen <= 4 * taken, "{foreseen} bytes for {taken}");
}
