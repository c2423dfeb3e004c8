//! Irradiance precomputed at photons of a map, for gather rays to look up.

use super::domain::{KernelDomain, Seen, Sight};
use super::estimate::EstimateParams;
use super::kd_tree::{Block, KdTree, Point, Visitor};
use super::map::{
    MIN_NORMAL_COS, NO_KEY, NearestOne, PhotonMap, Query, Scratch, distance_squared_of, flattened, index_of,
    key_of, leaves_surface,
};
use super::photon::{Acceptance, PhotonClass, PhotonClasses, decode_normal, normal_code};
use crate::math::{Rgb, Rgbe};
use crate::sampling::mix;
use arrayvec::ArrayVec;
use glam::Vec3;
use rayon::prelude::*;

/// Points in a leaf: few, since a search looks for one point only.
const LEAF: usize = 8;

/// Rank of the neighbour whose distance is the validity radius of a point. Where points are spread evenly, a share of
/// `exp(-32)` of the places whose nearest point this is lie outside the validity radius; in a corner of three surfaces,
/// a share of `exp(-10)`.
const NEIGHBOURS: usize = 32;

/// Factor on the validity radius if the neighbours of a point lie far apart: against what the point faces, or, for places beyond the
/// nearest obstacle that its feelers found, against the distance from which the place is seen. The result is about the distance to
/// the third neighbour. Without this factor, where photons are few, a point on the ground in front of a house would be used
/// for the floor inside, through the window, and a point in a patch of sun for the floor around it.
const SHARE_OF_REACH: f32 = 0.3;

/// Largest distance to neighbour [`NEIGHBOURS`], as a share of the distance to the surface that the point faces.
/// Shadows change over such lengths. If the neighbours lie farther apart, the points do not show where direct light
/// ends, and the place samples the lights itself.
const LARGEST_SHARE_OF_OUTLOOK: f32 = 0.25;

/// Length of the outlook ray in radii of the estimate. What the place faces beyond this length does not matter: except
/// in rare cases, the neighbours lie no farther apart than [`LARGEST_SHARE_OF_OUTLOOK`] of it.
const LARGEST_OUTLOOK: f32 = 32.0;

/// Largest share of direct photons among the neighbours of a point, as numerator and denominator, for which the point
/// keeps direct light. Above this share the points inside a lit area, such as a patch of sun, far outnumber those
/// outside and would be used for many places beyond its edge. The place then samples the lights itself.
const LARGEST_SHARE_OF_DIRECT: (usize, usize) = (3, 4);

/// Leaves that a search visits before it gives up: the points near the place are then not on its surface.
const MOST_LEAVES: u32 = 64;

/// Points tested for visibility from one place, nearest first.
const MOST_ASKED: usize = 3;

/// Least validity radius of a point of [`IrradianceMap::near`] next to an obstacle, as a share of the radius of its
/// estimate. It is less than the blur of the estimate itself, and small objects with gaps between them, such as beads,
/// need it.
const LEAST_SEEN: f32 = 0.2;

/// Irradiance at some photons of a map, for final gather rays to look up (Christensen, "Faster Photon Map Global
/// Illumination", Journal of Graphics Tools 4(3), 1999).
///
/// The points have a tree of their own. A point takes 27 bytes.
#[derive(Clone, Debug)]
pub struct IrradianceMap {
    tree: KdTree<LEAF>,
    values: Vec<Value>,
}

/// Values stored at a point.
#[derive(Clone, Copy, Debug)]
struct Value {
    irradiance: Rgbe,
    /// Distance to the nearest obstacle that the feeler rays of the point found; infinite in the open. For
    /// [`IrradianceMap::near`] it is limited to a share of the radius of the estimate. Zero where the point is valid
    /// for no place. The sign is negative where the irradiance lacks direct light.
    felt: f32,
    /// Validity radius: the distance to neighbour [`NEIGHBOURS`]. If the neighbours lie too far apart
    /// ([`LARGEST_SHARE_OF_OUTLOOK`]), it is multiplied by [`SHARE_OF_REACH`] and its sign is negative.
    reach: f32,
}

