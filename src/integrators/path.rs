//! Path tracer, the reference: unbiased path tracing (Kajiya 1986) with next-event estimation and multiple importance sampling (Veach &
//! Guibas 1995). It reads no map, so that the maps can be checked against it. Photons may guide the sampling of directions (Jensen
//! 1995), which changes nothing but the noise.

use super::direct::DirectLighting;
use super::glints::Chain;
use super::specular::chain_roulette;
use super::{Directions, EyeRay, Integrator, Irradiance, Receiver, Scratch, describe_first_hit};
use crate::bsdf::Lobe;
use crate::film::{Aov, PixelSample};
use crate::lights::{LightId, Receiver as LightReceiver};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::photons::DirectionGuide;
use crate::sampling::SampleStream;
use crate::scene::{CameraMedia, Scene, SurfaceInteraction};
use crate::settings::Wavelengths;
use crate::spectra::{Line, at_line};
use crate::transport::{
    Arrival, Collision, Event, MisPartner, emitted, escaped, first_surface, next_event, next_event_in_media,
    receiver, refracted_at,
};
use glam::Vec3;
use std::cell::Cell;

/// Number of surfaces after which Russian roulette may end a path.
const ROULETTE_DEPTH: u32 = 4;

/// Path tracer.
#[derive(Debug)]
pub struct PathTracer<'a> {
    scene: &'a Scene,
    direct: DirectLighting<'a>,
    guide: Option<&'a DirectionGuide>,
    max_depth: u32,
    camera_media: CameraMedia,
    wavelengths: Wavelengths,
}

/// Which part of the image receives the light that reaches a path, by the surfaces that the path has met since the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    /// No surface yet.
    Camera,
    /// A specular or highly glossy surface first: all further light belongs to the specular part.
    ThroughSpecular,
    /// One diffuse surface, and none after it.
    Diffuse,
    /// One diffuse surface, and only specular or highly glossy ones after it.
    DiffuseThenSpecular,
    /// Two diffuse surfaces or more.
    DiffuseTwice,
}

impl Class {
    /// Class after scattering by this lobe.
    fn after(self, lobe: Lobe) -> Self {
        match (self, lobe) {
            (Self::Camera | Self::ThroughSpecular, Lobe::Specular | Lobe::Glossy)
            | (Self::ThroughSpecular, _) => Self::ThroughSpecular,
            (Self::Camera, Lobe::Diffuse) => Self::Diffuse,
            (Self::Diffuse | Self::DiffuseThenSpecular, Lobe::Specular | Lobe::Glossy) => {
                Self::DiffuseThenSpecular
            }
            (Self::Diffuse | Self::DiffuseThenSpecular | Self::DiffuseTwice, _) => Self::DiffuseTwice,
        }
    }

    /// Image part of light that arrives after these surfaces.
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

impl<'a> PathTracer<'a> {
    /// Paths of at most `max_depth` surfaces from a camera in `camera_media`.
    pub fn new(scene: &'a Scene, max_depth: u32, camera_media: impl Into<CameraMedia>) -> Self {
        let direct = DirectLighting::new(scene, 1, true);
        Self {
            scene,
            direct,
            guide: None,
            max_depth,
            camera_media: camera_media.into(),
            wavelengths: Wavelengths::default(),
        }
    }

    /// The same path tracer, whose paths take these wavelengths where light is dispersed.
    pub fn with_wavelengths(self, wavelengths: Wavelengths) -> Self {
        Self { wavelengths, ..self }
    }

