use super::map::{PhotonMap, Query, Scratch};
use super::{Estimator, Kernel};
use crate::math::Rgb;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// How photons are weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateParams {
    /// Weight of a photon by its distance.
    pub kernel: Kernel,
    /// Whether the photon that sets the radius counts.
    pub estimator: Estimator,
}

/// An estimate of density, and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Irradiance in W m^-2 or radiance in W m^-2 sr^-1, as the function says. Always finite; zero without photons.
    pub value: Rgb,
    /// Count of photons in the sum.
    pub photons: u32,
    /// Radius of the disc that the sum was divided by.
    pub radius: f32,
}

impl PhotonMap {
    /// Irradiance at the query's position, on the side of its normal: `sum w dPhi / (n pi r^2)` over the photons
    /// found, divided by the count emitted, after eq. (3) and (5) of Jensen 1996 without the BRDF.
    ///
    /// A photon carries flux, which has the cosine of incidence in it already: the sum contains no cosine and
    /// needs none. Its `pi` is that of the disc's area alone.
    ///
    /// The radius is the distance of the `k`-th photon. [`Estimator::Corrected`] does not count that photon
    /// itself, and takes at least two; the expectation is then exact where photons lie uniformly (Garcia, Urena
    /// & Sbert 2012), for every kernel. Where fewer than `k` lie within [`Query::max_radius`], that is the radius
    /// and all count; with `k = usize::MAX` this is the estimate of fixed radius. Only where that is infinite as
    /// well does the farthest photon of the map stand in for the `k`-th.
    ///
    /// The radius is no less than eight times the spacing of `f32` at the largest coordinate of the map: closer
    /// than that, places cannot be told apart. Photons that coincide thus give a large and finite value, which
    /// over the disc of that radius amounts to their flux.
    pub fn estimate_irradiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
    ) -> Estimate {
        self.estimate(query, params, scratch, |index| self.power(index))
    }

    /// Radiance that the surface at the query's position reflects towards some `wo`: eq. (3) and (5) of Jensen 1996.
    ///
    /// `brdf` is `f_r(wo, wi)` in sr^-1 as a function of the unit direction `wi`, which points away from the surface;
    /// it contains no cosine of incidence, since the flux of a photon has it already. For all else see
    /// [`Self::estimate_irradiance`]; a constant `f_r` gives that times `f_r`.
    pub fn estimate_radiance(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        mut brdf: impl FnMut(Vec3) -> Rgb,
    ) -> Estimate {
        self.estimate(query, params, scratch, |index| {
            let payload = self.payload(index);
            payload.power.decode() * brdf(payload.wi())
        })
    }

    fn estimate(
        &self,
        query: &Query,
        params: &EstimateParams,
        scratch: &mut Scratch,
        mut contribution: impl FnMut(usize) -> Rgb,
    ) -> Estimate {
        let corrected = params.estimator == Estimator::Corrected;
        let least_radius = self.least_radius(query.position);
        let query = Query {
            k: if corrected { query.k.max(2) } else { query.k.max(1) },
            max_radius: query.max_radius.max(least_radius),
            ..*query
        };
        let mut found = self.search(&query, scratch);
        // The farthest sets the radius if it is the k-th, or if nothing else does.
        let mut farthest_sets_radius = found.is_complete() || query.max_radius == f32::INFINITY;
        let mut radius =
            if farthest_sets_radius { found.farthest_squared().sqrt() } else { query.max_radius };
        if farthest_sets_radius && radius < least_radius && !found.is_empty() {
            found = self.search(&Query { k: usize::MAX, max_radius: least_radius, ..query }, scratch);
            (farthest_sets_radius, radius) = (false, least_radius);
        }
        let photons = found.len().saturating_sub(usize::from(corrected && farthest_sets_radius));
        if photons == 0 {
            return Estimate { value: Rgb::ZERO, photons: 0, radius };
        }
        let per_radius_squared = 1.0 / (radius * radius);
        let mut sum = DVec3::ZERO;
        for (index, distance_squared) in found.iter().take(photons) {
            let weight = params.kernel.weight((distance_squared * per_radius_squared).min(1.0));
            sum += (contribution(index) * weight).as_dvec3();
        }
        let area = PI * f64::from(radius) * f64::from(radius);
        let scale = self.per_emitted() / (f64::from(params.kernel.mean_weight()) * area);
        // Flux of 1e30 W at one point exceeds what f32 can hold.
        let value = (sum * scale).min(DVec3::splat(f64::from(f32::MAX))).as_vec3();
        Estimate { value, photons: photons as u32, radius }
    }
}
