//! Final gathering, the fourth integral: gather rays read the photon maps where they land.

use super::lookup::{reflected_estimate, reflected_from_atlas};
use super::{PhotonMapIntegrator, Vertex};
use crate::bricks::IrradianceAtlas;
use crate::integrators::specular::chain_roulette;
use crate::integrators::{Directions, Scratch};
use crate::lights::{LightId, Receiver as LightReceiver};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::photons::IlluminationMaps;
use crate::sampling::{SampleStream, mix};
use crate::scene::{Shading, SurfaceInteraction};
use crate::spectra::{Line, at_line};
use crate::transport::{
    Arrival, Clearance, Collision, Event, MisPartner, emitted, escaped, next_event, receiver, walk_in_media,
};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Number of diffuse reflections after the first one up to which close surfaces are still computed accurately.
const CLOSE_RECURSIONS: u32 = 2;

/// Number of diffuse reflections after the first one up to which sampling still replaces an estimate from too few photons.
const POOR_RECURSIONS: u32 = 32;

/// Number of diffuse reflections after the first one that are followed without Russian roulette, if they are the first surface of a
/// gather ray.
const SURE_RECURSIONS: u32 = 2;

/// Smallest survival probability of that roulette.
const LEAST_SURVIVAL: f32 = 1e-3;

/// Largest albedo that the estimate of a bias assumes.
const LARGEST_ALBEDO: f32 = 0.9;

/// Numbers that identify decisions when a gather ray's random number is hashed. `LANDINGS` minus the depth identifies the surface at
/// that depth. The numbers `4 * depth + i` are far below these.
const MAP_OR_NOT: u32 = u32::MAX;
const GO_ON_OR_NOT: u32 = u32::MAX - 1;
const LANDINGS: u32 = u32::MAX - 2;
const COMPARE_OR_NOT: u32 = 1 << 31;
const WAVELENGTH: u32 = (1 << 31) + 1;
/// Plus the depth: the flight through media to the surface at that depth.
const FLIGHTS: u32 = 1 << 30;

/// Share of the comparable gather rays that are compared with the map, in rounds of progressive rendering. Each comparison costs one
/// lookup; all of them together cost 6 % of the time in a scene that is lit by little but indirect light.
const COMPARED_SHARE: f32 = 0.5;

/// An estimate from fewer photons than this is poor.
const POOR_PHOTONS: u32 = 8;

/// If no irradiance was precomputed within this share of the largest radius, an estimate would about reach that radius. One precomputed
/// point represents several photons, so that some twenty photons are expected within the radius of an estimate.
const POOR_REACH: f32 = 0.25;

/// Gathered indirect radiance, gathered emitted radiance, and the expected bias of the first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gain {
    pub(super) indirect: Rgb,
    pub(super) direct: Rgb,
    pub(super) bias: Rgb,
}

/// Result of one gather ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gathered {
    pub(super) indirect: Rgb,
    pub(super) direct: Rgb,
    /// Expected bias of `indirect`, in rounds of progressive rendering.
    pub(super) bias: Rgb,
    /// Distance of the first surface; infinite where the ray hits none.
    pub(super) nearest: f32,
    /// Length of the whole path of the ray.
    pub(super) distance: f32,
}

impl Gathered {
    /// What the light of an emitter counts as that the ray hits with its segment number `depth`.
    fn part(&mut self, depth: u32) -> &mut Rgb {
        if depth == 0 { &mut self.direct } else { &mut self.indirect }
    }
}

/// Initial state of a gather ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start<'a> {
    pub(super) ray: Ray,
    pub(super) medium: MediumStack,
    /// Where the ray starts and the density of its direction; `None` where the emission of surfaces that the ray hits is not needed.
    pub(super) partner: Option<MisPartner>,
    /// The collision at which the ray starts, and the throughput at the start of its stretch; `None` where it starts at a surface.
    pub(super) collided: Option<(&'a Collision<'a>, Rgb)>,
    /// Whether the light reflected by surfaces that the ray hits is needed.
    pub(super) indirect: bool,
    /// Number of diffuse reflections before the one at which the ray starts.
    pub(super) recursion: u32,
    /// Factor on the light on its way to the eye, brightest channel.
    pub(super) weight: f32,
    /// Number of segments from the eye to the start of the ray.
    pub(super) depth: u32,
    /// Path length from the eye to the start of the ray.
    pub(super) travelled: f32,
    /// Width of the ray's cone over its length ([`cone_of`]).
    pub(super) cone: f32,
}

