//! Narrowing of map lookups in the rounds of progressive rendering, so that the bias vanishes as the number of rounds grows.

use super::PhotonMapSettings;
use crate::math::Rgb;
use crate::photons::{Estimate, NARROWER, Query};
use glam::Vec3;

/// Narrowing of the biased estimates in one round (Knaus & Zwicker, "Progressive Photon Mapping: A Probabilistic Approach", ACM
/// Transactions on Graphics 30(3), 2011; the radius schedule is in `render::progressive`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Narrowing {
    /// Radius of a caustic estimate over the distance of the farthest of its nearest photons, in (0, 1].
    pub nearest_share: f32,
    /// Factor on the largest and fixed radii, and on those of estimates behind a diffuse reflection, in (0, 1].
    pub radius_share: f32,
    /// Probability with which the global map is read where a gather ray ends, in [0, 1]. Otherwise the four integrals there are
    /// evaluated with one further gather ray, whose light is not biased.
    pub read_share: f32,
}

/// Smallest number of photons that determine the radius of an estimate: with fewer, the radius itself is too uncertain. A narrower disc
/// is a fraction of the disc of this many photons.
const FEWEST: u32 = 16;

impl Narrowing {
    /// Narrowing of a round whose discs have the relative `area`, in (0, 1], of those of the first round, which used `nearest` photons.
    /// Also returns the number of photons that determine the radius: as many as are expected within the disc, or a small minimum where
    /// that is less.
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

    /// Narrows a `query` for the nearest photons, or for all photons within a radius.
    pub(super) fn narrow(&self, query: Query) -> Query {
        if query.k == usize::MAX {
            return Query { max_radius: query.max_radius * self.radius_share, narrower: true, ..query };
        }
        // The query multiplies its largest radius by the share of the nearest as well, so that this is divided out.
        let max_radius = query.max_radius * self.radius_share / self.nearest_share;
        Query { max_radius, radius_share: self.nearest_share, narrower: true, ..query }
    }
}

impl PhotonMapSettings {
    /// A query of the caustic map behind a diffuse reflection in a progressive round. It uses fewer photons: the result is a mean over
    /// many places, where noise matters less than time.
    pub(super) fn caustic_query_behind(&self, narrowing: Narrowing, position: Vec3, normal: Vec3) -> Query {
        let nearest = FEWEST.min(self.caustic_nearest);
        let query = self.query(position, normal, nearest, self.caustic_radius);
        let narrowed = Narrowing { nearest_share: narrowing.radius_share, ..narrowing }.narrow(query);
        Query { narrower: false, ..narrowed }
    }
}

/// Probability in the first round with which the global map is read where a gather ray ends. It is below one, so that lookups can be
/// compared with unbiased values.
const READ_AT_FIRST: f64 = 0.5;

/// Expected bias of an estimate, from the same estimate over half of the area. An edge between light and dark is blurred in proportion
/// to the radius, b(r) = c r, so that b(r) = (L(r) - L(q r)) / (1 - q). Where light changes smoothly, b(r) = c r^2, the result is 1.7
/// times too large.
pub(super) fn bias_of(estimate: &Estimate) -> Rgb {
    (estimate.value - estimate.narrower) / (1.0 - NARROWER)
}
