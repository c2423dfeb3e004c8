//! Density estimates from the photons near a place: irradiance and reflected radiance.

use super::domain::clear_distance;
use super::map::{PhotonMap, Query, Scratch, leaves_surface};
use super::{Estimator, Kernel, KernelDomain, SearchRegion, Seen, Sight, differential};
use crate::math::Rgb;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// How photons are weighted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateParams {
    /// Weight of a photon by its distance.
    pub kernel: Kernel,
    /// Whether the photon that sets the radius counts.
    pub estimator: Estimator,
}

/// A density estimate with its number of photons and its radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Irradiance in W m^-2 or radiance in W m^-2 sr^-1, depending on the function. Always finite; zero without
    /// photons.
    pub value: Rgb,
    /// Number of photons in the sum.
    pub photons: u32,
    /// Radius of the disc that the sum was divided by.
    pub radius: f32,
    /// Whether differential checking left out photons that were found.
    pub at_edge: bool,
    /// The same estimate over the disc of [`NARROWER`] times the radius, from the same photons, where
    /// [`Query::narrower`] asks for it; otherwise [`Self::value`]. The difference between the two shows the bias.
    pub narrower: Rgb,
    /// Whether the disc belongs to this place: more than a negligible part of it can be seen from its centre.
    pub is_local: bool,
}

/// Radius of the second estimate over that of the first, for half of the area.
pub const NARROWER: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Largest number of photons within the least radius. If there are more, the radius shrinks until it holds this number,
/// down to [`FINEST`] times the least radius. This limits the time of a look-up in a point focus.
const MOST_UNRESOLVED: usize = 4096;
const FINEST: f32 = 0.25;

/// Distance of a photon in the surface, over the free height above the centre, up to which its visibility is not
/// tested. It is half of the distance at which a photon at that height would still count as in the surface.
const MOST_OVER_HEADROOM: f32 = 5.0;

/// One plus a margin for the rounding of distances, whatever the order of summation.
const ROUNDED: f32 = 1.0001;

/// Number of photons above or below the surface of the centre that are tested for visibility first, spread evenly over
/// all of them: on rough ground there are dozens. If all of these are visible, the others are assumed to be visible
/// too; otherwise each one is tested.
const MOST_ASKED: usize = 3;

/// Radius below which distances are rounding noise: eight times the spacing of `f32` at `position`. Coordinates of
/// photons within it are no larger than those of `position` plus this radius.
pub(super) fn least_radius(position: Vec3) -> f32 {
    // 1e-18 keeps the square within the normal range at the origin.
    (8.0 * f32::EPSILON * position.abs().max_element()).max(1e-18)
}

