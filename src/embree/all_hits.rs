//! All crossings of a ray with a scene, not only the nearest.

use super::callbacks::UserGeometry;
use super::scene::RawHit;
use crate::math::Ray;
use embree4_sys as sys;

/// Default number of crossings that are kept per ray.
const LIMIT: usize = 4096;

/// Reusable buffer for the crossings of one ray.
///
/// The nearest [`Self::limit`] crossings are kept; [`Self::dropped`] counts the others.
#[derive(Debug)]
pub struct AllHits {
    hits: Vec<Numbered>,
    sorted: Vec<RawHit>,
    /// Parameters that one primitive of user geometry reports.
    pub(super) local: Vec<f32>,
    limit: usize,
    dropped: u64,
}

/// A crossing, and its number among those that its primitive reported in one call.
#[derive(Clone, Copy, Debug)]
struct Numbered {
    hit: RawHit,
    ordinal: u32,
}

impl Numbered {
    /// Sort key: parameter, then instance, geometry, primitive and ordinal, so that the order is the same in every run. Parameters are
    /// positive, so their bits sort like their values.
    fn key(&self) -> (u32, Option<u32>, u32, u32, u32) {
        let hit = &self.hit;
        (hit.t.to_bits(), hit.instance, hit.geometry, hit.primitive, self.ordinal)
    }
}

impl Default for AllHits {
    fn default() -> Self {
        Self::with_limit(LIMIT)
    }
}

impl AllHits {
    /// A buffer for at most `limit` crossings (at least one) of a ray.
    pub fn with_limit(limit: usize) -> Self {
        Self { hits: Vec::new(), sorted: Vec::new(), local: Vec::new(), limit: limit.max(1), dropped: 0 }
    }

    /// Most crossings that are kept per ray.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Crossings of the last ray that were left out, all beyond the farthest one that was kept.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Crossings of the last ray in the order of (parameter, instance, geometry, primitive).
    pub fn sorted(&self) -> &[RawHit] {
        &self.sorted
    }

    pub(super) fn clear(&mut self) {
        self.hits.clear();
        self.sorted.clear();
        self.local.clear();
        self.dropped = 0;
    }

    /// Adds one crossing. It never panics: where there is no memory, the crossing counts as dropped.
    pub(super) fn push(&mut self, hit: RawHit, ordinal: u32) {
        if self.hits.len() >= self.limit.saturating_mul(2) {
            self.shrink();
        }
        if self.hits.len() == self.hits.capacity() && self.hits.try_reserve(1).is_err() {
            self.dropped += 1;
            return;
        }
        self.hits.push(Numbered { hit, ordinal });
    }

    /// Keeps only the nearest `limit` crossings.
    fn shrink(&mut self) {
        if self.hits.len() > self.limit {
            self.hits.select_nth_unstable_by_key(self.limit - 1, Numbered::key);
            self.dropped += (self.hits.len() - self.limit) as u64;
            self.hits.truncate(self.limit);
        }
    }

    /// Sorts the crossings and removes duplicates.
    pub(super) fn finish(&mut self) {
        self.hits.sort_unstable_by_key(Numbered::key);
        self.hits.dedup_by_key(|numbered| numbered.key());
        let beyond = self.hits.len().saturating_sub(self.limit);
        self.dropped += beyond as u64;
        self.hits.truncate(self.limit);
        self.sorted.extend(self.hits.iter().map(|numbered| numbered.hit));
    }
}

/// Query context for all crossings, which callbacks read.
#[repr(C)]
pub(super) struct Collection {
    /// The first field, as Embree knows only this part and passes its address to the callbacks.
    pub(super) context: sys::RTCRayQueryContext,
    pub(super) found: *mut AllHits,
}

/// [`sys::RTCRay::id`] of rays whose context is a [`Collection`]; all other rays have zero.
pub(super) const COLLECTS: u32 = 1;

/// The instance number from Embree's id; `None` for the invalid id.
pub(super) fn instance_of(id: u32) -> Option<u32> {
    (id != sys::RTC_INVALID_GEOMETRY_ID).then_some(id)
}

/// Filter called for each triangle that the ray hits. It keeps the crossing and rejects the hit, so that the traversal continues.
pub(super) unsafe extern "C" fn collect_triangle(arguments: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: valid for the call. This filter is an argument of `CommittedScene::intersect_all` alone, which traces
    // single rays, so N is 1, ray and hit have the layouts of `RTCRay` and `RTCHit`, and the context is a `Collection`
    // whose `found` nobody else uses during the query.
    unsafe {
        let arguments = &*arguments;
        if arguments.N != 1 || *arguments.valid != -1 {
            return;
        }
        *arguments.valid = 0;
        let (ray, hit) = (&*arguments.ray.cast::<sys::RTCRay>(), &*arguments.hit.cast::<sys::RTCHit>());
        let collection = &*arguments.context.cast::<Collection>();
        (*collection.found).push(
            RawHit {
                geometry: hit.geomID,
                primitive: hit.primID,
                instance: instance_of(hit.instID[0]),
                uv: [hit.u, hit.v],
                t: ray.tfar,
            },
            0,
        );
    }
}

/// Adds all crossings of one primitive of user geometry.
pub(super) fn collect_user(
    geometry: &UserGeometry,
    (id, primitive, instance): (u32, u32, Option<u32>),
    ray: &Ray,
    found: &mut AllHits,
) {
    found.local.clear();
    let local = &mut found.local;
    if !geometry.guarded(false, |object| {
        object.intersect_all(primitive, ray, local);
        true
    }) {
        return;
    }
    found.local.sort_unstable_by(f32::total_cmp);
    for ordinal in 0..found.local.len() {
        let t = found.local[ordinal];
        if t > 0.0 && t <= ray.t_max && t < f32::INFINITY {
            let hit = RawHit { geometry: id, primitive, instance, uv: [0.0; 2], t };
            found.push(hit, ordinal as u32);
        }
    }
}
