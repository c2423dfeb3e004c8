//! Texture slots of materials, texture data of mesh vertices, and textured emission.

use super::{ImageTexture, Sampler};
use crate::math::Rgb;
use glam::{Affine2, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// A texture with the way in which one parameter of a material reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureSlot {
    /// The picture.
    pub texture: Arc<ImageTexture>,
    /// Wrapping and filtering.
    pub sampler: Sampler,
    /// Index of the set of texture coordinates of a mesh, 0 or 1.
    pub set: usize,
    /// Transform from the coordinates of the mesh to those of the picture.
    pub transform: Affine2,
}

impl TextureSlot {
    /// Coordinates in the picture, from the two sets of coordinates of a mesh.
    #[inline]
    pub fn coordinates(&self, sets: [Vec2; 2]) -> Vec2 {
        self.transform.transform_point2(sets[self.set.min(1)])
    }

    /// The value at these coordinates of a mesh. `footprint` is the area of the lookup as a share of the picture's area; 0 for a point.
    #[inline]
    pub fn at(&self, sets: [Vec2; 2], footprint: f32) -> Vec4 {
        let [width, height] = self.texture.size();
        let texels = (footprint * width as f32 * height as f32).sqrt();
        self.texture.at(self.coordinates(sets), texels, &self.sampler)
    }
}

/// Texture data of mesh vertices. Each list is empty or has one item for each vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexData {
    /// Two sets of texture coordinates, finite.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear colours with alpha, which multiply the colour of the material.
    pub colours: Vec<Vec4>,
    /// Tangents (zero where there is no valid one) and the sign of the bitangent (1 or -1).
    pub tangents: Vec<(Vec3, f32)>,
}

/// Interpolation of the corners' values; `uv` are the barycentric coordinates of the second and third corner.
#[inline]
fn weighted<T>([a, b, c]: [T; 3], uv: [f32; 2]) -> T
where
    T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    a * (1.0 - uv[0] - uv[1]) + b * uv[0] + c * uv[1]
}

impl VertexData {
    /// Both sets of coordinates at the corners of a triangle; zero where there are none.
    #[inline]
    pub fn corner_sets(&self, triangle: [u32; 3]) -> [[Vec2; 2]; 3] {
        let of = |set: &Vec<Vec2>, vertex: u32| set.get(vertex as usize).copied().unwrap_or_default();
        triangle.map(|vertex| [of(&self.uvs[0], vertex), of(&self.uvs[1], vertex)])
    }

    /// Both sets of coordinates within a triangle.
    #[inline]
    pub fn sets(&self, triangle: [u32; 3], uv: [f32; 2]) -> [Vec2; 2] {
        let corners = self.corner_sets(triangle);
        [0, 1].map(|set| weighted(corners.map(|sets| sets[set]), uv))
    }

    /// The colour within a triangle; white where there are none.
    #[inline]
    pub fn colour(&self, triangle: [u32; 3], uv: [f32; 2]) -> Vec4 {
        if self.colours.is_empty() {
            return Vec4::ONE;
        }
        weighted(triangle.map(|vertex| self.colours[vertex as usize]), uv)
    }

    /// The tangent within a triangle, of any length, and the sign of the bitangent.
    #[inline]
    pub fn tangent(&self, triangle: [u32; 3], uv: [f32; 2]) -> Option<(Vec3, f32)> {
        if self.tangents.is_empty() {
            return None;
        }
        let corners = triangle.map(|vertex| self.tangents[vertex as usize]);
        Some((weighted(corners.map(|(tangent, _)| tangent), uv), corners[0].1))
    }
}

/// Textured emission: a factor in `[0, 1]` on the radiance of an emitter over its surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Glow {
    /// The picture, where there is one.
    pub slot: Option<TextureSlot>,
    /// Whether the colours of the vertices multiply the factor.
    pub coloured: bool,
    /// Vertex data of the emitting mesh.
    pub data: Arc<VertexData>,
}

impl Glow {
    /// The factor within a triangle, `footprint` as for [`TextureSlot::at`].
    #[inline]
    pub fn at(&self, triangle: [u32; 3], uv: [f32; 2], footprint: f32) -> Rgb {
        let colour = if self.coloured { self.data.colour(triangle, uv) } else { Vec4::ONE };
        let picture =
            self.slot.as_ref().map_or(Vec4::ONE, |slot| slot.at(self.data.sets(triangle, uv), footprint));
        (colour * picture).truncate().clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// Approximate mean factor over a triangle, from lookups at nine equal parts of it.
    pub fn mean(&self, triangle: [u32; 3]) -> Rgb {
        let area = self.slot.as_ref().map_or(0.0, |slot| {
            let [a, b, c] = self.data.corner_sets(triangle).map(|sets| slot.coordinates(sets));
            0.5 * (b - a).perp_dot(c - a).abs()
        });
        let mut sum = Rgb::ZERO;
        for (i, j) in [(1, 1), (4, 1), (1, 4), (2, 2), (5, 2), (2, 5), (4, 4), (7, 1), (1, 7)] {
            // Centroids of nine equal triangles.
            sum += self.at(triangle, [i as f32 / 9.0, j as f32 / 9.0], area / 9.0);
        }
        sum / 9.0
    }
}
