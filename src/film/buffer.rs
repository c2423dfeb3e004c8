//! Film and tiles: sums over the samples of each pixel, and their means.

mod bits;
mod halved;
mod state;

pub use halved::{HalvedSum, Halves, Precision};

use super::{AOVS, Aov, LayerSet, PixelRect};
use crate::math::Rgb;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use thiserror::Error;

/// The contribution of one camera sample to its pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSample {
    /// Radiance of each part, W/(m^2 sr), in the order of [`AOVS`].
    pub radiance: [Rgb; 5],
    /// Hemispherical reflectance of the first surface; black where there is none.
    pub albedo: Rgb,
    /// Shading normal of the first surface, world space, unit length; zero where there is none.
    pub normal: Vec3,
    /// Distance from the camera to the first surface, metres; infinite where there is none.
    pub depth: f32,
    /// Number of the object, below 2^24.
    pub object_id: Option<u32>,
    /// Number of the material, below 2^24.
    pub material_id: Option<u32>,
    /// Estimate of the bias: the excess of the expectation of the sum of [`Self::radiance`] over the true radiance. Zero where there is
    /// no estimate.
    pub bias: Rgb,
}

impl Default for PixelSample {
    /// The sample of a ray that hits nothing and carries no light.
    fn default() -> Self {
        Self {
            radiance: [Rgb::ZERO; 5],
            albedo: Rgb::ZERO,
            normal: Vec3::ZERO,
            depth: f32::INFINITY,
            object_id: None,
            material_id: None,
            bias: Rgb::ZERO,
        }
    }
}

impl PixelSample {
    /// Adds `radiance` to one part.
    pub fn add(&mut self, aov: Aov, radiance: Rgb) {
        self.radiance[aov as usize] += radiance;
    }
}

/// An error of creating a film or of merging a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FilmError {
    /// A picture without pixels.
    #[error("a picture of {width} x {height} pixels has no pixel; both must be at least 1")]
    Empty {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// A crop window that is empty or not inside the picture.
    #[error(
        "the crop window {},{} to {},{} is empty or not inside the picture of {width} x {height} pixels",
        crop.x0, crop.y0, crop.x1, crop.y1
    )]
    Crop {
        /// The window.
        crop: PixelRect,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// The machine does not have enough memory.
    #[error("no memory for a picture of {width} x {height} pixels; render it in crop windows")]
    Memory {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// The tile belongs to another film.
    #[error("a tile does not belong to this film: its pixels or its layers are others")]
    Foreign,
}

/// Samples that were not added, with the reason for the first. No sample is dropped silently.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejections {
    /// Samples left out because a value was NaN or infinite, or the pixel is not in the tile.
    pub samples: u64,
    /// Pixel of the first of them, and the layer or reason.
    pub first: Option<(u32, u32, &'static str)>,
    /// Samples with light in a part for which the film has no buffer. Their other parts were added.
    pub unplanned: u64,
}

impl Rejections {
    fn merge(&mut self, later: &Self) {
        self.samples += later.samples;
        self.first = self.first.or(later.first);
        self.unplanned += later.unplanned;
    }
}

/// Majority vote over numbers, in constant space (Boyer & Moore, "MJRTY: A Fast Majority Vote Algorithm", 1981). The candidate is the
/// number that more than half of the samples have; without a majority it is one of the numbers that occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Vote {
    candidate: Option<u32>,
    lead: u32,
}

impl Vote {
    fn add(&mut self, id: Option<u32>, is_first: bool) {
        if self.candidate == id || is_first {
            *self = Self { candidate: id, lead: self.lead.saturating_add(1) };
        } else if self.lead == 0 {
            *self = Self { candidate: id, lead: 1 };
        } else {
            self.lead -= 1;
        }
    }

    fn merge(&mut self, later: Self, is_first: bool) {
        if is_first {
            *self = later;
        } else if self.candidate == later.candidate {
            self.lead = self.lead.saturating_add(later.lead);
        } else if self.lead >= later.lead {
            self.lead -= later.lead;
        } else {
            *self = Self { candidate: later.candidate, lead: later.lead - self.lead };
        }
    }
}

/// Offset of each layer's sums within those of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    set: LayerSet,
    aovs: [usize; 5],
    beauty: usize,
    albedo: usize,
    normal: usize,
    /// Offset of the sum of distances; the number of samples with a distance follows.
    depth: usize,
    bias: usize,
    stride: usize,
}

