//! The reference: unbiased path tracing (Kajiya 1986) with next-event estimation and multiple importance sampling
//! (Veach & Guibas 1995). Reads no map, so that the maps can be checked against it; photons may tell it where to look
//! (Jensen 1995), which changes noise and nothing else.

use super::direct::{DirectLighting, power_heuristic};
use super::specular::chain_roulette;
use super::{Directions, Integrator, Scratch, describe_first_hit};
use crate::bsdf::Lobe;
use crate::film::{Aov, PixelSample};
use crate::lights::{Light, LightId};
use crate::math::{Ray, Rgb};
use crate::media::MediumId;
use crate::photons::DirectionGuide;
use crate::sampling::SampleStream;
use crate::scene::{Scene, SurfaceInteraction};
use glam::Vec3;

/// Surfaces after which roulette may end a path.
const ROULETTE_DEPTH: u32 = 4;

/// Path tracer.
#[derive(Debug)]
pub struct PathTracer<'a> {
    scene: &'a Scene,
    direct: DirectLighting<'a>,
    guide: Option<&'a DirectionGuide>,
    max_depth: u32,
    camera_medium: MediumId,
}

/// Which part of the picture light belongs to that reaches a path now, by the surfaces it has met from the camera on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// No surface yet.
    Camera,
    /// Something specular first: all of it is the specular part.
    ThroughSpecular,
    /// A diffuse surface, and nothing since.
    Diffuse,
    /// A diffuse surface, and only specular ones since.
    DiffuseThenSpecular,
    /// Two diffuse surfaces or more.
    DiffuseTwice,
}

impl Class {
    /// After scattering by this lobe.
    fn after(self, lobe: Lobe) -> Self {
        match (self, lobe) {
            (Self::Camera | Self::ThroughSpecular, Lobe::Specular) | (Self::ThroughSpecular, _) => {
                Self::ThroughSpecular
            }
            (Self::Camera, Lobe::Diffuse) => Self::Diffuse,
            (Self::Diffuse | Self::DiffuseThenSpecular, Lobe::Specular) => Self::DiffuseThenSpecular,
            (Self::Diffuse | Self::DiffuseThenSpecular | Self::DiffuseTwice, _) => Self::DiffuseTwice,
        }
    }

    /// The part for light that arrives after these surfaces.
    fn part(self) -> Aov {
        match self {
            Self::Camera => Aov::Emission,
            Self::ThroughSpecular => Aov::Specular,
            Self::Diffuse => Aov::Direct,
            Self::DiffuseThenSpecular => Aov::Caustics,
            Self::DiffuseTwice => Aov::Indirect,
        }
    }
}

/// Where the last direction was drawn from, if from a smooth lobe: light that it hits was sampled there as well.
#[derive(Clone, Copy)]
struct Drawn {
    from: Vec3,
    pdf: f32,
}

impl<'a> PathTracer<'a> {
    /// Paths of at most `max_depth` surfaces from a camera in `camera_medium`.
    pub fn new(scene: &'a Scene, max_depth: u32, camera_medium: MediumId) -> Self {
        let direct = DirectLighting::new(scene, 1, true);
        Self { scene, direct, guide: None, max_depth, camera_medium }
    }

    /// The same paths, drawn with the help of photons.
    pub fn guided_by(self, guide: Option<&'a DirectionGuide>) -> Self {
        Self { guide, ..self }
    }

    /// Weight of light found by following the path, against having sampled it from `drawn`.
    fn weight(&self, drawn: Option<Drawn>, id: LightId, pdf_of_light: impl FnOnce(Vec3) -> f32) -> f32 {
        drawn.map_or(1.0, |drawn| {
            power_heuristic(drawn.pdf, pdf_of_light(drawn.from) * self.direct.choice_probability(id))
        })
    }

    fn emitted(&self, hit: &SurfaceInteraction, drawn: Option<Drawn>) -> Rgb {
        let Some(id) = self.scene.surface(hit).light else { return Rgb::ZERO };
        let Light::Area(area) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        let weight =
            self.weight(drawn, id, |from| area.pdf_solid_angle(from, hit.primitive, hit.point.position));
        area.emitted(hit.is_front()) * weight
    }