    /// The same path tracer, with directions guided by photons.
    pub fn guided_by(self, guide: Option<&'a DirectionGuide>) -> Self {
        Self { guide, ..self }
    }
}

/// State of the path that is being traced.
struct State<'a> {
    ray: Ray,
    /// The camera's ray and the specular chain since; `None` once the path has met any other surface.
    seen: Option<(&'a EyeRay<'a>, Chain)>,
    throughput: Rgb,
    /// The wavelength of the path since it was dispersed; later factors are taken at this wavelength.
    line: Option<Line>,
    medium: MediumStack,
    class: Class,
    partner: Option<MisPartner>,
    /// The medium's scattering event at which the ray starts, and the throughput before it; `None` where the ray starts at a surface.
    collided: Option<(Collision<'a>, Rgb)>,
    /// Number of specular or highly glossy surfaces since the last other one.
    chain: u32,
    /// Factor of the throughput that comes from guided instead of BSDF sampling of directions.
    guidance: f32,
}

impl<'a> State<'a> {
    /// State of a path that starts with this ray.
    fn new(ray: Ray, medium: MediumStack) -> Self {
        Self {
            ray,
            seen: None,
            throughput: Rgb::ONE,
            line: None,
            medium,
            class: Class::Camera,
            partner: None,
            collided: None,
            chain: 0,
            guidance: 1.0,
        }
    }

    /// Light of radiance `rgb` that arrives along the ray, as the camera receives it.
    #[inline]
    fn received(&self, rgb: Rgb) -> Rgb {
        self.throughput * at_line(self.line, rgb)
    }

    /// Multiplies the throughput by a factor.
    #[inline]
    fn pass(&mut self, factor: Rgb) {
        self.throughput *= at_line(self.line, factor);
    }

    /// Takes a wavelength, if paths have one.
    fn disperse(&mut self, wavelengths: Wavelengths, samples: &mut SampleStream) {
        self.line = Line::choose(wavelengths, samples.next_1d());
        if let Some(line) = self.line {
            self.throughput = line.taken_by(self.throughput);
        }
    }
}

impl PathTracer<'_> {
    /// Samples the next ray; returns `false` where the path ends.
    fn scatter(
        &self,
        state: &mut State<'_>,
        hit: &SurfaceInteraction,
        (directions, reflected): (&Directions<'_>, Option<Rgb>),
        depth: u32,
        samples: &mut SampleStream,
    ) -> bool {
        let shading = directions.shading;
        let u_lobe = if shading.bsdf.chooses() || directions.draws_lobe() { samples.next_1d() } else { 0.0 };
        let u = if shading.bsdf.is_delta() { glam::Vec2::ZERO } else { samples.next_2d() };
        let Some(mut sample) = directions.sample(u_lobe, u) else { return false };
        let at_wavelength;
        let shading = match reflected {
            Some(colour) if !sample.transmission => {
                state.throughput *= colour;
                shading
            }
            Some(_) => {
                state.disperse(self.wavelengths, samples);
                at_wavelength = self.scene.shading_for(hit, state.medium, state.line);
                let Some(refracted) = refracted_at(&at_wavelength, shading) else { return false };
                sample = refracted;
                &at_wavelength
            }
            None => shading,
        };
        let direction = shading.frame.to_world(sample.wi);
        let Some(medium) =
            self.scene.medium_after(state.medium, hit, shading, direction, sample.transmission)
        else {
            return false;
        };
        state.pass(sample.throughput);
        state.chain = if sample.lobe == Lobe::Diffuse { 0 } else { state.chain + 1 };
        let Some(weight) = chain_roulette(state.chain, || samples.next_1d()) else { return false };
        state.throughput *= weight;
        // Russian roulette must not undo the guiding, which lowers the weight of the important directions. It therefore uses the
        // reflectance of the surfaces alone.
        if directions.is_guided() && sample.lobe == Lobe::Diffuse {
            let by_bsdf = shading.pdf_solid_angle(Lobe::Diffuse, sample.wi);
            state.guidance *= by_bsdf / sample.pdf_solid_angle;
        }
        if !survives(state, depth, samples) {
            return false;
        }
        state.partner = (sample.lobe != Lobe::Specular)
            .then_some(MisPartner { from: receiver(self.scene, hit), pdf: sample.pdf_solid_angle });
        state.collided = None;
        state.class = state.class.after(sample.lobe);
        state.medium = medium;
        let seen = state.seen.filter(|_| sample.lobe == Lobe::Specular);
        state.seen =
            seen.and_then(|(camera, chain)| Some((camera, chain.after(hit, shading, sample.transmission)?)));
        state.ray = hit.spawn(direction);
        true
    }
}

/// Plays Russian roulette by the brightest channel; returns `false` where the path ends.
fn survives(state: &mut State<'_>, depth: u32, samples: &mut SampleStream) -> bool {
    let brightest = state.throughput.abs().max_element() / state.guidance;
    if !(brightest > 0.0) {
        return false;
    }
    if depth >= ROULETTE_DEPTH && brightest < 1.0 {
        if samples.next_1d() >= brightest {
            return false;
        }
        state.throughput /= brightest;
    }
    true
}

impl<'a> PathTracer<'a> {
    /// The event that ends the ray of a path. Applies the attenuation of the media on the way and adds the light that they emit and
    /// scatter.
    fn next_event(
        &self,
        state: &mut State<'a>,
        depth: u32,
        samples: &mut SampleStream,
        (scratch, out): (&mut Scratch, &mut PixelSample),
    ) -> Event<'a> {
        if !self.scene.scatters() {
            return next_event(self.scene, &state.ray, &mut state.medium);
        }
        if depth == 0
            && let Some(hit) = first_surface(self.scene, &state.ray, state.medium)
        {
            describe_first_hit(out, self.scene, &hit);
        }
        let (throughput, line, u) = (state.throughput, state.line, samples.next_1d());
        let direct_part = state.class.after(Lobe::Diffuse).part();
        // What decides between the channels of media.
        let weights = line.map_or(throughput, Line::primaries);
        let passage =
            next_event_in_media(self.scene, &state.ray, &mut state.medium, (weights, u), |stretch| {
                let there = weights * stretch.weight;
                let direct = self.direct.scattered(stretch, (there, true, 1), samples, scratch);
                out.add(direct_part, throughput * at_line(line, stretch.weight * direct));
            });
        out.add(state.class.part(), state.received(passage.emitted));
        state.pass(passage.weight);
        passage.event
    }