impl Layout {
    fn new(set: LayerSet) -> Self {
        let mut stride = 0;
        let mut place = |present: bool, channels: usize| {
            let start = stride;
            stride += if present { channels } else { 0 };
            start
        };
        let aovs = set.aovs.map(|present| place(present, 3));
        let beauty = place(set.beauty, 3);
        let albedo = place(set.albedo, 3);
        let normal = place(set.normal, 3);
        let depth = place(set.depth, 2);
        let bias = place(set.bias, 3);
        Self { set, aovs, beauty, albedo, normal, depth, bias, stride }
    }

    /// The sum of all parts, of the values of a pixel.
    fn picture(&self, values: &[f64]) -> DVec3 {
        let at = |start: usize| DVec3::from_slice(&values[start..][..3]);
        if self.set.beauty {
            return at(self.beauty);
        }
        AOVS.into_iter().filter(|&aov| self.set.has(aov)).map(|aov| at(self.aovs[aov as usize])).sum()
    }

    /// The sum of bias estimates, of the values of a pixel; zero without that layer.
    fn bias(&self, values: &[f64]) -> DVec3 {
        if self.set.bias { DVec3::from_slice(&values[self.bias..][..3]) } else { DVec3::ZERO }
    }

    /// Name of the first layer in which `sample` has a value that must not enter a sum.
    fn refuse(&self, sample: &PixelSample) -> Option<&'static str> {
        let bad_aov = AOVS.into_iter().find(|&aov| !sample.radiance[aov as usize].is_finite());
        let depth_is_bad = sample.depth.is_nan() || sample.depth == f32::NEG_INFINITY;
        bad_aov
            .map(Aov::name)
            .or((self.set.albedo && !sample.albedo.is_finite()).then_some("albedo"))
            .or((self.set.normal && !sample.normal.is_finite()).then_some("normal"))
            .or((self.set.depth && depth_is_bad).then_some("depth"))
            .or((self.set.bias && !sample.bias.is_finite()).then_some("bias"))
    }
}

/// Sums over the samples of each pixel of a rectangle.
#[derive(Clone, Debug)]
struct Sums {
    rect: PixelRect,
    layout: Layout,
    counts: Vec<u64>,
    weights: Vec<f64>,
    values: Vec<f64>,
    objects: Vec<Vote>,
    materials: Vec<Vote>,
    rejections: Rejections,
}

/// `n` zeros, or `None` where there is no memory for them.
fn zeros<T: Clone + Default>(n: Option<usize>) -> Option<Vec<T>> {
    let n = n?;
    let mut v = Vec::new();
    v.try_reserve_exact(n).ok()?;
    v.resize(n, T::default());
    Some(v)
}

impl Sums {
    fn new(rect: PixelRect, layout: Layout) -> Option<Self> {
        let area = (rect.width() as usize).checked_mul(rect.height() as usize);
        let only_if = |present: bool| if present { area } else { Some(0) };
        Some(Self {
            rect,
            layout,
            counts: zeros(area)?,
            weights: zeros(area)?,
            values: zeros(area.and_then(|n| n.checked_mul(layout.stride)))?,
            objects: zeros(only_if(layout.set.object_id))?,
            materials: zeros(only_if(layout.set.material_id))?,
            rejections: Rejections::default(),
        })
    }

