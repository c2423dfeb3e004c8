//! Photon map integrator, the two-pass method of Jensen 1996: what the camera sees is computed accurately; what lies behind the next
//! diffuse reflection is read from the photon maps.

mod cache;
mod gather;
mod glossy;
mod lookup;
mod media;
mod narrowing;
mod receive;
mod reuse;
mod show;
mod show_classes;
mod show_radiosity;
mod walk;

pub use cache::{CachePass, CacheRequest};
pub use lookup::Place;
pub use narrowing::Narrowing;
pub use show::ShowPhotons;
pub use show_classes::ShowClasses;
pub use show_radiosity::{RadiosityView, ShowRadiosity, ShownRadiosity};

use super::direct::{DirectLighting, Reflected};
use super::{Directions, EyeRay, Integrator, Scratch};
use crate::bricks::IrradianceAtlas;
use crate::caches::IrradianceCache;
use crate::film::{Aov, PixelSample};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::photons::{
    DirectionGuide, EstimateParams, IlluminationMaps, IrradianceMap, MediaMaps, PhotonMap, Query,
    SearchRegion, ShadowMaps,
};
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, RenderPlan, Scene, Shading, SurfaceInteraction};
use crate::settings::Wavelengths;
use gather::Gain;
use glam::Vec3;
use lookup::{irradiance, irradiance_of, is_grey, reflected_estimate};
pub(super) use reuse::Remembered;
use std::f32::consts::FRAC_1_PI;
use walk::{Walk, walk_specular};

/// Settings of reading the maps.
#[derive(Clone, Copy, Debug)]
pub struct PhotonMapSettings {
    /// Number of photons in an estimate from the global map.
    pub global_nearest: u32,
    /// Number of photons in an estimate from the caustic map.
    pub caustic_nearest: u32,
    /// Fixed radius of estimates from the global map, render space; replaces the number of photons.
    pub global_radius: Option<f32>,
    /// Fixed radius of estimates from the caustic map, render space; replaces the number of photons.
    pub caustic_radius: Option<f32>,
    /// Weights and bias of caustic estimates.
    pub caustic: EstimateParams,
    /// Weights and bias of estimates from the global map.
    pub global: EstimateParams,
    /// Shape of the search region.
    pub region: SearchRegion,
    /// Whether estimates shrink where they grow or fall in one direction only (differential checking).
    pub differential_check: bool,
    /// Largest radius of an estimate, render space.
    pub max_radius: f32,
    /// Radius of the scene, render space; infinite where the scene has none.
    pub scene_radius: f32,
    /// Final gather rays per camera sample.
    pub gather_samples: u32,
    /// Distribution rays at the first highly glossy lobe that a camera sample meets; the next lobes get fewer.
    pub glossy_samples: u32,
    /// Shadow rays per light and camera sample.
    pub light_samples: u32,
    /// Whether estimates exclude what is not visible from their centre.
    pub visible_kernel: bool,
    /// Camera samples of one pixel share a caustic estimate on a Lambertian surface if they are closer to each other than this share of
    /// its radius.
    pub caustic_reuse: f32,
    /// Largest number of surfaces in a chain of specular reflections.
    pub max_depth: u32,
    /// Behind a diffuse reflection, surfaces closer than this are computed accurately (Jensen 1996, section 4); render space.
    pub accurate_distance: f32,
    /// Paths with a smaller weight than this are evaluated from the maps alone.
    pub approximate_weight: f32,
    /// Side of the voxels of brick maps that gather rays read, over the width of the cone of the ray.
    pub atlas_footprint: f32,
    /// Wavelengths of paths where light is dispersed.
    pub wavelengths: Wavelengths,
    /// Narrowing of the biased estimates in a round of progressive rendering; `None` for an image from a single set of maps.
    pub narrowing: Option<Narrowing>,
}

impl PhotonMapSettings {
    /// A query of the global map at a point.
    pub fn global_query(&self, position: Vec3, normal: Vec3) -> Query {
        self.query(position, normal, self.global_nearest, self.global_radius)
    }

