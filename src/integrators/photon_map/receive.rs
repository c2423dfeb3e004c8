//! Irradiance at a point, from the maps or by final gathering.

use super::lookup::reflected;
use super::{PhotonMapIntegrator, Vertex};
use crate::film::PixelSample;
use crate::integrators::{Irradiance, Receiver, Scratch};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::photons::{PhotonClass, PhotonClasses};
use crate::sampling::SampleStream;
use std::f32::consts::PI;

impl PhotonMapIntegrator<'_> {
    /// One estimate of the irradiance at a surface in `medium`, computed as for images: by shadow rays, the caustic map, and gather rays
    /// that read the global map.
    pub fn gathered_irradiance(
        &self,
        receiver: &Receiver,
        medium: MediumStack,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Irradiance {
        let vertex = Vertex {
            hit: &receiver.hit,
            shading: &receiver.shading,
            medium,
            share: 1.0,
            weight: 1.0,
            depth: 1,
            travelled: 0.0,
            width: 0.0,
        };
        let mut out = PixelSample::default();
        for (aov, radiance) in self.shade(&vertex, samples, scratch) {
            out.add(aov, radiance);
        }
        Irradiance::of_white(&out)
    }

    /// Irradiance from the illumination map of the surface. All light except caustics counts as indirect here, because the map does not
    /// separate it. `None` where the surface has no such map.
    pub fn summed_irradiance(&self, receiver: &Receiver) -> Option<Irradiance> {
        let maps = self.maps.illumination.as_ref()?;
        let (surface, position) = (receiver.hit.surface, receiver.hit.point.position);
        let normal = receiver.hit.facing_normal();
        let caustic = maps.caustic(surface, position, normal)?;
        let indirect = maps.diffuse(surface, position, normal)?;
        Some(Irradiance { direct: Rgb::ZERO, caustic, indirect })
    }

    /// Irradiance estimated from the photons themselves: direct and indirect light from the global map, each from the photons of its
    /// class, and caustics from the caustic map.
    pub fn photon_irradiance(&self, receiver: &Receiver, scratch: &mut Scratch) -> Irradiance {
        let (position, normal) = (receiver.hit.point.position, receiver.hit.facing_normal());
        let mut global = |class| {
            let Some(map) = &self.maps.global else { return Rgb::ZERO };
            scratch.counters.global_lookups += 1;
            let mut query = self.settings.global_query(position, normal);
            query.classes = PhotonClasses::only(class);
            let what = (map, &query, &self.settings.global);
            PI * reflected(self.scene, &self.settings, what, &receiver.shading, scratch)
        };
        let (direct, indirect) = (global(PhotonClass::Direct), global(PhotonClass::Indirect));
        let caustic = self.maps.caustic.as_ref().map_or(Rgb::ZERO, |map| {
            scratch.counters.caustic_lookups += 1;
            let query = self.settings.caustic_query(map, position, normal, 1.0);
            let what = (map, &query, &self.settings.caustic);
            PI * reflected(self.scene, &self.settings, what, &receiver.shading, scratch)
        });
        Irradiance { direct, caustic, indirect }
    }
}
