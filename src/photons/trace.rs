//! Pass 1: photons from the lights to where they are absorbed (Jensen 1996, section 3).

use super::emission::{Aim, emit};
use super::{Photon, PhotonClass};
use crate::bsdf::{Bsdf, Lambert, Lobe, TransportMode, shading_normal_correction, sides_agree};
use crate::embree::RawHit;
use crate::math::{Frame, Ray, Rgb};
use crate::media::MediumId;
use crate::sampling::{Rng, Sobol, Stream, mix};
use crate::scene::{DiffuseHit, MapKind, Scene, Shading, SurfaceInteraction};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::AddAssign;
use std::sync::atomic::{AtomicU64, Ordering};

/// What to trace.
#[derive(Clone, Copy, Debug)]
pub struct TraceSettings {
    /// Which map the photons are for.
    pub kind: MapKind,
    /// Photons to store, about.
    pub stored: u64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Surfaces a photon may meet before it is cut off and counted as truncated.
    pub max_depth: u32,
}

/// What became of the photons of one light. Powers are sums over photons; divided by the photons emitted in all, flux.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhotonTally {
    /// Photons emitted, those without power included.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// Surfaces met.
    pub bounces: u64,
    /// Photons that met no surface at all.
    pub missed: u64,
    /// Photons cut off at the depth limit.
    pub truncated: u64,
    /// Specular surfaces met.
    pub interfaces: u64,
    /// Interfaces met in another medium than they state.
    pub medium_mismatches: u64,
    /// Power that left the lights.
    pub power_emitted: DVec3,
    /// Power that surfaces and media absorbed, or that was stored in a map that follows photons no further.
    pub power_absorbed: DVec3,
    /// Power that left the scene.
    pub power_escaped: DVec3,
    /// Power cut off at the depth limit.
    pub power_truncated: DVec3,
}

impl AddAssign for PhotonTally {
    fn add_assign(&mut self, other: Self) {
        self.emitted += other.emitted;
        self.stored += other.stored;
        self.bounces += other.bounces;
        self.missed += other.missed;
        self.truncated += other.truncated;
        self.interfaces += other.interfaces;
        self.medium_mismatches += other.medium_mismatches;
        self.power_emitted += other.power_emitted;
        self.power_absorbed += other.power_absorbed;
        self.power_escaped += other.power_escaped;
        self.power_truncated += other.power_truncated;
    }
}

/// Photons of one map, in the order of their numbers.
#[derive(Debug)]
pub struct TracedPhotons {
    /// The photons; their powers are to be divided by `emitted`.
    pub photons: Vec<Photon>,
    /// Photons emitted by all lights together.
    pub emitted: u64,
    /// By light.
    pub tallies: Vec<PhotonTally>,
}

/// Photons traced to find out how many to emit: more where none of them is stored, before it is believed that none can be.
const PREPASSES: [u64; 3] = [20_000, 400_000, 8_000_000];

/// Photons traced before those, which are enough where they are stored this often: where surfaces reflect nearly
/// everything, a photon has thousands of bounces.
const FIRST_PREPASS: (u64, usize) = (200, 20_000);

/// Photons that one task traces.
const CHUNK: u64 = 4096;

/// More emitted photons than this for one stored are not worth waiting for; fewer are stored then.
const MOST_EMITTED_PER_STORED: f64 = 2000.0;

/// Traces about `settings.stored` photons.
///
/// How many to emit is found by a short pass with random numbers of its own, so that the count does not depend on the
/// photons that are kept. Each light emits in proportion to its flux; a photon's number alone decides its way, so the
/// result is the same for any number of threads. `progress` is called with the photons traced so far and those to
/// trace; once it returns `false` nothing more is traced and `None` returned.
pub fn trace_photons(
    scene: &Scene,
    settings: &TraceSettings,
    progress: &(dyn Fn(u64, u64) -> bool + Sync),
) -> Option<TracedPhotons> {
    let nothing = TracedPhotons {
        photons: Vec::new(),
        emitted: 0,
        tallies: vec![PhotonTally::default(); scene.lights().len()],
    };
    if settings.stored == 0 || scene.light_power().is_none() {
        return Some(nothing);
    }
    let mut prepass = Batch::new(scene, settings, Stream::Prepass, FIRST_PREPASS.0).run(&|_, _| true)?;
    for emitted in PREPASSES {
        if prepass.photons.len() < FIRST_PREPASS.1 && (emitted == PREPASSES[0] || prepass.photons.is_empty())
        {
            prepass = Batch::new(scene, settings, Stream::Prepass, emitted).run(&|_, _| true)?;
        }
    }
    if prepass.photons.is_empty() {
        return Some(TracedPhotons { photons: Vec::new(), ..prepass });
    }
    let per_stored = prepass.emitted as f64 / prepass.photons.len() as f64;
    let emitted = settings.stored as f64 * per_stored.min(MOST_EMITTED_PER_STORED);
    let stream = match settings.kind {
        MapKind::Global => Stream::GlobalPhotons,
        MapKind::Caustic => Stream::CausticPhotons,
    };
    Batch::new(scene, settings, stream, emitted.ceil() as u64).run(progress)
}

