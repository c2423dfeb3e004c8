//! Chains of specular surfaces that can be followed again from another camera ray.

use crate::bsdf::Lobe;
use crate::integrators::specular::SPLIT_DEPTH;
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::{Scene, Shading, SurfaceInteraction};
use crate::transport::{Event, next_event};
use glam::Vec2;

/// Largest number of surfaces in a chain that can be followed again.
const LONGEST: u32 = 64;

/// The specular lobes that a path followed since the camera, and nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::integrators) struct Chain {
    /// One bit per surface, the first one lowest: set for refraction.
    transmissions: u64,
    length: u32,
    /// Hash of the surfaces.
    hash: u32,
}

/// The end of a chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChainEnd {
    /// The ray that leaves the last surface.
    pub ray: Ray,
    /// Medium stack of the ray.
    pub medium: MediumStack,
    /// Radiance that arrives at the camera over the radiance along the ray.
    pub throughput: Rgb,
    /// Approximate probability with which a camera sample follows this chain and no other: the product of the choices made where there
    /// are many interfaces. It depends on place and chain alone.
    pub chance: f32,
}

impl Chain {
    /// The chain extended by the specular lobe of another surface; `None` where that lobe mirrors in two directions or disperses light.
    pub(in crate::integrators) fn after(
        self,
        hit: &SurfaceInteraction,
        shading: &Shading,
        transmission: bool,
    ) -> Option<Self> {
        if transmission && shading.disperses {
            return None;
        }
        if !shading.bsdf.has_specular() || !shading.bsdf.has_one_mirror(shading.wo_local) {
            return None;
        }
        if self.length >= LONGEST {
            return Some(Self { length: LONGEST + 1, ..self });
        }
        // On a flat face, another primitive reflects in another direction; with interpolated normals it does not.
        let is_flat = hit.shading_normal == hit.point.normal;
        let face = if is_flat { hit.primitive } else { 0 };
        let hash = (self.hash ^ hit.surface).wrapping_mul(0x9e37_79b1) ^ face.wrapping_mul(0x85eb_ca6b);
        Some(Self {
            transmissions: self.transmissions | (u64::from(transmission) << self.length),
            length: self.length + 1,
            hash: hash.rotate_left(15),
        })
    }

    /// Whether it contains no surface.
    pub(in crate::integrators) fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Whether it contains too many surfaces to be followed again.
    pub(super) fn is_lost(&self) -> bool {
        self.length > LONGEST
    }

    /// Follows another ray over the same surfaces with the same choices; `None` where the ray does not meet them.
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
            // Zero selects reflection; the largest number selects refraction.
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
