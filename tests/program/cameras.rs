//! Pictures of orthographic, panoramic and fisheye cameras, against closed forms, in every way to compute light.

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet, PixelRect};
use cardioid::render::{IntegratorKind, Overrides, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{build_scene, parse_scene};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

const KINDS: [IntegratorKind; 2] = [IntegratorKind::Path, IntegratorKind::PhotonMap];

/// A picture: its size and the red of its pixels, row after row.
struct Picture {
    width: usize,
    red: Vec<f64>,
}

fn picture_of(
    text: &str,
    (width, height): (u32, u32),
    kind: IntegratorKind,
    spp: u32,
    crop: Option<PixelRect>,
) -> Picture {
    let scene = parse_scene(text, Path::new("a.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
    let device = Arc::new(Device::new(1).unwrap());
    let built = build_scene(&scene, &device, (width, height)).unwrap_or_else(|error| panic!("{error}"));
    let asked = Overrides {
        integrator: Some(kind),
        spp: Some(spp),
        seed: Some(5),
        global_photons: Some(20_000),
        caustic_photons: Some(40_000),
        ..Overrides::default()
    };
    let request = RenderRequest {
        width,
        height,
        crop,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings: Settings::from(&asked),
    };
    let rendered = render(&built.scene, &built.camera, &request, &Silent).unwrap();
    let red = rendered.film.develop().beauty().iter().step_by(3).map(|value| f64::from(*value)).collect();
    Picture { width: crop.map_or(width, |crop| crop.width()) as usize, red }
}

impl Picture {
    /// Pixels with their columns and rows.
    fn pixels(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.red.iter().enumerate().map(|(i, &red)| (i % self.width, i / self.width, red))
    }
}

/// A floor of reflectance 0.5 that covers the middle half of the picture, in parallel light at 60 degrees from the normal.
#[test]
fn an_orthographic_floor_is_even() {
    let text = "[camera]\ntype = \"orthographic\"\neye = [0, 3, 0]\nat = [0, 0, 0]\nup = [0, 0, -1]\nheight = 2.0
        [materials.floor]\ntype = \"lambert\"\nreflectance = 0.5
        [[shapes]]\ntype = \"quad\"\ncorner = [-1, 0, 2]\nedge-u = [2, 0, 0]\nedge-v = [0, 0, -4]\nmaterial = \"floor\"
        [[lights]]\ntype = \"directional\"\ndirection = [1.7320508, -1, 0]\nirradiance = 4.0\n";
    let want = 0.5 / PI * 4.0 * 0.5;
    for kind in KINDS {
        for (x, y, red) in picture_of(text, (32, 16), kind, 4, None).pixels() {
            let want = if (8..24).contains(&x) { want } else { 0.0 };
            assert!((red - want).abs() < 1e-5, "{kind:?} {x} {y}: {red} {want}");
        }
    }
}

/// A box whose inside absorbs, and nothing else: light of the environment. The plane on which rays start goes through the box, and
/// the eye is outside of it or inside.
#[test]
fn parallel_rays_start_in_their_own_medium() {
    for (eye, columns) in [(0.0, 10..16), (0.5, 6..12)] {
        let text = format!(
            "[camera]\ntype = \"orthographic\"\neye = [{eye}, 0, 0.5]\nat = [{eye}, 0, 0]\nwidth = 2.0
            [materials.dark]\ntype = \"dielectric\"\nior = 1.0\nabsorption = 0.7
            [[shapes]]\ntype = \"box\"\nmin = [0.25, -9, -1]\nmax = [1, 9, 1]\nmaterial = \"dark\"
            [[lights]]\ntype = \"environment\"\nradiance = 1.0\n"
        );
        for kind in KINDS {
            for (x, y, red) in picture_of(&text, (16, 4), kind, 4, None).pixels() {
                let want = if columns.contains(&x) { (-0.7f64 * 1.5).exp() } else { 1.0 };
                assert!((red - want).abs() < 1e-4, "{kind:?} {eye} {x} {y}: {red} {want}");
            }
        }
    }
}

/// A sphere that emits covers the solid angle, or the area, that it has.
#[test]
fn spheres_have_their_size() {
    let scene = |camera: &str| {
        format!(
            "[camera]\n{camera}\neye = [1, 2, 3]\nat = [1, 2, 0]
            [[shapes]]\ntype = \"sphere\"\ncenter = [3, 3, 1]\nradius = 0.3\nemission = {{ radiance = 5.0 }}\n"
        )
    };
    let solid_angle = 5.0 * 2.0 * PI * (1.0 - (1.0f64 - 0.09 / 9.0).sqrt());
    for kind in KINDS {
        let panorama = picture_of(&scene("type = \"panorama\""), (128, 64), kind, 64, None);
        let pixel = (PI / 64.0).powi(2);
        let sum: f64 = panorama
            .pixels()
            .map(|(_, y, red)| red * pixel * (PI * ((y as f64 + 0.5) / 64.0 - 0.5)).cos())
            .sum();
        assert!((sum / solid_angle - 1.0).abs() < 0.01, "{kind:?}: {sum} {solid_angle}");
        let (x, y, _) = panorama.pixels().max_by(|a, b| a.2.total_cmp(&b.2)).unwrap();
        // At (2, 1, -2) from the eye: 45 degrees to the right, asin(1/3) above the horizon.
        assert!(
            (x as f64 - 80.0).abs() < 4.0
                && (y as f64 - (32.0 - 64.0 / PI * (1.0f64 / 3.0).asin())).abs() < 4.0
        );

        let fisheye = picture_of(&scene("type = \"fisheye\"\nfov = 180"), (80, 64), kind, 64, None);
        let sum: f64 = fisheye
            .pixels()
            .map(|(x, y, red)| {
                let radius = (x as f64 + 0.5 - 40.0).hypot(y as f64 + 0.5 - 32.0);
                let angle = radius / 32.0 * 0.5 * PI;
                red * angle.sin() / angle * pixel
            })
            .sum();
        assert!((sum / solid_angle - 1.0).abs() < 0.01, "{kind:?}: {sum} {solid_angle}");

        let parallel = picture_of(&scene("type = \"orthographic\"\nheight = 6"), (64, 64), kind, 64, None);
        let sum: f64 = parallel.pixels().map(|(.., red)| red * (6.0f64 / 64.0).powi(2)).sum();
        assert!((sum / (5.0 * PI * 0.09) - 1.0).abs() < 0.01, "{kind:?}: {sum}");
    }
}

/// An even environment is even in all directions, in a mirror too, and black outside the disc of a fisheye.
#[test]
fn an_even_environment() {
    let text = |kind: &str| {
        format!(
            "[camera]\ntype = \"{kind}\"\neye = [1, 2, 3]\nat = [0, 0, 0]\n[materials.mirror]\ntype = \"mirror\"
            [[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"mirror\"\n[[lights]]\ntype = \"environment\"\nradiance = 2.0\n"
        )
    };
    for kind in KINDS {
        assert!(picture_of(&text("panorama"), (16, 8), kind, 4, None).red.iter().all(|&red| red == 2.0));
        for (x, y, red) in picture_of(&text("fisheye"), (24, 16), kind, 4, None).pixels() {
            let radius = (x as f64 + 0.5 - 12.0).hypot(y as f64 + 0.5 - 8.0);
            match radius {
                _ if radius < 7.2 => assert_eq!(red, 2.0, "{x} {y}"),
                _ if radius > 8.8 => assert_eq!(red, 0.0, "{x} {y}"),
                _ => assert!((0.0..=2.0).contains(&red)),
            }
        }
    }
}

const ROOM: &str = "
    [materials.white]\ntype = \"lambert\"\nreflectance = 0.6
    [materials.glass]\ntype = \"dielectric\"\nior = 1.5
    [[shapes]]\ntype = \"box\"\nmin = [-1, 0, -1]\nmax = [1, 2, 1]\nmaterial = \"white\"\nflip-normal = true
    [[shapes]]\ntype = \"sphere\"\ncenter = [0.2, 0.5, 0.1]\nradius = 0.35\nmaterial = \"glass\"
    [[shapes]]\ntype = \"sphere\"\ncenter = [-0.4, 1.5, -0.3]\nradius = 0.2\nemission = { radiance = 6.0 }\n";

/// Photon maps and paths show the same light of a room with a caustic; the picture of a window is that part of the whole, to the bit.
#[test]
fn photons_and_paths_agree_and_windows_are_parts() {
    let size = (32, 16);
    for camera in [
        "type = \"orthographic\"\neye = [0, 1.9, 0]\nat = [0, 0, 0]\nup = [0, 0, -1]\nwidth = 1.9",
        "type = \"panorama\"\neye = [0.5, 1.2, 0.6]\nat = [0, 1.2, 0]",
        "type = \"fisheye\"\neye = [0.5, 1.8, 0.6]\nat = [0, 0, 0]",
    ] {
        let text = format!("[camera]\n{camera}\n{ROOM}");
        let mean = |picture: &Picture| picture.red.iter().sum::<f64>() / picture.red.len() as f64;
        let path = picture_of(&text, size, IntegratorKind::Path, 256, None);
        let mapped = picture_of(&text, size, IntegratorKind::PhotonMap, 16, None);
        let (a, b) = (mean(&path), mean(&mapped));
        assert!((a / b - 1.0).abs() < 0.03, "{camera}: {a} {b}");
        let crop = PixelRect { x0: 5, y0: 3, x1: 21, y1: 12 };
        let part = picture_of(&text, size, IntegratorKind::PhotonMap, 16, Some(crop));
        for (x, y, red) in part.pixels() {
            assert_eq!(red, mapped.red[(y + 3) * 32 + x + 5], "{camera}: {x} {y}");
        }
    }
}
