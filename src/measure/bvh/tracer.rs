//! Hierarchies over the same triangles, and the methods to trace rays in them.

use super::BvhBenchError;
use crate::embree::{CommittedScene, Device, SceneBuilder, TriangleBuffers};
use crate::math::Ray;
use std::sync::Arc;

/// A kind of hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Make {
    /// Embree with its robust flag, as the renderer uses it.
    EmbreeRobust,
    /// Embree without its robust flag.
    EmbreeFast,
    /// The crate `bvh`: binary, binned SAH.
    #[cfg(feature = "bvh-bench")]
    Bvh,
    /// The crate `obvhs`: binary, PLOC with reinsertion (`medium_build`).
    #[cfg(feature = "bvh-bench")]
    Obvhs2,
    /// The crate `obvhs`: the same tree in eight-way compressed form.
    #[cfg(feature = "bvh-bench")]
    ObvhsWide,
}

impl Make {
    /// All kinds in this build.
    pub const ALL: &[Self] = &[
        Self::EmbreeRobust,
        Self::EmbreeFast,
        #[cfg(feature = "bvh-bench")]
        Self::Bvh,
        #[cfg(feature = "bvh-bench")]
        Self::Obvhs2,
        #[cfg(feature = "bvh-bench")]
        Self::ObvhsWide,
    ];

    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::EmbreeRobust => "Embree, robust",
            Self::EmbreeFast => "Embree, not robust",
            #[cfg(feature = "bvh-bench")]
            Self::Bvh => "bvh",
            #[cfg(feature = "bvh-bench")]
            Self::Obvhs2 => "obvhs BVH2",
            #[cfg(feature = "bvh-bench")]
            Self::ObvhsWide => "obvhs CWBVH",
        }
    }

    /// Builds the hierarchy with the threads of the current pool; Embree uses `threads`.
    ///
    /// # Errors
    /// If Embree reports an error.
    pub fn build(self, triangles: &TriangleBuffers, threads: usize) -> Result<Structure, BvhBenchError> {
        match self {
            Self::EmbreeRobust | Self::EmbreeFast => {
                let device = Arc::new(Device::counting_memory(threads)?);
                let mut builder = SceneBuilder::with_robust(&device, self == Self::EmbreeRobust)?;
                builder.add_triangles(triangles.clone())?;
                Ok(Structure::Embree(builder.commit()?))
            }
            #[cfg(feature = "bvh-bench")]
            Self::Bvh => Ok(Structure::Bvh(super::crates::BinaryTree::build(triangles))),
            #[cfg(feature = "bvh-bench")]
            Self::Obvhs2 => Ok(Structure::Obvhs2(super::crates::Obvhs2::build(triangles))),
            #[cfg(feature = "bvh-bench")]
            Self::ObvhsWide => Ok(Structure::ObvhsWide(super::crates::ObvhsWide::build(triangles))),
        }
    }

    /// The traversals for this kind.
    pub fn walks(self) -> &'static [Walk] {
        match self {
            Self::EmbreeRobust | Self::EmbreeFast => &[Walk::Single, Walk::Packets8, Walk::Packets16],
            #[cfg(feature = "bvh-bench")]
            Self::Bvh => &[Walk::Single, Walk::OwnOrder],
            _ => &[Walk::Single],
        }
    }
}

/// A method of tracing rays in a hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// One ray at a time, with the library's function for that.
    Single,
    /// Embree's packets of eight.
    Packets8,
    /// Embree's packets of sixteen.
    Packets16,
    /// A traversal of this project in the tree of `bvh`: it visits the nearer child first and skips boxes behind the hit.
    OwnOrder,
}

impl Walk {
    /// Name for tables; empty for the default.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "",
            Self::Packets8 => ", packets of 8",
            Self::Packets16 => ", packets of 16",
            Self::OwnOrder => ", own walk",
        }
    }
}

/// A hit: number of the triangle, and ray parameter. Both are zero for occlusion queries.
pub type Hit = Option<(u32, f32)>;

/// A built hierarchy.
#[derive(Debug)]
pub enum Structure {
    /// From Embree.
    Embree(CommittedScene),
    /// From `bvh`.
    #[cfg(feature = "bvh-bench")]
    Bvh(super::crates::BinaryTree),
    /// From `obvhs`.
    #[cfg(feature = "bvh-bench")]
    Obvhs2(super::crates::Obvhs2),
    /// From `obvhs`.
    #[cfg(feature = "bvh-bench")]
    ObvhsWide(super::crates::ObvhsWide),
}

impl Structure {
    /// Bytes of the hierarchy and of its own copy of the triangles, without the shared mesh.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Embree(scene) => scene.device().memory_bytes().unwrap_or(0),
            #[cfg(feature = "bvh-bench")]
            Self::Bvh(tree) => tree.bytes(),
            #[cfg(feature = "bvh-bench")]
            Self::Obvhs2(tree) => tree.bytes(),
            #[cfg(feature = "bvh-bench")]
            Self::ObvhsWide(tree) => tree.bytes(),
        }
    }

    /// Traces `rays` into `hits`, of the same length, on this thread.
    pub fn trace(&self, walk: Walk, any_hit: bool, rays: &[Ray], hits: &mut [Hit]) {
        match self {
            Self::Embree(scene) => embree(scene, walk, any_hit, rays, hits),
            #[cfg(feature = "bvh-bench")]
            Self::Bvh(tree) => tree.trace(walk == Walk::OwnOrder, any_hit, rays, hits),
            #[cfg(feature = "bvh-bench")]
            Self::Obvhs2(tree) => tree.trace(any_hit, rays, hits),
            #[cfg(feature = "bvh-bench")]
            Self::ObvhsWide(tree) => tree.trace(any_hit, rays, hits),
        }
    }
}

fn embree(scene: &CommittedScene, walk: Walk, any_hit: bool, rays: &[Ray], hits: &mut [Hit]) {
    let width = match walk {
        Walk::Packets8 => 8,
        Walk::Packets16 => 16,
        Walk::Single | Walk::OwnOrder => {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = if any_hit {
                    scene.occluded(ray).then_some((0, 0.0))
                } else {
                    scene.intersect(ray).map(|hit| (hit.primitive, hit.t))
                };
            }
            return;
        }
    };
    let (mut found, mut dark) = ([None; 16], [false; 16]);
    for (rays, hits) in rays.chunks(width).zip(hits.chunks_mut(width)) {
        match (any_hit, width) {
            (false, 8) => scene.intersect_8(rays, &mut found),
            (false, _) => scene.intersect_16(rays, &mut found),
            (true, 8) => scene.occluded_8(rays, &mut dark),
            (true, _) => scene.occluded_16(rays, &mut dark),
        }
        for (lane, hit) in hits.iter_mut().enumerate() {
            *hit = if any_hit {
                dark[lane].then_some((0, 0.0))
            } else {
                found[lane].map(|hit| (hit.primitive, hit.t))
            };
        }
    }
}
