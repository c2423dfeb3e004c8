//! The photon map: photons searchable by position, the queries and the search.

use super::SearchRegion;
use super::kd_tree::{Block, KdTree, Point, Visitor};
use super::photon::{Acceptance, Payload, Photon, PhotonClass, PhotonClasses};
use crate::math::Rgb;
use glam::Vec3;
use rayon::prelude::*;

/// Points in a leaf. With 16 instead, a tree takes longer to build and to search for 80 photons.
pub(super) const LEAF: usize = 32;

/// Ratio of width to height of the neighbourhood of [`SearchRegion::Disc`].
///
/// It keeps photons of a parallel surface out of an estimate whose radius is less than four times the distance to that
/// surface.
pub const DISC_FLATNESS: f32 = 4.0;

/// Sine of the angle, 5.7 degrees, up to which a photon counts as in the surface of the query. Two errors tilt a photon
/// this far: the rounding of stored normals ([`super::NORMAL_ERROR`], of which half enters the mean of two), and the
/// facets of a mesh that approximates a round shape.
const IN_SURFACE: f32 = 0.1;

/// Squared distance by which [`SearchRegion::Disc`] orders photons.
///
/// `v` leads from the query to the photon, `normals` is the sum of both unit normals, and `distance_squared` is
/// `|v|^2`. Any chord of a circle is at a right angle to the sum of the normals at its ends. The height `h = v .
/// normals / |normals|` is therefore zero on planes and on surfaces of even curvature; on a parallel surface it is the
/// distance. For photons in the surface the result is `|v|^2`, so that the area searched is that of the sphere: `pi
/// r^2` on planes and on spheres (a cap of chord `r`), and larger by `r^2 / 32 R^2` on cylinders.
#[inline]
pub(super) fn flattened(distance_squared: f32, v: Vec3, normals: Vec3) -> f32 {
    let (along, scale) = (v.dot(normals), normals.length_squared());
    let allowed = IN_SURFACE * IN_SURFACE * distance_squared;
    // The most frequent case, without a division.
    if along * along <= allowed * scale {
        return distance_squared;
    }
    let outside = (along * along / scale - allowed).max(0.0);
    distance_squared + (DISC_FLATNESS * DISC_FLATNESS - 1.0) * outside
}

/// Whether the photon at `v` from the query lies outside its surface, curved or plane, so that [`flattened`] gives it
/// more than its distance.
#[inline]
pub(super) fn leaves_surface(distance_squared: f32, v: Vec3, normals: Vec3) -> bool {
    let along = v.dot(normals);
    along * along > IN_SURFACE * IN_SURFACE * distance_squared * normals.length_squared()
}

/// Least cosine between the normals of a photon and of the query: 45 degrees, as for the brick maps of Christensen &
/// Batali 2004, and four more for the rounding of a stored normal ([`super::NORMAL_ERROR`]), so that rounding never
/// rejects a photon that agrees within 45 degrees.
pub const MIN_NORMAL_COS: f32 = 0.656;

/// Parameters of a search for photons.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// Centre of the search, render space.
    pub position: Vec3,
    /// Unit geometric normal on the side that is looked up. Photons that arrived on the other side, or at a surface
    /// that faces elsewhere ([`Self::min_normal_cos`]), are rejected and do not count towards [`Self::k`].
    pub normal: Vec3,
    /// Maximum search radius; may be infinite.
    pub max_radius: f32,
    /// Number of nearest photons to find; `usize::MAX` for all within the radius.
    pub k: usize,
    /// Shape of the neighbourhood, which defines the distance measure.
    pub region: SearchRegion,
    /// Least cosine between [`Self::normal`] and the normal stored with a photon.
    pub min_normal_cos: f32,
    /// Classes of photons to find.
    pub classes: PhotonClasses,
    /// Whether estimates use fewer photons than [`Self::k`] where further photons change the value in one direction
    /// only: the differential checking of Jensen & Christensen 1995, section 3.3. Searches ignore it.
    pub differential_check: bool,
    /// Factor on the radius of estimates, in (0, 1]; only the photons within the smaller radius count. Searches ignore
    /// it.
    pub radius_share: f32,
    /// Threshold for faint estimates: an estimate over the whole disc that is no larger than this in any channel is
    /// used as it is, without visibility tests. Searches ignore it.
    pub faint: f32,
    /// Whether estimates are also made over a narrower disc ([`super::NARROWER`]). Searches ignore it.
    pub narrower: bool,
}

