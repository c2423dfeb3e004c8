//! Meshes that a scene file describes by a rule instead of by triangles.

mod city;
mod heights;
mod lathe;
mod teapot;

pub use city::{City, CityPart};
pub use heights::mesh_of_heights;
pub use lathe::{Curve, Lathe};
pub use teapot::Teapot;

use super::mesh::TriangleMesh;

/// Most triangles of a generated mesh.
pub const MOST_TRIANGLES: u64 = 100_000_000;

/// The rule of a generated mesh.
#[derive(Clone, Debug, PartialEq)]
pub enum Generator {
    /// A surface of revolution.
    Lathe(Lathe),
    /// The teapot of Newell (1975).
    Teapot(Teapot),
    /// A part of a city.
    City(City),
}

impl Generator {
    /// The mesh, in the shape's own space.
    pub fn mesh(&self) -> TriangleMesh {
        match self {
            Self::Lathe(lathe) => lathe.mesh(),
            Self::Teapot(teapot) => teapot.mesh(),
            Self::City(city) => city.mesh(),
        }
    }
}
