//! What a time limit leaves of a render: always a picture, and as much of the photons as there is time for.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet, PixelRect};
use cardioid::render::{IntegratorKind, Observer, Quality, RenderRequest, Rendered, Settings, Stop, render};
use cardioid::scene_file::{BuiltScene, build_scene, load_scene};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (24, 20);

fn spheres() -> BuiltScene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-spheres.toml");
    let device = Arc::new(Device::new(0).unwrap());
    build_scene(&load_scene(&file, &[]).unwrap(), &device, SIZE).unwrap()
}

/// A render that is to end then.
struct Until(Instant);

impl Observer for Until {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn should_stop(&self) -> bool {
        Instant::now() >= self.0
    }
    fn is_cancelled(&self) -> bool {
        false
    }
    fn deadline(&self) -> Option<Instant> {
        Some(self.0)
    }
}

fn render_until(scene: &BuiltScene, settings: Settings, crop: Option<PixelRect>, end: Instant) -> Rendered {
    let request = RenderRequest {
        width: SIZE.0,
        height: SIZE.1,
        crop,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings,
    };
    render(&scene.scene, &scene.camera, &request, &Until(end)).unwrap()
}

/// Every way to compute, on a machine so busy that the time is over before anything begins.
#[test]
fn the_first_sample_of_every_pixel_is_taken_however_late_it_is() {
    let scene = spheres();
    let base =
        Settings { spp: 64, global_photons: 500_000, caustic_photons: 500_000, ..Quality::Draft.settings() };
    let rounds = Settings { rounds: None, ..Quality::Draft.progressive_settings() };
    let by = |integrator| Settings { integrator, ..base.clone() };
    for (name, settings) in [
        ("photon map", base.clone()),
        ("adaptive", Settings { adaptive: true, ..base.clone() }),
        ("without cache", Settings { irradiance_cache: false, ..base.clone() }),
        ("path", by(IntegratorKind::Path)),
        ("photons", by(IntegratorKind::Photons)),
        ("rounds", rounds),
    ] {
        for crop in [None, Some(PixelRect { x0: 3, y0: 4, x1: 20, y1: 19 })] {
            let Rendered { film, statistics, stopped, .. } =
                render_until(&scene, settings.clone(), crop, Instant::now());
            assert_ne!(stopped, Some(Stop::BeforePixels), "{name}");
            let developed = film.develop();
            assert_eq!(developed.unsampled, 0, "{name}");
            assert!(developed.beauty().iter().any(|&value| value > 0.0), "{name} is black");
            if let Some(rounds) = &statistics.rounds {
                assert_eq!((rounds.done, rounds.fitted.map(|round| round.spp)), (1, Some(1)), "{name}");
                assert!(
                    rounds.fitted.is_some_and(|round| round.global_photons < 10_000),
                    "{name}: {rounds:?}"
                );
                continue;
            }
            assert_eq!((statistics.samples, stopped), (1, Some(Stop::DuringPixels)), "{name}");
            for map in &statistics.maps {
                assert!(map.stopped && map.asked >= 50_000, "{name}: {map:?}");
                assert!(map.photons > 100 && map.photons < map.asked / 5, "{name}: {map:?}");
            }
        }
    }
}

/// With time enough nothing changes, not one bit.
#[test]
fn what_fits_is_left_alone() {
    let scene = spheres();
    let later = || Instant::now() + Duration::from_secs(3600);
    let small = Settings { spp: 2, global_photons: 5000, caustic_photons: 5000, ..Quality::Draft.settings() };
    let rounds =
        Settings { rounds: Some(2), ..Settings { integrator: IntegratorKind::Progressive, ..small.clone() } };
    for settings in [small, rounds] {
        let limited = render_until(&scene, settings.clone(), None, later());
        let request = RenderRequest {
            width: SIZE.0,
            height: SIZE.1,
            crop: None,
            filter: Filter::Box { radius: 0.5 },
            layers: LayerSet::default(),
            settings,
        };
        let free = render(&scene.scene, &scene.camera, &request, &cardioid::render::Silent).unwrap();
        assert_eq!(limited.stopped, None);
        assert_eq!(limited.film.develop().layers, free.film.develop().layers);
        assert_eq!(limited.statistics.warnings, free.statistics.warnings);
    }
}
