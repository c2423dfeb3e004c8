//! Decides from photons whether a light is fully visible, partly visible or hidden, with a bound on the error.
//!
//! The photons that one light sends to the surface around a point are independent samples of its light there, and each
//! of them is either stopped on its way or not. If a share `p` of that light were stopped, `n` photons would all arrive
//! with probability `(1 - p)^n`. So `n` photons of one class show, with confidence `1 - (1 - p)^n`, that less than `p`
//! of the light is of the other class: the exact (Clopper-Pearson) bound for no event among `n`. For [`PHOTONS`]
//! photons that share is [`LARGEST_UNSEEN_SHARE`] with confidence [`CONFIDENCE`]; a share of 2 % is missed once in 10⁴,
//! one of 3 % once in 10⁶.
//!
//! A shadow may be missed if it takes less than that share from the surface within the radius of those photons. For a
//! straight and fully dark strip through the middle of that disc this means a width below `0.8 %` of its diameter.

use super::kd_tree::{KdTree, Point};
use super::map::{NearestOne, index_of};
use super::photon::{Acceptance, PhotonClasses, normal_code};
use super::shadow::TracedShadows;
use super::{Photon, PhotonClass, PhotonMap, Query, Scratch};
use glam::Vec3;
use rayon::prelude::*;

/// Share of a light's contribution around a point that may be blocked (or visible) without being noticed.
pub const LARGEST_UNSEEN_SHARE: f64 = 0.01;

/// Least probability that such a share is noticed.
pub const CONFIDENCE: f64 = 0.99;

/// Photons that must agree: the smallest `n` with `(1 - share)^n <= 1 - confidence`.
const PHOTONS: usize = 459;

/// One in this number of photons becomes a place where a decision is stored.
const STRIDE: usize = 8;

/// Least cosine between the normals of a place and of the decision that is used there: 25 degrees.
const MIN_NORMAL_COS: f32 = 0.906;

/// Visibility of a light at a point, as the photons show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShadowDecision {
    /// The light is fully visible.
    Lit,
    /// The light is fully hidden.
    Shadow,
    /// Direct and shadow photons are mixed here: a shadow ray must decide.
    Mixed,
    /// Too few photons for a decision: a shadow ray must decide.
    TooFew,
}

/// Decisions at some of the photons of one light.
///
/// At a place `c` the nearest [`PHOTONS`] photons of one class, on the same surface and facing alike, lie within `r`,
/// and the nearest of the other class at `d`. The sphere of radius `r + x` around a point at distance `x` from `c`
/// holds those photons and lies within `r + 2 x` of `c`: while that is below `d` it holds none of the other class. So
/// the decision at `c` is valid for all points within `(d - r) / 2`.
#[derive(Debug)]
pub(super) struct DecisionMap {
    tree: KdTree<LEAF>,
    /// Surface, and validity radius of the decision.
    places: Vec<(u32, f32)>,
    largest_reach: f32,
}

/// Points in a leaf: few, since a search looks for one point only.
const LEAF: usize = 8;

#[derive(Clone, Copy)]
struct Place {
    position: Vec3,
    surface: u32,
    reach: f32,
    /// Code of the normal and class of the photon, as in a photon's flags.
    flags: u16,
}

impl Point for Place {
    fn position(&self) -> Vec3 {
        self.position
    }

    fn tag(&self) -> u16 {
        self.flags
    }

    fn tie(&self) -> u64 {
        u64::from(self.reach.to_bits()) << 32 | u64::from(self.surface) << 16 | u64::from(self.flags)
    }
}

