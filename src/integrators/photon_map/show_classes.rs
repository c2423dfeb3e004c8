//! Display of single photons in the colours of their classes.

use super::walk::{Walk, walk_specular};
use super::{PhotonMapSettings, PhotonMaps, Vertex};
use crate::film::{Aov, PixelSample};
use crate::integrators::{EyeRay, Integrator, Scratch};
use crate::math::Rgb;
use crate::photons::{PhotonClass, PhotonClasses, PhotonMap, Query};
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, MapKind, Scene};
use crate::settings::Wavelengths;

/// Radius of a photon's disc, as a share of the scene's radius.
const DISC: f32 = 0.006;

/// Radiance between the discs, as a share of the surface's albedo, so that the scene remains recognisable.
const GROUND: f32 = 0.1;

/// Displays each photon of a map, and the shadow photons of all lights, as a disc on the first diffuse surface seen directly or through
/// specular ones (figure 1 of Jensen 1996). The largest radiance is 1, whatever the lights.
#[derive(Debug)]
pub struct ShowClasses<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    kind: MapKind,
    max_depth: u32,
    camera_media: CameraMedia,
}

impl<'a> ShowClasses<'a> {
    /// Displays the map of this kind and the shadow photons that `maps` hold.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        kind: MapKind,
        settings: PhotonMapSettings,
        camera_media: CameraMedia,
    ) -> Self {
        Self { scene, maps, kind, max_depth: settings.max_depth, camera_media }
    }

    /// Class of the nearest photon whose disc covers the point.
    fn class_at(&self, vertex: &Vertex<'_>) -> Option<PhotonClass> {
        let radius = DISC * self.scene.bounds().1;
        let query = Query::within(vertex.hit.point.position, vertex.hit.facing_normal(), radius);
        let nearest = |map: &PhotonMap, classes| {
            let query = Query { classes, ..query };
            map.nearest_one(&query, |_| true).map(|(index, distance)| (distance, map.class(index)))
        };
        let map = match self.kind {
            MapKind::Global => self.maps.global.as_ref(),
            MapKind::Caustic => self.maps.caustic.as_ref(),
        };
        let light = map.and_then(|map| nearest(map, PhotonClasses::LIGHT));
        let shadows = self.maps.shadows.iter().flat_map(|maps| maps.photon_maps());
        shadows
            .filter_map(|map| nearest(map, PhotonClasses::only(PhotonClass::Shadow)))
            .chain(light)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, class)| class)
    }

    fn shade(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> (Aov, Rgb) {
        if !vertex.shading.bsdf.has_diffuse() {
            return (Aov::Indirect, Rgb::ZERO);
        }
        scratch.counters.global_lookups += 1;
        let color = match self.class_at(vertex) {
            Some(PhotonClass::Direct) => Rgb::ONE,
            Some(PhotonClass::Indirect) => Rgb::new(0.1, 0.25, 1.0),
            Some(PhotonClass::Caustic) => Rgb::new(1.0, 0.8, 0.05),
            Some(PhotonClass::Shadow) => Rgb::new(1.0, 0.05, 0.02),
            None => vertex.shading.bsdf.albedo(vertex.shading.wo_local) * GROUND,
        };
        // The film divides by the power factor of render space.
        (Aov::Indirect, color * self.scene.space().power as f32)
    }
}

impl Integrator for ShowClasses<'_> {
    fn li(&self, ray: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let walk = Walk {
            scene: self.scene,
            max_depth: self.max_depth,
            glossy_samples: 1,
            samples_lights: false,
            // One direction tells what lies behind glass.
            wavelengths: Wavelengths::Off,
            media: None,
        };
        let medium = self.camera_media.at(self.scene, ray.ray.origin);
        walk_specular(walk, ray, medium, samples, scratch, &mut {
            |vertex: &Vertex<'_>, _: &mut SampleStream, scratch: &mut Scratch| [self.shade(vertex, scratch)]
        })
    }
}