    fn add(&mut self, x: u32, y: u32, weight: f32, sample: &PixelSample) {
        let index = self.rect.index(x, y);
        let reason = match index {
            None => Some("pixel outside the tile"),
            Some(_) if !weight.is_finite() => Some("filter weight"),
            Some(_) => self.layout.refuse(sample),
        };
        let (Some(index), None) = (index, reason) else {
            let first = reason.map(|reason| (x, y, reason));
            self.rejections.merge(&Rejections { samples: 1, first, unplanned: 0 });
            return;
        };
        let layout = self.layout;
        let weight = f64::from(weight);
        let values = &mut self.values[index * layout.stride..][..layout.stride];
        let mut add = |start: usize, v: Vec3| {
            for (sum, value) in values[start..start + 3].iter_mut().zip(v.to_array()) {
                *sum += weight * f64::from(value);
            }
        };
        let mut is_planned = true;
        for aov in AOVS {
            let radiance = sample.radiance[aov as usize];
            match layout.set.has(aov) {
                true => add(layout.aovs[aov as usize], radiance),
                false => is_planned &= layout.set.beauty || radiance == Rgb::ZERO,
            }
        }
        if layout.set.beauty {
            let radiance = sample.radiance.iter().map(|radiance| radiance.as_dvec3()).sum::<DVec3>();
            for (sum, value) in values[layout.beauty..][..3].iter_mut().zip(radiance.to_array()) {
                *sum += weight * value;
            }
        }
        let mut add = |start: usize, v: Vec3| {
            for (sum, value) in values[start..start + 3].iter_mut().zip(v.to_array()) {
                *sum += weight * f64::from(value);
            }
        };
        if layout.set.albedo {
            add(layout.albedo, sample.albedo);
        }
        if layout.set.normal {
            add(layout.normal, sample.normal);
        }
        if layout.set.bias {
            add(layout.bias, sample.bias);
        }
        if layout.set.depth && sample.depth.is_finite() {
            values[layout.depth] += f64::from(sample.depth);
            values[layout.depth + 1] += 1.0;
        }
        let is_first = self.counts[index] == 0;
        if let Some(vote) = self.objects.get_mut(index) {
            vote.add(sample.object_id, is_first);
        }
        if let Some(vote) = self.materials.get_mut(index) {
            vote.add(sample.material_id, is_first);
        }
        self.counts[index] += 1;
        self.weights[index] += weight;
        self.rejections.unplanned += u64::from(!is_planned);
    }

    /// Adds `later`, whose rectangle lies inside this one.
    fn merge(&mut self, later: &Self) {
        let (across, stride) = (later.rect.width() as usize, self.layout.stride);
        for row in 0..later.rect.height() as usize {
            let Some(to) = self.rect.index(later.rect.x0, later.rect.y0 + row as u32) else {
                return;
            };
            let from = row * across;
            let values = &mut self.values[to * stride..(to + across) * stride];
            let added = &later.values[from * stride..(from + across) * stride];
            values.iter_mut().zip(added).for_each(|(sum, value)| *sum += value);
            for column in 0..across {
                let (to, from) = (to + column, from + column);
                if later.counts[from] == 0 {
                    continue;
                }
                let is_first = self.counts[to] == 0;
                if let Some(vote) = self.objects.get_mut(to) {
                    vote.merge(later.objects[from], is_first);
                }
                if let Some(vote) = self.materials.get_mut(to) {
                    vote.merge(later.materials[from], is_first);
                }
                self.counts[to] += later.counts[from];
                self.weights[to] += later.weights[from];
            }
        }
        self.rejections.merge(&later.rejections);
    }
}

/// A rectangle of a film with its own sums, filled by one thread.
#[derive(Clone, Debug)]
pub struct Tile(Sums);

impl Tile {
    /// Its pixels, in coordinates of the whole picture.
    pub fn rect(&self) -> PixelRect {
        self.0.rect
    }

    /// Adds a sample to the pixel `(x, y)` of the picture, with the weight of its [`super::FilterSample`]. A sample
    /// that is not finite or lies outside this tile is left out and counted as rejected.
    pub fn add(&mut self, x: u32, y: u32, weight: f32, sample: &PixelSample) {
        self.0.add(x, y, weight, sample);
    }
}

/// All pixels of a picture, or of a crop window of it: sums in `f64`, row 0 at the top.
///
/// The mean of a pixel is its sum divided by the sum of weights. With positive filters all weights are 1 and this is the plain mean.
/// With Mitchell's filter this is slightly biased, but division by the number of samples would make a constant picture noisy. Where
/// negative weights cancel more than half of the samples, the sum is divided by the number of samples, so that no value grows without
/// bound.
#[derive(Clone, Debug)]
pub struct Film {
    width: u32,
    height: u32,
    sums: Sums,
}

impl Film {
    /// A black film of `width` x `height` pixels, of which only `crop` (the whole picture if `None`) has buffers.
    pub fn new(
        width: u32,
        height: u32,
        crop: Option<PixelRect>,
        layers: LayerSet,
    ) -> Result<Self, FilmError> {
        let whole = PixelRect::whole(width, height);
        if width == 0 || height == 0 {
            return Err(FilmError::Empty { width, height });
        }
        let rect = crop.unwrap_or(whole);
        if rect.is_empty() || !whole.contains_rect(&rect) {
            return Err(FilmError::Crop { crop: rect, width, height });
        }
        let sums = Sums::new(rect, Layout::new(layers)).ok_or(FilmError::Memory { width, height })?;
        Ok(Self { width, height, sums })
    }

