//! Sums of a picture together with those of its two independent halves, and how the sums of a block of rounds are rounded and kept.

use super::bits::{Code, Inflated, Planes, short};
use super::{Film, FilmError, LayerSet, Layout, PixelRect, Sums, Vote, divisor_of, zeros};
use glam::DVec3;
use rayon::prelude::*;
use std::io::{self, ErrorKind, Read, Write};

/// Explicit bits of mantissa of what only the estimate of the error reads: the picture of the even half (an error of 0.1 %, where a half
/// of 8 rounds rarely has a noise below 1 %), and the estimates of bias (3 %, where their noise is about their size).
const HALF_BITS: u32 = 9;
const BIAS_BITS: u32 = 4;

/// Pixels in a piece of work.
const PIXELS_AT_ONCE: usize = 4096;

/// Most values of a pixel: five parts, picture, albedo, normal, depth and bias.
const MOST_VALUES: usize = 29;

/// Precision of the sums of a block of rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// As they were added up, in `f64`: the only block of a picture.
    Exact,
    /// Single precision; the even half and the estimates of bias have fewer bits, since only the estimate of the error reads them.
    Rounded,
}

/// Sums of one half at a pixel: what the estimate of the error needs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Half {
    count: u64,
    weight: f64,
    picture: DVec3,
    bias: DVec3,
}

impl Half {
    fn add(&mut self, later: &Self) {
        self.count += later.count;
        self.weight += later.weight;
        self.picture += later.picture;
        self.bias += later.bias;
    }

    fn means(&self) -> [DVec3; 2] {
        let mean = |sum: DVec3| divisor_of(self.count, self.weight).map_or(DVec3::ZERO, |n| sum / n);
        [mean(self.picture), mean(self.bias)]
    }
}

/// Sums of the even and of the odd rounds of a picture, for the estimate of its error.
#[derive(Clone, Debug)]
pub struct Halves {
    rect: PixelRect,
    pixels: Vec<[Half; 2]>,
}

impl Halves {
    /// Halves without samples, of these pixels; `None` where there is no memory for them.
    pub fn new(rect: PixelRect) -> Option<Self> {
        Some(Self { rect, pixels: zeros(Some(rect.area()))? })
    }

    /// Means of the picture and of its bias in both halves, pixel by pixel.
    pub fn means(&self) -> impl Iterator<Item = [[DVec3; 2]; 2]> + '_ {
        self.pixels.iter().map(|halves| halves.each_ref().map(Half::means))
    }

    /// Takes over the sums of some of these pixels.
    pub fn put(&mut self, from: &Self) {
        for ((x, y), halves) in from.rect.pixels().zip(&from.pixels) {
            if let Some(pixel) = self.rect.index(x, y).and_then(|i| self.pixels.get_mut(i)) {
                *pixel = *halves;
            }
        }
    }
}

/// Sums of all samples of a picture, and of its even and odd rounds apart.
#[derive(Clone, Debug)]
pub struct HalvedSum {
    film: Film,
    halves: Halves,
}

/// One pixel of two halves that are added up with this precision: writes the values of the whole to `values`, and returns its sum of
/// weights and both halves.
fn combine(halves: [&Sums; 2], pixel: usize, precision: Precision, values: &mut [f64]) -> (f64, [Half; 2]) {
    let layout = halves[0].layout;
    let of = |half: &'_ Sums| -> std::ops::Range<usize> {
        let stride = half.layout.stride;
        pixel * stride..(pixel + 1) * stride
    };
    let [even, odd] = halves.map(|half| &half.values[of(half)]);
    let mut parts = [even, odd].map(|values| Half {
        count: 0,
        weight: 0.0,
        picture: layout.picture(values),
        bias: layout.bias(values),
    });
    for (part, half) in parts.iter_mut().zip(halves) {
        (part.count, part.weight) = (half.counts[pixel], half.weights[pixel]);
    }
    for (sum, (a, b)) in values.iter_mut().zip(even.iter().zip(odd)) {
        *sum = a + b;
    }
    if precision == Precision::Rounded {
        for part in &mut parts {
            part.weight = short(part.weight, 23);
            part.bias = part.bias.map(|x| short(x, BIAS_BITS));
        }
        values.iter_mut().for_each(|sum| *sum = short(*sum, 23));
        complete(layout, values, &mut parts);
    }
    (parts[0].weight + parts[1].weight, parts)
}

