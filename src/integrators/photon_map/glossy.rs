//! The second integral at surfaces with highly glossy lobes: a limited number of distribution rays (Jensen 1996, section 4.2).

use super::PhotonMapIntegrator;
use crate::bsdf::Lobe;
use crate::integrators::glints::spread_of;
use crate::integrators::specular::{Branch, SMALLEST_SHARE, SPLIT_DEPTH, chain_roulette};
use crate::math::{Ray, Rgb};
use crate::media::MediumStack;
use crate::sampling::{ONE_MINUS_EPSILON, SampleStream};
use crate::scene::{Scene, Shading, SurfaceInteraction};
use crate::transport::{MisPartner, receiver};
use glam::Vec2;

/// Smallest probability with which a path is continued, because estimates of albedos may be too low.
const LEAST_SURVIVAL: f32 = 0.05;

/// Smallest reflectance with which a highly glossy lobe gets all distribution rays.
const FULL_WEIGHT: f32 = 0.25;

/// Pushes the continuations at a surface with a highly glossy lobe, which may also have an ideal specular one.
///
/// Where the surface matters to the camera sample, both lobes are followed: the specular one by one ray, the glossy one by
/// `glossy_samples` times the share of the camera sample that arrives. A glossy surface seen in another glossy surface therefore gets
/// one ray for each ray of the other. A lobe that reflects less than a quarter, such as that of a varnish, gets fewer rays, because its
/// noise is scaled by its reflectance. Elsewhere one ray is sampled for both lobes and ends by Russian roulette.
pub(super) fn push_scattered(
    branches: &mut Vec<Branch>,
    parent: &Branch,
    (scene, samples_lights, glossy_samples): (&Scene, bool, u32),
    hit: &SurfaceInteraction,
    shading: &Shading,
    samples: &mut SampleStream,
) {
    let [_, glossy, specular] = shading.bsdf.lobe_weights(shading.wo_local);
    let total = glossy + specular;
    if !(total > 0.0) {
        return;
    }
    let mut push = |lobe: Lobe, [x, y, u_lobe, _]: [f32; 4], factor: f32, share: f32, count: u32| {
        let Some(sample) = shading.sample_lobe(lobe, u_lobe, Vec2::new(x, y)) else { return };
        let direction = shading.frame.to_world(sample.wi);
        let after = scene.medium_after(parent.medium, hit, shading, direction, sample.transmission);
        let Some(medium) = after else { return };
        let is_glossy = lobe == Lobe::Glossy;
        branches.push(Branch {
            ray: hit.spawn(direction),
            throughput: parent.received(sample.throughput) * factor,
            line: parent.line,
            medium,
            depth: parent.depth + 1,
            share: parent.share * share,
            travelled: parent.travelled + hit.distance,
            partner: (samples_lights && is_glossy)
                .then(|| MisPartner { from: receiver(scene, hit), pdf: sample.pdf_solid_angle }),
            is_glossy,
            spread: parent.spread.max(if is_glossy { spread_of(sample.pdf_solid_angle, count) } else { 0.0 }),
            widened: false,
            chain: parent
                .chain
                .filter(|_| !is_glossy)
                .and_then(|chain| chain.after(hit, shading, sample.transmission)),
        });
    };
    let alone = glossy.min(specular) <= 0.0;
    if parent.depth < SPLIT_DEPTH && (alone || parent.share * glossy.min(specular) > SMALLEST_SHARE) {
        if glossy > 0.0 {
            let wanted = glossy_samples as f32 * parent.share * (glossy / FULL_WEIGHT).min(1.0);
            let count = (wanted.ceil() as u32).clamp(1, glossy_samples);
            let splits = samples.splits(glossy_samples);
            let each = 1.0 / count as f32;
            for i in 0..count {
                push(Lobe::Glossy, splits.get_4d(i), each, each * glossy.min(1.0), count);
            }
        }
        if specular > 0.0 {
            push(Lobe::Specular, [0.0, 0.0, samples.next_1d(), 0.0], 1.0, specular.min(1.0), 1);
        }
        return;
    }
    let survival = if parent.depth < SPLIT_DEPTH { 1.0 } else { total.clamp(LEAST_SURVIVAL, 1.0) };
    let [x, y, u_lobe, u] = samples.splits(1).get_4d(0);
    if u >= survival {
        return;
    }
    let Some(weight) = chain_roulette(parent.depth, || samples.next_1d()) else { return };
    let (lobe, chosen, rest) = choose(u_lobe, glossy, specular);
    push(lobe, [x, y, rest, 0.0], weight * total / chosen / survival, total.min(1.0), 1);
}

/// Selects one of both lobes by their weights; returns it, its weight, and the remainder of `u`.
fn choose(u: f32, glossy: f32, specular: f32) -> (Lobe, f32, f32) {
    let probability = glossy / (glossy + specular);
    let (lobe, weight, rest) = if u < probability {
        (Lobe::Glossy, glossy, u / probability)
    } else {
        (Lobe::Specular, specular, (u - probability) / (1.0 - probability))
    };
    (lobe, weight, rest.clamp(0.0, ONE_MINUS_EPSILON))
}

/// Continuation of a gather ray.
pub(super) struct Continued {
    pub ray: Ray,
    pub medium: MediumStack,
    pub throughput: Rgb,
}

impl PhotonMapIntegrator<'_> {
    /// One additional ray that continues approximate evaluation at a surface with glossy lobes or mixed ones (section 2: highly glossy
    /// surfaces are traced there too); `None` where the path ends. `numbers` are hashes of the gather ray's own random number.
    ///
    /// At the `first` surface the probability is the root of the reflectance and not the reflectance itself. A floor that mirrors a
    /// seventh of the light would otherwise now and then contribute everything that it mirrors. To continue always would be too often,
    /// because a continued ray costs as much as an additional one.
    pub(super) fn continue_gathering(
        &self,
        (medium, first): (MediumStack, bool),
        hit: &SurfaceInteraction,
        shading: &Shading,
        numbers: [f32; 4],
    ) -> Option<Continued> {
        let [_, glossy, specular] = shading.bsdf.lobe_weights(shading.wo_local);
        let total = glossy + specular;
        let survival = if first { total.sqrt() } else { total }.clamp(LEAST_SURVIVAL, 1.0);
        let [x, y, u_lobe, u] = numbers;
        if !(total > 0.0) || u >= survival {
            return None;
        }
        let (lobe, chosen, rest) = choose(u_lobe, glossy, specular);
        let sample = shading.sample_lobe(lobe, rest, Vec2::new(x, y))?;
        let direction = shading.frame.to_world(sample.wi);
        let medium = self.scene.medium_after(medium, hit, shading, direction, sample.transmission)?;
        let throughput = sample.throughput * (total / chosen / survival);
        Some(Continued { ray: hit.spawn(direction), medium, throughput })
    }
}
