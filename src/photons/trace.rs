//! Pass 1: photons from the lights to where they are absorbed (Jensen 1996, section 3).

use super::sources::Sources;
use super::{Photon, PhotonClass};
use crate::bsdf::{Bend, Bsdf, BsdfSample, Lambert, Lobe, TransportMode, sides_agree};
use crate::embree::RawHit;
use crate::math::{Frame, Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Sobol, Stream, chain_roulette, mix};
use crate::scene::{DiffuseHit, MapKind, Scene, Shading, SurfaceInteraction};
use crate::transport::attenuation;
use glam::{DVec3, Vec2, Vec3};
use std::ops::{AddAssign, MulAssign};
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
    /// Whether photons are aimed by projection maps, rather than sent wherever the lights shine. Changes noise, not light.
    pub aimed: bool,
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
    /// Photons that met specular surfaces.
    pub interfaces: u64,
    /// Photons that met an interface in another medium than it states.
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

impl MulAssign<f64> for PhotonTally {
    /// Scales the powers.
    fn mul_assign(&mut self, factor: f64) {
        self.power_emitted *= factor;
        self.power_absorbed *= factor;
        self.power_escaped *= factor;
        self.power_truncated *= factor;
    }
}

/// Photons of all lights, some of each.
pub(super) struct Batch<'a> {
    pub scene: &'a Scene,
    pub settings: &'a TraceSettings,
    pub sources: &'a Sources<'a>,
    /// Surfaces at which photons are stored whatever these reflect: indices, in ascending order.
    pub receivers: &'a [u32],
    pub stream: Stream,
    /// By light: photons emitted.
    pub shares: Vec<u64>,
    /// Surfaces that some photon met, one bit each; empty where nobody asks. Which photons met them first leaves no trace.
    pub reached: &'a [AtomicU64],
}

/// What came of some photons of one light.
pub(super) struct Traced {
    pub photons: Vec<Photon>,
    /// By photon, the surface that it is stored at; only where some surfaces have illumination maps.
    pub surfaces: Vec<u32>,
    pub tally: PhotonTally,
}

