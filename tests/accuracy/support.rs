//! From scene text to numbers.

use cardioid::embree::Device;
use cardioid::film::{Developed, Filter, LayerSet, PixelRect};
use cardioid::render::{
    IntegratorKind, MapKind, Overrides, RenderRequest, Settings, Silent, Statistics, render,
};
use cardioid::scene::Scene;
use cardioid::scene_file::{BuiltScene, SceneDescription, build_scene, load_scene, parse_scene};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

/// Photon maps and final gathering at every camera sample, so that pixels are independent estimates. The irradiance cache has
/// tests of its own.
pub(crate) fn photon_map() -> Overrides {
    Overrides {
        integrator: Some(IntegratorKind::PhotonMap),
        irradiance_cache: Some(false),
        ..Overrides::default()
    }
}

/// Path tracing.
pub(crate) fn path() -> Overrides {
    Overrides { integrator: Some(IntegratorKind::Path), ..Overrides::default() }
}

/// One map, shown directly.
pub(crate) fn show(map: MapKind) -> Overrides {
    Overrides { integrator: Some(IntegratorKind::Photons), map: Some(map), ..Overrides::default() }
}

/// The five parts, in the order of the film.
pub(crate) const PARTS: [&str; 5] = ["emission", "direct", "specular", "caustics", "indirect"];

/// One for all tests: Embree's threads are few.
pub(crate) fn device() -> &'static Arc<Device> {
    static DEVICE: LazyLock<Arc<Device>> = LazyLock::new(|| Arc::new(Device::new(0).unwrap()));
    &DEVICE
}

/// A scene ready to be rendered.
pub(crate) struct Stage {
    pub(crate) description: SceneDescription,
    pub(crate) built: BuiltScene,
    pub(crate) size: (u32, u32),
}

impl Stage {
    /// From scene text.
    pub(crate) fn new(text: &str, size: (u32, u32)) -> Self {
        let description =
            parse_scene(text, Path::new("test.toml"), &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        Self::of(description, size)
    }

    /// From a file in `scenes/`.
    pub(crate) fn load(name: &str, size: (u32, u32)) -> Self {
        let description = load_scene(&scene_path(name), &[]).unwrap_or_else(|e| panic!("{e}"));
        Self::of(description, size)
    }

    pub(crate) fn of(description: SceneDescription, size: (u32, u32)) -> Self {
        let built = build_scene(&description, device(), size).unwrap_or_else(|e| panic!("{e}"));
        Self { description, built, size }
    }

    pub(crate) fn scene(&self) -> &Scene {
        &self.built.scene
    }

    pub(crate) fn settings(&self, overrides: &Overrides) -> Settings {
        Settings::from(&overrides.clone().over(self.description.render.clone()))
    }

    pub(crate) fn request(&self, overrides: &Overrides) -> RenderRequest {
        RenderRequest {
            width: self.size.0,
            height: self.size.1,
            crop: None,
            filter: Filter::Box { radius: 0.5 },
            layers: LayerSet::all(),
            settings: self.settings(overrides),
        }
    }

    /// The picture.
    pub(crate) fn shoot(&self, overrides: &Overrides) -> Shot {
        self.shoot_request(&self.request(overrides))
    }

    /// Some pixels of it.
    pub(crate) fn crop(&self, overrides: &Overrides, crop: PixelRect) -> Shot {
        self.shoot_request(&RenderRequest { crop: Some(crop), ..self.request(overrides) })
    }

    pub(crate) fn shoot_request(&self, request: &RenderRequest) -> Shot {
        let rendered = render(self.scene(), &self.built.camera, request, &Silent).unwrap();
        assert!(rendered.stopped.is_none());
        let shot = Shot { developed: rendered.film.develop(), statistics: rendered.statistics };
        shot.assert_sound();
        shot
    }

    /// Watts of a flux in the units of render space.
    pub(crate) fn watts(&self, flux: f64) -> f64 {
        let space = self.scene().space();
        flux / (space.power * space.scale * space.scale)
    }
}

pub(crate) fn scene_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("toml")
}

/// A picture and how it came about.
pub(crate) struct Shot {
    pub(crate) developed: Developed,
    pub(crate) statistics: Statistics,
}

impl Shot {
    /// Values of a layer.
    pub(crate) fn layer(&self, name: &str) -> &[f32] {
        &self.developed.layer(name).unwrap().values
    }

    /// Mean of a layer, by channel.
    pub(crate) fn mean(&self, name: &str) -> [f64; 3] {
        let values = self.layer(name);
        let pixels = (values.len() / 3) as f64;
        std::array::from_fn(|c| values.iter().skip(c).step_by(3).map(|&v| f64::from(v)).sum::<f64>() / pixels)
    }

    /// Standard error of [`Self::mean`] if pixels are independent estimates of one value: only for flat pictures, and
    /// an upper bound elsewhere.
    pub(crate) fn standard_error(&self, name: &str) -> [f64; 3] {
        let (values, mean) = (self.layer(name), self.mean(name));
        let pixels = (values.len() / 3) as f64;
        std::array::from_fn(|c| {
            let squares =
                values.iter().skip(c).step_by(3).map(|&v| (f64::from(v) - mean[c]).powi(2)).sum::<f64>();
            (squares / (pixels * (pixels - 1.0).max(1.0))).sqrt()
        })
    }

    /// What holds for every picture: finite, and the sum of its parts to the bit.
    fn assert_sound(&self) {
        for layer in self.developed.layers.iter().filter(|layer| layer.name != "depth") {
            assert!(layer.values.iter().all(|v| v.is_finite()), "{} is not finite", layer.name);
        }
        let parts = PARTS.map(|name| self.layer(name));
        for (i, &beauty) in self.layer("beauty").iter().enumerate() {
            let sum: f64 = parts.iter().map(|part| f64::from(part[i])).sum();
            let sum = sum.min(f64::from(f32::MAX));
            assert_eq!(beauty.to_bits(), (sum as f32).to_bits(), "value {i}: {beauty} is not the sum {sum}");
        }
        let mut names: Vec<_> = self.developed.layers.iter().map(|layer| layer.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), self.developed.layers.len());
    }

    /// True where a warning contains `text`.
    pub(crate) fn warns(&self, text: &str) -> bool {
        self.statistics.warnings.iter().any(|warning| warning.contains(text))
    }
}

/// Fails unless `value` is within the relative `tolerance` of `want`, channel by channel; prints how far it is.
#[track_caller]
pub(crate) fn assert_close(what: &str, value: [f64; 3], want: [f64; 3], tolerance: f64) {
    let off: Vec<f64> = (0..3).map(|c| value[c] / want[c] - 1.0).collect();
    println!(
        "{what}: {value:.6?}, want {want:.6?}, off by {:+.4} {:+.4} {:+.4} %",
        100.0 * off[0],
        100.0 * off[1],
        100.0 * off[2]
    );
    assert!(
        off.iter().all(|off| off.abs() <= tolerance),
        "{what}: {value:?}, not {want:?} within {tolerance}"
    );
}

pub(crate) fn grey(x: f64) -> [f64; 3] {
    [x; 3]
}
