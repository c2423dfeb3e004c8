//! Photon beams of one medium.

use super::super::kd_tree::{KdTree, Point};
use super::box_tree::{Bounds, BoxTree};
use super::fade::Fade;
use super::nearest::Nearest;
use super::points::{decode_length, encode_length, median};
use super::record::BeamRecord;
use crate::math::Rgb;
use crate::media::Volume;
use crate::media::density::{Density, Line};
use crate::photons::power::PackedPower;
use crate::sampling::{Rng, Stream};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Pieces into which each beam is divided for searches, and whose middles give the widths.
const PIECES: usize = 16;

/// Pieces whose distances give the density of beams at a place.
const NEAREST: usize = 24;

/// Beams that cross a disc of the width of a beam.
const ACROSS: f32 = 6.0;

/// Widths are within this factor of the median.
const RANGE: f32 = 4.0;

/// Least sine of the angle between a beam and a ray: below, the photon at a point takes the place of the beam, because the estimate has the
/// variance of `1 / sin^2`.
pub(super) const LEAST_SINE: f32 = 0.1;

const LEAF: usize = 8;

/// A beam: 28 bytes.
#[derive(Clone, Copy, Debug)]
struct Beam {
    start: Vec3,
    end: Vec3,
    power: PackedPower,
}

/// The middle of a piece.
#[derive(Clone, Copy)]
struct Middle {
    position: Vec3,
    /// Number of the beam times [`PIECES`], plus that of the piece.
    id: u32,
}

impl Point for Middle {
    fn position(&self) -> Vec3 {
        self.position
    }

    fn tag(&self) -> u16 {
        0
    }

    fn tie(&self) -> u64 {
        self.id.into()
    }
}

/// Beams of one medium.
#[derive(Clone, Debug)]
pub(super) struct BeamMap {
    beams: Vec<Beam>,
    /// Half the width of each beam at the ends of its pieces: `PIECES + 1` of each beam.
    widths: Vec<u16>,
    /// Pieces in the order of the boxes.
    pieces: Vec<u32>,
    boxes: BoxTree,
    per_emitted: f32,
}

/// Most beams of a map: the number of a piece has four bytes.
pub(in crate::photons) const MOST_BEAMS: usize = u32::MAX as usize / PIECES;

impl BeamMap {
    /// Of `records`, of a pass that emitted `emitted` photons. `widest` bounds the width where there are few beams.
    pub(super) fn build(records: &[BeamRecord], emitted: u64, widest: f32) -> Self {
        let mut rng = Rng::new(emitted, Stream::Media, !(records.len() as u64));
        let beams: Vec<Beam> = records
            .iter()
            .take(MOST_BEAMS)
            .map(|record| {
                let power = PackedPower::encode(record.power, record.line, rng.next_f32());
                Beam { start: record.start, end: record.end, power }
            })
            .collect();
        let mut middles: Vec<Middle> = (0..(beams.len() * PIECES) as u32)
            .map(|id| {
                let Beam { start, end, .. } = beams[id as usize / PIECES];
                let share = (id as usize % PIECES) as f32 + 0.5;
                Middle { position: start.lerp(end, share / PIECES as f32), id }
            })
            .collect();
        let tree = KdTree::<LEAF>::build(&mut middles);
        let spacing = |id: u32| {
            let Beam { start, end, .. } = beams[id as usize / PIECES];
            start.distance(end) / PIECES as f32
        };
        let nearest = NEAREST.min(middles.len());
        let found: Vec<f32> = middles
            .par_iter()
            .map_init(
                || Nearest::new(nearest),
                |search, middle| {
                    search.clear();
                    tree.search(middle.position, search);
                    let Some(radius) = search.radius().filter(|&radius| radius > 0.0) else { return widest };
                    // Length of beams in the ball over its volume: beams across a unit of area.
                    let length: f32 = search.indices().map(|index| spacing(middles[index].id)).sum();
                    let density = length / (4.0 / 3.0 * PI * radius * radius * radius);
                    (ACROSS / (PI * density)).sqrt().min(widest)
                },
            )
            .collect();
        let mut by_piece = vec![0.0; found.len()];
        for (middle, width) in middles.iter().zip(&found) {
            by_piece[middle.id as usize] = *width;
        }
        let usual = median(&found);
        let widths: Vec<u16> = by_piece
            .chunks(PIECES)
            .zip(&beams)
            .flat_map(|(pieces, beam)| {
                let size = beam.start.abs().max_element().max(beam.end.abs().max_element());
                let least = 8.0 * f32::EPSILON * size.max(f32::MIN_POSITIVE / f32::EPSILON);
                (0..=PIECES).map(move |node| {
                    let [a, b] = [node.saturating_sub(1), node.min(PIECES - 1)].map(|piece| pieces[piece]);
                    encode_length((a * b).sqrt().clamp(usual / RANGE, usual * RANGE).max(least))
                })
            })
            .collect();
        let pieces: Vec<u32> = middles.iter().map(|middle| middle.id).collect();
        let mut map = Self {
            beams,
            widths,
            pieces,
            boxes: BoxTree::new(Vec::new()),
            per_emitted: 1.0 / emitted.max(1) as f32,
        };
        let leaves = map.pieces.par_chunks(LEAF).map(|pieces| map.bounds_of(pieces)).collect();
        map.boxes = BoxTree::new(leaves);
        map
    }