/// Makes what follows from the rounded sums of the whole and those of the even half.
fn complete(layout: Layout, values: &mut [f64], [even, odd]: &mut [Half; 2]) {
    let whole = layout.picture(values);
    even.picture = even.picture.map(|x| short(x, HALF_BITS));
    odd.picture = whole - even.picture;
    if layout.set.bias {
        (even.bias + odd.bias).write_to_slice(&mut values[layout.bias..]);
    }
}

impl HalvedSum {
    /// Sums without samples. The parameters are those of [`Film::new`].
    ///
    /// # Errors
    /// As for [`Film::new`].
    pub fn new(
        width: u32,
        height: u32,
        crop: Option<PixelRect>,
        layers: LayerSet,
    ) -> Result<Self, FilmError> {
        let film = Film::new(width, height, crop, layers)?;
        let halves = Halves::new(film.rect()).ok_or(FilmError::Memory { width, height })?;
        Ok(Self { film, halves })
    }

    /// The sum of two halves, which must have the same pixels and layers.
    ///
    /// # Errors
    /// If they have not, or there is no memory.
    pub fn of([mut film, odd]: [Film; 2], precision: Precision) -> Result<Self, FilmError> {
        let (width, height) = (film.width, film.height);
        let mut halves = Halves::new(film.rect()).ok_or(FilmError::Memory { width, height })?;
        if (width, height, film.rect(), film.sums.layout)
            != (odd.width, odd.height, odd.rect(), odd.sums.layout)
        {
            return Err(FilmError::Foreign);
        }
        let even = &film.sums;
        let stride = even.layout.stride;
        let mut values: Vec<f64> =
            zeros(Some(even.values.len())).ok_or(FilmError::Memory { width, height })?;
        let mut weights: Vec<f64> =
            zeros(Some(even.weights.len())).ok_or(FilmError::Memory { width, height })?;
        halves
            .pixels
            .par_chunks_mut(PIXELS_AT_ONCE)
            .zip(values.par_chunks_mut(PIXELS_AT_ONCE * stride.max(1)))
            .zip(weights.par_chunks_mut(PIXELS_AT_ONCE))
            .enumerate()
            .for_each(|(piece, ((halves, values), weights))| {
                let values = values.chunks_exact_mut(stride.max(1));
                for (i, ((half, values), weight)) in halves.iter_mut().zip(values).zip(weights).enumerate() {
                    let pixel = piece * PIXELS_AT_ONCE + i;
                    (*weight, *half) = combine([even, &odd.sums], pixel, precision, values);
                }
            });
        // Counts, votes and samples that were left out.
        film.sums.merge(&odd.sums);
        (film.sums.values, film.sums.weights) = (values, weights);
        Ok(Self { film, halves })
    }

    /// Adds a later block with the same pixels and layers.
    ///
    /// # Errors
    /// If the block has others.
    pub fn add(&mut self, later: &Self) -> Result<(), FilmError> {
        self.film.add(&later.film)?;
        self.halves.pixels.iter_mut().zip(&later.halves.pixels).for_each(|(sums, later)| {
            sums.iter_mut().zip(later).for_each(|(sum, later)| sum.add(later));
        });
        Ok(())
    }

    /// The film of all samples.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// The film of all samples, without the halves.
    pub fn into_film(self) -> Film {
        self.film
    }

