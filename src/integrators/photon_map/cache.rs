//! Filling and reading the irradiance cache (Jensen 1996, section 4.4). For the Lambertian surfaces that the camera sees, directly or
//! through specular ones, indirect light is gathered at a few places before the image is rendered.

use super::gather::{Start, cone_of};
use super::walk::{Walk, walk_specular};
use super::{PhotonMapIntegrator, Vertex};
use crate::caches::{CacheSettings, Filling, Hemisphere, Irradiance, Place, Record, Seen};
use crate::camera::{Camera, PixelSpread};
use crate::film::Aov;
use crate::integrators::{Counters, EyeRay, Scratch};
use crate::math::{Frame, Rgb};
use crate::photons::{GuideParams, LocalGuide, PhotonClass, PhotonClasses};
use crate::sampling::{Rng, SampleStream, Stream, mix};
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Spacing in pixels of the first candidates.
const COARSEST: u32 = 32;

/// Smallest number of rays of a hemisphere in a dense batch, unless fewer are requested.
const LEAST_RAYS: u32 = 64;

/// Number of photons that guide the rays of a hemisphere. More photons add little and take longer to find.
const GUIDING_PHOTONS: usize = 256;

/// Parameters of filling the cache.
#[derive(Clone, Copy, Debug)]
pub struct CacheRequest<'a> {
    /// The camera that sees the places where irradiance is needed.
    pub camera: &'a Camera,
    /// Width and height of the whole image in pixels. A crop window fills the cache for the whole image, so that it shows the same.
    pub size: (u32, u32),
    /// Seed of all random numbers.
    pub seed: u64,
    /// Largest allowed error of an interpolation (Ward, Rubinstein & Clear 1988).
    pub error: f32,
    /// Rays of a hemisphere where records are far apart; hemispheres use fewer where records are close to one another.
    pub rays: u32,
}

/// Statistics of filling the cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CachePass {
    /// Records in the cache.
    pub records: u64,
    /// Hemispheres that were rejected because their light was not finite.
    pub rejected: u64,
    /// Counts of rays and lookups.
    pub counters: Counters,
}

/// A batch of pixels: those on a grid of spacing `step` whose grid column and row have this parity.
#[derive(Clone, Copy, Debug)]
struct Batch {
    step: u32,
    parity: Parity,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Parity {
    Any,
    /// Both odd.
    Odd,
    /// One odd, one even.
    Mixed,
}

/// All pixels, each once, from coarse to fine. Each batch after the first two has about as many pixels as all batches before it.
fn batches() -> impl Iterator<Item = Batch> {
    let finer = (0..COARSEST.ilog2()).flat_map(|level| {
        let step = COARSEST >> (level + 1);
        [Batch { step, parity: Parity::Odd }, Batch { step, parity: Parity::Mixed }]
    });
    std::iter::once(Batch { step: COARSEST, parity: Parity::Any }).chain(finer)
}

impl Batch {
    /// Rays of a hemisphere, `most` at most. Where light changes quickly or surfaces are small, records lie close together; their noise
    /// is then averaged over more records and is less visible than that of one record that lights a whole wall.
    fn rays(&self, most: u32) -> u32 {
        let divisor = match self.step {
            0..=2 => 4,
            3..=4 => 2,
            _ => 1,
        };
        (most / divisor).max(LEAST_RAYS).min(most)
    }