    /// Pixels across the whole picture.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down the whole picture.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The crop window; the whole picture where none was set.
    pub fn rect(&self) -> PixelRect {
        self.sums.rect
    }

    /// The set of buffers.
    pub fn layers(&self) -> LayerSet {
        self.sums.layout.set
    }

    /// An empty tile of these pixels, to be filled and merged.
    pub fn tile(&self, rect: PixelRect) -> Result<Tile, FilmError> {
        if rect.is_empty() || !self.rect().contains_rect(&rect) {
            return Err(FilmError::Foreign);
        }
        let memory = FilmError::Memory { width: self.width, height: self.height };
        Sums::new(rect, self.sums.layout).map(Tile).ok_or(memory)
    }

    /// Adds a tile. The last bits of `f64` sums depend on the order of addition: merge the tiles of a pass in the order of
    /// [`PixelRect::tiles`], and the passes one after another.
    pub fn merge(&mut self, tile: &Tile) -> Result<(), FilmError> {
        if tile.0.layout != self.sums.layout || !self.rect().contains_rect(&tile.rect()) {
            return Err(FilmError::Foreign);
        }
        self.sums.merge(&tile.0);
        Ok(())
    }

    /// Adds all samples of another film with the same pixels and layers.
    pub fn add(&mut self, other: &Self) -> Result<(), FilmError> {
        if (self.width, self.height, self.rect(), self.sums.layout)
            != (other.width, other.height, other.rect(), other.sums.layout)
        {
            return Err(FilmError::Foreign);
        }
        self.sums.merge(&other.sums);
        Ok(())
    }

    /// The picture and its bias estimate at each pixel, row by row: weighted means in `f64`, zero where there is no sample or no such
    /// layer.
    pub fn means_and_biases(&self) -> impl Iterator<Item = [DVec3; 2]> + '_ {
        let layout = self.sums.layout;
        (0..self.sums.counts.len()).map(move |pixel| {
            let divisor = self.divisor(pixel);
            let values = &self.sums.values[pixel * layout.stride..][..layout.stride];
            let mean = |sum: DVec3| divisor.map_or(DVec3::ZERO, |divisor| sum / divisor);
            [mean(layout.picture(values)), mean(layout.bias(values))]
        })
    }

    /// Divisor of the sums of a pixel; `None` where it has no sample.
    fn divisor(&self, pixel: usize) -> Option<f64> {
        divisor_of(self.sums.counts[pixel], self.sums.weights[pixel])
    }

    /// Samples that were left out so far.
    pub fn rejections(&self) -> Rejections {
        self.sums.rejections
    }

    /// Numbers of the objects and of the materials that pixels show.
    pub fn ids(&self) -> [BTreeSet<u32>; 2] {
        [&self.sums.objects, &self.sums.materials]
            .map(|votes| votes.iter().filter_map(|vote| vote.candidate).collect())
    }

    /// Samples added so far.
    pub fn sample_count(&self) -> u64 {
        self.sums.counts.iter().sum()
    }

    /// The means of all samples added so far.
    pub fn develop(&self) -> Developed {
        let Layout { set, aovs, beauty, albedo, normal, bias, .. } = self.sums.layout;
        let rgb: &[&str] = &["R", "G", "B"];
        let mut layers: Vec<Layer> = AOVS
            .into_iter()
            .filter(|&aov| set.has(aov))
            .map(|aov| Layer { name: aov.name(), channels: rgb, values: self.means(aovs[aov as usize]) })
            .collect();
        let values = if set.beauty { self.means(beauty) } else { self.sum_of(&layers) };
        layers.insert(0, Layer { name: "beauty", channels: rgb, values });
        let mut push = |present: bool, name, channels, values: &dyn Fn() -> Vec<f32>| {
            if present {
                layers.push(Layer { name, channels, values: values() });
            }
        };
        push(set.albedo, "albedo", rgb, &|| self.means(albedo));
        push(set.normal, "normal", &["X", "Y", "Z"], &|| self.means(normal));
        push(set.depth, "depth", &["Z"], &|| self.mean_depths());
        push(set.object_id, "object", &["id"], &|| ids(&self.sums.objects));
        push(set.material_id, "material", &["id"], &|| ids(&self.sums.materials));
        push(set.samples, "samples", &["n"], &|| self.sums.counts.iter().map(|&n| n as f32).collect());
        push(set.bias, "bias", rgb, &|| self.means(bias));
        Developed {
            width: self.width,
            height: self.height,
            rect: self.rect(),
            clamped: layers.iter().flat_map(|layer| &layer.values).filter(|v| v.abs() == f32::MAX).count()
                as u64,
            layers,
            unsampled: self.sums.counts.iter().filter(|&&n| n == 0).count() as u64,
            rejections: self.rejections(),
        }
    }

    /// Means of the three sums from `start` on, per pixel; zero where there is no sample.
    fn means(&self, start: usize) -> Vec<f32> {
        let Sums { counts, values, layout, .. } = &self.sums;
        let mut means = vec![0f32; 3 * counts.len()];
        means.par_chunks_mut(3).enumerate().for_each(|(pixel, mean)| {
            if let Some(divisor) = self.divisor(pixel) {
                let sums = &values[pixel * layout.stride + start..][..3];
                mean.iter_mut().zip(sums).for_each(|(mean, sum)| *mean = to_f32(sum / divisor));
            }
        });
        means
    }

    /// Sum of the layers, in `f64` over the rounded layers and rounded once. So the sum of the layers of a file equals the picture to the
    /// bit.
    fn sum_of(&self, layers: &[Layer]) -> Vec<f32> {
        let sum = |i: usize| to_f32(layers.iter().map(|layer| f64::from(layer.values[i])).sum());
        (0..3 * self.sums.counts.len()).into_par_iter().map(sum).collect()
    }

    fn mean_depths(&self) -> Vec<f32> {
        let Layout { depth, stride, .. } = self.sums.layout;
        let mean = |pixel: &[f64]| match pixel[depth + 1] {
            0.0 => f32::INFINITY,
            hits => to_f32(pixel[depth] / hits),
        };
        self.sums.values.chunks_exact(stride).map(mean).collect()
    }
}

