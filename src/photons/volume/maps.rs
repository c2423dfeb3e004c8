//! All photons in media, by medium.

use super::beams::{BeamMap, LEAST_SINE};
use super::fade::Fade;
use super::points::{Plane, PointMap};
use super::record::MediaRecords;
use crate::math::{Ray, Rgb};
use crate::media::{MediumId, Volume};
use crate::sampling::Rng;
use crate::scene::Scene;
use crate::transport::Stretch;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Photons of one medium.
#[derive(Clone, Debug, Default)]
struct MediumMaps {
    /// Light of specular chains.
    beams: Option<BeamMap>,
    /// The same light where it collides, for rays nearly parallel to it.
    caustic: Option<PointMap>,
    /// Light that the medium or a diffuse surface scattered before.
    scattered: Option<PointMap>,
}

/// Photons in all media.
#[derive(Clone, Debug, Default)]
pub struct MediaMaps {
    media: BTreeMap<MediumId, MediumMaps>,
}

/// Numbers of photons in media, and their memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MediaSizes {
    /// Beams.
    pub beams: u64,
    /// Photons at points.
    pub points: u64,
    /// Bytes of memory.
    pub bytes: u64,
}

/// How indirect light in a medium is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// From all photons along a ray.
    Along,
    /// At places farther away than this from where a path first collides: kernels are wider than the medium lets light pass, or its phase
    /// function is sharp. Up to there, the path is followed.
    Beyond(f32),
    /// Not at all: paths are followed.
    Never,
}

/// Light that a medium scatters, by the part of the picture that it belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MediaLight {
    /// Of specular chains from a light.
    pub caustics: Rgb,
    /// Scattered or reflected diffusely before.
    pub indirect: Rgb,
}

impl MediaMaps {
    /// Adds the light of specular chains, of a pass that emitted `emitted` photons.
    pub(in crate::photons) fn add_caustics(&mut self, scene: &Scene, records: &MediaRecords, emitted: u64) {
        let widest = widest(scene);
        for (medium, beams) in grouped(&records.beams, |beam| beam.medium) {
            self.media.entry(medium).or_default().beams = Some(BeamMap::build(&beams, emitted, widest));
        }
        for (medium, points) in grouped(&records.points, |point| point.medium) {
            let map = PointMap::build(&points, emitted, widest, |at, reach| nearest_plane(scene, at, reach));
            self.media.entry(medium).or_default().caustic = Some(map);
        }
    }

    /// Adds light that was scattered before, of a pass that emitted `emitted` photons.
    pub(in crate::photons) fn add_scattered(&mut self, scene: &Scene, records: &MediaRecords, emitted: u64) {
        for (medium, points) in grouped(&records.points, |point| point.medium) {
            let map =
                PointMap::build(&points, emitted, widest(scene), |at, reach| nearest_plane(scene, at, reach));
            self.media.entry(medium).or_default().scattered = Some(map);
        }
    }

    /// Numbers and memory.
    pub fn sizes(&self) -> MediaSizes {
        let mut sizes = MediaSizes::default();
        for maps in self.media.values() {
            let beams = maps.beams.iter();
            sizes.beams += beams.clone().map(|map| map.len() as u64).sum::<u64>();
            sizes.bytes += beams.map(|map| map.memory_bytes() as u64).sum::<u64>();
            for points in [&maps.caustic, &maps.scattered].into_iter().flatten() {
                sizes.points += points.len() as u64;
                sizes.bytes += points.memory_bytes() as u64;
            }
        }
        sizes
    }

    /// Radiance that arrives at the start of a stretch of the light that photons on their way over it scatter. `area` is the factor on the
    /// area of kernels, in (0, 1]: that of lengths across beams is the same, that of radii its root. Without `indirect` that part is zero.
    pub fn along(&self, stretch: &Stretch<'_>, area: f32, indirect: bool) -> MediaLight {
        let Some(maps) = self.media.get(&stretch.medium.medium()) else { return MediaLight::default() };
        let mut rng: Rng = stretch.rng;
        let volume = stretch.volume;
        let fade = Fade::new(volume, &stretch.line, stretch.length, &mut rng);
        let line = (&stretch.line, stretch.length);
        let direction = stretch.line.direction().as_vec3();
        let is_parallel = |wi: Vec3| wi.cross(direction).length_squared() < LEAST_SINE * LEAST_SINE;
        let points = |map: &Option<PointMap>, keeps: &dyn Fn(Vec3) -> bool| {
            map.as_ref().map_or(Rgb::ZERO, |map| map.along(line, (volume.phase(), &fade), area.sqrt(), keeps))
        };
        let beams = maps.beams.as_ref().map_or(Rgb::ZERO, |map| map.along(line, (volume, &fade), area));
        MediaLight {
            caustics: beams + points(&maps.caustic, &is_parallel),
            indirect: if indirect { points(&maps.scattered, &|_| true) } else { Rgb::ZERO },
        }
    }