    /// Pixel number `index` of the grid; `None` where the batch does not contain it.
    fn pixel(&self, index: u64, across: u64) -> Option<(u32, u32)> {
        let (i, j) = ((index % across) as u32, (index / across) as u32);
        let belongs = match self.parity {
            Parity::Any => true,
            Parity::Odd => i & j & 1 == 1,
            Parity::Mixed => (i ^ j) & 1 == 1,
        };
        belongs.then_some((i * self.step, j * self.step))
    }
}

impl PhotonMapIntegrator<'_> {
    /// Fills the irradiance cache from which the images are then rendered. The result is the same for any number of threads, unless
    /// `is_late` ends the pass early; the cache then keeps the records that it has. `None` where `is_cancelled` returns true.
    pub fn fill_cache(
        &mut self,
        request: &CacheRequest<'_>,
        is_cancelled: &(dyn Fn() -> bool + Sync),
        is_late: &(dyn Fn() -> bool + Sync),
        advance: &dyn Fn(u64),
    ) -> Option<CachePass> {
        let (width, height) = request.size;
        let settings = CacheSettings { error: request.error, bounds: self.scene.bounds() };
        let mut filling = Filling::new(settings);
        let mut pass = CachePass::default();
        let mut done = 0;
        if !self.has_photons() {
            return Some(pass);
        }
        let should_stop = || is_cancelled() || is_late();
        for batch in batches() {
            let across = u64::from(width.div_ceil(batch.step));
            let grid = across * u64::from(height.div_ceil(batch.step));
            // Candidates where a record is needed: the place, the pixel, and the index of the surface within the pixel.
            let found: Vec<(Vec<Candidate>, Counters)> = (0..grid)
                .into_par_iter()
                .filter_map(|index| batch.pixel(index, across))
                .map_init(Scratch::default, |scratch, pixel| {
                    let mut wanted = Vec::new();
                    if !should_stop() {
                        self.visit_pixel(request, pixel, scratch, |candidate, _, _| {
                            if filling.wants(&candidate.place) {
                                wanted.push(candidate);
                            }
                        });
                    }
                    (wanted, std::mem::take(&mut scratch.counters))
                })
                .collect();
            done += found.len() as u64;
            let mut candidates = Vec::new();
            for (of_pixel, counters) in found {
                candidates.extend(of_pixel);
                pass.counters += counters;
            }
            let places: Vec<Place> = candidates.iter().map(|candidate| candidate.place).collect();
            let rays = batch.rays(request.rays);
            let computed: Vec<(Option<Record>, Counters)> = filling
                .choose(&places)
                .into_par_iter()
                .with_max_len(1)
                .map_init(Scratch::default, |scratch, chosen| {
                    let record = if should_stop() {
                        None
                    } else {
                        self.record(request, rays, &candidates[chosen], scratch)
                    };
                    (record, std::mem::take(&mut scratch.counters))
                })
                .collect();
            if is_cancelled() {
                return None;
            }
            pass.counters += computed.iter().fold(Counters::default(), |mut sum, &(_, counters)| {
                sum += counters;
                sum
            });
            filling.accept(computed.into_iter().filter_map(|(record, _)| record));
            advance(done);
            if is_late() {
                break;
            }
        }
        pass.rejected = filling.rejected();
        let cache = filling.finish();
        pass.records = cache.len() as u64;
        self.cache = (!cache.is_empty()).then_some(cache);
        Some(pass)
    }

    /// Calls `visit` for each surface visible at the centre of a pixel whose indirect light is interpolated.
    fn visit_pixel(
        &self,
        request: &CacheRequest<'_>,
        (x, y): (u32, u32),
        scratch: &mut Scratch,
        mut visit: impl FnMut(Candidate, &Vertex<'_>, &mut Scratch),
    ) {
        let (width, height) = request.size;
        let size = Vec2::new(width as f32, height as f32);
        let at = |dx: f32| request.camera.ray((Vec2::new(x as f32, y as f32) + Vec2::new(dx, 0.5)) / size);
        let spread = PixelSpread::between(&at(0.0), &at(1.0));
        let pixel = u64::from(y) * u64::from(width) + u64::from(x);
        let mut samples = SampleStream::new(mix(request.seed ^ Stream::IrradianceCache as u64), pixel, 0);
        let mut number = 0;
        let walk = Walk {
            scene: self.scene,
            max_depth: self.settings.max_depth,
            glossy_samples: 1,
            samples_lights: false,
            wavelengths: self.settings.wavelengths,
            media: None,
        };
        let eye = at(0.5);
        let medium = self.camera_media.at(self.scene, eye.origin);
        walk_specular(walk, &EyeRay::alone(eye), medium, &mut samples, scratch, &mut {
            |vertex: &Vertex<'_>, _: &mut SampleStream, scratch: &mut Scratch| {
                if self.is_cached(vertex) {
                    visit(
                        Candidate { pixel: (x, y), number, place: place_of(vertex, spread) },
                        vertex,
                        scratch,
                    );
                }
                number += 1;
                [(Aov::Indirect, Rgb::ZERO)]
            }
        });
    }

    /// Whether indirect light at a vertex is interpolated. This holds for Lambertian surfaces that are computed accurately.
    fn is_cached(&self, vertex: &Vertex<'_>) -> bool {
        let is_lambert = vertex.shading.bsdf.lambertian().is_some();
        is_lambert
            && vertex.shading.bsdf.has_diffuse()
            && (vertex.depth == 1 || vertex.weight >= self.settings.approximate_weight)
    }

