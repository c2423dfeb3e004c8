//! Hierarchies over the same triangles, and the ways to trace rays in them.

use super::BvhBenchError;
use crate::embree::{CommittedScene, Device, SceneBuilder, TriangleBuffers};
use crate::math::Ray;
use std::sync::Arc;

/// A hierarchy of one make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Make {
    /// Embree with its robust flag, as the renderer uses it.
    EmbreeRobust,
    /// Embree without.
    EmbreeFast,
    /// The crate `bvh`: binary, binned SAH.
    #[cfg(feature = "bvh-bench")]
    Bvh,
    /// The crate `obvhs`: binary, PLOC with reinsertion (`medium_build`).
    #[cfg(feature = "bvh-bench")]
    Obvhs2,
    /// The crate `obvhs`: the same tree as eight-way compressed one.
    #[cfg(feature = "bvh-bench")]
    ObvhsWide,
}

impl Make {
    /// All there are in this build.
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

    /// For tables.
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

    /// Builds with the threads of the pool that it is called in; Embree with `threads`.
    ///
    /// # Errors
    /// Where Embree cannot.
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

    /// The ways to trace rays in it.
    pub fn walks(self) -> &'static [Walk] {
        match self {
            Self::EmbreeRobust | Self::EmbreeFast => &[Walk::Single, Walk::Packets8, Walk::Packets16],
            #[cfg(feature = "bvh-bench")]
            Self::Bvh => &[Walk::Single, Walk::OwnOrder],
            _ => &[Walk::Single],
        }
    }
}

/// How rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// One ray at a time, by the function that is offered for it.
    Single,
    /// Embree's packets of eight.
    Packets8,
    /// Embree's packets of sixteen.
    Packets16,
    /// In the tree of `bvh`, a walk of this project: nearer child first, nothing behind the hit.
    OwnOrder,
}

impl Walk {
    /// For tables; empty for the usual one.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "",
            Self::Packets8 => ", packets of 8",
            Self::Packets16 => ", packets of 16",
            Self::OwnOrder => ", own walk",
        }
    }
}

/// A hit: number of the triangle, and parameter. Where only asked if anything is hit, both are zero.
pub type Hit = Option<(u32, f32)>;

/// What was built.
#[derive(Debug)]
pub enum Structure {
    /// By Embree.
    Embree(CommittedScene),
    /// By `bvh`.
    #[cfg(feature = "bvh-bench")]
    Bvh(super::crates::BinaryTree),
    /// By `obvhs`.
    #[cfg(feature = "bvh-bench")]
    Obvhs2(super::crates::Obvhs2),
    /// By `obvhs`.
    #[cfg(feature = "bvh-bench")]
    ObvhsWide(super::crates::ObvhsWide),
}

impl Structure {
    /// Bytes of hierarchy and of the triangles it keeps for itself; the mesh that all read is not among them.
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
