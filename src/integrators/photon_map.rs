//! The two-pass method of Jensen 1996: what the camera sees is computed accurately, what lies behind the next diffuse
//! reflection is read from the photon maps.

use super::direct::DirectLighting;
use super::specular::{Branch, chain_roulette, push_children};
use super::{Integrator, Scratch, describe_first_hit};
use crate::bsdf::{Bsdf, TransportMode};
use crate::film::{Aov, PixelSample};
use crate::lights::Light;
use crate::math::{Ray, Rgb};
use crate::media::MediumId;
use crate::photons::{EstimateParams, FEELERS, IrradianceMap, KernelDomain, PhotonMap, Query, SearchRegion};
use crate::sampling::SampleStream;
use crate::scene::{MapKind, RenderPlan, Scene, Shading, SurfaceInteraction};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// How the maps are read.
#[derive(Clone, Copy, Debug)]
pub struct PhotonMapSettings {
    /// Photons in an estimate from the global map.
    pub global_nearest: u32,
    /// Photons in an estimate from the caustic map.
    pub caustic_nearest: u32,
    /// Weights and bias of caustic estimates.
    pub caustic: EstimateParams,
    /// Weights and bias of estimates from the global map.
    pub global: EstimateParams,
    /// Search region.
    pub region: SearchRegion,
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
        Query {
            region: self.region,
            max_radius: self.max_radius,
            ..Query::nearest(position, normal, self.global_nearest as usize)
        }
    }

    /// A query of the caustic map at a place.
    pub fn caustic_query(&self, position: Vec3, normal: Vec3) -> Query {
        Query {
            region: self.region,
            max_radius: self.max_radius,
            ..Query::nearest(position, normal, self.caustic_nearest as usize)
        }
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

    /// Fourth integral: light that was reflected diffusely before, gathered by rays that read the global map.
    fn indirect(&self, vertex: &Vertex<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> (Rgb, Rgb) {
        let (mut indirect, mut direct) = (Rgb::ZERO, Rgb::ZERO);
        if self.maps.global.is_none() && !self.bsdf_sampling {
            return (indirect, direct);
        }
        let count = ((self.settings.gather_samples as f32 * vertex.share).ceil() as u32).max(1);
        let splits = samples.splits(self.settings.gather_samples);
        for i in 0..count {
            let [x, y, u_lobe, u_path] = splits.get_4d(i);
            let Some(sample) = vertex.shading.bsdf.sample(
                vertex.shading.wo_local,
                u_lobe,
                glam::Vec2::new(x, y),
                TransportMode::Radiance,
            ) else {
                continue;
            };
            let direction = vertex.shading.frame.to_world(sample.wi);
            let Some(medium) = self.scene.medium_after(
                vertex.medium,
                vertex.hit,
                vertex.shading,
                direction,
                sample.transmission,
            ) else {
                continue;
            };
            scratch.counters.gather_rays += 1;
            let ray = vertex.hit.spawn(direction);
            let found = self.gather(vertex, ray, medium, sample.pdf_solid_angle, u_path, scratch);
            indirect += sample.throughput * found.indirect;
            direct += sample.throughput * found.direct;
        }
        (indirect / count as f32, direct / count as f32)
    }

    /// Radiance that arrives along a gather ray.
    fn gather(
        &self,
        vertex: &Vertex<'_>,
        mut ray: Ray,
        mut medium: MediumId,
        pdf: f32,
        mut u: f32,
        scratch: &mut Scratch,
    ) -> Gathered {
        let mut throughput = Rgb::ONE;
        let mut found = Gathered::default();
        for depth in 0..self.settings.max_depth {
            scratch.counters.depth_sum += 1;
            let Some(hit) = self.scene.intersect(&ray) else {
                if depth == 0 && self.bsdf_sampling {
                    found.direct = self.environment_by_bsdf(pdf);
                }
                return found;
            };
            throughput *= self.transmittance(medium, hit.distance);
            if depth == 0 && self.bsdf_sampling {
                found.direct = throughput * self.emitted_by_bsdf(vertex, &hit, pdf);
            }
            let shading = hit.shading(self.scene.material(&hit));
            if !shading.bsdf.is_delta() {
                found.indirect = throughput * self.approximate(&hit, &shading, scratch);
                return found;
            }
            // A specular surface on the way: one of its directions, drawn by the Fresnel term. One number serves the
            // whole chain: what a decision leaves of it is uniform again.
            let Some(weight) = chain_roulette(depth, || refreshed(u, depth)) else { return found };
            let probability = shading.bsdf.reflection_probability(shading.wo_local);
            let Some(sample) =
                shading.bsdf.sample(shading.wo_local, u, glam::Vec2::ZERO, TransportMode::Radiance)
            else {
                return found;
            };
            u = if u < probability { u / probability } else { (u - probability) / (1.0 - probability) };
            u = u.clamp(0.0, crate::sampling::ONE_MINUS_EPSILON);
            throughput *= weight;
            let direction = shading.frame.to_world(sample.wi);
            let Some(next) = self.scene.medium_after(medium, &hit, &shading, direction, sample.transmission)
            else {
                return found;
            };
            medium = next;
            throughput *= sample.throughput;
            ray = hit.spawn(direction);
        }
        scratch.counters.truncated += 1;
        found
    }

    /// Radiance of a diffuse surface read from the global map.
    fn approximate(&self, hit: &SurfaceInteraction, shading: &Shading, scratch: &mut Scratch) -> Rgb {
        let Some(map) = &self.maps.global else { return Rgb::ZERO };
        if !shading.bsdf.has_diffuse() {
            return Rgb::ZERO;
        }
        scratch.counters.global_lookups += 1;
        if let (Some(irradiance), Bsdf::Lambert(lambert)) = (&self.maps.irradiance, shading.bsdf) {
            let found = irradiance.nearest(hit.point.position, hit.facing_normal(), self.settings.max_radius);
            return match found {
                Some(irradiance) => lambert.reflectance * irradiance * FRAC_1_PI,
                None => {
                    scratch.counters.empty_lookups += 1;
                    Rgb::ZERO
                }
            };
        }
        let query = self.settings.global_query(hit.point.position, hit.facing_normal());
        reflected(self.scene, &self.settings, (map, &query, &self.settings.global), shading, scratch)
    }

    /// Light of an emitter that a gather ray hit by chance, weighted against light sampling.
    fn emitted_by_bsdf(&self, vertex: &Vertex<'_>, hit: &SurfaceInteraction, pdf: f32) -> Rgb {
        let Some(id) = self.scene.surface(hit).light else { return Rgb::ZERO };
        let Light::Area(area) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        let from = vertex.hit.point.position;
        let other = area.pdf_solid_angle(from, hit.primitive, hit.point.position)
            * self.direct.choice_probability(id);
        area.emitted(hit.is_front()) * super::direct::power_heuristic(pdf, other)
    }

    fn environment_by_bsdf(&self, pdf: f32) -> Rgb {
        let Some(id) = self.scene.environment() else { return Rgb::ZERO };
        let Light::Environment(environment) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        let other = self.direct.choice_probability(id) / (4.0 * std::f32::consts::PI);
        environment.radiance * super::direct::power_heuristic(pdf, other)
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

/// Another number for a deep surface of a chain whose own number is used up: a hash of it, the same in every run.
fn refreshed(u: f32, depth: u32) -> f32 {
    (crate::sampling::mix(u64::from(u.to_bits()) << 32 | u64::from(depth)) >> 40) as f32 / 16_777_216.0
}

/// What a gather ray brought.
#[derive(Clone, Copy, Debug, Default)]
struct Gathered {
    indirect: Rgb,
    direct: Rgb,
}

/// Radiance that a surface reflects of the photons in a map.
fn reflected(
    scene: &Scene,
    reading: &PhotonMapSettings,
    (map, query, params): (&PhotonMap, &Query, &EstimateParams),
    shading: &Shading,
    scratch: &mut Scratch,
) -> Rgb {
    let Scratch { photons, counters, .. } = scratch;
    let domain = |radius| {
        if !reading.visible_kernel {
            return None;
        }
        counters.feelers += FEELERS as u64;
        visible_domain(scene, query.position, query.normal, radius)
    };
    // Photons hold the cosine to the shading normal where there is one, see `photons::trace`.
    if let Bsdf::Lambert(lambert) = shading.bsdf {
        let irradiance = map.estimate_irradiance_visible(query, params, photons, domain).value;
        return lambert.reflectance * irradiance * FRAC_1_PI;
    }
    let wo = shading.wo_local;
    let f = |wi: Vec3| shading.bsdf.eval(wo, shading.frame.to_local(wi));
    map.estimate_radiance_visible(query, params, photons, domain, f).value
}

/// The part of the disc of `radius` around a point that can be seen from its centre.
pub fn visible_domain(scene: &Scene, position: Vec3, normal: Vec3, radius: f32) -> Option<KernelDomain> {
    KernelDomain::feel(normal, radius, |tangent| scene.surface_reach(position, normal, tangent, radius))
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

/// Shows one map at the first diffuse surface seen directly or through specular ones (figure 4 of Jensen 1996).
#[derive(Debug)]
pub struct ShowPhotons<'a> {
    scene: &'a Scene,
    maps: &'a PhotonMaps,
    kind: MapKind,
    settings: PhotonMapSettings,
    camera_medium: MediumId,
}

impl<'a> ShowPhotons<'a> {
    /// Shows the map of this kind.
    pub fn new(
        scene: &'a Scene,
        maps: &'a PhotonMaps,
        kind: MapKind,
        settings: PhotonMapSettings,
        camera_medium: MediumId,
    ) -> Self {
        Self { scene, maps, kind, settings, camera_medium }
    }

    fn shade(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> (Aov, Rgb) {
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        let (map, query, params, aov) = match self.kind {
            MapKind::Global => {
                let query = self.settings.global_query(position, normal);
                (&self.maps.global, query, &self.settings.global, Aov::Indirect)
            }
            MapKind::Caustic => {
                let query = self.settings.caustic_query(position, normal);
                (&self.maps.caustic, query, &self.settings.caustic, Aov::Caustics)
            }
        };
        let Some(map) = map else { return (aov, Rgb::ZERO) };
        if !vertex.shading.bsdf.has_diffuse() {
            return (aov, Rgb::ZERO);
        }
        match self.kind {
            MapKind::Global => scratch.counters.global_lookups += 1,
            MapKind::Caustic => scratch.counters.caustic_lookups += 1,
        }
        (aov, reflected(self.scene, &self.settings, (map, &query, params), vertex.shading, scratch))
    }
}

impl Integrator for ShowPhotons<'_> {
    fn li(&self, ray: Ray, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        walk_specular(self.scene, ray, self.camera_medium, self.settings.max_depth, samples, scratch, &mut {
            |vertex: &Vertex<'_>, _: &mut SampleStream, scratch: &mut Scratch| [self.shade(vertex, scratch)]
        })
    }
}

/// Follows a camera ray through specular surfaces and calls `shade` at each diffuse surface it ends on. What is behind a
/// specular surface belongs to the specular part whatever it is.
fn walk_specular<const N: usize>(
    scene: &Scene,
    ray: Ray,
    medium: MediumId,
    max_depth: u32,
    samples: &mut SampleStream,
    scratch: &mut Scratch,
    shade: &mut impl FnMut(&Vertex<'_>, &mut SampleStream, &mut Scratch) -> [(Aov, Rgb); N],
) -> PixelSample {
    let mut out = PixelSample::default();
    scratch.counters.camera_rays += 1;
    let mut branches = std::mem::take(&mut scratch.branches);
    branches.clear();
    branches.push(Branch { ray, throughput: Rgb::ONE, medium, depth: 0, share: 1.0 });
    while let Some(mut branch) = branches.pop() {
        let first = branch.depth == 0;
        let part = |aov: Aov| if first { aov } else { Aov::Specular };
        scratch.counters.depth_sum += 1;
        scratch.counters.specular_rays += u64::from(!first);
        let Some(hit) = scene.intersect(&branch.ray) else {
            if let Some(Light::Environment(sky)) = scene.environment().map(|id| &scene.lights()[id as usize])
            {
                out.add(part(Aov::Emission), branch.throughput * sky.radiance);
            }
            continue;
        };
        if first {
            describe_first_hit(&mut out, scene, &hit);
        }
        let medium = scene.medium(branch.medium);
        if !medium.is_clear() {
            branch.throughput *= medium.transmittance(hit.distance);
        }
        if let Some(Light::Area(area)) = scene.surface(&hit).light.map(|id| &scene.lights()[id as usize]) {
            out.add(part(Aov::Emission), branch.throughput * area.emitted(hit.is_front()));
        }
        let shading = hit.shading(scene.material(&hit));
        if shading.bsdf.is_delta() {
            scratch.counters.interfaces += 1;
            scratch.counters.medium_mismatches += u64::from(scene.is_medium_mismatch(&hit, branch.medium));
            if branch.depth + 1 >= max_depth {
                scratch.counters.truncated += 1;
                continue;
            }
            push_children(&mut branches, &branch, scene, &hit, &shading, samples);
            continue;
        }
        let vertex = Vertex { hit: &hit, shading: &shading, medium: branch.medium, share: branch.share };
        for (aov, radiance) in shade(&vertex, samples, scratch) {
            out.add(part(aov), branch.throughput * radiance);
        }
    }
    scratch.branches = branches;
    out
}