/// The rays of a photon pass that emits `emitted` photons, in the order in which one thread traces them: for benchmarks
/// of ray tracing with a real workload.
pub fn record_photon_rays(scene: &Scene, settings: &TraceSettings, emitted: u64) -> Vec<Ray> {
    let batch = Batch::new(scene, settings, Stream::Measure, emitted);
    let mut rays = Vec::new();
    for light in 0..batch.shares.len() {
        batch.trace_range(light, 0, batch.shares[light], emitted, &mut |ray| rays.push(*ray));
    }
    rays
}

/// The same pass on one thread, without recording: returns the rays traced.
pub fn trace_photons_alone(scene: &Scene, settings: &TraceSettings, emitted: u64) -> (Vec<Photon>, u64) {
    let batch = Batch::new(scene, settings, Stream::Measure, emitted);
    let (mut photons, mut rays) = (Vec::new(), 0);
    for light in 0..batch.shares.len() {
        let (stored, tally) = batch.trace_range(light, 0, batch.shares[light], emitted, &mut |_| ());
        rays += tally.bounces;
        photons.extend(stored);
    }
    (photons, rays)
}

/// Photons of all lights, some of each.
struct Batch<'a> {
    scene: &'a Scene,
    settings: &'a TraceSettings,
    stream: Stream,
    /// By light: photons emitted.
    shares: Vec<u64>,
    media: Vec<MediumId>,
}

impl<'a> Batch<'a> {
    fn new(scene: &'a Scene, settings: &'a TraceSettings, stream: Stream, emitted: u64) -> Self {
        let shares = match scene.light_power() {
            // At least one photon for a light that shines, so that none is left out whatever the others are.
            Some(power) => (0..scene.lights().len())
                .map(|light| {
                    let probability = f64::from(power.probability(light));
                    if probability > 0.0 { ((probability * emitted as f64).round() as u64).max(1) } else { 0 }
                })
                .collect(),
            None => vec![0; scene.lights().len()],
        };
        let media = scene.lights().iter().map(|light| scene.medium_at(light.a_point())).collect();
        Self { scene, settings, stream, shares, media }
    }

    fn run(&self, progress: &(dyn Fn(u64, u64) -> bool + Sync)) -> Option<TracedPhotons> {
        let emitted: u64 = self.shares.iter().sum();
        let mut tasks = Vec::new();
        for (light, &share) in self.shares.iter().enumerate() {
            tasks.extend(
                (0..share).step_by(CHUNK as usize).map(|first| (light, first, share.min(first + CHUNK))),
            );
        }
        let done = AtomicU64::new(0);
        let results: Option<Vec<(usize, Vec<Photon>, PhotonTally)>> = tasks
            .into_par_iter()
            .map(|(light, first, end)| {
                let (photons, tally) = self.trace_range(light, first, end, emitted, &mut |_| ());
                let traced = done.fetch_add(end - first, Ordering::Relaxed) + (end - first);
                progress(traced, emitted).then_some((light, photons, tally))
            })
            .collect();
        let results = results?;
        let mut tallies = vec![PhotonTally::default(); self.shares.len()];
        let mut photons = Vec::with_capacity(results.iter().map(|(_, photons, _)| photons.len()).sum());
        for (light, stored, tally) in results {
            photons.extend(stored);
            tallies[light] += tally;
        }
        Some(TracedPhotons { photons, emitted, tallies })
    }