    /// A query of the caustic map at a point.
    ///
    /// The radius is limited to where, if the photons were spread evenly over a sphere around the scene, the query would find four times
    /// as many as it needs. Beyond that radius caustics are so faint that one photon more or less makes no difference, and a wide search
    /// only meets the foci of other caustics. Rounds of progressive rendering have their own radius schedule.
    ///
    /// Where only a `share` of a camera sample arrives, fewer photons and down to half the reach are enough, because the noise is scaled
    /// by that share.
    pub fn caustic_query(&self, map: &PhotonMap, position: Vec3, normal: Vec3, share: f32) -> Query {
        let least = self.caustic_nearest.min(LEAST_CAUSTIC_NEAREST);
        let wanted = ((self.caustic_nearest as f32 * share).ceil() as u32).clamp(least, self.caustic_nearest);
        let query = self.query(position, normal, wanted, self.caustic_radius);
        if let Some(narrowing) = self.narrowing {
            return narrowing.narrow(query);
        }
        if self.caustic_radius.is_some() {
            return query;
        }
        let of_all = wanted as f32 / map.len().max(1) as f32;
        let reach = (2.0 + 2.0 * share.min(1.0)) * self.scene_radius * of_all.sqrt();
        Query { max_radius: query.max_radius.min(reach), ..query }
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

/// The maps of pass 1. Maps that the plan leaves out are `None`.
#[derive(Debug, Default)]
pub struct PhotonMaps {
    /// All photons on diffuse surfaces.
    pub global: Option<PhotonMap>,
    /// Irradiance precomputed at photons of the global map; `None` for full estimates at every gather ray.
    pub irradiance: Option<IrradianceMap>,
    /// Directional distributions of the indirect light; `None` where directions are sampled from BSDFs alone.
    pub guide: Option<DirectionGuide>,
    /// Irradiance precomputed at photons of the caustic map, for glossy and gather lookups; `None` for full estimates there too.
    pub caustic_irradiance: Option<IrradianceMap>,
    /// Photons that met only specular surfaces.
    pub caustic: Option<PhotonMap>,
    /// Photons summed up over objects with illumination maps; `None` where there are no such objects.
    pub illumination: Option<IlluminationMaps>,
    /// Photons in media that scatter; empty where there are none.
    pub media: MediaMaps,
    /// Brick maps of irradiance on disk, which gather rays read in place of the global map; `None` without them.
    pub atlas: Option<IrradianceAtlas>,
    /// Direct and shadow photons, by light; `None` where every shadow ray is traced.
    pub shadows: Option<ShadowMaps>,
    /// A radiosity solution, which is read in place of photons; `None` where photons are.
    pub radiosity: Option<ShownRadiosity>,
}

impl PhotonMaps {
    /// Memory in bytes of all precomputed irradiance.
    pub fn irradiance_bytes(&self) -> u64 {
        let of = |map: &Option<IrradianceMap>| map.as_ref().map_or(0, IrradianceMap::memory_bytes);
        (of(&self.irradiance) + of(&self.caustic_irradiance)) as u64
    }
}

/// Smallest number of photons of a caustic estimate with a small share of a camera sample.
const LEAST_CAUSTIC_NEAREST: u32 = 32;

/// Validity radius of a point with precomputed caustics, as a share of the radius of its estimate. Every fourth photon is such a point.
/// Where there are as many photons as an estimate needs, nearly all positions are therefore closer to a point than a third of the
/// radius; where there are few, they spread their light over most of the radius anyway.
pub const CAUSTIC_POINT_REACH: f32 = 0.5;

/// Largest share of a camera sample for which precomputed caustics are read.
const LARGEST_SHARE_NEARBY: f32 = 0.5;

/// Caustics fainter than this share of the other light of the camera sample are estimated over the whole disc: parts that are not
/// visible from its centre make no visible difference.
const FAINT_CAUSTICS: f32 = 0.005;

/// The same limit as a share of the light at one surface, however little of it arrives at the eye.
const FAINTEST_HERE: f32 = 0.1;

/// The photon map integrator (pass 2).
#[derive(Debug)]
pub struct PhotonMapIntegrator<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    settings: PhotonMapSettings,
    direct: DirectLighting<'a>,
    bsdf_sampling: bool,
    camera_media: CameraMedia,
    cache: Option<IrradianceCache>,
}

/// A surface with a diffuse or a highly glossy lobe that is computed accurately.
struct Vertex<'a> {
    hit: &'a SurfaceInteraction,
    shading: &'a Shading,
    medium: MediumStack,
    /// Share of the camera sample that arrives here; scales the number of gather rays.
    share: f32,
    /// Factor on light from here on its way to the eye, brightest channel.
    weight: f32,
    /// Number of segments from the eye to here.
    depth: u32,
    /// Path length from the eye to here.
    travelled: f32,
    /// Width of the cone of the ray that ends here: over which an average of irradiance will do; render space.
    width: f32,
}