    /// Continues the path from a scattering event in a medium, which counts as a diffuse reflection; returns `false` where the path
    /// ends.
    fn scatter_in_medium(
        &self,
        state: &mut State<'a>,
        collision: &Collision<'a>,
        (before, depth): (Rgb, u32),
        samples: &mut SampleStream,
    ) -> bool {
        let wo = -state.ray.direction;
        state.class = state.class.after(Lobe::Diffuse);
        state.chain = 0;
        state.seen = None;
        if !survives(state, depth, samples) {
            return false;
        }
        let sample = collision.phase.sample(wo, samples.next_2d());
        let from = LightReceiver { position: collision.position, normal: Vec3::ZERO };
        state.partner = Some(MisPartner { from, pdf: sample.pdf });
        state.collided = Some((*collision, before * collision.stretch.weight));
        state.ray = Ray::new(collision.position, sample.wi);
        true
    }

    /// Sampling density that the light `id` is weighted against where the ray of a path hits it. `id` is `None` for light from infinity.
    fn partner(&self, state: &State<'_>, id: Option<LightId>) -> Option<MisPartner> {
        let partner = state.partner?;
        let factor = state.collided.as_ref().map_or(1.0, |(collision, throughput)| {
            self.direct.density_of_collision(collision, *throughput, id)
        });
        Some(MisPartner { pdf: partner.pdf * factor, ..partner })
    }