impl PhotonMap {
    /// Irradiance at the query's position, on the side of its normal: `sum w dPhi / (n pi r^2)` over the photons found,
    /// divided by the number emitted, after eq. (3) and (5) of Jensen 1996 without the BRDF.
    ///
    /// The flux of a photon already includes the cosine of incidence, so the sum contains no cosine. Its `pi` belongs
    /// to the area of the disc.
    ///
    /// The radius is the distance of the `k`-th photon. [`Estimator::Corrected`] does not count that photon itself, and
    /// takes at least two; the expectation is then exact where photons lie uniformly (Garcia, Urena & Sbert 2012), for
    /// every kernel. Where fewer than `k` lie within [`Query::max_radius`], that is the radius and all photons count;
    /// with `k = usize::MAX` this is the estimate of fixed radius. If `max_radius` is infinite as well, the farthest
    /// photon of the map replaces the `k`-th.
    ///
    /// The radius is no less than eight times the spacing of `f32` at the query, because closer places cannot be told
    /// apart. Photons at one place therefore give a large and finite value, which integrates to their flux over the
    /// disc of that radius. More than 4096 of them count as 4096, in a disc of down to a quarter of that radius.
    ///
    /// With [`Query::differential_check`] the radius may be that of fewer photons. In uniform flux this shifts the mean
    /// by less than 1 % (measured for 50 to 200 photons).
    pub fn estimate_irradiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
    ) -> Estimate {
        self.estimate_irradiance_visible(query, params, scratch, &mut |_| None)
    }

    /// [`Self::estimate_irradiance`] over a visible kernel.
    ///
    /// `sight` finds, for the radius of the estimate, which part of the disc can be seen from its centre. Photons
    /// elsewhere are left out, and the kernel is normalised over the visible part. The expectation stays exact: given
    /// the radius that the `k`-th photon sets, wherever it lies, the others are distributed like the flux.
    ///
    /// Photons above or below the surface of the centre count where there is a free way to them; a few of them are
    /// tested first. All photons are tested in three cases: the nearest is hidden, something is right above the centre,
    /// or only a negligible part of the disc can be seen. A place inside a closed body thus gets nothing from the
    /// photons outside.
    pub fn estimate_irradiance_visible(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        sight: &mut impl Sight,
    ) -> Estimate {
        self.estimate(query, params, scratch, sight, |index| self.power(index))
    }

    /// Radiance that the surface at the query's position reflects towards some `wo`: eq. (3) and (5) of Jensen 1996.
    ///
    /// `brdf` is `f_r(wo, wi)` in sr^-1 as a function of the unit direction `wi`, which points away from the surface;
    /// it contains no cosine of incidence, which the flux of a photon already includes. Everything else is as for
    /// [`Self::estimate_irradiance`]; a constant `f_r` gives that irradiance times `f_r`.
    pub fn estimate_radiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        brdf: impl FnMut(Vec3) -> Rgb,
    ) -> Estimate {
        self.estimate_radiance_visible(query, params, scratch, &mut |_| None, brdf)
    }

    /// [`Self::estimate_radiance`] over a visible kernel; see [`Self::estimate_irradiance_visible`].
    pub fn estimate_radiance_visible(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        sight: &mut impl Sight,
        mut brdf: impl FnMut(Vec3) -> Rgb,
    ) -> Estimate {
        self.estimate(query, params, scratch, sight, |index| {
            let payload = self.payload(index);
            payload.times(brdf(payload.wi()))
        })
    }

    fn estimate(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        sight: &mut impl Sight,
        mut contribution: impl FnMut(usize) -> Rgb,
    ) -> Estimate {
        let corrected = params.estimator == Estimator::Corrected;
        let least_radius = least_radius(query.position);
        let query = Query {
            k: if corrected { query.k.max(2) } else { query.k.max(1) },
            max_radius: query.max_radius.max(least_radius),
            ..*query
        };
        let mut found = self.search(&query, scratch);
        // The farthest photon sets the radius if it is the k-th, or if there is no largest radius.
        let mut farthest_sets_radius = found.is_complete() || query.max_radius == f32::INFINITY;
        let mut radius =
            if farthest_sets_radius { found.farthest_squared().sqrt() } else { query.max_radius };
        let mut at_edge = false;
        if farthest_sets_radius && radius < least_radius && !found.is_empty() {
            let most = query.k.max(MOST_UNRESOLVED);
            found = self.search(&Query { k: most, max_radius: least_radius, ..query }, scratch);
            (farthest_sets_radius, radius) = (false, least_radius);
            if found.is_complete() {
                let farthest = found.farthest_squared().sqrt();
                farthest_sets_radius = farthest > FINEST * least_radius;
                radius = farthest.max(FINEST * least_radius);
            }
        }
        let mut photons = found.len().saturating_sub(usize::from(corrected && farthest_sets_radius));
        if query.differential_check && radius > least_radius {
            let per_radius_squared = 1.0 / (radius * radius);
            let relative = |(index, d)| (d * per_radius_squared, self.payload(index).brightness());
            if let Some(share) = differential::shrink(found.iter().take(photons).map(relative)) {
                radius = (radius * share.sqrt()).max(least_radius);
                photons = found.len();
                at_edge = true;
            }
        }
        let is_part = query.radius_share < 1.0 && radius > least_radius;
        if is_part {
            radius = (radius * query.radius_share.max(0.0)).max(least_radius);
        }
        let nothing =
            Estimate { value: Rgb::ZERO, photons: 0, radius, at_edge, narrower: Rgb::ZERO, is_local: true };
        if photons == 0 {
            return nothing;
        }
        let is_cut = at_edge || is_part;
        let is_inside = |distance_squared: f32| !is_cut || distance_squared <= radius * radius;
        if is_part && !found.iter().take(photons).any(|(_, distance_squared)| is_inside(distance_squared)) {
            return nothing;
        }
        let density = |sum: DVec3, disc: &Disc| {
            let scale = self.per_emitted() / disc.weighted_area(params.kernel);
            // A flux of 1e30 W at one point exceeds the range of f32.
            (sum * scale).min(DVec3::splat(f64::from(f32::MAX))).as_vec3()
        };
        if query.faint > 0.0 && !query.narrower {
            let whole = Disc { radius, domain: None };
            let (mut sum, mut counted) = (DVec3::ZERO, 0);
            for (index, distance_squared) in found.iter().take(photons).filter(|&(_, d)| is_inside(d)) {
                counted += 1;
                sum += (contribution(index) * whole.weight(params.kernel, distance_squared)).as_dvec3();
            }
            let value = density(sum, &whole);
            if value.abs().max_element() <= query.faint {
                return Estimate { value, photons: counted, narrower: value, ..nothing };
            }
        }
        let seen = sight.feel(radius);
        let is_local = !matches!(seen, Seen::Little);
        // Centres of precomputed points are photons, which need no visibility test to themselves.
        let is_here = |distance_squared: f32| distance_squared <= least_radius * least_radius;
        let sees = |sight: &mut _, index: usize| {
            let photon = self.photon(index);
            Sight::sees(sight, photon.position, photon.normal())
        };
        let is_doubtful = |index: usize, distance_squared: f32| {
            let offset = self.position(index) - query.position;
            match query.region {
                // The distance in the list is then larger than the true one, see `flattened`; normals need not be
                // decoded.
                SearchRegion::Disc => distance_squared > ROUNDED * offset.length_squared(),
                SearchRegion::Sphere => {
                    leaves_surface(distance_squared, offset, query.normal + self.normal(index))
                }
            }
        };
        let is_low = |index| (self.position(index) - query.position).dot(query.normal) < 0.0;
        let clear = if sight.feels() && !sight.is_covered() {
            // Not so far that a photon on the outer side of a thin body seems to lie in the surface.
            let reach = seen.least_reach().min(radius);
            clear_distance(reach).min(MOST_OVER_HEADROOM * sight.outlook(reach))
        } else {
            0.0
        };
        // Feelers show a free way to some photons; otherwise the nearest photon is tested. Photons below the centre do
        // not count: they may lie under the surface, as in a gap below the floor of a closed body.
        let height = |index| (self.position(index) - query.position).dot(query.normal);
        let is_beside =
            |(index, d)| d <= clear * clear && height(index) >= -least_radius && !is_doubtful(index, d);
        let is_among_photons = found.iter().take(photons).any(is_beside);
        let is_hidden = !is_among_photons && {
            let nearest = found.iter().take(photons).min_by(|a, b| a.1.total_cmp(&b.1));
            nearest.is_some_and(|(index, d)| !is_here(d) && !sees(&mut *sight, index))
        };
        let asks_each = is_hidden || !is_local || sight.is_covered();
        // Where the centre faces nothing within the radius, nothing hides photons that lie higher.
        let is_open = sight.feels() && sight.outlook(radius) > radius;
        let wide = Disc { radius, domain: seen.part().copied() };
        let narrow = query.narrower.then(|| wide.narrowed());
        let is_counted = |index: usize, distance_squared: f32| {
            is_inside(distance_squared) && wide.contains(|| self.position(index) - query.position)
        };
        let mut add = |sums: &mut Sums, index: usize, distance_squared: f32| {
            sums.photons += 1;
            let brought = contribution(index);
            sums.wide += (brought * wide.weight(params.kernel, distance_squared)).as_dvec3();
            if let Some(narrow) = &narrow
                && distance_squared <= narrow.radius * narrow.radius
                && narrow.contains(|| self.position(index) - query.position)
            {
                sums.narrow += (brought * narrow.weight(params.kernel, distance_squared)).as_dvec3();
            }
        };
        let (mut sums, mut doubtful) = (Sums::default(), Sums::default());
        let mut may_be_hidden = 0;
        for (index, distance_squared) in found.iter().take(photons) {
            if !is_counted(index, distance_squared) {
                continue;
            }
            if asks_each && !is_here(distance_squared) {
                if sees(&mut *sight, index) {
                    add(&mut sums, index, distance_squared);
                }
            } else if is_doubtful(index, distance_squared) {
                add(&mut doubtful, index, distance_squared);
                may_be_hidden += usize::from(!is_open || is_low(index));
            } else {
                add(&mut sums, index, distance_squared);
            }
        }
        if doubtful.photons > 0 {
            let all = || {
                found.iter().take(photons).filter(|&(index, d)| is_counted(index, d) && is_doubtful(index, d))
            };
            let step = may_be_hidden.div_ceil(MOST_ASKED).max(1);
            let mut some = all().filter(|&(index, _)| !is_open || is_low(index)).step_by(step);
            if may_be_hidden == 0 || some.all(|(index, _)| sees(&mut *sight, index)) {
                sums.add(&doubtful);
            } else {
                for (index, distance_squared) in all() {
                    if sees(&mut *sight, index) {
                        add(&mut sums, index, distance_squared);
                    }
                }
            }
        }
        let value = density(sums.wide, &wide);
        let narrower = narrow.as_ref().map_or(value, |narrow| density(sums.narrow, narrow));
        Estimate { value, photons: sums.photons, narrower, is_local, ..nothing }
    }
}