impl Query {
    /// The `k` nearest photons that carry light, at whatever distance, in a sphere.
    pub fn nearest(position: Vec3, normal: Vec3, k: usize) -> Self {
        Self {
            position,
            normal,
            max_radius: f32::INFINITY,
            k,
            region: SearchRegion::Sphere,
            min_normal_cos: MIN_NORMAL_COS,
            classes: PhotonClasses::LIGHT,
            differential_check: false,
            radius_share: 1.0,
            faint: 0.0,
            narrower: false,
        }
    }

    /// All photons within `radius` that carry light.
    pub fn within(position: Vec3, normal: Vec3, radius: f32) -> Self {
        Self { max_radius: radius, ..Self::nearest(position, normal, usize::MAX) }
    }

    /// The same query at another place.
    pub fn at(&self, position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, ..*self }
    }
}

/// Buffers that searches reuse; one for each thread.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Squared distance in the high half, index in the low one: integers in the order of distance.
    keys: Vec<u64>,
    visited: u64,
}

impl Scratch {
    /// Number of photons that all searches so far have visited: the cost of look-ups, independent of the machine's
    /// speed.
    pub fn visited(&self) -> u64 {
        self.visited
    }
}

/// Result of a search.
#[derive(Clone, Copy, Debug)]
pub struct Neighbours<'a> {
    keys: &'a [u64],
    complete: bool,
}

impl<'a> Neighbours<'a> {
    /// Number of photons found.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// True where nothing was found.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Whether all `k` were found, rather than fewer within the radius.
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Index of each photon in the map and its squared distance. The order depends on the map and the query only. The
    /// farthest photon is last.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (usize, f32)> + 'a {
        self.keys.iter().map(|&key| (index_of(key), distance_squared_of(key)))
    }

    /// Squared distance of the farthest, zero where nothing was found.
    pub fn farthest_squared(&self) -> f32 {
        self.keys.last().map_or(0.0, |&key| distance_squared_of(key))
    }
}

#[inline]
pub(super) fn key_of(index: u32, distance_squared: f32) -> u64 {
    u64::from(distance_squared.to_bits()) << 32 | u64::from(index)
}

#[inline]
pub(super) fn index_of(key: u64) -> usize {
    (key & 0xffff_ffff) as usize
}

