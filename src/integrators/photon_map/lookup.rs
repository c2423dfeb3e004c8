//! Photon-map lookups at a surface.

use super::PhotonMapSettings;
use crate::bricks::IrradianceAtlas;
use crate::bsdf::Lobe;
use crate::integrators::Scratch;
use crate::math::Rgb;
use crate::photons::{
    Estimate, EstimateParams, KernelDomain, PhotonMap, Query, Scratch as PhotonScratch, Seen, Sight,
};
use crate::scene::{Scene, Shading, SurfaceInteraction};
use glam::Vec3;
use std::cell::Cell;
use std::f32::consts::{FRAC_1_PI, PI};

/// Radiance that the diffuse lobe of a surface reflects, estimated from the photons of a map.
pub(super) fn reflected(
    scene: &Scene,
    reading: &PhotonMapSettings,
    what: (&PhotonMap, &Query, &EstimateParams),
    shading: &Shading,
    scratch: &mut Scratch,
) -> Rgb {
    reflected_estimate(scene, reading, what, shading, scratch).value
}

/// The same radiance, with the number of photons it rests on and their radius.
pub(super) fn reflected_estimate(
    scene: &Scene,
    reading: &PhotonMapSettings,
    what: (&PhotonMap, &Query, &EstimateParams),
    shading: &Shading,
    scratch: &mut Scratch,
) -> Estimate {
    // The power of photons includes the cosine to the shading normal where there is one, see `photons::trace`.
    if let Some(lambert) = shading.bsdf.lambertian() {
        let (map, query, params) = what;
        if map.is_dispersed() && !is_grey(lambert.reflectance) {
            let f = lambert.reflectance * FRAC_1_PI;
            let estimate = |photons: &mut PhotonScratch, place: &mut Place<'_>| {
                map.estimate_radiance_visible(query, params, photons, place, |_| f)
            };
            return look_up(scene, reading, query, scratch, estimate).0;
        }
        let query = Query { faint: irradiance_of(query.faint, lambert.reflectance), ..*query };
        let (estimate, _) = irradiance(scene, reading, (map, &query, params), scratch);
        let reflected = |irradiance: Rgb| lambert.reflectance * irradiance * FRAC_1_PI;
        let (value, narrower) = (reflected(estimate.value), reflected(estimate.narrower));
        return Estimate { value, narrower, ..estimate };
    }
    let f = |wi: Vec3| shading.eval_photon(shading.frame.to_local(wi));
    // To evaluate the BRDF twice for each photon costs more than the feeler rays that it might save.
    let (map, query, params) = (what.0, &Query { faint: 0.0, ..*what.1 }, what.2);
    let estimate = |photons: &mut PhotonScratch, place: &mut Place<'_>| {
        map.estimate_radiance_visible(query, params, photons, place, f)
    };
    look_up(scene, reading, query, scratch, estimate).0
}

/// Whether all channels are equal: light of any wavelength is then reflected alike.
pub(super) fn is_grey(reflectance: Rgb) -> bool {
    reflectance.x == reflectance.y && reflectance.y == reflectance.z
}

/// Radiance that the diffuse lobe of a surface reflects of the irradiance in its brick map, with voxels of about the side `width`; `None` where
/// the map holds nothing near.
pub(super) fn reflected_from_atlas(
    atlas: &IrradianceAtlas,
    (hit, shading): (&SurfaceInteraction, &Shading),
    width: f32,
    scratch: &mut Scratch,
) -> Option<Rgb> {
    scratch.counters.atlas_lookups += 1;
    let reader = (&mut scratch.bricks, &mut scratch.counters.bricks);
    let place = (hit.point.position, hit.facing_normal());
    let irradiance = atlas.look_up(reader, hit.surface, place, width)?.irradiance;
    // A lobe that depends on where light comes from counts as Lambertian of its albedo: brick maps hold no directions.
    let reflectance = match shading.bsdf.lambertian() {
        Some(lambert) => lambert.reflectance,
        None => shading.bsdf.lobe_albedo(Lobe::Diffuse, shading.wo_local),
    };
    Some(reflectance * irradiance * FRAC_1_PI)
}

