//! Chains of specular surfaces that can be followed again.

use crate::bsdf::Lobe;
use crate::integrators::specular::SPLIT_DEPTH;
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::{Scene, Shading, SurfaceInteraction};
use crate::transport::{Event, next_event};
use glam::Vec2;

/// Surfaces that a chain may have to be followed again.
const LONGEST: u32 = 64;

/// Specular lobes followed since the camera, and nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::integrators) struct Chain {
    /// By surface, the first lowest: one for refraction.
    transmissions: u64,
    length: u32,
    /// Of the surfaces.
    hash: u32,
}

/// The end of a chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChainEnd {
    /// Leaves the last surface.
    pub ray: Ray,
    /// What the ray is in.
    pub medium: MediumStack,
    /// Radiance that arrives at the camera over that of the ray.
    pub throughput: Rgb,
    /// About the probability with which a camera sample follows this chain and no other: that of the ways taken where interfaces are
    /// many. A function of place and chain alone.
    pub chance: f32,
}

impl Chain {
    /// With one surface more, by its specular lobe; `None` where that mirrors in two ways.
    pub(in crate::integrators) fn after(
        self,
        hit: &SurfaceInteraction,
        shading: &Shading,
        transmission: bool,
    ) -> Option<Self> {
        if !shading.bsdf.has_specular() || !shading.bsdf.has_one_mirror(shading.wo_local) {
            return None;
        }
        if self.length >= LONGEST {
            return Some(Self { length: LONGEST + 1, ..self });
        }
        // Where it is flat, another primitive is another direction; where its normals are interpolated, it is not.
        let is_flat = hit.shading_normal == hit.point.normal;
        let face = if is_flat { hit.primitive } else { 0 };
        let hash = (self.hash ^ hit.surface).wrapping_mul(0x9e37_79b1) ^ face.wrapping_mul(0x85eb_ca6b);
        Some(Self {
            transmissions: self.transmissions | (u64::from(transmission) << self.length),
            length: self.length + 1,
            hash: hash.rotate_left(15),
        })
    }

    /// Whether it has no surface.
    pub(in crate::integrators) fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Whether it has too many surfaces to be followed again.
    pub(super) fn is_lost(&self) -> bool {
        self.length > LONGEST
    }

    /// Follows another ray over the same surfaces in the same ways; `None` where it does not meet them.
    pub(super) fn follow(&self, scene: &Scene, mut ray: Ray, mut medium: MediumStack) -> Option<ChainEnd> {
        if self.is_lost() {
            return None;
        }
        let (mut throughput, mut chance) = (Rgb::ONE, 1.0);
        let mut other = Self::default();
        while other.length < self.length {
            let Event::Surface(arrival) = next_event(scene, &ray, &mut medium) else { return None };
            arrival.attenuate(&mut throughput);
            let hit = arrival.hit;
            let shading = scene.shading_within(&hit, medium);
            let transmission = (self.transmissions >> other.length) & 1 == 1;
            let reflected = shading.bsdf.reflection_probability(shading.wo_local);
            // Zero chooses reflection, the largest number refraction.
            let (u, share) =
                if transmission { (ONE_MINUS_EPSILON, 1.0 - reflected) } else { (0.0, reflected) };
            let sample = shading.sample_lobe(Lobe::Specular, u, Vec2::ZERO)?;
            if sample.transmission != transmission || !(share > 0.0) {
                return None;
            }
            throughput *= sample.throughput * share;
            if other.length >= SPLIT_DEPTH {
                chance *= share;
            }
            let direction = shading.frame.to_world(sample.wi);
            medium = scene.medium_after(medium, &hit, &shading, direction, transmission)?;
            other = other.after(&hit, &shading, transmission)?;
            ray = hit.spawn(direction);
        }
        (other == *self).then_some(ChainEnd { ray, medium, throughput, chance })
    }
}