#[inline]
pub(super) fn distance_squared_of(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

/// Photons where they landed, searchable by position (Jensen 1996, section 3).
///
/// The map is immutable and contains no geometry: a query needs a position, a normal and a radius. It is a function of
/// the *set* of its photons: neither their order nor the number of threads that build it changes a bit.
#[derive(Clone, Debug)]
pub struct PhotonMap {
    tree: KdTree<LEAF>,
    payloads: Vec<Payload>,
    /// Middle and half sides of the box around the photons.
    bounds: (Vec3, Vec3),
    emitted: u64,
    dropped: u64,
    /// Whether any photon has a wavelength.
    is_dispersed: bool,
}

impl Point for Photon {
    #[inline]
    fn position(&self) -> Vec3 {
        self.position
    }

    #[inline]
    fn tag(&self) -> u16 {
        self.flags()
    }

    #[inline]
    fn tie(&self) -> u64 {
        self.payload_bits()
    }
}

impl PhotonMap {
    /// A map of `photons`, the result of a pass in which the lights emitted `emitted` photons.
    ///
    /// Photons without a finite position are left out and counted in [`Self::dropped`].
    ///
    /// # Panics
    /// With 2^32 photons or more, which would take 86 GB.
    pub fn build(photons: Vec<Photon>, emitted: u64) -> Self {
        Self::build_parts(photons, emitted, &|| false)
    }

    /// [`Self::build`]; `None` once `stop` returns true, after which it must keep returning true.
    pub fn build_until(photons: Vec<Photon>, emitted: u64, stop: &(dyn Fn() -> bool + Sync)) -> Option<Self> {
        let map = Self::build_parts(photons, emitted, stop);
        (!stop()).then_some(map)
    }

    fn build_parts(mut photons: Vec<Photon>, emitted: u64, stop: &(dyn Fn() -> bool + Sync)) -> Self {
        let given = photons.len();
        if !photons.par_iter().with_min_len(4096).all(|photon| photon.position.is_finite()) {
            photons.retain(|photon| photon.position.is_finite());
        }
        assert!(u32::try_from(photons.len() + LEAF).is_ok(), "a photon map holds less than 2^32 photons");
        let dropped = (given - photons.len()) as u64;
        let tree = KdTree::build_until(&mut photons, stop);
        let payloads = photons.par_iter().with_min_len(4096).map(Photon::payload).collect();
        let is_dispersed = photons.par_iter().with_min_len(4096).any(Photon::is_monochromatic);
        let bounds = tree.bounds();
        Self { tree, payloads, bounds, emitted, dropped, is_dispersed }
    }

    /// The map of the photons of these classes alone, which estimates of these classes search faster.
    ///
    /// Estimates of these classes are the same as in the full map except for the order of summation.
    #[must_use]
    pub fn only(&self, classes: PhotonClasses) -> Self {
        let photons = self.photons().filter(|photon| classes.contains(photon.class())).collect();
        Self::build(photons, self.emitted)
    }

    /// The map of the photons of all `maps`; its number of emitted photons is the sum of theirs.
    ///
    /// The maps must come from passes over the same lights that differ in their random numbers only. Each is then an
    /// estimate of the same flux, and so is the whole. The result equals, bit by bit, a map built of all photons at
    /// once.
    pub fn merge<'a>(maps: impl IntoIterator<Item = &'a Self>) -> Self {
        let (mut photons, mut emitted, mut dropped) = (Vec::new(), 0u64, 0u64);
        for map in maps {
            photons.extend((0..map.len()).map(|index| map.photon(index)));
            emitted = emitted.saturating_add(map.emitted);
            dropped += map.dropped;
        }
        Self { dropped, ..Self::build(photons, emitted) }
    }

    /// Number of photons stored.
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// True where no photon is stored.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of photons that the lights emitted, by which estimates divide. With zero all estimates are zero.
    pub fn emitted(&self) -> u64 {
        self.emitted
    }

    /// Whether any photon has a wavelength: what a coloured surface reflects is then not its colour times the irradiance.
    pub fn is_dispersed(&self) -> bool {
        self.is_dispersed
    }

    /// Number of photons that were not stored because their position was not finite.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Photon `index`, in the map's own order.
    pub fn photon(&self, index: usize) -> Photon {
        Photon::from_parts(self.tree.position(index), self.tree.tag(index), self.payloads[index])
    }

    /// All photons, in the map's own order.
    pub fn photons(&self) -> impl ExactSizeIterator<Item = Photon> {
        (0..self.len()).map(|index| self.photon(index))
    }

    /// Bytes that the photons and the search structure take.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + self.payloads.capacity() * size_of::<Payload>()
    }

    /// Sum of the flux of all photons that carry light, divided by the number emitted: watts for each channel.
    pub fn total_flux(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for photon in self.photons().filter(|photon| photon.class() != PhotonClass::Shadow) {
            let power = photon.power().as_dvec3();
            (0..3).for_each(|channel| sum[channel] += power[channel]);
        }
        sum.map(|channel| channel * self.per_emitted())
    }

    /// `1 / emitted`, or zero if no photon was emitted.
    pub(super) fn per_emitted(&self) -> f64 {
        if self.emitted == 0 { 0.0 } else { 1.0 / self.emitted as f64 }
    }

    pub(super) fn payload(&self, index: usize) -> &Payload {
        &self.payloads[index]
    }

    /// Class of photon `index`.
    #[inline]
    pub fn class(&self, index: usize) -> PhotonClass {
        super::photon::decode_class(self.tree.tag(index))
    }

    #[inline]
    pub(super) fn position(&self, index: usize) -> Vec3 {
        self.tree.position(index)
    }

    #[inline]
    pub(super) fn normal(&self, index: usize) -> Vec3 {
        super::photon::decode_normal(self.tree.tag(index))
    }

    pub(super) fn power(&self, index: usize) -> Rgb {
        self.payloads[index].power()
    }

    /// The photons that match `query`. Allocates only while `scratch` has not yet seen a search of this size.
    ///
    /// The result is exact: it equals a comparison of all photons by squared distance as `f32` computes it, where ties
    /// go to the lower index.
    pub fn search<'a>(&self, query: &Query, scratch: &'a mut Scratch) -> Neighbours<'a> {
        let accept = Acceptance::new(query.normal, query.min_normal_cos, query.classes);
        let mut collector = Collector {
            keys: &mut scratch.keys,
            len: 0,
            k: query.k.min(self.len()).max(1),
            bound: if query.max_radius >= 0.0 { query.max_radius * query.max_radius } else { -1.0 },
            accept,
            blocks: 0,
        };
        if query.k > 0 && !self.is_out_of_plane(query) {
            match query.region {
                SearchRegion::Sphere => self.tree.search(query.position, &mut collector),
                SearchRegion::Disc => {
                    self.tree.search(
                        query.position,
                        &mut Flat { centre: query.position, collector: &mut collector },
                    );
                }
            }
        }
        let blocks = collector.blocks;
        let len = collector.finish();
        scratch.visited += blocks * LEAF as u64;
        Neighbours { keys: &scratch.keys[..len], complete: len > 0 && len == query.k }
    }

    /// Whether every photon lies so far from the plane of the query that none is within [`Query::max_radius`] in the
    /// measure of a disc ([`flattened`]). It uses the box around all photons for a lower bound of that distance. An
    /// example is a map of photons on a floor, and a query above it that looks for photons in its own plane.
    fn is_out_of_plane(&self, query: &Query) -> bool {
        if query.region != SearchRegion::Disc {
            return false;
        }
        let (middle, half) = self.bounds;
        let height = (middle - query.position).dot(query.normal).abs() - half.dot(query.normal.abs());
        let bound = query.max_radius * query.max_radius;
        if !(height > 0.0 && bound.is_finite()) {
            return false;
        }
        // The height is measured along the mean of both normals, at half their angle from the query's.
        let [cos, sin] = [1.0, -1.0].map(|sign| (0.5 + sign * 0.5 * query.min_normal_cos).max(0.0).sqrt());
        let across = (bound - height * height).max(0.0).sqrt();
        let tilted = (height * cos - across * sin).max(0.0);
        let outside = (tilted * tilted - IN_SURFACE * IN_SURFACE * bound).max(0.0);
        // The margin of a thousandth exceeds all rounding errors.
        height * height + (DISC_FLATNESS * DISC_FLATNESS - 1.0) * outside > 1.001 * bound
    }

    /// The nearest photon that both `query` and `accept` admit, and its squared distance. [`Query::k`] is ignored.
    pub fn nearest_one(&self, query: &Query, accept: impl Fn(&Photon) -> bool) -> Option<(usize, f32)> {
        let acceptance = Acceptance::new(query.normal, query.min_normal_cos, query.classes);
        let measure = |index: usize, flags, distance_squared, position: Vec3| {
            let (accepted, normals) = acceptance.judge(flags);
            let distance_squared = match query.region {
                SearchRegion::Sphere => distance_squared,
                SearchRegion::Disc => flattened(distance_squared, position - query.position, normals),
            };
            (accepted && accept(&self.photon(index))).then_some(distance_squared)
        };
        let mut visitor = NearestOne::new(query.max_radius, measure);
        self.tree.search(query.position, &mut visitor);
        visitor.best().map(|key| (index_of(key), distance_squared_of(key)))
    }
}

