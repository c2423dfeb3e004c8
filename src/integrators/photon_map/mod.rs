//! The two-pass method of Jensen 1996: what the camera sees is computed accurately, what lies behind the next diffuse
//! reflection is read from the photon maps.

mod cache;
mod gather;
mod glossy;
mod lookup;
mod narrowing;
mod receive;
mod reuse;
mod show;
mod show_classes;
mod walk;

pub use cache::{CachePass, CacheRequest};
pub use lookup::Place;
pub use narrowing::Narrowing;
pub use show::ShowPhotons;
pub use show_classes::ShowClasses;

use super::direct::{DirectLighting, Reflected};
use super::{Directions, EyeRay, Integrator, Scratch};
use crate::caches::IrradianceCache;
use crate::film::{Aov, PixelSample};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::photons::{
    DirectionGuide, EstimateParams, IlluminationMaps, IrradianceMap, PhotonMap, Query, SearchRegion,
    ShadowMaps,
};
use crate::sampling::SampleStream;
use crate::scene::{RenderPlan, Scene, Shading, SurfaceInteraction};
use gather::Gain;
use glam::Vec3;
use lookup::{irradiance, irradiance_of, reflected_estimate};
pub(super) use reuse::Remembered;
use std::f32::consts::FRAC_1_PI;
use walk::{Walk, walk_specular};

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
    /// Radius of the scene, render space; infinite where it has none.
    pub scene_radius: f32,
    /// Final gather rays per camera sample.
    pub gather_samples: u32,
    /// Distribution rays at the first highly glossy lobe that a camera sample meets; fewer at the next ones.
    pub glossy_samples: u32,
    /// Shadow rays per light and camera sample.
    pub light_samples: u32,
    /// Whether estimates leave out what cannot be seen from their centre.
    pub visible_kernel: bool,
    /// Camera samples of one pixel that are nearer to one another than this share of the radius of a caustic estimate share
    /// it, on Lambertian surfaces.
    pub caustic_reuse: f32,
    /// Surfaces that a chain of specular reflections may have.
    pub max_depth: u32,
    /// Behind a diffuse reflection, surfaces nearer than this are computed accurately (Jensen 1996, section 4), render
    /// space.
    pub accurate_distance: f32,
    /// Paths that carry less than this are evaluated from the maps alone.
    pub approximate_weight: f32,
    /// How far a round of progressive rendering has narrowed what is biased; `None` for a picture of one map alone.
    pub narrowing: Option<Narrowing>,
}

impl PhotonMapSettings {
    /// A query of the global map at a place.
    pub fn global_query(&self, position: Vec3, normal: Vec3) -> Query {
        self.query(position, normal, self.global_nearest, self.global_radius)
    }

    /// A query of the caustic map at a place.
    ///
    /// It reaches no farther than where, were the photons spread evenly over a sphere around the scene, it would find four
    /// times as many as are wanted: beyond that caustics are so faint that one photon more or less changes nothing, and what
    /// a wide search meets is the foci of others. Rounds of progressive rendering have a law of their own.
    ///
    /// Where only a `share` of a camera sample arrives fewer photons serve, and half the reach, since their noise counts by that
    /// share.
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

/// The maps of pass 1; those that the plan leaves out are `None`.
#[derive(Debug, Default)]
pub struct PhotonMaps {
    /// All photons on diffuse surfaces.
    pub global: Option<PhotonMap>,
    /// Irradiance precomputed at photons of the global map; `None` for full estimates at every gather ray.
    pub irradiance: Option<IrradianceMap>,
    /// Where indirect light comes from; `None` where directions are drawn from BSDFs alone.
    pub guide: Option<DirectionGuide>,
    /// Irradiance precomputed at photons of the caustic map, for what is seen blurred; `None` for full estimates there too.
    pub caustic_irradiance: Option<IrradianceMap>,
    /// Photons that met only specular surfaces.
    pub caustic: Option<PhotonMap>,
    /// Sums of photons over objects with coordinates; `None` where there are none.
    pub illumination: Option<IlluminationMaps>,
    /// Direct and shadow photons, by light; `None` where every shadow ray is traced.
    pub shadows: Option<ShadowMaps>,
}

impl PhotonMaps {
    /// Bytes of all precomputed irradiance.
    pub fn irradiance_bytes(&self) -> u64 {
        let of = |map: &Option<IrradianceMap>| map.as_ref().map_or(0, IrradianceMap::memory_bytes);
        (of(&self.irradiance) + of(&self.caustic_irradiance)) as u64
    }
}

/// Photons of a caustic estimate that counts for little in a camera sample.
const LEAST_CAUSTIC_NEAREST: u32 = 32;

/// How far from a point its precomputed caustics are read, as a share of the radius of its estimate. Points lie at every fourth
/// photon, so that where there are as many as an estimate wants nearly all places are nearer than a third; few photons spread
/// their light over most of the radius anyway.
pub const CAUSTIC_POINT_REACH: f32 = 0.5;

/// Share of a camera sample up to which caustics are read at points.
const LARGEST_SHARE_NEARBY: f32 = 0.5;

/// Caustics fainter than this, as a share of the other light of the camera sample, are estimated over the whole disc: what
/// cannot be seen from its centre changes them by less than any eye sees.
const FAINT_CAUSTICS: f32 = 0.005;

/// The same as a share of the light at one surface, however little of that arrives.
const FAINTEST_HERE: f32 = 0.1;

/// Pass 2.
#[derive(Debug)]
pub struct PhotonMapIntegrator<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    settings: PhotonMapSettings,
    direct: DirectLighting<'a>,
    bsdf_sampling: bool,
    camera_medium: MediumStack,
    cache: Option<IrradianceCache>,
}

