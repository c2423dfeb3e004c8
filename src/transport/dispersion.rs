//! Refraction of a path that takes a wavelength.

use crate::bsdf::{BsdfSample, Lobe};
use crate::sampling::ONE_MINUS_EPSILON;
use crate::scene::Shading;
use glam::Vec2;

/// Refraction of a camera path at a smooth interface, where the path chose refraction by the Fresnel term of `shading`, at the d line, and
/// then took the wavelength of `at_line`. `None` where nothing of this wavelength is refracted.
pub fn refracted_at(at_line: &Shading, shading: &Shading) -> Option<BsdfSample> {
    let sample = at_line.sample_lobe(Lobe::Specular, ONE_MINUS_EPSILON, Vec2::ZERO)?;
    let weight = refracted_share(at_line, shading)?;
    sample.transmission.then_some(BsdfSample { throughput: sample.throughput * weight, ..sample })
}

/// Share of the light that is refracted at the wavelength of `at_line`, over that of `shading`; `None` where nothing is refracted.
pub fn refracted_share(at_line: &Shading, shading: &Shading) -> Option<f32> {
    let refracted = |shading: &Shading| 1.0 - shading.bsdf.reflection_probability(shading.wo_local);
    let (share, usual) = (refracted(at_line), refracted(shading));
    (share > 0.0 && usual > 0.0).then(|| share / usual)
}