/// Keeps the `k` nearest accepted points in a flat buffer of slightly more than `2 k`. When it is full, a selection in
/// linear time keeps `k` and yields the new bound. A heap would cost a logarithm for each photon.
struct Collector<'a> {
    keys: &'a mut Vec<u64>,
    len: usize,
    k: usize,
    bound: f32,
    accept: Acceptance,
    /// Leaves seen.
    blocks: u64,
}

impl Collector<'_> {
    fn shrink(&mut self) {
        let (_, &mut kth, _) = self.keys[..self.len].select_nth_unstable(self.k - 1);
        self.bound = distance_squared_of(kth);
        self.len = self.k;
    }

    /// Keeps the `k` nearest, the farthest last, and returns their number.
    fn finish(mut self) -> usize {
        if self.len > self.k {
            self.shrink();
        } else if self.len > 1 {
            let last = self.len - 1;
            self.keys[..self.len].select_nth_unstable(last);
        }
        self.len
    }
}

impl Collector<'_> {
    /// Takes the points of a block within the bound that `judge` accepts, at the squared distance it returns.
    #[inline]
    fn take(
        &mut self,
        first: u32,
        distances_squared: &[f32; LEAF],
        mut judge: impl FnMut(&Acceptance, usize, f32) -> (bool, f32),
    ) {
        self.blocks += 1;
        if self.keys.len() < self.len + LEAF {
            self.keys.resize(2 * (self.len + LEAF), 0);
        }
        // Without branches: every key is written, and the next one overwrites those that are rejected.
        let out = &mut self.keys[self.len..self.len + LEAF];
        let mut near = 0;
        for (lane, &distance_squared) in distances_squared.iter().enumerate() {
            out[near] = key_of(first + lane as u32, distance_squared);
            near += usize::from(distance_squared <= self.bound);
        }
        let mut accepted = 0;
        for i in 0..near {
            let key = out[i];
            let (accept, distance_squared) =
                judge(&self.accept, index_of(key) % LEAF, distance_squared_of(key));
            out[accepted] = key_of(index_of(key) as u32, distance_squared);
            accepted += usize::from(accept & (distance_squared <= self.bound));
        }
        self.len += accepted;
        if self.len >= 2 * self.k + 8 {
            self.shrink();
        }
    }
}