/// Weighted contributions of photons, over the disc and the narrower disc.
#[derive(Clone, Copy, Default)]
struct Sums {
    photons: u32,
    wide: DVec3,
    narrow: DVec3,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.photons += other.photons;
        self.wide += other.wide;
        self.narrow += other.narrow;
    }
}

/// The disc of an estimate.
struct Disc {
    radius: f32,
    /// The visible part of the disc, where it is not the whole disc.
    domain: Option<KernelDomain>,
}

impl Disc {
    /// The disc of [`NARROWER`] times the radius.
    fn narrowed(&self) -> Self {
        let radius = NARROWER * self.radius;
        Self { radius, domain: self.domain.as_ref().map(|domain| domain.narrowed(radius)) }
    }

    /// Whether the point at `offset` from the centre can be seen from it.
    fn contains(&self, offset: impl FnOnce() -> Vec3) -> bool {
        self.domain.as_ref().is_none_or(|domain| domain.contains(offset()))
    }

    fn weight(&self, kernel: Kernel, distance_squared: f32) -> f32 {
        let per_radius_squared = 1.0 / (self.radius * self.radius);
        kernel.weight((distance_squared * per_radius_squared).min(1.0))
    }

    /// Integral of the kernel over the disc.
    fn weighted_area(&self, kernel: Kernel) -> f64 {
        let mean_weight = match &self.domain {
            Some(domain) => domain.mean_weight(kernel),
            None => kernel.mean_weight(),
        };
        f64::from(mean_weight) * (PI * f64::from(self.radius) * f64::from(self.radius))
    }
}

#[cfg(test)]
mod tests;
