//! Photons at points of a medium, each with a kernel of its own width.

use super::super::kd_tree::{KdTree, Point};
use super::box_tree::{Bounds, BoxTree};
use super::fade::Fade;
use super::nearest::Nearest;
use super::record::PointRecord;
use crate::math::{Rgb, octahedral_decode, octahedral_encode};
use crate::media::Phase;
use crate::media::density::Line;
use crate::photons::power::PackedPower;
use crate::sampling::{Rng, Stream};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// Photons whose distances give the width of a kernel: the farthest of so many.
const NEAREST: usize = 30;

/// Kernels are at most this many times the median wide.
const WIDEST: f32 = 4.0;

/// Kernels are at least this many roundings of a coordinate wide.
const NARROWEST: f32 = 8.0 * f32::EPSILON;

const LEAF: usize = 32;
const WI_BITS: u32 = 8;

/// Photons of a leaf, field by field, so that vector units test all of them at once: 24 bytes each. Lanes beyond the last photon hold NaN
/// as position, which no search accepts.
#[derive(Clone, Debug)]
struct Block {
    x: [f32; LEAF],
    y: [f32; LEAF],
    z: [f32; LEAF],
    /// Widths of the kernels: [`encode_length`].
    radius: [u16; LEAF],
    power: [PackedPower; LEAF],
    wi: [u16; LEAF],
    /// Normals of the nearest surfaces, away from the photon.
    normal: [u16; LEAF],
    /// Distances of the planes of these surfaces: [`encode_length`], or [`FAR`].
    clear: [u16; LEAF],
}

const _: () = assert!(size_of::<Block>() == 24 * LEAF);

/// Distance of a surface beyond the kernel.
const FAR: u16 = u16::MAX;

/// A plane next to a photon, at which its kernel ends: light of a kernel that reached through it would be lost, or get to the wrong side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Unit normal, away from the photon.
    pub normal: Vec3,
    /// Distance from the photon; not negative.
    pub distance: f32,
}

impl Block {
    fn of(photons: &[Traced], radii: &[f32], nearest_plane: impl Fn(Vec3, f32) -> Option<Plane>) -> Self {
        let mut block = Self {
            x: [f32::NAN; LEAF],
            y: [f32::NAN; LEAF],
            z: [f32::NAN; LEAF],
            radius: [encode_length(1.0); LEAF],
            power: [PackedPower::default(); LEAF],
            wi: [0; LEAF],
            normal: [0; LEAF],
            clear: [FAR; LEAF],
        };
        for (lane, (photon, &radius)) in photons.iter().zip(radii).enumerate() {
            let p = photon.position;
            (block.x[lane], block.y[lane], block.z[lane]) = (p.x, p.y, p.z);
            block.radius[lane] = encode_length(radius);
            (block.power[lane], block.wi[lane]) = (photon.power, photon.wi);
            if let Some(plane) = nearest_plane(p, radius) {
                block.normal[lane] = octahedral_encode(plane.normal, WI_BITS) as u16;
                block.clear[lane] = encode_length(plane.distance.max(NARROWEST * radius));
            }
        }
        block
    }

    #[inline]
    fn position(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline]
    fn wi(&self, lane: usize) -> Vec3 {
        octahedral_decode(u32::from(self.wi[lane]), WI_BITS)
    }

    /// The surface nearest to a photon, if its kernel may reach it.
    #[inline]
    fn plane(&self, lane: usize) -> Option<Plane> {
        (self.clear[lane] != FAR).then(|| Plane {
            normal: octahedral_decode(u32::from(self.normal[lane]), WI_BITS),
            distance: decode_length(self.clear[lane]),
        })
    }

    /// Calls `visit` for each lane whose photon is nearer than `share` of its radius to the line, with the distance along the line and the
    /// squared distance from it over the squared radius.
    #[inline]
    fn along(&self, origin: Vec3, direction: Vec3, share: f32, mut visit: impl FnMut(usize, f32, f32)) {
        let mut t = [0f32; LEAF];
        let mut square = [0f32; LEAF];
        for i in 0..LEAF {
            let (x, y, z) = (self.x[i] - origin.x, self.y[i] - origin.y, self.z[i] - origin.z);
            t[i] = x * direction.x + y * direction.y + z * direction.z;
            let (x, y, z) = (x - t[i] * direction.x, y - t[i] * direction.y, z - t[i] * direction.z);
            let radius = decode_length(self.radius[i]) * share;
            square[i] = (x * x + y * y + z * z) / (radius * radius);
        }
        for lane in 0..LEAF {
            if square[lane] < 1.0 {
                visit(lane, t[lane], square[lane]);
            }
        }
    }

