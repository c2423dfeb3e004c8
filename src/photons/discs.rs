//! Irradiance and area at photons: oriented discs for brick maps (Christensen & Batali 2004, section 4).

use super::domain::{KernelDomain, Seen, Sight};
use super::estimate::EstimateParams;
use super::irradiance::DirectLight;
use super::map::{PhotonMap, Query, Scratch};
use super::photon::{Photon, PhotonClass, PhotonClasses};
use crate::bricks::Disc;
use crate::math::Rgb;
use rayon::prelude::*;

/// A disc next to an obstacle, or to the end of its surface, is no smaller than this share of the radius of its estimate, so that no hole
/// remains there.
const LEAST_SEEN: f32 = 0.2;

/// An estimate from fewer photons than this describes no place: look-ups find nothing there.
const FEWEST: u32 = 8;

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

    fn sees(&mut self, position: glam::Vec3, normal: glam::Vec3) -> bool {
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

impl PhotonMap {
    /// Irradiance and area at each of `photons`, in their order, from the photons of this map, which must hold them and all others within
    /// `template.max_radius` of them. Discs of estimates from fewer than 8 photons of all light, or of places that see only a negligible part of their disc,
    /// are left out.
    ///
    /// `template` holds the search parameters; `sight` finds what can be seen from a place with a normal. If `direct` is given, it returns the
    /// direct irradiance of a point (its number counted from `first`, position, normal), and photons are asked for reflected light alone.
    ///
    /// A photon takes part in its own estimate, and must: what a brick map shows is the mean of discs over their area. With the k nearest
    /// photons, itself among them and without the farthest, a disc of radius r has the irradiance (k - 1) P / (pi r^2), so that each adds the
    /// same flux. The mean of pi r^2 is (k - 1) over the density of photons, so the ratio of both sums is that density times P, without bias.
    ///
    /// The result does not depend on the number of threads. Once `stop` returns true, it is incomplete.
    pub fn discs<S: Sight>(
        &self,
        photons: &[Photon],
        (template, params): (&Query, &EstimateParams),
        sight: impl Fn(glam::Vec3, glam::Vec3) -> S + Sync,
        direct: Option<(&DirectLight<'_>, u64)>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Vec<Disc> {
        // A separate tree: in the full tree a search would visit all the nearer photons of other classes.
        let reflected = direct.map(|_| {
            let indirect = PhotonClasses::only(PhotonClass::Indirect);
            self.only(indirect.and(PhotonClasses::only(PhotonClass::Caustic)))
        });
        let disc = |scratch: &mut Scratch, (number, photon): (usize, &Photon)| {
            if stop() {
                return None;
            }
            let (position, normal) = (photon.position, photon.normal());
            let query = template.at(position, normal);
            let by_lights =
                direct.and_then(|(direct, first)| direct(first + number as u64, position, normal));
            let map = reflected.as_ref().filter(|_| by_lights.is_some()).unwrap_or(self);
            let mut noting = Noting { sight: sight(position, normal), reach: f32::INFINITY };
            let by_photons = map.estimate_irradiance_visible(&query, params, scratch, &mut noting);
            // Where direct light is known, even no photon at all says that little is reflected there.
            let is_enough = by_lights.is_some() || by_photons.photons >= FEWEST;
            if !is_enough || !by_photons.is_local {
                return None;
            }
            // The density of all photons sets the area.
            let detail = if by_lights.is_some() {
                let all = self.search(&query, scratch);
                if all.is_complete() { all.farthest_squared().sqrt() } else { query.max_radius }
            } else {
                by_photons.radius
            };
            let detail = detail.min(query.max_radius).max(super::estimate::least_radius(position));
            let radius = noting.reach.max(LEAST_SEEN * detail).min(detail);
            // Within a fixed radius the areas of discs do not make up for the photon itself, which is always there.
            let is_own = by_lights.is_none() || photon.class() != PhotonClass::Direct;
            let count = by_photons.photons as f32;
            let others = if is_own && by_photons.radius >= query.max_radius {
                (count - 1.0) / count.max(1.0)
            } else {
                1.0
            };
            let irradiance = others * by_photons.value + by_lights.unwrap_or(Rgb::ZERO);
            // The response to single wavelengths may be negative in a channel; where few photons have other wavelengths, so is the sum.
            let irradiance = irradiance.max(Rgb::ZERO);
            Some(Disc { position, normal, radius, detail, irradiance })
        };
        let discs: Vec<Option<Disc>> =
            photons.par_iter().enumerate().with_max_len(256).map_init(Scratch::default, disc).collect();
        discs.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photons::{Estimator, Kernel, NORMAL_ERROR, SearchRegion};
    use crate::sampling::{Rng, Stream};
    use glam::Vec3;

    const PARAMS: EstimateParams =
        EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };

    /// Photons of power one, spread evenly over the unit square.
    fn square(count: usize, seed: u64) -> Vec<Photon> {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        (0..count)
            .map(|_| {
                let position = rng.next_2d().extend(0.0);
                Photon::new(position, Rgb::ONE, Vec3::Z, Vec3::Z, PhotonClass::Direct, 0.5)
            })
            .collect()
    }

    fn query(k: usize, max_radius: f32) -> Query {
        Query { region: SearchRegion::Disc, max_radius, ..Query::nearest(Vec3::ZERO, Vec3::Z, k) }
    }

    fn discs_at(photons: &[Photon], around: &[Photon], (k, reach): (usize, f32)) -> Vec<Disc> {
        let map = PhotonMap::build(around.to_vec(), 1);
        map.discs(photons, (&query(k, reach), &PARAMS), |_, _| |_| None, None, &|| false)
    }

    /// The mean over area is the density of photons, though few photons are in each estimate. With k - 1 in place of k it would be off by a
    /// tenth.
    #[test]
    fn the_mean_of_discs_over_area_has_no_bias() {
        let (mut flux, mut area) = (0f64, 0f64);
        let count = 20_000;
        for seed in 0..8 {
            let photons = square(count, seed);
            for disc in discs_at(&photons, &photons, (10, 0.1)) {
                // Discs at the rim reach beyond the photons.
                if (disc.position.truncate() - 0.5).abs().max_element() < 0.45 {
                    let own = f64::from(disc.radius).powi(2);
                    area += own;
                    flux += own * f64::from(disc.irradiance.x);
                }
                assert!(disc.radius == disc.detail && (disc.normal - Vec3::Z).length() <= NORMAL_ERROR);
            }
        }
        let ratio = flux / area / count as f64;
        println!("mean of discs over the density of photons: {ratio}");
        // Of 130,000 photons in the middle; their number is known to 0.2 %.
        assert!((ratio - 1.0).abs() < 0.012, "{ratio}");
    }

    /// Where photons are taken group by group, with those within the largest radius around, nothing shows where groups meet.
    #[test]
    fn groups_have_no_seam() {
        let all = square(6000, 1);
        let whole = discs_at(&all, &all, (50, 0.08));
        let mut parts = Vec::new();
        let (mut alone, mut worst) = (Vec::new(), 0f32);
        for half in [true, false] {
            let own: Vec<Photon> =
                all.iter().filter(|photon| (photon.position.x < 0.5) == half).copied().collect();
            let near = |photon: &&Photon| {
                (photon.position.x < 0.58) == half || (photon.position.x - 0.5).abs() <= 0.08
            };
            let around: Vec<Photon> = all.iter().filter(near).copied().collect();
            parts.extend(discs_at(&own, &around, (50, 0.08)));
            alone.extend(discs_at(&own, &own, (50, 0.08)));
        }
        let find = |discs: &[Disc], disc: &Disc| {
            *discs.iter().find(|found| found.position == disc.position).unwrap()
        };
        for disc in &whole {
            let part = find(&parts, disc);
            assert!(
                (part.irradiance - disc.irradiance).abs().max_element() <= 1e-4 * disc.irradiance.x,
                "{disc:?} {part:?}"
            );
            assert_eq!(part.radius, disc.radius);
            let seam = find(&alone, disc);
            worst = worst.max((seam.irradiance.x / disc.irradiance.x - 1.0).abs());
        }
        println!("seam without the neighbours' photons: {worst:.2} of the irradiance");
        assert!(worst > 0.2, "{worst}");
    }

    /// Few photons describe no place.
    #[test]
    fn lone_photons_are_left_out() {
        let few = square(7, 2);
        assert!(discs_at(&few, &few, (50, 10.0)).is_empty());
        assert!(discs_at(&[], &[], (50, 10.0)).is_empty());
    }
}