    fn trace_range(
        &self,
        light: usize,
        first: u64,
        end: u64,
        emitted: u64,
        observe: &mut impl FnMut(&Ray),
    ) -> (Vec<Photon>, PhotonTally) {
        let mut photons = Vec::with_capacity((end - first) as usize);
        let mut tally = PhotonTally::default();
        let seed = mix(self.settings.seed ^ mix((self.stream as u64) << 32 | light as u64));
        let sequence = Sobol::new(seed);
        // Every photon of this light stands for this share of its flux, times the photons of all lights, since the
        // map divides by those.
        let scale = (emitted as f64 / self.shares[light] as f64) as f32;
        let source = &self.scene.lights()[light];
        let (bounds, casters) = (self.scene.bounds(), self.scene.casters());
        let aim = match self.settings.kind {
            MapKind::Global => Aim::Scene(bounds),
            MapKind::Caustic => Aim::Casters(casters, bounds),
        };
        let mut flights: Vec<Flight> = Vec::with_capacity(IN_FLIGHT);
        let mut hits = [None; IN_FLIGHT];
        let mut index = first;
        let mut points = sequence.set((index >> 32) as u32);
        loop {
            while flights.len() < IN_FLIGHT && index < end {
                tally.emitted += 1;
                if index as u32 == 0 {
                    points = sequence.set((index >> 32) as u32);
                }
                if let Some(start) = emit(source, aim, points.sample_4d(index as u32)) {
                    let power = start.power * scale;
                    tally.power_emitted += power.as_dvec3();
                    flights.push(Flight {
                        rng: Rng::new(seed, self.stream, index),
                        ray: start.ray,
                        power,
                        medium: self.media[light],
                        depth: 0,
                        only_specular: true,
                        from_infinity: source.is_at_infinity(),
                    });
                }
                index += 1;
            }
            if flights.is_empty() {
                break;
            }
            for (hit, flight) in hits.iter_mut().zip(&flights) {
                observe(&flight.ray);
                *hit = self.scene.embree().intersect(&flight.ray);
            }
            // From the back, so that a removal moves only flights that have been advanced.
            for i in (0..flights.len()).rev() {
                if !flights[i].advance(self, hits[i], &mut photons, &mut tally) {
                    flights.swap_remove(i);
                }
            }
        }
        tally.stored = photons.len() as u64;
        (photons, tally)
    }
}

/// Photons that a thread has under way at a time. Each goes its own way, whatever the others do; but while one waits for
/// its surface, the processor works on the next.
const IN_FLIGHT: usize = 32;

/// A photon under way.
struct Flight {
    rng: Rng,
    ray: Ray,
    power: Rgb,
    medium: MediumId,
    /// Surfaces met.
    depth: u32,
    /// No diffuse surface met so far.
    only_specular: bool,
    /// Its light is infinitely far away, and its first ray no distance that a medium could absorb over.
    from_infinity: bool,
}

impl Flight {
    /// Goes on from what its ray hit; `false` where it ends.
    #[inline(always)]
    fn advance(
        &mut self,
        pass: &Batch<'_>,
        hit: Option<RawHit>,
        photons: &mut Vec<Photon>,
        tally: &mut PhotonTally,
    ) -> bool {
        let Some(hit) = hit else {
            tally.missed += u64::from(self.depth == 0);
            tally.power_escaped += self.power.as_dvec3();
            return false;
        };
        tally.bounces += 1;
        let arriving = self.power;
        let medium = pass.scene.medium(self.medium);
        if !(medium.is_clear() || self.from_infinity && self.depth == 0) {
            self.power *= medium.transmittance(hit.t);
        }
        let goes_on = match pass.scene.diffuse_hit(&self.ray, &hit) {
            Some(hit) => self.reflect(pass.settings.kind, &hit, photons),
            None => self.meet(pass, &hit, photons, tally),
        };
        let left = if goes_on { self.power } else { Rgb::ZERO };
        tally.power_absorbed += arriving.as_dvec3() - left.as_dvec3();
        self.depth += 1;
        if goes_on && self.depth >= pass.settings.max_depth {
            tally.truncated += 1;
            tally.power_truncated += self.power.as_dvec3();
            return false;
        }
        goes_on
    }

    /// Goes on from a flat Lambert surface, as [`Self::meet`] from all others. Here the direction has no say in the
    /// roulette, so that is played first, and only survivors draw one.
    #[inline(always)]
    fn reflect(&mut self, kind: MapKind, hit: &DiffuseHit, photons: &mut Vec<Photon>) -> bool {
        self.store(kind, (hit.position(), hit.facing_normal()), 1.0, photons);
        if kind == MapKind::Caustic || !self.survives(self.power * hit.reflectance) {
            return false;
        }
        self.only_specular = false;
        let local = Lambert::sample_direction(self.rng.next_2d());
        self.ray = hit.spawn(Frame::from_z(hit.facing_normal()).to_world(local));
        true
    }

