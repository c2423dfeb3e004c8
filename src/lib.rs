//! Photon mapping on Embree.
//!
//! The rooms of the crate, each of which uses only those before it: [`math`], [`sampling`], [`files`],
//! [`memory`], [`observer`], [`settings`]; `embree`, `image_io`,
//! `film`, `spectra`; `shapes`, `bsdf`, `media`, `lights`, `camera`; `scene`; [`scene_file`]; `bricks`, `photons`; `caches`,
//! `radiosity`; `integrators`; [`render`]; `measure`; and `cli`, which only the program uses.

pub mod bricks;
pub mod bsdf;
pub mod caches;
pub mod camera;
pub mod embree;
pub mod files;
pub mod film;
pub mod image_io;
pub mod integrators;
pub mod lights;
pub mod math;
pub mod measure;
pub mod media;
pub mod memory;
pub mod observer;
pub mod photons;
pub mod radiosity;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod scene_file;
pub mod settings;
pub mod shapes;
pub mod spectra;
pub mod textures;
pub mod transport;