/// Divisor of the sums of a pixel with this many samples and this sum of weights; `None` without samples.
fn divisor_of(count: u64, weight: f64) -> Option<f64> {
    let count = count as f64;
    (count > 0.0).then_some(if weight.abs() >= 0.5 * count { weight } else { count })
}

fn ids(votes: &[Vote]) -> Vec<f32> {
    votes.iter().map(|vote| vote.candidate.map_or(-1.0, |id| id as f32)).collect()
}

/// The nearest `f32`, at most its largest.
fn to_f32(x: f64) -> f32 {
    x.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
}

/// One layer of a developed picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name: `beauty`, the name of an [`Aov`], `albedo`, `normal`, `depth`, `object`, `material` or `samples`.
    pub name: &'static str,
    /// Names of the channels.
    pub channels: &'static [&'static str],
    /// Values of the pixels, row by row from the top, with interleaved channels.
    pub values: Vec<f32>,
}

/// Means of a film.
///
/// `beauty` comes first and is the sum of the parts that follow. Radiance is in W/(m^2 sr). Albedo and normal are filtered like radiance,
/// so normals do not have unit length where surfaces meet. `depth` is the plain mean in metres over the samples that hit a surface, and
/// infinite where none did. `object` and `material` hold the number that most samples of the pixel have, and -1 for nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Developed {
    /// Pixels across the whole picture.
    pub width: u32,
    /// Pixels down the whole picture.
    pub height: u32,
    /// The pixels that the layers hold.
    pub rect: PixelRect,
    /// The layers.
    pub layers: Vec<Layer>,
    /// Pixels without a sample; they are black.
    pub unsampled: u64,
    /// Number of values that were clamped to the largest `f32`.
    pub clamped: u64,
    /// Samples that were left out.
    pub rejections: Rejections,
}