impl Visitor<LEAF> for Collector<'_> {
    #[inline]
    fn bound(&self) -> f32 {
        self.bound
    }

    #[inline]
    fn wants(&self, normals: u32) -> bool {
        self.accept.may_accept(normals)
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; LEAF], block: &Block<LEAF>) {
        self.take(first, distances_squared, |acceptance, lane, distance_squared| {
            (acceptance.accepts(block.tag(lane)), distance_squared)
        });
    }
}

/// A [`Collector`] that orders photons as [`SearchRegion::Disc`] does.
struct Flat<'a, 'b> {
    centre: Vec3,
    collector: &'a mut Collector<'b>,
}

impl Visitor<LEAF> for Flat<'_, '_> {
    #[inline]
    fn bound(&self) -> f32 {
        self.collector.bound
    }

    #[inline]
    fn wants(&self, normals: u32) -> bool {
        self.collector.accept.may_accept(normals)
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; LEAF], block: &Block<LEAF>) {
        self.collector.take(first, distances_squared, |acceptance, lane, distance_squared| {
            let (accepted, normals) = acceptance.judge(block.tag(lane));
            (accepted, flattened(distance_squared, block.position(lane) - self.centre, normals))
        });
    }
}

/// Keeps the nearest accepted point.
pub(super) struct NearestOne<F> {
    best: u64,
    bound: f32,
    measure: F,
}

/// A key that no point has: its distance is not a number.
pub(super) const NO_KEY: u64 = u64::MAX;

impl<F> NearestOne<F> {
    /// Searches within `max_radius`; a negative radius contains nothing. `measure` takes index, tag, squared distance
    /// and position, and returns the squared distance that counts for an accepted point, which must be no less than the
    /// given one.
    pub(super) fn new(max_radius: f32, measure: F) -> Self {
        let bound = if max_radius >= 0.0 { max_radius * max_radius } else { -1.0 };
        Self { best: NO_KEY, bound, measure }
    }

    /// Key of the nearest point.
    pub(super) fn best(&self) -> Option<u64> {
        (self.best != NO_KEY).then_some(self.best)
    }
}

impl<const L: usize, F: Fn(usize, u16, f32, Vec3) -> Option<f32>> Visitor<L> for NearestOne<F> {
    #[inline]
    fn bound(&self) -> f32 {
        self.bound
    }