    /// Calls `visit` for each lane whose photon is nearer than `share` of its radius to a place, with the squared distance over the squared
    /// radius.
    #[inline]
    fn around(&self, place: Vec3, share: f32, mut visit: impl FnMut(usize, f32)) {
        let squares: [f32; LEAF] = std::array::from_fn(|i| {
            let (x, y, z) = (self.x[i] - place.x, self.y[i] - place.y, self.z[i] - place.z);
            let radius = decode_length(self.radius[i]) * share;
            (x * x + y * y + z * z) / (radius * radius)
        });
        for (lane, &square) in squares.iter().enumerate() {
            if square < 1.0 {
                visit(lane, square);
            }
        }
    }

    fn bounds(&self) -> Bounds {
        let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        for lane in (0..LEAF).filter(|&lane| !self.x[lane].is_nan()) {
            let radius = Vec3::splat(decode_length(self.radius[lane]));
            bounds[0] = bounds[0].min(self.position(lane) - radius);
            bounds[1] = bounds[1].max(self.position(lane) + radius);
        }
        bounds
    }
}

/// Share of the kernel `3/pi (1 - x^2)^2` over a disc on the side of its middle of a line at the distance `c` in [0, 1]: the integral of
/// `16 / (5 pi) (1 - x^2)^(5/2)` from -1 to `c`.
fn share_of_disc(c: f32) -> f32 {
    let rest = (1.0 - c * c).max(0.0);
    let root = rest.sqrt();
    let integral = c * root * (rest * rest / 6.0 + 5.0 / 24.0 * rest + 5.0 / 16.0)
        + 5.0 / 16.0 * c.clamp(-1.0, 1.0).asin();
    0.5 + 16.0 / 5.0 * FRAC_1_PI * integral
}

/// Share of the kernel `105/(32 pi) (1 - x^2)^2` over a ball on the side of its middle of a plane at the distance `c` in [0, 1].
fn share_of_ball(c: f32) -> f32 {
    let square = c * c;
    0.5 + 35.0 / 32.0 * c * (1.0 - square * (1.0 - square * (0.6 - square / 7.0)))
}

/// A length in the upper two bytes of its number, rounded down: within 0.8 %.
pub(super) fn encode_length(length: f32) -> u16 {
    // Not infinite, and not FAR.
    (length.min(f32::MAX).to_bits() >> 16) as u16
}

/// The length of [`encode_length`].
#[inline]
pub(super) fn decode_length(code: u16) -> f32 {
    f32::from_bits(u32::from(code) << 16)
}

/// A photon while the map is built.
#[derive(Clone, Copy)]
struct Traced {
    position: Vec3,
    power: PackedPower,
    wi: u16,
}

impl Point for Traced {
    fn position(&self) -> Vec3 {
        self.position
    }

    fn tag(&self) -> u16 {
        0
    }

    fn tie(&self) -> u64 {
        u64::from(u32::from_be_bytes(self.power.to_bytes())) << 16 | u64::from(self.wi)
    }
}

/// Photons at points of one medium.
#[derive(Clone, Debug)]
pub(super) struct PointMap {
    blocks: Vec<Block>,
    len: usize,
    boxes: BoxTree,
    /// One over the number of photons emitted.
    per_emitted: f32,
    /// Median width of the kernels.
    usual_width: f32,
}

impl PointMap {
    /// Of `records`, of a pass that emitted `emitted` photons. `nearest_plane` is that of the surface
    /// nearest to a place within a given reach; `widest` bounds kernels where there are few photons.
    pub(super) fn build(
        records: &[PointRecord],
        emitted: u64,
        widest: f32,
        nearest_plane: impl Fn(Vec3, f32) -> Option<Plane> + Sync,
    ) -> Self {
        let mut rng = Rng::new(emitted, Stream::Media, records.len() as u64);
        let mut traced: Vec<Traced> = records
            .iter()
            .map(|record| Traced {
                position: record.position,
                power: PackedPower::encode(record.power, record.line, rng.next_f32()),
                wi: octahedral_encode(record.wi, WI_BITS) as u16,
            })
            .collect();
        let tree = KdTree::<LEAF>::build(&mut traced);
        let nearest = NEAREST.min(traced.len().saturating_sub(1)).max(1);
        // With fewer photons, the volume of so many.
        let scale = (NEAREST as f32 / nearest as f32).cbrt();
        let mut radii: Vec<f32> = traced
            .par_iter()
            .map_init(
                || Nearest::new(nearest + 1),
                |search, photon| {
                    search.clear();
                    tree.search(photon.position, search);
                    search.radius().filter(|&radius| radius > 0.0).map_or(widest, |r| (r * scale).min(widest))
                },
            )
            .collect();
        let usual_width = median(&radii);
        for (radius, photon) in radii.iter_mut().zip(&traced) {
            let least = NARROWEST * photon.position.abs().max_element().max(f32::MIN_POSITIVE / f32::EPSILON);
            *radius = radius.min(usual_width * WIDEST).max(least);
        }
        let blocks: Vec<Block> = traced
            .par_chunks(LEAF)
            .zip(radii.par_chunks(LEAF))
            .map(|(photons, radii)| Block::of(photons, radii, &nearest_plane))
            .collect();
        let boxes = BoxTree::new(blocks.iter().map(Block::bounds).collect());
        Self { blocks, len: traced.len(), boxes, per_emitted: 1.0 / emitted.max(1) as f32, usual_width }
    }