impl<'a> PhotonMapIntegrator<'a> {
    /// Reads `maps` for images of `scene` from a camera in `camera_media`.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        plan: &RenderPlan,
        settings: PhotonMapSettings,
        camera_media: impl Into<CameraMedia>,
    ) -> Self {
        let bsdf_sampling = plan.bsdf_sampling.build;
        let direct = DirectLighting::new(scene, settings.light_samples, bsdf_sampling)
            .with_shadows(maps.shadows.as_ref());
        Self { scene, maps, settings, direct, bsdf_sampling, camera_media: camera_media.into(), cache: None }
    }

    /// How directions of gather rays are sampled at a vertex.
    fn directions<'v>(&'v self, vertex: &Vertex<'v>, scratch: &mut Scratch) -> Directions<'v> {
        Directions::new(self.maps.guide.as_ref(), vertex.hit, vertex.shading, &mut scratch.counters)
    }

    /// Largest radiance of caustics whose visibility is not tested, if the vertex sends out the radiance `other`.
    fn faint_caustics(vertex: &Vertex<'_>, other: Rgb) -> f32 {
        (FAINT_CAUSTICS / vertex.share.max(FAINT_CAUSTICS)).min(FAINTEST_HERE) * (other.element_sum() / 3.0)
    }

    /// The third integral: the caustic map, shown directly. `other` is the other light that leaves the vertex. The second value is the
    /// expected bias, in rounds of progressive rendering.
    fn caustics(&self, vertex: &Vertex<'_>, other: Rgb, scratch: &mut Scratch) -> (Rgb, Rgb) {
        let by_map = self.summed_up(vertex.hit, vertex.shading, IlluminationMaps::caustic, scratch);
        if let Some(radiance) = by_map {
            return (radiance, Rgb::ZERO);
        }
        let Some(map) = &self.maps.caustic else { return (Rgb::ZERO, Rgb::ZERO) };
        scratch.counters.caustic_lookups += 1;
        let query = Query {
            faint: Self::faint_caustics(vertex, other),
            ..self.settings.caustic_query(
                map,
                vertex.hit.point.position,
                vertex.hit.facing_normal(),
                vertex.share,
            )
        };
        let what = (map, &query, &self.settings.caustic);
        let estimate = reflected_estimate(self.scene, &self.settings, what, vertex.shading, scratch);
        (estimate.value, narrowing::bias_of(&estimate))
    }

    /// The same integral behind a diffuse reflection.
    fn caustics_behind(&self, vertex: &Vertex<'_>, other: Rgb, scratch: &mut Scratch) -> Rgb {
        if let Some(radiance) = self.caustics_nearby(vertex, scratch) {
            return radiance;
        }
        let (Some(map), Some(narrowing)) = (&self.maps.caustic, self.settings.narrowing) else {
            return self.caustics(vertex, other, scratch).0;
        };
        scratch.counters.caustic_lookups += 1;
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let query = self.settings.caustic_query_behind(narrowing, position, normal);
        // Feeler rays would dominate the cost, and the radius is small.
        let reading = PhotonMapSettings { visible_kernel: false, ..self.settings };
        reflected_estimate(
            self.scene,
            &reading,
            (map, &query, &self.settings.caustic),
            vertex.shading,
            scratch,
        )
        .value
    }

    /// Caustics from the nearest precomputed point; `None` where caustics are not precomputed or no point is near enough.
    fn caustics_nearby(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> Option<Rgb> {
        let points = self.maps.caustic_irradiance.as_ref().filter(|_| self.settings.narrowing.is_none())?;
        let lambert = vertex.shading.bsdf.lambertian()?;
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let connects = |place, facing| self.scene.connects(vertex.hit, place, facing);
        let map = self.maps.caustic.as_ref()?;
        // Largest validity radius of a point. Without it, a position far from all points of its own side would search all the points
        // around it.
        let widest = self.settings.caustic_query(map, position, normal, 1.0).max_radius;
        let largest = CAUSTIC_POINT_REACH * widest.min(self.settings.max_radius);
        let irradiance = points.near(position, normal, largest, connects)?;
        scratch.counters.caustic_nearby += 1;
        Some(lambert.reflectance * irradiance * FRAC_1_PI)
    }

    /// [`Self::caustics`] for a surface that the eye sees. An estimate that blurs over the pixel is computed once for all its camera
    /// samples. It is not shared by gather rays, which land at different places in each sample.
    fn shared_caustics(&self, vertex: &Vertex<'_>, other: Rgb, scratch: &mut Scratch) -> (Rgb, Rgb) {
        let reuse = self.settings.caustic_reuse;
        let shares = reuse > 0.0 && self.settings.narrowing.is_none();
        let lambert = vertex.shading.bsdf.lambertian().filter(|_| shares);
        let (Some(map), Some(lambert)) = (&self.maps.caustic, lambert) else {
            return self.caustics(vertex, other, scratch);
        };
        if map.is_dispersed() && !is_grey(lambert.reflectance) {
            return self.caustics(vertex, other, scratch);
        }
        let by_map = self.summed_up(vertex.hit, vertex.shading, IlluminationMaps::caustic, scratch);
        if let Some(radiance) = by_map {
            return (radiance, Rgb::ZERO);
        }
        if vertex.share <= LARGEST_SHARE_NEARBY
            && let Some(radiance) = self.caustics_nearby(vertex, scratch)
        {
            return (radiance, Rgb::ZERO);
        }
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let known = scratch.remembered.at(position, normal);
        scratch.counters.caustic_shared += u64::from(known.is_some());
        let irradiance = known.unwrap_or_else(|| {
            scratch.counters.caustic_lookups += 1;
            let query = Query {
                faint: irradiance_of(Self::faint_caustics(vertex, other), lambert.reflectance),
                ..self.settings.caustic_query(map, position, normal, vertex.share)
            };
            let what = (map, &query, &self.settings.caustic);
            let (estimate, seen) = irradiance(self.scene, &self.settings, what, scratch);
            // Geometry closer than the radius separates places for which estimates differ.
            scratch.remembered.note(position, normal, seen.min(reuse * estimate.radius), estimate.value);
            estimate.value
        });
        (lambert.reflectance * irradiance * FRAC_1_PI, Rgb::ZERO)
    }

    /// Radiance that a Lambertian surface reflects of the light that `read` finds in its illumination map; `None` where it has no such
    /// map.
    fn summed_up(
        &self,
        hit: &SurfaceInteraction,
        shading: &Shading,
        read: impl Fn(&IlluminationMaps, u32, Vec3, Vec3) -> Option<Rgb>,
        scratch: &mut Scratch,
    ) -> Option<Rgb> {
        let maps = self.maps.illumination.as_ref()?;
        let irradiance = read(maps, hit.surface, hit.point.position, hit.facing_normal())?;
        let lambert = shading.bsdf.lambertian()?;
        scratch.counters.illumination_lookups += 1;
        Some(lambert.reflectance * irradiance * FRAC_1_PI)
    }

    /// All integrals at a surface that is not ideally specular, except for what the rays of highly glossy lobes find.
    fn shade(
        &self,
        vertex: &Vertex<'_>,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> [(Aov, Rgb); 4] {
        let Vertex { hit, shading, medium, .. } = *vertex;
        let (has_diffuse, has_glossy) = (shading.bsdf.has_diffuse(), shading.bsdf.has_glossy());
        let is_light = !has_glossy && vertex.depth > 1 && vertex.weight < self.settings.approximate_weight;
        if is_light && let Some(radiance) = self.approximate(vertex, 0.0, scratch) {
            scratch.counters.approximate_weight += 1;
            let nothing = |aov: Aov| (aov, Rgb::ZERO);
            return [
                nothing(Aov::Direct),
                nothing(Aov::Specular),
                nothing(Aov::Caustics),
                (Aov::Indirect, radiance),
            ];
        }
        scratch.counters.accurate_seen += u64::from(has_diffuse);
        let directions = self.directions(vertex, scratch);
        let by_light = if has_diffuse || has_glossy {
            self.direct.radiance(hit, &directions, medium, samples, scratch)
        } else {
            Reflected::default()
        };
        let (mut caustics, mut gathered) = (Rgb::ZERO, Gain::default());
        if has_diffuse {
            gathered = self.indirect(vertex, &directions, samples, scratch);
            // At surfaces seen directly, indirect light is left out, so that an irradiance cache changes nothing else.
            let indirect = if vertex.depth > 1 { gathered.indirect } else { Rgb::ZERO };
            let other = by_light.diffuse + gathered.direct + indirect;
            let bias;
            (caustics, bias) = self.shared_caustics(vertex, other, scratch);
            scratch.bias = bias + gathered.bias;
        }
        [
            (Aov::Direct, by_light.diffuse + gathered.direct),
            (Aov::Specular, by_light.glossy),
            (Aov::Caustics, caustics),
            (Aov::Indirect, gathered.indirect),
        ]
    }
}

impl Integrator for PhotonMapIntegrator<'_> {
    fn li(&self, ray: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let walk = Walk {
            scene: self.scene,
            max_depth: self.settings.max_depth,
            glossy_samples: self.settings.glossy_samples,
            samples_lights: true,
            wavelengths: self.settings.wavelengths,
            media: Some(&|stretch, throughput, samples, scratch| {
                self.scattered_along(stretch, throughput, samples, scratch)
            }),
        };
        let medium = self.camera_media.at(self.scene, ray.ray.origin);
        walk_specular(walk, ray, medium, samples, scratch, &mut {
            |vertex: &Vertex<'_>, samples: &mut SampleStream, scratch: &mut Scratch| {
                self.shade(vertex, samples, scratch)
            }
        })
    }
}
