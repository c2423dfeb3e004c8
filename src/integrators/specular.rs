//! Specular reflection and refraction seen from the camera: the second integral of eq. (2), by recursion.

use super::glints::Chain;
use crate::bsdf::{BsdfSample, Lobe};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::SampleStream;
pub(super) use crate::sampling::chain_roulette;
use crate::scene::{Scene, Shading, SurfaceInteraction};
use crate::settings::Wavelengths;
use crate::spectra::{Line, at_line};
use crate::transport::{MisPartner, refracted_at};

/// A camera path that has met only specular and highly glossy surfaces so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub ray: Ray,
    pub throughput: Rgb,
    /// The wavelength of the path since it was dispersed; later factors are taken at this wavelength.
    pub line: Option<Line>,
    pub medium: MediumStack,
    /// Number of surfaces met before.
    pub depth: u32,
    /// Share of the camera sample that this branch carries: products of Fresnel terms where paths were split.
    pub share: f32,
    /// Density of the ray for MIS; set where the ray was sampled from a highly glossy lobe and lights were sampled as well.
    pub partner: Option<MisPartner>,
    /// Whether the ray was sampled from a highly glossy lobe.
    pub is_glossy: bool,
    /// Ray-cone spread: tangent of the angle of the cone that this ray represents among the samples of the glossy lobe it comes from,
    /// directly or through specular surfaces. Zero where there was no such lobe.
    pub spread: f32,
    /// Whether the light of small emitters along this ray was already counted at its origin.
    pub widened: bool,
    /// Path length from the eye to the origin of the ray.
    pub travelled: f32,
    /// The specular chain so far; `None` after any other lobe.
    pub chain: Option<Chain>,
}

impl Branch {
    /// The branch of a path that starts with this ray.
    pub(super) fn from_eye(ray: Ray, medium: MediumStack) -> Self {
        Self {
            ray,
            throughput: Rgb::ONE,
            line: None,
            medium,
            depth: 0,
            share: 1.0,
            partner: None,
            is_glossy: false,
            spread: 0.0,
            widened: false,
            travelled: 0.0,
            chain: Some(Chain::default()),
        }
    }

    /// Light of radiance `rgb` that arrives along the ray, as the camera receives it.
    #[inline]
    pub(super) fn received(&self, rgb: Rgb) -> Rgb {
        self.throughput * at_line(self.line, rgb)
    }

    /// The same branch with a wavelength, if it takes one.
    pub(super) fn dispersed(self, line: Option<Line>) -> Self {
        let throughput = line.map_or(self.throughput, |line| line.taken_by(self.throughput));
        Self { throughput, line, ..self }
    }
}

/// Number of wavelengths, evenly spread, in which a camera sample follows light that is dispersed for the first time.
const LINES: u32 = 4;

/// Number of interfaces at which both reflection and refraction are followed; at deeper ones, one of them is sampled.
pub(super) const SPLIT_DEPTH: u32 = 3;

/// A branch with a smaller share than this is not split off but sampled with its probability.
pub(super) const SMALLEST_SHARE: f32 = 0.02;

/// Pushes the continuations at a specular surface: both of them at an interface while the branch matters; otherwise one, sampled with
/// the Fresnel term as probability. Where the interface disperses light, a branch without a wavelength takes several of these
/// `wavelengths`, or one where it is not split.
pub(super) fn push_children(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    (scene, wavelengths): (&Scene, Wavelengths),
    hit: &SurfaceInteraction,
    shading: &Shading,
    samples: &mut SampleStream,
) {
    if shading.disperses && parent.line.is_none() && wavelengths != Wavelengths::Off {
        match scene.reflected_colour(hit, parent.medium, shading, wavelengths) {
            Some(colour) => {
                push_dispersed(branches, parent, (scene, wavelengths), (hit, shading), colour, samples)
            }
            None => {
                let is_split = parent.depth < SPLIT_DEPTH && parent.share > SMALLEST_SHARE;
                let each = each_line(if is_split { LINES } else { 1 }, samples.next_1d());
                for (u, share) in each {
                    let parent = Branch {
                        throughput: parent.throughput * share,
                        share: parent.share * share,
                        ..*parent
                    }
                    .dispersed(Line::choose(wavelengths, u));
                    let shading = scene.shading_for(hit, parent.medium, parent.line);
                    push_children(branches, &parent, (scene, wavelengths), hit, &shading, samples);
                }
            }
        }
        return;
    }
    let reflectance = shading.bsdf.reflection_probability(shading.wo_local);
    let smaller = parent.share * reflectance.min(1.0 - reflectance);
    if parent.depth < SPLIT_DEPTH && smaller > SMALLEST_SHARE {
        // Zero selects reflection; the largest number selects refraction.
        for (u, share) in [(0.0, reflectance), (crate::sampling::ONE_MINUS_EPSILON, 1.0 - reflectance)] {
            push(branches, parent, scene, hit, shading, (u, share));
        }
    } else {
        let Some(weight) = chain_roulette(parent.depth, || samples.next_1d()) else { return };
        let parent = Branch { throughput: parent.throughput * weight, ..*parent };
        push(branches, &parent, scene, hit, shading, (samples.next_1d(), 1.0));
    }
}

