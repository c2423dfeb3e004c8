//! The second integral at surfaces with highly glossy lobes: distribution rays, a limited number of them (Jensen 1996,
//! section 4.2).

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

/// Least probability with which a path is continued: estimates of albedos may be too low.
const LEAST_SURVIVAL: f32 = 0.05;

/// What a highly glossy lobe reflects at least to get all distribution rays.
const FULL_WEIGHT: f32 = 0.25;

/// Pushes what continues from a surface with a highly glossy lobe, and perhaps an ideal specular one beside it.
///
/// Where the surface matters to the camera sample both lobes are followed, the specular one by one ray and the glossy one
/// by `glossy_samples` times the share of the camera sample that arrives, so that a glossy surface seen in another gets
/// one ray for each; by fewer where the lobe reflects less than a quarter, as that of a varnish does: its noise counts by that
/// share. Elsewhere one ray is drawn for both, and ends by roulette.
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
            throughput: parent.throughput * sample.throughput * factor,
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

/// One of both lobes by their weights, its weight, and what the choice leaves of `u`.
fn choose(u: f32, glossy: f32, specular: f32) -> (Lobe, f32, f32) {
    let probability = glossy / (glossy + specular);
    let (lobe, weight, rest) = if u < probability {
        (Lobe::Glossy, glossy, u / probability)
    } else {
        (Lobe::Specular, specular, (u - probability) / (1.0 - probability))
    };
    (lobe, weight, rest.clamp(0.0, ONE_MINUS_EPSILON))
}

/// A gather ray that goes on.
pub(super) struct Continued {
    pub ray: Ray,
    pub medium: MediumStack,
    pub throughput: Rgb,
}

impl PhotonMapIntegrator<'_> {
    /// One additional ray by which approximate evaluation goes on at a surface with glossy lobes, or mixed ones (section
    /// 2: highly glossy surfaces are traced there too); `None` where it ends. `numbers` are hashes of the gather ray's own.
    ///
    /// From the `first` surface more often than in proportion to what it reflects, by the root of that: a floor that
    /// mirrors a seventh of the light would else now and then bring all of what it shows. Always would be too often, since a
    /// ray that goes on costs as much as one more.
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
