//! Reading the maps at a surface.

use super::PhotonMapSettings;
use crate::integrators::Scratch;
use crate::math::Rgb;
use crate::photons::{Estimate, EstimateParams, KernelDomain, PhotonMap, Query, Scratch as PhotonScratch};
use crate::scene::{Scene, Shading};
use glam::Vec3;
use std::cell::Cell;
use std::f32::consts::{FRAC_1_PI, PI};

/// Radiance that the diffuse lobe of a surface reflects of the photons in a map.
pub(super) fn reflected(
    scene: &Scene,
    reading: &PhotonMapSettings,
    what: (&PhotonMap, &Query, &EstimateParams),
    shading: &Shading,
    scratch: &mut Scratch,
) -> Rgb {
    reflected_estimate(scene, reading, what, shading, scratch).value
}

/// The same radiance, with the count of photons it rests on and their radius.
pub(super) fn reflected_estimate(
    scene: &Scene,
    reading: &PhotonMapSettings,
    what: (&PhotonMap, &Query, &EstimateParams),
    shading: &Shading,
    scratch: &mut Scratch,
) -> Estimate {
    // Photons hold the cosine to the shading normal where there is one, see `photons::trace`.
    if let Some(lambert) = shading.bsdf.lambertian() {
        let (map, query, params) = what;
        let query = Query { faint: irradiance_of(query.faint, lambert.reflectance), ..*query };
        let (estimate, _) = irradiance(scene, reading, (map, &query, params), scratch);
        let reflected = |irradiance: Rgb| lambert.reflectance * irradiance * FRAC_1_PI;
        let (value, narrower) = (reflected(estimate.value), reflected(estimate.narrower));
        return Estimate { value, narrower, ..estimate };
    }
    let f = |wi: Vec3| shading.eval_photon(shading.frame.to_local(wi));
    // Weighing each photon by the BRDF twice costs more than the feelers that it might save.
    let (map, query, params) = (what.0, &Query { faint: 0.0, ..*what.1 }, what.2);
    let estimate = |photons: &mut PhotonScratch, domain: &mut Feel<'_>| {
        map.estimate_radiance_visible(query, params, photons, domain, f)
    };
    look_up(scene, reading, query, scratch, estimate).0
}

/// Irradiance of which a Lambertian surface reflects no more than `radiance` in any channel.
pub(super) fn irradiance_of(radiance: f32, reflectance: Rgb) -> f32 {
    PI * radiance / reflectance.max_element().max(f32::MIN_POSITIVE)
}

/// Irradiance on the side of the query's normal, and how far its centre sees within the surface in every direction that was
/// felt: infinity where nothing was in the way.
pub(super) fn irradiance(
    scene: &Scene,
    reading: &PhotonMapSettings,
    (map, query, params): (&PhotonMap, &Query, &EstimateParams),
    scratch: &mut Scratch,
) -> (Estimate, f32) {
    let estimate = |photons: &mut PhotonScratch, domain: &mut Feel<'_>| {
        map.estimate_irradiance_visible(query, params, photons, domain)
    };
    look_up(scene, reading, query, scratch, estimate)
}

/// Finds the visible part of a disc of some radius.
type Feel<'a> = dyn FnMut(f32) -> Option<KernelDomain> + 'a;

fn look_up(
    scene: &Scene,
    reading: &PhotonMapSettings,
    query: &Query,
    scratch: &mut Scratch,
    estimate: impl FnOnce(&mut PhotonScratch, &mut Feel<'_>) -> Estimate,
) -> (Estimate, f32) {
    let Scratch { photons, counters, .. } = scratch;
    let mut seen = f32::INFINITY;
    let mut domain = |radius| {
        if !reading.visible_kernel {
            return None;
        }
        let Query { position, normal, .. } = *query;
        let felt = Cell::new(0);
        let domain = KernelDomain::feel(normal, radius, |tangent, length| {
            felt.set(felt.get() + 1);
            scene.surface_reach(position, normal, tangent, length)
        });
        counters.feelers += felt.get();
        seen = domain.as_ref().map_or(f32::INFINITY, KernelDomain::least_reach);
        domain
    };
    let visited = photons.visited();
    let estimate = estimate(photons, &mut domain);
    counters.photons_visited += photons.visited() - visited;
    counters.differential_stops += u64::from(estimate.at_edge);
    (estimate, seen)
}

/// The part of the disc of `radius` around a point that can be seen from its centre.
pub fn visible_domain(scene: &Scene, position: Vec3, normal: Vec3, radius: f32) -> Option<KernelDomain> {
    KernelDomain::feel(normal, radius, |tangent, length| {
        scene.surface_reach(position, normal, tangent, length)
    })
}