/// Random numbers for `count` wavelengths, evenly spread, each with its share.
fn each_line(count: u32, u: f32) -> impl Iterator<Item = (f32, f32)> {
    let share = 1.0 / count as f32;
    (0..count).map(move |i| ((u + i as f32) * share, share))
}

/// [`push_children`] for a branch without a wavelength at a smooth interface that reflects light of this `colour`, relative to `shading`:
/// reflected light needs no wavelength.
fn push_dispersed(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    (scene, wavelengths): (&Scene, Wavelengths),
    (hit, shading): (&SurfaceInteraction, &Shading),
    colour: Rgb,
    samples: &mut SampleStream,
) {
    let reflectance = shading.bsdf.reflection_probability(shading.wo_local);
    let smaller = parent.share * reflectance.min(1.0 - reflectance);
    let is_split = parent.depth < SPLIT_DEPTH && smaller > SMALLEST_SHARE;
    let mut parent = *parent;
    let (mut reflects, mut refracts) = (Some(reflectance), Some(1.0 - reflectance));
    if !is_split {
        let Some(weight) = chain_roulette(parent.depth, || samples.next_1d()) else { return };
        parent.throughput *= weight;
        let is_reflected = samples.next_1d() < reflectance;
        (reflects, refracts) = if is_reflected { (Some(1.0), None) } else { (None, Some(1.0)) };
    }
    if let Some(share) = reflects {
        let reflected = Branch { throughput: parent.throughput * colour, ..parent };
        push(branches, &reflected, scene, hit, shading, (0.0, share));
    }
    let Some(refracted) = refracts else { return };
    let count =
        if parent.depth < SPLIT_DEPTH && parent.share * refracted > SMALLEST_SHARE { LINES } else { 1 };
    for (u, share) in each_line(count, samples.next_1d()) {
        let at = parent.dispersed(Line::choose(wavelengths, u));
        let at_wavelength = scene.shading_for(hit, at.medium, at.line);
        let sample = refracted_at(&at_wavelength, shading);
        push_sample(branches, &at, scene, (hit, &at_wavelength), sample, share * refracted);
    }
}

/// Pushes the continuation by the specular lobe of a surface that also has other lobes.
pub(super) fn push_specular(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    scene: &Scene,
    hit: &SurfaceInteraction,
    shading: &Shading,
    u: f32,
) {
    let sample = shading.sample_lobe(Lobe::Specular, u, glam::Vec2::ZERO);
    push_sample(branches, parent, scene, (hit, shading), sample, 1.0);
}

fn push(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    scene: &Scene,
    hit: &SurfaceInteraction,
    shading: &Shading,
    (u, share): (f32, f32),
) {
    let sample = shading.sample(u, glam::Vec2::ZERO);
    push_sample(branches, parent, scene, (hit, shading), sample, share);
}

fn push_sample(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    scene: &Scene,
    (hit, shading): (&SurfaceInteraction, &Shading),
    sample: Option<BsdfSample>,
    share: f32,
) {
    let Some(sample) = sample else { return };
    let direction = shading.frame.to_world(sample.wi);
    let Some(medium) = scene.medium_after(parent.medium, hit, shading, direction, sample.transmission) else {
        return;
    };
    branches.push(Branch {
        ray: hit.spawn(direction),
        throughput: parent.received(sample.throughput) * share,
        line: parent.line,
        medium,
        depth: parent.depth + 1,
        share: parent.share * share,
        partner: None,
        is_glossy: false,
        spread: parent.spread,
        widened: false,
        travelled: parent.travelled + hit.distance,
        chain: parent.chain.and_then(|chain| chain.after(hit, shading, sample.transmission)),
    });
}