/// Result of a look-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointIrradiance {
    /// Irradiance in W m^-2, cosine included.
    pub irradiance: Rgb,
    /// Whether the irradiance lacks direct light, which the caller then adds for the place itself.
    pub lacks_direct: bool,
}

/// Bytes of a point in a file: position, irradiance, reach, normal, little-endian.
pub(super) const IRRADIANCE_RECORD: usize = 22;

/// Bit next to the code of the normal in a file: the neighbours of the point lie too far apart
/// ([`LARGEST_SHARE_OF_OUTLOOK`]).
const SPARSE: u16 = 1 << 15;

/// A point before the tree is built.
#[derive(Clone, Copy)]
pub(super) struct IrradiancePoint {
    position: Vec3,
    irradiance: Rgbe,
    reach: f32,
    /// Code of the normal, in the same bits as in a photon's flags.
    normal: u16,
    /// The irradiance without direct light, where it is known.
    reflected: Option<Rgbe>,
    /// Whether the photon at this point is a direct photon.
    is_direct: bool,
    /// Distance to the surface that the point faces.
    outlook: f32,
    /// Whether its estimate uses fewer than half of the photons that were asked for.
    is_poor: bool,
    /// Whether a file already states that its neighbours lie too far apart.
    is_sparse: bool,
}

impl Point for IrradiancePoint {
    fn position(&self) -> Vec3 {
        self.position
    }

    fn tag(&self) -> u16 {
        self.normal
    }

    fn tie(&self) -> u64 {
        u64::from(u32::from_be_bytes(self.irradiance.0)) << 16 | u64::from(self.normal)
    }
}

impl PhotonMap {
    /// Estimates the irradiance at every `stride`-th photon, on the side that the photon arrived at.
    ///
    /// `template` holds the search parameters; its position and normal are replaced by those of the photons. The photon
    /// itself takes part in the estimate, and it must: a place whose *nearest* point is at distance `d` has no other
    /// point within `d`, and on average one photon is missing for that reason. Without the photon itself the constant
    /// kernel would be low by `1 / k`.
    ///
    /// Values are rounded to [`Rgbe`] at random, without bias, with an RMS error of 0.25 % (measured), which equals the
    /// noise of an estimate from 160 000 photons. The result is the same for any number of threads.
    pub fn precompute_irradiance(
        &self,
        template: &Query,
        params: &EstimateParams,
        stride: usize,
    ) -> IrradianceMap {
        let sight = |_, _| |_| None;
        self.precompute_parts(template, params, (stride, f32::INFINITY), (sight, None), &|| false)
    }

    /// [`Self::precompute_irradiance`] over visible kernels: `sight` finds what can be seen from a place with a normal.
    /// If `direct` is given, it returns the direct irradiance for a point (number of the point, position, normal). The
    /// result is then the sum of this value and an estimate from reflected light alone. Where `direct` returns `None`,
    /// the estimate uses all photons. The whole result is `None` once `stop` returns true, after which it must keep
    /// returning true.
    ///
    /// A point at a direct photon then takes no part in its own estimate, and correspondingly fewer photons are missing
    /// at a place, so this is without bias as well.
    pub fn precompute_irradiance_until<S: Sight>(
        &self,
        template: &Query,
        params: &EstimateParams,
        stride: usize,
        sight: impl Fn(Vec3, Vec3) -> S + Sync,
        direct: Option<&DirectLight<'_>>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<IrradianceMap> {
        let parts = (sight, direct);
        let map = self.precompute_parts(template, params, (stride, f32::INFINITY), parts, stop);
        (!stop()).then_some(map)
    }