    /// Goes on from any surface.
    #[inline(never)]
    fn meet(
        &mut self,
        pass: &Batch<'_>,
        hit: &RawHit,
        photons: &mut Vec<Photon>,
        tally: &mut PhotonTally,
    ) -> bool {
        let hit = pass.scene.interaction(&self.ray, hit);
        let shading = hit.shading(pass.scene.material(&hit));
        if shading.bsdf.has_diffuse() {
            // Density on the surface has the cosine at the geometric normal in it; what is reflected has that at the
            // shading normal.
            let at = (hit.point.position, hit.facing_normal());
            self.store(pass.settings.kind, at, shading_share(&hit), photons);
        }
        let is_lobe_left = shading.bsdf.has_specular() || shading.bsdf.has_glossy();
        if pass.settings.kind == MapKind::Caustic && !is_lobe_left {
            return false;
        }
        let goes_on = self.scatter(pass.scene, &hit, &shading, tally);
        goes_on && (self.only_specular || pass.settings.kind != MapKind::Caustic)
    }

    /// Stores the photon where it is, on the side of `normal`, with `share` of its power.
    #[inline(always)]
    fn store(
        &mut self,
        kind: MapKind,
        (position, normal): (Vec3, Vec3),
        share: f32,
        photons: &mut Vec<Photon>,
    ) {
        let class = match (self.depth, self.only_specular) {
            (0, _) => PhotonClass::Direct,
            (_, true) => PhotonClass::Caustic,
            (_, false) => PhotonClass::Indirect,
        };
        if kind == MapKind::Caustic && class != PhotonClass::Caustic {
            return;
        }
        let power = self.power * share;
        if power == Rgb::ZERO {
            return;
        }
        let dither = self.rng.next_f32();
        photons.push(Photon::new(position, power, -self.ray.direction, normal, class, dither));
    }

    /// Draws the ray on which the photon goes on, and its new power; `false` where it ends here.
    fn scatter(
        &mut self,
        scene: &Scene,
        hit: &SurfaceInteraction,
        shading: &Shading,
        tally: &mut PhotonTally,
    ) -> bool {
        let u_lobe = if shading.bsdf.chooses() { self.rng.next_f32() } else { 0.0 };
        let u = if shading.bsdf.is_delta() { Vec2::ZERO } else { self.rng.next_2d() };
        let bent = hit.shading_normal != hit.point.normal;
        // Lambert's law is sampled around the geometric normal, see below.
        let around_geometric = bent && matches!(shading.bsdf, Bsdf::Lambert(_));
        let frame = if around_geometric { Frame::from_z(shading.geometric) } else { shading.frame };
        let wo = frame.to_local(hit.wo);
        let Some(sample) = shading.bsdf.sample(wo, u_lobe, u, TransportMode::Flux) else {
            return false;
        };
        let direction = frame.to_world(sample.wi);
        if sample.lobe != Lobe::Diffuse {
            tally.interfaces += 1;
            tally.medium_mismatches += u64::from(scene.is_medium_mismatch(hit, self.medium));
        } else {
            self.only_specular = false;
        }
        let Some(medium) = scene.medium_after(self.medium, hit, shading, direction, sample.transmission)
        else {
            return false;
        };
        let mut power = self.power * sample.throughput;
        if bent {
            power *= match around_geometric {
                false => shading_normal_correction(hit.wo, direction, shading.frame.z, shading.geometric),
                // The adjoint of what a camera path meets that arrives from `direction`: the cosine at the shading
                // normal, or at the geometric one where the shading normal faces away from it.
                true if sides_agree(direction, hit.shading_normal, hit.point.normal) => shading_share(hit),
                true => 1.0,
            };
        }
        if !self.survives(power) {
            return false;
        }
        self.medium = medium;
        self.ray = hit.spawn(direction);
        true
    }

    /// Chromatic roulette over what is left of the `power` after a surface: the brightest channel decides, so that
    /// photons keep their power and no channel of a survivor grows beyond it.
    #[inline(always)]
    fn survives(&mut self, power: Rgb) -> bool {
        let survival = power.max_element() / self.power.max_element();
        if !(survival > 0.0) || survival < 1.0 && self.rng.next_f32() >= survival {
            return false;
        }
        self.power = if survival < 1.0 { power / survival } else { power };
        true
    }
}

/// Cosine of incidence at the shading normal over that at the geometric one, for the light that arrives at `hit`: the
/// share of the flux density on the surface that a diffuse lobe reflects, or more than one. Zero from below the shading
/// normal's horizon (Veach 1997, section 5.3).
fn shading_share(hit: &SurfaceInteraction) -> f32 {
    let (shading, geometric) = (hit.wo.dot(hit.shading_normal), hit.wo.dot(hit.point.normal));
    if hit.shading_normal == hit.point.normal || geometric == 0.0 {
        1.0
    } else {
        (shading / geometric).max(0.0)
    }
}
