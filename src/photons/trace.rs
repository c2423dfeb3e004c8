//! Pass 1: traces photons from the lights until they are absorbed (Jensen 1996, section 3).

use super::scattering::{
    candidates, mirrored_share, one_of, sampled, sampled_around_geometric, shading_share, without_diffuse,
};
use super::sources::Sources;
use super::volume::{MediaRecords, Thinning};
use super::{Photon, PhotonClass};
use crate::bsdf::{Bsdf, Lambert, Lobe};
use crate::embree::RawHit;
use crate::math::{Frame, Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::{ONE_MINUS_EPSILON, Rng, Sobol, Stream, chain_roulette, mix};
use crate::scene::{DiffuseHit, MapKind, Scene, Shading, SurfaceInteraction};
use crate::settings::Wavelengths;
use crate::spectra::{Line, at_line};
use crate::transport::{
    Clearance, Event, attenuation, refracted_share, surface_through_media, walk_in_media,
};
use glam::{DVec3, Vec2, Vec3};
use std::ops::{AddAssign, MulAssign};
use std::sync::atomic::{AtomicU64, Ordering};

/// Settings of a photon pass.
#[derive(Clone, Copy, Debug)]
pub struct TraceSettings {
    /// The map that the photons are for.
    pub kind: MapKind,
    /// Approximate number of photons to store.
    pub stored: u64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Largest number of surfaces that a photon meets; then it is cut off and counted as truncated.
    pub max_depth: u32,
    /// Whether photons are aimed by projection maps, or sent wherever the lights shine. This changes the noise, not the
    /// mean.
    pub aimed: bool,
    /// Wavelengths of photons that are dispersed.
    pub wavelengths: Wavelengths,
}

/// Counts and powers of the photons of one light. Powers are sums over photons; divided by the number of all emitted
/// photons they are flux.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhotonTally {
    /// Photons emitted, including those without power.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// Number of surfaces met.
    pub bounces: u64,
    /// Photons that met no surface at all.
    pub missed: u64,
    /// Photons cut off at the depth limit.
    pub truncated: u64,
    /// Photons that left a surface by a specular or glossy lobe.
    pub interfaces: u64,
    /// Photons that met an interface whose stated medium differs from the one they were in.
    pub medium_mismatches: u64,
    /// Photons that a medium scattered where that may be stored.
    pub media_paths: u64,
    /// Number of times that media scattered them there.
    pub media_collisions: u64,
    /// Power that left the lights.
    pub power_emitted: DVec3,
    /// Power that surfaces and media absorbed, or that was stored in a map which does not follow photons further.
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
        self.media_paths += other.media_paths;
        self.media_collisions += other.media_collisions;
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

/// A pass over all lights: a number of photons of each.
pub(super) struct Batch<'a> {
    pub scene: &'a Scene,
    pub settings: &'a TraceSettings,
    pub sources: &'a Sources<'a>,
    /// Surfaces at which photons are stored even if they reflect nothing: indices, in ascending order.
    pub receivers: &'a [u32],
    pub stream: Stream,
    /// Whether photons are stored in media instead of on surfaces.
    pub in_media: bool,
    /// Whether the surface of each photon is recorded, though no surface has an illumination map.
    pub tagged: bool,
    /// Which of the photons that media scatter are stored.
    pub kept: Kept<'a>,
    /// Which photons are followed, by whether they meet media.
    pub starts: Starts<'a>,
    /// By light: number of photons to emit.
    pub shares: Vec<u64>,
    /// Surfaces that some photon met, one bit each; empty where this is not needed. The result does not depend on which
    /// photon met a surface first.
    pub reached: &'a [AtomicU64],
}

/// Photons that a pass follows, by whether they meet a medium that scatters, or a surface that bounds one, before any diffuse surface. Two
/// passes, one aimed at such media and at specular surfaces, together have all photons. By surface, whether it bounds such a medium.
#[derive(Clone, Copy, Debug)]
pub(super) enum Starts<'a> {
    /// All.
    Anywhere,
    /// Those that meet one.
    AtMedia(&'a [bool]),
    /// The others.
    Elsewhere(&'a [bool]),
}

/// Which of the photons that media scatter are stored, their power divided by the probability of that.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kept<'a> {
    /// The first of each path, and later ones ever less often.
    First,
    /// All.
    All,
    /// By place.
    Thinned(&'a Thinning),
}

impl Kept<'_> {
    /// Probability of storing a photon at a place where its path has been scattered so often before.
    fn share(self, position: Vec3, before: u32) -> f32 {
        match self {
            Self::First => ALL_STORED / (ALL_STORED + before as f32),
            Self::All => 1.0,
            Self::Thinned(thinning) => thinning.share(position),
        }
    }
}