impl DecisionMap {
    pub(super) fn build(traced: &TracedShadows, max_radius: f32) -> Self {
        let mut by_surface: Vec<(u32, u32)> =
            traced.surfaces.iter().enumerate().map(|(i, &surface)| (surface, i as u32)).collect();
        by_surface.par_sort_unstable();
        let groups: Vec<&[(u32, u32)]> = by_surface.chunk_by(|a, b| a.0 == b.0).collect();
        let mut places = Vec::new();
        for group in groups {
            // Too few even if all agree: a photon does not count in the decision at its own place.
            if group.len() <= PHOTONS {
                continue;
            }
            let photons: Vec<Photon> = group.iter().map(|&(_, i)| traced.photons[i as usize]).collect();
            // Every eighth photon in the order of tracing, which is random.
            let centers: Vec<Photon> = photons.iter().step_by(STRIDE).copied().collect();
            let map = PhotonMap::build(photons, 1);
            let surface = group[0].0;
            places.par_extend(centers.par_iter().with_max_len(256).map_init(
                Scratch::default,
                |scratch, center| {
                    let reach = reach(&map, center, max_radius, scratch);
                    let class = if reach > 0.0 { center.class() } else { PhotonClass::Indirect };
                    let flags = normal_code(center.normal()) | (class as u16) << 12;
                    Place { position: center.position, surface, reach, flags }
                },
            ));
        }
        let tree = KdTree::build(&mut places);
        let largest_reach = places.iter().map(|place| place.reach).fold(0.0, f32::max);
        Self {
            tree,
            places: places.iter().map(|place| (place.surface, place.reach)).collect(),
            largest_reach,
        }
    }

    /// The decision for a place of `surface` with the unit geometric `normal` on the side that is looked up.
    #[inline]
    pub(super) fn decide(&self, position: Vec3, normal: Vec3, surface: u32) -> ShadowDecision {
        let acceptance = Acceptance::new(normal, MIN_NORMAL_COS, PhotonClasses::ALL);
        let mut found = PhotonClass::Indirect;
        let mut visitor = NearestOne::new(self.largest_reach, |index: usize, flags, distance_squared, _| {
            (acceptance.accepts(flags) && self.places[index].0 == surface).then_some(distance_squared)
        });
        self.tree.search(position, &mut visitor);
        let Some(key) = visitor.best() else { return ShadowDecision::TooFew };
        let index = index_of(key);
        let distance = (self.tree.position(index) - position).length();
        let reach = self.places[index].1;
        if reach > 0.0 {
            found = super::photon::decode_class(self.tree.tag(index));
        }
        match found {
            PhotonClass::Direct if distance <= reach => ShadowDecision::Lit,
            PhotonClass::Shadow if distance <= reach => ShadowDecision::Shadow,
            PhotonClass::Direct | PhotonClass::Shadow => ShadowDecision::TooFew,
            PhotonClass::Indirect | PhotonClass::Caustic => ShadowDecision::Mixed,
        }
    }

    pub(super) fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + self.places.capacity() * size_of::<(u32, f32)>()
    }
}