    /// The halves.
    pub fn halves(&self) -> &Halves {
        &self.halves
    }

    /// The means of `sum`, where there is one, with a block added that these halves form.
    pub fn means_with<'a>(
        sum: Option<&'a Self>,
        block: &'a [Film; 2],
        precision: Precision,
    ) -> impl Iterator<Item = [[DVec3; 2]; 2]> + 'a {
        let sums = block.each_ref().map(|half| &half.sums);
        (0..block[0].rect().area()).map(move |pixel| {
            let mut values = [0.0; MOST_VALUES];
            let stride = sums[0].layout.stride.min(MOST_VALUES);
            let (_, added) = combine(sums, pixel, precision, &mut values[..stride]);
            let mut halves = sum.map_or_else(Default::default, |sum| sum.halves.pixels[pixel]);
            halves.iter_mut().zip(&added).for_each(|(half, added)| half.add(added));
            halves.each_ref().map(Half::means)
        })
    }

    /// Writes all sums, little-endian.
    ///
    /// # Errors
    /// If writing to `to` fails.
    pub fn save(&self, to: &mut impl Write) -> io::Result<()> {
        self.film.save(to)?;
        for half in self.halves.pixels.iter().flatten() {
            to.write_all(&half.count.to_le_bytes())?;
            let numbers = [[half.weight, 0.0, 0.0], half.picture.into(), half.bias.into()].concat();
            let numbers = numbers.iter().enumerate().filter(|(i, _)| !matches!(i, 1 | 2));
            numbers.into_iter().try_for_each(|(_, x)| to.write_all(&x.to_le_bytes()))?;
        }
        Ok(())
    }

    /// Replaces all sums with those that [`Self::save`] wrote for the same pixels and layers.
    ///
    /// # Errors
    /// If `from` ends too early or holds a sum that is not finite. The sums are then unusable.
    pub fn restore(&mut self, from: &mut impl Read) -> io::Result<()> {
        self.film.restore(from)?;
        let mut eight = || -> io::Result<[u8; 8]> {
            let mut bytes = [0; 8];
            from.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        for half in self.halves.pixels.iter_mut().flatten() {
            half.count = u64::from_le_bytes(eight()?);
            let mut number = || eight().map(f64::from_le_bytes);
            half.weight = number()?;
            half.picture = DVec3::new(number()?, number()?, number()?);
            half.bias = DVec3::new(number()?, number()?, number()?);
            if !(half.weight.is_finite() && half.picture.is_finite() && half.bias.is_finite()) {
                return Err(not_finite());
            }
        }
        Ok(())
    }

    /// The sums of these rows of the picture, compressed. They must have this precision.
    ///
    /// # Errors
    /// None in practice: the bytes go to memory.
    pub fn encode(&self, rows: std::ops::Range<u32>, precision: Precision) -> io::Result<Vec<u8>> {
        let rect = self.film.rect();
        let across = rect.width() as usize;
        let at = |row: u32| row.clamp(rect.y0, rect.y1).saturating_sub(rect.y0) as usize * across;
        let pixels = at(rows.start)..at(rows.end);
        let sums = &self.film.sums;
        let (layout, halves) = (sums.layout, &self.halves.pixels[pixels.clone()]);
        let values = &sums.values[pixels.start * layout.stride..pixels.end * layout.stride];
        let plan = PlanePlan::new(layout, precision);
        let mut planes = Planes::default();
        let before = |codes: &[u64], i: usize| if i == 0 { 0 } else { codes[i - 1] };
        for half in 0..2 {
            let counts: Vec<u64> = halves.iter().map(|halves| halves[half].count).collect();
            planes.push(8, &counts, |i| before(&counts, i));
            let weights: Vec<u64> = halves.iter().map(|halves| plan.full.of(halves[half].weight)).collect();
            planes.push(plan.full.width(), &weights, |i| before(&weights, i));
        }
        for &(start, channels, are_alike) in &plan.layers {
            let mut last: Option<Vec<u64>> = None;
            for channel in 0..channels {
                let codes: Vec<u64> = values
                    .chunks_exact(layout.stride)
                    .map(|values| plan.full.of(values[start + channel]))
                    .collect();
                let other = last.as_deref().filter(|_| are_alike);
                planes.push(plan.full.width(), &codes, |i| foreseen(i, &codes[..i], other));
                last = Some(codes);
            }
        }
        let pictures = |channel: usize| {
            values.chunks_exact(layout.stride.max(1)).map(move |values| layout.picture(values)[channel])
        };
        for channel in 0..3 {
            match precision {
                Precision::Exact => {
                    for half in 0..2 {
                        let codes: Vec<u64> =
                            halves.iter().map(|h| plan.half.of(h[half].picture[channel])).collect();
                        planes.push(plan.half.width(), &codes, |i| before(&codes, i));
                    }
                }
                Precision::Rounded => {
                    let codes: Vec<u64> =
                        halves.iter().map(|h| plan.half.of(h[0].picture[channel])).collect();
                    let middles: Vec<u64> = pictures(channel).map(|x| plan.middle(x)).collect();
                    planes.push(plan.half.width(), &codes, |i| middles[i]);
                }
            }
        }
        for half in (0..2).filter(|_| layout.set.bias) {
            for channel in 0..3 {
                let codes: Vec<u64> = halves.iter().map(|h| plan.bias.of(h[half].bias[channel])).collect();
                planes.push(plan.bias.width(), &codes, |i| before(&codes, i));
            }
        }
        for votes in [&sums.objects, &sums.materials].into_iter().filter(|votes| !votes.is_empty()) {
            let votes = &votes[pixels.clone()];
            let candidates: Vec<u64> =
                votes.iter().map(|vote| vote.candidate.map_or(0, |id| u64::from(id) + 1)).collect();
            planes.push(5, &candidates, |i| before(&candidates, i));
            let leads: Vec<u64> = votes.iter().map(|vote| u64::from(vote.lead)).collect();
            planes.push(4, &leads, |i| before(&leads, i));
        }
        planes.deflated()
    }

    /// Replaces all sums with those that [`Self::encode`] made of the same rows, of a sum with these layers.
    ///
    /// # Errors
    /// If the bytes are damaged or hold other layers. The sums are then unusable.
    pub fn decode(&mut self, bytes: &[u8], precision: Precision) -> io::Result<()> {
        let sums = &mut self.film.sums;
        let layout = sums.layout;
        let stride = layout.stride;
        let plan = PlanePlan::new(layout, precision);
        let mut planes = Inflated::new(bytes, self.halves.pixels.len(), plan.width(precision))?;
        let before = |i: usize, codes: &[u64]| if i == 0 { 0 } else { codes[i - 1] };
        for half in 0..2 {
            let counts = planes.take(8, before);
            let weights = planes.take(plan.full.width(), before);
            for (halves, (count, weight)) in
                self.halves.pixels.iter_mut().zip(counts.into_iter().zip(weights))
            {
                halves[half] = Half { count, weight: plan.full.number(weight), ..Half::default() };
            }
        }
        for &(start, channels, are_alike) in &plan.layers {
            let mut last: Option<Vec<u64>> = None;
            for channel in 0..channels {
                let other = last.as_deref().filter(|_| are_alike);
                let codes = planes.take(plan.full.width(), |i, codes| foreseen(i, codes, other));
                for (values, &code) in sums.values.chunks_exact_mut(stride).zip(&codes) {
                    values[start + channel] = plan.full.number(code);
                }
                last = Some(codes);
            }
        }
        for channel in 0..3 {
            match precision {
                Precision::Exact => {
                    for half in 0..2 {
                        let codes = planes.take(plan.half.width(), before);
                        for (halves, code) in self.halves.pixels.iter_mut().zip(codes) {
                            halves[half].picture[channel] = plan.half.number(code);
                        }
                    }
                }
                Precision::Rounded => {
                    let values = &sums.values;
                    let middle = |i: usize, _: &[u64]| {
                        plan.middle(layout.picture(&values[i * stride..(i + 1) * stride])[channel])
                    };
                    let codes = planes.take(plan.half.width(), middle);
                    for (halves, code) in self.halves.pixels.iter_mut().zip(codes) {
                        halves[0].picture[channel] = plan.half.number(code);
                    }
                }
            }
        }
        for half in (0..2).filter(|_| layout.set.bias) {
            for channel in 0..3 {
                let codes = planes.take(plan.bias.width(), before);
                for (halves, code) in self.halves.pixels.iter_mut().zip(codes) {
                    halves[half].bias[channel] = plan.bias.number(code);
                }
            }
        }
        for votes in [&mut sums.objects, &mut sums.materials].into_iter().filter(|votes| !votes.is_empty()) {
            let candidates = planes.take(5, before);
            let leads = planes.take(4, before);
            for (vote, (candidate, lead)) in votes.iter_mut().zip(candidates.into_iter().zip(leads)) {
                let candidate = candidate.checked_sub(1).map(|id| id as u32);
                *vote = Vote { candidate, lead: lead as u32 };
            }
        }
        for (pixel, halves) in self.halves.pixels.iter_mut().enumerate() {
            let values = &mut sums.values[pixel * stride..(pixel + 1) * stride];
            match precision {
                Precision::Rounded => complete(layout, values, halves),
                Precision::Exact if layout.set.bias => {
                    (halves[0].bias + halves[1].bias).write_to_slice(&mut values[layout.bias..]);
                }
                Precision::Exact => {}
            }
            sums.counts[pixel] = halves[0].count.saturating_add(halves[1].count);
            sums.weights[pixel] = halves[0].weight + halves[1].weight;
            let are_finite = |half: &Half| half.picture.is_finite() && half.bias.is_finite();
            let is_finite = sums.weights[pixel].is_finite() && values.iter().all(|x| x.is_finite());
            if !(is_finite && halves.iter().all(are_finite)) {
                return Err(not_finite());
            }
        }
        Ok(())
    }
}