impl Batch<'_> {
    /// Notes that a photon met a surface.
    #[inline]
    fn note(&self, surface: u32) {
        let (word, bit) = (&self.reached[(surface / 64) as usize], 1 << (surface % 64));
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Whether some photon met a surface.
    pub(super) fn has_reached(&self, surface: u32) -> bool {
        self.reached[(surface / 64) as usize].load(Ordering::Relaxed) >> (surface % 64) & 1 == 1
    }

    /// Traces photons `first..end` of `light`.
    pub(super) fn trace_range(
        &self,
        light: usize,
        first: u64,
        end: u64,
        emitted: u64,
        observe: &mut impl FnMut(&Ray),
    ) -> Traced {
        let mut stored = Stored {
            photons: Vec::with_capacity((end - first) as usize),
            surfaces: self.scene.has_illumination_maps().then(Vec::new),
        };
        let mut tally = PhotonTally::default();
        let Some(source) = self.sources.emitter(light) else {
            return Traced { photons: Vec::new(), surfaces: Vec::new(), tally };
        };
        let media = self.sources.media(light);
        let seed = mix(self.settings.seed ^ mix((self.stream as u64) << 32 | light as u64));
        let sequence = Sobol::new(seed);
        // Every photon of this light stands for this share of its flux, times the photons of all lights, since the
        // map divides by those.
        let scale = (emitted as f64 / self.shares[light] as f64) as f32;
        let from_infinity = self.scene.lights()[light].is_at_infinity();
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
                if let Some(start) = source.emit(points.sample_4d(index as u32)) {
                    let power = start.power * scale;
                    tally.power_emitted += power.as_dvec3();
                    flights.push(Flight {
                        rng: Rng::new(seed, self.stream, index),
                        ray: start.ray,
                        power,
                        started_with: power.max_element(),
                        medium: media[usize::from(start.back)],
                        depth: 0,
                        chain: 0,
                        only_specular: true,
                        from_infinity,
                        met: Met::default(),
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
                if !self.reached.is_empty()
                    && let Some(hit) = hit
                {
                    self.note(self.scene.surface_of(hit));
                }
            }
            // From the back, so that a removal moves only flights that have been advanced.
            for i in (0..flights.len()).rev() {
                if !flights[i].advance(self, hits[i], &mut stored, &mut tally) {
                    flights.swap_remove(i);
                }
            }
        }
        let Stored { mut photons, surfaces } = stored;
        tally.stored = photons.len() as u64;
        // Where few are stored, the rest of the room would outweigh them a thousand times.
        photons.shrink_to_fit();
        Traced { photons, surfaces: surfaces.unwrap_or_default(), tally }
    }
}

/// Photons stored so far.
struct Stored {
    photons: Vec<Photon>,
    /// The surface of each, where that is wanted.
    surfaces: Option<Vec<u32>>,
}

/// A photon whose power has grown by more than this, roulette apart, is cut off and counted. Power grows where shading and geometric
/// normals differ, each time by at most some ten times, and falls as often: no more than one photon in so many grows so far on sound
/// meshes (Markov's inequality), but where the normals of a closed body contradict each other it may never stop growing.
const LARGEST_GROWTH: f32 = 1000.0;

/// Photons that a thread has under way at a time. Each goes its own way, whatever the others do; but while one waits for
/// its surface, the processor works on the next.
const IN_FLIGHT: usize = 32;

/// A photon under way.
struct Flight {
    rng: Rng,
    ray: Ray,
    power: Rgb,
    /// Brightest channel of the power with which it started, times the factors of [`chain_roulette`] since.
    started_with: f32,
    medium: MediumStack,
    /// Surfaces met.
    depth: u32,
    /// Specular ones since the last that was not.
    chain: u32,
    /// No diffuse surface met so far.
    only_specular: bool,
    /// Its light is infinitely far away, and its first ray no distance that a medium could absorb over.
    from_infinity: bool,
    met: Met,
}

/// What a photon has been counted for.
#[derive(Clone, Copy, Default)]
struct Met {
    interface: bool,
    mismatch: bool,
}

impl Flight {
    /// Goes on from what its ray hit; `false` where it ends.
    #[inline(always)]
    fn advance(
        &mut self,
        pass: &Batch<'_>,
        hit: Option<RawHit>,
        photons: &mut Stored,
        tally: &mut PhotonTally,
    ) -> bool {
        let Some(hit) = hit else {
            tally.missed += u64::from(self.depth == 0);
            tally.power_escaped += self.power.as_dvec3();
            return false;
        };
        tally.bounces += 1;
        let arriving = self.power;
        if !(self.from_infinity && self.depth == 0) {
            self.power *= attenuation(pass.scene, &self.medium, hit.t);
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
    fn reflect(&mut self, kind: MapKind, hit: &DiffuseHit, photons: &mut Stored) -> bool {
        self.store(kind, (hit.surface, hit.position(), hit.facing_normal()), 1.0, photons);
        if kind == MapKind::Caustic || !self.survives(self.power * hit.reflectance) {
            return false;
        }
        self.only_specular = false;
        self.chain = 0;
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
        photons: &mut Stored,
        tally: &mut PhotonTally,
    ) -> bool {
        let hit = pass.scene.met(&self.ray, hit);
        if let Some(after) = pass.scene.hidden(self.medium, &hit) {
            // Light behind a border that is not there counts as a caustic: shadow rays end at the border.
            self.medium = after;
            self.ray = hit.spawn(self.ray.direction);
            return true;
        }
        let shading = pass.scene.shading_within(&hit, self.medium);
        if shading.bsdf.has_diffuse() || pass.receivers.binary_search(&hit.surface).is_ok() {
            // Density on the surface has the cosine at the geometric normal in it; what is reflected has that at the
            // shading normal.
            let at = (hit.surface, hit.point.position, hit.facing_normal());
            self.store(pass.settings.kind, at, shading_share(&hit), photons);
        }
        let is_lobe_left = shading.bsdf.has_specular() || shading.bsdf.has_glossy();
        if pass.settings.kind == MapKind::Caustic && !is_lobe_left {
            return false;
        }
        let goes_on = self.scatter(pass, &hit, &shading, tally);
        goes_on && (self.only_specular || pass.settings.kind != MapKind::Caustic)
    }

    /// Stores the photon where it is, on the side of `normal`, with `share` of its power.
    #[inline(always)]
    fn store(
        &mut self,
        kind: MapKind,
        (surface, position, normal): (u32, Vec3, Vec3),
        share: f32,
        photons: &mut Stored,
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
        photons.photons.push(Photon::new(position, power, -self.ray.direction, normal, class, dither));
        if let Some(surfaces) = &mut photons.surfaces {
            surfaces.push(surface);
        }
    }

    /// Draws the ray on which the photon goes on, and its new power; `false` where it ends here.
    fn scatter(
        &mut self,
        pass: &Batch<'_>,
        hit: &SurfaceInteraction,
        shading: &Shading,
        tally: &mut PhotonTally,
    ) -> bool {
        let scene = pass.scene;
        let u_lobe = if shading.bsdf.chooses() { self.rng.next_f32() } else { 0.0 };
        let u = if shading.bsdf.is_delta() { Vec2::ZERO } else { self.rng.next_2d() };
        let bent = hit.shading_normal != hit.point.normal;
        // Where a caustic photon would end by the diffuse lobe, the others alone are drawn.
        let is_mixed = pass.settings.kind == MapKind::Caustic && !bent && shading.bsdf.has_diffuse();
        let (u_lobe, share) = if is_mixed { without_diffuse(shading, u_lobe) } else { (u_lobe, 1.0) };
        let found = match (&shading.bsdf, bent) {
            (_, false) => sampled(shading, u_lobe, u),
            (Bsdf::Lambert(_), true) => sampled_around_geometric(hit, shading, u),
            (_, true) => {
                let flat = SurfaceInteraction { shading_normal: hit.point.normal, ..*hit };
                let flat = scene.shading_within(&flat, self.medium);
                let candidates = candidates(hit, shading, &flat, (u_lobe, u));
                one_of(candidates, || self.rng.next_f32())
            }
        };
        let Some((sample, direction)) = found else { return false };
        let mut weight = 1.0;
        if sample.lobe != Lobe::Diffuse {
            self.check_medium(scene, hit, tally);
            let Some(survived) = chain_roulette(self.chain, || self.rng.next_f32()) else { return false };
            weight = survived;
            self.started_with *= survived;
            self.chain += 1;
        } else {
            self.only_specular = false;
            self.chain = 0;
        }
        let Some(medium) = scene.medium_after(self.medium, hit, shading, direction, sample.transmission)
        else {
            return false;
        };
        let power = self.power * (sample.throughput * (weight * share));
        if power.max_element() > LARGEST_GROWTH * self.started_with {
            tally.truncated += 1;
            tally.power_truncated += power.as_dvec3();
            tally.power_absorbed -= power.as_dvec3();
            return false;
        }
        // Photons are aimed at a surface by what it mirrors, and those that arrive there carry more by as much as it mirrors less: roulette
        // is not to take that away again.
        let expected = if is_mixed && self.depth == 0 { mirrored_share(&shading.bsdf) } else { 1.0 };
        if !self.survives_below(power, expected) {
            return false;
        }
        self.medium = medium;
        self.ray = hit.spawn(direction);
        true
    }

    /// Counts the photon once if it meets interfaces, and once if one of them states another medium on this side. The
    /// photon goes on in the stated one, so that one mistake is not repeated at each interface behind it.
    fn check_medium(&mut self, scene: &Scene, hit: &SurfaceInteraction, tally: &mut PhotonTally) {
        if !self.met.interface {
            self.met.interface = true;
            tally.interfaces += 1;
        }
        let Some(stated) = scene.mismatch(hit, self.medium) else { return };
        if !self.met.mismatch {
            self.met.mismatch = true;
            tally.medium_mismatches += 1;
        }
        self.medium = stated;
    }

    /// Chromatic roulette over what is left of the `power` after a surface: the brightest channel decides, so that
    /// photons keep their power and no channel of a survivor grows beyond it.
    #[inline(always)]
    fn survives(&mut self, power: Rgb) -> bool {
        self.survives_below(power, 1.0)
    }

    /// [`Self::survives`] where photons are meant to keep the `expected` share of their power: none is stopped that has as much.
    #[inline(always)]
    fn survives_below(&mut self, power: Rgb, expected: f32) -> bool {
        let survival = power.max_element() / (self.power.max_element() * expected);
        if !(survival > 0.0) || survival < 1.0 && self.rng.next_f32() >= survival {
            return false;
        }
        self.power = if survival < 1.0 { power / survival } else { power };
        true
    }
}

/// The number that chooses a lobe, moved to where it chooses none but the highly glossy and specular ones, and the share of the
/// light that is theirs.
fn without_diffuse(shading: &Shading, u_lobe: f32) -> (f32, f32) {
    let [diffuse, glossy, specular] = shading.bsdf.lobe_weights(shading.wo_local);
    let total = diffuse + glossy + specular;
    let share = diffuse / total;
    if !(diffuse > 0.0 && total > diffuse) {
        return (u_lobe, 1.0);
    }
    ((share + (1.0 - share) * u_lobe).min(ONE_MINUS_EPSILON), 1.0 - share)
}

/// Mean share, over the hemisphere and weighted by the cosine, of the light that a surface mirrors or refracts.
fn mirrored_share(bsdf: &Bsdf) -> f32 {
    const DIRECTIONS: u8 = 4;
    let share = |i: u8| {
        let cosine = ((f32::from(i) + 0.5) / f32::from(DIRECTIONS)).sqrt();
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        let [_, glossy, specular] = bsdf.lobe_weights(Vec3::new(sine, 0.0, cosine));
        glossy + specular
    };
    ((0..DIRECTIONS).map(share).sum::<f32>() / f32::from(DIRECTIONS)).clamp(f32::MIN_POSITIVE, 1.0)
}

/// A direction and the sample that it is from.
type Scattered = (BsdfSample, Vec3);

/// A direction drawn from the BSDF.
fn sampled(shading: &Shading, u_lobe: f32, u: Vec2) -> Option<Scattered> {
    let sample = shading.bsdf.sample(shading.wo_local, u_lobe, u, TransportMode::Flux)?;
    Some((sample, shading.frame.to_world(sample.wi)))
}

/// A direction from a Lambertian surface with another shading normal. Its light leaves as that of any Lambertian surface, so it
/// is drawn around the geometric normal, and has no cosine at grazing angles to be divided by.
fn sampled_around_geometric(hit: &SurfaceInteraction, shading: &Shading, u: Vec2) -> Option<Scattered> {
    let frame = Frame::from_z(shading.geometric);
    let sample = shading.bsdf.sample(frame.to_local(hit.wo), 0.0, u, TransportMode::Flux)?;
    let direction = frame.to_world(sample.wi);
    // The adjoint of what a camera path meets that arrives from `direction`: it sees the geometric normal where the shading
    // normal faces away from it.
    let sees_shading = sides_agree(direction, hit.shading_normal, hit.point.normal);
    let share = if sees_shading { shading_share(hit) } else { 1.0 };
    Some((BsdfSample { throughput: sample.throughput * share, ..sample }, direction))
}

/// Directions in which light goes on from a surface whose normals differ, each a term of the adjoint of what paths do: those
/// from where the shading normal is seen, and those from where it faces away and a path sees the geometric one, `flat`.
fn candidates(
    hit: &SurfaceInteraction,
    shading: &Shading,
    flat: &Shading,
    (u_lobe, u): (f32, Vec2),
) -> [Option<Scattered>; 4] {
    let seen = match shading.bent() {
        Some(bent) => bent.scatter_photon(u_lobe, u),
        // Light from where the shading normal faces away.
        None => [None; 3],
    };
    let [a, b, c] = seen.map(|sample| sample.map(|sample| (sample, shading.frame.to_world(sample.wi))));
    let faces_away = |direction: Vec3| !sides_agree(direction, hit.shading_normal, hit.point.normal);
    [a, b, c, sampled(flat, u_lobe, u).filter(|&(_, direction)| faces_away(direction))]
}

/// One of several directions, in proportion to what goes there, with the light of all.
fn one_of(candidates: [Option<Scattered>; 4], u: impl FnOnce() -> f32) -> Option<Scattered> {
    let weight = |found: &Option<Scattered>| found.map_or(0.0, |(sample, _)| sample.throughput.max_element());
    let total: f32 = candidates.iter().map(weight).sum();
    let mut left = u() * total;
    let chosen = candidates.iter().position(|found| {
        let weight = weight(found);
        let is_here = weight > 0.0 && left < weight;
        left -= weight;
        is_here
    });
    // Rounding may leave a little at the end.
    let chosen = chosen.or_else(|| candidates.iter().rposition(|found| weight(found) > 0.0))?;
    let (sample, direction) = candidates[chosen]?;
    let throughput = sample.throughput * (total / sample.throughput.max_element());
    Some((BsdfSample { throughput, ..sample }, direction))
}

/// What a Lambertian surface reflects of light that arrives at `hit`, over what it would with the geometric normal as shading
/// normal: the share of a photon's power that the map keeps ([`crate::bsdf::Bend::lambert_share`]). Zero from below the
/// shading normal's horizon.
fn shading_share(hit: &SurfaceInteraction) -> f32 {
    if hit.shading_normal == hit.point.normal {
        return 1.0;
    }
    let side = 1f32.copysign(hit.wo.dot(hit.point.normal));
    let frame = Frame::from_z(hit.shading_normal * side);
    Bend::new(frame.to_local(hit.point.normal * side)).lambert_share(frame.to_local(hit.wo))
}