impl Developed {
    /// The layer of that name.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.name == name)
    }

    /// The picture: linear RGB, row by row.
    pub fn beauty(&self) -> &[f32] {
        self.layer("beauty").map_or(&[], |layer| &layer.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Filter;
    use crate::sampling::{Rng, Stream};

    fn sample(rng: &mut Rng) -> PixelSample {
        let mut sample = PixelSample::default();
        AOVS.into_iter()
            .for_each(|aov| sample.add(aov, Rgb::splat(rng.next_f32()) * Rgb::new(1.0, 2.0, 3.0)));
        sample
    }

    #[test]
    fn beauty_is_the_sum_of_the_parts_to_the_bit() {
        let mut film = Film::new(7, 5, None, LayerSet::default()).unwrap();
        let mut tile = film.tile(film.rect()).unwrap();
        let mut rng = Rng::new(1, Stream::Measure, 20);
        for (x, y) in film.rect().pixels() {
            (0..9).for_each(|_| tile.add(x, y, 1.0, &sample(&mut rng)));
        }
        film.merge(&tile).unwrap();
        let developed = film.develop();
        assert_eq!(developed.layers.len(), 6);
        for i in 0..7 * 5 * 3 {
            let sum: f64 = AOVS.iter().map(|a| f64::from(developed.layer(a.name()).unwrap().values[i])).sum();
            assert_eq!(developed.beauty()[i], sum as f32);
        }
        assert_eq!(film.sample_count(), 7 * 5 * 9);
    }

    #[test]
    fn any_tiles_and_any_crop_give_the_same_bits() {
        let render = |crop: Option<PixelRect>, size: u32| {
            let mut film = Film::new(50, 41, crop, LayerSet::all()).unwrap();
            for pass in 0..3 {
                let tiles: Vec<Tile> = film
                    .rect()
                    .tiles(size)
                    .into_par_iter()
                    .map(|rect| {
                        let mut tile = film.tile(rect).unwrap();
                        for (x, y) in rect.pixels() {
                            let index = u64::from(y * 50 + x) * 3 + pass;
                            let mut rng = Rng::new(1, Stream::Camera, index);
                            (0..4).for_each(|_| tile.add(x, y, 1.0, &sample(&mut rng)));
                        }
                        tile
                    })
                    .collect();
                tiles.iter().for_each(|tile| film.merge(tile).unwrap());
            }
            film.develop()
        };
        let whole = render(None, 16);
        assert_eq!(whole, render(None, 7));
        let crop = PixelRect { x0: 3, y0: 9, x1: 30, y1: 40 };
        let part = render(Some(crop), 16);
        for (x, y) in crop.pixels() {
            let (i, j) = (crop.index(x, y).unwrap() * 3, (y * 50 + x) as usize * 3);
            assert_eq!(part.beauty()[i..i + 3], whole.beauty()[j..j + 3]);
        }
    }

    #[test]
    fn a_sample_that_is_not_finite_is_counted_and_left_out() {
        let mut film = Film::new(4, 4, None, LayerSet::all()).unwrap();
        let mut tile = film.tile(film.rect()).unwrap();
        let mut good = PixelSample { depth: 2.0, ..Default::default() };
        good.add(Aov::Direct, Rgb::ONE);
        tile.add(1, 2, 1.0, &good);
        tile.add(1, 2, 1.0, &PixelSample { normal: Vec3::splat(f32::NAN), ..good });
        tile.add(1, 2, 1.0, &PixelSample { depth: f32::NAN, ..good });
        tile.add(1, 2, f32::INFINITY, &good);
        tile.add(9, 2, 1.0, &good);
        let mut bad = good;
        bad.add(Aov::Caustics, Rgb::new(0.0, f32::INFINITY, 0.0));
        tile.add(3, 3, 1.0, &bad);
        film.merge(&tile).unwrap();
        let rejections = film.rejections();
        assert_eq!((rejections.samples, rejections.first), (5, Some((1, 2, "normal"))));
        let developed = film.develop();
        assert_eq!(developed.unsampled, 15);
        assert_eq!(developed.beauty()[(2 * 4 + 1) * 3], 1.0);
        assert!(developed.layers.iter().all(|l| l.name == "depth" || l.values.iter().all(|v| v.is_finite())));
    }

    #[test]
    fn layers_that_nobody_asked_for_do_not_exist() {
        let mut set = LayerSet::default();
        set.aovs[Aov::Caustics as usize] = false;
        let mut film = Film::new(2, 1, None, set).unwrap();
        assert_eq!(film.sums.values.len(), 2 * 12);
        let mut tile = film.tile(film.rect()).unwrap();
        let mut sample = PixelSample { albedo: Rgb::splat(f32::NAN), ..Default::default() };
        sample.add(Aov::Direct, Rgb::ONE);
        tile.add(0, 0, 1.0, &sample);
        sample.add(Aov::Caustics, Rgb::ONE);
        tile.add(1, 0, 1.0, &sample);
        film.merge(&tile).unwrap();
        let developed = film.develop();
        // Light without a buffer is counted as unplanned; an albedo without a buffer is not even checked.
        assert_eq!(developed.rejections, Rejections { samples: 0, first: None, unplanned: 1 });
        let names: Vec<&str> = developed.layers.iter().map(|l| l.name).collect();
        assert_eq!(names, ["beauty", "emission", "direct", "specular", "indirect"]);
    }

    #[test]
    fn auxiliary_layers() {
        let mut film = Film::new(2, 1, None, LayerSet::all()).unwrap();
        for ids in [[7, 7], [8, 7], [8, 7]] {
            let mut tile = film.tile(film.rect()).unwrap();
            for id in ids {
                let hit = PixelSample {
                    albedo: Rgb::splat(0.5),
                    normal: Vec3::Y,
                    depth: id as f32,
                    object_id: Some(id),
                    material_id: Some(3),
                    ..Default::default()
                };
                tile.add(0, 0, 1.0, &hit);
                tile.add(1, 0, 1.0, &PixelSample::default());
            }
            film.merge(&tile).unwrap();
        }
        let developed = film.develop();
        let values = |name: &str| developed.layer(name).unwrap().values.clone();
        assert_eq!(values("albedo"), [0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
        assert_eq!(values("normal"), [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(values("depth"), [44.0 / 6.0, f32::INFINITY]);
        assert_eq!((values("object"), values("material")), (vec![7.0, -1.0], vec![3.0, -1.0]));
    }

    #[test]
    fn negative_lobes_leave_a_constant_picture_constant() {
        let sampler = Filter::Mitchell { radius: 2.0 }.sampler().unwrap();
        let mut rng = Rng::new(2, Stream::Measure, 21);
        for n in [1, 2, 3, 16] {
            let mut film = Film::new(64, 64, None, LayerSet::default()).unwrap();
            let mut tile = film.tile(film.rect()).unwrap();
            let mut sample = PixelSample::default();
            sample.add(Aov::Indirect, Rgb::ONE);
            for (x, y) in film.rect().pixels() {
                (0..n).for_each(|_| tile.add(x, y, sampler.sample(rng.next_2d()).weight, &sample));
            }
            film.merge(&tile).unwrap();
            let developed = film.develop();
            assert!(developed.beauty().iter().all(|v| v.abs() <= 1.000_001), "{n}");
            let off = developed.beauty().iter().filter(|v| (**v - 1.0).abs() > 1e-6).count();
            assert!(off as f32 / 12288.0 < if n == 1 { 1e-9 } else { 0.35 }, "{n}: {off}");
        }
    }

    #[test]
    fn extremes_of_radiance() {
        let mut film = Film::new(2, 1, None, LayerSet::default()).unwrap();
        let mut tile = film.tile(film.rect()).unwrap();
        let mut huge = PixelSample::default();
        huge.add(Aov::Direct, Rgb::splat(f32::MAX));
        huge.add(Aov::Indirect, Rgb::splat(f32::MAX));
        (0..3).for_each(|_| tile.add(0, 0, 1.0, &huge));
        let mut tiny = PixelSample::default();
        tiny.add(Aov::Direct, Rgb::splat(1e-30));
        (0..3).for_each(|_| tile.add(1, 0, 1.0, &tiny));
        film.merge(&tile).unwrap();
        let developed = film.develop();
        assert!(developed.clamped > 0);
        assert_eq!(developed.beauty(), [f32::MAX, f32::MAX, f32::MAX, 1e-30, 1e-30, 1e-30]);
    }

    #[test]
    fn errors() {
        let layers = LayerSet::default();
        assert!(matches!(Film::new(0, 4, None, layers), Err(FilmError::Empty { .. })));
        let outside = PixelRect { x0: 2, y0: 0, x1: 5, y1: 1 };
        assert!(matches!(Film::new(4, 4, Some(outside), layers), Err(FilmError::Crop { .. })));
        assert!(matches!(Film::new(u32::MAX, u32::MAX, None, layers), Err(FilmError::Memory { .. })));
        let mut film = Film::new(4, 4, None, layers).unwrap();
        assert_eq!(film.tile(outside).err(), Some(FilmError::Foreign));
        let other = Film::new(4, 4, None, LayerSet::all()).unwrap();
        assert_eq!(film.merge(&other.tile(other.rect()).unwrap()), Err(FilmError::Foreign));
    }
}