fn not_finite() -> io::Error {
    io::Error::new(ErrorKind::InvalidData, "a sum is not finite")
}

/// The code foreseen for a pixel: that of the pixel before it, moved as the channel before this one has moved, where channels are alike.
fn foreseen(i: usize, codes: &[u64], other: Option<&[u64]>) -> u64 {
    match (i, other) {
        (0, _) => 0,
        (_, None) => codes[i - 1],
        (_, Some(other)) => codes[i - 1].wrapping_add(other[i].wrapping_sub(other[i - 1])),
    }
}

/// Which planes a block has, and how their numbers become codes.
struct PlanePlan {
    full: Code,
    half: Code,
    bias: Code,
    /// Start and number of channels of each layer but the bias, and whether its channels go up and down together.
    layers: Vec<(usize, usize, bool)>,
    layout: Layout,
}

impl PlanePlan {
    fn new(layout: Layout, precision: Precision) -> Self {
        let (full, half, bias) = match precision {
            Precision::Exact => (Code::Double, Code::Double, Code::Double),
            Precision::Rounded => (Code::Short(23), Code::Short(HALF_BITS), Code::Short(BIAS_BITS)),
        };
        let set = layout.set;
        let aovs = set.aovs.into_iter().zip(layout.aovs).map(|(there, start)| (there, start, 3, true));
        let others = [
            (set.beauty, layout.beauty, 3, true),
            (set.albedo, layout.albedo, 3, true),
            (set.normal, layout.normal, 3, false),
            (set.depth, layout.depth, 2, false),
        ];
        let layers = aovs.chain(others).filter(|layer| layer.0).map(|(_, a, b, c)| (a, b, c)).collect();
        Self { full, half, bias, layers, layout }
    }