    /// Number of photons.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Median width of the kernels.
    pub(super) fn usual_width(&self) -> f32 {
        self.usual_width
    }

    /// Bytes on the heap.
    pub(super) fn memory_bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<Block>() + self.boxes.memory_bytes()
    }

    /// Radiance that the photons scatter towards the start of a line, with transmittance `fade` up to there: the beam radiance estimate of
    /// Jarosz, Zwicker & Jensen 2008 with kernels `3 / (pi r^2) (1 - (d/r)^2)^2`. `share` of each radius is used, and of the photons
    /// those whose direction `keeps` accepts.
    pub(super) fn along(
        &self,
        (line, length): (&Line, f64),
        (phase, fade): (Phase, &Fade<'_>),
        share: f32,
        keeps: impl Fn(Vec3) -> bool,
    ) -> Rgb {
        let (origin, direction) = (line.origin().as_vec3(), line.direction().as_vec3());
        let length = length as f32;
        let mut sum = Rgb::ZERO;
        self.boxes.along(origin, direction, length, |leaf| {
            let block = &self.blocks[leaf];
            block.along(origin, direction, share, |lane, t, square| {
                let wi = block.wi(lane);
                if !(t > 0.0 && t < length && keeps(wi)) {
                    return;
                }
                let radius = decode_length(block.radius[lane]) * share;
                let rest = 1.0 - square;
                let mut kernel = 3.0 * FRAC_1_PI * rest * rest / (radius * radius);
                if let Some(Plane { normal, distance }) = block.plane(lane) {
                    let cosine = normal.dot(direction);
                    if (origin + t * direction - block.position(lane)).dot(normal) > distance {
                        return;
                    }
                    // The kernel is a disc across the line, which the plane cuts at this distance from its middle.
                    let cut = distance / (radius * (1.0 - cosine * cosine).max(0.0).sqrt());
                    if cut < 1.0 {
                        kernel /= share_of_disc(cut);
                    }
                }
                sum += block.power[lane].decode() * fade.at(t) * (phase.eval(-direction, wi) * kernel);
            });
        });
        sum * self.per_emitted
    }

    /// Radiance per unit of length that the photons scatter at a place towards `wo`, per density of the medium there.
    pub(super) fn at(&self, position: Vec3, wo: Vec3, phase: Phase, share: f32) -> Rgb {
        let mut sum = Rgb::ZERO;
        self.boxes.around(position, |leaf| {
            let block = &self.blocks[leaf];
            block.around(position, share, |lane, square| {
                let radius = decode_length(block.radius[lane]) * share;
                let rest = 1.0 - square;
                let mut kernel = 105.0 / (32.0 * PI) * rest * rest / (radius * radius * radius);
                if let Some(Plane { normal, distance }) = block.plane(lane) {
                    if (position - block.position(lane)).dot(normal) > distance {
                        return;
                    }
                    if distance < radius {
                        kernel /= share_of_ball(distance / radius);
                    }
                }
                sum += block.power[lane].decode() * (phase.eval(wo, block.wi(lane)) * kernel);
            });
        });
        sum * self.per_emitted
    }
}

/// Median; zero of nothing.
pub(super) fn median(values: &[f32]) -> f32 {
    let mut sorted = values.to_vec();
    let middle = sorted.len() / 2;
    if sorted.is_empty() {
        return 0.0;
    }
    *sorted.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_kernels_are_their_integrals() {
        for c in [0.0f32, 0.1, 0.5, 0.9, 1.0] {
            let (mut disc, mut ball) = (0.0f64, 0.0f64);
            const STEPS: u32 = 100_000;
            for i in 0..STEPS {
                let width = (1.0 + f64::from(c)) / f64::from(STEPS);
                let x = -1.0 + (f64::from(i) + 0.5) * width;
                let rest = 1.0 - x * x;
                disc += 16.0 / (5.0 * std::f64::consts::PI) * rest.powf(2.5) * width;
                ball += 35.0 / 32.0 * rest.powi(3) * width;
            }
            assert!((f64::from(share_of_disc(c)) - disc).abs() < 1e-6, "{c}: {disc}");
            assert!((f64::from(share_of_ball(c)) - ball).abs() < 1e-6, "{c}: {ball}");
        }
    }

    #[test]
    fn lengths_are_kept_within_a_hundredth() {
        for length in [1e-37f32, 1e-19, 1e-6, 0.37, 1.0, 123.0, 1e18, f32::MAX] {
            let ratio = decode_length(encode_length(length)) / length;
            assert!(ratio <= 1.0 && ratio > 1.0 - 1.0 / 128.0, "{length}: {ratio}");
        }
        assert!(encode_length(f32::INFINITY) < FAR);
        assert_eq!(encode_length(0.0), 0);
    }
}
