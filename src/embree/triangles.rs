//! Triangle buffers that Embree and the renderer share.

use rayon::prelude::*;
use std::sync::Arc;

/// An error of creating triangle buffers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TriangleError {
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {index}, but there are only {vertices}")]
    IndexOutOfRange {
        /// Number of the triangle, from 0.
        triangle: usize,
        /// The index.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// There are more vertices or triangles than Embree can index with 32 bits.
    #[error("{0} vertices or triangles in one mesh; Embree counts to 4294967294")]
    TooMany(usize),
}

/// Vertex positions and corner indices that Embree and the renderer read in place. Cheap to clone.
#[derive(Clone, Debug)]
pub struct TriangleBuffers {
    // An `Arc` of a `Vec`, as the conversion to `Arc<[T]>` would copy gigabytes.
    positions: Arc<Vec<[f32; 3]>>,
    triangles: Arc<Vec<[u32; 3]>>,
}

impl TriangleBuffers {
    /// Takes ownership of both buffers. Every index is checked here, as Embree does not check them.
    ///
    /// # Errors
    /// If an index is out of range or there are more elements than Embree can index.
    pub fn new(mut positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, TriangleError> {
        let vertices = positions.len();
        if let Some(count) = [vertices, triangles.len()].into_iter().find(|&n| n >= u32::MAX as usize) {
            return Err(TriangleError::TooMany(count));
        }
        let wrong = |t: &[u32; 3]| t.iter().copied().find(|&v| v as usize >= vertices);
        let first = triangles.par_iter().with_min_len(1 << 16).position_first(|t| wrong(t).is_some());
        if let Some((triangle, index)) = first.and_then(|i| Some((i, wrong(&triangles[i])?))) {
            return Err(TriangleError::IndexOutOfRange { triangle, index, vertices });
        }
        // Embree loads 16 bytes at the last vertex, so the buffer is padded.
        positions.push([0.0; 3]);
        Ok(Self { positions: Arc::new(positions), triangles: Arc::new(triangles) })
    }

    /// Vertex positions.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions[..self.positions.len() - 1]
    }

    /// Corner indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Positions of the three corners of triangle `index`.
    #[inline(always)]
    pub fn corners(&self, index: u32) -> [[f32; 3]; 3] {
        // Written out, as a closure over arrays would go through memory and delay each hit.
        let [a, b, c] = self.triangles[index as usize];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// Bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.positions.as_slice()) + size_of_val(self.triangles.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_checked() {
        let error = TriangleBuffers::new(vec![[0.0; 3]; 3], vec![[0, 1, 2], [0, 1, 3]]).unwrap_err();
        assert_eq!(error, TriangleError::IndexOutOfRange { triangle: 1, index: 3, vertices: 3 });
        // The padding does not count as a vertex.
        let buffers = TriangleBuffers::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]]).unwrap();
        assert_eq!(buffers.positions().len(), 3);
    }
}
