//! Specular reflection and refraction seen from the camera: the second integral of eq. (2), by recursion.

use super::glints::Chain;
use crate::bsdf::{BsdfSample, Lobe};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::SampleStream;
pub(super) use crate::sampling::chain_roulette;
use crate::scene::{Scene, Shading, SurfaceInteraction};
use crate::transport::MisPartner;

/// A camera path that has met only specular and highly glossy surfaces so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub ray: Ray,
    pub throughput: Rgb,
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
}

/// Number of interfaces at which both reflection and refraction are followed; at deeper ones, one of them is sampled.
pub(super) const SPLIT_DEPTH: u32 = 3;

/// A branch with a smaller share than this is not split off but sampled with its probability.
pub(super) const SMALLEST_SHARE: f32 = 0.02;

/// Pushes the continuations at a specular surface: both of them at an interface while the branch matters; otherwise one, sampled with
/// the Fresnel term as probability.
pub(super) fn push_children(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    scene: &Scene,
    hit: &SurfaceInteraction,
    shading: &Shading,
    samples: &mut SampleStream,
) {
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
        throughput: parent.throughput * sample.throughput * share,
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
