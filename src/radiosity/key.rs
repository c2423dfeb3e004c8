//! What the steps of a solution depend on, as hashes of content. The rules of restarting: geometry and the options of patches decide about
//! steps 1 and 2, reflectance and light about step 3, and the camera about neither.

use super::RadiosityOptions;
use super::links::State;
use super::model::Optics;
use crate::scene::{Geometry, Node, Scene};
use std::fmt::{self, Write};

/// A BLAKE3 hash.
pub(super) type Key = [u8; blake3::OUT_LEN];

/// A writer whose text goes into a hash.
struct Hashing<'a>(&'a mut blake3::Hasher);

impl Write for Hashing<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

/// Hash of the geometry in render space, and of the options that patches and form factors depend on.
pub(super) fn geometry_key(scene: &Scene, options: &RadiosityOptions) -> Key {
    let mut hasher = blake3::Hasher::new();
    // All fields are listed, so that a new one does not compile until its step is decided.
    let RadiosityOptions { patches, method, strata, tolerance: _, specular: _, seed } = *options;
    for number in [patches as u64, u64::from(strata), seed, method as u64] {
        hasher.update(&number.to_le_bytes());
    }
    for node in scene.nodes() {
        match node {
            Node::Surface(index) => {
                hasher.update(&index.to_le_bytes());
            }
            Node::Instance { first, placement } => {
                hasher.update(b"instance").update(&first.to_le_bytes());
                placement.to_world.to_cols_array().iter().for_each(|x| {
                    hasher.update(&x.to_le_bytes());
                });
            }
        }
    }
    for surface in scene.surfaces() {
        hasher.update(&[u8::from(surface.flip_normal)]);
        match &surface.geometry {
            Geometry::Mesh(mesh) => {
                let (positions, triangles) = (mesh.buffers.positions(), mesh.buffers.triangles());
                hasher.update(&(triangles.len() as u64).to_le_bytes());
                positions.iter().flatten().for_each(|x| {
                    hasher.update(&x.to_le_bytes());
                });
                triangles.iter().flatten().for_each(|x| {
                    hasher.update(&x.to_le_bytes());
                });
            }
            // Numbers print as the shortest text that gives the same number, and writing to a hash cannot fail.
            Geometry::Procedural(shape) => {
                let _ = write!(Hashing(&mut hasher), "{shape:?}");
            }
        }
    }
    *hasher.finalize().as_bytes()
}

/// Hash of reflectances, emission and other light on all patches, and of the options of the solution.
pub(super) fn light_key(state: &State, options: &RadiosityOptions) -> Key {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&options.tolerance.to_le_bytes());
    for (Optics { reflectance, emission }, (lights, _)) in state.optics.iter().zip(&state.lights) {
        for value in [reflectance, emission, lights].into_iter().flat_map(|rgb| rgb.to_array()) {
            hasher.update(&value.to_le_bytes());
        }
    }
    *hasher.finalize().as_bytes()
}
