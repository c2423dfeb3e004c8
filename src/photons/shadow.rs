//! Direct and shadow photons: rays from the lights pass through the whole scene, and photons are stored where light
//! arrives and where it is blocked (Jensen & Christensen 1995; Jensen 1996, section 3).

use super::emission::Emitter;
use super::shadow_decision::{DecisionMap, ShadowDecision};
use super::{Photon, PhotonClass, PhotonMap, Query, Scratch};
use crate::lights::LightId;
use crate::sampling::{Rng, Stream, mix};
use crate::scene::{Crossings, Scene, ShadowMode, SurfaceInteraction};
use rayon::prelude::*;
use std::ops::AddAssign;

/// Photons around a point that `as-printed` uses: ten, as for the shadow hits of illumination maps in section 6 of
/// Jensen & Christensen 1995 (Computers & Graphics); Jensen 1996 states no number.
const NEAREST: usize = 10;

/// Counts of the rays of one light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShadowTally {
    /// Rays traced.
    pub rays: u64,
    /// Rays that crossed nothing.
    pub missed: u64,
    /// Surfaces crossed, an edge between triangles once.
    pub crossings: u64,
    /// Hits at edges or corners that belonged to the same crossing as another hit.
    pub merged: u64,
    /// Crossings beyond the number that is kept for one ray.
    pub dropped: u64,
    /// Direct photons stored.
    pub direct: u64,
    /// Shadow photons stored.
    pub shadow: u64,
}

impl AddAssign for ShadowTally {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.missed += other.missed;
        self.crossings += other.crossings;
        self.merged += other.merged;
        self.dropped += other.dropped;
        self.direct += other.direct;
        self.shadow += other.shadow;
    }
}

/// Photons of one light, in the order of their numbers, and the surface that each lies on.
#[derive(Debug, Default)]
pub struct TracedShadows {
    /// Direct and shadow photons. A shadow photon has the power that would have arrived.
    pub photons: Vec<Photon>,
    /// Index into [`Scene::surfaces`] for each photon.
    pub surfaces: Vec<u32>,
    /// Counts.
    pub tally: ShadowTally,
}

/// Rays that one task traces.
const CHUNK: u64 = 4096;

/// Traces `rays` rays of `light` through the whole scene. A direct photon is stored at the first surface and a shadow
/// photon at each surface behind it, if the surface has a diffuse component on that side. A first surface of glass or
/// metal stores none, but still casts a shadow, since shadow rays are stopped there.
///
/// The result is the same for any number of threads.
pub fn trace_shadow_photons(scene: &Scene, light: LightId, rays: u64, seed: u64) -> TracedShadows {
    let chunks: Vec<TracedShadows> = (0..rays.div_ceil(CHUNK))
        .into_par_iter()
        .map_init(Crossings::default, |crossings, chunk| {
            let first = chunk * CHUNK;
            trace_range(scene, light, (first, rays.min(first + CHUNK)), seed, crossings)
        })
        .collect();
    let mut all = TracedShadows::default();
    for chunk in chunks {
        all.photons.extend(chunk.photons);
        all.surfaces.extend(chunk.surfaces);
        all.tally += chunk.tally;
    }
    all
}

fn trace_range(
    scene: &Scene,
    light: LightId,
    (first, end): (u64, u64),
    seed: u64,
    crossings: &mut Crossings,
) -> TracedShadows {
    let mut found = TracedShadows::default();
    if light as usize >= scene.lights().len() {
        return found;
    }
    // The photons are not aimed: decisions count photons, which must represent all of the light equally.
    let emitter = Emitter::unaimed(scene, light as usize);
    let seed = mix(seed ^ mix(u64::from(light)));
    for index in first..end {
        found.tally.rays += 1;
        // Independent random numbers rather than Sobol' points: the confidence of decisions assumes independent
        // samples.
        let mut rng = Rng::new(seed, Stream::ShadowPhotons, index);
        let (place, heading) = (rng.next_2d(), rng.next_2d());
        let u = [place.x, place.y, heading.x, heading.y];
        let Some(start) = emitter.emit(u) else { continue };
        scene.intersect_all(&start.ray, crossings);
        let tally = &mut found.tally;
        tally.missed += u64::from(crossings.hits().is_empty());
        tally.crossings += crossings.hits().len() as u64;
        tally.merged += crossings.merged();
        tally.dropped += crossings.dropped();
        for (number, raw) in crossings.hits().iter().enumerate() {
            let hit = scene.interaction(&start.ray, raw);
            if !hit.shading(scene.material(&hit)).bsdf.has_diffuse() {
                continue;
            }
            let class = if number == 0 { PhotonClass::Direct } else { PhotonClass::Shadow };
            let (position, normal) = (hit.point.position, hit.facing_normal());
            found.photons.push(Photon::new(
                position,
                start.power,
                -start.ray.direction,
                normal,
                class,
                rng.next_f32(),
            ));
            found.surfaces.push(hit.surface);
            match class {
                PhotonClass::Direct => tally.direct += 1,
                PhotonClass::Indirect | PhotonClass::Caustic | PhotonClass::Shadow => tally.shadow += 1,
            }
        }
    }
    found
}

