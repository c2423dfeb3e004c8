//! What the importers of other renderers' scenes share: places and messages, spectra, pictures, and the way from their materials
//! and shapes to a description.

pub(crate) mod error;
pub(crate) mod facets;
pub(crate) mod indices;
pub(crate) mod light;
pub(crate) mod material;
pub(crate) mod models;
pub(crate) mod paint;
pub(crate) mod pictures;
pub(crate) mod report;
pub(crate) mod shape;
pub(crate) mod spectrum;
pub(crate) mod surface;
pub(crate) mod tessellate;
pub(crate) mod text;
pub(crate) mod vertices;

use super::description::{
    FilmDescription, FilterDescription, Location, MediumDescription, Named, SceneDescription,
};
use crate::memory::{MemoryError, MemoryEstimate};
use crate::settings::Overrides;
use glam::DVec3;
use report::Report;
use std::path::Path;
use std::sync::Arc;

/// Decides whether the memory of an estimate may be allocated.
pub(crate) type Allow<'a> = &'a dyn Fn(&MemoryEstimate) -> Result<(), MemoryError>;

/// The scene that an importer builds, with its messages.
pub(crate) struct Building<'a> {
    pub scene: &'a mut SceneDescription,
    pub report: &'a mut Report,
}

/// A film without exposure and crop window.
pub(crate) fn blank_film([width, height]: [u32; 2], filter: FilterDescription) -> FilmDescription {
    FilmDescription { width, height, filter, exposure: None, white: 0.0, crop: None }
}

/// A scene of a file without anything in it but air.
pub(crate) fn blank_scene(path: &Path, film: FilmDescription) -> SceneDescription {
    let location = Location { file: Arc::new(path.to_path_buf()), line: 0, column: 0 };
    let air =
        MediumDescription { ior: 1.0, dispersion: None, absorption: DVec3::ZERO, priority: 0, volume: None };
    SceneDescription {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        media: vec![Named { name: "air".to_owned(), location: location.clone(), value: air }],
        location,
        camera: None,
        film,
        render: Overrides::default(),
        textures: Vec::new(),
        materials: Vec::new(),
        looks: Vec::new(),
        shapes: Vec::new(),
        groups: Vec::new(),
        instances: Vec::new(),
        lights: Vec::new(),
        light_photons: Vec::new(),
        warnings: Vec::new(),
        notes: Vec::new(),
        further_files: Vec::new(),
        parameters: Vec::new(),
    }
}