/// Rays that a cone counts at least. Fewer rays from one place do not mean that wider averages will do: those of all samples of a pixel, and of
/// its neighbours, are averaged.
const LEAST_RAYS: u32 = 256;

/// Least density of the directions of gather rays, per steradian, that widens a cone: that of a cosine of 0.1.
const LEAST_DENSITY: f32 = 0.1 * FRAC_1_PI;

/// Width of the cone of a gather ray over its length. Each of `rays` rays stands for the solid angle 1 / (rays pdf), where `pdf` is the density of
/// its direction per steradian; a cone of that solid angle has the diameter 2 sqrt(1 / (pi rays pdf)) at distance 1.
pub(super) fn cone_of(rays: u32, pdf: f32) -> f32 {
    let rays = rays.max(LEAST_RAYS) as f32;
    2.0 * (FRAC_1_PI / (rays * pdf.max(LEAST_DENSITY))).sqrt()
}

/// A surface at which a gather ray landed.
struct Landed<'a> {
    vertex: Vertex<'a>,
    /// Length of the last segment of the ray.
    distance: f32,
    /// Number of diffuse reflections before this one, without the one at which the first gather ray starts.
    recursion: u32,
    /// Probability with which sampling continues from here where the map is not read.
    survival: f32,
}

/// Probability with which recursive sampling continues from the diffuse lobe of a surface. `passed` is the factor by which the gather
/// ray attenuates light that leaves the surface.
///
/// A gather ray meets several such surfaces where they also have glossy lobes. The probability is proportional to what arrives from each
/// of them, so that fewer than one ray in total follows them, because albedos are below one. The recursion therefore ends, even in the
/// crevices of a polished flake.
fn survival_of_recursion(passed: f32, shading: &Shading) -> f32 {
    let [diffuse, ..] = shading.bsdf.lobe_weights(shading.wo_local);
    let survival = passed * diffuse;
    if survival.is_nan() { 1.0 } else { survival.clamp(LEAST_SURVIVAL, 1.0) }
}