/// Irradiance of which a Lambertian surface reflects at most `radiance` in any channel.
pub(super) fn irradiance_of(radiance: f32, reflectance: Rgb) -> f32 {
    PI * radiance / reflectance.max_element().max(f32::MIN_POSITIVE)
}

/// Irradiance on the side of the query's normal, and the shortest distance along the surface over all directions in which feeler rays
/// were traced; infinite where nothing was in the way.
pub(super) fn irradiance(
    scene: &Scene,
    reading: &PhotonMapSettings,
    (map, query, params): (&PhotonMap, &Query, &EstimateParams),
    scratch: &mut Scratch,
) -> (Estimate, f32) {
    let estimate = |photons: &mut PhotonScratch, place: &mut Place<'_>| {
        map.estimate_irradiance_visible(query, params, photons, place)
    };
    look_up(scene, reading, query, scratch, estimate)
}

fn look_up(
    scene: &Scene,
    reading: &PhotonMapSettings,
    query: &Query,
    scratch: &mut Scratch,
    estimate: impl FnOnce(&mut PhotonScratch, &mut Place<'_>) -> Estimate,
) -> (Estimate, f32) {
    let Scratch { photons, counters, .. } = scratch;
    let mut place = Place::new(scene, query.position, query.normal, reading.visible_kernel);
    let visited = photons.visited();
    let estimate = estimate(photons, &mut place);
    counters.photons_visited += photons.visited() - visited;
    counters.differential_stops += u64::from(estimate.at_edge);
    counters.feelers += place.rays;
    (estimate, place.seen)
}

/// Distance along the normal, relative to the distance of a photon, within which geometry above the place can block the path to the
/// photon.
const WAY_HEADROOM: f32 = 2.0;

/// A place on a surface, with what its rays found about the surfaces around it.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    scene: &'a Scene,
    position: Vec3,
    normal: Vec3,
    feels: bool,
    /// Free distance along the normal, infinite if it exceeds the range that was searched; and that range.
    headroom: (f32, f32),
    is_covered: bool,
    seen: f32,
    rays: u64,
}

impl<'a> Place<'a> {
    /// A place at `position` on a surface that faces along the unit `normal`. `feels` enables feeler rays, which measure how far the
    /// surface continues.
    pub fn new(scene: &'a Scene, position: Vec3, normal: Vec3, feels: bool) -> Self {
        let (seen, headroom) = (f32::INFINITY, (f32::INFINITY, 0.0));
        Self { scene, position, normal, feels, headroom, is_covered: false, seen, rays: 0 }
    }

    /// Free distance along the normal above the centre; infinite where it exceeds `within`.
    fn headroom(&mut self, within: f32) -> f32 {
        let (found, asked) = self.headroom;
        if found.is_infinite() && asked < within {
            self.rays += 1;
            self.headroom = (self.scene.headroom(self.position, self.normal, within), within);
        }
        self.headroom.0
    }
}

impl Sight for Place<'_> {
    fn feel(&mut self, radius: f32) -> Seen {
        if !self.feels {
            return Seen::Whole;
        }
        let length = KernelDomain::length_for(radius);
        let lift = Scene::feeler_lift(self.headroom(length), length);
        self.is_covered = lift < Scene::feeler_lift(length, length);
        let Self { scene, position, normal, .. } = *self;
        let felt = Cell::new(0);
        let seen = KernelDomain::feel(normal, radius, |tangent, length| {
            felt.set(felt.get() + 1);
            scene.surface_reach((position, normal), tangent, length, lift)
        });
        self.rays += felt.get();
        self.seen = seen.least_reach();
        seen
    }

    fn sees(&mut self, position: Vec3, normal: Vec3) -> bool {
        // Paths to photons rise to at most half of that height.
        let within = WAY_HEADROOM * position.distance(self.position);
        let headroom = self.headroom(within).min(within);
        self.rays += 1;
        self.scene.connects_upwards((self.position, self.normal), headroom, (position, normal))
    }

    fn feels(&self) -> bool {
        self.feels
    }

    fn is_covered(&self) -> bool {
        self.is_covered
    }

    fn outlook(&mut self, within: f32) -> f32 {
        self.headroom(within)
    }
}