    /// Irradiance over visible kernels with a validity radius of at most this `share` of the radius of the estimate
    /// ([`IrradianceMap::near`]). `None` once `stop` returns true, after which it must keep returning true.
    pub fn precompute_irradiance_near<S: Sight>(
        &self,
        template: &Query,
        params: &EstimateParams,
        (stride, share): (usize, f32),
        sight: impl Fn(Vec3, Vec3) -> S + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<IrradianceMap> {
        let map = self.precompute_parts(template, params, (stride, share), (sight, None), stop);
        (!stop()).then_some(map)
    }

    fn precompute_parts<S: Sight>(
        &self,
        template: &Query,
        params: &EstimateParams,
        (stride, share): (usize, f32),
        (sight, direct): (impl Fn(Vec3, Vec3) -> S + Sync, Option<&DirectLight<'_>>),
        stop: &(dyn Fn() -> bool + Sync),
    ) -> IrradianceMap {
        // A separate tree: in the full tree a search would visit all the nearer photons of other classes.
        let reflected = direct.map(|_| {
            let indirect = PhotonClasses::only(PhotonClass::Indirect);
            self.only(indirect.and(PhotonClasses::only(PhotonClass::Caustic)))
        });
        let stride = stride.max(1);
        let points: Vec<IrradiancePoint> = (0..self.len().div_ceil(stride))
            .into_par_iter()
            .with_max_len(256)
            .map_init(Scratch::default, |scratch, i| {
                let photon = self.photon(i * stride);
                let normal = photon.normal();
                if stop() {
                    return IrradiancePoint {
                        position: photon.position,
                        irradiance: Rgbe::default(),
                        reach: 0.0,
                        normal: 0,
                        reflected: None,
                        is_direct: false,
                        outlook: 0.0,
                        is_poor: false,
                        is_sparse: false,
                    };
                }
                let by_lights = direct.and_then(|direct| direct(i as u64, photon.position, normal));
                let map = reflected.as_ref().filter(|_| by_lights.is_some()).unwrap_or(self);
                let query = template.at(photon.position, normal);
                let mut noting = Noting { sight: sight(photon.position, normal), reach: f32::INFINITY };
                let by_photons = map.estimate_irradiance_visible(&query, params, scratch, &mut noting);
                let irradiance = by_photons.value + by_lights.unwrap_or(Rgb::ZERO);
                let reach = if share.is_finite() {
                    let least = LEAST_SEEN * by_photons.radius;
                    noting.reach.max(least).min(share * by_photons.radius)
                } else if by_photons.is_local {
                    noting.reach
                } else {
                    0.0
                };
                let dither = (mix(i as u64) >> 40) as f32 / 16_777_216.0;
                IrradiancePoint {
                    position: photon.position,
                    irradiance: Rgbe::encode_dithered(irradiance, dither),
                    reach,
                    normal: normal_code(normal),
                    reflected: by_lights.map(|_| Rgbe::encode_dithered(by_photons.value, dither)),
                    is_direct: photon.class() == PhotonClass::Direct,
                    outlook: if share.is_finite() {
                        f32::INFINITY
                    } else {
                        noting.sight.outlook(LARGEST_OUTLOOK * by_photons.radius)
                    },
                    is_poor: (by_photons.photons as usize) < template.k / 2,
                    is_sparse: false,
                }
            })
            .collect();
        IrradianceMap::of_points(points)
    }
}

/// Direct irradiance, by number of the point, position and normal.
pub type DirectLight<'a> = dyn Fn(u64, Vec3, Vec3) -> Option<Rgb> + Sync + 'a;

/// A [`Sight`] that records the distance to the nearest obstacle its feelers found.
struct Noting<S> {
    sight: S,
    reach: f32,
}

impl<S: Sight> Sight for Noting<S> {
    fn feel(&mut self, radius: f32) -> Seen {
        let seen = self.sight.feel(radius);
        self.reach = seen.part().map_or(f32::INFINITY, KernelDomain::least_reach);
        seen
    }

    fn sees(&mut self, position: Vec3, normal: Vec3) -> bool {
        self.sight.sees(position, normal)
    }

    fn feels(&self) -> bool {
        self.sight.feels()
    }

    fn is_covered(&self) -> bool {
        self.sight.is_covered()
    }

    fn outlook(&mut self, within: f32) -> f32 {
        self.sight.outlook(within)
    }
}

impl IrradianceMap {
    /// The map of these points, which may come in any order.
    pub(super) fn of_points(mut points: Vec<IrradiancePoint>) -> Self {
        let tree = KdTree::build(&mut points);
        let values = points
            .par_iter()
            .with_max_len(1024)
            .map_init(Vec::new, |keys, point| {
                let reach = spacing(&tree, point.position, keys);
                let is_sparse = point.is_sparse || reach > LARGEST_SHARE_OF_OUTLOOK * point.outlook;
                // An estimate that blurs a whole room does not describe this place. To use points where photons happen
                // to lie, and sample elsewhere, would make the mean too bright.
                let felt = if is_sparse && point.is_poor { 0.0 } else { point.reach };
                let reach = if is_sparse { -SHARE_OF_REACH * reach } else { reach };
                match point.reflected {
                    Some(irradiance) if is_sparse || is_mostly_direct(&points, point, keys) => {
                        Value { irradiance, felt: -felt, reach }
                    }
                    _ => Value { irradiance: point.irradiance, felt, reach },
                }
            })
            .collect();
        Self { tree, values }
    }

    /// Point `index`, in the map's own order, as files hold it.
    pub(super) fn record(&self, index: usize) -> [u8; IRRADIANCE_RECORD] {
        let Value { irradiance, felt, reach } = self.values[index];
        let mut bytes = [0; IRRADIANCE_RECORD];
        let coordinates = self.tree.position(index).to_array();
        coordinates
            .iter()
            .enumerate()
            .for_each(|(i, x)| bytes[4 * i..4 * i + 4].copy_from_slice(&x.to_le_bytes()));
        bytes[12..16].copy_from_slice(&irradiance.0);
        bytes[16..20].copy_from_slice(&felt.to_le_bytes());
        let sparse = if reach.is_sign_negative() { SPARSE } else { 0 };
        bytes[20..].copy_from_slice(&(self.tree.tag(index) | sparse).to_le_bytes());
        bytes
    }

    /// The point of these bytes; `None` where they are not valid.
    pub(super) fn point(bytes: [u8; IRRADIANCE_RECORD]) -> Option<IrradiancePoint> {
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let position = Vec3::from_array([0, 4, 8].map(|at| f32::from_le_bytes(word(at))));
        let reach = f32::from_le_bytes(word(16));
        let code = u16::from_le_bytes([bytes[20], bytes[21]]);
        let is_sound = position.is_finite() && !reach.is_nan();
        is_sound.then_some(IrradiancePoint {
            position,
            irradiance: Rgbe(word(12)),
            reach,
            normal: code & !SPARSE,
            reflected: None,
            is_direct: false,
            outlook: f32::INFINITY,
            is_poor: false,
            is_sparse: code & SPARSE != 0,
        })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// True where there is no point.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes that points and search structure take.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + self.values.capacity() * size_of::<Value>()
    }

    /// Irradiance in W m^-2, cosine included, at the point nearest to `position` whose normal agrees with the unit
    /// vector `normal` ([`MIN_NORMAL_COS`]), within `max_radius`. `None` where the place is outside its validity
    /// radius, or where `connects` finds no free way to the point (position, normal).
    pub fn near(
        &self,
        position: Vec3,
        normal: Vec3,
        max_radius: f32,
        connects: impl Fn(Vec3, Vec3) -> bool,
    ) -> Option<Rgb> {
        let acceptance = Acceptance::new(normal, MIN_NORMAL_COS, PhotonClasses::ALL);
        let nearest = NearestOne::new(max_radius, |_, normal, distance_squared, _| {
            acceptance.accepts(normal).then_some(distance_squared)
        });
        let mut visitor = Facing { acceptance: &acceptance, nearest };
        self.tree.search(position, &mut visitor);
        let index = index_of(visitor.nearest.best()?);
        let Value { irradiance, felt: reach, .. } = self.values[index];
        let reaches = self.tree.position(index).distance_squared(position) <= reach * reach;
        (reaches && self.connects(index, connects)).then(|| irradiance.decode())
    }

    /// Irradiance in W m^-2, cosine included, at the nearest point whose normal agrees with the unit vector `normal`
    /// ([`MIN_NORMAL_COS`]) and which is valid for `position`; `None` where there is none within `max_radius`.
    ///
    /// A point is valid for places on its own surface within its validity radius, if `connects` finds a free way to the
    /// point (position, normal). Points above or below the surface count as farther away, as in
    /// [`super::SearchRegion::Disc`]. Among the valid points, those whose feelers met no obstacle up to the distance of
    /// the place come first, and the nearest of them is used: a point at the foot of a wall is not valid behind the
    /// wall. For other points that lie far apart against the distance that the place is `seen_from`, the validity radius shrinks to
    /// about the distance of the third neighbour. If the nearest point is valid for no place, the result is `None`.
    pub fn nearest(
        &self,
        (position, normal): (Vec3, Vec3),
        (max_radius, seen_from): (f32, f32),
        connects: impl Fn(Vec3, Vec3) -> bool,
    ) -> Option<PointIrradiance> {
        let mut refused = ArrayVec::<usize, MOST_ASKED>::new();
        while !refused.is_full() {
            let mut answering = Answering {
                map: self,
                refused: &refused,
                place: (position, normal),
                acceptance: Acceptance::new(normal, MIN_NORMAL_COS, PhotonClasses::ALL),
                open: NO_KEY,
                any: NO_KEY,
                coarse: LARGEST_SHARE_OF_OUTLOOK * seen_from,
                bound: if max_radius >= 0.0 { max_radius * max_radius } else { -1.0 },
                leaves: MOST_LEAVES,
            };
            self.tree.search(position, &mut answering);
            let index = index_of(answering.best()?);
            let Value { irradiance, felt, .. } = self.values[index];
            // Where photons near the place are too few, photons farther away do not describe the light here.
            if felt == 0.0 {
                return None;
            }
            if self.connects(index, &connects) {
                return Some(PointIrradiance {
                    irradiance: irradiance.decode(),
                    lacks_direct: felt.is_sign_negative(),
                });
            }
            refused.push(index);
        }
        None
    }

    fn connects(&self, index: usize, connects: impl Fn(Vec3, Vec3) -> bool) -> bool {
        connects(self.tree.position(index), decode_normal(self.tree.tag(index)))
    }
}

/// Finds the nearest point that faces along a normal; leaves without such points are skipped.
struct Facing<'a, F> {
    acceptance: &'a Acceptance,
    nearest: NearestOne<F>,
}

impl<F: Fn(usize, u16, f32, Vec3) -> Option<f32>> Visitor<LEAF> for Facing<'_, F> {
    #[inline]
    fn bound(&self) -> f32 {
        Visitor::<LEAF>::bound(&self.nearest)
    }

