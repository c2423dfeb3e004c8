//! What a round of progressive rendering reads of its maps, so that bias vanishes with the rounds.

use super::PhotonMapSettings;
use crate::math::Rgb;
use crate::photons::{Estimate, NARROWER, Query};
use glam::Vec3;

/// How far a round has narrowed what is biased (Knaus & Zwicker, "Progressive Photon Mapping: A Probabilistic Approach", ACM
/// Transactions on Graphics 30(3), 2011; the law is in `render::progressive`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Narrowing {
    /// Radius of a caustic estimate over the distance of the farthest of its nearest photons, in (0, 1].
    pub nearest_share: f32,
    /// What the largest and fixed radii are multiplied by, and those of estimates behind a diffuse reflection, in (0, 1].
    pub radius_share: f32,
    /// Probability with which the global map is read where a gather ray ends, in [0, 1]. Else the four integrals there are
    /// evaluated, with one gather ray that goes on from there, and whose light is not biased.
    pub read_share: f32,
}

/// Photons for the radius of an estimate, at least: of fewer, the radius itself is too uncertain. Narrower discs are a share
/// of theirs.
const FEWEST: u32 = 16;

impl Narrowing {
    /// That of a round whose discs have `area` of the first round's, in (0, 1], where the first took `nearest` photons; and
    /// the photons that set the radius. They number as many as are expected within the disc, or a few where that is less.
    pub fn by_area(area: f64, nearest: u32) -> (Self, u32) {
        let wanted = area * f64::from(nearest);
        let photons = (wanted.ceil() as u32).clamp(FEWEST.min(nearest), nearest).max(1);
        let narrowing = Self {
            nearest_share: (wanted / f64::from(photons)).sqrt() as f32,
            radius_share: area.sqrt() as f32,
            read_share: (READ_AT_FIRST * area) as f32,
        };
        (narrowing, photons)
    }

    /// `query`, which asks for the nearest or for all within a radius, narrowed.
    pub(super) fn narrow(&self, query: Query) -> Query {
        if query.k == usize::MAX {
            return Query { max_radius: query.max_radius * self.radius_share, narrower: true, ..query };
        }
        // The largest radius is multiplied by the share of the nearest as well.
        let max_radius = query.max_radius * self.radius_share / self.nearest_share;
        Query { max_radius, radius_share: self.nearest_share, narrower: true, ..query }
    }
}

impl PhotonMapSettings {
    /// A query of the caustic map behind a diffuse reflection in a progressive round: of fewer photons, as what is seen is the
    /// mean over many places, where noise matters less than time.
    pub(super) fn caustic_query_behind(&self, narrowing: Narrowing, position: Vec3, normal: Vec3) -> Query {
        let nearest = FEWEST.min(self.caustic_nearest);
        let query = self.query(position, normal, nearest, self.caustic_radius);
        let narrowed = Narrowing { nearest_share: narrowing.radius_share, ..narrowing }.narrow(query);
        Query { narrower: false, ..narrowed }
    }
}

/// Probability in the first round with which the global map is read where a gather ray ends. Below one, so that what is read
/// can be compared with what is so.
const READ_AT_FIRST: f64 = 0.5;

/// By how much an estimate is expected to be off, from the same over half of the area: a border between light and dark is
/// blurred in proportion to the radius, b(r) = c r, so that b(r) = (L(r) - L(q r)) / (1 - q). Where light changes smoothly,
/// b(r) = c r^2, this is 1.7 times too much.
pub(super) fn bias_of(estimate: &Estimate) -> Rgb {
    (estimate.value - estimate.narrower) / (1.0 - NARROWER)
}
