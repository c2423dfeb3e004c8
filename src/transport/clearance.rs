//! Walks through dense media trace no ray while they stay closer than the nearest surface.

use crate::math::Ray;
use crate::media::Volume;
use crate::media::density::Density;
use crate::scene::Scene;

/// What a walk through a homogeneous medium knows of the distance to surfaces. The events that it meets are the same as without.
#[derive(Clone, Copy, Debug)]
pub struct Clearance {
    /// No ray from the present place hits anything nearer.
    distance: f32,
    /// Collisions until the scene is asked again.
    wait: u8,
}

/// Distances are asked for up to so many mean free paths.
const REACH: f32 = 32.0;

/// With fewer mean free paths than this, a walk soon needs a ray anyway.
const USEFUL: f32 = 2.0;

/// Collisions without a question at the start of a walk, and after an answer that was of little use: so thin media, in which walks are short,
/// cost nothing, and by then a walk is a few mean free paths away.
const PATIENCE: u8 = 8;

impl Default for Clearance {
    /// Of a walk that begins.
    fn default() -> Self {
        Self { distance: 0.0, wait: PATIENCE }
    }
}

impl Clearance {
    /// The distance within which a ray from where the walk is now hits nothing, for a collision in `volume`; zero where it is not known.
    pub(super) fn at(&mut self, scene: &Scene, ray: &Ray, volume: &Volume) -> f32 {
        let extinction = volume.coefficients().extinction().max_element();
        if !(matches!(volume.density(), Density::Homogeneous) && extinction > 0.0) {
            return 0.0;
        }
        let useful = USEFUL / extinction;
        if self.distance < useful {
            if self.wait > 0 {
                self.wait -= 1;
            } else {
                self.distance = scene.embree().clearance(ray.origin, REACH / extinction);
                self.wait = if self.distance < useful { PATIENCE } else { 0 };
            }
        }
        self.distance
    }

    /// The walk moved on by `t`.
    pub(super) fn moved(&mut self, t: f32) {
        self.distance = (self.distance - t).max(0.0);
    }

    /// The walk left the medium, or met a surface.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }
}