    #[inline]
    fn wants(&self, normals: u32) -> bool {
        self.acceptance.may_accept(normals)
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; LEAF], block: &Block<LEAF>) {
        self.nearest.visit(first, distances_squared, block);
    }
}

/// Finds the nearest point that is valid for a place.
struct Answering<'a> {
    map: &'a IrradianceMap,
    refused: &'a [usize],
    place: (Vec3, Vec3),
    /// Distance of neighbours beyond which points are too far apart for who sees the place.
    coarse: f32,
    acceptance: Acceptance,
    /// Key of the nearest point whose feelers met no obstacle up to the place.
    open: u64,
    /// Key of the nearest point.
    any: u64,
    bound: f32,
    leaves: u32,
}

impl Answering<'_> {
    fn best(&self) -> Option<u64> {
        [self.open, self.any].into_iter().find(|&key| key != NO_KEY)
    }
}

impl Visitor<LEAF> for Answering<'_> {
    #[inline]
    fn bound(&self) -> f32 {
        self.bound
    }

    #[inline]
    fn wants(&self, normals: u32) -> bool {
        self.acceptance.may_accept(normals)
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; LEAF], block: &Block<LEAF>) {
        for (lane, &distance_squared) in distances_squared.iter().enumerate() {
            let key = key_of(first + lane as u32, distance_squared);
            // Ties go to the lower index.
            if !(distance_squared <= self.bound && key < self.open) {
                continue;
            }
            let index = index_of(key);
            let (accepts, normals) = self.acceptance.judge(block.tag(lane));
            if !accepts || self.refused.contains(&index) {
                continue;
            }
            let Value { felt, reach, .. } = self.map.values[index];
            let v = block.position(lane) - self.place.0;
            let is_open = distance_squared <= felt * felt;
            // Points without a valid estimate take part: a place nearest to one of them has no value.
            let is_fine = is_open || felt == 0.0 || reach < self.coarse;
            let reach = if is_fine { reach } else { SHARE_OF_REACH * reach };
            if !(flattened(distance_squared, v, normals) <= reach * reach) {
                continue;
            }
            self.any = self.any.min(key);
            if is_open || felt == 0.0 {
                self.open = key;
                self.bound = distance_squared;
            }
        }
        self.leaves -= 1;
        if self.leaves == 0 {
            self.bound = -1.0;
        }
    }
}