/// With [`Kept::First`] a photon is stored with the probability of this number over itself plus the number of times it was to be stored before.
const ALL_STORED: f32 = 8.0;

/// Result of tracing some photons of one light.
pub(super) struct Traced {
    pub photons: Vec<Photon>,
    /// By photon, the surface that it is stored at; empty unless it is recorded.
    pub surfaces: Vec<u32>,
    /// Photons in media.
    pub media: MediaRecords,
    pub tally: PhotonTally,
}

impl Traced {
    /// Number of photons stored.
    pub(super) fn len(&self) -> usize {
        self.photons.len() + self.media.len()
    }
}

impl Batch<'_> {
    /// Records that a photon met a surface.
    #[inline]
    fn note(&self, surface: u32) {
        let (word, bit) = (&self.reached[(surface / 64) as usize], 1 << (surface % 64));
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Whether any photon met a surface.
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
            surfaces: (self.tagged || self.scene.has_illumination_maps()).then(Vec::new),
            media: MediaRecords::default(),
        };
        let mut tally = PhotonTally::default();
        let Some(source) = self.sources.emitter(light) else {
            return Traced {
                photons: Vec::new(),
                surfaces: Vec::new(),
                media: MediaRecords::default(),
                tally,
            };
        };
        let media = self.sources.media(light);
        let seed = mix(self.settings.seed ^ mix((self.stream as u64) << 32 | light as u64));
        let sequence = Sobol::new(seed);
        // The map divides by the photons of all lights, so the power of a photon of this light is scaled by that number
        // over its own.
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
                        line: None,
                        u_line: low_discrepancy(index, seed),
                        ray: start.ray,
                        power,
                        started_with: power.max_element(),
                        medium: media[usize::from(start.back)],
                        clearance: Clearance::default(),
                        depth: 0,
                        scattered: 0,
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
            if self.scene.scatters() {
                for mut flight in flights.drain(..) {
                    while flight.advance_in_media(self, &mut stored, &mut tally) {}
                }
                continue;
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
            // From the last, so that a removal moves only flights that have been advanced.
            for i in (0..flights.len()).rev() {
                if !flights[i].advance(self, hits[i], &mut stored, &mut tally) {
                    flights.swap_remove(i);
                }
            }
        }
        let Stored { mut photons, surfaces, media } = stored;
        tally.stored = (photons.len() + media.len()) as u64;
        // Where few photons are stored, the unused capacity could be a thousand times larger.
        photons.shrink_to_fit();
        Traced { photons, surfaces: surfaces.unwrap_or_default(), media, tally }
    }
}

/// Photons stored so far.
struct Stored {
    photons: Vec<Photon>,
    /// The surface of each photon, where it is needed.
    surfaces: Option<Vec<u32>>,
    /// Photons in media.
    media: MediaRecords,
}

/// A photon whose power has grown by more than this factor, roulette apart, is cut off and counted. Power grows where
/// shading and geometric normals differ, each time by at most a factor of about ten, and it falls as often. On sound
/// meshes no more than one photon in this number grows so far (Markov's inequality). Where the normals of a closed body
/// contradict each other, the power might never stop growing.
const LARGEST_GROWTH: f32 = 1000.0;

/// Photons that a thread traces at a time. Their paths are independent; while one photon waits for its surface to be
/// loaded, the processor works on the next.
const IN_FLIGHT: usize = 32;

