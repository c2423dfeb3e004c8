//! The two-pass method of Jensen 1996: what the camera sees is computed accurately, what lies behind the next diffuse
//! reflection is read from the photon maps.

mod gather;
mod lookup;
mod show;
mod walk;

pub use lookup::visible_domain;
pub use show::ShowPhotons;

use super::direct::DirectLighting;
use super::{Integrator, Scratch};
use crate::film::{Aov, PixelSample};
use crate::math::{Ray, Rgb};
use crate::media::MediumId;
use crate::photons::{EstimateParams, IrradianceMap, PhotonMap, Query, SearchRegion};
use crate::sampling::SampleStream;
use crate::scene::{RenderPlan, Scene, Shading, SurfaceInteraction};
use glam::Vec3;
use lookup::reflected;
use walk::walk_specular;

/// How the maps are read.
#[derive(Clone, Copy, Debug)]
pub struct PhotonMapSettings {
    /// Photons in an estimate from the global map.
    pub global_nearest: u32,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: u32,
    /// Radius of estimates from the global map, render space, in place of a count of photons.
    pub global_radius: Option<f32>,
    /// Radius of estimates from the caustic map, render space, in place of a count of photons.
    pub caustic_radius: Option<f32>,
    /// Weights and bias of caustic estimates.
    pub caustic: EstimateParams,
    /// Weights and bias of estimates from the global map.
    pub global: EstimateParams,
    /// Search region.
    pub region: SearchRegion,
    /// Whether estimates shrink where they change in one direction only.
    pub differential_check: bool,
    /// Largest radius of an estimate, render space.
    pub max_radius: f32,
    /// Final gather rays per camera sample.
    pub gather_samples: u32,
    /// Shadow rays per light and camera sample.
    pub light_samples: u32,
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: bool,
    /// Surfaces that a chain of specular reflections may have.
    pub max_depth: u32,
}

impl PhotonMapSettings {
    /// A query of the global map at a place.
    pub fn global_query(&self, position: Vec3, normal: Vec3) -> Query {
        self.query(position, normal, self.global_nearest, self.global_radius)
    }

    /// A query of the caustic map at a place.
    pub fn caustic_query(&self, position: Vec3, normal: Vec3) -> Query {
        self.query(position, normal, self.caustic_nearest, self.caustic_radius)
    }

    fn query(&self, position: Vec3, normal: Vec3, nearest: u32, radius: Option<f32>) -> Query {
        let query = match radius {
            Some(radius) => Query::within(position, normal, radius),
            None => {
                Query { max_radius: self.max_radius, ..Query::nearest(position, normal, nearest as usize) }
            }
        };
        Query { region: self.region, differential_check: self.differential_check, ..query }
    }
}

/// The maps of pass 1; those that the plan leaves out are `None`.
#[derive(Debug, Default)]
pub struct PhotonMaps {
    /// All photons on diffuse surfaces.
    pub global: Option<PhotonMap>,
    /// Irradiance precomputed at photons of the global map; `None` for full estimates at every gather ray.
    pub irradiance: Option<IrradianceMap>,
    /// Photons that met only specular surfaces.
    pub caustic: Option<PhotonMap>,
}

/// Pass 2.
#[derive(Debug)]
pub struct PhotonMapIntegrator<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    settings: PhotonMapSettings,
    direct: DirectLighting<'a>,
    bsdf_sampling: bool,
    camera_medium: MediumId,
}

/// A diffuse surface that is computed accurately.
struct Vertex<'a> {
    hit: &'a SurfaceInteraction,
    shading: &'a Shading,
    medium: MediumId,
    /// Share of the camera sample that arrives here: scales the number of gather rays.
    share: f32,
}

impl<'a> PhotonMapIntegrator<'a> {
    /// Reads `maps` for pictures of `scene` from a camera in `camera_medium`.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        plan: &RenderPlan,
        settings: PhotonMapSettings,
        camera_medium: MediumId,
    ) -> Self {
        let bsdf_sampling = plan.bsdf_sampling.build;
        let direct = DirectLighting::new(scene, settings.light_samples, bsdf_sampling);
        Self { scene, maps, settings, direct, bsdf_sampling, camera_medium }
    }

    /// Third integral: the caustic map, shown directly.
    fn caustics(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> Rgb {
        let Some(map) = &self.maps.caustic else { return Rgb::ZERO };
        scratch.counters.caustic_lookups += 1;
        let query = self.settings.caustic_query(vertex.hit.point.position, vertex.hit.facing_normal());
        reflected(self.scene, &self.settings, (map, &query, &self.settings.caustic), vertex.shading, scratch)
    }

    fn transmittance(&self, medium: MediumId, distance: f32) -> Rgb {
        let medium = self.scene.medium(medium);
        if medium.is_clear() { Rgb::ONE } else { medium.transmittance(distance) }
    }

    /// All four integrals at a diffuse surface.
    fn shade(
        &self,
        vertex: &Vertex<'_>,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> [(Aov, Rgb); 3] {
        let Vertex { hit, shading, medium, .. } = *vertex;
        if !shading.bsdf.has_diffuse() {
            return [(Aov::Direct, Rgb::ZERO), (Aov::Caustics, Rgb::ZERO), (Aov::Indirect, Rgb::ZERO)];
        }
        let by_light = self.direct.radiance(hit, shading, medium, samples, &mut scratch.counters);
        let caustics = self.caustics(vertex, scratch);
        let (indirect, by_bsdf) = self.indirect(vertex, samples, scratch);
        [(Aov::Direct, by_light + by_bsdf), (Aov::Caustics, caustics), (Aov::Indirect, indirect)]
    }
}

impl Integrator for PhotonMapIntegrator<'_> {
    fn li(&self, ray: Ray, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        walk_specular(self.scene, ray, self.camera_medium, self.settings.max_depth, samples, scratch, &mut {
            |vertex: &Vertex<'_>, samples: &mut SampleStream, scratch: &mut Scratch| {
                self.shade(vertex, samples, scratch)
            }
        })
    }
}
