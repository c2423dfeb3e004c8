//! Walk from the camera over specular and highly glossy lobes to surfaces with other lobes.

use super::Vertex;
use super::glossy::push_scattered;
use crate::film::{Aov, PixelSample};
use crate::integrators::specular::{Branch, push_children};
use crate::integrators::{EyeRay, Scratch, describe_first_hit};
use crate::math::Rgb;
use crate::media::MediumStack;
use crate::sampling::SampleStream;
use crate::scene::Scene;
use crate::settings::Wavelengths;
use crate::spectra::{Line, at_line};
use crate::transport::{Arrival, Event, Stretch, emitted, escaped, next_event, surface_through_media};
use std::cell::Cell;

/// Width of the cone of a ray that carries so little light that its end is read from a map, over the length of its path: that of one of 256
/// gather rays.
const FAINT_WIDTH: f32 = 0.125;

/// Parameters of following a camera ray.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    pub scene: &'a Scene,
    /// Largest number of surfaces in a path.
    pub max_depth: u32,
    /// Distribution rays at the first highly glossy lobe of a camera sample.
    pub glossy_samples: u32,
    /// Whether lights are sampled at highly glossy lobes; emission that their rays hit then gets an MIS weight.
    pub samples_lights: bool,
    /// Wavelengths of paths where light is dispersed.
    pub wavelengths: Wavelengths,
    /// Light that media scatter along a path; `None` where it is not needed.
    pub media: Option<&'a ScatteredAlong<'a>>,
}

/// Radiance of the light that a stretch of a medium scatters, by part of the picture, from the throughput of a path at its start.
pub(super) type ScatteredAlong<'a> =
    dyn Fn(&Stretch<'_>, Rgb, &mut SampleStream, &mut Scratch) -> [(Aov, Rgb); 3] + 'a;

/// Follows a camera ray through specular and highly glossy lobes. Calls `shade` at each surface that has a diffuse lobe, or a highly
/// glossy one, at which lights are sampled. All light behind the first such lobe belongs to the specular part.
pub(super) fn walk_specular<const N: usize>(
    walk: Walk<'_>,
    camera: &EyeRay<'_>,
    camera_medium: MediumStack,
    samples: &mut SampleStream,
    scratch: &mut Scratch,
    shade: &mut impl FnMut(&Vertex<'_>, &mut SampleStream, &mut Scratch) -> [(Aov, Rgb); N],
) -> PixelSample {
    let Walk { scene, max_depth, glossy_samples, samples_lights, wavelengths, media } = walk;
    let mut out = PixelSample::default();
    scratch.counters.camera_rays += 1;
    let mut branches = std::mem::take(&mut scratch.branches);
    branches.clear();
    branches.push(Branch::from_eye(camera.ray, camera_medium));
    while let Some(mut branch) = branches.pop() {
        let first = branch.depth == 0;
        let part = |aov: Aov| if first { aov } else { Aov::Specular };
        scratch.counters.depth_sum += 1;
        scratch.counters.specular_rays += u64::from(!(first || branch.is_glossy));
        scratch.counters.glossy_rays += u64::from(branch.is_glossy);
        let (chain, ray, rare) = (branch.chain, branch.ray, Cell::new(0));
        let widened = Cell::new(branch.widened);
        let glint = |id| match chain {
            Some(chain) => camera.lamp_weight(&chain, id, &ray, &rare),
            None if widened.get() && camera.has_widened(id, &ray) => 0.0,
            None => 1.0,
        };
        let event = if scene.scatters() {
            let (throughput, line) = (branch.throughput, branch.line);
            // What decides between the channels of media.
            let weights = line.map_or(throughput, Line::primaries);
            let u = samples.next_1d();
            let passage = surface_through_media(scene, &branch.ray, &mut branch.medium, u, |stretch| {
                let there = weights * stretch.weight;
                let Some(media) = media.filter(|_| there != Rgb::ZERO) else { return };
                for (aov, radiance) in media(stretch, there, samples, scratch) {
                    out.add(part(aov), throughput * at_line(line, stretch.weight * radiance));
                }
            });
            out.add(part(Aov::Emission), branch.received(passage.emitted));
            branch.throughput = branch.received(passage.weight);
            passage.event
        } else {
            next_event(scene, &branch.ray, &mut branch.medium)
        };
        let Event::Surface(arrival) = event else {
            let found = escaped(scene, branch.ray.direction, branch.partner, glint);
            out.add(part(Aov::Emission), branch.received(found));
            scratch.counters.rare_glints += rare.get();
            continue;
        };
        let Arrival { hit, passed_null_interface, .. } = arrival;
        if first {
            describe_first_hit(&mut out, scene, &hit);
        }
        if passed_null_interface {
            branch.partner = None;
            widened.set(false);
        }
        if let Some(transmittance) = arrival.transmittance {
            branch.throughput = branch.received(transmittance);
        }
        let found = emitted(scene, &hit, branch.partner, glint);
        out.add(part(Aov::Emission), branch.received(found));
        scratch.counters.rare_glints += rare.get();
        let mut shading = scene.shading_for(&hit, branch.medium, branch.line);
        if shading.disperses
            && branch.line.is_none()
            && wavelengths != Wavelengths::Off
            && !shading.bsdf.is_delta()
        {
            // Each direction that a rough surface reflects or refracts may be another at another wavelength.
            branch = branch.dispersed(Line::choose(wavelengths, samples.next_1d()));
            shading = scene.shading_for(&hit, branch.medium, branch.line);
        }
        let bsdf = &shading.bsdf;
        if bsdf.has_specular() || bsdf.has_glossy() {
            scratch.counters.interfaces += 1;
            let before = branches.len();
            scratch.counters.medium_mismatches += u64::from(scene.mismatch(&hit, branch.medium).is_some());
            if branch.depth + 1 >= max_depth {
                scratch.counters.truncated += 1;
            } else if bsdf.is_delta() {
                push_children(&mut branches, &branch, (scene, wavelengths), &hit, &shading, samples);
            } else {
                let how = (scene, samples_lights, glossy_samples);
                push_scattered(&mut branches, &branch, how, &hit, &shading, samples);
            }
            for next in branches[before..]
                .iter_mut()
                .filter(|next| branch.spread > 0.0 && !next.is_glossy && next.line.is_none())
            {
                let at = (&hit, &shading);
                if let Some(found) = camera.widened((&branch, next), at, samples, scratch) {
                    next.widened = true;
                    out.add(Aov::Specular, found);
                }
            }
        }
        if bsdf.is_delta() {
            continue;
        }
        let vertex = Vertex {
            hit: &hit,
            shading: &shading,
            medium: branch.medium,
            share: branch.share,
            weight: branch.throughput.abs().max_element(),
            depth: branch.depth + 1,
            travelled: branch.travelled + hit.distance,
            width: FAINT_WIDTH * (branch.travelled + hit.distance),
        };
        for (aov, radiance) in shade(&vertex, samples, scratch) {
            out.add(part(aov), branch.received(radiance));
        }
        out.bias += branch.throughput * std::mem::take(&mut scratch.bias);
    }
    scratch.branches = branches;
    out
}