/// A photon on its path.
struct Flight {
    rng: Rng,
    ray: Ray,
    /// Unnormalised flux, watts; with a `line` all channels are that of its wavelength.
    power: Rgb,
    /// Its wavelength since it was dispersed.
    line: Option<Line>,
    /// Random number of the wavelength.
    u_line: f32,
    /// Brightest channel of the power at the start, times the factors of [`chain_roulette`] since.
    started_with: f32,
    medium: MediumStack,
    clearance: Clearance,
    /// Number of surfaces met.
    depth: u32,
    /// Number of times that media scattered it where that is stored.
    scattered: u32,
    /// Length of the current specular chain.
    chain: u32,
    /// Whether the photon has met no diffuse surface so far.
    only_specular: bool,
    /// Whether its light is infinitely far away: its first ray then has no distance over which a medium could absorb.
    from_infinity: bool,
    met: Met,
}

/// What a photon has met: counters that it has already incremented, and media.
#[derive(Clone, Copy, Default)]
struct Met {
    interface: bool,
    mismatch: bool,
    /// A medium that scatters, before any diffuse surface.
    media: bool,
}

/// Random number in `[0, 1)` for the wavelength of photon `index` of a pass: successive photons cover all wavelengths evenly.
fn low_discrepancy(index: u64, seed: u64) -> f32 {
    // The golden section, as a fraction of 2^64.
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    (index.wrapping_mul(GOLDEN).wrapping_add(mix(!seed)) >> 40) as f32 / 16_777_216.0
}

impl Flight {
    /// Power as the sensor receives it.
    #[inline(always)]
    fn received(&self) -> DVec3 {
        match self.line {
            None => self.power.as_dvec3(),
            Some(line) => (line.response() * self.power.x).as_dvec3(),
        }
    }

    /// Takes a wavelength, if photons have one.
    fn disperse(&mut self, wavelengths: Wavelengths) {
        self.line = Line::choose(wavelengths, self.u_line);
        if let Some(line) = self.line {
            self.power = Rgb::splat(line.at(self.power));
        }
    }

