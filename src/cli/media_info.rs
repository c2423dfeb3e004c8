//! What `cardioid info` says of media.

use super::info::four_digits;
use cardioid::math::Rgb;
use cardioid::media::density::{Density, Line};
use cardioid::media::{AIR, MediumId, Volume};
use cardioid::scene::{Scene, Target};
use cardioid::spectra::LineIndices;
use glam::DVec3;
use serde::Serialize;

/// A medium in words and numbers.
#[derive(Serialize)]
pub(super) struct DescribedMedium {
    name: String,
    ior: f32,
    /// Abbe number; none where the index is the same at each wavelength.
    abbe: Option<f64>,
    /// Kind of density; for media that scatter, absorb or emit by a volume.
    density: Option<String>,
    /// Metres where the density is one, by channel; none where nothing is lost.
    mean_free_path: [Option<f64>; 3],
    /// Through the middle of the box of its largest body, along x, y and z, in the channel that loses most.
    optical_depth: Option<[f64; 3]>,
    /// Voxels above zero.
    voxels: Option<u64>,
    /// Bytes of voxels, or of bounds on a function.
    bytes: Option<u64>,
}

/// All media but air.
pub(super) fn describe_media(scene: &Scene) -> Vec<DescribedMedium> {
    let all = scene.media().iter().enumerate().filter(|(id, _)| *id != usize::from(AIR));
    let described = |(id, medium): (usize, &cardioid::media::Medium)| {
        let (volume, space) = (medium.volume.as_deref(), scene.space());
        let extinction = volume.map_or(medium.absorption, |volume| volume.coefficients().extinction());
        let path = |loss: f32| (loss > 0.0).then(|| space.metres(1.0 / f64::from(loss)));
        let (voxels, bytes) = match volume.map(Volume::density) {
            Some(Density::Grid(grid)) => {
                let glow = volume.and_then(|volume| volume.glow()).map_or(0, |glow| glow.memory());
                (Some(grid.voxels()), Some((grid.memory() + glow) as u64))
            }
            Some(Density::Field(field)) => (None, Some(field.memory() as u64)),
            Some(Density::Homogeneous | Density::Height(_)) | None => (None, None),
        };
        let body = largest_body(scene, id as MediumId);
        DescribedMedium {
            name: medium.name.clone(),
            ior: medium.ior,
            abbe: medium.dispersion.as_ref().map(LineIndices::abbe),
            density: volume.map(|volume| kind_of(volume.density())),
            mean_free_path: extinction.to_array().map(path),
            optical_depth: body.map(|body| depths(volume.map(Volume::density), extinction, body)),
            voxels,
            bytes,
        }
    };
    all.map(described).collect()
}

impl DescribedMedium {
    /// The same in one line.
    pub(super) fn in_words(&self) -> String {
        let mut text = match &self.density {
            Some(kind) => format!("{}: {kind}", self.name),
            None => format!("{}: clear", self.name),
        };
        if self.ior != 1.0 {
            text += &format!(", index {}", self.ior);
            if let Some(abbe) = self.abbe {
                text += &format!(" at the d line, Abbe number {abbe:.2}");
            }
        }
        if self.mean_free_path.iter().any(Option::is_some) {
            let shown = self.mean_free_path.map(|path| path.map_or("endless".to_owned(), four_digits));
            let all = if shown[0] == shown[1] && shown[1] == shown[2] { &shown[..1] } else { &shown[..] };
            text += &format!(", mean free path {} m", all.join(" "));
            if let Some(depths) = self.optical_depth {
                let [x, y, z] = depths.map(four_digits);
                text += &format!(", optical depth {x} {y} {z} through its middle along x, y, z");
            }
        }
        if let Some(voxels) = self.voxels {
            text += &format!(", {voxels} voxels above zero");
        }
        if let Some(bytes) = self.bytes {
            text += &format!(", {} MB", four_digits(bytes as f64 / 1e6));
        }
        text
    }
}

fn kind_of(density: &Density) -> String {
    match density {
        Density::Homogeneous => "even".to_owned(),
        Density::Height(_) => "falls with height".to_owned(),
        Density::Field(field) => format!("noise, up to {}", four_digits(field.majorant())),
        Density::Grid(grid) => format!("voxels, up to {}", four_digits(grid.majorant())),
    }
}

/// The largest body whose border has the medium inside.
fn largest_body(scene: &Scene, id: MediumId) -> Option<&Target> {
    let is_inside = |target: &&Target| {
        let surface = &scene.surfaces()[target.surface as usize];
        let media = scene.materials()[surface.material as usize].1.media();
        media.is_some_and(|[inside, _]| inside == id)
    };
    scene.targets().iter().filter(is_inside).max_by(|a, b| a.radius.total_cmp(&b.radius))
}

/// Optical depths through the middle of the box of a body, along each axis.
fn depths(density: Option<&Density>, extinction: Rgb, body: &Target) -> [f64; 3] {
    let [min, max] = body.bounds.map(|corner| corner.as_dvec3());
    let (middle, size) = (0.5 * (min + max), max - min);
    let most = f64::from(extinction.max_element());
    [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        let length = size.dot(axis);
        let line = Line::new(middle - axis * (0.5 * length), axis);
        most * line.map_or(0.0, |line| density.map_or(length, |density| density.integral(&line, length)))
    })
}