    fn environment(&self, drawn: Option<Drawn>) -> Rgb {
        let Some(id) = self.scene.environment() else { return Rgb::ZERO };
        let Light::Environment(sky) = &self.scene.lights()[id as usize] else { return Rgb::ZERO };
        sky.radiance * self.weight(drawn, id, |_| 1.0 / (4.0 * std::f32::consts::PI))
    }
}

/// A path under way.
struct State {
    ray: Ray,
    throughput: Rgb,
    medium: MediumId,
    class: Class,
    drawn: Option<Drawn>,
    /// Specular surfaces met since the last other one.
    chain: u32,
    /// Part of the throughput that comes from drawing directions more or less often than the BSDF alone would.
    guidance: f32,
}

impl PathTracer<'_> {
    /// Draws the next ray; `false` where the path ends.
    fn scatter(
        &self,
        state: &mut State,
        hit: &SurfaceInteraction,
        directions: &Directions<'_>,
        depth: u32,
        samples: &mut SampleStream,
    ) -> bool {
        let shading = directions.shading;
        let u_lobe = if shading.bsdf.is_delta() || directions.draws_lobe() { samples.next_1d() } else { 0.0 };
        let u = if shading.bsdf.is_delta() { glam::Vec2::ZERO } else { samples.next_2d() };
        let Some(sample) = directions.sample(u_lobe, u) else { return false };
        let direction = shading.frame.to_world(sample.wi);
        let Some(medium) =
            self.scene.medium_after(state.medium, hit, shading, direction, sample.transmission)
        else {
            return false;
        };
        state.throughput *= sample.throughput;
        state.chain = if shading.bsdf.is_delta() { state.chain + 1 } else { 0 };
        let Some(weight) = chain_roulette(state.chain, || samples.next_1d()) else { return false };
        state.throughput *= weight;
        // Roulette must not undo the guiding, which lowers the weight of the directions that matter: it goes by what the
        // surfaces reflect.
        if directions.is_guided() && sample.pdf_solid_angle.is_finite() {
            let by_bsdf = shading.bsdf.pdf_solid_angle(shading.wo_local, sample.wi);
            state.guidance *= by_bsdf / sample.pdf_solid_angle;
        }
        let brightest = state.throughput.max_element() / state.guidance;
        if !(brightest > 0.0) {
            return false;
        }
        if depth >= ROULETTE_DEPTH && brightest < 1.0 {
            if samples.next_1d() >= brightest {
                return false;
            }
            state.throughput /= brightest;
        }
        state.drawn = (sample.lobe == Lobe::Diffuse)
            .then_some(Drawn { from: hit.point.position, pdf: sample.pdf_solid_angle });
        state.class = state.class.after(sample.lobe);
        state.medium = medium;
        state.ray = hit.spawn(direction);
        true
    }
}

impl Integrator for PathTracer<'_> {
    fn li(&self, ray: Ray, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let mut out = PixelSample::default();
        let counters = &mut scratch.counters;
        counters.camera_rays += 1;
        let mut state = State {
            ray,
            throughput: Rgb::ONE,
            medium: self.camera_medium,
            class: Class::Camera,
            drawn: None,
            chain: 0,
            guidance: 1.0,
        };
        for depth in 0..self.max_depth {
            counters.depth_sum += 1;
            counters.path_rays += u64::from(depth > 0);
            let Some(hit) = self.scene.intersect(&state.ray) else {
                out.add(state.class.part(), state.throughput * self.environment(state.drawn));
                return out;
            };
            if depth == 0 {
                describe_first_hit(&mut out, self.scene, &hit);
            }
            let medium = self.scene.medium(state.medium);
            if !medium.is_clear() {
                state.throughput *= medium.transmittance(hit.distance);
            }
            out.add(state.class.part(), state.throughput * self.emitted(&hit, state.drawn));
            let shading = hit.shading(self.scene.material(&hit));
            let directions = Directions::new(self.guide, &hit, &shading, counters);
            if shading.bsdf.is_delta() {
                counters.interfaces += 1;
                counters.medium_mismatches += u64::from(self.scene.is_medium_mismatch(&hit, state.medium));
            } else if shading.bsdf.has_diffuse() {
                let direct = self.direct.radiance(&hit, &directions, state.medium, samples, counters);
                out.add(state.class.after(Lobe::Diffuse).part(), state.throughput * direct);
            }
            if !self.scatter(&mut state, &hit, &directions, depth, samples) {
                return out;
            }
        }
        counters.truncated += 1;
        out
    }
}