    /// Continues from the hit of its ray; `false` where the photon ends.
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
            tally.power_escaped += self.received();
            return false;
        };
        tally.bounces += 1;
        let arriving = self.received();
        if !(self.from_infinity && self.depth == 0) {
            self.power *= at_line(self.line, attenuation(pass.scene, &self.medium, hit.t));
        }
        let goes_on = match pass.scene.diffuse_hit(&self.ray, &hit) {
            Some(hit) => self.reflect(pass.settings.kind, &hit, photons),
            None => self.meet(pass, &hit, photons, tally),
        };
        let left = if goes_on { self.received() } else { DVec3::ZERO };
        tally.power_absorbed += arriving - left;
        self.depth += 1;
        if goes_on && self.depth >= pass.settings.max_depth {
            tally.truncated += 1;
            tally.power_truncated += self.received();
            return false;
        }
        goes_on
    }

    /// Continues along its ray through media that scatter, to the next surface or scattering event; `false` where the photon ends.
    ///
    /// The light of a specular chain is not scattered in a pass for caustics: it crosses media as beams.
    #[inline(never)]
    fn advance_in_media(&mut self, pass: &Batch<'_>, photons: &mut Stored, tally: &mut PhotonTally) -> bool {
        let (scene, ray, arriving, line) = (pass.scene, self.ray, self.power, self.line);
        let arriving_flux = self.received();
        let u = self.rng.next_f32();
        let mut in_media = false;
        let passage = if pass.settings.kind == MapKind::Caustic {
            let (center, radius) = scene.bounds();
            let reach = f64::from(ray.origin.distance(center) + radius);
            let mut records = (pass.in_media && self.depth > 0).then_some(&mut photons.media);
            let mut rng = self.rng.split();
            surface_through_media(scene, &ray, &mut self.medium, u, |stretch| {
                if let Some(records) = &mut records {
                    records.cross(&ray, stretch, (arriving, line), reach, &mut rng);
                }
            })
        } else {
            let weights = line.map_or(arriving, Line::primaries);
            let (medium, clearance) = (&mut self.medium, &mut self.clearance);
            walk_in_media(scene, &ray, medium, (weights, u), clearance, |_| in_media = true)
        };
        let ends_at = |bounding: &[bool]| match &passage.event {
            Event::Surface(arrival) => bounding[arrival.hit.surface as usize],
            Event::Medium(_) | Event::Escape => false,
        };
        let is_followed = match pass.starts {
            Starts::Anywhere => true,
            Starts::AtMedia(bounding) => {
                self.met.media |= self.only_specular && (in_media || ends_at(bounding));
                self.only_specular || self.met.media
            }
            Starts::Elsewhere(bounding) => {
                self.met.media |= self.only_specular && (in_media || ends_at(bounding));
                !self.met.media
            }
        };
        if !is_followed {
            tally.power_escaped += arriving_flux;
            return false;
        }
        self.power *= at_line(line, passage.weight);
        let goes_on = match passage.event {
            Event::Escape => {
                tally.missed += u64::from(self.depth == 0);
                tally.power_escaped += self.received();
                tally.power_absorbed += arriving_flux - self.received();
                return false;
            }
            Event::Surface(arrival) => {
                tally.bounces += 1;
                if !pass.reached.is_empty() {
                    pass.note(arrival.hit.surface);
                }
                self.meet_surface(pass, &arrival.hit, photons, tally)
            }
            Event::Medium(collision) => {
                if pass.in_media && !self.only_specular {
                    tally.media_paths += u64::from(self.scattered == 0);
                    tally.media_collisions += 1;
                    // So that the photons of a dense medium are not those of a few paths.
                    let share = pass.kept.share(collision.position, self.scattered);
                    if self.rng.next_f32() < share {
                        photons.media.scatter(&ray, &collision, (self.power / share, line));
                    }
                    self.scattered += 1;
                }
                self.only_specular = false;
                self.chain = 0;
                let scattered = std::mem::replace(&mut self.power, arriving);
                let survives = self.survives(scattered);
                if survives {
                    let sample = collision.phase.sample(-ray.direction, self.rng.next_2d());
                    self.ray = Ray::new(collision.position, sample.wi);
                }
                survives
            }
        };
        let left = if goes_on { self.received() } else { DVec3::ZERO };
        tally.power_absorbed += arriving_flux - left;
        self.depth += 1;
        if goes_on && self.depth >= pass.settings.max_depth {
            tally.truncated += 1;
            tally.power_truncated += self.received();
            return false;
        }
        goes_on
    }

    /// Continues from a flat Lambert surface; [`Self::meet`] handles all others. Here the roulette does not depend on
    /// the direction, so it comes first, and only survivors sample a direction.
    #[inline(always)]
    fn reflect(&mut self, kind: MapKind, hit: &DiffuseHit, photons: &mut Stored) -> bool {
        self.store(kind, (hit.surface, hit.position(), hit.facing_normal()), 1.0, photons);
        if kind == MapKind::Caustic || !self.survives(self.power * at_line(self.line, hit.reflectance)) {
            return false;
        }
        self.only_specular = false;
        self.chain = 0;
        let local = Lambert::sample_direction(self.rng.next_2d());
        self.ray = hit.spawn(Frame::from_z(hit.facing_normal()).to_world(local));
        true
    }

    /// Continues from any surface.
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
            // Light after a null interface counts as a caustic, because shadow rays end at the interface.
            self.medium = after;
            self.ray = hit.spawn(self.ray.direction);
            return true;
        }
        self.meet_surface(pass, &hit, photons, tally)
    }

    /// Continues from any surface that is no null interface.
    #[inline(always)]
    fn meet_surface(
        &mut self,
        pass: &Batch<'_>,
        hit: &SurfaceInteraction,
        photons: &mut Stored,
        tally: &mut PhotonTally,
    ) -> bool {
        let mut shading = pass.scene.shading_for(hit, self.medium, self.line);
        let mut reflected = None;
        let wavelengths = pass.settings.wavelengths;
        if shading.disperses && self.line.is_none() && wavelengths != Wavelengths::Off {
            if hit.shading_normal == hit.point.normal {
                reflected = pass.scene.reflected_colour(hit, self.medium, &shading, wavelengths);
            }
            if reflected.is_none() {
                self.disperse(wavelengths);
                shading = pass.scene.shading_for(hit, self.medium, self.line);
            }
        }
        let is_receiver = || pass.receivers.binary_search(&hit.surface).is_ok();
        if !pass.in_media && (shading.bsdf.has_diffuse() || is_receiver()) {
            // Photon density on the surface includes the cosine at the geometric normal; the reflected light has the
            // cosine at the shading normal.
            let at = (hit.surface, hit.point.position, hit.facing_normal());
            self.store(pass.settings.kind, at, shading_share(hit), photons);
        }
        let is_lobe_left = shading.bsdf.has_specular() || shading.bsdf.has_glossy();
        if pass.settings.kind == MapKind::Caustic && !is_lobe_left {
            return false;
        }
        let goes_on = self.scatter(pass, hit, (&shading, reflected), tally);
        goes_on && (self.only_specular || pass.settings.kind != MapKind::Caustic)
    }

    /// Stores the photon at its position, on the side of `normal`, with `share` of its power.
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
        let power = (power, self.line);
        photons.photons.push(Photon::of_line(position, power, -self.ray.direction, normal, class, dither));
        if let Some(surfaces) = &mut photons.surfaces {
            surfaces.push(surface);
        }
    }

    /// Samples the ray on which the photon continues, and its new power; `false` where it ends here. `reflected` is the colour of light
    /// that a smooth interface reflects, where only light that it refracts needs a wavelength.
    fn scatter(
        &mut self,
        pass: &Batch<'_>,
        hit: &SurfaceInteraction,
        (shading, reflected): (&Shading, Option<Rgb>),
        tally: &mut PhotonTally,
    ) -> bool {
        let scene = pass.scene;
        let u_lobe = if shading.bsdf.chooses() { self.rng.next_f32() } else { 0.0 };
        let u = if shading.bsdf.is_delta() { Vec2::ZERO } else { self.rng.next_2d() };
        let bent = hit.shading_normal != hit.point.normal;
        // The diffuse lobe would end a caustic photon, so only the other lobes are sampled.
        let is_mixed = pass.settings.kind == MapKind::Caustic && !bent && shading.bsdf.has_diffuse();
        let (u_lobe, share) = if is_mixed { without_diffuse(shading, u_lobe) } else { (u_lobe, 1.0) };
        let found = match (&shading.bsdf, bent) {
            (_, false) => sampled(shading, u_lobe, u),
            (Bsdf::Lambert(_), true) => sampled_around_geometric(hit, shading, u),
            (_, true) => {
                let flat = SurfaceInteraction { shading_normal: hit.point.normal, ..*hit };
                let flat = scene.shading_for(&flat, self.medium, self.line);
                let candidates = candidates(hit, shading, &flat, (u_lobe, u));
                one_of(candidates, || self.rng.next_f32())
            }
        };
        let Some((mut sample, mut direction)) = found else { return false };
        let at_wavelength;
        let shading = match reflected {
            Some(colour) if !sample.transmission => {
                sample.throughput *= colour;
                shading
            }
            Some(_) => {
                self.disperse(pass.settings.wavelengths);
                at_wavelength = scene.shading_for(hit, self.medium, self.line);
                let refracted = sampled(&at_wavelength, ONE_MINUS_EPSILON, u);
                let share = refracted_share(&at_wavelength, shading);
                let (Some(refracted), Some(share)) = (refracted, share) else { return false };
                (sample, direction) = refracted;
                sample.throughput *= share;
                &at_wavelength
            }
            None => shading,
        };
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
        let power = self.power * at_line(self.line, sample.throughput * (weight * share));
        if power.max_element() > LARGEST_GROWTH * self.started_with {
            tally.truncated += 1;
            self.power = power;
            tally.power_truncated += self.received();
            tally.power_absorbed -= self.received();
            return false;
        }
        // Photons are aimed at a surface in proportion to the share that it mirrors, so photons that arrive at a weak
        // mirror carry more power. Roulette must not undo this.
        let expected = if is_mixed && self.depth == 0 { mirrored_share(&shading.bsdf) } else { 1.0 };
        if !self.survives_below(power, expected) {
            return false;
        }
        self.medium = medium;
        self.ray = hit.spawn(direction);
        true
    }

    /// Counts the photon once if it meets interfaces, and once if one of them states another medium on this side. The
    /// photon continues in the stated medium, so that one mistake is not counted again at each later interface.
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

    /// Chromatic roulette after a surface, with `power` as the remaining power: the brightest channel decides, so that
    /// photons keep their power and no channel of a survivor exceeds it.
    #[inline(always)]
    fn survives(&mut self, power: Rgb) -> bool {
        self.survives_below(power, 1.0)
    }

    /// [`Self::survives`] where photons are expected to keep the share `expected` of their power: a photon that keeps
    /// at least this share always survives.
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