    /// Follows a path from its ray on and adds what it finds to `out`. The ray is segment number `first`, counted from the camera.
    fn follow(
        &self,
        mut state: State<'a>,
        first: u32,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
        out: &mut PixelSample,
    ) {
        for depth in first..self.max_depth {
            scratch.counters.depth_sum += 1;
            scratch.counters.path_rays += u64::from(depth > 0);
            let (seen, ray, rare) = (state.seen, state.ray, Cell::new(0));
            let glint = |id| seen.map_or(1.0, |(eye, chain)| eye.lamp_weight(&chain, id, &ray, &rare));
            let before = state.line.map_or(state.throughput, Line::primaries);
            let arrival = match self.next_event(&mut state, depth, samples, (scratch, out)) {
                Event::Surface(arrival) => arrival,
                Event::Medium(collision) => {
                    if !self.scatter_in_medium(&mut state, &collision, (before, depth), samples) {
                        return;
                    }
                    continue;
                }
                Event::Escape => {
                    let found = escaped(self.scene, state.ray.direction, self.partner(&state, None), glint);
                    out.add(state.class.part(), state.received(found));
                    scratch.counters.rare_glints += rare.get();
                    return;
                }
            };
            let Arrival { hit, passed_null_interface, .. } = arrival;
            if depth == 0 && !self.scene.scatters() {
                describe_first_hit(out, self.scene, &hit);
            }
            if passed_null_interface {
                state.partner = None;
            }
            if let Some(transmittance) = arrival.transmittance {
                state.pass(transmittance);
            }
            let partner = self.partner(&state, self.scene.surface(&hit).light);
            let found = emitted(self.scene, &hit, partner, glint);
            out.add(state.class.part(), state.received(found));
            scratch.counters.rare_glints += rare.get();
            let mut shading = self.scene.shading_for(&hit, state.medium, state.line);
            let mut reflected = None;
            if shading.disperses && state.line.is_none() && self.wavelengths != Wavelengths::Off {
                reflected = self.scene.reflected_colour(&hit, state.medium, &shading, self.wavelengths);
                if reflected.is_none() {
                    state.disperse(self.wavelengths, samples);
                    shading = self.scene.shading_for(&hit, state.medium, state.line);
                }
            }
            let directions = Directions::new(self.guide, &hit, &shading, &mut scratch.counters);
            if shading.bsdf.has_specular() || shading.bsdf.has_glossy() {
                scratch.counters.interfaces += 1;
                scratch.counters.medium_mismatches +=
                    u64::from(self.scene.mismatch(&hit, state.medium).is_some());
            }
            if shading.bsdf.has_diffuse() || shading.bsdf.has_glossy() {
                let direct = self.direct.radiance(&hit, &directions, state.medium, samples, scratch);
                out.add(state.class.after(Lobe::Diffuse).part(), state.received(direct.diffuse));
                out.add(state.class.after(Lobe::Glossy).part(), state.received(direct.glossy));
            }
            if !self.scatter(&mut state, &hit, (&directions, reflected), depth, samples) {
                return;
            }
        }
        scratch.counters.truncated += 1;
    }

    /// One unbiased estimate of the irradiance at a surface in `medium`, split into the parts of the light; the cosine is included.
    pub fn irradiance(
        &self,
        receiver: &Receiver,
        medium: MediumStack,
        samples: &mut SampleStream,
        scratch: &mut Scratch,
    ) -> Irradiance {
        let mut out = PixelSample::default();
        let Receiver { hit, shading } = receiver;
        let directions = Directions::new(self.guide, hit, shading, &mut scratch.counters);
        let direct = self.direct.radiance(hit, &directions, medium, samples, scratch);
        out.add(Aov::Direct, direct.diffuse);
        let mut state = State::new(Ray::new(hit.point.position, hit.facing_normal()), medium);
        if self.scatter(&mut state, hit, (&directions, None), 0, samples) {
            self.follow(state, 1, samples, scratch, &mut out);
        }
        Irradiance::of_white(&out)
    }
}

impl Integrator for PathTracer<'_> {
    fn li(&self, camera: &EyeRay<'_>, samples: &mut SampleStream, scratch: &mut Scratch) -> PixelSample {
        let mut out = PixelSample::default();
        scratch.counters.camera_rays += 1;
        let seen = Some((camera, Chain::default()));
        self.follow(
            State { seen, ..State::new(camera.ray, self.camera_media.at(self.scene, camera.ray.origin)) },
            0,
            samples,
            scratch,
            &mut out,
        );
        out
    }
}