/// Whether so many of the neighbours with these keys, on the surface of a point, are direct photons that the point
/// leaves direct light to the place that looks it up ([`LARGEST_SHARE_OF_DIRECT`]).
fn is_mostly_direct(points: &[IrradiancePoint], point: &IrradiancePoint, keys: &[u64]) -> bool {
    let normal = decode_normal(point.normal);
    let (mut all, mut direct) = (0, 0);
    for &key in keys {
        let other = &points[index_of(key)];
        let facing = decode_normal(other.normal);
        let v = other.position - point.position;
        if normal.dot(facing) >= MIN_NORMAL_COS && !leaves_surface(v.length_squared(), v, normal + facing) {
            all += 1;
            direct += usize::from(other.is_direct);
        }
    }
    let (share, of) = LARGEST_SHARE_OF_DIRECT;
    of * direct > share * all
}

/// Distance to neighbour [`NEIGHBOURS`] of a point. Zero where there are fewer neighbours, which do not show how close
/// they lie. Leaves the keys of the neighbours and of the point itself in `keys`.
fn spacing(tree: &KdTree<LEAF>, position: Vec3, keys: &mut Vec<u64>) -> f32 {
    keys.clear();
    let mut visitor = Farthest { keys, bound: f32::INFINITY };
    tree.search(position, &mut visitor);
    visitor.shrink();
    if visitor.bound.is_finite() { visitor.bound.sqrt() } else { 0.0 }
}

/// Keeps the [`NEIGHBOURS`] nearest neighbours and the point itself.
struct Farthest<'a> {
    keys: &'a mut Vec<u64>,
    bound: f32,
}

impl Farthest<'_> {
    fn shrink(&mut self) {
        if self.keys.len() > NEIGHBOURS {
            let (_, &mut kth, _) = self.keys.select_nth_unstable(NEIGHBOURS);
            self.bound = distance_squared_of(kth);
            self.keys.truncate(NEIGHBOURS + 1);
        }
    }
}

impl Visitor<LEAF> for Farthest<'_> {
    #[inline]
    fn bound(&self) -> f32 {
        self.bound
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; LEAF], _: &Block<LEAF>) {
        let bound = self.bound;
        let near = (first..).zip(distances_squared).filter(|&(_, &squared)| squared <= bound);
        self.keys.extend(near.map(|(index, &squared)| key_of(index, squared)));
        if self.keys.len() > 2 * NEIGHBOURS {
            self.shrink();
        }
    }
}

#[cfg(test)]
mod tests;