/// Validity radius of the class of `center` around it; zero where the classes mix or photons are too few.
fn reach(map: &PhotonMap, center: &Photon, max_radius: f32, scratch: &mut Scratch) -> f32 {
    let (own, other) = match center.class() {
        PhotonClass::Shadow => (PhotonClass::Shadow, PhotonClass::Direct),
        PhotonClass::Direct | PhotonClass::Indirect | PhotonClass::Caustic => {
            (PhotonClass::Direct, PhotonClass::Shadow)
        }
    };
    let agreeing = Query {
        max_radius,
        classes: PhotonClasses::only(own),
        // The centre was chosen because of its class, so it gives no evidence of the class around it.
        ..Query::nearest(center.position, center.normal(), PHOTONS + 1)
    };
    let found = map.search(&agreeing, scratch);
    if !found.is_complete() {
        return 0.0;
    }
    let radius = found.farthest_squared().sqrt();
    let contrary = Query { max_radius: 2.0 * radius, classes: PhotonClasses::only(other), ..agreeing };
    let distance = map.nearest_one(&contrary, |_| true).map_or(2.0 * radius, |(_, squared)| squared.sqrt());
    (0.5 * (distance - radius)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    #[test]
    fn photons_are_as_many_as_the_confidence_asks_for() {
        let missed = |n: usize| (1.0 - LARGEST_UNSEEN_SHARE).powi(n as i32);
        assert!(missed(PHOTONS) <= 1.0 - CONFIDENCE && missed(PHOTONS - 1) > 1.0 - CONFIDENCE);
    }

    /// Photons on the unit square, in shadow where `in_shadow` is true.
    fn traced(count: u64, seed: u64, in_shadow: impl Fn(Vec3, &mut Rng) -> bool) -> TracedShadows {
        let mut all = TracedShadows::default();
        for i in 0..count {
            let mut rng = Rng::new(seed, Stream::Measure, i);
            let u = rng.next_2d();
            let position = Vec3::new(u.x, 0.0, u.y);
            let class = if in_shadow(position, &mut rng) { PhotonClass::Shadow } else { PhotonClass::Direct };
            all.photons.push(Photon::new(position, Vec3::ONE, Vec3::Y, Vec3::Y, class, 0.0));
            all.surfaces.push(7);
        }
        all
    }

    #[test]
    fn pure_areas_are_decided_and_others_are_not() {
        let half = traced(200_000, 1, |p, _| p.x < 0.5);
        let map = DecisionMap::build(&half, 1.0);
        // A disc of 459 of 200 000 photons on one square metre has this radius, and at edges twice it.
        let radius = (459.0 / 200_000.0 / std::f32::consts::PI).sqrt();
        let mut undecided = 0;
        for i in 0..2000 {
            let mut rng = Rng::new(2, Stream::Measure, i);
            let u = rng.next_2d();
            let decision = map.decide(Vec3::new(u.x, 0.0, u.y), Vec3::Y, 7);
            let from_edge = u.x - 0.5;
            match decision {
                ShadowDecision::Lit => assert!(from_edge > 0.4 * radius, "{u}"),
                ShadowDecision::Shadow => assert!(from_edge < -0.4 * radius, "{u}"),
                ShadowDecision::Mixed | ShadowDecision::TooFew => {
                    undecided += u32::from(from_edge.abs() > 2.5 * radius);
                }
            }
        }
        assert!(undecided < 60, "{undecided} of 2000 far from the edge");
        let inside = Vec3::new(0.9, 0.0, 0.5);
        assert_eq!(map.decide(inside, Vec3::Y, 7), ShadowDecision::Lit);
        assert_eq!(map.decide(inside, Vec3::NEG_Y, 7), ShadowDecision::TooFew);
        assert_eq!(map.decide(inside, Vec3::Y, 8), ShadowDecision::TooFew);
        assert_eq!(map.decide(inside + Vec3::Y, Vec3::Y, 7), ShadowDecision::TooFew);
        assert_eq!(map.decide(Vec3::NAN, Vec3::Y, 7), ShadowDecision::TooFew);
    }

    /// A faint shadow everywhere, of the share that may be missed: no more places than stated are decided wrongly.
    #[test]
    fn a_share_goes_unseen_as_rarely_as_stated() {
        for (share, rarely) in [(LARGEST_UNSEEN_SHARE, 1.0 - CONFIDENCE), (0.03, 1e-5)] {
            let (mut places, mut unseen) = (0, 0);
            for seed in 0..8 {
                let faint = traced(50_000, 10 + seed, |_, rng| f64::from(rng.next_f32()) < share);
                let map = DecisionMap::build(&faint, 1.0);
                for i in 0..4000 {
                    let mut rng = Rng::new(seed, Stream::Measure, i);
                    let u = rng.next_2d() * 0.8 + 0.1;
                    places += 1;
                    unseen +=
                        u32::from(map.decide(Vec3::new(u.x, 0.0, u.y), Vec3::Y, 7) == ShadowDecision::Lit);
                }
            }
            let rate = f64::from(unseen) / f64::from(places);
            println!("share {share}: {rate}");
            // Neighbouring places share photons: each map has about a hundred independent discs, so three deviations
            // are generous.
            assert!(rate <= rarely + 3.0 * (rarely / 800.0).sqrt(), "share {share}: {rate}");
        }
    }

    #[test]
    fn too_few_photons_decide_nothing() {
        let map = DecisionMap::build(&traced(PHOTONS as u64, 5, |_, _| false), 1.0);
        assert_eq!(map.decide(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, 7), ShadowDecision::TooFew);
        assert_eq!(map.places.len(), 0);
        let empty = DecisionMap::build(&TracedShadows::default(), 1.0);
        assert_eq!(empty.decide(Vec3::ZERO, Vec3::Y, 0), ShadowDecision::TooFew);
    }
}