    /// Number of beams.
    pub(super) fn len(&self) -> usize {
        self.beams.len()
    }

    /// Bytes on the heap.
    pub(super) fn memory_bytes(&self) -> usize {
        self.beams.capacity() * size_of::<Beam>()
            + self.widths.capacity() * size_of::<u16>()
            + self.pieces.capacity() * size_of::<u32>()
            + self.boxes.memory_bytes()
    }

    /// Half the width at both ends of a piece.
    #[inline]
    fn widths_of(&self, id: u32) -> [f32; 2] {
        let (beam, piece) = (id as usize / PIECES, id as usize % PIECES);
        let first = beam * (PIECES + 1) + piece;
        [self.widths[first], self.widths[first + 1]].map(decode_length)
    }

    fn bounds_of(&self, pieces: &[u32]) -> Bounds {
        pieces.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |bounds, &id| {
            let Beam { start, end, .. } = self.beams[id as usize / PIECES];
            let piece = (id as usize % PIECES) as f32;
            let ends = [piece, piece + 1.0].map(|i| start.lerp(end, i / PIECES as f32));
            let [a, b] = self.widths_of(id);
            let room = Vec3::splat(a.max(b));
            let low = ends[0].min(ends[1]) - room;
            let high = ends[0].max(ends[1]) + room;
            [bounds[0].min(low), bounds[1].max(high)]
        })
    }

    /// Radiance that the beams scatter towards the start of a line, with transmittance `fade` up to there. The kernel across a beam is
    /// `15/16 (1 - x^2)^2 / w`, `x` the distance of both lines over `w`, half the width. `share` of each width is used. Pairs at an angle of
    /// a sine below [`LEAST_SINE`] are left out.
    pub(super) fn along(
        &self,
        (line, length): (&Line, f64),
        (volume, fade): (&Volume, &Fade<'_>),
        share: f32,
    ) -> Rgb {
        let (origin, direction) = (line.origin().as_vec3(), line.direction().as_vec3());
        let length = length as f32;
        let phase = volume.phase();
        let is_homogeneous = matches!(volume.density(), Density::Homogeneous);
        let has_closed_form = volume.density().depth(line, 0.0).is_some();
        let mut sum = Rgb::ZERO;
        self.boxes.along(origin, direction, length, |leaf| {
            let ids = &self.pieces[leaf * LEAF..self.pieces.len().min((leaf + 1) * LEAF)];
            for &id in ids {
                let beam = &self.beams[id as usize / PIECES];
                let along = beam.end - beam.start;
                let across = direction.cross(along);
                let (sine_squared, whole_squared) = (across.length_squared(), along.length_squared());
                let offset = beam.start - origin;
                let apart = offset.dot(across);
                let [a, b] = self.widths_of(id);
                let widest = a.max(b) * share;
                // Most are too far away: found without a division. False for beams without a length too.
                let is_near = apart * apart < widest * widest * sine_squared;
                if !(is_near && sine_squared >= LEAST_SINE * LEAST_SINE * whole_squared) {
                    continue;
                }
                let whole = whole_squared.sqrt();
                // Distances along both lines to where they are nearest to each other; along the beam in pieces.
                let t = offset.cross(along).dot(across) / sine_squared;
                let at = offset.cross(direction).dot(across) / sine_squared * PIECES as f32;
                let piece = id as usize % PIECES;
                // The last piece has the end of the beam.
                let is_here = if piece == PIECES - 1 { at <= PIECES as f32 } else { at < (piece + 1) as f32 };
                if !(t > 0.0 && t < length && at >= piece as f32 && is_here) {
                    continue;
                }
                let s = at / PIECES as f32 * whole;
                let width = (a + (b - a) * (at - piece as f32)) * share;
                let x = apart / (sine_squared.sqrt() * width);
                let (sine, towards) = (sine_squared.sqrt() / whole, along / whole);
                let rest = 1.0 - x * x;
                if !(rest > 0.0) {
                    continue;
                }
                let mut weight =
                    phase.eval(-direction, -towards) * (15.0 / 16.0) * rest * rest / (width * sine);
                if !is_homogeneous {
                    let place = line.at(t.into());
                    weight *= volume.density().at(place) as f32;
                }
                let mut found = beam.power.decode() * weight;
                if is_homogeneous {
                    // Both exponentials at once.
                    found *= fade.at(s + t);
                } else {
                    found *= fade.at(t);
                    if has_closed_form
                        && let Some(line) = Line::new(beam.start.as_dvec3(), towards.as_dvec3())
                    {
                        found *= volume.exact_transmittance(&line, s.into()).unwrap_or(Rgb::ONE);
                    }
                }
                sum += found;
            }
        });
        sum * volume.coefficients().scattering() * self.per_emitted
    }
}