/// A surface with a diffuse or a highly glossy lobe that is computed accurately.
struct Vertex<'a> {
    hit: &'a SurfaceInteraction,
    shading: &'a Shading,
    medium: MediumStack,
    /// Share of the camera sample that arrives here: scales the number of gather rays.
    share: f32,
    /// What light from here is multiplied by on its way to the eye, brightest channel.
    weight: f32,
    /// Segments from the eye to here.
    depth: u32,
    /// Way from the eye to here.
    travelled: f32,
}

impl<'a> PhotonMapIntegrator<'a> {
    /// Reads `maps` for pictures of `scene` from a camera in `camera_medium`.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        plan: &RenderPlan,
        settings: PhotonMapSettings,
        camera_medium: MediumStack,
    ) -> Self {
        let bsdf_sampling = plan.bsdf_sampling.build;
        let direct = DirectLighting::new(scene, settings.light_samples, bsdf_sampling)
            .with_shadows(maps.shadows.as_ref());
        Self { scene, maps, settings, direct, bsdf_sampling, camera_medium, cache: None }
    }

    /// How gather rays are drawn at a vertex.
    fn directions<'v>(&'v self, vertex: &Vertex<'v>, scratch: &mut Scratch) -> Directions<'v> {
        Directions::new(self.maps.guide.as_ref(), vertex.hit, vertex.shading, &mut scratch.counters)
    }

    /// Radiance of caustics up to which their visibility is not asked for, where `other` light leaves a vertex.
    fn faint_caustics(vertex: &Vertex<'_>, other: Rgb) -> f32 {
        (FAINT_CAUSTICS / vertex.share.max(FAINT_CAUSTICS)).min(FAINTEST_HERE) * (other.element_sum() / 3.0)
    }

    /// Third integral: the caustic map, shown directly, beside `other` light that leaves the vertex. And by how much that is
    /// expected to be off, in rounds of progressive rendering.
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

    /// The same behind a diffuse reflection.
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
        // Feelers would cost more than all else, and the radius is small.
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

    /// Caustics as the nearest point says where they are precomputed; `None` where none is near enough.
    fn caustics_nearby(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> Option<Rgb> {
        let points = self.maps.caustic_irradiance.as_ref().filter(|_| self.settings.narrowing.is_none())?;
        let lambert = vertex.shading.bsdf.lambertian()?;
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let connects = |place, facing| self.scene.connects(vertex.hit, place, facing);
        let map = self.maps.caustic.as_ref()?;
        // No point answers farther away than this: a place far from all of its own side would else look at all around it.
        let widest = self.settings.caustic_query(map, position, normal, 1.0).max_radius;
        let largest = CAUSTIC_POINT_REACH * widest.min(self.settings.max_radius);
        let irradiance = points.near(position, normal, largest, connects)?;
        scratch.counters.caustic_nearby += 1;
        Some(lambert.reflectance * irradiance * FRAC_1_PI)
    }

    /// [`Self::caustics`] for a surface that the eye sees: an estimate that blurs over the pixel is made once for its camera
    /// samples. Not for what gather rays meet, which are other places in each sample.
    fn shared_caustics(&self, vertex: &Vertex<'_>, other: Rgb, scratch: &mut Scratch) -> (Rgb, Rgb) {
        let reuse = self.settings.caustic_reuse;
        let shares = reuse > 0.0 && self.settings.narrowing.is_none();
        let lambert = vertex.shading.bsdf.lambertian().filter(|_| shares);
        let (Some(map), Some(lambert)) = (&self.maps.caustic, lambert) else {
            return self.caustics(vertex, other, scratch);
        };
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
            // What stands nearer separates places that the estimate tells apart.
            scratch.remembered.note(position, normal, seen.min(reuse * estimate.radius), estimate.value);
            estimate.value
        });
        (lambert.reflectance * irradiance * FRAC_1_PI, Rgb::ZERO)
    }

    /// Radiance that a Lambertian surface reflects of the light that `read` finds in its illumination map; `None` where it has
    /// none.
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

    /// All integrals at a surface that is not ideal specular, but for what highly glossy lobes find by their own rays.
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
            // Of what the eye sees itself without indirect light, so that an irradiance cache changes that alone.
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
        };
        walk_specular(walk, ray, self.camera_medium, samples, scratch, &mut {
            |vertex: &Vertex<'_>, samples: &mut SampleStream, scratch: &mut Scratch| {
                self.shade(vertex, samples, scratch)
            }
        })
    }
}
