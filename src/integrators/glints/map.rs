//! Map of glints by their place on the image, and additional camera samples in the glints of a pixel.

use super::chain::Chain;
use super::finder::{Glint, GlintFinder};
use crate::camera::{Camera, CameraRay, FilmPlace};
use crate::film::FilterSampler;
use crate::lights::LightId;
use crate::math::{Ray, Rgb};
use crate::sampling::{Rng, warp};
use crate::scene::{CameraMedia, Scene};
use crate::transport::emission_along;
use glam::{IVec2, Vec2};

/// Largest number of glints of one pixel that are sampled: the strongest ones.
const MOST_IN_PIXEL: usize = 64;

/// Number of additional samples for each of the pixel's own samples.
const RAYS: usize = 4;

/// Two glints are the same if the centre of one lies within the other's ellipse scaled by this share.
const SAME: f32 = 0.5;

/// Weight of a glint whose centre lies outside of the filter, as a share of the weight at the filter's centre.
const OUTSIDE: f32 = 0.05;

/// All glints that were found, sorted by pixel.
#[derive(Clone, Debug, Default)]
pub struct GlintMap {
    /// Glints pixel by pixel, row by row.
    glints: Vec<Glint>,
    /// For each pixel with glints, its position and the index of its first glint.
    pixels: Vec<((i32, i32), usize)>,
    /// Longest semi-axis of all ellipses.
    reach: f32,
}

/// How often camera samples hit emitters with small images behind specular chains by chance, by blocks of pixels of the whole image.
///
/// A single small image is hit by few samples. Where there are many images, as between mirrors that face each other, samples often hit
/// one of them, each time another one.
#[derive(Clone, Debug, Default)]
pub struct ChanceMeetings {
    /// Number of blocks in a row.
    across: usize,
    /// Hits per camera sample, by block, row by row.
    rates: Vec<f32>,
}

impl ChanceMeetings {
    /// Side of a block in pixels.
    pub const BLOCK: u32 = 8;

    /// For an image of this size. `met` has the position of each searched pixel and its hits, as a mean over the rays that started
    /// there. Pixels in which no search started do not count in the mean of their block.
    pub fn new((width, height): (u32, u32), met: impl IntoIterator<Item = ((u32, u32), f32)>) -> Self {
        let across = width.div_ceil(Self::BLOCK) as usize;
        let mut sums = vec![(0.0, 0u32); across * height.div_ceil(Self::BLOCK) as usize];
        for ((x, y), value) in met {
            let (sum, count) = &mut sums[(y / Self::BLOCK) as usize * across + (x / Self::BLOCK) as usize];
            *sum += value;
            *count += 1;
        }
        let rate = |(sum, count): (f32, u32)| if count > 0 { sum / count as f32 } else { 0.0 };
        Self { across, rates: sums.into_iter().map(rate).collect() }
    }

    /// Hits per camera sample around the pixel with this `center`.
    fn around(&self, center: Vec2) -> f32 {
        let block = (center.max(Vec2::ZERO) / Self::BLOCK as f32).as_uvec2();
        let column = (block.x as usize).min(self.across.saturating_sub(1));
        self.rates.get(block.y as usize * self.across + column).copied().unwrap_or(0.0)
    }
}

fn pixel_of(glint: &Glint) -> (i32, i32) {
    let at = glint.ellipse.middle().floor().as_ivec2();
    (at.y, at.x)
}

impl GlintMap {
    /// The map of all glints found; duplicates are merged.
    pub fn new(mut found: Vec<Glint>) -> Self {
        found.sort_by_key(pixel_of);
        let mut map = Self::default();
        for of_pixel in found.chunk_by(|a, b| pixel_of(a) == pixel_of(b)) {
            let first = map.glints.len();
            for glint in of_pixel {
                let known = map.glints[first..]
                    .iter_mut()
                    .find(|known| known.chain == glint.chain && known.ellipse.is_near(&glint.ellipse, SAME));
                match known {
                    Some(known) => known.weight = known.weight.max(glint.weight),
                    None => map.glints.push(*glint),
                }
            }
            map.glints[first..].sort_by(|a, b| b.weight.total_cmp(&a.weight));
            map.glints.truncate(first + MOST_IN_PIXEL);
            map.pixels.push((pixel_of(&of_pixel[0]), first));
        }
        map.reach = map.glints.iter().map(|glint| glint.ellipse.reach()).fold(0.0, f32::max);
        map
    }

    /// Number of glints.
    pub fn len(&self) -> usize {
        self.glints.len()
    }

    /// Whether there are no glints.
    pub fn is_empty(&self) -> bool {
        self.glints.is_empty()
    }

    /// The glints of the pixel with this `center`; `None` where there are none.
    pub fn of_pixel<'a>(&'a self, center: Vec2, sampler: &'a FilterSampler) -> Option<PixelGlints<'a>> {
        if self.is_empty() {
            return None;
        }
        let radius = Vec2::splat(sampler.radius());
        let (low, high) = (center - radius, center + radius);
        let cell = |at: Vec2| -> IVec2 { at.floor().as_ivec2() };
        let (first, last) = (cell(low - self.reach), cell(high + self.reach));
        let mut glints = Vec::new();
        for row in first.y..=last.y {
            let start = self.pixels.partition_point(|&(at, _)| at < (row, first.x));
            for (i, &(at, begin)) in self.pixels.iter().enumerate().skip(start) {
                if at > (row, last.x) {
                    break;
                }
                let end = self.pixels.get(i + 1).map_or(self.glints.len(), |next| next.1);
                glints.extend(self.glints[begin..end].iter().copied().filter(|glint| {
                    let (middle, reach) = (glint.ellipse.middle(), glint.ellipse.reach());
                    (middle + reach).cmpgt(low).all() && (middle - reach).cmplt(high).all()
                }));
            }
        }
        let most = sampler.density(Vec2::ZERO).0 * OUTSIDE;
        let weight =
            |glint: &Glint| glint.weight * (sampler.density(glint.ellipse.offset_from(center)).0 + most);
        glints.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
        glints.truncate(MOST_IN_PIXEL);
        let total: f32 = glints.iter().map(weight).sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let choices = glints.iter().map(|glint| (*glint, weight(glint) / total)).collect();
        Some(PixelGlints { choices, center, sampler })
    }
}

