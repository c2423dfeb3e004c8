//! Serialization of a film's sums, so that a render can be resumed.

use super::{Film, Rejections, Vote};
use std::io::{self, ErrorKind, Read, Write};

/// Reasons for a rejected sample, as a saved film encodes them.
const REASONS: [&str; 12] = [
    "pixel outside the tile",
    "filter weight",
    "emission",
    "direct",
    "specular",
    "caustics",
    "indirect",
    "albedo",
    "normal",
    "depth",
    "bias",
    "sample",
];

impl Film {
    /// Writes all sums, little-endian. [`Self::restore`] reads them into a film with the same pixels and layers.
    ///
    /// # Errors
    /// If writing to `to` fails.
    pub fn save(&self, to: &mut impl Write) -> io::Result<()> {
        let sums = &self.sums;
        sums.counts.iter().try_for_each(|n| to.write_all(&n.to_le_bytes()))?;
        sums.weights.iter().chain(&sums.values).try_for_each(|x| to.write_all(&x.to_le_bytes()))?;
        for vote in sums.objects.iter().chain(&sums.materials) {
            // Numbers are below 2^24, so `u32::MAX` is free to mean none.
            to.write_all(&vote.candidate.unwrap_or(u32::MAX).to_le_bytes())?;
            to.write_all(&vote.lead.to_le_bytes())?;
        }
        let Rejections { samples, first, unplanned } = sums.rejections;
        let (x, y, reason) = first.unwrap_or((0, 0, ""));
        let reason = match first {
            None => u32::MAX,
            Some(_) => REASONS.iter().position(|&known| known == reason).unwrap_or(REASONS.len() - 1) as u32,
        };
        to.write_all(&samples.to_le_bytes())?;
        [x, y, reason].into_iter().try_for_each(|n| to.write_all(&n.to_le_bytes()))?;
        to.write_all(&unplanned.to_le_bytes())
    }

    /// Replaces all sums with those that [`Self::save`] wrote.
    ///
    /// # Errors
    /// If `from` ends too early or holds a sum that is not finite. The film is then unusable.
    pub fn restore(&mut self, from: &mut impl Read) -> io::Result<()> {
        let sums = &mut self.sums;
        for n in &mut sums.counts {
            *n = u64::from_le_bytes(bytes(from)?);
        }
        for x in sums.weights.iter_mut().chain(&mut sums.values) {
            *x = f64::from_le_bytes(bytes(from)?);
            if !x.is_finite() {
                return Err(io::Error::new(ErrorKind::InvalidData, "a sum is not finite"));
            }
        }
        for vote in sums.objects.iter_mut().chain(&mut sums.materials) {
            let candidate = u32::from_le_bytes(bytes(from)?);
            *vote = Vote {
                candidate: (candidate != u32::MAX).then_some(candidate),
                lead: u32::from_le_bytes(bytes(from)?),
            };
        }
        let samples = u64::from_le_bytes(bytes(from)?);
        let (x, y) = (u32::from_le_bytes(bytes(from)?), u32::from_le_bytes(bytes(from)?));
        let reason = REASONS.get(u32::from_le_bytes(bytes(from)?) as usize);
        let unplanned = u64::from_le_bytes(bytes(from)?);
        sums.rejections = Rejections { samples, first: reason.map(|&reason| (x, y, reason)), unplanned };
        Ok(())
    }
}

fn bytes<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use crate::film::{Film, LayerSet, PixelSample};
    use crate::math::Rgb;

    #[test]
    fn a_film_comes_back_to_the_bit_and_goes_on_alike() {
        let layers = LayerSet { bias: true, ..LayerSet::all() };
        let new = || Film::new(5, 3, None, layers).unwrap();
        let sample = |i: u32| PixelSample {
            radiance: [Rgb::new(0.1 * i as f32, 1.0 / 3.0, 7.0); 5],
            depth: if i.is_multiple_of(3) { f32::INFINITY } else { i as f32 },
            object_id: i.is_multiple_of(2).then_some(i % 4),
            bias: Rgb::new(-0.1, 0.2, if i == 8 { f32::NAN } else { 0.0 }),
            ..PixelSample::default()
        };
        let add = |film: &mut Film, range: std::ops::Range<u32>| {
            for i in range {
                let mut tile = film.tile(film.rect()).unwrap();
                tile.add(i % 5, i % 3, 0.7, &sample(i));
                film.merge(&tile).unwrap();
            }
        };
        let mut whole = new();
        add(&mut whole, 0..9);
        let mut kept = Vec::new();
        whole.save(&mut kept).unwrap();
        add(&mut whole, 9..30);
        let mut resumed = new();
        resumed.restore(&mut kept.as_slice()).unwrap();
        add(&mut resumed, 9..30);
        let bits = |film: &Film| {
            let mut bytes = Vec::new();
            film.save(&mut bytes).unwrap();
            bytes
        };
        assert_eq!(bits(&whole), bits(&resumed));
        assert_eq!(resumed.rejections(), whole.rejections());
        assert_eq!(resumed.rejections().first, Some((3, 2, "bias")));
        assert!(new().restore(&mut &kept[..kept.len() - 1]).is_err());
        kept[8 * 15..8 * 16].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(new().restore(&mut kept.as_slice()).is_err());
    }
}