    /// The code foreseen for the picture of the even half, where that of both is `whole`.
    fn middle(&self, whole: f64) -> u64 {
        let bits = if let Code::Short(bits) = self.half { bits } else { 23 };
        self.half.of(short(0.5 * whole, bits))
    }

    /// Bytes of a pixel before compression.
    fn width(&self, precision: Precision) -> usize {
        let set = self.layout.set;
        let values: usize = self.layers.iter().map(|layer| layer.1).sum();
        let halves = if precision == Precision::Exact { 6 } else { 3 };
        let votes = 9 * (usize::from(set.object_id) + usize::from(set.material_id));
        let bias = if set.bias { 6 * self.bias.width() } else { 0 };
        2 * (8 + self.full.width()) + values * self.full.width() + halves * self.half.width() + bias + votes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::PixelSample;
    use crate::math::Rgb;
    use crate::sampling::{Rng, Stream};
    use glam::Vec3;

    const SIZE: (u32, u32) = (19, 23);

    /// A half with noise, lights, negative weights and pixels without samples.
    fn half(layers: LayerSet, seed: u64) -> Film {
        let mut film = Film::new(SIZE.0, SIZE.1, None, layers).unwrap();
        let mut rng = Rng::new(seed, Stream::Measure, 3);
        for _ in 0..3 {
            let mut tile = film.tile(film.rect()).unwrap();
            for (x, y) in film.rect().pixels().filter(|&(x, y)| (x + y) % 7 != 0) {
                let bright = if rng.next_f32() < 0.01 { 1e6 } else { 1.0 };
                let mut value = || Rgb::new(rng.next_f32(), 2.0 * rng.next_f32(), 0.1 * rng.next_f32());
                let sample = PixelSample {
                    radiance: [bright * value(), value(), Rgb::ZERO, value(), value()],
                    albedo: value(),
                    normal: Vec3::new(0.6, -0.8, 0.0),
                    depth: if x % 5 == 0 { f32::INFINITY } else { 3.0 + value().x },
                    object_id: (x % 3 != 0).then_some(y),
                    material_id: Some(x / 4),
                    bias: value() - Rgb::splat(0.5),
                };
                tile.add(x, y, 1.2 - rng.next_f32(), &sample);
            }
            film.merge(&tile).unwrap();
        }
        film
    }

    fn bytes(sum: &HalvedSum) -> Vec<u8> {
        let mut bytes = Vec::new();
        sum.save(&mut bytes).unwrap();
        bytes
    }

    fn layer_sets() -> [LayerSet; 3] {
        [
            LayerSet::all(),
            LayerSet { bias: true, ..LayerSet::all() },
            LayerSet { bias: true, ..LayerSet::beauty() },
        ]
    }

    /// Sums of one band after another, from their bytes, are the sums of the whole.
    #[test]
    fn blocks_come_back_to_the_bit() {
        for layers in layer_sets() {
            for precision in [Precision::Exact, Precision::Rounded] {
                let sum = HalvedSum::of([half(layers, 1), half(layers, 2)], precision).unwrap();
                for rows in [0..9, 9..23] {
                    let rect = PixelRect { y0: rows.start, y1: rows.end, ..sum.film().rect() };
                    let mut back = HalvedSum::new(SIZE.0, SIZE.1, Some(rect), layers).unwrap();
                    let encoded = sum.encode(rows, precision).unwrap();
                    back.decode(&encoded, precision).unwrap();
                    for (i, (x, y)) in rect.pixels().enumerate() {
                        let whole = sum.film().rect().index(x, y).unwrap();
                        assert_eq!(
                            back.halves.pixels[i], sum.halves.pixels[whole],
                            "{layers:?} {precision:?}"
                        );
                        let stride = sum.film.sums.layout.stride;
                        let of = |film: &Film, i: usize| film.sums.values[i * stride..][..stride].to_vec();
                        assert_eq!(of(&back.film, i), of(&sum.film, whole));
                        assert_eq!(back.film.sums.counts[i], sum.film.sums.counts[whole]);
                        assert_eq!(back.film.sums.weights[i], sum.film.sums.weights[whole]);
                    }
                    let votes = |film: &Film| (film.sums.objects.clone(), film.sums.materials.clone());
                    let across = SIZE.0 as usize;
                    let rows = rect.y0 as usize * across..rect.y1 as usize * across;
                    if layers.object_id {
                        let (objects, materials) = votes(&sum.film);
                        let expected = (objects[rows.clone()].to_vec(), materials[rows].to_vec());
                        assert_eq!(votes(&back.film), expected);
                    }
                    assert!(back.decode(&encoded[..encoded.len() - 2], precision).is_err());
                }
            }
        }
    }

    /// A single block is the sum of its halves; rounding moves it by the last bits of single precision.
    #[test]
    fn rounding_moves_no_mean_by_more_than_single_precision() {
        let layers = LayerSet { bias: true, ..LayerSet::all() };
        let halves = || [half(layers, 1), half(layers, 2)];
        let mut plain = half(layers, 1);
        plain.add(&half(layers, 2)).unwrap();
        let exact = HalvedSum::of(halves(), Precision::Exact).unwrap();
        let saved = |film: &Film| {
            let mut bytes = Vec::new();
            film.save(&mut bytes).unwrap();
            bytes
        };
        assert_eq!(saved(exact.film()), saved(&plain));
        let rounded = HalvedSum::of(halves(), Precision::Rounded).unwrap();
        let (exact, rounded) = (exact.film().develop(), rounded.film().develop());
        for (a, b) in exact.layers.iter().zip(&rounded.layers) {
            for (a_value, b_value) in a.values.iter().zip(&b.values) {
                // Two roundings to 24 bits, of the sum and of its weight; bias is kept to 3 % of either half.
                let most = if a.name == "bias" { 0.1 } else { 3e-7 };
                let size = if a.name == "bias" { a_value.abs().max(1.0) } else { a_value.abs() };
                assert!(
                    a_value == b_value || (a_value - b_value).abs() <= most * size,
                    "{}: {a_value} {b_value}",
                    a.name
                );
            }
        }
    }

    /// The estimate of the error while a block is rendered is that of the sum when it is complete.
    #[test]
    fn means_before_and_after_a_block_is_added() {
        let layers = LayerSet { bias: true, ..LayerSet::all() };
        let block = |seed: u64| [half(layers, seed), half(layers, seed + 1)];
        let mut sum = HalvedSum::of(block(1), Precision::Rounded).unwrap();
        let before: Vec<_> = HalvedSum::means_with(Some(&sum), &block(3), Precision::Rounded).collect();
        sum.add(&HalvedSum::of(block(3), Precision::Rounded).unwrap()).unwrap();
        let after: Vec<_> = sum.halves().means().collect();
        assert_eq!(before, after);
        // Halves add up to the whole.
        let whole = sum.film().means_and_biases();
        for (pixel, ([picture, _], halves)) in whole.zip(&sum.halves.pixels).enumerate() {
            let both = halves[0].picture + halves[1].picture;
            let divisor = divisor_of(sum.film.sums.counts[pixel], sum.film.sums.weights[pixel]);
            let mean = divisor.map_or(DVec3::ZERO, |n| both / n);
            assert!(
                (mean - picture).abs().max_element() <= 1e-12 * picture.abs().max_element(),
                "{mean} {picture}"
            );
        }
        let mut back = HalvedSum::new(SIZE.0, SIZE.1, None, layers).unwrap();
        back.restore(&mut bytes(&sum).as_slice()).unwrap();
        assert_eq!(bytes(&back), bytes(&sum));
    }
}
