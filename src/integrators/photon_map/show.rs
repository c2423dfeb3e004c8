//! Direct display of one photon map.

use super::lookup::{reflected, reflected_from_atlas};
use super::walk::{Walk, walk_specular};
use super::{PhotonMapSettings, PhotonMaps, Vertex};
use crate::film::{Aov, PixelSample};
use crate::integrators::{EyeRay, Integrator, Scratch};
use crate::math::Rgb;
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, MapKind, Scene};
use std::f32::consts::FRAC_1_PI;

/// Side of the voxels of brick maps that are shown, over the length of the path from the eye: about a pixel.
const SHOWN_WIDTH: f32 = 1e-3;

/// Displays one map, or the brick maps of an irradiance atlas, at the first diffuse surface seen directly or through specular ones (figure 4 of Jensen 1996).
#[derive(Debug)]
pub struct ShowPhotons<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    kind: MapKind,
    settings: PhotonMapSettings,
    camera_media: CameraMedia,
}

impl<'a> ShowPhotons<'a> {
    /// Displays the map of this kind.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        kind: MapKind,
        settings: PhotonMapSettings,
        camera_media: CameraMedia,
    ) -> Self {
        Self { scene, maps, kind, settings, camera_media }
    }

    fn shade(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> (Aov, Rgb) {
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let (map, params, aov) = match self.kind {
            MapKind::Global => (&self.maps.global, &self.settings.global, Aov::Indirect),
            MapKind::Caustic => (&self.maps.caustic, &self.settings.caustic, Aov::Caustics),
        };
        if let Some(irradiance) = self.maps.illumination.as_ref().and_then(|maps| match self.kind {
            MapKind::Global => maps.all(vertex.hit.surface, position, normal),
            MapKind::Caustic => maps.caustic(vertex.hit.surface, position, normal),
        }) {
            scratch.counters.illumination_lookups += 1;
            let lambert = vertex.shading.bsdf.lambertian();
            let reflected = lambert.map_or(Rgb::ZERO, |lambert| lambert.reflectance * irradiance * FRAC_1_PI);
            return (aov, reflected);
        }
        if let Some(atlas) = &self.maps.atlas {
            let width = SHOWN_WIDTH * vertex.travelled;
            let found = reflected_from_atlas(atlas, (vertex.hit, vertex.shading), width, scratch);
            return (aov, found.unwrap_or(Rgb::ZERO));
        }
        let Some(map) = map else { return (aov, Rgb::ZERO) };
        if !vertex.shading.bsdf.has_diffuse() {
            return (aov, Rgb::ZERO);
        }
        let query = match self.kind {
            MapKind::Global => {
                scratch.counters.global_lookups += 1;
                self.settings.global_query(position, normal)
            }
            MapKind::Caustic => {
                scratch.counters.caustic_lookups += 1;
                self.settings.caustic_query(map, position, normal, 1.0)
            }
        };
        (aov, reflected(self.scene, &self.settings, (map, &query, params), vertex.shading, scratch))
    }
}

impl Integrator for ShowPhotons<'_> {
    fn li(&self, ray: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let walk = Walk {
            scene: self.scene,
            max_depth: self.settings.max_depth,
            glossy_samples: self.settings.glossy_samples,
            samples_lights: false,
            wavelengths: self.settings.wavelengths,
            media: None,
        };
        let medium = self.camera_media.at(self.scene, ray.ray.origin);
        walk_specular(walk, ray, medium, samples, scratch, &mut {
            |vertex: &Vertex<'_>, _: &mut SampleStream, scratch: &mut Scratch| [self.shade(vertex, scratch)]
        })
    }
}