    /// How indirect light in a medium is read.
    pub fn reading(&self, medium: MediumId, volume: &Volume, area: f32) -> Reading {
        let Some(map) = self.media.get(&medium).and_then(|maps| maps.scattered.as_ref()) else {
            return Reading::Never;
        };
        let peak = volume.phase().peak();
        if peak > SHARPEST_PEAK {
            return Reading::Never;
        }
        let width = map.usual_width() * area.cbrt();
        let depth = width * volume.coefficients().extinction().max_element();
        if peak > SHARP_PEAK || depth > LARGEST_DEPTH { Reading::Beyond(width) } else { Reading::Along }
    }

    /// Media in which light that was scattered before is read with kernels wider than a mean free path, so that it is blurred where the
    /// medium is thin or light enters: each with the median width in mean free paths of the densest channel.
    pub fn blurred(&self, scene: &Scene) -> Vec<(MediumId, f32)> {
        let depth = |medium: MediumId, maps: &MediumMaps| {
            let volume = scene.medium(medium).volume.as_ref()?;
            let width = maps.scattered.as_ref()?.usual_width();
            (volume.phase().peak() <= SHARPEST_PEAK)
                .then(|| width * volume.coefficients().extinction().max_element())
        };
        let media = self.media.iter();
        media
            .filter_map(|(&id, maps)| Some((id, depth(id, maps)?)))
            .filter(|&(_, depth)| depth > 1.0)
            .collect()
    }

    /// Light of photons that a medium scatters at a place towards `wo`: radiance per unit of length, over the scattering coefficient there.
    pub fn at(
        &self,
        medium: MediumId,
        volume: &Volume,
        (position, wo): (Vec3, Vec3),
        area: f32,
    ) -> MediaLight {
        let Some(maps) = self.media.get(&medium) else { return MediaLight::default() };
        let scattering = volume.coefficients().scattering() * volume.density().at(position.as_dvec3()) as f32;
        let light = |map: &Option<PointMap>| {
            let Some(map) = map else { return Rgb::ZERO };
            let sum = map.at(position, wo, volume.phase(), area.cbrt());
            let channel = |c: usize| if scattering[c] > 0.0 { sum[c] / scattering[c] } else { 0.0 };
            Rgb::new(channel(0), channel(1), channel(2))
        };
        MediaLight { caustics: light(&maps.caustic), indirect: light(&maps.scattered) }
    }
}

/// Largest optical depth of a kernel at density one with which indirect light is read along rays.
const LARGEST_DEPTH: f32 = 0.3;

/// Largest value of a phase function with which photons are read along rays: that of a mean cosine of 0.9. Beyond, few of the photons
/// along a ray have a direction that matters.
const SHARP_PEAK: f32 = 15.2;

/// Largest value of a phase function with which photons are read at all: that of a mean cosine of 0.97. Beyond, it changes within the
/// rounding of the direction of a photon.
const SHARPEST_PEAK: f32 = 174.0;

/// Largest width of a kernel, as a share of the scene's radius.
const WIDEST: f32 = 0.25;

fn widest(scene: &Scene) -> f32 {
    let radius = scene.bounds().1;
    if radius > 0.0 { WIDEST * radius } else { f32::MAX }
}

fn grouped<T: Copy>(all: &[T], medium: impl Fn(&T) -> MediumId) -> BTreeMap<MediumId, Vec<T>> {
    let mut groups: BTreeMap<MediumId, Vec<T>> = BTreeMap::new();
    for one in all {
        groups.entry(medium(one)).or_default().push(*one);
    }
    groups
}

/// The plane of the surface nearest to a place, among those that rays along the axes and diagonals hit within `reach`.
fn nearest_plane(scene: &Scene, at: Vec3, reach: f32) -> Option<Plane> {
    const D: f32 = 0.577_350_26;
    const DIRECTIONS: [Vec3; 7] = [
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::new(D, D, D),
        Vec3::new(-D, D, D),
        Vec3::new(D, -D, D),
        Vec3::new(D, D, -D),
    ];
    let mut nearest: Option<Plane> = None;
    for direction in DIRECTIONS.into_iter().flat_map(|direction| [direction, -direction]) {
        let ray = Ray { t_max: reach, ..Ray::new(at, direction) };
        if let Some(hit) = scene.intersect(&ray) {
            let cosine = hit.point.normal.dot(direction);
            let distance = hit.distance * cosine.abs();
            if nearest.is_none_or(|plane| distance < plane.distance) {
                nearest = Some(Plane { normal: hit.point.normal * cosine.signum(), distance });
            }
        }
    }
    nearest
}