impl PhotonMapIntegrator<'_> {
    /// The fourth integral: light that was reflected diffusely before, either interpolated in the irradiance cache or gathered by rays
    /// that read the global map. Also returns the light of emitters that those rays hit, which belongs to the first integral.
    pub(super) fn indirect(
        &self,
        vertex: &Vertex<'_>,
        directions: &Directions<'_>,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Gain {
        let has_source =
            self.maps.global.is_some() || self.maps.atlas.is_some() || self.maps.radiosity.is_some();
        if !(has_source || self.bsdf_sampling) {
            return Gain::default();
        }
        let count = ((self.settings.gather_samples as f32 * vertex.share).ceil() as u32).max(1);
        // Reserved even where they are not needed, so that the cache changes no other random number of the camera sample.
        let splits = samples.splits(self.settings.gather_samples);
        let cached = self.patches_shown(vertex).or_else(|| self.cached(vertex, scratch));
        if let (Some(indirect), false) = (cached, self.bsdf_sampling) {
            return Gain { indirect, ..Gain::default() };
        }
        let points = (0..count).map(|i| splits.get_4d(i));
        let gathered = self.gather_from(vertex, directions, points, (cached.is_none(), 0), scratch);
        Gain { indirect: cached.unwrap_or(gathered.indirect), ..gathered }
    }

    /// Mean over gather rays sampled with these random numbers: reflected light that arrives, if it is `wanted`, and light of emitters.
    fn gather_from(
        &self,
        vertex: &Vertex<'_>,
        directions: &Directions<'_>,
        points: impl ExactSizeIterator<Item = [f32; 4]>,
        (wanted, recursion): (bool, u32),
        scratch: &mut Scratch,
    ) -> Gain {
        let mut gain = Gain::default();
        let count = points.len();
        for [x, y, u_lobe, u_path] in points {
            let Some(sample) = directions.sample_diffuse(u_lobe, glam::Vec2::new(x, y)) else { continue };
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
            let start = Start {
                ray: vertex.hit.spawn(direction),
                medium,
                partner: self.bsdf_sampling.then(|| MisPartner {
                    from: receiver(self.scene, vertex.hit),
                    pdf: sample.pdf_solid_angle,
                }),
                collided: None,
                indirect: wanted,
                recursion,
                weight: vertex.weight * sample.throughput.max_element(),
                depth: vertex.depth,
                travelled: vertex.travelled,
                cone: cone_of(count as u32, sample.pdf_solid_angle),
            };
            let found = self.gather(&start, u_path, scratch);
            gain.indirect += sample.throughput * found.indirect;
            gain.direct += sample.throughput * found.direct;
            gain.bias += sample.throughput * found.bias;
        }
        let count = count as f32;
        Gain { indirect: gain.indirect / count, direct: gain.direct / count, bias: gain.bias / count }
    }

    /// Radiance that arrives along a gather ray.
    pub(super) fn gather(&self, start: &Start<'_>, mut u: f32, scratch: &mut Scratch) -> Gathered {
        let Start { mut ray, mut medium, .. } = *start;
        let mut throughput = Rgb::ONE;
        let mut line: Option<Line> = None;
        let mut found = Gathered {
            indirect: Rgb::ZERO,
            direct: Rgb::ZERO,
            bias: Rgb::ZERO,
            nearest: f32::INFINITY,
            distance: 0.0,
        };
        scratch.counters.gather_rays += 1;
        let own = u;
        // Where the path first collided in the present medium.
        let mut walk = start.collided.map(|(collision, _)| collision.position);
        let mut clearance = Clearance::default();
        let mut next_partner = start.partner;
        for depth in 0..self.settings.max_depth {
            scratch.counters.depth_sum += 1;
            // Lights were sampled where this segment starts, if it is the first one or comes from a collision.
            let partner = next_partner.take();
            let event = if self.scene.scatters() {
                let u = refreshed(own, FLIGHTS + depth);
                let weights = line.map_or(throughput, Line::primaries);
                let passage =
                    walk_in_media(self.scene, &ray, &mut medium, (weights, u), &mut clearance, |_| ());
                throughput *= at_line(line, passage.weight);
                passage.event
            } else {
                next_event(self.scene, &ray, &mut medium)
            };
            let arrival = match event {
                Event::Surface(arrival) => arrival,
                Event::Medium(collision) => {
                    // A medium has no distance that limits how far the light found here may be interpolated.
                    found.distance = f32::INFINITY;
                    if !start.indirect {
                        return found;
                    }
                    let first = *walk.get_or_insert(collision.position);
                    let mut samples = SampleStream::new(key_of(collision.position, own), depth.into(), 0);
                    let way = (-ray.direction, first);
                    let (scattered, is_all) = self.scattered_at(&collision, way, &mut samples, scratch);
                    found.indirect += throughput * at_line(line, scattered);
                    if is_all {
                        return found;
                    }
                    let survival = throughput.abs().max_element().clamp(LEAST_SURVIVAL, 1.0);
                    if samples.next_1d() >= survival {
                        return found;
                    }
                    throughput /= survival;
                    let sample = collision.phase.sample(-ray.direction, samples.next_2d());
                    ray = Ray::new(collision.position, sample.wi);
                    let from = LightReceiver { position: collision.position, normal: Vec3::ZERO };
                    next_partner = Some(MisPartner { from, pdf: sample.pdf });
                    continue;
                }
                Event::Escape => {
                    if let Some(partner) = partner {
                        let partner = self.against_light(start, depth, partner, None);
                        let escaped = escaped(self.scene, ray.direction, Some(partner), |_| 1.0);
                        *found.part(depth) += throughput * at_line(line, escaped);
                    }
                    found.distance = f32::INFINITY;
                    return found;
                }
            };
            if let Some(transmittance) = arrival.transmittance {
                throughput *= at_line(line, transmittance);
            }
            let Arrival { hit, passed_null_interface, .. } = arrival;
            found.distance += hit.distance;
            // Light that passes a null interface is counted as a caustic.
            if let Some(partner) = partner.filter(|_| !passed_null_interface)
                && let Some(id) = self.scene.surface(&hit).light
            {
                let partner = self.against_light(start, depth, partner, Some(id));
                let emitted = emitted(self.scene, &hit, Some(partner), |_| 1.0);
                *found.part(depth) += throughput * at_line(line, emitted);
            }
            walk = None;
            if depth == 0 {
                found.nearest = hit.distance;
                if !start.indirect {
                    return found;
                }
            }
            let mut shading = self.scene.shading_for(&hit, medium, line);
            if shading.disperses && line.is_none() {
                // A gather ray is one of many, so that also light that is reflected may take a wavelength.
                line = Line::choose(self.settings.wavelengths, refreshed(own, WAVELENGTH));
                if let Some(line) = line {
                    throughput = line.taken_by(throughput);
                    shading = self.scene.shading_for(&hit, medium, Some(line));
                }
            }
            if !shading.bsdf.is_delta() {
                let segments = start.depth + depth + 1;
                scratch.counters.gather_paths += 1;
                scratch.counters.gather_path_segments += u64::from(segments);
                let landing = Vertex {
                    hit: &hit,
                    shading: &shading,
                    medium,
                    share: 0.0,
                    weight: start.weight * throughput.abs().max_element(),
                    depth: segments,
                    travelled: start.travelled + found.distance,
                    width: start.cone * found.distance,
                };
                let passed = throughput.abs().max_element();
                let survival = if depth == 0 && start.recursion < SURE_RECURSIONS {
                    1.0
                } else {
                    survival_of_recursion(passed, &shading)
                };
                let landed =
                    Landed { vertex: landing, distance: hit.distance, recursion: start.recursion, survival };
                // Each surface of a specular chain makes its own decision.
                let u = if depth == 0 { u } else { refreshed(own, LANDINGS - depth) };
                let (leaving, bias) = self.leaving(&landed, u, scratch);
                found.indirect += throughput * at_line(line, leaving);
                found.bias += throughput * at_line(line, bias);
                if !(shading.bsdf.has_glossy() || shading.bsdf.has_specular()) {
                    return found;
                }
                let numbers = std::array::from_fn(|i| refreshed(own, 4 * depth + i as u32));
                let Some(next) = self.continue_gathering((medium, depth == 0), &hit, &shading, numbers)
                else {
                    return found;
                };
                scratch.counters.approximate_rays += 1;
                throughput *= at_line(line, next.throughput);
                (medium, ray) = (next.medium, next.ray);
                continue;
            }
            // At a specular surface one direction is sampled with the Fresnel term as probability. One random number serves the whole
            // chain, because its remainder after a decision is uniform again.
            let Some(weight) = chain_roulette(depth, || refreshed(u, depth)) else { return found };
            let probability = shading.bsdf.reflection_probability(shading.wo_local);
            let Some(sample) = shading.sample(u, glam::Vec2::ZERO) else { return found };
            u = if u < probability { u / probability } else { (u - probability) / (1.0 - probability) };
            u = u.clamp(0.0, crate::sampling::ONE_MINUS_EPSILON);
            throughput *= weight;
            let direction = shading.frame.to_world(sample.wi);
            let Some(next) = self.scene.medium_after(medium, &hit, &shading, direction, sample.transmission)
            else {
                return found;
            };
            medium = next;
            throughput *= at_line(line, sample.throughput);
            scratch.counters.approximate_rays += 1;
            ray = hit.spawn(direction);
        }
        scratch.counters.truncated += 1;
        found
    }

    /// The density of the direction of a segment against which light sampling is weighted for the light `id`; `None` for light from
    /// infinity. At the collision where the ray starts, light sampling chose the distance as well.
    fn against_light(
        &self,
        start: &Start<'_>,
        depth: u32,
        partner: MisPartner,
        id: Option<LightId>,
    ) -> MisPartner {
        match start.collided {
            Some((collision, throughput)) if depth == 0 => {
                let factor = self.direct.density_of_collision(collision, throughput, id);
                MisPartner { pdf: partner.pdf * factor, ..partner }
            }
            _ => partner,
        }
    }

    /// Radiance that leaves a surface on which a gather ray ends (Jensen 1996, sections 4 to 4.4). It is read from the global map,
    /// unless the surface is so close that the blur of the map would show (corners), or there are too few photons. Only the diffuse lobe
    /// is covered; highly glossy lobes are sampled even here, see [`Self::continue_gathering`]. The second value is the expected bias,
    /// in rounds of progressive rendering.
    fn leaving(&self, landed: &Landed<'_>, u: f32, scratch: &mut Scratch) -> (Rgb, Rgb) {
        if !landed.vertex.shading.bsdf.has_diffuse() || !self.has_photons() {
            return (Rgb::ZERO, Rgb::ZERO);
        }
        if let Some(narrowing) = self.settings.narrowing
            && refreshed(u, MAP_OR_NOT) >= narrowing.read_share
        {
            return self.compared(narrowing.read_share, landed, u, scratch);
        }
        (self.mostly_approximate(landed, u, scratch), Rgb::ZERO)
    }

    /// [`Self::leaving`] outside of progressive rendering.
    fn mostly_approximate(&self, landed: &Landed<'_>, u: f32, scratch: &mut Scratch) -> Rgb {
        let Vertex { hit, shading, .. } = landed.vertex;
        if self.is_too_close(landed) {
            scratch.counters.accurate_close += 1;
            return self.accurate(landed, u, scratch);
        }
        if let Some(radiance) = self.approximate(&landed.vertex, u, scratch) {
            scratch.counters.approximate_diffuse += 1;
            return radiance;
        }
        scratch.counters.empty_lookups += 1;
        if landed.recursion < POOR_RECURSIONS {
            scratch.counters.accurate_poor += 1;
            return self.accurate(landed, u, scratch);
        }
        scratch.counters.approximate_poor += 1;
        self.poor_estimate(hit, shading, scratch)
    }

    /// Whether the maps hold indirect light. An empty map causes a warning, and nothing replaces it.
    pub(super) fn has_photons(&self) -> bool {
        let is_lit = self.maps.illumination.as_ref().is_some_and(|maps| maps.sizes().photons > 0);
        is_lit
            || self.maps.atlas.is_some()
            || self.maps.radiosity.is_some()
            || self.maps.global.as_ref().is_some_and(|map| !map.is_empty())
    }

    /// Whether a surface is so close that the blur of the map would show, and its weight is large enough to matter.
    fn is_too_close(&self, landed: &Landed<'_>) -> bool {
        landed.distance < self.settings.accurate_distance
            && landed.recursion < CLOSE_RECURSIONS
            && landed.vertex.weight >= self.settings.approximate_weight
    }

    /// The four integrals in the case that the map, which is read with probability `read_share`, is not read. Also estimates the bias
    /// that reading the map adds to the mean of both cases.
    ///
    /// Let b be the bias of the map, a the bias of the value returned here, and q = `read_share`. The recursion also reads the map with
    /// probability q, so that a = albedo (q b + (1 - q) a). The mean is then off by q b + (1 - q) a = q (b - a) / (1 - albedo), and b -
    /// a is the difference of the two values.
    fn compared(&self, read_share: f32, landed: &Landed<'_>, u: f32, scratch: &mut Scratch) -> (Rgb, Rgb) {
        let shading = landed.vertex.shading;
        scratch.counters.accurate_drawn += 1;
        let radiance = self.accurate(landed, u, scratch);
        // Where the map is not read in either case, it adds no bias.
        if landed.recursion > 0 || self.is_too_close(landed) {
            return (radiance, Rgb::ZERO);
        }
        if refreshed(u, COMPARE_OR_NOT) >= COMPARED_SHARE {
            return (radiance, Rgb::ZERO);
        }
        let Some(read) = self.approximate(&landed.vertex, u, scratch) else {
            return (radiance, Rgb::ZERO);
        };
        let albedo = shading.bsdf.albedo(shading.wo_local).max_element();
        let ways_on = 1.0 / (1.0 - albedo.min(LARGEST_ALBEDO));
        // Each such difference represents all gather rays; this one was selected with this probability.
        let drawn = (1.0 - read_share) * COMPARED_SHARE;
        (radiance, (read - radiance) * (read_share * ways_on / drawn))
    }

    /// The four integrals behind a diffuse reflection, with one gather ray: recursive sampling that ends by Russian roulette.
    fn accurate(&self, landed: &Landed<'_>, u: f32, scratch: &mut Scratch) -> Rgb {
        let Landed { vertex: at, recursion, survival, .. } = landed;
        if *survival < 1.0 && refreshed(u, GO_ON_OR_NOT) >= *survival {
            return Rgb::ZERO;
        }
        let mut samples = SampleStream::new(key_of(at.hit.point.position, u), u64::from(*recursion), 0);
        let directions = self.directions(at, scratch);
        let direct = self.direct.radiance(at.hit, &directions, at.medium, &mut samples, scratch);
        let point = [samples.splits(1).get_4d(0)].into_iter();
        let gathered = self.gather_from(at, &directions, point, (true, recursion + 1), scratch);
        let other = direct.diffuse + gathered.direct + gathered.indirect;
        (other + self.caustics_behind(at, other, scratch)) / *survival
    }

    /// Radiance of a diffuse surface read from the global map; `None` where the estimate rests on too few photons. If lights are sampled
    /// too, the random numbers are derived from the position and `u`.
    pub(super) fn approximate(&self, at: &Vertex<'_>, u: f32, scratch: &mut Scratch) -> Option<Rgb> {
        let Vertex { hit, shading, .. } = *at;
        if let Some(radiance) = self.patches_behind(at) {
            return Some(radiance);
        }
        if let Some(radiance) = self.summed_up(hit, shading, IlluminationMaps::all, scratch) {
            return Some(radiance);
        }
        if let Some(atlas) = &self.maps.atlas {
            return self.read_atlas(atlas, at, scratch);
        }
        let map = self.maps.global.as_ref().filter(|map| !map.is_empty())?;
        scratch.counters.global_lookups += 1;
        let largest = self.settings.max_radius;
        if let (Some(irradiance), Some(lambert)) = (&self.maps.irradiance, shading.bsdf.lambertian()) {
            let connects = |place, facing| self.scene.connects(hit, place, facing);
            let (position, normal) = (hit.point.position, hit.facing_normal());
            // A point farther away than the origin of the ray belongs to another part of the scene.
            let reach = (POOR_REACH * largest).min(hit.distance);
            let found = irradiance.nearest((position, normal), (reach, hit.distance), connects)?;
            let reflected = lambert.reflectance * found.irradiance * FRAC_1_PI;
            return Some(if found.lacks_direct {
                reflected + self.direct_at(at, u, scratch)
            } else {
                reflected
            });
        }
        let query = self.settings.global_query(hit.point.position, hit.facing_normal());
        let what = (map, &query, &self.settings.global);
        let estimate = reflected_estimate(self.scene, &self.settings, what, shading, scratch);
        let is_rich = estimate.radius < largest && estimate.photons >= POOR_PHOTONS && estimate.is_local;
        is_rich.then_some(estimate.value)
    }

    /// Radiance that the diffuse lobe of a surface reflects of the irradiance in its brick map; `None` where that holds nothing near. Voxels
    /// are as wide as a share of the ray's cone there ([`PhotonMapSettings::atlas_footprint`]).
    fn read_atlas(&self, atlas: &IrradianceAtlas, at: &Vertex<'_>, scratch: &mut Scratch) -> Option<Rgb> {
        reflected_from_atlas(atlas, (at.hit, at.shading), self.settings.atlas_footprint * at.width, scratch)
    }

    /// Radiance of direct light that the diffuse lobe of a surface reflects.
    fn direct_at(&self, at: &Vertex<'_>, u: f32, scratch: &mut Scratch) -> Rgb {
        let mut samples = SampleStream::new(key_of(at.hit.point.position, u), 0, 0);
        let directions = Directions::of_bsdf(at.shading);
        self.direct.radiance(at.hit, &directions, at.medium, &mut samples, scratch).diffuse
    }

    /// Estimate from the map, however few photons it rests on.
    fn poor_estimate(&self, hit: &SurfaceInteraction, shading: &Shading, scratch: &mut Scratch) -> Rgb {
        let Some(map) = &self.maps.global else { return Rgb::ZERO };
        let query = self.settings.global_query(hit.point.position, hit.facing_normal());
        let what = (map, &query, &self.settings.global);
        reflected_estimate(self.scene, &self.settings, what, shading, scratch).value
    }
}

/// Seed of the random numbers at a point where a gather ray with the random number `u` ends.
fn key_of(p: Vec3, u: f32) -> u64 {
    let bits = |a: f32, b: f32| u64::from(a.to_bits()) << 32 | u64::from(b.to_bits());
    mix(mix(bits(p.x, p.y)) ^ bits(p.z, u))
}

/// A new random number for a surface of a chain whose own number is used up: a hash of it, the same in every run.
fn refreshed(u: f32, depth: u32) -> f32 {
    (mix(u64::from(u.to_bits()) << 32 | u64::from(depth)) >> 40) as f32 / 16_777_216.0
}