    #[inline]
    fn visit(&mut self, first: u32, distances_squared: &[f32; L], block: &Block<L>) {
        for (lane, &distance_squared) in distances_squared.iter().enumerate() {
            let index = first + lane as u32;
            // Ties go to the lower index.
            if distance_squared <= self.bound && key_of(index, distance_squared) < self.best {
                let measured =
                    (self.measure)(index as usize, block.tag(lane), distance_squared, block.position(lane));
                let key = measured.map_or(NO_KEY, |distance_squared| key_of(index, distance_squared));
                if key < self.best && measured <= Some(self.bound) {
                    self.best = key;
                    self.bound = distance_squared_of(key);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream, warp};
    use proptest::prelude::*;

    fn photon_at(position: Vec3, normal: Vec3, rng: &mut Rng) -> Photon {
        let class = if rng.next_f32() < 0.1 { PhotonClass::Shadow } else { PhotonClass::Indirect };
        Photon::new(position, Rgb::new(1.0, 0.5, rng.next_f32()), normal, normal, class, rng.next_f32())
    }

    /// Photons in usual and unusual arrangements: in space, on axis-aligned planes, on lines, at few places, at one.
    fn photons_of(kind: u32, count: usize, seed: u64) -> Vec<Photon> {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        (0..count)
            .map(|i| {
                let u = Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
                let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
                let side = (rng.next_u64() % 6) as usize;
                let (position, normal) = match kind {
                    0 => (u, warp::square_to_sphere(rng.next_2d())),
                    1 => (axes[side] + u - u * axes[side].abs(), axes[side]),
                    2 => (Vec3::X * u.x, Vec3::Y),
                    3 => ((u * 3.0).floor(), axes[side]),
                    4 => (Vec3::ONE, axes[side]),
                    _ => (Vec3::splat(i as f32), Vec3::Z),
                };
                photon_at(position, normal, &mut rng)
            })
            .collect()
    }

    /// All keys that `query` accepts, by comparing every photon.
    fn brute_force(map: &PhotonMap, query: &Query) -> Vec<u64> {
        let metric = |photon: &Photon| {
            let v = photon.position - query.position;
            let (x, y, z) = (v.x, v.y, v.z);
            let euclid = x * x + y * y + z * z;
            match query.region {
                SearchRegion::Sphere => euclid,
                SearchRegion::Disc => flattened(euclid, v, photon.normal() + query.normal),
            }
        };
        let mut keys: Vec<u64> = map
            .photons()
            .enumerate()
            .filter(|(_, photon)| photon.normal().dot(query.normal) >= query.min_normal_cos)
            .filter(|(_, photon)| query.classes.contains(photon.class()))
            .map(|(index, photon)| key_of(index as u32, metric(&photon)))
            .filter(|&key| distance_squared_of(key) <= query.max_radius * query.max_radius)
            .collect();
        keys.sort_unstable();
        keys.truncate(query.k);
        keys
    }

    fn sorted(found: Neighbours) -> Vec<u64> {
        let mut keys: Vec<u64> = found.iter().map(|(index, d)| key_of(index as u32, d)).collect();
        assert_eq!(keys.iter().max(), keys.last());
        keys.sort_unstable();
        keys
    }

    proptest! {
        #[test]
        fn search_equals_brute_force(
            kind in 0u32..6,
            count in prop_oneof![0usize..70, 70usize..3000],
            k in prop_oneof![0usize..4, 4usize..100, Just(usize::MAX)],
            seed in any::<u64>(),
            radius in prop_oneof![Just(f32::INFINITY), 0f32..2.0],
            disc in any::<bool>(),
            every_class in any::<bool>(),
        ) {
            let map = PhotonMap::build(photons_of(kind, count, seed), 1);
            prop_assert_eq!(map.len(), count);
            let mut rng = Rng::new(seed, Stream::Measure, 1);
            let mut scratch = Scratch::default();
            for i in 0..5 {
                let position = if i < 3 && count > 0 {
                    map.photon(rng.next_u64() as usize % count).position
                } else {
                    Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 2.0
                };
                let query = Query {
                    position,
                    normal: warp::square_to_sphere(rng.next_2d()),
                    max_radius: radius,
                    k,
                    region: if disc { SearchRegion::Disc } else { SearchRegion::Sphere },
                    min_normal_cos: if i % 2 == 0 { -2.0 } else { MIN_NORMAL_COS },
                    classes: if every_class { PhotonClasses::ALL } else { PhotonClasses::LIGHT },
                    differential_check: false,
                    radius_share: 1.0,
                    faint: 0.0,
                    narrower: false,
                };
                let wanted = brute_force(&map, &query);
                prop_assert_eq!(&sorted(map.search(&query, &mut scratch)), &wanted);

                let odd = |photon: &Photon| photon.payload_bits() % 2 == 1;
                let all = brute_force(&map, &Query { k: usize::MAX, ..query });
                let wanted = all.iter().find(|&&key| odd(&map.photon(index_of(key))));
                let found = map.nearest_one(&query, odd);
                prop_assert_eq!(found, wanted.map(|&key| (index_of(key), distance_squared_of(key))));
            }
        }
    }
}