    /// Indirect radiance interpolated from the cache; `None` where there is no cache or no record reaches the vertex.
    pub(super) fn cached(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> Option<Rgb> {
        let cache = self.cache.as_ref()?;
        let lambert = vertex.shading.bsdf.lambertian()?;
        let (position, normal) = (vertex.hit.point.position, vertex.shading.frame.z);
        let connects = |place, facing| self.scene.connects(vertex.hit, place, facing);
        let found = cache.interpolate(position, normal, vertex.medium, connects);
        match found {
            Some(_) => scratch.counters.cache_hits += 1,
            None => scratch.counters.cache_misses += 1,
        }
        found.map(|irradiance| lambert.reflectance * irradiance * FRAC_1_PI)
    }

    /// Computes the record of a candidate. The camera ray of its pixel is traced again to find it.
    fn record(
        &self,
        request: &CacheRequest<'_>,
        rays: u32,
        candidate: &Candidate,
        scratch: &mut Scratch,
    ) -> Option<Record> {
        let mut record = None;
        self.visit_pixel(request, candidate.pixel, scratch, |found, vertex, scratch| {
            if found.number == candidate.number {
                let (x, y) = candidate.pixel;
                let pixel = u64::from(y) << 32 | u64::from(x);
                let rng =
                    Rng::new(request.seed, Stream::IrradianceCache, mix(pixel) ^ u64::from(found.number));
                let irradiance = self.hemisphere(vertex, rays, rng, scratch);
                record = Some(Record { place: found.place, irradiance });
            }
        });
        record
    }

    /// Gathers the irradiance over a vertex. Where nearby photons show from where light comes, half of the rays are sampled towards it.
    fn hemisphere(&self, vertex: &Vertex<'_>, rays: u32, mut rng: Rng, scratch: &mut Scratch) -> Irradiance {
        let Vertex { hit, shading, .. } = *vertex;
        // Rotated at random, so that the strata of neighbouring records do not align.
        let frame = Frame::from_z(shading.frame.z);
        let (sin, cos) = (TAU * rng.next_f32()).sin_cos();
        let axes = Mat3::from_cols(frame.x * cos + frame.y * sin, frame.y * cos - frame.x * sin, frame.z);
        let weight = vertex.weight * shading.bsdf.albedo(shading.wo_local).max_element();
        let guide = self.local_guide(vertex, scratch);
        let lobe = guide.as_ref().and_then(|guide| guide.turned(shading.frame.z));
        let hemisphere = if lobe.is_some() { Hemisphere::guided(rays) } else { Hemisphere::with_rays(rays) };
        let expected = |local: Vec3| lobe.as_ref().map_or(1.0, |lobe| lobe.over_lambert(axes * local));
        let irradiance = hemisphere.gather(&mut rng, expected, |local, u| {
            // Directions that lie above the shading normal but below the surface are replaced by others.
            let direction = shading.diffuse_direction(axes * local, u);
            let Some(medium) = self.scene.medium_after(vertex.medium, hit, shading, direction, false) else {
                return Seen::NOTHING;
            };
            let ray = hit.spawn(direction);
            let start = Start {
                ray,
                medium,
                partner: None,
                collided: None,
                indirect: true,
                recursion: 0,
                weight,
                depth: vertex.depth,
                travelled: vertex.travelled,
                cone: cone_of(rays, local.z * FRAC_1_PI),
            };
            let found = self.gather(&start, u, scratch);
            Seen { radiance: found.indirect, nearest: found.nearest, distance: found.distance }
        });
        irradiance.turned(axes)
    }
}

impl PhotonMapIntegrator<'_> {
    /// Directional distribution of the photons around a vertex; `None` without photons.
    fn local_guide(&self, vertex: &Vertex<'_>, scratch: &mut Scratch) -> Option<LocalGuide> {
        let map = self.maps.global.as_ref().filter(|map| !map.is_empty())?;
        let params = GuideParams {
            classes: PhotonClasses::only(PhotonClass::Indirect),
            nearest: GUIDING_PHOTONS,
            per_cell: 0,
            floor: 0.0,
            region: self.settings.region,
            max_radius: self.settings.max_radius,
        };
        let (position, normal) = (vertex.hit.point.position, vertex.hit.facing_normal());
        Some(LocalGuide::new(map, &params, position, normal, &mut scratch.photons))
    }
}

/// A place where a record may be needed, with the pixel and surface that it belongs to.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    pixel: (u32, u32),
    /// Index of the surface among those that the pixel shows over specular paths.
    number: u32,
    place: Place,
}

fn place_of(vertex: &Vertex<'_>, spread: PixelSpread) -> Place {
    let hit = vertex.hit;
    // Side of a square with the area of the pixel on the surface; at most about three times the short side.
    let cosine = hit.wo.dot(hit.point.normal).abs().max(0.1);
    Place {
        position: hit.point.position,
        normal: vertex.shading.frame.z,
        medium: vertex.medium,
        footprint: spread.at(vertex.travelled) / cosine.sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_hold_every_pixel_once() {
        for (width, height) in [(1u32, 1u32), (33, 5), (64, 64), (100, 47)] {
            let mut seen = vec![0; (width * height) as usize];
            let mut counts = Vec::new();
            for batch in batches() {
                let across = u64::from(width.div_ceil(batch.step));
                let grid = across * u64::from(height.div_ceil(batch.step));
                let before: i32 = seen.iter().sum();
                for (x, y) in (0..grid).filter_map(|index| batch.pixel(index, across)) {
                    seen[(y * width + x) as usize] += 1;
                }
                counts.push(seen.iter().sum::<i32>() - before);
            }
            assert!(seen.iter().all(|&n| n == 1), "{width} x {height}");
            assert_eq!(counts.len(), 11);
        }
    }
}