/// Stored form of the photons of one light.
#[derive(Debug)]
enum LightMap {
    /// The photons, for `as-printed` and for pictures of them.
    Photons(PhotonMap),
    /// Only the decisions, for `bounded`.
    Decisions(DecisionMap),
}

/// Direct and shadow photons, one contiguous map for each light.
#[derive(Debug)]
pub struct ShadowMaps {
    /// By light; `None` where every shadow ray is traced.
    lights: Vec<Option<LightMap>>,
    /// By light.
    tallies: Vec<ShadowTally>,
    max_radius: f32,
}

/// Traces `rays` rays, divided evenly among the lights that `mode` uses (in mode `Off`, where photons are to be shown,
/// among all but the environment), and stores the form of the photons that `mode` needs. `max_radius` bounds searches,
/// render space.
pub fn build_shadow_maps(
    scene: &Scene,
    mode: ShadowMode,
    rays: u64,
    seed: u64,
    max_radius: f32,
) -> ShadowMaps {
    let served = if mode == ShadowMode::Off { ShadowMode::AsPrinted } else { mode };
    let count = scene.lights().iter().filter(|light| served.serves(light)).count() as u64;
    let mut maps = ShadowMaps { lights: Vec::new(), tallies: Vec::new(), max_radius };
    for (id, light) in scene.lights().iter().enumerate() {
        if !served.serves(light) {
            maps.lights.push(None);
            maps.tallies.push(ShadowTally::default());
            continue;
        }
        let traced = trace_shadow_photons(scene, id as LightId, rays.div_ceil(count), seed);
        maps.tallies.push(traced.tally);
        maps.lights.push(Some(match mode {
            ShadowMode::Bounded => LightMap::Decisions(DecisionMap::build(&traced, max_radius)),
            ShadowMode::Off | ShadowMode::AsPrinted => {
                LightMap::Photons(PhotonMap::build(traced.photons, traced.tally.rays))
            }
        }));
    }
    maps
}

impl ShadowMaps {
    /// The decision of the photons of `light` for a place; `None` where there is no map of them.
    #[inline]
    pub fn decide(
        &self,
        light: LightId,
        hit: &SurfaceInteraction,
        scratch: &mut Scratch,
    ) -> Option<ShadowDecision> {
        let (position, normal) = (hit.point.position, hit.facing_normal());
        Some(match self.lights.get(light as usize)?.as_ref()? {
            LightMap::Decisions(map) => map.decide(position, normal, hit.surface),
            LightMap::Photons(map) => {
                let query = Query {
                    max_radius: self.max_radius,
                    classes: super::PhotonClasses::ALL,
                    ..Query::nearest(position, normal, NEAREST)
                };
                let found = map.search(&query, scratch);
                if !found.is_complete() {
                    return Some(ShadowDecision::TooFew);
                }
                let shadows =
                    found.iter().filter(|&(index, _)| map.class(index) == PhotonClass::Shadow).count();
                match shadows {
                    0 => ShadowDecision::Lit,
                    NEAREST => ShadowDecision::Shadow,
                    _ => ShadowDecision::Mixed,
                }
            }
        })
    }

    /// The photons of each light, where they are kept.
    pub fn photon_maps(&self) -> impl Iterator<Item = &PhotonMap> {
        self.lights.iter().filter_map(|light| match light {
            Some(LightMap::Photons(map)) => Some(map),
            _ => None,
        })
    }

    /// By light: counts of pass 1.
    pub fn tallies(&self) -> &[ShadowTally] {
        &self.tallies
    }

    /// Bytes that the map of `light` takes.
    pub fn memory_bytes(&self, light: usize) -> usize {
        match self.lights.get(light) {
            Some(Some(LightMap::Photons(map))) => map.memory_bytes(),
            Some(Some(LightMap::Decisions(map))) => map.memory_bytes(),
            _ => 0,
        }
    }
}
