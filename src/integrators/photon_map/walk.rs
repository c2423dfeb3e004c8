//! From the camera to the first surfaces that are not specular.

use super::Vertex;
use crate::film::{Aov, PixelSample};
use crate::integrators::specular::{Branch, push_children};
use crate::integrators::{Scratch, describe_first_hit};
use crate::lights::Light;
use crate::math::{Ray, Rgb};
use crate::media::MediumId;
use crate::sampling::SampleStream;
use crate::scene::Scene;

/// Follows a camera ray through specular surfaces and calls `shade` at each diffuse surface it ends on. What is behind a
/// specular surface belongs to the specular part whatever it is.
pub(super) fn walk_specular<const N: usize>(
    scene: &Scene,
    ray: Ray,
    medium: MediumId,
    max_depth: u32,
    samples: &mut SampleStream,
    scratch: &mut Scratch,
    shade: &mut impl FnMut(&Vertex<'_>, &mut SampleStream, &mut Scratch) -> [(Aov, Rgb); N],
) -> PixelSample {
    let mut out = PixelSample::default();
    scratch.counters.camera_rays += 1;
    let mut branches = std::mem::take(&mut scratch.branches);
    branches.clear();
    branches.push(Branch { ray, throughput: Rgb::ONE, medium, depth: 0, share: 1.0, travelled: 0.0 });
    while let Some(mut branch) = branches.pop() {
        let first = branch.depth == 0;
        let part = |aov: Aov| if first { aov } else { Aov::Specular };
        scratch.counters.depth_sum += 1;
        scratch.counters.specular_rays += u64::from(!first);
        let Some(hit) = scene.intersect(&branch.ray) else {
            if let Some(Light::Environment(sky)) = scene.environment().map(|id| &scene.lights()[id as usize])
            {
                out.add(part(Aov::Emission), branch.throughput * sky.radiance);
            }
            continue;
        };
        if first {
            describe_first_hit(&mut out, scene, &hit);
        }
        let medium = scene.medium(branch.medium);
        if !medium.is_clear() {
            branch.throughput *= medium.transmittance(hit.distance);
        }
        if let Some(Light::Area(area)) = scene.surface(&hit).light.map(|id| &scene.lights()[id as usize]) {
            out.add(part(Aov::Emission), branch.throughput * area.emitted(hit.is_front()));
        }
        let shading = hit.shading(scene.material(&hit));
        if shading.bsdf.is_delta() {
            scratch.counters.interfaces += 1;
            scratch.counters.medium_mismatches += u64::from(scene.is_medium_mismatch(&hit, branch.medium));
            if branch.depth + 1 >= max_depth {
                scratch.counters.truncated += 1;
                continue;
            }
            push_children(&mut branches, &branch, scene, &hit, &shading, samples);
            continue;
        }
        let vertex = Vertex {
            hit: &hit,
            shading: &shading,
            medium: branch.medium,
            share: branch.share,
            weight: branch.throughput.max_element(),
            depth: branch.depth + 1,
            travelled: branch.travelled + hit.distance,
        };
        for (aov, radiance) in shade(&vertex, samples, scratch) {
            out.add(part(aov), branch.throughput * radiance);
        }
    }
    scratch.branches = branches;
    out
}