/// The glints of a pixel.
#[derive(Clone, Debug)]
pub struct PixelGlints<'a> {
    /// The glints, each with the probability with which it is sampled.
    choices: Vec<(Glint, f32)>,
    center: Vec2,
    sampler: &'a FilterSampler,
}

impl PixelGlints<'_> {
    /// Expected number of additional samples that follow `chain`, for each of the pixel's own samples and per square pixel, at an
    /// `offset` from its centre. A sample that came from the glint `drawn` counts as inside it, though rounding may place it outside.
    fn density(&self, chain: &Chain, offset: Vec2, drawn: Option<usize>) -> f32 {
        let contains = |i: usize, glint: &Glint| {
            drawn == Some(i) || (glint.chain == *chain && glint.ellipse.contains(self.center, offset))
        };
        let of_chain = self.choices.iter().enumerate().filter(|(i, (glint, _))| contains(*i, glint));
        of_chain.map(|(_, (glint, choice))| choice / glint.ellipse.area()).sum::<f32>() * RAYS as f32
    }

    /// Light that additional samples find for one of the pixel's own samples, through the same point of the `lens`. The film adds it
    /// with the `weight` of that sample.
    pub fn radiance(
        &self,
        (scene, media): (&Scene, CameraMedia),
        (camera, size, lens): (&Camera, Vec2, Vec2),
        weight: f32,
        mut numbers: Rng,
    ) -> Rgb {
        let mut sum = Rgb::ZERO;
        // Each sample covers its own part of the disc, because one glint may cause most of the light. The first part is random, so that
        // no part is tied to a glint.
        let first = (numbers.next_u64() % RAYS as u64) as usize;
        for i in 0..RAYS {
            let mut u = (i as f32 + numbers.next_f32()) / RAYS as f32;
            let v = numbers.next_2d();
            let part = ((first + i) % RAYS) as f32;
            let disc = warp::square_to_disc(Vec2::new((part + v.x) / RAYS as f32, v.y));
            let chosen = self.choices.iter().position(|(_, choice)| {
                u -= choice;
                u < 0.0
            });
            // Rounding may leave a remainder.
            let chosen = chosen.unwrap_or(self.choices.len() - 1);
            let (glint, _) = &self.choices[chosen];
            let offset = glint.ellipse.offset_from(self.center) + glint.ellipse.at(disc);
            let place = FilmPlace { size, center: self.center, offset };
            let (own, sign) = self.sampler.density(place.offset);
            if own == 0.0 {
                continue;
            }
            let ray = CameraRay::new(camera, place, lens).ray;
            let Some(end) = glint.chain.follow(scene, ray, media.at(scene, ray.origin)) else { continue };
            let found = emission_along(scene, &end.ray, end.medium);
            if found == Rgb::ZERO {
                continue;
            }
            let all = own * end.chance + self.density(&glint.chain, offset, Some(chosen));
            sum += found * end.throughput * (own * sign / (all * weight));
        }
        if sum.is_finite() { sum } else { Rgb::ZERO }
    }
}

/// Glint data that a camera sample needs.
#[derive(Clone, Copy, Debug)]
pub struct GlintView<'a> {
    /// Place of the sample on the image.
    pub camera: &'a CameraRay<'a>,
    /// Filter by which the pixel was sampled.
    pub sampler: &'a FilterSampler,
    /// Glints of the sample's pixel, which additional samples cover ([`PixelGlints::radiance`]).
    pub pixel: Option<&'a PixelGlints<'a>>,
    /// The finder of these glints.
    pub hunter: &'a GlintFinder<'a>,
    /// How often emitters are hit by chance.
    pub meetings: &'a ChanceMeetings,
    /// Number of camera samples of the pixel, if light hit by chance is limited to what these samples resolve.
    pub samples: Option<f32>,
}

impl GlintView<'_> {
    /// MIS weight of an emitter that the sample hits behind a chain by this `ray`; and whether the weight is reduced because hits are
    /// rare.
    pub(in crate::integrators) fn weight(&self, chain: &Chain, id: LightId, ray: &Ray) -> (f32, bool) {
        let place = self.camera.place();
        let own = self.sampler.density(place.offset).0;
        let further = self.pixel.map_or(0.0, |pixel| pixel.density(chain, place.offset, None));
        if further > 0.0 {
            // Followed again with the same numbers, the chain ends at the same point.
            let chance = self.hunter.chance(self.camera, chain).unwrap_or(0.0);
            return if chance > 0.0 {
                (own * chance / (own * chance + further), false)
            } else {
                (1.0, false)
            };
        }
        match self.samples {
            Some(samples) => {
                let certainty = self.hunter.certainty(self.camera, *chain, (id, ray), (samples, own));
                // Each single image is rare, but hitting one of them is not.
                let often = samples * self.meetings.around(self.camera.place().center);
                let certainty = certainty.max(often.min(1.0));
                (certainty, certainty < 1.0)
            }
            None => (1.0, false),
        }
    }
}
